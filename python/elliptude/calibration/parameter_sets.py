"""Sets of parameters that linear inequalities leave, and what a linear program proves about them.

Every number returned here is a bound: it is calculated from the multipliers that the solver found, by an inequality
that holds for any multipliers, so that neither the solver's tolerances nor an early end can make it too small.
Derivations: docs/theory.md, section 19.4.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy

from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Shortfall:
    """By how much inequalities would have to be wider for all of them to hold, and which of them say so."""

    least: float
    """Proved: every parameter in the box breaks one of them by this much or more. Negative: there may be room."""
    needed: float
    """Attained: with this much more room there is a parameter, up to the solver's tolerance."""
    weights: FloatArray
    """How much each inequality has to do with it, shape (n,), at least 0."""


@dataclass(frozen=True, eq=False)
class ParameterSet:
    """All θ in a box with Gθ ≤ h."""

    lowest: FloatArray
    """Least value of each parameter, shape (m,)."""
    highest: FloatArray
    """Greatest value, shape (m,)."""
    rows: FloatArray
    """G, shape (n, m)."""
    limits: FloatArray
    """h, shape (n,)."""

    def within(self, rows: FloatArray, limits: FloatArray) -> "ParameterSet":
        """The part in which further inequalities hold."""
        return ParameterSet(
            self.lowest, self.highest, np.concatenate([self.rows, rows]), np.concatenate([self.limits, limits])
        )

    def support(self, direction: FloatArray) -> float:
        """An upper bound of cᵀθ over the set, (19.6); the least one up to the solver's tolerance."""
        found = scipy.optimize.linprog(
            -direction,
            A_ub=self.rows,
            b_ub=self.limits + _room(self.rows, self.limits, self._sizes()),
            bounds=[*zip(self.lowest, self.highest, strict=True)],
            method="highs",
        )
        none = np.zeros(len(self.limits))
        if found.status != 0:
            return self._proved(direction, none)
        return min(self._proved(direction, np.maximum(-found.ineqlin.marginals, 0.0)), self._proved(direction, none))

    def box(self) -> tuple[FloatArray, FloatArray]:
        """The least and greatest value of each parameter."""
        axes = np.eye(len(self.lowest))
        return -np.array([self.support(-axis) for axis in axes]), np.array([self.support(axis) for axis in axes])

    def shortfall(self, first: int, slack: FloatArray) -> Shortfall:
        """How far the inequalities from ``first`` on are from leaving a parameter, in units of their ``slack``, (19.7).

        Parameters
        ----------
        first : int
            The inequalities before it must hold as they are.
        slack : (n - first,) array
            By how much each is widened for one unit, positive.
        """
        column = np.concatenate([np.zeros(first), -slack])
        found = scipy.optimize.linprog(
            np.append(np.zeros(len(self.lowest)), 1.0),
            A_ub=np.column_stack([self.rows, column]),
            b_ub=self.limits,
            bounds=[*zip(self.lowest, self.highest, strict=True), (None, None)],
            method="highs",
        )
        if found.status != 0:
            return Shortfall(-np.inf, np.inf, np.zeros(len(self.limits) - first))
        weights = np.maximum(-found.ineqlin.marginals, 0.0)
        share = float(weights[first:] @ slack)
        if not share > 0.0:
            return Shortfall(-np.inf, float(found.fun or 0.0), weights[first:])
        # With θ in the box, λᵀ(Gθ - h) is at least its least value there, and at most λᵀ(slack) times the shortfall.
        return Shortfall(
            -self._proved(np.zeros(len(self.lowest)), weights) / share, float(found.fun or 0.0), weights[first:]
        )

    def _sizes(self) -> FloatArray:
        sizes: FloatArray = np.maximum(np.abs(self.lowest), np.abs(self.highest))
        return sizes

    def _proved(self, direction: FloatArray, weights: FloatArray) -> float:
        """λᵀh + max over the box of (c - Gᵀλ)ᵀθ, rounded up: at least cᵀθ for all θ of the set, whatever λ ≥ 0."""
        rest = direction - self.rows.T @ weights
        sizes = self._sizes()
        value = float(weights @ self.limits + np.maximum(rest * self.lowest, rest * self.highest).sum())
        absolute = float(weights @ (np.abs(self.limits) + np.abs(self.rows) @ sizes) + np.abs(direction) @ sizes)
        return value + 4.0 * (len(weights) + len(sizes)) * _EPSILON * absolute


def _room(rows: FloatArray, limits: FloatArray, sizes: FloatArray) -> FloatArray:
    """A little more than the limits, so that a set that is a point has an inside for the solver."""
    room: FloatArray = 1e-9 * (np.abs(limits) + np.abs(rows) @ sizes)
    return room


@cache
def covering_directions(divisions: int = 2) -> tuple[FloatArray, float]:
    """Unit vectors (n, 3), and the cosine of the largest angle from any direction to the nearest of them.

    An icosahedron, its triangles divided: 42 directions after one division, 162 after two. The farthest point of a
    triangle's sphere from its corners is perpendicular to its plane. The second half of the directions are the
    opposites of the first.
    """
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    corners = np.array([np.roll([0.0, a, b * golden], k) for k in range(3) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    points = corners / np.linalg.norm(corners[0])
    near = points @ points.T > 0.4
    triples = np.array(
        [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    )
    triangles = points[triples]
    for _ in range(divisions):
        triangles = np.concatenate([_divided(triangle) for triangle in triangles])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    cosine = float(np.abs(np.einsum("ni,nki->nk", normals, triangles)).min()) - 1e-12
    corners = np.unique(np.round(triangles.reshape(-1, 3), 12), axis=0)
    half = corners[np.lexsort(corners.T)[len(corners) // 2 :]]
    directions = np.concatenate([half, -half])
    return directions / np.linalg.norm(directions, axis=1)[:, None], cosine


def _divided(triangle: FloatArray) -> FloatArray:
    """The four triangles that the middles of the sides make of a triangle on the sphere."""
    a, b, c = triangle
    ab, bc, ca = ((p + q) / np.linalg.norm(p + q) for p, q in ((a, b), (b, c), (c, a)))
    return np.array([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]])


def small_ball(directions: FloatArray, cosine: float, supports: FloatArray) -> tuple[FloatArray, float]:
    """A ball that holds every x with uᵀx ≤ support for all directions u, (19.9).

    Parameters
    ----------
    directions : (n, 3) array
        Unit vectors.
    cosine : float
        Of the largest angle from any direction to the nearest of them.
    supports : (n,) array

    Returns
    -------
    center : (3,) array
    radius : float
    """
    found = scipy.optimize.linprog(
        [0.0, 0.0, 0.0, 1.0],
        A_ub=np.column_stack([-directions, -np.ones(len(directions))]),
        b_ub=-supports,
        bounds=[(None, None)] * 4,
        method="highs",
    )
    center = np.zeros(3) if found.x is None else np.asarray(found.x[:3])
    radius = max(float((supports - directions @ center).max()), 0.0) / cosine
    return center, radius * (1.0 + 1e-12)
