#pragma once

/// \file
/// State ellipsoids as Python has them.

#include <elliptude/state.hpp>

#include "arrays.hpp"

namespace elliptude::python {

using BodyState = RigidBodyState<double>;

/// A state ellipsoid of either flow: attitude, and angular velocity or gyro bias.
struct AnyStateEllipsoid {
  Matrix3<double> attitude;
  Vector3<double> vector;
  Matrix6<double> shape;

  template <typename State>
  [[nodiscard]] StateEllipsoid<State> as() const noexcept {
    return {State{attitude, vector}, shape};
  }
  template <typename State>
  [[nodiscard]] static AnyStateEllipsoid from(const StateEllipsoid<State>& ellipsoid) noexcept {
    return {ellipsoid.center.attitude, vector_part(ellipsoid.center), ellipsoid.shape};
  }
};

[[nodiscard]] AnyStateEllipsoid make_state_ellipsoid(const py::object& attitude, const py::object& vector,
                                                     const py::object& shape);

/// An `elliptude.Extent`.
[[nodiscard]] py::object extent_of(const AnyStateEllipsoid& self);

}  // namespace elliptude::python
