#pragma once

/// \file
/// What a mode is, chosen at compile time.

#include "elliptude/first_order/fusion.hpp"

namespace elliptude {

/// The paper's estimator (§3) with its misprints mended: first order throughout, ellipsoids carried to another center by a shift.
struct PaperEstimator {
  static constexpr Recentring recentring = Recentring::shifted;
};

/// The same with ellipsoids carried to another center by the Jacobian that belongs there. Still of first order: what it returns
/// is a bound only up to terms of second order in the error.
struct FirstOrderEstimator {
  static constexpr Recentring recentring = Recentring::first_order;
};

}  // namespace elliptude
