#pragma once

/// \file
/// What a guaranteed filter does about measurements that contradict its set, and what an update reports.

#include <cstdint>

#include "elliptude/measurement/sensors.hpp"

namespace elliptude {

/// What to do with measurements that no predicted state can have caused: some bound is then wrong.
enum class Policy : std::uint8_t {
  raise,             ///< report `empty_intersection`, and leave the filter as it was
  drop_measurement,  ///< leave out as few measurements as make the rest agree with the prediction
  restart,           ///< forget the prediction, and start again from the measurements
  relaxed,           ///< let up to k of the measurements of an update be wrong, whether that shows or not
};

// What a filter's policy is, is known when it is compiled if ELLIPTUDE_ONLY_POLICY names one (`raise`, say), the same in
// all files of a program: what only others need is then not compiled, and they are refused with `out_of_range`.
#ifdef ELLIPTUDE_ONLY_POLICY
inline constexpr Policy default_policy = Policy::ELLIPTUDE_ONLY_POLICY;
[[nodiscard]] constexpr bool is_policy(Policy /*chosen*/, Policy which) noexcept { return which == default_policy; }
[[nodiscard]] constexpr bool is_compiled(Policy policy) noexcept { return policy == default_policy; }
#else
inline constexpr Policy default_policy = Policy::raise;
/// Whether the policy that a filter was told is this one.
[[nodiscard]] constexpr bool is_policy(Policy chosen, Policy which) noexcept { return chosen == which; }
/// Whether a filter can have this policy.
[[nodiscard]] constexpr bool is_compiled(Policy policy) noexcept { return policy <= Policy::relaxed; }
#endif
/// Whether some policy that is compiled leaves measurements out.
inline constexpr bool may_drop =
    is_compiled(Policy::drop_measurement) || is_compiled(Policy::restart) || is_compiled(Policy::relaxed);

/// What the guarantee of a set rests on. A stronger claim is the larger, and memory that is all zero claims nothing.
enum class Claim : std::uint8_t {
  none,           ///< no set: the attitude is not known
  conditional,    ///< on the stated bounds, and on the dropped measurements having been the wrong ones
  unconditional,  ///< on the stated bounds of everything that the filter used
};

/// What a guaranteed filter that has no set lacks.
enum class Lacks : std::uint8_t {
  nothing,   ///< there is a set
  attitude,  ///< two directions that are not parallel, or an attitude, in one update
  /// Any bound of the angular velocity or the gyro's bias, of which directions and attitudes say nothing: a measured
  /// angular velocity, `bound_vector`, or a start.
  vector,
};

/// The report of a guaranteed update.
template <typename Scalar>
struct GuaranteedUpdate {
  Claim claim = Claim::none;
  bool prediction_used = false;  ///< whether the prediction made the set smaller than the measurements alone
  Sensors dropped = 0;           ///< which measurements were left out, or are proved wrong
  /// How far the constraints are from having no common point; negative if they had none (`QuadricFusion::margin`), −1
  /// if that cannot be measured, as for an angular velocity beyond the `FilterDomain`.
  Scalar margin = Scalar(1);
  Sensors contradicting = 0;  ///< if the margin is negative: the measurement that weighs most against the rest
  /// How many choices of measurements were tried: all of them, and others after a contradiction or where some may be
  /// wrong.
  int fusions = 0;
  int steps = 0;  ///< of the searches for all these
  /// Whether one of these searches ended because it had taken as many steps as it may: the set holds, and may be larger
  /// than it need be.
  bool ended_by_limit = false;
};

}  // namespace elliptude
