// A spacecraft that spins about a principal axis, with a star tracker, a Sun sensor and a gyro whose errors are
// bounded. At one moment the Sun sensor sees a reflection instead: the filter proves that something is wrong, leaves it
// out, and says so.
#include <elliptude/elliptude.hpp>
#include <iostream>

using namespace elliptude;
using Flow = GuaranteedRigidBodyFlow<double, FreeBody<double>>;
using Filter = GuaranteedFilter<Flow>;

int main() {
  RigidBody<double> body;
  Flow flow;
  Filter filter;
  BodyUncertainty<double> uncertainty;
  uncertainty.torque = ball_shape<3>(1e-3);  // any torque of up to 1 mN m, however it changes
  Filter::Settings settings;                 // the least volume
  settings.policy = Policy::drop_measurement;
  const Matrix3<double> inertia = Vector3<double>(1.0, 2.8, 2.0).asDiagonal();  // kg m²
  if (RigidBody<double>::make(inertia, body) != Status::ok ||
      Flow::make(body, {}, 0.05, uncertainty, flow) != Status::ok ||  // steps of at most 50 ms
      Filter::make(flow, settings, 0.0, filter) != Status::ok) {
    return 1;
  }

  const Vector3<double> spin(0, 0.2, 0);  // rad/s
  const Vector3<double> star(0, 0.6, 0.8);
  const Vector3<double> sun(1, 0, 0);
  for (int k = 0; k <= 10; ++k) {
    const double time = 0.5 * k;
    const Matrix3<double> truth = exp(Vector3<double>(time * spin));
    const Vector3<double> star_seen = exp(Vector3<double>(0, 0.004, -0.002)) * (truth.transpose() * star);
    const Vector3<double> sun_seen = k == 6 ? Vector3<double>(0, 0, 1) : Vector3<double>(truth.transpose() * sun);
    const std::array<Direction<double>, 2> directions{Direction<double>::within(star, star_seen, 0.005),
                                                      Direction<double>::within(sun, sun_seen, 0.02)};
    const auto rate = AngularVelocity<double>::within(spin + Vector3<double>(0.001, -0.001, 0.001), 0.0032);  // rad/s

    GuaranteedUpdate<double> update;
    if (filter.predict(time, {}) != Status::ok ||
        filter.update({directions.data(), directions.size(), &rate, nullptr}, update) != Status::ok ||
        !filter.knows_attitude()) {
      return 1;
    }
    double form = 0;  // at most 1 in the set
    if (quadratic_form(filter.ellipsoid(), RigidBodyState<double>{truth, spin}, form) != Status::ok || !(form <= 1)) {
      return 1;
    }
    const auto widths = half_widths(filter.ellipsoid().in_coordinates());
    std::cout << time << " s: half-widths about the body axes " << 1e3 * widths.head<3>().transpose() << " mrad"
              << (update.dropped == direction_bit(1) ? ", without the Sun sensor" : "")
              << (update.claim == Claim::unconditional ? "" : ", if that was what was wrong") << '\n';
  }
  return 0;
}
