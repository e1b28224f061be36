"""True attitudes from angular velocities that are on lines, piece by piece; how far two of them turn apart."""

import numpy as np
import scipy

from elliptude.bounds.gyro import GyroBounds
from elliptude.typing import FloatArray

# rad; over a longer turn a piece is divided. The series of a step is off by less than the rounding of a double then.
_LONGEST_TURN = 0.02
_ROWS = 512
"""Rows that are compared with all others at a time."""


class Turning:
    """How a body turns whose angular velocity, in body axes, is on a line in each of M pieces, and may jump between.

    Parameters
    ----------
    times : (M + 1,) array
        Where pieces begin and end, s, increasing.
    begins, ends : (M, 3) array
        The rate at both ends of each piece, rad/s.
    """

    def __init__(self, times: FloatArray, begins: FloatArray, ends: FloatArray) -> None:
        spans = np.diff(times)
        fastest = np.maximum(np.linalg.norm(begins, axis=1), np.linalg.norm(ends, axis=1))
        parts = np.maximum(np.ceil(fastest * spans / _LONGEST_TURN), 1.0).astype(np.intp)
        piece = np.repeat(np.arange(len(spans)), parts)
        place = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
        from_share, to_share = place / parts[piece], (place + 1.0) / parts[piece]
        change = (ends - begins)[piece]
        self.times = np.append(times[piece] + from_share * spans[piece], times[-1])
        self.begins = begins[piece] + from_share[:, None] * change
        self.ends = begins[piece] + to_share[:, None] * change
        turns = scipy.spatial.transform.Rotation.from_rotvec(
            _turn(np.diff(self.times), self.begins, self.ends)
        ).as_matrix()
        attitudes = np.empty((len(self.times), 3, 3))
        attitudes[0] = np.eye(3)
        for i, turn in enumerate(turns):
            attitudes[i + 1] = attitudes[i] @ turn
        # What rounding has made of their lengths would be an error of every vector.
        self._attitudes: FloatArray = scipy.spatial.transform.Rotation.from_matrix(attitudes).as_matrix()

    def set_attitude(self, time: float, attitude: FloatArray) -> None:
        """Let the body have an attitude (3, 3), from body to reference axes, at a time, s."""
        there = self.attitudes(np.array([time]))[0]
        self._attitudes = (attitude @ there.T) @ self._attitudes

    def attitudes(self, times: FloatArray) -> FloatArray:
        """From body to reference axes at times of any order, s, shape (..., 3, 3)."""
        piece = self._piece(times)
        rates = self._rates(times, piece)
        turns = scipy.spatial.transform.Rotation.from_rotvec(
            _turn(times - self.times[piece], self.begins[piece], rates)
        ).as_matrix()
        attitudes: FloatArray = self._attitudes[piece] @ turns
        return attitudes

    def rates(self, times: FloatArray) -> FloatArray:
        """Angular velocities, rad/s, body axes; where they jump, those behind it."""
        return self._rates(times, self._piece(times))

    def _piece(self, times: FloatArray) -> FloatArray:
        return np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.begins) - 1)

    def _rates(self, times: FloatArray, piece: FloatArray) -> FloatArray:
        share = (times - self.times[piece]) / (self.times[piece + 1] - self.times[piece])
        rates: FloatArray = self.begins[piece] + share[..., None] * (self.ends - self.begins)[piece]
        return rates


def share_of_noise_turn(
    times: FloatArray, true: Turning, with_noise: Turning, bounds: GyroBounds, over: float
) -> float:
    """The largest turn by noise alone over any window, as a share of what is stated for as long, (18.56).

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


def _turn(spans: FloatArray, begins: FloatArray, ends: FloatArray) -> FloatArray:
    """Rotation vectors of steps with a rate on a line, by Magnus' series of the sixth order, rad."""
    # Cᵀ' = -S(ω) Cᵀ: the series of a = -ω h in the middle and its change d, of which [S(a), S(d)] = S(a × d).
    middle, change = -0.5 * (begins + ends) * spans[:, None], -(ends - begins) * spans[:, None]
    first = np.cross(middle, change)
    second = -np.cross(middle, first) / 60.0
    turns: FloatArray = -(middle + np.cross(-20.0 * middle + first, change + second) / 240.0)
    return turns
