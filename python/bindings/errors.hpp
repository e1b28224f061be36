#pragma once

/// \file
/// What Python is told when something is wrong: the argument's name, the value and the limit. Nothing here needs the
/// interpreter's lock, so that loops can fail without it.

#include <elliptude/status.hpp>
#include <limits>
#include <stdexcept>
#include <string>

namespace elliptude::python {

/// Becomes `elliptude.InconsistentMeasurement`.
class InconsistentSets : public std::runtime_error {
 public:
  explicit InconsistentSets(const std::string& message, double margin = std::numeric_limits<double>::quiet_NaN())
      : std::runtime_error(message), margin_(margin) {}

  [[nodiscard]] double margin() const noexcept { return margin_; }

 private:
  double margin_;
};

/// A number as a message shows it.
[[nodiscard]] std::string text(double value);

/// \throws ValueError.
[[noreturn]] void value_error(const std::string& message);

/// \param subject what the status is about, for the message: an argument or an operation.
/// \throws InconsistentSets for an empty intersection, ValueError for any other status but `ok`.
void raise_unless_ok(Status status, const std::string& subject);

}  // namespace elliptude::python
