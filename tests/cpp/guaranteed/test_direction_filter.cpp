// A filter of one direction: the truth is in its cap; lies are dropped, restarted from or reported, and got over; an unknown turn
// forgets.
#include <doctest/doctest.h>

#include <cmath>
#include <elliptude/guaranteed/direction_filter.hpp>
#include <limits>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using Filter = DirectionFilter<double>;
using Cap = DirectionCap<double>;

Filter filter_of(Policy policy, int regain_after = 5) {
  Filter filter;
  REQUIRE(Filter::make({policy, regain_after}, filter) == Status::ok);
  return filter;
}

double angle_between(const Vector3<double>& a, const Vector3<double>& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

// A body that turns, a gyro's turns with errors up to an angle, and measurements of the vertical with errors up to another.
class Motion {
 public:
  explicit Motion(std::uint64_t seed) : random_(seed), attitude_(random_.rotation()) {}

  void turn(Filter& filter, double angle) {
    const Vector3<double> known = random_.log_uniform(0.01, 1) * random_.unit_vector<3>();
    attitude_ = attitude_ * exp(known) * exp(Vector3<double>(angle * random_.unit_vector<3>()));
    REQUIRE(filter.predict_turn(known, angle) == Status::ok);
  }

  [[nodiscard]] Vector3<double> up() const { return attitude_.transpose() * Vector3<double>::UnitZ(); }

  [[nodiscard]] Cap measured(double angle, double share = 0.999) {
    // The error is across the direction, so that it is nearly all of the angle.
    const Vector3<double> across = up().cross(random_.unit_vector<3>()).normalized();
    return {exp(Vector3<double>(share * angle * across)) * up(), angle};
  }

 private:
  Random random_;
  Matrix3<double> attitude_;
};

}  // namespace

TEST_CASE("direction filter: the truth is in the cap, which says no less than the measurement but for its rounding") {
  double worst = 0;
  double together = 0;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Motion motion(seed);
    Filter filter = filter_of(Policy::raise);
    CHECK(filter.claim() == Claim::none);
    for (int k = 0; k < 200; ++k) {
      motion.turn(filter, 0.002);
      if (k % 3 == 0) {
        const double angle = k % 2 == 0 ? 0.05 : 0.02;
        DirectionUpdate update;
        REQUIRE(filter.update(motion.measured(angle), update) == Status::ok);
        CHECK(update.claim == Claim::unconditional);
        CHECK(!update.contradicts);
        CHECK(filter.cap().angle <= normalized(Cap{motion.up(), angle}).angle);
        together += filter.cap().angle / angle;
        ++count;
      }
      worst = std::fmax(worst, angle_between(filter.cap().center, motion.up()) / filter.cap().angle);
    }
  }
  MESSAGE("truth at most at " << worst << " of the angle; cap by measurement " << together / count);
  CHECK(worst <= 1);
  CHECK(worst > 0.98);
  CHECK(together / count < 0.8);
}

TEST_CASE("direction filter: a measured center of any length is turned by rounding as it is normalized") {
  using Long = Vector3<long double>;
  Random random(9);
  const auto angle_between = [](const Long& a, const Long& b) {
    return 2 * std::atan2((a.normalized() - b.normalized()).norm(), (a.normalized() + b.normalized()).norm());
  };
  for (int trial = 0; trial < 2000; ++trial) {
    const auto length = static_cast<float>(random.log_uniform(0.1, 20));
    const Vector3<float> center = length * random.unit_vector<3>().cast<float>();
    const Vector3<float> truth = center / length + 1e-4F * random.unit_vector<3>().cast<float>();
    const long double angle = angle_between(center.cast<long double>(), truth.cast<long double>());
    DirectionFilter<float> filter;
    REQUIRE(DirectionFilter<float>::make({}, filter) == Status::ok);
    DirectionUpdate update;
    // The truth is on the cap's rim.
    const float rim = std::nextafter(static_cast<float>(angle), 4.0F);
    REQUIRE(filter.update({center, rim}, update) == Status::ok);
    CHECK(angle_between(filter.cap().center.cast<long double>(), truth.cast<long double>()) <=
          static_cast<long double>(filter.cap().angle));
  }
}

TEST_CASE("direction filter: a measurement that contradicts is reported, dropped or started from") {
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart}) {
    Motion motion(7);
    Filter filter = filter_of(policy);
    DirectionUpdate update;
    REQUIRE(filter.update(motion.measured(0.02), update) == Status::ok);
    motion.turn(filter, 0.001);
    const Cap before = filter.cap();
    const Cap lie{-motion.up(), 0.02};
    const Status status = filter.update(lie, update);
    if (policy == Policy::raise) {
      CHECK(status == Status::empty_intersection);
      CHECK(filter.cap().center == before.center);
      CHECK(filter.claim() == Claim::unconditional);
      CHECK(update.contradicts);
      CHECK_FALSE(update.dropped);
      CHECK(update.claim == Claim::unconditional);
      continue;
    }
    REQUIRE(status == Status::ok);
    CHECK(update.contradicts);
    CHECK(update.dropped == (policy == Policy::drop_measurement));
    CHECK(update.claim == Claim::conditional);
    const Cap kept = policy == Policy::drop_measurement ? before : normalized(lie);
    CHECK(angle_between(filter.cap().center, kept.center) <= 1e-15);
    CHECK(filter.cap().angle == kept.angle);
    // After `regain_after` updates in agreement the claim is unconditional, with the truth inside.
    for (int k = 0; k < 10; ++k) {
      motion.turn(filter, 0.001);
      REQUIRE(filter.update(motion.measured(0.02), update) == Status::ok);
    }
    CHECK(update.claim == Claim::unconditional);
    CHECK(angle_between(filter.cap().center, motion.up()) <= filter.cap().angle);
  }
}

TEST_CASE("direction filter: a wrong start is got over within twice regain_after updates") {
  for (const Policy policy : {Policy::drop_measurement, Policy::restart}) {
    for (std::uint64_t seed = 1; seed <= 50; ++seed) {
      Motion motion(seed);
      Filter filter = filter_of(policy, 4);
      DirectionUpdate update;
      REQUIRE(filter.update({-motion.up(), 0.01}, update) == Status::ok);  // a lie that nothing contradicts
      for (int k = 0; k < 2 * 4 + 1; ++k) {
        motion.turn(filter, 0.001);
        REQUIRE(filter.update(motion.measured(0.05), update) == Status::ok);
      }
      CHECK(update.claim == Claim::unconditional);
      CHECK(angle_between(filter.cap().center, motion.up()) <= filter.cap().angle);
    }
  }
}

TEST_CASE("direction filter: a measurement that says nothing agrees with nothing") {
  for (const Policy policy : {Policy::drop_measurement, Policy::restart}) {
    Filter filter = filter_of(policy);
    DirectionUpdate update;
    REQUIRE(filter.update({Vector3<double>::UnitX(), 1e-3}, update) == Status::ok);
    REQUIRE(filter.update({Vector3<double>::UnitZ(), 1e-3}, update) == Status::ok);
    CHECK(update.contradicts);
    for (int k = 0; k < 20; ++k) {
      const double angle = k % 2 == 0 ? std::numeric_limits<double>::infinity() : scalar::pi<double>();
      REQUIRE(filter.update({Vector3<double>::UnitZ(), angle}, update) == Status::ok);
      CHECK(update.claim == Claim::conditional);
      CHECK(filter.claim() == Claim::conditional);
    }
  }
}

TEST_CASE("direction filter: a turn that may be any forgets the direction, and bad input changes nothing") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  Filter filter = filter_of(Policy::raise);
  DirectionUpdate update;
  REQUIRE(filter.update({Vector3<double>(0, 0, 5), 0.1}, update) == Status::ok);
  CHECK(filter.cap().center == Vector3<double>::UnitZ());
  const Vector3<double> turn(0.1, 0, 0);
  CHECK(filter.predict_turn(turn, -0.1) == Status::out_of_range);
  CHECK(filter.predict_turn(turn, nan) == Status::not_finite);
  CHECK(filter.predict_turn(Vector3<double>(nan, 0, 0), 0.1) == Status::not_finite);
  CHECK(filter.update({Vector3<double>::Zero(), 0.1}, update) == Status::zero_direction);
  CHECK(filter.update({Vector3<double>::UnitZ(), nan}, update) == Status::not_finite);
  CHECK(filter.cap().angle == normalized(Cap{Vector3<double>::UnitZ(), 0.1}).angle);
  REQUIRE(filter.predict_turn(turn, infinity) == Status::ok);
  CHECK(!filter.knows_direction());
  CHECK(filter.claim() == Claim::none);
  // A measurement that says nothing.
  REQUIRE(filter.update({Vector3<double>::UnitZ(), 4}, update) == Status::ok);
  CHECK(!filter.knows_direction());
  Filter unmade;
  CHECK(Filter::make({Policy::relaxed, 5}, unmade) == Status::out_of_range);
  CHECK(Filter::make({Policy::raise, 0}, unmade) == Status::out_of_range);
}
