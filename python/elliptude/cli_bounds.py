"""The command ``elliptude bounds``."""

import dataclasses
import json
import math
import zipfile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomlkit
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude import bound_rules, proposals, tables
from elliptude.files import FileError, replacing
from elliptude.proposals import DelayProposal, Proposal, Quantiles, Recording

_NOTE = (
    "These are quantiles and maxima of one recording. They are no guarantee: another recording, or the next minute of "
    "this one, may exceed any of them. A bound to rely on needs a reason, such as a datasheet or the size of the room."
)


def bounds(
    log: Annotated[
        Path,
        typer.Argument(
            help="A recording: NPZ with t, gyr, acc, mag, or CSV with met_s, wx, wy, wz.", show_default=False
        ),
    ],
    reference: Annotated[
        bool,
        typer.Option(
            "--reference/--no-reference", help="Compare with the reference attitude, if the recording has one."
        ),
    ] = True,
    margin: Annotated[
        float, typer.Option(min=1.0, max=100.0, help="What maxima are multiplied by in the proposed configuration.")
    ] = 1.2,
    out: Annotated[
        Path | None, typer.Option(help="Write a rule for bounds to start from: TOML.", show_default=False)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace what is there.")] = False,
) -> None:
    """Propose bounds, delays and time offsets from a recording, with or without a reference attitude.

    What it prints are quantiles and maxima of this recording, which guarantee nothing about another.
    """
    if not math.isfinite(margin):
        raise typer.BadParameter(f"{margin} is not a number", param_hint="--margin")
    if out is not None and out.exists() and not force:
        raise FileError(f"{out} is there already; --force replaces it")
    recording = read_recording(log)
    if not reference:
        recording = dataclasses.replace(recording, attitudes=None)
    try:
        proposed = proposals.propose(recording)
    except ValueError as error:
        raise FileError(f"{log}: {error}") from error
    if out is not None:
        _write(out, proposed, margin, log)
    if as_json:
        summary = {"log": str(log), "note": _NOTE, "margin": margin} | summarize(proposed)
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False))
        return
    compared = "with its reference attitude" if recording.attitudes is not None else "without a reference attitude"
    typer.echo(
        f"{log}: {len(recording.times)} rows, {proposed.duration:.4g} s, {100.0 * proposed.rest:.3g} % at rest, "
        f"{compared}"
    )
    Console(width=max(Console().width, 100)).print(_table(proposed))
    for line in _remarks(proposed):
        typer.echo(line)
    typer.echo(_NOTE)
    if out is not None:
        typer.echo(
            f"Written: {out}, maxima times {margin:g}; the rule for a sensor in the hand where it shows nothing."
        )


# --- what is read -----------------------------------------------------------------------------------------------------


def read_recording(path: Path) -> Recording:
    """Read a recording.

    Parameters
    ----------
    path : pathlib.Path
        NPZ with the arrays t (s), gyr (rad/s), acc (m/s²), mag (µT) and q_ref (qw, qx, qy, qz), all but the first two
        optional; or a table with the columns met_s, wx, wy, wz (rad/s) and, optionally, qw, qx, qy, qz.

    Returns
    -------
    Recording

    Raises
    ------
    FileError
        If it cannot be read or lacks something.
    """
    recording = _read_npz(path) if path.suffix == ".npz" else _read_table(path)
    if len(recording.times) < 3:
        raise FileError(f"{path}: has {len(recording.times)} rows; bounds cannot be proposed from fewer than 3")
    backward = np.flatnonzero(~(np.diff(recording.times) > 0.0))
    if len(backward):
        raise FileError(f"{path}: row {int(backward[0]) + 1}: its time is not after that of the row before")
    return recording


def _read_npz(path: Path) -> Recording:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in ("t", "gyr", "acc", "mag", "q_ref") if name in file}
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or 'not an NPZ file'}") from error
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        raise FileError(f"{path}: not an NPZ file: {error}") from error
    for name in ("t", "gyr"):
        if name not in arrays:
            raise FileError(f"{path}: has no array {name}")
    count = arrays["t"].shape[0] if arrays["t"].ndim == 1 else -1
    widths = {"t": (), "gyr": (3,), "acc": (3,), "mag": (3,), "q_ref": (4,)}
    for name, array in arrays.items():
        if array.shape != (count, *widths[name]) or array.dtype.kind not in "fiu":
            wanted = ", ".join(["N", *(str(width) for width in widths[name])])
            raise FileError(f"{path}: {name} must hold numbers, shape ({wanted}), not {array.dtype} {array.shape}")
    values = {name: array.astype(np.float64) for name, array in arrays.items()}
    return Recording(values["t"], values["gyr"], values.get("acc"), values.get("mag"), values.get("q_ref"))


def _read_table(path: Path) -> Recording:
    columns = tables.read_columns(path, time="met_s", numbers=("wx", "wy", "wz"))
    rates = np.column_stack([columns[name] for name in ("wx", "wy", "wz")])
    try:
        reference = tables.read_columns(path, time="met_s", numbers=tables.QUATERNION)
    except FileError:  # no reference in it
        return Recording(columns["met_s"], rates)
    attitudes = np.column_stack([reference[name] for name in tables.QUATERNION])
    return Recording(columns["met_s"], rates, attitudes=attitudes)


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
    if key == "delay_s":
        return round(value, 4)
    if value == 0.0:
        return 0.0
    scale = 10.0 ** (2 - math.floor(math.log10(value)))
    return float(f"{math.ceil(value * scale - 1e-9) / scale:.3g}")
