#pragma once

/// \file
/// What is measured, in time by `benchmark_core` and in instructions by `instructions_core`: each operation is a
/// function that runs `count` times and returns a number made of all the results, so that none of them can be left out.

#include <array>

#include "operations/cycles.hpp"
#include "operations/fusions.hpp"
#include "operations/motions.hpp"
#include "operations/rotations.hpp"
#include "operations/wahba.hpp"

namespace elliptude::operations {

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
