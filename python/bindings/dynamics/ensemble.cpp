#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <elliptude/dynamics/linearization.hpp>
#include <exception>
#include <thread>
#include <vector>

#include "dynamics/ensemble_kernel.hpp"
#include "dynamics/integrator.hpp"
#include "module.hpp"
#include "signals.hpp"
#include "threads.hpp"

namespace elliptude_kernels {

InstructionSet widest_set() noexcept {
#if defined(__GNUC__) && defined(__x86_64__)
  static const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq");
  static const bool has_avx2 = __builtin_cpu_supports("avx2");
  return has_avx512 ? InstructionSet::avx512 : (has_avx2 ? InstructionSet::avx2 : InstructionSet::baseline);
#elif defined(__GNUC__)
  return InstructionSet::baseline;
#else
  return InstructionSet::none;
#endif
}

Kernels widest() noexcept {
  switch (widest_set()) {
#if defined(__GNUC__) && defined(__x86_64__)
    case InstructionSet::avx512:
      return {&move_avx512, &solve_wahba_avx512};
    case InstructionSet::avx2:
      return {&move_avx2, &solve_wahba_avx2};
#endif
#if defined(__GNUC__)
    case InstructionSet::baseline:
      return {&move_baseline, &solve_wahba_baseline};
#endif
    default:
      return {nullptr, nullptr};
  }
}

}  // namespace elliptude_kernels

namespace elliptude::python {

Index thread_count(const py::object& threads, double worth) {
  if (!threads.is_none()) {
    return positive_count(threads, "threads");
  }
  const double processors = std::max(1.0, 1.0 * std::thread::hardware_concurrency());
  return static_cast<Index>(std::clamp(worth, 1.0, processors));
}

namespace {

using elliptude_kernels::Bodies;
using elliptude_kernels::Outcome;
using elliptude_kernels::Settings;
using elliptude_kernels::Stop;

/// After how many steps of a body a call looks whether to stop; the same for all bodies, as each run begins at a time of its own.
constexpr long longest_run = 1L << 12;

/// What a call returns: to begin with the initial states, then where each body is.
struct Moved {
  Results attitudes;
  Results rates;
  Results by_state;
  Results by_control;

  Moved(const InitialStates& start, bool linearized)
      : attitudes(start.leading(), {3, 3}),
        rates(start.leading(), {3}),
        by_state(linearized ? start.leading() : Shape{0}, {6, 6}),
        by_control(linearized ? start.leading() : Shape{0}, {6, 3}) {
    for (Index i = 0; i < start.count(); ++i) {
      set(i, start.state(i));
    }
  }
  void set(Index i, const RigidBodyState<double>& state) noexcept {
    attitudes.set(i, state.attitude);
    rates.set(i, state.angular_velocity);
  }
  [[nodiscard]] RigidBodyState<double> state(Index i) noexcept {
    return {Eigen::Map<const RowMajor3>(attitudes[i]), Eigen::Map<const Vector3<double>>(rates[i])};
  }
};

/// Moves all bodies, in groups that threads take one after another. What a body gets depends neither on its group, nor on the
/// thread, nor on the instruction set.
class Run {
 public:
  Run(const Integrator& integrator, const Settings& settings, const InitialStates& start, long steps, Moved& moved,
      bool linearized)
      : integrator_(integrator),
        settings_(settings),
        start_(start),
        steps_(steps),
        moved_(moved),
        linearized_(linearized) {}

  /// \throws what Ctrl-C raises.
  void on(Index threads) {
    std::vector<std::thread> others;
    const Index groups = (start_.count() + group - 1) / group;
    for (Index i = 1; i < std::min(threads, groups); ++i) {
      try {
        ++others_at_work_;
        others.emplace_back([this] {
          take_groups(
              {[](void* stopped) noexcept { return static_cast<std::atomic<bool>*>(stopped)->load(); }, &stopped_});
          --others_at_work_;
        });
      } catch (const std::exception&) {  // no more threads, or no memory for them: those that there are do the work
        --others_at_work_;
        break;
      }
    }
    // Ctrl-C is this thread's to see, also while it has nothing else to do.
    const Interruption signals = interruption_by_signals();
    take_groups({signals.stop, signals.context});
    while (others_at_work_ > 0) {
      std::this_thread::sleep_for(std::chrono::microseconds(50));
      if (!stopped_ && signals.stop(signals.context)) {
        stopped_ = true;
      }
    }
    for (std::thread& other : others) {
      other.join();
    }
    raise_if_interrupted(stopped_ ? Status::interrupted : Status::ok);
  }

  [[nodiscard]] const FirstFailure& failure() const noexcept { return failure_; }

 private:
  static constexpr Index group = static_cast<Index>(elliptude_kernels::most);

  void take_groups(const Stop& stop) noexcept {
    const Index count = start_.count();
    for (Index first = group * next_++; first < count && !stopped_; first = group * next_++) {
      move(first, std::min(group, count - first), stop);
    }
  }

  /// States alone in runs of steps, after each of which it looks whether to stop.
  void move(Index first, Index size, const Stop& stop) noexcept {
    std::array<double, elliptude_kernels::most> times;
    std::array<double, 3 * elliptude_kernels::most> controls;
    for (Index i = 0; i < size; ++i) {
      Eigen::Map<Vector3<double>>(controls.data() + 3 * i) = start_.control_torque(first + i);
    }
    const Bodies bodies{moved_.attitudes[first],
                        moved_.rates[first],
                        times.data(),
                        controls.data(),
                        linearized_ ? moved_.by_state[first] : nullptr,
                        linearized_ ? moved_.by_control[first] : nullptr};
    for (long done = 0, run = 0; done < steps_ && !stopped_; done += run) {
      run = linearized_ ? steps_ : std::min(longest_run, steps_ - done);
      for (Index i = 0; i < size; ++i) {
        times[static_cast<std::size_t>(i)] = start_.time(first + i) + static_cast<double>(done) * integrator_.step;
      }
      const Outcome outcome = move_(settings_, run, bodies, static_cast<std::size_t>(size), stop);
      const auto status = static_cast<Status>(outcome.status);
      if (status == Status::interrupted || (status == Status::ok && stop.asked(stop.context))) {
        stopped_ = true;
      } else if (status != Status::ok) {
        failure_.note(first + static_cast<Index>(outcome.body), status);
        return;
      }
    }
  }

  const Integrator& integrator_;
  const Settings& settings_;
  const InitialStates& start_;
  long steps_;
  Moved& moved_;
  bool linearized_;
  elliptude_kernels::Move move_ = elliptude_kernels::widest().move;
  std::atomic<Index> next_{0};
  std::atomic<bool> stopped_{false};
  std::atomic<int> others_at_work_{0};
  FirstFailure failure_;
};

/// One body after the other: a potential that the kernels do not have, or an exact rotor.
void move_alone(const Integrator& self, const InitialStates& start, long steps, Moved& moved, bool linearized) {
  Failure failure;
  const py::gil_scoped_release release;
  const PotentialInCall potential{*self.potential, failure};
  const Interruption signals = interruption_by_signals();
  for (Index i = 0; i < start.count(); ++i) {
    RigidBodyState<double> state = start.state(i);
    FlowLinearization<double> linearization = FlowLinearization<double>::identity();
    Status status = Status::ok;
    for (long done = 0, run = 0; status == Status::ok && done < steps; done += run) {
      const double time = start.time(i) + static_cast<double>(done) * self.step;
      run = linearized ? steps : std::min(longest_run, steps - done);
      status = self.with_method([&](const auto& body, const auto& method) {
        return linearized ? integrate_linearized(body, potential, method, time, self.step, run, start.control_torque(i),
                                                 state, state, linearization, signals)
                          : integrate(body, potential, method, time, self.step, run, start.control_torque(i), state,
                                      state, [](long, const RigidBodyState<double>&) {});
      });
      if (status == Status::ok && signals.stop(signals.context)) {
        status = Status::interrupted;
      }
    }
    raise_if_interrupted(status);
    if (status != Status::ok || failure.happened()) {
      raise_integration(status, failure, self, state, start.where(i));
    }
    moved.set(i, state);
    if (linearized) {
      moved.by_state.set(i, linearization.state);
      moved.by_control.set(i, linearization.control);
    }
  }
}

[[nodiscard]] Moved move_all(const Integrator& self, const InitialStates& start, const py::object& steps,
                             const py::object& threads, bool linearized) {
  const auto step_count = static_cast<long>(positive_count(steps, "steps"));
  // A thread is worth its start for half a millisecond of work.
  constexpr double least_steps = 1 << 14;
  const double worth = static_cast<double>(start.count()) * static_cast<double>(step_count) / least_steps;
  const Index taken = thread_count(threads, worth);
  Moved moved(start, linearized);
  Settings settings{};
  if (self.is_exact || elliptude_kernels::widest().move == nullptr || !(*self.potential).describe(settings)) {
    move_alone(self, start, step_count, moved, linearized);
    return moved;
  }
  Eigen::Map<Matrix3<double>>(settings.inertia) = self.body.inertia();
  settings.step = self.step;
  settings.order = self.order;
  Run run(self, settings, start, step_count, moved, linearized);
  {
    const py::gil_scoped_release release;
    run.on(taken);
  }
  if (run.failure().status() != Status::ok) {
    const Index body = run.failure().item();
    raise_integration(run.failure().status(), Failure(), self, moved.state(body), start.where(body));
  }
  return moved;
}

[[nodiscard]] py::tuple advance(const Integrator& self, const py::object& attitude, const py::object& angular_velocity,
                                const py::object& steps, const py::object& time, const py::object& control_torque,
                                const py::object& threads) {
  const InitialStates start(attitude, angular_velocity, time, control_torque);
  const Moved moved = move_all(self, start, steps, threads, false);
  return py::make_tuple(moved.attitudes.array(), moved.rates.array());
}

[[nodiscard]] py::object advance_linearized(const Integrator& self, const py::object& attitude,
                                            const py::object& angular_velocity, const py::object& steps,
                                            const py::object& time, const py::object& control_torque,
                                            const py::object& threads) {
  const InitialStates start(attitude, angular_velocity, time, control_torque);
  const Moved moved = move_all(self, start, steps, threads, true);
  return py::module_::import("elliptude.results")
      .attr("FlowLinearization")(moved.attitudes.array(), moved.rates.array(), moved.by_state.array(),
                                 moved.by_control.array());
}

}  // namespace

void define_ensembles(py::class_<Integrator>& integrator) {
  integrator
      .def("advance", &advance, py::arg("attitude"), py::arg("angular_velocity"), py::arg("steps"),
           py::arg("time") = 0.0, py::arg("control_torque") = py::none(), py::kw_only(),
           py::arg("threads") = py::none(),
           R"(advance(self, attitude, angular_velocity, steps, time=0.0, control_torque=None, *, threads=None)
--

Many bodies moved by many steps: where they are at the end.

Several bodies go through one SIMD register, with the widest instructions that the processor has, and groups of them through
threads. The numbers depend on neither, and not on how many bodies there are; they are those of `trajectory` but for rounding. That
holds for a `FreeBody`, `UniformGravity` and `GravityGradient`; with another potential one body goes after the other.

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes. The leading shapes of all arguments broadcast.
angular_velocity : array_like, shape (..., 3)
    ω in rad/s, body axes.
steps : int
    At least 1.
time : array_like, shape (...), optional
    t in s at the start.
control_torque : array_like, shape (..., 3), optional
    In N m, body axes, constant over all steps; zero unless given.
threads : int, optional
    As many as there are processors and as the work is worth, unless given.

Returns
-------
attitude : ndarray, shape (..., 3, 3)
angular_velocity : ndarray, shape (..., 3)

Raises
------
ValueError
    If an attitude is not a rotation, an entry is not finite, a shape does not fit, or the step is too long for an angular
    velocity. It names the first body of which that is so.

Examples
--------
>>> import numpy as np
>>> from elliptude import Integrator, RigidBody
>>> rotor = Integrator(RigidBody([0.13, 0.28, 0.17]), step=0.01)
>>> rates = np.random.default_rng(0).normal(size=(1000, 3))
>>> attitudes, rates = rotor.advance(np.eye(3), rates, steps=500)
>>> attitudes.shape
(1000, 3, 3)
)")
      .def(
          "advance_linearized", &advance_linearized, py::arg("attitude"), py::arg("angular_velocity"),
          py::arg("steps") = 1, py::arg("time") = 0.0, py::arg("control_torque") = py::none(), py::kw_only(),
          py::arg("threads") = py::none(),
          R"(advance_linearized(self, attitude, angular_velocity, steps=1, time=0.0, control_torque=None, *, threads=None)
--

As `advance`, and the linearization of all the steps together: `linearize` of many bodies at a time.

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes. The leading shapes of all arguments broadcast.
angular_velocity : array_like, shape (..., 3)
    ω in rad/s, body axes.
steps : int, optional
    At least 1.
time : array_like, shape (...), optional
    t in s at the start.
control_torque : array_like, shape (..., 3), optional
    In N m, body axes, constant over all steps; zero unless given.
threads : int, optional
    As many as there are processors and as the work is worth, unless given.

Returns
-------
FlowLinearization

Raises
------
ValueError
    As `advance`.
)");
}

}  // namespace elliptude::python
