// Time per operation of the core. The targets of the first sight, at -O3 -march=native: a step at most 100 ns, a step with A and
// A P Aᵀ at most 200 ns, the fusion of two ellipsoids of six dimensions at most 1.5 µs.

#include <benchmark/benchmark.h>

#include "operations.hpp"

namespace {

void measure(benchmark::State& state, double (*run)(long count)) {
  constexpr long batch = 1024;  // what a run sets up at its start is shared by so many
  while (state.KeepRunningBatch(batch)) {
    benchmark::DoNotOptimize(run(batch));
  }
}

[[maybe_unused]] const bool registered = [] {
  for (const auto& operation : elliptude::operations::all) {
    benchmark::RegisterBenchmark(operation.name, measure, operation.run);
  }
  return true;
}();

}  // namespace
