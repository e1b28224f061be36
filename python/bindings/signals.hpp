#pragma once

/// \file
/// Lets Ctrl-C end a long prediction, as it ends a loop in Python.

#include <elliptude/base/interruption.hpp>
#include <elliptude/base/status.hpp>

namespace elliptude::python {

/// An interruption for a flow: whether a signal's handler has raised something. That is then Python's error in this thread, which
/// `raise_if_interrupted` raises.
[[nodiscard]] Interruption interruption_by_signals() noexcept;

/// \throws what a signal's handler raised, for the status of a flow that was interrupted. With or without Python's lock.
void raise_if_interrupted(Status status);

}  // namespace elliptude::python
