/// Limits as a small processor's program sets them: what fits is used, and more is refused.

#define ELLIPTUDE_MOST_DIRECTIONS 4
#define ELLIPTUDE_MOST_QUADRICS 8
#define ELLIPTUDE_MOST_QUESTIONED 1
#define ELLIPTUDE_MOST_WRONG 0
#define ELLIPTUDE_ONLY_VOLUME 1
#define ELLIPTUDE_MOST_STEPS 20

#include <doctest/doctest.h>

#include <elliptude/elliptude.hpp>
#include <vector>

using namespace elliptude;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Flow = GuaranteedRigidBodyFlow<double, FreeBody<double>>;
using Filter = GuaranteedFilter<Flow>;
using PaperFlow = RigidBodyFlow<double, FreeBody<double>>;
using PaperFilter = AttitudeFilter<PaperFlow, PaperEstimator>;

/// The axes of the reference, again and again, each seen without error.
std::vector<Direction<double>> directions(std::size_t count) {
  std::vector<Direction<double>> result;
  for (std::size_t i = 0; i < count; ++i) {
    const Vector3d axis = Vector3d::Unit(static_cast<int>(i % 3));
    result.push_back(Direction<double>::within(axis, axis, 0.01));
  }
  return result;
}

const AngularVelocity<double> rate{Vector3d::Zero(), 1e-4 * Matrix3d::Identity()};
const MeasuredAttitude<double> attitude{Matrix3d::Identity(), 1e-4 * Matrix3d::Identity()};

Filter guaranteed() {
  Flow flow;
  Filter filter;
  REQUIRE(Flow::make({}, {}, 0.1, {}, flow) == Status::ok);
  Filter::Settings settings;
  settings.keeps_constraints = true;
  REQUIRE(Filter::make(flow, settings, 0, filter) == Status::ok);
  REQUIRE(filter.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) == Status::ok);
  return filter;
}

}  // namespace

TEST_CASE("a guaranteed filter takes as many measurements as its limits allow and refuses more") {
  Filter filter = guaranteed();
  GuaranteedUpdate<double> update;
  const auto four = directions(4);
  const auto five = directions(5);
  // With the bound of the vector and what is known of it these are eight quadrics.
  const Ellipsoid<double, 3> vector{Vector3d::Zero(), 1e-2 * Matrix3d::Identity()};
  REQUIRE(filter.resume(nullptr, &vector, {}) == Status::ok);
  REQUIRE(filter.update({four.data(), four.size(), &rate, &attitude}, update) == Status::ok);
  CHECK(update.claim == Claim::unconditional);
  const Matrix6<double> shape = filter.ellipsoid().shape;
  CHECK(filter.update({five.data(), five.size(), &rate, &attitude}, update) == Status::out_of_range);
  CHECK(filter.ellipsoid().shape == shape);
  // One constraint counts for a question, where six were kept at most.
  AttitudeBounds<double> bounds{};
  REQUIRE(filter.bounds(Vector3d::UnitZ(), bounds) == Status::ok);
  CHECK(bounds.angle > 0);
  CHECK(bounds.angle < 0.03);
  // The bits of sensors are the same for all limits.
  CHECK(angular_velocity_bit == Sensors(1) << 32);
}

TEST_CASE("nine quadrics are refused where eight fit") {
  const Ellipsoid<double, 3> ball{Vector3d::Zero(), Matrix3d::Identity()};
  Quadric<double, 3> quadric;
  REQUIRE(to_quadric(ball, quadric) == Status::ok);
  const std::vector<Quadric<double, 3>> quadrics(9, quadric);
  QuadricFusion<double, 3> fusion;
  const auto criterion = SizeCriterion<double, 3>::volume();
  CHECK(minimal_intersection(&ball, quadrics.data(), 8, criterion, fusion) == Status::ok);
  CHECK(minimal_intersection(&ball, quadrics.data(), 9, criterion, fusion) == Status::out_of_range);
}

TEST_CASE("a filter of first order refuses more directions than its limit") {
  const auto four = directions(4);
  const auto five = directions(5);
  PaperFlow flow;
  PaperFilter filter;
  REQUIRE(PaperFlow::make({}, {}, 0.1, 2, Matrix3d::Zero(), flow) == Status::ok);
  const StateEllipsoid<RigidBodyState<double>> start{{Matrix3d::Identity(), Vector3d::Zero()},
                                                     0.01 * Matrix6<double>::Identity()};
  REQUIRE(PaperFilter::make(flow, SizeCriterion<double, 6>::volume(), 0, start, filter) == Status::ok);
  Update<double> update{};
  CHECK(filter.update(five.data(), five.size(), rate, update) == Status::out_of_range);
  CHECK(filter.update(four.data(), four.size(), rate, update) == Status::ok);
  DirectionCones<double> cones;
  const Eigen::Matrix<double, 3, 5> axes = Eigen::Matrix<double, 3, 5>::Ones();
  const auto bounds = Eigen::Matrix<double, 5, 1>::Constant(0.01);
  CHECK(DirectionCones<double>::make(axes, axes, bounds, cones) == Status::out_of_range);
}

TEST_CASE("more steps than the limit are refused unless a flow is told otherwise") {
  Filter filter = guaranteed();
  GuaranteedUpdate<double> update;
  const auto three = directions(3);
  REQUIRE(filter.update({three.data(), three.size(), &rate, nullptr}, update) == Status::ok);
  CHECK(filter.predict(2.1, {}) == Status::too_many_steps);
  CHECK(filter.predict(2.0, {}) == Status::ok);
}

TEST_CASE("where no measurement may be wrong, a filter that lets one be is not made") {
  Flow flow;
  REQUIRE(Flow::make({}, {}, 0.1, {}, flow) == Status::ok);
  Filter::Settings settings;
  settings.policy = Policy::relaxed;
  Filter filter;
  REQUIRE(Filter::make(flow, settings, 0, filter) == Status::ok);
  settings.most_wrong = 1;
  CHECK(Filter::make(flow, settings, 0, filter) == Status::out_of_range);
}

TEST_CASE("where searches know the volume alone a trace is refused by all that search") {
  const auto trace = SizeCriterion<double, 6>::trace();
  CHECK(validate(trace) == Status::out_of_range);
  CHECK(validate(SizeCriterion<double, 6>::volume()) == Status::ok);
  Flow flow;
  REQUIRE(Flow::make({}, {}, 0.1, {}, flow) == Status::ok);
  Filter filter;
  Filter::Settings settings;
  settings.criterion = trace;
  CHECK(Filter::make(flow, settings, 0, filter) == Status::out_of_range);
  PaperFlow paper_flow;
  PaperFilter paper;
  REQUIRE(PaperFlow::make({}, {}, 0.1, 2, Matrix3d::Zero(), paper_flow) == Status::ok);
  const StateEllipsoid<RigidBodyState<double>> start{{Matrix3d::Identity(), Vector3d::Zero()},
                                                     0.01 * Matrix6<double>::Identity()};
  CHECK(PaperFilter::make(paper_flow, trace, 0, start, paper) == Status::out_of_range);
  const Ellipsoid<double, 6> ball{Vector<double, 6>::Zero(), Matrix6<double>::Identity()};
  Intersection<double, 6> smallest;
  CHECK(minimal_intersection(ball, ball, trace, smallest) == Status::out_of_range);
}

TEST_CASE("sums know both criteria, as filters of first order sum attitudes by trace") {
  const std::array<Ellipsoid<double, 3>, 2> terms{
      {{Vector3d::Zero(), Matrix3d::Identity()}, {Vector3d::Zero(), 4 * Matrix3d::Identity()}}};
  Ellipsoid<double, 3> sum;
  REQUIRE(minimal_sum(terms.data(), terms.size(), SizeCriterion<double, 3>::trace(), sum) == Status::ok);
  CHECK(sum.shape(0, 0) == doctest::Approx(9));
}
