"""Arrays in memory, read as a file is."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from elliptude.io.readers.base import Batch, NumbersAlone, numbered
from elliptude.typing import FloatArray


class ArrayLog(NumbersAlone):
    """Columns in memory. Their names are those of a slice, such as ``gyr[:, 0]``; NaN is what was not measured."""

    def __init__(self, columns: Mapping[str, FloatArray], name: str) -> None:
        self.path: os.PathLike[str] = Path(name)
        self._values = dict(columns)
        self.columns = tuple(columns)

    def stream(self, column: str) -> str:
        """All columns share their rows."""
        return ""

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """All rows in one batch."""
        yield {column: numbered(self._values[column]) for column in columns}

    def place(self, column: str, row: int) -> str:
        """As a program writes it: ``gyr[812, 0]``."""
        return column.replace(":", str(row))

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """Rows from 0."""
        return [f"row {row}" for row in rows]
