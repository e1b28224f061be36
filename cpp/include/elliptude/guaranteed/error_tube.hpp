#pragma once

/// \file
/// Carries the set of errors y = [γ; δω] about a moving center along the motion, with bounds of everything that is left
/// out. (theory, section 17)
///
/// Exactly (theory, section 17.1),
///
///     γ'  = −ω̂ × γ + δω + ½ γ × δω + ¼ γ (γ·δω)
///     δω' = J⁻¹ (S(Jω̂ + h_w) − S(ω̂)J) δω + J⁻¹ (𝓜γ + ½ M''(γ, γ) − δω × Jδω + rest of the torque + τ − defect)
///
/// With y = Y(s) u, where Y follows the linear part but for a known error, u moves by terms of second order and higher.
/// Those of second order are integrated exactly as a quadratic map of u(0); the unknown torque and what is of third and
/// fourth order push u within an ellipsoid, and what is left is bounded in the norm of u.

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/guaranteed/detail/enlarged_ball.hpp"
#include "elliptude/guaranteed/detail/tube_bounds.hpp"

namespace elliptude {

/// The set of errors over one stretch of the motion, from an ellipsoid to an ellipsoid.
template <typename Scalar, typename Potential>
class ErrorTube {
 public:
  /// \param shape of the ellipsoid of y = [γ; δω] at the start.
  /// \param h the longest step to come, s.
  /// \param stiffness a bound of ‖J⁻¹ ∂M/∂ζ‖, 1/s². Both only choose the norm in which the rest is bounded.
  /// \return `not_positive_definite` also of a flat one.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status start(const Matrix6<Scalar>& shape, const Scalar& h,
                                                   const Scalar& stiffness) noexcept {
    // A Cholesky factor is that of a matrix which differs by less than this from the one given (Higham, Accuracy and
    // Stability, theorem 10.3): none is then smaller.
    Matrix6<Scalar> raised = shape;
    raised.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::cholesky(6));
    // Norms are taken about a set that is not too thin in any direction: what nonlinear terms do to a thin set is
    // judged by the width of the whole, and over a step Y must not change by more than a part of itself.
    const Scalar share = scalar::constant<Scalar>(0.01L);
    const Scalar attitude = shape.diagonal().template head<3>().sum();
    const Scalar rate = shape.diagonal().template tail<3>().sum();
    const Scalar by_rate = Scalar(4) * h;
    const Scalar by_torque = by_rate * stiffness;
    Matrix6<Scalar> wide = raised;
    wide.diagonal().template head<3>().array() += share * attitude + by_rate * by_rate * rate;
    wide.diagonal().template tail<3>().array() += share * rate + by_torque * by_torque * attitude;
    Matrix6<Scalar> set;
    if (const Status status = put_cholesky(raised, set); status != Status::ok) {
      return status;
    }
    if (const Status status = put_cholesky(wide, frame_); status != Status::ok) {
      return status;
    }
    set_ = solve_lower(frame_, set);
    second_order_.setZero();
    second_order_norm_ = Scalar(0);
    pushed_.setZero();
    pushed_norm_ = Scalar(0);
    rest_ = Scalar(0);
    return Status::ok;
  }

  /// How far u may have moved from where it began, in the norm in which the set has radius one.
  [[nodiscard]] Scalar displacement() const noexcept { return second_order_norm_ + pushed_norm_ + rest_; }

  /// Over the step of the motion that `series` is of; the center is `series.end` afterwards.
  /// \return `unbounded` if the bounds do not close: the set is too large, or the step too long, for it to be bounded;
  /// `invalid_inertia` if the inertia error reaches the least principal moment. Nothing has then changed.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status step(const RigidBody<Scalar>& body,
                                                  const MotionSeries<Scalar, Potential>& series,
                                                  const BodyUncertainty<Scalar>& uncertainty) noexcept;

  /// An ellipsoid about zero that contains Y u for all that u can be by now.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Matrix6<Scalar> shape() const noexcept;

  // What is known of every motion that began at y = Y(0) u₀ with ‖u₀‖ ≤ 1: by now y = Y (u₀ + q(u₀) + p + r),

  [[nodiscard]] const Matrix6<Scalar>& frame() const noexcept { return frame_; }                              ///< Y
  [[nodiscard]] const detail::packed::Forms<Scalar>& second_order() const noexcept { return second_order_; }  ///< q
  [[nodiscard]] const Matrix6<Scalar>& pushed() const noexcept { return pushed_; }  ///< shape of p's ellipsoid
  [[nodiscard]] const Scalar& rest() const noexcept { return rest_; }               ///< bound of ‖r‖

 private:
  /// How u moves over a step. `frame_` is not yet that of its end. \return the status of `step`.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status move(const RigidBody<Scalar>& body,
                                                  const MotionSeries<Scalar, Potential>& series,
                                                  const BodyUncertainty<Scalar>& uncertainty,
                                                  const detail::LinearPart<Scalar>& linear) noexcept;

  /// Takes up a step that closes.
  /// \param forms of second order of u' in the middle of the step, and `largest_form` their norm.
  /// \param h of the step, s.
  ELLIPTUDE_OUT_OF_LINE void take_up(const detail::packed::Forms<Scalar>& forms, const Scalar& largest_form,
                                     const detail::Pushes<Scalar>& pushes, const detail::Displacement<Scalar>& moved,
                                     const Scalar& h) noexcept;

  /// Shape of an ellipsoid about v + set⁻¹q(set v) for all ‖v‖ ≤ 1.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Matrix6<Scalar> moved_ball(const Matrix6<Scalar>& set_inverse,
                                                                 const Vector6<Scalar>& widths) const noexcept {
    // What is second order in the coordinates v of the set itself, u = set_ v, where the set is the unit ball.
    return detail::ball_and_image(detail::packed::seen_from(second_order_, set_, set_inverse), widths);
  }

  /// Adds p and r to the shape of an ellipsoid of u.
  ELLIPTUDE_OUT_OF_LINE void add_pushes(const Matrix6<Scalar>& set_inverse, const Scalar& width,
                                        Matrix6<Scalar>& shape) const noexcept;

  Matrix6<Scalar> frame_;
  Matrix6<Scalar> set_;  // {set_ v : ‖v‖ ≤ 1} is the set of u at the start, within the unit ball
  detail::packed::Forms<Scalar> second_order_;
  Scalar second_order_norm_;  // of q(u) for ‖u‖ ≤ 1
  Matrix6<Scalar> pushed_;
  Scalar pushed_norm_;  // of p
  Scalar rest_;
};

template <typename Scalar, typename Potential>
Status ErrorTube<Scalar, Potential>::step(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                                          const BodyUncertainty<Scalar>& uncertainty) noexcept {
  detail::LinearPart<Scalar> linear;
  if (const Status status = detail::expand_linear_part(body, series, frame_, linear); status != Status::ok) {
    return status;
  }
  if (const Status status = move(body, series, uncertainty, linear); status != Status::ok) {
    return status;
  }
  frame_ = linear.end;
  return Status::ok;
}

template <typename Scalar, typename Potential>
Status ErrorTube<Scalar, Potential>::move(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                                          const BodyUncertainty<Scalar>& uncertainty,
                                          const detail::LinearPart<Scalar>& linear) noexcept {
  const Scalar& h = series.step_powers[1];
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const TorqueBounds<Scalar>& torque = series.acceleration;  // of J⁻¹M
  const detail::step_means::LinearChange<Scalar> change{linear.change_odd, linear.change};
  const Scalar attitude = linear.largest_attitude;
  const Scalar strength = linear.from_rate_norm * torque.largest;  // of the torque in u'
  const Scalar degree = torque.degree;
  const detail::step_means::FormChange<Scalar> of_forms = detail::change_of_forms(series);

  // Second order (theory, eq. 17.7).
  const detail::packed::Forms<Scalar> forms = detail::second_order_forms(body, series, Scalar(half * h), linear);
  const Scalar largest_form = spectral_norm(forms);  // ‖Y⁻¹ N₂(Yu, Yu)‖ ≤ this times ‖u‖² in the middle
  const Scalar form_bound = strength * attitude * attitude * half * degree * degree;
  const detail::step_means::SecondOrder<Scalar> second_order =
      detail::step_means::SecondOrder<Scalar>::of(largest_form, form_bound, change, of_forms, h);

  const Scalar cubic_bound =
      strength * attitude * attitude * attitude * scalar::constant<Scalar>(0.375L) * degree * degree;
  const Scalar before = displacement();
  detail::Pushes<Scalar> pushes;
  pushes.find_higher(body, series, linear);
  const detail::StepBounds<Scalar, Potential> bounds{series,   linear,       pushes,      change,
                                                     of_forms, second_order, cubic_bound, before};
  detail::Displacement<Scalar> moved;
  const auto closes_within = [&](const Scalar& most) {
    const Status status =
        pushes.find_unknown(body, series, uncertainty, linear, Scalar(attitude * change.stretch() * (Scalar(1) + most)),
                            Scalar(linear.largest_difference * change.stretch()));
    return status == Status::ok && !bounds.close(most, moved) ? Status::unbounded : status;
  };
  Status status = Status::unbounded;
  if constexpr (is_local<std::decay_t<decltype(series.torque)>>) {
    // An expansion about one attitude lacks less if the errors move less.
    const Scalar little = before + scalar::constant<Scalar>(0.05L);
    status = closes_within(little < Scalar(1) ? little : Scalar(1));
  }
  if (status == Status::unbounded) {
    status = closes_within(Scalar(1));
  }
  if (status != Status::ok) {
    return status;
  }

  take_up(forms, largest_form, pushes, moved, h);
  return Status::ok;
}

template <typename Scalar, typename Potential>
void ErrorTube<Scalar, Potential>::take_up(const detail::packed::Forms<Scalar>& forms, const Scalar& largest_form,
                                           const detail::Pushes<Scalar>& pushes,
                                           const detail::Displacement<Scalar>& moved, const Scalar& h) noexcept {
  const bool is_first = displacement() == Scalar(0);
  second_order_ += h * forms;
  second_order_norm_ = is_first ? Scalar(h * largest_form) : spectral_norm(second_order_);
  const Matrix6<Scalar> higher = sum_of_shapes(Matrix6<Scalar>((moved.cube * moved.cube) * pushes.cubic),
                                               Matrix6<Scalar>((moved.fourth * moved.fourth) * pushes.fourth));
  pushed_ = sum_of_shapes(pushed_, Matrix6<Scalar>((h * h) * sum_of_shapes(pushes.unknown, higher)));
  pushed_norm_ += h * (pushes.unknown_norm + pushes.cubic_norm * moved.cube + pushes.fourth_norm * moved.fourth);
  rest_ += moved.rest;
}

template <typename Scalar, typename Potential>
Matrix6<Scalar> ErrorTube<Scalar, Potential>::shape() const noexcept {
  const Matrix6<Scalar> set_inverse = lower_inverse(set_);
  const Vector6<Scalar> widths = set_.colwise().squaredNorm();
  Matrix6<Scalar> shape = congruence_of_lower(set_, moved_ball(set_inverse, widths));
  add_pushes(set_inverse, Scalar(widths.sum()), shape);
  Matrix6<Scalar> whole = symmetric_congruence(frame_, shape);
  // Entry (i, j) errs by at most 16 ε √(mᵢmⱼ), which this diagonal outweighs.
  const Vector6<Scalar> magnitude =
      frame_.cwiseAbs().lazyProduct(Vector6<Scalar>(shape.diagonal().cwiseSqrt())).cwiseAbs2();
  whole.diagonal() += rounding::share<Scalar>(rounding::image) * magnitude;
  return whole;
}

template <typename Scalar, typename Potential>
void ErrorTube<Scalar, Potential>::add_pushes(const Matrix6<Scalar>& set_inverse, const Scalar& width,
                                              Matrix6<Scalar>& shape) const noexcept {
  const Scalar one(1);
  // What is left is a ball in u, and the disturbance an ellipsoid: sums with shares by their size beside the set.
  const Scalar rest_share =
      detail::tube::moderate_growth(Scalar(rest_ * scalar::sqrt(Scalar(set_inverse.squaredNorm() / Scalar(6)))),
                                    Scalar(Scalar(6) * rest_ * rest_), width);
  if (rest_share > Scalar(0)) {
    shape *= one + rest_share;
    shape.diagonal().array() += (one + one / rest_share) * rest_ * rest_;
  }
  const Matrix6<Scalar> beside = product_by_columns(set_inverse, pushed_);
  const Scalar pushed_share = detail::tube::moderate_growth(
      detail::tube::share_of(Scalar(beside.cwiseProduct(set_inverse).sum())), Scalar(pushed_.trace()), width);
  if (pushed_.trace() > Scalar(0)) {
    shape = ((one + pushed_share) * shape + (one + one / pushed_share) * pushed_).eval();
  }
}

}  // namespace elliptude
