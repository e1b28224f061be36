#pragma once

/// \file
/// How much of Eigen's assignments is written out in straight lines. That is fast, and takes several times the code of
/// a loop. A program for a small processor has loops: with `ELLIPTUDE_MOST_UNROLLED`, the same in all its files. Sets
/// have the same bits with every value, to the last. (docs/flight.md)

/// Eigen's cost of an assignment up to which it is written out, 0 or more: one for each number that is read or written,
/// and for each operation. With 18 a 3x3 matrix is copied in straight lines, and a 6x6 one in a loop. If it is not
/// defined, the limit is Eigen's own, 110.
#ifdef ELLIPTUDE_MOST_UNROLLED

#ifdef EIGEN_CORE_H
#error "elliptude: with ELLIPTUDE_MOST_UNROLLED its headers, not the single one, must be included before Eigen"
#endif
#ifdef EIGEN_UNROLLING_LIMIT
#error "elliptude: the bits depend on EIGEN_UNROLLING_LIMIT; define ELLIPTUDE_MOST_UNROLLED instead of it"
#endif

namespace elliptude::detail {

/// Eigen's limit in one of its files. It has one limit for all, and bits depend on it: Eigen adds a short sum in pairs
/// where it is written out, but from the first number on in a loop. So the file of sums keeps Eigen's own limit.
[[nodiscard]] constexpr int unrolling_limit(const char* file) noexcept {
  static_assert((ELLIPTUDE_MOST_UNROLLED) >= 0, "ELLIPTUDE_MOST_UNROLLED must be 0 or more");
  const char* name = file;
  for (const char* next = file; *next != '\0'; ++next) {
    name = *next == '/' || *next == '\\' ? next + 1 : name;
  }
  const char* of_sums = "Redux.h";
  while (*name != '\0' && *name == *of_sums) {
    ++name;
    ++of_sums;
  }
  return *name == *of_sums ? 110 : (ELLIPTUDE_MOST_UNROLLED);
}

}  // namespace elliptude::detail

#define EIGEN_UNROLLING_LIMIT (::elliptude::detail::unrolling_limit(__FILE__))

#endif

namespace elliptude::detail {

/// Whether a program wants little code, and calls what others have inlined.
inline constexpr bool has_little_code =
#ifdef ELLIPTUDE_MOST_UNROLLED
    true;
#else
    false;
#endif

/// Whether the core's own loops over a matrix of so many numbers are written out, as Eigen's are.
template <int Numbers>
inline constexpr bool is_written_out =
#ifdef ELLIPTUDE_MOST_UNROLLED
    Numbers <= (ELLIPTUDE_MOST_UNROLLED);
#else
    true;
#endif

}  // namespace elliptude::detail
