#include <doctest/doctest.h>

#include <elliptude/dynamics/integrator.hpp>
#include <limits>
#include <vector>

#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

constexpr double right_angle = 1.5707963267948966;
const auto ignore_steps = [](long, const auto&) {};

template <typename Scalar>
Composition<Scalar> composition(int order) {
  Composition<Scalar> result;
  REQUIRE(composition_of_order(order, result) == Status::ok);
  return result;
}

/// h S(a) − (F J_d − J_d Fᵀ), in long double.
double residual(const RigidBody<double>& body, double h, const Vector3<double>& a, const Matrix3<double>& f) {
  using Exact = Matrix3<long double>;
  const Exact fjd = f.cast<long double>() * body.nonstandard_inertia().cast<long double>();
  const Exact left = static_cast<long double>(h) * hat(Vector3<long double>(a.cast<long double>()));
  return static_cast<double>(Exact(left - (fjd - fjd.transpose())).norm());
}

double turn_of(const Matrix3<double>& f) { return log(f).norm(); }

double orthogonality(const Matrix3<double>& f) { return (f.transpose() * f - Matrix3<double>::Identity()).norm(); }

}  // namespace

TEST_CASE("the turn of a step solves the implicit equation to rounding") {
  Random random(1);
  for (int sample = 0; sample < 2000; ++sample) {
    const RigidBody<double> body = make_body(random_inertia(random));
    const double h = (sample % 2 == 0 ? 1 : -1) * random.log_uniform(1e-6, 10);
    // Turns up to 0.6 rad: where every body has a solution.
    const Vector3<double> a = body.inertia() * (random.log_uniform(1e-8, 0.3) / h * random.unit_vector<3>());
    Matrix3<double> f;
    REQUIRE(relative_attitude(body, h, a, f) == Status::ok);
    CHECK(orthogonality(f) <= 1e-15);
    CHECK(f.determinant() > 0);
    // Beside the rounding of F itself, of which F J_d holds about an epsilon.
    CHECK(residual(body, h, a, f) <= 4e-16 * body.inertia().norm());
  }
}

TEST_CASE("the Cayley and the exponential form agree to rounding up to turns near a right angle") {
  Random random(2);
  int compared = 0;
  for (int sample = 0; sample < 5000; ++sample) {
    const RigidBody<double> body = make_body(random_inertia(random));
    const double h = random.log_uniform(1e-3, 1);
    const Vector3<double> a = body.inertia() * (random.uniform(0, 1) / h * random.unit_vector<3>());
    Matrix3<double> cayley_form;
    Matrix3<double> exponential_form;
    if (relative_attitude(body, h, a, cayley_form) != Status::ok || turn_of(cayley_form) > 1.2) {
      continue;  // near the fold at a right angle the solution itself magnifies rounding
    }
    ++compared;
    REQUIRE(relative_attitude_exponential(body, h, a, exponential_form) == Status::ok);
    // Newton's matrix multiplies rounding by its condition, at most that of J times 1 / cos(turn).
    const double condition = body.principal_moments()(0) / body.principal_moments()(2);
    CHECK((cayley_form - exponential_form).norm() <= 4e-15 * condition);
  }
  CHECK(compared >= 4000);
}

TEST_CASE("a spin about a principal axis has a solution up to h times the rate of one") {
  for (const RigidBody<double>& body : {spacecraft<double>(), pendulum_body<double>(), skewed_body<double>()}) {
    SymmetricEigen<double, 3> axes;
    REQUIRE(symmetric_eigen(body.inertia(), axes) == Status::ok);
    for (int axis = 0; axis < 3; ++axis) {
      for (const double h : {0.01, 0.5, -0.5}) {
        for (const double sign : {1.0, -1.0}) {
          CAPTURE(axis);
          CAPTURE(h);
          const Vector3<double> direction = sign * axes.vectors.col(axis);
          const auto spin = [&](double turn) { return Vector3<double>(body.inertia() * (turn / h * direction)); };
          Matrix3<double> f;
          REQUIRE(relative_attitude(body, h, spin(0.99), f) == Status::ok);
          // The turn of a principal spin is asin(h ω) exactly.
          CHECK((log(f) - std::asin(0.99) * direction).norm() <= 1e-13);
          REQUIRE(relative_attitude_exponential(body, h, spin(0.99), f) == Status::ok);
          CHECK((log(f) - std::asin(0.99) * direction).norm() <= 1e-13);
          const Matrix3<double> before = f;
          CHECK(relative_attitude(body, h, spin(1.01), f) == Status::step_too_long);
          CHECK(relative_attitude_exponential(body, h, spin(1.01), f) == Status::step_too_long);
          CHECK(relative_attitude(body, h, spin(100.0), f) == Status::step_too_long);
          CHECK(relative_attitude_exponential(body, h, spin(100.0), f) == Status::step_too_long);
          CHECK(f == before);
        }
      }
    }
  }
}

namespace {

/// The branch of small steps, followed in small steps of the load from nothing to h a.
struct Branch {
  double share;  ///< of the load up to which it could be followed: it ends where its Newton matrix becomes singular
  Vector3<double> c;  ///< Gibbs vector of F there
};

Branch follow_branch(const Matrix3<double>& inertia, const Vector3<double>& load) {
  constexpr int parts = 200;
  Branch branch{0, Vector3<double>::Zero()};
  for (int part = 1; part <= parts; ++part) {
    const double share = static_cast<double>(part) / parts;
    const Vector3<double> ha = share * load;
    Vector3<double> c = branch.c;
    double change = 1;
    for (int step = 0; step < 10 && change > 1e-12; ++step) {
      const Matrix3<double> newton =
          hat(ha) + ha.dot(c) * Matrix3<double>::Identity() + c * ha.transpose() - 2 * inertia;
      if (!(newton.determinant() < 0)) {
        return branch;
      }
      const Vector3<double> correction = newton.inverse() * (2 * inertia * c - ha - ha.cross(c) - c.dot(ha) * c);
      c += correction;
      change = correction.norm();
    }
    if (change > 1e-12) {
      return branch;
    }
    branch = {share, c};
  }
  return branch;
}

}  // namespace

TEST_CASE("a long step gives the solution on the branch of small steps or a status and never another matrix") {
  Random random(3);
  int right = 0;
  int refused = 0;
  for (int sample = 0; sample < 3000; ++sample) {
    const RigidBody<double> body = make_body(random_inertia(random));
    const double h = random.log_uniform(1e-3, 10);
    const Vector3<double> a = body.inertia() * (random.uniform(0.5, 2) / h * random.unit_vector<3>());
    const Branch branch = follow_branch(body.inertia(), h * a);
    // Near its end the follower cannot tell what exists, nor rounding at a right angle.
    const bool ends_before = branch.share < 0.98 || (branch.share == 1 && branch.c.norm() > 1.001);
    const bool exists = branch.share == 1 && branch.c.norm() < 0.999;
    const Matrix3<double> before = random.rotation();
    Matrix3<double> f = before;
    const Status status = relative_attitude(body, h, a, f);
    if (status == Status::ok) {
      REQUIRE(!ends_before);
      REQUIRE(turn_of(f) < right_angle);
      REQUIRE(orthogonality(f) <= 1e-14);
      REQUIRE(residual(body, h, a, f) <= 1e-14 * (body.inertia().norm() + (h * a).norm()));
      if (exists) {
        REQUIRE((f - cayley(branch.c)).norm() <= 1e-9);
        ++right;
      }
    } else {
      REQUIRE(status == Status::step_too_long);
      REQUIRE(!exists);  // it is not refused without need
      REQUIRE(f == before);
      ++refused;
    }
    Matrix3<double> g = before;
    if (relative_attitude_exponential(body, h, a, g) == Status::ok) {
      REQUIRE(!ends_before);
      REQUIRE((g - f).norm() <= 1e-6);  // near the end of the branch rounding is magnified
    } else {
      REQUIRE(!exists);
      REQUIRE(g == before);
    }
  }
  CHECK(right >= 900);
  CHECK(refused >= 900);
}

namespace {

/// Whether turning the rate round at the end and integrating the motion that runs backwards leads to the start.
template <typename Forward, typename Backward>
double way_back(const RigidBody<double>& body, const Forward& forward, const Backward& backward, int order, double h,
                long steps, const RigidBodyState<double>& start) {
  RigidBodyState<double> end;
  REQUIRE(integrate(body, forward, composition<double>(order), 0.3, h, steps, Vector3<double>(0.02, -0.01, 0.03), start,
                    end, ignore_steps) == Status::ok);
  REQUIRE((end.attitude - start.attitude).norm() > 0.1);
  end.angular_velocity = -end.angular_velocity;
  RigidBodyState<double> back;
  REQUIRE(integrate(body, backward, composition<double>(order), 0.0, h, steps, Vector3<double>(0.02, -0.01, 0.03), end,
                    back, ignore_steps) == Status::ok);
  return (back.attitude - start.attitude).norm() + (back.angular_velocity + start.angular_velocity).norm();
}

}  // namespace

TEST_CASE("a motion that is turned round runs back to where it came from") {
  const RigidBody<double> body = skewed_body<double>();
  const RigidBodyState<double> start = make_state<double>({0.4L, -0.8L, 0.3L}, {0.5L, -0.3L, 0.4L});
  const double h = 0.02;
  const long steps = 100;
  const double rate = 0.9;
  const Matrix3<double> orbit = tilted_orbit<double>();
  // The orbit seen backwards: from the last radial direction on, the other way round.
  const double last = rate * (0.3 + h * static_cast<double>(steps));
  Matrix3<double> reversed;
  reversed.col(0) = std::cos(last) * orbit.col(0) + std::sin(last) * orbit.col(1);
  reversed.col(1) = std::sin(last) * orbit.col(0) - std::cos(last) * orbit.col(1);
  reversed.col(2) = -orbit.col(2);
  const auto forward = gravity_gradient(body, rate, orbit);
  const auto backward = gravity_gradient(body, rate, reversed);
  for (const int order : {2, 4, 6, 8}) {
    CAPTURE(order);
    CHECK(way_back(body, FreeBody<double>{}, FreeBody<double>{}, order, h, steps, start) <= 1e-12);
    CHECK(way_back(body, pendulum_gravity<double>(), pendulum_gravity<double>(), order, h, steps, start) <= 1e-12);
    CHECK(way_back(body, forward, backward, order, h, steps, start) <= 1e-12);
  }
}

TEST_CASE("many steps in one call are the same steps one by one") {
  const RigidBody<double> body = skewed_body<double>();
  const auto potential = gravity_gradient(body, 0.9, tilted_orbit<double>());
  const Vector3<double> control(0.1, -0.2, 0.05);
  const double h = 0.03125;  // exact, so that the times are the same
  for (const int order : {2, 4}) {
    std::vector<RigidBodyState<double>> visited;
    RigidBodyState<double> end;
    RigidBodyState<double> state = orbit_state<double>();
    REQUIRE(integrate(body, potential, composition<double>(order), 1.0, h, 20L, control, state, end,
                      [&visited](long step, const RigidBodyState<double>& at) {
                        visited.push_back(at);
                        CHECK(step == static_cast<long>(visited.size()));
                      }) == Status::ok);
    REQUIRE(visited.size() == 20);
    for (std::size_t k = 0; k < visited.size(); ++k) {
      REQUIRE(integrate_step(body, potential, composition<double>(order), 1.0 + h * static_cast<double>(k), h, control,
                             state, state) == Status::ok);
      CHECK((state.attitude - visited[k].attitude).norm() <= 1e-14);
      CHECK((state.angular_velocity - visited[k].angular_velocity).norm() <= 2e-14);
    }
    CHECK(end.attitude == visited.back().attitude);
    CHECK(end.angular_velocity == visited.back().angular_velocity);
  }
}

TEST_CASE("no steps leave the state as it is") {
  const RigidBodyState<double> start = orbit_state<double>();
  RigidBodyState<double> end;
  REQUIRE(integrate(spacecraft<double>(), FreeBody<double>{}, composition<double>(2), 0.0, 0.1, 0L,
                    Vector3<double>(0, 0, 0), start, end, ignore_steps) == Status::ok);
  CHECK(end.attitude == start.attitude);
  CHECK(end.angular_velocity == start.angular_velocity);
}

namespace {

/// Works until a given time, then says what it is told to.
struct FailingPotential {
  double last_time;
  double answer;

  double energy(const Matrix3<double>&, const double&) const { return 0; }
  Vector3<double> torque(const Matrix3<double>&, const double& time) const {
    return Vector3<double>(0, time > last_time ? answer : 0.0, 0);
  }
  Matrix3<double> torque_jacobian(const Matrix3<double>&, const double&) const { return Matrix3<double>::Zero(); }
};

struct Attempt {
  RigidBodyState<double> state = orbit_state<double>();
  double time = 0;
  double h = 0.05;
  long steps = 10;
  Vector3<double> control = Vector3<double>::Zero();

  /// The status, after a check that a failure leaves the output alone.
  template <typename Potential>
  Status status(const Potential& potential) const {
    const RigidBodyState<double> before = free_state<double>();
    RigidBodyState<double> next = before;
    const Status result = integrate(spacecraft<double>(), potential, composition<double>(4), time, h, steps, control,
                                    state, next, ignore_steps);
    const bool unchanged = next.attitude == before.attitude && next.angular_velocity == before.angular_velocity;
    CHECK(unchanged == (result != Status::ok));
    return result;
  }
};

}  // namespace

TEST_CASE("a step from what is not a state has a status that says why and leaves the output alone") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const FreeBody<double> free;
  CHECK(Attempt{}.status(free) == Status::ok);
  for (const double bad : {nan, infinity, -infinity}) {
    Attempt attempt;
    attempt.state.attitude(1, 2) = bad;
    CHECK(attempt.status(free) == Status::not_finite);
    attempt = Attempt{};
    attempt.state.angular_velocity(1) = bad;
    CHECK(attempt.status(free) == Status::not_finite);
    attempt = Attempt{};
    attempt.control(2) = bad;
    CHECK(attempt.status(free) == Status::not_finite);
    attempt = Attempt{};
    attempt.h = bad;
    CHECK(attempt.status(free) == Status::not_finite);
    attempt = Attempt{};
    attempt.time = bad;
    CHECK(attempt.status(free) == Status::not_finite);
  }
  for (const double bad : {0.0, -0.05}) {
    Attempt attempt;
    attempt.h = bad;
    CHECK(attempt.status(free) == Status::out_of_range);
  }
  const Matrix3<double> rotation = orbit_state<double>().attitude;
  for (const Matrix3<double>& bad :
       {Matrix3<double>(-rotation), Matrix3<double>(1.0001 * rotation), Matrix3<double>(Matrix3<double>::Zero()),
        Matrix3<double>(Matrix3<double>::Ones())}) {
    Attempt attempt;
    attempt.state.attitude = bad;
    CHECK(attempt.status(free) == Status::not_a_rotation);
  }
}

TEST_CASE("a step too long is refused also within a composition and after steps that went well") {
  Attempt attempt;
  attempt.h = 1;
  CHECK(attempt.status(FreeBody<double>{}) == Status::step_too_long);
  // The largest stage of order 4 is 0.658 h: a spin about a principal axis may have h|w| up to 1.52.
  attempt.state = make_state<double>({0, 0, 0}, {0, 1, 0});
  attempt.h = 1.51;
  CHECK(attempt.status(FreeBody<double>{}) == Status::ok);
  attempt.h = 1.53;
  CHECK(attempt.status(FreeBody<double>{}) == Status::step_too_long);
  // Spun up by a control torque, it is too fast after some steps only.
  attempt.state = make_state<double>({0, 0, 0}, {0, 0, 0});
  attempt.h = 0.1;
  attempt.control = Vector3<double>(0, 2.8, 0);
  attempt.steps = 100;
  CHECK(attempt.status(FreeBody<double>{}) == Status::ok);
  attempt.steps = 200;
  CHECK(attempt.status(FreeBody<double>{}) == Status::step_too_long);
}

TEST_CASE("a potential that fails at the start or on the way is reported") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, infinity}) {
    CHECK(Attempt{}.status(FailingPotential{-1, bad}) == Status::callback_failed);
    CHECK(Attempt{}.status(FailingPotential{0.26, bad}) == Status::callback_failed);
    CHECK(Attempt{}.status(FailingPotential{0.49, bad}) == Status::callback_failed);
    CHECK(Attempt{}.status(FailingPotential{0.6, bad}) == Status::ok);
  }
}

TEST_CASE("single precision integrates to its own rounding") {
  RigidBodyState<float> small = orbit_state<float>();
  RigidBodyState<double> large = orbit_state<double>();
  const RigidBody<float> body = skewed_body<float>();
  REQUIRE(integrate(body, gravity_gradient(body, 0.9F, tilted_orbit<float>()), composition<float>(4), 0.0F, 0.02F, 50L,
                    Vector3<float>(0, 0, 0), small, small, ignore_steps) == Status::ok);
  const RigidBody<double> same = skewed_body<double>();
  REQUIRE(integrate(same, gravity_gradient(same, 0.9, tilted_orbit<double>()), composition<double>(4), 0.0, 0.02, 50L,
                    Vector3<double>(0, 0, 0), large, large, ignore_steps) == Status::ok);
  CHECK((small.attitude.cast<double>() - large.attitude).norm() <= 2e-5);
  CHECK((small.angular_velocity.cast<double>() - large.angular_velocity).norm() <= 2e-5);
}
