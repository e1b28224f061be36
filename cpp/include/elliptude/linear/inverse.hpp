#pragma once

/// \file
/// Inverses of small matrices: of any regular one, of a positive definite one, and of a shape whose ellipsoid must lose
/// no point.

#include <utility>

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/cholesky.hpp"
#include "elliptude/linear/triangular.hpp"

namespace elliptude {

/// The inverse of any regular matrix, by Gauss and Jordan's elimination with the largest pivot of each column.
/// \return `not_finite` if there is no inverse, or it overflows.
template <typename Scalar, int N>
[[nodiscard]] Status inverse_of(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& inverse) noexcept {
  // Row by row: a, and beside it the future inverse.
  Eigen::Matrix<Scalar, N, 2 * N, Eigen::RowMajor> rows;
  rows.template leftCols<N>() = a;
  rows.template rightCols<N>().setIdentity();
  for (int j = 0; j < N; ++j) {
    int pivot = j;
    for (int i = j + 1; i < N; ++i) {
      pivot = scalar::abs(Scalar(rows(i, j))) > scalar::abs(Scalar(rows(pivot, j))) ? i : pivot;
    }
    if (pivot != j) {
      rows.row(j).swap(rows.row(pivot));
    }
    rows.row(j) *= Scalar(1) / rows(j, j);
    for (int i = 0; i < N; ++i) {
      if (i != j) {
        rows.row(i) -= Scalar(rows(i, j)) * rows.row(j);
      }
    }
  }
  if (!scalar::all_finite(rows.template rightCols<N>())) {
    return Status::not_finite;
  }
  inverse = rows.template rightCols<N>();
  return Status::ok;
}

/// The inverse of a symmetric positive definite matrix, exactly symmetric.
/// \return `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status inverse_positive_definite(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& inverse) noexcept {
  Matrix<Scalar, N> l;
  if (const Status status = put_cholesky(a, l); status != Status::ok) {
    return status;
  }
  inverse = square_of_lower(lower_inverse(l));
  return Status::ok;
}

/// A root of the inverse of a symmetric positive definite matrix or less, so that (1 − share) ‖root y‖² ≤ yᵀa⁻¹y for
/// all y whatever rounding does: a set {yᵀa⁻¹y ≤ 1} loses no point, however thin. The diagonal is raised by more than a
/// Cholesky factor loses; with L that factor, its computed inverse is (I + E) L⁻¹, ‖E‖ ≤ ½Nε κ², κ = ‖|L⁻¹||L|‖ (Higham,
/// Accuracy and Stability, section 14.2), and the square of that errs by as much again: the share is 8Nε κ². If that
/// would be much, a is enlarged a little first, and the set becomes a little less thin.
/// \param root a lower triangle.
/// \return `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status inverse_root_from_below(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& root,
                                             Scalar& share) noexcept {
  Matrix<Scalar, N> raised = a;
  raised.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::cholesky(N));
  Scalar added = rounding::share<Scalar>(rounding::inverse_widening(N)) * a.trace();
  for (int attempt = 0; attempt < 4; ++attempt) {
    Matrix<Scalar, N> l;
    if (const Status status = put_cholesky(raised, l); status != Status::ok) {
      return status;
    }
    root = lower_inverse(l);
    share = rounding::share<Scalar>(rounding::inverse(N)) *
            root.cwiseAbs().lazyProduct(l.cwiseAbs()).squaredNorm();  // ≥ 8Nε κ²
    if (share < scalar::constant<Scalar>(0.125L)) {
      return Status::ok;
    }
    raised.diagonal().array() += added;
    added *= Scalar(16);
  }
  return Status::not_positive_definite;
}

/// The inverse of a symmetric positive definite matrix or less, so that yᵀ inverse y ≤ yᵀa⁻¹y for all y whatever
/// rounding does.
/// \return `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status inverse_from_below(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& inverse) noexcept {
  Matrix<Scalar, N> root;
  Scalar share;
  if (const Status status = inverse_root_from_below(a, root, share); status != Status::ok) {
    return status;
  }
  inverse = (Scalar(1) - share) * square_of_lower(root);
  return Status::ok;
}

}  // namespace elliptude
