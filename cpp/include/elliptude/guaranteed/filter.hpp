#pragma once

/// \file
/// The guaranteed filter: its set holds the state of the continuous motion if all bounds that it was told hold. (theory,
/// sections 16 to 18)

#include "elliptude/attitude/attitude_bounds.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/guaranteed/detail/contradiction.hpp"
#include "elliptude/guaranteed/detail/kept_constraints.hpp"
#include "elliptude/guaranteed/recovery.hpp"

namespace elliptude {

/// The guaranteed filter, in the Gibbs chart throughout. It may know nothing about the attitude, at the beginning or after a
/// prediction has become too large to be useful. It then starts from the next measurements that determine one. A function
/// that does not return `ok` has changed nothing. A filter that `make` has not made knows nothing at time zero, and cannot predict.
template <typename FlowType>
class GuaranteedFilter {
 public:
  using Flow = FlowType;
  using State = typename Flow::State;
  using Input = typename Flow::Input;
  using Scalar = StateScalar<State>;
  using Set = GibbsEllipsoid<State>;
  static constexpr bool measures_rate = std::is_same_v<State, RigidBodyState<Scalar>>;

  struct Settings {
    SizeCriterion<Scalar, 6> criterion = SizeCriterion<Scalar, 6>::volume();
    Policy policy = Policy::raise;
    /// For `Policy::relaxed`: how many of at most eight measurements may be wrong, 0 to 2.
    int most_wrong = 0;
    /// A conditional claim ends after this many updates in a row without contradiction: the set is then taken from the
    /// measurements of that moment alone, if they bound one. If contradictions go on, the past is given up for such a set
    /// this many updates after the first one; the claim stays conditional until as many have agreed. (theory, section 16.8)
    int regain_after = 10;
    /// Whether the gyro's bias is part of what is estimated. If it is not, it is in the ellipsoid of `bound_vector`, which is all
    /// that is ever known of it, and the attitude is predicted and fused by itself: its sets are smaller, as no part of a sum
    /// has to bound the bias. The shape is then of two sets, one of the attitude and the bound of the bias, with zeros between,
    /// and the state is in their product. (theory, section 16.7)
    bool estimates_vector = true;
    /// Whether what an update has used is kept beside the set until the next prediction, so that `bounds` says as much as all of it
    /// does, and not only as much as the set does.
    bool keeps_constraints = false;
  };

  /// A filter that knows nothing at `time`.
  /// \return `not_finite`; `out_of_range` of the settings; the status of `validate` for the criterion.
  [[nodiscard]] static Status make(const Flow& flow, const Settings& settings, const Scalar& time,
                                   GuaranteedFilter& filter) noexcept {
    if (!scalar::isfinite(time)) {
      return Status::not_finite;
    }
    if (settings.most_wrong < 0 || settings.most_wrong > 2 || settings.regain_after < 1 ||
        (measures_rate && !settings.estimates_vector)) {
      return Status::out_of_range;
    }
    if (const Status status = validate(settings.criterion); status != Status::ok) {
      return status;
    }
    filter.flow_ = flow;
    filter.settings_ = settings;
    filter.time_ = time;
    filter.known_.has_vector_bound = false;
    filter.forget();
    return Status::ok;
  }

  /// Starts the filter: the state is in this set now.
  /// \return the status of `validate`; `not_positive_definite` of a flat set; `unbounded` of a set that holds half turns;
  /// `out_of_range` beyond the `FilterDomain`.
  template <typename Chart>
  [[nodiscard]] Status start(const StateEllipsoid<State, Chart>& set) noexcept {
    if (const Status status = validate(set); status != Status::ok) {
      return status;
    }
    Matrix6<Scalar> factor;
    if (const Status status = cholesky(set.shape, factor); status != Status::ok) {
      return status;
    }
    Set begin;
    if constexpr (std::is_same_v<Chart, GibbsChart>) {
      begin = set;
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
    confine(begin);
    if (!can_be_kept(begin)) {
      return Status::out_of_range;
    }
    constraints_.count = 0;
    known_.set = begin;
    known_.has_attitude = true;
    known_.has_vector = false;
    trust_ = {};
    claim_ = Claim::unconditional;
    return Status::ok;
  }

  /// The angular velocity, or the gyro's bias, is in this ellipsoid at all times, rad/s.
  /// \return the status of `validate`; `not_positive_definite` of a flat one; `out_of_range` beyond the `FilterDomain`.
  [[nodiscard]] Status bound_vector(const Ellipsoid<Scalar, 3>& bound) noexcept {
    if (const Status status = validated(bound); status != Status::ok) {
      return status;
    }
    known_.vector_bound = with_least_width(bound);
    known_.has_vector_bound = true;
    if (known_.has_attitude) {
      confine(known_.set);
    }
    return Status::ok;
  }

  /// Forgets everything but the bound of the vector: attitude, measurements of the vector, and what was dropped. Use it to go on
  /// under `Policy::raise` if the past is wrong, or cannot be predicted.
  void forget() noexcept {
    constraints_.count = 0;
    known_.has_attitude = false;
    known_.has_vector = false;
    trust_ = {};
    claim_ = Claim::none;
  }

  [[nodiscard]] const Scalar& time() const noexcept { return time_; }
  [[nodiscard]] const Flow& flow() const noexcept { return flow_; }
  [[nodiscard]] const Settings& settings() const noexcept { return settings_; }
  [[nodiscard]] Claim claim() const noexcept { return claim_; }
  /// Whether there is a set; `ellipsoid` is meaningless otherwise.
  [[nodiscard]] bool knows_attitude() const noexcept { return known_.has_attitude; }
  [[nodiscard]] const Set& ellipsoid() const noexcept { return known_.set; }
  /// Whether the angular velocity or the bias is known while the attitude is not; `vector` is meaningless otherwise.
  [[nodiscard]] bool knows_vector() const noexcept { return known_.has_vector; }
  [[nodiscard]] const Ellipsoid<Scalar, 3>& vector() const noexcept { return known_.vector; }
  /// Whether the set, of the attitude or of the vector, rests on what was dropped, and what updates have shown since.
  [[nodiscard]] const Trust& trust() const noexcept { return trust_; }

  /// How far the attitude of the set's center may be off: the tilt, the turn about the vertical, and in all. Each is a question of
  /// its own to the set, and after an update with `keeps_constraints` to the measurements and the prediction that it came from; then
  /// the answers are sharper than the set. (theory, section 16.11)
  /// \param vertical in reference axes, of any length.
  /// \return `unbounded` without a set; `not_finite`; `zero_direction`.
  [[nodiscard]] Status bounds(const Vector3<Scalar>& vertical, AttitudeBounds<Scalar>& result) const noexcept {
    if (!scalar::all_finite(vertical)) {
      return Status::not_finite;
    }
    if (!(vertical.cwiseAbs().maxCoeff() > Scalar(0))) {
      return Status::zero_direction;
    }
    if (!known_.has_attitude) {
      return Status::unbounded;
    }
    const Vector3<Scalar> body =
        scalar::unit(Vector3<Scalar>(known_.set.center.attitude.transpose().lazyProduct(scalar::unit(vertical))));
    const Ellipsoid<Scalar, 3> set = detail::attitude_of(known_.set);
    const Status status = attitude_bounds(set, constraints_.quadrics.data(), constraints_.count, body, result);
    // Constraints that nothing satisfies, though fusion found no contradiction: no more than the set is claimed then.
    return status == Status::empty_intersection ? attitude_bounds(set, constraints_.quadrics.data(), 0, body, result)
                                                : status;
  }

  /// Restores a stored filter bit for bit, after `make` with its settings and time, and `bound_vector`.
  /// \param set its set, or null if it did not know the attitude.
  /// \param vector what it knew without the attitude, or null.
  /// \return `out_of_range` of both, or of a negative count; the status of `start` and `bound_vector`.
  [[nodiscard]] Status resume(const Set* set, const Ellipsoid<Scalar, 3>* vector, const Trust& trust) noexcept {
    if (trust.agreeing_updates() < 0 || trust.disputed_updates() < 0 || (set != nullptr && vector != nullptr)) {
      return Status::out_of_range;
    }
    if (set != nullptr) {
      if (const Status status = start(*set); status != Status::ok) {
        return status;
      }
    } else if (vector != nullptr) {
      if (const Status status = validated(*vector); status != Status::ok) {
        return status;
      }
      known_.vector = *vector;
    }
    known_.has_attitude = set != nullptr;
    known_.has_vector = vector != nullptr;
    trust_ = trust;
    claim_ = present_claim();
    return Status::ok;
  }

  /// Moves the set to a later time. If it has become too large to be bounded the attitude is forgotten, and what is known of
  /// the vector is kept. So it is, but under `Policy::raise`, if this set cannot be predicted where another can be: a wrong rate
  /// may be one that no step is short enough for.
  /// \return the status of the flow, but for `unbounded`; `out_of_range` of a time before the filter's, or under `Policy::raise` of a
  /// gyro's turn beyond the `FilterDomain`, which is else unbounded.
  [[nodiscard]] Status predict(const Scalar& time, const Input& input) noexcept {
    return predict_by(time, input, [&](const Scalar& duration, const Set& set, Set& predicted) {
      return predicted_set(duration, input, set, predicted);
    });
  }

  /// Moves the set of a gyro's filter over a turn that is known but for an angle, however it was measured: rates that were added
  /// up, of which the errors partly cancel, or a turntable. One filter may be copied and predicted to many times, so that each
  /// row of a log is predicted from one before it in one piece. (theory, section 18.6)
  /// \param turn rotation vector in the body axes at the filter's time, rad.
  /// \param angle of the turn that is added to it, rad; anything from π on says nothing of the attitude.
  /// \return the status of `predict`, and `out_of_range` of a negative angle.
  [[nodiscard]] Status predict_turn(const Scalar& time, const Vector3<Scalar>& turn, const Scalar& angle) noexcept {
    static_assert(!measures_rate, "a rigid body's flow predicts the angular velocity, which a turn does not tell");
    if (!scalar::all_finite(turn) || !(angle == angle)) {
      return Status::not_finite;
    }
    if (!(angle >= Scalar(0))) {
      return Status::out_of_range;
    }
    return predict_by(time, Input{}, [&](const Scalar& duration, const Set& set, Set& predicted) {
      if (!scalar::isfinite(duration)) {
        return Status::not_finite;
      }
      if (turns_too_far(turn)) {
        return beyond_all_turns();
      }
      if (!settings_.estimates_vector && known_.has_vector_bound) {
        return flow_.predict_attitude_turn(duration, turn, angle, known_.vector_bound, set, predicted);
      }
      return flow_.predict_turn(duration, turn, angle, set, predicted);
    });
  }

  /// Fuses all measurements of one moment with the prediction, at once. If the attitude is not known, they may start it.
  /// \return what the measurements' `validate` says; `out_of_range` of too many directions, of an angular velocity given to a
  /// gyro's filter, which has it as input, or, where nothing may be left out, of one beyond the `FilterDomain`, or of more than
  /// eight measurements of which some may be wrong; `empty_intersection` if they contradict the prediction, or each other, and
  /// the policy is to say so.
  [[nodiscard]] Status update(const Measurements<Scalar>& measurements, GuaranteedUpdate<Scalar>& update) noexcept {
    if (measurements.direction_count > most_directions ||
        (!measures_rate && measurements.angular_velocity != nullptr)) {
      return Status::out_of_range;
    }
    const Sensors given = detail::sensors::present(measurements);
    Sensors beyond = 0;
    if (const Status status = find_impossible(measurements, beyond); status != Status::ok) {
      return status;
    }
    const Sensors all = given & ~beyond;
    GuaranteedUpdate<Scalar> result;
    const detail::SetSolver<State> solver = solver_of(measurements);
    Solution solution;
    Status status = Status::ok;
    if (may_be_wrong() && given != 0) {
      if (detail::sensors::number_of(given) > 8) {
        return Status::out_of_range;
      }
      status = detail::UnionOfChoices<State>(solver, all, settings_.most_wrong - detail::sensors::number_of(beyond))
                   .find(solution, result);
    } else {
      status = solver.solve(all, Past::used, nullptr, solution);
      detail::count_fusion(solution.fusion, result);
      if (status == Status::ok) {
        result.margin = solution.fusion.margin;
      } else if (status != Status::unbounded) {
        if (const Status invalid = detail::sensors::checked(measurements, Status::ok); invalid != Status::ok) {
          return invalid;
        }
        // Measurements that are valid one by one but cannot be combined are treated like a contradiction, but not reported as one.
        const bool empty = status == Status::empty_intersection;
        result.margin = empty ? solution.fusion.margin : Scalar(-1);
        result.contradicting = empty ? detail::sensors::at(all, solution.fusion.contradiction) : 0;
        if (const Status resolved = detail::resolve(solver, settings_.policy, all, solution, result);
            resolved != Status::empty_intersection) {
          status = resolved;
        }
      }
      if (beyond != 0) {
        result.margin = Scalar(-1);
        result.contradicting = beyond;
      }
    }
    if (status == Status::empty_intersection) {
      report_contradiction(result, update);
    }
    if (status != Status::ok && status != Status::unbounded) {
      return status;
    }
    result.dropped |= beyond;
    return accept(measurements, all, status == Status::ok, solution, result, update);
  }

  /// One linear measurement of the error [ζ; δ] about the present center.
  /// \return the status of `to_quadric` and `minimal_intersection`; `unbounded` if the attitude is not known, or the set is not in
  /// the `FilterDomain` afterwards.
  template <int Rows>
  [[nodiscard]] Status update(const LinearMeasurement<Scalar, Rows>& measurement,
                              GuaranteedUpdate<Scalar>& update) noexcept {
    if (!known_.has_attitude) {
      return Status::unbounded;
    }
    LinearMeasurement<Scalar, Rows> seen = measurement;
    if (!settings_.estimates_vector && known_.has_vector_bound) {
      if (const Status status = without_vector(seen); status != Status::ok) {
        return status;
      }
    }
    Quadric<Scalar, 6> quadric;
    if (const Status status = to_quadric(seen, known_.set, quadric); status != Status::ok) {
      return status;
    }
    QuadricFusion<Scalar, 6> fusion;
    Status status = Status::ok;
    if (settings_.estimates_vector) {
      const Ellipsoid<Scalar, 6> predicted = known_.set.in_coordinates();
      status = minimal_intersection(&predicted, &quadric, 1, settings_.criterion, fusion);
    } else {
      QuadricFusion<Scalar, 3> found;
      found.margin = Scalar(1);
      const Ellipsoid<Scalar, 3> predicted = detail::attitude_of(known_.set);
      const Quadric<Scalar, 3> of_attitude{quadric.a.template topLeftCorner<3, 3>(), quadric.g.template head<3>(),
                                           quadric.c};
      status =
          minimal_intersection(&predicted, &of_attitude, 1, detail::attitude_criterion(settings_.criterion), found);
      fusion.margin = found.margin;
      fusion.steps = found.steps;
      fusion.ended_by_limit = found.ended_by_limit;
      if (status == Status::ok) {
        fusion.prediction_alone = found.prediction_alone;
        fusion.set.center << found.set.center, Vector3<Scalar>::Zero();
        fusion.set.shape = detail::product_shape(found.set.shape, known_.vector_bound.shape);
      }
    }
    if (status != Status::ok) {
      if (status == Status::empty_intersection) {
        report_contradiction({Claim::none, false, 0, fusion.margin, 0, 1, fusion.steps, fusion.ended_by_limit}, update);
      }
      return status;
    }
    if (!fusion.prediction_alone) {
      Set next;
      if (const Status placed = place(known_.set.center, fusion.set, next); placed != Status::ok) {
        return placed;
      }
      known_.set = next;
      constraints_.count = 0;
    }
    update = {claim_, true, 0, fusion.margin, 0, 1, fusion.steps, fusion.ended_by_limit};
    return Status::ok;
  }

 private:
  using Solution = detail::Solution<State>;
  using Past = typename detail::SetSolver<State>::Past;

  [[nodiscard]] detail::SetSolver<State> solver_of(const Measurements<Scalar>& measurements) const noexcept {
    return {known_, settings_.criterion, settings_.estimates_vector, measurements};
  }

  /// \param beyond impossible measurements, which are left out: an angular velocity beyond the `FilterDomain`.
  /// \return the status of its `validate`; `out_of_range` where nothing may be left out.
  [[nodiscard]] Status find_impossible(const Measurements<Scalar>& measurements, Sensors& beyond) const noexcept {
    if (measurements.angular_velocity == nullptr) {
      return Status::ok;
    }
    const AngularVelocity<Scalar>& rate = *measurements.angular_velocity;
    if (const Status status = validate(rate); status != Status::ok) {
      return status;
    }
    if (!in_domain(Ellipsoid<Scalar, 3>{rate.value, rate.bound})) {
      if (settings_.policy == Policy::raise || (settings_.policy == Policy::relaxed && settings_.most_wrong == 0)) {
        return Status::out_of_range;
      }
      beyond = angular_velocity_bit;
    }
    return Status::ok;
  }

  /// What an update reports that has changed nothing else.
  static void report_contradiction(const GuaranteedUpdate<Scalar>& result, GuaranteedUpdate<Scalar>& update) noexcept {
    update.margin = result.margin;
    update.contradicting = result.contradicting;
    update.fusions = result.fusions;
    update.steps = result.steps;
    update.ended_by_limit = result.ended_by_limit;
  }

  [[nodiscard]] bool may_be_wrong() const noexcept {
    return settings_.policy == Policy::relaxed && settings_.most_wrong > 0;
  }

  [[nodiscard]] Claim present_claim() const noexcept {
    return !known_.has_attitude ? Claim::none : trust_.rests_on_drops() ? Claim::conditional : Claim::unconditional;
  }

  /// \return the status of `validate` for an ellipsoid of the vector; `not_positive_definite`; `out_of_range` beyond the domain.
  [[nodiscard]] static Status validated(const Ellipsoid<Scalar, 3>& vector) noexcept {
    if (const Status status = validate(vector); status != Status::ok) {
      return status;
    }
    Matrix3<Scalar> factor;
    if (const Status status = cholesky(vector.shape, factor); status != Status::ok) {
      return status;
    }
    return in_domain(vector) ? Status::ok : Status::out_of_range;
  }

  /// If the vector is left to its bound, nothing else is known about it.
  void confine(Set& set) const noexcept {
    if constexpr (!measures_rate) {
      if (!settings_.estimates_vector && known_.has_vector_bound) {
        set.center.gyro_bias = known_.vector_bound.center;
        set.shape =
            detail::product_shape(Matrix3<Scalar>(set.shape.template topLeftCorner<3, 3>()), known_.vector_bound.shape);
      }
    }
  }

  /// \param move from a duration and a set to the set that is predicted, as `Flow::predict`.
  template <typename Move>
  [[nodiscard]] Status predict_by(const Scalar& time, const Input& input, const Move& move) noexcept {
    const Scalar duration = time - time_;
    if (known_.has_attitude) {
      Set predicted;
      Status status = move(duration, known_.set, predicted);
      // A rigid body's flow has factored the shape itself.
      if (status == Status::ok && (measures_rate ? in_domain(predicted) : can_be_kept(predicted))) {
        known_.set = predicted;
        constraints_.count = 0;
        time_ = time;
        return Status::ok;
      }
      status = status == Status::ok ? Status::unbounded : status;
      if (status == Status::interrupted ||
          (status != Status::unbounded && (settings_.policy == Policy::raise || !predicts_another(duration, move)))) {
        return status;
      }
    }
    Ellipsoid<Scalar, 3> vector = known_.has_attitude ? detail::vector_of(known_.set) : known_.vector;
    bool has_vector = settings_.estimates_vector && (known_.has_attitude || known_.has_vector);
    if (has_vector) {
      const Status status = flow_.predict_vector(time_, duration, input, vector, vector);
      // What was given so flat that its factor is rounding has none after a turn: nothing can be made of it.
      const bool is_flat = status == Status::not_positive_definite && settings_.policy != Policy::raise;
      if (status != Status::ok && status != Status::beyond_domain && !is_flat) {
        return status;
      }
      has_vector = status == Status::ok && can_be_kept(vector);
    } else if (!scalar::isfinite(duration)) {
      return Status::not_finite;
    } else if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    known_.vector = vector;
    known_.has_vector = has_vector;
    known_.has_attitude = false;
    if (!has_vector) {
      trust_ = {};  // nothing is left that could rest on what was dropped
    }
    claim_ = Claim::none;
    time_ = time;
    return Status::ok;
  }

  [[nodiscard]] Status predicted_set(const Scalar& duration, const Input& input, const Set& set,
                                     Set& predicted) const noexcept {
    if constexpr (!measures_rate) {
      const Vector3<Scalar> turn = duration * input.angular_velocity;
      if (scalar::isfinite(duration) && scalar::all_finite(input.angular_velocity) && turns_too_far(turn)) {
        return beyond_all_turns();
      }
      if (!settings_.estimates_vector && known_.has_vector_bound) {
        return flow_.predict_attitude(time_, duration, input, known_.vector_bound, set, predicted);
      }
    }
    return flow_.predict(time_, duration, input, set, predicted);
  }

  [[nodiscard]] static bool turns_too_far(const Vector3<Scalar>& turn) noexcept {
    return !(turn.cwiseAbs().maxCoeff() <= FilterDomain<Scalar>::largest());
  }

  [[nodiscard]] Status beyond_all_turns() const noexcept {
    return settings_.policy == Policy::raise ? Status::out_of_range : Status::unbounded;
  }

  /// Whether a prediction fails because of the set and not because of the input: a small set at rest can be predicted.
  template <typename Move>
  [[nodiscard]] bool predicts_another(const Scalar& duration, const Move& move) const noexcept {
    Set another{{known_.set.center.attitude, Vector3<Scalar>::Zero()}, Matrix6<Scalar>::Identity()};
    another.shape *= scalar::constant<Scalar>(1e-6L);
    Set ignored;
    const Status status = move(duration, another, ignored);
    return status == Status::ok || status == Status::unbounded;
  }

  /// y = H [ζ; δ] + v with δ in its bound: H_δ δ is one more error.
  template <int Rows>
  [[nodiscard]] Status without_vector(LinearMeasurement<Scalar, Rows>& measurement) const noexcept {
    if (!scalar::all_finite(measurement.h) || !scalar::all_finite(measurement.bound)) {
      return Status::not_finite;
    }
    const Matrix<Scalar, Rows, 3> h = measurement.h.template rightCols<3>();
    const Matrix<Scalar, Rows> added = congruence(h, known_.vector_bound.shape);
    if (added.trace() > Scalar(0)) {
      const Matrix<Scalar, Rows> sum = sum_of_shapes(measurement.bound, added);
      measurement.bound =
          (scalar::constant<Scalar>(0.5L) + rounding::share<Scalar>(rounding::small_sum)) * (sum + sum.transpose());
      measurement.h.template rightCols<3>().setZero();
    }
    return Status::ok;
  }

  /// A set of errors about a center put about its own. All sets but predictions come this way.
  /// \return `unbounded` if it may hold half turns, or cannot be kept.
  [[nodiscard]] Status place(const State& center, const Ellipsoid<Scalar, 6>& errors, Set& next) const noexcept {
    Set placed;
    if (recentred(center, errors, placed) != Status::ok) {
      return Status::unbounded;
    }
    confine(placed);
    if (!can_be_kept(placed)) {
      return Status::unbounded;
    }
    next = placed;
    return Status::ok;
  }

  /// Takes up a solution, or, where the attitude remains unknown, what was measured of the vector. Nothing is taken up that the
  /// filter may not keep.
  [[nodiscard]] Status accept(const Measurements<Scalar>& measurements, Sensors all, bool bounded,
                              const Solution& solution, GuaranteedUpdate<Scalar>& result,
                              GuaranteedUpdate<Scalar>& update) noexcept {
    Set next = known_.set;
    bool used_prediction = bounded && solution.used_prediction;
    if (bounded && !(solution.used_prediction && solution.fusion.prediction_alone)) {
      // Where it is not: the measurements say too little, and what was kept is kept.
      bounded = place(solution.center, solution.fusion.set, next) == Status::ok;
      used_prediction = used_prediction && bounded;
    }
    Trust trust = trust_;
    if (all != 0 || result.dropped != 0) {
      // Where nothing is taken up there is nothing that could rest on what was left out; but a vector that is known without an
      // attitude may be what the measurements contradict.
      const bool contradicted = result.margin < Scalar(0) || (!may_be_wrong() && result.dropped != 0);
      trust.count(contradicted, bounded || known_.has_attitude || known_.has_vector);
    }
    if (trust.past_is_due(settings_.regain_after)) {
      Solution alone;
      const Status status = solver_of(measurements).solve(all, Past::forgotten, nullptr, alone);
      detail::count_fusion(alone.fusion, result);
      if (status == Status::ok && place(alone.center, alone.fusion.set, next) == Status::ok) {
        trust.give_up_past(settings_.regain_after);
        result.dropped &= ~all;
        bounded = true;
        used_prediction = false;
      }
    }
    Ellipsoid<Scalar, 3> vector = known_.vector;
    bool has_vector = known_.has_vector;
    if (!bounded && !known_.has_attitude && !may_be_wrong() && (all & angular_velocity_bit & ~result.dropped) != 0) {
      if (const Status status = take_up(*measurements.angular_velocity, trust, vector, result); status != Status::ok) {
        if (status == Status::empty_intersection) {
          result.contradicting = angular_velocity_bit;
          report_contradiction(result, update);
        }
        return status;
      }
      has_vector = true;
    }
    if (bounded) {
      const Sensors used = may_be_wrong() ? 0 : all & ~result.dropped;
      keep_constraints(measurements, used, used_prediction && !may_be_wrong(), next.center.attitude);
      known_.set = next;
    }
    known_.has_attitude = known_.has_attitude || bounded;
    known_.vector = vector;
    known_.has_vector = has_vector && !known_.has_attitude;
    trust_ = trust;
    claim_ = present_claim();
    result.claim = claim_;
    result.prediction_used = used_prediction;
    update = result;
    return Status::ok;
  }

  /// Keeps what the set comes from, as seen from its center.
  /// \param with_prediction whether the prediction, which is still `known_.set`, is part of it.
  void keep_constraints(const Measurements<Scalar>& measurements, Sensors used, bool with_prediction,
                        const Matrix3<Scalar>& center) noexcept {
    constraints_.count = 0;
    if (!settings_.keeps_constraints) {
      return;
    }
    Quadric<Scalar, 3> quadric;
    const Matrix3<Scalar> predicted = known_.set.shape.template topLeftCorner<3, 3>();
    if (with_prediction && to_quadric(center, known_.set.center.attitude, predicted, quadric) == Status::ok) {
      constraints_.add(quadric);
    }
    for (std::size_t i = 0; i < measurements.direction_count; ++i) {
      if ((used & direction_bit(i)) != 0 && cone(center, measurements.directions[i], quadric) == Status::ok) {
        constraints_.add(quadric);
      }
    }
    if ((used & attitude_bit) != 0 && to_quadric(center, *measurements.attitude, quadric) == Status::ok) {
      constraints_.add(quadric);
    }
  }

  /// Where the attitude is unknown: what an angular velocity says of the vector, with what was known of it or in its place.
  /// \param vector what is known of it, if anything is.
  /// \return the status of `fused_vector`, where nothing may be left out.
  [[nodiscard]] Status take_up(const AngularVelocity<Scalar>& rate, Trust& trust, Ellipsoid<Scalar, 3>& vector,
                               GuaranteedUpdate<Scalar>& result) const noexcept {
    const Ellipsoid<Scalar, 3> measured = with_least_width(Ellipsoid<Scalar, 3>{rate.value, rate.bound});
    const Status status = known_.has_vector ? fused_vector(measured, vector, result.margin) : Status::ok;
    const bool may_drop = settings_.policy == Policy::drop_measurement || settings_.policy == Policy::restart;
    if (status != Status::ok && !may_drop) {
      return status;
    }
    if (status != Status::ok) {
      trust = trust_;
      trust.count(true, true);
    }
    const bool is_due = trust.past_is_due(settings_.regain_after);
    if (is_due) {
      trust.give_up_past(settings_.regain_after);
    }
    if (!known_.has_vector || is_due || (status != Status::ok && settings_.policy == Policy::restart)) {
      vector = measured;
    } else if (status != Status::ok) {
      result.dropped |= angular_velocity_bit;
    }
    return Status::ok;
  }

  /// The set of the vector: its bound, what is known, and what was measured.
  /// \param margin set after `empty_intersection`.
  [[nodiscard]] static Status fused_vector(const Ellipsoid<Scalar, 3>& measured, Ellipsoid<Scalar, 3>& vector,
                                           Scalar& margin) noexcept {
    Quadric<Scalar, 3> quadric;
    if (const Status status =
            to_quadric(Ellipsoid<Scalar, 3>{measured.center - vector.center, measured.shape}, quadric);
        status != Status::ok) {
      return status;
    }
    const Ellipsoid<Scalar, 3> known{Vector3<Scalar>::Zero(), vector.shape};
    QuadricFusion<Scalar, 3> fusion;
    const Status status = minimal_intersection(&known, &quadric, 1, SizeCriterion<Scalar, 3>::volume(), fusion);
    if (status == Status::empty_intersection) {
      margin = fusion.margin;
    }
    if (status != Status::ok) {
      return status;
    }
    const Ellipsoid<Scalar, 3> fused{vector.center + fusion.set.center, fusion.set.shape};
    if (can_be_kept(fused)) {
      vector = fused;
    }
    return Status::ok;
  }

  Flow flow_;
  Settings settings_;
  Scalar time_{0};
  detail::Knowledge<State> known_;
  detail::KeptConstraints<Scalar> constraints_;
  Trust trust_;  // in the set, of the attitude or of the vector
  Claim claim_ = Claim::none;
};

}  // namespace elliptude
