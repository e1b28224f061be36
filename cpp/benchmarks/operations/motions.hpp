#pragma once

/// \file
/// Bodies in motion, as in the scenarios `free`, `orbit` and `pendulum`, and steps of them.

#include <elliptude/dynamics/exact_rotor.hpp>
#include <elliptude/dynamics/linearization.hpp>
#include <type_traits>

#include "common.hpp"

namespace elliptude::operations {

template <typename Potential>
struct Motion {
  RigidBody<double> body;
  Potential potential;
  RigidBodyState<double> state;
  double h;
};

inline RigidBody<double> make_body(const Vector3d& moments) {
  RigidBody<double> body;
  expect_ok(RigidBody<double>::make(moments.asDiagonal(), body));
  return body;
}

inline auto free_motion() {
  return Motion<FreeBody<double>>{make_body({1, 2.8, 2}), {}, {Matrix3d::Identity(), Vector3d(0.01, 0.01, 5)}, 0.01};
}

inline auto gravity_gradient_motion() {
  const RigidBody<double> body = make_body({1, 2.8, 2});
  GravityGradient<double> potential;
  expect_ok(GravityGradient<double>::make(body, 1, Matrix3d::Identity(), potential));
  return Motion<GravityGradient<double>>{
      body, potential, {exp(Vector3d(1.8325957145940461, 0, 0)), Vector3d(2.316, 0.446, -0.591)}, 0.020943951023931952};
}

inline auto pendulum_motion() {
  UniformGravity<double> potential;
  expect_ok(UniformGravity<double>::make(1, 9.81, {0, 0, 0.3}, potential));
  return Motion<UniformGravity<double>>{make_body({0.13, 0.28, 0.17}),
                                        potential,
                                        {exp(Vector3d(2.0943951023931953, 0, 0)), Vector3d(0.5, -0.5, 0.4)},
                                        0.005};
}

inline Composition<double> composition(int order) {
  Composition<double> result;
  expect_ok(composition_of_order(order, result));
  return result;
}

/// The same motion with the exact free rotor.
template <typename Potential>
struct ExactMotion {
  ExactRotor<double> body;
  Potential potential;
  RigidBodyState<double> state;
  double h;
};

template <auto make_motion>
auto exactly() {
  const auto motion = make_motion();
  ExactRotor<double> rotor;
  expect_ok(ExactRotor<double>::make(motion.body, rotor));
  return ExactMotion<std::decay_t<decltype(motion.potential)>>{rotor, motion.potential, motion.state, motion.h};
}

/// A step of a trajectory of `count` steps.
template <auto make_motion, int order>
double step(long count) {
  const auto motion = make_motion();
  RigidBodyState<double> end = motion.state;
  double sum = 0;
  expect_ok(integrate(motion.body, motion.potential, composition(order), 0.0, motion.h, count, Vector3d(0, 0, 0),
                      motion.state, end,
                      [&sum](long, const RigidBodyState<double>& state) { sum += state.angular_velocity.x(); }));
  return sum + end.attitude.sum();
}

/// A step asked for by itself, its input checked each time.
template <auto make_motion, int order>
double lone_step(long count) {
  const auto motion = make_motion();
  const Composition<double> stages = composition(order);
  RigidBodyState<double> state = motion.state;
  for (long i = 0; i < count; ++i) {
    expect_ok(integrate_step(motion.body, motion.potential, stages, static_cast<double>(i) * motion.h, motion.h,
                             Vector3d(0, 0, 0), state, state));
  }
  return state.attitude.sum() + state.angular_velocity.sum();
}

/// A lone step, its linearization A, and A P Aᵀ.
template <auto make_motion, int order>
double step_with_ellipsoid(long count) {
  const auto motion = make_motion();
  const Composition<double> stages = composition(order);
  RigidBodyState<double> state = motion.state;
  FlowLinearization<double> flow;
  Ellipsoid6 ellipsoid{Vector6<double>::Zero(), 0.01 * Matrix6<double>::Identity()};
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    expect_ok(integrate_linearized(motion.body, motion.potential, stages, static_cast<double>(i) * motion.h, motion.h,
                                   1L, Vector3d(0, 0, 0), state, state, flow));
    const Ellipsoid6 image = affine_image(ellipsoid, flow.state, Vector6<double>(Vector6<double>::Zero()));
    sum += image.shape.sum();
    ellipsoid.shape(0, 0) = 0.01 + 1e-9 * static_cast<double>(i);
  }
  return sum + state.attitude.sum();
}

}  // namespace elliptude::operations
