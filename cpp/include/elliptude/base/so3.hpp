#pragma once

/// \file
/// Rotations. An attitude is a matrix C in SO(3) that takes body vectors to the reference frame (paper, §2); a rotation
/// vector ζ is in radians, in body axes, and perturbs on the body side: C = Ĉ exp(S(ζ)).
///
/// Every function of the angle θ is written in x = θ², as a power series below one radian and in half-angle form above,
/// where nothing cancels. One threshold then serves every scalar type, no function loses digits anywhere, and
/// derivatives taken through them (by a dual scalar) are as good as the values.

#include "elliptude/base/unrolling.hpp"

// Eigen reads what that header sets.
#include <Eigen/LU>
#include <cstdint>

#include "elliptude/base/rounding.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude {

namespace detail::angle {

// The remainders of the series at x = 1 are below 1e-19 of the sum.

/// sin θ / θ at x = θ² < 1.
template <typename Scalar>
[[nodiscard]] Scalar sine_series(const Scalar& x) noexcept {
  using Value = scalar::Value<Scalar>;
  constexpr std::array<Value, 10> coefficients{Value(1.0L),
                                               -Value(1.0L / 6),
                                               Value(1.0L / 120),
                                               -Value(1.0L / 5040),
                                               Value(1.0L / 362880),
                                               -Value(1.0L / 39916800.0L),
                                               Value(1.0L / 6227020800.0L),
                                               -Value(1.0L / 1307674368000.0L),
                                               Value(1.0L / 355687428096000.0L),
                                               -Value(1.0L / 121645100408832000.0L)};
  return scalar::polynomial(x, coefficients);
}

/// (1 − cos θ) / θ² at x = θ² < 1.
template <typename Scalar>
[[nodiscard]] Scalar versine_series(const Scalar& x) noexcept {
  using Value = scalar::Value<Scalar>;
  constexpr std::array<Value, 10> coefficients{Value(1.0L / 2),
                                               -Value(1.0L / 24),
                                               Value(1.0L / 720),
                                               -Value(1.0L / 40320),
                                               Value(1.0L / 3628800.0L),
                                               -Value(1.0L / 479001600.0L),
                                               Value(1.0L / 87178291200.0L),
                                               -Value(1.0L / 20922789888000.0L),
                                               Value(1.0L / 6402373705728000.0L),
                                               -Value(1.0L / 2432902008176640000.0L)};
  return scalar::polynomial(x, coefficients);
}

/// (θ − sin θ) / θ³ at x = θ² < 1.
template <typename Scalar>
[[nodiscard]] Scalar sine_tail_series(const Scalar& x) noexcept {
  using Value = scalar::Value<Scalar>;
  constexpr std::array<Value, 10> coefficients{Value(1.0L / 6),
                                               -Value(1.0L / 120),
                                               Value(1.0L / 5040),
                                               -Value(1.0L / 362880),
                                               Value(1.0L / 39916800.0L),
                                               -Value(1.0L / 6227020800.0L),
                                               Value(1.0L / 1307674368000.0L),
                                               -Value(1.0L / 355687428096000.0L),
                                               Value(1.0L / 121645100408832000.0L),
                                               -Value(1.0L / 51090942171709440000.0L)};
  return scalar::polynomial(x, coefficients);
}

/// (1 − (θ/2) cot(θ/2)) / θ² = Σ |B₂ₖ| θ²ᵏ⁻² / (2k)! at x = θ² < 1; successive terms fall by (2π)².
template <typename Scalar>
[[nodiscard]] Scalar cotangent_series(const Scalar& x) noexcept {
  using Value = scalar::Value<Scalar>;
  constexpr std::array<Value, 12> coefficients{Value(1.0L / 12),
                                               Value(1.0L / 720),
                                               Value(1.0L / 30240),
                                               Value(1.0L / 1209600),
                                               Value(1.0L / 47900160),
                                               Value(691.0L / 1307674368000.0L),
                                               Value(1.0L / 74724249600.0L),
                                               Value(3617.0L / 10670622842880000.0L),
                                               Value(43867.0L / 5109094217170944000.0L),
                                               Value(174611.0L / 802857662698291200000.0L),
                                               Value(77683.0L / 14101100039391805440000.0L),
                                               Value(236364091.0L / 1693824136731743669452800000.0L)};
  return scalar::polynomial(x, coefficients);
}

/// The functions of the angle that exp and its Jacobians are made of, at x = θ².
template <typename Scalar>
struct Functions {
  Scalar sine;       ///< sin θ / θ
  Scalar versine;    ///< (1 − cos θ) / θ²
  Scalar sine_tail;  ///< (θ − sin θ) / θ³
  Scalar cotangent;  ///< (1 − (θ/2) cot(θ/2)) / θ², finite below a full turn
};

/// Which of them to calculate: a caller pays only for what it needs.
enum class Want : std::uint8_t { exponential, jacobian, inverse_jacobian };

template <Want want, typename Scalar>
[[nodiscard]] Functions<Scalar> functions(const Scalar& x) noexcept {
  Functions<Scalar> result{};
  const auto small = x < Scalar(1);
  if constexpr (want == Want::inverse_jacobian) {
    result.cotangent = cotangent_series(x);
  } else {
    result.versine = versine_series(x);
    if constexpr (want == Want::exponential) {
      result.sine = sine_series(x);
    } else {
      result.sine_tail = sine_tail_series(x);
    }
  }
  if (scalar::all(small)) {
    return result;
  }
  const Scalar square = scalar::select(small, Scalar(1), x);
  const Scalar angle = scalar::sqrt(square);
  const Scalar half_sine = scalar::sin(Scalar(angle / Scalar(2)));
  const Scalar half_cosine = scalar::cos(Scalar(angle / Scalar(2)));
  if constexpr (want == Want::inverse_jacobian) {
    const Scalar closed = (Scalar(1) - angle * half_cosine / (Scalar(2) * half_sine)) / square;
    result.cotangent = scalar::select(small, result.cotangent, closed);
  } else {
    const Scalar sine = Scalar(2) * half_sine * half_cosine / angle;
    result.versine = scalar::select(small, result.versine, Scalar(Scalar(2) * half_sine * half_sine / square));
    if constexpr (want == Want::exponential) {
      result.sine = scalar::select(small, result.sine, sine);
    } else {
      result.sine_tail = scalar::select(small, result.sine_tail, Scalar((Scalar(1) - sine) / square));
    }
  }
  return result;
}

/// atan(y) / y at x = y² < 1e-3, remainder below 1e-21.
template <typename Scalar>
[[nodiscard]] Scalar arctangent_series(const Scalar& x) noexcept {
  using Value = scalar::Value<Scalar>;
  constexpr std::array<Value, 7> coefficients{Value(1.0L),     -Value(1.0L / 3),  Value(1.0L / 5), -Value(1.0L / 7),
                                              Value(1.0L / 9), -Value(1.0L / 11), Value(1.0L / 13)};
  return scalar::polynomial(x, coefficients);
}

}  // namespace detail::angle

/// S(x), the skew-symmetric matrix with S(x) y = x × y (paper, §2.3.1).
template <typename Derived>
[[nodiscard]] Matrix3<typename Derived::Scalar> hat(const Eigen::MatrixBase<Derived>& x) noexcept {
  EIGEN_STATIC_ASSERT_VECTOR_SPECIFIC_SIZE(Derived, 3)
  using Scalar = typename Derived::Scalar;
  const Vector3<Scalar> v = x;
  Matrix3<Scalar> result;
  result.col(0) = Vector3<Scalar>(Scalar(0), v.z(), -v.y());
  result.col(1) = Vector3<Scalar>(-v.z(), Scalar(0), v.x());
  result.col(2) = Vector3<Scalar>(v.y(), -v.x(), Scalar(0));
  return result;
}

/// S(x) S(y) = y xᵀ − (xᵀy) I.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> hat_product(const Vector3<Scalar>& x, const Vector3<Scalar>& y) noexcept {
  Matrix3<Scalar> result = y * x.transpose();
  result.diagonal().array() -= x.dot(y);
  return result;
}

/// The inverse of `hat`; for a general matrix, that of its skew-symmetric part.
template <typename Derived>
[[nodiscard]] Vector3<typename Derived::Scalar> vee(const Eigen::MatrixBase<Derived>& matrix) noexcept {
  EIGEN_STATIC_ASSERT_MATRIX_SPECIFIC_SIZE(Derived, 3, 3)
  using Scalar = typename Derived::Scalar;
  const Matrix3<Scalar> m = matrix;
  const Scalar half = scalar::constant<Scalar>(0.5L);
  return Vector3<Scalar>(half * (m(2, 1) - m(1, 2)), half * (m(0, 2) - m(2, 0)), half * (m(1, 0) - m(0, 1)));
}

/// I + a S(v) + b S(v)², which every function of a rotation vector is.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> skew_polynomial(const Vector3<Scalar>& v, const Scalar& a, const Scalar& b) noexcept {
  const Vector3<Scalar> bv = b * v;
  const Vector3<Scalar> av = a * v;
  const Scalar xy = bv.x() * v.y();
  const Scalar xz = bv.x() * v.z();
  const Scalar yz = bv.y() * v.z();
  const Scalar xx = bv.x() * v.x();
  const Scalar yy = bv.y() * v.y();
  const Scalar zz = bv.z() * v.z();
  Matrix3<Scalar> result;
  result << Scalar(1) - (yy + zz), xy - av.z(), xz + av.y(),  //
      xy + av.z(), Scalar(1) - (xx + zz), yz - av.x(),        //
      xz - av.y(), yz + av.x(), Scalar(1) - (xx + yy);
  return result;
}

/// exp(S(ζ)), Rodrigues' formula, for a rotation vector of any length.
template <typename Derived>
[[nodiscard]] Matrix3<typename Derived::Scalar> exp(const Eigen::MatrixBase<Derived>& zeta) noexcept {
  EIGEN_STATIC_ASSERT_VECTOR_SPECIFIC_SIZE(Derived, 3)
  using Scalar = typename Derived::Scalar;
  const Vector3<Scalar> z = zeta;
  const auto f = detail::angle::functions<detail::angle::Want::exponential>(Scalar(z.squaredNorm()));
  return skew_polynomial(z, f.sine, f.versine);
}

/// The right Jacobian: exp(S(ζ + δ)) = exp(S(ζ)) exp(S(J_r(ζ) δ)) to first order in δ;
/// J_r = I − (1−cos θ)/θ² S(ζ) + (θ−sin θ)/θ³ S(ζ)².
template <typename Derived>
[[nodiscard]] Matrix3<typename Derived::Scalar> right_jacobian(const Eigen::MatrixBase<Derived>& zeta) noexcept {
  EIGEN_STATIC_ASSERT_VECTOR_SPECIFIC_SIZE(Derived, 3)
  using Scalar = typename Derived::Scalar;
  const Vector3<Scalar> z = zeta;
  const auto f = detail::angle::functions<detail::angle::Want::jacobian>(Scalar(z.squaredNorm()));
  return skew_polynomial(z, Scalar(-f.versine), f.sine_tail);
}

/// J_r(ζ)⁻¹ = I + ½ S(ζ) + (1 − (θ/2) cot(θ/2))/θ² S(ζ)²: log(exp(S(ζ)) exp(S(δ))) = ζ + J_r⁻¹(ζ) δ to first order.
/// Regular below a full turn, ‖ζ‖ < 2π; at a full turn it does not exist and entries are not finite or very large.
template <typename Derived>
[[nodiscard]] Matrix3<typename Derived::Scalar> right_jacobian_inverse(
    const Eigen::MatrixBase<Derived>& zeta) noexcept {
  EIGEN_STATIC_ASSERT_VECTOR_SPECIFIC_SIZE(Derived, 3)
  using Scalar = typename Derived::Scalar;
  const Vector3<Scalar> z = zeta;
  const auto f = detail::angle::functions<detail::angle::Want::inverse_jacobian>(Scalar(z.squaredNorm()));
  return skew_polynomial(z, scalar::constant<Scalar>(0.5L), f.cotangent);
}

/// The left Jacobian J_l(ζ) = J_r(−ζ): exp(S(ζ + δ)) = exp(S(J_l(ζ) δ)) exp(S(ζ)) to first order.
template <typename Derived>
[[nodiscard]] Matrix3<typename Derived::Scalar> left_jacobian(const Eigen::MatrixBase<Derived>& zeta) noexcept {
  return right_jacobian(-zeta);
}

/// J_l(ζ)⁻¹ = J_r(−ζ)⁻¹.
template <typename Derived>
[[nodiscard]] Matrix3<typename Derived::Scalar> left_jacobian_inverse(const Eigen::MatrixBase<Derived>& zeta) noexcept {
  return right_jacobian_inverse(-zeta);
}

/// The Cayley map, c = tan(θ/2) n: I + 2/(1+cᵀc) (S(c) + S(c)²). It reaches every rotation but the half turns.
template <typename Derived>
[[nodiscard]] Matrix3<typename Derived::Scalar> cayley(const Eigen::MatrixBase<Derived>& gibbs) noexcept {
  EIGEN_STATIC_ASSERT_VECTOR_SPECIFIC_SIZE(Derived, 3)
  using Scalar = typename Derived::Scalar;
  const Vector3<Scalar> c = gibbs;
  const Scalar factor = Scalar(2) / (Scalar(1) + c.squaredNorm());
  return skew_polynomial(c, factor, factor);
}

/// A unit quaternion, scalar first: (qw, qx, qy, qz) = (cos(θ/2), sin(θ/2) n), of the rotation that the matrix is.
template <typename Scalar>
struct Quaternion {
  Scalar w;
  Vector3<Scalar> vector;
};

/// The quaternion with qw >= 0 of a rotation. Each of the four candidates (a column of 4qqᵀ) holds the quaternion times
/// one of its components; the largest is taken, so that no digits are lost at any angle.
template <typename Derived>
[[nodiscard]] Quaternion<typename Derived::Scalar> to_quaternion(const Eigen::MatrixBase<Derived>& rotation) noexcept {
  EIGEN_STATIC_ASSERT_MATRIX_SPECIFIC_SIZE(Derived, 3, 3)
  using Scalar = typename Derived::Scalar;
  const Matrix3<Scalar> c = rotation;
  const Vector3<Scalar> skew(c(2, 1) - c(1, 2), c(0, 2) - c(2, 0), c(1, 0) - c(0, 1));
  const Scalar xy = c(0, 1) + c(1, 0);
  const Scalar xz = c(0, 2) + c(2, 0);
  const Scalar yz = c(1, 2) + c(2, 1);
  const Scalar trace = c(0, 0) + c(1, 1) + c(2, 2);
  Vector<Scalar, 4> best(Scalar(1) + trace, skew.x(), skew.y(), skew.z());
  Scalar largest = best(0);
  const std::array<Vector<Scalar, 4>, 3> others{
      Vector<Scalar, 4>(skew.x(), Scalar(1) + c(0, 0) - c(1, 1) - c(2, 2), xy, xz),
      Vector<Scalar, 4>(skew.y(), xy, Scalar(1) - c(0, 0) + c(1, 1) - c(2, 2), yz),
      Vector<Scalar, 4>(skew.z(), xz, yz, Scalar(1) - c(0, 0) - c(1, 1) + c(2, 2))};
  for (int k = 0; k < 3; ++k) {
    const Vector<Scalar, 4>& other = others[static_cast<std::size_t>(k)];
    const auto better = other(k + 1) > largest;
    for (int i = 0; i < 4; ++i) {
      best(i) = scalar::select(better, other(i), best(i));
    }
    largest = scalar::select(better, other(k + 1), largest);
  }
  const Scalar norm = scalar::sqrt(Scalar(best.squaredNorm()));
  const Scalar factor = scalar::select(best(0) < Scalar(0), Scalar(-1), Scalar(1)) / norm;
  return {Scalar(best(0) * factor), Vector3<Scalar>(best.template tail<3>() * factor)};
}

/// The rotation of a quaternion, which need not be of unit length but must not be zero.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> to_rotation(const Quaternion<Scalar>& q) noexcept {
  const Scalar factor = Scalar(2) / (q.w * q.w + q.vector.squaredNorm());
  const Vector3<Scalar> v = q.vector;
  return skew_polynomial(v, Scalar(factor * q.w), factor);
}

/// The rotation vector ζ of a rotation, ‖ζ‖ <= π. At a half turn both signs are right, and one is returned.
template <typename Derived>
[[nodiscard]] Vector3<typename Derived::Scalar> log(const Eigen::MatrixBase<Derived>& rotation) noexcept {
  EIGEN_STATIC_ASSERT_MATRIX_SPECIFIC_SIZE(Derived, 3, 3)
  using Scalar = typename Derived::Scalar;
  const Quaternion<Scalar> q = to_quaternion(rotation);
  const Scalar square = q.vector.squaredNorm();
  const auto small = square < scalar::constant<Scalar>(1e-3L) * q.w * q.w;
  const Scalar w = scalar::select(small, q.w, Scalar(1));
  Scalar half_angle_over_sine = detail::angle::arctangent_series(Scalar(square / (w * w))) / w;
  if (!scalar::all(small)) {
    const Scalar sine = scalar::sqrt(scalar::select(small, Scalar(1), square));
    half_angle_over_sine = scalar::select(small, half_angle_over_sine, Scalar(scalar::atan2(sine, q.w) / sine));
  }
  return (Scalar(2) * half_angle_over_sine) * q.vector;
}

/// The Gibbs vector c = tan(θ/2) n of a rotation, the inverse of `cayley`; infinite at a half turn.
template <typename Derived>
[[nodiscard]] Vector3<typename Derived::Scalar> cayley_inverse(const Eigen::MatrixBase<Derived>& rotation) noexcept {
  const auto q = to_quaternion(rotation);
  return q.vector / q.w;
}

/// Whether a matrix is a rotation: entries of CᵀC − I at most `tolerance` in size, and det C > 0.
template <typename Derived>
[[nodiscard]] bool is_rotation(const Eigen::MatrixBase<Derived>& matrix,
                               const typename Derived::Scalar& tolerance) noexcept {
  EIGEN_STATIC_ASSERT_MATRIX_SPECIFIC_SIZE(Derived, 3, 3)
  using Scalar = typename Derived::Scalar;
  const Matrix3<Scalar> c = matrix;
  const Matrix3<Scalar> defect = c.transpose() * c - Matrix3<Scalar>::Identity();
  for (int i = 0; i < 9; ++i) {
    if (!scalar::all(scalar::abs(defect(i)) <= tolerance)) {
      return false;
    }
  }
  return scalar::all(c.determinant() > Scalar(0));
}

/// The tolerance of `is_rotation` for input from outside, whose entries may have been stored with half the digits: √ε.
template <typename Scalar>
[[nodiscard]] Scalar rotation_tolerance() noexcept {
  return rounding::root<Scalar>();
}

/// One Newton step of the polar decomposition without an inverse, X (3I − XᵀX)/2: brings a rotation that rounding has
/// worn off back to rounding, with quadratic convergence.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> renormalized(const Matrix3<Scalar>& rotation) noexcept {
  const Matrix3<Scalar> gram = rotation.transpose() * rotation;
  return rotation *
         (scalar::constant<Scalar>(1.5L) * Matrix3<Scalar>::Identity() - scalar::constant<Scalar>(0.5L) * gram);
}

/// The rotation nearest to a matrix in the Frobenius norm, its orthogonal polar factor, by Newton's iteration
/// X ← (X + X⁻ᵀ)/2.
/// \return `not_finite`; `not_a_rotation` if the determinant is not positive or the matrix is so flat that the nearest
/// rotation is not determined.
template <typename Scalar>
[[nodiscard]] Status project_to_rotation(const Matrix3<Scalar>& matrix, Matrix3<Scalar>& rotation) noexcept {
  if (!scalar::all_finite(matrix)) {
    return Status::not_finite;
  }
  Matrix3<Scalar> x = matrix;
  if (!scalar::is_precise_square(Scalar(matrix.squaredNorm()))) {
    const Scalar largest = scalar::largest_size(matrix);
    if (!(largest > Scalar(0))) {
      return Status::not_a_rotation;
    }
    x /= largest;
  }
  x /= scalar::sqrt(Scalar(x.squaredNorm()));
  const Scalar tolerance = rounding::root<Scalar>();  // the step after it would be its square
  constexpr int most_steps = 60;
  for (int step = 0; step < most_steps; ++step) {
    const Scalar determinant = x.determinant();
    if (!(determinant > rounding::share<Scalar>(rounding::singular))) {
      return Status::not_a_rotation;
    }
    const Matrix3<Scalar> next = scalar::constant<Scalar>(0.5L) * (x + x.inverse().transpose());
    const Scalar change = scalar::sqrt(Scalar((next - x).squaredNorm()));
    x = next;
    if (change <= tolerance) {
      rotation = x;
      return Status::ok;
    }
  }
  return Status::not_converged;
}

}  // namespace elliptude
