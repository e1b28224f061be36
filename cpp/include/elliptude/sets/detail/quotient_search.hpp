#pragma once

/// \file
/// The search for the multipliers of one question: a semidefinite problem of N + 1 rows and few unknowns, by an
/// interior-point method. (theory, eq. 16.5 and section 16.11)

#include <algorithm>
#include <array>
#include <limits>

#include "elliptude/base/limits.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/detail/affine_search.hpp"
#include "elliptude/sets/detail/bordered_system.hpp"
#include "elliptude/sets/detail/multipliers.hpp"
#include "elliptude/sets/quadric.hpp"

namespace elliptude {

namespace detail {

/// Minimises s over Z = sG − ΣμₖMₖ − F = Σ xₖBₖ − F ⪰ 0, μ ≥ 0. The unknowns x are the multipliers, the first of them
/// the unit ball's, with Bₖ = −Mₖ, and then s with G for B. By Newton's steps towards the least s − τ (log det Z + Σ
/// log μₖ) with ever smaller τ. Every Z ≻ 0 on the way is a bound; in the end about the least s for the multipliers
/// found is taken. Where the question is linear, `AffineSearch` finds them for less.
template <typename Scalar, int N>
class QuotientSearch {
 public:
  using Form = Matrix<Scalar, N + 1>;

  /// The unit ball alone, in the coordinates in which the ellipsoid is that.
  void begin() noexcept {
    forms_[0].setZero();
    forms_[0](0, 0) = Scalar(-1);
    forms_[0].diagonal().template tail<N>().setConstant(Scalar(1));
    sizes_[0] = Scalar(1);
    constraints_ = 1;
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
      forms_[constraints_] = form * (Scalar(1) / size);
      sizes_[constraints_] = Scalar(1);
      ++constraints_;
    }
  }

  /// The next question.
  /// \param f, g in these coordinates, and how large the terms are that they were summed from.
  void ask(const Form& f, const Scalar& size_of_f, const Form& g, const Scalar& size_of_g) noexcept {
    f_ = f;
    size_of_f_ = size_of_f;
    forms_[constraints_] = g;
    sizes_[constraints_] = size_of_g;
  }

  /// \param s changed only on success.
  /// \return the status of `largest_quotient`.
  [[nodiscard]] Status run(Scalar& s) noexcept {
    const Scalar scale = largest_row(f_);
    if (!scalar::isfinite(scale) || !scalar::isfinite(size_of_f_) || !scalar::isfinite(sizes_[constraints_])) {
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
  static_assert(most_questioned <= rounding::most_in_quotient, "the rounding of a longer sum is not counted");
  static constexpr int longest_move = 4;
  using Unknowns = std::array<Scalar, most>;

  /// Whether the question is how large a number is that is linear in y.
  [[nodiscard]] bool is_affine() const noexcept {
    Form one = Form::Zero();
    one(0, 0) = Scalar(1);
    return forms_[constraints_] == one && f_.template bottomRightCorner<N, N>().isZero(Scalar(0));
  }

  /// The multipliers for such a question, and s.
  [[nodiscard]] bool find_affine() noexcept {
    AffineSearch<Scalar, N, most - 1> search(&forms_[0], constraints_, f_.template bottomLeftCorner<N, 1>());
    if (!search.run()) {
      return false;
    }
    std::copy_n(search.multipliers().begin(), constraints_, x_.begin());
    x_[constraints_] = search.least() + f_(0, 0);
    // There Z is singular along [1; u]: the proof will subtract its rounding from that, and a little more is for the
    // other directions.
    x_[constraints_] += scalar::constant<Scalar>(1.01L) * rounding_of(x_) * (Scalar(1) + search.point().squaredNorm());
    gap_ = Scalar(0);
    return true;
  }

  /// The multipliers for any question, and an s.
  [[nodiscard]] bool find_by_barrier() noexcept {
    // Rounding has its place from the start, for multipliers of a few: at the end there would be no room for it.
    relief_ =
        rounding::share<Scalar>(2 * rounding::quotient) * (size_of_f_ + Scalar(8) * (Scalar(1) + sizes_[constraints_]));
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
    for (std::size_t k = 1; k <= constraints_; ++k) {
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
    for (std::size_t k = 0; k <= constraints_; ++k) {
      size += scalar::abs(x[k]) * sizes_[k];
    }
    return rounding::share<Scalar>(rounding::quotient) * size;
  }

  /// Multipliers of one, that of the ball large enough to outweigh the others and F well, and s likewise.
  [[nodiscard]] bool find_start() noexcept {
    const Scalar others(static_cast<scalar::Value<Scalar>>(constraints_));  // with F, each of norm one at most
    x_[0] = others + Scalar(1);
    std::fill_n(x_.begin() + 1, constraints_ - 1, Scalar(1));
    Scalar& s = x_[constraints_];
    s = Scalar(2) * x_[0];
    constexpr int most_doublings = 60;
    int step = 0;
    while (!is_positive_definite(lowered(x_, scalar::constant<Scalar>(0.5L)))) {
      if (++step > most_doublings) {
        return false;
      }
      s *= Scalar(2);
    }
    z_ = lowered(x_, relief_);
    gap_ = Scalar(std::numeric_limits<scalar::Value<Scalar>>::infinity());
    return is_positive_definite(z_);
  }

  /// Whether about 1 % is left to gain.
  [[nodiscard]] bool is_close() const noexcept {
    const Scalar size = scalar::abs(x_[constraints_]);
    const Scalar least = scalar::constant<Scalar>(1e-8L);
    return gap_ < scalar::constant<Scalar>(0.01L) * (size > least ? size : least);
  }

  /// The barrier's second derivatives tr(BⱼZ⁻¹BₖZ⁻¹) + [1/μₖ²] and beside them its slope, with the unknowns eliminated.
  /// Each needs one product BₖZ⁻¹.
  /// \return whether they are positive definite, as they are but for rounding.
  [[nodiscard]] bool eliminate() noexcept {
    RootFreeFactor<Scalar, N + 1> factor;
    if (factorize(z_, factor) != Status::ok) {
      return false;
    }
    const Form inverse = square_of_lower(inverse_root(factor));
    system_.begin(constraints_ + 1);
    std::array<Form, most> images;
    for (std::size_t k = 0; k <= constraints_; ++k) {
      images[k] = product_by_columns(forms_[k], inverse);
      system_.right_side(k) = images[k].trace();
      const Form transposed = images[k].transpose();
      for (std::size_t j = 0; j <= k; ++j) {
        system_.entry(j, k) = images[j].cwiseProduct(transposed).sum();
      }
    }
    for (std::size_t k = 0; k < constraints_; ++k) {
      const Scalar per_multiplier = Scalar(1) / x_[k];
      system_.right_side(k) += per_multiplier;
      system_.entry(k, k) += per_multiplier * per_multiplier;
    }
    return system_.eliminate();
  }

  /// A step of Newton's method. With H and h the barrier's second derivatives and slope it is H⁻¹(h − e/τ), e the unit
  /// vector of s, and τ is the one that makes it four units long in the metric of H; one unit would be sure to stay
  /// inside.
  /// \return whether there was one.
  [[nodiscard]] bool take_step() noexcept {
    if (!eliminate()) {
      return false;
    }
    // With H = L diag(p)⁻¹ Lᵀ the squared length is that of L⁻¹h − e/τ in the metric of diag(p), as L⁻¹e = e: e is the
    // last.
    Scalar left(longest_move * longest_move);
    for (std::size_t k = 0; k < constraints_; ++k) {
      left -= system_.inverse_pivot(k) * system_.right_side(k) * system_.right_side(k);
    }
    const Scalar square = left / system_.inverse_pivot(constraints_);
    if (!(square >= Scalar(0))) {
      return false;
    }
    const Scalar beyond = scalar::sqrt(square);
    const Scalar per_tau = system_.right_side(constraints_) + beyond;
    system_.right_side(constraints_) = -beyond;
    Unknowns move;
    system_.solve(move);
    const Form change = combined(move);
    const Scalar length = scalar::constant<Scalar>(0.8L) * longest(move, change);
    for (std::size_t k = 0; k <= constraints_; ++k) {
      x_[k] += length * move[k];
    }
    z_ += length * change;
    const Scalar unknowns(static_cast<scalar::Value<Scalar>>(N + 1 + static_cast<int>(constraints_)));
    gap_ = unknowns / per_tau;
    return length > scalar::constant<Scalar>(1e-6L);
  }

  /// How much of a step stays inside; shorter and shorter where the matrix decides.
  [[nodiscard]] Scalar longest(const Unknowns& move, const Form& change) const noexcept {
    Scalar length = longest_step(x_, move, constraints_, scalar::constant<Scalar>(0.95L));
    constexpr int most_trials = 30;
    for (int trial = 0; trial < most_trials; ++trial) {
      if (is_positive_definite(Form(z_ + length * change))) {
        return length;
      }
      length *= scalar::constant<Scalar>(0.7L);
    }
    return Scalar(0);
  }

  /// About the least s for these multipliers, with all that rounding may have done.
  /// \return whether the multipliers prove any.
  [[nodiscard]] bool least_for_multipliers(Scalar& least) const noexcept {
    if (!may_sum(x_, constraints_)) {
      return false;
    }
    Unknowns x = x_;
    Scalar& s = x[constraints_];
    RootFreeFactor<Scalar, N + 1> factor;
    const auto proves = [&] { return factorize(lowered(x, rounding_of(x)), factor) == Status::ok; };
    constexpr int most_raises = 40;
    int raises = 0;
    for (Scalar raise = rounding_of(x); !proves(); raise *= Scalar(4)) {  // where rounding is all that is left
      s += raise;
      if (++raises > most_raises) {
        return false;
      }
    }
    least = s;
    if (raises == 0 && !(gap_ > Scalar(0))) {
      return scalar::isfinite(least);
    }
    // Where rounding is most of Z, its room is not known so well.
    constexpr int most_trials = 3;
    Scalar fall = room(factor);
    for (int trial = 0; trial < most_trials; ++trial) {
      s = least - fall;
      if (proves()) {
        least = s;
        break;
      }
      fall *= scalar::constant<Scalar>(0.5L);
    }
    return scalar::isfinite(least);
  }

  /// By how much s may fall, or a little less. Z − δG ⪰ 0 while δ times the largest eigenvalue λ of K = WGWᵀ, Z⁻¹ =
  /// WᵀW, is one at most, and λ⁸ ≤ tr K⁸ = ‖K⁴‖².
  [[nodiscard]] Scalar room(const RootFreeFactor<Scalar, N + 1>& factor) const noexcept {
    const Form image = congruence(inverse_root(factor), forms_[constraints_]);
    const Form square = product_by_columns(image, image);
    const Scalar fourth = product_by_columns(square, square).norm();
    return scalar::constant<Scalar>(0.99L) / scalar::sqrt(scalar::sqrt(fourth));
  }

  Form f_;
  Scalar size_of_f_;
  std::array<Form, most> forms_;  // Bₖ
  Unknowns sizes_;                // of the terms of their largest entries
  std::size_t constraints_ = 0;
  Scalar relief_;
  Unknowns x_;  // the multipliers, and s
  Form z_;
  /// About what s may still fall, on the path where the barrier's slope is e/τ; zero where s is the least for x.
  Scalar gap_;
  BorderedSystem<Scalar, most> system_;
};

}  // namespace detail

}  // namespace elliptude
