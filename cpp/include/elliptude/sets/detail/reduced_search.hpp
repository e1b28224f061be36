#pragma once

/// \file
/// Where the search of `minimal_intersection` begins: at the best q, found in coordinates in which each step costs
/// little. (theory, section 7.4) Every q gives a bound, and the search goes on from there with factors of A itself, so
/// that nothing rests on the rounding of these coordinates. No branch depends on a number: a lane of many has the bits
/// that it has alone.

#include <array>

#include "elliptude/sets/detail/combination.hpp"

namespace elliptude::detail {

/// Householder's reflection I − scale·axis·axisᵀ, which turns a vector into `image` times the last unit vector.
template <typename Scalar, int Size>
struct Reflection {
  Vector<Scalar, Size> axis;
  Scalar scale;
  Scalar image;

  explicit Reflection(const Vector<Scalar, Size>& x) noexcept : axis(x) {
    const Scalar length = scalar::sqrt(Scalar(x.squaredNorm()));
    image = scalar::select(x(Size - 1) > Scalar(0), Scalar(-length), length);  // nothing cancels in the axis
    axis(Size - 1) -= image;
    scale = scalar::select(length > Scalar(0), Scalar(Scalar(-1) / (image * axis(Size - 1))), Scalar(0));
  }

  /// H S H for a symmetric matrix, of whose first coordinates the reflection is one.
  template <int N>
  void turn(Matrix<Scalar, N>& symmetric) const noexcept {
    Vector<Scalar, N> product = scale * symmetric.template leftCols<Size>().lazyProduct(axis);
    const Scalar along = scalar::constant<Scalar>(0.5L) * scale * axis.dot(product.template head<Size>());
    product.template head<Size>() -= along * axis;
    symmetric.template leftCols<Size>() -= product.lazyProduct(axis.transpose());
    symmetric.template topRows<Size>() -= axis.lazyProduct(product.transpose());
  }
};

/// Σ aₖbₖ of the first `count` numbers, added up as Eigen adds up a sum that it writes out, of two to six: in two halves,
/// each from its end.
template <typename Scalar, int N>
[[nodiscard]] Scalar product_in_halves(const Vector<Scalar, N>& a, const Vector<Scalar, N>& b, int count) noexcept {
  const auto backwards = [&](int first, int last) {
    Scalar sum = a(last) * b(last);
    for (int k = last; k-- > first;) {
      sum += a(k) * b(k);
    }
    return sum;
  };
  const int half = count / 2;
  return half == 0 ? backwards(0, count - 1) : Scalar(backwards(0, half - 1) + backwards(half, count - 1));
}

/// `Reflection` of a size that is known when it runs, with the same bits: the code is there once.
template <typename Scalar, int N>
struct LoopedReflection {
  static_assert(N <= 6, "a longer sum is added up in another order");
  int size;
  Vector<Scalar, N> axis;
  Scalar scale;
  Scalar image;

  LoopedReflection(const Vector<Scalar, N>& x, int count) noexcept : size(count), axis(x) {
    const Scalar length = scalar::sqrt(product_in_halves<Scalar, N>(x, x, count));
    image = x(count - 1) > Scalar(0) ? Scalar(-length) : length;
    axis(count - 1) -= image;
    scale = length > Scalar(0) ? Scalar(Scalar(-1) / (image * axis(count - 1))) : Scalar(0);
  }

  /// H S H for the first `count` rows and columns of a symmetric matrix.
  ELLIPTUDE_OUT_OF_LINE void turn(int count, Matrix<Scalar, N>& symmetric) const noexcept {
    Vector<Scalar, N> product;
    for (int i = 0; i < count; ++i) {
      product(i) = scale * product_in_halves<Scalar, N>(symmetric.row(i), axis, size);
    }
    const Scalar along = scalar::constant<Scalar>(0.5L) * scale * product_in_halves<Scalar, N>(axis, product, size);
    for (int i = 0; i < size; ++i) {
      product(i) -= along * axis(i);
    }
    for (int j = 0; j < size; ++j) {
      for (int i = 0; i < count; ++i) {
        symmetric(i, j) -= product(i) * axis(j);
      }
    }
    for (int j = 0; j < count; ++j) {
      for (int i = 0; i < size; ++i) {
        symmetric(i, j) -= axis(i) * product(j);
      }
    }
  }
};

/// A polynomial Σ cₖ qᵏ of q with room for `Count` coefficients.
template <typename Scalar, std::size_t Count>
using Polynomial = std::array<Scalar, Count>;

/// A polynomial of q and its first two derivatives, at one q.
template <typename Scalar>
struct Jet {
  Scalar value;
  Scalar first;
  Scalar second;

  /// \param degree of the polynomial, whose further coefficients are not read.
  template <std::size_t Count>
  [[nodiscard]] ELLIPTUDE_INLINE static Jet of(std::size_t degree, const Polynomial<Scalar, Count>& polynomial,
                                               const Scalar& q) noexcept {
    Scalar value = polynomial[degree];
    Scalar first(0);
    Scalar half_second(0);
    for (std::size_t k = degree; k-- > 0;) {
      half_second = half_second * q + first;
      first = first * q + value;
      value = value * q + polynomial[k];
    }
    return {value, first, Scalar(2) * half_second};
  }
  /// Adds the derivatives of `times` log of this.
  void add_logarithm(const Scalar& times, Scalar& slope, Scalar& curvature) const noexcept {
    const Scalar inverse = Scalar(1) / value;
    const Scalar relative = first * inverse;
    slope += times * relative;
    curvature += times * (second * inverse - relative * relative);
  }
};

/// T = QᵀMQ, a tridiagonal matrix, where Qᵀv is a multiple of the last unit vector; and QᵀW'Q unless by volume.
template <typename Scalar, int N>
struct Tridiagonal {
  Vector<Scalar, N> diagonal;
  Vector<Scalar, N> beside;  ///< the last is ± ‖v‖
  Matrix<Scalar, N> weight;

  ELLIPTUDE_OUT_OF_LINE Tridiagonal(const Matrix<Scalar, N>& m, const Vector<Scalar, N>& v,
                                    const RelativeSize<Scalar, N>& size) noexcept {
    Matrix<Scalar, N> t = m;
    const bool weighted = !size.by_volume();
    if (weighted) {
      weight = size.weight();
    }
    if constexpr (is_written_out<N>) {
      reflect<N>(v, weighted, t);
      reflect_columns<N - 1>(weighted, t);
    } else {
      for (int turned = N; turned == N || turned > 1; --turned) {
        const LoopedReflection<Scalar, N> reflection(turned == N ? v : Vector<Scalar, N>(t.col(turned)), turned);
        beside(turned - 1) = reflection.image;
        reflection.turn(turned, t);
        if (weighted) {
          reflection.turn(N, weight);
        }
      }
    }
    if constexpr (N > 1) {
      beside(0) = t(0, 1);
    }
    diagonal = t.diagonal();
  }

 private:
  /// The reflection that turns x into the last unit vector of the first `Size`. Of t these coordinates alone are
  /// turned: what their column has become is known.
  template <int Size>
  ELLIPTUDE_OUT_OF_LINE void reflect(const Vector<Scalar, Size>& x, bool weighted, Matrix<Scalar, N>& t) noexcept {
    const Reflection<Scalar, Size> reflection(x);
    beside(Size - 1) = reflection.image;
    Matrix<Scalar, Size> rest = t.template topLeftCorner<Size, Size>();
    reflection.turn(rest);
    t.template topLeftCorner<Size, Size>() = rest;
    if (weighted) {
      reflection.turn(weight);
    }
  }

  /// The same for what is left above the diagonal of each column, from the one after the first `Size` down.
  template <int Size>
  void reflect_columns(bool weighted, Matrix<Scalar, N>& t) noexcept {
    if constexpr (Size > 1) {
      reflect<Size>(Vector<Scalar, Size>(t.col(Size).template head<Size>()), weighted, t);
      reflect_columns<Size - 1>(weighted, t);
    }
  }
};

/// The logarithm of the size of (7.5) with its derivatives, by polynomials of q: det(T + qI), N and tr W'A⁻¹ times it,
/// from minors of T + qI with T tridiagonal, (7.9) and (7.10). All in units of a typical q.
template <typename Scalar, int N>
class ReducedSize {
 public:
  /// \param m positive semidefinite.
  /// \param slack_at_origin k of the problem.
  /// \param size of sets that are not flat.
  ReducedSize(const Matrix<Scalar, N>& m, const Vector<Scalar, N>& v, const Scalar& slack_at_origin,
              const RelativeSize<Scalar, N>& size, const Scalar& unit) noexcept
      : by_volume_(size.by_volume()) {
    Tridiagonal<Scalar, N> t(m, v, size);
    const Scalar scale = Scalar(1) / unit;
    t.beside *= scale;
    t.diagonal *= scale;
    expand(t, Scalar(slack_at_origin * scale));
  }

  /// √(hH) of the harmonic and the arithmetic mean of T's eigenvalues, if T ≻ 0: 1/h is the sum of p'(0)/p(0), p =
  /// det(T + qI).
  [[nodiscard]] Scalar mean() const noexcept {
    return scalar::sqrt(Scalar(determinant_[N - 1] * determinant_[0] / determinant_[1]));
  }

  /// The first and second derivative with respect to q.
  /// \return whether det(T + qI) > 0 and N > 0; if not, the derivatives are of no use.
  [[nodiscard]] auto derivatives(const Scalar& q, Scalar& slope, Scalar& curvature) const noexcept {
    const auto of_determinant = Jet<Scalar>::of(N, determinant_, q);
    const auto of_level = Jet<Scalar>::of(N + 1, level_, q);
    slope = Scalar(0);
    curvature = Scalar(0);
    if (by_volume()) {
      of_level.add_logarithm(Scalar(N), slope, curvature);
      of_determinant.add_logarithm(Scalar(-N - 1), slope, curvature);
    } else {
      of_level.add_logarithm(Scalar(1), slope, curvature);
      of_determinant.add_logarithm(Scalar(-2), slope, curvature);
      Jet<Scalar>::of(N - 1, trace_, q).add_logarithm(Scalar(1), slope, curvature);
    }
    return of_determinant.value > Scalar(0) && of_level.value > Scalar(0);
  }

 private:
  [[nodiscard]] bool by_volume() const noexcept { return only_volume || by_volume_; }

  using Coefficients = Polynomial<Scalar, N + 2>;
  using Minors = std::array<Coefficients, N + 1>;

  /// The polynomials.
  /// \param slack at the origin.
  ELLIPTUDE_OUT_OF_LINE void expand(Tridiagonal<Scalar, N>& t, const Scalar& slack) noexcept {
    const Vector<Scalar, N> squares = t.beside.cwiseAbs2();
    Minors leading;
    leading[0] = {Scalar(1)};
    leading[1] = {t.diagonal(0), Scalar(1)};
    if constexpr (is_written_out<N>) {
      add_leading<1>(t.diagonal, squares, leading);
      level_ = next(N, leading[N], slack, Scalar(-squares(N - 1)), leading[N - 1]);
    } else {
      for (int size = 1; size <= N; ++size) {  // the last is N(q) det(T + qI), which the minors have no room for
        const auto k = static_cast<std::size_t>(size);
        const Scalar diagonal = size < N ? t.diagonal(size) : slack;
        const Scalar square = size < N ? squares(size - 1) : Scalar(-squares(N - 1));
        (size < N ? leading[k + 1] : level_) = next(k, leading[k], diagonal, square, leading[k - 1]);
      }
    }
    determinant_ = leading[N];
    if (!by_volume()) {
      weigh_minors(t);
      trace_.fill(Scalar(0));
      if constexpr (is_written_out<N>) {
        add_columns<N - 1>(t, squares, leading, leading[0], leading[0]);
      } else {
        Coefficients trailing = leading[0];
        Coefficients before = leading[0];
        for (int column = N - 1; column >= 0; --column) {
          add_column(column, t, leading, trailing);
          const auto below = static_cast<std::size_t>(N - 1 - column);
          const Coefficients longer = next(below, trailing, t.diagonal(column), squares(column), before);
          before = trailing;
          trailing = longer;
        }
      }
    }
  }

  /// (t + q) · minor − square · before, where the minor is of this degree and `before` of one less.
  [[nodiscard]] ELLIPTUDE_INLINE static Coefficients next(std::size_t degree, const Coefficients& minor,
                                                          const Scalar& t, const Scalar& square,
                                                          const Coefficients& before) noexcept {
    Coefficients result;
    result[0] = t * minor[0];
    for (std::size_t k = 1; k <= degree; ++k) {
      result[k] = t * minor[k] + minor[k - 1];
    }
    for (std::size_t k = 0; k < degree; ++k) {
      result[k] -= square * before[k];
    }
    result[degree + 1] = minor[degree];
    return result;
  }

  /// The leading minors of more than `Size` rows. A recursion, like the other, so that each loop has a constant length
  /// and is unrolled. Where it is not written out, there are loops instead of both.
  template <int Size>
  static void add_leading(const Vector<Scalar, N>& diagonal, const Vector<Scalar, N>& squares,
                          Minors& leading) noexcept {
    if constexpr (Size < N) {
      leading[Size + 1] = next(Size, leading[Size], diagonal(Size), squares(Size - 1), leading[Size - 1]);
      add_leading<Size + 1>(diagonal, squares, leading);
    }
  }

  /// Makes of QᵀW'Q what (7.10) multiplies the minors with.
  static void weigh_minors(Tridiagonal<Scalar, N>& t) noexcept {
    for (int j = 1; j < N; ++j) {
      Scalar product(2);
      for (int i = j - 1; i >= 0; --i) {
        product *= -t.beside(i);
        t.weight(i, j) *= product;
      }
    }
  }

  /// Adds what a column has of tr(QᵀW'Q (T + qI)⁻¹) det(T + qI).
  /// \param trailing minor of the rows below.
  ELLIPTUDE_INLINE void add_column(int column, const Tridiagonal<Scalar, N>& t, const Minors& leading,
                                   const Coefficients& trailing) noexcept {
    const auto most = static_cast<std::size_t>(column);  // the degree of the sum of leading minors
    const std::size_t below = N - 1 - most;              // that of the trailing one
    std::array<Scalar, N> sum;
    for (std::size_t k = 0; k <= most; ++k) {
      sum[k] = t.weight(static_cast<Eigen::Index>(k), column) * leading[k][k];
      for (std::size_t i = k + 1; i <= most; ++i) {
        sum[k] += t.weight(static_cast<Eigen::Index>(i), column) * leading[i][k];
      }
    }
    for (std::size_t k = 0; k <= most; ++k) {
      for (std::size_t i = 0; i <= below; ++i) {
        trace_[k + i] += sum[k] * trailing[i];
      }
    }
  }

  /// What the columns from `Column` down have.
  /// \param trailing minor of the rows below, and `before` that without the first of them, if there is one.
  template <int Column>
  void add_columns(const Tridiagonal<Scalar, N>& t, const Vector<Scalar, N>& squares, const Minors& leading,
                   const Coefficients& trailing, const Coefficients& before) noexcept {
    add_column(Column, t, leading, trailing);
    if constexpr (Column > 0) {
      constexpr std::size_t below = N - 1 - Column;
      add_columns<Column - 1>(t, squares, leading, next(below, trailing, t.diagonal(Column), squares(Column), before),
                              trailing);
    }
  }

  bool by_volume_;
  Coefficients determinant_;  ///< det(T + qI), of degree N
  Coefficients level_;        ///< N(q) det(T + qI), of degree N + 1
  Coefficients trace_;        ///< tr(W'A⁻¹) det(T + qI), of degree N − 1, if not by volume
};

/// The q of least size, in units of `unit`, by Newton's steps in q/(c + q), where c is a mean of M's eigenvalues:
/// (7.11). One where the first set alone is the best, and where the steps do not arrive at a minimum that is more than
/// rounding.
template <typename Scalar, int N>
[[nodiscard]] Scalar reduced_weight(const ReducedSize<Scalar, N>& size) noexcept {
  const Scalar tolerance = scalar::constant<Scalar>(0.1L) * scalar::sqrt(rounding::root<Scalar>());
  const Scalar infinity(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  const Scalar longest(10);
  Scalar slope;
  Scalar curvature;
  const auto definite = size.derivatives(Scalar(0), slope, curvature);
  auto settled = definite && slope >= Scalar(0);
  auto arrived = Scalar(1) < Scalar(0);
  const Scalar wanted = size.mean();
  const Scalar mean = scalar::select(wanted > Scalar(0) && wanted < infinity, wanted, Scalar(1));
  Scalar low(0);
  Scalar high = infinity;
  Scalar q = mean;
  constexpr int most_steps = 12;
  for (int step = 0; step < most_steps && !scalar::all(settled); ++step) {
    settled = settled || !size.derivatives(q, slope, curvature);
    const auto rising = slope > Scalar(0);
    high = scalar::select(rising, q, high);
    low = scalar::select(rising, low, q);
    const auto above = high < infinity;
    const auto below = low > Scalar(0);
    const Scalar most = scalar::select(above, high, Scalar(longest * q));
    const Scalar least = scalar::select(below, low, Scalar(q / longest));
    const Scalar reach = mean + q;
    const Scalar fall = slope * reach;
    const Scalar bend = curvature * reach * reach + Scalar(2) * fall;
    const Scalar newton = (q * bend - mean * fall) / (bend + fall);
    const auto inside = bend > rounding::root<Scalar>() && newton > least && newton < most;
    const Scalar up = scalar::select(above, Scalar(scalar::sqrt(Scalar(most * q))), most);
    const Scalar down = scalar::select(below, Scalar(scalar::sqrt(Scalar(least * q))), least);
    const Scalar next = scalar::select(inside, newton, scalar::select(rising, down, up));
    arrived = arrived || (!settled && inside && scalar::abs(Scalar(newton - q)) <= tolerance * q);
    q = scalar::select(settled, q, next);
    settled = settled || arrived || scalar::abs(bend) <= rounding::root<Scalar>();
  }
  return scalar::select(arrived, q, Scalar(1));
}

/// A q near the best of two sets that are not flat; `typical` where one alone is the best.
template <typename Scalar, int N, typename Slack>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Scalar start_of_search(const Problem<Scalar, N, Slack>& problem,
                                                           const RelativeSize<Scalar, N>& size,
                                                           const Scalar& typical) noexcept {
  const Scalar slack_at_origin = problem.slack(Vector<Scalar, N>::Zero());
  const auto idle = slack_at_origin >= size.idle_slack(problem.m);
  if (scalar::all(idle)) {
    return typical;
  }
  const Scalar q =
      typical * reduced_weight(ReducedSize<Scalar, N>(problem.m, problem.v, slack_at_origin, size, typical));
  return scalar::select(!idle && q > Scalar(0) && q - q == Scalar(0), q, typical);
}

}  // namespace elliptude::detail
