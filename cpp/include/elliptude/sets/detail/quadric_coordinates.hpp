#pragma once

/// \file
/// The coordinates in which guaranteed fusion searches, and quadrics seen in them, relaxed by what rounding may do.

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/detail/many_quadrics.hpp"

namespace elliptude::detail {

/// The coordinates u of the search, y = shift + factor u with a lower triangle.
template <typename Scalar, int N>
struct Coordinates {
  Vector<Scalar, N> shift;
  Matrix<Scalar, N> factor;
  Vector<Scalar, N> reach;  ///< bounds |y| over the unit ball, if that is one of the constraints
  bool in_ball;
};

/// The quadric in u, relaxed by what rounding may do to it: for all u of the unit ball if that is one of the
/// constraints, else for all u. (theory, section 16.6)
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
  result.constrain_all(N, [&] { return relaxed(quadric, at.factor, at.shift, at.reach, at.in_ball, rounding); });
}

template <typename Scalar>
void relax(const HalfQuadric<Scalar>& half, const Coordinates<Scalar, 6>& at, const Scalar& rounding,
           Constraint<Scalar, 6>& result) noexcept {
  if (half.half == Half::first) {
    result.constrain_leading(3, [&] {
      return relaxed(half.quadric, Matrix3<Scalar>(at.factor.template topLeftCorner<3, 3>()),
                     Vector3<Scalar>(at.shift.template head<3>()), Vector3<Scalar>(at.reach.template head<3>()),
                     at.in_ball, rounding);
    });
  } else {
    result.constrain_all(3, [&] {
      return relaxed(half.quadric, Matrix<Scalar, 3, 6>(at.factor.template bottomRows<3>()),
                     Vector3<Scalar>(at.shift.template tail<3>()), Vector3<Scalar>(at.reach.template tail<3>()),
                     at.in_ball, rounding);
    });
  }
}

/// About the greatest slack of a constraint near the ball, so that multipliers of about one suit constraints of any
/// scale: by conjugate gradients from zero, until it is known to a factor of two or they leave the ball.
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
  if (best > rounding::share<Scalar>(rounding::three_digits) * scalar::abs(q.c)) {
    return best;
  }
  const Scalar missing = scalar::constant<Scalar>(1e-3L) * scalar::abs(q.c);
  const Scalar largest = scalar::largest_size(q.a);
  return missing > Scalar(0) ? missing : (largest > Scalar(0) ? largest : Scalar(1));
}

/// Scales for coordinates without a prediction, in which the quadrics' diagonals are of the size of their slack.
/// \return `unbounded` if no quadric constrains some coordinate.
template <typename Scalar, int N, typename Given>
[[nodiscard]] Status scale_by_slack(const Given* quadrics, std::size_t count, Matrix<Scalar, N>& factor) noexcept {
  Vector<Scalar, N> largest = Vector<Scalar, N>::Zero();
  for (std::size_t k = 0; k < count; ++k) {
    const Quadric<Scalar, N> quadric = extended(quadrics[k]);
    // Not much less than the slack at zero, or a sharp set would be far from zero in its own widths, and lose by
    // rounding.
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

/// Coordinates u of which the predicted ellipsoid is in the unit ball.
/// \return `not_finite`, `not_symmetric`, `not_positive_definite`.
template <typename Scalar, int N>
[[nodiscard]] Status coordinates_of(const Ellipsoid<Scalar, N>& predicted, Coordinates<Scalar, N>& at) noexcept {
  if (!scalar::all_finite(predicted.center) || !scalar::all_finite(predicted.shape)) {
    return Status::not_finite;
  }
  if (!is_symmetric(predicted.shape)) {
    return Status::not_symmetric;
  }
  // Raised by more than the factorization loses, so that factor factorᵀ ⪰ P.
  Matrix<Scalar, N> raised = predicted.shape;
  raised.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::cholesky(N));
  if (const Status status = put_cholesky(raised, at.factor); status != Status::ok) {
    return status;
  }
  at.shift = predicted.center;
  at.reach = at.shift.cwiseAbs() + raised.diagonal().cwiseSqrt();
  at.in_ball = true;
  return Status::ok;
}

/// Coordinates without a prediction, in which the quadrics' diagonals are of the size of their slack.
/// \return `unbounded` if no quadric constrains some coordinate.
template <typename Scalar, int N, typename Given>
[[nodiscard]] Status coordinates_without_prediction(const Given* quadrics, std::size_t count,
                                                    Coordinates<Scalar, N>& at) noexcept {
  at.shift.setZero();
  at.reach.setZero();
  at.factor.setZero();
  at.in_ball = false;
  return scale_by_slack(quadrics, count, at.factor);
}

}  // namespace elliptude::detail
