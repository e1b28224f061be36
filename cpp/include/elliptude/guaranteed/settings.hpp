#pragma once

/// \file
/// What a guaranteed filter is told about how it is to work. (theory, sections 16.7, 16.8, 16.11)

#include "elliptude/guaranteed/policy.hpp"
#include "elliptude/sets/ellipsoid.hpp"

namespace elliptude {

/// Settings of a `GuaranteedFilter`.
template <typename Scalar>
struct GuaranteedSettings {
  SizeCriterion<Scalar, 6> criterion = SizeCriterion<Scalar, 6>::volume();
  Policy policy = default_policy;
  /// For `Policy::relaxed`: how many of at most eight measurements may be wrong, 0 to `ELLIPTUDE_MOST_WRONG`, which is 2.
  int most_wrong = 0;
  /// A conditional claim ends after this many updates in a row without contradiction: the set is then taken from the
  /// measurements of that moment alone, if they bound one. If contradictions go on, the past is given up for such a set
  /// this many updates after the first one; the claim stays conditional until as many have agreed.
  /// (theory, section 16.8)
  int regain_after = 10;
  /// Whether the gyro's bias is part of what is estimated. If it is not, it is in the ellipsoid of `bound_vector`,
  /// which is all that is ever known of it, and the attitude is predicted and fused by itself: its sets are smaller, as
  /// no part of a sum has to bound the bias. The shape is then of two sets, one of the attitude and the bound of the
  /// bias, with zeros between, and the state is in their product. `ELLIPTUDE_ONLY_WHOLE_STATES` leaves that out.
  /// (theory, section 16.7)
  bool estimates_vector = true;
  /// Whether what an update has used is kept beside the set until the next prediction, so that `bounds` says as much as
  /// all of it does, and not only as much as the set does.
  bool keeps_constraints = false;
};

}  // namespace elliptude
