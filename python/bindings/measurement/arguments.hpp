#pragma once

/// \file
/// Arguments of the filters: bounds of errors, and measurements.

#include <elliptude/measurement/types.hpp>
#include <mutex>
#include <optional>

#include "arrays.hpp"

namespace elliptude::python {

/// The shape of an error's ellipsoid from what a user gives: a radius, or the shape matrix itself.
[[nodiscard]] Matrix3<double> bound_of(const double* data, bool is_radius);

/// \throws ValueError unless the shape is symmetric and positive (semi)definite.
void require_bound(const Matrix3<double>& bound, bool may_be_flat, const std::string& label);

/// One bound: a radius () or a shape matrix (3, 3).
[[nodiscard]] Matrix3<double> one_bound(const py::object& value, const std::string& name, bool may_be_flat);

/// Bounds of m directions: a radius for all, (m,) radii or (m, 3, 3) shape matrices.
[[nodiscard]] std::vector<Matrix3<double>> direction_bounds(const py::object& value, Index m);

/// Directions of one moment, checked as far as does not need their values.
class DirectionArguments {
 public:
  DirectionArguments(const py::object& bounds, const py::object& weights, Index m);

  [[nodiscard]] Direction<double> direction(Index i, const double* reference, const double* body) const noexcept {
    const auto k = static_cast<std::size_t>(i);
    return {Eigen::Map<const Vector3<double>>(reference), Eigen::Map<const Vector3<double>>(body), bounds_[k],
            weights_[k]};
  }

 private:
  std::vector<Matrix3<double>> bounds_;
  std::vector<double> weights_;
};

/// \throws ValueError of a direction without length.
void require_direction(const Vector3<double>& direction, const std::string& label);

/// A row that was not measured is all NaN; one that is so in part is an error.
[[nodiscard]] inline bool is_absent(const Vector3<double>& row) noexcept { return row.array().isNaN().all(); }

void require_measured(const Vector3<double>& row, const std::string& label);

/// A column (n, 3) of optional rows: a row of NaN is absent. Empty if the argument is None.
class OptionalRows {
 public:
  OptionalRows(const py::object& value, const std::string& name, Index rows) {
    if (!value.is_none()) {
      items_.emplace(value, name, Shape{rows, 3}, Items::Require::anything, Items::Batch::none);
    }
  }
  [[nodiscard]] bool given() const noexcept { return items_.has_value(); }
  [[nodiscard]] std::optional<Vector3<double>> row(Index i) const {
    const Vector3<double> value = Eigen::Map<const Vector3<double>>((*items_)[0] + 3 * i);
    return is_absent(value) ? std::nullopt : std::optional(value);
  }

 private:
  std::optional<Items> items_;
};

/// An argument of a log that is not None: one item for all rows, or one for each.
class LogInput {
 public:
  /// \throws TypeError, ValueError with the argument's name.
  LogInput(const py::object& value, const std::string& name, const Shape& item, Index rows,
           Items::Require require = Items::Require::finite);

  [[nodiscard]] bool has_rows() const noexcept { return !items_.leading().empty(); }
  [[nodiscard]] const double* row(Index i) const noexcept { return items_[has_rows() ? i : 0]; }

 private:
  Items items_;
};

/// `LogInput`, or empty if the argument is None.
[[nodiscard]] std::optional<LogInput> log_input(const py::object& value, const std::string& name, const Shape& item,
                                                Index rows, Items::Require require = Items::Require::finite);

/// y = H x + v of one to six rows, v in the ellipsoid of the shape `bound`.
class LinearArguments {
 public:
  /// \throws TypeError, ValueError with the argument's name.
  LinearArguments(const py::object& y, const py::object& h, const py::object& bound);

  [[nodiscard]] Index rows() const noexcept { return y_.item()[0]; }
  template <int Rows>
  [[nodiscard]] LinearMeasurement<double, Rows> measurement() const {
    return {y_.vector<Rows>(0), h_.dynamic_matrix(), bound_.dynamic_matrix()};
  }

 private:
  Items y_;
  Items h_;
  Items bound_;
};

/// Allows one call of a filter at a time: waiting for another thread could take for ever, because that one may wait for the
/// interpreter's lock. \throws RuntimeError.
[[nodiscard]] std::unique_lock<std::mutex> exclusive(std::mutex& mutex);

/// The size criterion that `criterion` and `weight` name. \throws ValueError.
[[nodiscard]] SizeCriterion<double, 6> size_criterion_of(const std::string& criterion, const py::object& weight);

}  // namespace elliptude::python
