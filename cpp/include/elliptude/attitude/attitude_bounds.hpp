#pragma once

/// \file
/// Bounds of single questions about an attitude: how far it may be tilted, how far turned about the vertical, how far
/// in all. Each has multipliers of its own, so that it is as sharp as the constraints allow. (theory, section 16.11)

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/quotient.hpp"

namespace elliptude {

/// How far the attitude of a set's center is at most from the attitudes in the set, rad, up to π; π where nothing
/// was asked.
template <typename Scalar>
struct AttitudeBounds {
  Scalar tilt = scalar::pi<Scalar>();  ///< between the vertical as seen from the body in both attitudes
  /// The least and the most that is left of the turn from the center's attitude to the others when the shortest turn has
  /// taken the tilt away: a turn about the vertical, in the sense of a right-handed screw.
  Scalar heading_from = -scalar::pi<Scalar>();
  Scalar heading_to = scalar::pi<Scalar>();
  /// Angle of the whole turn from one to the other: cos(angle/2) = cos(tilt/2) cos(heading/2), each at its largest.
  Scalar angle = scalar::pi<Scalar>();

  /// The larger of both sides.
  [[nodiscard]] Scalar heading() const noexcept {
    return -heading_from > heading_to ? Scalar(-heading_from) : heading_to;
  }
};

namespace detail {

/// A bound of n·γ/2 over a set; infinite if none was found.
template <typename Scalar>
[[nodiscard]] Status largest_along(QuestionedSet<Scalar, 3>& set, const Vector3<Scalar>& direction,
                                   Scalar& largest) noexcept {
  const Scalar quarter = scalar::constant<Scalar>(0.25L);
  Matrix<Scalar, 4> one = Matrix<Scalar, 4>::Zero();
  one(0, 0) = Scalar(1);
  Matrix<Scalar, 4> along = Matrix<Scalar, 4>::Zero();
  along.template block<3, 1>(1, 0) = quarter * direction;
  along.template block<1, 3>(0, 1) = quarter * direction.transpose();
  const Status status = set.largest_quotient(along, one, largest);
  if (status == Status::unbounded) {
    largest = Scalar(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  }
  return status == Status::unbounded ? Status::ok : status;
}

/// A bound of ‖γ⊥‖²/4 over 1 + ‖γ‖²/4, across the direction, over a set; one if none was found.
template <typename Scalar>
[[nodiscard]] Status largest_across(QuestionedSet<Scalar, 3>& set, const Vector3<Scalar>& direction,
                                    Scalar& largest) noexcept {
  const Scalar quarter = scalar::constant<Scalar>(0.25L);
  Matrix<Scalar, 4> all = Matrix<Scalar, 4>::Zero();
  all(0, 0) = Scalar(1);
  all.diagonal().template tail<3>().setConstant(quarter);
  // A sum of squares along two axes: I − nnᵀ would lose what is small beside its ones, and with it thin sets.
  int least = 0;
  direction.cwiseAbs().minCoeff(&least);
  const Vector3<Scalar> first = direction.cross(Vector3<Scalar>::Unit(least)).normalized();
  const Vector3<Scalar> second = direction.cross(first);
  Matrix<Scalar, 4> across = Matrix<Scalar, 4>::Zero();
  across.template bottomRightCorner<3, 3>() =
      quarter * (first.lazyProduct(first.transpose()) + second.lazyProduct(second.transpose()));
  const Status status = set.largest_quotient(across, all, largest);
  if (status != Status::ok && status != Status::unbounded) {
    return status;
  }
  largest = status == Status::ok && largest < Scalar(1) ? largest : Scalar(1);
  return largest >= Scalar(0) ? Status::ok : Status::empty_intersection;
}

/// Twice an angle and what was lost of it, up to π.
template <typename Scalar>
[[nodiscard]] Scalar widened_turn(const Scalar& half_angle, const Scalar& slipped) noexcept {
  const Scalar pi = scalar::pi<Scalar>();
  const Scalar result =
      Scalar(2) * (half_angle + rounding::share<Scalar>(rounding::product) * scalar::abs(half_angle)) + slipped;
  return result < pi ? result : pi;
}

template <typename Scalar>
[[nodiscard]] Scalar half_turn_of_tangent(const Scalar& tangent) noexcept {
  const Scalar pi = scalar::pi<Scalar>();
  return tangent < Scalar(1) / rounding::square<Scalar>() ? scalar::atan2(tangent, Scalar(1)) : Scalar(pi / 2);
}

/// The turn whose half has this tangent at most.
template <typename Scalar>
[[nodiscard]] Scalar turn_of_tangent(const Scalar& tangent, const Scalar& slipped) noexcept {
  return widened_turn(half_turn_of_tangent(tangent), slipped);
}

}  // namespace detail

/// The bounds for the attitudes with γ, the Gibbs vector about the center, in a set and in `count` quadrics. Of the
/// heading ψ it is n·γ/2 = tan(ψ/2), of the tilt α ‖γ⊥‖²/4 = sin²(α/2) (1 + ‖γ‖²/4).
/// \param set about zero. It may hold no half turn, as no ellipsoid of γ does.
/// \param vertical n, in the body axes at the center, a unit vector to rounding.
/// \return the status of `see` and of `largest_quotient`, but for `unbounded`, which is an angle of π;
/// `empty_intersection` if the bounds prove that nothing satisfies all.
template <typename Scalar>
[[nodiscard]] Status attitude_bounds(const Ellipsoid<Scalar, 3>& set, const Quadric<Scalar, 3>* quadrics,
                                     std::size_t count, const Vector3<Scalar>& vertical,
                                     AttitudeBounds<Scalar>& bounds) noexcept {
  QuestionedSet<Scalar, 3> questioned;
  if (const Status status = questioned.see(set, quadrics, count); status != Status::ok) {
    return status;
  }
  Scalar sine_square;
  if (const Status status = detail::largest_across(questioned, vertical, sine_square); status != Status::ok) {
    return status;
  }
  Scalar most;
  if (const Status status = detail::largest_along(questioned, vertical, most); status != Status::ok) {
    return status;
  }
  Scalar least;
  if (const Status status = detail::largest_along(questioned, Vector3<Scalar>(-vertical), least);
      status != Status::ok) {
    return status;
  }
  if (!(most + least >= Scalar(0))) {
    return Status::empty_intersection;
  }
  // The center, the vertical and the functions below are right to a few roundings of one, and the heading as many over
  // the cosine of half the tilt: next to a tilt of π it is lost.
  const Scalar cosine_square = Scalar(1) - sine_square;
  const Scalar slip = rounding::share<Scalar>(rounding::center + rounding::direction);
  const Scalar slip_of_heading =
      rounding::share<Scalar>(rounding::center + 2 * rounding::direction) / scalar::sqrt(cosine_square);
  AttitudeBounds<Scalar> result;
  result.tilt = detail::widened_turn(scalar::atan2(scalar::sqrt(sine_square), scalar::sqrt(cosine_square)), slip);
  result.heading_from = -detail::turn_of_tangent(least, slip_of_heading);
  result.heading_to = detail::turn_of_tangent(most, slip_of_heading);
  const Scalar half = detail::half_turn_of_tangent(most > least ? most : least);
  const Scalar cosine = scalar::cos(half);
  const Scalar sine = scalar::sin(half);
  result.angle = detail::widened_turn(scalar::atan2(scalar::sqrt(Scalar(sine_square + cosine_square * sine * sine)),
                                                    scalar::sqrt(Scalar(cosine_square * cosine * cosine))),
                                      slip);
  bounds = result;
  return Status::ok;
}

}  // namespace elliptude
