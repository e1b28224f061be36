"""The commands ``elliptude check`` and ``elliptude convert``."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.cli.options import Force, refuse_to_replace
from elliptude.configuration.configuration import read_configuration
from elliptude.estimation import check as checks
from elliptude.estimation.check import Report
from elliptude.logs import conversion


def check(
    log: Annotated[Path, typer.Argument(help="Measurements, in any format of docs/logs.md.", show_default=False)],
    config: Annotated[
        Path, typer.Argument(help="Which columns are which sensors, their bounds, the body: TOML.", show_default=False)
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
) -> None:
    """Look at a log and its configuration: what each sensor measured, and what is or may be wrong.

    Exit code 1 if there is an error; warnings are for people to look at.
    """
    report = checks.check(log, read_configuration(config))
    if as_json:
        typer.echo(
            json.dumps({"log": str(log), "config": str(config)} | report.to_dict(), indent=2, ensure_ascii=False)
        )
    else:
        if report.sensors:
            Console(width=max(Console().width, 110)).print(_table(report))
        if report.up_at_rest is not None:
            typer.echo(f"{report.up_at_rest}.")
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
