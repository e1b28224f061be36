#pragma once

/// \file
/// The Lie group variational integrator of a rigid body in a potential (paper, eqs. findf0, updateR0, updatew0), and
/// symmetric compositions of it of order 4, 6 and 8. It keeps the attitude a rotation and the momentum map of a
/// symmetric potential to rounding, and its energy error does not grow.

#include "elliptude/base/rounding.hpp"
#include "elliptude/dynamics/composition.hpp"
#include "elliptude/dynamics/potential.hpp"

namespace elliptude {

/// F, the rotation within one step, from h S(a) = F J_d − J_d Fᵀ (paper, eq. findf0) with a = Jω + (h/2) M. As the
/// Cayley map of c the equation is the quadratic h a + h a × c + h c (cᵀa) − 2Jc = 0 (theory, section 4), solved by
/// Newton's method from c = (h/2) J⁻¹a: no trigonometric function.
/// \param h the step in s; negative within compositions.
/// \return `step_too_long` if there is no solution on the branch of small steps with a turn below a right angle: the
/// matrix of Newton's method, −2J at rest, has then changed the sign of its determinant, or the iteration did not
/// settle.
template <typename Scalar>
[[nodiscard]] Status relative_attitude(const RigidBody<Scalar>& body, const Scalar& h, const Vector3<Scalar>& a,
                                       Matrix3<Scalar>& f) noexcept {
  const Vector3<Scalar> ha = h * a;
  const Matrix3<Scalar>& inertia = body.inertia();  // 2J as a matrix of its own would be written, and waited for
  const auto residual = [&](const Vector3<Scalar>& c, const Scalar& along) {
    return Vector3<Scalar>(ha + ha.cross(c) + along * c - Scalar(2) * (inertia * c));
  };
  const auto times_half_inverse = [&](const Vector3<Scalar>& v) {
    return Vector3<Scalar>(scalar::constant<Scalar>(0.5L) * (body.inertia_inverse() * v));
  };
  // The equation is quadratic in c: a change leaves a residual of at most its square times ‖h a‖.
  const Scalar tolerance = scalar::constant<Scalar>(0.25L) * rounding::one_rounding<Scalar>();
  // Once through the fixed point c = ½ J⁻¹ (h a + h a × c + h c (cᵀa)), which is cheaper than a step of Newton's
  // method.
  Vector3<Scalar> c = times_half_inverse(ha);
  c = times_half_inverse(ha + ha.cross(c) + c.dot(ha) * c);
  constexpr int most_steps = 40;
  [[maybe_unused]] auto had_settled = Scalar(1) < Scalar(0);
  for (int step = 0; step < most_steps; ++step) {
    const Scalar along = c.dot(ha);
    // The columns of S(ha) + c haᵀ + (cᵀha) I − 2J, inverted by Cramer's rule.
    const Vector3<Scalar> n0 = Vector3<Scalar>(along, ha.z(), -ha.y()) + ha.x() * c - Scalar(2) * inertia.col(0);
    const Vector3<Scalar> n1 = Vector3<Scalar>(-ha.z(), along, ha.x()) + ha.y() * c - Scalar(2) * inertia.col(1);
    const Vector3<Scalar> n2 = Vector3<Scalar>(ha.y(), -ha.x(), along) + ha.z() * c - Scalar(2) * inertia.col(2);
    const Vector3<Scalar> cofactor0 = n1.cross(n2);
    const Vector3<Scalar> cofactor1 = n2.cross(n0);
    const Vector3<Scalar> cofactor2 = n0.cross(n1);
    const Scalar determinant = n0.dot(cofactor0);
    if (!scalar::all(determinant < Scalar(0))) {
      return Status::step_too_long;
    }
    const Scalar scale = Scalar(-1) / determinant;
    const auto solve = [&](const Vector3<Scalar>& rest) {
      return Vector3<Scalar>(scale * cofactor0.dot(rest), scale * cofactor1.dot(rest), scale * cofactor2.dot(rest));
    };
    // The inverse serves twice: the second change costs little and leaves the product of both.
    const Vector3<Scalar> first = solve(residual(c, along));
    [[maybe_unused]] const Vector3<Scalar> before = c;
    c += first;
    const Vector3<Scalar> second = solve(residual(c, Scalar(c.dot(ha))));
    c += second;
    auto has_settled = first.squaredNorm() * second.squaredNorm() <= tolerance * tolerance;
    if constexpr (!std::is_same_v<decltype(has_settled), bool>) {
      // A lane that has settled stays as it is: what its neighbours do is nothing to it.
      for (int i = 0; i < 3; ++i) {
        c(i) = scalar::select(had_settled, Scalar(before(i)), Scalar(c(i)));
      }
      has_settled = has_settled || had_settled;
      had_settled = has_settled;
    }
    if (scalar::all(has_settled)) {
      if (!scalar::all(c.squaredNorm() < Scalar(1))) {
        return Status::step_too_long;
      }
      f = cayley(c);
      return Status::ok;
    }
  }
  return Status::step_too_long;
}

/// `relative_attitude` in the paper's own form F = exp(S(f)), where the equation is
/// h a = (sin‖f‖/‖f‖) Jf + ((1−cos‖f‖)/‖f‖²) f × Jf. Slower; for comparison.
template <typename Scalar>
[[nodiscard]] Status relative_attitude_exponential(const RigidBody<Scalar>& body, const Scalar& h,
                                                   const Vector3<Scalar>& a, Matrix3<Scalar>& f) noexcept {
  const Vector3<Scalar> ha = h * a;
  const Matrix3<Scalar>& inertia = body.inertia();
  const Scalar tolerance = scalar::constant<Scalar>(0.25L) * rounding::one_rounding<Scalar>();
  const Scalar right_angle = scalar::constant<Scalar>(0.5L) * scalar::pi<Scalar>();
  Vector3<Scalar> x = body.inertia_inverse() * ha;
  constexpr int most_steps = 40;
  for (int step = 0; step < most_steps; ++step) {
    const Scalar square = x.squaredNorm();
    const Scalar sine = detail::angle::functions<detail::angle::Want::exponential>(square).sine;
    const detail::angle::Functions<Scalar> functions = detail::angle::functions<detail::angle::Want::jacobian>(square);
    // Derivatives of the two factors are these times xᵀ.
    const Scalar sine_slope = functions.sine_tail - functions.versine;
    const auto tiny = square < Scalar(rotation_tolerance<Scalar>());
    const Scalar versine_slope =
        scalar::select(tiny, Scalar(Scalar(-1) / Scalar(12)),
                       Scalar((sine - Scalar(2) * functions.versine) / scalar::select(tiny, Scalar(1), square)));
    const Vector3<Scalar> jx = inertia * x;
    const Vector3<Scalar> gyroscopic = x.cross(jx);
    const Vector3<Scalar> residual = ha - sine * jx - functions.versine * gyroscopic;
    const Matrix3<Scalar> newton = sine * inertia + functions.versine * (hat(x) * inertia - hat(jx)) +
                                   (sine_slope * jx + versine_slope * gyroscopic) * x.transpose();
    if (!scalar::all(newton.determinant() > Scalar(0))) {
      return Status::step_too_long;
    }
    const Vector3<Scalar> change = newton.inverse() * residual;
    x += change;
    if (scalar::all(change.squaredNorm() <= tolerance)) {
      if (!scalar::all(x.squaredNorm() < right_angle * right_angle)) {
        return Status::step_too_long;
      }
      f = exp(x);
      return Status::ok;
    }
  }
  return Status::step_too_long;
}

/// The lengths of a stage in s.
template <typename Scalar>
struct StageLengths {
  Scalar before;  ///< how long the torque at the start acts then
  Scalar turn;    ///< how long the free body turns
  Scalar after;   ///< how long the torque at the end acts then

  /// Those of stage i of a `Composition` or `Splitting` of a step of length h.
  template <typename Method>
  [[nodiscard]] static StageLengths of(const Method& method, int i, const Scalar& h) noexcept {
    return {method.kick_before(i) * h, method.turn(i) * h, method.kick_after(i) * h};
  }
};

/// One stage of the integrator, with what the next stage and the linearization use again.
template <typename Scalar>
struct Stage {
  Vector3<Scalar> momentum;      ///< a = Jω + (h/2) M, with the length of the kick before the turn in the place of h/2
  Matrix3<Scalar> rotation;      ///< F
  RigidBodyState<Scalar> state;  ///< after the stage
  Vector3<Scalar> torque;        ///< of the potential after the stage
  /// Jω after the stage, body axes. It is carried from stage to stage, and ω follows from it: to ω and back at every
  /// stage would multiply it by J fl(J⁻¹), whose rounding errors are always the same ones and add up.
  Vector3<Scalar> body_momentum;
};

/// The stage before the first one.
/// \return `callback_failed`.
template <typename Scalar, typename Potential>
[[nodiscard]] Status start_stage(const RigidBody<Scalar>& body, const Potential& potential, const Scalar& time,
                                 const RigidBodyState<Scalar>& state, Stage<Scalar>& stage) noexcept {
  stage.state = state;
  stage.torque = potential.torque(state.attitude, time);
  stage.body_momentum = body.inertia() * state.angular_velocity;
  return scalar::all_finite(stage.torque) ? Status::ok : Status::callback_failed;
}

/// Eqs. findf0, updateR0, updatew0 over one stage from time t. The control torque (body axes, constant over the step)
/// acts beside the potential's.
/// \param free_turn finds the F of the body without torque, as `relative_attitude(body, h, a, f)` does.
/// \param stage what the stage before left, and then this one; of no use after a failure.
/// \return `step_too_long`, `callback_failed`.
template <typename Scalar, typename Potential, typename FreeTurn>
[[nodiscard]] Status integrate_stage(const RigidBody<Scalar>& body, const Potential& potential, const Scalar& time,
                                     const StageLengths<Scalar>& lengths, const Vector3<Scalar>& control_torque,
                                     const FreeTurn& free_turn, Stage<Scalar>& stage) noexcept {
  static_assert(is_potential<Potential, Scalar>, "see dynamics/potential.hpp for what a potential is");
  stage.momentum = stage.body_momentum + lengths.before * (stage.torque + control_torque);
  if (const Status status = free_turn(lengths.turn, stage.momentum, stage.rotation); status != Status::ok) {
    return status;
  }
  // Written column by column, as it is read: a processor waits where it reads in other pieces what was just written.
  std::array<Vector3<Scalar>, 3> columns;
  for (int j = 0; j < 3; ++j) {
    columns[static_cast<std::size_t>(j)] = stage.state.attitude.lazyProduct(stage.rotation.col(j));
  }
  for (int j = 0; j < 3; ++j) {
    stage.state.attitude.col(j) = columns[static_cast<std::size_t>(j)];
  }
  stage.torque = potential.torque(stage.state.attitude, Scalar(time + lengths.turn));
  if (!scalar::all_finite(stage.torque)) {
    return Status::callback_failed;
  }
  stage.body_momentum = stage.rotation.transpose() * stage.momentum + lengths.after * (stage.torque + control_torque);
  stage.state.angular_velocity.noalias() = body.inertia_inverse() * stage.body_momentum;
  return Status::ok;
}

/// Checks the start of a step.
/// \return `not_finite`, `not_a_rotation`; `out_of_range` of a step that is not positive.
template <typename Scalar>
[[nodiscard]] Status validate_step(const Scalar& time, const Scalar& h, const Vector3<Scalar>& control_torque,
                                   const RigidBodyState<Scalar>& state) noexcept {
  if (!scalar::isfinite(time) || !scalar::isfinite(h) || !scalar::all_finite(control_torque) ||
      !scalar::all_finite(state.attitude) || !scalar::all_finite(state.angular_velocity)) {
    return Status::not_finite;
  }
  if (!scalar::all(h > Scalar(0))) {
    return Status::out_of_range;
  }
  return is_rotation(state.attitude, rotation_tolerance<Scalar>()) ? Status::ok : Status::not_a_rotation;
}

/// As `integrate`, with all that is known after a step.
/// \param visit called as visit(k, stage) for k = 0, the start, and after step k = 1 … `steps`, with the step's last
/// stage.
template <typename Body, typename Method, typename Scalar, typename Potential, typename Visit>
[[nodiscard]] Status integrate_stages(const Body& body, const Potential& potential, const Method& method,
                                      const Scalar& time, const Scalar& h, long steps,
                                      const Vector3<Scalar>& control_torque, const RigidBodyState<Scalar>& state,
                                      Stage<Scalar>& stage, const Visit& visit) noexcept {
  static_assert(!Method::needs_exact_rotor || Body::is_exact, "a Splitting has its order with an ExactRotor only");
  const auto free_turn = [&body](const Scalar& length, const Vector3<Scalar>& momentum, Matrix3<Scalar>& f) {
    return relative_attitude(body, length, momentum, f);
  };
  if (const Status status = validate_step(time, h, control_torque, state); status != Status::ok) {
    return status;
  }
  if (steps < 0) {
    return Status::out_of_range;
  }
  if (const Status status = start_stage(body, potential, time, state, stage); status != Status::ok) {
    return status;
  }
  visit(0L, stage);
  for (long step = 0; step < steps; ++step) {
    Scalar stage_time = time + Scalar(static_cast<scalar::Value<Scalar>>(step)) * h;
    for (int i = 0; i < method.stages; ++i) {
      const auto lengths = StageLengths<Scalar>::of(method, i, h);
      if (const Status status =
              integrate_stage<Scalar>(body, potential, stage_time, lengths, control_torque, free_turn, stage);
          status != Status::ok) {
        return status;
      }
      stage_time += lengths.turn;
    }
    visit(step + 1, stage);
  }
  return Status::ok;
}

/// `steps` steps of length h from `time` on, under a constant control torque (N m, body axes). The torque at the end of
/// a step is that at the start of the next, so the potential is evaluated once for each stage.
/// \param body a `RigidBody` for the variational step; an `ExactRotor` for the splitting with the exact free body.
/// \param method a `Composition`; a `Splitting` with an `ExactRotor`.
/// \param visit called as visit(k, state) after step k = 1 … `steps`; pass an empty lambda if only the end matters.
/// \return the status of `validate_step`; `out_of_range` of a negative number of steps; `step_too_long`,
/// `callback_failed`; `next` changes only on success.
template <typename Body, typename Method, typename Scalar, typename Potential, typename Visit>
[[nodiscard]] Status integrate(const Body& body, const Potential& potential, const Method& method, const Scalar& time,
                               const Scalar& h, long steps, const Vector3<Scalar>& control_torque,
                               const RigidBodyState<Scalar>& state, RigidBodyState<Scalar>& next,
                               const Visit& visit) noexcept {
  Stage<Scalar> stage;
  const auto visit_state = [&visit](long k, const Stage<Scalar>& at) {
    if (k > 0) {
      visit(k, at.state);
    }
  };
  const Status status =
      integrate_stages(body, potential, method, time, h, steps, control_torque, state, stage, visit_state);
  if (status == Status::ok) {
    next = stage.state;
  }
  return status;
}

/// One step; see `integrate`.
template <typename Body, typename Method, typename Scalar, typename Potential>
[[nodiscard]] Status integrate_step(const Body& body, const Potential& potential, const Method& method,
                                    const Scalar& time, const Scalar& h, const Vector3<Scalar>& control_torque,
                                    const RigidBodyState<Scalar>& state, RigidBodyState<Scalar>& next) noexcept {
  return integrate(body, potential, method, time, h, 1L, control_torque, state, next,
                   [](long, const RigidBodyState<Scalar>&) {});
}

}  // namespace elliptude
