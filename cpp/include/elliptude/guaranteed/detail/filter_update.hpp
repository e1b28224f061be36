#pragma once

/// \file
/// A guaranteed filter's update by the measurements of one moment: the fusion, what a contradiction leads to, and what
/// is taken up. (theory, sections 16.5 to 16.11)

#include <utility>

#include "elliptude/guaranteed/detail/contradiction.hpp"
#include "elliptude/guaranteed/detail/filter_memory.hpp"
#include "elliptude/guaranteed/update_constraints.hpp"

namespace elliptude::detail {

/// Copies into the caller's report how measurements contradicted, where nothing else of the filter changes.
template <typename Scalar>
void report_contradiction(const GuaranteedUpdate<Scalar>& result, GuaranteedUpdate<Scalar>& update) noexcept {
  update.margin = result.margin;
  update.contradicting = result.contradicting;
  update.fusions = result.fusions;
  update.steps = result.steps;
  update.ended_by_limit = result.ended_by_limit;
}

/// An update of what a filter knows.
template <typename Flow>
class FilterUpdate {
 public:
  using Memory = FilterMemory<Flow>;
  using State = typename Memory::State;
  using Scalar = typename Memory::Scalar;
  using Set = typename Memory::Set;
  using Solution = detail::Solution<State>;
  using Past = typename SetSolver<State>::Past;
  /// A measurement of the vector, its bound, and what is known of it.
  using VectorSets = std::array<Ellipsoid<Scalar, 3>, 3>;

  explicit FilterUpdate(Memory& filter) noexcept : filter_(filter) {}

  /// `GuaranteedFilter::update`.
  [[nodiscard]] Status run(const Measurements<Scalar>& measurements, GuaranteedUpdate<Scalar>& update) noexcept {
    update = GuaranteedUpdate<Scalar>{};
    update.claim = filter_.claim;
    if (measurements.direction_count > most_directions ||
        (measurements.direction_count > 0 && measurements.directions == nullptr) ||
        (!Memory::measures_rate && measurements.angular_velocity != nullptr) ||
        (only_directions && measurements.attitude != nullptr)) {
      return Status::out_of_range;
    }
    const Sensors given = sensors::present(measurements);
    Sensors beyond = 0;
    if (const Status status = find_impossible(measurements, beyond); status != Status::ok) {
      return status;
    }
    const Sensors all = given & ~beyond;
    GuaranteedUpdate<Scalar> result;
    const Status status = filter_.may_be_wrong() && given != 0 ? fuse_choices(measurements, given, beyond, result)
                                                               : fuse_all(measurements, all, beyond, result);
    if (status == Status::empty_intersection) {
      report_contradiction(result, update);
    }
    if (status != Status::ok && status != Status::unbounded) {
      return status;
    }
    result.dropped |= beyond;
    return accept(measurements, all, status == Status::ok, result, update);
  }

  /// Leaves what the set comes from, after a `run` that was `ok`, about the center of the fusion, where all of it is
  /// quadrics of attitude and vector together.
  /// \param before what the filter knew.
  void leave(const Knowledge<State>& before, const Measurements<Scalar>& measurements,
             UpdateConstraints<State>& constraints) const noexcept {
    const bool is_product = filter_.leaves_vector();
    if (!filter_.known.has_attitude) {
      constraints.forget();
      return;
    }
    if (!took_up_) {
      constraints = UpdateConstraints<State>::of(filter_.known.set, is_product);
      return;
    }
    constraints.set_about(solution_.center, solution_.fusion.set, filter_.known.set, is_product);
    const SetSolver<State> solver{before, filter_.settings.criterion, filter_.settings.estimates_vector, measurements};
    std::array<HalfQuadric<Scalar>, most_quadrics> quadrics;
    std::size_t count = 0;
    if (solver.collect(used_, Past::forgotten, solution_.center, quadrics, count) != Status::ok) {
      return;  // less sharp, and no less a bound
    }
    if (with_prediction_) {
      constraints.add_past(before.set.shape);
    }
    for (std::size_t k = 0; k < count; ++k) {
      constraints.add(quadrics[k]);
    }
  }

 private:
  /// The union over what may be wrong, of which impossible measurements are a part.
  [[nodiscard]] Status fuse_choices(const Measurements<Scalar>& measurements, Sensors given, Sensors beyond,
                                    GuaranteedUpdate<Scalar>& result) noexcept {
    if (sensors::number_of(given) > most_of_choices) {
      return Status::out_of_range;
    }
    const SetSolver<State> solver = filter_.solver_of(measurements);
    return UnionOfChoices<State>(solver, given & ~beyond, filter_.settings.most_wrong - sensors::number_of(beyond))
        .find(solution_, result);
  }

  /// All possible measurements at once, or, where they contradict what is known, what the policy leaves of them.
  [[nodiscard]] Status fuse_all(const Measurements<Scalar>& measurements, Sensors all, Sensors beyond,
                                GuaranteedUpdate<Scalar>& result) noexcept {
    const SetSolver<State> solver = filter_.solver_of(measurements);
    Status status = solver.solve(all, Past::used, nullptr, solution_);
    count_fusion(solution_.fusion, result);
    if (status == Status::ok) {
      result.margin = solution_.fusion.margin;
    } else if (status != Status::unbounded) {
      if (const Status invalid = sensors::checked(measurements, Status::ok); invalid != Status::ok) {
        return invalid;
      }
      // Measurements that are valid one by one but cannot be combined are treated like a contradiction, but not
      // reported as one.
      const bool empty = status == Status::empty_intersection;
      result.margin = empty ? solution_.fusion.margin : Scalar(-1);
      result.contradicting = empty ? sensors::at(all, solution_.fusion.contradiction) : 0;
      const Status resolved = resolve(solver, filter_.settings.policy, all, solution_, result);
      status = resolved == Status::empty_intersection ? status : resolved;
    }
    if (beyond != 0) {
      result.margin = Scalar(-1);
      result.contradicting = beyond;
    }
    return status;
  }

  static constexpr int most_of_choices = 8;  // measurements of which some may be wrong: 37 fusions at most

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
      if (filter_.has_policy(Policy::raise) ||
          (filter_.has_policy(Policy::relaxed) && filter_.settings.most_wrong == 0)) {
        return Status::out_of_range;
      }
      beyond = angular_velocity_bit;
    }
    return Status::ok;
  }

  /// Takes up a solution, or, where the attitude remains unknown, what was measured of the vector. Nothing is taken up
  /// that the filter may not keep.
  [[nodiscard]] Status accept(const Measurements<Scalar>& measurements, Sensors all, bool bounded,
                              GuaranteedUpdate<Scalar>& result, GuaranteedUpdate<Scalar>& update) noexcept {
    const Solution& solution = solution_;
    Set next = filter_.known.set;
    bool used_prediction = bounded && solution.used_prediction;
    if (bounded && !(solution.used_prediction && solution.fusion.prediction_alone)) {
      // Where it is not: the measurements say too little, and what was kept is kept.
      bounded = filter_.place(solution.center, solution.fusion.set, next) == Status::ok;
      used_prediction = used_prediction && bounded;
    }
    Trust trust = filter_.trust;
    if (all != 0 || result.dropped != 0) {
      // Where nothing is taken up there is nothing that could rest on what was left out; but a vector that is known
      // without an attitude may be what the measurements contradict.
      const bool contradicted = result.margin < Scalar(0) || (!filter_.may_be_wrong() && result.dropped != 0);
      trust.count(contradicted, bounded || filter_.known.has_attitude || filter_.known.has_vector);
    }
    if (may_drop && trust.past_is_due(filter_.settings.regain_after)) {
      Solution alone;
      const Status status = filter_.solver_of(measurements).solve(all, Past::forgotten, nullptr, alone);
      count_fusion(alone.fusion, result);
      if (status == Status::ok && filter_.place(alone.center, alone.fusion.set, next) == Status::ok) {
        trust.give_up_past(filter_.settings.regain_after);
        result.dropped &= ~all;
        bounded = true;
        used_prediction = false;
        solution_ = alone;
      }
    }
    Ellipsoid<Scalar, 3> vector = filter_.known.vector;
    bool has_vector = filter_.known.has_vector;
    if (!only_whole_states && !bounded && !filter_.known.has_attitude && !filter_.may_be_wrong() &&
        (all & angular_velocity_bit & ~result.dropped) != 0) {
      if (const Status status = take_up(*measurements.angular_velocity, trust, vector, has_vector, result);
          status != Status::ok) {
        if (status == Status::empty_intersection) {
          report_contradiction(result, update);
        }
        return status;
      }
    }
    if (bounded) {
      used_ = filter_.may_be_wrong() ? 0 : all & ~result.dropped;
      with_prediction_ = used_prediction && !filter_.may_be_wrong();
      keep_constraints(measurements, used_, with_prediction_, next.center.attitude);
      filter_.known.set = next;
    }
    took_up_ = bounded;
    filter_.known.has_attitude = filter_.known.has_attitude || bounded;
    filter_.known.vector = vector;
    filter_.known.has_vector = has_vector && !filter_.known.has_attitude;
    filter_.trust = trust;
    filter_.claim = filter_.present_claim();
    result.claim = filter_.claim;
    result.prediction_used = used_prediction;
    update = result;
    return Status::ok;
  }

  /// Keeps what the set comes from, as seen from its center.
  /// \param with_prediction whether the prediction, which is still the filter's set, is part of it.
  void keep_constraints(const Measurements<Scalar>& measurements, Sensors used, bool with_prediction,
                        const Matrix3<Scalar>& center) noexcept {
    filter_.constraints.count = 0;
    if (most_questioned == 0 || !filter_.settings.keeps_constraints) {
      return;
    }
    Quadric<Scalar, 3> quadric;
    const Matrix3<Scalar> predicted = filter_.known.set.shape.template topLeftCorner<3, 3>();
    if (with_prediction && to_quadric(center, filter_.known.set.center.attitude, predicted, quadric) == Status::ok) {
      filter_.constraints.add(quadric);
    }
    for (std::size_t i = 0; i < measurements.direction_count; ++i) {
      if ((used & direction_bit(i)) != 0 && cone(center, measurements.directions[i], quadric) == Status::ok) {
        filter_.constraints.add(quadric);
      }
    }
    if (!only_directions && (used & attitude_bit) != 0 &&
        to_quadric(center, *measurements.attitude, quadric) == Status::ok) {
      filter_.constraints.add(quadric);
    }
  }

  /// Where the attitude is unknown: what an angular velocity says of the vector within its bound, with what was known of
  /// it or in its place. (theory, section 16.8)
  /// \param vector what is known of it, if `has_vector`.
  /// \return the status of `common_vector`, where nothing may be left out.
  [[nodiscard]] Status take_up(const AngularVelocity<Scalar>& rate, Trust& trust, Ellipsoid<Scalar, 3>& vector,
                               bool& has_vector, GuaranteedUpdate<Scalar>& result) const noexcept {
    VectorSets sets{with_least_width(Ellipsoid<Scalar, 3>{rate.value, rate.bound})};
    std::size_t present = 1;
    if (filter_.known.has_vector_bound) {
      sets[present++] = filter_.known.vector_bound;
    }
    if (has_vector) {
      sets[present] = with_least_width(vector);
    }
    Ellipsoid<Scalar, 3> next;
    Status status = common_vector(sets, present + (has_vector ? 1 : 0), next, result.margin);
    if (status != Status::ok) {
      result.contradicting = status == Status::empty_intersection ? angular_velocity_bit : 0;
      if (!filter_.has_policy(Policy::drop_measurement) && !filter_.has_policy(Policy::restart)) {
        return status;
      }
      trust = filter_.trust;
      trust.count(true, has_vector);
    }
    const bool is_due = may_drop && trust.past_is_due(filter_.settings.regain_after);
    if (is_due || (status != Status::ok && filter_.has_policy(Policy::restart))) {
      Ellipsoid<Scalar, 3> alone;
      Scalar margin(1);
      // Where there is none, as rounding may have it of sets that hardly meet, the past is kept with what came of it.
      if (common_vector(sets, present, alone, margin) == Status::ok) {
        next = alone;
        status = Status::ok;
        if (is_due) {
          trust.give_up_past(filter_.settings.regain_after);
        }
      }
    }
    if (status == Status::ok) {
      vector = next;
      has_vector = true;
    } else {
      result.dropped |= angular_velocity_bit;
    }
    return Status::ok;
  }

  /// A set that holds what the first of these sets have in common, seen from the least of them: from far away a sharp
  /// set is lost in rounding.
  /// \param margin changed on failure.
  [[nodiscard]] static Status common_vector(VectorSets sets, std::size_t count, Ellipsoid<Scalar, 3>& common,
                                            Scalar& margin) noexcept {
    std::size_t least = 0;
    for (std::size_t i = 1; i < count; ++i) {
      least = sets[i].shape.trace() < sets[least].shape.trace() ? i : least;
    }
    std::swap(sets[0], sets[least]);
    common = sets[0];
    if (count == 1) {
      return Status::ok;
    }
    const Ellipsoid<Scalar, 3> seen{Vector3<Scalar>::Zero(), sets[0].shape};
    std::array<Quadric<Scalar, 3>, 2> quadrics;
    QuadricFusion<Scalar, 3> fusion;
    Status status = Status::ok;
    for (std::size_t i = 1; i < count && status == Status::ok; ++i) {
      status = to_quadric(Ellipsoid<Scalar, 3>{sets[i].center - sets[0].center, sets[i].shape}, quadrics[i - 1]);
    }
    if (status == Status::ok) {
      status = minimal_intersection(&seen, quadrics.data(), count - 1, SizeCriterion<Scalar, 3>::volume(), fusion);
    }
    if (status != Status::ok) {
      margin = status == Status::empty_intersection ? fusion.margin : Scalar(-1);
      return status;
    }
    const Ellipsoid<Scalar, 3> fused = moved_by(sets[0].center, fusion.set);
    if (can_be_kept(fused)) {
      common = fused;
    }
    return Status::ok;
  }

  /// A set that was seen from a vector, with what rounding of its center may do.
  [[nodiscard]] static Ellipsoid<Scalar, 3> moved_by(const Vector3<Scalar>& vector,
                                                     const Ellipsoid<Scalar, 3>& seen) noexcept {
    const Vector3<Scalar>& shift = seen.center;
    if (shift.isZero(Scalar(0))) {
      return {vector, seen.shape};
    }
    const Scalar slip =
        rounding::one_rounding<Scalar>() * scalar::sqrt(Scalar((vector.cwiseAbs() + shift.cwiseAbs()).squaredNorm()));
    return {vector + shift, enlarged(seen.shape, Matrix3<Scalar>((slip * slip) * Matrix3<Scalar>::Identity()))};
  }

  Memory& filter_;
  Solution solution_;  // that was found, or taken up in its place
  // Which measurements the set rests on that was taken up, and whether on the prediction.
  Sensors used_ = 0;
  bool with_prediction_ = false;
  bool took_up_ = false;
};

}  // namespace elliptude::detail
