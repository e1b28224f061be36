#pragma once

/// \file
/// Functions of rotations.

#include <array>
#include <elliptude/base/so3.hpp>

#include "common.hpp"

namespace elliptude::operations {

struct Exponential {
  Matrix3d operator()(const Vector3d& zeta) const { return exp(zeta); }
};
struct RightJacobian {
  Matrix3d operator()(const Vector3d& zeta) const { return right_jacobian(zeta); }
};
struct RightJacobianInverse {
  Matrix3d operator()(const Vector3d& zeta) const { return right_jacobian_inverse(zeta); }
};
struct Cayley {
  Matrix3d operator()(const Vector3d& zeta) const { return cayley(zeta); }
};

/// \param size of the rotation vectors' entries, in thousandths of a radian.
template <typename Function, int size>
double rotation(long count) {
  constexpr std::size_t samples = 256;
  static const std::array<Vector3d, samples> inputs = [] {
    Random random;
    std::array<Vector3d, samples> result;
    for (Vector3d& input : result) {
      input = random.in_cube(1e-3 * size);
    }
    return result;
  }();
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    sum += Function()(inputs[static_cast<std::size_t>(i) % samples]).sum();
  }
  return sum;
}

inline double logarithm(long count) {
  constexpr std::size_t samples = 256;
  static const std::array<Matrix3d, samples> inputs = [] {
    Random random;
    std::array<Matrix3d, samples> result;
    for (Matrix3d& input : result) {
      input = exp(random.in_cube(1.8));
    }
    return result;
  }();
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    sum += log(inputs[static_cast<std::size_t>(i) % samples]).sum();
  }
  return sum;
}

}  // namespace elliptude::operations
