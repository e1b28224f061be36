"""Converts logs from one format to another, piece by piece. A file is written whole or not at all."""

import os
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.rules import field_at_start
from elliptude.io import column_files, tables
from elliptude.io.files import FileError, replacing
from elliptude.io.readers.arrays import LABEL
from elliptude.io.readers.base import Cells, LogFile, require_columns
from elliptude.io.readers.open import open_log
from elliptude.logs import log as logs
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

SUFFIXES = (".csv", ".parquet", ".npz")
"""Endings of the names of files that can be written."""


def convert(source: str | os.PathLike[str], target: str | os.PathLike[str], stream: str | None = None) -> int:
    """Write the numbers of a log in another format, as they stand.

    Columns keep their names, and numbers their values. What is empty becomes empty, and NaN in NPZ; NaN becomes empty.

    Parameters
    ----------
    source : path-like
        In a format of `elliptude.io.readers.open.open_log`.
    target : path-like
        Ends in ``.csv``, ``.parquet`` or ``.npz``. An NPZ file holds all streams, the others one.
    stream : str, optional
        Which stream to write, if the log has several.

    Returns
    -------
    int
        The number of rows that were written, of all streams.

    Raises
    ------
    FileError
        If the log cannot be read, a column that begins with a number holds something else, or nothing can be written.
    """
    file = open_log(source)
    streams = list(dict.fromkeys(file.stream(column) for column in file.columns))
    if stream is not None and stream not in streams:
        listed = ", ".join(one for one in streams if one)
        known = f"there are {listed}" if listed else "this file is one table, so leave --stream out"
        raise FileError(f"{source}: no stream {stream!r}; {known}")
    chosen = streams if stream is None else [stream]
    if len(chosen) > 1 and Path(target).suffix != ".npz":
        raise FileError(f"{source}: more than one stream ({', '.join(chosen)}); --stream says which, or write .npz")
    # If two columns have one name, one would be lost. Commas at the end of each line do not make columns.
    named = [name for name in file.columns if name or file.columns.count(name) == 1]
    numbers = [name for name in named if file.holds_numbers(name)]
    require_columns(file, numbers)
    columns = [[name for name in numbers if file.stream(name) == one] for one in chosen]
    with replacing(target) as temporary, _writer(target, temporary, column_files.label_in(file)) as write:
        count = sum(_copy(file, some, write) for some in columns if some)
        if count == 0:
            raise FileError(f"{source}: a header, but no rows below it")
    return count


def convert_measurements(
    source: str | os.PathLike[str], target: str | os.PathLike[str], configuration: Configuration
) -> int:
    """Write the part of a log that a configuration uses as a table of measurements (docs/tables.md).

    Rows are those that the estimator sees. Directions are unit vectors in body axes, rates in rad/s. Where
    ``timing.same_within_s`` puts stamps into rows of other times, directions, a measured rate and a
    truth have columns of their own stamps.

    Parameters
    ----------
    source : path-like
    target : path-like
        Ends in ``.csv``, ``.parquet`` or ``.npz``.
    configuration : Configuration

    Returns
    -------
    int
        How many rows were written.

    Raises
    ------
    FileError
        As `elliptude.logs.read_log`; or if nothing can be written.
    """
    count = 0
    pieces = logs.read_pieces(source, configuration)
    if configuration.rule is not None and len(configuration.directions) > 1:
        # The field's reference is known once the rest at the start has been read; the mode needs the whole log anyway.
        pieces = iter([_with_field_of_rule(logs.joined(list(pieces)), configuration, str(source))])
    first = next(pieces)
    label = column_files.label_of("measurements", first.counts_from)
    with replacing(target) as temporary, _writer(target, temporary, label) as write:
        for log in chain([first], pieces):
            write(_measurements(log, configuration))
            count += len(log.times)
    return count


def _with_field_of_rule(log: Log, configuration: Configuration, name: str) -> Log:
    """The log with the reference of the field that its rule finds."""
    assert configuration.rule is not None
    assert log.rates is not None
    rule, kinds = configuration.rule.rule(), [sensor.kind for sensor in configuration.directions]
    i = kinds.index("magnetometer")
    references = log.references.copy()
    references[:, i] = np.nan
    if rule.magnetometer is not None:
        fields = log.directions[:, i] / units.FIELD["uT"]
        try:
            references[:, i] = field_at_start(
                rule, log.times, log.rates, log.directions[:, kinds.index("accelerometer")], fields
            )
        except ValueError as error:
            raise FileError(f"{name}: the reference of the field is that of the rest at the start: {error}") from error
    return replace(log, references=references)


def _measurements(log: Log, configuration: Configuration) -> dict[str, Cells]:
    columns: dict[str, FloatArray] = {"time_s": log.times}

    def add(names: Sequence[str], values: FloatArray | None) -> None:
        if values is not None:
            columns.update(zip(names, values.T, strict=True))

    def stamped(name: str, vectors: FloatArray, offsets: FloatArray | None) -> None:
        if offsets is not None:
            columns[tables.own_stamps(name)] = np.where(np.isnan(vectors[:, 0]), np.nan, log.times + offsets)

    if log.true_attitudes is not None:
        quaternions = np.full((len(log.times), 4), np.nan)
        known = np.isfinite(log.true_attitudes[:, 0, 0])
        quaternions[known] = tables.quaternions_from_attitudes(log.true_attitudes[known]) if known.any() else 0.0
        add(tables.QUATERNION, quaternions)
        stamped("true_attitude", quaternions, log.true_offsets)
    for i, sensor in enumerate(configuration.directions):
        for names, vectors in (
            (tables.measured(sensor.name), log.directions[:, i]),
            (tables.reference(sensor.name), log.references[:, i]),
        ):
            add(names, vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
        stamped(sensor.name, log.directions[:, i], None if log.offsets is None else log.offsets[:, i])
    add(tables.MEASURED_RATE, log.rates)
    if log.rates is not None:
        stamped("rate", log.rates, log.rate_offsets)
    return {name: Cells(values, np.isnan(values)) for name, values in columns.items()}


def _copy(file: LogFile, columns: list[str], write: "_Write") -> int:
    count = 0
    for batch in file.batches(columns):
        write(batch)
        count += len(next(iter(batch.values())).values)
    return count


# --- writing piece by piece -------------------------------------------------------------------------------------------

_Write: TypeAlias = Callable[[Mapping[str, Cells]], None]
"""Appends rows with the same columns to those written before."""


def _writer(target: str | os.PathLike[str], temporary: Path, label: str) -> AbstractContextManager[_Write]:
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
def _csv_writer(path: Path, label: str) -> Iterator[_Write]:
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
def _parquet_writer(path: Path, label: str) -> Iterator[_Write]:
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
def _npz_writer(path: Path, label: str) -> Iterator[_Write]:
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
