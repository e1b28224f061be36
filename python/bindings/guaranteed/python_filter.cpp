#include "guaranteed/python_filter.hpp"

#include <utility>

#include "guaranteed/policies.hpp"
#include "guaranteed/rows.hpp"
#include "sets/ellipsoids.hpp"
#include "signals.hpp"

namespace elliptude::python {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
/// Measurements that an update may have where some of them may be wrong: it tries which.
constexpr Index most_with_wrong_ones = 8;

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
[[nodiscard]] std::string beyond_domain() { return text(FilterDomain<double>::largest()) + " rad/s"; }

[[noreturn]] void raise_backwards(double time, double present) {
  value_error("time must not go backwards, but is " + text(time) + " s after " + text(present) + " s");
}

[[noreturn]] void raise_turn_too_far(const std::string& what, double turn, const std::string& unit) {
  value_error(what + " a turn of " + text(turn) + " rad, of which nothing is left to be known; is its unit " + unit +
              "?");
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
    value_error("step of the flow is too long: the angular velocity is " +
                text(vector_part(filter.ellipsoid().center).norm()) + " rad/s at " + text(filter.time()) +
                " s, and the motion in a step must be given by a short series; take a shorter step");
  }
  raise(status, "predict");
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
  const Status status = filter.predict_turn(time, turn, angle);
  if (status == Status::out_of_range && time >= filter.time()) {
    raise_turn_too_far(turn_name + " is", turn.stableNorm(), "rad");
  }
  if (status == Status::out_of_range) {
    raise_backwards(time, filter.time());
  }
  raise_unless_ok(status, "predict_turn");
}

[[noreturn]] void raise_inconsistent(const std::string& sensor, double time, double margin) {
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
[[nodiscard]] Vector3<double> vertical_of(const py::object& value) {
  const Vector3<double> vertical = single(value, "vertical", {3}).vector<3>(0);
  if (!(vertical.cwiseAbs().maxCoeff() > 0)) {
    value_error("vertical must not be zero");
  }
  return vertical;
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
  if (vector_bound_) {
    const Status status = filter.bound_vector(*vector_bound_);
    if (status == Status::out_of_range) {
      value_error("vector_bound must have a center and half-widths of at most " + beyond_domain());
    }
    raise_unless_ok(status, "vector_bound");
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
                                    bool rests_on_drops, int agreeing_updates, int disputed_updates) {
  std::optional<Ellipsoid<double, 3>> known;
  if (!vector.is_none()) {
    known = vector_bound_of(vector);
  }
  if (ellipsoid && !ellipsoid->is_gibbs) {
    value_error("a stored set must be in the chart 'gibbs'");
  }
  const auto go = [&](auto& filter) {
    using Set = typename std::decay_t<decltype(filter)>::Set;
    using State = typename std::decay_t<decltype(filter)>::State;
    const std::optional<Set> set = ellipsoid ? std::optional<Set>(ellipsoid->as<State, GibbsChart>()) : std::nullopt;
    return filter.resume(set ? &*set : nullptr, known ? &*known : nullptr,
                         Trust(rests_on_drops, agreeing_updates, disputed_updates));
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

// --- a whole log -------------------------------------------------------------------------------------------------------

namespace {

/// The rows of a GuaranteedLog, as they come.
class LogRows {
 public:
  /// \param vertical none: no bounds of tilt and heading are asked for.
  LogRows(Index rows, Index directions, const std::optional<Vector3<double>>& vertical)
      : sensors_(directions + 2),
        vertical_(vertical),
        bounds_({vertical ? rows : 0}, {4}),
        attitudes_({rows}, {3, 3}),
        vectors_({rows}, {3}),
        shapes_({rows}, {6, 6}),
        margins_({rows}, {}),
        claims_(rows),
        prediction_used_(rows),
        updated_(rows),
        dropped_({rows, sensors_}),
        claim_data_(claims_.mutable_data()),
        used_data_(prediction_used_.mutable_data()),
        updated_data_(updated_.mutable_data()),
        dropped_data_(dropped_.mutable_data()) {}

  /// What a filter is after a row. Needs no interpreter's lock.
  template <typename Filter>
  void set(Index row, const Filter& filter, const Measured& measured, const GuaranteedUpdate<double>& update) {
    updated_data_[row] = measured.any();
    std::fill_n(dropped_data_ + row * sensors_, sensors_, false);
    measured.for_each(update.dropped, sensors_ - 2,
                      [&](Index column) { dropped_data_[row * sensors_ + column] = true; });
    used_data_[row] = measured.any() ? update.prediction_used : filter.knows_attitude();
    margins_.set(row, update.margin);
    claim_data_[row] = static_cast<std::uint8_t>(filter.claim());
    if (filter.knows_attitude()) {
      const auto& set = filter.ellipsoid();
      attitudes_.set(row, set.center.attitude);
      vectors_.set(row, vector_part(set.center));
      shapes_.set(row, set.shape);
    } else {
      attitudes_.set(row, Matrix3<double>(Matrix3<double>::Constant(nan)));
      vectors_.set(row, Vector3<double>(Vector3<double>::Constant(nan)));
      shapes_.set(row, Matrix6<double>(Matrix6<double>::Constant(nan)));
    }
    if (vertical_) {
      AttitudeBounds<double> found{nan, nan, nan, nan};
      if (filter.knows_attitude()) {
        raise_unless_ok(filter.bounds(*vertical_, found), "bounds");
      }
      bounds_.set(row, Vector<double, 4>(found.tilt, found.heading_from, found.heading_to, found.angle));
    }
  }

  [[nodiscard]] py::object log(const Items& time) {
    return py::module_::import("elliptude.results")
        .attr("GuaranteedLog")(to_array(time.dynamic_vector()), attitudes_.array(), vectors_.array(), shapes_.array(),
                               claims_, prediction_used_, updated_, dropped_, margins_.array(),
                               vertical_ ? py::object(bounds_.array()) : py::object(py::none()));
  }

 private:
  Index sensors_;
  std::optional<Vector3<double>> vertical_;
  Results bounds_;
  Results attitudes_;
  Results vectors_;
  Results shapes_;
  Results margins_;
  py::array_t<std::uint8_t> claims_;
  py::array_t<bool> prediction_used_;
  py::array_t<bool> updated_;
  py::array_t<bool> dropped_;
  std::uint8_t* claim_data_;
  bool* used_data_;
  bool* updated_data_;
  bool* dropped_data_;
};

/// Predicts to each row of a log by `predict`, and fuses what it holds, without the interpreter's lock.
/// \param row that the loop is at, for whoever catches an exception.
template <typename Filter, typename Predict>
void run_rows(Filter& filter, const MeasuredLog& log, const SensorNames& names, Index rows, const Predict& predict,
              LogRows& out, Index& row) {
  const py::gil_scoped_release release;
  Measured measured;
  for (Index i = 0; i < rows; ++i) {
    row = i;
    if (i % 256 == 255) {
      const py::gil_scoped_acquire acquire;
      if (PyErr_CheckSignals() != 0) {
        throw py::error_already_set();
      }
    }
    predict(i);
    log.read(i, measured);
    GuaranteedUpdate<double> update;
    update.margin = nan;
    if (measured.any()) {
      update = fuse(filter, measured, names);
    }
    out.set(i, filter, measured, update);
  }
}

template <typename Filter>
void require_forward(const Items& time, Index row, const Filter& filter) {
  if (!(time[0][row] >= filter.time())) {
    value_error("times must not go backwards, but times[" + std::to_string(row) + "] is " + text(time[0][row]) +
                " s after " + text(filter.time()) + " s");
  }
}

}  // namespace

template <typename Loop>
py::object PythonGuaranteedFilter::run_log(const Items& time, Index directions, const py::object& vertical,
                                           const Loop& loop) {
  LogRows out(time.item()[0], directions,
              vertical.is_none() ? std::nullopt : std::optional<Vector3<double>>(vertical_of(vertical)));
  constraints_.reset();
  run_on_copy(filter_, [&](AnyFilter& working, Index& row) { loop(working, out, row); });
  return out.log(time);
}

py::object PythonGuaranteedFilter::run(const py::object& times, const py::object& directions,
                                       const py::object& reference, const py::object& bounds,
                                       const py::object& angular_velocity, const py::object& rate_bound,
                                       const py::object& attitude, const py::object& attitude_bound,
                                       const py::object& gyro, const py::object& increment,
                                       const py::object& control_torque, const py::object& wheel_momentum,
                                       const py::object& sensors, const py::object& vertical) {
  const std::unique_lock lock = exclusive(*mutex_);
  const Items time = single(times, "times", {any_length});
  const Index rows = time.item()[0];
  require_inputs_of_flow(control_torque, wheel_momentum, gyro, increment);
  require_bounds(directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const MeasuredLog log(rows, directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const Index m = log.directions();
  const SensorNames names(sensors, m, !angular_velocity.is_none(), !attitude.is_none());
  const std::optional<LogInput> torques = log_input(control_torque, "control_torque", {3}, rows);
  const std::optional<LogInput> wheels = log_input(wheel_momentum, "wheel_momentum", {3}, rows);
  const std::optional<LogInput> increments = log_input(increment, "increment", {}, rows, Items::Require::anything);
  std::optional<Items> rates;
  if (has_gyro()) {
    rates.emplace(gyro, "gyro", Shape{rows, 3}, Items::Require::anything, Items::Batch::none);
    if (time[0][0] != this->time()) {
      value_error("times[0] must be the filter's time, " + text(this->time()) +
                  " s, for a GuaranteedGyroFlow: gyro[k] is the rate from times[k] on; it is " + text(time[0][0]) +
                  " s");
    }
  }

  const auto loop = [&](AnyFilter& any, LogRows& out, Index& row) {
    std::visit(
        [&](auto& filter) {
          const auto predict = [&](Index i) {
            Inputs inputs;
            const Index before = std::max<Index>(i - 1, 0);  // a gyro's row is of the interval that it begins
            if (rates) {
              inputs.set_gyro(Eigen::Map<const Vector3<double>>((*rates)[0] + 3 * before),
                              "gyro[" + std::to_string(before) + "]");
            }
            if (increments && !(*increments->row(before) != *increments->row(before))) {
              inputs.increment = *increments->row(before);
              if (!(inputs.increment >= 0) || !scalar::isfinite(inputs.increment)) {
                value_error("increment[" + std::to_string(before) + "] must not be negative, but is " +
                            text(inputs.increment) + " rad; NaN where none is known");
              }
            }
            if (torques) {
              inputs.control_torque = Eigen::Map<const Vector3<double>>(torques->row(i));
            }
            if (wheels) {
              inputs.wheel_momentum = Eigen::Map<const Vector3<double>>(wheels->row(i));
            }
            require_forward(time, i, filter);
            predict_to(filter, time[0][i], inputs);
          };
          run_rows(filter, log, names, rows, predict, out, row);
        },
        any);
  };
  return run_log(time, m, vertical, loop);
}

py::object PythonGuaranteedFilter::run_turns(const py::object& times, const py::object& turns,
                                             const py::object& turn_bounds, const py::object& anchors,
                                             const py::object& directions, const py::object& reference,
                                             const py::object& bounds, const py::object& attitude,
                                             const py::object& attitude_bound, const py::object& sensors,
                                             const py::object& vertical) {
  const std::unique_lock lock = exclusive(*mutex_);
  if (!has_gyro()) {
    throw py::type_error("run_turns is for a GuaranteedGyroFlow; a turn does not tell a rigid body's rate");
  }
  const Items time = single(times, "times", {any_length});
  const Index rows = time.item()[0];
  require_bounds(directions, reference, bounds, py::none(), py::none(), attitude, attitude_bound);
  const MeasuredLog log(rows, directions, reference, bounds, py::none(), py::none(), attitude, attitude_bound);
  const SensorNames names(sensors, log.directions(), false, !attitude.is_none());
  const Items turn = single(turns, "turns", {rows, 3});
  const Items angle(turn_bounds, "turn_bounds", {rows}, Items::Require::anything, Items::Batch::none);
  const Anchors from(anchors, rows);
  const auto loop = [&](AnyFilter& any, LogRows& out, Index& row) {
    auto& filter = std::get<GyroFilter>(any);
    GyroFilter anchor = filter;
    const auto predict = [&](Index i) {
      require_forward(time, i, filter);  // from the row before, which need not be the anchor
      if (from.begins_at_row_before(i)) {
        anchor = filter;
      } else {
        filter = anchor;
      }
      const std::string place = "[" + std::to_string(i) + "]";
      turn_to(filter, time[0][i], Eigen::Map<const Vector3<double>>(turn[0] + 3 * i), "turns" + place, angle[0][i],
              "turn_bounds" + place);
    };
    run_rows(filter, log, names, rows, predict, out, row);
  };
  return run_log(time, log.directions(), vertical, loop);
}

}  // namespace elliptude::python
