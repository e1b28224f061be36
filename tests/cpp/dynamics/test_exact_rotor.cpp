#include <doctest/doctest.h>

#include <algorithm>
#include <elliptude/dynamics/exact_rotor.hpp>
#include <elliptude/dynamics/linearization.hpp>
#include <limits>
#include <vector>

#include "support/dual.hpp"
#include "support/pack.hpp"
#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

const auto ignore_steps = [](long, const auto&) {};

template <typename Scalar>
ExactRotor<Scalar> make_rotor(const RigidBody<Scalar>& body) {
  ExactRotor<Scalar> rotor;
  REQUIRE(ExactRotor<Scalar>::make(body, rotor) == Status::ok);
  return rotor;
}

/// A rigid body's inertia in its principal axes, a time and a momentum.
struct Case {
  Matrix3<double> inertia;
  double h;
  Vector3<double> momentum;
};

/// Bodies of every shape, among them symmetric, spherical, flat and thin ones and such that are nearly so; spins about each axis
/// and near it, at the separatrix and near it; short and long steps of both signs. In random axes.
std::vector<Case> cases(int count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Case> result;
  for (int i = 0; i < count; ++i) {
    Vector3<double> half(random.uniform(0.05, 1), random.uniform(0.05, 1), random.uniform(0.05, 1));
    const double near = i % 2 == 0 ? 0 : random.log_uniform(1e-14, 1e-2);
    switch (i % 6) {
      case 1:
        half(1) = half(0) * (1 + near);
        break;
      case 2:
        half = Vector3<double>(half(0), half(0) * (1 + near), half(0) * (1 - near));
        break;
      case 3:
        half(2) = half(2) * 1e-3 + near;
        break;
      case 4:
        half.head<2>() *= 1e-2;
        break;
      default:
        break;
    }
    const Vector3<double> moments(half(1) + half(2), half(0) + half(2), half(0) + half(1));
    Vector3<double> m = random.unit_vector<3>();
    const double off = (i / 6) % 2 == 0 ? 0 : random.log_uniform(1e-15, 1e-3);
    switch ((i / 12) % 4) {
      case 1:
        m = Vector3<double>::Unit((i / 48) % 3) + off * m;
        break;
      case 2: {  // 2E = ‖m‖²/J₂ of the middle moment
        Vector3<double> sorted = moments;
        std::sort(sorted.data(), sorted.data() + 3);
        for (int middle = 0; middle < 3; ++middle) {
          if (moments(middle) == sorted(1)) {
            const int one = (middle + 1) % 3;
            const int other = (middle + 2) % 3;
            m(other) = m(one) *
                       std::sqrt(std::abs((1 / moments(one) - 1 / moments(middle)) /
                                          (1 / moments(middle) - 1 / moments(other) + 1e-300))) *
                       (1 + off);
          }
        }
        break;
      }
      default:
        break;
    }
    if (!(m.norm() > 0.1 && m.norm() < 1e3)) {
      m = random.unit_vector<3>();
    }
    const Matrix3<double> axes = i % 5 == 0 ? Matrix3<double>(Matrix3<double>::Identity()) : random.rotation();
    const double turn = random.log_uniform(1e-6, 30);
    const double h = (i % 3 == 0 ? -1 : 1) * random.log_uniform(1e-3, 10);
    const Vector3<double> momentum = (turn / std::abs(h)) * moments.minCoeff() * m.normalized();
    result.push_back(
        {symmetrized(Matrix3<double>(axes * moments.asDiagonal() * axes.transpose())), h, axes * momentum});
  }
  return result;
}

/// F by power series of q̇ = ½ q ω and ȧ = a × J⁻¹a, whose turn is a fourth of a radian at most in each of many steps.
Matrix3<double> by_series(const Case& of) {
  using Real = long double;
  const Matrix3<Real> inverse = of.inertia.cast<Real>().inverse();
  Vector3<Real> a = of.momentum.cast<Real>();
  Vector<Real, 4> q(0, 0, 0, 1);  // scalar last
  const Real turn = std::abs(static_cast<Real>(of.h)) * a.norm() * inverse.norm();
  const int steps = 1 + static_cast<int>(4 * turn);
  const Real h = static_cast<Real>(of.h) / steps;
  constexpr int order = 28;
  for (int step = 0; step < steps; ++step) {
    std::array<Vector3<Real>, order + 1> as;
    std::array<Vector<Real, 4>, order + 1> qs;
    as[0] = a;
    qs[0] = q;
    Real power = 1;
    for (std::size_t n = 0; n < order; ++n) {
      Vector3<Real> da = Vector3<Real>::Zero();
      Vector<Real, 4> dq = Vector<Real, 4>::Zero();
      for (std::size_t k = 0; k <= n; ++k) {
        const Vector3<Real> rate = inverse * as[n - k];
        da += as[k].cross(rate);
        const Vector3<Real> v = qs[k].head<3>();
        dq.head<3>() += (qs[k](3) * rate + v.cross(rate)) / 2;
        dq(3) -= v.dot(rate) / 2;
      }
      as[n + 1] = da / static_cast<Real>(n + 1);
      qs[n + 1] = dq / static_cast<Real>(n + 1);
      power *= h;
      a += power * as[n + 1];
      q += power * qs[n + 1];
    }
    q.normalize();
  }
  return to_rotation(Quaternion<Real>{q(3), q.head<3>()}).cast<double>();
}

struct Found {
  ExactRotor<double> rotor;
  Matrix3<double> f;
  Matrix3<double> k;
};

Found find(const Case& of) {
  Found result{make_rotor(make_body(of.inertia)), {}, {}};
  REQUIRE(relative_attitude(result.rotor, of.h, of.momentum, result.f) == Status::ok);
  Matrix3<double> again;
  Matrix3<double> k_transposed;
  REQUIRE(relative_attitude_linearized(result.rotor, of.h, of.momentum, again, k_transposed) == Status::ok);
  CHECK((again - result.f).norm() <= 4e-15);
  result.k = k_transposed.transpose();
  return result;
}

/// How much of a relative change of the momentum, anywhere on the way, or of the inertia, all along it, there is in F at the end:
/// what rounding may be multiplied by. A change of the rates by a share of themselves turns the body by that share of its turn,
/// and its momentum, in body axes, too.
double sensitivity(const Case& of, const Found& found) {
  double largest = 0;
  double mean = 0;
  constexpr int parts = 8;
  for (int i = 0; i < parts; ++i) {
    const double before = of.h * i / parts;
    Matrix3<double> f;
    Matrix3<double> k_transposed;
    REQUIRE(relative_attitude(found.rotor, before, of.momentum, f) == Status::ok);
    const Vector3<double> momentum = f.transpose() * of.momentum;
    REQUIRE(relative_attitude_linearized(found.rotor, of.h - before, momentum, f, k_transposed) == Status::ok);
    largest = std::max(largest, k_transposed.norm() * of.momentum.norm());
    mean += k_transposed.norm() * of.momentum.norm() / parts;
  }
  const double turn = std::abs(of.h) * of.momentum.norm() * found.rotor.inverse_moments().z();
  return 1 + largest + turn * (1 + mean);
}

}  // namespace

TEST_CASE("the free rotor agrees with power series of its differential equation") {
  double worst = 0;
  for (const Case& of : cases(1500, 31)) {
    CAPTURE(of.inertia);
    CAPTURE(of.h);
    CAPTURE(of.momentum);
    const Found found = find(of);
    const double error = (found.f - by_series(of)).norm() / sensitivity(of, found);
    worst = std::max(worst, error);
    CHECK(error <= 1e-14);
    CHECK((found.f.transpose() * found.f - Matrix3<double>::Identity()).norm() <= 2e-15);
  }
  MESSAGE("largest error by sensitivity " << worst);
}

TEST_CASE("the free rotor conserves energy to rounding and its steps compose and reverse") {
  for (const Case& of : cases(600, 32)) {
    CAPTURE(of.inertia);
    CAPTURE(of.h);
    CAPTURE(of.momentum);
    const Found found = find(of);
    const Vector3<double> end = found.f.transpose() * of.momentum;
    const Case reverse{of.inertia, -of.h, end};
    // The way back multiplies what the way there has multiplied.
    const double tolerance = 4e-15 * sensitivity(of, found) * sensitivity(reverse, find(reverse));
    const Matrix3<double>& inverse = found.rotor.inertia_inverse();
    const double energy = of.momentum.dot(inverse * of.momentum);
    const double condition = found.rotor.principal_moments()(0) / found.rotor.principal_moments()(2);
    CHECK(std::abs(end.dot(inverse * end) - energy) <= 1e-14 * condition * energy);
    Matrix3<double> back;
    REQUIRE(relative_attitude(found.rotor, -of.h, end, back) == Status::ok);
    CHECK((back - found.f.transpose()).norm() <= tolerance);
    Matrix3<double> first;
    Matrix3<double> second;
    REQUIRE(relative_attitude(found.rotor, 0.3 * of.h, of.momentum, first) == Status::ok);
    const Vector3<double> between = first.transpose() * of.momentum;
    REQUIRE(relative_attitude(found.rotor, 0.7 * of.h, between, second) == Status::ok);
    CHECK((first * second - found.f).norm() <= tolerance);
  }
}

TEST_CASE("a symmetric body turns about its momentum and its axis at constant rates") {
  Random random(33);
  for (int sample = 0; sample < 500; ++sample) {
    const double along = random.uniform(0.1, 1.9);
    const Matrix3<double> axes = random.rotation();
    const RigidBody<double> body =
        make_body(symmetrized(Matrix3<double>(axes * Vector3<double>(1, 1, along).asDiagonal() * axes.transpose())));
    const ExactRotor<double> rotor = make_rotor(body);
    const Vector3<double> axis = axes.col(2);
    const Vector3<double> a = random.normal_matrix<3>();
    const double h = random.uniform(-10, 10);
    Matrix3<double> f;
    REQUIRE(relative_attitude(rotor, h, a, f) == Status::ok);
    const Matrix3<double> expected =
        exp(Vector3<double>(h * a)) * exp(Vector3<double>(h * (1 / along - 1) * axis.dot(a) * axis));
    CHECK((f - expected).norm() <= 1e-14 * (1 + std::abs(h) * a.norm() * (1 + 1 / along) / along));
  }
}

TEST_CASE("a sphere turns at its rate and a spin about a principal axis stays one") {
  Random random(34);
  for (int sample = 0; sample < 200; ++sample) {
    const double h = random.uniform(-10, 10);
    const Vector3<double> rate = random.normal_matrix<3>();
    Matrix3<double> f;
    const ExactRotor<double> sphere = make_rotor(make_body(Matrix3<double>(2.5 * Matrix3<double>::Identity())));
    REQUIRE(relative_attitude(sphere, h, Vector3<double>(2.5 * rate), f) == Status::ok);
    CHECK((f - exp(Vector3<double>(h * rate))).norm() <= 4e-15 * (1 + std::abs(h) * rate.norm()));
    const ExactRotor<double> rotor = make_rotor(spacecraft<double>());
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3<double> spin = rate(axis) * Vector3<double>::Unit(axis);
      REQUIRE(relative_attitude(rotor, h, Vector3<double>(rotor.inertia() * spin), f) == Status::ok);
      // About the intermediate axis deviations grow with the rate √((J₁ − J₂)(J₂ − J₃)/(J₁ J₃)).
      const double growth = axis == 2 ? std::exp(std::sqrt(0.8 / 2.8) * std::abs(h * rate(axis))) : 1;
      CHECK((f - exp(Vector3<double>(h * spin))).norm() <= 1e-14 * growth * (1 + std::abs(h * rate(axis))));
    }
  }
}

TEST_CASE("the derivative of the free rotor is that of dual numbers through it") {
  using D = Dual<3>;
  double worst = 0;
  for (const Case& of : cases(1500, 35)) {
    CAPTURE(of.inertia);
    CAPTURE(of.h);
    CAPTURE(of.momentum);
    const Found found = find(of);
    Matrix3<D> f;
    REQUIRE(relative_attitude(found.rotor.cast<D>(), D(of.h), variables<3>(of.momentum, 0), f) == Status::ok);
    const Vector3<D> turned = vee(Matrix3<D>(found.f.transpose().cast<D>() * f));
    const Matrix3<double> exact = jacobian(turned);
    // Dual numbers cancel in a short step where K does not.
    const double turn = std::abs(of.h) * of.momentum.norm() * found.rotor.inverse_moments().z();
    const double condition = sensitivity(of, found) * (1 + 1 / turn);
    const double error = (found.k - exact).norm() / found.k.norm();
    worst = std::max(worst, error / condition);
    CHECK(error <= 4e-15 * condition);
  }
  MESSAGE("largest relative error by condition " << worst);
}

TEST_CASE("a central difference of long double agrees with the derivative of the free rotor") {
  using Real = long double;
  for (const Case& of : cases(600, 36)) {
    CAPTURE(of.inertia);
    CAPTURE(of.h);
    CAPTURE(of.momentum);
    const Found found = find(of);
    const ExactRotor<Real> rotor = found.rotor.cast<Real>();
    // As long as the fastest rate allows: a change of the turn by so much.
    const Real step = 1e-4L * static_cast<Real>(of.momentum.norm() / sensitivity(of, found));
    const auto end = [&](int index, Real change) {
      Vector3<Real> a = of.momentum.cast<Real>();
      a(index) += change;
      Matrix3<Real> f;
      REQUIRE(relative_attitude(rotor, Real(of.h), a, f) == Status::ok);
      return f;
    };
    const Matrix3<Real> center = end(0, 0);
    Matrix3<double> difference;
    for (int i = 0; i < 3; ++i) {
      const auto slope = [&](Real change) {
        return Vector3<Real>(log(Matrix3<Real>(center.transpose() * end(i, change))) -
                             log(Matrix3<Real>(center.transpose() * end(i, -change))));
      };
      difference.col(i) = ((8 * slope(step) - slope(2 * step)) / (12 * step)).cast<double>();
    }
    const double turn = std::abs(of.h) * of.momentum.norm() * found.rotor.inverse_moments().z();
    CHECK((found.k - difference).norm() <= 1e-11 * found.k.norm() * sensitivity(of, found) * (1 + 1e-3 / turn));
  }
}

TEST_CASE_TEMPLATE("a body at rest stays and answers a momentum by its inertia", Scalar, float, double, long double) {
  const ExactRotor<Scalar> rotor = make_rotor(skewed_body<Scalar>());
  const Scalar epsilon = std::numeric_limits<Scalar>::epsilon();
  for (const long double rate : {0.0L, 1e-37L, 1e-20L, 1e-9L}) {
    for (const long double h : {-1.0L, 1e-3L, 0.0L}) {
      const Vector3<Scalar> a = Scalar(rate) * Vector3<Scalar>(Scalar(1), Scalar(-2), Scalar(0.5));
      Matrix3<Scalar> f;
      Matrix3<Scalar> k_transposed;
      REQUIRE(relative_attitude_linearized(rotor, Scalar(h), a, f, k_transposed) == Status::ok);
      CHECK((f - Matrix3<Scalar>::Identity()).norm() <= Scalar(4) * epsilon + Scalar(4) * a.norm());
      const Matrix3<Scalar> expected = Scalar(h) * rotor.inertia_inverse();
      CHECK((k_transposed - expected).norm() <= expected.norm() * (Scalar(30) * epsilon + Scalar(10) * a.norm()));
    }
  }
}

TEST_CASE_TEMPLATE("the free rotor in float and long double is that of double", Scalar, float, long double) {
  for (const Case& of : cases(300, 37)) {
    const Found found = find(of);
    const ExactRotor<Scalar> rotor = found.rotor.cast<Scalar>();
    Matrix3<Scalar> f;
    REQUIRE(relative_attitude(rotor, Scalar(of.h), Vector3<Scalar>(of.momentum.cast<Scalar>()), f) == Status::ok);
    const double coarse = std::max<double>(2.2e-16, static_cast<double>(std::numeric_limits<Scalar>::epsilon()));
    CHECK((f.template cast<double>() - found.f).norm() <= 20 * coarse * sensitivity(of, found));
  }
}

TEST_CASE("a free rotor refuses a turn without digits and what is not finite and then leaves its results alone") {
  const ExactRotor<double> rotor = make_rotor(spacecraft<double>());
  constexpr double infinity = std::numeric_limits<double>::infinity();
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double h : {1e30, infinity, nan}) {
    Matrix3<double> f = Matrix3<double>::Constant(7);
    Matrix3<double> k = Matrix3<double>::Constant(8);
    CHECK(relative_attitude(rotor, h, Vector3<double>(1, 2, 3), f) == Status::step_too_long);
    CHECK(relative_attitude_linearized(rotor, h, Vector3<double>(1, 2, 3), f, k) == Status::step_too_long);
    CHECK(f == Matrix3<double>::Constant(7));
    CHECK(k == Matrix3<double>::Constant(8));
  }
  Matrix3<double> f;
  CHECK(relative_attitude(rotor, 0.1, Vector3<double>(1, nan, 3), f) == Status::step_too_long);
  CHECK(relative_attitude(rotor, 0.1, Vector3<double>(1e200, 0, 0), f) == Status::step_too_long);
}

namespace {

template <typename Scalar>
Composition<Scalar> composition(int order) {
  Composition<Scalar> result;
  REQUIRE(composition_of_order(order, result) == Status::ok);
  return result;
}

/// The end of the pendulum's motion over `duration`, by the body or rotor given.
template <typename Body>
RigidBodyState<double> swing(const Body& body, int order, double duration, long steps) {
  RigidBodyState<double> end;
  REQUIRE(integrate(body, pendulum_gravity<double>(), composition<double>(order), 0.0,
                    duration / static_cast<double>(steps), steps, Vector3<double>(0.02, -0.01, 0.03),
                    pendulum_state<double>(), end, ignore_steps) == Status::ok);
  return end;
}

double distance(const RigidBodyState<double>& a, const RigidBodyState<double>& b) {
  return (a.attitude - b.attitude).norm() + (a.angular_velocity - b.angular_velocity).norm();
}

}  // namespace

TEST_CASE("a splitting with the exact rotor goes where the variational step goes with its own order") {
  const RigidBody<double> body = pendulum_body<double>();
  const ExactRotor<double> rotor = make_rotor(body);
  const RigidBodyState<double> truth = swing(body, 8, 0.5, 2000);
  for (const int order : {2, 4, 6, 8}) {
    CAPTURE(order);
    const long coarse = order == 2 ? 50 : 10;
    const double once = distance(swing(rotor, order, 0.5, coarse), truth);
    const double twice = distance(swing(rotor, order, 0.5, 2 * coarse), truth);
    CHECK(once <= 0.05);
    CHECK(std::log2(once / twice) == doctest::Approx(order).epsilon(0.15));
  }
  CHECK(distance(swing(rotor, 8, 0.5, 400), truth) <= 1e-12);
}

TEST_CASE("steps with the exact rotor and without torque are one long one") {
  const ExactRotor<double> rotor = make_rotor(spacecraft<double>());
  const RigidBodyState<double> start{exp(Vector3<double>(0.3, -0.2, 0.5)), Vector3<double>(0.01, 5, 0.01)};
  RigidBodyState<double> once;
  RigidBodyState<double> often;
  const Vector3<double> none(0, 0, 0);
  REQUIRE(integrate_step(rotor, FreeBody<double>{}, composition<double>(2), 0.0, 100.0, none, start, once) ==
          Status::ok);
  REQUIRE(integrate(rotor, FreeBody<double>{}, composition<double>(4), 0.0, 0.1, 1000L, none, start, often,
                    ignore_steps) == Status::ok);
  CHECK(distance(once, often) <= 1e-11);
  CHECK((rotor.angular_momentum(once) - rotor.angular_momentum(start)).norm() <= 1e-14);
  CHECK((rotor.angular_momentum(often) - rotor.angular_momentum(start)).norm() <= 1e-12);
}

namespace {

struct Composed {
  template <typename Scalar>
  static Composition<Scalar> method(int order) {
    return composition<Scalar>(order);
  }
};

struct Split {
  template <typename Scalar>
  static Splitting<Scalar> method(int order) {
    Splitting<Scalar> result;
    REQUIRE(splitting_of_order(order, result) == Status::ok);
    return result;
  }
};

}  // namespace

TEST_CASE_TEMPLATE("the linearization with the exact rotor is that of dual numbers and symplectic", Kind, Composed,
                   Split) {
  using D = Dual<9>;
  Random random(41);
  for (const int order : {2, 4}) {
    const RigidBody<double> body = make_body(random_inertia(random));
    const ExactRotor<double> rotor = make_rotor(body);
    UniformGravity<double> gravity;
    REQUIRE(UniformGravity<double>::make(0.8, 2, random.normal_matrix<3>(), gravity) == Status::ok);
    const RigidBodyState<double> start{random.rotation(), random.normal_matrix<3>()};
    const Vector3<double> control = order == 2 ? Vector3<double>(0, 0, 0) : random.normal_matrix<3>();
    RigidBodyState<double> end;
    FlowLinearization<double> linearization;
    REQUIRE(integrate_linearized(rotor, gravity, Kind::template method<double>(order), 0.3, 0.1, 5L, control, start,
                                 end, linearization) == Status::ok);
    const RigidBodyState<D> dual_start{start.attitude.cast<D>() * exp(variables<9>(Vector3<double>(0, 0, 0), 0)),
                                       variables<9>(start.angular_velocity, 3)};
    RigidBodyState<D> dual_end;
    REQUIRE(integrate(rotor.cast<D>(), gravity.cast<D>(), Kind::template method<D>(order), D(0.3), D(0.1), 5L,
                      variables<9>(control, 6), dual_start, dual_end, ignore_steps) == Status::ok);
    CHECK((values(dual_end.attitude) - end.attitude).norm() <= 1e-13);
    Vector6<D> error;
    error << vee(Matrix3<D>(end.attitude.transpose().cast<D>() * dual_end.attitude)), dual_end.angular_velocity;
    const Matrix<double, 6, 9> exact = jacobian(error);
    Matrix<double, 6, 9> found;
    found << linearization.state, linearization.control;
    CHECK((found - exact).norm() <= 1e-12 * exact.norm());
    CHECK(linearization.state.determinant() == doctest::Approx(1).epsilon(1e-11));
    if (order == 2) {
      // Aᵀ Ω(π⁺) A = Ω(π) in momentum coordinates.
      const auto form = [](const Vector3<double>& momentum) {
        Matrix6<double> result = Matrix6<double>::Zero();
        result.topLeftCorner<3, 3>() = -hat(momentum);
        result.topRightCorner<3, 3>().setIdentity();
        result.bottomLeftCorner<3, 3>() = -Matrix3<double>::Identity();
        return result;
      };
      Matrix6<double> scale = Matrix6<double>::Identity();
      scale.bottomRightCorner<3, 3>() = body.inertia();
      const Matrix6<double> a = scale * linearization.state * scale.inverse();
      const Matrix6<double> carried = a.transpose() * form(body.inertia() * end.angular_velocity) * a;
      CHECK((carried - form(body.inertia() * start.angular_velocity)).norm() <= 1e-12 * a.squaredNorm());
    }
  }
}

TEST_CASE("a pack of exact rotors moves as each would alone") {
  const ExactRotor<double> rotor = make_rotor(skewed_body<double>());
  Random random(42);
  std::array<Matrix3<double>, pack_size> attitudes;
  std::array<Vector3<double>, pack_size> rates;
  for (std::size_t lane = 0; lane < pack_size; ++lane) {
    attitudes[lane] = random.rotation();
    rates[lane] = random.log_uniform(1e-3, 100) * random.unit_vector<3>();  // some are halved, others not
  }
  const Vector3<double> control(0.1, 0.2, -0.1);
  const RigidBodyState<Lanes> start{pack(attitudes), pack(rates)};
  RigidBodyState<Lanes> end;
  FlowLinearization<Lanes> linearization;
  REQUIRE(integrate_linearized(rotor.cast<Lanes>(), FreeBody<Lanes>{}, composition<Lanes>(2), Lanes(0.3), Lanes(0.1),
                               3L, Vector3<Lanes>(control.cast<Lanes>()), start, end, linearization) == Status::ok);
  for (std::size_t lane = 0; lane < pack_size; ++lane) {
    RigidBodyState<double> alone;
    FlowLinearization<double> expected;
    REQUIRE(integrate_linearized(rotor, FreeBody<double>{}, composition<double>(2), 0.3, 0.1, 3L, control,
                                 RigidBodyState<double>{attitudes[lane], rates[lane]}, alone, expected) == Status::ok);
    const double turn = 1 + 0.3 * rates[lane].norm();
    CHECK((lane_of(end.attitude, lane) - alone.attitude).norm() <= 1e-14 * turn);
    CHECK((lane_of(end.angular_velocity, lane) - alone.angular_velocity).norm() <= 1e-14 * turn * rates[lane].norm());
    CHECK((lane_of(linearization.state, lane) - expected.state).norm() <= 1e-13 * turn * expected.state.norm());
    CHECK((lane_of(linearization.control, lane) - expected.control).norm() <= 1e-13 * turn * expected.state.norm());
  }
}
