#pragma once

/// \file
/// What the tests of guaranteed flows share: potentials beside the same torque written again in long double, and searches for
/// the state and the torque that leave a predicted set the furthest.

#include <elliptude/elliptude.hpp>

#include "support/independent_flow.hpp"
#include "support/random.hpp"

namespace elliptude::testing {

inline RealVector pendulum_torque(const Eigen::Vector3d& moment, const RealMatrix& attitude) {
  const RealVector down = attitude.row(2).transpose();
  return RealVector(moment.cast<Real>()).cross(down);
}

/// The reference axes are the orbit's.
inline RealVector gradient_torque(const RealMatrix& inertia, Real rate, const RealMatrix& attitude, Real time) {
  const RealVector b = attitude.transpose() * RealVector(std::cos(rate * time), std::sin(rate * time), 0);
  return 3 * rate * rate * b.cross(RealVector(inertia * b));
}

/// q(u), the quadratic map of a tube, in the precision of u.
template <typename Tube, typename Number>
Eigen::Matrix<Number, 6, 1> second_order(const Tube& tube, const Eigen::Matrix<Number, 6, 1>& u) {
  Eigen::Matrix<Number, 6, 1> image;
  for (int i = 0; i < 6; ++i) {
    const Matrix6<double> form = detail::packed::unpacked<double>(tube.second_order().col(i)).template topRows<6>();
    image(i) = u.dot(form.template cast<Number>() * u);
  }
  return image;
}

inline RigidBody<double> random_body(Random& random) {
  // The moments of a random distribution of mass.
  const Eigen::Vector3d masses(random.log_uniform(0.05, 1), random.log_uniform(0.05, 1), random.log_uniform(0.05, 1));
  const Eigen::Vector3d moments(masses(1) + masses(2), masses(2) + masses(0), masses(0) + masses(1));
  RigidBody<double> body;
  if (RigidBody<double>::make(random.symmetric<3>(moments), body) != Status::ok) {
    std::abort();
  }
  return body;
}

/// y = [γ; δω] of a motion about a center, in long double and by formulas of its own: with R = ĈᵀC, γ = 4 vee(R)/(1 + tr R).
inline Eigen::Matrix<Real, 6, 1> gibbs_error(const RigidBodyState<double>& center, const Motion& motion) {
  RealMatrix c = center.attitude.cast<Real>();
  for (int i = 0; i < 3; ++i) {  // the center is a rotation but for rounding: take the nearest
    c = (c + RealMatrix(c.inverse().transpose())) / 2;
  }
  const RealMatrix r = c.transpose() * motion.attitude;
  const Real scale = 2 / (1 + r.trace());
  Eigen::Matrix<Real, 6, 1> y;
  y << scale * (r(2, 1) - r(1, 2)), scale * (r(0, 2) - r(2, 0)), scale * (r(1, 0) - r(0, 1)),
      motion.angular_velocity - center.angular_velocity.cast<Real>();
  return y;
}

/// The motion whose error about the center is y: C = Ĉ (I + S(γ) + ½(S(γ)² …)) by Rodrigues' formula for g = γ/2.
inline Motion gibbs_motion(const RigidBodyState<double>& center, const Eigen::Matrix<Real, 6, 1>& y) {
  RealMatrix c = center.attitude.cast<Real>();
  for (int i = 0; i < 3; ++i) {
    c = (c + RealMatrix(c.inverse().transpose())) / 2;
  }
  const RealVector g = y.head<3>() / 2;
  RealMatrix s;
  s << 0, -g(2), g(1), g(2), 0, -g(0), -g(1), g(0), 0;
  const RealMatrix turn = RealMatrix::Identity() + (2 / (1 + g.squaredNorm())) * (s + s * s);
  return {c * turn, center.angular_velocity.cast<Real>() + y.tail<3>()};
}

using RealMatrix6 = Eigen::Matrix<Real, 6, 6>;
using RealVector6 = Eigen::Matrix<Real, 6, 1>;

/// How a set was predicted, and the truth's own motion with a torque that is constant in each of `pieces` parts.
struct Trial {
  GibbsEllipsoid<RigidBodyState<double>> before;
  GibbsEllipsoid<RigidBodyState<double>> after;
  RealMatrix inertia;  ///< the true one
  RealTorque torque;   ///< the known part, for the true inertia
  RealVector wheel = RealVector::Zero();
  Eigen::Matrix3d unknown = Eigen::Matrix3d::Zero();
  double time = 0;
  double duration = 0;
  int pieces = 1;
  int intervals = 2;  ///< of the integrator, in a piece
};

struct Worst {
  double form = 0;      ///< largest final form that was found
  double needed = 0;    ///< √ of it in the image of the set under the linear flow, minus one
  double computed = 0;  ///< largest √ratio of the predicted ellipsoid to that image, minus one
};

/// Ascent of the final form over the start's set and, in turn, over the torque in each piece.
inline Worst search_worst(const Trial& trial, Random& random, int starts, int rounds) {
  const RealMatrix6 factor = RealMatrix6(trial.before.shape.cast<Real>()).llt().matrixL();
  const RealMatrix6 after_inverse = RealMatrix6(trial.after.shape.cast<Real>()).inverse();
  using Torques = Eigen::Matrix<Real, 3, Eigen::Dynamic>;
  const auto run = [&](const RealVector6& v, const Torques& torques) {
    Motion motion = gibbs_motion(trial.before.center, RealVector6(factor * v));
    const Real piece = static_cast<Real>(trial.duration) / trial.pieces;
    for (int k = 0; k < trial.pieces; ++k) {
      const RealVector extra = torques.col(k);
      const RealTorque torque = [&](const RealMatrix& c, Real t) { return RealVector(trial.torque(c, t) + extra); };
      motion = independent_flow(trial.inertia, torque, motion, static_cast<Real>(trial.time) + k * piece, piece,
                                trial.intervals, trial.wheel);
    }
    return gibbs_error(trial.after.center, motion);
  };
  const bool pushed = !trial.unknown.isZero(0);
  const RealMatrix bound = trial.unknown.cast<Real>();
  const Torques none = Torques::Zero(3, trial.pieces);
  const Real small = 1e-5L;
  const auto jacobian = [&](const RealVector6& v, const Torques& torques) {
    RealMatrix6 a;
    for (int i = 0; i < 6; ++i) {
      const RealVector6 step = small * RealVector6::Unit(i);
      a.col(i) = (run(v + step, torques) - run(v - step, torques)) / (2 * small);
    }
    return a;
  };
  const RealMatrix6 linear = jacobian(RealVector6::Zero(), none);
  const RealMatrix6 linear_inverse = linear.inverse();
  Worst worst;
  const RealMatrix6 ratio = linear_inverse * trial.after.shape.cast<Real>() * linear_inverse.transpose();
  worst.computed =
      static_cast<double>(std::sqrt(Eigen::SelfAdjointEigenSolver<RealMatrix6>(ratio).eigenvalues().maxCoeff()) - 1);
  // The effect of a torque on the end.
  std::vector<Eigen::Matrix<Real, 6, 3>> influence;
  if (pushed) {
    const RealMatrix root = bound.llt().matrixL();
    const Real size = root.norm();
    for (int k = 0; k < trial.pieces; ++k) {
      Eigen::Matrix<Real, 6, 3> by;
      for (int i = 0; i < 3; ++i) {
        Torques torques = none;
        torques(i, k) = size * small;
        by.col(i) =
            (run(RealVector6::Zero(), torques) - run(RealVector6::Zero(), Torques(-torques))) / (2 * size * small);
      }
      influence.push_back(by);
    }
  }
  const auto worst_torques = [&](const RealVector6& p) {
    Torques torques = none;
    for (int k = 0; k < trial.pieces && pushed; ++k) {
      const RealVector gain = influence[static_cast<std::size_t>(k)].transpose() * p;
      const Real length = std::sqrt(gain.dot(bound * gain));
      if (length > 0) {
        torques.col(k) = bound * gain / length;
      }
    }
    return torques;
  };
  const Eigen::SelfAdjointEigenSolver<RealMatrix6> axes(RealMatrix6(linear.transpose() * after_inverse * linear));
  for (int start = 0; start < starts; ++start) {
    // Along the axes that end nearest the boundary, and anywhere.
    RealVector6 v = start < 4 ? RealVector6((start % 2 == 0 ? 1 : -1) * axes.eigenvectors().col(5 - start / 2))
                              : RealVector6(random.unit_vector<6>().cast<Real>());
    v.normalize();
    Torques torques = worst_torques(RealVector6(after_inverse * linear * v));
    for (int round = 0; round <= rounds; ++round) {
      const RealVector6 y = run(v, torques);
      const RealVector6 p = after_inverse * y;
      worst.form = std::fmax(worst.form, static_cast<double>(y.dot(p)));
      worst.needed = std::fmax(worst.needed, static_cast<double>((linear_inverse * y).norm() - 1));
      if (round < rounds) {
        const RealVector6 gradient = jacobian(v, torques).transpose() * p;
        v = gradient.normalized();
        torques = worst_torques(p);
      }
    }
  }
  return worst;
}

}  // namespace elliptude::testing
