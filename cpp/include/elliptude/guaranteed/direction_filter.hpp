#pragma once

/// \file
/// A filter that follows one direction alone, such as the vertical, as seen from the body: what is known of tilt needs
/// no heading. (theory, section 18.9)

#include "elliptude/attitude/direction_cap.hpp"
#include "elliptude/guaranteed/policy.hpp"
#include "elliptude/guaranteed/recovery.hpp"

namespace elliptude {

/// What an update of a `DirectionFilter` did.
struct DirectionUpdate {
  Claim claim = Claim::none;
  bool prediction_used = false;  ///< whether the prediction made the cap smaller than the measurement alone
  bool contradicts = false;      ///< whether the measurement and the prediction had no common direction
  bool dropped = false;          ///< whether the measurement was left out
};

/// Holds a direction that does not move in reference axes, in the body axes of a turning body: in a cap of the sphere,
/// which contains it if all bounds that the filter was told hold. A turn of the body with an error of at most φ makes
/// the cap's angle larger by φ, whatever else is known of the attitude. A function that does not return `ok` has
/// changed nothing. One that `make` has not made knows nothing, and has the settings that `Settings` begins with.
template <typename Scalar_>
class DirectionFilter {
 public:
  using Scalar = Scalar_;

  struct Settings {
    Policy policy = default_policy;
    /// As for `GuaranteedFilter`: after a contradiction the cap is taken from a measurement alone as soon as this many
    /// have agreed, or this many updates have passed. (theory, section 16.8)
    int regain_after = 10;
  };

  /// A filter that knows nothing.
  /// \return `out_of_range` of `Policy::relaxed`, which needs several measurements at once, of what is no policy, of one that
  /// is not compiled, and of a `regain_after` below one.
  [[nodiscard]] static Status make(const Settings& settings, DirectionFilter& filter) noexcept {
    if (!is_compiled(settings.policy) || settings.policy >= Policy::relaxed || settings.regain_after < 1) {
      return Status::out_of_range;
    }
    filter.settings_ = settings;
    filter.forget();
    return Status::ok;
  }

  /// Forgets the direction, and what was dropped.
  void forget() noexcept {
    cap_ = {};
    trust_.forget();
  }

  [[nodiscard]] const Settings& settings() const noexcept { return settings_; }
  /// Where the direction is, in body axes; with an angle of π anywhere.
  [[nodiscard]] const DirectionCap<Scalar>& cap() const noexcept { return cap_; }
  [[nodiscard]] bool knows_direction() const noexcept { return cap_.angle < scalar::pi<Scalar>(); }
  [[nodiscard]] Claim claim() const noexcept {
    return !knows_direction() ? Claim::none : trust_.rests_on_drops() ? Claim::conditional : Claim::unconditional;
  }

  /// The body has turned.
  /// \param turn rotation vector in body axes, rad.
  /// \param angle of the turn that is added to it, rad; anything from π on forgets the direction.
  /// \return `not_finite`, but an infinite angle is none; `out_of_range` of a negative angle.
  [[nodiscard]] Status predict_turn(const Vector3<Scalar>& turn, const Scalar& angle) noexcept {
    if (!scalar::all_finite(turn) || !(angle == angle)) {
      return Status::not_finite;
    }
    if (!(angle >= Scalar(0))) {
      return Status::out_of_range;
    }
    const Scalar slip = rounding::share<Scalar>(rounding::turn) +
                        rounding::share<Scalar>(rounding::turn_by_angle) * scalar::length(turn);
    const DirectionCap<Scalar> next = turned(cap_, exp(turn), Scalar(angle + slip));
    if (next.angle < scalar::pi<Scalar>()) {
      cap_ = next;
    } else {
      forget();
    }
    return Status::ok;
  }

  /// The direction was measured. An angle from π on says nothing, and counts for nothing.
  /// \param update also after `empty_intersection`; as it was after what `validate` refuses.
  /// \return the status of `validate`; `empty_intersection` under `Policy::raise`.
  [[nodiscard]] Status update(const DirectionCap<Scalar>& measured, DirectionUpdate& update) noexcept {
    if (const Status status = validate(measured); status != Status::ok) {
      return status;
    }
    DirectionUpdate result;
    if (!(measured.angle < scalar::pi<Scalar>())) {  // which measures nothing, and agrees with nothing
      result.claim = claim();
      result.prediction_used = knows_direction();
      update = result;
      return Status::ok;
    }
    const DirectionCap<Scalar> seen = normalized(measured);
    DirectionCap<Scalar> next = seen;
    if (knows_direction()) {
      result.contradicts = intersection(cap_, seen, next) != Status::ok;
      if (result.contradicts && is_policy(settings_.policy, Policy::raise)) {
        result.claim = claim();
        update = result;
        return Status::empty_intersection;
      }
      result.dropped = result.contradicts && is_policy(settings_.policy, Policy::drop_measurement);
      if (result.contradicts) {
        next = result.dropped ? cap_ : seen;
      }
      result.prediction_used = result.dropped || next.angle < seen.angle;
    }
    trust_.count(result.contradicts, true);
    if (trust_.past_is_due(settings_.regain_after)) {
      trust_.give_up_past(settings_.regain_after);
      next = seen;
      result.dropped = false;
      result.prediction_used = false;
    }
    cap_ = next;
    result.claim = claim();
    update = result;
    return Status::ok;
  }

 private:
  Settings settings_;
  DirectionCap<Scalar> cap_;  // all directions
  Trust trust_;
};

}  // namespace elliptude
