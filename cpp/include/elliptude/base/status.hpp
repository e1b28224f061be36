#pragma once

/// \file
/// The status that a fallible function returns. Nothing in the library throws: every fallible function is
/// `[[nodiscard]] Status f(const In&, Out&) noexcept`, and `Out` changes only if the status is `Status::ok`, but for the
/// report of an update: `GuaranteedUpdate` is written whatever the status is, `DirectionUpdate` and the margin of
/// `Update` also after `empty_intersection`.

#include <cstdint>

namespace elliptude {

enum class [[nodiscard]] Status : std::uint8_t {
  ok,
  not_finite,             ///< an input holds NaN or an infinity
  out_of_range,           ///< an input is outside the range that its documentation names
  not_a_rotation,         ///< a 3x3 matrix is not orthogonal with determinant +1
  not_symmetric,          ///< a matrix that must be symmetric is not
  not_positive_definite,  ///< a matrix that must be positive (semi)definite is not
  invalid_inertia,        ///< the principal moments break the triangle inequality: no mass distribution has them
  zero_direction,         ///< a direction has (nearly) no length
  attitude_undetermined,  ///< the directions leave a rotation free, or two attitudes fit them equally
  improper_profile,       ///< the attitude profile matrix L has det L <= 0: the paper's Theorem 1 does not apply
  step_too_long,          ///< the implicit equation of the integrator has no moderate solution at this step
  not_converged,          ///< an iteration with a bounded number of steps ended before its tolerance
  empty_intersection,     ///< the sets have no common point: some bound is wrong
  unbounded,              ///< no ellipsoid bounds the set
  callback_failed,        ///< a user's function reported a failure
  beyond_domain,          ///< a number is too large or too small for this precision (docs/domain.md)
  too_many_steps,         ///< the interval takes more steps than the flow's limit
  interrupted,            ///< the caller's interruption hook said to stop
  corrupted,              ///< memory was changed since the last call (`Sealed`)
};

/// One line for a log or an exception; never null.
[[nodiscard]] constexpr const char* message(Status status) noexcept {
  switch (status) {
    case Status::ok:
      return "ok";
    case Status::not_finite:
      return "an input holds NaN or an infinity";
    case Status::out_of_range:
      return "an input is outside its documented range";
    case Status::not_a_rotation:
      return "the matrix is not a rotation (orthogonal with determinant +1)";
    case Status::not_symmetric:
      return "the matrix is not symmetric";
    case Status::not_positive_definite:
      return "the matrix is not positive definite";
    case Status::invalid_inertia:
      return "the principal moments of inertia break the triangle inequality";
    case Status::zero_direction:
      return "a direction has no length";
    case Status::attitude_undetermined:
      return "the directions do not determine the attitude: they are collinear, or contradict each other";
    case Status::improper_profile:
      return "the attitude profile matrix L does not have a positive determinant";
    case Status::step_too_long:
      return "the step is too long for the integrator: shorten it";
    case Status::not_converged:
      return "an iteration did not reach its tolerance";
    case Status::empty_intersection:
      return "the sets have no common point: some bound is wrong";
    case Status::unbounded:
      return "the set is not bounded";
    case Status::callback_failed:
      return "a function given by the user failed";
    case Status::beyond_domain:
      return "a number is too large or too small for what this precision can bound";
    case Status::too_many_steps:
      return "the interval takes more steps than the flow's limit: lengthen the step, or raise most_steps";
    case Status::interrupted:
      return "stopped by the caller before the end";
    case Status::corrupted:
      return "the memory was changed since the last call: take a copy that was kept, or start again";
  }
  return "unknown status";
}

}  // namespace elliptude
