#include <doctest/doctest.h>

#include <elliptude/dynamics/linearization.hpp>
#include <limits>

#include "support/dual.hpp"
#include "support/pack.hpp"
#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

const auto ignore_steps = [](long, const auto&) {};

template <typename Scalar>
Composition<Scalar> composition(int order) {
  Composition<Scalar> result;
  REQUIRE(composition_of_order(order, result) == Status::ok);
  return result;
}

/// Where steps start, how many there are, and the control torque.
struct Flight {
  int order;
  long steps;
  double time;
  double h;
  RigidBodyState<double> start;
  Vector3<double> control;
};

template <typename Potential>
RigidBodyState<double> fly(const RigidBody<double>& body, const Potential& potential, const Flight& flight) {
  RigidBodyState<double> end = flight.start;
  REQUIRE(integrate(body, potential, composition<double>(flight.order), flight.time, flight.h, flight.steps,
                    flight.control, flight.start, end, ignore_steps) == Status::ok);
  return end;
}

template <typename Potential>
FlowLinearization<double> linearize(const RigidBody<double>& body, const Potential& potential, const Flight& flight,
                                    RigidBodyState<double>& end) {
  FlowLinearization<double> result = FlowLinearization<double>::identity();
  REQUIRE(integrate_linearized(body, potential, composition<double>(flight.order), flight.time, flight.h, flight.steps,
                               flight.control, flight.start, end, result) == Status::ok);
  return result;
}

using Both = Eigen::Matrix<double, 6, 9>;  ///< [A B]: by ζ, δω and the control torque

Both both(const FlowLinearization<double>& linearization) {
  Both result;
  result << linearization.state, linearization.control;
  return result;
}

/// The derivative of the end by central differences of step h.
template <typename Potential>
Both differences(const RigidBody<double>& body, const Potential& potential, const Flight& flight, double h) {
  const RigidBodyState<double> center = fly(body, potential, flight);
  const auto end = [&](int index, double change) {
    Flight perturbed = flight;
    if (index < 3) {
      perturbed.start.attitude = flight.start.attitude * exp(Vector3<double>(change * Vector3<double>::Unit(index)));
    } else if (index < 6) {
      perturbed.start.angular_velocity(index - 3) += change;
    } else {
      perturbed.control(index - 6) += change;
    }
    const RigidBodyState<double> state = fly(body, potential, perturbed);
    Vector6<double> error;
    error << log(Matrix3<double>(center.attitude.transpose() * state.attitude)),
        state.angular_velocity - center.angular_velocity;
    return error;
  };
  Both result;
  for (int index = 0; index < 9; ++index) {
    result.col(index) = (end(index, h) - end(index, -h)) / (2 * h);
  }
  return result;
}

/// The same by dual numbers through the whole of the templated step.
template <typename Potential>
Both dual_derivative(const RigidBody<double>& body, const Potential& potential, const Flight& flight) {
  using D = Dual<9>;
  const Vector3<D> zeta = variables<9>(Vector3<double>(0, 0, 0), 0);
  const RigidBodyState<D> start{flight.start.attitude.cast<D>() * exp(zeta),
                                variables<9>(flight.start.angular_velocity, 3)};
  RigidBodyState<D> end;
  REQUIRE(integrate(body.cast<D>(), potential, composition<D>(flight.order), D(flight.time), D(flight.h), flight.steps,
                    variables<9>(flight.control, 6), start, end, ignore_steps) == Status::ok);
  const Matrix3<double> attitude = values(end.attitude);
  Vector6<D> error;
  error << vee(Matrix3<D>(attitude.transpose().cast<D>() * end.attitude)), end.angular_velocity;
  return jacobian(error);
}

/// Calls test(body, potential, the same potential for dual numbers) with each kind of potential and several bodies.
template <typename Test>
void for_each_problem(const Test& test) {
  using D = Dual<9>;
  Random random(11);
  for (int sample = 0; sample < 3; ++sample) {
    const RigidBody<double> body = make_body(random_inertia(random));
    UniformGravity<double> gravity;
    REQUIRE(UniformGravity<double>::make(0.8, 2, random.normal_matrix<3>(), gravity) == Status::ok);
    const GravityGradient<double> gradient = gravity_gradient(body, 0.9, random.rotation());
    {
      INFO("free body");
      test(body, FreeBody<double>{}, FreeBody<D>{});
    }
    {
      INFO("uniform gravity");
      test(body, gravity, gravity.cast<D>());
    }
    {
      INFO("gravity gradient");
      test(body, gradient, gradient.cast<D>());
    }
    {
      INFO("sum");
      test(body, SumPotential(gravity, gradient), SumPotential(gravity.cast<D>(), gradient.cast<D>()));
    }
  }
}

/// Every order, one step and several, from random states.
template <typename Test>
void for_each_flight(const Test& test) {
  Random random(12);
  for (const int order : {2, 4, 6, 8}) {
    CAPTURE(order);
    for (const long steps : {1L, 7L}) {
      CAPTURE(steps);
      test(Flight{order, steps, random.uniform(-3, 3), random.log_uniform(0.01, 0.15),
                  RigidBodyState<double>{random.rotation(), random.normal_matrix<3>()}, random.normal_matrix<3>()});
    }
  }
}

}  // namespace

TEST_CASE("the linearization agrees with central differences for every potential and order and many steps") {
  double worst = 0;
  for_each_problem([&](const auto& body, const auto& potential, const auto&) {
    for_each_flight([&](const Flight& flight) {
      RigidBodyState<double> end = flight.start;
      const Both exact = both(linearize(body, potential, flight, end));
      const double h = 2e-3;
      const Both richardson =
          (16 * (4 * differences(body, potential, flight, h / 4) - differences(body, potential, flight, h / 2)) -
           (4 * differences(body, potential, flight, h / 2) - differences(body, potential, flight, h))) /
          45;
      const double state_error = (exact - richardson).leftCols<6>().norm() / exact.leftCols<6>().norm();
      const double control_error = (exact - richardson).rightCols<3>().norm() / exact.rightCols<3>().norm();
      worst = std::max({worst, state_error, control_error});
      CHECK(state_error <= 1e-8);
      CHECK(control_error <= 1e-8);
    });
  });
  MESSAGE("largest relative difference " << worst);
}

TEST_CASE("the linearization is the automatic derivative of the templated step") {
  double worst = 0;
  for_each_problem([&](const auto& body, const auto& potential, const auto& dual_potential) {
    for_each_flight([&](const Flight& flight) {
      RigidBodyState<double> end = flight.start;
      const Both exact = both(linearize(body, potential, flight, end));
      const Both automatic = dual_derivative(body, dual_potential, flight);
      const double error = (exact - automatic).norm() / exact.norm();
      worst = std::max(worst, error);
      CHECK(error <= 1e-12);
    });
  });
  MESSAGE("largest relative difference " << worst);
}

TEST_CASE("the linearization preserves volume and ends where the integrator ends") {
  double worst = 0;
  for_each_problem([&](const auto& body, const auto& potential, const auto&) {
    for_each_flight([&](const Flight& flight) {
      RigidBodyState<double> end = flight.start;
      const FlowLinearization<double> linearization = linearize(body, potential, flight, end);
      const double error = std::abs(linearization.state.determinant() - 1);
      worst = std::max(worst, error);
      CHECK(error <= 1e-12);
      const RigidBodyState<double> same = fly(body, potential, flight);
      CHECK((end.attitude - same.attitude).norm() <= 1e-14);
      CHECK((end.angular_velocity - same.angular_velocity).norm() <= 1e-14 * (1 + end.angular_velocity.norm()));
    });
  });
  MESSAGE("largest |det A - 1| " << worst);
}

TEST_CASE("the linearization of many steps is the product of those of single steps") {
  const RigidBody<double> body = skewed_body<double>();
  const auto potential = gravity_gradient(body, 0.9, tilted_orbit<double>());
  Flight flight{4, 6, 1.0, 0.0625, orbit_state<double>(), Vector3<double>(0.2, -0.1, 0.3)};
  RigidBodyState<double> end = flight.start;
  const FlowLinearization<double> whole = linearize(body, potential, flight, end);
  FlowLinearization<double> product = FlowLinearization<double>::identity();
  flight.steps = 1;
  for (int step = 0; step < 6; ++step) {
    const FlowLinearization<double> part = linearize(body, potential, flight, flight.start);
    product.control = (part.state * product.control + part.control).eval();
    product.state = (part.state * product.state).eval();
    flight.time += flight.h;
  }
  CHECK((whole.state - product.state).norm() <= 1e-13 * whole.state.norm());
  CHECK((whole.control - product.control).norm() <= 1e-13 * whole.control.norm());
  CHECK((whole.state - Matrix6<double>::Identity()).norm() > 0.1);
}

namespace {

/// The canonical two-form of T*SO(3) in [ζ; δπ], with the momentum π = Jω in body axes. Of the one-form θ = π·ζ on fields that
/// are constant in these coordinates, −dθ(1, 2) = ζ₁·δπ₂ − ζ₂·δπ₁ + π·(ζ₁ × ζ₂): the last term is the bracket of two rotations.
Matrix6<double> two_form(const Vector3<double>& momentum) {
  Matrix6<double> result = Matrix6<double>::Zero();
  result.topLeftCorner<3, 3>() = -hat(momentum);
  result.topRightCorner<3, 3>().setIdentity();
  result.bottomLeftCorner<3, 3>() = -Matrix3<double>::Identity();
  return result;
}

}  // namespace

TEST_CASE("the linearization is symplectic") {
  for_each_problem([&](const auto& body, const auto& potential, const auto&) {
    for_each_flight([&](const Flight& controlled) {
      Flight flight = controlled;
      flight.control.setZero();  // a torque constant in body axes has no potential
      RigidBodyState<double> end = flight.start;
      const Matrix6<double> a = linearize(body, potential, flight, end).state;
      Matrix6<double> to_momentum = Matrix6<double>::Identity();
      to_momentum.bottomRightCorner<3, 3>() = body.inertia();
      const Matrix6<double> flow = to_momentum * a * to_momentum.inverse();
      const Matrix6<double> before = two_form(body.inertia() * flight.start.angular_velocity);
      const Matrix6<double> after = two_form(body.inertia() * end.angular_velocity);
      CHECK((flow.transpose() * after * flow - before).norm() <= 1e-13 * flow.squaredNorm() * (1 + after.norm()));
    });
  });
}

namespace {

/// [A B] as eq. (6.3) has it: half a kick, a turn and half a kick for each stage, of the states that the integrator
/// goes through.
template <typename Potential>
Both stage_by_stage(const RigidBody<double>& body, const Potential& potential, const Flight& flight) {
  Both result = Both::Zero();  // of [ζ; δπ], of ζ, δω and the control at the start
  result.topLeftCorner<3, 3>().setIdentity();
  result.block<3, 3>(3, 3) = body.inertia();
  const Composition<double> stages = composition<double>(flight.order);
  RigidBodyState<double> state = flight.start;
  double time = flight.time;
  const auto kick = [&](double length) {
    const Both before = result;
    result.bottomRows<3>() += length * potential.torque_jacobian(state.attitude, time) * before.topRows<3>();
    result.block<3, 3>(3, 6) += length * Matrix3<double>::Identity();
  };
  for (long step = 0; step < flight.steps; ++step) {
    for (int i = 0; i < stages.stages; ++i) {
      const double length = stages.turn(i) * flight.h;
      kick(length / 2);
      const Vector3<double> a = body.inertia() * state.angular_velocity +
                                length / 2 * (potential.torque(state.attitude, time) + flight.control);
      Matrix3<double> f;
      REQUIRE(relative_attitude(body, length, a, f) == Status::ok);
      const Matrix3<double> fjd = f * body.nonstandard_inertia();
      const Matrix3<double> k = length * f.transpose() * (fjd.trace() * Matrix3<double>::Identity() - fjd).inverse();
      const Vector3<double> carried = f.transpose() * a;
      const Both before = result;
      result.topRows<3>() = f.transpose() * before.topRows<3>() + k * before.bottomRows<3>();
      result.bottomRows<3>() = (f.transpose() + hat(carried) * k) * before.bottomRows<3>();
      state.attitude = (state.attitude * f).eval();
      time += length;
      state.angular_velocity =
          body.inertia_inverse() * (carried + length / 2 * (potential.torque(state.attitude, time) + flight.control));
      kick(length / 2);
    }
  }
  result.bottomRows<3>() = (body.inertia_inverse() * result.bottomRows<3>()).eval();
  return result;
}

}  // namespace

TEST_CASE("the linearization is the product of half kicks and turns") {
  double worst = 0;
  for_each_problem([&](const auto& body, const auto& potential, const auto&) {
    for_each_flight([&](const Flight& flight) {
      RigidBodyState<double> end = flight.start;
      const Both found = both(linearize(body, potential, flight, end));
      const double error = (found - stage_by_stage(body, potential, flight)).norm() / found.norm();
      worst = std::max(worst, error);
      CHECK(error <= 1e-13);
    });
  });
  MESSAGE("largest relative difference " << worst);
}

TEST_CASE("a body without a torque is linearized as one with a torque that is zero") {
  const SumPotential<FreeBody<double>> zero;  // has kicks, which change nothing
  static_assert(has_torque<SumPotential<FreeBody<double>>> && !has_torque<FreeBody<double>>);
  const RigidBody<double> body = skewed_body<double>();
  for_each_flight([&](const Flight& flight) {
    RigidBodyState<double> free_end = flight.start;
    RigidBodyState<double> end = flight.start;
    CHECK(both(linearize(body, FreeBody<double>{}, flight, free_end)) == both(linearize(body, zero, flight, end)));
    CHECK(free_end.attitude == end.attitude);
    CHECK(free_end.angular_velocity == end.angular_velocity);
  });
}

TEST_CASE("no steps are linearized as the identity") {
  const Flight flight{4, 0, 0.3, 0.1, orbit_state<double>(), Vector3<double>(0.2, -0.1, 0.3)};
  RigidBodyState<double> end = flight.start;
  const RigidBody<double> body = skewed_body<double>();
  const FlowLinearization<double> none = linearize(body, FreeBody<double>{}, flight, end);
  CHECK((none.state - Matrix6<double>::Identity()).norm() <= 1e-15);
  CHECK(none.control.isZero(0));
}

TEST_CASE("four bodies in the lanes of a pack are integrated and linearized as each alone") {
  Random random(13);
  const RigidBody<double> body = skewed_body<double>();
  const auto potential = gravity_gradient(body, 0.9, tilted_orbit<double>());
  std::array<Matrix3<double>, pack_size> attitudes;
  std::array<Vector3<double>, pack_size> rates;
  for (std::size_t lane = 0; lane < pack_size; ++lane) {
    attitudes[lane] = random.rotation();
    rates[lane] = random.uniform(0.1, 2) * random.unit_vector<3>();  // some need more iterations than others
  }
  const Vector3<double> control(0.1, 0.2, -0.1);
  const RigidBodyState<Lanes> start{pack(attitudes), pack(rates)};
  for (const int order : {2, 4}) {
    RigidBodyState<Lanes> end = start;
    FlowLinearization<Lanes> linearization;
    REQUIRE(integrate_linearized(body.cast<Lanes>(), potential.cast<Lanes>(), composition<Lanes>(order), Lanes(0.3),
                                 Lanes(0.1), 5L, Vector3<Lanes>(control.cast<Lanes>()), start, end,
                                 linearization) == Status::ok);
    for (std::size_t lane = 0; lane < pack_size; ++lane) {
      const Flight flight{order, 5, 0.3, 0.1, {attitudes[lane], rates[lane]}, control};
      RigidBodyState<double> alone = flight.start;
      const FlowLinearization<double> expected = linearize(body, potential, flight, alone);
      CHECK((lane_of(end.attitude, lane) - alone.attitude).norm() <= 1e-14);
      CHECK((lane_of(end.angular_velocity, lane) - alone.angular_velocity).norm() <= 1e-14);
      CHECK((lane_of(linearization.state, lane) - expected.state).norm() <= 1e-13 * expected.state.norm());
      CHECK((lane_of(linearization.control, lane) - expected.control).norm() <= 1e-13);
    }
  }
  // One lane that turns too fast fails them all.
  RigidBodyState<Lanes> fast = start;
  fast.angular_velocity(0).lanes[2] = 100;
  RigidBodyState<Lanes> untouched = start;
  FlowLinearization<Lanes> linearization;
  CHECK(integrate_linearized(body.cast<Lanes>(), potential.cast<Lanes>(), composition<Lanes>(2), Lanes(0.3), Lanes(0.1),
                             1L, Vector3<Lanes>(control.cast<Lanes>()), fast, untouched,
                             linearization) == Status::step_too_long);
  CHECK(lane_of(untouched.attitude, 0) == attitudes[0]);
}

namespace {

/// Has a torque but no finite Jacobian from a time on.
struct RoughPotential {
  double last_time;

  double energy(const Matrix3<double>&, const double&) const { return 0; }
  Vector3<double> torque(const Matrix3<double>&, const double&) const { return Vector3<double>::Zero(); }
  Matrix3<double> torque_jacobian(const Matrix3<double>&, const double& time) const {
    return Matrix3<double>::Constant(time > last_time ? std::numeric_limits<double>::quiet_NaN() : 0.0);
  }
};

template <typename Potential>
Status status_of(const Potential& potential, const RigidBodyState<double>& start, double h) {
  const RigidBodyState<double> before = free_state<double>();
  RigidBodyState<double> end = before;
  FlowLinearization<double> linearization = FlowLinearization<double>::identity();
  const Status status = integrate_linearized(spacecraft<double>(), potential, composition<double>(4), 0.0, h, 10,
                                             Vector3<double>(0, 0, 0), start, end, linearization);
  const bool unchanged = end.attitude == before.attitude && end.angular_velocity == before.angular_velocity &&
                         linearization.state == Matrix6<double>::Identity() && linearization.control.isZero(0);
  CHECK(unchanged == (status != Status::ok));
  return status;
}

}  // namespace

TEST_CASE("a linearization that fails has a status and leaves the outputs alone") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const RigidBodyState<double> start = orbit_state<double>();
  CHECK(status_of(FreeBody<double>{}, start, 0.05) == Status::ok);
  CHECK(status_of(FreeBody<double>{}, start, 1.0) == Status::step_too_long);
  CHECK(status_of(FreeBody<double>{}, start, 0.0) == Status::out_of_range);
  CHECK(status_of(FreeBody<double>{}, start, nan) == Status::not_finite);
  CHECK(status_of(FreeBody<double>{}, {2 * start.attitude, start.angular_velocity}, 0.05) == Status::not_a_rotation);
  CHECK(status_of(FreeBody<double>{}, {nan * start.attitude, start.angular_velocity}, 0.05) == Status::not_finite);
  CHECK(status_of(RoughPotential{-1}, start, 0.05) == Status::callback_failed);
  CHECK(status_of(RoughPotential{0.26}, start, 0.05) == Status::callback_failed);
  CHECK(status_of(RoughPotential{0.6}, start, 0.05) == Status::ok);
}
