#pragma once

/// \file
/// Caps of the sphere: a direction that is known within an angle, and what two of them have in common.
/// (theory, section 18.9)

#include "elliptude/base/rounding.hpp"
#include "elliptude/base/so3.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude {

/// All directions within an angle of one; unless it is told, all there are.
template <typename Scalar>
struct DirectionCap {
  Vector3<Scalar> center = Vector3<Scalar>::UnitZ();  ///< a unit vector
  Scalar angle = scalar::pi<Scalar>();                ///< rad; from π on it holds all directions
};

/// \return `not_finite`, but an infinite angle is none; `zero_direction`; `out_of_range` of a negative angle.
template <typename Scalar>
[[nodiscard]] Status validate(const DirectionCap<Scalar>& cap) noexcept {
  if (!scalar::all_finite(cap.center) || !(cap.angle == cap.angle)) {
    return Status::not_finite;
  }
  if (!(cap.center.cwiseAbs().maxCoeff() > Scalar(0))) {
    return Status::zero_direction;
  }
  return cap.angle >= Scalar(0) ? Status::ok : Status::out_of_range;
}

/// The same directions about a unit vector, however long the center was.
template <typename Scalar>
[[nodiscard]] DirectionCap<Scalar> normalized(const DirectionCap<Scalar>& cap) noexcept {
  return {scalar::unit(cap.center), cap.angle + rounding::share<Scalar>(rounding::direction)};
}

/// Where the directions are in body axes after the body has turned by the rotation `turn`, and before, after or within
/// that by at most `angle`, rad, about any axis.
template <typename Scalar>
[[nodiscard]] DirectionCap<Scalar> turned(const DirectionCap<Scalar>& cap, const Matrix3<Scalar>& turn,
                                          const Scalar& angle) noexcept {
  return {scalar::unit(Vector3<Scalar>(turn.transpose().lazyProduct(cap.center))),
          (cap.angle + angle) * (Scalar(1) + rounding::share<Scalar>(rounding::product)) +
              rounding::share<Scalar>(rounding::direction)};
}

/// A small cap about what two caps have in common. With |x − cᵢ|² ≤ vᵢ = 4 sin²(rᵢ/2), α + β = 1 and D = |c₁ − c₂|, the
/// unit vector m along w = αc₁ + βc₂ has
///
///     |x − m|² ≤ (αv₁ + βv₂ − 2αβD²/(1 + ‖w‖))/‖w‖,   ‖w‖² = 1 − αβD²,
///
/// for any weights. With those here m is the middle of the arc on which both circles meet. The result is never larger
/// than either.
/// \param first, second about unit vectors.
/// \return `empty_intersection` if the bound is negative: they have no common direction.
template <typename Scalar>
[[nodiscard]] Status intersection(const DirectionCap<Scalar>& first, const DirectionCap<Scalar>& second,
                                  DirectionCap<Scalar>& result) noexcept {
  const DirectionCap<Scalar>& smaller = first.angle <= second.angle ? first : second;
  const DirectionCap<Scalar>& larger = first.angle <= second.angle ? second : first;
  if (!(larger.angle < scalar::pi<Scalar>())) {
    result = smaller;
    return Status::ok;
  }
  const auto square = [](const Scalar& angle) {
    const Scalar chord = Scalar(2) * scalar::sin(Scalar(scalar::constant<Scalar>(0.5L) * angle));
    return Scalar(chord * chord);
  };
  const Scalar distance = (smaller.center - larger.center).squaredNorm();
  const Scalar v1 = square(smaller.angle);
  const Scalar v2 = square(larger.angle);
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar weight = distance + v1 - v2 - half * distance * v1;
  const Scalar weights = Scalar(2) * distance - half * distance * (v1 + v2);
  Scalar beta = weights > Scalar(0) ? Scalar(weight / weights) : Scalar(0);  // of the larger cap
  beta = beta > Scalar(0) ? (beta < Scalar(1) ? beta : Scalar(1)) : Scalar(0);
  const Scalar product = beta * (Scalar(1) - beta);
  // 1 − αβD² would cancel for centers that are nearly opposite.
  const Vector3<Scalar> w = (Scalar(1) - beta) * smaller.center + beta * larger.center;
  const Scalar norm = scalar::length(w);
  const Scalar gain = Scalar(2) * product * distance / (Scalar(1) + norm);
  const Scalar sum = (Scalar(1) - beta) * v1 + beta * v2;
  // The centers are unit vectors to a few roundings: D² errs by as many times D.
  const Scalar lost =
      rounding::share<Scalar>(rounding::direction) * (sum + gain + scalar::sqrt(Scalar(sum + distance)));
  const Scalar bound = sum - gain + lost;
  if (bound < Scalar(0)) {
    return Status::empty_intersection;
  }
  if (!(norm > Scalar(0))) {  // opposite centers: w points nowhere
    result = smaller;
    return Status::ok;
  }
  const Scalar sine_square = half * half * bound / norm;
  const Scalar angle =
      sine_square < Scalar(1)
          ? Scalar(Scalar(2) * scalar::atan2(scalar::sqrt(sine_square), scalar::sqrt(Scalar(Scalar(1) - sine_square))))
          : scalar::pi<Scalar>();
  const Scalar covered =
      angle * (Scalar(1) + rounding::share<Scalar>(rounding::product)) + rounding::share<Scalar>(rounding::direction);
  if (covered < smaller.angle) {
    result = {scalar::unit(w), covered};
  } else {
    result = smaller;
  }
  return Status::ok;
}

}  // namespace elliptude
