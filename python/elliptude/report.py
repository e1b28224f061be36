"""An interactive report of a run in one HTML file, which needs no network: Plotly's program is inside.

Curves are drawn at chosen rows (`elliptude.thinning.chosen_rows`), the sphere at up to `FRAMES` times; the numbers in
the summary are of all rows.
"""

import base64
import json
import os
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude.body_axes import axis_patches
from elliptude.figures import error_limit, log_ticks
from elliptude.files import FileError, replacing
from elliptude.results import CLAIMS, FloatArray
from elliptude.run_figures import AXIS_COLOURS, CLAIM_COLOURS, PREDICTION_COLOURS, TILT_COLOUR, time_text
from elliptude.runs import SPELL_GAP, DroppedMeasurements, Run, Spell
from elliptude.thinning import chosen_rows, largest_of_each, pieces, prediction_shares, worst_claims

FRAMES = 240
"""Times at which the sphere is drawn."""
PIECES = 500
"""Of rows, of each of which the extremes are drawn."""
LISTED = 500
"""Spells of measurements left out that the report lists."""
EACH_LISTED = 20_000
"""Measurements left out that it lists one by one."""

# Spells that are shown without being asked for.
_OPEN = 12
_MERIDIANS, _RINGS = 36, 4
_INT16 = 32767
_NOT_KNOWN = -32768
# Of the names of lanes, px; all plots over time have it, so that their times are below one another.
_LANES_WIDTH = 110
_BLUE, _ORANGE = "#0072B2", "#D55E00"
_DASHES = ("solid", "dash", "dashdot")


def summarize(run: Run, label: str) -> dict[str, Any]:
    """The figures of a run: plain numbers, None for what is not known.

    Parameters
    ----------
    run : Run
    label : str
        What it is compared with.

    Returns
    -------
    dict
        Angles in degrees, times in seconds.
    """
    known, count = run.known, len(run.times)
    widths, largest = np.rad2deg(run.half_widths[known]), np.rad2deg(run.largest_angles[known])
    compared, escaped = run.compared, run.escaped & run.compared
    spells = run.refusal_spells()
    summary: dict[str, Any] = {
        "rows": count,
        "first_s": float(run.times[0]),
        "last_s": float(run.times[-1]),
        "median_rate_hz": float(1.0 / np.median(np.diff(run.times))) if count > 1 else None,
        "rows_with_a_set": int(known.sum()),
        "rows_with_an_update": sum(bool(names) for names in run.used),
        "claims": None if run.claims is None else {claim: int(run.claimed(claim).sum()) for claim in CLAIMS},
        "largest_angle_deg": _spread(largest),
        "half_width_deg": {axis: _spread(widths[:, i]) for i, axis in enumerate("xyz")},
        "left_out": {
            what: sum(spell.measurements for spell in spells if spell.what == what) for what in ("dropped", "refused")
        },
        "heading_from_start": run.heading_from_start,
        "compared_with": label if compared.any() else None,
    }
    if run.dropped is None and run.listed is None:
        del summary["left_out"]["dropped"]
    if run.listed is not None:
        summary["left_out"]["own bound"] = sum(why == "own_bound" for why in run.listed.contradicts)
    if run.void:
        summary["left_out_from_beginning_to_end"] = list(run.void)
    if run.tilt_bounds is not None:
        summary["tilt_bound_deg"] = _spread(np.rad2deg(run.tilt_bounds[known]))
    if run.prediction_used is not None:
        summary["prediction_used_rows"] = int((run.prediction_used[known] == 1.0).sum())
    if compared.any():
        assert run.errors is not None
        summary |= {
            "rows_compared": int(compared.sum()),
            "escapes": int(escaped.sum()),
            "first_escape_s": float(run.times[np.argmax(escaped)]) if escaped.any() else None,
            "escapes_by_claim": None
            if run.claims is None
            else {claim: int((escaped & run.claimed(claim)).sum()) for claim in CLAIMS},
            "reference_error_deg": float(np.rad2deg(run.reference_error)),
            "error_deg": _spread(np.rad2deg(np.linalg.norm(run.errors[compared], axis=1))),
        }
    return summary


def _spread(values: FloatArray) -> dict[str, float] | None:
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {"median": float(np.median(values)), "mean": float(values.mean()), "largest": float(values.max())}


def write_report(run: Run, path: str | os.PathLike[str], title: str, *, label: str = "truth") -> dict[str, Any]:
    """Write the report, in whole or not at all.

    Parameters
    ----------
    run : Run
    path : path-like
        Of the HTML file.
    title : str
    label : str
        What the run is compared with.

    Returns
    -------
    dict
        Of `summarize`, with what was left out of the pictures as ``drawn``.

    Raises
    ------
    FileError
        If plotly is not installed, or the file cannot be written.
    """
    plotly = plotly_script()
    rows, shown = chosen_rows(run, PIECES), _frame_rows(run)
    summary = summarize(run, label)
    summary["drawn"] = {"rows_of_curves": len(rows), "times_on_sphere": len(shown)}
    spells = run.refusal_spells()
    each = _each(run.listed)
    plots = _plots(run, rows, label, spells)
    data = {"plots": plots, "frames": _frames(run, shown), "dropped": each}
    compares = summary["compared_with"] is not None
    parts = {
        "version": elliptude.__version__,
        "title": escape(title),
        "css": _text("report.css"),
        "summary": _summary_table(summary),
        "key": _key(label if compares else None),
        "magnified": _magnified(run.magnification(shown)),
        "bands_heading": "Attitude error and its bound" if compares else "Bound of the attitude error",
        "strip_hidden": "" if "strip" in plots else "hidden",
        "strip_heading": _strip_heading(run, spells),
        "strip_key": _strip_key(run),
        "size_note": "The tilt is the angle between estimated and true up. " if run.tilt_bounds is not None else "",
        "dropped": _spell_table(spells),
        "each_hidden": "hidden" if each is None else "",
        "footnote": _footnote(run, len(rows), len(shown)),
        "plotly": plotly,
        # "</script>" in a name would end the script.
        "data": json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "script": _text("report.js"),
    }
    page = _text("report.html")
    pieces_of_page = page.split("@")
    # Between two @ stands a name.
    pieces_of_page[1::2] = [parts[name] for name in pieces_of_page[1::2]]
    with replacing(path) as temporary:
        temporary.write_text("".join(pieces_of_page), encoding="utf-8")
    return summary


def plotly_script() -> str:
    """Plotly as JavaScript.

    Raises
    ------
    FileError
        If plotly is not installed.
    """
    try:
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError as error:
        raise FileError("a report needs plotly: pip install 'elliptude[report]'") from error
    script: str = get_plotlyjs()
    return script


def _text(name: str) -> str:
    return (resources.files("elliptude") / "data" / "report" / name).read_text(encoding="utf-8")


# --- tables -----------------------------------------------------------------------------------------------------------


def _summary_table(summary: dict[str, Any]) -> str:
    rate, count = summary["median_rate_hz"], summary["rows"]
    lines = [
        (
            "rows",
            f"{count}, {_seconds(summary['first_s'])} s to {_seconds(summary['last_s'])} s"
            + (f", {rate:.4g} Hz" if rate else ""),
        ),
        ("rows with an update", f"{summary['rows_with_an_update']}"),
    ]
    if summary["rows_with_a_set"] < count:
        lines.append(("rows of which nothing is known", f"{count - summary['rows_with_a_set']}"))
    if summary["claims"] is not None:
        shares = [f"{claim} {_share(number, count)}" for claim, number in summary["claims"].items()]
        lines.append(("claim", ", ".join(shares)))
    lines.append(("largest angle in the set", _degrees(summary["largest_angle_deg"])))
    lines += [(f"half-width about {axis}", _degrees(spread)) for axis, spread in summary["half_width_deg"].items()]
    if "tilt_bound_deg" in summary:
        lines.append(("bound of the tilt", _degrees(summary["tilt_bound_deg"])))
    if "prediction_used_rows" in summary and summary["rows_with_a_set"]:
        number = summary["prediction_used_rows"]
        share = _share(number, summary["rows_with_a_set"])
        lines.append(("prediction used", f"{number} rows, {share} of those with a set"))
    if summary["heading_from_start"]:
        lines.append(("heading", "counts from the first row, as nothing told it"))
    names = {
        "dropped": "measurements dropped",
        "refused": "measurements refused",
        "own bound": "measurements beyond their own bound",
    }
    lines += [(names[what], f"{number}") for what, number in summary["left_out"].items()]
    if "left_out_from_beginning_to_end" in summary:
        lines.append(("left out from beginning to end", ", ".join(summary["left_out_from_beginning_to_end"])))
    cells = [(escape(name), escape(text)) for name, text in lines]
    if summary["compared_with"] is None:
        cells.append(("compared with", "nothing: there is no reference"))
    else:
        compared = f"{escape(summary['compared_with'])}, at {summary['rows_compared']} rows"
        if summary["reference_error_deg"]:
            compared += f"; it may itself be off by {summary['reference_error_deg']:.3g}°"
        cells.append(("compared with", compared))
        cells.append(("error", _degrees(summary["error_deg"])))
        escapes = f"{summary['escapes']} ({_share(summary['escapes'], summary['rows_compared'])})"
        if summary["escapes"]:
            if summary["escapes_by_claim"] is not None:
                escapes += ", " + ", ".join(
                    f"{number} {claim}" for claim, number in summary["escapes_by_claim"].items()
                )
            escapes = f'<span class="warn">{escapes}; the first at {_seconds(summary["first_escape_s"])} s</span>'
        cells.append(("outside the set", escapes))
    body = "\n".join(f'<tr><th scope="row">{name}</th><td>{text}</td></tr>' for name, text in cells)
    return f"<table>\n{body}\n</table>"


def _seconds(time: float) -> str:
    """To a microsecond, of any size."""
    return f"{time:.6f}".rstrip("0").rstrip(".")


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'s' if number != 1 else ''}"


def _share(number: int, of: int) -> str:
    return f"{100.0 * number / of:.4g} %"


def _degrees(spread: dict[str, float] | None) -> str:
    if spread is None:
        return "not known"
    return f"median {spread['median']:.3g}°, mean {spread['mean']:.3g}°, at most {spread['largest']:.3g}°"


def _spell_table(spells: list[Spell]) -> str:
    if not spells:
        return "<p>None.</p>"
    lines = "\n".join(
        f"<tr><td>{_seconds(spell.first)}</td><td>{_seconds(spell.last)}</td><td>{escape(spell.sensors)}</td>"
        f"<td>{spell.what}</td><td>{spell.measurements}</td></tr>"
        for spell in spells[:LISTED]
    )
    more = f"<p>And {len(spells) - LISTED} more spells: see the table of results.</p>" if len(spells) > LISTED else ""
    return (
        '<p class="faint">Dropped: this measurement alone contradicted the others. Refused: the sets of its row did '
        "not meet, and none of them was used. Own bound: it contradicts what is stated of its sensor, whatever the "
        f"attitude. Up to {SPELL_GAP:g} s apart they are one line.</p>\n"
        f"<details{' open' if len(spells) <= _OPEN else ''}><summary>{_counted(len(spells), 'spell')}</summary>\n"
        '<div class="scroll tall"><table><thead>\n'
        '<tr><th scope="col">from s</th><th scope="col">to s</th><th scope="col">sensors</th><th scope="col">why</th>'
        f'<th scope="col">measurements</th></tr>\n</thead><tbody>\n{lines}\n</tbody></table></div></details>\n{more}'
    )


def _each(listed: DroppedMeasurements | None) -> dict[str, Any] | None:
    """Measurements left out, column by column; the farthest off where there are very many."""
    if listed is None or not len(listed.times):
        return None
    count = len(listed.times)
    rows = np.arange(count)
    if count > EACH_LISTED:
        rows = np.sort(np.argsort(listed.margins, kind="stable")[:EACH_LISTED])
    return {
        "total": count,
        "time": [float(_seconds(time)) for time in listed.times[rows]],
        "place": [listed.places[row] for row in rows],
        "sensor": [listed.sensors[row] for row in rows],
        "why": ["its own bound" if listed.contradicts[row] == "own_bound" else "the prediction" for row in rows],
        "margin": [float(f"{margin:.4g}") for margin in listed.margins[rows]],
        "unit": [_unit(listed.units[row]) for row in rows],
    }


def _strip_key(run: Run) -> str:
    """What the colours of the strip mean; of the claims those that are made."""
    colours = {claim: colour for claim, colour in CLAIM_COLOURS.items() if claim in (run.claims or ())}
    entries = [(f"claim: {claim}", colour) for claim, colour in colours.items()]
    if run.prediction_used is not None:
        entries += [(f"prediction used: {where}", colour) for where, colour in PREDICTION_COLOURS.items()]
    return "".join(f'<span><i style="background:{colour}"></i>{text}</span>' for text, colour in entries)


def _key(label: str | None) -> str:
    entries = [
        f'<span><i style="background:{colour}"></i>body {axis}</span>'
        for colour, axis in zip(AXIS_COLOURS, "xyz", strict=True)
    ]
    if label is not None:
        entries.append(f'<span><i style="background:var(--ink)"></i>{escape(label)}</span>')
    return "".join(entries)


def _magnified(factor: int) -> str:
    if factor == 1:
        return "Each patch is the exact image of the set of attitudes:"
    return (
        f"<strong>Sets and errors are drawn {factor} times as large</strong>, or they would be dots. Each patch "
        "is the exact image of the set of attitudes, so magnified:"
    )


def _strip_heading(run: Run, spells: list[Spell]) -> str:
    """What the strip has, as a heading."""
    parts = ["claims"] * (run.claims is not None) + ["use of the prediction"] * (run.prediction_used is not None)
    parts += ["measurements left out"] * bool(spells and run.listed is None)
    return " and ".join([", ".join(parts[:-1])] * (len(parts) > 1) + parts[-1:]).capitalize()


def _footnote(run: Run, rows: int, frames: int) -> str:
    count = len(run.times)
    text = f"The numbers are of all {count} rows. The sphere is drawn at {frames} of them, evenly in time"
    text += ", and where the set is largest" + (" and the reference farthest out." if run.forms is not None else ".")
    if rows < count:
        text += (
            f" The curves are drawn at {rows} of them: of each of {len(pieces(count, PIECES))} pieces the rows with "
            "the extremes of set and error, so that nothing that stands out is missing."
        )
    return f"{text} elliptude {elliptude.__version__}"


# --- pictures ---------------------------------------------------------------------------------------------------------


def _plots(run: Run, rows: NDArray[np.intp], label: str, spells: list[Spell]) -> dict[str, Any]:
    """Plotly's data and layout for each place in the page."""
    # What the list has is marked below the size of the set.
    if run.listed is not None:
        spells = [spell for spell in spells if spell.what == "refused"]
    plots = {
        "size": _size(run, rows),
        "bands": _bands(run, rows, label),
        "sphere": _sphere(bool(run.compared.any()), label),
    }
    if run.claims is not None or run.prediction_used is not None or spells:
        plots["strip"] = _strip(run, spells)
    if "strip" in plots or "yaxis2" in plots["size"]["layout"]:
        for name in ("size", "bands", "strip"):
            if name in plots:
                plots[name]["layout"]["margin"]["l"] = _LANES_WIDTH
    return plots


def _list(values: FloatArray) -> list[float | None]:
    """For JSON, to six digits; None where there is nothing."""
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]


def _times(run: Run, rows: NDArray[np.intp]) -> list[float]:
    return [float(time) for time in run.times[rows]]


def _time_axis(run: Run) -> dict[str, Any]:
    """The same for all plots, so that they can be compared; times since 1970 are no "1.7B"."""
    first, last = float(run.times[0]), float(run.times[-1])
    return {
        "title": {"text": "time (s)"},
        "range": [first, last] if last > first else [first - 0.5, first + 0.5],
        "exponentformat": "none",
        "hoverformat": ".6~f",
    }


def _layout(**more: Any) -> dict[str, Any]:
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
    time, known = _times(run, rows), run.known[rows]
    traces = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": f"half-width about {axis}",
            "x": time,
            "y": _list(np.where(known, np.rad2deg(run.half_widths[rows, i]), np.nan)),
            "line": {"color": AXIS_COLOURS[i], "dash": _DASHES[i], "width": 1.5},
        }
        for i, axis in enumerate("xyz")
    ]
    largest = np.where(known, np.rad2deg(run.largest_angles[rows]), np.nan)
    traces.append(
        {
            "type": "scatter",
            "mode": "lines",
            "name": "largest angle",
            "x": time,
            "y": _list(largest),
            "line": {"width": 2},
            "meta": "ink",
        }
    )
    if run.tilt_bounds is not None:
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "bound of the tilt",
                "x": time,
                "y": _list(np.where(known, np.rad2deg(run.tilt_bounds[rows]), np.nan)),
                "line": {"color": TILT_COLOUR, "dash": "dot", "width": 1.5},
            }
        )
    scale = "log" if known.any() and (largest[known] > 0.0).all() else "linear"
    axis: dict[str, Any] = {"title": {"text": "angle (deg)"}, "type": scale}
    if scale == "log":
        drawn = [run.half_widths[rows].ravel(), run.largest_angles[rows]]
        drawn += [] if run.tilt_bounds is None else [run.tilt_bounds[rows]]
        angles = np.rad2deg(np.concatenate(drawn))
        ticks = log_ticks(float(angles[angles > 0.0].min()), float(np.nanmax(angles)))
        axis |= {"tickmode": "array", "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    layout = _layout(xaxis=_time_axis(run), yaxis=axis)
    if run.listed is not None and len(run.listed.times):
        marks = _drop_marks(run, run.listed)
        height = min(0.07 * len(marks), 0.3)
        layout["xaxis"] |= {"anchor": "y2"}
        layout["yaxis"] |= {"domain": [height + 0.04, 1.0]}
        layout["yaxis2"] = {"domain": [0.0, height], "automargin": True, "dtick": 1, "showgrid": False}
        traces += marks
    return {"data": traces, "layout": layout}


def _drop_marks(run: Run, listed: DroppedMeasurements) -> list[dict[str, Any]]:
    """A lane of marks for each sensor that was left out; of those that would hide one another the farthest off."""
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


def _unit(name: str) -> str:
    return name.replace("^2", "²").replace("uT", "µT")


def _why(listed: DroppedMeasurements, row: int) -> str:
    margin, place = listed.margins[row], listed.places[row]
    if listed.contradicts[row] == "own_bound":
        return f"{place}, {-margin:.3g} {_unit(listed.units[row])} beyond its own bound"
    return f"{place}, contradicts the prediction, margin {margin:.3g}"


def _bands(run: Run, rows: NDArray[np.intp], label: str) -> dict[str, Any]:
    time, known = _times(run, rows), run.known[rows]
    traces: list[dict[str, Any]] = []
    bounds, errors = run.half_widths[rows][known], None if run.errors is None else run.errors[rows][known]
    limit = np.rad2deg(error_limit(bounds, errors)) if known.any() else 1.0
    layout = _layout(grid={"rows": 3, "columns": 1, "pattern": "coupled"}, xaxis=_time_axis(run))
    for i, axis in enumerate("xyz"):
        place = {"xaxis": "x", "yaxis": f"y{i + 1}" if i else "y"}
        bound = np.where(known, np.rad2deg(run.half_widths[rows, i]), np.nan)
        x, y = _band(run.times[rows], bound)
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "bound",
                "legendgroup": "bound",
                "showlegend": i == 0,
                "x": x,
                "y": y,
                "fill": "toself",
                "fillcolor": "rgba(0,114,178,0.22)",
                "line": {"color": _BLUE, "width": 1},
                "hoverinfo": "skip",
                **place,
            }
        )
        if run.errors is not None and run.compared.any():
            error = np.rad2deg(run.errors[rows, i])
            outside = np.abs(error) - np.rad2deg(run.reference_error) > bound
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": f"error against {label}",
                    "legendgroup": "error",
                    "showlegend": i == 0,
                    "x": time,
                    "y": _list(error),
                    "line": {"width": 1.2},
                    "meta": "ink",
                    **place,
                }
            )
            if outside.any():
                traces.append(
                    {
                        "type": "scatter",
                        "mode": "markers",
                        "name": "outside the band",
                        "legendgroup": "outside",
                        "x": _times(run, rows[outside]),
                        "y": _list(error[outside]),
                        "marker": {"color": _ORANGE, "symbol": "x", "size": 7},
                        "showlegend": not any(trace["name"] == "outside the band" for trace in traces),
                        **place,
                    }
                )
        layout[f"yaxis{i + 1}" if i else "yaxis"] = {
            "title": {"text": f"about {axis} (deg)"},
            "zeroline": True,
            "range": [-limit, limit],
        }
    return {"data": traces, "layout": layout}


def _band(time: FloatArray, bound: FloatArray) -> tuple[list[float | None], list[float | None]]:
    """The outline of -bound to bound, a closed one for each piece between gaps."""
    known = np.flatnonzero(np.isfinite(bound))
    x: list[float | None] = []
    y: list[float | None] = []
    for piece in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        around = np.concatenate([piece, piece[::-1], piece[:1]])
        sides = np.concatenate([bound[piece], -bound[piece[::-1]], bound[piece[:1]]])
        x += [*time[around].tolist(), None]
        y += [*_list(sides), None]
    return x, y


def _strip(run: Run, spells: list[Spell]) -> dict[str, Any]:
    """A lane for the claim, and one for each sensor that was left out."""
    traces: list[dict[str, Any]] = []
    lanes: list[str] = []
    some = pieces(len(run.times), PIECES)
    edges = np.append(run.times[[piece.start for piece in some]], run.times[-1])

    def bars(lane: str, words: Sequence[str], colours: Mapping[str, str], legend: str) -> None:
        lanes.append(lane)
        for kind, colour in colours.items():
            chosen = [i for i, word in enumerate(words) if word == kind]
            if chosen:
                traces.append(
                    {
                        "type": "bar",
                        "orientation": "h",
                        "name": legend.format(kind),
                        "y": [lane] * len(chosen),
                        "base": _list(edges[chosen]),
                        "x": _list(np.diff(edges)[chosen]),
                        "marker": {"color": colour, "line": {"width": 0}},
                        "hoverinfo": "name",
                    }
                )

    if run.claims is not None:
        bars("claim", worst_claims(run.claims, some), CLAIM_COLOURS, "claim: {}")
    if run.prediction_used is not None:
        shares = prediction_shares(run.prediction_used, some)
        bars("prediction used", shares, PREDICTION_COLOURS, "prediction used: {}")
    for name in sorted({name for spell in spells for name in spell.sensors.split()}):
        own = [spell for spell in spells if name in spell.sensors.split()]
        lane = f"{name} left out"
        lanes.append(lane)
        # A line from first to last, and marks at both ends: a single measurement is seen too.
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
    layout = _layout(
        barmode="overlay",
        height=65 + 30 * len(lanes),
        xaxis=_time_axis(run),
        yaxis={"categoryorder": "array", "categoryarray": lanes[::-1], "automargin": True, "dtick": 1},
        showlegend=False,
        hovermode="closest",
    )
    return {"data": traces, "layout": layout}


# --- the sphere -------------------------------------------------------------------------------------------------------


def _frame_rows(run: Run) -> NDArray[np.intp]:
    """Rows evenly in time, the one with the largest set, and the one whose reference is farthest out."""
    wanted = np.linspace(run.times[0], run.times[-1], FRAMES)
    after = np.searchsorted(run.times, wanted).clip(max=len(run.times) - 1)
    before = np.maximum(after - 1, 0)
    rows = np.where(wanted - run.times[before] < run.times[after] - wanted, before, after).tolist()
    for score in (run.largest_angles, run.forms):
        if score is not None and np.isfinite(score).any():
            rows.append(int(np.nanargmax(score)))
    return np.unique(rows)


def _frames(run: Run, rows: NDArray[np.intp]) -> dict[str, Any]:
    """What moves on the sphere."""
    factor = run.magnification(rows)
    attitudes = run.attitudes[rows]
    attitudes[~run.known[rows]] = np.nan
    shapes = factor**2 * run.shapes[rows]
    patches = np.stack(
        [axis_patches(attitudes, shapes, i, chart=run.chart, meridians=_MERIDIANS, rings=_RINGS) for i in range(3)],
        axis=1,
    )
    marks = run.true_axes(factor)[rows].swapaxes(1, 2) if run.compared.any() else None
    return {
        "vertices": _RINGS * _MERIDIANS,
        "meridians": _MERIDIANS,
        "patches": _packed(patches),
        "tips": _packed(attitudes.swapaxes(1, 2)),
        "marks": None if marks is None else _packed(marks),
        "times": _times(run, rows),
        "labels": [_frame_label(run, int(row), bool(np.isfinite(patches[i]).all())) for i, row in enumerate(rows)],
        "patch_traces": [_STILL, _STILL + 1, _STILL + 2],
        "rim_traces": [_STILL + 3, _STILL + 4, _STILL + 5],
        "tip_traces": [_STILL + 6, _STILL + 7, _STILL + 8],
        "mark_trace": _STILL + 9,
    }


def _frame_label(run: Run, row: int, is_drawn: bool) -> str:
    parts = [f"{time_text(run, row)} s"]
    if not run.known[row]:
        return f"{parts[0]}: nothing is known"
    parts.append(f"within {np.rad2deg(run.largest_angles[row]):.3g}°")
    if not is_drawn:
        parts.append("too large to draw")
    if run.tilt_bounds is not None and np.isfinite(run.tilt_bounds[row]):
        parts.append(f"up within {np.rad2deg(run.tilt_bounds[row]):.3g}°")
    if run.claims is not None and run.claims[row]:
        parts.append(f"claim: {run.claims[row]}")
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


def _triangles(meridians: int, rings: int) -> tuple[list[int], list[int], list[int]]:
    """Of a disc whose vertices are rings of meridians; the last ring is a point."""
    i, j, k = [], [], []
    for ring in range(rings - 1):
        for one in range(meridians):
            other = (one + 1) % meridians
            a, b = ring * meridians + one, ring * meridians + other
            c, d = a + meridians, b + meridians
            i += [a, b]
            j += [b, d]
            k += [c, c]
    return i, j, k


def _globe() -> dict[str, Any]:
    """The sphere of directions, below the patches, which are flat between their vertices."""
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
    """Where the planes of the reference axes meet the sphere, and these axes themselves."""
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


def _sphere(compares: bool, label: str) -> dict[str, Any]:
    i, j, k = _triangles(_MERIDIANS, _RINGS)
    nothing: dict[str, list[float | None]] = {"x": [None], "y": [None], "z": [None]}
    names = {
        "type": "scatter3d",
        "mode": "text",
        **{axis: [1.3 * float(tip) for tip in row] for axis, row in zip("xyz", np.eye(3), strict=True)},
        "text": ["X", "Y", "Z"],
        "hoverinfo": "skip",
    }
    traces: list[dict[str, Any]] = [_globe(), _circles(), names]
    for axis, colour in zip("xyz", AXIS_COLOURS, strict=True):
        traces.append(
            {
                "type": "mesh3d",
                "name": f"body {axis}",
                **{name: [0.0] * (_RINGS * _MERIDIANS) for name in "xyz"},
                "i": i,
                "j": j,
                "k": k,
                "color": colour,
                "flatshading": True,
                "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0},
                "hoverinfo": "name",
            }
        )
    for axis, colour in zip("xyz", AXIS_COLOURS, strict=True):
        traces.append(
            {
                "type": "scatter3d",
                "mode": "lines",
                "name": f"rim of body {axis}",
                **nothing,
                "line": {"color": colour, "width": 4},
                "hoverinfo": "skip",
            }
        )
    for axis, colour in zip("xyz", AXIS_COLOURS, strict=True):
        traces.append(
            {
                "type": "scatter3d",
                "mode": "lines+text",
                "name": f"estimated body {axis}",
                **nothing,
                "text": ["", axis],
                "textfont": {"color": colour, "size": 26},
                "line": {"color": colour, "width": 5},
                "hoverinfo": "name",
            }
        )
    if compares:
        traces.append(
            {
                "type": "scatter3d",
                "mode": "markers",
                "name": label,
                **nothing,
                "marker": {"size": 4},
                "meta": "ink",
                "hoverinfo": "name",
            }
        )
    hidden = {"visible": False, "range": [-1.35, 1.35]}
    layout = _layout(
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        showlegend=False,
        hovermode="closest",
        scene={
            "xaxis": hidden,
            "yaxis": hidden,
            "zaxis": hidden,
            "aspectmode": "manual",
            "aspectratio": {"x": 1.9, "y": 1.9, "z": 1.9},
            "camera": {"eye": {"x": 1.15, "y": 0.8, "z": 0.65}, "projection": {"type": "orthographic"}},
            "dragmode": "orbit",
        },
        uirevision="kept",
    )
    return {"data": traces, "layout": layout}
