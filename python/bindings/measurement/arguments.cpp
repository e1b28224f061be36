#include "measurement/arguments.hpp"

#include <elliptude/measurement/linearization.hpp>

namespace elliptude::python {

Matrix3<double> bound_of(const double* data, bool is_radius) {
  return is_radius ? Matrix3<double>(data[0] * data[0] * Matrix3<double>::Identity())
                   : Matrix3<double>(Eigen::Map<const RowMajor3>(data));
}

void require_bound(const Matrix3<double>& bound, bool may_be_flat, const std::string& label) {
  const Status status = validate(Ellipsoid<double, 3>{Vector3<double>::Zero(), bound});
  raise_unless_ok(status, label);
  Matrix3<double> factor;
  if (!may_be_flat && cholesky(bound, factor) != Status::ok) {
    value_error(label + " must be positive: a radius above 0, or a positive definite shape matrix");
  }
}

namespace {

/// A radius whose square is beyond the domain: it must not count as zero, nor as infinite.
void require_radius(double radius, const Matrix3<double>& bound, const std::string& label) {
  if (radius > 0 && (bound(0, 0) == 0 || !is_in_domain(bound))) {
    raise(Status::beyond_domain, label + " = " + text(radius));
  }
}

}  // namespace

Matrix3<double> one_bound(const py::object& value, const std::string& name, bool may_be_flat) {
  const Items numbers(value, name, {});
  const bool is_radius = numbers.leading().empty();
  if (!is_radius && numbers.leading() != Shape{3, 3}) {
    value_error(name + " must be a number (a radius) or have the shape (3, 3), not " + text(numbers.leading()));
  }
  if (is_radius && numbers.number(0) < 0) {
    value_error(name + " must not be negative, but is " + text(numbers.number(0)));
  }
  const Matrix3<double> bound = bound_of(numbers[0], is_radius);
  if (is_radius) {
    require_radius(numbers.number(0), bound, name);
  }
  require_bound(bound, may_be_flat, name);
  return bound;
}

std::vector<Matrix3<double>> direction_bounds(const py::object& value, Index m) {
  const Items numbers(value, "bounds", {});
  const Shape& shape = numbers.leading();
  const bool is_radius = shape.size() < 2;
  if (!(shape.empty() || shape == Shape{m} || shape == Shape{m, 3, 3})) {
    value_error("bounds must be a number or have the shape (" + std::to_string(m) + ",) or (" + std::to_string(m) +
                ", 3, 3) for " + std::to_string(m) + " directions, not " + text(shape));
  }
  std::vector<Matrix3<double>> bounds;
  for (Index i = 0; i < m; ++i) {
    const Index offset = shape.empty() ? 0 : (is_radius ? i : 9 * i);
    const std::string label = shape.empty() ? "bounds" : "bounds[" + std::to_string(i) + "]";
    if (is_radius && !(numbers.number(offset) > 0)) {
      value_error(label + " must be positive, but is " + text(numbers.number(offset)) + " rad");
    }
    bounds.push_back(bound_of(numbers[offset], is_radius));
    if (is_radius) {
      require_radius(numbers.number(offset), bounds.back(), label);
    }
    require_bound(bounds.back(), false, label);
  }
  return bounds;
}

DirectionArguments::DirectionArguments(const py::object& bounds, const py::object& weights, Index m)
    : bounds_(direction_bounds(bounds, m)), weights_(static_cast<std::size_t>(m), 1.0) {
  constexpr auto most = static_cast<Index>(MeasuredDirections<double>::most_directions);
  if (m < 1 || m > most) {
    value_error("directions must be 1 to " + std::to_string(most) + ", not " + std::to_string(m));
  }
  if (!weights.is_none()) {
    const Items given = single(weights, "weights", {m});
    for (Index i = 0; i < m; ++i) {
      const double weight = given[0][i];
      if (!(weight > 0)) {
        value_error("weights must be positive, but weights[" + std::to_string(i) + "] is " + text(weight));
      }
      weights_[static_cast<std::size_t>(i)] = weight;
    }
  }
}

void require_direction(const Vector3<double>& direction, const std::string& label) {
  if (!(scalar::length(direction) > 0)) {
    value_error(label + " has no length: a direction must not be zero");
  }
}

void require_measured(const Vector3<double>& row, const std::string& label) {
  if (!scalar::all_finite(row)) {
    value_error(label + " must be finite, or all NaN where nothing was measured");
  }
}

LogInput::LogInput(const py::object& value, const std::string& name, const Shape& item, Index rows,
                   Items::Require require)
    : items_(value, name, item, require) {
  if (has_rows() && items_.leading() != Shape{rows}) {
    Shape all{rows};
    all.insert(all.end(), item.begin(), item.end());
    value_error(name + " must have the shape " + text(item) + " or " + text(all) + ", not " + text(items_.leading()) +
                (item.empty() ? "" : " times " + text(item)));
  }
}

std::optional<LogInput> log_input(const py::object& value, const std::string& name, const Shape& item, Index rows,
                                  Items::Require require) {
  return value.is_none() ? std::nullopt : std::optional<LogInput>(std::in_place, value, name, item, rows, require);
}

namespace {

/// \throws ValueError of a measurement with more rows than the state.
[[nodiscard]] Items measured_rows(const py::object& y) {
  Items values = single(y, "y", {any_length});
  if (values.item()[0] > 6) {
    value_error("y must have 1 to 6 rows, not " + std::to_string(values.item()[0]));
  }
  return values;
}

}  // namespace

LinearArguments::LinearArguments(const py::object& y, const py::object& h, const py::object& bound)
    : y_(measured_rows(y)), h_(single(h, "h", {rows(), 6})), bound_(single(bound, "bound", {rows(), rows()})) {}

std::unique_lock<std::mutex> exclusive(std::mutex& mutex) {
  std::unique_lock lock(mutex, std::try_to_lock);
  if (!lock.owns_lock()) {
    throw std::runtime_error("the filter is in use by another thread");
  }
  return lock;
}

SizeCriterion<double, 6> size_criterion_of(const std::string& criterion, const py::object& weight) {
  using Size = SizeCriterion<double, 6>;
  if (criterion == "weighted_trace") {
    if (weight.is_none()) {
      value_error("criterion 'weighted_trace' needs weight, a (6, 6) matrix");
    }
    const Matrix6<double> matrix =
        Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(single(weight, "weight", {6, 6})[0]);
    raise_unless_ok(validate(Size::weighted_trace(matrix)), "weight");
    return Size::weighted_trace(matrix);
  }
  if (!weight.is_none()) {
    value_error("weight goes with criterion 'weighted_trace', not '" + criterion + "'");
  }
  if (criterion == "trace") {
    return Size::trace();
  }
  if (criterion == "volume") {
    return Size::volume();
  }
  value_error("criterion must be 'trace', 'weighted_trace' or 'volume', not '" + criterion + "'");
}

}  // namespace elliptude::python
