"""How far a command is: a bar on a terminal; elsewhere, as in a file or a pipe, a plain line now and then."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

FIRST_LINE_S = 2.0
"""Work that is done earlier says nothing without a terminal."""
LONGEST_WAIT_S = 60.0
"""From one line to the next; the first waits are shorter, each twice the one before."""


def progress_on(console: Console, completed: str = "{task.percentage:>3.0f} %") -> Progress:
    """How much is done, and for how long; a bar disappears at the end.

    Parameters
    ----------
    console : rich.console.Console
    completed : str
        What is said of how much is done, as rich's columns have it.

    Returns
    -------
    rich.progress.Progress
    """
    return _made(console, [TextColumn("{task.description}"), BarColumn(), TextColumn(completed), TimeElapsedColumn()])


def progress_with_time_left(console: Console) -> Progress:
    """Share done, time gone and time left, for work of minutes or days; a bar disappears at the end."""
    columns = [TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()]
    # The speed is that of the last minutes: pieces differ in length.
    return _made(console, [*columns, TimeElapsedColumn(), TimeRemainingColumn()], speed_estimate_period=300.0)


@contextmanager
def steps(console: Console, total: int) -> Iterator[Callable[[str], None]]:
    """How many steps of a command are done, and the time left; a bar disappears at the end.

    Parameters
    ----------
    console : rich.console.Console
    total : int
        Steps, which take alike long as far as is known.

    Yields
    ------
    callable
        To be called with what the next step does, when it begins.
    """
    with progress_with_time_left(console) as progress:
        task = progress.add_task("", total=total, visible=False)
        begun = 0

        def step(what: str) -> None:
            nonlocal begun
            begun += 1
            said = f"{what} (step {begun} of {total})" if total > 1 else what
            progress.update(task, description=said, completed=begun - 1, visible=True)

        yield step
        progress.update(task, completed=total)


def _made(console: Console, columns: list[ProgressColumn], speed_estimate_period: float = 30.0) -> Progress:
    kind = Progress if console.is_terminal else _Lines
    return kind(*columns, console=console, transient=True, speed_estimate_period=speed_estimate_period)


class _Lines(Progress):
    """Progress in lines: a clock of its own writes them, since a step of the work may take longer than the wait."""

    def __init__(self, *columns: ProgressColumn, **settings: object) -> None:
        super().__init__(*columns, disable=True, **settings)  # type: ignore[arg-type]
        self._ended = threading.Event()
        self._clock: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._ended.clear()
        self._clock = threading.Thread(target=self._write_lines, name="progress", daemon=True)
        self._clock.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        if self._clock is not None:
            self._clock.join()

    def _write_lines(self) -> None:
        begin, wait = time.monotonic(), FIRST_LINE_S
        while not self._ended.wait(wait):
            for line in self._in_words(time.monotonic() - begin):
                self.console.print(line, markup=False, highlight=False, soft_wrap=True)
            wait = min(2.0 * wait, LONGEST_WAIT_S)

    def _in_words(self, elapsed: float) -> list[str]:
        """A line for each task that is not done."""
        lines = []
        for task in self.tasks:
            if task.finished:
                continue
            texts = [column(task) for column in self.columns if isinstance(column, TextColumn)]
            line = " ".join(" ".join(str(text).split()) for text in texts if str(text).strip())
            line += f", {_time(elapsed)} so far"
            if any(isinstance(one, TimeRemainingColumn) for one in self.columns) and task.time_remaining is not None:
                line += f", {_time(task.time_remaining)} left"
            lines.append(line)
        return lines


def _time(seconds: float) -> str:
    """A duration, as in "42 s" or "1:02:03"."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours}:{minutes:02}:{left:02}" if hours else f"{minutes}:{left:02}"
