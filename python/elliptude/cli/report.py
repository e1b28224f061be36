"""The commands ``elliptude report`` and ``elliptude view``."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer
from rich.console import Console

from elliptude.bounds.angles.about_axes import ErrorAxes
from elliptude.cli.options import (
    LOG_HELP,
    Force,
    LargestGap,
    ReferenceErrorDeg,
    Repair,
    ShownAxes,
    SummaryAsJson,
    TruthConfig,
    with_repair,
)
from elliptude.cli.outputs import PAGE, RECORDING, require_outputs
from elliptude.cli.progress import steps
from elliptude.configuration.configuration import read_configuration, read_configuration_of_truth
from elliptude.estimation.sizes_in_words import LARGEST_ANGLE, mean_and_most
from elliptude.io.spool import recording
from elliptude.report import comparison
from elliptude.report.estimated.reading import files_of_run, read_run
from elliptude.report.run import Run

Results: TypeAlias = Annotated[
    Path, typer.Argument(help="The folder or the table of results that `estimate` wrote.", show_default=False)
]

OtherReference: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help=f"Reference attitudes: a table with time_s and qw,qx,qy,qz, from body to reference axes; {LOG_HELP}",
        show_default=False,
    ),
]
ReferenceLabel: TypeAlias = Annotated[
    str | None, typer.Option(help="What the reference attitude is called.", show_default=False)
]

_PICTURES = ("angles.png", "bands.png", "size.png", "axes.png", "measured.png")


def make_report(
    result: Results,
    out: Annotated[Path, typer.Option(help="The HTML file.")] = Path("report.html"),
    reference: OtherReference = None,
    config: TruthConfig = None,
    largest_gap_s: LargestGap = 0.0,
    reference_error_deg: ReferenceErrorDeg = None,
    label: ReferenceLabel = None,
    pictures: Annotated[
        Path | None,
        typer.Option(help="Folder for the same pictures as PNG; created if missing.", show_default=False),
    ] = None,
    title: Annotated[
        str | None, typer.Option(help="Title of the page; the name of the recording if left out.", show_default=False)
    ] = None,
    axes: ShownAxes = "reference",
    as_json: SummaryAsJson = False,
    force: Force = False,
) -> None:
    """Make an interactive report of a result: one HTML file that any browser shows without a network.

    Sets over time, errors in their bounds, measurements left out, and where the body's axes may point.
    """
    files = [out] + [pictures / name for name in _PICTURES] if pictures is not None else [out]
    read = [*files_of_run(result), reference, config]
    require_outputs(files, force=force, folder=pictures, read=read, endings={out: PAGE})
    if reference is None:
        _require_none_of_reference("--config", config, reference_error_deg)
    with steps(Console(stderr=True), 2 if pictures is None else 3) as step:
        step("Reading")
        run, read_label = _read(result, axes)
        if reference is not None:
            run, read_label = _against(run, reference, config, largest_gap_s, reference_error_deg)
        label, title = label or read_label, title or _title(run, result)
        step("Writing the page")
        from elliptude.report import page  # imports Matplotlib, which would slow every command

        summary = page.write_report(run, out, title, label=label)
        if pictures is not None:
            step("Drawing")
            pictures.mkdir(parents=True, exist_ok=True)
            files = [out, *_write_pictures(run, pictures, title, label)]
    if as_json:
        typer.echo(json.dumps(summary | {"report": str(out)}, indent=2, ensure_ascii=False))
        return
    typer.echo(f"{result}: {_in_words(summary)}")
    for file in files:
        typer.echo(f"  {file}")


def view(
    result: Results,
    out: Annotated[
        Path | None,
        typer.Option(help="Write a recording for Rerun, .rrd, instead of opening its viewer.", show_default=False),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            help=f"The log that the results are of: show the measured directions within their bounds, too; {LOG_HELP}",
            show_default=False,
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="The configuration that the results are of.", show_default=False)
    ] = None,
    repair: Repair = False,
    reference: OtherReference = None,
    reference_config: TruthConfig = None,
    largest_gap_s: LargestGap = 0.0,
    reference_error_deg: ReferenceErrorDeg = None,
    label: ReferenceLabel = None,
    axes: ShownAxes = "reference",
    force: Force = False,
) -> None:
    """Show a result in Rerun, to go through it in time: the body's axes, where they may point, bounds and claims.

    The viewer stays open when the command ends. It is in the package's extra `rerun`. The truth that `estimate` found
    is shown, or another attitude (--reference), or none.
    """
    if out is not None:
        read = [*files_of_run(result), log, config, reference, reference_config]
        require_outputs([out], force=force, read=read, endings={out: RECORDING})
    if (log is None) != (config is None):
        raise typer.BadParameter("belong together: give both, or none", param_hint="--log and --config")
    if reference is None:
        _require_none_of_reference("--reference-config", reference_config, reference_error_deg)
    from elliptude import view as views  # imports Matplotlib, which would slow every command

    views.sdk()
    run, read_label = _read(result, axes)
    measured = None
    if reference is not None:
        run, read_label = _against(run, reference, reference_config, largest_gap_s, reference_error_deg)
    if log is not None and config is not None:
        configuration = with_repair(read_configuration(config), repair)
        measured = views.measured_directions(recording(log), configuration, run)
    label, title = label or read_label, _title(run, result)
    if out is None:
        drawn = views.show(run, title, label=label, measured=measured)
    else:
        drawn = views.write_view(run, out, title, label=label, measured=measured)
    typer.echo(f"{result}: {views.in_words(drawn)}")
    if out is not None:
        typer.echo(f"  {out}")


def _read(result: Path, axes: ErrorAxes) -> tuple[Run, str]:
    """The run, and what it is compared with; what of it cannot be shown is said."""
    run, label = read_run(result)
    if run.why_not_measured is not None:
        typer.secho(run.why_not_measured, fg=typer.colors.YELLOW, err=True)
    return replace(run, axes=axes), label


def _require_none_of_reference(option: str, config: Path | None, error_deg: float | None) -> None:
    """Raise if an option that is of a --reference is given without one."""
    if config is not None:
        raise typer.BadParameter("says what the columns of a --reference are", param_hint=option)
    if error_deg is not None:
        raise typer.BadParameter("is of a --reference", param_hint="--reference-error-deg")


def _against(
    run: Run, reference: Path, config: Path | None, largest_gap_s: float, error_deg: float | None
) -> tuple[Run, str]:
    """The run compared with a reference, and what that is called."""
    file, error = recording(reference), None if error_deg is None else math.radians(error_deg)
    configuration = None if config is None else read_configuration_of_truth(config)
    compared = comparison.run_against(run, file, configuration, largest_gap=largest_gap_s, reference_error=error)
    return compared, file.name


def _title(run: Run, result: Path) -> str:
    """What the estimation's pictures have, the recording's name; else that of the folder, or of the table with it."""
    if run.title is not None:
        return run.title
    resolved = result.resolve()
    return resolved.name if resolved.is_dir() else f"{resolved.parent.name}/{resolved.name}"


def _write_pictures(run: Run, folder: Path, title: str, label: str) -> list[Path]:
    """The files that were written: roll, pitch and yaw, and measurements, only where the result has them."""
    from elliptude.report import figures, run_figures
    from elliptude.report.axes.figure import axes_figure
    from elliptude.report.estimated import drawn as measured

    drawn = {
        "bands.png": run_figures.bands_figure(run, title, label=label),
        "size.png": run_figures.size_figure(run, title),
        "axes.png": axes_figure(run, title, label=label),
    }
    if run.roll_pitch_yaw is not None:
        drawn = {"angles.png": run_figures.angles_figure(run, title, label=label)} | drawn
    if run.measured:
        drawn["measured.png"] = measured.measured_figure(run, title)
    for name, figure in drawn.items():
        figures.save(figure, folder / name)
    return [folder / name for name in drawn]


def _in_words(summary: dict[str, Any]) -> str:
    words = f"{summary['rows']} rows"
    if (size := summary["largest_angle_deg"]) is not None:
        words += f", {LARGEST_ANGLE} {mean_and_most(size['mean'], size['largest'])} degrees: mean (at most)"
    if summary["compared_with"] is not None:
        words += (
            f"; {summary['compared_with']} outside the set at {summary['escapes']} of {summary['rows_compared']} rows"
        )
    return words
