#pragma once

/// \file
/// The filter's memory of contradictions: when it gives up a contradicted past. (theory, section 16.8)

#include <limits>

namespace elliptude {

/// Whether the set rests on measurements that were left out, and what updates have shown since.
class Trust {
 public:
  Trust() = default;
  Trust(bool rests_on_drops, int agreeing_updates, int disputed_updates, unsigned contradictions = 0) noexcept
      : rests_on_drops_(rests_on_drops),
        agreeing_updates_(agreeing_updates),
        disputed_updates_(disputed_updates),
        contradictions_(contradictions) {}

  [[nodiscard]] bool rests_on_drops() const noexcept { return rests_on_drops_; }
  /// Updates in a row without contradiction.
  [[nodiscard]] int agreeing_updates() const noexcept { return agreeing_updates_; }
  /// Updates since the first contradiction, or since the past was last given up for one.
  [[nodiscard]] int disputed_updates() const noexcept { return disputed_updates_; }
  /// Updates that contradicted, ever: whether any did between two moments.
  [[nodiscard]] unsigned contradictions() const noexcept { return contradictions_; }

  /// Counts an update that measured something.
  /// \param taken_up whether there is a set or a vector that could rest on what was left out.
  void count(bool contradicted, bool taken_up) noexcept {
    const auto one_more = [](int& number) { number += number < std::numeric_limits<int>::max() ? 1 : 0; };
    if (rests_on_drops_) {
      one_more(disputed_updates_);
    }
    if (contradicted) {
      ++contradictions_;
      agreeing_updates_ = 0;
      rests_on_drops_ = rests_on_drops_ || taken_up;
    } else {
      one_more(agreeing_updates_);
    }
  }

  /// Whether the set should be taken from the measurements of one moment alone.
  [[nodiscard]] bool past_is_due(int regain_after) const noexcept {
    return rests_on_drops_ && (agreeing_updates_ >= regain_after || disputed_updates_ >= regain_after);
  }

  /// The set is now taken from them. It rests on nothing that was left out, but is called unconditional only when
  /// updates agree.
  void give_up_past(int regain_after) noexcept {
    disputed_updates_ = 0;
    rests_on_drops_ = agreeing_updates_ < regain_after;
  }

  /// Nothing is left that could rest on what was left out.
  void forget() noexcept { *this = Trust(false, 0, 0, contradictions_); }

 private:
  bool rests_on_drops_ = false;
  int agreeing_updates_ = 0;
  int disputed_updates_ = 0;
  unsigned contradictions_ = 0;
};

}  // namespace elliptude
