#pragma once

/// \file
/// Which sets a guaranteed filter keeps: the domain in which everything computed from them stays finite.
/// (theory, section 16.9)

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/base/rounding.hpp"

namespace elliptude {

/// The filter's domain. An angular velocity or gyro bias beyond it is refused, or left out as a contradiction is; a set
/// that grows beyond it is forgotten.
template <typename Scalar>
struct FilterDomain {
  static constexpr bool is_single = rounding::is_single<Scalar>;

  /// The largest angular velocity or bias, rad/s, half-width of its bounds, and half-width of γ.
  [[nodiscard]] static Scalar largest() noexcept { return scalar::constant<Scalar>(is_single ? 1e6L : 1e9L); }
  /// rad/s: bounds with smaller half-widths are used as if they were wider by no more than this.
  [[nodiscard]] static Scalar least_width() noexcept { return rounding::one_rounding<Scalar>(); }
};

/// Whether an ellipsoid of the vector is within the domain; false of NaN.
template <typename Scalar>
[[nodiscard]] bool in_domain(const Ellipsoid<Scalar, 3>& vector) noexcept {
  const Scalar largest = FilterDomain<Scalar>::largest();
  // The largest of numbers may be a number though one of them is none.
  return scalar::all_finite(vector.center) && vector.center.cwiseAbs().maxCoeff() <= largest &&
         vector.shape.trace() <= largest * largest;
}

/// The same about the same center, a little wider, so that it has an inverse: E(0, S) is in E(0, S + w²I).
template <typename Scalar>
[[nodiscard]] Ellipsoid<Scalar, 3> with_least_width(const Ellipsoid<Scalar, 3>& vector) noexcept {
  Ellipsoid<Scalar, 3> wider = vector;
  wider.shape.diagonal().array() += FilterDomain<Scalar>::least_width() * FilterDomain<Scalar>::least_width();
  return wider;
}

/// Whether a filter may keep an ellipsoid of the vector: in the domain, finite and positive definite.
template <typename Scalar>
[[nodiscard]] bool can_be_kept(const Ellipsoid<Scalar, 3>& vector) noexcept {
  return scalar::all_finite(vector.shape) && in_domain(vector) && is_positive_definite(vector.shape);
}

/// Whether a set is finite and within the domain; false of NaN.
template <typename State>
[[nodiscard]] bool in_domain(const GibbsEllipsoid<State>& set) noexcept {
  using Scalar = StateScalar<State>;
  const Scalar largest = FilterDomain<Scalar>::largest();
  return scalar::all_finite(set.center.attitude) && scalar::all_finite(vector_part(set.center)) &&
         scalar::all_finite(set.shape) && vector_part(set.center).cwiseAbs().maxCoeff() <= largest &&
         set.shape.trace() <= largest * largest;
}

/// Whether a filter may keep a set: the one test that all sets pass before they are taken up.
template <typename State>
[[nodiscard]] bool can_be_kept(const GibbsEllipsoid<State>& set) noexcept {
  return in_domain(set) && is_positive_definite(set.shape);
}

}  // namespace elliptude
