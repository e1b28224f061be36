// Records what is replayed: a spacecraft that tumbles, four directions and its angular velocity with errors that keep
// their bounds. Writes the rows to the standard output, to be included by C++.
#include <cstdint>
#include <cstdio>
#include <elliptude/dynamics/integrator.hpp>

#include "recording.h"

using namespace elliptude;

namespace {

/// Numbers between −1 and 1, the same everywhere.
class Errors {
 public:
  double next() {
    state_ = state_ * 6364136223846793005U + 1442695040888963407U;
    return static_cast<double>(state_ >> 11) * 0x1p-52 - 1;
  }
  /// Within a ball of this radius.
  Vector3<double> within(double radius) {
    const double half_side = radius / 1.75;
    const double x = next();
    const double y = next();
    return half_side * Vector3<double>(x, y, next());
  }

 private:
  std::uint64_t state_ = 1;
};

Vector3<double> vector(const double (&numbers)[3]) { return {numbers[0], numbers[1], numbers[2]}; }

void write(const Vector3<double>& v) { std::printf("{%.17g, %.17g, %.17g}", v.x(), v.y(), v.z()); }

}  // namespace

int main() {
  RigidBody<double> body;
  GravityGradient<double> gravity;
  Composition<double> composition;
  if (RigidBody<double>::make(vector(flight::moments).asDiagonal(), body) != Status::ok ||
      GravityGradient<double>::make(body, flight::orbit_rate, Matrix3<double>::Identity(), gravity) != Status::ok ||
      composition_of_order(8, composition) != Status::ok) {
    return 1;
  }
  RigidBodyState<double> state{exp(Vector3<double>(0.3, -0.2, 0.5)), {0.1, 0.2, 0.3}};
  Errors errors;
  for (int row = 0; row < flight::rows; ++row) {
    const double time = row * flight::interval;
    std::printf("{%.17g, {", time);
    for (const auto& reference : flight::references) {
      write(exp(errors.within(flight::direction_bound)) * (state.attitude.transpose() * vector(reference)));
      std::printf(", ");
    }
    std::printf("}, ");
    write(state.angular_velocity + errors.within(flight::rate_bound));
    std::printf("},\n");
    if (integrate_step(body, gravity, composition, time, flight::interval, Vector3<double>(0, 0, 0), state, state) !=
        Status::ok) {
      return 1;
    }
  }
  return 0;
}
