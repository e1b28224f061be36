"""What `estimate` and `demo` write and show alike."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from elliptude.configuration.configuration import Configuration
from elliptude.io.files import write_json
from elliptude.io.tables import Result

FIGURE, SUMMARY = "estimate.png", "summary.json"


def finish(
    drawn: Result,
    summary: dict[str, Any],
    configuration: Configuration,
    out: Path,
    table: str,
    title: str,
    inside_share: float | None = None,
) -> dict[str, Any]:
    """Draw the figure and write the summary, last: it says that the folder is complete."""
    from elliptude.report import figures

    label = configuration.truth.label if configuration.truth is not None else "truth"
    figure = figures.estimate_figure(drawn, title, label=label, inside_share=inside_share)
    figures.save(figure, out / FIGURE)
    summary |= {"results": table, "figure": FIGURE}
    write_json(out / SUMMARY, summary)
    return summary


def progress_on(console: Console, completed: str = "{task.percentage:>3.0f} %") -> Progress:
    """A progress bar, only on a terminal; it disappears at the end."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(completed),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
