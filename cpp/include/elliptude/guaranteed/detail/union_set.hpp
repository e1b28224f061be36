#pragma once

/// \file
/// An ellipsoid about two, and its intersection with a prediction, for measurements some of which may be wrong.
/// (theory, section 16.10)

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/sets/quadric_fusion.hpp"

namespace elliptude::detail {

/// An ellipsoid about two: about the middle of their centers, with a shape that majorises both, and the distance added.
/// \return `not_positive_definite`, `not_converged`.
template <typename Scalar>
[[nodiscard]] Status enclosing(const Ellipsoid<Scalar, 6>& first, const Ellipsoid<Scalar, 6>& second,
                               Ellipsoid<Scalar, 6>& both) noexcept {
  Matrix6<Scalar> l;
  if (const Status status = put_cholesky(first.shape, l); status != Status::ok) {
    return status;
  }
  const Matrix6<Scalar> inverse = lower_inverse(l);
  const Matrix6<Scalar> seen = congruence(inverse, second.shape);
  SymmetricEigen<Scalar, 6> eigen;
  if (const Status status = symmetric_eigen(seen, eigen); status != Status::ok) {
    return status;
  }
  const EigenErrors<Scalar> errors = eigen_errors(seen, eigen);
  // What the second shape errs by, seen from the first, and its axes: the inverse of l is (I + E) L⁻¹ as in
  // `inverse_from_below`.
  const Scalar kappa_squared = inverse.cwiseAbs().lazyProduct(l.cwiseAbs()).squaredNorm();
  const Scalar lost =
      (rounding::share<Scalar>(rounding::union_axes) * (Scalar(1) + kappa_squared) + Scalar(2) * errors.vectors) *
          (Scalar(1) + eigen.values(0)) +
      errors.values;
  const Matrix6<Scalar> axes = l.lazyProduct(eigen.vectors);
  const Vector6<Scalar> widths = eigen.values.cwiseMax(Scalar(1)).array() + lost;
  const Matrix6<Scalar> scaled = axes * widths.asDiagonal();
  Matrix6<Scalar> shape = scaled.lazyProduct(axes.transpose());
  const Vector6<Scalar> offset = scalar::constant<Scalar>(0.5L) * (second.center - first.center);
  shape = enlarged(shape, Matrix6<Scalar>(offset * offset.transpose()));
  both.center = first.center + offset;
  both.shape = symmetrized(shape);
  both.shape.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::sum);
  return Status::ok;
}

/// What is in the prediction and in another ellipsoid that holds the truth: never larger than the prediction, which is
/// the answer where the other adds nothing, or cannot be used.
/// \param alone whether it is.
template <typename Scalar, int N>
[[nodiscard]] Ellipsoid<Scalar, N> within_prediction(const Ellipsoid<Scalar, N>& predicted,
                                                     const Ellipsoid<Scalar, N>& other,
                                                     const SizeCriterion<Scalar, N>& criterion, bool& alone) noexcept {
  Quadric<Scalar, N> quadric;
  QuadricFusion<Scalar, N> fusion;
  alone = to_quadric(other, quadric) != Status::ok ||
          minimal_intersection(&predicted, &quadric, 1, criterion, fusion) != Status::ok || fusion.prediction_alone;
  return alone ? predicted : fusion.set;
}

}  // namespace elliptude::detail
