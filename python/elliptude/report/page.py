"""An interactive report of a run in one HTML file, which needs no network: Plotly's program is inside.

Curves are drawn at chosen rows (`elliptude.report.thinning.chosen_rows`), the sphere at up to
`elliptude.report.axes.sphere.FRAMES` times; the numbers in the summary are of all rows.
"""

import json
import os
from dataclasses import replace
from html import escape
from importlib import resources
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude.bounds.angles.about_axes import ErrorAxes
from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT, UP, half_width, tilt_beyond_set
from elliptude.io.files import FileError, replacing
from elliptude.report.axes.sphere import frame_rows, sphere_frames, sphere_plot
from elliptude.report.curves import AMBER, GREY, PIECES, plots_over_time
from elliptude.report.estimated.curves import measured_plot
from elliptude.report.figures import BLUE
from elliptude.report.run import SPELL_GAP, DroppedMeasurements, Run, Spell
from elliptude.report.run_figures import AXIS_COLOURS, CLAIM_COLOURS, PREDICTION_COLOURS, claim_label
from elliptude.report.thinning import chosen_rows, pieces
from elliptude.results import CLAIMS, IF_PROPOSED_BOUNDS_HOLD
from elliptude.typing import FloatArray
from elliptude.units import readable_unit

LISTED = 500
"""How many spells of left-out measurements the report lists."""
EACH_LISTED = 20_000
"""How many left-out measurements it lists one by one."""

_CONTRADICTED = {"own_bound": "its own bound", "prediction_of_up": "the prediction of up"}

# How many spells are visible at first.
_OPEN = 12


def summarize(run: Run, label: str) -> dict[str, Any]:
    """The figures of a run: plain numbers; None for what is not known.

    Parameters
    ----------
    run : Run
    label : str
        What the run is compared with.

    Returns
    -------
    dict
        Angles in degrees, times in seconds.
    """
    known, count = run.known, len(run.times)
    reference, body = (replace(run, axes=axes).about_axes() for axes in get_args(ErrorAxes))
    widths, largest = np.rad2deg(body.half_widths[known]), np.rad2deg(run.largest_angles[known])
    about_reference = np.rad2deg(reference.half_widths[known])
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
        "half_width_reference_deg": {name: _spread(about_reference[:, i]) for i, name in enumerate(reference.names)},
        "axes": run.axes,
        "left_out": {
            what: sum(spell.measurements for spell in spells if spell.what == what) for what in ("dropped", "refused")
        },
        "heading_from_start": run.heading_from_start,
        "gaps": list(run.gaps),
        "smoothing": list(run.smoothing),
        "compared_with": label if compared.any() else None,
    }
    if run.dropped is None and run.listed is None:
        del summary["left_out"]["dropped"]
    if run.listed is not None:
        summary["left_out"]["own bound"] = sum(why == "own_bound" for why in run.listed.contradicts)
    summary |= _where_it_is_known(run)
    if compared.any():
        summary |= _against_the_reference(run, compared, escaped)
    return summary


def _where_it_is_known(run: Run) -> dict[str, Any]:
    """Figures that not every run has."""
    summary: dict[str, Any] = {}
    known = run.known
    if run.bounds_from_recording is not None:
        summary["bounds_from_recording"] = run.bounds_from_recording
    if run.implausible:
        summary["implausible"] = list(run.implausible)
    if run.suspicious:
        summary["suspicious"] = list(run.suspicious)
    if run.up_at_rest is not None:
        summary["up_at_rest"] = run.up_at_rest
    if run.best is not None:
        summary["best"] = run.best
    if run.void:
        summary["left_out_from_beginning_to_end"] = list(run.void)
    if run.tilt_bounds is not None:
        summary["tilt_bound_deg"] = _spread(np.rad2deg(run.tilt_bounds[known]))
    if run.heading_bounds is not None:
        summary["heading_bound_deg"] = _spread(np.rad2deg(run.heading_bounds[known]))
    if run.roll_pitch_yaw is not None:
        half_widths = 0.5 * np.rad2deg(run.roll_pitch_yaw[:, 2::3] - run.roll_pitch_yaw[:, 1::3])
        summary["angle_half_width_deg"] = dict(zip(("roll", "pitch", "yaw"), map(_spread, half_widths.T), strict=True))
    if run.up_bounds is not None:
        summary["up_bound_deg"] = _spread(np.rad2deg(run.up_bounds))
        summary["rows_with_up_alone"] = int(run.up_alone.sum())
    if run.prediction_used is not None:
        summary["prediction_used_rows"] = int((run.prediction_used[known] == 1.0).sum())
    return summary


def _against_the_reference(run: Run, compared: NDArray[np.bool_], escaped: NDArray[np.bool_]) -> dict[str, Any]:
    assert run.errors is not None
    return {
        "rows_compared": int(compared.sum()),
        "escapes": int(escaped.sum()),
        "first_escape_s": float(run.times[np.argmax(escaped)]) if escaped.any() else None,
        "escapes_by_claim": None
        if run.claims is None
        else {claim: int((escaped & run.claimed(claim)).sum()) for claim in CLAIMS},
        "reference_error_deg": float(np.rad2deg(run.reference_error)),
        "error_deg": _spread(np.rad2deg(np.linalg.norm(run.errors[compared], axis=1))),
    }


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
        Path of the HTML file.
    title : str
    label : str
        What the run is compared with.

    Returns
    -------
    dict
        What `summarize` returns, with what was left out of the pictures as ``drawn``.

    Raises
    ------
    FileError
        If plotly is not installed, or the file cannot be written.
    """
    plotly = plotly_script()
    rows, shown = chosen_rows(run, PIECES), frame_rows(run)
    summary = summarize(run, label)
    summary["drawn"] = {"rows_of_curves": len(rows), "times_on_sphere": len(shown)}
    spells = run.refusal_spells()
    each = _each(run.listed)
    plots = plots_over_time(run, rows, label, spells)
    if run.measured:
        margin = max((plot["layout"]["margin"]["l"] for plot in plots.values()), default=0)
        plots["measured"] = measured_plot(run, margin)
    plots["sphere"] = sphere_plot(bool(run.compared.any()), label)
    data = {"plots": plots, "frames": sphere_frames(run, shown), "dropped": each}
    compares = summary["compared_with"] is not None
    parts = {
        "version": elliptude.__version__,
        "title": escape(title),
        # Names of files are long, and have no blank where a line may end.
        "heading": escape(title).replace("_", "_<wbr>"),
        "proposed": _proposed(run),
        "css": _text("report.css"),
        "summary": _summary_table(summary),
        "key": _key(label if compares else None),
        "magnified": _magnified(run.magnification(shown)),
        "axes": _reference_axes(run),
        "angles_hidden": "" if "angles" in plots else "hidden",
        "angles_note": _angles_note(run) + _shaded(plots.get("angles")),
        "bands_heading": "Attitude error and its bound" if compares else "Bound of the attitude error",
        "bands_note": _bands_note(run) + _shaded(plots.get("bands")),
        "size_hidden": "" if "size" in plots else "hidden",
        "bands_hidden": "" if "bands" in plots else "hidden",
        "not_measured": _warning(run.why_not_measured),
        "measured_note": "Where it is grey, there was no sample." if any(one.gaps for one in run.measured) else "",
        "measured_hidden": "" if run.measured else "hidden",
        "strip_hidden": "" if "strip" in plots else "hidden",
        "strip_heading": _strip_heading(run, spells),
        "strip_key": _strip_key(run),
        "size_heading": "Size of the set" if run.headings is None else "How far the attitude may be off",
        "size_note": _size_note(run) + _shaded(plots.get("size")),
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
    # A name between two @ is replaced.
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


def _proposed(run: Run) -> str:
    """That nothing is guaranteed, if the bounds are proposals."""
    if run.bounds_from_recording is None:
        return ""
    return _warning(f"The bounds are proposals from {run.bounds_from_recording}: the sets are no guarantee.")


def _warning(said: str | None) -> str:
    return "" if said is None else f'<p class="warn">{escape(said)}</p>'


def _angles_note(run: Run) -> str:
    """What roll, pitch and yaw are, and when they say nothing."""
    count = "counts from the first row" if run.heading_from_start else "is in the axes of the reference frame"
    held = "claims" if run.bounds_from_recording is None else "claims and the proposed bounds"
    return (
        f"The blue bands hold the truth if the {held} do. Yaw {count}. Where the body's x axis may be vertical, "
        "roll and yaw are not defined, and their bands are whole turns. "
    )


def _shaded(plot: dict[str, Any] | None) -> str:
    """What grey and amber mean in a plot, if there is any."""
    colours = set() if plot is None else {one["fillcolor"] for one in plot["layout"]["shapes"]}
    said = "Where it is grey, what is shown is not known. " if GREY in colours else ""
    return said + ("Where it is amber, it rests on what was left out. " if AMBER in colours else "")


def _bands_note(run: Run) -> str:
    """About which axes errors are."""
    names, phrase = run.about_axes().names, run.about_axes().phrase
    note = f"The turn from the estimate to the truth {phrase}, as a rotation vector. "
    if run.axes == "reference" and run.heading_from_start:
        note += f"X and Y are horizontal, by the heading that counts from the first row; {names[2]} is vertical. "
    if run.headings is not None:
        note += "About the vertical that is not the same as the heading, whose bound is of one turn alone. "
    if run.about_axes().is_asked:
        note += "The bands answer each axis by itself, and are narrower than the set, which answers all at once. "
    return note


def _size_note(run: Run) -> str:
    """What the curves of the set's size are."""
    note = f"The {LARGEST_ANGLE} is that of the turns from its center, the estimate, to the attitudes in it. "
    if run.headings is None:
        note = f"The half-widths are how far the attitude error may reach {run.about_axes().phrase}. " + note
    else:
        note += f"The {HEADING} is of the turn about the vertical that is left when the tilt is taken away. "
    if run.tilt_bounds is not None:
        note += f"The {TILT} is of the angle between estimated and true up. "
    if beyond := run.tilt_beyond_set:
        said = tilt_beyond_set(beyond)
        note += f"{said[0].upper()}{said[1:]}. "
    if run.up_alone.any():
        note += "Where no attitude is known, up alone is drawn: how far true up may be from where it is said to be. "
    return note


def _summary_table(summary: dict[str, Any]) -> str:
    cells = [(escape(name), escape(text)) for name, text in _lines_of_the_run(summary)]
    for one in reversed(summary.get("suspicious", [])):
        cells.insert(0, ("suspicious", f'<span class="warn">{escape(one)}</span>'))
    for one in reversed(summary.get("implausible", [])):
        cells.insert(0, ("implausible, gone on regardless", f'<span class="warn">{escape(one)}</span>'))
    cells += _lines_of_the_comparison(summary)
    body = "\n".join(f'<tr><th scope="row">{name}</th><td>{text}</td></tr>' for name, text in cells)
    return f"<table>\n{body}\n</table>"


def _lines_of_the_run(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Names and figures of the run itself, as text."""
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
        lines.append(("rows without a set", f"{count - summary['rows_with_a_set']}"))
    if summary["claims"] is not None:
        recording = summary.get("bounds_from_recording")
        shares = [
            f"{claim} {_share(number, count)}"
            if recording is None
            else f"{_share(number, count)} {IF_PROPOSED_BOUNDS_HOLD[claim]}"
            for claim, number in summary["claims"].items()
        ]
        lines.append(("claim", ", ".join(shares)))
        if recording is not None:
            lines.append(("bounds", f"proposals from {recording}, so that the sets are no guarantee"))
    lines.append((LARGEST_ANGLE, _degrees(summary["largest_angle_deg"])))
    if "tilt_bound_deg" in summary:
        lines.append((TILT, _degrees(summary["tilt_bound_deg"])))
    if "heading_bound_deg" in summary:
        lines.append((HEADING, _degrees(summary["heading_bound_deg"])))
    else:
        widths = summary["half_width_deg" if summary["axes"] == "body" else "half_width_reference_deg"]
        lines += [(half_width(axis), _degrees(spread)) for axis, spread in widths.items()]
    if summary.get("rows_with_up_alone"):
        number = summary["rows_with_up_alone"]
        lines.append(("up alone", f"{number} rows without an attitude; up is known there all the same"))
        lines.append((f"{UP}, all rows", _degrees(summary["up_bound_deg"])))
    if "best" in summary:
        lines.append(("best estimate", summary["best"]))
    if "prediction_used_rows" in summary and summary["rows_with_a_set"]:
        number = summary["prediction_used_rows"]
        share = _share(number, summary["rows_with_a_set"])
        lines.append(("prediction used", f"{number} rows, {share} of those with a set"))
    if summary["heading_from_start"]:
        lines.append(("heading", "counts from the first row, because nothing determines it"))
    lines += [("" if i else "whole recording", line) for i, line in enumerate(summary["smoothing"])]
    lines += [("" if i else "gaps in the gyro", line) for i, line in enumerate(summary["gaps"])]
    names = {
        "dropped": "measurements dropped",
        "refused": "measurements refused",
        "own bound": "measurements beyond their own bound",
    }
    lines += [(names[what], f"{number}") for what, number in summary["left_out"].items()]
    if "left_out_from_beginning_to_end" in summary:
        lines.append(("left out from beginning to end", ", ".join(summary["left_out_from_beginning_to_end"])))
    if "up_at_rest" in summary:
        lines.append(("up", summary["up_at_rest"]))
    return lines


def _lines_of_the_comparison(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Names and figures of the comparison with a reference, as HTML."""
    if summary["compared_with"] is None:
        return [("compared with", "nothing: there is no reference")]
    compared = f"{escape(summary['compared_with'])}, at {summary['rows_compared']} rows"
    if summary["reference_error_deg"]:
        compared += f"; it may itself be off by {summary['reference_error_deg']:.3g}°"
    escapes = f"{summary['escapes']} ({_share(summary['escapes'], summary['rows_compared'])})"
    if summary["escapes"]:
        if summary["escapes_by_claim"] is not None:
            by_claim = ", ".join(f"{number} {claim}" for claim, number in summary["escapes_by_claim"].items())
            escapes += f", {by_claim}"
        escapes = f'<span class="warn">{escapes}; the first at {_seconds(summary["first_escape_s"])} s</span>'
    return [("compared with", compared), ("error", _degrees(summary["error_deg"])), ("outside the set", escapes)]


def _seconds(time: float) -> str:
    """A time to a microsecond, of any size."""
    return f"{time:.6f}".rstrip("0").rstrip(".")


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'s' if number != 1 else ''}"


def _share(number: int, of: int) -> str:
    return f"{100.0 * number / of:.4g} %"


def _degrees(spread: dict[str, float] | None) -> str:
    if spread is None:
        return "not known"
    return f"mean {spread['mean']:.3g}°, at most {spread['largest']:.3g}°"


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
        '<p class="faint">Dropped: it contradicted the prediction or the other measurements of its row. Refused: the '
        "sets of its row did "
        "not meet, and none of them was used. Own bound: it contradicts what is stated about its sensor, at any "
        f"attitude. Up to {SPELL_GAP:g} s apart they are one line.</p>\n"
        f"<details{' open' if len(spells) <= _OPEN else ''}><summary>{_counted(len(spells), 'spell')}</summary>\n"
        '<div class="scroll tall"><table><thead>\n'
        '<tr><th scope="col">from s</th><th scope="col">to s</th><th scope="col">sensors</th><th scope="col">why</th>'
        f'<th scope="col">measure&shy;ments</th></tr>\n</thead><tbody>\n{lines}\n</tbody></table></div></details>\n'
        f"{more}"
    )


def _each(listed: DroppedMeasurements | None) -> dict[str, Any] | None:
    """Left-out measurements, column by column; only those farthest off if there are very many."""
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
        "why": [_CONTRADICTED.get(listed.contradicts[row], "the prediction") for row in rows],
        "margin": [float(f"{margin:.4g}") for margin in listed.margins[rows]],
        "unit": [readable_unit(listed.units[row]) for row in rows],
    }


def _strip_key(run: Run) -> str:
    """What the colours of the strip mean; only for claims that occur."""
    said = {*(run.claims or ()), *(run.up_claims or ())}
    colours = {claim: colour for claim, colour in CLAIM_COLOURS.items() if claim in said}
    labels = {claim: claim_label(claim, run.bounds_from_recording) for claim in colours}
    entries = [(f"claim: {label}", colours[claim]) for claim, label in labels.items()]
    if run.prediction_used is not None:
        entries += [(f"prediction used: {where}", colour) for where, colour in PREDICTION_COLOURS.items()]
    return "".join(f'<span><i style="background:{colour}"></i>{text}</span>' for text, colour in entries)


def _key(label: str | None) -> str:
    entries = [
        f'<span><i style="background:{"var(--blue)" if colour == BLUE else colour}"></i>body {axis}</span>'
        for colour, axis in zip(AXIS_COLOURS, "xyz", strict=True)
    ]
    if label is not None:
        entries.append(f'<span><i style="background:var(--ink)"></i>{escape(label)}</span>')
    return "".join(entries)


def _reference_axes(run: Run) -> str:
    """The reference axes as the sphere has them, with what they are called."""
    names = replace(run, axes="reference").about_axes().names
    letters = [axis if axis == name else f"{axis} ({name})" for axis, name in zip("XYZ", names, strict=True)]
    return ", ".join(letters)


def _magnified(factor: int) -> str:
    if factor == 1:
        return "Each patch is the exact image of the set of attitudes:"
    return (
        f"<strong>Sets and errors are drawn {factor} times as large</strong>, or they would be dots. Each patch "
        "is the exact image of the set of attitudes, so magnified:"
    )


def _strip_heading(run: Run, spells: list[Spell]) -> str:
    """The heading of the strip."""
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
