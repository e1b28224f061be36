"""Work in pieces that goes on where it was interrupted: what is done is kept in a file beside the results."""

import json
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from rich.console import Console

from elliptude.campaigns import engine
from elliptude.campaigns.pieces import Piece
from elliptude.cli.progress import progress_with_time_left
from elliptude.io.files import FileError, write_json

PROGRESS = "progress.json"
# Time between two saves of the progress, s.
_KEEP_AFTER = 0.5


def begun(file: Path, arguments: dict[str, Any], names: set[str], *, force: bool) -> dict[str, Any]:
    """The results of an earlier run with the same arguments, by the names of pieces.

    Raises
    ------
    FileError
        If the file is of something else, and nobody says to start over.
    """
    if force or not file.exists():
        return {}
    try:
        kept = json.loads(file.read_text(encoding="utf-8"))
        same, done = kept["arguments"] == arguments, kept["done"]
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(f"{file} is not a validation's; --force starts over") from error
    if not same:
        raise FileError(f"{file} is of a validation with other arguments; --force starts over")
    return {name: result for name, result in done.items() if name in names}


def run(
    function: Callable[..., Any],
    pieces: Sequence[Piece],
    done: dict[str, Any],
    arguments: dict[str, Any],
    file: Path,
    processes: int | None,
    console: Console,
) -> None:
    """Do what is not done; however it ends, the file keeps the results, which are added to those that are done."""
    left = [piece for piece in pieces if piece.name not in done]
    results = engine.results(function, left, processes=processes)

    def keep() -> None:
        write_json(file, {"arguments": arguments, "done": done})

    kept = time.monotonic()
    with progress_with_time_left(console) as progress, closing(results):
        task = progress.add_task("Validating", total=len(pieces), completed=len(done))
        try:
            for name, result in results:
                done[name] = result
                progress.advance(task)
                if time.monotonic() > kept + _KEEP_AFTER:
                    keep()
                    kept = time.monotonic()
        finally:
            keep()
