"""Times for a file that has none: its rows come at a stated rate."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, Cells, LogFile

ROW_TIME = "row_time_s"
"""The column that no file has: the number of a row over the rows in a second, from 0."""


class CountedRows:
    """A file with a column of times besides, `ROW_TIME`, for the stream with the most columns.

    Parameters
    ----------
    file : LogFile
    rate_hz : float
        Rows in a second, more than 0.

    Raises
    ------
    FileError
        If streams have stamps of their own.
    """

    def __init__(self, file: LogFile, rate_hz: float) -> None:
        self.file = file
        self.path: os.PathLike[str] = file.path
        self._rate = rate_hz
        if ROW_TIME in file.columns:
            raise FileError(f"{file.path}: it has a column {ROW_TIME} itself: take it for the times")
        streams = Counter(file.stream(column) for column in file.columns if file.holds_numbers(column))
        if any(file.stamps(stream) is not None for stream in streams):
            raise FileError(f"{file.path}: it has stamps of its own: leave out the rate of its rows")
        self._stream = streams.most_common(1)[0][0] if streams else ""
        self.columns = (*file.columns, ROW_TIME)

    def stream(self, column: str) -> str:
        """See `LogFile`."""
        return self._stream if column == ROW_TIME else self.file.stream(column)

    def holds_numbers(self, column: str) -> bool:
        """See `LogFile`."""
        return column == ROW_TIME or self.file.holds_numbers(column)

    def time_unit(self, column: str) -> str | None:
        """See `LogFile`."""
        return None if column == ROW_TIME else self.file.time_unit(column)

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """None has any."""
        return None

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        others = [column for column in columns if column != ROW_TIME]
        # Something must be read to count rows.
        read = others or [
            next(one for one in self.file.columns if self.stream(one) == self._stream and self.holds_numbers(one))
        ]
        first = 0
        for batch in self.file.batches(read):
            count = len(batch[read[0]].empty)
            found = {column: batch[column] for column in others}
            if ROW_TIME in columns:
                times = np.arange(first, first + count) / self._rate
                found[ROW_TIME] = Cells(times, np.zeros(count, bool))
            first += count
            yield {column: found[column] for column in columns}

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        if column != ROW_TIME:
            return self.file.place(column, row)
        return next(iter(self.file.places_of_rows([row])), f"row {row + 1}")

    def about(self, column: str) -> str:
        """See `LogFile`."""
        return self.file.about(column)

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return self.file.places_of_rows(rows)
