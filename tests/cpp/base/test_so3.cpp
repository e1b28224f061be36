// Rotations, against the power series of the matrix exponential in long double, against Eigen, and against derivatives
// taken by dual numbers.
#include <doctest/doctest.h>

#include <array>
#include <limits>
#include <vector>

#include "elliptude/base/so3.hpp"
#include "support/dual.hpp"
#include "support/pack.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Dual;
using elliptude::testing::Lanes;
using elliptude::testing::Random;

namespace {

constexpr double pi = 3.141592653589793;

using LongMatrix = Eigen::Matrix<long double, 3, 3>;
using LongVector = Eigen::Matrix<long double, 3, 1>;

// The angles of the issue, at which well-known libraries lose digits: 4e-10 … 7e-9 near 1e-8 … 1e-7, 2e-9 near π.
const std::vector<double> issue_angles{0, 1e-8, 1.5e-7, 1e-6, 1e-4, 1, pi - 1e-6, pi - 1e-8};

// The cross-product matrix, written out again: hat() is under test.
LongMatrix cross_matrix(const LongVector& v) {
  LongMatrix s = LongMatrix::Zero();
  s(0, 1) = -v(2);
  s(0, 2) = v(1);
  s(1, 0) = v(2);
  s(1, 2) = -v(0);
  s(2, 0) = -v(1);
  s(2, 1) = v(0);
  return s;
}

// Σ S(v)ᵏ sᵏ / (k + shift)!: the exponential (s = 1, shift = 0), the right Jacobian (s = −1, shift = 1). Up to a full turn no
// term exceeds 90 and 60 terms leave nothing, so that long double keeps more than 17 digits.
LongMatrix series(const LongVector& v, int sign, int shift) {
  LongMatrix term = LongMatrix::Identity();
  LongMatrix sum = term;
  for (int k = 1; k < 60; ++k) {
    term = (term * cross_matrix(v) * static_cast<long double>(sign) / static_cast<long double>(k + shift)).eval();
    sum += term;
  }
  return sum;
}
LongMatrix exact_exp(const LongVector& v) { return series(v, 1, 0); }
LongMatrix exact_right_jacobian(const LongVector& v) { return series(v, -1, 1); }
LongMatrix exact_right_jacobian_inverse(const LongVector& v) { return exact_right_jacobian(v).inverse(); }

template <typename Scalar>
double error(const Matrix3<Scalar>& x, const LongMatrix& exact) {
  return static_cast<double>((x.template cast<long double>() - exact).cwiseAbs().maxCoeff());
}

// The largest error of `function` over random axes at one angle.
template <typename Scalar, typename Function, typename Exact>
double worst_error(double angle, const Function& function, const Exact& exact) {
  Random random(11);
  double worst = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vector3<Scalar> zeta = (angle * random.unit_vector<3>()).template cast<Scalar>();
    worst = std::max(worst, error<Scalar>(function(zeta), exact(zeta.template cast<long double>())));
  }
  return worst;
}

template <typename Scalar>
void check_at_its_precision(double tolerance) {
  using V = Vector3<Scalar>;
  for (const double angle : issue_angles) {
    CAPTURE(angle);
    CHECK(worst_error<Scalar>(angle, [](const V& z) { return elliptude::exp(z); }, exact_exp) <= tolerance);
    CHECK(worst_error<Scalar>(angle, [](const V& z) { return right_jacobian(z); }, exact_right_jacobian) <= tolerance);
    CHECK(worst_error<Scalar>(
              angle, [](const V& z) { return right_jacobian_inverse(z); }, exact_right_jacobian_inverse) <= tolerance);
    CHECK(worst_error<Scalar>(
              angle, [](const V& z) { return left_jacobian(z); },
              [](const LongVector& z) { return exact_right_jacobian(-z); }) <= tolerance);
    CHECK(worst_error<Scalar>(
              angle, [](const V& z) { return left_jacobian_inverse(z); },
              [](const LongVector& z) { return exact_right_jacobian_inverse(-z); }) <= tolerance);
  }
}

}  // namespace

TEST_CASE("exp and the Jacobians and their inverses err by at most 1e-15 at every angle up to pi") {
  check_at_its_precision<double>(1e-15);
}

TEST_CASE("exp and the Jacobians in float err as little in units of its own rounding") {
  check_at_its_precision<float>(1e-15 * (1.19e-7 / 2.22e-16));  // the same number of units of rounding as in double
}

TEST_CASE("exp and the Jacobians lose no digits on either side of where the series ends") {
  for (const double angle : {0.5, 0.9, 0.999999999, 1.000000001, 1.1, 1.5, 2.0, 3.0}) {
    CAPTURE(angle);
    using V = Vector3<double>;
    CHECK(worst_error<double>(angle, [](const V& z) { return elliptude::exp(z); }, exact_exp) <= 1e-15);
    CHECK(worst_error<double>(angle, [](const V& z) { return right_jacobian(z); }, exact_right_jacobian) <= 1e-15);
    CHECK(worst_error<double>(
              angle, [](const V& z) { return right_jacobian_inverse(z); }, exact_right_jacobian_inverse) <= 1e-15);
  }
}

TEST_CASE("exp and the Jacobians hold beyond pi") {
  for (const double angle : {3.5, 4.5, 6.0}) {
    CAPTURE(angle);
    using V = Vector3<double>;
    // The inverse grows without bound towards a full turn, and its error with its square.
    const double growth = 0.5 * angle / std::sin(0.5 * angle);
    CHECK(worst_error<double>(angle, [](const V& z) { return elliptude::exp(z); }, exact_exp) <= 2e-15);
    CHECK(worst_error<double>(angle, [](const V& z) { return right_jacobian(z); }, exact_right_jacobian) <= 2e-15);
    CHECK(worst_error<double>(
              angle, [](const V& z) { return right_jacobian_inverse(z); }, exact_right_jacobian_inverse) <=
          1e-15 * growth * growth);
  }
}

TEST_CASE("log undoes exp up to pi") {
  Random random(12);
  std::vector<double> angles = issue_angles;
  for (int i = 0; i < 200; ++i) {
    angles.push_back(random.uniform(0, pi));
  }
  angles.push_back(0.0632);  // on both sides of where the arctangent's series ends
  angles.push_back(0.0633);
  for (const double angle : angles) {
    for (int i = 0; i < 20; ++i) {
      const Vector3<double> zeta = angle * random.unit_vector<3>();
      const Vector3<double> back = log(elliptude::exp(zeta));
      CAPTURE(angle);
      // One rounding of an entry of C moves ζ by ε; relative to ζ where that is small.
      REQUIRE((back - zeta).norm() <= 3e-15);
      const Vector3<float> zeta_float = zeta.cast<float>();
      const Vector3<float> back_float = log(elliptude::exp(zeta_float));
      if (angle < 3.1415) {  // in float an angle so near pi may come back from the other side
        REQUIRE((back_float - zeta_float).norm() <= 3e-15F * (1.19e-7F / 2.22e-16F));
      }
    }
  }
}

TEST_CASE("log keeps the digits of a small rotation") {
  Random random(13);
  for (const double angle : {1e-8, 1e-12, 1e-100}) {
    const Vector3<double> zeta = angle * random.unit_vector<3>();
    CHECK((log(elliptude::exp(zeta)) - zeta).norm() <= 1e-15 * angle);
  }
}

TEST_CASE("exp undoes log for any rotation and at half turns") {
  Random random(14);
  for (int i = 0; i < 2000; ++i) {
    const Matrix3<double> c = random.rotation();
    REQUIRE((elliptude::exp(log(c)) - c).cwiseAbs().maxCoeff() <= 2e-15);
  }
  for (int i = 0; i < 200; ++i) {
    const Vector3<double> n = i < 3 ? Vector3<double>(Vector3<double>::Unit(i)) : random.unit_vector<3>();
    const Matrix3<double> half_turn = 2 * n * n.transpose() - Matrix3<double>::Identity();
    const Vector3<double> zeta = log(half_turn);
    REQUIRE(std::abs(zeta.norm() - pi) <= 1e-15);
    REQUIRE(zeta.cross(n).norm() <= 2e-15);
    REQUIRE((elliptude::exp(zeta) - half_turn).cwiseAbs().maxCoeff() <= 2e-15);
  }
}

TEST_CASE("hat is the cross product and vee its inverse and the skew part of any matrix") {
  Random random(15);
  const Vector3<double> x = random.normal_matrix<3>();
  const Vector3<double> y = random.normal_matrix<3>();
  CHECK((hat(x) * y - x.cross(y)).norm() <= 1e-15);
  CHECK(vee(hat(x)) == x);
  const Matrix3<double> symmetric = random.symmetric<3>(Vector3<double>(1, 2, 3));
  CHECK((vee(hat(x) + symmetric) - x).norm() <= 1e-15);
}

TEST_CASE("cayley is the quotient of I + S and I - S and turns by twice the arctangent") {
  Random random(16);
  for (const double size : {0.0, 1e-9, 0.1, 1.0, 10.0, 1e4}) {
    for (int i = 0; i < 100; ++i) {
      const Vector3<double> n = random.unit_vector<3>();
      const Vector3<double> c = size * n;
      const LongMatrix s = cross_matrix(c.cast<long double>());
      const LongMatrix quotient = (LongMatrix::Identity() + s) * (LongMatrix::Identity() - s).inverse();
      const Matrix3<double> rotation = cayley(c);
      REQUIRE(error<double>(rotation, quotient) <= 2e-15);
      REQUIRE((rotation - elliptude::exp(2 * std::atan(size) * n)).cwiseAbs().maxCoeff() <= 3e-15);
      // c grows as 1/cos(θ/2): a rounding of C is multiplied by 1 + ‖c‖².
      REQUIRE((cayley_inverse(rotation) - c).norm() <= 1e-15 * (1 + size * size));
    }
  }
}

TEST_CASE("quaternions have the scalar first and agree with Eigen at any angle") {
  Random random(17);
  std::vector<double> angles = issue_angles;
  for (int i = 0; i < 200; ++i) {
    angles.push_back(random.uniform(0, pi));
  }
  for (const double angle : angles) {
    const Vector3<double> n = random.unit_vector<3>();
    const Matrix3<double> c = Eigen::AngleAxisd(angle, n).toRotationMatrix();
    const auto q = to_quaternion(c);
    CAPTURE(angle);
    REQUIRE(q.w >= 0);
    REQUIRE(std::abs(q.w - std::cos(angle / 2)) <= 1e-15);
    REQUIRE((q.vector - std::sin(angle / 2) * n).norm() <= 1e-15);
    REQUIRE((to_rotation(q) - c).cwiseAbs().maxCoeff() <= 1e-15);
    const Eigen::Quaterniond eigen(q.w, q.vector.x(), q.vector.y(), q.vector.z());
    REQUIRE((eigen.toRotationMatrix() - c).cwiseAbs().maxCoeff() <= 1e-15);
  }
  for (int i = 0; i < 3; ++i) {
    const Vector3<double> n = Vector3<double>::Unit(i);
    const auto q = to_quaternion(2 * n * n.transpose() - Matrix3<double>::Identity());
    CHECK(q.w == 0);
    CHECK(q.vector.cwiseAbs() == n);
  }
}

TEST_CASE("a quaternion and its negative and its multiples are the same rotation") {
  Random random(18);
  const Vector<double, 4> x = random.unit_vector<4>();
  const Matrix3<double> c = to_rotation(Quaternion<double>{x(0), x.tail<3>()});
  for (const double factor : {-1.0, 3.0, -0.01}) {
    const Matrix3<double> other = to_rotation(Quaternion<double>{factor * x(0), factor * x.tail<3>()});
    CHECK((other - c).cwiseAbs().maxCoeff() <= 1e-15);
  }
}

TEST_CASE("the derivatives of exp are the right and the left Jacobian") {
  Random random(19);
  for (const double angle : {0.0, 1e-8, 1e-4, 0.3, 0.99, 1.01, 2.0, pi - 1e-6, 5.0}) {
    const Vector3<double> zeta = angle * random.unit_vector<3>();
    const auto c = elliptude::exp(testing::variables<3>(zeta));
    const Matrix3<double> value = testing::values(c);
    for (int j = 0; j < 3; ++j) {
      const Matrix3<double> derivative = c.unaryExpr([j](const Dual<3>& entry) { return entry.gradient(j); });
      CAPTURE(angle);
      const Matrix3<double> on_the_right = value.transpose() * derivative;
      const Matrix3<double> on_the_left = derivative * value.transpose();
      CHECK((on_the_right - hat(right_jacobian(zeta).col(j))).cwiseAbs().maxCoeff() <= 4e-15);
      CHECK((on_the_left - hat(left_jacobian(zeta).col(j))).cwiseAbs().maxCoeff() <= 4e-15);
    }
  }
}

TEST_CASE("the derivatives of log are the inverse right and left Jacobians") {
  Random random(20);
  for (const double angle : {0.0, 1e-8, 1e-4, 0.05, 0.3, 1.0, 2.0, pi - 1e-6}) {
    const Vector3<double> zeta = angle * random.unit_vector<3>();
    const Matrix3<Dual<3>> c = elliptude::exp(zeta).cast<Dual<3>>();
    const Matrix3<Dual<3>> d = elliptude::exp(testing::variables<3>(Vector3<double>(Vector3<double>::Zero())));
    CAPTURE(angle);
    CHECK((testing::jacobian(log(c * d)) - right_jacobian_inverse(zeta)).cwiseAbs().maxCoeff() <= 1e-14);
    CHECK((testing::jacobian(log(d * c)) - left_jacobian_inverse(zeta)).cwiseAbs().maxCoeff() <= 1e-14);
  }
}

TEST_CASE("derivatives taken through the Jacobians are right at every angle") {
  Random random(21);
  const long double h = 1e-6L;  // truncation 1e-12, rounding 1e-13
  for (const double angle : {0.0, 1e-8, 1.5e-7, 1e-4, 0.9999999, 1.0000001, 2.0, pi - 1e-6}) {
    const Vector3<double> zeta = angle * random.unit_vector<3>();
    const auto jacobian = right_jacobian(testing::variables<3>(zeta));
    const auto inverse = right_jacobian_inverse(testing::variables<3>(zeta));
    for (int j = 0; j < 3; ++j) {
      const auto along_j = [j](const Dual<3>& entry) { return entry.gradient(j); };
      const LongVector up = zeta.cast<long double>() + h * LongVector::Unit(j);
      const LongVector down = zeta.cast<long double>() - h * LongVector::Unit(j);
      CAPTURE(angle);
      CHECK(error<double>(jacobian.unaryExpr(along_j),
                          (exact_right_jacobian(up) - exact_right_jacobian(down)) / (2 * h)) <= 1e-11);
      CHECK(error<double>(inverse.unaryExpr(along_j),
                          (exact_right_jacobian_inverse(up) - exact_right_jacobian_inverse(down)) / (2 * h)) <= 1e-11);
    }
  }
}

TEST_CASE("is_rotation takes rotations and refuses reflections and stretched and unfinished matrices") {
  Random random(22);
  const double tolerance = rotation_tolerance<double>();
  CHECK(tolerance == doctest::Approx(1.49e-8).epsilon(0.01));
  for (int i = 0; i < 100; ++i) {
    const Matrix3<double> c = random.rotation();
    REQUIRE(is_rotation(c, 4e-15));
    REQUIRE_FALSE(is_rotation(-c, tolerance));
    REQUIRE_FALSE(is_rotation((1 + tolerance) * c, tolerance));
    REQUIRE(is_rotation((1 + 0.4 * tolerance) * c, tolerance));
    for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
      Matrix3<double> spoiled = c;
      spoiled(i % 9) = bad;
      REQUIRE_FALSE(is_rotation(spoiled, tolerance));
    }
  }
  CHECK_FALSE(is_rotation(Matrix3<double>(Matrix3<double>::Zero()), 0.5));
}

TEST_CASE("project_to_rotation is the orthogonal polar factor") {
  Random random(23);
  int tried = 0;
  for (int i = 0; i < 3000; ++i) {
    const double noise = random.log_uniform(1e-12, 1);
    const double scale = random.log_uniform(1e-100, 1e100);
    const Matrix3<double> matrix = scale * (random.rotation() + noise * random.normal_matrix<3, 3>());
    const Eigen::JacobiSVD<Matrix3<double>> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Vector3<double> s = svd.singularValues() / svd.singularValues()(0);
    if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 || s(2) < 1e-3) {
      continue;
    }
    ++tried;
    Matrix3<double> rotation;
    REQUIRE(project_to_rotation(matrix, rotation) == Status::ok);
    const Matrix3<double> polar = svd.matrixU() * svd.matrixV().transpose();
    // The polar factor's condition is 2 / (σ₂ + σ₃).
    REQUIRE((rotation - polar).cwiseAbs().maxCoeff() <= 1e-14 / (s(1) + s(2)));
    REQUIRE(is_rotation(rotation, 4e-15));
  }
  CHECK(tried > 2000);
}

TEST_CASE("project_to_rotation refuses what has no nearest rotation and leaves its output alone") {
  Random random(24);
  const Matrix3<double> before = random.rotation();
  Matrix3<double> out = before;
  Matrix3<double> matrix = random.rotation();
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (int i = 0; i < 9; ++i) {
      Matrix3<double> spoiled = matrix;
      spoiled(i) = bad;
      CHECK(project_to_rotation(spoiled, out) == Status::not_finite);
    }
  }
  CHECK(project_to_rotation(Matrix3<double>(Matrix3<double>::Zero()), out) == Status::not_a_rotation);
  CHECK(project_to_rotation(Matrix3<double>(-matrix), out) == Status::not_a_rotation);
  const Vector3<double> n = random.unit_vector<3>();
  CHECK(project_to_rotation(Matrix3<double>(n * n.transpose()), out) == Status::not_a_rotation);
  matrix.col(2).setZero();
  CHECK(project_to_rotation(matrix, out) == Status::not_a_rotation);
  CHECK(out == before);
}

TEST_CASE("renormalized squares the distance from the rotations and keeps a rotation") {
  Random random(25);
  for (int i = 0; i < 200; ++i) {
    const Matrix3<double> c = random.rotation();
    for (const double noise : {1e-14, 1e-8, 1e-4}) {
      const Matrix3<double> worn = c + noise * random.normal_matrix<3, 3>();
      const Matrix3<double> once = renormalized(worn);
      REQUIRE(is_rotation(once, 100 * noise * noise + 2e-15));
      Matrix3<double> polar;
      REQUIRE(project_to_rotation(worn, polar) == Status::ok);
      REQUIRE((once - polar).cwiseAbs().maxCoeff() <= 100 * noise * noise + 2e-15);
    }
  }
}

TEST_CASE("the functions of a rotation take Eigen expressions") {
  Random random(26);
  const Vector6<double> x = random.normal_matrix<6>();
  const Vector3<double> v = x.tail<3>();
  const Matrix3<double> a = random.rotation();
  const Matrix3<double> b = random.rotation();
  const Matrix3<double> ab = a * b;
  CHECK(hat(x.tail<3>()) == hat(v));
  CHECK(vee(a - b) == vee(Matrix3<double>(a - b)));
  CHECK(elliptude::exp(-x.tail<3>()) == elliptude::exp(Vector3<double>(-v)));
  CHECK(right_jacobian(2 * v) == right_jacobian(Vector3<double>(2 * v)));
  CHECK(right_jacobian_inverse(2 * v) == right_jacobian_inverse(Vector3<double>(2 * v)));
  CHECK(left_jacobian(v + v) == left_jacobian(Vector3<double>(2 * v)));
  CHECK(left_jacobian_inverse(v + v) == left_jacobian_inverse(Vector3<double>(2 * v)));
  CHECK(cayley(x.tail<3>() / 2) == cayley(Vector3<double>(v / 2)));
  CHECK(log(a * b) == log(ab));
  CHECK(cayley_inverse(a * b) == cayley_inverse(ab));
  CHECK(to_quaternion(a * b).vector == to_quaternion(ab).vector);
  CHECK(is_rotation(a * b, 1e-14));
}

TEST_CASE("a pack of four does in each lane what one number does") {
  Random random(27);
  for (int i = 0; i < 50; ++i) {
    // Lanes on both sides of every threshold: zero, a series, the closed form, nearly a half turn.
    const std::array<double, 4> angles{0, random.log_uniform(1e-9, 1), random.uniform(1, 3), pi - 1e-7};
    std::array<Vector3<double>, 4> zeta;
    for (std::size_t lane = 0; lane < 4; ++lane) {
      zeta[(lane + static_cast<std::size_t>(i)) % 4] = angles[lane] * random.unit_vector<3>();
    }
    const Vector3<Lanes> packed = testing::pack(zeta);
    const Matrix3<Lanes> rotation = elliptude::exp(packed);
    const Vector3<Lanes> logarithm = log(rotation);
    const Vector3<Lanes> gibbs = cayley_inverse(rotation);
    const auto q = to_quaternion(rotation);
    for (std::size_t lane = 0; lane < 4; ++lane) {
      const Vector3<double>& z = zeta[lane];
      const Matrix3<double> c = elliptude::exp(z);
      // Equal but for a compiler that fuses multiplications and additions in one of the two.
      const auto same = [](const auto& x, const auto& y) { return (x - y).norm() <= 1e-15 * (1 + y.norm()); };
      REQUIRE(same(testing::lane_of(rotation, lane), c));
      REQUIRE(same(testing::lane_of(right_jacobian(packed), lane), right_jacobian(z)));
      REQUIRE(same(testing::lane_of(right_jacobian_inverse(packed), lane), right_jacobian_inverse(z)));
      REQUIRE(same(testing::lane_of(left_jacobian(packed), lane), left_jacobian(z)));
      REQUIRE(same(testing::lane_of(left_jacobian_inverse(packed), lane), left_jacobian_inverse(z)));
      REQUIRE(same(testing::lane_of(logarithm, lane), log(c)));
      // Near a half turn c = tan(θ/2) n multiplies a rounding of the rotation by 1 + ‖c‖².
      const Vector3<double> c_gibbs = cayley_inverse(c);
      REQUIRE((testing::lane_of(gibbs, lane) - c_gibbs).norm() <= 1e-15 * (1 + c_gibbs.squaredNorm()));
      REQUIRE(same(testing::lane_of(cayley(packed), lane), cayley(z)));
      REQUIRE(same(testing::lane_of(q.vector, lane), to_quaternion(c).vector));
      REQUIRE(std::abs(q.w.lanes[lane] - to_quaternion(c).w) <= 1e-15);
      REQUIRE(same(testing::lane_of(to_rotation(q), lane), to_rotation(to_quaternion(c))));
      REQUIRE(same(testing::lane_of(renormalized(rotation), lane), renormalized(c)));
    }
    REQUIRE(is_rotation(rotation, Lanes(1e-14)));
  }
}

TEST_CASE("a pack is a rotation only if each lane is and finite only if each lane is") {
  Random random(28);
  std::array<Matrix3<double>, 4> lanes{random.rotation(), random.rotation(), random.rotation(), random.rotation()};
  CHECK(is_rotation(testing::pack(lanes), Lanes(1e-14)));
  for (std::size_t lane = 0; lane < 4; ++lane) {
    auto spoiled = lanes;
    spoiled[lane] *= -1;
    CHECK_FALSE(is_rotation(testing::pack(spoiled), Lanes(1e-14)));
    spoiled[lane](1, 2) = std::nan("");
    CHECK_FALSE(is_rotation(testing::pack(spoiled), Lanes(1e-14)));
    CHECK_FALSE(scalar::all_finite(testing::pack(spoiled)));
  }
}
