// Every function over all magnitudes that a number can have: what is answered with `ok` is finite, positive definite, and holds
// what it must; judged in long double, whose exponents reach far beyond those of double. (docs/domain.md)
#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "elliptude/elliptude.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using Real = long double;
using RealMatrix = Matrix3<Real>;
using RealVector = Vector3<Real>;
using Directions = Eigen::Matrix<double, 3, Eigen::Dynamic>;

/// Anything from the smallest number to the largest.
double any_magnitude(Random& random) { return std::pow(10.0, random.uniform(-323.2, 308)); }

/// Directions that keep their bounds, of any lengths.
struct Case {
  RealMatrix truth;
  Directions reference;
  Directions body;
  Eigen::VectorXd bounds;
};

Case draw(Random& random, int count) {
  Case c;
  const Eigen::Quaterniond q(random.normal(), random.normal(), random.normal(), random.normal());
  c.truth = Eigen::Quaternion<Real>(q.cast<Real>()).normalized().toRotationMatrix();
  c.reference.resize(3, count);
  c.body.resize(3, count);
  c.bounds.resize(count);
  const bool equal = random.uniform(0, 1) < 0.5;
  const double size = random.log_uniform(1e-9, 1);
  for (int i = 0; i < count; ++i) {
    // Bounds of all sizes; those below a rounding are met by directions that are as they should be but for rounding.
    c.bounds(i) = equal ? size : std::fmin(any_magnitude(random), 3.0);
    const RealVector b = random.unit_vector<3>().cast<Real>().normalized();
    const RealVector axis = b.cross(RealVector(random.unit_vector<3>().cast<Real>())).normalized();
    const Real angle =
        c.bounds(i) < 1e-15 ? 0 : Real(c.bounds(i)) * (random.uniform(0, 1) < 0.5 ? 1 : Real(random.uniform(0, 1)));
    const RealVector e = c.truth * b;
    const RealVector measured = std::cos(angle) * b + std::sin(angle) * axis.cross(b);
    // Lengths that keep all of the digits.
    const Real e_length = std::pow(10.0L, Real(random.uniform(-290, 300)));
    const Real b_length = std::pow(10.0L, Real(random.uniform(-290, 300)));
    c.reference.col(i) = (e_length * e).cast<double>();
    c.body.col(i) = (b_length * measured).cast<double>();
  }
  return c;
}

template <typename Chart>
void check_wahba(const Status status, const WahbaSet<double>& set, const Case& c) {
  if (status != Status::ok) {
    CHECK(status == Status::unbounded);  // the truth keeps its bounds: there is no contradiction
    return;
  }
  const Matrix3<double>& shape = set.error.shape;
  REQUIRE(shape.allFinite());
  Matrix3<double> factor;
  CHECK(cholesky(shape, factor) == Status::ok);
  const RealMatrix center = renormalized(RealMatrix(renormalized(RealMatrix(set.attitude.cast<Real>()))));
  const RealVector x = Chart::error(center, c.truth);
  CHECK(x.dot(RealMatrix(shape.cast<Real>()).llt().solve(x)) <= 1);
}

}  // namespace

TEST_CASE("Wahba's set with weights and bounds of any magnitude") {
  Random random(20260501);
  for (int trial = 0; trial < 3000; ++trial) {
    const int count = 2 + trial % 4;
    const Case c = draw(random, count);
    Eigen::VectorXd weights(count);
    const double weight = any_magnitude(random);
    for (int i = 0; i < count; ++i) {
      switch (trial % 3) {
        case 0:
          weights(i) = 2e-308;
          break;
        case 1:
          weights(i) = weight;
          break;
        default:
          weights(i) = any_magnitude(random);
      }
    }
    WahbaSet<double> set;
    check_wahba<ExponentialChart>(wahba_set<ExponentialChart>(c.reference, c.body, c.bounds, weights, set), set, c);
    check_wahba<GibbsChart>(wahba_set<GibbsChart>(c.reference, c.body, c.bounds, weights, set), set, c);
    check_wahba<GibbsChart>(
        minimal_wahba_set<GibbsChart>(c.reference, c.body, c.bounds, WahbaCriterion::volume, weights, set), set, c);
    check_wahba<GibbsChart>(
        minimal_wahba_set<GibbsChart>(c.reference, c.body, c.bounds, WahbaCriterion::trace, weights, set), set, c);
  }
}

namespace {

using Real6 = Matrix<Real, 6>;

/// A positive definite shape about the size 10^magnitude whose squared semi-axes spread over 10^spread; the frame or the
/// coordinates have the spread.
bool draw_shape(Random& random, double magnitude, double spread, Matrix6<double>& shape) {
  Vector6<double> widths;
  for (int i = 0; i < 6; ++i) {
    widths(i) = std::pow(10.0, 0.5 * (magnitude + spread * random.uniform(-0.5, 0.5)));
  }
  const bool rotated = random.uniform(0, 1) < 0.5;
  Matrix6<double> factor = rotated ? random.orthogonal<6>() : random.normal_matrix<6, 6>();
  if (rotated) {
    factor *= widths.asDiagonal();
  } else {
    factor.rowwise().normalize();
    factor = (widths.asDiagonal() * factor).eval();
  }
  shape = factor * factor.transpose();
  shape = (0.5 * (shape + shape.transpose())).eval();
  Matrix6<double> ignored;
  return shape.allFinite() && cholesky(shape, ignored) == Status::ok;
}

Real6 cholesky_factor(const Matrix6<double>& shape) { return Real6(shape.cast<Real>()).llt().matrixL(); }

Real form(const Ellipsoid<double, 6>& set, const Vector6<Real>& x) {
  const Vector6<Real> scale = set.shape.cast<Real>().diagonal().cwiseSqrt().cwiseInverse();
  const Real6 scaled = scale.asDiagonal() * set.shape.cast<Real>() * scale.asDiagonal();
  const Vector6<Real> y = scale.cwiseProduct(Vector6<Real>(x - set.center.cast<Real>()));
  return y.dot(Vector6<Real>(scaled.ldlt().solve(y)));
}

/// What may be said of an answer: never `ok` with a shape that is not one; inside the domain never anything but `ok`.
void check_answer(Status status, bool inside, const Ellipsoid<double, 6>& set) {
  if (inside) {
    CHECK(status == Status::ok);
  }
  if (status == Status::ok) {
    Matrix6<double> factor;
    CHECK(set.center.allFinite());
    CHECK(set.shape.allFinite());
    CHECK(cholesky(set.shape, factor) == Status::ok);
  }
}

}  // namespace

TEST_CASE("first-order sets of any magnitude and spread are sets or are refused") {
  Random random(20260502);
  int within = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    const bool by_spread = trial % 2 == 0;
    const double magnitude = by_spread ? 0 : random.uniform(-320, 305);
    const double spread = by_spread ? random.uniform(0, 40) : random.uniform(0, 2);
    Matrix6<double> a;
    Matrix6<double> b;
    if (!draw_shape(random, magnitude, spread, a) ||
        !draw_shape(random, magnitude + random.uniform(-5, 5), spread, b)) {
      continue;
    }
    const bool inside = is_in_domain(a) && is_in_domain(b) && magnitude < 265 && magnitude > -265 && spread < 12;
    within += inside ? 1 : 0;
    const Real6 root_a = cholesky_factor(a);
    const Real6 root_b = cholesky_factor(b);
    const Vector6<Real> x = root_a * random.in_ball<6>().cast<Real>();
    const Vector6<Real> y = root_b * (0.999L * random.in_ball<6>().cast<Real>());
    const Ellipsoid<double, 6> first{Vector6<double>::Zero(), a};
    const Ellipsoid<double, 6> second{Vector6<double>(Vector6<Real>(x - y).cast<double>()), b};
    const Real in_second = form(second, x);
    for (const auto& criterion : {SizeCriterion<double, 6>::trace(), SizeCriterion<double, 6>::volume()}) {
      const std::array<Ellipsoid<double, 6>, 2> terms{first, Ellipsoid<double, 6>{Vector6<double>::Zero(), b}};
      Ellipsoid<double, 6> sum;
      const Status summed = minimal_sum(terms.data(), terms.size(), criterion, sum);
      check_answer(summed, inside, sum);
      if (inside && summed == Status::ok) {
        CHECK(form(sum, x + y) <= 1 + 1e-6L);
      }
      Intersection<double, 6> both;
      if (in_second <= 1) {
        const Status status = minimal_intersection(first, second, criterion, both);
        check_answer(status, inside, both.set);
        if (inside && status == Status::ok) {
          CHECK(form(both.set, x) <= 1 + 1e-6L);
        }
      }
      GyroFlow<double> gyro;
      if (GyroFlow<double>::make(a.topLeftCorner<3, 3>(), b.topLeftCorner<3, 3>(), gyro) == Status::ok) {
        const StateEllipsoid<GyroState<double>> before{{Matrix3<double>::Identity(), Vector3<double>::Zero()}, a};
        Prediction<GyroState<double>> after;
        const Status status = gyro.predict(0, 1, {Vector3<double>(0.1, 0.2, 0.3)}, before, criterion, after);
        check_answer(status, inside, {Vector6<double>::Zero(), after.ellipsoid.shape});
      }
      RigidBodyFlow<double, FreeBody<double>> flow;
      RigidBody<double> body;
      REQUIRE(RigidBody<double>::make(Matrix3<double>(Vector3<double>(1, 2, 2.5).asDiagonal()), body) == Status::ok);
      const Matrix3<double> torque = trial % 4 < 2 ? Matrix3<double>(b.topLeftCorner<3, 3>()) : Matrix3<double>::Zero();
      if (RigidBodyFlow<double, FreeBody<double>>::make(body, {}, 0.1, 2, torque, flow) == Status::ok) {
        const StateEllipsoid<RigidBodyState<double>> before{
            {Matrix3<double>::Identity(), Vector3<double>(0.1, 0.2, 0.3)}, a};
        Prediction<RigidBodyState<double>> after;
        const Status status = flow.predict(0, 0.3, {}, before, criterion, after);
        check_answer(status, inside, {Vector6<double>::Zero(), after.ellipsoid.shape});
      }
      const StateEllipsoid<RigidBodyState<double>> one{{Matrix3<double>::Identity(), Vector3<double>::Zero()}, a};
      StateEllipsoid<RigidBodyState<double>> other = one;
      other.shape = b;
      for (const Recentring recentring : {Recentring::shifted, Recentring::first_order}) {
        Fusion<RigidBodyState<double>> fusion;
        const Status status = fuse(one, other, recentring, criterion, fusion);
        check_answer(status, inside, {Vector6<double>::Zero(), fusion.ellipsoid.shape});
      }
    }
  }
  CHECK(within > 1000);
}

TEST_CASE("a width beyond the domain is refused by a status of its own") {
  const Ellipsoid<double, 3> good{Vector3<double>::Zero(), Matrix3<double>::Identity()};
  for (const double size : {5e-324, 1e-310, 1e-290, 1e280, 1e300}) {
    const Ellipsoid<double, 3> bad{Vector3<double>::Zero(), size * Matrix3<double>::Identity()};
    CHECK(validate(bad) == Status::beyond_domain);
    Intersection<double, 3> both;
    CHECK(minimal_intersection(good, bad, SizeCriterion<double, 3>::trace(), both) == Status::beyond_domain);
    Quadric<double, 3> quadric;
    CHECK(to_quadric(bad, quadric) == Status::beyond_domain);
    const Direction<double> direction{Vector3<double>::UnitX(), Vector3<double>::UnitX(), bad.shape, 1};
    CHECK(validate(direction) == Status::beyond_domain);
    CHECK(validate(AngularVelocity<double>{Vector3<double>::Zero(), bad.shape}) == Status::beyond_domain);
  }
  for (const double size : {0.0, 1e-276, 1e276}) {
    CHECK(validate(Ellipsoid<double, 3>{Vector3<double>::Zero(), size * Matrix3<double>::Identity()}) == Status::ok);
  }
  const Ellipsoid<float, 3> small{Vector3<float>::Zero(), 1e-26F * Matrix3<float>::Identity()};
  CHECK(validate(small) == Status::beyond_domain);
}

TEST_CASE("what a quadric leaves of an ellipsoid is a set or beyond the domain") {
  // x² + y² + z² ≤ 1e-300: semi-axes of 1e-150. Of 1e-100 they are within.
  const Quadric<double, 3> tiny{Matrix3<double>::Identity(), Vector3<double>::Zero(), 1e-300};
  const Ellipsoid<double, 3> ball{Vector3<double>::Zero(), Matrix3<double>::Identity()};
  Intersection<double, 3> result{ball, 0.25};
  CHECK(minimal_intersection(tiny, ball, SizeCriterion<double, 3>::volume(), result) == Status::beyond_domain);
  CHECK(result.share == 0.25);
  CHECK(result.set.shape == ball.shape);
  const Quadric<double, 3> small{Matrix3<double>::Identity(), Vector3<double>::Zero(), 1e-200};
  REQUIRE(minimal_intersection(small, ball, SizeCriterion<double, 3>::volume(), result) == Status::ok);
  CHECK(result.set.shape(0, 0) == doctest::Approx(1e-200).epsilon(1e-9));
}

TEST_CASE("what many quadrics leave is a set of the domain, the prediction, or beyond the domain") {
  const Matrix6<double> unit = Matrix6<double>::Identity();
  const SizeCriterion<double, 6> criterion = SizeCriterion<double, 6>::trace();
  for (const double square : {1e-200, 1e-270, 1e-290, 1e-307}) {
    CAPTURE(square);
    const std::array<Quadric<double, 6>, 1> ball{Quadric<double, 6>{unit / square, Vector6<double>::Zero(), 1.0}};
    const bool represented = square > 1e-275;
    QuadricFusion<double, 6> fusion;
    CHECK(minimal_intersection<double, 6>(nullptr, ball.data(), 1, criterion, fusion) ==
          (represented ? Status::ok : Status::beyond_domain));
    // A prediction of twice the width.
    const Ellipsoid<double, 6> predicted{Vector6<double>::Zero(), 4.0 * square * unit};
    REQUIRE(minimal_intersection(&predicted, ball.data(), 1, criterion, fusion) == Status::ok);
    CHECK(fusion.prediction_alone == !represented);
    CHECK(fusion.set.shape.diagonal().minCoeff() > 0.0);
  }
}

TEST_CASE("the first-order attitude does not depend on the unit of the weights") {
  Random random(7);
  const Matrix3<double> truth = random.rotation();
  for (const double unit : {5e-324, 2e-308, 1.0, 1e300}) {
    std::array<Direction<double>, 3> directions;
    for (Direction<double>& direction : directions) {
      const Vector3<double> b = random.unit_vector<3>();
      direction = Direction<double>::within(truth * b, b, 0.01);
      direction.weight = unit;
    }
    MeasuredDirections<double> measured;
    REQUIRE(MeasuredDirections<double>::make(directions.data(), 3, WahbaMethod::svd, measured) == Status::ok);
    CHECK((measured.attitude() - truth).norm() < 1e-13);
    CHECK(measured.term(0).norm() > 1e-6);
    CHECK(measured.term(0).norm() < 1);
  }
}
