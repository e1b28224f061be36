/// All attitudes that agree with directions: of honest ones the truth is inside, in both charts, whatever the weights.

#include "fuzz.hpp"

namespace elliptude::fuzz {

using Directions = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 6>;
using Numbers = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6, 1>;

struct Case {
  Directions reference;
  Directions body;
  Numbers bounds;
  Numbers weights;
  RealMatrix truth;
  bool honest = true;
};

/// ζ of an attitude about a center, of any angle below π.
RealVector exponential_error(const Eigen::Matrix3d& center, const RealMatrix& attitude) {
  const RealVector gamma = gibbs_error(center, attitude);
  const Real length = gamma.norm();
  return length > 0 ? RealVector((2 * std::atan(length / 2) / length) * gamma) : gamma;
}

template <typename Chart>
void judge(const Case& c, Status status, const WahbaSet<double>& set, bool unchanged, const char* what) {
  if (status != Status::ok) {
    require(unchanged, "nothing changed otherwise", what);
    require(!c.honest || status == Status::unbounded || status == Status::attitude_undetermined ||
                status == Status::out_of_range,
            "what is true is not refused", message(status));
    return;
  }
  require(rotation_error(set.attitude) < 1e-12, "the center is a rotation", what);
  require_valid(set.error, what);
  if (c.honest) {
    const RealVector error = (std::is_same_v<Chart, GibbsChart> ? gibbs_error(set.attitude, c.truth)
                                                                : exponential_error(set.attitude, c.truth)) -
                             set.error.center.cast<Real>();
    if (const Real excess = outside_by<3>(set.error.shape, error); !(excess <= 0)) {
      std::fprintf(stderr, "form %.9Lg\n", 1 + excess);
      show("reference", c.reference);
      show("body", c.body);
      show("bounds", c.bounds);
      show("weights", c.weights);
      broken("the truth is inside", what);
    }
  }
}

template <typename Chart>
void try_sets(const Case& c, WahbaCriterion criterion) {
  WahbaSet<double> set{Eigen::Matrix3d::Identity(), {Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity()}, 0.5};
  const Snapshot before(set);
  const Status given = wahba_set<Chart>(c.reference, c.body, c.bounds, c.weights, set);
  judge<Chart>(c, given, set, before.unchanged(), "weights as given");
  set = {Eigen::Matrix3d::Identity(), {Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity()}, 0.5};
  const Snapshot again(set);
  Numbers found = c.weights;
  const Status minimal = minimal_wahba_set<Chart>(c.reference, c.body, c.bounds, criterion, found, set);
  judge<Chart>(c, minimal, set, again.unchanged(), "weights that were found");
  require(minimal == Status::ok || found.cwiseEqual(c.weights).count() == c.weights.cwiseEqual(c.weights).count(),
          "nothing changed otherwise", "the weights");
}

void session(Bytes bytes) {
  Case c;
  const int count = 1 + bytes.choice(6);
  c.truth = bytes.rotation();
  c.reference.resize(3, count);
  c.body.resize(3, count);
  c.bounds.resize(count);
  c.weights.resize(count);
  const int weights = bytes.choice(4);
  for (int i = 0; i < count; ++i) {
    // Anywhere; the one before or its opposite, exactly or nearly.
    RealVector e = bytes.unit_vector();
    if (i > 0 && bytes.choice(6) == 0) {
      e = static_cast<Real>(1 - 2 * bytes.choice(2)) * c.reference.col(i - 1).cast<Real>();
      if (bytes.choice(2) == 0) {
        const double apart = bytes.between(1e-16, 1e-2);
        e += static_cast<Real>(apart) * bytes.unit_vector();
      }
    }
    c.reference.col(i) = e.cast<double>();
    c.bounds(i) = bytes.choice(4) == 0 ? bytes.between(1e-16, 1e-6) : bytes.between(1e-6, 3.1415);
    const RealVector b = c.truth.transpose() * c.reference.col(i).cast<Real>().normalized();
    const RealVector across = b.cross(bytes.unit_vector());
    const Real angle = static_cast<Real>(c.bounds(i) * bytes.unit());
    const RealVector seen = across.norm() > 0 ? RealVector(real_exp(RealVector(angle * across.normalized())) * b) : b;
    c.body.col(i) =
        (seen * (bytes.choice(3) == 0 ? static_cast<Real>(bytes.between(1e-150, 1e150)) : 1)).cast<double>();
    c.weights(i) = weights == 0   ? 1.0
                   : weights == 1 ? bytes.between(1e-3, 1e3)
                   : weights == 2 ? bytes.between(1e-300, 1e300)
                                  : std::abs(bytes.number());
    c.honest = c.honest && std::isfinite(c.weights(i));
  }
  for (int garbage = bytes.choice(4) == 3 ? 1 + bytes.choice(3) : 0; garbage > 0; --garbage) {
    c.honest = false;
    const int i = bytes.choice(count);
    switch (bytes.choice(4)) {
      case 0:
        c.reference.col(i) = bytes.numbers<3, 1>();
        break;
      case 1:
        c.body.col(i) = bytes.numbers<3, 1>();
        break;
      case 2:
        c.bounds(i) = bytes.number();
        break;
      default:
        c.weights(i) = bytes.number();
    }
  }
  const WahbaCriterion criterion = bytes.choice(2) == 0 ? WahbaCriterion::trace : WahbaCriterion::volume;
  if (bytes.choice(2) == 0) {
    try_sets<GibbsChart>(c, criterion);
  } else {
    try_sets<ExponentialChart>(c, criterion);
  }
}

}  // namespace elliptude::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  elliptude::fuzz::session({data, size});
  return 0;
}
