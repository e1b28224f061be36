"""The picture of where the body's axes may point, at some times; as PNG."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from elliptude.report.axes.body_axes import axis_patches
from elliptude.report.figures import BLACK, GREY, entitle, legend_below, new_figure
from elliptude.report.run import Run
from elliptude.report.run_figures import AXIS_COLOURS, time_text
from elliptude.typing import FloatArray

# Where the sphere is seen from, in reference axes.
_AZIMUTH_DEG, _ELEVATION_DEG = 35.0, 25.0
_MERIDIANS, _RINGS = 240, 10


def axes_figure(run: Run, title: str, *, times: Sequence[float] | None = None, label: str = "truth") -> Figure:
    """Where the body's axes may point: the image of the set on the sphere of directions, at some times.

    Small sets, and the errors in them, are drawn larger by a factor that the title states.

    Parameters
    ----------
    run : Run
    title : str
    times : sequence of float, optional
        s; the nearest rows with a set are drawn. Six from the first to the last if left out.
    label : str
        What the estimates are compared with.

    Returns
    -------
    Figure
    """
    rows = _rows_at(run, times)
    columns = min(3, max(len(rows), 1))
    lines = max(1, -(-len(rows) // columns))
    figure = new_figure(3.3 * lines + 1.0)
    factor = run.magnification(rows)
    magnified = [f"sets and errors drawn {factor} times as large"] if factor > 1 else []
    entitle(figure, title, run.bounds_from_recording, *magnified)
    view, names = _view(), replace(run, axes="reference").about_axes().names
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    attitudes, true_axes = run.attitudes, run.true_axes(factor)
    for panel in panels:
        panel.set_axis_off()
        panel.set_aspect("equal")
        panel.set_xlim(-1.24, 1.24)
        panel.set_ylim(-1.24, 1.24)
    for panel, row in zip(panels, rows, strict=False):
        _draw_sphere(panel, view, names)
        is_drawn = True
        for i in range(3):
            patch = axis_patches(
                attitudes[row][None],
                factor**2 * run.shapes[row][None],
                i,
                chart=run.chart,
                meridians=_MERIDIANS,
                rings=_RINGS,
            )[0]
            is_drawn &= bool(np.isfinite(patch).all())
            _draw_patch(panel, patch @ view.T, AXIS_COLOURS[i])
            _draw_tip(panel, view @ attitudes[row][:, i], AXIS_COLOURS[i], "xyz"[i])
            true = view @ true_axes[row][:, i]
            if np.isfinite(true).all():
                panel.plot(*true[:2], "x", color=BLACK, markersize=5, alpha=1.0 if true[2] >= 0.0 else 0.4, zorder=6)
        size = f"within {np.rad2deg(run.largest_angles[row]):.3g}°"
        panel.set_title(
            f"{time_text(run, row)} s: {size if is_drawn else f'{size}, too large to draw'}",
            fontsize=9.5,
            y=-0.04,
            va="top",
        )
    if len(rows) == 0:
        panels[0].text(0.5, 0.5, "nothing is known", transform=panels[0].transAxes, ha="center", color=GREY)
    handles: list[Patch | Line2D] = [
        Patch(facecolor=colour, alpha=0.6, label=f"where the body's {name} axis may point")
        for colour, name in zip(AXIS_COLOURS, "xyz", strict=True)
    ]
    handles.append(Line2D([], [], color=GREY, marker="o", fillstyle="none", linestyle=":", label="behind the sphere"))
    if np.isfinite(true_axes[rows]).any():
        handles.append(Line2D([], [], color=BLACK, marker="x", linestyle="none", label=label))
    legend_below(figure, {str(one.get_label()): one for one in handles}, 2)
    return figure


def _rows_at(run: Run, times: Sequence[float] | None) -> NDArray[np.intp]:
    known = np.flatnonzero(run.known)
    if len(known) == 0:
        return known
    wanted = np.linspace(run.times[known[0]], run.times[known[-1]], 6) if times is None else np.array(times)
    nearest = np.abs(run.times[known][None, :] - wanted[:, None]).argmin(axis=1)
    return np.unique(known[nearest])


def _view() -> FloatArray:
    """Rows: right, up and towards the eye, in reference axes."""
    azimuth, elevation = np.deg2rad([_AZIMUTH_DEG, _ELEVATION_DEG])
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.array([right, np.cross(towards, right), towards])


def _draw_sphere(panel: Axes, view: FloatArray, names: Sequence[str]) -> None:
    """Its limb, the circles of the reference planes, and where the reference axes come out."""
    panel.add_patch(Circle((0.0, 0.0), 1.0, facecolor="#FAFAFA", edgecolor=GREY, linewidth=0.9, zorder=0))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for normal in range(3):
        circle = np.zeros((181, 3))
        circle[:, (normal + 1) % 3], circle[:, (normal + 2) % 3] = np.cos(turn), np.sin(turn)
        seen = circle @ view.T
        seen[seen[:, 2] < 0.0] = np.nan
        panel.plot(seen[:, 0], seen[:, 1], color="#C8C8C8", linewidth=0.6, zorder=1)
    for i in range(3):
        tip = view[:, i]
        panel.plot(*tip[:2], ".", color=GREY, markersize=4, zorder=2)
        panel.annotate(
            names[i],
            (tip[0], tip[1]),
            # The names of the body's axes are above theirs, to the right.
            xytext=(tip[0] - 0.13, 1.13 * tip[1]) if i == 2 else (tip[0], tip[1] - 0.1),
            color=GREY,
            fontsize=8,
            ha="center",
            va="center",
            zorder=6,
        )


def _draw_patch(panel: Axes, seen: FloatArray, colour: str) -> None:
    """A patch in rings, the rim first: filled in front of the sphere, behind it the dotted rim alone."""
    if not np.isfinite(seen).all():
        return
    closed = np.concatenate([seen, seen[:, :1]], axis=1)
    corners = np.stack([closed[:-1, :-1], closed[:-1, 1:], closed[1:, 1:], closed[1:, :-1]], axis=2).reshape(-1, 4, 3)
    in_front = corners[..., 2] >= 0.0
    # Corners behind the sphere go to the limb, so that the area ends there.
    limb = corners[..., :2] / np.maximum(np.hypot(corners[..., 0], corners[..., 1]), 1e-12)[..., None]
    flat = np.where(in_front[..., None], corners[..., :2], limb)
    quads = flat[in_front.any(axis=1)]
    # One path for all quads is filled once, without seams.
    outlines = np.concatenate([quads, quads[:, :1]], axis=1)
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(quads))
    if len(quads):
        path = Path(outlines.reshape(-1, 2), codes)
        panel.add_patch(PathPatch(path, facecolor=colour, edgecolor="none", alpha=0.35, zorder=3))
    rim = closed[0]
    is_front = rim[:, 2:] >= 0.0
    front, behind = np.where(is_front, rim[:, :2], np.nan), np.where(is_front, np.nan, rim[:, :2])
    panel.plot(front[:, 0], front[:, 1], color=colour, linewidth=1.2, zorder=4)
    panel.plot(behind[:, 0], behind[:, 1], color=colour, linewidth=0.8, linestyle=":", alpha=0.8, zorder=2)


def _draw_tip(panel: Axes, seen: FloatArray, colour: str, name: str) -> None:
    """The estimated axis as a dot with its name; hollow behind the sphere."""
    in_front = seen[2] >= 0.0
    panel.plot(
        *seen[:2],
        "o",
        markersize=4,
        markeredgecolor=colour,
        markerfacecolor=colour if in_front else "none",
        zorder=5,
    )
    panel.annotate(
        name,
        (seen[0], seen[1]),
        xytext=(6, 5),
        textcoords="offset points",
        color=colour,
        fontsize=10,
        weight="bold",
        zorder=6,
    )
