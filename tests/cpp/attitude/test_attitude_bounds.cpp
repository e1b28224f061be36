// Bounds of tilt, heading and angle: no attitude that satisfies the constraints is farther off, judged by vectors and quaternions in
// long double, and the farthest that a search finds is nearly as far.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <elliptude/attitude/attitude_bounds.hpp>
#include <elliptude/attitude/chart.hpp>
#include <elliptude/measurement/quadrics.hpp>
#include <vector>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using Long3 = Eigen::Matrix<long double, 3, 1>;
using LongMatrix3 = Eigen::Matrix<long double, 3, 3>;
using LongQuaternion = Eigen::Quaternion<long double>;

// Three questions about the turn from the center's attitude to another, which a quaternion in body axes is.
struct Answers {
  long double tilt = 0;
  long double heading = 0;
  long double angle = 0;
};

Answers answers_of(const LongQuaternion& error, const Long3& vertical) {
  Answers result;
  // The vertical as seen from both attitudes.
  const Long3 seen = error.conjugate() * vertical;
  result.tilt = std::atan2(seen.cross(vertical).norm(), seen.dot(vertical));
  // The shortest turn that takes one vertical to the other leaves a turn about it.
  const LongQuaternion rest = error * LongQuaternion::FromTwoVectors(vertical, seen);
  result.heading = 2 * std::atan2(std::abs(rest.vec().dot(vertical)), std::abs(rest.w()));
  result.angle = 2 * std::atan2(error.vec().norm(), std::abs(error.w()));
  return result;
}

LongQuaternion quaternion_of(const Long3& gamma) {
  LongQuaternion q;
  q.w() = 1;
  q.vec() = gamma / 2;
  return q.normalized();
}

// A set about a center and directions measured within angles, all of which hold for some attitude.
struct Scene {
  Matrix3<double> center;
  Ellipsoid<double, 3> set;
  std::vector<Direction<double>> directions;
  std::vector<double> angles;
  std::vector<Quadric<double, 3>> quadrics;
  Long3 vertical;  // in body axes at the center
  Long3 inside;    // γ of an attitude that satisfies all

  [[nodiscard]] bool holds(const Long3& gamma) const {
    const LongMatrix3 shape = set.shape.cast<long double>();
    if (gamma.dot(Eigen::LLT<LongMatrix3>(shape).solve(gamma)) > 1) {
      return false;
    }
    const LongMatrix3 attitude = center.cast<long double>() * quaternion_of(gamma).toRotationMatrix();
    for (std::size_t i = 0; i < directions.size(); ++i) {
      const Long3 seen = attitude.transpose() * directions[i].reference.cast<long double>().normalized();
      const Long3 body = directions[i].body.cast<long double>().normalized();
      if (std::atan2(seen.cross(body).norm(), seen.dot(body)) > static_cast<long double>(angles[i])) {
        return false;
      }
    }
    return true;
  }
};

Scene make_scene(Random& random, double size, double stretch, int directions) {
  Scene scene;
  scene.center = random.rotation();
  scene.set.center.setZero();
  scene.set.shape = size * size * random.positive_definite<3>(stretch);
  const Matrix3<double> factor = scene.set.shape.llt().matrixL();
  scene.inside = (0.9 * factor * random.in_ball<3>()).cast<long double>();
  const LongMatrix3 truth = scene.center.cast<long double>() * quaternion_of(scene.inside).toRotationMatrix();
  for (int i = 0; i < directions; ++i) {
    const double angle = size * random.log_uniform(0.1, 2);
    const Vector3<double> reference = random.unit_vector<3>();
    const Vector3<double> seen = (truth.transpose() * reference.cast<long double>()).cast<double>();
    const Vector3<double> body = exp(Vector3<double>(0.95 * angle * random.in_ball<3>())) * seen;
    scene.directions.push_back(Direction<double>::within(reference, body, angle));
    scene.angles.push_back(angle);
    Quadric<double, 3> quadric;
    REQUIRE(cone(scene.center, scene.directions.back(), quadric) == Status::ok);
    scene.quadrics.push_back(quadric);
  }
  scene.vertical = (scene.center.transpose() * Vector3<double>::UnitZ()).cast<long double>().normalized();
  return scene;
}

// The largest answer that a random walk finds, which takes what is larger and halves its steps where it finds nothing.
template <typename Question>
long double farthest(Random& random, const Scene& scene, const Question& question) {
  const Matrix3<double> factor = scene.set.shape.llt().matrixL();
  long double best = 0;
  for (int start = 0; start < 6; ++start) {
    Long3 at = scene.inside;
    long double value = question(answers_of(quaternion_of(at), scene.vertical));
    long double step = 0.5L;
    for (int k = 0; k < 1500 && step > 1e-5L; ++k) {
      const Long3 next = at + step * (factor * random.normal_matrix<3>()).cast<long double>();
      const long double there = question(answers_of(quaternion_of(next), scene.vertical));
      if (there > value && scene.holds(next)) {
        at = next;
        value = there;
        step *= 1.5L;
      } else {
        step *= 0.95L;
      }
    }
    best = std::max(best, value);
  }
  return best;
}

}  // namespace

TEST_CASE("attitude bounds: no attitude is farther off, and some is nearly as far") {
  Random random(1611);
  double worst = 0;
  double total = 0;
  double largest = 0;
  int count = 0;
  for (int trial = 0; trial < 240; ++trial) {
    const int directions = trial % 4;
    const double size = trial % 3 == 0 ? random.log_uniform(1e-6, 1e-3) : random.log_uniform(1e-3, 2);
    const Scene scene = make_scene(random, size, trial % 5 == 0 ? 1e4 : 30, directions);
    AttitudeBounds<double> bounds{};
    REQUIRE(attitude_bounds(scene.set, scene.quadrics.data(), scene.quadrics.size(),
                            Vector3<double>(scene.vertical.cast<double>()), bounds) == Status::ok);
    const auto compare = [&](const auto& question, double bound) {
      const auto found = static_cast<double>(farthest(random, scene, question));
      worst = std::max(worst, found / bound);
      total += bound / found;
      largest = std::max(largest, bound / found);
      ++count;
    };
    CAPTURE(trial);
    compare([](const Answers& a) { return a.tilt; }, bounds.tilt);
    compare([](const Answers& a) { return a.heading; }, bounds.heading());
    CHECK(farthest(random, scene, [](const Answers& a) { return a.angle; }) <= bounds.angle);
    const double both = 2 * std::acos(std::cos(bounds.tilt / 2) * std::cos(bounds.heading() / 2));
    CHECK(bounds.angle == doctest::Approx(both).epsilon(1e-6));
  }
  MESSAGE("found / bound at most " << worst << "; bound / found in the mean " << total / count << ", at most "
                                   << largest);
  CHECK(worst <= 1);
  CHECK(total / count < 1.03);
}

TEST_CASE("attitude bounds: a heading's sides are those of the turn from the center to the truth") {
  // North is measured 0.2 rad off the center's, to 0.05: the truth is turned about the vertical by as much, in the sense of C.
  const Vector3<double> vertical = Vector3<double>::UnitZ();
  const Matrix3<double> center = Matrix3<double>::Identity();
  const Matrix3<double> truth = exp(Vector3<double>(0, 0, 0.2));
  const Ellipsoid<double, 3> set{Vector3<double>::Zero(), 0.25 * Matrix3<double>::Identity()};
  std::array<Quadric<double, 3>, 2> quadrics;
  const auto measured = [&](const Vector3<double>& reference, double angle, Quadric<double, 3>& quadric) {
    const Vector3<double> body = truth.transpose() * reference;
    REQUIRE(cone(center, Direction<double>::within(reference, body, angle), quadric) == Status::ok);
  };
  measured(vertical, 1e-3, quadrics[0]);
  measured(Vector3<double>::UnitX(), 0.05, quadrics[1]);
  AttitudeBounds<double> bounds{};
  REQUIRE(attitude_bounds(set, quadrics.data(), 2, vertical, bounds) == Status::ok);
  CHECK(bounds.heading_from == doctest::Approx(0.15).epsilon(0.01));
  CHECK(bounds.heading_to == doctest::Approx(0.25).epsilon(0.01));
  CHECK(bounds.heading() == bounds.heading_to);
}

TEST_CASE("attitude bounds: a set alone, in closed form") {
  Random random(3);
  for (int trial = 0; trial < 50; ++trial) {
    const double width = random.log_uniform(1e-8, 3);
    const double across = random.log_uniform(1e-8, 3);
    const Vector3<double> vertical = random.unit_vector<3>();
    const Matrix3<double> along = vertical * vertical.transpose();
    const Ellipsoid<double, 3> set{Vector3<double>::Zero(),
                                   width * width * along + across * across * (Matrix3<double>::Identity() - along)};
    AttitudeBounds<double> bounds{};
    REQUIRE(attitude_bounds<double>(set, nullptr, 0, vertical, bounds) == Status::ok);
    // The ends of the semi-axes: |γ·n| = width, and |γ⊥| = across with γ·n = 0.
    CAPTURE(width);
    CAPTURE(across);
    const double heading = 2 * std::atan(width / 2);
    const double tilt = 2 * std::atan(across / 2);
    // A form that is thin in one direction is as sharp as rounding leaves it.
    CHECK(bounds.heading() >= heading);
    CHECK(bounds.heading() <= 1.01 * heading + 3e-7 * across);
    CHECK(bounds.tilt >= tilt);
    CHECK(bounds.tilt <= 1.01 * tilt + 3e-7 * width);
  }
}

TEST_CASE("attitude bounds: sets thin in tilt and long about a vertical next to a body axis") {
  for (const long double thin : {1e-9L, 1e-8L, 1e-7L, 1e-6L, 1e-4L}) {
    for (const double slope : {0.3, 1.0, 3.0}) {
      const Vector3<double> n = Vector3<double>(slope * static_cast<double>(thin), 0, 1).normalized();
      const Long3 widths(thin, thin, 2);
      const Ellipsoid<double, 3> set{Vector3<double>::Zero(), widths.cwiseAbs2().cast<double>().asDiagonal()};
      AttitudeBounds<double> bounds{};
      REQUIRE(attitude_bounds<double>(set, nullptr, 0, n, bounds) == Status::ok);
      for (int k = 0; k <= 1000; ++k) {
        const long double t = 3.14159265358979323846L * k / 1000;
        const Long3 gamma(0.999999999L * widths(0) * std::cos(t), 0, 0.999999999L * widths(2) * std::sin(t));
        CAPTURE(static_cast<double>(thin));
        CAPTURE(slope);
        CHECK(answers_of(quaternion_of(gamma), n.cast<long double>().normalized()).tilt <=
              static_cast<long double>(bounds.tilt));
      }
    }
  }
}

TEST_CASE("attitude bounds: a measured vertical bounds the tilt whatever the set says") {
  Random random(4);
  for (const double angle : {1e-3, 0.05, 0.5}) {
    const Matrix3<double> center = random.rotation();
    const Vector3<double> vertical = center.transpose() * Vector3<double>::UnitZ();
    const auto direction = Direction<double>::within(Vector3<double>::UnitZ(), vertical, angle);
    Quadric<double, 3> quadric;
    REQUIRE(cone(center, direction, quadric) == Status::ok);
    const Ellipsoid<double, 3> set{Vector3<double>::Zero(), 9 * Matrix3<double>::Identity()};
    AttitudeBounds<double> bounds{};
    REQUIRE(attitude_bounds(set, &quadric, 1, vertical, bounds) == Status::ok);
    CAPTURE(angle);
    CHECK(bounds.tilt >= angle);
    CHECK(bounds.tilt <= 1.02 * angle);
    CHECK(bounds.heading() >= 2 * std::atan(1.5));
    CHECK(bounds.heading() <= 1.01 * 2 * std::atan(1.5));
  }
}

TEST_CASE("attitude bounds: quadrics with no common attitude are said to be empty") {
  const Vector3<double> vertical = Vector3<double>::UnitZ();
  const Matrix3<double> shape = 0.01 * 0.01 * Matrix3<double>::Identity();
  const Direction<double> direction{vertical, exp(Vector3<double>(0.5, 0, 0)) * vertical, shape, 1};
  Quadric<double, 3> quadric;
  REQUIRE(cone(Matrix3<double>(Matrix3<double>::Identity()), direction, quadric) == Status::ok);
  const Ellipsoid<double, 3> set{Vector3<double>::Zero(), shape};
  AttitudeBounds<double> bounds{-1, -1, -1, -1};
  CHECK(attitude_bounds(set, &quadric, 1, vertical, bounds) == Status::empty_intersection);
  CHECK(bounds.tilt == -1);
}

TEST_CASE("attitude bounds: float, and input that is none") {
  Random random(5);
  for (int trial = 0; trial < 30; ++trial) {
    const Scene scene = make_scene(random, random.log_uniform(1e-3, 1), 30, trial % 3);
    std::vector<Quadric<float, 3>> quadrics;
    for (const Direction<double>& d : scene.directions) {
      const Direction<float> direction{d.reference.cast<float>(), d.body.cast<float>(), d.bound.cast<float>(), 1};
      quadrics.emplace_back();
      REQUIRE(cone(Matrix3<float>(scene.center.cast<float>()), direction, quadrics.back()) == Status::ok);
    }
    AttitudeBounds<float> bounds{};
    AttitudeBounds<double> precise{};
    const Vector3<double> vertical = scene.vertical.cast<double>();
    REQUIRE(attitude_bounds(scene.set, scene.quadrics.data(), scene.quadrics.size(), vertical, precise) == Status::ok);
    REQUIRE(attitude_bounds(Ellipsoid<float, 3>{Vector3<float>::Zero(), scene.set.shape.cast<float>()}, quadrics.data(),
                            quadrics.size(), Vector3<float>(vertical.cast<float>()), bounds) == Status::ok);
    CHECK(bounds.heading() >= 0.98 * precise.heading());
    CHECK(bounds.heading() <= 1.02 * precise.heading() + 1e-3);
    CHECK(bounds.tilt <= 1.02 * precise.tilt + 1e-3);
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  AttitudeBounds<double> bounds{-1, -1, -1, -1};
  const Vector3<double> vertical = Vector3<double>::UnitZ();
  const Matrix3<double> one = Matrix3<double>::Identity();
  Quadric<double, 3> quadric{one, Vector3<double>(nan, 0, 0), 1};
  CHECK(attitude_bounds<double>({Vector3<double>::Zero(), nan * one}, nullptr, 0, vertical, bounds) != Status::ok);
  CHECK(attitude_bounds<double>({Vector3<double>::Zero(), -one}, nullptr, 0, vertical, bounds) != Status::ok);
  // A quadric that cannot be read says nothing.
  CHECK(attitude_bounds<double>({Vector3<double>::Zero(), one}, &quadric, 1, vertical, bounds) == Status::ok);
  CHECK(bounds.heading() >= 2 * std::atan(0.5));
}
