#pragma once

/// \file
/// All attitudes that agree with measured directions, when the error of each is bounded by an angle: an ellipsoid that contains
/// them, without linearization, for errors of any size. (theory, section 15)
///
/// "The directions eᵢ and b̃ᵢ are at most rᵢ apart in attitude C", ∠(Cᵀeᵢ, b̃ᵢ) ≤ rᵢ, is a cone. With C = Ĉ C(q), q = (w, x) a unit
/// quaternion, it is exactly xᵀNᵢx − 2w dᵢᵀx ≤ sᵢ, and so is every sum of cones with weights μᵢ ≥ 0. Whatever the weights, the
/// sum holds all attitudes that the cones have in common; which weights are taken decides only how small the ellipsoid is.
///
/// Rounding is on the safe side throughout: an attitude that satisfies every cone is in the set that comes out, and data
/// that are called contradictory are so. What that adds to the set is of the size of a few roundings of the directions.

#include "elliptude/attitude/chart.hpp"
#include "elliptude/attitude/wahba.hpp"
#include "elliptude/sets/quadric.hpp"

namespace elliptude {

/// An ellipsoid of attitude errors about an attitude, both the result of directions with bounds.
template <typename Scalar>
struct WahbaSet {
  Matrix3<Scalar> attitude;    ///< Ĉ, the Wahba solution for the weights
  Ellipsoid<Scalar, 3> error;  ///< of the chart's coordinates about Ĉ; its center is zero
  Scalar margin;               ///< R as a share of Σ μᵢ 2 sin²(rᵢ/2): 1 for directions that fit exactly
};

/// Which ellipsoid the weights are chosen for.
enum class WahbaCriterion : std::uint8_t { trace, volume };

namespace detail {

/// The squared length of the coordinates of a turn by θ, from sin²(θ/2) and cos²(θ/2).
template <typename Scalar>
[[nodiscard]] Scalar squared_length(ExponentialChart, const Scalar& sine_square, const Scalar& cosine_square) noexcept {
  const Scalar half_angle = scalar::atan2(scalar::sqrt(sine_square), scalar::sqrt(cosine_square));
  return Scalar(4) * half_angle * half_angle;
}
template <typename Scalar>
[[nodiscard]] Scalar squared_length(GibbsChart, const Scalar& sine_square, const Scalar& cosine_square) noexcept {
  return Scalar(4) * sine_square / cosine_square;
}

}  // namespace detail

/// Cones added up with weights, the largest of which counts as one: the attitudes Ĉ C(q), q = (w, x), with xᵀNx − 2w Dᵀx ≤ R. (eq. 15.4)
template <typename Scalar>
struct ConeSum {
  Matrix3<Scalar> attitude;   ///< Ĉ
  Matrix3<Scalar> curvature;  ///< N, less what rounding may have added
  Vector3<Scalar> slope;      ///< D, zero to rounding, as Ĉ is the Wahba solution
  Scalar level;               ///< R, with what rounding may have taken
  Scalar margin;              ///< see `WahbaSet`
};

/// The ellipsoid of the chart's coordinates that a sum of cones is bounded by; the smallest there is about it. (eqs. 15.6, 15.7)
/// \return `empty_intersection` if no attitude satisfies the sum, which is a proof that some bound is wrong; `unbounded` if half
/// turns about Ĉ satisfy it, so that it reaches beyond every chart, or rounding cannot tell.
template <typename Chart, typename Scalar>
[[nodiscard]] Status bounding_ellipsoid(const ConeSum<Scalar>& sum, Ellipsoid<Scalar, 3>& ellipsoid) noexcept {
  const Scalar epsilon(scalar::epsilon<Scalar>);
  SymmetricEigen<Scalar, 3> eigen;
  if (const Status status = symmetric_eigen(sum.curvature, eigen); status != Status::ok) {
    return status;
  }
  const Scalar least = eigen.values(2);
  const Vector3<Scalar> slope = eigen.vectors.transpose() * sum.slope;
  // √(Dᵀ(N + tI)⁻¹D), and what the rounding of the eigenvectors can add to it.
  const auto slope_norm = [&](const Scalar& t) {
    const Vector3<Scalar> scaled = slope.cwiseQuotient((eigen.values.array() + t).sqrt().matrix());
    return Scalar(scaled.norm() + Scalar(32) * epsilon * slope.norm() / scalar::sqrt(Scalar(least + t)));
  };
  if (sum.level < Scalar(0) && least > sum.level) {
    const Scalar d = slope_norm(-sum.level);
    if (d * d < -sum.level) {
      return Status::empty_intersection;
    }
  }
  if (!(least > Scalar(0))) {
    return Status::unbounded;
  }
  // |w| ≤ 1 turns the linear term into ‖x‖_N ≤ δ + √(δ² + R).
  const Scalar delta = slope_norm(Scalar(0));
  const Scalar square = delta * delta + sum.level;
  const Scalar radius = delta + scalar::sqrt(scalar::select(square > Scalar(0), square, Scalar(0)));
  // No attitude in the computer is known better than to ε, and a set has a width: not less than that of sin φ = ε.
  const Scalar finest = epsilon * epsilon * least;
  const Scalar found = (Scalar(1) + Scalar(16) * epsilon) * radius * radius;
  const Scalar level = scalar::select(found > finest, found, finest);
  if (!(level < least)) {
    return Status::unbounded;
  }
  Vector3<Scalar> lengths;
  for (int j = 0; j < 3; ++j) {
    const Scalar value = eigen.values(j);
    lengths(j) = detail::squared_length(Chart(), Scalar(level / value), Scalar((value - level) / value));
  }
  if (!scalar::all_finite(lengths)) {
    return Status::unbounded;
  }
  // The entries of the product err by a share of the longest axis.
  lengths.array() += Scalar(64) * epsilon * lengths(2);
  const Matrix3<Scalar> shape = eigen.vectors * lengths.asDiagonal() * eigen.vectors.transpose();
  ellipsoid.center = Vector3<Scalar>::Zero();
  ellipsoid.shape = symmetrized(shape);
  return Status::ok;
}

/// Measured directions, each with a bound of its error.
template <typename Scalar>
class DirectionCones {
 public:
  static constexpr std::size_t most_directions = 32;
  using Weights = std::array<Scalar, most_directions>;

  /// \param reference 3 × m, directions eᵢ in reference axes, of any length.
  /// \param body 3 × m, b̃ᵢ, the same directions as measured in body axes.
  /// \param bounds m angles rᵢ, rad, between 0 and π.
  /// \return `not_finite`; `zero_direction`; `out_of_range` of a bound, if the sizes differ, or of more than
  /// `most_directions` or none.
  template <typename Reference, typename Body, typename Bounds>
  [[nodiscard]] static Status make(const Eigen::MatrixBase<Reference>& reference, const Eigen::MatrixBase<Body>& body,
                                   const Eigen::MatrixBase<Bounds>& bounds, DirectionCones& cones) noexcept {
    const Eigen::Index m = reference.cols();
    if (reference.rows() != 3 || body.rows() != 3 || body.cols() != m || bounds.size() != m || m == 0 ||
        m > static_cast<Eigen::Index>(most_directions)) {
      return Status::out_of_range;
    }
    DirectionCones result;
    result.count_ = static_cast<std::size_t>(m);
    for (std::size_t i = 0; i < result.count_; ++i) {
      const auto column = static_cast<Eigen::Index>(i);
      const Vector3<Scalar> e = reference.col(column);
      const Vector3<Scalar> b = body.col(column);
      const Scalar r = bounds(column);
      if (!scalar::all_finite(e) || !scalar::all_finite(b) || !scalar::isfinite(r)) {
        return Status::not_finite;
      }
      if (!(r > Scalar(0)) || !(r < scalar::pi<Scalar>())) {
        return Status::out_of_range;
      }
      result.reference_[i] = scalar::unit(e);
      result.body_[i] = scalar::unit(b);
      if (!(result.reference_[i].squaredNorm() > scalar::constant<Scalar>(0.5L)) ||
          !(result.body_[i].squaredNorm() > scalar::constant<Scalar>(0.5L))) {
        return Status::zero_direction;
      }
      // Unit vectors in the computer, seen through an attitude that is nearly a rotation, are within a few roundings of the
      // true ones: so much is added to the bound. (theory, 15.7)
      const Scalar sine = scalar::sin(Scalar((r + Scalar(16) * Scalar(scalar::epsilon<Scalar>)) / Scalar(2)));
      result.width_[i] = Scalar(2) * sine * sine;
    }
    cones = result;
    return Status::ok;
  }

  [[nodiscard]] std::size_t count() const noexcept { return count_; }

  /// Weights that count each cone by its width, 1/(1 − cos rᵢ), the largest of them 1.
  [[nodiscard]] Weights weights_by_bound() const noexcept {
    Scalar least = width_[0];
    for (std::size_t i = 1; i < count_; ++i) {
      least = width_[i] < least ? width_[i] : least;
    }
    Weights weights{};
    for (std::size_t i = 0; i < count_; ++i) {
      weights[i] = least / width_[i];
    }
    return weights;
  }

  /// The cones added up about the Wahba solution for the weights, whatever these are: as shares of the largest.
  /// \return `not_finite`; `out_of_range` if a weight is negative or all are zero.
  [[nodiscard]] Status add_up(const Weights& weights, ConeSum<Scalar>& sum) const noexcept {
    Scalar largest(0);
    for (std::size_t i = 0; i < count_; ++i) {
      if (!scalar::isfinite(weights[i])) {
        return Status::not_finite;
      }
      if (!(weights[i] >= Scalar(0))) {
        return Status::out_of_range;
      }
      largest = weights[i] > largest ? weights[i] : largest;
    }
    if (!(largest > Scalar(0))) {
      return Status::out_of_range;
    }
    // Shares of the largest: no sum overflows, and what underflows is far below what rounding is allowed. (theory, 15.7)
    Weights share{};
    Scalar total(0);
    Matrix3<Scalar> profile = Matrix3<Scalar>::Zero();
    for (std::size_t i = 0; i < count_; ++i) {
      share[i] = weights[i] / largest;
      total += share[i];
      profile += profile_term(share[i], reference_[i], body_[i]);
    }
    ConeSum<Scalar> result;
    result.attitude = Matrix3<Scalar>::Identity();
    RotationSvd<Scalar> svd;
    // Any rotation is a center for which the sum is exact. The solution is the best, where there is one.
    if (rotation_svd(profile, svd) == Status::ok) {
      result.attitude = renormalized(Matrix3<Scalar>(svd.u * svd.v.transpose()));
    }
    result.curvature.setZero();
    result.slope.setZero();
    Scalar width(0);
    Scalar misfit(0);
    for (std::size_t i = 0; i < count_; ++i) {
      const Seen cone = seen_from(result.attitude, i);
      result.curvature += share[i] * cone.curvature;
      result.slope += share[i] * cone.slope;
      width += share[i] * width_[i];
      misfit += share[i] * cone.misfit;
    }
    result.curvature.diagonal().array() -= rounding() * total;
    result.level = (Scalar(1) + rounding()) * width - (Scalar(1) - rounding()) * misfit;
    result.margin = (width - misfit) / width;
    sum = result;
    return Status::ok;
  }

  /// Weights that make the ellipsoid of the Gibbs chart about the solution for `weights_by_bound` small: at most twelve Newton
  /// steps in log μ from there, each of which makes it smaller. If half turns are in the set for the first weights, it looks
  /// for others that exclude them. Any weights give a valid set, so nothing depends on how far the search came. If cones
  /// added up prove on the way that the data contradict each other, it ends with those weights. (theory, 15.6)
  [[nodiscard]] Weights minimal_weights(const Matrix3<Scalar>& attitude, WahbaCriterion criterion) const noexcept;

 private:
  /// One cone about an attitude: xᵀNx − 2w dᵀx ≤ 2 sin²(r/2) − misfit.
  struct Seen {
    Matrix3<Scalar> curvature;
    Vector3<Scalar> slope;
    Scalar misfit;
  };

  [[nodiscard]] Seen seen_from(const Matrix3<Scalar>& attitude, std::size_t i) const noexcept {
    const Vector3<Scalar> predicted = attitude.transpose() * reference_[i];
    const Vector3<Scalar> difference = predicted - body_[i];
    const Matrix3<Scalar> product = predicted * body_[i].transpose();
    Seen seen;
    seen.misfit = scalar::constant<Scalar>(0.5L) * difference.squaredNorm();
    seen.curvature = -(product + product.transpose());
    seen.curvature.diagonal().array() += Scalar(2) * predicted.dot(body_[i]);
    seen.slope = body_[i].cross(difference);
    return seen;
  }

  /// A bound of the relative rounding of the sums in `add_up`, and of all that follows from them.
  [[nodiscard]] Scalar rounding() const noexcept {
    return Scalar(static_cast<int>(4 * count_ + 160)) * Scalar(scalar::epsilon<Scalar>);
  }

  std::array<Vector3<Scalar>, most_directions> reference_;
  std::array<Vector3<Scalar>, most_directions> body_;
  std::array<Scalar, most_directions> width_;  // 2 sin²(rᵢ/2)
  std::size_t count_ = 0;
};

namespace detail {

/// The cones as quadrics in γ about a fixed attitude, and their combinations A, g, c with weights μ: as in fusion, centre −A⁻¹g and
/// shape N A⁻¹. The search minimises N + τ, where τ is tr A⁻¹ or 3 det(A)^(−1/3): convex in μ, and at the best scale of μ twice the
/// root of the size N τ, which does not depend on the scale. (theory, 15.6)
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
    if (cholesky(a, l) != Status::ok) {
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

  /// The Newton step in log μ, with the weights and the point brought to the best scale; where N + τ falls with μₖ its gradient is
  /// left out of the Hessian, which so stays positive.
  /// \param decrease what the step promises, as a share of N + τ.
  [[nodiscard]] bool newton_step(Weights& weights, const Scalar& shift, Point& point, Weights& move,
                                 Scalar& decrease) const noexcept {
    const Scalar scale = scalar::sqrt(Scalar(point.spread / point.level));
    for (std::size_t k = 0; k < count; ++k) {
      weights[k] *= scale;
    }
    point.root /= scalar::sqrt(scale);
    point.level *= scale;
    point.spread /= scale;

    // The Hessian in μ is that of J Jᵀ with rows of thirteen entries.
    std::array<Vector<Scalar, 13>, most> rows;
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

    // (J Jᵀ + diag) move = −gradient, by Cholesky's method.
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
};

}  // namespace detail

template <typename Scalar>
typename DirectionCones<Scalar>::Weights DirectionCones<Scalar>::minimal_weights(
    const Matrix3<Scalar>& attitude, WahbaCriterion criterion) const noexcept {
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar quarter = scalar::constant<Scalar>(0.25L);
  detail::WeightSearch<Scalar, most_directions> search;
  search.count = count_;
  search.criterion = criterion;
  for (std::size_t i = 0; i < count_; ++i) {
    const Seen cone = seen_from(attitude, i);
    Quadric<Scalar, 3>& quadric = search.quadrics[i];
    quadric.c = width_[i] - cone.misfit;
    quadric.g = -half * cone.slope;
    quadric.a = quarter * cone.curvature;
    quadric.a.diagonal().array() -= quarter * (quadric.c + rounding());
    search.lift[i] = quarter * (width_[i] + rounding());
  }
  Weights weights = search.run(weights_by_bound());
  Scalar largest(0);
  for (std::size_t i = 0; i < count_; ++i) {
    largest = weights[i] > largest ? weights[i] : largest;
  }
  for (std::size_t i = 0; i < count_; ++i) {
    weights[i] /= largest;
  }
  return weights;
}

/// Directions within their bounds, added up with given weights: everything that `wahba_set` knows, also where it finds no set.
/// \return what `DirectionCones::make` and `add_up` say; `out_of_range` if the number of weights differs.
template <typename Reference, typename Body, typename Bounds, typename Weights>
[[nodiscard]] Status cone_sum(const Eigen::MatrixBase<Reference>& reference, const Eigen::MatrixBase<Body>& body,
                              const Eigen::MatrixBase<Bounds>& bounds, const Eigen::MatrixBase<Weights>& weights,
                              ConeSum<typename Reference::Scalar>& sum) noexcept {
  using Scalar = typename Reference::Scalar;
  DirectionCones<Scalar> cones;
  if (const Status status = DirectionCones<Scalar>::make(reference, body, bounds, cones); status != Status::ok) {
    return status;
  }
  if (weights.size() != reference.cols()) {
    return Status::out_of_range;
  }
  typename DirectionCones<Scalar>::Weights chosen{};
  for (std::size_t i = 0; i < cones.count(); ++i) {
    chosen[i] = weights(static_cast<Eigen::Index>(i));
  }
  return cones.add_up(chosen, sum);
}

/// An ellipsoid that contains every attitude for which each direction is within its bound: the smallest about what the directions
/// say, added up with the weights.
/// \tparam Chart `ExponentialChart` or `GibbsChart`, in whose coordinates the ellipsoid is.
/// \param reference 3 × m, directions in reference axes, of any length; m is at most 32.
/// \param body 3 × m, the same directions as measured in body axes.
/// \param bounds m angles between 0 and π, rad: the measured direction is at most so far from the true one.
/// \param weights m numbers of any magnitude, not negative, not all zero: they count as shares of the largest. A direction with
/// weight zero is not used.
/// \return what `cone_sum` says; `empty_intersection`, a proof that some bound is wrong; `unbounded` if half turns about the
/// attitude cannot be excluded, as with one direction, collinear ones, or very large bounds.
template <typename Chart, typename Reference, typename Body, typename Bounds, typename Weights>
[[nodiscard]] Status wahba_set(const Eigen::MatrixBase<Reference>& reference, const Eigen::MatrixBase<Body>& body,
                               const Eigen::MatrixBase<Bounds>& bounds, const Eigen::MatrixBase<Weights>& weights,
                               WahbaSet<typename Reference::Scalar>& set) noexcept {
  using Scalar = typename Reference::Scalar;
  ConeSum<Scalar> sum;
  if (const Status status = cone_sum(reference, body, bounds, weights, sum); status != Status::ok) {
    return status;
  }
  Ellipsoid<Scalar, 3> error;
  if (const Status status = bounding_ellipsoid<Chart>(sum, error); status != Status::ok) {
    return status;
  }
  set = {sum.attitude, error, sum.margin};
  return Status::ok;
}

/// The set for weights that make it small, by `DirectionCones::minimal_weights`; never larger than for weights of 1/(1 − cos rᵢ).
/// \param weights m numbers that come out: the weights, the largest of them 1.
/// \return as `wahba_set`; `unbounded` if no weights that exclude half turns were found.
template <typename Chart, typename Reference, typename Body, typename Bounds, typename Weights>
[[nodiscard]] Status minimal_wahba_set(const Eigen::MatrixBase<Reference>& reference,
                                       const Eigen::MatrixBase<Body>& body, const Eigen::MatrixBase<Bounds>& bounds,
                                       WahbaCriterion criterion, Eigen::MatrixBase<Weights>& weights,
                                       WahbaSet<typename Reference::Scalar>& set) noexcept {
  using Scalar = typename Reference::Scalar;
  DirectionCones<Scalar> cones;
  if (const Status status = DirectionCones<Scalar>::make(reference, body, bounds, cones); status != Status::ok) {
    return status;
  }
  if (weights.size() != reference.cols()) {
    return Status::out_of_range;
  }
  typename DirectionCones<Scalar>::Weights chosen = cones.weights_by_bound();
  ConeSum<Scalar> sum;
  if (const Status status = cones.add_up(chosen, sum); status != Status::ok) {
    return status;
  }
  Ellipsoid<Scalar, 3> error;
  const Status first = bounding_ellipsoid<Chart>(sum, error);
  if (first != Status::ok && first != Status::unbounded) {
    return first;
  }
  const auto other_weights = cones.minimal_weights(sum.attitude, criterion);
  ConeSum<Scalar> other_sum;
  Ellipsoid<Scalar, 3> other_error;
  Status other = cones.add_up(other_weights, other_sum);
  if (other == Status::ok) {
    other = bounding_ellipsoid<Chart>(other_sum, other_error);
  }
  if (other == Status::empty_intersection) {
    return other;
  }
  const auto size = [criterion](const Matrix3<Scalar>& shape) {
    return criterion == WahbaCriterion::trace ? Scalar(shape.trace()) : Scalar(shape.determinant());
  };
  if (other == Status::ok && (first != Status::ok || size(other_error.shape) < size(error.shape))) {
    chosen = other_weights;
    sum = other_sum;
    error = other_error;
  } else if (first != Status::ok) {
    return first;
  }
  for (std::size_t i = 0; i < cones.count(); ++i) {
    weights(static_cast<Eigen::Index>(i)) = chosen[i];
  }
  set = {sum.attitude, error, sum.margin};
  return Status::ok;
}

}  // namespace elliptude
