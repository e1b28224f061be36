#pragma once

/// \file
/// The flow update (paper, §3.1): how a state and its ellipsoid move between measurements, to first order in the error.
///
/// A flow has a `State`, an `Input` and
///
///     Status predict(time, duration, input, ellipsoid, criterion, Prediction<State>&) const noexcept
///
/// which moves the ellipsoid by `duration` ≥ 0 from `time` under the input.

#include <algorithm>

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/base/interruption.hpp"
#include "elliptude/dynamics/linearization.hpp"

namespace elliptude {

template <typename State>
struct Prediction {
  StateEllipsoid<State> ellipsoid;
  Matrix6<StateScalar<State>> transition;  ///< A^f (paper, eq. flow)
};

/// A rigid body in a potential, with a control torque as input and an unknown torque in an ellipsoid. One that `make`
/// has not made has no step, and predicts nothing: `too_many_steps`.
template <typename Scalar, typename Potential>
class RigidBodyFlow : public PredictionLimits {
 public:
  using State = RigidBodyState<Scalar>;
  struct Input {
    Vector3<Scalar> control_torque = Vector3<Scalar>::Zero();  ///< N m, body axes, constant over the interval
  };
  /// \param longest_step s; an interval is divided into the fewest equal steps that are no longer but for a thousandth.
  /// \param order of the integrator: 2, 4, 6 or 8.
  /// \param unknown_torque shape of an ellipsoid about zero, (N m)², body axes: a torque constant over each step and
  /// anything in the ellipsoid from step to step. Zero for none.
  /// \return `not_finite`; `out_of_range` of the step or the order, or of an unknown torque with
  /// `ELLIPTUDE_ONLY_KNOWN_TORQUES`; `not_symmetric`, `not_positive_definite` of the torque.
  [[nodiscard]] static ELLIPTUDE_SELDOM Status make(const RigidBody<Scalar>& body, const Potential& potential,
                                                    const Scalar& longest_step, int order,
                                                    const Matrix3<Scalar>& unknown_torque,
                                                    RigidBodyFlow& flow) noexcept {
    if (!scalar::isfinite(longest_step)) {
      return Status::not_finite;
    }
    if (!(longest_step > Scalar(0))) {
      return Status::out_of_range;
    }
    if (const Status status = validate(Ellipsoid<Scalar, 3>{Vector3<Scalar>::Zero(), unknown_torque});
        status != Status::ok) {
      return status;
    }
    if (only_known_torques && !unknown_torque.isZero(Scalar(0))) {
      return Status::out_of_range;
    }
    Composition<Scalar> composition;
    if (const Status status = composition_of_order(order, composition); status != Status::ok) {
      return status;
    }
    flow.body_ = body;
    flow.potential_ = potential;
    flow.composition_ = composition;
    flow.longest_step_ = longest_step;
    flow.unknown_torque_ = unknown_torque;
    flow.PredictionLimits::operator=(PredictionLimits());
    return Status::ok;
  }

  [[nodiscard]] const RigidBody<Scalar>& body() const noexcept { return body_; }
  [[nodiscard]] const Potential& potential() const noexcept { return potential_; }
  [[nodiscard]] const Composition<Scalar>& composition() const noexcept { return composition_; }
  [[nodiscard]] const Matrix3<Scalar>& unknown_torque() const noexcept { return unknown_torque_; }

  /// The fewest equal steps of a positive duration. \return `too_many_steps`.
  [[nodiscard]] Status count_steps(const Scalar& duration, long& steps) const noexcept {
    return divide(duration, longest_step_, steps);
  }

  /// The same flow of another scalar, for potentials that have `cast`; of a pack, with the limits of this one
  /// (`count_steps`).
  template <typename Other>
  [[nodiscard]] auto cast() const noexcept {
    using OtherPotential = decltype(potential_.template cast<Other>());
    RigidBodyFlow<Other, OtherPotential> result;
    result.body_ = body_.template cast<Other>();
    result.potential_ = potential_.template cast<Other>();
    result.composition_.stages = composition_.stages;
    std::copy(composition_.weights.begin(), composition_.weights.end(), result.composition_.weights.begin());
    result.longest_step_ = Other(longest_step_);
    result.unknown_torque_ = unknown_torque_.template cast<Other>();
    result.PredictionLimits::operator=(*this);
    return result;
  }

  /// \return `not_finite`, `not_a_rotation`, `step_too_long`, `callback_failed`; `out_of_range` of a negative duration;
  /// `too_many_steps`; `interrupted`; the status of `minimal_sum`.
  [[nodiscard]] Status predict(const Scalar& time, const Scalar& duration, const Input& input,
                               const StateEllipsoid<State>& ellipsoid, const SizeCriterion<Scalar, 6>& criterion,
                               Prediction<State>& prediction) const noexcept {
    if (!scalar::isfinite(time) || !scalar::isfinite(duration)) {
      return Status::not_finite;
    }
    if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (duration == Scalar(0)) {
      prediction = {ellipsoid, Matrix6<Scalar>::Identity()};
      return Status::ok;
    }
    long steps = 1;
    if (const Status status = divide(duration, longest_step_, steps); status != Status::ok) {
      return status;
    }
    const Scalar h = duration / Scalar(static_cast<scalar::Value<Scalar>>(steps));

    if (!only_known_torques && !unknown_torque_.isZero(Scalar(0))) {
      return predict_pushed(time, h, steps, input, ellipsoid, criterion, prediction);
    }
    State center;
    FlowLinearization<Scalar> linearization;
    if (const Status status =
            integrate_linearized(body_, potential_, composition_, time, h, steps, input.control_torque,
                                 ellipsoid.center, center, linearization, interruption());
        status != Status::ok) {
      return status;
    }
    prediction.ellipsoid.shape = transformed_shape(linearization.state, ellipsoid.shape);
    prediction.ellipsoid.center = center;
    prediction.transition = linearization.state;
    return Status::ok;
  }

 private:
  template <typename, typename>
  friend class RigidBodyFlow;

  /// The prediction in so many steps of h, with the unknown torque anything in its ellipsoid in each.
  [[nodiscard]] Status predict_pushed(const Scalar& time, const Scalar& h, long steps, const Input& input,
                                      const StateEllipsoid<State>& ellipsoid, const SizeCriterion<Scalar, 6>& criterion,
                                      Prediction<State>& prediction) const noexcept {
    Prediction<State> result{ellipsoid, Matrix6<Scalar>::Identity()};
    FlowLinearization<Scalar> linearization;
    for (long step = 0; step < steps; ++step) {
      if (interruption().after(step)) {
        return Status::interrupted;
      }
      const Scalar now = time + Scalar(static_cast<scalar::Value<Scalar>>(step)) * h;
      const State before = result.ellipsoid.center;
      if (const Status status = integrate_linearized(body_, potential_, composition_, now, h, 1L, input.control_torque,
                                                     before, result.ellipsoid.center, linearization);
          status != Status::ok) {
        return status;
      }
      if (const Status status = push(linearization, criterion, result.ellipsoid.shape); status != Status::ok) {
        return status;
      }
      result.transition = linearization.state.lazyProduct(result.transition).eval();
    }
    prediction = result;
    return Status::ok;
  }

  /// The shape after one step, with the unknown torque.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status push(const FlowLinearization<Scalar>& linearization,
                                                  const SizeCriterion<Scalar, 6>& criterion,
                                                  Matrix6<Scalar>& shape) const noexcept {
    const std::array<Ellipsoid<Scalar, 6>, 2> terms{
        Ellipsoid<Scalar, 6>{Vector6<Scalar>::Zero(), transformed_shape(linearization.state, shape)},
        Ellipsoid<Scalar, 6>{Vector6<Scalar>::Zero(), congruence(linearization.control, unknown_torque_)}};
    Ellipsoid<Scalar, 6> sum;
    if (const Status status = minimal_sum(terms.data(), terms.size(), criterion, sum); status != Status::ok) {
      return status;
    }
    shape = sum.shape;
    return Status::ok;
  }

  RigidBody<Scalar> body_;
  Potential potential_;
  Composition<Scalar> composition_{};
  Scalar longest_step_{0};
  Matrix3<Scalar> unknown_torque_ = Matrix3<Scalar>::Zero();
};

/// A motion that a gyro measured: the state at its end, A, and the shapes of the effects of the gyro's noise and of its
/// bias's drift.
template <typename Scalar>
struct GyroMotion {
  GyroState<Scalar> center;
  Matrix6<Scalar> transition;
  Matrix6<Scalar> noise;
  Matrix6<Scalar> drift;
};

/// A body about which only its gyro says something: ω̃ = ω + β + v, with the bias β in the state and v in an ellipsoid.
/// The rate is the input; over an interval, with F = exp(S(h(ω̃ − β̂))),
///
///     ζ⁺ = Fᵀζ − h J_r(h(ω̃ − β̂)) (δβ + v + ½ h β'),   δβ⁺ = δβ + h β'.   (theory, section 12)
template <typename Scalar>
class GyroFlow {
 public:
  using State = GyroState<Scalar>;
  struct Input {
    /// ω̃, rad/s, body axes, as measured, for the interval. One that was not set is no number, and is refused.
    Vector3<Scalar> angular_velocity = Vector3<Scalar>::Constant(scalar::not_a_number<Scalar>());
  };

  /// \param noise shape of the ellipsoid of v, (rad/s)², constant over an interval and anything in it from one to the
  /// next.
  /// \param drift shape of the ellipsoid of β' = dβ/dt, (rad/s²)², constant over an interval and anything in it from
  /// one to the next.
  /// \return `not_finite`, `not_symmetric`, `not_positive_definite`.
  [[nodiscard]] static Status make(const Matrix3<Scalar>& noise, const Matrix3<Scalar>& drift,
                                   GyroFlow& flow) noexcept {
    for (const Matrix3<Scalar>* shape : {&noise, &drift}) {
      if (const Status status = validate(Ellipsoid<Scalar, 3>{Vector3<Scalar>::Zero(), *shape}); status != Status::ok) {
        return status;
      }
    }
    flow.noise_ = noise;
    flow.drift_ = drift;
    return Status::ok;
  }

  /// \return `not_finite`; `out_of_range` of a negative duration.
  [[nodiscard]] Status predict(const Scalar& time, const Scalar& duration, const Input& input,
                               const StateEllipsoid<State>& ellipsoid, const SizeCriterion<Scalar, 6>& criterion,
                               Prediction<State>& prediction) const noexcept {
    if (!scalar::isfinite(time) || !scalar::isfinite(duration) || !scalar::all_finite(input.angular_velocity) ||
        !is_finite(ellipsoid.center)) {
      return Status::not_finite;
    }
    if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (duration == Scalar(0)) {
      prediction = {ellipsoid, Matrix6<Scalar>::Identity()};
      return Status::ok;
    }
    const GyroMotion<Scalar> motion = this->motion(duration, input, ellipsoid.center);
    Prediction<State> result;
    result.ellipsoid.center = motion.center;
    result.transition = motion.transition;
    const Vector6<Scalar> zero = Vector6<Scalar>::Zero();
    const std::array<Ellipsoid<Scalar, 6>, 3> terms{
        Ellipsoid<Scalar, 6>{zero, transformed_shape(motion.transition, ellipsoid.shape)},
        Ellipsoid<Scalar, 6>{zero, motion.noise}, Ellipsoid<Scalar, 6>{zero, motion.drift}};
    Ellipsoid<Scalar, 6> sum;
    if (const Status status = minimal_sum(terms.data(), terms.size(), criterion, sum); status != Status::ok) {
      return status;
    }
    result.ellipsoid.shape = sum.shape;
    prediction = result;
    return Status::ok;
  }

  /// What the state becomes over a duration, and what adds to its set. No branch depends on a number.
  [[nodiscard]] GyroMotion<Scalar> motion(const Scalar& duration, const Input& input,
                                          const State& state) const noexcept {
    const Vector3<Scalar> turn = duration * (input.angular_velocity - state.gyro_bias);
    const Matrix3<Scalar> f = exp(turn);
    const Matrix3<Scalar> by_rate = -duration * right_jacobian(turn);
    GyroMotion<Scalar> result;
    result.center = {state.attitude * f, state.gyro_bias};
    result.transition.setIdentity();
    result.transition.template topLeftCorner<3, 3>() = f.transpose();
    result.transition.template topRightCorner<3, 3>() = by_rate;
    result.noise.setZero();
    result.noise.template topLeftCorner<3, 3>() = symmetric_congruence(by_rate, noise_);
    // A drift β' that is constant over the interval turns the attitude by half of what its end value would.
    Matrix<Scalar, 6, 3> by_drift;
    by_drift.template topRows<3>() = scalar::constant<Scalar>(0.5L) * duration * by_rate;
    by_drift.template bottomRows<3>() = duration * Matrix3<Scalar>::Identity();
    result.drift = symmetric_congruence(by_drift, drift_);
    return result;
  }

  /// The same flow of another scalar.
  template <typename Other>
  [[nodiscard]] GyroFlow<Other> cast() const noexcept {
    GyroFlow<Other> result;
    result.noise_ = noise_.template cast<Other>();
    result.drift_ = drift_.template cast<Other>();
    return result;
  }

  /// The angular velocity ω = ω̃ − β − v at a sample, with its bound: an output here.
  [[nodiscard]] Status angular_velocity(const StateEllipsoid<State>& ellipsoid, const Input& input,
                                        Ellipsoid<Scalar, 3>& result) const noexcept {
    const std::array<Ellipsoid<Scalar, 3>, 2> terms{
        Ellipsoid<Scalar, 3>{input.angular_velocity - ellipsoid.center.gyro_bias,
                             ellipsoid.shape.template bottomRightCorner<3, 3>()},
        Ellipsoid<Scalar, 3>{Vector3<Scalar>::Zero(), noise_}};
    return minimal_sum(terms.data(), terms.size(), SizeCriterion<Scalar, 3>::trace(), result);
  }

 private:
  template <typename>
  friend class GyroFlow;

  Matrix3<Scalar> noise_ = Matrix3<Scalar>::Zero();
  Matrix3<Scalar> drift_ = Matrix3<Scalar>::Zero();
};

}  // namespace elliptude
