#pragma once

/// \file
/// The guaranteed flow of a body of which nothing is known but what its gyro says: the set that it predicts holds the
/// state of the continuous motion (theory, section 17.6). The errors are y = [γ; δβ] in the Gibbs chart. What a
/// guaranteed flow is: guaranteed/body_flow.hpp.

#include <cstdint>

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/guaranteed/detail/prediction_sums.hpp"
#include "elliptude/sets/sum.hpp"

namespace elliptude {

/// Bounds of a gyro's errors and of the motion between its samples. A sample is ω̃ = ω + β + v.
template <typename Scalar>
struct GyroUncertainty {
  Matrix3<Scalar> noise = Matrix3<Scalar>::Zero();  ///< shape of the ellipsoid of v, (rad/s)²
  Matrix3<Scalar> drift = Matrix3<Scalar>::Zero();  ///< shape of the ellipsoid of dβ/dt at every time, (rad/s²)²
  /// Largest relative error: v may be larger by this times ‖ω̃‖ of the rate that is given for an interval. Of a mean
  /// that is right for an error which is one linear map of the rate throughout the interval.
  Scalar scale = Scalar(0);
  Scalar angular_acceleration = Scalar(0);  ///< largest ‖dω/dt‖, rad/s²: how ω may move between samples
  /// The longest interval, s, that a rate and all of the above cover; negative for any. About a longer one, such as
  /// after lost samples, only the next number is known.
  Scalar longest_interval = Scalar(-1);
  Scalar largest_rate = Scalar(-1);  ///< largest ‖ω‖ at any time, rad/s; negative if unknown
};

/// A body about which only its gyro says something, at every time between its samples. One that `make` has not made has
/// no rate for any interval, and no bound of the drift: `unbounded`, and of the bias `beyond_domain`.
template <typename Scalar>
class GuaranteedGyroFlow {
 public:
  using State = GyroState<Scalar>;
  /// Which rate of an interval the input of the flow is.
  enum class IntervalRate : std::uint8_t {
    first_sample,  ///< that at its beginning
    mean_of_ends,  ///< the mean of those at both ends
    mean,          ///< its mean over the interval, from a gyro that integrates
    last_sample,   ///< that at its end: also what a rate of the beginning is backward in time
  };
  struct Input {
    /// ω̃, rad/s, body axes, as measured, for the interval. One that was not set is no number, and is refused.
    Vector3<Scalar> angular_velocity = Vector3<Scalar>::Constant(scalar::not_a_number<Scalar>());
    /// Bound of the angle that the errors v of the samples make together over this interval, rad, if it is better than
    /// the duration times the noise; negative for none.
    Scalar increment = Scalar(-1);
    bool is_measured = true;  ///< false: there is no rate for this interval, as if it were longer than the longest
  };

  /// \return `not_finite`, `out_of_range` of a negative scale error or angular acceleration, and of what is no
  /// `IntervalRate`; `not_symmetric`, `not_positive_definite`.
  [[nodiscard]] static ELLIPTUDE_SELDOM Status make(const GyroUncertainty<Scalar>& uncertainty,
                                                    IntervalRate interval_rate, GuaranteedGyroFlow& flow) noexcept {
    if (!scalar::isfinite(uncertainty.scale) || !scalar::isfinite(uncertainty.angular_acceleration) ||
        !scalar::isfinite(uncertainty.longest_interval) || !scalar::isfinite(uncertainty.largest_rate)) {
      return Status::not_finite;
    }
    if (!(uncertainty.scale >= Scalar(0)) || !(uncertainty.angular_acceleration >= Scalar(0)) ||
        interval_rate > IntervalRate::last_sample) {
      return Status::out_of_range;
    }
    for (const Matrix3<Scalar>* shape : {&uncertainty.noise, &uncertainty.drift}) {
      if (const Status status = validate(Ellipsoid<Scalar, 3>{Vector3<Scalar>::Zero(), *shape}); status != Status::ok) {
        return status;
      }
    }
    flow.uncertainty_ = uncertainty;
    flow.uncertainty_.noise = symmetrized(uncertainty.noise);
    flow.uncertainty_.drift = symmetrized(uncertainty.drift);
    flow.interval_rate_ = interval_rate;
    return Status::ok;
  }

  [[nodiscard]] const GyroUncertainty<Scalar>& uncertainty() const noexcept { return uncertainty_; }
  [[nodiscard]] IntervalRate interval_rate() const noexcept { return interval_rate_; }

  /// With ω̂ = ω̃ − β̂ and F = exp(S(hω̂)) the linear part is γ⁺ = Fᵀγ − h J_r(hω̂) δβ (theory, section 17.6).
  /// \return `not_finite`; `not_positive_definite` of a flat set; `out_of_range` of a negative duration; `unbounded` if
  /// the set may reach half turns within the interval.
  [[nodiscard]] Status predict(const Scalar& time, const Scalar& duration, const Input& input,
                               const GibbsEllipsoid<State>& ellipsoid, GibbsEllipsoid<State>& result) const noexcept {
    if (!scalar::isfinite(time) || !scalar::isfinite(duration) ||
        (input.is_measured && (!scalar::all_finite(input.angular_velocity) || !scalar::isfinite(input.increment))) ||
        !is_finite(ellipsoid.center)) {
      return Status::not_finite;
    }
    if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (duration == Scalar(0)) {
      result = ellipsoid;
      return Status::ok;
    }
    return speaks_of(duration, input) ? predict_measured(duration, input, ellipsoid, result)
                                      : predict_unmeasured(duration, ellipsoid, result);
  }

  /// Over an interval in which the body turned by `turn`, and before, after or within that by a turn of at most `angle`
  /// about any axis: what rates add up to, and how far that may be off. The bias has drifted. (theory, section 18.6)
  /// \param turn rotation vector in the body axes at the beginning, rad.
  /// \param angle rad; anything from π on says nothing of the attitude.
  /// \return `not_finite`, but an infinite angle is none; `out_of_range` of a negative duration or angle;
  /// `not_positive_definite` of a flat set; `unbounded` if the set may reach half turns.
  [[nodiscard]] Status predict_turn(const Scalar& duration, const Vector3<Scalar>& turn, const Scalar& angle,
                                    const GibbsEllipsoid<State>& ellipsoid,
                                    GibbsEllipsoid<State>& result) const noexcept {
    if (!scalar::isfinite(duration) || !scalar::all_finite(turn) || !(angle == angle) || !is_finite(ellipsoid.center)) {
      return Status::not_finite;
    }
    if (!(duration >= Scalar(0)) || !(angle >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (!is_made()) {
      return Status::unbounded;
    }
    const Matrix3<Scalar> f = exp(turn);
    // What F and the center are off by rounding is one more turn of the body, and a little of the errors themselves
    // (theory, section 17.8).
    const Scalar slip = rounding::share<Scalar>(rounding::turn) +
                        rounding::share<Scalar>(rounding::turn_by_angle) * scalar::sqrt(Scalar(turn.squaredNorm()));
    const GibbsEllipsoid<State> turned{
        {renormalized(Matrix3<Scalar>(ellipsoid.center.attitude * f)), ellipsoid.center.gyro_bias},
        covered_congruence<Scalar>(Matrix3<Scalar>(f.transpose()), ellipsoid.shape)};
    return predict_any_turn(duration, Scalar(angle + slip), slip, turned, result);
  }

  /// Predicts the attitude alone, for a bias that may be anywhere in its bound at every time: its effect on the rate is
  /// bounded like the noise, and nothing is said about the bias afterwards. (theory, section 16.7)
  /// \param ellipsoid whose attitude counts; its vector is taken to be `bias`.
  /// \return the status of `predict`.
  [[nodiscard]] Status predict_attitude(const Scalar& time, const Scalar& duration, const Input& input,
                                        const Ellipsoid<Scalar, 3>& bias, const GibbsEllipsoid<State>& ellipsoid,
                                        GibbsEllipsoid<State>& result) const noexcept {
    GuaranteedGyroFlow flow = *this;
    flow.uncertainty_.drift.setZero();
    flow.uncertainty_.noise = sum_of_shapes(uncertainty_.noise, bias.shape);
    flow.uncertainty_.noise.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::sum);
    Input given = input;
    if (given.increment >= Scalar(0)) {  // which is of the noise, and stands in its place
      given.increment += rounding::enlarged(Scalar(duration * detail::tube::radius(bias.shape)), rounding::product);
    }
    GibbsEllipsoid<State> predicted;
    if (const Status status = flow.predict(time, duration, given, with_next_to_no_bias(bias, ellipsoid), predicted);
        status != Status::ok) {
      return status;
    }
    result = with_bias(bias, predicted);
    return Status::ok;
  }

  /// The attitude alone over a turn, as `predict_attitude`.
  /// \return the status of `predict_turn`.
  [[nodiscard]] Status predict_attitude_turn(const Scalar& duration, const Vector3<Scalar>& turn, const Scalar& angle,
                                             const Ellipsoid<Scalar, 3>& bias, const GibbsEllipsoid<State>& ellipsoid,
                                             GibbsEllipsoid<State>& result) const noexcept {
    GuaranteedGyroFlow flow = *this;
    flow.uncertainty_.drift.setZero();
    GibbsEllipsoid<State> predicted;
    if (const Status status =
            flow.predict_turn(duration, turn, angle, with_next_to_no_bias(bias, ellipsoid), predicted);
        status != Status::ok) {
      return status;
    }
    result = with_bias(bias, predicted);
    return Status::ok;
  }

  /// The bias without the attitude: it drifts.
  /// \return `not_finite`; `out_of_range` of a negative duration; `not_positive_definite`; `beyond_domain` if it drifts
  /// beyond all numbers.
  [[nodiscard]] Status predict_vector(const Scalar& time, const Scalar& duration, const Input& /*input*/,
                                      const Ellipsoid<Scalar, 3>& ellipsoid,
                                      Ellipsoid<Scalar, 3>& result) const noexcept {
    if (!scalar::isfinite(time) || !scalar::isfinite(duration) || !scalar::all_finite(ellipsoid.center)) {
      return Status::not_finite;
    }
    if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (!is_made() && duration > Scalar(0)) {
      return Status::beyond_domain;
    }
    Matrix3<Scalar> sum = ellipsoid.shape;
    if (duration > Scalar(0) && !uncertainty_.drift.isZero(Scalar(0))) {
      const std::array<Matrix3<Scalar>, 1> others{Matrix3<Scalar>((duration * duration) * uncertainty_.drift)};
      if (const Status status = detail::tube::sum<Scalar, 3, 1>(ellipsoid.shape, others, sum); status != Status::ok) {
        return status;
      }
    }
    if (!scalar::all_finite(sum)) {
      return Status::beyond_domain;
    }
    result.center = ellipsoid.center;
    result.shape = sum;
    return Status::ok;
  }

 private:
  /// Whether anything except `largest_rate` is known about an interval.
  [[nodiscard]] bool speaks_of(const Scalar& duration, const Input& input) const noexcept {
    const Scalar& longest = uncertainty_.longest_interval;
    return input.is_measured && (longest < Scalar(0) || duration <= longest);
  }

  /// Over an interval whose rate was measured.
  /// \return as `predict`.
  [[nodiscard]] Status predict_measured(const Scalar& h, const Input& input, const GibbsEllipsoid<State>& ellipsoid,
                                        GibbsEllipsoid<State>& result) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Vector3<Scalar> rate = input.angular_velocity - ellipsoid.center.gyro_bias;
    const Scalar speed = scalar::sqrt(Scalar(rate.squaredNorm()));
    const Vector3<Scalar> turn = h * rate;
    const Matrix3<Scalar> f = exp(turn);
    const Matrix3<Scalar> by_bias = -h * right_jacobian(turn);
    const Matrix6<Scalar> shape = covered_congruence<Scalar>(f.transpose(), by_bias, ellipsoid.shape);

    // How far the rate may be from ω̃ − β at any time of the interval, and how far its integral.
    const Scalar scale = uncertainty_.scale * scalar::sqrt(Scalar(input.angular_velocity.squaredNorm()));
    const Scalar acceleration = uncertainty_.angular_acceleration;
    const bool is_sample = interval_rate_ == IntervalRate::first_sample || interval_rate_ == IntervalRate::last_sample;
    const bool is_mean = interval_rate_ == IntervalRate::mean;
    const Scalar wander = (is_sample ? Scalar(1) : half) * Scalar(acceleration * h);
    const Scalar wander_angle = is_mean ? Scalar(0) : Scalar(half * wander * h);
    const Scalar noise = detail::tube::radius(uncertainty_.noise) + scale;
    const Scalar drift = detail::tube::radius(uncertainty_.drift);
    const Scalar drifted = drifted_by_sample();
    const Scalar difference =
        detail::tube::radius(Matrix3<Scalar>(ellipsoid.shape.template bottomRightCorner<3, 3>())) +
        drifted * h * drift + noise + wander;  // ≥ ‖δω‖
    const Scalar before = detail::tube::radius(Matrix3<Scalar>(ellipsoid.shape.template topLeftCorner<3, 3>()));
    // ‖γ‖' ≤ ‖δω‖ (1 + ‖γ‖²/4): by at most ½ h ‖δω‖ in atan(‖γ‖/2).
    const Scalar angle = scalar::atan2(Scalar(half * before), Scalar(1)) + half * h * difference;
    if (!(angle < scalar::constant<Scalar>(1.5L))) {
      return Status::unbounded;
    }
    const Scalar reach = Scalar(2) * scalar::sin(angle) / scalar::cos(angle);
    const Scalar nonlinear = h * reach * difference * (reach > Scalar(2) ? Scalar(half * half * reach) : half);

    // All that has no direction is one ball. An error of the rate acts through a turn by at most hω̂ about its middle.
    Scalar ball = nonlinear + wander_angle + half * half * h * h * speed * (noise + wander);
    if (is_mean) {
      ball += half * half * h * h * drift;
    }
    // What F, J_r and the center are off by rounding: a turn of the center by a moves γ by at most
    // 2 tan(a/2) (1 + ‖γ/2‖²)/(1 − ‖γ/2‖ tan(a/2)) (theory, section 17.8).
    const Scalar slip =
        rounding::share<Scalar>(rounding::turn) + rounding::share<Scalar>(rounding::turn_by_angle) * (h * speed);
    if (!(slip * (Scalar(1) + reach) < scalar::constant<Scalar>(0.01L))) {
      return Status::unbounded;
    }
    ball +=
        slip * (before + h * difference + scalar::constant<Scalar>(1.01L) * (Scalar(1) + half * half * reach * reach));
    std::array<Matrix6<Scalar>, 3> others;
    others[0].setZero();
    others[1].setZero();
    if (input.increment >= Scalar(0)) {
      ball += input.increment;
    } else {
      ball += h * scale;
      others[0].template topLeftCorner<3, 3>() = turned_by_noise(h, turn);
    }
    // The bias at the end has moved by r in h E(0, drift); the rate that is given is of a bias that had moved by its
    // share of r.
    if (drift > Scalar(0)) {
      Matrix6<Scalar> moved = Matrix6<Scalar>::Zero();
      moved.template bottomRightCorner<3, 3>() = (h * h) * uncertainty_.drift;
      others[1] = covered_congruence<Scalar>(Matrix3<Scalar>::Zero(), Matrix3<Scalar>(drifted * by_bias), moved);
    }
    others[2] = detail::tube::attitude_ball(rounding::enlarged(ball, rounding::bound));
    return with_added({renormalized(Matrix3<Scalar>(ellipsoid.center.attitude * f)), ellipsoid.center.gyro_bias}, shape,
                      others, result);
  }

  /// How much of the bias's drift over an interval the rate has seen that is given for it, as a share.
  [[nodiscard]] Scalar drifted_by_sample() const noexcept {
    switch (interval_rate_) {
      case IntervalRate::first_sample:
        return Scalar(0);
      case IntervalRate::last_sample:
        return Scalar(1);
      case IntervalRate::mean_of_ends:
      case IntervalRate::mean:
        break;
    }
    return scalar::constant<Scalar>(0.5L);
  }

  /// What the noise turns the attitude by, as if all at the middle of the interval.
  [[nodiscard]] Matrix3<Scalar> turned_by_noise(const Scalar& h, const Vector3<Scalar>& turn) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Matrix3<Scalar> middle = exp(Vector3<Scalar>(half * turn));
    const Matrix3<Scalar> turned = congruence(Matrix3<Scalar>(middle.transpose()), uncertainty_.noise);
    Matrix3<Scalar> shape = (half * h * h) * (turned + turned.transpose());
    shape.diagonal().array() += rounding::share<Scalar>(rounding::sum) * (h * h) * uncertainty_.noise.trace();
    return shape;
  }

  /// The set of a shape and what is added to it.
  /// \return `not_positive_definite` of a flat set; `unbounded` if the sum overflows.
  template <std::size_t Count>
  [[nodiscard]] static Status with_added(const State& center, const Matrix6<Scalar>& shape,
                                         const std::array<Matrix6<Scalar>, Count>& others,
                                         GibbsEllipsoid<State>& result) noexcept {
    Matrix6<Scalar> sum;
    if (const Status status = detail::tube::sum<Scalar, 6, Count>(shape, others, sum); status != Status::ok) {
      return status;
    }
    if (!scalar::all_finite(sum)) {
      return Status::unbounded;
    }
    result.center = center;
    result.shape = sum;
    return Status::ok;
  }

  /// A set's attitude beside a bias that is as good as known, as a set is not flat.
  [[nodiscard]] static GibbsEllipsoid<State> with_next_to_no_bias(const Ellipsoid<Scalar, 3>& bias,
                                                                  const GibbsEllipsoid<State>& ellipsoid) noexcept {
    GibbsEllipsoid<State> set{{ellipsoid.center.attitude, bias.center}, Matrix6<Scalar>::Zero()};
    set.shape.template topLeftCorner<3, 3>() = ellipsoid.shape.template topLeftCorner<3, 3>();
    set.shape.diagonal().template tail<3>().setConstant(rounding::square<Scalar>());
    return set;
  }

  /// A set's attitude beside a bias that is in its bound.
  [[nodiscard]] static GibbsEllipsoid<State> with_bias(const Ellipsoid<Scalar, 3>& bias,
                                                       const GibbsEllipsoid<State>& ellipsoid) noexcept {
    GibbsEllipsoid<State> set = ellipsoid;
    set.shape.template bottomLeftCorner<3, 3>().setZero();
    set.shape.template topRightCorner<3, 3>().setZero();
    set.shape.template bottomRightCorner<3, 3>() = bias.shape;
    return set;
  }

  /// Over an interval about which it is only known that the body turns by no more than an angle.
  /// \return the status of `predict_any_turn`; `unbounded` if no such angle is known.
  [[nodiscard]] Status predict_unmeasured(const Scalar& duration, const GibbsEllipsoid<State>& ellipsoid,
                                          GibbsEllipsoid<State>& result) const noexcept {
    if (!(uncertainty_.largest_rate >= Scalar(0))) {
      return Status::unbounded;
    }
    return predict_any_turn(duration, Scalar(uncertainty_.largest_rate * duration), Scalar(0), ellipsoid, result);
  }

  /// Over a turn about any axis by no more than an angle: the center stays, and the errors move by at most what (17.10)
  /// says. (theory, section 17.6)
  /// \param slip what each error is off by besides, of itself.
  /// \return `not_positive_definite` of a flat set; `unbounded` if the set may reach half turns.
  [[nodiscard]] Status predict_any_turn(const Scalar& duration, const Scalar& angle, const Scalar& slip,
                                        const GibbsEllipsoid<State>& ellipsoid,
                                        GibbsEllipsoid<State>& result) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar before = detail::tube::radius(Matrix3<Scalar>(ellipsoid.shape.template topLeftCorner<3, 3>()));
    const Scalar half_angle = scalar::atan2(Scalar(half * before), Scalar(1));
    const Scalar half_turn = half * angle;
    if (!(half_angle + half_turn < scalar::constant<Scalar>(1.5L))) {
      return Status::unbounded;
    }
    // The cosines lose no more than 1.5/(sin 1.5 cos 1.5) = 22 times what their arguments do.
    const Scalar moved =
        Scalar(2) * scalar::sin(half_turn) / (scalar::cos(half_angle) * scalar::cos(Scalar(half_angle + half_turn)));
    std::array<Matrix6<Scalar>, 2> others;
    others[0] = detail::tube::attitude_ball(rounding::enlarged(Scalar(moved + slip * before), rounding::bound));
    others[1].setZero();
    others[1].template bottomRightCorner<3, 3>() = (duration * duration) * uncertainty_.drift;
    return with_added(ellipsoid.center, ellipsoid.shape, others, result);
  }

  [[nodiscard]] bool is_made() const noexcept { return uncertainty_.scale >= Scalar(0); }

  /// No interval is covered, and no rate is known. By the scale error it is none that `make` takes.
  [[nodiscard]] static GyroUncertainty<Scalar> unmade() noexcept {
    GyroUncertainty<Scalar> uncertainty;
    uncertainty.scale = Scalar(-1);
    uncertainty.longest_interval = Scalar(0);
    return uncertainty;
  }

  GyroUncertainty<Scalar> uncertainty_ = unmade();
  IntervalRate interval_rate_ = IntervalRate::first_sample;
};

}  // namespace elliptude
