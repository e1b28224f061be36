#pragma once

/// \file
/// Many bodies that move alike, `Width` at a time in SIMD registers: the integrator and its linearization, with the
/// results that each body would have alone.

#include <algorithm>
#include <cstddef>

#include "elliptude/dynamics/linearization.hpp"
#include "elliptude/ensemble/pack.hpp"

namespace elliptude {

/// A body of an ensemble: where it begins and what acts on it; then where it ended.
template <typename Number>
struct EnsembleMember {
  RigidBodyState<Number> state;
  Number time;                     ///< s, at the start
  Vector3<Number> control_torque;  ///< N m, body axes, constant
};

/// What became of an ensemble: `ok`, or the status of the first member that failed.
struct EnsembleStatus {
  Status status;
  std::size_t member;
};

/// Bodies with the same inertia, potential and step. For `Potential`, any template of the library's that has `cast`.
template <typename Number, int Width, template <typename> class Potential>
class Ensemble {
 public:
  /// \param step h in s.
  Ensemble(const RigidBody<Number>& body, const Potential<Number>& potential, const Composition<Number>& composition,
           const Number& step) noexcept
      : body_(body),
        potential_(potential),
        composition_(composition),
        step_(step),
        packed_body_(body.template cast<Scalar>()),
        packed_potential_(potential.template cast<Scalar>()) {
    packed_composition_.stages = composition.stages;
    std::copy(composition.weights.begin(), composition.weights.end(), packed_composition_.weights.begin());
  }

  /// `integrate` for each of `count` members. Those before the first that fails have moved; it has not.
  [[nodiscard]] EnsembleStatus integrate(long steps, EnsembleMember<Number>* members,
                                         std::size_t count) const noexcept {
    return each_group(
        members, count,
        [&](EnsembleMember<Number>* group, std::size_t, std::size_t size) {
          const Lanes lanes(group, size);
          RigidBodyState<Scalar> next;
          const Status status = elliptude::integrate(packed_body_, packed_potential_, packed_composition_, lanes.time,
                                                     Scalar(step_), steps, lanes.control_torque, lanes.state, next,
                                                     [](long, const RigidBodyState<Scalar>&) {});
          if (status == Status::ok) {
            for (std::size_t i = 0; i < size; ++i) {
              group[i].state = {lane(next.attitude, i), lane(next.angular_velocity, i)};
            }
          }
          return status;
        },
        [&](EnsembleMember<Number>& member, std::size_t) {
          return elliptude::integrate(body_, potential_, composition_, member.time, step_, steps, member.control_torque,
                                      member.state, member.state, [](long, const RigidBodyState<Number>&) {});
        });
  }

  /// `integrate_linearized` for each of `count` members.
  /// \param linearizations as many; of those before the first member that fails.
  /// \return also `interrupted`.
  [[nodiscard]] EnsembleStatus integrate_linearized(long steps, EnsembleMember<Number>* members, std::size_t count,
                                                    FlowLinearization<Number>* linearizations,
                                                    const Interruption& interruption = Interruption()) const noexcept {
    return each_group(
        members, count,
        [&](EnsembleMember<Number>* group, std::size_t begin, std::size_t size) {
          const Lanes lanes(group, size);
          RigidBodyState<Scalar> next;
          FlowLinearization<Scalar> linearization;
          const Status status = elliptude::integrate_linearized(packed_body_, packed_potential_, packed_composition_,
                                                                lanes.time, Scalar(step_), steps, lanes.control_torque,
                                                                lanes.state, next, linearization, interruption);
          if (status == Status::ok) {
            for (std::size_t i = 0; i < size; ++i) {
              group[i].state = {lane(next.attitude, i), lane(next.angular_velocity, i)};
              linearizations[begin + i] = {lane(linearization.state, i), lane(linearization.control, i)};
            }
          }
          return status;
        },
        [&](EnsembleMember<Number>& member, std::size_t index) {
          return elliptude::integrate_linearized(body_, potential_, composition_, member.time, step_, steps,
                                                 member.control_torque, member.state, member.state,
                                                 linearizations[index], interruption);
        });
  }

 private:
  using Scalar = Pack<Number, Width>;

  /// Members side by side; the last one again where they are fewer than lanes.
  struct Lanes {
    RigidBodyState<Scalar> state;
    Scalar time;
    Vector3<Scalar> control_torque;

    Lanes(const EnsembleMember<Number>* members, std::size_t size) noexcept {
      for (std::size_t i = 0; i < std::size_t{Width}; ++i) {
        const EnsembleMember<Number>& member = members[std::min(i, size - 1)];
        set_lane(state.attitude, i, member.state.attitude);
        set_lane(state.angular_velocity, i, member.state.angular_velocity);
        time.set(i, member.time);
        set_lane(control_torque, i, member.control_torque);
      }
    }
  };

  /// A pack fails if one of its members does: then each goes alone.
  template <typename Together, typename Alone>
  [[nodiscard]] static EnsembleStatus each_group(EnsembleMember<Number>* members, std::size_t count,
                                                 const Together& together, const Alone& alone) noexcept {
    for (std::size_t begin = 0; begin < count; begin += std::size_t{Width}) {
      const std::size_t size = std::min(std::size_t{Width}, count - begin);
      const Status all = together(members + begin, begin, size);
      if (all == Status::ok) {
        continue;
      }
      if (all == Status::interrupted) {
        return {all, begin};
      }
      for (std::size_t i = begin; i < begin + size; ++i) {
        if (const Status status = alone(members[i], i); status != Status::ok) {
          return {status, i};
        }
      }
    }
    return {Status::ok, count};
  }

  RigidBody<Number> body_;
  Potential<Number> potential_;
  Composition<Number> composition_;
  Number step_;
  RigidBody<Scalar> packed_body_;
  Potential<Scalar> packed_potential_;
  Composition<Scalar> packed_composition_{};
};

}  // namespace elliptude
