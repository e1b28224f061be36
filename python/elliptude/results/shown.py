"""How results show themselves: in one line, and as small plots in notebooks; and whether two are equal."""

from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.results.claims import CLAIMS
from elliptude.typing import FloatArray

# Pieces of rows of a small plot, and its size in px.
_PIECES, _PANEL_WIDTH, _PANEL_HEIGHT = 300, 600, 90


def equal(one: tuple[Any, ...], other: object) -> bool:
    """Whether two results of one kind have equal arrays; NaN is equal to NaN. Tuples of arrays cannot say so."""
    if type(other) is not type(one):
        return False
    assert isinstance(other, tuple)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


def span(name: str, times: FloatArray, claims: NDArray[np.uint8] | None = None) -> str:
    """A log of rows in one line."""
    said = f"{name}: {len(times)} rows"
    if len(times):
        said += f", {times[0]:.6g} to {times[-1]:.6g} s"
    if claims is None or not len(claims):
        return f"<{said}>"
    shares = [f"{claim} {100.0 * float(np.mean(claims == i)):.3g} %" for i, claim in enumerate(CLAIMS)]
    return f"<{said}; claims: {', '.join(shares)}>"


def panel(name: str, least: FloatArray, most: FloatArray, angle: FloatArray) -> str:
    """A band between the least and the most of each piece of rows, and the angle, all in degrees, as SVG."""
    starts = np.arange(0, len(angle), -(-len(angle) // _PIECES))
    least, most, angle = np.fmin.reduceat(least, starts), np.fmax.reduceat(most, starts), angle[starts]
    low, high = np.nanmin(least, initial=0.0), np.nanmax(most, initial=0.0)
    across, height = _PANEL_WIDTH / len(starts), _PANEL_HEIGHT / max(high - low, 1.0)
    known = np.flatnonzero(np.isfinite(least) & np.isfinite(most))
    bars = "".join(
        f'<rect x="{across * k:.1f}" y="{height * (high - most[k]):.1f}" width="{across + 0.1:.1f}" '
        f'height="{max(height * (most[k] - least[k]), 0.5):.1f}"/>'
        for k in known
    )
    dots = "".join(
        f'<rect x="{across * k:.1f}" y="{height * (high - angle[k]) - 0.6:.1f}" width="{across + 0.1:.1f}" '
        'height="1.2"/>'
        for k in np.flatnonzero(np.isfinite(angle))
    )
    return (
        f'<p style="margin:4px 0 0">{name}, {low:.0f}° to {high:.0f}°</p><svg viewBox="0 0 {_PANEL_WIDTH} '
        f'{_PANEL_HEIGHT}" style="width:100%;max-width:{_PANEL_WIDTH}px" role="img" aria-label="{name} over time">'
        f'<g fill="#0072B2" fill-opacity="0.3">{bars}</g><g fill="currentColor">{dots}</g></svg>'
    )


def pictured(line: str, angles: FloatArray) -> str:
    """A log for notebooks: its line, and how far the attitude may be off in each row, rad."""
    said = f"<p>{escape(line)}</p>"
    if not np.isfinite(angles).any():
        return f"<div>{said}</div>"
    degrees = np.rad2deg(angles)
    return f"<div>{said}{panel('largest angle', np.where(np.isnan(degrees), np.nan, 0.0), degrees, degrees)}</div>"
