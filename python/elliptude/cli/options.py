"""Options and refusals that several commands share."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from elliptude.configuration.configuration import Configuration
from elliptude.io.files import FileError

Force: TypeAlias = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
SummaryAsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]
Repair: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Leave out repeated rows, NaN, wrong time stamps and broken lines, and list them: gaps of the gyro.",
    ),
]

# How a reference attitude is read.
TruthConfig: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Configuration whose [truth] says what the reference's columns are.", show_default=False),
]
LargestGap: TypeAlias = Annotated[
    float, typer.Option(min=0.0, help="Interpolate between samples of the reference no further apart, s.")
]
ReferenceErrorDeg: TypeAlias = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        max=180.0,
        help="How far the reference may itself be off, degrees; if left out, truth.error_deg of the configuration.",
        show_default=False,
    ),
]


def with_repair(configuration: Configuration, repair: bool) -> Configuration:
    """The configuration with ``timing.repair``, if the option is given."""
    if not repair:
        return configuration
    timing = configuration.timing.model_copy(update={"repair": True})
    return configuration.model_copy(update={"timing": timing})


def refuse_to_replace(paths: Iterable[Path], force: bool) -> None:
    """Refuse to replace files without --force.

    Raises
    ------
    FileError
        If one of the paths exists; it is named.
    """
    for path in paths:
        if path.exists() and not force:
            raise FileError(f"{path} is there already; --force replaces it")


def reference_error(stated_deg: float | None, configuration: Configuration | None) -> tuple[float, str | None]:
    """How far a reference may itself be off, and who states it.

    Parameters
    ----------
    stated_deg : float, optional
        From an option, which has priority over the configuration.
    configuration : Configuration, optional

    Returns
    -------
    error_deg : float
        Degrees; 0 if nothing states it.
    source : str, optional
        In words; None if nothing states it.
    """
    if stated_deg is not None:
        require_finite("--reference-error-deg", stated_deg)
        return stated_deg, "--reference-error-deg"
    if configuration is not None and configuration.truth is not None:
        return configuration.truth.error_deg, "truth.error_deg of the configuration"
    return 0.0, None


def require_finite(option: str, value: float) -> None:
    """Refuse infinity and NaN as a value of an option."""
    if not math.isfinite(value):
        raise typer.BadParameter("not a finite number", param_hint=option)
