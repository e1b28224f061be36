#pragma once

/// \file
/// A guaranteed flow by itself: honest predictions one after another, whose sets must hold the truth, and predictions of
/// anything, which must be refused or be valid.

#include "worlds.hpp"

namespace elliptude::fuzz {

/// What may be said of any prediction.
template <typename World>
void any_prediction(Bytes& bytes, const World& world) {
  const typename World::Flow flow = world.flow();
  typename World::Set set;
  World other = world;
  if (bytes.choice(2) == 0) {
    set = honest_set(bytes, other);
  } else {
    set.center = {bytes.choice(2) == 0 ? Eigen::Matrix3d(Eigen::Matrix3d::Identity()) : bytes.numbers<3, 3>(),
                  bytes.numbers<3, 1>()};
    set.shape = bytes.any_shape<6>();
    if (validate(set) != Status::ok || !is_shape<6>(set.shape)) {
      return;  // a filter holds no such set
    }
  }
  const double time = bytes.choice(2) == 0 ? 0.0 : bytes.number();
  double duration = bytes.choice(2) == 0 ? bytes.between(1e-9, 10) : bytes.number();
  if (duration > world.most_duration() && std::isfinite(duration)) {
    duration = world.most_duration();
  }
  const typename World::Flow::Input input = World::any_input(bytes);
  typename World::Set result = set;
  const Snapshot before(result);
  const Status status = flow.predict(time, duration, input, set, result);
  if (status == Status::ok) {
    if (duration != 0) {
      require_valid(result, "a prediction of anything", flat_to_rounding);
    }
  } else {
    require(before.unchanged(), "nothing changed otherwise", "a prediction of anything");
  }
  const Ellipsoid<double, 3> vector{bytes.numbers<3, 1>(), bytes.any_shape<3>()};
  if (vector.center.allFinite() && is_shape<3>(vector.shape)) {
    Ellipsoid<double, 3> later = vector;
    const Snapshot vector_before(later);
    if (flow.predict_vector(time, duration, input, vector, later) == Status::ok) {
      require_valid(later, "a vector of anything", flat_to_rounding);
    } else {
      require(vector_before.unchanged(), "nothing changed otherwise", "a vector of anything");
    }
  }
}

template <typename World>
void flow_session(Bytes bytes) {
  World world(bytes);
  if (bytes.choice(4) == 0) {
    any_prediction(bytes, world);
    return;
  }
  const typename World::Flow flow = world.flow();
  typename World::Set set = honest_set(bytes, world);
  require_inside(world, set, "the first set");
  Ellipsoid<double, 3> vector{vector_part(set.center), set.shape.template bottomRightCorner<3, 3>()};
  const int most = 1 + bytes.choice(4);
  for (int step = 0; step < most; ++step) {
    const double time = world.time;
    const double end = time + bytes.between(1e-4, 1);
    const double duration = end - time;
    if (!world.is_moderate(duration)) {
      return;
    }
    const typename World::Flow::Input input = world.advance(bytes, end);
    typename World::Set next = set;
    const Snapshot before(next);
    if (const Status status = flow.predict_vector(time, duration, input, vector, vector); status == Status::ok) {
      require_valid(vector, "the vector");
      const RealVector error = world.vector() - vector.center.template cast<Real>();
      require(outside_by<3>(vector.shape, error) <= 0, "the truth is inside", "the vector");
    } else {
      broken("a valid prediction is not refused", message(status));
    }
    const Status status = flow.predict(time, duration, input, set, next);
    if (status != Status::ok) {
      require(before.unchanged(), "nothing changed otherwise", "a prediction");
      require(status == Status::unbounded || status == Status::step_too_long, "a valid prediction is not refused",
              message(status));
      return;
    }
    require_valid(next, "a prediction");
    require_inside(world, next, "a prediction");
    set = next;
  }
}

}  // namespace elliptude::fuzz
