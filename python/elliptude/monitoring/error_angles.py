"""How far an attitude may be off, and is at least off, if the truth is in a guaranteed set: theory, section 18.8.

Seen from its center, the set is a double cone of quaternions z = (s, v): Σ vᵢ²/aᵢ² ≤ s² along the axes of the shape,
with aᵢ half the semi-axis of the Gibbs vector. Total and tilt follow from the largest share ‖Bᵀz‖²/‖z‖² in it, the
heading from two vectors. Many rows are one call.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude.monitoring import arcs
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
_TINY = float(np.finfo(np.float64).tiny)
# What rounding may do, section 18.8: to a share, and to an angle.
_SHARE, ANGLE_ROUNDING = 64.0 * _EPSILON, 64.0 * _EPSILON
# The multiplier m is sought as x = log(m/(1-m)) in ± this, until no other is better by this share of what was found, or
# x is known this well; at most so many steps.
_RANGE, _SHARPNESS, _RESOLUTION, _STEPS = 40.0, 1e-9, 1e-7, 64
# In so many steps what is left to search must be halved; otherwise the next step halves it.
_PATIENCE = 3


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
    forms = _Forms.of(basis, squares)
    x, steepness = forms.first_guess()
    # Of the rows that are still sought: where x was before, the ratio there, and between which ends it is sought.
    rows, before, ratio_before = np.arange(len(x)), x, np.zeros(len(x))
    low, high = np.full(len(x), -_RANGE), np.full(len(x), _RANGE)
    least, wide = np.ones(len(x)), high - low
    for step in range(_STEPS):
        share, rise, fall = forms.at(x)
        least[rows] = np.minimum(least[rows], share)
        falls = rise < fall
        low, high = np.where(falls, x, low), np.where(falls, high, x)
        better = _better_at_most(x, rise - fall, np.where(falls, high, low))
        # Near 1 it is the difference from 1 that says how large an angle is.
        sought = better > _SHARPNESS * share * np.maximum(1.0 - share, 0.0)
        sought &= ((1.0 + _SHARE) * (share - better) < 1.0) & (high - low > _RESOLUTION)
        if not sought.any():
            break
        # The logarithm of the ratio is nearly a line in x: at first as for the guess, then through the last two.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = np.log(np.maximum(rise / np.maximum(fall, _TINY), _TINY))
            following = x - ratio * ((x - before) / (ratio - ratio_before) if step else 1.0 / steepness)
        outside = ~((following > low) & (following < high))
        if step % _PATIENCE == 0:
            outside |= (step > 0) & (high - low > 0.5 * wide)
            wide = high - low
        # No further than steps that double: the ends may be far away.
        most = 2.0 ** min(step + 1, 6)
        halved = np.clip(0.5 * (low + high), x - most, x + most)
        following = np.where(outside, halved, following)
        before, ratio_before, x = x, ratio, following
        if np.count_nonzero(sought) < 0.75 * len(sought):
            rows, x, before, ratio_before = rows[sought], x[sought], before[sought], ratio_before[sought]
            low, high, wide, forms = low[sought], high[sought], wide[sought], forms.take(sought)
    return np.minimum((1.0 + _SHARE) * least, 1.0)


def _better_at_most(x: FloatArray, slope: FloatArray, end: FloatArray) -> FloatArray:
    """How much less a share may be on the way to an end that it falls to: by its tangent in m, as it is convex in m."""
    growth, to_end = np.exp(x), np.exp(end - x)
    # The way in m, in units of dm/dx.
    better: FloatArray = np.abs(slope) * np.abs(to_end - 1.0) * ((1.0 + growth) / (1.0 + to_end * growth))
    return better


class _Forms(NamedTuple):
    """The matrices of (18.21) for n rows; one entry after another, and the rows last: it goes through whole arrays."""

    products: FloatArray
    """Of the columns of B in pairs, 00, 10, 11, .., row by row of B, shape (pairs, 4, n)."""
    squares: FloatArray
    """aᵢ², shape (3, n)."""

    @classmethod
    def of(cls, basis: FloatArray, squares: FloatArray) -> "_Forms":
        """The arguments are those of `largest_share`."""
        columns = np.ascontiguousarray(basis.transpose(2, 1, 0))
        pairs = [columns[j] * columns[k] for j in range(len(columns)) for k in range(j + 1)]
        return cls(np.array(pairs), np.ascontiguousarray(squares.T))

    def take(self, rows: NDArray[np.bool_]) -> "_Forms":
        """Those of some rows."""
        return _Forms(self.products[:, :, rows], self.squares[:, rows])

    def first_guess(self) -> tuple[FloatArray, FloatArray]:
        """The x where b²/(1-m) + a²/(a²+m) is least, b = ‖b₀‖ and a the largest aᵢ; how steep the ratio is there."""
        diagonal = self.products[[0, 2, 5][: (len(self.products) + 1) // 2], 0]
        b = np.sqrt(np.maximum(np.sum(diagonal, axis=0), _TINY))
        a = np.sqrt(np.maximum(np.max(self.squares, axis=0), _TINY))
        growth = a * np.maximum(1.0 - a * b, 0.0) / (b * (1.0 + a * a))
        # No nearer to 0: where m is of the size of rounding, the slope is lost, and nothing is to be gained.
        x = np.clip(np.log(np.maximum(growth, _TINY)), -0.5 * _RANGE, _RANGE)
        growth = np.exp(x)
        m = growth / (1.0 + growth)
        return x, 2.0 * m * (1.0 + (1.0 - m) / (a * a + m))

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """σ at m = 1/(1 + e^-x), and how it rises and falls with x: r and f of section 18.8, nearly."""
        growth = np.exp(x)
        m = growth / (1.0 + growth)
        weights = np.empty((4, len(x)))
        weights[0] = 1.0 + growth
        np.divide(self.squares, self.squares + m, out=weights[1:])
        entries = [_weighted(weights, products) for products in self.products]
        share = _largest_eigenvalue(entries)
        # Row by row of B what is along the eigenvector: of the slope no more cancels than has to.
        seen = _weighted(_onto_largest(entries, share), self.products)
        decrease = seen[1:] * weights[1:] * (m / (self.squares + m))
        return share, growth * seen[0], np.sum(decrease, axis=0) / (1.0 + growth)


def _weighted(weights: Sequence[FloatArray] | FloatArray, terms: FloatArray) -> FloatArray:
    """The sum of the terms times their weights."""
    total: FloatArray = weights[0] * terms[0]
    for weight, term in zip(weights[1:], terms[1:], strict=True):
        total += weight * term
    return total


def _onto_largest(entries: list[FloatArray], largest: FloatArray) -> list[FloatArray]:
    """The projection on the eigenvector of the largest eigenvalue λ, entries as there, those off the diagonal twice.

    Of three rows it is adj(λ - A) by its trace. Where two eigenvalues are the largest, it is some such matrix.
    """
    if len(entries) == 1:
        return [np.ones_like(largest)]
    if len(entries) == 3:
        a, b, c = entries
        half = 0.5 * (a - c)
        # λ - c or λ - a, the one that is no difference: the larger component, with b the other.
        larger = np.hypot(half, b) + np.abs(half)
        other = np.where(larger > 0.0, b / np.where(larger > 0.0, larger, 1.0), 0.0)
        share = 1.0 / (1.0 + other * other)
        rest = other * other * share
        is_first = half >= 0.0
        return [np.where(is_first, share, rest), 2.0 * other * share, np.where(is_first, rest, share)]
    a, d, b, f, e, c = (entry / largest for entry in entries)
    a, b, c = 1.0 - a, 1.0 - b, 1.0 - c
    of_a, of_b, of_c = b * c - e * e, a * c - f * f, a * b - d * d
    trace = np.maximum(of_a + of_b + of_c, _TINY)
    twice = 2.0 / trace
    of_a, of_b, of_c = of_a / trace, of_b / trace, of_c / trace
    return [of_a, (e * f + c * d) * twice, of_b, (d * e + b * f) * twice, (d * f + a * e) * twice, of_c]


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
