#pragma once

/// \file
/// Many bodies moved at a time, and many of Wahba's problems solved, by code for the processor's instruction set. Plain numbers go in and out: each set compiles the
/// library and Eigen in namespaces of its own, so that no function compiled for one can be linked into code for another.

#include <cstddef>

namespace elliptude_kernels {

/// What all bodies have in common; SI units, body axes, matrices by columns.
struct Settings {
  enum class Potential : unsigned char { free, uniform_gravity, gravity_gradient };

  double inertia[9];
  double step;
  int order;
  Potential potential;
  double moment[3];    ///< of uniform gravity
  double gradient[9];  ///< of the gravity gradient: the inertia that it acts on
  double orbit[9];
  double orbit_rate;
};

/// One number or matrix after the other, matrices by rows, for each body.
struct Bodies {
  double* attitude;          ///< 9 numbers each, in and out
  double* angular_velocity;  ///< 3 each, in and out
  const double* time;
  const double* control_torque;
  double* by_state;    ///< 36 each, out; null if no linearization is wanted
  double* by_control;  ///< 18 each
};

/// `elliptude::Status` as a number, and the first body that it is about.
struct Outcome {
  int status;
  std::size_t body;
};

/// What may stop a linearization before its end: as `elliptude::Interruption`.
struct Stop {
  bool (*asked)(void* context) noexcept;
  void* context;
};

/// The most bodies of one call.
constexpr std::size_t most = 64;

/// Moves up to `most` bodies.
using Move = Outcome (*)(const Settings&, long steps, const Bodies&, std::size_t count, const Stop&) noexcept;

/// Wahba's problems of as many directions each: where the first one's numbers are, and how many numbers there are from one problem to the
/// next.
struct WahbaInput {
  const double* reference;
  const double* body;
  const double* weights;
  std::ptrdiff_t reference_stride;
  std::ptrdiff_t body_stride;
  std::ptrdiff_t weights_stride;
  std::ptrdiff_t directions;
};

/// For each problem, out; an attitude by rows.
struct WahbaOutput {
  double* attitude;  ///< 9 numbers each
  double* cost;
  double* condition;
};

/// Solves problems by `WahbaMethod::foam`, up to the first that has no solution.
using SolveWahba = Outcome (*)(const WahbaInput&, std::size_t count, const WahbaOutput&) noexcept;

struct Kernels {
  Move move;
  SolveWahba solve_wahba;
};

Outcome move_baseline(const Settings& settings, long steps, const Bodies& bodies, std::size_t count,
                      const Stop& stop) noexcept;
Outcome solve_wahba_baseline(const WahbaInput& input, std::size_t count, const WahbaOutput& output) noexcept;
#if defined(__x86_64__)
Outcome move_avx2(const Settings& settings, long steps, const Bodies& bodies, std::size_t count,
                  const Stop& stop) noexcept;
Outcome solve_wahba_avx2(const WahbaInput& input, std::size_t count, const WahbaOutput& output) noexcept;
Outcome move_avx512(const Settings& settings, long steps, const Bodies& bodies, std::size_t count,
                    const Stop& stop) noexcept;
Outcome solve_wahba_avx512(const WahbaInput& input, std::size_t count, const WahbaOutput& output) noexcept;
#endif

enum class InstructionSet : unsigned char { none, baseline, avx2, avx512 };

/// The one with the widest registers that this processor has; none where the compiler has no vectors.
[[nodiscard]] InstructionSet widest_set() noexcept;

/// The kernels of that one; null where there is none.
[[nodiscard]] Kernels widest() noexcept;

}  // namespace elliptude_kernels
