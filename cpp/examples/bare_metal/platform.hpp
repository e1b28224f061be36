#pragma once

/// \file
/// What a replay needs of the machine that it runs on: `cortex_m.cpp` for a bare one, `host.cpp` for this one.

#include <cstdint>

namespace flight {

/// What the program does, called once the machine has started.
/// \return 0 if all went well.
[[gnu::cold]] int run();

/// Writes a text that ends with zero: by semihosting, or to the standard output.
void write(const char* text);

/// What a call cost; zero where it cannot be measured.
struct Cost {
  std::uint32_t instructions = 0;
  std::uint32_t stack = 0;  ///< bytes below the caller's
};

/// Calls `function(context)` once and says what that cost.
Cost measure(void (*function)(void* context), void* context);

/// The same for anything that can be called without arguments.
template <typename Function>
Cost measure(Function& function) {
  return measure([](void* context) { (*static_cast<Function*>(context))(); }, &function);
}

}  // namespace flight
