/// The coordinates in which the search for the smallest combination of two sets begins: derivatives against direct formulas and differences in
/// long double, and the q that they lead to (theory, section 7.4).

#include <doctest/doctest.h>

#include <elliptude/sets/intersection.hpp>

#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using Real = long double;

template <int N>
using RealMatrix = Eigen::Matrix<Real, N, N>;
template <int N>
using RealVector = Eigen::Matrix<Real, N, 1>;

/// A problem M, v, k with weights W' of a given scalar type, and what is to be found of it, calculated in long double as (7.5) says.
template <typename Scalar, int N>
struct Case {
  Matrix<Scalar, N> m;
  Vector<Scalar, N> v;
  Matrix<Scalar, N> factor;
  Scalar slack_at_origin;
  SizeCriterion<Scalar, N> criterion;

  struct At {
    Real level;
    Real size;
    Real slope;
    Real curvature;
  };
  [[nodiscard]] At at(Real q) const {
    const RealMatrix<N> a = m.template cast<Real>() + q * RealMatrix<N>::Identity();
    const RealMatrix<N> inverse = a.fullPivLu().inverse();
    const RealVector<N> u = -inverse * v.template cast<Real>();
    const RealMatrix<N> l = factor.template cast<Real>();
    const RealMatrix<N> w = l.transpose() * criterion.weight.template cast<Real>() * l;
    At result;
    const Real determinant = a.determinant();
    result.level = Real(slack_at_origin) + q - u.dot(v.template cast<Real>());
    const Real first = (1 - u.squaredNorm()) / result.level;
    const Real second = 2 * u.dot(inverse * u) / result.level - first * first;
    if (criterion.kind == SizeCriterion<Scalar, N>::Kind::volume) {
      result.size = N * std::log(result.level) - std::log(determinant);
      result.slope = N * first - inverse.trace();
      result.curvature = N * second + inverse.squaredNorm();
    } else {
      const Real trace = (w * inverse).trace();
      const Real change = -(w * inverse * inverse).trace() / trace;
      result.size = std::log(result.level) + std::log(trace);
      result.slope = first + change;
      result.curvature = second + 2 * (w * inverse * inverse * inverse).trace() / trace - change * change;
    }
    return result;
  }
  [[nodiscard]] detail::RelativeSize<Scalar, N> relative_size() const {
    return {factor, Vector<Scalar, N>::Ones(), criterion};
  }
  [[nodiscard]] detail::ReducedSize<Scalar, N> reduced(Scalar unit) const {
    return {m, v, slack_at_origin, relative_size(), unit};
  }
};

/// Two sets that meet: eigenvalues of M spread over `aspect`, some of them zero, and the second's center in the first set.
template <typename Scalar, int N>
Case<Scalar, N> random_case(Random& random, double aspect, int zeros, int criterion) {
  Eigen::Matrix<double, N, 1> values;
  for (int i = 0; i < N; ++i) {
    values(i) = i < zeros ? 0 : random.log_uniform(1 / std::sqrt(aspect), std::sqrt(aspect));
  }
  Eigen::Matrix<double, N, N> b = values.cwiseSqrt().asDiagonal();
  b = b * random.orthogonal<N>();
  const Eigen::Matrix<double, N, 1> w = 0.9 * random.in_ball<N>();
  using Criterion = SizeCriterion<Scalar, N>;
  Case<Scalar, N> result;
  result.m = (b.transpose() * b).template cast<Scalar>();
  result.v = (b.transpose() * w).template cast<Scalar>();
  result.factor = Eigen::Matrix<double, N, N>(random.normal_matrix<N, N>().template triangularView<Eigen::Lower>())
                      .template cast<Scalar>();
  result.slack_at_origin = static_cast<Scalar>(1 - w.squaredNorm());
  result.criterion = criterion == 0 ? Criterion::trace()
                     : criterion == 1
                         ? Criterion::volume()
                         : Criterion::weighted_trace(random.positive_definite<N>(10).template cast<Scalar>());
  return result;
}

/// Compares the reduced derivatives of 100 cases with the direct ones, in units of q, to `tolerance`, and those with differences.
template <typename Scalar, int N>
void derivatives_agree(double aspect, int zeros, Real tolerance) {
  Random random(17);
  for (int k = 0; k < 100; ++k) {
    const Case<Scalar, N> problem = random_case<Scalar, N>(random, aspect, zeros, k % 3);
    const Scalar unit = static_cast<Scalar>(random.log_uniform(0.1, 10));
    const auto reduced = problem.reduced(unit);
    const Scalar q = static_cast<Scalar>(random.log_uniform(1e-2, 1e2));
    Scalar slope;
    Scalar curvature;
    REQUIRE(reduced.derivatives(q, slope, curvature));
    const Real whole = Real(q) * Real(unit);
    const auto direct = problem.at(whole);
    CAPTURE(k);
    CHECK(std::fabs(Real(slope) * Real(q) - direct.slope * whole) < tolerance);
    CHECK(std::fabs(Real(curvature) * Real(q) * Real(q) - direct.curvature * whole * whole) < tolerance);
    const Real step = 1e-5L * whole;
    const auto above = problem.at(whole + step);
    const auto below = problem.at(whole - step);
    CHECK(std::fabs((above.size - below.size) / (2 * step) - direct.slope) * whole < 1e-7L);
    CHECK(std::fabs((above.slope - below.slope) / (2 * step) - direct.curvature) * whole * whole < 1e-7L);
  }
}

}  // namespace

TEST_CASE("a reflection turns a vector into the last unit vector, and a matrix as a product does") {
  Random random(2);
  for (int k = 0; k < 100; ++k) {
    Eigen::Vector4d x = random.normal_matrix<4>();
    x(3) = k % 3 == 0 ? 0 : x(3);
    x = k % 10 == 0 ? Eigen::Vector4d(Eigen::Vector4d::Zero()) : x;
    const detail::Reflection<double, 4> reflection(x);
    Eigen::Matrix<double, 6, 6> h = Eigen::Matrix<double, 6, 6>::Identity();
    h.topLeftCorner<4, 4>() -= reflection.scale * reflection.axis * reflection.axis.transpose();
    CHECK((h * h - Eigen::Matrix<double, 6, 6>::Identity()).norm() < 1e-14);
    CHECK((h.topLeftCorner<4, 4>() * x - reflection.image * Eigen::Vector4d::Unit(3)).norm() < 1e-14);
    Eigen::Matrix<double, 6, 6> s = random.positive_definite<6>(10);
    const Eigen::Matrix<double, 6, 6> expected = h * s * h;
    const Eigen::Matrix<double, 6, 6> before = s;
    reflection.turn(s);
    CHECK((s - expected).norm() < 1e-13);
    // The same in loops.
    Eigen::Matrix<double, 6, 1> longer = Eigen::Matrix<double, 6, 1>::Zero();
    longer.head<4>() = x;
    const detail::LoopedReflection<double, 6> looped(longer, 4);
    CHECK(std::fabs(looped.image - reflection.image) < 1e-14);
    CHECK(std::fabs(looped.scale - reflection.scale) <= 1e-14 * reflection.scale);  // not a number fails, too
    Eigen::Matrix<double, 6, 6> turned = before;
    looped.turn(6, turned);
    CHECK((turned - expected).norm() < 1e-13);
  }
}

TEST_CASE("slopes by minors of a tridiagonal matrix are those of the size") {
  derivatives_agree<double, 6>(10, 0, 1e-12L);
  derivatives_agree<double, 6>(1e12, 0, 1e-6L);  // needles: M has as few digits there
  derivatives_agree<double, 6>(10, 3, 1e-12L);   // three coordinates of which the first set says nothing
  derivatives_agree<double, 6>(10, 5, 1e-12L);
  derivatives_agree<double, 3>(100, 0, 1e-12L);
  derivatives_agree<double, 2>(100, 1, 1e-12L);
  derivatives_agree<double, 1>(10, 0, 1e-12L);
  derivatives_agree<float, 6>(10, 0, 1e-3L);
  derivatives_agree<float, 3>(10, 1, 1e-3L);
}

TEST_CASE("where the determinant or the level is negative, the slopes say so") {
  Random random(3);
  double slope;
  double curvature;
  for (int k = 0; k < 100; ++k) {
    Case<double, 6> problem = random_case<double, 6>(random, 10, 0, k % 3);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(problem.m);
    problem.slack_at_origin = 1e6;
    problem.m.diagonal().array() -= 2 * eigen.eigenvalues()(0);
    if (eigen.eigenvalues()(1) > 1.1 * eigen.eigenvalues()(0)) {  // not two of them negative
      CHECK_FALSE(problem.reduced(1).derivatives(0.99 * eigen.eigenvalues()(0), slope, curvature));
    }
    CHECK(problem.reduced(1).derivatives(1.01 * eigen.eigenvalues()(0), slope, curvature));
    const double q = 2 * eigen.eigenvalues()(0);
    problem.slack_at_origin -= static_cast<double>(problem.at(Real(q)).level) + 1e-6;
    CHECK_FALSE(problem.reduced(1).derivatives(q, slope, curvature));
    problem.slack_at_origin += 2e-6;
    CHECK(problem.reduced(1).derivatives(q, slope, curvature));
  }
}

TEST_CASE("the search begins at the best q") {
  Random random(4);
  int inner = 0;
  int at_first = 0;
  int elsewhere = 0;
  for (int k = 0; k < 3000; ++k) {
    const double aspect = random.log_uniform(1, k % 2 == 0 ? 10 : 1e6);
    Case<double, 6> problem = random_case<double, 6>(random, aspect, 0, k % 3);
    const double scale = random.log_uniform(1e-2, 1e2);
    problem.m *= scale;
    problem.v *= std::sqrt(scale);
    const auto slack = [&](const Vector6<double>& u) {
      return problem.slack_at_origin - u.dot(problem.m * u) - 2 * problem.v.dot(u);
    };
    const Vector6<double> present = Vector6<double>::Ones();
    const detail::Problem<double, 6, decltype(slack)> whole{problem.m, problem.v, present, slack};
    const auto size = problem.relative_size();
    const double typical = whole.typical_weight();
    const double q = detail::start_of_search(whole, size, typical);
    CAPTURE(k);
    if (problem.slack_at_origin >= size.idle_slack(problem.m)) {
      CHECK(q == typical);
    } else if (problem.at(0).slope >= 0) {
      CHECK(q == typical);
      ++at_first;
    } else if (q == typical) {
      ++elsewhere;  // the steps did not arrive
    } else {
      // Newton's step in log q from there is short.
      const auto there = problem.at(Real(q));
      const Real slope = there.slope * Real(q);
      const Real curvature = slope + there.curvature * Real(q) * Real(q);
      CHECK(curvature > 0);
      CHECK(std::fabs(slope) < 1e-8L * curvature);
      ++inner;
    }
  }
  CHECK(inner > 500);
  CHECK(at_first > 100);
  CHECK(elsewhere < 5);
}

TEST_CASE("in float the search does not begin where the least size is rounding") {
  Random random(11);
  int moved = 0;
  Real longest = 0;
  for (int k = 0; k < 20000; ++k) {
    // The second set is hardly better with the first than alone: the best q is large, and the size flat there.
    Case<float, 6> problem = random_case<float, 6>(random, random.log_uniform(1, 1e4), 0, k % 3);
    const auto size = problem.relative_size();
    const float scale =
        problem.slack_at_origin / size.idle_slack(problem.m) * static_cast<float>(1 + random.log_uniform(1e-6, 1e-1));
    problem.m *= scale;
    problem.v *= std::sqrt(scale);
    const auto slack = [&](const Vector6<float>& u) {
      return problem.slack_at_origin - u.dot(problem.m * u) - 2 * problem.v.dot(u);
    };
    const Vector6<float> present = Vector6<float>::Ones();
    const detail::Problem<float, 6, decltype(slack)> whole{problem.m, problem.v, present, slack};
    const float typical = whole.typical_weight();
    const float q = detail::start_of_search(whole, size, typical);
    if (q != typical) {
      ++moved;
      const auto there = problem.at(Real(q));
      const Real slope = there.slope * Real(q);
      const Real curvature = slope + there.curvature * Real(q) * Real(q);
      longest = std::fmax(longest, curvature > 0 ? std::fabs(slope) / curvature : 1);
    }
  }
  MESSAGE("of " << moved << " the longest step in log q from there " << longest);
  CHECK(moved > 500);
  CHECK(longest < 0.05L);
}
