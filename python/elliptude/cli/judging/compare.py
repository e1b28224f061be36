"""The command ``elliptude compare``: results beside a reference attitude."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.cli.options import LOG_HELP, Force, LargestGap, ReferenceErrorDeg, TruthConfig, quantity, reference_error
from elliptude.cli.outputs import print_table, require_outputs
from elliptude.cli.progress import steps
from elliptude.configuration.configuration import read_configuration_of_truth
from elliptude.io.files import FileError
from elliptude.io.spool import recording
from elliptude.logs.quaternion_readings import not_as_declared, readings_of
from elliptude.logs.reference_attitudes import Reference, read_reference
from elliptude.report import comparison, monitored
from elliptude.report.estimated.reading import files_of_run, read_run
from elliptude.report.run import Run

# s; a shorter time between two attitudes than rows have between them, and a longer one than a recording lasts.
_SHORTEST_DELTA_S, _LONGEST_DELTA_S = 1e-3, 1e6
# Shares of rows inside, below and above which another frame is more likely than a wrong set.
_MOST_OUTSIDE, _MOST_INSIDE = 0.5, 0.9


def compare(
    result: Annotated[
        Path, typer.Argument(help="A table of results, or the folder that estimate wrote.", show_default=False)
    ],
    reference: Annotated[
        Path,
        typer.Argument(
            help=f"A table with time_s,qw,qx,qy,qz; with --config a log in any format; {LOG_HELP}", show_default=False
        ),
    ],
    config: TruthConfig = None,
    largest_gap_s: LargestGap = 0.0,
    reference_error_deg: ReferenceErrorDeg = None,
    align: Annotated[
        comparison.Alignment,
        typer.Option(
            help="Turn the reference onto the estimate first: at the first compared row (origin), or at all as well "
            "as one turn can. Then no row is inside or outside."
        ),
    ] = "none",
    delta_rows: Annotated[
        int | None,
        typer.Option(
            min=1, help="Also compare turns of the body over so many compared rows: evo_rpe -u f.", show_default=False
        ),
    ] = None,
    delta_s: Annotated[
        float | None,
        quantity(
            "Also compare turns of the body over this time, within a tenth of it, s.",
            least=_SHORTEST_DELTA_S,
            greatest=_LONGEST_DELTA_S,
            show_default=False,
        ),
    ] = None,
    all_pairs: Annotated[
        bool,
        typer.Option("--all-pairs", help="Begin a turn at each row; otherwise one begins where the last one ends."),
    ] = False,
    tum: Annotated[
        Path | None,
        typer.Option(
            help="Folder for estimate.tum and reference.tum, which evo_ape and evo_rpe read.", show_default=False
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
    force: Force = False,
) -> None:
    """Compare results with a reference attitude: containment, error of the center, width of the sets.

    With --delta-rows or --delta-s also how far turns of the body are off, which says more of drift.

    Exit code 1 if the reference is outside a set that the table claims to hold without a condition, or if its
    quaternions are read in a wrong order or as their inverse.
    """
    if delta_rows is not None and delta_s is not None:
        raise typer.BadParameter("state --delta-rows or --delta-s, not both", param_hint="--delta-s")
    if all_pairs and delta_rows is None and delta_s is None:
        raise typer.BadParameter("needs --delta-rows or --delta-s", param_hint="--all-pairs")
    if tum is not None:
        files = [tum / name for name in ("estimate.tum", "reference.tum")]
        require_outputs(files, force=force, folder=tum, read=[*files_of_run(result), reference, config])
    other = recording(reference)
    configuration = None if config is None else read_configuration_of_truth(config)
    error_deg, source = reference_error(reference_error_deg, configuration)
    with steps(Console(stderr=True), 3) as step:
        step("Reading the result")
        run, _ = read_run(result)
        truth = None if configuration is None else configuration.truth
        choices = readings_of(truth)
        try:
            step("Reading the reference")
            attitudes = read_reference(other, configuration, origin=run.origin)
            step("Comparing")
            compared = comparison.compare(
                run,
                attitudes,
                largest_gap=largest_gap_s,
                reference_error=math.radians(error_deg),
                alignment=align,
            )
            # Frames that are aligned may be any: turns alone show how the columns are to be read.
            turned = run if align == "none" else replace(run, heading_from_start=True)
            misread = comparison.misread_reference(turned, attitudes, choices, largest_gap=largest_gap_s)
            hint = None if align != "none" else _hint(run, compared, attitudes, largest_gap_s, math.radians(error_deg))
            summary = compared.to_dict()
            if delta_rows is not None or delta_s is not None:
                summary["relative"] = comparison.relative_figures(
                    compared, rows=delta_rows, seconds=delta_s, all_pairs=all_pairs
                )
        except ValueError as error:
            raise FileError(f"{result}, {other}: {error}") from error
    written: tuple[Path, ...] = ()
    if tum is not None:
        tum.mkdir(parents=True, exist_ok=True)
        written = compared.write_tum(tum)
    if as_json:
        head = {
            "result": str(result),
            "reference": str(other),
            "reference_error_deg": error_deg,
            "reference_error_from": source,
            "reference_misread": misread,
            "hint": hint,
        }
        typer.echo(json.dumps(head | summary, indent=2, ensure_ascii=False, allow_nan=False))
    else:
        typer.echo(f"{result} against {other}: {len(compared.times)} of {compared.rows} rows compared")
        _say(summary, error_deg, source)
        if hint is not None:
            typer.secho(hint, fg=typer.colors.YELLOW)
        for path in written:
            typer.echo(f"  {path}")
    if (fault := _fault(compared, misread)) is not None:
        typer.secho(fault, err=True, fg=typer.colors.RED)
        raise typer.Exit(1)


def _hint(
    run: Run, compared: comparison.Comparison, reference: Reference, largest_gap: float, error: float
) -> str | None:
    """That the reference is probably in another frame than the sets, if most of them exclude it and then do not."""
    if compared.inside is None or compared.inside.mean() >= _MOST_OUTSIDE:
        return None
    frames: tuple[monitored.GroundFrame, ...] = get_args(monitored.GroundFrame)
    of_sets = next((frame for frame in frames if frame == (run.frame or "ENU")), None)
    if of_sets is None:
        return None
    for frame in frames:
        turn = monitored.frame_to_frame(frame, of_sets)
        turned = monitored.in_frame(reference, turn)
        found = comparison.compare(run, turned, largest_gap=largest_gap, reference_error=error)
        if found.inside is not None and found.inside.mean() > _MOST_INSIDE:
            return (
                f"the reference is outside most sets, and inside {100.0 * found.inside.mean():.3g} % of them as "
                f"{frame}, which the sets are not: the reference frames differ. `elliptude monitor` turns it, with "
                f"--frame {of_sets} --estimate-frame {frame}; --align origin compares without saying inside or outside"
            )
    return None


def _fault(compared: comparison.Comparison, misread: str | None) -> str | None:
    """What must not be, if anything is so."""
    if misread is not None:
        return not_as_declared(f"the reference {misread}", "--config")
    if compared.broken_promises:
        rows = compared.broken_promises
        return f"{rows} rows claim a set that holds without a condition, and the reference is outside"
    return None


def _say(summary: dict[str, Any], error_deg: float, source: str | None) -> None:
    """Print the figures of `elliptude compare`."""
    if summary["alignment"] == "none":
        own_error = "not stated" if source is None else f"{error_deg:g} degrees by {source}"
        counts = "any attitude that near to it" if error_deg > 0.0 else "the reference itself"
        typer.echo(f"the reference's own error: {own_error}; a row is inside if its set has {counts}")
    else:
        rows = "at the first compared row" if summary["alignment"] == "origin" else "over all compared rows"
        typer.echo(
            f"the reference is turned by {summary['turned_deg']:.4g} degrees onto the estimate {rows}: it takes on "
            "errors of the estimate, and cannot say whether it is inside"
        )
    print_table(_table(summary))
    if (relative := summary.get("relative")) is not None:
        rows, seconds, error = relative["delta_rows"], relative["delta_s"], relative["error_deg"]
        span = f"{seconds:g} s" if rows is None else f"{rows} row{'s' * (rows > 1)}"
        typer.echo(
            f"turns over {span} ({relative['pairs']} {'overlapping ' * relative['all_pairs']}pairs): error "
            f"{error['mean']:.3g} degrees (mean), {error['rms']:.3g} (rms), {error['max']:.3g} (max)"
        )


def _table(summary: dict[str, Any]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("claim", no_wrap=True)
    for heading in (
        "rows\n%", "inside\n%", "error\n° mean", "rms", "max", "half-widths\n° body", "half-widths\n° reference",
    ):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    for name, figures in {"all rows": summary["all"], **(summary["by_claim"] or {})}.items():
        cells = [f"{100.0 * figures['share_of_rows']:.4g}"]
        if figures["compared"]:
            error = figures["error_deg"]
            inside = figures["inside_share"]
            cells += ["-" if inside is None else f"{100.0 * inside:.6g}"]
            cells += [f"{error[which]:.3g}" for which in ("mean", "rms", "max")]
            cells += [
                " ".join(f"{width:.3g}" for width in figures[f"half_width_{axes}_deg"]["mean"])
                for axes in ("body", "reference")
            ]
        table.add_row(name, *cells)
    return table
