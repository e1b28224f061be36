"""The command ``elliptude monitor``: how far another filter's attitudes can be off."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.cli.options import LOG_HELP, EstimateLargestGap, Force, SummaryAsJson, quantity
from elliptude.cli.outputs import SUMMARY, print_table, require_outputs
from elliptude.cli.progress import steps
from elliptude.configuration.configuration import Configuration, read_configuration, read_configuration_of_truth
from elliptude.estimation.estimator import PieceEstimator
from elliptude.io.background import ahead
from elliptude.io.column_files import write_columns
from elliptude.io.files import FileError, write_json
from elliptude.io.spool import STANDARD_INPUT, NamedFile, recording
from elliptude.logs import log as logs
from elliptude.logs import plausibility
from elliptude.logs.quaternion_readings import not_as_declared, readings_of
from elliptude.logs.reference_attitudes import Reference, read_reference
from elliptude.monitoring import Limits, Monitored
from elliptude.monitoring.monitor import Heading
from elliptude.report import comparison, monitored
from elliptude.report.estimated.reading import files_of_run, read_run
from elliptude.report.monitored import GroundFrame
from elliptude.report.run import Run
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray


def _limit(what: str) -> Any:
    return quantity(f"Alert limit of the {what} error, degrees.", greatest=180.0, show_default=False)


def monitor(
    log: Annotated[
        Path,
        typer.Argument(
            help=f"A table of results, or the folder that estimate wrote; with --config a log: {LOG_HELP}",
            show_default=False,
        ),
    ],
    estimate: Annotated[
        Path,
        typer.Option(
            help="The other filter's attitudes: a table with time_s,qw,qx,qy,qz; with --estimate-config a log in any "
            f"format; {LOG_HELP}",
            show_default=False,
        ),
    ],
    config: Annotated[
        Path | None,
        typer.Option(help="Configuration of the log, of mode guaranteed: TOML.", show_default=False),
    ] = None,
    estimate_config: Annotated[
        Path | None,
        typer.Option(
            help="Configuration whose section truth says what the estimate's columns are.", show_default=False
        ),
    ] = None,
    frame: Annotated[
        GroundFrame | None,
        typer.Option(help="Reference frame of the sets, if --config does not say it.", show_default=False),
    ] = None,
    estimate_frame: Annotated[
        GroundFrame | None,
        typer.Option(help="Reference frame of the estimate, if it is another one.", show_default=False),
    ] = None,
    heading_free: Annotated[
        bool,
        typer.Option("--heading-free", help="The estimate's heading counts from elsewhere: judge its tilt alone."),
    ] = False,
    limit_deg: Annotated[float | None, _limit("whole")] = None,
    limit_tilt_deg: Annotated[float | None, _limit("tilt")] = None,
    limit_heading_deg: Annotated[float | None, _limit("heading")] = None,
    largest_gap_s: EstimateLargestGap = 0.0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for monitor.csv, monitor.png and monitor.json; created if missing.", show_default=False
        ),
    ] = None,
    format: Annotated[Literal["csv", "parquet"], typer.Option(help="Format of the table.")] = "csv",  # noqa: A002
    as_json: SummaryAsJson = False,
    force: Force = False,
) -> None:
    """Bound the error of another filter's attitudes, with a proof where they cannot be true.

    Exit code 1 if an attitude is proved wrong, if its error is not shown to be within a stated limit, or if its
    quaternions are read in a wrong order or as their inverse.
    """
    files = [] if out is None else [out / name for name in (f"monitor.{format}", "monitor.png", "monitor.json")]
    require_outputs(files, force=force, folder=out, read=[*files_of_run(log), estimate, config, estimate_config])
    limits = _limits(limit_deg, limit_tilt_deg, limit_heading_deg)
    if heading_free and (limit_deg is not None or limit_heading_deg is not None):
        raise typer.BadParameter("judges the tilt alone; --limit-tilt-deg is its limit", param_hint="--heading-free")
    source, other = recording(log), recording(estimate)
    if source.argument == other.argument == STANDARD_INPUT:
        raise typer.BadParameter("only one of LOG and --estimate can be a pipe", param_hint="--estimate")
    with steps(Console(stderr=True), 3) as step:
        step("Estimating the sets")
        run, configuration = _judge(source, config)
        frame = _frame_of_sets(frame, configuration)
        described = None if estimate_config is None else read_configuration_of_truth(estimate_config)
        truth = None if described is None else described.truth
        choices = readings_of(truth)
        step("Reading the estimate")
        attitudes = read_reference(other, described, origin=run.origin)
        free = heading_free or run.heading_from_start
        has_other_frame = free or estimate_frame is not None
        try:
            step("Judging")
            seen_by = replace(run, heading_from_start=True) if has_other_frame else run
            misread = comparison.misread_reference(
                seen_by, attitudes, choices, largest_gap=largest_gap_s, against="the centers of the sets"
            )
            if estimate_frame is not None:
                attitudes = monitored.in_frame(attitudes, _turn(estimate_frame, frame))
            found, hint = _judged_by(run, attitudes, (frame, estimate_frame), limits, largest_gap_s, free=free)
        except ValueError as error:
            raise FileError(f"{source}, {other}: {error}") from error
        summary = {
            "log": str(source),
            "estimate": str(other),
            "time_origin_s": run.origin,
            "turn_within_offset_deg": _largest_deg(run.clock_turns),
            "bounds_from_recording": run.bounds_from_recording,
            "bounds_of_sets": _bounds_of_sets(run, source, configuration),
            "heading_of_sets": _heading_of_sets(run, source, configuration),
            "estimate_misread": misread,
            "rows_that_may_prove": monitored.rows_that_may_prove(run, attitudes, found),
            "hint": hint,
        } | found.to_dict()
        if out is not None:
            _write_monitored(found, out, files, source.name, other.name, summary)
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False))
    else:
        _say_monitored(summary)
        for path in files:
            typer.echo(f"  {path}")
    if misread is not None:
        said = not_as_declared(f"the estimate {misread}", "--estimate-config")
        typer.secho(said, err=True, fg=typer.colors.RED)
    if misread is not None or summary["rows_with_alarm"]:
        raise typer.Exit(1)


def _limits(total: float | None, tilt: float | None, heading: float | None) -> Limits:
    return Limits(*(None if value is None else math.radians(value) for value in (total, tilt, heading)))


def _judge(log: NamedFile, config: Path | None) -> tuple[Run, Configuration | None]:
    """The run that judges: read, or of a log."""
    if config is None:
        return read_run(log)[0], None
    configuration = read_configuration(config)
    if configuration.estimator.mode != "guaranteed":
        raise FileError(f"{config}: estimator.mode: monitor needs 'guaranteed', not {configuration.estimator.mode!r}")
    estimator = PieceEstimator(configuration.with_best("none"))
    pieces = plausibility.plausible_pieces(ahead(logs.read_pieces(log, configuration)), configuration, str(log))
    try:
        (result,) = estimator.run(pieces)
    except ValueError as error:  # also sets that do not meet
        raise FileError(f"{log}: {error}") from error
    assert estimator.guaranteed is not None
    run = monitored.run_of(
        result,
        heading_from_start=estimator.guaranteed.starts_heading,
        bounds_from_recording=configuration.proposed_from,
    )
    return run, configuration


def _judged_by(
    run: Run,
    attitudes: Reference,
    frames: tuple[GroundFrame | None, GroundFrame | None],
    limits: Limits,
    largest_gap: float,
    *,
    free: bool,
) -> tuple[Monitored, str | None]:
    """What the run says of the attitudes, and what is probably the matter with them."""
    has_vertical = frames[0] is not None or run.tilt_bounds is not None
    heading: Heading = "free" if free else "same"
    found = monitored.judge(
        run, attitudes, has_vertical=has_vertical, heading=heading, limits=limits, largest_gap=largest_gap
    )
    hint = monitored.hint(
        run, attitudes, has_vertical=has_vertical, heading=heading, largest_gap=largest_gap, frames=frames
    )
    return found, hint


def _largest_deg(angles: FloatArray | None) -> float | None:
    return None if angles is None else float(np.rad2deg(angles.max()))


def _bounds_of_sets(run: Run, log: NamedFile, configuration: Configuration | None) -> str:
    """Whether the bounds behind the sets are stated; a table alone may have lost the line that says they are not."""
    if run.bounds_from_recording is not None:
        return "proposals"
    return "stated" if configuration is not None or _summary_beside(log).is_file() else "not known"


def _heading_of_sets(run: Run, log: NamedFile, configuration: Configuration | None) -> str:
    """From where the sets' heading counts; of a table alone that is not known."""
    if run.heading_from_start:
        return "from the first row"
    return "as referenced" if configuration is not None or _summary_beside(log).is_file() else "not stated"


def _summary_beside(log: NamedFile) -> Path:
    place = Path(log)
    return (place if place.is_dir() else place.parent) / SUMMARY


def _frame_of_sets(stated: GroundFrame | None, configuration: Configuration | None) -> GroundFrame | None:
    """The option's, or the configuration's if it is on the ground."""
    if configuration is None:
        return stated
    if stated is not None:
        raise typer.BadParameter("the configuration says it", param_hint="--frame")
    return None if configuration.frame == "J2000" else configuration.frame


def _turn(of_estimate: GroundFrame, of_sets: GroundFrame | None) -> FloatArray:
    """What takes vectors from the estimate's reference axes to those of the sets, (3, 3)."""
    if of_sets is None:
        raise typer.BadParameter("needs --frame, the reference frame of the sets", param_hint="--estimate-frame")
    return monitored.frame_to_frame(of_estimate, of_sets)


def _write_monitored(
    found: Monitored, out: Path, files: list[Path], log: str, estimate: str, summary: dict[str, Any]
) -> None:
    """Write table, picture and, last, the summary: it says that the folder is complete."""
    from elliptude.report import figures, run_figures  # Matplotlib would slow every command

    out.mkdir(parents=True, exist_ok=True)
    table, picture, last = files
    write_columns(table, "monitor", monitored.columns(found), origin=summary["time_origin_s"])
    title, recording = f"{estimate} judged by {log}", summary["bounds_from_recording"]
    figures.save(run_figures.monitor_figure(found, title, proposed_from=recording), picture)
    write_json(last, summary)


def _say_monitored(summary: dict[str, Any]) -> None:
    """Print the figures of `elliptude monitor`."""
    typer.echo(f"{summary['estimate']} judged by {summary['log']}: {summary['judged']} of {summary['rows']} rows")
    if summary["bounds_from_recording"] is not None:
        typer.echo(
            f"  the bounds are proposals from {summary['bounds_from_recording']}, so that no alarm is a proof: once "
            "there is a reason for each bound, delete bounds_from_recording in the configuration"
        )
    if summary["bounds_of_sets"] == "not known":
        typer.secho(
            f"  neither the table nor a {SUMMARY} beside it says that its bounds are proposals: taken as stated",
            fg=typer.colors.YELLOW,
        )
    if (turned := summary["turn_within_offset_deg"]) is not None:
        typer.echo(
            "  the gyro's stamps, which the sets have, may be off against the estimate's (flow.time_offset_bound_s): "
            f"bounds are wider by what the body may turn meanwhile, up to {turned:.3g} degrees"
        )
    may_prove = summary["rows_that_may_prove"]
    if may_prove < summary["judged"]:
        typer.echo(
            f"  {summary['judged'] - may_prove} of the {summary['judged']} rows have no sample of the estimate at "
            "their very time: bounds hold there, but only equal times, to 2 ns, prove anything"
        )
    if summary["questions"] == ["tilt"]:
        why = "; the sets' counts from the first row" if summary["heading_of_sets"] == "from the first row" else ""
        typer.echo(f"  the heading is free{why}: the tilt alone is judged")
    elif "heading" in summary["questions"] and summary["heading_of_sets"] == "not stated":
        typer.secho(
            f"  no {SUMMARY} beside the table says from where the sets' heading counts: taken as referenced",
            fg=typer.colors.YELLOW,
        )
    print_table(_table(summary))
    if summary["rows_with_proof"]:
        least = max(filter(None, (summary[question]["largest_least_deg"] for question in summary["questions"])))
        typer.secho(
            f"  proved wrong at {summary['rows_with_proof']} rows, first at {summary['first_proof_s']:.6f} s, by up to "
            f"{least:.3g} degrees at least",
            fg=typer.colors.RED,
        )
    for question in summary["questions"]:
        figures = summary[question]
        if figures["not_within_limit"]:
            typer.secho(
                f"  {question}: at {figures['not_within_limit']} of {summary['judged']} rows no unconditional bound is "
                f"within the limit of {figures['limit_deg']:g} degrees: the error may be larger there, which is no "
                "proof that it is",
                fg=typer.colors.YELLOW,
            )
    if summary["hint"] is not None:
        typer.secho(f"  {summary['hint']}", fg=typer.colors.YELLOW)


def _table(summary: dict[str, Any]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("error", no_wrap=True)
    for heading in (
        "claim",
        "rows",
        "bound\n° mean",
        "median",
        "max",
        "no\nbound",
        "proved\nwrong",
        "not shown\nin limit",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for question in summary["questions"]:
        figures = summary[question]
        for claim in CLAIMS[:2]:
            bound = figures["bound_deg"][claim]
            is_first = claim == CLAIMS[0]
            if not bound["rows"] and not is_first:
                continue
            angles = [f"{bound[which]:.3g}" if bound["rows"] else "-" for which in ("mean", "median", "max")]
            limit = "-" if figures["not_within_limit"] is None else str(figures["not_within_limit"])
            counts = [str(figures["without_bound"]), str(figures["proved_wrong"]), limit]
            if not is_first:
                counts = ["", f"({figures['wrong_if_condition_holds']})", ""]
            table.add_row(question, claim, str(bound["rows"]), *angles, *counts)
    return table
