#pragma once

/// \file
/// What moves the errors of an error tube beyond the linear part: forms of second order, the unknown torque, and pushes
/// of third order. (theory, sections 17.4 and 17.5)

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/guaranteed/detail/linear_part.hpp"
#include "elliptude/guaranteed/detail/packed_forms.hpp"

namespace elliptude::detail {

/// ½ J⁻¹ M''(γ, γ) in the middle of the step.
template <typename Scalar, typename Potential>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE expansion::RowForms<Scalar> torque_forms(
    const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series, const Scalar& middle) noexcept {
  expansion::Forms<Scalar> forms{Matrix3<Scalar>::Zero(), Matrix3<Scalar>::Zero(), Matrix3<Scalar>::Zero()};
  series.torque.add_curvature(middle, body.inertia_inverse(), forms);
  return expansion::rows_of(forms);
}

/// The terms of second order of u' in the middle of the step, as forms of u: their part from entry `begin` on.
/// \param gyroscopic the forms of δω in δω', and `curvature` those of γ, null for none; of products of two components
/// √2 times what `expansion::RowForms` has.
template <typename Scalar>
ELLIPTUDE_OUT_OF_LINE void put_forms(const LinearPart<Scalar>& linear, const expansion::RowForms<Scalar>& gyroscopic,
                                     const expansion::RowForms<Scalar>* curvature, int begin,
                                     packed::Forms<Scalar>& forms) noexcept {
  const packed::Factors<Scalar> attitude = packed::factors_of<Scalar>(linear.middle.template topRows<3>(), begin);
  const packed::Factors<Scalar> difference = packed::factors_of<Scalar>(linear.middle.template bottomRows<3>(), begin);
  Matrix<Scalar, packed::part_size, 3> by_rate =
      product_by_columns(packed::products(difference), gyroscopic.transpose());
  if (curvature != nullptr) {
    by_rate += product_by_columns(packed::products(attitude), curvature->transpose());
  }
  Matrix<Scalar, packed::part_size, 3> by_attitude;
  for (int a = 0; a < 3; ++a) {  // ½ γ × δω
    const auto next = static_cast<std::size_t>((a + 1) % 3);
    const auto last = static_cast<std::size_t>((a + 2) % 3);
    by_attitude.col(a) = scalar::constant<Scalar>(0.5L) * (packed::product(attitude[next], difference[last]) -
                                                           packed::product(attitude[last], difference[next]));
  }
  forms.template middleRows<packed::part_size>(begin) =
      product_by_columns(by_attitude, linear.from_attitude().transpose()) +
      product_by_columns(by_rate, linear.from_rate().transpose());
}

/// The terms of second order of u' in the middle of the step, as forms of u.
template <typename Scalar, typename Potential>
[[nodiscard]] packed::Forms<Scalar> second_order_forms(const RigidBody<Scalar>& body,
                                                       const MotionSeries<Scalar, Potential>& series,
                                                       const Scalar& middle,
                                                       const LinearPart<Scalar>& linear) noexcept {
  const Scalar root = scalar::constant<Scalar>(1.41421356237309504880168872420969807857L);
  // −J⁻¹ (δω × Jδω)
  expansion::RowForms<Scalar> gyroscopic =
      -body.inertia_inverse().lazyProduct(expansion::gyroscopic_forms(body.inertia()));
  gyroscopic.template rightCols<3>() *= root;
  const bool has_torque = series.acceleration.largest > Scalar(0);
  expansion::RowForms<Scalar> curvature;
  if (has_torque) {
    curvature = torque_forms(body, series, middle);
    curvature.template rightCols<3>() *= root;
  }
  packed::Forms<Scalar> forms;
  for (int begin = 0; begin < packed::size; begin += packed::part_size) {
    put_forms(linear, gyroscopic, has_torque ? &curvature : nullptr, begin, forms);
  }
  return forms;
}

/// The unknown torque, what an expansion about one attitude lacks of the torque (theory, eq. 17.13), and the inertia
/// error as a torque (theory, section 17.5).
/// \param largest_angle of γ, and `largest_difference` half of that of δω, over the step.
template <typename Scalar, typename Potential>
[[nodiscard]] Status unknown_torque(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                                    const BodyUncertainty<Scalar>& uncertainty,
                                    [[maybe_unused]] const Scalar& largest_angle, const Scalar& largest_difference,
                                    Matrix3<Scalar>& shape) noexcept {
  shape = uncertainty.torque;
  if constexpr (is_local<std::decay_t<decltype(series.torque)>>) {
    const Scalar half = scalar::constant<Scalar>(0.5L) * series.step_powers[1];
    // From the attitude of the expansion to the center's, at any time of the step.
    const Scalar of_center = half * (Scalar(2) * series.largest_rate - series.rate_norms[0]) +
                             rounding::share<Scalar>(rounding::series_attitude);
    const Scalar remainder = series.torque.remainder(Scalar(of_center + largest_angle), half);
    shape = sum_of_shapes(shape, Matrix3<Scalar>((remainder * remainder) * Matrix3<Scalar>::Identity()));
  }
  if (!(uncertainty.inertia > Scalar(0))) {
    return Status::ok;
  }
  const Scalar error = uncertainty.inertia;
  const Scalar least_moment = body.least_moment() - error;
  if (!(least_moment > Scalar(0))) {
    return Status::invalid_inertia;
  }
  const Scalar speed = series.largest_rate + Scalar(2) * largest_difference;
  const Scalar wheel = scalar::sqrt(Scalar(series.input.wheel_momentum.squaredNorm()));
  const Scalar spread = body.greatest_moment() - body.least_moment();
  const Scalar gradient = series.acceleration.by_inertia * error;
  const Scalar control = scalar::sqrt(Scalar(series.input.control_torque.squaredNorm()));
  const Scalar acceleration = (scalar::constant<Scalar>(0.5L) * spread * speed * speed + error * speed * speed +
                               wheel * speed + series.torque_bounds.largest + series.torque_bounds.fixed + gradient +
                               control + scalar::sqrt(Scalar(shape.trace()))) /
                              least_moment;
  const Scalar ball = error * speed * speed + gradient + error * acceleration;
  shape = sum_of_shapes(shape, Matrix3<Scalar>((ball * ball) * Matrix3<Scalar>::Identity()));
  return Status::ok;
}

/// Bound of |γ·δω| in the middle of the step, for ‖u‖ ≤ 1.
template <typename Scalar>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Scalar largest_product(const Matrix6<Scalar>& middle) noexcept {
  const Matrix<Scalar, 3, 6> top = middle.template topRows<3>();
  const Matrix<Scalar, 3, 6> bottom = middle.template bottomRows<3>();
  const Matrix6<Scalar> inner = top.transpose().lazyProduct(bottom);
  return scalar::constant<Scalar>(0.5L) * spectral_norm(Matrix6<Scalar>(inner + inner.transpose()));
}

/// Shape of an ellipsoid that holds the terms of third order of J⁻¹M in the middle of the step.
/// \param attitudes shape of the ellipsoid of γ.
template <typename Scalar, typename Potential>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Matrix3<Scalar> cubic_torque(const RigidBody<Scalar>& body,
                                                                 const MotionSeries<Scalar, Potential>& series,
                                                                 const Matrix3<Scalar>& attitudes,
                                                                 const Scalar& largest_attitude) noexcept {
  Matrix3<Scalar> axes;  // γ is in {axes v : ‖v‖ ≤ 1}
  if (put_cholesky(attitudes, axes) != Status::ok) {
    axes = largest_attitude * Matrix3<Scalar>::Identity();
  }
  expansion::CubicForms<Scalar> forms = expansion::CubicForms<Scalar>::Zero();
  const Scalar middle = scalar::constant<Scalar>(0.5L) * series.step_powers[1];
  series.torque.add_cubic(middle, body.inertia_inverse(), axes, forms);
  return forms.transpose().lazyProduct(forms);
}

}  // namespace elliptude::detail
