// Each term of what is not known of a rigid body (theory, section 17.5), alone: an unknown torque, and an inertia error by each way in
// which it acts. The error is a small part of the set, so that the ellipsoid about the sum hides nothing (see
// test_attainment_gyro.cpp), and the truth comes to the edge (tests/mutations/error_tube.toml).
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Flow = GuaranteedRigidBodyFlow<double, GravityGradient<double>>;

struct Case {
  Vector3d moments = {1, 1.0001, 1.0002};
  Vector3d rate = Vector3d::Zero();
  double step = 0.1;
  double orbit_rate = 1e-6;
  Matrix3d attitude = Matrix3d::Identity();
  double unknown = 0;                  ///< half-width of the unknown torque
  double inertia = 0;                  ///< bound of the inertia's error
  Matrix3d wrong = Matrix3d::Zero();   ///< that error
  Vector3d torque = Vector3d::Zero();  ///< the unknown torque that acts
  Vector3d control = Vector3d::Zero();
  Vector3d wheel = Vector3d::Zero();
};

/// The final form of the state that begins on the rim of the set, where the errors push it outwards.
double final_form(const Case& c) {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(c.moments.asDiagonal().toDenseMatrix(), body) == Status::ok);
  GravityGradient<double> gradient;
  REQUIRE(GravityGradient<double>::make(body, c.orbit_rate, Matrix3d::Identity(), gradient) == Status::ok);
  BodyUncertainty<double> uncertainty;
  uncertainty.torque = c.unknown * c.unknown * Matrix3d::Identity();
  uncertainty.inertia = c.inertia;
  Flow flow;
  REQUIRE(Flow::make(body, gradient, c.step, uncertainty, flow) == Status::ok);
  BodyInput<double> input;
  input.control_torque = c.control;
  input.wheel_momentum = c.wheel;
  const double size = 1e-3;
  const GibbsEllipsoid<RigidBodyState<double>> before{{c.attitude, c.rate}, size * size * Matrix6<double>::Identity()};
  GibbsEllipsoid<RigidBodyState<double>> after;
  REQUIRE(flow.predict(0, c.step, input, before, after) == Status::ok);
  const RealMatrix inertia = (body.inertia() + c.wrong).cast<Real>();
  const RealTorque torque = [&](const RealMatrix& a, Real t) {
    return RealVector(gradient_torque(inertia, Real(c.orbit_rate), a, t) + (c.control + c.torque).cast<Real>());
  };
  const auto end = [&](const RealVector6& u) {
    return gibbs_error(after.center,
                       independent_flow(inertia, torque, gibbs_motion(before.center, RealVector6(size * u)), 0,
                                        Real(c.step), 1, c.wheel.cast<Real>()));
  };
  const RealMatrix6 metric = RealMatrix6(after.shape.cast<Real>()).inverse();
  const RealVector6 middle = end(RealVector6::Zero());
  RealVector6 u;
  for (int i = 0; i < 6; ++i) {
    const RealVector6 step = 1e-3L * RealVector6::Unit(i);
    u(i) = (metric * middle).dot(end(step) - end(-step));
  }
  u.normalize();
  const RealVector6 y = end(u);
  return static_cast<double>(y.dot(metric * y));
}

void check(const Case& c, double least) {
  const double form = final_form(c);
  CHECK(form <= 1);
  CHECK(form > least);
}

const double diagonal = std::sqrt(0.5);

}  // namespace

TEST_CASE("an unknown torque alone reaches the edge") {
  Case c;
  c.unknown = 5e-4;
  c.torque = {5e-4, 0, 0};
  check(c, 0.97);
  c.moments = {3, 4, 5};
  c.unknown = 1.5e-3;
  c.torque = {1.5e-3, 0, 0};
  check(c, 0.97);
}

TEST_CASE("an inertia error turns the momentum away from the rate") {
  Case c;
  c.inertia = 5e-4;
  c.rate = {diagonal, diagonal, 0};
  c.wrong = c.inertia * Vector3d(1, -1, 0).asDiagonal().toDenseMatrix();
  check(c, 0.97);
}

TEST_CASE("an inertia error changes what a control torque does") {
  Case c;
  c.inertia = 5e-4;
  c.control = {1, 0, 0};
  c.wrong = c.inertia * Vector3d(-1, 0, 0).asDiagonal().toDenseMatrix();
  check(c, 0.97);
}

TEST_CASE("an inertia error changes what a wheel does") {
  Case c;
  c.step = 0.01;
  c.inertia = 5e-3;
  c.wheel = {0, 0, 20};
  c.rate = {0.05, 0, 0};
  c.wrong = c.inertia * Vector3d(-1, -1, 0).asDiagonal().toDenseMatrix();
  check(c, 0.95);
}

TEST_CASE("an inertia error moves the gravity gradient's torque") {
  Case c;
  c.inertia = 1.7e-4;
  c.orbit_rate = 1;
  c.wrong << 0, c.inertia, 0, c.inertia, 0, 0, 0, 0, 0;
  check(c, 0.95);
}

TEST_CASE("an inertia error changes what an unknown torque does") {
  Case c;
  c.inertia = 0.2;
  c.unknown = 4e-4;
  c.torque = {4e-4, 0, 0};
  c.wrong = c.inertia * Vector3d(-1, 0, 0).asDiagonal().toDenseMatrix();
  check(c, 0.95);
}

TEST_CASE("an inertia error changes what the body's own motion and the field do") {
  Case c;
  c.moments = {1, 1.5, 1.99};
  c.inertia = 5e-4;
  // ω × Jω is along the second axis, where the body is lighter than it is taken for, and so is ω × Δω.
  double largest = 0;
  for (const double side : {-1.0, 1.0}) {
    for (const double sign : {-1.0, 1.0}) {
      c.rate = {side * diagonal, 0, diagonal};
      c.wrong = c.inertia * Vector3d(sign, -1, -sign).asDiagonal().toDenseMatrix();
      const double form = final_form(c);
      CHECK(form <= 1);
      largest = std::fmax(largest, form);
    }
  }
  CHECK(largest > 0.9);
  // The same of the field's torque, at 45 degrees.
  largest = 0;
  c.rate.setZero();
  c.orbit_rate = 1;
  c.inertia = 1.2e-4;
  for (const double side : {-1.0, 1.0}) {
    for (const double sign : {-1.0, 1.0}) {
      c.attitude << diagonal, 0, -side * diagonal, 0, 1, 0, side * diagonal, 0, diagonal;
      c.wrong = c.inertia * Vector3d(sign, -1, -sign).asDiagonal().toDenseMatrix();
      const double form = final_form(c);
      CHECK(form <= 1);
      largest = std::fmax(largest, form);
    }
  }
  CHECK(largest > 0.9);
}

TEST_CASE("over a long step a small set holds what the series leave out") {
  // The linear part is carried to fourth order in time, the center to eighth: relative to the set, what the first leaves out does
  // not depend on its size, and the second outweighs in a tiny one.
  Random random(5);
  int closed = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const Vector3d moments(1, 1.5, 1.99);
    RigidBody<double> body;
    REQUIRE(RigidBody<double>::make(moments.asDiagonal().toDenseMatrix(), body) == Status::ok);
    GravityGradient<double> gradient;
    const double orbit_rate = trial % 3 == 0 ? 0.8 : 1e-6;
    REQUIRE(GravityGradient<double>::make(body, orbit_rate, Matrix3d::Identity(), gradient) == Status::ok);
    const double step = random.uniform(0.3, 0.7);
    Flow flow;
    REQUIRE(Flow::make(body, gradient, step, BodyUncertainty<double>{}, flow) == Status::ok);
    BodyInput<double> input;
    input.wheel_momentum = trial % 2 == 0 ? Vector3d(0.5 * random.unit_vector<3>()) : Vector3d::Zero();
    const double size = trial % 4 < 2 ? 1e-5 : random.log_uniform(1e-11, 1e-8);
    const GibbsEllipsoid<RigidBodyState<double>> before{{random.rotation(), 0.8 * random.unit_vector<3>()},
                                                        size * size * Matrix6<double>::Identity()};
    GibbsEllipsoid<RigidBodyState<double>> after;
    if (flow.predict(0, step, input, before, after) != Status::ok) {
      continue;
    }
    ++closed;
    const RealTorque torque = [&](const RealMatrix& a, Real t) {
      return gradient_torque(body.inertia().cast<Real>(), Real(orbit_rate), a, t);
    };
    const auto end = [&](const RealVector6& y) {
      return gibbs_error(after.center,
                         independent_flow(body.inertia().cast<Real>(), torque, gibbs_motion(before.center, y), 0,
                                          Real(step), 3, input.wheel_momentum.cast<Real>()));
    };
    RealMatrix6 linear;
    for (int i = 0; i < 6; ++i) {
      const RealVector6 e = 1e-5L * RealVector6::Unit(i);
      linear.col(i) = Real(size) * (end(e) - end(-e)) / 2e-5L;
    }
    const RealMatrix6 metric = RealMatrix6(after.shape.cast<Real>()).inverse();
    const RealMatrix6 seen = linear.transpose() * metric * linear;
    const Eigen::SelfAdjointEigenSolver<RealMatrix6> axes(seen);
    CHECK(axes.eigenvalues().maxCoeff() <= 1);
    const RealVector6 middle = end(RealVector6::Zero());
    for (int i = 0; i < 6; ++i) {
      for (const Real sign : {-1.0L, 1.0L}) {
        const RealVector6 y = middle + linear * (sign * axes.eigenvectors().col(i));
        CHECK(y.dot(metric * y) <= 1);
      }
    }
  }
  CHECK(closed >= 10);
}
