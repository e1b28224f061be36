// faults [TRIALS [SEED]]: filters in double, of both kinds and in C, are told what faulty sensors, clocks and programs say for a while.
// Fails if a filter says ok and has a set that is none, changes when it refuses, loses the truth though nothing it was told is wrong, or
// does not recover. Prints how often wrong sets were claimed while a sensor lied, which nothing can exclude.

#include "support/faults/c_subject.hpp"
#include "support/faults/campaign_program.hpp"

int main(int argc, char** argv) {
  using namespace elliptude::faults;
  std::vector<Candidate> candidates = cpp_candidates<double>();
  candidates.push_back({"C, body", [](const Rules& rules) { return std::make_unique<CSubject<BodyInC>>(rules); }});
  candidates.push_back({"C, gyro", [](const Rules& rules) { return std::make_unique<CSubject<GyroInC>>(rules); }});
  return campaign(argc, argv, candidates);
}
