#pragma once

/// \file
/// One trial of a fault campaign: a subject over some thirty moments, a fault for a few of them, and what came of it.

#include <cstdio>

#include "support/faults/subject.hpp"

namespace elliptude::faults {

/// What came of a fault.
struct Outcome {
  bool detected = false;  ///< a status, a contradiction, or a claim that was lowered
  int silent = 0;         ///< moments at which a set was claimed unconditionally and did not hold the truth
  int outside = 0;        ///< moments at which a set, whatever its claim, did not hold the truth
  int restarts = 0;
  bool good_at_end = false;      ///< an unconditional set that holds the truth
  int needed = 0;                ///< updates from the first contradiction after the fault until all was well for good
  const char* broken = nullptr;  ///< what may never be, if it was
};

/// Whether a shape is finite and positive definite, or not negative for filters of first order, but for its precision's rounding.
[[nodiscard]] inline bool is_valid(const Belief& belief, bool is_single) {
  const double epsilon = is_single ? 1.2e-7 : 2.3e-16;
  if (!std::isfinite(belief.time) || !belief.attitude.allFinite() || !belief.vector.allFinite() ||
      !belief.shape.allFinite() || !(belief.shape.diagonal().minCoeff() > 0)) {
    return false;
  }
  const Eigen::Matrix<double, 6, 1> scale = belief.shape.diagonal().cwiseSqrt().cwiseInverse();
  Matrix6d scaled = scale.asDiagonal() * belief.shape * scale.asDiagonal();
  scaled.diagonal().array() += 100 * epsilon;
  const bool is_rotation =
      (belief.attitude.transpose() * belief.attitude - Matrix3d::Identity()).norm() < 100 * epsilon;
  return is_rotation && belief.attitude.determinant() > 0 && scaled.llt().info() == Eigen::Success;
}

/// xᵀP⁻¹x of the truth, in the chart of the filter.
[[nodiscard]] inline double form(const Belief& belief, const World& world, bool is_guaranteed) {
  const Matrix3d turn = belief.attitude.transpose() * world.attitude();
  Eigen::Matrix<double, 6, 1> error;
  const Vector3d axis(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1));
  error << (is_guaranteed ? Vector3d(2 * axis / (1 + turn.trace())) : log(turn)), world.vector() - belief.vector;
  return error.dot(belief.shape.ldlt().solve(error));
}

/// Flight software around a filter: it makes the filter again where its memory is corrupted, and where it has refused three moments
/// without as many as `regain_after` in a row between them that agree. (docs/flight.md)
class Supervisor {
 public:
  Supervisor(Subject& subject, Outcome& outcome, int regain_after)
      : subject_(subject), outcome_(outcome), regain_after_(regain_after) {}

  /// Predicts to a moment and updates with it.
  /// \return whether the filter was told something, found nothing wrong, and was not made again.
  bool cycle(const Moment& moment) {
    contradicted_ = false;
    bool agrees = call([&] { return Answer{subject_.predict(moment)}; });
    agrees = agrees && call([&] { return subject_.update(moment); });
    agreeing_ = agrees ? agreeing_ + 1 : 0;
    refusals_ = agreeing_ >= regain_after_ ? 0 : refusals_ + (refused_ ? 1 : 0);
    if (subject_.check() != ELLIPTUDE_OK || refusals_ >= 3) {
      outcome_.detected = true;
      if (subject_.make(moment) == ELLIPTUDE_OK) {
        ++outcome_.restarts;
        refusals_ = 0;
        (void)call([&] { return subject_.update(moment); });
      }
      agrees = false;
    }
    refused_ = false;
    return agrees;
  }

  /// Whether an update of the last cycle found a contradiction.
  [[nodiscard]] bool contradicted() const { return contradicted_; }

  /// One call: what it refuses has changed nothing, and what it accepts has left a set as sets must be.
  template <typename Call>
  bool call(const Call& function) {
    const Belief before = subject_.belief();
    const Answer answer = function();
    const Belief after = subject_.belief();
    if (answer.status != ELLIPTUDE_OK && !(before == after)) {
      outcome_.broken = "a call that was refused has changed the filter";
    }
    if (answer.status == ELLIPTUDE_OK && after.knows && !is_valid(after, subject_.is_single())) {
      outcome_.broken = "ok, and a set that is not finite, not positive definite, or about no rotation";
    }
    // Five directions and a rate: all, without one, without two, alone, and what regaining takes. (docs/flight.md, Loops)
    if (answer.fusions > 1 + 6 + 15 + 8 || answer.steps > 12 * answer.fusions) {
      outcome_.broken = "more fusions or steps than there may be";
    }
    refused_ = refused_ || answer.status != ELLIPTUDE_OK;
    contradicted_ = contradicted_ || answer.contradicted;
    const bool agrees = answer.status == ELLIPTUDE_OK && !answer.contradicted;
    outcome_.detected = outcome_.detected || !agrees || (before.unconditional && !after.unconditional);
    return agrees;
  }

 private:
  Subject& subject_;
  Outcome& outcome_;
  int regain_after_;
  bool refused_ = false;
  bool contradicted_ = false;
  int refusals_ = 0;
  int agreeing_ = 0;
};

/// Calls that no one should make between an update and the next prediction, of which each is refused or does no harm.
inline void call_in_any_order(Subject& subject, Supervisor& supervisor, const Moment& honest, Random& random) {
  for (int calls = static_cast<int>(random.uniform(1, 5)); calls > 0; --calls) {
    Moment moment = honest;
    switch (static_cast<int>(random.uniform(0, 5))) {
      case 0:
        supervisor.call([&] { return Answer{subject.predict(moment)}; });  // to the same time once more
        break;
      case 1:
        supervisor.call([&] { return subject.update(moment); });
        break;
      case 2:
        moment.sights.clear();
        moment.has_rate = false;
        supervisor.call([&] { return subject.update(moment); });
        break;
      case 3:
        moment.sights.resize(40, moment.sights[0]);  // more than there may be
        supervisor.call([&] { return subject.update(moment); });
        break;
      default:
        subject.forget();
    }
  }
}

/// \param rules of the subject. One that goes on by itself has to recover from the first contradiction after the fault, and each from
/// when it is made again.
inline Outcome run(Subject& subject, Injection& injection, const Rules& rules, Random& random) {
  Outcome outcome;
  World world(subject.kind(), random);
  Supervisor supervisor(subject, outcome, rules.regain_after);
  if (subject.make(world.honest(random)) != ELLIPTUDE_OK) {
    outcome.broken = "an honest start is refused";
    return outcome;
  }
  const bool goes_on = rules.policy == Policy::drop_measurement || rules.policy == Policy::restart;
  int first_after = -1;  // moment from which on the filter has to recover
  int well_since = 0;
  const int quiet = 4 * rules.regain_after + 8;
  const int limit = 2 * rules.regain_after;
  for (int k = 0;; ++k) {
    const Moment moment = injection.told(k, world.honest(random));
    const int restarts = outcome.restarts;
    (void)supervisor.cycle(moment);
    if (injection.acts(k) && injection.fault() == Fault::repeated) {
      supervisor.call([&] { return subject.update(moment); });
    } else if (injection.acts(k) && injection.fault() == Fault::order) {
      call_in_any_order(subject, supervisor, moment, random);
    }
    const bool fault_is_over = k >= injection.end();
    const Belief belief = subject.belief();
    const bool holds = belief.knows && form(belief, world, subject.is_guaranteed()) <= 1;
    outcome.outside += belief.knows && !holds;
    outcome.silent += belief.unconditional && !holds;
    if (fault_is_over && first_after < 0 && ((goes_on && supervisor.contradicted()) || outcome.restarts > restarts)) {
      first_after = k;
    }
    outcome.good_at_end = belief.unconditional && holds;
    well_since = outcome.good_at_end ? well_since + 1 : 0;
    const int last = first_after >= 0 ? first_after + limit + 5 : injection.end() + quiet;
    if (k >= last) {
      outcome.needed = first_after >= 0 ? k + 1 - well_since - first_after : 0;
      if (subject.is_guaranteed() && first_after >= 0 && outcome.needed > limit) {
        outcome.broken = "not recovered in 2 regain_after moments";
      }
      return outcome;
    }
    world.advance();
  }
}

}  // namespace elliptude::faults
