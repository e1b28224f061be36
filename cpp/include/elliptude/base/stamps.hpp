#pragma once

/// \file
/// Time stamps as whole nanoseconds, for programs that run for long or calculate in `float`: seconds since a start lose
/// a millisecond in `float` after 10,000 s, and a nanosecond in `double` after three months. (docs/flight.md)

#include <cstdint>

#include "elliptude/base/scalar.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude {

/// The seconds from one stamp (ns) to another, negative to an earlier one: for any two stamps right to ε of themselves,
/// and the nearest number if the difference is known exactly as a `Scalar`, as it is up to 16.7 ms in `float` and 104
/// days in `double`.
template <typename Scalar>
[[nodiscard]] Scalar seconds_between(std::int64_t from, std::int64_t to) noexcept {
  using Value = scalar::Value<Scalar>;
  const bool is_later = from <= to;
  const auto earlier = static_cast<std::uint64_t>(is_later ? from : to);
  const auto later = static_cast<std::uint64_t>(is_later ? to : from);
  const std::uint64_t difference = later - earlier;  // modulo 2⁶⁴, in which that of any two stamps fits
  const Scalar seconds = Scalar(static_cast<Value>(difference)) / Scalar(static_cast<Value>(1000000000));
  return is_later ? seconds : Scalar(-seconds);
}

/// A filter that is predicted to stamps: `GuaranteedFilter` or `AttitudeFilter`. The interval of a prediction is the
/// difference of two stamps, right to ε of itself however long after the start: a guaranteed set covers that
/// (theory, section 17.8). For a free body and a gyro nothing else counts, so that sets have the same bits at all
/// times.
///
/// A potential that depends on time sees the seconds since the epoch, right to ε of themselves: in `float` to 0.01 s
/// after a day. A guaranteed set covers that, too, as it does the rounding of the potential's angle, and grows with it:
/// as by an unknown torque of 64 ε n t of the gravity gradient's at the orbital rate n, in `float` of 1 % of it after
/// 200 orbits. A set of first order does not.
///
/// The stamps are taken at their word: what the clock is off by, its last nanosecond included, is an error of the
/// measurements. Python has no such filter, as its numbers are `double`.
template <typename Filter>
class StampedFilter {
 public:
  using Scalar = typename Filter::Scalar;
  using Input = typename Filter::Input;

  /// A filter that was not made, at stamp zero.
  StampedFilter() = default;
  /// \param filter with the time `seconds_between<Scalar>(epoch, stamp)`; one with another time is not predicted.
  /// \param epoch the stamp of time zero, ns.
  /// \param stamp that of the filter, ns, later than the epoch or earlier.
  StampedFilter(const Filter& filter, std::int64_t epoch, std::int64_t stamp) noexcept
      : filter_(filter), epoch_(epoch), stamp_(stamp) {}

  /// To update it, and to ask. What moves it in time are the functions below.
  [[nodiscard]] Filter& filter() noexcept { return filter_; }
  [[nodiscard]] const Filter& filter() const noexcept { return filter_; }
  /// That of the last prediction, ns.
  [[nodiscard]] std::int64_t stamp() const noexcept { return stamp_; }
  /// That of time zero, ns.
  [[nodiscard]] std::int64_t epoch() const noexcept { return epoch_; }

  /// Moves the filter to a later stamp, ns.
  /// \return the status of the filter's `predict`, which is `out_of_range` of an earlier stamp; the same of a filter
  /// whose time is not that of its stamp, because it was predicted by itself.
  [[nodiscard]] Status predict(std::int64_t stamp, const Input& input) noexcept {
    return moved(stamp, [&](const Scalar& time, const Scalar& duration) {
      return filter_.predict_interval(time, duration, input);
    });
  }

  /// The same over a turn that is known but for an angle, of a guaranteed gyro's filter.
  /// \return the status of the filter's `predict_turn`; `out_of_range` as above.
  [[nodiscard]] Status predict_turn(std::int64_t stamp, const Vector3<Scalar>& turn, const Scalar& angle) noexcept {
    return moved(stamp, [&](const Scalar& time, const Scalar& duration) {
      return filter_.predict_turn_interval(time, duration, turn, angle);
    });
  }

  /// Seconds are no stamps.
  template <typename Seconds, typename = std::enable_if_t<std::is_floating_point_v<Seconds>>>
  Status predict(Seconds, const Input&) = delete;
  template <typename Seconds, typename = std::enable_if_t<std::is_floating_point_v<Seconds>>>
  Status predict_turn(Seconds, const Vector3<Scalar>&, const Scalar&) = delete;

 private:
  template <typename Move>
  [[nodiscard]] Status moved(std::int64_t stamp, const Move& move) noexcept {
    if (filter_.time() != seconds_between<Scalar>(epoch_, stamp_)) {
      return Status::out_of_range;
    }
    const Status status = move(seconds_between<Scalar>(epoch_, stamp), seconds_between<Scalar>(stamp_, stamp));
    if (status == Status::ok) {
      stamp_ = stamp;
    }
    return status;
  }

  Filter filter_;
  std::int64_t epoch_ = 0;
  std::int64_t stamp_ = 0;
};

}  // namespace elliptude
