#pragma once

/// \file
/// Many first-order filters moved and updated at a time, by code for the processor's instruction set; as in
/// dynamics/ensemble_kernel.hpp plain numbers go in and out, and each set has namespaces of its own.

#include "dynamics/ensemble_kernel.hpp"

namespace elliptude_kernels {

/// What all filters have in common; SI units, body axes, matrices by columns.
struct FilterSettings {
  enum class Criterion : unsigned char { trace, weighted_trace, volume };

  bool has_gyro;
  bool is_first_order;  ///< the mode; else that of the paper
  Settings body;        ///< of a rigid body; the step is the longest
  double unknown_torque[9];
  long most_steps;
  double noise[9];  ///< of a gyro
  double drift[9];
  Criterion criterion;
  double weight[36];
};

/// The filters' own numbers, one kind after the other: number k of filter i is numbers[k · stride + i]. For each the attitude, the
/// vector beside it, the shape, A^f and P₀, matrices by columns. A stride is a multiple of the widest register; the numbers beyond the last
/// filter are its own again.
struct FilterMemory {
  static constexpr std::size_t attitude = 0;
  static constexpr std::size_t vector = 9;
  static constexpr std::size_t shape = 12;
  static constexpr std::size_t transition = 48;
  static constexpr std::size_t prior_shape = 84;
  static constexpr std::size_t all = 120;
  static constexpr std::size_t widest_register = 8;

  double* numbers;
  std::size_t stride;
};

/// A block of filters: `count` from `first` on, which is a multiple of the widest register.
struct FilterBlock {
  FilterMemory memory;
  std::size_t first;
  std::size_t count;
  double time;  ///< of all
};

/// What was measured, for the whole memory; no numbers from one filter to the next where all have the same.
struct FilterMeasurements {
  std::ptrdiff_t directions;  ///< how many of each filter; none without
  const double* body;
  std::ptrdiff_t body_stride;
  const double* reference;
  std::ptrdiff_t reference_stride;
  const double* bounds;   ///< 9 numbers for each direction, of all filters
  const double* weights;  ///< one for each
  const double* rate;     ///< null without
  std::ptrdiff_t rate_stride;
  const double* rate_bound;  ///< 9 numbers, of all filters
};

/// For the whole memory: an `elliptude::Status` of each filter, and what its update did.
struct FilterOutcomes {
  int* status;
  double* share;
  double* margin;
};

/// Predicts to a time under inputs of three numbers for each filter of the memory.
using PredictFilters = void (*)(const FilterSettings&, const FilterBlock&, double time, const double* inputs,
                                std::ptrdiff_t input_stride, const Stop&, int* status) noexcept;

using UpdateFilters = void (*)(const FilterSettings&, const FilterBlock&, const FilterMeasurements&,
                               const FilterOutcomes&) noexcept;

struct FilterKernels {
  PredictFilters predict;
  UpdateFilters update;
};

FilterKernels filters_baseline() noexcept;
#if defined(__x86_64__)
FilterKernels filters_avx2() noexcept;
FilterKernels filters_avx512() noexcept;
#endif

/// Those for the widest registers that this processor has; null where the compiler has no vectors.
[[nodiscard]] FilterKernels widest_for_filters() noexcept;

}  // namespace elliptude_kernels
