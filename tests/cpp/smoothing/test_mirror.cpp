// Backward in time: potentials at −t, and flows from a set at the end of an interval to one that holds the state at its beginning.
// The motions come from code that shares nothing with the library's. (theory, section 20.1)
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

/// A torque of one's own that says nothing about −t.
struct OwnTorque {
  Vector3d torque(const Matrix3d& attitude, double time) const {
    return (1 + std::sin(time)) * Vector3d(0.1, 0.2, -0.1).cross(Vector3d(attitude.row(2).transpose()));
  }
  Matrix3d torque_jacobian(const Matrix3d& attitude, double time) const {
    return (1 + std::sin(time)) * hat_product(Vector3d(0.1, 0.2, -0.1), Vector3d(attitude.row(2).transpose()));
  }
};

template <typename Potential>
void check_backward(const Potential& forward, Random& random) {
  const auto backward = forward.backward();
  const auto again = backward.backward();
  for (const double time : {0.0, 0.7, -2.5}) {
    const Matrix3d c = random.rotation();
    CHECK((forward.torque(c, time) - backward.torque(c, -time)).norm() == 0);
    CHECK((forward.torque_jacobian(c, time) - backward.torque_jacobian(c, -time)).norm() == 0);
    CHECK((forward.torque(c, time) - again.torque(c, time)).norm() == 0);
  }
}

struct OnOrbit {
  RigidBody<double> body;
  double orbit_rate = 1.3;
  Vector3d moment{0.1, -0.2, 0.15};
  using Potential = SumPotential<GravityGradient<double>, UniformGravity<double>>;
  using Flow = GuaranteedRigidBodyFlow<double, Potential>;
  Flow flow;
  RealMatrix inertia;
  RealTorque torque;

  explicit OnOrbit(Random& random, double unknown) : body(random_body(random)) {
    GravityGradient<double> gradient;
    REQUIRE(GravityGradient<double>::make(body, orbit_rate, Matrix3d::Identity(), gradient) == Status::ok);
    UniformGravity<double> gravity;
    REQUIRE(UniformGravity<double>::make(1, 1, moment, gravity) == Status::ok);
    BodyUncertainty<double> uncertainty;
    uncertainty.torque = unknown * unknown * Matrix3d::Identity();
    REQUIRE(Flow::make(body, Potential(gradient, gravity), 0.05, uncertainty, flow) == Status::ok);
    inertia = body.inertia().cast<Real>();
    torque = [this](const RealMatrix& c, Real t) {
      return RealVector(gradient_torque(inertia, Real(orbit_rate), c, t) + pendulum_torque(moment, c));
    };
  }
};

using HeldGyro = GuaranteedGyroFlow<double>;
using Mode = HeldGyro::IntervalRate;

/// A turn about one axis over one interval, with errors at their bounds.
struct Turn {
  Mode mode = Mode::first_sample;
  double duration = 0.5;
  double rate = 0.3;
  double acceleration = 0;
  double noise = 0;
  double drift = 0;
  double scale = 0;
  double increment = -1;
  double width = 1e-6;  ///< of the set at the end, rad and rad/s
};

/// The form of the true state at the beginning in the set that the mirrored flow predicts from one at the end with the true state on
/// its boundary; signs are those of acceleration, of noise and drift, and of the error at the end.
double form_at_beginning(const Turn& t, const Vector3d& axis, double accelerates, double errs, double from) {
  const double h = t.duration;
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = t.noise * t.noise * Matrix3d::Identity();
  uncertainty.drift = t.drift * t.drift * Matrix3d::Identity();
  uncertainty.scale = t.scale;
  uncertainty.angular_acceleration = t.acceleration;
  HeldGyro flow;
  REQUIRE(HeldGyro::make(uncertainty, t.mode, flow) == Status::ok);
  const double a = accelerates * t.acceleration;
  const double bias = 0.1;
  const double drifted = errs * t.drift * h;
  double shown = t.rate + bias;  // at the beginning
  if (t.mode == Mode::last_sample) {
    shown += a * h + drifted;
  } else if (t.mode != Mode::first_sample) {
    shown += a * h / 2 + drifted / 2;
  }
  shown += errs * (t.increment >= 0 ? t.increment / h : t.noise + t.scale * shown / (1 - t.scale));
  const double angle = t.rate * h + a * h * h / 2;
  const GyroState<double> begin{Matrix3d::Identity(), bias * axis};
  const GyroState<double> end{exp(Vector3d(angle * axis)), (bias + drifted) * axis};
  // The true state is the center's with an error at the boundary.
  const Matrix6<double> shape = t.width * t.width * Matrix6<double>::Identity();
  const Vector6<double> error = (Vector6<double>() << from * t.width * axis, Vector3d::Zero()).finished();
  const GibbsEllipsoid<GyroState<double>> known{retract<GibbsChart>(end, Vector6<double>(-error)), shape};
  HeldGyro backward;
  REQUIRE(Mirror<HeldGyro>::flow(flow, backward) == Status::ok);
  GibbsEllipsoid<GyroState<double>> found;
  const HeldGyro::Input input{shown * axis, t.increment, true};
  REQUIRE(backward.predict(-h, h, Mirror<HeldGyro>::input(input), mirrored(known), found) == Status::ok);
  double form = 2;
  REQUIRE(quadratic_form(mirrored(found), begin, form) == Status::ok);
  return form;
}

double worst_form(const Turn& turn) {
  double worst = 0;
  const Vector3d axis = Vector3d(1, 2, -2).normalized();
  for (const double accelerates : {-1.0, 1.0}) {
    for (const double errs : {-1.0, 1.0}) {
      for (const double from : {-1.0, 1.0}) {
        worst = std::fmax(worst, form_at_beginning(turn, axis, accelerates, errs, from));
      }
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("mirror: potentials at the time -t, to the last bit") {
  Random random(1);
  check_backward(FreeBody<double>{}, random);
  UniformGravity<double> gravity;
  REQUIRE(UniformGravity<double>::make(2, 9.81, Vector3d(0.1, 0.2, 0.3), gravity) == Status::ok);
  check_backward(gravity, random);
  const RigidBody<double> body = random_body(random);
  GravityGradient<double> gradient;
  REQUIRE(GravityGradient<double>::make(body, 0.8, random.rotation(), gradient) == Status::ok);
  check_backward(gradient, random);
  TurningDirection<double> direction;
  REQUIRE(TurningDirection<double>::make(Vector3d::UnitX(), Vector3d(0, 0.3, 0.4), direction) == Status::ok);
  LinearPotential<double> linear;
  REQUIRE(LinearPotential<double>::make(Vector3d(1, 2, 3), direction, linear) == Status::ok);
  check_backward(linear, random);
  QuadraticPotential<double> quadratic;
  REQUIRE(QuadraticPotential<double>::make(body.inertia(), direction, quadratic) == Status::ok);
  check_backward(quadratic, random);
  check_backward(SumPotential<GravityGradient<double>, LinearPotential<double>>(gradient, linear), random);
  StatedTorque<double, QuadraticPotential<double>> stated;
  REQUIRE(StatedTorque<double, QuadraticPotential<double>>::make(quadratic, {1, 2, 3}, stated) == Status::ok);
  check_backward(stated, random);
  CHECK(stated.backward().statement().rate == 2);
  CHECK(std::is_same_v<decltype(stated.backward()), decltype(stated)>);
  StatedTorque<double, OwnTorque> own;
  REQUIRE(StatedTorque<double, OwnTorque>::make({}, {1, 1, 0}, own) == Status::ok);
  check_backward(own, random);
  CHECK(std::is_same_v<decltype(own.backward().backward()), decltype(own)>);
  CHECK_FALSE(goes_backward<OwnTorque>);
  CHECK_FALSE(goes_backward<SumPotential<FreeBody<double>, OwnTorque>>);
}

TEST_CASE("mirror: a set twice mirrored is the set, and a mirrored one holds the mirrored states") {
  Random random(2);
  const Matrix6<double> shape = random.positive_definite<6>(100);
  const GibbsEllipsoid<GyroState<double>> set{{random.rotation(), random.unit_vector<3>()}, shape};
  const auto back = mirrored(mirrored(set));
  CHECK(back.shape == set.shape);
  CHECK(back.center.gyro_bias == set.center.gyro_bias);
  const Matrix6<double> factor = shape.llt().matrixL();
  for (int k = 0; k < 20; ++k) {
    const GyroState<double> state = retract<GibbsChart>(set.center, Vector6<double>(factor * random.unit_vector<6>()));
    double one = 0;
    double other = 0;
    REQUIRE(quadratic_form(set, state, one) == Status::ok);
    REQUIRE(quadratic_form(mirrored(set), mirrored(state), other) == Status::ok);
    CHECK(std::fabs(one - other) < 1e-12);
  }
}

TEST_CASE("mirror: a body's motion backward, under potentials that depend on time, with a wheel and a control torque") {
  Random random(3);
  for (int k = 0; k < 6; ++k) {
    const OnOrbit scene(random, 0);
    BodyInput<double> input;
    input.control_torque = 0.3 * random.unit_vector<3>();
    input.wheel_momentum = 0.3 * random.unit_vector<3>();
    const double begin = random.uniform(-3, 3);
    const double h = 0.3;
    const RigidBodyState<double> start{random.rotation(), random.unit_vector<3>()};
    const RealVector control = input.control_torque.cast<Real>();
    const RealTorque torque = [&](const RealMatrix& c, Real t) { return RealVector(scene.torque(c, t) + control); };
    const Motion end = independent_flow(scene.inertia, torque, gibbs_motion(start, RealVector6::Zero()), Real(begin),
                                        Real(h), 4, input.wheel_momentum.cast<Real>());
    // Around the state at the end, which is anywhere on the boundary.
    const Matrix6<double> shape = 1e-8 * random.positive_definite<6>(10);
    const Vector6<double> error = Matrix6<double>(shape.llt().matrixL()) * random.unit_vector<6>();
    const RigidBodyState<double> last{end.attitude.cast<double>(), end.angular_velocity.cast<double>()};
    const GibbsEllipsoid<RigidBodyState<double>> known{retract<GibbsChart>(last, Vector6<double>(0.999 * error)),
                                                       shape};
    using Mirrored = Mirror<OnOrbit::Flow>;
    Mirrored::Backward backward;
    REQUIRE(Mirrored::flow(scene.flow, backward) == Status::ok);
    GibbsEllipsoid<RigidBodyState<double>> found;
    REQUIRE(backward.predict(-(begin + h), h, Mirrored::input(input), mirrored(known), found) == Status::ok);
    double form = 2;
    REQUIRE(quadratic_form(mirrored(found), start, form) == Status::ok);
    CHECK(form <= 1);
    CHECK(form > 0.9);  // nothing else is lost over so small a set
  }
}

TEST_CASE("mirror: a body's flow keeps its limits") {
  Random random(4);
  OnOrbit scene(random, 1e-3);
  REQUIRE(scene.flow.set_most_steps(7) == Status::ok);
  Mirror<OnOrbit::Flow>::Backward backward;
  REQUIRE(Mirror<OnOrbit::Flow>::flow(scene.flow, backward) == Status::ok);
  CHECK(backward.most_steps() == 7);
  CHECK(backward.uncertainty().torque == scene.flow.uncertainty().torque);
  CHECK(backward.longest_step() == 0.05);
  REQUIRE(backward.set_most_steps(9) == Status::ok);
  CHECK(Mirror<OnOrbit::Flow>::flow(OnOrbit::Flow(), backward) == Status::out_of_range);
  CHECK(backward.most_steps() == 9);
}

TEST_CASE("mirror: a gyro's errors reach the edge backward, too") {
  Turn turn;
  turn.noise = 1e-2;
  const double by_noise = worst_form(turn);
  CHECK(by_noise <= 1);
  CHECK(by_noise > 0.9);
  turn.increment = 3e-3;
  const double by_increment = worst_form(turn);
  CHECK(by_increment <= 1);
  CHECK(by_increment > 0.8);
  turn = Turn();
  turn.scale = 1e-2;
  const double by_scale = worst_form(turn);
  CHECK(by_scale <= 1);
  CHECK(by_scale > 0.9);
  for (const Mode mode : {Mode::first_sample, Mode::mean_of_ends, Mode::last_sample}) {
    turn = Turn();
    turn.mode = mode;
    turn.acceleration = 1e-2;
    const double by_wander = worst_form(turn);
    CHECK(by_wander <= 1);
    CHECK(by_wander > (mode == Mode::mean_of_ends ? 0 : 0.8));
  }
}

TEST_CASE("mirror: a bias that drifts before or after its sample") {
  for (const Mode mode : {Mode::first_sample, Mode::mean_of_ends, Mode::mean, Mode::last_sample}) {
    Turn turn;
    turn.mode = mode;
    turn.drift = 1e-2;
    CAPTURE(static_cast<int>(mode));
    const double of_noise = worst_form(turn);
    CHECK(of_noise <= 1);
    CHECK(of_noise > (mode == Mode::mean ? 0.5 : 0.95));
    turn.increment = 1e-9;
    const double of_increment = worst_form(turn);
    CHECK(of_increment <= 1);
    CHECK(of_increment > (mode == Mode::mean ? 0.5 : 0.95));
  }
}

TEST_CASE("mirror: of a gyro's bounds none changes, but which rate of an interval it shows") {
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = 4 * Matrix3d::Identity();
  uncertainty.drift = 9 * Matrix3d::Identity();
  uncertainty.scale = 0.1;
  uncertainty.angular_acceleration = 0.2;
  uncertainty.longest_interval = 3;
  uncertainty.largest_rate = 5;
  for (const auto& [mode, expected] : {std::pair{Mode::first_sample, Mode::last_sample},
                                       {Mode::last_sample, Mode::first_sample},
                                       {Mode::mean, Mode::mean},
                                       {Mode::mean_of_ends, Mode::mean_of_ends}}) {
    HeldGyro flow;
    HeldGyro backward;
    REQUIRE(HeldGyro::make(uncertainty, mode, flow) == Status::ok);
    REQUIRE(Mirror<HeldGyro>::flow(flow, backward) == Status::ok);
    CHECK(backward.interval_rate() == expected);
    CHECK(backward.uncertainty().noise == uncertainty.noise);
    CHECK(backward.uncertainty().drift == uncertainty.drift);
    CHECK(backward.uncertainty().scale == uncertainty.scale);
    CHECK(backward.uncertainty().angular_acceleration == uncertainty.angular_acceleration);
    CHECK(backward.uncertainty().longest_interval == uncertainty.longest_interval);
    CHECK(backward.uncertainty().largest_rate == uncertainty.largest_rate);
  }
  const HeldGyro::Input input = Mirror<HeldGyro>::input({Vector3d(1, 2, 3), 0.25, false});
  CHECK(input.angular_velocity == Vector3d(-1, -2, -3));
  CHECK(input.increment == 0.25);
  CHECK_FALSE(input.is_measured);
}
