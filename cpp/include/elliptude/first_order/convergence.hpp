#pragma once

/// \file
/// Diagnostics of the convergence theorem (paper, §3.4, eq. sufcond). It is a sufficient condition that a first update
/// from a poor prior can meet, but no filter at every update, because det A^f = 1 makes ‖A^f‖_F ≥ √6
/// (theory, section 11).

#include "elliptude/first_order/filter.hpp"
#include "elliptude/linear/cholesky.hpp"
#include "elliptude/linear/eigen.hpp"
#include "elliptude/linear/triangular.hpp"

namespace elliptude {

template <typename Scalar>
struct Convergence {
  Scalar flow_norm;       ///< ‖A^f‖_F since the update before
  Scalar smallest_ratio;  ///< λ_min of (P^m)⁻¹P^f
  Scalar chi;             ///< χ = √(6 + 30 κ(P^m))
  Scalar contraction;     ///< the least c that satisfies the theorem; tr P < c tr P₀ is promised only if it is below 1
  Scalar trace_ratio;     ///< tr P / tr P₀, measured
  Scalar smaller_than_sets;  ///< tr P / min(tr P^m, tr P^f): at most 1 if the trace is the criterion, before recentring
};

/// \param transition A^f since the update before, \param prior P₀ after it, \param predicted P^f, \param measured P^m,
/// \param fused P, \param share 0 measurement alone … 1 prediction alone, so that q = share / (1 − share). The theorem
/// is about P^f = A^f P₀ A^fᵀ, without an unknown torque or a gyro's noise, and about recentring by a shift.
/// \return `not_positive_definite` of P^m, `not_finite`, `not_converged`.
template <typename Scalar>
[[nodiscard]] Status convergence(const Matrix<Scalar, 6>& transition, const Matrix<Scalar, 6>& prior,
                                 const Matrix<Scalar, 6>& predicted, const Matrix<Scalar, 6>& measured,
                                 const Matrix<Scalar, 6>& fused, const Scalar& share,
                                 Convergence<Scalar>& result) noexcept {
  Matrix<Scalar, 6> l;
  if (const Status status = put_cholesky(measured, l); status != Status::ok) {
    return status;
  }
  // (P^m)⁻¹P^f has the eigenvalues of L⁻¹ P^f L⁻ᵀ.
  const Matrix<Scalar, 6> half = solve_lower(l, predicted);
  const Matrix<Scalar, 6> whole = solve_lower(l, Matrix<Scalar, 6>(half.transpose()));
  SymmetricEigen<Scalar, 6> ratio;
  SymmetricEigen<Scalar, 6> shape;
  if (const Status status = symmetric_eigen(whole, ratio); status != Status::ok) {
    return status;
  }
  if (const Status status = symmetric_eigen(measured, shape); status != Status::ok) {
    return status;
  }
  Convergence<Scalar> c;
  c.flow_norm = transition.norm();
  c.smallest_ratio = ratio.values(5) > Scalar(0) ? ratio.values(5) : Scalar(0);  // of a flat prediction, rounding
  c.chi = scalar::sqrt(Scalar(Scalar(6) + Scalar(30) * shape.values(0) / shape.values(5)));
  // 6 χ (1 + q) ‖A‖² / (q + λ_min) with q = share / (1 − share).
  c.contraction = Scalar(6) * c.chi * c.flow_norm * c.flow_norm / (share + (Scalar(1) - share) * c.smallest_ratio);
  c.trace_ratio = fused.trace() / prior.trace();
  const Scalar smaller = measured.trace() < predicted.trace() ? measured.trace() : predicted.trace();
  c.smaller_than_sets = fused.trace() / smaller;
  result = c;
  return Status::ok;
}

/// The same of an update of a filter with directions and an angular velocity.
/// \param before the filter just before the update, \param after just after it, \param share what `Update` says.
/// \return as above; `attitude_undetermined` of directions to which the theorem does not apply, as they determine no
/// attitude.
template <typename Filter, typename Scalar>
[[nodiscard]] Status convergence(const Filter& before, const Direction<Scalar>* directions, std::size_t count,
                                 const AngularVelocity<Scalar>& angular_velocity, const Filter& after,
                                 const Scalar& share, Convergence<Scalar>& result) noexcept {
  MeasuredDirections<Scalar> measured;
  if (const Status status = MeasuredDirections<Scalar>::make(directions, count, WahbaMethod::svd, measured);
      status != Status::ok) {
    return status;
  }
  StateEllipsoid<RigidBodyState<Scalar>> ellipsoid;
  if (const Status status = measured_state(measured, angular_velocity, before.criterion(), ellipsoid);
      status != Status::ok) {
    return status;
  }
  return convergence(before.transition(), before.prior_shape(), before.ellipsoid().shape, ellipsoid.shape,
                     after.ellipsoid().shape, share, result);
}

}  // namespace elliptude
