// Potentials of one's own in the guaranteed flow (theory, section 17.10): the same sets as the built-in ones where they say the same,
// the truth in the set where functions are stated, and every term of the statement at work.
#include <doctest/doctest.h>

#include <limits>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

template <typename Scalar>
using Set = GibbsEllipsoid<RigidBodyState<Scalar>>;

/// b × Kb of b = Cᵀ(cos nt, sin nt, 0). Its curvature is the difference of K's greatest and least eigenvalue (theory, section 5).
template <typename Scalar>
struct QuadraticTorque {
  Matrix3<Scalar> matrix = Matrix3<Scalar>::Zero();
  Scalar turn_rate = Scalar(0);

  [[nodiscard]] Vector3<Scalar> seen(const Matrix3<Scalar>& attitude, const Scalar& time) const {
    const Scalar angle = turn_rate * time;
    return attitude.transpose() * Vector3<Scalar>(std::cos(angle), std::sin(angle), Scalar(0));
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const {
    const Vector3<Scalar> b = seen(attitude, time);
    return b.cross(Vector3<Scalar>(matrix * b));
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const {
    const Vector3<Scalar> b = seen(attitude, time);
    return (hat(b) * matrix - hat(Vector3<Scalar>(matrix * b))) * hat(b);
  }
};

/// −3c (a·b)² a × b of U = c (a·b)³, b = Cᵀe₃: of third degree in C.
template <typename Scalar>
struct CubicTorque {
  Vector3<Scalar> axis = Vector3<Scalar>::UnitX();
  Scalar strength = Scalar(0);

  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) const {
    const Vector3<Scalar> b = attitude.row(2).transpose();
    const Scalar along = axis.dot(b);
    return (Scalar(-3) * strength * along * along) * axis.cross(b);
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) const {
    const Vector3<Scalar> b = attitude.row(2).transpose();
    const Scalar along = axis.dot(b);
    const Vector3<Scalar> across = axis.cross(b);
    return Scalar(-3) * strength *
           (Scalar(2) * along * across * across.transpose() + along * along * (hat(axis) * hat(b)));
  }
};

/// c (a·b) a, which has no potential.
template <typename Scalar>
struct DragTorque {
  Vector3<Scalar> axis = Vector3<Scalar>::UnitX();
  Scalar strength = Scalar(0);

  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) const {
    return (strength * axis.dot(attitude.row(2).transpose())) * axis;
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) const {
    return strength * axis * axis.cross(Vector3<Scalar>(attitude.row(2).transpose())).transpose();
  }
};

template <typename Scalar, typename Torque>
StatedTorque<Scalar, Torque> stated(const Torque& torque, double curvature, double rate, double error) {
  StatedTorque<Scalar, Torque> result;
  REQUIRE(StatedTorque<Scalar, Torque>::make(torque, {Scalar(curvature), Scalar(rate), Scalar(error)}, result) ==
          Status::ok);
  return result;
}

template <typename Scalar, typename Potential>
Status predict(const RigidBody<double>& body, const Potential& potential, double step,
               const BodyUncertainty<Scalar>& uncertainty, Trial& trial) {
  RigidBody<Scalar> rounded;
  REQUIRE(RigidBody<Scalar>::make(body.inertia().cast<Scalar>(), rounded) == Status::ok);
  GuaranteedRigidBodyFlow<Scalar, Potential> flow;
  REQUIRE(GuaranteedRigidBodyFlow<Scalar, Potential>::make(rounded, potential, Scalar(step), uncertainty, flow) ==
          Status::ok);
  Set<Scalar> set{{trial.before.center.attitude.cast<Scalar>(), trial.before.center.angular_velocity.cast<Scalar>()},
                  trial.before.shape.cast<Scalar>()};
  trial.inertia = rounded.inertia().template cast<Real>();
  trial.before = {{set.center.attitude.template cast<double>(), set.center.angular_velocity.template cast<double>()},
                  set.shape.template cast<double>()};
  trial.duration = static_cast<double>(Scalar(trial.duration));
  trial.time = static_cast<double>(Scalar(trial.time));
  const Status status = flow.predict(Scalar(trial.time), Scalar(trial.duration), {}, set, set);
  trial.after = {{set.center.attitude.template cast<double>(), set.center.angular_velocity.template cast<double>()},
                 set.shape.template cast<double>()};
  return status;
}

/// The torque as the truth has it, from the same functions in long double.
template <typename Torque>
RealTorque truth_of(const Torque& torque) {
  return [=](const RealMatrix& attitude, Real time) { return RealVector(torque.torque(attitude, time)); };
}

Trial random_trial(Random& random, double size, double step) {
  Trial trial;
  trial.before = {{random.rotation(), random.log_uniform(0.05, 2) * random.unit_vector<3>()},
                  size * size * random.positive_definite<6>(9) / 3};
  trial.time = random.uniform(0, 20);
  trial.duration = random.uniform(1, 8) * step;
  return trial;
}

template <typename Scalar>
void check_containment(int trials, double least_size, double error) {
  Random random(20260505);
  Worst worst;
  int refused = 0;
  for (int i = 0; i < trials; ++i) {
    const RigidBody<double> body = random_body(random);
    const double least = body.principal_moments()(2);
    const double step = random.log_uniform(0.01, 0.1);
    Trial trial = random_trial(random, random.log_uniform(least_size, 0.2), step);
    BodyUncertainty<Scalar> uncertainty;
    const Vector3d axis = random.unit_vector<3>();
    const Vector3<Scalar> rounded_axis = axis.cast<Scalar>();
    const Vector3<Real> real_axis = rounded_axis.template cast<Real>();
    const double strength = static_cast<double>(Scalar(random.log_uniform(0.1, 1) * least));
    Status status = Status::ok;
    if (i % 3 == 0) {
      const Vector3d values = strength * Vector3d(1, random.uniform(0, 1), 0);
      const Matrix3<Scalar> matrix = symmetrized(Matrix3<Scalar>(random.symmetric<3>(values).cast<Scalar>()));
      const double n = static_cast<double>(Scalar(random.uniform(0.2, 1)));
      // Along a turn its components are of second degree, and at most half of the spread of K.
      const double spread = strength * (1 + 1e-6);
      trial.torque = truth_of(QuadraticTorque<Real>{matrix.template cast<Real>(), Real(n)});
      status = predict<Scalar>(
          body, stated<Scalar>(QuadraticTorque<Scalar>{matrix, Scalar(n)}, spread, n * spread, error * strength), step,
          uncertainty, trial);
    } else if (i % 3 == 1) {
      // At most 2c/√3, and of third degree.
      trial.torque = truth_of(CubicTorque<Real>{real_axis, Real(strength)});
      status = predict<Scalar>(body,
                               stated<Scalar>(CubicTorque<Scalar>{rounded_axis, Scalar(strength)},
                                              0.5 * 9 * 1.1548 * strength, 0, error * strength),
                               step, uncertainty, trial);
    } else {
      trial.torque = truth_of(DragTorque<Real>{real_axis, Real(strength)});
      status = predict<Scalar>(
          body,
          SumPotential<LinearPotential<Scalar>, StatedTorque<Scalar, DragTorque<Scalar>>>(
              LinearPotential<Scalar>(), stated<Scalar>(DragTorque<Scalar>{rounded_axis, Scalar(strength)},
                                                        0.5001 * strength, 0, error * strength)),
          step, uncertainty, trial);
    }
    if (status != Status::ok) {
      REQUIRE(status == Status::unbounded);
      ++refused;
      continue;
    }
    const Worst found = search_worst(trial, random, 6, 3);
    CHECK(found.form <= 1);
    worst.form = std::fmax(worst.form, found.form);
    worst.computed = std::fmax(worst.computed, found.computed);
  }
  MESSAGE("worst form " << worst.form << ", widest " << worst.computed << ", " << refused << " of " << trials
                        << " refused");
  CHECK(refused < trials / 3);
  CHECK(worst.form > 0.9);
}

}  // namespace

TEST_CASE("the pendulum and the gravity gradient as potentials of one's own") {
  Random random(7);
  for (int i = 0; i < 20; ++i) {
    const RigidBody<double> body = random_body(random);
    const Vector3d moment = random.normal_matrix<3>() * body.principal_moments()(2);
    const double rate = random.uniform(0.2, 1);
    UniformGravity<double> gravity;
    GravityGradient<double> gradient;
    const Matrix3d orbit = random.rotation();
    REQUIRE(UniformGravity<double>::make(1, 1, moment, gravity) == Status::ok);
    REQUIRE(GravityGradient<double>::make(body, rate, orbit, gradient) == Status::ok);
    TurningDirection<double> down;
    TurningDirection<double> radial;
    REQUIRE(TurningDirection<double>::make(Vector3d(0, 0, 2), Vector3d::Zero(), down) == Status::ok);
    REQUIRE(TurningDirection<double>::make(orbit.col(0), rate * orbit.col(2), radial) == Status::ok);
    LinearPotential<double> own_gravity;
    QuadraticPotential<double> own_gradient;
    REQUIRE(LinearPotential<double>::make(moment, down, own_gravity) == Status::ok);
    REQUIRE(QuadraticPotential<double>::make(3 * rate * rate * body.inertia(), radial, own_gradient) == Status::ok);
    const Matrix3d attitude = random.rotation();
    const double time = random.uniform(0, 50);
    CHECK((own_gravity.torque(attitude, time) - gravity.torque(attitude, time)).norm() < 1e-14);
    CHECK((own_gradient.torque(attitude, time) - gradient.torque(attitude, time)).norm() < 1e-13);
    CHECK((own_gradient.torque_jacobian(attitude, time) - gradient.torque_jacobian(attitude, time)).norm() < 1e-13);
    CHECK(own_gradient.energy(attitude, time) == doctest::Approx(gradient.energy(attitude, time)));
    CHECK(own_gravity.torque_curvature_bound() == doctest::Approx(gravity.torque_curvature_bound()));
    CHECK(own_gradient.torque_curvature_bound() >= gradient.torque_curvature_bound());

    Trial built_in = random_trial(random, 0.05, 0.05);
    Trial own = built_in;
    const BodyUncertainty<double> uncertainty;
    REQUIRE(predict<double>(body, SumPotential<UniformGravity<double>, GravityGradient<double>>(gravity, gradient),
                            0.05, uncertainty, built_in) == Status::ok);
    REQUIRE(predict<double>(
                body, SumPotential<LinearPotential<double>, QuadraticPotential<double>>(own_gravity, own_gradient),
                0.05, uncertainty, own) == Status::ok);
    CHECK((own.after.center.attitude - built_in.after.center.attitude).norm() < 1e-13);
    const Vector6<double> scale = built_in.after.shape.diagonal().cwiseSqrt().cwiseInverse();
    const Matrix6<double> difference =
        scale.asDiagonal() * (own.after.shape - built_in.after.shape) * scale.asDiagonal();
    CHECK(difference.cwiseAbs().maxCoeff() < 1e-10);
  }
}

TEST_CASE("the state is in the set that functions and a statement of them predict") {
  check_containment<double>(24, 1e-6, 1e-14);
}

TEST_CASE("the state is in the set that functions and a statement of them predict in float") {
  check_containment<float>(24, 1e-3, 1e-5);
}

TEST_CASE("what an expansion about one attitude lacks of the torque") {
  Random random(3);
  double sharpest = 0;
  for (int i = 0; i < 300; ++i) {
    // Between the axes of the greatest and the least value, and about the axis of the middle one, as sharp as can be.
    const bool sharp = i % 3 == 0;
    const QuadraticTorque<double> torque{Vector3d(2, 1, 0).asDiagonal(), 0};
    const auto potential = stated<double>(torque, 2, 0, 0);
    TorqueExpansion<std::decay_t<decltype(potential)>, double, 4> expansion(potential);
    const Matrix3d attitude = sharp ? exp(Vector3d(0, std::atan(1.0), 0)) : random.rotation();
    const Vector3d turn = random.log_uniform(1e-3, 3) * (sharp ? Vector3d(0, 1, 0) : random.unit_vector<3>());
    REQUIRE(expansion.begin_step(attitude, Vector3d::Zero(), 0, 0) == Status::ok);
    const Matrix3d elsewhere = attitude * exp(turn);
    const double lacks = (torque.torque(elsewhere, 0) - expansion.start(elsewhere, 0)).norm();
    const double bound = expansion.remainder(turn.norm(), 0);
    CHECK(lacks <= bound);
    sharpest = std::fmax(sharpest, lacks / bound);
  }
  CHECK(sharpest > 0.99);  // so that half of the curvature would not do
}

TEST_CASE("the part of third order of what an expansion lacks") {
  // A torque that is linear in the turn: all of it but sin θ is left.
  struct Linear {
    [[nodiscard]] Vector3d torque(const Matrix3d& attitude, double /*time*/) const {
      return Vector3d(log(attitude)(0), 0, 0);
    }
    [[nodiscard]] Matrix3d torque_jacobian(const Matrix3d& /*attitude*/, double /*time*/) const {
      return Vector3d(1, 0, 0).asDiagonal();
    }
  };
  const auto potential = stated<double>(Linear{}, 0, 0, 0);
  TorqueExpansion<std::decay_t<decltype(potential)>, double, 4> expansion(potential);
  REQUIRE(expansion.begin_step(Matrix3d::Identity(), Vector3d::Zero(), 0, 0) == Status::ok);
  for (const double angle : {0.1, 0.5, 1.0}) {
    const Matrix3d elsewhere = exp(Vector3d(angle, 0, 0));
    const double lacks = (Linear{}.torque(elsewhere, 0) - expansion.start(elsewhere, 0)).norm();
    CHECK(lacks <= expansion.remainder(angle, 0));
    CHECK(lacks > (1 - angle * angle / 18) * expansion.remainder(angle, 0) - 1e-13);
  }
}

TEST_CASE("the time and the error of a statement") {
  struct Rising {
    [[nodiscard]] Vector3d torque(const Matrix3d& /*attitude*/, double time) const { return {2 * time, 0, 0}; }
    [[nodiscard]] Matrix3d torque_jacobian(const Matrix3d& /*attitude*/, double /*time*/) const {
      return Matrix3d::Zero();
    }
  };
  const auto potential = stated<double>(Rising{}, 0, 2, 0.25);
  TorqueExpansion<std::decay_t<decltype(potential)>, double, 4> expansion(potential);
  REQUIRE(expansion.begin_step(Matrix3d::Identity(), Vector3d::Zero(), 5, 0.5) == Status::ok);
  CHECK(expansion.start(Matrix3d::Identity(), 5)(0) == 10.5);
  CHECK(expansion.remainder(0, 0.25) == doctest::Approx(0.75));
  CHECK(expansion.remainder(0, 0.25) >= 0.75);
}

TEST_CASE("the error of a statement reaches the edge of the set as an unknown torque does") {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(Vector3d(1, 1.0001, 1.0002).asDiagonal().toDenseMatrix(), body) == Status::ok);
  const double size = 1e-3;
  const double push = 5e-4;
  const auto form_with = [&](double stated_error) {
    Trial trial;
    trial.before = {{Matrix3d::Identity(), Vector3d::Zero()}, size * size * Matrix6<double>::Identity()};
    trial.duration = 0.1;
    trial.torque = [&](const RealMatrix&, Real) { return RealVector(static_cast<Real>(push), 0, 0); };
    REQUIRE(predict<double>(body, stated<double>(QuadraticTorque<double>{}, 0, 0, stated_error), 0.1,
                            BodyUncertainty<double>{}, trial) == Status::ok);
    Random random(1);
    return search_worst(trial, random, 6, 4).form;
  };
  CHECK(form_with(push) <= 1);
  CHECK(form_with(push) > 0.97);
  CHECK(form_with(0.5 * push) > 1);
}

TEST_CASE("a statement with half of the curvature loses the truth") {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(Vector3d(1, 1.0001, 1.0002).asDiagonal().toDenseMatrix(), body) == Status::ok);
  const QuadraticTorque<double> torque{Vector3d(2, 1, 0).asDiagonal(), 0};
  const auto form_with = [&](double curvature) {
    Vector6<double> widths;
    widths << 0.002, 0.05, 0.002, 0.002, 0.002, 0.002;  // wide where the torque is curved most
    Trial trial;
    trial.before = {{exp(Vector3d(0, std::atan(1.0), 0)), Vector3d::Zero()},
                    widths.cwiseAbs2().asDiagonal().toDenseMatrix()};
    trial.duration = 0.2;
    trial.torque = truth_of(QuadraticTorque<Real>{torque.matrix.cast<Real>(), 0});
    REQUIRE(predict<double>(body, stated<double>(torque, curvature, 0, 0), 0.02, BodyUncertainty<double>{}, trial) ==
            Status::ok);
    Random random(1);
    return search_worst(trial, random, 8, 6).form;
  };
  CHECK(form_with(2) <= 1);
  CHECK(form_with(2) > 0.75);
  CHECK(form_with(1) > 1);
}

TEST_CASE("the rate alone is bounded by a stated torque") {
  Random random(11);
  for (int i = 0; i < 10; ++i) {
    const RigidBody<double> body = random_body(random);
    const Vector3d axis = random.unit_vector<3>();
    const CubicTorque<double> torque{axis, 0.3};
    using Potential = StatedTorque<double, CubicTorque<double>>;
    GuaranteedRigidBodyFlow<double, Potential> flow;
    REQUIRE(GuaranteedRigidBodyFlow<double, Potential>::make(
                body, stated<double>(torque, 0.5 * 9 * 1.1548 * 0.3, 0, 1e-14), 0.1, {}, flow) == Status::ok);
    const Ellipsoid<double, 3> start{random.normal_matrix<3>(), 1e-4 * Matrix3d::Identity()};
    Ellipsoid<double, 3> end;
    REQUIRE(flow.predict_vector(3, 0.5, {}, start, end) == Status::ok);
    const Motion motion =
        independent_flow(body.inertia().cast<Real>(), truth_of(CubicTorque<Real>{axis.cast<Real>(), 0.3L}),
                         {random.rotation().cast<Real>(), start.center.cast<Real>()}, 3, 0.5L, 4);
    CHECK(contains(end, Vector3d(motion.angular_velocity.cast<double>())));
  }
}

TEST_CASE_TEMPLATE("a direction and its turn are as they are, however small or large their numbers", Scalar, double,
                   float) {
  constexpr auto epsilon = std::numeric_limits<Scalar>::epsilon();
  const Vector3<Scalar> along(3, 0, 4);
  const Vector3<Scalar> across(4, 2, -3);
  const Scalar least = std::numeric_limits<Scalar>::min();
  for (const Scalar size : {4 * least, Scalar(1) / std::sqrt(std::numeric_limits<Scalar>::max()), std::sqrt(least),
                            Scalar(1), 4 / std::sqrt(least), 1 / (4 * least)}) {
    TurningDirection<Scalar> direction;
    REQUIRE(TurningDirection<Scalar>::make(size * along, Vector3<Scalar>::Zero(), direction) == Status::ok);
    CHECK((direction.start() - along / 5).norm() <= 4 * epsilon);
    if (size > 1) {
      continue;
    }
    REQUIRE(TurningDirection<Scalar>::make(along, size * across, direction) == Status::ok);
    CHECK((direction.start() - along / 5).norm() <= 16 * epsilon);
    CHECK(direction.start().dot(direction.along()) <= 4 * epsilon);
    CHECK(std::fabs(direction.rate() / size - across.norm()) <= 16 * epsilon);
  }
  TurningDirection<Scalar> direction;
  const Vector3<Scalar> beyond = Vector3<Scalar>::Constant(std::numeric_limits<Scalar>::max());
  CHECK(TurningDirection<Scalar>::make(Vector3<Scalar>(1, -1, 0), beyond, direction) == Status::out_of_range);
}

TEST_CASE("what potentials of one's own refuse") {
  const double infinite = std::numeric_limits<double>::infinity();
  TurningDirection<double> direction;
  using Direction = TurningDirection<double>;
  CHECK(Direction::make(Vector3d::Zero(), Vector3d::Zero(), direction) == Status::zero_direction);
  CHECK(Direction::make(Vector3d(1, 0, 0), Vector3d(0.1, 0, 1), direction) == Status::out_of_range);
  CHECK(Direction::make(Vector3d(1, 0, infinite), Vector3d::Zero(), direction) == Status::not_finite);
  LinearPotential<double> linear;
  CHECK(LinearPotential<double>::make(Vector3d(1, 0, infinite), direction, linear) == Status::not_finite);
  QuadraticPotential<double> quadratic;
  Matrix3d matrix = Matrix3d::Identity();
  matrix(0, 1) = 0.1;
  CHECK(QuadraticPotential<double>::make(matrix, direction, quadratic) == Status::not_symmetric);
  using Stated = StatedTorque<double, QuadraticTorque<double>>;
  Stated result;
  CHECK(Stated::make({}, {-1, 0, 0}, result) == Status::out_of_range);
  CHECK(Stated::make({}, {1, infinite, 0}, result) == Status::not_finite);

  struct Failing {
    [[nodiscard]] Vector3d torque(const Matrix3d& /*attitude*/, double /*time*/) const {
      return Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    }
    [[nodiscard]] Matrix3d torque_jacobian(const Matrix3d& /*attitude*/, double /*time*/) const {
      return Matrix3d::Zero();
    }
  };
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(Matrix3d::Identity(), body) == Status::ok);
  Trial trial;
  trial.before = {{Matrix3d::Identity(), Vector3d::Zero()}, 1e-4 * Matrix6<double>::Identity()};
  trial.duration = 1;
  CHECK(predict<double>(body, stated<double>(Failing{}, 0, 0, 0), 0.1, BodyUncertainty<double>{}, trial) ==
        Status::callback_failed);
}
