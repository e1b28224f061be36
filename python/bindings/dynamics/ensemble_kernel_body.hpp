/// \file
/// The kernels of ensemble_kernel.hpp for the instruction set that this is compiled for. Before it is included: ELLIPTUDE_MOVE and
/// ELLIPTUDE_SOLVE_WAHBA, the functions' names; ELLIPTUDE_WIDTH, how many numbers a register holds; names of their own for `elliptude` and `Eigen`.

#define EIGEN_DONT_VECTORIZE  // the packs are what is vectorised
#include <array>
#include <elliptude/ensemble/ensemble.hpp>
#include <elliptude/ensemble/wahba.hpp>

#include "dynamics/ensemble_kernel.hpp"

namespace elliptude_kernels {

namespace {

using namespace elliptude;

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

template <template <typename> class Potential>
[[nodiscard]] Outcome move(const RigidBody<double>& body, const Potential<double>& potential, const Settings& settings,
                           long steps, const Bodies& bodies, std::size_t count, const Stop& stop) noexcept {
  Composition<double> composition{};
  if (const Status status = composition_of_order(settings.order, composition); status != Status::ok) {
    return {static_cast<int>(status), 0};
  }
  std::array<EnsembleMember<double>, most> members;
  for (std::size_t i = 0; i < count; ++i) {
    members[i] = {{Eigen::Map<const RowMajor3>(bodies.attitude + 9 * i),
                   Eigen::Map<const Vector3<double>>(bodies.angular_velocity + 3 * i)},
                  bodies.time[i],
                  Eigen::Map<const Vector3<double>>(bodies.control_torque + 3 * i)};
  }
  const Ensemble<double, ELLIPTUDE_WIDTH, Potential> ensemble(body, potential, composition, settings.step);
  std::array<FlowLinearization<double>, most> linearizations;
  const EnsembleStatus done = bodies.by_state == nullptr
                                  ? ensemble.integrate(steps, members.data(), count)
                                  : ensemble.integrate_linearized(steps, members.data(), count, linearizations.data(),
                                                                  Interruption{stop.asked, stop.context});
  for (std::size_t i = 0; i < done.member; ++i) {
    Eigen::Map<RowMajor3>(bodies.attitude + 9 * i) = members[i].state.attitude;
    Eigen::Map<Vector3<double>>(bodies.angular_velocity + 3 * i) = members[i].state.angular_velocity;
    if (bodies.by_state != nullptr) {
      Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(bodies.by_state + 36 * i) = linearizations[i].state;
      Eigen::Map<Eigen::Matrix<double, 6, 3, Eigen::RowMajor>>(bodies.by_control + 18 * i) = linearizations[i].control;
    }
  }
  return {static_cast<int>(done.status), done.member};
}

[[nodiscard]] Matrix3<double> matrix(const double* numbers) noexcept {
  return Eigen::Map<const Matrix3<double>>(numbers);
}

}  // namespace

Outcome ELLIPTUDE_MOVE(const Settings& settings, long steps, const Bodies& bodies, std::size_t count,
                       const Stop& stop) noexcept {
  RigidBody<double> body;
  if (const Status status = RigidBody<double>::make(matrix(settings.inertia), body); status != Status::ok) {
    return {static_cast<int>(status), 0};
  }
  switch (settings.potential) {
    case Settings::Potential::free:
      break;
    case Settings::Potential::uniform_gravity: {
      UniformGravity<double> gravity;
      const Status status =
          UniformGravity<double>::make(1.0, 1.0, Eigen::Map<const Vector3<double>>(settings.moment), gravity);
      return status == Status::ok ? move(body, gravity, settings, steps, bodies, count, stop)
                                  : Outcome{static_cast<int>(status), 0};
    }
    case Settings::Potential::gravity_gradient: {
      RigidBody<double> acted_on;
      GravityGradient<double> gradient;
      Status status = RigidBody<double>::make(matrix(settings.gradient), acted_on);
      if (status == Status::ok) {
        status = GravityGradient<double>::make(acted_on, settings.orbit_rate, matrix(settings.orbit), gradient);
      }
      return status == Status::ok ? move(body, gradient, settings, steps, bodies, count, stop)
                                  : Outcome{static_cast<int>(status), 0};
    }
  }
  return move(body, FreeBody<double>(), settings, steps, bodies, count, stop);
}

Outcome ELLIPTUDE_SOLVE_WAHBA(const WahbaInput& input, std::size_t count, const WahbaOutput& output) noexcept {
  std::array<WahbaSolution<double>, most> solutions;
  WahbaProblems<double> problems{input.reference,   input.body,           input.weights,   input.reference_stride,
                                 input.body_stride, input.weights_stride, input.directions};
  for (std::size_t begin = 0; begin < count; begin += most) {
    const std::size_t size = count - begin < most ? count - begin : most;
    const EnsembleStatus done = solve_wahba_problems<ELLIPTUDE_WIDTH>(problems, size, solutions.data());
    for (std::size_t i = 0; i < done.member; ++i) {
      Eigen::Map<RowMajor3>(output.attitude + 9 * (begin + i)) = solutions[i].attitude;
      output.cost[begin + i] = solutions[i].cost;
      output.condition[begin + i] = solutions[i].condition;
    }
    if (done.status != Status::ok) {
      return {static_cast<int>(done.status), begin + done.member};
    }
    problems.reference += static_cast<std::ptrdiff_t>(size) * problems.reference_stride;
    problems.body += static_cast<std::ptrdiff_t>(size) * problems.body_stride;
    problems.weights += static_cast<std::ptrdiff_t>(size) * problems.weights_stride;
  }
  return {static_cast<int>(Status::ok), count};
}

}  // namespace elliptude_kernels
