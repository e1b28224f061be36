"""Writes columns piece by piece as CSV, Parquet or NPZ."""

import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from elliptude.io.files import FileError
from elliptude.io.readers.arrays import LABEL
from elliptude.io.readers.base import Cells

SUFFIXES = (".csv", ".parquet", ".npz")
"""Endings of the names of files that can be written."""

Write: TypeAlias = Callable[[Mapping[str, Cells]], None]
"""Appends rows with the same columns to those written before."""


def writing(target: str | os.PathLike[str], temporary: Path, label: str) -> AbstractContextManager[Write]:
    """What writes a table piece by piece to a temporary file, in the format that the target's name says.

    Parameters
    ----------
    target : path-like
    temporary : pathlib.Path
    label : str
        What the table says of itself; empty if nothing.

    Returns
    -------
    context manager
        Of what appends rows.

    Raises
    ------
    FileError
        If the target's name has another ending.
    """
    match Path(target).suffix:
        case ".csv":
            return _csv_writer(temporary, label)
        case ".parquet":
            return _parquet_writer(temporary, label)
        case ".npz":
            return _npz_writer(temporary, label)
    raise FileError(f"{target}: what is written ends in {', '.join(SUFFIXES)}")


def _arrow_table(columns: Mapping[str, Cells]) -> pa.Table:
    def unknown(cells: Cells) -> NDArray[np.bool_]:
        return np.asarray(cells.empty | np.isnan(cells.values), dtype=np.bool_)

    return pa.table({name: pa.array(cells.values, mask=unknown(cells)) for name, cells in columns.items()})


@contextmanager
def _csv_writer(path: Path, label: str) -> Iterator[Write]:
    # Arrow would put every name in quotes.
    options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
    with path.open("wb") as file:
        file.write(f"# {label}\n".encode() if label else b"")
        is_first = True

        def write(columns: Mapping[str, Cells]) -> None:
            nonlocal is_first
            if is_first:
                file.write((",".join(map(_in_csv, columns)) + "\n").encode())
                is_first = False
            pa.csv.write_csv(_arrow_table(columns), file, options)

        yield write


def _in_csv(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(character in name for character in ',"\n') else name


@contextmanager
def _parquet_writer(path: Path, label: str) -> Iterator[Write]:
    with ExitStack() as stack:
        writer: pa.parquet.ParquetWriter | None = None

        def write(columns: Mapping[str, Cells]) -> None:
            nonlocal writer
            table = _arrow_table(columns)
            if writer is None:
                schema = table.schema.with_metadata({"elliptude": label} if label else None)
                writer = stack.enter_context(pa.parquet.ParquetWriter(path, schema))
            writer.write_table(table.replace_schema_metadata(None))

        yield write


@contextmanager
def _npz_writer(path: Path, label: str) -> Iterator[Write]:
    """Holds all columns until the end, because the arrays of an archive cannot grow; the label is an array of text."""
    parts: dict[str, list[NDArray[np.generic]]] = {}

    def write(columns: Mapping[str, Cells]) -> None:
        for name, cells in columns.items():
            values = np.where(cells.empty, np.nan, cells.values) if cells.empty.any() else cells.values
            parts.setdefault(name, []).append(values)

    yield write
    arrays = ({LABEL: np.array(label)} if label else {}) | {name: np.concatenate(some) for name, some in parts.items()}
    with path.open("wb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, values, allow_pickle=False)
