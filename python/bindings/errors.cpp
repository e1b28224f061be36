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

void check_most_steps(long most_steps) {
  if (most_steps < 1) {
    value_error("most_steps must be positive, but is " + std::to_string(most_steps));
  }
}

void raise_too_many_steps(double time, double from, long most_steps) {
  value_error("the prediction from " + text(from) + " s to " + text(time) +
              " s takes more than most_steps = " + std::to_string(most_steps) +
              " steps of the flow: is the time right? Else lengthen step, or raise most_steps");
}

void raise(Status status, const std::string& subject) {
  std::string explained = subject + ": " + message(status);
  if (status == Status::beyond_domain) {
    explained += " (semi-axes are 0 or from 1e-138 to 1e137)";
  }
  if (status == Status::empty_intersection) {
    throw InconsistentSets(explained);
  }
  value_error(explained);
}

}  // namespace elliptude::python
