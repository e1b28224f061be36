#pragma once

/// \file
/// A filter of the paper's or the first-order mode, told anything: it is in a valid state at all times, and as it was after
/// whatever it refuses. It makes no promise of the truth.

#include <type_traits>

#include "worlds.hpp"

namespace elliptude::fuzz {

template <typename Filter>
void require_state(const Filter& filter, const char* what) {
  const auto& set = filter.ellipsoid();
  require(std::isfinite(filter.time()), "the time is finite", what);
  require(validate(set) == Status::ok, "ok means finite and not negative", what);
  if (!(rotation_error(set.center.attitude) < 1e-12)) {
    show("attitude", set.center.attitude);
    broken("the center is a rotation", what);
  }
  require(filter.transition().allFinite() && filter.prior_shape().allFinite(), "the record is finite", what);
}

template <typename Filter>
void one_call(Bytes& bytes, Filter& filter, double most_duration) {
  constexpr bool measures_rate = std::is_same_v<typename Filter::State, RigidBodyState<double>>;
  const auto any_direction = [&]() {
    Direction<double> direction = {Eigen::Vector3d::UnitX(), bytes.unit_vector().template cast<double>(),
                                   Eigen::Matrix3d::Identity(), 1.0};
    const int kind = bytes.choice(6);
    if (kind == 0) {
      direction.reference = bytes.numbers<3, 1>();
    } else if (kind == 1) {
      direction.body = bytes.numbers<3, 1>();
    } else {
      direction.reference = bytes.unit_vector().template cast<double>();
    }
    direction.bound = kind == 2 ? bytes.any_shape<3>() : bytes.shape<3>(1e-9, 3);
    direction.weight = kind == 3 ? bytes.number() : 1.0;
    return direction;
  };
  const auto any_rate = [&]() {
    AngularVelocity<double> rate{bytes.numbers<3, 1>(), bytes.shape<3>(1e-9, 10)};
    if (bytes.choice(3) == 0) {
      rate.bound = bytes.any_shape<3>();
    }
    return rate;
  };
  Update<double> update{0.25, 0.5};
  const Snapshot before(filter);
  Status status = Status::ok;
  const char* what = "a prediction";
  switch (bytes.choice(5)) {
    case 0: {
      double time = filter.time() + (bytes.choice(3) == 0 ? bytes.number() : bytes.between(1e-6, 1));
      if (std::isfinite(time) && time > filter.time() + most_duration) {
        time = filter.time() + most_duration;
      }
      typename Filter::Input input;
      const double size = bytes.choice(3) == 0 ? bytes.number() : 1.0;
      if constexpr (measures_rate) {
        input.control_torque = size * bytes.units<3>();
      } else {
        input.angular_velocity = size * bytes.units<3>();
      }
      status = filter.predict(time, input);
      break;
    }
    case 1: {
      what = "directions";
      std::array<Direction<double>, 4> directions;
      const int count = bytes.choice(5);
      for (int i = 0; i < count; ++i) {
        directions[static_cast<std::size_t>(i)] = any_direction();
      }
      status = filter.update(directions.data(), static_cast<std::size_t>(count), update);
      break;
    }
    case 2: {
      what = "an attitude";
      MeasuredAttitude<double> attitude{bytes.rotation().template cast<double>(), bytes.shape<3>(1e-9, 3)};
      if (bytes.choice(3) == 0) {
        attitude.attitude = bytes.numbers<3, 3>();
      }
      if (bytes.choice(3) == 0) {
        attitude.bound = bytes.any_shape<3>();
      }
      status = filter.update(attitude, update);
      break;
    }
    case 3: {
      what = "a linear measurement";
      const LinearMeasurement<double, 3> linear{bytes.numbers<3, 1>(), bytes.numbers<3, 6>(), bytes.any_shape<3>()};
      status = filter.update(linear, update);
      break;
    }
    default:
      what = "directions and a rate";
      if constexpr (measures_rate) {
        const std::array<Direction<double>, 2> directions{any_direction(), any_direction()};
        const AngularVelocity<double> rate = any_rate();
        if (bytes.choice(2) == 0) {
          status = filter.update(rate, update);
        } else {
          const Filter predicted = filter;
          status = filter.update(directions.data(), 2, rate, update);
          if (bytes.choice(2) == 0 && status == Status::ok) {
            Convergence<double> diagnostics{-1, -1, -1, -1, -1, -1};
            const Status found = convergence(predicted, directions.data(), 2, rate, filter, update.share, diagnostics);
            require(found == Status::ok || diagnostics.flow_norm == -1, "nothing changed otherwise", "diagnostics");
          }
        }
      }
  }
  if (status != Status::ok) {
    require(before.unchanged(), "nothing changed otherwise", what);
    require(status == Status::empty_intersection || (update.share == 0.25 && update.margin == 0.5),
            "nothing changed otherwise", what);
  } else {
    require(update.share >= 0 && update.share <= 1 && update.margin <= 1, "what an update reports is possible", what);
  }
  require_state(filter, what);
}

template <typename World, typename Estimator>
void first_order_life(Bytes& bytes) {
  using Filter = AttitudeFilter<typename World::FirstOrderFlow, Estimator>;
  World world(bytes);
  const int order = 2 + 2 * bytes.choice(4);
  StateEllipsoid<typename World::State> set;
  const auto honest = honest_set(bytes, world);
  set.center = honest.center;
  set.shape = bytes.choice(4) == 0 ? bytes.any_shape<6>() : honest.shape;
  if (bytes.choice(8) == 0) {
    set.center = {bytes.numbers<3, 3>(), bytes.numbers<3, 1>()};
  }
  Filter filter;
  if (Filter::make(world.first_order_flow(order), bytes.criterion(), 0.0, set, filter) != Status::ok) {
    return;
  }
  for (int calls = 1 + bytes.choice(8); calls > 0 && !bytes.at_end(); --calls) {
    one_call(bytes, filter, world.most_duration());
  }
}

template <typename World>
void first_order_session(Bytes bytes) {
  if (bytes.choice(4) == 0) {
    first_order_life<World, PaperEstimator>(bytes);
  } else {
    first_order_life<World, FirstOrderEstimator>(bytes);
  }
}

}  // namespace elliptude::fuzz
