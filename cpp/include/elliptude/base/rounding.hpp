#pragma once

/// \file
/// How far rounding may move a guaranteed set, as multiples of ε, the distance from 1 to the next number, each with the
/// statement that it covers. They are derived in theory, section 17.8, and compared with running error bounds of the
/// same templates in tests/cpp/base/test_rounding.cpp. Shapes are bounded entry by entry: an entry (i, j) of a shape
/// may be wrong by a multiple of ε √(Pᵢᵢ Pⱼⱼ), however thin the set is in some direction, so a share of the whole shape
/// does not cover it; a share of its diagonal does.

#include "elliptude/base/scalar.hpp"

namespace elliptude::rounding {

/// Shapes and rotations. Each comment says what the multiple covers, and relative to what.
///@{
/// Angle of a product of two rotations, brought back to SO(3), from the exact one; and of the Cayley map before it.
inline constexpr int center = 24;
/// Angle of the turn from one rotation to another, each one to rounding (`rotation`), by the Gibbs vector of their
/// product.
inline constexpr int turn_between = 128;
/// Norm of the errors of `exp` and `right_jacobian` of a computed turn θ: this many ε, and this many ε θ more.
inline constexpr int turn = 32;
inline constexpr int turn_by_angle = 12;
/// Entries of T P Tᵀ in the norms of T's rows in P (`covered_congruence`), and what a Cholesky factorisation after it
/// needs.
inline constexpr int congruence = 48;
/// Entries of a sum of a few shapes with factors in the roots of its own diagonal, the factors themselves, and a
/// Cholesky factorisation after it.
inline constexpr int sum = 64;
/// A shape seen from another, relative to that and to the condition of the first, squared (`enclosing`).
inline constexpr int union_axes = 48;
/// A product of a few positive numbers.
inline constexpr int product = 64;
/// A sum of a dozen products of positive numbers, among them tan of at most 1.5.
inline constexpr int bound = 128;
/// Entries of CᵀC − I of a rotation that is one to rounding.
inline constexpr int rotation = 8;
///@}

/// The functions of base/elementary.hpp, in units of the last place of the result. Such a unit is at most ε of the
/// result. (theory, section 17.11)
///@{
inline constexpr double exp_units = 1.0;
inline constexpr double log_units = 1.5;
inline constexpr double sine_units = 1.1;  ///< sin and cos
inline constexpr double atan2_units = 1.7;
///@}

/// Linear algebra. (Higham, Accuracy and Stability; theory, sections 7.7 and 17.8)
///@{
/// More than a Cholesky factorisation of N rows loses, relative to each diagonal entry (theorem 10.7).
[[nodiscard]] constexpr int cholesky(int n) noexcept { return 2 * n * (n + 1); }
/// More than the error of an inverse by Cholesky's factor and of its square, relative to κ² times themselves (section
/// 14.2).
[[nodiscard]] constexpr int inverse(int n) noexcept { return 8 * n; }
/// First widening of a shape whose inverse has too few digits, relative to the trace.
[[nodiscard]] constexpr int inverse_widening(int n) noexcept { return 256 * n; }
/// Inner product of two columns at right angles, relative to the product of their lengths.
inline constexpr int right_angle = 4;
/// Loss of the variance of up to six squared singular values, relative to their mean.
inline constexpr int variance = 64;
/// A determinant, a sine or a ratio of eigenvalues up to this may be zero.
inline constexpr int singular = 8;
/// Reciprocal of the largest condition of Wahba's problem that leaves digits.
inline constexpr int condition = 64;
/// How far the principal moments of a flat body may break the triangle inequality, relative to the largest.
inline constexpr int moments = 64;
/// An inertia's own rounding to another scalar type and that of its moments, in norm, relative to the largest moment.
inline constexpr int inertia_cast = 4;
/// What the computed VᵀV − I of n eigenvectors, and AV − VΛ relative to ‖A‖, are off by in norm.
[[nodiscard]] constexpr int eigen_defect(int n) noexcept { return n * n / 2 + 2; }
[[nodiscard]] constexpr int eigen_residual(int n) noexcept { return 2 * n; }
///@}

/// Sums of ellipsoids, and their intersections. (theory, sections 7 and 16.6)
///@{
/// An entry of T P Tᵀ errs by at most 16 relative to √(mᵢmⱼ), m = (|T| √diag P)²; this much on the diagonal outweighs
/// that.
inline constexpr int image = 128;
/// A sum of up to 64 shapes, relative to its diagonal.
inline constexpr int many_terms = 128;
/// Entries of ½ (M + Mᵀ) for a sum M of two shapes.
inline constexpr int small_sum = 16;
/// Loss of an ellipsoid's quadric at its points, relative to |x̂|ᵀ|A||y|.
[[nodiscard]] constexpr int quadric(int n) noexcept { return 4 * n; }
/// Loss of a linear measurement of so many rows in the metric of its bound, and of its quadric, relative to the sums of
/// their terms without signs.
[[nodiscard]] constexpr int whitening(int rows) noexcept { return 2 * (rows + 2); }
/// A number up to this many ε has less than three right digits.
inline constexpr int three_digits = 1000;
/// Loss of a quadric in coordinates of N numbers, relative to the sum of its terms without signs, and of `count` of
/// them in a sum.
[[nodiscard]] constexpr int relaxation(int n, int count) noexcept { return 4 * (n + 4) + 2 * count; }
/// What the inversion of a combination adds to its level, relative to ‖A‖ times the reach of its set.
[[nodiscard]] constexpr int inversion(int n) noexcept { return 8 * (n + 2); }
/// Loss of the ball in a sum of `count` constraints, relative to its multiplier.
[[nodiscard]] constexpr int terms_of_ball(int count) noexcept { return 4 * count; }
/// Loss of a sum of `count` constraints at the center, relative to all terms without signs.
[[nodiscard]] constexpr int terms(int n, int count) noexcept { return 4 * (n + 4 + count); }
/// Loss of the product of two roots with N rows, relative to its diagonal.
[[nodiscard]] constexpr int root_product(int n) noexcept { return 4 * n * n; }
/// Loss of a sum of forms of up to seven rows, and of its factorization, relative to the sum of their largest entries:
/// with so many constraints beside the ball and the question at most.
inline constexpr int quotient = 256;
inline constexpr int most_in_quotient = 8;
/// A turn about an axis by the forms (16.7) and their products, relative to 1 + ‖g⁺‖² of the attitudes in the set.
inline constexpr int turn_forms = 40;
/// A component of a vector of three numbers, relative to the sum of its terms without signs.
inline constexpr int component = 4;
/// Half-width of a slab about an interval.
inline constexpr int slab = 2;
/// Differences this small in what the search for multipliers minimises are rounding.
inline constexpr int objective = 64;
/// Slopes of the logarithm of a size, relative to the number of coordinates, each of which adds at most one to the
/// terms that cancel.
inline constexpr int slope = 4;
///@}

/// Directions, attitudes and their cones. (theory, sections 15.7, 16.1 and 16.2)
///@{
/// Error of the angle between unit vectors, one seen through an attitude that is a rotation to rounding; also relative
/// to the angle.
inline constexpr int direction = 16;
/// The square of the angle of a direction's bound, relative to the bound's trace.
inline constexpr int direction_bound = 32;
/// A sum of `count` cones, relative to the weights.
[[nodiscard]] constexpr int cone_sum(int count) noexcept { return 4 * count + 48; }
/// The slope of a sum of cones in axes, relative to ‖D‖.
inline constexpr int cone_slope = 4;
/// The squared radius of a sum of cones, relative to itself.
inline constexpr int cone_radius = 16;
/// Entries of the ellipsoid about a sum of cones, relative to the longest axis.
inline constexpr int cone_axes = 16;
/// A cone's curvature, its level and its misfit, if its largest entries are of size one.
inline constexpr int cone_curvature = 32;
inline constexpr int cone_level = 8;
inline constexpr int cone_misfit = 32;
/// The overlap of two ellipsoids of three numbers whose diagonals were raised by a share √ε, in √ε.
inline constexpr int raised_overlap = 64;
/// The largest angle of a measured attitude, and the difference of a chart's stretch from one.
inline constexpr int attitude_angle = 16;
/// A measured attitude's center; and the products of its quadric, relative to their terms without signs.
inline constexpr int attitude_center = 64;
inline constexpr int attitude_products = 8;
///@}

/// Steps of a motion. (theory, section 4.3)
///@{
/// A time that is as near to the end of a step, beside the times that it is counted from, is that step's.
inline constexpr int steps = 16;
///@}

/// Predictions. (theory, sections 17.2 and 17.8)
///@{
/// Rate of the motion's series, relative to the largest rate, and to the sum of the terms of Euler's equations over a
/// step.
inline constexpr int series_rate = 32;
inline constexpr int series_change = 64;
/// Angle of the attitude at the end of a step.
inline constexpr int series_attitude = 32;
/// The linear part of an error tube, and its rate over a step.
inline constexpr int linear_part = 256;
inline constexpr int linear_rate = 128;
/// What the inverse in (17.19) may be too small by, relative to its trace times itself.
inline constexpr int enlarged_ball = 96;
/// Jω + h_w, and JX − I, relative to the sums of their terms without signs.
inline constexpr int momentum = 8;
/// A torque's expansion about an attitude, relative to its value and its derivative.
inline constexpr int local_torque = 64;
///@}

/// `multiple` ε.
template <typename Scalar>
[[nodiscard]] Scalar share(int multiple) noexcept {
  return Scalar(static_cast<scalar::Value<Scalar>>(multiple)) * Scalar(scalar::epsilon<Scalar>);
}

/// ε itself: what one rounding may be, relative to the number. Where no guarantee depends on it, what is smaller by this
/// factor counts as nothing: the end of an iteration, an entry beside the diagonal, an angle at rest.
template <typename Scalar>
[[nodiscard]] Scalar one_rounding() noexcept {
  return share<Scalar>(1);
}

/// Whether a time (s) is within 1/ε: from there on the numbers beside it are a second away or more. In `float` that is
/// after 97 days, in `double` never.
template <typename Scalar>
[[nodiscard]] bool tells_seconds(const Scalar& time) noexcept {
  return scalar::abs(time) * one_rounding<Scalar>() <= Scalar(1);
}

/// √ε: half of the digits.
template <typename Scalar>
[[nodiscard]] Scalar root() noexcept {
  return scalar::sqrt(Scalar(scalar::epsilon<Scalar>));
}

/// ε².
template <typename Scalar>
[[nodiscard]] Scalar square() noexcept {
  return one_rounding<Scalar>() * one_rounding<Scalar>();
}

/// Whether numbers have the precision of `float`, or less.
template <typename Scalar>
constexpr bool is_single = static_cast<double>(scalar::epsilon<Scalar>) > 1e-10;

/// A calculated bound, rounded up a little.
template <typename Scalar>
[[nodiscard]] Scalar enlarged(const Scalar& calculated, int multiple) noexcept {
  return calculated * (Scalar(1) + share<Scalar>(multiple));
}

/// Σ|xᵢⱼ| √pⱼ, row by row: |xᵢ·v| is at most this for all v with |vⱼ| ≤ √pⱼ, the diagonal of a shape.
template <typename Scalar>
[[nodiscard]] Vector3<Scalar> row_norms(const Matrix3<Scalar>& x, const Vector3<Scalar>& roots) noexcept {
  return x.cwiseAbs().lazyProduct(roots);
}

}  // namespace elliptude::rounding

namespace elliptude {

/// T P Tᵀ for T = [[x, y], [0, I]], as a shape whose ellipsoid contains T E(0, P) whatever rounding does to it. With mᵢ
/// = Σⱼ |Tᵢⱼ| √Pⱼⱼ an entry of the attitude's block errs by at most 4.5 ε mᵢ mⱼ, one of the mixed block by 2 ε mᵢ √Pⱼⱼ,
/// and the vector's block is exact; |Σ Eᵢⱼ vᵢ vⱼ| is then at most 19.5 ε Σ mᵢ² vᵢ² + 6 ε Σ Pⱼⱼ vⱼ².
/// (theory, section 17.8)
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> covered_congruence(const Matrix3<Scalar>& x, const Matrix3<Scalar>& y,
                                                 const Matrix6<Scalar>& shape) noexcept {
  const Matrix3<Scalar> mixed = shape.template topRightCorner<3, 3>();
  const Matrix3<Scalar> vector = shape.template bottomRightCorner<3, 3>();
  const Matrix3<Scalar> to_attitude =
      x.lazyProduct(shape.template topLeftCorner<3, 3>()) + y.lazyProduct(mixed.transpose());
  const Matrix3<Scalar> to_vector = x.lazyProduct(mixed) + y.lazyProduct(vector);
  const Matrix3<Scalar> attitude = to_attitude.lazyProduct(x.transpose()) + to_vector.lazyProduct(y.transpose());
  Matrix6<Scalar> result;
  result.template topLeftCorner<3, 3>() = symmetrized(attitude);
  result.template topRightCorner<3, 3>() = to_vector;
  result.template bottomLeftCorner<3, 3>() = to_vector.transpose();
  result.template bottomRightCorner<3, 3>() = vector;
  const Vector6<Scalar> roots = shape.diagonal().cwiseSqrt();
  const Vector3<Scalar> rows = rounding::row_norms<Scalar>(x, roots.template head<3>()) +
                               rounding::row_norms<Scalar>(y, roots.template tail<3>());
  const Scalar share = rounding::share<Scalar>(rounding::congruence);
  result.diagonal().template head<3>() += share * rows.cwiseAbs2();
  result.diagonal().template tail<3>() *= Scalar(1) + share;
  return result;
}

/// The same for y = 0: the attitude alone is turned or stretched.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> covered_congruence(const Matrix3<Scalar>& x, const Matrix6<Scalar>& shape) noexcept {
  const Matrix3<Scalar> to_attitude = x.lazyProduct(shape.template topLeftCorner<3, 3>());
  const Matrix3<Scalar> to_vector = x.lazyProduct(shape.template topRightCorner<3, 3>());
  const Matrix3<Scalar> attitude = to_attitude.lazyProduct(x.transpose());
  Matrix6<Scalar> result = shape;
  result.template topLeftCorner<3, 3>() = symmetrized(attitude);
  result.template topRightCorner<3, 3>() = to_vector;
  result.template bottomLeftCorner<3, 3>() = to_vector.transpose();
  const Vector3<Scalar> rows =
      rounding::row_norms<Scalar>(x, Vector3<Scalar>(shape.diagonal().template head<3>().cwiseSqrt()));
  const Scalar share = rounding::share<Scalar>(rounding::congruence);
  result.diagonal().template head<3>() += share * rows.cwiseAbs2();
  result.diagonal().template tail<3>() *= Scalar(1) + share;
  return result;
}

}  // namespace elliptude
