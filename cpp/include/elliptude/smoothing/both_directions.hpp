#pragma once

/// \file
/// What is known at one moment from its past and from its future: two sets with what they rest on, and the set that answers for both.
/// (theory, section 20.4)

#include "elliptude/guaranteed/policy.hpp"
#include "elliptude/smoothing/common_set.hpp"

namespace elliptude {

/// A set, and what it rests on; `Claim::none` if there is none, and the set is then meaningless.
template <typename State>
struct ClaimedSet {
  GibbsEllipsoid<State> set;
  Claim claim = Claim::none;
};

/// What both directions of time leave possible at one moment.
template <typename State>
struct BothDirections {
  /// The smoothed set: where the claim is that of the past's, no wider by the criterion, in its largest angle, and in the vector.
  ClaimedSet<State> smoothed;
  /// The smallest by the criterion, which may be wider in one of the others: what a pass backward goes on with.
  ClaimedSet<State> smallest;
  bool uses_future = false;  ///< whether the smoothed set is another than the past's
  /// Whether both hold on the stated bounds alone, and have nothing in common: a statement is wrong. Both sets are then the past's.
  bool contradict = false;
};

namespace detail {

/// Whether a set reaches no farther than another, in attitude and in the vector.
template <typename State>
[[nodiscard]] bool is_no_wider(const GibbsEllipsoid<State>& one, const GibbsEllipsoid<State>& other) noexcept {
  using Scalar = StateScalar<State>;
  for (const int first : {0, 3}) {
    SymmetricEigen<Scalar, 3> of_one;
    SymmetricEigen<Scalar, 3> of_other;
    if (symmetric_eigen(Matrix3<Scalar>(one.shape.template block<3, 3>(first, first)), of_one) != Status::ok ||
        symmetric_eigen(Matrix3<Scalar>(other.shape.template block<3, 3>(first, first)), of_other) != Status::ok ||
        !(of_one.values(0) <= of_other.values(0))) {
      return false;
    }
  }
  return true;
}

}  // namespace detail

/// Combines two sets that hold the state of one moment. Of equal claims it is the set about both; of unequal ones the stronger alone,
/// which may be wider; of one set that one.
/// \param past, future in the same direction of time: a set of a mirrored flow has to be `mirrored` back.
/// \return the status of `common_set`, but for `empty_intersection`.
template <typename State>
[[nodiscard]] Status both_directions(const ClaimedSet<State>& past, const ClaimedSet<State>& future,
                                     const CommonSetSettings<StateScalar<State>>& settings,
                                     BothDirections<State>& result) noexcept {
  BothDirections<State> found;
  found.smoothed = past;
  found.smallest = past;
  if (future.claim < past.claim) {
    found.smoothed = future;
    found.smallest = future;
    found.uses_future = true;
  } else if (future.claim == past.claim && past.claim != Claim::none) {
    GibbsEllipsoid<State> common;
    const Status status = common_set(past.set, future.set, settings, common);
    if (status == Status::empty_intersection) {
      found.contradict = past.claim == Claim::unconditional;
    } else if (status != Status::ok) {
      return status;
    } else {
      found.smallest.set = common;
      if (common.shape != past.set.shape && detail::is_no_wider(common, past.set)) {
        found.smoothed.set = common;
        found.uses_future = true;
      }
    }
  }
  result = found;
  return Status::ok;
}

}  // namespace elliptude
