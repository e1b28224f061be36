#pragma once

/// \file
/// Where the search of `minimal_intersection` begins: at the best q, found in coordinates in which each step costs little. (theory,
/// section 7.4) Every q gives a bound, and the search goes on from there with factors of A itself, so that nothing rests on the
/// rounding of these coordinates. No branch depends on a number: a lane of many has the bits that it has alone.

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

/// A polynomial of q and its first two derivatives, at one q.
template <typename Scalar>
struct Jet {
  Scalar value;
  Scalar first;
  Scalar second;

  /// (q + x) · this − square · before, for `factor` = q + x.
  [[nodiscard]] Jet next(const Scalar& factor, const Scalar& square, const Jet& before) const noexcept {
    return {factor * value - square * before.value, value + factor * first - square * before.first,
            Scalar(2) * first + factor * second - square * before.second};
  }
  void add(const Scalar& times, const Jet& other) noexcept {
    value += times * other.value;
    first += times * other.first;
    second += times * other.second;
  }
  void add_product(const Jet& a, const Jet& b) noexcept {
    value += a.value * b.value;
    first += a.first * b.value + a.value * b.first;
    second += a.second * b.value + Scalar(2) * a.first * b.first + a.value * b.second;
  }
  /// Adds the derivatives of `times` log of this.
  void add_logarithm(const Scalar& times, Scalar& slope, Scalar& curvature) const noexcept {
    const Scalar inverse = Scalar(1) / value;
    const Scalar relative = first * inverse;
    slope += times * relative;
    curvature += times * (second * inverse - relative * relative);
  }
};

/// The logarithm of the size of (7.5) with its derivatives, by minors of T + qI, where T = QᵀMQ is tridiagonal and Qᵀv a multiple of the last
/// unit vector: (7.9) and (7.10). All in units of a typical q.
template <typename Scalar, int N>
class ReducedSize {
 public:
  /// \param slack_at_origin k of the problem.
  /// \param size of sets that are not flat.
  ReducedSize(const Matrix<Scalar, N>& m, const Vector<Scalar, N>& v, const Scalar& slack_at_origin,
              const RelativeSize<Scalar, N>& size, const Scalar& unit) noexcept
      : by_volume_(size.by_volume()), slack_(slack_at_origin / unit) {
    Matrix<Scalar, N> t = m;
    if (!by_volume_) {
      weight_ = size.weight();
    }
    reduce<N>(v, t);
    if constexpr (N > 1) {
      beside_(0) = t(0, 1);
    }
    const Scalar scale = Scalar(1) / unit;
    beside_ *= scale;
    diagonal_ = scale * t.diagonal();
    squares_ = beside_.cwiseAbs2();
    if (!by_volume_) {
      weigh_minors();
    }
  }

  /// The first and second derivative with respect to q, and det(T + qI).
  /// \return whether T + qI ≻ 0 and N > 0; if not, the derivatives are of no use.
  [[nodiscard]] auto derivatives(const Scalar& q, Scalar& slope, Scalar& curvature,
                                 Scalar& determinant) const noexcept {
    const Jet<Scalar> zero{Scalar(0), Scalar(0), Scalar(0)};
    std::array<Jet<Scalar>, N + 1> leading;
    leading[0] = {Scalar(1), Scalar(0), Scalar(0)};
    leading[1] = {diagonal_(0) + q, Scalar(1), Scalar(0)};
    auto valid = leading[1].value > Scalar(0);
    for (std::size_t i = 1; i < N; ++i) {
      const Eigen::Index row = static_cast<Eigen::Index>(i);
      leading[i + 1] = leading[i].next(diagonal_(row) + q, squares_(row - 1), leading[i - 1]);
      valid = valid && leading[i + 1].value > Scalar(0);
    }
    const Jet<Scalar> level = leading[N].next(slack_ + q, -squares_(N - 1), leading[N - 1]);
    slope = Scalar(0);
    curvature = Scalar(0);
    if (by_volume_) {
      level.add_logarithm(Scalar(N), slope, curvature);
      leading[N].add_logarithm(Scalar(-N - 1), slope, curvature);
    } else {
      level.add_logarithm(Scalar(1), slope, curvature);
      leading[N].add_logarithm(Scalar(-2), slope, curvature);
      Jet<Scalar> trace = zero;
      add_columns<N - 1>(q, leading, leading[0], zero, trace);
      trace.add_logarithm(Scalar(1), slope, curvature);
    }
    determinant = leading[N].value;
    return valid && level.value > Scalar(0);
  }

 private:
  /// The reflections that turn x into the last unit vector of the first `Size`, and then column for column what is left of it.
  template <int Size>
  void reduce(const Vector<Scalar, Size>& x, Matrix<Scalar, N>& t) noexcept {
    const Reflection<Scalar, Size> reflection(x);
    beside_(Size - 1) = reflection.image;
    reflection.turn(t);
    if (!by_volume_) {
      reflection.turn(weight_);
    }
    if constexpr (Size > 2) {
      reduce<Size - 1>(Vector<Scalar, Size - 1>(t.col(Size - 1).template head<Size - 1>()), t);
    }
  }

  /// Makes of QᵀW'Q what (7.10) multiplies the minors with.
  void weigh_minors() noexcept {
    for (int j = 1; j < N; ++j) {
      Scalar product(2);
      for (int i = j - 1; i >= 0; --i) {
        product *= -beside_(i);
        weight_(i, j) *= product;
      }
    }
  }

  /// Adds what the columns from `Column` down have of tr(QᵀW'Q (T + qI)⁻¹) det(T + qI).
  /// \param trailing minor of the rows below, and `before` that without the first of them. A recursion, so that each loop has a constant
  /// length and is unrolled.
  template <int Column>
  void add_columns(const Scalar& q, const std::array<Jet<Scalar>, N + 1>& leading, const Jet<Scalar>& trailing,
                   const Jet<Scalar>& before, Jet<Scalar>& sum) const noexcept {
    Jet<Scalar> column{Scalar(0), Scalar(0), Scalar(0)};
    for (int i = 0; i <= Column; ++i) {
      column.add(weight_(i, Column), leading[static_cast<std::size_t>(i)]);
    }
    sum.add_product(column, trailing);
    if constexpr (Column > 0) {
      add_columns<Column - 1>(q, leading, trailing.next(diagonal_(Column) + q, squares_(Column), before), trailing,
                              sum);
    }
  }

  bool by_volume_;
  Scalar slack_;
  Vector<Scalar, N> diagonal_;
  Vector<Scalar, N> beside_;   ///< the last is ± ‖v‖
  Vector<Scalar, N> squares_;  ///< of `beside_`
  Matrix<Scalar, N> weight_;   ///< if not by volume
};

/// The q of least size, in units of `unit`, by Newton's steps in q/(c + q), where c is the geometric mean of M's eigenvalues: (7.11). One where
/// the first set alone is the best, and where the steps do not arrive at a minimum that is more than rounding.
template <typename Scalar, int N>
[[nodiscard]] Scalar reduced_weight(const ReducedSize<Scalar, N>& size) noexcept {
  const Scalar tolerance = scalar::constant<Scalar>(0.1L) * scalar::sqrt(rounding::root<Scalar>());
  const Scalar infinity(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  const Scalar longest(10);
  Scalar slope;
  Scalar curvature;
  Scalar determinant;
  const auto definite = size.derivatives(Scalar(0), slope, curvature, determinant);
  auto settled = definite && slope >= Scalar(0);
  auto arrived = Scalar(1) < Scalar(0);
  const Scalar mean = scalar::exp(Scalar(scalar::log(scalar::select(definite, determinant, Scalar(1))) / Scalar(N)));
  Scalar low(0);
  Scalar high = infinity;
  Scalar q = mean;
  constexpr int most_steps = 12;
  for (int step = 0; step < most_steps && !scalar::all(settled); ++step) {
    settled = settled || !size.derivatives(q, slope, curvature, determinant);
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
