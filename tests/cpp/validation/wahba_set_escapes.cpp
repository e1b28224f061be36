// wahba_set_escapes [DRAWS [SEED]]: looks for an attitude that satisfies every cone and yet is outside of the set that
// `wahba_set` returns, or that it calls contradictory; and compares the sets with the paper's ellipsoid. The truth, the
// measured directions and the test of containment are in long double; only rounding the input to double is left. Fails on an
// escape, or if a set is larger than the figures it is to keep.

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <elliptude/attitude/wahba_set.hpp>
#include <elliptude/measurement/quadrics.hpp>
#include <vector>

#include "support/random.hpp"

namespace {

using namespace elliptude;
using elliptude::testing::Random;
using Long = long double;
using Directions = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 32>;
using Numbers = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 32, 1>;

constexpr double degree = 3.14159265358979323846 / 180;

// Directions as they are, and by how much and which way each is measured wrong.
struct Case {
  Matrix3<Long> truth;
  Directions reference;
  Numbers bounds;
  Numbers shares;    // of the bound
  Numbers azimuths;  // about the true direction
};

Matrix3<Long> rotation(Random& random) {
  const Eigen::Vector4d q = random.unit_vector<4>();
  return to_rotation(Quaternion<Long>{Long(q(0)), Vector3<Long>(q.tail<3>().cast<Long>())});
}

// The measured directions, rounded to double.
Directions body_of(const Case& c) {
  Directions body(3, c.reference.cols());
  for (Eigen::Index i = 0; i < c.reference.cols(); ++i) {
    const Vector3<Long> b = c.truth.transpose() * c.reference.col(i).cast<Long>().normalized();
    int least = 0;
    b.cwiseAbs().minCoeff(&least);
    const Vector3<Long> first = b.cross(Vector3<Long>::Unit(least)).normalized();
    const Vector3<Long> second = b.cross(first);
    const Vector3<Long> across = std::cos(Long(c.azimuths(i))) * first + std::sin(Long(c.azimuths(i))) * second;
    const Long angle = Long(c.shares(i)) * Long(c.bounds(i));
    body.col(i) = (std::cos(angle) * b + std::sin(angle) * across).cast<double>();
  }
  return body;
}

Case draw(Random& random, double bound) {
  Case c;
  c.truth = rotation(random);
  const std::array<int, 8> counts{2, 2, 3, 3, 4, 5, 8, 32};
  const int m = counts[static_cast<std::size_t>(random.uniform(0, 8))];
  c.reference.resize(3, m);
  c.bounds.resize(m);
  c.shares.resize(m);
  c.azimuths.resize(m);
  const double geometry = random.uniform(0, 1);
  const double spread = random.log_uniform(1e-7, 0.3);
  const Eigen::Vector3d middle = random.unit_vector<3>();
  const Eigen::Matrix3d axes = random.rotation();
  const bool mixed = random.uniform(0, 1) < 0.3;
  const double share = random.uniform(0, 1) < 0.8 ? 1.0 : random.uniform(0, 1);
  for (int i = 0; i < m; ++i) {
    Eigen::Vector3d e = random.unit_vector<3>();
    if (geometry < 0.2) {
      e = (middle + spread * e).normalized();  // nearly collinear
    } else if (geometry < 0.4) {
      e = axes.col(i % 3);  // orthogonal, and the same again
    } else if (geometry < 0.5 && i > 0) {
      e = (random.uniform(0, 1) < 0.5 ? 1 : -1) * c.reference.col(0) + (i == 1 ? 0.1 : 0.0) * e;
    }
    c.reference.col(i) = e;
    c.bounds(i) = mixed ? std::min(bound * random.log_uniform(0.01, 100), 170 * degree) : bound;
    c.shares(i) = share;
    c.azimuths(i) = random.uniform(0, 360 * degree);
  }
  return c;
}

// The form of the truth in a set: at most 1 inside.
template <typename Chart>
Long form(const WahbaSet<double>& set, const Matrix3<Long>& truth) {
  const Matrix3<Long> stored = set.attitude.cast<Long>();
  const Matrix3<Long> center = renormalized(Matrix3<Long>(renormalized(stored)));
  const Vector3<Long> x = Chart::error(center, truth);
  return x.dot(Matrix3<Long>(set.error.shape.cast<Long>()).llt().solve(x));
}

struct Row {
  double from;
  double to;
  long sets = 0;
  long half_turns = 0;
  long escapes = 0;
  Long worst = 0;
};

template <typename Chart>
Long check(const Case& c, Random& random, Row& row) {
  const Directions body = body_of(c);
  Long worst = 0;
  const auto count = [&](Status status, const WahbaSet<double>& set) {
    ++row.sets;
    if (status == Status::unbounded) {
      ++row.half_turns;
    } else if (status == Status::ok) {
      const Long value = form<Chart>(set, c.truth);
      worst = std::max(worst, value);
      row.escapes += value <= 1 ? 0 : 1;
    } else {
      ++row.escapes;  // the truth satisfies every cone: there is no contradiction, and the input is good
    }
  };
  WahbaSet<double> set;
  Numbers weights = Numbers::Ones(c.bounds.size());
  if (random.uniform(0, 1) < 0.3) {
    for (double& weight : weights) {
      weight = random.uniform(0, 1) < 0.2 ? 0 : random.log_uniform(0.01, 1);
    }
    weights(0) = 1;
  }
  count(wahba_set<Chart>(c.reference, body, c.bounds, weights, set), set);
  const auto criterion = random.uniform(0, 1) < 0.7 ? WahbaCriterion::trace : WahbaCriterion::volume;
  count(minimal_wahba_set<Chart>(c.reference, body, c.bounds, criterion, weights, set), set);
  row.worst = std::max(row.worst, worst);
  return worst;
}

// Draws; each in turn is the start of a search that turns the errors towards leaving the set.
long look_for_escapes(long draws, Random& random) {
  std::array<Row, 8> rows{{{1e-9 / degree, 1e-6 / degree},
                           {1e-6 / degree, 1e-3},
                           {1e-3, 1e-2},
                           {1e-2, 1e-1},
                           {1e-1, 1},
                           {1, 7},
                           {7, 20},
                           {20, 60}}};
  const auto step = [&random](const Case& c, Row& row) {
    return random.uniform(0, 1) < 0.5 ? check<ExponentialChart>(c, random, row) : check<GibbsChart>(c, random, row);
  };
  for (long done = 0; done < draws;) {
    Row& row = rows[static_cast<std::size_t>(random.uniform(0, 8))];
    Case best = draw(random, random.log_uniform(row.from, row.to) * degree);
    Long worst = step(best, row);
    ++done;
    const int steps = random.uniform(0, 1) < 0.1 ? 10 : 0;
    for (int k = 0; k < steps && done < draws; ++k, ++done) {
      Case other = best;
      other.shares.setOnes();
      for (double& azimuth : other.azimuths) {
        azimuth += random.normal() * 1.5 / (1 + k);
      }
      const Long value = step(other, row);
      if (value > worst) {
        worst = value;
        best = other;
      }
    }
  }
  std::printf("%22s %12s %12s %9s   %s\n", "bound, degrees", "sets", "half turns", "escapes", "1 - worst form");
  long escapes = 0;
  for (const Row& row : rows) {
    std::printf("%9.3g .. %9.3g %12ld %12ld %9ld   %.2Lg\n", row.from, row.to, row.sets, row.half_turns, row.escapes,
                1 - row.worst);
    escapes += row.escapes;
  }
  return escapes;
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<long>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

// The trace against that of the paper's first-order ellipsoid, errors of full size across the direction. \return how many of the
// medians are too large.
int compare_with_paper(long cases, Random& random) {
  constexpr double bound = 7 * degree;
  int failures = 0;
  std::printf("\n%-22s %8s %15s %8s %17s %8s %12s\n", "trace / paper's, 7°", "cases", "equal weights", "limit",
              "found weights", "limit", "half turns");
  struct Layout {
    const char* name;
    int count;
    bool orthogonal;
    double equal_limit;
    double found_limit;
  };
  for (const Layout& layout : {Layout{"2 random", 2, false, 1.0, 1.0}, Layout{"3 orthogonal", 3, true, 0.55, 0.50},
                               Layout{"5 random", 5, false, 0.30, 0.06}}) {
    std::vector<double> equal;
    std::vector<double> found;
    long half_turns = 0;
    for (long k = 0; k < cases; ++k) {
      Case c;
      c.truth = rotation(random);
      c.reference.resize(3, layout.count);
      c.bounds = Numbers::Constant(layout.count, bound);
      c.shares = Numbers::Ones(layout.count);
      c.azimuths.resize(layout.count);
      for (int i = 0; i < layout.count; ++i) {
        c.reference.col(i) = layout.orthogonal ? Eigen::Vector3d(Eigen::Vector3d::Unit(i)) : random.unit_vector<3>();
        c.azimuths(i) = random.uniform(0, 360 * degree);
      }
      const Directions body = body_of(c);
      std::array<Direction<double>, 5> directions;
      for (int i = 0; i < layout.count; ++i) {
        directions[static_cast<std::size_t>(i)] = Direction<double>::within(c.reference.col(i), body.col(i), bound);
      }
      MeasuredDirections<double> measured;
      MeasuredAttitude<double> paper;
      WahbaSet<double> set;
      Numbers weights = Numbers::Ones(layout.count);
      if (MeasuredDirections<double>::make(directions.data(), static_cast<std::size_t>(layout.count), WahbaMethod::svd,
                                           measured) != Status::ok ||
          measured.measured_attitude(SizeCriterion<double, 3>::trace(), paper) != Status::ok) {
        continue;
      }
      // A set that holds half turns counts as infinite.
      const auto ratio = [&](Status status) {
        return status == Status::ok ? set.error.shape.trace() / paper.bound.trace() : HUGE_VAL;
      };
      equal.push_back(ratio(wahba_set<ExponentialChart>(c.reference, body, c.bounds, weights, set)));
      half_turns += equal.back() < HUGE_VAL ? 0 : 1;
      found.push_back(
          ratio(minimal_wahba_set<ExponentialChart>(c.reference, body, c.bounds, WahbaCriterion::trace, weights, set)));
    }
    const double with_equal = median(equal);
    const double with_found = median(found);
    failures += with_equal <= layout.equal_limit ? 0 : 1;
    failures += with_found <= layout.found_limit ? 0 : 1;
    std::printf("%-21s %8zu %15.3f %8.2f %17.3f %8.2f %12ld\n", layout.name, equal.size(), with_equal,
                layout.equal_limit, with_found, layout.found_limit, half_turns);
  }
  return failures;
}

}  // namespace

int main(int argc, char** argv) {
  const long draws = argc > 1 ? std::atol(argv[1]) : 10000000;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (draws < 1000 || argc > 3) {
    std::fprintf(stderr, "usage: %s [DRAWS (at least 1000) [SEED]]\n", argv[0]);
    return 2;
  }
  Random random(static_cast<std::uint64_t>(seed));
  std::printf("%ld draws, seed %ld; of each two sets, with given and with found weights\n", draws, seed);
  const long escapes = look_for_escapes(draws, random);
  const int too_large = compare_with_paper(std::min(draws / 5, 20000L), random);
  std::printf("\n%ld escapes; %d figures above their limits\n", escapes, too_large);
  return escapes == 0 && too_large == 0 ? 0 : 1;
}
