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

  [[nodiscard]] bool describe(elliptude_kernels::Settings& settings) const noexcept override {
    using Kind = elliptude_kernels::Settings::Potential;
    if constexpr (std::is_same_v<Core, FreeBody<double>>) {
      settings.potential = Kind::free;
      return true;
    } else if constexpr (std::is_same_v<Core, UniformGravity<double>>) {
      settings.potential = Kind::uniform_gravity;
      Eigen::Map<Vector3<double>>(settings.moment) = core_.moment();
      return true;
    } else if constexpr (std::is_same_v<Core, GravityGradient<double>>) {
      settings.potential = Kind::gravity_gradient;
      Eigen::Map<Matrix3<double>>(settings.gradient) = core_.inertia();
      Eigen::Map<Matrix3<double>>(settings.orbit) = core_.orbit();
      settings.orbit_rate = core_.orbit_rate();
      return true;
    }
    return false;
  }

 private:
  Core core_;
  Settings settings_;
};

}  // namespace elliptude::python
