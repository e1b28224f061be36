#include "errors.hpp"

#include <pybind11/pybind11.h>

#include <array>
#include <cstdio>

namespace elliptude::python {

std::string text(double value) {
  std::array<char, 32> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%.9g", value);
  return buffer.data();
}

void value_error(const std::string& message) { throw pybind11::value_error(message); }

void raise(Status status, const std::string& subject) {
  const std::string explained = subject + ": " + message(status);
  if (status == Status::empty_intersection) {
    throw InconsistentSets(explained);
  }
  value_error(explained);
}

}  // namespace elliptude::python
