"""Quantiles, and means over pieces of a recording, from which proposals are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from elliptude.typing import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

PIECE_S = 0.5
"""Length of the pieces that a rest is cut into, s; averages are over one piece."""


@dataclass(frozen=True)
class Quantiles:
    """How large a number was in one recording. None of these bounds it in another."""

    count: int
    half: float
    """50 % of the samples are at or below it; the names below likewise."""
    ninety: float
    ninety_nine: float
    ninety_nine_point_nine: float
    maximum: float


def quantiles(values: ArrayLike) -> Quantiles | None:
    """Quantiles of the finite values, shape (N,); None if there are none."""
    array = np.asarray(values, dtype=np.float64)
    array = array[np.isfinite(array)]
    if not len(array):
        return None
    half, ninety, ninety_nine, most, maximum = np.quantile(array, [0.5, 0.9, 0.99, 0.999, 1.0])
    return Quantiles(len(array), float(half), float(ninety), float(ninety_nine), float(most), float(maximum))


def means_of_pieces(
    times: FloatArray, values: FloatArray, chosen: NDArray[np.bool_], piece: float = PIECE_S
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Means of the chosen rows in each piece of the recording, shape (n, 3), and to which each chosen row belongs."""
    numbers = np.floor((times[chosen] - times[0]) / piece + 1e-9).astype(np.intp)
    starts = np.flatnonzero(np.diff(numbers, prepend=-1))
    means: FloatArray = np.add.reduceat(values[chosen], starts) / np.diff(starts, append=len(numbers))[:, None]
    return means, np.cumsum(np.diff(numbers, prepend=-1) > 0) - 1


def finite_rows(rows: FloatArray) -> NDArray[np.bool_]:
    """Which rows are finite in all columns."""
    return np.asarray(np.isfinite(rows).all(axis=1), dtype=np.bool_)


def rotations_of(quaternions: ArrayLike) -> tuple[Rotation, NDArray[np.bool_]]:
    """Quaternions (qw, qx, qy, qz) as rotations, and which of them are known; the others are the identity."""
    array = np.asarray(quaternions, dtype=np.float64)
    known = finite_rows(array) & (np.linalg.norm(array, axis=1) > 0.0)
    return scipy.spatial.transform.Rotation.from_quat(
        np.where(known[:, None], array, [1.0, 0.0, 0.0, 0.0]), scalar_first=True
    ), known
