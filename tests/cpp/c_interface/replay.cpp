// Replays a recording through the C++ filters and prints the same as `replay.c`. Of the core it includes only the single header, which
// tools/single_header.py has made.
#include <cstdio>
#include <elliptude.hpp>

#include "recording.h"

#ifdef ELLIPTUDE_SINGLE_PRECISION
using Number = float;
#else
using Number = double;
#endif

using namespace elliptude;

namespace {

const flight::Row recording[flight::rows] = {
#include "recording.inc"
};

constexpr int liar = 50;
constexpr std::int64_t epoch = 1700000000123456789;  // of stamps, ns
constexpr std::int64_t cycle = 100000000;            // ns, as the interval of the recording

Number number(double value) { return static_cast<Number>(value); }

Vector3<Number> vector(const double (&numbers)[3]) {
  return {number(numbers[0]), number(numbers[1]), number(numbers[2])};
}

/// The shape with these half-axes, rounded up.
Matrix3<Number> ball(double half_axis) {
  const Number axis = number(half_axis);
  return rounding::enlarged(axis, rounding::product) * axis * Matrix3<Number>::Identity();
}

using Directions = std::array<Direction<Number>, 4>;

Directions directions_of(int row) {
  Directions result;
  for (std::size_t i = 0; i < 4; ++i) {
    result[i] = Direction<Number>::within(vector(flight::references[i]),
                                          vector(recording[row].directions[row == liar && i == 3 ? 0 : i]),
                                          number(flight::direction_bound));
  }
  return result;
}

template <typename Matrix>
void print(const char* what, const Matrix& matrix) {
  std::printf(" %s", what);
  for (Eigen::Index i = 0; i < matrix.size(); ++i) {
    std::printf(" %a", static_cast<double>(matrix(i / matrix.cols(), i % matrix.cols())));
  }
}

void print(const char* what, Number value) { std::printf(" %s %a", what, static_cast<double>(value)); }

template <typename Filter>
void print_row(const char* name, int row, Status predicted, Status updated, const GuaranteedUpdate<Number>& update,
               const Filter& filter) {
  AttitudeBounds<Number> bounds{};
  const Status asked = filter.bounds({0, 0, 2}, bounds);
  std::printf("%s %d: %s, %s, %s,", name, row, message(predicted), message(updated), message(asked));
  std::printf(
      " claim %d, lacks %d, dropped %llx, contradicting %llx, fusions %d, iterations %d, prediction %d, limits %u, "
      "trust %d %d,",
      static_cast<int>(filter.claim()), static_cast<int>(filter.lacks()),
      static_cast<unsigned long long>(update.dropped), static_cast<unsigned long long>(update.contradicting),
      update.fusions, update.steps, update.prediction_used ? 1 : 0, update.ended_by_limit ? 4U : 0U,
      filter.trust().agreeing_updates(), filter.trust().disputed_updates());
  print("margin", update.margin);
  print("time", filter.time());
  print("attitude", filter.ellipsoid().center.attitude);
  print("vector", vector_part(filter.ellipsoid().center));
  print("shape", filter.ellipsoid().shape);
  print("widths", half_widths(filter.ellipsoid().in_coordinates()));
  print("angles", Eigen::Matrix<Number, 4, 1>(bounds.tilt, bounds.heading_from, bounds.heading_to, bounds.angle));
  std::printf("\n");
}

template <typename Potential>
int replay_body(const char* name, const Potential& potential, Policy policy,
                const SizeCriterion<Number, 6>& criterion) {
  using Flow = GuaranteedRigidBodyFlow<Number, Potential>;
  using Filter = GuaranteedFilter<Flow>;
  RigidBody<Number> body;
  Flow flow;
  Filter filter;
  typename Filter::Settings settings;
  settings.policy = policy;
  settings.criterion = criterion;
  settings.keeps_constraints = policy == Policy::drop_measurement;
  if (RigidBody<Number>::make(vector(flight::moments).asDiagonal(), body) != Status::ok ||
      Flow::make(body, potential, number(flight::interval), {ball(1e-4)}, flow) != Status::ok ||
      Filter::make(flow, settings, number(recording[0].time), filter) != Status::ok) {
    return 1;
  }
  for (int row = 0; row < flight::rows; ++row) {
    BodyInput<Number> input;
    if (row == 20 || row == 21) {
      input.control_torque.x() = number(1e-5);
      input.wheel_momentum.y() = number(1e-3);
    }
    const Directions directions = directions_of(row);
    const AngularVelocity<Number> rate{vector(recording[row].rate), ball(flight::rate_bound)};
    GuaranteedUpdate<Number> update;
    const Status predicted = filter.predict(number(recording[row].time), input);
    const Status updated = filter.update({directions.data(), directions.size(), &rate, nullptr}, update);
    print_row(name, row, predicted, updated, update, filter);
  }
  return 0;
}

/// \param by_stamps its times are nanoseconds, of a clock that has been running for long.
int replay_gyro(const char* name, bool by_stamps) {
  using Flow = GuaranteedGyroFlow<Number>;
  using Filter = GuaranteedFilter<Flow>;
  Flow flow;
  Filter filter;
  GyroUncertainty<Number> uncertainty;
  uncertainty.noise = ball(flight::rate_bound);
  uncertainty.drift = ball(1e-6);
  uncertainty.angular_acceleration = number(0.2);
  Filter::Settings settings;
  settings.policy = Policy::relaxed;
  settings.most_wrong = 1;
  if (Flow::make(uncertainty, Flow::IntervalRate::first_sample, flow) != Status::ok ||
      Filter::make(flow, settings, number(recording[0].time), filter) != Status::ok ||
      filter.bound_vector({Vector3<Number>::Zero(), ball(0.01)}) != Status::ok) {
    return 1;
  }
  StampedFilter<Filter> stamped(filter, epoch, epoch);
  Filter& kept = by_stamps ? stamped.filter() : filter;
  for (int row = 0; row < flight::rows; ++row) {
    const Directions directions = directions_of(row);
    const MeasuredAttitude<Number> attitude{kept.ellipsoid().center.attitude, ball(0.05)};
    Flow::Input input;
    input.angular_velocity = vector(recording[row > 0 ? row - 1 : 0].rate);
    GuaranteedUpdate<Number> update;
    const Status predicted =
        by_stamps ? stamped.predict(epoch + row * cycle, input) : filter.predict(number(recording[row].time), input);
    const Status updated =
        kept.update({directions.data(), directions.size(), nullptr, row % 20 == 19 ? &attitude : nullptr}, update);
    print_row(name, row, predicted, updated, update, kept);
  }
  return 0;
}

}  // namespace

int main() {
  using Criterion = SizeCriterion<Number, 6>;
  RigidBody<Number> body;
  GravityGradient<Number> gravity;
  if (RigidBody<Number>::make(vector(flight::moments).asDiagonal(), body) != Status::ok ||
      GravityGradient<Number>::make(body, number(flight::orbit_rate), Matrix3<Number>::Identity(), gravity) !=
          Status::ok) {
    return 1;
  }
  return replay_body("free", FreeBody<Number>(), Policy::raise, Criterion::volume()) +
         replay_body("gravity gradient", gravity, Policy::drop_measurement, Criterion::trace()) +
         replay_gyro("gyro", false) + replay_gyro("gyro by stamps", true);
}
