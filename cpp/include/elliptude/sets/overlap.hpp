#pragma once

/// \file
/// Whether two ellipsoids have a common point, and the result type for a bound of their intersection.

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/ellipsoid.hpp"

namespace elliptude {

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
  const Vector<Scalar, N> d = second.center - first.center;
  Scalar low(0);
  Scalar high(1);
  Scalar lambda = scalar::constant<Scalar>(0.5L);
  Scalar largest(0);
  constexpr int most_steps = 60;
  for (int step = 0; step < most_steps; ++step) {
    const Matrix<Scalar, N> mixed = lambda * first.shape + (Scalar(1) - lambda) * second.shape;
    Matrix<Scalar, N> l;
    // Towards the end where one set is alone, and perhaps flat, the mixture may be flat to rounding.
    if (const Status status = step == 0 ? cholesky(mixed, l) : cholesky_semidefinite(mixed, l); status != Status::ok) {
      return status;
    }
    const Vector<Scalar, N> y = solve_lower_transposed(l, solve_lower(l, d));
    const Vector<Scalar, N> y1 = first.shape.lazyProduct(y);
    const Vector<Scalar, N> y2 = second.shape.lazyProduct(y);
    const Scalar p1 = y.dot(y1);
    const Scalar p2 = y.dot(y2);
    const Scalar value = lambda * (Scalar(1) - lambda) * d.dot(y);
    largest = value > largest ? value : largest;
    const Scalar slope = (Scalar(1) - lambda) * (Scalar(1) - lambda) * p2 - lambda * lambda * p1;
    if (slope == Scalar(0)) {
      break;
    }
    (slope > Scalar(0) ? low : high) = lambda;
    const Vector<Scalar, N> dy = solve_lower_transposed(l, solve_lower(l, Vector<Scalar, N>(y2 - y1)));
    const Scalar curvature =
        Scalar(-2) * (lambda * p1 + (Scalar(1) - lambda) * p2) +
        Scalar(2) * ((Scalar(1) - lambda) * (Scalar(1) - lambda) * y2.dot(dy) - lambda * lambda * y1.dot(dy));
    Scalar next = lambda - slope / curvature;
    if (!(next > low && next < high)) {
      next = scalar::constant<Scalar>(0.5L) * (low + high);
    }
    const Scalar change = scalar::abs(Scalar(next - lambda));
    lambda = next;
    // The value is flat at the maximum: an error of √ε in λ is one of ε in it.
    if (change <= scalar::constant<Scalar>(0.1L) * rounding::root<Scalar>() * (low < high ? high : low)) {
      break;
    }
  }
  margin = Scalar(1) - largest;
  return Status::ok;
}

/// An ellipsoid that contains an intersection, with the share of the second set: 0 is the first set alone, 1 the second; in the
/// paper's notation (eq. LP) q = share / (1 − share).
template <typename Scalar, int N>
struct Intersection {
  Ellipsoid<Scalar, N> set;
  Scalar share;
};

}  // namespace elliptude
