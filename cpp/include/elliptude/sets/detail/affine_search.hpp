#pragma once

/// \file
/// The search for the multipliers of a question that is linear: how far a set reaches along a direction. With the
/// largest point for given multipliers in closed form, a step works with N rows instead of N + 1 for each constraint.
/// (theory, eq. 16.10)

#include <algorithm>
#include <limits>

#include "elliptude/base/limits.hpp"
#include "elliptude/linear/cholesky.hpp"
#include "elliptude/sets/detail/multipliers.hpp"

namespace elliptude::detail {

/// Minimises D(μ) = max over u of 2wᵀu + Σ μₖsₖ(u) = Σ μₖcₖ + vᵀA⁻¹v over μ ≥ 0 with A = Σ μₖAₖ ≻ 0, v = w − Σ μₖgₖ,
/// where sₖ(u) = cₖ − 2gₖᵀu − uᵀAₖu, by a primal-dual interior-point method. D is convex, ∂ₖD = sₖ(u*), ∂ⱼ∂ₖD =
/// 2rⱼᵀA⁻¹rₖ with u* = A⁻¹v, rₖ = Aₖu* + gₖ. Every D on the way is a bound.
template <typename Scalar, int N, std::size_t most>
class AffineSearch {
 public:
  using Form = Matrix<Scalar, N + 1>;
  using Multipliers = std::array<Scalar, most>;

  /// \param forms [−cₖ, gₖᵀ; gₖ, Aₖ], of norm one or so. The first is the unit ball's.
  AffineSearch(const Form* forms, std::size_t count, const Vector<Scalar, N>& w) noexcept
      : forms_(forms), count_(count), w_(w) {}

  /// \return whether multipliers were found with about 1 % left to gain. Where A is nearly singular for the best, there
  /// may be none.
  [[nodiscard]] bool run() noexcept {
    if (!start()) {
      return false;
    }
    constexpr int most_steps = 11;
    bool close = is_close();
    for (int step = 0; step < most_steps && !close; ++step) {
      if (!take_step()) {
        return false;
      }
      close = is_close();
    }
    return close;
  }

  [[nodiscard]] const Scalar& least() const noexcept { return now_.value; }
  [[nodiscard]] const Multipliers& multipliers() const noexcept { return now_.mu; }
  /// Where the bound is attained.
  [[nodiscard]] const Vector<Scalar, N>& point() const noexcept { return now_.u; }

 private:
  struct Iterate {
    Multipliers mu;
    Matrix<Scalar, N> a;                    // A
    RootFreeFactor<Scalar, N> factor;       // of A
    Vector<Scalar, N> u;                    // where the bound is attained
    std::array<Vector<Scalar, N>, most> r;  // Aₖu + gₖ
    Multipliers slack;                      // at u: D's gradient
    Scalar value;                           // D
    Scalar scale;                           // what the multipliers were multiplied by to be at their best
  };

  /// The ball as if it were alone, where D is 2‖w‖, and half as much for the others together.
  [[nodiscard]] bool start() noexcept {
    const Scalar alone = w_.norm();
    if (!(alone > Scalar(0))) {
      return false;
    }
    Multipliers mu;
    mu[0] = alone;
    for (std::size_t k = 1; k < count_; ++k) {
      mu[k] = scalar::constant<Scalar>(0.5L) * alone / number(count_ - 1);
    }
    if (!evaluate(mu, now_)) {
      return false;
    }
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar least = scalar::constant<Scalar>(0.05L) * alone / (number(count_) * now_.mu[k]);
      z_[k] = now_.slack[k] > least ? now_.slack[k] : least;
    }
    return true;
  }

  /// The multipliers, at the scale where D is least, and what belongs to them: D(tμ) = t(c + gᵀA⁻¹g) − 2wᵀA⁻¹g +
  /// wᵀA⁻¹w/t.
  /// \return whether A ≻ 0.
  [[nodiscard]] bool evaluate(const Multipliers& mu, Iterate& it) const noexcept {
    Form sum = mu[0] * forms_[0];
    for (std::size_t k = 1; k < count_; ++k) {
      sum += mu[k] * forms_[k];
    }
    if (factorize(Matrix<Scalar, N>(sum.template bottomRightCorner<N, N>()), it.factor) != Status::ok) {
      return false;
    }
    const Vector<Scalar, N> g = sum.template bottomLeftCorner<N, 1>();
    const Vector<Scalar, N> of_w = solve(it.factor, w_);
    const Vector<Scalar, N> of_g = solve(it.factor, g);
    const Scalar grows = g.dot(of_g) - sum(0, 0);
    const Scalar falls = w_.dot(of_w);
    // Where it would fall for ever nothing satisfies all, and the multipliers stay as they are.
    it.scale = grows > Scalar(0) ? scalar::sqrt(Scalar(falls / grows)) : Scalar(1);
    const Scalar per_scale = Scalar(1) / it.scale;
    it.value = it.scale * grows + per_scale * falls - Scalar(2) * w_.dot(of_g);
    it.u = per_scale * of_w - of_g;
    it.a = it.scale * sum.template bottomRightCorner<N, N>();
    it.factor.p *= per_scale;
    for (std::size_t k = 0; k < count_; ++k) {
      it.mu[k] = it.scale * mu[k];
      const Vector<Scalar, N> gradient = forms_[k].template bottomLeftCorner<N, 1>();
      it.r[k] = gradient + forms_[k].template bottomRightCorner<N, N>().lazyProduct(it.u);
      it.slack[k] = -forms_[k](0, 0) - it.u.dot(gradient + it.r[k]);
    }
    return scalar::isfinite(it.value);
  }

  /// What the second derivatives and the slope leave to gain: little in the end, for each multiplier alone and for
  /// exchanges of some for others, which Σμₖsₖ = 0 makes as large as what falls.
  [[nodiscard]] bool is_close() const noexcept {
    const Scalar most_gain = tolerance_ * w_.norm();
    Scalar exchange(0);
    for (std::size_t k = 0; k < count_; ++k) {
      exchange += now_.slack[k] > Scalar(0) ? Scalar(now_.mu[k] * now_.slack[k]) : Scalar(0);
    }
    if (!(exchange < Scalar(4) * most_gain)) {
      return false;
    }
    const Matrix<Scalar, N> root = inverse_root(now_.factor);  // A⁻¹ is its square
    const Vector<Scalar, N> seen_w = root.lazyProduct(w_);
    const Scalar per_square = Scalar(1) / seen_w.squaredNorm();
    Scalar gain(0);
    for (std::size_t k = 0; k < count_; ++k) {
      const Vector<Scalar, N> seen = root.lazyProduct(now_.r[k]);
      const Scalar with_scale = seen.dot(seen_w);
      gain += gain_of(k, Scalar(2) * (seen.squaredNorm() - with_scale * with_scale * per_square));
    }
    return gain < most_gain;
  }

  /// The matrix of N rows that a step needs, factored.
  /// \return whether it is positive definite, as it is but for rounding.
  [[nodiscard]] bool factor_system() noexcept {
    Matrix<Scalar, N> system = scalar::constant<Scalar>(0.5L) * now_.a;
    for (std::size_t k = 0; k < count_; ++k) {
      yield_[k] = now_.mu[k] / z_[k];
      const Vector<Scalar, N> image = yield_[k] * now_.r[k];
      system += image.lazyProduct(now_.r[k].transpose());
    }
    return factorize(system, system_) == Status::ok;
  }

  /// A step of Mehrotra's predictor and corrector.
  /// \return whether it could be taken.
  [[nodiscard]] bool take_step() noexcept {
    if (!factor_system()) {
      return false;
    }
    Multipliers target;
    std::fill_n(target.begin(), count_, Scalar(0));
    aim_at(target);
    const Scalar primal = longest_step(now_.mu, move_, count_, Scalar(1));
    const Scalar dual = longest_step(z_, dz_, count_, Scalar(1));
    Scalar product(0);
    Scalar left(0);
    Scalar defect(0);
    for (std::size_t k = 0; k < count_; ++k) {
      product += now_.mu[k] * z_[k];
      defect += now_.mu[k] * scalar::abs(Scalar(now_.slack[k] - z_[k]));
      left += (now_.mu[k] + primal * move_[k]) * (z_[k] + dual * dz_[k]);
    }
    const Scalar ratio = left / product;
    const Scalar least_center = scalar::constant<Scalar>(1e-4L);
    const Scalar most_center = scalar::constant<Scalar>(0.3L);
    Scalar center = ratio * ratio * ratio;
    center = center > least_center ? center : least_center;
    center = center < most_center ? center : most_center;
    const Scalar tau = center * (product + defect) / number(count_);
    for (std::size_t k = 0; k < count_; ++k) {
      target[k] = tau - move_[k] * dz_[k];
    }
    aim_at(target);
    if (!(slope(tau) < Scalar(0))) {
      std::fill_n(target.begin(), count_, tau);
      aim_at(target);
    }
    return search_along_step(tau);
  }

  /// The slope of D − τ Σ log μ along the step.
  [[nodiscard]] Scalar slope(const Scalar& tau) const noexcept {
    Scalar sum(0);
    for (std::size_t k = 0; k < count_; ++k) {
      sum += (now_.slack[k] - tau / now_.mu[k]) * move_[k];
    }
    return sum;
  }

  /// What one multiplier alone would gain: in second order where it has to grow, all that it costs where it has to
  /// fall.
  [[nodiscard]] Scalar gain_of(std::size_t k, const Scalar& curvature) const noexcept {
    const Scalar& slope = now_.slack[k];
    const Scalar infinite(std::numeric_limits<scalar::Value<Scalar>>::infinity());
    const Scalar change =
        curvature > Scalar(0) ? Scalar(scalar::constant<Scalar>(0.5L) * slope * slope / curvature) : infinite;
    // One of more than a fiftieth of ‖w‖ is taken to move by at most fifty times itself: where D is nearly flat along
    // it, the gain of second order has no bound and says nothing.
    const Scalar by_size = scalar::constant<Scalar>(50) * now_.mu[k] * scalar::abs(slope);
    const bool is_small = now_.mu[k] < scalar::constant<Scalar>(0.02L) * w_.norm();
    const Scalar least = is_small || change < by_size ? change : by_size;
    const Scalar removal = now_.mu[k] * slope;
    return slope > Scalar(0) && removal < least ? removal : least;
  }

  /// The step that takes all μₖzₖ to their targets, linearized: (2RᵀA⁻¹R + E) Δμ = b with E = diag(z/μ), b = target/μ −
  /// s, by way of the N rows of y = 2A⁻¹RΔμ, which is −2Δu*: (A/2 + RE⁻¹Rᵀ) y = RE⁻¹b, Δμ = E⁻¹(b − Rᵀy).
  void aim_at(const Multipliers& target) noexcept {
    Vector<Scalar, N> sum = Vector<Scalar, N>::Zero();
    for (std::size_t k = 0; k < count_; ++k) {
      move_[k] = yield_[k] * (target[k] / now_.mu[k] - now_.slack[k]);
      sum += move_[k] * now_.r[k];
    }
    const Vector<Scalar, N> y = solve(system_, sum);
    for (std::size_t k = 0; k < count_; ++k) {
      move_[k] -= yield_[k] * now_.r[k].dot(y);
      dz_[k] = (target[k] - z_[k] * move_[k]) / now_.mu[k] - z_[k];
    }
  }

  /// D may rise by what keeps the multipliers away from zero, and no more.
  /// \return whether it went somewhere.
  [[nodiscard]] bool search_along_step(const Scalar& tau) noexcept {
    const Scalar inside = scalar::constant<Scalar>(0.95L);
    Scalar primal = longest_step(now_.mu, move_, count_, inside);
    const Scalar dual = longest_step(z_, dz_, count_, inside);
    const Scalar most_value = now_.value + number(count_) * tau;
    constexpr int most_trials = 12;
    for (int trial = 0; trial < most_trials; ++trial) {
      Multipliers mu;
      for (std::size_t k = 0; k < count_; ++k) {
        mu[k] = now_.mu[k] + primal * move_[k];
      }
      if (evaluate(mu, next_) && next_.value <= most_value) {
        for (std::size_t k = 0; k < count_; ++k) {
          z_[k] = (z_[k] + dual * dz_[k]) / next_.scale;
        }
        now_ = next_;
        return true;
      }
      primal *= scalar::constant<Scalar>(0.4L);
    }
    return false;
  }

  [[nodiscard]] static Scalar number(std::size_t count) noexcept {
    return Scalar(static_cast<scalar::Value<Scalar>>(count));
  }

  const Form* forms_;
  std::size_t count_;
  Vector<Scalar, N> w_;
  const Scalar tolerance_ = scalar::constant<Scalar>(0.0025L);
  Iterate now_;
  Iterate next_;
  Multipliers z_;
  Multipliers move_;
  Multipliers dz_;
  Multipliers yield_;                 // E⁻¹
  RootFreeFactor<Scalar, N> system_;  // of A/2 + RE⁻¹Rᵀ
};

}  // namespace elliptude::detail
