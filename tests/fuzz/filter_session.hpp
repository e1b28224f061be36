#pragma once

/// \file
/// A guaranteed filter over a few moments of its life: honest predictions and updates between lies and garbage.

#include <vector>

#include "worlds.hpp"

namespace elliptude::fuzz {

template <typename World>
class FilterSession {
 public:
  using Filter = GuaranteedFilter<typename World::Flow>;
  using Set = typename World::Set;
  static constexpr bool measures_rate = Filter::measures_rate;

  explicit FilterSession(Bytes bytes) : bytes_(bytes), world_(bytes_) {
    typename Filter::Settings& settings = settings_;
    settings.criterion = bytes_.criterion();
    settings.policy = static_cast<Policy>(bytes_.choice(4));
    settings.most_wrong = settings.policy == Policy::relaxed ? bytes_.choice(3) : 0;
    settings.regain_after = 1 + bytes_.choice(5);
    settings.estimates_vector = measures_rate || bytes_.choice(3) != 1;
    require(Filter::make(world_.flow(), settings, 0.0, filter_) == Status::ok, "a valid filter", "settings");
    const Set set = honest_set(bytes_, world_);
    if (bytes_.choice(4) != 0) {
      require(filter_.start(set) == Status::ok, "an honest set starts a filter", "start");
    }
    if (!settings.estimates_vector || (!measures_rate && bytes_.choice(2) == 1)) {
      bound_vector();
    }
    check("the start");
  }

  void run() {
    const int most = 1 + bytes_.choice(8);
    for (int step = 0; step < most && !bytes_.at_end(); ++step) {
      switch (bytes_.choice(12)) {
        case 0:
          any_prediction();
          break;
        case 1:
          any_update();
          break;
        case 2:
          any_function();
          break;
        case 3:
          lie();
          break;
        case 4:
          linear_update();
          break;
        default:
          if (!good_cycle(bytes_.choice(4))) {
            return;
          }
      }
    }
    if (!honest_ && (settings_.policy == Policy::drop_measurement || settings_.policy == Policy::restart)) {
      recover();
    }
  }

 private:
  /// What always holds for the vector: for the gyro's bias, which drifts by little in the seconds that this lasts.
  void bound_vector() {
    if constexpr (!measures_rate) {
      const double width = 10 * (0.1 + static_cast<double>(world_.vector().norm()));
      bound_vector_by(width);
    }
  }

  /// One that contradicts what the filter knows, as lies have it, is refused until the filter has forgotten them.
  void bound_vector_by(double width) {
    const Ellipsoid<double, 3> bound{Eigen::Vector3d::Zero(), width * width * Eigen::Matrix3d::Identity()};
    Status status = filter_.bound_vector(bound);
    if (status == Status::empty_intersection && !honest_) {
      filter_.forget();
      status = filter_.bound_vector(bound);
    }
    require(status == Status::ok, "a valid bound", "bound_vector");
  }

  /// The truth is in the set, which is of two where the bias is not estimated.
  void require_truth(const char* what) {
    const Set& set = filter_.ellipsoid();
    if (settings_.estimates_vector) {
      require_inside(world_, set, what);
      return;
    }
    const RealVector gamma = gibbs_error(set.center.attitude, world_.attitude());
    const RealVector error = world_.vector() - vector_part(set.center).template cast<Real>();
    if (outside_by<3>(set.shape.template topLeftCorner<3, 3>(), gamma) > 0 ||
        outside_by<3>(set.shape.template bottomRightCorner<3, 3>(), error) > 0) {
      broken("the truth is inside", what);
    }
  }

  /// What holds of a filter at all times.
  void check(const char* what) {
    const Real slack = honest_ ? Real(0) : flat_to_rounding;
    if (filter_.knows_attitude()) {
      require_valid(filter_.ellipsoid(), what, slack);
      require(filter_.claim() != Claim::none, "a set comes with a claim", what);
      if (honest_) {
        require(filter_.claim() == Claim::unconditional && !filter_.trust().rests_on_drops(), "nothing true is dropped",
                what);
        require_truth(what);
      }
    } else {
      require(filter_.claim() == Claim::none, "no set means no claim", what);
      if (filter_.knows_vector()) {
        require_valid(filter_.vector(), what, slack);
        const RealVector error = world_.vector() - filter_.vector().center.template cast<Real>();
        require(!honest_ || outside_by<3>(filter_.vector().shape, error) <= 0, "the truth is inside", "the vector");
      }
    }
  }

  /// As many directions as wanted, and a rate or an attitude, each off by what its bound allows.
  void measure(int count) {
    directions_.clear();
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector3d reference = i > 0 && bytes_.choice(8) == 0
                                            ? Eigen::Vector3d((1 - 2 * bytes_.choice(2)) * directions_[0].reference)
                                            : Eigen::Vector3d(bytes_.unit_vector().cast<double>());
      const double width = bytes_.between(1e-7, 1);
      const Eigen::Matrix3d bound = bytes_.shape<3>(width / 10, width);
      directions_.push_back(honest_direction(bytes_, world_.attitude(), reference, bound));
    }
    measurements_ = {directions_.data(), directions_.size(), nullptr, nullptr};
    if (measures_rate && bytes_.choice(3) != 0) {
      rate_.bound = bytes_.shape<3>(1e-6, 0.1);
      const RealVector error = point_of<3>(rate_.bound, bytes_.in_ball<3>());
      // What is fast is rounded by more than a small bound has to spare.
      for (Real share = 1 - Real(1e-9);; share *= Real(0.99)) {
        rate_.value = RealVector(world_.vector() - share * error).template cast<double>();
        const RealVector rounded = world_.vector() - rate_.value.template cast<Real>();
        if (share < Real(0.5) || outside_by<3>(rate_.bound, RealVector(rounded * (1 + Real(1e-12)))) <= 0) {
          break;
        }
      }
      measurements_.angular_velocity = &rate_;
    }
    if (bytes_.choice(4) == 1) {
      attitude_.bound = bytes_.shape<3>(1e-6, 0.5);
      const RealVector error = (1 - Real(1e-9)) * point_of<3>(attitude_.bound, bytes_.in_ball<3>());
      attitude_.attitude = RealMatrix(world_.attitude() * real_exp(RealVector(-error))).template cast<double>();
      measurements_.attitude = &attitude_;
    }
  }

  /// \return whether the truth can be followed further.
  [[nodiscard]] bool good_cycle(int count) {
    const double duration = bytes_.between(1e-4, 0.3);
    if (!world_.is_moderate(duration)) {
      return false;
    }
    const typename World::Flow::Input input = world_.advance(bytes_, world_.time + duration);
    const Snapshot before(filter_);
    if (const Status status = filter_.predict(world_.time, input); status != Status::ok) {
      require(before.unchanged(), "nothing changed otherwise", "a prediction");
      require(!honest_ || status == Status::step_too_long, "a valid prediction is not refused", message(status));
      return false;
    }
    check("a prediction");
    measure(count);
    update("an honest update");
    return true;
  }

  void update(const char* what) {
    const Snapshot before(filter_);
    const Claim claim = filter_.claim();
    GuaranteedUpdate<double> report;
    const Status status = filter_.update(measurements_, report);
    if (status != Status::ok) {
      require(before.unchanged(), "nothing changed otherwise", what);
    } else {
      require(report.claim == filter_.claim(), "the report says what is claimed", what);
      require_within_bound((report.dropped & angular_velocity_bit) == 0, what);
    }
    if (honest_) {
      require(status == Status::ok, "what is true is not refused", message(status));
      require(report.dropped == 0 || (claim == Claim::none && !filter_.knows_attitude()), "nothing true is dropped",
              what);
    }
    check(what);
  }

  /// A rate that was taken up without an attitude does not contradict its bound: no later update could succeed.
  void require_within_bound(bool took_rate_up, const char* what) const {
    if (took_rate_up && measurements_.angular_velocity != nullptr && !filter_.knows_attitude() &&
        filter_.knows_vector() && filter_.has_vector_bound()) {
      double margin = 1;
      const Status status = overlap_margin(filter_.vector(), filter_.vector_bound(), margin);
      require(status != Status::ok || margin > -0.01, "what is known of the vector meets its bound", what);
    }
  }

  /// One honest measurement and one that is not, of any size.
  void lie() {
    measure(1 + bytes_.choice(3));
    honest_ = false;
    const int which = bytes_.choice(3);
    if (which == 0 && measurements_.angular_velocity != nullptr) {
      rate_.value *= bytes_.choice(2) == 0 ? bytes_.number() : bytes_.between(1e-3, 1e300);
    } else if (which == 1 && measurements_.attitude != nullptr) {
      attitude_.attitude = bytes_.rotation().template cast<double>();
    } else {
      directions_[0].body = bytes_.choice(2) == 0 ? Eigen::Vector3d(-directions_[0].body) : bytes_.numbers<3, 1>();
    }
    update("a lie");
  }

  void any_prediction() {
    honest_ = false;
    double time = bytes_.choice(2) == 0 ? filter_.time() + std::abs(bytes_.number()) : bytes_.number();
    if (time > filter_.time() + world_.most_duration() && std::isfinite(time)) {
      time = filter_.time() + world_.most_duration();
    }
    const Snapshot before(filter_);
    if (filter_.predict(time, World::any_input(bytes_)) != Status::ok) {
      require(before.unchanged(), "nothing changed otherwise", "a prediction of anything");
    }
    world_.time = filter_.time();
    check("a prediction of anything");
  }

  void any_update() {
    honest_ = false;
    measure(bytes_.choice(4));
    for (int change = 1 + bytes_.choice(3); change > 0; --change) {
      const std::size_t i =
          directions_.empty() ? 0 : static_cast<std::size_t>(bytes_.choice(static_cast<int>(directions_.size())));
      switch (directions_.empty() ? 4 + bytes_.choice(4) : bytes_.choice(8)) {
        case 0:
          directions_[i].reference = bytes_.numbers<3, 1>();
          break;
        case 1:
          directions_[i].body = bytes_.numbers<3, 1>();
          break;
        case 2:
          directions_[i].bound = bytes_.any_shape<3>();
          break;
        case 3:
          directions_[i].weight = bytes_.number();
          break;
        case 4:
          rate_.value = bytes_.numbers<3, 1>();
          break;
        case 5:
          rate_.bound = bytes_.any_shape<3>();
          break;
        case 6:
          attitude_.attitude = bytes_.numbers<3, 3>();
          break;
        default:
          attitude_.bound = bytes_.any_shape<3>();
      }
    }
    update("an update with anything");
  }

  [[nodiscard]] Trust any_trust() {
    const bool rests = bytes_.choice(2) == 0;
    const int agreeing = bytes_.choice(4) - 1;
    return {rests, agreeing, bytes_.choice(4) - 1};
  }

  /// Whatever else may be called.
  void any_function() {
    honest_ = false;
    const Snapshot before(filter_);
    Status status = Status::ok;
    switch (bytes_.choice(3)) {
      case 0:
        status = filter_.bound_vector({bytes_.numbers<3, 1>(), bytes_.any_shape<3>()});
        break;
      case 1: {
        Set set;
        set.center = {
            bytes_.choice(2) == 0 ? Eigen::Matrix3d(bytes_.rotation().template cast<double>()) : bytes_.numbers<3, 3>(),
            bytes_.numbers<3, 1>()};
        set.shape = bytes_.any_shape<6>();
        status = bytes_.choice(2) == 0 ? filter_.start(set) : filter_.resume(&set, nullptr, any_trust());
        break;
      }
      default: {
        const Ellipsoid<double, 3> vector{bytes_.numbers<3, 1>(), bytes_.any_shape<3>()};
        status = filter_.resume(nullptr, &vector, any_trust());
      }
    }
    require(status == Status::ok || before.unchanged(), "nothing changed otherwise", "a function with anything");
    check("a function with anything");
  }

  void linear_update() {
    LinearMeasurement<double, 2> linear{bytes_.numbers<2, 1>(), bytes_.numbers<2, 6>(), bytes_.any_shape<2>()};
    honest_ = false;
    const Snapshot before(filter_);
    GuaranteedUpdate<double> report;
    if (filter_.update(linear, report) != Status::ok) {
      require(before.unchanged(), "nothing changed otherwise", "a linear update of anything");
    }
    check("a linear update of anything");
  }

  /// Whether a small set at rest, in the attitude that is believed, can be predicted.
  [[nodiscard]] bool predicts_rest(double duration, const typename World::Flow::Input& input) const {
    const typename World::State rest{filter_.ellipsoid().center.attitude, Eigen::Vector3d::Zero()};
    Set set{rest, 1e-12 * Matrix6<double>::Identity()};
    const Status status = filter_.flow().predict(filter_.time(), duration, input, set, set);
    return status == Status::ok || status == Status::unbounded;
  }

  /// Good cycles, in each of which the measurements alone bound a set: 2 × `regain_after` of them after the first that
  /// contradicts the claim is unconditional, with the truth inside, and both stay so. (theory, section 16.8)
  void recover() {
    if (!(std::abs(filter_.time()) < 1e6)) {
      return;  // where a second more is none
    }
    if constexpr (measures_rate) {
      bound_vector_by(1e3);
    } else {
      bound_vector();
    }
    world_.time = filter_.time();
    const int n = settings_.regain_after;
    // Nothing is promised about a lie that nothing contradicts: the set may be wrong, and the claim unconditional.
    int since = filter_.trust().rests_on_drops() ? 0 : -1;
    for (int cycle = 0; cycle < 5 * n + 2; ++cycle) {
      if (!world_.is_moderate(0.05)) {
        return;
      }
      const typename World::Flow::Input input = world_.advance(bytes_, filter_.time() + 0.05);
      if (const Status status = filter_.predict(world_.time, input); status != Status::ok) {
        if (status == Status::step_too_long && !predicts_rest(0.05, input)) {
          return;  // the flow's steps are too long for this body, whatever the filter holds
        }
        broken("a filter goes on after anything", message(status));
      }
      directions_.clear();
      for (int i = 0; i < 3; ++i) {
        directions_.push_back(
            honest_direction(bytes_, world_.attitude(), Eigen::Vector3d::Unit(i), 1e-4 * Eigen::Matrix3d::Identity()));
      }
      measurements_ = {directions_.data(), directions_.size(), nullptr, nullptr};
      if constexpr (measures_rate) {
        rate_.bound = 1e-4 * Eigen::Matrix3d::Identity();
        rate_.value = world_.vector().template cast<double>();
        measurements_.angular_velocity = &rate_;
      }
      GuaranteedUpdate<double> report;
      if (const Status status = filter_.update(measurements_, report); status != Status::ok) {
        broken("a filter goes on after anything", message(status));
      }
      check("a good cycle");
      const bool contradicts = report.dropped != 0 || report.contradicting != 0;
      since = since >= 0 ? since + 1 : (contradicts ? 0 : -1);
      if (since > 2 * n) {
        require(!contradicts && filter_.claim() == Claim::unconditional, "recovery in 2 regain_after updates",
                "the claim");
        require_truth("recovery in 2 regain_after updates");
      }
    }
  }

  Bytes bytes_;
  World world_;
  typename Filter::Settings settings_;
  Filter filter_;
  bool honest_ = true;  // whether all that the filter was told is true
  std::vector<Direction<double>> directions_;
  AngularVelocity<double> rate_{Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity()};
  MeasuredAttitude<double> attitude_{Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Identity()};
  Measurements<double> measurements_;
};

}  // namespace elliptude::fuzz
