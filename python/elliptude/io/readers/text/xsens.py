"""Text that Xsens' MT Manager exports, with times for files without SampleTimeFine.

Not every device sends SampleTimeFine; the column may be there and empty. Then the time of day says when a sample was,
in seven columns. Or the counter of packets does, with the rate that a line above the header states, such as
``// Update Rate: 100.0Hz``. Either becomes a column of times like any other. Older versions of MT Manager call the rate
``Sample rate``, and the column ``Counter``.
"""

import os
import re
from collections.abc import Iterator, Sequence

import numpy as np

from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, Cells
from elliptude.io.readers.text.csv import CsvTable
from elliptude.io.readers.text.dialect import ALL_FOUND_OUT, Stated

STAMP = "SampleTimeFine"
COUNTER = "PacketCounter"
UTC_TIME, PACKET_TIME = "utc_ns", "packet_time_s"
"""Columns of times that no file has: since 1970 by the time of day, and by the counter."""

_TIME_OF_DAY = tuple(f"UTC_{part}" for part in ("Year", "Month", "Day", "Hour", "Minute", "Second", "Nano"))
_LEAST = np.array([1970, 1, 1, 0, 0, 0, 0])
# Nanoseconds since 1970 are 64 bits until 2262; a minute may have a leap second.
_MOST = np.array([2261, 12, 31, 23, 59, 60, 999_999_999])
_OLD_COUNTER = "Counter"
_RATE = re.compile(r"(?:update|sample)\s+rate\s*:\s*(\d+(?:[.,]\d+)?)\s*hz", re.IGNORECASE)
# A counter of 16 bits: it begins anew.
_COUNTS = 65_536


class XsensTable(CsvTable):
    """A CSV file with PacketCounter. Without SampleTimeFine it has columns of times instead, as far as it says them.

    Parameters
    ----------
    path, stated, lenient
        As in `CsvTable`.
    """

    def __init__(self, path: str | os.PathLike[str], stated: Stated = ALL_FOUND_OUT, *, lenient: bool = False) -> None:
        super().__init__(path, stated, lenient=lenient)
        rates = _rates(self)
        self._counter = COUNTER if COUNTER in self.written else _OLD_COUNTER
        self.rate_hz = stated.packet_rate_hz or (rates[0] if rates else 0.0)
        """Packets in a second, by the user or by a line above the header; 0 if neither says it."""
        there = self._first_cells.keys()
        self._sources: dict[str, tuple[str, ...]] = {}
        if STAMP not in there:
            if there >= set(_TIME_OF_DAY):
                self._sources[UTC_TIME] = _TIME_OF_DAY
            if self._counter in there and self.rate_hz > 0.0:
                self._sources[PACKET_TIME] = (self._counter,)
        self.columns = tuple(dict.fromkeys((*self.written, *self._sources)))

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        read = [source for name in columns for source in self._sources.get(name, (name,))]
        count = _Count()
        for batch in super().batches(list(dict.fromkeys(read))):
            found = dict(batch)
            if UTC_TIME in columns and UTC_TIME in self._sources:
                found[UTC_TIME] = _since_1970([batch[name] for name in _TIME_OF_DAY])
            if PACKET_TIME in columns and PACKET_TIME in self._sources:
                counted = count.on(batch[self._counter])
                found[PACKET_TIME] = Cells(counted.values / self.rate_hz, counted.empty)
            yield {name: found[name] for name in columns}

    def place(self, column: str, row: int) -> str:
        """See `LogFile`; of a column that no file has, where it comes from."""
        if column in self._sources and column == UTC_TIME:
            line, first, last = self.places_of_rows([row])[0], _TIME_OF_DAY[0], _TIME_OF_DAY[-1]
            return f"{line}, columns {first} to {last} (a time of day)"
        return super().place(self._counter if column in self._sources else column, row)


def open_table(path: str | os.PathLike[str], stated: Stated = ALL_FOUND_OUT, *, lenient: bool = False) -> CsvTable:
    """Open a CSV file as what it is: Xsens' have PacketCounter, or older ones Counter and a rate.

    Parameters
    ----------
    path, stated, lenient
        As in `CsvTable`.

    Raises
    ------
    FileError
        If it cannot be read, or the rate of packets is stated and there is no PacketCounter.
    """
    table = CsvTable(path, stated, lenient=lenient)
    if COUNTER in table.columns or (_OLD_COUNTER in table.columns and (stated.packet_rate_hz or _rates(table))):
        return XsensTable(path, stated, lenient=lenient)
    if stated.packet_rate_hz is not None:
        raise FileError(f"{path}: packet_rate_hz is of the column {COUNTER}, and there is none")
    return table


def _rates(table: CsvTable) -> list[float]:
    """The rates that lines above the header state, Hz."""
    return [float(match[1].replace(",", ".")) for line in table.comments if (match := _RATE.search(line))]


class _Count:
    """Counts on where a counter begins anew. A step of more than half its counts is one back."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._counted = 0.0

    def on(self, cells: Cells) -> Cells:
        there = ~cells.empty & np.isfinite(cells.values)
        counts = cells.values[there].astype(np.float64)
        counted = np.full(len(there), np.nan)
        if len(counts):
            if self._last is None:
                self._last = self._counted = float(counts[0])
            steps = np.diff(counts, prepend=self._last)
            counted[there] = self._counted + np.cumsum((steps + _COUNTS / 2) % _COUNTS - _COUNTS / 2)
            self._last, self._counted = float(counts[-1]), float(counted[there][-1])
        return Cells(counted, ~there)


def _since_1970(parts: Sequence[Cells]) -> Cells:
    """Nanoseconds by the parts of a time of day; empty where they are none."""
    values = np.column_stack([part.values for part in parts]).astype(np.float64)
    empty = np.any([part.empty for part in parts], axis=0)
    with np.errstate(invalid="ignore"):
        empty |= ~((values >= _LEAST) & (values <= _MOST) & (values == np.floor(values))).all(axis=1)
    year, month, day, hour, minute, second, nano = np.where(empty[:, None], _LEAST, values).astype(np.int64).T
    months = ((year - 1970) * 12 + month - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + day - 1
    return Cells((((days * 24 + hour) * 60 + minute) * 60 + second) * 1_000_000_000 + nano, empty)
