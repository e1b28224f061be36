"""Converts logs from one format to another, piece by piece. A file is written whole or not at all."""

import os
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import tomlkit

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.rules import field_at_start
from elliptude.io import column_files
from elliptude.io.files import FileError, replacing
from elliptude.io.readers.base import LogFile, require_columns
from elliptude.io.readers.open import open_log
from elliptude.logs import log as logs
from elliptude.logs.conversion.table import columns_of, configuration_of, require_rest_phases
from elliptude.logs.conversion.writers import Write, writing
from elliptude.logs.log import Log


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
    with replacing(target) as temporary, writing(target, temporary, column_files.label_in(file)) as write:
        count = sum(_copy(file, some, write) for some in columns if some)
        if count == 0:
            raise FileError(f"{source}: a header, but no rows below it")
    return count


def convert_measurements(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    configuration: Configuration,
    configuration_target: str | os.PathLike[str] | None = None,
) -> int:
    """Write all that a configuration takes from a log as a table of measurements (docs/tables.md).

    Rows are those that the estimator sees, numbers are in SI units and body axes. Where ``timing.same_within_s`` puts
    stamps into rows of other times, sensors have columns of their own stamps.

    Parameters
    ----------
    source : path-like
    target : path-like
        Ends in ``.csv``, ``.parquet`` or ``.npz``.
    configuration : Configuration
    configuration_target : path-like, optional
        Where to write the configuration, TOML, by which the table gives the same results as the log.

    Returns
    -------
    int
        How many rows were written.

    Raises
    ------
    FileError
        As `elliptude.logs.read_log`; or if nothing can be written; or if the table has not all that a reference of its
        configuration is made of.
    """
    count, last = 0, 0.0
    pieces = logs.read_pieces(source, configuration)
    if configuration.rule is not None and len(configuration.directions) > 1:
        # The field's reference is known once the rest at the start has been read; the mode needs the whole log anyway.
        pieces = iter([_with_field_of_rule(logs.joined(list(pieces)), configuration, str(source))])
    first = next(pieces)
    label = column_files.label_of("measurements", first.counts_from)
    with replacing(target) as temporary, writing(target, temporary, label) as write:
        for log in chain([first], pieces):
            write(columns_of(log, configuration))
            count, last = count + len(log.times), float(log.times[-1])
        if configuration_target is not None:
            require_rest_phases(configuration, first.origin, float(first.times[0]), last)
            with replacing(configuration_target) as document:
                document.write_text(tomlkit.dumps(configuration_of(first, configuration)), encoding="utf-8")
    return count


def _with_field_of_rule(log: Log, configuration: Configuration, name: str) -> Log:
    """The log with the reference of the field that its rule finds."""
    assert configuration.rule is not None
    assert log.rates is not None
    rule, kinds = configuration.calibrated_rule(), [sensor.kind for sensor in configuration.directions]
    i, up = kinds.index("magnetometer"), kinds.index("accelerometer")
    references = log.references.copy()
    references[:, i] = np.nan
    if rule.magnetometer is not None:
        # Rows in which none of the three was sampled are none of theirs.
        sampled = np.asarray(np.isfinite(log.directions[:, (i, up), 0]).any(axis=1))
        sampled[log.gyro_rows] = True
        own = [None if (times := log.sampled(one)) is None else times[sampled] for one in (up, i)]
        try:
            references[:, i] = field_at_start(
                rule,
                log.times[sampled],
                log.rates[sampled],
                log.directions[sampled, up],
                log.directions[sampled, i] / units.FIELD["uT"],
                forces_sampled=own[0],
                fields_sampled=own[1],
            )
        except ValueError as error:
            raise FileError(f"{name}: the reference of the field is that of the rest at the start: {error}") from error
    return replace(log, references=references)


def _copy(file: LogFile, columns: list[str], write: Write) -> int:
    count = 0
    for batch in file.batches(columns):
        write(batch)
        count += len(next(iter(batch.values())).values)
    return count
