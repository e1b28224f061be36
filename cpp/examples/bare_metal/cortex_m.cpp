// A Cortex-M with a floating-point unit and nothing else: vector table, start-up, semihosting, and counts of
// instructions and stack. The counts are true where QEMU runs it with `-icount shift=0`: the processor then needs 1 ns
// for each instruction, and SysTick counts its 25 MHz.
#include <cstddef>
#include <cstdint>

#include "platform.hpp"

extern "C" {

// Named by mps2.ld.
extern std::uint32_t data_load, data_begin, data_end, bss_begin, bss_end, stack_bottom, stack_top;

void start();

// The unit has to be on before any function of C, which may save its registers.
[[gnu::naked, noreturn]] void reset() {
  asm volatile(
      "ldr r0, =0xE000ED88\n"  // CPACR: full access to CP10 and CP11
      "ldr r1, [r0]\n"
      "orr r1, r1, #(0xF << 20)\n"
      "str r1, [r0]\n"
      "dsb\n"
      "isb\n"
      "b start\n");
}

}  // extern "C"

namespace {

constexpr std::uint32_t instructions_per_tick = 40;
constexpr std::uint32_t tick_mask = 0xFFFFFF;
constexpr std::uint32_t painted = 0xA5C35A3C;

volatile std::uint32_t& memory(std::uintptr_t address) { return *reinterpret_cast<volatile std::uint32_t*>(address); }

std::uint32_t ticks() {
  asm volatile("dsb\nisb" ::: "memory");
  const std::uint32_t now = memory(0xE000E018);  // SYST_CVR, which counts down
  asm volatile("dsb\nisb" ::: "memory");
  return now;
}

[[gnu::always_inline]] inline std::uint32_t* stack_pointer() {
  std::uint32_t* pointer;
  asm volatile("mov %0, sp" : "=r"(pointer)::"memory");
  return pointer;
}

int call(int operation, const void* argument) {
  register int r0 asm("r0") = operation;
  register const void* r1 asm("r1") = argument;
  asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

[[noreturn]] void leave(int code) {
  const std::uint32_t reason[2] = {0x20026, static_cast<std::uint32_t>(code)};  // ADP_Stopped_ApplicationExit
  call(0x20, reason);                                                           // SYS_EXIT_EXTENDED
  for (;;) {
  }
}

/// 2000 instructions of a loop, which must be as many by the counter.
[[nodiscard]] bool counts_instructions() {
  std::uint32_t rounds = 1000;
  const std::uint32_t before = ticks();
  asm volatile(
      "1: subs %0, %0, #1\n"
      "bne 1b"
      : "+r"(rounds)::"cc");
  const std::uint32_t counted = ((before - ticks()) & tick_mask) * instructions_per_tick;
  return counted >= 1960 && counted <= 2080;
}

[[noreturn]] void fault() {
  flight::write("fault\n");
  leave(3);
}

using Handler = void (*)();
struct Vectors {
  std::uint32_t* stack;
  Handler handlers[15];
};
[[gnu::section(".vectors"), gnu::used]] const Vectors vectors = {
    &stack_top,
    {reset, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault}};

}  // namespace

extern "C" void start() {
  for (std::uint32_t *to = &data_begin, *from = &data_load; to != &data_end;) {
    *to++ = *from++;
  }
  for (std::uint32_t* to = &bss_begin; to != &bss_end;) {
    *to++ = 0;
  }
  memory(0xE000E014) = tick_mask;  // SYST_RVR
  memory(0xE000E018) = 0;
  memory(0xE000E010) = 5;  // SYST_CSR: the processor's clock, no interrupt, on
  if (!counts_instructions()) {
    flight::write("SysTick does not count instructions: run it with -icount shift=0\n");
    leave(4);
  }
  leave(flight::run());
}

namespace flight {

void write(const char* text) { call(0x04, text); }  // SYS_WRITE0

Cost measure(void (*function)(void* context), void* context) {
  std::uint32_t* const top = stack_pointer();
  for (std::uint32_t* word = &stack_bottom; word < stack_pointer(); ++word) {
    *static_cast<volatile std::uint32_t*>(word) = painted;
  }
  const std::uint32_t before = ticks();
  function(context);
  const std::uint32_t after = ticks();
  const std::uint32_t* word = &stack_bottom;
  while (word < top && *static_cast<const volatile std::uint32_t*>(word) == painted) {
    ++word;
  }
  return {((before - after) & tick_mask) * instructions_per_tick,
          static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(top) - reinterpret_cast<std::uintptr_t>(word))};
}

}  // namespace flight
