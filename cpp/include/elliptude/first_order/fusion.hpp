#pragma once

/// \file
/// The filtering procedure (paper, §3.3): the smallest ellipsoid about the intersection of the predicted and the
/// measured set.

#include <cstdint>

#include "elliptude/measurement/quadrics.hpp"

namespace elliptude {

/// An ellipsoid after fusion, with the share of the prediction in it.
template <typename State>
struct Fusion {
  StateEllipsoid<State> ellipsoid;
  StateScalar<State> share;   ///< 0 the measurement alone, 1 the prediction alone; the paper's q is share / (1 − share)
  StateScalar<State> margin;  ///< of the overlap, `overlap_margin`; set also if the sets do not meet
};

/// How an ellipsoid's attitude errors are carried to another center. Both are of first order in the error; only the
/// second is right to first order if the centers differ.
enum class Recentring : std::uint8_t {
  shifted,      ///< the paper's: log(exp(S(a)) exp(S(ζ))) ≈ a + ζ
  first_order,  ///< a + J_r⁻¹(a) ζ, and J_r(ζ̂) (ζ − ζ̂) after the fusion
};

namespace detail {

/// diag(G, I) P diag(G, I)ᵀ.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> with_attitude_transformed(const Matrix3<Scalar>& g,
                                                        const Matrix6<Scalar>& shape) noexcept {
  Matrix6<Scalar> transform = Matrix6<Scalar>::Identity();
  transform.template topLeftCorner<3, 3>() = g;
  return transformed_shape(transform, shape);
}

}  // namespace detail

/// The ellipsoid of errors x about a center, in coordinates where it is E(x̂, P), put about its own center (paper, eqs.
/// nattes, nveles).
template <typename State>
[[nodiscard]] StateEllipsoid<State> recentred(const State& center, const Ellipsoid<StateScalar<State>, 6>& ellipsoid,
                                              Recentring recentring) noexcept {
  using Scalar = StateScalar<State>;
  StateEllipsoid<State> result{retract(center, ellipsoid.center), ellipsoid.shape};
  if (recentring == Recentring::first_order) {
    result.shape = detail::with_attitude_transformed(
        ExponentialChart::moved_to(Vector3<Scalar>(ellipsoid.center.template head<3>())), ellipsoid.shape);
  }
  return result;
}

/// The prediction seen from the measured center: E(x̂^mf, P^f) (paper, eqs. errz, errPi, ellRmf).
template <typename State>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Ellipsoid<StateScalar<State>, 6> seen_from(const State& center,
                                                                               const StateEllipsoid<State>& ellipsoid,
                                                                               Recentring recentring) noexcept {
  using Scalar = StateScalar<State>;
  Ellipsoid<Scalar, 6> seen{state_error(center, ellipsoid.center), ellipsoid.shape};
  if (recentring == Recentring::first_order) {
    seen.shape = detail::with_attitude_transformed(
        ExponentialChart::seen_from(Vector3<Scalar>(seen.center.template head<3>())), ellipsoid.shape);
  }
  return seen;
}

namespace detail {

/// Whether a filter may keep a set: rounding may leave no set if the fused sets spread too far.
template <typename State>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool is_kept(const StateEllipsoid<State>& set) noexcept {
  return scalar::all_finite(set.shape) && is_in_domain(set.shape) &&
         (is_positive_definite(set.shape) || validate(set) == Status::ok);
}

}  // namespace detail

namespace detail {

/// Takes a fused set of errors about a center up, if a filter may keep it.
/// \param taken may be where `center` is.
/// \return `beyond_domain` if not.
template <typename State>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status take_fused(const State& center, const Ellipsoid<StateScalar<State>, 6>& set,
                                                      Recentring recentring, StateEllipsoid<State>& taken) noexcept {
  const StateEllipsoid<State> fused = recentred(center, set, recentring);
  // A shift leaves the shape as `minimal_intersection` has checked it.
  if (recentring != Recentring::shifted && !is_kept(fused)) {
    return Status::beyond_domain;
  }
  taken = fused;
  return Status::ok;
}

/// `fuse` of two ellipsoids.
/// \param margin set after `ok` and `empty_intersection`, and perhaps after another failure.
/// \param fused may be where the prediction is.
template <typename State>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status fuse_ellipsoids(const StateEllipsoid<State>& measured,
                                                           const StateEllipsoid<State>& predicted,
                                                           Recentring recentring,
                                                           const SizeCriterion<StateScalar<State>, 6>& criterion,
                                                           StateEllipsoid<State>& fused, StateScalar<State>& share,
                                                           StateScalar<State>& margin) noexcept {
  using Scalar = StateScalar<State>;
  const Ellipsoid<Scalar, 6> coordinates = measured.in_coordinates();
  Ellipsoid<Scalar, 6> set = seen_from(measured.center, predicted, recentring);
  // The overlap first, as the intersection takes the place of the prediction. It is of use only if both sets are valid.
  Scalar its_margin(0);
  const Status overlap = overlap_of_valid(coordinates, set, its_margin);
  Scalar its_share(1);
  const Status status = intersect_in_place(coordinates, criterion, set, its_share);
  if (status != Status::ok && status != Status::empty_intersection) {
    return status;
  }
  if (overlap != Status::ok) {
    return overlap;
  }
  margin = its_margin;
  if (status == Status::empty_intersection || its_margin < Scalar(0)) {
    return Status::empty_intersection;
  }
  if (its_share == Scalar(1)) {
    // The prediction alone has no need to be carried to the measured center and back.
    if (recentring != Recentring::shifted && !is_kept(predicted)) {
      return Status::beyond_domain;
    }
    fused = predicted;
  } else if (const Status taken = take_fused(measured.center, set, recentring, fused); taken != Status::ok) {
    return taken;
  }
  share = its_share;
  return Status::ok;
}

}  // namespace detail

/// Fuses a predicted and a measured ellipsoid about the measured center (paper, eqs. xhatP-LP).
/// \return the status of `minimal_intersection`; after `empty_intersection` the margin is set, and nothing else.
template <typename State>
[[nodiscard]] Status fuse(const StateEllipsoid<State>& measured, const StateEllipsoid<State>& predicted,
                          Recentring recentring, const SizeCriterion<StateScalar<State>, 6>& criterion,
                          Fusion<State>& fusion) noexcept {
  return detail::fuse_ellipsoids(measured, predicted, recentring, criterion, fusion.ellipsoid, fusion.share,
                                 fusion.margin);
}

namespace detail {

/// The size of the combination of ‖y − Bu‖ ≤ 1, of a few rows, with the unit ball, in the coordinates where it costs
/// little: with the eigenvalues dᵢ of BBᵀ, yᵢ the coordinates of y along its eigenvectors, wᵢ the weights W' of the
/// vectors of u that belong to them and w₀ that of all others,
///
///     N = 1 + q − Σ yᵢ² q/(dᵢ + q),   tr W'A⁻¹ = Σ wᵢ/(dᵢ + q) + w₀/q,   −log det A = −Σ log(dᵢ + q) − (6 − rows) log q.
template <typename Scalar, int Rows, int N>
class SizeByRows {
 public:
  /// \return whether BBᵀ is positive definite.
  [[nodiscard]] static bool make(const Vector<Scalar, Rows>& y, const Matrix<Scalar, Rows, N>& b,
                                 const RelativeSize<Scalar, N>& size, SizeByRows& result) noexcept {
    SymmetricEigen<Scalar, Rows> eigen;
    if (symmetric_eigen(Matrix<Scalar, Rows>(b.lazyProduct(b.transpose())), eigen) != Status::ok ||
        !(eigen.values(Rows - 1) > Scalar(0))) {
      return false;
    }
    result = SizeByRows(y, b, size, eigen);
    return true;
  }

  SizeByRows() noexcept = default;
  /// \param eigen of BBᵀ, positive definite.
  SizeByRows(const Vector<Scalar, Rows>& y, const Matrix<Scalar, Rows, N>& b, const RelativeSize<Scalar, N>& size,
             const SymmetricEigen<Scalar, Rows>& eigen) noexcept
      : values_(eigen.values), along_(eigen.vectors.transpose().lazyProduct(y)), by_volume_(size.by_volume()) {
    if (!by_volume()) {
      const Matrix<Scalar, Rows, N> vectors = eigen.vectors.transpose().lazyProduct(b);  // times √dᵢ
      const Matrix<Scalar, Rows, N> half = vectors.lazyProduct(size.weight());
      weights_ = half.cwiseProduct(vectors).rowwise().sum().cwiseQuotient(eigen.values);
      rest_ = size.weight().trace() - weights_.sum();
    }
  }

  /// The first and second derivative of the logarithm of the size with respect to log q. No branch depends on a number.
  /// \return whether the sets meet, as far as this q shows; if not, neither is of use.
  [[nodiscard]] Truth<Scalar> derivatives(const Scalar& q, Scalar& slope, Scalar& curvature) const noexcept {
    Scalar level = Scalar(1) + q;
    Scalar level1(1);
    Scalar level2(0);
    Scalar trace = rest_ / q;  // of W'A⁻¹, and its derivatives
    Scalar trace1 = -trace / q;
    Scalar trace2 = Scalar(-2) * trace1 / q;
    Scalar determinant1 = -Scalar(N - Rows) / q;  // of −log det A
    Scalar determinant2 = -determinant1 / q;
    for (int i = 0; i < Rows; ++i) {
      const Scalar inverse = Scalar(1) / (values_(i) + q);
      const Scalar square = along_(i) * along_(i);
      level -= square * q * inverse;
      const Scalar fall = square * values_(i) * inverse * inverse;
      level1 -= fall;
      level2 += Scalar(2) * fall * inverse;
      determinant1 -= inverse;
      determinant2 += inverse * inverse;
      if (!by_volume()) {
        const Scalar part = weights_(i) * inverse;
        trace += part;
        trace1 -= part * inverse;
        trace2 += Scalar(2) * part * inverse * inverse;
      }
    }
    const Scalar relative = level1 / level;
    slope = relative;
    curvature = level2 / level - relative * relative;
    if (by_volume()) {
      slope = Scalar(N) * slope + determinant1;
      curvature = Scalar(N) * curvature + determinant2;
    } else {
      slope += trace1 / trace;
      curvature += trace2 / trace - (trace1 / trace) * (trace1 / trace);
    }
    curvature = q * slope + q * q * curvature;  // now with respect to log q
    slope = q * slope;
    return level > Scalar(0);
  }

 private:
  [[nodiscard]] bool by_volume() const noexcept { return only_volume || by_volume_; }

  Vector<Scalar, Rows> values_;
  Vector<Scalar, Rows> along_;
  Vector<Scalar, Rows> weights_ = Vector<Scalar, Rows>::Zero();
  Scalar rest_{0};
  bool by_volume_ = false;
};

/// The q of least size for a few rows, by Newton's steps in log q. Only where the search of `minimal_intersection` is
/// to start: every q gives a bound.
template <typename Scalar, int Rows, int N>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Scalar weight_of_rows(const Vector<Scalar, Rows>& y,
                                                          const Matrix<Scalar, Rows, N>& b,
                                                          const RelativeSize<Scalar, N>& size,
                                                          const Scalar& start) noexcept {
  SizeByRows<Scalar, Rows, N> by_rows;
  if (!SizeByRows<Scalar, Rows, N>::make(y, b, size, by_rows)) {
    return start;
  }
  Scalar q = start;
  constexpr int most_steps = 20;
  for (int step = 0; step < most_steps; ++step) {
    Scalar slope;
    Scalar curvature;
    if (!by_rows.derivatives(q, slope, curvature)) {
      return start;
    }
    const Scalar move = newton_move(slope, curvature, Scalar(9));
    q = move > Scalar(0) ? Scalar(q * (Scalar(1) + move)) : Scalar(q / (Scalar(1) - move));
    if (scalar::abs(move) <= scalar::constant<Scalar>(1e-3L)) {  // its square is left
      break;
    }
  }
  return scalar::isfinite(q) && q > Scalar(0) ? q : start;
}

/// Whether a measurement and a prediction meet, decided in the measured coordinates: E(y, R) and E(0, HPHᵀ).
/// \return the status of `overlap_margin`.
template <typename State, int Rows>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status overlap_with(const LinearMeasurement<StateScalar<State>, Rows>& measurement,
                                                        const StateEllipsoid<State>& predicted,
                                                        StateScalar<State>& margin) noexcept {
  using Scalar = StateScalar<State>;
  const Ellipsoid<Scalar, Rows> image =
      affine_image(predicted.in_coordinates(), measurement.h, Vector<Scalar, Rows>(Vector<Scalar, Rows>::Zero()));
  return overlap_margin(Ellipsoid<Scalar, Rows>{measurement.y, measurement.bound}, image, margin);
}

/// `recombine` of ‖y − Bu‖ ≤ 1 with the unit ball about a center of zero.
template <typename Scalar, int Rows, int N>
ELLIPTUDE_OUT_OF_LINE void recombine_rows(const Vector<Scalar, Rows>& y, const Matrix<Scalar, Rows, N>& b,
                                          const Matrix<Scalar, N>& factor, const Vector<Scalar, N>& present,
                                          const Scalar& q, Ellipsoid<Scalar, N>& set) noexcept {
  Matrix<Scalar, N> rows = Matrix<Scalar, N>::Zero();
  rows.template topRows<Rows>() = b;
  Vector<Scalar, N> offset = Vector<Scalar, N>::Zero();
  offset.template head<Rows>() = -y;
  recombine(Vector<Scalar, N>(Vector<Scalar, N>::Zero()), factor, rows, offset, present, q, set);
}

/// A measurement as ‖y − Bu‖ ≤ 1 in the coordinates u of a prediction of this shape, x = x̂ + l u.
/// \return the status of `whitened` and `cholesky_semidefinite`.
template <typename Scalar, int Rows>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status whiten(const LinearMeasurement<Scalar, Rows>& measurement,
                                                  const Matrix6<Scalar>& shape, Vector<Scalar, Rows>& y,
                                                  Matrix<Scalar, Rows, 6>& b, Matrix6<Scalar>& l) noexcept {
  Matrix<Scalar, Rows, 6> h;
  if (const Status status = whitened(measurement, y, h); status != Status::ok) {
    return status;
  }
  if (const Status status = cholesky_semidefinite(shape, l); status != Status::ok) {
    return status;
  }
  b = h.lazyProduct(l);
  return Status::ok;
}

/// The smallest ellipsoid about ‖y − Bu‖ ≤ 1, of a few rows, and the unit ball, in x = l u.
/// \param share after `ok`: as in `minimal_intersection`.
/// \param q of the combination after `ok`, where the search began after `empty_intersection`.
/// \param is_ill_conditioned whether the set is to be recombined for that q.
/// \return the status of `minimal_intersection`.
template <typename Scalar, int Rows>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status search_rows(const Vector<Scalar, Rows>& y, const Matrix<Scalar, Rows, 6>& b,
                                                       const Matrix6<Scalar>& l, const Vector6<Scalar>& present,
                                                       const SizeCriterion<Scalar, 6>& criterion,
                                                       Ellipsoid<Scalar, 6>& set, Scalar& share, Scalar& q,
                                                       bool& is_ill_conditioned) noexcept {
  // As a quadric (`to_quadric`), but its slack from the residual: where the measurement is much sharper than the
  // prediction the constants of the quadric would cancel.
  const Matrix6<Scalar> m = b.transpose().lazyProduct(b);
  const Vector6<Scalar> v = -b.transpose().lazyProduct(y);
  const auto slack = [&](const Vector6<Scalar>& u) noexcept -> Scalar {
    return Scalar(1) - Vector<Scalar, Rows>(y - b.lazyProduct(u)).squaredNorm();
  };
  const AnySlack<Scalar, 6> any_slack(slack);
  const Problem<Scalar, 6, AnySlack<Scalar, 6>> problem{m, v, present, any_slack};
  const RelativeSize<Scalar, 6> size(l, present, criterion);
  Scalar start = problem.typical_weight();
  if (start > Scalar(0) && present.sum() == Scalar(6)) {
    start = weight_of_rows(y, b, size, start);
  }
  KeptCombination<Scalar, 6> best;
  const Vector6<Scalar> origin = Vector6<Scalar>::Zero();
  const Status status = minimal_intersection(origin, l, problem, size, start, set, share, best);
  q = status == Status::ok ? Scalar(share / (Scalar(1) - share)) : start;
  is_ill_conditioned = status == Status::ok && share < Scalar(1) && problem.is_ill_conditioned(q, best);
  return status;
}

}  // namespace detail

/// Fuses a predicted ellipsoid with a linear measurement of some of its coordinates (theory, section 10): one
/// direction, an angular velocity or an attitude alone, about the predicted center.
/// \return the status of `validate`, `whitened` and `minimal_intersection`; after `empty_intersection` the margin is
/// set, and nothing else.
template <typename State, int Rows>
[[nodiscard]] Status fuse(const LinearMeasurement<StateScalar<State>, Rows>& measurement,
                          const StateEllipsoid<State>& predicted, Recentring recentring,
                          const SizeCriterion<StateScalar<State>, 6>& criterion, Fusion<State>& fusion) noexcept {
  using Scalar = StateScalar<State>;
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  if (const Status status = validate(predicted); status != Status::ok) {
    return status;
  }
  Vector<Scalar, Rows> y;
  Matrix<Scalar, Rows, 6> b;
  Matrix6<Scalar> l;
  if (const Status status = detail::whiten(measurement, predicted.shape, y, b, l); status != Status::ok) {
    return status;
  }
  const Vector6<Scalar> present = detail::present_coordinates(l);
  Ellipsoid<Scalar, 6> set;
  Scalar q(0);
  bool is_ill_conditioned = false;
  Scalar share(1);
  const Status status = detail::search_rows(y, b, l, present, criterion, set, share, q, is_ill_conditioned);
  if (status != Status::ok && status != Status::empty_intersection) {
    return status;
  }
  Scalar margin;
  if (const Status overlap = detail::overlap_with(measurement, predicted, margin); overlap != Status::ok) {
    return overlap;
  }
  fusion.margin = margin;
  if (margin < Scalar(0)) {
    return Status::empty_intersection;
  }
  // Where the measurement is far sharper than the prediction, M is too ill-conditioned for a proof and for the shape.
  const bool undecided = status == Status::empty_intersection;
  if (undecided || share == Scalar(1)) {
    set.center.setZero();
    set.shape = predicted.shape;
  }
  if (undecided || is_ill_conditioned) {
    detail::recombine_rows(y, b, l, present, q, set);
    share = q / (Scalar(1) + q);
  }
  const Status taken = detail::take_fused(predicted.center, set, recentring, fusion.ellipsoid);
  if (taken == Status::ok) {
    fusion.share = share;
  }
  return taken;
}

}  // namespace elliptude
