#pragma once

/// \file
/// Backward in time: with s = −t attitudes stay as they are, and angular velocities change their sign. What else
/// changes is said here: a guaranteed flow of what is mirrored goes from a set at the end of an interval to one at its
/// beginning. (theory, section 20.1)

#include <utility>

#include "elliptude/guaranteed/body_flow.hpp"
#include "elliptude/guaranteed/gyro_flow.hpp"

namespace elliptude {

template <typename Scalar>
[[nodiscard]] RigidBodyState<Scalar> mirrored(const RigidBodyState<Scalar>& state) noexcept {
  return {state.attitude, -state.angular_velocity};
}
template <typename Scalar>
[[nodiscard]] GyroState<Scalar> mirrored(const GyroState<Scalar>& state) noexcept {
  return {state.attitude, -state.gyro_bias};
}

/// A set in the other direction of time, without rounding: the attitude's error is the same, that of the vector has the
/// other sign.
template <typename State>
[[nodiscard]] GibbsEllipsoid<State> mirrored(const GibbsEllipsoid<State>& set) noexcept {
  using Scalar = StateScalar<State>;
  GibbsEllipsoid<State> result{mirrored(set.center), set.shape};
  result.shape.template topRightCorner<3, 3>() *= Scalar(-1);
  result.shape.template bottomLeftCorner<3, 3>() *= Scalar(-1);
  return result;
}

/// An angular velocity or a bias in the other direction of time.
template <typename Scalar>
[[nodiscard]] Ellipsoid<Scalar, 3> mirrored(const Ellipsoid<Scalar, 3>& vector) noexcept {
  return {-vector.center, vector.shape};
}

/// A guaranteed flow and its input in the other direction of time: specialise it for a flow of one's own.
template <typename Flow>
struct Mirror;

/// Jω̄' = −ω̄ × (Jω̄ − h_w) + M(C, −s) + u + τ: inertia, torques and their bounds stay, a wheel's momentum changes its
/// sign. (theory, eq. 20.2)
template <typename Scalar, typename Potential>
struct Mirror<GuaranteedRigidBodyFlow<Scalar, Potential>> {
  static_assert(
      goes_backward<Potential>,
      "this potential does not say what its torque is backward in time: give it a `Potential backward() const`");

  using Flow = GuaranteedRigidBodyFlow<Scalar, Potential>;
  using Backward = GuaranteedRigidBodyFlow<Scalar, decltype(std::declval<const Potential&>().backward())>;

  /// \return the status of `Backward::make`.
  [[nodiscard]] static Status flow(const Flow& forward, Backward& backward) noexcept {
    Backward made;
    if (const Status status = Backward::make(forward.body(), forward.potential().backward(), forward.longest_step(),
                                             forward.uncertainty(), made);
        status != Status::ok) {
      return status;
    }
    static_cast<PredictionLimits&>(made) = static_cast<const PredictionLimits&>(forward);
    backward = made;
    return Status::ok;
  }

  [[nodiscard]] static BodyInput<Scalar> input(const BodyInput<Scalar>& given) noexcept {
    return {given.control_torque, -given.wheel_momentum};
  }
};

/// −ω̃ = (I + K)ω̄ + b̄ + v̄: the gyro shows the opposite, of a bias with the other sign, within the same bounds. A
/// rate of the interval's beginning is then one of its end, and one of the end is one of the beginning.
template <typename Scalar>
struct Mirror<GuaranteedGyroFlow<Scalar>> {
  using Flow = GuaranteedGyroFlow<Scalar>;
  using Backward = Flow;
  using Input = typename Flow::Input;

  /// \return the status of `make`.
  [[nodiscard]] static Status flow(const Flow& forward, Backward& backward) noexcept {
    return Flow::make(forward.uncertainty(), mirrored(forward.interval_rate()), backward);
  }

  [[nodiscard]] static Input input(const Input& given) noexcept {
    Input result = given;
    result.angular_velocity = -given.angular_velocity;
    return result;
  }

 private:
  using IntervalRate = typename Flow::IntervalRate;

  [[nodiscard]] static IntervalRate mirrored(IntervalRate rate) noexcept {
    if (rate == IntervalRate::first_sample) {
      return IntervalRate::last_sample;
    }
    return rate == IntervalRate::last_sample ? IntervalRate::first_sample : rate;
  }
};

}  // namespace elliptude
