"""The interface of a log file: its columns, their numbers in batches, and where a fault is.

The place in a message is one that a person can go to: the line of a CSV file, from 1 and with comments and header, or
the row of another file, from 1.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from elliptude.io.files import FileError, did_you_mean

BATCH_ROWS = 1 << 17
"""Rows of a Parquet file, or messages of a bag, that are read at a time."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Some rows of a column."""

    values: NDArray[np.float64] | NDArray[np.int64]
    """Shape (N,); whole numbers that a double does not hold are int64."""
    empty: NDArray[np.bool_]
    """Which cells are empty, or NaN in a format without empty cells; shape (N,)."""


Batch: TypeAlias = Mapping[str, Cells]
"""Some rows of some columns, as many of each."""


class LogFile(Protocol):
    """A file of one or more streams. A stream is a group of columns that share their rows."""

    path: os.PathLike[str]
    """Where it is; as text, what messages call it."""
    columns: tuple[str, ...]

    def stream(self, column: str) -> str:
        """The stream that a column belongs to; "" where the file has but one."""

    def holds_numbers(self, column: str) -> bool:
        """Whether a column has numbers, as far as is visible without reading it all."""

    def time_unit(self, column: str) -> str | None:
        """The unit of a column of times, since 1970, if its cells are times of day and not numbers."""

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """The column and the unit of a stream's own time stamps, if the format defines them."""

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """Some columns of one stream, from the first row to the last.

        Raises
        ------
        FileError
            If the file cannot be read, or a cell is no number; with its place.
        """

    def place(self, column: str, row: int) -> str:
        """Where a cell is, for a message: "line 812, column 9 (sun_bx)". ``row`` counts from 0 in its stream."""

    def about(self, column: str) -> str:
        """What a message says of a column beside its name, or of one that is not there; empty if that is nothing."""

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """Where rows are, for messages: "line 812"; empty if the streams do not share their rows.

        The file is read at most once, however many rows there are.
        """


class Table(LogFile, Protocol):
    """A file of rows and columns, its header read."""

    label: str
    """Kind and version, if it is elliptude's."""

    def read(self, numbers: list[str], texts: list[str]) -> pa.Table:
        """The columns: float64, where null is an empty cell, and text."""

    def refuse(self, bad: NDArray[np.bool_], name: str, fault: str) -> None:
        """Raise FileError for the first bad row of a column, if there is one."""


class NumbersAlone:
    """What files of numbers have in common: no times of day, and no stamps of their own."""

    def holds_numbers(self, column: str) -> bool:
        """All do."""
        return True

    def time_unit(self, column: str) -> str | None:
        """No column has times of day."""
        return None

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """Any column may hold the times."""
        return None

    def about(self, column: str) -> str:
        """Nothing."""
        return ""


def require_columns(file: LogFile, names: Sequence[str]) -> None:
    """Raise FileError unless each column is there, once.

    Parameters
    ----------
    file : LogFile
    names : sequence of str

    Raises
    ------
    FileError
        With the existing columns.
    """
    for name in names:
        if file.columns.count(name) != 1:
            listed = [repr(one) if set(one) & set(",;|\t") else one for one in file.columns]
            there_are = f"the columns are {', '.join(listed)}" if listed else "it has no columns"
            if len(listed) == 1 and listed != list(file.columns):
                there_are = f"the whole header is one column, {listed[0]}: csv.delimiter says what separates columns"
            there_are = there_are if len(there_are) <= 320 else f"{there_are[:316]} ..."
            fault = "two columns" if name in file.columns else "no column"
            meant = "" if name in file.columns else did_you_mean(name, file.columns)
            about = f": {said}" if (said := file.about(name)) else ""
            raise FileError(f"{file.path}: {fault} {name!r}{about or meant}; {there_are}")


def numbered(values: NDArray[np.generic]) -> Cells:
    """The cells of an array of numbers, in which NaN is what was not measured.

    Parameters
    ----------
    values : (N,) array
        Booleans, integers or floats.

    Returns
    -------
    Cells
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8:
        return Cells(values.astype(np.int64), np.zeros(len(values), bool))
    numbers = values.astype(np.float64)
    return Cells(numbers, np.isnan(numbers))


def cells_of(column: pa.Array, large: bool) -> Cells:
    """The cells of an Arrow array of numbers, as int64 if a double might lose digits."""
    # By DLPack, as PyArrow's `to_numpy` imports pandas, which takes longer than to read a small file.
    empty = np.from_dlpack(column.is_null().cast(pa.uint8())).astype(np.bool_)
    if large:
        return Cells(np.where(empty, 0, _stored(column.cast(pa.int64()))), empty)
    return Cells(np.where(empty, np.nan, _stored(column.cast(pa.float64()))), empty)


def _stored(column: pa.Array) -> NDArray[Any]:
    """What is stored of each cell, also of an empty one, where it means nothing."""
    _, data = column.buffers()
    return np.from_dlpack(pa.Array.from_buffers(column.type, len(column), [None, data], offset=column.offset))
