// worst_case [TRIES [SEED]]: looks for the prediction and the update that cost most, with four directions and an angular velocity. What
// is counted are operations with numbers, and so the same on every machine. The search starts from random sets and measurements, and
// keeps each change of a few of their numbers that costs more. Prints the mean of random ones beside the worst found. Fails if an update takes
// more fusions, or more steps of their searches, than docs/flight.md says.

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <elliptude/elliptude.hpp>
#include <vector>

#include "support/counted.hpp"
#include "support/random.hpp"

namespace {

using namespace elliptude;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using elliptude::testing::Counted;
using elliptude::testing::operations;
using elliptude::testing::Random;

constexpr int directions = 4;
/// Numbers from 0 to 1 that a trial is made from: a set, a truth in it, references, errors and bounds.
constexpr int set_genes = 6 + 3 + 6;
constexpr int gene_count = set_genes + directions * (2 + 3 + 1) + 3 + 1 + 3;
using Genes = std::array<double, gene_count>;

/// Reads genes one after the other.
class Reader {
 public:
  explicit Reader(const Genes& genes) : next_(genes.data()) {}
  double next() { return *next_++; }
  double between(double low, double high) { return low * std::pow(high / low, next()); }
  /// In the unit ball, on its boundary where a gene is beyond what the ball has room for.
  template <int N>
  Eigen::Matrix<double, N, 1> in_ball() {
    Eigen::Matrix<double, N, 1> v;
    for (int i = 0; i < N; ++i) {
      v(i) = 2 * next() - 1;
    }
    return v / std::max(1.0, v.norm());
  }
  Vector3d unit_vector() {
    const double z = 2 * next() - 1;
    const double angle = 6.283185307179586 * next();
    const double r = std::sqrt(1 - z * z);
    return {r * std::cos(angle), r * std::sin(angle), z};
  }

 private:
  const double* next_;
};

template <typename Scalar, int Rows, int Columns>
Eigen::Matrix<Scalar, Rows, Columns> as(const Eigen::Matrix<double, Rows, Columns>& m) {
  using Value = scalar::Value<Scalar>;
  return m.unaryExpr([](double x) { return Scalar(static_cast<Value>(x)); });
}

/// A set, and measurements of a truth in it.
template <typename Scalar>
struct Trial {
  Matrix3<Scalar> attitude;
  Vector3<Scalar> rate;
  Matrix6<Scalar> shape;
  std::array<Direction<Scalar>, directions> seen;
  AngularVelocity<Scalar> measured_rate;

  /// \param lies errors are up to this times their bounds.
  Trial(const Genes& genes, double lies) {
    Reader read(genes);
    Eigen::Matrix<double, 6, 1> widths;
    for (double& width : widths) {
      width = read.between(1e-4, 0.3);
    }
    // The attitude's axes turned, and mixed with those of the rate.
    Eigen::Matrix<double, 6, 6> root = widths.asDiagonal();
    root.topLeftCorner<3, 3>() = exp(Vector3d(3 * read.in_ball<3>())) * root.topLeftCorner<3, 3>();
    root.bottomLeftCorner<3, 3>() = 0.5 * root.topLeftCorner<3, 3>();
    const Eigen::Matrix<double, 6, 1> error = root * read.in_ball<6>();
    shape = as<Scalar>(Eigen::Matrix<double, 6, 6>(root * root.transpose()));
    const Matrix3d truth = exp(Vector3d(error.head<3>()));
    attitude = Matrix3<Scalar>::Identity();
    for (Direction<Scalar>& direction : seen) {
      const Vector3d reference = read.unit_vector();
      const Vector3d turn = lies * read.in_ball<3>();
      const double bound = read.between(1e-4, 0.3);
      const Vector3d body = exp(Vector3d(0.999 * bound * turn)) * Vector3d(truth.transpose() * reference);
      direction = Direction<Scalar>::within(as<Scalar>(reference), as<Scalar>(body),
                                            Scalar(static_cast<scalar::Value<Scalar>>(bound)));
    }
    const Vector3d rate_error = lies * read.in_ball<3>();
    const double bound = read.between(1e-4, 0.3);
    const Vector3d center = read.in_ball<3>();
    rate = as<Scalar>(center);
    measured_rate = {as<Scalar>(Vector3d(center + error.tail<3>() + 0.999 * bound * rate_error)),
                     as<Scalar>(Matrix3d(bound * bound * Matrix3d::Identity()))};
  }
};

struct Cost {
  long operations = 0;
  int fusions = 0;
  int steps = 0;
  bool is_ok = false;
};

template <typename Scalar>
RigidBody<Scalar> body_of() {
  RigidBody<Scalar> body;
  if (RigidBody<Scalar>::make(Vector3<Scalar>(Scalar(1), Scalar(2.75F), Scalar(2)).asDiagonal(), body) != Status::ok) {
    std::abort();
  }
  return body;
}

/// One prediction over 0.1 s or update of the guaranteed filter.
template <typename Real>
struct Guaranteed {
  using Scalar = Counted<Real>;
  using Flow = GuaranteedRigidBodyFlow<Scalar, FreeBody<Scalar>>;
  using Filter = GuaranteedFilter<Flow>;
  Policy policy;
  int most_wrong;
  bool predicts;
  long most_steps = 1000;

  Cost operator()(const Trial<Scalar>& trial) const {
    static const RigidBody<Scalar> body = body_of<Scalar>();
    typename Filter::Settings settings;
    settings.policy = policy;
    settings.most_wrong = most_wrong;
    Flow flow;
    Filter filter;
    GuaranteedUpdate<Scalar> report;
    if (Flow::make(body, {}, Scalar(Real(0.1)), {}, flow) != Status::ok ||
        flow.set_most_steps(most_steps) != Status::ok ||
        Filter::make(flow, settings, Scalar(0), filter) != Status::ok ||
        filter.start(typename Filter::Set{{trial.attitude, trial.rate}, trial.shape}) != Status::ok) {
      return {};
    }
    operations = 0;
    Status status = Status::ok;
    if (predicts) {
      status = filter.predict(Scalar(Real(0.1)), {});
    } else {
      status = filter.update({trial.seen.data(), trial.seen.size(), &trial.measured_rate, nullptr}, report);
    }
    return {operations, report.fusions, report.steps, status == Status::ok};
  }
};

/// The same of the paper's.
template <typename Real>
struct Paper {
  using Scalar = Counted<Real>;
  using Flow = RigidBodyFlow<Scalar, FreeBody<Scalar>>;
  using Filter = AttitudeFilter<Flow, PaperEstimator>;

  Cost operator()(const Trial<Scalar>& trial) const {
    static const RigidBody<Scalar> body = body_of<Scalar>();
    Flow flow;
    Filter filter;
    Update<Scalar> report;
    if (Flow::make(body, {}, Scalar(Real(0.1)), 2, Matrix3<Scalar>::Zero(), flow) != Status::ok ||
        Filter::make(flow, SizeCriterion<Scalar, 6>::volume(), Scalar(0), {{trial.attitude, trial.rate}, trial.shape},
                     filter) != Status::ok) {
      return {};
    }
    operations = 0;
    const Status status = filter.update(trial.seen.data(), trial.seen.size(), trial.measured_rate, report);
    return {operations, 0, 0, status == Status::ok};
  }
};

/// Looks for the genes that cost most, prints what was found, and compares with the limits.
/// \return whether the limits were kept.
template <typename Tried>
bool search(const char* name, const Tried& tried, double lies, long tries, Random& random) {
  using Scalar = typename Tried::Scalar;
  const long drawn = std::max(tries / 4, 10L);
  std::vector<std::pair<long, Genes>> best;
  double sum = 0;
  long counted = 0;
  Cost most;
  const auto cost_of = [&](const Genes& genes) {
    const Cost cost = tried(Trial<Scalar>(genes, lies));
    most.fusions = std::max(most.fusions, cost.fusions);
    most.steps = std::max(most.steps, cost.steps);
    return cost;
  };
  for (long k = 0; k < drawn; ++k) {
    Genes genes;
    for (double& gene : genes) {
      gene = random.uniform(0, 1);
    }
    const Cost cost = cost_of(genes);
    best.emplace_back(cost.operations, genes);
    sum += cost.is_ok ? static_cast<double>(cost.operations) : 0;
    counted += cost.is_ok;
  }
  std::sort(best.begin(), best.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  best.resize(std::min<std::size_t>(best.size(), 8));
  const long drawn_most = best[0].first;
  for (long k = drawn; k < tries; ++k) {
    auto& [record, genes] = best[static_cast<std::size_t>(k) % best.size()];
    Genes changed = genes;
    const double size = random.log_uniform(1e-4, 1);
    for (int changes = static_cast<int>(random.uniform(1, 5)); changes > 0; --changes) {
      double& gene = changed[static_cast<std::size_t>(random.uniform(0, gene_count))];
      gene = std::clamp(gene + size * random.uniform(-1, 1), 0.0, 1.0);
    }
    if (const long cost = cost_of(changed).operations; cost >= record) {
      record = cost;
      genes = changed;
    }
  }
  most.operations = std::max_element(best.begin(), best.end())->first;
  std::printf("%-44s %10.0f %10ld %10ld %8.2f %8d %6d\n", name, counted > 0 ? sum / static_cast<double>(counted) : 0.0,
              drawn_most, most.operations,
              counted > 0 ? static_cast<double>(most.operations) * static_cast<double>(counted) / sum : 0.0,
              most.fusions, most.steps);
  std::fflush(stdout);
  const int n = directions + 1;
  return most.fusions <= 1 + n + n * (n - 1) / 2 + 1 + n && most.steps <= 12 * most.fusions;
}

}  // namespace

int main(int argc, char** argv) {
  const long tries = argc > 1 ? std::atol(argv[1]) : 20000;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (tries < 40 || argc > 3) {
    std::fprintf(stderr, "usage: %s [TRIES [SEED]], at least 40 tries\n", argv[0]);
    return 2;
  }
  Random random(static_cast<std::uint64_t>(seed));
  std::printf("%ld tries each, seed %ld; operations with numbers\n%-44s %10s %10s %10s %8s %8s %6s\n", tries, seed, "",
              "mean", "drawn", "found", "/ mean", "fusions", "steps");
  bool kept = true;
  kept = search("guaranteed, predict", Guaranteed<double>{Policy::raise, 0, true}, 1, tries, random) && kept;
  kept = search("guaranteed, update", Guaranteed<double>{Policy::raise, 0, false}, 1, tries, random) && kept;
  kept = search("guaranteed, update, drop, liars", Guaranteed<double>{Policy::drop_measurement, 0, false}, 20, tries,
                random) &&
         kept;
  kept =
      search("guaranteed, update, relaxed, 1 wrong", Guaranteed<double>{Policy::relaxed, 1, false}, 1, tries, random) &&
      kept;
  kept =
      search("guaranteed, update, relaxed, 2 wrong", Guaranteed<double>{Policy::relaxed, 2, false}, 1, tries, random) &&
      kept;
  kept = search("paper, update", Paper<double>{}, 1, tries, random) && kept;
  kept = search("paper, update, float", Paper<float>{}, 1, tries, random) && kept;
  kept = search("guaranteed, predict, never finer", Guaranteed<double>{Policy::raise, 0, true, 1}, 1, tries, random) &&
         kept;
  if (!kept) {
    std::printf("more fusions or steps than docs/flight.md says\n");
  }
  return kept ? 0 : 1;
}
