#pragma once

/// \file
/// An ellipsoid about two, and what a prediction leaves of it: for measurements of which some may be wrong. (theory, section
/// 16.10)

#include "elliptude/quadric_fusion.hpp"

namespace elliptude {

/// An ellipsoid about two: about the middle of their centers, with a shape that majorises both, and the distance added.
/// \return `not_positive_definite`, `not_converged`.
template <typename Scalar>
[[nodiscard]] Status enclosing(const Ellipsoid<Scalar, 6>& first, const Ellipsoid<Scalar, 6>& second,
                               Ellipsoid<Scalar, 6>& both) noexcept {
  Matrix6<Scalar> l;
  if (const Status status = cholesky(first.shape, l); status != Status::ok) {
    return status;
  }
  const Matrix6<Scalar> inverse = lower_inverse(l);
  const Matrix6<Scalar> half = inverse.lazyProduct(second.shape);
  SymmetricEigen<Scalar, 6> eigen;
  if (const Status status = symmetric_eigen(Matrix6<Scalar>(half.lazyProduct(inverse.transpose())), eigen);
      status != Status::ok) {
    return status;
  }
  const Matrix6<Scalar> axes = l.lazyProduct(eigen.vectors);
  const Matrix6<Scalar> scaled = axes * eigen.values.cwiseMax(Scalar(1)).asDiagonal();
  Matrix6<Scalar> shape = scaled.lazyProduct(axes.transpose());
  const Vector6<Scalar> offset = scalar::constant<Scalar>(0.5L) * (second.center - first.center);
  shape = enlarged(shape, Matrix6<Scalar>(offset * offset.transpose()));
  both.center = first.center + offset;
  both.shape =
      (scalar::constant<Scalar>(0.5L) + Scalar(64) * Scalar(scalar::epsilon<Scalar>)) * (shape + shape.transpose());
  return Status::ok;
}

/// An ellipsoid as a quadric that holds all of it that is in the prediction, rounding included: with u = L⁻¹(x − x̂) the computed
/// inverse of L is (I + E) L⁻¹, ‖E‖ ≤ Nε κ, κ = ‖|L⁻¹||L|‖.
/// \return `not_positive_definite` also where κ leaves no digits.
template <typename Scalar, int N>
[[nodiscard]] Status rounded_quadric(const Ellipsoid<Scalar, N>& ellipsoid, const Ellipsoid<Scalar, N>& predicted,
                                     Quadric<Scalar, N>& quadric) noexcept {
  const Scalar epsilon(scalar::epsilon<Scalar>);
  Matrix<Scalar, N> raised = ellipsoid.shape;
  raised.diagonal() *= Scalar(1) + Scalar(2 * N * (N + 1)) * epsilon;
  Matrix<Scalar, N> l;
  if (const Status status = cholesky(raised, l); status != Status::ok) {
    return status;
  }
  const Matrix<Scalar, N> inverse = lower_inverse(l);
  const Scalar kappa = inverse.cwiseAbs().lazyProduct(l.cwiseAbs()).norm();
  const Scalar share = Scalar(8 * N) * epsilon * kappa * kappa;
  if (!(share < Scalar(1))) {
    return Status::not_positive_definite;
  }
  quadric.a = (Scalar(1) - share) * square_of_lower(inverse);
  quadric.g = -quadric.a.lazyProduct(ellipsoid.center);
  const Vector<Scalar, N> reach = ellipsoid.center.cwiseAbs() + predicted.center.cwiseAbs() +
                                  Vector<Scalar, N>(predicted.shape.diagonal().cwiseSqrt());
  quadric.c = Scalar(1) + quadric.g.dot(ellipsoid.center) +
              Scalar(16 * N) * epsilon * (Scalar(1) + reach.dot(quadric.a.cwiseAbs().lazyProduct(reach)));
  return Status::ok;
}

/// What is in the prediction and in another ellipsoid that holds the truth: never larger than the prediction, which is the
/// answer where the other adds nothing, or cannot be used.
/// \param alone whether it is.
template <typename Scalar, int N>
[[nodiscard]] Ellipsoid<Scalar, N> within_prediction(const Ellipsoid<Scalar, N>& predicted,
                                                     const Ellipsoid<Scalar, N>& other,
                                                     const SizeCriterion<Scalar, N>& criterion, bool& alone) noexcept {
  Quadric<Scalar, N> quadric;
  QuadricFusion<Scalar, N> fusion;
  alone = rounded_quadric(other, predicted, quadric) != Status::ok ||
          minimal_intersection(&predicted, &quadric, 1, criterion, fusion) != Status::ok || fusion.prediction_alone;
  return alone ? predicted : fusion.set;
}

}  // namespace elliptude
