// Small factorisations, against Eigen's decompositions and against matrices whose factors are known.
#include <doctest/doctest.h>

#include <array>
#include <limits>

#include "elliptude/linear/eigen.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/linear/norms.hpp"
#include "elliptude/linear/svd.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

// The size is dynamic, because each fixed size takes long to compile.
using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

// Entries of l lᵀ − a, each as a share of √(aᵢᵢ aⱼⱼ): the scale in which Cholesky's method is accurate.
template <int N>
LongMatrix scaled_defect(const Matrix<double, N>& a, const Matrix<double, N>& l) {
  const LongMatrix exact = l.template cast<long double>();
  LongMatrix defect = exact * exact.transpose() - a.template cast<long double>();
  for (int j = 0; j < N; ++j) {
    for (int i = 0; i < N; ++i) {
      const long double scale = std::sqrt(static_cast<long double>(a(i, i)) * static_cast<long double>(a(j, j)));
      defect(i, j) = scale > 0 ? defect(i, j) / scale : defect(i, j);
    }
  }
  return defect;
}

template <int N>
bool is_lower(const Matrix<double, N>& l) {
  return l.template triangularView<Eigen::StrictlyUpper>().toDenseMatrix().isZero(0);
}

template <int N>
void check_cholesky() {
  Random random(31);
  for (const double condition : {1.0, 1e3, 1e8}) {
    for (int i = 0; i < 200; ++i) {
      // Rows and columns in units that differ by 1e8: Cholesky's method does not mind.
      Vector<double, N> units;
      for (int k = 0; k < N; ++k) {
        units(k) = random.log_uniform(1e-4, 1e4);
      }
      const Matrix<double, N> unscaled = random.positive_definite<N>(condition);
      Matrix<double, N> a;
      for (int k = 0; k < N; ++k) {
        for (int j = 0; j < N; ++j) {
          a(j, k) = units(j) * units(k) * unscaled(j, k);
        }
      }
      Matrix<double, N> l;
      REQUIRE(cholesky(a, l) == Status::ok);
      REQUIRE(is_lower<N>(l));
      REQUIRE(l.diagonal().minCoeff() > 0);
      REQUIRE(scaled_defect<N>(a, l).cwiseAbs().maxCoeff() <= N * epsilon);
      const Eigen::LLT<Matrix<double, N>> eigen(a);
      const Matrix<double, N> scaled_difference =
          units.cwiseInverse().asDiagonal() * (l - Matrix<double, N>(eigen.matrixL()));
      REQUIRE(scaled_difference.cwiseAbs().maxCoeff() <= 4 * N * epsilon * condition * std::sqrt(condition));

      const Matrix<double, N> root = lower_inverse(l);
      REQUIRE(is_lower<N>(root));
      const Matrix<double, N> unit = root * l;
      REQUIRE((unit - Matrix<double, N>::Identity()).cwiseAbs().maxCoeff() <=
              4 * N * epsilon * std::sqrt(condition) * 10);
      const LongMatrix exact_l = l.template cast<long double>();
      const LongMatrix exact_image = exact_l * a.template cast<long double>() * exact_l.transpose();
      const Matrix<double, N> image_error = congruence_of_lower(l, a) - exact_image.template cast<double>();
      // Entry (i, j) of |l| |a| |l|ᵀ is at most what the diagonals have, of N terms each.
      const Vector<double, N> widths = l.cwiseAbs() * Vector<double, N>(a.diagonal().cwiseSqrt());
      REQUIRE((image_error.array().abs() <= 2 * N * epsilon * (widths * widths.transpose()).array()).all());
      const Matrix<double, N, 2> b = units.asDiagonal() * random.normal_matrix<N, 2>();
      const Matrix<double, N, 2> x = solve_lower_transposed(l, solve_lower(l, b));
      const Matrix<double, N, 2> reference = eigen.solve(b);
      Matrix<double, N> inverse;
      REQUIRE(inverse_positive_definite(a, inverse) == Status::ok);
      REQUIRE(inverse == inverse.transpose());
      // In units of one, relative, and as far as the condition allows.
      const Matrix<double, N, 2> scaled_x = units.asDiagonal() * x;
      const Matrix<double, N, 2> scaled_reference = units.asDiagonal() * reference;
      const Matrix<double, N> scaled_inverse = units.asDiagonal() * inverse * units.asDiagonal();
      // The exact inverse is taken in units of one and not by cofactors, which lose even the digits of long double.
      const LongMatrix per_unit = units.template cast<long double>().cwiseInverse().asDiagonal();
      const LongMatrix scaled_a = per_unit * a.template cast<long double>() * per_unit;
      const Matrix<double, N> scaled_exact =
          Eigen::PartialPivLU<LongMatrix>(scaled_a).inverse().template cast<double>();
      const double tolerance = 4 * epsilon * condition;
      REQUIRE((scaled_x - scaled_reference).norm() <= tolerance * scaled_reference.norm());
      REQUIRE((scaled_inverse - scaled_exact).norm() <= tolerance * scaled_exact.norm());
    }
  }
}

// A random matrix of rank `rank` exactly in real arithmetic, rounded to doubles.
template <int N>
Matrix<double, N> of_rank(Random& random, int rank, double smallest) {
  Vector<double, N> values = Vector<double, N>::Zero();
  for (int i = 0; i < rank; ++i) {
    values(i) = random.log_uniform(smallest, 1);
  }
  return random.symmetric<N>(values);
}

template <int N>
void check_semidefinite() {
  Random random(32);
  for (int rank = 1; rank <= N; ++rank) {
    for (int i = 0; i < 300; ++i) {
      const Matrix<double, N> a = of_rank<N>(random, rank, 1e-3);
      Matrix<double, N> l;
      CAPTURE(rank);
      REQUIRE(cholesky_semidefinite(a, l) == Status::ok);
      REQUIRE(is_lower<N>(l));
      const LongMatrix defect = scaled_defect<N>(a, l);
      // Not more than the documented 2N(N+1)ε above a, and below it by no more than the rounding of products.
      REQUIRE(defect.diagonal().maxCoeff() <= 2 * (N + 1) * (N + 1) * epsilon);
      REQUIRE((defect + defect.transpose()).template selfadjointView<Eigen::Lower>().eigenvalues().minCoeff() / 2 >=
              -N * epsilon);
    }
  }
}

template <int N>
void check_eigen(const Matrix<double, N>& a, double tolerance) {
  SymmetricEigen<double, N> eigen;
  REQUIRE(symmetric_eigen(a, eigen) == Status::ok);
  const Eigen::SelfAdjointEigenSolver<LongMatrix> reference(a.template cast<long double>());
  const double size = a.cwiseAbs().maxCoeff();
  for (int i = 0; i < N; ++i) {
    REQUIRE(std::abs(eigen.values(i) - static_cast<double>(reference.eigenvalues()(N - 1 - i))) <= tolerance * size);
    REQUIRE((i == 0 || eigen.values(i) <= eigen.values(i - 1)));
  }
  const Matrix<double, N> gram = eigen.vectors.transpose() * eigen.vectors;
  REQUIRE((gram - Matrix<double, N>::Identity()).cwiseAbs().maxCoeff() <= tolerance);
  const Matrix<double, N> residual = a * eigen.vectors - eigen.vectors * eigen.values.asDiagonal();
  REQUIRE(residual.cwiseAbs().maxCoeff() <= tolerance * size);
}

template <int N>
void check_random_eigen() {
  Random random(33);
  for (int i = 0; i < 200; ++i) {
    check_eigen<N>(random.symmetric<N>(random.normal_matrix<N>()), 30 * N * epsilon);
    check_eigen<N>(random.positive_definite<N>(1e12), 30 * N * epsilon);
    Vector<double, N> twice = Vector<double, N>::Ones();  // one value of multiplicity N − 1
    twice(0) = random.uniform(-2, 2);
    check_eigen<N>(random.symmetric<N>(twice), 30 * N * epsilon);
  }
  check_eigen<N>(Matrix<double, N>::Zero(), 0);
  check_eigen<N>(Matrix<double, N>::Identity(), 0);
  check_eigen<N>(1e-300 * Matrix<double, N>::Ones(), 10 * N * epsilon);
  check_eigen<N>(1e300 * Matrix<double, N>::Ones(), 10 * N * epsilon);
}

// a = l diag(1/p) lᵀ with the lower triangle that is filled in here, a⁻¹ = rᵀr, and what solves a x = b.
template <int N>
void check_root_free() {
  Random random(33);
  for (int i = 0; i < 200; ++i) {
    const Matrix<double, N> a = random.positive_definite<N>(100);
    RootFreeFactor<double, N> factor;
    REQUIRE(factorize(a, factor) == Status::ok);
    Matrix<double, N> l = factor.l.template triangularView<Eigen::StrictlyLower>();
    l.diagonal().setOnes();
    const double rounding = 50 * N * epsilon * a.norm();
    REQUIRE((l * factor.p.cwiseInverse().asDiagonal() * l.transpose() - a).norm() <= rounding);
    const Matrix<double, N> root = inverse_root(factor);
    REQUIRE(is_lower(root));
    REQUIRE((root.transpose() * root * a - Matrix<double, N>::Identity()).norm() <= 1e4 * N * epsilon);
    const Vector<double, N> b = random.normal_matrix<N>();
    REQUIRE((a * solve(factor, b) - b).norm() <= 1e4 * N * epsilon * b.norm());
  }
}

// The three factors are what they are said to be, to rounding in units of the largest singular value.
void check_svd(const Matrix3<double>& a) {
  RotationSvd<double> svd;
  REQUIRE(rotation_svd(a, svd) == Status::ok);
  const Eigen::JacobiSVD<Matrix3<double>> eigen(a, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vector3<double> s = eigen.singularValues();
  const double rounding = 20 * epsilon * s(0);
  for (const Matrix3<double>& q : {svd.u, svd.v}) {
    REQUIRE((q.transpose() * q - Matrix3<double>::Identity()).cwiseAbs().maxCoeff() <= 20 * epsilon);
    REQUIRE(q.determinant() > 0);
  }
  REQUIRE((svd.u * svd.values.asDiagonal() * svd.v.transpose() - a).cwiseAbs().maxCoeff() <= rounding);
  REQUIRE((svd.values.cwiseAbs() - s).cwiseAbs().maxCoeff() <= rounding);
  REQUIRE(svd.values(0) >= svd.values(1));
  REQUIRE(svd.values(1) >= 0);
  REQUIRE(svd.values(1) >= std::abs(svd.values(2)) - rounding);
  if (s(2) > 1e-10 * s(0)) {
    REQUIRE((svd.values(2) > 0) == ((eigen.matrixU() * eigen.matrixV().transpose()).determinant() > 0));
  }
}

}  // namespace

TEST_CASE("Cholesky factors and solves and inverses agree with Eigen in any units") {
  check_cholesky<1>();
  check_cholesky<2>();
  check_cholesky<3>();
  check_cholesky<6>();
}

TEST_CASE("cholesky refuses what is not positive definite and leaves its output alone") {
  Random random(34);
  const Matrix3<double> before = random.normal_matrix<3, 3>();
  Matrix3<double> out = before;
  CHECK(cholesky(Matrix3<double>(Matrix3<double>::Zero()), out) == Status::not_positive_definite);
  CHECK(cholesky(Matrix3<double>(Vector3<double>(1, 1, -1e-300).asDiagonal()), out) == Status::not_positive_definite);
  CHECK(cholesky(random.symmetric<3>(Vector3<double>(1, 2, -0.001)), out) == Status::not_positive_definite);
  for (int j = 0; j < 3; ++j) {
    for (int i = j; i < 3; ++i) {
      for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
        Matrix3<double> spoiled = random.positive_definite<3>(10);
        spoiled(i, j) = bad;
        CHECK(cholesky(spoiled, out) != Status::ok);
        CHECK(cholesky_semidefinite(spoiled, out) != Status::ok);
        CHECK(inverse_positive_definite(spoiled, out) != Status::ok);
      }
    }
  }
  CHECK(out == before);
}

TEST_CASE("factors without roots and what they solve and invert agree with Eigen") {
  check_root_free<2>();
  check_root_free<3>();
  check_root_free<6>();
}

TEST_CASE("a factor without roots refuses each pivot that is not positive") {
  for (int k = 0; k < 6; ++k) {
    for (const double pivot : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
      Matrix6<double> a = Matrix6<double>::Identity();
      a(k, k) = pivot;
      RootFreeFactor<double, 6> factor;
      CHECK(factorize(a, factor) == Status::not_positive_definite);
    }
  }
}

TEST_CASE("a matrix is finite if each of its numbers is") {
  Matrix6<double> a = Matrix6<double>::Ones();
  CHECK(scalar::all_finite(a));
  CHECK(scalar::all_finite(a.topRows<2>()));
  for (int k = 0; k < 36; ++k) {
    for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
      a(k % 6, k / 6) = bad;
      CHECK_FALSE(scalar::all_finite(a));
      CHECK_FALSE(scalar::all_finite(a.transpose()));
      a(k % 6, k / 6) = 1;
    }
  }
}

TEST_CASE("cholesky_semidefinite factors matrices of any rank and never falls below them") {
  check_semidefinite<2>();
  check_semidefinite<3>();
  check_semidefinite<6>();
}

TEST_CASE("cholesky_semidefinite takes a plane in any position however near to the axes") {
  Random random(30);
  for (int i = 0; i < 2000; ++i) {
    const Vector3<double> tilt = random.log_uniform(1e-20, 1) * random.unit_vector<3>();
    const Vector3<double> normal = (Vector3<double>::Unit(i % 3) + tilt).normalized();
    Matrix3<double> a = 4 * (Matrix3<double>::Identity() - normal * normal.transpose());
    a = (0.5 * (a + a.transpose())).eval();
    a.diagonal() = a.diagonal().cwiseMax(0).eval();  // 1 − n² may come out below zero, which is refused
    Matrix3<double> l;
    CAPTURE(a);
    REQUIRE(cholesky_semidefinite(a, l) == Status::ok);
    // Within 4N(N+1)ε of the largest entry above a, two more for rounding, and not below it.
    const LongMatrix exact = l.cast<long double>();
    const LongMatrix defect = exact * exact.transpose() - a.cast<long double>();
    REQUIRE(defect.cwiseAbs().maxCoeff() <= 4 * 50 * epsilon);
    REQUIRE(defect.selfadjointView<Eigen::Lower>().eigenvalues().minCoeff() >= -4 * 3 * epsilon);
  }
}

TEST_CASE("cholesky_semidefinite gives a column of zeros for a coordinate without width") {
  Random random(35);
  for (int flat = 0; flat < 3; ++flat) {
    Matrix3<double> a = random.positive_definite<3>(100);
    a.row(flat).setZero();
    a.col(flat).setZero();
    Matrix3<double> l;
    REQUIRE(cholesky_semidefinite(a, l) == Status::ok);
    CHECK(l.col(flat) == Vector3<double>::Zero());
    CHECK(l.row(flat).transpose() == Vector3<double>::Zero());
    CHECK((l * l.transpose() - a).cwiseAbs().maxCoeff() <= 4 * epsilon * a.cwiseAbs().maxCoeff());
  }
  Matrix3<double> l;
  REQUIRE(cholesky_semidefinite(Matrix3<double>(Matrix3<double>::Zero()), l) == Status::ok);
  CHECK(l == Matrix3<double>::Zero());
}

TEST_CASE("cholesky_semidefinite refuses a matrix that is negative by more than rounding") {
  Random random(36);
  const Matrix3<double> before = random.normal_matrix<3, 3>();
  Matrix3<double> out = before;
  Matrix3<double> off_diagonal = Matrix3<double>::Zero();  // indefinite, with a zero on the diagonal
  off_diagonal(0, 0) = 1;
  off_diagonal(1, 0) = off_diagonal(0, 1) = 1e-6;  // with an eigenvalue of −1e-12
  CHECK(cholesky_semidefinite(off_diagonal, out) == Status::not_positive_definite);
  off_diagonal(0, 0) = 0;
  CHECK(cholesky_semidefinite(off_diagonal, out) == Status::not_positive_definite);
  CHECK(cholesky_semidefinite(Matrix3<double>(Vector3<double>(1, -1e-300, 1).asDiagonal()), out) ==
        Status::not_positive_definite);
  for (int i = 0; i < 100; ++i) {
    CHECK(cholesky_semidefinite(random.symmetric<3>(Vector3<double>(1, 0.5, -1e-10)), out) ==
          Status::not_positive_definite);
  }
  CHECK(out == before);
}

TEST_CASE("is_symmetric takes rounding and refuses more and refuses NaN") {
  Random random(37);
  const Matrix3<double> a = random.positive_definite<3>(10);
  CHECK(is_symmetric(a));
  Matrix3<double> b = a;
  b(0, 1) += 1e-12;
  CHECK(is_symmetric(b));
  b(0, 1) += 1e-6;
  CHECK_FALSE(is_symmetric(b));
  b(0, 1) = std::nan("");
  CHECK_FALSE(is_symmetric(b));
}

TEST_CASE("symmetric_eigen agrees with Eigen also for multiple eigenvalues and extreme scales") {
  check_random_eigen<2>();
  check_random_eigen<3>();
  check_random_eigen<4>();
  check_random_eigen<6>();
}

TEST_CASE("symmetric_eigen gives small eigenvalues of graded matrices with nearly full digits") {
  Random random(38);
  for (int i = 0; i < 200; ++i) {
    const Vector3<double> grade(1, 1e-6, 1e-12);
    const Matrix3<double> core = random.positive_definite<3>(10);
    const Matrix3<double> a = grade.asDiagonal() * core * grade.asDiagonal();
    SymmetricEigen<double, 3> eigen;
    REQUIRE(symmetric_eigen(a, eigen) == Status::ok);
    // The exact answer of so steep a matrix to 1e-12 relative: λ₁ = a₁₁, then the eigenvalues of the Schur complements.
    LongMatrix schur = a.cast<long double>();
    for (int k = 0; k < 3; ++k) {
      REQUIRE(std::abs(static_cast<double>(static_cast<long double>(eigen.values(k)) / schur(k, k)) - 1) <= 1e-10);
      schur -= (schur.col(k) * schur.row(k) / schur(k, k)).eval();
    }
  }
}

TEST_CASE("symmetric_eigen refuses NaN and infinity and leaves its output alone") {
  SymmetricEigen<double, 3> out{Vector3<double>(1, 2, 3), Matrix3<double>::Identity()};
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    Matrix3<double> a = Matrix3<double>::Identity();
    a(1, 2) = bad;
    CHECK(symmetric_eigen(a, out) == Status::not_finite);
  }
  CHECK(out.values == Vector3<double>(1, 2, 3));
  CHECK(out.vectors == Matrix3<double>::Identity());
}

TEST_CASE("rotation_svd agrees with Eigen for either sign of the determinant and any rank") {
  Random random(39);
  for (int i = 0; i < 500; ++i) {
    check_svd(random.normal_matrix<3, 3>());
    check_svd(-random.rotation());
    check_svd(random.rotation());
    check_svd(random.log_uniform(1e-300, 1e300) * random.normal_matrix<3, 3>());
    const Matrix3<double> u = random.rotation();
    const Matrix3<double> v = random.rotation();
    check_svd(u * Vector3<double>(1, random.log_uniform(1e-16, 1), random.uniform(-1, 1) * 1e-17).asDiagonal() * v);
    check_svd(u * Vector3<double>(1, 1, -1e-9).asDiagonal() * v);
    check_svd(u.leftCols<2>() * v.topRows<2>());
    check_svd(u.leftCols<1>() * v.topRows<1>());
  }
  check_svd(Vector3<double>(1, 0, 0).asDiagonal());
  check_svd(Vector3<double>(0, 0, -1).asDiagonal());
  check_svd(Vector3<double>(0, 2, 1).asDiagonal());
  check_svd(Matrix3<double>::Ones());
}

TEST_CASE("rotation_svd converges where rounding keeps nearly equal columns from being orthogonal to the last bit") {
  Matrix3<double> a;
  a << 0.59263603819883792, 0.43705305050473409, 0.6765849224395204,    //
      -0.52680384970296079, -0.60341481567228061, 0.59863867580146202,  //
      0.61073865826909424, -0.70378788730322928, -0.36287863119908775;
  RotationSvd<double> svd;
  REQUIRE(rotation_svd(a, svd) == Status::ok);
  CHECK((svd.u * svd.values.asDiagonal() * svd.v.transpose() - a).norm() <= 4e-15);
  Random random(18);
  for (int trial = 0; trial < 100000; ++trial) {
    a = random.rotation() + random.log_uniform(1e-16, 0.3) * random.normal_matrix<3, 3>();
    REQUIRE(rotation_svd(a, svd) == Status::ok);
    REQUIRE((svd.u * svd.values.asDiagonal() * svd.v.transpose() - a).norm() <= 1e-14);
  }
}

TEST_CASE("rotation_svd keeps U a rotation when the second singular value all but vanishes") {
  for (const double tiny : {1e-16, 1e-30, 3e-31, 1e-31, 6e-32, 1e-32, 1e-100, 1e-300}) {
    Matrix3<double> a = Matrix3<double>::Zero();
    a(0, 0) = 1;
    a(0, 1) = 0.4 * tiny;
    a(1, 1) = tiny;
    CAPTURE(tiny);
    check_svd(a);
    check_svd(a.transpose());
  }
}

TEST_CASE("rotation_svd refuses zero and what is not finite and leaves its output alone") {
  RotationSvd<double> out{Matrix3<double>::Identity(), Vector3<double>(1, 2, 3), Matrix3<double>::Identity()};
  CHECK(rotation_svd(Matrix3<double>(Matrix3<double>::Zero()), out) == Status::out_of_range);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    Matrix3<double> a = Matrix3<double>::Identity();
    a(2, 0) = bad;
    CHECK(rotation_svd(a, out) == Status::not_finite);
  }
  CHECK(out.values == Vector3<double>(1, 2, 3));
}

TEST_CASE("the norm of a matrix so small that its square is denormal is finite") {
  CHECK(spectral_norm(Matrix3<float>(2e-20F * Matrix3<float>::Identity())) >= 1.9e-20F);
  CHECK(spectral_norm(Matrix3<float>(2e-20F * Matrix3<float>::Identity())) < 1e-19F);
  Matrix6<double> gram = Matrix6<double>::Zero();
  gram(0, 0) = 1e-309;
  CHECK(norm_of_gram(gram) == doctest::Approx(3.16e-155).epsilon(0.01));
}

TEST_CASE("products by columns agree with Eigen's, of transposes and of single columns too") {
  Random random(13);
  const Matrix<double, 6, 3> a = random.normal_matrix<6, 3>();
  const Matrix3<double> b = random.normal_matrix<3, 3>();
  const Vector3<double> c = random.normal_matrix<3, 1>();
  CHECK((product_by_columns(a, b) - a * b).norm() <= 4 * epsilon * a.norm() * b.norm());
  CHECK((product_by_columns(a, b.transpose()) - a * b.transpose()).norm() <= 4 * epsilon * a.norm() * b.norm());
  CHECK((product_by_columns(a, c) - a * c).norm() <= 4 * epsilon * a.norm() * c.norm());
  CHECK((congruence(a, b) - a * b * a.transpose()).norm() <= 8 * epsilon * a.squaredNorm() * b.norm());
  const Eigen::MatrixXd any_a = a;  // sizes that are known at run time alone, as from Python
  const Eigen::MatrixXd any_b = b;
  CHECK((congruence(any_a, any_b) - congruence(a, b)).norm() <= 8 * epsilon * a.squaredNorm() * b.norm());
}

namespace {

/// Each entry added up by itself, in the order of its terms.
template <typename A, typename B>
Matrix<typename A::Scalar, A::RowsAtCompileTime, B::ColsAtCompileTime> product_by_entries(const A& a, const B& b) {
  Matrix<typename A::Scalar, A::RowsAtCompileTime, B::ColsAtCompileTime> product;
  for (int i = 0; i < a.rows(); ++i) {
    for (int j = 0; j < b.cols(); ++j) {
      product(i, j) = a(i, 0) * b(0, j);
      for (int k = 1; k < a.cols(); ++k) {
        product(i, j) += a(i, k) * b(k, j);
      }
    }
  }
  return product;
}

/// Small whole numbers, of which sums and products are exact, whatever is fused.
template <typename Scalar, int Rows, int Columns>
Matrix<Scalar, Rows, Columns> whole_numbers(Random& random) {
  return (10 * random.normal_matrix<Rows, Columns>()).array().round().matrix().template cast<Scalar>();
}

template <typename Scalar, int Rows, int N>
void check_products() {
  CAPTURE(Rows);
  Random random(Rows);
  const auto t = whole_numbers<Scalar, Rows, N>(random);
  const auto b = whole_numbers<Scalar, N, N>(random);
  const Matrix<Scalar, N> p = b + b.transpose();
  const Matrix<Scalar, Rows, N> product = product_by_entries(t, p);
  const Matrix<Scalar, Rows> image = product_by_entries(product, t.transpose());
  CHECK(product_by_columns(t, p) == product);
  CHECK(congruence(t, p) == image);
  CHECK(symmetric_congruence(t, p) == image);

  // What is not exact, too, is exactly symmetric.
  const Matrix<Scalar, Rows, N> any = random.normal_matrix<Rows, N>().template cast<Scalar>();
  const Matrix<Scalar, N> root = random.normal_matrix<N, N>().template cast<Scalar>();
  const Matrix<Scalar, N> shape = symmetrized(Matrix<Scalar, N>(root * root.transpose()));
  const Matrix<Scalar, Rows> seen = symmetric_congruence(any, shape);
  CHECK(seen == seen.transpose());
  CHECK((seen - congruence(any, shape)).norm() <= 16 * scalar::epsilon<Scalar> * any.squaredNorm() * shape.norm());
  const Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> sized_later = any;
  CHECK(symmetric_congruence(sized_later, shape) == seen.transpose());
}

}  // namespace

TEST_CASE("products in pieces of rows have every entry and congruences are exactly symmetric") {
  check_products<double, 8, 6>();
  check_products<double, 7, 6>();
  check_products<double, 6, 6>();
  check_products<double, 5, 6>();
  check_products<double, 3, 6>();
  check_products<double, 3, 3>();
  check_products<float, 7, 7>();
  check_products<float, 6, 6>();
}
