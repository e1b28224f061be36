#pragma once

/// \file
/// The guaranteed filter: its set holds the state of the continuous motion if all bounds that it was told hold.
/// (theory, sections 16 to 18)

#include "elliptude/attitude/attitude_bounds.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/guaranteed/detail/filter_linear_update.hpp"
#include "elliptude/guaranteed/detail/filter_prediction.hpp"
#include "elliptude/guaranteed/detail/filter_update.hpp"
#include "elliptude/guaranteed/update_constraints.hpp"

namespace elliptude {

/// The guaranteed filter, in the Gibbs chart throughout. It may know nothing about the attitude, at the beginning or
/// after a prediction has become too large to be useful. It then starts from the next measurements that determine one.
/// A function that does not return `ok` has changed nothing. A filter that `make` has not made knows nothing at time
/// zero. To predict nothing succeeds, but what such a filter was told is not carried on: of a rigid body the prediction
/// fails (`too_many_steps`), of a gyro it forgets all but the bound of the bias.
template <typename FlowType>
class GuaranteedFilter {
 public:
  using Flow = FlowType;
  using State = typename Flow::State;
  using Input = typename Flow::Input;
  using Scalar = StateScalar<State>;
  using Set = GibbsEllipsoid<State>;
  static constexpr bool measures_rate = detail::FilterMemory<Flow>::measures_rate;

  using Settings = GuaranteedSettings<Scalar>;

  /// A filter that knows nothing at `time`.
  /// \return `not_finite`; `out_of_range` of the settings; the status of `validate` for the criterion.
  [[nodiscard]] static ELLIPTUDE_SELDOM Status make(const Flow& flow, const Settings& settings, const Scalar& time,
                                                    GuaranteedFilter& filter) noexcept {
    if (!scalar::isfinite(time)) {
      return Status::not_finite;
    }
    if (!is_compiled(settings.policy) || settings.most_wrong < 0 || settings.most_wrong > most_that_are_wrong ||
        settings.regain_after < 1 || ((measures_rate || only_whole_states) && !settings.estimates_vector)) {
      return Status::out_of_range;
    }
    if (const Status status = validate(settings.criterion); status != Status::ok) {
      return status;
    }
    filter.memory_.flow = flow;
    filter.memory_.settings = settings;
    filter.memory_.time = time;
    filter.memory_.known.has_vector_bound = false;
    filter.memory_.trust = Trust();
    filter.forget();
    return Status::ok;
  }

  /// Starts the filter: the state is in this set now.
  /// \return the status of `validate`; `not_positive_definite` of a flat set; `unbounded` of a set that holds half
  /// turns; `out_of_range` beyond the `FilterDomain`; `empty_intersection` where its vector has nothing in common with
  /// the bound that `bound_vector` has stated, unless the vector is left to that.
  template <typename Chart>
  [[nodiscard]] Status start(const StateEllipsoid<State, Chart>& set) noexcept {
    Set begin;
    if (const Status status = startable(set, begin); status != Status::ok) {
      return status;
    }
    if (memory_.known.has_vector_bound && memory_.contradicts(detail::vector_of(begin), memory_.known.vector_bound)) {
      return Status::empty_intersection;
    }
    begin_with(begin);
    return Status::ok;
  }

  /// The angular velocity, or the gyro's bias, is in this ellipsoid at all times, rad/s.
  /// \return the status of `validate`; `not_positive_definite` of a flat one; `out_of_range` beyond the `FilterDomain`;
  /// `empty_intersection` where it has nothing in common with what the filter knows of the vector, so that no update
  /// could succeed.
  [[nodiscard]] Status bound_vector(const Ellipsoid<Scalar, 3>& bound) noexcept {
    if (const Status status = Memory::validated(bound); status != Status::ok) {
      return status;
    }
    const Ellipsoid<Scalar, 3> wider = with_least_width(Ellipsoid<Scalar, 3>{bound.center, symmetrized(bound.shape)});
    if (memory_.knows_vector() && memory_.contradicts(memory_.known_vector(), wider)) {
      return Status::empty_intersection;
    }
    memory_.known.vector_bound = wider;
    memory_.known.has_vector_bound = true;
    if (memory_.known.has_attitude) {
      memory_.confine(memory_.known.set);
    }
    return Status::ok;
  }

  /// Whether `bound_vector` has stated a bound; `vector_bound`, a little wider, is meaningless otherwise.
  [[nodiscard]] bool has_vector_bound() const noexcept { return memory_.known.has_vector_bound; }
  [[nodiscard]] const Ellipsoid<Scalar, 3>& vector_bound() const noexcept { return memory_.known.vector_bound; }
  /// Whether the vector is left to that bound, so that the set is a product of the attitude's and of it.
  [[nodiscard]] bool leaves_vector() const noexcept { return memory_.leaves_vector(); }

  /// Forgets everything but the bound of the vector: attitude, measurements of the vector, and what was dropped. Use it
  /// to go on under `Policy::raise` if the past is wrong, or cannot be predicted.
  void forget() noexcept { memory_.forget(); }

  [[nodiscard]] const Scalar& time() const noexcept { return memory_.time; }
  [[nodiscard]] const Flow& flow() const noexcept { return memory_.flow; }
  [[nodiscard]] const Settings& settings() const noexcept { return memory_.settings; }
  [[nodiscard]] Claim claim() const noexcept { return memory_.claim; }
  /// Whether there is a set; `ellipsoid` is meaningless otherwise.
  [[nodiscard]] bool knows_attitude() const noexcept { return memory_.known.has_attitude; }
  /// Why there is no set: an update with directions starts one only where something bounds the vector, too.
  [[nodiscard]] Lacks lacks() const noexcept {
    const bool has_vector = memory_.known.has_vector || memory_.known.has_vector_bound;
    return memory_.known.has_attitude ? Lacks::nothing : has_vector ? Lacks::attitude : Lacks::vector;
  }
  [[nodiscard]] const Set& ellipsoid() const noexcept { return memory_.known.set; }
  /// Whether the angular velocity or the bias is known while the attitude is not; `vector` is meaningless otherwise.
  [[nodiscard]] bool knows_vector() const noexcept { return memory_.known.has_vector; }
  [[nodiscard]] const Ellipsoid<Scalar, 3>& vector() const noexcept { return memory_.known.vector; }
  /// Whether the set, of the attitude or of the vector, rests on what was dropped, and what updates have shown since.
  [[nodiscard]] const Trust& trust() const noexcept { return memory_.trust; }

  /// How far the attitude of the set's center may be off: the tilt, the turn about the vertical, and in all. Each is a
  /// question of its own to the set, and after an update with `keeps_constraints` to the measurements and the
  /// prediction that it came from; then the answers are sharper than the set. (theory, section 16.11)
  /// \param vertical in reference axes, of any length.
  /// \return `unbounded` without a set; `not_finite`; `zero_direction`.
  [[nodiscard]] Status bounds(const Vector3<Scalar>& vertical, AttitudeBounds<Scalar>& result) const noexcept {
    if (!scalar::all_finite(vertical)) {
      return Status::not_finite;
    }
    if (!(vertical.cwiseAbs().maxCoeff() > Scalar(0))) {
      return Status::zero_direction;
    }
    if (!memory_.known.has_attitude) {
      return Status::unbounded;
    }
    const Vector3<Scalar> body = scalar::unit(
        Vector3<Scalar>(memory_.known.set.center.attitude.transpose().lazyProduct(scalar::unit(vertical))));
    const Ellipsoid<Scalar, 3> set = detail::attitude_of(memory_.known.set);
    const Status status =
        attitude_bounds(set, memory_.constraints.quadrics.data(), memory_.constraints.count, body, result);
    // Constraints that nothing satisfies, though fusion found no contradiction: no more than the set is claimed then.
    return status == Status::empty_intersection
               ? attitude_bounds(set, memory_.constraints.quadrics.data(), 0, body, result)
               : status;
  }

  /// Restores a stored filter bit for bit, after `make` with its settings and time, and `bound_vector`.
  /// \param set its set, or null if it did not know the attitude.
  /// \param vector what it knew without the attitude, or null.
  /// \return `out_of_range` of both, of a negative count, and of what limits leave out: a vector
  /// (`ELLIPTUDE_ONLY_WHOLE_STATES`), or dropped measurements (`ELLIPTUDE_ONLY_POLICY`); the status of `start`, but for
  /// `empty_intersection`, and of `bound_vector`.
  [[nodiscard]] Status resume(const Set* set, const Ellipsoid<Scalar, 3>* vector, const Trust& trust) noexcept {
    if (trust.agreeing_updates() < 0 || trust.disputed_updates() < 0 || (set != nullptr && vector != nullptr) ||
        (only_whole_states && vector != nullptr) || (!may_drop && trust.rests_on_drops())) {
      return Status::out_of_range;
    }
    if (set != nullptr) {
      Set begin;  // it need not meet the bound: what was predicted may have left it
      if (const Status status = startable(*set, begin); status != Status::ok) {
        return status;
      }
      begin_with(begin);
    } else if (vector != nullptr) {
      if (const Status status = Memory::validated(*vector); status != Status::ok) {
        return status;
      }
      memory_.known.vector = {vector->center, symmetrized(vector->shape)};
    }
    memory_.known.has_attitude = set != nullptr;
    memory_.known.has_vector = vector != nullptr;
    memory_.trust = trust;
    memory_.claim = memory_.present_claim();
    return Status::ok;
  }

  /// Moves the set to a later time. If it has become too large to be bounded the attitude is forgotten, and what is
  /// known of the vector is kept. So it is, but under `Policy::raise`, if this set cannot be predicted where another
  /// can be: a wrong rate may be one that no step is short enough for.
  /// \return the status of the flow, but for `unbounded`; `out_of_range` of a time before the filter's, or so large that
  /// it does not tell seconds apart (`rounding::tells_seconds`), or under `Policy::raise` of a gyro's turn beyond the
  /// `FilterDomain`, which is else unbounded.
  [[nodiscard]] Status predict(const Scalar& time, const Input& input) noexcept {
    if (scalar::isfinite(time) && !rounding::tells_seconds(time)) {
      return Status::out_of_range;
    }
    return predict_interval(time, Scalar(time - memory_.time), input);
  }

  /// The same where the interval is better known than as the difference of two times: see base/stamps.hpp.
  /// \param time at its end, s, which the filter then has. The two are not compared.
  /// \param duration of the interval, s, right to ε of itself.
  /// \return the status of `predict`; `out_of_range` of a negative duration.
  [[nodiscard]] Status predict_interval(const Scalar& time, const Scalar& duration, const Input& input) noexcept {
    if (!scalar::isfinite(time)) {
      return Status::not_finite;
    }
    return detail::FilterPrediction<Flow>(memory_).by_motion(time, duration, input);
  }

  /// Moves the set of a gyro's filter over a turn that is known but for an angle, however it was measured: rates that
  /// were added up, of which the errors partly cancel, or a turntable. One filter may be copied and predicted to many
  /// times, so that each row of a log is predicted from one before it in one piece. (theory, section 18.6)
  /// \param turn rotation vector in the body axes at the filter's time, rad.
  /// \param angle of the turn that is added to it, rad; anything from π on says nothing of the attitude.
  /// \return the status of `predict`, and `out_of_range` of a negative angle.
  [[nodiscard]] Status predict_turn(const Scalar& time, const Vector3<Scalar>& turn, const Scalar& angle) noexcept {
    if (scalar::isfinite(time) && !rounding::tells_seconds(time)) {
      return Status::out_of_range;
    }
    return predict_turn_interval(time, Scalar(time - memory_.time), turn, angle);
  }

  /// The same with a duration, as for `predict_interval`.
  [[nodiscard]] Status predict_turn_interval(const Scalar& time, const Scalar& duration, const Vector3<Scalar>& turn,
                                             const Scalar& angle) noexcept {
    static_assert(!measures_rate, "a rigid body's flow predicts the angular velocity, which a turn does not tell");
    if (!scalar::all_finite(turn) || !(angle == angle)) {
      return Status::not_finite;
    }
    if (!(angle >= Scalar(0))) {
      return Status::out_of_range;
    }
    if (!scalar::isfinite(time)) {
      return Status::not_finite;
    }
    return detail::FilterPrediction<Flow>(memory_).by_turn(time, duration, turn, angle);
  }

  /// Fuses all measurements of one moment with the prediction, at once. If the attitude is not known, they may start
  /// it: look at the claim, as `ok` does not say that there is a set.
  /// \param update written whatever the status; after a failure with the filter's claim as it was.
  /// \return what the measurements' `validate` says; `out_of_range` of too many directions or of a null pointer to them,
  /// of an angular velocity given to a gyro's filter, which has it as input, of more than eight measurements of which
  /// some may be wrong, and, where nothing may be left out, of an angular velocity beyond the `FilterDomain`;
  /// `empty_intersection` if they contradict the prediction, the bound of the vector, or each other, and the policy is
  /// to say so.
  [[nodiscard]] Status update(const Measurements<Scalar>& measurements, GuaranteedUpdate<Scalar>& update) noexcept {
    return detail::FilterUpdate<Flow>(memory_).run(measurements, update);
  }

  /// The same, and leaves what the update used, for questions that are answered one by one.
  /// \param constraints changed only on success.
  [[nodiscard]] Status update(const Measurements<Scalar>& measurements, GuaranteedUpdate<Scalar>& update,
                              UpdateConstraints<State>& constraints) noexcept {
    const detail::Knowledge<State> before = memory_.known;
    detail::FilterUpdate<Flow> step(memory_);
    const Status status = step.run(measurements, update);
    if (status == Status::ok) {
      step.leave(before, measurements, constraints);
    }
    return status;
  }

  /// One linear measurement of the error [ζ; δ] about the present center.
  /// \return the status of `to_quadric` and `minimal_intersection`; `unbounded` if the attitude is not known, or the
  /// set is not in the `FilterDomain` afterwards.
  template <int Rows>
  [[nodiscard]] Status update(const LinearMeasurement<Scalar, Rows>& measurement,
                              GuaranteedUpdate<Scalar>& update) noexcept {
    return detail::FilterLinearUpdate<Flow>(memory_).run(measurement, update);
  }

 private:
  using Memory = detail::FilterMemory<Flow>;

  /// A set as the filter would keep it.
  /// \return the status of `start`, but for `empty_intersection`.
  template <typename Chart>
  [[nodiscard]] Status startable(const StateEllipsoid<State, Chart>& set, Set& begin) const noexcept {
    if (const Status status = validate(set); status != Status::ok) {
      return status;
    }
    if (!is_positive_definite(set.shape)) {
      return Status::not_positive_definite;
    }
    if constexpr (std::is_same_v<Chart, GibbsChart>) {
      begin = {set.center, symmetrized(set.shape)};
    } else {
      if (const Status status = converted(set, begin); status != Status::ok) {
        return status;
      }
    }
    if (!is_rotation(begin.center.attitude, rounding::share<Scalar>(rounding::rotation))) {
      begin.center.attitude = renormalized(begin.center.attitude);  // about the nearest rotation, which rounding turns
      begin.shape =
          detail::with_attitude_added(begin.shape, Scalar(0), rounding::share<Scalar>(rounding::center), Scalar(0));
    }
    memory_.confine(begin);
    return can_be_kept(begin) ? Status::ok : Status::out_of_range;
  }

  void begin_with(const Set& set) noexcept {
    memory_.constraints.count = 0;
    memory_.known.set = set;
    memory_.known.has_attitude = true;
    memory_.known.has_vector = false;
    memory_.trust.forget();
    memory_.claim = Claim::unconditional;
  }

  Memory memory_;
};

}  // namespace elliptude
