#include "guaranteed/measurements.hpp"

namespace elliptude::python {

namespace {

const double pi = scalar::pi<double>();

/// \throws ValueError of an angle of half a turn or more, which bounds nothing.
void require_below_half_turn(const Matrix3<double>& bound, const std::string& label) {
  if (!(spectral_norm(bound) < pi * pi)) {
    value_error(label + " must be below pi rad: an error of half a turn is no bound");
  }
}

void require_direction_count(Index m) {
  constexpr auto most = static_cast<Index>(most_directions);
  if (m < 1 || m > most) {
    value_error("directions must be 1 to " + std::to_string(most) + ", not " + std::to_string(m));
  }
}

}  // namespace

// --- one moment --------------------------------------------------------------------------------------------------------

Measured measured_of(const py::object& directions, const py::object& reference, const py::object& bounds,
                     const py::object& angular_velocity, const py::object& rate_bound, const py::object& attitude,
                     const py::object& attitude_bound) {
  Measured measured;
  if (!directions.is_none()) {
    const Items body = single(directions, "directions", {any_length, 3});
    const Index m = body.item()[0];
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
  return measured;
}

// --- names -------------------------------------------------------------------------------------------------------------

SensorNames::SensorNames(const py::object& names, Index m, bool has_rate, bool has_attitude)
    : given_(!names.is_none()), m_(m) {
  if (!given_) {
    return;
  }
  if (py::isinstance<py::str>(names)) {
    throw py::type_error("sensors must be a sequence of names, not one str");
  }
  if (!py::isinstance<py::iterable>(names)) {
    throw py::type_error(std::string("sensors must be a sequence of names, not ") + Py_TYPE(names.ptr())->tp_name);
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

std::string SensorNames::text_of(Index column) const {
  if (given_) {
    return names_[static_cast<std::size_t>(column)];
  }
  return column == m_ ? "angular_velocity" : column == m_ + 1 ? "attitude" : "direction " + std::to_string(column);
}

py::object SensorNames::object_of(Index column) const {
  return !given_ && column < m_ ? py::object(py::int_(column)) : py::object(py::str(text_of(column)));
}

// --- a whole log -------------------------------------------------------------------------------------------------------

LogBounds::LogBounds(const py::object& value, const std::string& name, Index rows, Index columns, double limit)
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
    value_error(name + " must be a number or have the shape " +
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

std::optional<Matrix3<double>> LogBounds::at(Index row, Index column) const {
  if (!is_radius_) {
    return matrices_[static_cast<std::size_t>(column)];
  }
  const double* radius = numbers_[row * row_stride_ + column * column_stride_];
  return *radius < limit_ ? std::optional(bound_of(radius, true)) : std::nullopt;
}

MeasuredLog::MeasuredLog(Index rows, const py::object& directions, const py::object& reference,
                         const py::object& bounds, const py::object& angular_velocity, const py::object& rate_bound,
                         const py::object& attitude, const py::object& attitude_bound)
    : rates_(angular_velocity, "angular_velocity", rows) {
  constexpr auto anything = Items::Require::anything;
  if (!directions.is_none()) {
    directions_.emplace(directions, "directions", Shape{rows, any_length, 3}, anything, Items::Batch::none);
    m_ = directions_->item()[1];
    require_direction_count(m_);
    references_.emplace(reference, "reference", Shape{m_, 3}, rows, anything);
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

void MeasuredLog::read(Index row, Measured& measured) const {
  measured.directions.clear();
  measured.columns.clear();
  for (Index j = 0; j < m_; ++j) {
    const Vector3<double> body = Eigen::Map<const Vector3<double>>((*directions_)[0] + 3 * (row * m_ + j));
    const std::optional<Matrix3<double>> bound = bounds_->at(row, j);
    if (is_absent(body) || !bound) {
      continue;
    }
    const Vector3<double> reference = Eigen::Map<const Vector3<double>>(references_->row(row) + 3 * j);
    if (!scalar::all_finite(body) || !(scalar::length(body) > 0)) {
      const std::string label = "directions[" + std::to_string(row) + ", " + std::to_string(j) + "]";
      require_measured(body, label);
      require_direction(body, label);
    }
    if (!scalar::all_finite(reference) || !(scalar::length(reference) > 0)) {
      const std::string label =
          "reference[" + (references_->has_rows() ? std::to_string(row) + ", " : "") + std::to_string(j) + "]";
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

}  // namespace elliptude::python
