"""What the files of phone apps leave open: which of them have gravity in them, and which way it points at rest."""

from typing import Any, Literal, TypeAlias

from elliptude.io.files import FileError
from elliptude.io.readers.base import LogFile
from elliptude.io.readers.folder import SUM, SensorLogger

AtRest: TypeAlias = Literal["up", "down"]


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
