#pragma once

/// \file
/// Measured directions with bounds as cones of attitudes, and weighted sums of these cones. (theory, section 15)
///
/// "The directions eᵢ and b̃ᵢ are at most rᵢ apart in attitude C", ∠(Cᵀeᵢ, b̃ᵢ) ≤ rᵢ, is a cone. With C = Ĉ C(q), q =
/// (w, x) a unit quaternion, it is exactly xᵀNᵢx − 2w dᵢᵀx ≤ sᵢ, and so is every sum of cones with weights μᵢ ≥ 0. With
/// any weights the sum holds all attitudes that the cones have in common; the weights only decide how small the
/// ellipsoid is.
///
/// Rounding is on the safe side throughout: an attitude that satisfies every cone is in the resulting set, and data
/// that are called contradictory are so. This widens the set by a few roundings of the directions.

#include "elliptude/attitude/chart.hpp"
#include "elliptude/attitude/detail/weight_search.hpp"
#include "elliptude/attitude/wahba.hpp"
#include "elliptude/base/limits.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/eigen.hpp"
#include "elliptude/linear/svd.hpp"

namespace elliptude {

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

/// Cones added up with weights, the largest of which counts as one: the attitudes Ĉ C(q), q = (w, x), with xᵀNx − 2w
/// Dᵀx ≤ R. (eq. 15.4)
template <typename Scalar>
struct ConeSum {
  Matrix3<Scalar> attitude;   ///< Ĉ
  Matrix3<Scalar> curvature;  ///< N, less what rounding may have added
  Vector3<Scalar> slope;      ///< D, zero to rounding, as Ĉ is the Wahba solution
  Scalar level;               ///< R, with what rounding may have taken
  Scalar margin;              ///< see `WahbaSet`
};

/// The smallest ellipsoid, in the chart's coordinates, about a sum of cones. (eqs. 15.6 to 15.8)
/// \return `empty_intersection` if no attitude satisfies the sum, which is a proof that some bound is wrong;
/// `unbounded` if half turns about Ĉ satisfy it, so that it reaches beyond every chart, or if rounding hides whether
/// they do.
template <typename Chart, typename Scalar>
[[nodiscard]] Status bounding_ellipsoid(const ConeSum<Scalar>& sum, Ellipsoid<Scalar, 3>& ellipsoid) noexcept {
  SymmetricEigen<Scalar, 3> eigen;
  if (const Status status = symmetric_eigen(sum.curvature, eigen); status != Status::ok) {
    return status;
  }
  const EigenErrors<Scalar> errors = eigen_errors(sum.curvature, eigen);
  eigen.values.array() -= errors.values;
  const Scalar least = eigen.values(2);
  const Vector3<Scalar> slope = eigen.vectors.transpose() * sum.slope;
  // √(Dᵀ(N + tI)⁻¹D), and what the rounding of the eigenvectors can add to it.
  const auto slope_norm = [&](const Scalar& t) {
    const Vector3<Scalar> scaled = slope.cwiseQuotient((eigen.values.array() + t).sqrt().matrix());
    return Scalar(scaled.norm() + (rounding::share<Scalar>(rounding::cone_slope) + errors.vectors) * slope.norm() /
                                      scalar::sqrt(Scalar(least + t)));
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
  const Scalar finest = rounding::square<Scalar>() * least;
  const Scalar found = (Scalar(1) + rounding::share<Scalar>(rounding::cone_radius)) * radius * radius;
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
  // The axes, and the entries of the product, err by a share of the longest.
  lengths.array() += (rounding::share<Scalar>(rounding::cone_axes) + Scalar(2) * errors.vectors) * lengths(2);
  const Matrix3<Scalar> shape = eigen.vectors * lengths.asDiagonal() * eigen.vectors.transpose();
  ellipsoid.center = Vector3<Scalar>::Zero();
  ellipsoid.shape = symmetrized(shape);
  return Status::ok;
}

/// Measured directions, each with a bound of its error.
template <typename Scalar>
class DirectionCones {
 public:
  static constexpr std::size_t most_directions = elliptude::most_directions;
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
      // Unit vectors in the computer, seen through an attitude that is nearly a rotation, are within a few roundings of
      // the true ones: this is added to the bound. (theory, 15.7)
      const Scalar sine = scalar::sin(Scalar((r + rounding::share<Scalar>(rounding::direction)) / Scalar(2)));
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

  /// The sum of the cones about the Wahba solution for the weights, which count as shares of the largest.
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
    // Shares of the largest: no sum overflows, and what underflows is far below what rounding is allowed.
    // (theory, 15.7)
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

  /// Weights that make the ellipsoid of the Gibbs chart about the solution for `weights_by_bound` small: at most twelve
  /// Newton steps in log μ from there, each of which makes it smaller. If half turns are in the set for the first
  /// weights, it looks for others that exclude them. Any weights give a valid set, so nothing depends on how far the
  /// search got. If a sum of cones on the way proves that the data contradict each other, it ends with those weights.
  /// (theory, 15.6)
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

  /// A bound of the relative rounding of the sums in `add_up`, and of everything computed from them.
  [[nodiscard]] Scalar rounding() const noexcept {
    return rounding::share<Scalar>(rounding::cone_sum(static_cast<int>(count_)));
  }

  std::array<Vector3<Scalar>, most_directions> reference_;
  std::array<Vector3<Scalar>, most_directions> body_;
  std::array<Scalar, most_directions> width_;  // 2 sin²(rᵢ/2)
  std::size_t count_ = 0;
};

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

}  // namespace elliptude
