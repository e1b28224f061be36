#pragma once

/// \file
/// Eigenvalues and eigenvectors of small symmetric matrices.

#include <utility>

#include "elliptude/base/rounding.hpp"
#include "elliptude/base/status.hpp"
#include "elliptude/linear/detail/jacobi_rotation.hpp"
#include "elliptude/linear/norms.hpp"

namespace elliptude {

/// Eigenvalues, largest first, and the orthonormal eigenvectors of a symmetric matrix, as columns in the same order.
template <typename Scalar, int N>
struct SymmetricEigen {
  Vector<Scalar, N> values;
  Matrix<Scalar, N> vectors;
};

/// Jacobi's cyclic method: small eigenvalues of graded matrices come out with nearly full digits.
/// \return `not_finite`, or `not_converged` after a bounded number of sweeps (not seen; quadratic convergence takes 4
/// to 7).
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_SELDOM Status symmetric_eigen(const Matrix<Scalar, N>& symmetric,
                                                      SymmetricEigen<Scalar, N>& eigen) noexcept {
  if (!scalar::all_finite(symmetric)) {
    return Status::not_finite;
  }
  Matrix<Scalar, N> a = symmetrized(symmetric);
  Matrix<Scalar, N> vectors = Matrix<Scalar, N>::Identity();
  constexpr int most_sweeps = 30;
  bool converged = false;
  for (int sweep = 0; sweep < most_sweeps && !converged; ++sweep) {
    converged = true;
    for (int p = 0; p < N - 1; ++p) {
      for (int q = p + 1; q < N; ++q) {
        const Scalar off = a(p, q);
        const Scalar diagonal = scalar::sqrt(scalar::abs(a(p, p))) * scalar::sqrt(scalar::abs(a(q, q)));
        if (scalar::abs(off) <= rounding::one_rounding<Scalar>() * diagonal ||
            scalar::abs(off) <= Scalar(std::numeric_limits<scalar::Value<Scalar>>::min()) ||
            scalar::abs(off) <= rounding::square<Scalar>() * scalar::largest_size(a)) {
          continue;
        }
        converged = false;
        // The rotation that makes entry (p, q) zero.
        const auto rotation = detail::JacobiRotation<Scalar>::of(Scalar(a(q, q) - a(p, p)), off);
        for (int k = 0; k < N; ++k) {
          rotation.turn(a(k, p), a(k, q));
        }
        for (int k = 0; k < N; ++k) {
          rotation.turn(a(p, k), a(q, k));
          rotation.turn(vectors(k, p), vectors(k, q));
        }
        a(p, q) = Scalar(0);
        a(q, p) = Scalar(0);
      }
    }
  }
  if (!converged) {
    return Status::not_converged;
  }
  for (int i = 0; i < N - 1; ++i) {
    int largest = i;
    for (int j = i + 1; j < N; ++j) {
      if (a(j, j) > a(largest, largest)) {
        largest = j;
      }
    }
    std::swap(a(i, i), a(largest, largest));
    vectors.col(i).swap(vectors.col(largest));
  }
  eigen.values = a.diagonal();
  eigen.vectors = vectors;
  return Status::ok;
}

/// How far eigenvalues and eigenvectors are off, found from what they leave of the matrix, whatever found them: there
/// are orthonormal vectors Q, no farther from the eigenvectors V than `vectors` (as a norm), for which ‖A − QΛQᵀ‖ ≤
/// `values`. By Weyl's inequality no eigenvalue is off by more than that.
template <typename Scalar>
struct EigenErrors {
  Scalar values;
  Scalar vectors;
};

/// With R = AV − VΛ, d = ‖VᵀV − I‖ and Q the nearest orthonormal matrix to V, ‖V − Q‖ ≤ d and ‖A − QΛQᵀ‖ ≤ ‖R‖/√(1 − d):
/// what V lacks of being orthonormal adds to R an antisymmetric matrix alone. (theory, section 17.8)
/// \return infinite errors of values if d is one or more.
template <typename Scalar, int N>
[[nodiscard]] ELLIPTUDE_SELDOM EigenErrors<Scalar> eigen_errors(const Matrix<Scalar, N>& symmetric,
                                                                const SymmetricEigen<Scalar, N>& eigen) noexcept {
  const Matrix<Scalar, N>& v = eigen.vectors;
  const Matrix<Scalar, N> defect = gram_of(v) - Matrix<Scalar, N>::Identity();
  const Scalar vectors = defect.norm() + rounding::share<Scalar>(rounding::eigen_defect(N));
  if (!(vectors < Scalar(1))) {
    return {Scalar(std::numeric_limits<scalar::Value<Scalar>>::infinity()), vectors};
  }
  const Scalar largest = scalar::largest_size(symmetric);
  if (!(largest > Scalar(0))) {
    return {largest, vectors};
  }
  // In units of the largest entry, so that no square is lost.
  const Matrix<Scalar, N> residual = (symmetric.lazyProduct(v) - v * eigen.values.asDiagonal()) / largest;
  const Scalar norm = (symmetric / largest).norm();
  const Scalar relative = residual.norm() + rounding::share<Scalar>(rounding::eigen_residual(N)) * norm;
  return {largest * relative / scalar::sqrt(Scalar(1) - vectors), vectors};
}

}  // namespace elliptude
