#pragma once

/// \file
/// Many bodies moved at a time, by code for the processor's instruction set. Plain numbers go in and out: each set compiles the
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

Outcome move_baseline(const Settings& settings, long steps, const Bodies& bodies, std::size_t count,
                      const Stop& stop) noexcept;
#if defined(__x86_64__)
Outcome move_avx2(const Settings& settings, long steps, const Bodies& bodies, std::size_t count,
                  const Stop& stop) noexcept;
Outcome move_avx512(const Settings& settings, long steps, const Bodies& bodies, std::size_t count,
                    const Stop& stop) noexcept;
#endif

/// For the widest registers that this processor has; null where the compiler has no vectors.
[[nodiscard]] Move widest() noexcept;

}  // namespace elliptude_kernels
