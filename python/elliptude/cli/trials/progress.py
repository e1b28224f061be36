"""A progress bar with the time left, for work of minutes or days."""

from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn, TimeRemainingColumn


def progress_with_time_left(console: Console) -> Progress:
    """Share done, time gone and time left, only on a terminal; it disappears at the end."""
    columns = (*Progress.get_default_columns()[:3], TimeElapsedColumn(), TimeRemainingColumn())
    # The speed is that of the last minutes: pieces differ in length.
    return Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal, speed_estimate_period=300.0
    )
