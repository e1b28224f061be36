#pragma once

/// \file
/// What a scalar type must provide, and the matrix types of the library.
///
/// `double` and `float` work as they are, with the functions of base/elementary.hpp; `long double` with those of the C
/// library. Another type (a dual number for automatic differentiation, a pack of SIMD lanes) needs arithmetic,
/// comparisons, construction from `double`, a specialisation of `Eigen::NumTraits`, and, in its own namespace, the
/// functions below that the code it meets calls. A pack's comparisons return a mask, for which `select(mask, a, b)`,
/// `all_of(mask)` and the logical operators must exist; a status for a pack is `ok` only if every lane is.

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/unrolling.hpp"

// Eigen reads what that header sets.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>

#include "elliptude/base/elementary.hpp"

namespace elliptude {

template <typename Scalar, int Size>
using Vector = Eigen::Matrix<Scalar, Size, 1>;
template <typename Scalar, int Rows, int Columns = Rows>
using Matrix = Eigen::Matrix<Scalar, Rows, Columns>;

/// Rows of columns that are worked with whole: with SIMD registers zeros fill them, which take no part where there are
/// none.
[[nodiscard]] constexpr int padded(int rows) noexcept {
#ifdef EIGEN_VECTORIZE
  return (rows + 3) / 4 * 4;
#else
  return rows;
#endif
}

using Eigen::Matrix3;
using Eigen::Vector3;
template <typename Scalar>
using Vector6 = Vector<Scalar, 6>;
template <typename Scalar>
using Matrix6 = Matrix<Scalar, 6>;

/// The built-in type in which constants for `Scalar` are written. Specialise `Value` for a scalar whose precision is
/// not that of `double` (a pack of floats, say).
template <typename Scalar>
struct ScalarTraits {
  using Value = std::conditional_t<std::is_floating_point_v<Scalar>, Scalar, double>;
};

namespace detail {

/// Calls the `select` that stands beside a pack type; in a namespace of its own so that no other is found.
template <typename Mask, typename Scalar>
[[nodiscard]] Scalar choose(const Mask& mask, const Scalar& a, const Scalar& b) noexcept {
  return select(mask, a, b);
}

}  // namespace detail

namespace scalar {

template <typename Scalar>
using Value = typename ScalarTraits<Scalar>::Value;

/// Distance from 1 to the next number of the precision that `Scalar` calculates in.
template <typename Scalar>
constexpr Value<Scalar> epsilon = std::numeric_limits<Value<Scalar>>::epsilon();

/// A constant, given with more digits than any `Scalar` holds.
template <typename Scalar>
[[nodiscard]] constexpr Scalar constant(long double value) noexcept {
  return Scalar(static_cast<Value<Scalar>>(value));
}

/// What compares with nothing: of a quantity that nobody has set.
template <typename Scalar>
[[nodiscard]] constexpr Scalar not_a_number() noexcept {
  return Scalar(std::numeric_limits<Value<Scalar>>::quiet_NaN());
}

/// π.
template <typename Scalar>
[[nodiscard]] constexpr Scalar pi() noexcept {
  return constant<Scalar>(3.14159265358979323846264338327950288L);
}

/// Whether base/elementary.hpp has the functions of a type; those of others stand beside it, or in `std`.
template <typename Scalar>
constexpr bool is_elementary = std::is_same_v<Scalar, double> || std::is_same_v<Scalar, float>;

template <typename Scalar>
[[nodiscard]] Scalar sqrt(const Scalar& x) noexcept {
  using std::sqrt;
  return sqrt(x);
}

template <typename Scalar>
[[nodiscard]] Scalar sin(const Scalar& x) noexcept {
  if constexpr (is_elementary<Scalar>) {
    return elementary::sin(x);
  } else {
    using std::sin;
    return sin(x);
  }
}

template <typename Scalar>
[[nodiscard]] Scalar cos(const Scalar& x) noexcept {
  if constexpr (is_elementary<Scalar>) {
    return elementary::cos(x);
  } else {
    using std::cos;
    return cos(x);
  }
}

template <typename Scalar>
[[nodiscard]] Scalar atan2(const Scalar& y, const Scalar& x) noexcept {
  if constexpr (is_elementary<Scalar>) {
    return elementary::atan2(y, x);
  } else {
    using std::atan2;
    return atan2(y, x);
  }
}

template <typename Scalar>
[[nodiscard]] Scalar exp(const Scalar& x) noexcept {
  if constexpr (is_elementary<Scalar>) {
    return elementary::exp(x);
  } else {
    using std::exp;
    return exp(x);
  }
}

template <typename Scalar>
[[nodiscard]] Scalar log(const Scalar& x) noexcept {
  if constexpr (is_elementary<Scalar>) {
    return elementary::log(x);
  } else {
    using std::log;
    return log(x);
  }
}

template <typename Scalar>
[[nodiscard]] Scalar abs(const Scalar& x) noexcept {
  using std::abs;
  return abs(x);
}

/// `a` where `mask` holds, else `b`, lane by lane; both have been evaluated.
template <typename Mask, typename Scalar>
[[nodiscard]] Scalar select(const Mask& mask, const Scalar& a, const Scalar& b) noexcept {
  if constexpr (std::is_same_v<Mask, bool>) {
    return mask ? a : b;
  } else {
    return detail::choose(mask, a, b);
  }
}

/// Whether a comparison holds in every lane.
template <typename Mask>
[[nodiscard]] bool all(const Mask& mask) noexcept {
  if constexpr (std::is_same_v<Mask, bool>) {
    return mask;
  } else {
    return all_of(mask);  // found beside the scalar type
  }
}

/// Whether a number is neither NaN nor infinite, in every lane. Written with arithmetic alone, so that each scalar type
/// has it: x - x is zero for finite x only.
template <typename Scalar>
[[nodiscard]] bool isfinite(const Scalar& x) noexcept {
  return all(x - x == Scalar(0));
}

/// Whether so many numbers are finite: one sum of zeros and no branch.
template <typename Scalar>
[[nodiscard]] ELLIPTUDE_SHARED bool are_finite(const Scalar* numbers, Eigen::Index count) noexcept {
  Scalar sum(0);
  for (Eigen::Index i = 0; i < count; ++i) {
    sum += numbers[i] - numbers[i];
  }
  return isfinite(sum);
}

/// Whether every entry is finite, in the same way.
template <typename Derived>
[[nodiscard]] bool all_finite(const Eigen::MatrixBase<Derived>& matrix) noexcept {
  using Scalar = typename Derived::Scalar;
  const auto& entries = matrix.derived();
  if constexpr (elliptude::detail::has_little_code && std::is_base_of_v<Eigen::PlainObjectBase<Derived>, Derived>) {
    return are_finite(entries.data(), entries.size());
  } else {
    return isfinite(Scalar((entries - entries).sum()));
  }
}

/// The largest |entry|; of a matrix with NaN any.
template <typename Derived>
[[nodiscard]] typename Derived::Scalar largest_size(const Eigen::MatrixBase<Derived>& matrix) noexcept {
  using Scalar = typename Derived::Scalar;
  if constexpr (elliptude::detail::is_written_out<Derived::SizeAtCompileTime>) {
    return matrix.cwiseAbs().maxCoeff();
  } else {  // Eigen writes a short one out, as a sum
    Scalar largest(0);
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
      for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
        const Scalar size = abs(Scalar(matrix(i, j)));
        largest = largest < size ? size : largest;
      }
    }
    return largest;
  }
}

/// Whether the square of a vector's length has neither overflowed nor lost digits to underflow, lane by lane.
template <typename Scalar>
[[nodiscard]] auto has_precise_square(const Scalar& square) noexcept {
  using Limits = std::numeric_limits<Value<Scalar>>;
  constexpr Value<Scalar> least = Limits::min() / (Limits::epsilon() * Limits::epsilon());
  return square > Scalar(least) && square <= Scalar(Limits::max());
}

/// The same in every lane.
template <typename Scalar>
[[nodiscard]] bool is_precise_square(const Scalar& square) noexcept {
  return all(has_precise_square(square));
}

/// The length of a finite vector, however small or large its entries: Eigen's `stableNorm`, without the loop that makes
/// it cost ten times as much as the length itself.
template <typename Scalar>
[[nodiscard]] Scalar length(const Vector3<Scalar>& v) noexcept {
  const Scalar square = v.squaredNorm();
  if (is_precise_square(square)) {
    return sqrt(square);
  }
  const Scalar largest = v.cwiseAbs().maxCoeff();
  return largest > Scalar(0) ? Scalar(largest * sqrt(Scalar(Vector3<Scalar>(v / largest).squaredNorm()))) : square;
}

/// A finite vector divided by its length; zero remains zero.
template <typename Scalar>
[[nodiscard]] Vector3<Scalar> unit(const Vector3<Scalar>& v) noexcept {
  const Scalar square = v.squaredNorm();
  if (is_precise_square(square)) {
    return v / sqrt(square);
  }
  const Scalar largest = v.cwiseAbs().maxCoeff();
  if (!(largest > Scalar(0))) {
    return v;
  }
  const Vector3<Scalar> scaled = v / largest;
  return scaled / sqrt(Scalar(scaled.squaredNorm()));
}

/// Σ coefficients[k] xᵏ by Horner's rule.
template <typename Scalar, std::size_t Count>
[[nodiscard]] Scalar polynomial(const Scalar& x, const std::array<Value<Scalar>, Count>& coefficients) noexcept {
  Scalar sum(coefficients[Count - 1]);
  for (std::size_t k = Count - 1; k-- > 0;) {
    sum = sum * x + Scalar(coefficients[k]);
  }
  return sum;
}

}  // namespace scalar

/// ½ (M + Mᵀ), exactly symmetric.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> symmetrized(const Matrix<Scalar, N>& m) noexcept {
  return scalar::constant<Scalar>(0.5L) * (m + m.transpose());
}

namespace detail {

/// How many of so many rows of a product are worked with at a time: those that fill SIMD registers of up to four
/// numbers, and what is left. Eigen by itself takes two at a time where there are six, and one where there are seven.
/// Of a symmetric product, two where there are no such registers.
template <typename Scalar, bool symmetric>
[[nodiscard]] constexpr int rows_at_a_time(int rows) noexcept {
  constexpr int packet = Eigen::internal::packet_traits<Scalar>::size;
  constexpr int width = packet < 4 ? packet : 4;
  if (width == 1) {
    return symmetric && rows > 2 ? 2 : rows;
  }
  return rows > 4 ? rows - rows % width : rows;
}

/// Puts `Size` rows of a b from `first` on, in the columns from `begin` on.
template <int Size, typename A, typename B, typename Product>
void put_rows_of_product(const A& a, const B& b, Eigen::Index first, Eigen::Index begin, Product& product) noexcept {
  using Column = Vector<typename A::Scalar, Size>;
  const Eigen::Index size = Size == Eigen::Dynamic ? a.rows() : Size;
  for (Eigen::Index j = begin; j < b.cols(); ++j) {
    Column column = a.col(0).template segment<Size>(first, size) * b(0, j);
    for (Eigen::Index k = 1; k < a.cols(); ++k) {
      column += a.col(k).template segment<Size>(first, size) * b(k, j);
    }
    product.col(j).template segment<Size>(first, size) = column;
  }
}

/// Puts the rows of a b from `First` on; of a symmetric product what is above its diagonal, and some below.
template <int First, bool symmetric, typename A, typename B, typename Product>
void put_product(const A& a, const B& b, Product& product) noexcept {
  constexpr int rows = A::RowsAtCompileTime;
  constexpr int size = rows == Eigen::Dynamic ? rows : rows_at_a_time<typename A::Scalar, symmetric>(rows - First);
  put_rows_of_product<size>(a, b, First, symmetric ? First : 0, product);  // NOLINT(bugprone-branch-clone): First is 0
  if constexpr (rows != Eigen::Dynamic && First + size < rows) {
    put_product<First + size, symmetric>(a, b, product);
  }
}

}  // namespace detail

/// a b, column by column, each added up apart: a processor without SIMD keeps it in its registers, and needs half the
/// instructions of `lazyProduct`.
/// \param product neither a nor b.
template <typename A, typename B>
void put_product_by_columns(const A& a, const B& b,
                            Matrix<typename A::Scalar, A::RowsAtCompileTime, B::ColsAtCompileTime>& product) noexcept {
  product.resize(a.rows(), b.cols());  // of sizes that are known at run time alone
  detail::put_product<0, false>(a, b, product);
}
template <typename A, typename B>
[[nodiscard]] Matrix<typename A::Scalar, A::RowsAtCompileTime, B::ColsAtCompileTime> product_by_columns(
    const A& a, const B& b) noexcept {
  Matrix<typename A::Scalar, A::RowsAtCompileTime, B::ColsAtCompileTime> product;
  put_product_by_columns(a, b, product);
  return product;
}

/// T P Tᵀ, symmetric but for rounding.
template <typename T, typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, T::RowsAtCompileTime> congruence(const T& t, const Matrix<Scalar, N>& p) noexcept {
  return product_by_columns(product_by_columns(t, p), t.transpose());
}

/// The same, exactly symmetric: what is above the diagonal is calculated and mirrored.
template <typename T, typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, T::RowsAtCompileTime> symmetric_congruence(const T& t,
                                                                        const Matrix<Scalar, N>& p) noexcept {
  Matrix<Scalar, T::RowsAtCompileTime> result(t.rows(), t.rows());
  detail::put_product<0, true>(product_by_columns(t, p), t.transpose(), result);
  for (Eigen::Index j = 0; j < t.rows(); ++j) {
    for (Eigen::Index i = 0; i < j; ++i) {
      result(j, i) = result(i, j);
    }
  }
  return result;
}

}  // namespace elliptude
