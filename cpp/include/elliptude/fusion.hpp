#pragma once

/// \file
/// The filtering procedure (paper, §3.3): the smallest ellipsoid about the intersection of what is predicted and what is measured.

#include "elliptude/measurement.hpp"

namespace elliptude {

/// An ellipsoid after fusion, and how it came about.
template <typename State>
struct Fusion {
  StateEllipsoid<State> ellipsoid;
  StateScalar<State> share;   ///< 0 the measurement alone, 1 the prediction alone; the paper's q is share / (1 − share)
  StateScalar<State> margin;  ///< of the overlap, `overlap_margin`; set also where the sets do not meet
};

/// How an ellipsoid's attitude errors are carried to another center. Both are of first order in the error; only the second
/// is right to first order where the centers differ.
enum class Recentring : std::uint8_t {
  shifted,      ///< the paper's: log(exp(S(a)) exp(S(ζ))) ≈ a + ζ
  first_order,  ///< a + J_r⁻¹(a) ζ, and J_r(ζ̂) (ζ − ζ̂) after the fusion
};

/// diag(G, I) P diag(G, I)ᵀ.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> with_attitude_transformed(const Matrix3<Scalar>& g,
                                                        const Matrix6<Scalar>& shape) noexcept {
  Matrix6<Scalar> transform = Matrix6<Scalar>::Identity();
  transform.template topLeftCorner<3, 3>() = g;
  const Matrix6<Scalar> half = transform.lazyProduct(shape);
  const Matrix6<Scalar> whole = half.lazyProduct(transform.transpose());
  return scalar::constant<Scalar>(0.5L) * (whole + whole.transpose());
}

/// The ellipsoid of errors x about a center, in coordinates where it is E(x̂, P), put about its own center (paper, eqs. nattes,
/// nveles).
template <typename State>
[[nodiscard]] StateEllipsoid<State> recentred(const State& center, const Ellipsoid<StateScalar<State>, 6>& ellipsoid,
                                              Recentring recentring) noexcept {
  using Scalar = StateScalar<State>;
  StateEllipsoid<State> result{retract(center, ellipsoid.center), ellipsoid.shape};
  if (recentring == Recentring::first_order) {
    result.shape = with_attitude_transformed(
        ExponentialChart::moved_to(Vector3<Scalar>(ellipsoid.center.template head<3>())), ellipsoid.shape);
  }
  return result;
}

/// The prediction as it is seen from the measured center: E(x̂^mf, P^f) (paper, eqs. errz, errPi, ellRmf).
template <typename State>
[[nodiscard]] Ellipsoid<StateScalar<State>, 6> seen_from(const State& center, const StateEllipsoid<State>& ellipsoid,
                                                         Recentring recentring) noexcept {
  using Scalar = StateScalar<State>;
  Ellipsoid<Scalar, 6> seen{state_error(center, ellipsoid.center), ellipsoid.shape};
  if (recentring == Recentring::first_order) {
    seen.shape = with_attitude_transformed(ExponentialChart::seen_from(Vector3<Scalar>(seen.center.template head<3>())),
                                           ellipsoid.shape);
  }
  return seen;
}

/// Fuses a predicted and a measured ellipsoid about the measured center (paper, eqs. xhatP-LP).
/// \return what `minimal_intersection` says; after `empty_intersection` the margin is set, and nothing else.
template <typename State>
[[nodiscard]] Status fuse(const StateEllipsoid<State>& measured, const StateEllipsoid<State>& predicted,
                          Recentring recentring, const SizeCriterion<StateScalar<State>, 6>& criterion,
                          Fusion<State>& fusion) noexcept {
  using Scalar = StateScalar<State>;
  const Ellipsoid<Scalar, 6> seen = seen_from(measured.center, predicted, recentring);
  Intersection<Scalar, 6> intersection;
  const Status status = minimal_intersection(measured.in_coordinates(), seen, criterion, intersection);
  if (status != Status::ok && status != Status::empty_intersection) {
    return status;
  }
  Scalar margin;
  if (const Status overlap = overlap_margin(measured.in_coordinates(), seen, margin); overlap != Status::ok) {
    return overlap;
  }
  fusion.margin = margin;
  if (status == Status::ok && margin < Scalar(0)) {
    return Status::empty_intersection;
  }
  if (status == Status::ok) {
    // The prediction alone has no need to be carried to the measured center and back.
    fusion.ellipsoid =
        intersection.share == Scalar(1) ? predicted : recentred(measured.center, intersection.set, recentring);
    fusion.share = intersection.share;
  }
  return status;
}

/// Fuses a predicted ellipsoid with a linear measurement of some of its coordinates (theory, section 10): one direction, an angular
/// velocity or an attitude alone, about the predicted center.
/// \return what `validate`, `whitened` and `minimal_intersection` say; after `empty_intersection` the margin is set, and nothing else.
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
  Matrix<Scalar, Rows, 6> h;
  Matrix6<Scalar> l;
  if (const Status status = whitened(measurement, y, h); status != Status::ok) {
    return status;
  }
  if (const Status status = cholesky_semidefinite(predicted.shape, l); status != Status::ok) {
    return status;
  }
  // As a quadric (`to_quadric`), but its slack from the residual: where the measurement is much sharper than the prediction
  // the constants of the quadric would cancel.
  const Vector6<Scalar> present =
      l.diagonal().unaryExpr([](const Scalar& entry) { return entry > Scalar(0) ? Scalar(1) : Scalar(0); });
  const Matrix<Scalar, Rows, 6> b = h.lazyProduct(l);
  const Matrix6<Scalar> m = b.transpose().lazyProduct(b);
  const Vector6<Scalar> v = -b.transpose().lazyProduct(y);
  const auto slack = [&](const Vector6<Scalar>& u) -> Scalar {
    return Scalar(1) - Vector<Scalar, Rows>(y - b.lazyProduct(u)).squaredNorm();
  };
  const fusion::Problem<Scalar, 6, decltype(slack)> problem{m, v, present, slack};
  Intersection<Scalar, 6> intersection;
  fusion::Combination<Scalar, 6> best;
  const Vector6<Scalar> origin = Vector6<Scalar>::Zero();
  const Status status = fusion::minimal_intersection(origin, l, problem, criterion, intersection, best);
  if (status != Status::ok && status != Status::empty_intersection) {
    return status;
  }
  if (status == Status::ok && intersection.share == Scalar(1)) {
    intersection.set = predicted.in_coordinates();
  }
  // Whether they meet is decided in the measured coordinates: E(0, HPHᵀ) and E(y, R).
  const Ellipsoid<Scalar, Rows> image =
      affine_image(predicted.in_coordinates(), measurement.h, Vector<Scalar, Rows>(Vector<Scalar, Rows>::Zero()));
  Scalar margin;
  if (const Status overlap = overlap_margin(Ellipsoid<Scalar, Rows>{measurement.y, measurement.bound}, image, margin);
      overlap != Status::ok) {
    return overlap;
  }
  fusion.margin = margin;
  if (status == Status::ok && margin < Scalar(0)) {
    return Status::empty_intersection;
  }
  if (status == Status::ok) {
    fusion.ellipsoid = recentred(predicted.center, intersection.set, recentring);
    fusion.share = intersection.share;
  }
  return status;
}

}  // namespace elliptude
