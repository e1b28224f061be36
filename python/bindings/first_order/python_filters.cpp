#include "first_order/python_filters.hpp"

#include <algorithm>
#include <utility>

#include "attitude/state_ellipsoid.hpp"
#include "signals.hpp"

namespace elliptude_kernels {

FilterKernels widest_for_filters() noexcept {
  switch (widest_set()) {
#if defined(__GNUC__) && defined(__x86_64__)
    case InstructionSet::avx512:
      return filters_avx512();
    case InstructionSet::avx2:
      return filters_avx2();
#endif
#if defined(__GNUC__)
    case InstructionSet::baseline:
      return filters_baseline();
#endif
    default:
      return {nullptr, nullptr};
  }
}

}  // namespace elliptude_kernels

namespace elliptude::python {

namespace {

using elliptude_kernels::FilterMeasurements;
using elliptude_kernels::FilterMemory;
using elliptude_kernels::FilterOutcomes;
using elliptude_kernels::FilterSettings;
using elliptude_kernels::Stop;

/// What stops all threads of a call: Ctrl-C, which the thread sees that Python called.
class StopOfAll {
 public:
  [[nodiscard]] Stop stop() noexcept {
    return {[](void* self) noexcept { return static_cast<StopOfAll*>(self)->asked(); }, this};
  }
  [[nodiscard]] bool asked() noexcept {
    if (!stopped_ && std::this_thread::get_id() == caller_ && signals_.stop(signals_.context)) {
      stopped_ = true;
    }
    return stopped_;
  }

 private:
  std::thread::id caller_ = std::this_thread::get_id();
  Interruption signals_ = interruption_by_signals();
  std::atomic<bool> stopped_{false};
};

[[nodiscard]] std::string of_filter(Index i) { return " of filter " + std::to_string(i); }

/// The first filter whose status is not `ok`, or how many there are.
[[nodiscard]] Index first_failure(const std::vector<int>& statuses) {
  return std::find_if(statuses.begin(), statuses.end(), [](int status) { return status != 0; }) - statuses.begin();
}

/// The directions of all filters, (m, 3) or (n, m, 3).
[[nodiscard]] Items directions_of(const py::object& directions, Index count) {
  Items items(directions, "directions", {any_length, 3});
  if (!items.leading().empty() && items.leading() != Shape{count}) {
    value_error("directions must have the shape (m, 3) or (" + std::to_string(count) +
                ", m, 3), one for each filter, not " + text(items.leading()) + " times " + text(items.item()));
  }
  if (items.item()[0] > static_cast<Index>(most_directions)) {
    value_error("directions must be at most " + std::to_string(most_directions) + " of each filter, not " +
                std::to_string(items.item()[0]));
  }
  return items;
}

/// The arguments of an update, and how the kernels have them.
class Measured {
 public:
  Measured(Index count, bool has_gyro, const py::object& directions, const py::object& reference,
           const py::object& bounds, const py::object& weights, const py::object& angular_velocity,
           const py::object& rate_bound) {
    if (directions.is_none() && angular_velocity.is_none()) {
      value_error("update needs directions, angular_velocity or both");
    }
    if (!directions.is_none()) {
      take_directions(count, directions, reference, bounds, weights);
    }
    if (!angular_velocity.is_none()) {
      if (has_gyro) {
        throw py::type_error("angular_velocity cannot update a GyroFlow: the gyro's rate is the input of predict");
      }
      if (rate_bound.is_none()) {
        value_error("angular_velocity needs rate_bound beside it");
      }
      rate_.emplace(angular_velocity, "angular_velocity", Shape{3}, count);
      rate_bound_ = one_bound(rate_bound, "rate_bound", false);
    }
  }

  [[nodiscard]] FilterMeasurements view() const noexcept {
    FilterMeasurements view{};
    if (body_) {
      view.directions = body_->item()[0];
      view.body = (*body_)[0];
      view.body_stride = body_->leading().empty() ? 0 : 3 * view.directions;
      view.reference = reference_->row(0);
      view.reference_stride = reference_->has_rows() ? 3 * view.directions : 0;
      view.bounds = bounds_.data();
      view.weights = weights_.data();
    }
    if (rate_) {
      view.rate = rate_->row(0);
      view.rate_stride = rate_->has_rows() ? 3 : 0;
      view.rate_bound = rate_bound_.data();
    }
    return view;
  }

  /// \throws ValueError of a direction of a filter without length.
  void require_lengths(Index i) const {
    const Index m = body_ ? body_->item()[0] : 0;
    for (Index k = 0; k < m; ++k) {
      const std::string there = "[" + std::to_string(i) + ", " + std::to_string(k) + "]";
      const double* body = (*body_)[body_->leading().empty() ? 0 : i];
      require_direction(Eigen::Map<const Vector3<double>>(body + 3 * k), "directions" + there);
      require_direction(Eigen::Map<const Vector3<double>>(reference_->row(i) + 3 * k), "reference" + there);
    }
  }

 private:
  void take_directions(Index count, const py::object& directions, const py::object& reference, const py::object& bounds,
                       const py::object& weights) {
    body_.emplace(directions_of(directions, count));
    const Index m = body_->item()[0];
    if (reference.is_none() || bounds.is_none()) {
      value_error("directions need reference and bounds beside them");
    }
    reference_.emplace(reference, "reference", Shape{m, 3}, count);
    const DirectionArguments arguments(bounds, weights, m);
    for (Index k = 0; k < m; ++k) {
      const Direction<double> direction = arguments.direction(k, reference_->row(0), (*body_)[0]);
      bounds_.insert(bounds_.end(), direction.bound.data(), direction.bound.data() + 9);
      weights_.push_back(direction.weight);
    }
  }

  std::optional<Items> body_;
  std::optional<LogInput> reference_;
  std::optional<LogInput> rate_;
  std::vector<double> bounds_;
  std::vector<double> weights_;
  Matrix3<double> rate_bound_ = Matrix3<double>::Zero();
};

}  // namespace

PythonFilters::PythonFilters(py::object flow, const py::object& attitude, const py::object& vector,
                             const py::object& shape, const py::object& time, std::string mode, std::string criterion,
                             const py::object& weight)
    : flow_(std::move(flow)), mode_(std::move(mode)), criterion_(std::move(criterion)) {
  time_ = single(time, "time", {}).number(0);
  const SizeCriterion<double, 6> size = size_criterion_of(criterion_, weight);
  settings_.criterion = criterion_ == "volume"  ? FilterSettings::Criterion::volume
                        : criterion_ == "trace" ? FilterSettings::Criterion::trace
                                                : FilterSettings::Criterion::weighted_trace;
  Eigen::Map<Matrix6<double>>(settings_.weight) = size.weight;
  if (mode_ != "paper" && mode_ != "first_order") {
    value_error("mode must be 'paper' or 'first_order', not '" + mode_ + "'");
  }
  settings_.is_first_order = mode_ == "first_order";
  set_flow();

  Items centers = attitudes(attitude, "attitude");
  Items vectors(vector, "vector", {3});
  Items shapes(shape, "shape", {6, 6});
  const Shape leading = broadcast({&centers, &vectors, &shapes});
  if (leading.size() != 1) {
    value_error(
        "attitude, vector and shape must be of n filters, with one dimension before that of each, but theirs are " +
        text(leading));
  }
  count_ = leading[0];
  stride_ = (static_cast<std::size_t>(count_) + FilterMemory::widest_register - 1) / FilterMemory::widest_register *
            FilterMemory::widest_register;
  numbers_.resize(FilterMemory::all * stride_);
  for (Index i = 0; i < count_; ++i) {
    const Matrix6<double> p = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(shapes[i]);
    const StateEllipsoid<BodyState> start{{centers.matrix3(i), vectors.vector<3>(i)}, p};
    if (const Status status = validate(start); status != Status::ok) {
      raise(status, shapes.label(i));
    }
    set(numbers_, FilterMemory::attitude, i, start.center.attitude);
    set(numbers_, FilterMemory::vector, i, start.center.angular_velocity);
    set(numbers_, FilterMemory::shape, i, p);
    set(numbers_, FilterMemory::transition, i, Matrix6<double>::Identity());
    set(numbers_, FilterMemory::prior_shape, i, p);
  }
}

void PythonFilters::set_flow() {
  if (elliptude_kernels::widest_for_filters().update == nullptr) {
    throw std::runtime_error("many filters at a time need a module that was compiled by GCC or Clang");
  }
  if (py::isinstance<BodyFlowSettings>(flow_)) {
    const auto& flow = flow_.cast<const BodyFlowSettings&>();
    has_kernel_ = (*flow.potential).describe(settings_.body);
    Eigen::Map<Matrix3<double>>(settings_.body.inertia) = flow.body.inertia();
    settings_.body.step = flow.step;
    settings_.body.order = flow.order;
    Eigen::Map<Matrix3<double>>(settings_.unknown_torque) = flow.unknown_torque;
    settings_.most_steps = flow.most_steps;
  } else if (py::isinstance<GyroFlowSettings>(flow_)) {
    const auto& flow = flow_.cast<const GyroFlowSettings&>();
    has_kernel_ = true;
    settings_.has_gyro = true;
    Eigen::Map<Matrix3<double>>(settings_.noise) = flow.noise;
    Eigen::Map<Matrix3<double>>(settings_.drift) = flow.drift;
  } else {
    throw py::type_error(std::string("flow must be a RigidBodyFlow or a GyroFlow, not ") +
                         Py_TYPE(flow_.ptr())->tp_name);
  }
}

py::object PythonFilters::weight() const {
  if (criterion_ != "weighted_trace") {
    return py::none();
  }
  return to_array(Matrix6<double>(Eigen::Map<const Matrix6<double>>(settings_.weight)));
}

void PythonFilters::resume(const py::object& transition, const py::object& prior_shape) {
  const std::unique_lock lock = exclusive(*mutex_);
  const LogInput a(transition, "transition", {6, 6}, count_);
  const LogInput p(prior_shape, "prior_shape", {6, 6}, count_);
  using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  std::vector<double> working = numbers_;
  for (Index i = 0; i < count_; ++i) {
    const Matrix6<double> prior = Eigen::Map<const RowMajor6>(p.row(i));
    raise_unless_ok(validate(Ellipsoid<double, 6>{Vector6<double>::Zero(), prior}), "prior_shape");
    set(working, FilterMemory::transition, i, Matrix6<double>(Eigen::Map<const RowMajor6>(a.row(i))));
    set(working, FilterMemory::prior_shape, i, prior);
  }
  numbers_ = working;
}

elliptude_kernels::FilterBlock PythonFilters::in_memory(std::vector<double>& numbers, Index first,
                                                        Index size) const noexcept {
  return {{numbers.data(), stride_}, static_cast<std::size_t>(first), static_cast<std::size_t>(size), time_};
}

void PythonFilters::predict(const py::object& time, const py::object& control_torque, const py::object& gyro,
                            const py::object& threads) {
  const std::unique_lock lock = exclusive(*mutex_);
  const double end = single(time, "time", {}).number(0);
  if (!(end >= time_)) {
    value_error("time must not go backwards, but is " + text(end) + " s after " + text(time_) + " s");
  }
  if (settings_.has_gyro && !control_torque.is_none()) {
    throw py::type_error("control_torque is an input of RigidBodyFlow; a GyroFlow knows no torque");
  }
  if (settings_.has_gyro && gyro.is_none()) {
    throw py::type_error("a GyroFlow needs gyro, the measured rates over the interval");
  }
  if (!settings_.has_gyro && !gyro.is_none()) {
    throw py::type_error(
        "gyro is the input of a GyroFlow; for a RigidBodyFlow measured rates go to update as angular_velocity");
  }
  const std::optional<LogInput> input = settings_.has_gyro ? log_input(gyro, "gyro", {3}, count_)
                                                           : log_input(control_torque, "control_torque", {3}, count_);
  constexpr double least_steps = 1 << 11;  // for which a thread is worth its start
  const double steps = settings_.has_gyro ? 1.0 : std::max(1.0, (end - time_) / settings_.body.step);
  const Index taken = thread_count(threads, static_cast<double>(count_) * steps / least_steps);
  std::vector<double> working = numbers_;
  std::vector<int> statuses(static_cast<std::size_t>(count_), 0);
  if (has_kernel_) {
    const py::gil_scoped_release release;
    constexpr std::array<double, 3> none{};
    StopOfAll stop;
    in_blocks(count_, block, taken, [&](Index first, Index size) {
      elliptude_kernels::widest_for_filters().predict(settings_, in_memory(working, first, size), end,
                                                      input ? input->row(0) : none.data(),
                                                      input && input->has_rows() ? 3 : 0, stop.stop(), statuses.data());
      return !stop.asked();
    });
    raise_if_interrupted(stop.asked() ? Status::interrupted : Status::ok);
  } else {
    predict_alone(end, input ? &*input : nullptr, working, statuses);
  }
  raise_unless_predicted(end, statuses);
  numbers_ = std::move(working);
  time_ = end;
}

/// A potential that no kernel has: one filter after the other, in this thread.
void PythonFilters::predict_alone(double time, const LogInput* input, std::vector<double>& numbers,
                                  std::vector<int>& statuses) {
  const auto& settings = flow_.cast<const BodyFlowSettings&>();
  Failure failure;
  BodyFlow flow;
  raise_unless_ok(BodyFlow::make(settings.body, HeldPotential{&*settings.potential, &failure}, settings.step,
                                 settings.order, settings.unknown_torque, flow),
                  "flow");
  raise_unless_ok(flow.set_most_steps(settings.most_steps), "most_steps");
  flow.set_interruption(interruption_by_signals());
  const SizeCriterion<double, 6> criterion = size_criterion_of(criterion_, weight());
  const py::gil_scoped_release release;
  for (Index i = 0; i < count_; ++i) {
    AttitudeFilter<BodyFlow, PaperEstimator> filter;  // a prediction does not depend on the mode
    const StateEllipsoid<BodyState> ellipsoid{
        {matrix<3, 3>(FilterMemory::attitude, i), matrix<3, 1>(FilterMemory::vector, i)},
        matrix<6, 6>(FilterMemory::shape, i)};
    Status status = filter.make(flow, criterion, time_, ellipsoid, filter);
    if (status == Status::ok) {
      status = filter.resume(matrix<6, 6>(FilterMemory::transition, i), matrix<6, 6>(FilterMemory::prior_shape, i));
    }
    if (status == Status::ok) {
      status =
          filter.predict(time, {input == nullptr ? Vector3<double>(Vector3<double>::Zero())
                                                 : Vector3<double>(Eigen::Map<const Vector3<double>>(input->row(i)))});
    }
    failure.rethrow();
    raise_if_interrupted(status);
    statuses[static_cast<std::size_t>(i)] = static_cast<int>(status);
    set(numbers, FilterMemory::attitude, i, filter.ellipsoid().center.attitude);
    set(numbers, FilterMemory::vector, i, filter.ellipsoid().center.angular_velocity);
    set(numbers, FilterMemory::shape, i, filter.ellipsoid().shape);
    set(numbers, FilterMemory::transition, i, filter.transition());
  }
}

void PythonFilters::raise_unless_predicted(double time, const std::vector<int>& statuses) const {
  const Index i = first_failure(statuses);
  if (i == count_) {
    return;
  }
  switch (const auto status = static_cast<Status>(statuses[static_cast<std::size_t>(i)])) {
    case Status::too_many_steps:
      raise_too_many_steps(time, time_, settings_.most_steps);
    case Status::unbounded:
      value_error("the set" + of_filter(i) + " has grown beyond all numbers by " + text(time) +
                  " s, without a measurement since " + text(time_) + " s");
    case Status::step_too_long:
      value_error(
          "step of the flow is too long: the turn within a stage must stay below a right angle, and the angular "
          "velocity" +
          of_filter(i) + " is " + text(matrix<3, 1>(FilterMemory::vector, i).norm()) + " rad/s");
    default:
      raise(status, "predict" + of_filter(i));
  }
}

py::object PythonFilters::update(const py::object& directions, const py::object& reference, const py::object& bounds,
                                 const py::object& weights, const py::object& angular_velocity,
                                 const py::object& rate_bound, const std::string& on_inconsistent,
                                 const py::object& threads) {
  const std::unique_lock lock = exclusive(*mutex_);
  if (on_inconsistent != "raise" && on_inconsistent != "skip") {
    value_error("on_inconsistent must be 'raise' or 'skip', not '" + on_inconsistent + "'");
  }
  const Measured measured(count_, settings_.has_gyro, directions, reference, bounds, weights, angular_velocity,
                          rate_bound);
  constexpr double least_filters = 1 << 8;  // for which a thread is worth its start
  const Index taken = thread_count(threads, static_cast<double>(count_) / least_filters);
  std::vector<double> working = numbers_;
  std::vector<int> statuses(static_cast<std::size_t>(count_), 0);
  Results shares({count_}, {});
  Results margins({count_}, {});
  std::fill_n(shares[0], count_, 1.0);
  std::fill_n(margins[0], count_, std::numeric_limits<double>::quiet_NaN());
  {
    const py::gil_scoped_release release;
    const FilterMeasurements view = measured.view();
    in_blocks(count_, block, taken, [&](Index first, Index size) {
      elliptude_kernels::widest_for_filters().update(settings_, in_memory(working, first, size), view,
                                                     FilterOutcomes{statuses.data(), shares[0], margins[0]});
      return true;
    });
  }
  py::array_t<bool> used(count_);
  for (Index i = 0; i < count_; ++i) {
    const auto status = static_cast<Status>(statuses[static_cast<std::size_t>(i)]);
    used.mutable_data()[i] = status == Status::ok;
    if (status == Status::empty_intersection && on_inconsistent == "raise") {
      throw InconsistentSets("measurement" + of_filter(i) + " at " + text(time_) +
                                 " s contradicts the prediction: the sets do not meet (margin " + text(*margins[i]) +
                                 "); some bound is wrong",
                             *margins[i], time_);
    }
    if (status != Status::ok && status != Status::empty_intersection) {
      measured.require_lengths(i);
      raise(status, "update" + of_filter(i));
    }
  }
  numbers_ = std::move(working);
  return py::module_::import("elliptude.results").attr("Updates")(shares.array(), margins.array(), used);
}

}  // namespace elliptude::python
