#pragma once

/// \file
/// The filter: owns the state ellipsoid and the time, predicts and updates. (paper, §3)

#include "elliptude/first_order/estimator.hpp"
#include "elliptude/first_order/flow.hpp"

namespace elliptude {

/// What an update did.
template <typename Scalar>
struct Update {
  Scalar share;   ///< 0 measurement alone … 1 prediction alone, of the last fusion
  Scalar margin;  ///< the least overlap of the sets fused, negative if and only if they do not meet
};

/// A filter is valid at all times: a function that does not return `ok` has changed nothing. If an update after a
/// prediction fails, the prediction remains, as if there had been no measurement. A filter that `make` has not made has
/// a set that is not finite, at time zero: it predicts and updates nothing.
template <typename FlowType, typename Estimator>
class AttitudeFilter {
 public:
  using Flow = FlowType;
  using State = typename Flow::State;
  using Input = typename Flow::Input;
  using Scalar = StateScalar<State>;
  static constexpr Recentring recentring = Estimator::recentring;

  /// \param ellipsoid holds the state at `time`.
  /// \return the status of `validate` for the ellipsoid or the criterion; `not_finite` for the time.
  [[nodiscard]] static ELLIPTUDE_SELDOM Status make(const Flow& flow, const SizeCriterion<Scalar, 6>& criterion,
                                                    const Scalar& time, const StateEllipsoid<State>& ellipsoid,
                                                    AttitudeFilter& filter) noexcept {
    if (!scalar::isfinite(time)) {
      return Status::not_finite;
    }
    if (const Status status = validate(criterion); status != Status::ok) {
      return status;
    }
    if (const Status status = validate(ellipsoid); status != Status::ok) {
      return status;
    }
    filter.flow_ = flow;
    filter.criterion_ = criterion;
    StateEllipsoid<State> start = ellipsoid;
    // One within `rotation_tolerance` is made a rotation; one that is so to rounding, as a stored one, keeps its bits.
    if (!is_rotation(start.center.attitude, rounding::share<Scalar>(rounding::center))) {
      start.center.attitude = renormalized(start.center.attitude);
    }
    filter.restart(time, start);
    return Status::ok;
  }

  /// Restores `transition()` and `prior_shape()` of a stored filter with the same state.
  /// \return `not_finite`; the status of `validate` for the shape.
  [[nodiscard]] Status resume(const Matrix6<Scalar>& transition, const Matrix6<Scalar>& prior_shape) noexcept {
    if (!scalar::all_finite(transition)) {
      return Status::not_finite;
    }
    if (const Status status = validate(Ellipsoid<Scalar, 6>{Vector6<Scalar>::Zero(), prior_shape});
        status != Status::ok) {
      return status;
    }
    transition_ = transition;
    prior_shape_ = prior_shape;
    return Status::ok;
  }

  [[nodiscard]] const Scalar& time() const noexcept { return time_; }
  [[nodiscard]] const StateEllipsoid<State>& ellipsoid() const noexcept { return ellipsoid_; }
  [[nodiscard]] const Flow& flow() const noexcept { return flow_; }
  [[nodiscard]] const SizeCriterion<Scalar, 6>& criterion() const noexcept { return criterion_; }
  /// A^f since the last update, and P₀ after it: for the diagnostics of `first_order/convergence.hpp`.
  [[nodiscard]] const Matrix6<Scalar>& transition() const noexcept { return transition_; }
  [[nodiscard]] const Matrix6<Scalar>& prior_shape() const noexcept { return prior_shape_; }

  /// Moves the ellipsoid to a later time (paper, §3.1). Without updates in between this is the paper's uncertainty
  /// tube.
  /// \return the status of the flow; `out_of_range` for a time before the filter's; `unbounded` if the set has grown
  /// beyond the domain (`is_in_domain`), or so far that rounding left none.
  [[nodiscard]] Status predict(const Scalar& time, const Input& input) noexcept {
    return predict_interval(time, Scalar(time - time_), input);
  }

  /// The same where the interval is better known than as the difference of two times: see base/stamps.hpp.
  /// \param time at its end, s, which the filter then has. The two are not compared.
  /// \param duration of the interval, s.
  /// \return the status of `predict`; `out_of_range` of a negative duration.
  [[nodiscard]] Status predict_interval(const Scalar& time, const Scalar& duration, const Input& input) noexcept {
    if (!scalar::isfinite(time)) {
      return Status::not_finite;
    }
    Prediction<State> prediction;
    if (const Status status = flow_.predict(time_, duration, input, ellipsoid_, criterion_, prediction);
        status != Status::ok) {
      return status;
    }
    if (!detail::is_kept(prediction.ellipsoid) || !scalar::all_finite(prediction.transition)) {
      return Status::unbounded;
    }
    ellipsoid_ = prediction.ellipsoid;
    if (duration != Scalar(0)) {  // a prediction over no time must change nothing, not even by rounding
      ellipsoid_.center.attitude = renormalized(ellipsoid_.center.attitude);
    }
    transition_ = prediction.transition.lazyProduct(transition_).eval();
    time_ = time;
    return Status::ok;
  }

  /// Directions and angular velocity together. If the directions determine an attitude, as in the paper: E^m of all of
  /// them, fused once with the prediction. If they do not, as one alone, collinear ones or none: each as what it says,
  /// then the angular velocity.
  /// \return the status of the measurements' `validate` and the fusion; `out_of_range` of too many directions or of a
  /// null pointer to any; after `empty_intersection` `update.margin` is set.
  [[nodiscard]] Status update(const Direction<Scalar>* directions, std::size_t count,
                              const AngularVelocity<Scalar>& angular_velocity, Update<Scalar>& update) noexcept {
    static_assert(std::is_same_v<State, RigidBodyState<Scalar>>,
                  "the gyro's rate is the input of GyroFlow, not a measurement");
    StateEllipsoid<State> measured;
    bool determined = false;
    if (const Status status = find_measured(directions, count, angular_velocity, determined, measured);
        status != Status::ok) {
      if constexpr (Estimator::takes_in_turn) {
        if (status == Status::attitude_undetermined && !determined) {
          return update_in_turn(directions, count, angular_velocity, update);
        }
      }
      return status;
    }
    Scalar share(0);
    Scalar margin(0);
    const Status status =
        detail::fuse_ellipsoids(measured, ellipsoid_, recentring, criterion_, ellipsoid_, share, margin);
    if (status == Status::ok) {
      accept(ellipsoid_);
    }
    return report(status, share, margin, update);
  }

  /// Directions without an angular velocity: two or more as one measured attitude, the sum of its terms by least trace;
  /// one alone, or so nearly collinear ones that the measured attitude reaches beyond a radian, each as what it says.
  /// \return as above; after `empty_intersection` `update.margin` is set.
  [[nodiscard]] Status update(const Direction<Scalar>* directions, std::size_t count, Update<Scalar>& update) noexcept {
    if (count == 0 || directions == nullptr) {
      return Status::out_of_range;
    }
    MeasuredDirections<Scalar> measured;
    const Status status = MeasuredDirections<Scalar>::make(directions, count, measured);
    if (status == Status::ok) {
      MeasuredAttitude<Scalar> attitude;
      SymmetricEigen<Scalar, 3> reach;
      if (const Status summed = measured.measured_attitude(SizeCriterion<Scalar, 3>::trace(), attitude);
          summed != Status::ok) {
        return summed;
      }
      if (const Status found = symmetric_eigen(attitude.bound, reach); found != Status::ok) {
        return found;
      }
      if (reach.values(0) <= Scalar(1)) {  // rad²: beyond, first order in the attitude says little
        return this->update(attitude, update);
      }
    } else if (status != Status::attitude_undetermined) {
      return status;
    }
    StateEllipsoid<State> ellipsoid = ellipsoid_;
    Update<Scalar> worst{Scalar(1), Scalar(1)};
    for (std::size_t i = 0; i < count; ++i) {
      LinearMeasurement<Scalar, 2> linear;
      if (const Status made = linear_direction(ellipsoid.center.attitude, directions[i], linear); made != Status::ok) {
        return made;
      }
      Fusion<State> fusion;
      const Status fused = fuse(linear, ellipsoid, recentring, criterion_, fusion);
      if (fused != Status::ok) {
        return report(fused, fusion.share, fusion.margin, update);
      }
      worst = {fusion.share, fusion.margin < worst.margin ? fusion.margin : worst.margin};
      ellipsoid = fusion.ellipsoid;
    }
    accept(ellipsoid);
    update = worst;
    return Status::ok;
  }

  /// A whole attitude, from a star tracker.
  [[nodiscard]] Status update(const MeasuredAttitude<Scalar>& measured, Update<Scalar>& update) noexcept {
    LinearMeasurement<Scalar, 3> linear;
    if (const Status status = linear_attitude(ellipsoid_.center.attitude, measured, linear); status != Status::ok) {
      return status;
    }
    return this->update(linear, update);
  }

  /// An angular velocity alone.
  [[nodiscard]] Status update(const AngularVelocity<Scalar>& measured, Update<Scalar>& update) noexcept {
    static_assert(std::is_same_v<State, RigidBodyState<Scalar>>,
                  "the gyro's rate is the input of GyroFlow, not a measurement");
    return this->update(linear_angular_velocity(ellipsoid_.center.angular_velocity, measured), update);
  }

  /// Any linear measurement of the error about the present center.
  template <int Rows>
  [[nodiscard]] Status update(const LinearMeasurement<Scalar, Rows>& measurement, Update<Scalar>& update) noexcept {
    Fusion<State> fusion;
    const Status status = fuse(measurement, ellipsoid_, recentring, criterion_, fusion);
    if (status == Status::ok) {
      accept(fusion.ellipsoid);
    }
    return report(status, fusion.share, fusion.margin, update);
  }

 private:
  /// E^m of directions and an angular velocity.
  /// \param determined whether the directions determine an attitude.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status find_measured(const Direction<Scalar>* directions, std::size_t count,
                                                           const AngularVelocity<Scalar>& angular_velocity,
                                                           bool& determined,
                                                           StateEllipsoid<State>& measured) const noexcept {
    MeasuredDirections<Scalar> attitude;
    const Status status = MeasuredDirections<Scalar>::make(directions, count, attitude);
    determined = status == Status::ok;
    return determined ? measured_state(attitude, angular_velocity, criterion_, measured) : status;
  }

  void restart(const Scalar& time, const StateEllipsoid<State>& ellipsoid) noexcept {
    time_ = time;
    accept(ellipsoid);
  }

  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status update_in_turn(const Direction<Scalar>* directions, std::size_t count,
                                                            const AngularVelocity<Scalar>& angular_velocity,
                                                            Update<Scalar>& update) noexcept {
    // What an update changes, should the second of two fail.
    const StateEllipsoid<State> ellipsoid = ellipsoid_;
    const Matrix6<Scalar> transition = transition_;
    const Matrix6<Scalar> prior_shape = prior_shape_;
    Update<Scalar> by_directions{Scalar(1), Scalar(1)};
    if (count > 0) {
      if (const Status status = this->update(directions, count, by_directions); status != Status::ok) {
        if (status == Status::empty_intersection) {
          update.margin = by_directions.margin;
        }
        return status;
      }
    }
    const Status status = this->update(angular_velocity, update);
    if (status == Status::ok) {
      update.margin = by_directions.margin < update.margin ? by_directions.margin : update.margin;
    } else {
      ellipsoid_ = ellipsoid;
      transition_ = transition;
      prior_shape_ = prior_shape;
    }
    return status;
  }

  void accept(const StateEllipsoid<State>& ellipsoid) noexcept {
    ellipsoid_ = ellipsoid;
    prior_shape_ = ellipsoid.shape;
    transition_.setIdentity();
  }

  [[nodiscard]] static Status report(Status status, const Scalar& share, const Scalar& margin,
                                     Update<Scalar>& update) noexcept {
    if (status == Status::ok) {
      update = {share, margin};
    } else if (status == Status::empty_intersection) {
      update.margin = margin;
    }
    return status;
  }

  [[nodiscard]] static StateEllipsoid<State> unmade() noexcept {
    const Scalar none(std::numeric_limits<scalar::Value<Scalar>>::quiet_NaN());
    return {{Matrix3<Scalar>::Identity(), Vector3<Scalar>::Zero()}, Matrix6<Scalar>::Constant(none)};
  }

  Flow flow_;
  SizeCriterion<Scalar, 6> criterion_ = SizeCriterion<Scalar, 6>::volume();
  Scalar time_{0};
  StateEllipsoid<State> ellipsoid_ = unmade();
  Matrix6<Scalar> transition_ = Matrix6<Scalar>::Identity();
  Matrix6<Scalar> prior_shape_ = ellipsoid_.shape;
};

}  // namespace elliptude
