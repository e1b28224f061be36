#pragma once

/// \file
/// What a fault campaign is about: a body that turns, what honest sensors say of it, and what faults make of that.

#include <Eigen/Dense>
#include <elliptude/base/so3.hpp>
#include <limits>
#include <vector>

#include "support/random.hpp"

namespace elliptude::faults {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using testing::Random;

inline constexpr double step = 0.125;         // s, between moments: exact in float, too
inline constexpr double angle_bound = 0.02;   // rad, of a direction
inline constexpr double rate_bound = 0.02;    // rad/s, of a rigid body's measured rate
inline constexpr double noise_bound = 0.002;  // rad/s, of a gyro
inline constexpr double bias_bound = 0.01;    // rad/s
inline constexpr double speed_bound = 2;      // rad/s, of the body: a relaxed filter cannot start without one
inline constexpr double inside = 0.999;       // how much of its bound an honest error may use

enum class Kind { body, gyro };

/// A direction that was seen, within `angle_bound`.
struct Sight {
  Vector3d reference;
  Vector3d body;
};

/// What is told to a filter at one moment.
struct Moment {
  double time = 0;
  Vector3d rate = Vector3d::Zero();  ///< of a rigid body at the moment, or what its gyro said of the interval before
  bool has_rate = true;
  std::vector<Sight> sights;
};

/// A free body with moments (1, 1, 1.5), or one that turns evenly and has a gyro with a constant bias.
class World {
 public:
  World(Kind kind, Random& random) : kind_(kind), attitude_(random.rotation()) {
    const Vector3d spin = random.log_uniform(0.01, 1) * random.unit_vector<3>();
    spin_ = spin;
    vector_ = kind == Kind::body ? spin : Vector3d(inside * bias_bound * random.in_ball<3>());
    const Matrix3d axes = random.rotation();
    const int count = static_cast<int>(random.uniform(3, 6));
    for (int i = 0; i < count; ++i) {
      references_.push_back(i < 3 ? Vector3d(axes.col(i)) : random.unit_vector<3>());
    }
  }

  [[nodiscard]] Kind kind() const { return kind_; }
  [[nodiscard]] const Matrix3d& attitude() const { return attitude_; }
  /// The angular velocity, or the gyro's bias.
  [[nodiscard]] const Vector3d& vector() const { return vector_; }
  [[nodiscard]] double time() const { return time_; }

  /// What honest sensors say now.
  [[nodiscard]] Moment honest(Random& random) const {
    Moment moment;
    moment.time = time_;
    for (const Vector3d& reference : references_) {
      const Vector3d error = inside * angle_bound * random.in_ball<3>();
      moment.sights.push_back({reference, exp(error) * Vector3d(attitude_.transpose() * reference)});
    }
    const double bound = kind_ == Kind::body ? rate_bound : noise_bound;
    moment.rate =
        vector_ + (kind_ == Kind::body ? Vector3d(Vector3d::Zero()) : spin_) + inside * bound * random.in_ball<3>();
    return moment;
  }

  void advance() {
    time_ += step;
    if (kind_ == Kind::gyro) {
      attitude_ = renormalized(Matrix3d(attitude_ * exp(Vector3d(step * spin_))));
      return;
    }
    // In closed form: with L = CJω fixed and κ = −½ω₃, C(t) = exp(S(tL)) C₀ exp(S(tκe₃)).
    const Vector3d moments(1, 1, 1.5);
    const Vector3d momentum = attitude_ * Vector3d(moments.cwiseProduct(vector_));
    const Vector3d own = -0.5 * vector_(2) * Vector3d::UnitZ();
    attitude_ = renormalized(Matrix3d(exp(Vector3d(step * momentum)) * attitude_ * exp(Vector3d(step * own))));
    vector_ = Vector3d(attitude_.transpose() * momentum).cwiseQuotient(moments);
  }

 private:
  Kind kind_;
  Matrix3d attitude_;
  Vector3d spin_;
  Vector3d vector_;
  double time_ = 0;
  std::vector<Vector3d> references_;
};

enum class Fault {
  none,
  lost,         // a sensor, or all, says nothing
  late,         // what it said one to three moments before
  repeated,     // the same is told twice
  swapped,      // two directions in each other's place
  extreme,      // NaN, infinity, a denormal or the largest number in one place
  constant,     // anything, and always the same
  stuck,        // what it said when the fault began
  sign,         // of a vector, reversed
  drift,        // an angle or a rate that grows slowly
  clock_ahead,  // stamps are late by 1 ms to 1e6 s
  clock_back,   // or early
  clock_wrong,  // a stamp that is no time
  order,        // calls in any order
};
inline constexpr int fault_count = 14;
inline constexpr const char* fault_names[fault_count] = {
    "none",  "lost", "late",  "repeated",    "swapped",    "extreme",     "constant",
    "stuck", "sign", "drift", "clock ahead", "clock back", "clock wrong", "order"};

/// Whether everything that a filter is told under this fault is true, or refused.
[[nodiscard]] inline bool is_honest(Fault fault) {
  return fault == Fault::none || fault == Fault::lost || fault == Fault::repeated || fault == Fault::order;
}

/// One fault, over a few moments.
class Injection {
 public:
  Injection(Fault fault, Random& random)
      : fault_(fault),
        begin_(static_cast<int>(random.uniform(0, 10))),
        end_(begin_ + static_cast<int>(random.uniform(1, 12))),
        delay_(static_cast<std::size_t>(random.uniform(1, 4))),
        all_(random.uniform(0, 1) < 0.2),
        on_rate_(random.uniform(0, 1) < 0.3),
        which_(static_cast<std::size_t>(random.uniform(0, 3))),
        special_(specials()[static_cast<std::size_t>(random.uniform(0, 10))]),
        entry_(static_cast<int>(random.uniform(0, 3))),
        axis_(random.unit_vector<3>()),
        size_(random.log_uniform(1e-3, 3)),
        offset_(random.log_uniform(1e-3, 1e6)) {}

  [[nodiscard]] Fault fault() const { return fault_; }
  [[nodiscard]] int end() const { return end_; }
  [[nodiscard]] bool acts(int k) const { return k >= begin_ && k < end_; }
  /// Whether at most one sensor of a moment is concerned, and not the gyro or the clock, from which predictions come.
  [[nodiscard]] bool is_of_one_sensor(Kind kind) const {
    return fault_ >= Fault::late && fault_ <= Fault::drift && fault_ != Fault::swapped &&
           !(on_rate_ && kind == Kind::gyro) && !(fault_ == Fault::late && all_);
  }

  /// What the filter is told in place of what honest sensors say. To be called at each moment.
  [[nodiscard]] Moment told(int k, const Moment& honest) {
    past_.push_back(honest);
    Moment moment = honest;
    if (!acts(k)) {
      return moment;
    }
    const Moment& before = past_[past_.size() - 1 - std::min(delay_, past_.size() - 1)];
    const Moment& at_begin = past_[static_cast<std::size_t>(begin_)];
    Vector3d& vector = on_rate_ ? moment.rate : moment.sights[which_].body;
    const auto of = [&](const Moment& other) { return on_rate_ ? other.rate : other.sights[which_].body; };
    const double growing = size_ * angle_bound * (k - begin_ + 1);
    switch (fault_) {
      case Fault::lost:
        lose(moment);
        break;
      case Fault::late:
        vector = of(before);
        if (all_) {
          const double now = moment.time;
          moment = before;
          moment.time = now;
        }
        break;
      case Fault::swapped:
        std::swap(moment.sights[0].body, moment.sights[1].body);
        break;
      case Fault::extreme:
        vector(entry_) = special_;
        break;
      case Fault::constant:
        vector = on_rate_ ? Vector3d(size_ * axis_) : axis_;
        break;
      case Fault::stuck:
        vector = of(at_begin);
        break;
      case Fault::sign:
        vector = -vector;
        break;
      case Fault::drift:
        vector = on_rate_ ? Vector3d(vector + growing * axis_) : Vector3d(exp(Vector3d(growing * axis_)) * vector);
        break;
      case Fault::clock_ahead:
        moment.time += offset_;
        break;
      case Fault::clock_back:
        moment.time -= offset_;
        break;
      case Fault::clock_wrong:
        moment.time = special_;
        break;
      default:
        break;
    }
    return moment;
  }

 private:
  [[nodiscard]] static const double* specials() {
    using Limits = std::numeric_limits<double>;
    static const double values[10] = {Limits::quiet_NaN(),
                                      Limits::infinity(),
                                      -Limits::infinity(),
                                      Limits::denorm_min(),
                                      Limits::max(),
                                      -Limits::max(),
                                      Limits::min(),
                                      1e-160,
                                      1e160,
                                      -1e30};
    return values;
  }
  void lose(Moment& moment) const {
    if (all_) {
      moment.sights.clear();
    }
    if (all_ || on_rate_) {
      moment.has_rate = false;
    } else {
      moment.sights.erase(moment.sights.begin() + static_cast<std::ptrdiff_t>(which_));
    }
  }

  Fault fault_;
  int begin_;
  int end_;
  std::size_t delay_;
  bool all_;
  bool on_rate_;
  std::size_t which_;
  double special_;
  int entry_;
  Vector3d axis_;
  double size_;
  double offset_;
  std::vector<Moment> past_;
};

}  // namespace elliptude::faults
