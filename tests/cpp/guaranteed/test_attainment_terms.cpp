// The terms of the tube's bounds one by one (theory, section 17.4): in each case one of them is most of the rest or of the pushes, and
// a true motion needs it. Seen in the tube's own coordinates, y = Y (u₀ + q(u₀) + p + r), where other terms hide nothing.
#include <doctest/doctest.h>

#include <functional>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Vector6d = Vector6<double>;
using Flow = std::function<Motion(const Motion&)>;

const RealTorque no_torque = [](const RealMatrix&, Real) { return RealVector(RealVector::Zero()); };

Matrix6<double> diagonal_shape(const Vector3d& attitude, const Vector3d& rate) {
  Vector6d squares;
  squares << attitude.cwiseAbs2(), rate.cwiseAbs2();
  return squares.asDiagonal().toDenseMatrix();
}

RigidBody<double> body_of(const Vector3d& moments) {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(moments.asDiagonal().toDenseMatrix(), body) == Status::ok);
  return body;
}

/// A tube from its start over some steps, and what a true motion leaves of it.
template <typename Potential>
struct Followed {
  RigidBody<double> body;
  RigidBodyState<double> start;
  MotionSeries<double, Potential> series;
  ErrorTube<double, Potential> tube;
  RealMatrix6 first_frame;
  BodyInput<double> input;
  BodyUncertainty<double> uncertainty;

  Followed(const RigidBody<double>& of, const Potential& potential, const RigidBodyState<double>& state,
           const Matrix6<double>& shape)
      : body(of), start(state), series(of, potential) {
    REQUIRE(tube.start(shape, 0, 0) == Status::ok);
    first_frame = tube.frame().template cast<Real>();
  }

  void expand(double h, double time = 0) {
    REQUIRE(series.expand(body, time, h, input, time == 0 ? start : series.end) == Status::ok);
  }
  void step() { REQUIRE(tube.step(body, series, uncertainty) == Status::ok); }
  void follow(double h, int steps = 1) {
    for (int k = 0; k < steps; ++k) {
      expand(h, k * h);
      step();
    }
  }

  [[nodiscard]] Motion motion(const RealVector6& u) const { return gibbs_motion(start, RealVector6(first_frame * u)); }
  /// p + r of the motion that began at u and has now come here.
  [[nodiscard]] RealVector6 left(const RealVector6& u, const Motion& end) const {
    const RealMatrix6 frame = tube.frame().template cast<Real>();
    return RealVector6(frame.inverse() * gibbs_error(series.end, end) - u - second_order(tube, u));
  }
  /// p + r must be in the sum of the pushes' ellipsoid and the ball of the rest: how much of that sum's width this takes in the
  /// direction, of some, in which it takes most. Those are that of p + r itself, and across the longest axes of the pushes.
  [[nodiscard]] double share(const RealVector6& r) const {
    const Eigen::SelfAdjointEigenSolver<RealMatrix6> pushes(RealMatrix6(tube.pushed().template cast<Real>()));
    double largest = 0;
    RealVector6 d = r;
    for (int k = 5; k >= 0; --k) {
      const Real length = d.norm();
      if (length > 0) {
        const Real width = std::sqrt(std::fmax(d.dot(tube.pushed().template cast<Real>() * d), Real(0)));
        largest = std::fmax(largest, static_cast<double>(r.dot(d) / (width + length * static_cast<Real>(tube.rest()))));
      }
      d -= pushes.eigenvectors().col(k).dot(d) * pushes.eigenvectors().col(k);
    }
    return largest;
  }
};

/// The truth is in the set, and so near to its edge that it would not be without the term.
void check(double share, double least) {
  MESSAGE("of the bound: " << share);
  CHECK(share <= 1);
  CHECK(share > least);
}

/// Motions from the six axes of u and back, odd part only: the linear part of what is left.
template <typename Potential>
RealMatrix6 linear_left(const Followed<Potential>& tube, const Flow& flow) {
  RealMatrix6 columns;
  const Real e = 1e-3L;
  for (int i = 0; i < 6; ++i) {
    const RealVector6 u = e * RealVector6::Unit(i);
    columns.col(i) = (tube.left(u, flow(tube.motion(u))) - tube.left(-u, flow(tube.motion(RealVector6(-u))))) / (2 * e);
  }
  return columns;
}

double norm_of(const RealMatrix6& matrix) {
  return static_cast<double>(Eigen::JacobiSVD<RealMatrix6>(matrix).singularValues()(0));
}

RealVector6 along(int axis, int other = -1) {
  RealVector6 u = RealVector6::Unit(axis);
  if (other >= 0) {
    u += RealVector6::Unit(other);
  }
  return u.normalized();
}

}  // namespace

TEST_CASE("the linear part's own series: its first error") {
  // A ball that turns: A is constant, and Y' − A Y is A⁵ s⁴/24.
  Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), {1, 0, 0}},
                                  diagonal_shape({1e-6, 1e-6, 1e-6}, {1e-8, 1e-8, 1e-8}));
  tube.follow(0.3);
  const RealMatrix inertia = RealMatrix::Identity();
  const double left =
      norm_of(linear_left(tube, [&](const Motion& m) { return independent_flow(inertia, no_torque, m, 0, 0.3L, 1); }));
  check(left / tube.tube.rest(), 0.5);
}

TEST_CASE("the linear part's own series: the products beyond") {
  // A ball that begins to turn: A is linear in time, and of A Y the coefficient of s⁴ vanishes.
  Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                  diagonal_shape(Vector3d::Constant(1e-2), Vector3d::Constant(1e-5)));
  const double acceleration = 0.22;
  tube.input.control_torque = {acceleration, 0, 0};
  tube.follow(0.3);
  const RealMatrix inertia = RealMatrix::Identity();
  const RealTorque control = [&](const RealMatrix&, Real) { return RealVector(static_cast<Real>(acceleration), 0, 0); };
  const double left =
      norm_of(linear_left(tube, [&](const Motion& m) { return independent_flow(inertia, control, m, 0, 0.3L, 1); }));
  check(left / tube.tube.rest(), 0.6);
}

TEST_CASE("the linear part's own series: the torque's Jacobian beyond its fourth term") {
  const RigidBody<double> body = body_of({1, 1.0001, 1.0002});
  GravityGradient<double> gradient;
  REQUIRE(GravityGradient<double>::make(body, 1, Matrix3d::Identity(), gradient) == Status::ok);
  Followed<GravityGradient<double>> tube(body, gradient, {Matrix3d::Identity(), Vector3d::Zero()},
                                         diagonal_shape(Vector3d::Constant(5e-4), Vector3d::Constant(5e-7)));
  const double h = 0.15;
  tube.follow(h);
  const RealMatrix inertia = body.inertia().cast<Real>();
  const RealTorque torque = [&](const RealMatrix& a, Real t) { return gradient_torque(inertia, 1, a, t); };
  const double left =
      norm_of(linear_left(tube, [&](const Motion& m) { return independent_flow(inertia, torque, m, 0, Real(h), 1); }));
  check(left / tube.tube.rest(), 0.025);
}

TEST_CASE("a center that jumps where the step ends") {
  // By the whole angle that is allowed for, about the axis and across.
  for (const double angle : {1e-5, 9e-4}) {
    Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                    diagonal_shape({0.02, 0.02, 0.02}, {1e-3, 1e-3, 1e-3}));
    const double h = 1e-3;
    tube.expand(h);
    tube.series.attitude_error = angle;
    tube.step();
    tube.series.end.attitude = elliptude::exp(Vector3d(0.999999 * angle, 0, 0));
    const RealVector6 zero = RealVector6::Zero();
    const RealVector6 left =
        tube.left(zero, independent_flow(RealMatrix::Identity(), no_torque, tube.motion(zero), 0, Real(h), 1));
    check(static_cast<double>(left.norm()) / tube.tube.rest(), 0.95);
  }
}

TEST_CASE("a center that does not obey Euler's equation") {
  // The whole defect at once where the step begins.
  const double size = 1e-3;
  Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                  diagonal_shape({1, 1, 1}, {size, size, size}));
  tube.expand(1e-4);
  tube.series.rate_defect = 1e-4;
  tube.step();
  const RealVector6 zero = RealVector6::Zero();
  Motion motion = tube.motion(zero);
  motion.angular_velocity(0) += 1e-4L;
  const RealVector6 left = tube.left(zero, independent_flow(RealMatrix::Identity(), no_torque, motion, 0, 1e-4L, 1));
  check(static_cast<double>(left.norm()) / tube.tube.rest(), 0.97);
}

TEST_CASE("an unknown torque that changes its sign in the middle") {
  // What it does to the rate cancels. That it acted at different times remains.
  const double h = 0.1;
  Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                  diagonal_shape({1e-4, 1e-4, 1e-4}, {1e-4, 1e-4, 1e-4}));
  const double torque = 2e-5;
  tube.uncertainty.torque = Vector3d(torque * torque, 0, 0).asDiagonal();
  tube.follow(h);
  const auto pushed = [&](Real side) {
    return [=](const RealMatrix&, Real) { return RealVector(side * static_cast<Real>(torque), 0, 0); };
  };
  const RealVector6 zero = RealVector6::Zero();
  const RealMatrix inertia = RealMatrix::Identity();
  const Real half = static_cast<Real>(h) / 2;
  const Motion middle = independent_flow(inertia, pushed(1), tube.motion(zero), 0, half, 1);
  const RealVector6 left = tube.left(zero, independent_flow(inertia, pushed(-1), middle, half, half, 1));
  check(tube.share(left), 0.7);
}

TEST_CASE("an unknown torque while the linear part changes and changes back") {
  // A body that stands still in the middle of the step: of Y's change there is no part that is linear in time.
  const double h = 0.1;
  const double acceleration = 8;
  const RigidBody<double> body = body_of({1, 1.9, 1.9});
  Followed<FreeBody<double>> tube(body, {}, {Matrix3d::Identity(), {-acceleration * h / 2, 0, 0}},
                                  diagonal_shape({1e-2, 1e-2, 1e-2}, {1e-5, 1e-5, 1e-5}));
  tube.input.control_torque = {acceleration, 0, 0};
  const double torque = 2e-5;
  tube.uncertainty.torque = Vector3d(0, torque * torque, 0).asDiagonal();
  tube.follow(h);
  const RealVector6 zero = RealVector6::Zero();
  const RealTorque pushed = [&](const RealMatrix&, Real) {
    return RealVector(static_cast<Real>(acceleration), static_cast<Real>(torque), 0);
  };
  const RealVector6 left =
      tube.left(zero, independent_flow(body.inertia().cast<Real>(), pushed, tube.motion(zero), 0, Real(h), 1));
  check(tube.share(left), 0.9);
}

TEST_CASE("third order: a turn about the axis of the error") {
  // γ = 2 tan(θ/2) along δω. That is ¼ γ (γ·δω), and no second order.
  const double h = 0.02;
  Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                  diagonal_shape({0.3, 0.3, 0.3}, {0.2, 0.2, 0.2}));
  tube.follow(h);
  RealVector6 u = RealVector6::Zero();
  u(0) = std::sqrt(2.0L / 3.0L);
  u(3) = std::sqrt(1.0L / 3.0L);
  const RealVector6 left =
      tube.left(u, independent_flow(RealMatrix::Identity(), no_torque, tube.motion(u), 0, Real(h), 1));
  check(tube.share(left), 0.6);
}

TEST_CASE("third order: a pendulum where it hangs") {
  // Its torque is a sine, of which the second order vanishes.
  const double h = 1e-3;
  UniformGravity<double> gravity;
  const Vector3d arm(0, 0, -1e-3);
  REQUIRE(UniformGravity<double>::make(1, 1, arm, gravity) == Status::ok);
  Followed<UniformGravity<double>> tube(body_of({1, 1, 1}), gravity, {Matrix3d::Identity(), Vector3d::Zero()},
                                        diagonal_shape({0.2, 0.2, 0.2}, {1e-3, 1e-3, 1e-3}));
  tube.follow(h);
  const RealTorque torque = [&](const RealMatrix& a, Real) { return pendulum_torque(arm, a); };
  const RealVector6 u = along(0);
  const RealVector6 left =
      tube.left(u, independent_flow(RealMatrix::Identity(), torque, tube.motion(u), 0, Real(h), 1));
  check(tube.share(left), 0.6);
}

TEST_CASE("fourth order: a pendulum that lies") {
  // Its torque is a cosine; about this axis of odd order there is nothing.
  const double h = 1e-4;
  UniformGravity<double> gravity;
  const Vector3d arm(1e-3, 0, 0);
  REQUIRE(UniformGravity<double>::make(1, 1, arm, gravity) == Status::ok);
  Followed<UniformGravity<double>> tube(body_of({1, 1, 1}), gravity, {Matrix3d::Identity(), Vector3d::Zero()},
                                        diagonal_shape({0.4, 0.4, 0.4}, {1e-3, 1e-3, 1e-3}));
  tube.follow(h);
  const RealTorque torque = [&](const RealMatrix& a, Real) { return pendulum_torque(arm, a); };
  const RealVector6 u = along(1);
  const RealVector6 left =
      tube.left(u, independent_flow(RealMatrix::Identity(), torque, tube.motion(u), 0, Real(h), 1));
  check(tube.share(left), 0.3);
}

TEST_CASE("a potential that turns") {
  // As the same torque that could turn: by how much its forms of second and of third order then change about the middle.
  const double h = 1e-3;
  const double turn = 20;
  const double strength = 1e-3;
  const double attitude = 0.4;
  const double rate = 1e-3;
  const auto rest = [&](double turn_rate, double degree) {
    UniformGravity<double> gravity;
    REQUIRE(UniformGravity<double>::make(1, 1, Vector3d(strength, 0, 0), gravity) == Status::ok);
    Followed<UniformGravity<double>> tube(body_of({1, 1, 1}), gravity, {Matrix3d::Identity(), Vector3d::Zero()},
                                          diagonal_shape(Vector3d::Constant(attitude), Vector3d::Constant(rate)));
    tube.expand(h);
    tube.series.acceleration.turn_rate = turn_rate;
    tube.series.acceleration.degree = degree;
    tube.step();
    return tube.tube.rest();
  };
  const double wide = std::sqrt(1.03);  // the norm's
  for (const double degree : {1.0, 2.0}) {
    const double angle = degree * turn * h / 2;
    const double second = 0.5 * degree * degree * std::pow(wide * attitude, 2);
    const double third = 0.375 * degree * degree * std::pow(wide * attitude, 3);
    const double least = h * strength / (wide * rate) * angle * angle / 2 * (second / 3 + third / 2);
    const double more = rest(turn, degree) - rest(0, degree);
    MESSAGE("of the bound: " << least / more);
    CHECK(least <= more);
    CHECK(least > 0.65 * more);
  }
}

TEST_CASE("second order after the error has been pushed elsewhere") {
  // An unknown torque turns δω, and γ × δω with it, into a direction that no push has.
  const double attitude = 0.03;
  const double duration = 1;
  const double rate = 0.3 * attitude / duration;
  const int steps = 400;
  const double thin = 1e-3;
  Followed<FreeBody<double>> tube(
      body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
      diagonal_shape({attitude, thin * attitude, thin * attitude}, {thin * rate, rate, thin * rate}));
  const double torque = 0.3 * rate / duration;
  tube.uncertainty.torque = Vector3d(0, torque * torque, 0).asDiagonal();
  tube.follow(duration / steps, steps);
  const RealVector6 u = along(0);
  const RealTorque pushed = [&](const RealMatrix&, Real) { return RealVector(0, static_cast<Real>(torque), 0); };
  const RealVector6 left =
      tube.left(u, independent_flow(RealMatrix::Identity(), pushed, tube.motion(u), 0, Real(duration), 4));
  check(tube.share(left), 0.9);
}

TEST_CASE("an inertia error of a body whose center stands still") {
  // Only what the error of the rate may be makes the body gyrate.
  const double h = 1e-2;
  const double error = 0.1;
  Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                  diagonal_shape({0.1, 0.1, 0.1}, {0.1, 0.1, 0.1}));
  tube.uncertainty.inertia = error;
  tube.follow(h);
  const RealMatrix wrong =
      RealMatrix::Identity() + static_cast<Real>(error) * RealVector(1, -1, -1).asDiagonal().toDenseMatrix();
  const RealVector6 u = along(3, 4);
  const RealVector6 left = tube.left(u, independent_flow(wrong, no_torque, tube.motion(u), 0, Real(h), 1));
  check(tube.share(left), 0.15);
}

TEST_CASE("the rest is added to the set and not to its square") {
  // From the rim, and by all of a jump further out.
  for (const double angle : {1e-5, 9e-4}) {
    const double size = 0.02;
    Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                    diagonal_shape(Vector3d::Constant(size), Vector3d::Constant(1e-4)));
    const double h = 1e-3;
    tube.expand(h);
    tube.series.attitude_error = angle;
    tube.step();
    tube.series.end.attitude = elliptude::exp(Vector3d(-0.999999 * angle, 0, 0));
    RealVector6 y = RealVector6::Zero();
    y(0) = static_cast<Real>(size);
    const RealVector6 end = gibbs_error(tube.series.end, independent_flow(RealMatrix::Identity(), no_torque,
                                                                          gibbs_motion(tube.start, y), 0, Real(h), 1));
    const double form =
        static_cast<double>(end.dot(RealMatrix6(RealMatrix6(tube.tube.shape().cast<Real>()).inverse()) * end));
    check(form, 0.98);
  }
}

TEST_CASE("what rounding may do to a tube") {
  // It is far more than what it does, so this is the statement: of a set whose factor is exact, 84 for the factorization and 128 for
  // the image; of a step that does nothing, 256 for each half of Y, and for the attitude.
  const double epsilon = std::numeric_limits<double>::epsilon();
  Followed<FreeBody<double>> tube(body_of({1, 1, 1}), {}, {Matrix3d::Identity(), Vector3d::Zero()},
                                  Matrix6<double>::Identity());
  for (int i = 0; i < 6; ++i) {
    const double excess = (tube.tube.shape()(i, i) - 1) / epsilon;
    CHECK(excess > 205);
    CHECK(excess < 225);
  }
  tube.follow(1e-9);
  const double rest = tube.tube.rest() / epsilon;
  CHECK(rest > 512);
  CHECK(rest < 600);
}
