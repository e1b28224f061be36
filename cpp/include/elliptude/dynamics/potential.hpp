#pragma once

/// \file
/// Potentials U(C, t) of the attitude, and the torques they exert (the paper's moment M, §2.3.1).
///
/// A potential is any type with
///
///     Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const;                   // U, joule
///     Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const;          // M, N m, body axes
///     Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const; // ∂M/∂ζ, C = Ĉ exp(S(ζ))
///
/// and, if it can promise one,
///
///     Scalar torque_curvature_bound() const;
///
/// a κ with ‖M(Ĉ exp(S(ζ))) − M(Ĉ) − (∂M/∂ζ) ζ‖ ≤ κ ‖ζ‖² for every Ĉ, ζ and time; and, for smoothing, which goes
/// backward in time,
///
///     Potential backward() const;  // the potential U(C, −t), of this type or of another
///
/// (theory, section 20.1). A guaranteed flow needs more of a potential: a `TorqueExpansion`
/// (guaranteed/torque_expansion.hpp). A potential reports a failure by a torque that is not finite: the integrator then
/// returns `Status::callback_failed`. The integrators need no more than this. A flow holds a potential, which must
/// also be default-constructible and assignable: a `GradientPotential` is not, and fits no flow.

#include <tuple>
#include <utility>

#include "elliptude/base/rounding.hpp"
#include "elliptude/dynamics/rigid_body.hpp"

namespace elliptude {

namespace detail {

template <typename Potential, typename Scalar, typename = void>
struct IsPotential : std::false_type {};

template <typename Potential, typename Scalar>
struct IsPotential<Potential, Scalar,
                   std::void_t<decltype(Scalar(std::declval<const Potential&>().energy(
                                   std::declval<const Matrix3<Scalar>&>(), std::declval<const Scalar&>()))),
                               decltype(Vector3<Scalar>(std::declval<const Potential&>().torque(
                                   std::declval<const Matrix3<Scalar>&>(), std::declval<const Scalar&>()))),
                               decltype(Matrix3<Scalar>(std::declval<const Potential&>().torque_jacobian(
                                   std::declval<const Matrix3<Scalar>&>(), std::declval<const Scalar&>())))>>
    : std::true_type {};

template <typename Potential, typename = void>
struct HasCurvatureBound : std::false_type {};

template <typename Potential>
struct HasCurvatureBound<Potential, std::void_t<decltype(std::declval<const Potential&>().torque_curvature_bound())>>
    : std::true_type {};

template <typename Torque, typename = void>
struct GoesBackward : std::false_type {};

template <typename Torque>
struct GoesBackward<Torque, std::void_t<decltype(std::declval<const Torque&>().backward())>> : std::true_type {};

}  // namespace detail

template <typename Potential, typename Scalar>
constexpr bool is_potential = detail::IsPotential<Potential, Scalar>::value;
template <typename Potential>
constexpr bool has_curvature_bound = detail::HasCurvatureBound<Potential>::value;
/// Whether a potential, or a torque, says what it is at the time −t.
template <typename Torque>
constexpr bool goes_backward = detail::GoesBackward<Torque>::value;

/// No potential: a free body.
template <typename Scalar>
struct FreeBody {
  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& /*attitude*/, const Scalar& /*time*/) const noexcept {
    return Scalar(0);
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& /*attitude*/, const Scalar& /*time*/) const noexcept {
    return Vector3<Scalar>::Zero();
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& /*attitude*/,
                                                const Scalar& /*time*/) const noexcept {
    return Matrix3<Scalar>::Zero();
  }
  [[nodiscard]] Scalar torque_curvature_bound() const noexcept { return Scalar(0); }
  [[nodiscard]] FreeBody backward() const noexcept { return *this; }

  template <typename Other>
  [[nodiscard]] FreeBody<Other> cast() const noexcept {
    return {};
  }
};

/// Whether a potential may have a torque.
template <typename Potential>
constexpr bool has_torque = true;
template <typename Scalar>
constexpr bool has_torque<FreeBody<Scalar>> = false;  // NOLINT(misc-definitions-in-headers): a template

/// Uniform gravity on a body held at a point, the 3D pendulum: U = −m g e₃ᵀCρ. The third reference axis points down.
/// M = m g ρ × Cᵀe₃, ∂M/∂ζ = m g S(ρ) S(Cᵀe₃).
template <typename Scalar>
class UniformGravity {
 public:
  /// No weight.
  UniformGravity() noexcept : moment_(Vector3<Scalar>::Zero()) {}

  /// \param mass m in kg, not negative.
  /// \param gravity g in m/s², not negative.
  /// \param center_of_mass ρ in m, body axes, from the fixed point.
  /// \return `not_finite`, `out_of_range`; `beyond_domain` if m g ρ overflows.
  [[nodiscard]] static Status make(const Scalar& mass, const Scalar& gravity, const Vector3<Scalar>& center_of_mass,
                                   UniformGravity& potential) noexcept {
    if (!scalar::isfinite(mass) || !scalar::isfinite(gravity) || !scalar::all_finite(center_of_mass)) {
      return Status::not_finite;
    }
    if (!(mass >= Scalar(0)) || !(gravity >= Scalar(0))) {
      return Status::out_of_range;
    }
    const Vector3<Scalar> moment = (mass * gravity) * center_of_mass;
    if (!scalar::all_finite(moment)) {
      return Status::beyond_domain;
    }
    potential.moment_ = moment;
    return Status::ok;
  }

  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) const noexcept {
    return -down(attitude).dot(moment_);
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) const noexcept {
    return moment_.cross(down(attitude));
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude,
                                                const Scalar& /*time*/) const noexcept {
    return hat_product(moment_, down(attitude));
  }
  /// ½ m g ‖ρ‖: along a rotation about a fixed axis the second derivative of Cᵀe₃ is at most one in size.
  [[nodiscard]] Scalar torque_curvature_bound() const noexcept {
    return scalar::constant<Scalar>(0.5L) * scalar::sqrt(Scalar(moment_.squaredNorm()));
  }
  [[nodiscard]] UniformGravity backward() const noexcept { return *this; }

  /// m g ρ, N m, body axes.
  [[nodiscard]] const Vector3<Scalar>& moment() const noexcept { return moment_; }

  template <typename Other>
  [[nodiscard]] UniformGravity<Other> cast() const noexcept {
    UniformGravity<Other> result;
    result.moment_ = moment_.template cast<Other>();
    return result;
  }

 private:
  template <typename>
  friend class UniformGravity;

  /// Cᵀe₃, the third row of C.
  [[nodiscard]] static Vector3<Scalar> down(const Matrix3<Scalar>& attitude) noexcept {
    return attitude.row(2).transpose();
  }

  Vector3<Scalar> moment_;  // m g ρ, N m
};

/// Gravity gradient on a circular orbit of rate n. With r(t) the unit vector from the attracting body, in reference
/// axes, and b = Cᵀr: U = (3n²/2) bᵀJb, M = 3n² b × Jb, ∂M/∂ζ = 3n² (−S(Jb) + S(b)J) S(b). It depends on time.
template <typename Scalar>
class GravityGradient {
 public:
  /// No orbital motion, no torque.
  ELLIPTUDE_SELDOM GravityGradient() noexcept
      : inertia_(Matrix3<Scalar>::Identity()),
        orbit_(Matrix3<Scalar>::Identity()),
        spread_(Scalar(0)),
        rate_(Scalar(0)) {}

  /// \param body whose inertia the torque acts on.
  /// \param orbit_rate n in rad/s, not negative.
  /// \param orbit a rotation whose columns are, in reference axes, the radial direction at t = 0, the direction of
  /// motion and the orbit normal: r(t) = cos(nt) column 0 + sin(nt) column 1.
  /// \return `not_finite`, `out_of_range`, `not_a_rotation`; `beyond_domain` if 3n² or 3n²J overflows.
  [[nodiscard]] static ELLIPTUDE_SELDOM Status make(const RigidBody<Scalar>& body, const Scalar& orbit_rate,
                                                    const Matrix3<Scalar>& orbit, GravityGradient& potential) noexcept {
    if (!scalar::isfinite(orbit_rate) || !scalar::all_finite(orbit)) {
      return Status::not_finite;
    }
    if (!(orbit_rate >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (!is_rotation(orbit, rotation_tolerance<Scalar>())) {
      return Status::not_a_rotation;
    }
    const Scalar strength = strength_of(orbit_rate);
    if (!scalar::isfinite(strength) || !scalar::isfinite(Scalar(strength * body.principal_moments()(0)))) {
      return Status::beyond_domain;
    }
    potential.inertia_ = body.inertia();
    potential.orbit_ = renormalized(orbit);
    potential.spread_ = body.principal_moments()(0) - body.principal_moments()(2);
    potential.rate_ = orbit_rate;
    return Status::ok;
  }

  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    const Vector3<Scalar> b = radial(attitude, time);
    return scalar::constant<Scalar>(0.5L) * strength() * b.dot(inertia_ * b);
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    const Vector3<Scalar> b = radial(attitude, time);
    return strength() * b.cross(Vector3<Scalar>(inertia_ * b));
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    const Vector3<Scalar> b = radial(attitude, time);
    const Vector3<Scalar> jb = inertia_ * b;
    const Matrix3<Scalar> sb = hat(b);
    return strength() * (sb.lazyProduct(Matrix3<Scalar>(inertia_.lazyProduct(sb))) - hat_product(jb, b));
  }
  /// 3n² (J_max − J_min).
  [[nodiscard]] Scalar torque_curvature_bound() const noexcept { return strength() * spread_; }
  /// r(−t) is that of the orbit O diag(1, −1, −1), which rounding leaves as it is. (theory, eq. 20.3)
  [[nodiscard]] GravityGradient backward() const noexcept {
    GravityGradient result = *this;
    result.orbit_.template rightCols<2>() *= Scalar(-1);
    return result;
  }

  [[nodiscard]] const Matrix3<Scalar>& inertia() const noexcept { return inertia_; }
  /// Columns: the radial direction at t = 0, the direction of motion, the orbit normal.
  [[nodiscard]] const Matrix3<Scalar>& orbit() const noexcept { return orbit_; }
  /// n, rad/s.
  [[nodiscard]] const Scalar& orbit_rate() const noexcept { return rate_; }

  template <typename Other>
  [[nodiscard]] GravityGradient<Other> cast() const noexcept {
    GravityGradient<Other> result;
    result.inertia_ = inertia_.template cast<Other>();
    result.orbit_ = orbit_.template cast<Other>();
    result.spread_ = Other(spread_);
    result.rate_ = Other(rate_);
    return result;
  }

 private:
  template <typename>
  friend class GravityGradient;

  /// 3n², in 1/s².
  [[nodiscard]] Scalar strength() const noexcept { return strength_of(rate_); }
  [[nodiscard]] static Scalar strength_of(const Scalar& rate) noexcept { return Scalar(3) * rate * rate; }

  /// b = Cᵀ r(t).
  [[nodiscard]] Vector3<Scalar> radial(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    const Scalar angle = rate_ * time;
    const Vector3<Scalar> r = scalar::cos(angle) * orbit_.col(0) + scalar::sin(angle) * orbit_.col(1);
    return attitude.transpose() * r;
  }

  Matrix3<Scalar> inertia_;
  Matrix3<Scalar> orbit_;
  Scalar spread_;  // J_max − J_min
  Scalar rate_;
};

/// The sum of potentials. It has a curvature bound if each of them has.
template <typename... Potentials>
class SumPotential {
 public:
  static_assert(sizeof...(Potentials) > 0);

  /// The sum of default potentials, if each type has a default: a flow needs one to be default-constructed.
  SumPotential() = default;
  explicit SumPotential(Potentials... potentials) noexcept : potentials_(std::move(potentials)...) {}

  template <typename Scalar>
  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return std::apply([&](const auto&... p) { return Scalar((p.energy(attitude, time) + ...)); }, potentials_);
  }
  template <typename Scalar>
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return std::apply([&](const auto&... p) { return Vector3<Scalar>((p.torque(attitude, time) + ...)); }, potentials_);
  }
  template <typename Scalar>
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return std::apply([&](const auto&... p) { return Matrix3<Scalar>((p.torque_jacobian(attitude, time) + ...)); },
                      potentials_);
  }
  [[nodiscard]] const std::tuple<Potentials...>& potentials() const noexcept { return potentials_; }
  template <bool Bounded = (has_curvature_bound<Potentials> && ...), typename = std::enable_if_t<Bounded>>
  [[nodiscard]] auto torque_curvature_bound() const noexcept {
    return std::apply([](const auto&... p) { return (p.torque_curvature_bound() + ...); }, potentials_);
  }
  template <bool Backward = (goes_backward<Potentials> && ...), typename = std::enable_if_t<Backward>>
  [[nodiscard]] auto backward() const noexcept {
    return std::apply([](const auto&... p) { return SumPotential<decltype(p.backward())...>(p.backward()...); },
                      potentials_);
  }

 private:
  std::tuple<Potentials...> potentials_;
};

/// The torque of a potential from its gradient ∂U/∂C (entries ∂U/∂Cᵢⱼ, as if they were independent):
/// M = Σ rᵢ × vᵢ with rᵢ and vᵢ the rows of C and of ∂U/∂C, which is S(M) = (∂U/∂C)ᵀC − Cᵀ(∂U/∂C).
template <typename Scalar>
[[nodiscard]] Vector3<Scalar> torque_of_gradient(const Matrix3<Scalar>& attitude,
                                                 const Matrix3<Scalar>& gradient) noexcept {
  Vector3<Scalar> torque = Vector3<Scalar>::Zero();
  for (int i = 0; i < 3; ++i) {
    torque += Vector3<Scalar>(attitude.row(i).transpose()).cross(Vector3<Scalar>(gradient.row(i).transpose()));
  }
  return torque;
}

/// A user's potential from two functions of (attitude, time): its energy and its gradient ∂U/∂C. The torque's Jacobian
/// is taken by fourth-order central differences, whose error is about 1e-12 of the torque in double.
template <typename Scalar, typename Energy, typename Gradient>
class GradientPotential {
 public:
  GradientPotential(Energy energy, Gradient gradient) noexcept
      : energy_(std::move(energy)), gradient_(std::move(gradient)) {}

  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return energy_(attitude, time);
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return torque_of_gradient(attitude, Matrix3<Scalar>(gradient_(attitude, time)));
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    // ε^(1/5), where truncation and rounding of the fourth-order difference are alike.
    const Scalar step = scalar::exp(Scalar(scalar::log(rounding::one_rounding<Scalar>()) / Scalar(5)));
    Matrix3<Scalar> jacobian;
    for (int j = 0; j < 3; ++j) {
      const Vector3<Scalar> axis = Vector3<Scalar>::Unit(j);
      const auto difference = [&](const Scalar& angle) {
        return Vector3<Scalar>(torque(Matrix3<Scalar>(attitude * exp(angle * axis)), time) -
                               torque(Matrix3<Scalar>(attitude * exp(-angle * axis)), time));
      };
      jacobian.col(j) = (Scalar(8) * difference(step) - difference(Scalar(2) * step)) / (Scalar(12) * step);
    }
    return jacobian;
  }

 private:
  Energy energy_;
  Gradient gradient_;
};

}  // namespace elliptude
