#pragma once

/// \file
/// How far the errors of an error tube move over a step, at most. (theory, section 17.4)

#include "elliptude/guaranteed/detail/prediction_sums.hpp"
#include "elliptude/guaranteed/detail/step_means.hpp"
#include "elliptude/guaranteed/detail/tube_terms.hpp"

namespace elliptude::detail {

/// What pushes u within ellipsoids: the unknown torque, and what is of third and of fourth order for ‖u‖ = 1 in the
/// middle.
template <typename Scalar>
struct Pushes {
  Matrix6<Scalar> unknown;
  Matrix6<Scalar> cubic;
  Matrix6<Scalar> fourth;
  Scalar unknown_norm;
  Scalar cubic_norm;
  Scalar fourth_norm;

  /// What is of third and of fourth order.
  template <typename Potential>
  ELLIPTUDE_OUT_OF_LINE void find_higher(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                                         const LinearPart<Scalar>& linear) noexcept {
    const auto top = linear.middle.template topRows<3>();
    const Matrix3<Scalar> attitudes = top.lazyProduct(top.transpose());  // shape of the ellipsoid of γ
    // ¼ γ (γ·δω): a number, which is a form of u, times γ
    const Scalar quarter = scalar::constant<Scalar>(0.25L) * largest_product(linear.middle);
    cubic_norm = put_push(linear.from_attitude(), Matrix3<Scalar>((quarter * quarter) * attitudes), cubic);
    if (series.acceleration.largest > Scalar(0)) {
      add_cubic_push(linear.from_rate(), cubic_torque(body, series, attitudes, linear.largest_attitude));
    }
    const Scalar attitude = linear.largest_attitude;
    const Scalar degree = series.acceleration.degree;
    const Scalar bound =
        attitude * attitude * attitude * attitude * scalar::constant<Scalar>(0.125L) * degree * degree * degree;
    fourth_norm = put_push(linear.from_rate(), Matrix3<Scalar>((bound * bound) * series.acceleration.shape), fourth);
  }

  /// The unknown torque.
  /// \param largest_angle of γ over the step.
  /// \param largest_difference of δω over the step, for ‖u‖ ≤ 1.
  /// \return `invalid_inertia` if the inertia error reaches the least principal moment.
  template <typename Potential>
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status find_unknown(const RigidBody<Scalar>& body,
                                                          const MotionSeries<Scalar, Potential>& series,
                                                          const BodyUncertainty<Scalar>& uncertainty,
                                                          const LinearPart<Scalar>& linear, const Scalar& largest_angle,
                                                          const Scalar& largest_difference) noexcept {
    Matrix3<Scalar> torque;
    if (const Status status = unknown_torque(body, series, uncertainty, largest_angle, largest_difference, torque);
        status != Status::ok) {
      return status;
    }
    unknown.setZero();
    unknown_norm = Scalar(0);
    if (torque.trace() != Scalar(0)) {  // of NaN, too, which shows in the norm
      const Matrix<Scalar, 6, 3> by_torque = linear.from_rate().lazyProduct(body.inertia_inverse());
      unknown_norm = put_push(by_torque, torque, unknown);
    }
    return Status::ok;
  }

 private:
  /// The ellipsoid of what three numbers, themselves in an ellipsoid, are in u'. \return a bound of its radius.
  template <typename Columns>
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE static Scalar put_push(const Columns& columns, const Matrix3<Scalar>& shape,
                                                             Matrix6<Scalar>& push) noexcept {
    push = congruence(columns, shape);
    return scalar::sqrt(Scalar(push.trace()));
  }

  template <typename Columns>
  ELLIPTUDE_OUT_OF_LINE void add_cubic_push(const Columns& columns, const Matrix3<Scalar>& shape) noexcept {
    cubic = sum_of_shapes(cubic, congruence(columns, shape));
    cubic_norm = scalar::sqrt(Scalar(cubic.trace()));
  }
};

/// How the torque's forms change within half a step, in parts of their bounds. (theory, eq. 17.5)
template <typename Scalar, typename Potential>
[[nodiscard]] step_means::FormChange<Scalar> change_of_forms(const MotionSeries<Scalar, Potential>& series) noexcept {
  const TorqueBounds<Scalar>& torque = series.acceleration;
  const Scalar& h = series.step_powers[1];
  Scalar turn_acceleration(0);
  for (std::size_t k = 1; k < series.rate_norms.size(); ++k) {
    turn_acceleration +=
        Scalar(static_cast<scalar::Value<Scalar>>(k)) * series.step_powers[k - 1] * series.rate_norms[k];
  }
  // The forms in the middle are those of the first eight terms of the directions they are made of.
  static_assert(MotionSeries<Scalar, Potential>::order == 8);
  const Scalar truncated =
      torque.largest > Scalar(0)
          ? Scalar(series.tail(8, Scalar(1), torque.turn_rate, h) * scalar::constant<Scalar>(1.0L / 256.0L))
          : Scalar(0);
  return step_means::FormChange<Scalar>::within(torque.degree, Scalar(series.largest_rate + torque.turn_rate),
                                                turn_acceleration, Scalar(scalar::constant<Scalar>(0.5L) * h),
                                                truncated);
}

/// Bounds of what moves u beyond second order, given how far it moves.
template <typename Scalar>
struct Displacement {
  Scalar rest;    ///< of u from where the quadratic map and the pushes take it, over this step
  Scalar all;     ///< of u from where it began
  Scalar cube;    ///< what the pushes of third order in the middle, for ‖u‖ = 1, are multiplied by
  Scalar fourth;  ///< and those of fourth
};

/// What the displacement over a step is bounded by.
template <typename Scalar, typename Potential>
struct StepBounds {
  const MotionSeries<Scalar, Potential>& series;
  const LinearPart<Scalar>& linear;
  const Pushes<Scalar>& pushes;
  step_means::LinearChange<Scalar> change;
  step_means::FormChange<Scalar> of_forms;
  step_means::SecondOrder<Scalar> second_order;
  Scalar cubic_bound;  ///< of the forms of third order
  Scalar before;       ///< how far u has moved before the step

  /// If u stays within eta of where it began.
  [[nodiscard]] Displacement<Scalar> within(const Scalar& eta) const noexcept {
    const Scalar one(1);
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar& h = series.step_powers[1];
    const Scalar stretch = change.stretch();
    const Scalar shrink = change.shrink();
    const Scalar most = one + eta;
    const Scalar gibbs = half * linear.largest_attitude * stretch * most;
    // A center that is another by the angle a moves γ by at most 2 tan(a/2) (1 + ‖γ/2‖²) / (1 − tan(a/2) ‖γ/2‖).
    const Scalar tangent = scalar::constant<Scalar>(0.501L) * series.attitude_error;
    const Scalar left = one - tangent * gibbs;
    if (!(left > half)) {
      const Scalar infinite(std::numeric_limits<scalar::Value<Scalar>>::infinity());
      return {infinite, infinite, infinite, infinite};
    }
    const Scalar jumps = shrink * (most * linear.error + linear.from_rate_norm * series.rate_defect +
                                   linear.from_attitude_norm * Scalar(2) * tangent * (one + gibbs * gibbs) / left);
    const Scalar fifth = one + scalar::constant<Scalar>(1.25L) * gibbs;
    const Scalar moved =
        h * (second_order.largest * most * most +
             shrink * (pushes.unknown_norm +
                       step_means::cube_of(stretch) * step_means::cube_of(most) *
                           (pushes.cubic_norm + cubic_bound * (of_forms.drift + of_forms.rest + of_forms.missing)) +
                       step_means::fourth_of(stretch) * step_means::fourth_of(most) * fifth * pushes.fourth_norm));
    // ‖u‖ is at most this where the step begins and ends, and at most on a line between.
    const Scalar first = one + before + jumps;
    const step_means::Line<Scalar> line{first, Scalar(first + moved)};
    const Scalar cube_at_ends = line.cube_at_ends(stretch);
    const Scalar fourth_at_ends = line.fourth_at_ends(stretch);
    Scalar rest = second_order.quadrature + jumps;
    rest += second_order.displaced(line.mean(), moved, h);
    rest += h * cubic_bound * step_means::changing_cubes(of_forms, change, cube_at_ends);
    rest += h * half * linear.change * shrink *
            (pushes.unknown_norm + pushes.cubic_norm * cube_at_ends + pushes.fourth_norm * fifth * fourth_at_ends);
    return {rest, Scalar(line.last - one), line.mean_cube(stretch), Scalar(fifth * line.mean_fourth(stretch))};
  }

  /// A displacement that is within what it was found for.
  /// \param most what the displacement must be below.
  /// \return whether there is one: the set is else too large, or the step too long.
  [[nodiscard]] bool close(const Scalar& most, Displacement<Scalar>& moved) const noexcept {
    Scalar eta = before + second_order.integral;
    for (int attempt = 0; attempt < 6; ++attempt) {
      moved = within(eta);
      if (moved.all <= eta && eta < most) {
        return true;
      }
      eta = scalar::constant<Scalar>(1.02L) * moved.all;
    }
    return false;
  }
};

}  // namespace elliptude::detail
