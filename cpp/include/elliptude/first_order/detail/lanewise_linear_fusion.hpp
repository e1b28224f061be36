#pragma once

/// \file
/// `fuse` of many predictions with as many linear measurements (theory, section 10), lane by lane where all is as
/// usual; see lanewise_sets.hpp.

#include "elliptude/first_order/detail/lanewise_fusion.hpp"

namespace elliptude::detail::lanewise {

/// Exchanges two numbers in the lanes of the mask.
template <typename Scalar>
void swap_where(const Truth<Scalar>& mask, Scalar& a, Scalar& b) noexcept {
  const Scalar before = a;
  a = scalar::select(mask, b, a);
  b = scalar::select(mask, before, b);
}

/// The eigenvalues in order, largest first, as `symmetric_eigen` exchanges them.
template <typename Scalar, int N>
void sort_eigenvalues(SymmetricEigen<Scalar, N>& eigen) noexcept {
  for (int i = 0; i < N - 1; ++i) {
    Scalar largest = eigen.values(i);
    Scalar place(static_cast<scalar::Value<Scalar>>(i));
    for (int j = i + 1; j < N; ++j) {
      const Truth<Scalar> larger = eigen.values(j) > largest;
      largest = scalar::select(larger, eigen.values(j), largest);
      place = scalar::select(larger, Scalar(static_cast<scalar::Value<Scalar>>(j)), place);
    }
    for (int j = i + 1; j < N; ++j) {
      const Truth<Scalar> here = place == Scalar(static_cast<scalar::Value<Scalar>>(j));
      swap_where(here, eigen.values(i), eigen.values(j));
      for (int k = 0; k < N; ++k) {
        swap_where(here, eigen.vectors(k, i), eigen.vectors(k, j));
      }
    }
  }
}

/// `JacobiRotation::of`.
template <typename Scalar>
[[nodiscard]] JacobiRotation<Scalar> jacobi_rotation(const Scalar& difference, const Scalar& off) noexcept {
  const Scalar cotangent = difference / (Scalar(2) * off);
  const Scalar root = scalar::sqrt(Scalar(Scalar(1) + cotangent * cotangent));
  const Scalar tangent = scalar::select(cotangent >= Scalar(0), Scalar(Scalar(1) / (cotangent + root)),
                                        Scalar(Scalar(-1) / (root - cotangent)));
  const Scalar cosine = Scalar(1) / scalar::sqrt(Scalar(Scalar(1) + tangent * tangent));
  return {cosine, tangent * cosine};
}

/// Turns two numbers in the lanes of the mask.
template <typename Scalar>
void turn_where(const Truth<Scalar>& mask, const JacobiRotation<Scalar>& rotation, Scalar& first,
                Scalar& second) noexcept {
  Scalar turned_first = first;
  Scalar turned_second = second;
  rotation.turn(turned_first, turned_second);
  first = scalar::select(mask, turned_first, first);
  second = scalar::select(mask, turned_second, second);
}

/// The lanes in which `symmetric_eigen` turns coordinates p and q.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> is_turned(const Matrix<Scalar, N>& a, int p, int q) noexcept {
  Scalar largest(0);
  for (int k = 0; k < N * N; ++k) {
    largest = greater(largest, scalar::abs(a.data()[k]));
  }
  const Scalar off = scalar::abs(Scalar(a(p, q)));
  const Scalar diagonal = scalar::sqrt(scalar::abs(Scalar(a(p, p)))) * scalar::sqrt(scalar::abs(Scalar(a(q, q))));
  return !(off <= rounding::one_rounding<Scalar>() * diagonal ||
           off <= Scalar(std::numeric_limits<scalar::Value<Scalar>>::min()) ||
           off <= rounding::square<Scalar>() * largest);
}

/// `symmetric_eigen`. \return where it has converged.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> symmetric_eigen(const Matrix<Scalar, N>& symmetric,
                                            SymmetricEigen<Scalar, N>& eigen) noexcept {
  const Truth<Scalar> valid = finite(symmetric);
  Matrix<Scalar, N> a = symmetrized(symmetric);
  eigen.vectors.setIdentity();
  Truth<Scalar> converged = !valid;
  constexpr int most_sweeps = 30;
  for (int sweep = 0; sweep < most_sweeps && !scalar::all(converged); ++sweep) {
    converged = everywhere<Scalar>();
    for (int p = 0; p < N - 1; ++p) {
      for (int q = p + 1; q < N; ++q) {
        const Truth<Scalar> turned = is_turned(a, p, q);
        converged = converged && (!valid || !turned);
        const auto rotation = jacobi_rotation<Scalar>(a(q, q) - a(p, p), a(p, q));
        for (int k = 0; k < N; ++k) {
          turn_where(turned, rotation, a(k, p), a(k, q));
        }
        for (int k = 0; k < N; ++k) {
          turn_where(turned, rotation, a(p, k), a(q, k));
          turn_where(turned, rotation, eigen.vectors(k, p), eigen.vectors(k, q));
        }
        a(p, q) = scalar::select(turned, Scalar(0), a(p, q));
        a(q, p) = scalar::select(turned, Scalar(0), a(q, p));
      }
    }
  }
  eigen.values = a.diagonal();
  sort_eigenvalues(eigen);
  return valid && converged;
}

/// `weight_of_rows`. What has settled stays as it is.
/// \param usual becomes false where the eigenvalues were not found.
template <typename Scalar, int Rows, int N>
[[nodiscard]] Scalar weight_of_rows(const Vector<Scalar, Rows>& y, const Matrix<Scalar, Rows, N>& b,
                                    const RelativeSize<Scalar, N>& size, const Scalar& start,
                                    Truth<Scalar>& usual) noexcept {
  SymmetricEigen<Scalar, Rows> eigen;
  usual = usual && lanewise::symmetric_eigen(Matrix<Scalar, Rows>(b.lazyProduct(b.transpose())), eigen);
  Truth<Scalar> possible = eigen.values(Rows - 1) > Scalar(0);
  const SizeByRows<Scalar, Rows, N> by_rows(y, b, size, eigen);
  Scalar q = start;
  Truth<Scalar> settled = !possible || !usual;
  constexpr int most_steps = 20;
  for (int step = 0; step < most_steps && !scalar::all(settled); ++step) {
    Scalar slope;
    Scalar curvature;
    possible = possible && (settled || by_rows.derivatives(q, slope, curvature));
    settled = settled || !possible;
    const Scalar move = lanewise::newton_move<Scalar>(slope, curvature, Scalar(9));
    const Scalar next =
        scalar::select(move > Scalar(0), Scalar(q * (Scalar(1) + move)), Scalar(q / (Scalar(1) - move)));
    q = scalar::select(settled, q, next);
    settled = settled || scalar::abs(move) <= scalar::constant<Scalar>(1e-3L);
  }
  return scalar::select(possible && q - q == Scalar(0) && q > Scalar(0), q, start);
}

/// Where `is_rotation` accepts an attitude.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> is_rotation(const Matrix3<Scalar>& c) noexcept {
  const Matrix3<Scalar> defect = c.transpose() * c - Matrix3<Scalar>::Identity();
  Scalar largest(0);
  for (int k = 0; k < 9; ++k) {
    largest = greater(largest, scalar::abs(defect.data()[k]));
  }
  return finite(c) && largest <= rotation_tolerance<Scalar>() && c.determinant() > Scalar(0);
}

/// `overlap_with`, where the measurement and the prediction meet.
template <typename State, int Rows>
[[nodiscard]] Truth<StateScalar<State>> overlap_with(const LinearMeasurement<StateScalar<State>, Rows>& measurement,
                                                     const StateEllipsoid<State>& predicted,
                                                     StateScalar<State>& margin) noexcept {
  using Scalar = StateScalar<State>;
  const Matrix<Scalar, Rows> image = symmetric_congruence(measurement.h, predicted.shape);
  Matrix<Scalar, Rows> factor;
  const Truth<Scalar> valid =
      finite(image) && in_domain(image) && definite_cholesky(image, factor) && semidefinite(measurement.bound);
  const Vector<Scalar, Rows> d = Vector<Scalar, Rows>::Zero() - measurement.y;
  return valid && overlap<Scalar, Rows>(d, measurement.bound, image, margin) && margin >= Scalar(0);
}

/// `fuse` of linear measurements with predictions.
/// \param criterion one that `validate` accepts.
/// \return where all was as usual and the sets meet.
template <typename State, int Rows>
[[nodiscard]] Truth<StateScalar<State>> fuse(const LinearMeasurement<StateScalar<State>, Rows>& measurement,
                                             const StateEllipsoid<State>& predicted, Recentring recentring,
                                             const SizeCriterion<StateScalar<State>, 6>& criterion,
                                             Fusion<State>& fusion) noexcept {
  using Scalar = StateScalar<State>;
  Matrix6<Scalar> l;
  Matrix<Scalar, Rows> factor;
  Truth<Scalar> usual = lanewise::is_rotation(predicted.center.attitude) && finite(vector_part(predicted.center)) &&
                        finite(predicted.shape) && in_domain(predicted.shape) && symmetric(predicted.shape) &&
                        definite_cholesky(predicted.shape, l) && finite(measurement.y) && finite(measurement.h) &&
                        finite(measurement.bound) && in_domain(measurement.bound) && symmetric(measurement.bound) &&
                        lanewise::cholesky(measurement.bound, factor);
  const Vector<Scalar, Rows> y = solve_lower(factor, measurement.y);
  const Matrix<Scalar, Rows, 6> h = solve_lower(factor, measurement.h);
  const Vector6<Scalar> present = Vector6<Scalar>::Ones();
  const Matrix<Scalar, Rows, 6> b = h.lazyProduct(l);
  const Matrix6<Scalar> m = b.transpose().lazyProduct(b);
  const Vector6<Scalar> v = -b.transpose().lazyProduct(y);
  const auto slack = [&](const Vector6<Scalar>& u) noexcept -> Scalar {
    return Scalar(1) - Vector<Scalar, Rows>(y - b.lazyProduct(u)).squaredNorm();
  };
  const Problem<Scalar, 6, decltype(slack)> problem{m, v, present, slack};
  const RelativeSize<Scalar, 6> size(l, present, criterion);
  const Scalar typical = problem.typical_weight();
  usual = usual && typical > Scalar(0);
  const Scalar start = lanewise::weight_of_rows(y, b, size, typical, usual);
  LanesIntersection<Scalar, 6> intersection;
  const Vector6<Scalar> origin = Vector6<Scalar>::Zero();
  usual = lanewise::minimal_intersection(origin, l, problem, size, start, usual, intersection);
  usual = usual && !intersection.first_alone && lanewise::overlap_with(measurement, predicted, fusion.margin);
  const Matrix6<Scalar> shape = select(intersection.second_alone, predicted.shape, intersection.shape);
  const Vector6<Scalar> center = select(intersection.second_alone, origin, intersection.center);
  fusion.ellipsoid = lanewise::recentred(predicted.center, center, shape, recentring);
  fusion.share = intersection.share;
  return usual && lanewise::is_kept(fusion.ellipsoid);
}

}  // namespace elliptude::detail::lanewise
