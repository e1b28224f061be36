#pragma once

/// \file
/// Numbers that know how wrong they are: the value that `double` arithmetic gives and a bound of its distance from the exact
/// result, carried along operation by operation (running error analysis: Wilkinson; Higham, Accuracy and Stability, section 3.3).
/// The library's templates run on them as they are, so that a constant which is to cover rounding can be compared with a bound of
/// it, and not with errors that happened to be small.

#include <Eigen/Core>
#include <cmath>
#include <elliptude/base/rounding.hpp>
#include <limits>

namespace elliptude::testing {

struct Tracked {
  double value = 0;
  double error = 0;  ///< |value − exact| ≤ error

  Tracked() = default;
  /// A constant of the library's: exact if it is a multiple of 2⁻²⁰, else rounded. Input is made by `exactly`.
  Tracked(double constant)
      : value(constant),
        error(std::rint(std::ldexp(constant, 20)) == std::ldexp(constant, 20) ? 0 : half_ulp(constant)) {}
  Tracked(double v, double e) : value(v), error(e) {}
  [[nodiscard]] static Tracked exactly(double v) { return {v, 0}; }

  /// Largest error of an operation that gave this, rounded to nearest; the last term is that of denormal numbers.
  [[nodiscard]] static double half_ulp(double result) {
    return std::fabs(result) * (std::numeric_limits<double>::epsilon() / 2) + std::numeric_limits<double>::denorm_min();
  }
  /// Bounds are added up in double too: each sum is enlarged by more than its own rounding.
  [[nodiscard]] static double up(double bound) { return bound * (1 + 1e-14); }

  Tracked& operator+=(const Tracked& b) { return *this = *this + b; }
  Tracked& operator-=(const Tracked& b) { return *this = *this - b; }
  Tracked& operator*=(const Tracked& b) { return *this = *this * b; }
  Tracked& operator/=(const Tracked& b) { return *this = *this / b; }

  friend Tracked operator+(const Tracked& a) { return a; }
  friend Tracked operator-(const Tracked& a) { return {-a.value, a.error}; }
  friend Tracked operator+(const Tracked& a, const Tracked& b) {
    const double sum = a.value + b.value;
    // A sum with zero is exact.
    const bool exact = a.value == 0 || b.value == 0;
    return {sum, up(a.error + b.error + (exact ? 0 : half_ulp(sum)))};
  }
  friend Tracked operator-(const Tracked& a, const Tracked& b) { return a + (-b); }
  friend Tracked operator*(const Tracked& a, const Tracked& b) {
    const double product = a.value * b.value;
    const auto is_power_of_two = [](double x) {
      int exponent = 0;
      return x == 0 || std::fabs(std::frexp(x, &exponent)) == 0.5;
    };
    const bool exact = is_power_of_two(a.value) || is_power_of_two(b.value);
    return {product, up(std::fabs(a.value) * b.error + std::fabs(b.value) * a.error + a.error * b.error +
                        (exact ? 0 : half_ulp(product)))};
  }
  friend Tracked operator/(const Tracked& a, const Tracked& b) {
    const double quotient = a.value / b.value;
    const double least = std::fabs(b.value) - b.error;
    if (!(least > 0)) {
      return {quotient, std::numeric_limits<double>::infinity()};
    }
    return {quotient, up((a.error + std::fabs(quotient) * b.error) / least + half_ulp(quotient))};
  }

  friend bool operator==(const Tracked& a, const Tracked& b) { return a.value == b.value; }
  friend bool operator!=(const Tracked& a, const Tracked& b) { return a.value != b.value; }
  friend bool operator<(const Tracked& a, const Tracked& b) { return a.value < b.value; }
  friend bool operator>(const Tracked& a, const Tracked& b) { return a.value > b.value; }
  friend bool operator<=(const Tracked& a, const Tracked& b) { return a.value <= b.value; }
  friend bool operator>=(const Tracked& a, const Tracked& b) { return a.value >= b.value; }

  friend Tracked sqrt(const Tracked& x) {
    const double root = std::sqrt(x.value);
    if (x.error == 0) {
      return {root, half_ulp(root)};
    }
    // |√(x + e) − √x| ≤ |e| / (√x + √(x + e)), and ≤ √|e|.
    const double least = x.value > x.error ? std::sqrt(x.value - x.error) : 0;
    return {root, up(std::fmin(x.error / (root + least), std::sqrt(x.error)) + half_ulp(root))};
  }
  /// The functions of base/elementary.hpp err by so many units in the last place, of two half units each.
  friend Tracked sin(const Tracked& x) {
    const double sine = elementary::sin(x.value);
    return {sine,
            up(std::fabs(std::cos(x.value)) * x.error + x.error * x.error + 2 * rounding::sine_units * half_ulp(sine))};
  }
  friend Tracked cos(const Tracked& x) {
    const double cosine = elementary::cos(x.value);
    return {cosine, up(std::fabs(std::sin(x.value)) * x.error + x.error * x.error +
                       2 * rounding::sine_units * half_ulp(cosine))};
  }
  friend Tracked atan2(const Tracked& y, const Tracked& x) {
    const double angle = elementary::atan2(y.value, x.value);
    const double distance = std::hypot(y.value, x.value) - std::hypot(y.error, x.error);
    return {angle, up((y.error + x.error) / distance + 2 * rounding::atan2_units * half_ulp(angle))};
  }
  friend Tracked abs(const Tracked& x) { return {std::fabs(x.value), x.error}; }
};

/// A matrix of exact numbers.
template <int Rows, int Columns>
[[nodiscard]] Eigen::Matrix<Tracked, Rows, Columns> exactly(const Eigen::Matrix<double, Rows, Columns>& matrix) {
  return matrix.unaryExpr([](double x) { return Tracked::exactly(x); });
}
/// The bounds of the errors of a matrix's entries.
template <int Rows, int Columns>
[[nodiscard]] Eigen::Matrix<double, Rows, Columns> errors(const Eigen::Matrix<Tracked, Rows, Columns>& matrix) {
  return matrix.unaryExpr([](const Tracked& x) { return x.error; });
}
/// What `double` arithmetic gives.
template <int Rows, int Columns>
[[nodiscard]] Eigen::Matrix<double, Rows, Columns> values(const Eigen::Matrix<Tracked, Rows, Columns>& matrix) {
  return matrix.unaryExpr([](const Tracked& x) { return x.value; });
}

}  // namespace elliptude::testing

namespace Eigen {

template <>
struct NumTraits<elliptude::testing::Tracked> : NumTraits<double> {
  using Real = elliptude::testing::Tracked;
  using NonInteger = elliptude::testing::Tracked;
  using Nested = elliptude::testing::Tracked;
  using Literal = double;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 2,
    AddCost = 4,
    MulCost = 6
  };
};

}  // namespace Eigen
