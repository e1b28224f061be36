"""The command ``elliptude demo``.

Matplotlib is imported where it draws: its import takes a third of a second, which would slow every command.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
import tomlkit
import typer
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.cli.outputs import FIGURE, SUMMARY, finish, print_table, require_outputs
from elliptude.cli.progress import progress_on
from elliptude.configuration.configuration import Configuration, read_configuration
from elliptude.estimation import estimator as estimation
from elliptude.estimation.estimator import Estimation
from elliptude.estimation.summary import SETTLED_UPDATE
from elliptude.io.files import replacing, write_json
from elliptude.io.toml import load_toml
from elliptude.logs import log as logs
from elliptude.report.estimated.measured import Measured
from elliptude.report.estimated.stored import MEASURED
from elliptude.simulation import fermi, scenarios
from elliptude.simulation import simulated as simulation
from elliptude.simulation.configured import configuration_tables
from elliptude.typing import FloatArray

_SEEDS = 100
_BOUND_DEG = 7.0
_NOISES: tuple[simulation.Noise, ...] = ("inside", "perpendicular")
_Mode: TypeAlias = Literal["guaranteed", "first_order"]
_ENDINGS: dict[_Mode, str] = {"guaranteed": "-guaranteed", "first_order": ""}
"""What the names of the modes' folders end in."""


@dataclass(frozen=True)
class _Line:
    """A line of the demo's table."""

    case: str
    mode: _Mode
    error_deg: float
    bound_deg: float
    updates: int
    inside: float
    inside_at_worst: float | None
    refused: int
    elapsed_s: float


def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for the files; those of an earlier demo are replaced.", show_default=False)
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print the table as JSON.")] = False,
) -> None:
    """Show the estimator at work: a simulated spacecraft, a simulated pendulum, and an hour of the Fermi spacecraft.

    Simulated are two or three directions within 7 degrees and the angular velocity; for Fermi it is the Sun and the
    rates, with and without a synthetic star. The guaranteed mode comes first, with the paper's estimator below it.
    """
    require_outputs([out / "demo.json"], force=True, folder=out)
    console = Console(stderr=True)
    lines: list[_Line] = []
    written: list[Path] = []
    cases = [(name, directions) for name in ("orbit", "pendulum") for directions in ("three", "two")]
    with progress_on(console) as progress:
        task = progress.add_task("", total=len(cases) + 1)
        for name, directions in cases:
            progress.update(task, description=f"{name}, {directions} directions")
            lines += _scenario(name, directions, out)
            for ending in _ENDINGS.values():
                written += [out / f"{name}-{directions}{ending}" / file for file in (FIGURE, "results.csv")]
            progress.advance(task)
        progress.update(task, description="Fermi")
        lines += _fermi(out / "fermi")
        written += [
            out / "fermi" / name / FIGURE for name in ("sun", *(f"sun-and-star{one}" for one in _ENDINGS.values()))
        ]
        written.append(out / "fermi" / "fermi.png")
        progress.advance(task)
    write_json(out / "demo.json", [vars(line) for line in lines])
    written.append(out / "demo.json")
    if as_json:
        typer.echo(json.dumps([vars(line) for line in lines], indent=2, ensure_ascii=False))
        return
    print_table(_table(lines))
    typer.echo(
        f"\nAttitude error and its bound, the largest angle in the set: means from the "
        f"{SETTLED_UPDATE}th update on.\n"
        f"Inside: the share of all updates whose truth lies in the set. Simulations: {_SEEDS} seeds,\n"
        "errors within the bounds; worst: each error as large as its bound. In the mode guaranteed the\n"
        "truth is inside whenever errors keep their bounds. The paper's estimator, first_order, drops\n"
        "terms of second order, so the truth may lie outside.\n"
    )
    for file in written:
        typer.echo(file)


def _table(lines: list[_Line]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 1))
    table.add_column("", no_wrap=True)
    table.add_column("mode", no_wrap=True)
    for heading in ("error\n°", "bound\n°", "updates", "inside\n%", "worst\n%", "refused"):
        table.add_column(heading, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(
            line.case,
            line.mode,
            f"{line.error_deg:.2f}",
            f"{line.bound_deg:.2f}",
            f"{line.updates}",
            f"{100.0 * line.inside:.2f}",
            "" if line.inside_at_worst is None else f"{100.0 * line.inside_at_worst:.2f}",
            f"{line.refused}",
        )
    return table


def _scenario(name: str, directions: str, out: Path) -> list[_Line]:
    """A scenario with many seeds in both modes; the first one's files are what `simulate` and `estimate` write."""
    scenario = scenarios.load(name)
    truth = simulation.truth(scenario)
    measured = [
        (
            noise,
            seed,
            simulation.measure(scenario, truth, seed=seed, directions=directions, bound_deg=_BOUND_DEG, noise=noise),
        )
        for noise in _NOISES
        for seed in range(_SEEDS)
    ]
    lines = []
    for mode, ending in _ENDINGS.items():
        begin = time.perf_counter()
        by_noise: dict[simulation.Noise, list[Estimation]] = {noise: [] for noise in _NOISES}
        for noise, seed, simulated in measured:
            tables = _in_mode(configuration_tables(scenario, simulated), mode)
            is_written = noise == "inside" and seed == 0
            configuration = Configuration.model_validate(tables)
            if mode == "guaranteed" and not is_written:
                configuration = configuration.with_best("none")  # an estimate beside the sets takes half of the time
            log = logs.log_of(simulated.measurements)
            estimated = estimation.estimate(log, configuration)
            by_noise[noise].append(estimated)
            if is_written:
                folder = out / f"{name}-{directions}{ending}"
                folder.mkdir(parents=True, exist_ok=True)
                simulated.measurements.write(folder / "measurements.csv")
                with replacing(folder / "estimate.toml") as temporary:
                    temporary.write_text(tomlkit.dumps(tables), encoding="utf-8")
                title = f"{scenario.description}\n{directions} directions within {_BOUND_DEG:g}° and the rate"
                _write(log, estimated, configuration, folder, title=title)
        worst = np.concatenate([_forms_of_updates(one) for one in by_noise["perpendicular"]])
        lines.append(
            _line(
                f"{name}, {directions} directions",
                mode,
                by_noise["inside"],
                time.perf_counter() - begin,
                inside_at_worst=float(np.mean(worst <= 1.0)),
            )
        )
    return lines


def _in_mode(tables: dict[str, Any], mode: _Mode) -> dict[str, Any]:
    """A configuration in a mode. The guaranteed one starts from nothing if no set is given."""
    if mode == "first_order":
        return tables | {"estimator": tables.get("estimator", {"when_sets_do_not_meet": "skip"})}
    told = {key: value for key, value in tables.items() if key != "start" or value["kind"] == "given"}
    return told | {"estimator": {"mode": mode}}


def _fermi(folder: Path) -> list[_Line]:
    """Fermi with only the Sun after the first row, and with the synthetic star throughout, this in both modes."""
    recorded = fermi.telemetry()
    with fermi.configuration_file() as file:
        stated = load_toml(file)
    lines, runs = [], []
    cases: tuple[tuple[str, str, int | None, _Mode], ...] = (
        ("Sun + synthetic star", "sun-and-star", None, "guaranteed"),
        ("Sun alone", "sun", 1, "first_order"),
        ("Sun + synthetic star", "sun-and-star", None, "first_order"),
    )
    for name, subfolder, star_until, mode in cases:
        begin = time.perf_counter()
        place = folder / f"{subfolder}{_ENDINGS[mode]}"
        place.mkdir(parents=True, exist_ok=True)
        measurements = fermi.measurements(recorded, star_until=star_until)
        measurements.write(place / "measurements.csv")
        with fermi.configuration_file() as file, replacing(place / "estimate.toml") as temporary:
            if mode == "first_order":
                temporary.write_bytes(file.read_bytes())
            else:
                temporary.write_text(tomlkit.dumps(_in_mode(stated, mode)), encoding="utf-8")
        configuration = read_configuration(place / "estimate.toml")
        log = logs.read_log(place / "measurements.csv", configuration)
        estimated = estimation.estimate(log, configuration)
        _write(log, estimated, configuration, place, title=f"Fermi, 13 October 2015: {name}")
        if mode == "first_order":
            about = fermi.half_widths_about(estimated.result, measurements.references[:, 0])
            runs.append((name, estimated.result, *about))
        lines.append(_line(f"Fermi, {name}", mode, [estimated], time.perf_counter() - begin))
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
    return np.flatnonzero([bool(names) for names in estimated.result.used])


def _forms_of_updates(estimated: Estimation) -> FloatArray:
    assert estimated.result.forms is not None
    return estimated.result.forms[_updates(estimated)]


def _line(
    case: str, mode: _Mode, estimations: list[Estimation], elapsed: float, *, inside_at_worst: float | None = None
) -> _Line:
    """Error and bound are means from the settled update on, the share is of all updates."""
    errors: list[FloatArray] = []
    bounds: list[FloatArray] = []
    for estimated in estimations:
        assert estimated.result.errors is not None
        settled = _updates(estimated)[SETTLED_UPDATE - 1 :]
        errors.append(np.linalg.norm(estimated.result.errors[settled, :3], axis=1))
        bounds.append(estimated.result.largest_angles[settled])
    inside = np.concatenate([_forms_of_updates(estimated) for estimated in estimations]) <= 1.0
    return _Line(
        case=case,
        mode=mode,
        error_deg=float(np.rad2deg(np.concatenate(errors).mean())),
        bound_deg=float(np.rad2deg(np.concatenate(bounds).mean())),
        updates=len(inside),
        inside=float(inside.mean()),
        inside_at_worst=inside_at_worst,
        refused=sum(bool(names) for estimated in estimations for names in estimated.result.refused),
        elapsed_s=elapsed,
    )


def _write(log: logs.Log, estimated: Estimation, configuration: Configuration, out: Path, *, title: str) -> None:
    """Write results, measurements, figure and, last, the summary, which says that the folder is complete."""
    for name in (SUMMARY, MEASURED):
        (out / name).unlink(missing_ok=True)
    estimated.result.write(out / "results.csv")
    summary = estimation.summarize(estimated, configuration)
    measured = Measured(configuration)
    measured.add(log)
    measured.add_left_out(estimated.result)
    finish(estimated.result, summary, configuration, out, "results.csv", title, measured=measured.sensors())
