// Each term of the gyro flow's bound (theory, section 17.6), alone: one source of error acts, a search finds the worst that it can
// do, and the truth comes to the edge of the set. So no term can be lost or halved unnoticed (tests/mutations/gyro_flow.toml).
//
// A small set R is added to a large one P by an ellipsoid about the sum, (7.1), whose half-width exceeds P's by R's width times a
// factor near one if P is much the larger: there the sum hides nothing. So nearly all cases are of errors that are a small part
// of the set, and the truth is out as soon as it is granted some tenths of the error too little.
#include <doctest/doctest.h>

#include <functional>
#include <string>
#include <vector>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using Flow = GuaranteedGyroFlow<double>;
using Set = GibbsEllipsoid<GyroState<double>>;
using Mode = Flow::IntervalRate;
using RealVectorX = Eigen::Matrix<Real, Eigen::Dynamic, 1>;

constexpr int pieces = 8;

/// What acts; a number that is zero does not.
struct Case {
  Mode mode = Mode::mean_of_ends;
  double duration = 0.5;
  Vector3d rate = Vector3d::Zero();  ///< measured
  Vector3d bias = Vector3d::Zero();  ///< the center's
  Vector3d attitude = Vector3d::Constant(1e-2);
  Vector3d bias_widths = Vector3d::Constant(1e-9);
  Vector3d noise = Vector3d::Zero();  ///< half-widths
  double drift = 0;
  double scale = 0;
  double acceleration = 0;
  bool by_increment = false;  ///< the noise's angle is given as an increment
};

RealMatrix turn_by(const RealVector& v) {
  const Real angle = v.norm();
  RealMatrix s;
  s << 0, -v(2), v(1), v(2), 0, -v(0), -v(1), v(0), 0;
  const Real a = angle > 1e-6L ? std::sin(angle) / angle : 1 - angle * angle / 6;
  const Real b = angle > 1e-6L ? (1 - std::cos(angle)) / (angle * angle) : 0.5L;
  return RealMatrix::Identity() + a * s + b * s * s;
}

/// The truth's motion from a point of the set, under errors that are points of their bounds in each piece of the interval.
class Truth {
 public:
  Truth(const Case& c, const Set& before) : case_(c), before_(before) {
    root_ = RealMatrix6(before.shape.cast<Real>()).llt().matrixL();
  }
  /// u, and then of each piece: noise, scale, drift, angular acceleration, each in the unit ball.
  static constexpr int size = 6 + 12 * pieces;

  [[nodiscard]] RealVector6 end(const RealVectorX& p, const Set& after) const {
    const RealVector6 y = root_ * p.head<6>();
    const RigidBodyState<double> as_body{before_.center.attitude, before_.center.gyro_bias};
    const Motion start = gibbs_motion(as_body, y);
    const RealVector bias = start.angular_velocity;
    const auto h = static_cast<Real>(case_.duration);
    const Real part = h / pieces;
    std::array<RealVector, pieces + 1> drifted;  // β − β₀
    std::array<RealVector, pieces + 1> moved;    // what ω has changed by
    drifted[0].setZero();
    moved[0].setZero();
    RealVector mean_drifted = RealVector::Zero();
    RealVector mean_moved = RealVector::Zero();
    for (int k = 0; k < pieces; ++k) {
      const auto i = static_cast<std::size_t>(k);
      drifted[i + 1] = drifted[i] + part * Real(case_.drift) * of(p, k, 2);
      moved[i + 1] = moved[i] + part * Real(case_.acceleration) * of(p, k, 3);
      mean_drifted += (drifted[i] + drifted[i + 1]) / (2 * pieces);
      mean_moved += (moved[i] + moved[i + 1]) / (2 * pieces);
    }
    RealVector sampled = bias;  // what the measured rate shows beside the true one at the beginning, and the noise
    if (case_.mode == Mode::last_sample) {
      sampled += drifted[pieces] + moved[pieces];
    } else if (case_.mode == Mode::mean_of_ends) {
      sampled += (drifted[pieces] + moved[pieces]) / 2;
    } else if (case_.mode == Mode::mean) {
      sampled += mean_drifted + mean_moved;
    }
    const Real by_scale = Real(case_.scale) * Real(case_.rate.norm());
    RealMatrix c = start.attitude;
    for (int k = 0; k < pieces; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const RealVector noise = case_.noise.cast<Real>().cwiseProduct(of(p, k, 0)) + by_scale * of(p, k, 1);
      const RealVector base = case_.rate.cast<Real>() - sampled - noise;
      constexpr int parts = 4;
      for (int j = 0; j < parts; ++j) {  // of fourth order: the mean and a commutator
        const auto omega = [&](Real share) {
          const Real at = (j + share) / parts;
          return RealVector(base + (1 - at) * moved[i] + at * moved[i + 1]);
        };
        const Real length = part / parts;
        const RealVector first = omega(0.5L - std::sqrt(3.0L) / 6);
        const RealVector second = omega(0.5L + std::sqrt(3.0L) / 6);
        c = (c * turn_by(RealVector(length / 2 * (first + second) -
                                    std::sqrt(3.0L) / 12 * length * length * second.cross(first))))
                .eval();
      }
    }
    return gibbs_error({after.center.attitude, after.center.gyro_bias}, {c, bias + drifted[pieces]});
  }

  /// The largest final form that is found: ascent over the start and the errors from starts along every axis.
  [[nodiscard]] double worst(const Set& after, Random& random) const {
    const RealMatrix6 metric = RealMatrix6(after.shape.cast<Real>()).inverse();
    const bool noisy = !case_.noise.isZero(0);
    const std::array<bool, 4> acts{noisy, case_.scale > 0, case_.drift > 0, case_.acceleration > 0};
    double largest = 0;
    for (int start = 0; start < 20; ++start) {
      RealVectorX p = RealVectorX::Zero(size);
      p.head<6>() = start < 12 ? RealVector6((start % 2 == 0 ? 1 : -1) * RealVector6::Unit(start / 2))
                               : RealVector6(random.unit_vector<6>().cast<Real>());
      for (int round = 0; round < 8; ++round) {
        const RealVector6 y = end(p, after);
        const RealVector6 normal = metric * y;
        largest = std::fmax(largest, static_cast<double>(y.dot(normal)));
        const auto slope = [&](int i) {
          const Real step = 1e-4L;
          RealVectorX moved = p;
          moved(i) += step;
          const Real up = normal.dot(end(moved, after));
          moved(i) -= 2 * step;
          return (up - normal.dot(end(moved, after))) / (2 * step);
        };
        RealVectorX next = RealVectorX::Zero(size);
        for (int i = 0; i < 6; ++i) {
          next(i) = slope(i);
        }
        next.head<6>().normalize();
        for (int k = 0; k < pieces; ++k) {
          for (int kind = 0; kind < 4; ++kind) {
            if (acts[static_cast<std::size_t>(kind)]) {
              RealVector gain;
              for (int i = 0; i < 3; ++i) {
                gain(i) = slope(6 + 12 * k + 3 * kind + i);
              }
              next.segment<3>(6 + 12 * k + 3 * kind) = gain.normalized();
            }
          }
        }
        p = next;
      }
    }
    return largest;
  }

 private:
  [[nodiscard]] static RealVector of(const RealVectorX& p, int piece, int kind) {
    return p.segment<3>(6 + 12 * piece + 3 * kind);
  }

  Case case_;
  Set before_;
  RealMatrix6 root_;
};

/// The largest final form, which must not exceed one, and not stay far below it.
double worst_form(const Case& c) {
  Random random(17);
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = (c.noise.cwiseAbs2() + Vector3d::Constant(1e-40)).asDiagonal();
  uncertainty.drift = c.drift * c.drift * Matrix3d::Identity();
  uncertainty.scale = c.scale;
  uncertainty.angular_acceleration = c.acceleration;
  if (c.noise.isZero(0)) {
    uncertainty.noise.setZero();
  }
  Flow flow;
  REQUIRE(Flow::make(uncertainty, c.mode, flow) == Status::ok);
  Set before{{random.rotation(), c.bias}, Matrix6<double>::Zero()};
  before.shape.diagonal() << c.attitude.cwiseAbs2(), c.bias_widths.cwiseAbs2();
  Flow::Input input{c.rate};
  if (c.by_increment) {
    input.increment = c.duration * c.noise(0);
  }
  Set after;
  REQUIRE(flow.predict(0, c.duration, input, before, after) == Status::ok);
  return Truth(c, before).worst(after, random);
}

const Vector3d about_z(0, 0, 1);

}  // namespace

TEST_CASE("gyro flow: noise alone reaches the edge") {
  Case c;
  c.noise.setConstant(1e-3);  // 5 % of the set in the interval
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.98);
}

TEST_CASE("gyro flow: noise in one direction is turned with the body") {
  for (const double speed : {0.0, 2.0, 4.0}) {
    Case c;
    c.noise = {1e-3, 1e-12, 1e-12};
    c.rate = speed * about_z;
    const double form = worst_form(c);
    CAPTURE(speed);
    CHECK(form <= 1);
    CHECK(form > 0.97);
  }
}

TEST_CASE("gyro flow: noise that changes with the turn pushes across its own direction") {
  // The set is wide where the noise acts and narrow across it.
  Case c;
  c.rate = 2 * about_z;
  c.attitude = {3e-1, 1e-2, 3e-1};
  c.noise = {2e-3, 1e-12, 1e-12};
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.9);
}

TEST_CASE("gyro flow: a scale error alone is one of the measured rate") {
  Case c;
  c.rate = 2 * about_z;
  c.bias = 1.99 * about_z;
  c.scale = 5e-4;
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.98);
}

TEST_CASE("gyro flow: an increment stands for noise and scale error") {
  Case c;
  c.noise.setConstant(1e-3);
  c.by_increment = true;
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.98);
}

TEST_CASE("gyro flow: the rate wanders between samples") {
  for (const Mode mode : {Mode::first_sample, Mode::mean_of_ends, Mode::last_sample}) {
    Case c;
    c.mode = mode;
    c.acceleration = 4e-3;
    const double form = worst_form(c);
    CAPTURE(static_cast<int>(mode));
    CHECK(form <= 1);
    CHECK(form > 0.98);
  }
}

TEST_CASE("gyro flow: what wanders about its mean is turned") {
  Case c;
  c.mode = Mode::mean;
  c.rate = 2 * about_z;
  c.acceleration = 4e-2;
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.94);
}

TEST_CASE("gyro flow: the bias goes with the attitude") {
  for (const double speed : {0.0, 2.0}) {
    Case c;
    c.rate = speed * about_z;
    c.bias_widths.setConstant(2e-2);
    const double form = worst_form(c);
    CHECK(form <= 1);
    CHECK(form > 0.99);
  }
}

TEST_CASE("gyro flow: the error of second order, of noise") {
  // γ along x and noise along z push along y, where the set is narrow.
  Case c;
  c.attitude = {0.5, 2.5e-3, 0.5};
  c.noise = {1e-12, 1e-12, 2e-3};
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.97);
}

TEST_CASE("gyro flow: the error of second order, of the bias") {
  Case c;
  c.attitude = {0.5, 1e-3, 0.5};
  c.bias_widths = {1e-9, 1e-9, 4e-3};
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.85);
}

TEST_CASE("gyro flow: the error of third order, of noise") {
  Case c;
  c.attitude.setConstant(3);  // to 113°
  c.noise.setConstant(3e-2);
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.97);
}

TEST_CASE("gyro flow: the error of third order, of what wanders") {
  Case c;
  c.mode = Mode::first_sample;
  c.attitude.setConstant(1.8);
  c.acceleration = 0.2;
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.9);
}

TEST_CASE("gyro flow: the error of third order, of a drift") {
  Case c;
  c.attitude.setConstant(3);
  c.bias_widths.setConstant(1);
  c.drift = 0.1;
  c.duration = 0.25;
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.8);
}

TEST_CASE("gyro flow: the attitude's error grows within the interval") {
  Case c;
  c.attitude.setConstant(1e-3);
  c.noise.setConstant(4.4);  // turns by up to 2.2 rad
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.1);
}

TEST_CASE("gyro flow: a drift moves the bias and the attitude together, and is turned") {
  // By a small part of the set; and by nearly all of it, from an attitude and a bias that are known.
  for (const auto& [attitude, bias, drift] : {std::array{5e-3, 1e-2, 1e-3}, {1e-6, 1e-6, 1e-4}}) {
    for (const Mode mode : {Mode::first_sample, Mode::mean_of_ends, Mode::mean, Mode::last_sample}) {
      for (const double speed : {0.0, 3.0}) {
        Case c;
        c.mode = mode;
        c.rate = speed * about_z;
        c.attitude.setConstant(attitude);
        c.bias_widths.setConstant(bias);
        c.drift = drift;
        const double form = worst_form(c);
        CAPTURE(static_cast<int>(mode));
        CAPTURE(speed);
        CHECK(form <= 1);
        // What a mean has seen of the drift, and what it has not, share a bound.
        const double least = drift < bias ? 0.98 : (mode == Mode::mean ? 0.5 : 0.95);
        CHECK(form > least);
      }
    }
  }
}

TEST_CASE("gyro flow: a drift that is over at the end has been in the mean") {
  Case c;
  c.mode = Mode::mean;
  c.bias_widths.setConstant(1e-2);
  c.attitude.setConstant(1e-3);
  c.drift = 2e-4;  // by 1 % of the set
  const double form = worst_form(c);
  CHECK(form <= 1);
  CHECK(form > 0.97);
}

TEST_CASE("gyro flow: without an attitude the bias drifts") {
  GyroUncertainty<double> uncertainty;
  uncertainty.drift = 1e-6 * Matrix3d::Identity();
  Flow flow;
  REQUIRE(Flow::make(uncertainty, Mode::mean, flow) == Status::ok);
  Ellipsoid<double, 3> after;
  REQUIRE(flow.predict_vector(0, 20, {}, {Vector3d::Zero(), 1e-4 * Matrix3d::Identity()}, after) == Status::ok);
  // 0.01 rad/s and 0.001 rad/s² for 20 s, all in one direction.
  CHECK(std::sqrt(after.shape(0, 0)) >= 0.03);
  CHECK(std::sqrt(after.shape(0, 0)) < 0.03 * (1 + 1e-12));
}
