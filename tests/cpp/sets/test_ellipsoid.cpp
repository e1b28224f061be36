// Ellipsoids, against answers known in closed form, against the paper's own formulas in long double with a search in place
// of an iteration, and against points of the sets that they must contain.
#include <doctest/doctest.h>

#include <array>
#include <limits>
#include <vector>

#include "elliptude/sets/intersection.hpp"
#include "elliptude/sets/sum.hpp"
#include "support/random.hpp"
#include "support/search.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr double pi = 3.141592653589793;

// The size is dynamic, because each fixed size takes long to compile.
using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
using LongVector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;

template <int N>
using Criterion = SizeCriterion<double, N>;

template <int N>
Ellipsoid<double, N> ball(const Vector<double, N>& center, double radius = 1) {
  return {center, radius * radius * Matrix<double, N>::Identity()};
}

Ellipsoid<double, 2> ellipse(double x, double y) {
  return {Vector<double, 2>::Zero(), Vector<double, 2>(x, y).asDiagonal()};
}

// The criterion in the logarithm, so that a difference is a share.
template <int N>
long double size_of(const LongMatrix& shape, const Criterion<N>& criterion) {
  if (criterion.kind == Criterion<N>::Kind::volume) {
    return std::log(Eigen::PartialPivLU<LongMatrix>(shape).determinant());
  }
  return std::log((criterion.weight.template cast<long double>() * shape).trace());
}

// (x − x̂)ᵀP⁻¹(x − x̂) in long double.
template <int N>
double form(const Ellipsoid<double, N>& e, const Vector<double, N>& x) {
  const LongVector rest = x.template cast<long double>() - e.center.template cast<long double>();
  return static_cast<double>(
      rest.dot(Eigen::PartialPivLU<LongMatrix>(e.shape.template cast<long double>()).solve(rest)));
}

// The paper's fusion as it is printed (eqs. xhatP-LP): L = P₁(P₁ + P₂/q)⁻¹, β = 1 + q − dᵀP₁⁻¹Ld, P = β(I − L)P₁.
template <int N>
struct PaperFusion {
  LongVector center;
  LongMatrix shape;
  long double beta;

  PaperFusion(const Ellipsoid<double, N>& first, const Ellipsoid<double, N>& second, long double q) {
    const LongMatrix p1 = first.shape.template cast<long double>();
    const LongMatrix p2 = second.shape.template cast<long double>();
    const LongVector d = second.center.template cast<long double>() - first.center.template cast<long double>();
    const LongMatrix l = p1 * Eigen::PartialPivLU<LongMatrix>(p1 + p2 / q).inverse();
    beta = 1 + q - d.dot(Eigen::PartialPivLU<LongMatrix>(p1).solve(l * d));
    center = first.center.template cast<long double>() + l * d;
    shape = beta * (LongMatrix::Identity(N, N) - l) * p1;
  }
};

template <int N>
long double smallest_by_search(const Ellipsoid<double, N>& first, const Ellipsoid<double, N>& second,
                               const Criterion<N>& criterion) {
  const auto value = [&](long double log_q) {
    return size_of<N>(PaperFusion<N>(first, second, std::exp(log_q)).shape, criterion);
  };
  // Beyond these ends the printed (I − L) cancels even in long double, and the sets themselves are as good.
  const long double inside = testing::least_value(value, -18.0L, 18.0L, 300);
  return std::min({inside, size_of<N>(first.shape.template cast<long double>(), criterion),
                   size_of<N>(second.shape.template cast<long double>(), criterion)});
}

// Two ellipsoids about a common point, at random.
template <int N>
std::array<Ellipsoid<double, N>, 2> overlapping_pair(Random& random, double condition) {
  const Vector<double, N> common = random.normal_matrix<N>();
  std::array<Ellipsoid<double, N>, 2> pair;
  for (Ellipsoid<double, N>& e : pair) {
    e.shape = random.log_uniform(0.3, 3) * random.positive_definite<N>(condition);
    const Matrix<double, N> root = e.shape.llt().matrixL();
    e.center = common + root * (0.98 * random.in_ball<N>());
  }
  return pair;
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

// Points on the surface of the intersection, met by rays from point to point within: the worst points for a bound.
template <int N, typename Visit>
void visit_surface(Random& random, const std::array<Ellipsoid<double, N>, 2>& pair, Vector<double, N> inside, int count,
                   const Visit& visit) {
  std::array<Matrix<double, N>, 2> inverse{pair[0].shape.inverse(), pair[1].shape.inverse()};
  const Matrix<double, N> root = pair[0].shape.llt().matrixL();
  for (int i = 0; i < count; ++i) {
    const Vector<double, N> ray = root * random.unit_vector<N>();
    double longest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < 2; ++k) {
      const Vector<double, N> rest = inside - pair[k].center;
      const double a = ray.dot(inverse[k] * ray);
      const double b = ray.dot(inverse[k] * rest);
      const double c = rest.dot(inverse[k] * rest) - 1;
      longest = std::min(longest, (-b + std::sqrt(std::max(0.0, b * b - a * c))) / a);
    }
    const Vector<double, N> point = inside + longest * (1 - 1e-12) * ray;
    if (form(pair[0], point) <= 1 && form(pair[1], point) <= 1) {
      visit(point);
      inside += random.uniform(0, 1) * (point - inside);
    }
  }
}

template <int N>
void check_against_search(int draws, double condition) {
  Random random(41);
  int found = 0;
  for (int i = 0; i < draws; ++i) {
    const auto pair = overlapping_pair<N>(random, condition);
    const Criterion<N> criterion = any_criterion<N>(random, i);
    Intersection<double, N> result;
    const Status status = minimal_intersection(pair[0], pair[1], criterion, result);
    REQUIRE(status == Status::ok);
    ++found;
    const long double size = size_of<N>(result.set.shape.template cast<long double>(), criterion);
    const long double least = smallest_by_search(pair[0], pair[1], criterion);
    CAPTURE(i);
    // Not larger than what the search finds, and not smaller than anything in the family.
    REQUIRE(static_cast<double>(size - least) <= 1e-10);
    REQUIRE(static_cast<double>(size - least) >= -1e-10);
    if (result.share > 1e-6 && result.share < 1 - 1e-6) {
      const long double share = static_cast<long double>(result.share);
      const PaperFusion<N> paper(pair[0], pair[1], share / (1 - share));
      const double scale = std::sqrt(condition);
      REQUIRE((result.set.center - paper.center.template cast<double>()).norm() <= 1e-12 * scale);
      REQUIRE((result.set.shape - paper.shape.template cast<double>()).norm() <= 1e-11 * result.set.shape.norm());
    }
  }
  CHECK(found == draws);
}

template <int N>
void check_containment(int draws, double condition) {
  Random random(42);
  int visited = 0;
  for (int i = 0; i < draws; ++i) {
    const auto pair = overlapping_pair<N>(random, condition);
    const Criterion<N> criterion = any_criterion<N>(random, i);
    Intersection<double, N> result;
    REQUIRE(minimal_intersection(pair[0], pair[1], criterion, result) == Status::ok);
    // A common point to start from: minimise the larger form along the line between the centers of the family.
    Vector<double, N> inside = result.set.center;
    double least = std::numeric_limits<double>::infinity();
    for (int k = -40; k <= 40; ++k) {
      const PaperFusion<N> paper(pair[0], pair[1], std::exp(0.25L * k));
      const Vector<double, N> point = paper.center.template cast<double>();
      const double larger = std::max(form(pair[0], point), form(pair[1], point));
      if (larger < least) {
        least = larger;
        inside = point;
      }
    }
    REQUIRE(least < 1);
    visit_surface<N>(random, pair, inside, 200, [&](const Vector<double, N>& point) {
      ++visited;
      REQUIRE(form(result.set, point) <= 1 + 1e-9);
    });
    // Never larger than either set.
    for (const auto& e : pair) {
      const long double size = size_of<N>(result.set.shape.template cast<long double>(), criterion);
      REQUIRE(static_cast<double>(size - size_of<N>(e.shape.template cast<long double>(), criterion)) <= 1e-12);
    }
  }
  CHECK(visited > 100 * draws);
}

}  // namespace

// ---- the known answers, to the digits printed there

TEST_CASE("unit balls at distance 1 meet in a set with margin 3/4 and center 0.5 and shape 0.75") {
  const auto first = ball<3>(Vector3<double>::Zero());
  const auto second = ball<3>(Vector3<double>(1, 0, 0));
  double margin = 0;
  REQUIRE(overlap_margin(first, second, margin) == Status::ok);
  CHECK(std::abs(margin - 0.75) <= 2 * epsilon);
  for (const auto& criterion : {Criterion<3>::trace(), Criterion<3>::volume()}) {
    Intersection<double, 3> result;
    REQUIRE(minimal_intersection(first, second, criterion, result) == Status::ok);
    CHECK((result.set.center - Vector3<double>(0.5, 0, 0)).norm() <= 1e-10);
    CHECK((result.set.shape - 0.75 * Matrix3<double>::Identity()).norm() <= 1e-10);
    CHECK(std::abs(result.share - 0.5) <= 1e-10);
  }
}

TEST_CASE("unit balls at distance 2.2 do not meet and their margin is -0.21") {
  const auto first = ball<3>(Vector3<double>::Zero());
  const auto second = ball<3>(Vector3<double>(0, 2.2, 0));
  double margin = 0;
  REQUIRE(overlap_margin(first, second, margin) == Status::ok);
  CHECK(std::abs(margin + 0.21) <= 4 * epsilon);
  for (const auto& criterion : {Criterion<3>::trace(), Criterion<3>::volume()}) {
    Intersection<double, 3> result{ball<3>(Vector3<double>(7, 7, 7)), 0.1};
    CHECK(minimal_intersection(first, second, criterion, result) == Status::empty_intersection);
    CHECK(result.set.center == Vector3<double>(7, 7, 7));  // as it was
    CHECK(result.share == 0.1);
  }
}

TEST_CASE("the ellipses diag(4 1) and diag(1 4) fuse to the circle 1.6") {
  for (const auto& criterion : {Criterion<2>::trace(), Criterion<2>::volume()}) {
    Intersection<double, 2> result;
    REQUIRE(minimal_intersection(ellipse(4, 1), ellipse(1, 4), criterion, result) == Status::ok);
    CHECK((result.set.shape - 1.6 * Matrix<double, 2>::Identity()).norm() <= 1e-10);
    CHECK(result.set.center.norm() <= epsilon);
  }
}

TEST_CASE("the ellipses diag(4 1) and diag(1 9) fuse to trace 3.36536439505 and log determinant 1.037171007") {
  Intersection<double, 2> result;
  REQUIRE(minimal_intersection(ellipse(4, 1), ellipse(1, 9), Criterion<2>::trace(), result) == Status::ok);
  CHECK(std::abs(result.set.shape.trace() - 3.36536439505) <= 0.5e-11);
  // The issue prints 1.75411076 and 1.61125363; these digits are from a search with 40.
  CHECK(std::abs(result.set.shape(0, 0) - 1.75411076895) <= 1e-10);
  CHECK(std::abs(result.set.shape(1, 1) - 1.61125362610) <= 1e-10);
  CHECK(result.set.shape(0, 1) == 0);
  REQUIRE(minimal_intersection(ellipse(4, 1), ellipse(1, 9), Criterion<2>::volume(), result) == Status::ok);
  CHECK(std::abs(std::log(result.set.shape.determinant()) - 1.037171007) <= 0.5e-9);
}

TEST_CASE("the sum of the ellipses diag(4 1) and diag(1 9) has trace (sqrt 5 + sqrt 10) squared") {
  const std::array<Ellipsoid<double, 2>, 2> terms{ellipse(4, 1), ellipse(1, 9)};
  Ellipsoid<double, 2> sum;
  REQUIRE(minimal_sum(terms.data(), 2, Criterion<2>::trace(), sum) == Status::ok);
  const double root = std::sqrt(5.0) + std::sqrt(10.0);
  CHECK(std::abs(sum.shape.trace() - root * root) <= 1e-14 * root * root);
}

TEST_CASE("a unit ball and a flat disc meet in the disc that they have in common") {
  const auto sphere = ball<3>(Vector3<double>::Zero());
  const Ellipsoid<double, 3> disc{Vector3<double>(0, 0, 0.2), Vector3<double>(4, 4, 0).asDiagonal()};
  for (const bool flat_first : {false, true}) {
    Intersection<double, 3> result;
    const auto& first = flat_first ? disc : sphere;
    const auto& second = flat_first ? sphere : disc;
    REQUIRE(minimal_intersection(first, second, Criterion<3>::trace(), result) == Status::ok);
    CHECK((result.set.center - Vector3<double>(0, 0, 0.2)).norm() <= 4 * epsilon);
    CHECK((result.set.shape - Matrix3<double>(Vector3<double>(0.96, 0.96, 0).asDiagonal())).norm() <= 4 * epsilon);
    REQUIRE(minimal_intersection(first, second, Criterion<3>::volume(), result) == Status::ok);
    CHECK((result.set.shape - Matrix3<double>(Vector3<double>(0.96, 0.96, 0).asDiagonal())).norm() <= 4 * epsilon);
  }
}

// ---- the intersection against a search and against points

TEST_CASE("the intersection is the smallest of the paper's family in any dimension") {
  check_against_search<1>(60, 1);
  check_against_search<2>(120, 100);
  check_against_search<3>(120, 100);
  check_against_search<6>(90, 1e4);
}

TEST_CASE("the intersection contains each common point and is never larger than either set") {
  check_containment<2>(300, 100);
  check_containment<3>(300, 100);
  check_containment<6>(150, 1e4);
}

TEST_CASE("swapping the sets swaps the share and nothing else") {
  Random random(43);
  for (int i = 0; i < 200; ++i) {
    const auto pair = overlapping_pair<3>(random, 100);
    const Criterion<3> criterion = any_criterion<3>(random, i);
    Intersection<double, 3> one;
    Intersection<double, 3> other;
    REQUIRE(minimal_intersection(pair[0], pair[1], criterion, one) == Status::ok);
    REQUIRE(minimal_intersection(pair[1], pair[0], criterion, other) == Status::ok);
    REQUIRE((one.set.shape - other.set.shape).norm() <=
            1e-7 * one.set.shape.norm());  // a share converges to half the digits
    REQUIRE(std::abs(one.set.shape.trace() - other.set.shape.trace()) <= 1e-7 * one.set.shape.trace());
    REQUIRE(std::abs(one.share + other.share - 1) <= 1e-7);
  }
}

TEST_CASE("of two identical sets and of one inside the other the smaller comes back as it is") {
  Random random(44);
  for (int i = 0; i < 100; ++i) {
    const Ellipsoid<double, 3> large{random.normal_matrix<3>(), random.positive_definite<3>(100)};
    const Matrix3<double> root = large.shape.llt().matrixL();
    const Ellipsoid<double, 3> small{large.center + root * (0.3 * random.in_ball<3>()), 0.01 * large.shape};
    const Criterion<3> criterion = any_criterion<3>(random, i);
    Intersection<double, 3> result;
    REQUIRE(minimal_intersection(large, small, criterion, result) == Status::ok);
    REQUIRE(result.share == 1);
    REQUIRE(result.set.shape == small.shape);
    REQUIRE(result.set.center == small.center);
    REQUIRE(minimal_intersection(small, large, criterion, result) == Status::ok);
    REQUIRE(result.share == 0);
    REQUIRE(result.set.shape == small.shape);
    REQUIRE(minimal_intersection(large, large, criterion, result) == Status::ok);
    REQUIRE((result.set.shape - large.shape).norm() <= 1e-13 * large.shape.norm());
    REQUIRE((result.set.center - large.center).norm() <= 1e-13);
  }
}

TEST_CASE("concentric sets of opposite extreme aspect fuse to what the search finds") {
  for (const double aspect : {1e-6, 1e-3, 1.0, 1e3, 1e6}) {
    const Ellipsoid<double, 2> first{Vector<double, 2>::Zero(), Vector<double, 2>(aspect, 1 / aspect).asDiagonal()};
    const Ellipsoid<double, 2> second{Vector<double, 2>::Zero(), Vector<double, 2>(1 / aspect, aspect).asDiagonal()};
    const double small = std::min(aspect, 1 / aspect);
    Intersection<double, 2> result;
    for (const auto& criterion : {Criterion<2>::trace(), Criterion<2>::volume()}) {
      REQUIRE(minimal_intersection(first, second, criterion, result) == Status::ok);
      // By symmetry q = 1: 2/(1/a + a) on both axes.
      const double exact = 2 / (small + 1 / small);
      CAPTURE(aspect);
      REQUIRE((result.set.shape - exact * Matrix<double, 2>::Identity()).norm() <= 1e-9 * exact);
    }
  }
}

TEST_CASE("coordinates in units from 1e-6 to 1e6 cost no digits") {
  Random random(45);
  for (int i = 0; i < 100; ++i) {
    const auto pair = overlapping_pair<3>(random, 100);
    Vector3<double> units;  // powers of two, so that scaling rounds nothing
    for (int k = 0; k < 3; ++k) {
      units(k) = std::ldexp(1.0, static_cast<int>(random.uniform(-20, 20)));
    }
    const Matrix3<double> scale = units.asDiagonal();
    const Matrix3<double> back = units.cwiseInverse().asDiagonal();
    const auto scaled = [&scale](const Ellipsoid<double, 3>& e) {
      return Ellipsoid<double, 3>{scale * e.center, scale * e.shape * scale};
    };
    Intersection<double, 3> result;
    Intersection<double, 3> in_units;
    REQUIRE(minimal_intersection(pair[0], pair[1], Criterion<3>::volume(), result) == Status::ok);
    REQUIRE(minimal_intersection(scaled(pair[0]), scaled(pair[1]), Criterion<3>::volume(), in_units) == Status::ok);
    REQUIRE((back * in_units.set.shape * back - result.set.shape).norm() <= 1e-12 * result.set.shape.norm());
    REQUIRE((back * in_units.set.center - result.set.center).norm() <= 1e-12 * (1 + result.set.center.norm()));
    // The trace keeps its meaning if its weight is given in the same units.
    const Matrix3<double> weight = random.positive_definite<3>(10);
    REQUIRE(minimal_intersection(pair[0], pair[1], Criterion<3>::weighted_trace(weight), result) == Status::ok);
    REQUIRE(minimal_intersection(scaled(pair[0]), scaled(pair[1]), Criterion<3>::weighted_trace(back * weight * back),
                                 in_units) == Status::ok);
    REQUIRE((back * in_units.set.shape * back - result.set.shape).norm() <= 1e-12 * result.set.shape.norm());
  }
}

TEST_CASE("sets of great aspect in any frame keep a common point up to the rounding of their own shape") {
  Random random(46);
  const double condition = 1e8;  // semi-axes from 1e-2 to 1e2; the search works with the square of it
  for (int i = 0; i < 300; ++i) {
    const Vector3<double> common = random.normal_matrix<3>();
    std::array<Ellipsoid<double, 3>, 2> pair;
    for (auto& e : pair) {
      e.shape = random.positive_definite<3>(condition);
      const Matrix3<double> root = e.shape.llt().matrixL();
      e.center = common + root * (0.98 * random.in_ball<3>());
    }
    const Criterion<3> criterion = any_criterion<3>(random, i);
    Intersection<double, 3> result;
    CAPTURE(i);
    REQUIRE(minimal_intersection(pair[0], pair[1], criterion, result) == Status::ok);
    // A rounding of an entry of P moves the form by ε times the condition.
    REQUIRE(form(result.set, common) <= 1 + 10 * epsilon * condition);
    for (const auto& e : pair) {
      const long double size = size_of<3>(result.set.shape.cast<long double>(), criterion);
      REQUIRE(static_cast<double>(size - size_of<3>(e.shape.cast<long double>(), criterion)) <=
              10 * epsilon * condition);
    }
  }
}

TEST_CASE("the fusion of a common point with much smaller sets keeps it") {
  // What a filter sees when a precise measurement meets a vague prediction, and the reverse.
  Random random(47);
  for (const double ratio : {1e-6, 1e-3, 1e3, 1e6}) {
    for (int i = 0; i < 100; ++i) {
      const Vector<double, 6> common = random.normal_matrix<6>();
      std::array<Ellipsoid<double, 6>, 2> pair;
      for (std::size_t k = 0; k < 2; ++k) {
        pair[k].shape = (k == 0 ? 1.0 : ratio * ratio) * random.positive_definite<6>(100);
        const Matrix<double, 6> root = pair[k].shape.llt().matrixL();
        pair[k].center = common + root * (0.98 * random.in_ball<6>());
      }
      Intersection<double, 6> result;
      CAPTURE(ratio);
      REQUIRE(minimal_intersection(pair[0], pair[1], any_criterion<6>(random, i), result) == Status::ok);
      REQUIRE(form(result.set, common) <= 1 + 1e-9);
    }
  }
}

// ---- the margin

TEST_CASE("the margin of sets that touch is zero and its sign is the fusion's answer on either side") {
  Random random(48);
  int checked = 0;
  for (int i = 0; i < 500; ++i) {
    // Two sets with opposite normals at a common point of their surfaces.
    const Vector3<double> normal = random.unit_vector<3>();
    std::array<Ellipsoid<double, 3>, 2> pair;
    for (std::size_t k = 0; k < 2; ++k) {
      pair[k].shape = random.positive_definite<3>(1e4);
      const Vector3<double> reach = pair[k].shape * normal / std::sqrt(normal.dot(pair[k].shape * normal));
      pair[k].center = k == 0 ? Vector3<double>(-reach) : reach;
    }
    double margin = 1;
    REQUIRE(overlap_margin(pair[0], pair[1], margin) == Status::ok);
    REQUIRE(std::abs(margin) <= 1e-12);
    for (const double gap : {-1e-3, -1e-6, -1e-9, 1e-9, 1e-6, 1e-3}) {
      auto moved = pair[1];
      moved.center = pair[0].center + (1 + gap) * (pair[1].center - pair[0].center);
      REQUIRE(overlap_margin(pair[0], moved, margin) == Status::ok);
      REQUIRE((margin < 0) == (gap > 0));
      REQUIRE(std::abs(margin + 2 * gap) <= 2 * gap * gap + 1e-12);  // 1 − (1 + gap)²
      Intersection<double, 3> result;
      const Status status = minimal_intersection(pair[0], moved, any_criterion<3>(random, i), result);
      CAPTURE(gap);
      REQUIRE(status == (gap > 0 ? Status::empty_intersection : Status::ok));
      ++checked;
    }
  }
  CHECK(checked == 3000);
}

TEST_CASE("the margin agrees with a dense search and its sign with the fusion for random pairs") {
  Random random(49);
  int empty = 0;
  int common = 0;
  for (int i = 0; i < 1000; ++i) {
    std::array<Ellipsoid<double, 3>, 2> pair;
    for (auto& e : pair) {
      e = {random.normal_matrix<3>() * 1.5, random.positive_definite<3>(30)};
    }
    double margin = 0;
    REQUIRE(overlap_margin(pair[0], pair[1], margin) == Status::ok);
    const LongVector d = (pair[1].center - pair[0].center).cast<long double>();
    const auto negative = [&](long double lambda) {
      const LongMatrix mixed =
          lambda * pair[0].shape.cast<long double>() + (1 - lambda) * pair[1].shape.cast<long double>();
      return -lambda * (1 - lambda) * d.dot(Eigen::PartialPivLU<LongMatrix>(mixed).solve(d));
    };
    const double exact = static_cast<double>(1 + testing::least_value(negative, 0.0L, 1.0L, 300));
    REQUIRE(std::abs(margin - exact) <= 1e-12 * (1 + std::abs(exact)));
    Intersection<double, 3> result;
    const Status status = minimal_intersection(pair[0], pair[1], any_criterion<3>(random, i), result);
    REQUIRE(status == (margin < 0 ? Status::empty_intersection : Status::ok));
    (margin < 0 ? empty : common) += 1;
  }
  CHECK(empty > 200);
  CHECK(common > 200);
}

TEST_CASE("the margin of sets about one center is one") {
  double margin = 0;
  REQUIRE(overlap_margin(ellipse(4, 1), ellipse(1, 9), margin) == Status::ok);
  CHECK(margin == 1);
}

TEST_CASE("the margin of a ball and a disc across it is that of the chord") {
  const Ellipsoid<double, 3> disc{Vector3<double>(0, 0, 0.2), Vector3<double>(4, 4, 0).asDiagonal()};
  double margin = 0;
  REQUIRE(overlap_margin(ball<3>(Vector3<double>::Zero()), disc, margin) == Status::ok);
  CHECK(std::abs(margin - 0.96) <= 1e-7);  // the maximum is at an end, λ = 1, which an iteration can only approach
}

// ---- flat sets

TEST_CASE("a flat set in any position fuses to what it has in common with a ball") {
  Random random(50);
  for (int i = 0; i < 300; ++i) {
    // A disc of radius 2 at distance h from the center of the ball: the common disc has the radius √(1 − h²).
    const double h = random.uniform(-0.9, 0.9);
    const Matrix3<double> frame = random.rotation();
    const Vector3<double> normal = frame.col(2);
    Matrix3<double> shape = 4 * (Matrix3<double>::Identity() - normal * normal.transpose());
    shape = (0.5 * (shape + shape.transpose())).eval();
    const Ellipsoid<double, 3> disc{h * normal, shape};
    Intersection<double, 3> result;
    CAPTURE(i);
    REQUIRE(minimal_intersection(ball<3>(Vector3<double>::Zero()), disc, Criterion<3>::trace(), result) == Status::ok);
    const Matrix3<double> exact = (1 - h * h) * (Matrix3<double>::Identity() - normal * normal.transpose());
    // Rounding has given the disc a thickness of √(24 ε) of its radius, which bends the answer by as much.
    REQUIRE((result.set.shape - exact).cwiseAbs().maxCoeff() <= 1e-6);
    REQUIRE((result.set.center - h * normal).norm() <= 1e-6);
    // No point of the common disc is lost beyond rounding.
    for (int k = 0; k < 20; ++k) {
      const double angle = random.uniform(0, 2 * pi);
      const Vector3<double> rim = std::cos(angle) * frame.col(0) + std::sin(angle) * frame.col(1);
      REQUIRE(support(result.set, rim) >= std::sqrt(1 - h * h) - 1e-12);
    }
  }
}

TEST_CASE("a flat disc outside the ball is found empty") {
  Random random(51);
  for (int i = 0; i < 300; ++i) {
    const Vector3<double> normal = random.unit_vector<3>();
    Matrix3<double> shape = 4 * (Matrix3<double>::Identity() - normal * normal.transpose());
    shape = (0.5 * (shape + shape.transpose())).eval();
    Intersection<double, 3> result;
    CHECK(minimal_intersection(ball<3>(Vector3<double>::Zero()), Ellipsoid<double, 3>{1.001 * normal, shape},
                               Criterion<3>::trace(), result) == Status::empty_intersection);
  }
  const Ellipsoid<double, 3> level{Vector3<double>(0, 0, 1.001), Vector3<double>(4, 4, 0).asDiagonal()};
  Intersection<double, 3> result;
  CHECK(minimal_intersection(ball<3>(Vector3<double>::Zero()), level, Criterion<3>::volume(), result) ==
        Status::empty_intersection);
}

TEST_CASE("a point is a flat set too") {
  const Ellipsoid<double, 3> inside{Vector3<double>(0.5, 0.5, 0), Matrix3<double>::Zero()};
  const Ellipsoid<double, 3> outside{Vector3<double>(0.9, 0.9, 0), Matrix3<double>::Zero()};
  Intersection<double, 3> result;
  REQUIRE(minimal_intersection(ball<3>(Vector3<double>::Zero()), inside, Criterion<3>::trace(), result) == Status::ok);
  CHECK(result.set.center == inside.center);
  CHECK(result.set.shape == inside.shape);
  CHECK(minimal_intersection(ball<3>(Vector3<double>::Zero()), outside, Criterion<3>::trace(), result) ==
        Status::empty_intersection);
}

// ---- sums

TEST_CASE("the sum of one ellipsoid is that ellipsoid") {
  Random random(52);
  const Ellipsoid<double, 3> only{random.normal_matrix<3>(), random.positive_definite<3>(100)};
  for (const auto& criterion : {Criterion<3>::trace(), Criterion<3>::volume()}) {
    Ellipsoid<double, 3> sum;
    REQUIRE(minimal_sum(&only, 1, criterion, sum) == Status::ok);
    CHECK(sum.center == only.center);
    CHECK((sum.shape - only.shape).norm() <= 4 * epsilon * only.shape.norm());
  }
}

TEST_CASE("the sum contains the sum of the sets and no other shares make it smaller") {
  Random random(53);
  for (int i = 0; i < 200; ++i) {
    constexpr int N = 3;
    const std::size_t count = 2 + static_cast<std::size_t>(i % 5);
    std::vector<Ellipsoid<double, N>> terms(count);
    LongVector center = LongVector::Zero(N);
    for (auto& term : terms) {
      term = {random.normal_matrix<N>(), random.log_uniform(1e-4, 1e4) * random.positive_definite<N>(1e4)};
      center += term.center.cast<long double>();
    }
    const Criterion<N> criterion = any_criterion<N>(random, i);
    Ellipsoid<double, N> sum;
    REQUIRE(minimal_sum(terms.data(), count, criterion, sum) == Status::ok);
    REQUIRE((sum.center - center.cast<double>()).norm() <= 1e-14);

    for (int k = 0; k < 50; ++k) {
      const Vector<double, N> direction = random.unit_vector<N>();
      double reach = 0;
      for (const auto& term : terms) {
        reach += support(term, direction);
      }
      REQUIRE(support(sum, direction) >= reach * (1 - 1e-12 * (reach > 0 ? 1 : -1)));
    }

    // Σ Pᵢ/αᵢ with the shares that the theory names, and with others near and far.
    std::vector<long double> shares(count);
    const LongMatrix inverse = Eigen::PartialPivLU<LongMatrix>(sum.shape.cast<long double>()).inverse();
    for (std::size_t k = 0; k < count; ++k) {
      const LongMatrix metric =
          criterion.kind == Criterion<N>::Kind::volume ? inverse : LongMatrix(criterion.weight.cast<long double>());
      shares[k] = std::sqrt((metric * terms[k].shape.cast<long double>()).trace());
    }
    const auto mixed = [&](const std::vector<long double>& weights) {
      long double all = 0;
      for (const long double weight : weights) {
        all += weight;
      }
      LongMatrix shape = LongMatrix::Zero(N, N);
      for (std::size_t k = 0; k < count; ++k) {
        shape += terms[k].shape.cast<long double>() * (all / weights[k]);
      }
      return shape;
    };
    CAPTURE(i);
    const auto size = [&](const LongMatrix& shape) { return static_cast<double>(size_of<N>(shape, criterion)); };
    const double found = size(sum.shape.cast<long double>());
    if (criterion.kind == Criterion<N>::Kind::volume) {
      // To the end of the iteration, of which the sum is promised to be a step whose log det is within 1e-6.
      for (int step = 0; step < 500; ++step) {
        const LongMatrix metric = Eigen::PartialPivLU<LongMatrix>(mixed(shares)).inverse();
        for (std::size_t k = 0; k < count; ++k) {
          shares[k] = std::sqrt((metric * terms[k].shape.cast<long double>()).trace());
        }
      }
      REQUIRE((mixed(shares).cast<double>() - sum.shape).norm() <= 1e-2 * sum.shape.norm());
      REQUIRE(found <= size(mixed(shares)) + 1e-6);
    } else {
      REQUIRE((mixed(shares).cast<double>() - sum.shape).norm() <= 1e-12 * sum.shape.norm());
      REQUIRE(std::abs(found - size(mixed(shares))) <= 1e-13);
    }
    const double least = size(mixed(shares));
    for (const double spread : {1e-3, 0.1, 2.0}) {
      for (int k = 0; k < 10; ++k) {
        std::vector<long double> others = shares;
        for (long double& share : others) {
          share *= static_cast<long double>(std::exp(spread * random.normal()));
        }
        REQUIRE(size(mixed(others)) >= least - 1e-13);
      }
    }
  }
}

TEST_CASE("the product of two sets holds both, and no other share makes it smaller") {
  Random random(56);
  for (int i = 0; i < 200; ++i) {
    const Matrix3<double> a = random.log_uniform(1e-4, 1e4) * random.positive_definite<3>(1e4);
    const Matrix<double, 2> b = random.log_uniform(1e-4, 1e4) * random.positive_definite<2>(1e4);
    const Criterion<5> criterion = any_criterion<5>(random, i);
    Matrix<double, 5> product;
    REQUIRE(product_of_shapes(a, b, criterion, product) == Status::ok);
    const auto with_share = [&](double share) {
      LongMatrix shape = LongMatrix::Zero(5, 5);
      shape.topLeftCorner(3, 3) = a.cast<long double>() / static_cast<long double>(share);
      shape.bottomRightCorner(2, 2) = b.cast<long double>() / static_cast<long double>(1 - share);
      return shape;
    };
    const double share = a.trace() / product.topLeftCorner<3, 3>().trace();
    CAPTURE(i);
    REQUIRE((product - with_share(share).cast<double>()).norm() <= 1e-12 * product.norm());
    const long double least = size_of<5>(product.cast<long double>(), criterion);
    for (double other = 0.01; other < 1; other += 0.01) {
      REQUIRE(static_cast<double>(size_of<5>(with_share(other), criterion) - least) >=
              -1e-11);  // the condition times ε
    }
    const Vector3<double> x = random.unit_vector<3>();
    const Vector<double, 2> y = random.unit_vector<2>();
    Vector<double, 5> corner;
    corner << Matrix3<double>(a.llt().matrixL()) * x, Matrix<double, 2>(b.llt().matrixL()) * y;
    REQUIRE(corner.dot(product.ldlt().solve(corner)) <= 1 + 1e-12);
  }
}

TEST_CASE("the product of a set and a point is as flat as the point, and none of the least volume") {
  const Matrix<double, 2> disc = Matrix<double, 2>::Identity();
  const Matrix<double, 2> point = Matrix<double, 2>::Zero();
  Matrix<double, 4> product = Matrix<double, 4>::Constant(7);
  CHECK(product_of_shapes(disc, point, Criterion<4>::volume(), product) == Status::not_positive_definite);
  CHECK(product_of_shapes(point, disc, Criterion<4>::volume(), product) == Status::not_positive_definite);
  const Matrix<double, 2> huge = 1.7e308 * disc;
  CHECK(product_of_shapes(huge, huge, Criterion<4>::volume(), product) == Status::beyond_domain);
  CHECK(product == Matrix<double, 4>::Constant(7));
  REQUIRE(product_of_shapes(disc, point, Criterion<4>::trace(), product) == Status::ok);
  CHECK(product == Matrix<double, 4>(Vector<double, 4>(1, 1, 0, 0).asDiagonal()));
  REQUIRE(product_of_shapes(point, point, Criterion<4>::trace(), product) == Status::ok);
  CHECK(product == Matrix<double, 4>::Zero());
}

TEST_CASE("a sum may hold flat terms and points") {
  std::array<Ellipsoid<double, 2>, 3> terms{ellipse(4, 0), ellipse(0, 1), ellipse(0, 0)};
  terms[2].center = Vector<double, 2>(3, 4);
  Ellipsoid<double, 2> sum;
  REQUIRE(minimal_sum(terms.data(), 3, Criterion<2>::trace(), sum) == Status::ok);
  CHECK(sum.center == Vector<double, 2>(3, 4));
  CHECK((sum.shape - Matrix<double, 2>(Vector<double, 2>(6, 3).asDiagonal())).norm() <= 1e-14);  // (2 + 1)(4/2, 1/1)
  REQUIRE(minimal_sum(terms.data(), 3, Criterion<2>::volume(), sum) == Status::ok);
  CHECK(sum.shape(0, 1) == 0);
  CHECK(std::log(sum.shape.determinant() / (8 * 2)) <= 1e-6);  // equal shares
  CHECK(sum.shape.determinant() >= 8 * 2 * (1 - 1e-13));
  REQUIRE(minimal_sum(&terms[2], 1, Criterion<2>::trace(), sum) == Status::ok);
  CHECK(sum.shape == Matrix<double, 2>::Zero());
  const Ellipsoid<double, 2> before = sum;
  CHECK(minimal_sum(terms.data(), 1, Criterion<2>::volume(), sum) == Status::not_positive_definite);
  CHECK(sum.center == before.center);
}

// ---- what else there is to do with an ellipsoid

TEST_CASE("an affine image has the support function of the image") {
  Random random(54);
  for (int i = 0; i < 100; ++i) {
    const Ellipsoid<double, 3> e{random.normal_matrix<3>(), random.positive_definite<3>(100)};
    const Matrix<double, 2, 3> transform = random.normal_matrix<2, 3>();
    const Vector<double, 2> shift = random.normal_matrix<2>();
    const auto image = affine_image(e, transform, shift);
    const Vector<double, 2> direction = random.unit_vector<2>();
    const double exact = support(e, Vector3<double>(transform.transpose() * direction)) + direction.dot(shift);
    REQUIRE(std::abs(support(image, direction) - exact) <= 1e-13 * (1 + std::abs(exact)));
    REQUIRE(image.shape == image.shape.transpose());
    const auto up = affine_image(e, random.normal_matrix<4, 3>(), random.normal_matrix<4>());  // flat
    REQUIRE(validate(up) == Status::ok);
    const auto selected = affine_image(e, Matrix<double, 2, 3>(Matrix<double, 2, 3>::Identity().rowwise().reverse()),
                                       Vector<double, 2>(Vector<double, 2>::Zero()));
    REQUIRE(selected.center == Vector<double, 2>(e.center(2), e.center(1)));
    const auto projected = projection<1, 2>(e);
    REQUIRE(projected.center == e.center.tail<2>());
    REQUIRE(projected.shape == e.shape.bottomRightCorner<2, 2>());
  }
}

TEST_CASE("support and half-widths are met by points of the set and exceeded by none") {
  Random random(55);
  for (int i = 0; i < 20; ++i) {
    const Ellipsoid<double, 3> e{random.normal_matrix<3>(), random.positive_definite<3>(100)};
    const Matrix3<double> root = e.shape.llt().matrixL();
    const Vector3<double> direction = random.normal_matrix<3>();
    const double reach = support(e, direction);
    const Vector3<double> box = half_widths(e);
    for (int k = 0; k < 500; ++k) {
      const Vector3<double> x = e.center + root * random.unit_vector<3>();
      REQUIRE(direction.dot(x) <= reach + 1e-13);
      REQUIRE(((x - e.center).cwiseAbs() - box).maxCoeff() <= 1e-13);
    }
    const Vector3<double> top = e.center + root * (root.transpose() * direction).normalized();
    REQUIRE(std::abs(direction.dot(top) - reach) <= 1e-13 * (1 + std::abs(reach)));
    for (int k = 0; k < 3; ++k) {
      REQUIRE(std::abs(box(k) - (support(e, Vector3<double>(Vector3<double>::Unit(k))) - e.center(k))) <=
              1e-13 * box(k) + 1e-15);
    }
  }
}

TEST_CASE("the quadratic form and containment are those of the definition") {
  Random random(56);
  for (int i = 0; i < 200; ++i) {
    const Ellipsoid<double, 3> e{random.normal_matrix<3>(), random.positive_definite<3>(100)};
    const Vector3<double> x = e.center + random.normal_matrix<3>();
    double value = 0;
    REQUIRE(quadratic_form(e, x, value) == Status::ok);
    REQUIRE(std::abs(value - form(e, x)) <= 1e-13 * 100 * (1 + value));
    const Matrix3<double> root = e.shape.llt().matrixL();
    const Vector3<double> u = random.unit_vector<3>();
    REQUIRE(contains(e, Vector3<double>(e.center + (1 - 1e-12) * (root * u))));
    REQUIRE_FALSE(contains(e, Vector3<double>(e.center + (1 + 1e-12) * (root * u))));
  }
}

TEST_CASE("a flat set contains the points of its plane and no others") {
  const Ellipsoid<double, 3> disc{Vector3<double>(1, 2, 3), Vector3<double>(4, 1, 0).asDiagonal()};
  double value = 0;
  REQUIRE(quadratic_form(disc, Vector3<double>(2, 2.5, 3), value) == Status::ok);
  CHECK(value == 0.5);
  CHECK(contains(disc, Vector3<double>(2, 2.5, 3)));
  REQUIRE(quadratic_form(disc, Vector3<double>(2, 2.5, 3.0000001), value) == Status::ok);
  CHECK(value == std::numeric_limits<double>::infinity());
  CHECK_FALSE(contains(disc, Vector3<double>(2, 2.5, 3.0000001)));
}

TEST_CASE("log_volume knows the balls of dimension 1 to 6") {
  const std::array<double, 6> unit{2, pi, 4 * pi / 3, pi * pi / 2, 8 * pi * pi / 15, pi * pi * pi / 6};
  const auto volume = [](const auto& e) {
    double value = 0;
    REQUIRE(log_volume(e, value) == Status::ok);
    return std::exp(value);
  };
  CHECK(volume(ball<1>(Vector<double, 1>::Zero())) == doctest::Approx(unit[0]).epsilon(1e-14));
  CHECK(volume(ball<2>(Vector<double, 2>::Zero())) == doctest::Approx(unit[1]).epsilon(1e-14));
  CHECK(volume(ball<3>(Vector<double, 3>::Zero())) == doctest::Approx(unit[2]).epsilon(1e-14));
  CHECK(volume(ball<4>(Vector<double, 4>::Zero())) == doctest::Approx(unit[3]).epsilon(1e-14));
  CHECK(volume(ball<5>(Vector<double, 5>::Zero())) == doctest::Approx(unit[4]).epsilon(1e-14));
  CHECK(volume(ball<6>(Vector<double, 6>::Zero(), 2)) == doctest::Approx(64 * unit[5]).epsilon(1e-14));
  CHECK(volume(ellipse(4, 9)) == doctest::Approx(6 * pi).epsilon(1e-14));
  double value = 7;
  CHECK(log_volume(ellipse(4, 0), value) == Status::not_positive_definite);
  CHECK(value == 7);
}

TEST_CASE("principal axes are those that the set was made with") {
  Random random(57);
  for (int i = 0; i < 50; ++i) {
    const Matrix3<double> frame = random.rotation();
    const Vector3<double> lengths(3, 2, i % 2 == 0 ? 0.5 : 0.0);
    Matrix3<double> shape = frame * lengths.cwiseAbs2().asDiagonal() * frame.transpose();
    shape = (0.5 * (shape + shape.transpose())).eval();
    PrincipalAxes<double, 3> axes;
    REQUIRE(principal_axes(Ellipsoid<double, 3>{Vector3<double>::Zero(), shape}, axes) == Status::ok);
    REQUIRE((axes.lengths - lengths).norm() <= (i % 2 == 0 ? 1e-14 : 1e-7));  // the root of a rounded zero
    REQUIRE(((axes.directions.transpose() * frame).cwiseAbs() - Matrix3<double>::Identity()).norm() <= 1e-14);
  }
}

// ---- refusals

TEST_CASE("what is not an ellipsoid or not a criterion is refused by name and the output stays") {
  Random random(58);
  const Ellipsoid<double, 3> good{random.normal_matrix<3>(), random.positive_definite<3>(10)};
  const auto check = [&](const Ellipsoid<double, 3>& e, const Criterion<3>& criterion, Status expected) {
    const Intersection<double, 3> before{ball<3>(Vector3<double>(7, 7, 7)), 0.1};
    Intersection<double, 3> result = before;
    CHECK(minimal_intersection(e, good, criterion, result) == expected);
    CHECK(minimal_intersection(good, e, criterion, result) == expected);
    CHECK(result.set.center == before.set.center);
    CHECK(result.set.shape == before.set.shape);
    CHECK(result.share == before.share);
    Ellipsoid<double, 3> sum = before.set;
    const std::array<Ellipsoid<double, 3>, 2> terms{good, e};
    CHECK(minimal_sum(terms.data(), 2, criterion, sum) == expected);
    CHECK(sum.center == before.set.center);
    CHECK(sum.shape == before.set.shape);
  };
  const auto check_set = [&](const Ellipsoid<double, 3>& e, Status expected) {
    CHECK(validate(e) == expected);
    for (const auto& criterion : {Criterion<3>::trace(), Criterion<3>::volume()}) {
      check(e, criterion, expected);
    }
    double margin = 7;
    CHECK(overlap_margin(e, good, margin) == expected);
    CHECK(overlap_margin(good, e, margin) == expected);
    CHECK(margin == 7);
    CHECK_FALSE(contains(e, e.center));
  };
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    Ellipsoid<double, 3> spoiled = good;
    spoiled.center(1) = bad;
    check_set(spoiled, Status::not_finite);
    spoiled = good;
    spoiled.shape(0, 2) = bad;
    check_set(spoiled, Status::not_finite);
  }
  Ellipsoid<double, 3> skew = good;
  skew.shape(0, 1) += 0.1;
  CHECK(validate(skew) == Status::not_symmetric);
  Intersection<double, 3> result;
  CHECK(minimal_intersection(skew, good, Criterion<3>::trace(), result) == Status::not_symmetric);
  CHECK(minimal_intersection(good, skew, Criterion<3>::trace(), result) == Status::not_symmetric);
  check_set({good.center, random.symmetric<3>(Vector3<double>(1, 1, -1e-3))}, Status::not_positive_definite);

  Criterion<3> criterion = Criterion<3>::weighted_trace(random.symmetric<3>(Vector3<double>(1, 1, 0)));
  criterion.weight.row(0).setZero();
  criterion.weight.col(0).setZero();
  check(good, criterion, Status::not_positive_definite);
  criterion = Criterion<3>::weighted_trace(Matrix3<double>::Identity());
  criterion.weight(0, 1) = 1;
  check(good, criterion, Status::not_symmetric);
  criterion.weight(0, 1) = std::nan("");
  check(good, criterion, Status::not_finite);

  Ellipsoid<double, 3> sum = good;
  CHECK(minimal_sum(&good, 0, Criterion<3>::trace(), sum) == Status::out_of_range);
  const std::vector<Ellipsoid<double, 3>> many(65, good);
  CHECK(minimal_sum(many.data(), 65, Criterion<3>::trace(), sum) == Status::out_of_range);
  CHECK(minimal_sum(many.data(), 64, Criterion<3>::trace(), sum) == Status::ok);
  CHECK((sum.shape - 64 * 64 * good.shape).norm() <= 1e-12 * 64 * 64 * good.shape.norm());
}

TEST_CASE("two flat sets are refused where no combination of them is regular") {
  Intersection<double, 2> result;
  CHECK(minimal_intersection(ellipse(1, 0), ellipse(0, 1), Criterion<2>::trace(), result) ==
        Status::not_positive_definite);
}

namespace {

template <int N>
void check_pairs_of_any_condition() {
  for (const double condition : {1e4, 1e8, 1e12}) {
    Random random(7);
    double worst = -1;
    for (int trial = 0; trial < 300; ++trial) {
      Ellipsoid<double, N> first{Vector<double, N>::Zero(), random.positive_definite<N>(condition)};
      Ellipsoid<double, N> second{Vector<double, N>::Zero(), random.positive_definite<N>(condition)};
      const Vector<double, N> common = random.normal_matrix<N>();
      const Matrix<double, N> root1 = first.shape.llt().matrixL();
      const Matrix<double, N> root2 = second.shape.llt().matrixL();
      first.center = common - 0.999 * root1 * random.unit_vector<N>();
      second.center = common - 0.999 * root2 * random.unit_vector<N>();
      const auto criterion = trial % 2 == 0 ? SizeCriterion<double, N>::trace() : SizeCriterion<double, N>::volume();
      Intersection<double, N> result;
      REQUIRE(minimal_intersection(first, second, criterion, result) == Status::ok);
      double form = 0;
      REQUIRE(quadratic_form(result.set, common, form) == Status::ok);
      worst = std::max(worst, form);
    }
    CHECK(worst <= 1);
  }
}

}  // namespace

TEST_CASE("Pairs of any condition keep a common point and are not taken for empty") {
  check_pairs_of_any_condition<3>();
  check_pairs_of_any_condition<6>();
}

namespace {

// Two ellipsoids with a point in common, zero, and little more: each reaches beyond it by about this share of its
// radius, from opposite sides. The centers are rounded as they may be.
std::array<Ellipsoid<double, 3>, 2> barely_meeting_pair(Random& random, double condition, long double beyond) {
  std::array<Ellipsoid<double, 3>, 2> pair;
  for (auto& e : pair) {
    e.shape = random.positive_definite<3>(random.log_uniform(1, condition));
  }
  const LongMatrix first = pair[0].shape.cast<long double>();
  const LongMatrix second = pair[1].shape.cast<long double>();
  const Eigen::LLT<LongMatrix> factor(first);
  const LongVector unit = random.unit_vector<3>().cast<long double>();
  const LongMatrix root = factor.matrixL();
  const LongVector center = (1 - beyond) * (root * unit);
  const LongVector normal = factor.solve(center);
  const LongVector along = second * normal;
  pair[0].center = center.cast<double>();
  pair[1].center = (-(1 - beyond) / std::sqrt(normal.dot(along)) * along).cast<double>();
  return pair;
}

}  // namespace

TEST_CASE("sets that barely meet are not empty where their margin says so and the smaller of the two is enough") {
  Random random(31);
  const Vector3<double> common = Vector3<double>::Zero();
  int met = 0;
  int alone = 0;
  for (int i = 0; i < 3000; ++i) {
    const auto pair = barely_meeting_pair(random, 1e10, static_cast<long double>(random.log_uniform(1e-14, 1e-4)));
    double margin;
    REQUIRE(overlap_margin(pair[0], pair[1], margin) == Status::ok);
    if (form(pair[0], common) >= 1 || form(pair[1], common) >= 1 || margin < 0) {
      continue;  // rounding has parted them
    }
    const Criterion<3> criterion = i % 2 == 0 ? Criterion<3>::volume() : Criterion<3>::trace();
    Intersection<double, 3> result;
    REQUIRE(minimal_intersection(pair[0], pair[1], criterion, result) == Status::ok);
    ++met;
    alone += result.share == 0 || result.share == 1 ? 1 : 0;
    const long double size = size_of<3>(result.set.shape.cast<long double>(), criterion);
    for (const auto& e : pair) {
      REQUIRE(size <= size_of<3>(e.shape.cast<long double>(), criterion) + 1e-3L);
    }
  }
  CHECK(met > 2000);
  CHECK(alone > 5);
}

TEST_CASE("what sets that barely meet have in common is bounded as sharply as that of others") {
  Random random(32);
  const Vector3<double> common = Vector3<double>::Zero();
  int met = 0;
  for (int i = 0; i < 300; ++i) {
    const auto pair = barely_meeting_pair(random, 10, static_cast<long double>(random.log_uniform(1e-11, 1e-4)));
    const Criterion<3> criterion = i % 2 == 0 ? Criterion<3>::volume() : Criterion<3>::trace();
    Intersection<double, 3> result;
    if (minimal_intersection(pair[0], pair[1], criterion, result) != Status::ok) {
      continue;  // rounding has parted them
    }
    ++met;
    const long double size = size_of<3>(result.set.shape.cast<long double>(), criterion);
    const long double least = smallest_by_search(pair[0], pair[1], criterion);
    CAPTURE(i);
    REQUIRE(static_cast<double>(size - least) < 1e-3);
    REQUIRE(form(result.set, common) < 1 + 1e-6);
  }
  CHECK(met > 290);
}
