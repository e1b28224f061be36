"""Lie group variational integrator (paper, section 2.3.1; theory 4).

Each step solves h S(a) = F J_d - J_d F' for the relative attitude F, with
a = J omega_k + (h/2) M_k. Three independent solvers are given; all stop when a Newton
correction no longer matters, and raise ``StepTooLong`` when there is no solution.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from . import so3
from .rigid_body import RigidBody, State, nonstandard_inertia
from .so3 import Array

RelativeAttitude = Callable[[Array, Array, float], Array]

NO_TORQUE = (0.0, 0.0, 0.0)
NEWTON_STEPS = 50
NEGLIGIBLE_CORRECTION = 1e-12  # Newton squares it: the iterate after it is exact


class StepTooLong(ValueError):
    """The body turns too far within one step: findf0 has no solution."""


def relative_attitude_exponential(inertia: Array, a: Array, h: float) -> Array:
    """F = exp(S(f)) with findf0 written in f (paper, below updatew0; theory 4):

    h a = (sin t / t) J f + ((1 - cos t) / t^2) f cross J f with t = |f|. As
    F exp(S(eta)) changes the right side by F (tr(J_d F) I - J_d F) eta, and eta is
    J_r(f) times the change of f, Newton's matrix is (tr(F J_d) I - F J_d) J_l(f).
    """
    f = h * np.linalg.solve(inertia, a)
    for _ in range(NEWTON_STEPS):
        angle = float(np.linalg.norm(f))
        inertia_f = inertia @ f
        residual = (
            np.sinc(angle / np.pi) * inertia_f
            + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * np.cross(f, inertia_f)
            - h * a
        )
        slope = variation_matrix(inertia, so3.exp(f)) @ so3.left_jacobian(f)
        correction = np.linalg.solve(slope, residual)
        f = f - correction
        if np.linalg.norm(correction) < NEGLIGIBLE_CORRECTION:
            return so3.exp(f)
    raise StepTooLong(f"no relative attitude for h a = {h * a}")


def relative_attitude_cayley(inertia: Array, a: Array, h: float) -> Array:
    """F = cayley(c), where findf0 is quadratic (theory 4):

    h a + h a cross c + h c (c'a) - 2 J c = 0.
    """
    c = 0.5 * h * np.linalg.solve(inertia, a)
    for _ in range(NEWTON_STEPS):
        residual = h * (a + np.cross(a, c) + c * (c @ a)) - 2.0 * inertia @ c
        slope = h * (so3.hat(a) + (c @ a) * np.eye(3) + np.outer(c, a)) - 2.0 * inertia
        correction = np.linalg.solve(slope, residual)
        c = c - correction
        if np.linalg.norm(correction) < NEGLIGIBLE_CORRECTION:
            return so3.cayley(c)
    raise StepTooLong(f"no relative attitude for h a = {h * a}")


def relative_attitude_matrix(inertia: Array, a: Array, h: float) -> Array:
    """findf0 as printed, by Newton's method on the group: F <- exp(S(eta)) F."""
    j_d = nonstandard_inertia(inertia)
    relative = so3.exp(h * np.linalg.solve(inertia, a))
    for _ in range(NEWTON_STEPS):
        residual = so3.vee(relative @ j_d - j_d @ relative.T) - h * a
        correction = np.linalg.solve(variation_matrix(inertia, relative), residual)
        relative = so3.exp(-correction) @ relative
        if np.linalg.norm(correction) < NEGLIGIBLE_CORRECTION:
            return so3.nearest_rotation(relative)
    raise StepTooLong(f"no relative attitude for h a = {h * a}")


def variation_matrix(inertia: Array, relative: Array) -> Array:
    """tr(F J_d) I - F J_d: the change of h a when F becomes exp(S(eta)) F, per eta."""
    product = relative @ nonstandard_inertia(inertia)
    return float(np.trace(product)) * np.eye(3) - product


def half_kicked_momentum(body: RigidBody, state: State, h: float, control: ArrayLike = NO_TORQUE) -> Array:
    """a = J omega_k + (h/2) (M_k + u): the left side of findf0 over h."""
    torque = body.potential.torque(state.attitude, state.time) + np.asarray(control)
    return np.asarray(body.inertia @ state.angular_velocity + 0.5 * h * torque)


def variational_step(
    body: RigidBody,
    state: State,
    h: float,
    control: ArrayLike = NO_TORQUE,
    relative_attitude: RelativeAttitude = relative_attitude_cayley,
) -> State:
    """One step of second order: findf0, updateR0, updatew0.

    ``control`` is a torque in body axes, constant over the step, added to both
    moments.
    """
    a = half_kicked_momentum(body, state, h, control)
    relative = relative_attitude(body.inertia, a, h)
    attitude = state.attitude @ relative
    time = state.time + h
    torque = body.potential.torque(attitude, time) + np.asarray(control)
    momentum = relative.T @ a + 0.5 * h * torque
    return State(attitude, np.linalg.solve(body.inertia, momentum), time)


def composition_stages(order: int) -> tuple[float, ...]:
    """The stages, as fractions of the step, of a symmetric composition (theory 4).

    Order 4 is Suzuki's (1990) five stages; orders 6 and 8 are Kahan and Li's (1997)
    nine and seventeen stages, s9odr6a and s17odr8a.
    """
    if order == 4:
        suzuki = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
        return (suzuki, suzuki, 1.0 - 4.0 * suzuki, suzuki, suzuki)
    to_the_middle = {
        2: (1.0,),
        6: (
            0.39216144400731413927925056,
            0.33259913678935943859974864,
            -0.70624617255763935980996482,
            0.08221359629355080023149045,
            0.79854399093482996339895035,
        ),
        8: (
            0.13020248308889008087881763,
            0.56116298177510838456196441,
            -0.38947496264484728640807860,
            0.15884190655515560089621075,
            -0.39590389413323757733623154,
            0.18453964097831570709183254,
            0.25837438768632204729397911,
            0.29501172360931029887096624,
            -0.60550853383003451169892108,
        ),
    }[order]
    return to_the_middle + to_the_middle[-2::-1]


def step(
    body: RigidBody,
    state: State,
    h: float,
    order: int = 2,
    control: ArrayLike = NO_TORQUE,
    relative_attitude: RelativeAttitude = relative_attitude_cayley,
) -> State:
    """One step of the given order; the time advances with each stage (theory 4)."""
    for fraction in composition_stages(order):
        state = variational_step(body, state, fraction * h, control, relative_attitude)
    return state


def integrate(
    body: RigidBody,
    state: State,
    h: float,
    steps: int,
    order: int = 2,
    control: ArrayLike = NO_TORQUE,
) -> State:
    """Several equal steps."""
    for _ in range(steps):
        state = step(body, state, h, order, control)
    return state


def continuous_rate(time: float, packed: Array, body: RigidBody, control: ArrayLike = NO_TORQUE) -> Array:
    """The continuous equations of motion (paper, Rdot), for an ODE solver.

    ``packed`` holds the nine entries of C by rows, then omega.
    """
    attitude, omega = packed[:9].reshape(3, 3), packed[9:]
    torque = body.potential.torque(attitude, time) + np.asarray(control)
    gyroscopic = np.cross(omega, body.inertia @ omega)
    omega_rate = np.linalg.solve(body.inertia, torque - gyroscopic)
    return np.concatenate([(attitude @ so3.hat(omega)).ravel(), omega_rate])
