#pragma once

/// \file
/// The continuous motion of a rigid body, from an integrator that shares nothing with the library's: Gragg, Bulirsch and
/// Stoer's extrapolation of the modified midpoint rule, in long double, on the plain differential equations
/// Ċ = C S(ω), Jω̇ = Jω × ω + M, with no rotation formula at all.

#include <Eigen/Dense>
#include <array>
#include <functional>

namespace elliptude::testing {

using Real = long double;
using RealVector = Eigen::Matrix<Real, 3, 1>;
using RealMatrix = Eigen::Matrix<Real, 3, 3>;

struct Motion {
  RealMatrix attitude;
  RealVector angular_velocity;
};

/// The torque on the body, in body axes, at an attitude and a time.
using RealTorque = std::function<RealVector(const RealMatrix& attitude, Real time)>;

/// The motion after `duration`, in `intervals` intervals of order 20 each, of a body that carries a wheel of this momentum.
inline Motion independent_flow(const RealMatrix& inertia, const RealTorque& torque, const Motion& start, Real time,
                               Real duration, int intervals, const RealVector& wheel = RealVector::Zero()) {
  using Packed = Eigen::Matrix<Real, 3, 4>;  // C and ω side by side
  const RealMatrix inverse = inertia.inverse();
  const auto derivative = [&](const Packed& y, Real t) {
    const RealMatrix c = y.leftCols<3>();
    const RealVector w = y.col(3);
    Packed result;
    for (int i = 0; i < 3; ++i) {
      result.row(i).head<3>() = RealVector(c.row(i)).cross(w);
    }
    result.col(3) = inverse * (RealVector(inertia * w + wheel).cross(w) + torque(c, t));
    return result;
  };
  const auto midpoint_rule = [&](const Packed& y, Real t, Real length, int parts) {
    const Real h = length / static_cast<Real>(parts);
    Packed before = y;
    Packed now = y + h * derivative(y, t);
    for (int k = 1; k < parts; ++k) {
      const Packed after = before + 2 * h * derivative(now, t + static_cast<Real>(k) * h);
      before = now;
      now = after;
    }
    return Packed((before + now + h * derivative(now, t + length)) / 2);
  };

  constexpr int columns = 10;
  const Real length = duration / static_cast<Real>(intervals);
  Packed y;
  y << start.attitude, start.angular_velocity;
  for (int interval = 0; interval < intervals; ++interval) {
    const Real t = time + static_cast<Real>(interval) * length;
    std::array<Packed, columns>
        row;  // Aitken and Neville's table in the square of the part's length, one row at a time
    for (int k = 0; k < columns; ++k) {
      Packed value = midpoint_rule(y, t, length, 2 * (k + 1));
      for (int j = 0; j < k; ++j) {
        const Real ratio = static_cast<Real>(k + 1) / static_cast<Real>(k - j);
        const Packed finer = value + (value - row[static_cast<std::size_t>(j)]) / (ratio * ratio - 1);
        row[static_cast<std::size_t>(j)] = value;
        value = finer;
      }
      row[static_cast<std::size_t>(k)] = value;
    }
    y = row.back();
  }
  return {y.leftCols<3>(), y.col(3)};
}

/// How far two motions are apart: the norm of the rotation between them (to first order) and of the rates' difference.
inline Real distance(const Motion& a, const Motion& b) {
  const RealMatrix turn = a.attitude.transpose() * b.attitude;
  const RealVector twice(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1));
  return std::sqrt(twice.squaredNorm() / 4 + (a.angular_velocity - b.angular_velocity).squaredNorm());
}

}  // namespace elliptude::testing
