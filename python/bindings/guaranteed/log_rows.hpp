#pragma once

/// \file
/// What a guaranteed filter is after each row of a log, as arrays.

#include <algorithm>
#include <limits>
#include <optional>

#include "attitude/state_ellipsoid.hpp"
#include "guaranteed/measurements.hpp"
#include "guaranteed/policies.hpp"

namespace elliptude::python {

/// The rows of a GuaranteedLog, as they come.
class LogRows {
  static constexpr double nan = std::numeric_limits<double>::quiet_NaN();

 public:
  /// \param vertical none: no bounds of tilt and heading are asked for.
  LogRows(Index rows, Index directions, const std::optional<Vector3<double>>& vertical)
      : sensors_(directions + 2),
        vertical_(vertical),
        bounds_({vertical ? rows : 0}, {4}),
        attitudes_({rows}, {3, 3}),
        vectors_({rows}, {3}),
        shapes_({rows}, {6, 6}),
        margins_({rows}, {}),
        claims_(rows),
        prediction_used_(rows),
        updated_(rows),
        dropped_({rows, sensors_}),
        claim_data_(claims_.mutable_data()),
        used_data_(prediction_used_.mutable_data()),
        updated_data_(updated_.mutable_data()),
        dropped_data_(dropped_.mutable_data()) {}

  /// What a filter is after a row. Needs no interpreter's lock.
  template <typename Filter>
  void set(Index row, const Filter& filter, const Measured& measured, const GuaranteedUpdate<double>& update) {
    updated_data_[row] = measured.any();
    std::fill_n(dropped_data_ + row * sensors_, sensors_, false);
    measured.for_each(update.dropped, sensors_ - 2,
                      [&](Index column) { dropped_data_[row * sensors_ + column] = true; });
    used_data_[row] = measured.any() ? update.prediction_used : filter.knows_attitude();
    margins_.set(row, update.margin);
    claim_data_[row] = code_of(filter.claim());
    if (filter.knows_attitude()) {
      const auto& set = filter.ellipsoid();
      attitudes_.set(row, set.center.attitude);
      vectors_.set(row, vector_part(set.center));
      shapes_.set(row, set.shape);
    } else {
      attitudes_.set(row, Matrix3<double>(Matrix3<double>::Constant(nan)));
      vectors_.set(row, Vector3<double>(Vector3<double>::Constant(nan)));
      shapes_.set(row, Matrix6<double>(Matrix6<double>::Constant(nan)));
    }
    if (vertical_) {
      AttitudeBounds<double> found{nan, nan, nan, nan};
      if (filter.knows_attitude()) {
        raise_unless_ok(filter.bounds(*vertical_, found), "bounds");
      }
      bounds_.set(row, Vector<double, 4>(found.tilt, found.heading_from, found.heading_to, found.angle));
    }
  }

  [[nodiscard]] py::object log(const Items& time) {
    return py::module_::import("elliptude.results")
        .attr("GuaranteedLog")(to_array(time.dynamic_vector()), attitudes_.array(), vectors_.array(), shapes_.array(),
                               claims_, prediction_used_, updated_, dropped_, margins_.array(),
                               vertical_ ? py::object(bounds_.array()) : py::object(py::none()));
  }

 private:
  Index sensors_;
  std::optional<Vector3<double>> vertical_;
  Results bounds_;
  Results attitudes_;
  Results vectors_;
  Results shapes_;
  Results margins_;
  py::array_t<std::uint8_t> claims_;
  py::array_t<bool> prediction_used_;
  py::array_t<bool> updated_;
  py::array_t<bool> dropped_;
  std::uint8_t* claim_data_;
  bool* used_data_;
  bool* updated_data_;
  bool* dropped_data_;
};

}  // namespace elliptude::python
