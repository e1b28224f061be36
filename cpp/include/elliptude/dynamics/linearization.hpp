#pragma once

/// \file
/// The linearization of the discrete flow (paper, §3.1: x⁺ = A x with x = [ζ; δω]; theory, section 6), for the step,
/// its compositions and any number of steps, with respect to the state and to a constant control torque.

#include "elliptude/base/interruption.hpp"
#include "elliptude/dynamics/integrator.hpp"

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

/// F of `relative_attitude`, and Kᵀ with K = h Fᵀ [tr(F J_d) I − F J_d]⁻¹, which turns a change of the momentum into
/// one of the attitude at the end: ζ⁺ = Fᵀζ + K δa (theory, eq. 6.1).
/// \return `step_too_long`, also if tr(F J_d) I − F J_d is singular.
template <typename Scalar>
[[nodiscard]] Status relative_attitude_linearized(const RigidBody<Scalar>& body, const Scalar& h,
                                                  const Vector3<Scalar>& a, Matrix3<Scalar>& f,
                                                  Matrix3<Scalar>& k_transposed) noexcept {
  if (const Status status = relative_attitude(body, h, a, f); status != Status::ok) {
    return status;
  }
  const Matrix3<Scalar> fjd = f.lazyProduct(body.nonstandard_inertia());
  // Rows of tr(F J_d) I − F J_d; its inverse by their cross products.
  const Scalar trace = fjd.trace();
  const Vector3<Scalar> r0(trace - fjd(0, 0), -fjd(0, 1), -fjd(0, 2));
  const Vector3<Scalar> r1(-fjd(1, 0), trace - fjd(1, 1), -fjd(1, 2));
  const Vector3<Scalar> r2(-fjd(2, 0), -fjd(2, 1), trace - fjd(2, 2));
  Matrix3<Scalar> cofactors;
  cofactors.col(0) = r1.cross(r2);
  cofactors.col(1) = r2.cross(r0);
  cofactors.col(2) = r0.cross(r1);
  const Scalar determinant = r0.dot(Vector3<Scalar>(cofactors.col(0)));
  if (!scalar::all(determinant > Scalar(0))) {
    return Status::step_too_long;
  }
  k_transposed = (h / determinant) * cofactors.transpose().lazyProduct(f);
  return Status::ok;
}

/// The linearization as it grows stage by stage, in [ζ; δπ] with the momentum π = Jω, where a stage is a kick, a free
/// rotor and a kick. Both matrices are transposed, so that a stage runs along columns: one row for each entry of ζ and
/// δπ at the start and of the control torque, and three of zeros that make twelve, whole SIMD registers of any width.
template <typename Scalar>
struct MomentumLinearization {
  Matrix<Scalar, 12, 3> zeta;
  Matrix<Scalar, 12, 3> momentum;

  [[nodiscard]] static MomentumLinearization identity() noexcept {
    MomentumLinearization result{Matrix<Scalar, 12, 3>::Zero(), Matrix<Scalar, 12, 3>::Zero()};
    result.zeta.template block<3, 3>(0, 0).setIdentity();
    result.momentum.template block<3, 3>(3, 0).setIdentity();
    return result;
  }

  /// A push of some length by the control torque alone: δπ ← δπ + length δu.
  void push(const Scalar& length) noexcept {
    for (int i = 0; i < 3; ++i) {
      momentum(6 + i, i) += length;
    }
  }

  /// A kick of some length: δπ ← δπ + length (𝓜 ζ + δu), with the Jacobian 𝓜 = ∂M/∂ζ of the torque and δu of the
  /// control.
  void kick(const Scalar& length, const Matrix3<Scalar>& jacobian) noexcept {
    const Matrix3<Scalar> transposed = length * jacobian.transpose();
    momentum += zeta.lazyProduct(transposed);
    push(length);
  }

  /// The free rotor, eq. (6.1): ζ ← Fᵀζ + Kδπ and δπ ← S(Fᵀa) Kδπ + Fᵀδπ.
  void turn(const Matrix3<Scalar>& k_transposed, const Stage<Scalar>& stage) noexcept {
    zeta = (zeta.lazyProduct(stage.rotation) + momentum.lazyProduct(k_transposed)).eval();
    momentum = momentum.lazyProduct(momentum_turned(k_transposed, stage)).eval();
  }

  /// Becomes what a push of some length and a turn make of the identity.
  void begin_with_push(const Scalar& length, const Matrix3<Scalar>& k_transposed, const Stage<Scalar>& stage) noexcept {
    const Matrix3<Scalar> turned = momentum_turned(k_transposed, stage);
    for (int j = 0; j < 3; ++j) {
      zeta.col(j).template segment<3>(0) = stage.rotation.col(j);
      zeta.col(j).template segment<3>(3) = k_transposed.col(j);
      zeta.col(j).template segment<3>(6) = length * k_transposed.col(j);
      zeta.col(j).template segment<3>(9).setZero();
      momentum.col(j).template segment<3>(0).setZero();
      momentum.col(j).template segment<3>(3) = turned.col(j);
      momentum.col(j).template segment<3>(6) = length * turned.col(j);
      momentum.col(j).template segment<3>(9).setZero();
    }
  }

  /// The same of a kick.
  void begin_with_kick(const Scalar& length, const Matrix3<Scalar>& jacobian, const Matrix3<Scalar>& k_transposed,
                       const Stage<Scalar>& stage) noexcept {
    begin_with_push(length, k_transposed, stage);
    const Matrix3<Scalar> kick = length * jacobian.transpose();
    zeta.template topRows<3>() += kick.lazyProduct(k_transposed);
    momentum.template topRows<3>() = kick.lazyProduct(momentum.template middleRows<3>(3));
  }

  /// Puts the same in [ζ; δω] where it shall be.
  void put_in_angular_velocity(const RigidBody<Scalar>& body, FlowLinearization<Scalar>& result) const noexcept {
    const Matrix<Scalar, 12, 3> rate = momentum.lazyProduct(body.inertia_inverse());
    const Matrix3<Scalar>& inertia = body.inertia();
    result.state.template topLeftCorner<3, 3>() = zeta.template middleRows<3>(0).transpose();
    result.state.template topRightCorner<3, 3>() = zeta.template middleRows<3>(3).transpose().lazyProduct(inertia);
    result.state.template bottomLeftCorner<3, 3>() = rate.template middleRows<3>(0).transpose();
    result.state.template bottomRightCorner<3, 3>() = rate.template middleRows<3>(3).transpose().lazyProduct(inertia);
    result.control.template topRows<3>() = zeta.template middleRows<3>(6).transpose();
    result.control.template bottomRows<3>() = rate.template middleRows<3>(6).transpose();
  }

 private:
  /// What a turn multiplies δπ by, transposed: F + Kᵀ S(Fᵀa)ᵀ.
  [[nodiscard]] static Matrix3<Scalar> momentum_turned(const Matrix3<Scalar>& k_transposed,
                                                       const Stage<Scalar>& stage) noexcept {
    const Vector3<Scalar> carried = stage.rotation.transpose() * stage.momentum;
    return stage.rotation - k_transposed.lazyProduct(hat(carried));
  }
};

namespace detail {

/// Linearizes stage by stage. The kick at the end of a stage and that at the start of the next are one, as the attitude
/// between them is the same; and the first stage starts from the identity, which needs no product.
template <typename Scalar, typename Potential>
class Linearizer {
 public:
  Matrix3<Scalar> k_transposed;  ///< of the free turn of the next stage

  /// \return `callback_failed` for a torque Jacobian that is not finite.
  [[nodiscard]] Status start(const Potential& potential, const Matrix3<Scalar>& attitude, const Scalar& time) noexcept {
    return find_jacobian(potential, attitude, time);
  }

  /// \param stage that has been integrated, until `time`. \return as `start`.
  [[nodiscard]] Status go_on(const Potential& potential, const StageLengths<Scalar>& lengths,
                             const Stage<Scalar>& stage, const Scalar& time) noexcept {
    const Scalar length = left_ + lengths.before;
    left_ = lengths.after;
    if (has_begun_) {
      act(length);
      total_.turn(k_transposed, stage);
    } else if constexpr (has_torque<Potential>) {
      total_.begin_with_kick(length, jacobian_, k_transposed, stage);
    } else {
      total_.begin_with_push(length, k_transposed, stage);
    }
    has_begun_ = true;
    return find_jacobian(potential, stage.state.attitude, time);
  }

  /// After the last stage.
  [[nodiscard]] const MomentumLinearization<Scalar>& end() noexcept {
    if (!has_begun_) {
      total_ = MomentumLinearization<Scalar>::identity();
    }
    act(left_);
    left_ = Scalar(0);
    return total_;
  }

 private:
  [[nodiscard]] Status find_jacobian([[maybe_unused]] const Potential& potential,
                                     [[maybe_unused]] const Matrix3<Scalar>& attitude,
                                     [[maybe_unused]] const Scalar& time) noexcept {
    if constexpr (has_torque<Potential>) {
      jacobian_ = potential.torque_jacobian(attitude, time);
      return scalar::all_finite(jacobian_) ? Status::ok : Status::callback_failed;
    } else {
      return Status::ok;
    }
  }

  void act(const Scalar& length) noexcept {
    if constexpr (has_torque<Potential>) {
      total_.kick(length, jacobian_);
    } else {
      total_.push(length);
    }
  }

  MomentumLinearization<Scalar> total_;
  Matrix3<Scalar> jacobian_;  // of the torque at the present attitude
  Scalar left_{0};            // how long that torque still acts after the last turn
  bool has_begun_ = false;
};

}  // namespace detail

/// As `integrate`, and the linearization of all the steps together: A^f = A_{l−1} … A_0 (paper, eq. flow).
///
/// A stage of length h with a = Jω + (h/2) M and F turns perturbations by
///
///     ζ⁺ = Fᵀζ + ξ,   ξ = K (J δω + (h/2) 𝓜 ζ),   K = h Fᵀ [tr(F J_d) I − F J_d]⁻¹
///     J δω⁺ = S(Fᵀa) ξ + Fᵀ (J δω + (h/2) 𝓜 ζ) + (h/2) 𝓜⁺ ζ⁺
///
/// With an `ExactRotor` K is another, eq. (6.6).
///
/// \return as `integrate`; `callback_failed` also for a torque Jacobian that is not finite; `interrupted`.
template <typename Body, typename Method, typename Scalar, typename Potential>
[[nodiscard]] Status integrate_linearized(const Body& body, const Potential& potential, const Method& method,
                                          const Scalar& time, const Scalar& h, long steps,
                                          const Vector3<Scalar>& control_torque, const RigidBodyState<Scalar>& state,
                                          RigidBodyState<Scalar>& next, FlowLinearization<Scalar>& linearization,
                                          const Interruption& interruption = Interruption()) noexcept {
  static_assert(!Method::needs_exact_rotor || Body::is_exact, "a Splitting has its order with an ExactRotor only");
  if (const Status status = validate_step(time, h, control_torque, state); status != Status::ok) {
    return status;
  }
  if (steps < 0) {
    return Status::out_of_range;
  }
  Stage<Scalar> stage;
  if (const Status status = start_stage(body, potential, time, state, stage); status != Status::ok) {
    return status;
  }
  detail::Linearizer<Scalar, Potential> linearizer;
  if (const Status status = linearizer.start(potential, state.attitude, time); status != Status::ok) {
    return status;
  }
  const auto free_turn = [&](const Scalar& length, const Vector3<Scalar>& momentum, Matrix3<Scalar>& f) {
    return relative_attitude_linearized(body, length, momentum, f, linearizer.k_transposed);
  };
  for (long step = 0; step < steps; ++step) {
    if (interruption.after(step)) {
      return Status::interrupted;
    }
    Scalar stage_time = time + Scalar(static_cast<scalar::Value<Scalar>>(step)) * h;
    for (int i = 0; i < method.stages; ++i) {
      const auto lengths = StageLengths<Scalar>::of(method, i, h);
      if (const Status status =
              integrate_stage<Scalar>(body, potential, stage_time, lengths, control_torque, free_turn, stage);
          status != Status::ok) {
        return status;
      }
      stage_time += lengths.turn;
      if (const Status status = linearizer.go_on(potential, lengths, stage, stage_time); status != Status::ok) {
        return status;
      }
    }
  }
  next = stage.state;
  linearizer.end().put_in_angular_velocity(body, linearization);
  return Status::ok;
}

}  // namespace elliptude
