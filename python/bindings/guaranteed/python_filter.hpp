#pragma once

/// \file
/// The guaranteed filter as Python has it.

#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>
#include <elliptude/guaranteed/update_constraints.hpp>
#include <optional>
#include <variant>

#include "attitude/state_ellipsoid.hpp"
#include "guaranteed/flow.hpp"
#include "guaranteed/measurements.hpp"

namespace elliptude::python {

/// Either filter behind one interface. The docstrings in guaranteed/filter.cpp describe the functions.
class PythonGuaranteedFilter {
 public:
  PythonGuaranteedFilter(py::object flow, const std::optional<AnyStateEllipsoid>& start, const py::object& time,
                         std::string criterion, const py::object& weight, const std::string& policy, int most_wrong,
                         int regain_after, const py::object& vector_bound, bool estimate_vector);

  [[nodiscard]] const py::object& flow() const noexcept { return flow_; }
  [[nodiscard]] const std::string& criterion() const noexcept { return criterion_; }
  [[nodiscard]] py::object weight() const;
  [[nodiscard]] const char* policy() const;
  [[nodiscard]] int most_wrong() const {
    return std::visit([](const auto& filter) { return filter.settings().most_wrong; }, filter_);
  }
  [[nodiscard]] int regain_after() const {
    return std::visit([](const auto& filter) { return filter.settings().regain_after; }, filter_);
  }
  [[nodiscard]] py::object vector_bound() const;
  [[nodiscard]] bool estimate_vector() const {
    return std::visit([](const auto& filter) { return filter.settings().estimates_vector; }, filter_);
  }

  [[nodiscard]] double time() const {
    return std::visit([](const auto& filter) { return filter.time(); }, filter_);
  }
  [[nodiscard]] const char* claim() const;
  [[nodiscard]] bool knows_attitude() const {
    return std::visit([](const auto& filter) { return filter.knows_attitude(); }, filter_);
  }
  [[nodiscard]] std::optional<AnyStateEllipsoid> ellipsoid() const;
  /// The set of the vector while the attitude is not known: (center, shape).
  [[nodiscard]] py::object vector() const;
  [[nodiscard]] int agreeing_updates() const {
    return std::visit([](const auto& filter) { return filter.trust().agreeing_updates(); }, filter_);
  }
  [[nodiscard]] int disputed_updates() const {
    return std::visit([](const auto& filter) { return filter.trust().disputed_updates(); }, filter_);
  }
  [[nodiscard]] bool rests_on_drops() const {
    return std::visit([](const auto& filter) { return filter.trust().rests_on_drops(); }, filter_);
  }

  [[nodiscard]] unsigned contradictions() const {
    return std::visit([](const auto& filter) { return filter.trust().contradictions(); }, filter_);
  }

  void resume(const std::optional<AnyStateEllipsoid>& ellipsoid, const py::object& vector, bool rests_on_drops,
              int agreeing_updates, int disputed_updates, int contradictions);

  void forget();

  void predict(const py::object& time, const py::object& control_torque, const py::object& wheel_momentum,
               const py::object& gyro, const py::object& increment);

  void predict_turn(const py::object& time, const py::object& turn, const py::object& turn_bound);

  [[nodiscard]] py::object update(const py::object& directions, const py::object& reference, const py::object& bounds,
                                  const py::object& angular_velocity, const py::object& rate_bound,
                                  const py::object& attitude, const py::object& attitude_bound,
                                  const py::object& sensors);

  [[nodiscard]] py::object update_linear(const py::object& y, const py::object& h, const py::object& bound);

  /// How far the attitude may be off, None without a set.
  [[nodiscard]] py::object bounds(const py::object& vertical) const;

  /// Single questions to what the last update used: guaranteed/questions.cpp.
  [[nodiscard]] py::object turn_about(const py::object& axis) const;
  [[nodiscard]] py::object vector_along(const py::object& direction) const;
  [[nodiscard]] py::object attitude_set(const std::string& criterion) const;

  [[nodiscard]] py::object run(const py::object& times, const py::object& directions, const py::object& reference,
                               const py::object& bounds, const py::object& angular_velocity,
                               const py::object& rate_bound, const py::object& attitude,
                               const py::object& attitude_bound, const py::object& gyro, const py::object& increment,
                               const py::object& control_torque, const py::object& wheel_momentum,
                               const py::object& sensors, const py::object& vertical);

  [[nodiscard]] py::object run_turns(const py::object& times, const py::object& turns, const py::object& turn_bounds,
                                     const py::object& anchors, const py::object& directions,
                                     const py::object& reference, const py::object& bounds, const py::object& attitude,
                                     const py::object& attitude_bound, const py::object& sensors,
                                     const py::object& vertical, const py::object& threads);

  [[nodiscard]] int traverse(visitproc visit, void* arg) const noexcept {
    Py_VISIT(flow_.ptr());
    return 0;
  }

 private:
  using BodyFilter = GuaranteedFilter<GuaranteedBodyFlow>;
  using GyroFilter = GuaranteedFilter<GuaranteedGyroFlow<double>>;
  using AnyFilter = std::variant<BodyFilter, GyroFilter>;
  using AnyConstraints = std::variant<UpdateConstraints<BodyFilter::State>, UpdateConstraints<GyroFilter::State>>;

  template <typename Filter>
  void make(const typename Filter::Flow& flow, const typename Filter::Settings& settings, double time,
            const std::optional<AnyStateEllipsoid>& start);

  /// Runs `loop` over the rows of a log: it gets a filter, the rows to fill and the index of the row.
  template <typename Loop>
  [[nodiscard]] py::object run_log(const Items& time, Index directions, const py::object& vertical, const Loop& loop);

  [[nodiscard]] bool has_gyro() const noexcept { return std::holds_alternative<GyroFilter>(filter_); }

  /// What the last update left, or the set as it is; the attitude is known.
  [[nodiscard]] AnyConstraints present_constraints() const;

  /// \throws TypeError of inputs that are not those of the flow.
  void require_inputs_of_flow(const py::object& control_torque, const py::object& wheel_momentum,
                              const py::object& gyro, const py::object& increment) const;

  /// \throws ValueError if a measurement comes without its bound, TypeError for a rate in a gyro's filter.
  void require_bounds(const py::object& directions, const py::object& reference, const py::object& bounds,
                      const py::object& angular_velocity, const py::object& rate_bound, const py::object& attitude,
                      const py::object& attitude_bound) const;

  py::object flow_;
  std::string criterion_;
  std::optional<Ellipsoid<double, 3>> vector_bound_;
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
  AnyFilter filter_;
  std::optional<AnyConstraints> constraints_;  // of the last update, until the filter changes
};

}  // namespace elliptude::python
