#pragma once

/// \file
/// Wahba's problem (paper, §2.1): the attitude C that minimises ½ Σ wᵢ ‖eᵢ − C b̃ᵢ‖² for reference directions eᵢ and
/// the same directions b̃ᵢ measured in body axes. With the attitude profile L = Σ wᵢ eᵢ b̃ᵢᵀ it maximises tr(CᵀL).
///
/// Directions are the columns of 3 × m matrices and need not be of unit length: only their direction counts.

#include <cstdint>

#include "elliptude/attitude/detail/quick_foam.hpp"
#include "elliptude/base/limits.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/base/so3.hpp"
#include "elliptude/linear/eigen.hpp"
#include "elliptude/linear/svd.hpp"

namespace elliptude {

template <typename Scalar>
struct WahbaSolution {
  Matrix3<Scalar> attitude;
  Scalar cost;       ///< ½ Σ wᵢ ‖eᵢ − C b̃ᵢ‖² for unit directions
  Scalar condition;  ///< largest over smallest curvature of the cost at C: large if a rotation is almost free
};

/// Which algorithm solves it. All four find the same attitude where they apply.
enum class WahbaMethod : std::uint8_t {
  svd,        ///< Markley: L = UΣVᵀ, C = U diag(1, 1, det U det V) Vᵀ. The default.
  foam,       ///< Markley's fast optimal attitude matrix, six times faster; `svd` where the condition is large
  davenport,  ///< the unit quaternion as the top eigenvector of Davenport's matrix
  qr,         ///< the paper's Theorem 1, only for det L > 0
};

/// The condition beyond which directions count as collinear: a larger one leaves the answer no digits.
template <typename Scalar>
[[nodiscard]] Scalar wahba_condition_limit() noexcept {
  return Scalar(1) / rounding::share<Scalar>(rounding::condition);
}

/// What one direction adds to the attitude profile L = Σ wᵢ eᵢ b̃ᵢᵀ, of unit vectors.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> profile_term(const Scalar& weight, const Vector3<Scalar>& reference,
                                           const Vector3<Scalar>& body) noexcept {
  return (weight * reference) * body.transpose();
}

/// L = Σ wᵢ eᵢ b̃ᵢᵀ of directions made unit vectors.
/// \param weights m numbers, not negative.
/// \return `not_finite`; `out_of_range` if a weight is negative, all are zero, or the sizes differ; `zero_direction`;
/// `beyond_domain` if L overflows, or the weights' sum is below the least normal number: L would have no right digits.
template <typename Reference, typename Body, typename Weights>
[[nodiscard]] Status attitude_profile(const Eigen::MatrixBase<Reference>& reference,
                                      const Eigen::MatrixBase<Body>& body, const Eigen::MatrixBase<Weights>& weights,
                                      Matrix3<typename Reference::Scalar>& profile) noexcept {
  using Scalar = typename Reference::Scalar;
  if (reference.rows() != 3 || body.rows() != 3 || reference.cols() != body.cols() ||
      weights.size() != reference.cols()) {
    return Status::out_of_range;
  }
  Matrix3<Scalar> sum = Matrix3<Scalar>::Zero();
  Scalar total(0);
  for (Eigen::Index i = 0; i < reference.cols(); ++i) {
    const Vector3<Scalar> e = reference.col(i);
    const Vector3<Scalar> b = body.col(i);
    const Scalar weight = weights(i);
    if (!scalar::all_finite(e) || !scalar::all_finite(b) || !scalar::isfinite(weight)) {
      return Status::not_finite;
    }
    if (!(weight >= Scalar(0))) {
      return Status::out_of_range;
    }
    const Scalar length_e = scalar::length(e);
    const Scalar length_b = scalar::length(b);
    if (!(length_e > Scalar(0)) || !(length_b > Scalar(0))) {
      return Status::zero_direction;
    }
    sum += profile_term(weight, Vector3<Scalar>(e / length_e), Vector3<Scalar>(b / length_b));
    total += weight;
  }
  if (!(total > Scalar(0))) {
    return Status::out_of_range;
  }
  if (!scalar::all_finite(sum) || !(total >= Scalar(std::numeric_limits<scalar::Value<Scalar>>::min()))) {
    return Status::beyond_domain;
  }
  profile = sum;
  return Status::ok;
}

namespace detail {

/// Curvatures of the cost about the minimiser are the sums of two singular values, the last one signed.
template <typename Scalar>
[[nodiscard]] Status condition_of_curvatures(const Scalar& largest, const Scalar& smallest,
                                             Scalar& condition) noexcept {
  if (!(smallest * wahba_condition_limit<Scalar>() > largest)) {
    return Status::attitude_undetermined;
  }
  condition = largest / smallest;
  return Status::ok;
}

}  // namespace detail

/// \return `not_finite`; `attitude_undetermined`.
template <typename Scalar>
[[nodiscard]] Status attitude_by_svd(const Matrix3<Scalar>& profile, Matrix3<Scalar>& attitude,
                                     Scalar& condition) noexcept {
  RotationSvd<Scalar> svd;
  if (const Status status = rotation_svd(profile, svd); status != Status::ok) {
    return status == Status::out_of_range ? Status::attitude_undetermined : status;
  }
  if (const Status status = detail::condition_of_curvatures(Scalar(svd.values(0) + svd.values(1)),
                                                            Scalar(svd.values(1) + svd.values(2)), condition);
      status != Status::ok) {
    return status;
  }
  attitude.noalias() = svd.u * svd.v.transpose();
  return Status::ok;
}

/// Davenport's q-method: eᵀC(q)b = qᵀKq, so that the best unit quaternion is the top eigenvector of K = Σ wᵢKᵢ.
/// \return `not_finite`; `attitude_undetermined`.
template <typename Scalar>
[[nodiscard]] Status attitude_by_davenport(const Matrix3<Scalar>& profile, Matrix3<Scalar>& attitude,
                                           Scalar& condition) noexcept {
  Matrix<Scalar, 4> k;
  const Vector3<Scalar> z = vee(Matrix3<Scalar>(profile - profile.transpose()));  // Σ wᵢ b̃ᵢ × eᵢ
  k(0, 0) = profile.trace();
  k.template topRightCorner<1, 3>() = z.transpose();
  k.template bottomLeftCorner<3, 1>() = z;
  k.template bottomRightCorner<3, 3>() = profile + profile.transpose() - profile.trace() * Matrix3<Scalar>::Identity();
  SymmetricEigen<Scalar, 4> eigen;
  if (const Status status = symmetric_eigen(k, eigen); status != Status::ok) {
    return status;
  }
  // Twice the curvatures of the cost are the gaps below the top eigenvalue.
  if (const Status status = detail::condition_of_curvatures(Scalar(eigen.values(0) - eigen.values(3)),
                                                            Scalar(eigen.values(0) - eigen.values(1)), condition);
      status != Status::ok) {
    return status;
  }
  const Vector<Scalar, 4> q = eigen.vectors.col(0);
  attitude = to_rotation(Quaternion<Scalar>{q(0), q.template tail<3>()});
  return Status::ok;
}

namespace detail {

/// What `attitude_by_foam` finds without a decomposition.
template <typename Scalar>
struct FoamSolution {
  Matrix3<Scalar> attitude;
  Matrix3<Scalar> curvature;  ///< tr(A) I − ½(A + Aᵀ), A = CᵀL: the cost's second derivatives
};

/// The largest root of the quartic of which λ = σ₁ + σ₂ + s₃ is one, (λ² − ‖L‖²)² = 8λ det L + 4‖adj L‖², by Newton's
/// steps from above, where it is convex. (theory, eq. 8.5)
/// \return whether it has settled: where the root is double, the steps are short and slow.
template <typename Scalar>
[[nodiscard]] bool foam_root(const Scalar& square, const Scalar& determinant, const Scalar& adjugate_square,
                             Scalar& lambda) noexcept {
  // σ₁σ₂ + σ₂σ₃ + σ₃σ₁ ≤ √3 ‖adj L‖.
  lambda = scalar::sqrt(Scalar(square + scalar::constant<Scalar>(3.4641016151377546L) * scalar::sqrt(adjugate_square)));
  constexpr int most_steps = 8;
  for (int step = 0; step < most_steps; ++step) {
    const Scalar gap = lambda * lambda - square;
    const Scalar value = gap * gap - Scalar(8) * lambda * determinant - Scalar(4) * adjugate_square;
    const Scalar change = value / (Scalar(4) * lambda * gap - Scalar(8) * determinant);
    lambda -= change;
    // The error that is left is of the size of its square.
    if (scalar::abs(change) <= rounding::root<Scalar>() * lambda) {
      return true;
    }
  }
  return false;
}

/// C = [(κ + ‖L‖²) L + λ adj Lᵀ − L Lᵀ L]/ζ (theory, eq. 8.6), and one step of Newton's method on the cost. No branch
/// depends on a number.
/// \param sum κ + ‖L‖².
template <typename Scalar>
[[nodiscard]] FoamSolution<Scalar> foam_attitude(const Matrix3<Scalar>& profile, const Matrix3<Scalar>& cofactors,
                                                 const Scalar& sum, const Scalar& lambda, const Scalar& zeta) noexcept {
  FoamSolution<Scalar> solution;
  const Matrix3<Scalar> gram = profile.transpose().lazyProduct(profile);
  const Matrix3<Scalar> rough =
      renormalized<Scalar>((sum * profile + lambda * cofactors - profile.lazyProduct(gram)) / zeta);
  const Matrix3<Scalar> a = rough.transpose().lazyProduct(profile);
  solution.curvature = a.trace() * Matrix3<Scalar>::Identity() - symmetrized(a);
  const Vector3<Scalar> k0 = solution.curvature.col(0);
  const Vector3<Scalar> k1 = solution.curvature.col(1);
  const Vector3<Scalar> k2 = solution.curvature.col(2);
  const Vector3<Scalar> slope = vee(Matrix3<Scalar>(a - a.transpose()));
  const Vector3<Scalar> k12 = k1.cross(k2);
  const Vector3<Scalar> turn =
      Vector3<Scalar>(k12.dot(slope), k2.cross(k0).dot(slope), k0.cross(k1).dot(slope)) / k0.dot(k12);
  solution.attitude = renormalized<Scalar>(rough + rough.lazyProduct(hat(turn)));
  return solution;
}

/// ζ/λ³ below which `solve_by_foam` leaves too few digits: at most twice the reciprocal of the condition.
inline constexpr long double least_share_of_foam = 1e-3L;

/// Markley's FOAM, and one step of Newton's method on the cost, for a profile of size one.
/// \return whether the condition is below 2000, which leaves the method digits enough.
template <typename Scalar>
[[nodiscard]] bool solve_by_foam(const Matrix3<Scalar>& profile, FoamSolution<Scalar>& solution) noexcept {
  const Vector3<Scalar> l0 = profile.col(0);
  const Vector3<Scalar> l1 = profile.col(1);
  const Vector3<Scalar> l2 = profile.col(2);
  Matrix3<Scalar> cofactors;  // adj Lᵀ
  cofactors.col(0) = l1.cross(l2);
  cofactors.col(1) = l2.cross(l0);
  cofactors.col(2) = l0.cross(l1);
  const Scalar determinant = l0.dot(Vector3<Scalar>(cofactors.col(0)));
  const Scalar square = profile.squaredNorm();
  Scalar lambda;
  if (!foam_root(square, determinant, Scalar(cofactors.squaredNorm()), lambda)) {
    return false;
  }
  const Scalar kappa = scalar::constant<Scalar>(0.5L) * (lambda * lambda - square);
  const Scalar zeta = kappa * lambda - determinant;  // (σ₁ + σ₂)(σ₂ + s₃)(s₃ + σ₁)
  if (!(zeta > scalar::constant<Scalar>(least_share_of_foam) * lambda * lambda * lambda)) {
    return false;
  }
  solution = foam_attitude(profile, cofactors, Scalar(kappa + square), lambda, zeta);
  return true;
}

/// The largest over the smallest eigenvalue of a positive definite matrix in closed form, right to half of the digits.
template <typename Scalar>
[[nodiscard]] Scalar condition_in_closed_form(const Matrix3<Scalar>& matrix) noexcept {
  const Scalar mean = matrix.trace() / Scalar(3);
  const Matrix3<Scalar> rest = matrix - mean * Matrix3<Scalar>::Identity();
  const Scalar spread = scalar::sqrt(Scalar(rest.squaredNorm() / Scalar(6)));
  if (!(spread > rounding::share<Scalar>(rounding::singular) * mean)) {
    return Scalar(1);
  }
  // The eigenvalues are mean + 2 spread cos(φ + 2πk/3) with cos 3φ = det(rest/spread)/2.
  Scalar cosine = scalar::constant<Scalar>(0.5L) * Matrix3<Scalar>(rest / spread).determinant();
  cosine = cosine > Scalar(1) ? Scalar(1) : (cosine < Scalar(-1) ? Scalar(-1) : cosine);
  const Scalar phi = scalar::atan2(scalar::sqrt(Scalar(Scalar(1) - cosine * cosine)), cosine) / Scalar(3);
  const Scalar along = scalar::cos(phi);
  const Scalar across = scalar::sin(phi);
  const Scalar smallest = mean - spread * (along + scalar::constant<Scalar>(1.7320508075688773L) * across);
  return (mean + Scalar(2) * spread * along) / smallest;
}

}  // namespace detail

/// Markley's FOAM: C = [(κ + ‖L‖²) L + λ adj Lᵀ − L Lᵀ L]/ζ without a decomposition, and one step of Newton's method;
/// `svd` where the condition may be above a thousand. The condition is right to half of the digits. (theory, eq. 8.6)
/// \return `not_finite`; `attitude_undetermined`.
template <typename Scalar>
[[nodiscard]] Status attitude_by_foam(const Matrix3<Scalar>& profile, Matrix3<Scalar>& attitude,
                                      Scalar& condition) noexcept {
  detail::FoamSolution<Scalar> solution;
  if (!detail::solve_by_foam(profile, solution)) {
    return attitude_by_svd(profile, attitude, condition);
  }
  attitude = solution.attitude;
  condition = detail::condition_in_closed_form(solution.curvature);
  return Status::ok;
}

/// The paper's Theorem 1: L = QR with Q in SO(3), C = SL, S = Q √((RRᵀ)⁻¹) Qᵀ. It is the polar factor of L, and a
/// rotation only if det L > 0. Forming RRᵀ squares the condition of L.
/// \return `not_finite`; `improper_profile` if det L is not positive or L is singular to rounding.
template <typename Scalar>
[[nodiscard]] Status attitude_by_qr(const Matrix3<Scalar>& profile, Matrix3<Scalar>& attitude,
                                    Scalar& condition) noexcept {
  if (!scalar::all_finite(profile)) {
    return Status::not_finite;
  }
  // Gram and Schmidt, the third column by the cross product: Q is a rotation, and r₃₃ has the sign of det L.
  const Vector3<Scalar> l1 = profile.col(0);
  const Vector3<Scalar> l2 = profile.col(1);
  const Scalar r11 = l1.norm();
  if (!(r11 > Scalar(0))) {
    return Status::improper_profile;
  }
  const Vector3<Scalar> q1 = l1 / r11;
  Vector3<Scalar> rest = l2 - q1.dot(l2) * q1;
  rest -= q1.dot(rest) * q1;  // twice is enough
  const Scalar r22 = rest.norm();
  if (!(r22 > Scalar(0))) {
    return Status::improper_profile;
  }
  Matrix3<Scalar> q;
  q.col(0) = q1;
  q.col(1) = rest / r22;
  q.col(2) = q1.cross(Vector3<Scalar>(q.col(1)));
  Matrix3<Scalar> r = q.transpose() * profile;
  r(1, 0) = Scalar(0);
  r(2, 0) = Scalar(0);
  r(2, 1) = Scalar(0);
  if (!(r(2, 2) > Scalar(0))) {
    return Status::improper_profile;
  }
  SymmetricEigen<Scalar, 3> eigen;  // of RRᵀ: the squared singular values of L
  if (const Status status = symmetric_eigen(Matrix3<Scalar>(r * r.transpose()), eigen); status != Status::ok) {
    return status;
  }
  if (!(eigen.values(2) > rounding::share<Scalar>(rounding::singular) * eigen.values(0))) {
    return Status::improper_profile;
  }
  const Vector3<Scalar> singular = eigen.values.cwiseSqrt();
  const Matrix3<Scalar> s =
      q * eigen.vectors * singular.cwiseInverse().asDiagonal() * eigen.vectors.transpose() * q.transpose();
  if (const Status status = detail::condition_of_curvatures(Scalar(singular(0) + singular(1)),
                                                            Scalar(singular(1) + singular(2)), condition);
      status != Status::ok) {
    return status;
  }
  attitude = s * profile;  // which `profile` may be, too
  return Status::ok;
}

namespace detail {

/// The profile divided by its largest entry: squares of small ones would be lost.
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> of_size_one(const Matrix3<Scalar>& profile) noexcept {
  const Scalar size = scalar::largest_size(profile);
  return size > Scalar(0) ? Matrix3<Scalar>(profile / size) : profile;
}

}  // namespace detail

/// The attitude of a profile, of any size, by any of the methods.
template <typename Scalar>
[[nodiscard]] Status attitude_of_profile(const Matrix3<Scalar>& profile, WahbaMethod method, Matrix3<Scalar>& attitude,
                                         Scalar& condition) noexcept {
  switch (method) {
    case WahbaMethod::svd:
      return attitude_by_svd(profile, attitude, condition);
    case WahbaMethod::foam:
      return attitude_by_foam(detail::of_size_one(profile), attitude, condition);
    case WahbaMethod::davenport:
      return attitude_by_davenport(detail::of_size_one(profile), attitude, condition);
    case WahbaMethod::qr:
      return attitude_by_qr(detail::of_size_one(profile), attitude, condition);
  }
  return Status::out_of_range;
}

/// The same by FOAM, and by singular values where that is not sure, without the condition, which may cost as much as
/// the attitude. No other method is linked for it.
template <typename Scalar>
[[nodiscard]] Status foam_attitude_of_profile(const Matrix3<Scalar>& profile, Matrix3<Scalar>& attitude) noexcept {
  detail::FoamSolution<Scalar> solution;
  if (detail::solve_by_foam(detail::of_size_one(profile), solution)) {
    attitude = solution.attitude;
    return Status::ok;
  }
  if (only_foam) {
    return scalar::all_finite(profile) ? Status::attitude_undetermined : Status::not_finite;
  }
  Scalar condition;
  return attitude_by_svd(profile, attitude, condition);
}

/// The same by any method.
template <typename Scalar>
[[nodiscard]] Status attitude_of_profile(const Matrix3<Scalar>& profile, WahbaMethod method,
                                         Matrix3<Scalar>& attitude) noexcept {
  if (method == WahbaMethod::foam) {
    return foam_attitude_of_profile(profile, attitude);
  }
  Scalar condition;
  return attitude_of_profile(profile, method, attitude, condition);
}

namespace detail {

/// Columns of Eigen's as directions for `quick_foam`.
template <typename Reference, typename Body, typename Weights>
struct DirectionColumns {
  using Scalar = typename Reference::Scalar;

  const Reference& references;
  const Body& bodies;
  const Weights& weights;

  [[nodiscard]] Triple<Scalar> reference(Eigen::Index i) const noexcept {
    return {references(0, i), references(1, i), references(2, i)};
  }
  [[nodiscard]] Triple<Scalar> body(Eigen::Index i) const noexcept {
    return {bodies(0, i), bodies(1, i), bodies(2, i)};
  }
  [[nodiscard]] Scalar weight(Eigen::Index i) const noexcept { return weights(i); }
};

}  // namespace detail

/// Solves Wahba's problem. Two directions that are not collinear are enough for `svd` and `davenport`.
/// \param reference 3 × m, directions in reference axes.
/// \param body 3 × m, the same directions as measured in body axes.
/// \param weights m numbers, not negative, not all zero.
/// \return the status of `attitude_profile` or of the method; `attitude_undetermined` for collinear directions.
template <typename Reference, typename Body, typename Weights>
[[nodiscard]] Status solve_wahba(const Eigen::MatrixBase<Reference>& reference, const Eigen::MatrixBase<Body>& body,
                                 const Eigen::MatrixBase<Weights>& weights, WahbaMethod method,
                                 WahbaSolution<typename Reference::Scalar>& solution) noexcept {
  using Scalar = typename Reference::Scalar;
  if (method == WahbaMethod::foam && reference.rows() == 3 && body.rows() == 3 && reference.cols() == body.cols() &&
      weights.size() == reference.cols()) {
    const detail::DirectionColumns<Reference, Body, Weights> columns{reference.derived(), body.derived(),
                                                                     weights.derived()};
    if (detail::quick_foam<Scalar>(columns, reference.cols(), solution)) {
      return Status::ok;
    }
  }
  Matrix3<Scalar> profile;
  if (const Status status = attitude_profile(reference, body, weights, profile); status != Status::ok) {
    return status;
  }
  WahbaSolution<Scalar> result;
  if (const Status status = attitude_of_profile(profile, method, result.attitude, result.condition);
      status != Status::ok) {
    return status;
  }
  result.cost = Scalar(0);
  for (Eigen::Index i = 0; i < reference.cols(); ++i) {
    const Vector3<Scalar> e = scalar::unit(Vector3<Scalar>(reference.col(i)));
    const Vector3<Scalar> b = scalar::unit(Vector3<Scalar>(body.col(i)));
    result.cost += scalar::constant<Scalar>(0.5L) * weights(i) * (e - result.attitude * b).squaredNorm();
  }
  solution = result;
  return Status::ok;
}

/// Two measurements and, as the paper suggests for m = 2, their cross product as a third.
template <typename Scalar>
struct ThreeDirections {
  Matrix3<Scalar> reference;
  Matrix3<Scalar> body;
};

/// Adds e₁ × e₂ and b̃₁ × b̃₂, made unit vectors, to two directions. With it `qr` can be used; the third error is not
/// independent of the others and no bound of it is given, so bounds must not be built on it.
/// \return `not_finite`; `zero_direction`; `attitude_undetermined` if either pair is collinear.
template <typename Scalar>
[[nodiscard]] Status add_cross_product(const Matrix<Scalar, 3, 2>& reference, const Matrix<Scalar, 3, 2>& body,
                                       ThreeDirections<Scalar>& three) noexcept {
  if (!scalar::all_finite(reference) || !scalar::all_finite(body)) {
    return Status::not_finite;
  }
  const auto complete = [](const Matrix<Scalar, 3, 2>& two, Matrix3<Scalar>& all) {
    for (int i = 0; i < 2; ++i) {
      const Vector3<Scalar> direction = two.col(i);
      const Scalar length = scalar::length(direction);
      if (!(length > Scalar(0))) {
        return Status::zero_direction;
      }
      all.col(i) = direction / length;
    }
    const Vector3<Scalar> normal = Vector3<Scalar>(all.col(0)).cross(Vector3<Scalar>(all.col(1)));
    const Scalar sine = normal.norm();
    if (!(sine > rounding::share<Scalar>(rounding::singular))) {
      return Status::attitude_undetermined;
    }
    all.col(2) = normal / sine;
    return Status::ok;
  };
  ThreeDirections<Scalar> result;
  if (const Status status = complete(reference, result.reference); status != Status::ok) {
    return status;
  }
  if (const Status status = complete(body, result.body); status != Status::ok) {
    return status;
  }
  three = result;
  return Status::ok;
}

}  // namespace elliptude
