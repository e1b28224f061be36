#include "errors.hpp"

#include <pybind11/pybind11.h>

#include <array>
#include <cstdio>

namespace elliptude::python {

namespace {

class PredictionError : public pybind11::value_error {
 public:
  using value_error::value_error;
  void set_error() const override {
    pybind11::set_error(pybind11::module_::import("elliptude.errors").attr("PredictionError"), what());
  }
};

class OverflowError : public pybind11::builtin_exception {
 public:
  using builtin_exception::builtin_exception;
  void set_error() const override { pybind11::set_error(PyExc_OverflowError, what()); }
};

std::string explained(Status status, const std::string& subject) {
  return subject + ": " + message(status) +
         (status == Status::beyond_domain ? " (semi-axes are 0 or from 1e-138 to 1e137)" : "");
}

}  // namespace

std::string text(double value) {
  std::array<char, 32> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%.9g", value);
  return buffer.data();
}

void value_error(const std::string& message) { throw pybind11::value_error(message); }

void prediction_error(const std::string& message) { throw PredictionError(message); }

void overflow_error(const std::string& message) { throw OverflowError(message); }

void check_most_steps(long most_steps) {
  if (most_steps < 1) {
    value_error("most_steps must be positive, but is " + std::to_string(most_steps));
  }
}

void raise_too_many_steps(double time, double from, long most_steps) {
  prediction_error("the prediction from " + text(from) + " s to " + text(time) +
                   " s takes more than most_steps = " + std::to_string(most_steps) +
                   " steps of the flow: is the time right? Else lengthen step, or raise most_steps");
}

void raise(Status status, const std::string& subject) {
  if (status == Status::empty_intersection) {
    throw InconsistentSets(explained(status, subject));
  }
  value_error(explained(status, subject));
}

void raise_unpredicted(Status status, const std::string& subject) { throw PredictionError(explained(status, subject)); }

}  // namespace elliptude::python
