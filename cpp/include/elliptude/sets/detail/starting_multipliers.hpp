#pragma once

/// \file
/// Where the search for the multipliers of guaranteed fusion begins. (theory, section 16.5)

#include "elliptude/linear/eigen.hpp"
#include "elliptude/sets/detail/many_quadrics.hpp"

namespace elliptude::detail {

/// The start of the search. With a prediction each measurement gets the best multiplier for it and the prediction
/// alone, by Newton's step from the prediction, with F's second derivative for the volume; without a prediction all get
/// the same.
template <typename Scalar, int N>
[[nodiscard]] typename ManyQuadrics<Scalar, N>::Multipliers starting_multipliers(
    const ManyQuadrics<Scalar, N>& problem) noexcept {
  typename ManyQuadrics<Scalar, N>::Multipliers multipliers;
  const Scalar n(N);
  if (!problem.with_ball) {
    multipliers.fill(n / Scalar(problem.count));
    return multipliers;
  }
  // None starts at zero, where the search would be slow to raise it, and the prediction keeps a part.
  const Scalar least = scalar::constant<Scalar>(0.05L);
  const Scalar most = scalar::constant<Scalar>(0.5L) * n;
  Scalar sum(0);
  for (std::size_t k = 1; k < problem.count; ++k) {
    Scalar best = problem.constraints[k].with([&](const auto& q) {
      const Scalar square = q.a.squaredNorm();
      const Scalar descent = problem.weighted_trace(k) / n - q.c;
      const Scalar curvature = square / (n * n) + Scalar(2) * q.g.squaredNorm() / n;
      const Scalar newton = descent / curvature;
      // For a sharp one that is too little: it bounds (tr A)²/‖A‖² coordinates, and its multiplier is about that.
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

/// Multipliers with A ≻ 0. Where A is not, a direction v with vᵀAv ≤ 0 takes weight from the constraints with vᵀAₖv < 0
/// and gives it to the others.
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

}  // namespace elliptude::detail
