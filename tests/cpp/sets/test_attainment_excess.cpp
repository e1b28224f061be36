// By how much a fused set is larger than the combination that it is, a set of attitudes than its cones, and what is not called empty
// (theory, sections 7.4, 15.7 and 16.6): what rounding may do in the worst case is far above what it does, so it is the statement
// that is tested, against the same in long double.
#include <doctest/doctest.h>

#include <elliptude/attitude/wahba_set.hpp>
#include <elliptude/sets/quadric.hpp>
#include <elliptude/sets/quadric_fusion.hpp>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Real = long double;
using RealVector = Eigen::Matrix<Real, 3, 1>;
using RealMatrix = Eigen::Matrix<Real, 3, 3>;
using Fusion = QuadricFusion<double, 3>;
constexpr double epsilon = std::numeric_limits<double>::epsilon();
const Ellipsoid<double, 3> ball{Vector3d::Zero(), Matrix3d::Identity()};

/// A and N of the reported multipliers and the constraint as it was relaxed, within the unit ball.
struct Combination {
  RealMatrix a;
  RealVector center;
  Real level;

  Combination(const Fusion& fused, const Quadric<double, 3>& given) {
    Matrix3d factor = std::sqrt(1 + 24 * epsilon) * Matrix3d::Identity();
    const double rounding = (4 * (3 + 4) + 2) * epsilon;
    const auto seen =
        detail::relaxed<double, 3, 3>(given, factor, Vector3d::Zero(), Vector3d(factor.diagonal()), true, rounding);
    const auto first = static_cast<Real>(fused.predicted_multiplier);
    const auto second = static_cast<Real>(fused.multipliers[0]);
    a = second * seen.a.cast<Real>() + first * RealMatrix::Identity();
    const RealVector g = second * seen.g.cast<Real>();
    center = -a.inverse() * g;
    level = first + second * Real(seen.c) - g.dot(center);
  }
  [[nodiscard]] RealMatrix shape() const { return level * a.inverse(); }
};

Quadric<double, 3> slab(const Vector3d& normal, double middle, double width) {
  return {normal * normal.transpose(), -middle * normal, width * width - middle * middle};
}

}  // namespace

TEST_CASE("the level is raised by what the inversion may add") {
  Random random(1);
  for (int trial = 0; trial < 200; ++trial) {
    // A sharp ball inside the predicted one.
    const double sharp = random.log_uniform(1e3, 1e5);
    const Vector3d at = 0.3 * random.unit_vector<3>();
    const Quadric<double, 3> q{sharp * sharp * Matrix3d::Identity(), -sharp * sharp * at,
                               1 - sharp * sharp * at.squaredNorm()};
    Fusion fused;
    REQUIRE(minimal_intersection(&ball, &q, 1, SizeCriterion<double, 3>::volume(), fused) == Status::ok);
    REQUIRE(!fused.prediction_alone);
    const Combination exact(fused, q);
    const double excess = static_cast<double>(Real(fused.set.shape.trace()) / exact.shape().trace() - 1);
    const double stated = 40 * epsilon * static_cast<double>(exact.a.trace() / exact.level) * (1 + at.squaredNorm());
    CHECK(excess > 0.8 * stated);
    CHECK(excess < 1.3 * stated);
  }
}

TEST_CASE("the diagonal is raised by what the products may lose in a thin coordinate") {
  Random random(2);
  for (int trial = 0; trial < 200; ++trial) {
    // Nearly along the first axis, so that the other entries of its row are the level's part alone.
    const double thin = random.log_uniform(1e-4, 1e-2);
    const Vector3d normal = Vector3d(1, thin, random.uniform(-1, 1) * thin).normalized();
    Fusion fused;
    const Quadric<double, 3> q = slab(normal, random.uniform(-0.1, 0.1) * thin, thin);
    REQUIRE(minimal_intersection(&ball, &q, 1, SizeCriterion<double, 3>::volume(), fused) == Status::ok);
    REQUIRE(!fused.prediction_alone);
    const Combination exact(fused, q);
    const RealMatrix shape = exact.shape();
    const RealMatrix given = fused.set.shape.cast<Real>();
    const double excess = static_cast<double>(given(0, 0) / shape(0, 0) / (given(0, 1) / shape(0, 1)) - 1);
    const double spread = static_cast<double>(std::sqrt(shape.trace() / shape(0, 0)));
    CHECK(excess > 0.5 * 36 * epsilon * spread);
    CHECK(excess < 2 * 36 * epsilon * (1 + spread));
  }
}

TEST_CASE("what rounding could make empty is not called empty") {
  Random random(3);
  for (int trial = 0; trial < 500; ++trial) {
    const double sharp = random.log_uniform(10, 1e4);
    const auto at_gap = [&](double gap) {
      const Vector3d at = (1 + 1 / sharp + gap * epsilon * sharp) * random.unit_vector<3>();
      const Quadric<double, 3> q{sharp * sharp * Matrix3d::Identity(), -sharp * sharp * at,
                                 1 - sharp * sharp * at.squaredNorm()};
      Fusion fused;
      return minimal_intersection(&ball, &q, 1, SizeCriterion<double, 3>::volume(), fused);
    };
    CHECK(at_gap(120) == Status::ok);
    CHECK(at_gap(0.1 / (epsilon * sharp)) == Status::empty_intersection);
  }
}

TEST_CASE("where nothing is gained the prediction is the result and no larger set") {
  Random random(4);
  for (int trial = 0; trial < 200; ++trial) {
    // It helps as soon as its slack is less than a third of its trace, but then only by the square of what is missing.
    const Quadric<double, 3> q = slab(random.unit_vector<3>(), 0, std::sqrt((1 - random.log_uniform(1e-12, 1e-9)) / 3));
    Fusion fused;
    REQUIRE(minimal_intersection(&ball, &q, 1, SizeCriterion<double, 3>::volume(), fused) == Status::ok);
    CHECK(fused.set.shape.determinant() <= 1);
    CHECK(fused.prediction_alone);
  }
}

TEST_CASE_TEMPLATE("a ball and what touches it in one point: met at the first weight that is tried", Dimension,
                   std::integral_constant<int, 1>, std::integral_constant<int, 4>) {
  // Half a space that touches the ball where the search begins, in numbers that round nowhere: a level of exactly zero.
  constexpr int n = Dimension::value;
  Quadric<double, n> half_space{Matrix<double, n>::Zero(), Vector<double, n>::Zero(), -2};
  half_space.g(0) = 1;
  if (n > 1) {
    half_space.a(n - 1, n - 1) = 1;
  }
  const Ellipsoid<double, n> unit{Vector<double, n>::Zero(), Matrix<double, n>::Identity()};
  Intersection<double, n> result;
  REQUIRE(minimal_intersection(half_space, unit, SizeCriterion<double, n>::volume(), result) == Status::ok);
  CHECK(result.set.center(0) == -1);
  CHECK(result.set.shape.trace() == 0);
}

namespace {

/// What the eigenvalues of a matrix, as they are found, may be off by.
template <typename Scalar>
Scalar of_eigenvalues(const Matrix3<Scalar>& symmetric) {
  SymmetricEigen<Scalar, 3> eigen;
  REQUIRE(symmetric_eigen(symmetric, eigen) == Status::ok);
  return eigen_errors(symmetric, eigen).values;
}

/// How much longer the sum of the squared semi-axes is than of the same sum of cones, with curvatures lower by `lowered`, in long
/// double, whose rounding is nothing.
double excess_about(const Matrix3d& curvature, const Vector3d& slope, double level, double lowered) {
  const ConeSum<double> sum{Matrix3d::Identity(), curvature, slope, level, 0};
  // What long double lowers by itself is not lowered twice.
  const RealMatrix as_given = curvature.cast<Real>();
  const RealMatrix lower = as_given - (static_cast<Real>(lowered) - of_eigenvalues(as_given)) * RealMatrix::Identity();
  const ConeSum<Real> exact{RealMatrix::Identity(), lower, slope.cast<Real>(), static_cast<Real>(level), 0};
  Ellipsoid<double, 3> set;
  Ellipsoid<Real, 3> wanted;
  REQUIRE(bounding_ellipsoid<GibbsChart>(sum, set) == Status::ok);
  REQUIRE(bounding_ellipsoid<GibbsChart>(exact, wanted) == Status::ok);
  return static_cast<double>(set.shape.cast<Real>().trace() / wanted.shape.trace() - 1);
}

}  // namespace

TEST_CASE("the radius of a sum of cones is raised by its own rounding") {
  Random random(5);
  for (int trial = 0; trial < 200; ++trial) {
    // All three semi-axes of a ball are raised alike: by 16 of the radius, and of the longest by 16 and by twice the 6 that
    // eigenvectors are known to.
    const Matrix3d curvature = Matrix3d::Identity();
    const double level = random.log_uniform(1e-9, 1e-3);
    const double excess = excess_about(curvature, Vector3d::Zero(), level, of_eigenvalues(curvature));
    CHECK(excess > 40 * epsilon);
    CHECK(excess < 50 * epsilon);
  }
}

TEST_CASE("the curvatures of a sum of cones are lowered by what their eigenvalues may be off by") {
  Random random(7);
  for (int trial = 0; trial < 200; ++trial) {
    const double ratio = random.log_uniform(1e2, 1e4);
    const Matrix3d curvature = Vector3d(ratio * ratio, ratio * ratio, 1).asDiagonal();
    const double excess = excess_about(curvature, Vector3d::Zero(), 1e-9, 0);
    const double lowered = of_eigenvalues(curvature);
    CHECK(lowered > 8 * ratio * ratio * epsilon);
    CHECK(excess > 0.99 * lowered);
    CHECK(excess < 1.01 * lowered + 50 * epsilon);
  }
}

TEST_CASE("the slope of a sum of cones is raised by the rounding of the eigenvectors") {
  Random random(6);
  for (int trial = 0; trial < 200; ++trial) {
    // Along the shortest axis; what of it rounding turns to the longest counts there by the ratio of both.
    const double ratio = random.log_uniform(1e2, 1e5);
    const Matrix3d curvature = Vector3d(ratio * ratio, ratio * ratio, 1).asDiagonal();
    const double excess = excess_about(curvature, Vector3d(1e-3, 0, 0), 0, of_eigenvalues(curvature));
    CHECK(excess > 0.9 * 2 * 10 * epsilon * ratio);
    CHECK(excess < 1.1 * 2 * 10 * epsilon * ratio + 90 * epsilon);
  }
}
