#pragma once

/// \file
/// Factorisations of small matrices of fixed size, as plain loops: no blocked path that would link `malloc`, a bounded
/// number of operations, and any scalar type. Acceptance tests are written so that NaN fails them.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <utility>

#include "elliptude/base/scalar.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude {

/// Whether entries (i, j) and (j, i) differ by at most √ε of the largest entry: input may have been stored with half the digits.
/// NaN off the diagonal is refused, on it perhaps not.
template <typename Scalar, int N>
[[nodiscard]] bool is_symmetric(const Matrix<Scalar, N>& a) noexcept {
  const Scalar tolerance = scalar::sqrt(Scalar(scalar::epsilon<Scalar>)) * a.cwiseAbs().maxCoeff();
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

/// The columns of `cholesky` from `Column` on. A recursion, so that each loop has a constant length and is unrolled: half the
/// instructions.
template <int Column, typename Scalar, int N>
[[nodiscard]] bool cholesky_columns(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& factor) noexcept {
  if constexpr (Column < N) {
    Scalar pivot = a(Column, Column);
    for (int k = 0; k < Column; ++k) {
      pivot -= factor(Column, k) * factor(Column, k);
    }
    if (!scalar::all(pivot > Scalar(0)) || !scalar::isfinite(pivot)) {
      return false;
    }
    const Scalar diagonal = scalar::sqrt(pivot);
    const Scalar inverse = Scalar(1) / diagonal;
    factor.col(Column).template head<Column>().setZero();
    factor(Column, Column) = diagonal;
    for (int i = Column + 1; i < N; ++i) {
      Scalar entry = a(i, Column);
      for (int k = 0; k < Column; ++k) {
        entry -= factor(i, k) * factor(Column, k);
      }
      factor(i, Column) = entry * inverse;
    }
    return cholesky_columns<Column + 1>(a, factor);
  } else {
    return true;
  }
}

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

/// The lower triangle l with a = l lᵀ of a symmetric positive definite matrix, of which the lower triangle is read.
/// \return `not_positive_definite` if a pivot is not positive (or is NaN).
template <typename Scalar, int N>
[[nodiscard]] Status cholesky(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& l) noexcept {
  Matrix<Scalar, N> factor;
  if (!detail::cholesky_columns<0>(a, factor)) {
    return Status::not_positive_definite;
  }
  l = factor;
  return Status::ok;
}

/// As `cholesky`, of a positive semidefinite matrix such as the shape of a flat ellipsoid. A row and column of zeros gives
/// a column of zeros in l. Where a pivot is of the size of rounding, the matrix is factored again with a raised diagonal: by
/// 2N(N+1)ε of each aⱼⱼ, more than the factorization loses (Higham, Accuracy and Stability, theorem 10.7), and if that is not
/// enough by as much of the largest, since the entries of I − nnᵀ, say, err by a share of one and not of themselves. So l lᵀ is
/// a or a little more, and an ellipsoid factored in this way does not shrink by it. Raising the small pivot alone would not
/// do: the errors of the entries below it would be divided by its root.
/// \return `not_positive_definite` if a is more negative than rounding explains, or an entry of its diagonal is negative.
template <typename Scalar, int N>
[[nodiscard]] Status cholesky_semidefinite(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& l) noexcept {
  const Scalar rounding = Scalar(2 * N * (N + 1)) * Scalar(scalar::epsilon<Scalar>);
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
        raised(j, j) = Scalar(1);  // stands alone, and is taken out again below
        present(j) = Scalar(0);
      }
    }
  }
  Matrix<Scalar, N> factor;
  Status status = cholesky(raised, factor);
  bool accurate = status == Status::ok;
  for (int j = 0; j < N; ++j) {
    accurate = accurate && factor(j, j) * factor(j, j) > rounding * raised(j, j);
  }
  if (!accurate) {
    raised.diagonal() *= Scalar(1) + rounding;
    status = cholesky(raised, factor);
  }
  if (status != Status::ok) {
    raised.diagonal().array() += rounding * a.diagonal().maxCoeff();
    status = cholesky(raised, factor);
  }
  if (status != Status::ok) {
    return status;
  }
  l = factor;
  l.diagonal().array() *= present.array();
  return Status::ok;
}

/// The inverse of a lower triangle whose diagonal has no zero.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> lower_inverse(const Matrix<Scalar, N>& l) noexcept {
  Matrix<Scalar, N> inverse;
  for (int j = 0; j < N; ++j) {
    inverse(j, j) = Scalar(1) / l(j, j);
  }
  detail::inverse_columns<0>(l, inverse);
  return inverse;
}

/// lᵀl of a lower triangle, exactly symmetric: of the inverse of a Cholesky factor it is the inverse of what was factored.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> square_of_lower(const Matrix<Scalar, N>& l) noexcept {
  Matrix<Scalar, N> square;
  detail::square_columns<0>(l, square);
  return square;
}

/// A symmetric positive definite matrix as l diag(1/p) lᵀ with a unit lower triangle l: Cholesky's factor without its roots, each
/// of which has to wait for the one before.
template <typename Scalar, int N>
struct RootFreeFactor {
  Matrix<Scalar, N> l;  ///< below the diagonal; the rest is undefined
  Vector<Scalar, N> p;  ///< inverse pivots
};

namespace detail {

/// The columns of `factorize` from `Column` on; `scaled` is l diag(1/p).
template <int Column, typename Scalar, int N>
[[nodiscard]] bool root_free_columns(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& scaled,
                                     RootFreeFactor<Scalar, N>& factor) noexcept {
  if constexpr (Column < N) {
    Scalar pivot = a(Column, Column);
    for (int k = 0; k < Column; ++k) {
      pivot -= factor.l(Column, k) * scaled(Column, k);
    }
    if (!scalar::all(pivot > Scalar(0)) || !scalar::isfinite(pivot)) {
      return false;
    }
    factor.p(Column) = Scalar(1) / pivot;
    for (int i = Column + 1; i < N; ++i) {
      Scalar entry = a(i, Column);
      for (int k = 0; k < Column; ++k) {
        entry -= factor.l(i, k) * scaled(Column, k);
      }
      scaled(i, Column) = entry;
      factor.l(i, Column) = entry * factor.p(Column);
    }
    return root_free_columns<Column + 1>(a, scaled, factor);
  } else {
    return true;
  }
}

/// The columns of the inverse of a unit lower triangle from `Column` on.
template <int Column, typename Scalar, int N>
void unit_inverse_columns(const Matrix<Scalar, N>& l, Matrix<Scalar, N>& inverse) noexcept {
  if constexpr (Column < N) {
    inverse.col(Column).template head<Column>().setZero();
    inverse(Column, Column) = Scalar(1);
    for (int i = Column + 1; i < N; ++i) {
      Scalar sum = l(i, Column);
      for (int k = Column + 1; k < i; ++k) {
        sum += l(i, k) * inverse(k, Column);
      }
      inverse(i, Column) = -sum;
    }
    unit_inverse_columns<Column + 1>(l, inverse);
  }
}

template <int Row, typename Scalar, int N>
void solve_unit_down(const Matrix<Scalar, N>& l, Vector<Scalar, N>& x) noexcept {
  if constexpr (Row < N) {
    for (int k = 0; k < Row; ++k) {
      x(Row) -= l(Row, k) * x(k);
    }
    solve_unit_down<Row + 1>(l, x);
  }
}

template <int Row, typename Scalar, int N>
void solve_unit_up(const Matrix<Scalar, N>& l, Vector<Scalar, N>& x) noexcept {
  if constexpr (Row >= 0) {
    for (int k = Row + 1; k < N; ++k) {
      x(Row) -= l(k, Row) * x(k);
    }
    solve_unit_up<Row - 1>(l, x);
  }
}

}  // namespace detail

/// \return `not_positive_definite` if a pivot is not positive (or is NaN).
template <typename Scalar, int N>
[[nodiscard]] Status factorize(const Matrix<Scalar, N>& a, RootFreeFactor<Scalar, N>& factor) noexcept {
  Matrix<Scalar, N> scaled;
  return detail::root_free_columns<0>(a, scaled, factor) ? Status::ok : Status::not_positive_definite;
}

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

/// The inverse of any regular matrix, by Gauss and Jordan's elimination with the largest pivot of each column.
/// \return `not_finite` if there is no inverse, or it is beyond all numbers.
template <typename Scalar, int N>
[[nodiscard]] Status inverse_of(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& inverse) noexcept {
  // Row by row: a beside what becomes its inverse.
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
  const Matrix<Scalar, N> result = rows.template rightCols<N>();
  if (!scalar::all_finite(result)) {
    return Status::not_finite;
  }
  inverse = result;
  return Status::ok;
}

/// x with l x = b, for a lower triangle whose diagonal has no zero; b may have any number of columns.
template <typename Scalar, int N, int Columns>
[[nodiscard]] Matrix<Scalar, N, Columns> solve_lower(const Matrix<Scalar, N>& l,
                                                     const Matrix<Scalar, N, Columns>& b) noexcept {
  Matrix<Scalar, N, Columns> x = b;
  detail::solve_rows_down<0>(l, x);
  return x;
}

/// x with lᵀ x = b, as `solve_lower`.
template <typename Scalar, int N, int Columns>
[[nodiscard]] Matrix<Scalar, N, Columns> solve_lower_transposed(const Matrix<Scalar, N>& l,
                                                                const Matrix<Scalar, N, Columns>& b) noexcept {
  Matrix<Scalar, N, Columns> x = b;
  detail::solve_rows_up<N - 1>(l, x);
  return x;
}

/// The inverse of a symmetric positive definite matrix, exactly symmetric.
/// \return `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status inverse_positive_definite(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& inverse) noexcept {
  Matrix<Scalar, N> l;
  if (const Status status = cholesky(a, l); status != Status::ok) {
    return status;
  }
  inverse = square_of_lower(lower_inverse(l));
  return Status::ok;
}

/// The inverse of a symmetric positive definite matrix or less, so that yᵀ inverse y ≤ yᵀa⁻¹y for all y whatever rounding does: a
/// set {yᵀa⁻¹y ≤ 1} loses no point, however thin. The diagonal is raised by more than a Cholesky factor loses; with L that factor,
/// its computed inverse is (I + E) L⁻¹, ‖E‖ ≤ ½Nε κ², κ = ‖|L⁻¹||L|‖ (Higham, Accuracy and Stability, section 14.2), and the square
/// of that errs by as much again: 8Nε κ² of it is taken away. Where that would be much of it, a is taken a little larger,
/// and the set a little less thin.
/// \return `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status inverse_from_below(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& inverse) noexcept {
  const Scalar epsilon(scalar::epsilon<Scalar>);
  Matrix<Scalar, N> raised = a;
  raised.diagonal() *= Scalar(1) + Scalar(2 * N * (N + 1)) * epsilon;
  Scalar added = Scalar(256 * N) * epsilon * a.trace();
  for (int attempt = 0; attempt < 4; ++attempt) {
    Matrix<Scalar, N> l;
    if (const Status status = cholesky(raised, l); status != Status::ok) {
      return status;
    }
    const Matrix<Scalar, N> root = lower_inverse(l);
    const Scalar share = Scalar(8 * N) * epsilon * root.cwiseAbs().lazyProduct(l.cwiseAbs()).squaredNorm();  // ≥ 8Nε κ²
    if (share < scalar::constant<Scalar>(0.125L)) {
      inverse = (Scalar(1) - share) * square_of_lower(root);
      return Status::ok;
    }
    raised.diagonal().array() += added;
    added *= Scalar(16);
  }
  return Status::not_positive_definite;
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

/// Eigenvalues, largest first, and the orthonormal eigenvectors of a symmetric matrix, as columns in the same order.
template <typename Scalar, int N>
struct SymmetricEigen {
  Vector<Scalar, N> values;
  Matrix<Scalar, N> vectors;
};

/// Jacobi's cyclic method: small eigenvalues of graded matrices come out with nearly full digits.
/// \return `not_finite`, or `not_converged` after a bounded number of sweeps (not seen; quadratic convergence takes 4 to 7).
template <typename Scalar, int N>
[[nodiscard]] Status symmetric_eigen(const Matrix<Scalar, N>& symmetric, SymmetricEigen<Scalar, N>& eigen) noexcept {
  if (!scalar::all_finite(symmetric)) {
    return Status::not_finite;
  }
  Matrix<Scalar, N> a = symmetrized(symmetric);
  Matrix<Scalar, N> vectors = Matrix<Scalar, N>::Identity();
  constexpr int most_sweeps = 30;
  bool converged = false;
  for (int sweep = 0; sweep < most_sweeps && !converged; ++sweep) {
    converged = true;
    for (int p = 0; p < N - 1; ++p) {
      for (int q = p + 1; q < N; ++q) {
        const Scalar off = a(p, q);
        const Scalar diagonal = scalar::sqrt(scalar::abs(a(p, p))) * scalar::sqrt(scalar::abs(a(q, q)));
        const Scalar largest = a.cwiseAbs().maxCoeff();
        if (scalar::abs(off) <= Scalar(scalar::epsilon<Scalar>) * diagonal ||
            scalar::abs(off) <= Scalar(std::numeric_limits<scalar::Value<Scalar>>::min()) ||
            scalar::abs(off) <= Scalar(scalar::epsilon<Scalar>) * Scalar(scalar::epsilon<Scalar>) * largest) {
          continue;
        }
        converged = false;
        // The rotation that makes entry (p, q) zero, of at most 45 degrees.
        const Scalar cotangent = (a(q, q) - a(p, p)) / (Scalar(2) * off);
        const Scalar root = scalar::sqrt(Scalar(Scalar(1) + cotangent * cotangent));
        const Scalar tangent =
            cotangent >= Scalar(0) ? Scalar(Scalar(1) / (cotangent + root)) : Scalar(Scalar(-1) / (root - cotangent));
        const Scalar cosine = Scalar(1) / scalar::sqrt(Scalar(Scalar(1) + tangent * tangent));
        const Scalar sine = tangent * cosine;
        for (int k = 0; k < N; ++k) {
          const Scalar akp = a(k, p);
          const Scalar akq = a(k, q);
          a(k, p) = cosine * akp - sine * akq;
          a(k, q) = sine * akp + cosine * akq;
        }
        for (int k = 0; k < N; ++k) {
          const Scalar apk = a(p, k);
          const Scalar aqk = a(q, k);
          a(p, k) = cosine * apk - sine * aqk;
          a(q, k) = sine * apk + cosine * aqk;
          const Scalar vkp = vectors(k, p);
          const Scalar vkq = vectors(k, q);
          vectors(k, p) = cosine * vkp - sine * vkq;
          vectors(k, q) = sine * vkp + cosine * vkq;
        }
        a(p, q) = Scalar(0);
        a(q, p) = Scalar(0);
      }
    }
  }
  if (!converged) {
    return Status::not_converged;
  }
  for (int i = 0; i < N - 1; ++i) {
    int largest = i;
    for (int j = i + 1; j < N; ++j) {
      if (a(j, j) > a(largest, largest)) {
        largest = j;
      }
    }
    std::swap(a(i, i), a(largest, largest));
    vectors.col(i).swap(vectors.col(largest));
  }
  eigen.values = a.diagonal();
  eigen.vectors = vectors;
  return Status::ok;
}

/// A singular value decomposition within SO(3): a = U diag(σ₁, σ₂, s₃) Vᵀ with U and V rotations, σ₁ ≥ σ₂ ≥ |s₃|. The
/// last value carries the sign of det a, which is what Wahba's problem needs.
template <typename Scalar>
struct RotationSvd {
  Matrix3<Scalar> u;
  Vector3<Scalar> values;
  Matrix3<Scalar> v;
};

/// By one-sided Jacobi rotations (Hestenes). Of a matrix of rank one the second vectors are chosen freely.
/// \return `not_finite`; `out_of_range` for the zero matrix; `not_converged`.
template <typename Scalar>
[[nodiscard]] Status rotation_svd(const Matrix3<Scalar>& a, RotationSvd<Scalar>& svd) noexcept {
  if (!scalar::all_finite(a)) {
    return Status::not_finite;
  }
  const Scalar size = a.cwiseAbs().maxCoeff();
  if (!(size > Scalar(0))) {
    return Status::out_of_range;
  }
  Matrix3<Scalar> columns = a / size;
  Matrix3<Scalar> v = Matrix3<Scalar>::Identity();
  const Scalar epsilon(scalar::epsilon<Scalar>);
  constexpr int most_sweeps = 30;
  bool converged = false;
  for (int sweep = 0; sweep < most_sweeps && !converged; ++sweep) {
    converged = true;
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        const Scalar pp = columns.col(p).squaredNorm();
        const Scalar qq = columns.col(q).squaredNorm();
        const Scalar pq = columns.col(p).dot(columns.col(q));
        // Columns at right angles to rounding, of which a product of three terms takes some, or so short that their angle is
        // rounding.
        if (scalar::abs(pq) <= Scalar(4) * epsilon * scalar::sqrt(Scalar(pp * qq)) ||
            scalar::abs(pq) <= epsilon * epsilon) {
          continue;
        }
        converged = false;
        const Scalar cotangent = (qq - pp) / (Scalar(2) * pq);
        const Scalar root = scalar::sqrt(Scalar(Scalar(1) + cotangent * cotangent));
        const Scalar tangent =
            cotangent >= Scalar(0) ? Scalar(Scalar(1) / (cotangent + root)) : Scalar(Scalar(-1) / (root - cotangent));
        const Scalar cosine = Scalar(1) / scalar::sqrt(Scalar(Scalar(1) + tangent * tangent));
        const Scalar sine = tangent * cosine;
        const Vector3<Scalar> column = columns.col(p);
        columns.col(p) = cosine * column - sine * columns.col(q);
        columns.col(q) = sine * column + cosine * columns.col(q);
        const Vector3<Scalar> vp = v.col(p);
        v.col(p) = cosine * vp - sine * v.col(q);
        v.col(q) = sine * vp + cosine * v.col(q);
      }
    }
  }
  if (!converged) {
    return Status::not_converged;
  }
  Vector3<Scalar> lengths(columns.col(0).norm(), columns.col(1).norm(), columns.col(2).norm());
  for (int i = 0; i < 2; ++i) {
    for (int j = i + 1; j < 3; ++j) {
      if (lengths(j) > lengths(i)) {
        std::swap(lengths(i), lengths(j));
        columns.col(i).swap(columns.col(j));
        v.col(i).swap(v.col(j));
      }
    }
  }
  Vector3<Scalar> u1 = columns.col(0) / lengths(0);
  Vector3<Scalar> u2;
  if (lengths(1) > Scalar(4) * epsilon * epsilon) {
    // So short a column may have passed the test above at an angle.
    u2 = (columns.col(1) - u1.dot(columns.col(1)) * u1).normalized();
  } else {  // rank one: any direction at right angles to u1, made from the axis least along it
    int least = 0;
    u1.cwiseAbs().minCoeff(&least);
    u2 = u1.cross(Vector3<Scalar>::Unit(least)).normalized();
  }
  svd.u.col(0) = u1;
  svd.u.col(1) = u2;
  svd.u.col(2) = u1.cross(u2);
  svd.v = v;
  svd.v.col(2) = Vector3<Scalar>(v.col(0)).cross(Vector3<Scalar>(v.col(1)));
  // The third column of a V is s₃ u₃, whatever sign the swaps have left on it.
  const Vector3<Scalar> third = a * svd.v.col(2);
  svd.values << size * lengths(0), size * lengths(1), svd.u.col(2).dot(third);
  return Status::ok;
}

/// aᵀa, exactly symmetric.
template <typename Scalar, int Rows, int Columns>
[[nodiscard]] Matrix<Scalar, Columns> gram_of(const Matrix<Scalar, Rows, Columns>& a) noexcept {
  Matrix<Scalar, Columns> gram;
  for (int j = 0; j < Columns; ++j) {
    for (int i = 0; i <= j; ++i) {
      gram(i, j) = a.col(i).dot(a.col(j));
      gram(j, i) = gram(i, j);
    }
  }
  return gram;
}

/// An upper bound of the largest singular value of B with BᵀB = gram: the largest eigenvalue is within √(N − 1) standard deviations
/// of the mean of all (Samuelson's inequality), and the traces of the gram matrix and of its square give both. Too large by at most
/// √((1 + √N)/2), or √N where the fourth power of the result is beyond the numbers' range; only by rounding where all singular
/// values are alike, or all but one are zero.
template <typename Scalar, int N>
[[nodiscard]] Scalar norm_of_gram(const Matrix<Scalar, N>& gram) noexcept {
  static_assert(N <= 6);  // rounding is counted for that
  using Value = scalar::Value<Scalar>;
  const Scalar trace = gram.trace();
  const Scalar mean = trace / Scalar(N);
  const Scalar square = mean * mean;
  if (!(square > Scalar(std::numeric_limits<Value>::min() / std::numeric_limits<Value>::epsilon()))) {
    // The squares are lost; the trace bounds it too.
    return scalar::sqrt(trace < Scalar(0) ? Scalar(-trace) : trace);
  }
  const Scalar variance = gram.squaredNorm() / Scalar(N) - square;
  const Scalar rounding = Scalar(64) * Scalar(scalar::epsilon<Scalar>) * square;
  const Scalar most = Scalar(N - 1) * ((variance < Scalar(0) ? Scalar(0) : variance) + rounding);
  return scalar::sqrt(Scalar(mean + scalar::sqrt(most)));
}

/// An upper bound of the largest singular value.
template <typename Scalar, int Rows, int Columns>
[[nodiscard]] Scalar spectral_norm(const Matrix<Scalar, Rows, Columns>& matrix) noexcept {
  if constexpr (Rows <= Columns) {
    const Matrix<Scalar, Rows> gram = matrix.lazyProduct(matrix.transpose());
    return norm_of_gram(gram);
  } else {
    return norm_of_gram(gram_of(matrix));
  }
}

}  // namespace elliptude
