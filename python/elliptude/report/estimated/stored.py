"""The file ``measured.csv`` beside a table of results: what sensors measured, in few enough samples for a picture."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.io.column_files import Column, comments_in, read_events, stacked, writing_columns
from elliptude.io.files import FileError, system_fault
from elliptude.typing import FloatArray

MEASURED = "measured.csv"
"""What the file is called."""

_SAMPLE, _GAP, _LEFT_OUT = "sample", "gap", "left_out"
_VALUES = ("x", "y", "z")
_MARK_BELOW = 150
_OF_RESULTS = "of the results "


def fingerprint_of(table: Path) -> str:
    """A few hexadecimal digits that tell a table of results from others.

    Parameters
    ----------
    table : pathlib.Path

    Raises
    ------
    FileError
        If it cannot be read.
    """
    try:
        with table.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:32]
    except OSError as fault:
        raise FileError(f"{table}: {system_fault(fault)}") from fault


@dataclass(frozen=True, eq=False)
class MeasuredSensor:
    """Samples of a sensor: all extremes of a recording, and the samples beside its longest gaps."""

    name: str
    """As the configuration has it."""
    kind: str
    """Such as "magnetometer"; empty for a direction that the log has."""
    unit: str
    """Empty for directions."""
    times: FloatArray
    """s, shape (K,)."""
    values: FloatArray
    """In body axes, shape (K, 3); NaN at a time within a gap."""
    gaps: list[tuple[float, float]]
    """From the last sample before a gap to the first one after it, s."""
    left_out: FloatArray
    """When its measurements did not go into the set, s, shape (n,)."""

    @property
    def is_sparse(self) -> bool:
        """Whether each sample is marked, as lines between few only guide the eye; of a single one there is none."""
        return len(self.times) < _MARK_BELOW


def with_gaps(
    times: FloatArray, values: FloatArray, gaps: Sequence[tuple[float, float]]
) -> tuple[FloatArray, FloatArray]:
    """Times, shape (K,), and values, shape (K, 3), of samples with NaN in the middle of each gap.

    Parameters
    ----------
    times : (n,) array
        s.
    values : (n, 3) array
    gaps : sequence of (float, float)
        Each ends at a sample, s.
    """
    rows = np.searchsorted(times, [end for _, end in gaps])
    middles = [0.5 * (begin + end) for begin, end in gaps]
    return np.insert(times, rows, middles), np.insert(values, rows, np.nan, axis=0)


def write_measured(
    path: str | os.PathLike[str], sensors: Sequence[MeasuredSensor], table: Path, origin: int = 0
) -> None:
    """Write the samples, gaps and times of sensors, one sensor after the other, in whole or not at all.

    Parameters
    ----------
    path : path-like
    sensors : sequence of MeasuredSensor
        A table without rows is written for none.
    table : pathlib.Path
        The results that were estimated from them; it has been written.
    origin : int
        The second of the recording's clock that the times count from.

    Raises
    ------
    FileError
        If it cannot be written, or the results cannot be read.
    """
    parts = [_rows_of(sensor) for sensor in sensors]
    counts = [len(times) for times, _, _ in parts]
    values = np.concatenate([np.empty((0, 3)), *(one for _, one, _ in parts)])
    columns: dict[str, Column] = {
        "time_s": np.concatenate([np.empty(0), *(one for one, _, _ in parts)]),
        "sensor": [sensor.name for sensor, count in zip(sensors, counts, strict=True) for _ in range(count)],
        "kind": [sensor.kind for sensor, count in zip(sensors, counts, strict=True) for _ in range(count)],
        "unit": [sensor.unit for sensor, count in zip(sensors, counts, strict=True) for _ in range(count)],
        "what": [word for _, _, what in parts for word in what],
    }
    with writing_columns(path, "measured", [_OF_RESULTS + fingerprint_of(table)]) as write:
        write(columns | dict(zip(_VALUES, values.T, strict=True)), origin)


def _rows_of(sensor: MeasuredSensor) -> tuple[FloatArray, FloatArray, list[str]]:
    """Times, values and what they are, in order of time; a gap is at the time of the sample that it begins with."""
    is_sample = np.isfinite(sensor.values).all(axis=1)
    samples = sensor.times[is_sample]
    times = np.concatenate([samples, [begin for begin, _ in sensor.gaps], sensor.left_out])
    values = np.full((len(times), 3), np.nan)
    values[: len(samples)] = sensor.values[is_sample]
    what = [_SAMPLE] * len(samples) + [_GAP] * len(sensor.gaps) + [_LEFT_OUT] * len(sensor.left_out)
    order = np.argsort(times, kind="stable")
    return times[order], values[order], [what[row] for row in order]


def read_measured(path: Path, table: Path) -> tuple[MeasuredSensor, ...]:
    """Read what `write_measured` wrote.

    Parameters
    ----------
    path : pathlib.Path
    table : pathlib.Path
        The results that it must be of.

    Returns
    -------
    tuple of MeasuredSensor
        In the order of the file.

    Raises
    ------
    FileError
        If it is no such table; the message names file, line and column. Or if it is of other results.
    """
    texts = ("sensor", "kind", "unit", "what")
    columns = read_events(path, "measured", optional=[_VALUES], texts=texts, ordered_in="sensor")
    names, what = columns["sensor"], columns["what"]
    for row in np.flatnonzero(~np.isin(what, (_SAMPLE, _GAP, _LEFT_OUT))):
        raise FileError(f"{path}: row {row + 1} below the header: {what[row]!r}, not {_SAMPLE}, {_GAP} or {_LEFT_OUT}")
    for row in np.flatnonzero(~names.astype(np.bool_)):
        raise FileError(f"{path}: row {row + 1} below the header: no name of a sensor")
    for row in np.flatnonzero((what == _SAMPLE) & np.isnan(columns["x"])):
        raise FileError(f"{path}: row {row + 1} below the header: a sample without x y z")
    if _OF_RESULTS + fingerprint_of(table) not in comments_in(path):
        raise FileError(f"{path}: not of {table.name} as it is now, but of an earlier run or of another recording")
    return tuple(_sensor(path, columns, names == name) for name in dict.fromkeys(names))


def _sensor(path: Path, columns: dict[str, NDArray[Any]], rows: NDArray[np.bool_]) -> MeasuredSensor:
    """The sensor of some rows."""
    name, kind, unit = (str(columns[column][rows][0] or "") for column in ("sensor", "kind", "unit"))
    what = columns["what"][rows]
    times, values = columns["time_s"][rows], stacked(columns, _VALUES)[rows]
    samples, begins = times[what == _SAMPLE], times[what == _GAP]
    ends = np.searchsorted(samples, begins, side="right")
    if not len(samples):
        raise FileError(f"{path}: sensor {name}: no sample")
    if len(ends) and ends[-1] == len(samples):
        raise FileError(f"{path}: sensor {name}: no sample after the gap at {begins[-1]:.6f} s")
    gaps = list(zip(begins.tolist(), samples[ends].tolist(), strict=True))
    drawn = with_gaps(samples, values[what == _SAMPLE], gaps)
    return MeasuredSensor(name, kind, unit, *drawn, gaps, times[what == _LEFT_OUT])
