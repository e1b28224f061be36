#pragma once

/// \file
/// Lets a caller stop a long prediction before its end.

namespace elliptude {

/// A function that a flow calls about once in `interval` steps and that says whether to stop; null for none. It must not throw,
/// and gets `context` as given. A prediction that was stopped returns `Status::interrupted` and has changed nothing.
struct Interruption {
  bool (*stop)(void* context) noexcept = nullptr;
  void* context = nullptr;

  static constexpr long interval = 64;

  /// Whether to stop after this many steps.
  [[nodiscard]] bool after(long steps) const noexcept {
    return stop != nullptr && steps > 0 && steps % interval == 0 && stop(context);
  }
};

/// The most steps of one prediction, unless a flow is told otherwise: more of them are more likely a wrong time than intended.
constexpr long default_most_steps = 1'000'000;

}  // namespace elliptude
