#include <limits>

#include "guaranteed/anchored_rows.hpp"
#include "guaranteed/filter_calls.hpp"
#include "guaranteed/log_rows.hpp"
#include "guaranteed/python_filter.hpp"
#include "guaranteed/rows.hpp"

namespace elliptude::python {

namespace {

/// Fuses what a row holds with a filter that was predicted to it.
template <typename Filter>
void fuse_row(Filter& filter, const MeasuredLog& log, const SensorNames& names, Index row, Measured& measured,
              LogRows& out) {
  log.read(row, measured);
  GuaranteedUpdate<double> update;
  update.margin = std::numeric_limits<double>::quiet_NaN();  // of no fusion
  if (measured.any()) {
    update = fuse(filter, measured, names);
  }
  out.set(row, filter, measured, update);
}

/// Predicts to each row of a log by `predict`, and fuses what it holds, without the interpreter's lock.
/// \param row that the loop is at, for whoever catches an exception.
template <typename Filter, typename Predict>
void run_rows(Filter& filter, const MeasuredLog& log, const SensorNames& names, Index rows, const Predict& predict,
              LogRows& out, Index& row) {
  const py::gil_scoped_release release;
  Measured measured;
  for (Index i = 0; i < rows; ++i) {
    row = i;
    raise_signals_at(i);
    predict(i);
    fuse_row(filter, log, names, i, measured, out);
  }
}

void require_forward(const Items& time, Index row, double before) {
  if (!(time[0][row] >= before)) {
    value_error("times must not go backwards, but times[" + std::to_string(row) + "] is " + text(time[0][row]) +
                " s after " + text(before) + " s");
  }
}

}  // namespace

template <typename Loop>
py::object PythonGuaranteedFilter::run_log(const Items& time, Index directions, const py::object& vertical,
                                           const Loop& loop) {
  LogRows out(time.item()[0], directions,
              vertical.is_none() ? std::nullopt : std::optional<Vector3<double>>(vertical_of(vertical)));
  constraints_.reset();
  run_on_copy(filter_, [&](AnyFilter& working, Index& row) { loop(working, out, row); });
  return out.log(time);
}

py::object PythonGuaranteedFilter::run(const py::object& times, const py::object& directions,
                                       const py::object& reference, const py::object& bounds,
                                       const py::object& angular_velocity, const py::object& rate_bound,
                                       const py::object& attitude, const py::object& attitude_bound,
                                       const py::object& gyro, const py::object& increment,
                                       const py::object& control_torque, const py::object& wheel_momentum,
                                       const py::object& sensors, const py::object& vertical) {
  const std::unique_lock lock = exclusive(*mutex_);
  const Items time = single(times, "times", {any_length});
  const Index rows = time.item()[0];
  require_inputs_of_flow(control_torque, wheel_momentum, gyro, increment);
  require_bounds(directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const MeasuredLog log(rows, directions, reference, bounds, angular_velocity, rate_bound, attitude, attitude_bound);
  const Index m = log.directions();
  const SensorNames names(sensors, m, !angular_velocity.is_none(), !attitude.is_none());
  const std::optional<LogInput> torques = log_input(control_torque, "control_torque", {3}, rows);
  const std::optional<LogInput> wheels = log_input(wheel_momentum, "wheel_momentum", {3}, rows);
  const std::optional<LogInput> increments = log_input(increment, "increment", {}, rows, Items::Require::anything);
  std::optional<Items> rates;
  if (has_gyro()) {
    rates.emplace(gyro, "gyro", Shape{rows, 3}, Items::Require::anything, Items::Batch::none);
    if (time[0][0] != this->time()) {
      value_error("times[0] must be the filter's time, " + text(this->time()) +
                  " s, for a GuaranteedGyroFlow: gyro[k] is the rate from times[k] on; it is " + text(time[0][0]) +
                  " s");
    }
  }

  const auto loop = [&](AnyFilter& any, LogRows& out, Index& row) {
    std::visit(
        [&](auto& filter) {
          const auto predict = [&](Index i) {
            Inputs inputs;
            const Index before = std::max<Index>(i - 1, 0);  // a gyro's row is of the interval that it begins
            if (rates) {
              inputs.set_gyro(Eigen::Map<const Vector3<double>>((*rates)[0] + 3 * before),
                              "gyro[" + std::to_string(before) + "]");
            }
            if (increments && !(*increments->row(before) != *increments->row(before))) {
              inputs.increment = *increments->row(before);
              if (!(inputs.increment >= 0) || !scalar::isfinite(inputs.increment)) {
                value_error("increment[" + std::to_string(before) + "] must not be negative, but is " +
                            text(inputs.increment) + " rad; NaN where none is known");
              }
            }
            if (torques) {
              inputs.control_torque = Eigen::Map<const Vector3<double>>(torques->row(i));
            }
            if (wheels) {
              inputs.wheel_momentum = Eigen::Map<const Vector3<double>>(wheels->row(i));
            }
            require_forward(time, i, filter.time());
            predict_to(filter, time[0][i], inputs);
          };
          run_rows(filter, log, names, rows, predict, out, row);
        },
        any);
  };
  return run_log(time, m, vertical, loop);
}

py::object PythonGuaranteedFilter::run_turns(const py::object& times, const py::object& turns,
                                             const py::object& turn_bounds, const py::object& anchors,
                                             const py::object& directions, const py::object& reference,
                                             const py::object& bounds, const py::object& attitude,
                                             const py::object& attitude_bound, const py::object& sensors,
                                             const py::object& vertical, const py::object& threads) {
  const std::unique_lock lock = exclusive(*mutex_);
  if (!has_gyro()) {
    throw py::type_error("run_turns is for a GuaranteedGyroFlow; a turn does not tell a rigid body's rate");
  }
  const Items time = single(times, "times", {any_length});
  const Index rows = time.item()[0];
  require_bounds(directions, reference, bounds, py::none(), py::none(), attitude, attitude_bound);
  const MeasuredLog log(rows, directions, reference, bounds, py::none(), py::none(), attitude, attitude_bound);
  const SensorNames names(sensors, log.directions(), false, !attitude.is_none());
  const Items turn = single(turns, "turns", {rows, 3});
  const Items angle(turn_bounds, "turn_bounds", {rows}, Items::Require::anything, Items::Batch::none);
  const Anchors from(anchors, rows);
  constexpr double worth = 1 << 10;  // rows
  const Index taken = thread_count(threads, static_cast<double>(rows) / worth);
  const auto loop = [&](AnyFilter& any, LogRows& out, Index& row) {
    const auto run_row = [&](GyroFilter& filter, Index i, bool is_first) {
      // From the row before, which need not be the anchor.
      require_forward(time, i, is_first ? filter.time() : time[0][i - 1]);
      const std::string place = "[" + std::to_string(i) + "]";
      turn_to(filter, time[0][i], Eigen::Map<const Vector3<double>>(turn[0] + 3 * i), "turns" + place, angle[0][i],
              "turn_bounds" + place);
      Measured measured;
      fuse_row(filter, log, names, i, measured, out);
    };
    const py::gil_scoped_release release;
    AnchoredRows<GyroFilter, decltype(run_row)>(from, rows, taken, run_row).run(std::get<GyroFilter>(any), row);
  };
  return run_log(time, log.directions(), vertical, loop);
}

}  // namespace elliptude::python
