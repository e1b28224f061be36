"""Which rows of a clock are out of order, and what is left out for the others to be in order."""

from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elliptude.typing import FloatArray

# Two rows that are further apart than this share of the usual step may be neighbours, and have room for no other.
_A_STEP = 0.9
# The same where a stamp is far ahead, so that rows behind it that go on from the row before it are no chance.
_A_SHORT_STEP = 0.75
# Long steps that are far.
_FAR = 3.0
# A step that so many of all are shorter than is a long one, but no pause.
_NO_PAUSE = 0.95
# Counters of time, and what one of their ticks may be in the unit of the column.
_COUNTER_BITS = (16, 24, 31, 32)
_COUNTER_TICKS = (1.0, 1e-3, 1e-6, 1e-9)
# Usual steps: a counter has so many at least, and a row or two may be lost where it begins anew.
_LEAST_OF_COUNTER = 100.0
_LOST_BESIDE = 3.0

Rows: TypeAlias = NDArray[np.intp]


def counter_size(times: FloatArray, row: int) -> float | None:
    """After how much a counter begins anew that does so before a row; None if no usual one would go on at that row."""
    steps = np.diff(times)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else np.inf
    for size in (2.0**bits * tick for bits in _COUNTER_BITS for tick in _COUNTER_TICKS):
        if size > _LEAST_OF_COUNTER * usual and 0.0 < size + steps[row - 1] < _LOST_BESIDE * usual:
            return size
    return None


def out_of_order(times: FloatArray, marks: NDArray[Any]) -> tuple[Rows, Rows, Rows]:
    """Rows to leave out because they are late or ahead, and those at which the clock was set back for good.

    A row may be left out if the others show that its own stamp alone is wrong: there is room for it between its
    neighbours, or at its stamp, or it repeats a row. After a clock is set back rows go on at once: there is no room.
    Where there is room for many more rows than these, the log paused, and the clock may have been set in the pause.
    """
    late: list[int] = []
    ahead: list[int] = []
    hopeless: list[int] = []
    steps = np.diff(times)
    if not (steps < 0.0).any():
        return (np.empty(0, np.intp),) * 3
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    long = float(np.quantile(steps[steps > 0.0], _NO_PAUSE)) if (steps > 0.0).any() else 0.0

    def have_room(count: int, room: float, step: float = _A_STEP) -> bool:
        """Whether the time between two rows is that of this many rows, and a lost one perhaps."""
        return step * (count + 1) * usual <= room <= (count + 2) * long

    latest, before = 0, -1  # the last row that is kept, and the one before it
    i = 1
    while i < len(times):
        if times[i] >= times[latest]:
            before, latest = latest, i
            i += 1
            continue
        room = np.inf if before < 0 else times[i] - times[before]
        goes_on = i + 1 >= len(times) or times[i + 1] >= times[i]
        end = i + int(np.argmax(times[i:] > times[latest])) if (times[i:] > times[latest]).any() else len(times)
        run = np.arange(i, end)
        after = times[end] if end < len(times) else np.inf
        repeats = all(_is_repeated(int(row), latest, times, marks) for row in run[:1000]) and len(run) <= 1000
        fits = repeats or (end < len(times) and have_room(len(run), after - times[latest]))
        if end < len(times) or len(run) == 1:
            fits = fits or _have_places(times[run], np.append(times[max(i - 1000, 0) : i], times[end : end + 1]), usual)
        is_far = times[latest] - times[i] > _FAR * long
        has_room = before < 0 or have_room(1, room, _A_SHORT_STEP if is_far else _A_STEP)
        if len(run) > 1 and goes_on and has_room and not repeats:
            ahead.append(latest)
            latest = i
            i += 1
        elif fits:
            late += run.tolist()
            i = end
        else:
            hopeless.append(i)
            latest, before = i, -1
            i += 1
    return tuple(np.array(rows, dtype=np.intp) for rows in (late, ahead, hopeless))  # type: ignore[return-value]


def _is_repeated(row: int, latest: int, times: FloatArray, marks: NDArray[Any]) -> bool:
    """Whether an earlier row has the same stamp and the same values."""
    begin = max(latest - 1000, 0)
    same = times[begin : latest + 1] == times[row]
    return bool((same & (marks[begin : latest + 1] == marks[row]).all(axis=1)).any())


def _have_places(late: FloatArray, others: FloatArray, usual: float) -> bool:
    """Whether rows that are late would be a step away from all others if they stood in the order of time."""
    ordered = np.sort(np.concatenate([np.unique(others), late]))
    near = (ordered >= late.min() - 2.0 * usual) & (ordered <= late.max() + 2.0 * usual)
    return bool(len(late) <= 1000 and (np.diff(ordered[near]) >= _A_STEP * usual).all())


def contradicting(times: FloatArray, marks: NDArray[np.uint64], left_out: NDArray[np.bool_]) -> Rows:
    """Rows in which a sensor has another sample at the same time, with other values."""
    there = np.flatnonzero((marks != 0) & ~left_out & ~np.isnan(times))
    ends = np.flatnonzero(np.diff(times[there], prepend=np.nan, append=np.nan) != 0.0)
    if len(ends) == len(there) + 1:
        return np.empty(0, np.intp)
    groups = [there[a:b] for a, b in pairwise(ends) if b - a > 1 and len(np.unique(marks[there[a:b]])) > 1]
    return np.concatenate(groups) if groups else np.empty(0, np.intp)
