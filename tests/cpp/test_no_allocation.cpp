// Runs every function of the library, as freestanding/flight_core.cpp has compiled them, while allocations are counted, by
// operator new and by the C heap's own functions: this program's definitions stand before the C library's.
#include <doctest/doctest.h>

#include <cstdlib>
#include <new>

#include "support/every_function.hpp"

namespace {

bool counting = false;
int allocations = 0;

void count() noexcept { allocations += counting ? 1 : 0; }

// While it lives, allocations are counted.
class Watch {
 public:
  Watch() noexcept {
    allocations = 0;
    counting = true;
  }
  ~Watch() { counting = false; }
  Watch(const Watch&) = delete;
  Watch& operator=(const Watch&) = delete;
};

}  // namespace

#if defined(__GLIBC__)
#define ELLIPTUDE_TEST_COUNTS_MALLOC
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* malloc(std::size_t size) {
  count();
  return __libc_malloc(size);
}
void* calloc(std::size_t number, std::size_t size) {
  count();
  return __libc_calloc(number, size);
}
void* realloc(void* p, std::size_t size) {
  count();
  return __libc_realloc(p, size);
}
}
#endif

// Not inlined: GCC would see new beside free and warn of the pair.
[[gnu::noinline]] void* operator new(std::size_t size) {
  count();
  if (void* p = std::malloc(size)) {
    return p;
  }
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace elliptude::testing {

extern template Tally<double> use_every_function(const Seeds<double>&) noexcept;
extern template Tally<float> use_every_function(const Seeds<float>&) noexcept;

}  // namespace elliptude::testing

using namespace elliptude::testing;

TEST_CASE("the count sees operator new and malloc") {
  int seen_new = 0;
  {
    const Watch watch;
    // The function itself: a new expression may be optimised away.
    void* volatile p = ::operator new(100);
    seen_new = allocations;
    ::operator delete(p);
  }
  CHECK(seen_new > 0);
#ifdef ELLIPTUDE_TEST_COUNTS_MALLOC
  int seen_malloc = 0;
  {
    const Watch watch;
    void* volatile p = std::malloc(100);
    seen_malloc = allocations;
    std::free(p);
  }
  CHECK(seen_malloc > 0);
#endif
}

TEST_CASE("no function allocates in double") {
  Tally<double> tally;
  int counted = -1;
  {
    const Watch watch;
    tally = use_every_function(Seeds<double>{});
    counted = allocations;
  }
  CHECK(counted == 0);
  CHECK(tally.failures == 0);
  CHECK(tally.calls > 400);
  CHECK(std::isfinite(tally.checksum));
}

TEST_CASE("no function allocates in float") {
  Tally<float> tally;
  int counted = -1;
  {
    const Watch watch;
    tally = use_every_function(Seeds<float>{});
    counted = allocations;
  }
  CHECK(counted == 0);
  CHECK(tally.failures == 0);
  CHECK(tally.calls > 400);
  CHECK(std::isfinite(tally.checksum));
}
