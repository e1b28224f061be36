"""Any table of numbers over time, column by column, as CSV or Parquet: the format is described in ``docs/tables.md``.

A table has one row for each time and one named column for each number; an empty cell (null in Parquet) is what was not
measured, and NaN in the arrays here. NaN and infinity as text are refused, because their meaning is not clear.
"""

import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from elliptude.io.files import FileError, replacing
from elliptude.io.readers.base import Table, require_columns
from elliptude.io.readers.parquet import ParquetTable
from elliptude.io.readers.text.csv import CsvTable
from elliptude.typing import FloatArray

VERSION = 1
"""Version of the format. A reader takes this version and older ones; a new column does not make a new version."""

Kind: TypeAlias = Literal["measurements", "results", "dropped", "measured", "monitor"]
_ORIGIN = re.compile(r"time_s counts from (-?\d+) s")
_PROPOSED = re.compile(r"; bounds_from_recording = (.*)$")
Column: TypeAlias = FloatArray | Sequence[str]


def write_columns(path: str | os.PathLike[str], kind: Kind, columns: Mapping[str, Column], origin: int = 0) -> None:
    """Write a table in whole or not at all.

    Numbers keep every bit. In CSV they have the fewest digits that do.

    Parameters
    ----------
    path : path-like
        Ends in ``.csv`` or ``.parquet``.
    kind : {"measurements", "results", "dropped", "measured"}
        Written into the file, with the version of the format.
    columns : mapping of str to array of shape (N,), or to N texts
        NaN becomes an empty cell. Texts hold no comma, quote or line break.
    origin : int
        The second of the recording's clock that ``time_s`` counts from.

    Raises
    ------
    FileError
        If it cannot be written.
    ValueError
        If a number is infinite.
    """
    with writing_columns(path, kind) as write:
        write(columns, origin)


class Writing(Protocol):
    """Writes the next rows of a table."""

    def __call__(self, columns: Mapping[str, Column], origin: int = 0, /) -> None:
        """Write rows of these columns, whose times count from ``origin``."""


def label_of(kind: Kind, origin: int = 0, proposed_from: str | None = None) -> str:
    """What a table says of itself: its kind and version, the second that ``time_s`` counts from if it is not 0.

    And the recording that the bounds behind it are proposals from, if they are.
    """
    proposed = "" if proposed_from is None else f"; bounds_from_recording = {json.dumps(proposed_from)}"
    return f"elliptude {kind} {VERSION}" + (f"; {counts_from(origin)}" if origin else "") + proposed


def counts_from(origin: int) -> str:
    """What the first line of a table says if its times count from a second of the recording's clock."""
    return f"time_s counts from {origin} s"


@contextmanager
def writing_columns(
    path: str | os.PathLike[str], kind: Kind, notes: Sequence[str] = (), proposed_from: str | None = None
) -> Iterator[Writing]:
    """Write a table piece by piece, in whole or not at all: see `write_columns`.

    A piece is written in the background, one at a time, while the next one is being made.

    Parameters
    ----------
    path : path-like
    kind : {"measurements", "results"}
    notes : sequence of str
        What whoever reads the table must know, as it is when the first rows are given: comments in CSV, in Parquet the
        metadata's ``elliptude notes``.
    proposed_from : str, optional
        The recording that the bounds behind the table are proposals from.

    Yields
    ------
    callable
        Takes the columns of the next rows, the same ones each time, and the second that ``time_s`` counts from; what
        goes wrong with a piece is raised when the next one is given, or at the end.

    Raises
    ------
    FileError, ValueError
        As `write_columns`.
    """
    suffix = Path(path).suffix
    if suffix not in {".csv", ".parquet"}:
        raise FileError(f"{path}: a table's name ends in .csv or .parquet")
    with replacing(path) as temporary, ExitStack() as opened, ThreadPoolExecutor(1) as pool:
        writer: pa.parquet.ParquetWriter | None = None
        file = opened.enter_context(temporary.open("wb")) if suffix == ".csv" else None
        pending: list[Future[None]] = []
        said: list[str] = []

        def write_piece(columns: Mapping[str, Column], label: str) -> None:
            nonlocal writer
            for name, values in columns.items():
                if isinstance(values, np.ndarray) and np.isinf(values).any():
                    raise ValueError(f"column {name}: a table holds no infinite numbers")
            table = pa.table({name: _arrow_array(values) for name, values in columns.items()})
            if file is None:
                metadata = {"elliptude": label} | ({"elliptude notes": "\n".join(said)} if said else {})
                table = table.replace_schema_metadata(metadata)
                writer = writer or opened.enter_context(pa.parquet.ParquetWriter(temporary, table.schema))
                writer.write_table(table)
                return
            if file.tell() == 0:
                # Arrow would put every name in quotes.
                head = [f"# {label}", *(f"# {' '.join(note.split())}" for note in said), ",".join(columns)]
                file.write(("\n".join(head) + "\n").encode())
            pa.csv.write_csv(table, file, pa.csv.WriteOptions(include_header=False, quoting_style="none"))

        def write(columns: Mapping[str, Column], origin: int = 0) -> None:
            if pending:
                pending.pop().result()
            elif not said:
                said.extend(notes)
            pending.append(pool.submit(write_piece, columns, label_of(kind, origin, proposed_from)))

        yield write
        if pending:
            pending.pop().result()


def _arrow_array(values: Column) -> pa.Array:
    if isinstance(values, np.ndarray):
        return pa.array(values, type=pa.float64(), from_pandas=True)
    return pa.array(values, type=pa.string())


def column_names(path: str | os.PathLike[str], kind: Kind | None = None) -> tuple[str, ...]:
    """The names of a table's columns.

    Parameters
    ----------
    path : path-like
        CSV, which may be compressed, or Parquet; elliptude's or another program's.
    kind : {"measurements", "results"}, optional
        What it must be if it is elliptude's.

    Returns
    -------
    tuple of str

    Raises
    ------
    FileError
        If there is no header, or the table is of another kind or a newer version.
    """
    return _open(path, kind).columns


def time_origin(path: str | os.PathLike[str]) -> int:
    """The second of the recording's clock that a table's column ``time_s`` counts from; 0 if it does not say.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    int

    Raises
    ------
    FileError
        As `column_names`.
    """
    return origin_of(_open(path))


def proposed_from(path: str | os.PathLike[str]) -> str | None:
    """The recording that the bounds behind a table are proposals from; None if it does not say so.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    str or None

    Raises
    ------
    FileError
        As `column_names`.
    """
    if (match := _PROPOSED.search(_open(path).label)) is None:
        return None
    try:
        return str(json.loads(match[1]))
    except ValueError:  # edited since
        return match[1]


def comments_in(path: str | os.PathLike[str]) -> list[str]:
    """The lines above the header of a CSV file that begin with #, without that.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    list of str

    Raises
    ------
    FileError
        As `column_names`.
    """
    return [line.removeprefix("#").strip() for line in CsvTable(path).comments]


def label_in(file: object) -> str:
    """`label_of` the table in a file that is open, in any format; empty if it is none of elliptude's."""
    label: str = getattr(file, "label", "")
    return label if label.startswith("elliptude ") else ""


def origin_of(file: object) -> int:
    """`time_origin` of a file that is open, in any format."""
    # A table of another program may say it, too.
    match = _ORIGIN.search(getattr(file, "label", ""))
    return 0 if match is None else int(match[1])


def read_columns(
    path: str | os.PathLike[str],
    *,
    time: str = "time_s",
    numbers: Iterable[str] = (),
    optional: Iterable[tuple[str, ...]] = (),
    texts: Iterable[str] = (),
) -> dict[str, NDArray[np.float64]]:
    """Read some columns of a table of numbers over time; what is in the others does not matter.

    Parameters
    ----------
    path : path-like
        CSV, which may be compressed, or Parquet; elliptude's or another program's. Lines before the header that begin
        with ``#`` are comments.
    time : str
        The column of times, which must increase strictly.
    numbers : iterable of str
        Columns of finite numbers.
    optional : iterable of tuple of str
        Groups of columns of finite numbers, such as the components of a direction, whose cells may be empty, but in one
        row only all together.
    texts : iterable of str
        Columns of text.

    Returns
    -------
    dict of str to array
        Each shape (N,), N at least 1; NaN for an empty cell, and arrays of text as objects.

    Raises
    ------
    FileError
        If the file is not such a table; the message names file, line and column.
    """
    groups, texts = [tuple(group) for group in optional], list(texts)
    required = [time, *numbers]
    wanted = list(dict.fromkeys([*required, *(name for group in groups for name in group)]))
    source = _open(path)
    require_columns(source, [*wanted, *texts])
    table = source.read(wanted, texts)
    if table.num_rows == 0:
        raise FileError(f"{path}: a header, but no rows below it")
    columns = _numbers_of(source, table, wanted, required, groups)
    source.refuse(np.diff(columns[time], prepend=-np.inf) <= 0.0, time, "not after the time of the row before")
    return columns | {name: np.array(table[name].to_pylist(), dtype=object) for name in texts}


def read_events(
    path: str | os.PathLike[str],
    kind: Kind,
    *,
    numbers: Iterable[str] = (),
    optional: Iterable[tuple[str, ...]] = (),
    texts: Iterable[str],
    ordered_in: str | None = None,
) -> dict[str, NDArray[Any]]:
    """Read a table with a row for each event, of which several may be at a time, and which may have none.

    Parameters
    ----------
    path : path-like
    kind : str
    numbers, texts : iterable of str
        Columns of finite numbers and of text.
    optional : iterable of tuple of str
        As of `read_columns`.
    ordered_in : str, optional
        The column of text whose rows with the same word are in order of time; all rows are if left out.

    Returns
    -------
    dict of str to array
        With ``time_s``, each shape (n,); NaN for an empty cell, texts as objects.

    Raises
    ------
    FileError
        If it is no such table; the message names file, line and column.
    """
    source, numbers, groups, texts = _open(path, kind), ["time_s", *numbers], list(optional), list(texts)
    wanted = [*numbers, *(name for group in groups for name in group)]
    require_columns(source, [*wanted, *texts])
    table = source.read(wanted, texts)
    columns: dict[str, NDArray[Any]] = _numbers_of(source, table, wanted, numbers, groups)
    columns |= {name: np.array(table[name].to_pylist(), dtype=object) for name in texts}
    times = columns["time_s"]
    words = np.zeros(len(times), dtype=object) if ordered_in is None else columns[ordered_in]
    is_before = np.zeros(len(times), dtype=np.bool_)
    for word in set(words):
        rows = np.flatnonzero(words == word)
        is_before[rows[1:]] = np.diff(times[rows]) < 0.0
    source.refuse(is_before, "time_s", f"before the time of the row before{f' of its {ordered_in}' * bool(ordered_in)}")
    return columns


def _numbers_of(
    source: Table, table: pa.Table, wanted: Sequence[str], required: Sequence[str], groups: Sequence[tuple[str, ...]]
) -> dict[str, FloatArray]:
    """Columns of finite numbers, of which the required ones have no empty cell, the others only all of their group."""
    columns: dict[str, NDArray[np.float64]] = {}
    empty: dict[str, NDArray[np.bool_]] = {}
    for name in wanted:
        columns[name] = np.array(table[name].to_numpy(), dtype=np.float64)
        empty[name] = np.asarray(table[name].is_null().to_numpy(), dtype=np.bool_)
        source.refuse(
            ~(np.isfinite(columns[name]) | empty[name]), name, "not a finite number; leave empty what is not known"
        )
    for name in required:
        source.refuse(empty[name], name, "empty")
    for group in groups:
        some = np.any([empty[name] for name in group], axis=0)
        for name in group:
            source.refuse(some & ~empty[name], name, f"a number, but {' '.join(group)} are empty only together")
    return columns


def _open(path: str | os.PathLike[str], kind: Kind | None = None) -> Table:
    if Path(path).is_dir():
        tables = [str(one) for name in ("results.csv", "results.parquet") if (one := Path(path) / name).is_file()]
        remedy = f"name the table in it: {' or '.join(tables)}" if tables else "where a table is needed"
        raise FileError(f"{path}: a folder, {remedy}")
    if not Path(path).is_file():
        raise FileError(f"{path}: {'not a regular file' if Path(path).exists() else 'no such file'}")
    source: Table = ParquetTable(path) if Path(path).suffix == ".parquet" else CsvTable(path)
    if match := re.fullmatch(r"elliptude (\w+) (\d+)(?:; .*)?", source.label):
        if int(match[2]) > VERSION:
            raise FileError(f"{path}: version {match[2]} of the format; this elliptude reads up to version {VERSION}")
        if kind is not None and match[1] != kind:
            raise FileError(f"{path}: a table of {match[1]}, where one of {kind} is needed")
    return source


def stacked(columns: Mapping[str, FloatArray], names: Sequence[str]) -> FloatArray:
    """Some columns side by side, shape (N, len(names))."""
    return np.column_stack([columns[name] for name in names])


def symmetric(columns: Mapping[str, FloatArray], names: Sequence[str]) -> FloatArray:
    """Symmetric matrices (N, n, n) from the columns of their upper entries, row by row."""
    entries = stacked(columns, names)
    n = math.isqrt(2 * len(names))
    upper = np.triu_indices(n)
    matrices = np.empty((len(entries), n, n))
    matrices[:, *upper] = entries
    matrices[:, *upper[::-1]] = entries
    return matrices
