#pragma once

/// \file
/// What a user would take instead, as plain as it is usually written, on the same inputs and measured in the same run:
/// for ratios that mean something on any machine. None of it bounds anything.

#include <Eigen/Geometry>
#include <Eigen/SVD>

#if __has_include(<boost/numeric/odeint.hpp>)
#define ELLIPTUDE_HAS_ODEINT 1
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>
#endif

#include "operations.hpp"

namespace elliptude::operations::peers {

using Eigen::Quaterniond;

/// A body's attitude as a unit quaternion, and its angular velocity in body axes; or their derivatives.
struct QuaternionState {
  Quaterniond attitude;
  Vector3d rate;
};

/// Euler's equations: q̇ = ½ q ⊗ ω, J ω̇ = Jω × ω + M.
template <typename Potential>
QuaternionState derivative(const Motion<Potential>& motion, double time, const QuaternionState& state) {
  const Vector3d torque = motion.potential.torque(Matrix3d(state.attitude.toRotationMatrix()), time);
  const Vector3d momentum = motion.body.inertia() * state.rate;
  Quaterniond turn = state.attitude * Quaterniond(0, state.rate.x(), state.rate.y(), state.rate.z());
  turn.coeffs() *= 0.5;
  return {turn, motion.body.inertia_inverse() * (momentum.cross(state.rate) + torque)};
}

inline QuaternionState moved(const QuaternionState& state, double h, const QuaternionState& slope) {
  return {Quaterniond(state.attitude.coeffs() + h * slope.attitude.coeffs()), state.rate + h * slope.rate};
}

/// A step of the classical Runge–Kutta method, and the quaternion made a unit one again.
template <typename Potential>
QuaternionState runge_kutta_step(const Motion<Potential>& motion, double time, const QuaternionState& state) {
  const double h = motion.h;
  const QuaternionState k1 = derivative(motion, time, state);
  const QuaternionState k2 = derivative(motion, time + h / 2, moved(state, h / 2, k1));
  const QuaternionState k3 = derivative(motion, time + h / 2, moved(state, h / 2, k2));
  const QuaternionState k4 = derivative(motion, time + h, moved(state, h, k3));
  QuaternionState next;
  next.attitude.coeffs() = state.attitude.coeffs() + (h / 6) * (k1.attitude.coeffs() + 2 * k2.attitude.coeffs() +
                                                                2 * k3.attitude.coeffs() + k4.attitude.coeffs());
  next.attitude.normalize();
  next.rate = state.rate + (h / 6) * (k1.rate + 2 * k2.rate + 2 * k3.rate + k4.rate);
  return next;
}

template <auto make_motion>
double quaternion_step(long count) {
  const auto motion = make_motion();
  QuaternionState state{Quaterniond(motion.state.attitude), motion.state.angular_velocity};
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    state = runge_kutta_step(motion, static_cast<double>(i) * motion.h, state);
    sum += state.rate.x();
  }
  return sum + state.attitude.coeffs().sum();
}

/// A multiplicative extended Kalman filter of [ζ; δω]: Runge–Kutta and a transition matrix of second order, scalar
/// measurements one after another. (Markley and Crassidis, Fundamentals of Spacecraft Attitude Determination and
/// Control, 6.2)
template <typename Potential>
class KalmanFilter {
 public:
  KalmanFilter(const Motion<Potential>& motion, const QuaternionState& state, const Matrix6<double>& covariance)
      : motion_(&motion), state_(state), covariance_(covariance) {}

  void predict(double time) {
    const Matrix3d& j = motion_->body.inertia();
    const Matrix3d& inverse = motion_->body.inertia_inverse();
    const Matrix3d c = state_.attitude.toRotationMatrix();
    Matrix6<double> f;  // of the errors' differential equation
    f.topLeftCorner<3, 3>() = -hat(state_.rate);
    f.topRightCorner<3, 3>().setIdentity();
    f.bottomLeftCorner<3, 3>().noalias() = inverse * motion_->potential.torque_jacobian(c, time);
    f.bottomRightCorner<3, 3>().noalias() = inverse * (hat(Vector3d(j * state_.rate)) - hat(state_.rate) * j);
    const double h = motion_->h;
    const Matrix6<double> transition = Matrix6<double>::Identity() + h * f + (h * h / 2) * f * f;
    state_ = runge_kutta_step(*motion_, time, state_);
    covariance_ = (transition * covariance_ * transition.transpose()).eval();
  }

  void update(const Cycle& cycle, double variance) {
    Vector6<double> error = Vector6<double>::Zero();
    const Matrix3d c = state_.attitude.toRotationMatrix();
    for (const auto& direction : cycle.directions) {
      const Vector3d expected = c.transpose() * direction.reference;
      const Matrix3d h = hat(expected);  // b = b̂ + b̂ × ζ
      const Vector3d residual = direction.body - expected;
      for (int row = 0; row < 3; ++row) {
        Vector6<double> along = Vector6<double>::Zero();
        along.head<3>() = h.row(row).transpose();
        fuse(along, residual(row), variance, error);
      }
    }
    const Vector3d rate_residual = cycle.angular_velocity.value - state_.rate;
    for (int row = 0; row < 3; ++row) {
      fuse(Vector6<double>::Unit(3 + row), rate_residual(row), variance, error);
    }
    state_.attitude = state_.attitude * Quaterniond(1, error(0) / 2, error(1) / 2, error(2) / 2);
    state_.attitude.normalize();
    state_.rate += error.tail<3>();
  }

  [[nodiscard]] const QuaternionState& state() const { return state_; }
  [[nodiscard]] const Matrix6<double>& covariance() const { return covariance_; }

 private:
  /// A scalar measurement y = hᵀx with this variance.
  void fuse(const Vector6<double>& h, double y, double variance, Vector6<double>& error) {
    const Vector6<double> ph = covariance_ * h;
    const Vector6<double> gain = ph / (h.dot(ph) + variance);
    error += gain * (y - h.dot(error));
    covariance_ -= gain * ph.transpose();
  }

  const Motion<Potential>* motion_;
  QuaternionState state_;
  Matrix6<double> covariance_;
};

/// The cycle that `guaranteed_cycle` and `first_order_cycle` measure, through the Kalman filter.
inline double kalman_cycle(long count) {
  static const std::array<Cycle, cycle_count> cycles = typical_cycles();
  const auto motion = gravity_gradient_motion();
  const double variance = 0.0016;  // a third of the bound, squared
  const QuaternionState start{Quaterniond(motion.state.attitude), motion.state.angular_velocity};
  KalmanFilter<GravityGradient<double>> filter(motion, start, 0.0016 * Matrix6<double>::Identity());
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const std::size_t at = 1 + static_cast<std::size_t>(i) % (cycle_count - 1);
    if (at == 1) {
      filter = KalmanFilter<GravityGradient<double>>(motion, start, 0.0016 * Matrix6<double>::Identity());
    }
    filter.predict(cycles[at - 1].time);
    filter.update(cycles[at], variance);
    sum += filter.covariance().trace();
  }
  return sum + filter.state().rate.sum();
}

/// Wahba's problem as it is mostly written: the attitude profile of unit vectors, and Eigen's decomposition of it.
template <int directions>
double wahba_by_eigen(long count) {
  static const auto inputs = make_wahba_samples<directions>();
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    const auto& sample = inputs[static_cast<std::size_t>(i) % wahba_samples];
    const Matrix3d profile = sample.reference * sample.body.transpose();
    const Eigen::JacobiSVD<Matrix3d> svd(profile, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const double sign = svd.matrixU().determinant() * svd.matrixV().determinant();
    const Matrix3d attitude = svd.matrixU() * Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
    sum += attitude.sum();
  }
  return sum;
}

#ifdef ELLIPTUDE_HAS_ODEINT
/// A step of Dormand and Prince's method of order 5 in Boost, which leaves the attitude's length to its user.
template <auto make_motion>
double odeint_step(long count) {
  using State = std::array<double, 7>;
  const auto motion = make_motion();
  const auto system = [&motion](const State& x, State& slope, double time) {
    const QuaternionState found =
        derivative(motion, time, {Quaterniond(x[0], x[1], x[2], x[3]), Vector3d(x[4], x[5], x[6])});
    slope = {found.attitude.w(), found.attitude.x(), found.attitude.y(), found.attitude.z(),
             found.rate.x(),     found.rate.y(),     found.rate.z()};
  };
  const Quaterniond q(motion.state.attitude);
  const Vector3d& w = motion.state.angular_velocity;
  State state{q.w(), q.x(), q.y(), q.z(), w.x(), w.y(), w.z()};
  boost::numeric::odeint::runge_kutta_dopri5<State> stepper;
  double sum = 0;
  for (long i = 0; i < count; ++i) {
    stepper.do_step(system, state, static_cast<double>(i) * motion.h, motion.h);
    sum += state[4];
  }
  return sum + state[0];
}
#endif

inline constexpr std::array all{
    Operation{"peer_quaternion_step_free", quaternion_step<free_motion>},
    Operation{"peer_quaternion_step_gravity_gradient", quaternion_step<gravity_gradient_motion>},
    Operation{"peer_quaternion_step_pendulum", quaternion_step<pendulum_motion>},
    Operation{"peer_kalman_cycle", kalman_cycle},
    Operation{"peer_wahba_by_eigen_3_directions", wahba_by_eigen<3>},
    Operation{"peer_wahba_by_eigen_5_directions", wahba_by_eigen<5>},
#ifdef ELLIPTUDE_HAS_ODEINT
    Operation{"peer_odeint_step_free", odeint_step<free_motion>},
    Operation{"peer_odeint_step_pendulum", odeint_step<pendulum_motion>},
#endif
};

}  // namespace elliptude::operations::peers
