"""Pictures of a run over time: errors in their bands, the size of the set; as PNG.

Where nothing is known, the curves have gaps. A strip below them shows what the estimator claims, and which measurements
it left out.
"""

from collections.abc import Callable, Mapping, Sequence, Set

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT, half_width
from elliptude.monitoring import Monitored
from elliptude.monitoring.monitor import QUESTIONS
from elliptude.report.breaks import broken, gaps_of, pieces_between_gaps
from elliptude.report.figures import (
    BLACK,
    BLUE,
    GAP_SHADE,
    GREY,
    HEADING_COLOUR,
    NO_SAMPLE,
    ORANGE,
    SHADE,
    TILT_COLOUR,
    UNKNOWN,
    Style,
    begin_above,
    draw_bands_alone,
    draw_roll_pitch_yaw,
    entitle,
    error_limit,
    legend_below,
    marks_of,
    new_figure,
    plain_log_axis,
    shade_spans,
    shade_unknown,
    true_roll_pitch_yaw,
)
from elliptude.report.run import Run
from elliptude.report.thinning import chosen_rows, pieces, prediction_shares, worst_claims
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray

AXIS_COLOURS = (ORANGE, "#009E73", BLUE)
"""Colours of the body's x, y and z axis: Okabe and Ito's, which the colour-blind can distinguish."""
AXIS_LINES = ("-", "--", "-.")
CLAIM_COLOURS = {"unconditional": "#56B4E9", "conditional": "#E69F00", "none": "#BBBBBB"}
LEAST_COLOURS = {"unconditional": BLACK, "conditional": "#B8860B"}
"""What another filter is off at least: a proof, and what would be one if the condition holds."""
PREDICTION_COLOURS = {"every row": "#5E3C99", "some rows": "#B2ABD2"}
"""Colours of the words that `elliptude.report.thinning.prediction_shares` returns."""

_MOST_PIECES = 1000
_MOST_STRIP_PIECES = 400


def angles_figure(run: Run, title: str, *, label: str = "truth") -> Figure:
    """Roll, pitch and yaw, each between the angles that the truth may have.

    Parameters
    ----------
    run : Run
        With these angles.
    title : str
    label : str
        What the estimates are compared with.

    Returns
    -------
    Figure
    """
    run = broken(run, gaps_of(run))
    assert run.roll_pitch_yaw is not None
    rows = chosen_rows(run, _MOST_PIECES)
    figure, panels, strip = _over_time(run, title, 3, 6.4)
    true = None if run.errors is None else true_roll_pitch_yaw(run.attitudes[rows], run.errors[rows])
    draw_roll_pitch_yaw(panels, run.times[rows], run.roll_pitch_yaw[rows], true, label)
    known = [np.isfinite(run.roll_pitch_yaw[:, 3 * i]) for i in range(3)]
    _finish(figure, run, strip, *panels[0].get_legend_handles_labels(), known=known)
    return figure


def bands_figure(run: Run, title: str, *, label: str = "truth") -> Figure:
    """The attitude error inside its bound, axis by axis; without a reference the bound alone.

    Parameters
    ----------
    run : Run
    title : str
    label : str
        What the estimates are compared with.

    Returns
    -------
    Figure
    """
    run = broken(run, gaps_of(run))
    rows = chosen_rows(run, _MOST_PIECES)
    shown = run.about_axes()
    time, bounds = run.times[rows], np.rad2deg(shown.half_widths[rows])
    bounds[~run.known[rows]] = np.nan
    figure, axes, strip = _over_time(run, title, 3, 6.4)
    errors = None if shown.errors is None or not run.compared.any() else np.rad2deg(shown.errors[rows])
    limit = error_limit(bounds, errors)
    for i, panel in enumerate(axes):
        panel.fill_between(time, -bounds[:, i], bounds[:, i], color=BLUE, alpha=0.22, linewidth=0, label="bound")
        draw_bands_alone(panel, time, -bounds[:, i], bounds[:, i])
        # Lines, so that a band thinner than a pixel, or between two gaps, is visible too.
        for sign in (-1.0, 1.0):
            panel.plot(time, sign * bounds[:, i], color=BLUE, linewidth=0.7, **marks_of(bounds[:, i]))
        if errors is not None:
            panel.plot(time, errors[:, i], color=BLACK, linewidth=0.8, label=f"error against {label}")
            outside = np.abs(errors[:, i]) - np.rad2deg(run.reference_error) > bounds[:, i]
            if outside.any():
                at = np.clip(errors[outside, i], -limit, limit)
                panel.plot(
                    time[outside],
                    at,
                    "x",
                    color=ORANGE,
                    markersize=4,
                    label="outside the band",
                    clip_on=False,
                    zorder=4,
                )
        panel.axhline(0.0, color=GREY, linewidth=0.5)
        panel.set_ylim(-limit, limit)
        panel.set_ylabel(f"about {shown.names[i]} (deg)")
    heading = f"attitude error {shown.phrase}, and its bound"
    if errors is None:
        heading = f"bound of the attitude error {shown.phrase}"
    elif run.compared.any():
        heading += f"; outside the set: {int(run.escaped.sum())} of {int(run.compared.sum())} rows"
    axes[0].set_title(heading, fontsize=9.5)
    entries = {text: handle for panel in axes for handle, text in zip(*panel.get_legend_handles_labels(), strict=True)}
    _finish(figure, run, strip, list(entries.values()), list(entries))
    return figure


def size_figure(run: Run, title: str) -> Figure:
    """The largest angle in the set, and bounds of heading and tilt, on a log scale.

    Without bounds of the heading, its half-widths instead.

    Parameters
    ----------
    run : Run
    title : str

    Returns
    -------
    Figure
    """
    run = broken(run, gaps_of(run))
    rows = chosen_rows(run, _MOST_PIECES)
    figure, (panel,), strip = _over_time(run, title, 1, 4.6)
    known = run.known[rows]
    headings, shown = run.heading_bounds, run.about_axes()
    for i in range(3 if headings is None else 0):
        widths = np.where(known, np.rad2deg(shown.half_widths[rows, i]), np.nan)
        panel.plot(
            run.times[rows],
            widths,
            color=AXIS_COLOURS[i],
            linestyle=AXIS_LINES[i],
            linewidth=1.1,
            label=half_width(shown.names[i]),
            **marks_of(widths),
        )
    largest = np.where(known, np.rad2deg(run.largest_angles[rows]), np.nan)
    style: Style = {"color": BLACK, "linewidth": 1.4, **marks_of(largest)}
    panel.plot(run.times[rows], largest, label=LARGEST_ANGLE, **style)
    if headings is not None:
        heading = np.where(known, np.rad2deg(headings[rows]), np.nan)
        style = {"color": HEADING_COLOUR, "linewidth": 1.1, "linestyle": "--", **marks_of(heading)}
        panel.plot(run.times[rows], heading, label=HEADING, **style)
    if run.tilt_bounds is not None:
        tilt = np.where(known, np.rad2deg(run.tilt_bounds[rows]), np.nan)
        style = {"color": TILT_COLOUR, "linewidth": 1.1, "linestyle": ":" if headings is None else "-"}
        panel.plot(run.times[rows], tilt, label=TILT, **style, **marks_of(tilt))
    alone = run.up_alone[rows]
    if run.up_bounds is not None and alone.any():
        up = np.where(alone, np.rad2deg(run.up_bounds[rows]), np.nan)
        style = {"color": TILT_COLOUR, "linewidth": 1.4, "linestyle": ":", **marks_of(up)}
        panel.plot(run.times[rows], up, label="up alone", **style)
    panel.set_title("how far the attitude may be off" if headings is not None else "size of the set of attitudes")
    panel.title.set_fontsize(9.5)
    panel.set_ylabel("angle (deg)")
    if (known.any() and (largest[known] > 0.0).all()) or (alone.any() and not known.any()):
        plain_log_axis(panel)
        begin_above(panel, HEADING)
    _finish(figure, run, strip, *panel.get_legend_handles_labels(), known=[run.known | run.up_alone])
    return figure


def monitor_figure(monitored: Monitored, title: str, *, proposed_from: str | None = None) -> Figure:
    """How far another filter's attitudes can be off, limits, and a strip of alarms; a panel for each question.

    Parameters
    ----------
    monitored : Monitored
    title : str
    proposed_from : str, optional
        The recording that the bounds are proposed from, if they are proposals.

    Returns
    -------
    Figure
    """
    bounds = np.where(monitored.judged[:, None], np.rad2deg(monitored.bounds), np.nan)
    shown = [QUESTIONS.index(question) for question in monitored.questions]
    alarms = monitored.alarms
    lanes = {
        name: (flags, colour)
        for name, flags, colour in (
            ("proved wrong", alarms.proved, LEAST_COLOURS["unconditional"]),
            ("outside, no proof", alarms.conditional, LEAST_COLOURS["conditional"]),
            ("not within limit", alarms.over_limit, ORANGE),
        )
        if flags.any()
    }
    figure = new_figure(1.4 + 1.7 * len(shown) + 0.22 * len(lanes))
    entitle(figure, title, proposed_from)
    ratios = [1.0] * len(shown) + ([0.13 * len(lanes)] if lanes else [])
    panels = figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False).ravel().tolist()
    panels, strip = panels[: len(shown)], panels[len(shown)] if lanes else None
    some = pieces(len(bounds), _MOST_PIECES)
    starts = np.array([piece.start for piece in some])
    # A curve's value is the largest of its piece of rows; a gap in part of it does not hide it.
    times = monitored.times[starts]
    for panel, i in zip(panels, shown, strict=True):
        for index, claim in enumerate(CLAIMS[:2]):
            curve = np.fmax.reduceat(np.where(monitored.claims[:, i] == index, bounds[:, i], np.nan), starts)
            if np.isfinite(curve).any():
                label = f"bound, {claim_label(claim, proposed_from)}"
                panel.plot(times, curve, color=CLAIM_COLOURS[claim], linewidth=1.3, label=label)
        for index, (rests_on, colour) in enumerate(LEAST_COLOURS.items()):
            is_off = monitored.judged & (monitored.claims[:, i] == index) & (monitored.least[:, i] > 0.0)
            least = np.fmax.reduceat(np.where(is_off, np.rad2deg(monitored.least[:, i]), np.nan), starts)
            if np.isfinite(least).any():
                # Beside a row of another claim a band has no width; its edge is visible all the same.
                label = "off at least" if rests_on == "unconditional" else "off at least if the condition holds"
                panel.fill_between(times, 0.0, least, facecolor=colour, edgecolor=colour, linewidth=0.7, label=label)
        limit = getattr(monitored.limits, QUESTIONS[i])
        if limit is not None:
            panel.axhline(np.rad2deg(limit), color=ORANGE, linestyle="--", linewidth=1.0, label="limit")
        panel.set_ylabel(f"{QUESTIONS[i]} (deg)")
        panel.set_ylim(bottom=0.0)
    heading = "how far the estimate can be off" + ("" if lanes else "; no alarm")
    panels[0].set_title(heading, fontsize=9.5)
    if strip is not None:
        edges = np.append(times, time_span(monitored.times)[1])
        for lane, (flags, colour) in enumerate(lanes.values()):
            is_alarm = np.logical_or.reduceat(flags.any(axis=1), starts)
            spans = [(edges[k], edges[k + 1] - edges[k]) for k in np.flatnonzero(is_alarm)]
            strip.broken_barh(spans, (lane - 0.4, 0.8), facecolor=colour, edgecolor=colour, linewidth=0.5)
        strip.set_ylim(len(lanes) - 0.4, -0.6)
        strip.set_yticks(range(len(lanes)), list(lanes), fontsize=8)
        strip.tick_params(axis="y", length=0)
        for side in ("top", "right", "left"):
            strip.spines[side].set_visible(False)
    lowest = strip or panels[-1]
    lowest.set_xlabel("time (s)")
    lowest.set_xlim(*time_span(monitored.times))
    entries = {text: one for panel in panels for one, text in zip(*panel.get_legend_handles_labels(), strict=True)}
    texts = sorted(entries, key=lambda text: (not text.startswith("bound"), not text.startswith("off"), len(text)))
    legend_below(figure, {text: entries[text] for text in texts}, 3)
    return figure


def claim_label(claim: str, proposed_from: str | None) -> str:
    """A claim as a legend says it: one that rests on proposals is no guarantee.

    Parameters
    ----------
    claim : str
        One of `elliptude.results.CLAIMS`.
    proposed_from : str, optional
        The recording that the bounds are proposed from, if they are proposals.

    Returns
    -------
    str
    """
    return claim if proposed_from is None or claim == "none" else f"{claim}, by proposals"


def time_text(run: Run, row: int) -> str:
    """A row's time, s, to a thousandth of the run's duration."""
    duration = float(run.times[-1] - run.times[0])
    digits = max(0, 3 - int(np.ceil(np.log10(duration)))) if duration > 0.0 else 3
    return f"{run.times[row]:.{digits}f}"


def _over_time(run: Run, title: str, count: int, height: float) -> tuple[Figure, list[Axes], Axes | None]:
    """A figure with panels above each other, and a strip below them if it has anything to show."""
    lanes = _lanes(run)
    figure = new_figure(height + 0.22 * lanes)
    entitle(figure, title, run.bounds_from_recording)
    ratios = [1.0] * count + ([0.06 * lanes * count] if lanes else [])
    panels = figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False).ravel().tolist()
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_xlim(*time_span(run.times))
    return figure, panels[:count], panels[count] if lanes else None


def time_span(times: FloatArray) -> tuple[float, float]:
    """What a time axis shows, s: from the first time to the last one."""
    return (float(times[0]), float(times[-1])) if len(times) > 1 else (float(times[0]) - 0.5, float(times[0]) + 0.5)


def _names(run: Run) -> list[str]:
    """Sensors that were left out at least once."""
    return sorted({name for refusal in run.refusals() for name in refusal.sensors.split()})


def _lanes(run: Run) -> int:
    return len(_lane_names(run))


def _lane_names(run: Run) -> list[str]:
    """Names of the strip's lanes, from top to bottom."""
    said = [("claim", run.claims is not None), ("claim of up", claims_of_up(run) is not None)]
    said.append(("prediction used", run.prediction_used is not None))
    return [name for name, is_said in said if is_said] + [f"{name} left out" for name in _names(run)]


def claims_of_up(run: Run) -> tuple[str, ...] | None:
    """What is claimed of up in each row; None if the claim of the attitude says it all."""
    return run.up_claims if run.up_claims != run.claims else None


def _finish(
    figure: Figure,
    run: Run,
    strip: Axes | None,
    handles: Sequence[Artist],
    labels: Sequence[str],
    *,
    known: Sequence[NDArray[np.bool_]] | None = None,
) -> None:
    """Show where what a panel shows is not known, draw the strip, and put one legend below everything.

    ``known`` has the rows of each panel but the strip; those with a set if left out.
    """
    handles, labels, gaps = list(handles), list(labels), gaps_of(run)
    panels = [panel for panel in figure.axes if panel is not strip]
    known = [run.known] * len(panels) if known is None else known
    for panel, rows in zip(panels, known, strict=True):
        shade_unknown(panel, run.times, rows)
        shade_spans(panel, gaps, NO_SAMPLE, GAP_SHADE)
    if gaps:
        handles.append(Patch(**GAP_SHADE))
        labels.append(NO_SAMPLE)
    if not np.all(known):
        handles.append(Patch(**SHADE))
        labels.append(UNKNOWN)
    if strip is not None:
        names, lanes = _names(run), _lane_names(run)
        bars_of = pieces_between_gaps(run, _MOST_STRIP_PIECES, time_span(run.times)[1])
        some = [piece.rows for piece in bars_of]

        def bars(
            lane: int,
            words: Sequence[str],
            colours: Mapping[str, str],
            legend: Callable[[str], str],
            explained: Set[str] = frozenset(),
        ) -> None:
            for kind, colour in colours.items():
                spans = [(p.begin, p.end - p.begin) for p, word in zip(bars_of, words, strict=True) if word == kind]
                if spans:
                    strip.broken_barh(spans, (lane - 0.4, 0.8), facecolor=colour, linewidth=0)
                if spans and kind not in explained:
                    handles.append(Patch(facecolor=colour))
                    labels.append(legend(kind))

        def claimed_as(claim: str) -> str:
            return f"claim: {claim_label(claim, run.bounds_from_recording)}"

        claimed = {"claim": run.claims, "claim of up": claims_of_up(run)}
        shown: set[str] = set()
        for claimed_name, claims in claimed.items():
            if claims is not None:
                words = worst_claims(claims, some)
                bars(lanes.index(claimed_name), words, CLAIM_COLOURS, claimed_as, shown)
                shown |= set(words)
        if run.prediction_used is not None:
            shares = prediction_shares(run.prediction_used, some)
            bars(lanes.index("prediction used"), shares, PREDICTION_COLOURS, "prediction used: {}".format)
        times: dict[str, list[float]] = {name: [] for name in names}
        for refusal in run.refusals():
            for name in refusal.sensors.split():
                times[name].append(refusal.time)
        for lane, name in enumerate(names, start=len(lanes) - len(names)):
            strip.plot(times[name], np.full(len(times[name]), float(lane)), "|", color=BLACK, markersize=7)
        strip.set_ylim(len(lanes) - 0.4, -0.6)
        strip.set_yticks(range(len(lanes)), lanes, fontsize=8)
        strip.tick_params(axis="y", length=0)
        for side in ("top", "right", "left"):
            strip.spines[side].set_visible(False)
    legend_below(figure, dict(zip(labels, handles, strict=True)))
