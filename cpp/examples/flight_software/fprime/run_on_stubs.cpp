// Runs the component on the stubs: some samples in, and whether what comes out is as it should be.
#include <cmath>
#include <cstdio>

#include "AttitudeEstimator.hpp"

namespace {

int failures = 0;

void check(bool holds, const char* what) {
  if (!holds) {
    std::printf("does not hold: %s\n", what);
    ++failures;
  }
}

/// A body that turns about its third axis by 0.05 rad/s.
Adcs::Sample sample_at(double seconds) {
  const double angle = 0.05 * seconds;
  Adcs::Stars stars;
  stars[0] = Adcs::Star({1, 0, 0}, {std::cos(angle), -std::sin(angle), 0}, 1e-3);
  stars[1] = Adcs::Star({0, 1, 0}, {std::sin(angle), std::cos(angle), 0}, 1e-3);
  return {seconds, {0, 0, 0.05}, 2, stars};
}

}  // namespace

int main() {
  Adcs::AttitudeEstimator estimator("attitudeEstimator");
  Adcs::Sample early = sample_at(0);
  estimator.take(early);
  check(estimator.sent().refused == 1 && !estimator.sent().knows, "without configure samples are refused");
  estimator.command(0, 0);
  check(estimator.sent().responses == 0, "and so is the command");
  check(estimator.configure(0), "configure");
  for (int row = 0; row < 20; ++row) {
    const double seconds = 0.25 * row;
    Adcs::Sample sample = sample_at(seconds);
    if (row == 9) {
      sample = Adcs::Sample(seconds, {0, 0, std::nan("")}, 2, sample.get_stars());
    } else if (row == 12) {
      Adcs::Stars stars = sample.get_stars();
      stars[1] = Adcs::Star({0, 1, 0}, {0, 1, 0.5}, 1e-3);
      sample = Adcs::Sample(seconds, sample.get_rate(), 2, stars);
    }
    estimator.take(sample);
    const auto& sent = estimator.sent();
    check(sent.knows && sent.refused == 1 && sent.limits_hit == 0, "the attitude is known");
    const double error = std::atan2(sent.attitude[3], sent.attitude[0]) - 0.05 * seconds;
    check(std::fabs(error) <= 2 * sent.half_widths[2] && sent.half_widths[2] < 0.01, "the attitude is near the truth");
    check(sent.left_out == (row < 12 ? 0U : 2U), "the liar was left out, and no other star");
    check(row != 12 || sent.conditional, "and the claim is conditional");
  }
  // A bit of the filter's memory flips, as a particle does it.
  reinterpret_cast<unsigned char*>(&estimator)[sizeof(Adcs::AttitudeEstimatorComponentBase) + 200] ^= 4;
  Adcs::Sample late = sample_at(5);
  estimator.take(late);
  check(estimator.sent().refused == 2, "memory that was changed is noticed");
  estimator.take(late);
  check(estimator.sent().refused == 2 && estimator.sent().knows, "and the next sample starts anew");
  reinterpret_cast<unsigned char*>(&estimator)[sizeof(Adcs::AttitudeEstimatorComponentBase) + 200] ^= 4;
  estimator.command(0, 0);
  check(estimator.sent().responses == 1, "the command is answered, whatever the memory holds");
  const Adcs::Stars none;
  Adcs::Sample crowded(5.25, {0, 0, 0.05}, static_cast<U32>(none.size()) + 1, none);
  estimator.take(crowded);
  check(estimator.sent().refused == 3, "more stars than there is room for are refused");
  Adcs::Sample ahead = sample_at(1e6);
  estimator.take(ahead);
  estimator.take(early);
  check(estimator.sent().refused == 4, "a sample from the past is refused");
  estimator.command(0, 0);
  estimator.take(early);
  check(estimator.sent().refused == 4 && estimator.sent().knows, "but not after the command");
  std::printf("%d failures\n", failures);
  return failures == 0 ? 0 : 1;
}
