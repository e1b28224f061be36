#pragma once

/// \file
/// Functions that are not inlined. A compiler gives a function room for all that it has inlined into it, and often
/// shares none of it; what is out of line takes its room only while it runs. So a function that holds large sets has
/// those parts of it out of line that are large themselves, and a cold path is out of line where it would make a hot
/// function's frame larger. (docs/flight.md, what it costs)

#if defined(__GNUC__)
#define ELLIPTUDE_OUT_OF_LINE __attribute__((noinline))
#elif defined(_MSC_VER)
#define ELLIPTUDE_OUT_OF_LINE __declspec(noinline)
#else
#define ELLIPTUDE_OUT_OF_LINE
#endif

// A program that defines `ELLIPTUDE_MOST_UNROLLED` wants little code. `ELLIPTUDE_SHARED` is a short function that many
// others call: such a program has it once, and does not inline it. `ELLIPTUDE_SELDOM` is one that runs as a filter is
// made, or where something went wrong: its compiler makes it as short as it can.
#ifndef ELLIPTUDE_MOST_UNROLLED
#define ELLIPTUDE_SHARED
#define ELLIPTUDE_SELDOM
#elif defined(__GNUC__)
#define ELLIPTUDE_SHARED __attribute__((noinline))
#define ELLIPTUDE_SELDOM __attribute__((noinline, cold))
#else
#define ELLIPTUDE_SHARED ELLIPTUDE_OUT_OF_LINE
#define ELLIPTUDE_SELDOM ELLIPTUDE_OUT_OF_LINE
#endif

/// A function that is inlined wherever it is called: one that is given constants where more is written out, and
/// variables where there are loops.
#if defined(__GNUC__)
#define ELLIPTUDE_INLINE __attribute__((always_inline)) inline
#elif defined(_MSC_VER)
#define ELLIPTUDE_INLINE __forceinline
#else
#define ELLIPTUDE_INLINE inline
#endif
