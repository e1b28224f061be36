"""Draws what a sensor measured: a panel with its three axes, its gaps, and marks where it was left out."""

from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elliptude.report.estimated.stored import MeasuredSensor
from elliptude.report.figures import BLACK, GAP_SHADE, NO_SAMPLE, Style, entitle, legend_below, new_figure, shade_spans
from elliptude.report.run import Run
from elliptude.report.run_figures import AXIS_COLOURS, time_span

LEFT_OUT = "left out"


def measured_figure(run: Run, title: str) -> Figure:
    """What each sensor of a run measured, a panel each.

    Parameters
    ----------
    run : Run
        With at least one sensor.
    title : str

    Returns
    -------
    Figure
    """
    figure = new_figure(1.2 + 1.6 * len(run.measured))
    entitle(figure, title, run.bounds_from_recording)
    panels = figure.subplots(len(run.measured), 1, sharex=True, squeeze=False).ravel().tolist()
    for panel, sensor in zip(panels, run.measured, strict=True):
        draw_measured(panel, sensor)
    begin_measured(panels[0])
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_xlim(*time_span(run.times))
    figure.align_ylabels(panels)
    entries = {label: handle for panel in panels for handle, label in zip(*shades_and_marks(panel), strict=True)}
    legend_below(figure, entries)
    return figure


def begin_measured(panel: Axes) -> None:
    """Say above the first panel what all are, and which axis has which colour."""
    panel.set_title("what the sensors measured, in body axes", fontsize=9.5)
    # Beside the title: within the panel it would hide curves.
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98)}
    panel.legend(panel.lines[:3], "xyz", **place, ncols=3, fontsize=9, frameon=False, borderpad=0.1)


def shades_and_marks(panel: Axes) -> tuple[list[Artist], list[str]]:
    """What a legend has of a panel beside its axes: gaps and marks."""
    found = [one for one in (*panel.collections, *panel.lines) if one.get_label() in (NO_SAMPLE, LEFT_OUT)]
    return list(found), [str(one.get_label()) for one in found]


def heading_of(sensor: MeasuredSensor) -> list[str]:
    """What a panel shows, in lines: the sensor's name, its kind if that is another word, and the unit."""
    lines = [sensor.name, sensor.kind, f"({sensor.unit})"]
    return [line for line in dict.fromkeys(lines) if line not in ("", "()")]


def draw_measured(panel: Axes, sensor: MeasuredSensor) -> None:
    """The three axes over time, which `begin_measured` names.

    Parameters
    ----------
    panel : Axes
    sensor : MeasuredSensor
    """
    marks: Style = {"marker": "o", "markersize": 2.0} if sensor.is_sparse else {}
    for i, (axis, colour) in enumerate(zip("xyz", AXIS_COLOURS, strict=True)):
        panel.plot(sensor.times, sensor.values[:, i], color=colour, linewidth=0.8, label=f"_{axis}", **marks)
    shade_spans(panel, sensor.gaps, NO_SAMPLE, GAP_SHADE)
    if len(sensor.left_out):
        heights = [0.04] * len(sensor.left_out)
        transform = panel.get_xaxis_transform()
        panel.plot(
            sensor.left_out, heights, "|", color=BLACK, markersize=5, transform=transform, label=LEFT_OUT, zorder=4
        )
    panel.set_ylabel("\n".join(heading_of(sensor)), fontsize=8.5)
    panel.grid(axis="y", linewidth=0.3)
