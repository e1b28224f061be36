// A pass backward: motions that agree with all that was measured are inside, and a filter that goes backward with the measurements
// finds sets as good. (theory, section 20.5)
#include <doctest/doctest.h>

#include "support/smoothing_scene.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using namespace elliptude::testing::smoothing;

TEST_CASE("backward pass: every motion that agrees with all measurements is in the smoothed set") {
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

TEST_CASE("backward pass: intervals of different lengths, and a bias that drifts while a rate is held") {
  // All is known at the end, and the gyro has no noise: what is left is how far the bias drifts.
  using Flow = GyroScene::Flow;
  using Filter = GyroScene::Filter;
  GyroUncertainty<double> uncertainty;
  uncertainty.drift = 1e-4 * Matrix3d::Identity();
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Flow::IntervalRate::first_sample, flow) == Status::ok);
  double worst = 0;
  for (const double sign : {-1.0, 1.0}) {
    Filter filter;
    REQUIRE(Filter::make(flow, {}, 0, filter) == Status::ok);
    GyroState<double> truth{Matrix3d::Identity(), Vector3d(0.01, 0.02, -0.01)};
    const GibbsEllipsoid<GyroState<double>> wide{truth, Matrix6<double>::Identity()};
    REQUIRE(filter.start(wide) == Status::ok);
    std::vector<FilterMoment<Filter>> moments{FilterMoment<Filter>::of(filter, {})};
    std::vector<GyroState<double>> truths{truth};
    double time = 0;
    for (const double duration : {0.2, 0.1, 0.3, 0.05}) {
      PredictedInterval<Filter> interval;
      interval.duration = duration;
      interval.input.angular_velocity = Vector3d(0.3, 0, 0) + truth.gyro_bias;
      truth.attitude = truth.attitude * exp(Vector3d(duration * Vector3d(0.3, 0, 0)));
      truth.gyro_bias.x() += sign * 0.999999 * 1e-2 * duration;
      time += duration;
      REQUIRE(filter.predict(time, interval.input) == Status::ok);
      moments.push_back(FilterMoment<Filter>::of(filter, interval));
      truths.push_back(truth);
    }
    // By a star tracker and a bias that is given.
    const GibbsEllipsoid<GyroState<double>> sharp{truth, 1e-14 * Matrix6<double>::Identity()};
    REQUIRE(filter.start(sharp) == Status::ok);
    moments.back().known.set = filter.ellipsoid();
    BackwardPass<Filter> pass(filter, moments.back());
    for (std::size_t k = moments.size() - 1; k-- > 0;) {
      REQUIRE(pass.to(moments[k]) == Status::ok);
      CHECK(pass.smoothed().uses_future);
      const double form = form_of(pass.smoothed().set, truths[k]);
      CHECK(form <= 1);
      worst = std::fmax(worst, form);
      CHECK(largest(pass.smoothed().set.shape, 0) < 0.01 * 0.01);
    }
  }
  CHECK(worst > 0.1);
}

TEST_CASE("backward pass: one interval is a prediction of the mirrored flow over it") {
  using Flow = GyroScene::Flow;
  using Filter = GyroScene::Filter;
  for (const bool estimates_vector : {true, false}) {
    const Filter filter = GyroScene::filter(Policy::raise, estimates_vector);
    Filter known = filter;
    const GibbsEllipsoid<GyroState<double>> set{{exp(Vector3d(0.1, 0.2, 0.3)), Vector3d(0.001, 0, 0)},
                                                1e-6 * Matrix6<double>::Identity()};
    REQUIRE(known.start(set) == Status::ok);
    FilterMoment<Filter> last = FilterMoment<Filter>::of(known, {});
    last.time = 3;
    last.interval.duration = 2;
    last.interval.input = {Vector3d(0.1, 0, 0), 0.002, true};
    BackwardPass<Filter> pass(filter, last);
    FilterMoment<Filter> nothing;
    nothing.time = 1;
    REQUIRE(pass.to(nothing) == Status::ok);
    Flow flow;
    REQUIRE(Mirror<Flow>::flow(filter.flow(), flow) == Status::ok);
    Filter back;
    REQUIRE(Filter::make(flow, filter.settings(), -3, back) == Status::ok);
    REQUIRE(back.bound_vector(mirrored(filter.vector_bound())) == Status::ok);
    REQUIRE(back.start(mirrored(known.ellipsoid())) == Status::ok);
    REQUIRE(back.predict(-1, Mirror<Flow>::input(last.interval.input)) == Status::ok);
    CHECK(pass.smoothed().set.shape == mirrored(back.ellipsoid()).shape);
    CHECK(pass.smoothed().set.center.attitude == back.ellipsoid().center.attitude);
  }
}

TEST_CASE("backward pass: once it is proved that a statement is wrong, no earlier set is unconditional") {
  using Filter = GyroScene::Filter;
  const Filter filter = GyroScene::filter(Policy::drop_measurement);
  const auto moment = [](double time, double about_x) {
    FilterMoment<Filter> known;
    known.time = time;
    known.interval.duration = 1;
    known.interval.input.angular_velocity.setZero();
    known.known = {{{exp(Vector3d(about_x, 0, 0)), Vector3d::Zero()}, 1e-6 * Matrix6<double>::Identity()},
                   Claim::unconditional};
    return known;
  };
  BackwardPass<Filter> pass(filter, moment(3, 0.1));
  REQUIRE(pass.to(moment(2, 0)) == Status::ok);
  CHECK(pass.has_contradicted());
  CHECK(pass.smoothed().claim == Claim::conditional);
  REQUIRE(pass.to(moment(1, 0)) == Status::ok);
  CHECK(pass.has_contradicted());
  CHECK(pass.smoothed().claim == Claim::conditional);
  CHECK(pass.smoothed().time == 1);
  const Filter raises = GyroScene::filter(Policy::raise);
  BackwardPass<Filter> other(raises, moment(3, 0.1));
  CHECK(other.to(moment(2, 0)) == Status::empty_intersection);
  CHECK(other.smoothed().time == 3);
  CHECK(other.smoothed().claim == Claim::unconditional);
}

TEST_CASE("backward pass: compared with a filter that is given the measurements in the other order") {
  // That is how elliptude.smoothing does it. Both sets hold the truth, and neither is always the smaller.
  double pass_gain = 0;
  double filter_gain = 0;
  int rows = 0;
  for (std::uint64_t seed = 31; seed < 36; ++seed) {
    GyroScene scene(seed);
    GyroScene::Filter filter = GyroScene::filter();
    std::vector<FilterMoment<GyroScene::Filter>> moments;
    std::vector<std::array<Direction<double>, 2>> seen;
    std::vector<GyroState<double>> truths;
    for (int k = 0; k < 15; ++k) {
      PredictedInterval<GyroScene::Filter> interval;
      if (k > 0) {
        interval.duration = GyroScene::step;
        interval.input = scene.move();
        REQUIRE(filter.predict(k * GyroScene::step, interval.input) == Status::ok);
      }
      seen.push_back(scene.directions());
      truths.push_back(scene.truth);
      GuaranteedUpdate<double> report;
      REQUIRE(filter.update({seen.back().data(), 2, nullptr, nullptr}, report) == Status::ok);
      moments.push_back(FilterMoment<GyroScene::Filter>::of(filter, interval));
    }
    BackwardPass<GyroScene::Filter> pass(filter, moments.back());
    CHECK(pass.smoothed().set.shape == filter.ellipsoid().shape);
    CHECK_FALSE(pass.smoothed().uses_future);
    GyroScene::Flow flow;
    REQUIRE(Mirror<GyroScene::Flow>::flow(filter.flow(), flow) == Status::ok);
    GyroScene::Filter other;
    REQUIRE(GyroScene::Filter::make(flow, filter.settings(), -filter.time(), other) == Status::ok);
    REQUIRE(other.bound_vector(mirrored(filter.vector_bound())) == Status::ok);
    for (std::size_t k = moments.size(); k-- > 0;) {
      GuaranteedUpdate<double> report;
      REQUIRE(other.update({seen[k].data(), 2, nullptr, nullptr}, report) == Status::ok);
      BothDirections<GyroState<double>> both;
      REQUIRE(both_directions<GyroState<double>>(moments[k].known, {mirrored(other.ellipsoid()), other.claim()}, {},
                                                 both) == Status::ok);
      if (k + 1 < moments.size()) {
        REQUIRE(pass.to(moments[k]) == Status::ok);
      }
      CHECK(pass.smoothed().time == moments[k].time);
      CHECK(form_of(pass.smoothed().set, truths[k]) <= 1);
      CHECK(form_of(both.smoothed.set, truths[k]) <= 1);
      CHECK_FALSE(both.contradict);
      pass_gain += log_size(moments[k].known.set) - log_size(pass.smoothed().set);
      filter_gain += log_size(moments[k].known.set) - log_size(both.smoothed.set);
      ++rows;
      if (k > 0) {
        REQUIRE(other.predict(other.time() + GyroScene::step,
                              Mirror<GyroScene::Flow>::input(moments[k].interval.input)) == Status::ok);
      }
    }
    CHECK_FALSE(pass.has_contradicted());
  }
  MESSAGE("mean gain of the logarithm of the volume: ", pass_gain / rows, " by the pass, ", filter_gain / rows,
          " by the filter");
  CHECK(pass_gain > 0.6 * filter_gain);
  CHECK(filter_gain > 0);
}
