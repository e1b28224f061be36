"""How far an attitude may be off, and is at least off, if the truth is in a guaranteed set: theory, section 18.8.

Seen from its center, the set is a double cone of quaternions z = (s, v): Σ vᵢ²/aᵢ² ≤ s² along the axes of the shape,
with aᵢ half the semi-axis of the Gibbs vector. Total and tilt follow from the largest share ‖Bᵀz‖²/‖z‖² in it, the
heading from two vectors. Many rows are one call.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude.monitoring import arcs
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
# What rounding may do, section 18.8: to a share, and to an angle.
_SHARE, ANGLE_ROUNDING = 64.0 * _EPSILON, 64.0 * _EPSILON
# The multiplier m is sought as log(m/(1-m)) in ± this, by as many steps of the golden section: to 4e-7.
_RANGE, _STEPS = 40.0, 40
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


class ErrorAngles(NamedTuple):
    """How far n attitudes are off at most and at least, rad, shape (n,) each; NaN without a set."""

    total: FloatArray
    """The largest angle to an attitude of the set."""
    tilt: FloatArray
    """The largest angle between the two up directions; NaN without up."""
    heading: FloatArray
    """The largest turn about up; NaN without up."""
    least_total: FloatArray
    """The least angle: 0 if the attitude is in the set."""
    least_tilt: FloatArray
    """0 if an attitude of the set has this up."""
    least_heading: FloatArray
    """0 if an attitude of the set has this heading."""
    heading_from: FloatArray
    """The turn about up from the attitude to the truth: at least this, modulo 2π; NaN without up."""
    heading_to: FloatArray
    """And at most this; the middle of both is from −π to π."""


def error_angles(
    offsets: FloatArray,
    shapes: FloatArray,
    up: FloatArray | None = None,
    principal: tuple[FloatArray, FloatArray] | None = None,
) -> ErrorAngles:
    """How far attitudes are off at most and at least if the truth is in their sets.

    Parameters
    ----------
    offsets : (n, 4) array
        Unit quaternions (w, x, y, z) of Ĉᵀ C₀: each attitude C₀ as seen from its set's center. Either sign.
    shapes : (n, 3, 3) array
        P of the Gibbs vector, rad², positive semidefinite; NaN where there is no set.
    up : (n, 3) array, optional
        Unit vectors up in the body axes of the centers, Ĉᵀe.
    principal : (n, 3) and (n, 3, 3) array, optional
        Eigenvalues of the shapes and their eigenvectors as columns, if these are known.

    Returns
    -------
    ErrorAngles
    """
    count = len(offsets)
    angles = ErrorAngles(*(np.full(count, np.nan) for _ in ErrorAngles._fields))
    known = np.isfinite(offsets).all(axis=1) & np.isfinite(shapes).all(axis=(1, 2))
    if up is not None:
        known &= np.isfinite(up).all(axis=1)
    if not known.any():
        return angles
    values, vectors = np.linalg.eigh(shapes[known]) if principal is None else (part[known] for part in principal)
    squares, axes = _half_axes(values, vectors)
    # Everything in the axes of the shapes from here on.
    q = np.concatenate([offsets[known, :1], _turned(axes, offsets[known, 1:, None])[..., 0]], axis=1)
    total = largest_share(_times(np.broadcast_to(np.eye(3), (len(q), 3, 3)), q), squares)
    angles.total[known] = _angle_of_sine(total)
    # An attitude in its set may be right: no search is needed to say so.
    with np.errstate(over="ignore"):
        outside = np.sum(q[:, 1:] ** 2 / squares, axis=1) > q[:, 0] ** 2
    angles.least_total[known] = _least_angles(q[:, :, None], squares, outside)
    if up is None:
        return angles
    vertical = _turned(axes, up[known, :, None])
    twisted = _times(vertical, q)
    tilt = largest_share(_times(_across(vertical[..., 0]), q), squares)
    angles.tilt[known] = _angle_of_sine(tilt)
    angles.least_tilt[known] = _least_angles(np.concatenate([q[:, :, None], twisted], axis=2), squares, outside)
    middle, half_width = heading_interval(q, twisted[..., 0], squares)
    # Where up may be nearly opposite, a small turn changes the heading much.
    half_width += ANGLE_ROUNDING / np.maximum(np.sqrt(1.0 - tilt), ANGLE_ROUNDING**2)
    angles.heading[known] = np.minimum(np.abs(middle) + half_width, np.pi)
    angles.least_heading[known] = np.maximum(np.abs(middle) - half_width, 0.0)
    angles.heading_from[known], angles.heading_to[known] = arcs.arc(middle, half_width).T
    return angles


def largest_share(basis: FloatArray, squares: FloatArray) -> FloatArray:
    """Bounds of the largest ‖Bᵀz‖²/‖z‖² among the quaternions of sets, (18.21): the least of all multipliers.

    Parameters
    ----------
    basis : (n, 4, r) array
        B, orthonormal columns, r at most 3, in the axes of the shapes.
    squares : (n, 3) array
        aᵢ², not 0.

    Returns
    -------
    (n,) array
        At most 1; attained up to 1e-6 of it and rounding.
    """
    # One entry of the forms after another, and the rows last: what follows goes through whole arrays.
    columns = np.ascontiguousarray(basis.transpose(1, 2, 0))
    pairs = [(j, k) for j in range(columns.shape[1]) for k in range(j + 1)]
    products = [[row[j] * row[k] for row in columns] for j, k in pairs]
    of_axes = np.ascontiguousarray(squares.T)

    def share(x: FloatArray) -> FloatArray:
        # m = 1/(1 + e^-x), 1/(1-m) = 1 + e^x.
        growth = np.exp(x)
        weights = [1.0 + growth, *(of_axes / (of_axes + growth / (1.0 + growth)))]
        entries = [weights[0] * of[0] for of in products]
        for entry, of in zip(entries, products, strict=True):
            for weight, product in zip(weights[1:], of[1:], strict=True):
                entry += weight * product
        return _largest_eigenvalue(entries)

    low, high = np.full(len(basis), -_RANGE), np.full(len(basis), _RANGE)
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = share(left), share(right)
    least = np.minimum(np.minimum(at_left, at_right), 1.0)
    for _ in range(_STEPS):
        goes_left = at_left <= at_right
        low, high = np.where(goes_left, low, left), np.where(goes_left, right, high)
        new = np.where(goes_left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        at_new = share(new)
        left, right = np.where(goes_left, new, right), np.where(goes_left, left, new)
        at_left, at_right = np.where(goes_left, at_new, at_right), np.where(goes_left, at_left, at_new)
        least = np.minimum(least, at_new)
    return np.minimum((1.0 + _SHARE) * least, 1.0)


def heading_interval(q: FloatArray, twisted: FloatArray, squares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The turns about up from attitudes to those of their sets, (18.24): all within a half-width of a middle.

    Parameters
    ----------
    q : (n, 4) array
        The attitudes seen from the centers, in the axes of the shapes.
    twisted : (n, 4) array
        (0, u) q, u the unit vector up in these axes.
    squares : (n, 3) array
        aᵢ².

    Returns
    -------
    middle, half_width : (n,) array
        rad; a half-width of π says nothing. Rounding of the vectors themselves is not in it.
    """

    def dual(a: FloatArray, b: FloatArray) -> FloatArray:
        product: FloatArray = a[:, 0] * b[:, 0] - np.einsum("ni,ni,ni->n", squares, a[:, 1:], b[:, 1:])
        return product

    def size(a: FloatArray) -> FloatArray:
        product: FloatArray = a[:, 0] ** 2 + np.einsum("ni,ni->n", squares, a[:, 1:] ** 2)
        return product

    # One scale for all, so that no square overflows.
    scale = np.maximum(np.max(squares, axis=1), 1.0)
    # Less by what rounding may do to them: more turns are possible then.
    k11 = (dual(q, q) - _SHARE * size(q)) / scale
    k22 = (dual(twisted, twisted) - _SHARE * size(twisted)) / scale
    k12 = dual(q, twisted) / scale
    middle = np.arctan2(k12, 0.5 * (k11 - k22))
    # Where the root is 0 and the sum negative, any heading is possible: π.
    root = np.sqrt(np.maximum(k12**2 - k11 * k22, 0.0))
    return middle, np.arctan2(root, 0.5 * (k11 + k22))


def _half_axes(values: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """aᵢ² (n, 3), enlarged by what rounding may do, and right-handed axes (n, 3, 3) as columns; by eigenvectors."""
    # Right-handed, because cross products follow.
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    largest = np.maximum(values[:, -1:], np.finfo(np.float64).tiny)
    return 0.25 * (np.maximum(values, 0.0) + _SHARE * largest), axes


def _turned(axes: FloatArray, vectors: FloatArray) -> FloatArray:
    """Columns (n, 3, r) in the axes of the shapes."""
    turned: FloatArray = np.swapaxes(axes, 1, 2) @ vectors
    return turned


def _times(normals: FloatArray, q: FloatArray) -> FloatArray:
    """The quaternions (0, n) q of columns n (k, 3, r), as columns (k, 4, r)."""
    w, v = q[:, :1, None], q[:, 1:, None]
    first = -np.sum(v * normals, axis=1, keepdims=True)
    others = w * normals + np.cross(normals, v, axis=1)
    return np.concatenate([first, others], axis=1)


def _across(directions: FloatArray) -> FloatArray:
    """Two orthonormal columns (n, 3, 2) perpendicular to unit vectors."""
    # The axis that is least along the direction is far from parallel to it.
    axis = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    one = np.cross(directions, axis)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([one, np.cross(directions, one)], axis=2)


def _largest_eigenvalue(entries: list[FloatArray]) -> FloatArray:
    """The largest eigenvalues of symmetric matrices of up to three rows: entries 00, 10, 11, 20, 21, 22.

    Of three positive semidefinite rows an upper bound: q + 2 p cos φ with cos 3φ = det((A - qI)/p)/2 grows with the
    determinant, to which is added what rounding may take: of A - qI some ε q, of its share of p some ε q/p.
    """
    if len(entries) == 1:
        return entries[0]
    if len(entries) == 3:
        a, b, c = entries
        return np.asarray(0.5 * (a + c) + np.hypot(0.5 * (a - c), b))
    a, d, b, f, e, c = entries
    mean = (a + b + c) / 3.0
    a, b, c = a - mean, b - mean, c - mean
    spread = np.sqrt(((a * a + b * b + c * c) + 2.0 * (d * d + e * e + f * f)) / 6.0)
    scale = np.where(spread > 0.0, spread, 1.0)
    a, b, c, d, e, f = (entry / scale for entry in (a, b, c, d, e, f))
    cosine = 0.5 * (a * (b * c - e * e) - d * (d * c - e * f) + f * (d * e - b * f))
    cosine += _SHARE * (1.0 + np.abs(mean) / scale)
    largest = mean + 2.0 * spread * np.cos(np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0)
    return np.asarray((1.0 + _SHARE) * largest)


def _angle_of_sine(share: FloatArray) -> FloatArray:
    """The angle of sin²(θ/2), upwards."""
    return np.minimum(2.0 * np.arcsin(np.sqrt(share)) + ANGLE_ROUNDING, np.pi)


def _least_angles(basis: FloatArray, squares: FloatArray, outside: NDArray[np.bool_]) -> FloatArray:
    """The angle of cos²(θ/2), the largest share, downwards; 0 but in the rows outside."""
    angles = np.zeros(len(basis))
    if not outside.any():
        return angles
    share = largest_share(basis[outside], squares[outside])
    angles[outside] = np.maximum(2.0 * np.arccos(np.sqrt(share)) - ANGLE_ROUNDING, 0.0)
    return angles
