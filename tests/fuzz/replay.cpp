// Runs a fuzz target on the inputs of a corpus file, one a line in hexadecimal digits, `#` before a comment: what was found once
// is tried in every build, without a fuzzer.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

int main(int count, char** names) {
  if (count != 2) {
    std::fprintf(stderr, "usage: %s CORPUS.txt\n", names[0]);
    return 2;
  }
  std::ifstream file(names[1]);
  if (!file) {
    std::fprintf(stderr, "%s: cannot be read\n", names[1]);
    return 2;
  }
  int inputs = 0;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    line.erase(std::min(line.find('#'), line.size()));
    std::vector<std::uint8_t> bytes;
    int digits = 0;
    unsigned value = 0;
    for (const char c : line) {
      if (c == ' ') {
        continue;
      }
      const std::size_t digit = std::string("0123456789abcdef").find(c);
      if (digit == std::string::npos) {
        std::fprintf(stderr, "%s:%d: not a hexadecimal digit: '%c'\n", names[1], number, c);
        return 2;
      }
      value = 16 * value + static_cast<unsigned>(digit);
      if (++digits % 2 == 0) {
        bytes.push_back(static_cast<std::uint8_t>(value));
        value = 0;
      }
    }
    if (digits == 0) {
      continue;
    }
    std::fprintf(stderr, "%s:%d\n", names[1], number);
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
    ++inputs;
  }
  std::printf("%d inputs\n", inputs);
  return inputs > 0 ? 0 : 1;
}
