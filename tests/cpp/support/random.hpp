#pragma once

/// \file
/// Seeded random input for the tests: the same on every run and machine (the standard's engines are specified to the bit;
/// its distributions are not, and are not used).

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>
#include <random>

namespace elliptude::testing {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  /// Uniform in [low, high).
  [[nodiscard]] double uniform(double low, double high) {
    return low + (high - low) * std::ldexp(static_cast<double>(engine_() >> 11), -53);
  }

  /// Uniform in the logarithm.
  [[nodiscard]] double log_uniform(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }

  /// Standard normal (Box and Muller).
  [[nodiscard]] double normal() {
    return std::sqrt(-2 * std::log(1 - uniform(0, 1))) * std::cos(uniform(0, 6.283185307179586));
  }

  template <int Rows, int Columns = 1>
  [[nodiscard]] Eigen::Matrix<double, Rows, Columns> normal_matrix() {
    Eigen::Matrix<double, Rows, Columns> result;
    for (int j = 0; j < Columns; ++j) {
      for (int i = 0; i < Rows; ++i) {
        result(i, j) = normal();
      }
    }
    return result;
  }

  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, 1> unit_vector() {
    return normal_matrix<N>().normalized();
  }

  /// Uniform in the unit ball.
  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, 1> in_ball() {
    return std::pow(uniform(0, 1), 1.0 / N) * unit_vector<N>();
  }

  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, N> orthogonal() {
    const Eigen::Matrix<double, N, N> matrix = normal_matrix<N, N>();
    return Eigen::HouseholderQR<Eigen::Matrix<double, N, N>>(matrix).householderQ();
  }

  /// Uniform in SO(3), by a uniform unit quaternion.
  [[nodiscard]] Eigen::Matrix3d rotation() {
    const Eigen::Vector4d q = unit_vector<4>();
    return Eigen::Quaterniond(q(0), q(1), q(2), q(3)).toRotationMatrix();
  }

  /// Symmetric, with the eigenvalues given, in a random frame.
  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, N> symmetric(const Eigen::Matrix<double, N, 1>& eigenvalues) {
    const Eigen::Matrix<double, N, N> frame = orthogonal<N>();
    const Eigen::Matrix<double, N, N> matrix = frame * eigenvalues.asDiagonal() * frame.transpose();
    return (matrix + matrix.transpose()) / 2;
  }

  /// Symmetric positive definite, eigenvalues from 1/√condition to √condition, both taken where N > 1.
  template <int N>
  [[nodiscard]] Eigen::Matrix<double, N, N> positive_definite(double condition) {
    Eigen::Matrix<double, N, 1> eigenvalues;
    for (int i = 0; i < N; ++i) {
      eigenvalues(i) = log_uniform(1 / std::sqrt(condition), std::sqrt(condition));
    }
    eigenvalues(0) = std::sqrt(condition);
    eigenvalues(N - 1) = 1 / std::sqrt(condition);
    return symmetric<N>(eigenvalues);
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace elliptude::testing
