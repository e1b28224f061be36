// A spacecraft on a circular orbit, turned by the gravity gradient: integrates one orbit and prints attitude, energy
// and angular momentum.

#include <cstdio>
#include <elliptude/dynamics/integrator.hpp>

using elliptude::Status;

int main() {
  // Every function that can fail says so by a status; nothing throws. This one is `invalid_inertia` for a matrix that
  // no distribution of masses has.
  elliptude::RigidBody<double> body;
  const Eigen::Matrix3d inertia = Eigen::Vector3d(1.0, 2.8, 2.0).asDiagonal();  // kg m²
  if (const Status status = elliptude::RigidBody<double>::make(inertia, body); status != Status::ok) {
    std::fprintf(stderr, "inertia: %s\n", elliptude::message(status));
    return 1;
  }

  // The orbit's frame: the radial direction at t = 0, the direction of motion and the orbit normal, in reference axes.
  const double orbit_rate = 1.1e-3;  // rad/s, a low Earth orbit
  const Eigen::Matrix3d orbit = Eigen::Matrix3d::Identity();
  elliptude::GravityGradient<double> gravity;
  if (const Status status = elliptude::GravityGradient<double>::make(body, orbit_rate, orbit, gravity);
      status != Status::ok) {
    std::fprintf(stderr, "orbit: %s\n", elliptude::message(status));
    return 1;
  }

  // The attitude C takes body axes to reference axes; the angular velocity is in body axes, in rad/s.
  elliptude::RigidBodyState<double> state;
  state.attitude = elliptude::exp(Eigen::Vector3d(0.2, 0.1, -0.1));  // a rotation vector, rad
  state.angular_velocity = orbit_rate * Eigen::Vector3d(0.1, -0.2, 1.1);

  elliptude::Composition<double> composition;
  if (const Status status = elliptude::composition_of_order(4, composition); status != Status::ok) {
    std::fprintf(stderr, "order: %s\n", elliptude::message(status));
    return 1;
  }

  constexpr long steps = 300;
  const double orbit_period = 2 * 3.141592653589793 / orbit_rate;
  const double step = orbit_period / static_cast<double>(steps);
  const Eigen::Vector3d no_control = Eigen::Vector3d::Zero();  // a torque in body axes, N m

  const auto print = [&](long k, const elliptude::RigidBodyState<double>& at) {
    const double time = static_cast<double>(k) * step;
    const elliptude::Quaternion<double> q = elliptude::to_quaternion(at.attitude);
    const double energy = body.kinetic_energy(at.angular_velocity) + gravity.energy(at.attitude, time);
    const Eigen::Vector3d momentum = body.angular_momentum(at);  // reference axes
    // The potential turns with the orbit, so energy is exchanged with it; what stays is Jacobi's integral.
    const double jacobi = energy - orbit_rate * momentum.dot(orbit.col(2));
    std::printf("%7.0f  %8.5f %8.5f %8.5f %8.5f  %.6e  %.12e  %9.6f %9.6f %9.6f\n", time, q.w, q.vector.x(),
                q.vector.y(), q.vector.z(), energy, jacobi, 1e3 * momentum.x(), 1e3 * momentum.y(), 1e3 * momentum.z());
  };

  std::puts(
      "   time        qw       qx       qy       qz        energy              Jacobi        momentum, 1e-3 N m s");
  print(0, state);
  const Status status = elliptude::integrate(body, gravity, composition, 0.0, step, steps, no_control, state, state,
                                             [&](long k, const elliptude::RigidBodyState<double>& at) {
                                               if (k % 30 == 0) {
                                                 print(k, at);
                                               }
                                             });
  if (status != Status::ok) {
    std::fprintf(stderr, "integration: %s\n", elliptude::message(status));
    return 1;
  }
  return 0;
}
