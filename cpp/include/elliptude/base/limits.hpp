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

/// Quadrics that one question about the attitude takes into account, 1 or more; others are left out, and the answer is
/// less sharp.
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
/// More steps than these are more likely a wrong time than intended.
inline constexpr long default_most_steps = ELLIPTUDE_MOST_STEPS;

static_assert(most_directions >= 1 && most_directions <= 32, "ELLIPTUDE_MOST_DIRECTIONS must be 1 to 32");
static_assert(most_quadrics >= most_directions + 4,
              "ELLIPTUDE_MOST_QUADRICS must be at least ELLIPTUDE_MOST_DIRECTIONS + 4");
static_assert(most_questioned >= 1, "ELLIPTUDE_MOST_QUESTIONED must be 1 or more");
static_assert(most_that_are_wrong >= 0 && most_that_are_wrong <= 2, "ELLIPTUDE_MOST_WRONG must be 0 to 2");
static_assert(default_most_steps >= 1, "ELLIPTUDE_MOST_STEPS must be 1 or more");

}  // namespace elliptude
