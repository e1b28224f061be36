// What the mutations of base/rounding.hpp and of the gyro's flow are noticed by (tests/mutations): each share for rounding where it is all
// that a set is granted, and predictions of intervals and biases of which nothing but a bound is known, at the edge.
#include <doctest/doctest.h>

#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Real = long double;
using RealMatrix = Matrix3<Real>;
using RealVector = Vector3<Real>;
using RealMatrix6 = Eigen::Matrix<Real, 6, 6>;

RealMatrix nearest(const Matrix3<float>& c) {
  RealMatrix r = c.cast<Real>();
  for (int k = 0; k < 6; ++k) {
    r = ((r + RealMatrix(r.inverse().transpose())) / 2).eval();
  }
  return r;
}

/// γᵀP⁻¹γ of an attitude in a set of `float`.
double attitude_form(const GibbsEllipsoid<GyroState<float>>& set, const RealMatrix& truth) {
  const RealVector error = 2 * cayley_inverse(RealMatrix(nearest(set.center.attitude).transpose() * truth));
  const RealMatrix shape = set.shape.cast<Real>().topLeftCorner<3, 3>();
  return static_cast<double>(error.dot(shape.llt().solve(error)));
}

/// The attitude about z after `turn` from a set's edge, in the set that a prediction gave.
double form_about_z(const GibbsEllipsoid<GyroState<double>>& before, const GibbsEllipsoid<GyroState<double>>& after,
                    double turn) {
  const Vector3d edge(0, 0, std::sqrt(before.shape(2, 2)));
  const Matrix3d truth = GibbsChart::retract(before.center.attitude, edge) * exp(Vector3d(0, 0, turn));
  const Vector3d error = GibbsChart::error(after.center.attitude, truth);
  const Matrix3d shape = after.shape.topLeftCorner<3, 3>();
  return error.dot(shape.llt().solve(error));
}

}  // namespace

TEST_CASE("an attitude turned alone holds its image") {
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    Vector6<double> widths;
    for (int k = 0; k < 6; ++k) {
      widths(k) = random.log_uniform(1e-8, 1);
    }
    const Matrix6<double> shape = random.symmetric<6>(Vector6<double>(widths.cwiseAbs2()));
    Matrix6<double> t = Matrix6<double>::Identity();
    t.topLeftCorner<3, 3>() = exp(Vector3d(random.in_ball<3>()));
    const Matrix6<double> image = covered_congruence(Matrix3d(t.topLeftCorner<3, 3>()), shape);
    const RealMatrix6 exact = t.cast<Real>() * shape.cast<Real>() * t.cast<Real>().transpose();
    const RealMatrix6 added = image.cast<Real>() - exact;
    CHECK(static_cast<double>(added.norm() / exact.norm()) < 1e-12);
    CHECK(Eigen::SelfAdjointEigenSolver<RealMatrix6>(added).eigenvalues()(0) > 0);
  }
}

TEST_CASE("an ellipsoid far from the origin loses no point as a quadric") {
  Random random(2);
  Real least = 1;
  for (int i = 0; i < 300; ++i) {
    const Ellipsoid<double, 3> ellipsoid{random.log_uniform(1e2, 1e4) * random.unit_vector<3>(),
                                         random.symmetric<3>(Vector3d(1, random.uniform(0.5, 1), 0.5))};
    Quadric<double, 3> quadric;
    REQUIRE(to_quadric(ellipsoid, quadric) == Status::ok);
    const RealMatrix root = RealMatrix(ellipsoid.shape.cast<Real>()).llt().matrixL();
    const RealVector y = ellipsoid.center.cast<Real>() + root * random.unit_vector<3>().cast<Real>();
    const RealMatrix a = quadric.a.cast<Real>();
    least = std::fmin(least, static_cast<Real>(quadric.c) - y.dot(a * y) - 2 * y.dot(quadric.g.cast<Real>()));
  }
  CHECK(static_cast<double>(least) > 0);
}

TEST_CASE("the rounding of a turn and of the center is all of a tiny set in float") {
  using Flow = GuaranteedGyroFlow<float>;
  Random random(3);
  Flow flow;
  REQUIRE(Flow::make({}, Flow::IntervalRate::mean, flow) == Status::ok);
  for (const double size : {1e-3, 1.0, 1e2, 1e3}) {
    double worst = 0;
    for (int trial = 0; trial < 200; ++trial) {
      GibbsEllipsoid<GyroState<float>> set{{random.rotation().cast<float>(), Vector3<float>::Zero()},
                                           1e-18F * Matrix6<float>::Identity()};
      const Vector3<float> rate = (size * random.uniform(0.5, 1) * random.unit_vector<3>()).cast<float>();
      const auto h = static_cast<float>(random.uniform(0.5, 1));
      const RealMatrix truth = nearest(set.center.attitude) * exp(RealVector(static_cast<Real>(h) * rate.cast<Real>()));
      REQUIRE(flow.predict(0, h, {rate}, set, set) == Status::ok);
      worst = std::fmax(worst, attitude_form(set, truth));
    }
    INFO("turns of " << size << " rad: worst form " << worst);
    CHECK(worst <= 1);
  }
}

TEST_CASE("a start about what is not quite a rotation holds the nearest one") {
  using Flow = GuaranteedGyroFlow<float>;
  Random random(4);
  Flow flow;
  REQUIRE(Flow::make({}, Flow::IntervalRate::mean, flow) == Status::ok);
  GuaranteedFilter<Flow> filter;
  REQUIRE(GuaranteedFilter<Flow>::make(flow, {}, 0, filter) == Status::ok);
  double worst = 0;
  for (int trial = 0; trial < 200; ++trial) {
    GibbsEllipsoid<GyroState<float>> set{{random.rotation().cast<float>(), Vector3<float>::Zero()},
                                         1e-18F * Matrix6<float>::Identity()};
    set.center.attitude += (1e-5 * random.normal_matrix<3, 3>()).cast<float>();
    REQUIRE(filter.start(set) == Status::ok);
    worst = std::fmax(worst, attitude_form(filter.ellipsoid(), nearest(set.center.attitude)));
  }
  CHECK(worst <= 1);
}

TEST_CASE("a rate known by two measurements is not lost where its set is put, in float") {
  using Flow = GuaranteedRigidBodyFlow<float, FreeBody<float>>;
  Random random(8);
  Flow flow;
  REQUIRE(Flow::make(RigidBody<float>(), {}, 1, {}, flow) == Status::ok);
  Real worst = 0;
  for (int trial = 0; trial < 500; ++trial) {
    GuaranteedFilter<Flow> filter;
    REQUIRE(GuaranteedFilter<Flow>::make(flow, {}, 0, filter) == Status::ok);
    const Vector3<float> rate = (100 * random.unit_vector<3>()).cast<float>();
    const auto width = static_cast<float>(random.log_uniform(100, 1000)) * std::numeric_limits<float>::epsilon();
    // Two balls whose common part is a lens; the truth is on its edge.
    const Vector3<float> other = rate + width * random.unit_vector<3>().cast<float>();
    const RealVector apart = other.cast<Real>() - rate.cast<Real>();
    const RealVector across = apart.cross(RealVector(random.unit_vector<3>().cast<Real>())).normalized();
    const float square = width * width;
    const Real reach = static_cast<Real>(square) - apart.squaredNorm() / 4;
    if (!(reach > 0)) {
      continue;
    }
    const RealVector truth =
        rate.cast<Real>() + apart / 2 + (1 - static_cast<Real>(1e-15L)) * std::sqrt(reach) * across;
    for (const Vector3<float>& value : {rate, other}) {
      const AngularVelocity<float> measured{value, square * Matrix3<float>::Identity()};
      Measurements<float> measurements;
      measurements.angular_velocity = &measured;
      GuaranteedUpdate<float> update;
      REQUIRE(filter.update(measurements, update) == Status::ok);
    }
    REQUIRE(filter.knows_vector());
    const RealVector error = truth - filter.vector().center.cast<Real>();
    const RealMatrix shape = filter.vector().shape.cast<Real>();
    worst = std::fmax(worst, error.dot(shape.llt().solve(error)));
  }
  CHECK(static_cast<double>(worst - 1) <= 0);
}

TEST_CASE("gyro: a bias in its bound turns the attitude as noise does and beside it") {
  using Flow = GuaranteedGyroFlow<double>;
  const double noise = 1e-3;
  const double bound = 2e-3;
  const double h = 0.5;
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = noise * noise * Matrix3d::Identity();
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean, flow) == Status::ok);
  const Ellipsoid<double, 3> bias{Vector3d(0, 0, 0.1), bound * bound * Matrix3d::Identity()};
  // The bias that was estimated before counts for nothing.
  GibbsEllipsoid<GyroState<double>> before{{Random(5).rotation(), Vector3d(0, 0, 3)},
                                           1e-6 * Matrix6<double>::Identity()};
  for (const double increment : {-1.0, h * noise}) {
    GibbsEllipsoid<GyroState<double>> after;
    REQUIRE(flow.predict_attitude(0, h, {bias.center, increment}, bias, before, after) == Status::ok);
    const double form = form_about_z(before, after, h * (noise + bound));
    CHECK(form <= 1);
    CHECK(form > 0.85);
    CHECK(after.shape.bottomRightCorner<3, 3>() == bias.shape);
    CHECK(after.center.gyro_bias == bias.center);
  }
}

TEST_CASE("gyro: a large set over an interval that nothing speaks of") {
  using Flow = GuaranteedGyroFlow<double>;
  GyroUncertainty<double> uncertainty;
  uncertainty.longest_interval = 0.1;
  uncertainty.largest_rate = 1;
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean, flow) == Status::ok);
  const double width = 2 * std::tan(0.6);
  GibbsEllipsoid<GyroState<double>> before{{Random(6).rotation(), Vector3d::Zero()},
                                           width * width * Matrix6<double>::Identity()};
  for (const double turn : {0.4, 0.8, 1.2}) {
    GibbsEllipsoid<GyroState<double>> after;
    REQUIRE(flow.predict(0, turn, {Vector3d::Zero()}, before, after) == Status::ok);
    const double form = form_about_z(before, after, turn);
    CHECK(form <= 1);
    CHECK(form > 0.8);
  }
}
