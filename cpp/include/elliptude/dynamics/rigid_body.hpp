#pragma once

/// \file
/// The rigid body: its inertia and what follows from it (paper, §2.3.1). SI units, body axes.

#include "elliptude/attitude/state.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/eigen.hpp"
#include "elliptude/linear/inverse.hpp"

namespace elliptude {

/// An inertia that a mass distribution can have. `make` checks it, so that every `RigidBody` is valid.
template <typename Scalar>
class RigidBody {
 public:
  /// Whether its free motion is exact; see `ExactRotor`.
  static constexpr bool is_exact = false;

  /// A body with unit inertia.
  ELLIPTUDE_SELDOM RigidBody() noexcept
      : inertia_(Matrix3<Scalar>::Identity()),
        inertia_inverse_(Matrix3<Scalar>::Identity()),
        nonstandard_inertia_(scalar::constant<Scalar>(0.5L) * Matrix3<Scalar>::Identity()),
        principal_moments_(Vector3<Scalar>::Ones()),
        least_moment_(1),
        greatest_moment_(1) {}

  /// \param inertia J in kg m², about the point that the body turns about.
  /// \return `not_finite`, `not_symmetric`, `not_positive_definite`; `beyond_domain` if the sum of the moments or the
  /// inverse overflows; `invalid_inertia` if a principal moment exceeds the sum of the others (equality, a flat body, is
  /// allowed).
  [[nodiscard]] static ELLIPTUDE_SELDOM Status make(const Matrix3<Scalar>& inertia, RigidBody& body) noexcept {
    if (!scalar::all_finite(inertia)) {
      return Status::not_finite;
    }
    if (!is_symmetric(inertia)) {
      return Status::not_symmetric;
    }
    if (!scalar::isfinite(Scalar(inertia.cwiseAbs().sum()))) {
      return Status::beyond_domain;
    }
    RigidBody result;
    result.inertia_ = symmetrized(inertia);
    if (const Status status = inverse_positive_definite(result.inertia_, result.inertia_inverse_);
        status != Status::ok) {
      return status;
    }
    if (!scalar::all_finite(result.inertia_inverse_)) {
      return Status::beyond_domain;
    }
    SymmetricEigen<Scalar, 3> eigen;
    if (const Status status = symmetric_eigen(result.inertia_, eigen); status != Status::ok) {
      return status;
    }
    const Scalar rounding = rounding::share<Scalar>(rounding::moments) * eigen.values(0);
    if (!(eigen.values(0) <= eigen.values(1) + eigen.values(2) + rounding)) {
      return Status::invalid_inertia;
    }
    result.principal_moments_ = eigen.values;
    const Scalar error = eigen_errors(result.inertia_, eigen).values;
    result.least_moment_ = eigen.values(2) - error;
    result.greatest_moment_ = eigen.values(0) + error;
    result.nonstandard_inertia_ =
        scalar::constant<Scalar>(0.5L) * result.inertia_.trace() * Matrix3<Scalar>::Identity() - result.inertia_;
    body = result;
    return Status::ok;
  }

  /// J, kg m².
  [[nodiscard]] const Matrix3<Scalar>& inertia() const noexcept { return inertia_; }
  [[nodiscard]] const Matrix3<Scalar>& inertia_inverse() const noexcept { return inertia_inverse_; }
  /// J_d = ½ tr(J) I − J (paper, after eq. updatew0).
  [[nodiscard]] const Matrix3<Scalar>& nonstandard_inertia() const noexcept { return nonstandard_inertia_; }
  /// Eigenvalues of J, largest first.
  [[nodiscard]] const Vector3<Scalar>& principal_moments() const noexcept { return principal_moments_; }
  /// No moment of inertia about any axis is less, or more, whatever rounding did to the eigenvalues; the lower bound of a
  /// needle's may be negative. (theory, section 17.2)
  ///@{
  [[nodiscard]] Scalar least_moment() const noexcept { return least_moment_; }
  [[nodiscard]] Scalar greatest_moment() const noexcept { return greatest_moment_; }
  ///@}

  /// ½ ωᵀJω, in joule.
  [[nodiscard]] Scalar kinetic_energy(const Vector3<Scalar>& angular_velocity) const noexcept {
    return scalar::constant<Scalar>(0.5L) * angular_velocity.dot(inertia_ * angular_velocity);
  }

  /// CJω, the angular momentum in reference axes, in N m s: constant for a free body.
  [[nodiscard]] Vector3<Scalar> angular_momentum(const RigidBodyState<Scalar>& state) const noexcept {
    return state.attitude * (inertia_ * state.angular_velocity);
  }

  /// The same body for another scalar type. Its inertia is rounded, and the bounds of its moments are as much wider.
  template <typename Other>
  [[nodiscard]] RigidBody<Other> cast() const noexcept {
    RigidBody<Other> result;
    result.inertia_ = inertia_.template cast<Other>();
    result.inertia_inverse_ = inertia_inverse_.template cast<Other>();
    result.nonstandard_inertia_ = nonstandard_inertia_.template cast<Other>();
    result.principal_moments_ = principal_moments_.template cast<Other>();
    const Other greatest = static_cast<Other>(greatest_moment_);
    const Other rounding = rounding::share<Other>(rounding::inertia_cast) * greatest;
    result.least_moment_ = static_cast<Other>(least_moment_) - rounding;
    result.greatest_moment_ = greatest + rounding;
    return result;
  }

 private:
  template <typename>
  friend class RigidBody;

  Matrix3<Scalar> inertia_;
  Matrix3<Scalar> inertia_inverse_;
  Matrix3<Scalar> nonstandard_inertia_;
  Vector3<Scalar> principal_moments_;
  Scalar least_moment_;
  Scalar greatest_moment_;
};

}  // namespace elliptude
