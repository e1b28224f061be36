"""Some rows of long results, for a picture: more points than pixels show nothing more."""

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.results import FloatArray
from elliptude.tables import Results

LIMIT = 10_000
"""Results of more rows are thinned, to between half as many and as many."""


class Thinned:
    """Of each so many rows the one with the truth furthest out, or without a truth the one with the largest set.

    How many rows stand for one doubles when there are too many, so memory does not grow. A picture of what is left
    shows every escape that a picture of all would show.
    """

    def __init__(self) -> None:
        self._stride = 1
        self._rows = 0
        self._numbers: NDArray[np.intp] = np.empty(0, dtype=np.intp)
        self._kept: Results | None = None

    def add(self, results: Results) -> None:
        """Take the next rows."""
        numbers = np.arange(self._rows, self._rows + len(results.times))
        self._rows += len(numbers)
        worst = _worst(results, numbers // self._stride)
        part = chosen(results, worst)
        self._kept = part if self._kept is None else _joined(self._kept, part)
        self._numbers = np.concatenate([self._numbers, numbers[worst]])
        while len(self._numbers) > LIMIT:
            self._stride *= 2
            worst = _worst(self._kept, self._numbers // self._stride)
            self._kept, self._numbers = chosen(self._kept, worst), self._numbers[worst]

    def results(self) -> Results:
        """What is left.

        Raises
        ------
        ValueError
            If there was nothing.
        """
        if self._kept is None:
            raise ValueError("no rows were added")
        return self._kept


def _worst(results: Results, bins: NDArray[np.intp]) -> NDArray[np.intp]:
    """The worst row of each bin, in order."""
    size: FloatArray = results.largest_angles
    known = np.zeros(len(size), dtype=np.bool_)
    if results.forms is not None:
        known = np.isfinite(results.forms)
        size = np.where(known, results.forms, size)
    order = np.lexsort((size, known, bins))
    last = np.append(np.flatnonzero(np.diff(bins[order])), len(order) - 1)
    return np.sort(order[last])


def chosen(results: Results, rows: NDArray[np.intp]) -> Results:
    """Some rows of results."""

    def of(value: Any) -> Any:
        if value is None or isinstance(value, str):
            return value
        return value[rows] if isinstance(value, np.ndarray) else [value[row] for row in rows]

    return Results(**{field.name: of(getattr(results, field.name)) for field in fields(Results)})


def _joined(first: Results, second: Results) -> Results:
    def of(one: Any, other: Any) -> Any:
        if one is None or isinstance(one, str):
            return one
        return np.concatenate([one, other]) if isinstance(one, np.ndarray) else [*one, *other]

    return Results(
        **{field.name: of(getattr(first, field.name), getattr(second, field.name)) for field in fields(Results)}
    )
