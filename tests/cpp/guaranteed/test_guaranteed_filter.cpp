// The guaranteed filter: the truth is in its set, what it claims, its policies, and that nothing changes on failure.
#include <doctest/doctest.h>

#include "support/filter_scene.hpp"

using namespace elliptude;
using namespace elliptude::testing;

TEST_CASE("from nothing, and with one direction at a time, the truth stays in the set") {
  double worst = 0;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    Scene scene(100 + seed);
    BodyFilter filter = filter_with({});
    CHECK(filter.claim() == Claim::none);
    CHECK_FALSE(filter.knows_attitude());
    Report update;
    // One direction determines no attitude; the rate alone is kept.
    REQUIRE(filter.update({scene.directions.data(), 1, &scene.rate, nullptr}, update) == Status::ok);
    CHECK(update.claim == Claim::none);
    CHECK_FALSE(filter.knows_attitude());
    // Two do, with the rate that was measured before.
    REQUIRE(filter.update({scene.directions.data(), 2, nullptr, nullptr}, update) == Status::ok);
    CHECK(update.claim == Claim::unconditional);
    CHECK(form_of(filter, scene.truth) <= 1);
    for (std::size_t k = 0; k < 40; ++k) {
      scene.move(0.1);
      REQUIRE(filter.predict(0.1 * static_cast<double>(k + 1), {}) == Status::ok);
      worst = std::fmax(worst, form_of(filter, scene.truth));
      CHECK(form_of(filter, scene.truth) <= 1);
      REQUIRE(filter.update({&scene.directions[k % 4], 1, k % 3 == 0 ? &scene.rate : nullptr, nullptr}, update) ==
              Status::ok);
      CHECK(update.claim == Claim::unconditional);
      CHECK(update.margin >= 0);
      worst = std::fmax(worst, form_of(filter, scene.truth));
      CHECK(form_of(filter, scene.truth) <= 1);
    }
  }
  MESSAGE("worst form " << worst);
}

TEST_CASE("a lost prediction: the attitude is forgotten, the vector is not, and what was conditional stays so") {
  for (const bool conditional : {false, true}) {
    Scene scene(7);
    BodyFilter::Settings settings;
    settings.policy = Policy::drop_measurement;
    BodyFilter filter = filter_with(settings);
    Report update;
    REQUIRE(filter.update(scene.all(), update) == Status::ok);
    if (conditional) {
      scene.directions[2] = measured(scene.truth, scene.references[2], Vector3d(0.5, 0.5, 0.5));
      REQUIRE(filter.update(scene.all(), update) == Status::ok);
      CHECK(update.dropped == direction_bit(2));
      CHECK(update.contradicting == direction_bit(2));
      CHECK(update.margin < 0);
      CHECK(filter.claim() == Claim::conditional);
      // All of them were tried, and all but each one.
      CHECK(update.fusions == 1 + detail::sensors::number_of(detail::sensors::present(scene.all())));
      CHECK(update.steps <= 12 * update.fusions);
      CHECK_FALSE(update.ended_by_limit);
      CHECK(form_of(filter, scene.truth) <= 1);
    }
    REQUIRE(filter.predict(400, {}) == Status::ok);
    CHECK_FALSE(filter.knows_attitude());
    CHECK(filter.claim() == Claim::none);
    CHECK(filter.time() == 400);
    // The rate is still known from what came before, and is needed here.
    scene.measure();
    REQUIRE(filter.update({scene.directions.data(), 3, nullptr, nullptr}, update) == Status::ok);
    CHECK(filter.knows_attitude());
    CHECK(filter.claim() == (conditional ? Claim::conditional : Claim::unconditional));
  }
}

TEST_CASE("a linear measurement that contradicts is reported alone, and nothing of an update before it") {
  Scene scene(7);
  BodyFilter filter = filter_with({});
  Report update;
  REQUIRE(filter.update(scene.all(), update) == Status::ok);
  update.fusions = 9;
  update.steps = -1;
  update.contradicting = direction_bit(3);
  update.ended_by_limit = true;
  LinearMeasurement<double, 1> linear{Vector<double, 1>::Constant(100), Matrix<double, 1, 6>::Zero(),
                                      Matrix<double, 1>::Constant(1e-3)};
  linear.h(0, 5) = 1;
  REQUIRE(filter.update(linear, update) == Status::empty_intersection);
  CHECK(update.margin < 0);
  CHECK(update.fusions == 1);
  CHECK(update.steps >= 0);
  CHECK(update.contradicting == 0);
  CHECK_FALSE(update.ended_by_limit);
}

TEST_CASE("policies after a contradiction") {
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart}) {
    Scene scene(8);
    BodyFilter::Settings settings;
    settings.policy = policy;
    settings.regain_after = 3;
    BodyFilter filter = filter_with(settings);
    Report update;
    REQUIRE(filter.update(scene.all(), update) == Status::ok);
    scene.move(0.1);
    REQUIRE(filter.predict(0.1, {}) == Status::ok);
    const Snapshot before = snapshot(filter);
    scene.directions[1] = measured(scene.truth, scene.references[1], Vector3d(0.4, -0.4, 0.4));
    const Status status = filter.update(scene.all(), update);
    CHECK(update.margin < 0);
    if (policy == Policy::raise) {
      CHECK(status == Status::empty_intersection);
      CHECK(update.contradicting == direction_bit(1));
      CHECK(same(before, snapshot(filter)));
      continue;
    }
    REQUIRE(status == Status::ok);
    CHECK(update.dropped == direction_bit(1));
    CHECK(filter.claim() == Claim::conditional);
    CHECK(form_of(filter, scene.truth) <= 1);
    for (int k = 2; k < 6; ++k) {
      scene.move(0.1);
      REQUIRE(filter.predict(0.1 * k, {}) == Status::ok);
      REQUIRE(filter.update(scene.all(), update) == Status::ok);
      CHECK(form_of(filter, scene.truth) <= 1);
      CHECK(filter.claim() == (k < 4 ? Claim::conditional : Claim::unconditional));
    }
  }
}

TEST_CASE("two directions that contradict each other where nothing else is known are both left out") {
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart}) {
    Scene scene(10);
    BodyFilter::Settings settings;
    settings.policy = policy;
    BodyFilter filter = filter_with(settings);
    const Snapshot before = snapshot(filter);
    const Vector3d right = scene.directions[1].body;
    scene.directions[1].body = exp(Vector3d(0.3, 0.2, 0.1)) * Vector3d(0.5 * (right + scene.directions[0].body));
    const Measurements<double> both{scene.directions.data(), 2, &scene.rate, nullptr};
    Report update;
    const Status status = filter.update(both, update);
    CHECK(update.margin < 0);
    CHECK((update.contradicting & (direction_bit(0) | direction_bit(1))) != 0);
    if (policy == Policy::raise) {
      CHECK(status == Status::empty_intersection);
      CHECK(same(before, snapshot(filter)));
      CHECK_FALSE(filter.knows_vector());
      continue;
    }
    REQUIRE(status == Status::ok);
    CHECK(update.dropped == (direction_bit(0) | direction_bit(1)));
    CHECK(update.claim == Claim::none);
    CHECK_FALSE(filter.knows_attitude());
    CHECK(filter.knows_vector());
    // Nothing of them was taken up: what comes rests on nothing that was left out.
    scene.directions[1].body = right;
    REQUIRE(filter.update(both, update) == Status::ok);
    CHECK(filter.claim() == Claim::unconditional);
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("two directions that contradict each other say so where nothing tells the vector") {
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart}) {
    Scene scene(10);
    BodyFilter::Settings settings;
    settings.policy = policy;
    BodyFilter filter = filter_with(settings);
    const Measurements<double> both{scene.directions.data(), 2, nullptr, nullptr};
    Report update;
    // They agree: no set, as the angular velocity may be any, and nothing is wrong.
    REQUIRE(filter.update(both, update) == Status::ok);
    CHECK(update.claim == Claim::none);
    CHECK(update.dropped == 0);
    CHECK(update.margin > 0);
    const Snapshot before = snapshot(filter);
    scene.directions[1].body =
        exp(Vector3d(0.3, 0.2, 0.1)) * Vector3d(0.5 * (scene.directions[1].body + scene.directions[0].body));
    const Status status = filter.update(both, update);
    CHECK(update.margin < 0);
    CHECK((update.contradicting & (direction_bit(0) | direction_bit(1))) != 0);
    if (policy == Policy::raise) {
      CHECK(status == Status::empty_intersection);
      CHECK(same(before, snapshot(filter)));
      continue;
    }
    REQUIRE(status == Status::ok);
    CHECK(update.dropped == (direction_bit(0) | direction_bit(1)));
    CHECK(update.claim == Claim::none);
  }
}

TEST_CASE("directions that are seen in a mirror contradict each other, where Wahba's problem is undetermined too") {
  // Two axes of a sensor are swapped: each pair of directions fits some attitude, and no attitude fits all three.
  for (const double angle : {0.01, 0.1, 0.5, 0.9}) {
    std::array<Direction<double>, 3> mirrored;
    for (int k = 0; k < 3; ++k) {
      mirrored[static_cast<std::size_t>(k)] =
          Direction<double>::within(Vector3d::Unit(k), Vector3d::Unit(k == 2 ? 2 : 1 - k), angle);
    }
    for (const Policy policy : {Policy::raise, Policy::drop_measurement}) {
      BodyFilter::Settings settings;
      settings.policy = policy;
      BodyFilter filter = filter_with(settings);
      Report update;
      CAPTURE(angle);
      const AngularVelocity<double> rate{Vector3d(0.1, 0.2, 0.3), 0.01 * Matrix3<double>::Identity()};
      const Status status = filter.update({mirrored.data(), mirrored.size(), &rate, nullptr}, update);
      CHECK(status == (policy == Policy::raise ? Status::empty_intersection : Status::ok));
      CHECK(update.margin < 0);
      if (policy == Policy::drop_measurement) {
        CHECK(update.dropped != 0);
        CHECK(filter.claim() != Claim::unconditional);
      }
    }
  }
}

TEST_CASE("restart forgets a prediction that was wrong") {
  Scene scene(9);
  BodyFilter::Settings settings;
  settings.policy = Policy::restart;
  BodyFilter filter = filter_with(settings);
  Matrix6<double> shape = 1e-4 * Matrix6<double>::Identity();
  const State wrong{scene.truth.attitude * exp(Vector3d(1, 0, 0)), scene.truth.angular_velocity};
  REQUIRE(filter.start(GibbsEllipsoid<State>{wrong, shape}) == Status::ok);
  Report update;
  REQUIRE(filter.update(scene.all(), update) == Status::ok);
  CHECK_FALSE(update.prediction_used);
  CHECK(update.claim == Claim::conditional);
  CHECK(form_of(filter, scene.truth) <= 1);
}

TEST_CASE("relaxed: whatever one sensor says, the truth is in the set") {
  BodyFilter::Settings settings;
  settings.policy = Policy::relaxed;
  settings.most_wrong = 1;
  for (int trial = 0; trial < 20; ++trial) {
    Scene scene(200 + static_cast<std::uint64_t>(trial));
    BodyFilter filter = filter_with(settings);
    const GibbsEllipsoid<State> set{scene.truth, 0.01 * Matrix6<double>::Identity()};
    REQUIRE(filter.start(set) == Status::ok);
    for (int k = 1; k < 6; ++k) {
      scene.move(0.1);
      REQUIRE(filter.predict(0.1 * k, {}) == Status::ok);
      const auto wrong = static_cast<std::size_t>(scene.random.uniform(0, 5));
      const Vector3d error = scene.random.log_uniform(0.01, 1) * scene.random.unit_vector<3>();
      if (wrong < 4) {
        scene.directions[wrong] = measured(scene.truth, scene.references[wrong], error);
      } else {
        scene.rate.value += error;
      }
      Report update;
      REQUIRE(filter.update(scene.all(), update) == Status::ok);
      CHECK(form_of(filter, scene.truth) <= 1);
      CHECK(filter.claim() == Claim::unconditional);
      CHECK((update.dropped & ~(wrong < 4 ? direction_bit(wrong) : angular_velocity_bit)) == 0);
    }
  }
}

TEST_CASE("relaxed, from nothing: no set where one choice leaves the attitude open, no vector from one sensor") {
  BodyFilter::Settings settings;
  settings.policy = Policy::relaxed;
  settings.most_wrong = 1;
  Scene scene(10);
  BodyFilter filter = filter_with(settings);
  REQUIRE(filter.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) == Status::ok);
  // Without the first, two of the same direction are left: that choice comes first, and joins later.
  const std::vector<Direction<double>> directions{measured(scene.truth, scene.references[0], Vector3d(0.3, 0.3, 0)),
                                                  measured(scene.truth, scene.references[1], Vector3d::Zero()),
                                                  measured(scene.truth, scene.references[1], Vector3d(0, 0.001, 0))};
  Report update;
  REQUIRE(filter.update({directions.data(), 3, nullptr, nullptr}, update) == Status::ok);
  CHECK(update.claim == Claim::none);
  CHECK_FALSE(filter.knows_attitude());
  // The angular velocity may be what is wrong: it is not kept, and two steps later does not bound a set.
  BodyFilter other = filter_with(settings);
  AngularVelocity<double> lie{scene.truth.angular_velocity + Vector3d(3, 0, 0), 1e-4 * Matrix3d::Identity()};
  REQUIRE(other.update({scene.directions.data(), 1, &lie, nullptr}, update) == Status::ok);
  REQUIRE(other.update({scene.directions.data(), 4, nullptr, nullptr}, update) == Status::ok);
  CHECK_FALSE(other.knows_attitude());
}

TEST_CASE("relaxed: measurements that are not valid are refused wherever they stand") {
  BodyFilter::Settings settings;
  settings.policy = Policy::relaxed;
  for (int wrong = 1; wrong <= 2; ++wrong) {
    settings.most_wrong = wrong;
    for (std::size_t at = 0; at < 4; ++at) {
      Scene scene(12);
      BodyFilter filter = filter_with(settings);
      REQUIRE(filter.start(GibbsEllipsoid<State>{scene.truth, 0.01 * Matrix6<double>::Identity()}) == Status::ok);
      const Snapshot before = snapshot(filter);
      scene.directions[at].body(1) = std::nan("");
      Report update;
      CHECK(filter.update({scene.directions.data(), 4, nullptr, nullptr}, update) == Status::not_finite);
      CHECK(filter.update({&scene.directions[at], 1, nullptr, nullptr}, update) == Status::not_finite);
      CHECK(same(before, snapshot(filter)));
    }
  }
}

TEST_CASE("bad input is refused, and nothing changes") {
  Scene scene(13);
  BodyFilter filter = filter_with({});
  REQUIRE(filter.predict(1, {}) == Status::ok);
  Report first;
  REQUIRE(filter.update({nullptr, 0, &scene.rate, nullptr}, first) == Status::ok);
  REQUIRE(filter.knows_vector());
  for (const bool started : {false, true}) {
    if (started) {
      REQUIRE(filter.start(GibbsEllipsoid<State>{scene.truth, 0.01 * Matrix6<double>::Identity()}) == Status::ok);
    }
    const Snapshot before = snapshot(filter);
    Report update;
    CHECK(filter.predict(0.5, {}) == Status::out_of_range);
    for (const double bad : {std::nan(""), HUGE_VAL}) {
      BodyInput<double> input;
      input.control_torque(1) = bad;
      CHECK(filter.predict(2, input) == Status::not_finite);
      input = {};
      input.wheel_momentum(2) = bad;
      CHECK(filter.predict(2, input) == Status::not_finite);
    }
    CHECK(filter.predict(std::nan(""), {}) == Status::not_finite);
    CHECK(filter.predict(HUGE_VAL, {}) == Status::not_finite);
    std::vector<Direction<double>> directions = scene.directions;
    directions[3].reference.setZero();
    CHECK(filter.update({directions.data(), 4, nullptr, nullptr}, update) != Status::ok);
    directions = scene.directions;
    directions[0].bound(0, 0) = -1;
    CHECK(filter.update({directions.data(), 4, nullptr, nullptr}, update) != Status::ok);
    AngularVelocity<double> rate = scene.rate;
    rate.value(2) = std::nan("");
    CHECK(filter.update({nullptr, 0, &rate, nullptr}, update) == Status::not_finite);
    const MeasuredAttitude<double> attitude{2 * Matrix3d::Identity(), Matrix3d::Identity()};
    CHECK(filter.update({nullptr, 0, nullptr, &attitude}, update) == Status::not_a_rotation);
    directions.assign(33, scene.directions[0]);
    CHECK(filter.update({directions.data(), 33, nullptr, nullptr}, update) == Status::out_of_range);
    Matrix6<double> flat = Matrix6<double>::Identity();
    flat(5, 5) = 0;
    CHECK(filter.start(GibbsEllipsoid<State>{scene.truth, flat}) == Status::not_positive_definite);
    CHECK(same(before, snapshot(filter)));
  }
  BodyFilter::Settings settings;
  settings.most_wrong = 3;
  CHECK(BodyFilter::make(filter.flow(), settings, 0, filter) == Status::out_of_range);
  settings = {};
  settings.regain_after = 0;
  CHECK(BodyFilter::make(filter.flow(), settings, 0, filter) == Status::out_of_range);
  CHECK(BodyFilter::make(filter.flow(), {}, std::nan(""), filter) == Status::not_finite);
}

TEST_CASE("gyro: the rate is an input, and the truth stays in the set") {
  using Flow = GuaranteedGyroFlow<double>;
  using Filter = GuaranteedFilter<Flow>;
  Random random(14);
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = 1e-4 * Matrix3d::Identity();
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::first_sample, flow) == Status::ok);
  Filter filter;
  REQUIRE(Filter::make(flow, {}, 0, filter) == Status::ok);
  REQUIRE(filter.bound_vector({Vector3d::Zero(), 0.01 * Matrix3d::Identity()}) == Status::ok);
  GyroState<double> truth{random.rotation(), 0.099 * random.unit_vector<3>()};
  const Vector3d rate = random.normal_matrix<3>();
  const AngularVelocity<double> wrong{rate, Matrix3d::Identity()};
  Report update;
  CHECK(filter.update({nullptr, 0, &wrong, nullptr}, update) == Status::out_of_range);
  const Matrix3d axes = random.rotation();
  for (int k = 0; k < 60; ++k) {
    std::array<Direction<double>, 2> directions;
    for (int i = 0; i < 2; ++i) {
      const Vector3d body = exp(Vector3d(0.019 * random.unit_vector<3>())) * (truth.attitude.transpose() * axes.col(i));
      directions[static_cast<std::size_t>(i)] = Direction<double>::within(axes.col(i), body, 0.02);
    }
    REQUIRE(filter.update({&directions[static_cast<std::size_t>(k % 2)], k == 0 ? 2U : 1U, nullptr, nullptr}, update) ==
            Status::ok);
    REQUIRE(filter.knows_attitude());
    double form = 2;
    REQUIRE(quadratic_form(filter.ellipsoid(), truth, form) == Status::ok);
    CHECK(form <= 1);
    const Vector3d sample = rate + truth.gyro_bias + 0.0099 * random.unit_vector<3>();
    REQUIRE(filter.predict(0.1 * (k + 1), {sample}) == Status::ok);
    truth.attitude = truth.attitude * exp(Vector3d(0.1 * rate));
    REQUIRE(quadratic_form(filter.ellipsoid(), truth, form) == Status::ok);
    CHECK(form <= 1);
  }
}

TEST_CASE("a bias that is not estimated takes no share of the sum that bounds the attitude") {
  using GyroFlow = GuaranteedGyroFlow<double>;
  using GyroFilter = GuaranteedFilter<GyroFlow>;
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = 1e-6 * Matrix3d::Identity();
  GyroFlow flow;
  REQUIRE(GyroFlow::make(uncertainty, GyroFlow::IntervalRate::mean, flow) == Status::ok);
  GyroFilter filters[2];
  for (int i = 0; i < 2; ++i) {
    GyroFilter::Settings settings;
    settings.estimates_vector = i == 1;
    REQUIRE(GyroFilter::make(flow, settings, 0, filters[i]) == Status::ok);
  }
  GuaranteedUpdate<double> report;
  const Vector3d rate(0.3, -0.2, 0.1);
  const Vector3d noise(6e-4, 0, -8e-4);
  Matrix3d attitude = exp(Vector3d(1, -0.5, 0.7));
  const auto measured_at = [&](const Vector3d& reference, const Vector3d& error) {
    return Direction<double>::within(reference, exp(error) * (attitude.transpose() * reference), bound);
  };
  Direction<double> directions[2] = {measured_at(Vector3d::UnitX(), Vector3d(0, 0, bound)),
                                     measured_at(Vector3d::UnitZ(), Vector3d(bound, 0, 0))};
  // Without a bound of the bias there is no set.
  REQUIRE(filters[0].update({directions, 2, nullptr, nullptr}, report) == Status::ok);
  CHECK(report.claim == Claim::none);
  for (int step = 0; step < 40; ++step) {
    const Vector3d axis(bound * std::cos(step), bound * std::sin(step), 0);
    directions[0] = measured_at(Vector3d::UnitX(), axis);
    directions[1] = measured_at(Vector3d::UnitZ(), -axis);
    for (GyroFilter& filter : filters) {
      REQUIRE(filter.bound_vector({Vector3d::Zero(), 1e-18 * Matrix3d::Identity()}) == Status::ok);
      REQUIRE(filter.update({directions, 2, nullptr, nullptr}, report) == Status::ok);
      CHECK(report.claim == Claim::unconditional);
      double form = 2;
      REQUIRE(quadratic_form(filter.ellipsoid(), {attitude, Vector3d::Zero()}, form) == Status::ok);
      CHECK(form <= 1);
      REQUIRE(filter.predict(0.1 * (step + 1), {rate + noise}) == Status::ok);
    }
    const double ratio = filters[0].ellipsoid().shape.topLeftCorner<3, 3>().determinant() /
                         filters[1].ellipsoid().shape.topLeftCorner<3, 3>().determinant();
    CHECK(ratio < 0.5);
    attitude = attitude * exp(Vector3d(0.1 * rate));
  }
  BodyFilter::Settings settings;
  settings.estimates_vector = false;
  BodyFilter body;
  CHECK(BodyFilter::make(filter_with({}).flow(), settings, 0, body) == Status::out_of_range);
}
