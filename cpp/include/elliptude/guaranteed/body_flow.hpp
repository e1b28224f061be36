#pragma once

/// \file
/// The guaranteed flow of a rigid body: the set that it predicts holds the state of the continuous motion, with nothing
/// left out (theory, section 17). The errors are y = [γ; δω] in the Gibbs chart.
///
/// A guaranteed flow can be default-constructed and assigned, as a filter holds one. It has a `State`, an `Input` and
///
///     Status predict(time, duration, input, ellipsoid, result) const noexcept
///     Status predict_vector(time, duration, input, ellipsoid of the vector alone, result) const noexcept
///
/// the second for an unknown attitude. One of `RigidBodyState` factors the shapes that it predicts itself, and returns
/// `unbounded` of one that is not positive definite, as the filter does not factor them. One of `GyroState` need not,
/// but has an `Input` with `angular_velocity` and `is_measured`, and also
///
///     Status predict_attitude(time, duration, input, ellipsoid of the bias, ellipsoid, result) const noexcept
///     Status predict_turn(duration, turn, angle, ellipsoid, result) const noexcept
///     Status predict_attitude_turn(duration, turn, angle, ellipsoid of the bias, ellipsoid, result) const noexcept
///
/// as `GuaranteedGyroFlow` has them: for a bias that is left to its bound, for `GuaranteedFilter::predict_turn`, and
/// for both.

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/base/interruption.hpp"
#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/guaranteed/error_tube.hpp"
#include "elliptude/guaranteed/own_torque_expansion.hpp"

namespace elliptude {

/// A rigid body in a potential: Euler's equations in continuous time, Jω' = −ω × (Jω + h_w) + M(C, t) + u + τ, with a
/// control torque and a wheel's momentum as input and a torque that is not known. The potential must have a
/// `TorqueExpansion`. One that `make` has not made has no step, and predicts nothing: `too_many_steps`.
template <typename Scalar, typename Potential>
class GuaranteedRigidBodyFlow : public PredictionLimits {
  static_assert(has_expansion<Potential, Scalar>,
                "this potential offers no bounds of its torque: see guaranteed/torque_expansion.hpp for what a "
                "guaranteed flow needs");

 public:
  using State = RigidBodyState<Scalar>;
  using Input = BodyInput<Scalar>;

  /// \param longest_step s; an interval is divided into the fewest equal steps that are no longer but for a thousandth.
  /// The set is valid for any step; a shorter one makes it smaller, until the terms that do not depend on the step
  /// outweigh.
  /// \return `not_finite`; `out_of_range` of the step or of a negative inertia error; `invalid_inertia` if the inertia
  /// error reaches the least principal moment, or rounding might; `not_symmetric`, `not_positive_definite` of the
  /// torque.
  [[nodiscard]] static ELLIPTUDE_SELDOM Status make(const RigidBody<Scalar>& body, const Potential& potential,
                                                    const Scalar& longest_step,
                                                    const BodyUncertainty<Scalar>& uncertainty,
                                                    GuaranteedRigidBodyFlow& flow) noexcept {
    if (!scalar::isfinite(longest_step) || !scalar::isfinite(uncertainty.inertia)) {
      return Status::not_finite;
    }
    if (!(longest_step > Scalar(0)) || !(uncertainty.inertia >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (!(uncertainty.inertia < body.least_moment())) {
      return Status::invalid_inertia;
    }
    if (const Status status = validate(Ellipsoid<Scalar, 3>{Vector3<Scalar>::Zero(), uncertainty.torque});
        status != Status::ok) {
      return status;
    }
    const TorqueExpansion<Potential, Scalar, 1> expansion(potential);
    const TorqueBounds<Scalar> torque_bounds = expansion.bounds(Matrix3<Scalar>::Identity());
    const TorqueBounds<Scalar> acceleration_bounds = expansion.bounds(body.inertia_inverse());
    if (!scalar::isfinite(torque_bounds.largest) || !scalar::isfinite(acceleration_bounds.largest)) {
      return Status::not_finite;
    }
    flow.body_ = body;
    flow.potential_ = potential;
    flow.longest_step_ = longest_step;
    flow.uncertainty_ = uncertainty;
    flow.uncertainty_.torque = symmetrized(uncertainty.torque);
    flow.torque_bounds_ = torque_bounds;
    flow.acceleration_bounds_ = acceleration_bounds;
    flow.PredictionLimits::operator=(PredictionLimits());
    return Status::ok;
  }

  [[nodiscard]] const RigidBody<Scalar>& body() const noexcept { return body_; }
  [[nodiscard]] const Potential& potential() const noexcept { return potential_; }
  [[nodiscard]] const Scalar& longest_step() const noexcept { return longest_step_; }
  [[nodiscard]] const BodyUncertainty<Scalar>& uncertainty() const noexcept { return uncertainty_; }

  /// If the motion or the set has no bound with these steps, three and nine times as many are tried before the
  /// prediction fails.
  /// \return `not_finite`; `not_positive_definite` of a flat set; `out_of_range` of a negative duration;
  /// `too_many_steps`; `callback_failed`; `step_too_long` if the motion itself turns too far even then; `unbounded` if
  /// the set is too large, or the step too long for it, for the prediction to say anything; `interrupted`.
  [[nodiscard]] Status predict(const Scalar& time, const Scalar& duration, const Input& input,
                               const GibbsEllipsoid<State>& ellipsoid, GibbsEllipsoid<State>& result) const noexcept {
    if (!scalar::isfinite(time) || !scalar::isfinite(duration) || !scalar::all_finite(input.control_torque) ||
        !scalar::all_finite(input.wheel_momentum)) {
      return Status::not_finite;
    }
    if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (duration == Scalar(0)) {
      result = ellipsoid;
      return Status::ok;
    }
    long steps = 1;
    if (const Status status = divide(duration, longest_step_, steps); status != Status::ok) {
      return status;
    }
    Status status = divided(time, duration, steps, input, ellipsoid, result);
    long finer = steps;
    const bool may_close = status == Status::unbounded || status == Status::step_too_long;
    for (int retry = 0; retry < 2 && may_close && finer <= most_steps() / 3; ++retry) {
      finer *= 3;
      const Status again = divided(time, duration, finer, input, ellipsoid, result);
      if (again == Status::ok || again == Status::interrupted) {
        return again;
      }
      if (again == Status::unbounded) {
        status = again;  // the motion is not what fails
      }
    }
    return status;
  }

  /// What remains known about the angular velocity without the attitude: ‖Jω + h_w‖ grows no faster than the torques.
  /// \return `not_finite`; `out_of_range` of a negative duration; `beyond_domain`, also of a body of which rounding
  /// leaves no inverse; `callback_failed`; `too_many_steps` of a flow that was not made.
  [[nodiscard]] Status predict_vector(const Scalar& time, const Scalar& duration, const Input& input,
                                      const Ellipsoid<Scalar, 3>& ellipsoid,
                                      Ellipsoid<Scalar, 3>& result) const noexcept {
    if (!scalar::isfinite(time) || !scalar::isfinite(duration) || !scalar::all_finite(input.control_torque) ||
        !scalar::all_finite(input.wheel_momentum)) {
      return Status::not_finite;
    }
    if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (duration == Scalar(0)) {
      result = ellipsoid;
      return Status::ok;
    }
    if (!(longest_step_ > Scalar(0))) {
      return Status::too_many_steps;
    }
    const Scalar error = uncertainty_.inertia;
    const Matrix3<Scalar>& j = body_.inertia();
    const Matrix3<Scalar> momentum_shape = covered_momentum_shape(ellipsoid.shape);
    const Scalar gradient = torque_bounds_.by_inertia * error;
    Scalar torque(0);
    if (const Status status = largest_torque(time, duration, torque); status != Status::ok) {
      return status;
    }
    const Scalar speed = scalar::length(ellipsoid.center) + detail::tube::radius(ellipsoid.shape);
    const Scalar wheel = scalar::length(input.wheel_momentum);
    Scalar momentum = scalar::length(Vector3<Scalar>(j * ellipsoid.center + input.wheel_momentum)) +
                      detail::tube::radius(momentum_shape) + error * speed;
    momentum += rounding_of_momentum(ellipsoid.center, input.wheel_momentum);
    momentum += duration *
                (torque + gradient + scalar::length(input.control_torque) + detail::tube::radius(uncertainty_.torque));
    momentum += error * (momentum + wheel) / (body_.least_moment() - error);
    const Matrix3<Scalar>& inverse = body_.inertia_inverse();
    const Vector3<Scalar> center = -inverse * input.wheel_momentum;
    const Scalar defect = defect_of_inverse();
    if (!(defect < Scalar(1))) {
      return Status::beyond_domain;
    }
    momentum = (momentum + momentum_left(center, input.wheel_momentum)) / (Scalar(1) - defect);
    Matrix3<Scalar> shape = (rounding::enlarged(momentum, rounding::product) * momentum) * inverse.lazyProduct(inverse);
    shape.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::sum);
    if (!scalar::all_finite(shape) || !is_in_domain(shape)) {
      return Status::beyond_domain;
    }
    result.center = center;
    result.shape = shape;
    return Status::ok;
  }

 private:
  struct Course {
    GibbsEllipsoid<State> end;
    Scalar size;                  // of the set at the end: √det P
    Scalar largest_displacement;  // of the errors since the beginning of a tube, before the last step
    long step;                    // of how many this is the end
  };

  /// J P J, of which the errors Jω of the momentum are, raised by what rounding may do to it: a needle's shape may be
  /// long where J is small.
  [[nodiscard]] Matrix3<Scalar> covered_momentum_shape(const Matrix3<Scalar>& shape) const noexcept {
    const Matrix3<Scalar>& j = body_.inertia();
    Matrix3<Scalar> result = j * shape * j;
    const Vector3<Scalar> rows = rounding::row_norms<Scalar>(j, shape.diagonal().cwiseSqrt());
    result.diagonal() += rounding::share<Scalar>(rounding::congruence) * rows.cwiseAbs2();
    return result;
  }

  /// What rounding may do to Jω + h_w, of which the terms may cancel: a body's momentum and its wheel's often do.
  [[nodiscard]] Scalar rounding_of_momentum(const Vector3<Scalar>& rate, const Vector3<Scalar>& wheel) const noexcept {
    const Vector3<Scalar> terms =
        rounding::row_norms<Scalar>(body_.inertia(), rate.cwiseAbs()) + Vector3<Scalar>(wheel.cwiseAbs());
    return rounding::share<Scalar>(rounding::momentum) * scalar::length(terms);
  }

  /// A bound of ‖Jω + h_w‖ at the center, where it would be zero but for rounding.
  [[nodiscard]] Scalar momentum_left(const Vector3<Scalar>& center, const Vector3<Scalar>& wheel) const noexcept {
    const Vector3<Scalar> left = body_.inertia() * center + wheel;
    return scalar::length(left) + rounding_of_momentum(center, wheel);
  }

  /// A bound of ‖JX − I‖ of the inverse X as it was computed, so that ‖X⁻¹v‖ ≤ ‖Jv‖/(1 − defect).
  [[nodiscard]] ELLIPTUDE_SELDOM Scalar defect_of_inverse() const noexcept {
    const Matrix3<Scalar>& j = body_.inertia();
    const Matrix3<Scalar>& inverse = body_.inertia_inverse();
    const Matrix3<Scalar> residual = j * inverse - Matrix3<Scalar>::Identity();
    const Matrix3<Scalar> terms = j.cwiseAbs() * inverse.cwiseAbs();
    return scalar::sqrt(Scalar(residual.squaredNorm())) +
           rounding::share<Scalar>(rounding::momentum) * scalar::sqrt(Scalar(terms.squaredNorm()));
  }

  /// Bound of the potential's torque at every attitude from `time` on.
  [[nodiscard]] Status largest_torque(const Scalar& time, const Scalar& duration, Scalar& largest) const noexcept {
    using Expansion = TorqueExpansion<Potential, Scalar, 1>;
    largest = torque_bounds_.largest + torque_bounds_.fixed;
    if constexpr (is_local<Expansion>) {
      Expansion expansion(potential_);
      if (const Status status =
              expansion.begin_step(Matrix3<Scalar>::Identity(), Vector3<Scalar>::Zero(), time, Scalar(0));
          status != Status::ok) {
        return status;
      }
      const TorqueBounds<Scalar> bounds = expansion.bounds(Matrix3<Scalar>::Identity());
      largest = bounds.largest + bounds.fixed + expansion.remainder(scalar::constant<Scalar>(3.1416L), duration);
    }
    return Status::ok;
  }

  /// The prediction in so many steps.
  [[nodiscard]] Status divided(const Scalar& time, const Scalar& duration, long steps, const Input& input,
                               const GibbsEllipsoid<State>& ellipsoid, GibbsEllipsoid<State>& result) const noexcept {
    const Scalar h = duration / Scalar(static_cast<scalar::Value<Scalar>>(steps));
    // What is of third order grows with the square of how far a tube's errors have moved since it began, so it may be
    // better to begin again with an ellipsoid about all of them; but each such ellipsoid is larger than what it
    // contains, and second-order terms that would have cancelled later no longer do. Both ways hold the truth, and the
    // smaller set is taken.
    Course course;
    Status status = follow(time, h, steps, input, ellipsoid, scalar::constant<Scalar>(0.1L), course);
    const Scalar shorter = scalar::constant<Scalar>(0.01L);
    if (steps > 1 && (status == Status::unbounded || (status == Status::ok && course.largest_displacement > shorter))) {
      status = follow_again(time, h, steps, input, ellipsoid, shorter, status, course);
    }
    if (status == Status::ok) {
      result = course.end;
    }
    return status;
  }

  /// The same with shorter tubes. \param status of the course. \return that of the one with the smaller set, which it
  /// is now.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status follow_again(const Scalar& time, const Scalar& h, long steps,
                                                          const Input& input, const GibbsEllipsoid<State>& ellipsoid,
                                                          const Scalar& longest, Status status,
                                                          Course& course) const noexcept {
    Course other;
    if (follow(time, h, steps, input, ellipsoid, longest, other) == Status::ok &&
        (status != Status::ok || other.size < course.size)) {
      course = other;
      return Status::ok;
    }
    return status;
  }

  /// A tube after another, each until its errors have moved by more than `longest`.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status follow(const Scalar& time, const Scalar& h, long steps, const Input& input,
                                                    const GibbsEllipsoid<State>& ellipsoid, const Scalar& longest,
                                                    Course& course) const noexcept {
    GibbsEllipsoid<State>& set = course.end;
    set = ellipsoid;
    // A center within `rotation_tolerance` is not yet one within rounding.
    set.center.attitude = renormalized(set.center.attitude);
    course.largest_displacement = Scalar(0);
    course.step = 0;
    ErrorTube<Scalar, Potential> tube;
    while (course.step < steps) {
      if (const Status status = tube.start(set.shape, h, stiffness()); status != Status::ok) {
        return course.step > 0 ? Status::unbounded : refused(set.shape, status);
      }
      if (const Status status = follow_tube(tube, time, h, steps, input, longest, course); status != Status::ok) {
        return status;
      }
      if (!put_end(tube, course)) {
        return Status::unbounded;
      }
    }
    return Status::ok;
  }

  /// A bound of ‖J⁻¹ ∂M/∂ζ‖, 1/s².
  [[nodiscard]] Scalar stiffness() const noexcept { return acceleration_bounds_.degree * acceleration_bounds_.largest; }

  /// Why no tube starts with a shape, which said `status`. Of one that is as it should be, h² has overflowed.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE static Status refused(const Matrix6<Scalar>& shape, Status status) noexcept {
    return is_positive_definite(shape) ? Status::step_too_long : status;
  }

  /// The set at a tube's end. \return whether its shape is finite and positive definite.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE static bool put_end(const ErrorTube<Scalar, Potential>& tube,
                                                          Course& course) noexcept {
    course.end.shape = tube.shape();
    Matrix6<Scalar> factor;
    if (!scalar::all_finite(course.end.shape) || put_cholesky(course.end.shape, factor) != Status::ok) {
      return false;
    }
    course.size = factor.diagonal().prod();
    return true;
  }

  /// Takes as many of the steps that are left as a tube that has been started may have. The series of the motion is here, and
  /// not where the tube is, as both are large.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status follow_tube(ErrorTube<Scalar, Potential>& tube, const Scalar& time,
                                                         const Scalar& h, long steps, const Input& input,
                                                         const Scalar& longest, Course& course) const noexcept {
    MotionSeries<Scalar, Potential> series(potential_, torque_bounds_, acceleration_bounds_);
    for (;;) {
      if (interruption().after(course.step)) {
        return Status::interrupted;
      }
      const Scalar now = time + Scalar(static_cast<scalar::Value<Scalar>>(course.step)) * h;
      if (const Status status = series.expand(body_, now, h, input, course.end.center); status != Status::ok) {
        return status;
      }
      if (const Status status = tube.step(body_, series, uncertainty_); status != Status::ok) {
        return status;
      }
      course.end.center = series.end;
      if (++course.step == steps) {
        return Status::ok;
      }
      const Scalar displacement = tube.displacement();
      if (displacement > course.largest_displacement) {
        course.largest_displacement = displacement;
      }
      if (displacement > longest) {
        return Status::ok;
      }
    }
  }

  RigidBody<Scalar> body_;
  Potential potential_;
  Scalar longest_step_{0};
  BodyUncertainty<Scalar> uncertainty_;
  TorqueBounds<Scalar> torque_bounds_;        // of M
  TorqueBounds<Scalar> acceleration_bounds_;  // of J⁻¹M
};

}  // namespace elliptude
