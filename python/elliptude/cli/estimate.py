"""The command ``elliptude estimate``.

Matplotlib is imported where it draws: its import takes a third of a second, which would slow every command.
"""

import importlib
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer
from rich.console import Console
from rich.progress import Progress, TaskID

from elliptude import smoothing
from elliptude.bounds.angles.about_axes import ErrorAxes, reference_axes
from elliptude.cli.options import LOG_HELP, Force, Repair, ShownAxes, SummaryAsJson, with_repair
from elliptude.cli.outputs import FIGURE, PAGE, SUMMARY, finish, require_outputs
from elliptude.cli.progress import progress_on
from elliptude.configuration.configuration import Configuration, read_configuration
from elliptude.configuration.estimator import BestEstimate, Question
from elliptude.estimation import guaranteed_result, sizes_in_words
from elliptude.estimation.estimator import PieceEstimator
from elliptude.estimation.guaranteed_run import run_guaranteed
from elliptude.estimation.questions import columns as answer_columns
from elliptude.estimation.questions.answers import answers_of
from elliptude.estimation.sizes_in_words import LARGEST_ANGLE, rows_in_words
from elliptude.estimation.summary import SETTLED_UPDATE, Summary
from elliptude.io.background import ahead
from elliptude.io.column_files import write_columns, writing_columns
from elliptude.io.files import FileError
from elliptude.io.spool import NamedFile, recording
from elliptude.logs import log as logs
from elliptude.logs import plausibility
from elliptude.logs.repair import Survey
from elliptude.logs.repaired import Repaired
from elliptude.report.breaks import LongSteps
from elliptude.report.estimated.measured import Measured
from elliptude.report.estimated.reading import read_run
from elliptude.report.estimated.stored import MEASURED
from elliptude.report.thinning import Thinned
from elliptude.results import IF_PROPOSED_BOUNDS_HOLD
from elliptude.smoothing.smoother import smoothed_answers, smoothed_run

_DROPPED = "dropped.csv"


def estimate(
    log: Annotated[
        Path,
        typer.Argument(
            help=f"Measurements: CSV, Parquet, NPZ, ULog, a bag: see docs/logs.md; {LOG_HELP}", show_default=False
        ),
    ],
    config: Annotated[
        Path, typer.Option(help="Which columns are which sensors, their bounds, the body: TOML.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results; created if missing.", show_default=False)],
    report: Annotated[
        Path | None,
        typer.Option(help="Also write the report, as `elliptude report` does: HTML.", show_default=False),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="Use the whole recording for each row, what comes after it, too; for the guaranteed mode.",
        ),
    ] = False,
    format: Annotated[Literal["csv", "parquet"], typer.Option(help="Format of the table.")] = "csv",  # noqa: A002
    ignore_implausible: Annotated[
        bool,
        typer.Option(
            "--ignore-implausible",
            help="Go on although sensors contradict one another, as with a wrong unit or axis; the results say so.",
        ),
    ] = False,
    best: Annotated[
        BestEstimate | None,
        typer.Option(
            help="The estimate beside the set, in the guaranteed mode; if left out, VQF's where it is installed and "
            "fits the sensors, and a Kalman filter's for a rigid body, else the center.",
            show_default=False,
        ),
    ] = None,
    questions: Annotated[
        str | None,
        typer.Option(
            help="What to ask each row of the guaranteed mode by itself, sharper than its set, separated by commas: "
            f"{', '.join(get_args(Question))}. Each answer is columns of the table, and takes about 0.1 ms a row.",
            show_default=False,
        ),
    ] = None,
    repair: Repair = False,
    axes: ShownAxes = "reference",
    as_json: SummaryAsJson = False,
    force: Force = False,
) -> None:
    """Estimate attitudes and their bounds from a log of measurements.

    Writes a table of results, samples of what was measured, a figure and, last, summary.json; in the guaranteed mode
    also dropped.csv, every measurement that was left out; with --report also the page that `elliptude report` makes.
    Where the configuration names a truth to compare with, they say how far off the estimates are and how often the
    truth lies inside the set. The exit code is 1 if no row has a set and none says where up is.
    """
    configuration = with_repair(read_configuration(config), repair)
    if ignore_implausible:
        configuration = configuration.model_copy(update={"implausible": "ignore"})
    try:
        if questions is not None:
            configuration = configuration.with_questions(_questions_of(questions))
        if smooth:
            smoothing.require_guaranteed(configuration)
    except ValueError as error:
        raise FileError(f"{config}: {error}") from error
    if best is not None:
        if configuration.estimator.mode != "guaranteed":
            raise FileError("--best needs estimator.mode = 'guaranteed'")
        configuration = configuration.with_best(best)
    files = [out / f"results.{format}", out / MEASURED, out / FIGURE, out / SUMMARY]
    if configuration.estimator.mode == "guaranteed":
        files.insert(1, out / _DROPPED)
    if report is not None:
        from elliptude.report import page as html_report

        # An error at the end is better found before a long estimation.
        html_report.plotly_script()
        files.append(report)
    other = out / f"results.{'csv' if format == 'parquet' else 'parquet'}"
    written = [*files, other] if other.exists() else files
    require_outputs(written, force=force, folder=out, read=[log, config], endings={report: PAGE})
    source = recording(log)
    with _making(out), progress_on(Console(stderr=True), "{task.completed:,} rows") as progress:
        summary = _estimate_pieces(source, configuration, out, files[0].name, progress, smooth, axes)
        other.unlink(missing_ok=True)  # of an earlier estimation: a folder of results has one table
        if report is not None:
            run, label = read_run(out)
            html_report.write_report(replace(run, axes=axes), report, source.name, label=label)
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False))
    else:
        _say(source, summary)
        for file in files:
            typer.echo(f"  {file}")
    if _is_nothing_known(summary):
        raise typer.Exit(1)


def _questions_of(names: str) -> list[Question]:
    """The questions that an option names."""
    known: tuple[Question, ...] = get_args(Question)
    asked = [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in known:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(known)}", param_hint="--questions")
    return [one for one in known if one in asked]


def _is_nothing_known(summary: dict[str, Any]) -> bool:
    """Whether no row of the guaranteed mode has a set, nor says where up is."""
    of_up = summary.get("up_claim_share_of_rows")
    return bool(summary.get("why_no_set")) and (of_up is None or of_up["none"] == 1.0)


def _say(log: NamedFile, summary: dict[str, Any]) -> None:
    """Print the main figures of the summary."""
    if hints := summary.get("why_no_set"):
        typer.secho(f"{log}: no row has a set: {'; '.join(hints)}", fg=typer.colors.RED)
    for one in summary["repaired"]:
        typer.secho(f"repaired: {one['said']}", fg=typer.colors.YELLOW)
    for one in summary["implausible"]:
        typer.secho(f"gone on although implausible: {one}", fg=typer.colors.RED)
    if summary["calibrated"]:
        typer.echo(f"corrected by a calibration: {', '.join(summary['calibrated'])}")
    for one in summary["calibrations_not_used"]:
        typer.secho(one, fg=typer.colors.YELLOW)
    for one in summary["suspicious_statements"]:
        typer.secho(f"suspicious: {one}", fg=typer.colors.YELLOW)
    if summary["mode"] == "guaranteed":
        _say_of_guaranteed(log, summary)
    else:
        typer.echo(
            f"{log}: {rows_in_words(summary['rows'])}, {summary['updates']} updates, {summary['refused']} refused"
        )
    if "smoothing" in summary:
        for line in summary["smoothing"]["said"]:
            typer.echo(f"  {line}")
    _say_up(summary)
    for line in summary["gaps"]["said"]:
        typer.echo(f"  {line}")
    largest = summary["largest_angle_deg"]
    if largest["mean_settled"] is not None and "sizes" not in summary:
        said = sizes_in_words.mean_and_most(largest["mean_settled"], largest["max_settled"])
        typer.echo(f"  {LARGEST_ANGLE} {said} degrees: mean (at most), from the {SETTLED_UPDATE}th update on")
    if summary["compared_with"] is not None and summary["inside_share_of_rows"] is not None:
        error = summary["attitude_error_deg"]["mean"]
        inside = 100.0 * summary["inside_share_of_rows"]
        typer.echo(
            f"  against {summary['compared_with']}: mean error {error:.3g} degrees, inside at {inside:.4g} % of rows"
        )
    if (best := summary.get("best")) is not None:
        typer.echo(f"  best estimate, {best['in_words']}")


def _say_up(summary: dict[str, Any]) -> None:
    """Print which way up the body was, which only the user can check."""
    if summary["up_at_rest"] is not None:
        typer.echo(f"  {summary['up_at_rest']['in_words']}")


def _say_of_guaranteed(log: NamedFile, summary: dict[str, Any]) -> None:
    claims = summary["claim_share_of_rows"]
    recording = summary["bounds_from_recording"]
    if recording is None:
        shares = ", ".join(f"{name} {100.0 * share:.4g} %" for name, share in claims.items())
        typer.echo(f"{log}: {rows_in_words(summary['rows'])}; the guarantee is {shares}")
    else:
        shares = ", ".join(f"{100.0 * share:.4g} % {IF_PROPOSED_BOUNDS_HOLD[name]}" for name, share in claims.items())
        typer.echo(f"{log}: {rows_in_words(summary['rows'])}; {shares}")
        typer.echo(
            f"  the bounds are proposals from {recording}, so that the sets are no guarantee: once there is a reason "
            "for each bound, delete bounds_from_recording in the configuration"
        )
    for sensor, rows in summary["contradicted_rows"].items():
        what = "left out for the whole recording" if sensor in summary["void"] else "left out there"
        contradict = "1 row contradicts" if rows == 1 else f"{rows} rows contradict"
        typer.echo(f"  {sensor}: {contradict} its stated bounds; {what}")
    if summary["contradicted_up"] is not None:
        typer.secho(f"  {summary['contradicted_up']['said']}", fg=typer.colors.RED)
    if summary["dropped_measurements"]:
        counts = ", ".join(f"{name} {count}" for name, count in summary["dropped_by_sensor"].items())
        typer.echo(
            f"  {summary['dropped_measurements']} measurements contradict the prediction or one another; left out "
            f"({counts})"
        )
    if summary["heading"] == "from the first row":
        typer.echo("  nothing determines the heading: it counts from the first row")
    axes = reference_axes(summary["reference_frame"], summary["heading"] == "from the first row")
    for line in sizes_in_words.lines(summary["sizes"], axes):
        typer.echo(f"  {line}")
    if rows := summary["tilt_beyond_set_rows"]:
        typer.echo(f"  {sizes_in_words.tilt_beyond_set(rows)}")
    for name, part in summary["sizes"].items():
        if asked := answer_columns.in_words(part):
            typer.echo(f"  asked one by one: {asked} degrees (mean, {name.replace('_', ' ')})")
    if (of_up := summary["up_claim_share_of_rows"]) is not None and of_up["none"] < claims["none"]:
        known = 100.0 * (1.0 - of_up["none"])
        surely = "" if recording else f", unconditionally at {100.0 * of_up['unconditional']:.4g} %"
        typer.echo(f"  up is known at {known:.4g} % of rows{surely}")


def _estimate_pieces(
    log: NamedFile,
    configuration: Configuration,
    out: Path,
    table: str,
    progress: Progress,
    smooth: bool,
    axes: ErrorAxes,
) -> dict[str, Any]:
    """Read, estimate and write piece by piece: memory does not grow with the log."""
    task = progress.add_task("Reading", total=None)
    heard = plausibility.Heard()
    found = Survey()
    read = _noting_repairs(logs.read_pieces(log, configuration), found)
    pieces = plausibility.plausible_pieces(ahead(read), configuration, str(log), heard)
    made, answering = (smoothed_run, smoothed_answers) if smooth else (run_guaranteed, answers_of)
    estimator = PieceEstimator(configuration, made, answering)
    at_once = configuration.estimator.mode == "guaranteed"
    if at_once:
        pieces = _counted(pieces, progress, task)
    summary, thinned, steps, measured = Summary(), Thinned(), LongSteps(), Measured(configuration)
    try:
        with writing_columns(out / table, "results", heard.notes, configuration.proposed_from) as write:
            for result in estimator.run(_measured(pieces, measured)):
                progress.update(task, advance=0 if at_once else len(result.times), description="Estimating")
                # It takes a third of a second, while the core works on the next piece.
                importlib.import_module("elliptude.report.figures")
                write(result.columns(), result.origin)
                summary.add(result)
                thinned.add(result)
                steps.add(result.times)
                if not at_once:
                    measured.add_left_out(result)
            progress.update(task, description="Writing")
            # Of an earlier estimation: the new table is not of it.
            for name in (SUMMARY, MEASURED, _DROPPED):
                (out / name).unlink(missing_ok=True)
    except ValueError as error:  # also sets that do not meet
        raise FileError(f"{log}: {heard.after(str(error))}") from error
    if estimator.guaranteed is not None:
        dropped = guaranteed_result.dropped_columns(estimator.guaranteed)
        write_columns(out / _DROPPED, "dropped", dropped, estimator.guaranteed.log.counts_from)
        measured.add_left_out_at(zip(map(float, dropped["time_s"]), map(str, dropped["sensor"]), strict=True))
    figures_of = summary.to_dict(
        configuration,
        vector_is_compared=estimator.vector_is_compared,
        elapsed=estimator.elapsed,
        guaranteed=estimator.guaranteed,
        heard=heard,
        bridged=estimator.bridged,
        best=estimator.best,
        answers=estimator.answers,
    )
    if smooth:
        assert estimator.guaranteed is not None
        figures_of["smoothing"] = smoothing.figures(estimator.guaranteed)
    figures_of["repaired"] = found.to_dict()
    return finish(
        thinned.result(),
        figures_of,
        configuration,
        out,
        table,
        log.name,
        summary.inside_share,
        axes,
        measured.sensors(),
        steps.gaps(figures_of["gaps"]["longest_interval_s"]),
    )


def _noting_repairs(pieces: Iterator[logs.Log], found: Survey) -> Iterator[logs.Log]:
    """The pieces of a log; what was repaired in its file is noted with the first one."""
    for piece in pieces:
        if isinstance(piece.file, Repaired) and not found.faults:
            found.faults += piece.file.found.faults
        yield piece


def _measured(pieces: Iterator[logs.Log], measured: Measured) -> Iterator[logs.Log]:
    """The pieces of a log; what they measured is kept for the pictures."""
    for piece in pieces:
        measured.add(piece)
        yield piece


def _counted(pieces: Iterator[logs.Log], progress: Progress, task: TaskID) -> Iterator[logs.Log]:
    """The pieces of a log; the progress changes once all rows are read, before any is estimated."""
    for piece in pieces:
        progress.update(task, advance=len(piece.times))
        yield piece
    progress.update(task, description="Estimating")


@contextmanager
def _making(folder: Path) -> Iterator[None]:
    """Make the folder and those above it; if the block fails, remove the new ones again."""
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for one in new:
                one.rmdir()
        raise
