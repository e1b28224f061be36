#pragma once

/// \file
/// What a guaranteed filter's set comes from, for questions about the attitude alone. (theory, section 16.11)

#include "elliptude/sets/quotient.hpp"

namespace elliptude::detail {

/// Quadrics of γ about the center of the filter's set, each of which holds the attitude as the set does. Any of them
/// may be left out.
template <typename Scalar>
struct KeptConstraints {
  std::array<Quadric<Scalar, 3>, most_questioned> quadrics;
  std::size_t count = 0;

  void add(const Quadric<Scalar, 3>& quadric) noexcept {
    if constexpr (most_questioned > 0) {
      if (count < most_questioned) {
        quadrics[count++] = quadric;
      }
    }
  }
};

}  // namespace elliptude::detail
