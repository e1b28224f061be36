// The fusion of many quadrics: containment in long double at extreme ratios, the optimum against coordinate descent in long
// double, derivatives against differences, emptiness against the overlap of two ellipsoids.
#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "elliptude/measurement/quadrics.hpp"
#include "elliptude/sets/quadric_fusion.hpp"
#include "support/random.hpp"
#include "support/search.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using LongMatrix6 = Eigen::Matrix<long double, 6, 6>;
using LongVector6 = Eigen::Matrix<long double, 6, 1>;
using Long3 = Eigen::Matrix<long double, 3, 1>;
using Ellipsoid6 = Ellipsoid<double, 6>;
using Criterion = SizeCriterion<double, 6>;
using Fusion6 = QuadricFusion<double, 6>;

template <typename Scalar>
long double form(const Ellipsoid<Scalar, 6>& ellipsoid, const LongVector6& y) {
  const LongVector6 x = y - ellipsoid.center.template cast<long double>();
  return x.dot(Eigen::LLT<LongMatrix6>(ellipsoid.shape.template cast<long double>()).solve(x));
}

template <typename Scalar>
long double slack_of(const Quadric<Scalar, 6>& quadric, const LongVector6& y) {
  return static_cast<long double>(quadric.c) - y.dot(quadric.a.template cast<long double>() * y) -
         2 * y.dot(quadric.g.template cast<long double>());
}

long double size_of(const Matrix6<double>& shape, const Criterion& criterion) {
  const LongMatrix6 p = shape.cast<long double>();
  return criterion.kind == Criterion::Kind::volume ? std::log(Eigen::PartialPivLU<LongMatrix6>(p).determinant())
                                                   : 6 * std::log((criterion.weight.cast<long double>() * p).trace());
}

// A predicted ellipsoid, three cones and a rate, all of which hold for `truth`: on the boundary of a cone, or of the
// prediction, or inside.
struct Scene {
  Ellipsoid6 predicted;
  std::array<HalfQuadric<double>, 4> halves;
  std::array<Quadric<double, 6>, 4> quadrics;  // the same of all six coordinates
  LongVector6 truth;
};

Scene make_scene(Random& random, double predicted_radius, double r, int kind) {
  Scene scene;
  const Matrix3<double> center = random.rotation();
  const Vector3<double> rate = r * random.normal_matrix<3>();
  scene.predicted.shape = random.positive_definite<6>(kind % 2 == 0 ? 10.0 : 1000.0);
  scene.predicted.shape *= predicted_radius * predicted_radius / scene.predicted.shape.diagonal().maxCoeff();
  scene.predicted.center.setZero();
  const LongMatrix6 l = Eigen::LLT<LongMatrix6>(scene.predicted.shape.cast<long double>()).matrixL();
  const Vector6<double> u = kind % 3 == 0 ? random.unit_vector<6>() : random.in_ball<6>();
  scene.truth = l * u.normalized().cast<long double>() * (static_cast<long double>(u.norm()) * (1 - 1e-15L));
  const Long3 g = scene.truth.head<3>() / 2;
  const Eigen::Matrix<long double, 3, 3> turn =
      Eigen::Quaternion<long double>(1, g.x(), g.y(), g.z()).normalized().toRotationMatrix();
  const Matrix3<double> axes = random.orthogonal<3>();
  for (int k = 0; k < 3; ++k) {
    const Vector3<double> e = kind % 4 == 0 ? Vector3<double>(axes.col(k)) : random.unit_vector<3>();
    const Long3 b = turn.transpose() * (center.transpose().cast<long double>() * e.cast<long double>()).normalized();
    const Long3 across = b.cross(random.unit_vector<3>().cast<long double>()).normalized();
    const long double angle =
        (kind % 5 < 2 ? 1.0L : static_cast<long double>(random.uniform(0, 1))) * static_cast<long double>(r);
    const Long3 measured = std::cos(angle) * b + std::sin(angle) * across;
    Quadric<double, 3> quadric;
    REQUIRE(cone(center, Direction<double>::within(e, measured.cast<double>(), r), quadric) == Status::ok);
    scene.halves[static_cast<std::size_t>(k)] = of_attitude(quadric);
  }
  const Vector3<double> offset = (1 - 1e-12) * (kind % 5 < 2 ? random.unit_vector<3>() : random.in_ball<3>());
  Quadric<double, 3> quadric;
  REQUIRE(
      to_quadric(rate,
                 AngularVelocity<double>{rate + (scene.truth.tail<3>() + r * offset.cast<long double>()).cast<double>(),
                                         (1 + 1e-12) * r * r * Matrix3<double>::Identity()},
                 quadric) == Status::ok);
  scene.halves[3] = of_vector(quadric);
  for (std::size_t k = 0; k < 4; ++k) {
    scene.quadrics[k] = extended(scene.halves[k]);
  }
  return scene;
}

// The least size by coordinate descent: F = N − log det A or N + n log tr(W A⁻¹) is convex in μ ≥ 0 (theory, section 16).
long double smallest_by_descent(const std::vector<Quadric<double, 6>>& constraints, const Criterion& criterion,
                                std::vector<long double>& mu) {
  const std::size_t count = constraints.size();
  const auto value = [&](const std::vector<long double>& m) {
    LongMatrix6 a = LongMatrix6::Zero();
    LongVector6 g = LongVector6::Zero();
    long double c = 0;
    for (std::size_t k = 0; k < count; ++k) {
      a += m[k] * constraints[k].a.cast<long double>();
      g += m[k] * constraints[k].g.cast<long double>();
      c += m[k] * static_cast<long double>(constraints[k].c);
    }
    const Eigen::LLT<LongMatrix6> factor(a);
    if (factor.info() != Eigen::Success) {
      return HUGE_VALL;
    }
    const long double level = c + g.dot(factor.solve(g));
    if (criterion.kind == Criterion::Kind::volume) {
      return level - 2 * factor.matrixLLT().diagonal().array().log().sum();
    }
    const LongMatrix6 inverse = factor.solve(LongMatrix6::Identity());
    return level + 6 * std::log((criterion.weight.cast<long double>() * inverse).trace());
  };
  long double best = value(mu);
  for (int sweep = 0; sweep < 200; ++sweep) {
    const long double before = best;
    for (std::size_t k = 0; k < count; ++k) {
      const long double log_mu = std::log(mu[k]);
      long double low = log_mu - (sweep < 3 ? 12.0L : 1.0L);
      long double high = log_mu + (sweep < 3 ? 12.0L : 1.0L);
      const auto along = [&](long double x) {
        std::vector<long double> trial = mu;
        trial[k] = std::exp(x);
        return value(trial);
      };
      const long double golden = (std::sqrt(5.0L) - 1) / 2;
      for (int i = 0; i < 45; ++i) {
        const long double left = high - golden * (high - low);
        const long double right = low + golden * (high - low);
        if (along(left) < along(right)) {
          high = right;
        } else {
          low = left;
        }
      }
      const long double found = along((low + high) / 2);
      if (found < best) {
        best = found;
        mu[k] = std::exp((low + high) / 2);
      }
    }
    if (before - best < 1e-9L) {
      break;
    }
  }
  // N = n at the best scale: the logarithm of the volume's square, or 6 times that of the trace.
  return best - 6 + 6 * std::log(6.0L);
}

}  // namespace

TEST_CASE("fusion never loses what satisfies every constraint") {
  Random random(1);
  for (const double ratio : {1e-9, 1e-6, 1e-3, 0.3, 3.0, 1e3, 1e6, 1e9, 1e12}) {
    long double worst = 0;
    int smaller = 0;
    for (int trial = 0; trial < 400; ++trial) {
      const double r = ratio > 1 ? 0.5 / ratio : 0.05;
      const Scene scene = make_scene(random, r * ratio, r, trial);
      for (const Criterion& criterion : {Criterion::volume(), Criterion::trace()}) {
        Fusion6 result;
        REQUIRE(minimal_intersection(&scene.predicted, scene.quadrics.data(), 4, criterion, result) == Status::ok);
        CHECK(size_of(result.set.shape, criterion) <= size_of(scene.predicted.shape, criterion));
        worst = std::max(worst, form(result.set, scene.truth));
        smaller += result.prediction_alone ? 0 : 1;
      }
    }
    INFO("ratio " << ratio);
    CHECK(worst <= 1);
    CHECK(smaller >= (ratio >= 3 ? 790 : 0));
  }
}

TEST_CASE("fusion in float never loses what satisfies every constraint") {
  Random random(2);
  for (const double ratio : {1e-3, 1.0, 30.0, 1e3, 1e5}) {
    for (int trial = 0; trial < 200; ++trial) {
      const double r = ratio > 1 ? 0.5 / ratio : 0.05;
      const Scene scene = make_scene(random, r * ratio, r, trial);
      const Ellipsoid<float, 6> predicted{scene.predicted.center.cast<float>(),
                                          scene.predicted.shape.cast<float>() * 1.00001F};
      std::array<Quadric<float, 6>, 4> quadrics;
      bool consistent = form(predicted, scene.truth) <= 1;
      for (std::size_t k = 0; k < 4; ++k) {
        const Quadric<double, 6>& q = scene.quadrics[k];
        quadrics[k] = {q.a.cast<float>(), q.g.cast<float>(), static_cast<float>(q.c)};
        consistent = consistent && slack_of(quadrics[k], scene.truth) >= 0;  // also as the rounded input says
      }
      QuadricFusion<float, 6> result;
      if (consistent) {
        REQUIRE(minimal_intersection(&predicted, quadrics.data(), 4, SizeCriterion<float, 6>::volume(), result) ==
                Status::ok);
        CHECK(form(result.set, scene.truth) <= 1);
      }
    }
  }
}

TEST_CASE("fusion finds the smallest ellipsoid of the family") {
  Random random(3);
  long double worst = 0;
  for (int trial = 0; trial < 24; ++trial) {
    const double r = random.log_uniform(1e-3, 0.1);
    const Scene scene = make_scene(random, r * random.log_uniform(0.3, 30), r, trial);
    std::vector<Quadric<double, 6>> all(1);
    REQUIRE(to_quadric(scene.predicted, all[0]) == Status::ok);
    all.insert(all.end(), scene.quadrics.begin(), scene.quadrics.end());
    Matrix6<double> weight = Matrix6<double>::Identity();
    weight.bottomRightCorner<3, 3>() *= 30;
    for (const Criterion& criterion : {Criterion::volume(), Criterion::trace(), Criterion::weighted_trace(weight)}) {
      Fusion6 result;
      REQUIRE(minimal_intersection(&scene.predicted, scene.quadrics.data(), 4, criterion, result) == Status::ok);
      std::vector<long double> mu(5, 1.2L);
      const long double best =
          std::min(smallest_by_descent(all, criterion, mu), size_of(scene.predicted.shape, criterion));
      worst = std::max(worst, size_of(result.set.shape, criterion) - best);
      CHECK(size_of(result.set.shape, criterion) - best <= 1e-3L);
      CHECK(size_of(result.set.shape, criterion) - best >= -1e-7L);
    }
  }
  MESSAGE("worst excess of the logarithm: " << static_cast<double>(worst));
}

TEST_CASE("quadrics of three coordinates are fused like the same of six") {
  Random random(31);
  for (int trial = 0; trial < 300; ++trial) {
    const double r = random.log_uniform(1e-5, 0.3);
    const Scene scene = make_scene(random, r * random.log_uniform(0.1, 1e3), r, trial);
    for (const Criterion& criterion : {Criterion::volume(), Criterion::trace()}) {
      for (const Ellipsoid6* predicted : {&scene.predicted, static_cast<const Ellipsoid6*>(nullptr)}) {
        Fusion6 half;
        Fusion6 whole;
        const Status status = minimal_intersection(predicted, scene.quadrics.data(), 4, criterion, whole);
        REQUIRE(minimal_intersection(predicted, scene.halves.data(), 4, criterion, half) == status);
        if (status == Status::ok) {
          CHECK(static_cast<double>(size_of(half.set.shape, criterion)) ==
                doctest::Approx(static_cast<double>(size_of(whole.set.shape, criterion))).epsilon(3e-3));
          CHECK(form(half.set, scene.truth) <= 1);
        }
      }
    }
  }
}

TEST_CASE("of many that are alike the sharpest is found") {
  Random random(32);
  for (int trial = 0; trial < 200; ++trial) {
    const Scene scene = make_scene(random, 1.0, 0.1, trial);
    const int count = 2 + trial % 9;
    const double spread = trial % 2 == 0 ? 0.03 : 0.2;
    std::vector<HalfQuadric<double>> alike;
    for (int k = 0; k < count; ++k) {
      const double radius = 0.1 * std::sqrt(1 + (k == 0 ? 0 : random.uniform(0.1, 1) * spread));
      alike.push_back(of_attitude(
          Quadric<double, 3>{Matrix3<double>::Identity() / (radius * radius), Vector3<double>::Zero(), 1.0}));
    }
    for (const Criterion& criterion : {Criterion::volume(), Criterion::trace()}) {
      Fusion6 all;
      Fusion6 one;
      REQUIRE(minimal_intersection(&scene.predicted, alike.data(), alike.size(), criterion, all) == Status::ok);
      REQUIRE(minimal_intersection(&scene.predicted, alike.data(), 1, criterion, one) == Status::ok);
      CHECK(size_of(all.set.shape, criterion) - size_of(one.set.shape, criterion) <= 5e-3L);
    }
  }
}

TEST_CASE("the result is not larger than a prediction of strong correlations") {
  for (const double correlation : {1 - 1e-6, 1 - 1e-9, 1 - 1e-11}) {
    for (const double offset : {0.0, 100.0}) {
      Ellipsoid6 predicted{Vector6<double>::Constant(offset), Matrix6<double>::Identity()};
      predicted.shape.topRightCorner<3, 3>().diagonal().setConstant(correlation);
      predicted.shape.bottomLeftCorner<3, 3>().diagonal().setConstant(correlation);
      for (int k = 0; k < 100; ++k) {
        // Sharper by next to nothing than where it would begin to make the prediction smaller.
        const double sharpness = 2 + 2 * std::pow(10.0, -0.5 - 0.1 * k);
        const Quadric<double, 3> quadric{sharpness * Matrix3<double>::Identity(),
                                         Vector3<double>::Constant(-sharpness * offset),
                                         1 - 3 * sharpness * offset * offset};
        const HalfQuadric<double> half = of_attitude(quadric);
        Fusion6 result;
        for (const Criterion& criterion : {Criterion::volume(), Criterion::trace()}) {
          REQUIRE(minimal_intersection(&predicted, &half, 1, criterion, result) == Status::ok);
          CHECK(size_of(result.set.shape, criterion) <= size_of(predicted.shape, criterion) + 1e-7L);
        }
      }
    }
  }
}

TEST_CASE("fusion of two ellipsoids is that of two sets") {
  Random random(4);
  int empty = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    const Criterion criterion = trial % 2 == 0 ? Criterion::volume() : Criterion::trace();
    const Ellipsoid6 first{Vector6<double>::Zero(), random.positive_definite<6>(1e4)};
    const Ellipsoid6 second{random.uniform(0, 0.5) * random.normal_matrix<6>(), random.positive_definite<6>(1e4)};
    Quadric<double, 6> quadric;
    REQUIRE(to_quadric(second, quadric) == Status::ok);
    Intersection<double, 6> two;
    Fusion6 many;
    const Status status = minimal_intersection(first, second, criterion, two);
    REQUIRE(minimal_intersection(&first, &quadric, 1, criterion, many) == status);
    if (status == Status::ok) {
      const long double excess = size_of(many.set.shape, criterion) - size_of(two.set.shape, criterion);
      CHECK(excess <= 1e-3L);
      CHECK(excess >= -1e-5L);
    } else {
      ++empty;
      CHECK(many.margin < 0);
    }
  }
  CHECK(empty > 20);
}

TEST_CASE("emptiness is proved where two ellipsoids do not overlap and nowhere else") {
  Random random(5);
  int proved = 0;
  for (int trial = 0; trial < 600; ++trial) {
    const Ellipsoid6 first{Vector6<double>::Zero(), random.positive_definite<6>(100.0)};
    Ellipsoid6 second{random.unit_vector<6>(), random.positive_definite<6>(100.0)};
    // 1 − margin grows with the square of the distance.
    double margin;
    REQUIRE(overlap_margin(first, second, margin) == Status::ok);
    const double wanted = random.log_uniform(1e-7, 1) * (trial % 2 == 0 ? 1 : -1);
    second.center *= std::sqrt((1 - wanted) / (1 - margin));
    REQUIRE(overlap_margin(first, second, margin) == Status::ok);
    Quadric<double, 6> quadric;
    REQUIRE(to_quadric(second, quadric) == Status::ok);
    Fusion6 result;
    result.margin = 7;
    const Status status = minimal_intersection(&first, &quadric, 1, Criterion::volume(), result);
    if (margin > 0) {
      CHECK(status == Status::ok);
      CHECK(result.margin >= margin * (1 - 1e-6) - 1e-12);
    } else if (status == Status::empty_intersection) {
      ++proved;
      CHECK(result.margin < 0);
      CHECK(result.margin >= margin * (1 + 1e-6) - 1e-12);
    } else {
      CHECK(margin > -1e-5);  // so close that a proof may be missed, but never made where there is none
    }
  }
  MESSAGE("proved empty: " << proved << " of 300");
  CHECK(proved >= 290);
}

TEST_CASE("a contradicting sensor is named") {
  Random random(6);
  int named = 0;
  for (int trial = 0; trial < 200; ++trial) {
    Scene scene = make_scene(random, 0.05, 0.02, trial);
    const std::size_t wrong = static_cast<std::size_t>(trial % 3);
    const Matrix3<double> center = Matrix3<double>::Identity();
    const Vector3<double> e = random.unit_vector<3>();
    Quadric<double, 3> quadric;
    const Vector3<double> turned = exp(Vector3<double>(0.5 * e.cross(random.unit_vector<3>()).normalized())) * e;
    REQUIRE(cone(center, Direction<double>::within(e, turned, 0.02), quadric) == Status::ok);
    scene.quadrics[wrong] = extended(of_attitude(quadric));
    Fusion6 result;
    result.prediction_alone = true;
    REQUIRE(minimal_intersection(&scene.predicted, scene.quadrics.data(), 4, Criterion::volume(), result) ==
            Status::empty_intersection);
    CHECK(result.margin < 0);
    named += result.contradiction == wrong ? 1 : 0;
  }
  CHECK(named >= 190);
}

TEST_CASE("quadrics alone are fused where they bound a set") {
  Random random(7);
  for (int trial = 0; trial < 300; ++trial) {
    const double r = random.log_uniform(1e-4, 0.3);
    const Scene scene = make_scene(random, r, r, 4 * trial);  // three orthogonal directions
    for (const Criterion& criterion : {Criterion::volume(), Criterion::trace()}) {
      Fusion6 result;
      REQUIRE(minimal_intersection<double, 6>(nullptr, scene.quadrics.data(), 4, criterion, result) == Status::ok);
      CHECK(form(result.set, scene.truth) <= 1);
      CHECK(result.predicted_multiplier == 0);
      if (trial < 10) {
        const std::vector<Quadric<double, 6>> all(scene.quadrics.begin(), scene.quadrics.end());
        std::vector<long double> mu(4, 1.5L);
        const long double excess = size_of(result.set.shape, criterion) - smallest_by_descent(all, criterion, mu);
        CHECK(excess <= 1e-3L);
        CHECK(excess >= -1e-7L);
      }
    }
    Fusion6 result;
    CHECK(minimal_intersection<double, 6>(nullptr, scene.quadrics.data(), 3, Criterion::volume(), result) ==
          Status::unbounded);  // nothing is said of the rate
    QuadricFusion<double, 3> attitude;
    const Quadric<double, 3> one{scene.quadrics[0].a.topLeftCorner<3, 3>(), scene.quadrics[0].g.head<3>(),
                                 scene.quadrics[0].c};
    CHECK(minimal_intersection<double, 3>(nullptr, &one, 1, SizeCriterion<double, 3>::volume(), attitude) ==
          Status::unbounded);
  }
}

TEST_CASE("a sharp attitude far from the center is used in full") {
  // Nothing of what is to be found depends on the sharpness, but for rounding: it only scales the attitude.
  const Ellipsoid6 predicted{Vector6<double>::Zero(), Matrix6<double>::Identity()};
  Random random(23);
  for (int trial = 0; trial < 20; ++trial) {
    const Matrix3<double> center = random.rotation();
    const Vector3<double> turn = 0.8 * random.unit_vector<3>();
    const auto relative_size = [&](double r) {
      const MeasuredAttitude<double> measured{center * exp(turn), r * r * Matrix3<double>::Identity()};
      Quadric<double, 3> quadric;
      REQUIRE(to_quadric(center, measured, quadric) == Status::ok);
      const Quadric<double, 6> seen = extended(of_attitude(quadric));
      Fusion6 fusion;
      REQUIRE(minimal_intersection(&predicted, &seen, 1, Criterion::volume(), fusion) == Status::ok);
      return std::sqrt(fusion.set.shape.topLeftCorner<3, 3>().trace()) / r;
    };
    const double expected = relative_size(1e-2);
    for (const double r : {1e-3, 1e-4, 1e-5}) {
      CHECK(relative_size(r) == doctest::Approx(expected).epsilon(0.005));
    }
    CHECK(relative_size(1e-6) < 1.1 * expected);  // the widening for rounding begins
  }
}

TEST_CASE("a prediction cuts a set that is far sharper") {
  // A ball of radius r about a point next to the unit sphere: to order r the sphere is a plane, at the distance k r from the center,
  // and a ball with a half-space gives balls, the smallest of them about the disk in which the plane cuts it: of radius r √(1 − k²).
  Random random(24);
  for (const double r : {1e-2, 1e-4, 1e-5}) {
    for (const double k : {0.5, 0.9}) {
      const Vector6<double> axis = random.unit_vector<6>();
      const Ellipsoid6 predicted{Vector6<double>::Zero(), Matrix6<double>::Identity()};
      const Ellipsoid6 sharp{(1 + k * r) * axis, r * r * Matrix6<double>::Identity()};
      Quadric<double, 6> quadric;
      REQUIRE(to_quadric(sharp, quadric) == Status::ok);
      Fusion6 fusion;
      REQUIRE(minimal_intersection(&predicted, &quadric, 1, Criterion::volume(), fusion) == Status::ok);
      const double log_volume = 6 * std::log(1 - k * k);
      const double found = std::log(static_cast<double>(
          Eigen::PartialPivLU<LongMatrix6>((fusion.set.shape / (r * r)).cast<long double>()).determinant()));
      CHECK(found == doctest::Approx(log_volume).scale(1).epsilon(r == 1e-4 ? 0.01 : 0.1));
    }
    for (const double k : {1.1, 3.0, 50.0}) {
      const Ellipsoid6 predicted{Vector6<double>::Zero(), Matrix6<double>::Identity()};
      const Ellipsoid6 sharp{(1 + k * r) * random.unit_vector<6>(), r * r * Matrix6<double>::Identity()};
      Quadric<double, 6> quadric;
      REQUIRE(to_quadric(sharp, quadric) == Status::ok);
      Fusion6 fusion;
      CHECK(minimal_intersection(&predicted, &quadric, 1, Criterion::volume(), fusion) == Status::empty_intersection);
    }
  }
}

TEST_CASE("a sharp set far from zero is found without a prediction") {
  for (const double r : {1e-3, 1e-5, 1e-6}) {
    Quadric<double, 6> quadric;
    const Ellipsoid6 sharp{0.5 * Vector6<double>::Unit(2), r * r * Matrix6<double>::Identity()};
    REQUIRE(to_quadric(sharp, quadric) == Status::ok);
    Fusion6 fusion;
    REQUIRE(minimal_intersection<double, 6>(nullptr, &quadric, 1, Criterion::volume(), fusion) == Status::ok);
    CHECK(std::sqrt(fusion.set.shape.diagonal().maxCoeff()) < 1.1 * r);
  }
}

TEST_CASE("forty quadrics are fused") {
  Random random(8);
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<Quadric<double, 6>> quadrics;
    const Scene scene = make_scene(random, 0.1, 0.05, 1);
    for (std::size_t k = 0; k < most_quadrics; ++k) {  // ellipsoids that hold the truth
      Ellipsoid6 ellipsoid{Vector6<double>::Zero(), 0.01 * random.positive_definite<6>(100.0)};
      const Matrix6<double> l = Eigen::LLT<Matrix6<double>>(ellipsoid.shape).matrixL();
      ellipsoid.center = scene.truth.cast<double>() + (1 - 1e-9) * l * random.in_ball<6>();
      Quadric<double, 6> quadric;
      REQUIRE(to_quadric(ellipsoid, quadric) == Status::ok);
      quadrics.push_back(quadric);
    }
    Fusion6 result;
    REQUIRE(minimal_intersection(&scene.predicted, quadrics.data(), quadrics.size(), Criterion::volume(), result) ==
            Status::ok);
    CHECK(form(result.set, scene.truth) <= 1);
    if (trial < 2) {
      std::vector<Quadric<double, 6>> all = quadrics;
      all.emplace_back();
      REQUIRE(to_quadric(scene.predicted, all.back()) == Status::ok);
      std::vector<long double> mu(all.size(), 0.15L);
      CHECK(size_of(result.set.shape, Criterion::volume()) - smallest_by_descent(all, Criterion::volume(), mu) <=
            1e-3L);
    }
    quadrics.push_back(quadrics.front());
    CHECK(minimal_intersection(&scene.predicted, quadrics.data(), quadrics.size(), Criterion::volume(), result) ==
          Status::out_of_range);
  }
}

TEST_CASE("the gradient and the Hessian are those of F") {
  Random random(9);
  using Problem = detail::ManyQuadrics<double, 6>;
  for (int trial = 0; trial < 20; ++trial) {
    const Scene scene = make_scene(random, 1.0, 1.0, trial);
    Problem problem;
    problem.with_ball = true;
    problem.volume = trial % 2 == 0;
    problem.weight = random.positive_definite<6>(10.0);
    problem.count = 5;
    problem.constraints[0].constrain_all(
        6, [] { return Quadric<double, 6>{Matrix6<double>::Identity(), Vector6<double>::Zero(), 1.0}; });
    for (std::size_t k = 0; k < 4; ++k) {
      const Quadric<double, 6>& q = scene.quadrics[k];
      if (k < 3 && trial % 3 != 0) {
        problem.constraints[k + 1].constrain_leading(
            3, [&] { return Quadric<double, 3>{q.a.topLeftCorner<3, 3>(), q.g.head<3>(), q.c}; });
      } else {
        problem.constraints[k + 1].constrain_all(3, [&] { return q; });
      }
    }
    Problem::Multipliers mu{};
    for (std::size_t k = 0; k < 5; ++k) {
      mu[k] = random.uniform(0.5, 2) * (k == 0 ? 5 : 1);
    }
    Problem::Iterate at;
    REQUIRE(problem.combine(mu, at) == Status::ok);
    Problem::Multipliers gradient{};
    Matrix6<double> v;
    problem.gradient(at, v, gradient);
    std::array<double, Problem::most * Problem::most> hessian{};
    problem.hessian(at, v, gradient, hessian.data());
    const double h = 1e-5;
    for (std::size_t j = 0; j < 5; ++j) {
      const double trace = at.slack[j] - gradient[j];
      const double curvature = hessian[j * Problem::most + j] - trace * trace / 6;
      const double least = problem.least_curvature(j, at, v, gradient);
      if (j == 0) {
        CHECK(least == doctest::Approx(curvature));
      } else if (problem.volume) {
        CHECK(least <= curvature + 1e-9);
      }
      const auto moved = [&](double by, Problem::Iterate& it, Problem::Multipliers& slope) {
        Problem::Multipliers other = mu;
        other[j] += by;
        REQUIRE(problem.combine(other, it) == Status::ok);
        Matrix6<double> w;
        problem.gradient(it, w, slope);
      };
      Problem::Iterate up;
      Problem::Iterate down;
      Problem::Multipliers slope_up{};
      Problem::Multipliers slope_down{};
      moved(h, up, slope_up);
      moved(-h, down, slope_down);
      CHECK(gradient[j] ==
            doctest::Approx((up.level + up.barrier - down.level - down.barrier) / (2 * h)).epsilon(1e-7));
      for (std::size_t k = 0; k <= j; ++k) {
        CHECK(hessian[j * Problem::most + k] == doctest::Approx((slope_up[k] - slope_down[k]) / (2 * h)).epsilon(1e-6));
      }
    }
  }
}

TEST_CASE("a prediction that nothing improves is returned unchanged") {
  Random random(10);
  const Scene scene = make_scene(random, 0.001, 2.0, 4);
  Fusion6 result;
  REQUIRE(minimal_intersection(&scene.predicted, scene.quadrics.data(), 4, Criterion::volume(), result) == Status::ok);
  CHECK(result.prediction_alone);
  CHECK(result.set.shape == scene.predicted.shape);
  CHECK(result.set.center == scene.predicted.center);
  CHECK(result.predicted_multiplier == 1);
  REQUIRE(minimal_intersection(&scene.predicted, scene.quadrics.data(), 0, Criterion::trace(), result) == Status::ok);
  CHECK(result.prediction_alone);
  CHECK(result.contradiction == Fusion6::none);
}

TEST_CASE("no step makes a multiplier negative, whatever rounding makes of it") {
  // Multipliers and constraints of any size: ∇²F has rank two, and is not even semidefinite after rounding. Some of these
  // steps made one negative before the end of a step saw to it.
  Random random(61);
  using Step = detail::MultiplierStep<double>;
  for (int i = 0; i < 200000; ++i) {
    const std::size_t count = 2 + static_cast<std::size_t>(i % 7);
    Step step(count);
    Step::Multipliers multipliers;
    std::array<Eigen::Vector2d, 8> rows;
    for (std::size_t k = 0; k < count; ++k) {
      multipliers[k] = random.log_uniform(1e-13, 1e-7);
      rows[k] = random.log_uniform(1e-6, 1e12) * random.normal_matrix<2>();
      step.gradient[k] = random.log_uniform(1e-12, 1e12) * (random.uniform(0, 1) < 0.5 ? -1 : 1);
      for (std::size_t j = 0; j <= k; ++j) {
        step.hessian[k * Step::most + j] = rows[k].dot(rows[j]);
      }
    }
    if (!step.find(multipliers, 0)) {
      continue;
    }
    Step::Multipliers next;
    step.put_end(multipliers, next);
    CAPTURE(i);
    for (std::size_t k = 0; k < count; ++k) {
      REQUIRE(next[k] >= 0.0099 * multipliers[k]);
    }
  }
}

TEST_CASE("a fusion reports the steps of its search and whether they were all that it may take") {
  const auto criterion = SizeCriterion<double, 3>::volume();
  const Ellipsoid<double, 3> ball{Vector3<double>::Zero(), Matrix3<double>::Identity()};
  const Ellipsoid<double, 3> beside{Vector3<double>(0.8, 0, 0), Matrix3<double>::Identity()};
  std::array<Quadric<double, 3>, 2> quadrics;
  QuadricFusion<double, 3> fusion;
  REQUIRE(to_quadric(ball, quadrics[0]) == Status::ok);
  REQUIRE(to_quadric(beside, quadrics[1]) == Status::ok);
  REQUIRE(minimal_intersection(&ball, quadrics.data(), 2, criterion, fusion) == Status::ok);
  CHECK(fusion.steps > 0);
  CHECK(fusion.steps < 12);
  CHECK_FALSE(fusion.ended_by_limit);
  const Ellipsoid<double, 3> wide{Vector3<double>::Zero(), 100 * Matrix3<double>::Identity()};
  REQUIRE(to_quadric(wide, quadrics[0]) == Status::ok);
  REQUIRE(minimal_intersection(&ball, quadrics.data(), 1, criterion, fusion) == Status::ok);
  REQUIRE(fusion.prediction_alone);
  CHECK(fusion.steps == 0);
  // Two thin ellipsoids that barely meet, found by trying many: the search gains at each step, and would go on.
  quadrics[0].a << 53760092.150603622, -32592235.887717653, -22405673.162533127,  //
      -32592235.887717653, 19759154.624249622, 13583520.85855354,                 //
      -22405673.162533127, 13583520.85855354, 9338082.9048608169;
  quadrics[0].g.setZero();
  quadrics[0].c = 1;
  quadrics[1].a << 2.7358616972666887, -0.66692734471473858, 2.931275080079764,  //
      -0.66692734471473858, 1.457228669600515, -1.492528505982559,               //
      2.931275080079764, -1.492528505982559, 7.3802657986748903;
  quadrics[1].g << -0.087782826570409034, 1.04973780170456, 0.11396835320937233;
  quadrics[1].c = -0.00047859843385661405;
  REQUIRE(minimal_intersection<double, 3>(nullptr, quadrics.data(), 2, criterion, fusion) == Status::ok);
  CHECK(fusion.steps == 12);
  CHECK(fusion.ended_by_limit);
}

namespace {

// N(μ) with Σμ = 1 of the unit ball and quadrics, the ball's multiplier first, as the definition says.
long double level_of(const std::array<Quadric<double, 3>, 3>& quadrics, std::array<long double, 4> mu) {
  const long double sum = mu[0] + mu[1] + mu[2] + mu[3];
  Eigen::Matrix<long double, 3, 3> a = mu[0] / sum * Eigen::Matrix<long double, 3, 3>::Identity();
  Long3 g = Long3::Zero();
  long double c = mu[0] / sum;
  for (std::size_t k = 0; k < 3; ++k) {
    a += mu[k + 1] / sum * quadrics[k].a.cast<long double>();
    g += mu[k + 1] / sum * quadrics[k].g.cast<long double>();
    c += mu[k + 1] / sum * static_cast<long double>(quadrics[k].c);
  }
  return c + g.dot(a.llt().solve(g));
}

}  // namespace

TEST_CASE("the margin is the least level on the way, no more than where the search begins and where it ends") {
  Random random(42);
  const Ellipsoid<double, 3> ball{Vector3<double>::Zero(), Matrix3<double>::Identity()};
  const auto criterion = SizeCriterion<double, 3>::volume();
  int risen = 0;
  for (int i = 0; i < 1000; ++i) {
    std::array<Quadric<double, 3>, 3> quadrics;
    for (auto& quadric : quadrics) {
      const Matrix3<double> shape = random.log_uniform(0.05, 5) * random.positive_definite<3>(20);
      REQUIRE(to_quadric({random.uniform(0, 1.5) * random.unit_vector<3>(), shape}, quadric) == Status::ok);
    }
    QuadricFusion<double, 3> fusion;
    const Status status = minimal_intersection(&ball, quadrics.data(), 3, criterion, fusion);
    if (status != Status::ok || fusion.prediction_alone) {
      continue;
    }
    detail::Coordinates<double, 3> at;
    detail::Gathered<double, 3> gathered;
    REQUIRE(detail::coordinates_of(ball, at) == Status::ok);
    detail::gather(quadrics.data(), 3, criterion, at, gathered);
    const auto start = detail::starting_multipliers(gathered.problem);
    std::array<long double, 4> first{};
    std::array<long double, 4> last{static_cast<long double>(fusion.predicted_multiplier)};
    for (std::size_t k = 0; k < 4; ++k) {
      first[k] = static_cast<long double>(start[k] / gathered.scale[k]);
      last[k] = k == 0 ? last[k] : static_cast<long double>(fusion.multipliers[k - 1]);
    }
    const long double begins = level_of(quadrics, first);
    const long double ends = level_of(quadrics, last);
    REQUIRE(static_cast<long double>(fusion.margin) <= begins + 1e-9L);
    REQUIRE(static_cast<long double>(fusion.margin) <= ends + 1e-9L);
    risen += ends > begins + 1e-3L ? 1 : 0;
  }
  CHECK(risen > 50);
}

TEST_CASE("a sharp slab through a prediction far from zero loses no point by the rounding of its coordinates") {
  Random random(41);
  const double far = 1e4;
  const auto criterion = SizeCriterion<double, 3>::trace();
  int inside = 0;
  for (int i = 0; i < 1000; ++i) {
    // Seen from zero the terms of the slab are 1e8, and cancel to the square of its width, at least 1e-8.
    const Vector3<double> center = far * random.unit_vector<3>();
    const Vector3<double> normal = center.cross(random.unit_vector<3>()).normalized();
    const Ellipsoid<double, 3> predicted{center, Matrix3<double>::Identity()};
    Quadric<double, 3> quadric;
    REQUIRE(slab(normal, 0.0, random.log_uniform(1e-4, 3e-3), quadric) == Status::ok);
    QuadricFusion<double, 3> fusion;
    REQUIRE(minimal_intersection(&predicted, &quadric, 1, criterion, fusion) == Status::ok);
    const Eigen::LLT<Eigen::Matrix<long double, 3, 3>> factor(fusion.set.shape.cast<long double>());
    const auto slack_at = [&](const Long3& y) {
      return static_cast<long double>(quadric.c) - y.dot(quadric.a.cast<long double>() * y) -
             2 * y.dot(quadric.g.cast<long double>());
    };
    for (int k = 0; k < 10; ++k) {
      // From the rim of the ball in the slab's middle to the slab's surface: there neither constraint has slack.
      const Long3 across = normal.cross(random.unit_vector<3>()).normalized().cast<long double>();
      const Long3 from = center.cast<long double>() + 0.99999L * across;
      const Long3 along = (k % 2 == 0 ? 1 : -1) * normal.cast<long double>();
      long double low = 0;
      long double high = 0.04L;
      for (int step = 0; step < 60; ++step) {
        const long double middle = (low + high) / 2;
        (slack_at(from + middle * along) >= 0 ? low : high) = middle;
      }
      const Long3 y = from + low * along;
      if (slack_at(y) >= 0 && (y - center.cast<long double>()).squaredNorm() <= 1) {
        ++inside;
        const Long3 rest = y - fusion.set.center.cast<long double>();
        REQUIRE(rest.dot(factor.solve(rest)) <= 1);
      }
    }
  }
  CHECK(inside > 5000);
}

TEST_CASE("the scale of a quadric does not matter and a multiplier may be zero") {
  Random random(11);
  for (int trial = 0; trial < 100; ++trial) {
    const Scene scene = make_scene(random, 0.1, 0.05, trial);
    std::array<Quadric<double, 6>, 4> scaled = scene.quadrics;
    for (Quadric<double, 6>& q : scaled) {
      const double factor = random.log_uniform(1e-12, 1e12);
      q.a *= factor;
      q.g *= factor;
      q.c *= factor;
    }
    Fusion6 plain;
    Fusion6 other;
    REQUIRE(minimal_intersection(&scene.predicted, scene.quadrics.data(), 4, Criterion::volume(), plain) == Status::ok);
    REQUIRE(minimal_intersection(&scene.predicted, scaled.data(), 4, Criterion::volume(), other) == Status::ok);
    CHECK(size_of(plain.set.shape, Criterion::volume()) ==
          doctest::Approx(static_cast<double>(size_of(other.set.shape, Criterion::volume()))).epsilon(1e-9));
  }
}

TEST_CASE("bad input to the fusion is refused and changes nothing") {
  Random random(12);
  Scene scene = make_scene(random, 0.1, 0.05, 0);
  Fusion6 result;
  result.margin = 3;
  const auto fuse = [&]() {
    return minimal_intersection(&scene.predicted, scene.quadrics.data(), 4, Criterion::volume(), result);
  };
  const Scene good = scene;
  scene.quadrics[2].c = std::nan("");
  CHECK(fuse() == Status::not_finite);
  scene = good;
  scene.quadrics[1].a(0, 1) += 1;
  CHECK(fuse() == Status::not_symmetric);
  scene = good;
  scene.predicted.shape.setZero();
  CHECK(fuse() == Status::not_positive_definite);
  scene = good;
  scene.predicted.center(3) = std::nan("");
  CHECK(fuse() == Status::not_finite);
  scene = good;
  CHECK(minimal_intersection(&scene.predicted, scene.quadrics.data(), 4,
                             Criterion::weighted_trace(Matrix6<double>::Zero()),
                             result) == Status::not_positive_definite);
  CHECK(result.margin == 3);
}

TEST_CASE("a quadric that cannot be scaled is out of range and no input that is not finite") {
  Random random(13);
  const Scene scene = make_scene(random, 0.1, 0.05, 0);
  Fusion6 result;
  result.margin = 3;
  // It says nothing, with a slack whose reciprocal is no number.
  const Quadric<double, 6> weak{Matrix6<double>::Zero(), Vector6<double>::Zero(), 4.9406564584124654e-324};
  CHECK(minimal_intersection(&scene.predicted, &weak, 1, Criterion::volume(), result) == Status::out_of_range);
  Quadric<double, 6> sharp = scene.quadrics[0];
  sharp.a *= 1e300;
  Ellipsoid6 wide = scene.predicted;
  wide.shape *= 1e20;
  CHECK(minimal_intersection(&wide, &sharp, 1, Criterion::volume(), result) == Status::out_of_range);
  CHECK(result.margin == 3);
}

TEST_CASE("a combination with a multiplier below zero is no bound, whoever asks for it") {
  // The ball, and three quarters of it less: A is positive definite.
  detail::ManyQuadrics<double, 2> problem;
  problem.count = 2;
  for (std::size_t k = 0; k < 2; ++k) {
    problem.constraints[k].constrain_all(
        2, [] { return Quadric<double, 2>{Eigen::Matrix2d::Identity(), Eigen::Vector2d::Zero(), 1.0}; });
  }
  detail::ManyQuadrics<double, 2>::Iterate it;
  CHECK(problem.combine({1.0, 0.0}, it) == Status::ok);
  CHECK(problem.combine({1.0, -0.75}, it) == Status::out_of_range);
  CHECK(problem.combine({1.0, std::numeric_limits<double>::quiet_NaN()}, it) == Status::out_of_range);
}

TEST_CASE("only multipliers that are numbers and not below zero may be summed") {
  const double no_number = std::numeric_limits<double>::quiet_NaN();
  CHECK(detail::may_sum(std::array<double, 3>{1, 0, 2}, 3));
  CHECK(detail::may_sum(std::array<double, 3>{1, 0, -1}, 2));  // the third is none of them
  CHECK_FALSE(detail::may_sum(std::array<double, 3>{1, 0, -1e-300}, 3));
  CHECK_FALSE(detail::may_sum(std::array<double, 3>{1, no_number, 0}, 3));
}
