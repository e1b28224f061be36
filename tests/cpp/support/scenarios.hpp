#pragma once

/// \file
/// The scenarios that figures are quoted for, and bodies and potentials beside them, as the tests meet them.

#include <doctest/doctest.h>

#include <elliptude/dynamics/potential.hpp>

#include "support/random.hpp"

namespace elliptude::testing {

template <typename Scalar>
RigidBody<Scalar> make_body(const Matrix3<Scalar>& inertia) {
  RigidBody<Scalar> body;
  REQUIRE(RigidBody<Scalar>::make(inertia, body) == Status::ok);
  return body;
}

/// diag(1, 2.8, 2) kg m², of the scenarios `free`, `orbit` and `long_orbit`; the third axis is the intermediate one.
template <typename Scalar>
RigidBody<Scalar> spacecraft() {
  return make_body(Matrix3<Scalar>(Vector3<Scalar>(Scalar(1), scalar::constant<Scalar>(2.8L), Scalar(2)).asDiagonal()));
}

/// The body of the scenario `pendulum`.
template <typename Scalar>
RigidBody<Scalar> pendulum_body() {
  return make_body(Matrix3<Scalar>(
      Vector3<Scalar>(scalar::constant<Scalar>(0.13L), scalar::constant<Scalar>(0.28L), scalar::constant<Scalar>(0.17L))
          .asDiagonal()));
}

/// No axis of this body is a principal one, and its moments are nearly those of a flat body.
template <typename Scalar>
RigidBody<Scalar> skewed_body() {
  const Matrix3<Scalar> axes = exp(
      Vector3<Scalar>(scalar::constant<Scalar>(0.7L), scalar::constant<Scalar>(-0.4L), scalar::constant<Scalar>(1.1L)));
  const Vector3<Scalar> moments(scalar::constant<Scalar>(0.9L), scalar::constant<Scalar>(1.5L),
                                scalar::constant<Scalar>(2.3L));
  return make_body(Matrix3<Scalar>(axes * moments.asDiagonal() * axes.transpose()));
}

/// The inertia of a random body: principal moments b + c, a + c, a + b in random axes.
inline Matrix3<double> random_inertia(Random& random) {
  const double a = random.uniform(0.05, 1);
  const double b = random.uniform(0.05, 1);
  const double c = random.uniform(0.05, 1);
  return random.symmetric<3>(Vector3<double>(b + c, a + c, a + b));
}

/// Gravity of the scenario `pendulum`: mass 1, 9.81 m/s², centre of mass 0.3 m along the third axis.
template <typename Scalar>
UniformGravity<Scalar> pendulum_gravity() {
  UniformGravity<Scalar> gravity;
  REQUIRE(UniformGravity<Scalar>::make(Scalar(1), scalar::constant<Scalar>(9.81L),
                                       Vector3<Scalar>(Scalar(0), Scalar(0), scalar::constant<Scalar>(0.3L)),
                                       gravity) == Status::ok);
  return gravity;
}

template <typename Scalar>
GravityGradient<Scalar> gravity_gradient(const RigidBody<Scalar>& body, const Scalar& rate,
                                         const Matrix3<Scalar>& orbit) {
  GravityGradient<Scalar> gradient;
  REQUIRE(GravityGradient<Scalar>::make(body, rate, orbit, gradient) == Status::ok);
  return gradient;
}

/// The gravity gradient of the scenarios `orbit` and `long_orbit`: rate 1, radial direction (cos t, sin t, 0).
template <typename Scalar>
GravityGradient<Scalar> orbit_gravity(const RigidBody<Scalar>& body) {
  return gravity_gradient(body, Scalar(1), Matrix3<Scalar>(Matrix3<Scalar>::Identity()));
}

/// An orbit plane that no reference axis lies in.
template <typename Scalar>
Matrix3<Scalar> tilted_orbit() {
  return exp(
      Vector3<Scalar>(scalar::constant<Scalar>(0.5L), scalar::constant<Scalar>(-0.9L), scalar::constant<Scalar>(0.3L)));
}

template <typename Scalar>
RigidBodyState<Scalar> make_state(const std::array<long double, 3>& rotation_vector,
                                  const std::array<long double, 3>& rate) {
  const auto vector = [](const std::array<long double, 3>& v) {
    return Vector3<Scalar>(scalar::constant<Scalar>(v[0]), scalar::constant<Scalar>(v[1]),
                           scalar::constant<Scalar>(v[2]));
  };
  return {exp(vector(rotation_vector)), vector(rate)};
}

constexpr long double degree = 0.0174532925199432957692369076848861271L;

template <typename Scalar>
RigidBodyState<Scalar> free_state() {
  return make_state<Scalar>({0, 0, 0}, {0.01L, 0.01L, 5.0L});
}

template <typename Scalar>
RigidBodyState<Scalar> pendulum_state() {
  return make_state<Scalar>({120 * degree, 0, 0}, {0.5L, -0.5L, 0.4L});
}

template <typename Scalar>
RigidBodyState<Scalar> orbit_state() {
  return make_state<Scalar>({105 * degree, 0, 0}, {2.316L, 0.446L, -0.591L});
}

template <typename Scalar>
RigidBodyState<Scalar> long_orbit_state() {
  return make_state<Scalar>({0, 0, 0}, {0.3L, -0.2L, 1.1L});
}

}  // namespace elliptude::testing
