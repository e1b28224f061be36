"""The tables of the report: the figures of a run in words, and what was left out."""

from html import escape
from typing import Any

import numpy as np

from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT, UP, half_width
from elliptude.report.run import SPELL_GAP, DroppedMeasurements, Spell
from elliptude.results import IF_PROPOSED_BOUNDS_HOLD
from elliptude.units import readable_unit

LISTED = 500
"""How many spells of left-out measurements the report lists."""
EACH_LISTED = 20_000
"""How many left-out measurements it lists one by one."""

_CONTRADICTED = {"own_bound": "its own bound", "prediction_of_up": "the prediction of up"}

# How many spells are visible at first.
_OPEN = 12


def summary_table(summary: dict[str, Any]) -> str:
    """The figures of a run, as HTML."""
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


def spell_table(spells: list[Spell]) -> str:
    """Spells of left-out measurements, as HTML."""
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


def each_left_out(listed: DroppedMeasurements | None) -> dict[str, Any] | None:
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
