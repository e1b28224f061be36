// Two sets of one moment, from its past and from its future, and what they rest on. (theory, section 20.4)
#include <doctest/doctest.h>

#include "support/smoothing_scene.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using namespace elliptude::testing::smoothing;

TEST_CASE("both directions: the stronger claim alone, and no set without one") {
  const GibbsEllipsoid<GyroState<double>> narrow{{Matrix3d::Identity(), Vector3d::Zero()},
                                                 0.01 * Matrix6<double>::Identity()};
  GibbsEllipsoid<GyroState<double>> wide = narrow;
  wide.shape *= 9;
  BothDirections<GyroState<double>> both;
  REQUIRE(both_directions<GyroState<double>>({narrow, Claim::conditional}, {wide, Claim::unconditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::unconditional);
  CHECK(both.smoothed.set.shape == wide.shape);
  CHECK(both.smallest.set.shape == wide.shape);
  CHECK(both.uses_future);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::unconditional}, {narrow, Claim::conditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::unconditional);
  CHECK(both.smoothed.set.shape == wide.shape);
  CHECK_FALSE(both.uses_future);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::none}, {narrow, Claim::conditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::conditional);
  CHECK(both.smoothed.set.shape == narrow.shape);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::none}, {narrow, Claim::none}, {}, both) == Status::ok);
  CHECK(both.smoothed.claim == Claim::none);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::conditional}, {narrow, Claim::conditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::conditional);
  CHECK(log_size(both.smoothed.set) < log_size(wide));
  CHECK_FALSE(both.contradict);
}

TEST_CASE("both directions: a smaller set that reaches farther is not shown, but is gone on with") {
  // The past is a ball, the future a thin ellipsoid across it whose largest part lies outside.
  const GibbsEllipsoid<GyroState<double>> past{{Matrix3d::Identity(), Vector3d::Zero()},
                                               0.01 * Matrix6<double>::Identity()};
  Vector6<double> squares = Vector6<double>::Constant(0.0101);
  squares(0) = 1e-6;
  squares(1) = 0.04;
  const GibbsEllipsoid<GyroState<double>> future{{Matrix3d::Identity(), Vector3d::Zero()},
                                                 Matrix6<double>(squares.asDiagonal())};
  BothDirections<GyroState<double>> both;
  REQUIRE(both_directions<GyroState<double>>({past, Claim::unconditional}, {future, Claim::unconditional}, {}, both) ==
          Status::ok);
  CHECK(log_size(both.smallest.set) < log_size(past) - 1);
  CHECK(largest(both.smallest.set.shape, 0) > largest(past.shape, 0));
  CHECK(both.smoothed.set.shape == past.shape);
  CHECK_FALSE(both.uses_future);
}

TEST_CASE("both directions: the vector by itself is no wider than it was") {
  // The future says how attitude and vector go together: across that the common set is thin, and along it wider in the vector.
  const GibbsEllipsoid<GyroState<double>> past{{Matrix3d::Identity(), Vector3d::Zero()},
                                               1e-6 * Matrix6<double>::Identity()};
  Matrix6<double> together = Matrix6<double>::Identity();
  together.topRightCorner<3, 3>() = -0.3 * Matrix3d::Identity();
  const Vector6<double> squares = (Vector6<double>() << Vector3d::Constant(1e-12), Vector3d::Constant(1e-3)).finished();
  const GibbsEllipsoid<GyroState<double>> future{
      {Matrix3d::Identity(), Vector3d::Zero()},
      Matrix6<double>(together * Matrix6<double>(squares.asDiagonal()) * together.transpose())};
  BothDirections<GyroState<double>> both;
  REQUIRE(both_directions<GyroState<double>>({past, Claim::unconditional}, {future, Claim::unconditional}, {}, both) ==
          Status::ok);
  CHECK(both.uses_future);
  CHECK(largest(both.smoothed.set.shape, 0) < 0.5 * largest(past.shape, 0));
  CHECK(largest(both.smoothed.set.shape, 3) > largest(past.shape, 3));
  CHECK(both.vector.shape == Matrix3d(past.shape.bottomRightCorner<3, 3>()));
  // Where that is narrower, it is that of the common set.
  GibbsEllipsoid<GyroState<double>> narrow = past;
  narrow.shape *= 0.25;
  REQUIRE(both_directions<GyroState<double>>({past, Claim::unconditional}, {narrow, Claim::unconditional}, {}, both) ==
          Status::ok);
  CHECK(both.vector.shape == Matrix3d(both.smoothed.set.shape.bottomRightCorner<3, 3>()));
  CHECK(both.vector.shape(0, 0) < 0.3e-6);
}

TEST_CASE("both directions: sets that have nothing in common, and whether that proves anything") {
  const GibbsEllipsoid<GyroState<double>> past{{Matrix3d::Identity(), Vector3d::Zero()},
                                               1e-4 * Matrix6<double>::Identity()};
  GibbsEllipsoid<GyroState<double>> future = past;
  future.center.attitude = exp(Vector3d(0.1, 0, 0));
  BothDirections<GyroState<double>> both;
  for (const Claim claim : {Claim::unconditional, Claim::conditional}) {
    REQUIRE(both_directions<GyroState<double>>({past, claim}, {future, claim}, {}, both) == Status::ok);
    CHECK(both.contradict == (claim == Claim::unconditional));
    CHECK(both.smoothed.set.shape == past.shape);
    CHECK(both.smoothed.claim == claim);
    CHECK_FALSE(both.uses_future);
  }
  GibbsEllipsoid<GyroState<double>> broken = past;
  broken.shape(0, 0) = std::nan("");
  CHECK(both_directions<GyroState<double>>({past, Claim::unconditional}, {broken, Claim::unconditional}, {}, both) ==
        Status::not_finite);
  CHECK(both.smoothed.claim == Claim::conditional);
}
