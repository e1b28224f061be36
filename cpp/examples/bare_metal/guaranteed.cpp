// The guaranteed filter of a rigid body under the gravity gradient and a torque that is not known.
#include "replay.hpp"

using namespace flight;
using Potential = elliptude::GravityGradient<Scalar>;
using Flow = elliptude::GuaranteedRigidBodyFlow<Scalar, Potential>;
using Filter = elliptude::GuaranteedFilter<Flow>;

int flight::run() {
  static Filter filter;
  elliptude::RigidBody<Scalar> body;
  Potential potential;
  Flow flow;
  elliptude::BodyUncertainty<Scalar> uncertainty;
  uncertainty.torque = ball(1e-4);  // N m
  const Measured first(recording[0]);
  elliptude::GuaranteedUpdate<Scalar> report;
  const auto update = [&](const Measured& now) {
    return filter.update({now.directions.data(), now.directions.size(), &now.rate, nullptr}, report);
  };
  if (elliptude::RigidBody<Scalar>::make(vector(moments).asDiagonal(), body) != Status::ok ||
      Potential::make(body, static_cast<Scalar>(orbit_rate), elliptude::Matrix3<Scalar>::Identity(), potential) !=
          Status::ok ||
      Flow::make(body, potential, static_cast<Scalar>(interval), uncertainty, flow) != Status::ok ||
      Filter::make(flow, {}, first.time, filter) != Status::ok || update(first) != Status::ok) {
    return 2;
  }
  return replay(filter, [](const Measured&, const Measured& now) { return filter.predict(now.time, {}); }, update);
}
