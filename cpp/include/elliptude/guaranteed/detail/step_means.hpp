#pragma once

/// \file
/// Bounds of the integrals of terms that change within a step of a tube: numbers only. (theory, section 17.4)
///
/// x = |s − h/2|/(h/2) is how far a time is from the middle of the step, in parts of half of it. Y(s) = Y(h/2) (I +
/// W(s)), and ‖W(s)‖ ≤ x times `odd` for its part that is linear in s − h/2, and x² times `all` − `odd` for what is
/// left of it.

#include "elliptude/base/scalar.hpp"

namespace elliptude {
namespace detail::step_means {

template <typename Scalar>
[[nodiscard]] Scalar cube_of(const Scalar& x) noexcept {
  return x * x * x;
}
template <typename Scalar>
[[nodiscard]] Scalar fourth_of(const Scalar& x) noexcept {
  return x * x * x * x;
}

/// Bounds of W within a step, less than one.
template <typename Scalar>
struct LinearChange {
  Scalar odd;
  Scalar all;

  /// ‖Y(s) u‖ against that in the middle, block by block.
  [[nodiscard]] Scalar stretch() const noexcept { return Scalar(1) + all; }
  /// ‖Y(s)⁻¹ v‖ against that in the middle.
  [[nodiscard]] Scalar shrink() const noexcept { return Scalar(1) / (Scalar(1) - all); }
};

/// How far the torque's forms are from those used in the middle, in parts of their bound (theory, eq. 17.5).
template <typename Scalar>
struct FormChange {
  Scalar drift;  ///< what is linear in s − h/2, where the step ends
  Scalar rest;   ///< what is of second order in s − h/2, there
  /// At all times: the forms in the middle are those of the first terms of the directions they are made of.
  Scalar missing;

  /// \param degree of the torque, 1 or 2, and 0 of none.
  /// \param turn_rate sum of the body's and the potential's rate, at most.
  /// \param turn_acceleration of the body, at most.
  /// \param middle half of the step.
  /// \param truncated what a unit vector lacks, at most.
  [[nodiscard]] static FormChange within(const Scalar& degree, const Scalar& turn_rate, const Scalar& turn_acceleration,
                                         const Scalar& middle, const Scalar& truncated) noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    FormChange change;
    change.drift = degree * turn_rate * middle;
    change.rest = half * (change.drift * change.drift + degree * turn_acceleration * middle * middle);
    change.missing = degree * truncated * (Scalar(1) + truncated);
    return change;
  }
};

/// Bounds of the second-order terms of u', for ‖u‖ ≤ 1 (theory, eq. 17.7).
template <typename Scalar>
struct SecondOrder {
  Scalar quadrature;  ///< how far their integral is from the step's length times their value in the middle
  Scalar integral;    ///< of their norm
  Scalar largest;     ///< norm

  /// \param largest_form norm of the quadratic map in the middle.
  /// \param form_bound bound of the torque's forms in it.
  [[nodiscard]] static SecondOrder of(const Scalar& largest_form, const Scalar& form_bound,
                                      const LinearChange<Scalar>& linear, const FormChange<Scalar>& change,
                                      const Scalar& h) noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar growth = linear.stretch() * linear.stretch() * linear.shrink();
    const Scalar odd = Scalar(3) * linear.odd * largest_form + form_bound * change.drift;
    const Scalar at_ends = growth * (largest_form + form_bound * (change.drift + change.rest));
    const Scalar even = at_ends - largest_form - odd;  // of second order in s − h/2
    SecondOrder means;
    means.quadrature = even * h / Scalar(3) + growth * change.missing * form_bound * h;
    means.integral = (largest_form + half * odd) * h + means.quadrature;
    means.largest = at_ends + growth * change.missing * form_bound;
    return means;
  }

  /// What they add up to at u₀ + e rather than at u₀, if ‖e‖ is at most a line from `mean` − 1 − `moved`/2 to `mean` −
  /// 1 + `moved`/2 (theory, eq. 17.8).
  [[nodiscard]] Scalar displaced(const Scalar& mean, const Scalar& moved, const Scalar& h) const noexcept {
    return integral * (mean * mean - Scalar(1)) + largest * h * moved * moved / Scalar(12);
  }
};

/// ‖u‖ on a line from `first` to `last`, and the means of eq. 17.9.
template <typename Scalar>
struct Line {
  Scalar first;
  Scalar last;

  [[nodiscard]] Scalar mean() const noexcept { return scalar::constant<Scalar>(0.5L) * (first + last); }
  [[nodiscard]] Scalar cube_at_ends(const Scalar& stretch) const noexcept {
    return cube_of(stretch) * scalar::constant<Scalar>(0.5L) * (cube_of(first) + cube_of(last));
  }
  [[nodiscard]] Scalar fourth_at_ends(const Scalar& stretch) const noexcept {
    return fourth_of(stretch) * scalar::constant<Scalar>(0.5L) * (fourth_of(first) + fourth_of(last));
  }
  /// The mean of (1 + ‖W‖)³ ‖u‖³ over the step.
  [[nodiscard]] Scalar mean_cube(const Scalar& stretch) const noexcept {
    return scalar::constant<Scalar>(0.5L) * (cube_of(mean()) + cube_at_ends(stretch));
  }
  /// The mean of (1 + ‖W‖)⁴ ‖u‖⁴ over the step.
  [[nodiscard]] Scalar mean_fourth(const Scalar& stretch) const noexcept {
    return scalar::constant<Scalar>(0.5L) * (fourth_of(mean()) + fourth_at_ends(stretch));
  }
};

/// What forms of third order that change add up to beyond h times those in the middle at u₀, in parts of h and their
/// bound.
template <typename Scalar>
[[nodiscard]] Scalar changing_cubes(const FormChange<Scalar>& change, const LinearChange<Scalar>& linear,
                                    const Scalar& cube_at_ends) noexcept {
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar at_ends = linear.shrink() * cube_at_ends;
  return half * change.drift * (at_ends - Scalar(1)) + (half * change.rest + change.missing) * at_ends;
}

}  // namespace detail::step_means
}  // namespace elliptude
