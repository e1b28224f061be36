/// exp, log, sin, cos and atan2 of base/elementary.hpp, of `double` and `float`: against the C library in a wider format, at the
/// bounds of base/rounding.hpp; what C says of special numbers; and their bits, which are the same everywhere.

#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <elliptude/base/elementary.hpp>
#include <elliptude/base/rounding.hpp>
#include <vector>

#include "support/function_hashes.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

template <typename Real>
using Limits = std::numeric_limits<Real>;

/// The format in which the true value is known: of x86 `long double` for `double`, which has 11 digits more.
template <typename Real>
using Wide = std::conditional_t<std::is_same_v<Real, double>, long double, double>;

/// How far a result is from a value, in units of the last place of the value.
template <typename Real>
double units(Real result, Wide<Real> exact) {
  if (std::isnan(exact) || std::isnan(result)) {
    return std::isnan(exact) && std::isnan(result) ? 0 : Limits<double>::infinity();
  }
  int exponent = 0;
  (void)std::frexp(exact, &exponent);
  if (exponent > Limits<Real>::max_exponent) {
    return result == std::copysign(Limits<Real>::infinity(), static_cast<Real>(exact)) ? 0 : Limits<double>::infinity();
  }
  const int least = Limits<Real>::min_exponent;
  const Wide<Real> unit = std::ldexp(Wide<Real>(1), (exponent > least ? exponent : least) - Limits<Real>::digits);
  return static_cast<double>(std::fabs(static_cast<Wide<Real>>(result) - exact) / unit);
}

/// Numbers of every size, of either sign.
template <typename Real>
Real any(Random& random, int from, int to) {
  const double mantissa = random.uniform(1, 2) * (random.uniform(0, 1) < 0.5 ? -1 : 1);
  return std::ldexp(static_cast<Real>(mantissa), static_cast<int>(std::floor(random.uniform(from, to))));
}

template <typename Real>
struct Worst {
  double exp = 0, log = 0, sin = 0, cos = 0, atan2 = 0;

  static void raise(double& worst, double found) { worst = found > worst ? found : worst; }
  void try_exp(Real x) { raise(exp, units<Real>(elementary::exp(x), std::exp(static_cast<Wide<Real>>(x)))); }
  void try_log(Real x) { raise(log, units<Real>(elementary::log(x), std::log(static_cast<Wide<Real>>(x)))); }
  void try_sin_and_cos(Real x) {
    raise(sin, units<Real>(elementary::sin(x), std::sin(static_cast<Wide<Real>>(x))));
    raise(cos, units<Real>(elementary::cos(x), std::cos(static_cast<Wide<Real>>(x))));
  }
  void try_atan2(Real y, Real x) {
    raise(atan2,
          units<Real>(elementary::atan2(y, x), std::atan2(static_cast<Wide<Real>>(y), static_cast<Wide<Real>>(x))));
  }
  /// The bounds are kept, and one that is far above what is found would say little.
  void check() const {
    for (const auto& [found, bound] : {std::pair{exp, rounding::exp_units}, std::pair{log, rounding::log_units},
                                       std::pair{sin, rounding::sine_units}, std::pair{cos, rounding::sine_units},
                                       std::pair{atan2, rounding::atan2_units}}) {
      CHECK(found <= bound);
      CHECK(found > 0.5 * bound);
    }
  }
};

template <typename Real>
constexpr bool has_wide_format = Limits<Wide<Real>>::digits >= Limits<Real>::digits + 8;

}  // namespace

TEST_CASE_TEMPLATE("functions of random numbers keep their bounds", Real, double, float) {
  if (!has_wide_format<Real>) {
    return;  // long double is double: the hashes below say the rest
  }
  Random random(17);
  Worst<Real> worst;
  const int most = Limits<Real>::max_exponent;
  for (int i = 0; i < 100000; ++i) {
    worst.try_exp(static_cast<Real>(random.uniform(-1, 1) * (i % 2 == 0 ? 1.5 : 0.72 * most)));
    worst.try_log(static_cast<Real>(i % 2 == 0 ? random.uniform(0.4, 2.2)
                                               : static_cast<double>(std::fabs(any<Real>(random, -most - 10, most)))));
    const double nearby = 1.5707963267948966 * std::floor(random.uniform(-9000, 9000));
    worst.try_sin_and_cos(i % 4 == 0   ? static_cast<Real>(nearby)
                          : i % 4 == 1 ? any<Real>(random, -40, most)
                                       : static_cast<Real>(random.uniform(-4, 4) * (i % 4 == 2 ? 1 : 5000)));
    const int spread = i % 2 == 0 ? 3 : most;
    worst.try_atan2(any<Real>(random, -spread, spread), any<Real>(random, -spread, spread));
  }
  worst.check();
}

TEST_CASE("functions of every five-thousandth float keep their bounds") {
  Worst<float> worst;
  for (std::uint64_t bits = 0; bits < std::uint64_t{1} << 32; bits += 5003) {
    const auto x = elementary::detail::from_bits<float>(static_cast<std::uint32_t>(bits));
    worst.try_exp(x);
    worst.try_log(x);
    worst.try_sin_and_cos(x);
    worst.try_atan2(x, 1.0F);
    worst.try_atan2(1.7F, x);
  }
  CHECK(worst.exp <= rounding::exp_units);
  CHECK(worst.log <= rounding::log_units);
  CHECK(worst.sin <= rounding::sine_units);
  CHECK(worst.cos <= rounding::sine_units);
  CHECK(worst.atan2 <= rounding::atan2_units);
}

TEST_CASE("the angles next to quarter turns") {
  // Of all numbers that of `double` which is nearest to one (Kahan; tools/elementary.py finds its distance), and the numbers next to
  // quarter turns on both sides of where Cody and Waite's reduction ends.
  CHECK(units<double>(elementary::cos(0x1.6ac5b262ca1ffp+849), -4.68716592425462761112e-19L) < rounding::sine_units);
  CHECK(units<double>(elementary::sin(0x1.6ac5b262ca1ffp+849), 1.0L) < rounding::sine_units);
  if (!has_wide_format<double>) {
    return;
  }
  Worst<double> worst;
  for (int n = 1; n < 20000; ++n) {
    // The C library's long double sine is right to less than a thousandth of a unit.
    const auto nearest = static_cast<double>(static_cast<long double>(n) * 1.57079632679489661923132169163975144L);
    for (const double x : {nearest, std::nextafter(nearest, 0.0), -nearest}) {
      worst.try_sin_and_cos(x);
    }
  }
  CHECK(worst.sin <= rounding::sine_units);
  CHECK(worst.cos <= rounding::sine_units);
}

TEST_CASE_TEMPLATE("functions of special numbers are those of the C library", Real, double, float) {
  const Real infinity = Limits<Real>::infinity();
  const Real nan = Limits<Real>::quiet_NaN();
  std::vector<Real> special{0, -Real(0), 1, -1, infinity, -infinity, nan};
  for (const Real x : {Limits<Real>::min(), Limits<Real>::max(), Limits<Real>::denorm_min(), Real(2), Real(1e30),
                       Real(0.75), Real(1e-30)}) {
    special.push_back(x);
    special.push_back(-x);
  }
  // The same, up to the last place, with the same sign, also of zeros.
  const auto is_same = [](Real a, Real b) {
    if (std::isnan(b)) {
      return std::isnan(a);
    }
    return std::signbit(a) == std::signbit(b) &&
           (a == b || std::fabs(a - b) <= 2 * Limits<Real>::epsilon() * std::fabs(b) + Limits<Real>::denorm_min());
  };
  for (const Real x : special) {
    CAPTURE(x);
    CHECK(is_same(elementary::exp(x), std::exp(x)));
    CHECK(is_same(elementary::log(x), std::log(x)));
    CHECK(is_same(elementary::sin(x), std::sin(x)));
    CHECK(is_same(elementary::cos(x), std::cos(x)));
    for (const Real y : special) {
      CAPTURE(y);
      CHECK(is_same(elementary::atan2(y, x), std::atan2(y, x)));
    }
  }
  CHECK(elementary::exp(Real(0)) == 1);
  CHECK(elementary::log(Real(1)) == 0);
  CHECK(elementary::cos(Real(0)) == 1);
}

TEST_CASE_TEMPLATE("signs are exact: odd functions and even ones", Real, double, float) {
  Random random(19);
  for (int i = 0; i < 20000; ++i) {
    const Real x = any<Real>(random, -30, Limits<Real>::max_exponent);
    const Real y = any<Real>(random, -30, Limits<Real>::max_exponent);
    CHECK(elementary::sin(-x) == -elementary::sin(x));
    CHECK(elementary::cos(-x) == elementary::cos(x));
    CHECK(elementary::atan2(-y, x) == -elementary::atan2(y, x));
  }
}

#if !defined(__FMA__) && \
    !defined(__ARM_FEATURE_FMA)  // where a compiler may fuse, "same bits: ..." has this with other flags
TEST_CASE("the bits of the functions are the same everywhere") {
  CHECK(testing::function_hashes<double>() == testing::golden_functions_of_double);
  CHECK(testing::function_hashes<float>() == testing::golden_functions_of_float);
}
#endif
