#pragma once

/// \file
/// The modes of a filter, chosen at compile time.

#include "elliptude/first_order/fusion.hpp"

namespace elliptude {

/// The paper's estimator (§3), corrected (theory, section 2): first order throughout; a shift moves ellipsoids to
/// another center.
struct PaperEstimator {
  static constexpr Recentring recentring = Recentring::shifted;
  /// Whether directions that do not determine an attitude are fused each as what it says.
  static constexpr bool takes_in_turn = true;
};

/// The paper's alone: it has nothing for directions that do not determine an attitude, and they are refused as
/// `attitude_undetermined` also beside an angular velocity. It is 19 kB less code on a Cortex-M7.
struct DeterminedPaperEstimator {
  static constexpr Recentring recentring = Recentring::shifted;
  static constexpr bool takes_in_turn = false;
};

/// As `PaperEstimator`, except that the Jacobian of the exponential moves ellipsoids to another center. Still of first
/// order: its sets are bounds only up to terms of second order in the error.
struct FirstOrderEstimator {
  static constexpr Recentring recentring = Recentring::first_order;
  static constexpr bool takes_in_turn = true;
};

}  // namespace elliptude
