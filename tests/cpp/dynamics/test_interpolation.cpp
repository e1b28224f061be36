// The motion between two steps, against the closed form of a steady spin and an independent integrator.

#include <doctest/doctest.h>

#include <cmath>
#include <elliptude/dynamics/exact_rotor.hpp>
#include <elliptude/dynamics/interpolation.hpp>
#include <limits>
#include <vector>

#include "support/independent_flow.hpp"
#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

const double not_a_number = std::numeric_limits<double>::quiet_NaN();

/// A turn about a fixed axis by the angle α(t) = t + t²/4 + t³/10, which no polynomial in the Gibbs vector is.
struct Turn {
  Vector3<double> axis;
  Matrix3<double> start;

  [[nodiscard]] MovingState<double> at(double t) const {
    return {
        {start * exp(Vector3<double>((t + t * t / 4 + t * t * t / 10) * axis)), (1 + t / 2 + 3 * t * t / 10) * axis},
        (0.5 + 6 * t / 10) * axis};
  }
};

double angle_between(const RigidBodyState<double>& a, const RigidBodyState<double>& b) {
  return log(Matrix3<double>(a.attitude.transpose() * b.attitude)).norm();
}

/// The largest errors of attitude and rate within an interval about t = 0.3, over nine places.
Eigen::Vector2d errors(const Turn& turn, double duration) {
  const double first = 0.3 - duration / 2;
  MotionBetween<double> motion;
  REQUIRE(MotionBetween<double>::make(turn.at(first), turn.at(first + duration), duration, motion) == Status::ok);
  Eigen::Vector2d largest(0, 0);
  for (int i = 1; i < 10; ++i) {
    const RigidBodyState<double> found = motion.at(i / 10.0);
    const RigidBodyState<double> truth = turn.at(first + duration * i / 10.0).state;
    largest(0) = std::max(largest(0), angle_between(truth, found));
    largest(1) = std::max(largest(1), (truth.angular_velocity - found.angular_velocity).norm());
  }
  return largest;
}

}  // namespace

TEST_CASE("the motion between two states has the attitude and rate of both and the sixth order") {
  const Turn turn{Vector3<double>(2, -1, 2) / 3, exp(Vector3<double>(0.4, 2.0, -1.0))};
  MotionBetween<double> motion;
  REQUIRE(MotionBetween<double>::make(turn.at(0), turn.at(0.7), 0.7, motion) == Status::ok);
  for (const double end : {0.0, 1.0}) {
    const RigidBodyState<double> found = motion.at(end);
    CHECK(angle_between(turn.at(0.7 * end).state, found) <= 1e-15);
    CHECK((turn.at(0.7 * end).state.angular_velocity - found.angular_velocity).norm() <= 4e-15);
  }
  const Eigen::Vector2d coarse = errors(turn, 0.4);
  const Eigen::Vector2d fine = errors(turn, 0.2);
  CHECK(coarse(0) <= 1e-5);
  CHECK(std::log2(coarse(0) / fine(0)) == doctest::Approx(6).epsilon(0.05));
  CHECK(std::log2(coarse(1) / fine(1)) == doctest::Approx(5).epsilon(0.06));
}

TEST_CASE("the rate between two states is that of the attitude there, where the axis moves") {
  const ExactRotor<double> rotor = [] {
    ExactRotor<double> result;
    REQUIRE(ExactRotor<double>::make(skewed_body<double>(), result) == Status::ok);
    return result;
  }();
  const RigidBodyState<double> start{exp(Vector3<double>(0.3, -0.2, 0.5)), Vector3<double>(2, -1, 1.5)};
  Composition<double> once;
  REQUIRE(composition_of_order(2, once) == Status::ok);
  std::vector<MovingState<double>> ends;
  Stage<double> last;
  const Vector3<double> none(0, 0, 0);
  REQUIRE(integrate_stages(rotor, FreeBody<double>{}, once, 0.0, 0.2, 1L, none, start, last,
                           [&](long, const Stage<double>& stage) {
                             ends.push_back(MovingState<double>::after(rotor, stage, none));
                           }) == Status::ok);
  REQUIRE(ends.size() == 2);
  MotionBetween<double> motion;
  REQUIRE(MotionBetween<double>::make(ends[0], ends[1], 0.2, motion) == Status::ok);
  const double step = 1e-4;
  const auto difference = [&](double share) {
    const Vector3<double> turn =
        log(Matrix3<double>(motion.at(share - step).attitude.transpose() * motion.at(share + step).attitude));
    return Vector3<double>(turn / (2 * step * 0.2));
  };
  for (const double share : {0.2, 0.5, 0.9}) {
    CHECK((difference(share) - motion.at(share).angular_velocity).norm() <= 1e-7);
    RigidBodyState<double> truth;
    REQUIRE(integrate_step(rotor, FreeBody<double>{}, once, 0.0, 0.2 * share, none, start, truth) == Status::ok);
    CHECK(angle_between(truth, motion.at(share)) <= 2e-6);
    CHECK((truth.angular_velocity - motion.at(share).angular_velocity).norm() <= 1e-4);
  }
  // The accelerations are the derivatives of the rate.
  for (const double share : {0.0, 1.0}) {
    const Vector3<double> slope =
        (motion.at(share + step).angular_velocity - motion.at(share - step).angular_velocity) / (2 * step * 0.2);
    CHECK((slope - ends[share > 0.5 ? 1 : 0].acceleration).norm() <= 1e-4);
  }
}

namespace {

struct Swing {
  ExactRotor<double> rotor;
  Splitting<double> splitting;
  Vector3<double> control{0.02, -0.01, 0.03};

  explicit Swing(int order) {
    REQUIRE(ExactRotor<double>::make(pendulum_body<double>(), rotor) == Status::ok);
    REQUIRE(splitting_of_order(order, splitting) == Status::ok);
  }
  template <typename Visit>
  Status run(const std::vector<double>& times, double h, long steps, RigidBodyState<double>& end,
             const Visit& visit) const {
    return integrate_to_times(rotor, pendulum_gravity<double>(), splitting, 0.5, h, steps, control,
                              pendulum_state<double>(), times, end, visit);
  }
};

}  // namespace

TEST_CASE("the states at any times are those of an independent integrator there") {
  const Swing swing(6);
  const RealMatrix inertia = pendulum_body<double>().inertia().cast<Real>();
  const RealVector control = swing.control.cast<Real>();
  const auto torque = [&](const RealMatrix& c, Real) {
    return RealVector(RealVector(0, 0, 9.81L * 0.3L).cross(RealVector(c.transpose() * RealVector(0, 0, 1))) + control);
  };
  const std::vector<double> times{0.5, 0.5, 0.513, 0.55, 0.5667, 0.6201, 0.7999, 0.8};
  RigidBodyState<double> end;
  std::size_t rows = 0;
  REQUIRE(swing.run(times, 0.02, 15, end, [&](std::size_t row, const RigidBodyState<double>& found) {
    CHECK(row == rows);
    ++rows;
    const RigidBodyState<double> start = pendulum_state<double>();
    const Motion truth =
        independent_flow(inertia, torque, {start.attitude.cast<Real>(), start.angular_velocity.cast<Real>()}, 0,
                         static_cast<Real>(times[row]) - 0.5L + 1e-30L, 10);
    CAPTURE(row);
    CHECK(static_cast<double>((truth.attitude - found.attitude.cast<Real>()).norm()) <= 2e-9);
    CHECK(static_cast<double>((truth.angular_velocity - found.angular_velocity.cast<Real>()).norm()) <= 5e-7);
  }) == Status::ok);
  CHECK(rows == times.size());
}

TEST_CASE("a time at a step, or off it by rounding, has the bits of that step") {
  const Swing swing(4);
  std::vector<RigidBodyState<double>> steps;
  RigidBodyState<double> end;
  REQUIRE(integrate(swing.rotor, pendulum_gravity<double>(), swing.splitting, 0.5, 0.1, 7L, swing.control,
                    pendulum_state<double>(), end,
                    [&](long, const RigidBodyState<double>& state) { steps.push_back(state); }) == Status::ok);
  std::vector<double> times;
  for (int k = 1; k <= 7; ++k) {
    times.push_back(k / 10.0 + 0.5);
  }
  times.back() = std::nextafter(times.back(), 2.0);
  RigidBodyState<double> other;
  std::size_t rows = 0;
  REQUIRE(swing.run(times, 0.1, 7, other, [&](std::size_t row, const RigidBodyState<double>& found) {
    ++rows;
    CHECK(found.attitude == steps[row].attitude);
    CHECK(found.angular_velocity == steps[row].angular_velocity);
  }) == Status::ok);
  CHECK(rows == 7);
  CHECK(other.attitude == end.attitude);
}

TEST_CASE("times that are not within the steps and steps that turn too far are refused") {
  const Swing swing(4);
  const RigidBodyState<double> before{Matrix3<double>::Constant(7), Vector3<double>(7, 7, 7)};
  const auto refused = [&](const std::vector<double>& times, double h, long steps, Status wanted) {
    RigidBodyState<double> end = before;
    CHECK(swing.run(times, h, steps, end, [](std::size_t, const RigidBodyState<double>&) {}) == wanted);
    CHECK(end.attitude == before.attitude);
    CHECK(end.angular_velocity == before.angular_velocity);
  };
  refused({0.6, 0.55}, 0.1, 2, Status::out_of_range);
  refused({0.49}, 0.1, 2, Status::out_of_range);
  refused({0.6, 0.71}, 0.1, 2, Status::out_of_range);
  refused({not_a_number}, 0.1, 2, Status::out_of_range);
  refused({0.55, not_a_number}, 0.1, 2, Status::out_of_range);
  refused({0.6}, -0.1, 2, Status::out_of_range);
  refused({0.6}, not_a_number, 2, Status::out_of_range);
  refused({2.0}, 3.0, 1, Status::step_too_long);  // the pendulum turns round in this time

  // A long step is right where no time lies within it.
  RigidBodyState<double> end;
  CHECK(swing.run({3.5}, 3.0, 1, end, [](std::size_t, const RigidBodyState<double>&) {}) == Status::ok);
  CHECK(swing.run({}, 3.0, 1, end, [](std::size_t, const RigidBodyState<double>&) {}) == Status::ok);

  MotionBetween<double> motion;
  const Turn turn{Vector3<double>(0, 0, 1), Matrix3<double>::Identity()};
  CHECK(MotionBetween<double>::make(turn.at(0), turn.at(0.1), 1.6, motion) == Status::step_too_long);
  CHECK(MotionBetween<double>::make(turn.at(0), turn.at(1), 1.3, motion) == Status::step_too_long);
  CHECK(MotionBetween<double>::make(turn.at(0), turn.at(1), not_a_number, motion) == Status::not_finite);
}
