#include "signals.hpp"

#include <pybind11/pybind11.h>

#include <chrono>

namespace py = pybind11;

namespace elliptude::python {

Interruption interruption_by_signals() noexcept {
  using Clock = std::chrono::steady_clock;
  Interruption interruption;
  interruption.stop = [](void*) noexcept {
    // To wait for the interpreter's lock may take as long as other threads hold it: milliseconds each time.
    constexpr std::chrono::milliseconds pause(50);
    thread_local Clock::time_point last;
    if (Clock::now() - last < pause) {
      return false;
    }
    const py::gil_scoped_acquire acquire;
    const bool raised = PyErr_CheckSignals() != 0;
    last = Clock::now();
    return raised;
  };
  return interruption;
}

void raise_signals() {
  const py::gil_scoped_acquire acquire;
  if (PyErr_CheckSignals() != 0) {
    throw py::error_already_set();
  }
}

void raise_if_interrupted(Status status) {
  if (status == Status::interrupted) {
    const py::gil_scoped_acquire acquire;
    throw py::error_already_set();
  }
}

}  // namespace elliptude::python
