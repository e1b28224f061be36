"""Options that several commands share, and what numbers they may be."""

from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

from elliptude.bounds.angles.about_axes import ErrorAxes
from elliptude.configuration.configuration import Configuration

# Between two samples a day apart nothing is known.
_LONGEST_GAP_S = 86_400.0


def quantity(text: str, *, least: float = 0.0, greatest: float, **more: Any) -> Any:
    """An option that is a number from ``least`` to ``greatest``; help and messages say both.

    Parameters
    ----------
    text : str
        The help, with the unit.
    least, greatest : float
    **more
        What else `typer.Option` takes.

    Returns
    -------
    typer.models.OptionInfo
    """

    def checked(value: float | list[float] | None) -> float | list[float] | None:
        for one in value if isinstance(value, list) else [value]:
            if one is not None and not least <= one <= greatest:  # NaN fails, too
                raise typer.BadParameter(f"{one:g} is not from {least:g} to {greatest:g}")
        return value

    return typer.Option(help=f"{text} From {least:g} to {greatest:g}.", callback=checked, **more)


LOG_HELP = "- is standard input, and a named pipe is read, too."
"""What the help of each argument that names a recording ends with."""

Force: TypeAlias = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
SummaryAsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]
Repair: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Leave out repeated rows, NaN, wrong time stamps and broken lines, and list them: gaps of the gyro.",
    ),
]

ShownAxes: TypeAlias = Annotated[
    ErrorAxes,
    typer.Option(
        "--axes", help="About which axes pictures show attitude errors and half-widths: the reference's or the body's."
    ),
]

# How a reference attitude is read.
TruthConfig: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Configuration whose section truth says what the reference's columns are.", show_default=False),
]
LargestGap: TypeAlias = Annotated[
    float, quantity("Interpolate between samples of the reference no further apart, s.", greatest=_LONGEST_GAP_S)
]
EstimateLargestGap: TypeAlias = Annotated[
    float, quantity("Interpolate between samples of the estimate no further apart, s.", greatest=_LONGEST_GAP_S)
]
ReferenceErrorDeg: TypeAlias = Annotated[
    float | None,
    quantity(
        "How far the reference may itself be off, degrees; if left out, truth.error_deg of the configuration.",
        greatest=180.0,
        show_default=False,
    ),
]


def with_repair(configuration: Configuration, repair: bool) -> Configuration:
    """The configuration with ``timing.repair``, if the option is given."""
    if not repair:
        return configuration
    if configuration.timing.row_rate_hz is not None:
        raise typer.BadParameter(
            "a repair leaves rows out, and times that are counted by rows ([timing] row_rate_hz) would be wrong",
            param_hint="--repair",
        )
    timing = configuration.timing.model_copy(update={"repair": True})
    return configuration.model_copy(update={"timing": timing})


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
        return stated_deg, "--reference-error-deg"
    if configuration is not None and configuration.truth is not None:
        return configuration.truth.error_deg, "truth.error_deg of the configuration"
    return 0.0, None
