#pragma once

/// \file
/// A minimiser that knows nothing of what it minimises: a grid, then golden sections about its best point.

#include <cmath>

namespace elliptude::testing {

/// The least value of `function` between `low` and `high`. Values that are not finite count as infinite.
template <typename Function>
[[nodiscard]] long double least_value(const Function& function, long double low, long double high, int grid) {
  const auto value = [&function](long double x) {
    const long double y = function(x);
    return std::isfinite(y) ? y : HUGE_VALL;
  };
  const long double width = (high - low) / grid;
  long double best = low;
  long double least = value(low);
  for (int i = 1; i <= grid; ++i) {
    const long double x = low + width * i;
    const long double y = value(x);
    if (y < least) {
      least = y;
      best = x;
    }
  }
  const long double golden = (std::sqrt(5.0L) - 1) / 2;
  long double a = std::fmax(low, best - width);
  long double b = std::fmin(high, best + width);
  for (int i = 0; i < 70; ++i) {
    const long double left = b - golden * (b - a);
    const long double right = a + golden * (b - a);
    (value(left) < value(right) ? b : a) = value(left) < value(right) ? right : left;
  }
  return std::fmin(least, value((a + b) / 2));
}

}  // namespace elliptude::testing
