#pragma once

/// \file
/// Potentials of one's own that a guaranteed flow can use. (theory, sections 5 and 17.10)
///
/// Every U that is a polynomial of at most second degree in the entries of C is a sum of a `LinearPotential` or more
/// and of a `QuadraticPotential` or more: a dipole in a field, a spring, a weight; a gravity gradient, an induced
/// dipole. Nothing has to be stated about them. Any other torque, with a potential or without, is used through a
/// `StatedTorque`: functions, and a statement of how far they may be off.

#include "elliptude/dynamics/potential.hpp"

namespace elliptude {

/// A unit vector in reference axes that stands still, or turns at a constant rate in the plane across an axis.
template <typename Scalar>
class TurningDirection {
 public:
  /// The first reference axis, standing still.
  TurningDirection() noexcept : start_(Vector3<Scalar>::UnitX()), along_(Vector3<Scalar>::Zero()), rate_(Scalar(0)) {}

  /// \param direction at time 0, reference axes; any length above zero.
  /// \param turn the angular velocity of the direction, rad/s, reference axes: zero, or at right angles to the
  /// direction: what is off by rounding is put right, so that the direction turns about the turn's axis.
  /// \return `not_finite`; `zero_direction`; `out_of_range` of a turn that is not at right angles.
  [[nodiscard]] static Status make(const Vector3<Scalar>& direction, const Vector3<Scalar>& turn,
                                   TurningDirection& result) noexcept {
    if (!scalar::all_finite(direction) || !scalar::all_finite(turn)) {
      return Status::not_finite;
    }
    if (!(direction.cwiseAbs().maxCoeff() > Scalar(0))) {
      return Status::zero_direction;
    }
    const Scalar rate = scalar::length(turn);
    if (!scalar::isfinite(rate)) {
      return Status::out_of_range;
    }
    TurningDirection made;
    made.start_ = scalar::unit(direction);
    made.rate_ = rate;
    if (rate > Scalar(0)) {
      const Vector3<Scalar> axis = scalar::unit(turn);
      if (!(scalar::abs(Scalar(axis.dot(made.start_))) <= rotation_tolerance<Scalar>())) {
        return Status::out_of_range;
      }
      const Vector3<Scalar> along = axis.cross(made.start_);
      made.along_ = along / scalar::sqrt(Scalar(along.squaredNorm()));
      made.start_ = made.along_.cross(axis);
    }
    result = made;
    return Status::ok;
  }

  [[nodiscard]] const Vector3<Scalar>& start() const noexcept { return start_; }  ///< r(0)
  [[nodiscard]] const Vector3<Scalar>& along() const noexcept { return along_; }  ///< r'(0) over the rate; zero at rest
  [[nodiscard]] const Scalar& rate() const noexcept { return rate_; }             ///< n, rad/s

  /// r(t) = cos(nt) r(0) + sin(nt) r'(0)/n.
  [[nodiscard]] Vector3<Scalar> at(const Scalar& time) const noexcept {
    const Scalar angle = rate_ * time;
    return scalar::cos(angle) * start_ + scalar::sin(angle) * along_;
  }
  /// r(−t).
  [[nodiscard]] TurningDirection backward() const noexcept {
    TurningDirection result = *this;
    result.along_ *= Scalar(-1);
    return result;
  }

 private:
  Vector3<Scalar> start_;
  Vector3<Scalar> along_;
  Scalar rate_;
};

/// U = −pᵀb with b = Cᵀr(t) and a vector p of the body: a magnetic dipole in a field, a weight, a force at a point.
/// M = p × b, ∂M/∂ζ = S(p) S(b).
template <typename Scalar>
class LinearPotential {
 public:
  /// No torque.
  LinearPotential() noexcept : moment_(Vector3<Scalar>::Zero()) {}

  /// \param moment p in N m, body axes: the dipole times the field's strength, or an arm times a force.
  /// \return `not_finite`.
  [[nodiscard]] static Status make(const Vector3<Scalar>& moment, const TurningDirection<Scalar>& direction,
                                   LinearPotential& potential) noexcept {
    if (!scalar::all_finite(moment)) {
      return Status::not_finite;
    }
    potential.moment_ = moment;
    potential.direction_ = direction;
    return Status::ok;
  }

  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return -moment_.dot(seen(attitude, time));
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return moment_.cross(seen(attitude, time));
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return hat_product(moment_, seen(attitude, time));
  }
  /// ½ ‖p‖, as for `UniformGravity`.
  [[nodiscard]] Scalar torque_curvature_bound() const noexcept {
    return scalar::constant<Scalar>(0.5L) * scalar::sqrt(Scalar(moment_.squaredNorm()));
  }
  [[nodiscard]] LinearPotential backward() const noexcept {
    LinearPotential result = *this;
    result.direction_ = direction_.backward();
    return result;
  }

  [[nodiscard]] const Vector3<Scalar>& moment() const noexcept { return moment_; }  ///< p, N m, body axes
  [[nodiscard]] const TurningDirection<Scalar>& direction() const noexcept { return direction_; }

 private:
  [[nodiscard]] Vector3<Scalar> seen(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return attitude.transpose() * direction_.at(time);
  }

  Vector3<Scalar> moment_;
  TurningDirection<Scalar> direction_;
};

/// U = ½ bᵀKb with b = Cᵀr(t) and a symmetric K of the body: the gravity gradient of any mass, a dipole that a field
/// induces. M = b × Kb, ∂M/∂ζ = (S(b)K − S(Kb)) S(b).
template <typename Scalar>
class QuadraticPotential {
 public:
  /// No torque.
  QuadraticPotential() noexcept : matrix_(Matrix3<Scalar>::Zero()) {}

  /// \param matrix K in N m, body axes, symmetric; multiples of the identity do nothing.
  /// \return `not_finite`, `not_symmetric`.
  [[nodiscard]] static Status make(const Matrix3<Scalar>& matrix, const TurningDirection<Scalar>& direction,
                                   QuadraticPotential& potential) noexcept {
    if (!scalar::all_finite(matrix)) {
      return Status::not_finite;
    }
    if (!is_symmetric(matrix)) {
      return Status::not_symmetric;
    }
    potential.matrix_ = symmetrized(matrix);
    potential.direction_ = direction;
    return Status::ok;
  }

  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    const Vector3<Scalar> b = seen(attitude, time);
    return scalar::constant<Scalar>(0.5L) * b.dot(matrix_ * b);
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    const Vector3<Scalar> b = seen(attitude, time);
    return b.cross(Vector3<Scalar>(matrix_ * b));
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    const Vector3<Scalar> b = seen(attitude, time);
    const Vector3<Scalar> kb = matrix_ * b;
    const Matrix3<Scalar> sb = hat(b);
    return sb.lazyProduct(Matrix3<Scalar>(matrix_.lazyProduct(sb))) - hat_product(kb, b);
  }
  /// Twice the norm of K less a third of its trace: at least the difference of K's greatest and least eigenvalue.
  [[nodiscard]] Scalar torque_curvature_bound() const noexcept {
    Matrix3<Scalar> deviator = matrix_;
    deviator.diagonal().array() -= matrix_.trace() / Scalar(3);
    return Scalar(2) * scalar::sqrt(Scalar(deviator.squaredNorm()));
  }
  [[nodiscard]] QuadraticPotential backward() const noexcept {
    QuadraticPotential result = *this;
    result.direction_ = direction_.backward();
    return result;
  }

  [[nodiscard]] const Matrix3<Scalar>& matrix() const noexcept { return matrix_; }  ///< K, N m, body axes
  [[nodiscard]] const TurningDirection<Scalar>& direction() const noexcept { return direction_; }

 private:
  [[nodiscard]] Vector3<Scalar> seen(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return attitude.transpose() * direction_.at(time);
  }

  Matrix3<Scalar> matrix_;
  TurningDirection<Scalar> direction_;
};

/// What a user states of a torque M° that he gives by functions M(C, t) and 𝓜(C, t): for all C, t, s and all ‖ζ‖ ≤ π
///
///     ‖M°(C exp(S(ζ)), t + s) − M(C, t) − 𝓜(C, t) ζ‖ ≤ error + curvature ‖ζ‖² + rate |s|.   (theory, eq. 17.11)
///
/// M° is the torque that acts on the body. The error covers all by which the functions are wrong: rounding, a table's
/// interpolation, π times the error of 𝓜; and that C is a rotation to rounding only.
template <typename Scalar>
struct TorqueStatement {
  Scalar curvature = Scalar(0);  ///< κ, N m/rad²: half of the largest second derivative along any turn
  Scalar rate = Scalar(0);       ///< N m/s: of the torque at a fixed attitude; zero if it does not depend on time
  Scalar error = Scalar(0);      ///< N m
};

/// A torque by functions at the time −t.
template <typename Scalar, typename Torque>
class BackwardTorque {
 public:
  BackwardTorque() = default;
  explicit BackwardTorque(const Torque& forward) noexcept : forward_(forward) {}

  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return forward_.energy(attitude, Scalar(-time));
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return forward_.torque(attitude, Scalar(-time));
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return forward_.torque_jacobian(attitude, Scalar(-time));
  }
  [[nodiscard]] const Torque& backward() const noexcept { return forward_; }

 private:
  Torque forward_;
};

/// A torque of one's own by functions, with what is stated of it. It need not have a potential: with `torque` and
/// `torque_jacobian` alone it can be used in a guaranteed flow, with `energy` also in a flow of first order.
template <typename Scalar, typename Torque>
class StatedTorque {
 public:
  StatedTorque() = default;

  /// \param torque any type with `torque` and `torque_jacobian` as in dynamics/potential.hpp. A torque that is not
  /// finite makes a prediction fail with `callback_failed`.
  /// \return `not_finite`; `out_of_range` of a negative number.
  [[nodiscard]] static Status make(const Torque& torque, const TorqueStatement<Scalar>& statement,
                                   StatedTorque& result) noexcept {
    for (const Scalar& number : {statement.curvature, statement.rate, statement.error}) {
      if (!scalar::isfinite(number)) {
        return Status::not_finite;
      }
      if (!(number >= Scalar(0))) {
        return Status::out_of_range;
      }
    }
    result.torque_ = torque;
    result.statement_ = statement;
    return Status::ok;
  }

  [[nodiscard]] Scalar energy(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return torque_.energy(attitude, time);
  }
  [[nodiscard]] Vector3<Scalar> torque(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return torque_.torque(attitude, time);
  }
  [[nodiscard]] Matrix3<Scalar> torque_jacobian(const Matrix3<Scalar>& attitude, const Scalar& time) const noexcept {
    return torque_.torque_jacobian(attitude, time);
  }
  [[nodiscard]] Scalar torque_curvature_bound() const noexcept { return statement_.curvature; }
  [[nodiscard]] const TorqueStatement<Scalar>& statement() const noexcept { return statement_; }
  /// What is stated says the same of both directions of time. A torque that does not say what it is at −t is asked
  /// there.
  [[nodiscard]] auto backward() const noexcept {
    if constexpr (goes_backward<Torque>) {
      return backward_by(torque_.backward());
    } else {
      return backward_by(BackwardTorque<Scalar, Torque>(torque_));
    }
  }

 private:
  template <typename, typename>
  friend class StatedTorque;

  template <typename Backward>
  [[nodiscard]] StatedTorque<Scalar, Backward> backward_by(const Backward& torque) const noexcept {
    StatedTorque<Scalar, Backward> result;
    result.torque_ = torque;
    result.statement_ = statement_;
    return result;
  }

  Torque torque_;
  TorqueStatement<Scalar> statement_;
};

}  // namespace elliptude
