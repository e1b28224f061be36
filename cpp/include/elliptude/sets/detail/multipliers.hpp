#pragma once

/// \file
/// Multipliers of constraints that are summed: which of them make a bound, and how far they may go.
/// (theory, section 16.5)

#include <algorithm>
#include <array>
#include <cstddef>

namespace elliptude::detail {

/// Whether constraints may be summed with these multipliers: a sum with one below zero bounds nothing and proves nothing.
/// What is proved rests on this alone, and not on the search that found them.
/// \param multipliers an array of `count` numbers or more.
template <typename Scalar, std::size_t Most>
[[nodiscard]] bool may_sum(const std::array<Scalar, Most>& multipliers, std::size_t count) noexcept {
  return std::all_of(multipliers.begin(), multipliers.begin() + count,
                     [](const Scalar& mu) { return mu >= Scalar(0); });
}

/// The largest part of a step, all of it at most, that leaves each multiplier 1 − `share` of itself.
/// \param from, along arrays of `count` numbers or more, the first positive.
template <typename Scalar, std::size_t Most>
[[nodiscard]] Scalar longest_step(const std::array<Scalar, Most>& from, const std::array<Scalar, Most>& along,
                                  std::size_t count, const Scalar& share) noexcept {
  Scalar length(1);
  for (std::size_t k = 0; k < count; ++k) {
    if (length * along[k] < -share * from[k]) {
      length = -share * from[k] / along[k];
    }
  }
  return length;
}

}  // namespace elliptude::detail
