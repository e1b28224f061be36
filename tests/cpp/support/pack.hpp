#pragma once

/// \file
/// Four doubles that move together, as a SIMD register holds them: the least that the library asks of such a scalar.
/// Comparisons give a mask with one truth value a lane, so that code which branches on one number does not compile.

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <elliptude/base/scalar.hpp>

namespace elliptude::testing {

constexpr std::size_t pack_size = 4;

struct Mask {
  std::array<bool, pack_size> lanes{};

  friend Mask operator&&(const Mask& a, const Mask& b) {
    return combine(a, b, [](bool x, bool y) { return x && y; });
  }
  friend Mask operator||(const Mask& a, const Mask& b) {
    return combine(a, b, [](bool x, bool y) { return x || y; });
  }
  friend Mask operator!(const Mask& a) {
    return combine(a, a, [](bool x, bool) { return !x; });
  }
  friend bool all_of(const Mask& a) { return a.lanes[0] && a.lanes[1] && a.lanes[2] && a.lanes[3]; }

  template <typename Function>
  [[nodiscard]] static Mask combine(const Mask& a, const Mask& b, const Function& function) {
    Mask result;
    for (std::size_t i = 0; i < pack_size; ++i) {
      result.lanes[i] = function(a.lanes[i], b.lanes[i]);
    }
    return result;
  }
};

struct Lanes {
  std::array<double, pack_size> lanes{};

  Lanes() = default;
  Lanes(double x) : lanes{x, x, x, x} {}  // implicit: a constant stands wherever a number does

  template <typename Function>
  [[nodiscard]] static Lanes map(const Lanes& a, const Lanes& b, const Function& function) {
    Lanes result;
    for (std::size_t i = 0; i < pack_size; ++i) {
      result.lanes[i] = function(a.lanes[i], b.lanes[i]);
    }
    return result;
  }
  template <typename Function>
  [[nodiscard]] static Mask compare(const Lanes& a, const Lanes& b, const Function& function) {
    Mask result;
    for (std::size_t i = 0; i < pack_size; ++i) {
      result.lanes[i] = function(a.lanes[i], b.lanes[i]);
    }
    return result;
  }

  Lanes& operator+=(const Lanes& b) { return *this = *this + b; }
  Lanes& operator-=(const Lanes& b) { return *this = *this - b; }
  Lanes& operator*=(const Lanes& b) { return *this = *this * b; }
  Lanes& operator/=(const Lanes& b) { return *this = *this / b; }

  friend Lanes operator-(const Lanes& a) {
    return map(a, a, [](double x, double) { return -x; });
  }
  friend Lanes operator+(const Lanes& a, const Lanes& b) {
    return map(a, b, [](double x, double y) { return x + y; });
  }
  friend Lanes operator-(const Lanes& a, const Lanes& b) {
    return map(a, b, [](double x, double y) { return x - y; });
  }
  friend Lanes operator*(const Lanes& a, const Lanes& b) {
    return map(a, b, [](double x, double y) { return x * y; });
  }
  friend Lanes operator/(const Lanes& a, const Lanes& b) {
    return map(a, b, [](double x, double y) { return x / y; });
  }

  friend Mask operator==(const Lanes& a, const Lanes& b) {
    return compare(a, b, [](double x, double y) { return x == y; });
  }
  friend Mask operator<(const Lanes& a, const Lanes& b) {
    return compare(a, b, [](double x, double y) { return x < y; });
  }
  friend Mask operator>(const Lanes& a, const Lanes& b) { return b < a; }
  friend Mask operator<=(const Lanes& a, const Lanes& b) {
    return compare(a, b, [](double x, double y) { return x <= y; });
  }
  friend Mask operator>=(const Lanes& a, const Lanes& b) { return b <= a; }

  friend Lanes select(const Mask& mask, const Lanes& a, const Lanes& b) {
    Lanes result;
    for (std::size_t i = 0; i < pack_size; ++i) {
      result.lanes[i] = mask.lanes[i] ? a.lanes[i] : b.lanes[i];
    }
    return result;
  }

  friend Lanes sqrt(const Lanes& a) {
    return map(a, a, [](double x, double) { return std::sqrt(x); });
  }
  friend Lanes sin(const Lanes& a) {
    return map(a, a, [](double x, double) { return scalar::sin(x); });
  }
  friend Lanes cos(const Lanes& a) {
    return map(a, a, [](double x, double) { return scalar::cos(x); });
  }
  friend Lanes exp(const Lanes& a) {
    return map(a, a, [](double x, double) { return scalar::exp(x); });
  }
  friend Lanes log(const Lanes& a) {
    return map(a, a, [](double x, double) { return scalar::log(x); });
  }
  friend Lanes abs(const Lanes& a) {
    return map(a, a, [](double x, double) { return std::abs(x); });
  }
  friend Lanes atan2(const Lanes& a, const Lanes& b) {
    return map(a, b, [](double y, double x) { return scalar::atan2(y, x); });
  }
};

/// Lane `lane` of each entry.
template <int Rows, int Columns>
[[nodiscard]] Eigen::Matrix<double, Rows, Columns> lane_of(const Eigen::Matrix<Lanes, Rows, Columns>& x,
                                                           std::size_t lane) {
  return x.unaryExpr([lane](const Lanes& entry) { return entry.lanes[lane]; });
}

/// Four matrices as one of packs.
template <int Rows, int Columns>
[[nodiscard]] Eigen::Matrix<Lanes, Rows, Columns> pack(
    const std::array<Eigen::Matrix<double, Rows, Columns>, pack_size>& matrices) {
  Eigen::Matrix<Lanes, Rows, Columns> result;
  for (int j = 0; j < Columns; ++j) {
    for (int i = 0; i < Rows; ++i) {
      for (std::size_t lane = 0; lane < pack_size; ++lane) {
        result(i, j).lanes[lane] = matrices[lane](i, j);
      }
    }
  }
  return result;
}

}  // namespace elliptude::testing

template <>
struct Eigen::NumTraits<elliptude::testing::Lanes> : Eigen::NumTraits<double> {
  using Real = elliptude::testing::Lanes;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
  enum { RequireInitialization = 1, ReadCost = 4, AddCost = 4, MulCost = 4 };
};
