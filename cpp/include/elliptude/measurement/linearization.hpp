#pragma once

/// \file
/// The ellipsoid of several measurements together (paper, §3.2), and each as linear rows of the error, to first order.

#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/attitude/wahba.hpp"
#include "elliptude/base/limits.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/measurement/types.hpp"

namespace elliptude {

namespace detail {

/// 𝒜ⁱ Sⁱ 𝒜ⁱᵀ of one direction, with 𝒜ⁱ = −(tr(A) I − A)⁻¹ wᵢ (tr(Aᵢ) I − Aᵢ), Aᵢ = b̃ᵢ eᵢᵀ Ĉ (paper, eq. zetakpm).
/// \param inverse (tr(A) I − A)⁻¹, \param share −wᵢ, in the units that A has.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> direction_effect(const Matrix3<Scalar>& attitude, const Matrix3<Scalar>& inverse,
                                               const Scalar& share, const Vector3<Scalar>& e, const Vector3<Scalar>& b,
                                               const Matrix3<Scalar>& bound) noexcept {
  const Matrix3<Scalar> ai = b * (attitude.transpose() * e).transpose();
  const Matrix3<Scalar> sensitivity = share * inverse * (ai.trace() * Matrix3<Scalar>::Identity() - ai);
  const Matrix3<Scalar> term = sensitivity * bound * sensitivity.transpose();
  return symmetrized(term);
}

}  // namespace detail

/// The attitude that minimises Wahba's cost for the directions, and 𝒜ⁱ with ζ = Σ 𝒜ⁱ νⁱ to first order (paper, eq.
/// zetakpm): 𝒜ⁱ = −(tr(A) I − A)⁻¹ wᵢ (tr(Aᵢ) I − Aᵢ), A = Ĉᵀ Σ wᵢ eᵢ b̃ᵢᵀ, Aᵢ = b̃ᵢ eᵢᵀ Ĉ.
template <typename Scalar>
class MeasuredDirections {
 public:
  static constexpr std::size_t most_directions = elliptude::most_directions;

  /// \return the status of `validate` for a direction; `attitude_undetermined` for fewer than two, or collinear ones;
  /// `out_of_range` for more than `most_directions`, or a null pointer to any.
  [[nodiscard]] static Status make(const Direction<Scalar>* directions, std::size_t count, WahbaMethod method,
                                   MeasuredDirections& measured) noexcept {
    return make_by([method](const Matrix3<Scalar>& profile,
                            Matrix3<Scalar>& attitude) { return attitude_of_profile(profile, method, attitude); },
                   directions, count, measured);
  }

  /// The same by FOAM: a program that calls nothing else is not linked with the other methods.
  [[nodiscard]] static Status make(const Direction<Scalar>* directions, std::size_t count,
                                   MeasuredDirections& measured) noexcept {
    return make_by([](const Matrix3<Scalar>& profile,
                      Matrix3<Scalar>& attitude) { return foam_attitude_of_profile(profile, attitude); },
                   directions, count, measured);
  }

  [[nodiscard]] const Matrix3<Scalar>& attitude() const noexcept { return attitude_; }
  /// How many directions there are, and the shape 𝒜ⁱ Sⁱ 𝒜ⁱᵀ of the effect of one direction's error on ζ.
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
  /// \param solve finds the attitude of a profile.
  template <typename Solve>
  [[nodiscard]] static Status make_by(const Solve& solve, const Direction<Scalar>* directions, std::size_t count,
                                      MeasuredDirections& measured) noexcept {
    if (count > most_directions || (count > 0 && directions == nullptr)) {
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
    if (const Status status = solve(profile, result.attitude_); status != Status::ok) {
      return status;
    }
    const Matrix3<Scalar> a = result.attitude_.transpose() * profile;
    const Matrix3<Scalar> curvature = a.trace() * Matrix3<Scalar>::Identity() - a;
    const Matrix3<Scalar> inverse = curvature.inverse();
    for (std::size_t i = 0; i < count; ++i) {
      const Vector3<Scalar> e = scalar::unit(directions[i].reference);
      const Vector3<Scalar> b = scalar::unit(directions[i].body);
      result.terms_[i] = detail::direction_effect(result.attitude_, inverse, Scalar(-directions[i].weight / largest), e,
                                                  b, directions[i].bound);
    }
    result.count_ = count;
    measured = result;
    return Status::ok;
  }

  Matrix3<Scalar> attitude_;
  std::array<Matrix3<Scalar>, most_directions> terms_;
  std::size_t count_ = 0;
};

/// E^m, the measured ellipsoid of directions and angular velocity together (paper, eqs. Pmkl, mea): the sum of the flat
/// ellipsoids that each error makes in [ζ; δω]. Those of the directions have an ellipsoid of ζ alone as their sum, for
/// the criterion's part.
/// \return the status of `validate` for the angular velocity and the criterion, of `minimal_sum`, and of
/// `product_of_shapes`.
template <typename Scalar>
[[nodiscard]] Status measured_state(const MeasuredDirections<Scalar>& directions,
                                    const AngularVelocity<Scalar>& angular_velocity,
                                    const SizeCriterion<Scalar, 6>& criterion,
                                    StateEllipsoid<RigidBodyState<Scalar>>& measured) noexcept {
  if (const Status status = validate(angular_velocity); status != Status::ok) {
    return status;
  }
  if (const Status status = validate(criterion); status != Status::ok) {
    return status;
  }
  MeasuredAttitude<Scalar> attitude;
  if (const Status status = directions.measured_attitude(criterion.template of_first<3>(), attitude);
      status != Status::ok) {
    return status;
  }
  Matrix6<Scalar> shape;
  if (const Status status = product_of_shapes(attitude.bound, angular_velocity.bound, criterion, shape);
      status != Status::ok) {
    return status;
  }
  measured = {{directions.attitude(), angular_velocity.value}, shape};
  return Status::ok;
}

/// One direction alone as two linear rows of ζ about a center. With b̂ = Ĉᵀe and a the shortest turn to where it was
/// measured, exp(S(a))ᵀ b̂ = b̃, it is linearized about Ĉ exp(S(a)), where the error J_r(a) (ζ − a) turns b̃ as −ν
/// does: at any distance,
///
///     Uᵀ S(b̃) a = Uᵀ S(b̃) J_r(a) ζ + Uᵀ S(b̃) ν,   J_r(a) a = a,
///
/// with the columns of U two axes across b̃; about b̃ itself the direction says nothing. (theory, section 10)
/// \return `not_finite` of the center; the status of `validate`.
template <typename Scalar>
[[nodiscard]] Status linear_direction(const Matrix3<Scalar>& center, const Direction<Scalar>& direction,
                                      LinearMeasurement<Scalar, 2>& linear) noexcept {
  if (!scalar::all_finite(center)) {
    return Status::not_finite;
  }
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
  if (sine > rounding::one_rounding<Scalar>()) {
    offset = (scalar::atan2(sine, cosine) / sine) * normal;
  } else if (cosine < Scalar(0)) {
    offset = scalar::atan2(Scalar(0), cosine) * across.col(0);
  }
  const Matrix<Scalar, 2, 3> rows = across.transpose() * hat(b);
  linear.y = rows * offset;
  linear.h.setZero();
  linear.h.template leftCols<3>() = rows * right_jacobian(offset);
  linear.bound = rows * direction.bound * rows.transpose();
  return Status::ok;
}

namespace detail {

/// `linear_attitude` of a rotation.
template <typename Scalar>
[[nodiscard]] LinearMeasurement<Scalar, 3> attitude_rows(const Matrix3<Scalar>& center,
                                                         const MeasuredAttitude<Scalar>& measured) noexcept {
  LinearMeasurement<Scalar, 3> linear;
  linear.y = ExponentialChart::error(center, measured.attitude);
  linear.h.setZero();
  linear.h.template leftCols<3>().setIdentity();
  const Matrix3<Scalar> moved = ExponentialChart::seen_from(linear.y);
  linear.bound = moved * measured.bound * moved.transpose();
  return linear;
}

}  // namespace detail

/// A whole attitude as three linear rows of ζ about a center: ζ̃ = log(ĈᵀC̃) and C = C̃ exp(S(ν)) make ζ = ζ̃ +
/// J_r⁻¹(ζ̃) ν.
/// \return `not_finite`; `not_a_rotation` of what was measured.
template <typename Scalar>
[[nodiscard]] Status linear_attitude(const Matrix3<Scalar>& center, const MeasuredAttitude<Scalar>& measured,
                                     LinearMeasurement<Scalar, 3>& linear) noexcept {
  if (!scalar::all_finite(center) || !scalar::all_finite(measured.attitude) || !scalar::all_finite(measured.bound)) {
    return Status::not_finite;
  }
  if (!is_rotation(measured.attitude, rotation_tolerance<Scalar>())) {
    return Status::not_a_rotation;
  }
  linear = detail::attitude_rows(center, measured);
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

/// \return `not_finite`; `beyond_domain`, `not_symmetric` of the bound.
template <typename Scalar, int Rows>
[[nodiscard]] Status validate(const LinearMeasurement<Scalar, Rows>& measurement) noexcept {
  if (!scalar::all_finite(measurement.y) || !scalar::all_finite(measurement.h) ||
      !scalar::all_finite(measurement.bound)) {
    return Status::not_finite;
  }
  if (!is_in_domain(measurement.bound)) {
    return Status::beyond_domain;
  }
  return is_symmetric(measurement.bound) ? Status::ok : Status::not_symmetric;
}

/// (y − Hx)ᵀ R⁻¹ (y − Hx) ≤ 1, a linear measurement in the metric of its bound: ‖y_w − H_w x‖ ≤ 1.
/// \return the status of `validate`; `not_positive_definite` of a bound with a zero width.
template <typename Scalar, int Rows>
[[nodiscard]] Status whitened(const LinearMeasurement<Scalar, Rows>& measurement, Vector<Scalar, Rows>& y,
                              Matrix<Scalar, Rows, 6>& h) noexcept {
  if (const Status status = validate(measurement); status != Status::ok) {
    return status;
  }
  Matrix<Scalar, Rows> l;
  if (const Status status = cholesky(measurement.bound, l); status != Status::ok) {
    return status;
  }
  h = solve_lower(l, measurement.h);
  y = solve_lower(l, measurement.y);
  return Status::ok;
}

}  // namespace elliptude
