#pragma once

/// \file
/// The recording that is replayed: what its sensors and their bounds are. `record.cpp` makes it.

namespace flight {

/// What was measured at one moment.
struct Row {
  double time;              ///< s
  double directions[4][3];  ///< of `references`, in body axes
  double rate[3];           ///< rad/s
};

constexpr int rows = 201;
constexpr double interval = 0.1;            ///< s
constexpr double moments[3] = {1, 2.8, 2};  ///< of inertia, kg m²
/// Of the gravity gradient, rad/s, as if the orbit were a low one; the frame's axes are those of the reference.
constexpr double orbit_rate = 0.0011;
constexpr double direction_bound = 0.01;  ///< rad
constexpr double rate_bound = 0.01;       ///< rad/s
constexpr double references[4][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.6, 0, -0.8}};

}  // namespace flight
