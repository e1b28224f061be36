// Quadrics and what they have in common with an ellipsoid, against closed forms, against a search over the multiplier in
// long double, and against points of both sets.
#include <doctest/doctest.h>

#include <array>
#include <limits>

#include "elliptude/sets/quadric.hpp"
#include "support/random.hpp"
#include "support/search.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

// The size is dynamic, because each fixed size takes long to compile.
using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
using LongVector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
template <int N>
using Criterion = SizeCriterion<double, N>;

template <int N>
Ellipsoid<double, N> unit_ball() {
  return {Vector<double, N>::Zero(), Matrix<double, N>::Identity()};
}

template <int N>
long double size_of(const LongMatrix& shape, const Criterion<N>& criterion) {
  if (criterion.kind == Criterion<N>::Kind::volume) {
    return std::log(Eigen::PartialPivLU<LongMatrix>(shape).determinant());
  }
  return std::log((criterion.weight.template cast<long double>() * shape).trace());
}

// The least criterion over the family A = A₁ + qA₂ ≻ 0 (theory, section 6), and of the ellipsoid alone.
template <int N>
long double smallest_by_search(const Quadric<double, N>& quadric, const Ellipsoid<double, N>& ellipsoid,
                               const Criterion<N>& criterion) {
  const LongMatrix inverse = Eigen::PartialPivLU<LongMatrix>(ellipsoid.shape.template cast<long double>()).inverse();
  const LongVector origin = ellipsoid.center.template cast<long double>();
  // About the ellipsoid's center, where nothing cancels.
  const LongMatrix m = quadric.a.template cast<long double>();
  const LongVector v = m * origin + quadric.g.template cast<long double>();
  const long double k = static_cast<long double>(quadric.c) - origin.dot(m * origin) -
                        2 * origin.dot(quadric.g.template cast<long double>());
  const auto value = [&](long double log_q) {
    const long double q = std::exp(log_q);
    const LongMatrix a = m + q * inverse;
    const Eigen::LLT<LongMatrix> factor(a);
    if (factor.info() != Eigen::Success) {
      return HUGE_VALL;
    }
    const long double level = k + q + v.dot(factor.solve(v));
    return size_of<N>(LongMatrix(level * factor.solve(LongMatrix::Identity(N, N))), criterion);
  };
  return std::min(testing::least_value(value, -25.0L, 25.0L, 2000),
                  size_of<N>(ellipsoid.shape.template cast<long double>(), criterion));
}

// The cone ∠(y, axis) ≤ r of a direction, about any point within, and its other nappe: yᵀ(cos²r I − aaᵀ)y ≤ 0.
Quadric<double, 3> cone(const Vector3<double>& axis, double r) {
  return {std::cos(r) * std::cos(r) * Matrix3<double>::Identity() - axis * axis.transpose(), Vector3<double>::Zero(),
          0};
}

template <int N>
Criterion<N> any_criterion(Random& random, int which) {
  switch (which % 3) {
    case 0:
      return Criterion<N>::trace();
    case 1:
      return Criterion<N>::volume();
    default:
      return Criterion<N>::weighted_trace(random.positive_definite<N>(100));
  }
}

// Random quadrics that hold `common`: definite, indefinite, flat in some directions, linear.
template <int N>
Quadric<double, N> quadric_about(Random& random, const Vector<double, N>& common, int kind) {
  Vector<double, N> eigenvalues = random.normal_matrix<N>();
  if (kind % 4 == 1) {
    eigenvalues = eigenvalues.cwiseMax(0).eval();
  } else if (kind % 4 == 2) {
    eigenvalues = eigenvalues.cwiseAbs().eval();
  } else if (kind % 4 == 3) {
    eigenvalues.setZero();
  }
  Quadric<double, N> q{random.symmetric<N>(eigenvalues), random.normal_matrix<N>(), 0};
  q.c = -slack(q, common) + random.log_uniform(1e-3, 1);
  return q;
}

template <int N>
void check_random(int draws) {
  Random random(81);
  int visited = 0;
  for (int i = 0; i < draws; ++i) {
    const Vector<double, N> common = random.normal_matrix<N>();
    Ellipsoid<double, N> e;
    e.shape = random.log_uniform(0.3, 3) * random.positive_definite<N>(30);
    const Matrix<double, N> root = e.shape.llt().matrixL();
    e.center = common + root * (0.98 * random.in_ball<N>());
    const Quadric<double, N> q = quadric_about<N>(random, common, i);
    const Criterion<N> criterion = any_criterion<N>(random, i / 4);
    Intersection<double, N> result;
    CAPTURE(i);
    REQUIRE(minimal_intersection(q, e, criterion, result) == Status::ok);

    const long double size = size_of<N>(result.set.shape.template cast<long double>(), criterion);
    const long double least = smallest_by_search(q, e, criterion);
    REQUIRE(static_cast<double>(size - least) <= 1e-9);
    REQUIRE(static_cast<double>(size - least) >= -1e-9);
    REQUIRE(static_cast<double>(size - size_of<N>(e.shape.template cast<long double>(), criterion)) <= 1e-12);

    const Eigen::LLT<LongMatrix> factor(result.set.shape.template cast<long double>());
    const auto form = [&](const Vector<double, N>& x) {
      const LongVector rest = x.template cast<long double>() - result.set.center.template cast<long double>();
      return static_cast<double>(rest.dot(factor.solve(rest)));
    };
    REQUIRE(form(common) <= 1 + 1e-9);
    for (int k = 0; k < 300; ++k) {
      // From the common point outwards in the ellipsoid, and kept where the quadric allows it.
      const Vector<double, N> far = e.center + root * random.unit_vector<N>();
      const Vector<double, N> x = common + random.uniform(0, 1) * (far - common);
      if (contains(q, x)) {
        ++visited;
        REQUIRE(form(x) <= 1 + 1e-9);
      }
    }
  }
  CHECK(visited > 20 * draws);
}

}  // namespace

TEST_CASE("a quadric made of an ellipsoid holds the same points and gives the ellipsoid back") {
  Random random(82);
  for (int i = 0; i < 100; ++i) {
    const Ellipsoid<double, 3> e{random.normal_matrix<3>(), random.positive_definite<3>(100)};
    Quadric<double, 3> q;
    REQUIRE(to_quadric(e, q) == Status::ok);
    const Matrix3<double> root = e.shape.llt().matrixL();
    const Vector3<double> u = random.unit_vector<3>();
    REQUIRE(contains(q, Vector3<double>(e.center + 0.999999 * (root * u))));
    REQUIRE_FALSE(contains(q, Vector3<double>(e.center + 1.000001 * (root * u))));
    REQUIRE(std::abs(slack(q, e.center) - 1) <= 1e-12);
    q.a *= 7;  // a quadric is the same set in any multiple
    q.g *= 7;
    q.c *= 7;
    Ellipsoid<double, 3> back;
    REQUIRE(to_ellipsoid(q, back) == Status::ok);
    REQUIRE((back.center - e.center).norm() <= 1e-12 * (1 + e.center.norm()));
    // Larger by what rounding may have done to the inverse, a share of 24ε κ², and no less (theory, section 17.8).
    REQUIRE((back.shape - e.shape).norm() <= 1e-10 * e.shape.norm());
    REQUIRE((back.shape - e.shape).trace() >= 0);
  }
}

TEST_CASE("pullback sees the same set in other coordinates") {
  Random random(83);
  for (int i = 0; i < 100; ++i) {
    const Quadric<double, 3> q = quadric_about<3>(random, random.normal_matrix<3>(), i);
    const Matrix<double, 3, 2> transform = random.normal_matrix<3, 2>();
    const Vector3<double> shift = random.normal_matrix<3>();
    const Quadric<double, 2> seen = pullback(q, transform, shift);
    const Vector<double, 2> z = random.normal_matrix<2>();
    const double exact = slack(q, Vector3<double>(transform * z + shift));
    REQUIRE(std::abs(slack(seen, z) - exact) <= 1e-13 * (10 + std::abs(exact)));
    REQUIRE(seen.a == seen.a.transpose());
    const Matrix<double, 3, 6> selection = Matrix<double, 3, 6>::Identity();
    const Vector6<double> y = random.normal_matrix<6>();
    REQUIRE(std::abs(slack(pullback(q, selection, Vector3<double>(Vector3<double>::Zero())), y) -
                     slack(q, Vector3<double>(y.head<3>()))) <= 1e-13);
  }
}

TEST_CASE("a slab holds what lies between its planes") {
  Quadric<double, 3> q;
  REQUIRE(slab(Vector3<double>(0, 0, 2), 3.0, 1.0, q) == Status::ok);  // 2 ≤ 2z ≤ 4
  CHECK(contains(q, Vector3<double>(100, -100, 1)));
  CHECK(contains(q, Vector3<double>(100, -100, 2)));
  CHECK_FALSE(contains(q, Vector3<double>(0, 0, 0.999999)));
  CHECK_FALSE(contains(q, Vector3<double>(0, 0, 2.000001)));
}

TEST_CASE("a ball cut by two planes has the volume of the ellipsoid method") {
  // Parallel cuts at ±α of the unit ball, α < 1/√n: semi-axes α√n across and √(n(1−α²)/(n−1)) along (Bland, Goldfarb, Todd).
  constexpr int n = 6;
  for (const double alpha : {0.01, 0.1, 0.3, 0.4}) {
    Quadric<double, n> q;
    REQUIRE(slab(Vector<double, n>(Vector<double, n>::Unit(2)), 0.0, alpha, q) == Status::ok);
    Intersection<double, n> result;
    REQUIRE(minimal_intersection(q, unit_ball<n>(), Criterion<n>::volume(), result) == Status::ok);
    Vector<double, n> exact = Vector<double, n>::Constant(n * (1 - alpha * alpha) / (n - 1));
    exact(2) = n * alpha * alpha;
    CAPTURE(alpha);
    CHECK((result.set.shape - Matrix<double, n>(exact.asDiagonal())).cwiseAbs().maxCoeff() <= 1e-9);
    CHECK(result.set.center.norm() <= 1e-15);
  }
  Quadric<double, n> wide;
  REQUIRE(slab(Vector<double, n>(Vector<double, n>::Unit(2)), 0.0, 0.41, wide) == Status::ok);  // beyond 1/√6
  Intersection<double, n> result;
  REQUIRE(minimal_intersection(wide, unit_ball<n>(), Criterion<n>::volume(), result) == Status::ok);
  CHECK(result.share == 1);
  CHECK(result.set.shape == unit_ball<n>().shape);
}

TEST_CASE("a ball cut by a half-space is bounded by the ball about the cut") {
  // x ≤ −a: the family is of balls about −μ with radius² 1 − 2aμ + μ².
  for (const double a : {0.1, 0.5, 0.9}) {
    const Quadric<double, 3> half_space{Matrix3<double>::Zero(), Vector3<double>(0.5, 0, 0), -a};
    for (const auto& criterion : {Criterion<3>::trace(), Criterion<3>::volume()}) {
      Intersection<double, 3> result;
      REQUIRE(minimal_intersection(half_space, unit_ball<3>(), criterion, result) == Status::ok);
      // The size is at rounding when the multiplier, on which the center depends, has half as many digits.
      CHECK((result.set.center - Vector3<double>(-a, 0, 0)).norm() <= 1e-8);
      CHECK((result.set.shape - (1 - a * a) * Matrix3<double>::Identity()).norm() <= 1e-9);
    }
  }
  const Quadric<double, 3> through{Matrix3<double>::Zero(), Vector3<double>(0.5, 0, 0), 0.1};
  Intersection<double, 3> result;
  REQUIRE(minimal_intersection(through, unit_ball<3>(), Criterion<3>::trace(), result) == Status::ok);
  CHECK(result.share == 1);  // no ball of the family is smaller
}

TEST_CASE("a half-space or a slab beyond the ball leaves nothing and one that touches leaves a point") {
  Intersection<double, 3> result{unit_ball<3>(), 0.1};
  for (const auto& criterion : {Criterion<3>::trace(), Criterion<3>::volume()}) {
    for (const double a : {1.000001, 1.5, 100.0}) {
      const Quadric<double, 3> half_space{Matrix3<double>::Zero(), Vector3<double>(0.5, 0, 0), -a};
      CHECK(minimal_intersection(half_space, unit_ball<3>(), criterion, result) == Status::empty_intersection);
      Quadric<double, 3> q;
      REQUIRE(slab(Vector3<double>(0, 1, 0), a + 0.5, 0.5, q) == Status::ok);
      CHECK(minimal_intersection(q, unit_ball<3>(), criterion, result) == Status::empty_intersection);
    }
    CHECK(result.share == 0.1);
    const Quadric<double, 3> close{Matrix3<double>::Zero(), Vector3<double>(0.5, 0, 0), -0.999999};
    Intersection<double, 3> cap;
    REQUIRE(minimal_intersection(close, unit_ball<3>(), criterion, cap) == Status::ok);
    CHECK(std::abs(cap.set.shape(0, 0) - 1.999999e-6) <= 1e-12);
  }
}

TEST_CASE("a cylinder and a ball") {
  // x² + y² ≤ r²: the family has (r² + q)/(1 + q) across and (r² + q)/q along.
  const double r = 0.5;
  const Quadric<double, 2> disc{Matrix<double, 2>::Identity(), Vector<double, 2>::Zero(), r * r};
  const Matrix<double, 2, 3> selection = Matrix<double, 2, 3>::Identity();
  const Quadric<double, 3> cylinder = pullback(disc, selection, Vector<double, 2>(Vector<double, 2>::Zero()));
  Intersection<double, 3> result;
  REQUIRE(minimal_intersection(cylinder, unit_ball<3>(), Criterion<3>::trace(), result) == Status::ok);
  const auto trace = [r](long double log_q) {
    const long double q = std::exp(log_q);
    const long double level = static_cast<long double>(r * r) + q;
    return 2 * level / (1 + q) + level / q;
  };
  CHECK(std::abs(result.set.shape.trace() - static_cast<double>(testing::least_value(trace, -10, 10, 1000))) <= 1e-12);
  const double q = result.share / (1 - result.share);
  CHECK(std::abs(result.set.shape(0, 0) - (r * r + q) / (1 + q)) <= 1e-14);
  CHECK(std::abs(result.set.shape(2, 2) - (r * r + q) / q) <= 1e-13);
}

TEST_CASE("a cone and a ball within it and beside it and across it") {
  Random random(84);
  const Vector3<double> axis = random.unit_vector<3>();
  const Quadric<double, 3> q = cone(axis, 0.3);
  Vector3<double> side = axis.cross(random.unit_vector<3>()).normalized();
  Intersection<double, 3> result;
  const Ellipsoid<double, 3> within{10 * axis, Matrix3<double>::Identity()};
  REQUIRE(minimal_intersection(q, within, Criterion<3>::volume(), result) == Status::ok);
  CHECK(result.share == 1);
  const Ellipsoid<double, 3> beside{10 * side, Matrix3<double>::Identity()};
  CHECK(minimal_intersection(q, beside, Criterion<3>::volume(), result) == Status::empty_intersection);
  // Where the cone's half angle is small beside the ball's the answer is nearly the chord of the axis.
  const Ellipsoid<double, 3> wide{10 * axis, 9 * Matrix3<double>::Identity()};
  REQUIRE(minimal_intersection(cone(axis, 0.01), wide, Criterion<3>::volume(), result) == Status::ok);
  CHECK(support(result.set, side) - side.dot(result.set.center) < 0.3);
  for (int i = 0; i < 20000; ++i) {
    const Vector3<double> x = 10 * axis + 3 * random.in_ball<3>().cwiseProduct(Vector3<double>::Ones());
    const double angle = std::atan2(x.cross(axis).norm(), x.dot(axis));
    const Vector3<double> near = x.dot(axis) * axis + 0.03 * (x - x.dot(axis) * axis);
    const double near_angle = std::atan2(near.cross(axis).norm(), near.dot(axis));
    for (const auto& [point, its_angle] : {std::pair(x, angle), std::pair(near, near_angle)}) {
      double form = 0;
      REQUIRE(quadratic_form(result.set, point, form) == Status::ok);
      REQUIRE((its_angle > 0.01 || (point - 10 * axis).norm() > 3 || form <= 1 + 1e-9));
    }
  }
}

TEST_CASE("the intersection with any quadric is the smallest of its family and loses no point") {
  check_random<2>(120);
  check_random<3>(120);
  check_random<6>(60);
}

TEST_CASE("a quadric far sharper than the ellipsoid loses no point and does not contradict it") {
  using Long6 = Eigen::Matrix<long double, 6, 1>;
  using LongMatrix6 = Eigen::Matrix<long double, 6, 6>;
  for (const auto& criterion : {Criterion<6>::trace(), Criterion<6>::volume()}) {
    for (const double ratio : {1e-3, 1e-5, 1e-6, 1e-7}) {
      Random random(8);
      CAPTURE(ratio);
      for (int trial = 0; trial < 200; ++trial) {
        const Matrix<double, 6> shape = 0.01 * Matrix<double, 6>(random.positive_definite<6>(10));
        const LongMatrix6 root = LongMatrix6(shape.cast<long double>()).llt().matrixL();
        const Long6 x = root * (0.9 * random.in_ball<6>()).cast<long double>();
        // ‖H(x − z)‖ ≤ 0.1 ratio, three coordinates of six free, about a z that x is well within.
        Matrix<double, 2, 6> h = Matrix<double, 2, 6>::Zero();
        h.leftCols<3>() = random.normal_matrix<2, 3>() / (0.1 * ratio);
        const Vector<double, 2> y =
            (h.cast<long double>() * x + (0.9 * random.in_ball<2>()).cast<long double>()).cast<double>();
        const Quadric<double, 6> quadric{h.transpose() * h, -h.transpose() * y, 1 - y.squaredNorm()};
        Intersection<double, 6> result;
        REQUIRE(minimal_intersection(quadric, Ellipsoid<double, 6>{Vector<double, 6>::Zero(), shape}, criterion,
                                     result) == Status::ok);
        const Long6 error = x - result.set.center.cast<long double>();
        const LongMatrix6 found = result.set.shape.cast<long double>();
        CHECK(static_cast<double>(error.dot(found.llt().solve(error))) <= 1);
      }
    }
  }
}

TEST_CASE("a flat ellipsoid meets a quadric in its plane") {
  // The disc x² + y² ≤ 4 at z = 0.2 in the ball: radius² 0.96.
  Quadric<double, 3> sphere;
  REQUIRE(to_quadric(unit_ball<3>(), sphere) == Status::ok);
  const Ellipsoid<double, 3> disc{Vector3<double>(0, 0, 0.2), Vector3<double>(4, 4, 0).asDiagonal()};
  Intersection<double, 3> result;
  REQUIRE(minimal_intersection(sphere, disc, Criterion<3>::trace(), result) == Status::ok);
  CHECK((result.set.shape - Matrix3<double>(Vector3<double>(0.96, 0.96, 0).asDiagonal())).norm() <= 1e-13);
  CHECK((result.set.center - disc.center).norm() <= 1e-15);
  const Ellipsoid<double, 3> outside{Vector3<double>(0, 0, 1.1), disc.shape};
  CHECK(minimal_intersection(sphere, outside, Criterion<3>::trace(), result) == Status::empty_intersection);
}

TEST_CASE("a quadric that says nothing leaves the ellipsoid and one that allows nothing leaves no set") {
  const Quadric<double, 3> everything{Matrix3<double>::Zero(), Vector3<double>::Zero(), 0};
  const Quadric<double, 3> nothing{Matrix3<double>::Zero(), Vector3<double>::Zero(), -1e-9};
  const Ellipsoid<double, 3> e{Vector3<double>(1, 2, 3), Vector3<double>(1, 2, 3).asDiagonal()};
  Intersection<double, 3> result;
  REQUIRE(minimal_intersection(everything, e, Criterion<3>::volume(), result) == Status::ok);
  CHECK(result.set.shape == e.shape);
  CHECK(result.set.center == e.center);
  CHECK(minimal_intersection(nothing, e, Criterion<3>::volume(), result) == Status::empty_intersection);
}

TEST_CASE("invalid quadrics are refused by name and the output stays") {
  Random random(85);
  const Quadric<double, 3> good{Matrix3<double>::Identity(), Vector3<double>::Zero(), 1};
  Intersection<double, 3> result{unit_ball<3>(), 0.1};
  Ellipsoid<double, 3> ellipsoid{Vector3<double>(7, 7, 7), Matrix3<double>::Identity()};
  const auto check = [&](const Quadric<double, 3>& q, Status expected) {
    CHECK(validate(q) == expected);
    CHECK(to_ellipsoid(q, ellipsoid) == expected);
    CHECK(minimal_intersection(q, unit_ball<3>(), Criterion<3>::trace(), result) == expected);
  };
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    Quadric<double, 3> q = good;
    q.a(0, 1) = bad;
    check(q, Status::not_finite);
    q = good;
    q.g(1) = bad;
    check(q, Status::not_finite);
    q = good;
    q.c = bad;
    check(q, Status::not_finite);
    CHECK(slab(Vector3<double>(bad, 0, 0), 0.0, 1.0, q) == Status::not_finite);
    CHECK(slab(Vector3<double>(1, 0, 0), bad, 1.0, q) == Status::not_finite);
    CHECK(slab(Vector3<double>(1, 0, 0), 0.0, bad, q) == Status::not_finite);
  }
  Quadric<double, 3> q = good;
  q.a(0, 1) = 0.5;
  check(q, Status::not_symmetric);
  CHECK(to_ellipsoid(cone(Vector3<double>(1, 0, 0), 0.3), ellipsoid) == Status::unbounded);
  q = good;
  q.c = -1;
  CHECK(to_ellipsoid(q, ellipsoid) == Status::empty_intersection);
  q = good;
  CHECK(slab(Vector3<double>(0, 0, 0), 0.0, 1.0, q) == Status::zero_direction);
  CHECK(slab(Vector3<double>(1, 0, 0), 0.0, -1e-9, q) == Status::out_of_range);
  CHECK(q.a == good.a);
  CHECK(to_quadric(Ellipsoid<double, 3>{Vector3<double>::Zero(), Vector3<double>(1, 1, 0).asDiagonal()}, q) ==
        Status::not_positive_definite);
  CHECK(ellipsoid.center == Vector3<double>(7, 7, 7));
  CHECK(result.share == 0.1);
}
