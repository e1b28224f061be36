// The rounding terms of measurements and of recentring (theory, sections 16.1 to 16.4 and 16.6), seen from a longer scalar: the
// same templates in float, and the truth in long double. Sets are so sharp that rounding decides, so that a term that is lost
// puts the truth outside (tests/mutations/measurement.toml, state.toml).
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

constexpr float epsilon = std::numeric_limits<float>::epsilon();

/// The rotation nearest to a matrix that is one but for rounding.
template <typename Scalar>
RealMatrix nearest(const Matrix3<Scalar>& matrix) {
  RealMatrix c = matrix.template cast<Real>();
  for (int i = 0; i < 4; ++i) {
    c = (c + RealMatrix(c.inverse().transpose())) / 2;
  }
  return c;
}

RealMatrix turn_by(const RealVector& v) {
  const Real angle = v.norm();
  RealMatrix s;
  s << 0, -v(2), v(1), v(2), 0, -v(0), -v(1), v(0), 0;
  const Real a = angle > 1e-7L ? std::sin(angle) / angle : 1 - angle * angle / 6;
  const Real half = angle > 1e-7L ? std::sin(angle / 2) / angle : 0.5L;
  return RealMatrix::Identity() + a * s + 2 * half * half * s * s;
}

RealVector gibbs(const RealMatrix& center, const RealMatrix& attitude) {
  const RealMatrix r = center.transpose() * attitude;
  return RealVector(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)) * (2 / (1 + r.trace()));
}

template <typename Scalar>
Real slack_of(const Quadric<Scalar, 3>& q, const RealVector& y) {
  return Real(q.c) - y.dot(q.a.template cast<Real>() * y) - 2 * y.dot(q.g.template cast<Real>());
}

RealVector unit_across(Random& random, const RealVector& v) {
  return v.cross(RealVector(random.unit_vector<3>().cast<Real>())).normalized();
}

}  // namespace

TEST_CASE("the angle of a direction's bound is none too small, however long the bound is along the direction") {
  Random random(41);
  int valid = 0;
  Real most = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Vector3<float> body = random.unit_vector<3>().cast<float>();
    const RealVector b = body.cast<Real>().normalized();
    const RealVector x = unit_across(random, b);
    const RealVector y = b.cross(x);
    const Real along = static_cast<Real>(random.log_uniform(1e-3, 1));
    const Real across = along * static_cast<Real>(random.log_uniform(3e-4, 1));
    const RealMatrix shape =
        along * along * b * b.transpose() + across * across * (x * x.transpose() + y * y.transpose() / 4);
    const Matrix3<float> bound = symmetrized(Matrix3<float>(shape.cast<float>()));
    float angle = 0;
    if (angle_bound(Direction<float>{body, body, bound, 1}, angle) != Status::ok) {
      continue;  // the entries' rounding makes it indefinite
    }
    ++valid;
    const RealMatrix projection = RealMatrix::Identity() - b * b.transpose();
    const RealMatrix seen = projection * bound.cast<Real>() * projection;
    const Real exact = Eigen::SelfAdjointEigenSolver<RealMatrix>(seen).eigenvalues()(2);
    const Real excess = (Real(angle) * Real(angle) - exact) / Real(bound.trace());
    CHECK(excess >= 0);
    most = std::max(most, excess);
  }
  CHECK(valid > 15000);
  CHECK(most < 40 * epsilon);
}

TEST_CASE("a cone in float holds every attitude of its rim") {
  Random random(1);
  int inside = 0;
  for (int trial = 0; trial < 60000; ++trial) {
    const Real r = static_cast<Real>(random.log_uniform(1e-5, 2));
    const Vector3<float> e = random.unit_vector<3>().cast<float>() * static_cast<float>(random.log_uniform(0.3, 3));
    const Vector3<float> b = random.unit_vector<3>().cast<float>() * static_cast<float>(random.log_uniform(0.3, 3));
    const auto direction = Direction<float>::within(e, b, static_cast<float>(r));
    // The bound as it is stored, without the rounding of its root.
    const Real angle = std::sqrt(Real(direction.bound(0, 0)));
    const RealVector body = b.cast<Real>().normalized();
    const RealVector reference = e.cast<Real>().normalized();
    // Any attitude with the direction on the rim: the shortest turn, then any turn about the reference.
    const RealVector rim = turn_by(RealVector(angle * unit_across(random, body))) * body;
    const RealVector axis = rim.cross(reference);
    const Real sine = axis.norm();
    const RealMatrix shortest = turn_by(RealVector(std::atan2(sine, rim.dot(reference)) / sine * axis));
    const RealMatrix truth = turn_by(RealVector(Real(random.uniform(-3, 3)) * reference)) * shortest;
    // Centers near the truth, and far from it about the direction, where the matrix is nearly singular.
    const RealVector about = trial % 2 == 0 ? RealVector(Real(random.log_uniform(1e-7, 2)) * unit_across(random, rim))
                                            : RealVector(Real(random.log_uniform(1e-3, 3.1)) * rim);
    const RealVector tilt = angle * Real(random.uniform(0, 1)) * unit_across(random, rim);
    const Matrix3<float> center =
        renormalized(Matrix3<float>((truth * turn_by(about) * turn_by(tilt)).template cast<float>()));
    Quadric<float, 3> quadric;
    REQUIRE(cone(center, direction, quadric) == Status::ok);
    const Real left = slack_of(quadric, gibbs(nearest(center), truth));
    CHECK(left >= 0);
    inside += left < 1e-2L ? 1 : 0;
  }
  CHECK(inside > 10000);  // near the rim
}

TEST_CASE("a measured attitude in float holds every attitude of its rim") {
  Random random(2);
  int inside = 0;
  for (int trial = 0; trial < 60000; ++trial) {
    const Real size = static_cast<Real>(random.log_uniform(1e-6, 0.5));
    const bool thin = trial % 3 == 0;
    const Eigen::Vector3d widths(1, thin ? 1e-2 : 1, thin ? 1e-1 : 1);
    MeasuredAttitude<float> measured;
    measured.attitude = renormalized(Matrix3<float>(random.rotation().cast<float>()));
    measured.bound = (random.symmetric<3>(widths.cwiseAbs2()) * static_cast<double>(size * size)).cast<float>();
    measured.bound = (0.5F * (measured.bound + measured.bound.transpose())).eval();
    if (trial % 4 == 0) {  // as it may have been stored: a rotation to half the digits
      measured.attitude += 0.2F * rotation_tolerance<float>() * random.normal_matrix<3, 3>().cast<float>();
    }
    const RealMatrix root = RealMatrix(measured.bound.cast<Real>()).llt().matrixL();
    const RealVector nu = root * random.unit_vector<3>().cast<Real>();
    const RealMatrix truth = nearest(measured.attitude) * turn_by(nu);
    // Seen from anywhere; or from the measured attitude itself, where nothing but its own rounding counts.
    const bool at_measured = trial % 5 == 1;
    const RealVector away = Real(random.log_uniform(1e-6, 2.8)) * random.unit_vector<3>().cast<Real>();
    const Matrix3<float> center = at_measured
                                      ? renormalized(measured.attitude)
                                      : renormalized(Matrix3<float>((truth * turn_by(away)).template cast<float>()));
    Quadric<float, 3> quadric;
    if (to_quadric(center, measured, quadric) != Status::ok) {
      continue;
    }
    const Real left = slack_of(quadric, gibbs(nearest(center), truth));
    CHECK(left >= 0);
    inside += left < 1e-2L ? 1 : 0;
  }
  CHECK(inside > 3000);
}

namespace {

/// The largest form of truths on the rim of a small set that is seen from another center.
template <typename Move>
void check_rims(const Move& move, double least_size, double most_size, double vector, Random& random, int trials,
                double& worst) {
  for (int trial = 0; trial < trials; ++trial) {
    const double size = random.log_uniform(least_size, most_size);
    RigidBodyState<float> center{renormalized(Matrix3<float>(random.rotation().cast<float>())),
                                 (vector * random.unit_vector<3>()).cast<float>()};
    Ellipsoid<float, 6> set;
    set.shape = (size * size * random.positive_definite<6>(4)).cast<float>();
    set.shape = (0.5F * (set.shape + set.shape.transpose())).eval();
    set.center.setZero();
    set.center.head<3>() = (random.log_uniform(1e-3, 2) * random.unit_vector<3>()).cast<float>();
    set.center.tail<3>() = (random.log_uniform(1e-3, 1) * vector * random.unit_vector<3>()).cast<float>();
    GibbsEllipsoid<RigidBodyState<float>> moved;
    if (move(center, set, moved) != Status::ok) {
      continue;
    }
    const RealMatrix6 root = RealMatrix6(set.shape.cast<Real>()).llt().matrixL();
    const RealMatrix6 metric = RealMatrix6(moved.shape.cast<Real>()).inverse();
    for (int k = 0; k < 4; ++k) {
      const RealVector6 y = set.center.cast<Real>() + root * random.unit_vector<6>().cast<Real>();
      const RealVector g = y.head<3>() / 2;
      RealMatrix s;
      s << 0, -g(2), g(1), g(2), 0, -g(0), -g(1), g(0), 0;
      const RealMatrix turn = RealMatrix::Identity() + (2 / (1 + g.squaredNorm())) * (s + s * s);
      RealVector6 seen;
      seen << gibbs(nearest(moved.center.attitude), nearest(center.attitude) * turn),
          center.angular_velocity.cast<Real>() + y.tail<3>() - moved.center.angular_velocity.cast<Real>();
      const double form = static_cast<double>(seen.dot(metric * seen));
      CHECK(form <= 1);
      worst = std::fmax(worst, form);
    }
  }
}

}  // namespace

TEST_CASE("recentring in float loses nothing of sets as small as its rounding") {
  Random random(3);
  double worst = 0;
  const auto move = [](const auto& center, const auto& set, auto& moved) { return recentred(center, set, moved); };
  check_rims(move, 1e-8, 1e-4, 1e-6, random, 8000, worst);  // the attitude's rounding
  CHECK(worst > 0.8);
  check_rims(move, 1e-6, 1e-3, 100, random, 8000, worst);  // the vector's
}

TEST_CASE("many recentrings leave a rotation") {
  Random random(4);
  RigidBodyState<float> center{renormalized(Matrix3<float>(random.rotation().cast<float>())), Vector3<float>::Zero()};
  Ellipsoid<float, 6> set;
  set.shape = 1e-4F * Matrix6<float>::Identity();
  set.center.setZero();
  for (int k = 0; k < 4000; ++k) {
    set.center.head<3>() = (0.3 * random.unit_vector<3>()).cast<float>();
    GibbsEllipsoid<RigidBodyState<float>> moved;
    REQUIRE(recentred(center, set, moved) == Status::ok);
    center = moved.center;
  }
  CHECK((center.attitude.transpose() * center.attitude - Matrix3<float>::Identity()).norm() < 8 * epsilon);
}

TEST_CASE_TEMPLATE("a linear measurement with a thin bound loses no point", Scalar, double, float) {
  using Matrix2r = Eigen::Matrix<Real, 2, 2>;
  using Vector2r = Eigen::Matrix<Real, 2, 1>;
  using Vector6r = Eigen::Matrix<Real, 6, 1>;
  Random random(9);
  const double longest = std::is_same_v<Scalar, float> ? 300 : 1e5;  // up to which the truth below has its digits
  Real worst = 0;
  for (int trial = 0; trial < 500; ++trial) {
    GibbsEllipsoid<RigidBodyState<Scalar>> predicted{{Matrix3<Scalar>::Identity(), Vector3<Scalar>::Zero()},
                                                     Scalar(1e-4F) * Matrix6<Scalar>::Identity()};
    LinearMeasurement<Scalar, 2> measurement;
    measurement.h.setZero();
    measurement.h.template rightCols<3>() = random.normal_matrix<2, 3>().template cast<Scalar>();
    // As wide as the prediction along one axis, and much wider along the other: the prediction's own rounding is small.
    const double ratio = random.log_uniform(1, longest);
    measurement.bound =
        (1e-4 * random.symmetric<2>(Eigen::Vector2d(ratio * ratio, random.uniform(0.1, 1)))).template cast<Scalar>();
    const Eigen::SelfAdjointEigenSolver<Matrix2r> bound(Matrix2r(measurement.bound.template cast<Real>()));
    if (!(bound.eigenvalues()(0) > 0)) {
      continue;  // rounding has made it flat
    }
    const Vector6r y =
        (1 - 1e-9L) * std::sqrt(static_cast<Real>(predicted.shape(0, 0))) * random.unit_vector<6>().cast<Real>();
    const auto h = measurement.h.template cast<Real>().eval();
    const Vector2r off = std::sqrt(bound.eigenvalues()(0)) * bound.eigenvectors().col(0);  // along the thin axis
    Real form = 2;
    for (Real share = 1; form > 1 - 1e-8L; share *= 0.999L) {  // as it is rounded, in its bound
      measurement.y = Vector2r(h * y + share * off).template cast<Scalar>();
      const Vector2r error = measurement.y.template cast<Real>() - h * y;
      form = (bound.eigenvectors().transpose() * error).cwiseAbs2().cwiseQuotient(bound.eigenvalues()).sum();
      REQUIRE(share > 0.5L);
    }
    Quadric<Scalar, 6> quadric;
    const Status status = to_quadric(measurement, predicted, quadric);
    if (status == Status::not_positive_definite) {
      continue;
    }
    REQUIRE(status == Status::ok);
    const Ellipsoid<Scalar, 6> known = predicted.in_coordinates();
    QuadricFusion<Scalar, 6> fusion;
    REQUIRE(minimal_intersection(&known, &quadric, 1, SizeCriterion<Scalar, 6>::volume(), fusion) == Status::ok);
    const Vector6r error = y - fusion.set.center.template cast<Real>();
    worst = std::fmax(worst, error.dot(RealMatrix6(fusion.set.shape.template cast<Real>()).llt().solve(error)));
  }
  CHECK(static_cast<double>(worst - 1) <= 0);
}

namespace {

template <int rows>
struct RowCount {
  static constexpr int value = rows;
};

}  // namespace

TEST_CASE_TEMPLATE("a linear measurement's quadric holds its rim, in exact arithmetic", Count, RowCount<1>, RowCount<2>,
                   RowCount<3>) {
  constexpr int rows = Count::value;
  using Bound = Eigen::Matrix<Real, rows, rows>;
  using Rows = Eigen::Matrix<Real, rows, 1>;
  using Vector6r = Eigen::Matrix<Real, 6, 1>;
  Random random(17);
  Real least = 1;  // slack, of one
  int tried = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    LinearMeasurement<float, rows> measurement;
    measurement.h = random.normal_matrix<rows, 6>().template cast<float>();
    Vector<double, rows> widths;
    for (int k = 0; k < rows; ++k) {
      widths(k) = random.log_uniform(1e-3, 1);
    }
    measurement.bound =
        symmetrized(Matrix<float, rows>(random.symmetric<rows>(widths.cwiseAbs2()).template cast<float>()));
    const Eigen::SelfAdjointEigenSolver<Bound> bound(Bound(measurement.bound.template cast<Real>()));
    if (!(bound.eigenvalues()(0) > 0)) {
      continue;  // rounding has made it flat
    }
    // The state is that far away, in widths of the bound.
    const Vector6<float> reach = Vector6<float>::Constant(static_cast<float>(random.log_uniform(1e-3, 1e2)));
    const Vector6r x = reach.cast<Real>().cwiseProduct(random.unit_vector<6>().cast<Real>());
    const auto h = measurement.h.template cast<Real>().eval();
    const Rows rim = bound.eigenvectors() *
                     bound.eigenvalues().cwiseSqrt().cwiseProduct(random.unit_vector<rows>().template cast<Real>());
    measurement.y = Rows(h * x + rim).template cast<float>();
    const auto form_of = [&](const Rows& error) {
      return (bound.eigenvectors().transpose() * error).cwiseAbs2().cwiseQuotient(bound.eigenvalues()).sum();
    };
    if (form_of(measurement.y.template cast<Real>() - h * x) > 1) {
      continue;  // as y is rounded, it is outside
    }
    Quadric<float, 6> quadric;
    if (covered_quadric(measurement, reach, quadric) != Status::ok) {
      continue;
    }
    ++tried;
    const Real slack = static_cast<Real>(quadric.c) - 2 * quadric.g.template cast<Real>().dot(x) -
                       x.dot(quadric.a.template cast<Real>() * x);
    least = std::fmin(least, slack);
  }
  CHECK(static_cast<double>(least) >= 0);
  CHECK(tried > 2000);
}
