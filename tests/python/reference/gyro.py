"""Flow of attitude and gyro bias under a measured rate (theory 12).

The gyro reads omega_tilde = omega + bias + v with v in E(0, V), constant in the step; the
bias drifts by an amount in E(0, D) a step. The error is x = [zeta; delta bias].
"""

from typing import NamedTuple

import numpy as np

from . import so3
from .ellipsoid import sum_minimum_trace
from .so3 import Array


class GyroState(NamedTuple):
    """Attitude C and gyro bias."""

    attitude: Array
    bias: Array


def step(state: GyroState, gyro: Array, h: float) -> GyroState:
    """C+ = C F with F = exp(S(h (omega_tilde - bias)))."""
    return GyroState(state.attitude @ so3.exp(h * (gyro - state.bias)), state.bias)


def noise_effect(state: GyroState, gyro: Array, h: float) -> Array:
    """The 6x3 matrix that takes v to x+: [-h J_r(h (omega_tilde - bias)); 0]."""
    jacobian = so3.right_jacobian(h * (gyro - state.bias))
    return np.vstack([-h * jacobian, np.zeros((3, 3))])


def drift_effect(state: GyroState, gyro: Array, h: float) -> Array:
    """The 6x3 matrix that takes the bias's change over the step to x+.

    The gyro's mean over the step holds half of a change that comes evenly.
    """
    return 0.5 * noise_effect(state, gyro, h) + np.vstack([np.zeros((3, 3)), np.eye(3)])


def transition(state: GyroState, gyro: Array, h: float) -> Array:
    """A of x+ = A x: zeta+ = F' zeta - h J_r delta bias, delta bias+ = delta bias."""
    relative = so3.exp(h * (gyro - state.bias))
    matrix = np.eye(6)
    matrix[:3, :3] = relative.T
    matrix[:, 3:] += noise_effect(state, gyro, h)
    return matrix


def predicted_shape(
    state: GyroState,
    shape: Array,
    gyro: Array,
    h: float,
    noise_bound: Array,
    drift_bound: Array,
    weight: Array | None = None,
) -> Array:
    """Least-trace sum of A P A', the noise's and the drift's ellipsoid (theory 7.2, 12)."""
    a, b = transition(state, gyro, h), noise_effect(state, gyro, h)
    d = drift_effect(state, gyro, h)
    return sum_minimum_trace([a @ shape @ a.T, b @ noise_bound @ b.T, d @ drift_bound @ d.T], weight)


def predict(
    state: GyroState,
    shape: Array,
    gyro: Array,
    h: float,
    noise_bound: Array,
    drift_bound: Array,
    weight: Array | None = None,
) -> tuple[GyroState, Array]:
    """Centre and shape over several steps, one row of ``gyro`` each."""
    for reading in gyro:
        shape = predicted_shape(state, shape, reading, h, noise_bound, drift_bound, weight)
        state = step(state, reading, h)
    return state, shape
