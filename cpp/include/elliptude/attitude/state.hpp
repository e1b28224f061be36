#pragma once

/// \file
/// What a filter estimates: a state, an attitude and a vector beside it, and the error of one about another.

#include "elliptude/attitude/chart.hpp"

namespace elliptude {

/// Attitude C (body to reference) and angular velocity ω (rad/s, body axes).
template <typename Scalar>
struct RigidBodyState {
  Matrix3<Scalar> attitude;
  Vector3<Scalar> angular_velocity;
};

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

/// Whether every number of a state is finite.
template <typename State>
[[nodiscard]] bool is_finite(const State& state) noexcept {
  return scalar::all_finite(state.attitude) && scalar::all_finite(vector_part(state));
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

/// The error x = [ζ; δ] of a state about a center: C = Ĉ exp(S(ζ)), and the difference of the vectors; in the Gibbs
/// chart [γ; δ].
template <typename Chart = ExponentialChart, typename State>
[[nodiscard]] Vector6<StateScalar<State>> state_error(const State& center, const State& state) noexcept {
  Vector6<StateScalar<State>> x;
  x << Chart::error(center.attitude, state.attitude), vector_part(state) - vector_part(center);
  return x;
}

/// The state whose error about the center is x.
template <typename Chart = ExponentialChart, typename State>
[[nodiscard]] State retract(const State& center, const Vector6<StateScalar<State>>& x) noexcept {
  using Scalar = StateScalar<State>;
  return {Chart::retract(center.attitude, Vector3<Scalar>(x.template head<3>())),
          Vector3<Scalar>(vector_part(center) + x.template tail<3>())};
}

}  // namespace elliptude
