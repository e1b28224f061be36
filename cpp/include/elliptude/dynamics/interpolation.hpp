#pragma once

/// \file
/// The motion between the steps of an integrator, so that a step need not be as short as the times at which one wants
/// to know the state (theory, section 4.3).

#include "elliptude/dynamics/integrator.hpp"

namespace elliptude {

/// A state, and how the angular velocity changes there.
template <typename Scalar>
struct MovingState {
  RigidBodyState<Scalar> state;
  Vector3<Scalar> acceleration;  ///< ω̇ in rad/s², body axes

  /// After a stage of an integrator: Jω̇ = Jω × ω + M + u.
  template <typename Body>
  [[nodiscard]] static MovingState after(const Body& body, const Stage<Scalar>& stage,
                                         const Vector3<Scalar>& control_torque) noexcept {
    const Vector3<Scalar> torque =
        stage.body_momentum.cross(stage.state.angular_velocity) + stage.torque + control_torque;
    return {stage.state, body.inertia_inverse() * torque};
  }
};

/// The motion from one state to another: the polynomial of degree five in the Gibbs vector from the first attitude that
/// has the attitude, angular velocity and acceleration of both (theory, eqs. 4.13 and 4.14). One that `make` has not
/// made rests at the identity.
template <typename Scalar>
class MotionBetween {
 public:
  /// \param duration from the first to the last, s, positive. \return `not_finite`; `out_of_range` of another duration;
  /// `step_too_long` if, at the angular velocity of either state, the body would turn by a right angle or more in that
  /// time: the polynomial says nothing of such a motion.
  [[nodiscard]] static Status make(const MovingState<Scalar>& first, const MovingState<Scalar>& last,
                                   const Scalar& duration, MotionBetween& motion) noexcept {
    if (!scalar::isfinite(duration)) {
      return Status::not_finite;
    }
    if (!(duration > Scalar(0))) {
      return Status::out_of_range;
    }
    const Scalar right_angle = scalar::constant<Scalar>(0.5L) * scalar::pi<Scalar>();
    for (const MovingState<Scalar>* end : {&first, &last}) {
      if (!is_finite(end->state) || !scalar::all_finite(end->acceleration)) {
        return Status::not_finite;
      }
      if (!(duration * scalar::sqrt(Scalar(end->state.angular_velocity.squaredNorm())) < right_angle)) {
        return Status::step_too_long;
      }
    }
    MotionBetween result;
    result.attitude_ = first.state.attitude;
    result.duration_ = duration;
    const Vector3<Scalar> zero = Vector3<Scalar>::Zero();
    const Gibbs start = gibbs(zero, first, duration);
    const Gibbs end =
        gibbs(cayley_inverse(Matrix3<Scalar>(first.state.attitude.transpose() * last.state.attitude)), last, duration);
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Vector3<Scalar> d = end.value - start.slope - half * start.curvature;
    const Vector3<Scalar> e = end.slope - start.slope - start.curvature;
    const Vector3<Scalar> f = end.curvature - start.curvature;
    result.coefficients_.col(0) = start.slope;
    result.coefficients_.col(1) = half * start.curvature;
    result.coefficients_.col(2) = Scalar(10) * d - Scalar(4) * e + half * f;
    result.coefficients_.col(3) = Scalar(-15) * d + Scalar(7) * e - f;
    result.coefficients_.col(4) = Scalar(6) * d - Scalar(3) * e + half * f;
    if (!scalar::all_finite(result.coefficients_)) {
      return Status::not_finite;
    }
    motion = result;
    return Status::ok;
  }

  /// \param share of the duration, from 0 to 1.
  [[nodiscard]] RigidBodyState<Scalar> at(const Scalar& share) const noexcept {
    Vector3<Scalar> c = coefficients_.col(4);
    Vector3<Scalar> slope = Scalar(5) * c;
    for (int i = 3; i >= 0; --i) {
      c = share * c + coefficients_.col(i);
      slope = share * slope + Scalar(i + 1) * coefficients_.col(i);
    }
    c *= share;
    // ω = 2 (ċ − c × ċ)/(1 + cᵀc), the turn on the right of (3.7).
    const Scalar scale = Scalar(2) / (duration_ * (Scalar(1) + c.squaredNorm()));
    return {attitude_ * cayley(c), scale * (slope - c.cross(slope))};
  }

 private:
  /// The Gibbs vector and its derivatives by the share of the duration.
  struct Gibbs {
    Vector3<Scalar> value;
    Vector3<Scalar> slope;
    Vector3<Scalar> curvature;
  };

  /// 2ċ = ω + c × ω + c (cᵀω), and its derivative.
  [[nodiscard]] static Gibbs gibbs(const Vector3<Scalar>& c, const MovingState<Scalar>& moving,
                                   const Scalar& duration) noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Vector3<Scalar> turn = duration * moving.state.angular_velocity;
    const Vector3<Scalar> change = (duration * duration) * moving.acceleration;
    const Vector3<Scalar> slope = half * (turn + c.cross(turn) + c.dot(turn) * c);
    const Vector3<Scalar> curvature = half * (change + slope.cross(turn) + c.cross(change) + c.dot(turn) * slope +
                                              (slope.dot(turn) + c.dot(change)) * c);
    return {c, slope, curvature};
  }

  Matrix3<Scalar> attitude_ = Matrix3<Scalar>::Identity();
  Matrix<Scalar, 3, 5> coefficients_ = Matrix<Scalar, 3, 5>::Zero();  // of the powers 1 to 5 of the share
  Scalar duration_{1};
};

/// The states at any times within the steps of `integrate`: between two steps by `MotionBetween`, at a step that step's
/// own.
/// \param times in s, ascending, from `time` to `time` + `steps` h: any type with `size()` and `[]`.
/// \param visit called as visit(row, state) for each of the times, in their order.
/// \return as `integrate`; `out_of_range` of times that do not ascend or are not within the steps; `step_too_long` also
/// where a time lies within a step in which the body turns by a right angle or more. `next`, the state after the last
/// step, changes only on success.
template <typename Body, typename Method, typename Scalar, typename Potential, typename Times, typename Visit>
[[nodiscard]] Status integrate_to_times(const Body& body, const Potential& potential, const Method& method,
                                        const Scalar& time, const Scalar& h, long steps,
                                        const Vector3<Scalar>& control_torque, const RigidBodyState<Scalar>& state,
                                        const Times& times, RigidBodyState<Scalar>& next, const Visit& visit) noexcept {
  using Row = decltype(times.size());
  const Row count = times.size();
  const auto step_time = [&](long k) { return Scalar(time + Scalar(static_cast<scalar::Value<Scalar>>(k)) * h); };
  // A time this close to a step is that step's.
  const Scalar slack = rounding::share<Scalar>(rounding::steps) * (scalar::abs(time) + scalar::abs(step_time(steps)));
  for (Row row = 0; row < count; ++row) {
    const Scalar earliest = row == 0 ? Scalar(time - slack) : Scalar(times[row - 1]);
    if (!(times[row] >= earliest && times[row] <= step_time(steps) + slack)) {
      return Status::out_of_range;
    }
  }
  Row row = 0;
  Status found = Status::ok;
  MovingState<Scalar> before;
  const auto visit_rows = [&](long k, const Stage<Scalar>& stage) {
    const MovingState<Scalar> now = MovingState<Scalar>::after(body, stage, control_torque);
    const Scalar reached = step_time(k);
    MotionBetween<Scalar> motion;
    bool is_made = false;
    for (; row < count && found == Status::ok && times[row] <= reached + slack; ++row) {
      if (times[row] >= reached - slack) {
        visit(row, now.state);
        continue;
      }
      if (!is_made) {
        found = MotionBetween<Scalar>::make(before, now, h, motion);
        is_made = true;
      }
      if (found == Status::ok) {
        visit(row, motion.at(Scalar((times[row] - step_time(k - 1)) / h)));
      }
    }
    before = now;
  };
  Stage<Scalar> last;
  if (const Status status =
          integrate_stages(body, potential, method, time, h, steps, control_torque, state, last, visit_rows);
      status != Status::ok) {
    return status;
  }
  if (found == Status::ok) {
    next = last.state;
  }
  return found;
}

}  // namespace elliptude
