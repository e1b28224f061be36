#pragma once

/// \file
/// The search for the multipliers of guaranteed fusion, by a primal-dual interior-point method. (theory, section 16)

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/detail/many_quadrics.hpp"

namespace elliptude::detail {

/// A positive definite H as L diag(1/p) Lᵀ with a unit lower triangle L, in place: L below the diagonal of H, of which
/// the lower triangle is read, p on it, and Lᵀ without the division by pivots above it.
/// \return whether H is positive definite.
template <typename Scalar>
[[nodiscard]] bool factor_in_place(Scalar* h, std::size_t stride, std::size_t count) noexcept {
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t i = j; i < count; ++i) {
      Scalar sum = h[i * stride + j];
      for (std::size_t k = 0; k < j; ++k) {
        sum -= h[i * stride + k] * h[k * stride + j];
      }
      if (i == j) {
        if (!(sum > Scalar(0))) {
          return false;
        }
        h[j * stride + j] = Scalar(1) / sum;
      } else {
        h[j * stride + i] = sum;
        h[i * stride + j] = sum * h[j * stride + j];
      }
    }
  }
  return true;
}

/// x = H⁻¹ b in place of b, with what `factor_in_place` has left.
template <typename Scalar>
void solve_in_place(const Scalar* factor, std::size_t stride, std::size_t count, Scalar* b) noexcept {
  for (std::size_t i = 1; i < count; ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      b[i] -= factor[i * stride + k] * b[k];
    }
  }
  for (std::size_t i = count; i-- > 0;) {
    b[i] *= factor[i * stride + i];
    for (std::size_t k = i + 1; k < count; ++k) {
      b[i] -= factor[k * stride + i] * b[k];
    }
  }
}

/// How much of a step stays above zero, up to a share of the way there.
/// \param from, along arrays of `count` numbers, the first positive.
template <typename Scalar, std::size_t Most>
[[nodiscard]] Scalar longest_step(const std::array<Scalar, Most>& from, const std::array<Scalar, Most>& along,
                                  std::size_t count, const Scalar& share) noexcept {
  Scalar length(1);
  for (std::size_t k = 0; k < count; ++k) {
    if (length * along[k] < -share * from[k]) {
      length = -share * from[k] / along[k];
    }
  }
  return length;
}

/// Minimises F over μ ≥ 0 by a primal-dual interior-point method: each step solves (∇²F + diag(zₖ/μₖ)) Δμ = t/μ − ∇F
/// with a target tₖ for each μₖzₖ, stays inside μ > 0 and A ≻ 0, and is followed by the best scale. Every iterate is a
/// valid bound, and the best is kept.
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
        now_(&iterates[0]),
        best_(&iterates[0]) {}

  /// \return `empty_intersection` with `best()` the proof.
  [[nodiscard]] Status run() noexcept {
    constexpr int most_steps = 20;
    for (int step = 0; step <= most_steps; ++step) {
      steps_ = step;
      note_margin(step == 0);
      if (now_->level + now_->rounding < Scalar(0)) {
        best_ = now_;
        return Status::empty_intersection;
      }
      best_ = now_->size < best_->size ? now_ : best_;
      ended_by_limit_ = step == most_steps;
      if (!(now_->level > now_->rounding) || ended_by_limit_) {
        break;
      }
      bring_to_best_scale();
      problem_.gradient(*now_, v_, gradient_);
      if (step == 0) {
        start_duals();
      }
      if (!take_step()) {
        break;
      }
    }
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
      z_[k] /= t;
    }
    it.level *= t;
    it.rounding *= t;
    it.inverse *= Scalar(1) / t;
    it.root *= Scalar(1) / scalar::sqrt(t);
    it.barrier = it.size - log_dimension_;
  }

  void start_duals() noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar least = scalar::constant<Scalar>(0.002L) * Scalar(N) / (Scalar(count_) * now_->multipliers[k]);
      z_[k] = gradient_[k] > least ? gradient_[k] : least;
    }
  }

  /// A step of Mehrotra's predictor and corrector.
  /// \return whether there was one worth it, and it could be taken.
  [[nodiscard]] bool take_step() noexcept {
    const Iterate& it = *now_;
    const Scalar accuracy = tolerance_ + it.rounding;
    const bool exchange = may_exchange(accuracy);
    if (!exchange &&
        !may_gain(accuracy, [&](std::size_t k) { return problem_.least_curvature(k, it, v_, gradient_); })) {
      return false;
    }
    problem_.hessian(it, v_, gradient_, hessian_.data());
    const bool worth_it = exchange || may_gain(accuracy, [&](std::size_t k) {
                            const Scalar trace = it.slack[k] - gradient_[k];
                            return Scalar(hessian_[k * Problem::most + k] - trace * trace / Scalar(N));
                          });
    for (std::size_t k = 0; k < count_; ++k) {
      hessian_[k * Problem::most + k] += z_[k] / it.multipliers[k];
    }
    if (!factor_in_place(hessian_.data(), Problem::most, count_)) {
      return false;
    }
    Multipliers target;
    std::fill_n(target.begin(), count_, Scalar(0));
    aim_at(target);
    Scalar fall(0);  // of F along its tangent: no less than what the whole step would gain
    for (std::size_t k = 0; k < count_; ++k) {
      fall -= gradient_[k] * move_[k];
    }
    if (fall <= accuracy && !worth_it) {
      return false;
    }
    const Scalar tau = target_product();
    correct(tau, target);
    return search_along_step(tau);
  }

  /// Exchanges of constraints that are alike gain more than each multiplier alone: for these Σμg of those that would
  /// fall, as ∇Fᵀμ = 0.
  [[nodiscard]] bool may_exchange(const Scalar& accuracy) const noexcept {
    Scalar exchange(0);
    for (std::size_t k = 0; k < count_; ++k) {
      exchange += gradient_[k] > Scalar(0) ? Scalar(now_->multipliers[k] * gradient_[k]) : Scalar(0);
    }
    return exchange > Scalar(2) * accuracy;
  }

  /// What moving one multiplier alone, and then all to their best scale, would gain, summed: g²/2c with what ∂²F has
  /// beside the direction of μ itself; but no more than μg of one that can only fall to zero.
  template <typename Curvature>
  [[nodiscard]] bool may_gain(const Scalar& accuracy, const Curvature& curvature) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar infinite(std::numeric_limits<scalar::Value<Scalar>>::infinity());
    Scalar gain(0);
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar& g = gradient_[k];
      const Scalar raise = half * g * g;
      const Scalar removal = now_->multipliers[k] * g;
      const Scalar second = curvature(k);
      const Scalar change = second > Scalar(0) ? Scalar(raise / second) : infinite;
      gain += g > Scalar(0) && removal < change ? removal : change;
    }
    return !(gain <= accuracy);
  }

  /// The step that takes all μₖzₖ to their targets, linearized.
  void aim_at(const Multipliers& target) noexcept {
    const Iterate& it = *now_;
    for (std::size_t k = 0; k < count_; ++k) {
      move_[k] = target[k] / it.multipliers[k] - gradient_[k];
    }
    solve_in_place(hessian_.data(), Problem::most, count_, move_.data());
    for (std::size_t k = 0; k < count_; ++k) {
      dz_[k] = (target[k] - z_[k] * move_[k]) / it.multipliers[k] - z_[k];
    }
  }

  /// What all μₖzₖ are to become: a step straight at the optimum shows how far one gets, and so how much to keep away
  /// from the boundary.
  [[nodiscard]] Scalar target_product() const noexcept {
    const Iterate& it = *now_;
    Scalar gap(0);
    Scalar defect(0);
    for (std::size_t k = 0; k < count_; ++k) {
      gap += it.multipliers[k] * z_[k];
      defect += it.multipliers[k] * scalar::abs(Scalar(gradient_[k] - z_[k]));
    }
    const Scalar straight_primal = longest_step(it.multipliers, move_, count_, Scalar(1));
    const Scalar straight_dual = longest_step(z_, dz_, count_, Scalar(1));
    Scalar left(0);
    for (std::size_t k = 0; k < count_; ++k) {
      left += (it.multipliers[k] + straight_primal * move_[k]) * (z_[k] + straight_dual * dz_[k]);
    }
    const Scalar ratio_left = left / gap;
    const Scalar least_center = scalar::constant<Scalar>(1e-4L);
    const Scalar most_center = scalar::constant<Scalar>(0.3L);
    Scalar center = ratio_left * ratio_left * ratio_left;
    center = center > least_center ? center : least_center;
    center = center < most_center ? center : most_center;
    return center * (gap + defect) / Scalar(count_);
  }

  /// Aims at products τ less what they would miss in second order, or, where that is too much, at τ: the slope is then
  /// negative.
  void correct(const Scalar& tau, Multipliers& target) noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      target[k] = tau - move_[k] * dz_[k];
    }
    aim_at(target);
    note_slope(tau);
    if (!(slope_ < Scalar(0))) {
      std::fill_n(target.begin(), count_, tau);
      aim_at(target);
      note_slope(tau);
    }
  }

  /// The slope of F − τ Σ log μ along the step.
  void note_slope(const Scalar& tau) noexcept {
    slope_ = Scalar(0);
    for (std::size_t k = 0; k < count_; ++k) {
      slope_ += (gradient_[k] - tau / now_->multipliers[k]) * move_[k];
    }
  }

  /// F − τ Σ log μ must fall; where it does not, to the minimum of the parabola through what is known of it.
  /// \return whether it falls; the next iterate is then `now_`.
  [[nodiscard]] bool search_along_step(const Scalar& tau) noexcept {
    const Iterate& it = *now_;
    const Scalar inside = scalar::constant<Scalar>(0.99L);
    Scalar primal = longest_step(it.multipliers, move_, count_, inside);
    const Scalar dual = longest_step(z_, dz_, count_, inside);
    const Scalar value = it.level + it.barrier;
    const Scalar noise = rounding::share<Scalar>(rounding::objective) * (Scalar(1) + scalar::abs(value)) + it.rounding;
    Multipliers from;
    std::copy_n(it.multipliers.begin(), count_, from.begin());
    now_ = best_ == &iterates_[0] ? &iterates_[1] : &iterates_[0];
    constexpr int most_trials = 12;
    bool accepted = false;
    for (int trial = 0; trial < most_trials && !accepted; ++trial) {
      Multipliers next;
      Scalar ratios(0);
      Scalar ratio(1);
      for (std::size_t k = 0; k < count_; ++k) {
        next[k] = from[k] + primal * move_[k];
        ratio *= next[k] / from[k];
        if (k % 8 == 7 || k + 1 == count_) {  // the logarithm of a product that neither overflows nor vanishes
          ratios += scalar::log(ratio);
          ratio = Scalar(1);
        }
      }
      Scalar shorter = scalar::constant<Scalar>(0.25L) * primal;
      if (problem_.combine(next, *now_) == Status::ok) {
        const Scalar change = now_->level + now_->barrier - value - tau * ratios;
        accepted = change <= scalar::constant<Scalar>(1e-3L) * primal * slope_ + noise;
        const Scalar parabola = Scalar(-0.5) * slope_ * primal * primal / (change - slope_ * primal);
        const Scalar least = scalar::constant<Scalar>(0.1L) * primal;
        const Scalar most = scalar::constant<Scalar>(0.5L) * primal;
        shorter = parabola < most ? (parabola > least ? parabola : least) : most;
        accepted = accepted || now_->level + now_->rounding < Scalar(0);
      }
      primal = shorter;
    }
    for (std::size_t k = 0; accepted && k < count_; ++k) {
      z_[k] += dual * dz_[k];
    }
    return accepted;
  }

  const Problem& problem_;
  const Multipliers& scale_;
  std::array<Iterate, 2>& iterates_;
  std::size_t count_;
  const Scalar log_dimension_ = Scalar(N) * scalar::log(Scalar(N));
  // What is left of F − min F, and so of the logarithm of the volume, or N times that of the trace.
  const Scalar tolerance_ = scalar::constant<Scalar>(1e-3L);
  Iterate* now_;
  const Iterate* best_;
  Scalar margin_;
  int steps_ = 0;
  bool ended_by_limit_ = false;
  Multipliers z_{};
  Multipliers gradient_;
  Matrix<Scalar, N> v_;
  std::array<Scalar, Problem::most * Problem::most> hessian_;
  Multipliers move_;
  Multipliers dz_;
  Scalar slope_;
};

}  // namespace elliptude::detail
