// Rounding of intersections: sets that spread far and nearly touch keep their common points, and sets that touch are not empty in
// either order. (theory, section 7.8)
#include <doctest/doctest.h>

#include "elliptude/elliptude.hpp"
#include "random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using Real = long double;
using Real6 = Matrix<Real, 6>;
using RealVector6 = Vector6<Real>;

/// Squared semi-axes over 10^±spread/2 about 10^magnitude, along the axes of a turned frame or in the coordinates.
Matrix6<double> spread_shape(Random& random, double magnitude, double spread) {
  Vector6<double> widths;
  for (int i = 0; i < 6; ++i) {
    widths(i) = std::pow(10.0, 0.5 * (magnitude + spread * random.uniform(-0.5, 0.5)));
  }
  Matrix6<double> factor = random.orthogonal<6>();
  if (random.uniform(0, 1) < 0.5) {
    factor = (factor * widths.asDiagonal()).eval();
  } else {
    factor = (widths.asDiagonal() * random.normal_matrix<6, 6>()).eval();
  }
  const Matrix6<double> shape = factor * factor.transpose();
  return 0.5 * (shape + shape.transpose());
}

/// After the diagonal is made one; in long double.
Real condition(const Matrix6<double>& shape) {
  const RealVector6 inverse = shape.diagonal().cast<Real>().cwiseSqrt().cwiseInverse();
  const Real6 scaled = inverse.asDiagonal() * shape.cast<Real>() * inverse.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Real6> eigen(scaled);
  return eigen.eigenvalues()(0) > 0 ? eigen.eigenvalues()(5) / eigen.eigenvalues()(0) : 1e30L;
}

Real form(const Matrix6<double>& shape, const RealVector6& x) {
  const Real6 l = shape.cast<Real>().llt().matrixL();
  return RealVector6(l.triangularView<Eigen::Lower>().solve(x)).squaredNorm();
}

}  // namespace

TEST_CASE("sets that spread far and nearly touch keep their common point") {
  Random random(5);
  int checked = 0;
  for (int trial = 0; trial < 6000; ++trial) {
    const double spread = random.uniform(9, 24);
    const Ellipsoid<double, 6> first{Vector6<double>::Zero(), spread_shape(random, 0, spread)};
    Ellipsoid<double, 6> second{Vector6<double>::Zero(), spread_shape(random, random.uniform(-5, 5), spread)};
    if (condition(first.shape) > 1e13L || condition(second.shape) > 1e13L) {
      continue;
    }
    // A point just within both, with opposite normals there.
    const Real inside = 1 - 1e-7L;
    const Real6 l1 = first.shape.cast<Real>().llt().matrixL();
    const Real6 l2 = second.shape.cast<Real>().llt().matrixL();
    const RealVector6 v = random.unit_vector<6>().cast<Real>();
    const RealVector6 normal = l1.transpose().triangularView<Eigen::Upper>().solve(v);
    const RealVector6 point = l1 * (inside * v);
    const RealVector6 toward = -RealVector6(l2.transpose() * normal).normalized();
    second.center = RealVector6(point - l2 * (inside * toward)).cast<double>();
    if (!(form(second.shape, point - second.center.cast<Real>()) <= 1)) {
      continue;  // lost when the center was rounded
    }
    ++checked;
    for (const auto& criterion : {SizeCriterion<double, 6>::volume(), SizeCriterion<double, 6>::trace()}) {
      Intersection<double, 6> result;
      REQUIRE(minimal_intersection(first, second, criterion, result) == Status::ok);
      REQUIRE(form(result.set.shape, point - result.set.center.cast<Real>()) <= 1 + 1e-6L);
    }
  }
  CHECK(checked > 2000);
}

TEST_CASE("sets that touch to rounding are not empty in either order") {
  Random random(6);
  int beyond = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const double r1 = random.log_uniform(1e-6, 1e6);
    const double r2 = random.log_uniform(1e-6, 1e6);
    const Vector3<double> direction = random.unit_vector<3>();
    const Ellipsoid<double, 3> first{Vector3<double>::Zero(), r1 * r1 * Matrix3<double>::Identity()};
    for (const double gap : {0.0, 1e-6}) {
      const Ellipsoid<double, 3> second{Vector3<double>((1 + gap) * (r1 + r2) * direction),
                                        r2 * r2 * Matrix3<double>::Identity()};
      const Status expected = gap > 0 ? Status::empty_intersection : Status::ok;
      double margin = 1;
      double other = 1;
      REQUIRE(overlap_margin(first, second, margin) == Status::ok);
      REQUIRE(overlap_margin(second, first, other) == Status::ok);
      if (gap > 0) {
        REQUIRE(margin < 0);
        REQUIRE(other < 0);
        ++beyond;
      } else {
        REQUIRE(margin >= 0);
        REQUIRE(other >= 0);
        REQUIRE(margin < 1e-6);
      }
      Intersection<double, 3> result;
      const auto criterion = SizeCriterion<double, 3>::trace();
      REQUIRE(minimal_intersection(first, second, criterion, result) == expected);
      REQUIRE(minimal_intersection(second, first, criterion, result) == expected);
    }
  }
  CHECK(beyond == 3000);
}
