#pragma once

/// \file
/// The measurements of one moment, and sets of them as bits.

#include <cstdint>

#include "elliptude/measurement/quadrics.hpp"

namespace elliptude {

/// The measurements of one moment. Null or a length of zero means not measured.
template <typename Scalar>
struct Measurements {
  const Direction<Scalar>* directions = nullptr;
  std::size_t direction_count = 0;
  const AngularVelocity<Scalar>* angular_velocity = nullptr;
  const MeasuredAttitude<Scalar>* attitude = nullptr;
};

/// One bit for each measurement of an update: the directions, of which there are at most 32, and two more.
using Sensors = std::uint64_t;

[[nodiscard]] constexpr Sensors direction_bit(std::size_t i) noexcept { return Sensors(1) << i; }
inline constexpr Sensors angular_velocity_bit = Sensors(1) << 32;
inline constexpr Sensors attitude_bit = Sensors(1) << 33;

namespace detail::sensors {

[[nodiscard]] constexpr Sensors lowest(Sensors sensors) noexcept { return sensors & (~sensors + 1); }

[[nodiscard]] constexpr int number_of(Sensors sensors) noexcept {
  int count = 0;
  for (; sensors != 0; sensors &= sensors - 1) {
    ++count;
  }
  return count;
}

/// Which measurement the constraint of this index is; they come in the order of their bits.
[[nodiscard]] constexpr Sensors at(Sensors selected, std::size_t index) noexcept {
  for (; selected != 0; selected &= selected - 1) {
    if (index == 0) {
      return lowest(selected);
    }
    --index;
  }
  return 0;
}

template <typename Scalar>
[[nodiscard]] Sensors present(const Measurements<Scalar>& measurements) noexcept {
  Sensors all = 0;
  for (std::size_t i = 0; i < measurements.direction_count; ++i) {
    all |= direction_bit(i);
  }
  all |= measurements.angular_velocity != nullptr ? angular_velocity_bit : 0;
  all |= measurements.attitude != nullptr ? attitude_bit : 0;
  return all;
}

/// Calls `add` with every choice of all but `wrong` (0, 1 or 2) of the sensors.
template <typename Add>
void for_each_choice(Sensors all, int wrong, const Add& add) noexcept {
  if (wrong >= number_of(all)) {
    add(Sensors(0));
    return;
  }
  if (wrong == 0) {
    add(all);
    return;
  }
  for (Sensors first = all; first != 0; first &= first - 1) {
    if (wrong == 1) {
      add(all & ~lowest(first));
      continue;
    }
    for (Sensors second = first & (first - 1); second != 0; second &= second - 1) {
      add(all & ~lowest(first) & ~lowest(second));
    }
  }
}

/// The status of `validate` for measurements that are not valid, even if they would not have been used; else `status`.
template <typename Scalar>
[[nodiscard]] Status checked(const Measurements<Scalar>& measurements, Status status) noexcept {
  for (std::size_t i = 0; i < measurements.direction_count; ++i) {
    if (const Status invalid = validate(measurements.directions[i]); invalid != Status::ok) {
      return invalid;
    }
  }
  if (measurements.angular_velocity != nullptr) {
    if (const Status invalid = validate(*measurements.angular_velocity); invalid != Status::ok) {
      return invalid;
    }
  }
  if (!only_directions && measurements.attitude != nullptr) {
    Quadric<Scalar, 3> quadric;
    if (const Status invalid = to_quadric(measurements.attitude->attitude, *measurements.attitude, quadric);
        invalid != Status::ok) {
      return invalid;
    }
  }
  return status;
}

}  // namespace detail::sensors
}  // namespace elliptude
