#pragma once

/// \file
/// What becomes of a combination that was found: its ellipsoid where rounding counts, and whether that is one.
/// (theory, section 7)

#include "elliptude/sets/detail/combination.hpp"

namespace elliptude::detail {

/// The ellipsoid of one combination of ‖w + Bu‖ ≤ 1 with the unit ball, by a triangularisation of [B; √q I]: forming
/// BᵀB, as the search does, squares the condition of B, and costs containment where the two sets differ by more than
/// that leaves.
template <typename Scalar, int N>
ELLIPTUDE_OUT_OF_LINE void recombine(const Vector<Scalar, N>& origin, const Matrix<Scalar, N>& factor,
                                     const Matrix<Scalar, N>& b, const Vector<Scalar, N>& w,
                                     const Vector<Scalar, N>& present, const Scalar& q,
                                     Ellipsoid<Scalar, N>& set) noexcept {
  Matrix<Scalar, 2 * N, N> stacked = Matrix<Scalar, 2 * N, N>::Zero();
  stacked.template topRows<N>() = b;
  const Scalar root = scalar::sqrt(q);
  for (int i = 0; i < N; ++i) {
    stacked(N + i, i) = present(i) > Scalar(0) ? root : Scalar(1);
  }
  Vector<Scalar, 2 * N> right = Vector<Scalar, 2 * N>::Zero();
  right.template head<N>() = -w;
  triangularize(stacked, right);
  const Matrix<Scalar, N> lower =
      Matrix<Scalar, N>(stacked.template topRows<N>().template triangularView<Eigen::Upper>()).transpose();
  const Vector<Scalar, N> u = solve_lower_transposed(lower, Vector<Scalar, N>(right.template head<N>()));
  const Scalar level =
      (Scalar(1) - Vector<Scalar, N>(w + b.lazyProduct(u)).squaredNorm()) + q * (Scalar(1) - u.squaredNorm());
  const Matrix<Scalar, N> half = solve_lower(lower, Matrix<Scalar, N>(factor.transpose()));
  if (level >= Scalar(0) && scalar::all_finite(u) && scalar::all_finite(half)) {
    set.center = origin + factor.lazyProduct(u);
    set.shape.noalias() = level * half.transpose().lazyProduct(half);
  }
}

/// Checks a combined set: it must be positive definite by more than rounding, or a factor of it would be luck, unless
/// the second set is flat or the two have one point in common.
/// \return `beyond_domain` otherwise: a width that cannot be represented, or a shape that rounding left indefinite.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status validate_combined(const Ellipsoid<Scalar, N>& set,
                                                             bool second_is_flat) noexcept {
  const bool may_be_flat = second_is_flat || set.shape.diagonal().sum() == Scalar(0);
  if (may_be_flat) {
    return validate(set) == Status::ok ? Status::ok : Status::beyond_domain;
  }
  Matrix<Scalar, N> lowered = set.shape;
  lowered.diagonal() *= Scalar(1) - rounding::share<Scalar>(rounding::cholesky(N));
  return validate_entries(set) == Status::ok && is_positive_definite(lowered) ? Status::ok : Status::beyond_domain;
}

/// Whether the ellipsoid of the first Cholesky factor is smaller than that of the second.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool is_smaller(const Matrix<Scalar, N>& first, const Matrix<Scalar, N>& second,
                                                    const SizeCriterion<Scalar, N>& criterion) noexcept {
  if (criterion.by_volume()) {
    return first.diagonal().prod() < second.diagonal().prod();
  }
  const auto trace = [&](const Matrix<Scalar, N>& factor) {
    return Scalar(criterion.weight.cwiseProduct(factor.lazyProduct(factor.transpose())).sum());
  };
  return trace(first) < trace(second);
}

}  // namespace elliptude::detail
