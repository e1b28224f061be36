#pragma once

/// \file
/// The intersection of two ellipsoids, or of an ellipsoid with a quadric: whether it is empty, and the smallest
/// ellipsoid of a one-parameter family that contains it (paper, eqs. xhatP-LP; theory, section 7).

#include "elliptude/sets/detail/recombine.hpp"
#include "elliptude/sets/detail/reduced_search.hpp"

namespace elliptude {

namespace detail {

/// In x = x̂₂ + L₂u the second set is the unit ball and the first ‖w + Bu‖ ≤ 1.
/// \return `not_positive_definite` if the first is flat, `cholesky_semidefinite`'s of the second.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status whiten(const Ellipsoid<Scalar, N>& first, const Ellipsoid<Scalar, N>& second,
                                                  Matrix<Scalar, N>& l2, Vector<Scalar, N>& w,
                                                  Matrix<Scalar, N>& b) noexcept {
  Matrix<Scalar, N> l1;
  if (const Status status = put_cholesky(first.shape, l1); status != Status::ok) {
    return status;
  }
  if (const Status status = cholesky_semidefinite(second.shape, l2); status != Status::ok) {
    return status;
  }
  w = solve_lower(l1, Vector<Scalar, N>(second.center - first.center));
  b = solve_lower(l1, l2);
  return Status::ok;
}

/// After a search that has found no common point: if M is ill-conditioned, a negative N may come from rounding; the
/// overlap margin, found without M, decides.
/// \param share after `ok`: of the smaller of both sets, which is then the result.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status choose_one(const Ellipsoid<Scalar, N>& first,
                                                      const Ellipsoid<Scalar, N>& second, const Matrix<Scalar, N>& l2,
                                                      bool flat, const SizeCriterion<Scalar, N>& criterion,
                                                      Scalar& share) noexcept {
  Scalar margin;
  if (overlap_margin(first, second, margin) != Status::ok || margin < Scalar(0)) {
    return Status::empty_intersection;
  }
  Matrix<Scalar, N> l1;
  const bool first_is_smaller = !flat && put_cholesky(first.shape, l1) == Status::ok && is_smaller(l1, l2, criterion);
  share = first_is_smaller ? Scalar(0) : Scalar(1);
  return Status::ok;
}

/// `minimal_intersection` in place of the second set, of two with valid entries; the first is not flat.
/// \param set the second; the result after `ok`.
/// \return `whiten`'s also of a flat first set; then nothing has changed.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status intersect(const Ellipsoid<Scalar, N>& first,
                                                     const SizeCriterion<Scalar, N>& criterion,
                                                     Ellipsoid<Scalar, N>& set, Scalar& share) noexcept {
  Matrix<Scalar, N> l2;
  Matrix<Scalar, N> b;
  Vector<Scalar, N> w;
  if (const Status status = whiten(first, set, l2, w, b); status != Status::ok) {
    return status;
  }
  const Vector<Scalar, N> origin = set.center;
  const Vector<Scalar, N> present = present_coordinates(l2);
  Matrix<Scalar, N> m;
  put_square_of_lower(b, m);
  const Vector<Scalar, N> v = b.transpose().lazyProduct(w);
  const auto slack = [&](const Vector<Scalar, N>& u) noexcept -> Scalar {
    return Scalar(1) - Vector<Scalar, N>(w + b.lazyProduct(u)).squaredNorm();
  };
  const AnySlack<Scalar, N> any_slack(slack);
  const Problem<Scalar, N, AnySlack<Scalar, N>> problem{m, v, present, any_slack};
  const bool flat = present.sum() < Scalar(N);
  KeptCombination<Scalar, N> best;
  const RelativeSize<Scalar, N> size(l2, present, criterion);
  const Scalar typical = problem.typical_weight();
  const Scalar start = flat ? typical : start_of_search(problem, size, typical);
  Status status = minimal_intersection(origin, l2, problem, size, start, set, share, best);
  if (status == Status::empty_intersection) {
    status = choose_one(first, set, l2, flat, criterion, share);
  }
  if (status != Status::ok) {
    return status;
  }
  if (share == Scalar(0) && !flat) {
    set = first;
  } else if (share != Scalar(1)) {
    const Scalar q = share / (Scalar(1) - share);
    if (problem.is_ill_conditioned(q, best)) {
      recombine(origin, l2, b, w, present, q, set);
    }
    return validate_combined(set, flat);
  }
  return Status::ok;
}

/// `minimal_intersection` where the first set is flat: of both, exchanged.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status intersect_exchanged(const Ellipsoid<Scalar, N>& first,
                                                               const SizeCriterion<Scalar, N>& criterion,
                                                               Ellipsoid<Scalar, N>& set, Scalar& share) noexcept {
  Ellipsoid<Scalar, N> exchanged = first;
  const Status status = intersect(set, criterion, exchanged, share);
  if (status == Status::ok) {
    set = exchanged;
    share = Scalar(1) - share;
  }
  return status;
}

/// `minimal_intersection` in place of the second set.
/// \param set the second; the result after `ok`, and of no use otherwise.
template <typename Scalar, int N>
[[nodiscard]] Status intersect_in_place(const Ellipsoid<Scalar, N>& first, const SizeCriterion<Scalar, N>& criterion,
                                        Ellipsoid<Scalar, N>& set, Scalar& share) noexcept {
  if (const Status status = validate_entries(first); status != Status::ok) {
    return status;
  }
  if (const Status status = validate_entries(set); status != Status::ok) {
    return status;
  }
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  const Status status = intersect(first, criterion, set, share);
  return status == Status::not_positive_definite ? intersect_exchanged(first, criterion, set, share) : status;
}

}  // namespace detail

/// A small ellipsoid that contains the intersection of two (paper, eqs. xhatP-LP, in information form): the smallest of
/// the family that two multipliers give, never larger than either set. One of the two may be flat.
/// \return the status of `validate`; `not_positive_definite` also if both are flat; `empty_intersection` if it is
/// proved that they have no common point (of sets that differ far in size `overlap_margin` tells more; docs/domain.md);
/// `beyond_domain` also of what they have in common.
template <typename Scalar, int N>
[[nodiscard]] Status minimal_intersection(const Ellipsoid<Scalar, N>& first, const Ellipsoid<Scalar, N>& second,
                                          const SizeCriterion<Scalar, N>& criterion,
                                          Intersection<Scalar, N>& result) noexcept {
  Intersection<Scalar, N> intersection{second, Scalar(1)};
  const Status status = detail::intersect_in_place(first, criterion, intersection.set, intersection.share);
  if (status == Status::ok) {
    result = intersection;
  }
  return status;
}

}  // namespace elliptude
