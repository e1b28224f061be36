#pragma once

/// \file
/// The unit ball made a little larger, about all that a quadratic map moves its points to. (theory, section 17.4, *The shape*)

#include "elliptude/guaranteed/detail/packed_forms.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/linear/norms.hpp"

namespace elliptude::detail {

/// Shape of an ellipsoid that holds x = v + q(v) for all ‖v‖ ≤ 1.
///
/// With the symmetric part q_s of q, vᵀq(v) = vᵀKw, w = vvᵀ packed, and a bound σ of q − q_s, for any λ > 0 (theory, eq. 17.19),
///
///     xᵀ(I − KKᵀ/λ)x ≤ 1 + λ + σ²
///
/// \param forms q.
/// \param most what the trace of the ball may be, for it to be wanted.
/// \return whether there is such a ball; `ball` has not changed otherwise.
template <typename Scalar>
[[nodiscard]] bool enlarged_ball(const packed::Slices<Scalar>& forms, const Scalar& most,
                                 Matrix6<Scalar>& ball) noexcept {
  const Scalar one(1);
  const packed::Slices<Scalar> symmetric = packed::symmetric_part(forms);
  const Scalar mean = symmetric.squaredNorm() / Scalar(6);  // of the eigenvalues of KKᵀ
  // The trace is at least six times the square of this, as both parts of q are at right angles to each other.
  const Scalar least = scalar::sqrt(Scalar(one + forms.squaredNorm() / Scalar(6))) + scalar::sqrt(mean);
  if (!(Scalar(6) * least * least < most)) {
    return false;
  }
  const Scalar turning = norm_of_gram(gram_of(packed::Slices<Scalar>(forms - symmetric)));  // σ
  const Scalar whole = one + turning * turning;
  // The best λ if all eigenvalues of KKᵀ are alike.
  const Scalar lambda = mean + scalar::sqrt(Scalar(mean * (mean + whole)));
  Matrix6<Scalar> metric = Matrix6<Scalar>::Zero();
  if (lambda > Scalar(0)) {
    metric = (-one / lambda) * gram_of(symmetric);
  }
  metric.diagonal().array() += one;
  Matrix6<Scalar> inverse;
  if (inverse_positive_definite(metric, inverse) != Status::ok) {
    return false;
  }
  // The inverse errs by more, the worse its condition is, which is at most its trace.
  const Scalar trace = inverse.trace();
  const Scalar level = (whole + lambda) * (one + rounding::share<Scalar>(rounding::enlarged_ball) * trace);
  if (!(level * trace < most)) {
    return false;
  }
  ball = level * inverse;
  return true;
}

}  // namespace elliptude::detail
