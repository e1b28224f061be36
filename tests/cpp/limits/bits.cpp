// Prints the bits of sets that need all that the smallest limits of test_small_limits.cpp allow. It is compiled with several limits, and
// a test compares what is printed.

#include <cstdio>
#include <elliptude/elliptude.hpp>

using namespace elliptude;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

const char* said(Status status) { return message(status); }

template <typename Set>
void print(const char* what, Status status, const Set& set) {
  std::printf("%s: %s", what, said(status));
  for (int i = 0; i < set.shape.size(); ++i) {
    std::printf(" %a", set.shape.data()[i]);
  }
  for (int i = 0; i < 9; ++i) {
    std::printf(" %a", set.center.attitude.data()[i]);
  }
  std::printf("\n");
}

using Gravity = GravityGradient<double>;
using PaperFlow = RigidBodyFlow<double, Gravity>;
using PaperFilter = AttitudeFilter<PaperFlow, PaperEstimator>;
using Flow = GuaranteedRigidBodyFlow<double, Gravity>;
using Filter = GuaranteedFilter<Flow>;

struct Moment {
  std::array<Direction<double>, 4> directions;
  AngularVelocity<double> rate;
  MeasuredAttitude<double> attitude;
};

Moment moment(const RigidBodyState<double>& truth, int step) {
  const Vector3d references[] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.6, 0, -0.8}};
  Moment result;
  for (int i = 0; i < 4; ++i) {
    const Vector3d error = 0.009 * Vector3d::Unit((i + step) % 3);
    const Vector3d body = exp(error) * (truth.attitude.transpose() * references[i]);
    result.directions[static_cast<std::size_t>(i)] = Direction<double>::within(references[i], body, 0.01);
  }
  result.rate = {truth.angular_velocity + Vector3d(0.005, -0.003, 0.002), 1e-4 * Matrix3d::Identity()};
  result.attitude = {truth.attitude * exp(Vector3d(0.01, 0.005, -0.01)), 4e-4 * Matrix3d::Identity()};
  return result;
}

}  // namespace

int main() {
  RigidBody<double> body;
  Gravity gravity;
  Composition<double> composition;
  PaperFlow paper_flow;
  Flow flow;
  const Matrix3d inertia = Vector3d(1.0, 2.8, 2.0).asDiagonal();
  if (RigidBody<double>::make(inertia, body) != Status::ok ||
      Gravity::make(body, 1e-3, Matrix3d::Identity(), gravity) != Status::ok ||
      composition_of_order(8, composition) != Status::ok ||
      PaperFlow::make(body, gravity, 0.1, 2, 1e-8 * Matrix3d::Identity(), paper_flow) != Status::ok ||
      Flow::make(body, gravity, 0.1, {1e-8 * Matrix3d::Identity()}, flow) != Status::ok) {
    return 1;
  }
  RigidBodyState<double> truth{exp(Vector3d(0.3, -0.2, 0.5)), {0.1, 0.2, 0.3}};
  PaperFilter paper;
  Filter::Settings settings;
  settings.policy = Policy::drop_measurement;
  settings.keeps_constraints = true;
  Filter guaranteed;
  const StateEllipsoid<RigidBodyState<double>> start{truth, 0.01 * Matrix6<double>::Identity()};
  if (PaperFilter::make(paper_flow, SizeCriterion<double, 6>::volume(), 0.0, start, paper) != Status::ok ||
      Filter::make(flow, settings, 0.0, guaranteed) != Status::ok ||
      guaranteed.bound_vector({Vector3d::Zero(), Matrix3d::Identity()}) != Status::ok) {
    return 1;
  }
  for (int step = 0; step < 20; ++step) {
    const double time = 0.1 * step;
    Moment seen = moment(truth, step);
    if (step == 7) {
      seen.directions[3].body = seen.directions[0].body;  // a liar
    }
    Update<double> update{};
    GuaranteedUpdate<double> report;
    const Status predicted = paper.predict(time, {});
    const Status updated = paper.update(seen.directions.data(), seen.directions.size(), seen.rate, update);
    print("paper", predicted == Status::ok ? updated : predicted, paper.ellipsoid());
    const Status moved = guaranteed.predict(time, {});
    const Status fused =
        guaranteed.update({seen.directions.data(), seen.directions.size(), &seen.rate, &seen.attitude}, report);
    print("guaranteed", moved == Status::ok ? fused : moved, guaranteed.ellipsoid());
    AttitudeBounds<double> bounds{};
    const Status asked = guaranteed.bounds(Vector3d::UnitZ(), bounds);
    std::printf("bounds: %s %a %a, dropped %llx\n", said(asked), bounds.tilt, bounds.angle,
                static_cast<unsigned long long>(report.dropped));
    if (integrate_step(body, gravity, composition, time, 0.1, Vector3d(0, 0, 0), truth, truth) != Status::ok) {
      return 1;
    }
  }
  return 0;
}
