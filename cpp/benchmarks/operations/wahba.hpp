#pragma once

/// \file
/// Attitude from directions: Wahba's problem, and the set of attitudes that bounded errors leave.

#include <array>
#include <cstdint>
#include <elliptude/attitude/wahba_set.hpp>

#include "common.hpp"

namespace elliptude::operations {

constexpr std::size_t wahba_samples = 64;

template <int directions>
struct WahbaSample {
  Matrix<double, 3, directions> reference;
  Matrix<double, 3, directions> body;  // wrong by up to 0.174, about 10 degrees
};

template <int directions>
std::array<WahbaSample<directions>, wahba_samples> make_wahba_samples() {
  Random random;
  std::array<WahbaSample<directions>, wahba_samples> result;
  for (WahbaSample<directions>& sample : result) {
    const Matrix3d attitude = exp(random.in_cube(1.8));
    for (int i = 0; i < directions; ++i) {
      sample.reference.col(i) = (random.in_cube(0.7) + Vector3d::Unit(i % 3)).normalized();
      sample.body.col(i) = exp(random.in_cube(0.1)) * attitude.transpose() * sample.reference.col(i);
    }
  }
  return result;
}

template <WahbaMethod method, int directions>
double wahba(long count) {
  static const auto inputs = make_wahba_samples<directions>();
  const Vector<double, directions> weights = Vector<double, directions>::Ones();
  WahbaSolution<double> solution;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const auto& sample = inputs[static_cast<std::size_t>(i) % wahba_samples];
    expect_ok(solve_wahba(sample.reference, sample.body, weights, method, solution));
    sum += solution.attitude.sum();
  }
  return sum;
}

enum class SetWeights : std::uint8_t { given, found };

template <typename Chart, SetWeights choice, int directions>
double set_of_directions(long count) {
  static const auto inputs = make_wahba_samples<directions>();
  const auto bounds = Vector<double, directions>::Constant(0.18);
  Vector<double, directions> weights = Vector<double, directions>::Ones();
  WahbaSet<double> set;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const auto& sample = inputs[static_cast<std::size_t>(i) % wahba_samples];
    if constexpr (choice == SetWeights::given) {
      expect_ok(wahba_set<Chart>(sample.reference, sample.body, bounds, weights, set));
    } else {
      expect_ok(minimal_wahba_set<Chart>(sample.reference, sample.body, bounds, WahbaCriterion::trace, weights, set));
    }
    sum += set.error.shape.trace() + set.attitude.sum();
  }
  return sum;
}

}  // namespace elliptude::operations
