// A guaranteed filter's bounds of tilt and heading: the truth is within them, they are sharper than the set while its measurements
// are at hand, and those of the set after a prediction.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>
#include <vector>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using Flow = GuaranteedGyroFlow<double>;
using Filter = GuaranteedFilter<Flow>;

Filter filter_of(bool keeps_constraints, SizeCriterion<double, 6> criterion, Policy policy = Policy::raise) {
  Flow flow;
  REQUIRE(Flow::make({}, Flow::IntervalRate::mean_of_ends, flow) == Status::ok);
  Filter::Settings settings;
  settings.criterion = criterion;
  settings.policy = policy;
  settings.estimates_vector = false;
  settings.keeps_constraints = keeps_constraints;
  Filter filter;
  REQUIRE(Filter::make(flow, settings, 0, filter) == Status::ok);
  REQUIRE(filter.bound_vector({Vector3<double>::Zero(), 1e-18 * Matrix3<double>::Identity()}) == Status::ok);
  return filter;
}

// A body that turns by known turns with an error, and sees up and one more direction with errors of their own.
class Body {
 public:
  explicit Body(std::uint64_t seed) : random_(seed), attitude_(random_.rotation()) {}

  void turn(std::vector<Filter*> filters, double angle) {
    const Vector3<double> known = random_.log_uniform(0.01, 1) * random_.unit_vector<3>();
    attitude_ = attitude_ * exp(known) * exp(Vector3<double>(angle * random_.in_ball<3>()));
    time_ += 1;
    for (Filter* filter : filters) {
      REQUIRE(filter->predict_turn(time_, known, angle) == Status::ok);
    }
  }

  [[nodiscard]] Direction<double> measured(const Vector3<double>& reference, double angle) {
    const Vector3<double> body =
        exp(Vector3<double>(0.99 * angle * random_.in_ball<3>())) * attitude_.transpose() * reference;
    return Direction<double>::within(reference, body, angle);
  }

  // Tilt and heading of the truth as seen from an estimate, by the swing and the twist of their difference.
  [[nodiscard]] std::pair<double, double> tilt_and_heading(const Matrix3<double>& estimate) const {
    const Vector3<double> vertical = Vector3<double>::UnitZ();
    const Vector3<double> up = attitude_.transpose() * vertical;
    const Vector3<double> estimated = estimate.transpose() * vertical;
    const Eigen::Quaterniond twist(Matrix3<double>(attitude_ * estimate.transpose()));
    double heading = 2 * std::atan2(twist.z(), twist.w());
    heading -= std::round(heading / (2 * scalar::pi<double>())) * 2 * scalar::pi<double>();
    return {std::atan2(up.cross(estimated).norm(), up.dot(estimated)), heading};
  }

  Random& random() { return random_; }
  [[nodiscard]] const Matrix3<double>& attitude() const { return attitude_; }

 private:
  Random random_;
  Matrix3<double> attitude_;
  double time_ = 0;
};

AttitudeBounds<double> bounds_of(const Filter& filter) {
  AttitudeBounds<double> bounds{};
  REQUIRE(filter.bounds(Vector3<double>(0, 0, 2), bounds) == Status::ok);
  return bounds;
}

}  // namespace

TEST_CASE("questions: the truth is within every bound, and the bounds are sharper than those of the set") {
  double worst = 0;
  double gain = 0;
  double loss = 0;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Body body(seed);
    const auto criterion = seed % 2 == 0 ? SizeCriterion<double, 6>::volume() : SizeCriterion<double, 6>::trace();
    Filter keeping = filter_of(true, criterion);
    Filter plain = filter_of(false, criterion);
    const double up = body.random().log_uniform(0.01, 0.3);
    const double north = body.random().log_uniform(0.05, 0.8);
    const Vector3<double> field = Vector3<double>(1, 0, body.random().uniform(-1, 1)).normalized();
    for (int k = 0; k < 40; ++k) {
      body.turn({&keeping, &plain}, 0.01);
      const std::array<Direction<double>, 3> directions{body.measured(Vector3<double>::UnitZ(), up),
                                                        body.measured(field, north),
                                                        body.measured(Vector3<double>::UnitY(), north)};
      Measurements<double> measurements;
      measurements.directions = directions.data();
      measurements.direction_count = k % 3 == 0 ? 2 : 3;
      GuaranteedUpdate<double> update;
      REQUIRE(keeping.update(measurements, update) == Status::ok);
      REQUIRE(plain.update(measurements, update) == Status::ok);
      CHECK(keeping.ellipsoid().shape == plain.ellipsoid().shape);
      const AttitudeBounds<double> bounds = bounds_of(keeping);
      const AttitudeBounds<double> of_set = bounds_of(plain);
      const auto [tilt, heading] = body.tilt_and_heading(keeping.ellipsoid().center.attitude);
      CAPTURE(seed);
      CAPTURE(k);
      CHECK(tilt <= bounds.tilt);
      CHECK(heading <= bounds.heading_to);
      CHECK(heading >= bounds.heading_from);
      const Matrix3<double> difference = keeping.ellipsoid().center.attitude.transpose() * body.attitude();
      CHECK(log(difference).norm() <= bounds.angle);
      worst = std::max({worst, tilt / bounds.tilt, heading / (heading > 0 ? bounds.heading_to : bounds.heading_from)});
      gain += bounds.heading() / of_set.heading() + bounds.tilt / of_set.tilt;
      loss = std::max({loss, bounds.heading() / of_set.heading(), bounds.tilt / of_set.tilt});
      count += 2;
      // A prediction leaves only the set.
      AttitudeBounds<double> after{};
      Filter later = keeping;
      REQUIRE(later.predict_turn(later.time() + 1, Vector3<double>::Zero(), 0) == Status::ok);
      REQUIRE(later.bounds(Vector3<double>::UnitZ(), after) == Status::ok);
      CHECK(after.heading() == doctest::Approx(of_set.heading()).epsilon(0.01));
    }
  }
  MESSAGE("truth at most at " << worst << "; bounds by those of the set " << gain / count << ", at most " << loss);
  CHECK(worst <= 1);
  CHECK(gain / count < 0.9);
  CHECK(loss < 1.01);
}

TEST_CASE("questions: what was dropped takes no part, and without an attitude there is no answer") {
  Body body(3);
  Filter filter = filter_of(true, SizeCriterion<double, 6>::volume(), Policy::drop_measurement);
  AttitudeBounds<double> bounds{};
  CHECK(filter.bounds(Vector3<double>::UnitZ(), bounds) == Status::unbounded);
  GuaranteedUpdate<double> update;
  for (int k = 0; k < 30; ++k) {
    body.turn({&filter}, 0.002);
    std::array<Direction<double>, 4> directions{
        body.measured(Vector3<double>::UnitZ(), 0.05), body.measured(Vector3<double>::UnitX(), 0.2),
        body.measured(Vector3<double>(1, 1, 0), 0.2), body.measured(Vector3<double>(0, 1, 1), 0.2)};
    if (k % 5 == 4) {
      directions[0].body = -directions[0].body;
    }
    const Measurements<double> measurements{directions.data(), 4, nullptr, nullptr};
    REQUIRE(filter.update(measurements, update) == Status::ok);
    CHECK(update.dropped == (k % 5 == 4 ? direction_bit(0) : 0));
    const AttitudeBounds<double> found = bounds_of(filter);
    const auto [tilt, heading] = body.tilt_and_heading(filter.ellipsoid().center.attitude);
    CHECK(tilt <= found.tilt);
    CHECK(std::fabs(heading) <= found.heading());
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(filter.bounds(Vector3<double>(0, nan, 1), bounds) == Status::not_finite);
  CHECK(filter.bounds(Vector3<double>::Zero(), bounds) == Status::zero_direction);
  filter.forget();
  CHECK(filter.bounds(Vector3<double>::UnitZ(), bounds) == Status::unbounded);
}
