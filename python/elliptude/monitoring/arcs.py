"""Headings that are possible: arcs of a circle, as two angles of which the second is not less, modulo 2π.

The middle of an arc is from −π to π, so that its ends may be beyond. An arc of 2π says nothing.
"""

import numpy as np

from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
# What a shift by 2π and the sum with a middle may lose, rad.
_ROUNDING = 16.0 * _EPSILON


def arc(middle: FloatArray, half_width: FloatArray) -> FloatArray:
    """The arcs about middles, shape (n, 2), rad.

    Parameters
    ----------
    middle, half_width : (n,) array
        rad; the middle is any angle, a half-width of π or more says nothing.
    """
    turns = np.round(middle / (2.0 * np.pi))
    middle = middle - 2.0 * np.pi * turns
    half_width = half_width + np.where(turns == 0.0, 0.0, _ROUNDING * np.abs(turns))
    says_nothing = half_width >= np.pi
    middle, half_width = np.where(says_nothing, 0.0, middle), np.where(says_nothing, np.pi, half_width)
    return np.column_stack([middle - half_width, middle + half_width])


def common(first: FloatArray, second: FloatArray) -> FloatArray:
    """The shortest arcs that hold what two arcs have in common, shape (n, 2).

    Where one is NaN, the other. Where the two have no common angle, so that something stated is wrong, and where an arc
    about both common pieces would be longer, the shorter of the two.

    Parameters
    ----------
    first, second : (n, 2) array
        rad.
    """
    shift = 2.0 * np.pi * np.round((first.sum(axis=1) - second.sum(axis=1)) / (4.0 * np.pi))
    beside = _shifted(second, shift)
    low, high = np.maximum(first[:, 0], beside[:, 0]), np.minimum(first[:, 1], beside[:, 1])
    # The other side of the circle, where long arcs may meet once more.
    turn = 2.0 * np.pi - _ROUNDING
    twice = (beside[:, 0] + turn <= first[:, 1]) | (beside[:, 1] - turn >= first[:, 0])
    met = np.column_stack([low, high])
    met = _shifted(met, -2.0 * np.pi * np.round(met.sum(axis=1) / (4.0 * np.pi)))
    found = np.where(first[:, 1:] - first[:, :1] <= second[:, 1:] - second[:, :1], first, second)
    is_one = (low <= high) & ~twice
    found[is_one] = met[is_one]
    only_first, only_second = np.isnan(second[:, 0]), np.isnan(first[:, 0])
    found[only_first], found[only_second] = first[only_first], second[only_second]
    return found


def largest(arcs: FloatArray) -> FloatArray:
    """The largest turn to either side, at most π, shape (n,)."""
    return np.minimum(np.maximum(-arcs[:, 0], arcs[:, 1]), np.pi)


def least(arcs: FloatArray) -> FloatArray:
    """The least turn to either side, 0 in the arc, shape (n,)."""
    return np.maximum(np.maximum(arcs[:, 0], -arcs[:, 1]), 0.0)


def _shifted(arcs: FloatArray, shift: FloatArray) -> FloatArray:
    """Arcs turned by multiples of 2π, enlarged by what that loses."""
    by, rounding = shift[:, None], np.where(shift == 0.0, 0.0, _ROUNDING)[:, None]
    return np.concatenate([arcs[:, :1] + by - rounding, arcs[:, 1:] + by + rounding], axis=1)
