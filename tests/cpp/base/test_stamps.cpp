/// Filters that are predicted to stamps, in `float`: sets do not depend on how long ago the start was, hold exact motions, and the same in
/// seconds does not.

#include <doctest/doctest.h>

#include <elliptude/elliptude.hpp>
#include <limits>
#include <type_traits>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using Vector3f = Vector3<float>;
using Matrix3f = Matrix3<float>;
using Gravity = GravityGradient<float>;  // with the rate 0 a free body
using BodyFilter = GuaranteedFilter<GuaranteedRigidBodyFlow<float, Gravity>>;
using GyroFilter = GuaranteedFilter<GuaranteedGyroFlow<float>>;
using FirstOrderBody = AttitudeFilter<RigidBodyFlow<float, Gravity>, FirstOrderEstimator>;
using FirstOrderGyro = AttitudeFilter<GyroFlow<float>, FirstOrderEstimator>;

static_assert(std::is_trivially_destructible_v<StampedFilter<BodyFilter>>);
static_assert(std::is_trivially_destructible_v<StampedFilter<FirstOrderGyro>>);

template <typename Filter, typename Stamp, typename = void>
struct TakesStamp : std::false_type {};
template <typename Filter, typename Stamp>
struct TakesStamp<Filter, Stamp,
                  std::void_t<decltype(std::declval<StampedFilter<Filter>&>().predict(
                      std::declval<Stamp>(), std::declval<const typename Filter::Input&>()))>> : std::true_type {};
static_assert(TakesStamp<GyroFilter, std::int64_t>::value && TakesStamp<GyroFilter, int>::value);
static_assert(!TakesStamp<GyroFilter, float>::value && !TakesStamp<GyroFilter, double>::value);

constexpr std::int64_t second = 1000000000;
constexpr std::int64_t cycle = second / 100;
constexpr int cycles = 193;
constexpr std::int64_t earliest = std::numeric_limits<std::int64_t>::min();
constexpr std::int64_t latest = std::numeric_limits<std::int64_t>::max();
constexpr float width = 1e-3F;  // of sets at the start, rad and rad/s

const Vector3f rate(0.3F, -0.2F, 0.5F);

Matrix3f start_attitude() { return exp(Vector3f(0.4F, -0.7F, 0.2F)); }
Matrix6<float> start_shape() { return width * width * Matrix6<float>::Identity(); }

template <typename Filter>
Filter started(const typename Filter::Flow& flow, float time) {
  using State = typename Filter::State;
  Filter filter;
  REQUIRE(Filter::make(flow, {}, time, filter) == Status::ok);
  const Vector3f vector = std::is_same_v<State, GyroState<float>> ? Vector3f(Vector3f::Zero()) : rate;
  REQUIRE(filter.start(GibbsEllipsoid<State>{{start_attitude(), vector}, start_shape()}) == Status::ok);
  return filter;
}

template <typename Filter>
Filter started_to_first_order(const typename Filter::Flow& flow, float time) {
  using State = typename Filter::State;
  Filter filter;
  const Vector3f vector = std::is_same_v<State, GyroState<float>> ? Vector3f(Vector3f::Zero()) : rate;
  REQUIRE(Filter::make(flow, SizeCriterion<float, 6>::volume(), time, {{start_attitude(), vector}, start_shape()},
                       filter) == Status::ok);
  return filter;
}

RigidBody<float> body() {
  RigidBody<float> result;
  REQUIRE(RigidBody<float>::make(Vector3f(1, 2, 2.5F).asDiagonal(), result) == Status::ok);
  return result;
}

Gravity gravity(float orbit_rate) {
  Gravity result;
  REQUIRE(Gravity::make(body(), orbit_rate, Matrix3f::Identity(), result) == Status::ok);
  return result;
}

BodyFilter guaranteed_body(float time, float orbit_rate = 0) {
  BodyFilter::Flow flow;
  REQUIRE(BodyFilter::Flow::make(body(), gravity(orbit_rate), 0.1F, {}, flow) == Status::ok);
  return started<BodyFilter>(flow, time);
}

GyroFilter guaranteed_gyro(float time, float drift = 0) {
  GyroUncertainty<float> uncertainty;
  uncertainty.drift = drift * drift * Matrix3f::Identity();
  GyroFilter::Flow flow;
  REQUIRE(GyroFilter::Flow::make(uncertainty, GyroFilter::Flow::IntervalRate::mean, flow) == Status::ok);
  return started<GyroFilter>(flow, time);
}

FirstOrderBody first_order_body(float time) {
  FirstOrderBody::Flow flow;
  REQUIRE(FirstOrderBody::Flow::make(body(), gravity(0), 0.1F, 2, Matrix3f::Zero(), flow) == Status::ok);
  return started_to_first_order<FirstOrderBody>(flow, time);
}

FirstOrderGyro first_order_gyro(float time) {
  FirstOrderGyro::Flow flow;
  REQUIRE(FirstOrderGyro::Flow::make(1e-8F * Matrix3f::Identity(), Matrix3f::Zero(), flow) == Status::ok);
  return started_to_first_order<FirstOrderGyro>(flow, time);
}

/// Bit for bit, but for the time.
template <typename Filter>
bool same_set(const Filter& a, const Filter& b) {
  const auto& one = a.ellipsoid();
  const auto& other = b.ellipsoid();
  return one.center.attitude == other.center.attitude && vector_part(one.center) == vector_part(other.center) &&
         one.shape == other.shape;
}

/// yᵀP⁻¹y of a truth, in long double.
template <typename Filter>
double form_of(const Filter& filter, const RealMatrix& attitude, const RealVector& vector) {
  const auto& center = filter.ellipsoid().center;
  const RigidBodyState<double> in_double{center.attitude.template cast<double>(),
                                         vector_part(center).template cast<double>()};
  const RealVector6 y = gibbs_error(in_double, {attitude, vector});
  return static_cast<double>(y.dot(RealMatrix6(filter.ellipsoid().shape.template cast<Real>()).ldlt().solve(y)));
}

/// A truth on the boundary of a filter's set.
template <typename Filter>
Motion on_boundary(const Filter& filter, Random& random) {
  const auto& center = filter.ellipsoid().center;
  const RealMatrix6 root = RealMatrix6(filter.ellipsoid().shape.template cast<Real>()).llt().matrixL();
  return gibbs_motion({center.attitude.template cast<double>(), vector_part(center).template cast<double>()},
                      RealVector6(0.9999L * (root * random.unit_vector<6>().cast<Real>())));
}

/// Turned about a constant rate.
RealMatrix turned(const RealMatrix& attitude, const RealVector& angular_velocity, Real duration) {
  const Real speed = angular_velocity.norm();
  return attitude * Eigen::AngleAxis<Real>(speed * duration, angular_velocity / speed).toRotationMatrix();
}

Real seconds(std::int64_t stamp) { return static_cast<Real>(stamp) / 1e9L; }

/// So many cycles of 10 ms, from a stamp on.
template <typename Make>
auto after_cycles(const Make& make, std::int64_t epoch, std::int64_t first, const Vector3f& gyro) {
  using Filter = decltype(make(0.0F));
  typename Filter::Input input;
  if constexpr (std::is_same_v<typename Filter::State, GyroState<float>>) {
    input.angular_velocity = gyro;
  }
  StampedFilter<Filter> filter(make(seconds_between<float>(epoch, first)), epoch, first);
  for (int k = 1; k <= cycles; ++k) {
    REQUIRE(filter.predict(first + k * cycle, input) == Status::ok);
  }
  CHECK(filter.stamp() == first + cycles * cycle);
  CHECK(filter.filter().time() == seconds_between<float>(epoch, filter.stamp()));
  return filter.filter();
}

/// The same with times in seconds.
template <typename Make>
auto after_scalar_cycles(const Make& make, std::int64_t first, const Vector3f& gyro) {
  using Filter = decltype(make(0.0F));
  typename Filter::Input input;
  if constexpr (std::is_same_v<typename Filter::State, GyroState<float>>) {
    input.angular_velocity = gyro;
  }
  Filter filter = make(static_cast<float>(seconds(first)));
  for (int k = 1; k <= cycles; ++k) {
    REQUIRE(filter.predict(static_cast<float>(seconds(first + k * cycle)), input) == Status::ok);
  }
  return filter;
}

/// Wherever the stamps are, the set is that of a filter near time zero. Seconds give another after a million of them.
template <typename Make>
void check_at_all_times(const Make& make) {
  const auto near = after_cycles(make, 0, 0, rate);
  const std::int64_t weeks = 1234567 * second + 890123457;
  CHECK(same_set(after_cycles(make, 0, weeks, rate), near));
  CHECK(same_set(after_cycles(make, weeks, weeks, rate), near));
  CHECK(same_set(after_cycles(make, earliest, earliest, rate), near));
  CHECK(same_set(after_cycles(make, latest - cycles * cycle, latest - cycles * cycle, rate), near));
  CHECK(same_set(after_cycles(make, earliest, latest - cycles * cycle, rate), near));
  CHECK(same_set(after_cycles(make, latest, earliest, rate), near));
  // By seconds the intervals sum up right to the spacing of the times, which is 0.125 s here.
  const auto late = after_scalar_cycles(make, weeks, rate);
  CHECK((late.ellipsoid().center.attitude - near.ellipsoid().center.attitude).norm() > 5 * width);
}

/// Refused, and nothing has changed.
template <typename Filter>
void check_refused(StampedFilter<Filter>& filter, std::int64_t stamp, const typename Filter::Input& input,
                   Status expected) {
  const StampedFilter<Filter> before = filter;
  CHECK(filter.predict(stamp, input) == expected);
  CHECK(filter.stamp() == before.stamp());
  CHECK(filter.epoch() == before.epoch());
  CHECK(filter.filter().time() == before.filter().time());
  CHECK(same_set(filter.filter(), before.filter()));
}

}  // namespace

TEST_CASE("seconds between any two stamps are right to rounding") {
  const auto check = [](std::int64_t from, std::int64_t to) {
    const Real exact = (static_cast<Real>(to) - static_cast<Real>(from)) / 1e9L;  // whose 64 bits hold any difference
    const auto is_right = [&](auto number) {
      const Real most = 1.0001L * static_cast<Real>(std::numeric_limits<decltype(number)>::epsilon());
      return std::fabs(static_cast<Real>(number) - exact) <= most * std::fabs(exact);
    };
    CHECK(is_right(seconds_between<float>(from, to)));
    CHECK(is_right(seconds_between<double>(from, to)));
    CHECK(seconds_between<float>(from, to) == -seconds_between<float>(to, from));
  };
  for (const std::int64_t from : {earliest, earliest + 1, std::int64_t{-1}, std::int64_t{0}, std::int64_t{1}, latest}) {
    for (const std::int64_t to : {earliest, std::int64_t{-7}, std::int64_t{0}, cycle, latest - 1, latest}) {
      check(from, to);
    }
  }
  Random random(1);
  for (int i = 0; i < 2000; ++i) {
    const auto from = static_cast<std::int64_t>(random.uniform(-9e18, 9e18));
    const auto step = static_cast<std::int64_t>(random.log_uniform(1, 9e18));
    check(from, from > 0 ? from - step : from + step);
  }
  CHECK(seconds_between<float>(latest - cycle, latest) == 0.01F);
  CHECK(seconds_between<double>(earliest, earliest + 20 * cycle) == 0.2);
  CHECK(seconds_between<double>(earliest, latest) == 18446744073.709551615);
}

TEST_CASE("a guaranteed set of a free body is the same at all stamps") {
  check_at_all_times([](float time) { return guaranteed_body(time); });
}
TEST_CASE("a guaranteed set of a gyro is the same at all stamps") {
  check_at_all_times([](float time) { return guaranteed_gyro(time, 1e-5F); });
}
TEST_CASE("a first-order set of a free body is the same at all stamps") { check_at_all_times(first_order_body); }
TEST_CASE("a first-order set of a gyro is the same at all stamps") { check_at_all_times(first_order_gyro); }

TEST_CASE("turns that were added up go by stamps too") {
  const auto after_turns = [](std::int64_t first) {
    StampedFilter<GyroFilter> filter(guaranteed_gyro(0, 1e-3F), first, first);
    for (int k = 1; k <= 100; ++k) {
      REQUIRE(filter.predict_turn(first + k * cycle, 0.01F * rate, 1e-5F) == Status::ok);
    }
    CHECK(filter.predict_turn(first + 100 * cycle - 1, rate, 0) == Status::out_of_range);
    CHECK(filter.stamp() == first + 100 * cycle);
    return filter.filter();
  };
  const GyroFilter near = after_turns(0);
  CHECK(same_set(after_turns(1234567 * second + 1), near));
  // The bias has drifted for a second, which only the duration tells.
  CHECK(std::sqrt(near.ellipsoid().shape(3, 3)) > 1.5F * width);
}

TEST_CASE("a stamped filter holds the truth where one by seconds has lost it") {
  Random random(2);
  const std::int64_t first = 1234567 * second + 890123457;
  for (int trial = 0; trial < 10; ++trial) {
    const auto make_gyro = [](float time) { return guaranteed_gyro(time); };
    const Motion turning = on_boundary(make_gyro(0), random);
    const RealMatrix end = turned(turning.attitude, rate.cast<Real>() - turning.angular_velocity, 1.93L);
    CHECK(form_of(after_cycles(make_gyro, 0, first, rate), end, turning.angular_velocity) <= 1);
    CHECK(form_of(after_scalar_cycles(make_gyro, first, rate), end, turning.angular_velocity) > 2);

    const auto make_body = [](float time) { return guaranteed_body(time); };
    const RealMatrix inertia = RealVector(1, 2, 2.5L).asDiagonal();
    const RealTorque none = [](const RealMatrix&, Real) { return RealVector(RealVector::Zero()); };
    const Motion moved = independent_flow(inertia, none, on_boundary(make_body(0), random), 0, 1.93L, 8);
    CHECK(form_of(after_cycles(make_body, 0, first, rate), moved.attitude, moved.angular_velocity) <= 1);
    CHECK(form_of(after_scalar_cycles(make_body, first, rate), moved.attitude, moved.angular_velocity) > 2);
  }
}

TEST_CASE("a gyro's set holds exact turns over stamps of any difference") {
  Random random(3);
  double worst = 0;
  for (int trial = 0; trial < 20; ++trial) {
    std::int64_t stamp = earliest / 2;
    StampedFilter<GyroFilter> filter(guaranteed_gyro(0), stamp, stamp);
    // Narrow sets, in which the rounding of long turns would show.
    GibbsEllipsoid<GyroState<float>> set = filter.filter().ellipsoid();
    set.shape *= 1e-4F;
    REQUIRE(filter.filter().start(set) == Status::ok);
    const Motion start = on_boundary(filter.filter(), random);
    RealMatrix truth = start.attitude;
    for (int k = 0; k < 200; ++k) {
      const auto step = static_cast<std::int64_t>(random.log_uniform(1e3, 3e9));
      const Vector3f gyro = (random.log_uniform(0.1, 30) * random.unit_vector<3>()).cast<float>();
      GyroFilter::Input input;
      input.angular_velocity = gyro;
      REQUIRE(filter.predict(stamp + step, input) == Status::ok);
      REQUIRE(filter.filter().knows_attitude());
      truth = turned(truth, gyro.cast<Real>() - start.angular_velocity, seconds(step));
      stamp += step;
      worst = std::fmax(worst, form_of(filter.filter(), truth, start.angular_velocity));
    }
  }
  INFO("worst form " << worst);
  CHECK(worst <= 1);
  CHECK(worst > 0.5);  // the truth is near the boundary where rounding is the least
}

TEST_CASE("a body's set holds exact motions over many stamps and long after the epoch of an orbit") {
  Random random(4);
  const RealMatrix inertia = RealVector(1, 2, 2.5L).asDiagonal();
  for (const float orbit_rate : {0.0F, 0.0625F}) {
    const Real n = static_cast<Real>(orbit_rate);
    const RealTorque torque = [&](const RealMatrix& c, Real t) { return gradient_torque(inertia, n, c, t); };
    for (const std::int64_t since_epoch : {std::int64_t{0}, 100000 * second + 123456789}) {
      double worst = 0;
      for (int trial = 0; trial < 4; ++trial) {
        std::int64_t stamp = since_epoch - second;
        StampedFilter<BodyFilter> filter(guaranteed_body(seconds_between<float>(-second, stamp), orbit_rate), -second,
                                         stamp);
        GibbsEllipsoid<RigidBodyState<float>> set = filter.filter().ellipsoid();
        set.shape *= 1e-2F;
        REQUIRE(filter.filter().start(set) == Status::ok);
        Motion truth = on_boundary(filter.filter(), random);
        for (int k = 0; k < 40; ++k) {
          const auto step = static_cast<std::int64_t>(random.log_uniform(1e6, 5e8));
          REQUIRE(filter.predict(stamp + step, {}) == Status::ok);
          REQUIRE(filter.filter().knows_attitude());
          truth = independent_flow(inertia, torque, truth, seconds(stamp + second), seconds(step), 1);
          stamp += step;
          worst = std::fmax(worst, form_of(filter.filter(), truth.attitude, truth.angular_velocity));
        }
      }
      INFO("orbit's rate " << orbit_rate << ", " << since_epoch / second << " s after the epoch: " << worst);
      CHECK(worst <= 1);
      CHECK(worst > 0.5);
    }
  }
}

TEST_CASE("a stamp that is refused changes nothing") {
  const std::int64_t first = 5000 * second;
  StampedFilter<GyroFilter> gyro(guaranteed_gyro(0), first, first);
  GyroFilter::Input input;
  input.angular_velocity = rate;
  REQUIRE(gyro.predict(first + cycle, input) == Status::ok);
  check_refused(gyro, first + cycle - 1, input, Status::out_of_range);
  check_refused(gyro, earliest, input, Status::out_of_range);
  input.angular_velocity.x() = std::numeric_limits<float>::quiet_NaN();
  check_refused(gyro, first + 2 * cycle, input, Status::not_finite);
  input.angular_velocity = rate;
  const GyroFilter before = gyro.filter();
  CHECK(gyro.predict(first + cycle, input) == Status::ok);  // no time
  CHECK(same_set(gyro.filter(), before));
  CHECK(gyro.predict(first + 2 * cycle, input) == Status::ok);

  StampedFilter<BodyFilter> free(guaranteed_body(0), first, first);
  REQUIRE(free.predict(first + cycle, {}) == Status::ok);
  check_refused(free, first, {}, Status::out_of_range);
  check_refused(free, first + 200000 * second, {}, Status::too_many_steps);
  check_refused(free, latest, {}, Status::too_many_steps);

  StampedFilter<FirstOrderBody> other(first_order_body(0), first, first);
  REQUIRE(other.predict(first + cycle, {}) == Status::ok);
  check_refused(other, first, {}, Status::out_of_range);
  check_refused(other, latest, {}, Status::too_many_steps);
}

TEST_CASE("a filter that was predicted without its stamp is not predicted to one") {
  StampedFilter<GyroFilter> filter(guaranteed_gyro(0), 0, 0);
  GyroFilter::Input input;
  input.angular_velocity = rate;
  REQUIRE(filter.predict(cycle, input) == Status::ok);
  REQUIRE(filter.filter().predict(0.02F, input) == Status::ok);
  check_refused(filter, 3 * cycle, input, Status::out_of_range);
  StampedFilter<FirstOrderGyro> never(first_order_gyro(1), 0, 0);  // made at another time
  check_refused(never, cycle, {rate}, Status::out_of_range);
}

TEST_CASE("what knows nothing has a stamp") {
  GyroFilter filter;
  StampedFilter<GyroFilter> unmade;
  GyroFilter::Input input;
  input.angular_velocity = rate;
  CHECK(unmade.stamp() == 0);
  CHECK(unmade.epoch() == 0);
  CHECK(unmade.filter().claim() == Claim::none);
  REQUIRE(GyroFilter::make(guaranteed_gyro(0).flow(), {}, 0, filter) == Status::ok);
  StampedFilter<GyroFilter> stamped(filter, earliest, earliest);
  CHECK(stamped.predict(latest, input) == Status::ok);
  CHECK(stamped.stamp() == latest);
  CHECK(stamped.filter().time() == seconds_between<float>(earliest, latest));
  CHECK(!stamped.filter().knows_attitude());
}

TEST_CASE("an interval and its end must be times") {
  const float none = std::numeric_limits<float>::quiet_NaN();
  GyroFilter gyro = guaranteed_gyro(0);
  FirstOrderGyro other = first_order_gyro(0);
  GyroFilter::Input input;
  input.angular_velocity = rate;
  CHECK(gyro.predict_interval(none, 1, input) == Status::not_finite);
  CHECK(gyro.predict_interval(1, none, input) == Status::not_finite);
  CHECK(gyro.predict_interval(1, -1, input) == Status::out_of_range);
  CHECK(gyro.predict_turn_interval(none, 1, rate, 0) == Status::not_finite);
  CHECK(gyro.predict_turn_interval(1, -1, rate, 0) == Status::out_of_range);
  CHECK(other.predict_interval(none, 1, {rate}) == Status::not_finite);
  CHECK(other.predict_interval(1, -1, {rate}) == Status::out_of_range);
  CHECK(gyro.time() == 0);
  CHECK(other.time() == 0);
  CHECK(same_set(gyro, guaranteed_gyro(0)));
  CHECK(same_set(other, first_order_gyro(0)));
}
