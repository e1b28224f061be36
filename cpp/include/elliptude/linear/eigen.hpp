#pragma once

/// \file
/// Eigenvalues and eigenvectors of small symmetric matrices.

#include <utility>

#include "elliptude/base/rounding.hpp"
#include "elliptude/base/status.hpp"
#include "elliptude/linear/detail/jacobi_rotation.hpp"

namespace elliptude {

/// Eigenvalues, largest first, and the orthonormal eigenvectors of a symmetric matrix, as columns in the same order.
template <typename Scalar, int N>
struct SymmetricEigen {
  Vector<Scalar, N> values;
  Matrix<Scalar, N> vectors;
};

/// Jacobi's cyclic method: small eigenvalues of graded matrices come out with nearly full digits.
/// \return `not_finite`, or `not_converged` after a bounded number of sweeps (not seen; quadratic convergence takes 4
/// to 7).
template <typename Scalar, int N>
[[nodiscard]] Status symmetric_eigen(const Matrix<Scalar, N>& symmetric, SymmetricEigen<Scalar, N>& eigen) noexcept {
  if (!scalar::all_finite(symmetric)) {
    return Status::not_finite;
  }
  Matrix<Scalar, N> a = symmetrized(symmetric);
  Matrix<Scalar, N> vectors = Matrix<Scalar, N>::Identity();
  constexpr int most_sweeps = 30;
  bool converged = false;
  for (int sweep = 0; sweep < most_sweeps && !converged; ++sweep) {
    converged = true;
    for (int p = 0; p < N - 1; ++p) {
      for (int q = p + 1; q < N; ++q) {
        const Scalar off = a(p, q);
        const Scalar diagonal = scalar::sqrt(scalar::abs(a(p, p))) * scalar::sqrt(scalar::abs(a(q, q)));
        const Scalar largest = a.cwiseAbs().maxCoeff();
        if (scalar::abs(off) <= rounding::share<Scalar>(1) * diagonal ||
            scalar::abs(off) <= Scalar(std::numeric_limits<scalar::Value<Scalar>>::min()) ||
            scalar::abs(off) <= rounding::square<Scalar>() * largest) {
          continue;
        }
        converged = false;
        // The rotation that makes entry (p, q) zero.
        const auto rotation = detail::JacobiRotation<Scalar>::of(Scalar(a(q, q) - a(p, p)), off);
        for (int k = 0; k < N; ++k) {
          rotation.turn(a(k, p), a(k, q));
        }
        for (int k = 0; k < N; ++k) {
          rotation.turn(a(p, k), a(q, k));
          rotation.turn(vectors(k, p), vectors(k, q));
        }
        a(p, q) = Scalar(0);
        a(q, p) = Scalar(0);
      }
    }
  }
  if (!converged) {
    return Status::not_converged;
  }
  for (int i = 0; i < N - 1; ++i) {
    int largest = i;
    for (int j = i + 1; j < N; ++j) {
      if (a(j, j) > a(largest, largest)) {
        largest = j;
      }
    }
    std::swap(a(i, i), a(largest, largest));
    vectors.col(i).swap(vectors.col(largest));
  }
  eigen.values = a.diagonal();
  eigen.vectors = vectors;
  return Status::ok;
}

}  // namespace elliptude
