#pragma once

/// \file
/// Numbers that count what is calculated with them: additions, products, quotients, roots and functions, each as one. The library's
/// templates run on them as they are. Unlike instructions, the counts do not depend on a compiler or a processor.

#include <Eigen/Core>
#include <cmath>
#include <elliptude/base/scalar.hpp>
#include <type_traits>

namespace elliptude::testing {

/// Operations since it was last set to zero, of one thread.
inline thread_local long operations = 0;

template <typename Real>
struct Counted {
  Real value = 0;

  Counted() = default;
  template <typename Number, typename = std::enable_if_t<std::is_arithmetic_v<Number>>>
  Counted(Number x) : value(static_cast<Real>(x)) {}
  template <typename Number, typename = std::enable_if_t<std::is_arithmetic_v<Number>>>
  explicit operator Number() const {
    return static_cast<Number>(value);
  }
  Counted& operator+=(const Counted& b) { return *this = *this + b; }
  Counted& operator-=(const Counted& b) { return *this = *this - b; }
  Counted& operator*=(const Counted& b) { return *this = *this * b; }
  Counted& operator/=(const Counted& b) { return *this = *this / b; }

  friend Counted operator+(const Counted& a) { return a; }
  friend Counted operator-(const Counted& a) { return {-a.value}; }
  friend Counted operator+(const Counted& a, const Counted& b) { return counted(a.value + b.value); }
  friend Counted operator-(const Counted& a, const Counted& b) { return counted(a.value - b.value); }
  friend Counted operator*(const Counted& a, const Counted& b) { return counted(a.value * b.value); }
  friend Counted operator/(const Counted& a, const Counted& b) { return counted(a.value / b.value); }

  friend bool operator==(const Counted& a, const Counted& b) { return a.value == b.value; }
  friend bool operator!=(const Counted& a, const Counted& b) { return a.value != b.value; }
  friend bool operator<(const Counted& a, const Counted& b) { return a.value < b.value; }
  friend bool operator>(const Counted& a, const Counted& b) { return a.value > b.value; }
  friend bool operator<=(const Counted& a, const Counted& b) { return a.value <= b.value; }
  friend bool operator>=(const Counted& a, const Counted& b) { return a.value >= b.value; }

  friend Counted sqrt(const Counted& x) { return counted(std::sqrt(x.value)); }
  friend Counted exp(const Counted& x) { return counted(scalar::exp(x.value)); }
  friend Counted log(const Counted& x) { return counted(scalar::log(x.value)); }
  friend Counted sin(const Counted& x) { return counted(scalar::sin(x.value)); }
  friend Counted cos(const Counted& x) { return counted(scalar::cos(x.value)); }
  friend Counted atan2(const Counted& y, const Counted& x) { return counted(scalar::atan2(y.value, x.value)); }
  friend Counted abs(const Counted& x) { return {std::fabs(x.value)}; }

 private:
  static Counted counted(Real result) {
    ++operations;
    return {result};
  }
};

}  // namespace elliptude::testing

namespace elliptude {

template <typename Real>
struct ScalarTraits<testing::Counted<Real>> {
  using Value = Real;
};

}  // namespace elliptude

namespace Eigen {

template <typename Real_>
struct NumTraits<elliptude::testing::Counted<Real_>> : NumTraits<Real_> {
  using Real = elliptude::testing::Counted<Real_>;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 1,
    AddCost = 1,
    MulCost = 1
  };
};

}  // namespace Eigen
