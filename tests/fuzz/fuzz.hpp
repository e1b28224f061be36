#pragma once

/// \file
/// What the fuzz targets share: bytes read as numbers and matrices, truths in long double, and the oracle: what must hold of
/// every set that a function returned with `ok`, and of everything else when it did not.

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>

#include <elliptude/elliptude.hpp>

namespace elliptude::fuzz {

using Real = long double;
using RealVector = Eigen::Matrix<Real, 3, 1>;
using RealMatrix = Eigen::Matrix<Real, 3, 3>;

/// Ends the program: an oracle was broken.
[[noreturn]] inline void broken(const char* oracle, const char* what) {
  std::fprintf(stderr, "ORACLE BROKEN: %s: %s\n", oracle, what);
  std::abort();
}

inline void require(bool holds, const char* oracle, const char* what) {
  if (!holds) {
    broken(oracle, what);
  }
}

/// For who looks into it.
template <typename Matrix>
void show(const char* name, const Matrix& matrix) {
  std::fprintf(stderr, "%s:\n", name);
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
      std::fprintf(stderr, " %.17g", static_cast<double>(matrix(i, j)));
    }
    std::fprintf(stderr, "\n");
  }
}

/// The input, a byte or two at a time; zeros after its end.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  [[nodiscard]] bool at_end() const { return size_ == 0; }
  [[nodiscard]] unsigned byte() {
    if (size_ == 0) {
      return 0;
    }
    --size_;
    return *data_++;
  }
  /// 0 to count − 1.
  [[nodiscard]] int choice(int count) { return static_cast<int>(byte()) % count; }

  /// In [−1, 1], both ends and zero among it.
  [[nodiscard]] double unit() {
    const unsigned coarse = byte();
    if (coarse == 0 || coarse == 255) {
      return coarse == 0 ? 0 : 1;
    }
    if (coarse == 254) {
      return -1;
    }
    return (static_cast<double>(coarse) - 127 + static_cast<double>(byte()) / 256) / 128;
  }

  /// Between two positive numbers, evenly in the logarithm.
  [[nodiscard]] double between(double low, double high) {
    const unsigned coarse = byte();
    const double share = (256.0 * coarse + byte()) / 65535;
    return std::fmin(std::fmax(low * std::pow(high / low, share), low), high);
  }

  /// Any double: mostly of a size that occurs, but also powers of ten, denormals, what is no number, and the last one again.
  [[nodiscard]] double number() {
    const double m = unit();
    switch (choice(12)) {
      case 0:
        last_ = std::copysign(std::pow(10.0, static_cast<int>(byte()) * 631 / 255 - 323), m);
        break;
      case 1: {
        constexpr double special[] = {0.0,
                                      -0.0,
                                      std::numeric_limits<double>::denorm_min(),
                                      std::numeric_limits<double>::min(),
                                      std::numeric_limits<double>::max(),
                                      -std::numeric_limits<double>::max(),
                                      std::numeric_limits<double>::epsilon(),
                                      std::numeric_limits<double>::infinity(),
                                      -std::numeric_limits<double>::infinity(),
                                      std::numeric_limits<double>::quiet_NaN(),
                                      3.141592653589793,
                                      1e154};
        last_ = special[choice(12)];
        break;
      }
      case 2:
        break;  // the last one again
      case 3:
        last_ = m * std::pow(10.0, static_cast<int>(byte()) % 40 - 20);
        break;
      default:
        last_ = m * std::pow(10.0, static_cast<int>(byte()) % 7 - 3);
    }
    return last_;
  }

  template <int Rows, int Columns>
  [[nodiscard]] Eigen::Matrix<double, Rows, Columns> numbers() {
    Eigen::Matrix<double, Rows, Columns> result;
    for (int i = 0; i < Rows * Columns; ++i) {
      result(i) = number();
    }
    return result;
  }

  /// In the unit ball, its surface among it.
  template <int N>
  [[nodiscard]] Eigen::Matrix<Real, N, 1> in_ball() {
    const Eigen::Matrix<Real, N, 1> v = units<N>().template cast<Real>();
    const Real length = v.norm();
    return length > 1 ? Eigen::Matrix<Real, N, 1>(v / (length * (1 + 4 * std::numeric_limits<Real>::epsilon()))) : v;
  }

  /// Numbers in [−1, 1], one after another: arguments of a function have no order.
  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, 1> units() {
    Eigen::Matrix<double, N, 1> result;
    for (int i = 0; i < N; ++i) {
      result(i) = unit();
    }
    return result;
  }

  [[nodiscard]] RealVector unit_vector() {
    const RealVector v = units<3>().cast<Real>();
    return v.norm() > 0 ? RealVector(v.normalized()) : RealVector(RealVector::UnitX());
  }

  /// Entirely free, or a turn about an axis by whole quarters.
  [[nodiscard]] RealMatrix rotation() {
    const Eigen::Quaternion<Real> q(Eigen::Matrix<Real, 4, 1>(units<4>().cast<Real>()));
    return q.norm() > 0 ? RealMatrix(q.normalized().toRotationMatrix()) : RealMatrix(RealMatrix::Identity());
  }

  /// A positive definite shape with semi-axes between the widths, along the coordinate axes or not.
  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, N> shape(double least, double most) {
    Eigen::Matrix<double, N, N> l = Eigen::Matrix<double, N, N>::Zero();
    const int kind = choice(4);
    const double same = between(least, most);
    for (int i = 0; i < N; ++i) {
      l(i, i) = kind == 0 ? same : between(least, most);
      for (int j = 0; j < i && kind >= 2; ++j) {
        l(i, j) = unit() * (kind == 2 ? l(i, i) : l(j, j));
      }
    }
    const Eigen::Matrix<double, N, N> p = l * l.transpose();
    return (p + p.transpose()) / 2;
  }

  /// The same between widths of any kind.
  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, N> any_sized_shape(double least, double most) {
    const double first = between(least, most);
    return shape<N>(first, between(least, most));
  }

  /// A matrix that somebody might give for a shape.
  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, N> any_shape() {
    switch (choice(4)) {
      case 0:
        return numbers<N, N>();
      case 1: {
        const Eigen::Matrix<double, N, N> a = numbers<N, N>();
        return a + a.transpose();
      }
      case 2: {
        const Eigen::Matrix<double, N, 1> d = numbers<N, 1>();
        return d.asDiagonal();
      }
      default: {
        const double scale = number();
        const Eigen::Matrix<double, N, N> p = shape<N>(1e-6, 1);
        return (scale * scale) * p;
      }
    }
  }

  [[nodiscard]] SizeCriterion<double, 6> criterion() {
    using Criterion = SizeCriterion<double, 6>;
    const int kind = choice(4);
    return kind == 0   ? Criterion::trace()
           : kind == 1 ? Criterion::weighted_trace(shape<6>(1e-2, 1e2))
                       : Criterion::volume();
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
  double last_ = 1;
};

/// The bytes of an object, to tell later whether it has changed.
template <typename T>
class Snapshot {
 public:
  explicit Snapshot(const T& object) : object_(&object) { std::memcpy(bytes_, &object, sizeof(T)); }
  [[nodiscard]] bool unchanged() const { return std::memcmp(bytes_, object_, sizeof(T)) == 0; }

 private:
  const void* object_;
  unsigned char bytes_[sizeof(T)];
};

/// exp(S(v)) by Rodrigues' formula.
inline RealMatrix real_exp(const RealVector& v) {
  const Real angle = v.norm();
  RealMatrix s;
  s << 0, -v(2), v(1), v(2), 0, -v(0), -v(1), v(0), 0;
  if (!(angle > 0)) {
    return RealMatrix::Identity();
  }
  const Real half = std::sin(angle / 2) / angle;
  return RealMatrix::Identity() + (std::sin(angle) / angle) * s + (2 * half * half) * (s * s);
}

/// The rotation nearest to a matrix that is one but for rounding.
inline RealMatrix nearest_rotation(RealMatrix c) {
  for (int i = 0; i < 3; ++i) {
    c = (c + RealMatrix(c.inverse().transpose())) / 2;
  }
  return c;
}

/// γ of an attitude about a center, by γ = 4 vee(R)/(1 + tr R), R = ĈᵀC.
inline RealVector gibbs_error(const Eigen::Matrix3d& center, const RealMatrix& attitude) {
  const RealMatrix r = nearest_rotation(center.cast<Real>()).transpose() * attitude;
  const Real scale = 2 / (1 + r.trace());
  return scale * RealVector(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
}

/// The attitude with this γ about a center.
inline RealMatrix gibbs_attitude(const Eigen::Matrix3d& center, const RealVector& gamma) {
  const RealVector g = gamma / 2;
  RealMatrix s;
  s << 0, -g(2), g(1), g(2), 0, -g(0), -g(1), g(0), 0;
  return nearest_rotation(center.cast<Real>()) *
         RealMatrix(RealMatrix::Identity() + (2 / (1 + g.squaredNorm())) * (s + s * s));
}

/// Whether P is finite, symmetric and positive definite, by a factorisation in long double; with `slack` added to it, in
/// multiples of each diagonal entry.
template <int N>
bool is_shape(const Eigen::Matrix<double, N, N>& p, Real slack = 0) {
  // What a user gives is taken as it is if it is symmetric to √ε (`is_symmetric`).
  const double asymmetry = slack > 0 ? 2e-8 : 1e-12;
  if (!p.allFinite() || (p - p.transpose()).cwiseAbs().maxCoeff() > asymmetry * p.cwiseAbs().maxCoeff()) {
    return false;
  }
  const Eigen::Matrix<Real, N, 1> d = p.diagonal().template cast<Real>().cwiseSqrt();
  if (!(d.minCoeff() > 0)) {
    return false;
  }
  const Eigen::Matrix<Real, N, 1> inverse = d.cwiseInverse();
  Eigen::Matrix<Real, N, N> scaled = inverse.asDiagonal() * p.template cast<Real>() * inverse.asDiagonal();
  scaled.diagonal().array() += slack;
  // As it is, too: `point_of` takes that factor, and of a shape that is flat to rounding one may exist without the other.
  return Eigen::LLT<Eigen::Matrix<Real, N, N>>(scaled).info() == Eigen::Success &&
         (slack > 0 || Eigen::LLT<Eigen::Matrix<Real, N, N>>(p.template cast<Real>()).info() == Eigen::Success);
}

/// What a factorisation in double cannot tell from zero: a shape that the user gave may be as flat.
constexpr Real flat_to_rounding = 64 * static_cast<Real>(std::numeric_limits<double>::epsilon());

/// By how much xᵀP⁻¹x exceeds 1, less what its own evaluation may round, and what x, known to `digits`, may be off: positive
/// only where x is outside.
template <int N>
Real outside_by(const Eigen::Matrix<double, N, N>& p, const Eigen::Matrix<Real, N, 1>& x,
                Real digits = 64 * std::numeric_limits<Real>::epsilon()) {
  const Eigen::Matrix<Real, N, 1> inverse = p.diagonal().template cast<Real>().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix<Real, N, N> scaled = inverse.asDiagonal() * p.template cast<Real>() * inverse.asDiagonal();
  const Eigen::LLT<Eigen::Matrix<Real, N, N>> factor(scaled);
  const Eigen::Matrix<Real, N, N> l = factor.matrixL();
  const Eigen::Matrix<Real, N, 1> u = l.template triangularView<Eigen::Lower>().solve(inverse.cwiseProduct(x));
  // The factor is that of a matrix within a few roundings of each entry of the scaled one.
  const Eigen::Matrix<Real, N, N> identity = Eigen::Matrix<Real, N, N>::Identity();
  const Eigen::Matrix<Real, N, N> narrow = l.template triangularView<Eigen::Lower>().solve(identity);
  const Real rounding = 64 * std::numeric_limits<Real>::epsilon() * narrow.squaredNorm() +
                        2 * digits * Eigen::Matrix<Real, N, N>(narrow * inverse.asDiagonal()).norm();
  const Real excess = u.squaredNorm() - 1 - rounding * (1 + u.squaredNorm());
  return excess <= 0 ? Real(0) : excess;  // NaN stays
}

/// A point of the set about zero with this shape, from one of the unit ball.
template <int N>
Eigen::Matrix<Real, N, 1> point_of(const Eigen::Matrix<double, N, N>& shape, const Eigen::Matrix<Real, N, 1>& v) {
  const Eigen::Matrix<Real, N, N> l = Eigen::LLT<Eigen::Matrix<Real, N, N>>(shape.template cast<Real>()).matrixL();
  return l * v;
}

inline double rotation_error(const Eigen::Matrix3d& c) {
  return c.allFinite() ? (c.transpose() * c - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() : 1;
}

/// What must hold for an ellipsoid that was returned with `ok`.
template <int N>
void require_valid(const Ellipsoid<double, N>& set, const char* what, Real slack = 0) {
  if (!set.center.allFinite() || !is_shape<N>(set.shape, slack)) {
    show("center", set.center);
    show("shape", set.shape);
    broken("ok means finite and positive definite", what);
  }
}

/// What must hold for a set of states that was returned with `ok`.
template <typename State, typename Chart>
void require_valid(const StateEllipsoid<State, Chart>& set, const char* what, Real slack = 0) {
  if (!(rotation_error(set.center.attitude) < 1e-12 && set.center.attitude.determinant() > 0)) {
    show("attitude", set.center.attitude);
    broken("the center is a rotation", what);
  }
  require_valid(Ellipsoid<double, 3>{vector_part(set.center), set.shape.template bottomRightCorner<3, 3>()}, what,
                slack);
  require_valid(set.in_coordinates(), what, slack);
}

/// A direction, seen in an attitude with an error of its own within its bound, to rounding; a share of the bound is left for
/// that of its components to doubles.
inline Direction<double> honest_direction(Bytes& bytes, const RealMatrix& attitude, const Eigen::Vector3d& reference,
                                          const Eigen::Matrix3d& bound) {
  const RealVector error = (1 - Real(1e-13)) * point_of<3>(bound, bytes.in_ball<3>());
  const RealVector e = reference.cast<Real>();
  const RealVector body = real_exp(RealVector(-error)) * RealVector(attitude.transpose() * e);
  return {reference, body.cast<double>(), bound, 1.0};
}

}  // namespace elliptude::fuzz
