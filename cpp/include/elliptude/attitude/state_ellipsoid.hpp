#pragma once

/// \file
/// What a filter keeps: the ellipsoid E(Ĉ, ω̂, P) of states about a state (paper, eq. ueso).

#include "elliptude/attitude/state.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/sum.hpp"

namespace elliptude {

/// The set {retract(center, x) : xᵀ P⁻¹ x ≤ 1} in the coordinates x of a chart. P, rad² and rad²/s², is the shape of a
/// set, not a covariance.
template <typename State, typename Chart = ExponentialChart>
struct StateEllipsoid {
  using Scalar = StateScalar<State>;

  State center;
  Matrix6<Scalar> shape;

  /// The same set in the coordinates x, about zero.
  [[nodiscard]] Ellipsoid<Scalar, 6> in_coordinates() const noexcept { return {Vector6<Scalar>::Zero(), shape}; }
};

/// A set in the Gibbs chart: what the guaranteed filter keeps.
template <typename State>
using GibbsEllipsoid = StateEllipsoid<State, GibbsChart>;

/// \return `not_finite`, `not_a_rotation`, `not_symmetric`, `not_positive_definite`.
template <typename State, typename Chart>
[[nodiscard]] Status validate(const StateEllipsoid<State, Chart>& ellipsoid) noexcept {
  using Scalar = StateScalar<State>;
  if (!is_finite(ellipsoid.center)) {
    return Status::not_finite;
  }
  if (!is_rotation(ellipsoid.center.attitude, rotation_tolerance<Scalar>())) {
    return Status::not_a_rotation;
  }
  return validate(ellipsoid.in_coordinates());
}

/// xᵀP⁻¹x of a state, at most 1 inside.
template <typename State, typename Chart>
[[nodiscard]] Status quadratic_form(const StateEllipsoid<State, Chart>& ellipsoid, const State& state,
                                    StateScalar<State>& value) noexcept {
  return quadratic_form(ellipsoid.in_coordinates(), state_error<Chart>(ellipsoid.center, state), value);
}

/// How far a set reaches, as angles of the attitude and in the vector beside it, in any chart; in the Gibbs chart the
/// half-widths of ζ are bounds.
template <typename Scalar>
struct Extent {
  Vector6<Scalar> half_widths_body;       ///< of ζ (rad) and of the vector (rad/s), along body axes
  Vector3<Scalar> half_widths_reference;  ///< of ζ along reference axes, rad
  Scalar largest_angle;                   ///< largest ‖ζ‖ in the set, rad
  Vector3<Scalar> largest_angle_axis;     ///< unit vector in body axes: the axis of the turn that is known least
  Vector6<Scalar> greatest_uncertainty;   ///< unit eigenvector of P to its largest eigenvalue (paper, §3.3)
};

namespace detail {

/// The largest length of a vector in an ellipsoid, no less for rounding.
template <typename Scalar>
[[nodiscard]] Scalar largest_length(const Matrix3<Scalar>& shape, const SymmetricEigen<Scalar, 3>& eigen) noexcept {
  const Scalar square = eigen.values(0) + eigen_errors(shape, eigen).values;
  return rounding::enlarged(Scalar(scalar::sqrt(square > Scalar(0) ? square : Scalar(0))), rounding::attitude_angle);
}

}  // namespace detail

/// No number in it is less for rounding.
/// \return `not_finite`, `not_converged`.
template <typename State, typename Chart>
[[nodiscard]] Status extent(const StateEllipsoid<State, Chart>& ellipsoid,
                            Extent<StateScalar<State>>& result) noexcept {
  using Scalar = StateScalar<State>;
  Extent<Scalar> extent;
  const Scalar more = Scalar(1) + rounding::share<Scalar>(rounding::attitude_angle);
  extent.half_widths_body = more * half_widths(ellipsoid.in_coordinates());
  const Matrix3<Scalar> attitude_shape = ellipsoid.shape.template topLeftCorner<3, 3>();
  const Matrix3<Scalar> in_reference = covered_image(ellipsoid.center.attitude, attitude_shape);
  extent.half_widths_reference = more * in_reference.diagonal().cwiseMax(Scalar(0)).cwiseSqrt();
  for (int i = 0; i < 3; ++i) {
    extent.half_widths_body(i) = Chart::angle(Scalar(extent.half_widths_body(i)));
    extent.half_widths_reference(i) = Chart::angle(Scalar(extent.half_widths_reference(i)));
  }
  SymmetricEigen<Scalar, 3> attitude;
  if (const Status status = symmetric_eigen(attitude_shape, attitude); status != Status::ok) {
    return status;
  }
  extent.largest_angle = Chart::angle(detail::largest_length(attitude_shape, attitude));
  extent.largest_angle_axis = attitude.vectors.col(0);
  SymmetricEigen<Scalar, 6> whole;
  if (const Status status = symmetric_eigen(ellipsoid.shape, whole); status != Status::ok) {
    return status;
  }
  extent.greatest_uncertainty = whole.vectors.col(0);
  result = extent;
  return Status::ok;
}

namespace detail {

/// What a change of coordinates adds to a shape: E(0, `factor`² P_attitude) in the attitude, and balls for the rounding
/// of the new center, in attitude (rad) and vector.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> with_attitude_added(const Matrix6<Scalar>& shape, const Scalar& factor,
                                                  const Scalar& attitude_slip, const Scalar& vector_slip) noexcept {
  // The slips are of different coordinates, together in E(0, 2 R), and beside the ellipsoid share p: (1 + p) and (1 +
  // 1/p).
  const Scalar square = attitude_slip * attitude_slip;
  const Scalar least = scalar::constant<Scalar>(1.0L / 64.0L);
  const Scalar size = factor * factor * shape.template topLeftCorner<3, 3>().trace();
  Scalar p = least;
  Scalar slip_factor = Scalar(2);
  if (size > Scalar(0)) {
    const Scalar best = scalar::sqrt(Scalar(Scalar(6) * square / size));
    p = best > least ? best : least;
    slip_factor *= Scalar(1) + Scalar(1) / p;
  }
  Matrix6<Scalar> added = Matrix6<Scalar>::Zero();
  if (size > Scalar(0)) {
    added.template topLeftCorner<3, 3>() = ((Scalar(1) + p) * factor * factor) * shape.template topLeftCorner<3, 3>();
  }
  added.diagonal().template head<3>().array() += slip_factor * square;
  added.diagonal().template tail<3>().array() += slip_factor * vector_slip * vector_slip;
  return enlarged(shape, added);
}

/// gᵀPg, and not less than it is: its terms may cancel where a set is thin.
template <typename Scalar>
[[nodiscard]] Scalar square_from_above(const Matrix3<Scalar>& shape, const Vector3<Scalar>& g) noexcept {
  const Scalar width = g.cwiseAbs().dot(shape.diagonal().cwiseSqrt());
  const Scalar computed = g.dot(shape.lazyProduct(g));
  return (computed > Scalar(0) ? computed : Scalar(0)) + rounding::share<Scalar>(rounding::component) * width * width;
}

}  // namespace detail

/// Moves the ellipsoid of errors [γ; δ] about a center to its own center. Where g = γ/2 is seen from ĝ it is
/// g⁺ = (g − ĝ − ĝ×g)/(1 + ĝ·g), so that γ⁺ = σ B (γ − γ̂) with B = (I − S(ĝ))/(1 + ‖ĝ‖²) and |σ − 1| ≤ e/(1 − e),
/// e = √(ĝᵀPĝ)/(2(1 + ‖ĝ‖²)): the result contains the set without remainder. (theory, section 16.3)
/// \return `unbounded` if e ≥ 1: about the new center the set may hold half turns; `not_finite`.
template <typename State>
[[nodiscard]] Status recentred(const State& center, const Ellipsoid<StateScalar<State>, 6>& ellipsoid,
                               StateEllipsoid<State, GibbsChart>& result) noexcept {
  using Scalar = StateScalar<State>;
  if (!is_finite(center) || !scalar::all_finite(ellipsoid.center) || !scalar::all_finite(ellipsoid.shape)) {
    return Status::not_finite;
  }
  const Vector3<Scalar> g = scalar::constant<Scalar>(0.5L) * ellipsoid.center.template head<3>();
  const Scalar scale = Scalar(1) + g.squaredNorm();
  const Matrix3<Scalar> attitude = ellipsoid.shape.template topLeftCorner<3, 3>();
  const Scalar e = rounding::enlarged(
      Scalar(scalar::sqrt(detail::square_from_above(attitude, g)) / (Scalar(2) * scale)), rounding::product);
  if (!(e < Scalar(1))) {
    return Status::unbounded;
  }
  Matrix3<Scalar> b = (Scalar(-1) / scale) * hat(g);
  b.diagonal().array() += Scalar(1) / scale;
  State moved = retract<GibbsChart>(center, ellipsoid.center);
  moved.attitude = renormalized(moved.attitude);  // the rounding of many updates without a prediction must not add up
  // A turn of the center by a moves γ by at most a (1 + ‖γ/2‖²), and a little more as a is not nothing; rounding of B
  // acts on γ.
  const Scalar stretch = Scalar(1) / (Scalar(1) - e);
  const Scalar square_reach = stretch * stretch * ellipsoid.shape.template topLeftCorner<3, 3>().trace();
  const Scalar attitude_slip = rounding::share<Scalar>(rounding::center) * (Scalar(1) + square_reach);
  const Scalar vector_slip =
      rounding::one_rounding<Scalar>() * (vector_part(center).norm() + ellipsoid.center.template tail<3>().norm());
  result = {moved, detail::with_attitude_added(covered_congruence(b, ellipsoid.shape), Scalar(e * stretch),
                                               attitude_slip, vector_slip)};
  return Status::ok;
}

/// The largest length of an attitude error in the set, in the chart's coordinates.
template <typename State, typename Chart>
[[nodiscard]] Status largest_attitude_error(const StateEllipsoid<State, Chart>& ellipsoid,
                                            StateScalar<State>& length) noexcept {
  using Scalar = StateScalar<State>;
  const Matrix3<Scalar> shape = ellipsoid.shape.template topLeftCorner<3, 3>();
  SymmetricEigen<Scalar, 3> eigen;
  if (const Status status = symmetric_eigen(shape, eigen); status != Status::ok) {
    return status;
  }
  length = detail::largest_length(shape, eigen);
  return Status::ok;
}

/// The same set in another chart, enlarged by what an ellipsoid in it needs. ζ → γ adds the ellipsoid (τ − 1)² P_ζζ,
/// with τ at the largest angle in the set. (theory, section 16.4)
/// \return the status of `validate`; `unbounded` if the set holds half turns.
template <typename State>
[[nodiscard]] Status converted(const StateEllipsoid<State, ExponentialChart>& from,
                               StateEllipsoid<State, GibbsChart>& to) noexcept {
  using Scalar = StateScalar<State>;
  if (const Status status = validate(from); status != Status::ok) {
    return status;
  }
  Scalar angle;
  if (const Status status = largest_attitude_error(from, angle); status != Status::ok) {
    return status;
  }
  if (!(angle < scalar::pi<Scalar>())) {
    return Status::unbounded;
  }
  const Scalar stretch = rounding::enlarged(gibbs_stretch(angle), rounding::product);
  const Matrix6<Scalar> shape =
      detail::with_attitude_added(from.shape, Scalar(stretch - Scalar(1)), Scalar(0), Scalar(0));
  if (!(stretch >= Scalar(1)) || !scalar::all_finite(shape)) {  // rounded to π or beyond
    return Status::unbounded;
  }
  to = {from.center, shape};
  return Status::ok;
}

/// γ → ζ adds the ellipsoid (1 − 1/τ)² P_γγ. \return the status of `validate`.
template <typename State>
[[nodiscard]] Status converted(const StateEllipsoid<State, GibbsChart>& from,
                               StateEllipsoid<State, ExponentialChart>& to) noexcept {
  using Scalar = StateScalar<State>;
  if (const Status status = validate(from); status != Status::ok) {
    return status;
  }
  Scalar length;
  if (const Status status = largest_attitude_error(from, length); status != Status::ok) {
    return status;
  }
  const Scalar shrink = length > Scalar(0) ? Scalar(GibbsChart::angle(length) / length) : Scalar(1);
  const Scalar factor = Scalar(1) - shrink + rounding::share<Scalar>(rounding::product);
  to = {from.center, detail::with_attitude_added(from.shape, factor, Scalar(0), Scalar(0))};
  return Status::ok;
}

}  // namespace elliptude
