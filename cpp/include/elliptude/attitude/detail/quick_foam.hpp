#pragma once

/// \file
/// Wahba's problem by Markley's FOAM where all is as usual: without a decomposition, and without a branch that depends
/// on a number, so that a pack solves as many problems as it has lanes. It says where its answer holds; `solve_wahba`
/// goes another way elsewhere. (theory, section 8)

#include "elliptude/attitude/detail/column.hpp"
#include "elliptude/base/rounding.hpp"

namespace elliptude::detail {

/// What comparing two numbers gives: a truth value, or one a lane.
template <typename Scalar>
using Truth = decltype(Scalar() < Scalar());

template <typename Scalar>
[[nodiscard]] Scalar lesser(const Scalar& a, const Scalar& b) noexcept {
  return scalar::select(b < a, b, a);
}

template <typename Scalar>
[[nodiscard]] Scalar greater(const Scalar& a, const Scalar& b) noexcept {
  return scalar::select(b > a, b, a);
}

/// 2^exponent, for an exponent that is not negative.
template <typename Number>
[[nodiscard]] constexpr Number two_to_the(int exponent) noexcept {
  Number power(1);
  for (int i = 0; i < exponent; ++i) {
    power *= Number(2);
  }
  return power;
}

/// What a direction's lengths make of its weight w.
template <typename Scalar>
struct DirectionScale {
  Scalar factor;  ///< w/(|e||b̃|)
  Scalar ratio;   ///< |e|/|b̃|
  Scalar share;   ///< w/|e|²
};

template <typename Scalar>
[[nodiscard]] EIGEN_ALWAYS_INLINE DirectionScale<Scalar> direction_scale(const Scalar& square_e, const Scalar& square_b,
                                                                         const Scalar& weight) noexcept {
  const Scalar inverse = Scalar(1) / scalar::sqrt(Scalar(square_e * square_b));
  const Scalar factor = weight * inverse;
  return {factor, square_e * inverse, factor * (square_b * inverse)};
}

/// L of weights whose sum is one; and what the cost needs of the first directions again.
template <typename Scalar>
struct QuickProfile {
  static constexpr Eigen::Index most_kept = 8;

  Columns<Scalar> l;
  /// Whether no product of lengths and weights has overflowed or lost digits, and no weight is negative.
  Truth<Scalar> usual;
  std::array<Column<Scalar>, most_kept> references;
  std::array<Scalar, most_kept> ratios;
  std::array<Scalar, most_kept> shares;
};

/// \param directions e, b̃ and w of direction i as `reference(i)`, `body(i)` (`Triple`) and `weight(i)`.
template <typename Scalar, typename Directions>
EIGEN_ALWAYS_INLINE void sum_up(const Directions& directions, Eigen::Index count,
                                QuickProfile<Scalar>& profile) noexcept {
  const Column<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  Columns<Scalar> sum{zero, zero, zero};
  Scalar total(0);
  Scalar least_square(1);
  Scalar largest_square(1);
  Scalar least_weight(0);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Triple<Scalar> e = directions.reference(i);
    const Triple<Scalar> b = directions.body(i);
    const Scalar weight = directions.weight(i);
    const Scalar square_e = dot(e, e);
    const Scalar square_b = dot(b, b);
    const DirectionScale<Scalar> scale = direction_scale(square_e, square_b, weight);
    const Column<Scalar> reference(e.x, e.y, e.z);
    const Column<Scalar> scaled = scale.factor * reference;
    sum = {sum[0] + b.x * scaled, sum[1] + b.y * scaled, sum[2] + b.z * scaled};
    total += weight;
    least_weight = lesser(least_weight, weight);
    least_square = lesser(least_square, lesser(square_e, square_b));
    largest_square = greater(largest_square, greater(square_e, square_b));
    if (i < QuickProfile<Scalar>::most_kept) {
      const auto at = static_cast<std::size_t>(i);
      profile.references[at] = reference;
      profile.ratios[at] = scale.ratio;
      profile.shares[at] = scale.share;
    }
  }
  // The squares of two lengths, and then a weight, are multiplied.
  using Number = scalar::Value<Scalar>;
  constexpr int most = std::numeric_limits<Number>::max_exponent / 2;
  constexpr Number squares = two_to_the<Number>(most - 12);
  constexpr Number weights = two_to_the<Number>(most - 24);
  profile.usual = least_square >= Scalar(Number(1) / squares) && largest_square <= Scalar(squares) &&
                  least_weight >= Scalar(0) && total >= Scalar(Number(1) / weights) && total <= Scalar(weights);
  const Scalar inverse = Scalar(1) / total;
  profile.l = {inverse * sum[0], inverse * sum[1], inverse * sum[2]};
}

template <typename Scalar>
struct QuickRoot {
  Scalar lambda;
  Scalar zeta;
  Truth<Scalar> settled;  ///< and simple by far
};

/// The largest root λ of (8.5) by Halley's steps (8.7) from one, which it is not above. What has settled stays as it
/// is, whatever the other lanes of a pack do.
template <typename Scalar>
[[nodiscard]] EIGEN_ALWAYS_INLINE QuickRoot<Scalar> quick_root(const Scalar& square, const Scalar& determinant,
                                                               const Scalar& adjugate_square) noexcept {
  constexpr int least_steps = 2;
  constexpr int most_steps = 4;
  constexpr long double least_share = 1.0L / 256;  // of ζ in λ³
  QuickRoot<Scalar> root{Scalar(1), Scalar(0), Scalar(0) > Scalar(0)};
  for (int step = 0; step <= most_steps; ++step) {
    const Scalar square_of_root = root.lambda * root.lambda;
    const Scalar kappa = scalar::constant<Scalar>(0.5L) * (square_of_root - square);
    const Scalar value = kappa * kappa - adjugate_square - Scalar(2) * root.lambda * determinant;
    root.zeta = kappa * root.lambda - determinant;
    if (step >= least_steps) {
      // The scale of (8.8) is off by at most p λ²/2ζ²; its square is rounding.
      root.settled = value * square_of_root <= rounding::root<Scalar>() * (root.zeta * root.zeta) &&
                     root.zeta > scalar::constant<Scalar>(least_share) * (square_of_root * root.lambda);
      if (step == most_steps || scalar::all(root.settled)) {
        break;
      }
    }
    const Scalar change =
        Scalar(2) * value * root.zeta / (Scalar(4) * root.zeta * root.zeta - value * (square_of_root + kappa));
    root.lambda = scalar::select(root.settled, root.lambda, Scalar(root.lambda - change));
  }
  return root;
}

/// The rotation next to (cof(λL + cof L) + ζL)/λζ by one of Newton's steps for the polar factor.
/// (theory, eqs. 8.8 and 8.9)
template <typename Scalar>
[[nodiscard]] EIGEN_ALWAYS_INLINE Columns<Scalar> quick_attitude(const Columns<Scalar>& l, const Columns<Scalar>& k,
                                                                 const QuickRoot<Scalar>& root) noexcept {
  const Columns<Scalar> mixed =
      cofactors(Columns<Scalar>{k[0] + root.lambda * l[0], k[1] + root.lambda * l[1], k[2] + root.lambda * l[2]});
  const Columns<Scalar> p{mixed[0] + root.zeta * l[0], mixed[1] + root.zeta * l[1], mixed[2] + root.zeta * l[2]};
  const Columns<Scalar> q = cofactors(p);
  const Scalar inverse = Scalar(1) / (root.lambda * root.zeta);
  const Scalar inner = scalar::constant<Scalar>(0.5L) * inverse;
  // 1/det to first order: det P/(λζ)³ is one but for the scale's error.
  const Scalar outer = (inner * inverse) * (Scalar(2) - dot(p[0], q[0]) * (inverse * inverse * inverse));
  return {inner * p[0] + outer * q[0], inner * p[1] + outer * q[1], inner * p[2] + outer * q[2]};
}

/// cos(⅔ arccos c) of two numbers c from 0 to 1, within 1e-10: the polynomial of degree ten that is nearest to it.
template <typename Scalar>
[[nodiscard]] EIGEN_ALWAYS_INLINE Eigen::Array<Scalar, 2, 1> cosines_of_two_thirds(
    const Eigen::Array<Scalar, 2, 1>& c) noexcept {
  using Pair = Eigen::Array<Scalar, 2, 1>;
  const auto line = [&c](long double constant, long double slope) {
    return Pair(scalar::constant<Scalar>(constant) + scalar::constant<Scalar>(slope) * c);
  };
  const Pair c2 = c * c;
  const Pair c4 = c2 * c2;
  const Pair low =
      line(0.500000000081081761L, 0.577350249499929925L) + c2 * line(-0.111110309747589829L, 0.0534454428329556135L);
  const Pair middle = line(-0.032813031093264125L, 0.0223199087402349947L) +
                      c2 * line(-0.0152799864586514633L, 0.00937812832321461991L);
  const Pair high = line(-0.00448529251464878517L, 0.00140248640659392743L) +
                    c2 * scalar::constant<Scalar>(-0.000207596114160589143L);
  return low + c4 * (middle + c4 * high);
}

/// The largest over the smallest of λ − σ, with the eigenvalues σ of A = CᵀL in closed form: those of CᵀL − ⅓λI have
/// the same squares and the same product as L − ⅓λC. (theory, eq. 8.10)
template <typename Scalar>
[[nodiscard]] EIGEN_ALWAYS_INLINE Scalar quick_condition(const Columns<Scalar>& c, const Columns<Scalar>& l,
                                                         const Scalar& lambda) noexcept {
  const Scalar third = lambda * scalar::constant<Scalar>(1.0L / 3.0L);
  const Columns<Scalar> rest{l[0] - third * c[0], l[1] - third * c[1], l[2] - third * c[2]};
  // Not zero, and no more than rounding where it counts.
  const Scalar square = sum_of_squares(rest) * scalar::constant<Scalar>(1.0L / 6.0L) + rounding::square<Scalar>();
  const Scalar spread = scalar::sqrt(square);
  const Scalar quarter = scalar::constant<Scalar>(0.25L) * dot(rest[0], cross(rest[1], rest[2])) / (spread * square);
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Eigen::Array<Scalar, 2, 1> squares_of_cosines(half + quarter, half - quarter);
  const Eigen::Array<Scalar, 2, 1> ends = spread * cosines_of_two_thirds<Scalar>(squares_of_cosines.abs().sqrt());
  return (third + ends(1)) / (third - ends(0));
}

/// ½ Σ wᵢ ‖eᵢ/|eᵢ| − C b̃ᵢ/|b̃ᵢ|‖².
template <typename Scalar, typename Directions>
[[nodiscard]] EIGEN_ALWAYS_INLINE Scalar quick_cost(const Directions& directions, Eigen::Index count,
                                                    const QuickProfile<Scalar>& profile,
                                                    const Columns<Scalar>& c) noexcept {
  Column<Scalar> squares(Scalar(0), Scalar(0), Scalar(0));
  const auto add = [&](const Column<Scalar>& e, const Triple<Scalar>& b, const Scalar& ratio, const Scalar& share) {
    const Column<Scalar> rest = e - ratio * (b.x * c[0] + b.y * c[1] + b.z * c[2]);
    squares = squares + share * (rest * rest);
  };
  for (Eigen::Index i = 0; i < count; ++i) {
    const Triple<Scalar> b = directions.body(i);
    if (i < QuickProfile<Scalar>::most_kept) {
      const auto at = static_cast<std::size_t>(i);
      add(profile.references[at], b, profile.ratios[at], profile.shares[at]);
    } else {
      const Triple<Scalar> e = directions.reference(i);
      const DirectionScale<Scalar> scale = direction_scale(dot(e, e), dot(b, b), Scalar(directions.weight(i)));
      add(Column<Scalar>(e.x, e.y, e.z), b, scale.ratio, scale.share);
    }
  }
  return scalar::constant<Scalar>(0.5L) * sum(squares);
}

/// Solves Wahba's problem.
/// \param solution a `WahbaSolution`; one of numbers changes only if the answer holds, and of packs those lanes have no
/// meaning where it does not.
/// \return where the answer holds: the numbers have usual sizes, and the condition is moderate.
template <typename Scalar, typename Directions, typename Solution>
[[nodiscard]] Truth<Scalar> quick_foam(const Directions& directions, Eigen::Index count, Solution& solution) noexcept {
  QuickProfile<Scalar> profile;
  sum_up(directions, count, profile);
  const Columns<Scalar>& l = profile.l;
  const Columns<Scalar> k = cofactors(l);
  const QuickRoot<Scalar> root = quick_root<Scalar>(sum_of_squares(l), dot(l[0], k[0]), sum_of_squares(k));
  const Truth<Scalar> holds = profile.usual && root.settled;
  if constexpr (std::is_same_v<Truth<Scalar>, bool>) {
    if (!holds) {
      return false;
    }
  }
  const Columns<Scalar> c = quick_attitude(l, k, root);
  solution.condition = quick_condition(c, l, root.lambda);
  solution.cost = quick_cost(directions, count, profile, c);
  for (int j = 0; j < 3; ++j) {
    solution.attitude.col(j) = c[static_cast<std::size_t>(j)].vector();
  }
  return holds;
}

}  // namespace elliptude::detail
