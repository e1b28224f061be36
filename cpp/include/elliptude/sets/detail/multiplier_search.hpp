#pragma once

/// \file
/// The search for the multipliers of guaranteed fusion, by a primal-dual interior-point method. (theory, section 16)

#include "elliptude/linear/eigen.hpp"
#include "elliptude/sets/detail/many_quadrics.hpp"

namespace elliptude::detail {

/// A positive definite H as L diag(1/p) Lᵀ with a unit lower triangle L, in place: L below the diagonal of H, of which the lower
/// triangle is read, p on it, and Lᵀ without the division by pivots above it.
/// \return whether H is positive definite.
template <typename Scalar>
[[nodiscard]] bool factor_in_place(Scalar* h, std::size_t stride, std::size_t count) noexcept {
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t i = j; i < count; ++i) {
      Scalar sum = h[i * stride + j];
      for (std::size_t k = 0; k < j; ++k) {
        sum -= h[i * stride + k] * h[k * stride + j];
      }
      if (i == j) {
        if (!(sum > Scalar(0))) {
          return false;
        }
        h[j * stride + j] = Scalar(1) / sum;
      } else {
        h[j * stride + i] = sum;
        h[i * stride + j] = sum * h[j * stride + j];
      }
    }
  }
  return true;
}

/// x = H⁻¹ b in place of b, with what `factor_in_place` has left.
template <typename Scalar>
void solve_in_place(const Scalar* factor, std::size_t stride, std::size_t count, Scalar* b) noexcept {
  for (std::size_t i = 1; i < count; ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      b[i] -= factor[i * stride + k] * b[k];
    }
  }
  for (std::size_t i = count; i-- > 0;) {
    b[i] *= factor[i * stride + i];
    for (std::size_t k = i + 1; k < count; ++k) {
      b[i] -= factor[k * stride + i] * b[k];
    }
  }
}

/// Where the search begins. With a prediction each measurement has what would be best for it and the prediction alone, by
/// Newton's step from the prediction, with F's second derivative for the volume; without one all share alike.
template <typename Scalar, int N>
[[nodiscard]] typename ManyQuadrics<Scalar, N>::Multipliers starting_multipliers(
    const ManyQuadrics<Scalar, N>& problem) noexcept {
  typename ManyQuadrics<Scalar, N>::Multipliers multipliers;
  const Scalar n(N);
  if (!problem.with_ball) {
    multipliers.fill(n / Scalar(problem.count));
    return multipliers;
  }
  // None at zero, where the search would be slow to raise it, and some of the prediction.
  const Scalar least = scalar::constant<Scalar>(0.05L);
  const Scalar most = scalar::constant<Scalar>(0.5L) * n;
  Scalar sum(0);
  for (std::size_t k = 1; k < problem.count; ++k) {
    Scalar best = problem.constraints[k].with([&](const auto& q) {
      const Scalar square = q.a.squaredNorm();
      const Scalar descent = problem.weighted_trace(k) / n - q.c;
      const Scalar curvature = square / (n * n) + Scalar(2) * q.g.squaredNorm() / n;
      const Scalar newton = descent / curvature;
      // Of a sharp one the prediction says too little: it bounds (tr A)²/‖A‖² coordinates, and its multiplier is about that.
      const Scalar trace = q.a.trace();
      const Scalar sharp = trace * (trace - n) / square;
      return sharp > newton ? sharp : newton;  // not where A = 0
    });
    best = best > least ? best : least;
    multipliers[k] = best < most ? best : most;
    sum += multipliers[k];
  }
  const Scalar share = sum > most ? Scalar(most / sum) : Scalar(1);
  for (std::size_t k = 1; k < problem.count; ++k) {
    multipliers[k] *= share;
  }
  multipliers[0] = n - share * sum;
  return multipliers;
}

/// Multipliers with A ≻ 0. Where A is not, a direction v with vᵀAv ≤ 0 takes weight from the constraints with vᵀAₖv < 0 and
/// gives it to the others.
/// \return `unbounded` if none are found.
template <typename Scalar, int N>
[[nodiscard]] Status find_bounded(const ManyQuadrics<Scalar, N>& problem,
                                  typename ManyQuadrics<Scalar, N>::Multipliers& multipliers,
                                  typename ManyQuadrics<Scalar, N>::Iterate& start) noexcept {
  constexpr int most_steps = 30;
  for (int step = 0; step < most_steps; ++step) {
    if (problem.combine(multipliers, start) == Status::ok) {
      return Status::ok;
    }
    Matrix<Scalar, N> a;
    Vector<Scalar, N> g;
    problem.sum(multipliers, a, g);
    SymmetricEigen<Scalar, N> eigen;
    if (symmetric_eigen(a, eigen) != Status::ok) {
      return Status::unbounded;
    }
    const Vector<Scalar, N> v = eigen.vectors.col(N - 1);
    bool changed = false;
    for (std::size_t k = 0; k < problem.count; ++k) {
      const Scalar along = problem.is_ball(k) ? Scalar(1) : problem.constraints[k].with([&v](const auto& q) {
        constexpr int dimension = std::decay_t<decltype(q.g)>::RowsAtCompileTime;
        const Vector<Scalar, dimension> head = v.template head<dimension>();
        return Scalar(head.dot(q.a.lazyProduct(head)));
      });
      multipliers[k] *= along > Scalar(0) ? Scalar(2) : scalar::constant<Scalar>(0.5L);
      changed = changed || along > Scalar(0);
    }
    if (!changed) {
      return Status::unbounded;
    }
  }
  return Status::unbounded;
}

/// Minimises F over μ ≥ 0 by a primal-dual interior-point method: each step solves (∇²F + diag(zₖ/μₖ)) Δμ = t/μ − ∇F with a
/// target tₖ for each μₖzₖ, stays inside μ > 0 and A ≻ 0, and is followed by the best scale. Every iterate is a valid bound, and
/// the best is kept.
/// \param iterates the first one with A ≻ 0 and multipliers that are positive: where the search begins. The best iterate is one
/// of the two in the end.
/// \param margin the least N/Σμ/scale met.
/// \return `empty_intersection` with `best` the proof.
template <typename Scalar, int N>
[[nodiscard]] Status minimize(const ManyQuadrics<Scalar, N>& problem,
                              const typename ManyQuadrics<Scalar, N>::Multipliers& scale,
                              std::array<typename ManyQuadrics<Scalar, N>::Iterate, 2>& iterates,
                              const typename ManyQuadrics<Scalar, N>::Iterate*& best, Scalar& margin) noexcept {
  using Problem = ManyQuadrics<Scalar, N>;
  using Multipliers = typename Problem::Multipliers;
  constexpr int most_steps = 20;
  const Scalar log_dimension = Scalar(N) * scalar::log(Scalar(N));
  // What is left of F − min F, and so of the logarithm of the volume, or N times that of the trace.
  const Scalar tolerance = scalar::constant<Scalar>(1e-3L);
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar infinite(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  const std::size_t count = problem.count;
  typename Problem::Iterate* now = &iterates[0];
  best = now;
  Multipliers z{};
  Multipliers gradient;
  Matrix<Scalar, N> v;
  std::array<Scalar, Problem::most * Problem::most> hessian;
  for (int step = 0; step <= most_steps; ++step) {
    typename Problem::Iterate& it = *now;
    Scalar sum(0);
    for (std::size_t k = 0; k < count; ++k) {
      sum += it.multipliers[k] / scale[k];  // as given
    }
    margin = step == 0 || it.level / sum < margin ? Scalar(it.level / sum) : margin;
    if (it.level + it.rounding < Scalar(0)) {
      best = now;
      return Status::empty_intersection;
    }
    best = it.size < best->size ? now : best;
    if (!(it.level > it.rounding) || step == most_steps) {
      break;
    }
    // The same ellipsoid, `best` or not, with the multipliers at their best scale.
    const Scalar t = Scalar(N) / it.level;
    for (std::size_t k = 0; k < count; ++k) {
      it.multipliers[k] *= t;
      z[k] /= t;
    }
    it.level *= t;
    it.rounding *= t;
    it.inverse *= Scalar(1) / t;
    it.root *= Scalar(1) / scalar::sqrt(t);
    it.barrier = it.size - log_dimension;

    problem.gradient(it, v, gradient);
    Scalar gap(0);
    Scalar defect(0);
    for (std::size_t k = 0; k < count; ++k) {
      if (step == 0) {
        const Scalar least = scalar::constant<Scalar>(0.002L) * Scalar(N) / (Scalar(count) * it.multipliers[k]);
        z[k] = gradient[k] > least ? gradient[k] : least;
      }
      gap += it.multipliers[k] * z[k];
      defect += it.multipliers[k] * scalar::abs(Scalar(gradient[k] - z[k]));
    }
    // What moving one multiplier alone, and then all to their best scale, would gain, summed: g²/2c with what ∂²F has beside the
    // direction of μ itself; but no more than μg of one that can only fall to zero. Exchanges of constraints that are alike gain
    // more: for these Σμg of those that would fall, as ∇Fᵀμ = 0.
    const Scalar accuracy = tolerance + it.rounding;
    Scalar exchange(0);
    for (std::size_t k = 0; k < count; ++k) {
      exchange += gradient[k] > Scalar(0) ? Scalar(it.multipliers[k] * gradient[k]) : Scalar(0);
    }
    const bool may_exchange = exchange > Scalar(2) * accuracy;
    const auto may_gain = [&](const auto& curvature) {
      Scalar gain(0);
      for (std::size_t k = 0; k < count; ++k) {
        const Scalar& g = gradient[k];
        const Scalar raise = half * g * g;
        const Scalar removal = it.multipliers[k] * g;
        const Scalar second = curvature(k);
        const Scalar change = second > Scalar(0) ? Scalar(raise / second) : infinite;
        gain += g > Scalar(0) && removal < change ? removal : change;
      }
      return !(gain <= accuracy);
    };
    if (!may_exchange && !may_gain([&](std::size_t k) { return problem.least_curvature(k, it, v, gradient); })) {
      break;
    }
    problem.hessian(it, v, gradient, hessian.data());
    const bool worth_it = may_exchange || may_gain([&](std::size_t k) {
                            const Scalar trace = it.slack[k] - gradient[k];
                            return Scalar(hessian[k * Problem::most + k] - trace * trace / Scalar(N));
                          });
    for (std::size_t k = 0; k < count; ++k) {
      hessian[k * Problem::most + k] += z[k] / it.multipliers[k];
    }
    if (!factor_in_place(hessian.data(), Problem::most, count)) {
      break;
    }
    // The step that takes all μₖzₖ to their targets, linearized.
    Multipliers move;
    Multipliers dz;
    const auto aim_at = [&](const Multipliers& target) {
      for (std::size_t k = 0; k < count; ++k) {
        move[k] = target[k] / it.multipliers[k] - gradient[k];
      }
      solve_in_place(hessian.data(), Problem::most, count, move.data());
      for (std::size_t k = 0; k < count; ++k) {
        dz[k] = (target[k] - z[k] * move[k]) / it.multipliers[k] - z[k];
      }
    };
    // How much of a step stays inside, up to a share of the way to the boundary.
    const auto longest = [count](const Multipliers& from, const Multipliers& along, const Scalar& share) {
      Scalar length(1);
      for (std::size_t k = 0; k < count; ++k) {
        if (length * along[k] < -share * from[k]) {
          length = -share * from[k] / along[k];
        }
      }
      return length;
    };
    // Mehrotra's predictor and corrector: a step straight at the optimum shows how far one gets, and so how much to keep away
    // from the boundary, and what the products μₖzₖ then miss in second order.
    Multipliers target;
    std::fill_n(target.begin(), count, Scalar(0));
    aim_at(target);
    Scalar fall(0);  // of F along its tangent: no less than what the whole step would gain
    for (std::size_t k = 0; k < count; ++k) {
      fall -= gradient[k] * move[k];
    }
    if (fall <= accuracy && !worth_it) {
      break;
    }
    const Scalar straight_primal = longest(it.multipliers, move, Scalar(1));
    const Scalar straight_dual = longest(z, dz, Scalar(1));
    Scalar left(0);
    for (std::size_t k = 0; k < count; ++k) {
      left += (it.multipliers[k] + straight_primal * move[k]) * (z[k] + straight_dual * dz[k]);
    }
    const Scalar ratio_left = left / gap;
    const Scalar least_center = scalar::constant<Scalar>(1e-4L);
    const Scalar most_center = scalar::constant<Scalar>(0.3L);
    Scalar center = ratio_left * ratio_left * ratio_left;
    center = center > least_center ? center : least_center;
    center = center < most_center ? center : most_center;
    const Scalar tau = center * (gap + defect) / Scalar(count);
    for (std::size_t k = 0; k < count; ++k) {
      target[k] = tau - move[k] * dz[k];
    }
    aim_at(target);
    const auto slope_of = [&] {  // of F − τ Σ log μ along the step
      Scalar along(0);
      for (std::size_t k = 0; k < count; ++k) {
        along += (gradient[k] - tau / it.multipliers[k]) * move[k];
      }
      return along;
    };
    Scalar slope = slope_of();
    if (!(slope < Scalar(0))) {  // the correction is too large: without it the slope is negative
      for (std::size_t k = 0; k < count; ++k) {
        target[k] = tau;
      }
      aim_at(target);
      slope = slope_of();
    }
    const Scalar inside = scalar::constant<Scalar>(0.99L);
    Scalar primal = longest(it.multipliers, move, inside);
    const Scalar dual = longest(z, dz, inside);
    // F − τ Σ log μ must fall; where it does not, to the minimum of the parabola through what is known of it.
    const Scalar value = it.level + it.barrier;
    const Scalar noise = Scalar(64) * Scalar(scalar::epsilon<Scalar>) * (Scalar(1) + scalar::abs(value)) + it.rounding;
    Multipliers from;
    std::copy_n(it.multipliers.begin(), count, from.begin());
    now = best == &iterates[0] ? &iterates[1] : &iterates[0];
    constexpr int most_trials = 12;
    bool accepted = false;
    for (int trial = 0; trial < most_trials && !accepted; ++trial) {
      Multipliers next;
      Scalar ratios(0);
      Scalar ratio(1);
      for (std::size_t k = 0; k < count; ++k) {
        next[k] = from[k] + primal * move[k];
        ratio *= next[k] / from[k];
        if (k % 8 == 7 || k + 1 == count) {  // the logarithm of a product that neither overflows nor vanishes
          ratios += scalar::log(ratio);
          ratio = Scalar(1);
        }
      }
      Scalar shorter = scalar::constant<Scalar>(0.25L) * primal;
      if (problem.combine(next, *now) == Status::ok) {
        const Scalar change = now->level + now->barrier - value - tau * ratios;
        accepted = change <= scalar::constant<Scalar>(1e-3L) * primal * slope + noise;
        const Scalar parabola = Scalar(-0.5) * slope * primal * primal / (change - slope * primal);
        const Scalar least = scalar::constant<Scalar>(0.1L) * primal;
        const Scalar most = scalar::constant<Scalar>(0.5L) * primal;
        shorter = parabola < most ? (parabola > least ? parabola : least) : most;
        accepted = accepted || now->level + now->rounding < Scalar(0);
      }
      primal = shorter;
    }
    if (!accepted) {
      break;
    }
    for (std::size_t k = 0; k < count; ++k) {
      z[k] += dual * dz[k];
    }
  }
  return Status::ok;
}

}  // namespace elliptude::detail
