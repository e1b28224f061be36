#pragma once

/// \file
/// Triangles of fixed size: their inverses, squares and solutions.

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/scalar.hpp"

namespace elliptude {

namespace detail {

// A triangle is gone through column by column, or row by row. Where that is written out, by a recursion, each loop has
// a constant length.

/// Column j of `lower_inverse`, where the diagonal is done.
template <typename Scalar, int N>
ELLIPTUDE_INLINE void put_inverse_column(const Matrix<Scalar, N>& l, int j, Matrix<Scalar, N>& inverse) noexcept {
  for (int i = 0; i < j; ++i) {
    inverse(i, j) = Scalar(0);
  }
  for (int i = j + 1; i < N; ++i) {
    Scalar sum = l(i, j) * inverse(j, j);
    for (int k = j + 1; k < i; ++k) {
      sum += l(i, k) * inverse(k, j);
    }
    inverse(i, j) = -sum * inverse(i, i);
  }
}

/// Column j of `square_of_lower`, and row j.
template <typename Scalar, int N>
ELLIPTUDE_INLINE void put_square_column(const Matrix<Scalar, N>& l, int j, Matrix<Scalar, N>& square) noexcept {
  for (int i = j; i < N; ++i) {
    Scalar sum = l(N - 1, i) * l(N - 1, j);
    for (int k = i; k < N - 1; ++k) {
      sum += l(k, i) * l(k, j);
    }
    square(i, j) = sum;
    square(j, i) = sum;
  }
}

/// Row i of `solve_lower`.
template <typename Scalar, int N, int Columns>
ELLIPTUDE_INLINE void solve_row_down(const Matrix<Scalar, N>& l, int i, Matrix<Scalar, N, Columns>& x) noexcept {
  for (int k = 0; k < i; ++k) {
    x.row(i) -= l(i, k) * x.row(k);
  }
  x.row(i) *= Scalar(1) / l(i, i);
}

/// Row i of `solve_lower_transposed`.
template <typename Scalar, int N, int Columns>
ELLIPTUDE_INLINE void solve_row_up(const Matrix<Scalar, N>& l, int i, Matrix<Scalar, N, Columns>& x) noexcept {
  for (int k = i + 1; k < N; ++k) {
    x.row(i) -= l(k, i) * x.row(k);
  }
  x.row(i) *= Scalar(1) / l(i, i);
}

/// The columns of `lower_inverse` from `Column` on.
template <int Column, typename Scalar, int N>
void inverse_columns(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& inverse) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    for (int j = Column; j < N; ++j) {
      put_inverse_column(l, j, inverse);
    }
  } else if constexpr (Column < N) {
    put_inverse_column(l, Column, inverse);
    inverse_columns<Column + 1>(l, inverse);
  }
}

/// The columns of `square_of_lower` from `Column` on.
template <int Column, typename Scalar, int N>
void square_columns(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& square) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    for (int j = Column; j < N; ++j) {
      put_square_column(l, j, square);
    }
  } else if constexpr (Column < N) {
    put_square_column(l, Column, square);
    square_columns<Column + 1>(l, square);
  }
}

/// The rows of `solve_lower` from `Row` on.
template <int Row, typename Scalar, int N, int Columns>
void solve_rows_down(const Matrix<Scalar, N>& l, Matrix<Scalar, N, Columns>& x) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    for (int i = Row; i < N; ++i) {
      solve_row_down(l, i, x);
    }
  } else if constexpr (Row < N) {
    solve_row_down(l, Row, x);
    solve_rows_down<Row + 1>(l, x);
  }
}

/// The rows of `solve_lower_transposed` from `Row` on, upwards.
template <int Row, typename Scalar, int N, int Columns>
void solve_rows_up(const Matrix<Scalar, N>& l, Matrix<Scalar, N, Columns>& x) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    for (int i = Row; i >= 0; --i) {
      solve_row_up(l, i, x);
    }
  } else if constexpr (Row >= 0) {
    solve_row_up(l, Row, x);
    solve_rows_up<Row - 1>(l, x);
  }
}

}  // namespace detail

/// The inverse of a lower triangle whose diagonal has no zero.
/// \param inverse not l.
template <typename Scalar, int N>
void put_lower_inverse(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& inverse) noexcept {
  for (int j = 0; j < N; ++j) {
    inverse(j, j) = Scalar(1) / l(j, j);
  }
  detail::inverse_columns<0>(l, inverse);
}
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> lower_inverse(const Matrix<Scalar, N>& l) noexcept {
  Matrix<Scalar, N> inverse;
  put_lower_inverse(l, inverse);
  return inverse;
}

/// lᵀl of a lower triangle, exactly symmetric: for the inverse of a Cholesky factor it is the inverse of the factored
/// matrix.
/// \param square not l.
template <typename Scalar, int N>
void put_square_of_lower(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& square) noexcept {
  detail::square_columns<0>(l, square);
}
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> square_of_lower(const Matrix<Scalar, N>& l) noexcept {
  Matrix<Scalar, N> square;
  put_square_of_lower(l, square);
  return square;
}

/// a lᵀ of a lower triangle, column by column as `product_by_columns`, which it has the bits of.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> times_transposed_lower(const Matrix<Scalar, N>& a,
                                                       const Matrix<Scalar, N>& l) noexcept {
  Matrix<Scalar, N> product;
  for (int j = 0; j < N; ++j) {
    Vector<Scalar, N> column = a.col(0) * l(j, 0);
    for (int k = 1; k <= j; ++k) {
      column += a.col(k) * l(j, k);
    }
    product.col(j) = column;
  }
  return product;
}

/// l p lᵀ of a lower triangle and an exactly symmetric p, symmetric but for rounding.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> congruence_of_lower(const Matrix<Scalar, N>& l, const Matrix<Scalar, N>& p) noexcept {
  const Matrix<Scalar, N> product = times_transposed_lower(p, l).transpose();
  return times_transposed_lower(product, l);
}

/// x with l x = b, for a lower triangle whose diagonal has no zero; b may have any number of columns.
template <typename Scalar, int N, int Columns>
[[nodiscard]] Matrix<Scalar, N, Columns> solve_lower(const Matrix<Scalar, N>& l,
                                                     const Matrix<Scalar, N, Columns>& b) noexcept {
  Matrix<Scalar, N, Columns> x = b;
  detail::solve_rows_down<0>(l, x);
  return x;
}

/// x with lᵀ x = b; see `solve_lower`.
template <typename Scalar, int N, int Columns>
[[nodiscard]] Matrix<Scalar, N, Columns> solve_lower_transposed(const Matrix<Scalar, N>& l,
                                                                const Matrix<Scalar, N, Columns>& b) noexcept {
  Matrix<Scalar, N, Columns> x = b;
  detail::solve_rows_up<N - 1>(l, x);
  return x;
}

/// Householder's triangularisation: turns the columns of a, with at least as many rows, into an upper triangle R with
/// RᵀR = aᵀa, without forming aᵀa, and applies the same reflections to b. What is below the triangle is left undefined.
template <typename Scalar, int Rows, int N>
void triangularize(Matrix<Scalar, Rows, N>& a, Vector<Scalar, Rows>& b) noexcept {
  static_assert(Rows >= N);
  for (int j = 0; j < N; ++j) {
    Scalar square(0);
    for (int i = j; i < Rows; ++i) {
      square += a(i, j) * a(i, j);
    }
    const Scalar length = scalar::sqrt(square);
    if (!(length > Scalar(0))) {
      continue;
    }
    // The reflection of column j on the axis, on the side where nothing cancels; v is left in the column.
    const Scalar target = a(j, j) > Scalar(0) ? Scalar(-length) : length;
    a(j, j) -= target;
    const Scalar scale = Scalar(-1) / (target * a(j, j));  // 2 / vᵀv
    for (int k = j + 1; k < N; ++k) {
      Scalar product(0);
      for (int i = j; i < Rows; ++i) {
        product += a(i, j) * a(i, k);
      }
      product *= scale;
      for (int i = j; i < Rows; ++i) {
        a(i, k) -= product * a(i, j);
      }
    }
    Scalar product(0);
    for (int i = j; i < Rows; ++i) {
      product += a(i, j) * b(i);
    }
    product *= scale;
    for (int i = j; i < Rows; ++i) {
      b(i) -= product * a(i, j);
    }
    a(j, j) = target;
  }
}

}  // namespace elliptude
