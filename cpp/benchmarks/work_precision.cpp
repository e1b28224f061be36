// What the attitudes of a motion cost: processor time to errors of 1e-3, 1e-6 and 1e-9 rad, of the worst of 1,000
// equally spaced outputs, of the integrators here and of those that a user would take instead. It prints a line for
// each method and motion, with tabs between: the motion, the method, and milliseconds for each error, or a dash where
// none of its settings reaches it.

#include <cmath>
#include <cstdio>
#include <ctime>
#include <elliptude/dynamics/exact_rotor.hpp>
#include <elliptude/dynamics/interpolation.hpp>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#if __has_include(<boost/numeric/odeint.hpp>)
#define ELLIPTUDE_HAS_FEHLBERG 1
#include <boost/numeric/odeint/stepper/controlled_runge_kutta.hpp>
#include <boost/numeric/odeint/stepper/dense_output_runge_kutta.hpp>
#include <boost/numeric/odeint/stepper/generation.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_fehlberg78.hpp>
#endif

#include "peers.hpp"

namespace {

using namespace elliptude;
using operations::composition;
using operations::expect_ok;
using operations::Matrix3d;
using operations::Motion;
using operations::Vector3d;

constexpr long outputs = 1000;
constexpr std::array<double, 3> targets{1e-3, 1e-6, 1e-9};

/// The attitudes at the outputs, each as its method has it.
struct Outputs {
  std::vector<Matrix3d> rotations;
  std::vector<Eigen::Quaterniond> quaternions;

  [[nodiscard]] Matrix3d attitude(std::size_t i) const {
    return rotations.empty() ? quaternions[i].normalized().toRotationMatrix() : rotations[i];
  }
};

/// What a setting gives, or nothing where it is refused.
using Run = std::function<std::optional<Outputs>()>;

/// A method with its settings, from the cheapest on.
struct Method {
  std::string name;
  std::vector<Run> settings;
};

/// Into how many steps the motion is divided.
const std::vector<long> steps_of_settings{50,    75,    100,   125,   167,   200,   250,    300,    375,    500,
                                          667,   750,   1000,  1500,  2000,  3000,  4000,   6000,   8000,   12000,
                                          16000, 24000, 32000, 48000, 64000, 96000, 128000, 192000, 256000, 512000};

std::vector<double> output_times(double duration) {
  std::vector<double> times(outputs);
  for (std::size_t i = 0; i < times.size(); ++i) {
    times[i] = static_cast<double>(i + 1) * duration / static_cast<double>(outputs);
  }
  return times;
}

template <typename Body, typename Stages, typename Potential>
std::optional<Outputs> by_steps(const Body& body, const Motion<Potential>& motion, double duration,
                                const Stages& stages, long steps) {
  Outputs found;
  found.rotations.resize(outputs);
  RigidBodyState<double> last;
  const Status status = integrate_to_times(
      body, motion.potential, stages, 0.0, duration / static_cast<double>(steps), steps, Vector3d(0, 0, 0),
      motion.state, output_times(duration), last,
      [&found](std::size_t i, const RigidBodyState<double>& state) { found.rotations[i] = state.attitude; });
  return status == Status::ok ? std::optional(found) : std::nullopt;
}

template <typename Potential>
Outputs by_runge_kutta(Motion<Potential> motion, double duration, long division) {
  using operations::peers::QuaternionState;
  motion.h = duration / static_cast<double>(outputs * division);
  QuaternionState state{Eigen::Quaterniond(motion.state.attitude), motion.state.angular_velocity};
  Outputs found;
  found.quaternions.reserve(outputs);
  for (long k = 0; k < outputs * division; ++k) {
    state = operations::peers::runge_kutta_step(motion, static_cast<double>(k) * motion.h, state);
    if ((k + 1) % division == 0) {
      found.quaternions.push_back(state.attitude);
    }
  }
  return found;
}

#ifdef ELLIPTUDE_HAS_FEHLBERG

using OdeState = std::array<double, 7>;

template <typename Potential>
auto system_of(const Motion<Potential>& motion) {
  return [&motion](const OdeState& x, OdeState& slope, double time) {
    const auto found = operations::peers::derivative(
        motion, time, {Eigen::Quaterniond(x[0], x[1], x[2], x[3]).normalized(), Vector3d(x[4], x[5], x[6])});
    slope = {found.attitude.w(), found.attitude.x(), found.attitude.y(), found.attitude.z(),
             found.rate.x(),     found.rate.y(),     found.rate.z()};
  };
}

template <typename Potential>
OdeState start_of(const Motion<Potential>& motion) {
  const Eigen::Quaterniond q(motion.state.attitude);
  const Vector3d& w = motion.state.angular_velocity;
  return {q.w(), q.x(), q.y(), q.z(), w.x(), w.y(), w.z()};
}

/// Dormand and Prince's method of order 5 with its own interpolation for the outputs.
template <typename Potential>
Outputs by_dopri5(const Motion<Potential>& motion, double duration, double tolerance) {
  namespace odeint = boost::numeric::odeint;
  auto stepper = odeint::make_dense_output(tolerance, tolerance, odeint::runge_kutta_dopri5<OdeState>());
  const double spacing = duration / static_cast<double>(outputs);
  const auto system = system_of(motion);
  stepper.initialize(start_of(motion), 0.0, spacing);
  Outputs found;
  found.quaternions.reserve(outputs);
  OdeState x{};
  for (long k = 1; k <= outputs; ++k) {
    const double time = static_cast<double>(k) * spacing;
    while (stepper.current_time() < time) {
      stepper.do_step(system);
    }
    stepper.calc_state(time, x);
    found.quaternions.emplace_back(x[0], x[1], x[2], x[3]);
  }
  return found;
}

/// Fehlberg's method of order 8, which has none, from output to output.
template <typename Potential>
Outputs by_fehlberg(const Motion<Potential>& motion, double duration, double tolerance) {
  namespace odeint = boost::numeric::odeint;
  auto stepper = odeint::make_controlled(tolerance, tolerance, odeint::runge_kutta_fehlberg78<OdeState>());
  const double spacing = duration / static_cast<double>(outputs);
  const auto system = system_of(motion);
  OdeState x = start_of(motion);
  Outputs found;
  found.quaternions.reserve(outputs);
  double step = spacing;
  double time = 0;
  for (long k = 1; k <= outputs; ++k) {
    const double until = static_cast<double>(k) * spacing;
    while (until - time > 1e-12 * spacing) {
      double tried = std::min(step, until - time);
      const bool is_last = !(tried < until - time);
      if (stepper.try_step(system, x, time, tried) == odeint::success && is_last) {
        step = std::max(step, tried);
      } else {
        step = tried;
      }
    }
    found.quaternions.emplace_back(x[0], x[1], x[2], x[3]);
  }
  return found;
}
#endif

template <typename Potential>
std::vector<Method> methods_of(const Motion<Potential>& motion, const ExactRotor<double>& rotor, double duration) {
  std::vector<Method> methods;
  for (const int order : {2, 4, 6, 8}) {
    Method variational{"variational, order " + std::to_string(order), {}};
    Method exact{"exact rotor, order " + std::to_string(order), {}};
    Splitting<double> splitting;
    expect_ok(splitting_of_order(order, splitting));
    for (const long steps : steps_of_settings) {
      variational.settings.emplace_back(
          [=, &motion] { return by_steps(motion.body, motion, duration, composition(order), steps); });
      exact.settings.emplace_back([=, &motion, &rotor] { return by_steps(rotor, motion, duration, splitting, steps); });
    }
    methods.push_back(variational);
    methods.push_back(exact);
  }
  Method classical{"RK4, quaternion", {}};
  for (const long steps : steps_of_settings) {
    if (steps % outputs == 0) {  // it has no interpolation of its own
      classical.settings.emplace_back([=, &motion] { return by_runge_kutta(motion, duration, steps / outputs); });
    }
  }
  methods.push_back(classical);
#ifdef ELLIPTUDE_HAS_FEHLBERG
  Method dopri5{"odeint, dopri5", {}};
  Method fehlberg{"odeint, rkf78", {}};
  for (int digits = 4; digits <= 28; ++digits) {
    const double tolerance = std::pow(10.0, -0.5 * digits);
    dopri5.settings.emplace_back([=, &motion] { return by_dopri5(motion, duration, tolerance); });
    fehlberg.settings.emplace_back([=, &motion] { return by_fehlberg(motion, duration, tolerance); });
  }
  methods.push_back(dopri5);
  methods.push_back(fehlberg);
#endif
  return methods;
}

/// The least processor time of some runs, ms.
double milliseconds(const Run& run) {
  double least = std::numeric_limits<double>::infinity();
  for (int repetition = 0; repetition < 5; ++repetition) {
    const std::clock_t begin = std::clock();
    long count = 0;
    do {  // as long as the clock needs
      static_cast<void>(run());
      ++count;
    } while (std::clock() - begin < CLOCKS_PER_SEC / 500);
    least =
        std::min(least, 1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC / static_cast<double>(count));
  }
  return least;
}

/// The attitudes at the outputs, in long double by steps that end at each of them.
template <typename Potential>
std::vector<Matrix3d> truth_of(const Motion<Potential>& motion, const ExactRotor<double>& rotor, double duration) {
  using Real = long double;
  constexpr long division = 16;
  constexpr long steps = division * outputs;
  Composition<Real> stages;
  expect_ok(composition_of_order(8, stages));
  const RigidBodyState<Real> start{renormalized(Matrix3<Real>(motion.state.attitude.template cast<Real>())),
                                   motion.state.angular_velocity.template cast<Real>()};
  std::vector<Matrix3d> truth;
  RigidBodyState<Real> end;
  expect_ok(integrate(rotor.template cast<Real>(), motion.potential.template cast<Real>(), stages, Real(0),
                      static_cast<Real>(duration) / steps, steps, Vector3<Real>(0, 0, 0), start, end,
                      [&truth](long k, const RigidBodyState<Real>& state) {
                        if (k % division == 0) {
                          truth.push_back(state.attitude.template cast<double>());
                        }
                      }));
  return truth;
}

/// The largest error, rad.
double error_of(const Outputs& found, const std::vector<Matrix3d>& truth) {
  double largest = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    largest = std::max(largest, log(Matrix3d(truth[i].transpose() * found.attitude(i))).norm());
  }
  return largest;
}

template <typename Potential>
void report(const char* name, const Motion<Potential>& motion, double duration) {
  ExactRotor<double> rotor;
  expect_ok(ExactRotor<double>::make(motion.body, rotor));
  const std::vector<Matrix3d> truth = truth_of(motion, rotor, duration);
  for (const Method& method : methods_of(motion, rotor, duration)) {
    std::array<double, targets.size()> best;
    best.fill(std::numeric_limits<double>::infinity());
    for (const Run& run : method.settings) {
      const std::optional<Outputs> found = run();
      const double error = found ? error_of(*found, truth) : std::numeric_limits<double>::infinity();
      if (error <= targets.front()) {
        const double cost = milliseconds(run);
        for (std::size_t i = 0; i < targets.size(); ++i) {
          if (error <= targets[i]) {
            best[i] = std::min(best[i], cost);
          }
        }
      }
      if (error <= targets.back()) {
        break;  // what follows costs more
      }
    }
    std::printf("%s\t%s", name, method.name.c_str());
    for (const double cost : best) {
      cost < std::numeric_limits<double>::infinity() ? std::printf("\t%.3g", cost) : std::printf("\t–");
    }
    std::printf("\n");
    std::fflush(stdout);
  }
}

}  // namespace

int main() {
  auto free = elliptude::operations::free_motion();
  free.state.angular_velocity = Vector3d(0.01, 5, 0.01);
  report("stable_spin, 100 s", free, 100.0);
  report("pendulum, 12 s", elliptude::operations::pendulum_motion(), 12.0);
  report("gravity gradient, 6 orbits", elliptude::operations::gravity_gradient_motion(), 37.699111843077517);
}
