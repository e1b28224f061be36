#pragma once

/// \file
/// Guaranteed fusion: a small ellipsoid about everything that satisfies a predicted ellipsoid and any number of quadrics at once
/// (theory, section 16).

#include <algorithm>

#include "elliptude/sets/quadric.hpp"

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

namespace detail {

/// One constraint in the coordinates u of the search.
template <typename Scalar, int N>
struct Constraint {
  static constexpr int lead = std::min(N, 3);

  int rank;                    ///< of A, at most
  bool leading;                ///< whether it speaks of the first three of six coordinates only, as a direction does
  Quadric<Scalar, lead> part;  ///< what it says of these, if so
  Quadric<Scalar, N> quadric;  ///< and of all coordinates, if not

  /// f of the one that it is.
  template <typename Function>
  auto with(const Function& f) const noexcept {
    return leading ? f(part) : f(quadric);
  }
  template <typename Function>
  auto with(const Function& f) noexcept {
    return leading ? f(part) : f(quadric);
  }
};

/// The combination of many constraints, uᵀAu + 2gᵀu ≤ c, and what its minimisation needs. For the volume the convex function
/// F(μ) = N − log det A has the minimiser of N A⁻¹'s volume; for the trace it is N + n log tr(W A⁻¹). (theory, section 16)
template <typename Scalar, int N>
class ManyQuadrics {
 public:
  static constexpr std::size_t most = most_quadrics + 1;
  static constexpr int lead = Constraint<Scalar, N>::lead;
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

  /// A = ΣμₖAₖ and g = Σμₖgₖ.
  void sum(const Multipliers& multipliers, Matrix<Scalar, N>& a, Vector<Scalar, N>& g) const noexcept {
    a.setZero();
    g.setZero();
    if (with_ball) {
      a.diagonal().setConstant(multipliers[0]);
    }
    for (std::size_t k = with_ball ? 1 : 0; k < count; ++k) {
      constraints[k].with([&](const auto& q) {
        constexpr int dimension = std::decay_t<decltype(q.g)>::RowsAtCompileTime;
        if constexpr (dimension == N) {
          a += multipliers[k] * q.a;
          g += multipliers[k] * q.g;
        } else {
          a.template topLeftCorner<dimension, dimension>() += multipliers[k] * q.a;
          g.template head<dimension>() += multipliers[k] * q.g;
        }
      });
    }
  }

  /// Σ μₖ (|cₖ| + Σ |gᵢ| (1 + uᵢ²) + Σ uᵢ² Σⱼ|Aᵢⱼ|): at least the sum of all terms of the combination at u, without their signs.
  [[nodiscard]] Scalar magnitude(const Multipliers& multipliers, const Vector<Scalar, N>& squares) const noexcept {
    Scalar sum(0);
    for (std::size_t k = 0; k < count; ++k) {
      constraints[k].with([&](const auto& q) {
        constexpr int dimension = std::decay_t<decltype(q.g)>::RowsAtCompileTime;
        const Vector<Scalar, dimension> rows = q.a.cwiseAbs().rowwise().sum() + q.g.cwiseAbs();
        sum +=
            multipliers[k] * (scalar::abs(q.c) + q.g.cwiseAbs().sum() + rows.dot(squares.template head<dimension>()));
      });
    }
    return sum;
  }

  /// \return `not_positive_definite` if A is not.
  [[nodiscard]] Status combine(const Multipliers& multipliers, Iterate& it) const noexcept {
    Matrix<Scalar, N> a;
    Vector<Scalar, N> g;
    sum(multipliers, a, g);
    RootFreeFactor<Scalar, N> factor;
    if (const Status status = factorize(a, factor); status != Status::ok) {
      return status;
    }
    std::copy_n(multipliers.begin(), count, it.multipliers.begin());
    it.root = inverse_root(factor);
    it.inverse = square_of_lower(it.root);
    // By substitution, whose residual is of the size of A û: the product A⁻¹g would have one of ‖A‖ ‖A⁻¹‖ ‖g‖.
    it.center = solve(factor, Vector<Scalar, N>(-g));
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
    if (with_ball) {  // which is not relaxed
      it.rounding += Scalar(4 * static_cast<int>(count)) * Scalar(scalar::epsilon<Scalar>) * multipliers[0];
    }
    // The constraints are relaxed by what their sums lose at the states of the set, which are near, and it is at û that they are
    // summed: far from these, terms may cancel that are much larger than what is left.
    if (!with_ball || it.center.squaredNorm() > Scalar(1)) {
      it.rounding += Scalar(4 * (N + 4 + static_cast<int>(count))) * Scalar(scalar::epsilon<Scalar>) *
                     magnitude(multipliers, Vector<Scalar, N>(it.center.cwiseAbs2()));
    }
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
      result[k] =
          it.slack[k] -
          (is_ball(k) ? v.trace() : constraints[k].with([&v](const auto& q) { return trace_of_product(q.a, v); }));
    }
  }

  /// ∇²F, the lower triangle, in rows of length `most`: tr(A⁻¹AⱼA⁻¹Aₖ) + 2 rⱼᵀA⁻¹rₖ with rₖ = Aₖû + gₖ for the volume; for the trace
  /// 2 tr(A⁻¹AⱼVAₖ) − tr(VAⱼ) tr(VAₖ)/N + 2 rⱼᵀA⁻¹rₖ.
  void hessian(const Iterate& it, const Matrix<Scalar, N>& v, const Multipliers& gradient,
               Scalar* result) const noexcept {
    const Matrix<Scalar, N>& x = it.inverse;
    const Matrix<Scalar, lead> x_corner = corner<lead>(x);
    const Matrix<Scalar, lead> v_corner = corner<lead>(v);
    std::array<Matrix<Scalar, N>, most> z;            // A⁻¹AₖV, not of leading constraints
    std::array<Matrix<Scalar, lead>, most> z_corner;  // its first corner, of all
    std::array<Vector<Scalar, N>, most> r;            // rₖ, its first numbers of leading ones
    std::array<Vector<Scalar, N>, most> t;            // A⁻¹rₖ
    for (std::size_t k = 0; k < count; ++k) {
      const Constraint<Scalar, N>& constraint = constraints[k];
      if (constraint.leading) {
        const Matrix<Scalar, lead> half = x_corner.lazyProduct(constraint.part.a);
        z_corner[k].noalias() = half.lazyProduct(v_corner);
        const Vector<Scalar, lead> own =
            constraint.part.a.lazyProduct(it.center.template head<lead>()) + constraint.part.g;
        r[k].template head<lead>() = own;
        t[k].noalias() = x.template leftCols<lead>().lazyProduct(own);
        continue;
      }
      if (is_ball(k)) {
        z[k].noalias() = x.lazyProduct(v);
        r[k] = it.center;
      } else {
        const Matrix<Scalar, N> half = x.lazyProduct(constraint.quadric.a);
        z[k].noalias() = half.lazyProduct(v);
        r[k] = constraint.quadric.a.lazyProduct(it.center) + constraint.quadric.g;
      }
      z_corner[k] = corner<lead>(z[k]);
      t[k].noalias() = x.lazyProduct(r[k]);
    }
    for (std::size_t j = 0; j < count; ++j) {
      for (std::size_t k = 0; k <= j; ++k) {
        Scalar entry;
        Scalar inner;
        if (constraints[j].leading || constraints[k].leading) {
          const std::size_t one = constraints[j].leading ? j : k;
          const std::size_t other = constraints[j].leading ? k : j;
          entry = trace_of_product(constraints[one].part.a, z_corner[other]);
          inner = r[one].template head<lead>().dot(t[other].template head<lead>());
        } else {
          entry = is_ball(k) ? z[j].trace() : trace_of_product(constraints[k].quadric.a, z[j]);
          inner = r[k].dot(t[j]);
        }
        if (!by_volume) {
          entry += entry - (it.slack[j] - gradient[j]) * (it.slack[k] - gradient[k]) / Scalar(N);
        }
        result[j * most + k] = entry + Scalar(2) * inner;
      }
    }
  }

  /// Of ∂²F/∂μₖ², less what it has along μ, for which ∇²F μ = tr(VA): the least that it can be for the volume, where an A of rank m
  /// has tr(A⁻¹AₖA⁻¹Aₖ) ≥ tr(A⁻¹Aₖ)²/m, and an estimate for the trace. The ball's is exact.
  [[nodiscard]] Scalar least_curvature(std::size_t k, const Iterate& it, const Matrix<Scalar, N>& v,
                                       const Multipliers& gradient) const noexcept {
    const Scalar trace = it.slack[k] - gradient[k];
    const Scalar along = trace * trace / Scalar(N);
    if (is_ball(k)) {
      const Scalar square = it.inverse.cwiseProduct(v).sum();
      return (by_volume ? Scalar(square - along) : Scalar(Scalar(2) * (square - along))) +
             Scalar(2) * (it.root.lazyProduct(it.center)).squaredNorm();
    }
    return trace * trace / Scalar(constraints[k].rank) - along;
  }

  [[nodiscard]] Scalar slack_at(std::size_t k, const Vector<Scalar, N>& u) const noexcept {
    if (is_ball(k)) {
      return constraints[0].quadric.c - u.squaredNorm();
    }
    return constraints[k].with([&u](const auto& q) {
      constexpr int dimension = std::decay_t<decltype(q.g)>::RowsAtCompileTime;
      return slack(q, Vector<Scalar, dimension>(u.template head<dimension>()));
    });
  }

  [[nodiscard]] bool is_ball(std::size_t k) const noexcept { return with_ball && k == 0; }

  /// tr(W Aₖ), for the volume tr Aₖ.
  [[nodiscard]] Scalar weighted_trace(std::size_t k) const noexcept {
    return constraints[k].with(
        [this](const auto& q) { return by_volume ? Scalar(q.a.trace()) : trace_of_product(q.a, weight); });
  }

 private:
  /// The first M rows and columns.
  template <int M>
  [[nodiscard]] static Matrix<Scalar, M> corner(const Matrix<Scalar, N>& matrix) noexcept {
    return matrix.template topLeftCorner<M, M>();
  }
  /// tr(A Z), of Z the corner that is as large as A.
  template <int M, int K>
  [[nodiscard]] static Scalar trace_of_product(const Matrix<Scalar, M>& a, const Matrix<Scalar, K>& z) noexcept {
    if constexpr (M == K) {
      return a.cwiseProduct(z).sum();
    } else {
      return a.cwiseProduct(z.template topLeftCorner<M, M>()).sum();
    }
  }
};

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

/// The coordinates u of the search, y = shift + factor u with a lower triangle.
template <typename Scalar, int N>
struct Coordinates {
  Vector<Scalar, N> shift;
  Matrix<Scalar, N> factor;
  Vector<Scalar, N> reach;  ///< bounds |y| over the unit ball, if that is one of the constraints
  bool in_ball;
};

/// The quadric in u, relaxed by what rounding may do to it: for all u of the unit ball if that is one of the constraints, else for
/// all u. (theory, section 16)
/// \param rows of the factor, those of the quadric's coordinates, without columns of zeros.
template <typename Scalar, int M, int K>
[[nodiscard]] Quadric<Scalar, K> relaxed(const Quadric<Scalar, M>& quadric, const Matrix<Scalar, M, K>& rows,
                                         const Vector<Scalar, M>& shift, const Vector<Scalar, M>& reach, bool in_ball,
                                         const Scalar& rounding) noexcept {
  Quadric<Scalar, K> seen = pullback(quadric, rows, shift);
  if (in_ball) {
    const Scalar size =
        reach.dot(quadric.a.cwiseAbs().lazyProduct(reach)) + Scalar(2) * reach.dot(quadric.g.cwiseAbs());
    seen.c += rounding * (scalar::abs(quadric.c) + size);
  } else {
    // |u|ᵀ|A||u| ≤ Σ uᵢ² Σⱼ|Aᵢⱼ| and 2|gᵢuᵢ| ≤ |gᵢ| (1 + uᵢ²)
    seen.c += rounding * (scalar::abs(quadric.c) + seen.g.cwiseAbs().sum());
    const Vector<Scalar, K> sums = seen.a.cwiseAbs().rowwise().sum() + seen.g.cwiseAbs();
    seen.a.diagonal() -= rounding * sums;
  }
  return seen;
}

template <typename Scalar, int N>
void relax(const Quadric<Scalar, N>& quadric, const Coordinates<Scalar, N>& at, const Scalar& rounding,
           Constraint<Scalar, N>& result) noexcept {
  result.rank = N;
  result.leading = false;
  result.quadric = relaxed(quadric, at.factor, at.shift, at.reach, at.in_ball, rounding);
}

template <typename Scalar>
void relax(const HalfQuadric<Scalar>& half, const Coordinates<Scalar, 6>& at, const Scalar& rounding,
           Constraint<Scalar, 6>& result) noexcept {
  result.rank = 3;
  result.leading = half.half == Half::first;
  if (result.leading) {
    result.part = relaxed(half.quadric, Matrix3<Scalar>(at.factor.template topLeftCorner<3, 3>()),
                          Vector3<Scalar>(at.shift.template head<3>()), Vector3<Scalar>(at.reach.template head<3>()),
                          at.in_ball, rounding);
  } else {
    result.quadric = relaxed(half.quadric, Matrix<Scalar, 3, 6>(at.factor.template bottomRows<3>()),
                             Vector3<Scalar>(at.shift.template tail<3>()), Vector3<Scalar>(at.reach.template tail<3>()),
                             at.in_ball, rounding);
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

/// Scales for coordinates without a prediction, in which the quadrics' diagonals are of the size of their slack.
/// \return `unbounded` if there is a coordinate of which none speaks.
template <typename Scalar, int N, typename Given>
[[nodiscard]] Status scale_by_slack(const Given* quadrics, std::size_t count, Matrix<Scalar, N>& factor) noexcept {
  Vector<Scalar, N> largest = Vector<Scalar, N>::Zero();
  for (std::size_t k = 0; k < count; ++k) {
    const Quadric<Scalar, N> quadric = extended(quadrics[k]);
    // Not much less than the slack at zero, or a sharp set would be far from zero in its own widths, and lose by rounding.
    const Scalar least = scalar::constant<Scalar>(1e-3L) * scalar::abs(quadric.c);
    const Scalar scale_of_slack = slack_scale(quadric);
    const Scalar level = scale_of_slack > least ? scale_of_slack : least;
    largest = largest.cwiseMax(quadric.a.diagonal().cwiseAbs() / level).eval();
  }
  if (!(largest.array() > Scalar(0)).all()) {
    return Status::unbounded;
  }
  factor.diagonal() = largest.cwiseSqrt().cwiseInverse();
  return Status::ok;
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
