// The tube of errors: its linear and second-order parts against differences of the exact flow, and what it refuses.
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

struct Case {
  RigidBody<double> body;
  UniformGravity<double> gravity;
  Vector3d arm;
  RigidBodyState<double> state;
};

Case random_case(Random& random) {
  Case c;
  c.body = random_body(random);
  c.arm = c.body.principal_moments()(2) * random.normal_matrix<3>();
  REQUIRE(UniformGravity<double>::make(1, 1, c.arm, c.gravity) == Status::ok);
  c.state = {random.rotation(), random.normal_matrix<3>()};
  return c;
}

RealVector6 moved(const Case& c, const RigidBodyState<double>& end, const RealVector6& y, double h) {
  const RealTorque torque = [&](const RealMatrix& a, Real) { return pendulum_torque(c.arm, a); };
  return gibbs_error(end,
                     independent_flow(c.body.inertia().cast<Real>(), torque, gibbs_motion(c.state, y), 0, Real(h), 4));
}

using Tube = ErrorTube<double, UniformGravity<double>>;
using Series = MotionSeries<double, UniformGravity<double>>;

}  // namespace

TEST_CASE("a tube that has not moved is its set, none smaller") {
  Random random(1);
  for (const double condition : {1.0, 1e3, 1e6}) {
    const Matrix6<double> shape = random.positive_definite<6>(condition);
    Tube tube;
    REQUIRE(tube.start(shape, 0, 0) == Status::ok);
    const Matrix6<double> difference = tube.shape() - shape;
    CHECK(Eigen::SelfAdjointEigenSolver<Matrix6<double>>(difference).eigenvalues().minCoeff() > 0);
    CHECK(difference.norm() < 1e-12 * shape.norm());
    CHECK(tube.displacement() == 0);
  }
}

TEST_CASE("a small set is carried by the linear part of the exact flow") {
  Random random(2);
  double worst = 0;
  for (int trial = 0; trial < 30; ++trial) {
    const Case c = random_case(random);
    const double h = random.log_uniform(0.005, 0.03);
    const Matrix6<double> shape = 1e-10 * random.positive_definite<6>(100);
    Tube tube;
    REQUIRE(tube.start(shape, 0, 0) == Status::ok);
    Series series(c.body, c.gravity);
    REQUIRE(series.expand(c.body, 0, h, {}, c.state) == Status::ok);
    REQUIRE(tube.step(c.body, series, {}) == Status::ok);
    RealMatrix6 linear;
    const Real e = 1e-4L;
    for (int i = 0; i < 6; ++i) {
      const RealVector6 step = e * RealVector6::Unit(i);
      linear.col(i) = (8 * (moved(c, series.end, step, h) - moved(c, series.end, -step, h)) -
                       (moved(c, series.end, 2 * step, h) - moved(c, series.end, -2 * step, h))) /
                      (12 * e);
    }
    const RealMatrix6 image = linear * shape.cast<Real>() * linear.transpose();
    const RealMatrix6 root = RealMatrix6(image).llt().matrixL();
    const RealMatrix6 ratio = root.inverse() * tube.shape().cast<Real>() * root.inverse().transpose();
    const Eigen::Matrix<Real, 6, 1> values = Eigen::SelfAdjointEigenSolver<RealMatrix6>(ratio).eigenvalues();
    CHECK(values.minCoeff() >= 1 - 1e-12L);
    worst = std::fmax(worst, static_cast<double>(values.maxCoeff() - 1));
  }
  MESSAGE("largest excess of the shape " << worst);
  CHECK(worst < 1e-4);
}

TEST_CASE("the displacement is that of the exact flow's second order, and little more") {
  Random random(3);
  double least = 1e9;
  double most = 0;
  for (int trial = 0; trial < 20; ++trial) {
    const Case c = random_case(random);
    const double h = random.log_uniform(0.01, 0.05);
    const double size = 3e-3;
    const Matrix6<double> shape = size * size * Matrix6<double>(random.positive_definite<6>(9));
    Tube tube;
    REQUIRE(tube.start(shape, 0, 0) == Status::ok);
    Series series(c.body, c.gravity);
    REQUIRE(series.expand(c.body, 0, h, {}, c.state) == Status::ok);
    REQUIRE(tube.step(c.body, series, {}) == Status::ok);
    RealMatrix6 linear;
    for (int i = 0; i < 6; ++i) {
      const RealVector6 step = 1e-5L * RealVector6::Unit(i);
      linear.col(i) = (moved(c, series.end, step, h) - moved(c, series.end, -step, h)) / 2e-5L;
    }
    // The norm of the tube, with no step to come: of the set and a hundredth of its squared width.
    Matrix6<double> wide = shape;
    wide.diagonal().head<3>().array() += 0.01 * shape.diagonal().head<3>().sum();
    wide.diagonal().tail<3>().array() += 0.01 * shape.diagonal().tail<3>().sum();
    const RealMatrix6 frame = RealMatrix6(wide.cast<Real>()).llt().matrixL();
    const RealMatrix6 back = frame.inverse() * linear.inverse();
    const RealVector6 center = moved(c, series.end, RealVector6::Zero(), h);
    double largest = 0;
    for (int k = 0; k < 400; ++k) {
      const RealVector6 u = random.unit_vector<6>().cast<Real>();
      const RealVector6 y = frame * u;
      const RealVector6 second =
          (moved(c, series.end, y, h) - 2 * center + moved(c, series.end, RealVector6(-y), h)) / 2;
      largest = std::fmax(largest, static_cast<double>(RealVector6(back * second).norm()));
    }
    const double ratio = tube.displacement() / largest;
    least = std::fmin(least, ratio);
    most = std::fmax(most, ratio);
    CHECK(ratio >= 1);
  }
  MESSAGE("displacement over the largest of 400: " << least << " to " << most);
  CHECK(most < 6);
}

namespace {

struct Beyond {
  double largest = 0;  // of what is left of the exact flow beyond the quadratic map, as a part of what it may be
  int closed = 0;
};

/// Motions that begin anywhere in the unit ball of u, by a search that tries to leave p and r behind.
template <typename Potential>
void search_beyond(const RigidBody<double>& body, const Potential& potential, const RealTorque& torque, int steps,
                   Random& random, Beyond& worst) {
  RigidBodyState<double> state{random.rotation(), random.normal_matrix<3>()};
  const RigidBodyState<double> start = state;
  const double h = random.log_uniform(0.01, 0.1) / steps;
  const double size = random.log_uniform(0.02, 0.4);
  ErrorTube<double, Potential> tube;
  REQUIRE(tube.start(size * size * Matrix6<double>(random.positive_definite<6>(9)), h, 1) == Status::ok);
  const RealMatrix6 first_frame = tube.frame().template cast<Real>();
  MotionSeries<double, Potential> series(body, potential);
  for (int k = 0; k < steps; ++k) {
    REQUIRE(series.expand(body, k * h, h, {}, state) == Status::ok);
    if (tube.step(body, series, {}) != Status::ok) {
      return;  // too large a set for so long a step
    }
    state = series.end;
  }
  ++worst.closed;
  const RealMatrix6 back = RealMatrix6(tube.frame().template cast<Real>()).inverse();
  const auto left = [&](const RealVector6& u) {
    const Motion end = independent_flow(body.inertia().cast<Real>(), torque,
                                        gibbs_motion(start, RealVector6(first_frame * u)), 0, Real(steps) * Real(h), 2);
    return RealVector6(back * gibbs_error(state, end) - u - second_order(tube, u));
  };
  // A sum of an ellipsoid and a ball holds what is below its support in every direction.
  const auto part = [&](const RealVector6& r) {
    RealVector6 d = r.normalized();
    double largest = 0;
    for (int k = 0; k < 4; ++k) {
      const Vector6<double> direction = d.cast<double>();
      const double width = std::sqrt(direction.dot(tube.pushed() * direction)) + tube.rest();
      largest = std::fmax(largest, static_cast<double>(d.dot(r)) / width);
      // Towards the normal where r leaves the set: less of what the set is wide in.
      d = (r - (static_cast<Real>(largest) * (tube.pushed() * direction).template cast<Real>()) /
                   static_cast<Real>(std::sqrt(direction.dot(tube.pushed() * direction)) + 1e-30))
              .normalized();
    }
    return largest;
  };
  for (int trial = 0; trial < 3; ++trial) {
    RealVector6 u = random.unit_vector<6>().cast<Real>();
    double best = part(left(u));
    Real move = 0.5L;
    for (int k = 0; k < 60; ++k) {
      RealVector6 other = u + move * random.normal_matrix<6>().cast<Real>();
      other /= std::fmax(other.norm(), Real(1));
      const double found = part(left(other));
      if (found > best) {
        best = found;
        u = other;
      } else {
        move *= 0.93L;
      }
    }
    worst.largest = std::fmax(worst.largest, best);
  }
}

}  // namespace

TEST_CASE("beyond the quadratic map the exact flow leaves no more than the pushes and the rest") {
  for (const int steps : {1, 4}) {
    Random random(5);
    std::array<Beyond, 3> worst;
    for (int trial = 0; trial < 8; ++trial) {
      const Case c = random_case(random);
      const RealMatrix inertia = c.body.inertia().cast<Real>();
      FreeBody<double> free;
      GravityGradient<double> gradient;
      REQUIRE(GravityGradient<double>::make(c.body, 1, Matrix3d::Identity(), gradient) == Status::ok);
      search_beyond(
          c.body, free, [](const RealMatrix&, Real) { return RealVector(RealVector::Zero()); }, steps, random,
          worst[0]);
      search_beyond(
          c.body, c.gravity, [&](const RealMatrix& a, Real) { return pendulum_torque(c.arm, a); }, steps, random,
          worst[1]);
      search_beyond(
          c.body, gradient, [&](const RealMatrix& a, Real t) { return gradient_torque(inertia, 1, a, t); }, steps,
          random, worst[2]);
    }
    for (std::size_t i = 0; i < 3; ++i) {
      MESSAGE(steps << " steps, potential " << i << ": " << worst[i].largest << " of the bound, closed "
                    << worst[i].closed << " of 8");
      CHECK(worst[i].closed >= 4);
      CHECK(worst[i].largest <= 1);
      CHECK(worst[i].largest > 0.2);
    }
  }
}

TEST_CASE("flat sets, sets that are too large and errors of the inertia that are too large are refused") {
  Random random(4);
  const Case c = random_case(random);
  Series series(c.body, c.gravity);
  REQUIRE(series.expand(c.body, 0, 0.05, {}, c.state) == Status::ok);
  Tube tube;
  Matrix6<double> flat = Matrix6<double>::Identity();
  flat(2, 2) = 0;
  CHECK(tube.start(flat, 0, 0) == Status::not_positive_definite);
  REQUIRE(tube.start(1e4 * Matrix6<double>::Identity(), 0, 0) == Status::ok);
  CHECK(tube.step(c.body, series, {}) == Status::unbounded);
  REQUIRE(tube.start(1e-4 * Matrix6<double>::Identity(), 0, 0) == Status::ok);
  const Matrix6<double> before = tube.shape();
  BodyUncertainty<double> uncertainty;
  uncertainty.inertia = c.body.principal_moments()(2);
  CHECK(tube.step(c.body, series, uncertainty) == Status::invalid_inertia);
  CHECK(tube.shape() == before);
  uncertainty.inertia = 0;
  uncertainty.torque = 1e6 * Matrix3d::Identity();
  CHECK(tube.step(c.body, series, uncertainty) == Status::unbounded);
  CHECK(tube.shape() == before);
  uncertainty.torque = std::nan("") * Matrix3d::Identity();
  CHECK(tube.step(c.body, series, uncertainty) == Status::unbounded);
  CHECK(tube.shape() == before);
}

TEST_CASE("what the second order makes of a set is in the shape, by whichever bound") {
  Random random(9);
  double farthest = 0;
  int moved_far = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const Case c = random_case(random);
    const double size = random.log_uniform(0.02, 0.3);
    const Matrix6<double> shape =
        size * size * Matrix6<double>(random.positive_definite<6>(random.log_uniform(1, 1e3)));
    const double h = random.log_uniform(0.05, 0.2);
    Tube tube;
    REQUIRE(tube.start(shape, h, 1) == Status::ok);
    const RealMatrix6 set =
        tube.frame().cast<long double>().inverse() * RealMatrix6(shape.cast<long double>()).llt().matrixL();
    Series series(c.body, c.gravity);
    if (series.expand(c.body, 0, h, {}, c.state) != Status::ok || tube.step(c.body, series, {}) != Status::ok) {
      continue;
    }
    moved_far += tube.displacement() > 0.05 ? 1 : 0;
    const RealMatrix6 root = RealMatrix6(tube.shape().cast<long double>()).llt().matrixL();
    const RealMatrix6 whitened = root.inverse() * tube.frame().cast<long double>();
    const auto form = [&](const RealVector6& v) {
      const RealVector6 u = set * v;
      const RealVector6 end = u + second_order(tube, u);
      return RealVector6(whitened * end).squaredNorm();
    };
    for (int start = 0; start < 8; ++start) {
      RealVector6 v = random.unit_vector<6>().cast<long double>();
      for (int k = 0; k < 30; ++k) {  // towards the farthest
        RealVector6 gradient;
        for (int i = 0; i < 6; ++i) {
          const RealVector6 little = 1e-5L * RealVector6::Unit(i);
          gradient(i) = form(v + little) - form(v - little);
        }
        v = (v + 0.5L * gradient.normalized()).normalized();
        const double reached = static_cast<double>(form(v));
        CHECK(reached <= 1);
        farthest = std::fmax(farthest, reached);
      }
    }
  }
  MESSAGE("farthest " << farthest << ", tubes that moved far " << moved_far);
  CHECK(farthest > 0.98);
  CHECK(moved_far > 30);
}
