/// The seal of an object's bytes: what it notices, and what it lets pass.

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <elliptude/base/seal.hpp>
#include <initializer_list>
#include <vector>

#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

std::vector<unsigned char> bytes(std::size_t count, Random& random) {
  std::vector<unsigned char> result(count);
  for (unsigned char& byte : result) {
    byte = static_cast<unsigned char>(random.uniform(0, 256));
  }
  return result;
}

void flip(std::vector<unsigned char>& object, std::size_t bit) {
  object[bit / 8] = static_cast<unsigned char>(object[bit / 8] ^ (1U << bit % 8));
}

/// Something that a caller changes by calls.
struct Counter {
  int value = 0;
  double other = 1;
};

}  // namespace

TEST_CASE("every one and every two flipped bits change a seal") {
  Random random(1);
  for (const std::size_t size : {1U, 3U, 4U, 7U, 24U, 57U}) {
    for (const unsigned char fill : std::initializer_list<unsigned char>{0x00, 0xFF, 0x5A}) {
      std::vector<unsigned char> object = fill == 0x5A ? bytes(size, random) : std::vector<unsigned char>(size, fill);
      const Seal seal = seal_of(object.data(), size);
      long unseen = 0;
      for (std::size_t one = 0; one < 8 * size; ++one) {
        flip(object, one);
        unseen += seal_of(object.data(), size) == seal;
        for (std::size_t other = one + 1; other < 8 * size; ++other) {
          flip(object, other);
          unseen += seal_of(object.data(), size) == seal;
          flip(object, other);
        }
        flip(object, one);
      }
      CHECK(unseen == 0);
      CHECK(seal_of(object.data(), size) == seal);
    }
  }
}

TEST_CASE("two words that are exchanged or filled change a seal") {
  Random random(2);
  std::vector<unsigned char> object = bytes(64, random);
  const Seal seal = seal_of(object.data(), object.size());
  for (std::size_t one = 0; one < 16; ++one) {
    for (std::size_t other = 0; other < one; ++other) {
      std::vector<unsigned char> changed = object;
      std::swap_ranges(changed.begin() + static_cast<std::ptrdiff_t>(4 * one),
                       changed.begin() + static_cast<std::ptrdiff_t>(4 * one + 4),
                       changed.begin() + static_cast<std::ptrdiff_t>(4 * other));
      CHECK(seal_of(changed.data(), changed.size()) != seal);
    }
  }
  for (const unsigned char fill : std::initializer_list<unsigned char>{0x00, 0xFF}) {  // of zeros and of ones
    for (std::size_t first = 0; first + 8 <= 64; first += 4) {
      std::vector<unsigned char> before(64, static_cast<unsigned char>(~fill));
      std::vector<unsigned char> after = before;
      std::fill_n(after.begin() + static_cast<std::ptrdiff_t>(first), 8, fill);
      CHECK(seal_of(before.data(), 64) != seal_of(after.data(), 64));
    }
  }
}

TEST_CASE("memory that was set to zero, seal and all, has no valid seal") {
  const std::array<double, 8> zeros{};
  CHECK(seal_of(zeros.data(), sizeof zeros) != Seal());
  CHECK(seal_of(zeros.data(), 0) != Seal());
}

TEST_CASE("a sealed object is called only as long as its bytes are as they were left") {
  Sealed<Counter> sealed{Counter()};
  const auto count = [](Counter& counter) {
    ++counter.value;
    return counter.value == 3 ? Status::out_of_range : Status::ok;
  };
  CHECK(sealed.verify() == Status::ok);
  CHECK(sealed.call(count) == Status::ok);
  CHECK(sealed.call(count) == Status::ok);
  CHECK(sealed.call(count) == Status::out_of_range);  // what the function says, and what it did is sealed
  CHECK(sealed.verify() == Status::ok);
  CHECK(sealed.object().value == 3);
  auto* const memory = reinterpret_cast<unsigned char*>(&sealed);
  for (std::size_t byte = 0; byte < sizeof(Counter); ++byte) {
    memory[byte] = static_cast<unsigned char>(memory[byte] ^ 0x10U);
    CHECK(sealed.verify() == Status::corrupted);
    CHECK(sealed.call(count) == Status::corrupted);
    memory[byte] = static_cast<unsigned char>(memory[byte] ^ 0x10U);
  }
  CHECK(sealed.object().value == 3);                                                       // nothing was called
  memory[sizeof sealed - 1] = static_cast<unsigned char>(memory[sizeof sealed - 1] ^ 1U);  // of the seal itself
  CHECK(sealed.call(count) == Status::corrupted);
  sealed.replace({7, 0});
  CHECK(sealed.call(count) == Status::ok);
  CHECK(sealed.object().value == 8);
}
