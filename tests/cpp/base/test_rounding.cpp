/// The constants of base/rounding.hpp against bounds of rounding: the same templates in numbers that carry a bound of their error, over
/// the ranges that theory, section 17.8, states. And gyro predictions in `float`, where rounding is in sight of `double`.

#include <doctest/doctest.h>

#include <elliptude/guaranteed/gyro_flow.hpp>
#include <elliptude/sets/quadric.hpp>

#include "support/random.hpp"
#include "support/tracked.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6d = Matrix6<double>;
using Vector6d = Vector6<double>;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// A shape whose roots of eigenvalues are from `thin` to `wide`, in axes of its own.
Matrix6d thin_shape(Random& random, double thin, double wide) {
  Vector6d widths;
  for (int i = 0; i < 6; ++i) {
    widths(i) = random.log_uniform(thin, wide);
  }
  widths(0) = thin;
  widths(5) = wide;
  return random.symmetric<6>(Vector6d(widths.cwiseAbs2()));
}

/// The largest |Σ Eᵢⱼ vᵢ vⱼ| / Σ dᵢ vᵢ² for errors within the bounds: the largest eigenvalue of the bounds scaled by d.
template <int N>
double largest_share(const Eigen::Matrix<double, N, N>& bounds, const Eigen::Matrix<double, N, 1>& d) {
  const Eigen::Matrix<double, N, 1> scale = d.cwiseSqrt().cwiseInverse();
  const Eigen::Matrix<double, N, N> scaled = scale.asDiagonal() * bounds * scale.asDiagonal();
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, N, N>>(scaled).eigenvalues().cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("a number that knows its error bounds it") {
  // Against long double, whose own error is 2000 times smaller.
  Random random(1);
  for (int i = 0; i < 2000; ++i) {
    const double x = random.normal() * random.log_uniform(1e-3, 1e3);
    const double y = random.normal() * random.log_uniform(1e-3, 1e3);
    const auto formula = [](const auto& a, const auto& b) {
      using std::cos;
      using std::sin;
      using std::sqrt;
      return sqrt(a * a + b * b) - (a - b) * sin(a) / (cos(b) * cos(b) + decltype(a * b)(1));
    };
    const Tracked tracked = formula(Tracked::exactly(x), Tracked::exactly(y));
    const long double exact = formula(static_cast<long double>(x), static_cast<long double>(y));
    CHECK(std::fabs(static_cast<double>(static_cast<long double>(tracked.value) - exact)) <= tracked.error);
    CHECK(tracked.error < 1e-11);
  }
  CHECK(Tracked(0.1).error > 0);
  CHECK(Tracked(0.375).error == 0);
}

TEST_CASE("turns and their Jacobians are as exact as the constants say") {
  Random random(2);
  for (const double size : {1e-6, 1e-3, 0.1, 0.99, 1.01, 3.0, 10.0, 1e2, 1e3, 1e4, 1e6}) {
    double worst_turn = 0;
    double worst_jacobian = 0;
    for (int i = 0; i < 500; ++i) {
      // As the gyro's prediction has it: the rate is a difference, the turn a product, and the duration right to ε.
      const Vector3d measured = random.uniform(0.7, 1) * size * random.unit_vector<3>();
      const Vector3d bias = 0.1 * size * random.unit_vector<3>();
      const Vector3<Tracked> rate = exactly<3, 1>(measured) - exactly<3, 1>(bias);
      const double duration = random.uniform(0.5, 1);
      const Vector3<Tracked> turn = Tracked(duration, epsilon * duration) * rate;
      const double bound = epsilon * (rounding::turn + rounding::turn_by_angle * values<3, 1>(turn).norm());
      worst_turn = std::fmax(worst_turn, errors<3, 3>(exp(turn)).norm() / bound);
      worst_jacobian = std::fmax(worst_jacobian, errors<3, 3>(right_jacobian(turn)).norm() / bound);
    }
    INFO("turn of " << size << " rad");
    CHECK(worst_turn < 1);
    CHECK(worst_jacobian < 1);
  }
}

TEST_CASE("centers are as exact as the constants say") {
  Random random(3);
  double worst_product = 0;
  double worst_cayley = 0;
  for (int i = 0; i < 2000; ++i) {
    const Matrix3<Tracked> center = exactly<3, 3>(random.rotation());
    // A matrix that is off by F in norm is off by F/√2 as an angle.
    const Matrix3<Tracked> turn = exactly<3, 3>(exp(Vector3d(3 * random.in_ball<3>())));
    worst_product = std::fmax(worst_product, errors<3, 3>(renormalized(Matrix3<Tracked>(center * turn))).norm());
    const Vector3<Tracked> gibbs = exactly<3, 1>(random.log_uniform(1e-6, 1e3) * random.unit_vector<3>());
    worst_cayley = std::fmax(worst_cayley, errors<3, 3>(cayley(gibbs)).norm());
  }
  MESSAGE("product " << worst_product / epsilon << " epsilon, Cayley map " << worst_cayley / epsilon);
  CHECK(worst_product / std::sqrt(2.0) < (rounding::turn - 15) * epsilon);  // beside the turn's own 15
  CHECK((worst_product + worst_cayley) / std::sqrt(2.0) < rounding::center * epsilon);
}

TEST_CASE("a congruence errs by less than its raised diagonal covers") {
  Random random(4);
  for (const double thin : {1e-8, 1e-6, 1e-3, 0.3}) {
    double worst = 0;
    for (int i = 0; i < 300; ++i) {
      const Matrix6d shape = thin_shape(random, thin, 1);
      const Vector3d zeta = random.log_uniform(1e-4, 3) * random.unit_vector<3>();
      const Matrix3d x = exp(zeta).transpose();
      const Matrix3d y = -random.log_uniform(1e-3, 10) * right_jacobian(zeta);
      const Matrix6<Tracked> tracked =
          covered_congruence(exactly<3, 3>(x), exactly<3, 3>(y), Matrix6<Tracked>(exactly<6, 6>(shape)));
      const Matrix6<Tracked> turned = covered_congruence(exactly<3, 3>(x), Matrix6<Tracked>(exactly<6, 6>(shape)));
      const Vector6d roots = shape.diagonal().cwiseSqrt();
      Vector6d with;
      with << x.cwiseAbs() * roots.head<3>() + y.cwiseAbs() * roots.tail<3>(), roots.tail<3>();
      Vector6d without;
      without << x.cwiseAbs() * roots.head<3>(), roots.tail<3>();
      worst = std::fmax(worst, largest_share<6>(errors<6, 6>(tracked), with.cwiseAbs2()));
      worst = std::fmax(worst, largest_share<6>(errors<6, 6>(turned), without.cwiseAbs2()));
    }
    INFO("thin " << thin << ": " << worst / epsilon << " epsilon");
    CHECK(worst < (rounding::congruence - 21) * epsilon);  // 21 are left for the factorisation after it
  }
}

TEST_CASE("a congruence is that of the matrices and holds the image") {
  Random random(5);
  for (int i = 0; i < 200; ++i) {
    const Matrix6d shape = thin_shape(random, random.log_uniform(1e-8, 0.1), 1);
    const Vector3d zeta = random.in_ball<3>();
    Matrix6d t = Matrix6d::Identity();
    t.topLeftCorner<3, 3>() = exp(zeta);
    t.topRightCorner<3, 3>() = random.normal_matrix<3, 3>();
    const Matrix6d image =
        covered_congruence(Matrix3d(t.topLeftCorner<3, 3>()), Matrix3d(t.topRightCorner<3, 3>()), shape);
    using Matrix6l = Eigen::Matrix<long double, 6, 6>;
    const Matrix6l exact = t.cast<long double>() * shape.cast<long double>() * t.cast<long double>().transpose();
    const Matrix6l added = image.cast<long double>() - exact;
    CHECK(static_cast<double>(added.norm() / exact.norm()) < 1e-12);
    // What was added is positive: no direction has lost.
    CHECK(Eigen::SelfAdjointEigenSolver<Matrix6l>(added).eigenvalues()(0) > 0);
  }
}

TEST_CASE("a sum of shapes errs by less than its raised diagonal covers") {
  Random random(6);
  double worst = 0;
  for (int i = 0; i < 300; ++i) {
    const Matrix6d shape = thin_shape(random, random.log_uniform(1e-6, 0.1), 1);
    std::array<Matrix6<Tracked>, 2> others{
        exactly<6, 6>(Matrix6d(1e-6 * thin_shape(random, random.log_uniform(1e-8, 0.1), 1))),
        detail::tube::attitude_ball(Tracked::exactly(random.log_uniform(1e-12, 1)))};
    Matrix6<Tracked> sum;
    REQUIRE(detail::tube::sum<Tracked, 6, 2>(exactly<6, 6>(shape), others, sum) == Status::ok);
    // The factors may be any: what counts is that an entry errs by a share of √(Pᵢᵢ Pⱼⱼ). The inverse that they come from is thin
    // too, and its bounds would hide this; so the last step alone, with factors that are what they are.
    const double first = random.uniform(1, 3);
    const double second = random.log_uniform(1, 1e3);
    Matrix6<Tracked> total = Tracked::exactly(first) * exactly<6, 6>(shape);
    total += Tracked::exactly(second) * others[0];
    total += Tracked::exactly(second) * others[1];
    worst = std::fmax(worst, largest_share<6>(errors<6, 6>(total), Vector6d(values<6, 6>(total).diagonal())));
  }
  MESSAGE("sum " << worst / epsilon << " epsilon");
  // Beside it, in the same share: 6 for the factors' own rounding, 12 for entries that were products, 21 for the factorisation.
  CHECK(worst < (rounding::sum - 39) * epsilon);
}

TEST_CASE("a thin set in float: an ideal gyro's prediction holds every truth and none is refused") {
  using Flow = GuaranteedGyroFlow<float>;
  using Real = long double;
  using RealMatrix = Matrix3<Real>;
  using RealVector = Vector3<Real>;
  Random random(7);
  Flow flow;
  REQUIRE(Flow::make({}, Flow::IntervalRate::mean, flow) == Status::ok);
  for (const double thin : {1e-1, 1e-2, 1e-3, 1e-4}) {
    for (const int steps : {1, 200, 5000}) {
      double worst = 0;
      int refused = 0;
      for (int trial = 0; trial < (steps > 1000 ? 4 : 40); ++trial) {
        const double wide = 0.5;
        Matrix6d exact_shape = Matrix6d::Zero();
        exact_shape.topLeftCorner<3, 3>() = random.symmetric<3>(
            Vector3d(wide * wide, std::pow(thin * wide, 2), std::pow(random.log_uniform(thin, 1) * wide, 2)));
        exact_shape.bottomRightCorner<3, 3>() = 1e-8 * Matrix3d::Identity();
        GibbsEllipsoid<GyroState<float>> set{{random.rotation().cast<float>(), Vector3<float>::Zero()},
                                             exact_shape.cast<float>()};
        set.shape = (0.5F * (set.shape + set.shape.transpose())).eval();
        set.shape.diagonal() *= 1 + 16 * std::numeric_limits<float>::epsilon();
        const auto nearest = [](const Matrix3<float>& c) {
          RealMatrix r = c.cast<Real>();
          for (int k = 0; k < 4; ++k) {
            r = (r + RealMatrix(r.inverse().transpose())) / 2;
          }
          return r;
        };
        // On the boundary, along an axis of the attitude's set or anywhere.
        const Eigen::Matrix<Real, 6, 6> p = set.shape.cast<Real>();
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<Real, 6, 6>> axes(p);
        Eigen::Matrix<Real, 6, 1> y =
            axes.operatorSqrt() * (trial % 2 == 0 ? Eigen::Matrix<Real, 6, 1>(axes.eigenvectors().col(trial / 2 % 6))
                                                  : Eigen::Matrix<Real, 6, 1>(random.unit_vector<6>().cast<Real>()));
        RealMatrix truth = nearest(set.center.attitude) * cayley(RealVector(y.head<3>() / 2));
        const RealVector bias = y.tail<3>();
        const Vector3<float> measured = (random.log_uniform(0.01, 3) * random.unit_vector<3>()).cast<float>();
        const float h = 0.001F;
        const RealMatrix turn = exp(RealVector(static_cast<Real>(h) * (measured.cast<Real>() - bias)));
        for (int k = 0; k < steps; ++k) {
          if (flow.predict(0, h, {measured}, set, set) != Status::ok) {
            ++refused;
            break;
          }
          truth = (truth * turn).eval();
        }
        y << 2 * cayley_inverse(RealMatrix(nearest(set.center.attitude).transpose() * truth)),
            bias - set.center.gyro_bias.cast<Real>();
        const Eigen::Matrix<Real, 6, 6> after = set.shape.cast<Real>();
        worst = std::fmax(worst, static_cast<double>(y.dot(after.ldlt().solve(y))));
      }
      INFO("thin/wide " << thin << ", " << steps << " steps: worst form " << worst);
      CHECK(refused == 0);
      CHECK(worst <= 1);
    }
  }
}

TEST_CASE("an ellipsoid as a quadric loses no point however thin it is") {
  using Real = long double;
  using RealMatrix = Matrix3<Real>;
  using RealVector = Vector3<Real>;
  Random random(8);
  for (const double thin : {1.0, 1e-2, 1e-4, 1e-6}) {
    Real least = 1;
    for (int i = 0; i < 300; ++i) {
      const Matrix3d shape = random.symmetric<3>(
          Vector3d(1, std::pow(random.log_uniform(thin, 1), 2), std::pow(thin, 2)) * random.log_uniform(1e-6, 1e6));
      const double size = std::sqrt(shape.trace());
      const Ellipsoid<double, 3> ellipsoid{i % 3 == 0 ? Vector3d::Zero() : Vector3d(size * random.normal_matrix<3>()),
                                           shape};
      Quadric<double, 3> quadric;
      REQUIRE(to_quadric(ellipsoid, quadric) == Status::ok);
      const RealMatrix root = RealMatrix(shape.cast<Real>()).llt().matrixL();
      const Eigen::SelfAdjointEigenSolver<RealMatrix> axes(RealMatrix(root.transpose() * root));
      for (int k = 0; k < 6; ++k) {  // the ends of the axes, and anywhere
        const RealVector u = k < 3 ? RealVector(axes.eigenvectors().col(k)) : random.unit_vector<3>().cast<Real>();
        const RealVector y = ellipsoid.center.cast<Real>() + root * u;
        const RealMatrix a = quadric.a.cast<Real>();
        least = std::fmin(least, static_cast<Real>(quadric.c) - y.dot(a * y) - 2 * y.dot(quadric.g.cast<Real>()));
      }
    }
    INFO("thin/wide " << thin);
    CHECK(static_cast<double>(least) > 0);
    CHECK(static_cast<double>(least) < 0.02);
  }
}
