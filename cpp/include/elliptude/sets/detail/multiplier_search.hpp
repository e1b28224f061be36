#pragma once

/// \file
/// The search for the multipliers of guaranteed fusion, by Newton's method with bounds. (theory, eq. 16.4 and
/// section 16.5)

#include <algorithm>

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/detail/many_quadrics.hpp"
#include "elliptude/sets/detail/multiplier_step.hpp"

namespace elliptude::detail {

/// Minimises F over μ > 0 by Newton's method: each step is the best for a quadratic model of F among those that leave each
/// multiplier a share of what it was, is taken if F at its best scale falls, and is followed by that scale. Every iterate
/// is a valid bound, and the best is kept.
template <typename Scalar, int N>
class MultiplierSearch {
 public:
  using Problem = ManyQuadrics<Scalar, N>;
  using Iterate = typename Problem::Iterate;
  using Multipliers = typename Problem::Multipliers;

  /// \param scale what the multipliers are divided by to be those of the constraints as given.
  /// \param iterates the first one with A ≻ 0 and multipliers that are positive: where the search begins. The other is
  /// room to work in.
  MultiplierSearch(const Problem& problem, const Multipliers& scale, std::array<Iterate, 2>& iterates) noexcept
      : problem_(problem),
        scale_(scale),
        iterates_(iterates),
        count_(problem.count),
        step_(problem.count),
        now_(&iterates[0]),
        best_(&iterates[0]) {}

  /// \return `empty_intersection` with `best()` the proof.
  [[nodiscard]] Status run() noexcept {
    constexpr int most_steps = 12;
    for (int step = 0; step <= most_steps; ++step) {
      steps_ = step;
      note_margin(step == 0);
      if (now_->level + now_->rounding < Scalar(0)) {
        best_ = now_;
        return Status::empty_intersection;
      }
      best_ = now_->size < best_->size ? now_ : best_;
      ended_by_limit_ = step == most_steps && !is_done_;
      if (!(now_->level > now_->rounding) || ended_by_limit_ || is_done_) {
        break;
      }
      bring_to_best_scale();
      problem_.gradient(*now_, v_, step_.gradient);
      if (!take_step()) {
        break;
      }
    }
    // What is below zero by rounding alone proves nothing.
    margin_ = margin_ < Scalar(0) ? Scalar(0) : margin_;
    return Status::ok;
  }

  [[nodiscard]] const Iterate& best() const noexcept { return *best_; }
  /// The least N/Σμ that was met, with the multipliers of the constraints as given.
  [[nodiscard]] const Scalar& margin() const noexcept { return margin_; }
  /// How many steps were taken, and whether that was all that may be.
  [[nodiscard]] int steps() const noexcept { return steps_; }
  [[nodiscard]] bool ended_by_limit() const noexcept { return ended_by_limit_; }

 private:
  void note_margin(bool is_first) noexcept {
    const Iterate& it = *now_;
    Scalar sum(0);
    for (std::size_t k = 0; k < count_; ++k) {
      sum += it.multipliers[k] / scale_[k];  // as given
    }
    margin_ = is_first || it.level / sum < margin_ ? Scalar(it.level / sum) : margin_;
  }

  /// The same ellipsoid, the best or not, with the multipliers at their best scale.
  void bring_to_best_scale() noexcept {
    Iterate& it = *now_;
    const Scalar t = Scalar(N) / it.level;
    for (std::size_t k = 0; k < count_; ++k) {
      it.multipliers[k] *= t;
    }
    it.level *= t;
    it.rounding *= t;
    it.inverse *= Scalar(1) / t;
    it.root *= Scalar(1) / scalar::sqrt(t);
    it.barrier = it.size - log_dimension_;
  }

  /// \return whether there was a step worth it, and it could be taken.
  [[nodiscard]] bool take_step() noexcept {
    const Iterate& it = *now_;
    const Scalar accuracy = tolerance_ + scalar::constant<Scalar>(0.1L) * it.rounding;
    const bool exchange = step_.may_exchange(it.multipliers, accuracy);
    Multipliers least_curvature;
    if (!exchange) {
      for (std::size_t k = 0; k < count_; ++k) {
        least_curvature[k] = problem_.least_curvature(k, it, v_, step_.gradient);
      }
      if (!step_.may_gain(it.multipliers, least_curvature, accuracy)) {
        return false;
      }
    }
    problem_.hessian(it, v_, step_.gradient, step_.hessian.data());
    return step_.find(it.multipliers, accuracy) && search_along_step();
  }

  /// F at its best scale must fall along the step, which is made more careful until it does.
  /// \return whether it falls; the next iterate is then `now_`.
  [[nodiscard]] bool search_along_step() noexcept {
    const Iterate& it = *now_;
    const Scalar value = it.size;
    const Scalar noise = rounding::share<Scalar>(rounding::objective) * (Scalar(1) + scalar::abs(value)) + it.rounding;
    Multipliers from;
    std::copy_n(it.multipliers.begin(), count_, from.begin());
    now_ = best_ == &iterates_[0] ? &iterates_[1] : &iterates_[0];
    constexpr int most_trials = 12;
    for (int trial = 0; trial < most_trials; ++trial) {
      Multipliers next;
      step_.put_end(from, next);
      const bool is_bound = problem_.combine(next, *now_) == Status::ok;
      const Scalar change = is_bound ? Scalar(now_->size - value) : Scalar(0);
      if (is_bound && (step_.falls(change, noise) || now_->level + now_->rounding < Scalar(0))) {
        is_done_ = step_.is_last(change, tolerance_);
        step_.begin_anew();
        return true;
      }
      if (!step_.retry(from, is_bound ? &change : nullptr)) {
        return false;
      }
    }
    return false;
  }

  const Problem& problem_;
  const Multipliers& scale_;
  std::array<Iterate, 2>& iterates_;
  std::size_t count_;
  MultiplierStep<Scalar> step_;
  const Scalar log_dimension_ = Scalar(N) * scalar::log(Scalar(N));
  // What is left of F − min F, and so of the logarithm of the volume, or N times that of the trace.
  const Scalar tolerance_ = scalar::constant<Scalar>(1e-3L);
  Iterate* now_;
  const Iterate* best_;
  Scalar margin_;
  int steps_ = 0;
  bool ended_by_limit_ = false;
  bool is_done_ = false;  // whether the last step left no more than the tolerance
  Matrix<Scalar, N> v_;
};

}  // namespace elliptude::detail
