#include <algorithm>
#include <cmath>
#include <elliptude/dynamics/interpolation.hpp>
#include <vector>

#include "dynamics/integrator.hpp"
#include "signals.hpp"

namespace elliptude::python {

namespace {

// Some milliseconds.
constexpr Index steps_between_signals = 1 << 15;

/// Steps in runs of at most so many: `run(done, count)`. Between runs Ctrl-C is looked for.
template <typename Run>
void in_runs(Index step_count, Index most, const Run& run) {
  Index done = 0;
  while (done < step_count) {
    const Index count = std::min(most, step_count - done);
    run(done, count);
    if ((done + count) / steps_between_signals > done / steps_between_signals) {
      raise_signals();
    }
    done += count;
  }
}

/// \throws ValueError unless they are finite, ascend, and begin at `start` or later.
[[nodiscard]] std::vector<double> ascending_times(const py::object& given, double start) {
  const Items items(given, "times", {});
  if (items.leading().size() != 1 || items.leading()[0] < 1) {
    value_error("times must have the shape (n,) with at least one time, not " + text(items.leading()));
  }
  std::vector<double> times;
  for (Index row = 0; row < items.leading()[0]; ++row) {
    const double earliest = times.empty() ? start : times.back();
    times.push_back(items.number(row));
    if (!(times.back() >= earliest)) {
      value_error("times[" + std::to_string(row) + "] must not be before " + text(earliest) + " s, but is " +
                  text(times.back()) + " s");
    }
  }
  return times;
}

/// Some of the times, as `integrate_to_times` takes them.
struct TimesInRun {
  const double* first;
  std::size_t count;

  [[nodiscard]] std::size_t size() const noexcept { return count; }
  [[nodiscard]] double operator[](std::size_t row) const noexcept { return first[row]; }
};

}  // namespace

py::object trajectory(const Integrator& self, const py::object& attitude, const py::object& angular_velocity,
                      const py::object& steps, const py::object& time, const py::object& control_torque,
                      const py::object& every) {
  RigidBodyState<double> state{single_attitude(attitude, "attitude"),
                               single(angular_velocity, "angular_velocity", {3}).vector<3>(0)};
  const Index step_count = positive_count(steps, "steps");
  const Index stride = positive_count(every, "every");
  if (step_count % stride != 0) {
    value_error("every must divide steps, so that the last state is there, but is " + std::to_string(stride) + " for " +
                std::to_string(step_count) + " steps");
  }
  const double start = single(time, "time", {}).number(0);
  const Items controls(control_torque_or_zero(control_torque), "control_torque", {3});
  const bool constant_control = controls.leading().empty();
  if (!constant_control && controls.leading() != Shape{step_count}) {
    Shape shape = controls.leading();
    shape.push_back(3);
    value_error("control_torque must have the shape (3,) or (steps, 3) = " + text({step_count, 3}) + ", not " +
                text(shape));
  }

  const Index rows = step_count / stride + 1;
  Results times({rows}, {});
  Results attitudes_at({rows}, {3, 3});
  Results rates_at({rows}, {3});
  const auto record = [&](Index row, const RigidBodyState<double>& at) {
    times.set(row, start + static_cast<double>(row * stride) * self.step);
    attitudes_at.set(row, at.attitude);
    rates_at.set(row, at.angular_velocity);
  };
  record(0, state);
  Failure failure;
  {
    const py::gil_scoped_release release;
    const Index most = constant_control ? steps_between_signals : 1;
    in_runs(step_count, most, [&](Index done, Index run) {
      RigidBodyState<double> latest = state;
      Index completed = done;
      const auto visit = [&](long k, const RigidBodyState<double>& at) {
        latest = at;
        completed = done + k;
        if (completed % stride == 0) {
          record(completed / stride, at);
        }
      };
      const Status status = self.with_method([&](const auto& body, const auto& method) {
        return integrate(body, PotentialInCall{*self.potential, failure}, method,
                         start + static_cast<double>(done) * self.step, self.step, static_cast<long>(run),
                         controls.vector<3>(constant_control ? 0 : done), state, state, visit);
      });
      if (status != Status::ok) {
        raise_integration(status, failure, self, latest, " after " + std::to_string(completed) + " steps");
      }
    });
  }
  return py::module_::import("elliptude.results")
      .attr("Trajectory")(times.array(), attitudes_at.array(), rates_at.array());
}

py::object trajectory_at(const Integrator& self, const py::object& attitude, const py::object& angular_velocity,
                         const py::object& at, const py::object& time, const py::object& control_torque) {
  RigidBodyState<double> state{single_attitude(attitude, "attitude"),
                               single(angular_velocity, "angular_velocity", {3}).vector<3>(0)};
  const double start = single(time, "time", {}).number(0);
  const Vector3<double> control = single(control_torque_or_zero(control_torque), "control_torque", {3}).vector<3>(0);
  const std::vector<double> times = ascending_times(at, start);
  const double steps_needed = std::ceil((times.back() - start) / self.step * (1 - 4e-16));
  if (!(steps_needed < 1e15)) {
    value_error("times[-1] is " + text(steps_needed) + " steps of " + text(self.step) + " s after time");
  }
  const auto step_count = std::max<Index>(1, static_cast<Index>(steps_needed));

  Results times_at({static_cast<Index>(times.size())}, {});
  Results attitudes_at({static_cast<Index>(times.size())}, {3, 3});
  Results rates_at({static_cast<Index>(times.size())}, {3});
  Failure failure;
  {
    const py::gil_scoped_release release;
    std::size_t row = 0;
    in_runs(step_count, steps_between_signals, [&](Index done, Index run) {
      const double run_start = start + static_cast<double>(done) * self.step;
      const double run_end = start + static_cast<double>(done + run) * self.step;
      const auto begin = times.begin() + static_cast<std::ptrdiff_t>(row);
      const auto end = done + run == step_count ? times.end() : std::upper_bound(begin, times.end(), run_end);
      const auto visit = [&](std::size_t, const RigidBodyState<double>& found) {
        const auto here = static_cast<Index>(row);
        times_at.set(here, times[row]);
        attitudes_at.set(here, found.attitude);
        rates_at.set(here, found.angular_velocity);
        ++row;
      };
      const TimesInRun in_run{times.data() + row, static_cast<std::size_t>(end - begin)};
      const RigidBodyState<double> before = state;
      const Status status = self.with_method([&](const auto& body, const auto& method) {
        return integrate_to_times(body, PotentialInCall{*self.potential, failure}, method, run_start, self.step,
                                  static_cast<long>(run), control, before, in_run, state, visit);
      });
      if (status == Status::step_too_long && self.is_exact && !failure.happened()) {
        value_error("step " + text(self.step) +
                    " s is too long: between two steps the body must turn by less than a right angle, and the angular "
                    "velocity is " +
                    text(before.angular_velocity.norm()) + " rad/s");
      }
      if (status != Status::ok) {
        raise_integration(status, failure, self, before, "");
      }
    });
  }
  return py::module_::import("elliptude.results")
      .attr("Trajectory")(times_at.array(), attitudes_at.array(), rates_at.array());
}

}  // namespace elliptude::python
