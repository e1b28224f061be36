#pragma once

/// \file
/// A body in free motion with sensors that keep their bounds, and filters to try on it.

#include <doctest/doctest.h>

#include <vector>

#include "support/guaranteed.hpp"

namespace elliptude::testing {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using BodyFlow = GuaranteedRigidBodyFlow<double, FreeBody<double>>;
using BodyFilter = GuaranteedFilter<BodyFlow>;
using State = RigidBodyState<double>;
using Report = GuaranteedUpdate<double>;

inline constexpr double bound = 0.02;

inline BodyFilter filter_with(const BodyFilter::Settings& settings) {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(Vector3d(1, 2, 2.5).asDiagonal(), body) == Status::ok);
  BodyFlow flow;
  REQUIRE(BodyFlow::make(body, {}, 0.05, {}, flow) == Status::ok);
  BodyFilter filter;
  REQUIRE(BodyFilter::make(flow, settings, 0, filter) == Status::ok);
  return filter;
}

inline State after(const State& state, double duration) {
  const RealMatrix inertia = Vector3d(1, 2, 2.5).cast<Real>().asDiagonal();
  const RealTorque none = [](const RealMatrix&, Real) { return RealVector(RealVector::Zero()); };
  const Motion motion = independent_flow(inertia, none, gibbs_motion(state, RealVector6::Zero()), 0, Real(duration), 4);
  return {motion.attitude.cast<double>(), motion.angular_velocity.cast<double>()};
}

inline Direction<double> measured(const State& truth, const Vector3d& reference, const Vector3d& error) {
  const Vector3d body = exp(error) * (truth.attitude.transpose() * reference);
  return Direction<double>::within(reference, body, bound);
}

/// Everything that can be asked, to compare.
struct Snapshot {
  double time;
  Claim claim;
  bool knows;
  Matrix6<double> shape;
  Matrix3d attitude;
};
inline Snapshot snapshot(const BodyFilter& filter) {
  Snapshot s{filter.time(), filter.claim(), filter.knows_attitude(), Matrix6<double>::Zero(), Matrix3d::Zero()};
  if (s.knows) {
    s.shape = filter.ellipsoid().shape;
    s.attitude = filter.ellipsoid().center.attitude;
  }
  return s;
}
inline bool same(const Snapshot& a, const Snapshot& b) {
  return a.time == b.time && a.claim == b.claim && a.knows == b.knows && a.shape == b.shape && a.attitude == b.attitude;
}

inline double form_of(const BodyFilter& filter, const State& truth) {
  double form = 2;
  REQUIRE(quadratic_form(filter.ellipsoid(), truth, form) == Status::ok);
  return form;
}

struct Scene {
  Random random;
  State truth;
  std::vector<Vector3d> references;
  std::vector<Direction<double>> directions;
  AngularVelocity<double> rate;

  explicit Scene(std::uint64_t seed) : random(seed), truth{random.rotation(), 0.5 * random.unit_vector<3>()} {
    const Matrix3d axes = random.rotation();
    references = {axes.col(0), axes.col(1), axes.col(2), axes * Vector3d(1, 1, 1).normalized()};
    measure();
  }
  void move(double duration) {
    truth = after(truth, duration);
    measure();
  }
  void measure() {
    directions.clear();
    for (const Vector3d& r : references) {
      directions.push_back(measured(truth, r, 0.999 * bound * random.unit_vector<3>()));
    }
    rate = {truth.angular_velocity + 0.999 * bound * random.unit_vector<3>(), bound * bound * Matrix3d::Identity()};
  }
  [[nodiscard]] Measurements<double> all() const { return {directions.data(), directions.size(), &rate, nullptr}; }
};

}  // namespace elliptude::testing
