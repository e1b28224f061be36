// What eigenvalues and eigenvectors are off by at most, against long double: as Jacobi's method finds them, and as spoilt
// ones that no method would find.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "elliptude/linear/eigen.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

// The size is dynamic, because each fixed size takes long to compile.
using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
using LongVector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;

long double norm_of(const LongMatrix& matrix) { return Eigen::JacobiSVD<LongMatrix>(matrix).singularValues()(0); }

LongVector largest_first(const LongMatrix& symmetric) {
  return Eigen::SelfAdjointEigenSolver<LongMatrix>(symmetric).eigenvalues().reverse();
}

// The nearest orthonormal matrix.
LongMatrix orthonormal(const LongMatrix& matrix) {
  const Eigen::JacobiSVD<LongMatrix> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

// Shares of the three bounds that were used up: of eigenvalues, of A − QΛQᵀ, of V − Q.
struct Shares {
  long double values = 0;
  long double matrix = 0;
  long double vectors = 0;
};

template <typename Scalar, int N>
void add_shares(const Matrix<Scalar, N>& a, const SymmetricEigen<Scalar, N>& eigen, Shares& shares) {
  const EigenErrors<Scalar> errors = eigen_errors(a, eigen);
  const LongMatrix exact = a.template cast<long double>();
  const LongMatrix v = eigen.vectors.template cast<long double>();
  const LongVector lambda = eigen.values.template cast<long double>();
  LongVector in_order = lambda;
  std::sort(in_order.data(), in_order.data() + N, [](long double x, long double y) { return x > y; });
  const LongMatrix q = orthonormal(v);
  const LongMatrix left = exact - q * lambda.asDiagonal() * q.transpose();
  const auto of_values = static_cast<long double>(errors.values);
  shares.values = std::max(shares.values, (largest_first(exact) - in_order).cwiseAbs().maxCoeff() / of_values);
  shares.matrix = std::max(shares.matrix, norm_of(left) / of_values);
  shares.vectors = std::max(shares.vectors, norm_of(LongMatrix(v - q)) / static_cast<long double>(errors.vectors));
}

template <typename Scalar, int N>
Matrix<Scalar, N> spread_matrix(Random& random) {
  Vector<double, N> values;
  for (int k = 0; k < N; ++k) {
    values(k) = random.log_uniform(1e-12, 1) * (random.uniform(0, 1) < 0.2 ? -1 : 1);
  }
  if (random.uniform(0, 1) < 0.3) {
    values(1) = values(0);
  }
  // Also where squares of the entries are lost in `float`.
  const double scale = random.log_uniform(1e-24, 1e12);
  return symmetrized(Matrix<Scalar, N>((scale * random.symmetric<N>(values)).template cast<Scalar>()));
}

template <typename Scalar, int N>
void check_errors() {
  Random random(7);
  Shares found;
  Shares spoilt;
  for (int sample = 0; sample < 3000; ++sample) {
    const Matrix<Scalar, N> a = spread_matrix<Scalar, N>(random);
    SymmetricEigen<Scalar, N> eigen;
    REQUIRE(symmetric_eigen(a, eigen) == Status::ok);
    add_shares(a, eigen, found);
    const double size = random.log_uniform(1e-6, 1e-3);
    for (int k = 0; k < N; ++k) {
      eigen.values(k) += Scalar(size * random.normal()) * a.norm();
      for (int j = 0; j < N; ++j) {
        eigen.vectors(j, k) += Scalar(size * random.normal());
      }
    }
    add_shares(a, eigen, spoilt);
  }
  for (const Shares& shares : {found, spoilt}) {
    CHECK(shares.values <= 1);
    CHECK(shares.matrix <= 1);
    CHECK(shares.vectors <= 1);
  }
  // What is spoilt uses up a good part of the bounds: neither is idle.
  CHECK(spoilt.matrix > 0.2L);
  CHECK(spoilt.vectors > 0.2L);
}

}  // namespace

TEST_CASE("an eigenvalue is off by no more than what is left of the matrix says, whatever found it") {
  check_errors<double, 3>();
  check_errors<double, 6>();
  check_errors<float, 3>();
  check_errors<float, 6>();
}

TEST_CASE("a vector that is too short makes the residual as much smaller, and the bound is attained") {
  Random random(11);
  for (const double d : {1e-3, 0.1, 0.5, 0.9}) {
    const Matrix3<double> q = random.rotation();
    const Matrix3<double> a = q * Vector3<double>(1, 0.7, 0.4).asDiagonal() * q.transpose();
    const Matrix3<double> v = q * Vector3<double>(1, std::sqrt(1 - d), 1).asDiagonal();
    Shares shares;
    add_shares<double, 3>(symmetrized(a), {Vector3<double>(1, 0.6, 0.4), v}, shares);
    CHECK(shares.matrix <= 1);
    CHECK(shares.matrix > 1 - 1e-12);
  }
  const SymmetricEigen<double, 3> none{Vector3<double>::Zero(), Matrix3<double>::Zero()};
  CHECK(std::isinf(eigen_errors(Matrix3<double>(Matrix3<double>::Identity()), none).values));
}

TEST_CASE("a diagonal matrix, one of zeros, and one of the least numbers") {
  SymmetricEigen<double, 3> eigen;
  Matrix3<double> a = Vector3<double>(1, 3, 2).asDiagonal();
  REQUIRE(symmetric_eigen(a, eigen) == Status::ok);
  CHECK(eigen_errors(a, eigen).values < 100 * std::numeric_limits<double>::epsilon());
  a.setZero();
  REQUIRE(symmetric_eigen(a, eigen) == Status::ok);
  CHECK(eigen_errors(a, eigen).values == 0);
  a.setConstant(1e-300);
  REQUIRE(symmetric_eigen(a, eigen) == Status::ok);
  CHECK(eigen_errors(a, eigen).values > 1e-316);
  CHECK(eigen_errors(a, eigen).values < 1e-312);
}
