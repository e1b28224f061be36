"""How far a gyro's noise by itself turns an attitude away: docs/theory.md, (18.56)."""

import numpy as np

from elliptude.bounds.gyro import GyroBounds
from elliptude.typing import FloatArray
from elliptude.validation.recordings.turning import Turning

_ROWS = 512
"""Rows that are compared with all others at a time."""


def share_of_noise_turn(
    times: FloatArray, true: Turning, with_noise: Turning, bounds: GyroBounds, over: float
) -> float:
    """The largest turn by noise alone over any window, as a share of what is stated for as long.

    Parameters
    ----------
    times : (N,) array
        s; the ends of windows.
    true, with_noise : Turning
        How the body turns, and how a body that turned as the gyro's noise shows it.
    bounds : GyroBounds
        With a turn by noise.
    over : float
        The longest window that this is stated for, s.

    Returns
    -------
    float
    """
    away = with_noise.attitudes(times) @ true.attitudes(times).transpose(0, 2, 1)
    flat = away.reshape(-1, 9)
    largest = 0.0
    for first in range(0, len(times), _ROWS):
        rows = slice(first, first + _ROWS)
        # ‖A - B‖² / 2 is 3 - tr(A Bᵀ), which is 4 sin²(angle / 2).
        squares = np.maximum(3.0 - flat[rows] @ flat.T, 0.0)
        angles = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(squares), 1.0))
        apart = np.abs(times[rows, None] - times)
        stated = bounds.noise_turn + bounds.noise_turn_growth * apart
        largest = max(largest, float((angles / stated)[apart <= over * (1.0 + 1e-9)].max(initial=0.0)))
    return largest
