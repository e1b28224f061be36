"""CSV files, read batch by batch, so that memory does not grow with the file."""

import csv
import io
import os
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from elliptude.io.files import FileError
from elliptude.io.readers.arrow import cells_of
from elliptude.io.readers.base import Batch

BATCH_BYTES = 1 << 22
"""Bytes of the text that are read at a time."""


class CsvTable:
    """A CSV file. Arrow reads it; a slow second reading finds what is at fault, and in which line."""

    _NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII)
    # From 16 digits on a double may not hold a whole number.
    _LARGE = re.compile(r"[+-]?\d{16,18}|[+-]?[0-8]\d{18}", re.ASCII)

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.label = ""
        with self._text() as text:
            for self._header_line, line in enumerate(text, start=1):
                if line.startswith("#"):
                    self.label = self.label or line.removeprefix("#").strip()
                elif line.strip():
                    self.columns = tuple(name.strip() for name in next(csv.reader([line])))
                    return
        raise FileError(f"{path}: empty, not even a header")

    def stream(self, column: str) -> str:
        """The only one."""
        return ""

    def stamps(self, stream: str) -> None:
        """Any column may hold the times."""
        return

    def holds_numbers(self, column: str) -> bool:
        """Whether its first cell is a number or empty."""
        cell = self._first_cells.get(column, "")
        return not cell or self._NUMBER.fullmatch(cell) is not None

    @cached_property
    def _first_cells(self) -> dict[str, str]:
        _, first = next(self._rows(), (0, []))
        return {name: cell.strip(" \t") for name, cell in zip(self.columns, first, strict=False)}

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        cells = self._first_cells
        large = {name for name in columns if self._LARGE.fullmatch(cells.get(name, ""))}
        types = {name: pa.int64() if name in large else pa.float64() for name in columns}
        for batch in self._batches(types):
            yield {name: cells_of(batch.column(name), name in large) for name in columns}

    def read(self, numbers: list[str], texts: list[str]) -> pa.Table:
        """See `Table`."""
        types = dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(texts, pa.string())
        return pa.Table.from_batches(self._batches(types), schema=pa.schema(types))

    def _batches(self, types: Mapping[str, pa.DataType]) -> Iterator[pa.RecordBatch]:
        try:
            with pa.input_stream(os.fspath(self.path), compression="detect") as stream:
                yield from pa.csv.open_csv(
                    stream,
                    read_options=pa.csv.ReadOptions(
                        column_names=self.columns, skip_rows=self._header_line, block_size=BATCH_BYTES
                    ),
                    convert_options=pa.csv.ConvertOptions(
                        column_types=types, include_columns=list(types), null_values=[""], strings_can_be_null=False
                    ),
                )
        except (pa.ArrowException, OSError) as error:
            self._find_fault(types)
            raise FileError(f"{self.path}: {error}") from error

    def refuse(self, bad: NDArray[np.bool_], name: str, fault: str) -> None:
        """See `Table`."""
        if bad.any():
            line, cells = next(islice(self._rows(), int(np.argmax(bad)), None))
            self._fail(line, name, fault, cells[self.columns.index(name)])

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return f"{self.places_of_rows([row])[0]}, column {self.columns.index(column) + 1} ({column})"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        wanted = sorted(set(rows))
        lines: dict[int, int] = {}
        read = self._rows()
        for row, before in zip(wanted, [-1, *wanted], strict=False):
            lines[row], _ = next(islice(read, row - before - 1, None))
        return [f"line {lines[row]}" for row in rows]

    def _find_fault(self, types: Mapping[str, pa.DataType]) -> None:
        for line, cells in self._rows():
            if len(cells) != len(self.columns):
                raise FileError(
                    f"{self.path}: line {line}: {len(cells)} columns, but the header has {len(self.columns)}"
                )
            for name, kind in types.items():
                cell = cells[self.columns.index(name)].strip(" \t")
                if not cell or kind == pa.string():
                    continue
                if not self._NUMBER.fullmatch(cell):
                    self._fail(line, name, "not a number", cells[self.columns.index(name)])
                if kind == pa.int64() and not re.fullmatch(r"[+-]?\d{1,18}|[+-]?[0-8]\d{18}", cell, re.ASCII):
                    self._fail(line, name, "not a whole number, as the first one in the column is", cell)

    def _fail(self, line: int, name: str, fault: str, cell: str) -> NoReturn:
        content = textwrap.shorten(cell, 40, placeholder="...")
        place = f"line {line}, column {self.columns.index(name) + 1} ({name})"
        raise FileError(f"{self.path}: {place}: {fault}" + (f": {content!r}" if content else ""))

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """The rows below the header, each with the number of its last line; no empty lines, as Arrow skips them."""
        with self._text() as text:
            reader = csv.reader(islice(text, self._header_line, None))
            try:
                yield from ((self._header_line + reader.line_num, cells) for cells in reader if cells)
            except csv.Error as error:
                raise FileError(f"{self.path}: line {self._header_line + reader.line_num}: {error}") from error

    @contextmanager
    def _text(self) -> Iterator[io.TextIOWrapper]:
        try:
            with (
                pa.input_stream(os.fspath(self.path), compression="detect") as stream,
                io.TextIOWrapper(stream, encoding="utf-8-sig", errors="replace", newline="") as text,
            ):
                yield text
        except OSError as error:
            raise FileError(f"{self.path}: {error.strerror or error}") from error
