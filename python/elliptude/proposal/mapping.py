"""Which columns of a log are which sensors, before there are bounds.

The tables of a configuration without bounds, as TOML has them: from a file, from columns that were named one by one,
from a preset, or from headers that state sensor, axis and unit, such as ``Gyroscope X (deg/s)``. Units are always
stated, never guessed from numbers.
"""

import copy
import dataclasses
import os
import re
import textwrap
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elliptude import units
from elliptude.configuration import references
from elliptude.configuration.configuration import Configuration
from elliptude.io.files import FileError
from elliptude.io.readers.base import LogFile, require_columns
from elliptude.io.readers.counted import ROW_TIME, CountedRows
from elliptude.io.readers.open import LogSource
from elliptude.io.readers.text.csv import CsvTable
from elliptude.io.readers.text.dialect import ISO_STAMP, TIME_HEADER, Dialect
from elliptude.io.readers.text.folder import CsvFolder
from elliptude.io.toml import load_toml, validate
from elliptude.logs import log, reference_attitudes
from elliptude.proposal.known_formats import AtRest, complete_sensor_logger, complete_xsens, turn_at_rest
from elliptude.proposal.proposals import Recording
from elliptude.typing import FloatArray

Tables: TypeAlias = dict[str, Any]

_PRESETS = resources.files("elliptude") / "data" / "presets"

_HEADER = re.compile(r"(?P<sensor>.*?)[\s_.]*(?P<axis>[xyz])\s*[(\[](?P<unit>[^)\]]*)[)\]]", re.IGNORECASE)
_YEAR_2001 = 1e9
_SENSORS = {
    "gyroscope": re.compile(r"gyr.*|g|w(_rs_s)?|omega|angular.?velocity|angular.?rate|rotation.?rate", re.IGNORECASE),
    "accelerometer": re.compile(r"(?!.*(without|linear|user|free))acc.*|a(_rs_s)?|f|specific.?force", re.IGNORECASE),
    "magnetometer": re.compile(r"mag.*|m|b|field", re.IGNORECASE),
}
"""What a column's name begins with, w_RS_S and a_RS_S as in EuRoC's; its unit has to be one of the sensor's, too."""
_UNITS: Mapping[str, Mapping[Any, float]] = {
    "gyroscope": units.ANGULAR_VELOCITY,
    "accelerometer": units.ACCELERATION,
    "magnetometer": units.FIELD,
}
_NAMES = {"accelerometer": "up", "magnetometer": "field"}
# A gap of up to this many of the sensor's own steps is bridged.
_LARGEST_GAP = 3.0


def presets() -> tuple[str, ...]:
    """The names of formats whose units are in their documentation and not in the file."""
    return tuple(sorted(file.name.removesuffix(".toml") for file in _PRESETS.iterdir() if file.name.endswith(".toml")))


def of_preset(name: str, file: LogFile, at_rest: AtRest | None = None) -> Tables:
    """The tables for a format of `presets`, without the sensors that a file does not have; it must have the gyro.

    A column such as ``*.angular_velocity.x`` is that of the one topic that has it.

    Parameters
    ----------
    name : str
    file : LogFile
    at_rest : {"up", "down"}, optional
        Where the accelerometer points at rest, if the format does not say it, or says it wrongly.

    Raises
    ------
    FileError
        If several topics have it, or the file lacks what the format needs.
    """
    with resources.as_file(_PRESETS / f"{name}.toml") as preset:
        tables = load_toml(preset)
    if name == "sensor-logger":
        complete_sensor_logger(tables, file, at_rest)
    if name == "xsens":
        complete_xsens(tables, file)
    for sensor in [tables["flow"], *tables.get("directions", [])]:
        sensor["columns"] = [_found(column, file) for column in sensor["columns"]]
    require_columns(file, tables["flow"]["columns"])
    if "directions" in tables:
        tables["directions"] = [one for one in tables["directions"] if set(file.columns).issuperset(one["columns"])]
    if "velocity" in tables and not set(file.columns).issuperset(tables["velocity"]["columns"]):
        del tables["velocity"]
    turn_at_rest(tables, at_rest)
    if "truth" in tables and not set(file.columns).issuperset(tables["truth"]["attitude_columns"]):
        del tables["truth"]
    return tables


def _found(column: str, file: LogFile) -> str:
    if not column.startswith("*"):
        return column
    there = [name for name in file.columns if name.endswith(column[1:])]
    if len(there) > 1:
        raise FileError(f"{file.path}: which of {', '.join(there)}? Say with --gyro, --accelerometer, --magnetometer")
    return there[0] if there else column


def of_sensors(
    time_column: str | None,
    time_unit: str,
    sensors: Mapping[str, tuple[Sequence[str], str]],
    truth: Sequence[str] = (),
) -> Tables:
    """The tables for columns that were named one by one.

    Parameters
    ----------
    time_column : str or None
        None in a file whose sensors have stamps of their own, such as a bag.
    time_unit : str
    sensors : mapping
        From "gyroscope", "accelerometer", "magnetometer" to three columns and their unit.
    truth : sequence of str
        Four columns qw, qx, qy, qz from body to reference axes (ENU), or none.

    Returns
    -------
    dict
    """
    columns, unit = sensors["gyroscope"]
    tables: Tables = {} if time_column is None else {"time_column": time_column, "time_unit": time_unit}
    directions = [
        {"name": name, "kind": kind, "columns": list(sensors[kind][0]), "unit": sensors[kind][1]}
        for kind, name in _NAMES.items()
        if kind in sensors
    ]
    if directions:
        tables["reference_frame"] = "ENU"
    tables["flow"] = {"kind": "gyro", "columns": list(columns), "unit": unit}
    if directions:
        tables["directions"] = directions
    if truth:
        tables["truth"] = {"attitude_columns": list(truth), "label": "the reference attitude"}
    return tables


def as_written(tables: Tables, file: LogFile, *, repair: bool) -> Tables:
    """The tables with what is to be said about the file: how it is written, what repairs and origin it needs.

    Parameters
    ----------
    tables : dict
    file : LogFile
    repair : bool
        Whether to leave out what is wrong.

    Returns
    -------
    dict
        What the tables say already stays.
    """
    full = copy.deepcopy(tables)
    table = file.file if isinstance(file, CountedRows) else file
    if isinstance(table, CsvTable):
        standard = dataclasses.asdict(Dialect())
        found = {key: value for key, value in dataclasses.asdict(table.dialect).items() if value != standard[key]}
        if found:
            full["csv"] = found | full.get("csv", {})
    timing: Tables = {"repair": True} if repair else {}
    time, unit = full.get("time_column", "time_s"), full.get("time_unit", "s")
    own = None if time in file.columns else _own_stamps(file, full)
    if own is not None and _is_absolute(file, *own):
        timing["origin"] = "first"
    if time in file.columns and _is_absolute(file, time, file.time_unit(time) or unit):
        timing["origin"] = "first"
        if file.time_unit(time) is not None:
            full["time_unit"] = file.time_unit(time)
    if timing:
        full["timing"] = timing | full.get("timing", {})
    return full


def _own_stamps(file: LogFile, tables: Tables) -> tuple[str, str] | None:
    """The column and the unit of the stamps that the gyro's stream has of its own."""
    columns = tables.get("flow", {}).get("columns", [])
    if not columns or columns[0] not in file.columns:  # those who read it all say what is wrong
        return None
    return file.stamps(file.stream(columns[0]))


def _is_absolute(file: LogFile, column: str, unit: Any) -> bool:
    """Whether a column's first stamp is after 2001, counted from 1970."""
    if unit not in units.TICKS_PER_SECOND or not file.holds_numbers(column):
        return False
    try:
        cells = next(file.batches([column]), {}).get(column)
    except FileError:  # those who read it all say what is wrong
        return False
    if cells is None:
        return False
    there = np.flatnonzero(~cells.empty & np.isfinite(cells.values))
    return len(there) > 0 and float(cells.values[there[0]]) / units.TICKS_PER_SECOND[unit] >= _YEAR_2001


def times_of_day(file: LogFile) -> dict[str, str]:
    """The columns of a file that need no header to be known as times, and their unit: times of day, counted rows."""
    if isinstance(file, CountedRows):
        return {ROW_TIME: "s"}
    return {name: unit for name in file.columns if (unit := file.time_unit(name)) is not None}


def row_units(file: LogFile) -> tuple[str, ...]:
    """The units in a row below a CSV file's header, one for each column; empty if there is none."""
    if isinstance(file, CountedRows):
        inner = row_units(file.file)
        return (*inner, "s") if inner else ()
    return file.units if isinstance(file, CsvTable) else ()


def of_headers(
    columns: Sequence[str], row_units: Sequence[str] = (), of_day: Mapping[str, str] | None = None
) -> Tables | None:
    """The tables for columns whose names state sensor, axis and unit; None if time or gyro do not.

    Parameters
    ----------
    columns : sequence of str
    row_units : sequence of str
        Units in a row below the header, one for each column.
    of_day : mapping, optional
        What `times_of_day` says. Where no header states the unit of a time, the only such column has the times.

    Returns
    -------
    dict or None
    """
    plain = {f"{name} ({unit})": name for name, unit in zip(columns, row_units, strict=False)}
    stamps = {} if of_day is None else dict(of_day)
    if plain:
        stamps = {header: stamps[name] for header, name in plain.items() if name in stamps}
    found = _of_headers(tuple(plain) if plain else columns, stamps)
    if found is None or not plain:
        return found
    found["time_column"] = plain[found["time_column"]]
    for sensor in [found["flow"], *found.get("directions", [])]:
        sensor["columns"] = [plain[column] for column in sensor["columns"]]
    return found


def of_files(file: CsvFolder) -> Tables | None:
    """The tables for files whose headers state sensor, axis and unit; None if gyro or stamps do not, or two do.

    Parameters
    ----------
    file : CsvFolder

    Returns
    -------
    dict or None
    """
    found: dict[str, tuple[Sequence[str], str]] = {}
    for stem, table in file.tables.items():
        if file.stamps(stem) is None:
            continue
        sensors = _sensors_of(table.columns)
        if sensors is None or sensors.keys() & found.keys():
            return None
        found |= {sensor: ([f"{stem}.{name}" for name in names], unit) for sensor, (names, unit) in sensors.items()}
    return of_sensors(None, "s", found) if "gyroscope" in found else None


def _of_headers(columns: Sequence[str], of_day: Mapping[str, str]) -> Tables | None:
    stated = {column: match["unit"].lower() for column in columns if (match := TIME_HEADER.fullmatch(column.strip()))}
    times = list((stated or of_day).items())
    sensors = _sensors_of(columns)
    if len(times) != 1 or sensors is None or "gyroscope" not in sensors:
        return None
    column, unit = times[0]
    return of_sensors(column, units.unit_of(unit), sensors)


def _sensors_of(columns: Sequence[str]) -> dict[str, tuple[Sequence[str], str]] | None:
    """Columns and unit of each sensor that headers state in full; None if there are two of a kind."""
    found: dict[str, dict[str, tuple[str, str]]] = {}
    for column in columns:
        if match := _HEADER.fullmatch(column.strip()):
            unit = units.unit_of(match["unit"])
            for sensor, beginning in _SENSORS.items():
                if beginning.fullmatch(match["sensor"]) and unit in _UNITS[sensor]:
                    if match["axis"].lower() in found.setdefault(sensor, {}):
                        return None  # two such sensors: the user must say which
                    found[sensor][match["axis"].lower()] = column, unit
    sensors: dict[str, tuple[Sequence[str], str]] = {}
    for sensor, axes in found.items():
        stated = {unit for _, unit in axes.values()}
        if len(axes) == 3 and len(stated) == 1:
            sensors[sensor] = [axes[axis][0] for axis in "xyz"], stated.pop()
    return sensors


def unknown_units(columns: Sequence[str]) -> list[str]:
    """Headers of a sensor's axis with a unit that is not known for it, in words: such columns are passed over.

    Parameters
    ----------
    columns : sequence of str

    Returns
    -------
    list of str
    """
    found = []
    for name in map(str.strip, columns):
        match = _HEADER.fullmatch(name)
        if match is None or len(match["sensor"]) == 1:
            continue
        unit = units.unit_of(match["unit"])
        for sensor, beginning in _SENSORS.items():
            if beginning.fullmatch(match["sensor"]) and unit not in _UNITS[sensor]:
                known = ", ".join(str(one) for one in _UNITS[sensor])
                found.append(f"{match['unit'].strip()!r} of {name!r} is no unit of the {sensor} ({known})")
    return found


_BARE_TIME = re.compile(r"t|time|date|date[ _]?time|time[ _]?stamp", re.IGNORECASE)


def why_not_stated(columns: Sequence[str], of_day: Mapping[str, str]) -> str:
    """What headers lack to say by themselves which columns are which sensors, in words.

    Parameters
    ----------
    columns : sequence of str
        Headers of a file of which `of_headers` makes nothing.
    of_day : mapping
        What `times_of_day` says of it.

    Returns
    -------
    str
    """
    headers = [column.strip() for column in columns]
    if len(headers) == 1:
        header = textwrap.shorten(headers[0], 40, placeholder="...")
        return f"it is one column, {header!r}; if there are more, --delimiter says what separates them"
    if twice := [name for name in dict.fromkeys(headers) if headers.count(name) > 1]:
        return f"two columns are called {twice[0]!r}"
    if unknown := unknown_units(columns):
        return unknown[0]
    times = [name for name in headers if TIME_HEADER.fullmatch(name)] or list(of_day)
    if len(times) > 1:
        return f"{' and '.join(map(repr, times))} are two columns of times"
    sensors = _sensors_of(columns)
    if times and sensors is None:
        return "two sensors of a kind state their axes: which one counts?"
    lacks = [] if times else ["times, such as 'Time (s)'"]
    if sensors is not None and "gyroscope" not in sensors:
        lacks.append("a gyroscope's three axes with their unit, such as 'Gyroscope X (deg/s)'")
    rate = "" if times else "; if the rows come at a rate, --row-rate-hz says it"
    if not times and (bare := [name for name in headers if _BARE_TIME.fullmatch(name)]):
        rate += f"; without a unit {bare[0]!r} is read if it has dates and times of ISO 8601, such as {ISO_STAMP}"
    return f"no columns state {' or '.join(lacks)}{rate}"


def configuration_of(tables: Tables, path: str | os.PathLike[str]) -> Configuration:
    """A configuration to read the log with. Missing bounds are filled in with numbers that mean nothing.

    Parameters
    ----------
    tables : dict
    path : path-like
        The file with the tables, for messages.

    Returns
    -------
    Configuration

    Raises
    ------
    FileError
        If the tables do not fit.
    """
    full = copy.deepcopy(tables)
    flow = full.get("flow")
    if not isinstance(flow, dict) or flow.get("kind") != "gyro":
        raise FileError(f"{path}: bounds are proposed from a gyro, and what is beside it: flow.kind = 'gyro' is needed")
    flow.setdefault("noise_deg_per_s", 1.0)
    directions = full.get("directions")
    for sensor in directions if isinstance(directions, list) else []:
        if isinstance(sensor, dict):
            if not sensor.keys() & {"bound_deg", "bound_rad2", "bound_from"}:
                sensor["bound_deg"] = 1.0
            if sensor.get("kind") == "magnetometer" and not sensor.keys() & {"reference", "reference_ut"}:
                sensor["reference_ut"] = [0.0, 1.0, 0.0]
    if "rule" in full:
        full.setdefault("reference_frame", "ENU")  # a rule's own
    # Bounds are of samples as they are; `estimate` decides between them and what a calibration leaves.
    for key in ("start", "estimator", "rule", "calibration", "velocity"):
        full.pop(key, None)
    full["start"] = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1.0] * 6}
    return validate(path, full, Configuration)


def with_own_bounds(tables: Tables) -> set[str]:
    """The names of directions whose bounds the tables state, by a rule or one by one."""
    return {
        sensor["name"]
        for sensor in tables.get("directions", [])
        if "rule" in tables or sensor.keys() & {"bound_deg", "bound_rad2", "bound_from"}
    }


def read_recording(path: LogSource, configuration: Configuration) -> tuple[Recording, int]:
    """Read the recording that bounds are proposed from, at the gyro's times.

    Measurements at other times are interpolated between their samples, which smooths part of their noise
    away. The reference attitude is turned to a frame whose third axis is up.

    Parameters
    ----------
    path : path-like
    configuration : Configuration

    Returns
    -------
    recording : Recording
    origin : int
        What was subtracted from the file's times, s.

    Raises
    ------
    FileError
        If it cannot be read, or is too short.
    """
    name = path if isinstance(path, str | os.PathLike) else path.path
    samples = {one.name: one for one in log.read_samples(path, configuration)}
    gyro = samples["the gyro"]
    if len(gyro.times) < 3:
        raise FileError(
            f"{name}: bounds cannot be proposed from fewer than 3 samples of the gyro, and it has {len(gyro.times)}"
        )
    vectors: dict[str, FloatArray] = {}
    sampled: dict[str, NDArray[np.bool_]] = {}
    for sensor in configuration.directions:
        if sensor.kind != "direction" and sensor.kind not in vectors:
            there = samples[sensor.name]
            if not np.isfinite(there.values[:, 0]).any():
                columns = ", ".join(sensor.columns)
                raise FileError(
                    f"{name}: {sensor.name!r} ({columns}) is measured at no row: leave it out, by a configuration or "
                    "by options that name the columns of the other sensors (--time, --gyro, --accelerometer)"
                )
            vectors[sensor.kind] = _at(gyro.times, there.times, there.values[:, :3])
            sampled[sensor.kind] = np.isin(gyro.times, there.times)
    attitudes = None
    if configuration.truth is not None:
        reference = reference_attitudes.read_reference(name, configuration, origin=gyro.counts_from)
        gap = _LARGEST_GAP * float(np.median(np.diff(reference.times))) if len(reference.times) > 1 else 0.0
        rows, rotations = reference_attitudes.attitudes_at(reference, gyro.times, np.arange(len(gyro.times)), gap)
        if configuration.reference_frame not in {None, "J2000"}:
            # Columns are the frame's axes in ENU.
            to_enu = references.from_enu(np.eye(3), configuration.reference_frame)
            rotations = type(rotations).from_matrix(to_enu) * rotations
        attitudes = np.full((len(gyro.times), 4), np.nan)
        attitudes[rows] = rotations.as_quat(canonical=True, scalar_first=True)
    fields = vectors.get("magnetometer")
    recording = Recording(
        gyro.times,
        gyro.values,
        vectors.get("accelerometer"),
        None if fields is None else fields / units.FIELD["uT"],
        attitudes,
        float(np.logical_and.reduce(list(sampled.values())).mean()) if sampled else 1.0,
        float(sampled["accelerometer"].mean()) if "accelerometer" in sampled else 1.0,
    )
    return recording, gyro.origin


def _at(times: FloatArray, stamps: FloatArray, values: FloatArray) -> FloatArray:
    """Values at other times, NaN beyond the ends and in gaps, shape (N, 3)."""
    if np.array_equal(times, stamps):
        return values
    result = np.full((len(times), 3), np.nan)
    if len(stamps) < 2:
        return result
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    steps = np.diff(stamps)
    inside = (times >= stamps[0]) & (times <= stamps[-1]) & (steps[after - 1] <= _LARGEST_GAP * np.median(steps))
    for i in range(3):
        result[inside, i] = np.interp(times[inside], stamps, values[:, i])
    return result
