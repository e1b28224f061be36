"""The scale and the axes of a gyro that turns between rests leave possible; docs/theory.md, section 19.7.

The gyro shows ω̃ = (I + K) ω + b + v. Parameters are the nine entries of K' = K (I + K)⁻¹. Between two rests gravity
turns in body axes by the body's turn, and the integrated rates must agree with that.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.matrix_effects import chord_errors
from elliptude.bounds.turns import attitudes_from_rates, coning_angles, running_integral
from elliptude.calibration.parameter_sets import ParameterSet, covering_directions
from elliptude.calibration.vector_sensors import ContradictionError
from elliptude.typing import FloatArray

PARAMETERS = 9
_PASSES = 4
_HARDLY_SMALLER = 0.98
_ROUNDING = 1e-10
_AROUND = 8
"""Lines across gravity along which a turn's error is bounded, to either side."""


@dataclass(frozen=True, eq=False)
class Turn:
    """Rates from the middle of one rest to that of the next, and up at both ends."""

    times: FloatArray
    """s, shape (n,)."""
    rates: FloatArray
    """rad/s, the bias subtracted, shape (n, 3)."""
    up_before: FloatArray
    """Unit vector in body axes at the first row, shape (3,)."""
    up_after: FloatArray
    """In those at the last row."""
    angle_before: float
    """How far the first may be off, rad."""
    angle_after: float
    bias: float
    """Bound of what is left of the bias, rad/s."""


@dataclass(frozen=True, eq=False)
class GyroSet:
    """What turns leave possible of a gyro: (I - K̂') ω̃ is (I + K) ω + b + v with a smaller K."""

    inverse: FloatArray
    """K̂', shape (3, 3); zero where nothing is gained."""
    scale_error: float
    """Bound of ‖K‖ after the correction."""
    lowest: FloatArray
    """Least value of each entry of K', shape (3, 3)."""
    highest: FloatArray
    turns: int

    @property
    def matrix(self) -> FloatArray:
        """I - K̂', shape (3, 3)."""
        matrix: FloatArray = np.eye(3) - self.inverse
        return matrix

    @property
    def noise_factor(self) -> float:
        """What the correction makes of noise and bias, at most."""
        return float(np.linalg.norm(self.matrix, 2)) * (1.0 + 1e-12) if self.inverse.any() else 1.0


def gyro_set(turns: Sequence[Turn], gyro: GyroBounds, increment_over: float = math.inf) -> GyroSet:
    """All scale errors that agree with the turns.

    Parameters
    ----------
    turns : sequence of Turn
    gyro : GyroBounds
    increment_over : float
        The longest window, s, that ``gyro.increment`` is stated for. A longer turn is made of several.

    Raises
    ------
    ContradictionError
        If there are none.
    """
    k = gyro.scale_error
    largest = k / (1.0 - k)
    lowest, highest = np.full(PARAMETERS, -largest), np.full(PARAMETERS, largest)
    nothing = GyroSet(np.zeros((3, 3)), k, lowest.reshape(3, 3), highest.reshape(3, 3), len(turns))
    if not turns or k == 0.0:
        return nothing
    middle = np.zeros((3, 3))
    for _ in range(_PASSES):
        reach = np.maximum(highest - middle.ravel(), middle.ravel() - lowest).reshape(3, 3)
        left = min(_norm(reach), largest + float(np.linalg.norm(middle, 2)))
        slabs = [_slabs(turn, gyro, increment_over, middle, left) for turn in turns]
        rows, limits = np.concatenate([one[0] for one in slabs]), np.concatenate([one[1] for one in slabs])
        found = ParameterSet(lowest, highest, rows, limits)
        short = found.shortfall(0, np.ones(len(limits)))
        if short.least > _ROUNDING:
            shares = short.weights.reshape(len(turns), -1).sum(axis=1)
            worst = sorted(int(i) for i in np.argsort(-shares)[:3] if shares[i] > 0.0)
            places = ", ".join(f"{turns[i].times[0]:.2f} to {turns[i].times[-1]:.2f} s" for i in worst)
            raise ContradictionError(
                f"no scale and axes agree with the turns at {places}: they are at least "
                f"{np.rad2deg(short.least):.3g} degrees apart"
            )
        before = highest - lowest
        box = found.box()
        lowest, highest = np.maximum(lowest, box[0]), np.minimum(highest, box[1])
        middle = 0.5 * (lowest + highest).reshape(3, 3)
        if ((highest - lowest) > _HARDLY_SMALLER * before).all():
            break
    left = (1.0 + k) * _largest_norm(found, middle)
    entries = lowest.reshape(3, 3), highest.reshape(3, 3)
    if left < k:
        return GyroSet(middle, left, *entries, len(turns))
    return GyroSet(np.zeros((3, 3)), k, *entries, len(turns))


def _norm(sizes: FloatArray) -> float:
    """An upper bound of ‖X‖ for all X whose entries are at most these by magnitude: ‖X‖² ≤ ‖X‖₁ ‖X‖∞, and ‖X‖_F."""
    product = float(sizes.sum(axis=0).max() * sizes.sum(axis=1).max())
    return min(float(np.sqrt(product)), float(np.linalg.norm(sizes))) * (1.0 + 1e-12)


def _largest_norm(found: ParameterSet, middle: FloatArray) -> float:
    """An upper bound of ‖K' - middle‖ over the set, (19.15)."""
    directions, cosine = covering_directions(1)
    largest = 0.0
    for u in directions[: len(directions) // 2]:
        for v in directions:
            product = np.outer(u, v)
            largest = max(largest, found.support(product.ravel()) - float((product * middle).sum()))
    return float(largest / cosine**2)


def _slabs(
    turn: Turn, gyro: GyroBounds, increment_over: float, middle: FloatArray, left: float
) -> tuple[FloatArray, FloatArray]:
    """Inequalities for K' from one turn, (19.14), expanded about ``middle``; ‖K' - middle‖ is at most ``left``."""
    k = gyro.scale_error
    corrected = turn.rates - turn.rates @ middle.T
    steps = np.diff(turn.times)
    attitudes = attitudes_from_rates(steps, corrected)
    # In a step the rate is the mean of its ends; the frame turns, and the mean of its ends is off by its turn squared.
    means = 0.5 * (turn.rates[1:] + turn.rates[:-1])
    frames = 0.5 * (attitudes[1:] + attitudes[:-1])
    lever = np.einsum("n,nij,nk->ijk", steps, frames, means)
    stretch = 1.0 + float(np.linalg.norm(middle, 2))
    coned = float(coning_angles(steps, turn.rates).sum()) * stretch**3
    speeds = np.linalg.norm(turn.rates, axis=1)
    turned = float(running_integral(turn.times, speeds)[-1])
    sampled = left * stretch**2 * float(chord_errors(steps, turn.rates).sum()) + left * coned * turned
    duration = float(turn.times[-1] - turn.times[0])
    windows = max(1.0, math.ceil(duration / increment_over))
    noise = min(gyro.noise * duration, gyro.increment * (windows + turned * stretch))
    other = (noise + turn.bias * duration) / (1.0 - k) + coned
    all_rates = left * turned + (gyro.noise + turn.bias) * duration / (1.0 - k)
    error = left * turned + other
    first, last = 2.0 * np.sin(0.5 * turn.angle_before), 2.0 * np.sin(0.5 * turn.angle_after)
    bound = last + first * (1.0 + error) + 0.5 * error**2 + 0.5 * error * all_rates + other + sampled
    bound += 64.0 * float(np.finfo(np.float64).eps) * (len(turn.times) + turned)
    difference = attitudes[-1] @ turn.up_after - turn.up_before
    across = np.linalg.svd(turn.up_before[None])[2][1:]
    angles = np.arange(_AROUND) * np.pi / _AROUND
    rows, limits = [], []
    for e in np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1]:
        # e · (D × up) = (up × e) · D
        row = np.einsum("i,ijk->jk", np.cross(turn.up_before, e), lever).ravel()
        at_middle = float(row @ middle.ravel())
        rows += [row, -row]
        limits += [float(e @ difference) + bound + at_middle, -float(e @ difference) + bound - at_middle]
    return np.array(rows), np.array(limits)
