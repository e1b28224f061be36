#pragma once

/// \file
/// What all operations need: short names, numbers that are the same in every run, and an end of what fails.

#include <cmath>
#include <cstdlib>
#include <elliptude/base/scalar.hpp>
#include <elliptude/sets/ellipsoid.hpp>
#include <random>

namespace elliptude::operations {

using Vector3d = Vector3<double>;
using Matrix3d = Matrix3<double>;
using Ellipsoid6 = Ellipsoid<double, 6>;

inline void expect_ok(Status status) {
  if (status != Status::ok) {
    std::abort();  // a benchmark of a failure would be a very good one
  }
}

class Random {
 public:
  double uniform(double low, double high) {
    return low + (high - low) * std::ldexp(static_cast<double>(engine_() >> 11), -53);
  }
  Vector3d in_cube(double half_side) {
    const double x = uniform(-half_side, half_side);
    const double y = uniform(-half_side, half_side);
    return {x, y, uniform(-half_side, half_side)};
  }

 private:
  std::mt19937_64 engine_{1};
};

}  // namespace elliptude::operations
