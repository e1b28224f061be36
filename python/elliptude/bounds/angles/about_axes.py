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
    is_asked: bool = False
    """Whether half-widths are answers to questions of their own, and not those of the sets."""


def about_axes(
    axes: ErrorAxes,
    attitudes: FloatArray,
    shapes: FloatArray,
    chart: Chart,
    half_widths_body: FloatArray,
    errors: FloatArray | None,
    *,
    turns: FloatArray | None = None,
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
    turns : (n, 6) array, optional
        From and to which angle the turn about each of these axes is, rad, if that was asked by itself: half-widths are
        then how far it may be to either side.
    frame : str, optional
        The reference frame: "ENU", "NED" and "NWU" have axes with names.
    heading_from_start : bool
        Whether the heading counts from the first row, so that no horizontal axis is north.

    Returns
    -------
    AboutAxes
    """
    asked = None if turns is None else np.abs(turns).reshape(-1, 3, 2).max(axis=-1)
    if axes == "body":
        half_widths = half_widths_body if asked is None else asked
        return AboutAxes(("x", "y", "z"), "about the body axes", half_widths, errors, asked is not None)
    names = reference_axes(frame, heading_from_start)
    phrase = "about the reference axes" if "Z" in names else f"about {names[0]}, {names[1]} and {names[2]}"
    turned = None if errors is None else np.asarray((attitudes @ errors[..., None])[..., 0])
    # The reference axes in the body's are the rows of Ĉ.
    half_widths = half_widths_along(attitudes, shapes, chart) if asked is None else asked
    return AboutAxes(names, phrase, half_widths, turned, asked is not None)


def reference_axes(frame: str | None, heading_from_start: bool = False) -> tuple[str, str, str]:
    """Names of the axes of a reference frame; without a heading no horizontal one is north."""
    names = _NAMES.get(frame or "", ("X", "Y", "Z"))
    return ("X", "Y", names[2]) if heading_from_start else names


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
