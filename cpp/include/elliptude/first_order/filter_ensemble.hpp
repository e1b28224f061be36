#pragma once

/// \file
/// Many first-order filters that are alike, `Width` at a time in SIMD registers, with the results that each has alone.
/// For compilers with vector extensions (GCC, Clang).

#include <algorithm>
#include <cstddef>
#include <utility>

#include "elliptude/ensemble/pack.hpp"
#include "elliptude/first_order/detail/lanewise_linear_fusion.hpp"
#include "elliptude/first_order/detail/lanewise_measurement.hpp"
#include "elliptude/first_order/detail/lanewise_prediction.hpp"
#include "elliptude/first_order/filter.hpp"

namespace elliptude {

/// Filters side by side: in each lane what an `AttitudeFilter` holds of its own.
template <typename Filter, int Width>
struct FilterLanes {
  using Scalar = Pack<typename Filter::Scalar, Width>;
  using State = typename decltype(std::declval<const typename Filter::Flow&>().template cast<Scalar>())::State;

  std::size_t size = 0;  ///< how many filters; the lanes beyond hold the last one again
  Scalar time;
  StateEllipsoid<State> ellipsoid;
  Matrix6<Scalar> transition;
  Matrix6<Scalar> prior_shape;
};

/// What filters have in common that differ in their sets, their inputs and their measurements. Lanes in which all is as
/// usual go through a register together; a lane in which something is not goes alone, by `AttitudeFilter`: each filter
/// ends where it would end alone, with the same bits if Eigen's own vectors are off (`EIGEN_DONT_VECTORIZE`), else
/// within rounding.
template <typename FilterType, int Width>
class FilterEnsemble {
 public:
  using Filter = FilterType;
  using Flow = typename Filter::Flow;
  using Input = typename Filter::Input;
  using Number = typename Filter::Scalar;
  using Lanes = FilterLanes<Filter, Width>;

  /// \param flow one whose potential has `cast`.
  /// \return the status of `validate` for the criterion.
  [[nodiscard]] static Status make(const Flow& flow, const SizeCriterion<Number, 6>& criterion,
                                   FilterEnsemble& ensemble) noexcept {
    if (const Status status = validate(criterion); status != Status::ok) {
      return status;
    }
    ensemble.flow_ = flow;
    ensemble.criterion_ = criterion;
    ensemble.packed_flow_ = flow.template cast<Scalar>();
    ensemble.packed_criterion_.kind = static_cast<typename SizeCriterion<Scalar, 6>::Kind>(criterion.kind);
    ensemble.packed_criterion_.weight = criterion.weight.template cast<Scalar>();
    return Status::ok;
  }

  /// Puts the sets and times of filters side by side.
  /// \param size from 1 to `Width`.
  static void put(const Filter* filters, std::size_t size, Lanes& lanes) noexcept {
    lanes.size = size;
    for (std::size_t i = 0; i < width; ++i) {
      put_lane(filters[std::min(i, size - 1)], i, lanes);
    }
  }

  /// The filter of a lane.
  /// \return the status of `AttitudeFilter::make` and `resume`.
  [[nodiscard]] Status filter(const Lanes& lanes, std::size_t i, Filter& result) const noexcept {
    const StateEllipsoid<typename Filter::State> ellipsoid{
        {lane(lanes.ellipsoid.center.attitude, i), lane(vector_part(lanes.ellipsoid.center), i)},
        lane(lanes.ellipsoid.shape, i)};
    Filter made;
    if (const Status status = Filter::make(flow_, criterion_, lanes.time[i], ellipsoid, made); status != Status::ok) {
      return status;
    }
    if (const Status status = made.resume(lane(lanes.transition, i), lane(lanes.prior_shape, i));
        status != Status::ok) {
      return status;
    }
    result = made;
    return Status::ok;
  }

  /// `AttitudeFilter::predict` of each filter.
  /// \param inputs, statuses as many as filters. A filter whose status is not `ok` has not changed.
  /// \return how many filters went alone.
  std::size_t predict(const Number& time, const Input* inputs, Lanes& lanes, Status* statuses) const noexcept {
    const Mask usual = predict_together(time, inputs, lanes);
    return finish(usual, lanes, statuses,
                  [&](Filter& filter, std::size_t i) { return filter.predict(time, inputs[i]); });
  }

  /// `AttitudeFilter::update` of each filter with directions and an angular velocity.
  /// \param directions `count` of each filter, one filter's after the other's.
  /// \param rates, updates, statuses as many as filters. `updates` are those that `AttitudeFilter` sets.
  /// \return how many filters went alone.
  std::size_t update(const Direction<Number>* directions, std::size_t count, const AngularVelocity<Number>* rates,
                     Lanes& lanes, Update<Number>* updates, Status* statuses) const noexcept {
    static_assert(measures_rate, "the gyro's rate is the input of GyroFlow, not a measurement");
    const Mask usual = update_together(directions, count, rates, lanes, updates);
    return finish(usual, lanes, statuses, [&](Filter& filter, std::size_t i) {
      return filter.update(directions + i * count, count, rates[i], updates[i]);
    });
  }

  /// The same with directions alone.
  std::size_t update(const Direction<Number>* directions, std::size_t count, Lanes& lanes, Update<Number>* updates,
                     Status* statuses) const noexcept {
    const Mask usual = update_together(directions, count, lanes, updates);
    return finish(usual, lanes, statuses, [&](Filter& filter, std::size_t i) {
      return filter.update(directions + i * count, count, updates[i]);
    });
  }

  /// The same with a whole attitude of each filter.
  std::size_t update(const MeasuredAttitude<Number>* attitudes, Lanes& lanes, Update<Number>* updates,
                     Status* statuses) const noexcept {
    MeasuredAttitude<Scalar> measured;
    for (std::size_t i = 0; i < width; ++i) {
      set_lane(measured.attitude, i, attitudes[std::min(i, lanes.size - 1)].attitude);
      set_lane(measured.bound, i, attitudes[std::min(i, lanes.size - 1)].bound);
    }
    const Mask usual = fuse_attitude(detail::lanewise::is_rotation(measured.attitude), measured, lanes, updates);
    return finish(usual, lanes, statuses,
                  [&](Filter& filter, std::size_t i) { return filter.update(attitudes[i], updates[i]); });
  }

  /// The same with an angular velocity alone.
  std::size_t update(const AngularVelocity<Number>* rates, Lanes& lanes, Update<Number>* updates,
                     Status* statuses) const noexcept {
    static_assert(measures_rate, "the gyro's rate is the input of GyroFlow, not a measurement");
    const LinearMeasurement<Scalar, 3> linear =
        linear_angular_velocity(lanes.ellipsoid.center.angular_velocity, gathered_rate(rates, lanes.size));
    Fusion<PackedState> fusion;
    const Mask usual = detail::lanewise::fuse(linear, lanes.ellipsoid, Filter::recentring, packed_criterion_, fusion);
    accept(usual, fusion, lanes, updates);
    return finish(usual, lanes, statuses,
                  [&](Filter& filter, std::size_t i) { return filter.update(rates[i], updates[i]); });
  }

 private:
  using Scalar = typename Lanes::Scalar;
  using Mask = typename Scalar::Mask;
  using PackedState = typename Lanes::State;
  using PackedFlow = decltype(std::declval<const Flow&>().template cast<Scalar>());
  static constexpr auto width = static_cast<std::size_t>(Width);
  static constexpr bool measures_rate = std::is_same_v<typename Filter::State, RigidBodyState<Number>>;

  static void put_lane(const Filter& filter, std::size_t i, Lanes& lanes) noexcept {
    Vector3<Scalar> vector = vector_part(lanes.ellipsoid.center);
    set_lane(vector, i, vector_part(filter.ellipsoid().center));
    set_lane(lanes.ellipsoid.center.attitude, i, filter.ellipsoid().center.attitude);
    lanes.ellipsoid.center = {lanes.ellipsoid.center.attitude, vector};
    set_lane(lanes.ellipsoid.shape, i, filter.ellipsoid().shape);
    set_lane(lanes.transition, i, filter.transition());
    set_lane(lanes.prior_shape, i, filter.prior_shape());
    lanes.time.set(i, filter.time());
  }

  [[nodiscard]] static Mask nowhere() noexcept { return !detail::lanewise::everywhere<Scalar>(); }

  /// One vector for each filter; that of the last also in the lanes beyond.
  template <typename VectorOf>
  [[nodiscard]] static Vector3<Scalar> gathered(std::size_t size, const VectorOf& vector_of) noexcept {
    Vector3<Scalar> result;
    for (std::size_t i = 0; i < width; ++i) {
      set_lane(result, i, vector_of(std::min(i, size - 1)));
    }
    return result;
  }

  /// \return in which lanes the prediction is made.
  [[nodiscard]] Mask predict_together(const Number& time, const Input* inputs, Lanes& lanes) const noexcept {
    const Number duration = time - lanes.time[0];
    long steps = 1;
    if (!all_of(lanes.time == Scalar(lanes.time[0])) || !(duration > Number(0)) || !scalar::isfinite(time) ||
        detail::lanewise::count_steps(flow_, duration, steps) != Status::ok) {
      return nowhere();
    }
    const typename PackedFlow::Input input{gathered(lanes.size, [&](std::size_t i) {
      const auto& [vector] = inputs[i];
      return vector;
    })};
    Prediction<PackedState> prediction;
    Status status = Status::ok;
    Mask usual = detail::lanewise::predict(packed_flow_, lanes.time, Scalar(duration), steps, input, lanes.ellipsoid,
                                           packed_criterion_, prediction, status);
    if (status != Status::ok) {
      return nowhere();
    }
    usual = usual && detail::lanewise::finite(prediction.ellipsoid.shape) &&
            detail::lanewise::in_domain(prediction.ellipsoid.shape) && detail::lanewise::finite(prediction.transition);
    prediction.ellipsoid.center.attitude = renormalized(prediction.ellipsoid.center.attitude);
    lanes.ellipsoid = detail::lanewise::select(usual, prediction.ellipsoid, lanes.ellipsoid);
    lanes.transition = detail::lanewise::select(
        usual, Matrix6<Scalar>(prediction.transition.lazyProduct(lanes.transition)), lanes.transition);
    lanes.time = select(usual, Scalar(time), lanes.time);
    return usual;
  }

  /// Direction k of each filter.
  [[nodiscard]] static Direction<Scalar> gathered_direction(const Direction<Number>* directions, std::size_t count,
                                                            std::size_t k, std::size_t size) noexcept {
    Direction<Scalar> result;
    for (std::size_t i = 0; i < width; ++i) {
      const Direction<Number>& direction = directions[std::min(i, size - 1) * count + k];
      set_lane(result.reference, i, direction.reference);
      set_lane(result.body, i, direction.body);
      set_lane(result.bound, i, direction.bound);
      result.weight.set(i, direction.weight);
    }
    return result;
  }

  using PackedDirections = std::array<Direction<Scalar>, most_directions>;
  static void gather(const Direction<Number>* directions, std::size_t count, std::size_t size,
                     PackedDirections& packed) noexcept {
    for (std::size_t k = 0; k < count; ++k) {
      packed[k] = gathered_direction(directions, count, k, size);
    }
  }

  [[nodiscard]] static AngularVelocity<Scalar> gathered_rate(const AngularVelocity<Number>* rates,
                                                             std::size_t size) noexcept {
    AngularVelocity<Scalar> rate;
    for (std::size_t i = 0; i < width; ++i) {
      set_lane(rate.value, i, rates[std::min(i, size - 1)].value);
      set_lane(rate.bound, i, rates[std::min(i, size - 1)].bound);
    }
    return rate;
  }

  /// \return in which lanes the update is made.
  [[nodiscard]] Mask update_together(const Direction<Number>* directions, std::size_t count,
                                     const AngularVelocity<Number>* rates, Lanes& lanes,
                                     Update<Number>* updates) const noexcept {
    if (count < 2 || count > most_directions) {
      return nowhere();
    }
    PackedDirections packed;
    gather(directions, count, lanes.size, packed);
    StateEllipsoid<PackedState> measured;
    Mask usual = detail::lanewise::measured_state(packed.data(), count, gathered_rate(rates, lanes.size),
                                                  packed_criterion_, measured);
    Fusion<PackedState> fusion;
    usual = usual && detail::lanewise::fuse(measured, lanes.ellipsoid, Filter::recentring, packed_criterion_, fusion);
    accept(usual, fusion, lanes, updates);
    return usual;
  }
  [[nodiscard]] Mask update_together(const Direction<Number>* directions, std::size_t count, Lanes& lanes,
                                     Update<Number>* updates) const noexcept {
    if (count < 2 || count > most_directions) {
      return nowhere();
    }
    PackedDirections packed;
    gather(directions, count, lanes.size, packed);
    MeasuredAttitude<Scalar> measured;
    const Mask usual = detail::lanewise::measured_attitude(packed.data(), count, measured);
    return fuse_attitude(usual, measured, lanes, updates);
  }

  /// \param usual lanes in which the attitude is a rotation.
  /// \return in which lanes the update is made.
  [[nodiscard]] Mask fuse_attitude(Mask usual, const MeasuredAttitude<Scalar>& measured, Lanes& lanes,
                                   Update<Number>* updates) const noexcept {
    const LinearMeasurement<Scalar, 3> linear = detail::attitude_rows(lanes.ellipsoid.center.attitude, measured);
    Fusion<PackedState> fusion;
    usual = usual && detail::lanewise::fuse(linear, lanes.ellipsoid, Filter::recentring, packed_criterion_, fusion);
    accept(usual, fusion, lanes, updates);
    return usual;
  }

  /// Takes a fusion in the lanes of the mask.
  static void accept(const Mask& usual, const Fusion<PackedState>& fusion, Lanes& lanes,
                     Update<Number>* updates) noexcept {
    lanes.ellipsoid = detail::lanewise::select(usual, fusion.ellipsoid, lanes.ellipsoid);
    lanes.prior_shape = detail::lanewise::select(usual, fusion.ellipsoid.shape, lanes.prior_shape);
    lanes.transition = detail::lanewise::select(usual, Matrix6<Scalar>(Matrix6<Scalar>::Identity()), lanes.transition);
    for (std::size_t i = 0; i < lanes.size; ++i) {
      if (usual.lanes[i] != 0) {
        updates[i] = {fusion.share[i], fusion.margin[i]};
      }
    }
  }

  /// Does alone what was not done together. \return for how many filters.
  template <typename Alone>
  std::size_t finish(const Mask& usual, Lanes& lanes, Status* statuses, const Alone& alone) const noexcept {
    std::size_t alone_count = 0;
    for (std::size_t i = 0; i < lanes.size; ++i) {
      statuses[i] = Status::ok;
      if (usual.lanes[i] != 0) {
        continue;
      }
      ++alone_count;
      Filter filter;
      statuses[i] = this->filter(lanes, i, filter);
      if (statuses[i] == Status::ok) {
        statuses[i] = alone(filter, i);
      }
      if (statuses[i] != Status::ok) {
        continue;
      }
      const std::size_t end = i + 1 == lanes.size ? width : i + 1;
      for (std::size_t k = i; k < end; ++k) {
        put_lane(filter, k, lanes);
      }
    }
    return alone_count;
  }

  Flow flow_;
  SizeCriterion<Number, 6> criterion_ = SizeCriterion<Number, 6>::volume();
  PackedFlow packed_flow_;
  SizeCriterion<Scalar, 6> packed_criterion_ = SizeCriterion<Scalar, 6>::volume();
};

}  // namespace elliptude
