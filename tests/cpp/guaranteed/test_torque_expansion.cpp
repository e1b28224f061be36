// The torque's series in time, its expansion in the Gibbs chart, and its bounds, against the torque itself in long double.
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr int terms = 9;
using Series = std::array<Vector3d, terms>;

/// s at the end of ω(t) = Σ ω_k tᵏ from C₀, by the independent integrator's rule: a body of unit inertia, driven so that its rate
/// is ω, has that attitude. Its torque is ω' (the gyroscopic part vanishes).
RealMatrix attitude_after(const Matrix3d& start, const Series& rate, Real t) {
  const RealTorque drive = [&](const RealMatrix&, Real s) {
    RealVector sum = RealVector::Zero();
    for (int k = terms - 1; k >= 1; --k) {
      sum = s * sum + k * rate[static_cast<std::size_t>(k)].cast<Real>();
    }
    return sum;
  };
  return independent_flow(RealMatrix::Identity(), drive, {start.cast<Real>(), rate[0].cast<Real>()}, 0, t, 4).attitude;
}

template <typename Scalar, std::size_t Count>
RealVector sum_of(const std::array<Vector3<Scalar>, Count>& series, Real t) {
  RealVector sum = RealVector::Zero();
  for (std::size_t k = Count; k-- > 0;) {
    sum = t * sum + series[k].template cast<Real>();
  }
  return sum;
}

struct Field {
  RigidBody<double> body;
  Vector3d arm;
  UniformGravity<double> gravity;
  GravityGradient<double> gradient;
  double rate;
  Vector3d turn;       ///< of the direction of the potentials of one's own, rad/s
  Vector3d direction;  ///< and it, at time 0
  LinearPotential<double> linear;
  QuadraticPotential<double> quadratic;

  /// The direction at a time, by Rodrigues' formula.
  [[nodiscard]] RealVector direction_at(Real t) const {
    const RealVector r = direction.cast<Real>().normalized();
    const RealVector n = turn.cast<Real>().normalized();
    const Real angle = static_cast<Real>(rate) * t;
    return std::cos(angle) * r + std::sin(angle) * n.cross(r);
  }
};

Field random_field(Random& random) {
  Field field;
  field.body = random_body(random);
  field.arm = random.normal_matrix<3>();
  field.rate = random.uniform(0.3, 1);
  REQUIRE(UniformGravity<double>::make(1, 1, field.arm, field.gravity) == Status::ok);
  REQUIRE(GravityGradient<double>::make(field.body, field.rate, Matrix3d::Identity(), field.gradient) == Status::ok);
  field.direction = random.normal_matrix<3>();
  field.turn = field.rate * field.direction.cross(random.unit_vector<3>()).normalized();
  TurningDirection<double> direction;
  REQUIRE(TurningDirection<double>::make(field.direction, field.turn, direction) == Status::ok);
  REQUIRE(LinearPotential<double>::make(field.arm, direction, field.linear) == Status::ok);
  REQUIRE(QuadraticPotential<double>::make(field.body.inertia() - Matrix3d::Identity(), direction, field.quadratic) ==
          Status::ok);
  return field;
}

RealMatrix turned(const RealMatrix& attitude, const RealVector& gamma) {
  RealVector6 y = RealVector6::Zero();
  y.head<3>() = gamma;
  return attitude * gibbs_motion({Matrix3d::Identity(), Vector3d::Zero()}, y).attitude;
}

/// What is asked of one potential: `torque` is the same one, independently.
template <typename Potential>
void check_expansion(const Potential& potential, const RealTorque& torque, Random& random, double& third_sharpness,
                     double& fourth_sharpness) {
  const Matrix3d start = random.rotation();
  const double time = random.uniform(0, 50);
  Series rate;
  for (int k = 0; k < terms; ++k) {
    rate[static_cast<std::size_t>(k)] = random.normal_matrix<3>() / (k + 1);
  }
  TorqueExpansion<Potential, double, terms> expansion(potential);
  Series series;
  series[0] = expansion.start(start, time);
  for (int k = 1; k < terms; ++k) {
    series[static_cast<std::size_t>(k)] = expansion.extend(k, rate);
  }
  // The series' rest is of ninth order: halving the time must leave 1/512 of it.
  const auto torque_at = [&](Real t) { return torque(attitude_after(start, rate, t), static_cast<Real>(time) + t); };
  const auto rest = [&](Real t) { return (torque_at(t) - sum_of(series, t)).norm(); };
  const Real coarse = rest(0.04L);
  CHECK(coarse < 1e-6L * (1 + torque_at(0).norm()));
  CHECK(rest(0.02L) < coarse / 300 + 1e-14L * (1 + torque_at(0).norm()));

  const Matrix3d transform = random.normal_matrix<3, 3>();
  const TorqueBounds<double> bounds = expansion.bounds(transform);
  const RealMatrix n = transform.cast<Real>();
  const Real s = 0.02L;
  const RealMatrix attitude = attitude_after(start, rate, s);
  const auto at = [&](const RealVector& gamma) {
    return RealVector(n * torque(turned(attitude, gamma), static_cast<Real>(time) + s));
  };
  CHECK(static_cast<double>(at(RealVector::Zero()).norm()) <= bounds.largest);
  const auto width = [&](const Vector3d& along) { return std::sqrt(along.dot(bounds.shape * along)); };
  std::array<Matrix3d, 3> forms{Matrix3d::Zero(), Matrix3d::Zero(), Matrix3d::Zero()};
  expansion.add_curvature(0.02, transform, forms);
  Matrix3d jacobian = Matrix3d::Zero();
  for (int k = terms - 1; k >= 0; --k) {
    jacobian = 0.02 * jacobian + expansion.jacobian(k);
  }
  for (int trial = 0; trial < 20; ++trial) {
    const Vector3d direction = random.unit_vector<3>();
    const auto even = [&](Real size) {
      return RealVector((at(direction.cast<Real>() * size) + at(-direction.cast<Real>() * size)) / 2 -
                        at(RealVector::Zero()));
    };
    const auto odd = [&](Real size) {
      return RealVector((at(direction.cast<Real>() * size) - at(-direction.cast<Real>() * size)) / 2);
    };
    // Richardson in the square of the size: errors of sixth, and of fifth and seventh, order.
    const Real e = 1e-3L;
    const RealVector second = (4 * even(e) / (e * e) - even(2 * e) / (4 * e * e)) / 3;
    const RealVector first = (4 * odd(e) / e - odd(2 * e) / (2 * e)) / 3;
    const RealVector cubic = (odd(2 * e) / (2 * e) - odd(e) / e) / (3 * e * e);
    for (int i = 0; i < 3; ++i) {
      CHECK(direction.dot(forms[static_cast<std::size_t>(i)] * direction) ==
            doctest::Approx(static_cast<double>(second(i))).epsilon(1e-9).scale(bounds.largest));
    }
    CHECK((transform * jacobian * direction - first.cast<double>()).norm() <= 1e-9 * bounds.largest);
    // The cubic forms: on axes, at their vector.
    const Matrix3d axes = random.normal_matrix<3, 3>();
    const Vector3d v = axes.inverse() * direction;
    expansion::CubicForms<double> cubic_forms = expansion::CubicForms<double>::Zero();
    expansion.add_cubic(0.02, transform, axes, cubic_forms);
    Eigen::Matrix<double, 10, 1> packed;
    for (int i = 0; i < 3; ++i) {
      packed(i) = v(i) * v(i) * v(i);
      packed(3 + 2 * i) = std::sqrt(3.0) * v(i) * v(i) * v((i + 1) % 3);
      packed(4 + 2 * i) = std::sqrt(3.0) * v(i) * v(i) * v((i + 2) % 3);
    }
    packed(9) = std::sqrt(6.0) * v(0) * v(1) * v(2);
    CHECK(packed.norm() == doctest::Approx(std::pow(v.norm(), 3)));
    CHECK((cubic_forms.transpose() * packed - cubic.cast<double>()).norm() <=
          1e-4 * (bounds.largest + cubic_forms.norm() * packed.norm() * 1e-6));
    // The bounds of the parts, at any size.
    const double square = bounds.degree * bounds.degree;
    CHECK(static_cast<double>(second.norm()) <= 0.5 * square * bounds.largest * (1 + 1e-12));
    const Vector3d along = random.unit_vector<3>();
    CHECK(std::abs(static_cast<double>(along.cast<Real>().dot(at(RealVector::Zero())))) <= width(along));
    CHECK(width(along) <= bounds.largest * (1 + 1e-12));
    third_sharpness = std::fmax(third_sharpness, static_cast<double>(cubic.norm()) / (0.375 * square * bounds.largest));
    const Real g = static_cast<Real>(random.log_uniform(0.02, 5));
    const RealVector left =
        at(direction.cast<Real>() * g) - at(RealVector::Zero()) - first * g - second * (g * g) - cubic * (g * g * g);
    const double bound = 0.125 * square * bounds.degree * bounds.largest * static_cast<double>(g * g * g * g) *
                         (1 + 0.625 * static_cast<double>(g));
    fourth_sharpness = std::fmax(fourth_sharpness, static_cast<double>(left.norm()) / bound);
    CHECK(std::abs(static_cast<double>(along.cast<Real>().dot(left))) <= bound / bounds.largest * width(along));
  }
}

}  // namespace

TEST_CASE("series, expansion and bounds of each potential's torque") {
  Random random(20260402);
  std::array<double, 5> third{};
  std::array<double, 5> fourth{};
  for (int trial = 0; trial < 150; ++trial) {
    const Field field = random_field(random);
    const RealMatrix inertia = field.body.inertia().cast<Real>();
    const auto gravity = [&](const RealMatrix& a, Real) { return pendulum_torque(field.arm, a); };
    const auto gradient = [&](const RealMatrix& a, Real t) { return gradient_torque(inertia, Real(field.rate), a, t); };
    check_expansion(field.gravity, gravity, random, third[0], fourth[0]);
    check_expansion(field.gradient, gradient, random, third[1], fourth[1]);
    check_expansion(
        SumPotential<UniformGravity<double>, GravityGradient<double>>(field.gravity, field.gradient),
        [&](const RealMatrix& a, Real t) { return RealVector(gravity(a, t) + gradient(a, t)); }, random, third[2],
        fourth[2]);
    check_expansion(
        field.linear,
        [&](const RealMatrix& a, Real t) {
          return RealVector(field.arm.cast<Real>()).cross(RealVector(a.transpose() * field.direction_at(t)));
        },
        random, third[3], fourth[3]);
    check_expansion(
        field.quadratic,
        [&](const RealMatrix& a, Real t) {
          const RealVector b = a.transpose() * field.direction_at(t);
          return b.cross(RealVector(inertia * b));  // the identity does nothing
        },
        random, third[4], fourth[4]);
  }
  for (std::size_t i = 0; i < third.size(); ++i) {
    MESSAGE("potential " << i << ": third order " << third[i] << ", rest " << fourth[i] << " of its bound");
    CHECK(third[i] <= 1);
    CHECK(fourth[i] <= 1);
    CHECK(third[i] > 0.2);
    CHECK(fourth[i] > 0.2);
  }
}

TEST_CASE("the constants of third and fourth order hold for any trigonometric polynomial of degree one or two") {
  // f = a + b cos θ + c sin θ + d cos 2θ + e sin 2θ, its length by a fine grid.
  Random random(1);
  double third = 0;
  double rest = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const bool second_degree = trial % 2 == 0;
    const double degree = second_degree ? 2 : 1;
    Eigen::Matrix<double, 5, 1> k = random.normal_matrix<5>();
    if (trial % 10 < 4) {
      k.head<3>() *= random.log_uniform(1e-4, 1);
    }
    if (!second_degree) {
      k.tail<2>().setZero();
    }
    const auto f = [&](double t) {
      return k(0) + k(1) * std::cos(t) + k(2) * std::sin(t) + k(3) * std::cos(2 * t) + k(4) * std::sin(2 * t);
    };
    double largest = 0;
    for (int i = 0; i < 720; ++i) {
      largest = std::fmax(largest, std::fabs(f(i * 3.14159265358979 / 360)));
    }
    largest *= 1 + 1e-4;  // between the points of the grid
    const double first = k(2) + 2 * k(4);
    const double second = -(k(1) + 4 * k(3)) / 2;
    const double cubic = -(k(2) + 8 * k(4)) / 6 - first / 12;
    third = std::fmax(third, std::fabs(cubic) / (0.375 * degree * degree * largest));
    for (const double g : {-0.3, 0.1, 0.7, 2.0, -5.0, 30.0}) {
      const double left = f(2 * std::atan(g / 2)) - f(0) - g * (first + g * (second + g * cubic));
      const double size = std::fabs(g);
      rest = std::fmax(
          rest, std::fabs(left) / (std::pow(degree, 3) / 8 * std::pow(size, 4) * (1 + 0.625 * size) * largest + 1e-13));
    }
  }
  MESSAGE("third order " << third << ", rest " << rest << " of the bound");
  CHECK(third <= 1);
  CHECK(rest <= 1);
  CHECK(third > 0.8);
  CHECK(rest > 0.5);
}
