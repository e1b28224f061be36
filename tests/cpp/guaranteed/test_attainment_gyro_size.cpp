// What of the gyro flow's bound no truth attains alone, for other terms are as large: the sum as the theory lists it (section 17.6).
#include <doctest/doctest.h>

#include <elliptude/guaranteed/gyro_flow.hpp>

using namespace elliptude;
using Eigen::Matrix3d;
using Eigen::Vector3d;

TEST_CASE("a bias that drifts acts on an error of attitude as well") {
  // A body at rest, so that little is turned. The ball of all that has no direction: ½ h ‖γ‖ ‖δω‖ with ‖δω‖ ≤ ‖δβ‖ + ½ h D, and the way
  // of the drift, ¼ h² D; beside it the drift's own turn, ½ h times that of the bias.
  using Flow = GuaranteedGyroFlow<double>;
  const double h = 0.1;
  const double drift = 1;
  for (const double size : {0.3, 0.6, 1.0}) {
    const double bias = 0.01;
    GyroUncertainty<double> uncertainty;
    uncertainty.drift = drift * drift * Matrix3d::Identity();
    Flow flow;
    REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean, flow) == Status::ok);
    GibbsEllipsoid<GyroState<double>> before;
    before.center = {Matrix3d::Identity(), Vector3d::Zero()};
    before.shape.setZero();
    before.shape.diagonal() << Vector3d::Constant(size * size), Vector3d::Constant(bias * bias);
    GibbsEllipsoid<GyroState<double>> after;
    REQUIRE(flow.predict(0, h, {Vector3d::Zero()}, before, after) == Status::ok);

    const double difference = bias + h * drift / 2;
    const double reach = 2 * std::tan(std::atan(size / 2) + h * difference / 2);
    const double ball = h * reach * difference / 2 + h * h * drift / 4;
    Matrix6<double> map = Matrix6<double>::Identity();
    map.topRightCorner<3, 3>().diagonal().setConstant(-h);
    Matrix6<double> turn = Matrix6<double>::Zero();
    turn.topLeftCorner<3, 3>().diagonal().setConstant(h * h / 4);
    turn.topRightCorner<3, 3>().diagonal().setConstant(-h / 2);
    turn.bottomLeftCorner<3, 3>().diagonal().setConstant(-h / 2);
    turn.bottomRightCorner<3, 3>().setIdentity();
    const std::array<Matrix6<double>, 2> others{Matrix6<double>(h * h * drift * drift * turn),
                                                detail::tube::attitude_ball(ball)};
    Matrix6<double> wanted;
    REQUIRE(detail::tube::sum<double, 6, 2>(Matrix6<double>(map * before.shape * map.transpose()), others, wanted) ==
            Status::ok);
    CHECK(after.shape(2, 2) > wanted(2, 2) * (1 - 1e-9));
    CHECK(after.shape(2, 2) < wanted(2, 2) * 1.05);
  }
}
