// Containment: the state of the continuous motion, by an integrator that shares nothing with the library's, is in the set that
// the guaranteed flow predicts, wherever in its set it began and whatever the torque was.
#include <doctest/doctest.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using State = RigidBodyState<double>;
using Set = GibbsEllipsoid<State>;

enum class Kind { diagonal, correlated, thin, thinner };

/// An ellipsoid of this size, rad; rates of the size times `frequency`.
Matrix6<double> random_shape(Random& random, Kind kind, double size, double frequency) {
  Matrix6<double> scale = Matrix6<double>::Identity();
  scale.diagonal() << Vector3d::Constant(size), Vector3d::Constant(size * frequency);
  Matrix6<double> shape = Matrix6<double>::Identity();
  if (kind == Kind::diagonal) {
    for (int i = 0; i < 6; ++i) {
      shape(i, i) = random.log_uniform(0.1, 1);
    }
  } else {
    const double ratio = kind == Kind::correlated ? 3 : kind == Kind::thin ? 30 : 1000;
    shape = random.positive_definite<6>(ratio * ratio) / ratio;
  }
  shape = (scale * shape * scale).eval();
  return (shape + shape.transpose()) / 2;
}

struct Tally {
  double form = 0;
  double best_share = 0;
  double least_share = 1e9;
  int closed = 0;
  int refused = 0;

  void add(const Worst& worst) {
    form = std::fmax(form, worst.form);
    ++closed;
    const double share = worst.needed / worst.computed;
    best_share = std::fmax(best_share, share);
    least_share = std::fmin(least_share, share);
  }
};

/// Predicts and searches; refusals are counted.
template <typename Potential>
void attempt(const RigidBody<double>& body, const Potential& potential, double step,
             const BodyUncertainty<double>& uncertainty, const BodyInput<double>& input, Trial trial, Random& random,
             Tally& tally) {
  GuaranteedRigidBodyFlow<double, Potential> flow;
  REQUIRE(GuaranteedRigidBodyFlow<double, Potential>::make(body, potential, step, uncertainty, flow) == Status::ok);
  const Status status = flow.predict(trial.time, trial.duration, input, trial.before, trial.after);
  if (status != Status::ok) {
    REQUIRE(status == Status::unbounded);
    ++tally.refused;
    return;
  }
  trial.wheel = input.wheel_momentum.cast<Real>();
  trial.unknown = uncertainty.torque;
  const Worst worst = search_worst(trial, random, 6, 3);
  CHECK(worst.form <= 1);
  tally.add(worst);
}

}  // namespace

TEST_CASE("the state of the continuous motion is in the predicted set") {
  Random random(20260401);
  const bool long_run = std::getenv("ELLIPTUDE_TEST_LONG") != nullptr;
  const std::vector<double> sizes{1e-6, 1e-3, 0.05, 0.17, 0.35};
  struct Class {
    const char* name;
    bool torque, inertia, wheel;
  };
  for (const Class& c : {Class{"known", false, false, false}, Class{"wheel", false, false, true},
                         Class{"unknown torque", true, false, true}, Class{"wrong inertia", false, true, true},
                         Class{"torque and inertia", true, true, true}}) {
    for (int field = 0; field < 5; ++field) {
      Tally tally;
      const int count = long_run ? 60 : 6;
      for (int i = 0; i < count; ++i) {
        const RigidBody<double> body = random_body(random);
        const double least = body.principal_moments()(2);
        const double frequency = field == 2 ? 5 : field == 3 ? 0.3 : 1;  // rad/s, of the potential
        const double spin = random.log_uniform(0.05, 2) * frequency;
        BodyUncertainty<double> uncertainty;
        BodyInput<double> input;
        const double size = sizes[static_cast<std::size_t>(random.uniform(0, 5))];
        const double step = random.log_uniform(0.01, 0.15) / frequency;
        Trial trial;
        trial.duration = random.uniform(0.5, 6) * step;
        trial.time = random.uniform(0, 100);
        if (c.wheel) {
          input.wheel_momentum = random.normal_matrix<3>() * least * frequency;
          input.control_torque = 0.3 * random.normal_matrix<3>() * least * frequency * frequency;
        }
        if (c.torque) {
          const Vector3d axes(random.log_uniform(0.01, 1), random.log_uniform(0.01, 1), random.log_uniform(0.01, 1));
          uncertainty.torque = random.symmetric<3>(Vector3d(axes.cwiseAbs2())) *
                               std::pow(least * frequency * frequency * size * random.log_uniform(0.01, 1), 2);
          trial.pieces = 6;
          trial.intervals = 1;
        }
        Matrix3d error = Matrix3d::Zero();
        if (c.inertia) {
          uncertainty.inertia = least * size * random.log_uniform(0.01, 0.3);
          const Vector3d signs(random.uniform(-1, 1) < 0 ? -1 : 1, random.uniform(-1, 1) < 0 ? -1 : 1, 1);
          error = uncertainty.inertia * (1 - 1e-12) * random.symmetric<3>(signs);
        }
        trial.inertia = (body.inertia() + error).cast<Real>();
        trial.before = {{random.rotation(), spin * random.unit_vector<3>()},
                        random_shape(random, static_cast<Kind>(i % 4), size, frequency)};
        const RealVector control = input.control_torque.cast<Real>();
        const RealMatrix inertia = trial.inertia;
        UniformGravity<double> gravity;
        const Vector3d arm = random.unit_vector<3>() * least * frequency * frequency;
        REQUIRE(UniformGravity<double>::make(1, 1, arm, gravity) == Status::ok);
        const double rate = frequency * random.uniform(0.3, 1);
        GravityGradient<double> gradient;
        REQUIRE(GravityGradient<double>::make(body, rate, Matrix3d::Identity(), gradient) == Status::ok);
        if (field == 0) {
          trial.torque = [=](const RealMatrix&, Real) { return control; };
          attempt(body, FreeBody<double>{}, step, uncertainty, input, trial, random, tally);
        } else if (field <= 2) {
          trial.torque = [=](const RealMatrix& a, Real) { return RealVector(control + pendulum_torque(arm, a)); };
          attempt(body, gravity, step, uncertainty, input, trial, random, tally);
        } else if (field == 3) {
          trial.torque = [=](const RealMatrix& a, Real t) {
            return RealVector(control + gradient_torque(inertia, Real(rate), a, t));
          };
          attempt(body, gradient, step, uncertainty, input, trial, random, tally);
        } else {
          trial.torque = [=](const RealMatrix& a, Real t) {
            return RealVector(control + pendulum_torque(arm, a) + gradient_torque(inertia, Real(rate), a, t));
          };
          attempt(body, SumPotential<UniformGravity<double>, GravityGradient<double>>(gravity, gradient), step,
                  uncertainty, input, trial, random, tally);
        }
      }
      MESSAGE(std::string(c.name) << ", potential " << field << ": worst form " << tally.form
                                  << ", needed/computed inflation " << tally.least_share << " to " << tally.best_share
                                  << ", closed " << tally.closed << ", refused " << tally.refused);
      CHECK(tally.closed > 0);
    }
  }
}

TEST_CASE("many steps, with restarts of the tube, contain the motion") {
  Random random(7);
  for (int i = 0; i < 4; ++i) {
    const RigidBody<double> body = random_body(random);
    UniformGravity<double> gravity;
    const double least = body.principal_moments()(2);
    const Vector3d arm = random.unit_vector<3>() * least;
    REQUIRE(UniformGravity<double>::make(1, 1, arm, gravity) == Status::ok);
    Trial trial;
    trial.duration = 3;
    trial.intervals = 12;
    trial.inertia = body.inertia().cast<Real>();
    trial.before = {{random.rotation(), random.unit_vector<3>()},
                    random_shape(random, static_cast<Kind>(i), i < 2 ? 0.03 : 0.005, 1)};
    trial.torque = [=](const RealMatrix& a, Real) { return pendulum_torque(arm, a); };
    Tally tally;
    attempt(body, gravity, 0.02, BodyUncertainty<double>{}, BodyInput<double>{}, trial, random, tally);
    CHECK(tally.closed == 1);
    MESSAGE("150 steps: worst form " << tally.form << ", needed/computed " << tally.best_share);
  }
}

TEST_CASE("two gravity gradients: an inertia error moves both") {
  Random random(3);
  RigidBody<double> body = random_body(random);
  GravityGradient<double> one;
  REQUIRE(GravityGradient<double>::make(body, 2.0, Matrix3d::Identity(), one) == Status::ok);
  using Two = SumPotential<GravityGradient<double>, GravityGradient<double>>;
  const TorqueExpansion<Two, double, 4> sum(Two(one, one));
  CHECK(sum.bounds(Matrix3d::Identity()).by_inertia == doctest::Approx(24.0));
}

TEST_CASE("without an attitude the angular velocity stays bounded") {
  Random random(11);
  double worst = 0;
  for (int i = 0; i < 40; ++i) {
    const RigidBody<double> body = random_body(random);
    const double least = body.principal_moments()(2);
    BodyUncertainty<double> uncertainty;
    uncertainty.inertia = i % 2 == 0 ? 0 : 0.1 * least;
    uncertainty.torque = 0.01 * least * least * Matrix3d::Identity();
    GravityGradient<double> gradient;
    REQUIRE(GravityGradient<double>::make(body, 0.7, Matrix3d::Identity(), gradient) == Status::ok);
    GuaranteedRigidBodyFlow<double, GravityGradient<double>> flow;
    REQUIRE(decltype(flow)::make(body, gradient, 0.1, uncertainty, flow) == Status::ok);
    BodyInput<double> input;
    input.wheel_momentum = least * random.normal_matrix<3>();
    input.control_torque = 0.1 * least * random.normal_matrix<3>();
    const Ellipsoid<double, 3> before{random.normal_matrix<3>(), 0.04 * Matrix3d::Identity()};
    Ellipsoid<double, 3> after;
    REQUIRE(flow.predict_vector(5, 2, input, before, after) == Status::ok);
    const Matrix3d error = uncertainty.inertia * random.symmetric<3>(Vector3d(1, -1, 1));
    const RealMatrix inertia = (body.inertia() + error).cast<Real>();
    const RealVector push = (0.1 * least * random.unit_vector<3>() + input.control_torque).cast<Real>();
    const RealTorque torque = [&](const RealMatrix& a, Real t) {
      return RealVector(push + gradient_torque(inertia, 0.7L, a, t));
    };
    const Vector3d rate = before.center + 0.2 * random.unit_vector<3>();
    const Motion end = independent_flow(inertia, torque, {random.rotation().cast<Real>(), rate.cast<Real>()}, 5, 2, 20,
                                        input.wheel_momentum.cast<Real>());
    double form = 2;
    REQUIRE(quadratic_form(after, Vector3d(end.angular_velocity.cast<double>()), form) == Status::ok);
    CHECK(form <= 1);
    worst = std::fmax(worst, form);
  }
  MESSAGE("worst form " << worst);
  CHECK(worst > 0.2);
}

TEST_CASE("gyro: the attitude of a motion that the samples only bound is in the set") {
  using Flow = GuaranteedGyroFlow<double>;
  Random random(5);
  for (const Flow::IntervalRate mode :
       {Flow::IntervalRate::first_sample, Flow::IntervalRate::mean_of_ends, Flow::IntervalRate::mean}) {
    double worst = 0;
    for (int trial = 0; trial < 300; ++trial) {
      const double h = random.log_uniform(0.01, 0.5);
      GyroUncertainty<double> uncertainty;
      const double noise = random.log_uniform(1e-4, 0.1);
      const double drift = trial % 3 == 0 ? 0 : random.log_uniform(1e-4, 0.1);
      uncertainty.noise = noise * noise * Matrix3d::Identity();
      uncertainty.drift = drift * drift * Matrix3d::Identity();
      uncertainty.angular_acceleration = trial % 4 == 0 ? 0 : random.log_uniform(1e-3, 3);
      uncertainty.scale = trial % 2 == 0 ? 0 : random.log_uniform(1e-4, 0.05);
      Flow flow;
      REQUIRE(Flow::make(uncertainty, mode, flow) == Status::ok);
      const double size = random.log_uniform(1e-4, 0.3);
      GibbsEllipsoid<GyroState<double>> before{{random.rotation(), 0.1 * random.normal_matrix<3>()},
                                               random_shape(random, Kind::correlated, size, 1)};
      // The truth: everything at its bound, and all along the same or along different directions.
      const Matrix6<double> factor = before.shape.llt().matrixL();
      const Vector6<double> y = factor * random.unit_vector<6>();
      const GyroState<double> start = retract<GibbsChart>(before.center, y);
      const Vector3d n = y.head<3>().normalized();
      const bool together = trial % 2 == 0;
      const auto axis = [&] { return together ? n : Vector3d(random.unit_vector<3>()); };
      const Vector3d rate = random.log_uniform(0.05, 3) * random.unit_vector<3>();
      const Vector3d acceleration = uncertainty.angular_acceleration * axis();
      const Vector3d ramp = -drift * axis();
      const bool kink = random.uniform(0, 1) < 0.5;  // turns back in the middle of the interval
      const auto path = [&](double t) { return kink && t > h / 2 ? h - t : t; };
      const auto omega = [&](double t) { return Vector3d(rate + acceleration * path(t)); };
      const auto bias = [&](double t) { return Vector3d(start.gyro_bias + ramp * t); };
      const double mean_path = kink ? h / 4 : h / 2;
      const Vector3d measured_part = mode == Flow::IntervalRate::first_sample ? Vector3d(omega(0) + bias(0))
                                     : mode == Flow::IntervalRate::mean_of_ends
                                         ? Vector3d((omega(0) + omega(h) + bias(0) + bias(h)) / 2)
                                         : Vector3d(rate + acceleration * mean_path + bias(h / 2));
      // ω̃ = part + v with ‖v‖ = noise + scale ‖ω̃‖, by iteration.
      const Vector3d e = -axis();
      Vector3d measured = measured_part;
      for (int k = 0; k < 100; ++k) {
        measured = measured_part + (1 - 1e-12) * (noise + uncertainty.scale * measured.norm()) * e;
      }
      GibbsEllipsoid<GyroState<double>> after;
      const Status status = flow.predict(0, h, {measured}, before, after);
      REQUIRE(status == Status::ok);
      // Ċ = C S(ω) by small turns about the rate in the middle of each, of fourth order (the mean and a commutator).
      RealMatrix c = start.attitude.cast<Real>();
      const int parts = 200;
      for (int k = 0; k < parts; ++k) {
        const double length = h / parts;
        const double middle = (k + 0.5) * length;
        const Vector3d first = omega(middle - length * std::sqrt(3.0) / 6);
        const Vector3d second = omega(middle + length * std::sqrt(3.0) / 6);
        const Vector3d turn =
            length / 2 * (first + second) - std::sqrt(3.0) / 12 * length * length * second.cross(first);
        c = (c * exp(RealVector(turn.cast<Real>()))).eval();
      }
      const GyroState<double> end{c.cast<double>(), bias(h)};
      double form = 2;
      REQUIRE(quadratic_form(after, end, form) == Status::ok);
      CHECK(form <= 1);
      worst = std::fmax(worst, form);
    }
    MESSAGE("gyro mode " << static_cast<int>(mode) << ": worst form " << worst);
    CHECK(worst > 0.5);
  }
}
