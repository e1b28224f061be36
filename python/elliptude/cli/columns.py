"""Which columns of a log are which sensors, as the options of ``elliptude bounds`` say it."""

import csv
import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import typer

from elliptude.configuration.findings.finding import KEYS, Remedy, Words
from elliptude.io.files import FileError
from elliptude.io.readers.counted import ROW_TIME
from elliptude.io.readers.open import open_log
from elliptude.io.readers.text.dialect import Stated
from elliptude.io.readers.text.folder import CsvFolder, SensorLogger
from elliptude.io.spool import NamedFile
from elliptude.io.toml import load_toml
from elliptude.proposal import mapping
from elliptude.proposal.known_formats import AtRest, scale_field, turn_at_rest
from elliptude.proposal.mapping import Tables, of_preset, presets


def tables_of(
    log: NamedFile,
    config: Path | None,
    like: str | None,
    time: str | None,
    time_unit: str | None,
    named: dict[str, tuple[str | None, str | None]],
    truth: str | None,
    stated: Stated,
    at_rest: AtRest | None,
) -> tuple[Tables, os.PathLike[str]]:
    """Which columns of a log are which sensors, and the file that says so."""
    if stated.row_rate_hz is not None and (config is not None or time is not None):
        other = "--time" if config is None else "the configuration's [timing] row_rate_hz"
        raise typer.BadParameter(f"it is in the place of {other}", param_hint="--row-rate-hz")
    tables, stated_in = _tables_of(log, config, like, time, time_unit, named, truth, stated, at_rest)
    if stated.row_rate_hz is not None:
        times = {"time_column": ROW_TIME, "time_unit": "s"}
        tables = times | tables | times | {"timing": {"row_rate_hz": stated.row_rate_hz}}
    return tables, stated_in


def _tables_of(
    log: NamedFile,
    config: Path | None,
    like: str | None,
    time: str | None,
    time_unit: str | None,
    named: dict[str, tuple[str | None, str | None]],
    truth: str | None,
    stated: Stated,
    at_rest: AtRest | None,
) -> tuple[Tables, os.PathLike[str]]:
    by_name = any(columns is not None for columns, _ in named.values()) or time is not None
    if (config is not None) + (like is not None) + by_name > 1:
        raise typer.BadParameter("give one of a configuration, --like, and columns by name")
    if at_rest is not None and (config is not None or (like is None and not by_name)):
        raise typer.BadParameter("goes with columns by name or --like", param_hint="--at-rest")
    if not by_name:
        _require_none(
            "goes with columns by name: --time, --gyro and so on", {"--time-unit": time_unit, "--truth": truth}
        )
    for name, (columns, unit) in named.items():
        if columns is None:
            option = "--gyro" if name == "gyroscope" else f"--{name}"
            _require_none(f"goes with {option}, which names the columns", {f"{option}-unit": unit})
    if config is not None:
        tables = load_toml(config)
        mapping.configuration_of(tables, config)  # what follows takes them as sound
        return tables, config
    if like is not None:
        if like not in presets():
            raise typer.BadParameter(f"{like!r} is none of {', '.join(presets())}", param_hint="--like")
        return of_preset(like, open_log(log, stated), at_rest), log
    if not by_name:
        file = open_log(log, stated)
        if isinstance(file, SensorLogger):
            raise FileError(f"{log}: a recording of Sensor Logger, whose headers state no unit: --like sensor-logger")
        of_day = mapping.times_of_day(file)
        if isinstance(file, CsvFolder):
            found = mapping.of_files(file)
        else:
            found = mapping.of_headers(file.columns, mapping.row_units(file), of_day)
        if found is not None:
            for unknown in [] if isinstance(file, CsvFolder) else mapping.unknown_units(file.columns):
                typer.secho(f"passed over: {unknown}", fg=typer.colors.YELLOW, err=True)
            return found, log
        why = "" if isinstance(file, CsvFolder) else f" ({mapping.why_not_stated(file.columns, of_day)})"
        raise FileError(
            f"{log}: its columns do not state sensor, axis and unit, as 'Gyroscope X (deg/s)' beside 'Time (s)' does"
            f"{why}: give a configuration, --like, or --time, --gyro, --gyro-unit and so on"
        )
    sensors: dict[str, tuple[Sequence[str], str]] = {}
    for name, (columns, unit) in named.items():
        option = "--gyro" if name == "gyroscope" else f"--{name}"
        if columns is None:
            continue
        if unit is None:
            raise typer.BadParameter("a unit must be stated, none is guessed", param_hint=f"{option}-unit")
        sensors[name] = _listed(columns, 3, option), unit
    file = open_log(log, stated)
    has_stamps = any(file.stamps(stream) is not None for stream in {file.stream(column) for column in file.columns})
    needs_none = has_stamps or stated.row_rate_hz is not None
    if (time is None) != needs_none or "gyroscope" not in sensors:
        if time is not None and has_stamps:
            raise typer.BadParameter("topics have stamps of their own: leave it out", param_hint="--time")
        missing = "--gyro" if "gyroscope" not in sensors else "--time, or --row-rate-hz if the rows come at a rate"
        raise typer.BadParameter("needed with columns by name", param_hint=missing)
    found = mapping.of_sensors(time, time_unit or "s", sensors, _listed(truth, 4, "--truth") if truth else ())
    turn_at_rest(found, at_rest)
    return found, log


def _require_none(why: str, options: Mapping[str, str | None]) -> None:
    """Refuse an option that would count for nothing."""
    for option, value in options.items():
        if value is not None:
            raise typer.BadParameter(why, param_hint=option)


def state_field(tables: Tables, field_ut: float | None, config: Path | None) -> None:
    """Say in tables how strong the local field is at least, unless a configuration has them, which says it itself."""
    if config is None:
        scale_field(tables, field_ut)
    elif field_ut is not None:
        raise typer.BadParameter("the configuration says it: unit_ut", param_hint="--field-ut")


def stated_reading(tables: Tables, by_options: Stated) -> Stated:
    """How a file is to be read, by options and by a configuration."""
    names = {field.name for field in dataclasses.fields(Stated)}
    said = [table for key in ("csv", "timing") if isinstance(table := tables.get(key), dict)]
    known = {key: value for table in said for key, value in table.items() if key in names}
    return dataclasses.replace(Stated(**known), **{k: v for k, v in vars(by_options).items() if v is not None})


def _listed(columns: str, count: int, option: str) -> list[str]:
    listed = next(csv.reader([columns], skipinitialspace=True))
    if len(listed) != count:
        raise typer.BadParameter(f"{count} columns, not {len(listed)}", param_hint=option)
    return listed


# Spellings that a header has for the letters of a unit.
_SPELLINGS = str.maketrans({"µ": "u", "μ": "u", "°": "deg", "²": "^2"})


def _with_unit(columns: Sequence[str], unit: str, more: str = "") -> str:
    """Columns with the unit as which they are read, which is said once if their names end with it."""
    cut = [column.rpartition(" (") for column in columns]
    if all(name and end.removesuffix(")").translate(_SPELLINGS) == unit for name, _, end in cut):
        columns = [name for name, _, _ in cut]
    return f"{', '.join(columns)} ({unit}{more})"


def in_words(tables: Tables) -> list[str]:
    """How each column was read."""
    lines = ["time: the file's own stamps"]
    if "time_column" in tables:
        lines = [f"time: {_with_unit([tables['time_column']], tables.get('time_unit', 's'))}"]
    for sensor in [tables["flow"], *tables.get("directions", [])]:
        down = ", down at rest" if sensor.get("at_rest") == "down" else ""
        field = f", 1 is {sensor['unit_ut']:g} µT" if "unit_ut" in sensor else ""
        kind = sensor.get("kind", "direction")
        unit = sensor.get("unit", "rad/s" if kind == "gyro" else "no unit")
        lines.append(f"{kind}: {_with_unit(sensor['columns'], unit, down + field)}")
    if "velocity" in tables:
        velocity = tables["velocity"]
        lines.append(f"velocity: {_with_unit(velocity['columns'], velocity.get('unit', 'm/s'))}")
    if "truth" in tables:
        lines.append(f"reference attitude: {', '.join(tables['truth']['attitude_columns'])}")
    return lines


class OptionWords(Words):
    """What the options of `bounds` call the units of columns."""

    if_right = (
        "If it is right as it is, leave out --out and --rule, or give a configuration that says implausible = 'ignore'"
    )
    strength, by_strength = "--field-ut", "by --field-ut"
    before = ""

    def to_state(self, remedy: Remedy) -> str:
        """Which option to give."""
        if remedy.key.name not in {"unit", "time_unit"}:
            return super().to_state(remedy)
        return f"{self.before}say --{remedy.key.of}-unit {remedy.meant}{self.of_normalized(remedy)}"


class FirstNameColumns(OptionWords):
    """The same where a header or --like states columns and units: options of units go with those of columns."""

    before = "name the columns by options, and "


OPTIONS = OptionWords()
"""Those of columns that are named by options."""


def words_of(config: Path | None, named: Mapping[str, tuple[str | None, str | None]]) -> Words:
    """How what is found is said: as somebody stated it."""
    if config is not None:
        return KEYS
    return OPTIONS if any(columns is not None for columns, _ in named.values()) else FirstNameColumns()
