"""Ellipsoids about what two sets of states have in common: theory, section 20.3.

Shapes are of the Gibbs chart. All rows are done at once. What rounding may do is added to each result.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elliptude._core import cayley, cayley_inverse, hat, renormalized
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
# What rounding may do to an entry of a product of matrices of six rows, as a share of the product of their magnitudes.
_PRODUCT = 256.0 * _EPSILON
# A set seen from so far away is not fused: of (20.4), e.
_LARGEST_E = 0.9
# Nor is one whose shape, with ones on its diagonal, has a larger condition.
_LARGEST_CONDITION = 1e8
# How much a shape grows where a small ellipsoid is added to it, theory 20.3.
_ROOM = 1e-7
_ROWS_AT_ONCE = 20000
# The share is sought among so many, then by so many steps of the golden section.
_FIRST_SHARES, _STEPS = 9, 24
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True, eq=False)
class StateSets:
    """Sets of n rows: an attitude and k − 3 numbers beside it, k = 3 or 6; NaN where there is none."""

    attitudes: FloatArray
    """Centers, from body to reference axes, shape (n, 3, 3)."""
    vectors: FloatArray
    """Centers of the numbers beside, shape (n, k − 3)."""
    shapes: FloatArray
    """P of [γ; δ], shape (n, k, k)."""

    def take(self, rows: NDArray[np.intp]) -> "StateSets":
        """Some of the rows."""
        return StateSets(self.attitudes[rows], self.vectors[rows], self.shapes[rows])


@dataclass(frozen=True, eq=False)
class Common:
    """What n pairs of sets have in common."""

    sets: StateSets
    """About it; NaN where there is none, or none is found."""
    meet: NDArray[np.bool_]
    """False where it is proved that a pair has nothing in common, shape (n,)."""


def common(first: StateSets, second: StateSets, weight: FloatArray | None = None) -> Common:
    """Small ellipsoids about what pairs of sets have in common, (20.5), about centers of their own.

    Parameters
    ----------
    first, second : StateSets
    weight : (k, k) array, optional
        Weight of the trace that is minimised; the volume is if left out.

    Returns
    -------
    Common
    """
    sets = StateSets(*(np.full(part.shape, np.nan) for part in (first.attitudes, first.vectors, first.shapes)))
    meet = np.ones(len(first.shapes), dtype=np.bool_)
    rows = np.flatnonzero(np.isfinite(first.shapes).all(axis=(1, 2)) & np.isfinite(second.shapes).all(axis=(1, 2)))
    # Piece by piece, so that a long log needs little memory.
    for begin in range(0, len(rows), _ROWS_AT_ONCE):
        _fuse(first, second, weight, rows[begin : begin + _ROWS_AT_ONCE], sets, meet)
    return Common(sets, meet)


def _fuse(
    first: StateSets,
    second: StateSets,
    weight: FloatArray | None,
    rows: NDArray[np.intp],
    sets: StateSets,
    meet: NDArray[np.bool_],
) -> None:
    """Put into some rows of ``sets`` and ``meet`` what the pairs there have in common."""
    one, other = first.take(rows), second.take(rows)
    centers, shapes = _seen_from(one, other)
    squares = np.diagonal(one.shapes, axis1=1, axis2=2)
    scales = np.sqrt(np.where(squares > 0.0, squares, 1.0))
    conditions: FloatArray = (
        np.atleast_1d(np.linalg.cond(one.shapes / (scales[:, :, None] * scales[:, None, :])))
        if len(rows)
        else np.empty(0)
    )
    usable = np.flatnonzero(np.isfinite(shapes).all(axis=(1, 2)) & (conditions <= _LARGEST_CONDITION))
    rows, one = rows[usable], one.take(usable)
    middles, shapes, empty = _intersections(one.shapes, centers[usable], shapes[usable], conditions[usable], weight)
    meet[rows] = ~empty
    attitudes, shapes = _recentred(one.attitudes, middles, shapes)
    vectors = one.vectors + middles[:, 3:]
    shapes = _with_slip(shapes, middles, _largest(one.vectors) + _largest(middles[:, 3:]))
    found = np.flatnonzero(~empty & np.isfinite(shapes).all(axis=(1, 2)))
    for whole, some in zip((sets.attitudes, sets.vectors, sets.shapes), (attitudes, vectors, shapes), strict=True):
        whole[rows[found]] = some[found]


def log_sizes(shapes: FloatArray, weight: FloatArray | None = None) -> FloatArray:
    """What is minimised of shapes (n, k, k): log det P, or k log tr WP; NaN where a shape is."""
    if weight is None:
        known: NDArray[np.bool_] = np.asarray(np.isfinite(shapes).all(axis=(1, 2)))
        return np.where(known, np.linalg.slogdet(np.where(known[:, None, None], shapes, 0.0))[1], np.nan)
    return np.asarray(shapes.shape[-1] * np.log(np.einsum("ij,nji->n", weight, shapes)))


def _seen_from(one: StateSets, other: StateSets) -> tuple[FloatArray, FloatArray]:
    """Centers (n, k) and shapes of ellipsoids about the other sets, in coordinates about the first centers, (20.4)."""
    g, is_near = _gibbs_between(other.attitudes, one.attitudes)
    squares = np.einsum("ni,nij,nj->n", g, other.shapes[:, :3, :3], g)
    e = np.where(is_near, (1.0 + 1e-12) * 0.5 * np.sqrt(np.maximum(squares, 0.0)), np.inf)
    b = np.eye(3) - hat(g) + g[:, :, None] * g[:, None, :]
    shapes = _stretched(b, e, other.shapes)
    offsets = other.vectors - one.vectors
    centers = np.concatenate([-2.0 * g, offsets], axis=1)
    return centers, _with_slip(shapes, centers, _largest(other.vectors) + _largest(one.vectors))


def _recentred(attitudes: FloatArray, centers: FloatArray, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Attitudes at the centers of ellipsoids in coordinates about others, and shapes about them, (16.3)."""
    g = 0.5 * centers[:, :3]
    scale = 1.0 + np.einsum("ni,ni->n", g, g)
    squares = np.einsum("ni,nij,nj->n", g, shapes[:, :3, :3], g)
    e = (1.0 + 1e-12) * 0.5 * np.sqrt(np.maximum(squares, 0.0)) / scale
    b = (np.eye(3) - hat(g)) / scale[:, None, None]
    return renormalized(attitudes @ cayley(g)), _stretched(b, e, shapes)


def _gibbs_between(before: FloatArray, after: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Gibbs vectors tan(θ/2) n of the turns from attitudes to others, and whether these are far from half turns."""
    turns = before.swapaxes(1, 2) @ after
    g = np.zeros((len(turns), 3))
    is_near = np.asarray(np.trace(turns, axis1=1, axis2=2) > -0.9)
    if is_near.any():
        g[is_near] = cayley_inverse(renormalized(turns[is_near]))
    return g, is_near


def _stretched(b: FloatArray, e: FloatArray, shapes: FloatArray) -> FloatArray:
    """Shapes that hold [σ B γ; δ] for all [γ; δ] of a set and all σ with |1/σ − 1| at most e; NaN if e is too large."""
    k = shapes.shape[-1]
    turn = np.tile(np.eye(k), (len(shapes), 1, 1))
    turn[:, :3, :3] = b
    seen = turn @ shapes @ turn.swapaxes(1, 2)
    # |1 − σ| ≤ f; the sum of both ellipsoids with p = f.
    f = np.where(e < _LARGEST_E, e / (1.0 - np.minimum(e, _LARGEST_E)), np.nan)[:, None, None]
    stretched = (1.0 + f) * seen
    stretched[:, :3, :3] += (f + f**2) * seen[:, :3, :3]
    size = np.einsum("nij,nj->ni", np.abs(turn), np.sqrt(np.diagonal(shapes, axis1=1, axis2=2)))
    return _with_rounding(stretched, size * (1.0 + f[:, :, 0]))


def _with_rounding(shapes: FloatArray, sizes: FloatArray) -> FloatArray:
    """Shapes whose entries ij are off by at most some ε of sizes i times j: more by a diagonal that covers it."""
    k = shapes.shape[-1]
    covered = 0.5 * (shapes + shapes.swapaxes(1, 2))
    covered[:, np.arange(k), np.arange(k)] += k * _PRODUCT * sizes**2
    return covered


def _largest(vectors: FloatArray) -> FloatArray:
    """The largest entry of each row, without its sign."""
    return np.asarray(np.abs(vectors).max(axis=1, initial=0.0))


def _with_slip(shapes: FloatArray, centers: FloatArray, sizes: FloatArray) -> FloatArray:
    """Shapes about centers that are off by rounding: an attitude by some ε, numbers of these sizes by ε of them."""
    k = shapes.shape[-1]
    # By section 17.8 a turn moves γ by as much as it turns, and more where γ is large.
    reach = 1.0 + np.trace(shapes[:, :3, :3], axis1=1, axis2=2) + np.sum(centers[:, :3] ** 2, axis=1)
    slips = 64.0 * _EPSILON * np.where(np.arange(k) < 3, reach[:, None], sizes[:, None])
    return _with_box(shapes, slips)


def _with_box(shapes: FloatArray, half_widths: FloatArray) -> FloatArray:
    """Shapes that hold the sums of a set and of boxes of these half-widths, (n, k), by (7.1) with p = `_ROOM`."""
    k = shapes.shape[-1]
    sums = (1.0 + _ROOM) * shapes
    sums[:, np.arange(k), np.arange(k)] += (1.0 + 1.0 / _ROOM) * k * half_widths**2
    return sums


def _intersections(
    one: FloatArray, centers: FloatArray, other: FloatArray, conditions: FloatArray, weight: FloatArray | None
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Ellipsoids about what {yᵀ P⁻¹ y ≤ 1} and others have in common: centers, shapes; and where that is nothing."""
    k = one.shape[-1]
    if not len(one):
        return centers, other, np.zeros(0, dtype=np.bool_)
    # The first is a ball of squared radius 1 + slack in the coordinates u, y = L u.
    factor = np.linalg.cholesky(one)
    slack = k * _PRODUCT * conditions
    inverse = np.linalg.inv(factor)
    seen = inverse @ other @ inverse.swapaxes(1, 2)
    d, axes = np.linalg.eigh(0.5 * (seen + seen.swapaxes(1, 2)))
    at = np.einsum("nij,nj->ni", inverse, centers)
    # Rounding of the second shape and of its center, theory 20.3.
    off = slack * np.linalg.norm(at, axis=1)
    d = (1.0 + _ROOM) * (np.maximum(d, 0.0) + (slack * d[:, -1])[:, None]) + ((1.0 + 1.0 / _ROOM) * off**2)[:, None]
    at = np.einsum("nji,nj->ni", axes, at)
    whole = factor @ axes
    weights = None if weight is None else np.einsum("nji,jk,nki->ni", whole, weight, whole)

    def combined(share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """N, 1/A and the center of (1 − λ)‖u‖² + λ (u − b)ᵀ G⁻¹ (u − b), (20.5)."""
        q = (1.0 - share)[:, None] * d + share[:, None]
        level = 1.0 + (1.0 - share) * slack - share * (1.0 - share) * np.sum(at**2 / q, axis=1)
        return level, d / q, share[:, None] * at / q

    def size(share: FloatArray) -> FloatArray:
        level, inverses, _ = combined(share)
        # An empty intersection is smaller than any other, and the lower the level, the clearer is the proof.
        empty, positive = level / (1.0 + np.abs(level)) - 1e9, np.maximum(level, np.finfo(np.float64).tiny)
        if weights is None:
            sizes = k * np.log(positive) + np.sum(np.log(inverses), axis=1)
        else:
            sizes = np.log(positive) + np.log(np.sum(weights * inverses, axis=1))
        return np.where(level > 0.0, sizes, empty)

    shares = np.linspace(0.0, 1.0, _FIRST_SHARES)
    found = np.argmin([size(np.full(len(one), share)) for share in shares], axis=0)
    low, high = shares[np.maximum(found - 1, 0)], shares[np.minimum(found + 1, _FIRST_SHARES - 1)]
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        goes_left = size(left) <= size(right)
        low, high = np.where(goes_left, low, left), np.where(goes_left, right, high)
    level, inverses, middles = combined(0.5 * (low + high))
    shapes = (whole * ((np.maximum(level, 0.0) + _ROOM)[:, None] * inverses)[:, None, :]) @ whole.swapaxes(1, 2)
    shapes = _with_rounding(shapes, np.sqrt(np.diagonal(shapes, axis1=1, axis2=2)))
    scales = np.sqrt(np.diagonal(one, axis1=1, axis2=2))
    shapes = _with_box(shapes, k * _PRODUCT * scales * (1.0 + np.linalg.norm(middles, axis=1))[:, None])
    return np.einsum("nij,nj->ni", whole, middles), shapes, np.asarray(level < -_ROOM)
