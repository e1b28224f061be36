#include "first_order/python_filter.hpp"

#include <elliptude/first_order/convergence.hpp>
#include <utility>

#include "measurement/arguments.hpp"
#include "signals.hpp"

namespace elliptude::python {

namespace {

template <typename Filter>
inline constexpr bool has_rate = std::is_same_v<typename Filter::State, BodyState>;

/// What happened at a row of a log.
enum class Outcome : std::uint8_t { updated, predicted, refused };

template <typename Filter>
void predict_to(Filter& filter, double time, const Vector3<double>& input, Failure& failure) {
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

/// None if the directions determine no attitude: the theorem does not speak of them.
template <typename Filter>
[[nodiscard]] std::optional<Convergence<double>> diagnosed(const Filter& before,
                                                           const std::vector<Direction<double>>& directions,
                                                           const AngularVelocity<double>& rate, const Filter& after,
                                                           const Update<double>& update) {
  if constexpr (has_rate<Filter>) {
    Convergence<double> result;
    const Status status = convergence(before, directions.data(), directions.size(), rate, after, update.share, result);
    if (status != Status::attitude_undetermined) {
      raise_unless_ok(status, "update");
      return result;
    }
  }
  return std::nullopt;
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

[[nodiscard]] py::object updated(const Update<double>& update,
                                 const std::optional<Convergence<double>>& c = std::nullopt) {
  const py::module_ results = py::module_::import("elliptude.results");
  const py::object convergence = !c ? py::object(py::none())
                                    : results.attr("Convergence")(c->flow_norm, c->smallest_ratio, c->chi,
                                                                  c->contraction, c->trace_ratio, c->smaller_than_sets);
  return results.attr("Update")(update.share, update.margin, convergence);
}

}  // namespace

PythonFilter::PythonFilter(py::object flow, const AnyStateEllipsoid& ellipsoid, const py::object& time,
                           std::string mode, std::string criterion, const py::object& weight)
    : flow_(std::move(flow)), mode_(std::move(mode)), criterion_(std::move(criterion)) {
  const double start = single(time, "time", {}).number(0);
  const SizeCriterion<double, 6> size = size_criterion_of(criterion_, weight);
  if (ellipsoid.is_gibbs) {
    value_error("ellipsoid must be in the chart 'exponential': see StateEllipsoid.converted");
  }
  if (mode_ != "paper" && mode_ != "first_order") {
    value_error("mode must be 'paper' or 'first_order', not '" + mode_ + "'");
  }
  if (py::isinstance<BodyFlowSettings>(flow_)) {
    const auto& settings = flow_.cast<const BodyFlowSettings&>();
    BodyFlow core;
    raise_unless_ok(BodyFlow::make(settings.body, HeldPotential{&*settings.potential, failure_.get()}, settings.step,
                                   settings.order, settings.unknown_torque, core),
                    "flow");
    raise_unless_ok(core.set_most_steps(settings.most_steps), "most_steps");
    core.set_interruption(interruption_by_signals());
    make(core, size, start, ellipsoid);
  } else if (py::isinstance<GyroFlowSettings>(flow_)) {
    const auto& settings = flow_.cast<const GyroFlowSettings&>();
    GyroFlow<double> core;
    raise_unless_ok(GyroFlow<double>::make(settings.noise, settings.drift, core), "flow");
    make(core, size, start, ellipsoid);
  } else {
    throw py::type_error(std::string("flow must be a RigidBodyFlow or a GyroFlow, not ") +
                         Py_TYPE(flow_.ptr())->tp_name);
  }
}

py::object PythonFilter::weight() const {
  if (criterion_ != "weighted_trace") {
    return py::none();
  }
  return std::visit([](const auto& filter) { return py::object(to_array(filter.criterion().weight)); }, filter_);
}

template <typename Flow>
void PythonFilter::make(const Flow& flow, const SizeCriterion<double, 6>& criterion, double time,
                        const AnyStateEllipsoid& ellipsoid) {
  const auto start = ellipsoid.as<typename Flow::State>();
  if (mode_ == "paper") {
    AttitudeFilter<Flow, PaperEstimator> filter;
    raise_unless_ok(filter.make(flow, criterion, time, start, filter), "ellipsoid");
    filter_ = filter;
  } else {
    AttitudeFilter<Flow, FirstOrderEstimator> filter;
    raise_unless_ok(filter.make(flow, criterion, time, start, filter), "ellipsoid");
    filter_ = filter;
  }
}

std::unique_lock<std::mutex> PythonFilter::begin_call() {
  std::unique_lock lock = exclusive(*mutex_);
  *failure_ = Failure();
  return lock;
}

Vector3<double> PythonFilter::input_of(const py::object& control_torque, const py::object& gyro) const {
  if (has_gyro()) {
    if (!control_torque.is_none()) {
      throw py::type_error("control_torque is an input of RigidBodyFlow; a GyroFlow knows no torque");
    }
    if (gyro.is_none()) {
      throw py::type_error("a GyroFlow needs gyro, the measured rate over the interval");
    }
    return single(gyro, "gyro", {3}).vector<3>(0);
  }
  if (!gyro.is_none()) {
    throw py::type_error(
        "gyro is the input of a GyroFlow; for a RigidBodyFlow a measured rate goes to update as angular_velocity");
  }
  return control_torque.is_none() ? Vector3<double>(Vector3<double>::Zero())
                                  : single(control_torque, "control_torque", {3}).vector<3>(0);
}

void PythonFilter::resume(const py::object& transition, const py::object& prior_shape) {
  const Matrix6<double> a = single_matrix6(transition, "transition");
  const Matrix6<double> p = single_matrix6(prior_shape, "prior_shape");
  raise_unless_ok(std::visit([&](auto& filter) { return filter.resume(a, p); }, filter_), "prior_shape");
}

void PythonFilter::predict(const py::object& time, const py::object& control_torque, const py::object& gyro) {
  const std::unique_lock lock = begin_call();
  const double end = single(time, "time", {}).number(0);
  const Vector3<double> input = input_of(control_torque, gyro);
  std::visit([&](auto& filter) { predict_to(filter, end, input, *failure_); }, filter_);
}

py::object PythonFilter::update(const py::object& directions, const py::object& reference, const py::object& bounds,
                                const py::object& weights, const py::object& angular_velocity,
                                const py::object& rate_bound, const std::string& sensor, bool diagnostics) {
  const std::unique_lock lock = begin_call();
  std::vector<Direction<double>> given;
  if (!directions.is_none()) {
    const Items body(directions, "directions", {3});
    if (body.leading().size() != 1) {
      value_error("directions must have the shape (m, 3), one row for each direction");
    }
    const Index m = body.leading()[0];
    if (reference.is_none() || bounds.is_none()) {
      value_error("directions need reference and bounds beside them");
    }
    const Items references = single(reference, "reference", {m, 3});
    const DirectionArguments arguments(bounds, weights, m);
    for (Index i = 0; i < m; ++i) {
      given.push_back(arguments.direction(i, references[0] + 3 * i, body[i]));
      require_direction(given.back().body, "directions[" + std::to_string(i) + "]");
      require_direction(given.back().reference, "reference[" + std::to_string(i) + "]");
    }
  }
  std::optional<AngularVelocity<double>> rate;
  if (!angular_velocity.is_none()) {
    if (rate_bound.is_none()) {
      value_error("angular_velocity needs rate_bound beside it");
    }
    rate = AngularVelocity<double>{single(angular_velocity, "angular_velocity", {3}).vector<3>(0),
                                   one_bound(rate_bound, "rate_bound", false)};
  }
  if (given.empty() && !rate) {
    value_error("update needs directions, angular_velocity or both");
  }
  return std::visit(
      [&](auto& filter) {
        Update<double> update{};
        auto after = filter;
        raise_unless_updated(filter, fuse(after, given, rate, update), update, sensor);
        const auto convergence = diagnostics && rate ? diagnosed(filter, given, *rate, after, update) : std::nullopt;
        filter = after;
        return updated(update, convergence);
      },
      filter_);
}

py::object PythonFilter::update_attitude(const py::object& attitude, const py::object& bound,
                                         const std::string& sensor) {
  const std::unique_lock lock = begin_call();
  const MeasuredAttitude<double> measured{single_attitude(attitude, "attitude"), one_bound(bound, "bound", false)};
  return std::visit(
      [&](auto& filter) {
        Update<double> update{};
        raise_unless_updated(filter, filter.update(measured, update), update, sensor);
        return updated(update);
      },
      filter_);
}

py::object PythonFilter::update_linear(const py::object& y, const py::object& h, const py::object& bound,
                                       const std::string& sensor) {
  const std::unique_lock lock = begin_call();
  const LinearArguments given(y, h, bound);
  return std::visit(
      [&](auto& filter) {
        Update<double> update{};
        const Status status = with_dimension(given.rows(), [&](auto dimension) {
          return filter.update(given.measurement<decltype(dimension)::value>(), update);
        });
        raise_unless_updated(filter, status, update, sensor);
        return updated(update);
      },
      filter_);
}

AnyEllipsoid PythonFilter::angular_velocity_estimate(const py::object& gyro) const {
  const Vector3<double> rate = single(gyro, "gyro", {3}).vector<3>(0);
  return std::visit(
      [&](const auto& filter) -> AnyEllipsoid {
        using Filter = std::decay_t<decltype(filter)>;
        if constexpr (has_rate<Filter>) {
          throw py::type_error(
              "angular_velocity_estimate is for a GyroFlow; here the angular velocity is in the state");
        } else {
          Ellipsoid<double, 3> result;
          raise_unless_ok(filter.flow().angular_velocity(filter.ellipsoid(), {rate}, result), "gyro");
          return {result.center, result.shape};
        }
      },
      filter_);
}

py::object PythonFilter::run(const py::object& times, const py::object& directions, const py::object& reference,
                             const py::object& bounds, const py::object& weights, const py::object& angular_velocity,
                             const py::object& rate_bound, const py::object& gyro, const py::object& control_torque,
                             const std::string& on_inconsistent) {
  const std::unique_lock lock = begin_call();
  const Items time = single(times, "times", {any_length});
  const Index rows = time.item()[0];
  if (on_inconsistent != "raise" && on_inconsistent != "skip") {
    value_error("on_inconsistent must be 'raise' or 'skip', not '" + on_inconsistent + "'");
  }

  // Directions: NaN where a sensor has nothing to say.
  Index m = 0;
  std::optional<Items> body;
  std::optional<LogInput> references;
  std::optional<DirectionArguments> arguments;
  if (!directions.is_none()) {
    body.emplace(directions, "directions", Shape{rows, any_length, 3}, Items::Require::anything, Items::Batch::none);
    m = body->item()[1];
    if (reference.is_none() || bounds.is_none()) {
      value_error("directions need reference and bounds beside them");
    }
    references.emplace(reference, "reference", Shape{m, 3}, rows);
    arguments.emplace(bounds, weights, m);
  }
  const OptionalRows measured_rate(angular_velocity, "angular_velocity", rows);
  Matrix3<double> bound_of_rate = Matrix3<double>::Zero();
  if (measured_rate.given()) {
    if (has_gyro()) {
      throw py::type_error("angular_velocity cannot update a GyroFlow: the gyro's rates go in as gyro");
    }
    if (rate_bound.is_none()) {
      value_error("angular_velocity needs rate_bound beside it");
    }
    bound_of_rate = one_bound(rate_bound, "rate_bound", false);
  }

  // The input over the interval that ends at row i: torque i, or the gyro's rate of the row before.
  std::optional<Items> rates;
  std::optional<LogInput> torques;
  if (has_gyro()) {
    if (!control_torque.is_none()) {
      throw py::type_error("control_torque is an input of RigidBodyFlow; a GyroFlow knows no torque");
    }
    if (gyro.is_none()) {
      throw py::type_error("a GyroFlow needs gyro, the measured rates");
    }
    rates.emplace(single(gyro, "gyro", {rows, 3}));
    if (time[0][0] != this->time()) {
      value_error("times[0] must be the filter's time, " + text(this->time()) +
                  " s, for a GyroFlow: gyro[k] is the rate from times[k] on; it is " + text(time[0][0]) + " s");
    }
  } else {
    if (!gyro.is_none()) {
      throw py::type_error("gyro is the input of a GyroFlow; for a RigidBodyFlow give the rates as angular_velocity");
    }
    torques = log_input(control_torque, "control_torque", {3}, rows);
  }

  Results attitudes_out({rows}, {3, 3});
  Results vectors_out({rows}, {3});
  Results shapes_out({rows}, {6, 6});
  Results shares_out({rows}, {});
  Results margins_out({rows}, {});
  py::array_t<bool> used({rows, m + 1});
  py::array_t<std::uint8_t> outcomes(rows);
  bool* used_data = used.mutable_data();
  std::uint8_t* outcome_data = outcomes.mutable_data();

  AnyFilter working = filter_;
  Index row = 0;  // that the loop is at
  const auto go = [&](auto& filter) {
    const py::gil_scoped_release release;
    std::vector<Direction<double>> present;
    present.reserve(static_cast<std::size_t>(m));
    for (Index i = 0; i < rows; ++i) {
      if (i % 256 == 255) {
        const py::gil_scoped_acquire acquire;
        if (PyErr_CheckSignals() != 0) {
          throw py::error_already_set();
        }
      }
      row = i;
      Vector3<double> input = Vector3<double>::Zero();
      if (rates) {
        input = Eigen::Map<const Vector3<double>>((*rates)[0] + 3 * std::max<Index>(i - 1, 0));
      } else if (torques) {
        input = Eigen::Map<const Vector3<double>>(torques->row(i));
      }
      if (!(time[0][i] >= filter.time())) {
        value_error("times must not go backwards, but times[" + std::to_string(i) + "] is " + text(time[0][i]) +
                    " s after " + text(filter.time()) + " s");
      }
      predict_to(filter, time[0][i], input, *failure_);

      present.clear();
      for (Index j = 0; j < m; ++j) {
        const double* b = (*body)[0] + 3 * (i * m + j);
        const double* e = references->row(i) + 3 * j;
        const bool there = !is_absent(Eigen::Map<const Vector3<double>>(b));
        used_data[i * (m + 1) + j] = there;
        if (there) {
          present.push_back(arguments->direction(j, e, b));
          require_measured(present.back().body, "directions[" + std::to_string(i) + ", " + std::to_string(j) + "]");
        }
      }
      std::optional<AngularVelocity<double>> rate;
      if (measured_rate.given()) {
        if (const auto value = measured_rate.row(i)) {
          require_measured(*value, "angular_velocity[" + std::to_string(i) + "]");
          rate = AngularVelocity<double>{*value, bound_of_rate};
        }
      }
      used_data[i * (m + 1) + m] = rate.has_value();

      Update<double> update{1.0, 1.0};
      Outcome outcome = Outcome::predicted;
      if (!present.empty() || rate) {
        const Status status = fuse(filter, present, rate, update);
        if (status == Status::empty_intersection && on_inconsistent == "skip") {
          outcome = Outcome::refused;
          std::fill_n(used_data + i * (m + 1), m + 1, false);
        } else {
          raise_unless_updated(filter, status, update, "");
          outcome = Outcome::updated;
        }
      }
      const auto& ellipsoid = filter.ellipsoid();
      attitudes_out.set(i, ellipsoid.center.attitude);
      vectors_out.set(i, vector_part(ellipsoid.center));
      shapes_out.set(i, ellipsoid.shape);
      shares_out.set(i, update.share);
      margins_out.set(i, outcome == Outcome::predicted ? std::numeric_limits<double>::quiet_NaN() : update.margin);
      outcome_data[i] = static_cast<std::uint8_t>(outcome);
    }
  };
  try {
    std::visit(go, working);
  } catch (InconsistentSets& error) {
    error.set_row(row);
    throw;
  } catch (const py::value_error& error) {
    throw RowFault(error.what(), row);
  }
  filter_ = working;
  return py::module_::import("elliptude.results")
      .attr("FilterLog")(to_array(time.dynamic_vector()), attitudes_out.array(), vectors_out.array(),
                         shapes_out.array(), shares_out.array(), margins_out.array(), used, outcomes);
}

}  // namespace elliptude::python
