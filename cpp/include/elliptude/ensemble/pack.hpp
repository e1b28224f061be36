#pragma once

/// \file
/// Several numbers that move together in SIMD registers, a scalar for the library's templates: the same code as for one
/// body moves `Width` bodies. For compilers with vector extensions (GCC, Clang).

#include <cmath>

#include "elliptude/base/scalar.hpp"

namespace elliptude {

/// One truth value a lane: what comparing two packs gives.
template <typename Number, int Width>
struct PackMask {
  static_assert(sizeof(Number) == sizeof(long long) || sizeof(Number) == sizeof(int));
  using Integer = std::conditional_t<sizeof(Number) == sizeof(long long), long long, int>;
  using Lanes [[gnu::vector_size(sizeof(Number) * Width)]] = Integer;  // all bits set, or none

  Lanes lanes;

  friend PackMask operator&&(const PackMask& a, const PackMask& b) noexcept { return {a.lanes & b.lanes}; }
  friend PackMask operator||(const PackMask& a, const PackMask& b) noexcept { return {a.lanes | b.lanes}; }
  friend PackMask operator!(const PackMask& a) noexcept { return {~a.lanes}; }
  friend bool all_of(const PackMask& a) noexcept {
    Integer all = a.lanes[0];
    for (int i = 1; i < Width; ++i) {
      all &= a.lanes[i];
    }
    return all != 0;
  }
};

/// `Width` numbers, one for each of as many bodies.
template <typename Number, int Width>
struct Pack {
  using Lanes [[gnu::vector_size(sizeof(Number) * Width)]] = Number;
  using Mask = PackMask<Number, Width>;

  Lanes lanes;

  Pack() noexcept = default;
  /// A constant stands wherever a number does.
  Pack(Number x) noexcept : lanes(x - Lanes{}) {}  // NOLINT(google-explicit-constructor)
  explicit Pack(const Lanes& x) noexcept : lanes(x) {}

  [[nodiscard]] Number operator[](std::size_t lane) const noexcept { return lanes[lane]; }
  void set(std::size_t lane, Number x) noexcept { lanes[lane] = x; }

  Pack& operator+=(const Pack& b) noexcept { return *this = *this + b; }
  Pack& operator-=(const Pack& b) noexcept { return *this = *this - b; }
  Pack& operator*=(const Pack& b) noexcept { return *this = *this * b; }
  Pack& operator/=(const Pack& b) noexcept { return *this = *this / b; }

  friend Pack operator-(const Pack& a) noexcept { return Pack(-a.lanes); }
  friend Pack operator+(const Pack& a, const Pack& b) noexcept { return Pack(a.lanes + b.lanes); }
  friend Pack operator-(const Pack& a, const Pack& b) noexcept { return Pack(a.lanes - b.lanes); }
  friend Pack operator*(const Pack& a, const Pack& b) noexcept { return Pack(a.lanes * b.lanes); }
  friend Pack operator/(const Pack& a, const Pack& b) noexcept { return Pack(a.lanes / b.lanes); }

  friend Mask operator==(const Pack& a, const Pack& b) noexcept { return {a.lanes == b.lanes}; }
  friend Mask operator<(const Pack& a, const Pack& b) noexcept { return {a.lanes < b.lanes}; }
  friend Mask operator>(const Pack& a, const Pack& b) noexcept { return {a.lanes > b.lanes}; }
  friend Mask operator<=(const Pack& a, const Pack& b) noexcept { return {a.lanes <= b.lanes}; }
  friend Mask operator>=(const Pack& a, const Pack& b) noexcept { return {a.lanes >= b.lanes}; }

  friend Pack select(const Mask& mask, const Pack& a, const Pack& b) noexcept {
    return Pack(mask.lanes ? a.lanes : b.lanes);
  }

  friend Pack abs(const Pack& a) noexcept { return select(a < Pack(Number(0)), -a, a); }
  friend Pack sqrt(const Pack& a) noexcept {
    return map(a, [](Number x) { return std::sqrt(x); });
  }
  // Bodies often have the same time, and one angle for all.
  friend Pack sin(const Pack& a) noexcept {
    return all_of(a == Pack(a[0])) ? Pack(elementary::sin(a[0])) : map(a, [](Number x) { return elementary::sin(x); });
  }
  friend Pack cos(const Pack& a) noexcept {
    return all_of(a == Pack(a[0])) ? Pack(elementary::cos(a[0])) : map(a, [](Number x) { return elementary::cos(x); });
  }

  friend Pack exp(const Pack& a) noexcept {
    return map(a, [](Number x) { return elementary::exp(x); });
  }
  friend Pack log(const Pack& a) noexcept {
    return map(a, [](Number x) { return elementary::log(x); });
  }
  friend Pack atan2(const Pack& y, const Pack& x) noexcept {
    Pack result;
    for (int i = 0; i < Width; ++i) {
      result.lanes[i] = elementary::atan2(y.lanes[i], x.lanes[i]);
    }
    return result;
  }

  template <typename Function>
  [[nodiscard]] static Pack map(const Pack& a, const Function& function) noexcept {
    Pack result;
    for (int i = 0; i < Width; ++i) {
      result.lanes[i] = function(a.lanes[i]);
    }
    return result;
  }
};

template <typename Number, int Width>
struct ScalarTraits<Pack<Number, Width>> {
  using Value = Number;
};

/// Puts a matrix of numbers into one lane of a matrix of packs.
template <typename Number, int Width, int Rows, int Columns>
void set_lane(Matrix<Pack<Number, Width>, Rows, Columns>& packed, std::size_t i,
              const Matrix<Number, Rows, Columns>& one) noexcept {
  for (int k = 0; k < Rows * Columns; ++k) {
    packed.data()[k].set(i, one.data()[k]);
  }
}

/// One lane of a matrix of packs.
template <typename Number, int Width, int Rows, int Columns>
[[nodiscard]] Matrix<Number, Rows, Columns> lane(const Matrix<Pack<Number, Width>, Rows, Columns>& packed,
                                                 std::size_t i) noexcept {
  Matrix<Number, Rows, Columns> one;
  for (int k = 0; k < Rows * Columns; ++k) {
    one.data()[k] = packed.data()[k][i];
  }
  return one;
}

}  // namespace elliptude

namespace Eigen {

template <typename Number, int Width>
struct NumTraits<elliptude::Pack<Number, Width>> : NumTraits<Number> {
  using Real = elliptude::Pack<Number, Width>;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Number;
  enum { RequireInitialization = 0, ReadCost = 1, AddCost = 1, MulCost = 1 };
};

}  // namespace Eigen
