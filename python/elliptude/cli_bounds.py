"""The command ``elliptude bounds``."""

import csv
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomlkit
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude import bound_rules, mapping, proposals
from elliptude.cli_options import Force, refuse_to_replace, require_finite
from elliptude.files import FileError, replacing
from elliptude.mapping import PRESETS, Tables
from elliptude.models import load_toml
from elliptude.proposals import DelayProposal, Proposal, Quantiles
from elliptude.readers import open_log
from elliptude.starting_configuration import starting_configuration, upward

_NOTE = (
    "These are quantiles and maxima of one recording. They are no guarantee: another recording, or the next minute of "
    "this one, may exceed any of them. A bound to rely on needs a reason, such as a datasheet or the size of the room."
)


def bounds(
    log: Annotated[Path, typer.Argument(help="A recording, in any format of docs/logs.md.", show_default=False)],
    config: Annotated[
        Path | None,
        typer.Argument(help="Which columns are which sensors: TOML; bounds may be missing.", show_default=False),
    ] = None,
    like: Annotated[
        str | None,
        typer.Option(help=f"Columns and units of a known kind of file: {', '.join(PRESETS)}.", show_default=False),
    ] = None,
    time: Annotated[str | None, typer.Option(help="Column of times.", show_default=False)] = None,
    time_unit: Annotated[str, typer.Option(help="s, ms, us or ns.")] = "s",
    gyro: Annotated[str | None, typer.Option(help="Three columns, comma between.", show_default=False)] = None,
    gyro_unit: Annotated[str | None, typer.Option(help="rad/s or deg/s.", show_default=False)] = None,
    accelerometer: Annotated[str | None, typer.Option(help="Three columns.", show_default=False)] = None,
    accelerometer_unit: Annotated[str | None, typer.Option(help="m/s^2, g or mg.", show_default=False)] = None,
    magnetometer: Annotated[str | None, typer.Option(help="Three columns.", show_default=False)] = None,
    magnetometer_unit: Annotated[str | None, typer.Option(help="T, G, mG, uT or nT.", show_default=False)] = None,
    truth: Annotated[
        str | None, typer.Option(help="Four columns qw,qx,qy,qz from body to reference axes.", show_default=False)
    ] = None,
    reference: Annotated[
        bool,
        typer.Option("--reference/--no-reference", help="Compare with the reference attitude, if it is mapped."),
    ] = True,
    margin: Annotated[
        float, typer.Option(min=1.0, max=100.0, help="What maxima are multiplied by in what is written.")
    ] = 1.2,
    out: Annotated[
        Path | None, typer.Option(help="Write a whole configuration to start from: TOML.", show_default=False)
    ] = None,
    rule: Annotated[
        Path | None, typer.Option(help="Write a rule for bounds to start from: TOML.", show_default=False)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
    force: Force = False,
) -> None:
    """Propose bounds, delays and time offsets from a recording, with or without a reference attitude.

    Which columns are which sensors, and in which units, is said by a configuration, by --like, by naming columns and
    units, or by the file's header where it states sensor, axis and unit, such as "Gyroscope X (deg/s)". What it prints
    are quantiles and maxima of this recording, which guarantee nothing about another.
    """
    require_finite("--margin", margin)
    refuse_to_replace((path for path in (out, rule) if path is not None), force)
    named = {
        "gyroscope": (gyro, gyro_unit),
        "accelerometer": (accelerometer, accelerometer_unit),
        "magnetometer": (magnetometer, magnetometer_unit),
    }
    tables, source = _mapping(log, config, like, time, time_unit, named, truth)
    configuration = mapping.configuration_of(tables, source)
    recording, origin = mapping.read_recording(log, configuration)
    if not reference:
        recording = dataclasses.replace(recording, attitudes=None)
    try:
        proposed = proposals.propose(recording)
        document = (
            None if out is None else starting_configuration(tables, proposed, margin, log=log.name, origin=origin)
        )
    except ValueError as error:
        raise FileError(f"{log}: {error}") from error
    if out is not None and document is not None:
        with replacing(out) as temporary:
            temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    if rule is not None:
        _write(rule, proposed, margin, log)
    if as_json:
        summary = {"log": str(log), "note": _NOTE, "margin": margin} | summarize(proposed)
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False))
        return
    compared = "with its reference attitude" if recording.attitudes is not None else "without a reference attitude"
    typer.echo(
        f"{log}: {len(recording.times)} rows, {proposed.duration:.4g} s, {100.0 * proposed.rest:.3g} % at rest, "
        f"{compared}"
    )
    for line in _said(tables):
        typer.echo(f"  {line}")
    Console(width=max(Console().width, 100)).print(_table(proposed))
    for line in _remarks(proposed):
        typer.echo(line)
    typer.echo(_NOTE)
    if out is not None:
        typer.echo(f"Written: {out}, for `elliptude estimate {log} --config {out}`: maxima times {margin:g}.")
    if rule is not None:
        typer.echo(
            f"Written: {rule}, maxima times {margin:g}; the rule for a sensor in the hand where it shows nothing."
        )


# --- what is read -----------------------------------------------------------------------------------------------------


def _mapping(
    log: Path,
    config: Path | None,
    like: str | None,
    time: str | None,
    time_unit: str,
    named: dict[str, tuple[str | None, str | None]],
    truth: str | None,
) -> tuple[Tables, Path]:
    """Which columns are which sensors, and the file that says so."""
    by_name = any(columns is not None for columns, _ in named.values()) or time is not None
    if (config is not None) + (like is not None) + by_name > 1:
        raise typer.BadParameter("give one of a configuration, --like, and columns by name")
    if config is not None:
        return load_toml(config), config
    if like is not None:
        if like not in PRESETS:
            raise typer.BadParameter(f"{like!r} is none of {', '.join(PRESETS)}", param_hint="--like")
        return _present(PRESETS[like], log), log
    if not by_name:
        if (found := mapping.of_headers(open_log(log).columns)) is not None:
            return found, log
        raise FileError(
            f"{log}: its columns do not state sensor, axis and unit, as 'Gyroscope X (deg/s)' beside 'Time (s)' does: "
            "give a configuration, --like, or --time, --gyro, --gyro-unit and so on"
        )
    sensors: dict[str, tuple[Sequence[str], str]] = {}
    for name, (columns, unit) in named.items():
        option = "--gyro" if name == "gyroscope" else f"--{name}"
        if columns is None:
            continue
        if unit is None:
            raise typer.BadParameter("a unit must be stated, none is guessed", param_hint=f"{option}-unit")
        sensors[name] = _listed(columns, 3, option), unit
    if time is None or "gyroscope" not in sensors:
        raise typer.BadParameter("needed with columns by name", param_hint="--time, --gyro")
    return mapping.of_sensors(time, time_unit, sensors, _listed(truth, 4, "--truth") if truth else ()), log


def _present(tables: Tables, log: Path) -> Tables:
    """A preset without the sensors that the file does not have; the gyro it must have."""
    columns = set(open_log(log).columns)
    tables = dict(tables)
    if "directions" in tables:
        tables["directions"] = [one for one in tables["directions"] if columns.issuperset(one["columns"])]
    if not columns.issuperset(tables["truth"]["attitude_columns"]):
        del tables["truth"]
    return tables


def _listed(columns: str, count: int, option: str) -> list[str]:
    listed = next(csv.reader([columns], skipinitialspace=True))
    if len(listed) != count:
        raise typer.BadParameter(f"{count} columns, not {len(listed)}", param_hint=option)
    return listed


def _said(tables: Tables) -> list[str]:
    """What is read as what."""
    lines = [f"time: {tables.get('time_column', 'time_s')} ({tables.get('time_unit', 's')})"]
    for sensor in [tables["flow"], *tables.get("directions", [])]:
        lines.append(f"{sensor.get('kind', 'direction')}: {', '.join(sensor['columns'])} ({sensor.get('unit', '-')})")
    if "truth" in tables:
        lines.append(f"reference attitude: {', '.join(tables['truth']['attitude_columns'])}")
    return lines


# --- what is said -----------------------------------------------------------------------------------------------------

_DEGREES = float(np.rad2deg(1.0))


def _lines(proposed: Proposal) -> list[tuple[str, str, float, Quantiles | None]]:
    """Key, what it is, its unit's factor, the numbers."""
    gyro = proposed.gyro
    lines: list[tuple[str, str, float, Quantiles | None]] = [
        ("gyro_speed_deg_per_s", "gyro: rate, °/s", _DEGREES, gyro.speed),
        ("gyro_noise_deg_per_s", "gyro: noise at rest, °/s", _DEGREES, gyro.noise),
        ("gyro_bias_spread_deg_per_s", "gyro: bias of 0.5 s at rest, from its mean, °/s", _DEGREES, gyro.bias_spread),
        (
            "gyro_rate_error_deg_per_s",
            "gyro: rate over 0.05 s, from the reference, °/s",
            _DEGREES,
            gyro.rate_error,
        ),
    ]
    for duration, angles in gyro.window_angles.items():
        lines.append(
            (
                f"gyro_turn_error_{duration:g}s_deg",
                f"gyro: turn over {duration:g} s, from the reference, °",
                _DEGREES,
                angles,
            )
        )
    for key, unit, name, vector in (
        ("accelerometer", "m_per_s2", "accelerometer", proposed.accelerometer),
        ("magnetometer", "ut", "magnetometer", proposed.magnetometer),
    ):
        if vector is None:
            continue
        shown = "m/s²" if unit == "m_per_s2" else "µT"
        for state in ("rest", "moving"):
            about = "at rest" if state == "rest" else "moving"
            lines += [
                (
                    f"{key}_norm_{state}_{unit}",
                    f"{name}: length off, {about}, {shown}",
                    1.0,
                    getattr(vector, f"norm_{state}"),
                ),
                (
                    f"{key}_vector_{state}_{unit}",
                    f"{name}: vector off, {about}, {shown}",
                    1.0,
                    getattr(vector, f"vector_{state}"),
                ),
                (
                    f"{key}_angle_{state}_deg",
                    f"{name}: angle off, {about}, °",
                    _DEGREES,
                    getattr(vector, f"angle_{state}"),
                ),
            ]
        lines.append(
            (
                f"{key}_aligned_rest_deg",
                f"{name}: the same at rest, best turn removed, °",
                _DEGREES,
                vector.aligned_rest,
            )
        )
    lines.append(
        ("dip_rest_deg", "angle between field and specific force at rest, from its median, °", _DEGREES, proposed.dip)
    )
    return lines


def summarize(proposed: Proposal) -> dict[str, Any]:
    """The proposal for JSON: quantiles by key, delays in s; None where the recording does not show it."""
    summary: dict[str, Any] = {"duration_s": proposed.duration, "share_at_rest": proposed.rest}
    bias = proposed.gyro.bias
    summary["gyro_bias_deg_per_s"] = None if bias is None else np.rad2deg(bias).tolist()
    summary["gyro_scale_error"] = proposed.gyro.scale_error
    summary["quantiles"] = {
        key: None
        if found is None
        else {
            "samples": found.count,
            "50%": found.half * factor,
            "90%": found.ninety * factor,
            "99%": found.ninety_nine * factor,
            "99.9%": found.ninety_nine_point_nine * factor,
            "max": found.maximum * factor,
        }
        for key, _, factor, found in _lines(proposed)
    }
    for key, delay in (("gyro_delay_s", proposed.gyro_delay), ("magnetometer_delay_s", proposed.magnetometer_delay)):
        summary[key] = None if delay is None else dataclasses.asdict(delay)
    return summary


def _table(proposed: Proposal) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 1))
    table.add_column("")
    for heading in ("50 %", "90 %", "99 %", "99.9 %", "max"):
        table.add_column(heading, justify="right", no_wrap=True)
    for _, name, factor, found in _lines(proposed):
        if found is not None:
            numbers = (found.half, found.ninety, found.ninety_nine, found.ninety_nine_point_nine, found.maximum)
            table.add_row(name, *(f"{factor * number:.3g}" for number in numbers))
    return table


def _remarks(proposed: Proposal) -> list[str]:
    lines = []
    if proposed.gyro.bias is not None:
        bias = ", ".join(f"{value:.3f}" for value in np.rad2deg(proposed.gyro.bias))
        lines.append(f"Gyro: bias ({bias}) °/s")
    if proposed.gyro.scale_error is not None:
        lines.append(f"Gyro: scale and cross-axis error about {100.0 * proposed.gyro.scale_error:.2g} %")
    for name, against, delay in (
        ("Gyro", "the reference", proposed.gyro_delay),
        ("Magnetometer", "the gyro", proposed.magnetometer_delay),
    ):
        if delay is not None:
            lines.append(
                f"{name}: {1e3 * delay.delay:.2f} ms late against {against}; in {delay.pieces} pieces of the recording "
                f"at most {1e3 * delay.scatter:.2f} ms from that (a row is {1e3 * delay.step:.3g} ms)"
            )
    for name, vector in (("Accelerometer", proposed.accelerometer), ("Magnetometer", proposed.magnetometer)):
        if vector is not None and vector.misalignment is not None:
            lines.append(
                f"{name}: the turn that fits best at rest is {_DEGREES * vector.misalignment:.2g}° "
                "(about the vector itself a single pose tells nothing)"
            )
    return lines


# --- what is written --------------------------------------------------------------------------------------------------


def _write(path: Path, proposed: Proposal, margin: float, log: Path) -> None:
    document = tomlkit.document()
    for line in (
        f"Proposed by `elliptude bounds` from {log.name}: maxima of that recording, times {margin:g}.",
        "They guarantee nothing about another recording. Replace each number by one for which there is a reason, such",
        "as a datasheet or the size of the room; what the recording could not show is that of the rule for a sensor in",
        "the hand, as marked.",
    ):
        document.add(tomlkit.comment(line))
    for name, table in rule_tables(proposed, margin).items():
        document.add(tomlkit.nl())
        section = tomlkit.table()
        for key, (value, seen) in table.items():
            section.add(key, value)
            if not seen:
                section[key].comment("not seen in the recording")
        document.add(name, section)
    with replacing(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")


def rule_tables(proposed: Proposal, margin: float) -> dict[str, dict[str, tuple[Any, bool]]]:
    """A rule to start from: by table and key the value, and whether the recording showed it.

    Parameters
    ----------
    proposed : Proposal
    margin : float
        What maxima are multiplied by.

    Returns
    -------
    dict
        What `elliptude.bound_rules.Rule` takes, each value with True if it comes from the recording.
    """
    standard = bound_rules.hand_held().model_dump(mode="json", exclude_none=True)
    if proposed.magnetometer is None:
        del standard["magnetometer"]
    seen: dict[tuple[str, str], float | None] = {}

    def largest(found: Quantiles | None, factor: float = 1.0) -> float | None:
        return None if found is None else margin * factor * found.maximum

    gyro = proposed.gyro
    seen["gyro", "noise_deg_per_s"] = largest(gyro.noise, _DEGREES)
    seen["gyro", "bias_deg_per_s"] = largest(gyro.bias_spread, _DEGREES)
    if gyro.scale_error is not None:
        seen["gyro", "scale_error"] = min(margin * gyro.scale_error, 0.99)
    if proposed.accelerometer is not None:
        rest = proposed.accelerometer.vector_rest or proposed.accelerometer.norm_rest
        seen["accelerometer", "error_m_per_s2"] = largest(rest)
    if proposed.magnetometer is not None:
        vector = proposed.magnetometer
        seen["magnetometer", "error_ut"] = largest(vector.vector_rest or vector.norm_rest)
        seen["magnetometer", "disturbance_ut"] = largest(vector.vector_moving or vector.norm_moving)
        delay = proposed.magnetometer_delay
        if delay is not None:
            seen["magnetometer", "delay_s"] = delay.delay
            seen["magnetometer", "time_offset_bound_s"] = _offset_bound(delay, margin)
    result: dict[str, dict[str, tuple[Any, bool]]] = {}
    for name, table in standard.items():
        result[name] = {}
        for key, value in table.items():
            found = seen.get((name, key))
            result[name][key] = (value, False) if found is None else (_upward(found, key), True)
    for name, error, averaged in (
        ("accelerometer", "error_m_per_s2", "averaged_error_m_per_s2"),
        ("magnetometer", "error_ut", "averaged_error_ut"),
    ):
        # An average is not further off than the samples that it is made of.
        if name in result and result[name][averaged][0] > result[name][error][0]:
            result[name][averaged] = (result[name][error][0], result[name][error][1])
    return result


def _offset_bound(delay: DelayProposal, margin: float) -> float:
    """The scatter over the recording, and half a row, below which nothing is known."""
    return margin * (delay.scatter + 0.5 * delay.step)


def _upward(value: float, key: str) -> float:
    """Three digits, rounded up; a delay to the nearest 0.1 ms."""
    return round(value, 4) if key == "delay_s" else upward(value)
