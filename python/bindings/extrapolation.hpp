#pragma once

/// \file
/// True motions to judge the estimator by. On purpose nothing here is of the core: its integrator, its torques and its
/// rotations would hide their own errors. Plain arrays of numbers, SI units.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <tuple>

namespace elliptude::python::truth {

using Vector = std::array<double, 3>;
using Matrix = std::array<double, 9>;  // row by row

[[nodiscard]] inline Vector cross(const Vector& a, const Vector& b) noexcept {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
[[nodiscard]] inline Vector times(const Matrix& a, const Vector& x) noexcept {
  return {a[0] * x[0] + a[1] * x[1] + a[2] * x[2], a[3] * x[0] + a[4] * x[1] + a[5] * x[2],
          a[6] * x[0] + a[7] * x[1] + a[8] * x[2]};
}
[[nodiscard]] inline Vector transposed_times(const Matrix& a, const Vector& x) noexcept {
  return {a[0] * x[0] + a[3] * x[1] + a[6] * x[2], a[1] * x[0] + a[4] * x[1] + a[7] * x[2],
          a[2] * x[0] + a[5] * x[1] + a[8] * x[2]};
}
[[nodiscard]] inline Matrix product(const Matrix& a, const Matrix& b) noexcept {
  Matrix result{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      result[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    }
  }
  return result;
}

/// The inverse of a symmetric matrix by its cofactors.
[[nodiscard]] inline Matrix inverse(const Matrix& a) noexcept {
  const Vector x{a[0], a[1], a[2]};
  const Vector y{a[3], a[4], a[5]};
  const Vector z{a[6], a[7], a[8]};
  const Vector yz = cross(y, z);
  const Vector zx = cross(z, x);
  const Vector xy = cross(x, y);
  const double determinant = x[0] * yz[0] + x[1] * yz[1] + x[2] * yz[2];
  Matrix result{};
  for (std::size_t i = 0; i < 3; ++i) {
    result[3 * i] = yz[i] / determinant;
    result[3 * i + 1] = zx[i] / determinant;
    result[3 * i + 2] = xy[i] / determinant;
  }
  return result;
}

/// The unit quaternion (qw, qx, qy, qz) of the turn since the start, C = C₀ R(q), and the angular velocity in body axes.
using State = std::array<double, 7>;

[[nodiscard]] inline Vector angular_velocity(const State& state) noexcept { return {state[4], state[5], state[6]}; }

/// R(q).
[[nodiscard]] inline Matrix rotation(const State& q) noexcept {
  const double w = q[0];
  const double x = q[1];
  const double y = q[2];
  const double z = q[3];
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

/// q' = ½ q (0, ω), which is Ċ = C S(ω), and ω' as given.
[[nodiscard]] inline State derivative(const State& q, const Vector& omega_rate) noexcept {
  const Vector omega = angular_velocity(q);
  const Vector turned = cross({q[1], q[2], q[3]}, omega);
  return {-0.5 * (q[1] * omega[0] + q[2] * omega[1] + q[3] * omega[2]),
          0.5 * (q[0] * omega[0] + turned[0]),
          0.5 * (q[0] * omega[1] + turned[1]),
          0.5 * (q[0] * omega[2] + turned[2]),
          omega_rate[0],
          omega_rate[1],
          omega_rate[2]};
}

/// J ω' = M − ω × (J ω + h), with uniform gravity, a gravity gradient and a torque together; what is absent is zero.
struct RigidBodyMotion {
  Matrix inertia;
  Matrix inertia_inverse;
  /// m g ρ in N m; the third reference axis points down.
  Vector weighted_center;
  /// n in rad/s, of a circular orbit with the radial direction (cos nt, sin nt, 0).
  double orbit_rate;
  /// h in N m s, of wheels that keep it, body axes.
  Vector wheel_momentum;
  Matrix attitude0;
  /// N m, body axes; constant.
  Vector torque;

  [[nodiscard]] State operator()(double time, const State& state) const noexcept {
    const Matrix turn = rotation(state);
    const Vector omega = angular_velocity(state);
    const Vector down = transposed_times(turn, {attitude0[6], attitude0[7], attitude0[8]});
    const Vector orbit{std::cos(orbit_rate * time), std::sin(orbit_rate * time), 0};
    const Vector radial = transposed_times(turn, transposed_times(attitude0, orbit));
    const Vector gravity = cross(weighted_center, down);
    const Vector gradient = cross(radial, truth::times(inertia, radial));
    const Vector own = truth::times(inertia, omega);
    const Vector gyroscopic =
        cross(omega, {own[0] + wheel_momentum[0], own[1] + wheel_momentum[1], own[2] + wheel_momentum[2]});
    Vector moment{};
    for (std::size_t i = 0; i < 3; ++i) {
      moment[i] = gravity[i] + 3 * orbit_rate * orbit_rate * gradient[i] + torque[i] - gyroscopic[i];
    }
    return derivative(state, truth::times(inertia_inverse, moment));
  }
};

/// Any motion: the angular acceleration in body axes is given, and constant.
struct AcceleratedMotion {
  Vector angular_acceleration;

  [[nodiscard]] State operator()(double /*time*/, const State& state) const noexcept {
    return derivative(state, angular_acceleration);
  }
};

/// The state at `end` from that at `begin`: the midpoint rule in 2, 4, ... 16 substeps, extrapolated to order 16 (Gragg,
/// Bulirsch and Stoer; Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, II.9).
///
/// The step is chosen so that the last two columns of the extrapolation differ by at most 1e-13 (1 + |state|); the error
/// of what is kept is smaller still. `step` is the first trial and becomes the last step that was accepted.
/// \return false if no step is small enough, or numbers grow beyond bounds.
template <typename Motion>
[[nodiscard]] bool integrate(const Motion& motion, double begin, double end, double& step, State& state) noexcept {
  constexpr std::size_t columns = 8;
  constexpr std::size_t size = std::tuple_size_v<State>;
  constexpr double tolerance = 1e-13;
  constexpr int most_steps = 1000000;

  double time = begin;
  for (int count = 0; time < end; ++count) {
    const bool is_last = !(time + 1.01 * step < end);
    const double h = is_last ? end - time : step;
    if (count == most_steps || !(time + h > time)) {
      return false;
    }
    // Increments are extrapolated, not states: what is rounded is then smaller.
    std::array<State, columns> table{};
    State correction{};
    const State slope = motion(time, state);
    for (std::size_t j = 0; j < columns; ++j) {
      const std::size_t substeps = 2 * (j + 1);
      const double length = h / static_cast<double>(substeps);
      State before{};
      State here{};
      for (std::size_t i = 0; i < size; ++i) {
        here[i] = length * slope[i];
      }
      for (std::size_t k = 1; k < substeps; ++k) {
        State at = state;
        for (std::size_t i = 0; i < size; ++i) {
          at[i] += here[i];
        }
        const State rate = motion(time + static_cast<double>(k) * length, at);
        for (std::size_t i = 0; i < size; ++i) {
          const double next = before[i] + 2 * length * rate[i];
          before[i] = here[i];
          here[i] = next;
        }
      }
      // Aitken and Neville in powers of the substep's square; table[m] holds the entry of the row before in column m.
      for (std::size_t m = 0; m < j; ++m) {
        const double ratio = static_cast<double>(j + 1) / static_cast<double>(j - m);
        const State old = table[m];
        table[m] = here;
        for (std::size_t i = 0; i < size; ++i) {
          correction[i] = (here[i] - old[i]) / (ratio * ratio - 1);
          here[i] += correction[i];
        }
      }
      table[j] = here;
    }
    const State& increment = table[columns - 1];
    double error = 0;
    for (std::size_t i = 0; i < size; ++i) {
      if (!std::isfinite(increment[i])) {
        return false;
      }
      error = std::max(error, std::abs(correction[i]) / (tolerance * (1 + std::abs(state[i]))));
    }
    const double factor = 0.9 * std::pow(std::max(error, 1e-10), -1.0 / (2 * columns - 1));
    if (!(error <= 1)) {
      step = h * std::max(factor, 0.1);
      continue;
    }
    for (std::size_t i = 0; i < size; ++i) {
      state[i] += increment[i];
    }
    const double norm =
        std::sqrt(state[0] * state[0] + state[1] * state[1] + state[2] * state[2] + state[3] * state[3]);
    for (std::size_t i = 0; i < 4; ++i) {
      state[i] /= norm;
    }
    step = is_last ? std::max(step, h * std::min(factor, 2.0)) : h * std::min(factor, 2.0);
    time = is_last ? end : time + h;
  }
  return true;
}

}  // namespace elliptude::python::truth
