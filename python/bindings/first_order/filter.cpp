#include <pybind11/stl.h>

#include <elliptude/first_order/convergence.hpp>
#include <utility>
#include <variant>

#include "attitude/state_ellipsoid.hpp"
#include "first_order/flow.hpp"
#include "measurement/arguments.hpp"
#include "module.hpp"
#include "sets/ellipsoids.hpp"
#include "signals.hpp"

namespace elliptude::python {

namespace {

template <typename Estimator>
using BodyFilter = AttitudeFilter<BodyFlow, Estimator>;
template <typename Estimator>
using GyroFilter = AttitudeFilter<GyroFlow<double>, Estimator>;
using AnyFilter = std::variant<BodyFilter<PaperEstimator>, BodyFilter<FirstOrderEstimator>, GyroFilter<PaperEstimator>,
                               GyroFilter<FirstOrderEstimator>>;

template <typename Filter>
inline constexpr bool has_rate = std::is_same_v<typename Filter::State, BodyState>;

/// What happened at a row of a log.
enum class Outcome : std::uint8_t { updated, predicted, refused };

class PythonFilter {
 public:
  PythonFilter(py::object flow, const AnyStateEllipsoid& ellipsoid, const py::object& time, std::string mode,
               std::string criterion, const py::object& weight)
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
      make<BodyFilter<PaperEstimator>, BodyFilter<FirstOrderEstimator>>(core, size, start, ellipsoid);
    } else if (py::isinstance<GyroFlowSettings>(flow_)) {
      const auto& settings = flow_.cast<const GyroFlowSettings&>();
      GyroFlow<double> core;
      raise_unless_ok(GyroFlow<double>::make(settings.noise, settings.drift, core), "flow");
      make<GyroFilter<PaperEstimator>, GyroFilter<FirstOrderEstimator>>(core, size, start, ellipsoid);
    } else {
      throw py::type_error(std::string("flow must be a RigidBodyFlow or a GyroFlow, not ") +
                           Py_TYPE(flow_.ptr())->tp_name);
    }
  }

  [[nodiscard]] const py::object& flow() const noexcept { return flow_; }
  [[nodiscard]] const std::string& mode() const noexcept { return mode_; }
  [[nodiscard]] const std::string& criterion() const noexcept { return criterion_; }
  [[nodiscard]] bool has_gyro() const noexcept { return filter_.index() >= 2; }

  [[nodiscard]] py::object weight() const {
    if (criterion_ != "weighted_trace") {
      return py::none();
    }
    return std::visit([](const auto& filter) { return py::object(to_array(filter.criterion().weight)); }, filter_);
  }
  [[nodiscard]] double time() const {
    return std::visit([](const auto& filter) { return filter.time(); }, filter_);
  }
  [[nodiscard]] AnyStateEllipsoid ellipsoid() const {
    return std::visit([](const auto& filter) { return AnyStateEllipsoid::from(filter.ellipsoid()); }, filter_);
  }
  [[nodiscard]] Matrix6<double> transition() const {
    return std::visit([](const auto& filter) { return filter.transition(); }, filter_);
  }
  [[nodiscard]] Matrix6<double> prior_shape() const {
    return std::visit([](const auto& filter) { return filter.prior_shape(); }, filter_);
  }

  void resume(const py::object& transition, const py::object& prior_shape) {
    const Matrix6<double> a = single_matrix6(transition, "transition");
    const Matrix6<double> p = single_matrix6(prior_shape, "prior_shape");
    raise_unless_ok(std::visit([&](auto& filter) { return filter.resume(a, p); }, filter_), "prior_shape");
  }

  void predict(const py::object& time, const py::object& control_torque, const py::object& gyro) {
    const std::unique_lock lock = begin_call();
    const double end = single(time, "time", {}).number(0);
    const Vector3<double> input = input_of(control_torque, gyro);
    std::visit([&](auto& filter) { predict_to(filter, end, input); }, filter_);
  }

  [[nodiscard]] py::object update(const py::object& directions, const py::object& reference, const py::object& bounds,
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

  [[nodiscard]] py::object update_attitude(const py::object& attitude, const py::object& bound,
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

  [[nodiscard]] py::object update_linear(const py::object& y, const py::object& h, const py::object& bound,
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

  [[nodiscard]] AnyEllipsoid angular_velocity_estimate(const py::object& gyro) const {
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

  [[nodiscard]] py::object run(const py::object& times, const py::object& directions, const py::object& reference,
                               const py::object& bounds, const py::object& weights, const py::object& angular_velocity,
                               const py::object& rate_bound, const py::object& gyro, const py::object& control_torque,
                               const std::string& on_inconsistent);

  [[nodiscard]] int traverse(visitproc visit, void* arg) const noexcept {
    Py_VISIT(flow_.ptr());
    return 0;
  }

 private:
  template <typename Paper, typename FirstOrder>
  void make(const typename Paper::Flow& flow, const SizeCriterion<double, 6>& criterion, double time,
            const AnyStateEllipsoid& ellipsoid) {
    const auto start = ellipsoid.as<typename Paper::State>();
    if (mode_ == "paper") {
      Paper filter;
      raise_unless_ok(Paper::make(flow, criterion, time, start, filter), "ellipsoid");
      filter_ = filter;
    } else {
      FirstOrder filter;
      raise_unless_ok(FirstOrder::make(flow, criterion, time, start, filter), "ellipsoid");
      filter_ = filter;
    }
  }

  [[nodiscard]] std::unique_lock<std::mutex> begin_call() {
    std::unique_lock lock = exclusive(*mutex_);
    *failure_ = Failure();
    return lock;
  }

  [[nodiscard]] Vector3<double> input_of(const py::object& control_torque, const py::object& gyro) const {
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

  template <typename Filter>
  void predict_to(Filter& filter, double time, const Vector3<double>& input) const {
    const Status status = filter.predict(time, typename Filter::Input{input});
    failure_->rethrow();
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
  [[nodiscard]] static Status fuse(Filter& filter, const std::vector<Direction<double>>& directions,
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
  [[nodiscard]] static std::optional<Convergence<double>> diagnosed(const Filter& before,
                                                                    const std::vector<Direction<double>>& directions,
                                                                    const AngularVelocity<double>& rate,
                                                                    const Filter& after, const Update<double>& update) {
    if constexpr (has_rate<Filter>) {
      Convergence<double> result;
      const Status status =
          convergence(before, directions.data(), directions.size(), rate, after, update.share, result);
      if (status != Status::attitude_undetermined) {
        raise_unless_ok(status, "update");
        return result;
      }
    }
    return std::nullopt;
  }

  template <typename Filter>
  static void raise_unless_updated(const Filter& filter, Status status, const Update<double>& update,
                                   const std::string& sensor) {
    if (status == Status::empty_intersection) {
      throw InconsistentSets("measurement" + (sensor.empty() ? "" : " of " + sensor) + " at " + text(filter.time()) +
                                 " s contradicts the prediction: the sets do not meet (margin " + text(update.margin) +
                                 "); some bound is wrong",
                             update.margin, filter.time(), sensor);
    }
    raise_unless_ok(status, "update");
  }

  [[nodiscard]] static py::object updated(const Update<double>& update,
                                          const std::optional<Convergence<double>>& c = std::nullopt) {
    const py::module_ results = py::module_::import("elliptude.results");
    const py::object convergence =
        !c ? py::object(py::none())
           : results.attr("Convergence")(c->flow_norm, c->smallest_ratio, c->chi, c->contraction, c->trace_ratio,
                                         c->smaller_than_sets);
    return results.attr("Update")(update.share, update.margin, convergence);
  }

  py::object flow_;
  std::string mode_;
  std::string criterion_;
  std::unique_ptr<Failure> failure_ = std::make_unique<Failure>();
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
  AnyFilter filter_;
};

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
      predict_to(filter, time[0][i], input);

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

// --- measured ellipsoids ----------------------------------------------------------------------------------------------

[[nodiscard]] MeasuredDirections<double> measured_directions(const py::object& directions, const py::object& reference,
                                                             const py::object& bounds, const py::object& weights) {
  const Items body(directions, "directions", {3});
  if (body.leading().size() != 1) {
    value_error("directions must have the shape (m, 3), one row for each direction");
  }
  const Index m = body.leading()[0];
  const Items references = single(reference, "reference", {m, 3});
  const DirectionArguments arguments(bounds, weights, m);
  std::vector<Direction<double>> given;
  for (Index i = 0; i < m; ++i) {
    given.push_back(arguments.direction(i, references[0] + 3 * i, body[i]));
    require_direction(given.back().body, "directions[" + std::to_string(i) + "]");
    require_direction(given.back().reference, "reference[" + std::to_string(i) + "]");
  }
  MeasuredDirections<double> measured;
  raise_unless_ok(MeasuredDirections<double>::make(given.data(), given.size(), WahbaMethod::svd, measured),
                  "directions");
  return measured;
}

[[nodiscard]] py::tuple measured_attitude_of(const py::object& directions, const py::object& reference,
                                             const py::object& bounds, const py::object& weights) {
  MeasuredAttitude<double> attitude;
  raise_unless_ok(measured_directions(directions, reference, bounds, weights)
                      .measured_attitude(SizeCriterion<double, 3>::trace(), attitude),
                  "bounds");
  return py::make_tuple(to_array(attitude.attitude), to_array(attitude.bound));
}

[[nodiscard]] AnyStateEllipsoid measured_state_of(const py::object& directions, const py::object& reference,
                                                  const py::object& bounds, const py::object& angular_velocity,
                                                  const py::object& rate_bound, const py::object& weights) {
  const AngularVelocity<double> rate{single(angular_velocity, "angular_velocity", {3}).vector<3>(0),
                                     one_bound(rate_bound, "rate_bound", false)};
  StateEllipsoid<BodyState> result;
  raise_unless_ok(measured_state(measured_directions(directions, reference, bounds, weights), rate,
                                 SizeCriterion<double, 6>::trace(), result),
                  "bounds");
  return AnyStateEllipsoid::from(result);
}

}  // namespace

void define_filter(py::module_& module) {
  using namespace py::literals;

  py::class_<PythonFilter>(
      module, "AttitudeFilter", collectable<PythonFilter>(),
      R"(AttitudeFilter(flow, ellipsoid, *, time=0.0, mode='first_order', criterion='trace', weight=None)
--

Attitude and angular velocity (or gyro bias) with the ellipsoid that bounds them, from measurements with bounded errors.

A call that raises leaves the filter as it was; after a prediction, a refused measurement changes nothing. Both modes
are of first order: their sets are bounds only up to terms of second order in the error.

Parameters
----------
flow : RigidBodyFlow or GyroFlow
ellipsoid : StateEllipsoid
    Holds the state at `time`.
time : float
    s.
mode : {'first_order', 'paper'}
    How ellipsoids move to another center: 'paper' shifts them, as printed; 'first_order' uses the Jacobian of the exponential.
criterion : {'trace', 'weighted_trace', 'volume'}
    The size to minimise; the trace adds rad² to rad²/s² unless it is weighted.
weight : (6, 6) array_like, optional
    The weight of the trace, symmetric positive definite.
)")
      .def(py::init<py::object, const AnyStateEllipsoid&, const py::object&, std::string, std::string,
                    const py::object&>(),
           "flow"_a, "ellipsoid"_a, py::kw_only(), "time"_a = 0.0, "mode"_a = "first_order", "criterion"_a = "trace",
           "weight"_a = py::none())
      .def_property_readonly("flow", &PythonFilter::flow)
      .def_property_readonly("mode", &PythonFilter::mode)
      .def_property_readonly("criterion", &PythonFilter::criterion)
      .def_property_readonly("weight", &PythonFilter::weight)
      .def_property_readonly("time", &PythonFilter::time)
      .def_property_readonly("ellipsoid", &PythonFilter::ellipsoid)
      .def_property_readonly("attitude",
                             [](const PythonFilter& self) { return to_constant_array(self.ellipsoid().attitude); })
      .def_property_readonly("vector",
                             [](const PythonFilter& self) { return to_constant_array(self.ellipsoid().vector); })
      .def_property_readonly("shape",
                             [](const PythonFilter& self) { return to_constant_array(self.ellipsoid().shape); })
      .def_property_readonly(
          "transition", [](const PythonFilter& self) { return to_constant_array(self.transition()); },
          "A^f since the last update, (6, 6).")
      .def_property_readonly(
          "prior_shape", [](const PythonFilter& self) { return to_constant_array(self.prior_shape()); },
          "P₀, the shape after the last update, (6, 6).")
      .def("_resume", &PythonFilter::resume, "transition"_a, "prior_shape"_a)
      .def(
          "extent", [](const PythonFilter& self) { return extent_of(self.ellipsoid()); },
          R"(extent(self)
--

The same as `ellipsoid.extent()`.
)")
      .def("predict", &PythonFilter::predict, "time"_a, py::kw_only(), "control_torque"_a = py::none(),
           "gyro"_a = py::none(),
           R"(predict(self, time, *, control_torque=None, gyro=None)
--

Moves the ellipsoid to a later time (paper, §3.1).

Parameters
----------
time : float
    s, not before `self.time`.
control_torque : (3,) array_like, optional
    N m, body axes, constant over the interval; for a RigidBodyFlow.
gyro : (3,) array_like
    The measured rate over the interval, rad/s; for a GyroFlow.
)")
      .def(
          "update", &PythonFilter::update, py::kw_only(), "directions"_a = py::none(), "reference"_a = py::none(),
          "bounds"_a = py::none(), "weights"_a = py::none(), "angular_velocity"_a = py::none(),
          "rate_bound"_a = py::none(), "sensor"_a = "", "diagnostics"_a = false,
          R"(update(self, *, directions=None, reference=None, bounds=None, weights=None, angular_velocity=None, rate_bound=None, sensor='', diagnostics=False)
--

Fuses directions, an angular velocity or both with the prediction (paper, §3.2, §3.3). Any number of directions will do.

Parameters
----------
directions : (m, 3) array_like
    Measured in body axes.
reference : (m, 3) array_like
    The same directions in reference axes.
bounds : float, (m,) or (m, 3, 3) array_like
    Bounds of the direction errors: angles in rad, or shapes in rad².
weights : (m,) array_like, optional
    Weights in Wahba's problem.
angular_velocity : (3,) array_like, optional
    rad/s, body axes; for a RigidBodyFlow.
rate_bound : float or (3, 3) array_like
    rad/s, or a shape in (rad/s)².
sensor : str
    Name of the sensor for the message if the sets do not meet.
diagnostics : bool
    Whether to return diagnostics of the convergence theorem, for directions that determine an attitude, with an angular velocity.

Returns
-------
Update

Raises
------
InconsistentMeasurement
    If the sets have no common point.
)")
      .def("update_attitude", &PythonFilter::update_attitude, "attitude"_a, "bound"_a, "sensor"_a = "",
           R"(update_attitude(self, attitude, bound, sensor='')
--

Fuses a whole measured attitude, C = C̃ exp(S(ν)) with ν in a ball of radius `bound` (rad) or an ellipsoid of that shape.
)")
      .def("update_linear", &PythonFilter::update_linear, "y"_a, "h"_a, "bound"_a, "sensor"_a = "",
           R"(update_linear(self, y, h, bound, sensor='')
--

Fuses y = H x + v of the error x = [ζ; δ] about the present center, v in the ellipsoid of the shape `bound`.

Parameters
----------
y : (r,) array_like
h : (r, 6) array_like
bound : (r, r) array_like
)")
      .def("angular_velocity_estimate", &PythonFilter::angular_velocity_estimate, "gyro"_a,
           R"(angular_velocity_estimate(self, gyro)
--

The body's rate ω = gyro − bias − v at a sample with its bound, for a GyroFlow.

Returns
-------
Ellipsoid
)")
      .def(
          "run", &PythonFilter::run, "times"_a, py::kw_only(), "directions"_a = py::none(), "reference"_a = py::none(),
          "bounds"_a = py::none(), "weights"_a = py::none(), "angular_velocity"_a = py::none(),
          "rate_bound"_a = py::none(), "gyro"_a = py::none(), "control_torque"_a = py::none(),
          "on_inconsistent"_a = "raise",
          R"(run(self, times, *, directions=None, reference=None, bounds=None, weights=None, angular_velocity=None, rate_bound=None, gyro=None, control_torque=None, on_inconsistent='raise')
--

Predicts to each time of a log and updates with the measurements there, in one call and without the interpreter's lock.

Parameters
----------
times : (n,) array_like
    s, not decreasing, from `self.time` on.
directions : (n, m, 3) array_like, optional
    Rows that are all NaN are absent.
reference : (m, 3) or (n, m, 3) array_like
bounds, weights, rate_bound
    As in `update`, the same for all rows.
angular_velocity : (n, 3) array_like, optional
    For a RigidBodyFlow; rows that are all NaN are absent.
gyro : (n, 3) array_like
    For a GyroFlow: gyro[k] is the rate from times[k] to times[k + 1]; times[0] must be `self.time`.
control_torque : (3,) or (n, 3) array_like, optional
    For a RigidBodyFlow: row k acts until times[k].
on_inconsistent : {'raise', 'skip'}
    What to do with a row that contradicts the prediction. 'raise' leaves the filter as it was before the call.

Returns
-------
FilterLog

Raises
------
InconsistentMeasurement
    If sets do not meet; with the row.
RowError
    If a row has a number that is not finite or out of its range, or its time cannot be predicted to; with the row.
)");

  module.def("measured_attitude", &measured_attitude_of, "directions"_a, "reference"_a, "bounds"_a,
             "weights"_a = py::none(),
             R"(measured_attitude(directions, reference, bounds, weights=None)
--

The attitude that two or more directions measure, and the shape of its ellipsoid to first order (paper, eq. zetakpm).

Returns
-------
attitude : (3, 3) ndarray
shape : (3, 3) ndarray
    rad².
)");
  module.def("measured_state", &measured_state_of, "directions"_a, "reference"_a, "bounds"_a, "angular_velocity"_a,
             "rate_bound"_a, "weights"_a = py::none(),
             R"(measured_state(directions, reference, bounds, angular_velocity, rate_bound, weights=None)
--

The ellipsoid E^m of two or more directions and an angular velocity (paper, eqs. Pmkl, mea): a filter may start from it.

Returns
-------
StateEllipsoid
)");
}

}  // namespace elliptude::python
