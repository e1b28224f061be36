#pragma once

/// \file
/// Dual numbers: a value and its gradient with respect to N variables, carried through arithmetic by the chain rule. The
/// library's templates run on them as they are, so that a derivative written by hand can be compared with one that is not.

#include <Eigen/Core>
#include <cmath>

namespace elliptude::testing {

template <int N>
struct Dual {
  double value = 0;
  Eigen::Matrix<double, N, 1> gradient = Eigen::Matrix<double, N, 1>::Zero();

  Dual() = default;
  Dual(double constant) : value(constant) {}  // implicit: a constant stands wherever a number does
  Dual(double v, const Eigen::Matrix<double, N, 1>& g) : value(v), gradient(g) {}

  /// The variable number `index` of the N.
  [[nodiscard]] static Dual variable(double v, int index) { return {v, Eigen::Matrix<double, N, 1>::Unit(index)}; }

  Dual& operator+=(const Dual& b) { return *this = *this + b; }
  Dual& operator-=(const Dual& b) { return *this = *this - b; }
  Dual& operator*=(const Dual& b) { return *this = *this * b; }
  Dual& operator/=(const Dual& b) { return *this = *this / b; }

  friend Dual operator+(const Dual& a) { return a; }
  friend Dual operator-(const Dual& a) { return {-a.value, -a.gradient}; }
  friend Dual operator+(const Dual& a, const Dual& b) { return {a.value + b.value, a.gradient + b.gradient}; }
  friend Dual operator-(const Dual& a, const Dual& b) { return {a.value - b.value, a.gradient - b.gradient}; }
  friend Dual operator*(const Dual& a, const Dual& b) {
    return {a.value * b.value, a.gradient * b.value + a.value * b.gradient};
  }
  friend Dual operator/(const Dual& a, const Dual& b) {
    const double quotient = a.value / b.value;
    return {quotient, (a.gradient - quotient * b.gradient) / b.value};
  }

  friend bool operator==(const Dual& a, const Dual& b) { return a.value == b.value; }
  friend bool operator!=(const Dual& a, const Dual& b) { return a.value != b.value; }
  friend bool operator<(const Dual& a, const Dual& b) { return a.value < b.value; }
  friend bool operator>(const Dual& a, const Dual& b) { return a.value > b.value; }
  friend bool operator<=(const Dual& a, const Dual& b) { return a.value <= b.value; }
  friend bool operator>=(const Dual& a, const Dual& b) { return a.value >= b.value; }

  friend Dual sqrt(const Dual& x) {
    const double root = std::sqrt(x.value);
    return {root, x.gradient / (2 * root)};
  }
  friend Dual sin(const Dual& x) { return {std::sin(x.value), std::cos(x.value) * x.gradient}; }
  friend Dual cos(const Dual& x) { return {std::cos(x.value), -std::sin(x.value) * x.gradient}; }
  friend Dual exp(const Dual& x) { return {std::exp(x.value), std::exp(x.value) * x.gradient}; }
  friend Dual log(const Dual& x) { return {std::log(x.value), x.gradient / x.value}; }
  friend Dual abs(const Dual& x) { return x.value < 0 ? -x : x; }
  friend Dual atan2(const Dual& y, const Dual& x) {
    const double square = x.value * x.value + y.value * y.value;
    return {std::atan2(y.value, x.value), (x.value * y.gradient - y.value * x.gradient) / square};
  }
};

/// `x` as N variables, the first of which is number `first`.
template <int N, int Size>
[[nodiscard]] Eigen::Matrix<Dual<N>, Size, 1> variables(const Eigen::Matrix<double, Size, 1>& x, int first = 0) {
  Eigen::Matrix<Dual<N>, Size, 1> result;
  for (int i = 0; i < Size; ++i) {
    result(i) = Dual<N>::variable(x(i), first + i);
  }
  return result;
}

/// The values of a matrix of dual numbers.
template <int N, int Rows, int Columns>
[[nodiscard]] Eigen::Matrix<double, Rows, Columns> values(const Eigen::Matrix<Dual<N>, Rows, Columns>& x) {
  return x.unaryExpr([](const Dual<N>& entry) { return entry.value; });
}

/// The derivative of each entry of a vector of dual numbers, as a row.
template <int N, int Size>
[[nodiscard]] Eigen::Matrix<double, Size, N> jacobian(const Eigen::Matrix<Dual<N>, Size, 1>& x) {
  Eigen::Matrix<double, Size, N> result;
  for (int i = 0; i < Size; ++i) {
    result.row(i) = x(i).gradient.transpose();
  }
  return result;
}

}  // namespace elliptude::testing

template <int N>
struct Eigen::NumTraits<elliptude::testing::Dual<N>> : Eigen::NumTraits<double> {
  using Real = elliptude::testing::Dual<N>;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
  enum { RequireInitialization = 1, ReadCost = 1 + N, AddCost = 1 + N, MulCost = 1 + 3 * N };
};
