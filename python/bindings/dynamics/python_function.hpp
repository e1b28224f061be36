#pragma once

/// \file
/// Functions of (attitude, time) that are written in Python, as the core calls them.

#include <limits>

#include "dynamics/potential.hpp"

namespace elliptude::python {

/// What the core takes for a failure.
inline constexpr double failed_number = std::numeric_limits<double>::quiet_NaN();
inline const Vector3<double> failed_vector = Vector3<double>::Constant(failed_number);
inline const Matrix3<double> failed_matrix = Matrix3<double>::Constant(failed_number);

/// f() with the interpreter's lock; `failed` after a failure, its own or an earlier one.
template <typename Result, typename Function>
[[nodiscard]] Result guarded(Failure& failure, const Result& failed, const Function& f) noexcept {
  if (failure.happened()) {
    return failed;
  }
  const py::gil_scoped_acquire acquire;
  try {
    return f();
  } catch (...) {
    failure.keep_current_exception();
    return failed;
  }
}

/// What a function of (attitude, time) written in Python returns, checked.
[[nodiscard]] inline Items called(const py::object& function, const std::string& name, const Shape& item,
                                  const Matrix3<double>& attitude, double time) {
  return single(function(to_array(attitude), time), name + "(attitude, time)", item);
}

/// \throws ValueError unless it is a finite number that is not negative.
[[nodiscard]] inline double curvature_bound(const py::object& value) {
  const double bound = single(value, "torque_curvature_bound", {}).number(0);
  if (!(bound >= 0)) {
    value_error("torque_curvature_bound must not be negative, but is " + text(bound));
  }
  return bound;
}

}  // namespace elliptude::python
