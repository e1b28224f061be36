"""The commands ``elliptude check``, ``elliptude convert`` and ``elliptude calibrate``."""

import json
from pathlib import Path
from typing import Annotated

import tomlkit
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.calibration import calibrate as calibrating
from elliptude.calibration.calibrate import Found, FoundGyro
from elliptude.cli.options import Force, Repair, refuse_to_replace, require_finite, with_repair
from elliptude.configuration.calibration import Calibration, CalibrationDocument, read_statements
from elliptude.configuration.configuration import read_configuration
from elliptude.estimation import check as checks
from elliptude.estimation.check import Report
from elliptude.io.files import FileError, replacing
from elliptude.logs import conversion, plausibility
from elliptude.logs import log as logs


def check(
    log: Annotated[Path, typer.Argument(help="Measurements, in any format of docs/logs.md.", show_default=False)],
    config: Annotated[
        Path, typer.Argument(help="Which columns are which sensors, their bounds, the body: TOML.", show_default=False)
    ],
    repair: Repair = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
) -> None:
    """Look at a log and its configuration: what each sensor measured, and what is or may be wrong.

    Exit code 1 if there is an error; warnings are for people to look at.
    """
    report = checks.check(log, with_repair(read_configuration(config), repair))
    if as_json:
        typer.echo(
            json.dumps({"log": str(log), "config": str(config)} | report.to_dict(), indent=2, ensure_ascii=False)
        )
    else:
        if report.sensors:
            Console(width=max(Console().width, 110)).print(_table(report))
        if report.up_at_rest is not None:
            typer.echo(f"{report.up_at_rest}.")
        for line in report.repaired:
            typer.secho(line, fg=typer.colors.YELLOW)
        for finding in report.findings:
            color = typer.colors.RED if finding.severity == "error" else typer.colors.YELLOW
            typer.secho(f"{finding.severity}: {finding}", fg=color)
        errors = sum(finding.severity == "error" for finding in report.findings)
        typer.echo(f"{log}: {errors} errors, {len(report.findings) - errors} warnings")
    if not report.is_good:
        raise typer.Exit(1)


def _table(report: Report) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in ("sensor", "unit"):
        table.add_column(heading, no_wrap=True)
    for heading in ("measured", "empty", "Hz", "gaps", "longest step s", "lowest", "highest", "median norm"):
        table.add_column(heading, justify="right")
    for sensor in report.sensors:
        table.add_row(
            sensor.name,
            sensor.unit,
            f"{sensor.measured}",
            f"{sensor.empty}",
            _number(sensor.rate_hz),
            f"{sensor.gaps}",
            _number(sensor.longest_step_s),
            _number(min(sensor.lowest) if sensor.lowest else None),
            _number(max(sensor.highest) if sensor.highest else None),
            _number(sensor.median_norm),
        )
    return table


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def convert(
    source: Annotated[
        Path, typer.Argument(metavar="IN", help="A log, in any format of docs/logs.md.", show_default=False)
    ],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="OUT", help="The new file; its name ends in .csv, .parquet or .npz.", show_default=False
        ),
    ],
    config: Annotated[
        Path | None,
        typer.Option(
            help="Write the measurements of this configuration, in SI units and body axes, a row for each time.",
            show_default=False,
        ),
    ] = None,
    stream: Annotated[
        str | None,
        typer.Option(help="Which topic, or which length of arrays, if the log has several.", show_default=False),
    ] = None,
    force: Force = False,
) -> None:
    """Convert a log to CSV, Parquet or NPZ: as it stands, or as a configuration reads it."""
    refuse_to_replace([target], force)
    if config is None:
        rows = conversion.convert(source, target, stream)
    elif stream is not None:
        raise typer.BadParameter("a configuration says what is read", param_hint="--stream")
    else:
        rows = conversion.convert_measurements(source, target, read_configuration(config))
    typer.echo(f"{target}: {rows} rows")


def calibrate(
    log: Annotated[
        Path, typer.Argument(help="A recording made for this, in any format of docs/logs.md.", show_default=False)
    ],
    config: Annotated[
        Path, typer.Argument(help="Which columns are which sensors, and a rule: TOML.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="The calibration: TOML.", show_default=False)],
    statements: Annotated[
        Path | None,
        typer.Option(
            help="What is known of the sensors and of this recording: TOML, as in docs/calibrate.md. If left out, "
            "that of a sensor in the hand.",
            show_default=False,
        ),
    ] = None,
    disturbance_ut: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="How far the field differs from its mean in this recording, µT; instead of the statements'.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
    force: Force = False,
) -> None:
    """Find what a recording leaves possible of its sensors' offsets and scales, and write how to correct them.

    Nothing is fitted: every set of parameters that agrees with all samples within the stated bounds is kept, and what
    is left of the errors is a bound by the same statements.
    """
    if disturbance_ut is not None:
        require_finite("--disturbance-ut", disturbance_ut)
    refuse_to_replace([out], force)
    configuration = read_configuration(config).model_copy(update={"calibration": None})
    known = read_statements(statements)
    if disturbance_ut is not None:
        magnetometer = known.magnetometer.model_copy(update={"disturbance_ut": disturbance_ut})
        known = known.model_copy(update={"magnetometer": magnetometer})
    if configuration.rule is None:
        raise FileError(
            f"{config}: rule: missing; calibrate needs one, which says what a rest is and what the gyro does"
        )
    pieces = plausibility.plausible_pieces(logs.read_pieces(log, configuration), configuration, str(log))
    recording = logs.joined(list(pieces))
    try:
        found = calibrating.calibrate(recording, configuration, known)
    except ValueError as error:
        raise FileError(f"{log}: {error}") from error
    calibration = Calibration(
        recording=log.name,
        recording_sha256=calibrating.sha256_of(log),
        sensors=tuple(one.calibration() for one in found),
    )
    document = tomlkit.document()
    document.add(tomlkit.comment(f"Written by `elliptude calibrate` from {log.name}. A corrected sample is"))
    document.add(tomlkit.comment("matrix (sample - offset), in body axes; the errors are what may be left of it."))
    tables = CalibrationDocument(calibration=calibration).model_dump(mode="json", exclude_none=True)
    for name, table in tables.items():
        document.add(name, tomlkit.item(table))
    with replacing(out) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    if as_json:
        typer.echo(json.dumps([one.figures() for one in found], indent=2, ensure_ascii=False))
        return
    Console(width=max(Console().width, 110)).print(_offsets(found))
    for one in found:
        for remark in one.remarks():
            typer.echo(remark)
    typer.echo(f'{out}: use it with [calibration] file = "{out.name}" in a configuration')


def _offsets(found: list[Found | FoundGyro]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in ("sensor", "unit"):
        table.add_column(heading, no_wrap=True)
    for heading in ("poses", "offset x", "y", "z", "off by", "stated", "scale error", "stated", "least squares"):
        table.add_column(heading, justify="right")
    for one in found:
        if isinstance(one, FoundGyro):
            scale = (f"{one.left.scale_error:.3g}", f"{one.stated_scale_error:g}")
            table.add_row("the gyro", "", f"{one.left.turns} turns", *[""] * 5, *scale, "")
            continue
        left = one.left
        ranges = (f"{low:.3g} to {high:.3g}" for low, high in zip(left.lowest, left.highest, strict=True))
        proposed = "" if one.proposed_offset is None else " ".join(f"{value:.2g}" for value in one.proposed_offset)
        table.add_row(
            one.sensor.name,
            one.unit,
            f"{left.poses}",
            *ranges,
            f"{left.offset_error:.3g}",
            f"{one.stated.offset:g}",
            f"{left.scale_error:.3g}",
            f"{one.stated.scale_error:g}",
            proposed,
        )
    return table
