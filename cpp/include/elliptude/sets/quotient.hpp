#pragma once

/// \file
/// How large a quotient of two quadratic forms may be on a set: the answer to one question about it, as sharp as its
/// constraints allow, where an ellipsoid about the set has to answer all questions at once. (theory, section 16.11)

#include "elliptude/base/rounding.hpp"
#include "elliptude/sets/detail/quadric_coordinates.hpp"
#include "elliptude/sets/detail/quotient_search.hpp"

namespace elliptude {

/// An ellipsoid and quadrics, of which any number of questions may be asked: they are brought once into the coordinates
/// in which the ellipsoid is the unit ball.
template <typename Scalar, int N>
class QuestionedSet {
 public:
  using Form = Matrix<Scalar, N + 1>;

  /// \param quadrics at most `most_questioned` of them count.
  /// \return of the ellipsoid `not_finite`, `not_symmetric`, `not_positive_definite`. After another than `ok` nothing may be
  /// asked.
  [[nodiscard]] Status see(const Ellipsoid<Scalar, N>& ellipsoid, const Quadric<Scalar, N>* quadrics,
                           std::size_t count) noexcept {
    detail::Coordinates<Scalar, N> at;
    if (const Status status = detail::coordinates_of(ellipsoid, at); status != Status::ok) {
      return status;
    }
    transposed_.setZero();
    transposed_(0, 0) = Scalar(1);
    transposed_.template block<1, N>(0, 1) = at.shift.transpose();
    transposed_.template block<N, N>(1, 1) = at.factor.transpose();
    search_.begin();
    const std::size_t used = count < most_questioned ? count : most_questioned;
    const Scalar rounding = rounding::share<Scalar>(rounding::relaxation(N, static_cast<int>(used)));
    for (std::size_t k = 0; k < used; ++k) {
      search_.add(detail::relaxed(quadrics[k], at.factor, at.shift, at.reach, true, rounding));
    }
    return Status::ok;
  }

  /// A bound of zᵀFz/zᵀGz over all z = [1; y] with y in the ellipsoid and in the quadrics: the least s for which
  /// multipliers μ ≥ 0 with sG − F − ΣμₖMₖ ⪰ 0 were found, where zᵀMₖz is the slack of constraint k. Every such s is a
  /// bound, because no slack is negative in the set; the least of all is the best that the S-procedure gives, exact for
  /// the ellipsoid alone. The search ends where about 1 % is left on the path that it follows. Off that path, in some
  /// sets that are thin to 1e-8 or have indefinite quadrics, far more may be left: the bound holds and says less.
  /// Rounding is on the safe side.
  /// \param f, g symmetric, with G ⪰ 0.
  /// \param largest the bound s, which may be negative.
  /// \return `not_finite`; `unbounded` if no s was found.
  [[nodiscard]] Status largest_quotient(const Form& f, const Form& g, Scalar& largest) noexcept {
    search_.ask(seen(f), magnitude(f), seen(g), magnitude(g));
    return search_.run(largest);
  }

 private:
  [[nodiscard]] Form seen(const Form& form) const noexcept { return symmetric_congruence(transposed_, form); }

  /// A bound of the terms that an entry of the form was summed from.
  [[nodiscard]] Scalar magnitude(const Form& form) const noexcept {
    return congruence(Form(transposed_.cwiseAbs()), Form(form.cwiseAbs())).maxCoeff();
  }

  Form transposed_;  // Tᵀ, z = T [1; u] with u in the unit ball
  detail::QuotientSearch<Scalar, N> search_;
};

/// Between what a number may be.
template <typename Scalar>
struct Interval {
  Scalar least;
  Scalar most;
};

/// Where dᵀy may be for all y in an ellipsoid and in `count` quadrics: two questions, each with multipliers of its own,
/// about the ellipsoid's center, so that nothing is lost where that is far from zero. For convex quadrics they are
/// exact but for where the search ends. (theory, eq. 16.6)
/// \param direction d, of any length.
/// \return the status of `see` and of `largest_quotient`; `empty_intersection` if the bounds prove that nothing
/// satisfies all.
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
  QuestionedSet<Scalar, N> questioned;
  if (const Status status = questioned.see(ellipsoid, quadrics, count); status != Status::ok) {
    return status;
  }
  Scalar most;
  if (const Status status = questioned.largest_quotient(along, one, most); status != Status::ok) {
    return status;
  }
  Scalar least;
  if (const Status status = questioned.largest_quotient(Matrix<Scalar, N + 1>(-along), one, least);
      status != Status::ok) {
    return status;
  }
  if (!(most + least >= Scalar(0))) {
    return Status::empty_intersection;
  }
  const Scalar slip = rounding::one_rounding<Scalar>();
  const Scalar from = middle - least;
  const Scalar to = middle + most;
  extent = {from - slip * scalar::abs(from), to + slip * scalar::abs(to)};
  return Status::ok;
}

}  // namespace elliptude
