"""Axes of a sensor that would fit, and how a configuration has them."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from elliptude.typing import FloatArray


def axes_in_words(matrix: ArrayLike, columns: Sequence[str]) -> str:
    """Axes in the configuration's syntax; left-handed ones are those of columns in another order.

    Parameters
    ----------
    matrix : (3, 3) array
        From the sensor's axes to the body's.
    columns : sequence of str
        Three, as the configuration has them.

    Returns
    -------
    str
        Such as ``axes = ["y", "-x", "z"]``.
    """
    axes = np.asarray(matrix, dtype=np.float64)
    if np.linalg.det(axes) > 0.0:
        return f"axes = {_toml(axes)}"
    orders = [list(order) for order in itertools.permutations(range(3)) if np.linalg.det(np.eye(3)[list(order)]) < 0.0]
    # The columns in another order are P x, and A x = A Pᵀ (P x): the order whose axes are plainest.
    order = max(orders, key=lambda order: float(np.trace(axes @ np.eye(3)[order].T)))
    names = ", ".join(f'"{columns[i]}"' for i in order)
    return f"columns = [{names}], axes = {_toml(axes @ np.eye(3)[order].T)}"


def _toml(matrix: FloatArray) -> str:
    if np.array_equal(np.abs(matrix), np.abs(matrix).round()):
        names = []
        for row in matrix:
            i = int(np.argmax(np.abs(row)))
            names.append(f'"{"-" if row[i] < 0.0 else ""}{"xyz"[i]}"')
        return f"[{', '.join(names)}]"
    return "[" + ", ".join(f"[{', '.join(f'{value:.6g}' for value in row)}]" for row in matrix) + "]"
