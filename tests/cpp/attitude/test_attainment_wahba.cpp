// Each term of the set about a sum of cones (theory, sections 15.3, 15.5 and 15.7), alone: sums with a slope as no solution of
// Wahba's problem has it, and sets in float whose truth is in long double (tests/mutations/wahba_set.toml).
#include <doctest/doctest.h>

#include <Eigen/Eigenvalues>
#include <elliptude/attitude/wahba_set.hpp>

#include "support/independent_flow.hpp"
#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

/// The boundary point (w, x), w ≥ 0, of xᵀNx − 2w Dᵀx = R along a direction, by bisection; zero length where there is none.
Vector3d boundary(const ConeSum<double>& sum, const Vector3d& direction) {
  const auto excess = [&](double length) {
    const Vector3d x = length * direction;
    return x.dot(sum.curvature * x) - 2 * std::sqrt(1 - length * length) * sum.slope.dot(x) - sum.level;
  };
  // From outside: the largest root.
  double outside = 1;
  double inside = 1;
  while (inside > 0 && excess(inside) > 0) {
    outside = inside;
    inside -= 1e-3;
  }
  for (int k = 0; k < 60 && inside > 0; ++k) {
    const double middle = (inside + outside) / 2;
    (excess(middle) > 0 ? outside : inside) = middle;
  }
  return std::fmax(inside, 0.0) * direction;
}

template <typename Chart>
Vector3d coordinates(const Vector3d& x) {
  const double sine = x.norm();
  const double cosine = std::sqrt(1 - sine * sine);
  const double length = std::is_same_v<Chart, GibbsChart> ? 2 * sine / cosine : 2 * std::atan2(sine, cosine);
  return sine > 0 ? Vector3d(length / sine * x) : Vector3d::Zero();
}

}  // namespace

TEST_CASE_TEMPLATE("the ellipsoid holds a sum of cones with any slope and touches it", Chart, ExponentialChart,
                   GibbsChart) {
  Random random(1);
  double worst = 0;
  for (int trial = 0; trial < 300; ++trial) {
    ConeSum<double> sum;
    sum.attitude.setIdentity();
    sum.curvature = random.symmetric<3>(Vector3d(random.uniform(1, 3), random.uniform(1, 3), 1));
    // Small, so that |w| is nearly one; a level from a negative one, which is not yet empty, to a large one.
    const Vector3d along = random.unit_vector<3>();
    sum.slope = random.log_uniform(1e-3, 3e-2) * along;
    const double square = sum.slope.dot(sum.curvature.inverse() * sum.slope);
    sum.level = square * (trial % 3 == 0 ? -0.5 : trial % 3 == 1 ? 0.0 : random.log_uniform(0.1, 10));
    sum.margin = 0;
    Ellipsoid<double, 3> set;
    REQUIRE(bounding_ellipsoid<Chart>(sum, set) == Status::ok);
    const Matrix3d metric = set.shape.inverse();
    for (int k = 0; k < 40; ++k) {
      const Vector3d towards =
          k == 0 ? Vector3d(sum.curvature.inverse() * sum.slope) : Vector3d(random.unit_vector<3>());
      const Vector3d y = coordinates<Chart>(boundary(sum, towards.normalized()));
      const double form = y.dot(metric * y);
      CHECK(form <= 1);
      worst = std::fmax(worst, form);
    }
  }
  CHECK(worst > 0.98);
}

TEST_CASE("what is not empty is not called so") {
  Ellipsoid<double, 3> set;
  // Half turns satisfy it: xᵀNx = −1 < R.
  ConeSum<double> turned{Matrix3d::Identity(), Vector3d(1, 1, -1).asDiagonal(), Vector3d::Zero(), -0.5, 0};
  CHECK(bounding_ellipsoid<GibbsChart>(turned, set) == Status::unbounded);
  // R < 0, but the slope makes up for it, and then not quite.
  const auto with_slope = [](double slope) {
    return ConeSum<double>{Matrix3d::Identity(), Matrix3d::Identity(), Vector3d(slope, 0, 0), -0.01, 0};
  };
  CHECK(bounding_ellipsoid<GibbsChart>(with_slope(0.1006), set) == Status::ok);  // D² = 0.01 · 1.01
  CHECK(bounding_ellipsoid<GibbsChart>(with_slope(0.1004), set) == Status::empty_intersection);
}

namespace {

RealMatrix turn_by(const RealVector& v) {
  const Real angle = v.norm();
  RealMatrix s;
  s << 0, -v(2), v(1), v(2), 0, -v(0), -v(1), v(0), 0;
  const Real a = angle > 1e-7L ? std::sin(angle) / angle : 1 - angle * angle / 6;
  const Real half = angle > 1e-7L ? std::sin(angle / 2) / angle : 0.5L;
  return RealMatrix::Identity() + a * s + 2 * half * half * s * s;
}

}  // namespace

TEST_CASE("sets in float hold every attitude in all cones") {
  Random random(3);
  int near = 0;
  int contradicted = 0;
  for (int trial = 0; trial < 60000; ++trial) {
    const int count = 2 + trial % 4;
    const RealMatrix truth = random.rotation().cast<Real>();
    RealMatrix exact = truth;
    for (int i = 0; i < 4; ++i) {
      exact = (exact + RealMatrix(exact.inverse().transpose())) / 2;
    }
    // Nearly collinear directions, orthogonal ones and others; bounds near the rounding and far from it.
    const double spread = trial % 3 == 0 ? random.log_uniform(2e-3, 0.1) : 1;
    const double size = random.log_uniform(1e-6, 0.3);
    const Vector3d line = random.unit_vector<3>();
    Matrix<float, 3, Eigen::Dynamic> reference(3, count);
    Matrix<float, 3, Eigen::Dynamic> body(3, count);
    Vector<float, Eigen::Dynamic> bounds(count);
    Vector<float, Eigen::Dynamic> weights(count);
    for (int i = 0; i < count; ++i) {
      const Vector3d e =
          spread < 1 ? Vector3d(line + spread * random.unit_vector<3>()) : Vector3d(random.unit_vector<3>());
      reference.col(i) = e.cast<float>();
      const RealVector seen = (exact.transpose() * reference.col(i).cast<Real>()).normalized();
      const RealVector axis = seen.cross(RealVector(random.unit_vector<3>().cast<Real>())).normalized();
      body.col(i) = (turn_by(RealVector(Real(size) * axis)) * seen).cast<float>();
      const RealVector stored = body.col(i).cast<Real>().normalized();
      const Real angle = 2 * std::asin(std::fmin(Real(1), (stored - seen).norm() / 2));
      // Exactly as large as it has to be, but for the rounding of the bound itself, upwards.
      bounds(i) = std::nextafter(static_cast<float>(angle), 4.0F);
      weights(i) = static_cast<float>(random.log_uniform(0.3, 3));
      if (!(bounds(i) > 0)) {
        bounds(i) = 1e-7F;
      }
    }
    WahbaSet<float> set;
    const Status status = wahba_set<GibbsChart>(reference, body, bounds, weights, set);
    contradicted += status == Status::empty_intersection ? 1 : 0;
    if (status != Status::ok) {
      continue;
    }
    RealMatrix center = set.attitude.cast<Real>();
    for (int i = 0; i < 4; ++i) {
      center = (center + RealMatrix(center.inverse().transpose())) / 2;
    }
    const RealMatrix r = center.transpose() * exact;
    const RealVector y = RealVector(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)) * (2 / (1 + r.trace()));
    const double form = static_cast<double>(y.dot(RealMatrix(set.error.shape.cast<Real>()).inverse() * y));
    CHECK(form <= 1);
    near += form > 0.9 ? 1 : 0;
  }
  CHECK(contradicted == 0);
  CHECK(near > 1000);
}

TEST_CASE("the curvatures of a sum of cones are lowered by what rounding may have added") {
  Random random(5);
  double added = 0;  // by rounding, in units of what is taken away
  for (int trial = 0; trial < 20000; ++trial) {
    const int count = 1 + trial % 6;
    Matrix<float, 3, Eigen::Dynamic> reference(3, count);
    Matrix<float, 3, Eigen::Dynamic> body(3, count);
    DirectionCones<float>::Weights weights{};
    const RealMatrix turned = random.rotation().cast<Real>();
    for (int i = 0; i < count; ++i) {
      // They have unit length, so that normalizing leaves them as they are, but for what is rounded.
      reference.col(i) = scalar::unit(Vector3<float>(random.unit_vector<3>().cast<float>()));
      const RealVector seen = turned.transpose() * reference.col(i).cast<Real>();
      body.col(i) = scalar::unit(Vector3<float>((seen + 0.1L * random.unit_vector<3>().cast<Real>()).cast<float>()));
      weights[static_cast<std::size_t>(i)] = i == 0 ? 1 : static_cast<float>(random.uniform(0.1, 1));
    }
    DirectionCones<float> cones;
    REQUIRE(DirectionCones<float>::make(reference, body, Vector<float, Eigen::Dynamic>::Constant(count, 0.1F), cones) ==
            Status::ok);
    ConeSum<float> sum;
    REQUIRE(cones.add_up(weights, sum) == Status::ok);
    RealMatrix exact = RealMatrix::Zero();
    Real total = 0;
    for (int i = 0; i < count; ++i) {
      const auto weight = static_cast<Real>(weights[static_cast<std::size_t>(i)]);
      const RealVector e = scalar::unit(Vector3<float>(reference.col(i))).cast<Real>();
      const RealVector b = scalar::unit(Vector3<float>(body.col(i))).cast<Real>();
      const RealVector predicted = sum.attitude.cast<Real>().transpose() * e;
      const RealMatrix product = predicted * b.transpose();
      exact += weight * (2 * predicted.dot(b) * RealMatrix::Identity() - product - product.transpose());
      total += weight;
    }
    const RealMatrix lowered = exact - sum.curvature.cast<Real>();
    const RealVector room = Eigen::SelfAdjointEigenSolver<RealMatrix>(lowered).eigenvalues();
    CHECK(room(0) >= 0);
    const Real taken = static_cast<Real>(rounding::share<float>(rounding::cone_sum(count))) * total;
    added = std::fmax(added, static_cast<double>(1 - room(0) / taken));
  }
  CHECK(added > 0.01);
}

TEST_CASE("the smaller of two sets is taken and a contradiction of found weights is told") {
  Random random(4);
  int smaller = 0;
  int told = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const Matrix3d truth = random.rotation();
    Matrix<double, 3, 5> reference;
    Matrix<double, 3, 5> body;
    Vector<double, 5> bounds;
    // Errors of the size of the bounds, or a little more, in all but two of them: contradictions that few weights show.
    const double factor = trial % 2 == 0 ? 1 : 1.5;
    for (int i = 0; i < 5; ++i) {
      reference.col(i) = random.unit_vector<3>();
      bounds(i) = random.log_uniform(0.02, 0.2);
      const Vector3d seen = truth.transpose() * reference.col(i);
      const Vector3d axis = seen.cross(random.unit_vector<3>()).normalized();
      body.col(i) = exp(Vector3d(factor * bounds(i) * axis)) * seen;
    }
    Vector<double, 5> weights;
    WahbaSet<double> found;
    const Status status = minimal_wahba_set<GibbsChart>(reference, body, bounds, WahbaCriterion::trace, weights, found);
    DirectionCones<double> cones;
    REQUIRE(DirectionCones<double>::make(reference, body, bounds, cones) == Status::ok);
    const auto first_weights = cones.weights_by_bound();
    Vector<double, 5> as_vector;
    for (int i = 0; i < 5; ++i) {
      as_vector(i) = first_weights[static_cast<std::size_t>(i)];
    }
    WahbaSet<double> first;
    const Status at_first = wahba_set<GibbsChart>(reference, body, bounds, as_vector, first);
    if (at_first == Status::ok && status == Status::ok) {
      CHECK(found.error.shape.trace() <= first.error.shape.trace() * (1 + 1e-12));
      smaller += found.error.shape.trace() < 0.9 * first.error.shape.trace() ? 1 : 0;
    }
    if (factor == 1) {
      CHECK(status != Status::empty_intersection);
    } else {
      told += at_first == Status::ok && status == Status::empty_intersection ? 1 : 0;
    }
  }
  CHECK(smaller > 100);
  CHECK(told >= 5);
}
