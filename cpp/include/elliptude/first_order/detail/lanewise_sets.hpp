#pragma once

/// \file
/// Factors, sums and overlaps of ellipsoids, lane by lane: what the functions of the same names in linear/ and sets/
/// calculate where all is as usual, without a branch that depends on a lane. Each says in which lanes that holds; there
/// a lane has the bits that it has alone.

#include "elliptude/attitude/detail/quick_foam.hpp"
#include "elliptude/linear/triangular.hpp"
#include "elliptude/sets/overlap.hpp"
#include "elliptude/sets/sum.hpp"

namespace elliptude::detail::lanewise {

template <typename Scalar>
[[nodiscard]] Truth<Scalar> everywhere() noexcept {
  return Scalar(0) == Scalar(0);
}

template <typename Derived>
[[nodiscard]] Truth<typename Derived::Scalar> finite(const Eigen::MatrixBase<Derived>& matrix) noexcept {
  using Scalar = typename Derived::Scalar;
  return Scalar((matrix.derived() - matrix.derived()).sum()) == Scalar(0);
}

/// `a` in the lanes of the mask, else `b`, entry by entry.
template <typename Scalar, int Rows, int Columns>
[[nodiscard]] Matrix<Scalar, Rows, Columns> select(const Truth<Scalar>& mask, const Matrix<Scalar, Rows, Columns>& a,
                                                   const Matrix<Scalar, Rows, Columns>& b) noexcept {
  Matrix<Scalar, Rows, Columns> result;
  for (int k = 0; k < Rows * Columns; ++k) {
    result.data()[k] = scalar::select(mask, a.data()[k], b.data()[k]);
  }
  return result;
}

/// Where a diagonal has no zero and passes `is_in_domain`.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> in_domain(const Matrix<Scalar, N>& shape) noexcept {
  using Limits = std::numeric_limits<scalar::Value<Scalar>>;
  Scalar least = shape(0, 0);
  Scalar most = shape(0, 0);
  for (int i = 1; i < N; ++i) {
    least = lesser(least, Scalar(shape(i, i)));
    most = greater(most, Scalar(shape(i, i)));
  }
  return least >= Scalar(Limits::min()) / rounding::square<Scalar>() &&
         most <= Scalar(Limits::max()) * rounding::square<Scalar>();
}

/// `is_symmetric` of finite numbers.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> symmetric(const Matrix<Scalar, N>& a) noexcept {
  Scalar largest(0);
  Scalar difference(0);
  for (int j = 0; j < N; ++j) {
    for (int i = 0; i < N; ++i) {
      largest = greater(largest, scalar::abs(Scalar(a(i, j))));
      difference = i > j ? greater(difference, scalar::abs(Scalar(a(i, j) - a(j, i)))) : difference;
    }
  }
  return difference <= rounding::root<Scalar>() * largest;
}

/// Notes in which lanes every pivot of a factor is one, and goes on whatever they are.
template <typename Scalar>
[[nodiscard]] auto noting_pivots(Truth<Scalar>& usual) noexcept {
  return [&usual](const Scalar& pivot) noexcept {
    usual = usual && pivot > Scalar(0) && pivot - pivot == Scalar(0);
    return true;
  };
}

/// `cholesky`. \return where there is a factor.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> cholesky(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& l) noexcept {
  Truth<Scalar> usual = everywhere<Scalar>();
  static_cast<void>(cholesky_columns<0>(a, l, noting_pivots<Scalar>(usual)));
  return usual;
}

/// `cholesky_semidefinite` of a matrix that is definite by more than rounding. \return where it is.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> definite_cholesky(const Matrix<Scalar, N>& a, Matrix<Scalar, N>& l) noexcept {
  Truth<Scalar> usual = lanewise::cholesky(a, l);
  const Scalar rounding = rounding::share<Scalar>(rounding::cholesky(N));
  for (int j = 0; j < N; ++j) {
    usual = usual && l(j, j) * l(j, j) > rounding * a(j, j);
  }
  return usual;
}

/// Whether `validate` accepts a shape that may be flat: whichever way `cholesky_semidefinite` goes, it succeeds if a
/// factor is left after the diagonal was raised.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> semidefinite(const Matrix<Scalar, N>& shape) noexcept {
  using Limits = std::numeric_limits<scalar::Value<Scalar>>;
  const Scalar least = Scalar(Limits::min()) / rounding::square<Scalar>();
  const Scalar most = Scalar(Limits::max()) * rounding::square<Scalar>();
  Truth<Scalar> usual = finite(shape) && symmetric(shape);
  Matrix<Scalar, N> raised = shape;
  for (int j = 0; j < N; ++j) {
    const Scalar square = shape(j, j);
    Scalar others(0);
    for (int i = 0; i < N; ++i) {
      others += scalar::abs(Scalar(i < j ? shape(j, i) : shape(i, j)));
    }
    const Truth<Scalar> zero = others == Scalar(0);
    usual = usual && (zero || (square >= least && square <= most));
    raised(j, j) = scalar::select(zero, Scalar(1), square);
  }
  raised.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::cholesky(N));
  Matrix<Scalar, N> factor;
  const Truth<Scalar> raised_once = lanewise::cholesky(raised, factor);
  if (scalar::all(raised_once || !usual)) {
    return usual && raised_once;
  }
  Scalar largest(0);
  for (int j = 0; j < N; ++j) {
    largest = greater(largest, Scalar(shape(j, j)));
  }
  raised.diagonal().array() += rounding::share<Scalar>(rounding::cholesky(N)) * largest;
  return usual && (raised_once || lanewise::cholesky(raised, factor));
}

/// Terms with their shares, as `SharedSum`.
template <typename Scalar, int N>
[[nodiscard]] Matrix<Scalar, N> shared_shape(const Matrix<Scalar, N>* terms, std::size_t count, const Scalar* share,
                                             const Scalar& total) noexcept {
  Matrix<Scalar, N> sum = Matrix<Scalar, N>::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    sum += scalar::select(share[i] > Scalar(0), Scalar(total / share[i]), Scalar(0)) * terms[i];
  }
  return sum;
}

/// `minimal_sum` of ellipsoids about zero, for a criterion that `validate` accepts.
template <std::size_t Most, typename Scalar, int N>
[[nodiscard]] Truth<Scalar> minimal_sum(const Matrix<Scalar, N>* terms, std::size_t count,
                                        const SizeCriterion<Scalar, N>& criterion, Matrix<Scalar, N>& shape) noexcept {
  std::array<Scalar, Most> share;
  Scalar total(0);
  Truth<Scalar> usual = everywhere<Scalar>();
  for (std::size_t i = 0; i < count; ++i) {
    const Scalar square = criterion.weight.cwiseProduct(terms[i]).sum();
    usual = usual && semidefinite(terms[i]) && (square > Scalar(0) || terms[i].cwiseAbs().sum() == Scalar(0));
    share[i] = scalar::sqrt(square);
    total += share[i];
  }
  shape = shared_shape(terms, count, share.data(), total);
  Matrix<Scalar, N> factor;
  if (criterion.kind == SizeCriterion<Scalar, N>::Kind::volume) {
    constexpr int most_steps = detail::SharedSum<Scalar, N>::most_steps;
    Truth<Scalar> settled = !usual;
    for (int step = 0; step < most_steps && !scalar::all(settled); ++step) {
      usual = usual && (settled || lanewise::cholesky(shape, factor));
      const Matrix<Scalar, N> inverse = square_of_lower(lower_inverse(factor));
      std::array<Scalar, Most> next;
      Scalar next_total(0);
      for (std::size_t i = 0; i < count; ++i) {
        const Scalar square = inverse.cwiseProduct(terms[i]).sum();
        usual = usual && (settled || square > Scalar(0) || share[i] == Scalar(0));
        next[i] = scalar::select(share[i] > Scalar(0), scalar::sqrt(square), Scalar(0));
        next_total += next[i];
      }
      Scalar change(0);
      for (std::size_t i = 0; i < count; ++i) {
        change = greater(change, scalar::abs(Scalar(next[i] / next_total - share[i] / total)));
        share[i] = scalar::select(settled, share[i], next[i]);
      }
      total = scalar::select(settled, total, next_total);
      shape = shared_shape(terms, count, share.data(), total);
      settled = settled || !usual || change <= scalar::constant<Scalar>(1e-4L);
    }
  }
  return usual && finite(shape) && lanewise::cholesky(shape, factor);
}

/// `product_of_shapes` of two that `validate` accepts.
template <typename Scalar, int M, int N>
[[nodiscard]] Truth<Scalar> product_of_shapes(const Matrix<Scalar, M>& a, const Matrix<Scalar, N>& b,
                                              const SizeCriterion<Scalar, M + N>& criterion,
                                              Matrix<Scalar, M + N>& product) noexcept {
  Scalar part_a(M);
  Scalar part_b(N);
  Truth<Scalar> usual = everywhere<Scalar>();
  if (criterion.kind != SizeCriterion<Scalar, M + N>::Kind::volume) {
    part_a = scalar::sqrt(Scalar(criterion.weight.template topLeftCorner<M, M>().cwiseProduct(a).sum()));
    part_b = scalar::sqrt(Scalar(criterion.weight.template bottomRightCorner<N, N>().cwiseProduct(b).sum()));
    usual = part_a > Scalar(0) && part_b > Scalar(0);
  } else {
    Matrix<Scalar, M> factor_a;
    Matrix<Scalar, N> factor_b;
    usual = lanewise::cholesky(a, factor_a) && lanewise::cholesky(b, factor_b);
  }
  const Scalar whole = part_a + part_b;
  product.setZero();
  product.template topLeftCorner<M, M>() = (whole / part_a) * a;
  product.template bottomRightCorner<N, N>() = (whole / part_b) * b;
  return usual && finite(product);
}

/// `factorize_mixture` of one that is not flat. \return where it is so.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> factorize_mixture(const Scalar& lambda, const Matrix<Scalar, N>& first,
                                              const Matrix<Scalar, N>& second, bool may_be_flat,
                                              RootFreeFactor<Scalar, N>& factor) noexcept {
  const Matrix<Scalar, N> mixed = lambda * first + (Scalar(1) - lambda) * second;
  Matrix<Scalar, N> scaled;
  Truth<Scalar> usual = everywhere<Scalar>();
  static_cast<void>(root_free_columns<0>(mixed, scaled, factor, noting_pivots<Scalar>(usual)));
  return may_be_flat ? usual && has_accurate_pivots(mixed, factor) : usual;
}

/// `overlap_of_valid`. What has settled stays as it is, whatever the other lanes do.
template <typename Scalar, int N>
[[nodiscard]] Truth<Scalar> overlap(const Vector<Scalar, N>& d, const Matrix<Scalar, N>& first,
                                    const Matrix<Scalar, N>& second, Scalar& margin) noexcept {
  const Scalar tenth = scalar::constant<Scalar>(0.1L);
  Truth<Scalar> usual = everywhere<Scalar>();
  Truth<Scalar> settled = !usual;
  Scalar low(0);
  Scalar high(1);
  Truth<Scalar> valued = settled;  // where the last step leads to where the value alone is to be found
  Scalar lambda = scalar::constant<Scalar>(0.5L);
  Scalar largest(0);
  RootFreeFactor<Scalar, N> factor;
  constexpr int most_steps = 60;
  for (int step = 0; step < most_steps && !scalar::all(settled); ++step) {
    usual = usual && (settled || lanewise::factorize_mixture(lambda, first, second, step > 0, factor));
    const OverlapAt<Scalar> at = overlap_with_factor(lambda, first, second, d, factor);
    largest = scalar::select(settled, largest, greater(largest, at.value));
    const Truth<Scalar> rising = at.slope > Scalar(0);
    low = scalar::select(rising, lambda, low);
    high = scalar::select(rising, high, lambda);
    const Scalar enough = tenth * rounding::root<Scalar>() * high;
    settled = settled || !usual || at.slope == Scalar(0) || scalar::abs(at.step) <= enough || high - low <= enough;
    const Scalar next = lambda + at.step;
    const Truth<Scalar> inside = next > low && next < high;
    const Truth<Scalar> last = !settled && inside && scalar::abs(at.step) <= last_overlap_step(lambda, tenth);
    lambda = scalar::select(settled, lambda,
                            scalar::select(inside, next, Scalar(scalar::constant<Scalar>(0.5L) * (low + high))));
    valued = valued || last;
    settled = settled || last;
  }
  if (!scalar::all(!valued)) {
    usual = usual && (!valued || lanewise::factorize_mixture(lambda, first, second, true, factor));
    largest = scalar::select(valued, greater(largest, overlap_value(lambda, d, factor)), largest);
  }
  margin = Scalar(1) - largest;
  return usual;
}

}  // namespace elliptude::detail::lanewise
