"""What commands write: whether they can, before they work, and what `estimate` and `demo` write and show alike."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table

from elliptude.bounds.angles.about_axes import ErrorAxes
from elliptude.configuration.configuration import Configuration
from elliptude.io.files import FileError, require_writable, write_json
from elliptude.io.tables import Result
from elliptude.report.estimated.stored import MEASURED, MeasuredSensor, write_measured

PAGE = (".html", ".htm")
"""What the names of pages end in."""
RECORDING = (".rrd",)
"""What the names of recordings for Rerun end in."""
CONFIGURATION = (".toml",)
"""What the names of configurations, rules and calibrations end in."""
FIGURE, SUMMARY = "estimate.png", "summary.json"
# Wider than any table.
_WIDE = 1000


def require_outputs(
    files: Iterable[Path],
    *,
    force: bool,
    folder: Path | None = None,
    read: Iterable[Path | None] = (),
    endings: Mapping[Path | None, Sequence[str]] | None = None,
) -> None:
    """Refuse what a command could not write in the end, before it works.

    Parameters
    ----------
    files : iterable of pathlib.Path
    force : bool
        Whether files that are there may be replaced.
    folder : pathlib.Path, optional
        It is made if it is missing; that of any other file must be there.
    read : iterable of pathlib.Path or None
        What the command reads, which no output may replace; None is not given.
    endings : mapping, optional
        What the names of some of the files must end in, one of these.

    Raises
    ------
    FileError
        If a file cannot be written, is there and must not be replaced, is what the command reads, comes twice, or has a
        name of another ending.
    """
    needed = {path.resolve(): path for path in read if path is not None}
    written = set[Path]()
    for file in files:
        place = file.resolve()
        if place in needed:
            raise FileError(f"{file}: not written: it is what the command reads; give the output another name")
        if place in written:
            raise FileError(f"{file}: not written: two outputs have this name; give one of them another")
        written.add(place)
        ending = (endings or {}).get(file, ())
        if ending and file.suffix.lower() not in ending:
            raise FileError(f"{file}: not written: its name must end in {' or '.join(ending)}")
        require_writable(file, makes_folders=folder is not None and file.parent.absolute() == folder.absolute())
        if file.exists() and not force:
            raise FileError(f"{file} is there already; --force replaces it")


def print_table(table: Table) -> None:
    """Print a table as wide as the terminal, or as wide as it must be: cells that end in "..." are useless."""
    for column in table.columns:
        if column.no_wrap:
            lines = "\n".join(map(str, (column.header, *column.cells))).split("\n")
            column.min_width = max(map(cell_len, lines))
    least = Console(width=_WIDE).measure(table).minimum
    Console(width=max(Console().width, least)).print(table)


def finish(
    drawn: Result,
    summary: dict[str, Any],
    configuration: Configuration,
    out: Path,
    table: str,
    title: str,
    inside_share: float | None = None,
    axes: ErrorAxes = "reference",
    measured: Sequence[MeasuredSensor] = (),
    gaps: Sequence[tuple[float, float]] = (),
) -> dict[str, Any]:
    """Write what was measured, draw the figure, and write the summary, last: it says that the folder is complete."""
    from elliptude.report import figures
    from elliptude.report.estimated import picture

    write_measured(out / MEASURED, measured, out / table, drawn.origin)
    label = configuration.truth.label if configuration.truth is not None else "truth"
    figure = picture.estimate_figure(
        drawn,
        title,
        label=label,
        inside_share=inside_share,
        axes=axes,
        frame=configuration.frame,
        heading_from_start=summary.get("heading") == "from the first row",
        proposed_from=configuration.proposed_from,
        measured=measured,
        gaps=gaps,
    )
    figures.save(figure, out / FIGURE)
    summary |= {"title": title, "results": table, "figure": FIGURE}
    write_json(out / SUMMARY, summary)
    return summary
