#include "guaranteed/python_filter.hpp"
#include "sets/ellipsoids.hpp"

namespace elliptude::python {

namespace {

/// \throws ValueError of a vector without a direction.
[[nodiscard]] Vector3<double> direction_of(const py::object& value, const char* name) {
  const Vector3<double> direction = single(value, name, {3}).vector<3>(0);
  if (!(direction.cwiseAbs().maxCoeff() > 0)) {
    value_error(std::string(name) + " must not be zero");
  }
  return direction;
}

[[nodiscard]] py::object interval_of(const Interval<double>& interval) {
  return py::module_::import("elliptude.results").attr("Interval")(interval.least, interval.most);
}

}  // namespace

PythonGuaranteedFilter::AnyConstraints PythonGuaranteedFilter::present_constraints() const {
  if (constraints_) {
    return *constraints_;
  }
  return std::visit(
      [](const auto& filter) {
        using State = typename std::decay_t<decltype(filter)>::State;
        return AnyConstraints(UpdateConstraints<State>::of(filter.ellipsoid(), !filter.settings().estimates_vector));
      },
      filter_);
}

py::object PythonGuaranteedFilter::turn_about(const py::object& axis) const {
  const std::unique_lock lock = exclusive(*mutex_);
  const Vector3<double> n = direction_of(axis, "axis");
  if (!knows_attitude()) {
    return py::none();
  }
  Interval<double> angle{};
  raise_unless_ok(std::visit([&](const auto& asked) { return asked.turn_about(n, angle); }, present_constraints()),
                  "turn_about");
  return interval_of(angle);
}

py::object PythonGuaranteedFilter::vector_along(const py::object& direction) const {
  const std::unique_lock lock = exclusive(*mutex_);
  const Vector3<double> n = direction_of(direction, "direction");
  if (!knows_attitude()) {
    return py::none();
  }
  Interval<double> extent{};
  raise_unless_ok(std::visit([&](const auto& asked) { return asked.vector_along(n, extent); }, present_constraints()),
                  "vector_along");
  return interval_of(extent);
}

py::object PythonGuaranteedFilter::attitude_set(const std::string& criterion) const {
  const std::unique_lock lock = exclusive(*mutex_);
  if (criterion != "volume" && criterion != "trace") {
    value_error("criterion must be 'volume' or 'trace', not '" + criterion + "'");
  }
  if (!knows_attitude()) {
    return py::none();
  }
  const auto size = criterion == "volume" ? SizeCriterion<double, 3>::volume() : SizeCriterion<double, 3>::trace();
  AttitudeSet<double> set;
  raise_unless_ok(std::visit([&](const auto& asked) { return asked.attitude_set(size, set); }, present_constraints()),
                  "attitude_set");
  return py::module_::import("elliptude.results").attr("AttitudeSet")(to_array(set.center), to_array(set.shape));
}

}  // namespace elliptude::python
