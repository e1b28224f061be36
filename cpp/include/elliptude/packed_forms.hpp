#pragma once

/// \file
/// Quadratic forms of six numbers as columns that can be added and multiplied by the matrices of linear maps. (theory, section
/// 17.4)
///
/// A form uᵀHu is packed as the entries H(j, (j + d) mod 6), column after column for d = 0 … 3, those with d = 1 and 2 times √2;
/// those with d = 3 stand there twice. Its value is then the inner product with u uᵀ packed in the same way, which has the
/// length ‖u‖². There are 24 entries, whole SIMD registers of any width.

#include "elliptude/scalar.hpp"

namespace elliptude {
namespace packed {

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

/// The form of a symmetric matrix.
template <typename Derived>
[[nodiscard]] Form<typename Derived::Scalar> pack(const Eigen::MatrixBase<Derived>& matrix) noexcept {
  using Scalar = typename Derived::Scalar;
  Form<Scalar> form;
  for (int d = 0; d < 4; ++d) {
    for (int j = 0; j < 6; ++j) {
      form(6 * d + j) = weight<Scalar>(d) * matrix((j + d) % 6, j);
    }
  }
  return form;
}

/// The forms as they are of v with u = map v.
template <typename Scalar>
[[nodiscard]] Forms<Scalar> of_image(const Forms<Scalar>& forms, const Matrix6<Scalar>& map) noexcept {
  Matrix<Scalar, 8, 6> transposed = Matrix<Scalar, 8, 6>::Zero();  // two rows of zeros fill the registers
  transposed.template topRows<6>() = map.transpose();
  Forms<Scalar> result;
  for (int i = 0; i < 6; ++i) {
    const Matrix<Scalar, 8, 6> half = transposed.lazyProduct(unpacked<Scalar>(forms.col(i)));
    const Matrix<Scalar, 8, 6> image = half.lazyProduct(map);
    result.col(i) = pack(image);
  }
  return result;
}

/// The cubic form uᵀq(u) of a quadratic map q, as a symmetric tensor: its slices are packed forms again. Its norm can be much
/// smaller than that of q: a part of q that only turns u is no growth.
template <typename Scalar>
[[nodiscard]] Forms<Scalar> symmetric_part(const Forms<Scalar>& forms) noexcept {
  std::array<Matrix6<Scalar>, 6> h;
  for (int i = 0; i < 6; ++i) {
    h[static_cast<std::size_t>(i)] = unpacked<Scalar>(forms.col(i));
  }
  Forms<Scalar> result;
  for (int d = 0; d < 4; ++d) {
    const Scalar factor = scalar::constant<Scalar>(1.0L / 3.0L) * weight<Scalar>(d);
    for (int j = 0; j < 6; ++j) {
      const int k = (j + d) % 6;
      const auto& at_j = h[static_cast<std::size_t>(j)];
      const auto& at_k = h[static_cast<std::size_t>(k)];
      // H_i(j, k) + H_j(i, k) + H_k(i, j) for all i
      for (int i = 0; i < 6; ++i) {
        result(6 * d + j, i) = factor * (h[static_cast<std::size_t>(i)](j, k) + at_j(i, k) + at_k(i, j));
      }
    }
  }
  return result;
}

}  // namespace packed
}  // namespace elliptude
