/// Filters as flight software holds them: in static memory, before `make` has been called, and copied as a whole.

#include <doctest/doctest.h>

#include <elliptude/elliptude.hpp>
#include <new>
#include <type_traits>

using namespace elliptude;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Free = FreeBody<double>;
using PaperFilter = AttitudeFilter<RigidBodyFlow<double, Free>, PaperEstimator>;
using PaperGyroFilter = AttitudeFilter<GyroFlow<double>, PaperEstimator>;
using BodyFilter = GuaranteedFilter<GuaranteedRigidBodyFlow<double, Free>>;
using GyroFilter = GuaranteedFilter<GuaranteedGyroFlow<double>>;

// Nothing is owned, and memory may be reused without a destructor. (Eigen 3.4's matrices have a copy constructor of their own, so that
// nothing that holds one is trivially copyable by the letter.)
static_assert(std::is_trivially_destructible_v<PaperFilter> && std::is_trivially_destructible_v<PaperGyroFilter>);
static_assert(std::is_trivially_destructible_v<BodyFilter> && std::is_trivially_destructible_v<GyroFilter>);

const std::array<Direction<double>, 3> axes{Direction<double>::within({1, 0, 0}, {1, 0, 0}, 0.01),
                                            Direction<double>::within({0, 1, 0}, {0, 1, 0}, 0.01),
                                            Direction<double>::within({0, 0, 1}, {0, 0, 1}, 0.01)};
const AngularVelocity<double> rate{Vector3d(0.1, 0, 0), 1e-4 * Matrix3d::Identity()};

/// A filter in memory that held something else.
template <typename Filter>
struct Unmade {
  explicit Unmade(unsigned char before = 0x5A) {  // as a double about 1e126
    for (unsigned char& byte : memory) {
      byte = before;
    }
    filter = new (memory) Filter;
  }
  alignas(Filter) unsigned char memory[sizeof(Filter)];
  Filter* filter;
};

}  // namespace

TEST_CASE("a filter of first order that was not made refuses everything") {
  Unmade<PaperFilter> body;
  Update<double> update{};
  CHECK(body.filter->time() == 0);
  CHECK(body.filter->predict(1.0, {}) != Status::ok);
  CHECK(body.filter->predict(0.0, {}) != Status::ok);
  CHECK(body.filter->update(axes.data(), axes.size(), rate, update) != Status::ok);
  CHECK(body.filter->update(axes.data(), 1, update) != Status::ok);
  CHECK(body.filter->time() == 0);
  Unmade<PaperGyroFilter> gyro;
  CHECK(gyro.filter->predict(1.0, {Vector3d(0, 0, 0)}) != Status::ok);
  CHECK(gyro.filter->update(axes.data(), axes.size(), update) != Status::ok);
}

TEST_CASE("a guaranteed filter that was not made knows nothing and cannot predict what it is told") {
  Unmade<BodyFilter> body;
  GuaranteedUpdate<double> update;
  CHECK(body.filter->time() == 0);
  CHECK(body.filter->claim() == Claim::none);
  CHECK(!body.filter->knows_attitude());
  CHECK(!body.filter->knows_vector());
  CHECK(body.filter->lacks() == Lacks::vector);
  AttitudeBounds<double> bounds{};
  CHECK(body.filter->bounds(Vector3d::UnitZ(), bounds) == Status::unbounded);
  REQUIRE(body.filter->update({axes.data(), axes.size(), &rate, nullptr}, update) == Status::ok);
  CHECK(update.claim == Claim::unconditional);
  CHECK(body.filter->lacks() == Lacks::nothing);
  CHECK(body.filter->predict(1.0, {}) == Status::too_many_steps);
  CHECK(body.filter->time() == 0);

  Unmade<GyroFilter> gyro;
  const double width = 0.01;
  REQUIRE(gyro.filter->update({axes.data(), axes.size(), nullptr, nullptr}, update) == Status::ok);
  CHECK(!gyro.filter->knows_attitude());  // stars alone say nothing of the bias
  CHECK(gyro.filter->lacks() == Lacks::vector);
  REQUIRE(gyro.filter->bound_vector({Vector3d::Zero(), width * width * Matrix3d::Identity()}) == Status::ok);
  REQUIRE(gyro.filter->update({axes.data(), axes.size(), nullptr, nullptr}, update) == Status::ok);
  REQUIRE(gyro.filter->knows_attitude());
  GuaranteedGyroFlow<double>::Input input;
  input.angular_velocity = Vector3d(0.1, 0, 0);
  REQUIRE(gyro.filter->predict(1.0, input) == Status::ok);
  CHECK(!gyro.filter->knows_attitude());  // no rate is bounded: the attitude is forgotten
  CHECK(!gyro.filter->knows_vector());    // nor is the drift: the bias, but for its bound, is too
  CHECK(gyro.filter->claim() == Claim::none);
  CHECK(gyro.filter->lacks() == Lacks::attitude);
  REQUIRE(gyro.filter->update({axes.data(), axes.size(), nullptr, nullptr}, update) == Status::ok);
  REQUIRE(gyro.filter->predict_turn(2.0, Vector3d(0.1, 0, 0), 0.01) == Status::ok);
  CHECK(!gyro.filter->knows_attitude());
  CHECK(!gyro.filter->knows_vector());
}

TEST_CASE("a guaranteed filter that was not made does not carry a vector on, and nothing is predicted to any time") {
  Unmade<BodyFilter> body;
  GuaranteedUpdate<double> update;
  CHECK(body.filter->predict(2.0, {}) == Status::ok);
  CHECK(body.filter->time() == 2);
  REQUIRE(body.filter->update({nullptr, 0, &rate, nullptr}, update) == Status::ok);
  REQUIRE(body.filter->knows_vector());
  CHECK(body.filter->predict(3.0, {}) == Status::too_many_steps);
  CHECK(body.filter->time() == 2);
}

TEST_CASE("a filter of one direction that was not made knows nothing") {
  for (const int before : {0x00, 0x5A}) {
    const Unmade<DirectionFilter<double>> unmade(static_cast<unsigned char>(before));
    CHECK(!unmade.filter->knows_direction());
    CHECK(unmade.filter->claim() == Claim::none);
    CHECK(validate(unmade.filter->cap()) == Status::ok);
    CHECK(unmade.filter->predict_turn(Vector3d(0.1, 0, 0), 0.01) == Status::ok);
    CHECK(!unmade.filter->knows_direction());
  }
}

TEST_CASE("bounds that were not asked for say nothing, and a rate that was not given is no number") {
  const Unmade<AttitudeBounds<double>> bounds;
  CHECK(bounds.filter->tilt == scalar::pi<double>());
  CHECK(bounds.filter->heading() == scalar::pi<double>());
  CHECK(bounds.filter->angle == scalar::pi<double>());
  const Unmade<GyroFlow<double>::Input> input;
  CHECK(input.filter->angular_velocity.array().isNaN().all());
}
