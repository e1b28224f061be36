#pragma once

/// \file
/// A long prediction that Ctrl-C ends, as it does a loop in Python.

#include <elliptude/base/interruption.hpp>
#include <elliptude/base/status.hpp>

namespace elliptude::python {

/// For a flow: asks whether a signal's handler has raised something. That is then Python's error of this thread, for
/// `raise_if_interrupted` to raise.
[[nodiscard]] Interruption interruption_by_signals() noexcept;

/// \throws what a signal's handler raised, for the status of a flow that was interrupted. With or without Python's lock.
void raise_if_interrupted(Status status);

}  // namespace elliptude::python
