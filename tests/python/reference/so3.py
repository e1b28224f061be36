"""The rotation group SO(3) and its charts (paper, section 2)."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.floating]


def hat(x: ArrayLike) -> Array:
    """The skew matrix S(x) with S(x) y = x cross y (paper, below Rdot)."""
    x1, x2, x3 = np.asarray(x, dtype=float)
    return np.array([[0.0, -x3, x2], [x3, 0.0, -x1], [-x2, x1, 0.0]])


def vee(skew: Array) -> Array:
    """The inverse of ``hat``, of the skew part of the matrix."""
    return 0.5 * np.array(
        [
            skew[2, 1] - skew[1, 2],
            skew[0, 2] - skew[2, 0],
            skew[1, 0] - skew[0, 1],
        ]
    )


def exp(zeta: ArrayLike) -> Array:
    """Rodrigues' formula exp(S(zeta)) = I + (sin t / t) S + ((1 - cos t) / t^2) S^2."""
    skew = hat(zeta)
    angle = float(np.linalg.norm(zeta))
    return np.eye(3) + _sine_ratio(angle) * skew + _versine_ratio(angle) * skew @ skew


def log(rotation: Array) -> Array:
    """The rotation vector of angle at most pi, by way of the quaternion.

    The half angle comes from its sine and cosine together, so there is no loss near
    the identity or near pi. At pi both signs of the axis are right.
    """
    quaternion = quaternion_from_rotation(rotation)
    sine = float(np.linalg.norm(quaternion[1:]))
    if sine == 0.0:
        return np.zeros(3)
    return (2.0 * math.atan2(sine, quaternion[0]) / sine) * quaternion[1:]


def cayley(c: ArrayLike) -> Array:
    """The rotation I + 2 / (1 + c.c) (S(c) + S(c)^2), c = tan(angle / 2) axis."""
    skew = hat(c)
    return np.eye(3) + 2.0 / (1.0 + float(np.dot(c, c))) * (skew + skew @ skew)


def cayley_inverse(rotation: Array) -> Array:
    """The vector c = tan(angle / 2) axis; half turns have none."""
    quaternion = quaternion_from_rotation(rotation)
    return np.asarray(quaternion[1:] / quaternion[0])


def right_jacobian(zeta: ArrayLike) -> Array:
    """J_r with exp(S(zeta + d)) = exp(S(zeta)) exp(S(J_r d)) to first order in d."""
    skew = hat(zeta)
    angle = float(np.linalg.norm(zeta))
    return np.eye(3) - _versine_ratio(angle) * skew + _angle_minus_sine_ratio(angle) * skew @ skew


def right_jacobian_inverse(zeta: ArrayLike) -> Array:
    """J_r^-1: log(exp(S(zeta)) exp(S(d))) = zeta + J_r^-1 d to first order in d.

    The coefficient of S^2 is (1 - x cot x) / (4 x^2) with x half the angle.
    """
    skew = hat(zeta)
    half = 0.5 * float(np.linalg.norm(zeta))
    coefficient = _sine_minus_angle_cosine_ratio(half) / (4.0 * _sine_ratio(half))
    return np.eye(3) + 0.5 * skew + coefficient * skew @ skew


def left_jacobian(zeta: ArrayLike) -> Array:
    """J_l with exp(S(zeta + d)) = exp(S(J_l d)) exp(S(zeta)) to first order in d."""
    return right_jacobian(-np.asarray(zeta, dtype=float))


def left_jacobian_inverse(zeta: ArrayLike) -> Array:
    """J_l^-1: log(exp(S(d)) exp(S(zeta))) = zeta + J_l^-1 d to first order in d."""
    return right_jacobian_inverse(-np.asarray(zeta, dtype=float))


def nearest_rotation(matrix: Array) -> Array:
    """The rotation U diag(1, 1, det U det V) V' nearest to U Sigma V' (theory 8)."""
    u, _, v_transposed = np.linalg.svd(matrix)
    determinant = float(np.linalg.det(u @ v_transposed))
    return np.asarray(u @ np.diag([1.0, 1.0, round(determinant)]) @ v_transposed)


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """The matrix of (qw, qx, qy, qz), which need not be normalised."""
    q = np.asarray(quaternion, dtype=float)
    q = q / np.linalg.norm(q)
    w, v = float(q[0]), q[1:]
    return (w * w - float(v @ v)) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * hat(v)


def quaternion_from_rotation(rotation: Array) -> Array:
    """The unit quaternion (qw, qx, qy, qz) with qw >= 0.

    The entries of the rotation give all of 4 q q'; its largest column is q without
    cancellation.
    """
    c = rotation
    trace = np.trace(c)
    skew = 2.0 * vee(c)
    outer = np.empty((4, 4))
    outer[0, 0] = 1.0 + trace
    outer[0, 1:] = outer[1:, 0] = skew
    outer[1:, 1:] = c + c.T + (1.0 - trace) * np.eye(3)
    column = outer[:, np.argmax(np.diag(outer))]
    quaternion = column / np.linalg.norm(column)
    return -quaternion if quaternion[0] < 0.0 else quaternion


def _sine_ratio(x: float) -> float:
    """sin x / x."""
    return math.sin(x) / x if x != 0.0 else 1.0


def _versine_ratio(x: float) -> float:
    """(1 - cos x) / x^2, without its cancellation."""
    return 0.5 * _sine_ratio(0.5 * x) ** 2


def _angle_minus_sine_ratio(x: float) -> float:
    """(x - sin x) / x^3."""
    if x < 1.0:
        return _alternating_series(x, lambda k: 1.0 / math.factorial(2 * k + 3))
    return (x - math.sin(x)) / x**3


def _sine_minus_angle_cosine_ratio(x: float) -> float:
    """(sin x - x cos x) / x^3."""
    if x < 1.0:
        return _alternating_series(x, lambda k: (2 * k + 2) / math.factorial(2 * k + 3))
    return (math.sin(x) - x * math.cos(x)) / x**3


def _alternating_series(x: float, coefficient: Callable[[int], float]) -> float:
    """sum_k (-1)^k coefficient(k) x^2k; ten terms are exact to rounding for x < 1."""
    return sum((-x * x) ** k * coefficient(k) for k in range(10))
