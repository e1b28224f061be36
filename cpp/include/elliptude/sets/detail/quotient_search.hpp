#pragma once

/// \file
/// The search for the multipliers of one question: a semidefinite problem of N + 1 rows and few unknowns, by an interior-point method.
/// (theory, section 16.11)

#include "elliptude/base/limits.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/detail/affine_search.hpp"
#include "elliptude/sets/detail/multiplier_search.hpp"

namespace elliptude {

namespace detail {

/// Minimises s = x₀ over Z = Σ xₖBₖ − F ⪰ 0, μₖ = xₖ ≥ 0 from k = 1 on, with B₀ = G and Bₖ = −Mₖ, of which M₁ is the unit ball's,
/// by Newton's steps towards the least s − τ (log det Z + Σ log μₖ) with ever smaller τ. Every Z ≻ 0 on the way is a bound; in the
/// end the least s for the multipliers found is taken. Where the question is linear, `AffineSearch` finds them for less.
template <typename Scalar, int N>
class QuotientSearch {
 public:
  using Form = Matrix<Scalar, N + 1>;

  /// The unit ball alone, in the coordinates in which the ellipsoid is that.
  void begin() noexcept {
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

  /// The next question.
  /// \param f, g in these coordinates, and how large the terms are that they were summed from.
  void ask(const Form& f, const Scalar& size_of_f, const Form& g, const Scalar& size_of_g) noexcept {
    f_ = f;
    size_of_f_ = size_of_f;
    forms_[0] = g;
    sizes_[0] = size_of_g;
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
    // Multipliers that are best may leave Z no room for rounding; the barrier's keep some.
    Scalar least;
    const bool is_proved = is_affine() && find_affine() && least_for_multipliers(least);
    if (!is_proved && !(find_by_barrier() && least_for_multipliers(least))) {
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
  static constexpr int longest_move = 4;
  using Unknowns = std::array<Scalar, most>;

  /// Whether the question is how large a number is that is linear in y.
  [[nodiscard]] bool is_affine() const noexcept {
    Form one = Form::Zero();
    one(0, 0) = Scalar(1);
    return forms_[0] == one && f_.template bottomRightCorner<N, N>().isZero(Scalar(0));
  }

  /// The multipliers for such a question, and s.
  [[nodiscard]] bool find_affine() noexcept {
    AffineSearch<Scalar, N, most - 1> search(&forms_[1], count_ - 1, f_.template bottomLeftCorner<N, 1>());
    if (!search.run()) {
      return false;
    }
    x_[0] = search.least() + f_(0, 0);
    std::copy_n(search.multipliers().begin(), count_ - 1, x_.begin() + 1);
    gap_ = Scalar(0);
    return true;
  }

  /// The multipliers for any question, and an s.
  [[nodiscard]] bool find_by_barrier() noexcept {
    // Rounding has its place from the start, for multipliers of a few: at the end there would be no room for it.
    relief_ = rounding::share<Scalar>(2 * rounding::quotient) * (size_of_f_ + Scalar(8) * (Scalar(1) + sizes_[0]));
    if (!find_start()) {
      return false;
    }
    constexpr int most_steps = 40;
    for (int step = 0; step < most_steps && !is_close() && take_step(); ++step) {
    }
    return true;
  }

  /// A bound of the norm: the largest sum of a row's absolute values.
  [[nodiscard]] static Scalar largest_row(const Form& form) noexcept {
    return form.cwiseAbs().rowwise().sum().maxCoeff();
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

  /// Multipliers of one, that of the ball large enough to outweigh the others and F well, and s likewise.
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
    z_ = lowered(x_, relief_);
    gap_ = Scalar(std::numeric_limits<scalar::Value<Scalar>>::infinity());
    return is_positive_definite(z_);
  }

  /// Whether about 1 % is left to gain.
  [[nodiscard]] bool is_close() const noexcept {
    const Scalar size = scalar::abs(x_[0]);
    const Scalar least = scalar::constant<Scalar>(1e-8L);
    return gap_ < scalar::constant<Scalar>(0.01L) * (size > least ? size : least);
  }

  /// The barrier's slope and its second derivatives, tr(BⱼZ⁻¹BₖZ⁻¹) + [1/μₖ²], factored.
  /// \return whether they are positive definite, as they are but for rounding.
  [[nodiscard]] bool factor_system(Unknowns& slope) noexcept {
    RootFreeFactor<Scalar, N + 1> factor;
    if (factorize(z_, factor) != Status::ok) {
      return false;
    }
    const Form inverse = square_of_lower(inverse_root(factor));
    std::array<Form, most> images;
    for (std::size_t k = 0; k < count_; ++k) {
      images[k] = forms_[k].lazyProduct(inverse);
      slope[k] = images[k].trace();
      const Form transposed = images[k].transpose();
      for (std::size_t j = 0; j <= k; ++j) {
        system_[k * most + j] = images[j].cwiseProduct(transposed).sum();
      }
      if (k > 0) {
        slope[k] += Scalar(1) / x_[k];
        system_[k * most + k] += Scalar(1) / (x_[k] * x_[k]);
      }
    }
    return factor_in_place(system_.data(), most, count_);
  }

  /// A step of Newton's method. With H and h the barrier's second derivatives and slope it is H⁻¹(h − e₀/τ), and τ is the one that
  /// makes it four units long in the metric of H; one unit would be sure to stay inside.
  /// \return whether there was one.
  [[nodiscard]] bool take_step() noexcept {
    Unknowns slope;
    if (!factor_system(slope)) {
      return false;
    }
    Unknowns inwards = slope;
    Unknowns down;
    down.fill(Scalar(0));
    down[0] = Scalar(1);
    solve_in_place(system_.data(), most, count_, inwards.data());
    solve_in_place(system_.data(), most, count_, down.data());
    Scalar rest(-longest_move * longest_move);
    for (std::size_t k = 0; k < count_; ++k) {
      rest += slope[k] * inwards[k];
    }
    // down₀/τ² − 2 inwards₀/τ + hᵀH⁻¹h is the squared length.
    const Scalar root = inwards[0] * inwards[0] - down[0] * rest;
    if (!(root >= Scalar(0))) {
      return false;
    }
    const Scalar per_tau = (inwards[0] + scalar::sqrt(root)) / down[0];
    Unknowns move;
    move.fill(Scalar(0));
    for (std::size_t k = 0; k < count_; ++k) {
      move[k] = inwards[k] - per_tau * down[k];
    }
    const Scalar length = scalar::constant<Scalar>(0.8L) * longest(move);
    for (std::size_t k = 0; k < count_; ++k) {
      x_[k] += length * move[k];
    }
    z_ = lowered(x_, relief_);
    const Scalar unknowns(static_cast<scalar::Value<Scalar>>(N + static_cast<int>(count_)));
    gap_ = unknowns / per_tau;
    return length > scalar::constant<Scalar>(1e-6L);
  }

  /// How much of a step stays inside; shorter and shorter where the matrix decides.
  [[nodiscard]] Scalar longest(const Unknowns& move) const noexcept {
    const Scalar inside = scalar::constant<Scalar>(0.95L);
    Scalar length(1);
    for (std::size_t k = 1; k < count_; ++k) {
      if (length * move[k] < -inside * x_[k]) {
        length = -inside * x_[k] / move[k];
      }
    }
    const Form change = combined(move);
    constexpr int most_trials = 30;
    for (int trial = 0; trial < most_trials; ++trial) {
      if (is_positive_definite(Form(z_ + length * change))) {
        return length;
      }
      length *= scalar::constant<Scalar>(0.7L);
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
    Scalar low = x_[0] - Scalar(2) * gap_;
    low = low < high && scalar::isfinite(low) ? low : high;
    constexpr int most_halvings = 6;
    for (step = 0; step < most_halvings && low < high; ++step) {
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
  Scalar gap_;  // about what s may still fall for these multipliers, on the path where the barrier's slope is e₀/τ
  std::array<Scalar, most * most> system_;
};

}  // namespace detail

}  // namespace elliptude
