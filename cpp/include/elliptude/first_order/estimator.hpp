#pragma once

/// \file
/// The modes of a filter, chosen at compile time.

#include "elliptude/first_order/fusion.hpp"

namespace elliptude {

/// The paper's estimator (§3), corrected (theory, section 2): first order throughout; a shift moves ellipsoids to
/// another center.
struct PaperEstimator {
  static constexpr Recentring recentring = Recentring::shifted;
};

/// The same, except that the Jacobian of the exponential moves ellipsoids to another center. Still of first order: its
/// sets are bounds only up to terms of second order in the error.
struct FirstOrderEstimator {
  static constexpr Recentring recentring = Recentring::first_order;
};

}  // namespace elliptude
