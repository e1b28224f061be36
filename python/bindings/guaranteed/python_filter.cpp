#include "guaranteed/python_filter.hpp"

#include <utility>

#include "guaranteed/filter_calls.hpp"
#include "guaranteed/policies.hpp"
#include "sets/ellipsoids.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] py::object pair_of(const std::optional<Ellipsoid<double, 3>>& ellipsoid) {
  return ellipsoid ? py::object(py::make_tuple(to_array(ellipsoid->center), to_array(ellipsoid->shape)))
                   : py::object(py::none());
}

/// An ellipsoid of the vector: (center, bound), or a bound about zero.
[[nodiscard]] Ellipsoid<double, 3> vector_bound_of(const py::object& value) {
  if (!py::isinstance<py::tuple>(value)) {
    return {Vector3<double>::Zero(), one_bound(value, "vector_bound", false)};
  }
  const auto pair = value.cast<py::tuple>();
  if (pair.size() != 2) {
    value_error("vector_bound must be a bound or a pair (center, bound), not " + std::to_string(pair.size()) +
                " things");
  }
  return {single(pair[0], "vector_bound[0]", {3}).vector<3>(0), one_bound(pair[1], "vector_bound[1]", false)};
}

[[nodiscard]] py::object updated(const GuaranteedUpdate<double>& update, const py::tuple& dropped) {
  return py::module_::import("elliptude.results")
      .attr("GuaranteedUpdate")(name_of(update.claim), update.prediction_used, dropped, update.margin);
}

}  // namespace

// --- what it is --------------------------------------------------------------------------------------------------------

PythonGuaranteedFilter::PythonGuaranteedFilter(py::object flow, const std::optional<AnyStateEllipsoid>& start,
                                               const py::object& time, std::string criterion, const py::object& weight,
                                               const std::string& policy, int most_wrong, int regain_after,
                                               const py::object& vector_bound, bool estimate_vector)
    : flow_(std::move(flow)), criterion_(std::move(criterion)) {
  const double begin = single(time, "time", {}).number(0);
  require_seconds(begin);
  BodyFilter::Settings settings;
  settings.criterion = size_criterion_of(criterion_, weight);
  settings.policy = policy_of(policy);
  settings.keeps_constraints = true;
  if (most_wrong < 0 || most_wrong > 2) {
    value_error("most_wrong must be 0, 1 or 2, but is " + std::to_string(most_wrong));
  }
  if (most_wrong != 0 && settings.policy != Policy::relaxed) {
    value_error("most_wrong goes with policy 'relaxed', not '" + policy + "'");
  }
  if (regain_after < 1) {
    value_error("regain_after must be at least 1, but is " + std::to_string(regain_after));
  }
  settings.most_wrong = most_wrong;
  settings.regain_after = regain_after;
  settings.estimates_vector = estimate_vector;
  if (!estimate_vector && vector_bound.is_none()) {
    value_error("estimate_vector=False needs vector_bound, which is then all that is known of the vector");
  }
  if (!vector_bound.is_none()) {
    vector_bound_ = vector_bound_of(vector_bound);
  }
  if (py::isinstance<GuaranteedBodyFlowSettings>(flow_)) {
    if (!estimate_vector) {
      throw py::type_error("estimate_vector=False is for a GuaranteedGyroFlow, whose bias need not be estimated");
    }
    make<BodyFilter>(flow_.cast<const GuaranteedBodyFlowSettings&>().flow, settings, begin, start);
  } else if (py::isinstance<GuaranteedGyroFlowSettings>(flow_)) {
    make<GyroFilter>(flow_.cast<const GuaranteedGyroFlowSettings&>().flow,
                     {settings.criterion, settings.policy, settings.most_wrong, settings.regain_after,
                      settings.estimates_vector, settings.keeps_constraints},
                     begin, start);
  } else {
    throw py::type_error(std::string("flow must be a GuaranteedRigidBodyFlow or a GuaranteedGyroFlow, not ") +
                         Py_TYPE(flow_.ptr())->tp_name);
  }
}

template <typename Filter>
void PythonGuaranteedFilter::make(const typename Filter::Flow& flow, const typename Filter::Settings& settings,
                                  double time, const std::optional<AnyStateEllipsoid>& start) {
  using State = typename Filter::State;
  Filter filter;
  typename Filter::Flow interruptible = flow;
  if constexpr (std::is_same_v<Filter, BodyFilter>) {
    interruptible.set_interruption(interruption_by_signals());
  }
  raise_unless_ok(Filter::make(interruptible, settings, time, filter), "criterion");
  const auto bound_vector = [&] {
    if (vector_bound_) {
      const Status status = filter.bound_vector(*vector_bound_);
      if (status == Status::out_of_range) {
        value_error("vector_bound must have a center and half-widths of at most " + beyond_domain());
      }
      if (status == Status::empty_intersection) {
        value_error("vector_bound has nothing in common with what start says of the vector: one of them is wrong");
      }
      raise_unless_ok(status, "vector_bound");
    }
  };
  // A bias that is left to its bound is in that, whatever the start says of it.
  if (!settings.estimates_vector) {
    bound_vector();
  }
  if (start) {
    const Status status =
        start->is_gibbs ? filter.start(start->as<State, GibbsChart>()) : filter.start(start->as<State>());
    if (status == Status::unbounded) {
      value_error(
          "start holds half turns, which say nothing of the attitude: its largest angle must be below pi; without a "
          "start the filter begins with the first measurements");
    }
    if (status == Status::not_positive_definite) {
      value_error("start must have a positive definite shape: a guaranteed set is not flat");
    }
    if (status == Status::out_of_range) {
      value_error("start must have a vector and half-widths of at most " + beyond_domain());
    }
    raise_unless_ok(status, "start");
  }
  if (settings.estimates_vector) {
    bound_vector();
  }
  filter_ = filter;
}

py::object PythonGuaranteedFilter::weight() const {
  if (criterion_ != "weighted_trace") {
    return py::none();
  }
  return std::visit([](const auto& filter) { return py::object(to_array(filter.settings().criterion.weight)); },
                    filter_);
}

const char* PythonGuaranteedFilter::policy() const {
  return std::visit([](const auto& filter) { return policies[static_cast<std::size_t>(filter.settings().policy)]; },
                    filter_);
}

py::object PythonGuaranteedFilter::vector_bound() const { return pair_of(vector_bound_); }

const char* PythonGuaranteedFilter::claim() const {
  return std::visit([](const auto& filter) { return name_of(filter.claim()); }, filter_);
}

std::optional<AnyStateEllipsoid> PythonGuaranteedFilter::ellipsoid() const {
  return std::visit(
      [](const auto& filter) {
        return filter.knows_attitude() ? std::optional(AnyStateEllipsoid::from(filter.ellipsoid())) : std::nullopt;
      },
      filter_);
}

py::object PythonGuaranteedFilter::vector() const {
  return std::visit(
      [](const auto& filter) { return pair_of(filter.knows_vector() ? std::optional(filter.vector()) : std::nullopt); },
      filter_);
}

void PythonGuaranteedFilter::resume(const std::optional<AnyStateEllipsoid>& ellipsoid, const py::object& vector,
                                    bool rests_on_drops, int agreeing_updates, int disputed_updates,
                                    int contradictions) {
  std::optional<Ellipsoid<double, 3>> known;
  if (!vector.is_none()) {
    known = vector_bound_of(vector);
  }
  if (ellipsoid && !ellipsoid->is_gibbs) {
    value_error("a stored set must be in the chart 'gibbs'");
  }
  if (contradictions < 0) {
    value_error("contradictions must not be negative, but is " + std::to_string(contradictions));
  }
  const auto go = [&](auto& filter) {
    using Set = typename std::decay_t<decltype(filter)>::Set;
    using State = typename std::decay_t<decltype(filter)>::State;
    const std::optional<Set> set = ellipsoid ? std::optional<Set>(ellipsoid->as<State, GibbsChart>()) : std::nullopt;
    return filter.resume(
        set ? &*set : nullptr, known ? &*known : nullptr,
        Trust(rests_on_drops, agreeing_updates, disputed_updates, static_cast<unsigned>(contradictions)));
  };
  constraints_.reset();
  raise_unless_ok(std::visit(go, filter_), "ellipsoid, vector, agreeing_updates, disputed_updates");
}

void PythonGuaranteedFilter::forget() {
  const std::unique_lock lock = exclusive(*mutex_);
  constraints_.reset();
  std::visit([](auto& filter) { filter.forget(); }, filter_);
}

// --- what it does ------------------------------------------------------------------------------------------------------

void PythonGuaranteedFilter::require_inputs_of_flow(const py::object& control_torque, const py::object& wheel_momentum,
                                                    const py::object& gyro, const py::object& increment) const {
  if (has_gyro()) {
    if (!control_torque.is_none() || !wheel_momentum.is_none()) {
      throw py::type_error(std::string(control_torque.is_none() ? "wheel_momentum" : "control_torque") +
                           " is an input of GuaranteedRigidBodyFlow; a GuaranteedGyroFlow knows no torque");
    }
    if (gyro.is_none()) {
      throw py::type_error("a GuaranteedGyroFlow needs gyro, the measured rate over the interval");
    }
    return;
  }
  if (!gyro.is_none() || !increment.is_none()) {
    throw py::type_error(std::string(gyro.is_none() ? "increment" : "gyro") +
                         " is the input of a GuaranteedGyroFlow; for a GuaranteedRigidBodyFlow a measured rate is an "
                         "angular_velocity");
  }
}

void PythonGuaranteedFilter::require_bounds(const py::object& directions, const py::object& reference,
                                            const py::object& bounds, const py::object& angular_velocity,
                                            const py::object& rate_bound, const py::object& attitude,
                                            const py::object& attitude_bound) const {
  if (!directions.is_none() && (reference.is_none() || bounds.is_none())) {
    value_error("directions need reference and bounds beside them");
  }
  if (!angular_velocity.is_none()) {
    if (has_gyro()) {
      throw py::type_error(
          "angular_velocity cannot update a GuaranteedGyroFlow: the gyro's rate is the input of the prediction");
    }
    if (rate_bound.is_none()) {
      value_error("angular_velocity needs rate_bound beside it");
    }
  }
  if (!attitude.is_none() && attitude_bound.is_none()) {
    value_error("attitude needs attitude_bound beside it");
  }
}

void PythonGuaranteedFilter::predict(const py::object& time, const py::object& control_torque,
                                     const py::object& wheel_momentum, const py::object& gyro,
                                     const py::object& increment) {
  const std::unique_lock lock = exclusive(*mutex_);
  const double end = single(time, "time", {}).number(0);
  require_inputs_of_flow(control_torque, wheel_momentum, gyro, increment);
  Inputs inputs;
  const auto read = [](const py::object& value, const char* name, Vector3<double>& vector) {
    if (!value.is_none()) {
      vector = single(value, name, {3}).vector<3>(0);
    }
  };
  read(control_torque, "control_torque", inputs.control_torque);
  read(wheel_momentum, "wheel_momentum", inputs.wheel_momentum);
  if (!gyro.is_none()) {
    inputs.set_gyro(Items(gyro, "gyro", {3}, Items::Require::anything, Items::Batch::none).vector<3>(0), "gyro");
  }
  if (!increment.is_none()) {
    inputs.increment = single(increment, "increment", {}).number(0);
    if (!(inputs.increment >= 0)) {
      value_error("increment must not be negative, but is " + text(inputs.increment) + " rad");
    }
  }
  constraints_.reset();
  const py::gil_scoped_release release;
  std::visit([&](auto& filter) { predict_to(filter, end, inputs); }, filter_);
}

void PythonGuaranteedFilter::predict_turn(const py::object& time, const py::object& turn,
                                          const py::object& turn_bound) {
  const std::unique_lock lock = exclusive(*mutex_);
  const double end = single(time, "time", {}).number(0);
  const Vector3<double> rotation_vector = single(turn, "turn", {3}).vector<3>(0);
  const double angle = Items(turn_bound, "turn_bound", {}, Items::Require::anything, Items::Batch::none).number(0);
  auto* filter = std::get_if<GyroFilter>(&filter_);
  if (filter == nullptr) {
    throw py::type_error("predict_turn is for a GuaranteedGyroFlow; a turn does not tell a rigid body's rate");
  }
  constraints_.reset();
  turn_to(*filter, end, rotation_vector, "turn", angle, "turn_bound");
}

py::object PythonGuaranteedFilter::update(const py::object& directions, const py::object& reference,
                                          const py::object& bounds, const py::object& angular_velocity,
                                          const py::object& rate_bound, const py::object& attitude,
                                          const py::object& attitude_bound, const py::object& sensors) {
  const std::unique_lock lock = exclusive(*mutex_);
  require_bounds(directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const Measured measured =
      measured_of(directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const auto m = static_cast<Index>(measured.directions.size());
  if (!measured.any() && !vector_bound_) {
    value_error("update needs directions, angular_velocity or attitude");
  }
  const SensorNames names(sensors, m, measured.angular_velocity.has_value(), measured.attitude.has_value());
  return std::visit(
      [&](auto& filter) {
        UpdateConstraints<typename std::decay_t<decltype(filter)>::State> constraints;
        const GuaranteedUpdate<double> update = fuse(filter, measured, names, &constraints);
        constraints_ = constraints;
        py::list dropped;
        measured.for_each(update.dropped, m, [&](Index column) { dropped.append(names.object_of(column)); });
        return updated(update, py::tuple(dropped));
      },
      filter_);
}

py::object PythonGuaranteedFilter::update_linear(const py::object& y, const py::object& h, const py::object& bound) {
  const std::unique_lock lock = exclusive(*mutex_);
  const LinearArguments given(y, h, bound);
  if (!knows_attitude()) {
    value_error("update_linear is of the error about a center, but the attitude is not known");
  }
  return std::visit(
      [&](auto& filter) {
        GuaranteedUpdate<double> update;
        const Status status = with_dimension(given.rows(), [&](auto dimension) {
          return filter.update(given.measurement<decltype(dimension)::value>(), update);
        });
        if (status == Status::empty_intersection) {
          raise_inconsistent("linear measurement", filter.time(), update.margin);
        }
        raise_unless_ok(status, "update_linear");
        constraints_.reset();
        return updated(update, py::tuple());
      },
      filter_);
}

py::object PythonGuaranteedFilter::bounds(const py::object& vertical) const {
  const std::unique_lock lock = exclusive(*mutex_);
  const Vector3<double> direction = vertical_of(vertical);
  if (!knows_attitude()) {
    return py::none();
  }
  AttitudeBounds<double> bounds{};
  const Status status = std::visit([&](const auto& filter) { return filter.bounds(direction, bounds); }, filter_);
  raise_unless_ok(status, "bounds");
  return py::module_::import("elliptude.results")
      .attr("AttitudeBounds")(bounds.tilt, bounds.heading_from, bounds.heading_to, bounds.angle);
}

}  // namespace elliptude::python
