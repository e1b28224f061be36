#pragma once

/// \file
/// Guaranteed fusion: a small ellipsoid about everything that satisfies a predicted ellipsoid and any number of quadrics at once
/// (theory, section 16).

#include <algorithm>

#include "elliptude/quadric.hpp"

namespace elliptude {

/// How many quadrics can be fused at once.
inline constexpr std::size_t most_quadrics = 40;

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

namespace fusion {

/// One constraint in the coordinates u of the search.
template <typename Scalar, int N>
struct Constraint {
  Quadric<Scalar, N> quadric;
  bool leading;  ///< whether it speaks of the first three of six coordinates only, as a direction does
};

/// The combination of many constraints, uᵀAu + 2gᵀu ≤ c, and what its minimisation needs. For the volume the convex function
/// F(μ) = N − log det A has the minimiser of N A⁻¹'s volume; for the trace it is N + n log tr(W A⁻¹). (theory, section 16)
template <typename Scalar, int N>
class ManyQuadrics {
 public:
  static constexpr std::size_t most = most_quadrics + 1;
  static constexpr int lead = std::min(N, 3);
  using Multipliers = std::array<Scalar, most>;

  /// A(μ) ≻ 0 and what follows from it.
  struct Iterate {
    Multipliers multipliers;
    Multipliers slack;          ///< sₖ at the center
    Matrix<Scalar, N> root;     ///< lower triangle with A⁻¹ = rootᵀ root
    Matrix<Scalar, N> inverse;  ///< A⁻¹
    Vector<Scalar, N> center;   ///< −A⁻¹g
    Scalar level;               ///< N = c + gᵀA⁻¹g
    Scalar rounding;            ///< what the inversion of A may add to it
    Scalar barrier;             ///< −log det A, or N log tr(W A⁻¹): F = level + barrier
    Scalar size;                ///< N log level + barrier, which does not depend on the multipliers' scale
  };

  std::array<Constraint<Scalar, N>, most> constraints;
  std::size_t count = 0;
  bool with_ball = false;  ///< whether constraint 0 is the unit ball
  bool by_volume = true;
  Matrix<Scalar, N> weight;  ///< W in the coordinates u

  /// \return `not_positive_definite` if A is not.
  [[nodiscard]] Status combine(const Multipliers& multipliers, Iterate& it) const noexcept {
    Matrix<Scalar, N> a = Matrix<Scalar, N>::Zero();
    Vector<Scalar, N> g = Vector<Scalar, N>::Zero();
    for (std::size_t k = 0; k < count; ++k) {
      const Quadric<Scalar, N>& q = constraints[k].quadric;
      const Scalar& m = multipliers[k];
      if (with_ball && k == 0) {
        a.diagonal().array() += m;
      } else if (constraints[k].leading) {
        a.template topLeftCorner<lead, lead>() += m * q.a.template topLeftCorner<lead, lead>();
        g.template head<lead>() += m * q.g.template head<lead>();
      } else {
        a += m * q.a;
        g += m * q.g;
      }
    }
    Matrix<Scalar, N> l;
    if (const Status status = cholesky(a, l); status != Status::ok) {
      return status;
    }
    it.multipliers = multipliers;
    it.root = lower_inverse(l);
    it.inverse = square_of_lower(it.root);
    // By substitution, whose residual is of the size of A û: the product A⁻¹g would have one of ‖A‖ ‖A⁻¹‖ ‖g‖.
    it.center = solve_lower_transposed(l, solve_lower(l, Vector<Scalar, N>(-g)));
    it.level = Scalar(0);
    for (std::size_t k = 0; k < count; ++k) {
      it.slack[k] = slack_at(k, it.center);
      it.level += multipliers[k] * it.slack[k];
    }
    // The distance from û of what is to be contained is at most 1 + ‖û‖ in the ball, and √(N tr A⁻¹) in the result.
    const Scalar positive = it.level > Scalar(0) ? it.level : Scalar(0);
    const Scalar spread = positive * it.inverse.trace();
    const Scalar reach = Scalar(1) + it.center.squaredNorm() + (with_ball ? Scalar(0) : spread);
    it.rounding = Scalar(8 * (N + 2)) * Scalar(scalar::epsilon<Scalar>) * a.trace() *
                  (reach + scalar::sqrt(Scalar(reach * spread)));
    it.barrier = by_volume ? Scalar(Scalar(2) * scalar::log(Scalar(it.root.diagonal().prod())))
                           : Scalar(Scalar(N) * scalar::log(Scalar(it.inverse.cwiseProduct(weight).sum())));
    it.size = Scalar(N) * scalar::log(Scalar(positive + it.rounding)) + it.barrier;
    return Status::ok;
  }

  /// V with ∇F = s − tr(V A): A⁻¹, or N A⁻¹WA⁻¹/tr(WA⁻¹).
  void gradient(const Iterate& it, Matrix<Scalar, N>& v, Multipliers& result) const noexcept {
    const Matrix<Scalar, N>& x = it.inverse;
    if (by_volume) {
      v = x;
    } else {
      const Matrix<Scalar, N> half = x.lazyProduct(weight);
      v.noalias() = half.lazyProduct(x);
      v *= Scalar(N) / half.trace();
    }
    for (std::size_t k = 0; k < count; ++k) {
      result[k] = it.slack[k] - (with_ball && k == 0 ? v.trace() : trace_product(k, v));
    }
  }

  /// ∇²F, the lower triangle, in rows of length `most`: tr(A⁻¹AⱼA⁻¹Aₖ) + 2 rⱼᵀA⁻¹rₖ with rₖ = Aₖû + gₖ for the volume; for the trace
  /// 2 tr(A⁻¹AⱼVAₖ) − tr(VAⱼ) tr(VAₖ)/N + 2 rⱼᵀA⁻¹rₖ.
  void hessian(const Iterate& it, const Matrix<Scalar, N>& v, const Multipliers& gradient,
               Scalar* result) const noexcept {
    const Matrix<Scalar, N>& x = it.inverse;
    std::array<Matrix<Scalar, N>, most> z;  // A⁻¹AₖV
    std::array<Vector<Scalar, N>, most> t;  // root rₖ
    for (std::size_t k = 0; k < count; ++k) {
      const Quadric<Scalar, N>& q = constraints[k].quadric;
      if (with_ball && k == 0) {
        z[k].noalias() = x.lazyProduct(v);
        t[k].noalias() = it.root.lazyProduct(it.center);
      } else if (constraints[k].leading) {
        const Matrix<Scalar, lead> a = q.a.template topLeftCorner<lead, lead>();
        const Matrix<Scalar, lead> half = x.template topLeftCorner<lead, lead>().lazyProduct(a);
        z[k].template topLeftCorner<lead, lead>() = half.lazyProduct(v.template topLeftCorner<lead, lead>());
        const Vector<Scalar, lead> r = a.lazyProduct(it.center.template head<lead>()) + q.g.template head<lead>();
        t[k].noalias() = it.root.template leftCols<lead>().lazyProduct(r);
      } else {
        const Matrix<Scalar, N> half = x.lazyProduct(q.a);
        z[k].noalias() = half.lazyProduct(v);
        const Vector<Scalar, N> r = q.a.lazyProduct(it.center) + q.g;
        t[k].noalias() = it.root.lazyProduct(r);
      }
    }
    for (std::size_t j = 0; j < count; ++j) {
      for (std::size_t k = 0; k <= j; ++k) {
        Scalar entry = product(j, k, z);
        if (!by_volume) {
          entry += entry - (it.slack[j] - gradient[j]) * (it.slack[k] - gradient[k]) / Scalar(N);
        }
        result[j * most + k] = entry + Scalar(2) * t[j].dot(t[k]);
      }
    }
  }

  [[nodiscard]] Scalar slack_at(std::size_t k, const Vector<Scalar, N>& u) const noexcept {
    if (with_ball && k == 0) {
      return constraints[0].quadric.c - u.squaredNorm();
    }
    const Quadric<Scalar, N>& q = constraints[k].quadric;
    if (constraints[k].leading) {
      const auto u3 = u.template head<lead>();
      const Vector<Scalar, lead> half =
          q.a.template topLeftCorner<lead, lead>().lazyProduct(u3) + Scalar(2) * q.g.template head<lead>();
      return q.c - u3.dot(half);
    }
    return slack(q, u);
  }

 private:
  [[nodiscard]] Scalar product(std::size_t j, std::size_t k,
                               const std::array<Matrix<Scalar, N>, most>& z) const noexcept {
    if (with_ball && k == 0) {
      return j == 0 ? z[0].trace() : trace_product(j, z[0]);
    }
    return constraints[j].leading ? trace_product(j, z[k]) : trace_product(k, z[j]);
  }
  /// tr(Aₖ Z)
  [[nodiscard]] Scalar trace_product(std::size_t k, const Matrix<Scalar, N>& z) const noexcept {
    const Matrix<Scalar, N>& a = constraints[k].quadric.a;
    if (constraints[k].leading) {
      return a.template topLeftCorner<lead, lead>().cwiseProduct(z.template topLeftCorner<lead, lead>()).sum();
    }
    return a.cwiseProduct(z).sum();
  }
};

/// The factor L of a positive definite H = L Lᵀ, in place of the lower triangle of H, with 1/lᵢᵢ on its diagonal.
/// \return whether H is positive definite.
template <typename Scalar>
[[nodiscard]] bool factor_in_place(Scalar* h, std::size_t stride, std::size_t count) noexcept {
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t i = j; i < count; ++i) {
      Scalar sum = h[i * stride + j];
      for (std::size_t k = 0; k < j; ++k) {
        sum -= h[i * stride + k] * h[j * stride + k];
      }
      if (i == j) {
        if (!(sum > Scalar(0))) {
          return false;
        }
        h[j * stride + j] = Scalar(1) / scalar::sqrt(sum);
      } else {
        h[i * stride + j] = sum * h[j * stride + j];
      }
    }
  }
  return true;
}

/// x = H⁻¹ b in place of b, with what `factor_in_place` has left.
template <typename Scalar>
void solve_in_place(const Scalar* factor, std::size_t stride, std::size_t count, Scalar* b) noexcept {
  for (std::size_t i = 0; i < count; ++i) {
    Scalar sum = b[i];
    for (std::size_t k = 0; k < i; ++k) {
      sum -= factor[i * stride + k] * b[k];
    }
    b[i] = sum * factor[i * stride + i];
  }
  for (std::size_t i = count; i-- > 0;) {
    Scalar sum = b[i];
    for (std::size_t k = i + 1; k < count; ++k) {
      sum -= factor[k * stride + i] * b[k];
    }
    b[i] = sum * factor[i * stride + i];
  }
}

/// The constraint as it is seen in u, where y = shift + factor u, and relaxed by what rounding may do to it: for all u of the
/// unit ball if that is one of the constraints, else for all u. `reach` bounds |y| over the ball. (theory, section 16)
template <typename Scalar, int N>
void relax(const Quadric<Scalar, N>& quadric, const Vector<Scalar, N>& shift, const Matrix<Scalar, N>& factor,
           const Vector<Scalar, N>& reach, const Scalar& rounding, bool in_ball,
           Constraint<Scalar, N>& result) noexcept {
  constexpr int lead = ManyQuadrics<Scalar, N>::lead;
  constexpr int rest = N - lead;
  result.leading = rest > 0 && (quadric.a.template rightCols<rest>().array() == Scalar(0)).all() &&
                   (quadric.a.template bottomRows<rest>().array() == Scalar(0)).all() &&
                   (quadric.g.template tail<rest>().array() == Scalar(0)).all();
  Quadric<Scalar, N>& seen = result.quadric;
  Scalar size;
  if (result.leading) {
    seen.a.setZero();
    seen.g.setZero();
    // The factor is a lower triangle.
    const Matrix<Scalar, lead> a = quadric.a.template topLeftCorner<lead, lead>();
    const Matrix<Scalar, lead> l = factor.template topLeftCorner<lead, lead>();
    const Vector<Scalar, lead> s = shift.template head<lead>();
    const Vector<Scalar, lead> g = quadric.g.template head<lead>();
    const Quadric<Scalar, lead> small = pullback(Quadric<Scalar, lead>{a, g, quadric.c}, l, s);
    seen.a.template topLeftCorner<lead, lead>() = small.a;
    seen.g.template head<lead>() = small.g;
    seen.c = small.c;
    const Vector<Scalar, lead> w = reach.template head<lead>();
    size = w.dot(a.cwiseAbs().lazyProduct(w)) + Scalar(2) * w.dot(g.cwiseAbs());
  } else {
    seen = pullback(quadric, factor, shift);
    size = reach.dot(quadric.a.cwiseAbs().lazyProduct(reach)) + Scalar(2) * reach.dot(quadric.g.cwiseAbs());
  }
  seen.c += rounding * (scalar::abs(quadric.c) + (in_ball ? size : seen.g.cwiseAbs().sum()));
  if (!in_ball) {
    // |u|ᵀ|A||u| ≤ Σ uᵢ² Σⱼ|Aᵢⱼ| and 2|gᵢuᵢ| ≤ |gᵢ| (1 + uᵢ²)
    const Vector<Scalar, N> rows = seen.a.cwiseAbs().rowwise().sum() + seen.g.cwiseAbs();
    seen.a.diagonal() -= rounding * rows;
  }
}

/// About the greatest slack of a constraint near the ball, so that multipliers of about one suit constraints of any scale: by
/// conjugate gradients from zero, until it is known to a factor of two or they leave the ball.
template <typename Scalar, int N>
[[nodiscard]] Scalar slack_scale(const Quadric<Scalar, N>& q) noexcept {
  Scalar best = q.c;
  Vector<Scalar, N> u = Vector<Scalar, N>::Zero();
  Vector<Scalar, N> residual = -q.g;
  Vector<Scalar, N> direction = residual;
  Scalar square = residual.squaredNorm();
  for (int step = 0; step < N && square > Scalar(0); ++step) {
    const Vector<Scalar, N> image = q.a.lazyProduct(direction);
    const Scalar curvature = direction.dot(image);
    const Scalar limit = Scalar(1) / scalar::sqrt(Scalar(direction.squaredNorm()));
    const bool inside = curvature * limit > square;
    const Scalar length = inside ? Scalar(square / curvature) : limit;
    const Scalar gain = length * (Scalar(2) * square - length * curvature);
    u += length * direction;
    best += gain;
    if (!inside || gain <= best || u.squaredNorm() > Scalar(1)) {
      break;
    }
    residual -= length * image;
    const Scalar next = residual.squaredNorm();
    direction = residual + (next / square) * direction;
    square = next;
  }
  if (best > Scalar(1000) * Scalar(scalar::epsilon<Scalar>) * scalar::abs(q.c)) {
    return best;
  }
  const Scalar missing = scalar::constant<Scalar>(1e-3L) * scalar::abs(q.c);
  return missing > Scalar(0) ? missing : (q.a.norm() > Scalar(0) ? Scalar(q.a.norm()) : Scalar(1));
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
  const Scalar least = scalar::constant<Scalar>(0.1L);
  const Scalar most = scalar::constant<Scalar>(0.5L) * n;
  Scalar sum(0);
  for (std::size_t k = 1; k < problem.count; ++k) {
    const Quadric<Scalar, N>& q = problem.constraints[k].quadric;
    const Scalar trace = problem.by_volume ? Scalar(q.a.trace()) : Scalar(problem.weight.cwiseProduct(q.a).sum());
    const Scalar descent = trace / n - q.c;
    const Scalar curvature = q.a.squaredNorm() / (n * n) + Scalar(2) * q.g.squaredNorm() / n;
    // Of a sharp one the prediction says too little: it bounds as many coordinates as this, and its multiplier is about that.
    const Scalar dimension = q.a.trace() * q.a.trace() / q.a.squaredNorm();
    const Scalar sharp = dimension - n * q.a.trace() / q.a.squaredNorm();
    Scalar best = descent / curvature;
    best = sharp > best ? sharp : best;  // not where A = 0
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
    Matrix<Scalar, N> a = Matrix<Scalar, N>::Zero();
    for (std::size_t k = 0; k < problem.count; ++k) {
      a += multipliers[k] * problem.constraints[k].quadric.a;
    }
    SymmetricEigen<Scalar, N> eigen;
    if (symmetric_eigen(a, eigen) != Status::ok) {
      return Status::unbounded;
    }
    const Vector<Scalar, N> v = eigen.vectors.col(N - 1);
    bool changed = false;
    for (std::size_t k = 0; k < problem.count; ++k) {
      const Scalar along = v.dot(problem.constraints[k].quadric.a.lazyProduct(v));
      multipliers[k] *= along > Scalar(0) ? Scalar(2) : scalar::constant<Scalar>(0.5L);
      changed = changed || along > Scalar(0);
    }
    if (!changed) {
      return Status::unbounded;
    }
  }
  return Status::unbounded;
}

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
        const Scalar least = scalar::constant<Scalar>(0.005L) * Scalar(N) / (Scalar(count) * it.multipliers[k]);
        z[k] = gradient[k] > least ? gradient[k] : least;
      }
      gap += it.multipliers[k] * z[k];
      defect += it.multipliers[k] * scalar::abs(Scalar(gradient[k] - z[k]));
    }
    // A multiplier that is far too small counts for little in these sums though much is to be gained by raising it: g²/2∂²F alone
    // for each that would fall. For ∂²F a bound from below is at hand, tr(V Aₖ)²/N, which settles nearly all.
    const Scalar accuracy = tolerance + it.rounding;
    const bool balanced = gap + defect <= accuracy;
    const auto may_gain = [&](const auto& curvature) {
      bool gains = false;
      for (std::size_t k = 0; k < count; ++k) {
        gains = gains || (gradient[k] < Scalar(0) && gradient[k] * gradient[k] > accuracy * curvature(k));
      }
      return gains;
    };
    const auto least_curvature = [&](std::size_t k) {
      const Scalar trace = it.slack[k] - gradient[k];
      return Scalar(trace * trace / Scalar(N));
    };
    if (balanced && !may_gain(least_curvature)) {
      break;
    }
    problem.hessian(it, v, gradient, hessian.data());
    if (balanced && !may_gain([&](std::size_t k) { return hessian[k * Problem::most + k]; })) {
      break;
    }
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
    const Multipliers from = it.multipliers;
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

/// `minimal_intersection` of at most `most_quadrics` quadrics that are known to be symmetric, with a valid criterion; that all is
/// finite, and the prediction, are tested here.
template <typename Scalar, int N>
[[nodiscard]] Status fuse(const Ellipsoid<Scalar, N>* predicted, const Quadric<Scalar, N>* quadrics, std::size_t count,
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
  Vector<Scalar, N> shift = Vector<Scalar, N>::Zero();
  Vector<Scalar, N> reach = Vector<Scalar, N>::Zero();
  Matrix<Scalar, N> factor = Matrix<Scalar, N>::Zero();
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
    if (const Status status = cholesky(raised, factor); status != Status::ok) {
      return status;
    }
    shift = predicted->center;
    reach = shift.cwiseAbs() + raised.diagonal().cwiseSqrt();
  } else {
    std::array<Scalar, most_quadrics> level;
    for (std::size_t k = 0; k < count; ++k) {
      // Not much less than the slack at zero, or a sharp set would be far from zero in its own widths, and lose by rounding.
      const Scalar least = scalar::constant<Scalar>(1e-3L) * scalar::abs(quadrics[k].c);
      const Scalar scale_of_slack = slack_scale(quadrics[k]);
      level[k] = scale_of_slack > least ? scale_of_slack : least;
    }
    for (int i = 0; i < N; ++i) {
      Scalar largest(0);
      for (std::size_t k = 0; k < count; ++k) {
        const Scalar entry = scalar::abs(Scalar(quadrics[k].a(i, i))) / level[k];
        largest = entry > largest ? entry : largest;
      }
      if (!(largest > Scalar(0))) {
        return Status::unbounded;
      }
      factor(i, i) = Scalar(1) / scalar::sqrt(largest);
    }
  }
  if (!problem.by_volume) {
    problem.weight.noalias() = factor.transpose().lazyProduct(Matrix<Scalar, N>(criterion.weight.lazyProduct(factor)));
    problem.weight *= Scalar(N) / problem.weight.trace();
  }

  typename Problem::Multipliers scale;
  if (problem.with_ball) {
    problem.constraints[0] = {{Matrix<Scalar, N>::Identity(), Vector<Scalar, N>::Zero(), Scalar(1)}, false};
    scale[0] = Scalar(1);
  }
  const Scalar rounding = Scalar(4 * (N + 4) + static_cast<int>(count)) * epsilon;
  bool idle = problem.with_ball;
  for (std::size_t k = 0; k < count; ++k) {
    Constraint<Scalar, N>& constraint = problem.constraints[k + first];
    relax(quadrics[k], shift, factor, reach, rounding, problem.with_ball, constraint);
    Quadric<Scalar, N>& q = constraint.quadric;
    // At μ = (N, 0, ...) F grows with every multiplier if sₖ(0) ≥ tr(W Aₖ)/tr W.
    const Scalar trace = problem.by_volume ? Scalar(q.a.trace()) : Scalar(problem.weight.cwiseProduct(q.a).sum());
    idle = idle && q.c * Scalar(N) >= trace;
    scale[k + first] = slack_scale(q);
    const Scalar inverse = Scalar(1) / scale[k + first];
    q.a *= inverse;
    q.g *= inverse;
    q.c *= inverse;
    if (!scalar::all_finite(q.a) || !scalar::all_finite(q.g) || !scalar::isfinite(q.c)) {
      return Status::not_finite;
    }
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
  const Matrix<Scalar, N> half = scalar::sqrt(level) * factor.lazyProduct(best.root.transpose());
  Ellipsoid<Scalar, N> set;
  set.shape.noalias() = half.lazyProduct(half.transpose());
  set.center = shift + factor.lazyProduct(best.center);
  const Scalar spread = scalar::sqrt(Scalar(level * best.inverse.trace()));
  Scalar loss(0);
  for (int i = 0; i < N; ++i) {
    const Scalar lost = (spread * factor.row(i).norm() + scalar::abs(shift(i)) + scalar::abs(set.center(i))) /
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

}  // namespace fusion

/// A small ellipsoid that contains all that satisfies a predicted ellipsoid and `count` quadrics: the smallest of the family
/// E(−A⁻¹g, N A⁻¹), A = ΣμₖAₖ ≻ 0, g = Σμₖgₖ, c = Σμₖcₖ, N = c + gᵀA⁻¹g, over μ ≥ 0, never larger than the prediction, which is
/// returned unchanged where nothing helps. A bounded number of steps, each a valid bound; rounding is on the safe side: a
/// quadric more than about 1e7 times sharper than the prediction is used as if it were 1e7 times sharper. (theory, section 16)
/// \param predicted positive definite; or null, and then the quadrics must bound a set by themselves.
/// \return what `validate` says; `out_of_range` for more than `most_quadrics`; `not_positive_definite` of a flat prediction;
/// `unbounded` if no A ≻ 0 was found; `empty_intersection` with N < 0 and A ≻ 0 as proof, after which `margin` and
/// `contradiction` are set, and nothing else.
template <typename Scalar, int N>
[[nodiscard]] Status minimal_intersection(const Ellipsoid<Scalar, N>* predicted, const Quadric<Scalar, N>* quadrics,
                                          std::size_t count, const SizeCriterion<Scalar, N>& criterion,
                                          QuadricFusion<Scalar, N>& result) noexcept {
  if (count > most_quadrics) {
    return Status::out_of_range;
  }
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (const Status status = validate(quadrics[k]); status != Status::ok) {
      return status;
    }
  }
  return fusion::fuse(predicted, quadrics, count, criterion, result);
}

}  // namespace elliptude
