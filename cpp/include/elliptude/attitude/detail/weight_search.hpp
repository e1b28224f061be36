#pragma once

/// \file
/// The search for weights of cones that make the ellipsoid about their sum small. (theory, 15.6)

#include "elliptude/linear/cholesky.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/quadric.hpp"

namespace elliptude {

/// The criterion for which the weights are chosen.
enum class WahbaCriterion : std::uint8_t { trace, volume };

namespace detail {

/// The cones as quadrics in γ about a fixed attitude, and their combinations A, g, c with weights μ: as in fusion,
/// centre −A⁻¹g and shape N A⁻¹. The search minimises N + τ, where τ is tr A⁻¹ or 3 det(A)^(−1/3): convex in μ, and at
/// the best scale of μ twice the root of the size N τ, which does not depend on the scale. (theory, 15.6)
template <typename Scalar, std::size_t most>
class WeightSearch {
 public:
  using Weights = std::array<Scalar, most>;

  std::array<Quadric<Scalar, 3>, most> quadrics;
  std::array<Scalar, most> lift;  ///< Aₖ + lift I is positive semidefinite
  std::size_t count;
  WahbaCriterion criterion;

  [[nodiscard]] Weights run(const Weights& start) noexcept {
    constexpr int most_steps = 12;
    const Scalar tolerance = scalar::constant<Scalar>(1e-3L);
    Weights weights = start;
    Scalar shift(0);
    Point point;
    if (!evaluate(weights, shift, point)) {
      shift = scalar::constant<Scalar>(1.01L);
      if (!evaluate(weights, shift, point)) {
        return start;
      }
    }
    for (int step = 0; step < most_steps; ++step) {
      // Where A is not positive definite the search starts with a part of the lifts added, which it then takes away.
      for (const long double share : {0.0L, 0.5L, 0.8L}) {
        if (shift > Scalar(0) && evaluate(weights, Scalar(scalar::constant<Scalar>(share) * shift), point)) {
          shift *= scalar::constant<Scalar>(share);
          break;
        }
      }
      if (!(point.level > Scalar(0))) {
        return weights;
      }
      Weights move;
      Scalar decrease;
      if (!newton_step(weights, shift, point, move, decrease) || (decrease <= tolerance && !(shift > Scalar(0)))) {
        return weights;
      }
      Weights next;
      Point next_point;
      bool better = false;
      constexpr int most_halvings = 6;
      Scalar length(1);
      for (int halving = 0; halving < most_halvings && !better; ++halving) {
        for (std::size_t k = 0; k < count; ++k) {
          next[k] = weights[k] * scalar::exp(Scalar(length * move[k]));
        }
        better = evaluate(next, shift, next_point) && next_point.level * next_point.spread < point.level * point.spread;
        length *= scalar::constant<Scalar>(0.5L);
      }
      if (!better) {
        return weights;
      }
      weights = next;
      point = next_point;
    }
    return weights;
  }

 private:
  struct Point {
    Matrix3<Scalar> root;  // X with A⁻¹ = XᵀX
    Vector3<Scalar> center;
    Weights slack;
    Scalar level;   // N
    Scalar spread;  // τ
  };

  [[nodiscard]] Matrix3<Scalar> matrix(std::size_t k, const Scalar& shift) const noexcept {
    Matrix3<Scalar> a = quadrics[k].a;
    a.diagonal().array() += shift * lift[k];
    return a;
  }

  /// Whether A is positive definite.
  [[nodiscard]] bool evaluate(const Weights& weights, const Scalar& shift, Point& point) const noexcept {
    Matrix3<Scalar> a = Matrix3<Scalar>::Zero();
    Vector3<Scalar> g = Vector3<Scalar>::Zero();
    for (std::size_t k = 0; k < count; ++k) {
      a += weights[k] * matrix(k, shift);
      g += weights[k] * quadrics[k].g;
    }
    Matrix3<Scalar> l;
    if (put_cholesky(a, l) != Status::ok) {
      return false;
    }
    point.root = lower_inverse(l);
    point.center = -(point.root.transpose() * Vector3<Scalar>(point.root * g));
    point.level = Scalar(0);
    for (std::size_t k = 0; k < count; ++k) {
      point.slack[k] = slack(quadrics[k], point.center) - shift * lift[k] * point.center.squaredNorm();
      point.level += weights[k] * point.slack[k];
    }
    if (criterion == WahbaCriterion::trace) {
      point.spread = point.root.squaredNorm();
    } else {
      const Scalar third = scalar::constant<Scalar>(2.0L / 3.0L);
      point.spread = Scalar(3) * scalar::exp(Scalar(third * scalar::log(Scalar(point.root.diagonal().prod()))));
    }
    return scalar::isfinite(point.level) && scalar::isfinite(point.spread);
  }

  /// The rows of J, where the Hessian in μ is J Jᵀ.
  using Rows = std::array<Vector<Scalar, 13>, most>;

  /// The Newton step in log μ, with the weights and the point brought to the best scale; where N + τ falls with μₖ its
  /// gradient is left out of the Hessian, which so stays positive.
  /// \param decrease what the step promises, as a share of N + τ.
  [[nodiscard]] bool newton_step(Weights& weights, const Scalar& shift, Point& point, Weights& move,
                                 Scalar& decrease) const noexcept {
    bring_to_best_scale(weights, point);
    Rows rows;
    Weights gradient;
    const Scalar root_two = scalar::sqrt(Scalar(2));
    for (std::size_t k = 0; k < count; ++k) {
      const Matrix3<Scalar> a = matrix(k, shift);
      const Matrix3<Scalar> whitened = point.root * a * point.root.transpose();
      const Vector3<Scalar> turn = point.root * Vector3<Scalar>(a * point.center + quadrics[k].g);
      Scalar slope;
      Matrix3<Scalar> spread_row;
      Scalar volume_row(0);
      if (criterion == WahbaCriterion::trace) {
        const Matrix3<Scalar> product = whitened * point.root;
        slope = -product.cwiseProduct(point.root).sum();
        spread_row = root_two * product;
      } else {
        const Scalar third = point.spread / Scalar(3);
        slope = -third * whitened.trace();
        spread_row = scalar::sqrt(third) * whitened;
        volume_row = scalar::sqrt(point.spread) / Scalar(3) * whitened.trace();
      }
      gradient[k] = weights[k] * (point.slack[k] + slope);
      for (int j = 0; j < 9; ++j) {
        rows[k](j) = weights[k] * spread_row(j);
      }
      rows[k].template segment<3>(9) = (weights[k] * root_two) * turn;
      rows[k](12) = weights[k] * volume_row;
    }
    if (!solve(rows, gradient, move)) {
      return false;
    }
    const Scalar longest(4);
    Scalar largest(0);
    decrease = Scalar(0);
    for (std::size_t k = 0; k < count; ++k) {
      const Scalar size = scalar::abs(move[k]);
      largest = size > largest ? size : largest;
      decrease -= gradient[k] * move[k] / (point.level + point.spread);
    }
    if (!scalar::isfinite(largest)) {
      return false;
    }
    if (largest > longest) {
      for (std::size_t k = 0; k < count; ++k) {
        move[k] *= longest / largest;
      }
    }
    return true;
  }

  void bring_to_best_scale(Weights& weights, Point& point) const noexcept {
    const Scalar scale = scalar::sqrt(Scalar(point.spread / point.level));
    for (std::size_t k = 0; k < count; ++k) {
      weights[k] *= scale;
    }
    point.root /= scalar::sqrt(scale);
    point.level *= scale;
    point.spread /= scale;
  }

  /// (J Jᵀ + diag) move = −gradient, with the gradient on the diagonal where it is positive, by Cholesky's method.
  [[nodiscard]] bool solve(const Rows& rows, const Weights& gradient, Weights& move) const noexcept {
    Scalar trace(0);
    for (std::size_t k = 0; k < count; ++k) {
      trace += rows[k].squaredNorm();
    }
    std::array<Weights, most> l;
    for (std::size_t j = 0; j < count; ++j) {
      for (std::size_t i = j; i < count; ++i) {
        Scalar entry = rows[i].dot(rows[j]);
        if (i == j) {
          entry += (gradient[j] > Scalar(0) ? gradient[j] : Scalar(0)) + scalar::constant<Scalar>(1e-6L) * trace;
        }
        for (std::size_t k = 0; k < j; ++k) {
          entry -= l[i][k] * l[j][k];
        }
        if (i == j) {
          if (!(entry > Scalar(0))) {
            return false;
          }
          l[j][j] = scalar::sqrt(entry);
        } else {
          l[i][j] = entry / l[j][j];
        }
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      Scalar entry = -gradient[i];
      for (std::size_t k = 0; k < i; ++k) {
        entry -= l[i][k] * move[k];
      }
      move[i] = entry / l[i][i];
    }
    for (std::size_t i = count; i-- > 0;) {
      Scalar entry = move[i];
      for (std::size_t k = i + 1; k < count; ++k) {
        entry -= l[k][i] * move[k];
      }
      move[i] = entry / l[i][i];
    }
    return true;
  }
};

}  // namespace detail

}  // namespace elliptude
