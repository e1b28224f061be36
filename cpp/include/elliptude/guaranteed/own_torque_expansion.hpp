#pragma once

/// \file
/// The expansions of potentials of one's own (dynamics/own_potential.hpp). (theory, section 17.10)

#include "elliptude/dynamics/own_potential.hpp"
#include "elliptude/guaranteed/torque_expansion.hpp"

namespace elliptude {

/// M = p × s with s = Cᵀr(t), as for uniform gravity but that r may turn: r' = n v, v' = −n r.
template <typename Scalar, int Terms>
class TorqueExpansion<LinearPotential<Scalar>, Scalar, Terms> {
 public:
  explicit TorqueExpansion(const LinearPotential<Scalar>& potential) noexcept
      : moment_(potential.moment()), direction_(potential.direction()) {}

  [[nodiscard]] Vector3<Scalar> start(const Matrix3<Scalar>& attitude, const Scalar& time) noexcept {
    const Scalar angle = direction_.rate() * time;
    const Scalar cosine = scalar::cos(angle);
    const Scalar sine = scalar::sin(angle);
    return add(0, attitude.transpose() * (cosine * direction_.start() + sine * direction_.along()),
               attitude.transpose() * (cosine * direction_.along() - sine * direction_.start()));
  }
  [[nodiscard]] Vector3<Scalar> extend(int k, const std::array<Vector3<Scalar>, Terms>& rate) noexcept {
    const auto last = static_cast<std::size_t>(k - 1);
    const Scalar factor = Scalar(1) / Scalar(k);
    return add(k, factor * (direction_.rate() * along_[last] - expansion::cross_coefficient(k - 1, rate, seen_)),
               factor * (-direction_.rate() * seen_[last] - expansion::cross_coefficient(k - 1, rate, along_)));
  }
  [[nodiscard]] Matrix3<Scalar> jacobian(int k) const noexcept {
    return hat_product(moment_, seen_[static_cast<std::size_t>(k)]);
  }
  void add_curvature(const Scalar& s, const Matrix3<Scalar>& transform,
                     expansion::Forms<Scalar>& forms) const noexcept {
    const Vector3<Scalar> seen = expansion::value(seen_, count_, s);
    const Matrix3<Scalar> n = transform.lazyProduct(hat(moment_));
    for (int i = 0; i < 3; ++i) {
      forms[static_cast<std::size_t>(i)] += expansion::second_order_form(Vector3<Scalar>(n.row(i).transpose()), seen);
    }
  }
  /// −¼‖γ‖² p × (s × γ).
  void add_cubic(const Scalar& s, const Matrix3<Scalar>& transform, const Matrix3<Scalar>& axes,
                 expansion::CubicForms<Scalar>& forms) const noexcept {
    const Vector3<Scalar> seen = expansion::value(seen_, count_, s);
    expansion::add_cubic_of_first_degree(hat_product(moment_, seen), transform, axes, forms);
  }
  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& transform) const noexcept {
    const Matrix3<Scalar> map = transform.lazyProduct(hat(moment_));
    const Matrix3<Scalar> shape = map.lazyProduct(map.transpose());
    return {norm_of_gram(shape), Scalar(1), direction_.rate(), Scalar(0), shape};
  }

 private:
  [[nodiscard]] Vector3<Scalar> add(int k, const Vector3<Scalar>& seen, const Vector3<Scalar>& along) noexcept {
    const auto index = static_cast<std::size_t>(k);
    seen_[index] = seen;
    along_[index] = along;
    count_ = k + 1;
    return moment_.cross(seen);
  }

  Vector3<Scalar> moment_;
  TurningDirection<Scalar> direction_;
  std::array<Vector3<Scalar>, Terms> seen_;
  std::array<Vector3<Scalar>, Terms> along_;
  int count_ = 0;
};

template <typename Scalar, int Terms>
class TorqueExpansion<QuadraticPotential<Scalar>, Scalar, Terms> : public expansion::QuadraticTorque<Scalar, Terms> {
 public:
  explicit TorqueExpansion(const QuadraticPotential<Scalar>& potential) noexcept
      : expansion::QuadraticTorque<Scalar, Terms>(potential.matrix(), Scalar(1), potential.direction().start(),
                                                  potential.direction().along(), potential.direction().rate()),
        products_(scalar::sqrt(Scalar(potential.matrix().squaredNorm()))) {}

  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& transform) const noexcept {
    TorqueBounds<Scalar> bounds = expansion::QuadraticTorque<Scalar, Terms>::bounds(transform);
    bounds.products = products_;
    return bounds;
  }

 private:
  Scalar products_;  // ‖K‖: of a nearly isotropic K little is left of b × Kb
};

/// The part M* + 𝓜* a of a stated torque, with the value M* and the derivative 𝓜* at the attitude C* and the time in
/// the middle of a step, and a = sin θ n for C = C* exp(θ S(n)). In C it is a polynomial of first degree: a = ½ Σ sᵢ ×
/// eᵢ, sᵢ = CᵀC*eᵢ. What it lacks of the torque is `remainder`. (theory, eqs. 17.12 and 17.13)
template <typename Scalar, typename Torque, int Terms>
class TorqueExpansion<StatedTorque<Scalar, Torque>, Scalar, Terms> {
 public:
  static constexpr bool is_local = true;

  explicit TorqueExpansion(const StatedTorque<Scalar, Torque>& torque) noexcept
      : torque_(torque), value_(Vector3<Scalar>::Zero()), time_(Scalar(0)) {
    // Before the first step, the size of the derivative, by which norms are chosen.
    derivative_ = torque.statement().curvature * Matrix3<Scalar>::Identity();
  }

  [[nodiscard]] Status begin_step(const Matrix3<Scalar>& attitude, const Vector3<Scalar>& rate, const Scalar& time,
                                  const Scalar& h) noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L) * h;
    const Matrix3<Scalar> turned = attitude * exp(Vector3<Scalar>(half * rate));
    time_ = time + half;
    if (!scalar::all_finite(turned) || !scalar::isfinite(time_)) {
      return Status::step_too_long;
    }
    middle_ = renormalized(turned);
    value_ = torque_.torque(middle_, time_);
    derivative_ = torque_.torque_jacobian(middle_, time_);
    return scalar::all_finite(value_) && scalar::all_finite(derivative_) ? Status::ok : Status::callback_failed;
  }
  [[nodiscard]] Scalar remainder(const Scalar& angle, const Scalar& duration) const noexcept {
    const TorqueStatement<Scalar>& stated = torque_.statement();
    const Scalar size = scalar::sqrt(Scalar(derivative_.squaredNorm()));
    const Scalar clock = rounding::share<Scalar>(rounding::small_sum) * (scalar::abs(time_) + duration);
    return stated.error + stated.rate * (duration + clock) +
           (stated.curvature + angle * size / Scalar(6)) * angle * angle +
           rounding::share<Scalar>(rounding::local_torque) * (scalar::sqrt(Scalar(value_.squaredNorm())) + size);
  }

  [[nodiscard]] Vector3<Scalar> start(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) noexcept {
    axes_[0] = attitude.transpose() * middle_;
    count_ = 1;
    return value_ + derivative_ * turn(axes_[0]);
  }
  [[nodiscard]] Vector3<Scalar> extend(int k, const std::array<Vector3<Scalar>, Terms>& rate) noexcept {
    Matrix3<Scalar> sum = Matrix3<Scalar>::Zero();
    for (std::size_t i = 0; i < static_cast<std::size_t>(k); ++i) {
      sum += hat(rate[i]).lazyProduct(axes_[static_cast<std::size_t>(k - 1) - i]);
    }
    const auto index = static_cast<std::size_t>(k);
    axes_[index] = sum / Scalar(-k);
    count_ = k + 1;
    return derivative_ * turn(axes_[index]);
  }
  [[nodiscard]] Matrix3<Scalar> jacobian(int k) const noexcept {
    return derivative_.lazyProduct(turn_jacobian(axes_[static_cast<std::size_t>(k)]));
  }
  /// Row t of `transform` 𝓜*: t·a has the second order Σ nᵢ·(that of sᵢ), nᵢ = ½ eᵢ × t, and Σ nᵢ sᵢᵀ = −½ S(t) Σ eᵢ
  /// sᵢᵀ.
  void add_curvature(const Scalar& s, const Matrix3<Scalar>& transform,
                     expansion::Forms<Scalar>& forms) const noexcept {
    const Matrix3<Scalar> axes = expansion::value(axes_, count_, s);
    const Matrix3<Scalar> rows = transform.lazyProduct(derivative_);
    for (int i = 0; i < 3; ++i) {
      const Matrix3<Scalar> product =
          scalar::constant<Scalar>(-0.5L) * hat(Vector3<Scalar>(rows.row(i).transpose())).lazyProduct(axes.transpose());
      Matrix3<Scalar>& form = forms[static_cast<std::size_t>(i)];
      form += scalar::constant<Scalar>(0.25L) * (product + product.transpose());
      form.diagonal().array() -= scalar::constant<Scalar>(0.5L) * product.trace();
    }
  }
  void add_cubic(const Scalar& s, const Matrix3<Scalar>& transform, const Matrix3<Scalar>& axes,
                 expansion::CubicForms<Scalar>& forms) const noexcept {
    const Matrix3<Scalar> seen = expansion::value(axes_, count_, s);
    expansion::add_cubic_of_first_degree(Matrix3<Scalar>(derivative_.lazyProduct(turn_jacobian(seen))), transform, axes,
                                         forms);
  }
  /// ‖a‖ ≤ √(3/2) also where the sᵢ are any vectors of length one, or complex ones that have grown.
  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& transform) const noexcept {
    const Matrix3<Scalar> map = transform.lazyProduct(derivative_);
    const Matrix3<Scalar> shape = scalar::constant<Scalar>(1.5L) * map.lazyProduct(map.transpose());
    const Vector3<Scalar> fixed = transform * value_;
    TorqueBounds<Scalar> bounds{norm_of_gram(shape), Scalar(1), Scalar(0), Scalar(0), shape};
    bounds.fixed = scalar::sqrt(Scalar(fixed.squaredNorm()));
    return bounds;
  }

 private:
  /// a of the columns sᵢ.
  [[nodiscard]] static Vector3<Scalar> turn(const Matrix3<Scalar>& axes) noexcept {
    return vee(Matrix3<Scalar>(axes.transpose()));
  }
  /// ∂a/∂ζ = ½ (tr(s) I − s).
  [[nodiscard]] static Matrix3<Scalar> turn_jacobian(const Matrix3<Scalar>& axes) noexcept {
    Matrix3<Scalar> jacobian = scalar::constant<Scalar>(-0.5L) * axes;
    jacobian.diagonal().array() += scalar::constant<Scalar>(0.5L) * axes.trace();
    return jacobian;
  }

  StatedTorque<Scalar, Torque> torque_;
  Matrix3<Scalar> middle_;      // C*
  Vector3<Scalar> value_;       // M*
  Matrix3<Scalar> derivative_;  // 𝓜*
  Scalar time_;
  std::array<Matrix3<Scalar>, Terms> axes_;  // columns sᵢ
  int count_ = 0;
};

}  // namespace elliptude
