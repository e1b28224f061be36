#include "first_order/python_filter.hpp"

#include <elliptude/first_order/convergence.hpp>
#include <utility>

#include "first_order/filter_calls.hpp"
#include "measurement/arguments.hpp"

namespace elliptude::python {

namespace {

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

}  // namespace elliptude::python
