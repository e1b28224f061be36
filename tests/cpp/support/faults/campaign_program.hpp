#pragma once

/// \file
/// The program of a fault campaign: trials with every fault on every subject, and a table of what came of them.

#include <array>
#include <cstdlib>
#include <functional>
#include <map>

#include "support/faults/campaign.hpp"

namespace elliptude::faults {

/// A filter that is tried, by its name.
struct Candidate {
  const char* name;
  std::function<std::unique_ptr<Subject>(const Rules&)> make;
};

/// Counts of what came of one fault.
struct Row {
  long trials = 0;
  long detected = 0;
  long silent = 0;   ///< trials with a moment at which an unconditional set did not hold the truth
  long outside = 0;  ///< trials with a moment at which some set did not
  long restarts = 0;
  long lasting = 0;  ///< trials at whose end the filter is still wrong, and nothing contradicts it
  int slowest = 0;
};

/// The policies that a trial may have: how many of what it is told may be wrong by `relaxed` is one.
inline Rules draw_rules(Random& random) {
  constexpr Policy policies[] = {Policy::raise, Policy::drop_measurement, Policy::restart, Policy::relaxed};
  Rules rules;
  rules.policy = policies[static_cast<int>(random.uniform(0, 4))];
  rules.most_wrong = rules.policy == Policy::relaxed ? 1 : 0;
  rules.regain_after = static_cast<int>(random.uniform(2, 6));
  return rules;
}

/// What may not have come of a fault; null if all is as promised.
inline const char* broken_promise(const Outcome& outcome, const Injection& injection, const Rules& rules,
                                  const Subject& subject) {
  if (outcome.broken != nullptr || !subject.is_guaranteed()) {
    return outcome.broken;
  }
  if (is_honest(injection.fault()) && outcome.outside > 0) {
    return "the truth is outside, though all that the filter was told is true";
  }
  if (rules.policy == Policy::relaxed && injection.is_of_one_sensor(subject.kind()) && outcome.outside > 0) {
    return "the truth is outside, though only one of each moment was wrong, as the filter was told that it may be";
  }
  return nullptr;
}

inline void print(const char* name, const std::array<Row, fault_count>& rows) {
  std::printf("\n%-28s %8s %9s %8s %9s %9s %9s %9s\n", name, "trials", "detected", "silent", "outside", "restarts",
              "lasting", "slowest");
  for (int fault = 0; fault < fault_count; ++fault) {
    const Row& row = rows[static_cast<std::size_t>(fault)];
    std::printf("  %-26s %8ld %9ld %8ld %9ld %9ld %9ld %9d\n", fault_names[fault], row.trials, row.detected, row.silent,
                row.outside, row.restarts, row.lasting, row.slowest);
  }
}

/// `PROGRAM [TRIALS [SEED]]`: so many trials of each candidate.
/// \return 0, 1 if a promise was broken, 2 of wrong arguments.
inline int campaign(int argc, char** argv, const std::vector<Candidate>& candidates) {
  const long trials = argc > 1 ? std::atol(argv[1]) : 10000;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (trials < 1 || argc > 3) {
    std::fprintf(stderr, "usage: %s [TRIALS [SEED]]\n", argv[0]);
    return 2;
  }
  long failures = 0;
  std::printf("%ld trials of each filter, seed %ld\n", trials, seed);
  for (const Candidate& candidate : candidates) {
    std::array<Row, fault_count> rows;
    for (long trial = 0; trial < trials; ++trial) {
      // Each trial has a seed of its own, so that one can be run again by itself.
      Random random(static_cast<std::uint64_t>(seed) * 1000003U + static_cast<std::uint64_t>(trial));
      const Rules rules = draw_rules(random);
      Injection injection(static_cast<Fault>(trial % fault_count), random);
      const std::unique_ptr<Subject> subject = candidate.make(rules);
      const Outcome outcome = run(*subject, injection, rules, random);
      Row& row = rows[static_cast<std::size_t>(trial % fault_count)];
      ++row.trials;
      row.detected += outcome.detected;
      row.silent += outcome.silent > 0;
      row.outside += outcome.outside > 0;
      row.restarts += outcome.restarts;
      row.lasting += !outcome.good_at_end;
      row.slowest = std::max(row.slowest, outcome.needed);
      if (const char* broken = broken_promise(outcome, injection, rules, *subject); broken != nullptr) {
        if (++failures <= 20) {
          std::printf("BROKEN: %s: trial %ld of %s, %s, policy %d, regain_after %d\n", broken, trial, candidate.name,
                      fault_names[trial % fault_count], static_cast<int>(rules.policy), rules.regain_after);
        }
      }
    }
    print(candidate.name, rows);
    std::fflush(stdout);
  }
  std::printf("\n%ld promises broken\n", failures);
  return failures == 0 ? 0 : 1;
}

/// The C++ filters of one precision.
template <typename Scalar>
std::vector<Candidate> cpp_candidates() {
  using Body = GuaranteedSubject<GuaranteedRigidBodyFlow<Scalar, FreeBody<Scalar>>>;
  using Gyro = GuaranteedSubject<GuaranteedGyroFlow<Scalar>>;
  using Paper = FirstOrderSubject<RigidBodyFlow<Scalar, FreeBody<Scalar>>, PaperEstimator>;
  using FirstOrder = FirstOrderSubject<GyroFlow<Scalar>, FirstOrderEstimator>;
  return {{"guaranteed, body", [](const Rules& rules) { return std::make_unique<Body>(rules); }},
          {"guaranteed, gyro", [](const Rules& rules) { return std::make_unique<Gyro>(rules); }},
          {"paper, body", [](const Rules&) { return std::make_unique<Paper>(); }},
          {"first order, gyro", [](const Rules&) { return std::make_unique<FirstOrder>(); }}};
}

}  // namespace elliptude::faults
