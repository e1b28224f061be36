// What the body flow does at its limits: steps that are too many or stopped, sets that need finer steps, needles and spheres, and
// what its statuses say.
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Flow = GuaranteedRigidBodyFlow<double, FreeBody<double>>;
using Set = GibbsEllipsoid<RigidBodyState<double>>;

const RealTorque no_torque = [](const RealMatrix&, Real) { return RealVector(RealVector::Zero()); };

Flow free_flow(const RigidBody<double>& body, double step) {
  Flow flow;
  REQUIRE(Flow::make(body, {}, step, {}, flow) == Status::ok);
  return flow;
}

/// Two nearly equal moments and one that is smaller by `ratio`, about any axes.
RigidBody<double> needle(Random& random, double ratio) {
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(random.symmetric<3>(Vector3d(1, 1 + 0.7 / ratio, 1 / ratio)), body) == Status::ok);
  return body;
}

/// The largest form after a motion from anywhere on the set's boundary.
double worst_form(const RigidBody<double>& body, const Set& before, const Set& after, double duration, int intervals,
                  Random& random) {
  const RealMatrix6 factor = RealMatrix6(before.shape.cast<Real>()).llt().matrixL();
  const RealMatrix6 inverse = RealMatrix6(after.shape.cast<Real>()).inverse();
  double worst = 0;
  for (int k = 0; k < 8; ++k) {
    const RealVector6 y = factor * random.unit_vector<6>().cast<Real>();
    const Motion end = independent_flow(body.inertia().cast<Real>(), no_torque, gibbs_motion(before.center, y), 0,
                                        Real(duration), intervals);
    const RealVector6 error = gibbs_error(after.center, end);
    worst = std::fmax(worst, static_cast<double>(error.dot(inverse * error)));
  }
  return worst;
}

}  // namespace

TEST_CASE("needles and spheres keep small sets") {
  Random random(20260503);
  for (const double ratio : {1.0, 1e2, 1e4, 1e5}) {
    for (const double size : {1e-3, 1e-6, 1e-9}) {
      double worst = 0;
      double growth = 0;
      for (int trial = 0; trial < 10; ++trial) {
        const double step = 0.05;
        const int steps = trial % 2 == 0 ? 1 : 20;
        RigidBody<double> body = needle(random, ratio);
        if (ratio == 1) {
          REQUIRE(RigidBody<double>::make(random.symmetric<3>(Vector3d(1, 1 + 1e-9, 1 + 2e-9)), body) == Status::ok);
        }
        const Set before{{random.rotation(), random.log_uniform(0.05, 1) * random.unit_vector<3>()},
                         Matrix6<double>(size * size * Matrix6<double>::Identity())};
        Set after;
        REQUIRE(free_flow(body, step).predict(0, steps * step, {}, before, after) == Status::ok);
        worst = std::fmax(worst, worst_form(body, before, after, steps * step, steps, random));
        if (steps == 1) {
          growth = std::fmax(growth, std::sqrt(after.shape.trace() / before.shape.trace()));
        }
      }
      CHECK(worst <= 1);
      // A set is lost to rounding only where it is not far above ε times the ratio of the moments.
      CHECK(growth < 1.1 + 100 * 2.2e-16 * ratio / size);
    }
  }
}

TEST_CASE("the defect of a needle's motion is bounded by its rounding") {
  // Steps so short that there is nothing but rounding: the rate's series against Euler's equation, in long double.
  Random random(20260504);
  double largest_share = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const double ratio = random.log_uniform(1, 1e6);
    const RigidBody<double> body = needle(random, ratio);
    const double h = random.log_uniform(1e-4, 1e-2);
    const RigidBodyState<double> state{random.rotation(), random.unit_vector<3>()};
    BodyInput<double> input;
    if (trial % 2 == 1) {
      input.wheel_momentum = random.log_uniform(1e-3, 1) / ratio * random.unit_vector<3>();
    }
    MotionSeries<double, FreeBody<double>> series(body, FreeBody<double>{});
    REQUIRE(series.expand(body, 0, h, input, state) == Status::ok);
    const RealMatrix inertia = body.inertia().cast<Real>();
    const RealMatrix inverse = inertia.inverse();
    const RealVector wheel = input.wheel_momentum.cast<Real>();
    RealVector impulse = RealVector::Zero();
    const int parts = 8;
    for (int k = 0; k <= parts; ++k) {
      const Real s = static_cast<Real>(h) * k / parts;
      RealVector w = RealVector::Zero();
      RealVector slope = RealVector::Zero();
      for (int n = series.order; n >= 0; --n) {
        w = s * w + series.rate[static_cast<std::size_t>(n)].cast<Real>();
        if (n > 0) {
          slope = s * slope + n * series.rate[static_cast<std::size_t>(n)].cast<Real>();
        }
      }
      const RealVector defect = slope + inverse * RealVector(w.cross(RealVector(inertia * w + wheel)));
      impulse += (k == 0 || k == parts ? 1 : k % 2 == 1 ? 4 : 2) * defect.cwiseAbs();
    }
    impulse *= static_cast<Real>(h) / (3 * parts);
    const double share = static_cast<double>(impulse.norm()) / series.rate_defect;
    CHECK(share <= 1);
    largest_share = std::fmax(largest_share, share);
  }
  MESSAGE("largest share of the bound " << largest_share);
  CHECK(largest_share > 1e-3);
}

TEST_CASE("the most steps of a prediction are a setting") {
  const RigidBody<double> body;
  Flow flow = free_flow(body, 0.01);
  const Set before{{Matrix3d::Identity(), Vector3d(0.1, 0, 0)}, 1e-6 * Matrix6<double>::Identity()};
  Set after;
  CHECK(flow.most_steps() == default_most_steps);
  CHECK(flow.set_most_steps(0) == Status::out_of_range);
  REQUIRE(flow.set_most_steps(100) == Status::ok);
  CHECK(flow.predict(0, 1, {}, before, after) == Status::ok);
  CHECK(flow.predict(0, 1.02, {}, before, after) == Status::too_many_steps);
  for (const double duration : {1e60, 1e100, 1e300}) {
    CHECK(flow.predict(0, duration, {}, before, after) == Status::too_many_steps);
    CHECK(free_flow(body, duration).predict(0, duration, {}, before, after) == Status::step_too_long);
  }
  CHECK(flow.predict(0, -1, {}, before, after) == Status::out_of_range);
  Ellipsoid<double, 3> rate{Vector3d::Zero(), Matrix3d::Identity()};
  UniformGravity<double> gravity;
  REQUIRE(UniformGravity<double>::make(1, 1, Vector3d(1, 0, 0), gravity) == Status::ok);
  GuaranteedRigidBodyFlow<double, UniformGravity<double>> pendulum;
  REQUIRE(decltype(pendulum)::make(body, gravity, 0.1, {}, pendulum) == Status::ok);
  CHECK(pendulum.predict_vector(0, 1e100, {}, rate, rate) == Status::ok);
  CHECK(pendulum.predict_vector(0, 1e200, {}, rate, rate) == Status::beyond_domain);

  RigidBodyFlow<double, FreeBody<double>> first_order;
  REQUIRE(decltype(first_order)::make(body, {}, 0.01, 2, Matrix3d::Zero(), first_order) == Status::ok);
  REQUIRE(first_order.set_most_steps(100) == Status::ok);
  const StateEllipsoid<RigidBodyState<double>> start{before.center, before.shape};
  Prediction<RigidBodyState<double>> prediction;
  const auto criterion = SizeCriterion<double, 6>::trace();
  CHECK(first_order.predict(0, 1, {}, start, criterion, prediction) == Status::ok);
  CHECK(first_order.predict(0, 1.02, {}, start, criterion, prediction) == Status::too_many_steps);
  CHECK(first_order.predict(0, 1e100, {}, start, criterion, prediction) == Status::too_many_steps);
}

TEST_CASE("rounding of two times does not cost a second step") {
  // The difference of two times is the longest step but for their rounding: with a second step the set would be another one.
  const RigidBody<double> body;
  const Set before{{Matrix3d::Identity(), Vector3d(0.3, -0.2, 0.1)}, 1e-4 * Matrix6<double>::Identity()};
  Flow flow = free_flow(body, 0.1);
  REQUIRE(flow.set_most_steps(1) == Status::ok);
  RigidBodyFlow<double, FreeBody<double>> first_order;
  REQUIRE(decltype(first_order)::make(body, {}, 0.1, 2, Matrix3d::Zero(), first_order) == Status::ok);
  REQUIRE(first_order.set_most_steps(1) == Status::ok);
  const auto criterion = SizeCriterion<double, 6>::trace();
  for (const double first : {0.0, 20.0, 1e5, 1.7e9}) {
    for (int k = 0; k < 40; ++k) {
      const double time = first + 0.1 * k;
      const double duration = first + 0.1 * (k + 1) - time;
      Set after;
      CHECK(flow.predict(time, duration, {}, before, after) == Status::ok);
      Prediction<RigidBodyState<double>> prediction;
      const StateEllipsoid<RigidBodyState<double>> start{before.center, before.shape};
      CHECK(first_order.predict(time, duration, {}, start, criterion, prediction) == Status::ok);
    }
  }
  Set after;
  CHECK(flow.predict(0, 0.1002, {}, before, after) == Status::too_many_steps);
}

TEST_CASE("a caller can stop a prediction") {
  struct Counter {
    int asked = 0;
    int until = 0;
  } counter;
  const Interruption interruption{[](void* context) noexcept {
                                    auto& count = *static_cast<Counter*>(context);
                                    return ++count.asked > count.until;
                                  },
                                  &counter};
  const RigidBody<double> body;
  Flow flow = free_flow(body, 0.01);
  flow.set_interruption(interruption);
  const Set before{{Matrix3d::Identity(), Vector3d(0.1, 0, 0)}, 1e-6 * Matrix6<double>::Identity()};
  Set after = before;
  CHECK(flow.predict(0, 0.01 * 60, {}, before, after) == Status::ok);  // too short to be asked
  CHECK(counter.asked == 0);
  after = before;
  CHECK(flow.predict(0, 10, {}, before, after) == Status::interrupted);
  CHECK(counter.asked == 1);
  CHECK(after.shape == before.shape);
  counter = {0, 3};
  CHECK(flow.predict(0, 10, {}, before, after) == Status::interrupted);
  CHECK(counter.asked == 4);
  counter = {0, 1000000};
  CHECK(flow.predict(0, 10, {}, before, after) == Status::ok);

  for (const double torque : {0.0, 1e-6}) {
    RigidBodyFlow<double, FreeBody<double>> first_order;
    const Matrix3d shape = torque * Matrix3d::Identity();
    REQUIRE(decltype(first_order)::make(body, {}, 0.01, 2, shape, first_order) == Status::ok);
    first_order.set_interruption(interruption);
    const StateEllipsoid<RigidBodyState<double>> start{before.center, before.shape};
    Prediction<RigidBodyState<double>> prediction;
    counter = {0, 3};
    CHECK(first_order.predict(0, 10, {}, start, SizeCriterion<double, 6>::trace(), prediction) == Status::interrupted);
    CHECK(counter.asked == 4);
  }
}

TEST_CASE("finer steps before a set is given up") {
  // Sets and steps at the edge of what closes: whatever closes with a third or a ninth of the step is not refused, and holds.
  Random random(20260505);
  int closed_by_finer = 0;
  int refused = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const RigidBody<double> body = random_body(random);
    const double spin = random.log_uniform(0.5, 3);
    const double step = random.log_uniform(0.05, 0.3);
    const double duration = 12 * step;
    const double size = random.log_uniform(0.02, 0.5);
    const Set before{{random.rotation(), spin * random.unit_vector<3>()},
                     Matrix6<double>(size * size * Matrix6<double>::Identity())};
    const Flow flow = free_flow(body, step);
    Set after;
    const Status status = flow.predict(0, duration, {}, before, after);
    Flow strict = flow;  // with no steps to spare there is no finer try
    REQUIRE(strict.set_most_steps(12) == Status::ok);
    Set once;
    const Status coarse = strict.predict(0, duration, {}, before, once);
    if (coarse == Status::ok) {
      REQUIRE(status == Status::ok);
      CHECK(after.shape == once.shape);  // to the bit
    } else if (status == Status::ok) {
      ++closed_by_finer;
      CHECK(worst_form(body, before, after, duration, 24, random) <= 1);
    } else {
      ++refused;
    }
  }
  MESSAGE("closed by finer steps alone " << closed_by_finer << ", refused " << refused);
  CHECK(closed_by_finer > 0);
}

TEST_CASE("a step that turns the body too far is divided before it is refused") {
  Random random(20261122);
  int divided = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const RigidBody<double> body = random_body(random);
    const double step = random.log_uniform(0.05, 2);
    const Set before{{random.rotation(), 5 * random.unit_vector<3>()}, 1e-6 * Matrix6<double>::Identity()};
    const Flow flow = free_flow(body, step);
    Flow strict = flow;  // with no steps to spare there is no finer try
    REQUIRE(strict.set_most_steps(1) == Status::ok);
    Set after;
    const Status status = flow.predict(0, step, {}, before, after);
    Set once;
    const Status coarse = strict.predict(0, step, {}, before, once);
    REQUIRE((coarse != Status::ok || status == Status::ok));
    if (coarse == Status::step_too_long && status == Status::ok) {
      ++divided;
      CHECK(worst_form(body, before, after, step, 24, random) <= 1);
    }
  }
  MESSAGE("divided " << divided);
  CHECK(divided > 0);
}

TEST_CASE("a thin set does not become wider and wider to stay thin") {
  Random random(20261123);
  const double h = 1e-3;
  const double width = 0.03;
  const int steps = 200;
  for (int trial = 0; trial < 10; ++trial) {
    Eigen::Matrix<double, 6, 1> squares;
    for (int i = 0; i < 6; ++i) {
      squares(i) = std::pow(width * std::pow(1e-6, i / 5.0), 2);
    }
    const Matrix6<double> shape = random.symmetric<6>(squares);
    const auto widest = [](const Matrix6<double>& p) {
      return std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix6<double>>(p).eigenvalues().maxCoeff());
    };

    Set body_set{{random.rotation(), random.in_ball<3>()}, shape};
    const Flow body = free_flow(random_body(random), h);
    GibbsEllipsoid<GyroState<double>> gyro_set{{random.rotation(), random.in_ball<3>()}, shape};
    GuaranteedGyroFlow<double> gyro;
    REQUIRE(gyro.make({}, GuaranteedGyroFlow<double>::IntervalRate::mean, gyro) == Status::ok);
    const Vector3d rate = random.in_ball<3>();
    for (int k = 0; k < steps; ++k) {
      REQUIRE(body.predict(k * h, h, {}, body_set, body_set) == Status::ok);
      REQUIRE(gyro.predict(k * h, h, {rate}, gyro_set, gyro_set) == Status::ok);
    }
    // What the motion does to the widest axis in 0.2 s is less than a fifth of it.
    CHECK(widest(body_set.shape) < 3 * width);
    CHECK(widest(gyro_set.shape) < 3 * width);
  }
}
