#pragma once

/// \file
/// True motions to judge the estimator by. On purpose nothing here uses the core: its integrator, its torques and its
/// rotations would hide their own errors. Plain arrays of numbers, SI units, in double or long double.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <type_traits>

namespace elliptude::python::truth {

template <typename Scalar>
using Vector = std::array<Scalar, 3>;
template <typename Scalar>
using Matrix = std::array<Scalar, 9>;  // row by row

template <typename Scalar>
[[nodiscard]] Vector<Scalar> cross(const Vector<Scalar>& a, const Vector<Scalar>& b) noexcept {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
template <typename Scalar>
[[nodiscard]] Vector<Scalar> times(const Matrix<Scalar>& a, const Vector<Scalar>& x) noexcept {
  return {a[0] * x[0] + a[1] * x[1] + a[2] * x[2], a[3] * x[0] + a[4] * x[1] + a[5] * x[2],
          a[6] * x[0] + a[7] * x[1] + a[8] * x[2]};
}
template <typename Scalar>
[[nodiscard]] Vector<Scalar> transposed_times(const Matrix<Scalar>& a, const Vector<Scalar>& x) noexcept {
  return {a[0] * x[0] + a[3] * x[1] + a[6] * x[2], a[1] * x[0] + a[4] * x[1] + a[7] * x[2],
          a[2] * x[0] + a[5] * x[1] + a[8] * x[2]};
}
template <typename Scalar>
[[nodiscard]] Matrix<Scalar> product(const Matrix<Scalar>& a, const Matrix<Scalar>& b) noexcept {
  Matrix<Scalar> result{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      result[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    }
  }
  return result;
}

/// The inverse of a symmetric matrix by its cofactors.
template <typename Scalar>
[[nodiscard]] Matrix<Scalar> inverse(const Matrix<Scalar>& a) noexcept {
  const Vector<Scalar> x{a[0], a[1], a[2]};
  const Vector<Scalar> y{a[3], a[4], a[5]};
  const Vector<Scalar> z{a[6], a[7], a[8]};
  const Vector<Scalar> yz = cross(y, z);
  const Vector<Scalar> zx = cross(z, x);
  const Vector<Scalar> xy = cross(x, y);
  const Scalar determinant = x[0] * yz[0] + x[1] * yz[1] + x[2] * yz[2];
  Matrix<Scalar> result{};
  for (std::size_t i = 0; i < 3; ++i) {
    result[3 * i] = yz[i] / determinant;
    result[3 * i + 1] = zx[i] / determinant;
    result[3 * i + 2] = xy[i] / determinant;
  }
  return result;
}

/// The unit quaternion (qw, qx, qy, qz) of the turn since the start, C = C₀ R(q), and the angular velocity in body axes.
template <typename Scalar>
using State = std::array<Scalar, 7>;

template <typename Scalar>
[[nodiscard]] Vector<Scalar> angular_velocity(const State<Scalar>& state) noexcept {
  return {state[4], state[5], state[6]};
}

/// R(q).
template <typename Scalar>
[[nodiscard]] Matrix<Scalar> rotation(const State<Scalar>& q) noexcept {
  const Scalar w = q[0];
  const Scalar x = q[1];
  const Scalar y = q[2];
  const Scalar z = q[3];
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

/// q' = ½ q (0, ω), which is Ċ = C S(ω), and ω' as given.
template <typename Scalar>
[[nodiscard]] State<Scalar> derivative(const State<Scalar>& q, const Vector<Scalar>& omega_rate) noexcept {
  const Vector<Scalar> omega = angular_velocity(q);
  const Vector<Scalar> turned = cross({q[1], q[2], q[3]}, omega);
  return {-0.5 * (q[1] * omega[0] + q[2] * omega[1] + q[3] * omega[2]),
          0.5 * (q[0] * omega[0] + turned[0]),
          0.5 * (q[0] * omega[1] + turned[1]),
          0.5 * (q[0] * omega[2] + turned[2]),
          omega_rate[0],
          omega_rate[1],
          omega_rate[2]};
}

/// J ω' = M − ω × (J ω + h), with uniform gravity, a gravity gradient and a torque together; what is absent is zero.
template <typename Scalar>
struct RigidBodyMotion {
  Matrix<Scalar> inertia;
  Matrix<Scalar> inertia_inverse;
  /// m g ρ in N m; the third reference axis points down.
  Vector<Scalar> weighted_center;
  /// n in rad/s, the mean motion of an orbit that is at its perigee, (1, 0, 0), at time 0, and turns about (0, 0, 1).
  Scalar orbit_rate;
  /// Eccentricity of the orbit, below 1; 0 is a circle, with the radial direction (cos nt, sin nt, 0).
  Scalar eccentricity;
  /// h in N m s, of wheels that keep it, body axes.
  Vector<Scalar> wheel_momentum;
  Matrix<Scalar> attitude0;
  /// N m, body axes; constant.
  Vector<Scalar> torque;

  [[nodiscard]] State<Scalar> operator()(Scalar time, const State<Scalar>& state) const noexcept {
    const Matrix<Scalar> turn = rotation(state);
    const Vector<Scalar> omega = angular_velocity(state);
    const Vector<Scalar> down = transposed_times(turn, {attitude0[6], attitude0[7], attitude0[8]});
    // Kepler's equation by Newton's method, in units of the semi-major axis.
    Scalar anomaly = orbit_rate * time;
    for (int count = 0; eccentricity > 0 && count < 20; ++count) {
      anomaly -=
          (anomaly - eccentricity * std::sin(anomaly) - orbit_rate * time) / (1 - eccentricity * std::cos(anomaly));
    }
    const Scalar radius = 1 - eccentricity * std::cos(anomaly);
    const Vector<Scalar> orbit{(std::cos(anomaly) - eccentricity) / radius,
                               std::sqrt(1 - eccentricity * eccentricity) * std::sin(anomaly) / radius, 0};
    const Scalar strength = 3 * orbit_rate * orbit_rate / (radius * radius * radius);
    const Vector<Scalar> radial = transposed_times(turn, transposed_times(attitude0, orbit));
    const Vector<Scalar> gravity = cross(weighted_center, down);
    const Vector<Scalar> gradient = cross(radial, truth::times(inertia, radial));
    const Vector<Scalar> own = truth::times(inertia, omega);
    const Vector<Scalar> gyroscopic =
        cross(omega, {own[0] + wheel_momentum[0], own[1] + wheel_momentum[1], own[2] + wheel_momentum[2]});
    Vector<Scalar> moment{};
    for (std::size_t i = 0; i < 3; ++i) {
      moment[i] = gravity[i] + strength * gradient[i] + torque[i] - gyroscopic[i];
    }
    return derivative(state, truth::times(inertia_inverse, moment));
  }
};

/// Any motion: the angular acceleration in body axes is given, and constant.
template <typename Scalar>
struct AcceleratedMotion {
  Vector<Scalar> angular_acceleration;

  [[nodiscard]] State<Scalar> operator()(Scalar /*time*/, const State<Scalar>& state) const noexcept {
    return derivative(state, angular_acceleration);
  }
};

/// The state at `end` from that at `begin`: the midpoint rule in 2, 4, ... 16 substeps, extrapolated to order 16 (Gragg,
/// Bulirsch and Stoer; Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, II.9).
///
/// The step is chosen so that the last two columns of the extrapolation differ by at most 1e-13 (1 + |state|), in long
/// double 1e-17; the error of what is kept is smaller still. `step` is the first trial and becomes the last step that was accepted.
/// \return false if no step is small enough, or numbers overflow.
template <typename Scalar, typename Motion>
[[nodiscard]] bool integrate(const Motion& motion, Scalar begin, Scalar end, Scalar& step,
                             State<Scalar>& state) noexcept {
  constexpr std::size_t columns = 8;
  constexpr std::size_t size = std::tuple_size_v<State<Scalar>>;
  constexpr Scalar tolerance = static_cast<Scalar>(std::is_same_v<Scalar, double> ? 1e-13L : 1e-17L);
  constexpr int most_steps = 1000000;

  Scalar time = begin;
  for (int count = 0; time < end; ++count) {
    const bool is_last = !(time + 1.01 * step < end);
    const Scalar h = is_last ? end - time : step;
    if (count == most_steps || !(time + h > time)) {
      return false;
    }
    // Increments are extrapolated, not states: what is rounded is then smaller.
    std::array<State<Scalar>, columns> table{};
    State<Scalar> correction{};
    const State<Scalar> slope = motion(time, state);
    for (std::size_t j = 0; j < columns; ++j) {
      const std::size_t substeps = 2 * (j + 1);
      const Scalar length = h / static_cast<Scalar>(substeps);
      State<Scalar> before{};
      State<Scalar> here{};
      for (std::size_t i = 0; i < size; ++i) {
        here[i] = length * slope[i];
      }
      for (std::size_t k = 1; k < substeps; ++k) {
        State<Scalar> at = state;
        for (std::size_t i = 0; i < size; ++i) {
          at[i] += here[i];
        }
        const State<Scalar> rate = motion(time + static_cast<Scalar>(k) * length, at);
        for (std::size_t i = 0; i < size; ++i) {
          const Scalar next = before[i] + 2 * length * rate[i];
          before[i] = here[i];
          here[i] = next;
        }
      }
      // Aitken and Neville in powers of the substep's square; table[m] holds the entry of the row before in column m.
      for (std::size_t m = 0; m < j; ++m) {
        const Scalar ratio = static_cast<Scalar>(j + 1) / static_cast<Scalar>(j - m);
        const State<Scalar> old = table[m];
        table[m] = here;
        for (std::size_t i = 0; i < size; ++i) {
          correction[i] = (here[i] - old[i]) / (ratio * ratio - 1);
          here[i] += correction[i];
        }
      }
      table[j] = here;
    }
    const State<Scalar>& increment = table[columns - 1];
    Scalar error = 0;
    for (std::size_t i = 0; i < size; ++i) {
      if (!std::isfinite(increment[i])) {
        return false;
      }
      error = std::max(error, std::abs(correction[i]) / (tolerance * (1 + std::abs(state[i]))));
    }
    const Scalar factor = 0.9 * std::pow(std::max(error, Scalar(1e-10)), Scalar(-1) / (2 * columns - 1));
    if (!(error <= 1)) {
      step = h * std::max(factor, Scalar(0.1));
      continue;
    }
    for (std::size_t i = 0; i < size; ++i) {
      state[i] += increment[i];
    }
    const Scalar norm =
        std::sqrt(state[0] * state[0] + state[1] * state[1] + state[2] * state[2] + state[3] * state[3]);
    for (std::size_t i = 0; i < 4; ++i) {
      state[i] /= norm;
    }
    step = is_last ? std::max(step, h * std::min(factor, Scalar(2))) : h * std::min(factor, Scalar(2));
    time = is_last ? end : time + h;
  }
  return true;
}

}  // namespace elliptude::python::truth
