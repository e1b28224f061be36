#pragma once

/// \file
/// Guaranteed fusion: a small ellipsoid about everything that satisfies a predicted ellipsoid and any number of quadrics at once
/// (theory, section 16).

#include "elliptude/sets/detail/multiplier_search.hpp"
#include "elliptude/sets/detail/quadric_coordinates.hpp"

namespace elliptude {

/// An ellipsoid about an intersection, and how it came about.
template <typename Scalar, int N>
struct QuadricFusion {
  /// What `contradiction` is if no quadric is violated, and where there is none; of a quadric it is the index.
  static constexpr std::size_t predicted = most_quadrics;
  static constexpr std::size_t none = most_quadrics + 1;

  Ellipsoid<Scalar, N> set;
  std::array<Scalar, most_quadrics> multipliers;  ///< μ of the quadrics as given, with Σμ = 1 over all constraints
  Scalar predicted_multiplier;                    ///< of (y − ŷ)ᵀP⁻¹(y − ŷ) ≤ 1
  /// The least N(μ) with Σμ = 1 that was met. No state satisfies all constraints with more slack than this; negative, it proves
  /// that none satisfies them. Ellipsoids and cones have a slack of at most about 1.
  Scalar margin;
  bool prediction_alone;      ///< whether no quadric makes the predicted ellipsoid smaller: `set` is the input
  std::size_t contradiction;  ///< after `empty_intersection`: which quadric weighs most against the rest at the proof
};

namespace detail {

/// Whether the first set is smaller than the second, by the criterion.
template <typename Scalar, int N>
[[nodiscard]] bool is_smaller_set(const Ellipsoid<Scalar, N>& first, const Ellipsoid<Scalar, N>& second,
                                  const SizeCriterion<Scalar, N>& criterion) noexcept {
  if (criterion.kind != SizeCriterion<Scalar, N>::Kind::volume) {
    return criterion.weight.cwiseProduct(first.shape).sum() < criterion.weight.cwiseProduct(second.shape).sum();
  }
  Matrix<Scalar, N> l1;
  Matrix<Scalar, N> l2;
  if (cholesky(first.shape, l1) != Status::ok || cholesky(second.shape, l2) != Status::ok) {
    return false;
  }
  return l1.diagonal().prod() < l2.diagonal().prod();
}

/// `minimal_intersection` of at most `most_quadrics` quadrics that are known to be symmetric, with a valid criterion; that all is
/// finite, and the prediction, are tested here.
template <typename Scalar, int N, typename Given>
[[nodiscard]] Status fuse(const Ellipsoid<Scalar, N>* predicted, const Given* quadrics, std::size_t count,
                          const SizeCriterion<Scalar, N>& criterion, QuadricFusion<Scalar, N>& result) noexcept {
  using Problem = ManyQuadrics<Scalar, N>;
  using Fusion = QuadricFusion<Scalar, N>;
  const Scalar epsilon(scalar::epsilon<Scalar>);
  Problem problem;
  problem.with_ball = predicted != nullptr;
  problem.by_volume = criterion.kind == SizeCriterion<Scalar, N>::Kind::volume;
  const std::size_t first = problem.with_ball ? 1 : 0;
  problem.count = count + first;

  // y = shift + factor u: the predicted ellipsoid is in the unit ball of u; without one each coordinate has a scale in which
  // the quadrics' diagonals are of the size of their slack.
  Coordinates<Scalar, N> at;
  at.shift.setZero();
  at.reach.setZero();
  at.factor.setZero();
  at.in_ball = problem.with_ball;
  if (problem.with_ball) {
    if (!scalar::all_finite(predicted->center) || !scalar::all_finite(predicted->shape)) {
      return Status::not_finite;
    }
    if (!is_symmetric(predicted->shape)) {
      return Status::not_symmetric;
    }
    // Raised by more than the factorization loses, so that factor factorᵀ ⪰ P.
    Matrix<Scalar, N> raised = predicted->shape;
    raised.diagonal() *= Scalar(1) + Scalar(2 * N * (N + 1)) * epsilon;
    if (const Status status = cholesky(raised, at.factor); status != Status::ok) {
      return status;
    }
    at.shift = predicted->center;
    at.reach = at.shift.cwiseAbs() + raised.diagonal().cwiseSqrt();
  } else if (const Status status = scale_by_slack(quadrics, count, at.factor); status != Status::ok) {
    return status;
  }
  if (!problem.by_volume) {
    problem.weight.noalias() =
        at.factor.transpose().lazyProduct(Matrix<Scalar, N>(criterion.weight.lazyProduct(at.factor)));
    problem.weight *= Scalar(N) / problem.weight.trace();
  }

  typename Problem::Multipliers scale;
  if (problem.with_ball) {
    problem.constraints[0].rank = N;
    problem.constraints[0].leading = false;
    problem.constraints[0].quadric = {Matrix<Scalar, N>::Identity(), Vector<Scalar, N>::Zero(), Scalar(1)};
    scale[0] = Scalar(1);
  }
  const Scalar rounding = Scalar(4 * (N + 4) + 2 * static_cast<int>(count)) * epsilon;
  bool idle = problem.with_ball;
  bool finite = true;
  for (std::size_t k = first; k < problem.count; ++k) {
    Constraint<Scalar, N>& constraint = problem.constraints[k];
    relax(quadrics[k - first], at, rounding, constraint);
    const Scalar trace = problem.weighted_trace(k);
    constraint.with([&](auto& q) {
      // At μ = (N, 0, ...) F grows with every multiplier if sₖ(0) ≥ tr(W Aₖ)/tr W.
      idle = idle && q.c * Scalar(N) >= trace;
      scale[k] = slack_scale(q);
      const Scalar inverse = Scalar(1) / scale[k];
      q.a *= inverse;
      q.g *= inverse;
      q.c *= inverse;
      finite = finite && scalar::all_finite(q.a) && scalar::all_finite(q.g) && scalar::isfinite(q.c);
    });
  }
  if (!finite) {
    // An input that is not; or one too sharp, too weak or too far away to be scaled to the prediction.
    for (std::size_t k = 0; k < count; ++k) {
      if (elliptude::validate(quadrics[k]) == Status::not_finite) {
        return Status::not_finite;
      }
    }
    return Status::out_of_range;
  }
  const auto prediction_alone = [&](const Scalar& margin) {
    result.set = *predicted;
    result.multipliers.fill(Scalar(0));
    result.predicted_multiplier = Scalar(1);
    result.margin = margin;
    result.prediction_alone = true;
    result.contradiction = Fusion::none;
    return Status::ok;
  };
  if (idle) {
    return prediction_alone(Scalar(1));
  }

  typename Problem::Multipliers multipliers = starting_multipliers(problem);
  std::array<typename Problem::Iterate, 2> iterates;
  if (const Status status = find_bounded(problem, multipliers, iterates[0]); status != Status::ok) {
    return status;
  }
  const typename Problem::Iterate* found = nullptr;
  Scalar margin;
  const Status status = minimize(problem, scale, iterates, found, margin);
  const typename Problem::Iterate& best = *found;
  if (status == Status::empty_intersection) {
    // The prediction contradicts as much as what it contradicts: who asks wants to know which measurement that is.
    Scalar worst(0);
    result.contradiction = problem.with_ball ? Fusion::predicted : Fusion::none;
    for (std::size_t k = 0; k < count; ++k) {
      const Scalar violation = -best.multipliers[k + first] * best.slack[k + first];
      if (violation > worst) {
        worst = violation;
        result.contradiction = k;
      }
    }
    result.margin = margin;
    return status;
  }

  // P = N A⁻¹ in y, its diagonal raised by what the products may have lost.
  const Scalar level = (best.level > Scalar(0) ? best.level : Scalar(0)) + best.rounding;
  const Matrix<Scalar, N> half = scalar::sqrt(level) * at.factor.lazyProduct(best.root.transpose());
  Ellipsoid<Scalar, N> set;
  set.shape.noalias() = half.lazyProduct(half.transpose());
  set.center = at.shift + at.factor.lazyProduct(best.center);
  const Scalar spread = scalar::sqrt(Scalar(level * best.inverse.trace()));
  Scalar loss(0);
  for (int i = 0; i < N; ++i) {
    const Scalar lost = (spread * at.factor.row(i).norm() + scalar::abs(at.shift(i)) + scalar::abs(set.center(i))) /
                        scalar::sqrt(Scalar(set.shape(i, i)));
    loss = lost > loss ? lost : loss;
  }
  set.shape.diagonal() *= Scalar(1) + Scalar(4 * N * N) * epsilon * (Scalar(1) + loss);
  if (!scalar::all_finite(set.center) || !scalar::all_finite(set.shape)) {
    return problem.with_ball ? prediction_alone(margin) : Status::not_finite;
  }
  if (problem.with_ball && !is_smaller_set(set, *predicted, criterion)) {
    return prediction_alone(margin);
  }
  const auto as_given = [&](std::size_t k) { return Scalar(best.multipliers[k] / scale[k]); };
  Scalar sum(0);
  for (std::size_t k = 0; k < problem.count; ++k) {
    sum += as_given(k);
  }
  result.set = set;
  result.multipliers.fill(Scalar(0));
  result.predicted_multiplier = problem.with_ball ? Scalar(as_given(0) / sum) : Scalar(0);
  for (std::size_t k = 0; k < count; ++k) {
    result.multipliers[k] = as_given(k + first) / sum;
  }
  result.margin = margin;
  result.prediction_alone = false;
  result.contradiction = Fusion::none;
  return Status::ok;
}

/// What is asked of the input of `minimal_intersection`, but of the prediction.
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

/// A small ellipsoid that contains all that satisfies a predicted ellipsoid and `count` quadrics: the smallest of the family
/// E(−A⁻¹g, N A⁻¹), A = ΣμₖAₖ ≻ 0, g = Σμₖgₖ, c = Σμₖcₖ, N = c + gᵀA⁻¹g, over μ ≥ 0, never larger than the prediction, which is
/// returned unchanged where nothing helps. A bounded number of steps, each a valid bound; rounding is on the safe side: a
/// quadric more than about 1e7 times sharper than the prediction is used as if it were 1e7 times sharper. (theory, section 16)
/// \param predicted positive definite; or null, and then the quadrics must bound a set by themselves.
/// \return what `validate` says; `out_of_range` for more than `most_quadrics`, and for one that cannot be scaled to a slack of one
/// within floating point (entries of about 1e-308, or 1e308 in the widths of the prediction); `not_positive_definite` of a flat one;
/// `unbounded` if no A ≻ 0 was found; `empty_intersection` with N < 0 and A ≻ 0 as proof, after which `margin` and
/// `contradiction` are set, and nothing else.
template <typename Scalar, int N>
[[nodiscard]] Status minimal_intersection(const Ellipsoid<Scalar, N>* predicted, const Quadric<Scalar, N>* quadrics,
                                          std::size_t count, const SizeCriterion<Scalar, N>& criterion,
                                          QuadricFusion<Scalar, N>& result) noexcept {
  const Status status = detail::validate(quadrics, count, criterion);
  return status == Status::ok ? detail::fuse(predicted, quadrics, count, criterion, result) : status;
}

/// The same of quadrics of either half, faster than `extended` ones.
template <typename Scalar>
[[nodiscard]] Status minimal_intersection(const Ellipsoid<Scalar, 6>* predicted, const HalfQuadric<Scalar>* quadrics,
                                          std::size_t count, const SizeCriterion<Scalar, 6>& criterion,
                                          QuadricFusion<Scalar, 6>& result) noexcept {
  const Status status = detail::validate(quadrics, count, criterion);
  return status == Status::ok ? detail::fuse(predicted, quadrics, count, criterion, result) : status;
}

}  // namespace elliptude
