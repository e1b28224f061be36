#pragma once

/// \file
/// A step of the search for the multipliers of guaranteed fusion: what does not depend on how many numbers an ellipsoid
/// has, and so is there once for all. (theory, section 16)

#include <algorithm>
#include <array>
#include <limits>

#include "elliptude/base/limits.hpp"
#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/base/scalar.hpp"

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

/// A step of Mehrotra's predictor and corrector: Δμ with (∇²F + diag(zₖ/μₖ)) Δμ = t/μ − ∇F, for a target tₖ of each
/// μₖzₖ. Each function is given the multipliers μ of now.
template <typename Scalar>
class MultiplierStep {
 public:
  static constexpr std::size_t most = most_quadrics + 1;
  using Multipliers = std::array<Scalar, most>;

  Multipliers gradient;                     ///< ∇F
  std::array<Scalar, most * most> hessian;  ///< ∇²F, the lower triangle, in rows of length `most`; `find` factors it

  explicit MultiplierStep(std::size_t count) noexcept : count_(count) {}

  /// The first zₖ.
  /// \param numbers of the ellipsoid.
  void start_duals(int numbers, const Multipliers& multipliers) noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar least = scalar::constant<Scalar>(0.002L) * Scalar(numbers) / (Scalar(count_) * multipliers[k]);
      z_[k] = gradient[k] > least ? gradient[k] : least;
    }
  }
  /// The zₖ of multipliers t times as large.
  void scale_duals(const Scalar& t) noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      z_[k] /= t;
    }
  }

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
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool may_gain(const Multipliers& multipliers, const Multipliers& curvature,
                                                    const Scalar& accuracy) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar infinite(std::numeric_limits<scalar::Value<Scalar>>::infinity());
    Scalar gain(0);
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar& g = gradient[k];
      const Scalar raise = half * g * g;
      const Scalar removal = multipliers[k] * g;
      const Scalar& second = curvature[k];
      const Scalar change = second > Scalar(0) ? Scalar(raise / second) : infinite;
      gain += g > Scalar(0) && removal < change ? removal : change;
    }
    return !(gain <= accuracy);
  }

  /// \param worth_it whether to take it even if its own gain is less than the accuracy.
  /// \return whether there is one, and it is worth it.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool find(const Multipliers& multipliers, const Scalar& accuracy,
                                                bool worth_it) noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      hessian[k * most + k] += z_[k] / multipliers[k];
    }
    if (!factor_in_place(hessian.data(), most, count_)) {
      return false;
    }
    Multipliers target;
    std::fill_n(target.begin(), count_, Scalar(0));
    aim_at(multipliers, target);
    Scalar fall(0);  // of F along its tangent: no less than what the whole step would gain
    for (std::size_t k = 0; k < count_; ++k) {
      fall -= gradient[k] * move_[k];
    }
    if (fall <= accuracy && !worth_it) {
      return false;
    }
    tau_ = target_product(multipliers);
    correct(multipliers, target);
    const Scalar inside = scalar::constant<Scalar>(0.99L);
    length_ = longest_step(multipliers, move_, count_, inside);
    dual_ = longest_step(z_, dz_, count_, inside);
    return true;
  }

  /// The multipliers at the end of the step, which `shorten` may have shortened.
  /// \return what F − τ Σ log μ has of τ Σ log μ more there.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Scalar put_end(const Multipliers& from, Multipliers& next) const noexcept {
    Scalar ratios(0);
    Scalar ratio(1);
    for (std::size_t k = 0; k < count_; ++k) {
      next[k] = from[k] + length_ * move_[k];
      ratio *= next[k] / from[k];
      if (k % 8 == 7 || k + 1 == count_) {  // the logarithm of a product that neither overflows nor vanishes
        ratios += scalar::log(ratio);
        ratio = Scalar(1);
      }
    }
    return tau_ * ratios;
  }

  /// Where A is not positive definite at the end.
  void shorten() noexcept { length_ *= scalar::constant<Scalar>(0.25L); }
  /// Where F − τ Σ log μ changes by this: to the minimum of the parabola through what is known of it.
  /// \return whether it falls, but for noise. It is not shortened then.
  [[nodiscard]] bool falls(const Scalar& change, const Scalar& noise) const noexcept {
    return change <= scalar::constant<Scalar>(1e-3L) * length_ * slope_ + noise;
  }
  void shorten(const Scalar& change) noexcept {
    const Scalar parabola = Scalar(-0.5) * slope_ * length_ * length_ / (change - slope_ * length_);
    const Scalar least = scalar::constant<Scalar>(0.1L) * length_;
    const Scalar most_of_it = scalar::constant<Scalar>(0.5L) * length_;
    length_ = parabola < most_of_it ? (parabola > least ? parabola : least) : most_of_it;
  }

  /// The zₖ at the end.
  void take_duals() noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      z_[k] += dual_ * dz_[k];
    }
  }

 private:
  /// The step that takes all μₖzₖ to their targets, linearized.
  ELLIPTUDE_OUT_OF_LINE void aim_at(const Multipliers& multipliers, const Multipliers& target) noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      move_[k] = target[k] / multipliers[k] - gradient[k];
    }
    solve_in_place(hessian.data(), most, count_, move_.data());
    for (std::size_t k = 0; k < count_; ++k) {
      dz_[k] = (target[k] - z_[k] * move_[k]) / multipliers[k] - z_[k];
    }
  }

  /// What all μₖzₖ are to become: a step straight at the optimum shows how far one gets, and so how much to keep away
  /// from the boundary.
  [[nodiscard]] Scalar target_product(const Multipliers& multipliers) const noexcept {
    Scalar gap(0);
    Scalar defect(0);
    for (std::size_t k = 0; k < count_; ++k) {
      gap += multipliers[k] * z_[k];
      defect += multipliers[k] * scalar::abs(Scalar(gradient[k] - z_[k]));
    }
    const Scalar straight_primal = longest_step(multipliers, move_, count_, Scalar(1));
    const Scalar straight_dual = longest_step(z_, dz_, count_, Scalar(1));
    Scalar left(0);
    for (std::size_t k = 0; k < count_; ++k) {
      left += (multipliers[k] + straight_primal * move_[k]) * (z_[k] + straight_dual * dz_[k]);
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
  void correct(const Multipliers& multipliers, Multipliers& target) noexcept {
    for (std::size_t k = 0; k < count_; ++k) {
      target[k] = tau_ - move_[k] * dz_[k];
    }
    aim_at(multipliers, target);
    note_slope(multipliers);
    if (!(slope_ < Scalar(0))) {
      std::fill_n(target.begin(), count_, tau_);
      aim_at(multipliers, target);
      note_slope(multipliers);
    }
  }

  /// The slope of F − τ Σ log μ along the step.
  ELLIPTUDE_OUT_OF_LINE void note_slope(const Multipliers& multipliers) noexcept {
    slope_ = Scalar(0);
    for (std::size_t k = 0; k < count_; ++k) {
      slope_ += (gradient[k] - tau_ / multipliers[k]) * move_[k];
    }
  }

  std::size_t count_;
  Multipliers z_{};
  Multipliers move_;
  Multipliers dz_;
  Scalar tau_;
  Scalar slope_;
  Scalar length_;  // of the step of μ, in units of `move_`
  Scalar dual_;    // and of z
};

}  // namespace elliptude::detail
