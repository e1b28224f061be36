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
from elliptude.calibration.found import Found, FoundGyro, counted
from elliptude.cli.options import LOG_HELP, Force, Repair, quantity, with_repair
from elliptude.cli.outputs import CONFIGURATION, print_table, require_outputs
from elliptude.cli.progress import steps
from elliptude.configuration.calibration import (
    STRONGEST_FIELD_UT,
    Calibration,
    CalibrationDocument,
    read_statements,
)
from elliptude.configuration.configuration import read_configuration
from elliptude.estimation import check as checks
from elliptude.estimation.check import Report
from elliptude.io.files import FileError, replacing
from elliptude.io.spool import recording
from elliptude.logs import conversion, plausibility
from elliptude.logs import log as logs
from elliptude.units import readable_unit


def check(
    log: Annotated[
        Path, typer.Argument(help=f"Measurements, in any format of docs/logs.md; {LOG_HELP}", show_default=False)
    ],
    config: Annotated[
        Path, typer.Argument(help="Which columns are which sensors, their bounds, the body: TOML.", show_default=False)
    ],
    repair: Repair = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
) -> None:
    """Look at a log and its configuration: what each sensor measured, and what is or may be wrong.

    Exit code 1 if there is an error; warnings are for people to look at.
    """
    source = recording(log)
    with steps(Console(stderr=True), 1) as step:
        step("Checking")
        report = checks.check(source, with_repair(read_configuration(config), repair))
    if as_json:
        typer.echo(
            json.dumps({"log": str(source), "config": str(config)} | report.to_dict(), indent=2, ensure_ascii=False)
        )
    else:
        if report.sensors:
            print_table(_table(report))
        if report.up_at_rest is not None:
            typer.echo(f"{report.up_at_rest}.")
        for line in report.repaired:
            typer.secho(line, fg=typer.colors.YELLOW)
        for finding in report.findings:
            color = typer.colors.RED if finding.severity == "error" else typer.colors.YELLOW
            typer.secho(f"{finding.severity}: {finding}", fg=color)
        errors = sum(finding.severity == "error" for finding in report.findings)
        warnings = len(report.findings) - errors
        counts = [f"{count} {word}{'s' * (count != 1)}" for count, word in ((errors, "error"), (warnings, "warning"))]
        typer.echo(f"{source}: {', '.join(counts)}")
    if not report.is_good:
        raise typer.Exit(1)


def _table(report: Report) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in ("sensor", "unit"):
        table.add_column(heading, no_wrap=True)
    for heading in ("measured", "empty", "Hz", "gaps", "longest\nstep s", "lowest", "highest", "median\nnorm"):
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
        Path, typer.Argument(metavar="IN", help=f"A log, in any format of docs/logs.md; {LOG_HELP}", show_default=False)
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
    config_out: Annotated[
        Path | None,
        typer.Option(
            help="Also write the configuration by which `estimate` finds the same in OUT as by --config in IN: TOML.",
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
    files = [target] if config_out is None else [target, config_out]
    require_outputs(files, force=force, read=[source, config], endings={config_out: CONFIGURATION})
    log = recording(source)
    if config is None and config_out is not None:
        raise typer.BadParameter("is of a --config: give it, too", param_hint="--config-out")
    if config is None:
        rows = conversion.convert(log, target, stream)
    elif stream is not None:
        raise typer.BadParameter("a configuration says what is read", param_hint="--stream")
    else:
        rows = conversion.convert_measurements(log, target, read_configuration(config), config_out)
    typer.echo(f"{target}: {rows} rows")
    if config_out is not None:
        typer.echo(f"{config_out}: its configuration")


def calibrate(
    log: Annotated[
        Path,
        typer.Argument(
            help=f"A recording made for this, in any format of docs/logs.md; {LOG_HELP}", show_default=False
        ),
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
        quantity(
            "How far the field differs from its mean in this recording, µT; instead of the statements'.",
            greatest=STRONGEST_FIELD_UT,
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
    require_outputs([out], force=force, read=[log, config, statements], endings={out: CONFIGURATION})
    # What is neither calibrated nor needed for that would only bring stamps of its own.
    unused = {"calibration": None, "truth": None, "velocity": None}
    configuration = read_configuration(config).model_copy(update=unused)
    known = read_statements(statements)
    if disturbance_ut is not None:
        magnetometer = known.magnetometer.model_copy(update={"disturbance_ut": disturbance_ut})
        known = known.model_copy(update={"magnetometer": magnetometer})
    if configuration.rule is None:
        raise FileError(
            f"{config}: rule: missing; calibrate needs one, which says what a rest is and what the gyro does"
        )
    source = recording(log)
    with steps(Console(stderr=True), 2) as step:
        step("Reading")
        heard = plausibility.Heard()
        read = logs.read_pieces(source, configuration)
        pieces = plausibility.plausible_pieces(read, configuration, str(source), heard)
        samples = logs.joined(list(pieces))
        try:
            step("Calibrating")
            found = calibrating.calibrate(samples, configuration, known)
        except ValueError as error:
            raise FileError(f"{source}: {heard.after(str(error))}") from error
    calibration = Calibration(
        recording=source.name,
        recording_sha256=calibrating.sha256_of(Path(source)),
        sensors=tuple(one.calibration() for one in found),
    )
    document = tomlkit.document()
    document.add(tomlkit.comment(f"Written by `elliptude calibrate` from {source.name}. A corrected sample is"))
    document.add(tomlkit.comment("matrix (sample - offset), in body axes; the errors are what may be left of it."))
    tables = CalibrationDocument(calibration=calibration).model_dump(mode="json", exclude_none=True)
    for name, table in tables.items():
        document.add(name, tomlkit.item(table))
    with replacing(out) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    if as_json:
        typer.echo(json.dumps([one.figures() for one in found], indent=2, ensure_ascii=False))
        return
    print_table(_corrections(found))
    for one in found:
        for remark in one.remarks():
            typer.echo(remark)
    typer.echo(f'{out}: use it with [calibration] file = "{out.name}" in a configuration')


def _corrections(found: list[Found | FoundGyro]) -> Table:
    """What is subtracted, what is possible, what was stated: a row for each axis."""
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in ("sensor", "from", "axis"):
        table.add_column(heading, no_wrap=True)
    for heading in ("subtracted", "possible\noffsets", "stated", "least\nsquares", "scale\nerror", "stated"):
        table.add_column(heading, justify="right", no_wrap=True)
    for one in found:
        scale = (f"{one.left.scale_error:.3g}", f"{one.stated_scale_error:g}")
        if isinstance(one, FoundGyro):
            table.add_row(one.name, counted(one.left.turns, "turn"), *[""] * 5, *scale)
            continue
        left, proposed = one.left, one.proposed_offset
        for i, axis in enumerate("xyz"):
            first = i == 0
            table.add_row(
                f"{one.name} ({readable_unit(one.unit)})" if first else "",
                counted(left.poses, "pose") if first else "",
                axis,
                f"{left.offset[i]:.3g}" if left.is_correction else "-",
                f"{left.lowest[i]:.3g} to {left.highest[i]:.3g}",
                f"within {one.stated.offset:g}",
                "" if proposed is None else f"{proposed[i]:.3g}",
                *(scale if first else ("", "")),
            )
    return table
