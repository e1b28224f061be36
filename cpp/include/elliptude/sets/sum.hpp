#pragma once

/// \file
/// What bounds the sum {Σ xᵢ : xᵢ in Eᵢ} of ellipsoids: of two about zero, small by the trace or by the volume, and of
/// many.

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/sets/ellipsoid.hpp"

namespace elliptude {

/// The sum of two ellipsoids about zero, for the least trace (paper, eq. Pmkl); either may be flat, or a point.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> sum_of_shapes(const Matrix<Scalar, N>& a, const Matrix<Scalar, N>& b) noexcept {
  const Scalar width_a = scalar::sqrt(Scalar(a.trace()));
  const Scalar width_b = scalar::sqrt(Scalar(b.trace()));
  if (width_a == Scalar(0)) {
    return b;
  }
  if (width_b == Scalar(0)) {
    return a;
  }
  return (Scalar(1) + width_b / width_a) * a + (Scalar(1) + width_a / width_b) * b;
}

/// A shape whose ellipsoid contains the sum of E(0, P) and E(0, R): (1 + p) P + (1 + 1/p) R for any p > 0. This p is
/// the best for the volume to first order in R.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> enlarged(const Matrix<Scalar, N>& shape, const Matrix<Scalar, N>& added) noexcept {
  Matrix<Scalar, N> inverse;
  Scalar square = inverse_positive_definite(shape, inverse) == Status::ok
                      ? Scalar(inverse.cwiseProduct(added).sum() / Scalar(N))
                      : Scalar(added.trace() / shape.trace());
  if (!(square > Scalar(0)) || !scalar::isfinite(square)) {
    if (!(added.trace() > Scalar(0))) {
      return shape;
    }
    square = Scalar(1);
  }
  const Scalar p = scalar::sqrt(square);
  Matrix<Scalar, N> sum = (Scalar(1) + p) * shape + (Scalar(1) + Scalar(1) / p) * added;
  sum.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::sum);
  return sum;
}

namespace detail {

/// Terms of a sum with their shares αᵢ, not divided by their total: P = Σ Pᵢ/αᵢ.
template <typename Scalar, int N>
struct SharedSum {
  static constexpr std::size_t max_terms = 64;
  static constexpr int most_steps = 20;  ///< by volume
  using Shares = std::array<Scalar, max_terms>;

  const Ellipsoid<Scalar, N>* terms;
  std::size_t count;
  Shares share{};
  Scalar total{0};

  [[nodiscard]] Matrix<Scalar, N> shape() const noexcept {
    Matrix<Scalar, N> sum = Matrix<Scalar, N>::Zero();
    for (std::size_t i = 0; i < count; ++i) {
      if (share[i] > Scalar(0)) {
        sum += (total / share[i]) * terms[i].shape;
      }
    }
    return sum;
  }

  /// αᵢ ∝ √tr(W Pᵢ), the best for the trace.
  /// \return the status of `validate` for a term; `not_positive_definite` of one that is flat to rounding in the metric
  /// W.
  [[nodiscard]] Status share_by_trace(const Matrix<Scalar, N>& weight) noexcept {
    for (std::size_t i = 0; i < count; ++i) {
      if (const Status status = validate(terms[i]); status != Status::ok) {
        return status;
      }
      const Scalar square = weight.cwiseProduct(terms[i].shape).sum();
      if (!(square > Scalar(0)) && scalar::largest_size(terms[i].shape) > Scalar(0)) {
        // A term must not be lost to rounding.
        return Status::not_positive_definite;
      }
      share[i] = scalar::sqrt(square);
      total += share[i];
    }
    return Status::ok;
  }

  /// One step towards αᵢ ∝ √tr(P⁻¹Pᵢ), the best for the volume, which falls.
  /// \param change by how much a share has changed at most.
  /// \return `not_positive_definite` of a sum that is flat to rounding.
  [[nodiscard]] Status step_by_volume(const Matrix<Scalar, N>& present, Scalar& change) noexcept {
    Matrix<Scalar, N> inverse;
    if (const Status status = inverse_positive_definite(present, inverse); status != Status::ok) {
      return status;
    }
    Shares next{};
    Scalar next_total(0);
    for (std::size_t i = 0; i < count; ++i) {
      if (share[i] > Scalar(0)) {
        const Scalar square = inverse.cwiseProduct(terms[i].shape).sum();
        if (!(square > Scalar(0))) {  // flat to rounding
          return Status::not_positive_definite;
        }
        next[i] = scalar::sqrt(square);
        next_total += next[i];
      }
    }
    change = Scalar(0);
    for (std::size_t i = 0; i < count; ++i) {
      const Scalar difference = scalar::abs(Scalar(next[i] / next_total - share[i] / total));
      change = difference > change ? difference : change;
    }
    share = next;
    total = next_total;
    return Status::ok;
  }
};

}  // namespace detail

/// A small ellipsoid that contains the sum {Σ xᵢ : xᵢ in Eᵢ} of `count` ellipsoids: P = Σ Pᵢ/αᵢ with Σ αᵢ = 1. For the
/// trace αᵢ ∝ √tr(W Pᵢ) is the best of this family (paper, eq. Pmkl). For the volume the best has αᵢ ∝ √tr(P⁻¹Pᵢ), the
/// fixed point of an iteration in which the volume falls at every step (log det is concave, so its tangent majorises
/// it). It ends when no share changes by more than 1e-4: log det P is within 2e-7 of its least in all trials. What the logarithms
/// of shares change by halves at each step, so that it ends before its bound of steps unless rounding keeps it going.
/// (theory, section 7.2) Terms with a shape of zeros only move the center.
/// \return `out_of_range` for no terms or more than 64; the status of `validate` for a term or for the criterion; for
/// the volume `not_positive_definite` if the sum is flat to rounding, for the weighted trace if a term is so in the
/// metric W; `beyond_domain` if the sum overflows.
template <typename Scalar, int N>
[[nodiscard]] Status minimal_sum(const Ellipsoid<Scalar, N>* terms, std::size_t count,
                                 const SizeCriterion<Scalar, N>& criterion, Ellipsoid<Scalar, N>& sum) noexcept {
  if (count == 0 || count > detail::SharedSum<Scalar, N>::max_terms) {
    return Status::out_of_range;
  }
  if (const Status status = detail::validate_any(criterion); status != Status::ok) {
    return status;
  }
  // The best shares for the trace; for the volume they are where the iteration starts.
  detail::SharedSum<Scalar, N> shared{terms, count};
  if (const Status status = shared.share_by_trace(criterion.weight); status != Status::ok) {
    return status;
  }
  Vector<Scalar, N> center = Vector<Scalar, N>::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    center += terms[i].center;
  }
  Matrix<Scalar, N> shape = shared.shape();
  if (criterion.kind == SizeCriterion<Scalar, N>::Kind::volume) {
    constexpr int most_steps = detail::SharedSum<Scalar, N>::most_steps;
    const Scalar least_change = scalar::constant<Scalar>(1e-4L);
    bool settled = false;
    for (int step = 0; step < most_steps && !settled; ++step) {
      Scalar change;
      if (const Status status = shared.step_by_volume(shape, change); status != Status::ok) {
        return status;
      }
      shape = shared.shape();
      settled = change <= least_change;
    }
  }
  if (!scalar::all_finite(shape) || !scalar::all_finite(center)) {
    return Status::beyond_domain;
  }
  if (!is_positive_definite(shape)) {
    // Rounding may make a sum indefinite that cannot be, as one of its terms is not flat: an entry errs by a few ε of
    // its own terms, each at most √(Pᵢᵢ Pⱼⱼ).
    for (std::size_t i = 0; i < count; ++i) {
      if (is_positive_definite(terms[i].shape)) {
        shape.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::many_terms);
        break;
      }
    }
  }
  sum.center = center;
  sum.shape = shape;
  return Status::ok;
}

/// A shape whose ellipsoid contains all [x; y] with x in E(0, A) and y in E(0, B): diag(A/α, B/(1 − α)). The best α is,
/// for the volume, the share of numbers that x has; for the trace, of √tr(W₁₁A) and √tr(W₂₂B). Either may be flat, or a
/// point.
/// \return `not_positive_definite` for the volume if A or B is flat to rounding, for the weighted trace if one is so in
/// the metric W; `beyond_domain` if the product overflows.
template <typename Scalar, int M, int N>
[[nodiscard]] Status product_of_shapes(const Matrix<Scalar, M>& a, const Matrix<Scalar, N>& b,
                                       const SizeCriterion<Scalar, M + N>& criterion,
                                       Matrix<Scalar, M + N>& product) noexcept {
  Scalar part_a(M);
  Scalar part_b(N);
  if (!criterion.by_volume()) {
    part_a = scalar::sqrt(Scalar(criterion.weight.template topLeftCorner<M, M>().cwiseProduct(a).sum()));
    part_b = scalar::sqrt(Scalar(criterion.weight.template bottomRightCorner<N, N>().cwiseProduct(b).sum()));
  } else {
    if (!is_positive_definite(a) || !is_positive_definite(b)) {
      return Status::not_positive_definite;
    }
  }
  if ((!(part_a > Scalar(0)) && !a.isZero(Scalar(0))) || (!(part_b > Scalar(0)) && !b.isZero(Scalar(0)))) {
    return Status::not_positive_definite;  // it would be lost to rounding
  }
  const Scalar whole = part_a + part_b;
  Matrix<Scalar, M + N> result = Matrix<Scalar, M + N>::Zero();
  if (part_a > Scalar(0)) {
    result.template topLeftCorner<M, M>() = (whole / part_a) * a;
  }
  if (part_b > Scalar(0)) {
    result.template bottomRightCorner<N, N>() = (whole / part_b) * b;
  }
  if (!scalar::all_finite(result)) {
    return Status::beyond_domain;
  }
  product = result;
  return Status::ok;
}

}  // namespace elliptude
