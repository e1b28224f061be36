// The first-order side at the edge of the numbers: what a filter keeps, and weights near the smallest ones. (docs/domain.md)
#include <doctest/doctest.h>

#include "elliptude/elliptude.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

TEST_CASE("a filter keeps no shape that rounding left indefinite") {
  // A prior of 3e7 rad and directions known to 1e-9 rad, at the antipode of what it expects.
  const double wide = 1.129540854757145e15;
  StateEllipsoid<GyroState<double>> set;
  set.center.gyro_bias.setZero();
  set.shape.setZero();
  set.shape.diagonal() << wide, wide, wide, 0.28247524380591893, 0.28247524380591893, 0.28247524380591893;
  set.shape.topRightCorner<3, 3>() = -17862455.831610959 * Matrix3<double>::Identity();
  set.shape.bottomLeftCorner<3, 3>() = set.shape.topRightCorner<3, 3>().transpose();
  GyroFlow<double> flow;
  REQUIRE(GyroFlow<double>::make(Matrix3<double>::Zero(), Matrix3<double>::Zero(), flow) == Status::ok);
  using Filter = AttitudeFilter<GyroFlow<double>, FirstOrderEstimator>;
  Random random(7);
  int kept = 0;
  for (int trial = 0; trial < 300; ++trial) {
    set.center.attitude = random.rotation();
    Filter filter;
    REQUIRE(Filter::make(flow, SizeCriterion<double, 6>::volume(), 0, set, filter) == Status::ok);
    const Vector3<double> reference = random.unit_vector<3>();
    const Vector3<double> body = random.unit_vector<3>();
    const std::array<Direction<double>, 2> directions{Direction<double>::within(reference, body, 1e-9),
                                                      Direction<double>::within(-reference, body, 1e-9)};
    Update<double> update{0.25, 0.5};
    const Status status = filter.update(directions.data(), 2, update);
    REQUIRE(validate(filter.ellipsoid()) == Status::ok);
    if (status == Status::ok) {
      ++kept;
    } else {
      REQUIRE(filter.ellipsoid().shape == set.shape);
    }
  }
  MESSAGE("kept " << kept << " of 300");
}

TEST_CASE("weights of any size solve the same problem of Wahba or are refused") {
  Random random(8);
  for (int trial = 0; trial < 200; ++trial) {
    const Matrix3<double> truth = random.rotation();
    Matrix<double, 3, 4> body;
    for (int i = 0; i < 4; ++i) {
      body.col(i) = random.unit_vector<3>();
    }
    Matrix<double, 3, 4> reference = truth * body;
    reference += 0.01 * random.normal_matrix<3, 4>();
    const Vector<double, 4> weights(1, 2, 0.5, 1.5);
    for (const WahbaMethod method : {WahbaMethod::svd, WahbaMethod::foam, WahbaMethod::davenport, WahbaMethod::qr}) {
      WahbaSolution<double> usual;
      if (solve_wahba(reference, body, weights, method, usual) != Status::ok) {
        continue;  // det L is not positive
      }
      for (const double unit : {1e-307, 1e-300, 1e-293, 1e-160, 1e150, 1e300}) {
        WahbaSolution<double> other;
        REQUIRE(solve_wahba(reference, body, Vector<double, 4>(unit * weights), method, other) == Status::ok);
        REQUIRE((other.attitude - usual.attitude).norm() < 1e-12 * usual.condition);
        REQUIRE(std::abs(other.condition / usual.condition - 1) < 1e-9 * usual.condition);
      }
      for (const double unit : {5e-324, 1e-310}) {
        WahbaSolution<double> other = usual;
        REQUIRE(solve_wahba(reference, body, Vector<double, 4>(unit * Vector<double, 4>::Ones()), method, other) ==
                Status::beyond_domain);
        REQUIRE(other.attitude == usual.attitude);
      }
    }
  }
}
