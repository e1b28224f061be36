// Single questions to what one update leaves possible: how far a spacecraft may be turned about its camera's axis, how
// fast it may turn about that axis, and the set of its attitude alone. Each answer is sharper than the filter's set,
// which answers all at once.
#include <elliptude/elliptude.hpp>
#include <iostream>

using namespace elliptude;
using Flow = GuaranteedRigidBodyFlow<double, FreeBody<double>>;
using Filter = GuaranteedFilter<Flow>;

int main() {
  RigidBody<double> body;
  Flow flow;
  Filter filter;
  const Matrix3<double> inertia = Vector3<double>(1.0, 2.8, 2.0).asDiagonal();  // kg m²
  if (RigidBody<double>::make(inertia, body) != Status::ok || Flow::make(body, {}, 0.05, {}, flow) != Status::ok ||
      Filter::make(flow, {}, 0.0, filter) != Status::ok) {
    return 1;
  }

  // Two directions within 0.1 rad and a rate within 0.1 rad/s, at two moments.
  const Vector3<double> sun(1, 0, 0);
  const Vector3<double> field(0, 0.6, 0.8);
  const std::array<Direction<double>, 2> directions{Direction<double>::within(sun, sun, 0.1),
                                                    Direction<double>::within(field, field, 0.1)};
  const auto rate = AngularVelocity<double>::within(Vector3<double>::Zero(), 0.1);  // rad/s
  GuaranteedUpdate<double> update;
  UpdateConstraints<RigidBodyState<double>> constraints;
  for (const double time : {0.0, 0.5}) {
    if (filter.predict(time, {}) != Status::ok ||
        filter.update({directions.data(), directions.size(), &rate, nullptr}, update, constraints) != Status::ok) {
      return 1;
    }
  }

  const Vector3<double> camera(0, 0, 1);  // body axes
  Interval<double> turn{};
  Interval<double> speed{};
  AttitudeSet<double> attitude;
  if (constraints.turn_about(camera, turn) != Status::ok || constraints.vector_along(camera, speed) != Status::ok ||
      constraints.attitude_set(SizeCriterion<double, 3>::volume(), attitude) != Status::ok) {
    return 1;
  }
  // The truth did not move.
  if (!(turn.least <= 0 && 0 <= turn.most && speed.least <= 0 && 0 <= speed.most)) {
    return 1;
  }
  const auto widths = half_widths(filter.ellipsoid().in_coordinates());
  std::cout << "turn about the camera's axis: " << turn.least << " to " << turn.most << " rad; of the set " << widths(2)
            << " to either side\n"
            << "rate about it: " << speed.least << " to " << speed.most << " rad/s; of the set " << widths(5)
            << " to either side\n"
            << "half-widths of the attitude's own set: " << attitude.shape.diagonal().cwiseSqrt().transpose()
            << " rad; of the set " << widths.head<3>().transpose() << '\n';
  return 0;
}
