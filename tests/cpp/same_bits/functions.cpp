// Prints hashes of what base/elementary.hpp gives, as rows: compiled with instructions that a compiler might fuse.
#include <cinttypes>
#include <cstdio>

#include "support/function_hashes.hpp"

int main() {
  for (const auto& hashes :
       {elliptude::testing::function_hashes<double>(), elliptude::testing::function_hashes<float>()}) {
    for (const std::uint64_t hash : hashes) {
      std::printf("row %016" PRIx64 "\n", hash);
    }
  }
  return 0;
}
