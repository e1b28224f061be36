#include <doctest/doctest.h>

#include <elliptude/dynamics/rigid_body.hpp>
#include <limits>

#include "support/dual.hpp"
#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

Status status_of(const Matrix3<double>& inertia) {
  RigidBody<double> body;
  return RigidBody<double>::make(inertia, body);
}

Status status_of(double a, double b, double c) { return status_of(Vector3<double>(a, b, c).asDiagonal()); }

/// J = Σ m (|r|² I − r rᵀ) of point masses.
Matrix3<double> inertia_of_points(const Eigen::Matrix3Xd& points, const Eigen::VectorXd& masses) {
  Matrix3<double> inertia = Matrix3<double>::Zero();
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const Vector3<double> r = points.col(i);
    inertia += masses(i) * (r.squaredNorm() * Matrix3<double>::Identity() - r * r.transpose());
  }
  return inertia;
}

/// Eigenvalues in long double, least first.
template <typename Scalar>
Eigen::Matrix<long double, 3, 1> moments_in_long_double(const RigidBody<Scalar>& body) {
  return body.inertia().template cast<long double>().eval().template selfadjointView<Eigen::Lower>().eigenvalues();
}

}  // namespace

TEST_CASE("every distribution of masses has a valid inertia and J_d is its matrix of second moments") {
  Random random(1);
  for (int sample = 0; sample < 200; ++sample) {
    const Eigen::Matrix3Xd points = random.normal_matrix<3, 6>();
    const Eigen::VectorXd masses = random.normal_matrix<6>().cwiseAbs();
    const Matrix3<double> second_moments = points * masses.asDiagonal() * points.transpose();
    const Matrix3<double> inertia = inertia_of_points(points, masses);
    RigidBody<double> body;
    REQUIRE(RigidBody<double>::make(inertia, body) == Status::ok);
    CHECK((body.inertia() - inertia).norm() <= 1e-15 * inertia.norm());
    CHECK((body.nonstandard_inertia() - second_moments).norm() <= 1e-14 * inertia.norm());
    const Matrix3<double> identity = body.inertia_inverse() * inertia;
    const double condition = body.principal_moments()(0) / body.principal_moments()(2);
    CHECK((identity - Matrix3<double>::Identity()).norm() <= 1e-15 * 4 * condition);
  }
}

TEST_CASE("the principal moments are found in any axes and come largest first") {
  Random random(2);
  for (int sample = 0; sample < 100; ++sample) {
    const Matrix3<double> inertia = random.symmetric<3>(Vector3<double>(1.1, 2.5, 1.7));
    const RigidBody<double> body = make_body(inertia);
    CHECK((body.principal_moments() - Vector3<double>(2.5, 1.7, 1.1)).norm() <= 1e-14);
  }
}

TEST_CASE_TEMPLATE("no moment is less than the least or more than the greatest, of needles too", Scalar, double,
                   float) {
  Random random(4);
  int rounded_up = 0;
  for (int sample = 0; sample < 2000; ++sample) {
    const double least = random.log_uniform(1e-4, 1);
    const Vector3<double> moments(1, random.uniform(1 - least, 1), least);
    const Matrix3<Scalar> inertia = random.symmetric<3>(moments).cast<Scalar>();
    RigidBody<Scalar> body;
    if (RigidBody<Scalar>::make((inertia + inertia.transpose()) / 2, body) != Status::ok) {
      continue;  // the entries' rounding breaks the triangle inequality
    }
    const auto exact = moments_in_long_double(body);
    CHECK(static_cast<long double>(body.least_moment()) <= exact(0));
    CHECK(static_cast<long double>(body.greatest_moment()) >= exact(2));
    rounded_up += static_cast<long double>(body.principal_moments()(2)) > exact(0) ? 1 : 0;
  }
  CHECK(rounded_up > 500);
}

TEST_CASE("the moments of a body that was rounded to another type, or comes from one, are bounds there too") {
  Random random(5);
  for (int sample = 0; sample < 500; ++sample) {
    const double least = random.log_uniform(1e-3, 1);
    const Matrix3<double> inertia = random.symmetric<3>(Vector3<double>(1, random.uniform(1 - least, 1), least));
    RigidBody<double> body;
    if (RigidBody<double>::make((inertia + inertia.transpose()) / 2, body) != Status::ok) {
      continue;  // the entries' rounding breaks the triangle inequality
    }
    const RigidBody<float> rounded = body.cast<float>();
    const RigidBody<double> back = rounded.cast<double>();
    const auto exact = moments_in_long_double(rounded);
    CHECK(static_cast<long double>(rounded.least_moment()) <= exact(0));
    CHECK(static_cast<long double>(rounded.greatest_moment()) >= exact(2));
    CHECK(static_cast<long double>(back.least_moment()) <= exact(0));
    CHECK(static_cast<long double>(back.greatest_moment()) >= exact(2));
  }
}

TEST_CASE("masses in one plane are allowed and lengthening one axis beyond the triangle inequality is not") {
  Random random(3);
  for (int sample = 0; sample < 200; ++sample) {
    const double a = random.log_uniform(1e-3, 1e3);
    const double b = random.log_uniform(1e-3, 1e3);
    CHECK(status_of(random.symmetric<3>(Vector3<double>(a, b, a + b))) == Status::ok);
    CHECK(status_of(random.symmetric<3>(Vector3<double>(a, b, (a + b) * (1 + 1e-12)))) == Status::invalid_inertia);
  }
  CHECK(status_of(1, 2, 3) == Status::ok);
  CHECK(status_of(1, 2, 3.001) == Status::invalid_inertia);
  CHECK(status_of(3.001, 1, 2) == Status::invalid_inertia);
  CHECK(status_of(1, 3.001, 2) == Status::invalid_inertia);
}

TEST_CASE("the size of the body does not matter for its validity") {
  for (const double scale : {1e-20, 1e-6, 1.0, 1e6, 1e20}) {
    CAPTURE(scale);
    CHECK(status_of(scale * 1, scale * 2, scale * 2.9) == Status::ok);
    CHECK(status_of(scale * 1, scale * 2, scale * 3.1) == Status::invalid_inertia);
  }
}

TEST_CASE("an inertia that is not symmetric or not positive or not finite is refused and the body stays as it was") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double infinity = std::numeric_limits<double>::infinity();
  CHECK(status_of(1, 2, 0) == Status::not_positive_definite);
  CHECK(status_of(1, 2, -2) == Status::not_positive_definite);
  CHECK(status_of(-1, -1, -1) == Status::not_positive_definite);
  CHECK(status_of(0, 0, 0) == Status::not_positive_definite);
  CHECK(status_of(1, nan, 1) == Status::not_finite);
  CHECK(status_of(1, infinity, 1) == Status::not_finite);

  Matrix3<double> crooked = Vector3<double>(1, 1.2, 1.4).asDiagonal();
  crooked(0, 1) = 1e-3;
  CHECK(status_of(crooked) == Status::not_symmetric);
  crooked(1, 0) = 1e-3;
  CHECK(status_of(crooked) == Status::ok);

  RigidBody<double> body = spacecraft<double>();
  CHECK(RigidBody<double>::make(Matrix3<double>::Zero(), body) == Status::not_positive_definite);
  CHECK(body.inertia() == spacecraft<double>().inertia());
}

TEST_CASE("kinetic energy and angular momentum are those of the moving masses") {
  Random random(4);
  for (int sample = 0; sample < 100; ++sample) {
    const Eigen::Matrix3Xd points = random.normal_matrix<3, 5>();
    const Eigen::VectorXd masses = random.normal_matrix<5>().cwiseAbs();
    const RigidBody<double> body = make_body(inertia_of_points(points, masses));
    const RigidBodyState<double> state{random.rotation(), random.normal_matrix<3>()};
    double energy = 0;
    Vector3<double> momentum = Vector3<double>::Zero();
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const Vector3<double> r = points.col(i);
      const Vector3<double> velocity = state.angular_velocity.cross(r);  // body axes
      energy += masses(i) * velocity.squaredNorm() / 2;
      momentum += masses(i) * (state.attitude * r).cross(state.attitude * velocity);
    }
    CHECK(body.kinetic_energy(state.angular_velocity) == doctest::Approx(energy).epsilon(1e-13));
    CHECK((body.angular_momentum(state) - momentum).norm() <= 1e-13 * (1 + momentum.norm()));
  }
}

TEST_CASE("a body converts to other scalar types") {
  const RigidBody<double> body = skewed_body<double>();
  const RigidBody<float> small = body.cast<float>();
  CHECK(small.inertia() == body.inertia().cast<float>());
  CHECK(small.inertia_inverse() == body.inertia_inverse().cast<float>());
  CHECK(small.nonstandard_inertia() == body.nonstandard_inertia().cast<float>());
  CHECK(small.principal_moments() == body.principal_moments().cast<float>());

  using D = Dual<3>;
  const Vector3<double> rate(0.3, -0.4, 0.5);
  const D energy = body.cast<D>().kinetic_energy(variables<3>(rate));
  CHECK((energy.gradient - body.inertia() * rate).norm() <= 1e-15);
}
