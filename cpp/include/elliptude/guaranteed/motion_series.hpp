#pragma once

/// \file
/// The motion of a rigid body over one step as a power series in time, with a bound of how far it is from the exact
/// solution of Euler's equations. (theory, section 17)

#include "elliptude/base/rounding.hpp"
#include "elliptude/guaranteed/torque_expansion.hpp"

namespace elliptude {

/// A torque on the body and a wheel's angular momentum, constant over an interval: J ω' = −ω × (Jω + h_w) + M + u.
template <typename Scalar>
struct BodyInput {
  Vector3<Scalar> control_torque = Vector3<Scalar>::Zero();  ///< u, N m, body axes
  Vector3<Scalar> wheel_momentum = Vector3<Scalar>::Zero();  ///< h_w, N m s, body axes; its change is a control torque
};

/// The uncertainty of a rigid body: unknown torque and inertia error.
template <typename Scalar>
struct BodyUncertainty {
  /// Shape of an ellipsoid about zero, (N m)², body axes, that holds the unknown torque at every time, however it
  /// changes.
  Matrix3<Scalar> torque = Matrix3<Scalar>::Zero();
  /// Largest error of the inertia matrix in the spectral norm, kg m². It affects the gravity gradient too.
  Scalar inertia = Scalar(0);
};

/// ω̂(s) = Σ ω_k sᵏ for 0 ≤ s ≤ h, and the attitude that has exactly this rate. It obeys the equations of motion up to
/// an angular acceleration whose integral over the step is at most `rate_defect`. Rates are known to some ε times the
/// ratio of the largest moment to the least: for a needle with a ratio of 1e5, to 1e-11.
template <typename Scalar, typename Potential>
struct MotionSeries {
  /// Order of ω̂. The truncation error is then that of a method of this order.
  static constexpr int order = 8;
  static constexpr int terms = order + 1;
  using Coefficients = std::array<Vector3<Scalar>, terms>;

  TorqueExpansion<Potential, Scalar, terms> torque;
  BodyInput<Scalar> input;
  Coefficients rate;
  Coefficients momentum;                                   ///< Jω_k to rounding, and the wheel's in the first
  std::array<Scalar, terms> rate_norms;                    ///< ‖ω_k‖
  std::array<Scalar, std::size_t{2} * terms> step_powers;  ///< hᵏ
  RigidBodyState<Scalar> end;
  Scalar largest_rate;    ///< Σ ‖ω_k‖ hᵏ ≥ sup ‖ω̂‖
  Scalar attitude_error;  ///< angle between `end.attitude` and the attitude with rate ω̂, rad
  Scalar rate_defect;     ///< rad/s
  // The products that J⁻¹ is applied to, divided by the least moment: their rounding is not less, though they may
  // cancel.
  Scalar gyroscopic_size;  ///< of ω × and × (Jω + h_w), 1/s
  Scalar stiffness_size;   ///< of the torque, 1/s²

  TorqueBounds<Scalar> torque_bounds;  ///< of M, N m
  TorqueBounds<Scalar> acceleration;   ///< of J⁻¹M, rad/s²

  MotionSeries(const RigidBody<Scalar>& body, const Potential& potential) noexcept
      : torque(potential),
        torque_bounds(torque.bounds(Matrix3<Scalar>::Identity())),
        acceleration(torque.bounds(body.inertia_inverse())) {}
  /// With the bounds at hand.
  MotionSeries(const Potential& potential, const TorqueBounds<Scalar>& bounds_of_torque,
               const TorqueBounds<Scalar>& bounds_of_acceleration) noexcept
      : torque(potential), torque_bounds(bounds_of_torque), acceleration(bounds_of_acceleration) {}

  /// Bound of Σ_{k ≥ first} |a_k| sᵏ over 0 ≤ s ≤ h for an analytic a with |a(z)| ≤ exp(growth (ω̄(|z|) + turn) |z|),
  /// by Cauchy's estimate on the circle of radius κh: exp(…) κ^−first / (1 − 1/κ). Any κ > 1 gives a bound; this one,
  /// found by halving from at most 64 to not less than 2, is near the best. (theory, eq. 17.3)
  [[nodiscard]] Scalar tail(int first, const Scalar& growth, const Scalar& turn, const Scalar& h) const noexcept {
    const Scalar speed = growth * (largest_rate + turn) * h;
    const Scalar least(2);
    const Scalar most(64);
    const Scalar order_of_tail = Scalar(static_cast<scalar::Value<Scalar>>(first));
    Scalar kappa = order_of_tail / speed;  // of speed zero: infinite, and then `most`
    kappa = kappa < most ? kappa : most;
    kappa = kappa > least ? kappa : least;
    Scalar exponent(0);
    constexpr int most_halvings = 5;  // from 64 to 2
    for (int halving = 0; halving <= most_halvings; ++halving) {
      const Scalar radius = kappa * h;
      Scalar largest = rate_norms[order];
      for (int k = order - 1; k >= 0; --k) {
        largest = rate_norms[static_cast<std::size_t>(k)] + radius * largest;
      }
      exponent = growth * (largest + turn) * radius;
      // Where the polynomial ω̂ grows fast the best circle is smaller.
      if (exponent <= order_of_tail || !(kappa > least)) {
        break;
      }
      kappa *= scalar::constant<Scalar>(0.5L);
      kappa = kappa > least ? kappa : least;
    }
    Scalar power(1);
    for (int k = 0; k < first; ++k) {
      power *= kappa;
    }
    return scalar::exp(exponent) / (power * (Scalar(1) - Scalar(1) / kappa));
  }

  /// The series from `state` at `time` over a step h > 0.
  /// \return `not_finite` of the state; `callback_failed` if a torque is not finite; `step_too_long` if the series says
  /// nothing at this step, or its terms overflow.
  [[nodiscard]] Status expand(const RigidBody<Scalar>& body, const Scalar& time, const Scalar& h,
                              const BodyInput<Scalar>& body_input, const RigidBodyState<Scalar>& state) noexcept {
    input = body_input;
    rate[0] = state.angular_velocity;
    momentum[0] = body.inertia() * rate[0] + input.wheel_momentum;
    if (!scalar::all_finite(state.attitude) || !scalar::all_finite(rate[0])) {
      return Status::not_finite;
    }
    if constexpr (is_local<TorqueExpansion<Potential, Scalar, terms>>) {
      if (const Status status = torque.begin_step(state.attitude, rate[0], time, h); status != Status::ok) {
        return status;
      }
      torque_bounds = torque.bounds(Matrix3<Scalar>::Identity());
      acceleration = torque.bounds(body.inertia_inverse());
    }
    const Vector3<Scalar> first_torque = torque.start(state.attitude, time);
    if (!scalar::all_finite(first_torque)) {
      return Status::callback_failed;
    }
    Vector3<Scalar> torque_coefficient = first_torque + input.control_torque;
    for (int k = 1; k <= order; ++k) {
      const auto index = static_cast<std::size_t>(k);
      const Vector3<Scalar> change =
          (torque_coefficient - expansion::cross_coefficient(k - 1, rate, momentum)) / Scalar(k);
      rate[index] = body.inertia_inverse() * change;
      // From the rate, not the change itself: what J⁻¹ has lost of it would come back multiplied by the ratio of the
      // moments.
      momentum[index] = body.inertia() * rate[index];
      if (k < order) {
        torque_coefficient = torque.extend(k, rate);
      }
    }
    step_powers[0] = Scalar(1);
    for (std::size_t k = 1; k < step_powers.size(); ++k) {
      step_powers[k] = h * step_powers[k - 1];
    }
    largest_rate = Scalar(0);
    for (std::size_t k = 0; k < terms; ++k) {
      rate_norms[k] = scalar::sqrt(Scalar(rate[k].squaredNorm()));
      largest_rate += rate_norms[k] * step_powers[k];
    }
    if (!scalar::isfinite(largest_rate)) {
      return Status::step_too_long;
    }
    bound_defect(body, time, h);
    return turn(h, state);
  }

 private:
  /// The coefficients of ω̂' + J⁻¹ (ω̂ × (Jω̂ + h_w) − M − u) vanish up to order − 1; the rest, integrated over the
  /// step, and the rounding of all. (theory, section 17.2)
  void bound_defect(const RigidBody<Scalar>& body, const Scalar& time, const Scalar& h) noexcept {
    Scalar sum(0);
    Scalar momentum_sum(0);  // Σ ‖(Jω + h_w)_j‖ hʲ over j ≥ order − i
    for (std::size_t i = 0; i < terms; ++i) {
      const std::size_t j = order - i;
      momentum_sum += scalar::sqrt(Scalar(momentum[j].squaredNorm())) * step_powers[j];
      sum += rate_norms[i] * step_powers[i] * momentum_sum;
    }
    const Scalar least = body.least_moment();
    const Scalar greatest = body.greatest_moment();
    sum /= least;
    if (acceleration.largest > Scalar(0)) {
      sum += acceleration.largest * tail(order, acceleration.degree, acceleration.turn_rate, h);
    }
    // Every term of it grows with the power `order` of time or a higher one.
    rate_defect = sum * h / Scalar(order + 1);

    const Scalar angle = Scalar(1) + scalar::abs(Scalar(acceleration.turn_rate * time));
    // Not ‖momentum[0]‖: a wheel can cancel the body's momentum, but not the rounding of either.
    const Scalar wheel = scalar::sqrt(Scalar(input.wheel_momentum.squaredNorm()));
    gyroscopic_size = (greatest * largest_rate + wheel) / least;
    // Not the torque's bound alone: that of a nearly spherical body is small, but not the products that it is made of.
    stiffness_size =
        (torque_bounds.largest + torque_bounds.fixed + torque_bounds.products + torque_bounds.by_inertia * greatest) *
        angle / least;
    const Scalar control = scalar::sqrt(Scalar(input.control_torque.squaredNorm())) / least;
    const Scalar change = largest_rate - rate_norms[0];  // Σ ‖ω_k‖ hᵏ over k ≥ 1
    rate_defect += rounding::share<Scalar>(rounding::series_rate) * largest_rate +
                   rounding::share<Scalar>(rounding::series_change) *
                       (change * greatest / least + (largest_rate * gyroscopic_size + stiffness_size + control) * h);
  }

  /// The end of the step: the rate, and the attitude by the quaternion's series q' = ½ q ⊗ ω̂.
  [[nodiscard]] Status turn(const Scalar& h, const RigidBodyState<Scalar>& state) noexcept {
    // Quaternions with the real part last; q ⊗ ω is linear in ω, with the columns q ⊗ eⱼ.
    std::array<Vector<Scalar, 4>, terms + 1> q;
    std::array<Matrix<Scalar, 4, 3>, terms> by_rate;
    q[0] = Vector<Scalar, 4>(Scalar(0), Scalar(0), Scalar(0), Scalar(1));
    for (std::size_t k = 0; k < terms; ++k) {
      const Vector<Scalar, 4>& p = q[k];
      by_rate[k].col(0) = Vector<Scalar, 4>(p(3), p(2), -p(1), -p(0));
      by_rate[k].col(1) = Vector<Scalar, 4>(-p(2), p(3), p(0), -p(1));
      by_rate[k].col(2) = Vector<Scalar, 4>(p(1), -p(0), p(3), -p(2));
      Vector<Scalar, 4> sum = by_rate[0].lazyProduct(rate[k]);
      for (std::size_t i = 1; i <= k; ++i) {
        sum += by_rate[i].lazyProduct(rate[k - i]);
      }
      q[k + 1] = (scalar::constant<Scalar>(0.5L) / Scalar(static_cast<scalar::Value<Scalar>>(k + 1))) * sum;
    }
    Vector<Scalar, 4> whole = q[terms];
    for (std::size_t k = terms; k-- > 0;) {
      whole = q[k] + h * whole;
    }
    // A quaternion that errs by t is, made a unit, in error by at most 2t, and the angle by twice that and a little.
    const Scalar rest = tail(terms + 1, scalar::constant<Scalar>(0.5L), Scalar(0), h);
    attitude_error = scalar::constant<Scalar>(4.5L) * rest + rounding::share<Scalar>(rounding::series_attitude);
    if (!(attitude_error < scalar::constant<Scalar>(0.001L))) {
      return Status::step_too_long;
    }
    whole /= scalar::sqrt(Scalar(whole.squaredNorm()));
    end.attitude = renormalized(Matrix3<Scalar>(
        state.attitude * to_rotation(Quaternion<Scalar>{whole(3), Vector3<Scalar>(whole.template head<3>())})));
    end.angular_velocity = expansion::value(rate, terms, h);
    return Status::ok;
  }
};

}  // namespace elliptude
