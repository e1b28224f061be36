#pragma once

/// \file
/// What is known at one moment from its past and from its future: two sets with what they rest on, and the set that
/// answers for both. (theory, section 20.4)

#include "elliptude/guaranteed/policy.hpp"
#include "elliptude/smoothing/common_set.hpp"

namespace elliptude {

/// A set, and what it rests on; `Claim::none` if there is none, and the set is then meaningless.
template <typename State>
struct ClaimedSet {
  using Scalar = StateScalar<State>;

  GibbsEllipsoid<State> set{{Matrix3<Scalar>::Identity(), Vector3<Scalar>::Zero()}, Matrix6<Scalar>::Zero()};
  Claim claim = Claim::none;
};

/// What both directions of time leave possible at one moment.
template <typename State>
struct BothDirections {
  /// The smoothed set: where the claim is that of the past's, no larger by the criterion, and no wider in its largest
  /// angle.
  ClaimedSet<State> smoothed;
  /// The vector by itself, on the same claim: of the past's set and `smallest`, by the one that is narrower in it.
  Ellipsoid<StateScalar<State>, 3> vector{Vector3<StateScalar<State>>::Zero(), Matrix3<StateScalar<State>>::Zero()};
  /// The smallest by the criterion, which may be wider in its largest angle: what a pass backward goes on with.
  ClaimedSet<State> smallest;
  bool uses_future = false;  ///< whether the smoothed set is another than the past's
  /// Whether the claims are equal and the sets have nothing in common. Both sets of the result are then the past's.
  bool are_apart = false;
  /// Whether they are apart and hold on the stated bounds alone: a statement is wrong.
  bool contradict = false;
};

namespace detail {

/// Whether the three coordinates from `First` on reach no farther in one shape than in another.
template <int First, typename Scalar>
[[nodiscard]] bool is_no_wider(const Matrix6<Scalar>& one, const Matrix6<Scalar>& other) noexcept {
  SymmetricEigen<Scalar, 3> of_one;
  SymmetricEigen<Scalar, 3> of_other;
  return symmetric_eigen(Matrix3<Scalar>(one.template block<3, 3>(First, First)), of_one) == Status::ok &&
         symmetric_eigen(Matrix3<Scalar>(other.template block<3, 3>(First, First)), of_other) == Status::ok &&
         of_one.values(0) <= of_other.values(0);
}

}  // namespace detail

/// Combines two sets that hold the state of one moment. Of equal claims it is the set about both; of unequal ones the
/// stronger alone, which may be wider; of one set that one.
/// \param past, future in the same direction of time: a set of a mirrored flow has to be `mirrored` back.
/// \return the status of `common_set`, but for `empty_intersection`.
template <typename State>
[[nodiscard]] Status both_directions(const ClaimedSet<State>& past, const ClaimedSet<State>& future,
                                     const CommonSetSettings<StateScalar<State>>& settings,
                                     BothDirections<State>& result) noexcept {
  const auto vector_by = [](const GibbsEllipsoid<State>& set) -> Ellipsoid<StateScalar<State>, 3> {
    return {vector_part(set.center), set.shape.template bottomRightCorner<3, 3>()};
  };
  BothDirections<State> found;
  found.uses_future = future.claim > past.claim;
  found.smoothed = found.uses_future ? future : past;
  found.smallest = found.smoothed;
  found.vector = vector_by(found.smoothed.set);
  if (future.claim == past.claim && past.claim != Claim::none) {
    GibbsEllipsoid<State> common;
    const Status status = common_set(past.set, future.set, settings, common);
    if (status != Status::ok && status != Status::empty_intersection) {
      return status;
    }
    if (status == Status::empty_intersection) {
      found.are_apart = true;
      found.contradict = past.claim == Claim::unconditional;
    } else if (common.shape != past.set.shape) {
      found.smallest.set = common;
      if (detail::is_no_wider<3>(common.shape, past.set.shape)) {
        found.vector = vector_by(common);
      }
      if (detail::is_no_wider<0>(common.shape, past.set.shape)) {
        found.smoothed.set = common;
        found.uses_future = true;
      }
    }
  }
  result = found;
  return Status::ok;
}

}  // namespace elliptude
