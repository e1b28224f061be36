#pragma once

/// \file
/// Times an array of operations by Google Benchmark.

#include <benchmark/benchmark.h>

namespace elliptude::operations {

inline void measure(benchmark::State& state, double (*run)(long count)) {
  constexpr long batch = 1024;  // what a run sets up at its start is shared by so many
  while (state.KeepRunningBatch(batch)) {
    benchmark::DoNotOptimize(run(batch));
  }
}

/// \return true, so that it can be called before `main`.
template <typename Operations>
bool register_all(const Operations& operations) {
  for (const auto& operation : operations) {
    benchmark::RegisterBenchmark(operation.name, measure, operation.run);
  }
  return true;
}

}  // namespace elliptude::operations
