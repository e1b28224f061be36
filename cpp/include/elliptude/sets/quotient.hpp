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

}  // namespace elliptude
