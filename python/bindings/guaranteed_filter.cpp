#include <pybind11/stl.h>

#include <elliptude/guaranteed_filter.hpp>
#include <utility>
#include <variant>

#include "arguments.hpp"
#include "ellipsoids.hpp"
#include "guaranteed_flow.hpp"
#include "module.hpp"
#include "state_ellipsoid.hpp"

namespace elliptude::python {

namespace {

constexpr double pi = 3.14159265358979323846;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

using BodyFilter = GuaranteedFilter<GuaranteedBodyFlow>;
using GyroFilter = GuaranteedFilter<GuaranteedGyroFlow<double>>;
using AnyFilter = std::variant<BodyFilter, GyroFilter>;

template <typename Filter>
inline constexpr bool is_body = std::is_same_v<Filter, BodyFilter>;

// --- names of settings -------------------------------------------------------------------------------------------------

constexpr std::array<const char*, 4> policies{"raise", "drop_measurement", "restart", "relaxed"};
constexpr std::array<const char*, 3> claims{"unconditional", "conditional", "none"};

[[nodiscard]] Policy policy_of(const std::string& name) {
  std::string all;
  for (std::size_t i = 0; i < policies.size(); ++i) {
    if (name == policies[i]) {
      return static_cast<Policy>(i);
    }
    all += std::string(i == 0 ? "'" : ", '") + policies[i] + "'";
  }
  value_error("policy must be one of " + all + ", not '" + name + "'");
}

[[nodiscard]] const char* name_of(Claim claim) noexcept { return claims[static_cast<std::size_t>(claim)]; }

// --- bounds ------------------------------------------------------------------------------------------------------------

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

/// \throws ValueError of an angle of half a turn or more, which bounds nothing.
void require_below_half_turn(const Matrix3<double>& bound, const std::string& label) {
  if (!(spectral_norm(bound) < pi * pi)) {
    value_error(label + " must be below pi rad: an error of half a turn is no bound");
  }
}

/// Bounds of the measurements of a log, in rows and columns: one radius for all, one for each column, one for each row and
/// column, or a shape matrix for each column. A radius of NaN, or of the limit or more, is that of no measurement.
class LogBounds {
 public:
  /// \param columns 0 for a measurement without columns, of which there is one in a row.
  LogBounds(const py::object& value, const std::string& name, Index rows, Index columns, double limit)
      : numbers_(value, name, {}, Items::Require::anything), limit_(limit) {
    const Shape& shape = numbers_.leading();
    const std::string n = std::to_string(rows);
    const std::string m = std::to_string(columns);
    if (columns > 0 && shape == Shape{columns}) {
      column_stride_ = 1;
    } else if (columns > 0 && shape == Shape{rows, columns}) {
      row_stride_ = columns;
      column_stride_ = 1;
    } else if (columns == 0 && shape == Shape{rows}) {
      row_stride_ = 1;
    } else if (shape == (columns > 0 ? Shape{columns, 3, 3} : Shape{3, 3})) {
      is_radius_ = false;
      for (Index j = 0; j < std::max<Index>(columns, 1); ++j) {
        matrices_.emplace_back(Eigen::Map<const RowMajor3>(numbers_[9 * j]));
        const std::string label = name + (columns > 0 ? "[" + std::to_string(j) + "]" : "");
        require_bound(matrices_.back(), false, label);
        if (limit == pi) {
          require_below_half_turn(matrices_.back(), label);
        }
      }
      return;
    } else if (!shape.empty()) {
      value_error(
          name + " must be a number or have the shape " +
          (columns > 0 ? "(" + m + ",), (" + n + ", " + m + ") or (" + m + ", 3, 3)" : "(" + n + ",) or (3, 3)") +
          " for " + n + " rows" + (columns > 0 ? " of " + m + " directions" : "") + ", not " + text(shape));
    }
    for (Index i = 0; i < numbers_.count(); ++i) {
      const double radius = numbers_.number(i);
      if (radius < limit && !(radius > 0 && radius * radius > 0 && scalar::isfinite(radius * radius))) {
        value_error(numbers_.label(i) + " must be positive (and its square a number), but is " + text(radius));
      }
    }
  }

  /// The bound's shape, or nothing where nothing was measured.
  [[nodiscard]] std::optional<Matrix3<double>> at(Index row, Index column) const {
    if (!is_radius_) {
      return matrices_[static_cast<std::size_t>(column)];
    }
    const double* radius = numbers_[row * row_stride_ + column * column_stride_];
    return *radius < limit_ ? std::optional(bound_of(radius, true)) : std::nullopt;
  }

 private:
  Items numbers_;
  double limit_;
  bool is_radius_ = true;
  Index row_stride_ = 0;
  Index column_stride_ = 0;
  std::vector<Matrix3<double>> matrices_;
};

// --- measurements ------------------------------------------------------------------------------------------------------

constexpr auto most_directions = static_cast<Index>(most_sensor_directions);
constexpr Index most_with_wrong_ones = 8;

void require_direction_count(Index m) {
  if (m < 1 || m > most_directions) {
    value_error("directions must be 1 to " + std::to_string(most_directions) + ", not " + std::to_string(m));
  }
}

/// What was measured at one moment.
struct Measured {
  std::vector<Direction<double>> directions;
  std::vector<Index> columns;  ///< of the directions among all that there may be
  std::optional<AngularVelocity<double>> angular_velocity;
  std::optional<MeasuredAttitude<double>> attitude;

  [[nodiscard]] bool any() const noexcept {
    return !directions.empty() || angular_velocity.has_value() || attitude.has_value();
  }
  [[nodiscard]] Index count() const noexcept {
    return static_cast<Index>(directions.size()) + (angular_velocity ? 1 : 0) + (attitude ? 1 : 0);
  }
  [[nodiscard]] Measurements<double> core() const noexcept {
    return {directions.data(), directions.size(), angular_velocity ? &*angular_velocity : nullptr,
            attitude ? &*attitude : nullptr};
  }
  /// f(column) for each sensor, the angular velocity being column m and the attitude m + 1.
  template <typename Function>
  void for_each(Sensors sensors, Index m, const Function& f) const {
    for (std::size_t i = 0; i < directions.size(); ++i) {
      if ((sensors & direction_bit(i)) != 0) {
        f(columns[i]);
      }
    }
    if ((sensors & angular_velocity_bit) != 0) {
      f(m);
    }
    if ((sensors & attitude_bit) != 0) {
      f(m + 1);
    }
  }
};

/// What sensors are called: as the user does, or by their index.
class SensorNames {
 public:
  /// \param m how many directions there are.
  SensorNames(const py::object& names, Index m, bool has_rate, bool has_attitude) : given_(!names.is_none()), m_(m) {
    if (!given_) {
      return;
    }
    if (py::isinstance<py::str>(names)) {
      throw py::type_error("sensors must be a sequence of names, not one str");
    }
    for (const py::handle& name : names) {
      if (!py::isinstance<py::str>(name)) {
        throw py::type_error(std::string("sensors must hold names, not ") + Py_TYPE(name.ptr())->tp_name);
      }
      names_.push_back(name.cast<std::string>());
    }
    const auto count = static_cast<Index>(names_.size());
    const Index all = m + (has_rate ? 1 : 0) + (has_attitude ? 1 : 0);
    if (count != m && count != all) {
      value_error("sensors must name the " + std::to_string(m) + " directions" +
                  (all > m ? ", or these and what else is measured, " + std::to_string(all) + " in all" : "") +
                  ", but holds " + std::to_string(count) + " names");
    }
    if (count == m) {
      names_.emplace_back("angular_velocity");
      names_.emplace_back("attitude");
    } else if (!has_rate) {
      names_.insert(names_.end() - 1, "angular_velocity");
    } else if (!has_attitude) {
      names_.emplace_back("attitude");
    }
  }

  [[nodiscard]] std::string text_of(Index column) const {
    if (given_) {
      return names_[static_cast<std::size_t>(column)];
    }
    return column == m_ ? "angular_velocity" : column == m_ + 1 ? "attitude" : "direction " + std::to_string(column);
  }
  /// A direction without a name is its index.
  [[nodiscard]] py::object object_of(Index column) const {
    return !given_ && column < m_ ? py::object(py::int_(column)) : py::object(py::str(text_of(column)));
  }
  [[nodiscard]] Index directions() const noexcept { return m_; }

 private:
  bool given_;
  Index m_;
  std::vector<std::string> names_;
};

/// What goes into a prediction beside the time.
struct Inputs {
  Vector3<double> control_torque = Vector3<double>::Zero();
  Vector3<double> wheel_momentum = Vector3<double>::Zero();
  Vector3<double> gyro = Vector3<double>::Zero();
  double increment = -1;  // none
};

template <typename Filter>
[[nodiscard]] typename Filter::Input input_of(const Inputs& inputs) noexcept {
  if constexpr (is_body<Filter>) {
    return {inputs.control_torque, inputs.wheel_momentum};
  } else {
    return {inputs.gyro, inputs.increment};
  }
}

// --- the filter --------------------------------------------------------------------------------------------------------

class PythonGuaranteedFilter {
 public:
  PythonGuaranteedFilter(py::object flow, const std::optional<AnyStateEllipsoid>& start, const py::object& time,
                         std::string criterion, const py::object& weight, const std::string& policy, int most_wrong,
                         int regain_after, const py::object& vector_bound, bool estimate_vector)
      : flow_(std::move(flow)), criterion_(std::move(criterion)) {
    const double begin = single(time, "time", {}).number(0);
    BodyFilter::Settings settings;
    settings.criterion = size_criterion_of(criterion_, weight);
    settings.policy = policy_of(policy);
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
      make<GyroFilter>(
          flow_.cast<const GuaranteedGyroFlowSettings&>().flow,
          {settings.criterion, settings.policy, settings.most_wrong, settings.regain_after, settings.estimates_vector},
          begin, start);
    } else {
      throw py::type_error(std::string("flow must be a GuaranteedRigidBodyFlow or a GuaranteedGyroFlow, not ") +
                           Py_TYPE(flow_.ptr())->tp_name);
    }
  }

  [[nodiscard]] const py::object& flow() const noexcept { return flow_; }
  [[nodiscard]] const std::string& criterion() const noexcept { return criterion_; }
  [[nodiscard]] bool has_gyro() const noexcept { return std::holds_alternative<GyroFilter>(filter_); }
  [[nodiscard]] py::object weight() const {
    if (criterion_ != "weighted_trace") {
      return py::none();
    }
    return std::visit([](const auto& filter) { return py::object(to_array(filter.settings().criterion.weight)); },
                      filter_);
  }
  [[nodiscard]] double time() const {
    return std::visit([](const auto& filter) { return filter.time(); }, filter_);
  }
  [[nodiscard]] const char* claim() const {
    return std::visit([](const auto& filter) { return name_of(filter.claim()); }, filter_);
  }
  [[nodiscard]] const char* policy() const {
    return std::visit([](const auto& filter) { return policies[static_cast<std::size_t>(filter.settings().policy)]; },
                      filter_);
  }
  [[nodiscard]] int most_wrong() const {
    return std::visit([](const auto& filter) { return filter.settings().most_wrong; }, filter_);
  }
  [[nodiscard]] int regain_after() const {
    return std::visit([](const auto& filter) { return filter.settings().regain_after; }, filter_);
  }
  [[nodiscard]] bool estimate_vector() const {
    return std::visit([](const auto& filter) { return filter.settings().estimates_vector; }, filter_);
  }
  [[nodiscard]] int agreeing_updates() const {
    return std::visit([](const auto& filter) { return filter.agreeing_updates(); }, filter_);
  }
  [[nodiscard]] bool rests_on_drops() const {
    return std::visit([](const auto& filter) { return filter.rests_on_drops(); }, filter_);
  }
  [[nodiscard]] bool knows_attitude() const {
    return std::visit([](const auto& filter) { return filter.knows_attitude(); }, filter_);
  }
  [[nodiscard]] std::optional<AnyStateEllipsoid> ellipsoid() const {
    return std::visit(
        [](const auto& filter) {
          return filter.knows_attitude() ? std::optional(AnyStateEllipsoid::from(filter.ellipsoid())) : std::nullopt;
        },
        filter_);
  }
  [[nodiscard]] py::object vector_bound() const { return pair_of(vector_bound_); }
  /// What is known of the vector while the attitude is not: (center, shape).
  [[nodiscard]] py::object vector() const {
    return std::visit(
        [](const auto& filter) {
          return pair_of(filter.knows_vector() ? std::optional(filter.vector()) : std::nullopt);
        },
        filter_);
  }

  void resume(const std::optional<AnyStateEllipsoid>& ellipsoid, const py::object& vector, bool rests_on_drops,
              int agreeing_updates) {
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
      return filter.resume(set ? &*set : nullptr, known ? &*known : nullptr, rests_on_drops, agreeing_updates);
    };
    raise_unless_ok(std::visit(go, filter_), "ellipsoid, vector, agreeing_updates");
  }

  void predict(const py::object& time, const py::object& control_torque, const py::object& wheel_momentum,
               const py::object& gyro, const py::object& increment) {
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
    read(gyro, "gyro", inputs.gyro);
    if (!increment.is_none()) {
      inputs.increment = single(increment, "increment", {}).number(0);
      if (!(inputs.increment >= 0)) {
        value_error("increment must not be negative, but is " + text(inputs.increment) + " rad");
      }
    }
    const py::gil_scoped_release release;
    std::visit([&](auto& filter) { predict_to(filter, end, inputs, -1); }, filter_);
  }

  [[nodiscard]] py::object update(const py::object& directions, const py::object& reference, const py::object& bounds,
                                  const py::object& angular_velocity, const py::object& rate_bound,
                                  const py::object& attitude, const py::object& attitude_bound,
                                  const py::object& sensors) {
    const std::unique_lock lock = exclusive(*mutex_);
    require_bounds(directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
    Measured measured;
    Index m = 0;
    if (!directions.is_none()) {
      const Items body = single(directions, "directions", {any_length, 3});
      m = body.item()[0];
      require_direction_count(m);
      const Items references = single(reference, "reference", {m, 3});
      const std::vector<Matrix3<double>> shapes = direction_bounds(bounds, m);
      for (Index i = 0; i < m; ++i) {
        const Matrix3<double>& bound = shapes[static_cast<std::size_t>(i)];
        require_below_half_turn(bound, "bounds");
        measured.directions.push_back({Eigen::Map<const Vector3<double>>(references[0] + 3 * i),
                                       Eigen::Map<const Vector3<double>>(body[0] + 3 * i), bound, 1.0});
        measured.columns.push_back(i);
        require_direction(measured.directions.back().body, "directions[" + std::to_string(i) + "]");
        require_direction(measured.directions.back().reference, "reference[" + std::to_string(i) + "]");
      }
    }
    if (!angular_velocity.is_none()) {
      measured.angular_velocity = {single(angular_velocity, "angular_velocity", {3}).vector<3>(0),
                                   one_bound(rate_bound, "rate_bound", false)};
    }
    if (!attitude.is_none()) {
      measured.attitude = {single_attitude(attitude, "attitude"), one_bound(attitude_bound, "attitude_bound", false)};
      require_below_half_turn(measured.attitude->bound, "attitude_bound");
    }
    if (!measured.any() && !vector_bound_) {
      value_error("update needs directions, angular_velocity or attitude");
    }
    const SensorNames names(sensors, m, measured.angular_velocity.has_value(), measured.attitude.has_value());
    return std::visit(
        [&](auto& filter) {
          const GuaranteedUpdate<double> update = fuse(filter, measured, names, -1);
          py::list dropped;
          measured.for_each(update.dropped, m, [&](Index column) { dropped.append(names.object_of(column)); });
          return updated(update, py::tuple(dropped));
        },
        filter_);
  }

  [[nodiscard]] py::object update_linear(const py::object& y, const py::object& h, const py::object& bound) {
    const std::unique_lock lock = exclusive(*mutex_);
    const Items values = single(y, "y", {any_length});
    const Index rows = values.item()[0];
    if (rows > 6) {
      value_error("y must have 1 to 6 rows, not " + std::to_string(rows));
    }
    const Items matrix = single(h, "h", {rows, 6});
    const Items shape = single(bound, "bound", {rows, rows});
    if (!knows_attitude()) {
      value_error("update_linear is of the error about a center, but the attitude is not known");
    }
    return std::visit(
        [&](auto& filter) {
          GuaranteedUpdate<double> update;
          const Status status = with_dimension(rows, [&](auto dimension) {
            constexpr int n = decltype(dimension)::value;
            const LinearMeasurement<double, n> measurement{values.vector<n>(0), matrix.dynamic_matrix(),
                                                           shape.dynamic_matrix()};
            return filter.update(measurement, update);
          });
          if (status == Status::empty_intersection) {
            raise_inconsistent("linear measurement", filter.time(), -1, update.margin);
          }
          raise_unless_ok(status, "update_linear");
          return updated(update, py::tuple());
        },
        filter_);
  }

  [[nodiscard]] py::object run(const py::object& times, const py::object& directions, const py::object& reference,
                               const py::object& bounds, const py::object& angular_velocity,
                               const py::object& rate_bound, const py::object& attitude,
                               const py::object& attitude_bound, const py::object& gyro, const py::object& increment,
                               const py::object& control_torque, const py::object& wheel_momentum,
                               const py::object& sensors);

  [[nodiscard]] int traverse(visitproc visit, void* arg) const noexcept {
    Py_VISIT(flow_.ptr());
    return 0;
  }

 private:
  [[nodiscard]] static py::object pair_of(const std::optional<Ellipsoid<double, 3>>& ellipsoid) {
    return ellipsoid ? py::object(py::make_tuple(to_array(ellipsoid->center), to_array(ellipsoid->shape)))
                     : py::object(py::none());
  }

  template <typename Filter>
  void make(const typename Filter::Flow& flow, const typename Filter::Settings& settings, double time,
            const std::optional<AnyStateEllipsoid>& start) {
    using State = typename Filter::State;
    Filter filter;
    raise_unless_ok(Filter::make(flow, settings, time, filter), "criterion");
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
      raise_unless_ok(status, "start");
    }
    if (vector_bound_) {
      raise_unless_ok(filter.bound_vector(*vector_bound_), "vector_bound");
    }
    filter_ = filter;
  }

  /// \throws TypeError of inputs that are not those of the flow.
  void require_inputs_of_flow(const py::object& control_torque, const py::object& wheel_momentum,
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

  /// \throws ValueError where a measurement comes without its bound, TypeError of a rate for a gyro's filter.
  void require_bounds(const py::object& directions, const py::object& reference, const py::object& bounds,
                      const py::object& angular_velocity, const py::object& rate_bound, const py::object& attitude,
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

  [[nodiscard]] static std::string at_row(Index row) { return row < 0 ? "" : " at row " + std::to_string(row); }

  /// \param row of a log, or −1.
  template <typename Filter>
  static void predict_to(Filter& filter, double time, const Inputs& inputs, Index row) {
    const Status status = filter.predict(time, input_of<Filter>(inputs));
    if (status == Status::ok) {
      return;
    }
    if (status == Status::out_of_range) {
      value_error("time must not go backwards, and by no more than " + std::to_string(GuaranteedBodyFlow::most_steps) +
                  " steps forwards, but is " + text(time) + " s" + at_row(row) + " after " + text(filter.time()) +
                  " s");
    }
    if (status == Status::step_too_long) {
      value_error("step of the flow is too long" + at_row(row) + ": the angular velocity is " +
                  text(vector_part(filter.ellipsoid().center).norm()) + " rad/s at " + text(filter.time()) +
                  " s, and the motion in a step must be given by a short series; take a shorter step");
    }
    raise(status, "predict" + at_row(row));
  }

  [[noreturn]] static void raise_inconsistent(const std::string& sensor, double time, Index row, double margin) {
    throw InconsistentSets((sensor.empty() ? "the measurements" : "the measurement of " + sensor) +
                               std::string(" at ") + text(time) + " s" + at_row(row) +
                               (sensor.empty() ? " contradict" : " contradicts") +
                               " the prediction or each other: no state satisfies all bounds (margin " + text(margin) +
                               "); some bound is wrong",
                           margin, time, sensor);
  }

  template <typename Filter>
  [[nodiscard]] static GuaranteedUpdate<double> fuse(Filter& filter, const Measured& measured, const SensorNames& names,
                                                     Index row) {
    const auto& settings = filter.settings();
    if (settings.policy == Policy::relaxed && settings.most_wrong > 0 && measured.count() > most_with_wrong_ones) {
      value_error("policy 'relaxed' is for at most " + std::to_string(most_with_wrong_ones) +
                  " measurements at a time, but there are " + std::to_string(measured.count()) + at_row(row));
    }
    GuaranteedUpdate<double> update;
    const Status status = filter.update(measured.core(), update);
    if (status == Status::empty_intersection) {
      std::string sensor;
      measured.for_each(update.contradicting, names.directions(),
                        [&](Index column) { sensor = names.text_of(column); });
      if (sensor.empty() && measured.count() == 1) {  // the prediction weighs more, but it is the one against it
        sensor = names.text_of(!measured.columns.empty()   ? measured.columns[0]
                               : measured.angular_velocity ? names.directions()
                                                           : names.directions() + 1);
      }
      raise_inconsistent(sensor, filter.time(), row, update.margin);
    }
    raise_unless_ok(status, "update" + at_row(row));
    return update;
  }

  [[nodiscard]] static py::object updated(const GuaranteedUpdate<double>& update, const py::tuple& dropped) {
    return py::module_::import("elliptude.results")
        .attr("GuaranteedUpdate")(name_of(update.claim), update.prediction_used, dropped, update.margin);
  }

  py::object flow_;
  std::string criterion_;
  std::optional<Ellipsoid<double, 3>> vector_bound_;
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
  AnyFilter filter_;
};

// --- a whole log -------------------------------------------------------------------------------------------------------

/// The measurements of a log, checked as far as does not need their values.
class MeasuredLog {
 public:
  MeasuredLog(Index rows, const py::object& directions, const py::object& reference, const py::object& bounds,
              const py::object& angular_velocity, const py::object& rate_bound, const py::object& attitude,
              const py::object& attitude_bound)
      : rates_(angular_velocity, "angular_velocity", rows) {
    constexpr auto anything = Items::Require::anything;
    if (!directions.is_none()) {
      directions_.emplace(directions, "directions", Shape{rows, any_length, 3}, anything, Items::Batch::none);
      m_ = directions_->item()[1];
      require_direction_count(m_);
      references_.emplace(reference, "reference", Shape{m_, 3}, anything);
      reference_moves_ = !references_->leading().empty();
      if (reference_moves_ && references_->leading() != Shape{rows}) {
        const std::string m = std::to_string(m_);
        value_error("reference must have the shape (" + m + ", 3) or (" + std::to_string(rows) + ", " + m +
                    ", 3), not " + text(references_->leading()) + " times (" + m + ", 3)");
      }
      bounds_.emplace(bounds, "bounds", rows, m_, pi);
    }
    if (rates_.given()) {
      rate_bounds_.emplace(rate_bound, "rate_bound", rows, 0, std::numeric_limits<double>::infinity());
    }
    if (!attitude.is_none()) {
      const py::object matrices =
          py::hasattr(attitude, "as_matrix") ? py::object(attitude.attr("as_matrix")()) : attitude;
      attitudes_.emplace(matrices, "attitude", Shape{rows, 3, 3}, anything, Items::Batch::none);
      attitude_bounds_.emplace(attitude_bound, "attitude_bound", rows, 0, pi);
    }
  }

  [[nodiscard]] Index directions() const noexcept { return m_; }

  /// \throws ValueError of a row that is neither measured nor all NaN.
  void read(Index row, Measured& measured) const {
    measured.directions.clear();
    measured.columns.clear();
    for (Index j = 0; j < m_; ++j) {
      const Vector3<double> body = Eigen::Map<const Vector3<double>>((*directions_)[0] + 3 * (row * m_ + j));
      const std::optional<Matrix3<double>> bound = bounds_->at(row, j);
      if (is_absent(body) || !bound) {
        continue;
      }
      const Vector3<double> reference =
          Eigen::Map<const Vector3<double>>((*references_)[reference_moves_ ? row : 0] + 3 * j);
      if (!scalar::all_finite(body) || !(scalar::length(body) > 0)) {
        const std::string label = "directions[" + std::to_string(row) + ", " + std::to_string(j) + "]";
        require_measured(body, label);
        require_direction(body, label);
      }
      if (!scalar::all_finite(reference) || !(scalar::length(reference) > 0)) {
        const std::string label =
            "reference[" + (reference_moves_ ? std::to_string(row) + ", " : "") + std::to_string(j) + "]";
        if (!scalar::all_finite(reference)) {
          value_error(label + " must be finite where its direction is measured");
        }
        require_direction(reference, label);
      }
      measured.directions.push_back({reference, body, *bound, 1.0});
      measured.columns.push_back(j);
    }
    measured.angular_velocity.reset();
    if (rates_.given()) {
      const auto value = rates_.row(row);
      const auto bound = rate_bounds_->at(row, 0);
      if (value && bound) {
        if (!scalar::all_finite(*value)) {
          require_measured(*value, "angular_velocity[" + std::to_string(row) + "]");
        }
        measured.angular_velocity = {*value, *bound};
      }
    }
    measured.attitude.reset();
    if (attitudes_) {
      const Matrix3<double> value = Eigen::Map<const RowMajor3>((*attitudes_)[0] + 9 * row);
      const auto bound = attitude_bounds_->at(row, 0);
      if (!value.array().isNaN().all() && bound) {
        if (!scalar::all_finite(value) || !is_rotation(value, rotation_tolerance<double>())) {
          const std::string label = "attitude[" + std::to_string(row) + "]";
          if (!scalar::all_finite(value)) {
            value_error(label + " must be finite, or all NaN where nothing was measured");
          }
          require_rotation(value, label);
        }
        measured.attitude = {value, *bound};
      }
    }
  }

 private:
  Index m_ = 0;
  std::optional<Items> directions_;
  std::optional<Items> references_;
  bool reference_moves_ = false;
  std::optional<LogBounds> bounds_;
  OptionalRows rates_;
  std::optional<LogBounds> rate_bounds_;
  std::optional<Items> attitudes_;
  std::optional<LogBounds> attitude_bounds_;
};

/// An input of a log: nothing, one for all rows, or one for each.
class LogInput {
 public:
  LogInput(const py::object& value, const std::string& name, const Shape& item, Index rows, Items::Require require) {
    if (value.is_none()) {
      return;
    }
    items_.emplace(value, name, item, require);
    if (!(items_->leading().empty() || items_->leading() == Shape{rows})) {
      Shape all{rows};
      all.insert(all.end(), item.begin(), item.end());
      value_error(name + " must have the shape " + text(item) + " or " + text(all) + ", not " +
                  text(items_->leading()) + (item.empty() ? "" : " times " + text(item)));
    }
  }
  [[nodiscard]] bool given() const noexcept { return items_.has_value(); }
  [[nodiscard]] const double* row(Index i) const noexcept { return (*items_)[items_->leading().empty() ? 0 : i]; }

 private:
  std::optional<Items> items_;
};

py::object PythonGuaranteedFilter::run(const py::object& times, const py::object& directions,
                                       const py::object& reference, const py::object& bounds,
                                       const py::object& angular_velocity, const py::object& rate_bound,
                                       const py::object& attitude, const py::object& attitude_bound,
                                       const py::object& gyro, const py::object& increment,
                                       const py::object& control_torque, const py::object& wheel_momentum,
                                       const py::object& sensors) {
  const std::unique_lock lock = exclusive(*mutex_);
  const Items time = single(times, "times", {any_length});
  const Index rows = time.item()[0];
  require_inputs_of_flow(control_torque, wheel_momentum, gyro, increment);
  require_bounds(directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const MeasuredLog log(rows, directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const Index m = log.directions();
  const SensorNames names(sensors, m, !angular_velocity.is_none(), !attitude.is_none());
  const LogInput torques(control_torque, "control_torque", {3}, rows, Items::Require::finite);
  const LogInput wheels(wheel_momentum, "wheel_momentum", {3}, rows, Items::Require::finite);
  const LogInput increments(increment, "increment", {}, rows, Items::Require::anything);
  std::optional<Items> rates;
  if (has_gyro()) {
    rates.emplace(single(gyro, "gyro", {rows, 3}));
    if (time[0][0] != this->time()) {
      value_error("times[0] must be the filter's time, " + text(this->time()) +
                  " s, for a GuaranteedGyroFlow: gyro[k] is the rate from times[k] on; it is " + text(time[0][0]) +
                  " s");
    }
  }

  Results attitudes_out({rows}, {3, 3});
  Results vectors_out({rows}, {3});
  Results shapes_out({rows}, {6, 6});
  Results margins_out({rows}, {});
  py::array_t<std::uint8_t> claims_out(rows);
  py::array_t<bool> prediction_used(rows);
  py::array_t<bool> updated_out(rows);
  py::array_t<bool> dropped({rows, m + 2});
  std::uint8_t* claim_data = claims_out.mutable_data();
  bool* used_data = prediction_used.mutable_data();
  bool* updated_data = updated_out.mutable_data();
  bool* dropped_data = dropped.mutable_data();

  AnyFilter working = filter_;
  const auto go = [&](auto& filter) {
    const py::gil_scoped_release release;
    Measured measured;
    for (Index i = 0; i < rows; ++i) {
      if (i % 256 == 255) {
        const py::gil_scoped_acquire acquire;
        if (PyErr_CheckSignals() != 0) {
          throw py::error_already_set();
        }
      }
      Inputs inputs;
      const Index before = std::max<Index>(i - 1, 0);  // a gyro's row is of the interval that it begins
      if (rates) {
        inputs.gyro = Eigen::Map<const Vector3<double>>((*rates)[0] + 3 * before);
      }
      if (increments.given() && !(*increments.row(before) != *increments.row(before))) {
        inputs.increment = *increments.row(before);
        if (!(inputs.increment >= 0) || !scalar::isfinite(inputs.increment)) {
          value_error("increment[" + std::to_string(before) + "] must not be negative, but is " +
                      text(inputs.increment) + " rad; NaN where none is known");
        }
      }
      if (torques.given()) {
        inputs.control_torque = Eigen::Map<const Vector3<double>>(torques.row(i));
      }
      if (wheels.given()) {
        inputs.wheel_momentum = Eigen::Map<const Vector3<double>>(wheels.row(i));
      }
      if (!(time[0][i] >= filter.time())) {
        value_error("times must not go backwards, but times[" + std::to_string(i) + "] is " + text(time[0][i]) +
                    " s after " + text(filter.time()) + " s");
      }
      predict_to(filter, time[0][i], inputs, i);

      log.read(i, measured);
      GuaranteedUpdate<double> update;
      update.margin = nan;
      updated_data[i] = measured.any();
      if (measured.any()) {
        update = fuse(filter, measured, names, i);
      }
      std::fill_n(dropped_data + i * (m + 2), m + 2, false);
      measured.for_each(update.dropped, m, [&](Index column) { dropped_data[i * (m + 2) + column] = true; });
      used_data[i] = measured.any() ? update.prediction_used : filter.knows_attitude();
      margins_out.set(i, update.margin);
      claim_data[i] = static_cast<std::uint8_t>(filter.claim());
      if (filter.knows_attitude()) {
        const auto& set = filter.ellipsoid();
        attitudes_out.set(i, set.center.attitude);
        vectors_out.set(i, vector_part(set.center));
        shapes_out.set(i, set.shape);
      } else {
        attitudes_out.set(i, Matrix3<double>(Matrix3<double>::Constant(nan)));
        vectors_out.set(i, Vector3<double>(Vector3<double>::Constant(nan)));
        shapes_out.set(i, Matrix6<double>(Matrix6<double>::Constant(nan)));
      }
    }
  };
  try {
    std::visit(go, working);
  } catch (const InconsistentSets&) {
    filter_ = working;  // as it was predicted to the row: the user may go on from there
    throw;
  }
  filter_ = working;
  return py::module_::import("elliptude.results")
      .attr("GuaranteedLog")(to_array(time.dynamic_vector()), attitudes_out.array(), vectors_out.array(),
                             shapes_out.array(), claims_out, prediction_used, updated_out, dropped,
                             margins_out.array());
}

}  // namespace

void define_guaranteed_filter(py::module_& module) {
  using namespace py::literals;
  using Filter = PythonGuaranteedFilter;

  py::class_<Filter>(
      module, "GuaranteedFilter", collectable<Filter>(),
      R"(GuaranteedFilter(flow, start=None, *, time=0.0, criterion='volume', weight=None, policy='raise', most_wrong=0, regain_after=10, vector_bound=None, estimate_vector=True)
--

A set that holds attitude and angular velocity (or gyro bias) whenever what it was told of errors holds, to the last term.

It may know nothing of the attitude, at the beginning or when a prediction has become too large to be of use, and then starts
from the next measurements that determine one. A call that raises leaves the filter as it was, but for `run`.

Parameters
----------
flow : GuaranteedRigidBodyFlow or GuaranteedGyroFlow
start : StateEllipsoid, optional
    Holds the state at `time`, in either chart; nothing is known if omitted.
time : float
    s.
criterion : {'volume', 'trace', 'weighted_trace'}
    What the smallest ellipsoid is; the trace adds rad² to rad²/s² unless it is weighted.
weight : (6, 6) array_like, optional
    Of the weighted trace, symmetric positive definite.
policy : {'raise', 'drop_measurement', 'restart', 'relaxed'}
    What to do with measurements that no predicted state can have caused, which proves that some bound is wrong. 'raise' raises;
    'drop_measurement' leaves out as few as make the rest agree; 'restart' forgets the prediction; 'relaxed' lets `most_wrong`
    of the measurements of every update be wrong, whether that shows or not.
most_wrong : {0, 1, 2}
    For 'relaxed', of at most eight measurements.
regain_after : int
    After how many updates in a row without contradiction a conditional claim ends: the set is then taken from the measurements
    of that moment alone, if they bound one.
vector_bound : float, (3, 3) array_like or tuple of (3,) array_like and one of these, optional
    The angular velocity, or the gyro's bias, is always in this ellipsoid: a radius (rad/s) or shape ((rad/s)²) about zero, or
    about a center.
estimate_vector : bool
    Of a GuaranteedGyroFlow: whether its bias is estimated. If not, `vector_bound` is all that is known of it, and the attitude's
    sets, fused by themselves, are smaller.

Raises
------
ValueError
    If an argument is not finite or out of its range, or the start is flat or holds half turns.
)")
      .def(py::init<py::object, const std::optional<AnyStateEllipsoid>&, const py::object&, std::string,
                    const py::object&, const std::string&, int, int, const py::object&, bool>(),
           "flow"_a, "start"_a = py::none(), py::kw_only(), "time"_a = 0.0, "criterion"_a = "volume",
           "weight"_a = py::none(), "policy"_a = "raise", "most_wrong"_a = 0, "regain_after"_a = 10,
           "vector_bound"_a = py::none(), "estimate_vector"_a = true)
      .def_property_readonly("flow", &Filter::flow, "The flow, as it was given.")
      .def_property_readonly("time", &Filter::time, "Of the set, s.")
      .def_property_readonly("criterion", &Filter::criterion, "What the smallest ellipsoid is.")
      .def_property_readonly("weight", &Filter::weight,
                             "Of the weighted trace, shape (6, 6); None for another criterion.")
      .def_property_readonly("policy", &Filter::policy, "What is done with measurements that contradict.")
      .def_property_readonly("most_wrong", &Filter::most_wrong,
                             "How many measurements of an update may be wrong, for 'relaxed'.")
      .def_property_readonly("regain_after", &Filter::regain_after,
                             "After how many updates without contradiction a conditional claim ends.")
      .def_property_readonly("vector_bound", &Filter::vector_bound,
                             "What the vector is always in: (center, shape), rad/s and (rad/s)²; or None.")
      .def_property_readonly("estimate_vector", &Filter::estimate_vector,
                             "Whether the gyro's bias is estimated, and not only bounded; True for a body.")
      .def_property_readonly(
          "claim", &Filter::claim,
          "What the truth's being in the set rests on: 'unconditional', on what the filter was told of errors; "
          "'conditional', also on that what was dropped was what was wrong; 'none', there is no set.")
      .def_property_readonly("knows_attitude", &Filter::knows_attitude, "Whether there is a set.")
      .def_property_readonly("ellipsoid", &Filter::ellipsoid,
                             "The set, a StateEllipsoid in the Gibbs chart; None if the attitude is not known.")
      .def_property_readonly("_agreeing_updates", &Filter::agreeing_updates)
      .def_property_readonly("_vector", &Filter::vector)
      .def_property_readonly("_rests_on_drops", &Filter::rests_on_drops)
      .def("_resume", &Filter::resume, "ellipsoid"_a, "vector"_a, "rests_on_drops"_a, "agreeing_updates"_a)
      .def("predict", &Filter::predict, "time"_a, py::kw_only(), "control_torque"_a = py::none(),
           "wheel_momentum"_a = py::none(), "gyro"_a = py::none(), "increment"_a = py::none(),
           R"(predict(self, time, *, control_torque=None, wheel_momentum=None, gyro=None, increment=None)
--

Moves the set to a later time. If it becomes too large to be bounded, the attitude is forgotten.

Parameters
----------
time : float
    s, not before `self.time`.
control_torque : (3,) array_like, optional
    N m, body axes, constant over the interval; for a GuaranteedRigidBodyFlow, as the next.
wheel_momentum : (3,) array_like, optional
    Angular momentum of wheels relative to the body, N m s, body axes, constant over the interval.
gyro : (3,) array_like
    The measured rate of the interval as the flow's `interval_rate` says, rad/s, body axes; for a GuaranteedGyroFlow.
increment : float, optional
    Bound of the angle that the errors v of the gyro make together over this interval, rad, where a better one is known than
    the duration times the noise.

Raises
------
ValueError
    If time runs backwards, a step is too long for the motion, or an argument is not finite.
)")
      .def(
          "update", &Filter::update, "directions"_a = py::none(), "reference"_a = py::none(), "bounds"_a = py::none(),
          py::kw_only(), "angular_velocity"_a = py::none(), "rate_bound"_a = py::none(), "attitude"_a = py::none(),
          "attitude_bound"_a = py::none(), "sensors"_a = py::none(),
          R"(update(self, directions=None, reference=None, bounds=None, *, angular_velocity=None, rate_bound=None, attitude=None, attitude_bound=None, sensors=None)
--

Fuses all that was measured at one moment with the prediction, at once. Any number of directions will do.

Parameters
----------
directions : (m, 3) array_like
    Measured in body axes, 1 to 32.
reference : (m, 3) array_like
    The same directions in reference axes.
bounds : float, (m,) or (m, 3, 3) array_like
    Of the direction errors: angles in rad, below pi, or shapes in rad².
angular_velocity : (3,) array_like, optional
    rad/s, body axes; for a GuaranteedRigidBodyFlow.
rate_bound : float or (3, 3) array_like
    rad/s, or a shape in (rad/s)².
attitude : (3, 3) array_like or scipy Rotation, optional
    A whole attitude, as a star tracker gives it: C = C̃ exp(S(ν)).
attitude_bound : float or (3, 3) array_like
    Of ν: an angle in rad, below pi, or a shape in rad².
sensors : sequence of str, optional
    Names for messages and for what is dropped: of the directions, or of these, the angular velocity and the attitude as far as
    they are given. Without names a direction is its index, and the others are 'angular_velocity' and 'attitude'.

Returns
-------
GuaranteedUpdate

Raises
------
InconsistentMeasurement
    If no state satisfies all bounds and the policy does not say what to do then; with the sensor that contradicts most, where it
    is not the prediction.
ValueError
    If an argument is not finite or out of its range.
)")
      .def("update_linear", &Filter::update_linear, "y"_a, "h"_a, "bound"_a,
           R"(update_linear(self, y, h, bound)
--

Fuses y = H x + v of the error x = [ζ; δ] about the present center, v in the ellipsoid of the shape `bound`.

Parameters
----------
y : (r,) array_like
h : (r, 6) array_like
bound : (r, r) array_like

Returns
-------
GuaranteedUpdate

Raises
------
InconsistentMeasurement
    If no predicted state can have caused it, whatever the policy.
ValueError
    If the attitude is not known, or an argument is not finite or out of its range.
)")
      .def(
          "run", &Filter::run, "times"_a, py::kw_only(), "directions"_a = py::none(), "reference"_a = py::none(),
          "bounds"_a = py::none(), "angular_velocity"_a = py::none(), "rate_bound"_a = py::none(),
          "attitude"_a = py::none(), "attitude_bound"_a = py::none(), "gyro"_a = py::none(), "increment"_a = py::none(),
          "control_torque"_a = py::none(), "wheel_momentum"_a = py::none(), "sensors"_a = py::none(),
          R"(run(self, times, *, directions=None, reference=None, bounds=None, angular_velocity=None, rate_bound=None, attitude=None, attitude_bound=None, gyro=None, increment=None, control_torque=None, wheel_momentum=None, sensors=None)
--

Predicts to each time of a log and updates with what is there, in one call and without the interpreter's lock.

Parameters
----------
times : (n,) array_like
    s, not decreasing, from `self.time` on.
directions : (n, m, 3) array_like, optional
    Rows that are all NaN were not measured.
reference : (m, 3) or (n, m, 3) array_like
bounds : float, (m,), (n, m) or (m, 3, 3) array_like
    Angles in rad, or shapes in rad²; an angle that is NaN, or pi and more, says that nothing was measured there.
angular_velocity : (n, 3) array_like, optional
    For a GuaranteedRigidBodyFlow; rows that are all NaN were not measured.
rate_bound : float, (n,) or (3, 3) array_like
    rad/s, NaN where nothing was measured, or a shape in (rad/s)².
attitude : (n, 3, 3) array_like or scipy Rotation, optional
    Rows that are all NaN were not measured.
attitude_bound : float, (n,) or (3, 3) array_like
    As for directions.
gyro : (n, 3) array_like
    For a GuaranteedGyroFlow: gyro[k] is the rate of the interval from times[k] to times[k + 1], as the flow's `interval_rate`
    says; times[0] must be `self.time`.
increment : float or (n,) array_like, optional
    As in `predict`, of the same intervals as gyro; NaN where none is known.
control_torque, wheel_momentum : (3,) or (n, 3) array_like, optional
    For a GuaranteedRigidBodyFlow: row k acts until times[k].
sensors : sequence of str, optional
    As in `update`.

Returns
-------
GuaranteedLog

Raises
------
InconsistentMeasurement
    With the row, its time and the sensor; the filter is then as predicted to that row. After any other error it is as before
    the call.
ValueError
    If an argument is not finite or out of its range, with the row.
)");
}

}  // namespace elliptude::python
