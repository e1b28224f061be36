/// What limits leave out of a program for a small processor is refused, or said, and what is left works.

#define ELLIPTUDE_MOST_DIRECTIONS 4
#define ELLIPTUDE_MOST_QUADRICS 8
#define ELLIPTUDE_MOST_QUESTIONED 0
#define ELLIPTUDE_MOST_WRONG 0
#define ELLIPTUDE_ONLY_VOLUME 1
#define ELLIPTUDE_ONLY_POLICY raise
#define ELLIPTUDE_ONLY_WHOLE_STATES 1
#define ELLIPTUDE_ONLY_DIRECTIONS 1
#define ELLIPTUDE_ONLY_KNOWN_TORQUES 1
#define ELLIPTUDE_ONLY_FOAM 1

#include <doctest/doctest.h>

#include <elliptude/elliptude.hpp>
#include <vector>

using namespace elliptude;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Flow = GuaranteedRigidBodyFlow<double, FreeBody<double>>;
using Filter = GuaranteedFilter<Flow>;
using GyroMotionFlow = GuaranteedGyroFlow<double>;
using GyroFilter = GuaranteedFilter<GyroMotionFlow>;
using PaperFlow = RigidBodyFlow<double, FreeBody<double>>;

/// Of the axes of the reference, each seen without error.
std::vector<Direction<double>> directions(std::size_t count) {
  std::vector<Direction<double>> result;
  for (std::size_t i = 0; i < count; ++i) {
    const Vector3d axis = Vector3d::Unit(static_cast<int>(i % 3));
    result.push_back(Direction<double>::within(axis, axis, 0.01));
  }
  return result;
}

const AngularVelocity<double> rate{Vector3d::Zero(), 1e-4 * Matrix3d::Identity()};

Filter made() {
  Flow flow;
  Filter filter;
  REQUIRE(Flow::make({}, {}, 0.1, {}, flow) == Status::ok);
  Filter::Settings settings;
  settings.keeps_constraints = true;
  REQUIRE(Filter::make(flow, settings, 0, filter) == Status::ok);
  return filter;
}

Filter started() {
  Filter filter = made();
  GuaranteedUpdate<double> update;
  const auto three = directions(3);
  REQUIRE(filter.update({three.data(), three.size(), &rate, nullptr}, update) == Status::ok);
  REQUIRE(update.claim == Claim::unconditional);
  return filter;
}

}  // namespace

TEST_CASE("the only policy is that of settings that say nothing and others are refused") {
  const Flow flow = made().flow();
  Filter filter;
  CHECK(Filter::Settings().policy == Policy::raise);
  for (const Policy policy : {Policy::drop_measurement, Policy::restart, Policy::relaxed, static_cast<Policy>(17)}) {
    Filter::Settings settings;
    settings.policy = policy;
    CHECK(Filter::make(flow, settings, 0, filter) == Status::out_of_range);
  }
}

TEST_CASE("a contradiction is reported and the filter stays as it was") {
  Filter filter = started();
  const Matrix6<double> shape = filter.ellipsoid().shape;
  auto wrong = directions(3);
  wrong[1].body = Vector3d(0, 0.8, 0.6);
  GuaranteedUpdate<double> update;
  CHECK(filter.update({wrong.data(), wrong.size(), &rate, nullptr}, update) == Status::empty_intersection);
  CHECK(update.margin < 0);
  CHECK(update.contradicting == direction_bit(1));
  CHECK(filter.ellipsoid().shape == shape);
  CHECK(filter.claim() == Claim::unconditional);
}

TEST_CASE("where sets are of whole states nothing is known of the rate alone") {
  Filter filter = made();
  GuaranteedUpdate<double> update;
  REQUIRE(filter.update({nullptr, 0, &rate, nullptr}, update) == Status::ok);
  CHECK(update.claim == Claim::none);
  CHECK_FALSE(filter.knows_vector());
  CHECK(filter.lacks() == Lacks::vector);
  // Nor where the attitude is forgotten, which a long time makes of any set.
  filter = started();
  REQUIRE(filter.predict(1e3, {}) == Status::ok);
  CHECK(filter.claim() == Claim::none);
  CHECK_FALSE(filter.knows_vector());
  CHECK(filter.time() == 1e3);
  CHECK(filter.predict(1e3 - 1, {}) == Status::out_of_range);
  const auto three = directions(3);
  REQUIRE(filter.update({three.data(), three.size(), &rate, nullptr}, update) == Status::ok);
  CHECK(update.claim == Claim::unconditional);
}

TEST_CASE("directions start a filter whose rate is bounded and two that contradict each other start nothing") {
  Filter filter = made();
  REQUIRE(filter.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) == Status::ok);
  CHECK(filter.lacks() == Lacks::attitude);
  auto two = directions(2);
  GuaranteedUpdate<double> update;
  REQUIRE(filter.update({two.data(), two.size(), nullptr, nullptr}, update) == Status::ok);
  CHECK(update.claim == Claim::unconditional);
  filter = made();
  two[1].body = Vector3d(0.6, 0.8, 0);
  REQUIRE(filter.update({two.data(), two.size(), nullptr, nullptr}, update) == Status::ok);
  CHECK(update.claim == Claim::none);
}

TEST_CASE("what is not compiled cannot be restored") {
  Filter filter = made();
  const Ellipsoid<double, 3> vector{Vector3d::Zero(), 1e-2 * Matrix3d::Identity()};
  CHECK(filter.resume(nullptr, &vector, {}) == Status::out_of_range);
  const Filter::Set set = started().ellipsoid();
  CHECK(filter.resume(&set, nullptr, Trust(true, 0, 1, 1)) == Status::out_of_range);
  CHECK_FALSE(filter.knows_attitude());
  REQUIRE(filter.resume(&set, nullptr, Trust(false, 3, 0, 1)) == Status::ok);
  CHECK(filter.claim() == Claim::unconditional);
}

TEST_CASE("an attitude is refused as a measurement") {
  Filter filter = started();
  const MeasuredAttitude<double> attitude{Matrix3d::Identity(), 1e-4 * Matrix3d::Identity()};
  GuaranteedUpdate<double> update;
  CHECK(filter.update({nullptr, 0, nullptr, &attitude}, update) == Status::out_of_range);
  CHECK(filter.update({nullptr, 0, &rate, &attitude}, update) == Status::out_of_range);
}

TEST_CASE("without constraints questions are answered by the set alone") {
  const Filter filter = started();
  AttitudeBounds<double> bounds{};
  REQUIRE(filter.bounds(Vector3d::UnitZ(), bounds) == Status::ok);
  CHECK(bounds.angle > 0.005);
  CHECK(bounds.angle < 0.03);
}

TEST_CASE("a gyro's filter estimates the bias") {
  GyroMotionFlow flow;
  REQUIRE(GyroMotionFlow::make({}, GyroMotionFlow::IntervalRate::last_sample, flow) == Status::ok);
  GyroFilter filter;
  GyroFilter::Settings settings;
  REQUIRE(GyroFilter::make(flow, settings, 0, filter) == Status::ok);
  settings.estimates_vector = false;
  CHECK(GyroFilter::make(flow, settings, 0, filter) == Status::out_of_range);
}

TEST_CASE("a flow of first order refuses an unknown torque") {
  PaperFlow flow;
  CHECK(PaperFlow::make({}, {}, 0.1, 2, Matrix3d::Zero(), flow) == Status::ok);
  CHECK(PaperFlow::make({}, {}, 0.1, 2, 1e-8 * Matrix3d::Identity(), flow) == Status::out_of_range);
  CHECK(PaperFlow::make({}, {}, 0.1, 2, -Matrix3d::Identity(), flow) == Status::not_positive_definite);
}

TEST_CASE("directions that are nearly one leave an attitude undetermined where FOAM stands alone") {
  auto near = directions(2);
  MeasuredDirections<double> measured;
  CHECK(MeasuredDirections<double>::make(near.data(), near.size(), measured) == Status::ok);
  near[1] = Direction<double>::within(Vector3d(1, 1e-3, 0), Vector3d(1, 1e-3, 0), 0.01);
  CHECK(MeasuredDirections<double>::make(near.data(), near.size(), measured) == Status::attitude_undetermined);
  CHECK(MeasuredDirections<double>::make(near.data(), near.size(), WahbaMethod::svd, measured) == Status::ok);
}
