"""Bounds of single questions about an attitude from the constraints of a row (theory 16.11).

z = [1; gamma]. A constraint k holds where z'M_k z >= 0. Every s with multipliers mu >= 0 and sG - F - sum mu_k M_k >= 0
bounds z'Fz / z'Gz; the least one is found by a barrier method. Nothing is done about rounding.
"""

from collections.abc import Sequence

import numpy as np

from .quadrics import Quadric
from .so3 import Array


def slack_form(quadric: Quadric) -> Array:
    """M with z'Mz = c - y'A y - 2 g'y, z = [1; y]."""
    return np.block([[np.array([[quadric.c]]), -quadric.g[None]], [-quadric.g[:, None], -quadric.a]])


def least_multiple(f: Array, g: Array, forms: Sequence[Array]) -> float:
    """The least s with Z = sG - F - sum mu_k M_k positive semidefinite for some mu >= 0, from above.

    A barrier: s - (log det Z + sum log mu_k)/t is convex, and its least value is at most (n + K)/t above that of s. The
    first form is that of an ellipsoid about zero, in whose coordinates the search is done.
    """
    root = np.eye(len(f))
    root[1:, 1:] = np.linalg.inv(np.linalg.cholesky(-forms[0][1:, 1:])).T
    seen = [root.T @ form @ root for form in (f, g, *forms)]
    fixed, parts = -seen[0], [seen[1], *(-form / np.linalg.norm(form) for form in seen[2:])]
    size = len(f) + len(forms)

    def whole(x: Array) -> Array:
        return fixed + np.tensordot(x, parts, axes=1)

    def value(x: Array, weight: float) -> float:
        try:
            factor = np.linalg.cholesky(whole(x))
        except np.linalg.LinAlgError:
            return np.inf
        if not (x[1:] > 0.0).all():
            return np.inf
        return float(weight * x[0] - 2.0 * np.log(np.diag(factor)).sum() - np.log(x[1:]).sum())

    x = np.ones(1 + len(forms))
    while value(x, 1.0) == np.inf:
        x[1] *= 1.5
        x[0] *= 3.0
    weight = 1.0 / x[0]
    while size / weight > 1e-5 * abs(x[0]):
        weight *= 5.0
        for _ in range(60):
            inverse = np.linalg.inv(whole(x))
            products = [inverse @ part for part in parts]
            gradient = -np.array([np.trace(product) for product in products])
            hessian = np.array([[np.sum(one * other.T) for other in products] for one in products])
            gradient[0] += weight
            gradient[1:] -= 1.0 / x[1:]
            hessian[1:, 1:] += np.diag(1.0 / x[1:] ** 2)
            step = -np.linalg.solve(hessian, gradient)
            decrease = float(-gradient @ step)
            if decrease < 1e-9:
                break
            length, before = 1.0, value(x, weight)
            while value(x + length * step, weight) > before - 0.1 * length * decrease and length > 1e-12:
                length *= 0.5
            x = x + length * step
    return float(x[0])
