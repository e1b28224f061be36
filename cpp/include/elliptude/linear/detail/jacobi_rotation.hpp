#pragma once

/// \file
/// The rotation of Jacobi's methods for eigenvalues and singular values.

#include "elliptude/base/scalar.hpp"

namespace elliptude::detail {

/// A rotation of two coordinates by at most 45 degrees.
template <typename Scalar>
struct JacobiRotation {
  Scalar cosine;
  Scalar sine;

  /// The one that makes [a b; b d] diagonal.
  /// \param difference d - a, \param off b, not zero.
  [[nodiscard]] static JacobiRotation of(const Scalar& difference, const Scalar& off) noexcept {
    const Scalar cotangent = difference / (Scalar(2) * off);
    const Scalar root = scalar::sqrt(Scalar(Scalar(1) + cotangent * cotangent));
    const Scalar tangent =
        cotangent >= Scalar(0) ? Scalar(Scalar(1) / (cotangent + root)) : Scalar(Scalar(-1) / (root - cotangent));
    const Scalar cosine = Scalar(1) / scalar::sqrt(Scalar(Scalar(1) + tangent * tangent));
    return {cosine, tangent * cosine};
  }

  void turn(Scalar& first, Scalar& second) const noexcept {
    const Scalar before = first;
    first = cosine * before - sine * second;
    second = sine * before + cosine * second;
  }

  void turn_columns(Matrix3<Scalar>& matrix, int p, int q) const noexcept {
    const Vector3<Scalar> before = matrix.col(p);
    matrix.col(p) = cosine * before - sine * matrix.col(q);
    matrix.col(q) = sine * before + cosine * matrix.col(q);
  }
};

}  // namespace elliptude::detail
