#pragma once

/// \file
/// Bits of numbers, and what is left of an angle without its quarter turns. (theory, section 17.11)

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include "elliptude/base/detail/elementary_constants.hpp"

namespace elliptude::elementary::detail {

/// How a format's numbers are stored, and where its functions take other ways.
template <typename Real>
struct Format;

template <>
struct Format<double> {
  using Bits = std::uint64_t;
  static constexpr int fraction = 52;
  static constexpr int bias = 1023;
  static constexpr Bits one = Bits{1023} << 52;
  static constexpr Bits head = ~((Bits{1} << 27) - 1);  // sign, exponent and 26 digits
  static constexpr double to_integer = 0x1.8p52;        // a sum with it is rounded to an integer
  static constexpr double exponent_of_normal = 708;     // its exponential is a normal number, and so is the reciprocal
  static constexpr double of_subnormal = 0x1p52;        // times it, each subnormal number is a normal one
  static constexpr double own_sine = 0x1p-27;           // what is smaller is its own sine
  static constexpr double eighth_turn = 0x1.921fb54442d18p-1;
  static constexpr double cody_waite = 0x1.921fp13;  // 2^13 quarter turns, a little less
  static constexpr double least_of_ratio = 0x1p-969;
  static constexpr double most_of_ratio = 0x1p1022;
  static constexpr std::size_t words = 6;  // of 2/π, beside those that make only whole turns
};

template <>
struct Format<float> {
  using Bits = std::uint32_t;
  static constexpr int fraction = 23;
  static constexpr int bias = 127;
  static constexpr Bits one = Bits{127} << 23;
  static constexpr Bits head = ~((Bits{1} << 12) - 1);
  static constexpr float to_integer = 0x1.8p23F;
  static constexpr float exponent_of_normal = 86;
  static constexpr float of_subnormal = 0x1p23F;
  static constexpr float own_sine = 0x1p-13F;
  static constexpr float eighth_turn = 0x1.921fb4p-1F;
  static constexpr float cody_waite = 0x1.921p5F;
  static constexpr float least_of_ratio = 0x1p-102F;
  static constexpr float most_of_ratio = 0x1p126F;
  static constexpr std::size_t words = 3;
};

template <typename Real>
[[nodiscard]] typename Format<Real>::Bits to_bits(Real x) noexcept {
  typename Format<Real>::Bits bits;
  std::memcpy(&bits, &x, sizeof bits);
  return bits;
}

template <typename Real>
[[nodiscard]] Real from_bits(typename Format<Real>::Bits bits) noexcept {
  Real x;
  std::memcpy(&x, &bits, sizeof x);
  return x;
}

template <typename Real>
[[nodiscard]] bool is_negative(Real x) noexcept {
  return to_bits(x) >> (8 * sizeof(Real) - 1) != 0;
}

template <typename Real>
[[nodiscard]] Real magnitude(Real x) noexcept {
  return std::abs(x);
}

/// 2^exponent, a normal number.
template <typename Real>
[[nodiscard]] Real power_of_two(int exponent) noexcept {
  using F = Format<Real>;
  return from_bits<Real>(static_cast<typename F::Bits>(exponent + F::bias) << F::fraction);
}

/// The integer next to a number that is much smaller than 2^fraction.
template <typename Real>
[[nodiscard]] Real nearest_integer(Real x) noexcept {
  return (x + Format<Real>::to_integer) - Format<Real>::to_integer;
}

/// Σ coefficients[k] xᵏ.
template <typename Real, std::size_t Count>
[[nodiscard]] Real horner(Real x, const std::array<Real, Count>& coefficients) noexcept {
  Real sum = coefficients[Count - 1];
  for (std::size_t k = Count - 1; k-- > 0;) {
    sum = sum * x + coefficients[k];
  }
  return sum;
}

/// x = quadrant π/2 + high + low but for whole turns, |high + low| ≤ π/4 or hardly more, and |low| at most half a unit
/// of high's last place.
template <typename Real>
struct ReducedAngle {
  Real high;
  Real low;
  unsigned quadrant;
};

/// high + low, as their rounded sum and what it lost, exactly; |high| ≥ |low|, or high = 0. (Dekker)
template <typename Real>
[[nodiscard]] ReducedAngle<Real> sum_of_parts(Real high, Real low, unsigned quadrant) noexcept {
  const Real sum = high + low;
  return {sum, (high - sum) + low, quadrant};
}

/// Payne and Hanek's reduction, for finite |x| above a few turns: of the product with 2/π only the digits are
/// calculated that are not whole turns, as an integer.
template <typename Real>
[[nodiscard]] ReducedAngle<Real> reduced_by_integers(Real x) noexcept {
  using C = Constants<Real>;
  using F = Format<Real>;
  constexpr std::size_t count = F::words;
  const typename F::Bits bits = to_bits(magnitude(x));
  // |x| = m 2^e; digits of 2/π with weights of 2^(1-e) and above make whole turns.
  const int e = static_cast<int>(bits >> F::fraction) - F::bias - F::fraction;
  const std::uint64_t m = (bits & ((typename F::Bits{1} << F::fraction) - 1)) | (typename F::Bits{1} << F::fraction);
  const std::uint64_t m_high = m >> 32;
  const std::uint64_t m_low = m & 0xffffffffU;
  const auto first = static_cast<std::size_t>(e + 62);  // NOLINT(bugprone-misplaced-widening-cast): 23 to 1033
  std::array<std::uint32_t, count + 1> product{};
  std::uint64_t carry = 0;
  std::uint64_t below = 0;
  for (std::size_t i = count; i-- > 0;) {
    const std::size_t word = first / 32 + i;
    const std::uint64_t both = (std::uint64_t{two_over_pi[word]} << 32) | two_over_pi[word + 1];
    const std::uint64_t digits = (both >> (32 - first % 32)) & 0xffffffffU;
    const std::uint64_t low = m_low * digits + carry;
    const std::uint64_t sum = m_high * below + (low & 0xffffffffU);
    product[i] = static_cast<std::uint32_t>(sum & 0xffffffffU);
    carry = (low >> 32) + (sum >> 32);
    below = digits;
  }
  // Two digits of quarter turns, then a fraction; what is above a half is that much less than the next quarter.
  const unsigned whole = product[0] >> 30;
  std::array<std::uint32_t, count> fraction{};
  for (std::size_t i = 0; i < count; ++i) {
    fraction[i] = (product[i] << 2) | (product[i + 1] >> 30);
  }
  const bool is_above = fraction[0] >> 31 != 0;
  // Four pieces, each exact as a number.
  constexpr int width = sizeof(Real) == sizeof(double) ? 32 : 16;
  std::array<Real, 4> piece{};
  for (std::size_t i = 0; i < 4; ++i) {
    const std::uint32_t word = is_above ? ~fraction[i * width / 32] : fraction[i * width / 32];
    const std::uint32_t digits = width == 32 ? word : (i % 2 == 0 ? word >> 16 : word & 0xffffU);
    piece[i] = static_cast<Real>(digits) * power_of_two<Real>(-width * static_cast<int>(i + 1));
  }
  const auto upper = sum_of_parts(piece[0], piece[1], 0);
  const auto lower = sum_of_parts(piece[2], piece[3], 0);
  const auto part = sum_of_parts(upper.high, upper.low + lower.high, 0);
  // Times π/2: the product of the upper halves is exact.
  const Real head = from_bits<Real>(to_bits(part.high) & F::head);
  const Real rest = head * C::quarter_tail + ((part.high - head) + (part.low + lower.low)) * C::quarter;
  auto result = sum_of_parts(head * C::quarter_head, rest, is_above ? whole + 1 : whole);
  if (is_above != is_negative(x)) {
    result.high = -result.high;
    result.low = -result.low;
  }
  if (is_negative(x)) {
    result.quadrant = 0U - result.quadrant;
  }
  return result;
}

/// An angle without its quarter turns: by Cody and Waite up to 2^13 of them (float: 2^5), then by integers. NaN if it
/// is not finite.
template <typename Real>
[[nodiscard]] ReducedAngle<Real> reduced(Real x) noexcept {
  using C = Constants<Real>;
  using F = Format<Real>;
  const Real size = magnitude(x);
  if (size <= F::eighth_turn) {
    return {x, Real(0), 0};
  }
  if (size <= F::cody_waite) {
    // Both products and the first difference are exact, and the second one with its error.
    const Real n = nearest_integer(x * C::per_quarter);
    const Real first = x - n * C::quarter_first;
    const Real product = n * C::quarter_second;
    const Real second = first - product;
    const Real lost = (first - second) - product;
    return sum_of_parts(second, lost - n * C::quarter_third, static_cast<unsigned>(static_cast<int>(n)));
  }
  if (size <= std::numeric_limits<Real>::max()) {
    return reduced_by_integers(x);
  }
  return {x - x, Real(0), 0};
}

}  // namespace elliptude::elementary::detail
