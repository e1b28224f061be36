"""The plots over time of the interactive report."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT, half_width
from elliptude.report.breaks import pieces_between_gaps
from elliptude.report.figures import (
    HEADING_COLOUR,
    TILT_COLOUR,
    cut_at_wraps,
    error_limit,
    log_ticks,
    true_roll_pitch_yaw,
)
from elliptude.report.run import DroppedMeasurements, Run, Spell
from elliptude.report.run_figures import AXIS_COLOURS, CLAIM_COLOURS, PREDICTION_COLOURS, claim_label, claims_of_up
from elliptude.report.thinning import (
    largest_of_each,
    pieces,
    prediction_shares,
    spans_unknown,
    worst_claims,
)
from elliptude.typing import FloatArray
from elliptude.units import readable_unit

PIECES = 500
"""Pieces of rows; the extremes of each are drawn."""

# Width of the names of lanes, px; all plots over time have it, so that their times are below one another.
_LANES_WIDTH = 90
_BLUE, _ORANGE = "#0072B2", "#D55E00"
# On white and on black.
_LIGHT_BLUE, _MIDDLE_BLUE = "rgba(86,180,233,0.35)", "#2A93D1"
_DASHES = ("solid", "dash", "dashdot")


def plots_over_time(run: Run, rows: NDArray[np.intp], label: str, spells: list[Spell]) -> dict[str, Any]:
    """Plotly's data and layout for each place in the page."""
    # The measurements in the list are marked below the size of the set.
    if run.listed is not None:
        spells = [spell for spell in spells if spell.what == "refused"]
    plots: dict[str, Any] = {}
    if run.roll_pitch_yaw is not None:
        plots["angles"] = _angles(run, rows, run.roll_pitch_yaw[rows], label)
    # Without a set there is no band, and without up either nothing is known of any size.
    if run.known.any() or run.up_alone.any() or run.listed is not None:
        plots["size"] = _size(run, rows)
    if run.known.any():
        plots["bands"] = _bands(run, rows, label)
    for name, plot in plots.items():
        plot["layout"]["shapes"] = _unknown(run, name) + _conditional(run, name)
    if run.claims is not None or run.prediction_used is not None or spells:
        plots["strip"] = _strip(run, spells)
    if "strip" in plots or ("size" in plots and "yaxis2" in plots["size"]["layout"]):
        for name in ("angles", "size", "bands", "strip"):
            if name in plots:
                plots[name]["layout"]["margin"]["l"] = _LANES_WIDTH
    return plots


GREY, AMBER = "rgba(128,128,128,0.4)", "rgba(213,94,0,0.16)"
"""Where something is not known, and where it rests on what was left out. The grey is darker than the grid, from which a
narrow one must differ."""


def _shades(run: Run, colour: str, without: dict[str, NDArray[np.bool_]]) -> list[dict[str, Any]]:
    """Shapes of a colour over the parts of a plot, by the height that they have, but for these rows."""
    shade = {"type": "rect", "xref": "x", "y0": 0, "y1": 1, "layer": "below", "fillcolor": colour, "line": {"width": 0}}
    return [
        shade | {"yref": height, "x0": begin, "x1": end}
        for height, rows in without.items()
        for begin, end in spans_unknown(run.times, rows)
    ]


def _conditional(run: Run, name: str) -> list[dict[str, Any]]:
    """Amber shapes where what a plot shows rests on what was left out."""

    def others(claims: tuple[str, ...] | None) -> NDArray[np.bool_]:
        return np.ones(len(run.times), bool) if claims is None else np.array([one != "conditional" for one in claims])

    if name == "angles":
        of_up = others(run.claims if run.up_claims is None else run.up_claims)
        return _shades(run, AMBER, {"y domain": of_up, "y2 domain": of_up, "y3 domain": others(run.claims)})
    return _shades(run, AMBER, {"y domain" if name == "size" else "paper": others(run.claims)})


def _unknown(run: Run, name: str) -> list[dict[str, Any]]:
    """Grey shapes where what a plot shows is not known."""
    if name == "angles":
        assert run.roll_pitch_yaw is not None
        shown = {f"{axis} domain": run.roll_pitch_yaw[:, 3 * i] for i, axis in enumerate(("y", "y2", "y3"))}
        known = {height: np.isfinite(angle) for height, angle in shown.items()}
    elif name == "size":
        # Below it there may be lanes of marks, to which this does not apply.
        known = {"y domain": run.known | run.up_alone}
    else:
        known = {"paper": run.known}
    return _shades(run, GREY, known)


def _list(values: FloatArray) -> list[float | None]:
    """Values for JSON, to six digits; None where there is nothing."""
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]


def _times(run: Run, rows: NDArray[np.intp]) -> list[float]:
    return [float(time) for time in run.times[rows]]


def time_axis(run: Run) -> dict[str, Any]:
    """The time axis of all plots, so that they can be compared; times since 1970 are not written as "1.7B"."""
    first, last = float(run.times[0]), float(run.times[-1])
    return {
        "title": {"text": "time (s)"},
        "range": [first, last] if last > first else [first - 0.5, first + 0.5],
        "exponentformat": "none",
        "hoverformat": ".6~f",
    }


_OUTSIDE = "outside the band"


def plot_layout(**more: Any) -> dict[str, Any]:
    """The layout that all plots of the page share."""
    return {
        "margin": {"l": 55, "r": 10, "t": 10, "b": 45},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"size": 12},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        "hovermode": "x unified",
        **more,
    }


def _size(run: Run, rows: NDArray[np.intp]) -> dict[str, Any]:
    time, known, headings, shown = _times(run, rows), run.known[rows], run.heading_bounds, run.about_axes()

    def curve(name: str, angles: FloatArray, there: NDArray[np.bool_], line: dict[str, Any]) -> dict[str, Any]:
        degrees = np.where(there, np.rad2deg(angles[rows]), np.nan)
        return {"type": "scatter", "mode": "lines", "name": name, "x": time, "y": _list(degrees), "line": line}

    # Heading and tilt say more than three axes do.
    traces = [
        curve(
            half_width(axis),
            shown.half_widths[:, i],
            known,
            {"color": AXIS_COLOURS[i], "dash": _DASHES[i], "width": 1.5},
        )
        for i, axis in enumerate(shown.names if headings is None else ())
    ]
    traces.append(curve(LARGEST_ANGLE, run.largest_angles, known, {"width": 2}) | {"meta": "ink"})
    if headings is not None:
        line = {"color": HEADING_COLOUR, "dash": "dash", "width": 1.5}
        traces.append(curve(HEADING, headings, known, line))
    if run.tilt_bounds is not None:
        line = {"color": TILT_COLOUR, "dash": "dot" if headings is None else "solid", "width": 1.5}
        traces.append(curve(TILT, run.tilt_bounds, known, line))
    alone = run.up_alone[rows]
    if run.up_bounds is not None and alone.any():
        traces.append(curve("up alone", run.up_bounds, alone, {"color": TILT_COLOUR, "dash": "dot", "width": 2}))
    drawn = np.array([value for trace in traces for value in trace["y"] if value is not None], dtype=np.float64)
    scale = "log" if len(drawn) and (run.largest_angles[rows][known] > 0.0).all() else "linear"
    axis: dict[str, Any] = {"title": {"text": "angle (deg)"}, "type": scale}
    if scale == "log":
        low, high = float(drawn[drawn > 0.0].min()), float(drawn.max())
        if headings is not None:
            # A heading that counts from the first row begins at nearly nothing, which would flatten all else.
            others = [run.largest_angles, run.tilt_bounds, run.up_bounds]
            angles = np.concatenate([np.rad2deg(one[rows]) for one in others if one is not None])
            low = 0.2 * float(angles[angles > 0.0].min())
            axis["range"] = [float(np.log10(low)), float(np.log10(1.3 * high))]
        ticks = log_ticks(low, high)
        axis |= {"tickmode": "array", "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    layout = plot_layout(xaxis=time_axis(run), yaxis=axis)
    if run.listed is not None and len(run.listed.times):
        marks = _drop_marks(run, run.listed)
        height = min(0.07 * len(marks), 0.3)
        layout["xaxis"] |= {"anchor": "y2"}
        layout["yaxis"] |= {"domain": [height + 0.04, 1.0]}
        layout["yaxis2"] = {"domain": [0.0, height], "automargin": True, "dtick": 1, "showgrid": False}
        traces += marks
    return {"data": traces, "layout": layout}


def _drop_marks(run: Run, listed: DroppedMeasurements) -> list[dict[str, Any]]:
    """A lane of marks for each sensor that was left out. If marks would hide one another, the farthest off is drawn."""
    edges = run.times[[piece.start for piece in pieces(len(run.times), PIECES)]]
    bins = np.searchsorted(edges, listed.times, side="right")
    sensors = np.array(listed.sensors, dtype=object)
    marks = []
    for sensor in sorted(set(listed.sensors)):
        rows = np.flatnonzero(sensors == sensor)
        rows = rows[largest_of_each(bins[rows], -listed.margins[rows])]
        marks.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": f"{sensor} left out",
                "showlegend": False,
                "x": [float(time) for time in listed.times[rows]],
                "y": [f"{sensor} left out"] * len(rows),
                "text": [_why(listed, int(row)) for row in rows],
                "hovertemplate": "%{x:.6~f} s: %{text}<extra></extra>",
                "marker": {"symbol": "line-ns-open", "size": 10, "line": {"width": 1.5}},
                "meta": "ink",
                "yaxis": "y2",
            }
        )
    return marks


def _why(listed: DroppedMeasurements, row: int) -> str:
    margin, place = listed.margins[row], listed.places[row]
    if listed.contradicts[row] == "own_bound":
        return f"{place}, {-margin:.3g} {readable_unit(listed.units[row])} beyond its own bound"
    if listed.contradicts[row] == "prediction_of_up":
        return f"{place}, {-margin:.3g} {readable_unit(listed.units[row])} beyond the prediction of up"
    return f"{place}, contradicts the prediction, margin {margin:.3g}"


def _bands(run: Run, rows: NDArray[np.intp], label: str) -> dict[str, Any]:
    known = run.known[rows]
    traces: list[dict[str, Any]] = []
    shown = run.about_axes()
    bounds, errors = shown.half_widths[rows][known], None if shown.errors is None else shown.errors[rows][known]
    limit = np.rad2deg(error_limit(bounds, errors)) if known.any() else 1.0
    layout = plot_layout(grid={"rows": 3, "columns": 1, "pattern": "coupled"}, xaxis=time_axis(run))
    for i, axis in enumerate(shown.names):
        place = {"xaxis": "x", "yaxis": f"y{i + 1}" if i else "y"}
        bound = np.where(known, np.rad2deg(shown.half_widths[rows, i]), np.nan)
        traces.append(_bound_trace(run.times[rows], bound, i) | place)
        if shown.errors is not None and run.compared.any():
            error = np.rad2deg(shown.errors[rows, i])
            outside = np.abs(error) - np.rad2deg(run.reference_error) > bound
            traces.append(_error_trace(_times(run, rows), error, i, label) | place)
            if outside.any():
                is_first = not any(trace["name"] == _OUTSIDE for trace in traces)
                traces.append(_outside_trace(_times(run, rows[outside]), error[outside], is_first) | place)
        layout[f"yaxis{i + 1}" if i else "yaxis"] = {
            "title": {"text": f"about {axis} (deg)"},
            "zeroline": True,
            "range": [-limit, limit],
        }
    return {"data": traces, "layout": layout}


def _angles(run: Run, rows: NDArray[np.intp], angles: FloatArray, label: str) -> dict[str, Any]:
    """Roll, pitch and yaw, a panel each, in bands between the angles that the truth may have."""
    time = run.times[rows]
    true = None if run.errors is None else true_roll_pitch_yaw(run.attitudes[rows], run.errors[rows])
    traces: list[dict[str, Any]] = []
    layout = plot_layout(grid={"rows": 3, "columns": 1, "pattern": "coupled"}, xaxis=time_axis(run))
    for i, name in enumerate(("roll", "pitch", "yaw")):
        place = {"xaxis": "x", "yaxis": f"y{i + 1}" if i else "y"}
        value, least, most = np.rad2deg(angles[:, 3 * i : 3 * i + 3]).T
        goes_around = i != 1 and bool((np.nanmin(least, initial=0.0) < -180.0) | (np.nanmax(most, initial=0.0) > 180.0))
        cut_time, cut_value, cut_least, cut_most = cut_at_wraps(time, value, least, most)
        # What reaches beyond half a turn comes in again at the other side.
        thin = {"line": {"color": _LIGHT_BLUE, "width": 0.5}}  # fast turns would draw the edges over all
        for around in (0.0, -360.0, 360.0) if goes_around else (0.0,):
            x, y = _band(cut_time, cut_most + around, cut_least + around)
            traces.append(_band_trace("where it may be", x, y, is_first=i == 0 and not around) | place | thin)
        line = {"color": _MIDDLE_BLUE, "width": 1.5}
        traces.append(_angle_trace("as estimated", cut_time, cut_value, i == 0) | {"line": line} | place)
        if true is not None and run.compared.any():
            cut = cut_at_wraps(time, np.rad2deg(true[:, i]))
            inked = {"line": {"width": 1.2}, "meta": "ink"}
            traces.append(_angle_trace(label, cut[0], cut[1], i == 0) | inked | place)
        layout[f"yaxis{i + 1}" if i else "yaxis"] = {"title": {"text": f"{name} (deg)"}} | (
            {"range": [-180.0, 180.0], "dtick": 90} if goes_around else {}
        )
    return {"data": traces, "layout": layout}


def _lines(name: str, x: Sequence[float | None], y: Sequence[float | None], is_first: bool) -> dict[str, Any]:
    """A curve that shares its entry of the legend with others of its name."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "legendgroup": name,
        "showlegend": is_first,
        "x": x,
        "y": y,
    }


def _angle_trace(name: str, time: FloatArray, angle: FloatArray, is_first: bool) -> dict[str, Any]:
    """An angle over time, degrees."""
    return _lines(name, [float(one) for one in time], _list(angle), is_first)


def _bound_trace(times: FloatArray, bound: FloatArray, i: int) -> dict[str, Any]:
    """The band of the error about axis i."""
    x, y = _band(times, bound, -bound)
    return _band_trace("bound", x, y, is_first=i == 0)


def _band_trace(name: str, x: list[float | None], y: list[float | None], *, is_first: bool) -> dict[str, Any]:
    """A band by its outline."""
    return _lines(name, x, y, is_first) | {
        "fill": "toself",
        "fillcolor": _LIGHT_BLUE,
        "line": {"color": _BLUE, "width": 1},
        "hoverinfo": "skip",
    }


def _error_trace(times: list[float], error: FloatArray, i: int, label: str) -> dict[str, Any]:
    """The error about axis i."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": f"error against {label}",
        "legendgroup": "error",
        "showlegend": i == 0,
        "x": times,
        "y": _list(error),
        "line": {"width": 1.2},
        "meta": "ink",
    }


def _outside_trace(times: list[float], error: FloatArray, is_first: bool) -> dict[str, Any]:
    """The rows whose error is outside the band."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": _OUTSIDE,
        "legendgroup": "outside",
        "x": times,
        "y": _list(error),
        "marker": {"color": _ORANGE, "symbol": "x", "size": 7},
        "showlegend": is_first,
    }


def _band(time: FloatArray, highest: FloatArray, lowest: FloatArray) -> tuple[list[float | None], list[float | None]]:
    """The outline of a band, closed for each piece between gaps."""
    known = np.flatnonzero(np.isfinite(highest))
    x: list[float | None] = []
    y: list[float | None] = []
    for piece in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        around = np.concatenate([piece, piece[::-1], piece[:1]])
        sides = np.concatenate([highest[piece], lowest[piece[::-1]], highest[piece[:1]]])
        x += [*time[around].tolist(), None]
        y += [*_list(sides), None]
    return x, y


def _strip(run: Run, spells: list[Spell]) -> dict[str, Any]:
    """A lane for the claim, and one for each sensor that was left out."""
    traces: list[dict[str, Any]] = []
    lanes: list[str] = []
    bars_of = pieces_between_gaps(run, PIECES, float(run.times[-1]))
    begins, ends = (np.array([getattr(piece, name) for piece in bars_of]) for name in ("begin", "end"))
    some = [piece.rows for piece in bars_of]

    def bars(lane: str, words: Sequence[str], colours: Mapping[str, str], legend: Callable[[str], str]) -> None:
        lanes.append(lane)
        for kind, colour in colours.items():
            chosen = [i for i, word in enumerate(words) if word == kind]
            if chosen:
                traces.append(
                    {
                        "type": "bar",
                        "orientation": "h",
                        "name": legend(kind),
                        "y": [lane] * len(chosen),
                        "base": _list(begins[chosen]),
                        "x": _list((ends - begins)[chosen]),
                        "marker": {"color": colour, "line": {"width": 0}},
                        "hoverinfo": "name",
                    }
                )

    def claimed(claim: str) -> str:
        return claim_label(claim, run.bounds_from_recording)

    if run.claims is not None:
        bars("claim", worst_claims(run.claims, some), CLAIM_COLOURS, lambda claim: f"claim: {claimed(claim)}")
    if (of_up := claims_of_up(run)) is not None:
        bars("claim of up", worst_claims(of_up, some), CLAIM_COLOURS, lambda claim: f"claim of up: {claimed(claim)}")
    if run.prediction_used is not None:
        shares = prediction_shares(run.prediction_used, some)
        bars("prediction used", shares, PREDICTION_COLOURS, "prediction used: {}".format)
    for name in sorted({name for spell in spells for name in spell.sensors.split()}):
        own = [spell for spell in spells if name in spell.sensors.split()]
        lane = f"{name} left out"
        lanes.append(lane)
        # A line from first to last with marks at both ends, so that a single measurement is visible too.
        traces.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": lane,
                "showlegend": False,
                "x": [value for spell in own for value in (spell.first, spell.last, None)],
                "y": [lane, lane, None] * len(own),
                "line": {"width": 5},
                "marker": {"symbol": "line-ns-open", "size": 12, "line": {"width": 2}},
                "meta": "ink",
            }
        )
    # In two lines, as a phone is narrow.
    names = ["prediction<br>used" if lane == "prediction used" else lane for lane in lanes]
    layout = plot_layout(
        barmode="overlay",
        height=65 + 30 * len(lanes),
        xaxis=time_axis(run),
        yaxis={"categoryorder": "array", "categoryarray": lanes[::-1], "automargin": True}
        | {"tickmode": "array", "tickvals": lanes, "ticktext": names},
        showlegend=False,
        hovermode="closest",
    )
    return {"data": traces, "layout": layout}
