#pragma once

/// \file
/// A component in the style of F´ around the guaranteed filter of a gyro. It is compiled here against a stub of what F´
/// makes of AttitudeEstimator.fpp, and has never run under F´.

#include <elliptude.h>

#include <AttitudeEstimatorComponentAc.hpp>

namespace Adcs {

class AttitudeEstimator final : public AttitudeEstimatorComponentBase {
 public:
  explicit AttitudeEstimator(const char* compName);

  /// Starts the filter, which knows nothing, at a time. Called once, before samples come.
  /// \return whether it could be started; an event says why not.
  bool configure(F64 seconds);

 private:
  void sampleIn_handler(FwIndexType portNum, Sample& sample) override;
  void FORGET_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) override;

  /// Says what a call did.
  /// \return whether it did what it was to do.
  bool note(const char* what, const elliptude_report& report);
  void writeSet();

  elliptude_gyro m_filter{};  // zeros are a filter that was not made
  Vector m_rate{};            // of the sample before, which stands for the interval that it begins
  bool m_hasRate{false};      // whether it is a number: else the interval has no rate
  bool m_forgotten{false};    // whether the next sample starts the filter
};

}  // namespace Adcs
