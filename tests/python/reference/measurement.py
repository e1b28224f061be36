"""Measured uncertainty ellipsoid (paper, section 3.2; theory 9) and partial measurements.

Error model: b = exp(S(nu)) b_tilde with nu in E(0, S^i), and omega = omega_tilde + v with
v in E(0, T).
"""

from typing import NamedTuple

import numpy as np

from . import wahba
from .ellipsoid import StateEllipsoid, sum_minimum_trace
from .so3 import Array, hat, right_jacobian


class Measurement(NamedTuple):
    """Directions (m, 3), their weights (m,) and bounds S^i (m, 3, 3), rate and bound T."""

    reference: Array
    body: Array
    weights: Array
    direction_bounds: Array
    angular_velocity: Array
    rate_bound: Array


class LinearMeasurement(NamedTuple):
    """y = H x + v, v in E(0, R), in the error x about a centre (theory 10)."""

    y: Array
    h: Array
    r: Array


def direction_sensitivities(attitude: Array, reference: Array, body: Array, weights: Array) -> Array:
    """The matrices A^i of zeta = sum_i A^i nu^i (zetakpm), (m, 3, 3):

    A^i = -(tr(A) I - A)^-1 w_i (tr(A_i) I - A_i), A = C'L, A_i = b^i e^i' C.
    """
    a = attitude.T @ wahba.attitude_profile(reference, body, weights)
    inverse = np.linalg.inv(np.trace(a) * np.eye(3) - a)
    sensitivities = []
    for e, b, w in zip(reference, body, weights, strict=True):
        a_i = np.outer(b, e) @ attitude
        sensitivities.append(-inverse @ (w * (np.trace(a_i) * np.eye(3) - a_i)))
    return np.array(sensitivities)


def measured_shape(
    sensitivities: Array,
    direction_bounds: Array,
    rate_bound: Array,
    weight: Array | None = None,
) -> Array:
    """P^m (Pmkl): the sum of H1 A^i S^i A^i' H1' and H2 T H2', of least trace."""
    h1, h2 = np.eye(6)[:, :3], np.eye(6)[:, 3:]
    terms = [h1 @ a @ s @ a.T @ h1.T for a, s in zip(sensitivities, direction_bounds, strict=True)]
    return sum_minimum_trace([*terms, h2 @ rate_bound @ h2.T], weight)


def measured_ellipsoid(measurement: Measurement, weight: Array | None = None) -> StateEllipsoid:
    """E(C^m, omega^m, P^m) (meaRex by the SVD, meaw, Pmkl: mea)."""
    reference, body, weights, direction_bounds, angular_velocity, rate_bound = measurement
    attitude = wahba.solve_svd(reference, body, weights)
    sensitivities = direction_sensitivities(attitude, reference, body, weights)
    shape = measured_shape(sensitivities, direction_bounds, rate_bound, weight)
    return StateEllipsoid(attitude, angular_velocity, shape)


def linear_direction(attitude: Array, reference: Array, body: Array, bound: Array) -> LinearMeasurement:
    """One direction about the centre, to first order at any distance (bi; theory 10).

    With the shortest turn a that takes b_tilde to b_hat = C_hat' e, the error about
    C_hat exp(S(a)) is J_r(a) (zeta - a), and there b_tilde turns by -nu. Only the two
    components across b_tilde carry anything.
    """
    predicted = attitude.T @ reference
    across = np.linalg.svd(body[None, :])[2][1:]
    normal = np.cross(body, predicted)
    sine = float(np.linalg.norm(normal))
    offset = np.arctan2(sine, body @ predicted) / sine * normal if sine > 0 else normal
    rows = across @ hat(body)
    h = rows @ np.hstack([right_jacobian(offset), np.zeros((3, 3))])
    return LinearMeasurement(rows @ offset, h, rows @ bound @ rows.T)


def linear_rate(angular_velocity: Array, measured: Array, bound: Array) -> LinearMeasurement:
    """The angular velocity alone about the centre (Omega)."""
    h = np.hstack([np.zeros((3, 3)), np.eye(3)])
    return LinearMeasurement(measured - angular_velocity, h, bound)
