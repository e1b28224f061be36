"""Attitude errors and how far they reach, about the reference axes or about those of the body; arrays in and out.

The error ζ of C = Ĉ exp(S(ζ)) is a turn in body axes; C = exp(S(Ĉζ)) Ĉ is the same one in reference axes. If the body
turns, what is known well and what is not wanders through its axes, while north and up stay where they are.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elliptude.typing import Chart, FloatArray

ErrorAxes: TypeAlias = Literal["reference", "body"]
"""About which axes attitude errors are shown."""

_NAMES = {
    "ENU": ("east", "north", "up"),
    "NED": ("north", "east", "down"),
    "NWU": ("north", "west", "up"),
}


@dataclass(frozen=True, eq=False)
class AboutAxes:
    """Attitude errors of n rows and their bounds, about three axes."""

    names: tuple[str, str, str]
    """"east", or "X" for an axis without a name; "x" is the body's."""
    phrase: str
    """All three, as in "about the reference axes"."""
    half_widths: FloatArray
    """How far errors reach, rad, NaN without a set, shape (n, 3)."""
    errors: FloatArray | None
    """Errors that are known, rad, NaN where they are not, shape (n, 3); None without any."""


def about_axes(
    axes: ErrorAxes,
    attitudes: FloatArray,
    shapes: FloatArray,
    chart: Chart,
    half_widths_body: FloatArray,
    errors: FloatArray | None,
    *,
    frame: str | None = None,
    heading_from_start: bool = False,
) -> AboutAxes:
    """Attitude errors and their bounds, about the axes that are wanted.

    Parameters
    ----------
    axes : {"reference", "body"}
    attitudes : (n, 3, 3) array
        Centers Ĉ of the sets, from body to reference axes.
    shapes : (n, 3, 3) array
        P of the attitude error, rad².
    chart : {"exponential", "gibbs"}
        The coordinates of the error whose shape P is.
    half_widths_body : (n, 3) array
        rad.
    errors : (n, 3) array, optional
        ζ, rad, body axes.
    frame : str, optional
        The reference frame: "ENU", "NED" and "NWU" have axes with names.
    heading_from_start : bool
        Whether the heading counts from the first row, so that no horizontal axis is north.

    Returns
    -------
    AboutAxes
    """
    if axes == "body":
        return AboutAxes(("x", "y", "z"), "about the body axes", half_widths_body, errors)
    names = _NAMES.get(frame or "", ("X", "Y", "Z"))
    if heading_from_start:
        names = ("X", "Y", names[2])
    phrase = "about the reference axes" if "Z" in names else f"about {names[0]}, {names[1]} and {names[2]}"
    turned = None if errors is None else np.asarray((attitudes @ errors[..., None])[..., 0])
    # The reference axes in the body's are the rows of Ĉ.
    return AboutAxes(names, phrase, half_widths_along(attitudes, shapes, chart), turned)


def half_widths_along(directions: FloatArray, shapes: FloatArray, chart: Chart) -> FloatArray:
    """How far attitude errors reach along directions: no ζ of the set has a larger component (theory, 16.4).

    Parameters
    ----------
    directions : (n, m, 3) array
        Unit vectors u, body axes.
    shapes : (n, 3, 3) array
        P of the attitude error, rad².
    chart : {"exponential", "gibbs"}
        Whether P is of ζ or of γ = 2 tan(θ/2) n.

    Returns
    -------
    (n, m) array
        √(uᵀPu), of γ as the angle 2 atan(√(uᵀPu)/2); rad, NaN where anything is.
    """
    squares = ((directions @ shapes) * directions).sum(axis=-1)
    reach = np.sqrt(np.maximum(squares, 0.0))
    return np.asarray(reach if chart == "exponential" else 2.0 * np.arctan(0.5 * reach))
