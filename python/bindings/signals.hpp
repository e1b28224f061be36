#pragma once

/// \file
/// Lets Ctrl-C end a long prediction, or a loop over rows, as it ends a loop in Python.

#include <cstddef>
#include <elliptude/base/interruption.hpp>
#include <elliptude/base/status.hpp>

namespace elliptude::python {

/// An interruption for a flow: whether a signal's handler has raised something. That is then Python's error in this thread, which
/// `raise_if_interrupted` raises.
[[nodiscard]] Interruption interruption_by_signals() noexcept;

/// \throws what a signal's handler raised, for the status of a flow that was interrupted. With or without Python's lock.
void raise_if_interrupted(Status status);

/// \throws what a signal's handler raises now. Without Python's lock, which it takes for as long.
void raise_signals();

/// The same at each 256th row of a loop.
inline void raise_signals_at(std::ptrdiff_t row) {
  if (row % 256 == 255) {
    raise_signals();
  }
}

}  // namespace elliptude::python
