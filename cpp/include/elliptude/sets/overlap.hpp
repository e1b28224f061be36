#pragma once

/// \file
/// Whether two ellipsoids have a common point, and the result type for a bound of their intersection.

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/ellipsoid.hpp"

namespace elliptude {

namespace detail {

/// What λ(1−λ) dᵀ(λP₁ + (1−λ)P₂)⁻¹d and its slope are at one λ, and Newton's step to where the slope is zero.
template <typename Scalar>
struct OverlapAt {
  Scalar value;
  Scalar slope;
  Scalar step;
};

/// \param l Cholesky's factor of λP₁ + (1−λ)P₂. No branch depends on a number.
template <typename Scalar, int N>
[[nodiscard]] OverlapAt<Scalar> overlap_with_factor(const Scalar& lambda, const Matrix<Scalar, N>& first,
                                                    const Matrix<Scalar, N>& second, const Vector<Scalar, N>& d,
                                                    const Matrix<Scalar, N>& l) noexcept {
  const Scalar rest = Scalar(1) - lambda;
  const Vector<Scalar, N> y = solve_lower_transposed(l, solve_lower(l, d));
  const Vector<Scalar, N> y1 = first.lazyProduct(y);
  const Vector<Scalar, N> y2 = second.lazyProduct(y);
  const Scalar p1 = y.dot(y1);
  const Scalar p2 = y.dot(y2);
  const Vector<Scalar, N> dy = solve_lower_transposed(l, solve_lower(l, Vector<Scalar, N>(y2 - y1)));
  const Scalar curvature =
      Scalar(-2) * (lambda * p1 + rest * p2) + Scalar(2) * (rest * rest * y2.dot(dy) - lambda * lambda * y1.dot(dy));
  OverlapAt<Scalar> at;
  at.value = lambda * rest * d.dot(y);
  at.slope = rest * rest * p2 - lambda * lambda * p1;
  at.step = -at.slope / curvature;
  return at;
}

/// \param may_be_flat towards the end where one set is alone, and perhaps flat, the mixture may be flat to rounding.
/// \return `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status overlap_at(const Scalar& lambda, const Ellipsoid<Scalar, N>& first,
                                const Ellipsoid<Scalar, N>& second, const Vector<Scalar, N>& d, bool may_be_flat,
                                OverlapAt<Scalar>& at) noexcept {
  const Matrix<Scalar, N> mixed = lambda * first.shape + (Scalar(1) - lambda) * second.shape;
  Matrix<Scalar, N> l;
  if (const Status status = may_be_flat ? cholesky_semidefinite(mixed, l) : cholesky(mixed, l); status != Status::ok) {
    return status;
  }
  at = overlap_with_factor(lambda, first.shape, second.shape, d, l);
  return Status::ok;
}

/// `overlap_margin` of two ellipsoids that `validate` accepts.
/// \return `not_positive_definite` if λP₁ + (1−λ)P₂ is singular, both being flat.
template <typename Scalar, int N>
[[nodiscard]] Status overlap_of_valid(const Ellipsoid<Scalar, N>& first, const Ellipsoid<Scalar, N>& second,
                                      Scalar& margin) noexcept {
  const Vector<Scalar, N> d = second.center - first.center;
  Scalar low(0);
  Scalar high(1);
  Scalar lambda = scalar::constant<Scalar>(0.5L);
  Scalar largest(0);
  constexpr int most_steps = 60;
  for (int step = 0; step < most_steps; ++step) {
    OverlapAt<Scalar> at;
    if (const Status status = overlap_at(lambda, first, second, d, step > 0, at); status != Status::ok) {
      return status;
    }
    largest = at.value > largest ? at.value : largest;
    if (at.slope == Scalar(0)) {
      break;
    }
    (at.slope > Scalar(0) ? low : high) = lambda;
    // The value is flat at the maximum: an error of √ε in λ is one of ε in it. Newton's step says how far that is, also where it is too
    // short to leave λ, which the bracket would take for a step out of it; and so does the bracket, where the slope is rounding.
    const Scalar enough = scalar::constant<Scalar>(0.1L) * rounding::root<Scalar>() * high;
    if (scalar::abs(at.step) <= enough || high - low <= enough) {
      break;
    }
    lambda += at.step;
    if (!(lambda > low && lambda < high)) {
      lambda = scalar::constant<Scalar>(0.5L) * (low + high);
    }
  }
  margin = Scalar(1) - largest;
  return Status::ok;
}

}  // namespace detail

/// The overlap of two ellipsoids: 1 − max over 0 ≤ λ ≤ 1 of λ(1−λ) dᵀ(λP₁ + (1−λ)P₂)⁻¹d, with d the difference of the
/// centers. It is 1 for a common center, 0 where they touch, and negative if and only if they have no common point. The
/// maximum of this concave function is where λ √(yᵀP₁y) = (1−λ) √(yᵀP₂y), y = (λP₁ + (1−λ)P₂)⁻¹d. (theory, section 7)
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

/// An ellipsoid that contains an intersection, with the share of the second set: 0 is the first set alone, 1 the second; in the
/// paper's notation (eq. LP) q = share / (1 − share).
template <typename Scalar, int N>
struct Intersection {
  Ellipsoid<Scalar, N> set;
  Scalar share;
};

}  // namespace elliptude
