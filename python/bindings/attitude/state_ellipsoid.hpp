#pragma once

/// \file
/// State ellipsoids as Python has them.

#include <elliptude/attitude/state_ellipsoid.hpp>

#include "arrays.hpp"

namespace elliptude::python {

using BodyState = RigidBodyState<double>;

/// A state ellipsoid of either flow, attitude and angular velocity or gyro bias, in either chart.
struct AnyStateEllipsoid {
  Matrix3<double> attitude;
  Vector3<double> vector;
  Matrix6<double> shape;
  bool is_gibbs;

  template <typename State, typename Chart = ExponentialChart>
  [[nodiscard]] StateEllipsoid<State, Chart> as() const noexcept {
    return {State{attitude, vector}, shape};
  }
  template <typename State, typename Chart>
  [[nodiscard]] static AnyStateEllipsoid from(const StateEllipsoid<State, Chart>& ellipsoid) noexcept {
    return {ellipsoid.center.attitude, vector_part(ellipsoid.center), ellipsoid.shape,
            std::is_same_v<Chart, GibbsChart>};
  }
  /// f of the ellipsoid in its chart, as one of a rigid body: what does not depend on the flow.
  template <typename Function>
  [[nodiscard]] auto in_chart(const Function& f) const {
    return is_gibbs ? f(as<BodyState, GibbsChart>()) : f(as<BodyState>());
  }
  [[nodiscard]] const char* chart() const noexcept { return is_gibbs ? "gibbs" : "exponential"; }
};

/// \throws ValueError.
[[nodiscard]] AnyStateEllipsoid make_state_ellipsoid(const py::object& attitude, const py::object& vector,
                                                     const py::object& shape, const std::string& chart);

/// An array (6, 6) that is one item. \throws ValueError.
[[nodiscard]] Matrix6<double> single_matrix6(const py::object& value, const std::string& name);

/// An `elliptude.Extent`.
[[nodiscard]] py::object extent_of(const AnyStateEllipsoid& self);

}  // namespace elliptude::python
