#pragma once

/// \file
/// `fuse` of many predictions with as many measured sets, lane by lane where all is as usual; see lanewise_sets.hpp.

#include "elliptude/first_order/detail/lanewise_sets.hpp"
#include "elliptude/first_order/fusion.hpp"
#include "elliptude/sets/detail/reduced_search.hpp"

namespace elliptude::detail::lanewise {

/// `Problem::combine` where all coordinates exist. \return where A ≻ 0 and the level needs no better center.
template <typename Scalar, int N, typename Slack>
[[nodiscard]] Truth<Scalar> combine(const Problem<Scalar, N, Slack>& problem, const Scalar& q,
                                    Combination<Scalar, N>& result) noexcept {
  Matrix<Scalar, N> a = problem.m;
  for (int i = 0; i < N; ++i) {
    a(i, i) += q;
  }
  Matrix<Scalar, N> l;
  const Truth<Scalar> definite = lanewise::cholesky(a, l);
  result.root = lower_inverse(l);
  result.inverse = square_of_lower(result.root);
  result.center = -result.inverse.lazyProduct(problem.v);
  result.quadric_slack = problem.slack(result.center);
  result.ball_slack = Scalar(1) - result.center.squaredNorm();
  result.level = result.quadric_slack + q * result.ball_slack;
  return definite && result.level >= Scalar(0);
}

template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> is_common_point(const Combination<Scalar, N>& at) noexcept {
  return at.quadric_slack >= Scalar(0) && at.ball_slack >= Scalar(0);
}

template <typename Scalar>
[[nodiscard]] Scalar newton_move(const Scalar& slope, const Scalar& curvature, const Scalar& longest) noexcept {
  const Scalar downhill = scalar::select(slope > Scalar(0), Scalar(-longest), longest);
  const Scalar move = scalar::select(curvature > Scalar(0), Scalar(-slope / curvature), downhill);
  return scalar::select(move > longest, longest, scalar::select(move < -longest, Scalar(-longest), move));
}

/// `newton_move` where the bracket has an upper end, else `newton_move_upward`.
template <typename Scalar>
[[nodiscard]] Scalar move_in_bracket(const Scalar& slope, const Scalar& curvature, const Scalar& longest,
                                     const Scalar& high) noexcept {
  const Scalar newton = lanewise::newton_move<Scalar>(slope, curvature, longest);
  const Truth<Scalar> bracketed = high - high == Scalar(0);
  if (scalar::all(bracketed)) {
    return newton;
  }
  const Scalar left = curvature + Scalar(2) * slope;
  const Truth<Scalar> is_near = left > Scalar(0);
  const Scalar ratio = scalar::select(is_near, Scalar((curvature + slope) / left), Scalar(1));
  const Scalar wanted = scalar::select(is_near, scalar::log(ratio), longest);
  return scalar::select(bracketed, newton, scalar::select(wanted < longest, wanted, longest));
}

/// What a search has found: as `Found`, and where the search was as usual.
template <typename Scalar, int N>
struct LanesFound {
  Combination<Scalar, N> combination;
  Scalar share;
  Truth<Scalar> common_point;
  Truth<Scalar> first_alone;  ///< where the first set alone is the best
  Truth<Scalar> usual;
};

/// Takes the first set alone in the lanes that `ask` where it is the best: `first_set_is_best`.
template <typename Scalar, int N, typename Slack>
void try_first_set(const Problem<Scalar, N, Slack>& problem, const RelativeSize<Scalar, N>& size,
                   const Truth<Scalar>& ask, LanesFound<Scalar, N>& found) noexcept {
  Combination<Scalar, N> trial;
  const Truth<Scalar> bounded = combine(problem, Scalar(0), trial);
  Scalar slope;
  Scalar curvature;
  size.derivatives(trial, slope, curvature);
  const Truth<Scalar> best = ask && bounded && !(slope < Scalar(0));
  // A negative level asks for a better center. The last test of `minimal_intersection`: only a set smaller than the
  // second is taken.
  found.usual = found.usual && (!ask || !(trial.level < Scalar(0))) &&
                (!best || (trial.level > Scalar(0) && size.is_below_second(trial)));
  found.common_point = found.common_point || (best && lanewise::is_common_point(trial));
  found.first_alone = found.first_alone || best;
}

/// `least_combination`. What has settled stays where it is, and its combination is calculated again with the others'.
/// \param idle lanes that need none.
template <typename Scalar, int N, typename Slack>
void least_combination(const Problem<Scalar, N, Slack>& problem, const RelativeSize<Scalar, N>& size,
                       const Scalar& start, const Truth<Scalar>& idle, LanesFound<Scalar, N>& found) noexcept {
  const Scalar longest(4);
  constexpr int most_steps = 60;
  Scalar low(-std::numeric_limits<scalar::Value<Scalar>>::infinity());
  Scalar high(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  Scalar log_q(0);  // less that of the start
  Scalar q;
  Truth<Scalar> settled = idle || !found.usual;
  Truth<Scalar> tried = settled;
  for (int step = 0; step <= most_steps; ++step) {
    q = step == 0 ? start : Scalar(start * scalar::exp(log_q));
    const Truth<Scalar> bounded = combine(problem, q, found.combination) && found.combination.level > Scalar(0);
    const Truth<Scalar> skipped = idle || found.first_alone;
    found.usual = found.usual && (skipped || bounded);
    found.common_point = found.common_point || (!skipped && lanewise::is_common_point(found.combination));
    if (scalar::all(settled)) {
      break;
    }
    const auto [slope, curvature] = size.derivatives_in_log(found.combination, q);
    const Truth<Scalar> rising = slope > Scalar(0);
    high = scalar::select(rising, log_q, high);
    low = scalar::select(rising, low, log_q);
    settled = settled || !found.usual || scalar::abs(slope) <= rounding::share<Scalar>(rounding::slope * N);
    const Scalar move = move_in_bracket<Scalar>(slope, curvature, longest, high);
    settled = settled || scalar::abs(move) <= rounding::root<Scalar>();
    const Truth<Scalar> ask = move < scalar::constant<Scalar>(-0.5L) && !tried && !settled;
    if (!scalar::all(!ask)) {
      try_first_set(problem, size, ask, found);
      tried = tried || ask;
      settled = settled || found.first_alone;
    }
    if (scalar::all(settled)) {  // where they are
      break;
    }
    Scalar next = log_q + move;
    next = scalar::select(next > low && next < high, next, Scalar(scalar::constant<Scalar>(0.5L) * (low + high)));
    log_q = scalar::select(settled, log_q, next);
    settled = settled || is_last_move<Scalar>(slope, move) || high - low <= rounding::root<Scalar>();
  }
  found.usual = found.usual && settled;
  found.share = q / (Scalar(1) + q);
}

/// Where `Problem::is_ill_conditioned` says no.
template <typename Scalar, int N, typename Slack>
[[nodiscard]] Truth<Scalar> is_well_conditioned(const Problem<Scalar, N, Slack>& problem, const Scalar& share,
                                                const Combination<Scalar, N>& at) noexcept {
  const Scalar q = share / (Scalar(1) - share);
  const Scalar condition = (problem.m.trace() + Scalar(N) * q) * at.inverse.trace();
  return condition * condition * condition * rounding::one_rounding<Scalar>() <= Scalar(1);
}

/// What `minimal_intersection` gives, in coordinates.
template <typename Scalar, int N>
struct LanesIntersection {
  Vector<Scalar, N> center;
  Matrix<Scalar, N> shape;
  Scalar share;
  Truth<Scalar> first_alone;   ///< where the first set is to be taken as it is,
  Truth<Scalar> second_alone;  ///< where the second
};

/// `minimal_intersection` of a quadric and the ball of x = origin + l u.
/// \param valid lanes for which l and the problem are.
/// \return where the search was as usual, and found that the two have a common point.
template <typename Scalar, int N, typename Slack>
[[nodiscard]] Truth<Scalar> minimal_intersection(const Vector<Scalar, N>& origin, const Matrix<Scalar, N>& l,
                                                 const Problem<Scalar, N, Slack>& problem,
                                                 const RelativeSize<Scalar, N>& size, const Scalar& start,
                                                 const Truth<Scalar>& valid,
                                                 LanesIntersection<Scalar, N>& result) noexcept {
  const Scalar slack_at_origin = problem.slack(Vector<Scalar, N>::Zero());
  const Truth<Scalar> idle = slack_at_origin >= size.idle_slack(problem.m);
  LanesFound<Scalar, N> found;
  found.common_point = slack_at_origin >= Scalar(0);
  found.first_alone = !everywhere<Scalar>();
  found.usual = valid && start > Scalar(0) && start - start == Scalar(0);
  lanewise::least_combination(problem, size, start, idle, found);

  const Combination<Scalar, N>& best = found.combination;
  result.first_alone = found.first_alone;
  result.second_alone = idle || (!found.first_alone && (!size.is_below_second(best) || found.share == Scalar(1)));
  result.share =
      scalar::select(result.second_alone, Scalar(1), scalar::select(found.first_alone, Scalar(0), found.share));
  const Matrix<Scalar, N> half = l.lazyProduct(best.root.transpose());
  result.shape.noalias() = best.level * half.lazyProduct(half.transpose());
  result.center = origin + l.lazyProduct(best.center);
  return found.usual && found.common_point &&
         (result.second_alone || found.first_alone || is_well_conditioned(problem, found.share, best));
}

/// Where `validate_combined` accepts a set of full dimension.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> is_valid_combined(const Vector<Scalar, N>& center,
                                              const Matrix<Scalar, N>& shape) noexcept {
  Matrix<Scalar, N> lowered = shape;
  lowered.diagonal() *= Scalar(1) - rounding::share<Scalar>(rounding::cholesky(N));
  Matrix<Scalar, N> factor;
  return finite(center) && finite(shape) && in_domain(shape) && lanewise::cholesky(lowered, factor);
}

/// `minimal_intersection` of ellipsoids about zero and about another center, with factors that `cholesky` and
/// `definite_cholesky` found. Where the second set is to be taken as it is, there is no other.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> minimal_intersection(const Matrix<Scalar, N>& first, const Matrix<Scalar, N>& l1,
                                                 const Vector<Scalar, N>& center, const Matrix<Scalar, N>& l2,
                                                 const SizeCriterion<Scalar, N>& criterion, const Truth<Scalar>& valid,
                                                 LanesIntersection<Scalar, N>& result) noexcept {
  const Vector<Scalar, N> present = Vector<Scalar, N>::Ones();
  const Vector<Scalar, N> w = solve_lower(l1, center);
  const Matrix<Scalar, N> b = solve_lower(l1, l2);
  const Matrix<Scalar, N> m = square_of_lower(b);
  const Vector<Scalar, N> v = b.transpose().lazyProduct(w);
  const auto slack = [&](const Vector<Scalar, N>& u) noexcept -> Scalar {
    return Scalar(1) - Vector<Scalar, N>(w + b.lazyProduct(u)).squaredNorm();
  };
  const Problem<Scalar, N, decltype(slack)> problem{m, v, present, slack};
  const RelativeSize<Scalar, N> size(l2, present, criterion);
  const Scalar start = start_of_search(problem, size, problem.typical_weight());
  const Truth<Scalar> usual = lanewise::minimal_intersection(center, l2, problem, size, start, valid, result);
  const Truth<Scalar> valid_set =
      result.second_alone || result.first_alone || is_valid_combined(result.center, result.shape);
  result.shape = select(result.first_alone, first, result.shape);
  result.center = select(result.first_alone, Vector<Scalar, N>(Vector<Scalar, N>::Zero()), result.center);
  return usual && valid_set;
}

/// `a` in the lanes of the mask, else `b`.
template <typename State>
[[nodiscard]] StateEllipsoid<State> select(const Truth<StateScalar<State>>& mask, const StateEllipsoid<State>& a,
                                           const StateEllipsoid<State>& b) noexcept {
  return {
      {select(mask, a.center.attitude, b.center.attitude), select(mask, vector_part(a.center), vector_part(b.center))},
      select(mask, a.shape, b.shape)};
}

/// diag(G, I) P diag(G, I)ᵀ, where rounding leaves it definite: `with_attitude_transformed`.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> with_attitude_transformed(const Matrix3<Scalar>& g,
                                                        const Matrix6<Scalar>& shape) noexcept {
  Matrix6<Scalar> transform = Matrix6<Scalar>::Identity();
  transform.template topLeftCorner<3, 3>() = g;
  return symmetric_congruence(transform, shape);
}

/// `recentred`, where rounding leaves the shape definite.
template <typename State>
[[nodiscard]] StateEllipsoid<State> recentred(const State& center, const Vector6<StateScalar<State>>& x,
                                              const Matrix6<StateScalar<State>>& shape,
                                              Recentring recentring) noexcept {
  using Scalar = StateScalar<State>;
  if (recentring == Recentring::shifted) {
    return {retract(center, x), shape};
  }
  return {retract(center, x), lanewise::with_attitude_transformed(
                                  ExponentialChart::moved_to(Vector3<Scalar>(x.template head<3>())), shape)};
}

/// Where `is_kept` accepts a set that is definite.
template <typename State>
[[nodiscard]] Truth<StateScalar<State>> is_kept(const StateEllipsoid<State>& set) noexcept {
  Matrix6<StateScalar<State>> factor;
  return finite(set.shape) && in_domain(set.shape) && lanewise::cholesky(set.shape, factor);
}

/// `fuse` of measured sets with predictions.
/// \param criterion one that `validate` accepts.
/// \return where all was as usual and the sets meet.
template <typename State>
[[nodiscard]] Truth<StateScalar<State>> fuse(const StateEllipsoid<State>& measured,
                                             const StateEllipsoid<State>& predicted, Recentring recentring,
                                             const SizeCriterion<StateScalar<State>, 6>& criterion,
                                             Fusion<State>& fusion) noexcept {
  using Scalar = StateScalar<State>;
  const Vector6<Scalar> center = state_error(measured.center, predicted.center);
  const bool is_first_order = recentring == Recentring::first_order;
  const Matrix6<Scalar> seen =
      is_first_order ? lanewise::with_attitude_transformed(
                           ExponentialChart::seen_from(Vector3<Scalar>(center.template head<3>())), predicted.shape)
                     : predicted.shape;
  Matrix6<Scalar> l1;
  Matrix6<Scalar> l2;
  const Truth<Scalar> valid = finite(center) && finite(measured.shape) && finite(seen) && in_domain(measured.shape) &&
                              in_domain(seen) && lanewise::cholesky(measured.shape, l1) && definite_cholesky(seen, l2);
  LanesIntersection<Scalar, 6> intersection;
  Truth<Scalar> usual = lanewise::minimal_intersection(measured.shape, l1, center, l2, criterion, valid, intersection);
  usual = usual && overlap<Scalar, 6>(center, measured.shape, seen, fusion.margin) && fusion.margin >= Scalar(0);

  const StateEllipsoid<State> fused =
      lanewise::recentred(measured.center, intersection.center, intersection.shape, recentring);
  fusion.ellipsoid = select(intersection.second_alone, predicted, fused);
  fusion.share = intersection.share;
  return usual && lanewise::is_kept(fusion.ellipsoid);
}

}  // namespace elliptude::detail::lanewise
