#include <doctest/doctest.h>

#include <elliptude/first_order/convergence.hpp>
#include <elliptude/first_order/fusion.hpp>

#include "support/random.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using State = RigidBodyState<double>;
using Set = StateEllipsoid<State>;

State random_state(Random& random) { return {random.rotation(), random.normal_matrix<3>()}; }

/// The largest form that the image of a set's boundary has in the set that stands for it about another center.
double worst_of_image(const Set& set, const State& center, const Ellipsoid<double, 6>& seen, Random& random) {
  const Matrix6<double> root = set.shape.llt().matrixL();
  double worst = 0;
  for (int sample = 0; sample < 4000; ++sample) {
    const State state = retract(set.center, Vector6<double>(root * random.unit_vector<6>()));
    double form = 0;
    REQUIRE(quadratic_form(seen, state_error(center, state), form) == Status::ok);
    worst = std::max(worst, form);
  }
  return worst;
}

/// An attitude set ten times as long as wide, small enough for first order, with a rate beside it.
Set elongated(Random& random) {
  const Vector3<double> axes(0.02, 0.002, 0.002);
  Set set{random_state(random), Matrix6<double>::Identity() * 1e-6};
  set.shape.topLeftCorner<3, 3>() = random.symmetric<3>(axes.cwiseAbs2());
  return set;
}

}  // namespace

TEST_CASE("An ellipsoid of 10 to 1 carried over 7 degrees contains its image to first order and does not by a shift") {
  Random random(1);
  double worst_first_order = 0;
  double worst_shifted = 0;
  for (int trial = 0; trial < 20; ++trial) {
    const Set set = elongated(random);
    const State center =
        retract(set.center, (Vector6<double>() << 0.12217304763960307 * random.unit_vector<3>(), 0, 0, 0).finished());
    worst_first_order = std::max(worst_first_order,
                                 worst_of_image(set, center, seen_from(center, set, Recentring::first_order), random));
    worst_shifted =
        std::max(worst_shifted, worst_of_image(set, center, seen_from(center, set, Recentring::shifted), random));
  }
  MESSAGE("largest form, first order " << worst_first_order << ", shifted " << worst_shifted);
  CHECK(worst_first_order <= 1.02);
  CHECK(worst_shifted > 1.5);
}

TEST_CASE("Recentring after the fusion contains the image too and undoes what seeing from elsewhere did") {
  Random random(2);
  for (int trial = 0; trial < 20; ++trial) {
    const Set set = elongated(random);
    const State center = retract(
        set.center, (Vector6<double>() << 0.12217304763960307 * random.unit_vector<3>(), 0.1, 0.2, 0.3).finished());
    const Ellipsoid<double, 6> seen = seen_from(center, set, Recentring::first_order);
    const Set back = recentred(center, seen, Recentring::first_order);
    CHECK((back.shape - set.shape).norm() <= 1e-14 * set.shape.norm() * 100);
    CHECK(state_error(back.center, set.center).norm() <= 1e-14);
  }
}

TEST_CASE("A fused set contains the states that both sets hold and no state where they do not meet is invented") {
  Random random(3);
  int shared = 0;
  for (int trial = 0; trial < 300; ++trial) {
    Set predicted{random_state(random), 1e-6 * random.positive_definite<6>(30)};
    const Matrix6<double> root = predicted.shape.llt().matrixL();
    Set measured{retract(predicted.center, Vector6<double>(0.8 * root * random.in_ball<6>())),
                 1e-6 * random.positive_definite<6>(30)};
    Fusion<State> fusion{};
    const Status status =
        fuse(measured, predicted, Recentring::first_order, SizeCriterion<double, 6>::volume(), fusion);
    REQUIRE(status == Status::ok);
    CHECK(fusion.margin > 0);
    for (int sample = 0; sample < 200; ++sample) {
      const State state = retract(predicted.center, Vector6<double>(root * random.in_ball<6>()));
      double in_measured = 0;
      REQUIRE(quadratic_form(measured, state, in_measured) == Status::ok);
      if (in_measured <= 1) {
        ++shared;
        double form = 0;
        REQUIRE(quadratic_form(fusion.ellipsoid, state, form) == Status::ok);
        CHECK(form <= 1 + 0.01);  // sets of 1e-3 rad: second order
      }
    }
  }
  CHECK(shared > 1000);
}

TEST_CASE("A partial measurement fuses as the printed family at the best multiplier") {
  Random random(4);
  for (int trial = 0; trial < 50; ++trial) {
    const Set predicted{random_state(random), random.positive_definite<6>(20) * 1e-4};
    const Matrix6<double> root = predicted.shape.llt().matrixL();
    LinearMeasurement<double, 2> linear{Vector<double, 2>::Zero(), random.normal_matrix<2, 6>(),
                                        1e-4 * random.positive_definite<2>(5)};
    linear.y = linear.h * (0.7 * root * random.unit_vector<6>());
    Fusion<State> fusion{};
    REQUIRE(fuse(linear, predicted, Recentring::shifted, SizeCriterion<double, 6>::trace(), fusion) == Status::ok);
    // G = HPHᵀ + R/μ, K = PHᵀG⁻¹, P⁺ = (1 + μ − yᵀG⁻¹y)(I − KH)P (theory, section 10), over a fine grid of μ.
    double best = predicted.shape.trace();
    for (double log_mu = -12; log_mu < 12; log_mu += 0.002) {
      const double mu = std::exp(log_mu);
      const Matrix<double, 2> g = linear.h * predicted.shape * linear.h.transpose() + linear.bound / mu;
      const Matrix<double, 6, 2> k = predicted.shape * linear.h.transpose() * g.inverse();
      const double level = 1 + mu - linear.y.dot(g.inverse() * linear.y);
      REQUIRE(level > 0);
      best = std::min(best, level * (predicted.shape - k * linear.h * predicted.shape).trace());
    }
    CHECK(fusion.ellipsoid.shape.trace() <= best * (1 + 1e-9));
    CHECK(fusion.ellipsoid.shape.trace() >= best * (1 - 1e-6));  // the grid's own error
  }
}

namespace {

/// Where the search starts, against the slope of the whole problem there.
template <int Rows>
void check_start(Random& random, const SizeCriterion<double, 6>& criterion) {
  int found = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const Matrix<double, Rows, 6> b = random.log_uniform(1e-2, 1e3) * random.normal_matrix<Rows, 6>();
    const Vector<double, Rows> y = 0.7 * b * random.unit_vector<6>();
    const Matrix6<double> factor = random.positive_definite<6>(100).llt().matrixL();
    const Matrix6<double> m = b.transpose() * b;
    const Vector6<double> v = -b.transpose() * y;
    const Vector6<double> present = Vector6<double>::Ones();
    const auto slack = [&](const Vector6<double>& u) { return 1 - (y - b * u).squaredNorm(); };
    const detail::Problem<double, 6, decltype(slack)> problem{m, v, present, slack};
    const detail::RelativeSize<double, 6> size(factor, present, criterion);
    if (slack(Vector6<double>::Zero()) >= size.idle_slack(m)) {
      continue;  // the prediction alone is best
    }
    const double q = detail::weight_of_rows(y, b, size, problem.typical_weight());
    detail::Combination<double, 6> combination;
    REQUIRE(problem.combine(q, combination) == Status::ok);
    double slope = 0;
    double curvature = 0;
    size.derivatives(combination, slope, curvature);
    CHECK(std::abs(q * slope) <= 1e-4);  // with respect to log q: what is left to gain is the square of it
    ++found;
  }
  CHECK(found > 50);
}

}  // namespace

TEST_CASE("The search for a partial measurement's multiplier starts where it ends") {
  Random random(5);
  for (const auto& criterion : {SizeCriterion<double, 6>::trace(), SizeCriterion<double, 6>::volume(),
                                SizeCriterion<double, 6>::weighted_trace(random.positive_definite<6>(10))}) {
    check_start<1>(random, criterion);
    check_start<2>(random, criterion);
    check_start<3>(random, criterion);
  }
}

namespace {

/// A measurement of two attitude coordinates `ratio` as wide as the prediction, of a truth near the edge of both or inside.
struct Sharp {
  int empty = 0;
  double worst = 0;
};

Sharp fuse_sharp(double ratio, double condition, const SizeCriterion<double, 6>& criterion) {
  using Long6 = Eigen::Matrix<long double, 6, 1>;
  using LongMatrix6 = Eigen::Matrix<long double, 6, 6>;
  Random random(6);
  Sharp result;
  for (int trial = 0; trial < 300; ++trial) {
    const Set predicted{{Matrix3<double>::Identity(), Vector3<double>::Zero()},
                        Matrix6<double>(1e-4 / std::sqrt(condition) * random.positive_definite<6>(condition))};
    LinearMeasurement<double, 2> linear{Vector<double, 2>::Zero(), Matrix<double, 2, 6>::Zero(),
                                        ratio * ratio * 1e-4 * Matrix<double, 2>::Identity()};
    linear.h.leftCols<3>() = random.normal_matrix<2, 3>();
    const LongMatrix6 root = LongMatrix6(predicted.shape.cast<long double>()).llt().matrixL();
    const double edge = 1 - 1e-5;
    const Long6 truth = root * (edge * random.uniform(0.5, 1) * random.unit_vector<6>()).cast<long double>();
    linear.y =
        (linear.h.cast<long double>() * truth + (ratio * 1e-2 * edge * random.unit_vector<2>()).cast<long double>())
            .cast<double>();
    Fusion<State> fusion{};
    const Status status = fuse(linear, predicted, Recentring::shifted, criterion, fusion);
    if (status == Status::empty_intersection) {
      ++result.empty;
      continue;
    }
    REQUIRE(status == Status::ok);
    Long6 error = truth;
    error.head<3>() -= log(fusion.ellipsoid.center.attitude).cast<long double>();
    error.tail<3>() -= fusion.ellipsoid.center.angular_velocity.cast<long double>();
    const LongMatrix6 shape = fusion.ellipsoid.shape.cast<long double>();
    result.worst = std::max(result.worst, static_cast<double>(error.dot(shape.llt().solve(error))));
  }
  return result;
}

}  // namespace

TEST_CASE("A measurement far sharper than the prediction contains the truth and does not contradict it") {
  for (const auto& criterion : {SizeCriterion<double, 6>::trace(), SizeCriterion<double, 6>::volume()}) {
    for (const double condition : {1.0, 1e4}) {
      for (const double ratio : {1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8}) {
        CAPTURE(condition);
        CAPTURE(ratio);
        const Sharp sharp = fuse_sharp(ratio, condition, criterion);
        CHECK(sharp.empty == 0);
        if (ratio >= 1e-5) {
          CHECK(sharp.worst <= 1);
        } else if (ratio >= 1e-7) {
          CHECK(sharp.worst <= 1.01);  // beyond, what rounding does to the prediction's own factor shows
        }
      }
    }
  }
}

TEST_CASE("A sharp direction agrees with a wide prediction in either precision") {
  Random random(7);
  const auto check = [&random](auto one, double width, double angle) {
    using Scalar = decltype(one);
    for (int trial = 0; trial < 100; ++trial) {
      const Matrix3<double> attitude = random.rotation();
      Vector6<double> widths;
      widths << Vector3<double>::Constant(width), Vector3<double>::Constant(0.01);
      const Matrix6<double> shape = widths.asDiagonal() * random.positive_definite<6>(4) * widths.asDiagonal();
      const StateEllipsoid<RigidBodyState<Scalar>> predicted{{attitude.cast<Scalar>(), Vector3<Scalar>::Zero()},
                                                             shape.cast<Scalar>()};
      const Vector3<double> b = random.unit_vector<3>();
      const Vector3<double> across = b.cross(random.unit_vector<3>()).normalized();
      const Vector3<Scalar> e = (attitude * (b + 0.3 * width * across).normalized()).cast<Scalar>();
      LinearMeasurement<Scalar, 2> linear;
      REQUIRE(linear_direction(predicted.center.attitude,
                               Direction<Scalar>::within(e, Vector3<Scalar>(b.cast<Scalar>()), Scalar(angle)),
                               linear) == Status::ok);
      Fusion<RigidBodyState<Scalar>> fusion{};
      CHECK(fuse(linear, predicted, Recentring::first_order, SizeCriterion<Scalar, 6>::volume(), fusion) == Status::ok);
    }
  };
  for (const double angle : {1e-4, 1e-6, 1e-7}) {
    check(1.0, 0.3, angle);
  }
  for (const double angle : {1e-2, 1e-3, 1e-4, 3e-5}) {
    check(1.0F, 0.1, angle);
  }
}

TEST_CASE("Sets that do not meet are reported with their margin and the output stays") {
  Random random(5);
  const Set predicted{random_state(random), 1e-4 * Matrix6<double>::Identity()};
  const Set measured{retract(predicted.center, (Vector6<double>() << 0.022, 0, 0, 0, 0, 0).finished()),
                     predicted.shape};
  Fusion<State> fusion{predicted, 0.25, 7};
  CHECK(fuse(measured, predicted, Recentring::shifted, SizeCriterion<double, 6>::trace(), fusion) ==
        Status::empty_intersection);
  CHECK(fusion.margin == doctest::Approx(-0.21));
  CHECK(fusion.share == 0.25);
  CHECK(fusion.ellipsoid.shape == predicted.shape);

  LinearMeasurement<double, 1> linear{Vector<double, 1>(0.022), Matrix<double, 1, 6>::Unit(0),
                                      Matrix<double, 1>::Constant(1e-4)};
  CHECK(fuse(linear, predicted, Recentring::shifted, SizeCriterion<double, 6>::trace(), fusion) ==
        Status::empty_intersection);
  CHECK(fusion.margin == doctest::Approx(-0.21));
}

TEST_CASE("The convergence diagnostics are those of the theorem") {
  Random random(6);
  const Matrix6<double> a = random.normal_matrix<6, 6>();
  const Matrix6<double> prior = random.positive_definite<6>(10);
  const Matrix6<double> measured = random.positive_definite<6>(25);
  const Matrix6<double> predicted = a * prior * a.transpose();
  const Matrix6<double> fused = 0.1 * prior;
  const double share = 0.3;
  Convergence<double> result{};
  REQUIRE(convergence(a, prior, predicted, measured, fused, share, result) == Status::ok);
  const Eigen::VectorXd ratios = Matrix6<double>(measured.inverse() * predicted).eigenvalues().real();
  const double q = share / (1 - share);
  const double chi = std::sqrt(6 + 30 * 25.0);
  CHECK(result.flow_norm == doctest::Approx(a.norm()));
  CHECK(result.smallest_ratio == doctest::Approx(ratios.minCoeff()).epsilon(1e-9));
  CHECK(result.chi == doctest::Approx(chi));
  // Eq. sufcond holds with equality at the contraction reported.
  CHECK(a.norm() == doctest::Approx(std::sqrt(result.contraction * (q + ratios.minCoeff()) / (6 * chi * (1 + q)))));
  CHECK(result.trace_ratio == doctest::Approx(0.1));
  CHECK(convergence(a, prior, predicted, Matrix6<double>(Matrix6<double>::Zero()), fused, share, result) ==
        Status::not_positive_definite);
}
