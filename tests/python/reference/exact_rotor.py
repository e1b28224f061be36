"""The free rigid body in closed form (theory 4.1 and 6.1), by SciPy's elliptic functions and quadrature.

Nothing here is short of a half period by series or doubled, as the core's functions are.
"""

import numpy as np
from scipy.integrate import quad
from scipy.special import ellipj

from .so3 import Array


def elliptic_functions(a: float, b: float, length: float) -> tuple[float, float, float]:
    """s, c, d of (4.8) with c^2 = 1 - b s^2 and d^2 = 1 - a s^2."""
    larger, smaller = max(a, b), min(a, b)
    if larger == 0.0:
        return length, 1.0, 1.0
    root = np.sqrt(larger)
    sn, cn, dn, _ = ellipj(root * length, smaller / larger)
    return (sn / root, dn, cn) if a > b else (sn / root, cn, dn)


def phase(kappa: float, q: float, length: float) -> float:
    """theta of (4.11), with 1/(f_3^2 + kappa) = s^2/(d^2 + kappa s^2)."""
    a, b = kappa * q, (1.0 - kappa) * (1.0 - q)

    def rate(at: float) -> float:
        s, _, d = elliptic_functions(a, b, at)
        return s * s / (d * d + kappa * s * s)

    integral, _ = quad(rate, 0.0, length, epsabs=1e-14, epsrel=1e-13, limit=500)
    return -kappa * (1.0 - q) * float(integral)


def triad(m: Array) -> Array:
    """The columns m, p, m cross p, with p towards the third axis."""
    p = np.array([0.0, 0.0, 1.0]) - m[2] * m
    p /= np.linalg.norm(p)
    return np.column_stack([m, p, np.cross(m, p)])


def free_turn(inertia: Array, h: float, momentum: Array) -> Array:
    """F after the time h, from the momentum at the start in body axes, not zero: (4.7) to (4.11)."""
    moments, axes = np.linalg.eigh(inertia)
    moments, axes = moments[::-1], axes[:, ::-1]
    axes = axes * np.array([1.0, np.linalg.det(axes), 1.0])
    b1, b2, b3 = 1.0 / moments
    spread = b3 - b1
    kappa = (b3 - b2) / spread if spread > 0.0 else 0.5
    size = float(np.linalg.norm(momentum))
    m = axes.T @ momentum / size
    length = h * size * spread
    if (1.0 - kappa) * m[1] ** 2 + m[2] ** 2 > 0.5:
        exchange = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
        m, axes, kappa, length, b3 = exchange @ m, axes @ exchange.T, 1.0 - kappa, -length, b1
    x, y, z = m
    q = (1.0 - kappa) * y**2 + z**2
    s, c, d = elliptic_functions(kappa * q, (1.0 - kappa) * (1.0 - q), length)
    delta = d**2 + kappa * z**2 * s**2
    end = np.array(
        [
            x * d + kappa * y * z * s * c,
            y * c * d - x * z * s,
            z * c + (1.0 - kappa) * x * y * s * d,
        ]
    )
    end /= np.linalg.norm(end)
    across = c * d * (1.0 - z**2) - (1.0 - kappa) * x * y * z * s * (kappa * s**2 * (1.0 - z**2) + delta)
    psi = h * size * b3 + phase(kappa, q, length) + np.arctan2(-(1.0 - q) * s * delta, across)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(psi), -np.sin(psi)], [0.0, np.sin(psi), np.cos(psi)]])
    return axes @ triad(m) @ turn @ triad(end).T @ axes.T
