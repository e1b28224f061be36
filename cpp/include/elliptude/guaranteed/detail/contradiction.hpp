#pragma once

/// \file
/// What a guaranteed filter does if measurements contradict its set, or may be wrong: which to leave out, and the union
/// over all choices. (theory, sections 16.8 and 16.10)

#include "elliptude/guaranteed/detail/solution.hpp"
#include "elliptude/guaranteed/detail/union_set.hpp"
#include "elliptude/guaranteed/policy.hpp"

namespace elliptude::detail {

/// Counts a fusion in the report of an update.
template <typename Scalar>
void count_fusion(const QuadricFusion<Scalar, 6>& fusion, GuaranteedUpdate<Scalar>& result) noexcept {
  ++result.fusions;
  result.steps += fusion.steps;
  result.ended_by_limit = result.ended_by_limit || fusion.ended_by_limit;
}

/// Resolves a contradiction by the policy.
/// \return `unbounded` if measurements that contradict each other are all left out, and the attitude remains unknown.
template <typename State>
[[nodiscard]] Status resolve(const SetSolver<State>& solver, Policy policy, Sensors all, Solution<State>& solution,
                             GuaranteedUpdate<StateScalar<State>>& result) noexcept {
  using Scalar = StateScalar<State>;
  using Past = typename SetSolver<State>::Past;
  const Knowledge<State>& known = solver.known;
  const bool restarts = is_policy(policy, Policy::restart);
  if (!restarts && !is_policy(policy, Policy::drop_measurement)) {
    return Status::empty_intersection;
  }
  if (restarts && (known.has_attitude || known.has_vector)) {
    Solution<State> alone;
    const Status status = solver.solve(all, Past::forgotten, nullptr, alone);
    count_fusion(alone.fusion, result);
    if (status == Status::ok) {
      solution = alone;
      return Status::ok;
    }
  }
  // The fewest that have to go; among as many, those without which the others agree best.
  const auto attempt = [&](Sensors dropped, Scalar& best) {
    Solution<State> trial;
    const Sensors kept = all & ~dropped;
    if (kept == 0 && !known.has_attitude) {
      return;
    }
    const Status status = solver.solve(kept, Past::used, nullptr, trial);
    count_fusion(trial.fusion, result);
    if (status == Status::ok && (result.dropped == 0 || trial.fusion.margin > best)) {
      best = trial.fusion.margin;
      result.dropped = dropped;
      solution = trial;
    }
  };
  Scalar best(0);
  for (Sensors rest = all; rest != 0; rest &= rest - 1) {
    attempt(sensors::lowest(rest), best);
  }
  if (result.dropped == 0) {
    for (Sensors first = all; first != 0; first &= first - 1) {
      for (Sensors second = first & (first - 1); second != 0; second &= second - 1) {
        attempt(sensors::lowest(first) | sensors::lowest(second), best);
      }
    }
  }
  if (result.dropped == 0) {
    attempt(all, best);
  }
  if (result.dropped != 0) {
    return Status::ok;
  }
  // Without any of them, because nothing shows which ones are right. Without a prediction the angular velocity does not
  // need them.
  result.dropped = known.has_attitude ? all : all & ~angular_velocity_bit;
  return result.dropped != 0 ? Status::unbounded : Status::empty_intersection;
}

/// All states that the prediction allows and that at most `wrong` measurements exclude: the union over what may be left
/// out, in one ellipsoid, and that within the prediction, which holds them all. (theory, section 16.10)
template <typename State>
class UnionOfChoices {
 public:
  using Scalar = StateScalar<State>;
  using Past = typename SetSolver<State>::Past;

  UnionOfChoices(const SetSolver<State>& solver, Sensors all, int wrong) noexcept
      : solver_(solver), known_(solver.known), all_(all), wrong_(wrong) {}

  /// Measurements that every consistent choice leaves out are proved wrong, and are in `result.dropped`.
  /// \return `unbounded` without a set; `empty_intersection` if no choice is consistent; the status of `validate` for
  /// the measurements.
  [[nodiscard]] Status find(Solution<State>& solution, GuaranteedUpdate<Scalar>& result) noexcept {
    if (const Status status = sensors::checked(solver_.measurements, Status::ok); status != Status::ok) {
      return status;
    }
    // All choices use the same coordinates. An angular velocity or an attitude that may be wrong should not determine
    // them.
    center_ = known_.set.center;
    if (!known_.has_attitude &&
        solver_.measured_center(all_ & ~angular_velocity_bit & ~attitude_bit, Past::used, center_) != Status::ok &&
        solver_.measured_center(all_, Past::used, center_) != Status::ok) {
      return Status::unbounded;
    }
    result.margin = Scalar(-1);
    sensors::for_each_choice(all_, wrong_, [&](Sensors kept) { add(kept, solution, result); });
    if (failure_ != Status::ok) {
      result.margin = Scalar(1);  // not all choices were tried: nothing is known to contradict
      result.contradicting = 0;
    }
    if (failure_ != Status::ok && !known_.has_attitude) {
      return Status::unbounded;
    }
    if (failure_ == Status::ok && !found_) {
      return Status::empty_intersection;
    }
    if (failure_ == Status::ok) {
      result.dropped = proved_wrong(result);
    }
    solution.used_prediction = known_.has_attitude && (uses_prediction_ || alone_ || failure_ != Status::ok);
    if (known_.has_attitude) {
      keep_within_prediction(solution);
    }
    solution.fusion.prediction_alone = alone_;
    return Status::ok;
  }

 private:
  /// Adds the set that the measurements of one choice leave possible to the union.
  void add(Sensors kept, Solution<State>& solution, GuaranteedUpdate<Scalar>& result) noexcept {
    if (failure_ != Status::ok) {
      return;  // if one choice leaves the set unbounded, the union is unbounded
    }
    Solution<State> trial;
    Status status = known_.has_attitude ? Status::ok : Status::unbounded;
    if (known_.has_attitude || kept != 0) {
      status = solver_.solve(kept, Past::used, &center_, trial);
      count_fusion(trial.fusion, result);
    }
    if (status == Status::empty_intersection) {
      result.contradicting = sensors::at(kept, trial.fusion.contradiction);
      return;
    }
    if (status != Status::ok) {
      failure_ = status;
      return;
    }
    kept_by_some_ |= kept;
    result.margin = trial.fusion.margin > result.margin ? trial.fusion.margin : result.margin;
    uses_prediction_ = uses_prediction_ && trial.used_prediction;
    alone_ = alone_ || trial.fusion.prediction_alone;
    if (!found_) {
      solution = trial;
      found_ = true;
    } else if (!alone_) {
      failure_ = enclosing(solution.fusion.set, trial.fusion.set, solution.fusion.set);
    }
  }

  [[nodiscard]] Sensors proved_wrong(GuaranteedUpdate<Scalar>& result) noexcept {
    if (wrong_ >= sensors::number_of(all_)) {
      // All may be wrong: one is proved so if it contradicts what is known by itself.
      for (Sensors rest = all_; rest != 0; rest &= rest - 1) {
        Solution<State> trial;
        const Sensors one = sensors::lowest(rest);
        const Status status = solver_.solve(one, Past::used, &center_, trial);
        count_fusion(trial.fusion, result);
        if (status != Status::empty_intersection) {
          kept_by_some_ |= one;
        }
      }
    }
    return all_ & ~kept_by_some_;
  }

  void keep_within_prediction(Solution<State>& solution) noexcept {
    const Ellipsoid<Scalar, 6> predicted = known_.set.in_coordinates();
    alone_ = alone_ || failure_ != Status::ok;
    if (!alone_ && solver_.estimates_vector) {
      solution.fusion.set = within_prediction(predicted, solution.fusion.set, solver_.criterion, alone_);
    } else if (!alone_) {
      const Ellipsoid<Scalar, 3> joined{solution.fusion.set.center.template head<3>(),
                                        solution.fusion.set.shape.template topLeftCorner<3, 3>()};
      const Ellipsoid<Scalar, 3> attitude =
          within_prediction(attitude_of(known_.set), joined, solver_.criterion.template of_first<3>(), alone_);
      solution.fusion.set.center << attitude.center, Vector3<Scalar>::Zero();
      solution.fusion.set.shape = product_shape(attitude.shape, known_.vector_bound.shape);
    }
    if (alone_) {
      solution.center = known_.set.center;
      solution.fusion.set = predicted;
      solution.used_prediction = true;
    }
  }

  const SetSolver<State>& solver_;
  const Knowledge<State>& known_;
  Sensors all_;
  int wrong_;
  State center_;
  Status failure_ = Status::ok;
  bool found_ = false;
  bool uses_prediction_ = true;
  bool alone_ = false;  // whether some choice says no more than the prediction
  Sensors kept_by_some_ = 0;
};

}  // namespace elliptude::detail
