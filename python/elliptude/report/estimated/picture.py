"""The picture ``estimate.png``: attitude, how far it may be off, and below them what the sensors measured."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from elliptude.bounds.angles.about_axes import ErrorAxes, about_axes
from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT
from elliptude.io.tables import Result
from elliptude.report.breaks import broken
from elliptude.report.estimated.drawn import LEFT_OUT, begin_measured, draw_measured
from elliptude.report.estimated.stored import MeasuredSensor
from elliptude.report.figures import (
    BLACK,
    BLUE,
    CONDITIONAL,
    GAP_SHADE,
    GREY,
    HEADING_COLOUR,
    NO_SAMPLE,
    SIZE_COLOUR,
    TILT_COLOUR,
    UNKNOWN,
    Style,
    begin_above,
    draw_angle,
    draw_bands_alone,
    draw_bound_used,
    entitle,
    error_limit,
    legend_below,
    marks_of,
    new_figure,
    plain_log_axis,
    shade_conditional,
    shade_spans,
    shade_unknown,
    true_roll_pitch_yaw,
)
from elliptude.report.run_figures import AXIS_COLOURS, AXIS_LINES
from elliptude.typing import FloatArray

# Fewer points than this are marked, because the lines between them only guide the eye.
_MARK_BELOW = 150
_INCHES_OF_PANEL, _INCHES_OF_MARGIN = 1.45, 1.5


def estimate_figure(
    result: Result,
    title: str,
    *,
    label: str = "truth",
    inside_share: float | None = None,
    axes: ErrorAxes = "reference",
    frame: str | None = None,
    heading_from_start: bool = False,
    proposed_from: str | None = None,
    measured: Sequence[MeasuredSensor] = (),
    gaps: Sequence[tuple[float, float]] = (),
) -> Figure:
    """The attitude with its bounds; how far it may be off, and is; the share inside; what the sensors measured.

    Roll, pitch and yaw with their bands come first if the result has them. Errors about single axes have panels of
    their own where they are known and nothing else shows them. Bounds without errors are curves of one panel.

    Parameters
    ----------
    result : Result
    title : str
    label : str
        What the estimates are compared with.
    inside_share : float, optional
        The share of all rows, if ``result`` has only some of them.
    axes : {"reference", "body"}
        About which axes attitude errors are shown.
    frame : str, optional
        The reference frame, whose axes may have names.
    heading_from_start : bool
        Whether the heading counts from the first row.
    proposed_from : str, optional
        The recording that the bounds are proposed from, if they are proposals.
    measured : sequence of MeasuredSensor
        A panel for each.
    gaps : sequence of (float, float)
        From and to which time, s, there is no row; no curve goes on there.

    Returns
    -------
    Figure
    """
    result = broken(result, list(gaps))
    grid = _Rows(
        [
            *_angle_rows(result, label),
            *_error_rows(result, _error_columns(result, axes, frame, heading_from_start), label),
        ]
    )
    last = _last_row(result, inside_share, label)
    # Panels of half the width belong below others of half the width: times are below one another.
    is_wide = all(len(row) == 1 for row in grid.rows)
    grid.rows += [[one] for one in last] if is_wide else [last]
    grid.rows += [[partial(_draw_sensor, sensor=one, is_first=i == 0)] for i, one in enumerate(measured)]
    figure = grid.draw(title, proposed_from)
    for panel in figure.axes[: len(figure.axes) - len(measured)]:
        shade_spans(panel, gaps, NO_SAMPLE, GAP_SHADE)
    if len(result.times) > 1:  # also where nothing is known
        figure.axes[0].set_xlim(float(result.times[0]), float(result.times[-1]))
    figure.align_ylabels()
    _put_legend_below(figure, figure.axes)
    return figure


_Draw = Callable[[Axes], None]


class _Rows:
    """Panels over one time axis, one or two in a row."""

    def __init__(self, rows: Sequence[Sequence[_Draw]]) -> None:
        self.rows = [list(row) for row in rows]

    def draw(self, title: str, proposed_from: str | None) -> Figure:
        """The figure with all of them; the times are written where the next row has other columns, and in the end."""
        figure = new_figure(_INCHES_OF_MARGIN + _INCHES_OF_PANEL * len(self.rows))
        entitle(figure, title, proposed_from)
        grid: GridSpec = figure.add_gridspec(len(self.rows), 2)
        first: Axes | None = None
        for i, row in enumerate(self.rows):
            is_last = i + 1 == len(self.rows)
            for j, draw in enumerate(row):
                place = grid[i, :] if len(row) == 1 else grid[i, j]
                panel = figure.add_subplot(place, sharex=first)
                first = first or panel
                draw(panel)
                # Panels of the whole width are not aligned with those of half of it.
                panel.tick_params(labelbottom=is_last or len(row) != len(self.rows[i + 1]))
                if is_last:
                    panel.set_xlabel("time (s)")
        return figure


def _angle_rows(result: Result, label: str) -> list[list[_Draw]]:
    """Roll, pitch and yaw."""
    angles = result.roll_pitch_yaw
    if angles is None:
        return []
    true = _true_angles(result)

    def row(i: int) -> list[_Draw]:
        def draw(panel: Axes) -> None:
            draw_angle(panel, result.times, angles, true, label, i)
            shade_unknown(panel, result.times, np.isfinite(angles[:, 3 * i]))
            shade_conditional(panel, result.times, result.claims if i == 2 else (result.up_claims or result.claims))

        return [draw]

    return [row(i) for i in range(3)]


def _error_rows(result: Result, columns: list["_ErrorColumn"], label: str) -> list[list[_Draw]]:
    """Errors in bands, a panel for each axis, side by side; bounds without errors in one panel for all axes."""
    marks, has_set = _marks(result), np.isfinite(result.largest_angles)

    def shaded(panel: Axes) -> None:
        shade_unknown(panel, result.times, has_set)
        shade_conditional(panel, result.times, result.claims)

    def band(column: _ErrorColumn, i: int) -> _Draw:
        def draw(panel: Axes) -> None:
            shaded(panel)
            _draw_band(panel, result.times, column, i, label, **marks)

        return draw

    def bounds(column: _ErrorColumn) -> _Draw:
        def draw(panel: Axes) -> None:
            shaded(panel)
            _draw_bounds(panel, result.times, column, **marks)

        return draw

    compared = [column for column in columns if column.errors is not None]
    rows = [[band(column, i) for column in compared] for i in range(3) if compared]
    return rows + [[bounds(column)] for column in columns if column.errors is None]


def _draw_sensor(panel: Axes, sensor: MeasuredSensor, is_first: bool) -> None:
    """What a sensor measured; the first panel says what all are."""
    draw_measured(panel, sensor)
    if is_first:
        begin_measured(panel)


def _last_row(result: Result, inside_share: float | None, label: str) -> list[_Draw]:
    """The size of the set; beside it how much of its bound the error uses, if it is known."""
    marks, has_set, forms = _marks(result), np.isfinite(result.largest_angles), result.forms

    def size(panel: Axes) -> None:
        # Up may be known where no set is.
        shade_unknown(
            panel, result.times, has_set if result.up_bounds is None else has_set | np.isfinite(result.up_bounds)
        )
        shade_conditional(panel, result.times, result.claims)
        _draw_size(panel, result, label, **marks)

    def bound_used(panel: Axes) -> None:
        shade_unknown(panel, result.times, has_set)
        draw_bound_used(panel, result.times, [("", forms, BLACK)], inside_share, **marks)

    return [size] if forms is None or not np.isfinite(forms).any() else [bound_used, size]


class _ErrorColumn(NamedTuple):
    """A column of three panels: errors and their bounds."""

    heading: str
    labels: tuple[str, ...]
    bounds: FloatArray
    """Degrees or degrees/s, shape (N, 3)."""
    errors: FloatArray | None


def _error_columns(result: Result, axes: ErrorAxes, frame: str | None, heading_from_start: bool) -> list[_ErrorColumn]:
    """The attitude, and the vector beside it; a bias that is not estimated has nothing to show.

    Angles with their bands show the attitude, and bounds of heading and tilt say more than those about three axes.
    """
    found = []
    if result.roll_pitch_yaw is None or result.headings is None:
        found.append(_attitude_column(result, axes, frame, heading_from_start))
    if np.isfinite(result.half_widths[:, 3:]).any():
        name, unit = ("gyro bias error", "beta") if result.vector == "bias" else ("angular velocity error", "omega")
        labels = tuple(rf"$\delta\{unit}_{axis}$ (deg/s)" for axis in "xyz")
        bounds, errors = _vector_bounds(result), _known_errors(result, slice(3, 6))
        found.append(_error_column(name, "body axes", labels, bounds, errors))
    return found


def _attitude_column(result: Result, axes: ErrorAxes, frame: str | None, heading_from_start: bool) -> _ErrorColumn:
    """The attitude error about three axes."""
    attitude = about_axes(
        axes,
        result.attitudes,
        result.shapes[:, :3, :3],
        result.chart,
        result.half_widths[:, :3],
        _known_errors(result, slice(0, 3)),
        turns=result.turns_reference if axes == "reference" else result.turns_body,
        frame=frame,
        heading_from_start=heading_from_start,
    )
    labels = tuple(f"about {name} (deg)" for name in attitude.names)
    return _error_column("attitude error", attitude.phrase, labels, attitude.half_widths, attitude.errors)


def _vector_bounds(result: Result) -> FloatArray:
    """How far the vector may be off: as it was asked by itself, or as the set says, rad/s, shape (N, 3)."""
    if result.vector_ranges is None:
        return result.half_widths[:, 3:]
    ranges = result.vector_ranges.reshape(-1, 3, 2)
    return np.asarray(np.abs(ranges - result.vectors[..., None]).max(axis=-1))


def _known_errors(result: Result, part: slice) -> FloatArray | None:
    """Errors of the attitude or of the vector; None if none is known."""
    errors = result.errors
    return None if errors is None or not np.isfinite(errors[:, part]).any() else errors[:, part]


def _error_column(
    what: str, about: str, labels: tuple[str, ...], bounds: FloatArray, errors: FloatArray | None
) -> _ErrorColumn:
    heading = f"{what}{' ' if about.startswith('about') else ', '}{about}"
    heading = heading if errors is not None else f"bound of the {heading}"
    return _ErrorColumn(heading, labels, np.rad2deg(bounds), None if errors is None else np.rad2deg(errors))


def _draw_band(panel: Axes, time: FloatArray, column: _ErrorColumn, i: int, label: str, **marks: Any) -> None:
    """The error about an axis within its band."""
    limit = error_limit(column.bounds, column.errors)
    bound = column.bounds[:, i]
    panel.fill_between(time, -bound, bound, color=BLUE, alpha=0.22, linewidth=0, label="where it may be")
    draw_bands_alone(panel, time, -bound, bound)
    if column.errors is not None:
        style = marks or marks_of(column.errors[:, i])
        panel.plot(time, column.errors[:, i], color=BLACK, linewidth=0.9, label=f"error against {label}", **style)
    panel.axhline(0.0, color=GREY, linewidth=0.5)
    panel.set_ylim(-limit, limit)
    panel.set_ylabel(column.labels[i])
    if i == 0:
        panel.set_title(column.heading, fontsize=9.5)


def _draw_bounds(panel: Axes, time: FloatArray, column: _ErrorColumn, **marks: Any) -> None:
    """How far the error may reach about each axis, in one panel."""
    for i, (label, colour, style) in enumerate(zip(column.labels, AXIS_COLOURS, AXIS_LINES, strict=True)):
        name, drawn = label.partition(" (")[0], marks or marks_of(column.bounds[:, i])
        panel.plot(time, column.bounds[:, i], color=colour, linestyle=style, linewidth=1.1, label=name, **drawn)
    panel.set_ylim(0.0, error_limit(column.bounds, None))
    panel.set_ylabel(f"bound ({column.labels[0].partition(' (')[2]}")
    panel.set_title(column.heading, fontsize=9.5)
    # Beside the title: within the panel it would hide curves.
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, frameon=False, fontsize=8, borderpad=0.1)
    panel.grid(axis="y", linewidth=0.3)


def _put_legend_below(figure: Figure, panels: Sequence[Axes]) -> None:
    """What the curves of some panels are, each once."""
    entries: dict[str, Any] = {}
    for axes in panels:
        if axes.get_legend() is not None:  # says what its curves are
            continue
        of_axes = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        entries |= {label: handle for label, handle in of_axes.items() if label not in entries}
    # Shades may be in others alone.
    for label in (UNKNOWN, CONDITIONAL, NO_SAMPLE):
        shades = [one for axes in figure.axes for one in axes.collections if one.get_label() == label]
        if shades:
            entries[label] = shades[0]
    for axes in figure.axes:  # marks may be in panels with a legend of their own
        entries |= {str(line.get_label()): line for line in axes.lines if line.get_label() == LEFT_OUT}
    legend_below(figure, entries)


def _true_angles(result: Result) -> FloatArray | None:
    """Roll, pitch and yaw of the truth, rad, shape (N, 3); None without one."""
    if result.errors is None:
        return None
    return true_roll_pitch_yaw(result.attitudes, result.errors[:, :3])


def _draw_size(axes: Axes, result: Result, label: str, **marks: Any) -> None:
    """The largest angle in the set, the error, and bounds of heading and tilt."""
    time, errors = result.times, result.errors

    def draw(angles: FloatArray, **style: Any) -> None:
        axes.plot(time, np.rad2deg(angles), **style, **(marks or marks_of(angles)))

    draw(result.largest_angles, color=SIZE_COLOUR, linewidth=1.6, label=LARGEST_ANGLE)
    if errors is not None:
        off = np.linalg.norm(errors[:, :3], axis=1)
        draw(off, color=BLACK, linewidth=0.9, label=f"error against {label}")
    is_off = errors is not None and bool(np.isfinite(errors[:, :3]).any())
    axes.set_title(f"how far the attitude may be off{', and is' * is_off}", fontsize=9.5)
    axes.set_ylabel("angle (deg)")
    plain_log_axis(axes)
    if result.headings is None or result.tilt_bounds is None:
        return
    heading = np.abs(result.headings).max(axis=1)
    draw(heading, color=HEADING_COLOUR, linewidth=1.1, linestyle="--", label=HEADING)
    draw(result.tilt_bounds, color=TILT_COLOUR, linewidth=1.1, label=TILT)
    if result.up_bounds is not None:
        up = np.where(np.isnan(result.tilt_bounds), result.up_bounds, np.nan)
        if np.isfinite(up).any():
            draw(up, color=TILT_COLOUR, linewidth=1.4, linestyle=":", label="up alone")
    begin_above(axes, HEADING)


def _marks(result: Result) -> Style:
    return {"marker": "o", "markersize": 2.5} if len(result.times) < _MARK_BELOW else {}
