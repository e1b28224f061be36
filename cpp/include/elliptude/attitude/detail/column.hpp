#pragma once

/// \file
/// Columns of 3 × 3 matrices that stay in registers, where Eigen's would go through memory.

#include "elliptude/base/scalar.hpp"

namespace elliptude::detail {

/// Three numbers.
template <typename Scalar>
struct Triple {
  Scalar x;
  Scalar y;
  Scalar z;

  Triple() noexcept = default;
  Triple(const Scalar& first, const Scalar& second, const Scalar& third) noexcept : x(first), y(second), z(third) {}

  /// As a column of Eigen's.
  [[nodiscard]] Vector3<Scalar> vector() const noexcept { return {x, y, z}; }

  friend Triple operator+(const Triple& a, const Triple& b) noexcept { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend Triple operator-(const Triple& a, const Triple& b) noexcept { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  /// Entry by entry.
  friend Triple operator*(const Triple& a, const Triple& b) noexcept { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
  friend Triple operator*(const Scalar& s, const Triple& a) noexcept { return {s * a.x, s * a.y, s * a.z}; }
  friend Scalar sum(const Triple& a) noexcept { return a.x + a.y + a.z; }
  friend Triple cross(const Triple& a, const Triple& b) noexcept {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
};

#if defined(__AVX__) && (defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 12))
/// Three numbers in one register of four, with the results that they have as a `Triple`.
template <typename Number>
struct RegisterTriple {
  using Lanes [[gnu::vector_size(4 * sizeof(Number))]] = Number;

  Lanes lanes;

  RegisterTriple() noexcept = default;
  explicit RegisterTriple(const Lanes& x) noexcept : lanes(x) {}
  RegisterTriple(Number x, Number y, Number z) noexcept : lanes{x, y, z, Number(0)} {}

  [[nodiscard]] Vector3<Number> vector() const noexcept { return {lanes[0], lanes[1], lanes[2]}; }

  friend RegisterTriple operator+(const RegisterTriple& a, const RegisterTriple& b) noexcept {
    return RegisterTriple(a.lanes + b.lanes);
  }
  friend RegisterTriple operator-(const RegisterTriple& a, const RegisterTriple& b) noexcept {
    return RegisterTriple(a.lanes - b.lanes);
  }
  friend RegisterTriple operator*(const RegisterTriple& a, const RegisterTriple& b) noexcept {
    return RegisterTriple(a.lanes * b.lanes);
  }
  friend RegisterTriple operator*(Number s, const RegisterTriple& a) noexcept { return RegisterTriple(s * a.lanes); }
  friend Number sum(const RegisterTriple& a) noexcept { return a.lanes[0] + a.lanes[1] + a.lanes[2]; }
  friend RegisterTriple cross(const RegisterTriple& a, const RegisterTriple& b) noexcept {
    return RegisterTriple(turned(a.lanes * turned(b.lanes) - turned(a.lanes) * b.lanes));
  }

 private:
  /// y, z, x.
  [[nodiscard]] static Lanes turned(const Lanes& a) noexcept { return __builtin_shufflevector(a, a, 1, 2, 0, 3); }
};

template <typename Scalar>
using Column = std::conditional_t<scalar::is_elementary<Scalar>, RegisterTriple<Scalar>, Triple<Scalar>>;
#else
template <typename Scalar>
using Column = Triple<Scalar>;
#endif

template <typename Three>
[[nodiscard]] auto dot(const Three& a, const Three& b) noexcept {
  return sum(a * b);
}

/// A 3 × 3 matrix.
template <typename Scalar>
using Columns = std::array<Column<Scalar>, 3>;

/// (adj M)ᵀ.
template <typename Three>
[[nodiscard]] std::array<Three, 3> cofactors(const std::array<Three, 3>& m) noexcept {
  return {cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])};
}

template <typename Three>
[[nodiscard]] auto sum_of_squares(const std::array<Three, 3>& m) noexcept {
  return sum(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
}

}  // namespace elliptude::detail
