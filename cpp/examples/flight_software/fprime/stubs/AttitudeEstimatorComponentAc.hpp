#pragma once

/// \file
/// A stub of what F´ makes of AttitudeEstimator.fpp, and of the types that it would include: declarations of the same
/// form, as far as AttitudeEstimator.cpp uses them. Not F´, and no part of a flight build.

#include <array>
#include <cstdint>

using F64 = double;
using I32 = std::int32_t;
using U32 = std::uint32_t;
using FwIndexType = std::int16_t;
using FwOpcodeType = U32;

namespace Fw {

enum class CmdResponse { OK, EXECUTION_ERROR };

class StringBase {
 public:
  virtual ~StringBase() = default;
  [[nodiscard]] virtual const char* toChar() const = 0;
};

class String : public StringBase {
 public:
  explicit String(const char* text) : text_(text) {}
  [[nodiscard]] const char* toChar() const override { return text_; }

 private:
  const char* text_;  // of a literal
};

}  // namespace Fw

namespace Adcs {

using Vector = std::array<F64, 3>;
using Attitude = std::array<F64, 9>;

class Star {
 public:
  Star() = default;
  Star(const Vector& reference, const Vector& body, F64 bound) : reference_(reference), body_(body), bound_(bound) {}
  [[nodiscard]] const Vector& get_reference() const { return reference_; }
  [[nodiscard]] const Vector& get_body() const { return body_; }
  [[nodiscard]] F64 get_bound() const { return bound_; }

 private:
  Vector reference_{};
  Vector body_{};
  F64 bound_ = 0;
};
using Stars = std::array<Star, 4>;

class Sample {
 public:
  Sample(F64 seconds, const Vector& rate, U32 count, const Stars& stars)
      : seconds_(seconds), rate_(rate), count_(count), stars_(stars) {}
  [[nodiscard]] F64 get_seconds() const { return seconds_; }
  [[nodiscard]] const Vector& get_rate() const { return rate_; }
  [[nodiscard]] U32 get_count() const { return count_; }
  [[nodiscard]] const Stars& get_stars() const { return stars_; }

 private:
  F64 seconds_;
  Vector rate_;
  U32 count_;
  Stars stars_;
};

/// Keeps what would be sent.
class AttitudeEstimatorComponentBase {
 public:
  struct Sent {
    bool knows = false;
    Attitude attitude{};
    Vector half_widths{};
    bool conditional = false;
    F64 margin = 0;
    I32 iterations = 0;
    U32 limits_hit = 0;
    int refused = 0;
    U32 left_out = 0;
    int responses = 0;
  };

  explicit AttitudeEstimatorComponentBase(const char* name) : name_(name) {}
  virtual ~AttitudeEstimatorComponentBase() = default;
  AttitudeEstimatorComponentBase(const AttitudeEstimatorComponentBase&) = delete;
  AttitudeEstimatorComponentBase& operator=(const AttitudeEstimatorComponentBase&) = delete;
  [[nodiscard]] const Sent& sent() const { return sent_; }
  [[nodiscard]] const char* name() const { return name_; }

  // What the component's thread would call.
  void take(Sample& sample) { sampleIn_handler(0, sample); }
  void command(FwOpcodeType opCode, U32 cmdSeq) { FORGET_cmdHandler(opCode, cmdSeq); }

 protected:
  virtual void sampleIn_handler(FwIndexType portNum, Sample& sample) = 0;
  virtual void FORGET_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) = 0;

  void tlmWrite_Knows(bool arg) { sent_.knows = arg; }
  void tlmWrite_Attitude(const Attitude& arg) { sent_.attitude = arg; }
  void tlmWrite_HalfWidths(const Vector& arg) { sent_.half_widths = arg; }
  void tlmWrite_Conditional(bool arg) { sent_.conditional = arg; }
  void tlmWrite_Margin(F64 arg) { sent_.margin = arg; }
  void tlmWrite_Iterations(I32 arg) { sent_.iterations = arg; }
  void tlmWrite_LimitsHit(U32 arg) { sent_.limits_hit = arg; }
  void log_WARNING_HI_Refused(const Fw::StringBase& what, const Fw::StringBase& why) {
    sent_.refused += what.toChar() != nullptr && why.toChar() != nullptr ? 1 : 0;
  }
  void log_ACTIVITY_HI_LeftOut(U32 stars) { sent_.left_out = stars; }
  void cmdResponse_out(FwOpcodeType /*opCode*/, U32 /*cmdSeq*/, Fw::CmdResponse response) {
    sent_.responses += response == Fw::CmdResponse::OK ? 1 : 0;
  }

 private:
  const char* name_;
  Sent sent_;
};

}  // namespace Adcs
