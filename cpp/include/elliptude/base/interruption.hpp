#pragma once

/// \file
/// How a caller stops a long prediction before its end.

namespace elliptude {

/// A function that a flow asks now and then, about once in `interval` steps, whether to stop; without one nothing is asked. It must not throw, and
/// `context` is handed to it as it was given. A prediction that was stopped says `Status::interrupted`, and nothing has changed.
struct Interruption {
  bool (*stop)(void* context) noexcept = nullptr;
  void* context = nullptr;

  static constexpr long interval = 64;

  /// Whether to stop after this many steps.
  [[nodiscard]] bool after(long steps) const noexcept {
    return stop != nullptr && steps > 0 && steps % interval == 0 && stop(context);
  }
};

/// The steps of one prediction that a flow takes unless told otherwise: with more of them the time is more likely wrong than
/// meant.
constexpr long default_most_steps = 1'000'000;

}  // namespace elliptude
