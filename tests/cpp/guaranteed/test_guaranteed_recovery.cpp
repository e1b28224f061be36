// The guaranteed filter after what is wrong: what it keeps, when it gives up its past, and what it then claims.
#include <cmath>

#include <doctest/doctest.h>

#include "support/filter_scene.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using GyroFlow = GuaranteedGyroFlow<double>;
using GyroFilter = GuaranteedFilter<GyroFlow>;

BodyFilter with_policy(Policy policy, int regain_after = 10, int most_wrong = 0) {
  BodyFilter::Settings settings;
  settings.policy = policy;
  settings.regain_after = regain_after;
  settings.most_wrong = most_wrong;
  return filter_with(settings);
}

GyroFilter gyro_filter(const GyroFilter::Settings& settings, double bias_bound, double noise = 1e-3) {
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = noise * noise * Matrix3d::Identity();
  GyroFlow flow;
  REQUIRE(GyroFlow::make(uncertainty, GyroFlow::IntervalRate::mean, flow) == Status::ok);
  GyroFilter filter;
  REQUIRE(GyroFilter::make(flow, settings, 0, filter) == Status::ok);
  REQUIRE(filter.bound_vector({Vector3d::Zero(), bias_bound * bias_bound * Matrix3d::Identity()}) == Status::ok);
  return filter;
}

bool is_sound(const BodyFilter& filter) {
  Matrix6<double> factor;
  return scalar::all_finite(filter.ellipsoid().shape) && scalar::all_finite(filter.ellipsoid().center.attitude) &&
         scalar::all_finite(filter.ellipsoid().center.angular_velocity) &&
         cholesky(filter.ellipsoid().shape, factor) == Status::ok;
}

GibbsEllipsoid<State> ball_about(const State& state, double radius) {
  return {state, radius * radius * Matrix6<double>::Identity()};
}

/// In both sets: of the attitude, and of the bias.
bool in_product(const GyroFilter& filter, const GyroState<double>& truth) {
  const Vector6<double> error = state_error<GibbsChart>(filter.ellipsoid().center, truth);
  const Matrix6<double>& shape = filter.ellipsoid().shape;
  return contains(Ellipsoid<double, 3>{Vector3d::Zero(), shape.topLeftCorner<3, 3>()}, Vector3d(error.head<3>())) &&
         contains(Ellipsoid<double, 3>{Vector3d::Zero(), shape.bottomRightCorner<3, 3>()}, Vector3d(error.tail<3>()));
}

}  // namespace

TEST_CASE("one wrong first rate: recovered within twice regain_after of the first contradiction") {
  for (const Policy policy : {Policy::drop_measurement, Policy::restart}) {
    for (const double size : {1.0, 3.0, 20.0, 1e3, 3e6, 1e20, 1e160, 1e300}) {
      Scene scene(31);
      BodyFilter filter = with_policy(policy, 4);
      const Vector3d right = scene.rate.value;
      scene.rate.value += size * Vector3d(0.6, 0, -0.8);
      Report update;
      REQUIRE(filter.update(scene.all(), update) == Status::ok);
      int first = size > 1e9 ? 0 : -1;
      CHECK((update.dropped == angular_velocity_bit) == (first == 0));
      scene.rate.value = right;
      for (int k = 1; k <= 16; ++k) {
        scene.move(0.1);
        REQUIRE(filter.predict(0.1 * k, {}) == Status::ok);
        REQUIRE(filter.update(scene.all(), update) == Status::ok);
        first = first < 0 && update.margin < 0 ? k : first;
        if (filter.knows_attitude()) {
          CHECK(is_sound(filter));
        }
        if (first >= 0 && k >= first + 8) {
          CHECK(filter.claim() == Claim::unconditional);
          CHECK(form_of(filter, scene.truth) <= 1);
        }
      }
      CHECK((first >= 0 || size > 10));  // a set about a large rate is lost before it contradicts anything
      CHECK(filter.claim() == Claim::unconditional);
      CHECK(form_of(filter, scene.truth) <= 1);
    }
  }
}

TEST_CASE("raise: a set that cannot be predicted is reported, and forgotten when the user says so") {
  Scene scene(32);
  BodyFilter filter = with_policy(Policy::raise);
  Report update;
  AngularVelocity<double> wrong = scene.rate;
  wrong.value(0) = 1e4;
  REQUIRE(filter.update({scene.directions.data(), 4, &wrong, nullptr}, update) == Status::ok);
  const Snapshot before = snapshot(filter);
  CHECK(filter.predict(0.1, {}) != Status::ok);
  CHECK(same(before, snapshot(filter)));
  filter.forget();
  CHECK_FALSE(filter.knows_attitude());
  CHECK_FALSE(filter.knows_vector());
  CHECK(filter.claim() == Claim::none);
  scene.move(0.1);
  REQUIRE(filter.predict(0.1, {}) == Status::ok);
  REQUIRE(filter.update(scene.all(), update) == Status::ok);
  CHECK(filter.claim() == Claim::unconditional);
  CHECK(form_of(filter, scene.truth) <= 1);
}

TEST_CASE("what the user gives wrongly is reported under every policy, and the set is kept") {
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart}) {
    Scene scene(33);
    BodyFilter filter = with_policy(policy);
    Report update;
    REQUIRE(filter.update(scene.all(), update) == Status::ok);
    const Snapshot before = snapshot(filter);
    CHECK(filter.predict(1e12, {}) == Status::too_many_steps);
    CHECK(filter.predict(0.1, {Vector3d(std::nan(""), 0, 0), Vector3d::Zero()}) == Status::not_finite);
    CHECK(same(before, snapshot(filter)));
  }
}

TEST_CASE("nothing is kept that is not finite and positive definite") {
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart, Policy::relaxed}) {
    for (const double size : {2e9, 1e80, 1e160, 1e300}) {
      for (const bool started : {false, true}) {
        Scene scene(34);
        BodyFilter filter = with_policy(policy, 10, policy == Policy::relaxed ? 1 : 0);
        CHECK(filter.bound_vector({size * Vector3d::UnitX(), Matrix3d::Identity()}) == Status::out_of_range);
        CHECK(filter.bound_vector({Vector3d::Zero(), size * size * Matrix3d::Identity()}) != Status::ok);
        REQUIRE(filter.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) == Status::ok);
        State far = scene.truth;
        far.angular_velocity(1) = size;
        CHECK(filter.start(ball_about(far, 0.1)) == Status::out_of_range);
        if (started) {
          REQUIRE(filter.start(ball_about(scene.truth, 0.1)) == Status::ok);
        }
        const Snapshot before = snapshot(filter);
        AngularVelocity<double> wrong = scene.rate;
        wrong.value = size * Vector3d(0.6, 0.8, 0);
        Report update;
        const Status status = filter.update({scene.directions.data(), 4, &wrong, nullptr}, update);
        if (policy == Policy::raise) {
          CHECK(status == Status::out_of_range);
          CHECK(same(before, snapshot(filter)));
        } else {
          CHECK(status == Status::ok);
          CHECK(update.dropped == angular_velocity_bit);
          CHECK((!filter.knows_attitude() || form_of(filter, scene.truth) <= 1));
        }
        wrong = scene.rate;
        wrong.bound *= 1e5 * size * size;
        CHECK((filter.update({scene.directions.data(), 4, &wrong, nullptr}, update) == Status::ok) ==
              (policy != Policy::raise && size < 1e150));
        if (started) {
          BodyFilter other = filter;
          LinearMeasurement<double, 2> linear;
          linear.h.setOnes();
          linear.bound.setIdentity();
          linear.y.setConstant(size);
          CHECK(other.update(linear, update) != Status::ok);
          linear.y.setZero();
          linear.h *= size;
          (void)other.update(linear, update);
          linear.bound *= size;
          (void)other.update(linear, update);
          CHECK(is_sound(other));
        }
        for (int k = 1; k <= 12; ++k) {
          scene.move(0.1);
          REQUIRE(filter.predict(0.1 * k, {}) == Status::ok);
          REQUIRE(filter.update(scene.all(), update) == Status::ok);
          REQUIRE(filter.knows_attitude());
          CHECK(is_sound(filter));
        }
        CHECK(form_of(filter, scene.truth) <= 1);
        CHECK(filter.claim() == Claim::unconditional);
      }
    }
  }
}

TEST_CASE("a bound of the vector holds whatever was measured, and what is dropped chooses no coordinates") {
  for (const double size : {10.0, 3e4, 3e6, 9e8, 3e14, 3e104, 3e114, 1e200}) {
    Scene scene(35);
    BodyFilter filter = with_policy(Policy::drop_measurement);
    REQUIRE(filter.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) == Status::ok);
    AngularVelocity<double> wrong = scene.rate;
    wrong.value = size * Vector3d(0.6, -0.8, 0);
    Report update;
    REQUIRE(filter.update({scene.directions.data(), 4, &wrong, nullptr}, update) == Status::ok);
    CHECK(update.dropped == angular_velocity_bit);
    CHECK(filter.claim() == Claim::conditional);
    CHECK(form_of(filter, scene.truth) <= 1);
    CHECK(filter.ellipsoid().shape.bottomRightCorner<3, 3>().trace() < 10);  // 3 times 2 of 6 dimensions, and a little
    scene.move(0.1);
    REQUIRE(filter.predict(0.1, {}) == Status::ok);
    CHECK(filter.knows_attitude());
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("a past that contradicts again and again is given up, and later trusted again") {
  constexpr int regain_after = 5;
  for (const Policy policy : {Policy::drop_measurement, Policy::restart}) {
    Scene scene(36);
    BodyFilter filter = with_policy(policy, regain_after);
    // Wrong in the rate alone, about which the policy then blames the sensor.
    State wrong = scene.truth;
    wrong.angular_velocity += Vector3d(1, -1, 1);
    REQUIRE(filter.start(ball_about(wrong, 0.05)) == Status::ok);
    Report update;
    int given_up = -1;
    for (int k = 0; k <= 2 * regain_after + 3; ++k) {
      REQUIRE(filter.update(scene.all(), update) == Status::ok);
      const bool in = form_of(filter, scene.truth) <= 1;
      given_up = in && given_up < 0 ? k : given_up;
      if (k == 0) {
        CHECK(update.margin < 0);
      }
      if (policy == Policy::drop_measurement && k < regain_after) {
        CHECK_FALSE(in);
        CHECK(filter.trust().disputed_updates() == k);
      }
      CHECK((filter.claim() == Claim::unconditional) == (k >= (policy == Policy::restart ? 5 : 10)));
      scene.move(0.1);
      REQUIRE(filter.predict(0.1 * (k + 1), {}) == Status::ok);
    }
    CHECK(given_up == (policy == Policy::restart ? 0 : regain_after));
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("what does not determine an attitude by itself replaces no past") {
  Scene scene(37);
  BodyFilter filter = with_policy(Policy::drop_measurement, 2);
  REQUIRE(filter.start(ball_about({scene.truth.attitude * exp(Vector3d(1, 0, 0)), scene.truth.angular_velocity},
                                  0.05)) == Status::ok);
  Report update;
  for (int k = 0; k < 8; ++k) {
    REQUIRE(filter.update({&scene.directions[static_cast<std::size_t>(k % 4)], 1, &scene.rate, nullptr}, update) ==
            Status::ok);
    CHECK(filter.knows_attitude());
  }
  CHECK(filter.claim() == Claim::conditional);
  REQUIRE(filter.update(scene.all(), update) == Status::ok);
  CHECK(form_of(filter, scene.truth) <= 1);
}

TEST_CASE("a rate known without an attitude is given up as a set is") {
  for (const Policy policy : {Policy::drop_measurement, Policy::restart}) {
    Scene scene(38);
    BodyFilter filter = with_policy(policy, 3);
    AngularVelocity<double> wrong = scene.rate;
    wrong.value += Vector3d(1, 1, 1);
    Report update;
    REQUIRE(filter.update({nullptr, 0, &wrong, nullptr}, update) == Status::ok);
    const auto knows = [&] {
      REQUIRE(filter.knows_vector());
      return contains(filter.vector(), scene.truth.angular_velocity);
    };
    for (int k = 0; k < 7; ++k) {
      REQUIRE(filter.update({nullptr, 0, &scene.rate, nullptr}, update) == Status::ok);
      CHECK((update.dropped == angular_velocity_bit) == (policy == Policy::drop_measurement && k < 3));
      CHECK(knows() == (policy == Policy::restart || k >= 3));
      CHECK(filter.trust().rests_on_drops() == (k < (policy == Policy::restart ? 3 : 6)));
    }
    REQUIRE(filter.update(scene.all(), update) == Status::ok);
    CHECK(filter.claim() == Claim::unconditional);
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("a rate alone that contradicts the bound of the vector is not taken up") {
  const Ellipsoid<double, 3> bound_of_rate{Vector3d::Zero(), Vector3d::Constant(4).asDiagonal()};
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart}) {
    for (const bool knows : {false, true}) {
      for (const double size : {2.1, 30.0, 1e6}) {
        CAPTURE(static_cast<int>(policy));
        CAPTURE(knows);
        CAPTURE(size);
        Scene scene(41);
        BodyFilter filter = with_policy(policy, 3);
        REQUIRE(filter.bound_vector(bound_of_rate) == Status::ok);
        Report update;
        if (knows) {
          REQUIRE(filter.update({nullptr, 0, &scene.rate, nullptr}, update) == Status::ok);
        }
        const Ellipsoid<double, 3> before = filter.vector();
        AngularVelocity<double> wrong = scene.rate;
        wrong.value = size * Vector3d::UnitX();
        wrong.bound = 1e-4 * Matrix3d::Identity();
        const Status status = filter.update({scene.directions.data(), 1, &wrong, nullptr}, update);
        CHECK(update.margin < 0);
        CHECK(update.contradicting == angular_velocity_bit);
        CHECK(status == (policy == Policy::raise ? Status::empty_intersection : Status::ok));
        CHECK(update.dropped == (policy == Policy::raise ? 0 : angular_velocity_bit));
        CHECK(filter.knows_vector() == knows);
        if (knows) {
          CHECK(filter.vector().shape == before.shape);
          CHECK(filter.vector().center == before.center);
        }
        // What comes is taken as if nothing had been.
        REQUIRE(filter.update(scene.all(), update) == Status::ok);
        CHECK(update.dropped == 0);
        CHECK(filter.claim() == (knows && policy != Policy::raise ? Claim::conditional : Claim::unconditional));
        CHECK(form_of(filter, scene.truth) <= 1);
      }
    }
  }
}

TEST_CASE("a rate alone is known within the bound of the vector") {
  const auto width_along_x = [](const BodyFilter& filter) { return std::sqrt(filter.vector().shape(0, 0)); };
  for (const double half_width : {1e-3, 0.1, 10.0, 1e5}) {
    CAPTURE(half_width);
    // The truth is at the edge of both, which have a thin lens in common.
    BodyFilter filter = filter_with({});
    const Vector3d truth = Vector3d::UnitX();
    REQUIRE(filter.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) == Status::ok);
    const double smaller = std::fmin(half_width, 1.0);
    const AngularVelocity<double> rate{truth + (half_width - 0.001 * smaller) * Vector3d::UnitX(),
                                       half_width * half_width * Matrix3d::Identity()};
    Report update;
    REQUIRE(filter.update({nullptr, 0, &rate, nullptr}, update) == Status::ok);
    REQUIRE(filter.knows_vector());
    CHECK(contains(filter.vector(), truth));
    CHECK(width_along_x(filter) < 0.1 * smaller);
  }
}

TEST_CASE("a rate that is left out where the past is due contradicts") {
  // The last rate and the bound are apart by less than rounding, or by more, and what is known lies where they are near.
  int left_out = 0;
  int kept = 0;
  for (const Policy policy : {Policy::drop_measurement, Policy::restart}) {
    for (const double square : {1e-8, 1e-12}) {
      for (int k = -60; k < -4; ++k) {
        BodyFilter filter = with_policy(policy, 2);
        REQUIRE(filter.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) == Status::ok);
        const AngularVelocity<double> narrow{Vector3d::UnitX(), square * Matrix3d::Identity()};
        const AngularVelocity<double> wrong{-Vector3d::UnitX() / 2, 1e-8 * Matrix3d::Identity()};
        const AngularVelocity<double> last{(2 + std::ldexp(1, k)) * Vector3d::UnitX(), Matrix3d::Identity()};
        Report update;
        for (const auto* rate : {&narrow, &wrong, &narrow}) {
          REQUIRE(filter.update({nullptr, 0, rate, nullptr}, update) == Status::ok);
        }
        REQUIRE(filter.update({nullptr, 0, &last, nullptr}, update) == Status::ok);
        CAPTURE(square);
        CAPTURE(k);
        const bool contradicts = update.margin < 0;
        const bool past_given_up = filter.trust().disputed_updates() == 0;
        // What is known may show a contradiction that the last rate and the bound do not: then only the past is given up.
        CHECK((update.dropped != 0) == (contradicts && !past_given_up));
        left_out += update.dropped != 0 ? 1 : 0;
        kept += !contradicts && !past_given_up && filter.trust().rests_on_drops() ? 1 : 0;
      }
    }
  }
  CHECK(left_out > 0);
  CHECK(kept > 0);  // of which the past was not given up
}

TEST_CASE("a bias known without an attitude that contradicts its bound is given up") {
  for (const Policy policy : {Policy::drop_measurement, Policy::restart}) {
    GyroFilter::Settings settings;
    settings.policy = policy;
    settings.regain_after = 3;
    GyroFilter filter = gyro_filter(settings, 0.01);
    const Ellipsoid<double, 3> wrong{{0.5, 0, 0}, 1e-6 * Matrix3d::Identity()};
    REQUIRE(filter.resume(nullptr, &wrong, {}) == Status::ok);
    const Direction<double> directions[] = {
        {Vector3d::UnitX(), Vector3d::UnitX(), 1e-4 * Matrix3d::Identity(), 1},
        {Vector3d::UnitY(), Vector3d::UnitY(), 1e-4 * Matrix3d::Identity(), 1},
    };
    for (int k = 0; k <= 6; ++k) {
      GuaranteedUpdate<double> update;
      REQUIRE(filter.predict(0.1 * k, {Vector3d::Zero()}) == Status::ok);
      REQUIRE(filter.update({directions, 2, nullptr, nullptr}, update) == Status::ok);
    }
    REQUIRE(filter.knows_attitude());
    CHECK(filter.claim() == Claim::unconditional);
    const GyroState<double> truth{Matrix3d::Identity(), Vector3d::Zero()};
    CHECK(contains(filter.ellipsoid().in_coordinates(), state_error<GibbsChart>(filter.ellipsoid().center, truth)));
  }
}

TEST_CASE("a vector given flat to rounding does not hold up a filter") {
  GyroUncertainty<double> uncertainty;
  uncertainty.drift = 1e-8 * Matrix3d::Ones();
  GuaranteedGyroFlow<double> flow;
  REQUIRE(flow.make(uncertainty, GuaranteedGyroFlow<double>::IntervalRate::mean, flow) == Status::ok);
  int reported = 0;
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart, Policy::relaxed}) {
    for (int k = 1; k <= 200; ++k) {
      // Ones throughout: where there is a Cholesky factor it is rounding, and after a sum there may be none.
      const Ellipsoid<double, 3> flat{{0.001, 0, 0}, (k * 1e-17) * Matrix3d::Ones()};
      GyroFilter::Settings settings;
      settings.policy = policy;
      GyroFilter filter;
      REQUIRE(GyroFilter::make(flow, settings, 0, filter) == Status::ok);
      if (filter.resume(nullptr, &flat, {}) != Status::ok) {
        continue;
      }
      const Status status = filter.predict(0.1, {});
      if (policy == Policy::raise && status == Status::not_positive_definite) {
        ++reported;
      } else {
        CHECK(status == Status::ok);
      }
    }
  }
  CHECK(reported > 0);
}

TEST_CASE("a first set that rests on a drop is conditional") {
  Scene scene(39);
  BodyFilter filter = with_policy(Policy::drop_measurement);
  scene.directions[1] = measured(scene.truth, scene.references[1], Vector3d(0.4, -0.4, 0.4));
  Report update;
  REQUIRE(filter.update(scene.all(), update) == Status::ok);
  CHECK(update.dropped == direction_bit(1));
  CHECK(update.claim == Claim::conditional);
  CHECK(filter.claim() == Claim::conditional);
  CHECK(filter.trust().rests_on_drops());
  CHECK(filter.trust().contradictions() == 1);

  SUBCASE("and so is it after a linear measurement") {
    LinearMeasurement<double, 1> linear{Vector<double, 1>::Zero(), Matrix<double, 1, 6>::Zero(),
                                        Matrix<double, 1>::Constant(1e-3)};
    linear.h(0, 0) = 1;
    REQUIRE(filter.update(linear, update) == Status::ok);
    CHECK(update.claim == Claim::conditional);
    CHECK(filter.claim() == Claim::conditional);
  }
  SUBCASE("and after updates in which nothing was measured") {
    for (int k = 0; k < 30; ++k) {
      REQUIRE(filter.update(Measurements<double>{}, update) == Status::ok);
    }
    CHECK(filter.trust().agreeing_updates() == 0);
    CHECK(filter.trust().disputed_updates() == 0);
    CHECK(filter.claim() == Claim::conditional);
  }
  SUBCASE("but not after a new start") {
    REQUIRE(filter.start(ball_about(scene.truth, 0.1)) == Status::ok);
    CHECK(filter.claim() == Claim::unconditional);
    CHECK_FALSE(filter.trust().rests_on_drops());
    CHECK(filter.trust().contradictions() == 1);  // it is remembered that there was one
    scene.measure();
    REQUIRE(filter.update(scene.all(), update) == Status::ok);
    CHECK(update.claim == Claim::unconditional);
    filter.forget();
    CHECK(filter.trust().contradictions() == 1);
  }
}

TEST_CASE("of two that contradict each other the one goes without which the others agree best") {
  for (const std::size_t liar : {0U, 1U}) {
    Scene scene(40);
    BodyFilter filter = with_policy(Policy::drop_measurement);
    REQUIRE(filter.start(ball_about(scene.truth, 0.1)) == Status::ok);
    // Both of the same thing, and both within the prediction.
    Direction<double> two[2];
    two[liar] = measured(scene.truth, Vector3d::UnitX(), Vector3d(0, 0, 0));
    const Vector3d across = two[liar].body.cross(Vector3d(0.3, 0.5, 0.8)).normalized();
    two[1 - liar] = two[liar];
    two[liar] = measured(scene.truth, Vector3d::UnitX(), 0.09 * across);
    Report update;
    REQUIRE(filter.update({two, 2, nullptr, nullptr}, update) == Status::ok);
    CHECK(update.dropped == direction_bit(liar));
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("a measured attitude half a turn away does not hold up the others") {
  Scene scene(41);
  BodyFilter filter = with_policy(Policy::drop_measurement);
  State begin = scene.truth;
  REQUIRE(filter.start(ball_about(begin, 0.3)) == Status::ok);
  const Matrix3d turned = filter.ellipsoid().center.attitude * Vector3d(1, -1, -1).asDiagonal();
  const MeasuredAttitude<double> attitude{turned, 1e-4 * Matrix3d::Identity()};
  const MeasuredAttitude<double> nothing{scene.truth.attitude, 100 * Matrix3d::Identity()};
  for (const MeasuredAttitude<double>* some : {&attitude, &nothing}) {
    REQUIRE(filter.start(ball_about(begin, 0.3)) == Status::ok);
    Report update;
    REQUIRE(filter.update({scene.directions.data(), 4, &scene.rate, some}, update) == Status::ok);
    CHECK(filter.ellipsoid().shape.topLeftCorner<3, 3>().trace() < 0.01);
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("relaxed: on an honest log no set is larger than its prediction, and none is called wrong") {
  for (const int most_wrong : {1, 2}) {
    Scene scene(42);
    BodyFilter filter = with_policy(Policy::relaxed, 10, most_wrong);
    REQUIRE(filter.start(ball_about(scene.truth, 0.1)) == Status::ok);
    double largest = 0;
    for (int k = 1; k <= 60; ++k) {
      scene.move(0.1);
      REQUIRE(filter.predict(0.1 * k, {}) == Status::ok);
      const double before = filter.ellipsoid().shape.determinant();
      Report update;
      REQUIRE(filter.update(scene.all(), update) == Status::ok);
      CHECK(filter.ellipsoid().shape.determinant() <= before * (1 + 1e-9));
      CHECK(update.dropped == 0);
      CHECK(filter.claim() == Claim::unconditional);
      CHECK(form_of(filter, scene.truth) <= 1);
      largest = std::fmax(largest, filter.ellipsoid().shape.bottomRightCorner<3, 3>().trace());
    }
    CHECK(largest < 1);
    // As many may be wrong as there are: none is proved to be so.
    Report update;
    REQUIRE(filter.update({scene.directions.data(), static_cast<std::size_t>(most_wrong), nullptr, nullptr}, update) ==
            Status::ok);
    CHECK(update.dropped == 0);
    scene.directions[0] = measured(scene.truth, scene.references[0], Vector3d(1, 1, 1));
    REQUIRE(filter.update({scene.directions.data(), static_cast<std::size_t>(most_wrong), nullptr, nullptr}, update) ==
            Status::ok);
    CHECK(update.dropped == direction_bit(0));
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("relaxed: two liars at once") {
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    Scene scene(300 + seed);
    BodyFilter filter = with_policy(Policy::relaxed, 10, 2);
    REQUIRE(filter.start(ball_about({scene.truth.attitude * exp(Vector3d(0.15, 0, 0)), scene.truth.angular_velocity},
                                    0.2)) == Status::ok);
    // Both agree with the prediction and with each other, on another attitude.
    const State other{scene.truth.attitude * exp(Vector3d(0.12, 0.02, 0)), scene.truth.angular_velocity};
    const std::size_t first = seed % 4;
    const std::size_t second = (first + 1 + seed / 4) % 4;
    for (const std::size_t liar : {first, second}) {
      scene.directions[liar] = measured(other, scene.references[liar], Vector3d::Zero());
    }
    Report update;
    REQUIRE(filter.update(scene.all(), update) == Status::ok);
    CHECK(filter.claim() == Claim::unconditional);
    CHECK(form_of(filter, scene.truth) <= 1);
  }
}

TEST_CASE("relaxed: either of two that are far apart may be the right one") {
  for (const bool estimates : {false, true}) {
    GyroFilter::Settings settings;
    settings.policy = Policy::relaxed;
    settings.most_wrong = 1;
    settings.estimates_vector = estimates;
    GyroFilter filter = gyro_filter(settings, 1e-3);
    const GyroState<double> middle{exp(Vector3d(1, 2, 3)), Vector3d::Zero()};
    for (const double side : {-1.0, 1.0}) {
      GibbsEllipsoid<GyroState<double>> wide{middle, 0.25 * Matrix6<double>::Identity()};
      wide.shape.bottomRightCorner<3, 3>() *= 4e-6;
      REQUIRE(filter.start(wide) == Status::ok);
      const GyroState<double> truth{middle.attitude * exp(Vector3d(side * 0.25, 0, 0)), Vector3d::Zero()};
      const GyroState<double> lie{middle.attitude * exp(Vector3d(-side * 0.25, 0, 0)), Vector3d::Zero()};
      const MeasuredAttitude<double> attitude{lie.attitude, 1e-4 * Matrix3d::Identity()};
      const Vector3d seen = truth.attitude * Vector3d::UnitY();
      const Direction<double> direction = Direction<double>::within(seen, Vector3d::UnitY(), 0.01);
      GuaranteedUpdate<double> update;
      REQUIRE(filter.update({&direction, 1, nullptr, &attitude}, update) == Status::ok);
      CHECK(update.dropped == 0);
      CHECK(in_product(filter, truth));
      CHECK(in_product(filter, lie));  // for all that the filter knows
    }
  }
}

TEST_CASE("a bias that is left to its bound stays as it is, and adds to the attitude what it can") {
  Random random(43);
  constexpr double bias_bound = 1e-3;
  constexpr double used = 0.9999;
  constexpr double degree = 3.14159265358979323846 / 180;
  for (const int steps : {1, 10, 100}) {
    for (int trial = 0; trial < 10; ++trial) {
      GyroFilter::Settings settings;
      settings.estimates_vector = false;
      GyroFilter filter = gyro_filter(settings, bias_bound, 1e-9);
      const Matrix3d begin = random.rotation();
      GibbsEllipsoid<GyroState<double>> start{{begin, Vector3d::Zero()}, Matrix6<double>::Identity()};
      start.shape *= bias_bound * bias_bound;
      start.shape.topLeftCorner<3, 3>() = 1.22 * 1.22 * degree * degree * Matrix3d::Identity();
      REQUIRE(filter.start(start) == Status::ok);
      const Vector3d rate = 0.5 * random.unit_vector<3>();
      // The worst there is: at the edge, and the bias where it drives it out, constant or not.
      const Vector3d out = random.unit_vector<3>();
      Matrix3d truth =
          begin * GibbsChart::retract(Matrix3d(Matrix3d::Identity()), Vector3d(used * 1.22 * degree * out));
      for (int k = 0; k < steps; ++k) {
        const double h = 1.0 / steps;
        REQUIRE(filter.predict(h * (k + 1), {rate}) == Status::ok);
        constexpr int pieces = 64;
        for (int piece = 0; piece < pieces; ++piece) {
          // In the axes of the truth as it turns: the error's own axis.
          const Matrix3d carried = begin * exp(Vector3d((k * h + (piece + 0.5) * h / pieces) * rate));
          const Vector3d bias = -used * bias_bound * (carried.transpose() * (begin * out));
          truth = truth * exp(Vector3d(h / pieces * (rate - bias)));
        }
        const Vector3d last = -used * bias_bound * out;
        CHECK(in_product(filter, {truth, last}));
      }
      Extent<double> size;
      REQUIRE(extent(filter.ellipsoid(), size) == Status::ok);
      CHECK(size.largest_angle < (steps == 1 ? 1.30 : 1.32) * degree);
      CHECK(size.largest_angle > (1.22 + 0.057) * degree);
      CHECK((filter.ellipsoid().shape.bottomRightCorner<3, 3>() - bias_bound * bias_bound * Matrix3d::Identity())
                .cwiseAbs()
                .maxCoeff() < 1e-18);
    }
  }
}
