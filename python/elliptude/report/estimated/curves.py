"""The plot of the interactive report that shows what the sensors measured."""

from html import escape
from typing import Any

import numpy as np

from elliptude.report.curves import GREY, plot_layout, time_axis
from elliptude.report.estimated.drawn import LEFT_OUT, heading_of
from elliptude.report.estimated.stored import MeasuredSensor
from elliptude.report.run import Run
from elliptude.report.run_figures import AXIS_COLOURS
from elliptude.typing import FloatArray

_PIXELS_OF_PANEL, _PIXELS_OF_MARGIN = 150, 70
_LEAST_MARGIN = 90
"""For titles of three lines."""


def measured_plot(run: Run, margin: float = 0.0) -> dict[str, Any]:
    """Plotly's data and layout: a panel for each sensor, above each other.

    Parameters
    ----------
    run : Run
        With at least one sensor.
    margin : float
        What the plots above have on the left, px, so that times are below one another.

    Returns
    -------
    dict
    """
    traces: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    grid = {"rows": len(run.measured), "columns": 1, "pattern": "coupled"}
    height = _PIXELS_OF_MARGIN + _PIXELS_OF_PANEL * len(run.measured)
    layout = plot_layout(grid=grid, xaxis=time_axis(run), height=height)
    for k, sensor in enumerate(run.measured):
        y = f"y{k + 1}" if k else "y"
        for i, axis in enumerate("xyz"):
            mode = "lines+markers" if sensor.is_sparse else "lines"
            trace = {"type": "scatter", "mode": mode, "name": axis, "legendgroup": axis, "showlegend": k == 0}
            points = {"x": _numbers(sensor.times), "y": _numbers(sensor.values[:, i])}
            traces.append(
                trace
                | points
                | {"xaxis": "x", "yaxis": y, "line": {"color": AXIS_COLOURS[i], "width": 1}, "marker": {"size": 4}}
            )
        if len(sensor.left_out):
            # Below the curves, which are in the upper part of the range.
            low, high = float(np.nanmin(sensor.values)), float(np.nanmax(sensor.values))
            bottom = low - 0.08 * (high - low)
            is_first = all(trace["name"] != LEFT_OUT for trace in traces)
            traces.append(_marks(sensor, bottom) | {"xaxis": "x", "yaxis": y, "showlegend": is_first})
        shapes += [_shade(f"{y} domain", begin, end) for begin, end in sensor.gaps]
        title = {"text": "<br>".join(map(escape, heading_of(sensor))), "font": {"size": 11}, "standoff": 4}
        layout["yaxis" + y[1:]] = {"title": title}
    layout["shapes"] = shapes
    layout["margin"]["l"] = max(margin, _LEAST_MARGIN)
    return {"data": traces, "layout": layout}


def _marks(sensor: MeasuredSensor, height: float) -> dict[str, Any]:
    """A mark at each time at which the sensor was left out."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": LEFT_OUT,
        "legendgroup": LEFT_OUT,
        "x": _numbers(sensor.left_out),
        "y": [float(f"{height:.6g}")] * len(sensor.left_out),
        "hovertemplate": "%{x:.6~f} s: left out<extra></extra>",
        "marker": {"symbol": "line-ns-open", "size": 8, "line": {"width": 1.5}},
        "meta": "ink",
    }


def _shade(height: str, begin: float, end: float) -> dict[str, Any]:
    """Grey from the last sample before a gap to the first one after it."""
    shade = {"type": "rect", "xref": "x", "y0": 0, "y1": 1, "layer": "below", "fillcolor": GREY, "line": {"width": 0}}
    return shade | {"yref": height, "x0": begin, "x1": end}


def _numbers(values: FloatArray) -> list[float | None]:
    """For JSON, to ten digits; None in a gap."""
    return [float(f"{value:.10g}") if np.isfinite(value) else None for value in values]
