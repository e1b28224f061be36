#pragma once

/// \file
/// Truths that move, in long double and by formulas of their own, and what an honest sensor says of them: a rigid body in
/// uniform gravity, and a body with a gyro.

#include "fuzz.hpp"
#include "support/independent_flow.hpp"

namespace elliptude::fuzz {

/// A pendulum with a control torque and a torque that is not known. Its angular velocity is measured.
struct BodyWorld {
  using Potential = UniformGravity<double>;
  using Flow = GuaranteedRigidBodyFlow<double, Potential>;
  using FirstOrderFlow = RigidBodyFlow<double, Potential>;
  using State = RigidBodyState<double>;
  using Set = GibbsEllipsoid<State>;

  RigidBody<double> body;
  Potential potential;
  Eigen::Vector3d moment;
  BodyUncertainty<double> uncertainty;
  RealMatrix inertia;
  double longest_step = 0.05;
  testing::Motion truth{RealMatrix::Identity(), RealVector::Zero()};
  double time = 0;

  /// A body that can be, with a potential that may be weak, strong or nothing.
  explicit BodyWorld(Bytes& bytes) {
    Eigen::Vector3d masses;
    for (double& mass : masses) {
      mass = bytes.between(1e-3, 1);
    }
    const Eigen::Vector3d moments(masses(1) + masses(2), masses(2) + masses(0), masses(0) + masses(1));
    const Eigen::Matrix3d axes = bytes.rotation().cast<double>();
    const Eigen::Matrix3d j = axes * moments.asDiagonal() * axes.transpose();
    require(RigidBody<double>::make((j + j.transpose()) / 2, body) == Status::ok, "a valid inertia", "body");
    moment = bytes.choice(2) == 0 ? Eigen::Vector3d(Eigen::Vector3d::Zero())
                                  : Eigen::Vector3d(moments(2) * bytes.units<3>());
    require(Potential::make(1, 1, moment, potential) == Status::ok, "a valid potential", "gravity");
    inertia = body.inertia().cast<Real>();
    if (bytes.choice(2) == 1) {
      uncertainty.torque = bytes.shape<3>(1e-6, 1e-2);
    }
    if (bytes.choice(4) == 1) {
      uncertainty.inertia = 1e-3 * body.principal_moments()(2) * std::abs(bytes.unit());
      const Real e = static_cast<Real>(bytes.unit()) * (1 - Real(1e-9)) * static_cast<Real>(uncertainty.inertia);
      const RealVector axis = bytes.unit_vector();
      inertia += e * axis * axis.transpose();
    }
    longest_step = bytes.between(1e-3, 0.2);
  }

  [[nodiscard]] Flow flow() const {
    Flow result;
    require(Flow::make(body, potential, longest_step, uncertainty, result) == Status::ok &&
                result.set_most_steps(1000) == Status::ok,
            "a valid flow", "body");
    return result;
  }
  [[nodiscard]] FirstOrderFlow first_order_flow(int order) const {
    FirstOrderFlow result;
    require(FirstOrderFlow::make(body, potential, longest_step, order, uncertainty.torque, result) == Status::ok,
            "a valid flow", "body");
    return result;
  }

  [[nodiscard]] RealVector vector() const { return truth.angular_velocity; }
  [[nodiscard]] const RealMatrix& attitude() const { return truth.attitude; }
  void place(const RealMatrix& attitude, const RealVector& vector) { truth = {attitude, vector}; }

  /// Moves the truth to a later time, and says what is known of what moved it.
  [[nodiscard]] Flow::Input advance(Bytes& bytes, double end) {
    const double duration = end - time;
    Flow::Input input;
    if (bytes.choice(3) == 1) {
      const double size = body.principal_moments()(2);
      input.control_torque = size * bytes.units<3>();
      input.wheel_momentum = size * bytes.units<3>();
    }
    RealVector extra = input.control_torque.cast<Real>();
    if (!uncertainty.torque.isZero(0)) {
      extra += (1 - Real(1e-9)) * point_of<3>(uncertainty.torque, bytes.in_ball<3>());
    }
    const RealVector real_moment = moment.cast<Real>();
    const auto torque = [&](const RealMatrix& c, Real) {
      return RealVector(real_moment.cross(RealVector(c.row(2).transpose())) + extra);
    };
    // As many intervals as it takes until twice as many are the same.
    const auto after = [&](int intervals) {
      return testing::independent_flow(inertia, torque, truth, static_cast<Real>(time), static_cast<Real>(duration),
                                       intervals, input.wheel_momentum.cast<Real>());
    };
    int intervals = 1 + static_cast<int>(static_cast<Real>(duration) * (truth.angular_velocity.norm() + 2));
    testing::Motion coarse = after(intervals);
    testing::Motion fine = after(2 * intervals);
    while (!(testing::distance(coarse, fine) <= Real(1e-12) * (1 + fine.angular_velocity.norm()))) {
      intervals *= 2;
      require(intervals < 10000, "the oracle knows the truth", "the integrator");
      coarse = fine;
      fine = after(2 * intervals);
    }
    truth = fine;
    time = end;
    return input;
  }
  /// More steps take longer, and show no more.
  [[nodiscard]] double most_duration() const { return 50 * longest_step; }
  /// Whether the truth can still be computed to the digits that an oracle needs, in reasonable time.
  [[nodiscard]] bool is_moderate(double duration) const {
    return duration * static_cast<double>(truth.angular_velocity.norm() + 2) < 5;
  }

  [[nodiscard]] static Flow::Input any_input(Bytes& bytes) {
    return {bytes.numbers<3, 1>(),
            bytes.choice(2) == 0 ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : bytes.numbers<3, 1>()};
  }
};

/// A body that is turned somehow: C(t) = C₀ exp(S(At)) exp(S(Bt)) over an interval, whose rate exp(−S(Bt))A + B changes by
/// ‖A × B‖; with a gyro whose bias drifts.
struct GyroWorld {
  using Flow = GuaranteedGyroFlow<double>;
  using FirstOrderFlow = GyroFlow<double>;
  using State = GyroState<double>;
  using Set = GibbsEllipsoid<State>;
  using IntervalRate = Flow::IntervalRate;

  GyroUncertainty<double> uncertainty;
  IntervalRate interval_rate;
  RealMatrix truth = RealMatrix::Identity();
  RealVector bias = RealVector::Zero();
  double time = 0;

  explicit GyroWorld(Bytes& bytes) {
    const int kind = bytes.choice(16);
    if ((kind & 1) != 0) {
      uncertainty.noise = bytes.shape<3>(1e-6, 0.1);
    }
    if ((kind & 2) != 0) {
      uncertainty.drift = bytes.shape<3>(1e-7, 1e-2);
    }
    if ((kind & 4) != 0) {
      uncertainty.scale = 0.1 * std::abs(bytes.unit());
    }
    if ((kind & 8) != 0) {
      uncertainty.angular_acceleration = bytes.between(1e-3, 10);
    }
    interval_rate = static_cast<IntervalRate>(bytes.choice(4));
    if (bytes.choice(4) == 1) {
      uncertainty.longest_interval = bytes.between(1e-3, 1);
      uncertainty.largest_rate = bytes.between(1e-3, 10);
    }
  }

  [[nodiscard]] Flow flow() const {
    Flow result;
    require(Flow::make(uncertainty, interval_rate, result) == Status::ok, "a valid flow", "gyro");
    return result;
  }
  [[nodiscard]] FirstOrderFlow first_order_flow(int) const {
    FirstOrderFlow result;
    require(FirstOrderFlow::make(uncertainty.noise, uncertainty.drift, result) == Status::ok, "a valid flow", "gyro");
    return result;
  }

  [[nodiscard]] RealVector vector() const { return bias; }
  [[nodiscard]] const RealMatrix& attitude() const { return truth; }
  void place(const RealMatrix& attitude, const RealVector& vector) {
    truth = attitude;
    bias = vector;
  }

  /// Chooses what the gyro shows, then errors within their bounds, and moves the truth as it then must have moved.
  [[nodiscard]] Flow::Input advance(Bytes& bytes, double end) {
    const double duration = end - time;
    const double size = bytes.between(1e-3, 10);
    Flow::Input input;
    input.angular_velocity = size * bytes.units<3>();
    const RealVector shown = input.angular_velocity.cast<Real>();
    const Real inside = 1 - Real(1e-9);
    RealVector error = inside * static_cast<Real>(bytes.unit() * uncertainty.scale) * shown;
    if (!uncertainty.noise.isZero(0)) {
      error += inside * point_of<3>(uncertainty.noise, bytes.in_ball<3>());
    }
    RealVector drift = RealVector::Zero();
    if (!uncertainty.drift.isZero(0)) {
      drift = inside * point_of<3>(uncertainty.drift, bytes.in_ball<3>());
    }
    const Real h = static_cast<Real>(duration);
    time = end;
    if (bytes.choice(4) == 0) {
      input.increment = static_cast<double>(h * error.norm()) * (1 + 1e-12);
    }
    if (uncertainty.longest_interval >= 0 && duration > uncertainty.longest_interval) {
      // A gap: what the gyro shows says nothing, and the body turns as fast as it may.
      const Real fastest = inside * static_cast<Real>(uncertainty.largest_rate) / 2;
      const RealVector first = fastest * bytes.in_ball<3>();
      move(h, first, RealVector(fastest * bytes.in_ball<3>()), drift);
      return input;
    }
    Real seen = 0.5L;  // of the drift in the interval
    if (interval_rate == IntervalRate::first_sample) {
      seen = 0;
    } else if (interval_rate == IntervalRate::last_sample) {
      seen = 1;
    }
    const RealVector rate = shown - error - (bias + seen * h * drift);
    // The rate as the flow is told of it is M A + B.
    RealVector b = RealVector::Zero();
    RealVector a = rate;
    if (uncertainty.angular_acceleration > 0) {
      const double fastest = bytes.between(1e-2, 10);
      b = static_cast<Real>(fastest) * bytes.unit_vector();
      RealMatrix m = RealMatrix::Identity();
      if (interval_rate == IntervalRate::mean_of_ends) {
        m = (RealMatrix::Identity() + real_exp(RealVector(-h * b))) / 2;
      } else if (interval_rate == IntervalRate::mean) {
        m = mean_turn(RealVector(h * b));
      } else if (interval_rate == IntervalRate::last_sample) {
        m = real_exp(RealVector(-h * b));
      }
      a = m.inverse() * (rate - b);
      if (!(a.cross(b).norm() <= inside * static_cast<Real>(uncertainty.angular_acceleration))) {
        a = rate;
        b.setZero();
      }
    }
    move(h, a, b, drift);
    return input;
  }
  [[nodiscard]] static bool is_moderate(double duration) { return duration < 100; }
  [[nodiscard]] static double most_duration() { return std::numeric_limits<double>::infinity(); }

  [[nodiscard]] static Flow::Input any_input(Bytes& bytes) {
    Flow::Input input;
    input.angular_velocity = bytes.numbers<3, 1>();
    input.increment = bytes.choice(2) == 0 ? -1.0 : bytes.number();
    return input;
  }

 private:
  void move(Real h, const RealVector& a, const RealVector& b, const RealVector& drift) {
    truth = nearest_rotation(truth * real_exp(RealVector(h * a)) * real_exp(RealVector(h * b)));
    bias += h * drift;
  }

  /// The mean of exp(−S(v s)) over 0 ≤ s ≤ 1, by its series: ‖v‖ is at most about 10 where it matters.
  [[nodiscard]] static RealMatrix mean_turn(const RealVector& v) {
    RealMatrix s;
    s << 0, -v(2), v(1), v(2), 0, -v(0), -v(1), v(0), 0;
    const Real angle = v.norm();
    if (angle < Real(0.5)) {
      RealMatrix term = RealMatrix::Identity();
      RealMatrix sum = term;
      for (int k = 1; k < 24; ++k) {
        term = term * s * (Real(-1) / static_cast<Real>(k + 1));
        sum += term;
      }
      return sum;
    }
    return RealMatrix::Identity() - ((1 - std::cos(angle)) / (angle * angle)) * s +
           ((angle - std::sin(angle)) / (angle * angle * angle)) * (s * s);
  }
};

/// Puts the truth into a set: about a center, at an error within the shape.
template <typename World>
typename World::Set honest_set(Bytes& bytes, World& world) {
  const double widest = bytes.between(1e-4, 1);
  const double thinnest = widest * bytes.between(1e-6, 1);
  typename World::Set set;
  set.center.attitude = renormalized(Eigen::Matrix3d(bytes.rotation().template cast<double>()));
  const double speed = bytes.between(1e-2, 2);
  const Eigen::Vector3d vector = speed * bytes.units<3>();
  if constexpr (std::is_same_v<World, BodyWorld>) {
    set.center.angular_velocity = vector;
  } else {
    set.center.gyro_bias = 0.1 * vector;
  }
  set.shape = bytes.shape<6>(thinnest, widest);
  const Eigen::Matrix<Real, 6, 1> y = (1 - Real(1e-15)) * point_of<6>(set.shape, bytes.in_ball<6>());
  world.place(gibbs_attitude(set.center.attitude, RealVector(y.head<3>())),
              vector_part(set.center).template cast<Real>() + RealVector(y.tail<3>()));
  return set;
}

/// The truth is in the set.
template <typename World>
void require_inside(const World& world, const typename World::Set& set, const char* what) {
  Eigen::Matrix<Real, 6, 1> y;
  y << gibbs_error(set.center.attitude, world.attitude()),
      world.vector() - vector_part(set.center).template cast<Real>();
  if (const Real excess = outside_by<6>(set.shape, y); !(excess <= 0)) {
    std::fprintf(stderr, "form %.9Lg\n", 1 + excess);
    broken("the truth is inside", what);
  }
}

}  // namespace elliptude::fuzz
