"""Chooses some rows of long results for a picture: more points than pixels show nothing more.

`Thinned` takes rows as they are estimated and keeps the worst of each group; `chosen_rows` has all rows, and keeps
every extreme that a curve shows.
"""

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.io.tables import Result
from elliptude.report.run import Run
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray

LIMIT = 10_000
"""Results with more rows are thinned, to between half of this and this."""


class Thinned:
    """Keeps from each group of rows the one with the truth furthest out, or without a truth the largest set.

    When there are too many rows, the groups double, so memory does not grow. A picture of what is left
    shows every escape that a picture of all would show.
    """

    def __init__(self) -> None:
        self._stride = 1
        self._rows = 0
        self._numbers: NDArray[np.intp] = np.empty(0, dtype=np.intp)
        self._kept: Result | None = None

    def add(self, result: Result) -> None:
        """Take the next rows."""
        numbers = np.arange(self._rows, self._rows + len(result.times))
        self._rows += len(numbers)
        worst = _worst(result, numbers // self._stride)
        part = chosen(result, worst)
        self._kept = part if self._kept is None else _joined(self._kept, part)
        self._numbers = np.concatenate([self._numbers, numbers[worst]])
        while len(self._numbers) > LIMIT:
            self._stride *= 2
            worst = _worst(self._kept, self._numbers // self._stride)
            self._kept, self._numbers = chosen(self._kept, worst), self._numbers[worst]

    def result(self) -> Result:
        """The rows that were kept.

        Raises
        ------
        ValueError
            If there was nothing.
        """
        if self._kept is None:
            raise ValueError("no rows were added")
        return self._kept


def _worst(result: Result, bins: NDArray[np.intp]) -> NDArray[np.intp]:
    """The worst row of each bin, in order."""
    size: FloatArray = np.where(np.isnan(result.largest_angles), np.inf, result.largest_angles)
    known = np.zeros(len(size), dtype=np.bool_)
    if result.forms is not None:
        known = np.isfinite(result.forms)
        size = np.where(known, result.forms, size)
    return largest_of_each(bins, known, size)


def largest_of_each(bins: NDArray[np.intp], *scores: NDArray[Any]) -> NDArray[np.intp]:
    """The first row of each bin with the largest score; if there are several scores, the first one counts most.

    Bins must not decrease, and no score may be NaN.
    """
    starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
    lengths = np.diff(starts, append=len(bins))
    best = np.ones(len(bins), dtype=np.bool_)
    for score in scores:
        left = np.where(best, score, -np.inf)
        best &= left == np.repeat(np.maximum.reduceat(left, starts), lengths)
    rows = np.flatnonzero(best)
    return rows[np.diff(bins[rows], prepend=bins[0] - 1) > 0]


def chosen(result: Result, rows: NDArray[np.intp]) -> Result:
    """Some rows of results."""

    def of(value: Any) -> Any:
        if value is None or isinstance(value, str | int):
            return value
        return value[rows] if isinstance(value, np.ndarray) else [value[row] for row in rows]

    return Result(**{field.name: of(getattr(result, field.name)) for field in fields(Result)})


def _joined(first: Result, second: Result) -> Result:
    def of(one: Any, other: Any) -> Any:
        if one is None or isinstance(one, str | int):
            return one
        return np.concatenate([one, other]) if isinstance(one, np.ndarray) else [*one, *other]

    return Result(
        **{field.name: of(getattr(first, field.name), getattr(second, field.name)) for field in fields(Result)}
    )


def worst_claims(claims: tuple[str, ...], chunks: list[slice]) -> list[str]:
    """The weakest claim in each piece of rows; empty if a row has none."""
    ranks = {word: rank for rank, word in enumerate((*CLAIMS, ""))}
    coded = np.array([ranks[word] for word in claims])
    order = (*CLAIMS, "")
    return [order[int(coded[chunk].max())] for chunk in chunks]


def prediction_shares(used: FloatArray, chunks: list[slice]) -> list[str]:
    """How many of a piece's rows with a set have the prediction in it: "every row", "some rows" or "none"."""
    shares = []
    for chunk in chunks:
        known = used[chunk][np.isfinite(used[chunk])]
        shares.append("every row" if len(known) and known.all() else "some rows" if known.any() else "none")
    return shares


def spans_unknown(times: FloatArray, known: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Where something is not known: from the last row in which it is to the next, for each such piece of a run.

    Parameters
    ----------
    times : (N,) array
        s.
    known : (N,) array of bool

    Returns
    -------
    list of (float, float)
        In order, at most a thousand: pieces that are nearer than a pixel are one.
    """
    changes = np.flatnonzero(np.diff(np.concatenate([[True], known, [True]])))
    if not len(changes):
        return []
    begins, ends = times[np.maximum(changes[::2] - 1, 0)], times[np.minimum(changes[1::2], len(times) - 1)]
    is_apart = begins[1:] - ends[:-1] > 1e-3 * (times[-1] - times[0])
    return list(zip(begins[np.append(True, is_apart)].tolist(), ends[np.append(is_apart, True)].tolist(), strict=True))


def pieces(count: int, most: int) -> list[slice]:
    """Rows 0 to ``count`` in at most ``most`` pieces of the same length, but for the last."""
    length = -(-count // most)
    return [slice(begin, min(begin + length, count)) for begin in range(0, count, length)]


def chosen_rows(run: Run, most: int) -> NDArray[np.intp]:
    """Rows to draw instead of all: every extreme stays, each row as it is.

    From each piece of rows: the first one, those of the largest and the smallest set, those whose error is nearest to
    the edge of the band on each axis or farthest beyond it, the ones with the largest form and tilt, those of the
    largest and the smallest roll, pitch and yaw, and the first one without a set. And those of nothing in
    gaps, with the rows beside them.

    Parameters
    ----------
    run : Run
    most : int
        Pieces. All rows are drawn if there are not more.

    Returns
    -------
    (K,) array
        Increasing, K at most 17 times ``most``, and three for each gap.
    """
    count = len(run.times)
    if count <= most:
        return np.arange(count)
    ratios = np.zeros((count, 0))
    if run.errors is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            shown = run.about_axes()
            assert shown.errors is not None
            ratios = np.abs(shown.errors) / shown.half_widths
    scores = [run.largest_angles, -run.largest_angles, *ratios.T]
    scores += [score for score in (run.forms, run.tilt_bounds, run.heading_bounds, run.up_bounds) if score is not None]
    if run.roll_pitch_yaw is not None:
        values = run.roll_pitch_yaw[:, ::3].T
        scores += [*values, *-values]
    scores = [np.where(np.isnan(score), -np.inf, score) for score in scores]
    some, is_gap = pieces(count, most), ~run.known
    bins = np.arange(count) // some[0].stop
    gaps = largest_of_each(bins, is_gap)
    rows = [np.array([piece.start for piece in some]), gaps[is_gap[gaps]]]
    if run.in_gap is not None:
        in_gap = np.flatnonzero(run.in_gap)
        rows += [in_gap - 1, in_gap, in_gap + 1]
    return np.unique(np.concatenate(rows + [largest_of_each(bins, score) for score in scores]))
