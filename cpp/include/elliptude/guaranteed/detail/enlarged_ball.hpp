#pragma once

/// \file
/// Ellipsoids about all that a quadratic map moves the points of the unit ball to. (theory, section 17.4, *The shape*)

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/guaranteed/detail/packed_forms.hpp"
#include "elliptude/guaranteed/detail/prediction_sums.hpp"

namespace elliptude::detail {

/// The parts of q = r + s of `enlarged_ball`.
/// \param gram KKᵀ, and `mean` that of its eigenvalues.
/// \param sigma σ.
/// \return whether the ellipsoid's trace may be below `most`. What is found is meaningless otherwise.
template <typename Scalar>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool split(const packed::Slices<Scalar>& forms, const Scalar& most,
                                               Matrix6<Scalar>& gram, Scalar& mean, Scalar& sigma) noexcept {
  const Scalar one(1);
  packed::Slices<Scalar> part = packed::symmetric_part(forms);  // r, and then s, in the same place
  mean = part.squaredNorm() / Scalar(6);
  Vector6<Scalar> columns;  // of s, their lengths squared
  for (int j = 0; j < 6; ++j) {
    columns(j) = Vector<Scalar, packed::Slices<Scalar>::RowsAtCompileTime>(forms.col(j) - part.col(j)).squaredNorm();
  }
  // σ is no less than the length of any column. With it the trace is at least six times the square of `least`, whatever
  // λ.
  const Scalar column = columns.maxCoeff();
  const Scalar least = scalar::sqrt(Scalar(one + column + mean)) + scalar::sqrt(mean);
  if (!(Scalar(6) * least * least < most)) {
    return false;
  }
  gram = gram_of(part);
  part = forms - part;
  sigma = norm_of_gram(gram_of(part));
  return true;
}

/// Shape of an ellipsoid that holds x = v + q(v) for all ‖v‖ ≤ 1.
///
/// With q = r + s, where vᵀs(v) = 0 and r(v) = K vvᵀ, packed, comes from a symmetric tensor, and with ‖s(v)‖ ≤ σ, for
/// any λ > 0 (theory, eq. 17.19),
///
///     xᵀ(I − KKᵀ/λ)x ≤ 1 + λ + σ²
///
/// \param forms q: symmetric slices, with zeros in their last two rows.
/// \param most what the trace of the ellipsoid may be, for it to be wanted; below 1/ε by far.
/// \return whether there is such an ellipsoid; `ball` has not changed otherwise.
template <typename Scalar>
[[nodiscard]] bool enlarged_ball(const packed::Slices<Scalar>& forms, const Scalar& most,
                                 Matrix6<Scalar>& ball) noexcept {
  const Scalar one(1);
  Matrix6<Scalar> metric;  // first KKᵀ
  Scalar mean;
  Scalar sigma;
  if (!split(forms, most, metric, mean, sigma)) {
    return false;
  }
  const Scalar whole = one + sigma * sigma;
  // The best λ if all eigenvalues of KKᵀ are alike.
  const Scalar lambda = mean + scalar::sqrt(Scalar(mean * (mean + whole)));
  if (lambda > Scalar(0)) {
    metric *= -one / lambda;
  } else {
    metric.setZero();
  }
  metric.diagonal().array() += one;
  Matrix6<Scalar> inverse;
  if (inverse_positive_definite(metric, inverse) != Status::ok) {
    return false;
  }
  // The inverse is too small by more, the larger its trace is, which bounds its condition, as the metric is below I.
  const Scalar trace = inverse.trace();
  const Scalar cover = rounding::share<Scalar>(rounding::enlarged_ball) * trace;
  const Scalar level = (whole + lambda) * (one + cover);
  if (!(level * trace < most) || !(cover < scalar::constant<Scalar>(0.125L))) {
    return false;
  }
  ball = level * inverse;
  return true;
}

/// Shape of an ellipsoid that holds v + q(v) for all ‖v‖ ≤ 1: the sum of the ball and of the ellipsoid of q(v); or, as
/// v alone says where both are, (17.19), if that adds much less: in v, and in u, where the widest axes count. (17.19)
/// is larger in all directions, and what is of second order later grows with it.
/// \param widths of the set of u, squared, in the directions of v.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> ball_and_image(const packed::Slices<Scalar>& forms,
                                             const Vector6<Scalar>& widths) noexcept {
  const Scalar one(1);
  const Matrix6<Scalar> moved = gram_of(forms);  // {q(v) : ‖v‖ ≤ 1} lies in this ellipsoid
  const Scalar width = widths.sum();
  const Scalar moved_trace = moved.trace();
  const Scalar moved_width = widths.dot(moved.diagonal());
  const Scalar share = tube::moderate_growth(tube::share_of(moved_trace), moved_width, width);
  const Scalar by_moved = one + one / share;
  Matrix6<Scalar> ball;
  if (share > scalar::constant<Scalar>(0.002L) && moved_trace > Scalar(0)) {
    const Scalar much_less = scalar::constant<Scalar>(0.6L);
    const Scalar most = Scalar(6) + much_less * (Scalar(6) * share + by_moved * moved_trace);
    if (enlarged_ball(forms, most, ball) &&
        widths.dot(ball.diagonal()) - width < much_less * (share * width + by_moved * moved_width)) {
      return ball;
    }
  }
  ball = by_moved * moved;
  ball.diagonal().array() += moved_trace > Scalar(0) ? Scalar(one + share) : one;
  return ball;
}

}  // namespace elliptude::detail
