#pragma once

/// \file
/// Whether two ellipsoids have a common point, and the result type for a bound of their intersection.

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/ellipsoid.hpp"

namespace elliptude {

namespace detail {

/// What λ(1−λ) dᵀ(λP₁ + (1−λ)P₂)⁻¹d and its slope are at one λ, and a step towards where the slope is zero.
template <typename Scalar>
struct OverlapAt {
  Scalar value;
  Scalar slope;
  Scalar step;
};

/// The step is Newton's for the logarithm of x = λ √p₁ / ((1−λ) √p₂), pᵢ = yᵀPᵢy, in log t, t = λ/(1−λ): in one
/// dimension it arrives at once, however much the sets differ in size. Without a logarithm, 2 (x−1)/(x+1) for log x and
/// (2−l)/(2+l) for exp(−l).
/// \param factor of λP₁ + (1−λ)P₂. No branch depends on a number.
template <typename Scalar, int N>
[[nodiscard]] OverlapAt<Scalar> overlap_with_factor(const Scalar& lambda, const Matrix<Scalar, N>& first,
                                                    const Matrix<Scalar, N>& second, const Vector<Scalar, N>& d,
                                                    const RootFreeFactor<Scalar, N>& factor) noexcept {
  const Scalar rest = Scalar(1) - lambda;
  const Scalar two(2);
  const Vector<Scalar, N> y = solve(factor, d);
  const Vector<Scalar, N> y1 = first.lazyProduct(y);
  const Vector<Scalar, N> y2 = second.lazyProduct(y);
  const Scalar p1 = y.dot(y1);
  const Scalar p2 = y.dot(y2);
  const Vector<Scalar, N> dy = solve(factor, Vector<Scalar, N>(y2 - y1));
  const Scalar by_both = lambda * rest;
  const Scalar left = lambda * scalar::sqrt(p1);
  const Scalar right = rest * scalar::sqrt(p2);
  const Scalar rise = Scalar(1) - by_both * (y2.dot(dy) / p2 - y1.dot(dy) / p1);  // of log x with log t
  const Scalar fall = two * (left - right);
  const Scalar scale = rise * (left + right);
  OverlapAt<Scalar> at;
  at.value = by_both * d.dot(y);
  at.slope = right * right - left * left;
  at.step = -two * by_both * fall / (two * scale + fall * (rest - lambda));
  return at;
}

/// Its value alone.
template <typename Scalar, int N>
[[nodiscard]] Scalar overlap_value(const Scalar& lambda, const Vector<Scalar, N>& d,
                                   const RootFreeFactor<Scalar, N>& factor) noexcept {
  Vector<Scalar, N> x = d;
  solve_unit_down<0>(factor.l, x);
  return lambda * (Scalar(1) - lambda) * x.cwiseAbs2().dot(factor.p);
}

/// How long a step from λ leaves an error of less than a tenth of √ε of λ and of 1−λ. After a step s it is some s²/δ,
/// where the nearest pole is at a distance δ, and there is none between 0 and 1.
template <typename Scalar>
[[nodiscard]] Scalar last_overlap_step(const Scalar& lambda, const Scalar& tenth) noexcept {
  const Scalar rest = Scalar(1) - lambda;
  return tenth * scalar::sqrt(rounding::root<Scalar>()) * scalar::select(lambda < rest, lambda, rest);
}

/// \param may_be_flat towards the end where one set is alone, and perhaps flat, the mixture may be flat to rounding.
/// \return `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status factorize_mixture(const Scalar& lambda, const Matrix<Scalar, N>& first,
                                       const Matrix<Scalar, N>& second, bool may_be_flat,
                                       RootFreeFactor<Scalar, N>& factor) noexcept {
  const Matrix<Scalar, N> mixed = lambda * first + (Scalar(1) - lambda) * second;
  const Status status = factorize(mixed, factor);
  if (!may_be_flat) {
    return status;
  }
  if (status == Status::ok && scalar::all(has_accurate_pivots(mixed, factor))) {
    return Status::ok;
  }
  Matrix<Scalar, N> l;
  if (const Status flat = cholesky_semidefinite(mixed, l); flat != Status::ok) {
    return flat;
  }
  factor = without_roots(l);
  return Status::ok;
}

/// `overlap_margin` of two ellipsoids that `validate` accepts.
/// \return `not_positive_definite` if λP₁ + (1−λ)P₂ is singular, both being flat.
template <typename Scalar, int N>
[[nodiscard]] Status overlap_of_valid(const Ellipsoid<Scalar, N>& first, const Ellipsoid<Scalar, N>& second,
                                      Scalar& margin) noexcept {
  const Scalar tenth = scalar::constant<Scalar>(0.1L);
  const Vector<Scalar, N> d = second.center - first.center;
  Scalar low(0);
  Scalar high(1);
  Scalar lambda = scalar::constant<Scalar>(0.5L);
  Scalar largest(0);
  constexpr int most_steps = 60;
  for (int step = 0; step < most_steps; ++step) {
    RootFreeFactor<Scalar, N> factor;
    if (const Status status = factorize_mixture(lambda, first.shape, second.shape, step > 0, factor);
        status != Status::ok) {
      return status;
    }
    const OverlapAt<Scalar> at = overlap_with_factor(lambda, first.shape, second.shape, d, factor);
    largest = at.value > largest ? at.value : largest;
    if (at.slope == Scalar(0)) {
      break;
    }
    (at.slope > Scalar(0) ? low : high) = lambda;
    // The value is flat at the maximum: an error of √ε in λ is one of ε in it.
    const Scalar enough = tenth * rounding::root<Scalar>() * high;
    const Scalar next = lambda + at.step;
    const bool inside = next > low && next < high;
    if (scalar::abs(at.step) <= enough || high - low <= enough) {
      break;
    }
    if (inside && scalar::abs(at.step) <= last_overlap_step(lambda, tenth)) {
      if (factorize_mixture(next, first.shape, second.shape, true, factor) == Status::ok) {
        const Scalar value = overlap_value(next, d, factor);
        largest = value > largest ? value : largest;
      }
      break;
    }
    lambda = inside ? next : Scalar(scalar::constant<Scalar>(0.5L) * (low + high));
  }
  margin = Scalar(1) - largest;
  return Status::ok;
}

}  // namespace detail

/// The overlap of two ellipsoids: 1 − max over 0 ≤ λ ≤ 1 of λ(1−λ) dᵀ(λP₁ + (1−λ)P₂)⁻¹d, with d the difference of the
/// centers. It is 1 for a common center, 0 where they touch, and negative if and only if they have no common point, but
/// for rounding: of sets that are thin to 1e-6 and nearly touch it may have the wrong sign (docs/domain.md). The maximum
/// of this concave function is where λ √(yᵀP₁y) = (1−λ) √(yᵀP₂y), y = (λP₁ + (1−λ)P₂)⁻¹d. (theory, eq. 7.8)
/// \return the status of `validate`; `not_positive_definite` also if λP₁ + (1−λ)P₂ is singular, both being flat.
template <typename Scalar, int N>
[[nodiscard]] Status overlap_margin(const Ellipsoid<Scalar, N>& first, const Ellipsoid<Scalar, N>& second,
                                    Scalar& margin) noexcept {
  if (const Status status = validate(first); status != Status::ok) {
    return status;
  }
  if (const Status status = validate(second); status != Status::ok) {
    return status;
  }
  return detail::overlap_of_valid(first, second, margin);
}

/// An ellipsoid that contains an intersection, with the share of the second set: 0 is the first set alone, 1 the
/// second; in the paper's notation (eq. LP) q = share / (1 − share).
template <typename Scalar, int N>
struct Intersection {
  Ellipsoid<Scalar, N> set;
  Scalar share;
};

}  // namespace elliptude
