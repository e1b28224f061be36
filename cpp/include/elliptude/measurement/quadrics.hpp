#pragma once

/// \file
/// Measurements as exact quadrics of the error about any center. (theory, sections 16.1 and 16.2)

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/measurement/linearization.hpp"
#include "elliptude/sets/quadric.hpp"

namespace elliptude {

/// A linear measurement of x as a quadric, which may be a cylinder, but for rounding.
/// \return the status of `whitened`.
template <typename Scalar, int Rows>
[[nodiscard]] Status to_quadric(const LinearMeasurement<Scalar, Rows>& measurement,
                                Quadric<Scalar, 6>& quadric) noexcept {
  Vector<Scalar, Rows> y;
  Matrix<Scalar, Rows, 6> h;
  if (const Status status = whitened(measurement, y, h); status != Status::ok) {
    return status;
  }
  quadric.a = h.transpose().lazyProduct(h);
  quadric.g = -h.transpose().lazyProduct(y);
  quadric.c = Scalar(1) - y.squaredNorm();
  return Status::ok;
}

/// The same for all x with |xᵢ| at most `reach`, none of which is lost by rounding: with a root of the bound's inverse
/// that is none too large, and the level raised by what the products lose. (theory, section 16.6)
/// \return the status of `validate`; `not_positive_definite` of a bound with a zero width, or one of rounding.
template <typename Scalar, int Rows>
[[nodiscard]] Status covered_quadric(const LinearMeasurement<Scalar, Rows>& measurement, const Vector6<Scalar>& reach,
                                     Quadric<Scalar, 6>& quadric) noexcept {
  if (const Status status = validate(measurement); status != Status::ok) {
    return status;
  }
  const Matrix<Scalar, Rows> bound = symmetrized(measurement.bound);
  if (!is_positive_definite(bound)) {  // before it is raised
    return Status::not_positive_definite;
  }
  Matrix<Scalar, Rows> root;
  Scalar share;
  if (const Status status = inverse_root_from_below(bound, root, share); status != Status::ok) {
    return status;
  }
  root *= scalar::sqrt(Scalar(Scalar(1) - share));
  const Vector<Scalar, Rows> y = root.lazyProduct(measurement.y);
  const Matrix<Scalar, Rows, 6> h = root.lazyProduct(measurement.h);
  const Vector<Scalar, Rows> terms =
      root.cwiseAbs().lazyProduct(measurement.y.cwiseAbs() + measurement.h.cwiseAbs().lazyProduct(reach));
  const Vector<Scalar, Rows> seen_terms = y.cwiseAbs() + h.cwiseAbs().lazyProduct(reach);
  const Scalar rounded = rounding::share<Scalar>(rounding::whitening(Rows));
  const Scalar lost = rounded * scalar::sqrt(Scalar(terms.squaredNorm()));
  quadric.a = h.transpose().lazyProduct(h);
  quadric.g = -h.transpose().lazyProduct(y);
  quadric.c = Scalar(1) - y.squaredNorm() + (Scalar(2) + lost) * lost + rounded * seen_terms.squaredNorm();
  return Status::ok;
}

/// The angle within which a direction is known, the largest √λ of ΠSΠ, Π = I − b̃b̃ᵀ: ∠(exp(S(ν)) b̃, b̃) ≤ ‖Πν‖ for
/// every ν. No less whatever rounding does, however long S is along b̃. (theory, section 16.1)
/// \return the status of `validate`.
template <typename Scalar>
[[nodiscard]] Status angle_bound(const Direction<Scalar>& direction, Scalar& angle) noexcept {
  if (const Status status = validate(direction); status != Status::ok) {
    return status;
  }
  const Vector3<Scalar> b = scalar::unit(direction.body);
  int least = 0;
  b.cwiseAbs().minCoeff(&least);
  const Vector3<Scalar> first = b.cross(Vector3<Scalar>::Unit(least)).normalized();
  const Vector3<Scalar> second = b.cross(first);
  const Vector3<Scalar> s1 = direction.bound.lazyProduct(first);
  const Vector3<Scalar> s2 = direction.bound.lazyProduct(second);
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar mean = half * (first.dot(s1) + second.dot(s2));
  const Scalar difference = half * (first.dot(s1) - second.dot(s2));
  const Scalar mixed = half * (first.dot(s2) + second.dot(s1));
  const Scalar lost = rounding::share<Scalar>(rounding::direction_bound) * direction.bound.trace();
  angle = scalar::sqrt(Scalar(mean + scalar::sqrt(Scalar(difference * difference + mixed * mixed)) + lost));
  return Status::ok;
}

namespace detail {

/// `cone` of unit vectors and an angle that is not negative.
/// \return `not_finite` of the center.
template <typename Scalar>
[[nodiscard]] Status cone_of_units(const Matrix3<Scalar>& center, const Vector3<Scalar>& axis,
                                   const Vector3<Scalar>& body, const Scalar& bound,
                                   Quadric<Scalar, 3>& quadric) noexcept {
  const Vector3<Scalar> predicted = Vector3<Scalar>(center.transpose().lazyProduct(axis)).normalized();
  if (!scalar::all_finite(predicted)) {
    return Status::not_finite;
  }
  const Scalar angle =
      bound * (Scalar(1) + rounding::share<Scalar>(rounding::direction)) + rounding::share<Scalar>(rounding::direction);
  if (!(angle < scalar::pi<Scalar>())) {
    quadric = {Matrix3<Scalar>::Zero(), Vector3<Scalar>::Zero(), Scalar(1)};
    return Status::ok;
  }
  const Scalar sine = scalar::sin(Scalar(scalar::constant<Scalar>(0.5L) * angle));
  const Scalar versine = Scalar(2) * sine * sine;
  const Scalar inverse = Scalar(1) / versine;
  const Vector3<Scalar> difference = predicted - body;
  const Vector3<Scalar> d = body.cross(difference);  // b̃ × b̂ without cancellation
  const Matrix3<Scalar> mixed = predicted.lazyProduct(body.transpose());
  Matrix3<Scalar> a = -(mixed + mixed.transpose());
  a.diagonal().array() +=
      (Scalar(1) - versine) + predicted.dot(body) - rounding::share<Scalar>(rounding::cone_curvature);
  quadric.a = (scalar::constant<Scalar>(0.25L) * inverse) * a;
  quadric.g = (scalar::constant<Scalar>(-0.5L) * inverse) * d;
  quadric.c =
      Scalar(1) + rounding::share<Scalar>(rounding::cone_level) -
      (scalar::constant<Scalar>(0.5L) * (Scalar(1) - rounding::share<Scalar>(rounding::cone_misfit)) * inverse) *
          difference.squaredNorm();
  return Status::ok;
}

}  // namespace detail

/// The attitudes with ∠(Cᵀe, b̃) ≤ r, exactly, in γ about any center: with b̂ = Ĉᵀe, c = b̂·b̃, d = b̃ × b̂,
///
///     ¼ γᵀ[(cos r + c) I − b̂b̃ᵀ − b̃b̂ᵀ]γ − d·γ ≤ 2 sin²(r/2) − ½‖b̂ − b̃‖²,
///
/// divided by 2 sin²(r/2): the slack is (1 + ¼‖γ‖²)(1 − sin²(∠/2)/sin²(r/2)), one at the middle of the cone. A little
/// wider, for rounding (theory, eq. 16.2). With r ≥ π it says nothing: A = 0, g = 0, c = 1.
/// \param center a rotation to rounding.
/// \param reference e, and \param measured b̃, of any length.
/// \param bound r, rad: the direction is known to this angle.
/// \return `not_finite`, `zero_direction`; `out_of_range` of a negative angle.
template <typename Scalar>
[[nodiscard]] Status cone(const Matrix3<Scalar>& center, const Vector3<Scalar>& reference,
                          const Vector3<Scalar>& measured, const Scalar& bound, Quadric<Scalar, 3>& quadric) noexcept {
  const Vector3<Scalar> axis = scalar::unit(reference);
  const Vector3<Scalar> body = scalar::unit(measured);
  if (!scalar::isfinite(bound) || !scalar::all_finite(axis) || !scalar::all_finite(body)) {
    return Status::not_finite;
  }
  if (!(bound >= Scalar(0))) {
    return Status::out_of_range;
  }
  if (axis.isZero(Scalar(0)) || body.isZero(Scalar(0))) {
    return Status::zero_direction;
  }
  return detail::cone_of_units(center, axis, body, bound, quadric);
}

/// The same of a direction whose error is in an ellipsoid: r is its `angle_bound`.
/// \return the status of `validate` for the direction; `not_finite` of the center.
template <typename Scalar>
[[nodiscard]] Status cone(const Matrix3<Scalar>& center, const Direction<Scalar>& direction,
                          Quadric<Scalar, 3>& quadric) noexcept {
  Scalar angle;
  if (const Status status = angle_bound(direction, angle); status != Status::ok) {
    return status;
  }
  return detail::cone_of_units(center, scalar::unit(direction.reference), scalar::unit(direction.body), angle, quadric);
}

/// A quadric of the attitude error alone, as one of [γ; δ].
template <typename Scalar>
[[nodiscard]] HalfQuadric<Scalar> of_attitude(const Quadric<Scalar, 3>& quadric) noexcept {
  return {quadric, Half::first};
}

/// A quadric of the vector's error alone, as one of [γ; δ].
template <typename Scalar>
[[nodiscard]] HalfQuadric<Scalar> of_vector(const Quadric<Scalar, 3>& quadric) noexcept {
  return {quadric, Half::second};
}

namespace detail {

/// (Tγ − γ̂)ᵀ M (Tγ − γ̂) ≤ (1 + ¼ γ̂·γ)², T = I − S(ĝ): the set γ̃ᵀMγ̃ ≤ 1 about a center that is γ̂ = 2ĝ from that of
/// γ, a little wider for rounding. (theory, section 16.2)
/// \param form M, positive definite. The center rounds by a few ε, which moves γ̃ by 1 + ¼‖γ̃‖² times as much, and that
/// by √tr M in the set's own metric at most.
/// \param longest semi-axis of the set, or more.
template <typename Scalar>
[[nodiscard]] Quadric<Scalar, 3> seen_from(const Vector3<Scalar>& gamma, const Matrix3<Scalar>& form,
                                           const Scalar& longest) noexcept {
  const Scalar moved = Scalar(1) + scalar::constant<Scalar>(0.25L) * longest * longest;
  const Scalar wider = Scalar(1) + rounding::share<Scalar>(rounding::attitude_center) *
                                       (Scalar(1) + moved * scalar::sqrt(Scalar(form.trace())));
  const Matrix3<Scalar> m = form * (Scalar(1) / (wider * wider));
  const Matrix3<Scalar> t = Matrix3<Scalar>::Identity() - scalar::constant<Scalar>(0.5L) * hat(gamma);
  const Matrix3<Scalar> half = m.lazyProduct(t);
  const Vector3<Scalar> mg = m.lazyProduct(gamma);
  const Matrix3<Scalar> a = t.transpose().lazyProduct(half);
  Quadric<Scalar, 3> quadric;
  quadric.a = symmetrized(a) - scalar::constant<Scalar>(0.0625L) * gamma.lazyProduct(gamma.transpose());
  quadric.g = -t.transpose().lazyProduct(mg) - scalar::constant<Scalar>(0.25L) * gamma;
  quadric.c = Scalar(1) - gamma.dot(mg);
  // What the products lose, of their terms without signs; of the linear one 2eᵢ|γᵢ| ≤ eᵢ (w + γᵢ²/w), w = max|γ̂ᵢ|.
  const Scalar share = rounding::share<Scalar>(rounding::attitude_products);
  const Vector3<Scalar> far = gamma.cwiseAbs();
  const Scalar farthest = far.maxCoeff();
  const Matrix3<Scalar> rows = t.cwiseAbs();
  const Matrix3<Scalar> terms = m.cwiseAbs();
  const Vector3<Scalar> seen = terms.lazyProduct(far);
  const Vector3<Scalar> linear = rows.transpose().lazyProduct(seen) + scalar::constant<Scalar>(0.25L) * far;
  Vector3<Scalar> curved =
      rows.transpose().lazyProduct(Vector3<Scalar>(terms.lazyProduct(Vector3<Scalar>(rows.rowwise().sum())))) +
      scalar::constant<Scalar>(0.0625L) * far.sum() * far;
  if (farthest > Scalar(0)) {
    curved += linear / farthest;
  }
  quadric.a.diagonal() -= share * curved;
  quadric.c += share * (Scalar(1) + far.dot(seen) + farthest * linear.sum());
  return quadric;
}

}  // namespace detail

/// A measured attitude as a quadric of γ about any center. About C̃ it is in γ̃ᵀM γ̃ ≤ 1, M⁻¹ = τ² bound with τ at the
/// largest angle, and with γ̂ = 2ĝ the error of C̃ that is, in γ about Ĉ, exactly (projectively)
///
///     (Tγ − γ̂)ᵀ M (Tγ − γ̂) ≤ (1 + ¼ γ̂·γ)², T = I − S(ĝ).
///
/// With a bound that reaches half turns, or about a center from which C̃ is, to half the digits, a half turn, it says
/// nothing: A = 0, g = 0, c = 1.
/// \return `not_finite`, `not_a_rotation`, `not_symmetric`, `not_positive_definite` of the measurement.
template <typename Scalar>
[[nodiscard]] Status to_quadric(const Matrix3<Scalar>& center, const MeasuredAttitude<Scalar>& measured,
                                Quadric<Scalar, 3>& quadric) noexcept {
  if (!scalar::all_finite(measured.attitude) || !scalar::all_finite(measured.bound)) {
    return Status::not_finite;
  }
  if (!is_rotation(measured.attitude, rotation_tolerance<Scalar>())) {
    return Status::not_a_rotation;
  }
  if (const Status status = validate_definite(measured.bound); status != Status::ok) {
    return status;
  }
  // Largest angle; a bound of less than rounding is used as if it were wider by that.
  Matrix3<Scalar> bound = symmetrized(measured.bound);
  bound.diagonal().array() += rounding::square<Scalar>();
  Matrix3<Scalar> m;
  SymmetricEigen<Scalar, 3> eigen;
  const bool bounded = symmetric_eigen(bound, eigen) == Status::ok && inverse_from_below(bound, m) == Status::ok;
  const Scalar square = bounded ? Scalar(eigen.values(0) + eigen_errors(bound, eigen).values) : Scalar(16);
  const Scalar angle =
      rounding::enlarged(Scalar(scalar::sqrt(square > Scalar(0) ? square : Scalar(0))), rounding::attitude_angle);
  // A rotation to half the digits, as it may have been stored, is off by more than the widening below: use the nearest
  // rotation.
  const Vector3<Scalar> gamma = GibbsChart::error(center, renormalized(measured.attitude));
  const Scalar farthest = Scalar(1) / rounding::root<Scalar>();
  if (!(angle < scalar::pi<Scalar>()) || !(gamma.norm() < farthest)) {
    quadric = {Matrix3<Scalar>::Zero(), Vector3<Scalar>::Zero(), Scalar(1)};
    return Status::ok;
  }
  const Scalar stretch = gibbs_stretch(angle);
  m *= Scalar(1) / (stretch * stretch);
  quadric = detail::seen_from(gamma, m, Scalar(stretch * angle));
  return Status::ok;
}

/// A set of attitudes in γ about its own center as a quadric of γ about another, exactly but for rounding. About a
/// center from which its own is, to half the digits, a half turn, it says nothing: A = 0, g = 0, c = 1.
/// \param center a rotation to rounding.
/// \param own of the set, likewise.
/// \param shape of the set.
/// \return `not_positive_definite`.
template <typename Scalar>
[[nodiscard]] Status to_quadric(const Matrix3<Scalar>& center, const Matrix3<Scalar>& own, const Matrix3<Scalar>& shape,
                                Quadric<Scalar, 3>& quadric) noexcept {
  Matrix3<Scalar> m;
  if (const Status status = inverse_from_below(shape, m); status != Status::ok) {
    return status;
  }
  const Vector3<Scalar> gamma = GibbsChart::error(center, own);
  if (!(gamma.norm() < Scalar(1) / rounding::root<Scalar>())) {
    quadric = {Matrix3<Scalar>::Zero(), Vector3<Scalar>::Zero(), Scalar(1)};
    return Status::ok;
  }
  quadric = detail::seen_from(gamma, m, Scalar(scalar::sqrt(Scalar(shape.trace()))));
  return Status::ok;
}

/// A measured angular velocity as a quadric of δω about a center: (δω − (ω̃ − ω̂))ᵀ bound⁻¹ (δω − (ω̃ − ω̂)) ≤ 1.
/// \return the status of `validate`.
template <typename Scalar>
[[nodiscard]] Status to_quadric(const Vector3<Scalar>& center, const AngularVelocity<Scalar>& measured,
                                Quadric<Scalar, 3>& quadric) noexcept {
  return to_quadric(Ellipsoid<Scalar, 3>{measured.value - center, measured.bound}, quadric);
}

/// A linear measurement y = H [ζ; δ] + v as a quadric of [γ; δ]: γ is in the prediction, so ζ − γ is in E(0, (1 − 1/τ)²
/// P_γγ), and H's image of that is added to the bound of v. No state of the prediction is lost by rounding.
/// \return the status of `covered_quadric`.
template <typename State, int Rows>
[[nodiscard]] Status to_quadric(const LinearMeasurement<StateScalar<State>, Rows>& measurement,
                                const StateEllipsoid<State, GibbsChart>& predicted,
                                Quadric<StateScalar<State>, 6>& quadric) noexcept {
  using Scalar = StateScalar<State>;
  LinearMeasurement<Scalar, Rows> wider = measurement;
  const Matrix<Scalar, Rows, 3> h = measurement.h.template leftCols<3>();
  if (h.cwiseAbs().maxCoeff() > Scalar(0)) {
    Scalar length;
    if (const Status status = largest_attitude_error(predicted, length); status != Status::ok) {
      return status;
    }
    const Scalar rest = (length > Scalar(0) ? Scalar(Scalar(1) - GibbsChart::angle(length) / length) : Scalar(0)) +
                        rounding::share<Scalar>(rounding::attitude_angle);
    const Matrix<Scalar, Rows> added =
        (rest * rest) * covered_image(h, Matrix3<Scalar>(predicted.shape.template topLeftCorner<3, 3>()));
    Matrix<Scalar, Rows> inverse;
    if (const Status status = inverse_positive_definite(measurement.bound, inverse); status != Status::ok) {
      return status;
    }
    const Scalar p = scalar::sqrt(Scalar(inverse.cwiseProduct(added).sum() / Scalar(Rows)));
    if (p > Scalar(0)) {
      wider.bound = (Scalar(1) + p) * measurement.bound +
                    (scalar::constant<Scalar>(0.5L) + scalar::constant<Scalar>(0.5L) / p) * (added + added.transpose());
      wider.bound.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::sum);
    }
  }
  return covered_quadric(wider, Vector6<Scalar>(predicted.shape.diagonal().cwiseSqrt()), quadric);
}

}  // namespace elliptude
