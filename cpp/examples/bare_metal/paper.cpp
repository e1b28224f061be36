// The paper's estimator of a rigid body under the gravity gradient.
#include "replay.hpp"

using namespace flight;
using Potential = elliptude::GravityGradient<Scalar>;
using Flow = elliptude::RigidBodyFlow<Scalar, Potential>;
using Filter = elliptude::AttitudeFilter<Flow, elliptude::DeterminedPaperEstimator>;

int flight::run() {
  static Filter filter;
  elliptude::RigidBody<Scalar> body;
  Potential potential;
  Flow flow;
  const auto criterion = elliptude::SizeCriterion<Scalar, 6>::volume();
  const Measured first(recording[0]);
  elliptude::MeasuredDirections<Scalar> directions;
  elliptude::StateEllipsoid<Filter::State> start;
  if (elliptude::RigidBody<Scalar>::make(vector(moments).asDiagonal(), body) != Status::ok ||
      Potential::make(body, static_cast<Scalar>(orbit_rate), elliptude::Matrix3<Scalar>::Identity(), potential) !=
          Status::ok ||
      Flow::make(body, potential, static_cast<Scalar>(interval), 2, elliptude::Matrix3<Scalar>::Zero(), flow) !=
          Status::ok ||
      elliptude::MeasuredDirections<Scalar>::make(first.directions.data(), first.directions.size(), directions) !=
          Status::ok ||
      measured_state(directions, first.rate, criterion, start) != Status::ok ||
      Filter::make(flow, criterion, first.time, start, filter) != Status::ok) {
    return 2;
  }
  elliptude::Update<Scalar> report;
  return replay(
      filter, [](const Measured&, const Measured& now) { return filter.predict(now.time, {}); },
      [&](const Measured& now) {
        return filter.update(now.directions.data(), now.directions.size(), now.rate, report);
      });
}
