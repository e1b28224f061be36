#pragma once

/// \file
/// The log that a first-order filter runs over: what each row holds, and what the filter is after it.

#include <elliptude/first_order/filter.hpp>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "measurement/arguments.hpp"

namespace elliptude::python {

/// What the rows of a log measured. NaN where a sensor has nothing to say.
class FirstOrderMeasurements {
 public:
  /// \throws TypeError, ValueError with the argument's name.
  FirstOrderMeasurements(Index rows, const py::object& directions, const py::object& reference,
                         const py::object& bounds, const py::object& weights, const py::object& angular_velocity,
                         const py::object& rate_bound)
      : rates_(angular_velocity, "angular_velocity", rows) {
    if (!directions.is_none()) {
      body_.emplace(directions, "directions", Shape{rows, any_length, 3}, Items::Require::anything, Items::Batch::none);
      count_ = body_->item()[1];
      if (reference.is_none() || bounds.is_none()) {
        value_error("directions need reference and bounds beside them");
      }
      references_.emplace(reference, "reference", Shape{count_, 3}, rows);
      arguments_.emplace(bounds, weights, count_);
    }
    if (rates_.given()) {
      if (rate_bound.is_none()) {
        value_error("angular_velocity needs rate_bound beside it");
      }
      rate_bound_ = one_bound(rate_bound, "rate_bound", false);
    }
  }

  /// How many directions a row has at most.
  [[nodiscard]] Index directions() const noexcept { return count_; }

  /// Whether direction k was measured in a row.
  [[nodiscard]] bool has_direction(Index row, Index k) const {
    return !is_absent(Eigen::Map<const Vector3<double>>(body(row, k)));
  }

  /// The directions that were measured in a row.
  /// \throws ValueError of one that is not finite or has no length.
  void read_directions(Index row, std::vector<Direction<double>>& present) const {
    present.clear();
    for (Index k = 0; k < count_; ++k) {
      if (has_direction(row, k)) {
        present.push_back(arguments_->direction(k, references_->row(row) + 3 * k, body(row, k)));
        require_measured(present.back().body, "directions[" + std::to_string(row) + ", " + std::to_string(k) + "]");
      }
    }
  }

  /// The angular velocity of a row, if it was measured.
  /// \throws ValueError of one that is not finite.
  [[nodiscard]] std::optional<AngularVelocity<double>> rate(Index row) const {
    if (!rates_.given()) {
      return std::nullopt;
    }
    const std::optional<Vector3<double>> value = rates_.row(row);
    if (!value) {
      return std::nullopt;
    }
    require_measured(*value, "angular_velocity[" + std::to_string(row) + "]");
    return AngularVelocity<double>{*value, rate_bound_};
  }

 private:
  [[nodiscard]] const double* body(Index row, Index k) const { return (*body_)[0] + 3 * (row * count_ + k); }

  Index count_ = 0;
  std::optional<Items> body_;
  std::optional<LogInput> references_;
  std::optional<DirectionArguments> arguments_;
  OptionalRows rates_;
  Matrix3<double> rate_bound_ = Matrix3<double>::Zero();
};

/// The input of the flow over the interval that ends at a row: the torque of that row, or the gyro's rate of the one
/// before.
class FirstOrderInputs {
 public:
  /// \param has_gyro of which flow; the other's argument must be None.
  /// \throws TypeError, ValueError with the argument's name.
  FirstOrderInputs(Index rows, bool has_gyro, const py::object& gyro, const py::object& control_torque) {
    if (has_gyro) {
      if (!control_torque.is_none()) {
        throw py::type_error("control_torque is an input of RigidBodyFlow; a GyroFlow knows no torque");
      }
      if (gyro.is_none()) {
        throw py::type_error("a GyroFlow needs gyro, the measured rates");
      }
      rates_.emplace(single(gyro, "gyro", {rows, 3}));
    } else {
      if (!gyro.is_none()) {
        throw py::type_error("gyro is the input of a GyroFlow; for a RigidBodyFlow give the rates as angular_velocity");
      }
      torques_ = log_input(control_torque, "control_torque", {3}, rows);
    }
  }

  [[nodiscard]] Vector3<double> at(Index row) const {
    if (rates_) {
      return Eigen::Map<const Vector3<double>>((*rates_)[0] + 3 * std::max<Index>(row - 1, 0));
    }
    return torques_ ? Vector3<double>(Eigen::Map<const Vector3<double>>(torques_->row(row)))
                    : Vector3<double>(Vector3<double>::Zero());
  }

 private:
  std::optional<Items> rates_;
  std::optional<LogInput> torques_;
};

/// The rows of a FilterLog, as they come.
class FirstOrderLogRows {
 public:
  /// What happened at a row of a log.
  enum class Outcome : std::uint8_t { updated, predicted, refused };

  FirstOrderLogRows(Index rows, Index directions)
      : sensors_(directions + 1),
        attitudes_({rows}, {3, 3}),
        vectors_({rows}, {3}),
        shapes_({rows}, {6, 6}),
        shares_({rows}, {}),
        margins_({rows}, {}),
        used_({rows, sensors_}),
        outcomes_(rows),
        used_data_(used_.mutable_data()),
        outcome_data_(outcomes_.mutable_data()) {}

  /// What a filter is after a row. Needs no interpreter's lock.
  template <typename Filter>
  void set(Index row, const Filter& filter, const FirstOrderMeasurements& measured, const Update<double>& update,
           Outcome outcome) {
    const auto& ellipsoid = filter.ellipsoid();
    attitudes_.set(row, ellipsoid.center.attitude);
    vectors_.set(row, vector_part(ellipsoid.center));
    shapes_.set(row, ellipsoid.shape);
    shares_.set(row, update.share);
    margins_.set(row, outcome == Outcome::predicted ? std::numeric_limits<double>::quiet_NaN() : update.margin);
    outcome_data_[row] = static_cast<std::uint8_t>(outcome);
    bool* used = used_data_ + row * sensors_;
    for (Index k = 0; k < sensors_ - 1; ++k) {
      used[k] = outcome == Outcome::updated && measured.has_direction(row, k);
    }
    used[sensors_ - 1] = outcome == Outcome::updated && measured.rate(row).has_value();
  }

  [[nodiscard]] py::object log(const Items& time) {
    return py::module_::import("elliptude.results")
        .attr("FilterLog")(to_array(time.dynamic_vector()), attitudes_.array(), vectors_.array(), shapes_.array(),
                           shares_.array(), margins_.array(), used_, outcomes_);
  }

 private:
  Index sensors_;
  Results attitudes_;
  Results vectors_;
  Results shapes_;
  Results shares_;
  Results margins_;
  py::array_t<bool> used_;
  py::array_t<std::uint8_t> outcomes_;
  bool* used_data_;
  std::uint8_t* outcome_data_;
};

}  // namespace elliptude::python
