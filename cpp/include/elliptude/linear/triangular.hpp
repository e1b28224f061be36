#pragma once

/// \file
/// Triangles of fixed size: their inverses, squares and solutions.

#include "elliptude/base/scalar.hpp"

namespace elliptude {

namespace detail {

/// The columns of `lower_inverse` from `Column` on, where the diagonal is done.
template <int Column, typename Scalar, int N>
void inverse_columns(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& inverse) noexcept {
  if constexpr (Column < N) {
    inverse.col(Column).template head<Column>().setZero();
    for (int i = Column + 1; i < N; ++i) {
      Scalar sum = l(i, Column) * inverse(Column, Column);
      for (int k = Column + 1; k < i; ++k) {
        sum += l(i, k) * inverse(k, Column);
      }
      inverse(i, Column) = -sum * inverse(i, i);
    }
    inverse_columns<Column + 1>(l, inverse);
  }
}

/// The columns of `square_of_lower` from `Column` on.
template <int Column, typename Scalar, int N>
void square_columns(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& square) noexcept {
  if constexpr (Column < N) {
    for (int i = Column; i < N; ++i) {
      Scalar sum = l(N - 1, i) * l(N - 1, Column);
      for (int k = i; k < N - 1; ++k) {
        sum += l(k, i) * l(k, Column);
      }
      square(i, Column) = sum;
      square(Column, i) = sum;
    }
    square_columns<Column + 1>(l, square);
  }
}

/// The rows of `solve_lower` from `Row` on.
template <int Row, typename Scalar, int N, int Columns>
void solve_rows_down(const Matrix<Scalar, N>& l, Matrix<Scalar, N, Columns>& x) noexcept {
  if constexpr (Row < N) {
    for (int k = 0; k < Row; ++k) {
      x.row(Row) -= l(Row, k) * x.row(k);
    }
    x.row(Row) *= Scalar(1) / l(Row, Row);
    solve_rows_down<Row + 1>(l, x);
  }
}

/// The rows of `solve_lower_transposed` from `Row` on, upwards.
template <int Row, typename Scalar, int N, int Columns>
void solve_rows_up(const Matrix<Scalar, N>& l, Matrix<Scalar, N, Columns>& x) noexcept {
  if constexpr (Row >= 0) {
    for (int k = Row + 1; k < N; ++k) {
      x.row(Row) -= l(k, Row) * x.row(k);
    }
    x.row(Row) *= Scalar(1) / l(Row, Row);
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
