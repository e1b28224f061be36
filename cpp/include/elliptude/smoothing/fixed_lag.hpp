#pragma once

/// \file
/// Fixed lag, for streams: a guaranteed filter that remembers its last moments, and says of one of them what was possible then, with what
/// was measured since. (theory, section 20.5)

#include "elliptude/guaranteed/filter.hpp"
#include "elliptude/smoothing/both_directions.hpp"
#include "elliptude/smoothing/mirror.hpp"

namespace elliptude {

/// What was possible at an earlier moment, by all that was measured until now.
template <typename State>
struct SmoothedSet {
  StateScalar<State> time{0};
  GibbsEllipsoid<State> set;  ///< meaningless without a claim
  Claim claim = Claim::none;  ///< what the set rests on
  bool uses_future = false;   ///< whether it is another than the filter had then
};

/// A guaranteed filter and its last moments, at most `Lag` before the present one, in an array: a moment is what the filter knew before
/// a prediction, after the last update there. Nothing of the measurements is kept, as a moment's set has them in it. In `double` a moment
/// is about half a kilobyte.
///
/// `GuaranteedFilter` says how to start, bound or restore a filter; `make` then takes it over. `StampedFilter<FixedLag<...>>` is
/// predicted to stamps.
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
  /// \return the status of `Mirror<Flow>::flow`, of a flow that `make` has not made.
  [[nodiscard]] static Status make(const Filter& filter, FixedLag& result) noexcept {
    typename Mirror<Flow>::Backward backward;
    if (const Status status = Mirror<Flow>::flow(filter.flow(), Scalar(0), backward); status != Status::ok) {
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
  /// Whether a past and its future have contradicted one another since the beginning, or since the filter forgot.
  [[nodiscard]] bool has_contradicted() const noexcept { return has_contradicted_; }

  /// `GuaranteedFilter::forget`; the moments are forgotten, too.
  void forget() noexcept {
    filter_.forget();
    begin();
  }

  /// `GuaranteedFilter::predict`. A prediction over no time begins no moment.
  [[nodiscard]] Status predict(const Scalar& time, const Input& input) noexcept {
    return predict_interval(time, Scalar(time - filter_.time()), input);
  }
  /// `GuaranteedFilter::predict_interval`.
  [[nodiscard]] Status predict_interval(const Scalar& time, const Scalar& duration, const Input& input) noexcept {
    Interval interval;
    interval.duration = duration;
    interval.input = input;
    return append(filter_.predict_interval(time, duration, input), interval);
  }
  /// `GuaranteedFilter::predict_turn`.
  [[nodiscard]] Status predict_turn(const Scalar& time, const Vector3<Scalar>& turn, const Scalar& angle) noexcept {
    return predict_turn_interval(time, Scalar(time - filter_.time()), turn, angle);
  }
  /// `GuaranteedFilter::predict_turn_interval`.
  [[nodiscard]] Status predict_turn_interval(const Scalar& time, const Scalar& duration, const Vector3<Scalar>& turn,
                                             const Scalar& angle) noexcept {
    Interval interval;
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
      moment(0).known = present();
    }
    return status;
  }

  /// What was possible so many moments ago, by all that was measured until now. From the present set a flow goes backward, moment by
  /// moment, and each time the set is combined with what the filter knew then. Where the claim is that of the filter then, the set is no
  /// wider by the criterion, in its largest angle, and in the vector; where it is stronger, it may be. If past and future prove that a
  /// statement is wrong, it may be wrong elsewhere without showing it: from then on no smoothed set is unconditional.
  /// \param age 0 for the present.
  /// \return `out_of_range` of an age that is not less than `moments`; `empty_intersection` of such a proof under `Policy::raise`;
  /// `interrupted`; `callback_failed`. After any of these the same may be asked again.
  [[nodiscard]] Status smoothed(std::size_t age, SmoothedSet<State>& result) noexcept {
    if (age >= count_) {
      return Status::out_of_range;
    }
    BothDirections<State> both;
    both.smoothed = moment(0).known;
    both.smallest = both.smoothed;
    bool contradicted = has_contradicted_;
    for (std::size_t k = 1; k <= age; ++k) {
      ClaimedSet<State> future;
      if (const Status status = backward(moment(k - 1), both.smallest, future); status != Status::ok) {
        return status;
      }
      const Status status =
          both_directions(moment(k).known, future, {filter_.settings().criterion, is_product()}, both);
      if (status != Status::ok) {
        return status;
      }
      if (both.contradict && filter_.settings().policy == Policy::raise) {
        return Status::empty_intersection;
      }
      contradicted = contradicted || both.contradict;
    }
    has_contradicted_ = contradicted;
    const Claim claim = both.smoothed.claim;
    const bool is_weakened = contradicted && claim == Claim::unconditional;
    result = {moment(age).time, both.smoothed.set, is_weakened ? Claim::conditional : claim, both.uses_future};
    return Status::ok;
  }

 private:
  /// How the filter came to a moment.
  struct Interval {
    Scalar duration{0};
    Input input{};
    Vector3<Scalar> turn = Vector3<Scalar>::Zero();
    Scalar angle{0};
    bool is_turn = false;
  };
  struct Moment {
    Scalar time{0};
    Interval interval;
    ClaimedSet<State> known;
  };

  [[nodiscard]] Moment& moment(std::size_t age) noexcept { return moments_[(newest_ + Lag + 1 - age) % (Lag + 1)]; }

  [[nodiscard]] ClaimedSet<State> present() const noexcept {
    ClaimedSet<State> known;
    known.claim = filter_.claim();
    if (filter_.knows_attitude()) {
      known.set = filter_.ellipsoid();
    }
    return known;
  }

  /// What is known after a prediction rests on what was known before.
  [[nodiscard]] bool is_product() const noexcept {
    return !filter_.settings().estimates_vector && filter_.has_vector_bound();
  }

  void begin() noexcept {
    newest_ = 0;
    count_ = 1;
    has_contradicted_ = false;
    moment(0).time = filter_.time();
    moment(0).known = present();
  }

  [[nodiscard]] Status append(Status predicted, const Interval& interval) noexcept {
    if (predicted != Status::ok) {
      return predicted;
    }
    if (interval.duration > Scalar(0)) {
      newest_ = (newest_ + 1) % (Lag + 1);
      count_ += count_ <= Lag ? 1 : 0;
      moment(0).interval = interval;
    }
    moment(0).time = filter_.time();
    moment(0).known = present();
    return Status::ok;
  }

  /// From a set at the end of an interval to one at its beginning; none where it cannot be followed.
  /// \return `interrupted`, `callback_failed`; the status of `Mirror<Flow>::flow`.
  [[nodiscard]] Status backward(const Moment& end, const ClaimedSet<State>& known,
                                ClaimedSet<State>& future) const noexcept {
    future.claim = Claim::none;
    if (known.claim == Claim::none) {
      return Status::ok;
    }
    using BackwardFilter = GuaranteedFilter<typename Mirror<Flow>::Backward>;
    const Interval& interval = end.interval;
    typename Mirror<Flow>::Backward flow;
    const Scalar held = is_product() ? Scalar(0) : interval.duration;
    if (const Status status = Mirror<Flow>::flow(filter_.flow(), held, flow); status != Status::ok) {
      return status;
    }
    typename BackwardFilter::Settings settings = filter_.settings();
    settings.policy = Policy::raise;
    settings.most_wrong = 0;
    BackwardFilter filter;
    Status status = BackwardFilter::make(flow, settings, Scalar(-end.time), filter);
    if (status == Status::ok && is_product()) {
      status = filter.bound_vector(mirrored(filter_.vector_bound()));
    }
    if (status == Status::ok) {
      status = filter.start(mirrored(known.set));
    }
    if (status == Status::ok) {
      status = moved(interval, held, filter);
    }
    if (status == Status::interrupted || status == Status::callback_failed) {
      return status;
    }
    if (status == Status::ok && filter.knows_attitude()) {
      future = {mirrored(filter.ellipsoid()), known.claim};
    }
    return Status::ok;
  }

  /// Predicts a filter of the mirrored flow over an interval.
  template <typename BackwardFilter>
  [[nodiscard]] Status moved(const Interval& interval, const Scalar& held, BackwardFilter& filter) const noexcept {
    const Scalar time = filter.time() + interval.duration;
    if constexpr (!Filter::measures_rate) {
      if (interval.is_turn) {
        return filter.predict_turn_interval(time, interval.duration, Vector3<Scalar>(-interval.turn), interval.angle);
      }
    }
    return filter.predict_interval(time, interval.duration, Mirror<Flow>::input(filter_.flow(), held, interval.input));
  }

  Filter filter_;
  std::array<Moment, Lag + 1> moments_;
  std::size_t newest_ = 0;
  std::size_t count_ = 1;
  bool has_contradicted_ = false;
};

}  // namespace elliptude
