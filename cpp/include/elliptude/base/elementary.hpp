#pragma once

/// \file
/// exp, log, sin, cos and atan2 of `double` and `float`, with errors that are proved (theory, section 17.11) and the
/// same bits with every compiler and processor of IEEE arithmetic (docs/flight.md): nothing but sums, products and
/// quotients of the type itself, and integers. They do not set errno. Infinities, NaN, signed zeros and subnormal
/// numbers are taken and given as C's functions do.
///
/// base/rounding.hpp has their errors (`exp_units` and so on), beside which half of the smallest positive number may be
/// lost.

// Sums in another order, or numbers that are taken for finite, make the proofs of this library void, and these
// functions wrong.
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || \
    (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ != 0)
#error "elliptude: the guarantee covers IEEE arithmetic: compile without -ffast-math and what it consists of"
#endif

#include "elliptude/base/detail/angle_reduction.hpp"
#include "elliptude/base/detail/elementary_constants.hpp"

// The target elliptude::same_bits defines ELLIPTUDE_SAME_BITS. No macro says whether a compiler may fuse a product and
// a sum: the target tells it not to.
#if defined(ELLIPTUDE_SAME_BITS) && \
    (!defined(EIGEN_DONT_VECTORIZE) || (defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ % 16 != 0))
#error "elliptude: the same bits everywhere need EIGEN_DONT_VECTORIZE, and arithmetic that rounds to each type"
#endif

namespace elliptude::elementary {

namespace detail {

/// x 2^exponent, for exponents twice as large as those of numbers: with one rounding if it is subnormal.
template <typename Real>
[[nodiscard]] Real scaled(Real x, int exponent) noexcept {
  const int half = exponent / 2;
  return (x * power_of_two<Real>(half)) * power_of_two<Real>(exponent - half);
}

/// log x = log (2^exponent x), for normal x.
template <typename Real>
[[nodiscard]] Real log_of_normal(Real x, int exponent) noexcept {
  using C = Constants<Real>;
  using F = Format<Real>;
  // x = 2^k m with √½ ≤ m < √2: the bits of √½ are subtracted as an integer.
  const typename F::Bits bits = to_bits(x);
  const auto shifted = static_cast<int>((bits - to_bits(C::root_half) + F::one) >> F::fraction);
  const auto power = static_cast<typename F::Bits>(static_cast<typename F::Bits>(shifted - F::bias) << F::fraction);
  const Real f = from_bits<Real>(static_cast<typename F::Bits>(bits - power)) - 1;
  const auto k = static_cast<Real>(shifted - F::bias + exponent);

  // log (1 + f) = 2 artanh s = f - f²/2 + s (f²/2 + R), s = f/(2 + f), R = 2/3 s² + 2/5 s⁴ + …
  const Real s = f / (2 + f);
  const Real z = s * s;
  const Real rest = z * horner(z, C::log);
  const Real h = Real(0.5) * (f * f);
  return k * C::ln2_high - ((h - (s * (h + rest) + k * C::ln2_low)) - f);
}

/// sin (high + low) for an angle of at most π/4, but not next to zero.
template <typename Real>
[[nodiscard]] Real sine_of_reduced(Real high, Real low) noexcept {
  const Real z = high * high;
  return high + (low + (high * z) * horner(z, Constants<Real>::sin));
}

/// cos (high + low) for an angle of at most π/4.
template <typename Real>
[[nodiscard]] Real cosine_of_reduced(Real high, Real low) noexcept {
  const Real z = high * high;
  const Real half = Real(0.5) * z;
  const Real w = 1 - half;
  return w + (((1 - w) - half) + ((z * z) * horner(z, Constants<Real>::cos) - high * low));
}

/// The sine of an angle and a number of quarter turns.
template <typename Real>
[[nodiscard]] Real sine_in_quadrant(const ReducedAngle<Real>& angle, unsigned quadrant) noexcept {
  const Real result =
      quadrant % 2 == 0 ? sine_of_reduced(angle.high, angle.low) : cosine_of_reduced(angle.high, angle.low);
  return quadrant % 4 < 2 ? result : -result;
}

/// atan2 of magnitudes `least` ≤ `most`, neither of which overflows or underflows where it matters. The sector says
/// whether y is the larger (2), and whether x is negative (1).
template <typename Real>
[[nodiscard]] Real atan_of_ratio(Real least, Real most, unsigned sector) noexcept {
  using C = Constants<Real>;
  // atan n/m = atan c + atan (n - c m)/(m + c n), for the c of 0, ½, 1 that leaves least.
  unsigned center = 0;
  Real t;
  if (least < Real(5.0 / 16) * most) {
    t = least / most;
  } else if (least < Real(23.0 / 32) * most) {
    center = 1;
    t = (least - Real(0.5) * most) / (most + Real(0.5) * least);
  } else {
    center = 2;
    t = (least - most) / (most + least);
  }
  if (sector == 1 || sector == 2) {
    t = -t;
  }
  const Real z = t * t;
  const std::size_t base = 3 * sector + center;
  return C::base_high[base] - (((t * z) * horner(z, C::atan) - C::base_low[base]) - t);
}

/// atan2 where a number is zero, infinite, very large or very small, or NaN.
template <typename Real>
[[nodiscard]] Real atan_of_special(Real least, Real most, unsigned sector) noexcept {
  using Limits = std::numeric_limits<Real>;
  if (!(least <= most)) {
    return Limits::quiet_NaN();
  }
  if (most == 0) {
    return Constants<Real>::base_high[3 * sector];
  }
  if (most > Limits::max()) {
    return atan_of_ratio(Real(least > Limits::max() ? 1 : 0), Real(1), sector);
  }
  const Real scale = most < 1 ? Format<Real>::of_subnormal : Real(0.25);
  return atan_of_ratio(least * scale, most * scale, sector);
}

}  // namespace detail

/// eˣ.
template <typename Real>
[[nodiscard]] Real exp(Real x) noexcept {
  using C = detail::Constants<Real>;
  using F = detail::Format<Real>;
  const bool is_regular = detail::magnitude(x) <= F::exponent_of_normal;
  if (!is_regular && !(detail::magnitude(x) <= 2 * F::exponent_of_normal)) {
    return x > 0 ? x * std::numeric_limits<Real>::max() : x < 0 ? Real(0) : x;
  }
  // x = k ln 2 + r: the difference with the first part is exact.
  const Real k = detail::nearest_integer(x * C::per_ln2);
  const Real high = x - k * C::ln2_high;
  const Real low = k * C::ln2_low;
  const Real r = high - low;
  const Real result = 1 + (high - (low - (r * r) * detail::horner(r, C::exp)));
  const int exponent = static_cast<int>(k);
  return is_regular ? result * detail::power_of_two<Real>(exponent) : detail::scaled(result, exponent);
}

/// The natural logarithm.
template <typename Real>
[[nodiscard]] Real log(Real x) noexcept {
  using F = detail::Format<Real>;
  using Limits = std::numeric_limits<Real>;
  if (x >= Limits::min() && x <= Limits::max()) {
    return detail::log_of_normal(x, 0);
  }
  if (x > 0 && x < 1) {
    return detail::log_of_normal(Real(x * F::of_subnormal), -F::fraction);
  }
  return x > 0 ? x : x == 0 ? -Limits::infinity() : Limits::quiet_NaN();
}

/// The sine of an angle in rad, however large.
template <typename Real>
[[nodiscard]] Real sin(Real x) noexcept {
  if (detail::magnitude(x) < detail::Format<Real>::own_sine) {
    return x;
  }
  const auto angle = detail::reduced(x);
  return detail::sine_in_quadrant(angle, angle.quadrant);
}

/// The cosine of an angle in rad, however large.
template <typename Real>
[[nodiscard]] Real cos(Real x) noexcept {
  const auto angle = detail::reduced(x);
  return detail::sine_in_quadrant(angle, angle.quadrant + 1);
}

/// The angle from (1, 0) to (x, y), from -π to π, rad.
template <typename Real>
[[nodiscard]] Real atan2(Real y, Real x) noexcept {
  using F = detail::Format<Real>;
  const Real height = detail::magnitude(y);
  const Real width = detail::magnitude(x);
  const bool is_steep = height > width;
  const Real most = is_steep ? height : width;
  const Real least = is_steep ? width : height;
  const unsigned sector = (is_steep ? 2U : 0U) + (detail::is_negative(x) ? 1U : 0U);
  const bool is_regular = most >= F::least_of_ratio && most <= F::most_of_ratio && least <= most;
  const Real angle =
      is_regular ? detail::atan_of_ratio(least, most, sector) : detail::atan_of_special(least, most, sector);
  return detail::is_negative(y) ? -angle : angle;
}

}  // namespace elliptude::elementary
