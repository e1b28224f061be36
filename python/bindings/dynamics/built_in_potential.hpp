#pragma once

/// \file
/// One of the core's potentials behind the interface of all.

#include <type_traits>
#include <variant>

#include "dynamics/potential.hpp"

namespace elliptude::python {

/// \throws ValueError unless it is a finite number that is not negative.
[[nodiscard]] double not_negative(const py::object& value, const std::string& name);

/// One of the core's potentials, and the settings that it was made of.
template <typename Core, typename Settings>
class BuiltIn final : public Potential {
 public:
  BuiltIn(const Core& core, const Settings& settings) noexcept : core_(core), settings_(settings) {}

  [[nodiscard]] const Settings& settings() const noexcept { return settings_; }

  [[nodiscard]] double energy(const Matrix3<double>& attitude, double time,
                              Failure& /*failure*/) const noexcept override {
    return core_.energy(attitude, time);
  }
  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, double time,
                                       Failure& /*failure*/) const noexcept override {
    return core_.torque(attitude, time);
  }
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, double time,
                                                Failure& /*failure*/) const noexcept override {
    return core_.torque_jacobian(attitude, time);
  }
  [[nodiscard]] std::optional<double> torque_curvature_bound() const override { return core_.torque_curvature_bound(); }
  [[nodiscard]] Added add_to(BoundedPotential& sum) const noexcept override {
    if constexpr (std::is_same_v<Core, FreeBody<double>>) {
      return Added::yes;
    } else {
      return sum.add(core_) ? Added::yes : Added::too_many;
    }
  }

 private:
  Core core_;
  Settings settings_;
};

}  // namespace elliptude::python
