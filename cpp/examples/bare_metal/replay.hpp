#pragma once

/// \file
/// Replays the recording through a filter. It writes a digest of each set's bits, its width in nrad, and what
/// predictions and updates cost.

#include <cstdint>
#include <elliptude/elliptude.hpp>

#include "platform.hpp"
#include "recording.h"

#ifndef FLIGHT_SCALAR
#define FLIGHT_SCALAR double
#endif

namespace flight {

using Scalar = FLIGHT_SCALAR;
using elliptude::Status;
using elliptude::Vector3;

constexpr std::size_t directions_of_a_row = 4;

/// In a section of its own, so that it is not counted as code.
[[gnu::section(".recording")]] inline const Row recording[rows] = {
#include "recording.inc"
};

inline Vector3<Scalar> vector(const double (&numbers)[3]) {
  return {static_cast<Scalar>(numbers[0]), static_cast<Scalar>(numbers[1]), static_cast<Scalar>(numbers[2])};
}

/// The ellipsoid's shape that a ball of this radius has.
inline elliptude::Matrix3<Scalar> ball(double radius) {
  return static_cast<Scalar>(radius * radius) * elliptude::Matrix3<Scalar>::Identity();
}

/// The measurements of a row, with their bounds.
struct Measured {
  Scalar time;
  std::array<elliptude::Direction<Scalar>, directions_of_a_row> directions;
  elliptude::AngularVelocity<Scalar> rate;

  explicit Measured(const Row& row) : time(static_cast<Scalar>(row.time)), rate{vector(row.rate), ball(rate_bound)} {
    for (std::size_t i = 0; i < directions_of_a_row; ++i) {
      directions[i] = elliptude::Direction<Scalar>::within(vector(references[i]), vector(row.directions[i]),
                                                           static_cast<Scalar>(direction_bound));
    }
  }
};

/// Writes a line, word by word.
class Line {
 public:
  [[gnu::noinline]] Line& text(const char* word) {
    while (*word != '\0') {
      *end_++ = *word++;
    }
    *end_++ = ' ';
    return *this;
  }
  [[gnu::noinline]] Line& number(std::uint32_t value) {
    char digits[11];
    char* first = digits + 10;
    *first = '\0';
    do {
      *--first = static_cast<char>('0' + value % 10);
      value /= 10;
    } while (value != 0);
    return text(first);
  }
  [[gnu::noinline]] Line& bits(std::uint64_t value) {
    for (int shift = 60; shift >= 0; shift -= 4) {
      *end_++ = "0123456789abcdef"[(value >> shift) & 15];
    }
    *end_++ = ' ';
    return *this;
  }
  [[gnu::noinline]] void finish() {
    end_[-1] = '\n';
    *end_ = '\0';
    write(line_);
    end_ = line_;
  }

 private:
  char line_[128];
  char* end_ = line_;
};

/// FNV-1a of the bits of numbers.
class Digest {
 public:
  template <typename Matrix>
  void add(const Matrix& numbers) {
    add_bytes(reinterpret_cast<const unsigned char*>(numbers.data()),
              sizeof(Scalar) * static_cast<std::size_t>(numbers.size()));
  }
  [[gnu::noinline]] void add_bytes(const unsigned char* bytes, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      value_ = (value_ ^ bytes[i]) * 0x100000001B3U;
    }
  }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xCBF29CE484222325U;
};

/// The mean and the largest cost of what was done many times.
class Costs {
 public:
  void add(const Cost& cost) {
    sum_ += cost.instructions;
    ++count_;
    most_.instructions = cost.instructions > most_.instructions ? cost.instructions : most_.instructions;
    most_.stack = cost.stack > most_.stack ? cost.stack : most_.stack;
  }
  void write(const char* name) const {
    Line().text("cost").text(name).number(sum_ / count_).number(most_.instructions).number(most_.stack).finish();
  }

 private:
  std::uint32_t sum_ = 0;  // of 200, some ten millions; to divide 64 bits takes 0.7 kB
  std::uint32_t count_ = 0;
  Cost most_;
};

/// Predicts to each row but the first, which has started the filter, and updates with it.
/// \param predict, update from the row before and the row to a status.
/// \return 0 if all went well.
template <typename Filter, typename Predict, typename Update>
int replay(const Filter& filter, const Predict& predict, const Update& update) {
  Costs predictions;
  Costs updates;
  Measured before(recording[0]);
  for (int row = 1; row < rows; ++row) {
    const Measured now(recording[row]);
    Status predicted = Status::interrupted;
    Status updated = Status::interrupted;
    auto predict_once = [&] { predicted = predict(before, now); };
    auto update_once = [&] { updated = update(now); };
    predictions.add(measure(predict_once));
    updates.add(measure(update_once));
    Digest digest;
    digest.add(filter.ellipsoid().center.attitude);
    digest.add(elliptude::vector_part(filter.ellipsoid().center));
    digest.add(filter.ellipsoid().shape);
    using std::sqrt;
    const Scalar width = sqrt(filter.ellipsoid().shape.template topLeftCorner<3, 3>().trace());  // rad
    Line()
        .text("row")
        .number(static_cast<std::uint32_t>(row))
        .bits(digest.value())
        .number(static_cast<std::uint32_t>(width * static_cast<Scalar>(1e9)))
        .finish();
    if (predicted != Status::ok || updated != Status::ok) {
      Line().text("failed:").text(message(predicted)).text(message(updated)).finish();
      return 1;
    }
    before = now;
  }
  Line().text("size").number(sizeof(Filter)).finish();
  predictions.write("predict");
  updates.write("update");
  return 0;
}

}  // namespace flight
