"""Pictures of estimates and their bounds, as PNG, without a display.

A band is the half-width of the set along an axis, about zero error. Errors of the attitude are turns about the
reference axes or, if wanted, about those of the body (`elliptude.bounds.angles.about_axes`).
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, Locator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

import elliptude
from elliptude.io.files import replacing
from elliptude.io.tables import Result
from elliptude.report.breaks import alone
from elliptude.report.thinning import spans_unknown
from elliptude.typing import FloatArray

# Okabe and Ito's colours, which the colour-blind can distinguish.
BLUE, ORANGE, BLACK, GREY = "#0072B2", "#D55E00", "#000000", "#808080"
HEADING_COLOUR, TILT_COLOUR, SIZE_COLOUR = "#009E73", "#CC79A7", "#E69F00"
UNKNOWN = "not known"
SHADE: dict[str, Any] = {"facecolor": GREY, "alpha": 0.18, "linewidth": 0}
"""How pictures show where that is."""
NO_SAMPLE = "no sample"
GAP_SHADE: dict[str, Any] = SHADE | {"hatch": "////", "alpha": 0.35}
CONDITIONAL = "rests on what was left out"
CONDITIONAL_SHADE: dict[str, Any] = {"facecolor": ORANGE, "alpha": 0.13, "linewidth": 0}
# A strong and a light tone for each run that is compared.
_TONES = ((ORANGE, "#E69F00"), (BLUE, "#56B4E9"), ("#009E73", "#CC79A7"))
_NOISE_STYLES = {
    "inside": (GREY, "o"),
    "perpendicular": (BLUE, "s"),
    "common": ("#009E73", "^"),
    "alternating": ("#E69F00", "v"),
    "search": (ORANGE, "x"),
}
# The highest form that is drawn; a form is infinite if P is flat.
_HIGHEST_FORM = 1e4
# Forms beyond this are drawn on a log axis.
_FAR_OUT = 10.0
# A log axis over less has ticks at even steps, as a linear one; over more at powers of ten, this many at most.
_NARROW_DECADES, _WIDE_DECADES, _MOST_POWERS = 0.9, 3.1, 8

Style: TypeAlias = dict[str, Any]


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure as PNG, in whole or not at all."""
    with replacing(path) as temporary:
        # No version or date inside: the same estimate makes the same file.
        figure.savefig(temporary, format="png", dpi=120, metadata={"Software": None})


def entitle(figure: Figure, title: str, proposed_from: str | None, *more: str) -> None:
    """Put a title on a figure; below it that its bounds are proposals, if they are: a picture is shown by itself.

    Parameters
    ----------
    figure : Figure
    title : str
    proposed_from : str or None
        The recording that the bounds are proposed from.
    *more : str
        Lines below.
    """
    said = [] if proposed_from is None else [f"the bounds are proposals from {proposed_from}: no guarantee"]
    figure.suptitle("\n".join([title, *more, *said]), fontsize=11)


def true_roll_pitch_yaw(attitudes: FloatArray, errors: FloatArray) -> FloatArray:
    """Roll, pitch and yaw of C exp(S(ζ)), rad, shape (N, 3); NaN where ζ is not known."""
    angles = np.full(errors.shape, np.nan)
    known = np.isfinite(errors).all(axis=1) & np.isfinite(attitudes[:, 0, 0])
    c = attitudes[known] @ elliptude.exp(errors[known])
    angles[known, 0] = np.arctan2(c[:, 2, 1], c[:, 2, 2])
    angles[known, 1] = np.arctan2(-c[:, 2, 0], np.hypot(c[:, 2, 1], c[:, 2, 2]))
    angles[known, 2] = np.arctan2(c[:, 1, 0], c[:, 0, 0])
    return angles


def draw_roll_pitch_yaw(
    panels: Sequence[Axes], time: FloatArray, angles: FloatArray, true: FloatArray | None, label: str
) -> None:
    """Roll, pitch and yaw, a panel each, in bands between the angles that the truth may have.

    Parameters
    ----------
    panels : sequence of Axes
        Three.
    time : (N,) array
        s.
    angles : (N, 9) array
        As `elliptude.io.tables.Result.roll_pitch_yaw`, rad.
    true : (N, 3) array, optional
        rad.
    label : str
        What ``true`` is.
    """
    for i, panel in enumerate(panels):
        draw_angle(panel, time, angles, true, label, i)


def draw_angle(panel: Axes, time: FloatArray, angles: FloatArray, true: FloatArray | None, label: str, i: int) -> None:
    """Roll, pitch or yaw, by its number i, in its band; parameters as of `draw_roll_pitch_yaw`."""
    name = ("roll", "pitch", "yaw")[i]
    value, least, most = np.rad2deg(angles[:, 3 * i : 3 * i + 3]).T
    goes_around = i != 1 and bool((np.nanmin(least, initial=0.0) < -180.0) | (np.nanmax(most, initial=0.0) > 180.0))
    broken = cut_at_wraps(time, value, least, most)
    # What reaches beyond half a turn comes in again at the other side.
    for around in (0.0, -360.0, 360.0) if goes_around else (0.0,):
        panel.fill_between(
            broken[0],
            broken[2] + around,
            broken[3] + around,
            color=BLUE,
            alpha=0.22,
            linewidth=0,
            label="" if around else "where it may be",
        )
    draw_bands_alone(panel, broken[0], broken[2], broken[3])
    panel.plot(broken[0], broken[1], color=BLUE, linewidth=1.1, label="as estimated", **marks_of(broken[1]))
    if true is not None and np.isfinite(true[:, i]).any():
        cut = cut_at_wraps(time, np.rad2deg(true[:, i]))
        # Dashed, so that the estimate is seen below it, and no error is taken for it.
        panel.plot(cut[0], cut[1], color=BLACK, linewidth=1.0, linestyle=(0, (3, 2)), label=label)
    if goes_around:
        panel.set_ylim(-180.0, 180.0)
        panel.set_yticks(range(-180, 181, 90))
    panel.grid(axis="y", linewidth=0.3)
    panel.set_ylabel(f"{name} (deg)")
    if i == 0:
        panel.set_title("roll, pitch and yaw, and where the truth may be", fontsize=9.5)


def marks_of(values: FloatArray) -> Style:
    """How a curve is drawn that has numbers without any beside them: these are marked."""
    single = alone(values).tolist()
    return {"marker": "o", "markersize": 3.0, "markevery": single} if single else {}


def draw_bands_alone(panel: Axes, time: FloatArray, lowest: FloatArray, highest: FloatArray) -> None:
    """Bands of rows without any beside them, as lines: what is filled between one row and no other has no width."""
    rows = alone(lowest)
    if len(rows):
        panel.vlines(time[rows], lowest[rows], highest[rows], color=BLUE, alpha=0.4, linewidth=1.5)


def cut_at_wraps(time: FloatArray, value: FloatArray, *others: FloatArray) -> list[FloatArray]:
    """Curves with a NaN between rows where an angle (deg) jumps from one end of the circle to the other."""
    jumps = np.flatnonzero(np.abs(np.diff(value)) > 180.0) + 1
    cut = [np.insert(curve, jumps, np.nan) for curve in (value, *others)]
    return [np.insert(time, jumps, time[jumps]), *cut]


def begin_above(axes: Axes, name: str) -> None:
    """Begin a log axis at the smallest value of all curves but the one with this name.

    A heading that counts from the first row begins at nearly nothing, which would flatten all else.
    """
    others = [np.asarray(line.get_ydata(), dtype=np.float64) for line in axes.lines if line.get_label() != name]
    smallest = min((values[values > 0.0].min() for values in others if (values > 0.0).any()), default=0.0)
    if smallest > axes.get_ylim()[0]:
        axes.set_ylim(bottom=0.2 * float(smallest))


def about_line_figure(
    time: FloatArray,
    runs: Sequence[tuple[str, Result, FloatArray, FloatArray]],
    title: str,
    *,
    line: str,
    label: str,
) -> Figure:
    """How far attitude is bounded about a line of sight and across it, in several runs over one log.

    Parameters
    ----------
    time : (N,) array
        s.
    runs : sequence of (name, results, about, across)
        ``about`` and ``across`` are the half-widths of the set about the line and the largest one across it, rad, (N,).
    title : str
    line : str
        What the line is: "Sun line".
    label : str
        What the estimates are compared with.

    Returns
    -------
    Figure
    """
    figure = new_figure(7.2)
    figure.suptitle(title, fontsize=11)
    widths, errors, used = figure.subplots(3, 1, sharex=True, height_ratios=[1.5, 1.3, 1.0])
    for (name, result, about, across), (strong, light) in zip(runs, _TONES, strict=False):
        widths.plot(time, np.rad2deg(about), color=strong, linewidth=1.5, label=f"{name}:\nabout the {line}")
        widths.plot(time, np.rad2deg(across), color=light, linewidth=1.5, label="across it")
        errors.plot(time, np.rad2deg(result.largest_angles), color=light, linewidth=1.5, label=f"{name}:\nbound")
        if result.errors is not None:
            angles = np.rad2deg(np.linalg.norm(result.errors[:, :3], axis=1))
            errors.plot(time, angles, color=strong, linewidth=0.8, label="error")
    widths.set_title("half-widths of the set", fontsize=9.5)
    widths.set_ylabel("half-width (deg)")
    errors.set_title(f"attitude error against {label}, and its bound: the largest angle in the set", fontsize=9.5)
    errors.set_ylabel("angle (deg)")
    for axes in (widths, errors):
        plain_log_axis(axes)
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=9)
    colours = [strong for strong, _ in _TONES]
    draw_bound_used(
        used, time, [(name, run.forms, colour) for (name, run, *_), colour in zip(runs, colours, strict=False)]
    )
    used.set_xlabel("time (s)")
    used.set_xlim(float(time[0]), float(time[-1]))
    return figure


def validation_figure(summary: Mapping[str, Any]) -> Figure:
    """The worst form of each case, and sizes against those of mode ``paper`` and of the measurements alone.

    Parameters
    ----------
    summary : mapping
        What `elliptude.validation.summarize` returns.

    Returns
    -------
    Figure
    """
    cases, total = summary["cases"], summary["total"]
    columns = list(dict.fromkeys((case["scenario"], case["bound_deg"]) for case in cases))
    noises = list(dict.fromkeys(case["noise"] for case in cases))
    figure = new_figure(7.2)
    figure.suptitle(
        f"Mode {summary['mode']}: the truth outside at {total['escapes']} of {total['updates']} updates", fontsize=11
    )
    worst, size = figure.subplots(2, 1, sharex=True)

    def place(case: Mapping[str, Any], aside: float) -> float:
        return columns.index((case["scenario"], case["bound_deg"])) + aside

    for k, noise in enumerate(noises):
        colour, marker = _NOISE_STYLES[noise]
        chosen = [case for case in cases if case["noise"] == noise and case["worst"] is not None]
        at = [place(case, 0.14 * (k - 0.5 * (len(noises) - 1))) for case in chosen]
        heights = [min(case["worst"]["form"], _HIGHEST_FORM) for case in chosen]
        worst.plot(at, heights, marker, color=colour, markersize=4, label=noise, linestyle="none")
    worst.axhline(1.0, color=BLACK, linewidth=1.2, linestyle="--", label="edge of the set")
    worst.set_ylabel(r"largest $x^\mathsf{T}P^{-1}x$ (-)")
    worst.set_title("worst place of the truth in the set; a mark for each set of directions", fontsize=9.5)
    for name, label, colour, marker, aside in (
        ("measured", "against the measurements alone", ORANGE, "s", -0.15),
        ("paper", "against mode paper", BLUE, "o", 0.15),
    ):
        chosen = [case for case in cases if name in case["sizes"]]
        ratios = [case["sizes"]["own"]["trace"] / case["sizes"][name]["trace"] for case in chosen]
        at = [place(case, aside) for case in chosen]
        size.plot(at, ratios, marker, color=colour, markersize=3.5, alpha=0.7, label=label, linestyle="none")
    size.axhline(1.0, color=GREY, linewidth=0.8)
    size.set_ylabel("ratio of mean traces (-)")
    size.set_title("size of the set; a mark for each noise and set of directions", fontsize=9.5)
    size.set_xticks(range(len(columns)), [f"{bound:g}°" for _, bound in columns], fontsize=8)
    for scenario in dict.fromkeys(scenario for scenario, _ in columns):
        own = [i for i, column in enumerate(columns) if column[0] == scenario]
        size.annotate(
            scenario,
            (0.5 * (own[0] + own[-1]), 0.0),
            xytext=(0, -24),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            va="top",
        )
        for axes in (worst, size):
            axes.axvline(own[-1] + 0.5, color=GREY, linewidth=0.5)
    for axes in (worst, size):
        plain_log_axis(axes)
        axes.set_xlim(-0.5, len(columns) - 0.5)
    for axes, what in ((worst, "errors"), (size, "traces")):
        axes.legend(
            loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8.5, title=what, alignment="left"
        )
    size.set_xlabel("scenario, and bound of each direction", labelpad=22)
    return figure


def new_figure(height: float) -> Figure:
    """A figure with the Agg canvas. Not from pyplot, which keeps every figure that a program makes."""
    figure = Figure(figsize=(9.0, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def legend_below(figure: Figure, entries: Mapping[str, Artist], columns: int = 4) -> None:
    """Put one legend below everything, in at most so many columns, and in no more than fit.

    Parameters
    ----------
    figure : Figure
    entries : mapping of str to Artist
        Nothing is put without any.
    columns : int
    """
    for ncols in range(min(len(entries), columns), 0, -1):
        legend = figure.legend(
            list(entries.values()),
            list(entries),
            loc="outside lower center",
            ncols=ncols,
            frameon=False,
            fontsize=9,
        )
        if ncols == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def shade_unknown(axes: Axes, time: FloatArray, known: NDArray[np.bool_]) -> None:
    """Grey where what a panel shows is not known.

    Parameters
    ----------
    axes : Axes
    time : (N,) array
        s.
    known : (N,) array of bool
    """
    shade_spans(axes, spans_unknown(time, known), UNKNOWN, SHADE)


def shade_conditional(axes: Axes, time: FloatArray, claims: Sequence[str] | None) -> None:
    """Amber where what a panel shows rests on what was left out.

    Parameters
    ----------
    axes : Axes
    time : (N,) array
        s.
    claims : sequence of str, optional
        What is claimed of it in each row; nothing is shown without.
    """
    if claims is not None:
        others = np.array([one != "conditional" for one in claims], dtype=np.bool_)
        shade_spans(axes, spans_unknown(time, others), CONDITIONAL, CONDITIONAL_SHADE)


def shade_spans(axes: Axes, spans: Sequence[tuple[float, float]], label: str, style: Style) -> None:
    """Shade spans of time, s, over the whole height."""
    if spans:
        corners = [[(begin, 0.0), (begin, 1.0), (end, 1.0), (end, 0.0)] for begin, end in spans]
        shades = PolyCollection(corners, transform=axes.get_xaxis_transform(), label=label, **style)
        axes.add_collection(shades, autolim=False)


def error_limit(bounds: FloatArray, errors: FloatArray | None) -> float:
    """Where the axis of errors ends: the settled part fills it, and a start many times as wide is cut."""
    known = bounds[np.isfinite(bounds).all(axis=1)]
    settled = known[len(known) // 8 :]
    values = [settled[np.isfinite(settled)], np.array([]) if errors is None else np.abs(errors[np.isfinite(errors)])]
    highest = max((float(np.quantile(some, 0.98)) for some in values if len(some)), default=0.0)
    return 1.15 * highest if highest > 0.0 else 1.0


def draw_bound_used(
    axes: Axes,
    time: FloatArray,
    curves: Sequence[tuple[str, FloatArray | None, str]],
    inside_share: float | None = None,
    **marks: Any,
) -> None:
    """How much of its bound the error uses over time: √form, what the error is of what the set reaches its way, %.

    The edge of the set is at 100 %, and the title has the share of rows inside.
    """
    axes.axhline(100.0, color=ORANGE if len(curves) == 1 else BLACK, linewidth=1.2, linestyle="--")
    shares, highest = [], 1.0
    for name, forms, colour in curves:
        known = None if forms is None else forms[np.isfinite(forms)]
        if forms is None or known is None or not len(known):
            axes.text(
                0.5, 0.5, "nothing to compare with", transform=axes.transAxes, ha="center", va="center", color=GREY
            )
            shares.append("not known")
            continue
        axes.plot(time, 100.0 * np.sqrt(forms), color=colour, linewidth=0.9, **marks)
        share = f"{100.0 * (float(np.mean(known <= 1.0)) if inside_share is None else inside_share):.4g} %"
        shares.append(share if len(curves) == 1 else f"{name} {share}")
        highest = max(highest, float(known.max()))
    axes.set_ylim(0.0, 115.0 * np.sqrt(highest))
    if highest > _FAR_OUT:  # otherwise the edge would not be visible
        plain_log_axis(axes)
        axes.set_ylim(10.0, 150.0 * np.sqrt(min(highest, _HIGHEST_FORM**2)))
    axes.set_title(f"how much of its bound the error uses; inside: {', '.join(shares)}", fontsize=9.5)
    axes.set_ylabel("of its bound (%)")


def log_ticks(low: float, high: float) -> list[float]:
    """Ticks of a log axis over a range: at least two within it, and not so many that their labels meet.

    Parameters
    ----------
    low, high : float
        Positive.

    Returns
    -------
    list of float
        Round numbers, some of them outside.
    """
    decades = np.log10(high / low)
    if decades < _NARROW_DECADES:
        even = MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
        return [float(tick) for tick in even if tick > 0.0]
    steps = (1.0, 2.0, 5.0) if decades < _WIDE_DECADES else (1.0,)
    powers = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
    if decades >= _WIDE_DECADES:
        powers = powers[powers % np.ceil(decades / _MOST_POWERS) == 0.0]
    return [float(tick) for tick in np.outer(10.0**powers, steps).ravel()]


class _PlainLogLocator(Locator):
    """Ticks of `log_ticks` for what is shown."""

    def __call__(self) -> list[float]:
        assert self.axis is not None
        return self.tick_values(*sorted(self.axis.get_view_interval()))

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        return log_ticks(vmin, vmax)


def _plain(value: float, _: object) -> str:
    """0.5 and 20 as they are; powers of ten instead of many zeros."""
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    return f"$10^{{{round(np.log10(value))}}}$" if np.log10(value) % 1.0 == 0.0 else f"{value:g}"


def plain_log_axis(axes: Axes) -> None:
    """Make an axis logarithmic, with labels such as 0.5, 2 and 10, on narrow ranges too."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(_PlainLogLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(_plain))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", linewidth=0.3)
