#pragma once

/// \file
/// Guaranteed fusion: a small ellipsoid about everything that satisfies a predicted ellipsoid and any number of
/// quadrics at once (theory, section 16.5).

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/detail/multiplier_search.hpp"
#include "elliptude/sets/detail/quadric_coordinates.hpp"
#include "elliptude/sets/detail/starting_multipliers.hpp"

namespace elliptude {

/// An ellipsoid about an intersection, with the multipliers that give it.
template <typename Scalar, int N>
struct QuadricFusion {
  /// The value of `contradiction` if no quadric is violated, or without a contradiction; else it is a quadric's index.
  static constexpr std::size_t predicted = most_quadrics;
  static constexpr std::size_t none = most_quadrics + 1;

  Ellipsoid<Scalar, N> set;
  std::array<Scalar, most_quadrics> multipliers;  ///< μ of the quadrics as given, with Σμ = 1 over all constraints
  Scalar predicted_multiplier;                    ///< of (y − ŷ)ᵀP⁻¹(y − ŷ) ≤ 1
  /// The least N(μ) with Σμ = 1 on the way. No state satisfies all constraints with more slack than this; if negative,
  /// it proves that none satisfies them. Ellipsoids, and cones near the center, have one of at most 1 or so.
  Scalar margin;
  bool prediction_alone;      ///< whether no quadric makes the predicted ellipsoid smaller: `set` is the input
  std::size_t contradiction;  ///< after `empty_intersection`: which quadric weighs most against the rest at the proof
  int steps = 0;              ///< of the search for the multipliers
  /// Whether the search ended because it had taken as many steps as it may: the set holds, and may be larger than it
  /// need be.
  bool ended_by_limit = false;
};

namespace detail {

/// Whether the first set is smaller than the second, by the criterion.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool is_smaller_set(const Ellipsoid<Scalar, N>& first,
                                                        const Ellipsoid<Scalar, N>& second,
                                                        const SizeCriterion<Scalar, N>& criterion) noexcept {
  if (!criterion.by_volume()) {
    return criterion.weight.cwiseProduct(first.shape).sum() < criterion.weight.cwiseProduct(second.shape).sum();
  }
  Matrix<Scalar, N> l1;
  Matrix<Scalar, N> l2;
  if (put_cholesky(first.shape, l1) != Status::ok || put_cholesky(second.shape, l2) != Status::ok) {
    return false;
  }
  return l1.diagonal().prod() < l2.diagonal().prod();
}

/// Constraints in the coordinates of the search, divided by a scale each.
template <typename Scalar, int N>
struct Gathered {
  ManyQuadrics<Scalar, N> problem;
  typename ManyQuadrics<Scalar, N>::Multipliers scale;
  bool idle;    ///< whether no quadric makes the prediction smaller
  bool finite;  ///< whether all could be scaled
};

template <typename Scalar, int N, typename Given>
ELLIPTUDE_OUT_OF_LINE void gather(const Given* quadrics, std::size_t count, const SizeCriterion<Scalar, N>& criterion,
                                  const Coordinates<Scalar, N>& at, Gathered<Scalar, N>& gathered) noexcept {
  ManyQuadrics<Scalar, N>& problem = gathered.problem;
  problem.with_ball = at.in_ball;
  problem.volume = criterion.by_volume();
  const std::size_t first = problem.with_ball ? 1 : 0;
  problem.count = count + first;
  if (!problem.by_volume()) {
    problem.weight.noalias() =
        at.factor.transpose().lazyProduct(Matrix<Scalar, N>(criterion.weight.lazyProduct(at.factor)));
    problem.weight *= Scalar(N) / problem.weight.trace();
  }
  if (problem.with_ball) {
    problem.constraints[0].constrain_all(
        N, [] { return Quadric<Scalar, N>{Matrix<Scalar, N>::Identity(), Vector<Scalar, N>::Zero(), Scalar(1)}; });
    gathered.scale[0] = Scalar(1);
  }
  const Scalar rounding = rounding::share<Scalar>(rounding::relaxation(N, static_cast<int>(count)));
  bool idle = problem.with_ball;
  bool finite = true;
  for (std::size_t k = first; k < problem.count; ++k) {
    Constraint<Scalar, N>& constraint = problem.constraints[k];
    relax(quadrics[k - first], at, rounding, constraint);
    const Scalar trace = problem.weighted_trace(k);
    constraint.with([&](auto& q) {
      // At μ = (N, 0, ...) F grows with every multiplier if sₖ(0) ≥ tr(W Aₖ)/tr W.
      idle = idle && q.c * Scalar(N) >= trace;
      gathered.scale[k] = slack_scale(q);
      const Scalar inverse = Scalar(1) / gathered.scale[k];
      q.a *= inverse;
      q.g *= inverse;
      q.c *= inverse;
      finite = finite && scalar::all_finite(q.a) && scalar::all_finite(q.g) && scalar::isfinite(q.c);
    });
  }
  gathered.idle = idle;
  gathered.finite = finite;
}

/// P = N A⁻¹ in y, its diagonal raised by what the products may have lost.
template <typename Scalar, int N>
[[nodiscard]] Ellipsoid<Scalar, N> set_of(const typename ManyQuadrics<Scalar, N>::Iterate& best,
                                          const Coordinates<Scalar, N>& at) noexcept {
  const Scalar level = (best.level > Scalar(0) ? best.level : Scalar(0)) + best.rounding;
  const Matrix<Scalar, N> half = scalar::sqrt(level) * at.factor.lazyProduct(best.root.transpose());
  Ellipsoid<Scalar, N> set;
  set.shape.noalias() = half.lazyProduct(half.transpose());
  set.center = at.shift + at.factor.lazyProduct(best.center);
  const Scalar spread = scalar::sqrt(Scalar(level * best.inverse.trace()));
  const Vector<Scalar, N> terms = at.factor.cwiseAbs().lazyProduct(best.center.cwiseAbs());  // of the center
  Scalar loss(0);
  for (int i = 0; i < N; ++i) {
    const Scalar lost = (spread * at.factor.row(i).norm() + terms(i) + scalar::abs(at.shift(i))) /
                        scalar::sqrt(Scalar(set.shape(i, i)));
    loss = lost > loss ? lost : loss;
  }
  set.shape.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::root_product(N)) * (Scalar(1) + loss);
  return set;
}

/// Which quadric weighs most against the rest. The prediction contradicts as much as what it contradicts, but what a
/// caller wants to know is the measurement.
template <typename Scalar, int N>
[[nodiscard]] std::size_t contradiction_of(const ManyQuadrics<Scalar, N>& problem,
                                           const typename ManyQuadrics<Scalar, N>::Iterate& best) noexcept {
  using Fusion = QuadricFusion<Scalar, N>;
  const std::size_t first = problem.with_ball ? 1 : 0;
  Scalar worst(0);
  std::size_t contradiction = problem.with_ball ? Fusion::predicted : Fusion::none;
  for (std::size_t k = 0; k + first < problem.count; ++k) {
    const Scalar violation = -best.multipliers[k + first] * best.slack[k + first];
    if (violation > worst) {
      worst = violation;
      contradiction = k;
    }
  }
  return contradiction;
}

/// The prediction itself, where nothing makes it smaller.
template <typename Scalar, int N>
void report_prediction(const Ellipsoid<Scalar, N>& predicted, const Scalar& margin,
                       QuadricFusion<Scalar, N>& result) noexcept {
  result.set = predicted;
  result.multipliers.fill(Scalar(0));
  result.predicted_multiplier = Scalar(1);
  result.margin = margin;
  result.prediction_alone = true;
  result.contradiction = QuadricFusion<Scalar, N>::none;
}

template <typename Scalar, int N>
void report_set(const Ellipsoid<Scalar, N>& set, const Gathered<Scalar, N>& gathered,
                const typename ManyQuadrics<Scalar, N>::Iterate& best, const Scalar& margin,
                QuadricFusion<Scalar, N>& result) noexcept {
  const std::size_t first = gathered.problem.with_ball ? 1 : 0;
  const auto as_given = [&](std::size_t k) { return Scalar(best.multipliers[k] / gathered.scale[k]); };
  Scalar sum(0);
  for (std::size_t k = 0; k < gathered.problem.count; ++k) {
    sum += as_given(k);
  }
  result.set = set;
  result.multipliers.fill(Scalar(0));
  result.predicted_multiplier = first == 1 ? Scalar(as_given(0) / sum) : Scalar(0);
  for (std::size_t k = 0; k + first < gathered.problem.count; ++k) {
    result.multipliers[k] = as_given(k + first) / sum;
  }
  result.margin = margin;
  result.prediction_alone = false;
  result.contradiction = QuadricFusion<Scalar, N>::none;
}

/// The set of the best multipliers, or the prediction where that is smaller, or where the set's widths cannot be
/// represented.
/// \return without a prediction: `not_finite`, and `beyond_domain` of a width.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status report_best(const Gathered<Scalar, N>& gathered,
                                                       const typename ManyQuadrics<Scalar, N>::Iterate& best,
                                                       const Scalar& margin, const Ellipsoid<Scalar, N>* predicted,
                                                       const Coordinates<Scalar, N>& at,
                                                       const SizeCriterion<Scalar, N>& criterion,
                                                       QuadricFusion<Scalar, N>& result) noexcept {
  const Ellipsoid<Scalar, N> set = set_of(best, at);
  const bool is_finite = scalar::all_finite(set.center) && scalar::all_finite(set.shape);
  const bool is_set = is_finite && is_in_domain(set.shape) && set.shape.diagonal().minCoeff() > Scalar(0);
  if (predicted == nullptr && !is_set) {
    return is_finite ? Status::beyond_domain : Status::not_finite;
  }
  if (predicted != nullptr && !(is_set && is_smaller_set(set, *predicted, criterion))) {
    report_prediction(*predicted, margin, result);
  } else {
    report_set(set, gathered, best, margin, result);
  }
  return Status::ok;
}

/// The search for the multipliers, and what it found.
/// \param predicted what the coordinates are of; or null.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status fuse_gathered(const Gathered<Scalar, N>& gathered,
                                                         const Ellipsoid<Scalar, N>* predicted,
                                                         const Coordinates<Scalar, N>& at,
                                                         const SizeCriterion<Scalar, N>& criterion,
                                                         QuadricFusion<Scalar, N>& result) noexcept {
  using Problem = ManyQuadrics<Scalar, N>;
  typename Problem::Multipliers multipliers = starting_multipliers(gathered.problem);
  std::array<typename Problem::Iterate, 2> iterates;
  if (const Status status = find_bounded(gathered.problem, multipliers, iterates[0]); status != Status::ok) {
    return status;
  }
  MultiplierSearch<Scalar, N> search(gathered.problem, gathered.scale, iterates);
  const auto report_steps = [&] {
    result.steps = search.steps();
    result.ended_by_limit = search.ended_by_limit();
  };
  if (const Status status = search.run(); status == Status::empty_intersection) {
    report_steps();
    result.contradiction = contradiction_of(gathered.problem, search.best());
    // Below zero, also where the quotient is too small for a number.
    const Scalar least(-std::numeric_limits<scalar::Value<Scalar>>::min());
    result.margin = search.margin() < least ? search.margin() : least;
    return status;
  }
  const Status status = report_best(gathered, search.best(), search.margin(), predicted, at, criterion, result);
  if (status == Status::ok) {
    report_steps();
  }
  return status;
}

/// `minimal_intersection` of at most `most_quadrics` symmetric quadrics with a valid criterion. It checks the
/// prediction, and that all numbers are finite.
template <typename Scalar, int N, typename Given>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status fuse(const Ellipsoid<Scalar, N>* predicted, const Given* quadrics,
                                                std::size_t count, const SizeCriterion<Scalar, N>& criterion,
                                                QuadricFusion<Scalar, N>& result) noexcept {
  Coordinates<Scalar, N> at;
  if (const Status status =
          predicted != nullptr ? coordinates_of(*predicted, at) : coordinates_without_prediction(quadrics, count, at);
      status != Status::ok) {
    return status;
  }
  Gathered<Scalar, N> gathered;
  gather(quadrics, count, criterion, at, gathered);
  if (!gathered.finite) {
    // An input that is not finite; or one too sharp, too weak or too far away to be scaled to the prediction.
    for (std::size_t k = 0; k < count; ++k) {
      if (elliptude::validate(quadrics[k]) == Status::not_finite) {
        return Status::not_finite;
      }
    }
    return Status::out_of_range;
  }
  if (gathered.idle) {
    result.steps = 0;
    result.ended_by_limit = false;
    report_prediction(*predicted, Scalar(1), result);
    return Status::ok;
  }
  return fuse_gathered(gathered, predicted, at, criterion, result);
}

/// Checks the input of `minimal_intersection`, except the prediction.
template <typename Scalar, int N, typename Given>
[[nodiscard]] Status validate(const Given* quadrics, std::size_t count,
                              const SizeCriterion<Scalar, N>& criterion) noexcept {
  if (count > most_quadrics) {
    return Status::out_of_range;
  }
  if (const Status status = elliptude::validate(criterion); status != Status::ok) {
    return status;
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (const Status status = elliptude::validate(quadrics[k]); status != Status::ok) {
      return status;
    }
  }
  return Status::ok;
}

}  // namespace detail

/// A small ellipsoid that contains every point in a predicted ellipsoid and in `count` quadrics: the smallest of the
/// family E(−A⁻¹g, N A⁻¹), A = ΣμₖAₖ ≻ 0, g = Σμₖgₖ, c = Σμₖcₖ, N = c + gᵀA⁻¹g, over μ ≥ 0, never larger than the
/// prediction, which is returned unchanged if nothing helps. A bounded number of steps, each a valid bound; rounding is
/// on the safe side: a quadric more than about 1e7 times sharper than the prediction is used as if it were 1e7 times
/// sharper. (theory, section 16.5)
/// \param predicted positive definite; or null, and then the quadrics must bound a set by themselves.
/// \return the status of `validate`; `out_of_range` for more than `most_quadrics`, and for one that cannot be scaled to
/// a slack of one within floating point (entries of about 1e-308, or 1e308 in the widths of the prediction);
/// `not_positive_definite` of a flat one; `unbounded` if no A ≻ 0 was found; `beyond_domain` of what quadrics alone
/// leave; `empty_intersection` with N < 0 and A ≻ 0 as proof, after which `margin`, `contradiction`, `steps` and
/// `ended_by_limit` are set, and nothing else.
template <typename Scalar, int N>
[[nodiscard]] Status minimal_intersection(const Ellipsoid<Scalar, N>* predicted, const Quadric<Scalar, N>* quadrics,
                                          std::size_t count, const SizeCriterion<Scalar, N>& criterion,
                                          QuadricFusion<Scalar, N>& result) noexcept {
  const Status status = detail::validate(quadrics, count, criterion);
  return status == Status::ok ? detail::fuse(predicted, quadrics, count, criterion, result) : status;
}

/// The same for quadrics of either half, faster than with `extended` ones.
template <typename Scalar>
[[nodiscard]] Status minimal_intersection(const Ellipsoid<Scalar, 6>* predicted, const HalfQuadric<Scalar>* quadrics,
                                          std::size_t count, const SizeCriterion<Scalar, 6>& criterion,
                                          QuadricFusion<Scalar, 6>& result) noexcept {
  const Status status = detail::validate(quadrics, count, criterion);
  return status == Status::ok ? detail::fuse(predicted, quadrics, count, criterion, result) : status;
}

}  // namespace elliptude
