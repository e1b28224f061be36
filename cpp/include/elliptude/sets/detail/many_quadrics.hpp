#pragma once

/// \file
/// Sums of many quadrics with multipliers: the family of ellipsoids in which guaranteed fusion searches, and its
/// derivatives. (theory, eq. 16.4 and section 16.5)

#include <algorithm>
#include <array>
#include <new>
#include <type_traits>

#include "elliptude/base/limits.hpp"
#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/cholesky.hpp"
#include "elliptude/sets/detail/multipliers.hpp"
#include "elliptude/sets/quadric.hpp"

namespace elliptude {

namespace detail {

/// One constraint in the coordinates u of the search.
template <typename Scalar, int N>
struct Constraint {
  static constexpr int lead = std::min(N, 3);  ///< where it is N, none is `leading`

  int rank;      ///< of A, at most
  bool leading;  ///< whether it constrains only the first three of six coordinates, as a direction does
  union {
    Quadric<Scalar, lead> part;  ///< the quadric of these, if so
    Quadric<Scalar, N> quadric;  ///< the quadric of all coordinates, if not
  };

  // Neither quadric yet: with `= default` a union of classes has no constructor.
  Constraint() noexcept {}  // NOLINT(modernize-use-equals-default)

  /// Makes it a constraint of the first coordinates, or of all.
  /// \param make gives the quadric, which is made in its place.
  template <typename Make>
  void constrain_leading(int most_rank, const Make& make) noexcept {
    static_assert(std::is_trivially_destructible_v<Quadric<Scalar, N>>, "nothing ends what was here before");
    rank = most_rank;
    leading = true;
    new (&part) Quadric<Scalar, lead>(make());
  }
  template <typename Make>
  void constrain_all(int most_rank, const Make& make) noexcept {
    static_assert(std::is_trivially_destructible_v<Quadric<Scalar, lead>>, "nothing ends what was here before");
    rank = most_rank;
    leading = false;
    new (&quadric) Quadric<Scalar, N>(make());
  }

  /// f of the one that it is.
  template <typename Function>
  auto with(const Function& f) const noexcept {
    if constexpr (lead < N) {
      return leading ? f(part) : f(quadric);
    } else {
      return f(quadric);
    }
  }
  template <typename Function>
  auto with(const Function& f) noexcept {
    if constexpr (lead < N) {
      return leading ? f(part) : f(quadric);
    } else {
      return f(quadric);
    }
  }
};

/// The combination of many constraints, uᵀAu + 2gᵀu ≤ c, and what its minimisation needs. For the volume the convex
/// function F(μ) = N − log det A has the minimiser of N A⁻¹'s volume; for the trace it is N + n log tr(W A⁻¹).
/// (theory, eq. 16.4)
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
  bool with_ball = false;    ///< whether constraint 0 is the unit ball
  bool volume = true;        ///< whether that is what is made small
  Matrix<Scalar, N> weight;  ///< W in the coordinates u

  [[nodiscard]] bool by_volume() const noexcept { return only_volume || volume; }

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

  /// Σ μₖ (|cₖ| + Σ |gᵢ| (1 + uᵢ²) + Σ uᵢ² Σⱼ|Aᵢⱼ|): at least the sum of all terms of the combination at u, without
  /// their signs.
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

  /// \return `not_positive_definite` if A is not; `out_of_range` of multipliers that are none.
  [[nodiscard]] Status combine(const Multipliers& multipliers, Iterate& it) const noexcept {
    if (!may_sum(multipliers, count)) {
      return Status::out_of_range;
    }
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
    it.rounding =
        rounding::share<Scalar>(rounding::inversion(N)) * a.trace() * (reach + scalar::sqrt(Scalar(reach * spread)));
    if (with_ball) {  // which is not relaxed
      it.rounding += rounding::share<Scalar>(rounding::terms_of_ball(static_cast<int>(count))) * multipliers[0];
    }
    // The constraints are relaxed by what their sums lose at the states of the set, which are near. But they are summed
    // at û: far from the states, terms may cancel that are much larger than what is left.
    if (!with_ball || it.center.squaredNorm() > Scalar(1)) {
      it.rounding += rounding::share<Scalar>(rounding::terms(N, static_cast<int>(count))) *
                     magnitude(multipliers, Vector<Scalar, N>(it.center.cwiseAbs2()));
    }
    it.barrier = by_volume() ? Scalar(Scalar(2) * scalar::log(Scalar(it.root.diagonal().prod())))
                             : Scalar(Scalar(N) * scalar::log(Scalar(it.inverse.cwiseProduct(weight).sum())));
    it.size = Scalar(N) * scalar::log(Scalar(positive + it.rounding)) + it.barrier;
    return Status::ok;
  }

  /// V with ∇F = s − tr(V A): A⁻¹, or N A⁻¹WA⁻¹/tr(WA⁻¹).
  void gradient(const Iterate& it, Matrix<Scalar, N>& v, Multipliers& result) const noexcept {
    const Matrix<Scalar, N>& x = it.inverse;
    if (by_volume()) {
      v = x;
    } else {
      const Matrix<Scalar, N> half = product_by_columns(x, weight);
      v = product_by_columns(half, x);
      v *= Scalar(N) / half.trace();
    }
    for (std::size_t k = 0; k < count; ++k) {
      result[k] =
          it.slack[k] -
          (is_ball(k) ? v.trace() : constraints[k].with([&v](const auto& q) { return trace_of_product(q.a, v); }));
    }
  }

  /// ∇²F, the lower triangle, in rows of length `most`: tr(A⁻¹AⱼA⁻¹Aₖ) + 2 rⱼᵀA⁻¹rₖ with rₖ = Aₖû + gₖ for the volume;
  /// for the trace 2 tr(A⁻¹AⱼVAₖ) − tr(VAⱼ) tr(VAₖ)/N + 2 rⱼᵀA⁻¹rₖ.
  void hessian(const Iterate& it, const Matrix<Scalar, N>& v, const Multipliers& gradient,
               Scalar* result) const noexcept {
    const Matrix<Scalar, N>& x = it.inverse;
    const Matrix<Scalar, lead> x_corner = corner<lead>(x);
    const Matrix<Scalar, lead> v_corner = corner<lead>(v);
    std::array<Matrix<Scalar, lead>, most> z_corner;  // the first corner of A⁻¹AₖV
    std::array<Vector<Scalar, N>, most> r;            // rₖ, its first numbers of leading ones
    std::array<Vector<Scalar, lead>, most> t_head;    // the first numbers of A⁻¹rₖ
    // A⁻¹AⱼV, of a constraint that is neither leading nor the ball. GCC would not see that nothing else reads it.
    Matrix<Scalar, N> z = Matrix<Scalar, N>::Zero();
    for (std::size_t j = 0; j < count; ++j) {
      const Constraint<Scalar, N>& constraint = constraints[j];
      Vector<Scalar, N> t;  // A⁻¹rⱼ
      if (is_leading(j)) {
        const Matrix<Scalar, lead> half = x_corner.lazyProduct(constraint.part.a);
        z_corner[j].noalias() = half.lazyProduct(v_corner);
        const Vector<Scalar, lead> own =
            constraint.part.a.lazyProduct(it.center.template head<lead>()) + constraint.part.g;
        r[j].template head<lead>() = own;
        t.noalias() = x.template leftCols<lead>().lazyProduct(own);
      } else if (is_ball(j)) {
        z_corner[j].noalias() = x.template topRows<lead>().lazyProduct(v.template leftCols<lead>());
        r[j] = it.center;
        t.noalias() = x.lazyProduct(it.center);
      } else {
        put_product(x, constraint.quadric.a, v, z);
        z_corner[j] = corner<lead>(z);
        r[j] = constraint.quadric.a.lazyProduct(it.center) + constraint.quadric.g;
        t.noalias() = x.lazyProduct(r[j]);
      }
      t_head[j] = t.template head<lead>();
      for (std::size_t k = 0; k <= j; ++k) {
        Scalar entry;
        Scalar inner;
        if (is_leading(j) || is_leading(k)) {
          const std::size_t one = is_leading(j) ? j : k;
          const std::size_t other = is_leading(j) ? k : j;
          entry = trace_of_product(constraints[one].part.a, z_corner[other]);
          inner = r[one].template head<lead>().dot(t_head[other]);
        } else {
          entry = is_ball(j)   ? Scalar(x.cwiseProduct(v).sum())
                  : is_ball(k) ? z.trace()
                               : trace_of_product(constraints[k].quadric.a, z);
          inner = r[k].dot(t);
        }
        if (!by_volume()) {
          entry += entry - (it.slack[j] - gradient[j]) * (it.slack[k] - gradient[k]) / Scalar(N);
        }
        result[j * most + k] = entry + Scalar(2) * inner;
      }
    }
  }

  /// ∂²F/∂μₖ² less its part along μ, for which ∇²F μ = tr(VA): the least that it can be for the volume, where an A of
  /// rank m has tr(A⁻¹AₖA⁻¹Aₖ) ≥ tr(A⁻¹Aₖ)²/m, and an estimate for the trace. The ball's is exact.
  [[nodiscard]] Scalar least_curvature(std::size_t k, const Iterate& it, const Matrix<Scalar, N>& v,
                                       const Multipliers& gradient) const noexcept {
    const Scalar trace = it.slack[k] - gradient[k];
    const Scalar along = trace * trace / Scalar(N);
    if (is_ball(k)) {
      const Scalar square = it.inverse.cwiseProduct(v).sum();
      return (by_volume() ? Scalar(square - along) : Scalar(Scalar(2) * (square - along))) +
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

  [[nodiscard]] bool is_leading(std::size_t k) const noexcept { return lead < N && constraints[k].leading; }

  /// tr(W Aₖ), for the volume tr Aₖ.
  [[nodiscard]] Scalar weighted_trace(std::size_t k) const noexcept {
    return constraints[k].with(
        [this](const auto& q) { return by_volume() ? Scalar(q.a.trace()) : trace_of_product(q.a, weight); });
  }

 private:
  /// X A V.
  ELLIPTUDE_OUT_OF_LINE static void put_product(const Matrix<Scalar, N>& x, const Matrix<Scalar, N>& a,
                                                const Matrix<Scalar, N>& v, Matrix<Scalar, N>& product) noexcept {
    put_product_by_columns(product_by_columns(x, a), v, product);
  }

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

}  // namespace detail

}  // namespace elliptude
