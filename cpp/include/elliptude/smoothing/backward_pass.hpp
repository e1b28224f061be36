#pragma once

/// \file
/// From the last moment of a guaranteed filter to its first: what was possible at each, by all that was measured.
/// (theory, section 20.5)

#include "elliptude/guaranteed/filter.hpp"
#include "elliptude/smoothing/both_directions.hpp"
#include "elliptude/smoothing/mirror.hpp"

namespace elliptude {

/// A prediction of a guaranteed filter: by the motion, or over a turn.
template <typename Filter>
struct PredictedInterval {
  using Scalar = typename Filter::Scalar;

  Scalar duration{0};
  typename Filter::Input input{};  ///< of a prediction by the motion
  bool is_turn = false;
  Vector3<Scalar> turn = Vector3<Scalar>::Zero();  ///< of `predict_turn`
  Scalar angle{0};
};

/// A moment of a guaranteed filter: what it knew after its last update there, before the next prediction. Nothing of
/// the measurements is kept, as the set has them in it. In `double` a moment is about half a kilobyte.
template <typename Filter>
struct FilterMoment {
  typename Filter::Scalar time{0};
  PredictedInterval<Filter> interval;  ///< that led to it; ignored in the first moment
  ClaimedSet<typename Filter::State> known;
  unsigned contradictions = 0;  ///< how many updates had contradicted until then

  /// What a filter knows now.
  [[nodiscard]] static FilterMoment of(const Filter& filter, const PredictedInterval<Filter>& interval) noexcept {
    FilterMoment moment;
    moment.time = filter.time();
    moment.interval = interval;
    moment.known.claim = filter.claim();
    moment.contradictions = filter.trust().contradictions();
    if (filter.knows_attitude()) {
      moment.known.set = filter.ellipsoid();
    }
    return moment;
  }
};

/// What was possible at an earlier moment, by all that was measured until now.
template <typename State>
struct SmoothedSet {
  StateScalar<State> time{0};
  GibbsEllipsoid<State> set;  ///< meaningless without a claim, as is the vector
  /// The vector by itself. Where the claim is the same it is never wider than the filter's was then, though the set may
  /// be in its vector.
  Ellipsoid<StateScalar<State>, 3> vector;
  Claim claim = Claim::none;  ///< what the set rests on
  bool uses_future = false;   ///< whether it is another than the filter had then
};

/// A pass from the last moment of a filter backward, moment by moment, however a program keeps them. The mirrored flow
/// carries the set to the beginning of an interval, where it is combined with what the filter knew then, and goes on.
/// Where the claim is that of the filter then, the smoothed set is no larger by the criterion and no wider in its
/// largest angle, and the vector is no wider; where the claim is stronger, they may be.
///
/// Before a contradiction that the filter itself has met, and got over by its policy, its sets may have been wrong
/// already without showing it. So nothing of them is carried to earlier moments: only what was known after the dispute
/// is. Where such a set and what was known after have nothing in common, that is no new contradiction: the latter is
/// shown, called conditional.
template <typename FilterType>
class BackwardPass {
 public:
  using Filter = FilterType;
  using Flow = typename Filter::Flow;
  using State = typename Filter::State;
  using Scalar = typename Filter::Scalar;

  /// \param filter whose flow, settings and bound of the vector count; it must live as long as the pass, and stay as it
  /// is.
  /// \param has_contradicted whether a statement is known to be wrong already: no set is then unconditional.
  BackwardPass(const Filter& filter, const FilterMoment<Filter>& last, bool has_contradicted = false) noexcept
      : filter_(filter),
        time_(last.time),
        interval_(last.interval),
        contradictions_(last.contradictions),
        has_contradicted_(has_contradicted) {
    both_.smoothed = weakened(last.known);
    both_.vector = detail::vector_of(last.known.set);
    carried_ = both_.smoothed;
  }
  BackwardPass(const Filter&&, const FilterMoment<Filter>&, bool = false) = delete;

  /// Goes to the moment before, from which `interval` of the present one led here: none is left out.
  /// \return `empty_intersection` if it is proved under `Policy::raise` that a statement is wrong; `interrupted`;
  /// `callback_failed`; the status of `Mirror<Flow>::flow`. The pass is then where it was.
  [[nodiscard]] Status to(const FilterMoment<Filter>& earlier) noexcept {
    ClaimedSet<State> future;
    if (const Status status = backward(future); status != Status::ok) {
      return status;
    }
    BothDirections<State> both;
    if (const Status status = both_directions(weakened(earlier.known), future,
                                              {filter_.settings().criterion, filter_.leaves_vector()}, both);
        status != Status::ok) {
      return status;
    }
    const bool is_before_dispute = earlier.contradictions != contradictions_;
    if (both.are_apart && is_before_dispute) {
      both = after_dispute(future);
    }
    if (both.contradict && filter_.settings().policy == Policy::raise) {
      return Status::empty_intersection;
    }
    both_ = both;
    has_contradicted_ = has_contradicted_ || both.contradict;
    both_.smoothed = weakened(both_.smoothed);
    carried_ = weakened(is_before_dispute ? future : both.smallest);
    time_ = earlier.time;
    interval_ = earlier.interval;
    return Status::ok;
  }

  /// At the moment where the pass is.
  [[nodiscard]] SmoothedSet<State> smoothed() const noexcept {
    return {time_, both_.smoothed.set, both_.vector, both_.smoothed.claim, both_.uses_future};
  }

  /// Whether past and future have proved that a statement is wrong, where the filter had met no contradiction in
  /// between. It may be wrong elsewhere without showing it: no
  /// set is unconditional from then on, and those of later moments, which the pass has shown before, should not have
  /// been.
  [[nodiscard]] bool has_contradicted() const noexcept { return has_contradicted_; }

 private:
  using Backward = typename Mirror<Flow>::Backward;

  /// With the claim that is left once a statement is known to be wrong.
  [[nodiscard]] ClaimedSet<State> weakened(const ClaimedSet<State>& known) const noexcept {
    ClaimedSet<State> result = known;
    if (has_contradicted_ && known.claim == Claim::unconditional) {
      result.claim = Claim::conditional;
    }
    return result;
  }

  /// What is shown where the filter's set has been given up for what the future comes from.
  [[nodiscard]] static BothDirections<State> after_dispute(const ClaimedSet<State>& future) noexcept {
    BothDirections<State> result;
    result.smoothed = {future.set, Claim::conditional};
    result.vector = detail::vector_of(future.set);
    result.uses_future = true;
    return result;
  }

  /// What is carried, at the beginning of the interval that led here; none where it cannot be followed.
  [[nodiscard]] Status backward(ClaimedSet<State>& future) const noexcept {
    const ClaimedSet<State>& known = carried_;
    if (known.claim == Claim::none) {
      return Status::ok;
    }
    Backward flow;
    if (const Status status = Mirror<Flow>::flow(filter_.flow(), flow); status != Status::ok) {
      return status;
    }
    typename GuaranteedFilter<Backward>::Settings settings = filter_.settings();
    settings.policy = Policy::raise;
    settings.keeps_constraints = false;
    GuaranteedFilter<Backward> filter;
    Status status = GuaranteedFilter<Backward>::make(flow, settings, Scalar(-time_), filter);
    if (status == Status::ok && filter_.leaves_vector()) {
      status = filter.bound_vector(mirrored(filter_.vector_bound()));
    }
    if (status == Status::ok) {
      status = filter.start(mirrored(known.set));
    }
    if (status == Status::ok) {
      status = move(filter);
    }
    if (status == Status::interrupted || status == Status::callback_failed) {
      return status;
    }
    if (status == Status::ok && filter.knows_attitude()) {
      future = {mirrored(filter.ellipsoid()), known.claim};
    }
    return Status::ok;
  }

  [[nodiscard]] Status move(GuaranteedFilter<Backward>& filter) const noexcept {
    const Scalar time = filter.time() + interval_.duration;
    if constexpr (!Filter::measures_rate) {
      if (interval_.is_turn) {
        return filter.predict_turn_interval(time, interval_.duration, Vector3<Scalar>(-interval_.turn),
                                            interval_.angle);
      }
    }
    return filter.predict_interval(time, interval_.duration, Mirror<Flow>::input(interval_.input));
  }

  const Filter& filter_;
  Scalar time_;
  PredictedInterval<Filter> interval_;
  unsigned contradictions_;     ///< until the last moment
  BothDirections<State> both_;  ///< at the moment where the pass is
  ClaimedSet<State> carried_;   ///< what goes on to earlier moments
  bool has_contradicted_ = false;
};

}  // namespace elliptude
