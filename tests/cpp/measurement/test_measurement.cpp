#include <doctest/doctest.h>

#include <elliptude/measurement/quadrics.hpp>
#include <limits>
#include <vector>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

/// Directions in general position, measured of an attitude with errors of a given size.
std::vector<Direction<double>> measured(Random& random, const Matrix3<double>& attitude, int count, double error) {
  std::vector<Direction<double>> directions;
  for (int i = 0; i < count; ++i) {
    const Vector3<double> e = random.unit_vector<3>();
    const Vector3<double> b = exp(error * random.in_ball<3>()) * (attitude.transpose() * e);
    directions.push_back(Direction<double>::within(e, b, 0.1));
    directions.back().weight = random.uniform(0.5, 2);
  }
  return directions;
}

Matrix3<double> attitude_of(const std::vector<Direction<double>>& directions) {
  MeasuredDirections<double> result;
  REQUIRE(MeasuredDirections<double>::make(directions.data(), directions.size(), WahbaMethod::svd, result) ==
          Status::ok);
  return result.attitude();
}

}  // namespace

TEST_CASE("The sensitivities of the measured attitude agree with central differences of Wahba's solution") {
  Random random(1);
  for (int trial = 0; trial < 50; ++trial) {
    auto directions = measured(random, random.rotation(), 2 + trial % 4, 0.2);
    for (std::size_t i = 0; i < directions.size(); ++i) {
      // The term 𝒜ⁱ S 𝒜ⁱᵀ is linear in the bound S: a bound longer along one axis adds the square of one column.
      const Vector3<double> axis = random.unit_vector<3>();
      MeasuredDirections<double> round;
      MeasuredDirections<double> longer;
      directions[i].bound.setIdentity();
      REQUIRE(MeasuredDirections<double>::make(directions.data(), directions.size(), WahbaMethod::svd, round) ==
              Status::ok);
      directions[i].bound += axis * axis.transpose();
      REQUIRE(MeasuredDirections<double>::make(directions.data(), directions.size(), WahbaMethod::svd, longer) ==
              Status::ok);
      // The truth C belongs to b = exp(S(ν)) b̃: moving the measured direction by ν moves the attitude to the truth.
      const double step = 1e-5;
      auto forward = directions;
      auto backward = directions;
      forward[i].body = exp(step * axis) * directions[i].body;
      backward[i].body = exp(-step * axis) * directions[i].body;
      const Vector3<double> column = (log(Matrix3<double>(round.attitude().transpose() * attitude_of(forward))) -
                                      log(Matrix3<double>(round.attitude().transpose() * attitude_of(backward)))) /
                                     (2 * step);
      CHECK((longer.term(i) - round.term(i) - column * column.transpose()).norm() <= 1e-8 * (1 + column.squaredNorm()));
    }
  }
}

TEST_CASE("The measured ellipsoid is the sum of the printed formula") {
  Random random(2);
  const auto directions = measured(random, random.rotation(), 3, 0.05);
  MeasuredDirections<double> result;
  REQUIRE(MeasuredDirections<double>::make(directions.data(), directions.size(), WahbaMethod::svd, result) ==
          Status::ok);
  const AngularVelocity<double> rate{Vector3<double>(1, 2, 3), random.positive_definite<3>(10)};
  StateEllipsoid<RigidBodyState<double>> ellipsoid;
  REQUIRE(measured_state(result, rate, SizeCriterion<double, 6>::trace(), ellipsoid) == Status::ok);

  // Eq. Pmkl, as printed.
  double roots = std::sqrt(rate.bound.trace());
  Matrix6<double> sum = Matrix6<double>::Zero();
  sum.bottomRightCorner<3, 3>() = rate.bound / std::sqrt(rate.bound.trace());
  for (std::size_t i = 0; i < 3; ++i) {
    roots += std::sqrt(result.term(i).trace());
    sum.topLeftCorner<3, 3>() += result.term(i) / std::sqrt(result.term(i).trace());
  }
  CHECK((ellipsoid.shape - roots * sum).norm() <= 1e-14 * ellipsoid.shape.norm());
  CHECK(ellipsoid.center.angular_velocity == rate.value);
}

TEST_CASE("By any criterion the measured ellipsoid is as small as the sum of all its terms at once") {
  Random random(4);
  for (int trial = 0; trial < 30; ++trial) {
    const auto directions = measured(random, random.rotation(), 2 + trial % 4, 0.05);
    MeasuredDirections<double> result;
    REQUIRE(MeasuredDirections<double>::make(directions.data(), directions.size(), WahbaMethod::svd, result) ==
            Status::ok);
    const AngularVelocity<double> rate{Vector3<double>(1, 2, 3), 1e-2 * random.positive_definite<3>(10)};
    std::array<Ellipsoid<double, 6>, 6> terms;
    terms.fill({Vector6<double>::Zero(), Matrix6<double>::Zero()});
    for (std::size_t i = 0; i < result.count(); ++i) {
      terms[i].shape.topLeftCorner<3, 3>() = result.term(i);
    }
    terms[result.count()].shape.bottomRightCorner<3, 3>() = rate.bound;
    using Criterion = SizeCriterion<double, 6>;
    for (const Criterion& criterion :
         {Criterion::trace(), Criterion::weighted_trace(random.positive_definite<6>(100)), Criterion::volume()}) {
      StateEllipsoid<RigidBodyState<double>> ellipsoid;
      REQUIRE(measured_state(result, rate, criterion, ellipsoid) == Status::ok);
      Ellipsoid<double, 6> sum;
      REQUIRE(minimal_sum(terms.data(), result.count() + 1, criterion, sum) == Status::ok);
      if (criterion.kind == Criterion::Kind::volume) {
        // Each is within 1e-6 of the least.
        CHECK(std::abs(std::log(ellipsoid.shape.determinant() / sum.shape.determinant())) <= 1e-6);
      } else {
        CHECK((ellipsoid.shape - sum.shape).norm() <= 1e-12 * sum.shape.norm());
      }
    }
  }
}

TEST_CASE("The two rows of one direction contain what every small error of it does") {
  Random random(3);
  double worst = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    // About a center at any distance across the direction: what turns about the direction, it does not see.
    const double size = 1e-6;
    const Matrix3<double> truth = random.rotation();
    Direction<double> direction;
    direction.reference = random.unit_vector<3>() * random.uniform(0.1, 10);
    const Vector3<double> true_direction = (truth.transpose() * direction.reference).normalized();
    const Vector3<double> axis = true_direction.cross(random.unit_vector<3>()).normalized();
    const Matrix3<double> center = truth * exp(random.uniform(0, 3) * axis) * exp(size * random.in_ball<3>());
    const Vector3<double> zeta = ExponentialChart::error(center, truth);
    direction.bound = size * size * random.positive_definite<3>(20);
    const Matrix3<double> root = direction.bound.llt().matrixL();
    const Vector3<double> nu = root * random.unit_vector<3>();
    // Cᵀe = exp(S(ν)) b̃ (eq. bi).
    direction.body = exp(-nu) * (truth.transpose() * direction.reference);
    direction.weight = 1;
    LinearMeasurement<double, 2> linear;
    REQUIRE(linear_direction(center, direction, linear) == Status::ok);
    Vector6<double> x;
    x << zeta, random.unit_vector<3>();
    double form = 0;
    REQUIRE(quadratic_form(Ellipsoid<double, 2>{linear.y, linear.bound}, Vector<double, 2>(linear.h * x), form) ==
            Status::ok);
    worst = std::max(worst, form);
    CHECK(form <= 1 + 1e-2);  // terms of second order
  }
  CHECK(worst > 0.9);
}

TEST_CASE("A whole attitude contains what every small error of it does at any distance from the center") {
  Random random(4);
  double worst = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const Matrix3<double> center = random.rotation();
    MeasuredAttitude<double> measured_attitude;
    measured_attitude.attitude = center * exp(random.uniform(0, 2.5) * random.unit_vector<3>());
    measured_attitude.bound = 1e-10 * random.positive_definite<3>(10);
    const Matrix3<double> root = measured_attitude.bound.llt().matrixL();
    const Matrix3<double> truth = measured_attitude.attitude * exp(root * random.unit_vector<3>());
    LinearMeasurement<double, 3> linear;
    REQUIRE(linear_attitude(center, measured_attitude, linear) == Status::ok);
    const Vector3<double> zeta = ExponentialChart::error(center, truth);
    double form = 0;
    REQUIRE(quadratic_form(Ellipsoid<double, 3>{linear.y, linear.bound}, zeta, form) == Status::ok);
    worst = std::max(worst, std::abs(form - 1));
  }
  CHECK(worst < 1e-3);  // the errors are on the boundary, so the form is 1 but for second order
}

TEST_CASE("A linear measurement as a quadric says the same as its ellipsoid") {
  Random random(5);
  for (int trial = 0; trial < 100; ++trial) {
    const LinearMeasurement<double, 2> linear{random.normal_matrix<2>(), random.normal_matrix<2, 6>(),
                                              random.positive_definite<2>(30)};
    Quadric<double, 6> quadric;
    REQUIRE(to_quadric(linear, quadric) == Status::ok);
    const Vector6<double> x = random.normal_matrix<6>();
    const Vector<double, 2> rest = linear.y - linear.h * x;
    const double form = rest.dot(linear.bound.inverse() * rest);
    CHECK(slack(quadric, x) == doctest::Approx(1 - form).epsilon(1e-11));
  }
}

TEST_CASE("Measurements that make no sense are refused and the output stays") {
  Random random(6);
  auto directions = measured(random, random.rotation(), 3, 0.05);
  MeasuredDirections<double> before;
  REQUIRE(MeasuredDirections<double>::make(directions.data(), 3, WahbaMethod::svd, before) == Status::ok);
  const auto status_of = [&](const std::vector<Direction<double>>& given) {
    MeasuredDirections<double> result = before;
    const Status status = MeasuredDirections<double>::make(given.data(), given.size(), WahbaMethod::svd, result);
    CHECK(result.attitude() == before.attitude());
    return status;
  };
  auto bad = directions;
  bad[1].body.setZero();
  CHECK(status_of(bad) == Status::zero_direction);
  bad = directions;
  bad[2].reference(0) = std::numeric_limits<double>::quiet_NaN();
  CHECK(status_of(bad) == Status::not_finite);
  bad = directions;
  bad[0].weight = 0;
  CHECK(status_of(bad) == Status::out_of_range);
  bad = directions;
  bad[0].bound(0, 0) = -1;
  CHECK(status_of(bad) == Status::not_positive_definite);
  bad = directions;
  bad[0].bound.setZero();
  CHECK(status_of(bad) == Status::not_positive_definite);
  bad = directions;
  bad[0].bound(0, 1) = 1;
  CHECK(status_of(bad) == Status::not_symmetric);
  CHECK(status_of({directions[0]}) == Status::attitude_undetermined);
  CHECK(status_of({directions[0], directions[0]}) == Status::attitude_undetermined);
  CHECK(status_of(std::vector<Direction<double>>(33, directions[0])) == Status::out_of_range);

  LinearMeasurement<double, 3> linear;
  CHECK(linear_attitude(Matrix3<double>(Matrix3<double>::Identity()),
                        {Matrix3<double>(2 * Matrix3<double>::Identity()), Matrix3<double>::Identity()},
                        linear) == Status::not_a_rotation);
}
