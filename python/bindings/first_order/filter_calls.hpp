#pragma once

/// \file
/// Calls of a first-order filter, with its statuses as exceptions that say what was wrong.

#include <elliptude/first_order/filter.hpp>
#include <optional>
#include <string>
#include <vector>

#include "first_order/flow.hpp"
#include "signals.hpp"

namespace elliptude::python {

/// Whether the angular velocity is in the filter's state, and may be measured.
template <typename Filter>
inline constexpr bool has_rate = std::is_same_v<typename Filter::State, BodyState>;

template <typename Filter>
void predict_to(Filter& filter, double time, const Vector3<double>& input, const Failure& failure) {
  const Status status = filter.predict(time, typename Filter::Input{input});
  failure.rethrow();
  raise_if_interrupted(status);
  if (status == Status::out_of_range) {
    value_error("time must not go backwards, but is " + text(time) + " s after " + text(filter.time()) + " s");
  }
  if constexpr (has_rate<Filter>) {
    if (status == Status::too_many_steps) {
      raise_too_many_steps(time, filter.time(), filter.flow().most_steps());
    }
  }
  if (status == Status::unbounded) {
    value_error("the set has grown beyond all numbers by " + text(time) + " s, without a measurement since " +
                text(filter.time()) + " s");
  }
  if (status == Status::step_too_long) {
    value_error(
        "step of the flow is too long: the turn within a stage must stay below a right angle, and the angular "
        "velocity is " +
        text(vector_part(filter.ellipsoid().center).norm()) + " rad/s");
  }
  raise_unless_ok(status, "predict");
}

/// Fuses whatever there is.
template <typename Filter>
[[nodiscard]] Status fuse(Filter& filter, const std::vector<Direction<double>>& directions,
                          const std::optional<AngularVelocity<double>>& rate, Update<double>& update) {
  if constexpr (has_rate<Filter>) {
    if (rate) {
      return filter.update(directions.data(), directions.size(), *rate, update);
    }
  } else if (rate) {
    throw py::type_error("angular_velocity cannot update a GyroFlow: the gyro's rate is the input of predict");
  }
  return filter.update(directions.data(), directions.size(), update);
}

template <typename Filter>
void raise_unless_updated(const Filter& filter, Status status, const Update<double>& update,
                          const std::string& sensor) {
  if (status == Status::empty_intersection) {
    throw InconsistentSets("measurement" + (sensor.empty() ? "" : " of " + sensor) + " at " + text(filter.time()) +
                               " s contradicts the prediction: the sets do not meet (margin " + text(update.margin) +
                               "); some bound is wrong",
                           update.margin, filter.time(), sensor);
  }
  raise_unless_ok(status, "update");
}

}  // namespace elliptude::python
