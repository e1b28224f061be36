#pragma once

/// \file
/// Building blocks of torques along a motion: series of vectors that turn, and forms of second and third order.
/// (theory, section 17.3)

#include "elliptude/base/so3.hpp"

namespace elliptude {

namespace expansion {

/// Three columns of three numbers, and zeros below where they fill SIMD registers.
template <typename Scalar>
using Columns = Matrix<Scalar, padded(3), 3>;

/// Three numbers, and a zero for the same.
template <typename Scalar>
using Padded = Vector<Scalar, padded(3)>;

/// Coefficient k of ω × s, from those of ω and of s. The last of these, just made, comes last.
template <typename Scalar, typename Term, std::size_t Terms>
[[nodiscard]] Vector3<Scalar> cross_coefficient(int k, const std::array<Vector3<Scalar>, Terms>& rate,
                                                const std::array<Term, Terms>& s) noexcept {
  const Vector3<Scalar>& last = rate[static_cast<std::size_t>(k)];
  Scalar x = last(1) * s[0](2) - last(2) * s[0](1);
  Scalar y = last(2) * s[0](0) - last(0) * s[0](2);
  Scalar z = last(0) * s[0](1) - last(1) * s[0](0);
  for (int i = k - 1; i >= 0; --i) {
    const Vector3<Scalar>& a = rate[static_cast<std::size_t>(i)];
    const Term& b = s[static_cast<std::size_t>(k - i)];
    x = x + a(1) * b(2) - a(2) * b(1);
    y = y - a(0) * b(2) + a(2) * b(0);
    z = z + a(0) * b(1) - a(1) * b(0);
  }
  return {x, y, z};
}

/// The value of a series of `count` terms at s.
template <typename Scalar, typename Term, std::size_t Terms>
[[nodiscard]] Term value(const std::array<Term, Terms>& series, int count, const Scalar& s) noexcept {
  Term sum = series[static_cast<std::size_t>(count - 1)];
  for (int k = count - 2; k >= 0; --k) {
    sum = series[static_cast<std::size_t>(k)] + s * sum;
  }
  return sum;
}

/// What a turn by γ = 2 tan(θ/2) n does to s = Cᵀr to second order: s + s × γ + ½ (γ(γ·s) − s‖γ‖²). Component i of N
/// times the second-order part, as the matrix of a quadratic form of γ.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> second_order_form(const Vector3<Scalar>& row_of_n, const Vector3<Scalar>& s) noexcept {
  const Scalar quarter = scalar::constant<Scalar>(0.25L);
  Matrix3<Scalar> form = quarter * (row_of_n * s.transpose());
  form += quarter * (s * row_of_n.transpose());
  form.diagonal().array() -= scalar::constant<Scalar>(0.5L) * row_of_n.dot(s);
  return form;
}

template <typename Scalar>
using Forms = std::array<Matrix3<Scalar>, 3>;

/// Symmetric forms of three numbers, one a row, by the coefficients of b₁², b₂², b₃², √2 b₂b₃, √2 b₃b₁, √2 b₁b₂, which
/// together have the length ‖b‖².
template <typename Scalar>
using RowForms = Matrix<Scalar, 3, 6>;

template <typename Scalar>
[[nodiscard]] RowForms<Scalar> rows_of(const Forms<Scalar>& forms) noexcept {
  const Scalar root = scalar::constant<Scalar>(1.41421356237309504880168872420969807857L);
  RowForms<Scalar> rows;
  for (int i = 0; i < 3; ++i) {
    const Matrix3<Scalar>& form = forms[static_cast<std::size_t>(i)];
    for (int a = 0; a < 3; ++a) {
      rows(i, a) = form(a, a);
      rows(i, 3 + a) = root * form((a + 1) % 3, (a + 2) % 3);
    }
  }
  return rows;
}

/// b × Jb.
template <typename Scalar>
[[nodiscard]] RowForms<Scalar> gyroscopic_forms(const Matrix3<Scalar>& inertia) noexcept {
  const Scalar root = scalar::constant<Scalar>(0.70710678118654752440084436210484903928L);
  RowForms<Scalar> forms;
  for (int a = 0; a < 3; ++a) {
    // b_next (Jb)_last − b_last (Jb)_next
    const int next = (a + 1) % 3;
    const int last = (a + 2) % 3;
    forms(a, next) = inertia(last, next);
    forms(a, last) = -inertia(next, last);
    forms(a, a) = Scalar(0);
    forms(a, 3 + a) = root * (inertia(last, last) - inertia(next, next));  // of b_next b_last
    forms(a, 3 + next) = -root * inertia(next, a);                         // of b_last b_a
    forms(a, 3 + last) = root * inertia(last, a);                          // of b_a b_next
  }
  return forms;
}

/// Three cubic forms of γ, one a column, by the coefficients of their ten monomials: γᵢ³, γᵢ²γⱼ, γ₁γ₂γ₃, each divided
/// by the root of how often the monomial stands in γ ⊗ γ ⊗ γ (1, 3, 6), so that a form's value is an inner product with
/// a vector of length ‖γ‖³.
template <typename Scalar>
using CubicForms = Matrix<Scalar, 10, 3>;

/// The form (lᵀγ)(γᵀQγ) for a symmetric Q.
template <typename Scalar>
[[nodiscard]] Vector<Scalar, 10> cubic_product(const Vector3<Scalar>& l, const Matrix3<Scalar>& q) noexcept {
  const Scalar third = scalar::constant<Scalar>(0.57735026918962576450914878050195745565L);  // 1/√3
  const Scalar sixth = scalar::constant<Scalar>(0.40824829046386301636621401245098189866L);  // 1/√6
  Vector<Scalar, 10> form;
  for (int i = 0; i < 3; ++i) {
    form(i) = l(i) * q(i, i);
    const int next = (i + 1) % 3;
    const int last = (i + 2) % 3;
    form(3 + 2 * i) = third * (l(next) * q(i, i) + Scalar(2) * l(i) * q(i, next));  // γᵢ² γ_next
    form(4 + 2 * i) = third * (l(last) * q(i, i) + Scalar(2) * l(i) * q(i, last));  // γᵢ² γ_last
  }
  form(9) = Scalar(2) * sixth * (l(0) * q(1, 2) + l(1) * q(0, 2) + l(2) * q(0, 1));
  return form;
}

/// Adds the terms of third order of `transform` times a torque of first degree in vectors that turn with the body:
/// −¼‖γ‖² times its derivative's.
template <typename Scalar>
void add_cubic_of_first_degree(const Matrix3<Scalar>& jacobian, const Matrix3<Scalar>& transform,
                               const Matrix3<Scalar>& axes, CubicForms<Scalar>& forms) noexcept {
  const Matrix3<Scalar> linear = scalar::constant<Scalar>(-0.25L) * transform.lazyProduct(jacobian).lazyProduct(axes);
  const Matrix3<Scalar> square = axes.transpose().lazyProduct(axes);
  for (int i = 0; i < 3; ++i) {
    forms.col(i) += cubic_product(Vector3<Scalar>(linear.row(i).transpose()), square);
  }
}

}  // namespace expansion

}  // namespace elliptude
