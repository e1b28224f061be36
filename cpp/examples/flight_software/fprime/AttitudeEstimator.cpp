#include "AttitudeEstimator.hpp"

#include <algorithm>
#include <cmath>

namespace Adcs {

AttitudeEstimator::AttitudeEstimator(const char* compName) : AttitudeEstimatorComponentBase(compName) {}

bool AttitudeEstimator::configure(F64 seconds) {
  elliptude_gyro_parameters parameters;
  (void)elliptude_gyro_defaults(&parameters);
  parameters.settings.policy = ELLIPTUDE_DROP_MEASUREMENT;
  std::fill_n(parameters.noise, 3, 1e-3);       // rad/s
  std::fill_n(parameters.bias_bound, 3, 1e-3);  // rad/s
  parameters.angular_acceleration = 0.01;       // rad/s²
  parameters.longest_interval = 1.0;            // s: after a longer gap the rate says nothing
  parameters.largest_rate = 0.2;                // rad/s
  const elliptude_status status = elliptude_gyro_init(&m_filter, sizeof m_filter, &parameters, seconds);
  if (status != ELLIPTUDE_OK) {
    this->log_WARNING_HI_Refused(Fw::String("configure"), Fw::String(elliptude_message(status)));
  }
  return status == ELLIPTUDE_OK;
}

void AttitudeEstimator::sampleIn_handler(FwIndexType /*portNum*/, Sample& sample) {
  std::array<elliptude_direction, std::tuple_size<Stars>::value> directions{};
  const std::size_t count = sample.get_count();
  if (count > directions.size()) {
    this->log_WARNING_HI_Refused(Fw::String("sample"), Fw::String("more stars than a sample has room for"));
    return;
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Star& star = sample.get_stars()[i];
    std::copy_n(star.get_reference().begin(), 3, directions[i].reference);
    std::copy_n(star.get_body().begin(), 3, directions[i].body);
    directions[i].bound = star.get_bound();
  }
  elliptude_measurements measured{};
  measured.directions = directions.data();
  measured.direction_count = count;
  elliptude_report report;
  if (m_forgotten) {
    m_forgotten = !this->configure(sample.get_seconds());
  }
  (void)elliptude_gyro_predict(&m_filter, sample.get_seconds(), m_hasRate ? m_rate.data() : nullptr, &report);
  if (report.status == ELLIPTUDE_CORRUPTED) {  // memory was changed by something else: the next sample starts anew
    m_forgotten = true;
    m_hasRate = false;
  }
  if (this->note("predict", report)) {
    m_rate = sample.get_rate();
    m_hasRate = std::all_of(m_rate.begin(), m_rate.end(), [](F64 one) { return std::isfinite(one); });
    (void)elliptude_gyro_update(&m_filter, &measured, &report);
    (void)this->note("update", report);
  }
  this->writeSet();
}

void AttitudeEstimator::FORGET_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) {
  // Its time too: one sample whose clock is ahead would else have all that follow refused. The next sample starts it.
  const elliptude_status status = elliptude_gyro_forget(&m_filter);
  m_forgotten = m_forgotten || status == ELLIPTUDE_OK || status == ELLIPTUDE_CORRUPTED;
  m_hasRate = false;
  this->cmdResponse_out(opCode, cmdSeq, m_forgotten ? Fw::CmdResponse::OK : Fw::CmdResponse::EXECUTION_ERROR);
}

bool AttitudeEstimator::note(const char* what, const elliptude_report& report) {
  this->tlmWrite_Conditional(report.claim == ELLIPTUDE_CONDITIONAL);
  this->tlmWrite_Margin(report.margin);
  this->tlmWrite_Iterations(report.iterations);
  this->tlmWrite_LimitsHit(report.limits_hit);
  if (report.status != ELLIPTUDE_OK) {
    this->log_WARNING_HI_Refused(Fw::String(what), Fw::String(elliptude_message(report.status)));
  } else if (report.dropped != 0) {
    this->log_ACTIVITY_HI_LeftOut(static_cast<U32>(report.dropped));
  }
  return report.status == ELLIPTUDE_OK;
}

void AttitudeEstimator::writeSet() {
  elliptude_set set;
  const bool knows = elliptude_gyro_set(&m_filter, &set) == ELLIPTUDE_OK;
  this->tlmWrite_Knows(knows);
  if (knows) {
    Attitude attitude{};
    std::copy_n(set.attitude, attitude.size(), attitude.begin());
    this->tlmWrite_Attitude(attitude);
    this->tlmWrite_HalfWidths({set.half_widths[0], set.half_widths[1], set.half_widths[2]});
  }
}

}  // namespace Adcs
