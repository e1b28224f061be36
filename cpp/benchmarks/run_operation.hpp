#pragma once

/// \file
/// The program of `instructions_core` and `instructions_peers`: it runs one operation a number of times, for
/// tools/count_instructions.sh to count the instructions of; without arguments, it lists the operations.

#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace elliptude::operations {

template <typename Operations>
int run_operation(const Operations& operations, int argc, char** argv) {
  if (argc != 3) {
    for (const auto& operation : operations) {
      std::puts(operation.name);
    }
    return argc == 1 ? 0 : 2;
  }
  const long count = std::atol(argv[2]);
  for (const auto& operation : operations) {
    if (std::strcmp(operation.name, argv[1]) == 0 && count > 0) {
      // Printed, so that the results are needed.
      std::printf("%.17g\n", operation.run(count));
      return 0;
    }
  }
  std::fprintf(stderr, "usage: %s [OPERATION COUNT]\n", argv[0]);
  return 2;
}

}  // namespace elliptude::operations
