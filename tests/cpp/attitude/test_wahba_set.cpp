// The exact uncertainty set of Wahba's problem, against the definition of a cone, a search over weights, and boundary points.
// tests/cpp/validation/wahba_set_escapes.cpp looks for counterexamples at length.
#include <doctest/doctest.h>

#include <array>
#include <limits>

#include "elliptude/attitude/wahba_set.hpp"
#include "support/random.hpp"
#include "support/search.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using Directions = Eigen::Matrix<double, 3, Eigen::Dynamic>;

struct Problem {
  Matrix3<double> truth;
  Directions reference;
  Directions body;
  Eigen::VectorXd bounds;
  Eigen::VectorXd weights;
};

// Each direction wrong by `share` of its bound, across itself.
Problem draw(Random& random, int count, double bound, double share) {
  Problem p;
  p.truth = random.rotation();
  p.reference.resize(3, count);
  p.body.resize(3, count);
  p.bounds.resize(count);
  p.weights.resize(count);
  for (int i = 0; i < count; ++i) {
    const Vector3<double> b = random.unit_vector<3>();
    const Vector3<double> axis = b.cross(random.unit_vector<3>()).normalized();
    p.bounds(i) = bound * random.uniform(0.5, 1.5);
    p.weights(i) = random.uniform(0.2, 2);
    p.reference.col(i) = random.uniform(0.1, 10) * p.truth * b;
    p.body.col(i) = random.uniform(0.1, 10) * (Eigen::AngleAxisd(share * p.bounds(i), axis) * b);
  }
  return p;
}

template <typename Chart>
Status set_of(const Problem& p, WahbaSet<double>& set) {
  return wahba_set<Chart>(p.reference, p.body, p.bounds, p.weights, set);
}

Matrix3<double> turn(double angle, const Vector3<double>& axis) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

}  // namespace

TEST_CASE("a sum of cones is their weighted slack exactly at any attitude") {
  Random random(1);
  for (int trial = 0; trial < 300; ++trial) {
    const Problem p = draw(random, 1 + trial % 6, random.uniform(0.01, 2), random.uniform(0, 3));
    ConeSum<double> sum;
    REQUIRE(cone_sum(p.reference, p.body, p.bounds, p.weights, sum) == Status::ok);
    const Eigen::VectorXd shares = p.weights / p.weights.maxCoeff();
    for (int k = 0; k < 10; ++k) {
      const Vector<double, 4> q = random.unit_vector<4>();
      const Vector3<double> x = q.tail<3>();
      const Matrix3<double> c = sum.attitude * Eigen::Quaterniond(q(0), x(0), x(1), x(2)).toRotationMatrix();
      double expected = 0;
      for (Eigen::Index i = 0; i < p.bounds.size(); ++i) {
        const double cosine = p.reference.col(i).normalized().dot(c * p.body.col(i).normalized());
        expected += shares(i) * (cosine - std::cos(p.bounds(i)));
      }
      const double slack = sum.level - x.dot(sum.curvature * x) + 2 * q(0) * sum.slope.dot(x);
      // On the safe side, and by no more than the roundings that are allowed for.
      CHECK(slack >= expected - 1e-15 * shares.sum());
      CHECK(slack <= expected + 4e-13 * shares.sum());
    }
  }
}

TEST_CASE_TEMPLATE("the ellipsoid holds the boundary of the sum and touches it", Chart, ExponentialChart, GibbsChart) {
  Random random(2);
  int bounded = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Problem p = draw(random, 2 + trial % 5, random.log_uniform(1e-3, 1), random.uniform(0, 0.9));
    ConeSum<double> sum;
    Ellipsoid<double, 3> error;
    REQUIRE(cone_sum(p.reference, p.body, p.bounds, p.weights, sum) == Status::ok);
    if (bounding_ellipsoid<Chart>(sum, error) != Status::ok) {
      continue;
    }
    ++bounded;
    CHECK(error.center == Vector3<double>::Zero());
    const auto form_on_boundary = [&](const Vector3<double>& axis) {
      const double half_angle = std::asin(std::sqrt(sum.level / axis.dot(sum.curvature * axis)));
      const double length = std::is_same_v<Chart, GibbsChart> ? 2 * std::tan(half_angle) : 2 * half_angle;
      double form = 0;
      REQUIRE(quadratic_form(error, Vector3<double>(length * axis), form) == Status::ok);
      return form;
    };
    for (int k = 0; k < 50; ++k) {
      const double form = form_on_boundary(random.unit_vector<3>());
      CHECK(form <= 1 + 1e-13);
      if (std::is_same_v<Chart, GibbsChart>) {
        CHECK(form == doctest::Approx(1).epsilon(1e-6));  // in this chart the set is the ellipsoid
      }
    }
    const Eigen::SelfAdjointEigenSolver<Matrix3<double>> eigen(sum.curvature);
    for (int j = 0; j < 3; ++j) {
      CHECK(form_on_boundary(eigen.eigenvectors().col(j)) == doctest::Approx(1).epsilon(1e-6));
    }
  }
  CHECK(bounded > 100);
}

TEST_CASE_TEMPLATE("attitudes in all cones are in the set", Chart, ExponentialChart, GibbsChart) {
  Random random(3);
  for (const double bound : {1e-9, 1e-6, 1e-3, 0.1, 0.5, 1.0}) {
    int sets = 0;
    double largest = 0;
    for (int trial = 0; trial < 300; ++trial) {
      Problem p = draw(random, 2 + trial % 7, bound, 1);
      if (trial % 3 == 0) {  // the same direction twice, measured twice
        p.reference.col(0) = p.reference.col(1);
        p.body.col(0) = turn(0.99 * p.bounds(0),
                             (p.truth.transpose() * p.reference.col(0)).cross(random.unit_vector<3>()).normalized()) *
                        p.truth.transpose() * p.reference.col(0);
      }
      if (trial % 4 == 0) {
        p.weights(p.weights.size() - 1) = 0;
      }
      WahbaSet<double> set;
      for (const int way : {0, 1, 2}) {
        Eigen::VectorXd weights = p.weights;
        const Status status = way == 0 ? set_of<Chart>(p, set)
                                       : minimal_wahba_set<Chart>(
                                             p.reference, p.body, p.bounds,
                                             way == 1 ? WahbaCriterion::trace : WahbaCriterion::volume, weights, set);
        if (status == Status::unbounded) {
          continue;
        }
        REQUIRE(status == Status::ok);
        ++sets;
        double form = 0;
        REQUIRE(quadratic_form(set.error, Chart::error(set.attitude, p.truth), form) == Status::ok);
        CHECK(form <= 1);
        CHECK(set.margin <= 1);
        largest = std::max(largest, form);
      }
    }
    CHECK(sets > 200);
    CHECK(largest > 0.99);
  }
}

TEST_CASE("nearly collinear directions are bounded as long as rounding allows") {
  Random random(4);
  for (const double spread : {1e-1, 1e-3, 1e-5, 1e-6, 1e-9}) {
    int bounded = 0;
    for (int trial = 0; trial < 100; ++trial) {
      const double bound = 1e-3 * spread;
      const Vector3<double> middle = random.unit_vector<3>();
      Problem p = draw(random, 3, bound, 0);
      p.bounds.setConstant(bound);
      for (int i = 0; i < 3; ++i) {
        const Vector3<double> b = (middle + spread * random.unit_vector<3>()).normalized();
        p.body.col(i) = b;
        p.reference.col(i) = p.truth * b;
      }
      WahbaSet<double> set;
      const Status status = set_of<ExponentialChart>(p, set);
      if (status == Status::ok) {
        ++bounded;
        CHECK(contains(set.error, ExponentialChart::error(set.attitude, p.truth)));
      } else {
        REQUIRE(status == Status::unbounded);
      }
    }
    CHECK(bounded >= (spread >= 1e-5 ? 90 : 0));
    CHECK(bounded <= (spread <= 1e-9 ? 0 : 100));
  }
}

TEST_CASE("weights that were found against a search over the only ratio there is") {
  Random random(5);
  int found_better = 0;
  for (int trial = 0; trial < 60; ++trial) {
    Problem p = draw(random, 2, 0.1, random.uniform(0, 1));
    p.bounds(1) *= random.log_uniform(0.1, 3);
    for (const WahbaCriterion criterion : {WahbaCriterion::trace, WahbaCriterion::volume}) {
      WahbaSet<double> set;
      Eigen::VectorXd weights(2);
      if (minimal_wahba_set<GibbsChart>(p.reference, p.body, p.bounds, criterion, weights, set) != Status::ok) {
        continue;
      }
      const auto size = [&](const Matrix3<double>& shape) {
        return criterion == WahbaCriterion::trace ? std::log(shape.trace()) : std::log(shape.determinant()) / 3;
      };
      const auto size_at = [&](long double log_ratio) -> long double {
        const Eigen::Vector2d tried(1, std::exp(static_cast<double>(log_ratio)));
        WahbaSet<double> other;
        return wahba_set<GibbsChart>(p.reference, p.body, p.bounds, tried, other) == Status::ok
                   ? static_cast<long double>(size(other.error.shape))
                   : HUGE_VALL;
      };
      const auto least = static_cast<double>(elliptude::testing::least_value(size_at, -20, 20, 400));
      CHECK(size(set.error.shape) >= least - 1e-9);
      CHECK(size(set.error.shape) <= least + 5e-3);
      const double first_ratio = std::log((1 - std::cos(p.bounds(0))) / (1 - std::cos(p.bounds(1))));
      const auto first = static_cast<double>(size_at(static_cast<long double>(first_ratio)));
      CHECK(size(set.error.shape) <= first + 1e-12);
      found_better += size(set.error.shape) < first - 1e-3 ? 1 : 0;
      CHECK(weights.maxCoeff() == 1);
      CHECK(weights.minCoeff() >= 0);
    }
  }
  CHECK(found_better > 10);
}

TEST_CASE("weights are found that exclude half turns where the first do not") {
  Random random(6);
  int rescued = 0;
  for (int trial = 0; trial < 500; ++trial) {
    const Problem p = draw(random, 3, 1, random.uniform(0.3, 1));
    Problem first = p;
    for (Eigen::Index i = 0; i < 3; ++i) {
      first.weights(i) = 1 / (1 - std::cos(p.bounds(i)));
    }
    WahbaSet<double> set;
    if (set_of<ExponentialChart>(first, set) != Status::unbounded) {
      continue;
    }
    Eigen::VectorXd weights(3);
    if (minimal_wahba_set<ExponentialChart>(p.reference, p.body, p.bounds, WahbaCriterion::trace, weights, set) ==
        Status::ok) {
      ++rescued;
      CHECK(contains(set.error, ExponentialChart::error(set.attitude, p.truth)));
    }
  }
  CHECK(rescued > 20);
}

TEST_CASE("contradictory directions are proved to be so") {
  Random random(7);
  int proved_by_ones = 0;
  int proved_by_search = 0;
  for (int trial = 0; trial < 200; ++trial) {
    // Two directions whose angle is measured wrong by a little more than both bounds together: no attitude fits.
    Problem p = draw(random, 2, 0.1, 0);
    const Vector3<double> b0 = p.body.col(0).normalized();
    const Vector3<double> b1 = p.body.col(1).normalized();
    if (std::abs(b0.dot(b1)) > 0.8) {
      continue;
    }
    const Vector3<double> axis = b0.cross(b1).normalized();
    const double excess = trial % 2 == 0 ? 1e-4 : -1e-4;
    p.body.col(1) = turn(p.bounds.sum() + excess, axis) * b1;
    WahbaSet<double> set;
    Eigen::VectorXd weights(2);
    p.weights.setOnes();
    const Status with_ones = set_of<ExponentialChart>(p, set);
    const Status with_search =
        minimal_wahba_set<ExponentialChart>(p.reference, p.body, p.bounds, WahbaCriterion::trace, weights, set);
    if (excess < 0) {
      CHECK(with_ones != Status::empty_intersection);
      CHECK(with_search == Status::ok);
      continue;
    }
    ++(with_search == Status::empty_intersection ? proved_by_search : proved_by_ones);
    ConeSum<double> sum;
    REQUIRE(cone_sum(p.reference, p.body, p.bounds, p.weights, sum) == Status::ok);
    CHECK((sum.margin < 0) == (with_ones == Status::empty_intersection));
  }
  CHECK(proved_by_search > 60);
  CHECK(proved_by_ones == 0);

  // One direction measured at opposite ends: L = 0, and no attitude is better than another.
  Problem opposite = draw(random, 2, 0.5, 0);
  opposite.weights.setOnes();
  opposite.reference.col(1) = opposite.reference.col(0);
  opposite.body.col(1) = -opposite.body.col(0);
  WahbaSet<double> set;
  CHECK(set_of<GibbsChart>(opposite, set) == Status::empty_intersection);
}

TEST_CASE("sets with half turns have no ellipsoid") {
  WahbaSet<double> set;
  const Vector3<double> e = Vector3<double>::UnitX();
  const Vector<double, 1> bound(0.1);
  const Vector<double, 1> weight(1);
  CHECK(wahba_set<ExponentialChart>(e, e, bound, weight, set) == Status::unbounded);
  Vector<double, 1> found;
  CHECK(minimal_wahba_set<GibbsChart>(e, e, bound, WahbaCriterion::trace, found, set) == Status::unbounded);
  // Two exact orthogonal axes: Davenport's matrix has the eigenvalues 2, 0, 0, -2, so half turns from 2(1 - cos r) = 2 on.
  const Matrix<double, 3, 2> axes = Matrix<double, 3, 2>::Identity();
  const Eigen::Vector2d ones(1, 1);
  constexpr double right_angle = 1.5707963267948966;
  CHECK(wahba_set<ExponentialChart>(axes, axes, Eigen::Vector2d(Eigen::Vector2d::Constant(right_angle - 1e-6)), ones,
                                    set) == Status::ok);
  CHECK(set.error.shape(0, 0) > 9.8);  // nearly π²
  CHECK(set.error.shape(0, 0) < 9.8697);
  CHECK(wahba_set<ExponentialChart>(axes, axes, Eigen::Vector2d(Eigen::Vector2d::Constant(right_angle + 1e-6)), ones,
                                    set) == Status::unbounded);
}

TEST_CASE("the scale of weights and the lengths of directions do not matter") {
  Random random(8);
  for (int trial = 0; trial < 50; ++trial) {
    const Problem p = draw(random, 4, 0.1, 0.8);
    Problem scaled = p;
    scaled.weights *= 1e12;
    scaled.reference *= 1e-200;
    scaled.body *= 1e200;
    WahbaSet<double> one;
    WahbaSet<double> other;
    REQUIRE(set_of<ExponentialChart>(p, one) == set_of<ExponentialChart>(scaled, other));
    CHECK((one.attitude - other.attitude).norm() <= 1e-13);
    CHECK((one.error.shape - other.error.shape).norm() <= 1e-10 * one.error.shape.norm());
    CHECK(one.margin == doctest::Approx(other.margin).epsilon(1e-12));
  }
}

TEST_CASE_TEMPLATE("other precisions", Scalar, float, long double) {
  Random random(9);
  for (int trial = 0; trial < 300; ++trial) {
    const double bound = random.log_uniform(1e-4, 0.5);
    // The truth is drawn in double, and must not be off its bounds by what a wider precision can see.
    const Problem p = draw(random, 2 + trial % 4, bound, std::is_same_v<Scalar, float> ? 1 : 1 - 1e-9);
    WahbaSet<Scalar> set;
    Vector<Scalar, Eigen::Dynamic> weights(p.bounds.size());
    const Status status = minimal_wahba_set<ExponentialChart>(p.reference.cast<Scalar>(), p.body.cast<Scalar>(),
                                                              Vector<Scalar, Eigen::Dynamic>(p.bounds.cast<Scalar>()),
                                                              WahbaCriterion::trace, weights, set);
    if (status == Status::unbounded) {
      continue;
    }
    REQUIRE(status == Status::ok);
    const Ellipsoid<double, 3> error{set.error.center.template cast<double>(), set.error.shape.template cast<double>()};
    double form = 0;
    REQUIRE(quadratic_form(error,
                           ExponentialChart::error(Matrix3<double>(set.attitude.template cast<double>()), p.truth),
                           form) == Status::ok);
    CHECK(form <= 1);
  }
}

TEST_CASE("bad input and what it leaves alone") {
  Random random(10);
  const Problem good = draw(random, 3, 0.1, 0.5);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const auto check = [&](const auto& change, Status expected) {
    Problem p = good;
    change(p);
    WahbaSet<double> set{};
    set.margin = 42;
    CHECK(set_of<ExponentialChart>(p, set) == expected);
    CHECK(set.margin == 42);
  };
  check([&](Problem& p) { p.reference(1, 1) = nan; }, Status::not_finite);
  check([&](Problem& p) { p.body(2, 0) = infinity; }, Status::not_finite);
  check([&](Problem& p) { p.bounds(1) = nan; }, Status::not_finite);
  check([&](Problem& p) { p.weights(2) = nan; }, Status::not_finite);
  check([&](Problem& p) { p.bounds(0) = 0; }, Status::out_of_range);
  check([&](Problem& p) { p.bounds(0) = -0.1; }, Status::out_of_range);
  check([&](Problem& p) { p.bounds(0) = 3.2; }, Status::out_of_range);
  check([&](Problem& p) { p.weights(0) = -1; }, Status::out_of_range);
  check([&](Problem& p) { p.weights.setZero(); }, Status::out_of_range);
  check([&](Problem& p) { p.weights.conservativeResize(2); }, Status::out_of_range);
  check([&](Problem& p) { p.bounds.conservativeResize(2); }, Status::out_of_range);
  check([&](Problem& p) { p.body.conservativeResize(3, 2); }, Status::out_of_range);
  check([&](Problem& p) { p = draw(random, 33, 0.1, 0.5); }, Status::out_of_range);
  check([&](Problem& p) { p.reference.col(1).setZero(); }, Status::zero_direction);
  check([&](Problem& p) { p.body.col(1).setZero(); }, Status::zero_direction);

  WahbaSet<double> set{};
  set.margin = 42;
  Eigen::VectorXd weights = Eigen::VectorXd::Constant(3, 7);
  const Eigen::VectorXd contradictory = Eigen::VectorXd::Constant(3, 1e-6);
  CHECK(minimal_wahba_set<GibbsChart>(good.reference, good.body, contradictory, WahbaCriterion::trace, weights, set) ==
        Status::empty_intersection);
  CHECK(weights == Eigen::VectorXd::Constant(3, 7));
  CHECK(set.margin == 42);
  Eigen::VectorXd few(2);
  CHECK(minimal_wahba_set<GibbsChart>(good.reference, good.body, good.bounds, WahbaCriterion::trace, few, set) ==
        Status::out_of_range);
}
