"""The frame that a gyro carries along, and how far it may have turned away: docs/theory.md, sections 18.4 and 18.14."""

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.turns import attitudes_from_rates, coning_angles, from_the_first, lengths_of, running_sum
from elliptude.typing import FloatArray


class CarriedFrame:
    """Attitudes at the rows of a gyro, and running bounds of their error.

    Over a gap the frame turns at the mean of the rates around it, which is known within an angle. Where no angle is
    known the gap is closed: nothing is carried across.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    rates : (N, 3) array
        rad/s, body axes, the known bias subtracted.
    gaps : (N - 1,) array of bool
        Steps between rows that the gyro's bounds do not cover.
    gyro : GyroBounds
    bias_known : float
        When the bias was known, s.
    """

    def __init__(
        self, times: FloatArray, rates: FloatArray, gaps: NDArray[np.bool_], gyro: GyroBounds, bias_known: float
    ) -> None:
        self.since_known = times - bias_known
        steps = np.diff(times)
        angles = _gap_angles(steps, rates, gaps, gyro, self.since_known)
        closed = gaps & ~(angles < np.pi)
        # Sums across a closed gap would leave no digits for the rows behind it.
        steps = np.where(closed, 0.0, steps)
        speeds = lengths_of(rates)
        self.steps, self.rates = steps, rates
        self.covered_steps = np.where(gaps, 0.0, steps)
        """Steps that the gyro's bounds cover, s; 0 for gaps."""
        self.attitudes = attitudes_from_rates(steps, rates)
        """To the axes of the first row, shape (N, 3, 3)."""
        self.elapsed = from_the_first(steps)
        """Time since the first row without closed gaps, s."""
        self.turned = running_sum(steps, speeds)
        """The angle turned since then, rad."""
        self.apart = from_the_first(np.where(gaps, np.where(closed, 0.0, angles), coning_angles(steps, rates)))
        """Bounds of how far turns at mean rates are from those at rates on lines, and from the truth in gaps, rad."""
        self.steady = running_sum(steps, gyro.steady_error(speeds, self.since_known)) + self.apart
        """Bounds of the angle without the noise, rad."""
        self.closed = np.concatenate([[0], np.cumsum(closed)])
        """How many closed gaps there are before each row."""
        self.gaps = np.concatenate([[0], np.cumsum(gaps)])
        """How many gaps there are before each row."""


def _gap_angles(
    steps: FloatArray, rates: FloatArray, gaps: NDArray[np.bool_], gyro: GyroBounds, since_known: FloatArray
) -> FloatArray:
    """Bounds of the angle between each gap's turn and one at the mean of the rates around it, rad; 0 elsewhere."""
    angles = np.zeros(len(steps))
    where = np.flatnonzero(gaps)
    if len(where):
        durations, begin, end = steps[where], rates[where], rates[where + 1]
        with np.errstate(over="ignore", invalid="ignore"):
            by_change = gyro.angles_across_gaps(durations, begin, end, since_known[where + 1])
            by_rate = durations * (gyro.largest_rate + 0.5 * lengths_of(begin + end))
        angles[where] = np.fmin(by_change, by_rate)
    return angles
