#pragma once

/// \file
/// The filters of the C interface as subjects of a fault campaign.

#include "support/faults/subject.hpp"

namespace elliptude::faults {

/// The functions of the C interface for one of its filters, by the same names.
struct BodyInC {
  static constexpr Kind kind = Kind::body;
  using Filter = elliptude_body;
  static elliptude_status make(Filter& filter, const elliptude_settings& settings, double time) {
    elliptude_body_parameters parameters;
    (void)elliptude_body_defaults(&parameters);
    parameters.settings = settings;
    parameters.most_steps = 100;
    parameters.longest_step = number<elliptude_number>(step);
    parameters.inertia[8] = elliptude_number(1.5);
    for (elliptude_number& bound : parameters.rate_bound) {
      bound = number<elliptude_number>(speed_bound);
    }
    return elliptude_body_init(&filter, sizeof filter, &parameters, number<elliptude_number>(time));
  }
  static elliptude_status predict(Filter& filter, elliptude_number time, const elliptude_number* rate,
                                  elliptude_report& report) {
    (void)rate;
    return elliptude_body_predict(&filter, time, nullptr, nullptr, &report);
  }
  static constexpr auto update = elliptude_body_update;
  static constexpr auto forget = elliptude_body_forget;
  static constexpr auto check = elliptude_body_check;
  static constexpr auto set = elliptude_body_set;
};

struct GyroInC {
  static constexpr Kind kind = Kind::gyro;
  using Filter = elliptude_gyro;
  static elliptude_status make(Filter& filter, const elliptude_settings& settings, double time) {
    elliptude_gyro_parameters parameters;
    (void)elliptude_gyro_defaults(&parameters);
    parameters.settings = settings;
    parameters.interval_rate = ELLIPTUDE_MEAN;
    parameters.longest_interval = 1;
    parameters.largest_rate = number<elliptude_number>(speed_bound);
    for (int i = 0; i < 3; ++i) {
      parameters.noise[i] = number<elliptude_number>(noise_bound);
      parameters.bias_bound[i] = number<elliptude_number>(bias_bound);
    }
    return elliptude_gyro_init(&filter, sizeof filter, &parameters, number<elliptude_number>(time));
  }
  static elliptude_status predict(Filter& filter, elliptude_number time, const elliptude_number* rate,
                                  elliptude_report& report) {
    return elliptude_gyro_predict(&filter, time, rate, &report);
  }
  static constexpr auto update = elliptude_gyro_update;
  static constexpr auto forget = elliptude_gyro_forget;
  static constexpr auto check = elliptude_gyro_check;
  static constexpr auto set = elliptude_gyro_set;
};

template <typename InC>
class CSubject : public Subject {
 public:
  explicit CSubject(const Rules& rules)
      : Subject(InC::kind),
        settings_{static_cast<elliptude_policy>(rules.policy), rules.most_wrong, rules.regain_after,
                  ELLIPTUDE_LEAST_VOLUME, 1} {
    std::memset(&filter_, 0, sizeof filter_);
  }

  [[nodiscard]] bool is_guaranteed() const override { return true; }
  [[nodiscard]] bool is_single() const override { return sizeof(elliptude_number) == sizeof(float); }
  [[nodiscard]] int make(const Moment& moment) override {
    const elliptude_status status = InC::make(filter_, settings_, moment.time);
    if (status == ELLIPTUDE_OK) {
      report_ = {};
      report_.claim = ELLIPTUDE_NO_CLAIM;
      report_.time = number<elliptude_number>(moment.time);
    }
    return status;
  }
  [[nodiscard]] int predict(const Moment& moment) override {
    elliptude_number rate[3];
    write(moment.rate, rate);
    elliptude_report report;
    const elliptude_status status =
        InC::predict(filter_, number<elliptude_number>(moment.time), moment.has_rate ? rate : nullptr, report);
    keep(report);
    return status;
  }
  [[nodiscard]] Answer update(const Moment& moment) override {
    std::vector<elliptude_direction> directions(moment.sights.size());
    for (std::size_t i = 0; i < directions.size(); ++i) {
      write(moment.sights[i].reference, directions[i].reference);
      write(moment.sights[i].body, directions[i].body);
      directions[i].bound = number<elliptude_number>(angle_bound);
    }
    const auto bound = number<elliptude_number>(rate_bound);
    elliptude_rate rate{{0, 0, 0}, {bound, bound, bound}};
    write(moment.rate, rate.value);
    const bool with_rate = InC::kind == Kind::body && moment.has_rate;
    const elliptude_measurements measured{directions.data(), directions.size(), with_rate ? &rate : nullptr, nullptr};
    elliptude_report report;
    const elliptude_status status = InC::update(&filter_, &measured, &report);
    keep(report);
    return {status, report.margin < 0 || report.dropped != 0, report.fusions, report.iterations};
  }
  void forget() override {
    if (InC::forget(&filter_) == ELLIPTUDE_OK) {
      report_.claim = ELLIPTUDE_NO_CLAIM;
    }
  }
  [[nodiscard]] Belief belief() const override {
    elliptude_set set{};
    Belief belief;
    belief.knows = InC::set(&filter_, &set) == ELLIPTUDE_OK;
    belief.unconditional = belief.knows && set.claim == ELLIPTUDE_UNCONDITIONAL;
    belief.time = static_cast<double>(report_.time);
    for (int i = 0; i < 3; ++i) {
      belief.vector(i) = static_cast<double>(set.vector[i]);
    }
    for (int i = 0; i < 9; ++i) {
      belief.attitude(i / 3, i % 3) = static_cast<double>(set.attitude[i]);
    }
    for (int i = 0; i < 36; ++i) {
      belief.shape(i / 6, i % 6) = static_cast<double>(set.shape[i]);
    }
    return belief;
  }
  [[nodiscard]] int check() const override { return InC::check(&filter_); }
  [[nodiscard]] unsigned char* bytes() override { return reinterpret_cast<unsigned char*>(&filter_); }
  [[nodiscard]] std::size_t size() const override { return sizeof filter_; }

 private:
  static void write(const Vector3d& from, elliptude_number* to) {
    for (int i = 0; i < 3; ++i) {
      to[i] = number<elliptude_number>(from(i));
    }
  }
  /// The report of a filter that cannot be read has no time.
  void keep(const elliptude_report& report) {
    if (report.status != ELLIPTUDE_CORRUPTED && report.status != ELLIPTUDE_NOT_INITIALIZED) {
      report_ = report;
    }
  }

  elliptude_settings settings_;
  typename InC::Filter filter_;
  elliptude_report report_{};
};

}  // namespace elliptude::faults
