#pragma once

/// \file
/// A gyro whose bias drifts, and a heavy top on an orbit, with errors at their bounds, for the tests of smoothing.

#include <doctest/doctest.h>

#include <vector>

#include "support/guaranteed.hpp"

namespace elliptude::testing::smoothing {

using Eigen::Matrix3d;
using Eigen::Vector3d;

inline constexpr double rad = 0.02;  ///< bound of a direction

template <typename State>
double form_of(const GibbsEllipsoid<State>& set, const State& state) {
  double form = 2;
  REQUIRE(quadratic_form(set, state, form) == Status::ok);
  return form;
}

/// The larger form of attitude and vector, each in a set of its own.
template <typename State>
double form_in_product(const GibbsEllipsoid<State>& set, const State& state) {
  const Vector6<double> error = state_error<GibbsChart>(set.center, state);
  double attitude = 2;
  double vector = 2;
  const Ellipsoid<double, 6> whole = set.in_coordinates();
  REQUIRE(quadratic_form(projection<0, 3>(whole), Vector3d(error.head<3>()), attitude) == Status::ok);
  REQUIRE(quadratic_form(projection<3, 3>(whole), Vector3d(error.tail<3>()), vector) == Status::ok);
  return std::fmax(attitude, vector);
}

template <typename State>
double log_size(const GibbsEllipsoid<State>& set) {
  double size = 0;
  REQUIRE(log_volume(set.in_coordinates(), size) == Status::ok);
  return size;
}

inline double largest(const Matrix6<double>& shape, int first) {
  return Eigen::SelfAdjointEigenSolver<Matrix3d>(Matrix3d(shape.block<3, 3>(first, first))).eigenvalues()(2);
}

/// Measured with an error of an angle, across any axis.
inline Direction<double> measured(const Matrix3d& attitude, const Vector3d& reference, double angle, Random& random) {
  const Vector3d seen = attitude.transpose() * reference;
  const Vector3d across = seen.cross(random.unit_vector<3>()).normalized();
  return Direction<double>::within(reference, exp(Vector3d(angle * across)) * seen, rad);
}

/// A gyro with a bias that drifts at its bound, and one direction in turn.
struct GyroScene {
  using Flow = GuaranteedGyroFlow<double>;
  using Filter = GuaranteedFilter<Flow>;
  static constexpr double noise = 2e-4;
  static constexpr double drift = 1e-5;
  static constexpr double step = 0.5;

  Random random;
  Vector3d rate;
  Vector3d drifts;
  std::array<Vector3d, 3> references{Vector3d::UnitX(), Vector3d::UnitY(), Vector3d::UnitZ()};
  GyroState<double> truth;
  int row = 0;

  explicit GyroScene(std::uint64_t seed)
      : random(seed),
        rate(0.3 * random.unit_vector<3>()),
        drifts(drift * random.unit_vector<3>()),
        truth{random.rotation(), 0.01 * random.unit_vector<3>()} {}

  static Filter filter(Policy policy = Policy::raise, bool estimates_vector = true,
                       Flow::IntervalRate mode = Flow::IntervalRate::first_sample) {
    GyroUncertainty<double> uncertainty;
    uncertainty.noise = noise * noise * Matrix3d::Identity();
    uncertainty.drift = drift * drift * Matrix3d::Identity();
    Flow flow;
    REQUIRE(Flow::make(uncertainty, mode, flow) == Status::ok);
    Filter::Settings settings;
    settings.policy = policy;
    settings.estimates_vector = estimates_vector;
    Filter filter;
    REQUIRE(Filter::make(flow, settings, 0, filter) == Status::ok);
    REQUIRE(filter.bound_vector({Vector3d::Zero(), 4e-4 * Matrix3d::Identity()}) == Status::ok);
    return filter;
  }

  /// Both directions of a row: a bound is kept to the edge.
  std::array<Direction<double>, 2> directions(double angle = 0.999999 * rad) {
    return {measured(truth.attitude, references[static_cast<std::size_t>(row % 3)], angle, random),
            measured(truth.attitude, references[static_cast<std::size_t>((row + 1) % 3)], angle, random)};
  }

  /// The next row, and the gyro's sample at the beginning of the step.
  Flow::Input move() {
    const Vector3d shown = rate + truth.gyro_bias + 0.999999 * noise * random.unit_vector<3>();
    truth.attitude = truth.attitude * exp(Vector3d(step * rate));
    truth.gyro_bias += 0.999999 * step * drifts;
    ++row;
    return {shown, -1, true};
  }
};

/// A heavy top on an orbit, whose torque is not known to the last: directions at some rows, and no rate.
struct BodyScene {
  using Potential = SumPotential<GravityGradient<double>, UniformGravity<double>>;
  using Flow = GuaranteedRigidBodyFlow<double, Potential>;
  using Filter = GuaranteedFilter<Flow>;
  static constexpr double push = 1e-4;
  static constexpr double step = 0.2;

  Random random;
  RigidBody<double> body;
  Vector3d moment{0.1, -0.05, 0.2};
  RealMatrix inertia;
  RigidBodyState<double> truth;
  double time = 0;

  explicit BodyScene(std::uint64_t seed)
      : random(seed), body(random_body(random)), truth{random.rotation(), 0.5 * random.unit_vector<3>()} {
    inertia = body.inertia().cast<Real>();
  }

  Filter filter(double torque = push, double longest_step = 0.1) {
    GravityGradient<double> gradient;
    REQUIRE(GravityGradient<double>::make(body, 0.7, Matrix3d::Identity(), gradient) == Status::ok);
    UniformGravity<double> gravity;
    REQUIRE(UniformGravity<double>::make(1, 1, moment, gravity) == Status::ok);
    BodyUncertainty<double> uncertainty;
    uncertainty.torque = torque * torque * Matrix3d::Identity();
    Flow flow;
    REQUIRE(Flow::make(body, Potential(gradient, gravity), longest_step, uncertainty, flow) == Status::ok);
    Filter filter;
    REQUIRE(Filter::make(flow, {}, 0, filter) == Status::ok);
    return filter;
  }

  [[nodiscard]] Motion after(const Motion& from, double begin, double duration, const RealVector& pushed) const {
    const RealTorque torque = [&](const RealMatrix& c, Real t) {
      return RealVector(gradient_torque(inertia, Real(0.7L), c, t) + pendulum_torque(moment, c) + pushed);
    };
    return independent_flow(inertia, torque, from, Real(begin), Real(duration), 2);
  }

  void move(double pushes) {
    const RealVector pushed = (pushes * random.unit_vector<3>()).cast<Real>();
    const Motion end = after(gibbs_motion(truth, RealVector6::Zero()), time, step, pushed);
    truth = {renormalized(Matrix3d(end.attitude.cast<double>())), end.angular_velocity.cast<double>()};
    time += step;
  }

  std::array<Direction<double>, 2> directions(double angle = 0.999999 * rad) {
    return {measured(truth.attitude, Vector3d::UnitX(), angle, random),
            measured(truth.attitude, Vector3d(0, 0.6, 0.8), angle, random)};
  }
};

template <typename Lag>
void update(Lag& lag, const std::array<Direction<double>, 2>& directions, std::size_t count) {
  GuaranteedUpdate<double> report;
  REQUIRE(lag.update(Measurements<double>{directions.data(), count, nullptr, nullptr}, report) == Status::ok);
}

/// What the sets of a stream do at each age: how many are smaller than the filter's, and the worst form of the truth.
struct Found {
  double worst = 0;
  int smaller = 0;
  int sets = 0;
  double gain = 0;  ///< of the logarithm of the volume, in all
};

template <typename Lag, typename State>
void look_back(Lag& lag, const std::vector<State>& truths, const std::vector<ClaimedSet<State>>& known, Found& found) {
  for (std::size_t age = 0; age < lag.moments(); ++age) {
    const std::size_t row = truths.size() - 1 - age;
    SmoothedSet<State> set;
    REQUIRE(lag.smoothed(age, set) == Status::ok);
    if (set.claim == Claim::none) {
      continue;
    }
    ++found.sets;
    const bool is_product = !lag.filter().settings().estimates_vector;
    found.worst =
        std::fmax(found.worst, is_product ? form_in_product(set.set, truths[row]) : form_of(set.set, truths[row]));
    if (known[row].claim != set.claim) {
      CHECK(set.claim > known[row].claim);
      continue;
    }
    const double vector = Eigen::SelfAdjointEigenSolver<Matrix3d>(set.vector.shape).eigenvalues()(2);
    const bool no_wider = largest(set.set.shape, 0) <= (1 + 1e-12) * largest(known[row].set.shape, 0) &&
                          vector <= (1 + 1e-12) * largest(known[row].set.shape, 3) &&
                          log_size(set.set) <= log_size(known[row].set) + 1e-12;
    double of_vector = 2;
    REQUIRE(quadratic_form(set.vector, vector_part(truths[row]), of_vector) == Status::ok);
    found.worst = std::fmax(found.worst, of_vector);
    CHECK(no_wider);
    CHECK(set.uses_future == (set.set.shape != known[row].set.shape));
    found.smaller += set.uses_future ? 1 : 0;
    found.gain += log_size(known[row].set) - log_size(set.set);
  }
}

template <typename Filter, typename State = typename Filter::State>
ClaimedSet<State> known_by(const Filter& filter) {
  ClaimedSet<State> known;
  known.claim = filter.claim();
  if (filter.knows_attitude()) {
    known.set = filter.ellipsoid();
  }
  return known;
}

}  // namespace elliptude::testing::smoothing
