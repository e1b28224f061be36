// liars [RUNS [SEED]]: one measurement of a run says something false, of any size from 1e-3 to 1e300: a direction, an attitude, an
// angular velocity, a gyro's sample; at the start or later. The filter has to recover under the policies that go on by themselves:
// 2 regain_after updates after the first contradiction its claim is unconditional, the truth is in its set, and both stay so.
// Fails if one run does not.

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>
#include <vector>

#include "support/random.hpp"

namespace {

using namespace elliptude;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using elliptude::testing::Random;

constexpr double step = 0.1;           // s, between updates
constexpr double angle_bound_ = 0.02;  // rad
constexpr double rate_bound = 0.02;    // rad/s
constexpr double bias_bound = 0.01;    // rad/s
constexpr double inside = 0.999;       // how much of its bound an honest error may use

enum class Liar { direction, attitude, rate, gyro };
enum class Kind { body, gyro, product };

constexpr std::array<const char*, 3> kind_names{"rigid body", "gyro, bias estimated", "gyro, bias bounded"};

// What is drawn for a run.
struct Plan {
  Kind kind;
  Policy policy;
  int regain_after;
  int directions;
  bool with_attitude;
  bool with_vector_bound;
  bool with_start;
  Liar liar;
  int lie_at;
  double size;
  double speed;
};

// An attitude and a vector: an angular velocity, or a bias that adds to a rate.
struct Truth {
  Matrix3d attitude;
  Vector3d vector;
};

// The motion of a body with moments (1, 1, 1.5) without torque, in closed form: with L = CJω fixed and κ = −½ω₃,
// C(t) = exp(S(tL)) C₀ exp(S(tκe₃)).
Truth after(const Truth& truth, double t) {
  const Vector3d moments(1, 1, 1.5);
  const Vector3d momentum = truth.attitude * Vector3d(moments.cwiseProduct(truth.vector));
  const double kappa = -0.5 * truth.vector(2);
  Truth next;
  next.attitude = renormalized(
      Matrix3d(exp(Vector3d(t * momentum)) * truth.attitude * exp(Vector3d(t * kappa * Vector3d::UnitZ()))));
  next.vector = Vector3d(next.attitude.transpose() * momentum).cwiseQuotient(moments);
  return next;
}

struct Outcome {
  bool contradicted = false;
  bool recovered = true;
  bool outside_at_end = false;
  int updates_needed = 0;  // after the first contradiction
  long failed_predictions = 0;
  long refused = 0;
};

template <typename Filter>
bool holds(const Filter& filter, const Plan& plan, const Truth& truth) {
  if (!filter.knows_attitude()) {
    return false;
  }
  const typename Filter::State state{truth.attitude, truth.vector};
  const Vector6<double> error = state_error<GibbsChart>(filter.ellipsoid().center, state);
  const Matrix6<double> shape = filter.ellipsoid().shape;
  if (plan.kind != Kind::product) {
    return error.dot(shape.llt().solve(error)) <= 1;
  }
  const Vector3d attitude = error.head<3>();
  const Vector3d vector = error.tail<3>();
  return attitude.dot(Matrix3d(shape.topLeftCorner<3, 3>()).llt().solve(attitude)) <= 1 &&
         vector.dot(Matrix3d(shape.bottomRightCorner<3, 3>()).llt().solve(vector)) <= 1;
}

template <typename Filter>
Outcome run(Filter& filter, const Plan& plan, Random& random) {
  Truth truth{random.rotation(), plan.kind == Kind::body ? Vector3d(plan.speed * random.unit_vector<3>())
                                                         : Vector3d(inside * bias_bound * random.in_ball<3>())};
  Vector3d rate = plan.speed * random.unit_vector<3>();  // of the gyro's carrier
  Outcome outcome;
  if (plan.with_start) {
    Matrix6<double> shape = 0.0025 * Matrix6<double>::Identity();
    const typename Filter::State center{truth.attitude * exp(Vector3d(0.02 * random.unit_vector<3>())), truth.vector};
    if (filter.start(GibbsEllipsoid<typename Filter::State>{center, shape}) != Status::ok) {
      std::abort();
    }
  }
  std::vector<Vector3d> references;
  const Matrix3d axes = random.rotation();
  for (int i = 0; i < plan.directions; ++i) {
    references.push_back(i < 3 ? Vector3d(axes.col(i)) : random.unit_vector<3>());
  }
  const Vector3d wrong = plan.size * random.unit_vector<3>();
  const double turn = plan.size < 3 ? plan.size : random.uniform(0, 3.14159);
  int first = -1;
  int since_recovered = 0;
  for (int k = 0;; ++k) {
    std::vector<Direction<double>> directions;
    for (const Vector3d& reference : references) {
      const Vector3d body =
          exp(Vector3d(inside * angle_bound_ * random.in_ball<3>())) * Vector3d(truth.attitude.transpose() * reference);
      directions.push_back(Direction<double>::within(reference, body, angle_bound_));
    }
    MeasuredAttitude<double> attitude{truth.attitude * exp(Vector3d(inside * angle_bound_ * random.in_ball<3>())),
                                      angle_bound_ * angle_bound_ * Matrix3d::Identity()};
    AngularVelocity<double> angular_velocity{truth.vector + inside * rate_bound * random.in_ball<3>(),
                                             rate_bound * rate_bound * Matrix3d::Identity()};
    const bool lies = k == plan.lie_at;
    if (lies && plan.liar == Liar::direction) {
      Direction<double>& liar = directions[static_cast<std::size_t>(random.uniform(0, plan.directions))];
      const Vector3d axis = liar.body.cross(random.unit_vector<3>()).normalized();
      liar.body = std::min(plan.size, 1e150) * (exp(Vector3d(turn * axis)) * liar.body);
    } else if (lies && plan.liar == Liar::attitude) {
      attitude.attitude = attitude.attitude * exp(Vector3d(turn * random.unit_vector<3>()));
    } else if (lies && plan.liar == Liar::rate) {
      angular_velocity.value += wrong;
    }
    const Measurements<double> measurements{directions.data(), directions.size(),
                                            plan.kind == Kind::body ? &angular_velocity : nullptr,
                                            plan.with_attitude ? &attitude : nullptr};
    GuaranteedUpdate<double> update;
    const Status status = filter.update(measurements, update);
    outcome.refused += status != Status::ok;
    if (first < 0 && (status != Status::ok || update.margin < 0 || update.dropped != 0)) {
      first = k;
    }
    const bool good = filter.claim() == Claim::unconditional && holds(filter, plan, truth);
    since_recovered = good ? since_recovered + 1 : 0;
    // A set can be wrong without a contradiction, as long as nothing that was measured contradicts it.
    const int last = first >= 0 ? first + 2 * plan.regain_after + 5 : plan.lie_at + 3 * plan.regain_after + 5;
    if (k == last) {
      outcome.contradicted = first >= 0;
      outcome.outside_at_end = !good;
      outcome.updates_needed = k + 1 - since_recovered - first;
      outcome.recovered = first < 0 || (good && outcome.updates_needed <= 2 * plan.regain_after);
      return outcome;
    }
    typename Filter::Input input{};
    if constexpr (!Filter::measures_rate) {
      input.angular_velocity = rate + truth.vector;
      if (lies && plan.liar == Liar::gyro) {
        input.angular_velocity += wrong;
      }
      truth.attitude = renormalized(Matrix3d(truth.attitude * exp(Vector3d(step * rate))));
    } else {
      truth = after(truth, step);
    }
    outcome.failed_predictions += filter.predict(step * (k + 1), input) != Status::ok;
  }
}

Plan draw(Random& random) {
  Plan plan;
  const double kind = random.uniform(0, 1);
  plan.kind = kind < 0.5 ? Kind::body : kind < 0.75 ? Kind::gyro : Kind::product;
  plan.policy = random.uniform(0, 1) < 0.5 ? Policy::drop_measurement : Policy::restart;
  plan.regain_after = static_cast<int>(random.uniform(2, 8));
  plan.directions = static_cast<int>(random.uniform(2, 5));
  plan.with_attitude = random.uniform(0, 1) < 0.3;
  plan.with_vector_bound = plan.kind != Kind::body || random.uniform(0, 1) < 0.3;
  plan.with_start = random.uniform(0, 1) < 0.3;
  plan.lie_at = random.uniform(0, 1) < 0.4 ? 0 : static_cast<int>(random.uniform(0, 12));
  plan.speed = random.log_uniform(0.01, 2);
  // Half of them of a size that a sensor might show, where a lie is least plain.
  plan.size = random.uniform(0, 1) < 0.5 ? random.log_uniform(1e-3, 1e3) : random.log_uniform(1e-3, 1e300);
  const double liar = random.uniform(0, 1);
  plan.liar = plan.with_attitude && liar < 0.3 ? Liar::attitude
              : liar < 0.5                     ? Liar::direction
              : plan.kind == Kind::body        ? Liar::rate
                                               : Liar::gyro;
  return plan;
}

struct Row {
  long runs = 0;
  long contradicted = 0;
  long not_recovered = 0;
  long failed_predictions = 0;
  long refused = 0;
  long unseen_and_outside = 0;
  double slowest = 0;  // updates needed / regain_after
};

template <typename Filter>
Outcome tried(const typename Filter::Flow& flow, const Plan& plan, const Vector3d& bound_center, double bound,
              Random& random) {
  typename Filter::Settings settings;
  settings.policy = plan.policy;
  settings.regain_after = plan.regain_after;
  settings.estimates_vector = plan.kind != Kind::product;
  Filter filter;
  if (Filter::make(flow, settings, 0, filter) != Status::ok) {
    std::abort();
  }
  if (plan.with_vector_bound &&
      filter.bound_vector({bound_center, bound * bound * Matrix3d::Identity()}) != Status::ok) {
    std::abort();
  }
  return run(filter, plan, random);
}

}  // namespace

int main(int argc, char** argv) {
  const long runs = argc > 1 ? std::atol(argv[1]) : 100000;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (runs < 1 || argc > 3) {
    std::fprintf(stderr, "usage: %s [RUNS [SEED]]\n", argv[0]);
    return 2;
  }
  using BodyFlow = GuaranteedRigidBodyFlow<double, FreeBody<double>>;
  using GyroFlow = GuaranteedGyroFlow<double>;
  RigidBody<double> body;
  BodyFlow body_flow;
  GyroFlow gyro_flow;
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = 1e-6 * Matrix3d::Identity();
  if (RigidBody<double>::make(Vector3d(1, 1, 1.5).asDiagonal(), body) != Status::ok ||
      BodyFlow::make(body, {}, step, {}, body_flow) != Status::ok ||
      GyroFlow::make(uncertainty, GyroFlow::IntervalRate::mean, gyro_flow) != Status::ok) {
    return 2;
  }
  std::array<std::array<Row, 2>, 3> rows;
  Random random(static_cast<std::uint64_t>(seed));
  long failures = 0;
  for (long k = 0; k < runs; ++k) {
    const Plan plan = draw(random);
    const Outcome outcome =
        plan.kind == Kind::body
            ? tried<GuaranteedFilter<BodyFlow>>(body_flow, plan, Vector3d::Zero(), 4, random)
            : tried<GuaranteedFilter<GyroFlow>>(gyro_flow, plan, Vector3d::Zero(), bias_bound, random);
    Row& row = rows[static_cast<std::size_t>(plan.kind)][plan.policy == Policy::restart ? 1 : 0];
    ++row.runs;
    row.contradicted += outcome.contradicted;
    row.not_recovered += !outcome.recovered;
    row.failed_predictions += outcome.failed_predictions;
    row.refused += outcome.refused;
    row.unseen_and_outside += !outcome.contradicted && outcome.outside_at_end;
    if (outcome.contradicted) {
      row.slowest = std::max(row.slowest, static_cast<double>(outcome.updates_needed) / plan.regain_after);
    }
    if (!outcome.recovered && ++failures <= 10) {
      std::printf(
          "not recovered: run %ld, %s, policy %d, regain_after %d, %d directions%s%s%s, liar %d of %.3g at %d, "
          "speed %.3g: needed %d, %ld predictions failed\n",
          k, kind_names[static_cast<std::size_t>(plan.kind)], static_cast<int>(plan.policy), plan.regain_after,
          plan.directions, plan.with_attitude ? ", attitude" : "", plan.with_vector_bound ? ", bound" : "",
          plan.with_start ? ", start" : "", static_cast<int>(plan.liar), plan.size, plan.lie_at, plan.speed,
          outcome.updates_needed, outcome.failed_predictions);
    }
  }
  std::printf("%ld runs, seed %ld, one liar each\n%-22s %-17s %8s %13s %14s %19s %8s %20s %18s\n", runs, seed, "filter",
              "policy", "runs", "contradicted", "not recovered", "failed predictions", "refused",
              "slowest/regain_after", "unseen and outside");
  for (std::size_t kind = 0; kind < rows.size(); ++kind) {
    for (std::size_t policy = 0; policy < 2; ++policy) {
      const Row& row = rows[kind][policy];
      std::printf("%-22s %-17s %8ld %13ld %14ld %19ld %8ld %20.2f %18ld\n", kind_names[kind],
                  policy == 0 ? "drop_measurement" : "restart", row.runs, row.contradicted, row.not_recovered,
                  row.failed_predictions, row.refused, row.slowest, row.unseen_and_outside);
    }
  }
  return failures == 0 ? 0 : 1;
}
