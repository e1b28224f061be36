#pragma once

/// \file
/// Charts of the attitude error: coordinates about a center Ĉ, in body axes, zero at Ĉ (paper, §2.3.2).

#include "elliptude/base/so3.hpp"

namespace elliptude {

/// The paper's ζ: C = Ĉ exp(S(ζ)), a rotation vector in radians; a chart up to half turns.
struct ExponentialChart {
  template <typename Scalar>
  [[nodiscard]] static Vector3<Scalar> error(const Matrix3<Scalar>& center, const Matrix3<Scalar>& attitude) noexcept {
    return log(Matrix3<Scalar>(center.transpose() * attitude));
  }

  template <typename Scalar>
  [[nodiscard]] static Matrix3<Scalar> retract(const Matrix3<Scalar>& center, const Vector3<Scalar>& zeta) noexcept {
    return center * exp(zeta);
  }

  /// The angle of an error of this length, rad.
  template <typename Scalar>
  [[nodiscard]] static Scalar angle(const Scalar& length) noexcept {
    return length;
  }

  /// An error ζ about Ĉ, seen from Ĉ' with Ĉ = Ĉ' exp(S(a)), is a + G ζ to first order: G = J_r⁻¹(a).
  /// (theory, section 10)
  template <typename Scalar>
  [[nodiscard]] static Matrix3<Scalar> seen_from(const Vector3<Scalar>& offset) noexcept {
    return right_jacobian_inverse(offset);
  }

  /// An error ζ about Ĉ is G (ζ − ζ̂) to first order about Ĉ exp(S(ζ̂)): G = J_r(ζ̂).
  template <typename Scalar>
  [[nodiscard]] static Matrix3<Scalar> moved_to(const Vector3<Scalar>& center_error) noexcept {
    return right_jacobian(center_error);
  }
};

/// γ = 2 tan(θ/2) n, twice the Gibbs vector, equal to ζ to second order: a chart up to half turns in which a
/// direction's cone is a quadric.
struct GibbsChart {
  template <typename Scalar>
  [[nodiscard]] static Vector3<Scalar> error(const Matrix3<Scalar>& center, const Matrix3<Scalar>& attitude) noexcept {
    return Scalar(2) * cayley_inverse(Matrix3<Scalar>(center.transpose() * attitude));
  }

  template <typename Scalar>
  [[nodiscard]] static Matrix3<Scalar> retract(const Matrix3<Scalar>& center, const Vector3<Scalar>& gamma) noexcept {
    return center * cayley(scalar::constant<Scalar>(0.5L) * gamma);
  }

  /// The angle of an error of this length, rad: 2 atan(‖γ‖/2). For a single component γᵢ it bounds |ζᵢ|.
  /// (theory, section 16.4)
  template <typename Scalar>
  [[nodiscard]] static Scalar angle(const Scalar& length) noexcept {
    return Scalar(2) * scalar::atan2(Scalar(scalar::constant<Scalar>(0.5L) * length), Scalar(1));
  }
};

/// γ = τ ζ with τ = 2 tan(θ/2)/θ, which grows with the angle: for an angle below π, from 1 on.
template <typename Scalar>
[[nodiscard]] Scalar gibbs_stretch(const Scalar& angle) noexcept {
  const Scalar half = scalar::constant<Scalar>(0.5L) * angle;
  return half > Scalar(0) ? Scalar(scalar::sin(half) / (half * scalar::cos(half))) : Scalar(1);
}

}  // namespace elliptude
