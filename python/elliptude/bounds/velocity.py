"""How fast a vehicle really went, as a receiver of satellites measures it: the mean of its acceleration over a window.

Needs only NumPy; SI units; rows are instants. Derivation: docs/theory.md, section 18.13.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.arguments import increasing_times, require_not_negative, vector_rows
from elliptude.bounds.turns import lengths_of
from elliptude.bounds.window_averages import Place, Window
from elliptude.typing import FloatArray


@dataclass(frozen=True, eq=False)
class MeasuredVelocity:
    """Measured velocities, and how far each may be off.

    Parameters
    ----------
    times : (M,) array_like
        When they were measured, s, increasing; need not be times of other sensors.
    velocities : (M, 3) array_like
        In any axes that do not turn or accelerate, as east, north and up; m/s. A row with NaN does not count.
    error : float
        Bound of the length of their error at the time on the stamp, m/s.
    largest_acceleration : float
        How fast the velocity changes at most, m/s²: for the time between a stamp and a row.
    time_offset : float
        How far a stamp may be off, s.

    Raises
    ------
    ValueError
        If times do not increase, or a bound is negative or not finite.
    """

    times: ArrayLike
    velocities: ArrayLike
    error: float
    largest_acceleration: float
    time_offset: float = 0.0

    def __post_init__(self) -> None:
        """Check; rows without a velocity are left out."""
        for name in ("error", "largest_acceleration", "time_offset"):
            require_not_negative(name, getattr(self, name))
        stamps = increasing_times(self.times)
        vectors = vector_rows("velocities", self.velocities, len(stamps))
        there = np.isfinite(vectors[:, 0])
        object.__setattr__(self, "times", stamps[there])
        object.__setattr__(self, "velocities", vectors[there])

    def at_rows(self, times: ArrayLike, at: Place, time_offset: float = 0.0) -> "VelocityOfRows":
        """What is known of the velocity at each row.

        Parameters
        ----------
        times : (N,) array_like
            Of the rows, s, increasing.
        at : {"end", "middle"}
            ``"end"``: from a velocity that was measured until then; ``"middle"``: from the one that is nearest in time.
        time_offset : float
            How far the rows' own times may be off, s.

        Returns
        -------
        VelocityOfRows
        """
        rows = increasing_times(times)
        stamps, vectors = np.asarray(self.times), np.asarray(self.velocities)
        unknown = VelocityOfRows(np.full((len(rows), 3), np.nan), np.full(len(rows), np.inf), np.zeros(len(rows), bool))
        if not len(stamps):
            return unknown
        after = np.searchsorted(stamps, rows, side="right")  # the first stamp behind a row
        before = np.maximum(after - 1, 0)
        chosen = before
        if at == "middle":
            behind = np.minimum(after, len(stamps) - 1)
            chosen = np.where(np.abs(stamps[behind] - rows) < np.abs(stamps[before] - rows), behind, before)
        away = np.abs(rows - stamps[chosen])
        errors = self.error + self.largest_acceleration * (away + self.time_offset + time_offset)
        # If rows share a stamp, the nearest of them counts: windows had best end there.
        order = np.lexsort((away, chosen))
        nearest = np.zeros(len(rows), dtype=np.bool_)
        nearest[order[np.concatenate([[True], np.diff(chosen[order]) > 0])]] = True
        known = np.ones(len(rows), dtype=np.bool_) if at == "middle" else after > 0
        return VelocityOfRows(
            np.where(known[:, None], vectors[chosen], np.nan), np.where(known, errors, np.inf), nearest & known
        )


@dataclass(frozen=True, eq=False)
class VelocityOfRows:
    """The velocity of N rows, and how far each may be off."""

    velocities: FloatArray
    """m/s, shape (N, 3); NaN where it is not known."""
    errors: FloatArray
    """Bound of the error's length, m/s, shape (N,); infinite where the velocity is not known."""
    nearest: NDArray[np.bool_]
    """Rows that are the nearest to a stamp, shape (N,)."""

    def take(self, rows: slice) -> "VelocityOfRows":
        """Some rows."""
        return VelocityOfRows(self.velocities[rows], self.errors[rows], self.nearest[rows])

    def ends(self, window: Window) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """First and last rows of windows within others that had best begin and end there.

        The row itself stays in its window; one that is a window's end stays that.
        """
        rows = np.arange(len(self.nearest))
        following = np.minimum.accumulate(np.where(self.nearest, rows, len(rows))[::-1])[::-1]
        previous = np.maximum.accumulate(np.where(self.nearest, rows, -1))
        start = np.where(following[window.start] < window.row, following[window.start], window.start)
        stop = np.where(previous[window.stop] > window.row, previous[window.stop], window.stop)
        return start, stop

    def mean_acceleration(self, window: Window, spans: FloatArray | None = None) -> FloatArray:
        """Bound of the mean acceleration with equal weights over each window, (18.48), m/s².

        Parameters
        ----------
        window : Window
        spans : (M,) array, optional
            How long these are at least in the motion's time, s; as long as their stamps say if left out.

        Returns
        -------
        (M,) array
        """
        spans = window.before + window.after if spans is None else spans
        change = lengths_of(self.velocities[window.stop] - self.velocities[window.start])
        error = self.errors[window.stop] + self.errors[window.start]
        most = np.where(np.isfinite(error), change + error, np.inf)
        bound: FloatArray = np.divide(most, spans, out=np.full_like(spans, np.inf), where=~(spans <= 0.0))
        return bound
