#pragma once

/// \file
/// The linearization of the discrete flow (paper, §3.1: x⁺ = A x with x = [ζ; δω]; theory, section 2), for the step, its
/// compositions and any number of steps, with respect to the state and to a constant control torque.

#include "elliptude/integrator.hpp"

namespace elliptude {

/// First-order effect on [ζ; δω] at the end, ζ the error rotation vector on the body side, C = Ĉ exp(S(ζ)).
template <typename Scalar>
struct FlowLinearization {
  Matrix6<Scalar> state;         ///< A, of [ζ; δω] at the start; det A = 1
  Matrix<Scalar, 6, 3> control;  ///< B, of the control torque

  [[nodiscard]] static FlowLinearization identity() noexcept {
    return {Matrix6<Scalar>::Identity(), Matrix<Scalar, 6, 3>::Zero()};
  }
};

/// The linearization of one stage. With K = h Fᵀ [tr(F J_d) I − F J_d]⁻¹ and ξ = K (J δω + (h/2) 𝓜 ζ):
///
///     ζ⁺ = Fᵀζ + ξ
///     J δω⁺ = S(Fᵀa) ξ + Fᵀ (J δω + (h/2) 𝓜 ζ) + (h/2) 𝓜⁺ ζ⁺
///
/// where 𝓜 and 𝓜⁺ are the torque's Jacobians before and after the stage.
/// \return `step_too_long` if tr(F J_d) I − F J_d is singular.
template <typename Scalar>
[[nodiscard]] Status linearize_stage(const RigidBody<Scalar>& body, const Scalar& h, const Stage<Scalar>& stage,
                                     const Matrix3<Scalar>& jacobian_before, const Matrix3<Scalar>& jacobian_after,
                                     FlowLinearization<Scalar>& linearization) noexcept {
  const Scalar half = scalar::constant<Scalar>(0.5L) * h;
  const Matrix3<Scalar> f_transposed = stage.rotation.transpose();
  const Matrix3<Scalar> fjd = stage.rotation * body.nonstandard_inertia();
  const Matrix3<Scalar> implicit = fjd.trace() * Matrix3<Scalar>::Identity() - fjd;
  if (!scalar::all(implicit.determinant() > Scalar(0))) {
    return Status::step_too_long;
  }
  const Matrix3<Scalar> k = (h * f_transposed) * implicit.inverse();
  // Effect of a change of a on J ω⁺ before the second half kick.
  const Matrix3<Scalar> carried = hat(f_transposed * stage.momentum) * k + f_transposed;

  // Changes of a: (h/2) 𝓜 by ζ, J by δω, (h/2) I by the control torque.
  const Matrix3<Scalar> kick_before = half * jacobian_before;
  const Matrix3<Scalar> kick_after = half * jacobian_after;
  const Matrix3<Scalar>& inertia = body.inertia();
  const Matrix3<Scalar>& inverse = body.inertia_inverse();

  const Matrix3<Scalar> zeta_by_zeta = f_transposed + k * kick_before;
  const Matrix3<Scalar> zeta_by_rate = k * inertia;
  const Matrix3<Scalar> zeta_by_control = half * k;
  linearization.state.template topLeftCorner<3, 3>() = zeta_by_zeta;
  linearization.state.template topRightCorner<3, 3>() = zeta_by_rate;
  linearization.state.template bottomLeftCorner<3, 3>() =
      inverse * Matrix3<Scalar>(carried * kick_before + kick_after * zeta_by_zeta);
  linearization.state.template bottomRightCorner<3, 3>() =
      inverse * Matrix3<Scalar>(carried * inertia + kick_after * zeta_by_rate);
  linearization.control.template topRows<3>() = zeta_by_control;
  linearization.control.template bottomRows<3>() =
      inverse * Matrix3<Scalar>(half * (carried + Matrix3<Scalar>::Identity()) + kick_after * zeta_by_control);
  return Status::ok;
}

/// As `integrate`, and the linearization of all the steps together: A^f = A_{l−1} … A_0 (paper, eq. flow).
template <typename Scalar, typename Potential>
[[nodiscard]] Status integrate_linearized(const RigidBody<Scalar>& body, const Potential& potential,
                                          const Composition<Scalar>& composition, const Scalar& time, const Scalar& h,
                                          long steps, const Vector3<Scalar>& control_torque,
                                          const RigidBodyState<Scalar>& state, RigidBodyState<Scalar>& next,
                                          FlowLinearization<Scalar>& linearization) noexcept {
  if (const Status status = validate_step(time, h, control_torque, state); status != Status::ok) {
    return status;
  }
  Stage<Scalar> stage;
  stage.state = state;
  stage.torque = potential.torque(state.attitude, time);
  if (!scalar::all_finite(stage.torque)) {
    return Status::callback_failed;
  }
  Matrix3<Scalar> jacobian = potential.torque_jacobian(state.attitude, time);
  FlowLinearization<Scalar> total = FlowLinearization<Scalar>::identity();
  for (long step = 0; step < steps; ++step) {
    Scalar stage_time = time + Scalar(static_cast<scalar::Value<Scalar>>(step)) * h;
    for (int i = 0; i < composition.stages; ++i) {
      const Scalar length = composition.weights[static_cast<std::size_t>(i)] * h;
      const RigidBodyState<Scalar> before = stage.state;
      const Vector3<Scalar> torque = stage.torque;
      if (const Status status =
              integrate_stage(body, potential, stage_time, length, control_torque, before, torque, stage);
          status != Status::ok) {
        return status;
      }
      stage_time += length;
      const Matrix3<Scalar> jacobian_after = potential.torque_jacobian(stage.state.attitude, stage_time);
      if (!scalar::all_finite(jacobian_after)) {
        return Status::callback_failed;
      }
      FlowLinearization<Scalar> part;
      if (const Status status = linearize_stage(body, length, stage, jacobian, jacobian_after, part);
          status != Status::ok) {
        return status;
      }
      total.state = part.state.lazyProduct(total.state).eval();
      total.control = (part.state.lazyProduct(total.control) + part.control).eval();
      jacobian = jacobian_after;
    }
  }
  next = stage.state;
  linearization = total;
  return Status::ok;
}

}  // namespace elliptude
