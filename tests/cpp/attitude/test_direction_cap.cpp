// Caps: what two have in common is in the third, which is as small as the arc on which their circles meet; turns; contradictions.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <elliptude/attitude/direction_cap.hpp>
#include <limits>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using Long3 = Eigen::Matrix<long double, 3, 1>;
using Cap = DirectionCap<double>;

long double angle_between(const Long3& a, const Long3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

bool holds(const Cap& cap, const Long3& x) {
  return angle_between(cap.center.cast<long double>(), x) <= static_cast<long double>(cap.angle);
}

// A direction at this angle from the center of a cap, toward or away from somewhere.
Long3 at_angle(const Long3& center, const Long3& toward, long double angle) {
  const Long3 across = (toward - toward.dot(center) / center.squaredNorm() * center).normalized();
  return std::cos(angle) * center.normalized() + std::sin(angle) * across;
}

}  // namespace

TEST_CASE("direction cap: what two have in common is in the third, and reaches its edge") {
  Random random(1819);
  double worst = 0;
  int lenses = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const double size = trial % 3 == 0 ? random.uniform(0.1, 1.5) : random.log_uniform(1e-7, 1);
    const Cap first{random.unit_vector<3>(), size};
    const double second_angle = size * random.log_uniform(0.1, 2);
    // The centers are as far apart as lets the circles cut each other, mostly.
    const double apart = std::fabs(size - second_angle) + random.uniform(-0.1, 1) * 2 * std::fmin(size, second_angle);
    const Vector3<double> center = exp(Vector3<double>(std::fmax(apart, 0) * random.unit_vector<3>())) * first.center;
    const Cap second{center.normalized(), std::fmin(second_angle, 3)};
    Cap both{};
    const Status status = intersection(first, second, both);
    const Long3 c1 = first.center.cast<long double>();
    const Long3 c2 = second.center.cast<long double>();
    const long double distance = angle_between(c1, c2);
    CAPTURE(trial);
    if (status == Status::empty_intersection) {
      CHECK(static_cast<double>(distance) > first.angle + second.angle);
      continue;
    }
    REQUIRE(status == Status::ok);
    CHECK(both.angle <= std::fmin(first.angle, second.angle));
    // The points where both circles meet are the farthest of a lens.
    const long double a = std::atan2(std::cos(static_cast<long double>(second.angle)) -
                                         std::cos(static_cast<long double>(first.angle)) * std::cos(distance),
                                     std::cos(static_cast<long double>(first.angle)) * std::sin(distance));
    const long double half = std::acos(std::cos(static_cast<long double>(first.angle)) / std::cos(a));
    // (Cosines of smaller angles have too few digits to compare with.)
    const bool is_lens = a > 0 && a < distance && first.angle < 1.5 && second.angle < 1.5 && std::isfinite(half);
    if (is_lens && half > 1e-3L) {
      ++lenses;
      const Long3 middle = at_angle(c1, c2, a);
      const Long3 corner = at_angle(middle, c1.cross(c2), half);
      CHECK(both.angle >= static_cast<double>(half) * (1 - 1e-9));
      CHECK(both.angle <= static_cast<double>(half) * (1 + 1e-6) + 1e-7 * size);
      CHECK(angle_between(both.center.cast<long double>(), corner) <= both.angle);
    }
    for (int k = 0; k < 60; ++k) {
      const Cap& from = k % 2 == 0 ? first : second;
      const double share = k % 3 == 0 ? 1.0 : random.uniform(0, 1);
      const Long3 x = at_angle(from.center.cast<long double>(), random.unit_vector<3>().cast<long double>(),
                               static_cast<long double>(share * from.angle));
      if (holds(first, x) && holds(second, x)) {
        worst = std::max(worst, static_cast<double>(angle_between(both.center.cast<long double>(), x)) / both.angle);
      }
    }
  }
  MESSAGE("lenses " << lenses << ", farthest common direction by the angle " << worst);
  CHECK(lenses > 500);
  CHECK(worst <= 1);
  CHECK(worst > 0.99);
}

TEST_CASE("direction cap: one inside the other, disjoint ones, ones that say nothing") {
  const Vector3<double> up = Vector3<double>::UnitZ();
  const Vector3<double> near = exp(Vector3<double>(0.1, 0, 0)) * up;
  Cap both{};
  REQUIRE(intersection<double>({up, 0.5}, {near, 0.05}, both) == Status::ok);
  CHECK(both.angle == 0.05);
  CHECK(both.center == near);
  REQUIRE(intersection<double>({up, 4}, {near, 0.05}, both) == Status::ok);
  CHECK(both.angle == 0.05);
  REQUIRE(intersection<double>({up, std::numeric_limits<double>::infinity()}, {near, 0.05}, both) == Status::ok);
  CHECK(both.angle == 0.05);
  CHECK(intersection<double>({up, 0.049}, {near, 0.05}, both) == Status::empty_intersection);
  CHECK(intersection<double>({up, 0.051}, {near, 0.05}, both) == Status::ok);
  // Opposite centers: nothing is gained, and nothing lost.
  REQUIRE(intersection<double>({up, 2}, {Vector3<double>(-up), 1.9}, both) == Status::ok);
  CHECK(both.angle == 1.9);
  // The exact test of large caps: their circles meet where the sum of the angles is the distance.
  const Vector3<double> far = exp(Vector3<double>(2.0, 0, 0)) * up;
  CHECK(intersection<double>({up, 0.9}, {far, 1.09}, both) == Status::empty_intersection);
  CHECK(intersection<double>({up, 0.9}, {far, 1.11}, both) == Status::ok);
}

TEST_CASE("direction cap: nearly opposite centers, caps that nearly touch") {
  Random random(1821);
  double worst = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Long3 c1 = random.unit_vector<3>().cast<long double>().normalized();
    const auto near = static_cast<long double>(random.log_uniform(1e-12, 0.1));
    const auto any = static_cast<long double>(random.uniform(0.1, 3.1));
    const long double apart = trial % 2 == 0 ? 3.14159265358979323846L - near : any;
    const Vector3<double> first = c1.cast<double>().normalized();
    const Vector3<double> second = at_angle(c1, random.unit_vector<3>().cast<long double>(), apart).cast<double>();
    const Long3 truth = random.unit_vector<3>().cast<long double>().normalized();
    const auto reach = [&truth](const Vector3<double>& center) {
      return static_cast<double>(angle_between(center.cast<long double>().normalized(), truth)) * (1 + 1e-14) + 1e-14;
    };
    const Cap one{first, reach(first)};
    const Cap two{second.normalized(), reach(second)};
    Cap both{};
    CAPTURE(trial);
    REQUIRE(intersection(one, two, both) == Status::ok);
    worst = std::max(worst, static_cast<double>(angle_between(both.center.cast<long double>(), truth)) / both.angle);
  }
  CHECK(worst <= 1);
}

TEST_CASE("direction cap: exactly opposite centers have a direction in common from a right angle on") {
  const Vector3<double> up = Vector3<double>::UnitZ();
  for (int k = 1; k < 60; ++k) {
    const double angle = 0.025 * k;
    Cap both{};
    CAPTURE(angle);
    // With equal angles the vector between the centers may be exactly zero, and points nowhere.
    CHECK(intersection<double>({up, angle}, {-up, angle}, both) == Status::empty_intersection);
    CHECK(intersection<double>({up, angle}, {-up, 1.5 - angle}, both) == Status::empty_intersection);
    CHECK(intersection<double>({up, 1.6 + angle}, {-up, 1.6 + angle}, both) == Status::ok);
    CHECK(both.angle >= 1.6);
  }
}

TEST_CASE("direction cap: a turn takes the direction along, an unknown turn widens the cap by its angle") {
  Random random(20);
  double worst = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const Cap before{random.unit_vector<3>(), random.log_uniform(1e-6, 1)};
    const Matrix3<double> turn = random.rotation();
    const double angle = random.log_uniform(1e-6, 1);
    const Cap after = turned(before, turn, angle);
    const Long3 x = at_angle(before.center.cast<long double>(), random.unit_vector<3>().cast<long double>(),
                             static_cast<long double>(before.angle));
    // A direction d at rest is Cᵀd in the body: it turns the other way.
    const Matrix3<double> more = exp(Vector3<double>(angle * random.unit_vector<3>()));
    const Long3 y =
        (trial % 2 == 0 ? Matrix3<double>(turn * more) : Matrix3<double>(more * turn)).transpose().cast<long double>() *
        x;
    worst = std::max(worst, static_cast<double>(angle_between(after.center.cast<long double>(), y)) / after.angle);
  }
  CHECK(worst <= 1);
  CHECK(worst > 0.99);
}

TEST_CASE("direction cap: input that is none") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(validate(Cap{Vector3<double>(0, nan, 1), 1}) == Status::not_finite);
  CHECK(validate(Cap{Vector3<double>::UnitZ(), nan}) == Status::not_finite);
  CHECK(validate(Cap{Vector3<double>::Zero(), 1}) == Status::zero_direction);
  CHECK(validate(Cap{Vector3<double>::UnitZ(), -1}) == Status::out_of_range);
  CHECK(validate(Cap{Vector3<double>::UnitZ(), std::numeric_limits<double>::infinity()}) == Status::ok);
}
