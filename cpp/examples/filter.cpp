#include <elliptude/elliptude.hpp>
#include <iostream>

using namespace elliptude;
using Flow = RigidBodyFlow<double, FreeBody<double>>;
using Filter = AttitudeFilter<Flow, FirstOrderEstimator>;

int main() {
  RigidBody<double> body;
  Flow flow;
  Filter filter;
  const Matrix3<double> inertia = Vector3<double>(1.0, 2.8, 2.0).asDiagonal();  // kg m²
  const StateEllipsoid<RigidBodyState<double>> start{{Matrix3<double>::Identity(), Vector3<double>(0.1, 0.2, 0.3)},
                                                     0.04 * Matrix6<double>::Identity()};  // 0.2 rad and 0.2 rad/s
  const bool made =
      RigidBody<double>::make(inertia, body) == Status::ok &&
      Flow::make(body, {}, 0.01, 2, Matrix3<double>::Zero(), flow) == Status::ok &&  // 10 ms steps of order 2
      Filter::make(flow, SizeCriterion<double, 6>::volume(), 0.0, start, filter) == Status::ok;
  const auto star = Direction<double>::within({0, 0, 1}, {0.01, 0.02, 1}, 0.02);  // reference, body, within 0.02 rad
  Update<double> update{};
  if (!made || filter.predict(0.1, {}) != Status::ok || filter.update(&star, 1, update) != Status::ok) {
    return 1;
  }
  const auto widths = half_widths(filter.ellipsoid().in_coordinates());
  std::cout << "half-widths about the body axes, rad: " << widths.head<3>().transpose() << '\n';
  return 0;
}
