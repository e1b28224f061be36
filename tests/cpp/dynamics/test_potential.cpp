#include <doctest/doctest.h>

#include <elliptude/dynamics/potential.hpp>
#include <limits>
#include <vector>

#include "support/dual.hpp"
#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using Real = long double;

/// U = ½ k tr(Cᵀ A C B): no more symmetric than a potential has to be, and all its derivatives are known.
template <typename Scalar>
struct QuadraticPotential {
  Matrix3<Scalar> a;
  Matrix3<Scalar> b;

  Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const {
    return Scalar(0.5) * (Scalar(1) + time) * (attitude.transpose() * a * attitude * b).trace();
  }
  /// ∂U/∂C = ½ (A C B + Aᵀ C Bᵀ).
  Matrix3<Scalar> gradient(const Matrix3<Scalar>& attitude, const Scalar& time) const {
    return Scalar(0.5) * (Scalar(1) + time) * (a * attitude * b + a.transpose() * attitude * b.transpose());
  }
  Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const {
    return torque_of_gradient(attitude, gradient(attitude, time));
  }
  /// The Jacobian of M = vee(GᵀC − CᵀG): C turns by C S(ζ), and G, linear in C, with it.
  Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const {
    Matrix3<Scalar> jacobian;
    for (int j = 0; j < 3; ++j) {
      const Matrix3<Scalar> turn = attitude * hat(Vector3<Scalar>::Unit(j));
      const Matrix3<Scalar> product =
          gradient(turn, time).transpose() * attitude + gradient(attitude, time).transpose() * turn;
      jacobian.col(j) = Scalar(2) * vee(product);
    }
    return jacobian;
  }
};

template <typename Scalar>
QuadraticPotential<Scalar> quadratic_potential() {
  Random random(77);
  const Matrix3<double> a = random.normal_matrix<3, 3>();
  const Matrix3<double> b = random.normal_matrix<3, 3>();
  return {a.cast<Scalar>(), b.cast<Scalar>()};
}

/// Calls test(potential) with each potential of the library and one that a user could have written, for one scalar type.
template <typename Scalar, typename Test>
void for_each_potential(const Test& test) {
  const RigidBody<double> body = skewed_body<double>();
  UniformGravity<double> gravity;
  REQUIRE(UniformGravity<double>::make(1.3, 9.81, {0.2, -0.3, 0.4}, gravity) == Status::ok);
  const GravityGradient<double> gradient = gravity_gradient(body, 0.8, tilted_orbit<double>());
  const auto gravity_cast = gravity.template cast<Scalar>();
  const auto gradient_cast = gradient.template cast<Scalar>();
  {
    INFO("free body");
    test(FreeBody<Scalar>{});
  }
  {
    INFO("uniform gravity");
    test(gravity_cast);
  }
  {
    INFO("gravity gradient");
    test(gradient_cast);
  }
  {
    INFO("sum");
    test(SumPotential(gravity_cast, gradient_cast, quadratic_potential<Scalar>()));
  }
  {
    INFO("a user's own");
    test(quadratic_potential<Scalar>());
  }
}

/// ∂U/∂Cᵢⱼ by central differences, the entries taken for independent; exact for the potentials here, which are at most
/// quadratic in C.
template <typename Potential>
Matrix3<double> numerical_gradient(const Potential& potential, const Matrix3<double>& attitude, double time) {
  Matrix3<double> gradient;
  for (int i = 0; i < 9; ++i) {
    Matrix3<double> up = attitude;
    Matrix3<double> down = attitude;
    up(i) += 0.5;
    down(i) -= 0.5;
    gradient(i) = potential.energy(up, time) - potential.energy(down, time);
  }
  return gradient;
}

}  // namespace

TEST_CASE("the torque is the sum over rows r_i x v_i of the attitude and the gradient of the energy") {
  Random random(1);
  for_each_potential<double>([&](const auto& potential) {
    for (int sample = 0; sample < 50; ++sample) {
      const Matrix3<double> attitude = random.rotation();
      const double time = random.uniform(-5, 5);
      const Matrix3<double> gradient = numerical_gradient(potential, attitude, time);
      Vector3<double> torque = Vector3<double>::Zero();
      for (int i = 0; i < 3; ++i) {
        const Vector3<double> row = attitude.row(i);
        const Vector3<double> slope = gradient.row(i);
        torque += row.cross(slope);
      }
      CHECK((potential.torque(attitude, time) - torque).norm() <= 1e-14 * (1 + gradient.norm()));
      CHECK((torque_of_gradient(attitude, gradient) - torque).norm() <= 1e-15 * (1 + gradient.norm()));
      const Matrix3<double> paper = gradient.transpose() * attitude - attitude.transpose() * gradient;
      CHECK((hat(torque) - paper).norm() <= 1e-14 * (1 + gradient.norm()));
    }
  });
}

TEST_CASE("the torque is minus the derivative of the energy along rotations of the body") {
  Random random(2);
  using D = Dual<3>;
  const Vector3<D> zeta = variables<3>(Vector3<double>(0, 0, 0));
  for (int sample = 0; sample < 50; ++sample) {
    const Matrix3<double> attitude = random.rotation();
    const double time = random.uniform(-5, 5);
    std::vector<Vector3<double>> slopes;
    for_each_potential<D>([&](const auto& potential) {
      slopes.push_back(potential.energy(Matrix3<D>(attitude.cast<D>() * exp(zeta)), D(time)).gradient);
    });
    auto slope = slopes.begin();
    for_each_potential<double>([&](const auto& potential) {
      CHECK((potential.torque(attitude, time) + *slope).norm() <= 1e-14 * (1 + slope->norm()) * 4);
      ++slope;
    });
  }
}

TEST_CASE("the torque Jacobian is the derivative of the torque by dual numbers and by differences") {
  Random random(3);
  using D = Dual<3>;
  const Vector3<D> zeta = variables<3>(Vector3<double>(0, 0, 0));
  for (int sample = 0; sample < 50; ++sample) {
    const Matrix3<double> attitude = random.rotation();
    const double time = random.uniform(-5, 5);
    std::vector<Matrix3<double>> slopes;
    for_each_potential<D>([&](const auto& potential) {
      slopes.push_back(jacobian(Vector3<D>(potential.torque(Matrix3<D>(attitude.cast<D>() * exp(zeta)), D(time)))));
    });
    auto slope = slopes.begin();
    for_each_potential<double>([&](const auto& potential) {
      const Matrix3<double> value = potential.torque_jacobian(attitude, time);
      CHECK((value - *slope).norm() <= 1e-14 * (1 + slope->norm()) * 4);
      // Second-order differences with one step of Richardson's: an error of h⁴ and of ε/h.
      const auto difference = [&](int axis, double h) {
        const Vector3<double> turn = h * Vector3<double>::Unit(axis);
        return Vector3<double>((potential.torque(Matrix3<double>(attitude * exp(turn)), time) -
                                potential.torque(Matrix3<double>(attitude * exp(-turn)), time)) /
                               (2 * h));
      };
      for (int axis = 0; axis < 3; ++axis) {
        const Vector3<double> column = (4 * difference(axis, 5e-4) - difference(axis, 1e-3)) / 3;
        CHECK((value.col(axis) - column).norm() <= 1e-11 * (1 + value.norm()));
      }
      ++slope;
    });
  }
}

TEST_CASE("the gravity gradient follows the orbit in its tilted plane") {
  const RigidBody<double> body = skewed_body<double>();
  const Matrix3<double> orbit = tilted_orbit<double>();
  const double rate = 0.8;
  const GravityGradient<double> potential = gravity_gradient(body, rate, orbit);
  const Vector3<double> normal = orbit.col(2);
  Random random(4);
  for (int sample = 0; sample < 50; ++sample) {
    const Matrix3<double> attitude = random.rotation();
    const double time = random.uniform(-20, 20);
    // A body carried round with the orbit sees no change.
    const Matrix3<double> carried = exp(Vector3<double>(rate * time * normal)) * attitude;
    CHECK(potential.energy(carried, time) == doctest::Approx(potential.energy(attitude, 0)).epsilon(1e-13));
    CHECK((potential.torque(carried, time) - potential.torque(attitude, 0)).norm() <= 1e-13);
    CHECK((potential.torque_jacobian(carried, time) - potential.torque_jacobian(attitude, 0)).norm() <= 1e-13);
    // Two point masses on a line in the direction of motion, from the attraction itself: 3n²/2 bᵀJb is its second order.
    const Vector3<double> radial = std::cos(rate * time) * orbit.col(0) + std::sin(rate * time) * orbit.col(1);
    const Vector3<double> b = attitude.transpose() * radial;
    CHECK(potential.energy(attitude, time) ==
          doctest::Approx(1.5 * rate * rate * b.dot(body.inertia() * b)).epsilon(1e-13));
  }
  // From the attracting body at a distance of R = 1e4 m with gravitational parameter n²R³: the torque on a dumbbell.
  const double distance = 1e4;
  const Vector3<double> arm(0.6, -0.3, 0.5);
  const Matrix3<double> inertia = 2 * (arm.squaredNorm() * Matrix3<double>::Identity() - arm * arm.transpose()) +
                                  1e-9 * Matrix3<double>::Identity();
  const GravityGradient<double> dumbbell = gravity_gradient(make_body(inertia), rate, orbit);
  const Matrix3<double> attitude = random.rotation();
  const Vector3<long double> center =
      (distance * (std::cos(rate) * orbit.col(0) + std::sin(rate) * orbit.col(1))).cast<long double>();
  const Matrix3<long double> c = attitude.cast<long double>();
  Vector3<long double> torque = Vector3<long double>::Zero();
  for (const long double sign : {1.0L, -1.0L}) {
    const Vector3<long double> offset = c * (sign * arm.cast<long double>());
    const Vector3<long double> position = center + offset;
    const long double parameter = static_cast<long double>(rate * rate) * std::pow(center.norm(), 3.0L);
    torque += offset.cross(Vector3<long double>(-parameter / std::pow(position.norm(), 3.0L) * position));
  }
  const Vector3<double> expected = (c.transpose() * torque).cast<double>();
  // The next order of the expansion is (arm / distance)² smaller, for the two masses are symmetric.
  CHECK((dumbbell.torque(attitude, 1.0) - expected).norm() <= 1e-7 * expected.norm());
  CHECK(expected.norm() > 0.01);
}

TEST_CASE("uniform gravity pulls the centre of mass down along the third reference axis") {
  const UniformGravity<double> gravity = pendulum_gravity<double>();
  const Matrix3<double> hanging = Matrix3<double>::Identity();
  CHECK(gravity.energy(hanging, 0) == doctest::Approx(-9.81 * 0.3));
  CHECK(gravity.torque(hanging, 0).norm() == 0);
  const double tilt = 0.1;
  const Matrix3<double> tilted = exp(Vector3<double>(tilt, 0, 0));
  CHECK(gravity.torque(tilted, 0).x() == doctest::Approx(-9.81 * 0.3 * std::sin(tilt)));
}

namespace {

/// ‖M(C exp(S(ζ))) − M(C) − (∂M/∂ζ) ζ‖ / (κ ‖ζ‖²), in long double, in which the differences of small ζ keep their digits.
template <typename Potential>
Real share_of_bound(const Potential& potential, const Matrix3<Real>& attitude, const Vector3<Real>& zeta, Real time) {
  const Matrix3<Real> turned = attitude * exp(zeta);
  const Vector3<Real> rest = potential.torque(turned, time) - potential.torque(attitude, time) -
                             potential.torque_jacobian(attitude, time) * zeta;
  return rest.norm() / (potential.torque_curvature_bound() * zeta.squaredNorm());
}

/// The largest share found by a random search that closes in on the best attitude and direction so far.
template <typename Potential>
Real sharpest_share(const Potential& potential, Random& random) {
  Real best = 0;
  for (int start = 0; start < 20; ++start) {
    Matrix3<double> attitude = random.rotation();
    Vector3<double> axis = random.unit_vector<3>();
    Real here = 0;
    for (int trial = 0; trial < 400; ++trial) {
      const double reach = std::pow(10.0, -trial / 130.0);
      const Matrix3<double> near = attitude * exp(Vector3<double>(reach * random.normal_matrix<3>()));
      const Vector3<double> toward = (axis + reach * random.normal_matrix<3>()).normalized();
      const Real share = share_of_bound(potential, near.cast<Real>(), Vector3<Real>(toward.cast<Real>() * 1e-3L), 0.4L);
      if (share > here) {
        here = share;
        attitude = near;
        axis = toward;
      }
    }
    best = std::max(best, here);
  }
  return best;
}

template <typename Potential>
void check_curvature_bound(const Potential& potential) {
  Random random(5);
  for (int sample = 0; sample < 20000; ++sample) {
    const Matrix3<Real> attitude = random.rotation().cast<Real>();
    const double angle = sample % 2 == 0 ? random.uniform(0, 3.141592653589793) : random.log_uniform(1e-4, 3);
    const Vector3<Real> zeta = (angle * random.unit_vector<3>()).cast<Real>();
    REQUIRE(share_of_bound(potential, attitude, zeta, Real(random.uniform(-5, 5))) <= 1 + 1e-9L);
  }
  const Real sharpest = sharpest_share(potential, random);
  CHECK(sharpest >= 0.99L);
  CHECK(sharpest <= 1 + 1e-9L);
}

}  // namespace

TEST_CASE("the curvature bound of uniform gravity holds for all turns and is sharp") {
  UniformGravity<Real> gravity;
  REQUIRE(UniformGravity<Real>::make(1.3L, 9.81L, {0.2L, -0.3L, 0.4L}, gravity) == Status::ok);
  check_curvature_bound(gravity);
}

TEST_CASE("the curvature bound of the gravity gradient holds for all turns and is sharp") {
  check_curvature_bound(gravity_gradient(skewed_body<Real>(), 0.8L, tilted_orbit<Real>()));
}

TEST_CASE("a sum has the curvature bound that its parts have together") {
  const UniformGravity<Real> gravity = pendulum_gravity<Real>();
  const GravityGradient<Real> gradient = orbit_gravity(spacecraft<Real>());
  const SumPotential sum(gravity, gradient, FreeBody<Real>{});
  static_assert(has_curvature_bound<decltype(sum)>);
  CHECK(sum.torque_curvature_bound() ==
        doctest::Approx(static_cast<double>(0.5L * 9.81L * 0.3L + 3 * (2.8L - 1))).epsilon(1e-15));
  Random random(6);
  for (int sample = 0; sample < 5000; ++sample) {
    const Vector3<Real> zeta = (3.1 * random.in_ball<3>()).cast<Real>();
    REQUIRE(share_of_bound(sum, Matrix3<Real>(random.rotation().cast<Real>()), zeta, 0.7L) <= 1);
  }
  static_assert(!has_curvature_bound<QuadraticPotential<double>>);
  static_assert(!has_curvature_bound<SumPotential<FreeBody<double>, QuadraticPotential<double>>>);
  static_assert(has_curvature_bound<SumPotential<FreeBody<double>, UniformGravity<double>>>);
  static_assert(has_curvature_bound<FreeBody<double>>);
  CHECK(FreeBody<double>{}.torque_curvature_bound() == 0);
}

TEST_CASE("a sum adds the energies and torques of its parts") {
  const UniformGravity<double> gravity = pendulum_gravity<double>();
  const GravityGradient<double> gradient = orbit_gravity(spacecraft<double>());
  const SumPotential sum(gravity, gradient, gravity);
  static_assert(is_potential<decltype(sum), double>);
  const Matrix3<double> attitude = Random(7).rotation();
  CHECK(sum.energy(attitude, 0.3) ==
        doctest::Approx(2 * gravity.energy(attitude, 0.3) + gradient.energy(attitude, 0.3)).epsilon(1e-15));
  CHECK((sum.torque(attitude, 0.3) - 2 * gravity.torque(attitude, 0.3) - gradient.torque(attitude, 0.3)).norm() <=
        1e-15 * 10);
  CHECK((sum.torque_jacobian(attitude, 0.3) - 2 * gravity.torque_jacobian(attitude, 0.3) -
         gradient.torque_jacobian(attitude, 0.3))
            .norm() <= 1e-15 * 10);
}

TEST_CASE("a potential from its gradient alone has the torque and nearly the Jacobian of the same potential in full") {
  const QuadraticPotential<double> full = quadratic_potential<double>();
  const auto energy = [&full](const Matrix3<double>& c, double t) { return full.energy(c, t); };
  const auto gradient = [&full](const Matrix3<double>& c, double t) { return full.gradient(c, t); };
  const GradientPotential<double, decltype(energy), decltype(gradient)> potential(energy, gradient);
  static_assert(is_potential<decltype(potential), double>);
  static_assert(!has_curvature_bound<decltype(potential)>);
  Random random(8);
  for (int sample = 0; sample < 200; ++sample) {
    const Matrix3<double> attitude = random.rotation();
    const double time = random.uniform(0, 3);
    CHECK(potential.energy(attitude, time) == full.energy(attitude, time));
    CHECK(potential.torque(attitude, time) == full.torque(attitude, time));
    const double scale = full.gradient(attitude, time).norm();
    CHECK((potential.torque_jacobian(attitude, time) - full.torque_jacobian(attitude, time)).norm() <= 4e-12 * scale);
  }
}

TEST_CASE("what is not a potential is told from what is") {
  struct Empty {};
  struct NoJacobian {
    double energy(const Matrix3<double>&, const double&) const { return 0; }
    Vector3<double> torque(const Matrix3<double>&, const double&) const { return Vector3<double>::Zero(); }
  };
  static_assert(!is_potential<Empty, double>);
  static_assert(!is_potential<NoJacobian, double>);
  static_assert(is_potential<QuadraticPotential<double>, double>);
  static_assert(is_potential<UniformGravity<Dual<6>>, Dual<6>>);
  CHECK(is_potential<FreeBody<float>, float>);
}

TEST_CASE("potentials refuse numbers that mean nothing and stay as they were") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const Vector3<double> center(0, 0, 0.3);
  UniformGravity<double> gravity = pendulum_gravity<double>();
  CHECK(UniformGravity<double>::make(nan, 9.81, center, gravity) == Status::not_finite);
  CHECK(UniformGravity<double>::make(1, infinity, center, gravity) == Status::not_finite);
  CHECK(UniformGravity<double>::make(1, 9.81, {0, nan, 0}, gravity) == Status::not_finite);
  CHECK(UniformGravity<double>::make(-1, 9.81, center, gravity) == Status::out_of_range);
  CHECK(UniformGravity<double>::make(1, -9.81, center, gravity) == Status::out_of_range);
  CHECK(gravity.energy(Matrix3<double>::Identity(), 0) == doctest::Approx(-9.81 * 0.3));

  const RigidBody<double> body = spacecraft<double>();
  const Matrix3<double> identity = Matrix3<double>::Identity();
  GravityGradient<double> gradient = orbit_gravity(body);
  CHECK(GravityGradient<double>::make(body, nan, identity, gradient) == Status::not_finite);
  CHECK(GravityGradient<double>::make(body, -1, identity, gradient) == Status::out_of_range);
  CHECK(GravityGradient<double>::make(body, 1, nan * identity, gradient) == Status::not_finite);
  CHECK(GravityGradient<double>::make(body, 1, -identity, gradient) == Status::not_a_rotation);
  CHECK(GravityGradient<double>::make(body, 1, 1.001 * identity, gradient) == Status::not_a_rotation);
  CHECK(gradient.torque_curvature_bound() == doctest::Approx(3 * 1.8));
  CHECK(UniformGravity<double>().torque(identity, 0).norm() == 0);
  CHECK(GravityGradient<double>().torque(exp(Vector3<double>(0.1, 0.2, 0.3)), 0).norm() == 0);
}
