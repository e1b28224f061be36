// The guaranteed filter of a body of which nothing is known but what its gyro says.
#include "replay.hpp"

using namespace flight;
using Flow = elliptude::GuaranteedGyroFlow<Scalar>;
using Filter = elliptude::GuaranteedFilter<Flow>;

int flight::run() {
  static Filter filter;
  Flow flow;
  elliptude::GyroUncertainty<Scalar> uncertainty;
  uncertainty.noise = ball(rate_bound);
  uncertainty.angular_acceleration =
      static_cast<Scalar>(0.2);  // rad/s²: more than the torques and the gyroscopic term make
  const Measured first(recording[0]);
  elliptude::GuaranteedUpdate<Scalar> report;
  const auto update = [&](const Measured& now) {
    return filter.update({now.directions.data(), now.directions.size(), nullptr, nullptr}, report);
  };
  if (Flow::make(uncertainty, Flow::IntervalRate::first_sample, flow) != Status::ok ||
      Filter::make(flow, {}, first.time, filter) != Status::ok ||
      filter.bound_vector({Vector3<Scalar>::Zero(), ball(0.01)}) != Status::ok || update(first) != Status::ok) {
    return 2;
  }
  const auto predict = [](const Measured& before, const Measured& now) {
    Flow::Input input;
    input.angular_velocity = before.rate.value;
    return filter.predict(now.time, input);
  };
  return replay(filter, predict, update);
}
