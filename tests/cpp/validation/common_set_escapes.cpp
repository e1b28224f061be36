// common_set_escapes [PAIRS [SEED]]: looks for a state that is in two sets and yet outside of what `common_set` returns, or that it
// calls apart, in double and in float. The state and the test of containment are in long double. Fails on an escape. (theory, 20.5)

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <elliptude/smoothing/common_set.hpp>

#include "support/random.hpp"

namespace {

using namespace elliptude;
using elliptude::testing::Random;
using Long = long double;
using LongState = RigidBodyState<Long>;

// The form of a state in a set whose center is the nearest rotation; at most 1 inside.
template <typename Scalar>
Long form(const GibbsEllipsoid<RigidBodyState<Scalar>>& set, const LongState& state) {
  const Matrix3<Long> stored = set.center.attitude.template cast<Long>();
  const LongState center{renormalized(Matrix3<Long>(renormalized(stored))),
                         set.center.angular_velocity.template cast<Long>()};
  const Vector6<Long> y = state_error<GibbsChart>(center, state);
  return y.dot(Matrix6<Long>(set.shape.template cast<Long>()).llt().solve(y));
}

struct Row {
  double least;
  double most;
  long sets = 0;
  long smaller = 0;
  long escapes = 0;
  Long worst = 0;
};

// A set of any size in a range that holds the state: at its edge, within it, or a little inside.
template <typename Scalar>
GibbsEllipsoid<RigidBodyState<Scalar>> draw(const LongState& state, const Row& row, Random& random) {
  const double inside = sizeof(Scalar) == 4 ? 0.9999 : 1 - 1e-8;
  const double share = random.uniform(0, 1);
  const Long radius = std::sqrt(static_cast<Long>(share < 0.3 ? 0.3 : share < 0.6 ? 0.999 : inside));
  Vector6<double> widths;
  for (double& width : widths) {
    width = random.log_uniform(row.least, row.most) * random.log_uniform(sizeof(Scalar) == 4 ? 0.1 : 0.01, 1);
  }
  GibbsEllipsoid<RigidBodyState<Scalar>> set;
  set.shape =
      symmetrized(Matrix6<Scalar>(random.symmetric<6>(Vector6<double>(widths.cwiseAbs2())).template cast<Scalar>()));
  const Matrix6<Long> factor = Matrix6<Long>(set.shape.template cast<Long>()).llt().matrixL();
  const Vector6<Long> error = radius * (factor * random.unit_vector<6>().template cast<Long>());
  const Matrix3<Long> center = state.attitude * cayley(Vector3<Long>(-error.head<3>() / 2));
  set.center.attitude = renormalized(Matrix3<Scalar>(center.cast<Scalar>()));
  set.center.angular_velocity = (state.angular_velocity - error.tail<3>()).template cast<Scalar>();
  return set;
}

template <typename Scalar>
void check(Row& row, Random& random) {
  const Eigen::Vector4d q = random.unit_vector<4>();
  const LongState state{to_rotation(Quaternion<Long>{static_cast<Long>(q(0)), q.tail<3>().cast<Long>().eval()}),
                        (random.log_uniform(1e-3, 10) * random.unit_vector<3>()).cast<Long>()};
  const Matrix3<Long> attitude = renormalized(Matrix3<Long>(renormalized(state.attitude)));
  const LongState truth{attitude, state.angular_velocity};
  const auto first = draw<Scalar>(truth, row, random);
  const auto second = draw<Scalar>(truth, row, random);
  if (!(form(first, truth) <= 1) || !(form(second, truth) <= 1)) {
    return;  // by rounding of what was drawn
  }
  CommonSetSettings<Scalar> settings;
  if (random.uniform(0, 1) < 0.5) {
    settings.criterion = SizeCriterion<Scalar, 6>::trace();
  }
  GibbsEllipsoid<RigidBodyState<Scalar>> common;
  ++row.sets;
  if (common_set(first, second, settings, common) != Status::ok) {
    ++row.escapes;
    return;
  }
  const Long value = form(common, truth);
  row.escapes += value <= 1 ? 0 : 1;
  row.smaller += common.shape != first.shape ? 1 : 0;
  row.worst = value > row.worst ? value : row.worst;
}

template <typename Scalar>
long look_for_escapes(const char* name, double least, long pairs, Random& random) {
  std::array<Row, 4> rows;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double ratio = std::pow(3 / least, 0.25);
    rows[i] = {least * std::pow(ratio, static_cast<double>(i)), least * std::pow(ratio, static_cast<double>(i + 1))};
    for (long k = 0; k < pairs / 8; ++k) {
      check<Scalar>(rows[i], random);
    }
  }
  long escapes = 0;
  for (const Row& row : rows) {
    std::printf("%-7s %9.3g .. %9.3g %12ld %12ld %9ld   %.2Lg\n", name, row.least, row.most, row.sets, row.smaller,
                row.escapes, 1 - row.worst);
    escapes += row.escapes;
  }
  return escapes;
}

}  // namespace

int main(int argc, char** argv) {
  const long pairs = argc > 1 ? std::atol(argv[1]) : 1000000;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (pairs < 1000 || argc > 3) {
    std::fprintf(stderr, "usage: %s [PAIRS (at least 1000) [SEED]]\n", argv[0]);
    return 2;
  }
  Random random(static_cast<std::uint64_t>(seed));
  std::printf("%ld pairs of sets, seed %ld\n", pairs, seed);
  std::printf("%-7s %22s %12s %12s %9s   %s\n", "", "half-widths", "sets", "smaller", "escapes", "1 - worst form");
  const long escapes =
      look_for_escapes<double>("double", 1e-6, pairs, random) + look_for_escapes<float>("float", 1e-3, pairs, random);
  std::printf("\n%ld escapes\n", escapes);
  return escapes == 0 ? 0 : 1;
}
