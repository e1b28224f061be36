"""The sphere of the interactive report, with the directions that body axes may have, and what moves on it."""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.report.axes.body_axes import axis_patches
from elliptude.report.curves import plot_layout
from elliptude.report.run import Run
from elliptude.report.run_figures import AXIS_COLOURS, claim_label, time_text
from elliptude.typing import FloatArray

FRAMES = 240
"""How many times the sphere is drawn at."""

MERIDIANS, RINGS = 36, 4
"""Directions on each ring of a patch, and its rings."""
_LARGEST = np.deg2rad(60.0)
"""The largest errors of a set that is drawn: patches, flat between their rings, would cut through the globe."""
# On a phone they must still be letters; beside an axis and above it, so that they do not hide one another.
_NAME_SIZE, _TIP_SIZE = 20, 34
_INT16 = 32767
_NOT_KNOWN = -32768
_NOTHING: dict[str, list[float | None]] = {"x": [None], "y": [None], "z": [None]}


@dataclass(frozen=True, eq=False)
class Frames:
    """What moves on the sphere, at n times; NaN where it is not known."""

    tips: FloatArray
    """Where the body's x, y and z axis are estimated to point, in reference axes, shape (n, 3, 3)."""
    patches: FloatArray
    """Where each may point, from the rim to the middle, (n, 3, RINGS, MERIDIANS, 3); also NaN if too large to draw."""
    marks: FloatArray | None
    """Where the reference's axes point, shape (n, 3, 3); None without a reference."""

    @property
    def drawn(self) -> list[bool]:
        """At which times all patches are drawn."""
        return [bool(np.isfinite(patches).all()) for patches in self.patches]


def frame_rows(run: Run, most: int = FRAMES) -> NDArray[np.intp]:
    """Rows evenly in time, the one with the largest set, and the one whose reference is farthest out."""
    wanted = np.linspace(run.times[0], run.times[-1], most)
    after = np.searchsorted(run.times, wanted).clip(max=len(run.times) - 1)
    before = np.maximum(after - 1, 0)
    rows = np.where(wanted - run.times[before] < run.times[after] - wanted, before, after).tolist()
    for score in (run.largest_angles, run.forms):
        if score is not None and np.isfinite(score).any():
            rows.append(int(np.nanargmax(score)))
    return np.unique(rows)


def frames_of(run: Run, rows: NDArray[np.intp], magnification: int, largest: float = _LARGEST) -> Frames:
    """The sphere at some rows.

    Parameters
    ----------
    run : Run
    rows : (n,) array
    magnification : int
        How many times as large as they are sets are drawn, with the errors in them.
    largest : float
        The largest errors of a set that is drawn, rad, as it is drawn.

    Returns
    -------
    Frames
    """
    attitudes = run.attitudes[rows]
    attitudes[~run.known[rows]] = np.nan
    shapes = magnification**2 * run.shapes[rows]
    patches = np.stack(
        [axis_patches(attitudes, shapes, i, chart=run.chart, meridians=MERIDIANS, rings=RINGS) for i in range(3)],
        axis=1,
    )
    patches[magnification * run.largest_angles[rows] > largest] = np.nan
    marks = run.true_axes(magnification)[rows].swapaxes(1, 2) if run.compared.any() else None
    return Frames(attitudes.swapaxes(1, 2), patches, marks)


def sphere_frames(run: Run, rows: NDArray[np.intp]) -> dict[str, Any]:
    """What moves on the sphere."""
    frames = frames_of(run, rows, run.magnification(rows))
    return {
        "vertices": RINGS * MERIDIANS,
        "meridians": MERIDIANS,
        "patches": _packed(frames.patches),
        "tips": _packed(frames.tips),
        "marks": None if frames.marks is None else _packed(frames.marks),
        "times": run.times[rows].tolist(),
        "opens_at": _opening(run.known[rows], np.array(frames.drawn)),
        "labels": [frame_label(run, int(row), is_drawn) for row, is_drawn in zip(rows, frames.drawn, strict=True)],
        "patch_traces": [_STILL, _STILL + 1, _STILL + 2],
        "rim_traces": [_STILL + 3, _STILL + 4, _STILL + 5],
        "tip_traces": [_STILL + 6, _STILL + 7, _STILL + 8],
        "mark_trace": _STILL + 9,
    }


def _opening(known: NDArray[np.bool_], drawn: NDArray[np.bool_]) -> int:
    """The first time at which there is something to see: patches, or an attitude at least."""
    return int(np.argmax(drawn if drawn.any() else known))


def frame_label(run: Run, row: int, is_drawn: bool) -> str:
    """The time of a row, and in words how far its attitude may be off and what that rests on."""
    parts = [f"{time_text(run, row)} s"]
    if not run.known[row]:
        if run.up_bounds is not None and np.isfinite(run.up_bounds[row]):
            return f"{parts[0]}: no attitude is known, up within {np.rad2deg(run.up_bounds[row]):.3g}°"
        return f"{parts[0]}: nothing is known"
    parts.append(f"within {np.rad2deg(run.largest_angles[row]):.3g}°")
    if not is_drawn:
        parts.append("too large to draw")
    if run.tilt_bounds is not None and np.isfinite(run.tilt_bounds[row]):
        of_up = f"up within {np.rad2deg(run.tilt_bounds[row]):.3g}°"
        if run.up_claims is not None and run.claims is not None and run.up_claims[row] != run.claims[row]:
            of_up += f" ({claim_label(run.up_claims[row], run.bounds_from_recording)})"
        parts.append(of_up)
    if run.claims is not None and run.claims[row]:
        parts.append(f"claim: {claim_label(run.claims[row], run.bounds_from_recording)}")
    if run.compared[row]:
        assert run.errors is not None
        where = "OUTSIDE" if run.escaped[row] else "inside"
        parts.append(f"reference {np.rad2deg(np.linalg.norm(run.errors[row])):.3g}° off, {where}")
    return ", ".join(parts)


def _packed(directions: FloatArray) -> str:
    """Components from -1 to 1 as 16-bit numbers: to 3e-5, which is 0.002 degrees."""
    known = np.isfinite(directions)
    numbers = np.where(known, np.rint(np.where(known, directions, 0.0) * _INT16), _NOT_KNOWN)
    return base64.b64encode(numbers.astype("<i2").tobytes()).decode("ascii")


def triangles() -> tuple[list[int], list[int], list[int]]:
    """The triangles of a patch by their three corners; the last ring is a point."""
    i, j, k = [], [], []
    for ring in range(RINGS - 1):
        for one in range(MERIDIANS):
            other = (one + 1) % MERIDIANS
            a, b = ring * MERIDIANS + one, ring * MERIDIANS + other
            c, d = a + MERIDIANS, b + MERIDIANS
            i += [a, b]
            j += [b, d]
            k += [c, c]
    return i, j, k


def _globe() -> dict[str, Any]:
    """The sphere of directions, slightly smaller than the patches, which are flat between their vertices."""
    latitudes, longitudes = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 25), np.linspace(0.0, 2.0 * np.pi, 49)
    across = np.cos(latitudes)[:, None]
    sphere = 0.98 * np.stack(
        [
            across * np.cos(longitudes),
            across * np.sin(longitudes),
            np.broadcast_to(np.sin(latitudes)[:, None], (25, 49)),
        ]
    )
    x, y, z = (np.round(component, 4).tolist() for component in sphere)
    return {
        "type": "surface",
        "x": x,
        "y": y,
        "z": z,
        "showscale": False,
        "colorscale": [[0, "#d8dbe0"], [1, "#d8dbe0"]],
        "hoverinfo": "skip",
        "contours": {name: {"highlight": False} for name in "xyz"},
        "opacity": 0.6,
        "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0},
    }


def _circles() -> dict[str, Any]:
    """The circles in which the planes of the reference axes meet the sphere, and these axes."""
    angles = np.linspace(0.0, 2.0 * np.pi, 73)
    points: list[list[float | None]] = []
    for normal in range(3):
        circle = np.zeros((73, 3))
        circle[:, (normal + 1) % 3], circle[:, (normal + 2) % 3] = 0.99 * np.cos(angles), 0.99 * np.sin(angles)
        tip = 1.2 * np.eye(3)[normal]
        points += [*np.round(circle, 4).tolist(), [None] * 3, [0.0] * 3, tip.tolist(), [None] * 3]
    x, y, z = (list(column) for column in zip(*points, strict=True))
    return {
        "type": "scatter3d",
        "mode": "lines",
        "x": x,
        "y": y,
        "z": z,
        "line": {"color": "#8a8f98", "width": 1.5},
        "hoverinfo": "skip",
    }


_STILL = 3
"""Traces that do not move: the globe, its circles, the names of the reference axes."""


def sphere_plot(compares: bool, label: str) -> dict[str, Any]:
    """Plotly's data and layout."""
    names = {
        "type": "scatter3d",
        "mode": "text",
        **{axis: [1.3 * float(tip) for tip in row] for axis, row in zip("xyz", np.eye(3), strict=True)},
        "text": ["X", "Y", "Z"],
        "textfont": {"size": _NAME_SIZE},
        "textposition": "middle left",
        "hoverinfo": "skip",
    }
    axes = list(zip("xyz", AXIS_COLOURS, strict=True))
    traces: list[dict[str, Any]] = [_globe(), _circles(), names]
    traces += [_patch(axis, colour) for axis, colour in axes]
    traces += [_rim(axis, colour) for axis, colour in axes]
    traces += [_estimate(axis, colour) for axis, colour in axes]
    if compares:
        traces.append(
            {
                "type": "scatter3d",
                "mode": "markers",
                "name": label,
                **_NOTHING,
                "marker": {"size": 4},
                "meta": "ink",
                "hoverinfo": "name",
            }
        )
    hidden = {"visible": False, "range": [-1.35, 1.35]}
    layout = plot_layout(
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        showlegend=False,
        hovermode="closest",
        scene={
            "xaxis": hidden,
            "yaxis": hidden,
            "zaxis": hidden,
            "aspectmode": "manual",
            "aspectratio": {"x": 1.7, "y": 1.7, "z": 1.7},
            "camera": {"eye": {"x": 1.15, "y": 0.8, "z": 0.65}, "projection": {"type": "orthographic"}},
            "dragmode": "orbit",
        },
        uirevision="kept",
    )
    return {"data": traces, "layout": layout}


def _patch(axis: str, colour: str) -> dict[str, Any]:
    """Where a body axis may point."""
    i, j, k = triangles()
    return {
        "type": "mesh3d",
        "name": f"body {axis}",
        **{name: [0.0] * (RINGS * MERIDIANS) for name in "xyz"},
        "i": i,
        "j": j,
        "k": k,
        "color": colour,
        "flatshading": True,
        "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0},
        "hoverinfo": "name",
    }


def _rim(axis: str, colour: str) -> dict[str, Any]:
    """The edge of that patch."""
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": f"rim of body {axis}",
        **_NOTHING,
        "line": {"color": colour, "width": 4},
        "hoverinfo": "skip",
    }


def _estimate(axis: str, colour: str) -> dict[str, Any]:
    """Where a body axis is estimated to point."""
    return {
        "type": "scatter3d",
        "mode": "lines+text",
        "name": f"estimated body {axis}",
        **_NOTHING,
        "text": ["", axis],
        "textfont": {"color": colour, "size": _TIP_SIZE},
        "textposition": "top center",
        "line": {"color": colour, "width": 5},
        "hoverinfo": "name",
    }
