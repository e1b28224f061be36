#include "first_order/filter_calls.hpp"
#include "first_order/log_rows.hpp"
#include "first_order/python_filter.hpp"

namespace elliptude::python {

namespace {

/// A filter's run over a log, without the interpreter's lock.
class FirstOrderRun {
 public:
  using Outcome = FirstOrderLogRows::Outcome;

  /// \param skips whether a measurement that contradicts the prediction is left out; it is an error otherwise.
  FirstOrderRun(const Items& time, const FirstOrderInputs& inputs, const FirstOrderMeasurements& measured, bool skips,
                const Failure& failure, FirstOrderLogRows& out)
      : time_(time), inputs_(inputs), measured_(measured), skips_(skips), failure_(failure), out_(out) {}

  /// \param row that the loop is at, for whoever catches an exception.
  template <typename Filter>
  void run(Filter& filter, Index& row) {
    const py::gil_scoped_release release;
    const Index rows = time_.item()[0];
    for (Index i = 0; i < rows; ++i) {
      row = i;
      raise_signals_at(i);
      predict_to_row(filter, i);
      fuse_row(filter, i);
    }
  }

 private:
  template <typename Filter>
  void predict_to_row(Filter& filter, Index row) const {
    const double time = time_[0][row];
    if (!(time >= filter.time())) {
      value_error("times must not go backwards, but times[" + std::to_string(row) + "] is " + text(time) + " s after " +
                  text(filter.time()) + " s");
    }
    predict_to(filter, time, inputs_.at(row), failure_);
  }

  template <typename Filter>
  void fuse_row(Filter& filter, Index row) {
    measured_.read_directions(row, present_);
    const std::optional<AngularVelocity<double>> rate = measured_.rate(row);
    Update<double> update{1.0, 1.0};
    Outcome outcome = Outcome::predicted;
    if (!present_.empty() || rate) {
      const Status status = fuse(filter, present_, rate, update);
      if (status == Status::empty_intersection && skips_) {
        outcome = Outcome::refused;
      } else {
        raise_unless_updated(filter, status, update, "");
        outcome = Outcome::updated;
      }
    }
    out_.set(row, filter, measured_, update, outcome);
  }

  const Items& time_;
  const FirstOrderInputs& inputs_;
  const FirstOrderMeasurements& measured_;
  bool skips_;
  const Failure& failure_;
  FirstOrderLogRows& out_;
  std::vector<Direction<double>> present_;
};

}  // namespace

py::object PythonFilter::run(const py::object& times, const py::object& directions, const py::object& reference,
                             const py::object& bounds, const py::object& weights, const py::object& angular_velocity,
                             const py::object& rate_bound, const py::object& gyro, const py::object& control_torque,
                             const std::string& on_inconsistent) {
  const std::unique_lock lock = begin_call();
  const Items time = single(times, "times", {any_length});
  const Index rows = time.item()[0];
  if (on_inconsistent != "raise" && on_inconsistent != "skip") {
    value_error("on_inconsistent must be 'raise' or 'skip', not '" + on_inconsistent + "'");
  }
  const FirstOrderMeasurements measured(rows, directions, reference, bounds, weights, angular_velocity, rate_bound);
  if (has_gyro() && !angular_velocity.is_none()) {
    throw py::type_error("angular_velocity cannot update a GyroFlow: the gyro's rates go in as gyro");
  }
  const FirstOrderInputs inputs(rows, has_gyro(), gyro, control_torque);
  if (has_gyro() && time[0][0] != this->time()) {
    value_error("times[0] must be the filter's time, " + text(this->time()) +
                " s, for a GyroFlow: gyro[k] is the rate from times[k] on; it is " + text(time[0][0]) + " s");
  }

  FirstOrderLogRows out(rows, measured.directions());
  FirstOrderRun run(time, inputs, measured, on_inconsistent == "skip", *failure_, out);
  AnyFilter working = filter_;
  Index row = 0;
  try {
    std::visit([&](auto& filter) { run.run(filter, row); }, working);
  } catch (InconsistentSets& error) {
    error.set_row(row);
    throw;
  } catch (const py::value_error& error) {
    throw RowFault(error.what(), row);
  }
  filter_ = working;
  return out.log(time);
}

}  // namespace elliptude::python
