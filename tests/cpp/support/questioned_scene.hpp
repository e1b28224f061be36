#pragma once

/// \file
/// One update of a guaranteed filter with attitude and rate mixed, and the states that satisfy all of its constraints, by means of
/// its own: constraints formed from rotation matrices, and a barrier method for the farthest state in some direction.

#include <cmath>
#include <cstdint>
#include <elliptude/dynamics/potential.hpp>
#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/guaranteed/filter.hpp>
#include <limits>
#include <vector>

#include "support/random.hpp"

namespace elliptude::testing {

using SceneFilter = GuaranteedFilter<GuaranteedRigidBodyFlow<double, FreeBody<double>>>;
using SceneState = SceneFilter::State;
/// Bounds of the errors of directions, rad, and of the rate, rad/s.
inline const double scene_bound = 7 * scalar::pi<double>() / 180;

inline Matrix3<double> rotation_of_gibbs(const Vector3<double>& gamma) {
  return Eigen::Quaterniond(1, gamma(0) / 2, gamma(1) / 2, gamma(2) / 2).normalized().toRotationMatrix();
}

inline Vector3<double> gibbs_of(const Matrix3<double>& rotation) {
  const Eigen::Quaterniond q(rotation);
  return 2 * q.vec() / q.w();
}

/// s(y) = c - 2 gᵀy - yᵀAy of an error about the prior's center, from its values.
struct QuadraticSlack {
  Matrix6<double> a;
  Vector6<double> g;
  double c;

  template <typename Function>
  explicit QuadraticSlack(const Function& value) : c(value(Vector6<double>(Vector6<double>::Zero()))) {
    const auto at = [&](int i, double x, int j, double y) {
      Vector6<double> point = Vector6<double>::Zero();
      point(i) += x;
      point(j) += y;
      return value(point);
    };
    for (int i = 0; i < 6; ++i) {
      g(i) = -(at(i, 1, i, 0) - at(i, -1, i, 0)) / 4;
      for (int j = 0; j <= i; ++j) {
        const double mixed = i == j ? at(i, 1, i, 0) + at(i, -1, i, 0) - 2 * c
                                    : (at(i, 1, j, 1) - at(i, 1, j, -1) - at(i, -1, j, 1) + at(i, -1, j, -1)) / 4;
        a(i, j) = a(j, i) = -mixed / 2;
      }
    }
  }

  [[nodiscard]] double at(const Vector6<double>& y) const { return c - 2 * g.dot(y) - y.dot(a * y); }
};

/// One prior, its measurements and a truth that satisfies all.
class QuestionedScene {
 public:
  explicit QuestionedScene(std::uint64_t seed) : random_(seed) {
    const Matrix6<double> mixed = random_.positive_definite<6>(random_.log_uniform(2, 100));
    Vector6<double> widths = (mixed.diagonal().cwiseSqrt()).cwiseInverse();
    const double size = random_.log_uniform(0.07, 0.5);
    const double rate = random_.log_uniform(0.07, 0.5);
    for (int i = 0; i < 6; ++i) {
      widths(i) *= (i < 3 ? size : rate) * random_.log_uniform(0.5, 2);
    }
    prior_.shape = widths.asDiagonal() * mixed * widths.asDiagonal();
    prior_.shape = (prior_.shape + prior_.shape.transpose()).eval() / 2;
    prior_.center = {random_.rotation(), Vector3<double>(random_.normal_matrix<3>())};
    const Matrix6<double> root = prior_.shape.llt().matrixL();
    truth_ = root * random_.in_ball<6>();
    const Matrix3<double> attitude = attitude_of(truth_);
    const std::size_t count = random_.uniform(0, 1) < 0.5 ? 2 : 3;
    for (std::size_t i = 0; i < count; ++i) {
      const Vector3<double> reference = random_.unit_vector<3>();
      const Vector3<double> body =
          rotation_of_gibbs(scene_bound * 0.99 * random_.in_ball<3>()) * attitude.transpose() * reference;
      directions_.push_back(Direction<double>::within(reference, body.normalized(), scene_bound));
    }
    rate_ = {prior_.center.angular_velocity + truth_.tail<3>() + 0.99 * scene_bound * random_.in_ball<3>(),
             scene_bound * scene_bound * Matrix3<double>::Identity()};
    form_slacks();
  }

  [[nodiscard]] Matrix3<double> attitude_of(const Vector6<double>& y) const {
    return prior_.center.attitude * rotation_of_gibbs(y.head<3>());
  }

  /// \return whether the filter took them.
  [[nodiscard]] bool update(SizeCriterion<double, 6> criterion, SceneFilter& filter,
                            UpdateConstraints<SceneState>& constraints) const {
    SceneFilter::Settings settings;
    settings.criterion = criterion;
    Measurements<double> measurements;
    measurements.directions = directions_.data();
    measurements.direction_count = directions_.size();
    measurements.angular_velocity = &rate_;
    GuaranteedUpdate<double> report;
    return SceneFilter::make({}, settings, 0, filter) == Status::ok && filter.start(prior_) == Status::ok &&
           filter.update(measurements, report, constraints) == Status::ok;
  }

  /// The state with the largest objective that a barrier method finds; it satisfies all.
  [[nodiscard]] Vector6<double> farthest(const Vector6<double>& objective) const {
    Vector6<double> y = truth_;
    const double size = std::sqrt(objective.dot(prior_.shape * objective));
    for (double tau = size; tau > 1e-7 * size; tau *= 0.2) {
      for (int step = 0; step < 30 && climb(objective, tau, y); ++step) {
      }
    }
    return y;
  }

  [[nodiscard]] const GibbsEllipsoid<SceneState>& prior() const { return prior_; }
  [[nodiscard]] const Vector6<double>& truth() const { return truth_; }
  [[nodiscard]] Random& random() { return random_; }

 private:
  void form_slacks() {
    const Matrix6<double> inverse = prior_.shape.inverse();
    slacks_.emplace_back([&](const Vector6<double>& y) { return 1 - y.dot(inverse * y); });
    for (const Direction<double>& direction : directions_) {
      slacks_.emplace_back([&](const Vector6<double>& y) {
        const double cosine = direction.reference.dot(attitude_of(y) * direction.body);
        return (1 + y.head<3>().squaredNorm() / 4) * (cosine - std::cos(scene_bound)) / (1 - std::cos(scene_bound));
      });
    }
    slacks_.emplace_back([&](const Vector6<double>& y) {
      return 1 -
             (prior_.center.angular_velocity + y.tail<3>() - rate_.value).squaredNorm() / (scene_bound * scene_bound);
    });
  }

  [[nodiscard]] double barrier(const Vector6<double>& objective, double tau, const Vector6<double>& y) const {
    double sum = objective.dot(y);
    for (const QuadraticSlack& slack : slacks_) {
      const double s = slack.at(y);
      if (!(s > 0)) {
        return -std::numeric_limits<double>::infinity();
      }
      sum += tau * std::log(s);
    }
    return sum;
  }

  /// A damped step of Newton's method. \return whether it gained.
  [[nodiscard]] bool climb(const Vector6<double>& objective, double tau, Vector6<double>& y) const {
    Vector6<double> slope = objective;
    Matrix6<double> curvature = Matrix6<double>::Zero();
    for (const QuadraticSlack& slack : slacks_) {
      const double s = slack.at(y);
      const Vector6<double> down = 2 * (slack.a * y + slack.g);
      slope -= tau / s * down;
      curvature += tau * (2 / s * slack.a + down * down.transpose() / (s * s));
    }
    // Where a cone's curvature is negative it is left out.
    const Eigen::SelfAdjointEigenSolver<Matrix6<double>> eigen(curvature);
    const double least = 1e-12 * eigen.eigenvalues().maxCoeff();
    const Vector6<double> values = eigen.eigenvalues().cwiseMax(least);
    const Vector6<double> move =
        eigen.eigenvectors() * values.cwiseInverse().asDiagonal() * eigen.eigenvectors().transpose() * slope;
    const double before = barrier(objective, tau, y);
    for (double length = 1; length > 1e-6; length *= 0.6) {
      const Vector6<double> next = y + length * move;
      if (barrier(objective, tau, next) > before) {
        y = next;
        return true;
      }
    }
    return false;
  }

  Random random_;
  GibbsEllipsoid<SceneState> prior_;
  Vector6<double> truth_;
  std::vector<Direction<double>> directions_;
  AngularVelocity<double> rate_;
  std::vector<QuadraticSlack> slacks_;
};

}  // namespace elliptude::testing
