#pragma once

/// \file
/// A seal of a filter's bytes, by which flight software finds that memory was changed between two calls: by radiation,
/// or by a pointer gone astray. (docs/flight.md)

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "elliptude/base/status.hpp"

namespace elliptude {

/// Two sums of the words of 32 bits that an object consists of, Σ wᵢ and Σ i wᵢ (counted from its end), with numbers
/// that words of zeros do not have. Whatever changes in one or two words is seen, so that every one or two flipped bits
/// are, and the loss of all: if d₁ + d₂ = 0 and i d₁ + j d₂ = 0 then d₁ = d₂ = 0, also modulo 2⁶⁴, as the d are less
/// than 2³² in size, and so are the i of an object of less than 16 GiB. Of other changes one in 2³² may remain unseen,
/// or fewer.
struct Seal {
  std::uint64_t sum = 0;
  std::uint64_t weighted = 0;

  friend bool operator==(const Seal& a, const Seal& b) noexcept { return a.sum == b.sum && a.weighted == b.weighted; }
  friend bool operator!=(const Seal& a, const Seal& b) noexcept { return !(a == b); }
};

/// The seal of these bytes as they are now.
[[nodiscard]] inline Seal seal_of(const void* bytes, std::size_t size) noexcept {
  // What the compiler knows of the object says nothing of what its memory holds: it must read it.
  const void* const volatile hidden = bytes;
  const auto* next = static_cast<const unsigned char*>(hidden);
  Seal seal{0x656C6C6970747564U, 0};
  std::uint32_t word = 0;
  for (std::size_t words = size / sizeof word; words > 0; --words, next += sizeof word) {
    std::memcpy(&word, next, sizeof word);
    seal.sum += word;
    seal.weighted += seal.sum;
  }
  if (const std::size_t rest = size % sizeof word; rest > 0) {
    word = 0;
    std::memcpy(&word, next, rest);
    seal.sum += word;
    seal.weighted += seal.sum;
  }
  return seal;
}

/// An object, such as a filter, with the seal of its bytes. Only `call` changes it; it verifies the seal before, and
/// renews it afterwards. Not copied as it is, because a copy need not have the bytes between an object's members: seal
/// a copy of the object.
template <typename Object>
class Sealed {
 public:
  explicit Sealed(const Object& object) noexcept : object_(object), seal_(seal_of(&object_, sizeof(Object))) {}
  ~Sealed() = default;
  Sealed(const Sealed&) = delete;
  Sealed& operator=(const Sealed&) = delete;
  Sealed(Sealed&&) = delete;
  Sealed& operator=(Sealed&&) = delete;

  /// \return `corrupted` if the bytes of the object or of the seal are not those that the last call left.
  [[nodiscard]] Status verify() const noexcept {
    return seal_of(&object_, sizeof(Object)) == seal_ ? Status::ok : Status::corrupted;
  }
  /// The object, whatever its seal says.
  [[nodiscard]] const Object& object() const noexcept { return object_; }

  /// Calls a function of the object that returns a status, if the seal holds.
  /// \return `corrupted`, and nothing was called; the status of the function.
  template <typename Function>
  [[nodiscard]] Status call(const Function& function) noexcept {
    if (const Status status = verify(); status != Status::ok) {
      return status;
    }
    const Status status = function(object_);
    seal_ = seal_of(&object_, sizeof(Object));
    return status;
  }

  /// Another object in the place of this one, such as a filter that was made again or a copy that was kept.
  void replace(const Object& object) noexcept {
    object_ = object;
    seal_ = seal_of(&object_, sizeof(Object));
  }

 private:
  Object object_;
  Seal seal_;
};

}  // namespace elliptude
