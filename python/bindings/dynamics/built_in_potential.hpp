#pragma once

/// \file
/// One of the core's potentials behind the interface of all, and what is bound of each.

#include <string>
#include <type_traits>
#include <vector>

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

/// A parameter of a potential: its name in Python, the setting that it is, and what the property says.
template <typename Settings, typename Value>
struct Parameter {
  const char* name;
  Value Settings::* setting;
  const char* description;
};
template <typename Settings, typename Value>
Parameter(const char*, Value Settings::*, const char*) -> Parameter<Settings, Value>;

[[nodiscard]] inline py::object as_property(double value) { return py::float_(value); }
[[nodiscard]] inline py::object as_property(const RigidBody<double>& value) { return py::cast(value); }
template <typename Derived>
[[nodiscard]] py::object as_property(const Eigen::MatrixBase<Derived>& value) {
  return to_constant_array(value);
}

/// Gives a potential a property for each parameter of its constructor, in that order, and by them a `__repr__` and copies.
template <typename Core, typename Settings, typename... Values>
void define_parameters(py::class_<BuiltIn<Core, Settings>, Potential>& potential,
                       const Parameter<Settings, Values>&... parameters) {
  using Self = BuiltIn<Core, Settings>;
  (potential.def_property_readonly(
       parameters.name,
       [setting = parameters.setting](const Self& self) { return as_property(self.settings().*setting); },
       parameters.description),
   ...);
  const std::vector<std::string> names{parameters.name...};
  potential
      .def("__repr__",
           [names](const py::object& self) {
             py::list written;
             for (const std::string& name : names) {
               const py::object value = self.attr(name.c_str());
               written.append(py::str("{}={!r}").format(
                   name, py::hasattr(value, "tolist") ? py::object(value.attr("tolist")()) : value));
             }
             return py::str("{}({})").format(py::type::of(self).attr("__name__"), py::str(", ").attr("join")(written));
           })
      .def("__reduce__", [names](const py::object& self) {
        py::tuple arguments(names.size());
        for (std::size_t i = 0; i < names.size(); ++i) {
          arguments[i] = self.attr(names[i].c_str());
        }
        return py::make_tuple(py::type::of(self), arguments);
      });
}

}  // namespace elliptude::python
