#pragma once

/// \file
/// Measurements of the guaranteed filter, of one moment or of a log, with their bounds and the names of their sensors.

#include <elliptude/guaranteed/filter.hpp>

#include "measurement/arguments.hpp"

namespace elliptude::python {

/// The measurements of one moment.
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

/// The arguments of measurements of one moment, each with its bound beside it or None. \throws TypeError, ValueError.
[[nodiscard]] Measured measured_of(const py::object& directions, const py::object& reference, const py::object& bounds,
                                   const py::object& angular_velocity, const py::object& rate_bound,
                                   const py::object& attitude, const py::object& attitude_bound);

/// Names of sensors: the user's, or their index.
class SensorNames {
 public:
  /// \param m how many directions there are.
  /// \throws TypeError, ValueError.
  SensorNames(const py::object& names, Index m, bool has_rate, bool has_attitude);

  [[nodiscard]] std::string text_of(Index column) const;
  /// A direction without a name is its index.
  [[nodiscard]] py::object object_of(Index column) const;
  [[nodiscard]] Index directions() const noexcept { return m_; }

 private:
  bool given_;
  Index m_;
  std::vector<std::string> names_;
};

/// Bounds of the measurements of a log, in rows and columns: one radius for all, one for each column, one for each row and
/// column, or a shape matrix for each column. A radius of NaN, or at least the limit, means no measurement.
class LogBounds {
 public:
  /// \param columns 0 for a measurement without columns: one in each row.
  /// \throws TypeError, ValueError with the argument's name.
  LogBounds(const py::object& value, const std::string& name, Index rows, Index columns, double limit);

  /// The bound's shape, or nothing where nothing was measured.
  [[nodiscard]] std::optional<Matrix3<double>> at(Index row, Index column) const;

 private:
  Items numbers_;
  double limit_;
  bool is_radius_ = true;
  Index row_stride_ = 0;
  Index column_stride_ = 0;
  std::vector<Matrix3<double>> matrices_;
};

/// The measurements of a log, checked as far as does not need their values.
class MeasuredLog {
 public:
  /// \throws TypeError, ValueError with the argument's name.
  MeasuredLog(Index rows, const py::object& directions, const py::object& reference, const py::object& bounds,
              const py::object& angular_velocity, const py::object& rate_bound, const py::object& attitude,
              const py::object& attitude_bound);

  [[nodiscard]] Index directions() const noexcept { return m_; }

  /// \throws ValueError of a row that is neither measured nor all NaN.
  void read(Index row, Measured& measured) const;

 private:
  Index m_ = 0;
  std::optional<Items> directions_;
  std::optional<LogInput> references_;
  std::optional<LogBounds> bounds_;
  OptionalRows rates_;
  std::optional<LogBounds> rate_bounds_;
  std::optional<Items> attitudes_;
  std::optional<LogBounds> attitude_bounds_;
};

}  // namespace elliptude::python
