"""What one update leaves possible, question by question (theory 16.12), from constraints of [gamma; delta].

The constraints are quadrics about the center of the prediction; the first is the prediction itself. Nothing is done
about rounding.
"""

from collections.abc import Sequence

import numpy as np
import scipy.optimize

from .attitude_bounds import least_multiple, slack_form
from .quadrics import Quadric
from .so3 import Array


def of_attitude(quadric: Quadric) -> Quadric:
    """A quadric of gamma as one of all six."""
    a, g = np.zeros((6, 6)), np.zeros(6)
    a[:3, :3], g[:3] = quadric.a, quadric.g
    return Quadric(a, g, quadric.c)


def of_vector(center: Array, shape: Array) -> Quadric:
    """An ellipsoid of delta as a quadric of all six."""
    a, g = np.zeros((6, 6)), np.zeros(6)
    a[3:, 3:] = np.linalg.inv(shape)
    g[3:] = -a[3:, 3:] @ center
    return Quadric(a, g, 1.0 + float(g[3:] @ center))


def extent_along(constraints: Sequence[Quadric], direction: Array, inside: Array) -> tuple[float, float]:
    """The least and the most that d'y is proved to be; equation (16.6), about a point inside."""
    forms = [slack_form(one) for one in constraints]
    one, along = np.zeros((7, 7)), np.zeros((7, 7))
    one[0, 0] = 1.0
    along[0, 0] = -direction @ inside
    along[0, 1:] = along[1:, 0] = 0.5 * direction
    middle = float(direction @ inside)
    return middle - least_multiple(-along, one, forms), middle + least_multiple(along, one, forms)


def turn_about(constraints: Sequence[Quadric], axis: Array, center: Array) -> tuple[float, float]:
    """The least and the most turn about an axis from a center with the Gibbs vector 2 g; equation (16.7)."""
    forms = [slack_form(one) for one in constraints]
    g = 0.5 * center
    w, v = np.zeros(7), np.zeros(7)
    w[0], w[1:4] = 1.0, 0.5 * g
    v[0], v[1:4] = -axis @ g, 0.5 * (axis - np.cross(axis, g))
    along, one = 0.5 * (np.outer(w, v) + np.outer(v, w)), np.outer(w, w)
    least, most = least_multiple(-along, one, forms), least_multiple(along, one, forms)
    return -2.0 * float(np.arctan(least)), 2.0 * float(np.arctan(most))


def smallest_shadow(constraints: Sequence[Quadric], criterion: str) -> tuple[Array, Array]:
    """Center and shape of the smallest shadow on gamma that sums of the constraints give; equation (16.8)."""

    def shadow(logarithms: Array) -> tuple[Array, Array]:
        multipliers = np.exp(logarithms)
        a = sum(m * one.a for m, one in zip(multipliers, constraints, strict=True))
        g = sum(m * one.g for m, one in zip(multipliers, constraints, strict=True))
        c = sum(m * one.c for m, one in zip(multipliers, constraints, strict=True))
        inverse = np.linalg.inv(a)
        return -(inverse @ g)[:3], (c + g @ inverse @ g) * inverse[:3, :3]

    def size(logarithms: Array) -> float:
        shape = shadow(logarithms)[1]
        if np.linalg.eigvalsh(shape)[0] <= 0.0:
            return 1e3
        return float(np.linalg.slogdet(shape)[1] if criterion == "volume" else 3.0 * np.log(np.trace(shape)))

    best = np.zeros(len(constraints))
    best[1:] = -3.0
    for _ in range(4):
        options = {"maxiter": 4000, "maxfev": 8000, "xatol": 1e-6, "fatol": 1e-9}
        best = scipy.optimize.minimize(size, best, method="Nelder-Mead", options=options).x
    return shadow(best)


def own_set(constraints: Sequence[Quadric], criterion: str, inside: Array) -> tuple[Array, Array]:
    """The same, once more with slabs about where gamma is proved to be along the axes of the first."""
    _, shape = smallest_shadow(constraints, criterion)
    slabs = []
    for axis in np.linalg.eigh(shape)[1].T:
        direction = np.concatenate([axis, np.zeros(3)])
        least, most = extent_along(constraints, direction, inside)
        slabs.append(Quadric(np.outer(direction, direction), -0.5 * (least + most) * direction, -least * most))
    return smallest_shadow([*constraints, *slabs], criterion)
