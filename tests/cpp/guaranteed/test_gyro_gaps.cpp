// Intervals that no bound of a gyro speaks of: whatever turn at its largest rate the body makes is in the set.
#include <doctest/doctest.h>

#include <cmath>
#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

TEST_CASE("gyro: over an interval that nothing speaks of the body may turn about any axis at its largest rate") {
  using Flow = GuaranteedGyroFlow<double>;
  Random random(17);
  double worst = 0;
  double thinnest = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const double h = random.log_uniform(0.02, 2);
    const double turn = random.log_uniform(1e-3, 2.2);
    const double drift = trial % 3 == 0 ? 0 : random.log_uniform(1e-4, 0.1);
    GyroUncertainty<double> uncertainty;
    uncertainty.drift = drift * drift * Matrix3d::Identity();
    uncertainty.longest_interval = 0.5 * h;
    uncertainty.largest_rate = turn / h;
    Flow flow;
    REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean_of_ends, flow) == Status::ok);
    const bool is_thin = trial % 2 == 0;  // then what is added is all of the set
    const double size = is_thin ? 1e-7 : random.log_uniform(1e-3, 0.3);
    const GibbsEllipsoid<GyroState<double>> before{{random.rotation(), random.normal_matrix<3>()},
                                                   size * size * random.positive_definite<6>(9)};
    const Flow::Input input{100 * random.normal_matrix<3>()};  // is not looked at
    GibbsEllipsoid<GyroState<double>> after;
    REQUIRE(flow.predict(0, h, input, before, after) == Status::ok);
    const Matrix6<double> factor = before.shape.llt().matrixL();
    for (int k = 0; k < 20; ++k) {
      const Vector6<double> y = factor * random.unit_vector<6>();
      const GyroState<double> start = retract<GibbsChart>(before.center, y);
      // As far as it can turn: about the error's own axis or another, or on a way of two parts.
      const Vector3d axis = k % 2 == 0 ? Vector3d(y.head<3>().normalized()) : random.unit_vector<3>();
      const double first = k % 3 == 0 ? random.uniform(0, turn) : turn;
      const Vector3d second_axis = random.unit_vector<3>();
      const Matrix3d attitude =
          start.attitude * exp(Vector3d(first * axis)) * exp(Vector3d((turn - first) * second_axis));
      const GyroState<double> end{attitude, start.gyro_bias + h * drift * random.unit_vector<3>()};
      const Vector6<double> error = state_error<GibbsChart>(after.center, end);
      const double form = error.dot(after.shape.llt().solve(error));
      worst = std::fmax(worst, form);
      if (is_thin && drift == 0 && first == turn) {
        thinnest = std::fmax(thinnest, form);
      }
    }
  }
  MESSAGE("worst form " << worst << ", of thin sets " << thinnest);
  CHECK(worst <= 1);
  CHECK(thinnest > 0.99);
}

TEST_CASE("gyro: what is not known of a gap forgets the attitude and keeps the bias") {
  using Flow = GuaranteedGyroFlow<double>;
  GyroUncertainty<double> uncertainty;
  uncertainty.drift = 1e-4 * Matrix3d::Identity();
  uncertainty.longest_interval = 0.015;
  const GibbsEllipsoid<GyroState<double>> before{{Matrix3d::Identity(), Vector3d::Zero()},
                                                 1e-4 * Matrix6<double>::Identity()};
  const Flow::Input still{Vector3d::Zero()};
  const Flow::Input unmeasured{Vector3d::Constant(std::nan("")), -1, false};
  const auto predicted = [&](double h, const Flow::Input& input) {
    Flow flow;
    REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean_of_ends, flow) == Status::ok);
    GibbsEllipsoid<GyroState<double>> after = before;
    const Status status = flow.predict(0, h, input, before, after);
    if (status != Status::ok) {
      CHECK(after.shape == before.shape);
    }
    return status;
  };
  CHECK(predicted(0.015, still) == Status::ok);
  CHECK(predicted(0.0151, still) == Status::unbounded);
  CHECK(predicted(0.01, unmeasured) == Status::unbounded);
  uncertainty.largest_rate = 10;
  CHECK(predicted(0.0151, still) == Status::ok);
  CHECK(predicted(0.01, unmeasured) == Status::ok);
  CHECK(predicted(0.29, still) == Status::ok);
  CHECK(predicted(0.31, still) == Status::unbounded);  // 3.1 rad and what was open before: half turns
  CHECK(predicted(0.01, Flow::Input{Vector3d::Constant(std::nan(""))}) == Status::not_finite);
  uncertainty.largest_rate = 0;
  CHECK(predicted(100, still) == Status::ok);
  uncertainty.longest_interval = std::nan("");
  Flow flow;
  CHECK(Flow::make(uncertainty, Flow::IntervalRate::mean_of_ends, flow) == Status::not_finite);

  uncertainty.longest_interval = 0.015;
  uncertainty.largest_rate = -1;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean_of_ends, flow) == Status::ok);
  GuaranteedFilter<Flow> filter;
  REQUIRE(GuaranteedFilter<Flow>::make(flow, {}, 0, filter) == Status::ok);
  REQUIRE(filter.start(before) == Status::ok);
  REQUIRE(filter.predict(0.01, still) == Status::ok);
  REQUIRE(filter.knows_attitude());
  REQUIRE(filter.predict(2, still) == Status::ok);
  CHECK_FALSE(filter.knows_attitude());
  CHECK(filter.claim() == Claim::none);
  REQUIRE(filter.knows_vector());
  CHECK(filter.vector().shape(0, 0) >= std::pow(0.01 + 0.01 * 1.99, 2));
}

TEST_CASE("gyro: a rate that was not measured is not looked at, whatever it is") {
  using Flow = GuaranteedGyroFlow<double>;
  GyroUncertainty<double> uncertainty;
  uncertainty.largest_rate = 1;
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean_of_ends, flow) == Status::ok);
  const GibbsEllipsoid<GyroState<double>> before{{Matrix3d::Identity(), Vector3d::Zero()},
                                                 1e-4 * Matrix6<double>::Identity()};
  for (const double stale : {0.0, 1e30, std::nan("")}) {
    GuaranteedFilter<Flow> filter;
    REQUIRE(GuaranteedFilter<Flow>::make(flow, {}, 0, filter) == Status::ok);
    REQUIRE(filter.start(before) == Status::ok);
    CHECK(filter.predict(0.01, {Vector3d::Constant(stale), -1, false}) == Status::ok);
    CHECK(filter.knows_attitude());
  }
}
