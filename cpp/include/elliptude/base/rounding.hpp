#pragma once

/// \file
/// How far rounding may move a guaranteed set, as multiples of ε, the distance from 1 to the next number, each with the statement
/// that it covers. They are derived in theory, section 17.8, and compared with running error bounds of the same templates in
/// tests/cpp/base/test_rounding.cpp. Shapes are bounded entry by entry: an entry (i, j) of a shape may be wrong by a multiple of
/// ε √(Pᵢᵢ Pⱼⱼ), however thin the set is in some direction, so a share of the whole shape does not cover it; a share of its
/// diagonal does.

#include "elliptude/base/scalar.hpp"

namespace elliptude::rounding {

/// The multiples.
///@{
/// Angle of a product of two rotations, brought back to SO(3), from the exact one; and of the Cayley map before it.
inline constexpr int center = 24;
/// Norm of the errors of `exp` and `right_jacobian` of a computed turn θ: this many ε, and this many ε θ more.
inline constexpr int turn = 32;
inline constexpr int turn_by_angle = 12;
/// Entries of T P Tᵀ in the norms of T's rows in P (`covered_congruence`), and what a Cholesky factorisation after it needs.
inline constexpr int congruence = 48;
/// Entries of a sum of a few shapes with factors in the roots of its own diagonal, the factors themselves, and a Cholesky
/// factorisation after it.
inline constexpr int sum = 64;
/// A product of a few positive numbers.
inline constexpr int product = 64;
/// A sum of a dozen products of positive numbers, among them tan of at most 1.5.
inline constexpr int bound = 128;
/// Entries of CᵀC − I of a rotation that is one to rounding.
inline constexpr int rotation = 8;
///@}

/// `multiple` ε.
template <typename Scalar>
[[nodiscard]] Scalar share(int multiple) noexcept {
  return Scalar(static_cast<scalar::Value<Scalar>>(multiple)) * Scalar(scalar::epsilon<Scalar>);
}

/// A calculated bound, rounded up a little.
template <typename Scalar>
[[nodiscard]] Scalar enlarged(const Scalar& calculated, int multiple) noexcept {
  return calculated * (Scalar(1) + share<Scalar>(multiple));
}

/// Σ|xᵢⱼ| √pⱼ, row by row: |xᵢ·v| is at most this for all v with |vⱼ| ≤ √pⱼ, the diagonal of a shape.
template <typename Scalar>
[[nodiscard]] Vector3<Scalar> row_norms(const Matrix3<Scalar>& x, const Vector3<Scalar>& roots) noexcept {
  return x.cwiseAbs().lazyProduct(roots);
}

}  // namespace elliptude::rounding

namespace elliptude {

/// T P Tᵀ for T = [[x, y], [0, I]], as a shape whose ellipsoid contains T E(0, P) whatever rounding does to it. With
/// mᵢ = Σⱼ |Tᵢⱼ| √Pⱼⱼ an entry of the attitude's block errs by at most 4.5 ε mᵢ mⱼ, one of the mixed block by 2 ε mᵢ √Pⱼⱼ, and
/// the vector's block is exact; |Σ Eᵢⱼ vᵢ vⱼ| is then at most 19.5 ε Σ mᵢ² vᵢ² + 6 ε Σ Pⱼⱼ vⱼ². (theory, section 17.8)
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> covered_congruence(const Matrix3<Scalar>& x, const Matrix3<Scalar>& y,
                                                 const Matrix6<Scalar>& shape) noexcept {
  const Matrix3<Scalar> mixed = shape.template topRightCorner<3, 3>();
  const Matrix3<Scalar> vector = shape.template bottomRightCorner<3, 3>();
  const Matrix3<Scalar> to_attitude =
      x.lazyProduct(shape.template topLeftCorner<3, 3>()) + y.lazyProduct(mixed.transpose());
  const Matrix3<Scalar> to_vector = x.lazyProduct(mixed) + y.lazyProduct(vector);
  const Matrix3<Scalar> attitude = to_attitude.lazyProduct(x.transpose()) + to_vector.lazyProduct(y.transpose());
  Matrix6<Scalar> result;
  result.template topLeftCorner<3, 3>() = symmetrized(attitude);
  result.template topRightCorner<3, 3>() = to_vector;
  result.template bottomLeftCorner<3, 3>() = to_vector.transpose();
  result.template bottomRightCorner<3, 3>() = vector;
  const Vector6<Scalar> roots = shape.diagonal().cwiseSqrt();
  const Vector3<Scalar> rows = rounding::row_norms<Scalar>(x, roots.template head<3>()) +
                               rounding::row_norms<Scalar>(y, roots.template tail<3>());
  const Scalar share = rounding::share<Scalar>(rounding::congruence);
  result.diagonal().template head<3>() += share * rows.cwiseAbs2();
  result.diagonal().template tail<3>() *= Scalar(1) + share;
  return result;
}

/// The same for y = 0: the attitude alone is turned or stretched.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> covered_congruence(const Matrix3<Scalar>& x, const Matrix6<Scalar>& shape) noexcept {
  const Matrix3<Scalar> to_attitude = x.lazyProduct(shape.template topLeftCorner<3, 3>());
  const Matrix3<Scalar> to_vector = x.lazyProduct(shape.template topRightCorner<3, 3>());
  const Matrix3<Scalar> attitude = to_attitude.lazyProduct(x.transpose());
  Matrix6<Scalar> result = shape;
  result.template topLeftCorner<3, 3>() = symmetrized(attitude);
  result.template topRightCorner<3, 3>() = to_vector;
  result.template bottomLeftCorner<3, 3>() = to_vector.transpose();
  const Vector3<Scalar> rows =
      rounding::row_norms<Scalar>(x, Vector3<Scalar>(shape.diagonal().template head<3>().cwiseSqrt()));
  const Scalar share = rounding::share<Scalar>(rounding::congruence);
  result.diagonal().template head<3>() += share * rows.cwiseAbs2();
  result.diagonal().template tail<3>() *= Scalar(1) + share;
  return result;
}

}  // namespace elliptude
