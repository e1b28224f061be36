"""A log without the rows and samples that were found to be wrong."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, Cells, LogFile
from elliptude.logs.order_of_rows import Rows
from elliptude.logs.repair import Survey


class Repaired:
    """A log without what a survey found. Rows count without those that are left out; places are those of the file.

    Parameters
    ----------
    file : LogFile
    found : Survey

    Raises
    ------
    FileError
        If something is wrong that cannot be left out.
    """

    def __init__(self, file: LogFile, found: Survey) -> None:
        if found.hopeless:
            raise FileError(f"{file.path}: {'; '.join(found.hopeless)}")
        self.found = found
        self.path = file.path
        self.columns = file.columns
        self.label = getattr(file, "label", "")
        self._file = file

    def stream(self, column: str) -> str:
        """See `LogFile`."""
        return self._file.stream(column)

    def holds_numbers(self, column: str) -> bool:
        """See `LogFile`."""
        return self._file.holds_numbers(column)

    def time_unit(self, column: str) -> str | None:
        """See `LogFile`."""
        return self._file.time_unit(column)

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """See `LogFile`."""
        return self._file.stamps(stream)

    def about(self, column: str) -> str:
        """See `LogFile`."""
        return self._file.about(column)

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        without = self._left_out(columns[0])
        first = 0
        for batch in self._file.batches(columns):
            count = len(batch[columns[0]].values)
            keep = np.ones(count, bool)
            keep[_within(without, first, count)] = False
            yield {name: self._cells(name, cells, keep, first) for name, cells in batch.items()}
            first += count

    def _cells(self, name: str, cells: Cells, keep: NDArray[np.bool_], first: int) -> Cells:
        empty = cells.empty.copy()
        empty[_within(self.found.samples.get(name, np.empty(0, np.intp)), first, len(empty))] = True
        return Cells(cells.values[keep], empty[keep])

    def _left_out(self, column: str) -> Rows:
        return self.found.rows.get(self._file.stream(column), np.empty(0, np.intp))

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return self._file.place(column, row_in_file(self._left_out(column), row))

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return self._file.places_of_rows([row_in_file(self._left_out(self.columns[0]), row) for row in rows])


def _within(rows: Rows, first: int, count: int) -> Rows:
    """The rows of a batch, counted in it."""
    begin, end = np.searchsorted(rows, [first, first + count])
    return rows[begin:end] - first


def row_in_file(left_out: Rows, row: int) -> int:
    """A row of the file, from 0, that is the given one of those that are left."""
    # The k-th row that is left out has left_out[k] - k rows that are kept before it.
    return row + int(np.searchsorted(left_out - np.arange(len(left_out)), row, side="right"))
