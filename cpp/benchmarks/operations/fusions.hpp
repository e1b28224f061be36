#pragma once

/// \file
/// Fusion of two ellipsoids, and of an ellipsoid with quadrics.

#include <algorithm>
#include <array>
#include <elliptude/measurement/quadrics.hpp>
#include <elliptude/sets/intersection.hpp>
#include <elliptude/sets/quadric_fusion.hpp>

#include "motions.hpp"

namespace elliptude::operations {

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

}  // namespace elliptude::operations
