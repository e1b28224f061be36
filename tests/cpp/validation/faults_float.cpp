// faults_float [TRIALS [SEED]]: as `faults`, filters in float.

#include "support/faults/campaign_program.hpp"

int main(int argc, char** argv) {
  return elliptude::faults::campaign(argc, argv, elliptude::faults::cpp_candidates<float>());
}
