"""Gaps between rows: where no curve goes on, as nothing is known of what the body did there.

A step between rows is a gap if the bounds of the rate do not cover an interval as long. What is drawn over time is
drawn from rows with a row of nothing in each gap: `broken`.
"""

import heapq
from dataclasses import fields, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.gyro import with_rounding
from elliptude.io.tables import Result
from elliptude.report.run import Run
from elliptude.report.thinning import pieces
from elliptude.typing import FloatArray

MOST_GAPS = 1000
"""The longest gaps that are drawn: of more, none is as wide as a pixel."""

_ByRows = TypeVar("_ByRows", Result, Run)
_Gaps = list[tuple[float, float]]


class LongSteps:
    """The longest steps between rows that come piece by piece."""

    def __init__(self) -> None:
        self._last = np.empty(0)
        self._largest = 0.0
        self._found: list[tuple[float, float, float]] = []

    def add(self, times: FloatArray) -> None:
        """Take the next rows, by their times, s."""
        times = np.concatenate([self._last, times])
        self._last, self._largest = times[-1:], max(self._largest, float(np.abs(times).max(initial=0.0)))
        steps = np.diff(times)
        rows = np.argsort(-steps, kind="stable")[:MOST_GAPS]
        more = [(float(steps[row]), float(times[row]), float(times[row + 1])) for row in rows]
        self._found = heapq.nlargest(MOST_GAPS, self._found + more)

    def gaps(self, longest: float | None) -> _Gaps:
        """From and to which time, s, each step goes that is longer than ``longest``, s; none if that is None."""
        if longest is None:
            return []
        limit = with_rounding(longest, np.array([self._largest]))
        return sorted((begin, end) for step, begin, end in self._found if step > limit)


def gaps_of(run: Run) -> _Gaps:
    """From and to which time, s, each gap between a run's rows goes, also if the run has been broken there."""
    if run.in_gap is not None:
        return [(float(run.times[row - 1]), float(run.times[row + 1])) for row in np.flatnonzero(run.in_gap)]
    steps = LongSteps()
    steps.add(run.times)
    return steps.gaps(run.longest_step)


def broken(rows: _ByRows, gaps: _Gaps) -> _ByRows:
    """Rows with one of nothing in the middle of each gap, so that no curve through them crosses it.

    Parameters
    ----------
    rows : Result or Run
    gaps : list of (float, float)
        From and to which time, s, in order.

    Returns
    -------
    Result or Run
    """
    if not gaps:
        return rows
    middles = [0.5 * (begin + end) for begin, end in gaps]
    places, count = np.searchsorted(rows.times, middles), len(rows.times)

    def of(name: str, value: Any) -> Any:
        if name == "times":
            return np.insert(value, places, middles)
        if isinstance(value, np.ndarray):
            return np.insert(value.astype(np.float64), places, np.nan, axis=0)
        words = np.insert(np.array(value, dtype=object), places, "")
        return tuple(words) if isinstance(value, tuple) else list(words)

    named = ("used", "refused", "dropped", "claims", "up_claims", "best_tilt_claims", "best_from")
    found = {one.name: getattr(rows, one.name) for one in fields(rows)}
    of_rows = {
        name: of(name, value)
        for name, value in found.items()
        if (name in named and value is not None) or (isinstance(value, np.ndarray) and len(value) == count)
    }
    if isinstance(rows, Run):
        of_rows["in_gap"] = np.insert(np.zeros(count, dtype=np.bool_), places, True)
    return replace(rows, **of_rows)


class Piece(NamedTuple):
    """Some rows of a run, none of which is nothing in a gap, and from and to which time they are drawn as a bar."""

    rows: slice
    begin: float
    end: float


def pieces_between_gaps(run: Run, most: int, end: float) -> list[Piece]:
    """A run's rows in at most so many pieces, and one more for each gap that is in one.

    Each goes on until the next one begins, the last one until ``end``, s; before a gap for no more than a usual step.
    """
    count = len(run.times)
    is_gap = np.zeros(count, dtype=np.bool_) if run.in_gap is None else run.in_gap
    steps = np.diff(run.times[~is_gap])
    usual = float(np.median(steps)) if len(steps) else 0.0
    found = []
    for piece in pieces(count, most):
        rows = np.flatnonzero(~is_gap[piece]) + piece.start
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if not len(part):
                continue
            stop = int(part[-1]) + 1
            until = end if stop == count else float(run.times[stop])
            if stop < count and is_gap[stop]:
                until = min(until, float(run.times[part[-1]]) + usual)
            found.append(Piece(slice(int(part[0]), stop), float(run.times[part[0]]), until))
    return found


def alone(values: FloatArray) -> NDArray[np.intp]:
    """Where a number has none beside it, so that no line is drawn through it."""
    there = np.concatenate([[False], np.isfinite(values), [False]])
    return np.flatnonzero(there[1:-1] & ~there[:-2] & ~there[2:])
