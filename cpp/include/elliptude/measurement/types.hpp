#pragma once

/// \file
/// Measurements with bounds of their errors (paper, §2.3.3).

#include "elliptude/linear/cholesky.hpp"
#include "elliptude/sets/ellipsoid.hpp"

namespace elliptude {

/// A direction e, known in reference axes, measured as b̃ in body axes: Cᵀe = exp(S(ν)) b̃ with ν in E(0, bound)
/// (paper, eqs. bi, Sk).
template <typename Scalar>
struct Direction {
  Vector3<Scalar> reference;  ///< e, need not be of unit length
  Vector3<Scalar> body;       ///< b̃, need not be of unit length
  Matrix3<Scalar> bound;      ///< S, rad²
  Scalar weight;              ///< w in Wahba's problem, positive

  /// A direction known to an angle, rad, which must be positive: of another the bound is none, which `validate` refuses
  /// as `not_positive_definite`.
  [[nodiscard]] static Direction within(const Vector3<Scalar>& reference, const Vector3<Scalar>& body,
                                        const Scalar& angle) noexcept {
    return {reference, body, angle * scalar::abs(angle) * Matrix3<Scalar>::Identity(), Scalar(1)};
  }
};

/// ω = ω̃ + υ with υ in E(0, bound) (paper, eqs. Omega, Tk); rad/s, body axes.
template <typename Scalar>
struct AngularVelocity {
  Vector3<Scalar> value;  ///< ω̃
  Matrix3<Scalar> bound;  ///< rad²/s²: of a ball the square of its radius

  /// An angular velocity known to within `largest`, rad/s, in every direction, which must be positive: of another the
  /// bound is none, which `validate` refuses as `not_positive_definite`.
  [[nodiscard]] static AngularVelocity within(const Vector3<Scalar>& value, const Scalar& largest) noexcept {
    return {value, ball_shape<3>(largest)};
  }
};

/// A whole attitude, as a star tracker gives it: C = C̃ exp(S(ν)) with ν in E(0, bound), rad².
template <typename Scalar>
struct MeasuredAttitude {
  Matrix3<Scalar> attitude;  ///< C̃
  Matrix3<Scalar> bound;     ///< rad²

  /// An attitude known to an angle about any axis, rad, which must be positive, as for `Direction::within`.
  [[nodiscard]] static MeasuredAttitude within(const Matrix3<Scalar>& attitude, const Scalar& angle) noexcept {
    return {attitude, ball_shape<3>(angle)};
  }
};

/// y = H x + v with v in E(0, bound), of the error x = [ζ; δ] about the center of the ellipsoid that it updates.
template <typename Scalar, int Rows>
struct LinearMeasurement {
  Vector<Scalar, Rows> y;
  Matrix<Scalar, Rows, 6> h;
  Matrix<Scalar, Rows> bound;
};

/// \return `not_finite`, `zero_direction`; `out_of_range` of a weight that is not positive; `beyond_domain`,
/// `not_symmetric`, `not_positive_definite` of the bound, which must have no zero width.
template <typename Scalar>
[[nodiscard]] Status validate(const Direction<Scalar>& direction) noexcept {
  if (!scalar::all_finite(direction.reference) || !scalar::all_finite(direction.body) ||
      !scalar::isfinite(direction.weight) || !scalar::all_finite(direction.bound)) {
    return Status::not_finite;
  }
  if (!(scalar::length(direction.reference) > Scalar(0)) || !(scalar::length(direction.body) > Scalar(0))) {
    return Status::zero_direction;
  }
  if (!(direction.weight > Scalar(0))) {
    return Status::out_of_range;
  }
  if (!is_in_domain(direction.bound)) {
    return Status::beyond_domain;
  }
  return validate_definite(direction.bound);
}

/// \return `not_finite`, `beyond_domain`, `not_symmetric`; `not_positive_definite` of a bound with a zero width.
template <typename Scalar>
[[nodiscard]] Status validate(const AngularVelocity<Scalar>& angular_velocity) noexcept {
  if (!scalar::all_finite(angular_velocity.value) || !scalar::all_finite(angular_velocity.bound)) {
    return Status::not_finite;
  }
  if (!is_in_domain(angular_velocity.bound)) {
    return Status::beyond_domain;
  }
  return validate_definite(angular_velocity.bound);
}

}  // namespace elliptude
