"""Checks of the arguments of functions about bounds."""

import numpy as np
from numpy.typing import ArrayLike

from elliptude._arrays import unmasked
from elliptude.typing import FloatArray


def require_not_negative(name: str, value: float) -> None:
    """Raise ValueError unless the value is finite and at least 0."""
    if not 0.0 <= value < np.inf:
        raise ValueError(f"{name} must be finite and at least 0, not {value}")


def require_fraction(name: str, value: float) -> None:
    """Raise ValueError unless the value is from 0 to below 1."""
    if not 0.0 <= value < 1.0:
        raise ValueError(f"{name} must be from 0 to below 1, not {value}")


def vector_rows(name: str, values: ArrayLike, count: int | None = None) -> FloatArray:
    """An array (N, 3); a row that is not finite in any component becomes NaN in all."""
    array = np.asarray(unmasked(values), dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or (count is not None and len(array) != count):
        raise ValueError(f"{name} must have shape ({'N' if count is None else count}, 3), not {array.shape}")
    return np.where(np.isfinite(array).all(axis=1, keepdims=True), array, np.nan)


def increasing_times(values: ArrayLike) -> FloatArray:
    """An array (N,) of at least one time."""
    array = np.asarray(unmasked(values), dtype=np.float64)
    if array.ndim != 1 or not len(array):
        raise ValueError(f"times must have shape (N,) with at least one row, not {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"times must be finite; row {int(np.flatnonzero(~np.isfinite(array))[0])} is not")
    backward = np.flatnonzero(np.diff(array) <= 0.0)
    if len(backward):
        raise ValueError(f"times must increase; row {int(backward[0]) + 1} does not")
    return array
