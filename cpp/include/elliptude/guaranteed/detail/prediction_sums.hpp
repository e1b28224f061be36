#pragma once

/// \file
/// What a prediction adds to a set: sums of ellipsoids about zero, and by how much a set may become larger everywhere
/// for what is added to it. (theory, section 17.9)

#include <array>

#include "elliptude/base/rounding.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/linear/norms.hpp"

namespace elliptude {
namespace detail::tube {

/// A growth in a prediction that is always acceptable.
template <typename Scalar>
[[nodiscard]] Scalar always_moderate() noexcept {
  return scalar::constant<Scalar>(0.01L);
}

/// The share of least volume in a sum with the unit ball of six numbers. A sum holds with any positive one; if rounding
/// leaves none, it is one.
/// \param trace of what is added.
template <typename Scalar>
[[nodiscard]] Scalar share_of(const Scalar& trace) noexcept {
  return trace > Scalar(0) ? scalar::sqrt(Scalar(trace / Scalar(6))) : Scalar(1);
}

/// By how much a set is made larger everywhere for what is added to it: by the share that makes the sum smallest in
/// volume, unless that keeps a thin set thin by making it wider and wider, prediction after prediction. What is of
/// second order grows with the square of the width. A hundredth, or five times what is added against the whole set, is
/// moderate. (theory, section 17.9)
/// \param share the one of least volume.
/// \param added trace of what is added, in coordinates in which the set's widths are alike where it is not thin.
/// \param whole that of the set.
template <typename Scalar>
[[nodiscard]] Scalar moderate_growth(const Scalar& share, const Scalar& added, const Scalar& whole) noexcept {
  const Scalar always = always_moderate<Scalar>();
  if (!(share > always)) {
    return share;
  }
  const Scalar moderate = Scalar(5) * scalar::sqrt(Scalar(added / whole));
  const Scalar most = moderate > always ? moderate : always;
  return share < most ? share : most;
}

/// What is added to a set against the whole of it, squared: of attitude and vector by themselves, as their units
/// differ.
template <typename Scalar, int N, std::size_t Count>
[[nodiscard]] Scalar share_of_widest(const Matrix<Scalar, N>& shape,
                                     const std::array<Matrix<Scalar, N>, Count>& others) noexcept {
  Scalar widest(0);
  for (int from = 0; from < N; from += 3) {
    Scalar added(0);
    for (const Matrix<Scalar, N>& term : others) {
      added += term.diagonal().template segment<3>(from).sum();
    }
    const Scalar share = added / shape.diagonal().template segment<3>(from).sum();
    widest = share > widest ? share : widest;
  }
  return widest;
}

/// An ellipsoid that contains the sum of one with a positive definite shape and of others about zero, small in volume:
/// shares proportional to √tr(P⁻¹Pᵢ) about the sum P, by two steps of the iteration that finds the best
/// (`minimal_sum`), as far as that is a `moderate_growth`. Entries of the shapes may be wrong by a rounding or two of
/// themselves.
template <typename Scalar, int N, std::size_t Count>
[[nodiscard]] Status sum(const Matrix<Scalar, N>& shape, const std::array<Matrix<Scalar, N>, Count>& others,
                         Matrix<Scalar, N>& result) noexcept {
  Matrix<Scalar, N> total = shape;
  for (int step = 0; step < 2; ++step) {
    Matrix<Scalar, N> inverse;
    if (const Status status = inverse_positive_definite(total, inverse); status != Status::ok) {
      return status;
    }
    const auto size = [&inverse](const Matrix<Scalar, N>& term) {
      const Scalar square = inverse.cwiseProduct(term).sum();
      return scalar::sqrt(square > Scalar(0) ? square : Scalar(0));
    };
    const Scalar first = size(shape);
    std::array<Scalar, Count> sizes;
    Scalar all = first;
    for (std::size_t i = 0; i < Count; ++i) {
      sizes[i] = size(others[i]);
      all += sizes[i];
    }
    const Scalar growth = (all - first) / first;
    if (growth > always_moderate<Scalar>()) {
      const Scalar most = moderate_growth(growth, share_of_widest(shape, others), Scalar(1));
      all = first;
      for (Scalar& term : sizes) {
        term *= most / growth;
        all += term;
      }
    }
    total = (all / first) * shape;
    for (std::size_t i = 0; i < Count; ++i) {
      if (sizes[i] > Scalar(0)) {
        total += (all / sizes[i]) * others[i];
      } else if (!others[i].isZero(Scalar(0))) {
        return Status::not_positive_definite;  // a term must not be left out for its rounding
      }
    }
  }
  total.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::sum);
  result = total;
  return Status::ok;
}

/// The ball of a radius, in the attitude alone.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> attitude_ball(const Scalar& radius) noexcept {
  Matrix6<Scalar> ball = Matrix6<Scalar>::Zero();
  ball.diagonal().template head<3>().setConstant(radius * radius);
  return ball;
}

/// √ of the largest eigenvalue of a shape, or a little more: the ellipsoid lies in the ball of this radius.
template <typename Scalar>
[[nodiscard]] Scalar radius(const Matrix3<Scalar>& shape) noexcept {
  return scalar::sqrt(spectral_norm(shape));
}

}  // namespace detail::tube
}  // namespace elliptude
