/// \file
/// Looks for states that satisfy everything an update was told and are outside of what it answers: the truth is on the boundary of a
/// prior as thin as 1e-6 of its width and as wide as 170 degrees, and on the boundary of the cones, the rate's, the bias' and the
/// attitude's bounds that are given with it, of 1e-6 rad to beyond half turns, all policies, with liars where some may be wrong. Among
/// the questions is the turn about the axis for which a linear functional of the prior is largest at the truth. The truth is formed
/// and judged in long double.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <elliptude/elliptude.hpp>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "support/random.hpp"

namespace {

using namespace elliptude;
using elliptude::testing::Random;
using Long = long double;
using Vector3l = Eigen::Matrix<Long, 3, 1>;
using Matrix3l = Eigen::Matrix<Long, 3, 3>;
using Vector6l = Eigen::Matrix<Long, 6, 1>;
using Matrix6l = Eigen::Matrix<Long, 6, 6>;
using Quaternion = Eigen::Quaternion<Long>;

/// How far off the middle of what is answered a truth may be, in half-widths or as a form, besides what judging it loses.
constexpr double allowed = 1 + 1e-9;

/// The worst of each question.
struct Worst {
  std::map<std::string, double> values;
  long judged = 0;
  long escapes = 0;

  void judge(const std::string& question, Long value, std::uint64_t seed) {
    ++judged;
    double& worst = values[question];
    const auto found = static_cast<double>(value);
    worst = std::max(worst, found);
    if (!(found <= allowed)) {
      ++escapes;
      std::printf("seed %llu: %s: %.12g\n", static_cast<unsigned long long>(seed), question.c_str(), found);
    }
  }
  /// \param value that must be within an interval.
  template <typename Scalar>
  void judge(const std::string& question, Long value, const Scalar& least, const Scalar& most, std::uint64_t seed) {
    const Long middle = (Long(most) + Long(least)) / 2;
    judge(question, most > least ? std::abs(value - middle) / (Long(most) - middle) : Long(2), seed);
  }
};

Matrix3l rotation_of_gibbs(const Vector3l& gamma) {
  return Quaternion(1, gamma(0) / 2, gamma(1) / 2, gamma(2) / 2).normalized().toRotationMatrix();
}

Matrix3l rotation_of(const Vector3l& turn) {
  return turn.norm() > 0 ? Eigen::AngleAxis<Long>(turn.norm(), turn.normalized()).toRotationMatrix()
                         : Matrix3l(Matrix3l::Identity());
}

/// The rotation that a rounded one stands for.
template <typename Scalar>
Matrix3l nearest(const Matrix3<Scalar>& rounded) {
  Matrix3l c = rounded.template cast<Long>();
  for (int step = 0; step < 6; ++step) {
    c = (c * (3 * Matrix3l::Identity() - c.transpose() * c) / 2).eval();
  }
  return c;
}

/// The quaternion of an error, with a scalar part that is not negative.
Quaternion error_of(const Matrix3l& center, const Matrix3l& attitude) {
  Quaternion q(Matrix3l(center.transpose() * attitude));
  q.normalize();
  if (q.w() < 0) {
    q.coeffs() = -q.coeffs();
  }
  return q;
}

template <int N>
Long form(const Eigen::Matrix<Long, N, N>& shape, const Eigen::Matrix<Long, N, 1>& y) {
  return y.dot(shape.llt().solve(y));
}

Long angle_between(const Vector3l& a, const Vector3l& b) { return 2 * std::atan2((a - b).norm(), (a + b).norm()); }

/// A truth, and what is told of it.
template <typename Filter>
class Scene {
 public:
  using Scalar = typename Filter::Scalar;
  using State = typename Filter::State;
  static constexpr double epsilon = double(std::numeric_limits<Scalar>::epsilon());

  Scene(std::uint64_t seed, Worst& worst) : random_(seed), seed_(seed), worst_(worst) {}

  void run() {
    GuaranteedSettings<Scalar> settings;
    settings.policy = static_cast<Policy>(random_.uniform(0, 4));
    settings.most_wrong = settings.policy == Policy::relaxed ? static_cast<int>(random_.uniform(0, 3)) : 0;
    settings.keeps_constraints = true;
    if (random_.uniform(0, 1) < 0.5) {
      settings.criterion = SizeCriterion<Scalar, 6>::trace();
    }
    settings.estimates_vector = Filter::measures_rate || random_.uniform(0, 1) < 0.5;
    if (Filter::make({}, settings, Scalar(0), filter_) != Status::ok || !start()) {
      return;
    }
    if (!settings.estimates_vector && !bound_bias()) {
      return;
    }
    measure(settings.most_wrong > 0 ? static_cast<int>(random_.uniform(0, settings.most_wrong + 1)) : 0);
    Measurements<Scalar> measurements;
    measurements.directions = directions_.data();
    measurements.direction_count = directions_.size();
    measurements.angular_velocity = has_rate_ ? &rate_ : nullptr;
    measurements.attitude = has_attitude_ ? &attitude_ : nullptr;
    GuaranteedUpdate<Scalar> report;
    const Status status = filter_.update(measurements, report, constraints_);
    worst_.judge("contradicted", status == Status::empty_intersection ? 2 : 0, seed_);
    if (status == Status::ok) {
      worst_.judge("conditional", filter_.claim() == Claim::unconditional ? 0 : 2, seed_);
      judge_sets();
      for (const Vector3l& axis : axes()) {
        judge_axis(axis);
      }
    }
  }

 private:
  Vector3l direction() { return random_.unit_vector<3>().template cast<Long>().normalized(); }

  /// A shape with half-widths up to `widest`, of which none is less than `ratio` of it.
  Matrix3<Scalar> shape(double narrowest, double widest, double ratio) {
    const double width = random_.log_uniform(narrowest, widest);
    const Eigen::Vector3d squares(width * width, std::pow(width * random_.log_uniform(ratio, 1), 2),
                                  std::pow(width * random_.log_uniform(ratio, 1), 2));
    return random_.symmetric<3>(squares).template cast<Scalar>();
  }
  /// A point on the boundary, but for a share of its size; none of a shape that rounding left without one.
  bool on_boundary(const Matrix3<Scalar>& bound, Long share, Vector3l& point) {
    const Eigen::LLT<Matrix3l> factor(bound.template cast<Long>());
    const Vector3l to = factor.matrixL() * direction();
    point = (1 - share) * to;
    return factor.info() == Eigen::Success && share < 0.5L;
  }
  static double thinnest(const Matrix3<Scalar>& bound) {
    return std::sqrt(
        std::max(0.0, bound.template cast<double>().template selfadjointView<Eigen::Lower>().eigenvalues()(0)));
  }

  bool start() {
    constexpr bool single = rounding::is_single<Scalar>;
    const double least = single ? 1e-3 : 1e-6;
    Vector6<double> widths;
    const double wide = random_.uniform(0, 1) < 0.2 ? 25 : random_.log_uniform(100 * least, 2);
    const double fast = random_.log_uniform(1e-4, 100);
    for (int i = 0; i < 6; ++i) {
      widths(i) = i < 3 ? std::max(least, wide * random_.log_uniform(least, 1)) : fast * random_.log_uniform(0.1, 1);
    }
    Matrix6<double> mixed = random_.positive_definite<6>(random_.log_uniform(1.001, single ? 100 : 1e6));
    const Vector6<double> scale = mixed.diagonal().cwiseSqrt().cwiseInverse().cwiseProduct(widths);
    mixed = (scale.asDiagonal() * mixed * scale.asDiagonal()).eval();
    Matrix6<double> turned = Matrix6<double>::Identity();
    turned.topLeftCorner<3, 3>() = random_.orthogonal<3>();
    mixed = (turned * mixed * turned.transpose()).eval();
    prior_.shape = ((mixed + mixed.transpose()) / 2).eval().template cast<Scalar>();
    prior_.center = {Matrix3<Scalar>(Matrix3<Scalar>::Identity()),
                     Vector3<Scalar>(random_.normal_matrix<3>().template cast<Scalar>())};
    const Matrix6l exact = prior_.shape.template cast<Long>();
    const Eigen::LLT<Matrix6l> factor(exact);
    if (factor.info() != Eigen::Success || filter_.start(prior_) != Status::ok) {
      return false;
    }
    const Vector6l unit = random_.unit_vector<6>().template cast<Long>().normalized();
    const Vector6l to = factor.matrixL() * unit;
    const Vector6l y = (1 - 1e-12L) * to;
    normal_ = factor.solve(y).template head<3>();
    truth_ = rotation_of_gibbs(y.template head<3>());
    vector_ = vector_part(prior_.center).template cast<Long>() + y.template tail<3>();
    return true;
  }

  bool bound_bias() {
    Ellipsoid<Scalar, 3> bound{{}, shape(1e-4, 10, 0.1)};
    Vector3l error;
    if (!on_boundary(bound.shape, Long(100 * epsilon) * (1 + vector_.norm()) / Long(thinnest(bound.shape)), error)) {
      return false;
    }
    bound.center = (vector_ - error).template cast<Scalar>();
    return filter_.bound_vector(bound) == Status::ok;
  }

  /// \param lies how many measurements are wrong.
  void measure(int lies) {
    const int count = static_cast<int>(random_.uniform(0, 5));
    for (int i = 0; i < count; ++i) {
      add_direction(lies-- > 0);
    }
    Vector3l error;
    rate_.bound = shape(1e-4, 100, 1e-2);
    has_rate_ =
        Filter::measures_rate && random_.uniform(0, 1) < 0.6 &&
        on_boundary(rate_.bound, Long(100 * epsilon) * (1 + vector_.norm()) / Long(thinnest(rate_.bound)), error);
    rate_.value = (vector_ - error).template cast<Scalar>();
    attitude_.bound = shape(1e-4, 2, 1e-2);
    has_attitude_ = random_.uniform(0, 1) < 0.3 &&
                    on_boundary(attitude_.bound, Long(100 * epsilon) / Long(thinnest(attitude_.bound)), error);
    attitude_.attitude = (truth_ * rotation_of(-error)).template cast<Scalar>();
  }

  void add_direction(bool lies) {
    const Vector3<Scalar> reference = (random_.log_uniform(1e-2, 1e2) * direction()).template cast<Scalar>();
    const Vector3l seen = truth_.transpose() * reference.template cast<Long>().normalized();
    Matrix3<Scalar> bound = shape(1e-3, 2, 0.03);
    Vector3l error;
    const bool by_ellipsoid =
        !lies && random_.uniform(0, 1) < 0.3 && on_boundary(bound, Long(100 * epsilon) / Long(thinnest(bound)), error);
    const double angle = random_.log_uniform(random_.uniform(0, 1) < 0.2 ? 1e-6 : 1e-3, 3.2);
    if (!by_ellipsoid) {
      error = Long(angle) * (lies ? 3 : 1) * seen.cross(direction()).normalized();
    }
    const Vector3<Scalar> body = (rotation_of(-error) * seen).template cast<Scalar>();
    if (!by_ellipsoid) {
      const Long right = angle_between(body.template cast<Long>().normalized(), seen);
      const Scalar stated(static_cast<Scalar>((lies ? Long(angle) : right) * (1 + 4 * Long(epsilon))));
      bound = stated * stated * Matrix3<Scalar>::Identity();
    }
    directions_.push_back({reference, body, bound, Scalar(1)});
  }

  void judge_sets() {
    const auto& set = filter_.ellipsoid();
    const Quaternion q = error_of(nearest(set.center.attitude), truth_);
    Vector6l y;
    y << 2 * q.vec() / q.w(), vector_ - vector_part(set.center).template cast<Long>();
    const Matrix6l shape = set.shape.template cast<Long>();
    if (filter_.settings().estimates_vector) {
      worst_.judge("set", form<6>(shape, y), seed_);
    } else {
      worst_.judge("set of the attitude", form<3>(shape.template topLeftCorner<3, 3>(), y.template head<3>()), seed_);
      worst_.judge("set of the bias", form<3>(shape.template bottomRightCorner<3, 3>(), y.template tail<3>()), seed_);
    }
    for (const auto& criterion : {SizeCriterion<Scalar, 3>::volume(), SizeCriterion<Scalar, 3>::trace()}) {
      AttitudeSet<Scalar> own;
      if (constraints_.attitude_set(criterion, own) == Status::ok) {
        const Quaternion error = error_of(nearest(own.center), truth_);
        worst_.judge("attitude_set", form<3>(own.shape.template cast<Long>(), 2 * error.vec() / error.w()), seed_);
      }
    }
  }

  std::vector<Vector3l> axes() {
    const Matrix3l center = nearest(filter_.ellipsoid().center.attitude);
    const Vector3l to = error_of(center, truth_).vec();
    std::vector<Vector3l> found{direction(), to.norm() > 0 ? Vector3l(to.normalized()) : direction()};
    // About the prior's center n·g⁺ = (n·(g − ĝ − ĝ×g))/(1 + ĝ·g): its slope at the truth is along the prior's normal for n = J⁻ᵀ normal.
    const Quaternion whole = error_of(Matrix3l::Identity(), truth_);
    const Quaternion moved = error_of(Matrix3l::Identity(), center);
    const Vector3l g = whole.vec() / whole.w();
    const Vector3l hat = moved.vec() / moved.w();
    const Long w = 1 + hat.dot(g);
    const Vector3l plus = (g - hat - hat.cross(g)) / w;
    Matrix3l slope;
    for (int i = 0; i < 3; ++i) {
      const Vector3l unit = Vector3l::Unit(i);
      slope.col(i) = (unit - hat.cross(unit) - hat(i) * plus) / w;
    }
    const Vector3l axis = slope.transpose().fullPivLu().solve(normal_);
    if (axis.allFinite() && axis.norm() > 0) {
      found.emplace_back(axis.normalized());
      found.emplace_back(-axis.normalized());
    }
    return found;
  }

  void judge_axis(const Vector3l& axis) {
    const Matrix3l center = nearest(filter_.ellipsoid().center.attitude);
    const Quaternion q = error_of(center, truth_);
    const Vector3<Scalar> n = axis.template cast<Scalar>();
    const Vector3l unit = n.template cast<Long>().normalized();
    Interval<Scalar> extent;
    if (constraints_.turn_about(n, extent) == Status::ok) {
      worst_.judge("turn_about", 2 * std::atan2(unit.dot(q.vec()), q.w()), extent.least, extent.most, seed_);
    }
    if (constraints_.vector_along(n, extent) == Status::ok) {
      worst_.judge("vector_along", unit.dot(vector_), extent.least, extent.most, seed_);
    }
    const Vector3<Scalar> vertical = (center * unit).template cast<Scalar>();
    const Vector3l up = vertical.template cast<Long>().normalized();
    AttitudeBounds<Scalar> bounds;
    if (filter_.bounds(vertical, bounds) == Status::ok) {
      const Vector3l of_center = center.transpose() * up;
      worst_.judge("tilt", angle_between(of_center, truth_.transpose() * up) / Long(bounds.tilt), seed_);
      worst_.judge("heading", 2 * std::atan2(of_center.dot(q.vec()), q.w()), bounds.heading_from, bounds.heading_to,
                   seed_);
      worst_.judge("angle", 2 * std::atan2(q.vec().norm(), q.w()) / Long(bounds.angle), seed_);
    }
  }

  Random random_;
  std::uint64_t seed_;
  Worst& worst_;
  Filter filter_;
  UpdateConstraints<State> constraints_;
  GibbsEllipsoid<State> prior_;
  Matrix3l truth_;
  Vector3l vector_;
  Vector3l normal_;  // of the prior's boundary at the truth, of the attitude
  std::vector<Direction<Scalar>> directions_;
  AngularVelocity<Scalar> rate_;
  MeasuredAttitude<Scalar> attitude_;
  bool has_rate_ = false;
  bool has_attitude_ = false;
};

template <typename Scalar>
long search(const char* precision, long tries) {
  Worst worst;
  for (long i = 0; i < tries; ++i) {
    const auto seed = static_cast<std::uint64_t>(i);
    Scene<GuaranteedFilter<GuaranteedRigidBodyFlow<Scalar, FreeBody<Scalar>>>>(seed, worst).run();
    Scene<GuaranteedFilter<GuaranteedGyroFlow<Scalar>>>(seed, worst).run();
  }
  std::printf("%s: %ld truths, %ld answers, %ld that do not hold\n", precision, 2 * tries, worst.judged, worst.escapes);
  for (const auto& [question, value] : worst.values) {
    std::printf("  %-24s farthest truth %.9f\n", question.c_str(), value);
  }
  return worst.escapes + (worst.judged > tries ? 0 : 1);
}

}  // namespace

int main(int count, char** arguments) {
  const long tries = count > 1 ? std::strtol(arguments[1], nullptr, 10) : 20000;
  return search<double>("double", tries) + search<float>("float", tries) == 0 ? 0 : 1;
}
