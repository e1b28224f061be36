#pragma once

/// \file
/// Upper bounds of the largest singular value.

#include "elliptude/base/rounding.hpp"

namespace elliptude {

/// aᵀa, exactly symmetric.
template <typename Scalar, int Rows, int Columns>
[[nodiscard]] Matrix<Scalar, Columns> gram_of(const Matrix<Scalar, Rows, Columns>& a) noexcept {
  Matrix<Scalar, Columns> gram;
  for (int j = 0; j < Columns; ++j) {
    for (int i = 0; i <= j; ++i) {
      gram(i, j) = a.col(i).dot(a.col(j));
      gram(j, i) = gram(i, j);
    }
  }
  return gram;
}

/// An upper bound of the largest singular value of B with BᵀB = gram: the largest eigenvalue is within √(N − 1)
/// standard deviations of the mean of all (Samuelson's inequality), and the traces of the gram matrix and of its square
/// give both. Too large by at most √((1 + √N)/2), or √N where the fourth power of the result is beyond the numbers'
/// range; only by rounding where all singular values are alike, or all but one are zero.
template <typename Scalar, int N>
[[nodiscard]] Scalar norm_of_gram(const Matrix<Scalar, N>& gram) noexcept {
  static_assert(N <= 6);  // rounding is counted for that
  using Value = scalar::Value<Scalar>;
  const Scalar trace = gram.trace();
  const Scalar mean = trace / Scalar(N);
  const Scalar square = mean * mean;
  if (!(square > Scalar(std::numeric_limits<Value>::min()) / rounding::one_rounding<Scalar>())) {
    // The squares are lost; the trace bounds it too.
    return scalar::sqrt(trace < Scalar(0) ? Scalar(-trace) : trace);
  }
  const Scalar variance = gram.squaredNorm() / Scalar(N) - square;
  const Scalar rounding = rounding::share<Scalar>(rounding::variance) * square;
  const Scalar most = Scalar(N - 1) * ((variance < Scalar(0) ? Scalar(0) : variance) + rounding);
  return scalar::sqrt(Scalar(mean + scalar::sqrt(most)));
}

/// An upper bound of the largest singular value.
template <typename Scalar, int Rows, int Columns>
[[nodiscard]] Scalar spectral_norm(const Matrix<Scalar, Rows, Columns>& matrix) noexcept {
  if constexpr (Rows <= Columns) {
    const Matrix<Scalar, Rows> gram = matrix.lazyProduct(matrix.transpose());
    return norm_of_gram(gram);
  } else {
    return norm_of_gram(gram_of(matrix));
  }
}

}  // namespace elliptude
