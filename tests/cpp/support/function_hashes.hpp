#pragma once

/// \file
/// Hashes of bits: of numbers, and of what base/elementary.hpp gives for a list of arguments that is the same everywhere.

#include <array>
#include <cstdint>
#include <elliptude/base/elementary.hpp>

namespace elliptude::testing {

/// FNV-1a, byte by byte from the lowest.
struct Hash {
  std::uint64_t state = 14695981039346656037U;

  template <typename Real>
  void add(Real x) {
    auto bits = static_cast<std::uint64_t>(elementary::detail::to_bits(x));
    for (std::size_t i = 0; i < sizeof(Real); ++i, bits >>= 8) {
      state = (state ^ (bits & 255U)) * 1099511628211U;
    }
  }
};

/// Hashes of exp, log, sin, cos and atan2. Integers alone make the arguments, which have 24 digits.
template <typename Real>
[[nodiscard]] std::array<std::uint64_t, 5> function_hashes() {
  using elementary::detail::power_of_two;
  std::array<Hash, 5> result;
  std::uint64_t state = 1;
  const auto number = [&state](int from, int to) {
    state = state * 6364136223846793005U + 1442695040888963407U;
    const auto mantissa = static_cast<Real>(static_cast<std::int32_t>(state >> 40)) * power_of_two<Real>(-24);
    const auto exponent = from + static_cast<int>((state >> 20) % static_cast<unsigned>(to - from));
    const Real size = mantissa * power_of_two<Real>(exponent);
    return (state >> 19) % 2 == 0 ? size : -size;
  };
  const int most = std::numeric_limits<Real>::max_exponent - 1;
  for (int i = 0; i < 20000; ++i) {
    const bool is_near = i % 2 == 0;
    result[0].add(elementary::exp(number(-10, i % 8 == 0 ? 11 : 5)));
    const Real x = number(is_near ? -2 : 1 - most, is_near ? 3 : most);
    result[1].add(elementary::log(x < 0 ? -x : x));
    const Real angle = number(is_near ? -10 : -most / 2, is_near ? 15 : most);
    result[2].add(elementary::sin(angle));
    result[3].add(elementary::cos(angle));
    const Real y = number(-5, 5);
    result[4].add(elementary::atan2(y, number(-5, 5)));
  }
  return {result[0].state, result[1].state, result[2].state, result[3].state, result[4].state};
}

inline constexpr std::array<std::uint64_t, 5> golden_functions_of_double{
    0x47bd6dc969903175U, 0x9cf73e6d6859b00aU, 0x1a84199bc8c08bf3U, 0x08cfba3ec9cee66eU, 0x6aee9549b8bf429aU};
inline constexpr std::array<std::uint64_t, 5> golden_functions_of_float{
    0x82f248a96511432bU, 0x34e46042511386b2U, 0x70761c21b681f4a4U, 0x9c1a15ec14d1bdddU, 0xd100a9962a3c749cU};

}  // namespace elliptude::testing
