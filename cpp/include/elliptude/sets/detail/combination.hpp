#pragma once

/// \file
/// The weighted sum of a quadric and the unit ball: the family of ellipsoids in which `minimal_intersection` searches.
/// (theory, section 7)

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/sets/overlap.hpp"

namespace elliptude::detail {

/// 1 for each coordinate in which the ellipsoid of a triangular factor is not flat, else 0.
template <typename Scalar, int N>
[[nodiscard]] Vector<Scalar, N> present_coordinates(const Matrix<Scalar, N>& factor) noexcept {
  return factor.diagonal().unaryExpr([](const Scalar& entry) { return entry > Scalar(0) ? Scalar(1) : Scalar(0); });
}

/// A quadric uᵀMu + 2vᵀu ≤ k and the unit ball ‖u‖ ≤ 1, combined with weights 1 and q: A = M + qI at one q, and N = k +
/// q + vᵀA⁻¹v, whose sign shows whether the two meet. Where the ellipsoid that the ball stands for is flat in a
/// coordinate, that coordinate of u does not exist; it keeps a one on the diagonal of A. This is what is kept of the
/// best one; A⁻¹ follows from it.
template <typename Scalar, int N>
struct KeptCombination {
  Matrix<Scalar, N> root;    ///< lower triangle with A⁻¹ = rootᵀ root
  Vector<Scalar, N> center;  ///< −A⁻¹v
  Scalar quadric_slack;      ///< k − uᵀMu − 2vᵀu at the center
  Scalar ball_slack;         ///< 1 − ‖center‖², which is dN/dq
  Scalar level;              ///< N
  Scalar inverse_trace;      ///< tr A⁻¹

  /// Whether the center lies in both sets, a proof that they meet.
  [[nodiscard]] bool is_common_point() const noexcept { return quadric_slack >= Scalar(0) && ball_slack >= Scalar(0); }
};

template <typename Scalar, int N>
struct Combination : KeptCombination<Scalar, N> {
  Matrix<Scalar, N> inverse;  ///< A⁻¹
};

/// The slack of a quadric by a function of its own, in one type for all, so that the searches are compiled once.
template <typename Scalar, int N>
class AnySlack {
 public:
  /// \param slack lives as long as this.
  template <typename Slack>
  explicit AnySlack(const Slack& slack) noexcept
      : slack_(&slack), call_([](const void* any, const Vector<Scalar, N>& u) noexcept -> Scalar {
          return (*static_cast<const Slack*>(any))(u);
        }) {}
  [[nodiscard]] Scalar operator()(const Vector<Scalar, N>& u) const noexcept { return call_(slack_, u); }

 private:
  const void* slack_;
  Scalar (*call_)(const void*, const Vector<Scalar, N>&) noexcept;
};

/// The whitened problem: `slack(u)` is k − uᵀMu − 2vᵀu, which the caller evaluates without cancellation.
template <typename Scalar, int N, typename Slack>
struct Problem {
  const Matrix<Scalar, N>& m;
  const Vector<Scalar, N>& v;
  const Vector<Scalar, N>& present;  ///< 1 where the coordinate exists, else 0
  const Slack& slack;

  /// The q below which, where M is singular, A⁻¹ has less than three right digits, so that N < 0 proves nothing.
  [[nodiscard]] Scalar least_weight() const noexcept {
    return rounding::share<Scalar>(rounding::three_digits * N) * m.norm();
  }

  /// Whether forming M may have cost containment: its rounding moves the boundary by about the condition of A times ε,
  /// and ε^⅔ is not worth another way.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool is_ill_conditioned(const Scalar& q,
                                                              const KeptCombination<Scalar, N>& at) const noexcept {
    const Scalar condition = (m.trace() + Scalar(N) * q) * at.inverse_trace;
    return !(condition * condition * condition * rounding::one_rounding<Scalar>() <= Scalar(1));
  }

  /// A q of the size of the quadric; zero if that says nothing.
  [[nodiscard]] Scalar typical_weight() const noexcept { return (m.norm() + v.norm()) / scalar::sqrt(Scalar(N)); }

  /// \param result of use only after `ok`.
  /// \return `not_positive_definite` if A is not.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status combine(const Scalar& q, Combination<Scalar, N>& result) const noexcept {
    Matrix<Scalar, N> a = m;
    for (int i = 0; i < N; ++i) {
      a(i, i) += present(i) > Scalar(0) ? q : Scalar(1);
    }
    Matrix<Scalar, N>& l = result.inverse;  // for now
    if (const Status status = put_cholesky(a, l); status != Status::ok) {
      return status;
    }
    put_lower_inverse(l, result.root);
    put_square_of_lower(result.root, result.inverse);
    result.inverse_trace = result.inverse.trace();
    put_center(Vector<Scalar, N>(-result.inverse.lazyProduct(v)), q, true, result);
    // The level is at most N at any point, and less than it by the center's rounding times A.
    for (int k = 0; k < 2 && result.level < Scalar(0); ++k) {
      const Vector<Scalar, N> residual = a.lazyProduct(result.center) + v;
      put_center(Vector<Scalar, N>(result.center - result.inverse.lazyProduct(residual)), q, false, result);
    }
    return Status::ok;
  }

 private:
  /// \param anyway if not, only where the level is higher than that of the present center.
  void put_center(const Vector<Scalar, N>& center, const Scalar& q, bool anyway,
                  KeptCombination<Scalar, N>& result) const noexcept {
    const Scalar quadric_slack = slack(center);
    const Scalar ball_slack = Scalar(1) - center.squaredNorm();
    const Scalar level = quadric_slack + q * ball_slack;
    if (anyway || level > result.level) {
      result.center = center;
      result.quadric_slack = quadric_slack;
      result.ball_slack = ball_slack;
      result.level = level;
    }
  }
};

/// Whether the quadric and the ball have no common point: N(q) < 0 for some q ≥ 0 with A ≻ 0. N is convex; its least
/// value is where ‖center‖ = 1, found by the step that makes 1/‖center‖ linear in q (Moré and Sorensen), kept in a
/// bracket. (theory, eq. 7.7)
template <typename Scalar, int N, typename Slack>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool provably_empty(const Problem<Scalar, N, Slack>& problem,
                                                        const Scalar& start) noexcept {
  Scalar low(0);
  Scalar high(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  const Scalar least = problem.least_weight();
  Scalar q = start;
  constexpr int most_steps = 60;
  for (int step = 0; step < most_steps && q > least; ++step) {
    Combination<Scalar, N> combination;
    Scalar next;
    if (problem.combine(q, combination) != Status::ok) {
      low = q;
      next = Scalar(4) * q;
    } else {
      if (combination.level < Scalar(0)) {
        return true;
      }
      const Scalar length = combination.center.norm();
      if (combination.is_common_point()) {
        return false;
      }
      (length > Scalar(1) ? low : high) = q;
      const Scalar change = combination.center.squaredNorm() * (length - Scalar(1)) /
                            combination.center.dot(combination.inverse.lazyProduct(combination.center));
      if (scalar::abs(change) <= rounding::root<Scalar>() * q) {
        return false;
      }
      next = q + change;
    }
    if (!(next > low && next < high)) {
      next = scalar::isfinite(high) ? scalar::constant<Scalar>(0.5L) * (low + high) : Scalar(4) * q;
    }
    q = next;
  }
  return false;
}

/// The size of the ellipsoid that a combination stands for, seen in x = origin + factor u, by its logarithm less that
/// of the second set's, log of tr(W' N A⁻¹) / tr W' with W' = factorᵀ W factor, or of det(N A⁻¹) over the coordinates
/// that exist.
template <typename Scalar, int N>
class RelativeSize {
 public:
  /// \param factor a lower triangle.
  RelativeSize(const Matrix<Scalar, N>& factor, const Vector<Scalar, N>& present,
               const SizeCriterion<Scalar, N>& criterion) noexcept
      : by_volume_(criterion.by_volume()),
        dimension_(present.sum()),
        absent_(Scalar(N) - dimension_),
        weight_(present.asDiagonal()) {
    if (!by_volume() && criterion.kind == SizeCriterion<Scalar, N>::Kind::trace) {
      put_square_of_lower(factor, weight_);
    } else if (!by_volume()) {
      put_weight(factor, criterion.weight);
    }
  }

  /// Whether that is negative: the second set alone is larger. No branch depends on a number.
  [[nodiscard]] auto is_below_second(const KeptCombination<Scalar, N>& c) const noexcept {
    if (by_volume()) {
      return relative_log_volume(c) < Scalar(0);
    }
    return c.level * weight_.cwiseProduct(square_of_lower(c.root)).sum() < weight_.trace();
  }

  /// First and second derivative with respect to q.
  ELLIPTUDE_OUT_OF_LINE void derivatives(const Combination<Scalar, N>& c, Scalar& first,
                                         Scalar& second) const noexcept {
    const Scalar level1 = c.ball_slack / c.level;
    const Scalar level2 = Scalar(2) * c.center.dot(c.inverse.lazyProduct(c.center)) / c.level - level1 * level1;
    if (by_volume()) {
      first = dimension_ * level1 - (c.inverse.trace() - absent_);
      second = dimension_ * level2 + (c.inverse.squaredNorm() - absent_);
    } else {
      const Matrix<Scalar, N> half = c.inverse.lazyProduct(weight_);
      const Matrix<Scalar, N> both = half.lazyProduct(c.inverse);
      const Scalar trace = half.trace();
      const Scalar trace1 = -both.trace() / trace;
      first = level1 + trace1;
      second = level2 + Scalar(2) * both.cwiseProduct(c.inverse).sum() / trace - trace1 * trace1;
    }
  }

  struct Slopes {
    Scalar first;
    Scalar second;
  };
  /// The same with respect to log q.
  [[nodiscard]] Slopes derivatives_in_log(const Combination<Scalar, N>& c, const Scalar& q) const noexcept {
    Slopes slopes;
    derivatives(c, slopes.first, slopes.second);
    slopes.second = q * slopes.first + q * q * slopes.second;
    slopes.first = q * slopes.first;
    return slopes;
  }

  [[nodiscard]] bool by_volume() const noexcept { return only_volume || by_volume_; }
  [[nodiscard]] const Matrix<Scalar, N>& weight() const noexcept { return weight_; }  ///< W', if not by volume

  /// The quadric's slack at the ball's center from which on mixing in the quadric gains nothing: where the derivative
  /// with respect to 1/q at 1/q = 0 is not negative.
  [[nodiscard]] Scalar idle_slack(const Matrix<Scalar, N>& m) const noexcept {
    return by_volume() ? Scalar(m.trace() / dimension_) : Scalar(weight_.cwiseProduct(m).sum() / weight_.trace());
  }

 private:
  /// The logarithm of det(N A⁻¹) over the coordinates that exist: that of the volume, squared, less the second set's.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Scalar relative_log_volume(const KeptCombination<Scalar, N>& c) const noexcept {
    Scalar determinant(1);
    for (int i = 0; i < N; ++i) {
      determinant *= c.root(i, i);  // of the root of A⁻¹
    }
    return dimension_ * scalar::log(c.level) + Scalar(2) * scalar::log(determinant);
  }

  ELLIPTUDE_OUT_OF_LINE void put_weight(const Matrix<Scalar, N>& factor, const Matrix<Scalar, N>& weight) noexcept {
    weight_ = factor.transpose().lazyProduct(Matrix<Scalar, N>(weight.lazyProduct(factor)));
  }

  bool by_volume_;
  Scalar dimension_;
  Scalar absent_;
  Matrix<Scalar, N> weight_;
};

/// The end of a search: the combination, its share, and whether the search met a common point of the two sets.
template <typename Scalar, int N>
struct Found {
  KeptCombination<Scalar, N>& combination;
  Scalar share;
  bool common_point;

  void take(const KeptCombination<Scalar, N>& trial, const Scalar& its_share) noexcept {
    combination = trial;
    share = its_share;
    common_point = common_point || trial.is_common_point();
  }
};

/// Newton's step to where the slope is zero, or the longest one downhill where the curvature is not positive.
template <typename Scalar>
[[nodiscard]] Scalar newton_move(const Scalar& slope, const Scalar& curvature, const Scalar& longest) noexcept {
  const Scalar move =
      curvature > Scalar(0) ? Scalar(-slope / curvature) : (slope > Scalar(0) ? Scalar(-longest) : longest);
  return move > longest ? longest : (move < -longest ? Scalar(-longest) : move);
}

/// The step in log q that Newton's step in 1/q is, or the longest one where that is beyond the second set alone, 1/q =
/// 0. There the size is smooth in 1/q: in log q each step towards it would go half a unit.
template <typename Scalar>
[[nodiscard]] Scalar newton_move_upward(const Scalar& slope, const Scalar& curvature, const Scalar& longest) noexcept {
  const Scalar left = curvature + Scalar(2) * slope;
  const Scalar move = left > Scalar(0) ? scalar::log(Scalar((curvature + slope) / left)) : longest;
  return move < longest ? move : longest;
}

/// Whether a step to where the slope is zero is the last: short, and short beside the width of the minimum, which of
/// sets that barely meet is narrow. Newton's steps square the error: after one with |slope · move| ≤ ε^¼ the logarithm
/// of the size exceeds its least value by a quarter of √ε at most. (theory, section 7.4) No branch depends on a number.
template <typename Scalar>
[[nodiscard]] auto is_last_move(const Scalar& slope, const Scalar& move) noexcept {
  const Scalar tolerance = scalar::sqrt(rounding::root<Scalar>());
  return scalar::abs(move) <= tolerance && scalar::abs(Scalar(slope * move)) <= tolerance;
}

/// Where a search for the best log q has still to look.
template <typename Scalar>
struct Bracket {
  Scalar low{-std::numeric_limits<scalar::Value<Scalar>>::infinity()};
  Scalar high{std::numeric_limits<scalar::Value<Scalar>>::infinity()};

  [[nodiscard]] bool is_narrow() const noexcept { return high - low <= rounding::root<Scalar>(); }
  /// This log q, or the middle if it is not inside.
  [[nodiscard]] Scalar inside(const Scalar& log_q) const noexcept {
    return log_q > low && log_q < high ? log_q : Scalar(scalar::constant<Scalar>(0.5L) * (low + high));
  }
};

/// Whether the first set alone, q = 0, is the best: it is bounded and the size grows from there. It is then what was
/// found.
/// \param trial room to work in.
template <typename Scalar, int N, typename Slack>
[[nodiscard]] bool first_set_is_best(const Problem<Scalar, N, Slack>& problem, const RelativeSize<Scalar, N>& size,
                                     Combination<Scalar, N>& trial, Found<Scalar, N>& found) noexcept {
  if (problem.combine(Scalar(0), trial) != Status::ok || !(trial.level >= Scalar(0))) {
    return false;
  }
  Scalar slope;
  Scalar curvature;
  size.derivatives(trial, slope, curvature);
  if (!(slope < Scalar(0))) {  // also where the level is zero
    found.take(trial, Scalar(0));
    return true;
  }
  return false;
}

/// The combination at one q is what was found, if it is a bound.
/// \param trial room to work in.
template <typename Scalar, int N, typename Slack>
void take_bound(const Problem<Scalar, N, Slack>& problem, const Scalar& q, Combination<Scalar, N>& trial,
                Found<Scalar, N>& found) noexcept {
  if (problem.combine(q, trial) == Status::ok && trial.level > Scalar(0)) {
    found.take(trial, Scalar(q / (Scalar(1) + q)));
  }
}

/// The combination of least size. The logarithm of either criterion has positive curvature wherever it is stationary,
/// so it is stationary once and best there (theory, section 7.4). Found by safeguarded Newton steps in log q from
/// `start`; each iterate is a valid bound. It ends also where the start was the best, where the slope is rounding, as
/// about the second set alone, and where the bracket is as narrow as √ε: beyond, rounding would choose the bound. So it
/// would beside weights with an N that is negative, but may be so by rounding: of these a few are tried.
/// \return `empty_intersection` with N < 0 and A ≻ 0 as proof; `not_converged` if no bound was found (A never ≻ 0).
template <typename Scalar, int N, typename Slack>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status least_combination(const Problem<Scalar, N, Slack>& problem,
                                                             const RelativeSize<Scalar, N>& size, const Scalar& start,
                                                             Found<Scalar, N>& found) noexcept {
  const Scalar longest(4);
  constexpr int most_steps = 60;
  constexpr int most_refused = 5;
  Bracket<Scalar> bracket;
  Scalar log_q(0);  // less that of the start, which so needs neither a logarithm nor an exponential
  bool bounded = false;
  int refused = 0;  // weights with an N that says nothing
  bool is_last = false;
  bool first_set_tried = false;
  Combination<Scalar, N> trial;
  for (int step = 0; step < most_steps; ++step) {
    const Scalar q = step == 0 ? start : Scalar(start * scalar::exp(log_q));
    Scalar move = longest;
    const bool is_definite = problem.combine(q, trial) == Status::ok;
    if (!is_definite || (trial.level < Scalar(0) && !(q > problem.least_weight()))) {
      if (is_definite && bounded && ++refused == most_refused) {
        return Status::ok;
      }
      bracket.low = log_q;
    } else {
      if (trial.level < Scalar(0)) {
        return Status::empty_intersection;
      }
      bounded = true;
      found.take(trial, Scalar(q / (Scalar(1) + q)));
      if (!(trial.level > Scalar(0))) {  // the sets touch in one point
        return Status::ok;
      }
      const auto [slope, curvature] = size.derivatives_in_log(trial, q);
      (slope > Scalar(0) ? bracket.high : bracket.low) = log_q;
      move = scalar::isfinite(bracket.high) ? newton_move(slope, curvature, longest)
                                            : newton_move_upward(slope, curvature, longest);
      if (scalar::abs(slope) <= rounding::share<Scalar>(rounding::slope * N) ||
          scalar::abs(move) <= rounding::root<Scalar>()) {
        return Status::ok;
      }
      is_last = is_last_move(slope, move);
      if (move < scalar::constant<Scalar>(-0.5L) && !first_set_tried) {
        first_set_tried = true;
        if (first_set_is_best(problem, size, trial, found)) {
          return Status::ok;
        }
      }
    }
    log_q = bracket.inside(Scalar(log_q + move));
    if (bounded && (is_last || bracket.is_narrow())) {
      break;
    }
  }
  if (bounded) {
    take_bound(problem, Scalar(start * scalar::exp(log_q)), trial, found);
  }
  return bounded ? Status::ok : Status::not_converged;
}

/// The ellipsoid {N A⁻¹} of a combination, where x = origin + factor u. `origin` may be its center.
template <typename Scalar, int N>
ELLIPTUDE_OUT_OF_LINE void put_set(const Vector<Scalar, N>& origin, const Matrix<Scalar, N>& factor,
                                   const KeptCombination<Scalar, N>& best, Ellipsoid<Scalar, N>& set) noexcept {
  const Matrix<Scalar, N> half = factor.lazyProduct(best.root.transpose());
  set.shape.noalias() = best.level * half.lazyProduct(half.transpose());
  set.center = origin + factor.lazyProduct(best.center);
}

/// The smallest ellipsoid of the family {N(q) A(q)⁻¹} about the intersection of the quadric with the ball u, where
/// x = origin + factor u; or the second set alone, with `share` 1, where that is smallest: `set` has then not changed.
/// \param start a q to search from, such as `problem.typical_weight()`.
/// \param set may be where `origin` is.
/// \param best the combination that it is, unless `share` is 1; it changes without success too.
/// \return as `least_combination`.
template <typename Scalar, int N, typename Slack>
[[nodiscard]] Status minimal_intersection(const Vector<Scalar, N>& origin, const Matrix<Scalar, N>& factor,
                                          const Problem<Scalar, N, Slack>& problem, const RelativeSize<Scalar, N>& size,
                                          const Scalar& start, Ellipsoid<Scalar, N>& set, Scalar& share,
                                          KeptCombination<Scalar, N>& best) noexcept {
  const auto second_set_alone = [&]() {
    share = Scalar(1);
    return Status::ok;
  };
  const Scalar slack_at_origin = problem.slack(Vector<Scalar, N>::Zero());
  if (!scalar::isfinite(start) || !scalar::isfinite(slack_at_origin)) {
    return Status::beyond_domain;  // the input is finite, but the sets differ too much in size
  }
  if (!(start > Scalar(0))) {  // the quadric says nothing, or that nothing is possible
    return slack_at_origin >= Scalar(0) ? second_set_alone() : Status::empty_intersection;
  }
  Found<Scalar, N> found{best, Scalar(0), slack_at_origin >= Scalar(0)};
  const bool idle = slack_at_origin >= size.idle_slack(problem.m);
  if (!idle) {
    if (const Status status = least_combination(problem, size, start, found); status != Status::ok) {
      return status;
    }
  }
  if (!found.common_point && provably_empty(problem, start)) {
    return Status::empty_intersection;
  }
  if (idle || found.share == Scalar(1) || (best.level > Scalar(0) && !size.is_below_second(best))) {
    return second_set_alone();
  }
  put_set(origin, factor, best, set);
  share = found.share;
  return Status::ok;
}

}  // namespace elliptude::detail
