"""The sphere of directions: the body's axes, the patches that they may point to, the measured directions."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elliptude.report.axes.sphere import MERIDIANS, Frames, frame_label, frame_rows, frames_of, triangles
from elliptude.report.run import Run, magnification_to
from elliptude.report.run_figures import AXIS_COLOURS
from elliptude.typing import FloatArray
from elliptude.view.directions import MeasuredDirections, circles, latest_rows, moved_away
from elliptude.view.stream import Stream, there

FRAMES = 2000
"""How many times the sphere is drawn at, besides the extremes."""
TRUTH_COLOUR = "#9D7BEA"
"""On white and on black, as all colours here: the viewer may be either."""

# The largest errors of a set that is drawn, rad, and a globe that the patches of such a set do not cut.
_LARGEST, _GLOBE = np.deg2rad(80.0), 0.91
# Circles about references are magnified with the sets, but only so that nearly all stay below this, rad.
_LARGEST_CIRCLE = np.deg2rad(45.0)
_SENSOR_COLOURS = ("#56B4E9", "#E69F00", "#40C8B0", "#8FBC3F")
_LEFT_OUT_COLOUR, _GREY = "#E0202B", "#8A8F98"


def send_globe(stream: Stream, run: Run, label: str, measured: MeasuredDirections | None) -> tuple[int, int]:
    """Draw the sphere.

    Parameters
    ----------
    stream : Stream
    run : Run
    label : str
        What the run is compared with.
    measured : MeasuredDirections, optional
        At all rows of the run.

    Returns
    -------
    times : int
        How many times it is drawn at.
    magnification : int
        By which sets, circles and errors are drawn too large.
    """
    rows = frame_rows(run, FRAMES)
    magnification = run.magnification(rows)
    if measured is not None and np.isfinite(measured.angles[rows]).any():
        angles = measured.angles[rows]
        magnification = min(magnification, magnification_to(_LARGEST_CIRCLE, angles[np.isfinite(angles)]))
    frames = frames_of(run, rows, magnification, _LARGEST)
    _send_reference_axes(stream, run)
    _send_body(stream, run.times[rows], frames, label)
    if measured is not None:
        _send_measured(stream, run, rows, measured, magnification)
    labels = [frame_label(run, int(row), is_drawn) for row, is_drawn in zip(rows, frames.drawn, strict=True)]
    stream.moving("now", run.times[rows], stream.rr.TextDocument.columns(text=labels))
    return len(rows), magnification


def _send_reference_axes(stream: Stream, run: Run) -> None:
    """The sphere itself, the reference axes and their names."""
    rr = stream.rr
    up = rr.ViewCoordinates.RIGHT_HAND_Z_DOWN if run.frame == "NED" else rr.ViewCoordinates.RIGHT_HAND_Z_UP
    stream.still("sphere", up)
    grey = stream.colours([_GREY])
    globe = rr.Ellipsoids3D(
        # Smaller than the patches, which are flat between their vertices.
        half_sizes=[[_GLOBE] * 3],
        fill_mode="TransparentFillMajorWireframe",
        colors=grey,
        line_radii=rr.Radius.ui_points(0.5),
    )
    stream.still("sphere/globe", globe)
    names = replace(run, axes="reference").about_axes().names
    tips = 1.2 * np.eye(3)
    stream.still("sphere/reference", rr.LineStrips3D([[[0.0] * 3, tip] for tip in tips], colors=grey))
    points = rr.Points3D(1.25 * np.eye(3), radii=rr.Radius.ui_points(0.0), labels=names, show_labels=True, colors=grey)
    stream.still("sphere/reference/names", points)


def _send_body(stream: Stream, times: FloatArray, frames: Frames, label: str) -> None:
    """The body's axes as estimated, where they may point, and where the reference has them."""
    rr = stream.rr
    corners = np.column_stack(triangles())
    for i, axis in enumerate("xyz"):
        colour, path = stream.colours([AXIS_COLOURS[i]]), f"sphere/body/{axis}"
        tips, lengths = there(frames.tips[:, i : i + 1])
        arrow = rr.Arrows3D.from_fields(
            colors=colour, radii=rr.Radius.ui_points(2.5), labels=[axis], show_labels=[True]
        )
        stream.still(path, arrow)
        stream.moving(path, times, rr.Arrows3D.columns(vectors=tips).partition(lengths=lengths))

        patches = frames.patches[:, i]
        vertices, lengths = there(patches.reshape(len(times), -1, 3))
        path = f"sphere/may_point/{axis}"
        stream.still(path, rr.Mesh3D.from_fields(triangle_indices=corners, albedo_factor=colour[0]))
        stream.moving(path, times, rr.Mesh3D.columns(vertex_positions=vertices).partition(lengths=lengths))

        rims, lengths = there(patches[:, 0, np.append(np.arange(MERIDIANS), 0)])
        _send_strips(stream, f"{path}/rim", times, rims, lengths, colour)
    if frames.marks is not None:
        marks, lengths = there(frames.marks)
        path = rr.new_entity_path(["sphere", "compared_with", label])
        points = rr.Points3D.from_fields(colors=stream.colours([TRUTH_COLOUR]), radii=rr.Radius.ui_points(6.0))
        stream.still(path, points)
        stream.moving(path, times, rr.Points3D.columns(positions=marks).partition(lengths=lengths))


def _send_measured(
    stream: Stream, run: Run, rows: NDArray[np.intp], measured: MeasuredDirections, magnification: int
) -> None:
    """Where the estimate points what was measured, and the circle in which the truth points it."""
    rr = stream.rr
    attitudes = run.attitudes
    attitudes[~run.known] = np.nan
    left_out = [
        set(f"{one} {other}".split()) for one, other in zip(run.dropped or run.refused, run.refused, strict=True)
    ]
    for i, name in enumerate(measured.names):
        there_is = np.isfinite(measured.directions[:, i, 0])
        latest = latest_rows(run.times, there_is, rows)
        missing = latest < 0
        references = measured.references[latest, i]
        pointed = np.einsum("nij,nj->ni", attitudes[latest], measured.directions[latest, i])
        shown = np.where(missing[:, None], np.nan, moved_away(pointed, references, magnification))
        angles = magnification * measured.angles[latest, i]
        rims = circles(references, np.where(missing | (angles >= np.pi), np.nan, angles))
        colour = _SENSOR_COLOURS[i % len(_SENSOR_COLOURS)]
        times, path = run.times[rows], rr.new_entity_path(["sphere", "measured", name])
        _send_strips(stream, f"{path}/within", times, *there(rims), stream.colours([colour]))
        points, lengths = there(shown[:, None])
        is_out = np.array([name in left_out[row] for row in latest]) | np.isnan(angles)  # or against its own bound
        is_out = is_out[lengths > 0]
        stream.still(path, rr.Points3D.from_fields(radii=rr.Radius.ui_points(5.0), labels=[name], show_labels=[True]))
        colours = np.where(is_out[:, None], stream.colours([_LEFT_OUT_COLOUR]), stream.colours([colour]))
        columns = rr.Points3D.columns(positions=points, colors=colours)
        stream.moving(path, times, columns.partition(lengths=lengths))


def _send_strips(
    stream: Stream,
    path: str,
    times: FloatArray,
    points: FloatArray,
    lengths: NDArray[np.intp],
    colour: NDArray[np.uint8],
) -> None:
    """A line at each time that has points."""
    rr = stream.rr
    stream.still(path, rr.LineStrips3D.from_fields(colors=colour, radii=rr.Radius.ui_points(1.2)))
    strips = points.reshape(-1, max(int(lengths.max(initial=1)), 1), 3)
    stream.moving(path, times, rr.LineStrips3D.columns(strips=strips).partition(lengths=(lengths > 0).astype(int)))
