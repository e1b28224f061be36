#pragma once

/// \file
/// Fixed lag, for streams: a guaranteed filter that remembers its last moments, and says of one of them what was
/// possible then, with what was measured since. (theory, section 20.5)

#include "elliptude/smoothing/backward_pass.hpp"

namespace elliptude {

/// A guaranteed filter and its last moments, the present one and at most `Lag` before it, in an array.
/// `GuaranteedFilter` says how to start, bound or restore a filter; `make` then copies it.
/// `StampedFilter<FixedLag<...>>` is predicted to stamps.
template <typename FilterType, std::size_t Lag>
class FixedLag {
  static_assert(Lag >= 1, "without a lag there is nothing to remember");

 public:
  using Filter = FilterType;
  using Flow = typename Filter::Flow;
  using State = typename Filter::State;
  using Input = typename Filter::Input;
  using Scalar = typename Filter::Scalar;
  static constexpr std::size_t lag = Lag;

  /// \param filter as it is now: the first moment.
  /// \return the status of `Mirror<Flow>::flow`: `out_of_range`, if the filter's flow has not been made.
  [[nodiscard]] static Status make(const Filter& filter, FixedLag& result) noexcept {
    typename Mirror<Flow>::Backward backward;
    if (const Status status = Mirror<Flow>::flow(filter.flow(), backward); status != Status::ok) {
      return status;
    }
    result.filter_ = filter;
    result.begin();
    return Status::ok;
  }

  [[nodiscard]] const Filter& filter() const noexcept { return filter_; }
  [[nodiscard]] const Scalar& time() const noexcept { return filter_.time(); }
  /// How many moments there are, with the present one: 1 to Lag + 1.
  [[nodiscard]] std::size_t moments() const noexcept { return count_; }
  /// Whether a past and its future were found to contradict one another, in what `smoothed` was asked for since the
  /// beginning, or since the filter forgot: where the filter had met no contradiction in between; not under
  /// `Policy::raise`, which keeps nothing of it.
  [[nodiscard]] bool has_contradicted() const noexcept { return has_contradicted_; }

  /// `GuaranteedFilter::forget`; the moments are forgotten, too.
  void forget() noexcept {
    filter_.forget();
    begin();
  }

  /// `GuaranteedFilter::predict`. A prediction over no time begins no moment, but a turn does.
  [[nodiscard]] Status predict(const Scalar& time, const Input& input) noexcept {
    if (cannot_tell_seconds(time)) {
      return Status::out_of_range;
    }
    return predict_interval(time, Scalar(time - filter_.time()), input);
  }
  /// `GuaranteedFilter::predict_interval`.
  [[nodiscard]] Status predict_interval(const Scalar& time, const Scalar& duration, const Input& input) noexcept {
    PredictedInterval<Filter> interval;
    interval.duration = duration;
    interval.input = input;
    return append(filter_.predict_interval(time, duration, input), interval);
  }
  /// `GuaranteedFilter::predict_turn`.
  [[nodiscard]] Status predict_turn(const Scalar& time, const Vector3<Scalar>& turn, const Scalar& angle) noexcept {
    if (cannot_tell_seconds(time)) {
      return Status::out_of_range;
    }
    return predict_turn_interval(time, Scalar(time - filter_.time()), turn, angle);
  }
  /// `GuaranteedFilter::predict_turn_interval`.
  [[nodiscard]] Status predict_turn_interval(const Scalar& time, const Scalar& duration, const Vector3<Scalar>& turn,
                                             const Scalar& angle) noexcept {
    PredictedInterval<Filter> interval;
    interval.duration = duration;
    interval.is_turn = true;
    interval.turn = turn;
    interval.angle = angle;
    return append(filter_.predict_turn_interval(time, duration, turn, angle), interval);
  }

  /// `GuaranteedFilter::update`, of any kind: what follows the measurements is the report.
  template <typename Measured, typename... Reports>
  [[nodiscard]] Status update(const Measured& measurements, Reports&... reports) noexcept {
    const Status status = filter_.update(measurements, reports...);
    if (status == Status::ok) {
      moment(0) = FilterMoment<Filter>::of(filter_, moment(0).interval);
    }
    return status;
  }

  /// What was possible so many moments ago, by all that was measured until now: a `BackwardPass` from the present. Once
  /// past and future have proved that a statement is wrong, no smoothed set is unconditional, until the filter forgets.
  /// \param age 0 for the present.
  /// \return `out_of_range` of an age that is not less than `moments`; the status of `BackwardPass::to`. After any of
  /// these the same may be asked again.
  [[nodiscard]] Status smoothed(std::size_t age, SmoothedSet<State>& result) noexcept {
    if (age >= count_) {
      return Status::out_of_range;
    }
    BackwardPass<Filter> pass(filter_, moment(0), has_contradicted_);
    for (std::size_t k = 1; k <= age; ++k) {
      if (const Status status = pass.to(moment(k)); status != Status::ok) {
        return status;
      }
    }
    has_contradicted_ = pass.has_contradicted();
    result = pass.smoothed();
    return Status::ok;
  }

 private:
  /// A time that tells no seconds is refused where an interval is the difference of two.
  [[nodiscard]] static bool cannot_tell_seconds(const Scalar& time) noexcept {
    return scalar::isfinite(time) && !rounding::tells_seconds(time);
  }

  [[nodiscard]] FilterMoment<Filter>& moment(std::size_t age) noexcept {
    return moments_[(newest_ + Lag + 1 - age) % (Lag + 1)];
  }

  void begin() noexcept {
    newest_ = 0;
    count_ = 1;
    has_contradicted_ = false;
    moment(0) = FilterMoment<Filter>::of(filter_, {});
  }

  [[nodiscard]] Status append(Status predicted, const PredictedInterval<Filter>& interval) noexcept {
    if (predicted != Status::ok) {
      return predicted;
    }
    const bool is_new = interval.duration > Scalar(0) || interval.is_turn;
    if (is_new) {
      newest_ = (newest_ + 1) % (Lag + 1);
      count_ += count_ <= Lag ? 1 : 0;
    }
    moment(0) = FilterMoment<Filter>::of(filter_, is_new ? interval : moment(0).interval);
    return Status::ok;
  }

  Filter filter_;
  std::array<FilterMoment<Filter>, Lag + 1> moments_;
  std::size_t newest_ = 0;
  std::size_t count_ = 1;
  bool has_contradicted_ = false;
};

}  // namespace elliptude
