#pragma once

/// \file
/// A set about what two sets of states have in common. (theory, sections 20.3 and 20.5)

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/sets/quadric_fusion.hpp"

namespace elliptude {

/// A set in the coordinates [γ; δ] about another center, in which it is an ellipsoid but for a stretch: with ĝ the
/// Gibbs vector of the turn to that center γ⁺ = −2ĝ + σ B γ, B = I − S(ĝ) + ĝĝᵀ and |1/σ − 1| ≤ e = ½ √(ĝᵀPĝ). The
/// result contains the set without remainder. (theory, eq. 20.4)
/// \return `unbounded` if e is above 0.9, as about that center the set may be near half turns, or if it is so wide that
/// rounding does that; `not_finite`.
template <typename State>
[[nodiscard]] Status seen_from(const State& center, const GibbsEllipsoid<State>& set,
                               Ellipsoid<StateScalar<State>, 6>& seen) noexcept {
  using Scalar = StateScalar<State>;
  const Matrix3<Scalar> turn = set.center.attitude.transpose().lazyProduct(center.attitude);
  const Vector3<Scalar> g = cayley_inverse(turn);
  if (!scalar::all_finite(turn) || !scalar::all_finite(set.shape)) {
    return Status::not_finite;
  }
  const Matrix3<Scalar> attitude = set.shape.template topLeftCorner<3, 3>();
  const Scalar e = rounding::enlarged(
      Scalar(scalar::constant<Scalar>(0.5L) * scalar::sqrt(detail::square_from_above(attitude, g))), rounding::product);
  if (!(e <= scalar::constant<Scalar>(0.9L))) {
    return Status::unbounded;
  }
  const Matrix3<Scalar> b = Matrix3<Scalar>::Identity() - hat(g) + g.lazyProduct(g.transpose());
  const Matrix6<Scalar> shape = covered_congruence(b, set.shape);
  // The computed ĝ is that of a center near the one that is meant, which moves γ⁺ by that turn times 1 + ¼‖γ⁺‖², and a
  // little more while the turn times ‖γ⁺‖ is small; rounding of B acts on γ.
  const Scalar stretch = Scalar(1) / (Scalar(1) - e);
  const Scalar square_reach =
      Scalar(4) * g.squaredNorm() + stretch * stretch * shape.template topLeftCorner<3, 3>().trace();
  const Scalar slip = rounding::share<Scalar>(rounding::turn_between);
  if (!(slip * scalar::sqrt(square_reach) <= scalar::constant<Scalar>(0.5L))) {
    return Status::unbounded;
  }
  const Scalar attitude_slip = slip * (Scalar(1) + square_reach);
  const Vector3<Scalar> offset = vector_part(set.center) - vector_part(center);
  const Scalar vector_slip =
      rounding::one_rounding<Scalar>() * (vector_part(set.center).norm() + vector_part(center).norm());
  Ellipsoid<Scalar, 6> result;
  result.center << Scalar(-2) * g, offset;
  result.shape = detail::with_attitude_added(shape, Scalar(e * stretch), attitude_slip, vector_slip);
  if (!scalar::all_finite(result.center) || !scalar::all_finite(result.shape)) {
    return Status::unbounded;
  }
  seen = result;
  return Status::ok;
}

namespace detail {

/// What the first N coordinates of an ellipsoid about zero and of another have in common.
/// \return the status of `minimal_intersection`; `unbounded` if it is the first.
template <int N, typename Scalar>
[[nodiscard]] Status common_part(const Ellipsoid<Scalar, 6>& first, const Ellipsoid<Scalar, 6>& second,
                                 const SizeCriterion<Scalar, N>& criterion, Ellipsoid<Scalar, 6>& result) noexcept {
  const Ellipsoid<Scalar, N> predicted = projection<0, N>(first);
  Quadric<Scalar, N> quadric;
  if (const Status status = to_quadric(projection<0, N>(second), quadric); status != Status::ok) {
    return status;
  }
  QuadricFusion<Scalar, N> fusion;
  if (const Status status = minimal_intersection(&predicted, &quadric, 1, criterion, fusion); status != Status::ok) {
    return status;
  }
  if (fusion.prediction_alone) {
    return Status::unbounded;
  }
  result = first;
  result.center.template head<N>() = fusion.set.center;
  result.shape.template topLeftCorner<N, N>() = fusion.set.shape;
  return Status::ok;
}

}  // namespace detail

/// What the size of a common set is measured by, and of which kind the sets are.
template <typename Scalar>
struct CommonSetSettings {
  SizeCriterion<Scalar, 6> criterion = SizeCriterion<Scalar, 6>::volume();
  /// Whether the vector is left to its bound: shapes are of two sets, with zeros between, and the first's vector is
  /// kept.
  bool is_product = false;
};

/// A small set about what two sets have in common, about its own center; the first, bit for bit, if none smaller is
/// found.
/// \param first, second positive definite, about rotations to rounding, as filters have them.
/// \return `empty_intersection` with a proof that they have nothing in common; the status of `validate` for the
/// criterion; `not_finite`.
template <typename State>
[[nodiscard]] Status common_set(const GibbsEllipsoid<State>& first, const GibbsEllipsoid<State>& second,
                                const CommonSetSettings<StateScalar<State>>& settings,
                                GibbsEllipsoid<State>& result) noexcept {
  using Scalar = StateScalar<State>;
  const SizeCriterion<Scalar, 6>& criterion = settings.criterion;
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  if (!scalar::all_finite(first.shape) || !scalar::all_finite(vector_part(first.center))) {
    return Status::not_finite;
  }
  Ellipsoid<Scalar, 6> seen;
  Ellipsoid<Scalar, 6> common;
  Status status = seen_from(first.center, second, seen);
  if (status == Status::ok) {
    const Ellipsoid<Scalar, 6> about = first.in_coordinates();
    status = settings.is_product ? detail::common_part<3>(about, seen, criterion.template of_first<3>(), common)
                                 : detail::common_part<6>(about, seen, criterion, common);
  }
  if (status == Status::empty_intersection || status == Status::not_finite) {
    return status;
  }
  GibbsEllipsoid<State> placed;
  if (status == Status::ok && recentred(first.center, common, placed) == Status::ok) {
    if (settings.is_product) {
      placed.center = State{placed.center.attitude, vector_part(first.center)};
      placed.shape.template bottomRightCorner<3, 3>() = first.shape.template bottomRightCorner<3, 3>();
    }
    if (detail::is_smaller_set(placed.in_coordinates(), first.in_coordinates(), criterion)) {
      result = placed;
      return Status::ok;
    }
  }
  result = first;
  return Status::ok;
}

}  // namespace elliptude
