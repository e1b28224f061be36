// The order of the integrator, against a converged solution of the differential equations from an independent integrator.

#include <doctest/doctest.h>

#include <cmath>
#include <elliptude/dynamics/exact_rotor.hpp>
#include <elliptude/dynamics/integrator.hpp>

#include "support/independent_flow.hpp"
#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

/// A motion with the torque written out once more, so that the library's potential takes no part in the reference.
template <typename Scalar, typename Potential>
struct Case {
  RigidBody<Scalar> body;
  Potential potential;
  RealTorque torque;  ///< of the potential and the control together
  RigidBodyState<Scalar> start;
  Scalar time;
  Scalar duration;
  Vector3<Scalar> control;
};

template <typename Scalar>
Motion to_motion(const RigidBodyState<Scalar>& state) {
  return {state.attitude.template cast<Real>(), state.angular_velocity.template cast<Real>()};
}

template <typename Scalar, typename Potential>
Motion reference(const Case<Scalar, Potential>& example, int intervals) {
  return independent_flow(example.body.inertia().template cast<Real>(), example.torque, to_motion(example.start),
                          static_cast<Real>(example.time), static_cast<Real>(example.duration), intervals);
}

/// The variational step, composed.
struct Variational {
  template <typename Scalar>
  static RigidBody<Scalar> body(const RigidBody<Scalar>& body) {
    return body;
  }
  template <typename Scalar>
  static Composition<Scalar> method(int order) {
    Composition<Scalar> composition;
    REQUIRE(composition_of_order(order, composition) == Status::ok);
    return composition;
  }
};

/// Kicks and turns of the exact rotor.
struct Exact {
  template <typename Scalar>
  static ExactRotor<Scalar> body(const RigidBody<Scalar>& body) {
    ExactRotor<Scalar> rotor;
    REQUIRE(ExactRotor<Scalar>::make(body, rotor) == Status::ok);
    return rotor;
  }
  template <typename Scalar>
  static Splitting<Scalar> method(int order) {
    Splitting<Scalar> splitting;
    REQUIRE(splitting_of_order(order, splitting) == Status::ok);
    return splitting;
  }
};

/// How far `steps` steps end from the reference.
template <typename Kind, typename Scalar, typename Potential>
Real error(const Case<Scalar, Potential>& example, const Motion& exact, int order, long steps) {
  RigidBodyState<Scalar> end = example.start;
  REQUIRE(integrate(Kind::body(example.body), example.potential, Kind::template method<Scalar>(order), example.time,
                    Scalar(example.duration / static_cast<Scalar>(steps)), steps, example.control, example.start, end,
                    [](long, const RigidBodyState<Scalar>&) {}) == Status::ok);
  return distance(exact, to_motion(end));
}

Real observed_order(Real coarse, Real fine) { return std::log2(coarse / fine); }

/// \param steps for order 8; the lower orders take twice as many for each order less, so that all their errors are of a
///        size at which neither the next order of the error nor rounding is seen.
template <typename Kind = Variational, typename Scalar, typename Potential>
void check_orders(const Case<Scalar, Potential>& example, long steps) {
  const Motion exact = reference(example, 40);
  REQUIRE(distance(exact, reference(example, 80)) <= 1e-14L);
  const auto orders_of = [&](int order, long first) {
    CAPTURE(order);
    const Real coarse = error<Kind>(example, exact, order, first);
    const Real middle = error<Kind>(example, exact, order, 2 * first);
    const Real fine = error<Kind>(example, exact, order, 4 * first);
    const Real first_order = observed_order(coarse, middle);
    const Real second_order = observed_order(middle, fine);
    MESSAGE("order " << order << ": observed " << static_cast<double>(first_order) << " and "
                     << static_cast<double>(second_order) << " / error " << static_cast<double>(fine));
    const Real wanted = order == 2 ? 1.95L : order == 4 ? 3.9L : order == 6 ? 5.8L : 7.8L;
    CHECK(first_order >= wanted);
    CHECK(second_order >= wanted);
    CHECK(second_order <= order + 0.2L);  // more would not be the order but a coincidence
  };
  // In double, rounding hides the higher orders where the errors are as small as those of the splitting.
  constexpr bool is_double = std::is_same_v<Scalar, double>;
  constexpr bool is_splitting = std::is_same_v<Kind, Exact>;
  if constexpr (is_double || is_splitting) {
    orders_of(2, 8 * steps);
    orders_of(4, (is_splitting ? 6 : 4) * steps);
    orders_of(6, 2 * steps);
  }
  if constexpr (!is_double) {
    orders_of(8, steps);
  }
}

template <typename Scalar>
auto free_case() {
  return Case<Scalar, FreeBody<Scalar>>{
      spacecraft<Scalar>(),   {},        [](const RealMatrix&, Real) { return RealVector(0, 0, 0); },
      free_state<Scalar>(),   Scalar(0), Scalar(2),
      Vector3<Scalar>::Zero()};
}

template <typename Scalar>
auto pendulum_case() {
  return Case<Scalar, UniformGravity<Scalar>>{pendulum_body<Scalar>(),
                                              pendulum_gravity<Scalar>(),
                                              [](const RealMatrix& c, Real) {
                                                const RealVector down = c.transpose() * RealVector(0, 0, 1);
                                                return RealVector(RealVector(0, 0, 9.81L * 0.3L).cross(down));
                                              },
                                              pendulum_state<Scalar>(),
                                              Scalar(0),
                                              Scalar(1),
                                              Vector3<Scalar>::Zero()};
}

/// \param control in N m, body axes.
template <typename Scalar>
auto gravity_gradient_case(const Vector3<Scalar>& control) {
  const RigidBody<Scalar> body = skewed_body<Scalar>();
  const RealMatrix inertia = body.inertia().template cast<Real>();
  const RealVector constant = control.template cast<Real>();
  const RealMatrix orbit = tilted_orbit<Scalar>().template cast<Real>();
  return Case<Scalar, GravityGradient<Scalar>>{body,
                                               gravity_gradient(body, Scalar(1), tilted_orbit<Scalar>()),
                                               [inertia, constant, orbit](const RealMatrix& c, Real t) {
                                                 const RealVector b =
                                                     c.transpose() * (orbit * RealVector(std::cos(t), std::sin(t), 0));
                                                 return RealVector(3 * b.cross(RealVector(inertia * b)) + constant);
                                               },
                                               orbit_state<Scalar>(),
                                               Scalar(0.5),
                                               Scalar(2),
                                               control};
}

}  // namespace

TEST_CASE("the independent integrator finds the closed motion of a symmetric top") {
  // In body axes ω turns about the axis of symmetry at the rate (1 − J₃/J₁) ω₃; in reference axes the axis of symmetry turns
  // about the angular momentum at the rate ‖H‖/J₁.
  const RealMatrix inertia = RealVector(2, 2, 1).asDiagonal();
  const RealVector rate(1.2L, 0, 3);
  const Real duration = 5;
  const Motion end = independent_flow(
      inertia, [](const RealMatrix&, Real) { return RealVector(0, 0, 0); }, {RealMatrix::Identity(), rate}, 0, duration,
      40);
  const Real phase = (1 - 0.5L) * 3 * duration;
  const RealVector expected_rate(1.2L * std::cos(phase), -1.2L * std::sin(phase), 3);
  // Some thousand steps of the midpoint rule, each of which rounds at 5e-20 of a rate of three.
  CHECK(static_cast<double>((end.angular_velocity - expected_rate).norm()) <= 1e-15);
  const RealVector momentum = inertia * rate;
  const RealMatrix precession = exp(Vector3<Real>(duration / 2 * momentum));
  const RealMatrix expected = precession * exp(Vector3<Real>(0, 0, phase));
  CHECK(static_cast<double>((end.attitude - expected).norm()) <= 1e-15);
}

TEST_CASE("the orders of a free body are two and four and six and eight") {
  check_orders(free_case<double>(), 20);
  check_orders(free_case<long double>(), 40);
}

TEST_CASE("the orders of a pendulum are two and four and six and eight") {
  check_orders(pendulum_case<double>(), 20);
  check_orders(pendulum_case<long double>(), 20);
}

TEST_CASE("the orders under gravity gradient on a tilted orbit are two and four and six and eight") {
  check_orders(gravity_gradient_case<double>({0, 0, 0}), 10);
  check_orders(gravity_gradient_case<long double>({0, 0, 0}), 15);
}

TEST_CASE("the orders with a control torque in body axes are two and four and six and eight") {
  check_orders(gravity_gradient_case<double>({0.3, -0.2, 0.5}), 10);
  check_orders(gravity_gradient_case<long double>({0.3L, -0.2L, 0.5L}), 15);
}

TEST_CASE("the orders of the splitting with the exact rotor are two and four and six and eight") {
  check_orders<Exact>(pendulum_case<long double>(), 14);
  check_orders<Exact>(gravity_gradient_case<long double>({0.3L, -0.2L, 0.5L}), 15);
}

TEST_CASE("the splitting errs a hundredth of what the composition does with no fewer turns") {
  const auto example = pendulum_case<long double>();
  const Motion exact = reference(example, 40);
  CHECK(error<Exact>(example, exact, 4, 50) <= 0.01L * error<Variational>(example, exact, 4, 60));
  CHECK(error<Exact>(example, exact, 6, 45) <= 0.01L * error<Variational>(example, exact, 6, 55));
}
