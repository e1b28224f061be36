#pragma once

/// \file
/// Policies and claims by their names.

#include <array>
#include <cstdint>
#include <elliptude/guaranteed/policy.hpp>
#include <string>

#include "errors.hpp"

namespace elliptude::python {

inline constexpr std::array<const char*, 4> policies{"raise", "drop_measurement", "restart", "relaxed"};
/// `elliptude.results.CLAIMS`.
inline constexpr std::array<const char*, 3> claims{"unconditional", "conditional", "none"};

/// \throws ValueError that names them all.
[[nodiscard]] inline Policy policy_of(const std::string& name) {
  std::string all;
  for (std::size_t i = 0; i < policies.size(); ++i) {
    if (name == policies[i]) {
      return static_cast<Policy>(i);
    }
    all += std::string(i == 0 ? "'" : ", '") + policies[i] + "'";
  }
  value_error("policy must be one of " + all + ", not '" + name + "'");
}

/// A claim in arrays: its place among `claims`, of which the strongest comes first.
[[nodiscard]] inline std::uint8_t code_of(Claim claim) noexcept {
  return claim == Claim::unconditional ? 0 : claim == Claim::conditional ? 1 : 2;
}

[[nodiscard]] inline const char* name_of(Claim claim) noexcept { return claims[code_of(claim)]; }

}  // namespace elliptude::python
