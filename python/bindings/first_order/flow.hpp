#pragma once

/// \file
/// How a state moves between measurements, as Python has it.

#include <elliptude/first_order/flow.hpp>

#include "dynamics/potential.hpp"

namespace elliptude::python {

/// A potential as a filter keeps it; both outlive every call.
struct HeldPotential {
  const Potential* potential = nullptr;
  Failure* failure = nullptr;

  [[nodiscard]] double energy(const Matrix3<double>& attitude, const double& time) const noexcept {
    return potential->energy(attitude, time, *failure);
  }
  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, const double& time) const noexcept {
    return potential->torque(attitude, time, *failure);
  }
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, const double& time) const noexcept {
    return potential->torque_jacobian(attitude, time, *failure);
  }
};

using BodyFlow = RigidBodyFlow<double, HeldPotential>;

struct BodyFlowSettings {
  RigidBody<double> body;
  PotentialReference potential;
  double step;
  int order;
  Matrix3<double> unknown_torque;
  long most_steps;

  [[nodiscard]] int traverse(visitproc visit, void* argument) const noexcept {
    return potential.traverse(visit, argument);
  }
};

struct GyroFlowSettings {
  Matrix3<double> noise;
  Matrix3<double> drift;
};

}  // namespace elliptude::python
