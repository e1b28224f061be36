// Each part of the bound of the center's defect, alone (theory, section 17.2; tests/mutations/motion_series.toml).
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

TEST_CASE("of the gyroscopic torque every product beyond the last coefficient counts") {
  // Long steps, so that the later products count as much as the first, written down as the theory does.
  Random random(1);
  int later = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const RigidBody<double> body = random_body(random);
    MotionSeries<double, FreeBody<double>> series(body, {});
    BodyInput<double> input;
    input.wheel_momentum = trial % 2 == 0 ? Vector3d::Zero() : Vector3d(0.1 * random.unit_vector<3>());
    const double h = random.log_uniform(0.1, 3);
    if (series.expand(body, 0, h, input, {random.rotation(), random.unit_vector<3>()}) != Status::ok) {
      continue;
    }
    const RealMatrix inertia = body.inertia().cast<Real>();
    Real all = 0;
    Real first = 0;
    for (int i = 0; i <= 8; ++i) {
      for (int j = 8 - i; j <= 8; ++j) {
        const RealVector rate = series.rate[static_cast<std::size_t>(i)].cast<Real>();
        RealVector momentum = inertia * series.rate[static_cast<std::size_t>(j)].cast<Real>();
        momentum += j == 0 ? RealVector(input.wheel_momentum.cast<Real>()) : RealVector::Zero();
        const Real size = rate.norm() * momentum.norm() * std::pow(Real(h), Real(i + j + 1)) / 9;
        all += size;
        first += i + j == 8 ? size : 0;
      }
    }
    all /= static_cast<Real>(body.principal_moments()(2));
    first /= static_cast<Real>(body.principal_moments()(2));
    CHECK(all * (1 - 1e-9L) <= static_cast<Real>(series.rate_defect));
    CHECK(static_cast<Real>(series.rate_defect) <= all * (1 + 1e-9L) + 1e-10L);
    later += all > 1.05L * first && all > 1e-8L ? 1 : 0;
  }
  MESSAGE("where later products count: " << later);
  CHECK(later > 20);
}

TEST_CASE("of a torque that turns by itself the series is not whole") {
  // A body at rest on an orbit: what it gyrates is of second order in the torque.
  const RigidBody<double> body = [] {
    RigidBody<double> made;
    REQUIRE(RigidBody<double>::make(Vector3d(1, 1.001, 1.002).asDiagonal(), made) == Status::ok);
    return made;
  }();
  const RealMatrix inertia = body.inertia().cast<Real>();
  GravityGradient<double> gradient;
  REQUIRE(GravityGradient<double>::make(body, 1, Matrix3d::Identity(), gradient) == Status::ok);
  double largest = 0;
  for (const double h : {0.3, 0.5}) {
    for (const double time : {0.0, 0.4, 0.8}) {
      MotionSeries<double, GravityGradient<double>> series(body, gradient);
      const RigidBodyState<double> state{Matrix3d::Identity(), Vector3d::Zero()};
      REQUIRE(series.expand(body, time, h, {}, state) == Status::ok);
      const auto rate = [&](Real s, int derivative) {
        RealVector sum = RealVector::Zero();
        for (int k = 8; k >= derivative; --k) {
          sum = s * sum + (derivative == 1 ? k : 1) * series.rate[static_cast<std::size_t>(k)].cast<Real>();
        }
        return sum;
      };
      const RealTorque drive = [&](const RealMatrix&, Real s) { return rate(s, 1); };
      constexpr int parts = 32;
      Motion motion = gibbs_motion(state, RealVector6::Zero());
      Real impulse = 0;
      for (int k = 0; k <= parts; ++k) {
        const Real s = Real(h) * k / parts;
        if (k > 0) {
          motion = independent_flow(RealMatrix::Identity(), drive, motion, s - Real(h) / parts, Real(h) / parts, 1);
        }
        const RealVector w = rate(s, 0);
        const RealVector defect =
            rate(s, 1) + inertia.inverse() * RealVector(w.cross(RealVector(inertia * w)) -
                                                        gradient_torque(inertia, 1, motion.attitude, Real(time) + s));
        impulse += defect.norm() * (k == 0 || k == parts ? 1 : k % 2 == 1 ? 4 : 2);
      }
      const double share = static_cast<double>(impulse * Real(h) / (3 * parts)) / series.rate_defect;
      CHECK(share <= 1);
      largest = std::fmax(largest, share);
    }
  }
  MESSAGE("of the bound: " << largest);
  CHECK(largest > 0.005);
}
