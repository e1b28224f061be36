#pragma once

/// \file
/// The singular value decomposition of a 3x3 matrix within SO(3).

#include <utility>

#include "elliptude/base/rounding.hpp"
#include "elliptude/base/status.hpp"
#include "elliptude/linear/detail/jacobi_rotation.hpp"

namespace elliptude {

/// A singular value decomposition within SO(3): a = U diag(σ₁, σ₂, s₃) Vᵀ with U and V rotations, σ₁ ≥ σ₂ ≥ |s₃|. The
/// last value carries the sign of det a, which is what Wahba's problem needs.
template <typename Scalar>
struct RotationSvd {
  Matrix3<Scalar> u;
  Vector3<Scalar> values;
  Matrix3<Scalar> v;
};

namespace detail {

/// The second left singular vector from the first and the second column with its length.
template <typename Scalar>
[[nodiscard]] Vector3<Scalar> second_vector(const Vector3<Scalar>& first, const Vector3<Scalar>& column,
                                            const Scalar& length) noexcept {
  if (length > rounding::share<Scalar>(rounding::right_angle) * rounding::one_rounding<Scalar>()) {
    // A column this short may have passed the test for right angles at an angle.
    return (column - first.dot(column) * first).normalized();
  }
  // Rank one: any direction at right angles to the first will do, made from the axis least along it.
  int least = 0;
  first.cwiseAbs().minCoeff(&least);
  return first.cross(Vector3<Scalar>::Unit(least)).normalized();
}

}  // namespace detail

/// By one-sided Jacobi rotations (Hestenes). For a matrix of rank one the second vectors are arbitrary.
/// \return `not_finite`; `out_of_range` for the zero matrix; `not_converged`.
template <typename Scalar>
[[nodiscard]] ELLIPTUDE_SELDOM Status rotation_svd(const Matrix3<Scalar>& a, RotationSvd<Scalar>& svd) noexcept {
  if (!scalar::all_finite(a)) {
    return Status::not_finite;
  }
  const Scalar size = scalar::largest_size(a);
  if (!(size > Scalar(0))) {
    return Status::out_of_range;
  }
  Matrix3<Scalar> columns = a / size;
  Matrix3<Scalar> v = Matrix3<Scalar>::Identity();
  constexpr int most_sweeps = 30;
  bool converged = false;
  for (int sweep = 0; sweep < most_sweeps && !converged; ++sweep) {
    converged = true;
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        const Scalar pp = columns.col(p).squaredNorm();
        const Scalar qq = columns.col(q).squaredNorm();
        const Scalar pq = columns.col(p).dot(columns.col(q));
        // Columns at right angles up to the rounding of a product of three terms, or so short that their angle is
        // rounding.
        if (scalar::abs(pq) <= rounding::share<Scalar>(rounding::right_angle) * scalar::sqrt(Scalar(pp * qq)) ||
            scalar::abs(pq) <= rounding::square<Scalar>()) {
          continue;
        }
        converged = false;
        const auto rotation = detail::JacobiRotation<Scalar>::of(Scalar(qq - pp), pq);
        rotation.turn_columns(columns, p, q);
        rotation.turn_columns(v, p, q);
      }
    }
  }
  if (!converged) {
    return Status::not_converged;
  }
  Vector3<Scalar> lengths(columns.col(0).norm(), columns.col(1).norm(), columns.col(2).norm());
  for (int i = 0; i < 2; ++i) {
    for (int j = i + 1; j < 3; ++j) {
      if (lengths(j) > lengths(i)) {
        std::swap(lengths(i), lengths(j));
        columns.col(i).swap(columns.col(j));
        v.col(i).swap(v.col(j));
      }
    }
  }
  const Vector3<Scalar> u1 = columns.col(0) / lengths(0);
  const Vector3<Scalar> u2 = detail::second_vector(u1, Vector3<Scalar>(columns.col(1)), lengths(1));
  svd.u.col(0) = u1;
  svd.u.col(1) = u2;
  svd.u.col(2) = u1.cross(u2);
  svd.v = v;
  svd.v.col(2) = Vector3<Scalar>(v.col(0)).cross(Vector3<Scalar>(v.col(1)));
  // The third column of a V is s₃ u₃, whatever sign the swaps have left on it.
  const Vector3<Scalar> third = a * svd.v.col(2);
  svd.values << size * lengths(0), size * lengths(1), svd.u.col(2).dot(third);
  return Status::ok;
}

}  // namespace elliptude
