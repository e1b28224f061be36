#pragma once

/// \file
/// Ellipsoids E(x̂, P) = {x : (x − x̂)ᵀ P⁻¹ (x − x̂) ≤ 1} in Rⁿ (paper, §2.3.2).
/// P is the shape of a set, not a covariance. It may be singular: the ellipsoid is then flat.

#include <cstdint>

#include "elliptude/base/limits.hpp"
#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/base/status.hpp"
#include "elliptude/linear/cholesky.hpp"
#include "elliptude/linear/eigen.hpp"

namespace elliptude {

template <typename Scalar, int N>
struct Ellipsoid {
  Vector<Scalar, N> center;
  Matrix<Scalar, N> shape;  ///< P, symmetric positive semidefinite
};

/// The shape of a ball: its squared radius times the identity, no smaller for rounding. A negative radius gives a shape
/// that is none.
template <int N, typename Scalar>
[[nodiscard]] Matrix<Scalar, N> ball_shape(const Scalar& radius) noexcept {
  return rounding::enlarged(Scalar(radius * scalar::abs(radius)), 2) * Matrix<Scalar, N>::Identity();
}

/// How large an ellipsoid is: tr(W P), the weighted sum of its squared semi-axes, or its volume. The trace depends on
/// the units of the coordinates (W carries them), the volume does not.
template <typename Scalar, int N>
struct SizeCriterion {
  enum class Kind : std::uint8_t { trace, weighted_trace, volume };

  Kind kind;
  Matrix<Scalar, N> weight;  ///< W, symmetric positive definite; the identity unless the trace is weighted

  [[nodiscard]] static SizeCriterion trace() noexcept { return {Kind::trace, Matrix<Scalar, N>::Identity()}; }
  [[nodiscard]] static SizeCriterion weighted_trace(const Matrix<Scalar, N>& weight) noexcept {
    return {Kind::weighted_trace, weight};
  }
  [[nodiscard]] static SizeCriterion volume() noexcept { return {Kind::volume, Matrix<Scalar, N>::Identity()}; }

  /// Whether the volume is what a search makes small; the only one that it can, with `ELLIPTUDE_ONLY_VOLUME`.
  [[nodiscard]] bool by_volume() const noexcept { return only_volume || kind == Kind::volume; }

  /// The same for the first M numbers alone.
  template <int M>
  [[nodiscard]] SizeCriterion<Scalar, M> of_first() const noexcept {
    return {static_cast<typename SizeCriterion<Scalar, M>::Kind>(kind), weight.template topLeftCorner<M, M>()};
  }
};

namespace detail {

/// `validate` of a criterion that no search is to use: a trace, too, where searches know the volume alone.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status validate_any(const SizeCriterion<Scalar, N>& criterion) noexcept {
  using Kind = typename SizeCriterion<Scalar, N>::Kind;
  if (!scalar::all_finite(criterion.weight)) {
    return Status::not_finite;
  }
  if (criterion.kind > Kind::volume) {
    return Status::out_of_range;
  }
  if (criterion.kind != Kind::weighted_trace) {
    const Scalar off = (criterion.weight - Matrix<Scalar, N>::Identity()).squaredNorm();
    return scalar::all(off == Scalar(0)) ? Status::ok : Status::out_of_range;
  }
  return validate_definite(criterion.weight);
}

}  // namespace detail

/// \return `not_finite`; `out_of_range` of what is no `Kind`, of a weight that is not the identity unless the trace is
/// weighted, and of a trace with `ELLIPTUDE_ONLY_VOLUME`; `not_symmetric`, `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status validate(const SizeCriterion<Scalar, N>& criterion) noexcept {
  if (only_volume && criterion.kind != SizeCriterion<Scalar, N>::Kind::volume) {
    return Status::out_of_range;
  }
  return detail::validate_any(criterion);
}

/// Whether each squared half-width is zero, or between the least normal number over ε² and the largest times ε²: in
/// double semi-axes from 1e-138 to 1e137, in float from 1e-12 to 1e12. Products of a few entries then neither overflow
/// nor lose digits to underflow. (docs/domain.md)
template <typename Scalar, int N>
[[nodiscard]] bool is_in_domain(const Matrix<Scalar, N>& shape) noexcept {
  using Limits = std::numeric_limits<scalar::Value<Scalar>>;
  const Scalar least = Scalar(Limits::min()) / rounding::square<Scalar>();
  const Scalar most = Scalar(Limits::max()) * rounding::square<Scalar>();
  for (int i = 0; i < N; ++i) {
    const Scalar& square = shape(i, i);
    if (!(square <= most) || !(scalar::abs(square) >= least || square == Scalar(0))) {
      return false;
    }
  }
  return true;
}

namespace detail {

/// `validate` but for whether the shape is positive semidefinite, which factorising it shows.
template <typename Scalar, int N>
[[nodiscard]] Status validate_entries(const Ellipsoid<Scalar, N>& ellipsoid) noexcept {
  if (!scalar::all_finite(ellipsoid.center) || !scalar::all_finite(ellipsoid.shape)) {
    return Status::not_finite;
  }
  if (!is_in_domain(ellipsoid.shape)) {
    return Status::beyond_domain;
  }
  return is_symmetric(ellipsoid.shape) ? Status::ok : Status::not_symmetric;
}

}  // namespace detail

/// \return `not_finite`, `not_symmetric`; `beyond_domain` of a width; `not_positive_definite` if the shape is not even
/// semidefinite.
template <typename Scalar, int N>
[[nodiscard]] Status validate(const Ellipsoid<Scalar, N>& ellipsoid) noexcept {
  if (const Status status = detail::validate_entries(ellipsoid); status != Status::ok) {
    return status;
  }
  Matrix<Scalar, N> factor;  // of no use with pivots of the size of rounding, but there is one
  return is_positive_definite(ellipsoid.shape) ? Status::ok : cholesky_semidefinite(ellipsoid.shape, factor);
}

/// T P Tᵀ of a square T, exactly symmetric. Its entry (i, j) errs by at most 16 ε √(mᵢmⱼ), m = (|T| √diag P)²; where
/// that makes the image of a positive definite shape indefinite, the diagonal is raised by what outweighs it.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> transformed_shape(const Matrix<Scalar, N>& transform,
                                                  const Matrix<Scalar, N>& shape) noexcept {
  Matrix<Scalar, N> result = symmetric_congruence(transform, shape);
  if (!is_positive_definite(result) && is_positive_definite(shape)) {
    const Vector<Scalar, N> width = transform.cwiseAbs().lazyProduct(Vector<Scalar, N>(shape.diagonal().cwiseSqrt()));
    result.diagonal() += rounding::share<Scalar>(rounding::image) * width.cwiseAbs2();
  }
  return result;
}

/// T P Tᵀ of any T, its diagonal raised by what outweighs the rounding of all its entries, as in `transformed_shape`.
template <typename Scalar, int M, int N>
[[nodiscard]] Matrix<Scalar, M> covered_image(const Matrix<Scalar, M, N>& transform,
                                              const Matrix<Scalar, N>& shape) noexcept {
  Matrix<Scalar, M> result = symmetric_congruence(transform, shape);
  const Vector<Scalar, M> width = transform.cwiseAbs().lazyProduct(Vector<Scalar, N>(shape.diagonal().cwiseSqrt()));
  result.diagonal() += rounding::share<Scalar>(rounding::image) * width.cwiseAbs2();
  return result;
}

/// {T x + s : x in E}, of any dimension: an ellipsoid again, with center T x̂ + s and shape T P Tᵀ. With T a selection
/// of rows it is the projection of E on these coordinates.
template <typename Scalar, int M, int N>
[[nodiscard]] Ellipsoid<Scalar, M> affine_image(const Ellipsoid<Scalar, N>& ellipsoid,
                                                const Matrix<Scalar, M, N>& transform,
                                                const Vector<Scalar, M>& shift) noexcept {
  return {transform.lazyProduct(ellipsoid.center) + shift, symmetric_congruence(transform, ellipsoid.shape)};
}

/// The projection on `Size` consecutive coordinates from `First` on.
template <int First, int Size, typename Scalar, int N>
[[nodiscard]] Ellipsoid<Scalar, Size> projection(const Ellipsoid<Scalar, N>& ellipsoid) noexcept {
  static_assert(0 <= First && First + Size <= N);
  return {ellipsoid.center.template segment<Size>(First), ellipsoid.shape.template block<Size, Size>(First, First)};
}

/// The support function max {dᵀx : x in E} = dᵀx̂ + √(dᵀPd).
template <typename Scalar, int N>
[[nodiscard]] Scalar support(const Ellipsoid<Scalar, N>& ellipsoid, const Vector<Scalar, N>& direction) noexcept {
  const Scalar square = direction.dot(ellipsoid.shape.lazyProduct(direction));
  return direction.dot(ellipsoid.center) + scalar::sqrt(scalar::select(square > Scalar(0), square, Scalar(0)));
}

/// The support along each coordinate axis, less the center: √Pᵢᵢ, the half-widths of the smallest box about E.
template <typename Scalar, int N>
[[nodiscard]] Vector<Scalar, N> half_widths(const Ellipsoid<Scalar, N>& ellipsoid) noexcept {
  return ellipsoid.shape.diagonal().cwiseSqrt();
}

/// (x − x̂)ᵀ P⁻¹ (x − x̂): at most 1 inside; infinite for a point off the plane of a flat ellipsoid.
/// \return `not_finite`, `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status quadratic_form(const Ellipsoid<Scalar, N>& ellipsoid, const Vector<Scalar, N>& x,
                                    Scalar& value) noexcept {
  Vector<Scalar, N> rest = x - ellipsoid.center;
  if (!scalar::all_finite(rest) || !scalar::all_finite(ellipsoid.shape)) {
    return Status::not_finite;
  }
  Matrix<Scalar, N> l;
  if (const Status status = cholesky_semidefinite(ellipsoid.shape, l); status != Status::ok) {
    return status;
  }
  Scalar sum(0);
  for (int i = 0; i < N; ++i) {
    if (l(i, i) == Scalar(0)) {
      if (!(rest(i) == Scalar(0))) {
        value = Scalar(std::numeric_limits<scalar::Value<Scalar>>::infinity());
        return Status::ok;
      }
      continue;
    }
    const Scalar u = rest(i) / l(i, i);
    sum += u * u;
    for (int k = i + 1; k < N; ++k) {
      rest(k) -= l(k, i) * u;
    }
  }
  value = sum;
  return Status::ok;
}

/// Whether x is in E. An ellipsoid that is not valid contains nothing.
template <typename Scalar, int N>
[[nodiscard]] bool contains(const Ellipsoid<Scalar, N>& ellipsoid, const Vector<Scalar, N>& x) noexcept {
  Scalar value;
  return quadratic_form(ellipsoid, x, value) == Status::ok && value <= Scalar(1);
}

/// The logarithm of the volume. \return `not_positive_definite` also of a flat ellipsoid, which has none.
template <typename Scalar, int N>
[[nodiscard]] Status log_volume(const Ellipsoid<Scalar, N>& ellipsoid, Scalar& value) noexcept {
  Matrix<Scalar, N> l;
  if (const Status status = put_cholesky(ellipsoid.shape, l); status != Status::ok) {
    return status;
  }
  // The unit ball's volume by V(n) = V(n − 2) 2π/n.
  long double ball = N % 2 == 0 ? 1.0L : 2.0L;
  for (int n = N % 2 == 0 ? 2 : 3; n <= N; n += 2) {
    ball *= 2.0L * scalar::pi<long double>() / static_cast<long double>(n);
  }
  Scalar sum = scalar::log(scalar::constant<Scalar>(ball));
  for (int i = 0; i < N; ++i) {
    sum += scalar::log(Scalar(l(i, i)));
  }
  value = sum;
  return Status::ok;
}

/// Semi-axes, longest first, and their directions (columns).
template <typename Scalar, int N>
struct PrincipalAxes {
  Vector<Scalar, N> lengths;
  Matrix<Scalar, N> directions;
};

template <typename Scalar, int N>
[[nodiscard]] Status principal_axes(const Ellipsoid<Scalar, N>& ellipsoid, PrincipalAxes<Scalar, N>& axes) noexcept {
  SymmetricEigen<Scalar, N> eigen;
  if (const Status status = symmetric_eigen(ellipsoid.shape, eigen); status != Status::ok) {
    return status;
  }
  axes.lengths = eigen.values.cwiseMax(Scalar(0)).cwiseSqrt();
  axes.directions = eigen.vectors;
  return Status::ok;
}

}  // namespace elliptude
