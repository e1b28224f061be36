#pragma once

/// \file
/// One prediction or one update of a guaranteed filter, with the messages of what can go wrong.

#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>
#include <elliptude/guaranteed/update_constraints.hpp>
#include <string>

#include "guaranteed/flow.hpp"
#include "guaranteed/measurements.hpp"
#include "signals.hpp"

namespace elliptude::python {

/// Measurements that an update may have where some of them may be wrong: it tries which.
constexpr Index most_with_wrong_ones = 8;

/// What goes into a prediction beside the time.
struct Inputs {
  Vector3<double> control_torque = Vector3<double>::Zero();
  Vector3<double> wheel_momentum = Vector3<double>::Zero();
  Vector3<double> gyro = Vector3<double>::Zero();
  double increment = -1;  // none
  bool is_measured = true;

  /// Sets a gyro's rate: all NaN if it was not measured.
  void set_gyro(const Vector3<double>& rate, const std::string& name) {
    is_measured = !rate.array().isNaN().all();
    gyro = rate;
    if (is_measured && !scalar::all_finite(gyro)) {
      value_error(name + " must be finite, or all NaN where nothing was measured");
    }
  }
};

template <typename Filter>
[[nodiscard]] typename Filter::Input input_of(const Inputs& inputs) noexcept {
  if constexpr (std::is_same_v<Filter, GuaranteedFilter<GuaranteedBodyFlow>>) {
    return {inputs.control_torque, inputs.wheel_momentum};
  } else {
    return {inputs.gyro, inputs.increment, inputs.is_measured};
  }
}

/// The largest angular velocity or bias that a filter keeps.
[[nodiscard]] inline std::string beyond_domain() { return text(FilterDomain<double>::largest()) + " rad/s"; }

/// Refuses a time to which a filter does not predict: one beyond which doubles do not tell seconds apart.
inline void require_seconds(double time) {
  if (scalar::isfinite(time) && !rounding::tells_seconds(time)) {
    value_error("time must be at most " + text(1 / rounding::share<double>(1)) +
                " s, beyond which numbers do not tell seconds apart, but is " + text(time) +
                " s; are these nanoseconds?");
  }
}

[[noreturn]] inline void raise_backwards(double time, double present) {
  value_error("time must not go backwards, but is " + text(time) + " s after " + text(present) + " s");
}

[[noreturn]] inline void raise_turn_too_far(const std::string& what, double turn, const std::string& unit) {
  prediction_error(what + " a turn of " + text(turn) + " rad, of which nothing is left to be known; is its unit " +
                   unit + "?");
}

/// `predict` of a filter. What a potential in Python raises is raised again, also where the flow could do without that call, and the filter
/// is as it was.
template <typename Filter>
[[nodiscard]] Status predict_or_rethrow(Filter& filter, double time, const Inputs& inputs) {
  if constexpr (std::is_same_v<Filter, GuaranteedFilter<GuaranteedBodyFlow>>) {
    const Filter before = filter;
    failure_of_this_thread() = Failure();
    const Status status = filter.predict(time, input_of<Filter>(inputs));
    if (failure_of_this_thread().happened()) {
      filter = before;
      rethrow_failure_of_this_thread();
    }
    return status;
  } else {
    return filter.predict(time, input_of<Filter>(inputs));
  }
}

template <typename Filter>
void predict_to(Filter& filter, double time, const Inputs& inputs) {
  const Status status = predict_or_rethrow(filter, time, inputs);
  if (status == Status::ok) {
    return;
  }
  raise_if_interrupted(status);
  require_seconds(time);
  if (status == Status::out_of_range && time >= filter.time() && !Filter::measures_rate) {
    raise_turn_too_far("gyro makes", inputs.gyro.norm() * (time - filter.time()), "rad/s");
  }
  if (status == Status::out_of_range) {
    raise_backwards(time, filter.time());
  }
  if constexpr (std::is_same_v<Filter, GuaranteedFilter<GuaranteedBodyFlow>>) {
    if (status == Status::callback_failed) {
      value_error("potential: its torque or torque_jacobian is not finite");
    }
    if (status == Status::too_many_steps) {
      raise_too_many_steps(time, filter.time(), filter.flow().most_steps());
    }
  }
  if (status == Status::step_too_long) {
    prediction_error("step of the flow is too long: the angular velocity is " +
                     text(vector_part(filter.ellipsoid().center).norm()) + " rad/s at " + text(filter.time()) +
                     " s, and the motion in a step must be given by a short series; take a shorter step");
  }
  raise_unpredicted(status, "predict");
}

template <typename Filter>
void turn_to(Filter& filter, double time, const Vector3<double>& turn, const std::string& turn_name, double angle,
             const std::string& bound_name) {
  if (!(angle >= 0)) {
    value_error(bound_name + " must not be negative, but is " + text(angle) + " rad");
  }
  if (!scalar::all_finite(turn)) {
    value_error(turn_name + " must be finite");
  }
  require_seconds(time);
  const Status status = filter.predict_turn(time, turn, angle);
  if (status == Status::out_of_range && time >= filter.time()) {
    raise_turn_too_far(turn_name + " is", turn.stableNorm(), "rad");
  }
  if (status == Status::out_of_range) {
    raise_backwards(time, filter.time());
  }
  if (status != Status::ok) {
    raise_unpredicted(status, "predict_turn");
  }
}

[[noreturn]] inline void raise_inconsistent(const std::string& sensor, double time, double margin) {
  throw InconsistentSets((sensor.empty() ? "the measurements" : "the measurement of " + sensor) + std::string(" at ") +
                             text(time) + " s" + (sensor.empty() ? " contradict" : " contradicts") +
                             " the prediction or each other: no state satisfies all bounds (margin " + text(margin) +
                             "); some bound is wrong",
                         margin, time, sensor);
}

template <typename Filter>
[[nodiscard]] GuaranteedUpdate<double> fuse(Filter& filter, const Measured& measured, const SensorNames& names,
                                            UpdateConstraints<typename Filter::State>* constraints = nullptr) {
  const auto& settings = filter.settings();
  if (settings.policy == Policy::relaxed && settings.most_wrong > 0 && measured.count() > most_with_wrong_ones) {
    value_error("policy 'relaxed' is for at most " + std::to_string(most_with_wrong_ones) +
                " measurements at a time, but there are " + std::to_string(measured.count()));
  }
  GuaranteedUpdate<double> update;
  const Status status = constraints != nullptr ? filter.update(measured.core(), update, *constraints)
                                               : filter.update(measured.core(), update);
  if (status == Status::empty_intersection) {
    std::string sensor;
    measured.for_each(update.contradicting, names.directions(), [&](Index column) { sensor = names.text_of(column); });
    if (sensor.empty() && measured.count() == 1) {  // the prediction weighs more, but it is the one against it
      sensor = names.text_of(!measured.columns.empty()   ? measured.columns[0]
                             : measured.angular_velocity ? names.directions()
                                                         : names.directions() + 1);
    }
    raise_inconsistent(sensor, filter.time(), update.margin);
  }
  if (status == Status::out_of_range && measured.angular_velocity) {
    value_error("angular_velocity and rate_bound must be at most " + beyond_domain() + ", but are " +
                text(measured.angular_velocity->value.norm()) + " and " +
                text(std::sqrt(measured.angular_velocity->bound.trace())) + " rad/s");
  }
  raise_unless_ok(status, "update");
  return update;
}

/// \throws ValueError of a vector without a direction.
[[nodiscard]] inline Vector3<double> vertical_of(const py::object& value) {
  const Vector3<double> vertical = single(value, "vertical", {3}).vector<3>(0);
  if (!(vertical.cwiseAbs().maxCoeff() > 0)) {
    value_error("vertical must not be zero");
  }
  return vertical;
}

}  // namespace elliptude::python
