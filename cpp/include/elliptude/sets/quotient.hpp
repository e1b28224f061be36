#pragma once

/// \file
/// How large a quotient of two quadratic forms may be on a set: the answer to one question about it, as sharp as its constraints
/// allow, where an ellipsoid about the set has to answer all questions at once. (theory, section 16.11)

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/detail/quadric_coordinates.hpp"
#include "elliptude/sets/detail/quotient_search.hpp"

namespace elliptude {

/// A bound of zᵀFz/zᵀGz over all z = [1; y] with y in an ellipsoid and in `count` quadrics: the least s for which multipliers μ ≥ 0
/// with sG − F − ΣμₖMₖ ⪰ 0 were found, where zᵀMₖz is the slack of constraint k. Every such s is a bound, because no slack is
/// negative in the set; the least of all is the best that the S-procedure gives, exact for the ellipsoid alone. The search ends
/// within about 1 % of it, or of what the ellipsoid alone gives divided by twenty. Rounding is on the safe side.
/// \param f, g symmetric, with G ⪰ 0.
/// \param quadrics at most `most_questioned` of them count.
/// \param largest the bound s, which may be negative.
/// \return the status of `validate` for the ellipsoid; `not_finite`; `unbounded` if no s was found.
template <typename Scalar, int N>
[[nodiscard]] Status largest_quotient(const Ellipsoid<Scalar, N>& ellipsoid, const Quadric<Scalar, N>* quadrics,
                                      std::size_t count, const Matrix<Scalar, N + 1>& f, const Matrix<Scalar, N + 1>& g,
                                      Scalar& largest) noexcept {
  detail::Coordinates<Scalar, N> at;
  if (const Status status = detail::coordinates_of(ellipsoid, at); status != Status::ok) {
    return status;
  }
  Matrix<Scalar, N + 1> t = Matrix<Scalar, N + 1>::Zero();
  t(0, 0) = Scalar(1);
  t.template block<N, 1>(1, 0) = at.shift;
  t.template block<N, N>(1, 1) = at.factor;
  const auto seen = [&t](const Matrix<Scalar, N + 1>& form) {
    return symmetrized(congruence(Matrix<Scalar, N + 1>(t.transpose()), form));
  };
  const auto magnitude = [&t](const Matrix<Scalar, N + 1>& form) {
    const Matrix<Scalar, N + 1> absolute = t.cwiseAbs();
    return Scalar(
        congruence(Matrix<Scalar, N + 1>(absolute.transpose()), Matrix<Scalar, N + 1>(form.cwiseAbs())).maxCoeff());
  };
  detail::QuotientSearch<Scalar, N> search;
  search.begin(seen(f), magnitude(f), seen(g), magnitude(g));
  const std::size_t used = count < most_questioned ? count : most_questioned;
  const Scalar rounding = rounding::share<Scalar>(rounding::relaxation(N, static_cast<int>(used)));
  for (std::size_t k = 0; k < used; ++k) {
    search.add(detail::relaxed(quadrics[k], at.factor, at.shift, at.reach, true, rounding));
  }
  return search.run(largest);
}

/// Between what a number may be.
template <typename Scalar>
struct Interval {
  Scalar least;
  Scalar most;
};

/// Where dᵀy may be for all y in an ellipsoid and in `count` quadrics: two questions, each with multipliers of its own, about the
/// ellipsoid's center, so that nothing is lost where that is far from zero. For convex quadrics they are exact but for where the
/// search ends. (theory, section 16.12)
/// \param direction d, of any length.
/// \return the status of `largest_quotient`; `empty_intersection` if the bounds prove that nothing satisfies all.
template <typename Scalar, int N>
[[nodiscard]] Status extent_along(const Ellipsoid<Scalar, N>& ellipsoid, const Quadric<Scalar, N>* quadrics,
                                  std::size_t count, const Vector<Scalar, N>& direction,
                                  Interval<Scalar>& extent) noexcept {
  const Scalar middle = direction.dot(ellipsoid.center);
  Matrix<Scalar, N + 1> one = Matrix<Scalar, N + 1>::Zero();
  one(0, 0) = Scalar(1);
  // dᵀy less this very number, however it was rounded.
  Matrix<Scalar, N + 1> along = Matrix<Scalar, N + 1>::Zero();
  along(0, 0) = -middle;
  along.template block<N, 1>(1, 0) = scalar::constant<Scalar>(0.5L) * direction;
  along.template block<1, N>(0, 1) = scalar::constant<Scalar>(0.5L) * direction.transpose();
  Scalar most;
  if (const Status status = largest_quotient(ellipsoid, quadrics, count, along, one, most); status != Status::ok) {
    return status;
  }
  Scalar least;
  if (const Status status = largest_quotient(ellipsoid, quadrics, count, Matrix<Scalar, N + 1>(-along), one, least);
      status != Status::ok) {
    return status;
  }
  if (!(most + least >= Scalar(0))) {
    return Status::empty_intersection;
  }
  const Scalar slip = rounding::share<Scalar>(1);
  const Scalar from = middle - least;
  const Scalar to = middle + most;
  extent = {from - slip * scalar::abs(from), to + slip * scalar::abs(to)};
  return Status::ok;
}

}  // namespace elliptude
