"""Options and refusals that several commands share."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from elliptude.files import FileError

Force: TypeAlias = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
SummaryAsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]

# How a reference attitude is read.
TruthConfig: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Configuration whose [truth] says what the reference's columns are.", show_default=False),
]
LargestGap: TypeAlias = Annotated[
    float, typer.Option(min=0.0, help="Interpolate between samples of the reference no further apart, s.")
]


def refuse_to_replace(paths: Iterable[Path], force: bool) -> None:
    """Nothing is replaced that was not said to be.

    Raises
    ------
    FileError
        If one of the paths exists; it is named.
    """
    for path in paths:
        if path.exists() and not force:
            raise FileError(f"{path} is there already; --force replaces it")


def require_finite(option: str, value: float) -> None:
    """Refuse infinity and what is no number as a value of an option."""
    if not math.isfinite(value):
        raise typer.BadParameter("not a finite number", param_hint=option)
