#pragma once

/// \file
/// All attitudes that agree with measured directions, when the error of each is bounded by an angle: an ellipsoid that
/// contains them, without linearization, for errors of any size. (theory, section 15)

#include "elliptude/attitude/direction_cones.hpp"

namespace elliptude {

/// An ellipsoid of attitude errors about an attitude, both the result of directions with bounds.
template <typename Scalar>
struct WahbaSet {
  Matrix3<Scalar> attitude;    ///< Ĉ, the Wahba solution for the weights
  Ellipsoid<Scalar, 3> error;  ///< of the chart's coordinates about Ĉ; its center is zero
  Scalar margin;               ///< R as a share of Σ μᵢ 2 sin²(rᵢ/2): 1 for directions that fit exactly
};

/// The sum of directions within their bounds, with given weights: everything that `wahba_set` uses, even if it finds no
/// set.
/// \return what `DirectionCones::make` and `add_up` say; `out_of_range` if the number of weights differs.
template <typename Reference, typename Body, typename Bounds, typename Weights>
[[nodiscard]] Status cone_sum(const Eigen::MatrixBase<Reference>& reference, const Eigen::MatrixBase<Body>& body,
                              const Eigen::MatrixBase<Bounds>& bounds, const Eigen::MatrixBase<Weights>& weights,
                              ConeSum<typename Reference::Scalar>& sum) noexcept {
  using Scalar = typename Reference::Scalar;
  DirectionCones<Scalar> cones;
  if (const Status status = DirectionCones<Scalar>::make(reference, body, bounds, cones); status != Status::ok) {
    return status;
  }
  if (weights.size() != reference.cols()) {
    return Status::out_of_range;
  }
  typename DirectionCones<Scalar>::Weights chosen{};
  for (std::size_t i = 0; i < cones.count(); ++i) {
    chosen[i] = weights(static_cast<Eigen::Index>(i));
  }
  return cones.add_up(chosen, sum);
}

/// An ellipsoid that contains every attitude for which each direction is within its bound: the smallest about the sum
/// of the directions' cones with the weights.
/// \tparam Chart `ExponentialChart` or `GibbsChart`, in whose coordinates the ellipsoid is.
/// \param reference 3 × m, directions in reference axes, of any length; m is at most 32.
/// \param body 3 × m, the same directions as measured in body axes.
/// \param bounds m angles between 0 and π, rad: the largest angle between the measured direction and the true one.
/// \param weights m numbers of any magnitude, not negative, not all zero: they count as shares of the largest. A
/// direction with weight zero is not used.
/// \return the status of `cone_sum`; `empty_intersection`, a proof that some bound is wrong; `unbounded` if half turns
/// about the attitude cannot be excluded, as with one direction, collinear ones, or very large bounds.
template <typename Chart, typename Reference, typename Body, typename Bounds, typename Weights>
[[nodiscard]] Status wahba_set(const Eigen::MatrixBase<Reference>& reference, const Eigen::MatrixBase<Body>& body,
                               const Eigen::MatrixBase<Bounds>& bounds, const Eigen::MatrixBase<Weights>& weights,
                               WahbaSet<typename Reference::Scalar>& set) noexcept {
  using Scalar = typename Reference::Scalar;
  ConeSum<Scalar> sum;
  if (const Status status = cone_sum(reference, body, bounds, weights, sum); status != Status::ok) {
    return status;
  }
  Ellipsoid<Scalar, 3> error;
  if (const Status status = bounding_ellipsoid<Chart>(sum, error); status != Status::ok) {
    return status;
  }
  set = {sum.attitude, error, sum.margin};
  return Status::ok;
}

/// The set for weights that make it small, by `DirectionCones::minimal_weights`; never larger than for weights of 1/(1
/// − cos rᵢ).
/// \param weights m numbers that come out: the weights, the largest of them 1.
/// \return as `wahba_set`; `unbounded` if no weights that exclude half turns were found.
template <typename Chart, typename Reference, typename Body, typename Bounds, typename Weights>
[[nodiscard]] Status minimal_wahba_set(const Eigen::MatrixBase<Reference>& reference,
                                       const Eigen::MatrixBase<Body>& body, const Eigen::MatrixBase<Bounds>& bounds,
                                       WahbaCriterion criterion, Eigen::MatrixBase<Weights>& weights,
                                       WahbaSet<typename Reference::Scalar>& set) noexcept {
  using Scalar = typename Reference::Scalar;
  DirectionCones<Scalar> cones;
  if (const Status status = DirectionCones<Scalar>::make(reference, body, bounds, cones); status != Status::ok) {
    return status;
  }
  if (weights.size() != reference.cols()) {
    return Status::out_of_range;
  }
  typename DirectionCones<Scalar>::Weights chosen = cones.weights_by_bound();
  ConeSum<Scalar> sum;
  if (const Status status = cones.add_up(chosen, sum); status != Status::ok) {
    return status;
  }
  Ellipsoid<Scalar, 3> error;
  const Status first = bounding_ellipsoid<Chart>(sum, error);
  if (first != Status::ok && first != Status::unbounded) {
    return first;
  }
  const auto other_weights = cones.minimal_weights(sum.attitude, criterion);
  ConeSum<Scalar> other_sum;
  Ellipsoid<Scalar, 3> other_error;
  Status other = cones.add_up(other_weights, other_sum);
  if (other == Status::ok) {
    other = bounding_ellipsoid<Chart>(other_sum, other_error);
  }
  if (other == Status::empty_intersection) {
    return other;
  }
  const auto size = [criterion](const Matrix3<Scalar>& shape) {
    return criterion == WahbaCriterion::trace ? Scalar(shape.trace()) : Scalar(shape.determinant());
  };
  if (other == Status::ok && (first != Status::ok || size(other_error.shape) < size(error.shape))) {
    chosen = other_weights;
    sum = other_sum;
    error = other_error;
  } else if (first != Status::ok) {
    return first;
  }
  for (std::size_t i = 0; i < cones.count(); ++i) {
    weights(static_cast<Eigen::Index>(i)) = chosen[i];
  }
  set = {sum.attitude, error, sum.margin};
  return Status::ok;
}

}  // namespace elliptude
