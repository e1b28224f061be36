/// \file
/// Looks for states that satisfy all constraints of an update and are outside of what is answered to single questions, and measures
/// how sharp the answers are: random priors with attitude and rate mixed, two or three directions known within 7 degrees, a rate within
/// 7 degrees/s. The farthest states are found by a barrier method of its own, on constraints that are formed from rotation matrices:
/// they satisfy everything, so a ratio to them is at least the ratio to the exact support.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "support/questioned_scene.hpp"

namespace {

using namespace elliptude;
using namespace elliptude::testing;

/// Ratios that are to be small.
struct Ratios {
  std::vector<double> values;

  void print(const char* name) {
    std::sort(values.begin(), values.end());
    double sum = 0;
    for (const double value : values) {
      sum += value;
    }
    const auto count = static_cast<double>(values.size());
    const auto beyond = static_cast<double>(values.end() - std::upper_bound(values.begin(), values.end(), 1.03));
    std::printf("%-64s mean %.3f  median %.3f  99 %% %.3f  largest %.3f  above 1.03: %.1f %%\n", name, sum / count,
                values[values.size() / 2], values[values.size() * 99 / 100], values.back(), 100 * beyond / count);
  }
};

struct Figures {
  Ratios turns, set_turns, rates, set_rates, radius, longest, radius_of_exact, set_of_exact;
  long escapes = 0;
};

/// The smallest ellipsoid about points, nearly (Khachiyan), as the product of its semi-axes to the power of a third.
double radius_about(const std::vector<Vector3<double>>& points) {
  const auto count = static_cast<Eigen::Index>(points.size());
  Eigen::VectorXd weights = Eigen::VectorXd::Constant(count, 1.0 / static_cast<double>(count));
  Matrix3<double> shape;
  for (int step = 0; step < 3000; ++step) {
    Eigen::Matrix4d moments = Eigen::Matrix4d::Zero();
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Vector4d q = points[static_cast<std::size_t>(i)].homogeneous();
      moments += weights(i) * q * q.transpose();
    }
    const Eigen::Matrix4d inverse = moments.inverse();
    Eigen::Index farthest = 0;
    double most = 0;
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Vector4d q = points[static_cast<std::size_t>(i)].homogeneous();
      const double form = q.dot(inverse * q);
      if (form > most) {
        most = form;
        farthest = i;
      }
    }
    const Vector3<double> center = moments.block<3, 1>(0, 3);
    shape = 3 * (moments.topLeftCorner<3, 3>() - center * center.transpose());
    if (most < 4.004) {
      break;
    }
    const double share = (most - 4) / (4 * (most - 1));
    weights *= 1 - share;
    weights(farthest) += share;
  }
  return std::pow(shape.determinant(), 1.0 / 6);
}

void ask(QuestionedScene& scene, SizeCriterion<double, 6> criterion, bool judges_size, Figures& figures) {
  SceneFilter filter;
  UpdateConstraints<SceneState> constraints;
  if (!scene.update(criterion, filter, constraints)) {
    ++figures.escapes;
    return;
  }
  const GibbsEllipsoid<SceneState>& set = filter.ellipsoid();
  std::vector<Vector6<double>> states{scene.truth()};
  const auto error = [&](const Vector6<double>& y) {
    return gibbs_of(set.center.attitude.transpose() * scene.attitude_of(y));
  };
  const auto vector = [&](const Vector6<double>& y) {
    return Vector3<double>(scene.prior().center.angular_velocity + y.tail<3>());
  };
  for (int k = 0; k < 4; ++k) {
    const Vector3<double> n = k < 3 ? Vector3<double>(Vector3<double>::Unit(k)) : scene.random().unit_vector<3>();
    Interval<double> turn;
    Interval<double> rate;
    if (constraints.turn_about(n, turn) != Status::ok || constraints.vector_along(n, rate) != Status::ok) {
      ++figures.escapes;
      continue;
    }
    // n·γ⁺/2 = v/w with v and w linear in y: the state with the largest v - tw has a larger quotient than t.
    const Vector3<double> g = gibbs_of(scene.prior().center.attitude.transpose() * set.center.attitude) / 2;
    const auto turn_to = [&](double sign) {
      Vector6<double> y = scene.truth();
      for (int step = 0; step < 4; ++step) {
        const double t = error(y).dot(n) / 2;
        Vector6<double> objective = Vector6<double>::Zero();
        objective.head<3>() = sign * (n - n.cross(g) - t * g) / 2;
        y = scene.farthest(objective);
      }
      states.push_back(y);
      return 2 * std::atan(error(y).dot(n) / 2);
    };
    const double to = turn_to(1);
    const double from = turn_to(-1);
    Vector6<double> objective = Vector6<double>::Zero();
    objective.tail<3>() = n;
    states.push_back(scene.farthest(objective));
    const double most = vector(states.back()).dot(n);
    states.push_back(scene.farthest(-objective));
    const double least = vector(states.back()).dot(n);
    for (const Vector6<double>& y : states) {
      const double turned = 2 * std::atan(error(y).dot(n) / 2);
      const double along = vector(y).dot(n);
      figures.escapes += turned < turn.least || turned > turn.most || along < rate.least || along > rate.most ? 1 : 0;
    }
    figures.turns.values.push_back((turn.most - turn.least) / (to - from));
    figures.rates.values.push_back((rate.most - rate.least) / (most - least));
    const double half = std::sqrt(n.dot(set.shape.topLeftCorner<3, 3>() * n));
    figures.set_turns.values.push_back(4 * std::atan(half / 2) / (to - from));
    figures.set_rates.values.push_back(2 * std::sqrt(n.dot(set.shape.bottomRightCorner<3, 3>() * n)) / (most - least));
  }
  AttitudeSet<double> own;
  if (constraints.attitude_set(criterion.of_first<3>(), own) != Status::ok) {
    ++figures.escapes;
    return;
  }
  const Matrix3<double> inverse = own.shape.inverse();
  for (const Vector6<double>& y : states) {
    const Vector3<double> gamma = gibbs_of(own.center.transpose() * scene.attitude_of(y));
    figures.escapes += gamma.dot(inverse * gamma) > 1 + 1e-12 ? 1 : 0;
  }
  const Matrix3<double> present = set.shape.topLeftCorner<3, 3>();
  const double radius = std::pow(own.shape.determinant(), 1.0 / 6);
  const double of_set = std::pow(present.determinant(), 1.0 / 6);
  figures.radius.values.push_back(radius / of_set);
  figures.longest.values.push_back(std::sqrt(own.shape.selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff() /
                                             present.selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff()));
  if (judges_size) {
    std::vector<Vector3<double>> errors;
    for (int k = 0; k < 60; ++k) {
      Vector6<double> objective = Vector6<double>::Zero();
      objective.head<3>() = scene.random().unit_vector<3>();
      for (const double sign : {1.0, -1.0}) {
        errors.push_back(error(scene.farthest(sign * objective)));
      }
    }
    const double exact = radius_about(errors);
    figures.radius_of_exact.values.push_back(radius / exact);
    figures.set_of_exact.values.push_back(of_set / exact);
  }
}

}  // namespace

int main(int count, char** arguments) {
  const long tries = count > 1 ? std::strtol(arguments[1], nullptr, 10) : 1000;
  long escapes = 0;
  for (const bool by_volume : {true, false}) {
    Figures figures;
    for (long i = 0; i < tries; ++i) {
      QuestionedScene scene(static_cast<std::uint64_t>(i));
      ask(scene, by_volume ? SizeCriterion<double, 6>::volume() : SizeCriterion<double, 6>::trace(), i % 5 == 0,
          figures);
    }
    std::printf("filter's set by %s, %ld updates: %ld answers that a state breaks, or that are none\n",
                by_volume ? "volume" : "trace", tries, figures.escapes);
    figures.turns.print("turn about an axis / what the constraints leave");
    figures.set_turns.print("the same of the filter's set");
    figures.rates.print("a rate's component / what the constraints leave");
    figures.set_rates.print("the same of the filter's set");
    figures.radius.print("the attitude's own set / the filter's attitude, radius");
    figures.longest.print("the same, longest semi-axis");
    figures.radius_of_exact.print("own set / smallest ellipsoid about the exact set, radius");
    figures.set_of_exact.print("the filter's attitude / the same");
    escapes += figures.escapes;
  }
  return escapes == 0 ? 0 : 1;
}
