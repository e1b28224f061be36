#pragma once

/// \file
/// The ellipsoid that directions and an angular velocity measure (paper, eqs. zetakpm, Pmkl, mea), lane by lane where
/// all is as usual; see lanewise_sets.hpp.

#include "elliptude/first_order/detail/lanewise_sets.hpp"
#include "elliptude/measurement/linearization.hpp"

namespace elliptude::detail::lanewise {

/// `unit` of a vector whose square is precise. \return where it is.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> unit(const Vector3<Scalar>& v, Vector3<Scalar>& result) noexcept {
  const Scalar square = v.squaredNorm();
  result = v / scalar::sqrt(square);
  return scalar::has_precise_square(square);
}

/// Where `validate` accepts a bound without a zero width.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> is_bound(const Matrix3<Scalar>& bound) noexcept {
  Matrix3<Scalar> factor;
  return finite(bound) && in_domain(bound) && symmetric(bound) && lanewise::cholesky(bound, factor);
}

/// `foam_root`. \return where it has settled.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> foam_root(const Scalar& square, const Scalar& determinant, const Scalar& adjugate_square,
                                      Scalar& lambda) noexcept {
  lambda = scalar::sqrt(Scalar(square + scalar::constant<Scalar>(3.4641016151377546L) * scalar::sqrt(adjugate_square)));
  Truth<Scalar> settled = !everywhere<Scalar>();
  constexpr int most_steps = 8;
  for (int step = 0; step < most_steps && !scalar::all(settled); ++step) {
    const Scalar gap = lambda * lambda - square;
    const Scalar value = gap * gap - Scalar(8) * lambda * determinant - Scalar(4) * adjugate_square;
    const Scalar change = value / (Scalar(4) * lambda * gap - Scalar(8) * determinant);
    const Scalar next = lambda - change;
    lambda = scalar::select(settled, lambda, next);
    settled = settled || scalar::abs(change) <= rounding::root<Scalar>() * next;
  }
  return settled;
}

/// `attitude_of_profile` by `foam`. \return where the condition leaves it digits enough.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> attitude_by_foam(const Matrix3<Scalar>& given, Matrix3<Scalar>& attitude) noexcept {
  Scalar size(0);
  for (int k = 0; k < 9; ++k) {
    size = greater(size, scalar::abs(given.data()[k]));
  }
  const Matrix3<Scalar> profile = given / size;
  const Vector3<Scalar> l0 = profile.col(0);
  const Vector3<Scalar> l1 = profile.col(1);
  const Vector3<Scalar> l2 = profile.col(2);
  Matrix3<Scalar> cofactors;
  cofactors.col(0) = l1.cross(l2);
  cofactors.col(1) = l2.cross(l0);
  cofactors.col(2) = l0.cross(l1);
  const Scalar determinant = l0.dot(Vector3<Scalar>(cofactors.col(0)));
  const Scalar square = profile.squaredNorm();
  Scalar lambda;
  const Truth<Scalar> settled = foam_root<Scalar>(square, determinant, cofactors.squaredNorm(), lambda);
  const Scalar kappa = scalar::constant<Scalar>(0.5L) * (lambda * lambda - square);
  const Scalar zeta = kappa * lambda - determinant;
  attitude = foam_attitude(profile, cofactors, Scalar(kappa + square), lambda, zeta).attitude;
  return size > Scalar(0) && settled && zeta > scalar::constant<Scalar>(least_share_of_foam) * lambda * lambda * lambda;
}

/// `MeasuredDirections::make` of at least two directions.
/// \param terms of each direction, the shape of the effect of its error.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> measured_directions(const Direction<Scalar>* directions, std::size_t count,
                                                Matrix3<Scalar>& attitude, Matrix3<Scalar>* terms) noexcept {
  Truth<Scalar> usual = everywhere<Scalar>();
  Scalar largest(0);
  for (std::size_t i = 0; i < count; ++i) {
    const Scalar& weight = directions[i].weight;
    usual = usual && weight > Scalar(0) && weight - weight == Scalar(0) && is_bound(directions[i].bound);
    largest = greater(largest, weight);
  }
  std::array<Vector3<Scalar>, most_directions> e;
  std::array<Vector3<Scalar>, most_directions> b;
  Matrix3<Scalar> profile = Matrix3<Scalar>::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    usual = usual && lanewise::unit(directions[i].reference, e[i]) && lanewise::unit(directions[i].body, b[i]);
    profile += profile_term(Scalar(directions[i].weight / largest), e[i], b[i]);
  }
  usual = usual && lanewise::attitude_by_foam(profile, attitude);
  const Matrix3<Scalar> a = attitude.transpose() * profile;
  const Matrix3<Scalar> curvature = a.trace() * Matrix3<Scalar>::Identity() - a;
  const Matrix3<Scalar> inverse = curvature.inverse();
  for (std::size_t i = 0; i < count; ++i) {
    terms[i] =
        direction_effect(attitude, inverse, Scalar(-directions[i].weight / largest), e[i], b[i], directions[i].bound);
  }
  return usual;
}

/// `MeasuredDirections::measured_attitude` by least trace, of at least two directions. \return where it reaches less
/// than a radian.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> measured_attitude(const Direction<Scalar>* directions, std::size_t count,
                                              MeasuredAttitude<Scalar>& measured) noexcept {
  std::array<Matrix3<Scalar>, most_directions> terms;
  const Truth<Scalar> usual = measured_directions(directions, count, measured.attitude, terms.data());
  return usual &&
         lanewise::minimal_sum<most_directions>(terms.data(), count, SizeCriterion<Scalar, 3>::trace(),
                                                measured.bound) &&
         measured.bound.trace() <= scalar::constant<Scalar>(0.9L);
}

/// `measured_state` of at least two directions and an angular velocity, for a criterion that `validate` accepts.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> measured_state(const Direction<Scalar>* directions, std::size_t count,
                                           const AngularVelocity<Scalar>& angular_velocity,
                                           const SizeCriterion<Scalar, 6>& criterion,
                                           StateEllipsoid<RigidBodyState<Scalar>>& measured) noexcept {
  std::array<Matrix3<Scalar>, most_directions> terms;
  Matrix3<Scalar> bound;
  Truth<Scalar> usual = measured_directions(directions, count, measured.center.attitude, terms.data());
  usual = usual && lanewise::minimal_sum<most_directions>(terms.data(), count, criterion.template of_first<3>(), bound);
  measured.center.angular_velocity = angular_velocity.value;
  usual = usual && finite(angular_velocity.value) && is_bound(angular_velocity.bound);
  return usual && lanewise::product_of_shapes(bound, angular_velocity.bound, criterion, measured.shape);
}

}  // namespace elliptude::detail::lanewise
