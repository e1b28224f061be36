#pragma once

/// \file
/// Filters of all kinds behind one interface, as flight software holds them: sealed, and made again by a rule where they cannot go on.

#include <elliptude.h>

#include <cstring>
#include <elliptude/base/seal.hpp>
#include <elliptude/elliptude.hpp>
#include <memory>
#include <optional>
#include <string>

#include "support/faults/world.hpp"

namespace elliptude::faults {

/// What a filter says of the state.
struct Belief {
  bool knows = false;
  bool unconditional = false;  ///< of a filter of first order: that it has a set
  double time = 0;
  Matrix3d attitude = Matrix3d::Identity();
  Vector3d vector = Vector3d::Zero();
  Matrix6d shape = Matrix6d::Zero();

  [[nodiscard]] bool operator==(const Belief& other) const {
    return knows == other.knows && unconditional == other.unconditional && time == other.time &&
           (!knows || (attitude == other.attitude && vector == other.vector && shape == other.shape));
  }
};

struct Answer {
  int status = ELLIPTUDE_OK;
  bool contradicted = false;
  int fusions = 0;
  int steps = 0;
};

class Subject {
 public:
  explicit Subject(Kind kind) : kind_(kind) {}
  Subject(const Subject&) = delete;
  Subject& operator=(const Subject&) = delete;
  virtual ~Subject() = default;

  [[nodiscard]] Kind kind() const { return kind_; }
  [[nodiscard]] virtual bool is_guaranteed() const = 0;
  [[nodiscard]] virtual bool is_single() const = 0;
  /// Starts again, at the time of a moment and from what was measured then.
  [[nodiscard]] virtual int make(const Moment& moment) = 0;
  [[nodiscard]] virtual int predict(const Moment& moment) = 0;
  [[nodiscard]] virtual Answer update(const Moment& moment) = 0;
  virtual void forget() = 0;
  [[nodiscard]] virtual Belief belief() const = 0;
  /// Whether the memory is as the last call left it.
  [[nodiscard]] virtual int check() const = 0;
  /// The memory that the filter consists of.
  [[nodiscard]] virtual unsigned char* bytes() = 0;
  [[nodiscard]] virtual std::size_t size() const = 0;

 private:
  Kind kind_;
};

/// What a campaign tells a guaranteed filter to do about contradictions.
struct Rules {
  Policy policy = Policy::drop_measurement;
  int most_wrong = 0;
  int regain_after = 3;
};

template <typename Scalar>
[[nodiscard]] Scalar number(double x) {
  if constexpr (std::is_same_v<Scalar, float>) {
    if (std::abs(x) > static_cast<double>(std::numeric_limits<float>::max())) {
      return std::copysign(std::numeric_limits<float>::infinity(), x > 0 ? 1.0F : -1.0F);
    }
  }
  return static_cast<Scalar>(x);
}
template <typename Scalar>
[[nodiscard]] Vector3<Scalar> vector_of(const Vector3d& v) {
  return {number<Scalar>(v.x()), number<Scalar>(v.y()), number<Scalar>(v.z())};
}
template <typename Scalar>
[[nodiscard]] Matrix3<Scalar> ball(double radius) {
  return number<Scalar>(radius * radius) * Matrix3<Scalar>::Identity();
}
template <typename Scalar>
[[nodiscard]] std::vector<Direction<Scalar>> directions_of(const Moment& moment) {
  std::vector<Direction<Scalar>> directions;
  for (const Sight& sight : moment.sights) {
    directions.push_back(Direction<Scalar>::within(vector_of<Scalar>(sight.reference), vector_of<Scalar>(sight.body),
                                                   number<Scalar>(angle_bound)));
  }
  return directions;
}

/// A flow of each kind.
template <typename Flow>
[[nodiscard]] Flow flow_of() {
  using Scalar = StateScalar<typename Flow::State>;
  Flow flow;
  Status status = Status::ok;
  if constexpr (std::is_same_v<Flow, GuaranteedGyroFlow<Scalar>>) {
    GyroUncertainty<Scalar> uncertainty;
    uncertainty.noise = ball<Scalar>(noise_bound);
    uncertainty.largest_rate = Scalar(speed_bound);
    uncertainty.longest_interval = Scalar(1);
    status = Flow::make(uncertainty, Flow::IntervalRate::mean, flow);
  } else if constexpr (std::is_same_v<Flow, GyroFlow<Scalar>>) {
    status = Flow::make(ball<Scalar>(noise_bound), Matrix3<Scalar>::Zero(), flow);
  } else {
    RigidBody<Scalar> body;
    status = RigidBody<Scalar>::make(Vector3<Scalar>(1, 1, Scalar(1.5)).asDiagonal(), body);
    if constexpr (std::is_same_v<Flow, GuaranteedRigidBodyFlow<Scalar, FreeBody<Scalar>>>) {
      status = status == Status::ok ? Flow::make(body, {}, Scalar(step), {}, flow) : status;
    } else {
      status = status == Status::ok ? Flow::make(body, {}, Scalar(step), 2, Matrix3<Scalar>::Zero(), flow) : status;
    }
    status = status == Status::ok ? flow.set_most_steps(100) : status;
  }
  if (status != Status::ok) {
    std::abort();
  }
  return flow;
}

/// What both kinds of C++ filters have in common.
template <typename Filter>
class CppSubject : public Subject {
 public:
  using Scalar = typename Filter::Scalar;
  static constexpr bool is_body = std::is_same_v<typename Filter::State, RigidBodyState<Scalar>>;
  CppSubject() : Subject(is_body ? Kind::body : Kind::gyro), filter_(Filter()) {}

  [[nodiscard]] bool is_single() const override { return std::is_same_v<Scalar, float>; }
  [[nodiscard]] int predict(const Moment& moment) override {
    typename Filter::Input input{};
    if constexpr (!is_body) {
      input.angular_velocity = vector_of<Scalar>(moment.rate);
      if constexpr (std::is_same_v<typename Filter::Flow, GuaranteedGyroFlow<Scalar>>) {
        input.is_measured = moment.has_rate;
      }
    }
    return static_cast<int>(
        filter_.call([&](Filter& filter) { return filter.predict(number<Scalar>(moment.time), input); }));
  }
  [[nodiscard]] int check() const override { return static_cast<int>(filter_.verify()); }
  [[nodiscard]] unsigned char* bytes() override { return reinterpret_cast<unsigned char*>(&filter_); }
  [[nodiscard]] std::size_t size() const override { return sizeof filter_; }
  [[nodiscard]] const Filter& filter() const { return filter_.object(); }
  /// Takes the memory as it is, as a filter without a seal would.
  void seal_as_it_is() { filter_.replace(Filter(filter_.object())); }

 protected:
  template <typename Set>
  void say(const Set& set, Belief& belief) const {
    belief.attitude = set.center.attitude.template cast<double>();
    belief.vector = vector_part(set.center).template cast<double>();
    belief.shape = set.shape.template cast<double>();
  }
  Sealed<Filter> filter_;
};

template <typename Flow>
class GuaranteedSubject : public CppSubject<GuaranteedFilter<Flow>> {
 public:
  using Filter = GuaranteedFilter<Flow>;
  using Base = CppSubject<Filter>;
  using Scalar = typename Base::Scalar;
  explicit GuaranteedSubject(const Rules& rules) : rules_(rules) {}

  [[nodiscard]] bool is_guaranteed() const override { return true; }
  [[nodiscard]] int make(const Moment& moment) override {
    typename Filter::Settings settings;
    settings.policy = rules_.policy;
    settings.most_wrong = rules_.most_wrong;
    settings.regain_after = rules_.regain_after;
    Filter filter;
    Status status = Filter::make(flow_of<Flow>(), settings, number<Scalar>(moment.time), filter);
    if (status == Status::ok) {
      status = filter.bound_vector({Vector3<Scalar>::Zero(), ball<Scalar>(Base::is_body ? speed_bound : bias_bound)});
    }
    if (status == Status::ok) {
      this->filter_.replace(filter);
    }
    return static_cast<int>(status);
  }
  [[nodiscard]] Answer update(const Moment& moment) override {
    const std::vector<Direction<Scalar>> directions = directions_of<Scalar>(moment);
    const AngularVelocity<Scalar> rate{vector_of<Scalar>(moment.rate), ball<Scalar>(rate_bound)};
    const bool with_rate = Base::is_body && moment.has_rate;
    GuaranteedUpdate<Scalar> report;
    Answer answer;
    answer.status = static_cast<int>(this->filter_.call([&](Filter& filter) {
      return filter.update({directions.data(), directions.size(), with_rate ? &rate : nullptr, nullptr}, report);
    }));
    answer.contradicted = report.margin < Scalar(0) || report.dropped != 0;
    answer.fusions = report.fusions;
    answer.steps = report.steps;
    return answer;
  }
  void forget() override {
    (void)this->filter_.call([](Filter& filter) {
      filter.forget();
      return Status::ok;
    });
  }
  [[nodiscard]] Belief belief() const override {
    const Filter& filter = this->filter_.object();
    Belief belief;
    belief.knows = filter.knows_attitude();
    belief.unconditional = filter.claim() == Claim::unconditional;
    belief.time = static_cast<double>(filter.time());
    this->say(filter.ellipsoid(), belief);
    return belief;
  }

 private:
  Rules rules_;
};

/// A filter of the modes `paper` and `first_order`, which promises nothing of the truth.
template <typename Flow, typename Estimator>
class FirstOrderSubject : public CppSubject<AttitudeFilter<Flow, Estimator>> {
 public:
  using Filter = AttitudeFilter<Flow, Estimator>;
  using Base = CppSubject<Filter>;
  using Scalar = typename Base::Scalar;

  [[nodiscard]] bool is_guaranteed() const override { return false; }
  [[nodiscard]] int make(const Moment& moment) override {
    const std::vector<Direction<Scalar>> directions = directions_of<Scalar>(moment);
    const auto criterion = SizeCriterion<Scalar, 6>::volume();
    MeasuredDirections<Scalar> measured;
    Status status = MeasuredDirections<Scalar>::make(directions.data(), directions.size(), WahbaMethod::foam, measured);
    StateEllipsoid<typename Filter::State> set;
    if constexpr (Base::is_body) {
      const AngularVelocity<Scalar> rate{vector_of<Scalar>(moment.rate), ball<Scalar>(rate_bound)};
      status = status == Status::ok ? measured_state(measured, rate, criterion, set) : status;
    } else {
      MeasuredAttitude<Scalar> attitude;
      status = status == Status::ok ? measured.measured_attitude(SizeCriterion<Scalar, 3>::trace(), attitude) : status;
      set.center = {attitude.attitude, Vector3<Scalar>::Zero()};
      set.shape.setZero();
      set.shape.template topLeftCorner<3, 3>() = Scalar(2) * attitude.bound;
      set.shape.template bottomRightCorner<3, 3>() = Scalar(2) * ball<Scalar>(bias_bound);
    }
    Filter filter;
    status = status == Status::ok ? Filter::make(flow_of<Flow>(), criterion, number<Scalar>(moment.time), set, filter)
                                  : status;
    if (status == Status::ok) {
      this->filter_.replace(filter);
      is_made_ = true;
    }
    return static_cast<int>(status);
  }
  [[nodiscard]] Answer update(const Moment& moment) override {
    const std::vector<Direction<Scalar>> directions = directions_of<Scalar>(moment);
    if (directions.empty() && !(Base::is_body && moment.has_rate)) {
      return {};
    }
    Update<Scalar> report{Scalar(1), Scalar(1)};
    Answer answer;
    answer.status = static_cast<int>(this->filter_.call([&](Filter& filter) {
      if constexpr (Base::is_body) {
        if (moment.has_rate) {
          const AngularVelocity<Scalar> rate{vector_of<Scalar>(moment.rate), ball<Scalar>(rate_bound)};
          return filter.update(directions.data(), directions.size(), rate, report);
        }
      }
      return filter.update(directions.data(), directions.size(), report);
    }));
    answer.contradicted = answer.status == ELLIPTUDE_EMPTY_INTERSECTION;
    return answer;
  }
  void forget() override {}
  [[nodiscard]] Belief belief() const override {
    Belief belief;
    belief.knows = is_made_;
    belief.unconditional = is_made_;
    belief.time = static_cast<double>(this->filter_.object().time());
    this->say(this->filter_.object().ellipsoid(), belief);
    return belief;
  }

 private:
  bool is_made_ = false;
};

}  // namespace elliptude::faults
