#pragma once

/// \file
/// Filters: a prediction and an update, over and over.

#include <array>
#include <elliptude/first_order/filter.hpp>
#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/guaranteed/filter.hpp>

#include "motions.hpp"

namespace elliptude::operations {

/// What an IMU's log asks for at each row, to first order: a step of the gyro's flow, and two directions.
inline double gyro_row(long count) {
  using Flow = GyroFlow<double>;
  using Filter = AttitudeFilter<Flow, FirstOrderEstimator>;
  constexpr double step = 0.01;
  constexpr double bound = 0.07;
  constexpr std::size_t row_count = 64;
  const std::array<Vector3d, 2> references{Vector3d(0, 0, 1), Vector3d(0, 0.4, -0.9)};
  const Vector3d rate(0.1, 0.1, 0.1);
  Random random;
  Matrix3d attitude = Matrix3d::Identity();
  std::array<std::array<Direction<double>, 2>, row_count> rows;
  for (auto& row : rows) {
    attitude = attitude * exp(Vector3d(step * rate));
    for (std::size_t k = 0; k < 2; ++k) {
      const Vector3d b = attitude.transpose() * references[k] + random.in_cube(0.01);
      row[k] = Direction<double>::within(references[k], b, bound);
    }
  }
  Flow flow;
  expect_ok(Flow::make(Matrix3d(7.6e-5 * Matrix3d::Identity()), Matrix3d(3e-10 * Matrix3d::Identity()), flow));
  Filter filter;
  Update<double> update;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const std::size_t at = static_cast<std::size_t>(i) % row_count;
    if (at == 0) {
      const StateEllipsoid<GyroState<double>> start{{Matrix3d::Identity(), Vector3d::Zero()},
                                                    0.01 * Matrix6<double>::Identity()};
      expect_ok(Filter::make(flow, SizeCriterion<double, 6>::trace(), 0.0, start, filter));
    }
    expect_ok(filter.predict(step * static_cast<double>(at + 1), {rate}));
    expect_ok(filter.update(rows[at].data(), rows[at].size(), update));
    sum += filter.ellipsoid().shape.trace();
  }
  return sum;
}

/// What a spacecraft of the scenario `orbit` measures at each step at 7 degrees: three directions and the angular
/// velocity.
struct Cycle {
  double time;
  std::array<Direction<double>, 3> directions;
  AngularVelocity<double> angular_velocity;
};

constexpr std::size_t cycle_count = 65;  // the first starts a filter, and 64 follow

inline std::array<Cycle, cycle_count> typical_cycles() {
  auto motion = gravity_gradient_motion();
  const double bound = 0.12217304763960307;
  const double half_side = bound / std::sqrt(3);  // of a cube in the ball
  Random random;
  std::array<Cycle, cycle_count> cycles;
  for (std::size_t i = 0; i < cycle_count; ++i) {
    cycles[i].time = static_cast<double>(i) * motion.h;
    for (int k = 0; k < 3; ++k) {
      const Vector3d e = Vector3d::Unit(k);
      const Vector3d b = exp(random.in_cube(half_side)) * (motion.state.attitude.transpose() * e);
      cycles[i].directions[static_cast<std::size_t>(k)] = Direction<double>::within(e, b, bound);
    }
    cycles[i].angular_velocity = {motion.state.angular_velocity + random.in_cube(half_side),
                                  bound * bound * Matrix3d::Identity()};
    expect_ok(integrate_step(motion.body, motion.potential, composition(4), cycles[i].time, motion.h, Vector3d(0, 0, 0),
                             motion.state, motion.state));
  }
  return cycles;
}

/// One step of the flow and the fusion of all measurements with its end, for a filter that has been running; and with
/// `asks` the bounds of tilt and heading after it.
template <SizeCriterion<double, 6>::Kind kind, bool asks>
double guaranteed_cycle(long count) {
  static const std::array<Cycle, cycle_count> cycles = typical_cycles();
  using Flow = GuaranteedRigidBodyFlow<double, GravityGradient<double>>;
  using Filter = GuaranteedFilter<Flow>;
  const auto motion = gravity_gradient_motion();
  Flow flow;
  expect_ok(Flow::make(motion.body, motion.potential, motion.h, BodyUncertainty<double>(), flow));
  Filter::Settings settings;
  settings.criterion = kind == SizeCriterion<double, 6>::Kind::trace ? SizeCriterion<double, 6>::trace()
                                                                     : SizeCriterion<double, 6>::volume();
  settings.keeps_constraints = asks;
  const auto measured = [](const Cycle& cycle) {
    return Measurements<double>{cycle.directions.data(), cycle.directions.size(), &cycle.angular_velocity, nullptr};
  };
  GuaranteedUpdate<double> update;
  Filter started;
  expect_ok(Filter::make(flow, settings, cycles[0].time, started));
  expect_ok(started.update(measured(cycles[0]), update));
  Filter filter;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const std::size_t at = 1 + static_cast<std::size_t>(i) % (cycle_count - 1);
    if (at == 1) {
      filter = started;
    }
    expect_ok(filter.predict(cycles[at].time, BodyInput<double>()));
    expect_ok(filter.update(measured(cycles[at]), update));
    sum += filter.ellipsoid().shape.trace();
    if constexpr (asks) {
      AttitudeBounds<double> bounds{};
      expect_ok(filter.bounds(Vector3d::UnitZ(), bounds));
      sum += bounds.angle;
    }
  }
  return sum;
}

/// The same cycle with linearized errors, as in the paper.
template <typename Estimator, SizeCriterion<double, 6>::Kind kind>
double first_order_cycle(long count) {
  static const std::array<Cycle, cycle_count> cycles = typical_cycles();
  using Flow = RigidBodyFlow<double, GravityGradient<double>>;
  using Filter = AttitudeFilter<Flow, Estimator>;
  const auto motion = gravity_gradient_motion();
  Flow flow;
  expect_ok(Flow::make(motion.body, motion.potential, motion.h, 2, Matrix3d(Matrix3d::Zero()), flow));
  const auto criterion = kind == SizeCriterion<double, 6>::Kind::trace ? SizeCriterion<double, 6>::trace()
                                                                       : SizeCriterion<double, 6>::volume();
  MeasuredDirections<double> directions;
  expect_ok(MeasuredDirections<double>::make(cycles[0].directions.data(), cycles[0].directions.size(), WahbaMethod::svd,
                                             directions));
  StateEllipsoid<RigidBodyState<double>> start;
  expect_ok(measured_state(directions, cycles[0].angular_velocity, criterion, start));
  Filter started;
  expect_ok(Filter::make(flow, criterion, cycles[0].time, start, started));
  Filter filter;
  Update<double> update;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const std::size_t at = 1 + static_cast<std::size_t>(i) % (cycle_count - 1);
    if (at == 1) {
      filter = started;
    }
    expect_ok(filter.predict(cycles[at].time, {}));
    expect_ok(
        filter.update(cycles[at].directions.data(), cycles[at].directions.size(), cycles[at].angular_velocity, update));
    sum += filter.ellipsoid().shape.trace();
  }
  return sum;
}

}  // namespace elliptude::operations
