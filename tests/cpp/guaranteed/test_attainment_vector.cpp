// Each term of the bound of the angular velocity without an attitude (theory, section 17.5), alone: the truth's momentum grows as
// fast as it may, so that no term can be lost (tests/mutations/body_flow.toml).
#include <doctest/doctest.h>

#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/measurement/quadrics.hpp>
#include <limits>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Real = long double;
using RealMatrix = Matrix3<Real>;
using RealVector = Vector3<Real>;

/// What acts; the body has the moment J about every axis, so that a torque along the momentum keeps it there.
struct Case {
  double center = 0;   ///< rad/s about the first axis
  double spread = 0;   ///< of the set
  double inertia = 0;  ///< error
  double torque = 0;   ///< unknown
  double control = 0;
  double wheel = 0;
  double gravity = 0;  ///< the largest torque of a weight
};

constexpr double moment = 2;
constexpr double duration = 3;

/// The half-width of the predicted ω + J⁻¹h_w about the first axis.
double half_width(const Case& c) {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(moment * Matrix3d::Identity(), body) == Status::ok);
  BodyUncertainty<double> uncertainty;
  uncertainty.inertia = c.inertia;
  uncertainty.torque = c.torque * c.torque * Matrix3d::Identity();
  UniformGravity<double> gravity;
  REQUIRE(UniformGravity<double>::make(1, 1, Vector3d(0, 0, c.gravity > 0 ? c.gravity : 1e-12), gravity) == Status::ok);
  GuaranteedRigidBodyFlow<double, UniformGravity<double>> flow;
  REQUIRE(decltype(flow)::make(body, gravity, 0.1, uncertainty, flow) == Status::ok);
  BodyInput<double> input;
  input.control_torque(0) = c.control;
  input.wheel_momentum(0) = c.wheel;
  Ellipsoid<double, 3> before{Vector3d(c.center, 0, 0), (c.spread * c.spread + 1e-30) * Matrix3d::Identity()};
  Ellipsoid<double, 3> after;
  REQUIRE(flow.predict_vector(0, duration, input, before, after) == Status::ok);
  CHECK(after.center(0) == doctest::Approx(-c.wheel / moment));
  return std::sqrt(after.shape(0, 0));
}

void check(double needed, double granted, double share = 0.999) {
  CHECK(needed <= granted * (1 + 1e-9));
  CHECK(needed >= share * granted);
}

}  // namespace

TEST_CASE("what is known before: the center and the spread and the wheel") {
  check(0.7, half_width({0.7}));
  check(0.7 + 0.2, half_width({0.7, 0.2}));
  check(0.2, half_width({0, 0.2}));
  // Jω + h_w is what keeps its length.
  check(0.7 + 0.5 / moment, half_width({0.7, 0, 0, 0, 0, 0.5}));
  check(0.7 - 0.5 / moment, half_width({0.7, 0, 0, 0, 0, -0.5}));
}

TEST_CASE("torques push along the momentum") {
  check(0.7 + duration * 0.1 / moment, half_width({0.7, 0, 0, 0.1}));
  check(0.7 + duration * 0.1 / moment, half_width({0.7, 0, 0, 0, 0.1}));
  // The weight can do so at any moment, and not all the time: what is bounded is its size.
  check(0.7 + duration * 0.1 / moment, half_width({0.7, 0, 0, 0, 0, 0, 0.1}), 0.97);  // a norm is bounded from above
}

TEST_CASE("an inertia error makes the momentum larger and then the body lighter") {
  // A body of J + e before has more momentum than J says; one of J − e turns faster with what it has.
  const double e = 0.2;
  const double rate = 0.7;
  const double granted = half_width({rate, 0, e});
  const double grown = (moment + e) * rate;
  // p = grown, and e ‖ω‖ ≤ e p/(J − e) more.
  check((grown + e * grown / (moment - e)) / moment, granted);
  // A truth with an axis of each, from one to the other by its own motion, turns as fast as that allows for no wheel.
  CHECK(grown / (moment - e) <= granted * (1 + 1e-12));
  // A wheel that cancels the momentum does not cancel the error: ω = (p + h_w)/(J − e) at most.
  const double wheel = -moment * rate;
  const double left = e * rate;
  const double with_wheel = half_width({rate, 0, e, 0, 0, wheel});
  check((left + e * (left - wheel) / (moment - e)) / moment, with_wheel);
}

TEST_CASE("an inertia error moves the gravity gradient") {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(moment * Matrix3d::Identity(), body) == Status::ok);
  GravityGradient<double> gradient;
  REQUIRE(GravityGradient<double>::make(body, 0.5, Matrix3d::Identity(), gradient) == Status::ok);
  BodyUncertainty<double> uncertainty;
  uncertainty.inertia = 0.2;
  GuaranteedRigidBodyFlow<double, GravityGradient<double>> flow;
  REQUIRE(decltype(flow)::make(body, gradient, 0.1, uncertainty, flow) == Status::ok);
  Ellipsoid<double, 3> after;
  REQUIRE(flow.predict_vector(0, duration, {}, {Vector3d::Zero(), 1e-30 * Matrix3d::Identity()}, after) == Status::ok);
  // A sphere has no torque; with moments 2.2, 2 and 1.8 the error's own is 3n² · ½ · 0.4 at 45°, as large as 3n² e.
  const double torque = 3 * 0.25 * 0.2;
  check(duration * torque * (1 + 0.2 / 1.8) / moment, std::sqrt(after.shape(0, 0)), 0.99);
}

TEST_CASE("a measured rate is within its bound about any center") {
  // 1.5 rad/s seen from 1 rad/s within 0.2: from 0.3 to 0.7.
  Quadric<double, 3> quadric;
  const AngularVelocity<double> measured{Vector3d(1.5, 0, 0), 0.04 * Matrix3d::Identity()};
  REQUIRE(to_quadric(Vector3d(1, 0, 0), measured, quadric) == Status::ok);
  CHECK(contains(quadric, Vector3d(0.699, 0, 0)));
  CHECK(contains(quadric, Vector3d(0.301, 0, 0)));
  CHECK_FALSE(contains(quadric, Vector3d(0.701, 0, 0)));
  CHECK_FALSE(contains(quadric, Vector3d(0.299, 0, 0)));
}

TEST_CASE_TEMPLATE("a momentum that the wheel cancels is known only to rounding", Scalar, double, float) {
  Random random(6);
  Real worst = 0;
  for (int trial = 0; trial < 500; ++trial) {
    const auto inertia = static_cast<Scalar>(random.log_uniform(0.1, 10));
    RigidBody<Scalar> body;
    GuaranteedRigidBodyFlow<Scalar, FreeBody<Scalar>> flow;
    REQUIRE(RigidBody<Scalar>::make(inertia * Matrix3<Scalar>::Identity(), body) == Status::ok);
    REQUIRE(decltype(flow)::make(body, {}, 1, {}, flow) == Status::ok);
    const auto rate = static_cast<Scalar>(random.uniform(-1, 1));
    const auto width = static_cast<Scalar>(random.log_uniform(50, 1e4)) * std::numeric_limits<Scalar>::epsilon();
    BodyInput<Scalar> input;
    input.wheel_momentum(0) = -inertia * rate;
    Ellipsoid<Scalar, 3> before{rate * Vector3<Scalar>::UnitX(), Matrix3<Scalar>::Zero()};
    before.shape.diagonal() << width * width, Scalar(1e-8F) * width * width, Scalar(1e-8F) * width * width;
    Ellipsoid<Scalar, 3> after;
    REQUIRE(flow.predict_vector(0, Scalar(0.125F), input, before, after) == Status::ok);
    for (const int side : {-1, 1}) {  // turns about a principal axis, and so for good
      const Real truth = static_cast<Real>(rate) + side * std::sqrt(static_cast<Real>(before.shape(0, 0)));
      const Real error = truth - static_cast<Real>(after.center(0));
      worst = std::fmax(worst, error * error / static_cast<Real>(after.shape(0, 0)));
    }
  }
  CHECK(static_cast<double>(worst - 1) <= 0);
}

TEST_CASE_TEMPLATE("a needle's rate is known only to rounding", Scalar, double, float) {
  Random random(7);
  Real worst = 0;
  int known = 0;
  for (int trial = 0; trial < 500; ++trial) {
    const double ratio = random.log_uniform(1e2, 1e4);
    RigidBody<Scalar> body;
    GuaranteedRigidBodyFlow<Scalar, FreeBody<Scalar>> flow;
    const Matrix3d inertia = random.symmetric<3>(Vector3d(1, 1, 1 / ratio));
    REQUIRE(RigidBody<Scalar>::make(inertia.cast<Scalar>(), body) == Status::ok);
    REQUIRE(decltype(flow)::make(body, {}, 1, {}, flow) == Status::ok);
    const Eigen::SelfAdjointEigenSolver<RealMatrix> axes(RealMatrix(body.inertia().template cast<Real>()));
    const RealVector rate = static_cast<Real>(ratio) * axes.eigenvectors().col(0);
    const Ellipsoid<Scalar, 3> before{rate.cast<Scalar>(), Scalar(1e-16F) * Matrix3<Scalar>::Identity()};
    Ellipsoid<Scalar, 3> after;
    // So short that nothing moves.
    const Status status = flow.predict_vector(0, std::ldexp(Scalar(1), -100), {}, before, after);
    if (status != Status::beyond_domain) {  // else rounding leaves no inverse
      REQUIRE(status == Status::ok);
      const RealVector error = (before.center - after.center).template cast<Real>();
      worst = std::fmax(worst, error.dot(RealMatrix(after.shape.template cast<Real>()).llt().solve(error)));
      ++known;
    }
  }
  CHECK(static_cast<double>(worst - 1) <= 0);
  CHECK(known > 400);
}

TEST_CASE("a momentum that cancels is as large as its rounding, and so is what the center leaves") {
  constexpr double exact_moment = 4;  // whose root and inverse round nowhere
  RigidBody<double> body;
  GuaranteedRigidBodyFlow<double, FreeBody<double>> flow;
  REQUIRE(RigidBody<double>::make(exact_moment * Matrix3d::Identity(), body) == Status::ok);
  REQUIRE(decltype(flow)::make(body, {}, 1, {}, flow) == Status::ok);
  const auto half_width_about = [&](double rate, double wheel) {
    BodyInput<double> input;
    input.wheel_momentum(0) = wheel;
    const Ellipsoid<double, 3> before{Vector3d(rate, 0, 0), 1e-40 * Matrix3d::Identity()};
    Ellipsoid<double, 3> after;
    REQUIRE(flow.predict_vector(0, 0.125, input, before, after) == Status::ok);
    return std::sqrt(after.shape(0, 0));
  };
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  // 8 ε of |J||ω| + |h_w|, of the momentum and of what the center -h_w/J leaves of it: of two terms of 1 each.
  check(2 * 8 * epsilon * 2 / exact_moment, half_width_about(1 / exact_moment, -1), 0.99);
  // The wheel's alone, where the center is all: of one term, and of two.
  const double wheel_alone = half_width_about(0, 1) * exact_moment;
  check(1 + 8 * epsilon + 2 * 8 * epsilon, wheel_alone, 1 - 200 * epsilon);
}

TEST_CASE("an inverse that rounding made too small makes the set wider by what is left of J X") {
  Random random(8);
  for (int trial = 0; trial < 50; ++trial) {
    const double ratio = random.log_uniform(1e8, 1e10);
    RigidBody<double> body;
    GuaranteedRigidBodyFlow<double, FreeBody<double>> flow;
    REQUIRE(RigidBody<double>::make(random.symmetric<3>(Vector3d(1, 1, 1 / ratio)), body) == Status::ok);
    REQUIRE(decltype(flow)::make(body, {}, 1, {}, flow) == Status::ok);
    // Across the needle's axis, where the momentum is large and its rounding nothing beside it.
    const Eigen::SelfAdjointEigenSolver<Matrix3d> axes(body.inertia());
    const Vector3d rate = axes.eigenvectors().col(2);
    Ellipsoid<double, 3> after;
    REQUIRE(flow.predict_vector(0, std::ldexp(1.0, -100), {}, {rate, 1e-40 * Matrix3d::Identity()}, after) ==
            Status::ok);
    const double momentum = (body.inertia() * rate).norm();
    const double granted = std::sqrt(after.shape.trace()) / body.inertia_inverse().norm();
    const RealMatrix left = body.inertia().cast<Real>() * body.inertia_inverse().cast<Real>() - RealMatrix::Identity();
    const double wider = granted / momentum - 1;
    CHECK(wider >= static_cast<double>(left.norm()));
    CHECK(wider > 1e-16 * ratio);
    CHECK(wider < 1e-14 * ratio);
  }
}
