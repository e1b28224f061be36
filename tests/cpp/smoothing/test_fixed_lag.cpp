// Fixed lag: the truth is inside, with errors at their bounds, and no set is wider than the filter's. (theory, sections 20.4 and 20.5)
#include <doctest/doctest.h>

#include "support/smoothing_scene.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using namespace elliptude::testing::smoothing;

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

TEST_CASE("fixed lag: turns over no time are moments of their own") {
  // Two turns with one stamp: the set from the second measurement is brought back over both.
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = 1e-8 * Matrix3d::Identity();
  GyroScene::Filter::Flow flow;
  REQUIRE(GyroScene::Filter::Flow::make(uncertainty, GyroScene::Filter::Flow::IntervalRate::mean, flow) == Status::ok);
  GyroScene::Filter filter;
  REQUIRE(GyroScene::Filter::make(flow, {}, 0, filter) == Status::ok);
  GyroState<double> truth{Matrix3d::Identity(), Vector3d::Zero()};
  Matrix6<double> shape = 1e-2 * Matrix6<double>::Identity();
  shape.bottomRightCorner<3, 3>() *= 1e-4;
  REQUIRE(filter.start(GibbsEllipsoid<GyroState<double>>{truth, shape}) == Status::ok);
  FixedLag<GyroScene::Filter, 4> lag;
  REQUIRE(FixedLag<GyroScene::Filter, 4>::make(filter, lag) == Status::ok);
  std::vector<GyroState<double>> truths{truth};
  for (const Vector3d& turn : {Vector3d(0.1, 0, 0), Vector3d(0.05, 0.06, 0)}) {
    REQUIRE(lag.predict_turn(1, turn, 1e-4) == Status::ok);
    truth.attitude = truth.attitude * exp(turn);
    truths.push_back(truth);
  }
  CHECK(lag.moments() == 3);
  const MeasuredAttitude<double> star{truth.attitude, 1e-6 * Matrix3d::Identity()};
  GuaranteedUpdate<double> report;
  REQUIRE(lag.update(Measurements<double>{nullptr, 0, nullptr, &star}, report) == Status::ok);
  for (std::size_t age = 0; age < 3; ++age) {
    SmoothedSet<GyroState<double>> set;
    REQUIRE(lag.smoothed(age, set) == Status::ok);
    CHECK(set.claim == Claim::unconditional);
    CHECK(set.uses_future == (age > 0));
    CHECK(form_of(set.set, truths[2 - age]) <= 1);
    CHECK(largest(set.set.shape, 0) < 2e-3);
  }
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

TEST_CASE("fixed lag: a filter whose flow has not been made is refused, one that knows no rate is not") {
  using Filter = GyroScene::Filter;
  using Lag = FixedLag<Filter, 3>;
  Lag lag;
  CHECK(Lag::make({}, lag) == Status::out_of_range);
  Filter filter;
  REQUIRE(Filter::make({}, {}, 2, filter) == Status::ok);
  CHECK(Lag::make(filter, lag) == Status::out_of_range);
  CHECK(lag.time() == 0);
  // It is told turns alone.
  GyroUncertainty<double> uncertainty;
  uncertainty.longest_interval = 0;
  Filter::Flow flow;
  REQUIRE(Filter::Flow::make(uncertainty, Filter::Flow::IntervalRate::first_sample, flow) == Status::ok);
  REQUIRE(Filter::make(flow, {}, 2, filter) == Status::ok);
  CHECK(Lag::make(filter, lag) == Status::ok);
  CHECK(lag.time() == 2);
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

TEST_CASE("fixed lag: after a contradiction equal claims still make sets no wider than the filter's") {
  using Flow = GuaranteedGyroFlow<double>;
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = Vector3d(1e-4, 1e-12, 1e-12).asDiagonal();
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean, flow) == Status::ok);
  GyroScene::Filter::Settings settings;
  settings.policy = Policy::drop_measurement;
  settings.regain_after = 1;
  GyroScene::Filter filter;
  REQUIRE(GyroScene::Filter::make(flow, settings, 0, filter) == Status::ok);
  REQUIRE(filter.bound_vector({Vector3d::Zero(), 1e-4 * Matrix3d::Identity()}) == Status::ok);
  Matrix6<double> shape = 1e-10 * Matrix6<double>::Identity();
  shape(1, 1) = 1e-4;
  REQUIRE(filter.start(GibbsEllipsoid<GyroState<double>>{{Matrix3d::Identity(), Vector3d::Zero()}, shape}) ==
          Status::ok);
  FixedLag<GyroScene::Filter, 8> lag;
  REQUIRE(FixedLag<GyroScene::Filter, 8>::make(filter, lag) == Status::ok);
  const auto sees = [&](double time, double angle, double within) {
    REQUIRE(lag.predict(time, {Vector3d::Zero(), -1, true}) == Status::ok);
    const MeasuredAttitude<double> star{exp(Vector3d(angle, 0, 0)), within * within * Matrix3d::Identity()};
    GuaranteedUpdate<double> report;
    REQUIRE(lag.update(Measurements<double>{nullptr, 0, nullptr, &star}, report) == Status::ok);
  };
  SmoothedSet<GyroState<double>> set;
  sees(1, 0.013, 1e-4);
  REQUIRE(lag.smoothed(1, set) == Status::ok);
  REQUIRE(lag.has_contradicted());
  sees(1.1, 0.7, 1e-4);  // dropped
  REQUIRE(lag.filter().claim() == Claim::conditional);
  const GibbsEllipsoid<GyroState<double>> then = lag.filter().ellipsoid();
  sees(1.2, 0.013, 0.1);  // agrees, so that the claim is regained by a wide set
  REQUIRE(lag.filter().claim() == Claim::unconditional);
  REQUIRE(lag.smoothed(1, set) == Status::ok);
  CHECK(set.claim == Claim::conditional);
  CHECK(largest(set.set.shape, 0) <= largest(then.shape, 0));
  CHECK(largest(Matrix6<double>(set.set.shape), 3) > 0);
  CHECK(set.vector.shape.trace() <= then.shape.bottomRightCorner<3, 3>().trace() * (1 + 1e-12));
}

TEST_CASE("fixed lag: what rests on a dropped measurement") {
  // A wrong direction is left out at the present: the present set is conditional, and tells earlier moments nothing that is unconditional.
  GyroScene scene(26);
  FixedLag<GyroScene::Filter, 4> lag;
  REQUIRE(FixedLag<GyroScene::Filter, 4>::make(GyroScene::filter(Policy::drop_measurement), lag) == Status::ok);
  REQUIRE(lag.predict(GyroScene::step, scene.move()) == Status::ok);
  update(lag, scene.directions(), 2);
  REQUIRE(lag.predict(2 * GyroScene::step, scene.move()) == Status::ok);
  update(lag, scene.directions(0.5), 1);
  REQUIRE(lag.filter().claim() == Claim::conditional);
  SmoothedSet<GyroState<double>> set;
  REQUIRE(lag.smoothed(0, set) == Status::ok);
  CHECK(set.claim == Claim::conditional);
  REQUIRE(lag.smoothed(1, set) == Status::ok);
  CHECK(set.claim == Claim::unconditional);
  CHECK_FALSE(set.uses_future);
  // Before there was a set, one comes from the present alone: it may be that of the moment before which is wrong.
  REQUIRE(lag.smoothed(2, set) == Status::ok);
  CHECK(set.claim == Claim::conditional);
  FixedLag<GyroScene::Filter, 4> other;
  REQUIRE(FixedLag<GyroScene::Filter, 4>::make(GyroScene::filter(Policy::drop_measurement), other) == Status::ok);
  REQUIRE(other.predict(GyroScene::step, scene.move()) == Status::ok);
  // Three directions at once, one of them wrong.
  const auto two = scene.directions();
  const std::array<Direction<double>, 4> four{two[0], two[1],
                                              measured(scene.truth.attitude, scene.references[0], 0.01, scene.random),
                                              measured(scene.truth.attitude, scene.references[2], 0.5, scene.random)};
  GuaranteedUpdate<double> report;
  REQUIRE(other.update(Measurements<double>{four.data(), 4, nullptr, nullptr}, report) == Status::ok);
  REQUIRE(other.filter().claim() == Claim::conditional);
  REQUIRE(other.smoothed(1, set) == Status::ok);
  CHECK(set.claim == Claim::conditional);
  CHECK(set.uses_future);
}

namespace {

/// A gyro that turns by at most `noise` in the second between two stars, and a filter that regains its claim by one.
struct LateLie {
  FixedLag<GyroScene::Filter, 8> lag;

  explicit LateLie(double noise) {
    using Flow = GuaranteedGyroFlow<double>;
    GyroUncertainty<double> uncertainty;
    uncertainty.noise = noise * noise * Matrix3d::Identity();
    Flow flow;
    REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::mean, flow) == Status::ok);
    GyroScene::Filter::Settings settings;
    settings.policy = Policy::drop_measurement;
    settings.regain_after = 1;
    settings.estimates_vector = false;
    GyroScene::Filter filter;
    REQUIRE(GyroScene::Filter::make(flow, settings, 0, filter) == Status::ok);
    REQUIRE(filter.bound_vector({Vector3d::Zero(), 1e-10 * Matrix3d::Identity()}) == Status::ok);
    REQUIRE(FixedLag<GyroScene::Filter, 8>::make(filter, lag) == Status::ok);
  }

  Claim sees(double time, double angle, double within) {
    const MeasuredAttitude<double> star{exp(Vector3d(angle, 0, 0)), within * within * Matrix3d::Identity()};
    GuaranteedUpdate<double> report;
    if (time > lag.time()) {
      REQUIRE(lag.predict(time, {Vector3d::Zero(), -1, true}) == Status::ok);
    }
    REQUIRE(lag.update(Measurements<double>{nullptr, 0, nullptr, &star}, report) == Status::ok);
    return lag.filter().claim();
  }

  SmoothedSet<GyroState<double>> check(std::size_t age, Claim claim) {
    SmoothedSet<GyroState<double>> set;
    REQUIRE(lag.smoothed(age, set) == Status::ok);
    CAPTURE(age);
    CHECK(set.claim == claim);
    CHECK(form_in_product(set.set, {Matrix3d::Identity(), Vector3d::Zero()}) <= 1);
    return set;
  }
};

}  // namespace

TEST_CASE("fixed lag: a lie that is found out late makes no earlier set wrong") {
  // The set is wide when the lie comes, which fits: it is the next measurement that contradicts. What is known after the dispute has grown
  // so wide on the way back that it meets the wrong set, too.
  LateLie scene(0.03);
  CHECK(scene.sees(0, 0.01, 0.1) == Claim::unconditional);
  CHECK(scene.sees(1, 0.01, 0.1) == Claim::unconditional);
  CHECK(scene.sees(2, 0.09, 1e-3) == Claim::unconditional);  // the lie
  CHECK(scene.sees(3, 0, 1e-3) == Claim::conditional);
  scene.check(2, Claim::unconditional);
  scene.check(3, Claim::unconditional);
  CHECK(scene.sees(4, 0, 1e-3) == Claim::conditional);
  scene.check(3, Claim::unconditional);
  scene.check(4, Claim::unconditional);
  CHECK(scene.sees(5, 0, 1e-3) == Claim::unconditional);
  scene.check(1, Claim::unconditional);
  CHECK(scene.check(2, Claim::unconditional).uses_future);  // the filter's claim is weaker there
  scene.check(4, Claim::unconditional);
  scene.check(5, Claim::unconditional);
  CHECK_FALSE(scene.lag.has_contradicted());
}

TEST_CASE("fixed lag: a lie that the filter has got over is no new contradiction") {
  // What is known after the dispute is so narrow on the way back that it has nothing in common with the wrong set: the filter has met
  // that, and smoothed sets recover as it does.
  LateLie scene(0.003);
  for (const auto& [time, angle, within] :
       {std::array{0.0, 0.01, 0.1}, {1, 0.01, 0.1}, {2, 0.09, 1e-3}, {3, 0, 1e-3}, {4, 0, 1e-3}, {5, 0, 1e-3}}) {
    scene.sees(time, angle, within);
  }
  REQUIRE(scene.lag.filter().claim() == Claim::unconditional);
  for (int asked = 0; asked < 2; ++asked) {
    for (const std::size_t age : {0U, 1U, 2U, 4U, 5U}) {
      CHECK(scene.check(age, Claim::unconditional).uses_future == (age > 0));
    }
    CHECK(scene.check(3, Claim::conditional).uses_future);  // the moment of the lie: one of the two is wrong
    CHECK_FALSE(scene.lag.has_contradicted());
  }
  for (int k = 6; k < 20; ++k) {
    scene.sees(k, 0, 1e-3);
  }
  for (std::size_t age = 0; age < scene.lag.moments(); ++age) {
    scene.check(age, Claim::unconditional);
  }
}

TEST_CASE("fixed lag: a time that tells no seconds is refused as by the filter") {
  using Flow = GuaranteedGyroFlow<float>;
  using Filter = GuaranteedFilter<Flow>;
  Flow flow;
  REQUIRE(Flow::make(GyroUncertainty<float>{}, Flow::IntervalRate::mean, flow) == Status::ok);
  Filter filter;
  REQUIRE(Filter::make(flow, {}, 1e8F, filter) == Status::ok);
  FixedLag<Filter, 2> lag;
  REQUIRE(FixedLag<Filter, 2>::make(filter, lag) == Status::ok);
  const Filter::Input still{Vector3<float>::Zero(), -1, true};
  CHECK(lag.predict(1.0001e8F, still) == Status::out_of_range);
  CHECK(lag.predict_turn(1.0001e8F, Vector3<float>::Zero(), 0.1F) == Status::out_of_range);
  CHECK(lag.predict(std::nanf(""), still) == Status::not_finite);
  CHECK(lag.moments() == 1);
  CHECK(lag.predict_interval(1.0001e8F, 1.0F, still) == Status::ok);
}

TEST_CASE("backward pass: a dispute that is over within one moment, of moments that a program keeps") {
  using Filter = GyroScene::Filter;
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = 0.03 * 0.03 * Matrix3d::Identity();
  GyroScene::Flow flow;
  REQUIRE(GyroScene::Flow::make(uncertainty, GyroScene::Flow::IntervalRate::mean, flow) == Status::ok);
  Filter::Settings settings;
  settings.policy = Policy::drop_measurement;
  settings.regain_after = 1;
  settings.estimates_vector = false;
  Filter filter;
  REQUIRE(Filter::make(flow, settings, 0, filter) == Status::ok);
  REQUIRE(filter.bound_vector({Vector3d::Zero(), 1e-10 * Matrix3d::Identity()}) == Status::ok);
  std::vector<FilterMoment<Filter>> moments;
  // The lie comes at 2 s, and fits. Of two updates at 5 s the first contradicts it, and the second regains the claim.
  for (const auto& [time, angle, within] :
       {std::array{0.0, 0.01, 0.1}, {1, 0.01, 0.1}, {2, 0.11, 1e-3}, {5, 0, 1e-3}, {5, 0, 0.1}}) {
    PredictedInterval<Filter> interval;
    interval.duration = time - filter.time();
    interval.input.angular_velocity.setZero();
    const bool is_new = interval.duration > 0 || moments.empty();
    REQUIRE(filter.predict(time, interval.input) == Status::ok);
    const MeasuredAttitude<double> star{exp(Vector3d(angle, 0, 0)), within * within * Matrix3d::Identity()};
    GuaranteedUpdate<double> report;
    REQUIRE(filter.update(Measurements<double>{nullptr, 0, nullptr, &star}, report) == Status::ok);
    if (is_new) {
      moments.push_back(FilterMoment<Filter>::of(filter, interval));
    } else {
      moments.back() = FilterMoment<Filter>::of(filter, moments.back().interval);
    }
    CHECK((filter.claim() == Claim::conditional) == (within == 1e-3 && time == 5));
  }
  BackwardPass<Filter> pass(filter, moments.back());
  for (std::size_t k = moments.size() - 1; k-- > 0;) {
    REQUIRE(pass.to(moments[k]) == Status::ok);
    CHECK(pass.smoothed().claim == Claim::unconditional);
    const double form = form_in_product(pass.smoothed().set, {Matrix3d::Identity(), Vector3d::Zero()});
    CHECK((form <= 1) == (k != 2));
  }
}

TEST_CASE("backward pass: earlier contradictions are none of later moments") {
  const auto moment = [](double time, double about_x, double within, unsigned contradictions) {
    FilterMoment<GyroScene::Filter> known;
    known.time = time;
    known.interval.duration = 1;
    known.interval.input = {Vector3d::Zero()};
    known.contradictions = contradictions;
    known.known = {{{exp(Vector3d(about_x, 0, 0)), Vector3d::Zero()}, within * within * Matrix6<double>::Identity()},
                   Claim::unconditional};
    return known;
  };
  const GyroScene::Filter filter = GyroScene::filter(Policy::drop_measurement);
  const GyroState<double> truth{Matrix3d::Identity(), Vector3d::Zero()};
  // How many updates had contradicted until moments 3, 2, 1 and 0: the set of moment 1 is carried to moment 0 if none did since.
  for (const auto& [counts, carried] : {std::pair{std::array{5U, 5U, 5U, 5U}, true},
                                        {std::array{5U, 5U, 5U, 4U}, true},
                                        {std::array{6U, 5U, 5U, 5U}, false},
                                        {std::array{6U, 6U, 5U, 5U}, false}}) {
    BackwardPass<GyroScene::Filter> pass(filter, moment(3, 0, 0.05, counts[0]));
    REQUIRE(pass.to(moment(2, 0, 0.05, counts[1])) == Status::ok);
    REQUIRE(pass.to(moment(1, 0.05, 1e-3, counts[2])) == Status::ok);
    CHECK(pass.smoothed().set.center.attitude.isApprox(exp(Vector3d(0.05, 0, 0)), 1e-2));
    REQUIRE(pass.to(moment(0, 0, 0.1, counts[3])) == Status::ok);
    const bool is_wrong = form_of(pass.smoothed().set, truth) > 1;
    CHECK(is_wrong == carried);
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
