"""Linearized flow of the variational integrator (paper, section 3.1; theory 6)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import integrator, so3
from .integrator import NO_TORQUE
from .rigid_body import RigidBody, State
from .so3 import Array


class LinearizedFlow(NamedTuple):
    """The end of the flow, x+ = A x, and the change of x+ per control torque.

    x = [zeta; delta omega], the error about the state at either end.
    """

    state: State
    transition: Array
    control_effect: Array


def linearize_variational_step(
    body: RigidBody, state: State, h: float, control: ArrayLike = NO_TORQUE
) -> LinearizedFlow:
    """One step of second order: the matrix A_k of Pkpf (theory 6).

    With delta a = J delta omega + (h/2) (dM_k zeta + delta u) and
    K = h F' (tr(F J_d) I - F J_d)^-1:

        xi              = K delta a,
        zeta+           = F' zeta + xi,
        J delta omega+  = S(F'a) xi + F' delta a + (h/2) (dM_{k+1} zeta+ + delta u).
    """
    inertia, potential = body
    a = integrator.half_kicked_momentum(body, state, h, control)
    relative = integrator.relative_attitude_cayley(inertia, a, h)
    end = integrator.variational_step(body, state, h, control)

    # Every row block acts on the columns [zeta, delta omega, delta u].
    identity = np.eye(3)
    jacobian = potential.torque_jacobian(state.attitude, state.time)
    jacobian_end = potential.torque_jacobian(end.attitude, end.time)
    gain = h * relative.T @ np.linalg.inv(integrator.variation_matrix(inertia, relative))

    delta_a = np.hstack([0.5 * h * jacobian, inertia, 0.5 * h * identity])
    zeta = np.hstack([identity, np.zeros((3, 6))])
    delta_u = np.hstack([np.zeros((3, 6)), identity])

    xi = gain @ delta_a
    zeta_end = relative.T @ zeta + xi
    momentum_end = so3.hat(relative.T @ a) @ xi + relative.T @ delta_a + 0.5 * h * (jacobian_end @ zeta_end + delta_u)
    rows = np.vstack([zeta_end, np.linalg.solve(inertia, momentum_end)])
    return LinearizedFlow(end, rows[:, :6], rows[:, 6:])


def linearize_flow(
    body: RigidBody,
    state: State,
    h: float,
    steps: int = 1,
    order: int = 2,
    control: ArrayLike = NO_TORQUE,
) -> LinearizedFlow:
    """A^f = A_{k+l-1} ... A_k over steps and composition stages (paper, flow)."""
    flow = LinearizedFlow(state, np.eye(6), np.zeros((6, 3)))
    for _ in range(steps):
        for fraction in integrator.composition_stages(order):
            stage = linearize_variational_step(body, flow.state, fraction * h, control)
            flow = LinearizedFlow(
                stage.state,
                stage.transition @ flow.transition,
                stage.transition @ flow.control_effect + stage.control_effect,
            )
    return flow
