#pragma once

/// \file
/// Cholesky's factorisation of small matrices of fixed size, with roots and without, as plain loops: no blocked path
/// that would link `malloc`, a bounded number of operations, and any scalar type. Acceptance tests are written so that
/// NaN fails them.

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude {

/// Whether entries (i, j) and (j, i) differ by at most √ε of the largest entry: input may have been stored with half
/// the digits. NaN off the diagonal is refused; NaN on the diagonal may pass.
template <typename Scalar, int N>
[[nodiscard]] bool is_symmetric(const Matrix<Scalar, N>& a) noexcept {
  const Scalar tolerance = rounding::root<Scalar>() * scalar::largest_size(a);
  for (int j = 0; j < N; ++j) {
    for (int i = j + 1; i < N; ++i) {
      if (!scalar::all(scalar::abs(Scalar(a(i, j) - a(j, i))) <= tolerance)) {
        return false;
      }
    }
  }
  return true;
}

namespace detail {

/// Whether a factor goes on from a pivot: it is positive and finite, in all lanes.
struct IsPivot {
  template <typename Scalar>
  [[nodiscard]] bool operator()(const Scalar& pivot) const noexcept {
    return scalar::all(pivot > Scalar(0)) && scalar::isfinite(pivot);
  }
};

/// Column j of `cholesky`.
/// \param accepts is given the pivot, and says whether to go on, as `IsPivot` does.
template <typename Scalar, int N, typename Accepts>
[[nodiscard]] ELLIPTUDE_INLINE bool put_cholesky_column(const Matrix<Scalar, N>& a, int j, Matrix<Scalar, N>& factor,
                                                        const Accepts& accepts) noexcept {
  Scalar pivot = a(j, j);
  for (int k = 0; k < j; ++k) {
    pivot -= factor(j, k) * factor(j, k);
  }
  if (!accepts(pivot)) {
    return false;
  }
  const Scalar diagonal = scalar::sqrt(pivot);
  const Scalar inverse = Scalar(1) / diagonal;
  for (int i = 0; i < j; ++i) {
    factor(i, j) = Scalar(0);
  }
  factor(j, j) = diagonal;
  for (int i = j + 1; i < N; ++i) {
    Scalar entry = a(i, j);
    for (int k = 0; k < j; ++k) {
      entry -= factor(i, k) * factor(j, k);
    }
    factor(i, j) = entry * inverse;
  }
  return true;
}

/// The columns of `cholesky` from `Column` on. A recursion, where it is written out, so that each loop has a constant
/// length and is unrolled: half the instructions.
template <int Column, typename Scalar, int N, typename Accepts>
[[nodiscard]] bool cholesky_columns(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& factor, Accepts accepts) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    bool accepted = true;
    for (int j = Column; accepted && j < N; ++j) {
      accepted = put_cholesky_column(a, j, factor, accepts);
    }
    return accepted;
  } else if constexpr (Column < N) {
    return put_cholesky_column(a, Column, factor, accepts) && cholesky_columns<Column + 1>(a, factor, accepts);
  } else {
    return true;
  }
}

}  // namespace detail

/// `cholesky` that leaves l of no use where it is not `ok`.
/// \param l not a.
template <typename Scalar, int N>
[[nodiscard]] Status put_cholesky(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& l) noexcept {
  return detail::cholesky_columns<0>(a, l, detail::IsPivot()) ? Status::ok : Status::not_positive_definite;
}

/// The lower triangle l with a = l lᵀ of a symmetric positive definite matrix, of which the lower triangle is read.
/// \return `not_positive_definite` if a pivot is not positive (or is NaN).
template <typename Scalar, int N>
[[nodiscard]] Status cholesky(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& l) noexcept {
  Matrix<Scalar, N> factor;
  const Status status = put_cholesky(a, factor);
  if (status == Status::ok) {
    l = factor;
  }
  return status;
}

/// Whether a symmetric matrix has a factor.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool is_positive_definite(const Matrix<Scalar, N>& a) noexcept {
  Matrix<Scalar, N> l;
  return put_cholesky(a, l) == Status::ok;
}

/// Whether a finite matrix is symmetric and positive definite.
/// \return `not_symmetric`, `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status validate_definite(const Matrix<Scalar, N>& a) noexcept {
  if (!is_symmetric(a)) {
    return Status::not_symmetric;
  }
  return is_positive_definite(a) ? Status::ok : Status::not_positive_definite;
}

namespace detail {

/// Whether each pivot of a factor is more than rounding, a share of the matrix's own diagonal.
template <typename Scalar, int N>
[[nodiscard]] bool has_accurate_pivots(const Matrix<Scalar, N>& a, const Matrix<Scalar, N>& factor,
                                       const Scalar& rounding) noexcept {
  bool accurate = true;
  for (int j = 0; j < N; ++j) {
    accurate = accurate && factor(j, j) * factor(j, j) > rounding * a(j, j);
  }
  return accurate;
}

}  // namespace detail

/// `cholesky` for a positive semidefinite matrix such as the shape of a flat ellipsoid. A row and column of zeros gives
/// a column of zeros in l. Where a pivot is of the size of rounding, the matrix is factored again with a raised
/// diagonal: by 2N(N+1)ε of each aⱼⱼ, more than the factorization loses (Higham, Accuracy and Stability, theorem 10.7),
/// and if that is not enough by as much of the largest, as the entries of I − nnᵀ, for example, err relative to one and
/// not to themselves. So l lᵀ is a or a little more, and an ellipsoid factored in this way does not shrink by it.
/// Raising the small pivot alone would not do: the errors of the entries below it would be divided by its root.
/// \return `not_positive_definite` if a is more negative than rounding explains, or an entry of its diagonal is
/// negative.
template <typename Scalar, int N>
[[nodiscard]] Status cholesky_semidefinite(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& l) noexcept {
  const Scalar rounding = rounding::share<Scalar>(rounding::cholesky(N));
  Matrix<Scalar, N> factor;
  Status status = put_cholesky(a, factor);
  if (status == Status::ok && detail::has_accurate_pivots(a, factor, rounding)) {
    l = factor;
    return Status::ok;
  }
  Matrix<Scalar, N> raised = a;
  Vector<Scalar, N> present = Vector<Scalar, N>::Ones();
  for (int j = 0; j < N; ++j) {
    if (!(a(j, j) >= Scalar(0))) {
      return Status::not_positive_definite;
    }
    if (a(j, j) == Scalar(0)) {
      bool zeros = true;
      for (int i = 0; i < N; ++i) {
        zeros = zeros && (i < j ? a(j, i) : a(i, j)) == Scalar(0);
      }
      if (zeros) {
        raised(j, j) = Scalar(1);  // stands alone, and is removed again below
        present(j) = Scalar(0);
      }
    }
  }
  status = put_cholesky(raised, factor);
  if (status != Status::ok || !detail::has_accurate_pivots(raised, factor, rounding)) {
    raised.diagonal() *= Scalar(1) + rounding;
    status = put_cholesky(raised, factor);
  }
  if (status != Status::ok) {
    raised.diagonal().array() += rounding * a.diagonal().maxCoeff();
    status = put_cholesky(raised, factor);
  }
  if (status != Status::ok) {
    return status;
  }
  l = factor;
  l.diagonal().array() *= present.array();
  return Status::ok;
}

/// A symmetric positive definite matrix as l diag(1/p) lᵀ with a unit lower triangle l: Cholesky's factor without its
/// roots, each of which would have to wait for the one before.
template <typename Scalar, int N>
struct RootFreeFactor {
  Matrix<Scalar, N> l;  ///< below the diagonal; the rest is undefined
  Vector<Scalar, N> p;  ///< inverse pivots
};

namespace detail {

/// Column j of `factorize`; `scaled` is l diag(1/p), `accepts` as for `put_cholesky_column`.
template <typename Scalar, int N, typename Accepts>
[[nodiscard]] ELLIPTUDE_INLINE bool put_root_free_column(const Matrix<Scalar, N>& a, int j, Matrix<Scalar, N>& scaled,
                                                         RootFreeFactor<Scalar, N>& factor,
                                                         const Accepts& accepts) noexcept {
  Scalar pivot = a(j, j);
  for (int k = 0; k < j; ++k) {
    pivot -= factor.l(j, k) * scaled(j, k);
  }
  if (!accepts(pivot)) {
    return false;
  }
  factor.p(j) = Scalar(1) / pivot;
  for (int i = j + 1; i < N; ++i) {
    Scalar entry = a(i, j);
    for (int k = 0; k < j; ++k) {
      entry -= factor.l(i, k) * scaled(j, k);
    }
    scaled(i, j) = entry;
    factor.l(i, j) = entry * factor.p(j);
  }
  return true;
}

/// The columns of `factorize` from `Column` on.
template <int Column, typename Scalar, int N, typename Accepts>
[[nodiscard]] bool root_free_columns(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& scaled,
                                     RootFreeFactor<Scalar, N>& factor, Accepts accepts) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    bool accepted = true;
    for (int j = Column; accepted && j < N; ++j) {
      accepted = put_root_free_column(a, j, scaled, factor, accepts);
    }
    return accepted;
  } else if constexpr (Column < N) {
    return put_root_free_column(a, Column, scaled, factor, accepts) &&
           root_free_columns<Column + 1>(a, scaled, factor, accepts);
  } else {
    return true;
  }
}

/// Column j of the inverse of a unit lower triangle.
template <typename Scalar, int N>
ELLIPTUDE_INLINE void put_unit_inverse_column(const Matrix<Scalar, N>& l, int j, Matrix<Scalar, N>& inverse) noexcept {
  for (int i = 0; i < j; ++i) {
    inverse(i, j) = Scalar(0);
  }
  inverse(j, j) = Scalar(1);
  for (int i = j + 1; i < N; ++i) {
    Scalar sum = l(i, j);
    for (int k = j + 1; k < i; ++k) {
      sum += l(i, k) * inverse(k, j);
    }
    inverse(i, j) = -sum;
  }
}

/// The columns from `Column` on.
template <int Column, typename Scalar, int N>
void unit_inverse_columns(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& inverse) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    for (int j = Column; j < N; ++j) {
      put_unit_inverse_column(l, j, inverse);
    }
  } else if constexpr (Column < N) {
    put_unit_inverse_column(l, Column, inverse);
    unit_inverse_columns<Column + 1>(l, inverse);
  }
}

/// Row i of `solve`, down and up.
template <typename Scalar, int N>
ELLIPTUDE_INLINE void solve_unit_row_down(const Matrix<Scalar, N>& l, int i, Vector<Scalar, N>& x) noexcept {
  for (int k = 0; k < i; ++k) {
    x(i) -= l(i, k) * x(k);
  }
}
template <typename Scalar, int N>
ELLIPTUDE_INLINE void solve_unit_row_up(const Matrix<Scalar, N>& l, int i, Vector<Scalar, N>& x) noexcept {
  for (int k = i + 1; k < N; ++k) {
    x(i) -= l(k, i) * x(k);
  }
}

template <int Row, typename Scalar, int N>
void solve_unit_down(const Matrix<Scalar, N>& l, Vector<Scalar, N>& x) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    for (int i = Row; i < N; ++i) {
      solve_unit_row_down(l, i, x);
    }
  } else if constexpr (Row < N) {
    solve_unit_row_down(l, Row, x);
    solve_unit_down<Row + 1>(l, x);
  }
}

template <int Row, typename Scalar, int N>
void solve_unit_up(const Matrix<Scalar, N>& l, Vector<Scalar, N>& x) noexcept {
  if constexpr (!is_written_out<N*(N + 1) / 2>) {
    for (int i = Row; i >= 0; --i) {
      solve_unit_row_up(l, i, x);
    }
  } else if constexpr (Row >= 0) {
    solve_unit_row_up(l, Row, x);
    solve_unit_up<Row - 1>(l, x);
  }
}

}  // namespace detail

/// \return `not_positive_definite` if a pivot is not positive (or is NaN).
template <typename Scalar, int N>
[[nodiscard]] Status factorize(const Matrix<Scalar, N>& a, RootFreeFactor<Scalar, N>& factor) noexcept {
  Matrix<Scalar, N> scaled;
  const bool has_pivots = detail::root_free_columns<0>(a, scaled, factor, detail::IsPivot());
  return has_pivots ? Status::ok : Status::not_positive_definite;
}

/// The same of a Cholesky factor whose diagonal has no zero.
template <typename Scalar, int N>
[[nodiscard]] RootFreeFactor<Scalar, N> without_roots(const Matrix<Scalar, N>& l) noexcept {
  const Vector<Scalar, N> inverse = l.diagonal().cwiseInverse();
  return {l * inverse.asDiagonal(), inverse.cwiseAbs2()};
}

namespace detail {

/// Whether each pivot of a factor is more than rounding, a share of the matrix's own diagonal. No branch depends on a
/// number.
template <typename Scalar, int N>
[[nodiscard]] auto has_accurate_pivots(const Matrix<Scalar, N>& a, const RootFreeFactor<Scalar, N>& factor) noexcept {
  const Scalar rounding = rounding::share<Scalar>(rounding::cholesky(N));
  auto accurate = rounding * a(0, 0) * factor.p(0) < Scalar(1);
  for (int j = 1; j < N; ++j) {
    accurate = accurate && rounding * a(j, j) * factor.p(j) < Scalar(1);
  }
  return accurate;
}

}  // namespace detail

/// The lower triangle r with a⁻¹ = rᵀr.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> inverse_root(const RootFreeFactor<Scalar, N>& factor) noexcept {
  Matrix<Scalar, N> root;
  detail::unit_inverse_columns<0>(factor.l, root);
  const Vector<Scalar, N> scale = factor.p.cwiseSqrt();
  root.array().colwise() *= scale.array();
  return root;
}

/// x with a x = b.
template <typename Scalar, int N>
[[nodiscard]] Vector<Scalar, N> solve(const RootFreeFactor<Scalar, N>& factor, const Vector<Scalar, N>& b) noexcept {
  Vector<Scalar, N> x = b;
  detail::solve_unit_down<0>(factor.l, x);
  x.array() *= factor.p.array();
  detail::solve_unit_up<N - 1>(factor.l, x);
  return x;
}

}  // namespace elliptude
