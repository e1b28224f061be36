#pragma once

/// \file
/// How many steps a prediction may take, and how a caller stops a long one before its end.

#include "elliptude/base/limits.hpp"
#include "elliptude/base/scalar.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude {

/// A function that a flow calls about once in `interval` steps and that says whether to stop; null for none. It must
/// not throw, and gets `context` as given. A prediction that was stopped returns `Status::interrupted` and has changed
/// nothing.
struct Interruption {
  bool (*stop)(void* context) noexcept = nullptr;
  void* context = nullptr;

  static constexpr long interval = 64;

  /// Whether to stop after this many steps.
  [[nodiscard]] bool after(long steps) const noexcept {
    return stop != nullptr && steps > 0 && steps % interval == 0 && stop(context);
  }
};

/// What flows that predict in steps have in common. The `make` of a flow sets both limits back to what they are by
/// default: they are to be set after it.
class PredictionLimits {
 public:
  /// The most steps of one prediction; more are refused.
  [[nodiscard]] long most_steps() const noexcept { return most_steps_; }
  /// \return `out_of_range` unless positive.
  [[nodiscard]] Status set_most_steps(long most_steps) noexcept {
    if (most_steps < 1) {
      return Status::out_of_range;
    }
    most_steps_ = most_steps;
    return Status::ok;
  }
  void set_interruption(const Interruption& interruption) noexcept { interruption_ = interruption; }
  [[nodiscard]] const Interruption& interruption() const noexcept { return interruption_; }

 protected:
  /// The fewest equal steps that a positive duration is divided into so that none is longer than `longest` by more than
  /// a thousandth: the difference of two times is right to their rounding alone, and must not cost a second step.
  /// \return `too_many_steps`.
  template <typename Scalar>
  [[nodiscard]] Status divide(const Scalar& duration, const Scalar& longest, long& steps) const noexcept {
    const Scalar wanted = duration / longest * scalar::constant<Scalar>(0.999L);
    if (!(wanted <= Scalar(static_cast<scalar::Value<Scalar>>(most_steps_)))) {
      return Status::too_many_steps;
    }
    const long whole = wanted > Scalar(1) ? static_cast<long>(wanted) : 1;
    steps = Scalar(static_cast<scalar::Value<Scalar>>(whole)) < wanted ? whole + 1 : whole;
    return Status::ok;
  }

 private:
  long most_steps_ = default_most_steps;
  Interruption interruption_;
};

}  // namespace elliptude
