#pragma once

/// \file
/// The search for the multipliers of one question: a semidefinite problem of N + 1 rows and few unknowns, by a primal-dual
/// interior-point method.
/// (theory, section 16.11)

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/detail/multiplier_search.hpp"

namespace elliptude {

/// How many quadrics one question takes into account.
inline constexpr std::size_t most_questioned = 8;

namespace detail {

/// Minimises s = x₀ over Z = Σ xₖBₖ − F ⪰ 0, μₖ = xₖ ≥ 0 from k = 1 on, with B₀ = G and Bₖ = −Mₖ, of which M₁ is the unit ball's.
/// Beside it runs the dual, X ⪰ 0 and w ≥ 0 with tr(GX) = 1, tr(MₖX) = wₖ: steps aim at ZX = τI, μₖwₖ = τ with ever smaller τ. Every
/// Z ≻ 0 on the way is a bound; in the end the least s for the multipliers found is taken.
template <typename Scalar, int N>
class QuotientSearch {
 public:
  using Form = Matrix<Scalar, N + 1>;

  /// \param f, g in the coordinates in which the ellipsoid is the unit ball, and how large the terms are that they were summed from.
  void begin(const Form& f, const Scalar& size_of_f, const Form& g, const Scalar& size_of_g) noexcept {
    f_ = f;
    size_of_f_ = size_of_f;
    forms_[0] = g;
    sizes_[0] = size_of_g;
    forms_[1].setZero();
    forms_[1](0, 0) = Scalar(-1);
    forms_[1].diagonal().template tail<N>().setConstant(Scalar(1));
    sizes_[1] = Scalar(1);
    count_ = 2;
  }

  /// One more constraint in these coordinates. One that says nothing is left out.
  void add(const Quadric<Scalar, N>& quadric) noexcept {
    Form form;
    form(0, 0) = -quadric.c;
    form.template block<N, 1>(1, 0) = quadric.g;
    form.template block<1, N>(0, 1) = quadric.g.transpose();
    form.template block<N, N>(1, 1) = quadric.a;
    const Scalar size = largest_row(form);
    const Scalar least = std::numeric_limits<scalar::Value<Scalar>>::min();
    if (size > least && size < Scalar(1) / least && !quadric.a.isZero(Scalar(0))) {
      forms_[count_] = form * (Scalar(1) / size);
      sizes_[count_] = Scalar(1);
      ++count_;
    }
  }

  /// \param s changed only on success.
  /// \return the status of `largest_quotient`.
  [[nodiscard]] Status run(Scalar& s) noexcept {
    const Scalar scale = largest_row(f_);
    if (!scalar::isfinite(scale) || !scalar::isfinite(size_of_f_) || !scalar::isfinite(sizes_[0])) {
      return Status::not_finite;
    }
    if (scale > Scalar(0)) {
      f_ *= Scalar(1) / scale;
      size_of_f_ /= scale;
      if (!scalar::all_finite(f_) || !scalar::isfinite(size_of_f_)) {
        return Status::not_finite;
      }
    }
    // Rounding has its place from the start, for multipliers of a few: at the end there would be no room for it.
    relief_ = rounding::share<Scalar>(2 * rounding::quotient) * (size_of_f_ + Scalar(8) * (Scalar(1) + sizes_[0]));
    if (!find_start()) {
      return Status::unbounded;
    }
    constexpr int most_steps = 40;
    for (int step = 0; step < most_steps && !is_close() && take_step(); ++step) {
    }
    Scalar least;
    if (!least_for_multipliers(least)) {
      return Status::unbounded;
    }
    least *= scale;
    if (!scalar::isfinite(least)) {
      return Status::unbounded;
    }
    s = least;
    return Status::ok;
  }

 private:
  static constexpr std::size_t most = most_questioned + 2;
  using Unknowns = std::array<Scalar, most>;

  /// A step of both problems.
  struct Step {
    Unknowns x;
    Form z;
    Form primal;
    Unknowns w;
  };

  /// A bound of the norm: the largest sum of a row's absolute values.
  [[nodiscard]] static Scalar largest_row(const Form& form) noexcept {
    return form.cwiseAbs().rowwise().sum().maxCoeff();
  }

  /// tr(AB) of a symmetric A.
  [[nodiscard]] static Scalar trace_of_product(const Form& a, const Form& b) noexcept {
    return a.cwiseProduct(b).sum();
  }

  /// Σ xₖBₖ.
  [[nodiscard]] Form combined(const Unknowns& x) const noexcept {
    Form sum = x[0] * forms_[0];
    for (std::size_t k = 1; k < count_; ++k) {
      sum += x[k] * forms_[k];
    }
    return sum;
  }

  /// Z, its diagonal lowered by `less`.
  [[nodiscard]] Form lowered(const Unknowns& x, const Scalar& less) const noexcept {
    Form z = combined(x) - f_;
    z.diagonal().array() -= less;
    return z;
  }

  [[nodiscard]] static bool is_positive_definite(const Form& form) noexcept {
    RootFreeFactor<Scalar, N + 1> factor;
    return factorize(form, factor) == Status::ok;
  }

  /// More than rounding may have changed Z, as a form of unit vectors.
  [[nodiscard]] Scalar rounding_of(const Unknowns& x) const noexcept {
    Scalar size = size_of_f_;
    for (std::size_t k = 0; k < count_; ++k) {
      size += scalar::abs(x[k]) * sizes_[k];
    }
    return rounding::share<Scalar>(rounding::quotient) * size;
  }

  /// Multipliers of one, that of the ball large enough to outweigh the others well, and s likewise; X and w with the same product
  /// everywhere.
  [[nodiscard]] bool find_start() noexcept {
    const Scalar others(static_cast<scalar::Value<Scalar>>(count_ - 1));  // with F, each of norm one at most
    x_[1] = others + Scalar(1);
    for (std::size_t k = 2; k < count_; ++k) {
      x_[k] = Scalar(1);
    }
    x_[0] = Scalar(2) * x_[1];
    constexpr int most_doublings = 60;
    int step = 0;
    while (!is_positive_definite(lowered(x_, scalar::constant<Scalar>(0.5L)))) {
      if (++step > most_doublings) {
        return false;
      }
      x_[0] *= Scalar(2);
    }
    RootFreeFactor<Scalar, N + 1> factor;
    if (factorize(lowered(x_, relief_), factor) != Status::ok) {
      return false;
    }
    z_ = lowered(x_, relief_);
    primal_ = square_of_lower(inverse_root(factor));
    const Scalar tau = Scalar(1) / trace_of_product(forms_[0], primal_);
    primal_ *= tau;
    for (std::size_t k = 1; k < count_; ++k) {
      w_[k] = tau / x_[k];
    }
    return scalar::isfinite(tau) && scalar::all_finite(primal_);
  }

  /// tr(ZX) + Σ μₖwₖ after shares of a step of both problems.
  [[nodiscard]] Scalar gap(const Step& step, const Scalar& dual_share, const Scalar& primal_share) const noexcept {
    Scalar sum = trace_of_product(Form(z_ + dual_share * step.z), Form(primal_ + primal_share * step.primal));
    for (std::size_t k = 1; k < count_; ++k) {
      sum += (x_[k] + dual_share * step.x[k]) * (w_[k] + primal_share * step.w[k]);
    }
    return sum;
  }

  [[nodiscard]] Scalar gap() const noexcept {
    Scalar sum = trace_of_product(z_, primal_);
    for (std::size_t k = 1; k < count_; ++k) {
      sum += x_[k] * w_[k];
    }
    return sum;
  }

  /// Whether no more than about 1 % is left to gain.
  [[nodiscard]] bool is_close() const noexcept {
    const Scalar size = scalar::abs(x_[0]);
    const Scalar least = scalar::constant<Scalar>(1e-8L);
    return gap() < scalar::constant<Scalar>(0.01L) * (size > least ? size : least);
  }

  /// A step of Mehrotra's predictor and corrector.
  /// \return whether there was one.
  [[nodiscard]] bool take_step() noexcept {
    RootFreeFactor<Scalar, N + 1> factor;
    if (factorize(z_, factor) != Status::ok) {
      return false;
    }
    const Form inverse = square_of_lower(inverse_root(factor));
    for (std::size_t k = 0; k < count_; ++k) {
      const Form half = primal_.lazyProduct(forms_[k]);
      const Form image = half.lazyProduct(inverse);
      for (std::size_t j = k; j < count_; ++j) {
        system_[j * most + k] = trace_of_product(forms_[j], image);
      }
      if (k > 0) {
        system_[k * most + k] += w_[k] / x_[k];
      }
    }
    if (!factor_in_place(system_.data(), most, count_)) {
      return false;
    }
    Unknowns products;
    products.fill(Scalar(0));
    Step step;
    aim_at(Scalar(0), inverse, Form(Form::Zero()), products, step);
    const Scalar whole = gap();
    const Scalar coarse = scalar::constant<Scalar>(0.5L);
    const Scalar dual = longest(z_, step.z, x_, step.x, Scalar(1), coarse);
    const Scalar primal = longest(primal_, step.primal, w_, step.w, Scalar(1), coarse);
    Scalar left = gap(step, dual, primal) / whole;
    const Scalar least = scalar::constant<Scalar>(0.05L);
    left = left > least ? (left < Scalar(1) ? left : Scalar(1)) : least;
    const Form second = symmetrized(Form(Form(step.primal.lazyProduct(step.z)).lazyProduct(inverse)));
    for (std::size_t k = 1; k < count_; ++k) {
      products[k] = step.x[k] * step.w[k];
    }
    const Scalar unknowns(static_cast<scalar::Value<Scalar>>(N + static_cast<int>(count_)));
    aim_at(Scalar(left * whole / unknowns), inverse, second, products, step);
    const Scalar inside = scalar::constant<Scalar>(0.95L);
    const Scalar fine = scalar::constant<Scalar>(0.8L);
    const Scalar dual_share = longest(z_, step.z, x_, step.x, inside, fine);
    const Scalar primal_share = longest(primal_, step.primal, w_, step.w, inside, fine);
    Unknowns next = x_;
    for (std::size_t k = 0; k < count_; ++k) {
      next[k] += dual_share * step.x[k];
      w_[k] += k > 0 ? Scalar(primal_share * step.w[k]) : Scalar(0);
    }
    const Form z = lowered(next, relief_);
    if (!is_positive_definite(z)) {
      return false;  // so close to the boundary that rounding decides
    }
    x_ = next;
    z_ = z;
    primal_ += primal_share * step.primal;
    return dual_share > scalar::constant<Scalar>(1e-6L);
  }

  /// The step that takes all products to τ, less what they would miss in second order.
  void aim_at(const Scalar& tau, const Form& inverse, const Form& second, const Unknowns& products,
              Step& step) const noexcept {
    const Form target = tau * inverse - second;
    for (std::size_t k = 0; k < count_; ++k) {
      step.x[k] = trace_of_product(forms_[k], target);
      step.x[k] += k == 0 ? Scalar(-1) : Scalar((tau - products[k]) / x_[k]);
    }
    solve_in_place(system_.data(), most, count_, step.x.data());
    step.z = combined(step.x);
    const Form half = primal_.lazyProduct(step.z);
    step.primal = target - primal_ - symmetrized(Form(half.lazyProduct(inverse)));
    for (std::size_t k = 1; k < count_; ++k) {
      step.w[k] = (tau - products[k] - w_[k] * step.x[k]) / x_[k] - w_[k];
    }
  }

  /// How much of a step stays inside, up to a share of the way to the boundary; shorter and shorter by a ratio where the matrix
  /// decides.
  [[nodiscard]] Scalar longest(const Form& form, const Form& move, const Unknowns& numbers, const Unknowns& along,
                               const Scalar& share, const Scalar& ratio) const noexcept {
    Scalar length(1);
    for (std::size_t k = 1; k < count_; ++k) {
      if (length * along[k] < -share * numbers[k]) {
        length = -share * numbers[k] / along[k];
      }
    }
    constexpr int most_trials = 30;
    for (int trial = 0; trial < most_trials; ++trial) {
      if (is_positive_definite(Form(form + (length / share) * move))) {
        return length;
      }
      length *= ratio;
    }
    return Scalar(0);
  }

  /// The least s for these multipliers, with all that rounding may have done.
  /// \return whether the multipliers prove any.
  [[nodiscard]] bool least_for_multipliers(Scalar& least) const noexcept {
    Unknowns x = x_;
    const auto proves = [&](const Scalar& s) {
      x[0] = s;
      return is_positive_definite(lowered(x, rounding_of(x)));
    };
    constexpr int most_raises = 40;
    Scalar high = x_[0];
    int step = 0;
    for (Scalar raise = rounding_of(x_); !proves(high); raise *= Scalar(4)) {  // where rounding is all that is left
      high += raise;
      if (++step > most_raises) {
        return false;
      }
    }
    Scalar low = x_[0] - Scalar(2) * gap();
    low = low < high ? low : high;
    constexpr int most_halvings = 6;
    for (step = 0; step < most_halvings; ++step) {
      const Scalar middle = scalar::constant<Scalar>(0.5L) * (low + high);
      (proves(middle) ? high : low) = middle;
    }
    least = high;
    return scalar::isfinite(high);
  }

  Form f_;
  Scalar size_of_f_;
  std::array<Form, most> forms_;  // Bₖ
  Unknowns sizes_;                // of the terms of their largest entries
  std::size_t count_ = 0;
  Scalar relief_;
  Unknowns x_;  // s, and the multipliers
  Form z_;
  Form primal_;  // X
  Unknowns w_;
  std::array<Scalar, most * most> system_;
};

}  // namespace detail

}  // namespace elliptude
