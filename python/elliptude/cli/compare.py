"""The command ``elliptude compare``."""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.cli.options import (
    Force,
    LargestGap,
    ReferenceErrorDeg,
    TruthConfig,
    reference_error,
    refuse_to_replace,
    require_finite,
)
from elliptude.configuration.configuration import read_configuration
from elliptude.io.files import FileError
from elliptude.logs.quaternion_readings import readings
from elliptude.logs.reference_attitudes import read_reference
from elliptude.report import comparison
from elliptude.report.run import read_run


def compare(
    result: Annotated[
        Path, typer.Argument(help="A table of results, or the folder that estimate wrote.", show_default=False)
    ],
    reference: Annotated[
        Path,
        typer.Argument(help="A table with time_s,qw,qx,qy,qz; with --config a log in any format.", show_default=False),
    ],
    config: TruthConfig = None,
    largest_gap_s: LargestGap = 0.0,
    reference_error_deg: ReferenceErrorDeg = None,
    tum: Annotated[
        Path | None,
        typer.Option(help="Folder for estimate.tum and reference.tum, which evo_ape reads.", show_default=False),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
    force: Force = False,
) -> None:
    """Compare results with a reference attitude: containment, error of the center, width of the sets.

    Exit code 1 if the reference is outside a set that the table claims to hold without a condition, or if its
    quaternions are read in a wrong order or as their inverse.
    """
    require_finite("--largest-gap-s", largest_gap_s)
    if tum is not None:
        refuse_to_replace((tum / name for name in ("estimate.tum", "reference.tum")), force)
    configuration = None if config is None else read_configuration(config)
    error_deg, source = reference_error(reference_error_deg, configuration)
    run, _ = read_run(result)
    truth = None if configuration is None else configuration.truth
    choices = readings("wxyz", "body_to_reference") if truth is None else readings(truth.order, truth.turns)
    try:
        attitudes = read_reference(reference, configuration)
        compared = comparison.compare(
            run, attitudes, largest_gap=largest_gap_s, reference_error=math.radians(error_deg)
        )
        misread = comparison.misread_reference(run, attitudes, choices, largest_gap=largest_gap_s)
    except ValueError as error:
        raise FileError(f"{result}, {reference}: {error}") from error
    written: tuple[Path, ...] = ()
    if tum is not None:
        tum.mkdir(parents=True, exist_ok=True)
        written = compared.write_tum(tum)
    summary = compared.to_dict()
    if as_json:
        head = {
            "result": str(result),
            "reference": str(reference),
            "reference_error_deg": error_deg,
            "reference_error_from": source,
            "reference_misread": misread,
        }
        typer.echo(json.dumps(head | summary, indent=2, ensure_ascii=False, allow_nan=False))
    else:
        typer.echo(f"{result} against {reference}: {len(compared.times)} of {compared.rows} rows compared")
        own_error = "not stated" if source is None else f"{error_deg:g} degrees by {source}"
        counts = "any attitude that near to it" if error_deg > 0.0 else "the reference itself"
        typer.echo(f"the reference's own error: {own_error}; a row is inside if its set has {counts}")
        Console(width=max(Console().width, 110)).print(_table(summary))
        for path in written:
            typer.echo(f"  {path}")
    if misread is not None:
        typer.secho(
            f"the reference {misread}: its quaternions are not as declared; [truth] of a configuration (--config) says "
            "how they are",
            err=True,
            fg=typer.colors.RED,
        )
        raise typer.Exit(1)
    if compared.broken_promises:
        typer.secho(
            f"{compared.broken_promises} rows claim a set that holds without a condition, and the reference is outside",
            err=True,
            fg=typer.colors.RED,
        )
        raise typer.Exit(1)


def _table(summary: dict[str, Any]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("claim", no_wrap=True)
    for heading in (
        "rows %", "inside %", "error ° mean", "rms", "max", "half-widths ° body", "half-widths ° reference",
    ):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    for name, figures in {"all rows": summary["all"], **(summary["by_claim"] or {})}.items():
        cells = [f"{100.0 * figures['share_of_rows']:.4g}"]
        if figures["compared"]:
            error = figures["error_deg"]
            cells += [f"{100.0 * figures['inside_share']:.6g}"]
            cells += [f"{error[which]:.3g}" for which in ("mean", "rms", "max")]
            cells += [
                " ".join(f"{width:.3g}" for width in figures[f"half_width_{axes}_deg"]["mean"])
                for axes in ("body", "reference")
            ]
        table.add_row(name, *cells)
    return table
