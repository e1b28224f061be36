/// \file
/// Looks for true states outside of the sets of the guaranteed filter in single precision: a gyro's and a body's, first sets
/// from 0.5 rad to 1e-3 rad wide and down to 1e-3 as thick, errors as large as their bounds. The truth and what is judged are in
/// long double; all that the filter is given is rounded first, and the truth made from what was rounded.

#include <cstdio>
#include <cstdlib>

#include "support/guaranteed.hpp"

namespace {

using namespace elliptude;
using namespace elliptude::testing;

using Vector6r = Eigen::Matrix<Real, 6, 1>;

/// What was counted for one kind of filter.
struct Row {
  const char* name;
  long updates = 0;
  long without_set = 0;
  long escapes = 0;
  long conditional = 0;  ///< claims after true measurements were taken for wrong
  long failed = 0;
  Real worst = 0;
};

RealMatrix nearest_rotation(const Matrix3<float>& attitude) {
  RealMatrix c = attitude.cast<Real>();
  for (int i = 0; i < 4; ++i) {
    c = (c + RealMatrix(c.inverse().transpose())) / 2;
  }
  return c;
}

RealMatrix turn_by(const RealVector& vector) {
  const Real angle = vector.norm();
  if (!(angle > 0)) {
    return RealMatrix::Identity();
  }
  return Eigen::AngleAxis<Real>(angle, RealVector(vector / angle)).toRotationMatrix();
}

/// The state that is y = [γ; δ] from a center.
template <typename State>
Motion moved(const State& center, const Vector6r& y) {
  const RealVector gamma = y.head<3>();
  const Real length = gamma.norm();
  const RealVector turn = length > 0 ? RealVector((2 * std::atan(length / 2) / length) * gamma) : gamma;
  return {nearest_rotation(center.attitude) * turn_by(turn),
          RealVector(vector_part(center).template cast<Real>()) + y.tail<3>()};
}

/// yᵀP⁻¹y; infinite if P is not positive definite.
template <typename State>
Real form(const GibbsEllipsoid<State>& set, const Motion& truth) {
  const RealMatrix r = nearest_rotation(set.center.attitude).transpose() * truth.attitude;
  const Real scale = 2 / (1 + r.trace());
  Vector6r y;
  y << scale * (r(2, 1) - r(1, 2)), scale * (r(0, 2) - r(2, 0)), scale * (r(1, 0) - r(0, 1)),
      truth.angular_velocity - RealVector(vector_part(set.center).template cast<Real>());
  const Eigen::LLT<Eigen::Matrix<Real, 6, 6>> factor(set.shape.template cast<Real>());
  return factor.info() == Eigen::Success ? Vector6r(factor.matrixL().solve(y)).squaredNorm() : HUGE_VALL;
}

/// A first set with the truth on its boundary, up to the rounding of the truth's place in the filter's own numbers.
template <typename State>
Motion draw_start(Random& random, const Vector3<float>& vector, GibbsEllipsoid<State>& set) {
  set.center = State{random.rotation().cast<float>(), vector};
  const double width = random.log_uniform(1e-3, 0.5);
  const double ratio = random.log_uniform(1e-3, 1);
  Eigen::Matrix<double, 6, 1> lengths;
  for (int i = 0; i < 6; ++i) {
    lengths(i) = width * std::pow(ratio, i == 0 ? 1 : random.uniform(0, 1));
  }
  lengths.tail<3>() *= random.log_uniform(1e-3, 1);
  Eigen::Matrix<double, 6, 6> axes = Eigen::Matrix<double, 6, 6>::Zero();
  axes.topLeftCorner<3, 3>() = random.orthogonal<3>();
  axes.bottomRightCorner<3, 3>() = random.orthogonal<3>();
  const Eigen::Matrix<double, 6, 6> shape = axes * lengths.cwiseAbs2().asDiagonal() * axes.transpose();
  set.shape = ((shape + shape.transpose()) / 2).cast<float>();
  Eigen::LLT<Eigen::Matrix<Real, 6, 6>> factor(set.shape.template cast<Real>());
  while (factor.info() != Eigen::Success) {  // rounding has made it flat
    set.shape += (1e-7F * set.shape.trace()) * Matrix6<float>::Identity();
    factor.compute(set.shape.template cast<Real>());
  }
  const Vector6r out = factor.matrixL() * random.unit_vector<6>().cast<Real>();
  return moved(set.center, Vector6r((1 - 1e-6L) * out));
}

/// A direction as measured, off by no more than its bound after rounding.
Direction<float> measured(Random& random, const Motion& truth, float bound) {
  const Vector3<float> reference = random.unit_vector<3>().cast<float>();
  const RealVector body = truth.attitude.transpose() * reference.cast<Real>().normalized();
  const RealVector across = body.cross(RealVector(random.unit_vector<3>().cast<Real>())).normalized();
  for (Real share = 1 - 1e-6L;; share *= 0.999L) {
    const Vector3<float> rounded = (turn_by(RealVector(share * Real(bound) * across)) * body).cast<float>();
    const RealVector exactly = rounded.cast<Real>();
    if (std::atan2(exactly.cross(body).norm(), exactly.dot(body)) <= (1 - 1e-7L) * Real(bound)) {
      return Direction<float>::within(reference, rounded, bound);
    }
  }
}

/// Fuses and judges. \return whether to go on.
template <typename Filter>
bool judge(Filter& filter, const Measurements<float>& measurements, const Motion& truth, Row& row) {
  GuaranteedUpdate<float> update;
  ++row.updates;
  if (filter.update(measurements, update) != Status::ok) {
    ++row.failed;
    return false;
  }
  row.conditional += update.claim == Claim::conditional ? 1 : 0;
  if (update.claim == Claim::none) {
    ++row.without_set;
    return true;
  }
  const Real value = form(filter.ellipsoid(), truth);
  row.worst = std::max(row.worst, value);
  row.escapes += value <= 1 ? 0 : 1;
  return true;
}

/// A gyro with noise at its bound and a constant bias, or without either.
void try_gyro(Random& random, Row& row, int updates) {
  using Flow = GuaranteedGyroFlow<float>;
  GyroUncertainty<float> uncertainty;
  const bool is_ideal = random.uniform(0, 1) < 0.5;
  const auto noise = static_cast<float>(is_ideal ? 0 : random.log_uniform(1e-4, 0.1));
  uncertainty.noise = (noise * noise) * Matrix3<float>::Identity();
  Flow flow;
  GuaranteedFilter<Flow> filter;
  GibbsEllipsoid<GyroState<float>> set;
  Motion truth = draw_start(random, Vector3<float>(random.in_ball<3>().cast<float>()), set);  // its rate is the bias
  const auto interval = static_cast<float>(std::ldexp(1, -static_cast<int>(random.uniform(3, 11))));
  if (Flow::make(uncertainty, Flow::IntervalRate::mean, flow) != Status::ok ||
      GuaranteedFilter<Flow>::make(flow, {}, 0, filter) != Status::ok || filter.start(set) != Status::ok) {
    ++row.failed;
    return;
  }
  for (int k = 1; k <= updates; ++k) {
    const Vector3<float> sample = (5 * random.in_ball<3>()).cast<float>();
    const RealVector error = (1 - 1e-6L) * Real(noise) * random.unit_vector<3>().cast<Real>();
    truth.attitude *= turn_by(RealVector(Real(interval) * (sample.cast<Real>() - truth.angular_velocity - error)));
    if (filter.predict(static_cast<float>(k) * interval, {sample}) != Status::ok) {
      ++row.failed;
      return;
    }
    const auto bound = static_cast<float>(random.log_uniform(1e-3, 0.1));
    const std::array<Direction<float>, 2> directions{measured(random, truth, bound), measured(random, truth, bound)};
    Measurements<float> measurements;
    measurements.directions = directions.data();
    measurements.direction_count = random.uniform(0, 1) < 0.3 ? 2 : 0;
    if (!judge(filter, measurements, truth, row)) {
      return;
    }
  }
}

/// A free body or a pendulum.
template <typename Potential>
void try_body(Random& random, Row& row, int updates, const Potential& potential, const RealVector& moment) {
  using Flow = GuaranteedRigidBodyFlow<float, Potential>;
  const Eigen::Vector3d masses(random.uniform(0.1, 1), random.uniform(0.1, 1), random.uniform(0.1, 1));
  const Vector3<float> moments =
      Eigen::Vector3d(masses(1) + masses(2), masses(2) + masses(0), masses(0) + masses(1)).cast<float>();
  RigidBody<float> body;
  Flow flow;
  GuaranteedFilter<Flow> filter;
  GibbsEllipsoid<RigidBodyState<float>> set;
  Motion truth = draw_start(random, Vector3<float>((3 * random.in_ball<3>()).cast<float>()), set);
  const float interval = 0.0625F;
  if (RigidBody<float>::make(moments.asDiagonal(), body) != Status::ok ||
      Flow::make(body, potential, 0.25F * interval, {}, flow) != Status::ok ||
      GuaranteedFilter<Flow>::make(flow, {}, 0, filter) != Status::ok || filter.start(set) != Status::ok) {
    ++row.failed;
    return;
  }
  const RealMatrix inertia = moments.cast<Real>().asDiagonal();
  const RealTorque torque = [&](const RealMatrix& attitude, Real /*time*/) {
    return RealVector(moment.cross(RealVector(attitude.row(2).transpose())));
  };
  for (int k = 1; k <= updates; ++k) {
    truth = independent_flow(inertia, torque, truth, 0, static_cast<Real>(interval), 1);
    if (filter.predict(static_cast<float>(k) * interval, {}) != Status::ok) {
      ++row.failed;
      return;
    }
    const auto bound = static_cast<float>(random.log_uniform(1e-3, 0.1));
    const std::array<Direction<float>, 2> directions{measured(random, truth, bound), measured(random, truth, bound)};
    const RealVector error = (1 - 1e-5L) * Real(bound) * random.unit_vector<3>().cast<Real>();
    const AngularVelocity<float> rate{RealVector(truth.angular_velocity - error).cast<float>(),
                                      (bound * bound) * Matrix3<float>::Identity()};
    Measurements<float> measurements;
    const bool is_measured = random.uniform(0, 1) < 0.5;
    measurements.directions = directions.data();
    measurements.direction_count = is_measured ? 2 : 0;
    measurements.angular_velocity = is_measured ? &rate : nullptr;
    // The rounding of the measured rate must not take it out of its bound.
    if (!(RealVector(truth.angular_velocity - rate.value.cast<Real>()).norm() <= (1 - 1e-7L) * Real(bound))) {
      measurements.angular_velocity = nullptr;
    }
    if (!judge(filter, measurements, truth, row)) {
      return;
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const long updates = argc > 1 ? std::atol(argv[1]) : 1000000;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (updates < 1000 || argc > 3) {
    std::fprintf(stderr, "usage: %s [UPDATES OF EACH KIND (at least 1000) [SEED]]\n", argv[0]);
    return 2;
  }
  Random random(static_cast<std::uint64_t>(seed));
  UniformGravity<float> gravity;
  if (UniformGravity<float>::make(1, 8, Vector3<float>(0.0625F, -0.125F, 0.25F), gravity) != Status::ok) {
    return 2;
  }
  std::array<Row, 3> rows{Row{"gyro"}, Row{"free body"}, Row{"pendulum"}};
  constexpr int in_a_trial = 40;
  while (rows[0].updates < updates) {
    try_gyro(random, rows[0], in_a_trial);
  }
  while (rows[1].updates < updates) {
    try_body(random, rows[1], in_a_trial, FreeBody<float>(), RealVector::Zero());
  }
  while (rows[2].updates < updates) {
    try_body(random, rows[2], in_a_trial, gravity, RealVector(0.5L, -1, 2));
  }
  std::printf("%-10s %10s %10s %9s %12s %8s   %s\n", "float", "updates", "no set", "escapes", "conditional", "failed",
              "worst form");
  long faults = 0;
  for (const Row& row : rows) {
    std::printf("%-10s %10ld %10ld %9ld %12ld %8ld   %.9Lg\n", row.name, row.updates, row.without_set, row.escapes,
                row.conditional, row.failed, row.worst);
    faults += row.escapes + row.conditional + row.failed;
  }
  return faults == 0 ? 0 : 1;
}
