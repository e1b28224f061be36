#pragma once

/// \file
/// Ellipsoids and quadrics whose dimension is known at run time, and their conversion to the core's fixed dimensions.

#include <elliptude/sets/quadric.hpp>
#include <type_traits>

#include "arrays.hpp"

namespace elliptude::python {

using AnyEllipsoid = Ellipsoid<double, Eigen::Dynamic>;
using AnyQuadric = Quadric<double, Eigen::Dynamic>;

inline constexpr Index largest_dimension = 6;

/// Calls f(std::integral_constant<int, n>) for the dimension n.
template <typename Function>
auto with_dimension(Index n, const Function& f) {
  switch (n) {
    case 1:
      return f(std::integral_constant<int, 1>{});
    case 2:
      return f(std::integral_constant<int, 2>{});
    case 3:
      return f(std::integral_constant<int, 3>{});
    case 4:
      return f(std::integral_constant<int, 4>{});
    case 5:
      return f(std::integral_constant<int, 5>{});
    case 6:
      return f(std::integral_constant<int, 6>{});
    default:
      value_error("dimension " + std::to_string(n) + " is not supported: from 1 to " +
                  std::to_string(largest_dimension));
  }
}

template <int N>
[[nodiscard]] Ellipsoid<double, N> fixed(const AnyEllipsoid& ellipsoid) {
  return {ellipsoid.center, ellipsoid.shape};
}
template <int N>
[[nodiscard]] Quadric<double, N> fixed(const AnyQuadric& quadric) {
  return {quadric.a, quadric.g, quadric.c};
}
template <int N>
[[nodiscard]] AnyEllipsoid any(const Ellipsoid<double, N>& ellipsoid) {
  return {ellipsoid.center, ellipsoid.shape};
}

/// \throws ValueError unless 1 <= n <= 6; `name` is of the argument that has the dimension.
void require_dimension(Index n, const std::string& name);

/// ½(M + Mᵀ) of a symmetric matrix. \throws ValueError.
[[nodiscard]] Eigen::MatrixXd symmetric(const Eigen::MatrixXd& matrix, const std::string& name);

/// Eigenvalues, largest first, and eigenvectors of a symmetric matrix.
[[nodiscard]] SymmetricEigen<double, Eigen::Dynamic> eigen_of(const Eigen::MatrixXd& matrix, const std::string& name);

/// \throws ValueError unless the symmetric matrix is positive definite.
void require_positive_definite(const Eigen::MatrixXd& matrix, const std::string& name);

/// The size criterion that `criterion` and `weight` name.
template <int N>
[[nodiscard]] SizeCriterion<double, N> size_criterion(bool by_volume, const Eigen::MatrixXd& weight) {
  if (by_volume) {
    return SizeCriterion<double, N>::volume();
  }
  return SizeCriterion<double, N>::weighted_trace(weight);
}

struct Criterion {
  bool by_volume;
  Eigen::MatrixXd weight;
};
/// \throws ValueError.
[[nodiscard]] Criterion criterion_argument(const std::string& criterion, const py::object& weight, Index dimension);

/// The margin of the overlap, or NaN if both sets are flat, so that it cannot be found.
[[nodiscard]] double margin_if_any(const AnyEllipsoid& first, const AnyEllipsoid& second);

/// Directions and lengths of the semi-axes, the longest first.
[[nodiscard]] PrincipalAxes<double, Eigen::Dynamic> axes_of(const AnyEllipsoid& ellipsoid);

/// Points of an ellipsoid, uniform in it or by area on its surface, by NumPy's generator. \throws ValueError.
[[nodiscard]] py::array sample(const AnyEllipsoid& ellipsoid, const py::object& count, const py::object& rng,
                               bool surface);

}  // namespace elliptude::python
