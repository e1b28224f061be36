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
  const packed::Slices<Scalar> turning = forms - symmetric;
  const Scalar mean = symmetric.squaredNorm() / Scalar(6);  // of the eigenvalues of KKᵀ
  // σ² is no less than the largest square of a column, and the trace, whatever λ, than six times the square of this.
  const Scalar column = turning.colwise().squaredNorm().maxCoeff();
  const Scalar least = scalar::sqrt(Scalar(one + column + mean)) + scalar::sqrt(mean);
  if (!(Scalar(6) * least * least < most)) {
    return false;
  }
  const Scalar sigma = norm_of_gram(gram_of(turning));
  const Scalar whole = one + sigma * sigma;
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
