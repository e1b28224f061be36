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
/// \return whether KKᵀ/λ is below I; `ball` has not changed otherwise.
template <typename Scalar>
[[nodiscard]] bool enlarged_ball(const packed::Slices<Scalar>& forms, Matrix6<Scalar>& ball) noexcept {
  const Scalar one(1);
  const packed::Slices<Scalar> symmetric = packed::symmetric_part(forms);
  const Matrix6<Scalar> growth = gram_of(symmetric);  // KKᵀ
  const Scalar mean = growth.trace() / Scalar(6);
  const Scalar turning = norm_of_gram(gram_of(packed::Slices<Scalar>(forms - symmetric)));  // σ
  const Scalar whole = one + turning * turning;
  // The best λ if all eigenvalues of KKᵀ were alike.
  const Scalar lambda = mean + scalar::sqrt(Scalar(mean * (mean + whole)));
  Matrix6<Scalar> metric = Matrix6<Scalar>::Zero();
  if (lambda > Scalar(0)) {
    metric = (-one / lambda) * growth;
  }
  metric.diagonal().array() += one;
  Matrix6<Scalar> inverse;
  if (inverse_positive_definite(metric, inverse) != Status::ok) {
    return false;
  }
  // The inverse errs by more, the worse its condition is, which is at most its trace.
  const Scalar level = (whole + lambda) * (one + rounding::share<Scalar>(rounding::enlarged_ball) * inverse.trace());
  if (!scalar::isfinite(level)) {
    return false;
  }
  ball = level * inverse;
  return true;
}

}  // namespace elliptude::detail
