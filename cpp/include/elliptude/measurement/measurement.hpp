#pragma once

/// \file
/// Measurements with bounded errors, and the ellipsoid that they measure (paper, §2.3.3 and §3.2), to first order.

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/attitude/wahba.hpp"
#include "elliptude/sets/quadric.hpp"

namespace elliptude {

/// A direction e, known in reference axes, measured as b̃ in body axes: Cᵀe = exp(S(ν)) b̃ with ν in E(0, bound) (paper, eqs.
/// bi, Sk).
template <typename Scalar>
struct Direction {
  Vector3<Scalar> reference;  ///< e, need not be of unit length
  Vector3<Scalar> body;       ///< b̃, need not be of unit length
  Matrix3<Scalar> bound;      ///< S, rad²
  Scalar weight;              ///< w in Wahba's problem, positive

  /// A direction known to an angle, rad.
  [[nodiscard]] static Direction within(const Vector3<Scalar>& reference, const Vector3<Scalar>& body,
                                        const Scalar& angle) noexcept {
    return {reference, body, angle * angle * Matrix3<Scalar>::Identity(), Scalar(1)};
  }
};

/// ω = ω̃ + υ with υ in E(0, bound) (paper, eqs. Omega, Tk); rad/s, body axes.
template <typename Scalar>
struct AngularVelocity {
  Vector3<Scalar> value;
  Matrix3<Scalar> bound;
};

/// A whole attitude, as a star tracker gives it: C = C̃ exp(S(ν)) with ν in E(0, bound), rad².
template <typename Scalar>
struct MeasuredAttitude {
  Matrix3<Scalar> attitude;
  Matrix3<Scalar> bound;
};

/// y = H x + v with v in E(0, bound), of the error x = [ζ; δ] about the center of the ellipsoid that it updates.
template <typename Scalar, int Rows>
struct LinearMeasurement {
  Vector<Scalar, Rows> y;
  Matrix<Scalar, Rows, 6> h;
  Matrix<Scalar, Rows> bound;
};

/// \return `not_finite`, `zero_direction`; `out_of_range` of a weight that is not positive; `beyond_domain`, `not_symmetric`,
/// `not_positive_definite` of the bound, which must have no zero width.
template <typename Scalar>
[[nodiscard]] Status validate(const Direction<Scalar>& direction) noexcept {
  if (!scalar::all_finite(direction.reference) || !scalar::all_finite(direction.body) ||
      !scalar::isfinite(direction.weight) || !scalar::all_finite(direction.bound)) {
    return Status::not_finite;
  }
  if (!(scalar::length(direction.reference) > Scalar(0)) || !(scalar::length(direction.body) > Scalar(0))) {
    return Status::zero_direction;
  }
  if (!(direction.weight > Scalar(0))) {
    return Status::out_of_range;
  }
  if (!is_in_domain(direction.bound)) {
    return Status::beyond_domain;
  }
  Matrix3<Scalar> factor;
  return is_symmetric(direction.bound) ? cholesky(direction.bound, factor) : Status::not_symmetric;
}

/// \return `not_finite`, `beyond_domain`, `not_symmetric`; `not_positive_definite` of a bound with a zero width.
template <typename Scalar>
[[nodiscard]] Status validate(const AngularVelocity<Scalar>& angular_velocity) noexcept {
  if (!scalar::all_finite(angular_velocity.value) || !scalar::all_finite(angular_velocity.bound)) {
    return Status::not_finite;
  }
  if (!is_in_domain(angular_velocity.bound)) {
    return Status::beyond_domain;
  }
  Matrix3<Scalar> factor;
  return is_symmetric(angular_velocity.bound) ? cholesky(angular_velocity.bound, factor) : Status::not_symmetric;
}

/// The attitude that minimises Wahba's cost for the directions, and 𝒜ⁱ with ζ = Σ 𝒜ⁱ νⁱ to first order (paper, eq. zetakpm):
/// 𝒜ⁱ = −(tr(A) I − A)⁻¹ wᵢ (tr(Aᵢ) I − Aᵢ), A = Ĉᵀ Σ wᵢ eᵢ b̃ᵢᵀ, Aᵢ = b̃ᵢ eᵢᵀ Ĉ.
template <typename Scalar>
class MeasuredDirections {
 public:
  static constexpr std::size_t most_directions = 32;

  /// \return what `validate` says of a direction; `attitude_undetermined` for fewer than two, or collinear ones;
  /// `out_of_range` for more than `most_directions`.
  [[nodiscard]] static Status make(const Direction<Scalar>* directions, std::size_t count, WahbaMethod method,
                                   MeasuredDirections& measured) noexcept {
    if (count > most_directions) {
      return Status::out_of_range;
    }
    if (count < 2) {
      return Status::attitude_undetermined;
    }
    MeasuredDirections result;
    Scalar largest(0);  // the weights count as shares of it
    for (std::size_t i = 0; i < count; ++i) {
      if (const Status status = validate(directions[i]); status != Status::ok) {
        return status;
      }
      largest = directions[i].weight > largest ? directions[i].weight : largest;
    }
    Matrix3<Scalar> profile = Matrix3<Scalar>::Zero();
    for (std::size_t i = 0; i < count; ++i) {
      const Vector3<Scalar> e = scalar::unit(directions[i].reference);
      const Vector3<Scalar> b = scalar::unit(directions[i].body);
      profile += profile_term(Scalar(directions[i].weight / largest), e, b);
    }
    Scalar condition;
    if (const Status status = attitude_of_profile(profile, method, result.attitude_, condition); status != Status::ok) {
      return status;
    }
    const Matrix3<Scalar> a = result.attitude_.transpose() * profile;
    const Matrix3<Scalar> curvature = a.trace() * Matrix3<Scalar>::Identity() - a;
    const Matrix3<Scalar> inverse = curvature.inverse();
    for (std::size_t i = 0; i < count; ++i) {
      const Vector3<Scalar> e = scalar::unit(directions[i].reference);
      const Vector3<Scalar> b = scalar::unit(directions[i].body);
      const Matrix3<Scalar> ai = b * (result.attitude_.transpose() * e).transpose();
      const Matrix3<Scalar> sensitivity =
          Scalar(-directions[i].weight / largest) * inverse * (ai.trace() * Matrix3<Scalar>::Identity() - ai);
      const Matrix3<Scalar> term = congruence(sensitivity, directions[i].bound);
      result.terms_[i] = symmetrized(term);
    }
    result.count_ = count;
    measured = result;
    return Status::ok;
  }

  [[nodiscard]] const Matrix3<Scalar>& attitude() const noexcept { return attitude_; }
  /// How many directions there are, and the shape 𝒜ⁱ Sⁱ 𝒜ⁱᵀ of what the error of one of them does to ζ.
  [[nodiscard]] std::size_t count() const noexcept { return count_; }
  [[nodiscard]] const Matrix3<Scalar>& term(std::size_t i) const noexcept { return terms_[i]; }

  /// The measured attitude alone: the sum of these ellipsoids.
  [[nodiscard]] Status measured_attitude(const SizeCriterion<Scalar, 3>& criterion,
                                         MeasuredAttitude<Scalar>& result) const noexcept {
    std::array<Ellipsoid<Scalar, 3>, most_directions> ellipsoids;
    for (std::size_t i = 0; i < count_; ++i) {
      ellipsoids[i] = {Vector3<Scalar>::Zero(), terms_[i]};
    }
    Ellipsoid<Scalar, 3> sum;
    if (const Status status = minimal_sum(ellipsoids.data(), count_, criterion, sum); status != Status::ok) {
      return status;
    }
    result = {attitude_, sum.shape};
    return Status::ok;
  }

 private:
  Matrix3<Scalar> attitude_;
  std::array<Matrix3<Scalar>, most_directions> terms_;
  std::size_t count_ = 0;
};

/// E^m, the measured ellipsoid of directions and angular velocity together (paper, eqs. Pmkl, mea): the sum of the flat
/// ellipsoids that each error makes in [ζ; δω].
/// \return what `validate` says of the angular velocity, and what `minimal_sum` says.
template <typename Scalar>
[[nodiscard]] Status measured_state(const MeasuredDirections<Scalar>& directions,
                                    const AngularVelocity<Scalar>& angular_velocity,
                                    const SizeCriterion<Scalar, 6>& criterion,
                                    StateEllipsoid<RigidBodyState<Scalar>>& measured) noexcept {
  if (const Status status = validate(angular_velocity); status != Status::ok) {
    return status;
  }
  std::array<Ellipsoid<Scalar, 6>, MeasuredDirections<Scalar>::most_directions + 1> terms;
  for (std::size_t i = 0; i <= directions.count(); ++i) {
    terms[i] = {Vector6<Scalar>::Zero(), Matrix6<Scalar>::Zero()};
    if (i < directions.count()) {
      terms[i].shape.template topLeftCorner<3, 3>() = directions.term(i);
    } else {
      terms[i].shape.template bottomRightCorner<3, 3>() = angular_velocity.bound;
    }
  }
  Ellipsoid<Scalar, 6> sum;
  if (const Status status = minimal_sum(terms.data(), directions.count() + 1, criterion, sum); status != Status::ok) {
    return status;
  }
  measured = {{directions.attitude(), angular_velocity.value}, sum.shape};
  return Status::ok;
}

/// One direction alone as two linear rows of ζ about a center. With b̂ = Ĉᵀe and a the shortest turn to where it was measured,
/// exp(S(a))ᵀ b̂ = b̃, it is linearized about Ĉ exp(S(a)), where the error J_r(a) (ζ − a) turns b̃ as −ν does: at any distance,
///
///     Uᵀ S(b̃) a = Uᵀ S(b̃) J_r(a) ζ + Uᵀ S(b̃) ν,   J_r(a) a = a,
///
/// with the columns of U two axes across b̃; about b̃ itself the direction says nothing. (theory, section 10)
/// \return what `validate` says.
template <typename Scalar>
[[nodiscard]] Status linear_direction(const Matrix3<Scalar>& center, const Direction<Scalar>& direction,
                                      LinearMeasurement<Scalar, 2>& linear) noexcept {
  if (const Status status = validate(direction); status != Status::ok) {
    return status;
  }
  const Vector3<Scalar> b = scalar::unit(direction.body);
  const Vector3<Scalar> predicted = center.transpose() * scalar::unit(direction.reference);
  int least = 0;
  b.cwiseAbs().minCoeff(&least);
  Matrix<Scalar, 3, 2> across;
  across.col(0) = b.cross(Vector3<Scalar>::Unit(least)).normalized();
  across.col(1) = b.cross(Vector3<Scalar>(across.col(0)));

  // a = θ n; at the antipode any axis across b̃ will do.
  const Vector3<Scalar> normal = b.cross(predicted);
  const Scalar sine = normal.norm();
  const Scalar cosine = b.dot(predicted);
  Vector3<Scalar> offset = normal;
  if (sine > Scalar(scalar::epsilon<Scalar>)) {
    offset = (scalar::atan2(sine, cosine) / sine) * normal;
  } else if (cosine < Scalar(0)) {
    offset = scalar::atan2(Scalar(0), cosine) * across.col(0);
  }
  const Matrix<Scalar, 2, 3> rows = across.transpose() * hat(b);
  linear.y = rows * offset;
  linear.h.setZero();
  linear.h.template leftCols<3>() = rows * right_jacobian(offset);
  linear.bound = congruence(rows, direction.bound);
  return Status::ok;
}

/// A whole attitude as three linear rows of ζ about a center: ζ̃ = log(ĈᵀC̃) and C = C̃ exp(S(ν)) make ζ = ζ̃ + J_r⁻¹(ζ̃) ν.
template <typename Scalar>
[[nodiscard]] Status linear_attitude(const Matrix3<Scalar>& center, const MeasuredAttitude<Scalar>& measured,
                                     LinearMeasurement<Scalar, 3>& linear) noexcept {
  if (!scalar::all_finite(measured.attitude)) {
    return Status::not_finite;
  }
  if (!is_rotation(measured.attitude, rotation_tolerance<Scalar>())) {
    return Status::not_a_rotation;
  }
  linear.y = ExponentialChart::error(center, measured.attitude);
  linear.h.setZero();
  linear.h.template leftCols<3>().setIdentity();
  const Matrix3<Scalar> moved = ExponentialChart::seen_from(linear.y);
  linear.bound = congruence(moved, measured.bound);
  return Status::ok;
}

/// An angular velocity as three linear rows of δω about a center.
template <typename Scalar>
[[nodiscard]] LinearMeasurement<Scalar, 3> linear_angular_velocity(const Vector3<Scalar>& center,
                                                                   const AngularVelocity<Scalar>& measured) noexcept {
  LinearMeasurement<Scalar, 3> linear;
  linear.y = measured.value - center;
  linear.h.setZero();
  linear.h.template rightCols<3>().setIdentity();
  linear.bound = measured.bound;
  return linear;
}

/// (y − Hx)ᵀ R⁻¹ (y − Hx) ≤ 1, a linear measurement in the metric of its bound: ‖y_w − H_w x‖ ≤ 1.
/// \return `not_finite`, `not_symmetric`; `beyond_domain`; `not_positive_definite` of a bound with a zero width.
template <typename Scalar, int Rows>
[[nodiscard]] Status whitened(const LinearMeasurement<Scalar, Rows>& measurement, Vector<Scalar, Rows>& y,
                              Matrix<Scalar, Rows, 6>& h) noexcept {
  if (!scalar::all_finite(measurement.y) || !scalar::all_finite(measurement.h) ||
      !scalar::all_finite(measurement.bound)) {
    return Status::not_finite;
  }
  if (!is_in_domain(measurement.bound)) {
    return Status::beyond_domain;
  }
  if (!is_symmetric(measurement.bound)) {
    return Status::not_symmetric;
  }
  Matrix<Scalar, Rows> l;
  if (const Status status = cholesky(measurement.bound, l); status != Status::ok) {
    return status;
  }
  h = solve_lower(l, measurement.h);
  y = solve_lower(l, measurement.y);
  return Status::ok;
}

/// What a linear measurement says of x, as a quadric that may be a cylinder.
/// \return what `whitened` says.
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

/// The angle within which a direction is known, the largest √λ of ΠSΠ, Π = I − b̃b̃ᵀ: ∠(exp(S(ν)) b̃, b̃) ≤ ‖Πν‖ for every ν.
/// (theory, section 16)
/// \return what `validate` says.
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
  angle = scalar::sqrt(Scalar(mean + scalar::sqrt(Scalar(difference * difference + mixed * mixed))));
  return Status::ok;
}

/// The attitudes with ∠(Cᵀe, b̃) ≤ r, r the `angle_bound`, exactly, in γ about any center: with b̂ = Ĉᵀe, c = b̂·b̃, d = b̃ × b̂,
///
///     ¼ γᵀ[(cos r + c) I − b̂b̃ᵀ − b̃b̂ᵀ]γ − d·γ ≤ 2 sin²(r/2) − ½‖b̂ − b̃‖²,
///
/// divided by 2 sin²(r/2): the slack is (1 + ¼‖γ‖²)(1 − sin²(∠/2)/sin²(r/2)), one at the middle of the cone. A little wider, for
/// rounding (theory, section 16). With r ≥ π it says nothing: A = 0, g = 0, c = 1.
/// \param center a rotation to rounding.
/// \return what `validate` says of the direction; `not_finite` of the center.
template <typename Scalar>
[[nodiscard]] Status cone(const Matrix3<Scalar>& center, const Direction<Scalar>& direction,
                          Quadric<Scalar, 3>& quadric) noexcept {
  const Scalar epsilon(scalar::epsilon<Scalar>);
  Scalar angle;
  if (const Status status = angle_bound(direction, angle); status != Status::ok) {
    return status;
  }
  const Vector3<Scalar> body = scalar::unit(direction.body);
  const Vector3<Scalar> predicted =
      Vector3<Scalar>(center.transpose().lazyProduct(scalar::unit(direction.reference))).normalized();
  if (!scalar::all_finite(predicted)) {
    return Status::not_finite;
  }
  angle = angle * (Scalar(1) + Scalar(16) * epsilon) + Scalar(16) * epsilon;
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
  a.diagonal().array() += (Scalar(1) - versine) + predicted.dot(body) - Scalar(32) * epsilon;
  quadric.a = (scalar::constant<Scalar>(0.25L) * inverse) * a;
  quadric.g = (scalar::constant<Scalar>(-0.5L) * inverse) * d;
  quadric.c =
      Scalar(1) + Scalar(8) * epsilon -
      (scalar::constant<Scalar>(0.5L) * (Scalar(1) - Scalar(32) * epsilon) * inverse) * difference.squaredNorm();
  return Status::ok;
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

/// A measured attitude as a quadric of γ about any center. About C̃ it is in γ̃ᵀM γ̃ ≤ 1, M⁻¹ = τ² bound with τ at the largest angle,
/// and with γ̂ = 2ĝ the error of C̃ that is, in γ about Ĉ, exactly (projectively)
///
///     (Tγ − γ̂)ᵀ M (Tγ − γ̂) ≤ (1 + ¼ γ̂·γ)², T = I − S(ĝ).
///
/// With a bound that reaches half turns, or about a center to which C̃ is a half turn but for half the digits, it says nothing:
/// A = 0, g = 0, c = 1.
/// \return `not_finite`, `not_a_rotation`, `not_symmetric`, `not_positive_definite` of the measurement.
template <typename Scalar>
[[nodiscard]] Status to_quadric(const Matrix3<Scalar>& center, const MeasuredAttitude<Scalar>& measured,
                                Quadric<Scalar, 3>& quadric) noexcept {
  const Scalar epsilon(scalar::epsilon<Scalar>);
  if (!scalar::all_finite(measured.attitude) || !scalar::all_finite(measured.bound)) {
    return Status::not_finite;
  }
  if (!is_rotation(measured.attitude, rotation_tolerance<Scalar>())) {
    return Status::not_a_rotation;
  }
  if (!is_symmetric(measured.bound)) {
    return Status::not_symmetric;
  }
  Matrix3<Scalar> m;
  if (const Status status = cholesky(measured.bound, m); status != Status::ok) {
    return status;
  }
  // Largest angle; a bound of less than rounding is used as if it were wider by that.
  Matrix3<Scalar> bound = measured.bound;
  bound.diagonal().array() += epsilon * epsilon;
  SymmetricEigen<Scalar, 3> eigen;
  const bool bounded = symmetric_eigen(bound, eigen) == Status::ok && inverse_from_below(bound, m) == Status::ok;
  const Scalar angle = bounded
                           ? Scalar(scalar::sqrt(eigen.values(0) > Scalar(0) ? Scalar(eigen.values(0)) : Scalar(0)) *
                                    (Scalar(1) + Scalar(16) * epsilon))
                           : Scalar(4);
  // A rotation to half the digits, as it may have been stored, errs by more than the widening below; the nearest one is meant.
  const Vector3<Scalar> gamma = GibbsChart::error(center, renormalized(measured.attitude));
  const Scalar farthest = Scalar(1) / scalar::sqrt(epsilon);
  if (!(angle < scalar::pi<Scalar>()) || !(gamma.norm() < farthest)) {
    quadric = {Matrix3<Scalar>::Zero(), Vector3<Scalar>::Zero(), Scalar(1)};
    return Status::ok;
  }
  // The measured center rounds by a few ε, which the shortest semi-axis has to cover.
  const Scalar shortest = scalar::sqrt(eigen.values(2) > Scalar(0) ? Scalar(eigen.values(2)) : Scalar(0));
  const Scalar wider = Scalar(1) + Scalar(32) * epsilon * (Scalar(1) + Scalar(1) / shortest);
  const Scalar stretch = gibbs_stretch(angle) * wider;
  m *= Scalar(1) / (stretch * stretch);
  const Matrix3<Scalar> t = Matrix3<Scalar>::Identity() - scalar::constant<Scalar>(0.5L) * hat(gamma);
  const Matrix3<Scalar> half = m.lazyProduct(t);
  const Vector3<Scalar> mg = m.lazyProduct(gamma);
  const Matrix3<Scalar> a = t.transpose().lazyProduct(half);
  quadric.a = symmetrized(a) - scalar::constant<Scalar>(0.0625L) * gamma.lazyProduct(gamma.transpose());
  quadric.a.diagonal().array() -= Scalar(32) * epsilon * (quadric.a.norm() + mg.norm());
  quadric.g = -t.transpose().lazyProduct(mg) - scalar::constant<Scalar>(0.25L) * gamma;
  quadric.c = Scalar(1) - gamma.dot(mg) + Scalar(64) * epsilon * (Scalar(1) + gamma.norm() * mg.norm() + mg.norm());
  return Status::ok;
}

/// A measured angular velocity as a quadric of δω about a center: (δω − (ω̃ − ω̂))ᵀ bound⁻¹ (δω − (ω̃ − ω̂)) ≤ 1.
/// \return what `validate` says.
template <typename Scalar>
[[nodiscard]] Status to_quadric(const Vector3<Scalar>& center, const AngularVelocity<Scalar>& measured,
                                Quadric<Scalar, 3>& quadric) noexcept {
  return to_quadric(Ellipsoid<Scalar, 3>{measured.value - center, measured.bound}, quadric);
}

/// A linear measurement y = H [ζ; δ] + v as a quadric of [γ; δ]: γ is in the prediction, so ζ − γ is in E(0, (1 − 1/τ)² P_γγ), and
/// H's image of that is added to the bound of v.
/// \return what `whitened` says.
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
                        Scalar(16) * Scalar(scalar::epsilon<Scalar>);
    const Matrix<Scalar, Rows> added =
        (rest * rest) * congruence(h, Matrix3<Scalar>(predicted.shape.template topLeftCorner<3, 3>()));
    Matrix<Scalar, Rows> inverse;
    if (const Status status = inverse_positive_definite(measurement.bound, inverse); status != Status::ok) {
      return status;
    }
    const Scalar p = scalar::sqrt(Scalar(inverse.cwiseProduct(added).sum() / Scalar(Rows)));
    if (p > Scalar(0)) {
      wider.bound = (Scalar(1) + p) * measurement.bound +
                    (scalar::constant<Scalar>(0.5L) + scalar::constant<Scalar>(0.5L) / p) * (added + added.transpose());
    }
  }
  return to_quadric(wider, quadric);
}

}  // namespace elliptude
