#pragma once

/// \file
/// Quadratic forms of six numbers as columns that can be added and multiplied by the matrices of linear maps. (theory, section
/// 17.4)
///
/// A form uᵀHu is packed as the entries H(j, (j + d) mod 6), column after column for d = 0 … 3, those with d = 1 and 2 times √2;
/// those with d = 3 stand there twice. Its value is then the inner product with u uᵀ packed in the same way, which has the
/// length ‖u‖². There are 24 entries, whole SIMD registers of any width.

#include "elliptude/base/scalar.hpp"

namespace elliptude {
namespace detail::packed {

constexpr int size = 24;

template <typename Scalar>
using Form = Vector<Scalar, size>;
/// Six forms, one a column: a quadratic map of six numbers to six.
template <typename Scalar>
using Forms = Matrix<Scalar, size, 6>;

/// What the entries of a diagonal are multiplied by.
template <typename Scalar>
[[nodiscard]] Scalar weight(int diagonal) noexcept {
  return diagonal == 1 || diagonal == 2 ? scalar::constant<Scalar>(1.41421356237309504880168872420969807857L)
                                        : Scalar(1);
}

/// A linear form aᵀu, as it goes into products.
template <typename Scalar>
struct Factor {
  Form<Scalar> first;   // a(j), where the entry (j, k) is packed
  Form<Scalar> second;  // a(k), times half the weight

  explicit Factor(const Vector6<Scalar>& a) noexcept {
    for (int d = 0; d < 4; ++d) {
      const Scalar half_weight = scalar::constant<Scalar>(0.5L) * weight<Scalar>(d);
      for (int j = 0; j < 6; ++j) {
        first(6 * d + j) = a(j);
        second(6 * d + j) = half_weight * a((j + d) % 6);
      }
    }
  }
};

/// The form (aᵀu)(bᵀu).
template <typename Scalar>
[[nodiscard]] Form<Scalar> product(const Factor<Scalar>& a, const Factor<Scalar>& b) noexcept {
  return a.first.cwiseProduct(b.second) + a.second.cwiseProduct(b.first);
}

/// The symmetric matrix of a form.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> unpacked(const Form<Scalar>& form) noexcept {
  Matrix6<Scalar> matrix;
  for (int d = 0; d < 4; ++d) {
    const Scalar factor = Scalar(1) / weight<Scalar>(d);
    for (int j = 0; j < 6; ++j) {
      const int k = (j + d) % 6;
      matrix(j, k) = factor * form(6 * d + j);
      matrix(k, j) = matrix(j, k);
    }
  }
  return matrix;
}

/// Six forms as symmetric matrices of eight rows, of which two are zeros to fill SIMD registers; each is a column. Unlike packed
/// forms they are cheap to multiply by maps. The inner product of columns is that of packed forms.
template <typename Scalar>
using Slices = Matrix<Scalar, 48, 6>;

template <typename Scalar>
[[nodiscard]] auto slice(Slices<Scalar>& slices, int i) noexcept {
  return Eigen::Map<Matrix<Scalar, 8, 6>>(slices.col(i).data());
}
template <typename Scalar>
[[nodiscard]] auto slice(const Slices<Scalar>& slices, int i) noexcept {
  return Eigen::Map<const Matrix<Scalar, 8, 6>>(slices.col(i).data());
}

/// The quadratic map q in the coordinates of a set, u = map v: map⁻¹ q(map v). The map is a lower triangle.
template <typename Scalar>
[[nodiscard]] Slices<Scalar> seen_from(const Forms<Scalar>& forms, const Matrix6<Scalar>& map,
                                       const Matrix6<Scalar>& inverse) noexcept {
  Matrix<Scalar, 8, 6> transposed = Matrix<Scalar, 8, 6>::Zero();
  transposed.template topRows<6>() = map.transpose();
  Slices<Scalar> images;
  for (int i = 0; i < 6; ++i) {
    const Matrix<Scalar, 8, 6> half = transposed.lazyProduct(unpacked<Scalar>(forms.col(i)));
    slice(images, i) = half.lazyProduct(map);
  }
  Slices<Scalar> result;
  for (int i = 0; i < 6; ++i) {
    result.col(i) = inverse(i, 0) * images.col(0);
    for (int k = 1; k <= i; ++k) {
      result.col(i) += inverse(i, k) * images.col(k);
    }
  }
  return result;
}

/// The cubic form uᵀq(u) of a quadratic map q, as a symmetric tensor: slice i is a quadratic form again. Its norm can be much
/// smaller than that of q: a part of q that only turns u is no growth.
template <typename Scalar>
[[nodiscard]] Slices<Scalar> symmetric_part(const Slices<Scalar>& slices) noexcept {
  const Scalar third = scalar::constant<Scalar>(1.0L / 3.0L);
  Slices<Scalar> across = Slices<Scalar>::Zero();  // H_j(i, k) as entry j of column k of slice i
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k <= i; ++k) {
      for (int j = 0; j < 6; ++j) {
        across(8 * k + j, i) = slices(8 * k + i, j);
      }
    }
  }
  Slices<Scalar> result;
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k <= i; ++k) {
      slice(result, i).col(k) = third * (slice(slices, i).col(k) + slice(slices, k).col(i) + slice(across, i).col(k));
      slice(result, k).col(i) = slice(result, i).col(k);
    }
  }
  return result;
}

}  // namespace detail::packed
}  // namespace elliptude
