#pragma once

/// \file
/// What is measured, in time by `benchmark_core` and in instructions by `instructions_core`: each operation is a
/// function that runs `count` times and returns a number made of all the results, so that none of them can be left out.

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <elliptude/attitude/wahba_set.hpp>
#include <elliptude/dynamics/exact_rotor.hpp>
#include <elliptude/dynamics/linearization.hpp>
#include <elliptude/first_order/filter.hpp>
#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/measurement/quadrics.hpp>
#include <elliptude/sets/intersection.hpp>
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

// --- bodies in motion: the scenarios `free`, `orbit` and `pendulum` -----------------------------------------------------

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

// --- fusion -----------------------------------------------------------------------------------------------------------

struct Pair {
  Ellipsoid6 measured;
  Ellipsoid6 predicted;
};

constexpr std::size_t pair_count = 64;

/// What an update of the scenario `orbit` meets at 7 degrees: a measured ellipsoid, and one that 30 steps have carried
/// on from such a measurement; the truth is in both.
inline std::array<Pair, pair_count> typical_pairs() {
  auto motion = gravity_gradient_motion();
  Random random;
  std::array<Pair, pair_count> pairs;
  const auto measured_shape = [&random] {
    Vector6<double> widths;
    for (int i = 0; i < 6; ++i) {
      widths(i) = random.uniform(0.1, 0.3);  // rad, and the like in orbit units
    }
    Matrix6<double> turn = Matrix6<double>::Zero();
    turn.topLeftCorner<3, 3>() = exp(random.in_cube(2));
    turn.bottomRightCorner<3, 3>() = exp(random.in_cube(2));
    return Matrix6<double>(turn * widths.cwiseAbs2().asDiagonal() * turn.transpose());
  };
  const auto around_truth = [&random](const Matrix6<double>& shape) {
    Matrix6<double> root;
    expect_ok(cholesky(shape, root));
    Vector6<double> direction;
    for (int i = 0; i < 6; ++i) {
      direction(i) = random.uniform(-0.55, 0.55);
    }
    return Ellipsoid6{root * (direction / std::max(1.0, direction.norm())), shape};
  };
  for (std::size_t i = 0; i < pair_count; ++i) {
    FlowLinearization<double> flow;
    expect_ok(integrate_linearized(motion.body, motion.potential, composition(2), static_cast<double>(i), motion.h, 30L,
                                   Vector3d(0, 0, 0), motion.state, motion.state, flow));
    const Matrix6<double> predicted = flow.state * measured_shape() * flow.state.transpose();
    pairs[i].measured = around_truth(measured_shape());
    pairs[i].predicted = around_truth(Matrix6<double>((predicted + predicted.transpose()) / 2));
  }
  return pairs;
}

template <SizeCriterion<double, 6>::Kind kind>
double fuse(long count) {
  static const std::array<Pair, pair_count> pairs = typical_pairs();
  const auto criterion = kind == SizeCriterion<double, 6>::Kind::trace ? SizeCriterion<double, 6>::trace()
                                                                       : SizeCriterion<double, 6>::volume();
  Intersection<double, 6> result;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const Pair& pair = pairs[static_cast<std::size_t>(i) % pair_count];
    expect_ok(minimal_intersection(pair.measured, pair.predicted, criterion, result));
    sum += result.set.shape.trace() + result.set.center.sum();
  }
  return sum;
}

/// A prediction about as wide as the measurements: three directions and the angular velocity, all about the predicted
/// center.
struct Gathered {
  Ellipsoid6 predicted;
  std::array<HalfQuadric<double>, 4> quadrics;
};

inline std::array<Gathered, pair_count> typical_quadrics() {
  Random random;
  std::array<Gathered, pair_count> result;
  for (Gathered& gathered : result) {
    const double bound = 0.02;
    Matrix6<double> root = Matrix6<double>::Identity();
    for (double& entry : root.reshaped()) {
      entry += random.uniform(-0.3, 0.3);
    }
    root *= bound * random.uniform(0.5, 2);
    gathered.predicted = {Vector6<double>::Zero(), root * root.transpose()};
    const Matrix3d center = exp(random.in_cube(1.8));
    Vector6<double> u;
    u << random.in_cube(0.4), random.in_cube(0.4);
    const Vector6<double> truth = root * u;
    const Matrix3d attitude = GibbsChart::retract(center, Vector3d(truth.head<3>()));
    for (int k = 0; k < 3; ++k) {
      const Vector3d e = (random.in_cube(0.3) + Vector3d::Unit(k)).normalized();
      const Vector3d b = exp(random.in_cube(0.5 * bound)) * (attitude.transpose() * e);
      Quadric<double, 3> quadric;
      expect_ok(cone(center, Direction<double>::within(e, b, bound), quadric));
      gathered.quadrics[static_cast<std::size_t>(k)] = of_attitude(quadric);
    }
    const Vector3d rate = truth.tail<3>() + random.in_cube(0.5 * bound);
    Quadric<double, 3> quadric;
    expect_ok(
        to_quadric(Vector3d(0, 0, 0), AngularVelocity<double>{rate, bound * bound * Matrix3d::Identity()}, quadric));
    gathered.quadrics[3] = of_vector(quadric);
  }
  return result;
}

template <SizeCriterion<double, 6>::Kind kind>
double fuse_quadrics(long count) {
  static const std::array<Gathered, pair_count> inputs = typical_quadrics();
  const auto criterion = kind == SizeCriterion<double, 6>::Kind::trace ? SizeCriterion<double, 6>::trace()
                                                                       : SizeCriterion<double, 6>::volume();
  QuadricFusion<double, 6> result;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const Gathered& input = inputs[static_cast<std::size_t>(i) % pair_count];
    expect_ok(minimal_intersection(&input.predicted, input.quadrics.data(), input.quadrics.size(), criterion, result));
    sum += result.set.shape.trace() + result.set.center.sum();
  }
  return sum;
}

// --- a row of a log ----------------------------------------------------------------------------------------------------

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

// --- the guaranteed filter --------------------------------------------------------------------------------------------

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

// --- attitude from directions ------------------------------------------------------------------------------------------

constexpr std::size_t wahba_samples = 64;

template <int directions>
struct WahbaSample {
  Matrix<double, 3, directions> reference;
  Matrix<double, 3, directions> body;  // wrong by up to 0.174, about 10 degrees
};

template <int directions>
std::array<WahbaSample<directions>, wahba_samples> make_wahba_samples() {
  Random random;
  std::array<WahbaSample<directions>, wahba_samples> result;
  for (WahbaSample<directions>& sample : result) {
    const Matrix3d attitude = exp(random.in_cube(1.8));
    for (int i = 0; i < directions; ++i) {
      sample.reference.col(i) = (random.in_cube(0.7) + Vector3d::Unit(i % 3)).normalized();
      sample.body.col(i) = exp(random.in_cube(0.1)) * attitude.transpose() * sample.reference.col(i);
    }
  }
  return result;
}

template <WahbaMethod method, int directions>
double wahba(long count) {
  static const auto inputs = make_wahba_samples<directions>();
  const Vector<double, directions> weights = Vector<double, directions>::Ones();
  WahbaSolution<double> solution;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const auto& sample = inputs[static_cast<std::size_t>(i) % wahba_samples];
    expect_ok(solve_wahba(sample.reference, sample.body, weights, method, solution));
    sum += solution.attitude.sum();
  }
  return sum;
}

enum class SetWeights : std::uint8_t { given, found };

template <typename Chart, SetWeights choice, int directions>
double set_of_directions(long count) {
  static const auto inputs = make_wahba_samples<directions>();
  const auto bounds = Vector<double, directions>::Constant(0.18);
  Vector<double, directions> weights = Vector<double, directions>::Ones();
  WahbaSet<double> set;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const auto& sample = inputs[static_cast<std::size_t>(i) % wahba_samples];
    if constexpr (choice == SetWeights::given) {
      expect_ok(wahba_set<Chart>(sample.reference, sample.body, bounds, weights, set));
    } else {
      expect_ok(minimal_wahba_set<Chart>(sample.reference, sample.body, bounds, WahbaCriterion::trace, weights, set));
    }
    sum += set.error.shape.trace() + set.attitude.sum();
  }
  return sum;
}

// --- rotations ---------------------------------------------------------------------------------------------------------

struct Exponential {
  Matrix3d operator()(const Vector3d& zeta) const { return exp(zeta); }
};
struct RightJacobian {
  Matrix3d operator()(const Vector3d& zeta) const { return right_jacobian(zeta); }
};
struct RightJacobianInverse {
  Matrix3d operator()(const Vector3d& zeta) const { return right_jacobian_inverse(zeta); }
};
struct Cayley {
  Matrix3d operator()(const Vector3d& zeta) const { return cayley(zeta); }
};

/// \param size of the rotation vectors' entries, in thousandths of a radian.
template <typename Function, int size>
double rotation(long count) {
  constexpr std::size_t samples = 256;
  static const std::array<Vector3d, samples> inputs = [] {
    Random random;
    std::array<Vector3d, samples> result;
    for (Vector3d& input : result) {
      input = random.in_cube(1e-3 * size);
    }
    return result;
  }();
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    sum += Function()(inputs[static_cast<std::size_t>(i) % samples]).sum();
  }
  return sum;
}

inline double logarithm(long count) {
  constexpr std::size_t samples = 256;
  static const std::array<Matrix3d, samples> inputs = [] {
    Random random;
    std::array<Matrix3d, samples> result;
    for (Matrix3d& input : result) {
      input = exp(random.in_cube(1.8));
    }
    return result;
  }();
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    sum += log(inputs[static_cast<std::size_t>(i) % samples]).sum();
  }
  return sum;
}

// --- all of them -------------------------------------------------------------------------------------------------------

struct Operation {
  const char* name;
  double (*run)(long count);
};

using Kind = SizeCriterion<double, 6>::Kind;

inline constexpr std::array<Operation, 46> all{{
    {"step_free_order_2", step<free_motion, 2>},
    {"step_gravity_gradient_order_2", step<gravity_gradient_motion, 2>},
    {"step_pendulum_order_2", step<pendulum_motion, 2>},
    {"step_exact_rotor_free_order_2", step<exactly<free_motion>, 2>},
    {"step_exact_rotor_pendulum_order_2", step<exactly<pendulum_motion>, 2>},
    {"step_free_order_4", step<free_motion, 4>},
    {"step_gravity_gradient_order_4", step<gravity_gradient_motion, 4>},
    {"step_pendulum_order_4", step<pendulum_motion, 4>},
    {"lone_step_free_order_2", lone_step<free_motion, 2>},
    {"lone_step_gravity_gradient_order_2", lone_step<gravity_gradient_motion, 2>},
    {"lone_step_pendulum_order_2", lone_step<pendulum_motion, 2>},
    {"lone_step_pendulum_order_4", lone_step<pendulum_motion, 4>},
    {"step_with_ellipsoid_free_order_2", step_with_ellipsoid<free_motion, 2>},
    {"step_with_ellipsoid_exact_rotor_free_order_2", step_with_ellipsoid<exactly<free_motion>, 2>},
    {"step_with_ellipsoid_gravity_gradient_order_2", step_with_ellipsoid<gravity_gradient_motion, 2>},
    {"step_with_ellipsoid_pendulum_order_2", step_with_ellipsoid<pendulum_motion, 2>},
    {"step_with_ellipsoid_pendulum_order_4", step_with_ellipsoid<pendulum_motion, 4>},
    {"fuse_trace", fuse<Kind::trace>},
    {"fuse_volume", fuse<Kind::volume>},
    {"fuse_3_cones_and_rate_trace", fuse_quadrics<Kind::trace>},
    {"fuse_3_cones_and_rate_volume", fuse_quadrics<Kind::volume>},
    {"gyro_row_2_directions", gyro_row},
    {"paper_cycle_trace", first_order_cycle<PaperEstimator, Kind::trace>},
    {"paper_cycle_volume", first_order_cycle<PaperEstimator, Kind::volume>},
    {"first_order_cycle_trace", first_order_cycle<FirstOrderEstimator, Kind::trace>},
    {"first_order_cycle_volume", first_order_cycle<FirstOrderEstimator, Kind::volume>},
    {"guaranteed_cycle_trace", guaranteed_cycle<Kind::trace, false>},
    {"guaranteed_cycle_volume", guaranteed_cycle<Kind::volume, false>},
    {"guaranteed_cycle_with_bounds_trace", guaranteed_cycle<Kind::trace, true>},
    {"guaranteed_cycle_with_bounds_volume", guaranteed_cycle<Kind::volume, true>},
    {"wahba_svd_3_directions", wahba<WahbaMethod::svd, 3>},
    {"wahba_svd_5_directions", wahba<WahbaMethod::svd, 5>},
    {"wahba_foam_3_directions", wahba<WahbaMethod::foam, 3>},
    {"wahba_foam_5_directions", wahba<WahbaMethod::foam, 5>},
    {"wahba_davenport_3_directions", wahba<WahbaMethod::davenport, 3>},
    {"wahba_set_3_directions", set_of_directions<ExponentialChart, SetWeights::given, 3>},
    {"wahba_set_5_directions", set_of_directions<ExponentialChart, SetWeights::given, 5>},
    {"wahba_set_gibbs_3_directions", set_of_directions<GibbsChart, SetWeights::given, 3>},
    {"minimal_wahba_set_3_directions", set_of_directions<ExponentialChart, SetWeights::found, 3>},
    {"minimal_wahba_set_5_directions", set_of_directions<ExponentialChart, SetWeights::found, 5>},
    {"exp", rotation<Exponential, 1800>},
    {"exp_of_small_angle", rotation<Exponential, 100>},
    {"cayley", rotation<Cayley, 100>},
    {"log", logarithm},
    {"right_jacobian", rotation<RightJacobian, 1800>},
    {"right_jacobian_inverse", rotation<RightJacobianInverse, 1800>},
}};

}  // namespace elliptude::operations
