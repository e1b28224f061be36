// Fixed lag: the truth is inside, with errors at their bounds; no set is wider than the filter's; motions that agree with all that was
// measured are inside, too. (theory, sections 20.4 and 20.5)
#include <doctest/doctest.h>

#include <vector>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double rad = 0.02;  ///< bound of a direction

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

double largest(const Matrix6<double>& shape, int first) {
  return Eigen::SelfAdjointEigenSolver<Matrix3d>(Matrix3d(shape.block<3, 3>(first, first))).eigenvalues()(2);
}

/// Measured with an error of an angle, across any axis.
Direction<double> measured(const Matrix3d& attitude, const Vector3d& reference, double angle, Random& random) {
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
  int never_wider = 0;
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
      CHECK(set.claim < known[row].claim);
      continue;
    }
    const bool no_wider = largest(set.set.shape, 0) <= (1 + 1e-12) * largest(known[row].set.shape, 0) &&
                          largest(set.set.shape, 3) <= (1 + 1e-12) * largest(known[row].set.shape, 3) &&
                          log_size(set.set) <= log_size(known[row].set) + 1e-12;
    found.never_wider += no_wider ? 1 : 0;
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

}  // namespace

TEST_CASE("fixed lag: a gyro with a bias that drifts, in each way in which a rate is held") {
  for (const auto mode : {GyroScene::Flow::IntervalRate::first_sample, GyroScene::Flow::IntervalRate::mean_of_ends,
                          GyroScene::Flow::IntervalRate::mean}) {
    for (const bool estimates_vector : {true, false}) {
      CAPTURE(estimates_vector);
      Found found;
      for (std::uint64_t seed = 1; seed <= 4; ++seed) {
        GyroScene scene(seed);
        FixedLag<GyroScene::Filter, 8> lag;
        REQUIRE(FixedLag<GyroScene::Filter, 8>::make(GyroScene::filter(Policy::raise, estimates_vector, mode), lag) ==
                Status::ok);
        std::vector<GyroState<double>> truths;
        std::vector<ClaimedSet<GyroState<double>>> known;
        for (int k = 0; k < 20; ++k) {
          if (k > 0) {
            auto input = scene.move();
            if (mode != GyroScene::Flow::IntervalRate::first_sample) {
              input.angular_velocity += 0.5 * GyroScene::step * scene.drifts;  // the mean of the bias
            }
            REQUIRE(lag.predict(k * GyroScene::step, input) == Status::ok);
          }
          if (k < 2 || k % 4 == 0) {  // one direction most of the time
            update(lag, scene.directions(), 2);
          } else {
            update(lag, scene.directions(), 1);
          }
          truths.push_back(scene.truth);
          known.push_back(known_by(lag.filter()));
          look_back(lag, truths, known, found);
        }
      }
      CHECK(found.worst <= 1);
      CHECK(found.worst > 0.5);
      CHECK(found.smaller > found.sets / 3);
      CHECK(found.gain > 0);
    }
  }
}

TEST_CASE("fixed lag: a rigid body under potentials, and a torque that is not known") {
  Found found;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    BodyScene scene(seed);
    FixedLag<BodyScene::Filter, 6> lag;
    REQUIRE(FixedLag<BodyScene::Filter, 6>::make(scene.filter(), lag) == Status::ok);
    std::vector<RigidBodyState<double>> truths;
    std::vector<ClaimedSet<RigidBodyState<double>>> known;
    for (int k = 0; k < 12; ++k) {
      if (k > 0) {
        scene.move(0.999999 * BodyScene::push);
        REQUIRE(lag.predict(scene.time, {}) == Status::ok);
      }
      const auto directions = scene.directions();
      const AngularVelocity<double> rate{scene.truth.angular_velocity + 0.0999999 * scene.random.unit_vector<3>(),
                                         0.01 * Matrix3d::Identity()};
      GuaranteedUpdate<double> report;
      const bool measures_rate = k == 0;
      REQUIRE(lag.update(Measurements<double>{directions.data(), 2, measures_rate ? &rate : nullptr, nullptr},
                         report) == Status::ok);
      truths.push_back(scene.truth);
      known.push_back(known_by(lag.filter()));
      look_back(lag, truths, known, found);
    }
  }
  CHECK(found.worst <= 1);
  CHECK(found.worst > 0.4);
  CHECK(found.smaller > found.sets / 2);
  CHECK(found.gain > 0.5 * found.sets);
}

TEST_CASE("fixed lag: every motion that agrees with all measurements is in the smoothed set") {
  // Without an unknown torque a state at one row is a motion at all rows, found by another integrator.
  BodyScene scene(7);
  constexpr int rows = 5;
  constexpr int asked = 1;  // the second row
  FixedLag<BodyScene::Filter, rows> lag;
  REQUIRE(FixedLag<BodyScene::Filter, rows>::make(scene.filter(0), lag) == Status::ok);
  std::vector<std::array<Direction<double>, 2>> seen;
  GibbsEllipsoid<RigidBodyState<double>> forward;
  AngularVelocity<double> rate{scene.truth.angular_velocity, 0.0025 * Matrix3d::Identity()};
  for (int k = 0; k < rows; ++k) {
    if (k > 0) {
      scene.move(0);
      REQUIRE(lag.predict(scene.time, {}) == Status::ok);
    }
    seen.push_back(scene.directions(0.5 * rad));
    GuaranteedUpdate<double> report;
    REQUIRE(lag.update(Measurements<double>{seen.back().data(), 2, k == 0 ? &rate : nullptr, nullptr}, report) ==
            Status::ok);
    if (k == asked) {
      forward = lag.filter().ellipsoid();
    }
  }
  SmoothedSet<RigidBodyState<double>> smoothed;
  REQUIRE(lag.smoothed(rows - 1 - asked, smoothed) == Status::ok);
  CHECK(smoothed.uses_future);
  CHECK(smoothed.time == BodyScene::step * asked);
  const Matrix6<double> factor = forward.shape.llt().matrixL();
  int agreeing = 0;
  int left_out = 0;  // of the filter's set
  double worst = 0;
  for (int j = 0; j < 4000; ++j) {
    const RigidBodyState<double> state =
        retract<GibbsChart>(forward.center, Vector6<double>(factor * scene.random.in_ball<6>()));
    bool agrees = true;
    Motion motion = gibbs_motion(state, RealVector6::Zero());
    for (int k = asked; k < rows && agrees; ++k) {
      if (k > asked) {
        motion = scene.after(motion, (k - 1) * BodyScene::step, BodyScene::step, RealVector::Zero());
      }
      for (const Direction<double>& direction : seen[static_cast<std::size_t>(k)]) {
        const Vector3d expected = motion.attitude.cast<double>().transpose() * direction.reference;
        agrees = agrees && std::atan2(expected.cross(direction.body).norm(), expected.dot(direction.body)) <= rad;
      }
    }
    if (!agrees) {
      left_out += form_of(smoothed.set, state) > 1 ? 1 : 0;
      continue;
    }
    // And before: backward by the same integrator with the time reversed is the motion forward from a state that leads here; the set of
    // the filter has the first row in it, so that a state that the first row excludes may be in the set, but need not.
    const Motion first = scene.after(gibbs_motion(state, RealVector6::Zero()), asked * BodyScene::step,
                                     -asked * BodyScene::step, RealVector::Zero());
    for (const Direction<double>& direction : seen[0]) {
      const Vector3d expected = first.attitude.cast<double>().transpose() * direction.reference;
      agrees = agrees && std::atan2(expected.cross(direction.body).norm(), expected.dot(direction.body)) <= rad;
    }
    agrees = agrees && (first.angular_velocity.cast<double>() - rate.value).norm() <= 0.05;
    if (agrees) {
      ++agreeing;
      worst = std::fmax(worst, form_of(smoothed.set, state));
    }
  }
  CHECK(agreeing > 20);
  CHECK(left_out > 500);
  CHECK(worst <= 1);
  CHECK(worst > 0.3);
}

TEST_CASE("fixed lag: rows before the first set get one from what was measured later") {
  GyroScene scene(21);
  FixedLag<GyroScene::Filter, 8> lag;
  REQUIRE(FixedLag<GyroScene::Filter, 8>::make(GyroScene::filter(), lag) == Status::ok);
  std::vector<GyroState<double>> truths{scene.truth};
  for (int k = 1; k <= 3; ++k) {
    const auto input = scene.move();
    truths.push_back(scene.truth);
    REQUIRE(lag.predict(k * GyroScene::step, input) == Status::ok);
  }
  SmoothedSet<GyroState<double>> set;
  REQUIRE(lag.smoothed(3, set) == Status::ok);
  CHECK(set.claim == Claim::none);
  CHECK(set.time == 0);
  update(lag, scene.directions(), 2);
  for (std::size_t age = 0; age <= 3; ++age) {
    REQUIRE(lag.smoothed(age, set) == Status::ok);
    CHECK(set.claim == Claim::unconditional);
    CHECK(set.uses_future == (age > 0));
    CHECK(form_of(set.set, truths[3 - age]) <= 1);
  }
}

TEST_CASE("fixed lag: turns, of which only the turn is known") {
  GyroScene scene(22);
  FixedLag<GyroScene::Filter, 3> lag;
  REQUIRE(FixedLag<GyroScene::Filter, 3>::make(GyroScene::filter(), lag) == Status::ok);
  const GyroState<double> first = scene.truth;
  update(lag, scene.directions(), 2);
  static_cast<void>(scene.move());
  const Vector3d turn = GyroScene::step * scene.rate;
  // The turn is off by all of its angle.
  const Vector3d off = exp(Vector3d(0.00999 * scene.random.unit_vector<3>())) * turn;
  const double angle = 1.001 * log(Matrix3d(exp(off).transpose() * exp(turn))).norm();
  REQUIRE(lag.predict_turn(GyroScene::step, off, angle) == Status::ok);
  const MeasuredAttitude<double> star{scene.truth.attitude, 1e-8 * Matrix3d::Identity()};
  GuaranteedUpdate<double> report;
  REQUIRE(lag.update(Measurements<double>{nullptr, 0, nullptr, &star}, report) == Status::ok);
  SmoothedSet<GyroState<double>> set;
  REQUIRE(lag.smoothed(1, set) == Status::ok);
  CHECK(set.uses_future);
  CHECK(form_of(set.set, first) <= 1);
  CHECK(largest(set.set.shape, 0) <
        1e-4);  // the star tracker's 0.1 mrad and the turn's error, not the directions' 20 mrad
}

TEST_CASE("fixed lag: only the last moments are kept, and predictions over no time begin none") {
  GyroScene scene(23);
  FixedLag<GyroScene::Filter, 3> lag;
  REQUIRE(FixedLag<GyroScene::Filter, 3>::make(GyroScene::filter(), lag) == Status::ok);
  SmoothedSet<GyroState<double>> set;
  set.time = 77;
  CHECK(lag.moments() == 1);
  CHECK(lag.smoothed(1, set) == Status::out_of_range);
  CHECK(set.time == 77);
  REQUIRE(lag.predict(0, {Vector3d::Zero(), -1, true}) == Status::ok);
  CHECK(lag.moments() == 1);
  for (int k = 1; k <= 9; ++k) {
    REQUIRE(lag.predict(k * GyroScene::step, scene.move()) == Status::ok);
    CHECK(lag.moments() == static_cast<std::size_t>(k < 3 ? k + 1 : 4));
  }
  for (std::size_t age = 0; age < 4; ++age) {
    REQUIRE(lag.smoothed(age, set) == Status::ok);
    CHECK(set.time == (9 - static_cast<double>(age)) * GyroScene::step);
  }
  CHECK(lag.smoothed(4, set) == Status::out_of_range);
  // What is refused changes nothing.
  CHECK(lag.predict(1, {Vector3d::Zero(), -1, true}) == Status::out_of_range);
  CHECK(lag.predict(std::nan(""), {Vector3d::Zero(), -1, true}) == Status::not_finite);
  CHECK(lag.predict_turn(10, Vector3d::Zero(), -1) == Status::out_of_range);
  GuaranteedUpdate<double> report;
  const Direction<double> none = Direction<double>::within(Vector3d::Zero(), Vector3d::UnitX(), rad);
  CHECK(lag.update(Measurements<double>{&none, 1, nullptr, nullptr}, report) == Status::zero_direction);
  CHECK(lag.moments() == 4);
  CHECK(lag.time() == 9 * GyroScene::step);
  lag.forget();
  CHECK(lag.moments() == 1);
  CHECK_FALSE(lag.filter().knows_attitude());
  FixedLag<BodyScene::Filter, 3> unmade;
  CHECK(FixedLag<BodyScene::Filter, 3>::make({}, unmade) == Status::out_of_range);
}

TEST_CASE("fixed lag: by stamps") {
  GyroScene scene(24);
  using Lag = FixedLag<GyroScene::Filter, 3>;
  Lag lag;
  REQUIRE(Lag::make(GyroScene::filter(), lag) == Status::ok);
  StampedFilter<Lag> stamped(lag, 0, 0);
  const GyroState<double> first = scene.truth;
  update(stamped.filter(), scene.directions(), 2);
  REQUIRE(stamped.predict(500000000, scene.move()) == Status::ok);
  update(stamped.filter(), scene.directions(), 2);
  SmoothedSet<GyroState<double>> set;
  REQUIRE(stamped.filter().smoothed(1, set) == Status::ok);
  CHECK(set.uses_future);
  CHECK(form_of(set.set, first) <= 1);
}

TEST_CASE("both directions: the stronger claim alone, and no set without one") {
  const GibbsEllipsoid<GyroState<double>> narrow{{Matrix3d::Identity(), Vector3d::Zero()},
                                                 0.01 * Matrix6<double>::Identity()};
  GibbsEllipsoid<GyroState<double>> wide = narrow;
  wide.shape *= 9;
  BothDirections<GyroState<double>> both;
  REQUIRE(both_directions<GyroState<double>>({narrow, Claim::conditional}, {wide, Claim::unconditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::unconditional);
  CHECK(both.smoothed.set.shape == wide.shape);
  CHECK(both.smallest.set.shape == wide.shape);
  CHECK(both.uses_future);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::unconditional}, {narrow, Claim::conditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::unconditional);
  CHECK(both.smoothed.set.shape == wide.shape);
  CHECK_FALSE(both.uses_future);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::none}, {narrow, Claim::conditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::conditional);
  CHECK(both.smoothed.set.shape == narrow.shape);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::none}, {narrow, Claim::none}, {}, both) == Status::ok);
  CHECK(both.smoothed.claim == Claim::none);
  REQUIRE(both_directions<GyroState<double>>({wide, Claim::conditional}, {narrow, Claim::conditional}, {}, both) ==
          Status::ok);
  CHECK(both.smoothed.claim == Claim::conditional);
  CHECK(log_size(both.smoothed.set) < log_size(wide));
  CHECK_FALSE(both.contradict);
}

TEST_CASE("both directions: a smaller set that reaches farther is not shown, but is gone on with") {
  // The past is a ball, the future a thin ellipsoid across it whose largest part lies outside.
  const GibbsEllipsoid<GyroState<double>> past{{Matrix3d::Identity(), Vector3d::Zero()},
                                               0.01 * Matrix6<double>::Identity()};
  Vector6<double> squares = Vector6<double>::Constant(0.0101);
  squares(0) = 1e-6;
  squares(1) = 0.04;
  const GibbsEllipsoid<GyroState<double>> future{{Matrix3d::Identity(), Vector3d::Zero()},
                                                 Matrix6<double>(squares.asDiagonal())};
  BothDirections<GyroState<double>> both;
  REQUIRE(both_directions<GyroState<double>>({past, Claim::unconditional}, {future, Claim::unconditional}, {}, both) ==
          Status::ok);
  CHECK(log_size(both.smallest.set) < log_size(past) - 1);
  CHECK(largest(both.smallest.set.shape, 0) > largest(past.shape, 0));
  CHECK(both.smoothed.set.shape == past.shape);
  CHECK_FALSE(both.uses_future);
}

TEST_CASE("both directions: sets that have nothing in common, and whether that proves anything") {
  const GibbsEllipsoid<GyroState<double>> past{{Matrix3d::Identity(), Vector3d::Zero()},
                                               1e-4 * Matrix6<double>::Identity()};
  GibbsEllipsoid<GyroState<double>> future = past;
  future.center.attitude = exp(Vector3d(0.1, 0, 0));
  BothDirections<GyroState<double>> both;
  for (const Claim claim : {Claim::unconditional, Claim::conditional}) {
    REQUIRE(both_directions<GyroState<double>>({past, claim}, {future, claim}, {}, both) == Status::ok);
    CHECK(both.contradict == (claim == Claim::unconditional));
    CHECK(both.smoothed.set.shape == past.shape);
    CHECK(both.smoothed.claim == claim);
    CHECK_FALSE(both.uses_future);
  }
  GibbsEllipsoid<GyroState<double>> broken = past;
  broken.shape(0, 0) = std::nan("");
  CHECK(both_directions<GyroState<double>>({past, Claim::unconditional}, {broken, Claim::unconditional}, {}, both) ==
        Status::not_finite);
  CHECK(both.smoothed.claim == Claim::conditional);
}

TEST_CASE("fixed lag: a past and a future that contradict one another") {
  // The attitude is known but about y, and the gyro but about x. What both make together is nearly a square, and the ellipsoid about it has
  // more: an attitude that is measured there fits the prediction, but no state of the beginning leads to it.
  for (const Policy policy : {Policy::raise, Policy::drop_measurement}) {
    using Flow = GuaranteedGyroFlow<double>;
    GyroUncertainty<double> uncertainty;
    uncertainty.noise = Vector3d(1e-4, 1e-12, 1e-12).asDiagonal();
    Flow flow;
    REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean, flow) == Status::ok);
    GyroScene::Filter::Settings settings;
    settings.policy = policy;
    GyroScene::Filter filter;
    REQUIRE(GyroScene::Filter::make(flow, settings, 0, filter) == Status::ok);
    Matrix6<double> shape = 1e-10 * Matrix6<double>::Identity();
    shape(1, 1) = 1e-4;
    REQUIRE(filter.start(GibbsEllipsoid<GyroState<double>>{{Matrix3d::Identity(), Vector3d::Zero()}, shape}) ==
            Status::ok);
    FixedLag<GyroScene::Filter, 4> lag;
    REQUIRE(FixedLag<GyroScene::Filter, 4>::make(filter, lag) == Status::ok);
    REQUIRE(lag.predict(1, {Vector3d::Zero(), -1, true}) == Status::ok);
    const MeasuredAttitude<double> star{exp(Vector3d(0.013, 0, 0)), 1e-8 * Matrix3d::Identity()};
    GuaranteedUpdate<double> report;
    REQUIRE(lag.update(Measurements<double>{nullptr, 0, nullptr, &star}, report) == Status::ok);
    CHECK(report.dropped == 0);
    SmoothedSet<GyroState<double>> set;
    REQUIRE(lag.smoothed(0, set) == Status::ok);
    CHECK(set.claim == Claim::unconditional);
    set.time = 77;
    if (policy == Policy::raise) {
      CHECK(lag.smoothed(1, set) == Status::empty_intersection);
      CHECK(set.time == 77);
      CHECK_FALSE(lag.has_contradicted());
      REQUIRE(lag.smoothed(0, set) == Status::ok);
      CHECK(set.claim == Claim::unconditional);
      continue;
    }
    // The statement that is wrong may be wrong elsewhere without showing it.
    REQUIRE(lag.smoothed(1, set) == Status::ok);
    CHECK(set.claim == Claim::conditional);
    CHECK(set.set.shape == filter.ellipsoid().shape);
    CHECK(lag.has_contradicted());
    REQUIRE(lag.smoothed(0, set) == Status::ok);
    CHECK(set.claim == Claim::conditional);
    CHECK(lag.filter().claim() == Claim::unconditional);
    lag.forget();
    CHECK_FALSE(lag.has_contradicted());
  }
}

TEST_CASE("fixed lag: the pass ends where a caller stops it, and may be asked again") {
  BodyScene scene(25);
  BodyScene::Flow flow = scene.filter(0, 0.005).flow();
  struct Switch {
    bool on = false;
  } stops;
  flow.set_interruption({[](void* context) noexcept { return static_cast<Switch*>(context)->on; }, &stops});
  BodyScene::Filter filter;
  REQUIRE(BodyScene::Filter::make(flow, {}, 0, filter) == Status::ok);
  REQUIRE(filter.start(GibbsEllipsoid<RigidBodyState<double>>{scene.truth, 1e-4 * Matrix6<double>::Identity()}) ==
          Status::ok);
  FixedLag<BodyScene::Filter, 4> lag;
  REQUIRE(FixedLag<BodyScene::Filter, 4>::make(filter, lag) == Status::ok);
  REQUIRE(lag.predict(0.5, {}) == Status::ok);
  SmoothedSet<RigidBodyState<double>> set;
  set.time = 77;
  stops.on = true;
  CHECK(lag.smoothed(1, set) == Status::interrupted);
  CHECK(set.time == 77);
  stops.on = false;
  CHECK(lag.smoothed(1, set) == Status::ok);
}
