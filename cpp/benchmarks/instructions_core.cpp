// Runs one operation a number of times, for tools/count_instructions.sh to count the instructions of; without arguments, lists
// the operations.

#include <cstdio>
#include <cstring>

#include "operations.hpp"

int main(int argc, char** argv) {
  if (argc != 3) {
    for (const auto& operation : elliptude::operations::all) {
      std::puts(operation.name);
    }
    return argc == 1 ? 0 : 2;
  }
  const long count = std::atol(argv[2]);
  for (const auto& operation : elliptude::operations::all) {
    if (std::strcmp(operation.name, argv[1]) == 0 && count > 0) {
      // Printed, so that the results are needed.
      std::printf("%.17g\n", operation.run(count));
      return 0;
    }
  }
  std::fprintf(stderr, "usage: %s [OPERATION COUNT]\n", argv[0]);
  return 2;
}
