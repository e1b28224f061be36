#pragma once

/// \file
/// A step of the search for the multipliers of guaranteed fusion: what does not depend on how many numbers an ellipsoid
/// has, and so is there once for all. (theory, section 16.5)

#include <algorithm>
#include <array>
#include <limits>

#include "elliptude/base/limits.hpp"
#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/base/scalar.hpp"

namespace elliptude::detail {

/// A step of Newton's method for multipliers that stay above zero: the Δμ that is best for ∇Fᵀ Δμ + ½ Δμᵀ ∇²F Δμ among
/// those that take no multiplier lower than a share of what it is.
template <typename Scalar>
class MultiplierStep {
 public:
  static constexpr std::size_t most = most_quadrics + 1;
  using Multipliers = std::array<Scalar, most>;

  Multipliers gradient;  ///< ∇F
  /// ∇²F, the lower triangle, in rows of length `most`. Above the diagonal is room for a factor.
  std::array<Scalar, most * most> hessian;

  explicit MultiplierStep(std::size_t count) noexcept : count_(count) {}

  /// Exchanges of constraints that are alike gain more than each multiplier alone: for these Σμg of those that would
  /// fall, as ∇Fᵀμ = 0.
  [[nodiscard]] bool may_exchange(const Multipliers& multipliers, const Scalar& accuracy) const noexcept {
    Scalar exchange(0);
    for (std::size_t k = 0; k < count_; ++k) {
      exchange += gradient[k] > Scalar(0) ? Scalar(multipliers[k] * gradient[k]) : Scalar(0);
    }
    return exchange > Scalar(2) * accuracy;
  }

  /// What moving one multiplier alone, and then all to their best scale, would gain, summed: g²/2c with what ∂²F has
  /// beside the direction of μ itself; but no more than μg of one that can only fall to zero.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool may_gain(const Multipliers& multipliers, const Multipliers& least_curvature,
                                                    const Scalar& accuracy) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar infinite(std::numeric_limits<scalar::Value<Scalar>>::infinity());
    Scalar gain(0);
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar& g = gradient[k];
      const Scalar raise = half * g * g;
      const Scalar removal = multipliers[k] * g;
      const Scalar& least = least_curvature[k];
      const Scalar change = least > Scalar(0) ? Scalar(raise / least) : infinite;
      gain += g > Scalar(0) && removal < change ? removal : change;
    }
    return !(gain <= accuracy);
  }

  /// \return whether there is one that promises to gain more than the accuracy.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool find(const Multipliers& multipliers, const Scalar& accuracy) noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      lowest_[k] = -fall_ * multipliers[k];
    }
    if (!settle_bounds()) {
      meet_bounds();
    }
    length_ = Scalar(1);
    slope_ = Scalar(0);
    left_ = Scalar(0);
    Scalar held(0);  // by bounds: the model's derivative at the end is zero for the others
    for (std::size_t k = 0; k < count_; ++k) {
      slope_ += gradient[k] * move_[k];
      if (at_bound_[k]) {
        const Scalar there = slope_at(k);
        held += there * move_[k];
        left_ += there * (multipliers[k] + lowest_[k]);
      }
    }
    gain_ = scalar::constant<Scalar>(-0.5L) * (slope_ + held);
    return slope_ < Scalar(0) && gain_ > scalar::constant<Scalar>(0.9L) * accuracy;  // F is not quite its model
  }

  /// The multipliers at the end of the step, none of them negative whatever rounding made of it. When a step is tried
  /// for the first time, those that grow do so as if ∂F were linear in 1/μ, as it is where a constraint is all that bounds a
  /// coordinate: from μ and Δμ to μ²/(μ − Δμ), and no more than as far again.
  ELLIPTUDE_OUT_OF_LINE void put_end(const Multipliers& from, Multipliers& next) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar move = length_ * move_[k];
      const Scalar end = from[k] + move;
      const Scalar least = from[k] - most_fall_ * from[k];
      next[k] = end > least ? end : least;  // also where it is no number
      if (failures_ == 0 && move > Scalar(0)) {
        next[k] += move < half * from[k] ? Scalar(move * move / (from[k] - move)) : Scalar(half * from[k]);
      }
    }
  }

  /// \return whether F at its best scale changed by this as it has to, but for noise.
  [[nodiscard]] bool falls(const Scalar& change, const Scalar& noise) const noexcept {
    return change <= scalar::constant<Scalar>(1e-3L) * length_ * slope_ + noise;
  }
  /// Whether a step that changed F by this was as good as it promised, and short: another one would gain about the
  /// square of its gain, and what multipliers at their bounds are kept from.
  [[nodiscard]] bool is_last(const Scalar& change, const Scalar& accuracy) const noexcept {
    return failures_ == 0 && gain_ <= scalar::constant<Scalar>(0.01L) &&
           scalar::abs(Scalar(change + gain_)) + left_ <= accuracy;
  }

  /// After a step that was taken.
  void begin_anew() noexcept {
    if (failures_ == 0) {
      fall_ = fall_ > scalar::constant<Scalar>(0.5L) ? most_fall_ : Scalar(Scalar(2) * fall_);
    }
    failures_ = 0;
  }
  /// A more careful step: multipliers fall less, and then the step is shorter, by the parabola through what is known of F.
  /// \param change of F, or null where A is not positive definite.
  /// \return whether there is one.
  [[nodiscard]] bool retry(const Multipliers& multipliers, const Scalar* change) noexcept {
    ++failures_;
    constexpr int most_searches = 3;
    if (failures_ <= most_searches) {
      fall_ = fall_ > scalar::constant<Scalar>(0.9L) ? scalar::constant<Scalar>(0.8L)
                                                     : Scalar(scalar::constant<Scalar>(0.4L) * fall_);
      return find(multipliers, Scalar(0));
    }
    if (change == nullptr) {
      length_ *= scalar::constant<Scalar>(0.25L);
      return true;
    }
    const Scalar parabola = Scalar(-0.5) * slope_ * length_ * length_ / (*change - slope_ * length_);
    const Scalar least = scalar::constant<Scalar>(0.1L) * length_;
    const Scalar most_of_it = scalar::constant<Scalar>(0.5L) * length_;
    length_ = parabola < most_of_it ? (parabola > least ? parabola : least) : most_of_it;
    return true;
  }

 private:
  /// An entry of ∇²F.
  [[nodiscard]] const Scalar& second_derivative(std::size_t i, std::size_t j) const noexcept {
    return hessian[std::max(i, j) * most + std::min(i, j)];
  }
  /// The model's derivative at the end of the step.
  [[nodiscard]] Scalar slope_at(std::size_t k) const noexcept {
    Scalar sum = gradient[k];
    for (std::size_t j = 0; j <= k; ++j) {
      sum += hessian[k * most + j] * move_[j];
    }
    for (std::size_t j = k + 1; j < count_; ++j) {
      sum += hessian[j * most + k] * move_[j];
    }
    return sum;
  }

  /// The best step by guessing which multipliers are at their bounds, at first those of the step before, until the guess is
  /// right.
  /// \return whether it was after a few rounds, as it nearly always is.
  [[nodiscard]] bool settle_bounds() noexcept {
    constexpr int most_rounds = 5;
    for (int round = 0; round < most_rounds; ++round) {
      solve();
      bool changed = false;
      for (std::size_t k = 0; k < count_; ++k) {
        const bool is = at_bound_[k] ? slope_at(k) >= Scalar(0) : move_[k] < lowest_[k];
        changed = changed || is != at_bound_[k];
        at_bound_[k] = is;
      }
      if (!changed) {
        return true;
      }
    }
    return false;
  }

  /// The best step by a way along which the model falls: towards the best for the bounds that are met until the next is met,
  /// and where it ends, without the bound that holds it back most. A step that lowers the model, if the rounds end before.
  ELLIPTUDE_OUT_OF_LINE void meet_bounds() noexcept {
    std::fill_n(at_bound_.begin(), count_, false);
    Multipliers reached;
    std::fill_n(reached.begin(), count_, Scalar(0));
    const std::size_t most_rounds = 3 * count_;
    for (std::size_t round = 0; round < most_rounds; ++round) {
      solve();
      Scalar share(1);
      std::size_t met = count_;
      for (std::size_t k = 0; k < count_; ++k) {
        const Scalar way = move_[k] - reached[k];
        if (!at_bound_[k] && reached[k] + share * way < lowest_[k]) {
          const Scalar left = (lowest_[k] - reached[k]) / way;
          share = left > Scalar(0) ? left : Scalar(0);  // rounding may have taken it beyond
          met = k;
        }
      }
      for (std::size_t k = 0; k < count_; ++k) {
        reached[k] += share * (move_[k] - reached[k]);
      }
      if (met < count_) {
        at_bound_[met] = true;
        continue;
      }
      Scalar least(0);
      for (std::size_t k = 0; k < count_; ++k) {
        const Scalar slope = at_bound_[k] ? slope_at(k) : Scalar(0);
        met = slope < least ? k : met;
        least = slope < least ? slope : least;
      }
      if (met == count_) {
        return;
      }
      at_bound_[met] = false;
    }
    std::copy_n(reached.begin(), count_, move_.begin());
  }

  /// The best step with some multipliers at their bounds and no bounds for the others, by L diag(p)⁻¹ Lᵀ of their ∇²F:
  /// Lᵀ without the division by pivots is above the diagonal. A pivot that is rounding is made one that is not.
  ELLIPTUDE_OUT_OF_LINE void solve() noexcept {
    std::array<std::size_t, most> free;
    std::size_t free_count = 0;
    for (std::size_t k = 0; k < count_; ++k) {
      if (at_bound_[k]) {
        move_[k] = lowest_[k];
      } else {
        free[free_count++] = k;
      }
    }
    Multipliers inverse_pivots;
    Multipliers row;
    for (std::size_t j = 0; j < free_count; ++j) {
      const std::size_t column = free[j];
      Scalar right = -gradient[column];
      for (std::size_t k = 0; k < count_; ++k) {
        right -= at_bound_[k] ? Scalar(second_derivative(column, k) * lowest_[k]) : Scalar(0);
      }
      for (std::size_t k = 0; k < j; ++k) {
        const Scalar& above = hessian[free[k] * most + column];
        row[k] = above * inverse_pivots[k];
        right -= above * move_[free[k]];
      }
      for (std::size_t i = j; i < free_count; ++i) {
        Scalar sum = hessian[free[i] * most + column];
        for (std::size_t k = 0; k < j; ++k) {
          sum -= hessian[free[k] * most + free[i]] * row[k];
        }
        if (i == j) {
          const Scalar& g = gradient[column];
          const Scalar least = rounding::root<Scalar>() * (second_derivative(column, column) + g * g);
          inverse_pivots[j] = Scalar(1) / (sum > least ? sum : least);
        } else {
          hessian[column * most + free[i]] = sum;
        }
      }
      move_[column] = right * inverse_pivots[j];
    }
    for (std::size_t i = free_count; i-- > 0;) {
      Scalar sum(0);
      for (std::size_t k = i + 1; k < free_count; ++k) {
        sum += hessian[free[i] * most + free[k]] * move_[free[k]];
      }
      move_[free[i]] -= inverse_pivots[i] * sum;
    }
  }

  std::size_t count_;
  int failures_ = 0;                                          // of the steps since one was taken
  const Scalar most_fall_ = scalar::constant<Scalar>(0.99L);  // by which share a multiplier may fall at once
  Scalar fall_ = most_fall_;                                  // by which it may now
  Multipliers lowest_;                                        // what Δμ may be
  Multipliers move_;                                          // Δμ
  std::array<bool, most> at_bound_{};
  Scalar slope_;   // of F along Δμ
  Scalar gain_;    // that the model promises
  Scalar left_;    // of what multipliers at their bounds would gain at zero
  Scalar length_;  // of the step, in units of `move_`
};

}  // namespace elliptude::detail
