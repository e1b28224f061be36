"""What known formats leave open, and options say: which way gravity points, what a time stamp or a unit counts."""

import math
from typing import Any, Literal, TypeAlias

import numpy as np

from elliptude import units
from elliptude.io.files import FileError
from elliptude.io.readers.base import LogFile
from elliptude.io.readers.text.folder import SUM, SensorLogger
from elliptude.io.readers.text.xsens import COUNTER, PACKET_TIME, STAMP, UTC_TIME, XsensTable

AtRest: TypeAlias = Literal["up", "down"]

# s; no sensor of Xsens is sampled more seldom. A DOT counts 1 µs, so that its steps would seem a hundred times as long.
_LONGEST_STEP = 0.25
_TICK = 1e-4


def complete_sensor_logger(tables: dict[str, Any], file: LogFile, at_rest: AtRest | None) -> None:
    """Put the accelerometer of a recording of Sensor Logger into the preset's tables.

    Accelerometer.csv is without gravity on every phone: a filter of the phone has subtracted its own idea of up. On an
    iPhone the signs of all files with acceleration are the opposite of Android's, unless "Standardise Units & Frames"
    was on, as Metadata.csv says.

    Parameters
    ----------
    tables : dict
        Those of the preset; changed.
    file : LogFile
    at_rest : {"up", "down"}, optional
        Where the accelerometer points at rest, if the user says it.

    Raises
    ------
    FileError
        If it is no such recording, nothing in it has gravity, or nothing says which way that points.
    """
    if not isinstance(file, SensorLogger):
        raise FileError(
            f"{file.path}: no recording of Sensor Logger, which is a folder or ZIP archive of CSV files with the "
            "columns time, seconds_elapsed, z, y, x"
        )
    accelerometer = tables["directions"][0]
    has_total = "TotalAcceleration" in file.tables
    if not has_total and f"{SUM}.x" not in file.columns:
        if "Accelerometer" not in file.tables:
            return  # a gyro and a magnetometer, of which others say what they lack
        raise FileError(
            f"{file.path}: Accelerometer.csv is the acceleration without gravity, which does not show which way is up. "
            "Record TotalAcceleration (Android) or Gravity (iPhone) with it"
        )
    if not has_total:
        accelerometer["columns"] = [f"{SUM}.{axis}" for axis in "xyz"]
    if (at_rest or _by_metadata(file)) == "down":
        accelerometer["at_rest"] = "down"


def _by_metadata(file: SensorLogger) -> AtRest:
    """Where the accelerometer points at rest, by the phone's system and the app's setting."""
    platform, standard = (file.metadata.get(key, "").strip().lower() for key in ("platform", "standardisation"))
    if platform == "android" or (platform == "ios" and standard == "true"):
        return "up"
    if platform == "ios" and standard == "false":
        return "down"
    lacks = "platform" if platform not in {"android", "ios"} else "standardisation"
    raise FileError(
        f"{file.path}: Metadata.csv does not say the {lacks}: with --at-rest say whether the accelerometer shows up "
        "(+z with the screen up, as Android does) or down (as iPhones do unless 'Standardise Units & Frames' was on)"
    )


def complete_xsens(tables: dict[str, Any], file: LogFile) -> None:
    """Say in the preset's tables which column has the times: SampleTimeFine, the time of day, or counted packets.

    Parameters
    ----------
    tables : dict
        Those of the preset; changed.
    file : LogFile

    Raises
    ------
    FileError
        If stamps count something else than 0.1 ms, or nothing says the time; with what to do instead.
    """
    if _has_stamps(file):
        return
    if UTC_TIME in file.columns:
        tables["time_column"], tables["time_unit"] = UTC_TIME, "ns"
    elif PACKET_TIME in file.columns and isinstance(file, XsensTable):
        step = _median_step(file, PACKET_TIME) * file.rate_hz
        if abs(step - 1.0) > 0.01:
            raise FileError(
                f"{file.path}: {COUNTER} goes up by {step:g} from row to row (median), so that it does not count what "
                f"the update rate of {file.rate_hz:g} Hz is of. With --packet-rate-hz say by how much it goes up in a "
                "second, and put a column of times in its place if it is no counter of samples"
            )
        tables["time_column"], tables["time_unit"] = PACKET_TIME, "s"
    else:
        lacks = f"{STAMP} is empty" if STAMP in file.columns else f"there is no {STAMP}"
        if isinstance(file, XsensTable) and not file.rate_hz:
            raise FileError(
                f"{file.path}: {lacks}; {COUNTER} counts packets, and no line above the header states their rate, as "
                "'// Update Rate: 100.0Hz' does: say it with --packet-rate-hz"
            )
        raise FileError(
            f"{file.path}: {lacks}, and there is neither a time of day (UTC_Year to UTC_Nano) nor {COUNTER}: export it "
            "with one of them from MT Manager, or put a column of times in its place"
        )


def _has_stamps(file: LogFile) -> bool:
    """Whether a file has stamps that count 0.1 ms."""
    if STAMP not in file.columns:
        return False
    step = _median_step(file, STAMP)
    if step * _TICK > _LONGEST_STEP:
        raise FileError(
            f"{file.path}: {STAMP} would have steps of {step * _TICK:.3g} s if it counted 0.1 ms, as MT Manager "
            "exports it. A Movella DOT counts 1 µs, and shows rates in deg/s: --time SampleTimeFine --time-unit us "
            "--gyro ..."
        )
    return not np.isnan(step)


def _median_step(file: LogFile, column: str) -> float:
    """The median step of the first rows; 0 if only one has a number, NaN if none has."""
    cells = next(file.batches([column]), {}).get(column)
    if cells is None:
        return 0.0  # others say that there are no rows
    there = cells.values[~cells.empty & np.isfinite(cells.values)]
    if len(there) < 2:
        return 0.0 if len(there) else math.nan
    return float(np.median(np.diff(there)))


def scale_field(tables: dict[str, Any], unit_ut: float | None) -> None:
    """Say how many µT the unit of a normalized magnetometer is.

    Parameters
    ----------
    tables : dict
        Changed.
    unit_ut : float, optional
        By the user; else what the tables have.

    Raises
    ------
    FileError
        If a normalized magnetometer has none, or there is none that is normalized.
    """
    normalized = [one for one in tables.get("directions", []) if one.get("unit") == "normalized"]
    if unit_ut is not None and not normalized:
        raise FileError("--field-ut is for a normalized magnetometer; there is none (--magnetometer-unit normalized)")
    for sensor in normalized:
        if unit_ut is not None:
            sensor["unit_ut"] = unit_ut
        elif "unit_ut" not in sensor:
            raise FileError(
                "a normalized magnetometer needs --field-ut: how many µT one unit is, at least. That is the strength "
                f"of the field where it was normalized; {units.WEAKEST_FIELD_UT:g} is right everywhere on the Earth"
            )


def turn_at_rest(tables: dict[str, Any], at_rest: AtRest | None) -> None:
    """Say where the accelerometer points at rest, if the user says it; up needs no word."""
    for sensor in tables.get("directions", []):
        if at_rest is not None and sensor.get("kind") == "accelerometer":
            sensor.pop("at_rest", None)
            if at_rest == "down":
                sensor["at_rest"] = at_rest
