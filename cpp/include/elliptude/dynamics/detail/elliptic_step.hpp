#pragma once

/// \file
/// Jacobi's elliptic functions of a step of the free rotor, the part of its phase that depends on the step and the two
/// invariants alone, and their derivatives (theory, section 4.1). Everything is regular for symmetric and spherical
/// bodies, for spins about each axis and at the separatrix.

#include "elliptude/base/scalar.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude::detail {

/// What the functions of a step depend on besides its length: κ = (b₃ − b₂)/(b₃ − b₁) of the inverse moments bᵢ, and q,
/// the largest z² of the motion of the unit vector of the momentum.
template <typename Scalar>
struct EllipticInvariants {
  Scalar kappa;
  Scalar q;
  Scalar rest;  ///< 1 − q, without cancellation

  [[nodiscard]] Scalar a() const noexcept { return kappa * q; }                   ///< A = κq
  [[nodiscard]] Scalar b() const noexcept { return (Scalar(1) - kappa) * rest; }  ///< B = (1 − κ)(1 − q)
};

/// s = sn, c and d = cn and dn, whichever comes first, with c² = 1 − Bs², d² = 1 − As², and the phase e^{iθ}, all at
/// the step's length T; or their derivatives with respect to q at the same T.
template <typename Scalar>
struct EllipticStep {
  Scalar s;
  Scalar c;
  Scalar d;
  Scalar angle;  ///< the phase is e^{i angle} (cosine + i sine)
  Scalar cosine = Scalar(1);
  Scalar sine = Scalar(0);

  struct Slope {
    Scalar s;
    Scalar c;
    Scalar d;
    Scalar phase;  ///< ∂θ/∂q
  };
  Slope by_q;
};

/// τ²/T² at the six nodes of Gauss's rule for ∫₀ᵀ τ² f(τ²) dτ = T³ Σ weight f, exact for f of degree 11.
template <typename Scalar>
struct StepQuadrature {
  static constexpr int count = 6;
  using Nodes = Eigen::Array<Scalar, count, 1>;

  [[nodiscard]] static Nodes nodes() noexcept {
    Nodes result;
    result << scalar::constant<Scalar>(0.0531110353928767363887096955813L),
        scalar::constant<Scalar>(0.201145747732240299626343177463L),
        scalar::constant<Scalar>(0.412612673879441420525454843176L),
        scalar::constant<Scalar>(0.642527435543658419089036630173L),
        scalar::constant<Scalar>(0.841986822256571648821331171148L),
        scalar::constant<Scalar>(0.968616285195211475549124482459L);
    return result;
  }

  [[nodiscard]] static Nodes weights() noexcept {
    Nodes result;
    result << scalar::constant<Scalar>(0.0120181339957554417920530213398L),
        scalar::constant<Scalar>(0.0418013142725662327689373244071L),
        scalar::constant<Scalar>(0.073505289463061962134874398569L),
        scalar::constant<Scalar>(0.0892300403864659335951860925028L),
        scalar::constant<Scalar>(0.0775650889098782566637164989104L),
        scalar::constant<Scalar>(0.0392134663056055063785659976042L);
    return result;
  }
};

/// T²℘(T) − 1 = Σ cₖ T²ᵏ, k = 2 … 11, as a polynomial in τ²/T²: the coefficients cₖ T²ᵏ (Abramowitz and Stegun, 18.5).
template <typename Scalar>
class WeierstrassSeries {
 public:
  /// \param y T².
  WeierstrassSeries(const Scalar& a, const Scalar& b, const Scalar& y) noexcept {
    const auto number = [](long double value) { return scalar::constant<Scalar>(value); };
    // g₂/20 and g₃/28 of the roots e₂ = −(A + B)/3, e₂ + A, e₂ + B.
    const Scalar y2 = y * y;
    const Scalar c2 = (a * a - a * b + b * b) * y2 * number(1.0L / 15);
    const Scalar c3 = (a + b) * (Scalar(2) * a - b) * (Scalar(2) * b - a) * y2 * y * number(-1.0L / 189);
    const Scalar c22 = c2 * c2;
    const Scalar c33 = c3 * c3;
    const Scalar c23 = c2 * c3;
    const Scalar c222 = c22 * c2;
    coefficients_ = {c2,
                     c3,
                     c22 * number(1.0L / 3),
                     c23 * number(3.0L / 11),
                     (Scalar(2) * c222 + Scalar(3) * c33) * number(1.0L / 39),
                     c22 * c3 * number(2.0L / 33),
                     c2 * (Scalar(11) * c222 + Scalar(36) * c33) * number(5.0L / 7293),
                     c3 * (Scalar(29) * c222 + Scalar(11) * c33) * number(1.0L / 2717),
                     c22 * (Scalar(242) * c222 + Scalar(1455) * c33) * number(1.0L / 240669),
                     c23 * (Scalar(389) * c222 + Scalar(369) * c33) * number(14.0L / 3187041)};
  }

  /// τ²℘(τ) − 1 at t = τ²/T², for a number or an array of them.
  template <typename Argument>
  [[nodiscard]] Argument at(const Argument& t) const noexcept {
    Argument sum = t * coefficients_.back();
    for (std::size_t k = coefficients_.size() - 1; k-- > 0;) {
      sum = (sum + coefficients_[k]) * t;
    }
    return sum * t;
  }

 private:
  std::array<Scalar, 10> coefficients_;
};

/// The longest T for which the series and the quadrature leave less than rounding: ½, and 1/√8 beyond double precision.
template <typename Scalar>
[[nodiscard]] Scalar longest_series_square() noexcept {
  return scalar::constant<Scalar>(std::numeric_limits<scalar::Value<Scalar>>::digits <= 53 ? 0.25L : 0.125L);
}

/// The functions at a T no longer than that.
template <bool slopes, typename Scalar>
[[nodiscard]] EllipticStep<Scalar> short_elliptic_step(const EllipticInvariants<Scalar>& of, const Scalar& t) noexcept {
  using Quadrature = StepQuadrature<Scalar>;
  using Nodes = typename Quadrature::Nodes;
  const Scalar a = of.a();
  const Scalar b = of.b();
  const Scalar y = t * t;
  const Scalar third = scalar::constant<Scalar>(1.0L / 3) * (a + b);  // −e₂
  const WeierstrassSeries<Scalar> series(a, b, y);
  // s² = 1/(℘ − e₂)
  const Scalar square = Scalar(1) / (Scalar(1) + series.at(Scalar(1)) + third * y);
  EllipticStep<Scalar> step;
  step.s = t * scalar::sqrt(square);
  const Scalar s2 = y * square;
  step.c = scalar::sqrt(Scalar(Scalar(1) - b * s2));
  step.d = scalar::sqrt(Scalar(Scalar(1) - a * s2));
  const Nodes nodes = Quadrature::nodes();
  const Nodes weights = Quadrature::weights();
  const Nodes w = series.at(nodes) + Scalar(1);
  const Scalar cube = y * t;
  // θ = −κ(1 − q) ∫ dτ / (℘ − e₃ + κ)
  const Nodes third_kind = weights / (w + (of.kappa - a + third) * y * nodes);
  step.angle = -of.kappa * of.rest * cube * third_kind.sum();
  if constexpr (slopes) {
    const Nodes f1 = w + (third - b) * y * nodes;
    const Nodes f2 = w + third * y * nodes;
    const Nodes both = weights / (f1 * f2);
    const Scalar integral1 = cube * Nodes(both * f2).sum();  // ∫ dτ / (℘ − e₁)
    const Scalar integral2 = cube * Nodes(both * f1).sum();  // ∫ dτ / (℘ − e₂)
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar other = Scalar(1) - of.kappa;
    auto& slope = step.by_q;
    slope.s = half * (step.c * step.d * (of.kappa * integral2 + integral1) - of.kappa * s2 * step.s);
    slope.c = (half * other * s2 - b * step.s * slope.s) / step.c;
    slope.d = -(half * of.kappa * s2 + a * step.s * slope.s) / step.d;
    slope.phase = half * of.kappa * (step.c * step.c * integral1 + integral2) / (step.d * step.d + of.kappa * s2);
  }
  return step;
}

/// The functions at 2T from those at T.
template <bool slopes, typename Scalar>
[[nodiscard]] EllipticStep<Scalar> doubled(const EllipticInvariants<Scalar>& of,
                                           const EllipticStep<Scalar>& step) noexcept {
  const Scalar a = of.a();
  const Scalar b = of.b();
  const Scalar& kappa = of.kappa;
  const Scalar other = Scalar(1) - kappa;
  const Scalar difference = of.q - other;  // A − B
  const Scalar& s = step.s;
  const Scalar s2 = s * s;
  const Scalar c2 = step.c * step.c;
  const Scalar d2 = step.d * step.d;
  const Scalar cd = step.c * step.d;
  const Scalar inverse = Scalar(1) / (d2 + a * s2 * c2);
  EllipticStep<Scalar> next;
  next.s = Scalar(2) * s * cd * inverse;
  next.c = (c2 * c2 + b * difference * s2 * s2) * inverse;
  next.d = (d2 * d2 - a * difference * s2 * s2) * inverse;
  // θ(2T) = 2 θ(T) + arg(across + i along)
  const Scalar pairs = c2 + c2 * d2 + d2;
  const Scalar across = d2 * (d2 * (c2 + Scalar(1)) - c2) + kappa * s2 * pairs;
  const Scalar along = Scalar(-2) * kappa * of.rest * s2 * s * cd;
  const Scalar square = across * across + along * along;
  const Scalar scale = Scalar(1) / scalar::sqrt(square);
  const Scalar cosine = (step.cosine * step.cosine - step.sine * step.sine) * scale;
  const Scalar sine = Scalar(2) * step.cosine * step.sine * scale;
  next.angle = Scalar(2) * step.angle;
  next.cosine = cosine * across - sine * along;
  next.sine = cosine * along + sine * across;
  if constexpr (slopes) {
    const auto& slope = step.by_q;
    const Scalar by_s2 = Scalar(2) * s * slope.s;
    const Scalar by_c2 = Scalar(2) * step.c * slope.c;
    const Scalar by_d2 = Scalar(2) * step.d * slope.d;
    const Scalar by_cd = slope.c * step.d + step.c * slope.d;
    const Scalar by_denominator = by_d2 + kappa * s2 * c2 + a * (by_s2 * c2 + s2 * by_c2);
    next.by_q.s = (Scalar(2) * (slope.s * cd + s * by_cd) - next.s * by_denominator) * inverse;
    next.by_q.c = (Scalar(2) * c2 * by_c2 + (b - other * difference) * s2 * s2 +
                   Scalar(2) * b * difference * s2 * by_s2 - next.c * by_denominator) *
                  inverse;
    next.by_q.d = (Scalar(2) * d2 * by_d2 - (a + kappa * difference) * s2 * s2 -
                   Scalar(2) * a * difference * s2 * by_s2 - next.d * by_denominator) *
                  inverse;
    const Scalar by_across = by_d2 * (d2 * (c2 + Scalar(1)) - c2) +
                             d2 * (by_d2 * (c2 + Scalar(1)) + d2 * by_c2 - by_c2) + kappa * by_s2 * pairs +
                             kappa * s2 * (by_c2 * (Scalar(1) + d2) + (c2 + Scalar(1)) * by_d2);
    const Scalar by_along =
        Scalar(2) * kappa * s2 * s * cd -
        Scalar(2) * kappa * of.rest * (scalar::constant<Scalar>(1.5L) * by_s2 * s * cd + s2 * s * by_cd);
    next.by_q.phase = Scalar(2) * slope.phase + (across * by_along - along * by_across) / square;
  }
  return next;
}

/// `a` where the mask holds, else `b`.
template <bool slopes, typename Mask, typename Scalar>
[[nodiscard]] EllipticStep<Scalar> select_step(const Mask& mask, const EllipticStep<Scalar>& a,
                                               const EllipticStep<Scalar>& b) noexcept {
  if constexpr (std::is_same_v<Mask, bool>) {
    return mask ? a : b;
  } else {
    const auto choose = [&mask](const Scalar& x, const Scalar& y) { return scalar::select(mask, x, y); };
    EllipticStep<Scalar> result{choose(a.s, b.s),
                                choose(a.c, b.c),
                                choose(a.d, b.d),
                                choose(a.angle, b.angle),
                                choose(a.cosine, b.cosine),
                                choose(a.sine, b.sine),
                                {}};
    if constexpr (slopes) {
      result.by_q = {choose(a.by_q.s, b.by_q.s), choose(a.by_q.c, b.by_q.c), choose(a.by_q.d, b.by_q.d),
                     choose(a.by_q.phase, b.by_q.phase)};
    }
    return result;
  }
}

/// The functions at any T: T is halved until the series serve, and the functions are doubled as often.
/// \return `step_too_long` for a T beyond 1/ε, of which no digit says anything about the phase, or that is not finite.
template <bool slopes, typename Scalar>
[[nodiscard]] Status elliptic_step(const EllipticInvariants<Scalar>& of, const Scalar& length,
                                   EllipticStep<Scalar>& step) noexcept {
  constexpr int most_halvings = 66;  // from 1/ε of long double on
  const Scalar longest = longest_series_square<Scalar>();
  Scalar t = length;
  Scalar halvings(0);
  int most = 0;
  while (!scalar::all(t * t <= longest)) {
    if (most == most_halvings) {
      return Status::step_too_long;
    }
    ++most;
    const auto is_long = t * t > longest;
    halvings += scalar::select(is_long, Scalar(1), Scalar(0));
    t = scalar::select(is_long, Scalar(scalar::constant<Scalar>(0.5L) * t), t);
  }
  EllipticStep<Scalar> result = short_elliptic_step<slopes>(of, t);
  for (int i = 0; i < most; ++i) {
    result = select_step<slopes>(Scalar(static_cast<scalar::Value<Scalar>>(i)) < halvings, doubled<slopes>(of, result),
                                 result);
  }
  step = result;
  return Status::ok;
}

}  // namespace elliptude::detail
