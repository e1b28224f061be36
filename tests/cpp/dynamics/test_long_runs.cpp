// A million steps of the scenarios `free`, `pendulum` and `long_orbit`.

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <elliptude/dynamics/integrator.hpp>

#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

#ifdef NDEBUG
constexpr long run_length = 1000000;
#else
constexpr long run_length = 20000;  // not optimised, or with sanitizers, a million steps would take minutes
#endif

/// The slope of a straight line through equidistant values, times their number: how much they rise in all, and the
/// standard error of it.
struct Trend {
  double rise;
  double standard_error;
};

template <std::size_t Count>
Trend trend(const std::array<double, Count>& values) {
  const auto place = [](std::size_t i) { return static_cast<double>(i) - 0.5 * static_cast<double>(Count - 1); };
  const double count = static_cast<double>(Count);
  double mean = 0;
  for (const double value : values) {
    mean += value / count;
  }
  double product = 0;
  double square = 0;
  for (std::size_t i = 0; i < Count; ++i) {
    product += place(i) * (values[i] - mean);
    square += place(i) * place(i);
  }
  const double slope = product / square;
  double rest = 0;
  for (std::size_t i = 0; i < Count; ++i) {
    const double deviation = values[i] - mean - slope * place(i);
    rest += deviation * deviation;
  }
  return {count * slope, count * std::sqrt(rest / (count - 2) / square)};
}

/// What a run says about what should be conserved.
struct Report {
  static constexpr std::size_t blocks = 50;

  double orthogonality = 0;          ///< largest ‖CᵀC − I‖
  double energy = 0;                 ///< largest change of the conserved energy, J
  double initial_energy = 0;         ///< J
  Vector3<double> initial_momentum;  ///< reference axes
  double momentum = 0;               ///< largest change of the angular momentum in reference axes, N m s
  double vertical_momentum = 0;      ///< of its third component alone
  Trend trend;                       ///< of the energy's mean over each of `blocks` parts of the run
};

/// \param orbit_rate n, where the energy that is conserved is Jacobi's integral E − n·H: with a potential that turns at the
///        rate n, ∂U/∂t is the power n·(CM) that the torque does on a body turning with it, and CM = Ḣ. Zero for others.
template <typename Potential>
Report run(const RigidBody<double>& body, const Potential& potential, const RigidBodyState<double>& start, double h,
           int order, const Vector3<double>& orbit_rate) {
  Composition<double> composition;
  REQUIRE(composition_of_order(order, composition) == Status::ok);
  const auto energy = [&](long step, const RigidBodyState<double>& state) {
    return body.kinetic_energy(state.angular_velocity) +
           potential.energy(state.attitude, static_cast<double>(step) * h) -
           orbit_rate.dot(body.angular_momentum(state));
  };
  Report report;
  report.initial_energy = energy(0, start);
  report.initial_momentum = body.angular_momentum(start);
  std::array<double, Report::blocks> means{};
  const auto visit = [&](long step, const RigidBodyState<double>& state) {
    const Matrix3<double> defect = state.attitude.transpose() * state.attitude - Matrix3<double>::Identity();
    report.orthogonality = std::max(report.orthogonality, defect.norm());
    const double change = energy(step, state) - report.initial_energy;
    report.energy = std::max(report.energy, std::abs(change));
    constexpr long length = run_length / static_cast<long>(Report::blocks);
    means[static_cast<std::size_t>((step - 1) / length)] += change / static_cast<double>(length);
    const Vector3<double> momentum = body.angular_momentum(state) - report.initial_momentum;
    report.momentum = std::max(report.momentum, momentum.norm());
    report.vertical_momentum = std::max(report.vertical_momentum, std::abs(momentum.z()));
  };
  RigidBodyState<double> end;
  REQUIRE(integrate(body, potential, composition, 0.0, h, run_length, Vector3<double>(0, 0, 0), start, end, visit) ==
          Status::ok);
  report.trend = trend(means);
  MESSAGE("order " << order << ": |C'C - I| " << report.orthogonality << " / energy "
                   << report.energy / std::abs(report.initial_energy)
                   << " relative = " << report.energy / std::abs(report.initial_energy) / (h * h) << " h^2 / trend "
                   << report.trend.rise << " +- " << report.trend.standard_error << " / momentum "
                   << report.momentum / report.initial_momentum.norm() << " relative / vertical "
                   << report.vertical_momentum);
  return report;
}

Report run_pendulum(int order) {
  return run(pendulum_body<double>(), pendulum_gravity<double>(), pendulum_state<double>(), 0.002, order,
             Vector3<double>(0, 0, 0));
}

Report run_long_orbit(int order) {
  return run(spacecraft<double>(), orbit_gravity(spacecraft<double>()), long_orbit_state<double>(), 0.01, order,
             Vector3<double>(0, 0, 1));
}

/// Six standard errors would be chance once in 1e9 times, were the blocks independent; and what rises within a run must stay
/// small against the oscillation, whatever its error.
void check_no_trend(const Report& report) {
  if (run_length < 1000000) {
    return;  // the parts of a short run are too short to be alike
  }
  CHECK(std::abs(report.trend.rise) <= 6 * report.trend.standard_error);
  CHECK(std::abs(report.trend.rise) <= 0.03 * report.energy);
}

}  // namespace

TEST_CASE("a free body keeps its rotation and momentum and energy to rounding over a million steps") {
  for (const int order : {2, 4}) {
    const Report report =
        run(spacecraft<double>(), FreeBody<double>{}, free_state<double>(), 0.01, order, Vector3<double>(0, 0, 0));
    CHECK(report.orthogonality <= 1e-12);
    CHECK(report.momentum <= 1e-11 * report.initial_momentum.norm());
    // At any kinetic energy: the free rotor of Moser and Veselov conserves it exactly, at any step.
    CHECK(report.energy <= 1e-11 * report.initial_energy);
  }
}

TEST_CASE("the energy of the pendulum oscillates within 32 h^2 and its vertical momentum stays over a million steps") {
  const Report report = run_pendulum(2);
  CHECK(report.energy <= 32 * 0.002 * 0.002 * std::abs(report.initial_energy));
  // The h^2 is there: less than this would mean that something else was integrated.
  CHECK(report.energy >= 10 * 0.002 * 0.002 * std::abs(report.initial_energy));
  CHECK(report.vertical_momentum <= 1e-10);
  CHECK(report.momentum >= 0.1);  // the rest of it is not conserved
  CHECK(report.orthogonality <= 1e-12);
  check_no_trend(report);
}

TEST_CASE("the Jacobi integral of the long orbit oscillates within 1.3 h^2 over a million steps") {
  const Report report = run_long_orbit(2);
  CHECK(report.energy <= 1.3 * 0.01 * 0.01 * std::abs(report.initial_energy));
  CHECK(report.energy >= 0.3 * 0.01 * 0.01 * std::abs(report.initial_energy));
  CHECK(report.orthogonality <= 1e-12);
  check_no_trend(report);
}

TEST_CASE("order four leaves no more than rounding of the drift over a million steps") {
  // The oscillation is below 1e-8, so that a rounding error of the same sign in every step, 1e-16 or so, would be seen.
  const Report pendulum = run_pendulum(4);
  CHECK(pendulum.energy <= 2e-9 * std::abs(pendulum.initial_energy));
  CHECK(std::abs(pendulum.trend.rise) <= 1e-10 * std::abs(pendulum.initial_energy));
  CHECK(pendulum.vertical_momentum <= 1e-11);
  CHECK(pendulum.orthogonality <= 2e-12);
  const Report orbit = run_long_orbit(4);
  CHECK(orbit.energy <= 2e-9 * std::abs(orbit.initial_energy));
  CHECK(std::abs(orbit.trend.rise) <= 1e-10 * std::abs(orbit.initial_energy));
  CHECK(orbit.orthogonality <= 2e-12);
}
