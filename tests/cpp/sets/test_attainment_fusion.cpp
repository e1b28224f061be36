// Fusion's rounding terms one by one, its multipliers, and its proofs (theory, sections 7.4, 7.5, 16.5 and 16.6): parts of the
// search in float against the same numbers in long double (tests/mutations/quadric_fusion.toml, intersection.toml).
#include <doctest/doctest.h>

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
constexpr float epsilon = std::numeric_limits<float>::epsilon();

template <typename Scalar>
Real slack_of(const Quadric<Scalar, 3>& q, const RealVector& y) {
  return Real(q.c) - y.dot(q.a.template cast<Real>() * y) - 2 * y.dot(q.g.template cast<Real>());
}

/// A quadric as a direction or a rate gives one, of widths that differ.
Quadric<float, 3> random_quadric(Random& random, double sharp) {
  const Vector3d widths(random.log_uniform(0.01, 1), random.log_uniform(0.01, 1), 1);
  const Matrix3d a = sharp * random.symmetric<3>(widths);
  const Vector3d at = random.normal_matrix<3>();
  Quadric<float, 3> q;
  q.a = a.cast<float>();
  q.a = (0.5F * (q.a + q.a.transpose())).eval();
  q.g = Vector3d(-a * at).cast<float>();
  q.c = static_cast<float>(1 - at.dot(a * at));
  return q;
}

}  // namespace

TEST_CASE("a quadric in other coordinates is relaxed by what rounding does to it") {
  Random random(1);
  Real nearest = 1;
  for (int trial = 0; trial < 20000; ++trial) {
    const Quadric<float, 3> given = random_quadric(random, random.log_uniform(1, 1e6));
    Matrix3<float> factor = random.normal_matrix<3, 3>().cast<float>();
    factor = Matrix3<float>(factor.triangularView<Eigen::Lower>());
    factor *= static_cast<float>(random.log_uniform(1e-2, 10));
    const Vector3<float> shift = (random.log_uniform(1e-3, 10) * random.normal_matrix<3>()).cast<float>();
    const Vector3<float> reach = 1.001F * (shift.cwiseAbs() + factor.rowwise().norm());
    const float rounding = static_cast<float>(4 * (3 + 4) + 2) * epsilon;
    const auto seen = detail::relaxed<float, 3, 3>(given, factor, shift, reach, true, rounding);
    for (int k = 0; k < 8; ++k) {
      const RealVector u = random.unit_vector<3>().cast<Real>();
      const RealVector y = shift.cast<Real>() + factor.cast<Real>() * u;
      const Real gain = slack_of(seen, u) - slack_of(given, y);
      CHECK(gain >= 0);
      nearest = std::fmin(nearest, gain / (Real(rounding) * (std::fabs(Real(given.c)) + 1)));
    }
    // Without a prediction coordinates are only scaled, and all u count: far away the matrix decides, and near zero the level.
    const Matrix3<float> scale = factor.diagonal().cwiseAbs().asDiagonal();
    const auto scaled = detail::relaxed<float, 3, 3>(given, scale, Vector3<float>::Zero(), reach, false, rounding);
    for (int k = 0; k < 8; ++k) {
      const RealVector u = Real(random.log_uniform(1e-6, 1e6)) * random.unit_vector<3>().cast<Real>();
      CHECK(slack_of(scaled, u) >= slack_of(given, RealVector(scale.cast<Real>() * u)));
    }
  }
  CHECK(nearest < 10);
}

TEST_CASE("what the inversion may add to the level is enough for every point of the ball") {
  Random random(2);
  for (int trial = 0; trial < 20000; ++trial) {
    detail::ManyQuadrics<float, 3> problem;
    problem.with_ball = true;
    problem.count = 2;
    problem.constraints[0].constrain_all(
        3, [] { return Quadric<float, 3>{Matrix3<float>::Identity(), Vector3<float>::Zero(), 1}; });
    // A sharp quadric, nearly a cylinder, whose boundary goes through a point of the ball.
    const RealVector point = random.in_ball<3>().cast<Real>();
    Quadric<float, 3> q;
    const Matrix3d a =
        random.log_uniform(10, 1e6) * random.symmetric<3>(Vector3d(1, random.log_uniform(1e-7, 1), 1e-7));
    const Vector3d at = random.in_ball<3>();
    q.a = a.cast<float>();
    q.a = (0.5F * (q.a + q.a.transpose())).eval();
    q.g = Vector3d(-a * at).cast<float>();
    q.c = 0;
    q.c = static_cast<float>(-slack_of(q, point) * (1 + 1e-6L));
    problem.constraints[1].constrain_all(3, [&] { return q; });
    detail::ManyQuadrics<float, 3>::Multipliers mu{};
    mu[0] = static_cast<float>(random.log_uniform(1e-3, 1));
    mu[1] = static_cast<float>(random.log_uniform(1e-3, 1));
    detail::ManyQuadrics<float, 3>::Iterate it;
    if (problem.combine(mu, it) != Status::ok) {
      continue;
    }
    // uᵀAu + 2gᵀu ≤ c of the numbers as they are, on its boundary towards any side, if that is in the ball.
    RealMatrix sum = Real(mu[1]) * q.a.cast<Real>();
    sum.diagonal().array() += Real(mu[0]);
    const RealVector g = Real(mu[1]) * q.g.cast<Real>();
    const RealVector center = -sum.inverse() * g;
    const Real level = Real(mu[0]) + Real(mu[1]) * Real(q.c) - center.dot(sum * center) - 2 * center.dot(g);
    if (!(level > 0)) {
      continue;
    }
    const RealMatrix root = it.root.cast<Real>();
    const RealMatrix metric = RealMatrix(root.transpose() * root).inverse();
    for (int k = 0; k < 6; ++k) {
      const RealVector n = random.unit_vector<3>().cast<Real>();
      const RealVector u = center + std::sqrt(level / n.dot(sum * n)) * n;
      if (u.norm() <= 1) {
        const RealVector v = u - it.center.cast<Real>();
        CHECK(v.dot(metric * v) <= Real(it.level) + Real(it.rounding));
      }
    }
  }
}

namespace {

/// The largest form, in long double, of points that satisfy a thin prediction and slabs through them, all in float.
double worst_of_thin(double thin, double cut, Random& random, int trials) {
  double worst = 0;
  for (int trial = 0; trial < trials; ++trial) {
    Ellipsoid<float, 3> predicted;
    predicted.shape = random.symmetric<3>(Vector3d(1, thin * thin, thin)).cast<float>();
    predicted.shape = (0.5F * (predicted.shape + predicted.shape.transpose())).eval();
    predicted.center = (random.log_uniform(1e-3, 1) * random.unit_vector<3>()).cast<float>();
    const Eigen::LLT<RealMatrix> factor(RealMatrix(predicted.shape.cast<Real>()));
    if (factor.info() != Eigen::Success) {
      continue;
    }
    const RealMatrix root = factor.matrixL();
    const RealVector point = predicted.center.cast<Real>() + root * random.unit_vector<3>().cast<Real>();
    std::array<Quadric<float, 3>, 2> quadrics;
    for (auto& q : quadrics) {
      const Vector3<float> n = random.unit_vector<3>().cast<float>();
      q.a = n * n.transpose();
      // The slab's edge goes through the point.
      const double width = random.log_uniform(0.1, 1) * cut;
      const double middle = static_cast<double>(n.cast<Real>().dot(point)) - width;
      q.g = static_cast<float>(-middle) * n;
      q.c = 0;
      q.c = std::nextafter(static_cast<float>(-slack_of(q, point)), 1e9F);
    }
    QuadricFusion<float, 3> result;
    const Status status =
        minimal_intersection(&predicted, quadrics.data(), 2, SizeCriterion<float, 3>::volume(), result);
    CHECK(status != Status::empty_intersection);
    if (status != Status::ok) {
      continue;
    }
    const RealVector y = point - result.set.center.cast<Real>();
    const double form = static_cast<double>(y.dot(RealMatrix(result.set.shape.cast<Real>()).inverse() * y));
    worst = std::fmax(worst, result.prediction_alone ? 0.0 : form);
  }
  return worst;
}

}  // namespace

TEST_CASE("thin sets in float keep the points of their rim") {
  Random random(3);
  for (const double thin : {0.3, 1e-2, 1e-3}) {
    for (const double cut : {1.0, 0.1, 1e-3}) {
      const double worst = worst_of_thin(thin, cut, random, 2000);
      CAPTURE(thin);
      CAPTURE(cut);
      CHECK(worst <= 1);
    }
  }
}

TEST_CASE("the result is the combination with the multipliers that are reported") {
  Random random(4);
  int used = 0;
  for (int trial = 0; trial < 300; ++trial) {
    Ellipsoid<double, 3> predicted{random.normal_matrix<3>(), random.positive_definite<3>(10)};
    std::array<Quadric<double, 3>, 3> quadrics;
    for (auto& q : quadrics) {
      const double scale = random.log_uniform(1e-3, 1e3);
      REQUIRE(to_quadric(Ellipsoid<double, 3>{predicted.center + 0.5 * random.unit_vector<3>(),
                                              random.positive_definite<3>(10)},
                         q) == Status::ok);
      q = {scale * q.a, scale * q.g, scale * q.c};
    }
    QuadricFusion<double, 3> result;
    REQUIRE(minimal_intersection(&predicted, quadrics.data(), 3, SizeCriterion<double, 3>::volume(), result) ==
            Status::ok);
    if (result.prediction_alone) {
      continue;
    }
    ++used;
    Matrix3d a = result.predicted_multiplier * predicted.shape.inverse();
    Vector3d g = -a * predicted.center;
    double c = result.predicted_multiplier * (1 - predicted.center.dot(predicted.shape.inverse() * predicted.center));
    double sum = result.predicted_multiplier;
    for (std::size_t k = 0; k < 3; ++k) {
      a += result.multipliers[k] * quadrics[k].a;
      g += result.multipliers[k] * quadrics[k].g;
      c += result.multipliers[k] * quadrics[k].c;
      sum += result.multipliers[k];
    }
    CHECK(sum == doctest::Approx(1));
    const Vector3d center = -a.inverse() * g;
    const Matrix3d shape = (c - center.dot(a * center) - 2 * center.dot(g)) * a.inverse();
    CHECK((center - result.set.center).norm() < 1e-9);
    CHECK((shape - result.set.shape).norm() < 1e-9 * shape.norm());
  }
  CHECK(used > 200);
}

// --- two sets ---------------------------------------------------------------------------------------------------------

TEST_CASE("balls of any sizes in any coordinates are empty exactly if they are apart") {
  Random random(5);
  for (int trial = 0; trial < 4000; ++trial) {
    const double small = random.log_uniform(1e-3, 1);
    const double gap = (trial % 2 == 0 ? 1e-3 : -1e-3) * small;
    const Matrix3d map =
        random.orthogonal<3>() * Vector3d(1, random.log_uniform(0.03, 1), random.log_uniform(0.03, 1)).asDiagonal();
    const Vector3d n = random.unit_vector<3>();
    const Ellipsoid<double, 3> first{Vector3d::Zero(), map * map.transpose()};
    const Ellipsoid<double, 3> second{map * ((1 + small + gap) * n), small * small * map * map.transpose()};
    for (const auto& criterion : {SizeCriterion<double, 3>::volume(), SizeCriterion<double, 3>::trace()}) {
      Intersection<double, 3> result;
      CHECK(minimal_intersection(first, second, criterion, result) ==
            (gap > 0 ? Status::empty_intersection : Status::ok));
      CHECK(minimal_intersection(second, first, criterion, result) ==
            (gap > 0 ? Status::empty_intersection : Status::ok));
      Quadric<double, 3> quadric;
      REQUIRE(to_quadric(first, quadric) == Status::ok);
      CHECK(minimal_intersection(quadric, second, criterion, result) ==
            (gap > 0 ? Status::empty_intersection : Status::ok));
    }
  }
}

TEST_CASE("sets that touch in one point are not empty") {
  // In numbers that round nowhere.
  for (const double small : {0.5, 1.0, 2.0}) {
    const Ellipsoid<double, 3> first{Vector3d::Zero(), Matrix3d::Identity()};
    const Ellipsoid<double, 3> second{Vector3d(1 + small, 0, 0), small * small * Matrix3d::Identity()};
    for (const auto& criterion : {SizeCriterion<double, 3>::volume(), SizeCriterion<double, 3>::trace()}) {
      Intersection<double, 3> result;
      REQUIRE(minimal_intersection(first, second, criterion, result) == Status::ok);
      double form = 2;
      if (quadratic_form(result.set, Vector3d(1, 0, 0), form) == Status::ok) {
        CHECK(form <= 1 + 1e-6);
      }
    }
  }
  const Ellipsoid<double, 3> ball{Vector3d::Zero(), Matrix3d::Identity()};
  Intersection<double, 3> result;
  // Nothing is said, and nothing is possible.
  const Quadric<double, 3> nothing{Matrix3d::Zero(), Vector3d::Zero(), 0};
  CHECK(minimal_intersection(nothing, ball, SizeCriterion<double, 3>::volume(), result) == Status::ok);
  const Quadric<double, 3> impossible{Matrix3d::Zero(), Vector3d::Zero(), -1};
  CHECK(minimal_intersection(impossible, ball, SizeCriterion<double, 3>::volume(), result) ==
        Status::empty_intersection);
}

TEST_CASE("the intersection is not larger than either set to the last digit") {
  Random random(6);
  for (int trial = 0; trial < 4000; ++trial) {
    // A second set that just misses being inside: nearly nothing is gained.
    const Ellipsoid<double, 3> first{Vector3d::Zero(), random.positive_definite<3>(4)};
    const Ellipsoid<double, 3> second{1e-9 * random.unit_vector<3>(), (1 + 1e-9) * first.shape};
    for (const auto& criterion : {SizeCriterion<double, 3>::volume(), SizeCriterion<double, 3>::trace()}) {
      Intersection<double, 3> result;
      REQUIRE(minimal_intersection(second, first, criterion, result) == Status::ok);
      CHECK(result.set.shape.trace() <= first.shape.trace());
    }
  }
}

TEST_CASE("needles that touch keep their common point") {
  Random random(7);
  for (int trial = 0; trial < 4000; ++trial) {
    const double thin = random.log_uniform(1e-9, 1e-5);
    const auto needle = [&] {
      const Matrix3d axes = random.orthogonal<3>();
      Ellipsoid<double, 3> set;
      set.shape = axes * Vector3d(1, thin * thin, thin).asDiagonal() * axes.transpose();
      set.shape = (0.5 * (set.shape + set.shape.transpose())).eval();
      set.center = 0.99 * axes.col(0);  // the origin is just inside the tip
      return set;
    };
    const Ellipsoid<double, 3> first = needle();
    const Ellipsoid<double, 3> second = needle();
    Intersection<double, 3> result;
    CHECK(minimal_intersection(first, second, SizeCriterion<double, 3>::volume(), result) !=
          Status::empty_intersection);
  }
}
