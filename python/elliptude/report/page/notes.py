"""What stands beside the pictures of the report: what they show, and what colours mean."""

from dataclasses import replace
from html import escape
from typing import Any

import elliptude
from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT, tilt_beyond_set
from elliptude.report.curves import AMBER, GREY, PIECES
from elliptude.report.figures import BLUE
from elliptude.report.run import Run, Spell
from elliptude.report.run_figures import AXIS_COLOURS, CLAIM_COLOURS, PREDICTION_COLOURS, claim_label
from elliptude.report.thinning import pieces


def proposed(run: Run) -> str:
    """That nothing is guaranteed, if the bounds are proposals."""
    if run.bounds_from_recording is None:
        return ""
    return warning(f"The bounds are proposals from {run.bounds_from_recording}: the sets are no guarantee.")


def warning(said: str | None) -> str:
    """What a reader should not miss, if there is anything."""
    return "" if said is None else f'<p class="warn">{escape(said)}</p>'


def angles_note(run: Run) -> str:
    """What roll, pitch and yaw are, and when they say nothing."""
    count = "counts from the first row" if run.heading_from_start else "is in the axes of the reference frame"
    held = "claims" if run.bounds_from_recording is None else "claims and the proposed bounds"
    return (
        f"The blue bands hold the truth if the {held} do. Yaw {count}. Where the body's x axis may be vertical, "
        "roll and yaw are not defined, and their bands are whole turns. "
    )


def shaded(plot: dict[str, Any] | None) -> str:
    """What grey and amber mean in a plot, if there is any."""
    colours = set() if plot is None else {one["fillcolor"] for one in plot["layout"]["shapes"]}
    said = "Where it is grey, what is shown is not known. " if GREY in colours else ""
    return said + ("Where it is amber, it rests on what was left out. " if AMBER in colours else "")


def bands_note(run: Run) -> str:
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


def size_note(run: Run) -> str:
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


def strip_key(run: Run) -> str:
    """What the colours of the strip mean; only for claims that occur."""
    said = {*(run.claims or ()), *(run.up_claims or ())}
    colours = {claim: colour for claim, colour in CLAIM_COLOURS.items() if claim in said}
    labels = {claim: claim_label(claim, run.bounds_from_recording) for claim in colours}
    entries = [(f"claim: {label}", colours[claim]) for claim, label in labels.items()]
    if run.prediction_used is not None:
        entries += [(f"prediction used: {where}", colour) for where, colour in PREDICTION_COLOURS.items()]
    return "".join(f'<span><i style="background:{colour}"></i>{text}</span>' for text, colour in entries)


def key(label: str | None) -> str:
    """What the colours on the sphere mean."""
    entries = [
        f'<span><i style="background:{"var(--blue)" if colour == BLUE else colour}"></i>body {axis}</span>'
        for colour, axis in zip(AXIS_COLOURS, "xyz", strict=True)
    ]
    if label is not None:
        entries.append(f'<span><i style="background:var(--ink)"></i>{escape(label)}</span>')
    return "".join(entries)


def reference_axes(run: Run) -> str:
    """The reference axes as the sphere has them, with what they are called."""
    names = replace(run, axes="reference").about_axes().names
    letters = [axis if axis == name else f"{axis} ({name})" for axis, name in zip("XYZ", names, strict=True)]
    return ", ".join(letters)


def magnified(factor: int) -> str:
    """How much larger than they are the sets are drawn."""
    if factor == 1:
        return "Each patch is the exact image of the set of attitudes:"
    return (
        f"<strong>Sets and errors are drawn {factor} times as large</strong>, or they would be dots. Each patch "
        "is the exact image of the set of attitudes, so magnified:"
    )


def strip_heading(run: Run, spells: list[Spell]) -> str:
    """The heading of the strip."""
    parts = ["claims"] * (run.claims is not None) + ["use of the prediction"] * (run.prediction_used is not None)
    parts += ["measurements left out"] * bool(spells and run.listed is None)
    return " and ".join([", ".join(parts[:-1])] * (len(parts) > 1) + parts[-1:]).capitalize()


def footnote(run: Run, rows: int, frames: int) -> str:
    """Which rows are drawn, and which elliptude wrote it."""
    count = len(run.times)
    text = f"The numbers are of all {count} rows. The sphere is drawn at {frames} of them, evenly in time"
    text += ", and where the set is largest" + (" and the reference farthest out." if run.forms is not None else ".")
    if rows < count:
        text += (
            f" The curves are drawn at {rows} of them: of each of {len(pieces(count, PIECES))} pieces the rows with "
            "the extremes of set and error, so that nothing that stands out is missing."
        )
    return f"{text} elliptude {elliptude.__version__}"
