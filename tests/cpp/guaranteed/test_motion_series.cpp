// The motion's power series against the independent integrator: the end of a step, and that the bounds of its error hold also
// where the step is long and the error large.
#include <doctest/doctest.h>

#include <array>
#include <vector>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

struct Result {
  double attitude_share = 0;  ///< of the bound
  double defect_share = 0;
  int accepted = 0;
};

template <typename Potential>
void check_step(const RigidBody<double>& body, const Potential& potential, const RealTorque& torque, double h,
                Random& random, Result& result) {
  const RigidBodyState<double> state{random.rotation(), random.normal_matrix<3>()};
  const double time = random.uniform(0, 20);
  BodyInput<double> input;
  const double least = body.principal_moments()(2);
  input.wheel_momentum = least * random.normal_matrix<3>();
  input.control_torque = least * random.normal_matrix<3>();
  MotionSeries<double, Potential> series(body, potential);
  const Status status = series.expand(body, time, h, input, state);
  if (status != Status::ok) {
    REQUIRE(status == Status::step_too_long);
    return;
  }
  ++result.accepted;
  const RealVector control = input.control_torque.cast<Real>();
  const RealVector wheel = input.wheel_momentum.cast<Real>();
  const RealMatrix inertia = body.inertia().cast<Real>();
  const RealVector6 zero = RealVector6::Zero();
  const Motion start = gibbs_motion(state, zero);

  // The attitude that has exactly the rate of the series: of a body of unit inertia that is driven so.
  const auto rate = [&](Real s, int derivative) {
    RealVector sum = RealVector::Zero();
    for (int k = series.order; k >= derivative; --k) {
      sum = s * sum + (derivative == 1 ? k : 1) * series.rate[static_cast<std::size_t>(k)].template cast<Real>();
    }
    return sum;
  };
  const RealTorque drive = [&](const RealMatrix&, Real s) { return rate(s, 1); };
  const Motion with_rate = independent_flow(RealMatrix::Identity(), drive, start, 0, Real(h), 8);
  const double angle = static_cast<double>(gibbs_error(series.end, with_rate).template head<3>().norm());
  CHECK(angle <= series.attitude_error);
  CHECK((series.end.angular_velocity.template cast<Real>() - rate(Real(h), 0)).norm() <
        1e-14L * (1 + Real(series.largest_rate)));
  result.attitude_share = std::fmax(result.attitude_share, angle / series.attitude_error);

  // What the defect adds up to, by Simpson's rule along the step.
  const RealMatrix inverse = inertia.inverse();
  const int parts = 16;
  Real impulse = 0;
  Motion motion = start;
  for (int k = 0; k <= parts; ++k) {
    const Real s = static_cast<Real>(h) * k / parts;
    if (k > 0) {
      motion = independent_flow(RealMatrix::Identity(), drive, motion, s - static_cast<Real>(h) / parts,
                                static_cast<Real>(h) / parts, 1);
    }
    const RealVector w = rate(s, 0);
    const RealVector defect =
        rate(s, 1) + inverse * RealVector(w.cross(RealVector(inertia * w + wheel)) -
                                          torque(motion.attitude, static_cast<Real>(time) + s) - control);
    impulse += defect.norm() * (k == 0 || k == parts ? 1 : k % 2 == 1 ? 4 : 2);
  }
  impulse *= static_cast<Real>(h) / (3 * parts);
  CHECK(static_cast<double>(impulse) <= series.rate_defect);
  result.defect_share = std::fmax(result.defect_share, static_cast<double>(impulse) / series.rate_defect);

  // And where the bounds say rounding, the end is that of the motion itself.
  if (series.rate_defect < 1e-12 && series.attitude_error < 1e-13) {
    const RealTorque whole = [&](const RealMatrix& a, Real t) { return RealVector(torque(a, t) + control); };
    const Motion end = independent_flow(inertia, whole, start, Real(time), Real(h), 4, wheel);
    CHECK(static_cast<double>(gibbs_error(series.end, end).norm()) < 1e-11);
  }
}

}  // namespace

TEST_CASE("the end of a step, and the bounds of its error at any length") {
  Random random(20260403);
  for (const double h : {0.001, 0.01, 0.05, 0.1, 0.2, 0.4}) {
    Result result;
    for (int trial = 0; trial < 40; ++trial) {
      const RigidBody<double> body = random_body(random);
      const RealMatrix inertia = body.inertia().cast<Real>();
      const Vector3d arm = body.principal_moments()(2) * random.normal_matrix<3>();
      const double rate = random.uniform(0.3, 1);
      UniformGravity<double> gravity;
      REQUIRE(UniformGravity<double>::make(1, 1, arm, gravity) == Status::ok);
      GravityGradient<double> gradient;
      REQUIRE(GravityGradient<double>::make(body, rate, Matrix3d::Identity(), gradient) == Status::ok);
      const RealTorque by_gravity = [&](const RealMatrix& a, Real) { return pendulum_torque(arm, a); };
      const RealTorque by_gradient = [&](const RealMatrix& a, Real t) {
        return gradient_torque(inertia, Real(rate), a, t);
      };
      const RealTorque none = [](const RealMatrix&, Real) { return RealVector(RealVector::Zero()); };
      check_step(body, FreeBody<double>{}, none, h, random, result);
      check_step(body, gravity, by_gravity, h, random, result);
      check_step(body, gradient, by_gradient, h, random, result);
      check_step(
          body, SumPotential<UniformGravity<double>, GravityGradient<double>>(gravity, gradient),
          [&](const RealMatrix& a, Real t) { return RealVector(by_gravity(a, t) + by_gradient(a, t)); }, h, random,
          result);
    }
    MESSAGE("h = " << h << ": accepted " << result.accepted << " of 160, largest share of the bound: attitude "
                   << result.attitude_share << ", defect " << result.defect_share);
    CHECK(result.accepted > (h < 0.3 ? 100 : 0));
  }
}

TEST_CASE("the coefficients of the rate are its derivatives") {
  // Against central differences of the independent integrator's rate, at increasing order.
  Random random(4);
  const RigidBody<double> body = random_body(random);
  const Vector3d arm = body.principal_moments()(2) * random.normal_matrix<3>();
  UniformGravity<double> gravity;
  REQUIRE(UniformGravity<double>::make(1, 1, arm, gravity) == Status::ok);
  const RigidBodyState<double> state{random.rotation(), random.normal_matrix<3>()};
  MotionSeries<double, UniformGravity<double>> series(body, gravity);
  REQUIRE(series.expand(body, 0, 0.01, {}, state) == Status::ok);
  const RealTorque torque = [&](const RealMatrix& a, Real) { return pendulum_torque(arm, a); };
  const Motion start = gibbs_motion(state, RealVector6::Zero());
  const auto rate = [&](Real t) {
    return independent_flow(body.inertia().cast<Real>(), torque, start, 0, t, 1).angular_velocity;
  };
  const Real e = 0.005L;
  const RealVector first = (8 * (rate(e) - rate(-e)) - (rate(2 * e) - rate(-2 * e))) / (12 * e);
  const RealVector second = (rate(e) - 2 * rate(0) + rate(-e)) / (e * e);
  const RealVector third = (rate(2 * e) - 2 * rate(e) + 2 * rate(-e) - rate(-2 * e)) / (2 * e * e * e);
  CHECK((first.cast<double>() - series.rate[1]).norm() < 1e-7 * series.rate[1].norm());
  CHECK((second.cast<double>() / 2 - series.rate[2]).norm() < 1e-3 * series.rate[2].norm());
  CHECK((third.cast<double>() / 6 - series.rate[3]).norm() < 1e-3 * series.rate[3].norm());
}

TEST_CASE("the bound of a tail covers the series that grows as fast as it may") {
  // exp(g (Σ ‖ω_k‖ zᵏ + n) z) has coefficients that are not negative, and is as large as is allowed where z > 0.
  Random random(20260506);
  double least = 1;
  double largest = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const RigidBody<double> body = random_body(random);
    const double h = random.log_uniform(1e-4, 2);
    MotionSeries<double, FreeBody<double>> series(body, FreeBody<double>{});
    // Whether the step is refused for its attitude does not matter here.
    (void)series.expand(body, 0, h, {}, {random.rotation(), random.log_uniform(0.01, 3) * random.unit_vector<3>()});
    const Real growth = trial % 3 == 0 ? 0.5L : trial % 3;
    const Real turn = trial % 2 == 0 ? 0 : static_cast<Real>(random.log_uniform(0.01, 3));
    const int first = std::array<int, 3>{4, 8, 10}[static_cast<std::size_t>(trial / 3 % 3)];
    const double bound = series.tail(first, static_cast<double>(growth), static_cast<double>(turn), h);
    // (k + 1) f_{k+1} = Σ (i + 1) e_{i+1} f_{k−i} with the exponent's coefficients e, in units of the step.
    std::array<Real, MotionSeries<double, FreeBody<double>>::terms + 1> exponent{};
    for (std::size_t k = 0; k + 1 < exponent.size(); ++k) {
      exponent[k + 1] = growth * (static_cast<Real>(series.rate_norms[k]) + (k == 0 ? turn : 0)) *
                        std::pow(static_cast<Real>(h), static_cast<Real>(k + 1));
    }
    std::vector<Real> f{1};
    Real tail = 0;
    for (std::size_t k = 0; k < 2000; ++k) {
      Real sum = 0;
      for (std::size_t i = 0; i + 1 < exponent.size() && i <= k; ++i) {
        sum += static_cast<Real>(i + 1) * exponent[i + 1] * f[k - i];
      }
      f.push_back(sum / static_cast<Real>(k + 1));
      tail += static_cast<int>(k + 1) >= first ? f.back() : 0;
    }
    if (!std::isfinite(bound)) {
      continue;
    }
    REQUIRE(tail > 0);
    CHECK(tail <= static_cast<Real>(bound));
    least = std::fmin(least, static_cast<double>(tail / static_cast<Real>(bound)));
    largest = std::fmax(largest, static_cast<double>(tail / static_cast<Real>(bound)));
  }
  MESSAGE("the tail as a share of its bound: " << least << " to " << largest);
  CHECK(largest > 0.05);
}

TEST_CASE("what is not a motion is refused") {
  MotionSeries<double, FreeBody<double>> series(RigidBody<double>{}, FreeBody<double>{});
  const RigidBodyState<double> fast{Matrix3d::Identity(), Vector3d(100, 0, 0)};
  CHECK(series.expand(RigidBody<double>{}, 0, 1, {}, fast) == Status::step_too_long);
  const RigidBodyState<double> broken{Matrix3d::Identity(), Vector3d(std::nan(""), 0, 0)};
  CHECK(series.expand(RigidBody<double>{}, 0, 1, {}, broken) == Status::not_finite);
  // A free body has no function that could fail: it is the step that is too long.
  for (const double h : {1e60, 1e100, 1e300}) {
    CHECK(series.expand(RigidBody<double>{}, 0, h, {}, fast) == Status::step_too_long);
  }
}
