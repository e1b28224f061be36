"""What the readers of CSV and Parquet have in common: Arrow."""

from typing import Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from elliptude.io.readers.base import Cells, LogFile


class Table(LogFile, Protocol):
    """A file of rows and columns, its header read."""

    label: str
    """Kind and version, if it is elliptude's."""

    def read(self, numbers: list[str], texts: list[str]) -> pa.Table:
        """The columns: float64, where null is an empty cell, and text."""

    def refuse(self, bad: NDArray[np.bool_], name: str, fault: str) -> None:
        """Raise FileError for the first bad row of a column, if there is one."""


def cells_of(column: pa.Array, large: bool) -> Cells:
    """The cells of an Arrow array of numbers, as int64 if a double might lose digits."""
    empty = np.asarray(column.is_null().to_numpy(zero_copy_only=False), dtype=np.bool_)
    if large:
        return Cells(np.asarray(column.cast(pa.int64()).fill_null(0)), empty)
    return Cells(np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False)), empty)
