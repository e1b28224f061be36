#include <doctest/doctest.h>

#include <elliptude/first_order/convergence.hpp>
#include <limits>
#include <vector>

#include "support/independent_flow.hpp"
#include "support/scenarios.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using State = RigidBodyState<double>;
using Set = StateEllipsoid<State>;
using Flow = RigidBodyFlow<double, GravityGradient<double>>;
using Filter = AttitudeFilter<Flow, FirstOrderEstimator>;

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
constexpr double interval = 0.62831853071795862;  // of scenario `orbit`, 30 steps

Flow orbit_flow(const Matrix3<double>& unknown_torque = Matrix3<double>::Zero()) {
  const RigidBody<double> body = spacecraft<double>();
  Flow flow;
  REQUIRE(Flow::make(body, orbit_gravity(body), interval / 30, 4, unknown_torque, flow) == Status::ok);
  return flow;
}

Filter make_filter(const Flow& flow, const Set& start) {
  Filter filter;
  REQUIRE(Filter::make(flow, SizeCriterion<double, 6>::trace(), 0.0, start, filter) == Status::ok);
  return filter;
}

/// The continuous motion of scenario `orbit`, from the test's own integrator, with a constant torque beside gravity.
State orbit_truth(const State& start, double time, double duration, const Vector3<double>& torque) {
  const RigidBody<double> body = spacecraft<double>();
  const RealMatrix inertia = body.inertia().cast<Real>();
  const auto real_torque = [&](const RealMatrix& attitude, Real t) {
    const RealVector b = attitude.transpose() * RealVector(std::cos(t), std::sin(t), 0);
    return RealVector(3 * b.cross(RealVector(inertia * b)) + torque.cast<Real>());
  };
  const Motion motion =
      independent_flow(inertia, real_torque, {start.attitude.cast<Real>(), start.angular_velocity.cast<Real>()},
                       static_cast<Real>(time), static_cast<Real>(duration), 2);
  return {renormalized(Matrix3<double>(motion.attitude.cast<double>())), motion.angular_velocity.cast<double>()};
}

std::vector<Direction<double>> measure(Random& random, const State& truth, int count, double bound) {
  std::vector<Direction<double>> directions;
  for (int i = 0; i < count; ++i) {
    const Vector3<double> e = Vector3<double>::Unit(i);
    directions.push_back(
        Direction<double>::within(e, exp(-bound * random.in_ball<3>()) * (truth.attitude.transpose() * e), bound));
  }
  return directions;
}

Set scenario_start() {
  Vector6<double> diagonal;
  diagonal << Vector3<double>::Constant(4.934802), Vector3<double>::Constant(0.548311);
  return {{Matrix3<double>::Identity(), Vector3<double>(2.116, 0.5466, -0.8915)}, diagonal.asDiagonal()};
}

/// All that a filter is, for "as it was".
void check_same(const Filter& a, const Filter& b) {
  CHECK(a.time() == b.time());
  CHECK(a.ellipsoid().center.attitude == b.ellipsoid().center.attitude);
  CHECK(a.ellipsoid().center.angular_velocity == b.ellipsoid().center.angular_velocity);
  CHECK(a.ellipsoid().shape == b.ellipsoid().shape);
  CHECK(a.transition() == b.transition());
  CHECK(a.prior_shape() == b.prior_shape());
}

double form_of(const Set& set, const State& state) {
  double form = 0;
  REQUIRE(quadratic_form(set, state, form) == Status::ok);
  return form;
}

}  // namespace

TEST_CASE(
    "On scenario orbit the truth stays inside and the error small with 3 and 2 directions and with one at a time") {
  Random random(1);
  const double bound = 7 * 0.017453292519943295;
  for (const int count : {3, 2, 1}) {
    Filter filter = make_filter(orbit_flow(), scenario_start());
    State truth = orbit_state<double>();
    double error = 0;
    for (int k = 0; k < 20; ++k) {
      truth = orbit_truth(truth, k * interval, interval, Vector3<double>::Zero());
      REQUIRE(filter.predict((k + 1) * interval, {}) == Status::ok);
      // One direction alone does not catch an error of 105 degrees to first order: two to begin with.
      auto directions = measure(random, truth, count == 1 && k < 2 ? 2 : count, bound);
      if (count == 1 && k >= 2) {
        directions[0] = measure(random, truth, 3, bound)[static_cast<std::size_t>(k % 3)];
      }
      const AngularVelocity<double> rate{truth.angular_velocity - bound * random.in_ball<3>(),
                                         bound * bound * Matrix3<double>::Identity()};
      Update<double> update{};
      if (count == 1) {
        REQUIRE(filter.update(directions.data(), directions.size(), update) == Status::ok);
        REQUIRE(filter.update(rate, update) == Status::ok);
      } else {
        const Filter predicted = filter;
        Convergence<double> diagnostics{};
        REQUIRE(filter.update(directions.data(), directions.size(), rate, update) == Status::ok);
        REQUIRE(convergence(predicted, directions.data(), directions.size(), rate, filter, update.share, diagnostics) ==
                Status::ok);
        CHECK(diagnostics.flow_norm >= std::sqrt(6.0));
        CHECK(diagnostics.trace_ratio == filter.ellipsoid().shape.trace() / predicted.prior_shape().trace());
      }
      CHECK(update.margin > 0);
      CHECK(form_of(filter.ellipsoid(), truth) <= 1);
      if (k >= 5) {
        error += state_error(filter.ellipsoid().center, truth).head<3>().norm() / 15;
      }
    }
    CHECK(error < 3.5 * 0.017453292519943295);
  }
}

TEST_CASE("Predicting in one go is predicting in many and a set moved without error holds its moved states") {
  Random random(2);
  const Set start{orbit_state<double>(), 1e-8 * random.positive_definite<6>(10)};
  Filter whole = make_filter(orbit_flow(), start);
  Filter parts = make_filter(orbit_flow(), start);
  REQUIRE(whole.predict(interval, {}) == Status::ok);
  for (int k = 1; k <= 30; ++k) {
    REQUIRE(parts.predict(interval * k / 30, {}) == Status::ok);
  }
  CHECK(state_error(whole.ellipsoid().center, parts.ellipsoid().center).norm() <= 1e-12);
  CHECK((whole.ellipsoid().shape - parts.ellipsoid().shape).norm() <= 1e-11 * whole.ellipsoid().shape.norm());
  CHECK((whole.transition() - parts.transition()).norm() <= 1e-11 * whole.transition().norm());

  const Matrix6<double> root = start.shape.llt().matrixL();
  double worst = 0;
  for (int sample = 0; sample < 30; ++sample) {
    const State moved = orbit_truth(retract(start.center, Vector6<double>(root * random.unit_vector<6>())), 0, interval,
                                    Vector3<double>::Zero());
    worst = std::max(worst, std::abs(form_of(whole.ellipsoid(), moved) - 1));
  }
  CHECK(worst < 0.02);  // second order of 1e-4 and the integrator's 1e-6, in a set with axes from 1e-5 up
}

TEST_CASE("A prediction over no time changes nothing") {
  Random random(3);
  for (int trial = 0; trial < 20; ++trial) {
    const Set start{orbit_state<double>(), 1e-2 * random.positive_definite<6>(10)};
    Filter filter = make_filter(orbit_flow(), start);
    REQUIRE(filter.predict(interval, {}) == Status::ok);
    const Direction<double> direction = measure(random, filter.ellipsoid().center, 1, 0.1)[0];
    Update<double> update{};
    REQUIRE(filter.update(&direction, 1, update) ==
            Status::ok);  // leaves an attitude that is a rotation but for rounding
    const Filter before = filter;
    REQUIRE(filter.predict(interval, {}) == Status::ok);
    check_same(filter, before);
  }
}

TEST_CASE("An unknown torque anywhere in its ellipsoid keeps the state inside") {
  Random random(3);
  const Matrix3<double> torque_shape = 1e-4 * random.positive_definite<3>(5);
  const Matrix3<double> torque_root = torque_shape.llt().matrixL();
  const Set start{orbit_state<double>(), 1e-8 * Matrix6<double>::Identity()};
  Filter filter = make_filter(orbit_flow(torque_shape), start);
  REQUIRE(filter.predict(interval, {}) == Status::ok);
  double worst = 0;
  for (int sample = 0; sample < 40; ++sample) {
    const Vector3<double> torque = torque_root * random.unit_vector<3>();
    worst = std::max(worst, form_of(filter.ellipsoid(), orbit_truth(start.center, 0, interval, torque)));
  }
  CHECK(worst <= 1);
  CHECK(worst > 0.2);  // a torque that stays the same is among the worst there are
}

TEST_CASE("A call that fails leaves the filter as it was") {
  Random random(4);
  Filter filter = make_filter(orbit_flow(), {orbit_state<double>(), 1e-2 * Matrix6<double>::Identity()});
  REQUIRE(filter.predict(0.5, {}) == Status::ok);
  const Filter before = filter;
  Update<double> update{0.5, 3};
  const State truth = filter.ellipsoid().center;
  auto directions = measure(random, truth, 3, 0.01);
  const AngularVelocity<double> rate{truth.angular_velocity, 1e-4 * Matrix3<double>::Identity()};

  CHECK(filter.predict(0.4, {}) == Status::out_of_range);
  CHECK(filter.predict(not_a_number, {}) == Status::not_finite);
  CHECK(filter.predict(1e12, {}) == Status::too_many_steps);
  CHECK(filter.predict(1.0, {Vector3<double>(not_a_number, 0, 0)}) == Status::not_finite);
  check_same(filter, before);

  auto bad = directions;
  bad[2].body.setZero();
  CHECK(filter.update(bad.data(), bad.size(), rate, update) == Status::zero_direction);
  CHECK(filter.update(bad.data(), bad.size(), update) == Status::zero_direction);
  CHECK(filter.update(bad.data(), 0, update) == Status::out_of_range);
  for (const std::size_t count : {1U, 2U}) {
    CHECK(filter.update(nullptr, count, rate, update) == Status::out_of_range);
    CHECK(filter.update(nullptr, count, update) == Status::out_of_range);
  }
  check_same(filter, before);
  CHECK(update.margin == 3);

  // A rate that cannot be.
  const AngularVelocity<double> wrong{truth.angular_velocity + Vector3<double>(5, 0, 0), rate.bound};
  CHECK(filter.update(directions.data(), 3, wrong, update) == Status::empty_intersection);
  CHECK(update.margin < 0);
  CHECK(filter.update(wrong, update) == Status::empty_intersection);
  CHECK(filter.update(AngularVelocity<double>{truth.angular_velocity, Matrix3<double>::Zero()}, update) ==
        Status::not_positive_definite);
  check_same(filter, before);

  REQUIRE(filter.update(directions.data(), 3, rate, update) == Status::ok);
  CHECK(filter.transition() == Matrix6<double>::Identity());
}

TEST_CASE("Collinear directions count one by one") {
  Random random(5);
  const State truth = orbit_state<double>();
  Filter filter = make_filter(orbit_flow(), {truth, 1e-2 * Matrix6<double>::Identity()});
  const Vector3<double> e(0, 0, 1);
  const Vector3<double> b = truth.attitude.transpose() * e;
  const std::vector<Direction<double>> twice(2, Direction<double>::within(e, b, 0.01));
  Update<double> update{};
  REQUIRE(filter.update(twice.data(), 2, update) == Status::ok);
  const Matrix3<double> shape = filter.ellipsoid().shape.topLeftCorner<3, 3>();
  CHECK(std::sqrt(b.dot(shape * b)) >= 0.1);  // about the direction nothing was learned
  CHECK(std::sqrt(e.cross(b).normalized().dot(shape * e.cross(b).normalized())) < 0.05);
}

TEST_CASE("The paper's estimator alone refuses what determines no attitude and is else the same to the last bit") {
  Random random(8);
  const State truth = orbit_state<double>();
  const Set start{truth, 1e-2 * Matrix6<double>::Identity()};
  AttitudeFilter<Flow, PaperEstimator> with;
  AttitudeFilter<Flow, DeterminedPaperEstimator> alone;
  REQUIRE(with.make(orbit_flow(), SizeCriterion<double, 6>::trace(), 0.0, start, with) == Status::ok);
  REQUIRE(alone.make(orbit_flow(), SizeCriterion<double, 6>::trace(), 0.0, start, alone) == Status::ok);
  const std::vector<Direction<double>> directions = measure(random, truth, 3, 0.01);
  const AngularVelocity<double> rate{truth.angular_velocity, 1e-4 * Matrix3<double>::Identity()};
  Update<double> update{};
  CHECK(alone.update(directions.data(), 1, rate, update) == Status::attitude_undetermined);
  CHECK(alone.ellipsoid().shape == start.shape);
  REQUIRE(with.update(directions.data(), 3, rate, update) == Status::ok);
  REQUIRE(alone.update(directions.data(), 3, rate, update) == Status::ok);
  CHECK(alone.ellipsoid().shape == with.ellipsoid().shape);
  CHECK(alone.ellipsoid().center.attitude == with.ellipsoid().center.attitude);
}

TEST_CASE("Directions and a rate are fused at once where they determine an attitude and else one after the other") {
  struct Case {
    std::vector<Vector3<double>> references;
    double share, margin, trace;
    Vector3<double> first_row;  // of the attitude
  };
  // As `AttitudeFilter.update` in Python said before the core decided this.
  const std::vector<Case> cases{{{},
                                 0.8825246745155377,
                                 0.9655698621496491,
                                 0.20645531017862542,
                                 {0.984493089445251, -0.14874777584584944, -0.0929916986373382}},
                                {{{0, 0.6, 0.8}},
                                 0.8579133668176495,
                                 0.6927005961302739,
                                 0.12704328110832838,
                                 {0.9972743762685577, -0.0723371980122854, -0.014530940158512962}},
                                {{{0, 0.6, 0.8}, {0, -0.6, -0.8}},
                                 0.8579064061563434,
                                 0.6927005961302739,
                                 0.12704039812072385,
                                 {0.9972753679813408, -0.07232594926740074, -0.014518866355542736}},
                                {{{0, 0.6, 0.8}, {1, 0, 0}},
                                 0.36423614510031316,
                                 0.6830624042068474,
                                 0.08828408615268447,
                                 {0.999949062890224, -0.00395761382009464, -0.009284875756530909}}};
  RigidBody<double> body;
  REQUIRE(RigidBody<double>::make(Matrix3<double>(Vector3<double>(3, 2, 1).asDiagonal()), body) == Status::ok);
  using FreeFlow = RigidBodyFlow<double, FreeBody<double>>;
  using FreeFilter = AttitudeFilter<FreeFlow, FirstOrderEstimator>;
  FreeFlow flow;
  REQUIRE(FreeFlow::make(body, {}, 0.05, 2, Matrix3<double>::Zero(), flow) == Status::ok);
  Vector6<double> widths;
  widths << 0.04, 0.05, 0.06, 0.01, 0.02, 0.03;
  Set start{{Matrix3<double>::Identity(), Vector3<double>(0.1, -0.2, 0.3)}, widths.asDiagonal()};
  start.shape(0, 3) = start.shape(3, 0) = 0.005;
  const AngularVelocity<double> rate{Vector3<double>(0.11, -0.19, 0.29), 0.05 * 0.05 * Matrix3<double>::Identity()};
  const AngularVelocity<double> wrong{Vector3<double>(5, 0, 0), rate.bound};
  for (const Case& c : cases) {
    CAPTURE(c.references.size());
    std::vector<Direction<double>> directions;
    for (const Vector3<double>& e : c.references) {
      const Vector3<double> b(e.x() - 0.02 * e.y(), e.y() + 0.02 * e.x(), e.z());
      directions.push_back(Direction<double>::within(e, b, 0.1));
    }
    FreeFilter filter;
    REQUIRE(FreeFilter::make(flow, SizeCriterion<double, 6>::trace(), 0.0, start, filter) == Status::ok);
    REQUIRE(filter.predict(0.5, {}) == Status::ok);
    Update<double> update{};
    const Matrix6<double> before = filter.ellipsoid().shape;
    CHECK(filter.update(directions.data(), directions.size(), wrong, update) == Status::empty_intersection);
    CHECK(update.margin < 0);
    CHECK(filter.ellipsoid().shape == before);
    const FreeFilter predicted = filter;
    REQUIRE(filter.update(directions.data(), directions.size(), rate, update) == Status::ok);
    Convergence<double> diagnostics{};
    CHECK(convergence(predicted, directions.data(), directions.size(), rate, filter, update.share, diagnostics) ==
          (directions.size() == 2 && c.share < 0.5 ? Status::ok : Status::attitude_undetermined));
    CHECK(update.share == doctest::Approx(c.share).epsilon(1e-7));
    CHECK(update.margin == doctest::Approx(c.margin).epsilon(1e-7));
    CHECK(filter.ellipsoid().shape.trace() == doctest::Approx(c.trace).epsilon(1e-7));
    CHECK((filter.ellipsoid().center.attitude.row(0).transpose() - c.first_row).norm() < 1e-7);
  }
}

TEST_CASE("A filter cannot be made of what is no state") {
  Filter filter;
  const Flow flow = orbit_flow();
  const auto criterion = SizeCriterion<double, 6>::trace();
  Set start{orbit_state<double>(), Matrix6<double>::Identity()};
  CHECK(Filter::make(flow, criterion, not_a_number, start, filter) == Status::not_finite);
  start.center.attitude *= 1.1;
  CHECK(Filter::make(flow, criterion, 0.0, start, filter) == Status::not_a_rotation);
  start.center.attitude /= 1.1;
  start.shape(0, 0) = -1;
  CHECK(Filter::make(flow, criterion, 0.0, start, filter) == Status::not_positive_definite);
  CHECK(Filter::make(flow, SizeCriterion<double, 6>::weighted_trace(-Matrix6<double>::Identity()), 0.0, start,
                     filter) == Status::not_positive_definite);
}

TEST_CASE("A filter starts at a rotation although the one that it is given has half the digits") {
  Set start{orbit_state<double>(), Matrix6<double>::Identity()};
  CHECK(make_filter(orbit_flow(), start).ellipsoid().center.attitude == start.center.attitude);
  const Matrix3<double> exact = start.center.attitude;
  start.center.attitude(1, 2) += 3e-10;
  const Matrix3<double> made = make_filter(orbit_flow(), start).ellipsoid().center.attitude;
  CHECK((made.transpose() * made - Matrix3<double>::Identity()).norm() < 1e-15);
  CHECK((made - exact).norm() < 3e-10);
}

TEST_CASE("The gyro flow holds every bias and noise and drift within their bounds and its rate is an output") {
  Random random(6);
  using GyroFilter = AttitudeFilter<GyroFlow<double>, FirstOrderEstimator>;
  const double noise = 2e-4;
  const double drift = 1e-5;
  GyroFlow<double> flow;
  REQUIRE(GyroFlow<double>::make(noise * noise * Matrix3<double>::Identity(),
                                 drift * drift * Matrix3<double>::Identity(), flow) == Status::ok);
  double worst = 0;
  for (int trial = 0; trial < 50; ++trial) {
    GyroState<double> truth{random.rotation(), 0.01 * random.normal_matrix<3>()};
    const StateEllipsoid<GyroState<double>> start{retract(truth, Vector6<double>(1e-3 * random.in_ball<6>())),
                                                  1e-6 * Matrix6<double>::Identity()};
    GyroFilter filter;
    REQUIRE(GyroFilter::make(flow, SizeCriterion<double, 6>::trace(), 0.0, start, filter) == Status::ok);
    const double h = 0.1;
    for (int k = 0; k < 20; ++k) {
      const Vector3<double> rate = random.normal_matrix<3>();
      const Vector3<double> change = h * drift * random.unit_vector<3>();
      // The mean over the interval, of a bias that changes evenly.
      const Vector3<double> gyro = rate + truth.gyro_bias + 0.5 * change + noise * random.unit_vector<3>();
      Ellipsoid<double, 3> rates;
      REQUIRE(flow.angular_velocity(filter.ellipsoid(), {gyro}, rates) == Status::ok);
      CHECK(support(rates, Vector3<double>(rate.normalized())) + 0.5 * h * drift >= rate.norm());
      REQUIRE(filter.predict((k + 1) * h, {gyro}) == Status::ok);
      truth.attitude = truth.attitude * exp(h * rate);
      truth.gyro_bias += change;
      double form = 0;
      REQUIRE(quadratic_form(filter.ellipsoid(), truth, form) == Status::ok);
      worst = std::max(worst, form);
    }
  }
  CHECK(worst <= 1);
  CHECK(worst > 0.5);
}

TEST_CASE("A steady drift without noise stays inside") {
  // An interval of one second at a drift that outweighs all else.
  GyroFlow<double> flow;
  const double drift = 1e-3;
  REQUIRE(GyroFlow<double>::make(Matrix3<double>::Zero(), drift * drift * Matrix3<double>::Identity(), flow) ==
          Status::ok);
  const GyroState<double> start{Matrix3<double>::Identity(), Vector3<double>::Zero()};
  Prediction<GyroState<double>> prediction;
  const Vector3<double> rate(0.1, -0.2, 0.3);
  const Vector3<double> change(0, 0, 0.99 * drift);
  REQUIRE(flow.predict(0.0, 1.0, {rate + 0.5 * change}, {start, 1e-16 * Matrix6<double>::Identity()},
                       SizeCriterion<double, 6>::trace(), prediction) == Status::ok);
  double form = 0;
  REQUIRE(quadratic_form(prediction.ellipsoid, GyroState<double>{exp(rate), change}, form) == Status::ok);
  CHECK(form <= 1);
  CHECK(form > 0.9);
}

TEST_CASE("A set that grows beyond all numbers is refused and the filter stays") {
  Filter filter = make_filter(orbit_flow(), {orbit_state<double>(), 1e-2 * Matrix6<double>::Identity()});
  const Filter before = filter;
  CHECK(filter.predict(2e4, {}) == Status::unbounded);
  check_same(filter, before);
}

TEST_CASE("A direction measured on the wrong side contradicts the prediction") {
  const Vector3<double> e(0, 0, 1);
  for (const double degrees : {10.0, 60.0, 120.0, 170.0, 179.0, 180.0}) {
    const Vector3<double> b = exp(degrees * 0.017453292519943295 * Vector3<double>::UnitX()) * e;
    Filter filter = make_filter(
        orbit_flow(), {{Matrix3<double>::Identity(), Vector3<double>::Zero()}, 1e-2 * Matrix6<double>::Identity()});
    const Direction<double> direction = Direction<double>::within(e, b, 0.1);
    Update<double> update{};
    const Status status = filter.update(&direction, 1, update);
    CHECK(status == (degrees < 11.5 ? Status::ok : Status::empty_intersection));
  }
}

TEST_CASE("The gyro flow's transition agrees with central differences") {
  Random random(7);
  GyroFlow<double> flow;
  REQUIRE(GyroFlow<double>::make(Matrix3<double>::Zero(), Matrix3<double>::Zero(), flow) == Status::ok);
  const StateEllipsoid<GyroState<double>> start{{random.rotation(), random.normal_matrix<3>()},
                                                Matrix6<double>::Identity()};
  const GyroFlow<double>::Input input{random.normal_matrix<3>()};
  const auto moved = [&](const Vector6<double>& x) {
    Prediction<GyroState<double>> result;
    REQUIRE(flow.predict(0.0, 0.7, input, {retract(start.center, x), start.shape}, SizeCriterion<double, 6>::trace(),
                         result) == Status::ok);
    return result;
  };
  const auto center = moved(Vector6<double>::Zero());
  for (int j = 0; j < 6; ++j) {
    const Vector6<double> x = 1e-5 * Vector6<double>::Unit(j);
    const Vector6<double> column = (state_error(center.ellipsoid.center, moved(x).ellipsoid.center) -
                                    state_error(center.ellipsoid.center, moved(-x).ellipsoid.center)) /
                                   2e-5;
    CHECK((column - center.transition.col(j)).norm() <= 1e-9);
  }
}

TEST_CASE("The extent of a set is that of its sampled states") {
  Random random(8);
  const Set sized{{random.rotation(), random.normal_matrix<3>()}, 1e-2 * random.positive_definite<6>(50)};
  Extent<double> result{};
  REQUIRE(extent(sized, result) == Status::ok);
  const Matrix6<double> root = sized.shape.llt().matrixL();
  double angle = 0;
  Vector3<double> reference = Vector3<double>::Zero();
  Vector6<double> body = Vector6<double>::Zero();
  for (int sample = 0; sample < 200000; ++sample) {
    const Vector6<double> x = root * random.unit_vector<6>();
    angle = std::max(angle, x.head<3>().norm());
    reference = reference.cwiseMax((sized.center.attitude * x.head<3>()).cwiseAbs());
    body = body.cwiseMax(x.cwiseAbs());
  }
  CHECK(angle <= result.largest_angle);
  CHECK(angle >= 0.95 * result.largest_angle);
  for (int i = 0; i < 3; ++i) {
    CHECK(reference(i) <= result.half_widths_reference(i));
    CHECK(reference(i) >= 0.95 * result.half_widths_reference(i));
  }
  for (int i = 0; i < 6; ++i) {
    CHECK(body(i) <= result.half_widths_body(i));
    CHECK(body(i) >= 0.95 * result.half_widths_body(i));
  }
}

TEST_CASE("The filter works in single precision") {
  using FloatFlow = RigidBodyFlow<float, FreeBody<float>>;
  using FloatFilter = AttitudeFilter<FloatFlow, PaperEstimator>;
  FloatFlow flow;
  REQUIRE(FloatFlow::make(spacecraft<float>(), FreeBody<float>(), 0.01F, 2, Matrix3<float>::Zero(), flow) ==
          Status::ok);
  FloatFilter filter;
  const RigidBodyState<float> state{Matrix3<float>::Identity(), Vector3<float>(0.1F, 0.2F, 0.3F)};
  REQUIRE(FloatFilter::make(flow, SizeCriterion<float, 6>::volume(), 0.0F, {state, 0.01F * Matrix6<float>::Identity()},
                            filter) == Status::ok);
  REQUIRE(filter.predict(1.0F, {}) == Status::ok);
  Update<float> update{};
  REQUIRE(filter.update(MeasuredAttitude<float>{filter.ellipsoid().center.attitude,
                                                Matrix3<float>(1e-4F * Matrix3<float>::Identity())},
                        update) == Status::ok);
  CHECK(update.margin == doctest::Approx(1));
}
