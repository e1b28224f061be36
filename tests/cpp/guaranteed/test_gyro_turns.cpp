// A turn that is known but for an angle: wherever the body can be, it is in the set, and there is no room to spare.
#include <doctest/doctest.h>

#include <cmath>
#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Flow = GuaranteedGyroFlow<double>;
using Set = GibbsEllipsoid<GyroState<double>>;

Flow flow_of(double drift) {
  GyroUncertainty<double> uncertainty;
  uncertainty.drift = drift * drift * Matrix3d::Identity();
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean_of_ends, flow) == Status::ok);
  return flow;
}

double form(const Set& set, const GyroState<double>& state) {
  const Vector6<double> error = state_error<GibbsChart>(set.center, state);
  return error.dot(set.shape.llt().solve(error));
}

}  // namespace

TEST_CASE("turn: whatever turn of at most the angle is added, the truth is in the set") {
  Random random(18);
  double worst = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const double h = random.log_uniform(0.02, 20);
    const double drift = trial % 3 == 0 ? 0 : random.log_uniform(1e-4, 0.1) / h;
    const double angle = random.log_uniform(1e-6, 1.5);
    const Vector3d turn = random.log_uniform(1e-3, 100) * random.unit_vector<3>();
    const double size = random.log_uniform(1e-6, 0.3);
    const Set before{{random.rotation(), random.normal_matrix<3>()}, size * size * random.positive_definite<6>(9)};
    Set after;
    REQUIRE(flow_of(drift).predict_turn(h, turn, angle, before, after) == Status::ok);
    CHECK((after.center.attitude - before.center.attitude * exp(turn)).norm() < 1e-13);
    const Matrix6<double> factor = before.shape.llt().matrixL();
    for (int k = 0; k < 20; ++k) {
      const GyroState<double> start =
          retract<GibbsChart>(before.center, Vector6<double>(factor * random.unit_vector<6>()));
      const Matrix3d more = exp(Vector3d(angle * random.unit_vector<3>()));
      // The unknown turn comes after the known one, or before it.
      const Matrix3d turned = k % 2 == 0 ? Matrix3d(exp(turn) * more) : Matrix3d(more * exp(turn));
      worst = std::fmax(worst,
                        form(after, {start.attitude * turned, start.gyro_bias + h * drift * random.unit_vector<3>()}));
    }
  }
  MESSAGE("worst form " << worst);
  CHECK(worst <= 1);
  CHECK(worst > 0.3);
}

TEST_CASE("turn: a set that is next to nothing becomes the ball of the angle") {
  Random random(19);
  for (const double angle : {1e-6, 1e-3, 0.1, 1.0}) {
    const double radius = 1e-9 * angle;
    const Set before{{random.rotation(), Vector3d::Zero()}, radius * radius * Matrix6<double>::Identity()};
    const Vector3d turn = 2 * random.unit_vector<3>();
    const Ellipsoid<double, 3> bias{Vector3d::Zero(), Matrix3d::Identity()};
    Set after;
    REQUIRE(flow_of(0).predict_attitude_turn(1, turn, angle, bias, before, after) == Status::ok);
    CHECK(after.shape.bottomRightCorner<3, 3>() == bias.shape);
    const GyroState<double> end{before.center.attitude * exp(turn) * exp(Vector3d(angle * random.unit_vector<3>())),
                                Vector3d::Zero()};
    CAPTURE(angle);
    CHECK(form(after, end) <= 1);
    CHECK(form(after, end) > 1 - 1e-4);  // shares are found in two steps
  }
}

TEST_CASE("turn: in the filter, with a bias that is bounded or estimated") {
  const Vector3d turn{0.3, -2, 1};
  const Set begin{{exp(Vector3d{1, 2, 3}), Vector3d::Zero()}, 1e-4 * Matrix6<double>::Identity()};
  for (const bool estimates : {true, false}) {
    CAPTURE(estimates);
    using Filter = GuaranteedFilter<Flow>;
    Filter::Settings settings;
    settings.estimates_vector = estimates;
    Filter anchor;
    REQUIRE(Filter::make(flow_of(0.01), settings, 0, anchor) == Status::ok);
    REQUIRE(anchor.bound_vector({Vector3d::Zero(), 1e-2 * Matrix3d::Identity()}) == Status::ok);
    REQUIRE(anchor.start(begin) == Status::ok);
    Filter filter = anchor;
    REQUIRE(filter.predict_turn(2, turn, 0.1) == Status::ok);
    CHECK(filter.time() == 2);
    CHECK((filter.ellipsoid().center.attitude - begin.center.attitude * exp(turn)).norm() < 1e-14);
    // √P of the attitude is the sum of both, of the bias what it drifts or its bound.
    const double moved = 2 * std::tan(std::atan(0.005) + 0.05) - 0.01;
    CHECK(std::sqrt(filter.ellipsoid().shape(0, 0)) >= 0.01 + moved);
    if (estimates) {
      CHECK(filter.ellipsoid().shape(5, 5) >= std::pow(0.01 + 2 * 0.01, 2));
    } else {
      CHECK(filter.ellipsoid().shape(5, 5) == 1e-2);
    }

    const auto refused = [&](double time, const Vector3d& given, double angle) {
      Filter copy = anchor;
      const Status status = copy.predict_turn(time, given, angle);
      if (status != Status::ok) {
        CHECK(copy.time() == 0);
        CHECK(copy.ellipsoid().shape == anchor.ellipsoid().shape);
        CHECK(copy.knows_attitude());
      }
      return status;
    };
    CHECK(refused(-1, turn, 0.1) == Status::out_of_range);
    CHECK(refused(1, turn, -0.1) == Status::out_of_range);
    CHECK(refused(1, turn, std::nan("")) == Status::not_finite);
    CHECK(refused(std::nan(""), turn, 0.1) == Status::not_finite);
    CHECK(refused(1, Vector3d{0, std::nan(""), 0}, 0.1) == Status::not_finite);
    CHECK(refused(1, Vector3d{0, 1e300, 0}, 0.1) == Status::out_of_range);

    Filter lost = anchor;
    REQUIRE(lost.predict_turn(1, turn, std::numeric_limits<double>::infinity()) == Status::ok);
    CHECK_FALSE(lost.knows_attitude());
    CHECK(lost.knows_vector() == estimates);
    CHECK(lost.time() == 1);
  }
}
