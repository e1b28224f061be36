#pragma once

/// \file
/// Predictions of flows of packs, lane by lane where all is as usual, for durations that are not zero; see
/// lanewise_sets.hpp.

#include "elliptude/first_order/detail/lanewise_sets.hpp"
#include "elliptude/first_order/flow.hpp"

namespace elliptude::detail::lanewise {

/// Over how many steps a flow divides a duration. \return `too_many_steps`.
template <typename Scalar, typename Potential>
[[nodiscard]] Status count_steps(const RigidBodyFlow<Scalar, Potential>& flow, const Scalar& duration,
                                 long& steps) noexcept {
  return flow.count_steps(duration, steps);
}
template <typename Scalar>
[[nodiscard]] Status count_steps(const GyroFlow<Scalar>& /*flow*/, const Scalar& /*duration*/, long& steps) noexcept {
  steps = 1;
  return Status::ok;
}

/// T P Tᵀ. \return where rounding leaves it definite: `transformed_shape` is the same there.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> transformed(const Matrix6<Scalar>& transform, const Matrix6<Scalar>& shape,
                                        Matrix6<Scalar>& result) noexcept {
  Matrix6<Scalar> factor;
  result = symmetric_congruence(transform, shape);
  return lanewise::cholesky(result, factor);
}

/// The prediction of `RigidBodyFlow` in so many steps.
/// \param status `ok`, or that of a step, which is one of all lanes: then there is no prediction.
/// \return in which lanes it is that of each filter alone.
template <typename Scalar, typename Potential>
[[nodiscard]] Truth<Scalar> predict(const RigidBodyFlow<Scalar, Potential>& flow, const Scalar& time,
                                    const Scalar& duration, long steps,
                                    const typename RigidBodyFlow<Scalar, Potential>::Input& input,
                                    const StateEllipsoid<RigidBodyState<Scalar>>& ellipsoid,
                                    const SizeCriterion<Scalar, 6>& criterion,
                                    Prediction<RigidBodyState<Scalar>>& prediction, Status& status) noexcept {
  using Value = scalar::Value<Scalar>;
  const Scalar h = duration / Scalar(static_cast<Value>(steps));
  FlowLinearization<Scalar> linearization;
  if (scalar::all(flow.unknown_torque().cwiseAbs().sum() == Scalar(0))) {
    status =
        integrate_linearized(flow.body(), flow.potential(), flow.composition(), time, h, steps, input.control_torque,
                             ellipsoid.center, prediction.ellipsoid.center, linearization, flow.interruption());
    prediction.transition = linearization.state;
    return transformed(linearization.state, ellipsoid.shape, prediction.ellipsoid.shape);
  }
  Truth<Scalar> usual = everywhere<Scalar>();
  status = Status::ok;
  prediction = {ellipsoid, Matrix6<Scalar>::Identity()};
  for (long step = 0; step < steps; ++step) {
    if (flow.interruption().after(step)) {
      status = Status::interrupted;
      return usual;
    }
    const RigidBodyState<Scalar> before = prediction.ellipsoid.center;
    status = integrate_linearized(flow.body(), flow.potential(), flow.composition(),
                                  Scalar(time + Scalar(static_cast<Value>(step)) * h), h, 1L, input.control_torque,
                                  before, prediction.ellipsoid.center, linearization);
    if (status != Status::ok) {
      return usual;
    }
    std::array<Matrix6<Scalar>, 2> terms;
    usual = usual && transformed(linearization.state, prediction.ellipsoid.shape, terms[0]);
    terms[1] = congruence(linearization.control, flow.unknown_torque());
    usual = usual && lanewise::minimal_sum<2>(terms.data(), terms.size(), criterion, prediction.ellipsoid.shape);
    prediction.transition = linearization.state.lazyProduct(prediction.transition).eval();
  }
  return usual;
}

/// The same of `GyroFlow` (theory, section 12), which has no steps.
template <typename Scalar>
[[nodiscard]] Truth<Scalar> predict(const GyroFlow<Scalar>& flow, const Scalar& /*time*/, const Scalar& duration,
                                    long /*steps*/, const typename GyroFlow<Scalar>::Input& input,
                                    const StateEllipsoid<GyroState<Scalar>>& ellipsoid,
                                    const SizeCriterion<Scalar, 6>& criterion,
                                    Prediction<GyroState<Scalar>>& prediction, Status& status) noexcept {
  status = Status::ok;
  const GyroMotion<Scalar> motion = flow.motion(duration, input, ellipsoid.center);
  prediction.ellipsoid.center = motion.center;
  prediction.transition = motion.transition;
  std::array<Matrix6<Scalar>, 3> terms{Matrix6<Scalar>::Zero(), motion.noise, motion.drift};
  const Truth<Scalar> usual =
      finite(input.angular_velocity) && transformed(motion.transition, ellipsoid.shape, terms[0]);
  return usual && lanewise::minimal_sum<3>(terms.data(), terms.size(), criterion, prediction.ellipsoid.shape);
}

}  // namespace elliptude::detail::lanewise
