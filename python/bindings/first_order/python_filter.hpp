#pragma once

/// \file
/// The first-order filter as Python has it.

#include <elliptude/first_order/filter.hpp>
#include <variant>

#include "attitude/state_ellipsoid.hpp"
#include "first_order/flow.hpp"
#include "sets/ellipsoids.hpp"

namespace elliptude::python {

/// Every flow and mode behind one interface. The docstrings in first_order/filter.cpp describe the functions.
class PythonFilter {
 public:
  PythonFilter(py::object flow, const AnyStateEllipsoid& ellipsoid, const py::object& time, std::string mode,
               std::string criterion, const py::object& weight);

  [[nodiscard]] const py::object& flow() const noexcept { return flow_; }
  [[nodiscard]] const std::string& mode() const noexcept { return mode_; }
  [[nodiscard]] const std::string& criterion() const noexcept { return criterion_; }
  [[nodiscard]] bool has_gyro() const noexcept { return filter_.index() >= 2; }

  [[nodiscard]] py::object weight() const;
  [[nodiscard]] double time() const {
    return std::visit([](const auto& filter) { return filter.time(); }, filter_);
  }
  [[nodiscard]] AnyStateEllipsoid ellipsoid() const {
    return std::visit([](const auto& filter) { return AnyStateEllipsoid::from(filter.ellipsoid()); }, filter_);
  }
  [[nodiscard]] Matrix6<double> transition() const {
    return std::visit([](const auto& filter) { return filter.transition(); }, filter_);
  }
  [[nodiscard]] Matrix6<double> prior_shape() const {
    return std::visit([](const auto& filter) { return filter.prior_shape(); }, filter_);
  }

  void resume(const py::object& transition, const py::object& prior_shape);

  void predict(const py::object& time, const py::object& control_torque, const py::object& gyro);

  [[nodiscard]] py::object update(const py::object& directions, const py::object& reference, const py::object& bounds,
                                  const py::object& weights, const py::object& angular_velocity,
                                  const py::object& rate_bound, const std::string& sensor, bool diagnostics);

  [[nodiscard]] py::object update_attitude(const py::object& attitude, const py::object& bound,
                                           const std::string& sensor);

  [[nodiscard]] py::object update_linear(const py::object& y, const py::object& h, const py::object& bound,
                                         const std::string& sensor);

  [[nodiscard]] AnyEllipsoid angular_velocity_estimate(const py::object& gyro) const;

  [[nodiscard]] py::object run(const py::object& times, const py::object& directions, const py::object& reference,
                               const py::object& bounds, const py::object& weights, const py::object& angular_velocity,
                               const py::object& rate_bound, const py::object& gyro, const py::object& control_torque,
                               const std::string& on_inconsistent);

  [[nodiscard]] int traverse(visitproc visit, void* arg) const noexcept {
    Py_VISIT(flow_.ptr());
    return 0;
  }

 private:
  using AnyFilter =
      std::variant<AttitudeFilter<BodyFlow, PaperEstimator>, AttitudeFilter<BodyFlow, FirstOrderEstimator>,
                   AttitudeFilter<GyroFlow<double>, PaperEstimator>,
                   AttitudeFilter<GyroFlow<double>, FirstOrderEstimator>>;

  template <typename Flow>
  void make(const Flow& flow, const SizeCriterion<double, 6>& criterion, double time,
            const AnyStateEllipsoid& ellipsoid);

  [[nodiscard]] std::unique_lock<std::mutex> begin_call();
  [[nodiscard]] Vector3<double> input_of(const py::object& control_torque, const py::object& gyro) const;

  py::object flow_;
  std::string mode_;
  std::string criterion_;
  std::unique_ptr<Failure> failure_ = std::make_unique<Failure>();
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
  AnyFilter filter_;
};

}  // namespace elliptude::python
