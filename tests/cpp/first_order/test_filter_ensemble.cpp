// Eigen adds up three products of one filter in another order where it uses SIMD registers of its own.
#define EIGEN_DONT_VECTORIZE
#include <doctest/doctest.h>

#include <array>
#include <cstring>
#include <elliptude/first_order/filter_ensemble.hpp>
#include <limits>
#include <random>
#include <vector>

using namespace elliptude;

namespace {

template <typename Derived>
[[nodiscard]] bool same_bits(const Eigen::MatrixBase<Derived>& a, const Eigen::MatrixBase<Derived>& b) {
  using Number = typename Derived::Scalar;
  return std::memcmp(a.derived().data(), b.derived().data(), sizeof(Number) * std::size_t(a.size())) == 0;
}

template <typename Filter>
[[nodiscard]] bool same_filter(const Filter& a, const Filter& b) {
  return same_bits(a.ellipsoid().center.attitude, b.ellipsoid().center.attitude) &&
         same_bits(vector_part(a.ellipsoid().center), vector_part(b.ellipsoid().center)) &&
         same_bits(a.ellipsoid().shape, b.ellipsoid().shape) && same_bits(a.transition(), b.transition()) &&
         same_bits(a.prior_shape(), b.prior_shape()) && a.time() == b.time();
}

template <typename Number>
class Random {
 public:
  [[nodiscard]] Vector3<Number> vector(double scale) {
    return Vector3<Number>(number(scale), number(scale), number(scale));
  }
  /// A vector of at most this length.
  [[nodiscard]] Vector3<Number> in_ball(double radius) {
    const Vector3<Number> v = vector(1);
    return Number(radius * std::cbrt(std::generate_canonical<double, 53>(generator_))) * v / v.norm();
  }
  [[nodiscard]] Number number(double scale) { return Number(scale * normal_(generator_)); }

 private:
  std::mt19937 generator_{5};
  std::normal_distribution<double> normal_;
};

/// What one filter of a scene is about: a body that turns, and three stars.
template <typename Number>
struct Truth {
  RigidBodyState<Number> state;
  Matrix3<Number> stars;
};

template <typename Number, typename Potential>
[[nodiscard]] RigidBodyFlow<Number, Potential> flow_of(const Potential& potential, double unknown_torque) {
  Matrix3<Number> inertia;
  inertia << 2, 0.125, 0, 0.125, 3, 0.0625, 0, 0.0625, 4;
  RigidBody<Number> body;
  REQUIRE(RigidBody<Number>::make(inertia, body) == Status::ok);
  RigidBodyFlow<Number, Potential> flow;
  const Matrix3<Number> torque = Number(unknown_torque * unknown_torque) * Matrix3<Number>::Identity();
  REQUIRE(RigidBodyFlow<Number, Potential>::make(body, potential, scalar::constant<Number>(0.05L), 2, torque, flow) ==
          Status::ok);
  return flow;
}

/// Filters of one kind, each by itself and in lanes, that are told the same.
template <typename Filter, int Width>
struct Scene {
  using Number = typename Filter::Scalar;
  using Ensemble = FilterEnsemble<Filter, Width>;

  Ensemble ensemble;
  std::vector<Filter> alone;
  typename Ensemble::Lanes lanes;
  std::size_t apart = 0;  ///< how many times a filter of the ensemble went alone

  Scene(const typename Filter::Flow& flow, const SizeCriterion<Number, 6>& criterion,
        const std::vector<StateEllipsoid<typename Filter::State>>& start) {
    REQUIRE(Ensemble::make(flow, criterion, ensemble) == Status::ok);
    for (const auto& ellipsoid : start) {
      alone.emplace_back();
      REQUIRE(Filter::make(flow, criterion, Number(0.25), ellipsoid, alone.back()) == Status::ok);
    }
    Ensemble::put(alone.data(), alone.size(), lanes);
  }

  void check() const {
    for (std::size_t i = 0; i < alone.size(); ++i) {
      Filter filter;
      REQUIRE(ensemble.filter(lanes, i, filter) == Status::ok);
      CAPTURE(i);
      REQUIRE(same_filter(filter, alone[i]));
    }
  }

  [[nodiscard]] std::vector<Status> predict(Number time, const std::vector<typename Filter::Input>& inputs) {
    std::vector<Status> statuses(alone.size(), Status::corrupted);
    apart += ensemble.predict(time, inputs.data(), lanes, statuses.data());
    for (std::size_t i = 0; i < alone.size(); ++i) {
      CHECK(alone[i].predict(time, inputs[i]) == statuses[i]);
    }
    check();
    return statuses;
  }

  /// \param together updates the lanes, \param one updates one filter.
  template <typename Together, typename One>
  [[nodiscard]] std::vector<Status> updated(const Together& together, const One& one) {
    std::vector<Status> statuses(alone.size(), Status::corrupted);
    std::vector<Update<Number>> updates(alone.size(), {Number(-7), Number(-7)});
    apart += together(updates.data(), statuses.data());
    for (std::size_t i = 0; i < alone.size(); ++i) {
      Update<Number> update{Number(-7), Number(-7)};
      CHECK(one(i, update) == statuses[i]);
      CHECK(update.share == updates[i].share);
      CHECK(update.margin == updates[i].margin);
    }
    check();
    return statuses;
  }

  [[nodiscard]] std::vector<Status> update(const std::vector<Direction<Number>>& directions,
                                           const std::vector<AngularVelocity<Number>>& rates) {
    const std::size_t count = directions.size() / alone.size();
    return updated(
        [&](auto* updates, Status* statuses) {
          return ensemble.update(directions.data(), count, rates.data(), lanes, updates, statuses);
        },
        [&](std::size_t i, auto& update) {
          return alone[i].update(directions.data() + i * count, count, rates[i], update);
        });
  }
  [[nodiscard]] std::vector<Status> update(const std::vector<Direction<Number>>& directions) {
    const std::size_t count = directions.size() / alone.size();
    return updated(
        [&](auto* updates, Status* statuses) {
          return ensemble.update(directions.data(), count, lanes, updates, statuses);
        },
        [&](std::size_t i, auto& update) { return alone[i].update(directions.data() + i * count, count, update); });
  }
  template <typename Measurement>
  [[nodiscard]] std::vector<Status> update_by(const std::vector<Measurement>& measured) {
    return updated(
        [&](auto* updates, Status* statuses) { return ensemble.update(measured.data(), lanes, updates, statuses); },
        [&](std::size_t i, auto& update) { return alone[i].update(measured[i], update); });
  }
};

/// Bodies, and what their sensors measure within their bounds; filter i's differ by up to 10 in scale from those of its neighbours.
template <typename Number>
struct Bodies {
  Random<Number> random;
  std::vector<Truth<Number>> truths;
  double bound;

  Bodies(std::size_t count, double bound_of_all) : bound(bound_of_all) {
    for (std::size_t i = 0; i < count; ++i) {
      Matrix3<Number> stars;
      stars << random.vector(1), random.vector(1), random.vector(1);
      truths.push_back({{exp(random.vector(1)), random.vector(0.1)}, stars});
    }
  }
  [[nodiscard]] double scale(std::size_t i) const { return bound * std::pow(10.0, 0.25 * double(i % 5)); }

  /// Poor ones, at first.
  [[nodiscard]] std::vector<StateEllipsoid<RigidBodyState<Number>>> start() {
    std::vector<StateEllipsoid<RigidBodyState<Number>>> result;
    for (const Truth<Number>& truth : truths) {
      Matrix6<Number> shape = Number(0.25) * Matrix6<Number>::Identity();
      shape(0, 4) = shape(4, 0) = Number(0.03125);
      result.push_back({{truth.state.attitude * exp(random.in_ball(0.2)), truth.state.angular_velocity}, shape});
    }
    return result;
  }

  template <typename Flow>
  void move(const Flow& flow, Number time, Number duration) {
    for (Truth<Number>& truth : truths) {
      REQUIRE(integrate(flow.body(), flow.potential(), flow.composition(), time, duration, 1L,
                        Vector3<Number>(Vector3<Number>::Zero()), truth.state, truth.state,
                        [](long, const RigidBodyState<Number>&) {}) == Status::ok);
    }
  }

  [[nodiscard]] std::vector<Direction<Number>> directions(int count) {
    std::vector<Direction<Number>> result;
    for (std::size_t i = 0; i < truths.size(); ++i) {
      for (int k = 0; k < count; ++k) {
        const Vector3<Number> star = truths[i].stars.col(k % 3) + Number(k / 3) * truths[i].stars.col((k + 1) % 3);
        const Vector3<Number> body =
            exp(random.in_ball(0.99 * scale(i))) * (truths[i].state.attitude.transpose() * star);
        result.push_back(Direction<Number>::within(star, body, Number(scale(i))));
        result.back().weight = Number(1 + k);
      }
    }
    return result;
  }
  [[nodiscard]] std::vector<MeasuredAttitude<Number>> attitudes() {
    std::vector<MeasuredAttitude<Number>> result;
    for (std::size_t i = 0; i < truths.size(); ++i) {
      Matrix3<Number> shape = Number(scale(i) * scale(i)) * Matrix3<Number>::Identity();
      shape(2, 2) *= Number(16);
      result.push_back({truths[i].state.attitude * exp(random.in_ball(0.99 * scale(i))), shape});
    }
    return result;
  }
  [[nodiscard]] std::vector<AngularVelocity<Number>> rates() {
    std::vector<AngularVelocity<Number>> result;
    for (std::size_t i = 0; i < truths.size(); ++i) {
      result.push_back({truths[i].state.angular_velocity + random.in_ball(0.99 * scale(i)),
                        Number(scale(i) * scale(i)) * Matrix3<Number>::Identity()});
    }
    return result;
  }
};

/// Adds how many of the filters did what they were asked.
void count_done(const std::vector<Status>& statuses, std::size_t& done) {
  for (const Status status : statuses) {
    done += status == Status::ok ? 1 : 0;
  }
}

template <typename Number>
[[nodiscard]] std::vector<SizeCriterion<Number, 6>> criteria() {
  Matrix6<Number> weight = Matrix6<Number>::Identity();
  weight(3, 3) = weight(4, 4) = Number(8);
  weight(1, 2) = weight(2, 1) = Number(0.5);
  return {SizeCriterion<Number, 6>::trace(), SizeCriterion<Number, 6>::volume(),
          SizeCriterion<Number, 6>::weighted_trace(weight)};
}

/// \param most_apart how many of a hundred steps of a filter may go alone.
template <typename Number, int Width, typename Estimator, typename Potential>
void moves_as_each_alone(const Potential& potential, double unknown_torque, int directions, double most_apart) {
  using Flow = RigidBodyFlow<Number, Potential>;
  using Filter = AttitudeFilter<Flow, Estimator>;
  const Flow flow = flow_of<Number>(potential, unknown_torque);
  constexpr std::size_t width = Width;
  for (const SizeCriterion<Number, 6>& criterion : criteria<Number>()) {
    for (const std::size_t count : {std::size_t{1}, width - 1, width}) {
      Bodies<Number> bodies(count, 0.003);
      Scene<Filter, Width> scene(flow, criterion, bodies.start());
      const std::vector<typename Filter::Input> inputs(count);
      Number time(0.25);
      std::size_t done = 0;
      constexpr int rows = 25;
      for (int row = 0; row < rows; ++row) {
        const Number end = time + Number(row % 5 == 4 ? 0.125 : 0.03125);
        bodies.move(flow, time, Number(end - time));
        time = end;
        count_done(scene.predict(time, inputs), done);
        count_done(scene.update(bodies.directions(directions), bodies.rates()), done);
      }
      CHECK(done == 2 * rows * count);
      CHECK(double(scene.apart) <= 0.01 * most_apart * double(2 * rows * count));
    }
  }
}

/// With directions, an attitude and an angular velocity each by itself: linear measurements.
template <typename Number, int Width, typename Estimator>
void takes_linear_measurements_as_each_alone(double most_apart) {
  using Flow = RigidBodyFlow<Number, FreeBody<Number>>;
  using Filter = AttitudeFilter<Flow, Estimator>;
  const Flow flow = flow_of<Number>(FreeBody<Number>(), 1e-4);
  constexpr std::size_t width = Width;
  for (const SizeCriterion<Number, 6>& criterion : criteria<Number>()) {
    Bodies<Number> bodies(width, 0.003);
    Scene<Filter, Width> scene(flow, criterion, bodies.start());
    const std::vector<typename Filter::Input> inputs(width);
    Number time(0.25);
    std::size_t done = 0;
    constexpr int rows = 12;
    for (int row = 0; row < rows; ++row) {
      bodies.move(flow, time, scalar::constant<Number>(0.03125L));
      time += scalar::constant<Number>(0.03125L);
      count_done(scene.predict(time, inputs), done);
      count_done(scene.update(bodies.directions(3)), done);
      count_done(scene.update_by(bodies.rates()), done);
      count_done(scene.update_by(bodies.attitudes()), done);
    }
    CHECK(done == 4 * rows * width);
    CHECK(double(scene.apart) <= 0.01 * most_apart * double(done));
  }
}

/// Gyros of bodies at rest.
template <typename Number, int Width, typename Estimator>
void follows_gyros_as_each_alone(double drift, double most_apart) {
  using Filter = AttitudeFilter<GyroFlow<Number>, Estimator>;
  GyroFlow<Number> flow;
  const Matrix3<Number> unit = Matrix3<Number>::Identity();
  REQUIRE(GyroFlow<Number>::make(scalar::constant<Number>(1e-6L) * unit, Number(drift * drift) * unit, flow) ==
          Status::ok);
  constexpr std::size_t width = Width;
  for (const SizeCriterion<Number, 6>& criterion : criteria<Number>()) {
    Bodies<Number> bodies(width, 0.01);
    std::vector<StateEllipsoid<GyroState<Number>>> start;
    for (const Truth<Number>& truth : bodies.truths) {
      start.push_back({{truth.state.attitude * exp(bodies.random.in_ball(0.05)), bodies.random.in_ball(0.01)},
                       scalar::constant<Number>(0.01L) * Matrix6<Number>::Identity()});
    }
    Scene<Filter, Width> scene(flow, criterion, start);
    Number time(0.25);
    std::size_t done = 0;
    constexpr int rows = 20;
    for (int row = 0; row < rows; ++row) {
      time += scalar::constant<Number>(0.015625L);
      std::vector<typename Filter::Input> inputs;
      for (std::size_t i = 0; i < width; ++i) {
        inputs.push_back({bodies.random.in_ball(1e-3)});
      }
      count_done(scene.predict(time, inputs), done);
      count_done(scene.update(bodies.directions(2 + row % 2)), done);
      count_done(scene.update_by(bodies.attitudes()), done);
    }
    CHECK(done == 3 * rows * width);
    CHECK(double(scene.apart) <= 0.01 * most_apart * double(done));
  }
}

/// Poor filters of bodies, and what is measured of them; bounds of the angular velocity have an aspect, in any position.
struct Needles {
  using Flow = RigidBodyFlow<double, FreeBody<double>>;
  using Filter = AttitudeFilter<Flow, FirstOrderEstimator>;
  static constexpr std::size_t width = 8;

  Flow flow = flow_of<double>(FreeBody<double>(), 0);
  SizeCriterion<double, 6> criterion = SizeCriterion<double, 6>::trace();
  std::vector<StateEllipsoid<RigidBodyState<double>>> start;
  std::vector<Direction<double>> directions;
  std::vector<AngularVelocity<double>> rates;
  std::vector<Vector3<double>> along;  ///< the way from the predicted rate to the measured one

  Needles(Bodies<double>& bodies, double aspect)
      : start(bodies.start()), directions(bodies.directions(3)), rates(bodies.rates()) {
    for (std::size_t i = 0; i < width; ++i) {
      const Matrix3<double> axes = exp(bodies.random.vector(1));
      const Matrix3<double> root = bodies.scale(i) * axes * Vector3<double>(1, aspect, aspect * aspect).asDiagonal();
      const Matrix3<double> other = root * exp(bodies.random.vector(1)) * Vector3<double>(1, 2, 3).asDiagonal();
      rates[i].bound = symmetrized(Matrix3<double>(root * root.transpose()));
      start[i].shape = 0.25 * Matrix6<double>::Identity();
      start[i].shape.bottomRightCorner<3, 3>() = symmetrized(Matrix3<double>(other * other.transpose()));
      along.push_back(root * bodies.random.vector(1));
    }
  }
  void move_rate(std::size_t i, double way) { rates[i].value = start[i].center.angular_velocity + way * along[i]; }
  /// The longest way at which the measured set of filter i is found to meet the predicted one.
  [[nodiscard]] double touching(std::size_t i) {
    Filter made;
    REQUIRE(Filter::make(flow, criterion, 0.25, start[i], made) == Status::ok);
    double low = 0;
    double high = 100;
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (low + high);
      move_rate(i, middle);
      Filter filter = made;
      Update<double> update;
      const bool meets = filter.update(directions.data() + 3 * i, 3, rates[i], update) == Status::ok;
      (meets ? low : high) = middle;
    }
    return low;
  }
};

}  // namespace

TEST_CASE("linear measurements, each by itself, change filters side by side as each alone") {
  SUBCASE("four doubles") { takes_linear_measurements_as_each_alone<double, 4, FirstOrderEstimator>(2); }
  SUBCASE("eight doubles, mode paper") { takes_linear_measurements_as_each_alone<double, 8, PaperEstimator>(2); }
  SUBCASE("four floats") { takes_linear_measurements_as_each_alone<float, 4, FirstOrderEstimator>(10); }
}

TEST_CASE("gyros side by side are followed as each alone") {
  SUBCASE("four doubles") { follows_gyros_as_each_alone<double, 4, FirstOrderEstimator>(1e-3, 2); }
  SUBCASE("two doubles, mode paper, no drift") { follows_gyros_as_each_alone<double, 2, PaperEstimator>(0, 2); }
  SUBCASE("eight floats") { follows_gyros_as_each_alone<float, 8, FirstOrderEstimator>(1e-2, 5); }
}

TEST_CASE("filters side by side hold what each holds alone to the last bit") {
  UniformGravity<double> gravity;
  REQUIRE(UniformGravity<double>::make(1.0, 9.81, Vector3<double>(0, 0.02, 0.3), gravity) == Status::ok);
  SUBCASE("two doubles, mode paper") { moves_as_each_alone<double, 2, PaperEstimator>(FreeBody<double>(), 0, 3, 2); }
  SUBCASE("four doubles, an unknown torque") {
    moves_as_each_alone<double, 4, FirstOrderEstimator>(FreeBody<double>(), 1e-3, 2, 2);
  }
  SUBCASE("eight doubles, a pendulum") { moves_as_each_alone<double, 8, FirstOrderEstimator>(gravity, 0, 5, 2); }
  SUBCASE("four floats") { moves_as_each_alone<float, 4, FirstOrderEstimator>(FreeBody<float>(), 0, 3, 2); }
}

TEST_CASE("what is unusual in one lane is done alone there, and changes no other") {
  using Flow = RigidBodyFlow<double, FreeBody<double>>;
  using Filter = AttitudeFilter<Flow, FirstOrderEstimator>;
  const Flow flow = flow_of<double>(FreeBody<double>(), 0);
  Bodies<double> bodies(8, 0.003);
  auto start = bodies.start();
  start[4].shape *= 1e-12;  // nothing is learnt from a measurement
  start[4].center = bodies.truths[4].state;
  start[5].shape *= 1e10;  // and nothing from the prior
  Scene<Filter, 8> scene(flow, SizeCriterion<double, 6>::trace(), start);
  std::vector<Direction<double>> directions = bodies.directions(3);
  std::vector<AngularVelocity<double>> rates = bodies.rates();
  rates[1].value += Vector3<double>(0, 3, 0);
  rates[2].value(0) = std::nan("");
  directions[10] = directions[11] = directions[9];  // of filter 3: collinear
  directions[18].weight = 0;                        // of filter 6
  rates[7].bound(1, 2) = 1e-14;                     // symmetric to half of the digits
  const std::vector<Status> statuses = scene.update(directions, rates);
  const Status none = Status::ok;
  CHECK(statuses == std::vector<Status>{none, Status::empty_intersection, Status::not_finite, none, none, none,
                                        Status::out_of_range, none});
  CHECK(scene.apart >= 4);
  CHECK(scene.apart <= 7);
}

TEST_CASE("a bound that only its last coordinate makes indefinite is refused in its lane") {
  using Filter = AttitudeFilter<RigidBodyFlow<double, FreeBody<double>>, FirstOrderEstimator>;
  Bodies<double> bodies(4, 0.003);
  Scene<Filter, 4> scene(flow_of<double>(FreeBody<double>(), 0), SizeCriterion<double, 6>::trace(), bodies.start());
  std::vector<Direction<double>> directions = bodies.directions(3);
  Matrix3<double>& bound = directions[7].bound;  // of filter 2; the sum with the other two is positive definite
  bound(0, 2) = bound(2, 0) = 1.01 * std::sqrt(bound(0, 0) * bound(2, 2));
  const Status none = Status::ok;
  CHECK(scene.update(directions, bodies.rates()) ==
        std::vector<Status>{none, none, Status::not_positive_definite, none});
  CHECK(scene.apart == 1);
}

TEST_CASE("where it is rounding whether two sets meet a lane says what the filter says alone") {
  Bodies<double> bodies(Needles::width, 0.003);
  std::size_t empty = 0;
  std::size_t met = 0;
  for (const double aspect : {1.0, 1e-2, 1e-3}) {
    for (int trial = 0; trial < 8; ++trial) {
      Needles needles(bodies, aspect);
      std::array<double, Needles::width> touching;
      for (std::size_t i = 0; i < Needles::width; ++i) {
        touching[i] = needles.touching(i);
      }
      for (const double beyond : {-1e-6, -1e-10, -1e-12, 0.0, 1e-14, 1e-12, 1e-8}) {
        for (std::size_t i = 0; i < Needles::width; ++i) {
          needles.move_rate(i, (1 + beyond) * touching[i]);
        }
        Scene<Needles::Filter, int{Needles::width}> scene(needles.flow, needles.criterion, needles.start);
        for (const Status status : scene.update(needles.directions, needles.rates)) {
          met += status == Status::ok ? 1 : 0;
          empty += status == Status::empty_intersection ? 1 : 0;
        }
      }
    }
  }
  CHECK(met > 400);
  CHECK(empty > 400);
}

TEST_CASE("filters whose times have come apart go on, each by itself") {
  using Flow = RigidBodyFlow<double, FreeBody<double>>;
  using Filter = AttitudeFilter<Flow, FirstOrderEstimator>;
  const Flow flow = flow_of<double>(FreeBody<double>(), 0);
  Bodies<double> bodies(4, 0.003);
  auto start = bodies.start();
  start[2].center.angular_velocity = Vector3<double>(500, 0, 0);
  Scene<Filter, 4> scene(flow, SizeCriterion<double, 6>::trace(), start);
  const std::vector<Filter::Input> inputs(4);
  const Status none = Status::ok;
  CHECK(scene.predict(0.5, inputs) == std::vector<Status>{none, none, Status::step_too_long, none});
  CHECK(scene.apart == 4);
  CHECK(scene.predict(0.25, inputs) ==
        std::vector<Status>{Status::out_of_range, Status::out_of_range, none, Status::out_of_range});
  CHECK(scene.predict(std::nan(""), inputs) == std::vector<Status>(4, Status::not_finite));
  CHECK(scene.predict(1e9, inputs) == std::vector<Status>(4, Status::too_many_steps));
}

TEST_CASE("one direction, none, and an attitude that is none are refused or taken as alone") {
  using Filter = AttitudeFilter<GyroFlow<double>, FirstOrderEstimator>;
  GyroFlow<double> flow;
  REQUIRE(GyroFlow<double>::make(1e-6 * Matrix3<double>::Identity(), Matrix3<double>::Zero(), flow) == Status::ok);
  Bodies<double> bodies(3, 0.01);
  std::vector<StateEllipsoid<GyroState<double>>> start;
  for (const Truth<double>& truth : bodies.truths) {
    start.push_back({{truth.state.attitude, Vector3<double>::Zero()}, 0.01 * Matrix6<double>::Identity()});
  }
  Scene<Filter, 4> scene(flow, SizeCriterion<double, 6>::trace(), start);
  CHECK(scene.update(bodies.directions(1)) == std::vector<Status>(3, Status::ok));
  CHECK(scene.apart == 3);
  CHECK(scene.update(std::vector<Direction<double>>()) == std::vector<Status>(3, Status::out_of_range));
  std::vector<MeasuredAttitude<double>> attitudes = bodies.attitudes();
  attitudes[1].attitude *= 1.5;
  attitudes[2].bound *= -1;
  CHECK(scene.update_by(attitudes) ==
        std::vector<Status>{Status::ok, Status::not_a_rotation, Status::not_positive_definite});
}

TEST_CASE("an ensemble is made of a valid criterion, and a lane is a filter of its own") {
  using Filter = AttitudeFilter<GyroFlow<double>, PaperEstimator>;
  FilterEnsemble<Filter, 2> ensemble;
  CHECK(FilterEnsemble<Filter, 2>::make(GyroFlow<double>(),
                                        SizeCriterion<double, 6>::weighted_trace(-Matrix6<double>::Identity()),
                                        ensemble) == Status::not_positive_definite);
  REQUIRE(FilterEnsemble<Filter, 2>::make(GyroFlow<double>(), SizeCriterion<double, 6>::trace(), ensemble) ==
          Status::ok);
  const std::vector<Filter> unmade(1);
  FilterLanes<Filter, 2> lanes;
  FilterEnsemble<Filter, 2>::put(unmade.data(), 1, lanes);
  Filter filter;
  CHECK(ensemble.filter(lanes, 0, filter) == Status::not_finite);
  Status status = Status::ok;
  const Filter::Input input{Vector3<double>::Zero()};
  CHECK(ensemble.predict(1.0, &input, lanes, &status) == 1);
  CHECK(status == Status::not_finite);
}
