#pragma once

/// \file
/// How much the core takes at once: the sizes of its arrays. They cost stack, and a program for a small processor sets
/// smaller ones: as macros, the same in all files of a program (`target_compile_definitions(elliptude INTERFACE
/// ELLIPTUDE_MOST_DIRECTIONS=4)`). What is within the limits gives the same results for all of them, to the last bit;
/// what is beyond is refused with `Status::out_of_range`. (docs/flight.md)

#include <cstddef>

/// Directions of one update, 1 to 32.
#ifndef ELLIPTUDE_MOST_DIRECTIONS
#define ELLIPTUDE_MOST_DIRECTIONS 32
#endif

/// Quadrics that are fused at once, at least four more than directions: a guaranteed filter adds an angular velocity,
/// an attitude, and what is known and stated of the vector.
#ifndef ELLIPTUDE_MOST_QUADRICS
#define ELLIPTUDE_MOST_QUADRICS (ELLIPTUDE_MOST_DIRECTIONS + 8)
#endif

/// Quadrics that one question about the attitude takes into account; others are left out, and the answer is less sharp.
/// With 0 a filter keeps none, which is 0.7 kB less of code.
#ifndef ELLIPTUDE_MOST_QUESTIONED
#define ELLIPTUDE_MOST_QUESTIONED 8
#endif

/// Measurements of one update that may be wrong under `Policy::relaxed`, 0 to 2. With 0 its union of sets is not
/// compiled: 14 kB of code of a guaranteed filter on a Cortex-M7.
#ifndef ELLIPTUDE_MOST_WRONG
#define ELLIPTUDE_MOST_WRONG 2
#endif

/// Whether sets are made small by their volume alone, 0 or 1. With 1 the search for the least trace is not compiled:
/// 3 kB of code on a Cortex-M7.
#ifndef ELLIPTUDE_ONLY_VOLUME
#define ELLIPTUDE_ONLY_VOLUME 0
#endif

/// Whether a guaranteed filter knows whole states or nothing, 0 or 1. With 1 no set of an attitude, or of a vector, by
/// itself is compiled: what is known of the vector is forgotten with the attitude, and a gyro's filter estimates the
/// bias. 12 kB of code of a guaranteed filter on a Cortex-M7. (theory, sections 16.7 and 16.8)
#ifndef ELLIPTUDE_ONLY_WHOLE_STATES
#define ELLIPTUDE_ONLY_WHOLE_STATES 0
#endif

/// Whether guaranteed filters are told of attitudes by directions alone, 0 or 1. With 1 a `MeasuredAttitude` is refused:
/// 2 kB of code on a Cortex-M7.
#ifndef ELLIPTUDE_ONLY_DIRECTIONS
#define ELLIPTUDE_ONLY_DIRECTIONS 0
#endif

/// Whether a flow of first order knows all torques, 0 or 1. With 1 an unknown torque that is not zero is refused: 2 kB of
/// code on a Cortex-M7.
#ifndef ELLIPTUDE_ONLY_KNOWN_TORQUES
#define ELLIPTUDE_ONLY_KNOWN_TORQUES 0
#endif

/// Whether FOAM is not helped by singular values, 0 or 1. With 1 directions that determine an attitude a thousand times
/// better about one axis than about another are refused as `attitude_undetermined`, where the method is left open: 1.5 kB
/// of code on a Cortex-M7.
#ifndef ELLIPTUDE_ONLY_FOAM
#define ELLIPTUDE_ONLY_FOAM 0
#endif

// ELLIPTUDE_ONLY_POLICY, the name of the only policy that is compiled: see guaranteed/policy.hpp.

/// Steps of one prediction, unless a flow is told otherwise.
#ifndef ELLIPTUDE_MOST_STEPS
#define ELLIPTUDE_MOST_STEPS 1000000
#endif

namespace elliptude {

inline constexpr std::size_t most_directions = ELLIPTUDE_MOST_DIRECTIONS;
inline constexpr std::size_t most_quadrics = ELLIPTUDE_MOST_QUADRICS;
inline constexpr std::size_t most_questioned = ELLIPTUDE_MOST_QUESTIONED;
inline constexpr int most_that_are_wrong = ELLIPTUDE_MOST_WRONG;
inline constexpr bool only_volume = ELLIPTUDE_ONLY_VOLUME != 0;
inline constexpr bool only_whole_states = ELLIPTUDE_ONLY_WHOLE_STATES != 0;
inline constexpr bool only_directions = ELLIPTUDE_ONLY_DIRECTIONS != 0;
inline constexpr bool only_known_torques = ELLIPTUDE_ONLY_KNOWN_TORQUES != 0;
inline constexpr bool only_foam = ELLIPTUDE_ONLY_FOAM != 0;
/// More steps than these are more likely a wrong time than intended.
inline constexpr long default_most_steps = ELLIPTUDE_MOST_STEPS;

static_assert(most_directions >= 1 && most_directions <= 32, "ELLIPTUDE_MOST_DIRECTIONS must be 1 to 32");
static_assert(most_quadrics >= most_directions + 4,
              "ELLIPTUDE_MOST_QUADRICS must be at least ELLIPTUDE_MOST_DIRECTIONS + 4");
static_assert(most_that_are_wrong >= 0 && most_that_are_wrong <= 2, "ELLIPTUDE_MOST_WRONG must be 0 to 2");
static_assert(default_most_steps >= 1, "ELLIPTUDE_MOST_STEPS must be 1 or more");

}  // namespace elliptude
