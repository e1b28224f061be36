#pragma once

/// \file
/// The integrator in Python: its settings, and the arguments of a call.

#include <elliptude/dynamics/exact_rotor.hpp>
#include <elliptude/dynamics/integrator.hpp>
#include <string>

#include "dynamics/potential.hpp"

namespace elliptude::python {

/// The integrator's settings. The potential is kept as the Python object that was given.
struct Integrator {
  RigidBody<double> body;
  PotentialReference potential;
  double step;
  int order;
  bool is_exact;  ///< whether a step takes `rotor` and `splitting` in the place of `body` and `composition`
  Composition<double> composition;
  ExactRotor<double> rotor;  ///< of the body
  Splitting<double> splitting;

  /// What `function` returns for the body and the composition, or the exact rotor and the splitting, that the steps take.
  template <typename Function>
  [[nodiscard]] Status with_method(const Function& function) const {
    return is_exact ? function(rotor, splitting) : function(body, composition);
  }

  [[nodiscard]] int traverse(visitproc visit, void* argument) const noexcept {
    return potential.traverse(visit, argument);
  }
};

/// \throws ValueError for a status of the core's integrator that is not `ok`; Python's own exception where a potential has
/// raised one.
[[noreturn]] void raise_integration(Status status, const Failure& failure, const Integrator& integrator,
                                    const RigidBodyState<double>& state, const std::string& where);

/// The control torque that was given, or zero.
[[nodiscard]] py::object control_torque_or_zero(const py::object& given);

/// \throws TypeError, ValueError unless it is an integer of at least 1.
[[nodiscard]] Index positive_count(const py::object& value, const std::string& name);

/// The trajectory of one initial state: at steps, and at given times. The docstrings are with their bindings.
[[nodiscard]] py::object trajectory(const Integrator& self, const py::object& attitude,
                                    const py::object& angular_velocity, const py::object& steps, const py::object& time,
                                    const py::object& control_torque, const py::object& every);
[[nodiscard]] py::object trajectory_at(const Integrator& self, const py::object& attitude,
                                       const py::object& angular_velocity, const py::object& at, const py::object& time,
                                       const py::object& control_torque);

/// The initial states, times and control torques of a call, broadcast.
class InitialStates {
 public:
  InitialStates(const py::object& attitude, const py::object& angular_velocity, const py::object& time,
                const py::object& control_torque)
      : attitude_(attitudes(attitude, "attitude")),
        angular_velocity_(angular_velocity, "angular_velocity", {3}),
        time_(time, "time", {}),
        control_torque_(control_torque_or_zero(control_torque), "control_torque", {3}),
        leading_(broadcast({&attitude_, &angular_velocity_, &time_, &control_torque_})) {}

  [[nodiscard]] const Shape& leading() const noexcept { return leading_; }
  [[nodiscard]] Index count() const noexcept { return count_of(leading_); }
  [[nodiscard]] RigidBodyState<double> state(Index i) const noexcept {
    return {attitude_.matrix3(i), angular_velocity_.vector<3>(i)};
  }
  [[nodiscard]] double time(Index i) const noexcept { return time_.number(i); }
  [[nodiscard]] Vector3<double> control_torque(Index i) const noexcept { return control_torque_.vector<3>(i); }
  /// " for item [3]", where there is more than one.
  [[nodiscard]] std::string where(Index i) const { return leading_.empty() ? "" : " for item " + place(leading_, i); }

 private:
  Items attitude_;
  Items angular_velocity_;
  Items time_;
  Items control_torque_;
  Shape leading_;
};

/// Adds the methods that move many bodies at a time.
void define_ensembles(py::class_<Integrator>& integrator);

}  // namespace elliptude::python
