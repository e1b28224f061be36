"""The commands ``elliptude estimate`` and ``elliptude demo``.

What draws is imported where it is drawn: Matplotlib takes a third of a second, which every command would take longer.
"""

import importlib
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomlkit
import typer
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from elliptude.cli import simulate
from elliptude.cli.options import Force, SummaryAsJson, refuse_to_replace
from elliptude.configuration.configuration import Configuration, read_configuration
from elliptude.estimation import estimator as estimation
from elliptude.estimation import guaranteed_results
from elliptude.estimation.estimator import Estimation, PieceEstimator
from elliptude.estimation.summary import SETTLED_UPDATE, Summary
from elliptude.io.background import ahead
from elliptude.io.files import FileError, replacing, write_json
from elliptude.io.tables import Results, write_columns, writing_columns
from elliptude.logs import log as logs
from elliptude.logs import plausibility
from elliptude.report.run import read_run
from elliptude.report.thinning import Thinned
from elliptude.results import IF_PROPOSED_BOUNDS_HOLD
from elliptude.simulation import fermi, scenarios
from elliptude.simulation import simulated as simulation
from elliptude.typing import FloatArray

_FIGURE, _SUMMARY, _DROPPED = "estimate.png", "summary.json", "dropped.csv"


def estimate(
    log: Annotated[
        Path,
        typer.Argument(help="Measurements: CSV, Parquet, NPZ, ULog, a bag: see docs/logs.md.", show_default=False),
    ],
    config: Annotated[
        Path, typer.Option(help="Which columns are which sensors, their bounds, the body: TOML.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Folder for what is written; made if need be.", show_default=False)],
    report: Annotated[
        Path | None,
        typer.Option(help="Also write what `elliptude report` makes of the result: HTML.", show_default=False),
    ] = None,
    format: Annotated[Literal["csv", "parquet"], typer.Option(help="Of the table.")] = "csv",  # noqa: A002
    ignore_implausible: Annotated[
        bool,
        typer.Option(
            "--ignore-implausible",
            help="Go on where sensors contradict one another as with a wrong unit, order or axis; the results say so.",
        ),
    ] = False,
    as_json: SummaryAsJson = False,
    force: Force = False,
) -> None:
    """Estimate attitudes and their bounds from a log of measurements.

    Writes a table of results, a figure and, last, summary.json; in the guaranteed mode also dropped.csv, every
    measurement that was left out; with --report also the page that `elliptude report` makes. Where the configuration
    names a truth to compare with, they say how far off the estimates are and how often the truth lies inside the set.
    """
    configuration = read_configuration(config)
    if ignore_implausible:
        configuration = configuration.model_copy(update={"implausible": "ignore"})
    files = [out / f"results.{format}", out / _FIGURE, out / _SUMMARY]
    if configuration.estimator.mode == "guaranteed":
        files.insert(1, out / _DROPPED)
    if report is not None:
        from elliptude.report import page as html_report

        # What would fail at the end is better said before a long estimation.
        html_report.plotly_script()
        if not report.parent.is_dir() and report.parent.resolve() != out.resolve():
            raise FileError(f"{report}: not written: no such folder")
        files.append(report)
    refuse_to_replace(files, force)
    with _making(out), _progress(Console(stderr=True), "{task.completed:,} rows") as progress:
        summary = _estimate_pieces(log, configuration, out, files[0].name, progress)
        if report is not None:
            run, label = read_run(out)
            html_report.write_report(run, report, log.name, label=label)
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False))
        return
    _say(log, summary)
    for file in files:
        typer.echo(f"  {file}")


def _say(log: Path, summary: dict[str, Any]) -> None:
    """The summary's essence."""
    for one in summary["implausible"]:
        typer.secho(f"gone on although implausible: {one}", fg=typer.colors.RED)
    for one in summary["suspicious_statements"]:
        typer.secho(f"suspicious: {one}", fg=typer.colors.YELLOW)
    if summary["mode"] == "guaranteed":
        _say_of_guaranteed(log, summary)
    else:
        typer.echo(f"{log}: {summary['rows']} rows, {summary['updates']} updates, {summary['refused']} refused")
    _say_up(summary)
    for line in summary["gaps"]["said"]:
        typer.echo(f"  {line}")
    largest = summary["largest_angle_deg"]["mean_settled"]
    if largest is not None:
        typer.echo(f"  bound {largest:.3g} degrees (largest angle, mean from the {SETTLED_UPDATE}th update on)")
    if summary["compared_with"] is not None and summary["inside_share_of_rows"] is not None:
        error = summary["attitude_error_deg"]["mean"]
        inside = 100.0 * summary["inside_share_of_rows"]
        typer.echo(
            f"  against {summary['compared_with']}: mean error {error:.3g} degrees, inside at {inside:.4g} % of rows"
        )


def _say_up(summary: dict[str, Any]) -> None:
    """Which way up the body was taken to be, which nobody but a person can check."""
    if summary["up_at_rest"] is not None:
        typer.echo(f"  {summary['up_at_rest']['in_words']}")


def _say_of_guaranteed(log: Path, summary: dict[str, Any]) -> None:
    claims = summary["claim_share_of_rows"]
    recording = summary["bounds_from_recording"]
    if recording is None:
        shares = ", ".join(f"{name} {100.0 * share:.4g} %" for name, share in claims.items())
        typer.echo(f"{log}: {summary['rows']} rows; the guarantee is {shares}")
    else:
        shares = ", ".join(f"{100.0 * share:.4g} % {IF_PROPOSED_BOUNDS_HOLD[name]}" for name, share in claims.items())
        typer.echo(f"{log}: {summary['rows']} rows; {shares}")
        typer.echo(
            f"  the bounds are proposals from {recording}, so that the sets are no guarantee: once there is a reason "
            "for each bound, delete bounds_from_recording in the configuration"
        )
    for hint in summary["why_no_set"]:
        typer.secho(f"  no set at any row: {hint}", fg=typer.colors.YELLOW)
    for sensor, rows in summary["contradicted_rows"].items():
        what = "left out for the whole recording" if sensor in summary["void"] else "left out there"
        typer.echo(f"  {sensor}: {rows} rows contradict its stated bounds; {what}")
    if summary["dropped_measurements"]:
        typer.echo(
            f"  {summary['dropped_measurements']} measurements contradict the prediction or one another; left out"
        )
    if summary["heading"] == "from the first row":
        typer.echo("  nothing tells the heading: it counts from the first row")
    for name, part in summary["sizes"].items():
        means = part["half_width_reference_deg"]["mean"]
        if means is not None:
            tilt = part["tilt_bound_deg"]
            said = ", ".join(f"{width:.3g}" for width in means)
            up = "" if tilt is None else f", up within {tilt['mean']:.3g}"
            typer.echo(f"  half-widths about the reference axes {said} degrees{up} (mean, {name.replace('_', ' ')})")


def _estimate_pieces(
    log: Path, configuration: Configuration, out: Path, table: str, progress: Progress
) -> dict[str, Any]:
    """Read, estimate and write piece by piece: memory does not grow with the log."""
    task = progress.add_task("Reading", total=None)
    heard = plausibility.Heard()
    pieces = plausibility.plausible_pieces(ahead(logs.read_pieces(log, configuration)), configuration, str(log), heard)
    estimator = PieceEstimator(configuration)
    at_once = configuration.estimator.mode == "guaranteed"
    if at_once:
        pieces = _counted(pieces, progress, task)
    summary, thinned = Summary(), Thinned()
    try:
        with writing_columns(out / table, "results", heard.notes) as write:
            for results in estimator.run(pieces):
                progress.update(task, advance=0 if at_once else len(results.times), description="Estimating")
                # It takes a third of a second, and the core is at work on the next piece.
                importlib.import_module("elliptude.report.figures")
                write(results.columns())
                summary.add(results)
                thinned.add(results)
            progress.update(task, description="Writing")
            (out / _SUMMARY).unlink(missing_ok=True)
    except ValueError as error:  # sets that do not meet among them
        raise FileError(f"{log}: {error}") from error
    if estimator.guaranteed is not None:
        write_columns(out / _DROPPED, "dropped", guaranteed_results.dropped_columns(estimator.guaranteed))
    figures_of = summary.to_dict(
        configuration,
        vector_is_compared=estimator.vector_is_compared,
        elapsed=estimator.elapsed,
        guaranteed=estimator.guaranteed,
        heard=heard,
        bridged=estimator.bridged,
    )
    return _finish(thinned.results(), figures_of, configuration, out, table, log.name, summary.inside_share)


def _counted(pieces: Iterator[logs.Log], progress: Progress, task: TaskID) -> Iterator[logs.Log]:
    """The pieces of a log whose rows are all read before the first of them is worked on: said when it is so."""
    for piece in pieces:
        progress.update(task, advance=len(piece.times))
        yield piece
    progress.update(task, description="Estimating")


def _write(estimated: Estimation, configuration: Configuration, out: Path, *, title: str) -> dict[str, Any]:
    """Write results, figure and, last, the summary, which says that the folder is complete."""
    (out / _SUMMARY).unlink(missing_ok=True)
    estimated.results.write(out / "results.csv")
    summary = estimation.summarize(estimated, configuration)
    return _finish(estimated.results, summary, configuration, out, "results.csv", title)


def _finish(
    drawn: Results,
    summary: dict[str, Any],
    configuration: Configuration,
    out: Path,
    table: str,
    title: str,
    inside_share: float | None = None,
) -> dict[str, Any]:
    from elliptude.report import figures

    label = configuration.truth.label if configuration.truth is not None else "truth"
    figure = figures.estimate_figure(drawn, title, label=label, inside_share=inside_share)
    figures.save(figure, out / _FIGURE)
    summary |= {"results": table, "figure": _FIGURE}
    write_json(out / _SUMMARY, summary)
    return summary


@contextmanager
def _making(folder: Path) -> Iterator[None]:
    """The folder with those above it; where nothing comes of it, those that were not there are gone again."""
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for one in new:
                one.rmdir()
        raise


def _progress(console: Console, completed: str = "{task.percentage:>3.0f} %") -> Progress:
    """On a terminal only; nothing is left of it."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(completed),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


# --- demo -------------------------------------------------------------------------------------------------------------

_SEEDS = 100
_BOUND_DEG = 7.0


@dataclass(frozen=True)
class _Line:
    """A line of the demo's table."""

    case: str
    error_deg: float
    bound_deg: float
    updates: int
    inside: float
    inside_at_worst: float | None
    refused: int
    elapsed_s: float


def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for what is written; an earlier demo's files are replaced.", show_default=False)
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print the table as JSON.")] = False,
) -> None:
    """Show the estimator at work: a simulated spacecraft, a simulated pendulum, and an hour of the Fermi spacecraft.

    Simulated are two or three directions within 7 degrees and the angular velocity; for Fermi it is the Sun and the
    rates, with and without a synthetic star.
    """
    console = Console(stderr=True)
    lines: list[_Line] = []
    written: list[Path] = []
    cases = [(name, directions) for name in ("orbit", "pendulum") for directions in ("three", "two")]
    with _progress(console) as progress:
        task = progress.add_task("", total=len(cases) + 1)
        for name, directions in cases:
            progress.update(task, description=f"{name}, {directions} directions")
            folder = out / f"{name}-{directions}"
            lines.append(_scenario(name, directions, folder))
            written += [folder / _FIGURE, folder / "results.csv"]
            progress.advance(task)
        progress.update(task, description="Fermi")
        lines += _fermi(out / "fermi")
        written += [out / "fermi" / name for name in ("fermi.png", f"sun/{_FIGURE}", f"sun-and-star/{_FIGURE}")]
        progress.advance(task)
    write_json(out / "demo.json", [vars(line) for line in lines])
    written.append(out / "demo.json")
    if as_json:
        typer.echo(json.dumps([vars(line) for line in lines], indent=2, ensure_ascii=False))
        return
    terminal = Console()
    # Cells that end in "..." help nobody; a narrower terminal breaks the lines.
    Console(width=max(terminal.width, 88)).print(_table(lines))
    typer.echo(
        f"\nAttitude error and its bound, the largest angle in the set: means from the "
        f"{SETTLED_UPDATE}th update on.\n"
        f"Inside: the share of all updates whose truth lies in the set. Simulations: {_SEEDS} seeds,\n"
        "errors within the bounds; worst: each error as large as its bound. The bound is of\n"
        "first order, so the truth may lie outside.\n"
    )
    for file in written:
        typer.echo(file)


def _table(lines: list[_Line]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 1))
    table.add_column("", no_wrap=True)
    for heading in ("error °", "bound °", "updates", "inside %", "worst %", "refused"):
        table.add_column(heading, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(
            line.case,
            f"{line.error_deg:.2f}",
            f"{line.bound_deg:.2f}",
            f"{line.updates}",
            f"{100.0 * line.inside:.2f}",
            "" if line.inside_at_worst is None else f"{100.0 * line.inside_at_worst:.2f}",
            f"{line.refused}",
        )
    return table


def _scenario(name: str, directions: str, folder: Path) -> _Line:
    """A scenario with many seeds; the first one's files are what `simulate` and `estimate` write."""
    begin = time.perf_counter()
    scenario = scenarios.load(name)
    truth = simulation.truth(scenario)
    by_noise: dict[simulation.Noise, list[Estimation]] = {"inside": [], "perpendicular": []}
    for noise, estimations in by_noise.items():
        for seed in range(_SEEDS):
            simulated = simulation.measure(
                scenario, truth, seed=seed, directions=directions, bound_deg=_BOUND_DEG, noise=noise
            )
            tables = simulate.configuration_tables(scenario, simulated)
            tables["estimator"] = {"when_sets_do_not_meet": "skip"}
            configuration = Configuration.model_validate(tables)
            estimations.append(estimation.estimate(logs.log_of(simulated.measurements), configuration))
            if noise == "inside" and seed == 0:
                folder.mkdir(parents=True, exist_ok=True)
                simulated.measurements.write(folder / "measurements.csv")
                with replacing(folder / "estimate.toml") as temporary:
                    temporary.write_text(tomlkit.dumps(tables), encoding="utf-8")
                title = f"{scenario.description}\n{directions} directions within {_BOUND_DEG:g}° and the rate"
                _write(estimations[0], configuration, folder, title=title)
    worst = np.concatenate([_forms_of_updates(one) for one in by_noise["perpendicular"]])
    return _line(
        f"{name}, {directions} directions",
        by_noise["inside"],
        time.perf_counter() - begin,
        inside_at_worst=float(np.mean(worst <= 1.0)),
    )


def _fermi(folder: Path) -> list[_Line]:
    """Fermi with the Sun alone after the first row, and with the synthetic star all along."""
    recorded, configuration = fermi.telemetry(), fermi.configuration()
    lines, runs = [], []
    cases = (("Sun alone", "sun", 1), ("Sun + synthetic star", "sun-and-star", None))
    for name, subfolder, star_until in cases:
        begin = time.perf_counter()
        place = folder / subfolder
        place.mkdir(parents=True, exist_ok=True)
        measurements = fermi.measurements(recorded, star_until=star_until)
        measurements.write(place / "measurements.csv")
        with fermi.configuration_file() as file, replacing(place / "estimate.toml") as temporary:
            temporary.write_bytes(file.read_bytes())
        log = logs.read_log(place / "measurements.csv", configuration)
        estimated = estimation.estimate(log, configuration)
        _write(estimated, configuration, place, title=f"Fermi, 13 October 2015: {name}")
        runs.append(
            (name, estimated.results, *fermi.half_widths_about(estimated.results, measurements.references[:, 0]))
        )
        lines.append(_line(f"Fermi, {name}", [estimated], time.perf_counter() - begin))
    from elliptude.report import figures

    figure = figures.about_line_figure(
        runs[0][1].times,
        runs,
        "Fermi, 13 October 2015: the Sun from the solar arrays within 2°, the rate within 0.005°/s",
        line="Sun line",
        label="the recorded attitude",
    )
    figures.save(figure, folder / "fermi.png")
    return lines


def _updates(estimated: Estimation) -> NDArray[np.intp]:
    return np.flatnonzero([bool(names) for names in estimated.results.used])


def _forms_of_updates(estimated: Estimation) -> FloatArray:
    assert estimated.results.forms is not None
    return estimated.results.forms[_updates(estimated)]


def _line(case: str, estimations: list[Estimation], elapsed: float, *, inside_at_worst: float | None = None) -> _Line:
    """Error and bound are means from the settled update on, the share is of all updates."""
    errors: list[FloatArray] = []
    bounds: list[FloatArray] = []
    for estimated in estimations:
        assert estimated.results.errors is not None
        settled = _updates(estimated)[SETTLED_UPDATE - 1 :]
        errors.append(np.linalg.norm(estimated.results.errors[settled, :3], axis=1))
        bounds.append(estimated.results.largest_angles[settled])
    inside = np.concatenate([_forms_of_updates(estimated) for estimated in estimations]) <= 1.0
    return _Line(
        case=case,
        error_deg=float(np.rad2deg(np.concatenate(errors).mean())),
        bound_deg=float(np.rad2deg(np.concatenate(bounds).mean())),
        updates=len(inside),
        inside=float(inside.mean()),
        inside_at_worst=inside_at_worst,
        refused=sum(bool(names) for estimated in estimations for names in estimated.results.refused),
        elapsed_s=elapsed,
    )
