#pragma once

/// \file
/// Guaranteed fusion for the first three of six coordinates alone: a small ellipsoid about the shadow of everything
/// that satisfies a predicted ellipsoid and any number of quadrics at once. (theory, eqs. 16.8 and 16.9)

#include "elliptude/sets/quadric_fusion.hpp"

namespace elliptude {

namespace detail {

/// The criterion for the first three coordinates as one for all N: their weight, and none for the others.
template <int N, typename Scalar>
[[nodiscard]] SizeCriterion<Scalar, N> criterion_of_first(const Matrix3<Scalar>& weight) noexcept {
  Matrix<Scalar, N> whole = Matrix<Scalar, N>::Zero();
  whole.template topLeftCorner<3, 3>() = weight;
  return SizeCriterion<Scalar, N>::weighted_trace(whole);
}

}  // namespace detail

/// A small ellipsoid that contains the first three coordinates of every point in a predicted ellipsoid and in `count`
/// quadrics: the shadow of an ellipsoid of the family of `minimal_intersection`, with the multipliers for which the
/// shadow is smallest. For the trace they are found in one search. For the volume it is the trace weighted by the
/// inverse of the shape found before, as often as it gains: each time the volume falls, and every shape on the way is a
/// bound.
/// \param predicted positive definite; or null.
/// \param criterion of the three coordinates.
/// \param first a shape to begin with, near what is looked for; positive definite. It only decides about the size.
/// \param set changed only on success.
/// \return the status of `minimal_intersection`.
template <typename Scalar, int N, typename Given>
[[nodiscard]] Status minimal_projection(const Ellipsoid<Scalar, N>* predicted, const Given* quadrics, std::size_t count,
                                        const SizeCriterion<Scalar, 3>& criterion, const Matrix3<Scalar>& first,
                                        Ellipsoid<Scalar, 3>& set) noexcept {
  if (const Status status = detail::validate(quadrics, count, SizeCriterion<Scalar, N>::trace());
      status != Status::ok) {
    return status;
  }
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  const bool by_volume = criterion.by_volume();
  constexpr int most_searches = 3;
  Matrix3<Scalar> weight = criterion.weight;
  Ellipsoid<Scalar, 3> best;
  QuadricFusion<Scalar, N> fusion;
  for (int search = 0; search < (by_volume ? most_searches : 1); ++search) {
    if (by_volume) {
      if (const Status status = inverse_positive_definite(search == 0 ? first : best.shape, weight);
          status != Status::ok) {
        return status;
      }
    }
    if (const Status status = detail::fuse(predicted, quadrics, count, detail::criterion_of_first<N>(weight), fusion);
        status != Status::ok) {
      return status;
    }
    const Ellipsoid<Scalar, 3> found = projection<0, 3>(fusion.set);
    // Where a search no longer gains, there is no more to be had.
    const bool gains = search == 0 || detail::is_smaller_set(found, best, criterion);
    best = gains ? found : best;
    if (!gains) {
      break;
    }
  }
  set = best;
  return Status::ok;
}

}  // namespace elliptude
