#pragma once

/// \file
/// What a filter estimates: a state, an attitude and a vector beside it, and the ellipsoid E(Ĉ, ω̂, P) about it (paper, eq. ueso).

#include "elliptude/chart.hpp"
#include "elliptude/ellipsoid.hpp"
#include "elliptude/rigid_body.hpp"

namespace elliptude {

/// Attitude and the bias of a gyro that measures ω + β, rad/s, body axes. (theory, section 12)
template <typename Scalar>
struct GyroState {
  Matrix3<Scalar> attitude;
  Vector3<Scalar> gyro_bias;
};

/// The vector beside the attitude: angular velocity, or gyro bias.
template <typename Scalar>
[[nodiscard]] const Vector3<Scalar>& vector_part(const RigidBodyState<Scalar>& state) noexcept {
  return state.angular_velocity;
}
template <typename Scalar>
[[nodiscard]] const Vector3<Scalar>& vector_part(const GyroState<Scalar>& state) noexcept {
  return state.gyro_bias;
}

/// The scalar type of a state.
template <typename State>
struct ScalarOfState;
template <typename Scalar>
struct ScalarOfState<RigidBodyState<Scalar>> {
  using Type = Scalar;
};
template <typename Scalar>
struct ScalarOfState<GyroState<Scalar>> {
  using Type = Scalar;
};
template <typename State>
using StateScalar = typename ScalarOfState<State>::Type;

/// The error x = [ζ; δ] of a state about a center: C = Ĉ exp(S(ζ)), and the difference of the vectors.
template <typename State>
[[nodiscard]] Vector6<StateScalar<State>> state_error(const State& center, const State& state) noexcept {
  Vector6<StateScalar<State>> x;
  x << ExponentialChart::error(center.attitude, state.attitude), vector_part(state) - vector_part(center);
  return x;
}

/// The state whose error about the center is x.
template <typename State>
[[nodiscard]] State retract(const State& center, const Vector6<StateScalar<State>>& x) noexcept {
  using Scalar = StateScalar<State>;
  return {ExponentialChart::retract(center.attitude, Vector3<Scalar>(x.template head<3>())),
          Vector3<Scalar>(vector_part(center) + x.template tail<3>())};
}

/// The set {retract(center, x) : xᵀ P⁻¹ x ≤ 1}. P, rad² and rad²/s², is the shape of a set, not a covariance.
template <typename State>
struct StateEllipsoid {
  using Scalar = StateScalar<State>;

  State center;
  Matrix6<Scalar> shape;

  /// The same set in the coordinates x, about zero.
  [[nodiscard]] Ellipsoid<Scalar, 6> in_coordinates() const noexcept { return {Vector6<Scalar>::Zero(), shape}; }
};

/// \return `not_finite`, `not_a_rotation`, `not_symmetric`, `not_positive_definite`.
template <typename State>
[[nodiscard]] Status validate(const StateEllipsoid<State>& ellipsoid) noexcept {
  using Scalar = StateScalar<State>;
  if (!scalar::all_finite(ellipsoid.center.attitude) || !scalar::all_finite(vector_part(ellipsoid.center))) {
    return Status::not_finite;
  }
  if (!is_rotation(ellipsoid.center.attitude, rotation_tolerance<Scalar>())) {
    return Status::not_a_rotation;
  }
  return validate(ellipsoid.in_coordinates());
}

/// xᵀP⁻¹x of a state, at most 1 inside.
template <typename State>
[[nodiscard]] Status quadratic_form(const StateEllipsoid<State>& ellipsoid, const State& state,
                                    StateScalar<State>& value) noexcept {
  return quadratic_form(ellipsoid.in_coordinates(), state_error(ellipsoid.center, state), value);
}

/// What a report says of the set about the attitude and the vector beside it.
template <typename Scalar>
struct Extent {
  Vector6<Scalar> half_widths_body;       ///< of ζ (rad) and of the vector (rad/s), along body axes
  Vector3<Scalar> half_widths_reference;  ///< of ζ along reference axes, rad
  Scalar largest_angle;                   ///< largest ‖ζ‖ in the set, rad
  Vector3<Scalar> largest_angle_axis;     ///< unit vector in body axes: the turn that is known least
  Vector6<Scalar> greatest_uncertainty;   ///< unit eigenvector of P to its largest eigenvalue (paper, §3.3)
};

/// \return `not_finite`, `not_converged`.
template <typename State>
[[nodiscard]] Status extent(const StateEllipsoid<State>& ellipsoid, Extent<StateScalar<State>>& result) noexcept {
  using Scalar = StateScalar<State>;
  Extent<Scalar> extent;
  extent.half_widths_body = half_widths(ellipsoid.in_coordinates());
  const Matrix3<Scalar> attitude_shape = ellipsoid.shape.template topLeftCorner<3, 3>();
  const Matrix3<Scalar>& c = ellipsoid.center.attitude;
  const Matrix3<Scalar> in_reference = c * attitude_shape * c.transpose();
  extent.half_widths_reference = in_reference.diagonal().cwiseMax(Scalar(0)).cwiseSqrt();
  SymmetricEigen<Scalar, 3> attitude;
  if (const Status status = symmetric_eigen(attitude_shape, attitude); status != Status::ok) {
    return status;
  }
  extent.largest_angle = scalar::sqrt(Scalar(attitude.values(0)));
  extent.largest_angle_axis = attitude.vectors.col(0);
  SymmetricEigen<Scalar, 6> whole;
  if (const Status status = symmetric_eigen(ellipsoid.shape, whole); status != Status::ok) {
    return status;
  }
  extent.greatest_uncertainty = whole.vectors.col(0);
  result = extent;
  return Status::ok;
}

}  // namespace elliptude
