#pragma once

/// \file
/// The free rigid body's motion in closed form, by Jacobi's elliptic functions (theory, sections 4.1 and 6.1). An
/// integrator that is given an `ExactRotor` in the place of a `RigidBody` is the splitting with the exact free rotor.

#include "elliptude/dynamics/detail/rotor_step.hpp"
#include "elliptude/dynamics/rigid_body.hpp"

namespace elliptude {

/// A rigid body whose free motion is exact, with the principal axes that this takes. Wherever an integrator's function
/// takes a `RigidBody`, this makes it the symmetric splitting: half a kick of the torque, the exact motion of the free
/// body, half a kick. It is symplectic and time-reversible as the variational step is, and without torque it errs by
/// rounding only, however long the step.
template <typename Scalar>
class ExactRotor : public RigidBody<Scalar> {
 public:
  static constexpr bool is_exact = true;

  /// A body with unit inertia.
  ExactRotor() noexcept
      : axes_(Matrix3<Scalar>::Identity()),
        inverse_moments_(Vector3<Scalar>::Ones()),
        kappa_(scalar::constant<Scalar>(0.5L)),
        spread_(Scalar(0)) {}

  /// \return `not_converged` if the principal axes are not found; no body is known for which that happens.
  [[nodiscard]] static Status make(const RigidBody<Scalar>& body, ExactRotor& rotor) noexcept {
    SymmetricEigen<Scalar, 3> eigen;
    if (const Status status = symmetric_eigen(body.inertia(), eigen); status != Status::ok) {
      return status;
    }
    ExactRotor result(body);
    result.axes_ = eigen.vectors;
    const Scalar handedness = result.axes_.determinant();
    result.axes_.col(1) *= scalar::select(handedness < Scalar(0), Scalar(-1), Scalar(1));
    const Vector3<Scalar>& moments = eigen.values;
    result.inverse_moments_ = moments.cwiseInverse();
    // κ = (b₃ − b₂)/(b₃ − b₁) and (b₃ − b₁)/b₃ of the inverse moments bᵢ, without their differences.
    const Scalar range = moments(0) - moments(2);
    const auto is_sphere = !(range > Scalar(0));
    result.kappa_ = scalar::select(
        is_sphere, scalar::constant<Scalar>(0.5L),
        Scalar((moments(1) - moments(2)) * moments(0) / (moments(1) * scalar::select(is_sphere, Scalar(1), range))));
    result.spread_ = range / moments(0);
    rotor = result;
    return Status::ok;
  }

  /// Right-handed, as columns, that of the largest moment first.
  [[nodiscard]] const Matrix3<Scalar>& principal_axes() const noexcept { return axes_; }
  /// 1/Jᵢ in the same order.
  [[nodiscard]] const Vector3<Scalar>& inverse_moments() const noexcept { return inverse_moments_; }
  /// κ = (1/J₃ − 1/J₂)/(1/J₃ − 1/J₁), ½ for a body with three equal moments.
  [[nodiscard]] const Scalar& kappa() const noexcept { return kappa_; }
  /// 1 − J₃/J₁.
  [[nodiscard]] const Scalar& spread() const noexcept { return spread_; }

  /// The same body for another scalar type.
  template <typename Other>
  [[nodiscard]] ExactRotor<Other> cast() const noexcept {
    ExactRotor<Other> result(RigidBody<Scalar>::template cast<Other>());
    result.axes_ = axes_.template cast<Other>();
    result.inverse_moments_ = inverse_moments_.template cast<Other>();
    result.kappa_ = Other(kappa_);
    result.spread_ = Other(spread_);
    return result;
  }

 private:
  template <typename>
  friend class ExactRotor;

  explicit ExactRotor(const RigidBody<Scalar>& body) noexcept : RigidBody<Scalar>(body) {}

  Matrix3<Scalar> axes_;
  Vector3<Scalar> inverse_moments_;
  Scalar kappa_;
  Scalar spread_;
};

/// F, the rotation of the free body within the time h: C(h) = C F and, of the momentum in body axes, a(h) = Fᵀa.
/// \param h in s, of either sign and any length.
/// \param a Jω at the start, N m s, body axes.
/// \return `step_too_long` of a turn so long, beyond 1/ε, that rounding leaves nothing of its angle, or that is not
/// finite.
template <typename Scalar>
[[nodiscard]] Status relative_attitude(const ExactRotor<Scalar>& rotor, const Scalar& h, const Vector3<Scalar>& a,
                                       Matrix3<Scalar>& f) noexcept {
  detail::RotorStep<Scalar> step;
  if (const Status status = step.template find<false>(rotor, h, a); status != Status::ok) {
    return status;
  }
  f = step.rotation();
  return Status::ok;
}

/// The same, and Kᵀ, which turns a change of the momentum into one of the attitude at the end: ζ⁺ = Fᵀζ + K δa
/// (theory, eq. 6.6).
/// \return as `relative_attitude`.
template <typename Scalar>
[[nodiscard]] Status relative_attitude_linearized(const ExactRotor<Scalar>& rotor, const Scalar& h,
                                                  const Vector3<Scalar>& a, Matrix3<Scalar>& f,
                                                  Matrix3<Scalar>& k_transposed) noexcept {
  detail::RotorStep<Scalar> step;
  if (const Status status = step.template find<true>(rotor, h, a); status != Status::ok) {
    return status;
  }
  f = step.rotation();
  k_transposed = step.by_momentum().transpose();
  return Status::ok;
}

}  // namespace elliptude
