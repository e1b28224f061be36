// What an update leaves possible, question by question: every state that satisfies all constraints is within the answers, the farthest
// of them nearly reach them, and where nothing is kept the answers are those of the set.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "support/questioned_scene.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using Constraints = UpdateConstraints<SceneState>;

struct Updated {
  QuestionedScene scene;
  SceneFilter filter;
  Constraints constraints;

  explicit Updated(std::uint64_t seed, SizeCriterion<double, 6> criterion = SizeCriterion<double, 6>::volume())
      : scene(seed) {
    REQUIRE(scene.update(criterion, filter, constraints));
  }

  [[nodiscard]] Vector3<double> error(const Vector6<double>& y) const {
    return gibbs_of(filter.ellipsoid().center.attitude.transpose() * scene.attitude_of(y));
  }
  [[nodiscard]] Vector3<double> rate(const Vector6<double>& y) const {
    return scene.prior().center.angular_velocity + y.tail<3>();
  }
  /// The state that is turned the most about an axis: n·γ⁺/2 = v/w with v and w linear in y, and the state with the largest v - tw has
  /// a larger quotient than t.
  [[nodiscard]] Vector6<double> most_turned(const Vector3<double>& n) const {
    const Vector3<double> g =
        gibbs_of(scene.prior().center.attitude.transpose() * filter.ellipsoid().center.attitude) / 2;
    Vector6<double> y = scene.truth();
    for (int step = 0; step < 4; ++step) {
      const double t = error(y).dot(n) / 2;
      Vector6<double> objective = Vector6<double>::Zero();
      objective.head<3>() = (n - n.cross(g) - t * g) / 2;
      y = scene.farthest(objective);
    }
    return y;
  }
  [[nodiscard]] Vector6<double> fastest(const Vector3<double>& n) const {
    Vector6<double> objective = Vector6<double>::Zero();
    objective.tail<3>() = n;
    return scene.farthest(objective);
  }
};

double turned(const Vector3<double>& gamma, const Vector3<double>& n) { return 2 * std::atan(gamma.dot(n) / 2); }

}  // namespace

TEST_CASE("update constraints: turns and rates hold all states and are nearly reached") {
  double widest = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    Updated updated(seed);
    const Vector3<double> n = updated.scene.random().unit_vector<3>();
    CAPTURE(seed);
    Interval<double> turn{};
    Interval<double> rate{};
    REQUIRE(updated.constraints.turn_about(3 * n, turn) == Status::ok);
    REQUIRE(updated.constraints.vector_along(0.1 * n, rate) == Status::ok);
    const double most = turned(updated.error(updated.most_turned(n)), n);
    const double least = turned(updated.error(updated.most_turned(-n)), n);
    CHECK(most <= turn.most);
    CHECK(least >= turn.least);
    const double fastest = updated.rate(updated.fastest(n)).dot(n);
    const double slowest = updated.rate(updated.fastest(-n)).dot(n);
    CHECK(fastest <= rate.most);
    CHECK(slowest >= rate.least);
    widest =
        std::max({widest, (turn.most - turn.least) / (most - least), (rate.most - rate.least) / (fastest - slowest)});
    // The component of the rotation vector is within the same bounds where these have zero between them.
    const Vector3<double> zeta = log(Matrix3<double>(updated.filter.ellipsoid().center.attitude.transpose() *
                                                     updated.scene.attitude_of(updated.most_turned(n))));
    CHECK((turn.most < 0 || zeta.dot(n) <= turn.most));
  }
  MESSAGE("widest answer by what the constraints leave " << widest);
  CHECK(widest <= 1.03);
}

TEST_CASE("update constraints: the attitude by itself holds all states in less than the filter's set") {
  for (const bool by_volume : {true, false}) {
    double gain = 0;
    const int count = 24;
    for (std::uint64_t seed = 1; seed <= count; ++seed) {
      const auto criterion = by_volume ? SizeCriterion<double, 6>::volume() : SizeCriterion<double, 6>::trace();
      Updated updated(seed, criterion);
      CAPTURE(seed);
      AttitudeSet<double> own;
      REQUIRE(updated.constraints.attitude_set(criterion.of_first<3>(), own) == Status::ok);
      const Matrix3<double> inverse = own.shape.inverse();
      const auto contains_state = [&](const Vector6<double>& y) {
        const Vector3<double> gamma = gibbs_of(own.center.transpose() * updated.scene.attitude_of(y));
        return gamma.dot(inverse * gamma) <= 1 + 1e-12;
      };
      CHECK(contains_state(updated.scene.truth()));
      // Also the states that are farthest along its own axes.
      const Eigen::SelfAdjointEigenSolver<Matrix3<double>> axes(own.shape);
      for (int i = 0; i < 3; ++i) {
        const Matrix3<double> to_center = own.center.transpose() * updated.filter.ellipsoid().center.attitude;
        const Vector3<double> axis = to_center.transpose() * axes.eigenvectors().col(i);
        CHECK(contains_state(updated.most_turned(axis)));
        CHECK(contains_state(updated.most_turned(-axis)));
      }
      const Matrix3<double> present = updated.filter.ellipsoid().shape.topLeftCorner<3, 3>();
      gain += by_volume ? std::pow(own.shape.determinant() / present.determinant(), 1.0 / 6)
                        : std::sqrt(own.shape.trace() / present.trace());
    }
    MESSAGE("radius of the attitude's own set by that of the filter's " << gain / count);
    CHECK(gain / count <= 0.93);
  }
}

TEST_CASE("update constraints: of a set alone the answers are the set's") {
  Updated updated(5);
  const GibbsEllipsoid<SceneState>& set = updated.filter.ellipsoid();
  const Constraints alone = Constraints::of(set, false);
  const Vector3<double> n = Vector3<double>(1, 2, -2) / 3;
  Interval<double> turn{};
  REQUIRE(alone.turn_about(n, turn) == Status::ok);
  const double half = std::sqrt(n.dot(set.shape.topLeftCorner<3, 3>() * n));
  CHECK(turn.most == doctest::Approx(2 * std::atan(half / 2)).epsilon(0.01));
  CHECK(turn.least == doctest::Approx(-turn.most).epsilon(0.01));
  Interval<double> rate{};
  REQUIRE(alone.vector_along(n, rate) == Status::ok);
  const double wide = std::sqrt(n.dot(set.shape.bottomRightCorner<3, 3>() * n));
  CHECK(rate.most == doctest::Approx(n.dot(set.center.angular_velocity) + wide).epsilon(0.01));
  CHECK(rate.least == doctest::Approx(n.dot(set.center.angular_velocity) - wide).epsilon(0.01));
  AttitudeSet<double> own;
  REQUIRE(alone.attitude_set(SizeCriterion<double, 3>::volume(), own) == Status::ok);
  const Matrix3<double> present = set.shape.topLeftCorner<3, 3>();
  CHECK(own.shape.determinant() == doctest::Approx(present.determinant()).epsilon(0.01));
  // Both sets of a product are asked by themselves.
  GibbsEllipsoid<SceneState> product = set;
  product.shape.topRightCorner<3, 3>().setZero();
  product.shape.bottomLeftCorner<3, 3>().setZero();
  const Constraints both = Constraints::of(product, true);
  REQUIRE(both.turn_about(n, turn) == Status::ok);
  CHECK(turn.most == doctest::Approx(2 * std::atan(half / 2)).epsilon(0.01));
  REQUIRE(both.vector_along(n, rate) == Status::ok);
  CHECK(rate.most == doctest::Approx(n.dot(set.center.angular_velocity) + wide).epsilon(0.01));
  REQUIRE(both.attitude_set(SizeCriterion<double, 3>::trace(), own) == Status::ok);
  CHECK(own.shape.trace() == doctest::Approx(present.trace()).epsilon(0.01));
}

TEST_CASE("update constraints: what was dropped takes no part") {
  Updated updated(7);
  // The same, and a direction far from all of it that the policy leaves out.
  SceneFilter::Settings settings;
  settings.policy = Policy::drop_measurement;
  SceneFilter filter;
  REQUIRE(SceneFilter::make({}, settings, 0, filter) == Status::ok);
  REQUIRE(filter.start(updated.filter.ellipsoid()) == Status::ok);
  const Vector3<double> reference = Vector3<double>::UnitX();
  const Matrix3<double> attitude = filter.ellipsoid().center.attitude;
  const std::array<Direction<double>, 2> directions{
      Direction<double>::within(reference, attitude.transpose() * reference, 0.5),
      Direction<double>::within(reference, -(attitude.transpose() * reference), 0.01)};
  GuaranteedUpdate<double> report;
  Constraints constraints;
  REQUIRE(filter.update({directions.data(), 2, nullptr, nullptr}, report, constraints) == Status::ok);
  REQUIRE(report.dropped == direction_bit(1));
  Interval<double> turn{};
  REQUIRE(constraints.turn_about(Vector3<double>::UnitZ(), turn) == Status::ok);
  CHECK(turn.least < 0);
  CHECK(turn.most > 0);
}

TEST_CASE("update constraints: what has no answer says so and changes nothing") {
  Updated updated(9);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Interval<double> kept{-1, 2};
  CHECK(updated.constraints.turn_about(Vector3<double>(0, nan, 1), kept) == Status::not_finite);
  CHECK(updated.constraints.turn_about(Vector3<double>::Zero(), kept) == Status::zero_direction);
  CHECK(updated.constraints.vector_along(Vector3<double>(0, nan, 1), kept) == Status::not_finite);
  CHECK(updated.constraints.vector_along(Vector3<double>::Zero(), kept) == Status::zero_direction);
  Constraints none;
  AttitudeSet<double> set{Matrix3<double>::Identity(), Matrix3<double>::Zero()};
  CHECK_FALSE(none.knows_attitude());
  CHECK(none.turn_about(Vector3<double>::UnitX(), kept) == Status::unbounded);
  CHECK(none.vector_along(Vector3<double>::UnitX(), kept) == Status::unbounded);
  CHECK(none.attitude_set(SizeCriterion<double, 3>::volume(), set) == Status::unbounded);
  CHECK(updated.constraints.attitude_set(SizeCriterion<double, 3>::weighted_trace(-Matrix3<double>::Identity()), set) ==
        Status::not_positive_definite);
  CHECK(kept.least == -1);
  CHECK(kept.most == 2);
  CHECK(set.shape.isZero());
  // A filter that knows no attitude leaves none.
  SceneFilter filter;
  REQUIRE(SceneFilter::make({}, {}, 0, filter) == Status::ok);
  const AngularVelocity<double> rate{Vector3<double>::Zero(), Matrix3<double>::Identity()};
  GuaranteedUpdate<double> report;
  REQUIRE(filter.update({nullptr, 0, &rate, nullptr}, report, updated.constraints) == Status::ok);
  CHECK_FALSE(updated.constraints.knows_attitude());
}
