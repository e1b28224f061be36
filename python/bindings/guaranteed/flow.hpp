#pragma once

/// \file
/// The guaranteed flows as Python has them.

#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>

#include "dynamics/bounded_potential.hpp"
#include "dynamics/potential.hpp"

namespace elliptude::python {

using GuaranteedBodyFlow = GuaranteedRigidBodyFlow<double, BoundedPotential>;

struct GuaranteedBodyFlowSettings {
  GuaranteedBodyFlow flow;
  PotentialReference potential;
  double step;
  BodyUncertainty<double> uncertainty;

  [[nodiscard]] int traverse(visitproc visit, void* argument) const noexcept {
    return potential.traverse(visit, argument);
  }
};

struct GuaranteedGyroFlowSettings {
  GuaranteedGyroFlow<double> flow;
  GyroUncertainty<double> uncertainty;
  std::string interval_rate;
};

}  // namespace elliptude::python
