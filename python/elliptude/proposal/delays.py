"""How late a sensor is against another, or against a reference attitude."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.gyro import usual_longest, with_rounding
from elliptude.proposal.statistics import rotations_of
from elliptude.typing import FloatArray


@dataclass(frozen=True)
class DelayProposal:
    """How late a signal seems; s."""

    delay: float
    """Positive: what the signal shows at a stamp was true that much earlier."""
    pieces: int
    """How many pieces of the recording moved enough to show a delay."""
    scatter: float
    """The largest difference between a piece's delay and this one."""
    step: float
    """The step between samples, which limits how well the delay is known."""


def delay_of_rates(
    times: ArrayLike, angular_velocities: ArrayLike, attitudes: ArrayLike, *, limit: float = 0.1, piece: float = 8.0
) -> DelayProposal | None:
    """How late the gyro is against the reference, from the shift that makes both rates agree best.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    angular_velocities : (N, 3) array
        rad/s.
    attitudes : (N, 4) array
        The reference (qw, qx, qy, qz).
    limit : float
        Delays up to this size are tried, s.
    piece : float
        The recording is cut into pieces of this length, s.

    Returns
    -------
    DelayProposal or None
        None where nothing moves enough.
    """
    stamps, rates = np.asarray(times, dtype=np.float64), np.asarray(angular_velocities, dtype=np.float64)
    reference, known = rotations_of(attitudes)
    if len(stamps) < 3:
        return None
    spans = stamps[2:] - stamps[:-2]
    turns = np.full_like(rates, np.nan)
    turns[1:-1] = (reference[:-2].inv() * reference[2:]).as_rotvec() / spans[:, None]
    turns[1:-1][~(known[:-2] & known[2:])] = np.nan
    turns[1:-1][spans > with_rounding(usual_longest(spans), stamps)] = np.nan  # the gyro knows nothing about a gap
    return _delay(stamps, lambda shifted: rates - shifted, turns, limit, piece)


def delay_of_vectors(
    times: ArrayLike, vectors: ArrayLike, angular_velocities: ArrayLike, *, limit: float = 0.1, piece: float = 8.0
) -> DelayProposal | None:
    """How late a vector sensor is against the gyro, without a reference: b' = -ω × b holds with the ω of that time.

    For a vector that is constant in space: the magnetic field, or the specific force as far as gravity outweighs
    motion. Arguments are those of `delay_of_rates`.

    Returns
    -------
    DelayProposal or None
        None where nothing turns enough.
    """
    stamps, rows = np.asarray(times, dtype=np.float64), np.asarray(vectors, dtype=np.float64)
    rates = np.asarray(angular_velocities, dtype=np.float64)
    if len(stamps) < 3:
        return None
    # Both sides are means over about 0.1 s; otherwise noise hides the derivative.
    half = max(round(0.05 / float(np.median(np.diff(stamps)))), 1)
    if len(stamps) <= 2 * half:
        return None
    steps = np.diff(stamps)[:, None]
    spans = (stamps[2 * half :] - stamps[: -2 * half])[:, None]

    def difference(shifted: FloatArray) -> FloatArray:
        turning = -np.cross(shifted, rows)
        running = np.concatenate(
            [np.zeros((1, 3)), np.cumsum(0.5 * steps * np.nan_to_num(turning[1:] + turning[:-1]), axis=0)]
        )
        result = np.full_like(rows, np.nan)
        result[half:-half] = (
            (rows[2 * half :] - rows[: -2 * half]) - (running[2 * half :] - running[: -2 * half])
        ) / spans
        result[half:-half][spans[:, 0] > with_rounding(usual_longest(spans[:, 0]), stamps)] = (
            np.nan
        )  # reaches over a gap
        return result

    return _delay(stamps, difference, rates, limit, piece)


def _delay(
    times: FloatArray, difference: Callable[[FloatArray], FloatArray], signal: FloatArray, limit: float, piece: float
) -> DelayProposal | None:
    """The shift of ``signal`` at which the mean square of the difference is least, for the whole and for each piece."""
    step = float(np.median(np.diff(times)))
    most = min(round(limit / step), len(times) // 4)
    if most < 1:
        return None
    shifts = np.arange(-most, most + 1) * step
    # Pieces are as many as there are rows in, not as there are seconds.
    numbers = np.unique(np.floor((times - times[0]) / piece), return_inverse=True)[1]
    inside = (times >= times[0] + most * step) & (times <= times[-1] - most * step)
    sums: FloatArray = np.zeros((len(shifts), numbers[-1] + 1))
    counts = np.zeros_like(sums)
    for n, shift in enumerate(shifts):
        # The signal at the stamp less the delay.
        late = np.column_stack([np.interp(times - shift, times, column) for column in signal.T])
        squares = np.sum(difference(late) ** 2, axis=1)
        usable = inside & np.isfinite(squares)
        sums[n] = np.bincount(numbers[usable], squares[usable], len(sums[n]))
        counts[n] = np.bincount(numbers[usable], minlength=len(sums[n]))
    with np.errstate(invalid="ignore", divide="ignore"):
        costs: FloatArray = sums / counts
    whole: FloatArray = sums.sum(axis=1) / np.maximum(counts.sum(axis=1), 1.0)
    delay = _lowest(shifts, whole)
    if delay is None:
        return None
    moving = [_lowest(shifts, cost) for cost in costs.T]
    told = [one for one in moving if one is not None]
    scatter = max((abs(one - delay) for one in told), default=0.0)
    return DelayProposal(delay, len(told), scatter, step)


def _lowest(shifts: NDArray[np.floating[Any]], costs: NDArray[np.floating[Any]]) -> float | None:
    """Where a parabola through the least cost and its neighbours is least; None at an end or if the costs are flat."""
    if not np.isfinite(costs).all():
        return None
    n = int(np.argmin(costs))
    # Flat: no shift has twice the cost of the best one.
    if n in (0, len(costs) - 1) or costs.max() < 2.0 * costs[n]:
        return None
    left, middle, right = costs[n - 1 : n + 2]
    curvature = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    return float(shifts[n] + offset * (shifts[1] - shifts[0]))
