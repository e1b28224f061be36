// Every function over all magnitudes that a number can have: what is answered with `ok` is finite, positive definite, and holds
// what it must; judged in long double, whose exponents reach far beyond those of double. (docs/domain.md)
#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "elliptude/elliptude.hpp"
#include "random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using Real = long double;
using RealMatrix = Matrix3<Real>;
using RealVector = Vector3<Real>;
using Directions = Eigen::Matrix<double, 3, Eigen::Dynamic>;

/// Anything from the smallest number to the largest.
double any_magnitude(Random& random) { return std::pow(10.0, random.uniform(-323.2, 308)); }

/// Directions that keep their bounds, of any lengths.
struct Case {
  RealMatrix truth;
  Directions reference;
  Directions body;
  Eigen::VectorXd bounds;
};

Case draw(Random& random, int count) {
  Case c;
  const Eigen::Quaterniond q(random.normal(), random.normal(), random.normal(), random.normal());
  c.truth = Eigen::Quaternion<Real>(q.cast<Real>()).normalized().toRotationMatrix();
  c.reference.resize(3, count);
  c.body.resize(3, count);
  c.bounds.resize(count);
  const bool equal = random.uniform(0, 1) < 0.5;
  const double size = random.log_uniform(1e-9, 1);
  for (int i = 0; i < count; ++i) {
    // Bounds of all sizes; those below a rounding are met by directions that are as they should be but for rounding.
    c.bounds(i) = equal ? size : std::fmin(any_magnitude(random), 3.0);
    const RealVector b = random.unit_vector<3>().cast<Real>().normalized();
    const RealVector axis = b.cross(RealVector(random.unit_vector<3>().cast<Real>())).normalized();
    const Real angle = c.bounds(i) < 1e-15 ? 0 : Real(c.bounds(i)) * (random.uniform(0, 1) < 0.5 ? 1 : Real(random.uniform(0, 1)));
    const RealVector e = c.truth * b;
    const RealVector measured = std::cos(angle) * b + std::sin(angle) * axis.cross(b);
    // Lengths that keep all of the digits.
    const Real e_length = std::pow(10.0L, Real(random.uniform(-290, 300)));
    const Real b_length = std::pow(10.0L, Real(random.uniform(-290, 300)));
    c.reference.col(i) = (e_length * e).cast<double>();
    c.body.col(i) = (b_length * measured).cast<double>();
  }
  return c;
}

template <typename Chart>
void check_wahba(const Status status, const WahbaSet<double>& set, const Case& c) {
  if (status != Status::ok) {
    CHECK(status == Status::unbounded);  // the truth keeps its bounds: there is no contradiction
    return;
  }
  const Matrix3<double>& shape = set.error.shape;
  REQUIRE(shape.allFinite());
  Matrix3<double> factor;
  CHECK(cholesky(shape, factor) == Status::ok);
  const RealMatrix center = renormalized(RealMatrix(renormalized(RealMatrix(set.attitude.cast<Real>()))));
  const RealVector x = Chart::error(center, c.truth);
  CHECK(x.dot(RealMatrix(shape.cast<Real>()).llt().solve(x)) <= 1);
}

}  // namespace

TEST_CASE("Wahba's set with weights and bounds of any magnitude") {
  Random random(20260501);
  for (int trial = 0; trial < 3000; ++trial) {
    const int count = 2 + trial % 4;
    const Case c = draw(random, count);
    Eigen::VectorXd weights(count);
    const double weight = any_magnitude(random);
    for (int i = 0; i < count; ++i) {
      switch (trial % 3) {
        case 0:
          weights(i) = 2e-308;
          break;
        case 1:
          weights(i) = weight;
          break;
        default:
          weights(i) = any_magnitude(random);
      }
    }
    WahbaSet<double> set;
    check_wahba<ExponentialChart>(wahba_set<ExponentialChart>(c.reference, c.body, c.bounds, weights, set), set, c);
    check_wahba<GibbsChart>(wahba_set<GibbsChart>(c.reference, c.body, c.bounds, weights, set), set, c);
    check_wahba<GibbsChart>(
        minimal_wahba_set<GibbsChart>(c.reference, c.body, c.bounds, WahbaCriterion::volume, weights, set), set, c);
    check_wahba<GibbsChart>(
        minimal_wahba_set<GibbsChart>(c.reference, c.body, c.bounds, WahbaCriterion::trace, weights, set), set, c);
  }
}
