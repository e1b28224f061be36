// Charts of the attitude error, and what measurements say in the Gibbs chart: against the definition in terms of angles, in
// long double, and with sets that the obvious approximations leave.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "elliptude/measurement/quadrics.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using State = RigidBodyState<double>;
using Gibbs = StateEllipsoid<State, GibbsChart>;
using Exponential = StateEllipsoid<State>;
using Long3 = Eigen::Matrix<long double, 3, 1>;
using LongMatrix3 = Eigen::Matrix<long double, 3, 3>;
using LongMatrix6 = Eigen::Matrix<long double, 6, 6>;
constexpr double pi = 3.14159265358979323846;

// Ĉᵀ C by the half-angle formula, γ = 2 tan(θ/2) n.
LongMatrix3 turn(const Vector3<double>& gamma) {
  const Long3 g = gamma.cast<long double>() / 2;
  return Eigen::Quaternion<long double>(1, g.x(), g.y(), g.z()).normalized().toRotationMatrix();
}

long double angle_between(const Long3& a, const Long3& b) {
  return 2 * std::atan2((a.normalized() - b.normalized()).norm(), (a.normalized() + b.normalized()).norm());
}

// yᵀP⁻¹y in long double.
long double form(const Matrix6<double>& shape, const Vector6<double>& y) {
  const Eigen::Matrix<long double, 6, 1> x = y.cast<long double>();
  return x.dot(Eigen::LLT<LongMatrix6>(shape.cast<long double>()).solve(x));
}

// A shape whose attitude axes are `radius` long at most, with attitude and rate so correlated that its correlation matrix
// has the condition given.
Matrix6<double> correlated_shape(Random& random, double radius, double condition) {
  Matrix6<double> shape = random.positive_definite<6>(condition);
  const double largest = Eigen::SelfAdjointEigenSolver<Matrix3<double>>(shape.topLeftCorner<3, 3>()).eigenvalues()(2);
  return shape * (radius * radius / largest);
}

// A point of the boundary; every other one where the attitude error is largest.
Vector6<double> boundary_point(Random& random, const Matrix6<double>& shape, bool extreme) {
  const Matrix6<double> l = Eigen::LLT<Matrix6<double>>(shape).matrixL();
  if (!extreme) {
    return l * random.unit_vector<6>();
  }
  Vector6<double> direction = Vector6<double>::Zero();
  direction.head<3>() =
      Eigen::SelfAdjointEigenSolver<Matrix3<double>>(shape.topLeftCorner<3, 3>()).eigenvectors().col(2);
  direction += 0.3 * random.uniform(0, 1) * random.unit_vector<6>();
  return l * (l.transpose() * direction).normalized();
}

}  // namespace

TEST_CASE("the slack of a cone is the angle's, about any center") {
  Random random(1);
  for (int trial = 0; trial < 3000; ++trial) {
    const double r = random.log_uniform(1e-3, 3.1);
    const Matrix3<double> center = random.rotation();
    const Vector3<double> e = random.unit_vector<3>();
    // Every other direction lies near the predicted one.
    const Vector3<double> b =
        trial % 2 == 0 ? random.unit_vector<3>()
                       : Vector3<double>(exp(Vector3<double>(r * random.in_ball<3>())) * (center.transpose() * e));
    Quadric<double, 3> quadric;
    REQUIRE(cone(center, Direction<double>::within(random.uniform(0.1, 9) * e, random.uniform(0.1, 9) * b, r),
                 quadric) == Status::ok);
    const Vector3<double> gamma = random.log_uniform(1e-3, 30) * random.unit_vector<3>();
    const Long3 seen = turn(gamma).transpose() * (center.transpose().cast<long double>() * e.cast<long double>());
    const long double angle = angle_between(seen, b.cast<long double>());
    const long double ratio = std::sin(angle / 2) / std::sin(static_cast<long double>(r) / 2);
    const long double expected = (1 + static_cast<long double>(gamma.squaredNorm()) / 4) * (1 - ratio * ratio);
    const double scale = (1 + gamma.squaredNorm()) / (r * r);
    CHECK(slack(quadric, gamma) == doctest::Approx(static_cast<double>(expected)).epsilon(1e-12 * scale));
    const auto bound = static_cast<long double>(r);
    if (std::abs(angle - bound) > 1e-12L) {
      CHECK(contains(quadric, gamma) == (angle < bound));
    }
  }
}

TEST_CASE("an attitude on the rim of a cone is inside it") {
  Random random(2);
  for (int trial = 0; trial < 20000; ++trial) {
    const double r = random.log_uniform(1e-12, 3);
    const Matrix3<double> center = random.rotation();
    const Vector3<double> gamma = random.log_uniform(1e-9, 10) * random.unit_vector<3>();
    const Vector3<double> e = random.unit_vector<3>();
    const Long3 seen = turn(gamma).transpose() * (center.transpose().cast<long double>() * e.cast<long double>());
    const Long3 across = seen.cross(random.unit_vector<3>().cast<long double>()).normalized();
    const Long3 b = std::cos(static_cast<long double>(r)) * seen + std::sin(static_cast<long double>(r)) * across;
    Quadric<double, 3> quadric;
    REQUIRE(cone(center, Direction<double>::within(e, b.cast<double>(), r), quadric) == Status::ok);
    const Long3 y = gamma.cast<long double>();
    const long double value = static_cast<long double>(quadric.c) - y.dot(quadric.a.cast<long double>() * y) -
                              2 * y.dot(quadric.g.cast<long double>());
    CHECK(value >= 0);
    // The same from the axis and the angle alone.
    const Direction<double> direction = Direction<double>::within(e, b.cast<double>(), r);
    double bound;
    REQUIRE(angle_bound(direction, bound) == Status::ok);
    Quadric<double, 3> by_angle;
    REQUIRE(cone(center, direction.reference, direction.body, bound, by_angle) == Status::ok);
    CHECK(by_angle.a == quadric.a);
    CHECK(by_angle.g == quadric.g);
    CHECK(by_angle.c == quadric.c);
    REQUIRE(cone(center, direction.reference, direction.body, r, by_angle) == Status::ok);
    const long double again = static_cast<long double>(by_angle.c) - y.dot(by_angle.a.cast<long double>() * y) -
                              2 * y.dot(by_angle.g.cast<long double>());
    CHECK(again >= 0);
  }
}

TEST_CASE("a cone is not made of what is no direction or no angle") {
  const Matrix3<double> center = Matrix3<double>::Identity();
  const Vector3<double> axis = Vector3<double>::UnitX();
  const Vector3<double> none = Vector3<double>::Zero();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinite = std::numeric_limits<double>::infinity();
  Quadric<double, 3> quadric{Matrix3<double>::Constant(7), Vector3<double>::Constant(7), 7};
  CHECK(cone(center, none, axis, 0.1, quadric) == Status::zero_direction);
  CHECK(cone(center, axis, none, 0.1, quadric) == Status::zero_direction);
  CHECK(cone(center, Vector3<double>(nan, 0, 0), axis, 0.1, quadric) == Status::not_finite);
  CHECK(cone(center, axis, Vector3<double>(0, infinite, 0), 0.1, quadric) == Status::not_finite);
  CHECK(cone(center, axis, axis, nan, quadric) == Status::not_finite);
  CHECK(cone(center, axis, axis, infinite, quadric) == Status::not_finite);
  CHECK(cone(center, axis, axis, -0.1, quadric) == Status::out_of_range);
  CHECK(cone(Matrix3<double>(nan * center), axis, axis, 0.1, quadric) == Status::not_finite);
  CHECK(quadric.c == 7);
  CHECK(cone(center, Vector3<double>(1e-300 * axis), Vector3<double>(1e300 * axis), 0.1, quadric) == Status::ok);
  CHECK(quadric.c == doctest::Approx(1));
}

TEST_CASE("the angle bound of a direction is sharp and holds") {
  Random random(3);
  for (int trial = 0; trial < 500; ++trial) {
    const Matrix3<double> bound = random.log_uniform(1e-4, 3) * random.positive_definite<3>(100.0);
    const Vector3<double> b = random.unit_vector<3>();
    double r;
    REQUIRE(angle_bound(Direction<double>{b, b, bound, 1}, r) == Status::ok);
    const Matrix3<double> across = Matrix3<double>::Identity() - b * b.transpose();
    const Eigen::SelfAdjointEigenSolver<Matrix3<double>> eigen(across * bound * across);
    CHECK(r * r == doctest::Approx(eigen.eigenvalues()(2)).epsilon(1e-12));
    const Matrix3<double> l = Eigen::LLT<Matrix3<double>>(bound).matrixL();
    for (int sample = 0; sample < 20; ++sample) {
      const Vector3<double> nu = l * random.unit_vector<3>();
      CHECK(angle_between((exp(nu) * b).cast<long double>(), b.cast<long double>()) <= r * (1 + 1e-12));
    }
  }
}

TEST_CASE("a cone of half a turn says nothing") {
  Quadric<double, 3> quadric;
  const Vector3<double> axis = Vector3<double>::UnitX();
  REQUIRE(cone(Matrix3<double>(Matrix3<double>::Identity()), Direction<double>::within(axis, -axis, pi), quadric) ==
          Status::ok);
  CHECK(quadric.a.norm() == 0);
  CHECK(quadric.g.norm() == 0);
  CHECK(quadric.c == 1);
}

TEST_CASE("recentring contains the set, and is nearly as small as it can be") {
  Random random(4);
  for (const double radius : {1e-9, 1e-3, 0.1, 0.5}) {
    for (const double condition : {10.0, 1e4}) {
      double worst_scaled = 0;
      double worst = 0;
      for (int trial = 0; trial < 300; ++trial) {
        const State center{random.rotation(), random.normal_matrix<3>()};
        Ellipsoid<double, 6> ellipsoid{Vector6<double>::Zero(), correlated_shape(random, radius, condition)};
        ellipsoid.center.head<3>() = random.uniform(0, 2) * random.unit_vector<3>();
        ellipsoid.center.tail<3>() = random.normal_matrix<3>();
        Gibbs result;
        REQUIRE(recentred(center, ellipsoid, result) == Status::ok);
        const Vector3<double> g = ellipsoid.center.head<3>() / 2;
        const Matrix3<double> b = (Matrix3<double>::Identity() - hat(g)) / (1 + g.squaredNorm());
        const double e = std::sqrt(g.dot(ellipsoid.shape.topLeftCorner<3, 3>() * g)) / (2 * (1 + g.squaredNorm()));
        Matrix6<double> t = Matrix6<double>::Identity();
        t.topLeftCorner<3, 3>() = b / (1 - e);
        const Matrix6<double> scaled = t * ellipsoid.shape * t.transpose();
        for (int sample = 0; sample < 20; ++sample) {
          // The error about the new center, in long double from both attitudes.
          const Vector6<double> offset = boundary_point(random, ellipsoid.shape, sample % 2 == 0);
          const Long3 g0 = ellipsoid.center.head<3>().cast<long double>() / 2;
          const Long3 dg = offset.head<3>().cast<long double>() / 2;
          // g⁺ = (g − ĝ − ĝ×g)/(1 + ĝ·g) of g = ĝ + dg
          const Long3 moved = (dg - g0.cross(dg)) / (1 + g0.dot(g0 + dg));
          Vector6<double> y;
          y << (2 * moved).cast<double>(), offset.tail<3>();
          worst = std::max(worst, static_cast<double>(form(result.shape, y)));
          worst_scaled = std::max(worst_scaled, static_cast<double>(form(scaled, y)));
        }
      }
      CHECK(worst <= 1);
      if (condition == 10.0) {
        CHECK(worst > (radius < 0.05 ? 0.99 : 0.6));
      }
      if (condition == 1e4 && radius == 0.5) {
        CHECK(worst_scaled > 1);  // scaling the attitude block alone is no bound
      }
    }
  }
}

TEST_CASE("a square of a thin shape is not less than it is, though its terms cancel") {
  Random random(44);
  int less = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    // Thin along g, and g along no axis: what is left of the terms is rounding.
    const Vector3<double> g = random.unit_vector<3>();
    const Vector3<double> across = g.cross(random.unit_vector<3>()).normalized();
    const Vector3<double> other = g.cross(across);
    const double thin = std::pow(10.0, random.uniform(-9, -2));
    const Matrix3<float> shape =
        Matrix3<double>(thin * thin * g * g.transpose() + across * across.transpose() + other * other.transpose())
            .cast<float>();
    const Vector3<float> along = g.cast<float>();
    const Vector3<double> exact_along = along.cast<double>();
    const Matrix3<double> exact_shape = symmetrized(Matrix3<double>(shape.cast<double>()));
    const double exact = exact_along.dot(exact_shape * exact_along);
    const Matrix3<float> symmetric = exact_shape.cast<float>();
    CHECK(static_cast<double>(detail::square_from_above(symmetric, along)) >= exact);
    less += static_cast<double>(along.dot(symmetric.lazyProduct(along))) < exact ? 1 : 0;
  }
  CHECK(less > 200);  // as calculated it often is
}

TEST_CASE("the projective change of center is that of the rotations") {
  Random random(5);
  for (int trial = 0; trial < 200; ++trial) {
    const State center{random.rotation(), random.normal_matrix<3>()};
    const double radius = 0.3;
    const Ellipsoid<double, 6> ellipsoid{random.normal_matrix<6>(), correlated_shape(random, radius, 100)};
    Gibbs result;
    REQUIRE(recentred(center, ellipsoid, result) == Status::ok);
    for (int sample = 0; sample < 10; ++sample) {
      const Vector6<double> y =
          ellipsoid.center + (1 - 1e-9) * boundary_point(random, ellipsoid.shape, sample % 2 == 0);
      const State state = retract<GibbsChart>(center, y);
      double value;
      REQUIRE(quadratic_form(result, state, value) == Status::ok);
      CHECK(value <= 1);
    }
  }
}

TEST_CASE("recentring refuses a set that may hold half turns") {
  const State center{Matrix3<double>::Identity(), Vector3<double>::Zero()};
  Ellipsoid<double, 6> ellipsoid{Vector6<double>::Zero(), Matrix6<double>::Identity() * 16.1};
  Gibbs result{center, Matrix6<double>::Identity()};
  CHECK(recentred(center, ellipsoid, result) == Status::ok);  // about its own center nothing changes
  ellipsoid.center(0) = 2;                                    // e = 4.01 · 1 / (2 · 2)
  result.shape.setIdentity();
  CHECK(recentred(center, ellipsoid, result) == Status::unbounded);
  CHECK(result.shape == Matrix6<double>::Identity());
  ellipsoid.shape(0, 0) = 15.9;
  CHECK(recentred(center, ellipsoid, result) == Status::ok);
  ellipsoid.center(0) = std::nan("");
  CHECK(recentred(center, ellipsoid, result) == Status::not_finite);
}

TEST_CASE("conversion between charts contains the set, where ignoring the difference or scaling does not") {
  Random random(6);
  double ignored = 0;
  double scaled = 0;
  for (const double radius : {1e-9, 0.01, 0.12, 0.5, 1.5, 3.0}) {
    double worst_in = 0;
    double worst_out = 0;
    for (int trial = 0; trial < 400; ++trial) {
      const State center{random.rotation(), random.normal_matrix<3>()};
      const Exponential exponential{center, correlated_shape(random, radius, 1e4)};
      Gibbs gibbs;
      REQUIRE(converted(exponential, gibbs) == Status::ok);
      Exponential back;
      const Gibbs same_numbers{center, exponential.shape};
      REQUIRE(converted(same_numbers, back) == Status::ok);
      const double stretch = 2 * std::tan(radius / 2) / radius;
      Matrix6<double> t = Matrix6<double>::Identity();
      t.topLeftCorner<3, 3>() *= stretch;
      const Matrix6<double> block_scaled = t * exponential.shape * t;
      for (int sample = 0; sample < 20; ++sample) {
        const Vector6<double> x = boundary_point(random, exponential.shape, sample % 2 == 0);
        const long double length = x.head<3>().cast<long double>().norm();
        Vector6<double> y = x;
        y.head<3>() *= static_cast<double>(2 * std::tan(length / 2) / length);
        worst_in = std::max(worst_in, static_cast<double>(form(gibbs.shape, y)));
        ignored = std::max(ignored, radius < 0.2 ? static_cast<double>(form(exponential.shape, y)) : 0.0);
        scaled = std::max(scaled, radius < 2 ? static_cast<double>(form(block_scaled, y)) : 0.0);
        y = x;
        y.head<3>() *= static_cast<double>(2 * std::atan(length / 2) / length);
        worst_out = std::max(worst_out, static_cast<double>(form(back.shape, y)));
      }
    }
    CHECK(worst_in <= 1);
    CHECK(worst_out <= 1);
    if (radius < 0.1) {
      CHECK(worst_in > 0.98);
      CHECK(worst_out > 0.98);
    }
  }
  CHECK(ignored > 1.02);
  CHECK(scaled > 1.5);
  Gibbs gibbs;
  CHECK(
      converted(Exponential{{Matrix3<double>::Identity(), Vector3<double>::Zero()}, 9.9 * Matrix6<double>::Identity()},
                gibbs) == Status::unbounded);
}

TEST_CASE("the extent of a Gibbs ellipsoid is in angles") {
  Random random(7);
  for (int trial = 0; trial < 100; ++trial) {
    const Gibbs gibbs{{random.rotation(), random.normal_matrix<3>()},
                      correlated_shape(random, random.uniform(0.1, 6), 100)};
    Extent<double> size;
    REQUIRE(extent(gibbs, size) == Status::ok);
    double largest = 0;
    for (int sample = 0; sample < 300; ++sample) {
      const State state = retract<GibbsChart>(gibbs.center, boundary_point(random, gibbs.shape, sample % 2 == 0));
      const Vector3<double> zeta = log(Matrix3<double>(gibbs.center.attitude.transpose() * state.attitude));
      largest = std::max(largest, zeta.norm());
      CHECK((zeta.cwiseAbs() - size.half_widths_body.head<3>()).maxCoeff() <= 1e-9);
      CHECK(((gibbs.center.attitude * zeta).cwiseAbs() - size.half_widths_reference).maxCoeff() <= 1e-9);
    }
    CHECK(largest <= size.largest_angle + 1e-9);
    CHECK(largest >= 0.97 * size.largest_angle);
    CHECK(size.largest_angle < pi);
  }
}

TEST_CASE("no number of an extent is less for rounding") {
  using Real = long double;
  using RealMatrix = Eigen::Matrix<Real, 3, 3>;
  Random random(17);
  int tight = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const Exponential set{{random.rotation(), random.normal_matrix<3>()},
                          correlated_shape(random, random.log_uniform(1e-6, 1), 100)};
    Extent<double> size;
    REQUIRE(extent(set, size) == Status::ok);
    const RealMatrix shape = set.shape.topLeftCorner<3, 3>().cast<Real>();
    const RealMatrix attitude = set.center.attitude.cast<Real>();
    const RealMatrix seen = attitude * shape * attitude.transpose();
    const Real largest = std::sqrt(Eigen::SelfAdjointEigenSolver<RealMatrix>(shape).eigenvalues()(2));
    CHECK(Real(size.largest_angle) >= largest);
    CHECK(Real(size.largest_angle) <= largest * (1 + 1e-13L));
    for (int i = 0; i < 3; ++i) {
      CHECK(Real(size.half_widths_body(i)) >= std::sqrt(shape(i, i)));
      CHECK(Real(size.half_widths_reference(i)) >= std::sqrt(seen(i, i)));
      tight += Real(size.half_widths_reference(i)) <= std::sqrt(seen(i, i)) * (1 + 1e-11L) ? 1 : 0;
    }
  }
  CHECK(tight > 5900);
  // Thin along an axis of the reference, where the entries of C P Cᵀ cancel.
  for (int trial = 0; trial < 300; ++trial) {
    const Matrix3<double> attitude = random.rotation();
    const double thin = random.log_uniform(3e-8, 1e-6);
    Matrix6<double> shape = Matrix6<double>::Identity();
    shape.topLeftCorner<3, 3>() = symmetrized(
        Matrix3<double>(attitude.transpose() * Vector3<double>(1, thin * thin, 0.3).asDiagonal() * attitude));
    Extent<double> size;
    REQUIRE(extent(Exponential{{attitude, Vector3<double>::Zero()}, shape}, size) == Status::ok);
    const RealMatrix seen =
        attitude.cast<Real>() * shape.topLeftCorner<3, 3>().cast<Real>() * attitude.cast<Real>().transpose();
    CHECK(Real(size.half_widths_reference(1)) >= std::sqrt(std::fmax(seen(1, 1), Real(0))));
  }
}

TEST_CASE("a measured attitude as a quadric about any center") {
  Random random(8);
  for (int trial = 0; trial < 400; ++trial) {
    const double radius = random.log_uniform(1e-6, 2.5);
    const Matrix3<double> shape = random.positive_definite<3>(100.0);
    const Matrix3<double> bound =
        shape * (radius * radius / Eigen::SelfAdjointEigenSolver<Matrix3<double>>(shape).eigenvalues()(2));
    const MeasuredAttitude<double> measured{random.rotation(), bound};
    const Matrix3<double> center = random.rotation();
    Quadric<double, 3> quadric;
    REQUIRE(to_quadric(center, measured, quadric) == Status::ok);
    const Matrix3<double> l = Eigen::LLT<Matrix3<double>>(bound).matrixL();
    const double size = quadric.a.norm() + 1;
    for (int sample = 0; sample < 20; ++sample) {
      const Vector3<double> nu = l * random.in_ball<3>();
      const Vector3<double> gamma = GibbsChart::error(center, Matrix3<double>(measured.attitude * exp(nu)));
      CHECK(slack(quadric, gamma) >= -1e-12 * size * (1 + gamma.squaredNorm()));
      // Exactly the ellipsoid in γ about the measured attitude, stretched by τ.
      const Vector3<double> own = GibbsChart::error(measured.attitude, Matrix3<double>(measured.attitude * exp(nu)));
      const double tau = 2 * std::tan(radius / 2) / radius;
      const double g = GibbsChart::error(center, measured.attitude).dot(gamma) / 4;
      const double expected = (1 + g) * (1 + g) * (1 - own.dot(bound.inverse() * own) / (tau * tau));
      CHECK(slack(quadric, gamma) == doctest::Approx(expected).epsilon(1e-10 * size * (1 + gamma.squaredNorm())));
    }
  }
  Quadric<double, 3> quadric;
  CHECK(to_quadric(Matrix3<double>(Matrix3<double>::Identity()),
                   MeasuredAttitude<double>{Matrix3<double>::Identity(), 10 * Matrix3<double>::Identity()},
                   quadric) == Status::ok);
  CHECK((quadric.a.isZero(0) && quadric.g.isZero(0) && quadric.c == 1));  // it holds everything
}

TEST_CASE("a linear measurement in the Gibbs chart keeps the errors that it holds in the exponential chart") {
  Random random(9);
  double ignored = 1;
  for (int trial = 0; trial < 300; ++trial) {
    const Gibbs predicted{{random.rotation(), random.normal_matrix<3>()}, correlated_shape(random, 1.0, 100)};
    const Vector6<double> y = boundary_point(random, predicted.shape, true);
    Vector6<double> x = y;
    x.head<3>() *= 2 * std::atan(y.head<3>().norm() / 2) / y.head<3>().norm();
    LinearMeasurement<double, 2> measurement;
    measurement.h = random.normal_matrix<2, 6>();
    measurement.bound = 0.01 * random.positive_definite<2>(4.0);
    const Matrix<double, 2> l = Eigen::LLT<Matrix<double, 2>>(measurement.bound).matrixL();
    measurement.y = measurement.h * x + (1 - 1e-9) * l * random.unit_vector<2>();
    Quadric<double, 6> quadric;
    REQUIRE(to_quadric(measurement, predicted, quadric) == Status::ok);
    CHECK(slack(quadric, y) >= 0);
    REQUIRE(to_quadric(measurement, quadric) == Status::ok);
    ignored = std::min(ignored, slack(quadric, y));
  }
  CHECK(ignored < -0.01);
}
