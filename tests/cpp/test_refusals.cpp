// What the functions must refuse, each by its status and with its output as it was: numbers that are not finite or would not be,
// lengths of time and numbers of steps that are none, and values that no enumeration has.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <utility>

#include "elliptude/elliptude.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
const Matrix3<double> one = Matrix3<double>::Identity();

/// A set about a state with a number of the attitude and one of the vector put in the place of its own.
template <typename Chart>
StateEllipsoid<GyroState<double>, Chart> set_about(double attitude, double vector) {
  StateEllipsoid<GyroState<double>, Chart> set{{one, Vector3<double>::Zero()}, 1e-4 * Matrix6<double>::Identity()};
  set.center.attitude(0, 0) = attitude;
  set.center.gyro_bias(1) = vector;
  return set;
}

}  // namespace

TEST_CASE("a state that is not finite is not predicted, and nothing is put about it") {
  GuaranteedGyroFlow<double> guaranteed;
  REQUIRE(GuaranteedGyroFlow<double>::make({}, GuaranteedGyroFlow<double>::IntervalRate::mean, guaranteed) ==
          Status::ok);
  GyroFlow<double> flow;
  REQUIRE(GyroFlow<double>::make(1e-6 * one, 1e-8 * one, flow) == Status::ok);
  const SizeCriterion<double, 6> criterion = SizeCriterion<double, 6>::trace();
  const Ellipsoid<double, 6> errors{Vector6<double>::Zero(), 1e-4 * Matrix6<double>::Identity()};
  for (const auto& [attitude, vector] :
       {std::pair(1.0, 0.0), std::pair(not_a_number, 0.0), std::pair(1.0, not_a_number)}) {
    const Status expected = attitude == 1 && vector == 0 ? Status::ok : Status::not_finite;
    const auto set = set_about<GibbsChart>(attitude, vector);
    GibbsEllipsoid<GyroState<double>> result = set_about<GibbsChart>(1, 7);
    for (const double duration : {0.0, 0.1}) {
      CHECK(guaranteed.predict(0, duration, {Vector3<double>::Zero()}, set, result) == expected);
      CHECK(guaranteed.predict_turn(duration, Vector3<double>(0.1, 0, 0), 0.01, set, result) == expected);
    }
    CHECK(recentred(set.center, errors, result) == expected);
    CHECK((expected == Status::ok || result.center.gyro_bias(1) == 7));
    Prediction<GyroState<double>> prediction;
    prediction.ellipsoid.center.gyro_bias(1) = 7;
    CHECK(flow.predict(0, 0.1, {Vector3<double>::Zero()}, set_about<ExponentialChart>(attitude, vector), criterion,
                       prediction) == expected);
    CHECK((expected == Status::ok || prediction.ellipsoid.center.gyro_bias(1) == 7));
  }
  Ellipsoid<double, 3> bias{Vector3<double>::Zero(), one};
  CHECK(guaranteed.predict_vector(0, 0.1, {}, {Vector3<double>(0, not_a_number, 0), one}, bias) == Status::not_finite);
  CHECK(bias.center == Vector3<double>::Zero());
}

TEST_CASE("what is not finite makes no linear measurement") {
  const Matrix3<double> no_number = Matrix3<double>::Constant(not_a_number);
  const Direction<double> direction = Direction<double>::within({1, 0, 0}, {1, 0, 0}, 0.01);
  LinearMeasurement<double, 2> of_direction;
  of_direction.y(0) = 7;
  CHECK(linear_direction(no_number, direction, of_direction) == Status::not_finite);
  CHECK(of_direction.y(0) == 7);
  LinearMeasurement<double, 3> of_attitude;
  of_attitude.y(0) = 7;
  CHECK(linear_attitude(no_number, {one, one}, of_attitude) == Status::not_finite);
  CHECK(linear_attitude(one, {one, no_number}, of_attitude) == Status::not_finite);
  CHECK(of_attitude.y(0) == 7);
  CHECK(linear_attitude(one, {one, one}, of_attitude) == Status::ok);
}

TEST_CASE("bodies and potentials whose numbers overflow are beyond the domain") {
  RigidBody<double> body;
  for (const double size : {1e-310, 1e308}) {
    CHECK(RigidBody<double>::make(size * one, body) == Status::beyond_domain);
    CHECK(body.inertia() == one);
  }
  UniformGravity<double> gravity;
  CHECK(UniformGravity<double>::make(1e200, 1e200, Vector3<double>::UnitX(), gravity) == Status::beyond_domain);
  CHECK(UniformGravity<double>::make(1e100, 1e100, 1e200 * Vector3<double>::UnitX(), gravity) == Status::beyond_domain);
  CHECK(gravity.moment() == Vector3<double>::Zero());
  GravityGradient<double> gradient;
  CHECK(GravityGradient<double>::make(body, 1e200, one, gradient) == Status::beyond_domain);
  REQUIRE(RigidBody<double>::make(1e200 * one, body) == Status::ok);
  CHECK(GravityGradient<double>::make(body, 1e80, one, gradient) == Status::beyond_domain);
  CHECK(gradient.orbit_rate() == 0);
  CHECK(GravityGradient<double>::make(body, 1e50, one, gradient) == Status::ok);
}

TEST_CASE("quadrics whose numbers overflow, or have no digits left, are beyond the domain") {
  const Vector3<double> x = Vector3<double>::UnitX();
  Quadric<double, 3> quadric{one, x, 7};
  for (const double length : {1e300, 1e-160, 1e-170, 5e-324}) {
    CHECK(slab(Vector3<double>(length * x), 0.0, 1.0, quadric) == Status::beyond_domain);
  }
  CHECK(slab(Vector3<double>(1e100 * x), 1e250, 1e250, quadric) == Status::beyond_domain);
  CHECK(slab(x, 1e200, 0.0, quadric) == Status::beyond_domain);
  CHECK(slab(Vector3<double>::Zero().eval(), 0.0, 1.0, quadric) == Status::zero_direction);
  CHECK(to_quadric(Ellipsoid<double, 3>{1e200 * x, one}, quadric) == Status::beyond_domain);
  CHECK(quadric.a == one);
  CHECK(quadric.g == x);
  CHECK(quadric.c == 7);
  CHECK(slab(Vector3<double>(1e-100 * x), 0.0, 1.0, quadric) == Status::ok);
}

TEST_CASE("a motion lasts for a positive time, and an integrator takes no negative number of steps") {
  MovingState<double> still{{one, Vector3<double>::Zero()}, Vector3<double>::Zero()};
  MotionBetween<double> motion;
  CHECK(motion.at(0.5).attitude == one);
  for (const double duration : {0.0, -1.0}) {
    CHECK(MotionBetween<double>::make(still, still, duration, motion) == Status::out_of_range);
  }
  CHECK(MotionBetween<double>::make(still, still, not_a_number, motion) == Status::not_finite);
  CHECK(MotionBetween<double>::make(still, still, 1.0, motion) == Status::ok);
  MovingState<double> lost = still;
  lost.acceleration(0) = not_a_number;
  CHECK(MotionBetween<double>::make(still, lost, 1.0, motion) == Status::not_finite);
  lost.acceleration(0) = 1e308;  // of which 10 times is none
  CHECK(MotionBetween<double>::make(still, lost, 10.0, motion) == Status::not_finite);

  Composition<double> composition;
  REQUIRE(composition_of_order(2, composition) == Status::ok);
  RigidBodyState<double> next{2 * one, Vector3<double>::Zero()};
  const Vector3<double> no_torque = Vector3<double>::Zero();
  CHECK(integrate(RigidBody<double>(), FreeBody<double>(), composition, 0.0, 0.1, -1L, no_torque, still.state, next,
                  [](long, const RigidBodyState<double>&) {}) == Status::out_of_range);
  FlowLinearization<double> linearization;
  CHECK(integrate_linearized(RigidBody<double>(), FreeBody<double>(), composition, 0.0, 0.1, -1L, no_torque,
                             still.state, next, linearization) == Status::out_of_range);
  CHECK(next.attitude == 2 * one);
}

TEST_CASE("the nearest rotation does not depend on the unit of a matrix") {
  Random random(9);
  const Matrix3<double> truth = random.rotation();
  for (const double unit : {1e-300, 1e-200, 1.0, 1e155, 1e307}) {
    Matrix3<double> rotation = Matrix3<double>::Zero();
    REQUIRE(project_to_rotation(Matrix3<double>(unit * truth), rotation) == Status::ok);
    CHECK((rotation - truth).norm() < 1e-14);
  }
  Matrix3<double> rotation = 2 * one;
  CHECK(project_to_rotation(Matrix3<double>::Zero().eval(), rotation) == Status::not_a_rotation);
  CHECK(rotation == 2 * one);
}

TEST_CASE("what is none of an enumeration's values, or a weight that is none, is refused") {
  using Flow = GuaranteedGyroFlow<double>;
  Flow flow;
  CHECK(Flow::make({}, Flow::IntervalRate(77), flow) == Status::out_of_range);
  GuaranteedFilter<Flow>::Settings settings;
  settings.policy = Policy(77);
  GuaranteedFilter<Flow> filter;
  CHECK(GuaranteedFilter<Flow>::make(flow, settings, 0, filter) == Status::out_of_range);
  DirectionFilter<double> direction;
  CHECK(DirectionFilter<double>::make({Policy(77), 10}, direction) == Status::out_of_range);
  using Criterion = SizeCriterion<double, 3>;
  CHECK(validate(Criterion{Criterion::Kind(77), one}) == Status::out_of_range);
  for (const Criterion::Kind kind : {Criterion::Kind::trace, Criterion::Kind::volume}) {
    CHECK(validate(Criterion{kind, one}) == Status::ok);
    CHECK(validate(Criterion{kind, not_a_number * one}) == Status::not_finite);
    CHECK(validate(Criterion{kind, -one}) == Status::out_of_range);
    CHECK(validate(Criterion{kind, 2 * one}) == Status::out_of_range);
  }
  CHECK(validate(Criterion::weighted_trace(2 * one)) == Status::ok);
  CHECK(validate(Criterion::weighted_trace(not_a_number * one)) == Status::not_finite);
  CHECK(validate(Criterion::weighted_trace(-one)) == Status::not_positive_definite);
}

TEST_CASE_TEMPLATE("a filter that knows nothing is not moved to a time that tells no seconds apart", Scalar, double,
                   float) {
  using Flow = GuaranteedGyroFlow<Scalar>;
  Flow flow;
  REQUIRE(Flow::make({}, Flow::IntervalRate::mean, flow) == Status::ok);
  GuaranteedFilter<Flow> filter;
  REQUIRE(GuaranteedFilter<Flow>::make(flow, {}, Scalar(0), filter) == Status::ok);
  const Scalar last = 1 / std::numeric_limits<Scalar>::epsilon();
  const Vector3<Scalar> turn = Vector3<Scalar>::Zero();
  for (const Scalar time : {std::nextafter(last, 2 * last), std::numeric_limits<Scalar>::max()}) {
    CHECK(filter.predict(time, {}) == Status::out_of_range);
    CHECK(filter.predict_turn(time, turn, Scalar(0)) == Status::out_of_range);
    CHECK(filter.predict(-time, {}) == Status::out_of_range);
  }
  CHECK(filter.predict(std::numeric_limits<Scalar>::infinity(), {}) == Status::not_finite);
  CHECK(filter.time() == Scalar(0));
  CHECK(filter.predict_interval(2 * last, Scalar(1), {}) == Status::ok);  // the interval is known beside the time
  REQUIRE(GuaranteedFilter<Flow>::make(flow, {}, Scalar(0), filter) == Status::ok);
  CHECK(filter.predict(last, {}) == Status::ok);
}

namespace {

using GyroFilter = GuaranteedFilter<GuaranteedGyroFlow<double>>;

/// A gyro's set, within 0.01 rad of the identity, with a bias within 0.01 rad/s of zero.
GyroFilter started_filter(Policy policy) {
  GuaranteedGyroFlow<double> flow;
  REQUIRE(GuaranteedGyroFlow<double>::make({}, GuaranteedGyroFlow<double>::IntervalRate::mean, flow) == Status::ok);
  GyroFilter::Settings settings;
  settings.policy = policy;
  GyroFilter filter;
  REQUIRE(GyroFilter::make(flow, settings, 0, filter) == Status::ok);
  REQUIRE(filter.start(set_about<GibbsChart>(1, 0)) == Status::ok);
  return filter;
}

}  // namespace

TEST_CASE("a rate that nobody gave is refused, and not taken for none") {
  GyroFilter filter = started_filter(Policy::raise);
  CHECK(filter.predict(1, {}) == Status::not_finite);
  CHECK(filter.time() == 0);
  CHECK(filter.predict(1, {Vector3<double>::Zero()}) == Status::ok);
}

TEST_CASE("a bound of the vector that contradicts what is known of it is refused, and the filter goes on") {
  GyroFilter filter = started_filter(Policy::drop_measurement);
  CHECK(filter.bound_vector({Vector3<double>(1, 0, 0), 0.01 * one}) == Status::empty_intersection);
  CHECK_FALSE(filter.has_vector_bound());
  CHECK(filter.bound_vector({Vector3<double>(0.1, 0, 0), 0.0121 * one}) == Status::ok);
  const Direction<double> up = Direction<double>::within(Vector3<double>::UnitZ(), Vector3<double>::UnitZ(), 0.1);
  GuaranteedUpdate<double> update;
  CHECK(filter.update({&up, 1, nullptr, nullptr}, update) == Status::ok);
  filter.forget();
  CHECK(filter.bound_vector({Vector3<double>(1, 0, 0), 0.01 * one}) == Status::ok);
}

TEST_CASE("a start that contradicts the bound of the vector is refused, but a stored set is taken up as it was") {
  for (const bool estimates_vector : {true, false}) {
    GuaranteedGyroFlow<double> flow;
    REQUIRE(GuaranteedGyroFlow<double>::make({}, GuaranteedGyroFlow<double>::IntervalRate::mean, flow) == Status::ok);
    GyroFilter::Settings settings;
    settings.estimates_vector = estimates_vector;
    GyroFilter filter;
    REQUIRE(GyroFilter::make(flow, settings, 0, filter) == Status::ok);
    REQUIRE(filter.bound_vector({Vector3<double>(5, 0, 0), 0.01 * one}) == Status::ok);
    const auto set = set_about<GibbsChart>(1, 0);
    CHECK(filter.start(set) == (estimates_vector ? Status::empty_intersection : Status::ok));
    CHECK(filter.knows_attitude() != estimates_vector);
    CHECK(filter.resume(&set, nullptr, Trust()) == Status::ok);
    CHECK(filter.knows_attitude());
  }
}

TEST_CASE("where there is no set, none is shown, and a report says what this update did") {
  GyroFilter filter = started_filter(Policy::raise);
  const Direction<double> up = Direction<double>::within(Vector3<double>::UnitZ(), Vector3<double>::UnitZ(), 0.1);
  const Direction<double> wrong = Direction<double>::within(Vector3<double>::UnitZ(), Vector3<double>::UnitX(), 0.1);
  GuaranteedUpdate<double> update;
  REQUIRE(filter.update({&up, 1, nullptr, nullptr}, update) == Status::ok);
  REQUIRE(update.fusions > 0);
  CHECK(filter.update({&wrong, 1, nullptr, nullptr}, update) == Status::empty_intersection);
  CHECK(update.claim == Claim::unconditional);  // the filter is as it was
  CHECK(update.margin < 0);
  CHECK_FALSE(update.prediction_used);
  const AngularVelocity<double> rate{Vector3<double>::Zero(), one};
  CHECK(filter.update({&up, 1, &rate, nullptr}, update) == Status::out_of_range);
  CHECK(update.fusions == 0);
  CHECK(update.margin == 1);
  CHECK(filter.update({nullptr, 2, nullptr, nullptr}, update) == Status::out_of_range);
  CHECK(filter.knows_attitude());
  filter.forget();
  CHECK(filter.ellipsoid().shape.array().isNaN().all());
  CHECK(filter.update({&up, 1, nullptr, nullptr}, update) == Status::ok);
  CHECK(update.claim == Claim::none);  // one direction alone
  CHECK(filter.ellipsoid().shape.array().isNaN().all());
}

TEST_CASE("an angle that is negative makes no direction") {
  for (const double angle : {-0.01, -1.0, 0.0}) {
    const auto direction = Direction<double>::within(Vector3<double>::UnitZ(), Vector3<double>::UnitZ(), angle);
    CHECK(validate(direction) == Status::not_positive_definite);
  }
}
