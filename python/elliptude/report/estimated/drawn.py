"""Draws what a sensor measured: a panel with its three axes, its gaps, and marks where it was left out."""

from matplotlib.axes import Axes

from elliptude.report.estimated.measured import MeasuredSensor
from elliptude.report.figures import BLACK, SHADE, shade_spans
from elliptude.report.run_figures import AXIS_COLOURS

NO_SAMPLE = "no sample"
LEFT_OUT = "left out"
GAP_SHADE = SHADE | {"hatch": "////", "alpha": 0.35}


def heading_of(sensor: MeasuredSensor) -> str:
    """What a panel shows, such as "accelerometer (m/s²)"."""
    return f"{sensor.name} ({sensor.unit})" if sensor.unit else sensor.name


def draw_measured(panel: Axes, sensor: MeasuredSensor) -> None:
    """The three axes over time.

    Parameters
    ----------
    panel : Axes
    sensor : MeasuredSensor
    """
    for i, (axis, colour) in enumerate(zip("xyz", AXIS_COLOURS, strict=True)):
        panel.plot(sensor.times, sensor.values[:, i], color=colour, linewidth=0.8, label=axis)
    panel.legend(loc="upper right", ncols=3, fontsize=7.5, framealpha=0.7, edgecolor="none", borderpad=0.2)
    shade_spans(panel, sensor.gaps, NO_SAMPLE, GAP_SHADE)
    if len(sensor.left_out):
        heights = [0.04] * len(sensor.left_out)
        transform = panel.get_xaxis_transform()
        panel.plot(
            sensor.left_out, heights, "|", color=BLACK, markersize=5, transform=transform, label=LEFT_OUT, zorder=4
        )
    panel.set_ylabel(heading_of(sensor).replace(" (", "\n("), fontsize=9)
    panel.grid(axis="y", linewidth=0.3)
