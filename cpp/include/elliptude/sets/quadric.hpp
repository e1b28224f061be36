#pragma once

/// \file
/// Quadrics {y : yᵀAy + 2gᵀy ≤ c}. A need not be positive definite: a half-space, a slab, a cylinder and a cone's
/// interior are quadrics as an ellipsoid is, and a measurement says that the state is in one. (theory, section 7)

#include <cstdint>

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/intersection.hpp"

namespace elliptude {

template <typename Scalar, int N>
struct Quadric {
  Matrix<Scalar, N> a;  ///< symmetric
  Vector<Scalar, N> g;
  Scalar c;
};

/// Which three of six coordinates: of [γ; δ] the first are the attitude's.
enum class Half : std::uint8_t { first, second };

/// A quadric of three of six coordinates, as most measurements are of one half of a state's error [γ; δ].
template <typename Scalar>
struct HalfQuadric {
  Quadric<Scalar, 3> quadric;
  Half half;
};

/// The same as a quadric of all six coordinates.
template <typename Scalar>
[[nodiscard]] Quadric<Scalar, 6> extended(const HalfQuadric<Scalar>& half) noexcept {
  const int start = half.half == Half::first ? 0 : 3;
  Quadric<Scalar, 6> result{Matrix6<Scalar>::Zero(), Vector6<Scalar>::Zero(), half.quadric.c};
  result.a.template block<3, 3>(start, start) = half.quadric.a;
  result.g.template segment<3>(start) = half.quadric.g;
  return result;
}
template <typename Scalar, int N>
[[nodiscard]] const Quadric<Scalar, N>& extended(const Quadric<Scalar, N>& quadric) noexcept {
  return quadric;
}

/// \return `not_finite`, `not_symmetric`.
template <typename Scalar, int N>
[[nodiscard]] Status validate(const Quadric<Scalar, N>& quadric) noexcept {
  if (!scalar::all_finite(quadric.a) || !scalar::all_finite(quadric.g) || !scalar::isfinite(quadric.c)) {
    return Status::not_finite;
  }
  return is_symmetric(quadric.a) ? Status::ok : Status::not_symmetric;
}

template <typename Scalar>
[[nodiscard]] Status validate(const HalfQuadric<Scalar>& half) noexcept {
  return validate(half.quadric);
}

/// c − yᵀAy − 2gᵀy: not negative inside.
template <typename Scalar, int N>
[[nodiscard]] Scalar slack(const Quadric<Scalar, N>& quadric, const Vector<Scalar, N>& y) noexcept {
  const Vector<Scalar, N> half = quadric.a.lazyProduct(y) + Scalar(2) * quadric.g;
  return quadric.c - y.dot(half);
}

template <typename Scalar, int N>
[[nodiscard]] bool contains(const Quadric<Scalar, N>& quadric, const Vector<Scalar, N>& y) noexcept {
  return slack(quadric, y) >= Scalar(0);
}

/// An ellipsoid as a quadric: A = P⁻¹, g = −Ax̂, c = 1 − x̂ᵀAx̂. A is a little less and c a little more, so that no
/// point of the ellipsoid is lost by rounding: for |yᵢ| ≤ |x̂ᵢ| + √Pᵢᵢ, as it is in there, g and c err by less than 4Nε
/// |x̂|ᵀ|A||y|.
/// \return `not_finite`; `beyond_domain`, also of a center so far away that c overflows; `not_symmetric`;
/// `not_positive_definite`, also of a flat one.
template <typename Scalar, int N>
[[nodiscard]] Status to_quadric(const Ellipsoid<Scalar, N>& ellipsoid, Quadric<Scalar, N>& quadric) noexcept {
  if (!scalar::all_finite(ellipsoid.center) || !scalar::all_finite(ellipsoid.shape)) {
    return Status::not_finite;
  }
  if (!is_in_domain(ellipsoid.shape)) {
    return Status::beyond_domain;
  }
  if (!is_symmetric(ellipsoid.shape)) {
    return Status::not_symmetric;
  }
  Quadric<Scalar, N> result;
  if (const Status status = inverse_from_below(symmetrized(ellipsoid.shape), result.a); status != Status::ok) {
    return status;
  }
  result.g = -result.a.lazyProduct(ellipsoid.center);
  const Vector<Scalar, N> offset = ellipsoid.center.cwiseAbs();
  const Vector<Scalar, N> reach = offset + Vector<Scalar, N>(ellipsoid.shape.diagonal().cwiseSqrt());
  const Scalar lost = offset.dot(result.a.cwiseAbs().lazyProduct(reach));
  result.c = Scalar(1) + result.g.dot(ellipsoid.center) + rounding::share<Scalar>(rounding::quadric(N)) * lost;
  if (!scalar::isfinite(result.c)) {
    return Status::beyond_domain;
  }
  quadric = result;
  return Status::ok;
}

/// The slab |nᵀy − middle| ≤ half_width, unbounded along N − 1 directions.
/// \return `not_finite`; `zero_direction`; `out_of_range` of a negative half-width; `beyond_domain` if the square of the
/// normal's length, or another number of the quadric, overflows or loses digits to underflow.
template <typename Scalar, int N>
[[nodiscard]] Status slab(const Vector<Scalar, N>& normal, const Scalar& middle, const Scalar& half_width,
                          Quadric<Scalar, N>& quadric) noexcept {
  if (!scalar::all_finite(normal) || !scalar::isfinite(middle) || !scalar::isfinite(half_width)) {
    return Status::not_finite;
  }
  if (!(normal.cwiseAbs().maxCoeff() > Scalar(0))) {
    return Status::zero_direction;
  }
  if (!(half_width >= Scalar(0))) {
    return Status::out_of_range;
  }
  const Quadric<Scalar, N> result{normal.lazyProduct(normal.transpose()), -middle * normal,
                                  (half_width - middle) * (half_width + middle)};
  if (!scalar::is_precise_square(Scalar(result.a.trace())) || !scalar::all_finite(result.g) ||
      !scalar::isfinite(result.c)) {
    return Status::beyond_domain;
  }
  quadric = result;
  return Status::ok;
}

/// {z : T z + s in the quadric}: the quadric seen in coordinates y = T z + s, of any dimension. With T a selection of
/// columns it turns a measurement of some coordinates into a quadric of all.
template <typename Scalar, int M, int N>
[[nodiscard]] Quadric<Scalar, M> pullback(const Quadric<Scalar, N>& quadric, const Matrix<Scalar, N, M>& transform,
                                          const Vector<Scalar, N>& shift) noexcept {
  const Matrix<Scalar, N, M> half = quadric.a.lazyProduct(transform);
  const Matrix<Scalar, M> a = transform.transpose().lazyProduct(half);
  const Vector<Scalar, N> gradient = quadric.a.lazyProduct(shift) + quadric.g;
  return {symmetrized(a), transform.transpose().lazyProduct(gradient), slack(quadric, shift)};
}

/// The ellipsoid that a quadric with A ≻ 0 is: center −A⁻¹g, shape (c + gᵀA⁻¹g) A⁻¹.
/// \return the status of `validate`; `unbounded` unless A ≻ 0; `empty_intersection` if no y satisfies it;
/// `beyond_domain` if A is so nearly singular that rounding leaves the inverse indefinite, or of its size.
template <typename Scalar, int N>
[[nodiscard]] Status to_ellipsoid(const Quadric<Scalar, N>& quadric, Ellipsoid<Scalar, N>& ellipsoid) noexcept {
  if (const Status status = validate(quadric); status != Status::ok) {
    return status;
  }
  Matrix<Scalar, N> inverse;
  if (inverse_positive_definite(quadric.a, inverse) != Status::ok) {
    return Status::unbounded;
  }
  const Vector<Scalar, N> center = -inverse.lazyProduct(quadric.g);
  const Scalar level = slack(quadric, center);
  if (!(level >= Scalar(0))) {
    return Status::empty_intersection;
  }
  const Matrix<Scalar, N> shape = level * inverse;
  if (!scalar::all_finite(center) || !is_in_domain(shape) || (level > Scalar(0) && !is_positive_definite(shape))) {
    return Status::beyond_domain;
  }
  ellipsoid.center = center;
  ellipsoid.shape = shape;
  return Status::ok;
}

/// A small ellipsoid that contains the intersection of an ellipsoid, which may be flat, with a quadric, which may be
/// unbounded or indefinite: the smallest of the family that two multipliers give, never larger than the ellipsoid.
/// `share` 0 is the quadric alone, 1 the ellipsoid.
/// \return the status of `validate`; `empty_intersection` if they have no common point; `beyond_domain` also for
/// what they have in common.
template <typename Scalar, int N>
[[nodiscard]] Status minimal_intersection(const Quadric<Scalar, N>& quadric, const Ellipsoid<Scalar, N>& ellipsoid,
                                          const SizeCriterion<Scalar, N>& criterion,
                                          Intersection<Scalar, N>& result) noexcept {
  if (const Status status = validate(quadric); status != Status::ok) {
    return status;
  }
  if (const Status status = validate(ellipsoid); status != Status::ok) {
    return status;
  }
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  Matrix<Scalar, N> l;
  if (const Status status = cholesky_semidefinite(ellipsoid.shape, l); status != Status::ok) {
    return status;
  }
  const Vector<Scalar, N> present = detail::present_coordinates(l);
  const Quadric<Scalar, N> seen = pullback(quadric, l, ellipsoid.center);
  const auto seen_slack = [&](const Vector<Scalar, N>& u) -> Scalar { return slack(seen, u); };
  const detail::AnySlack<Scalar, N> any_slack(seen_slack);
  const detail::Problem<Scalar, N, detail::AnySlack<Scalar, N>> problem{seen.a, seen.g, present, any_slack};
  Intersection<Scalar, N> intersection;
  detail::Combination<Scalar, N> best;
  const detail::RelativeSize<Scalar, N> size(l, present, criterion);
  if (const Status status = detail::minimal_intersection(ellipsoid.center, l, problem, size, problem.typical_weight(),
                                                         intersection.set, intersection.share, best);
      status != Status::ok) {
    return status;
  }
  if (intersection.share == Scalar(1)) {
    intersection.set = ellipsoid;
  } else {
    // Where the quadric is far sharper than the ellipsoid, A at the best q has too few right digits for a bound; with
    // more of the ellipsoid it has half of them, and any q gives one.
    const Scalar sure = rounding::root<Scalar>() * seen.a.norm();
    const Scalar q = intersection.share / (Scalar(1) - intersection.share);
    if (q < sure && problem.is_ill_conditioned(q, best)) {
      if (problem.combine(sure, best) == Status::ok && best.level >= Scalar(0)) {
        detail::put_set(ellipsoid.center, l, best, intersection.set);
        intersection.share = sure / (Scalar(1) + sure);
      } else {
        intersection.set = ellipsoid;
        intersection.share = Scalar(1);
      }
    }
    if (const Status status = detail::validate_combined(intersection.set, present.sum() < Scalar(N));
        status != Status::ok) {
      return status;
    }
  }
  result = intersection;
  return Status::ok;
}

}  // namespace elliptude
