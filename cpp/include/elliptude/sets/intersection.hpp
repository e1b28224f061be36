#pragma once

/// \file
/// The intersection of two ellipsoids, or of an ellipsoid with a quadric: whether it is empty, and the smallest ellipsoid of a
/// one-parameter family that contains it (paper, eqs. xhatP-LP; theory, section 7).

#include "elliptude/sets/detail/recombine.hpp"
#include "elliptude/sets/detail/reduced_search.hpp"

namespace elliptude {

/// A small ellipsoid that contains the intersection of two (paper, eqs. xhatP-LP, in information form): the smallest of the
/// family that two multipliers give, never larger than either set. One of the two may be flat.
/// \return the status of `validate`; `not_positive_definite` also if both are flat; `empty_intersection` if they have no
/// common point; `beyond_domain` also of what they have in common.
template <typename Scalar, int N>
[[nodiscard]] Status minimal_intersection(const Ellipsoid<Scalar, N>& first, const Ellipsoid<Scalar, N>& second,
                                          const SizeCriterion<Scalar, N>& criterion,
                                          Intersection<Scalar, N>& result) noexcept {
  for (const Ellipsoid<Scalar, N>* ellipsoid : {&first, &second}) {
    if (const Status status = detail::validate_entries(*ellipsoid); status != Status::ok) {
      return status;
    }
  }
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  Matrix<Scalar, N> l1;
  if (cholesky(first.shape, l1) != Status::ok) {
    Matrix<Scalar, N> l2;
    if (const Status status = cholesky(second.shape, l2); status != Status::ok) {
      return status;
    }
    const Status status = minimal_intersection(second, first, criterion, result);
    if (status == Status::ok) {
      result.share = Scalar(1) - result.share;
    }
    return status;
  }
  Matrix<Scalar, N> l2;
  if (const Status status = cholesky_semidefinite(second.shape, l2); status != Status::ok) {
    return status;
  }
  // In x = x̂₂ + L₂u the second set is the unit ball and the first ‖w + Bu‖ ≤ 1.
  const Vector<Scalar, N> present = detail::present_coordinates(l2);
  const Vector<Scalar, N> w = solve_lower(l1, Vector<Scalar, N>(second.center - first.center));
  const Matrix<Scalar, N> b = solve_lower(l1, l2);
  const Matrix<Scalar, N> m = square_of_lower(b);
  const Vector<Scalar, N> v = b.transpose().lazyProduct(w);
  const auto slack = [&](const Vector<Scalar, N>& u) -> Scalar {
    return Scalar(1) - Vector<Scalar, N>(w + b.lazyProduct(u)).squaredNorm();
  };
  const detail::Problem<Scalar, N, decltype(slack)> problem{m, v, present, slack};
  const bool flat = present.sum() < Scalar(N);
  Intersection<Scalar, N> intersection;
  detail::Combination<Scalar, N> best;
  const detail::RelativeSize<Scalar, N> size(l2, present, criterion);
  const Scalar typical = problem.typical_weight();
  const Scalar start = flat ? typical : detail::start_of_search(problem, size, typical);
  const Status status = detail::minimal_intersection(second.center, l2, problem, size, start, intersection, best);
  if (status != Status::ok) {
    // If M is ill-conditioned, a negative N may come from rounding; the overlap margin, found without M, decides.
    Scalar margin;
    if (status != Status::empty_intersection || overlap_margin(first, second, margin) != Status::ok ||
        margin < Scalar(0)) {
      return status;
    }
    intersection.share = !flat && detail::is_smaller(l1, l2, criterion) ? Scalar(0) : Scalar(1);
  }
  if (intersection.share == Scalar(1)) {
    intersection.set = second;
  } else if (intersection.share == Scalar(0) && !flat) {
    intersection.set = first;
  } else {
    const Scalar q = intersection.share / (Scalar(1) - intersection.share);
    if (problem.is_ill_conditioned(q, best)) {
      detail::recombine(second.center, l2, b, w, present, q, intersection.set);
    }
    if (const Status validity = detail::validate_combined(intersection.set, flat); validity != Status::ok) {
      return validity;
    }
  }
  result = intersection;
  return Status::ok;
}

}  // namespace elliptude
