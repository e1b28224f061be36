#pragma once

/// \file
/// Errors for Python: messages with the argument's name, the value and the limit. Nothing here needs the
/// interpreter's lock, so that loops can fail without it.

#include <cstddef>
#include <elliptude/base/status.hpp>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace elliptude::python {

/// Becomes `elliptude.InconsistentMeasurement`.
class InconsistentSets : public std::runtime_error {
 public:
  explicit InconsistentSets(const std::string& message, double margin = std::numeric_limits<double>::quiet_NaN(),
                            double time = std::numeric_limits<double>::quiet_NaN(), std::string sensor = {})
      : std::runtime_error(message), margin_(margin), time_(time), sensor_(std::move(sensor)) {}

  [[nodiscard]] double margin() const noexcept { return margin_; }
  [[nodiscard]] double time() const noexcept { return time_; }
  [[nodiscard]] const std::string& sensor() const noexcept { return sensor_; }
  /// The row of a log; −1 without a log.
  [[nodiscard]] std::ptrdiff_t row() const noexcept { return row_; }
  void set_row(std::ptrdiff_t row) noexcept { row_ = row; }

 private:
  double margin_;
  double time_;
  std::string sensor_;
  std::ptrdiff_t row_ = -1;
};

/// Becomes `elliptude.RowError`: what is wrong in one row of a log.
class RowFault : public std::runtime_error {
 public:
  RowFault(const std::string& message, std::ptrdiff_t row) : std::runtime_error(message), row_(row) {}

  [[nodiscard]] std::ptrdiff_t row() const noexcept { return row_; }

 private:
  std::ptrdiff_t row_;
};

/// A number as a message shows it.
[[nodiscard]] std::string text(double value);

/// \throws ValueError.
[[noreturn]] void value_error(const std::string& message);

/// \throws ValueError unless positive.
void check_most_steps(long most_steps);

/// For a prediction with more steps than its flow allows.
[[noreturn]] void raise_too_many_steps(double time, double from, long most_steps);

/// \throws `elliptude.errors.PredictionError`, a ValueError: the arguments are right, and no set can be given after the interval.
[[noreturn]] void prediction_error(const std::string& message);

/// \throws OverflowError. Not std::overflow_error: pybind11 lets one module translate what the standard library throws in all, and modules
/// that have each a C++ library linked into them do not know each other's types (`make wheel`).
[[noreturn]] void overflow_error(const std::string& message);

/// \param subject the argument or operation that the status is about, for the message.
/// \throws InconsistentSets for an empty intersection, ValueError for any other status.
[[noreturn]] void raise(Status status, const std::string& subject);

/// \throws `elliptude.errors.PredictionError` for any status of a prediction whose arguments are right.
[[noreturn]] void raise_unpredicted(Status status, const std::string& subject);

/// In loops use `raise` instead: it makes the subject only when it is needed.
inline void raise_unless_ok(Status status, const std::string& subject) {
  if (status != Status::ok) {
    raise(status, subject);
  }
}

}  // namespace elliptude::python
