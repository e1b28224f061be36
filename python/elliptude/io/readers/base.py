"""Files of numbers over time, by format: which columns there are, their numbers in batches, and where a fault is.

CSV and Parquet are read batch by batch, so that memory does not grow with the file. The place in a message is one that
a person can go to: the line of a CSV file, from 1 and with comments and header, or the row of another file, from 1.
"""

import csv
import io
import os
import re
import textwrap
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import NoReturn, Protocol, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from elliptude.io.files import FileError

BATCH_BYTES = 1 << 22
"""Of a CSV file's text that are worked on at a time."""
BATCH_ROWS = 1 << 17
"""Of a Parquet file that are worked on at a time."""
MOST_COLUMNS = 10_000
"""Of an array in an NPZ file: one that says it is wider is none of columns."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Some rows of a column."""

    values: NDArray[np.float64] | NDArray[np.int64]
    """Shape (N,); whole numbers that a double does not hold are int64."""
    empty: NDArray[np.bool_]
    """Where there is nothing: no number, or in a format without empty cells NaN; shape (N,)."""


Batch: TypeAlias = Mapping[str, Cells]
"""Some rows of some columns, as many of each."""


class LogFile(Protocol):
    """A file of one or more streams. A stream is some columns that have their rows together."""

    path: Path
    columns: tuple[str, ...]

    def stream(self, column: str) -> str:
        """The stream that a column belongs to; "" where the file has but one."""

    def holds_numbers(self, column: str) -> bool:
        """Whether a column is one of numbers, as far as can be told without reading it all."""

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """The column and the unit of a stream's own time stamps, where the format says which they are."""

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """Some columns of one stream, from the first row to the last.

        Raises
        ------
        FileError
            If the file cannot be read, or a cell is no number; with its place.
        """

    def place(self, column: str, row: int) -> str:
        """Where a cell is, for a message: "line 812, column 9 (sun_bx)". ``row`` counts from 0 in its stream."""

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """Where rows are, for messages: "line 812"; empty where a row of one stream is none of the others.

        The file is read no more than once, however many rows these are.
        """


class Table(LogFile, Protocol):
    """A file of rows and columns, its header read."""

    label: str
    """Kind and version, if it is elliptude's."""

    def read(self, numbers: list[str], texts: list[str]) -> pa.Table:
        """The columns: float64, where null is an empty cell, and text."""

    def refuse(self, bad: NDArray[np.bool_], name: str, fault: str) -> None:
        """Raise FileError for the first bad row of a column, if there is one."""


def open_log(path: str | os.PathLike[str]) -> LogFile:
    """Open a file in the format that its name ends in.

    Parameters
    ----------
    path : path-like
        ``.parquet``; ``.npz``; ``.ulg``; ``.bag``, ``.mcap``, ``.db3`` or the folder of a ROS 2 bag; anything else is
        CSV, which may be compressed (``.gz``, ``.bz2``, ``.zst``).

    Returns
    -------
    LogFile

    Raises
    ------
    FileError
        If there is no such file, it is of another format, or what reads the format is not installed.
    """
    path = Path(path)
    if path.is_dir() and (path / "metadata.yaml").is_file():
        from elliptude.io.readers.rosbag import BagFile

        return BagFile(path)
    if not path.is_file():
        raise FileError(f"{path}: {'not a regular file' if path.exists() else 'no such file'}")
    match path.suffix:
        case ".parquet":
            return ParquetTable(path)
        case ".npz":
            return NpzFile(path)
        case ".ulg":
            from elliptude.io.readers.ulog import UlogFile

            return UlogFile(path)
        case ".bag" | ".mcap" | ".db3":
            from elliptude.io.readers.rosbag import BagFile

            return BagFile(path)
        case _:
            return CsvTable(path)


def require_columns(file: LogFile, names: Sequence[str]) -> None:
    """Raise FileError unless each column is there, once.

    Parameters
    ----------
    file : LogFile
    names : sequence of str

    Raises
    ------
    FileError
        With the columns that there are.
    """
    for name in names:
        if file.columns.count(name) != 1:
            there_are = ", ".join(file.columns)
            there_are = there_are if len(there_are) <= 300 else f"{there_are[:296]} ..."
            fault = "two columns" if name in file.columns else "no column"
            raise FileError(f"{file.path}: {fault} {name!r}; the columns are {there_are}")


def numbered(values: NDArray[np.generic]) -> Cells:
    """The cells of an array of numbers, in which NaN is what was not measured.

    Parameters
    ----------
    values : (N,) array
        Of booleans, integers or floats.

    Returns
    -------
    Cells
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8:
        return Cells(values.astype(np.int64), np.zeros(len(values), bool))
    numbers = values.astype(np.float64)
    return Cells(numbers, np.isnan(numbers))


# --- Parquet ----------------------------------------------------------------------------------------------------------


class ParquetTable:
    """A Parquet file."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            schema = pa.parquet.read_schema(path)
        except (pa.ArrowException, OSError) as error:
            raise FileError(f"{path}: not a Parquet file: {error}") from error
        self.columns = tuple(schema.names)
        self.label = (schema.metadata or {}).get(b"elliptude", b"").decode()
        self._types = {field.name: field.type for field in schema}

    def stream(self, column: str) -> str:
        """The only one."""
        return ""

    def stamps(self, stream: str) -> None:
        """Any column may hold the times."""
        return

    def holds_numbers(self, column: str) -> bool:
        """See `LogFile`."""
        kind = self._types[column]
        return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        self._require_numbers(columns)
        large = {name for name in columns if self._types[name] in (pa.int64(), pa.uint64())}
        try:
            # Arrow would read all that is wanted of the file beforehand.
            with pa.parquet.ParquetFile(self.path, pre_buffer=False) as file:
                for batch in file.iter_batches(BATCH_ROWS, columns=list(columns)):
                    yield {name: _cells(batch.column(name), name in large) for name in columns}
        except (pa.ArrowException, OSError) as error:
            raise FileError(f"{self.path}: {error}") from error

    def read(self, numbers: list[str], texts: list[str]) -> pa.Table:
        """See `Table`."""
        self._require_numbers(numbers)
        schema = pa.schema([(name, pa.float64()) for name in numbers] + [(name, pa.string()) for name in texts])
        try:
            with pa.parquet.ParquetFile(self.path) as file:
                return file.read(columns=schema.names).select(schema.names).cast(schema)
        except (pa.ArrowException, OSError) as error:
            raise FileError(f"{self.path}: {error}") from error

    def refuse(self, bad: NDArray[np.bool_], name: str, fault: str) -> None:
        """See `Table`."""
        if bad.any():
            raise FileError(f"{self.path}: {self.place(name, int(np.argmax(bad)))}: {fault}")

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return f"row {row + 1}, column {column!r}"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return [f"row {row + 1}" for row in rows]

    def _require_numbers(self, names: Sequence[str]) -> None:
        for name in names:
            if not self.holds_numbers(name):
                raise FileError(f"{self.path}: column {name!r} is of type {self._types[name]}, not of numbers")


def _cells(column: pa.Array, large: bool) -> Cells:
    """Of an Arrow array of numbers, as int64 where a double might lose digits."""
    empty = np.asarray(column.is_null().to_numpy(zero_copy_only=False), dtype=np.bool_)
    if large:
        return Cells(np.asarray(column.fill_null(0).cast(pa.int64())), empty)
    return Cells(np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False)), empty)


# --- CSV --------------------------------------------------------------------------------------------------------------


class CsvTable:
    """A CSV file. Read by Arrow; what is at fault, and in which line, is found by a slow second reading."""

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
            yield {name: _cells(batch.column(name), name in large) for name in columns}

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


# --- NPZ --------------------------------------------------------------------------------------------------------------


class NpzFile:
    """A NumPy archive. Array ``t`` (N,) is the column ``t``, array ``gyr`` (N, 3) the columns ``gyr[0]`` to ``gyr[2]``.

    Arrays of other shapes, and what is neither number nor boolean, are no columns. Arrays of the same length make a
    stream, named by its length. NaN is what was not measured.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._lengths: dict[str, int] = {}
        try:
            with zipfile.ZipFile(path) as archive:
                for member in archive.namelist():
                    with archive.open(member) as file:
                        version = np.lib.format.read_magic(file)
                        read_header = (
                            np.lib.format.read_array_header_1_0
                            if version == (1, 0)
                            else np.lib.format.read_array_header_2_0
                        )
                        shape, _, dtype = read_header(file)
                    name = member.removesuffix(".npy")
                    if dtype.kind in "biuf" and len(shape) in {1, 2} and all(n <= MOST_COLUMNS for n in shape[1:]):
                        names = [name] if len(shape) == 1 else [f"{name}[{i}]" for i in range(shape[1])]
                        self._lengths |= dict.fromkeys(names, shape[0])
        except OSError as error:
            raise FileError(f"{path}: {error.strerror or error}") from error
        except Exception as error:  # zipfile and NumPy raise what their parsing happens to meet
            raise FileError(f"{path}: not an NPZ file: {error}") from error
        self.columns = tuple(self._lengths)

    def stream(self, column: str) -> str:
        """See `LogFile`."""
        return str(self._lengths[column])

    def stamps(self, stream: str) -> None:
        """Any column may hold the times."""
        return

    def holds_numbers(self, column: str) -> bool:
        """All do."""
        return True

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """All rows in one batch; an array is taken from the archive once."""
        arrays: dict[str, NDArray[np.generic]] = {}
        batch: dict[str, Cells] = {}
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                for column in columns:
                    name, _, index = column.partition("[") if column not in archive.files else (column, "", "")
                    if name not in arrays:
                        arrays[name] = archive[name]
                    values = arrays[name]
                    batch[column] = numbered(values[:, int(index[:-1])] if index else values)
        except OSError as error:
            raise FileError(f"{self.path}: {error.strerror or error}") from error
        except Exception as error:  # as above
            raise FileError(f"{self.path}: not an NPZ file: {error}") from error
        yield batch

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return f"row {row + 1}, column {column!r}"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return [f"row {row + 1}" for row in rows]
