"""The exact uncertainty set of Wahba's problem (theory 15), as it is derived.

Directions are (m, 3) arrays of unit rows, ``bounds`` m angles, ``weights`` m numbers.
Nothing is done about rounding: bounds must not be tiny.
"""

import numpy as np

from . import so3, wahba
from .so3 import Array


def in_all_cones(attitude: Array, reference: Array, body: Array, bounds: Array) -> bool:
    """Whether the angle between C'e^i and b^i is at most r_i, for each i."""
    cosines = np.sum((reference @ attitude) * body, axis=1)
    return bool(np.all(np.arccos(np.clip(cosines, -1.0, 1.0)) <= bounds))


def davenport_form(reference: Array, body: Array, bounds: Array, weights: Array) -> Array:
    """The Q = sum_i mu_i (K_i - cos r_i I) with q'Qq >= 0 for attitudes in all cones (15.2)."""
    profile = wahba.attitude_profile(reference, body, weights)
    return wahba.davenport_matrix(profile) - float(weights @ np.cos(bounds)) * np.eye(4)


def solution(reference: Array, body: Array, bounds: Array, weights: Array) -> tuple[Array, Array, float]:
    """The top eigenvector's attitude, N and R with x'Nx <= R about it (15.3, 15.4).

    R = lambda_1 - kappa, and N has the eigenvalues lambda_1 - lambda_j and the other
    eigenvectors, seen as errors about the first.
    """
    values, vectors = np.linalg.eigh(davenport_form(reference, body, bounds, weights))
    q = vectors[:, -1]
    w, v = q[0], q[1:]
    # The quaternion of q0 (w, x) is (w0 w - v0.x, w v0 + w0 x + v0 x x): columns for x.
    frame = np.vstack([-v, w * np.eye(3) + so3.hat(v)])
    axes = frame.T @ vectors[:, :-1]
    curvature = axes @ np.diag(values[-1] - values[:-1]) @ axes.T
    return so3.rotation_from_quaternion(q), curvature, float(values[-1])


def shape(curvature: Array, level: float, chart: str) -> Array:
    """The smallest ellipsoid of zeta or gamma about x'Nx <= R (15.6, 15.7)."""
    if chart == "gibbs":
        return 4.0 * level * np.linalg.inv(curvature - level * np.eye(3))
    values, vectors = np.linalg.eigh(curvature)
    half_angles = np.arcsin(np.sqrt(level / values))
    return vectors @ np.diag((2.0 * half_angles) ** 2) @ vectors.T


def coordinates(center: Array, attitude: Array, chart: str) -> Array:
    """The error zeta or gamma = 2 tan(theta/2) n of C about the centre."""
    zeta = so3.log(center.T @ attitude)
    angle = float(np.linalg.norm(zeta))
    if chart == "exponential" or angle == 0.0:
        return zeta
    return 2.0 * np.tan(0.5 * angle) * zeta / angle
