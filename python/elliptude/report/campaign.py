"""The summary of a campaign as one HTML page without a program in it: counts, widths, cost, and two pictures."""

import base64
import io
import os
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from elliptude.io.files import replacing
from elliptude.report.figures import BLACK, BLUE, ORANGE, new_figure, plain_log_axis

_COLOURS = (BLUE, ORANGE, "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_WORDS = ("scenario", "directions", "bound °", "errors", "estimator")
_NUMBERS = ("updates", "escapes", "refused", "no set", "failed", "worst form", "seed", "median °", "95 % °", "used %")


def write_page(summary: Mapping[str, Any], path: str | os.PathLike[str], title: str = "Campaign") -> None:
    """Write the page, in whole or not at all.

    Parameters
    ----------
    summary : mapping
        What `elliptude.campaign` returns.
    path : path-like
        Path of the HTML file.
    title : str

    Raises
    ------
    FileError
        If it cannot be written.
    """
    cases = _with_estimators(summary["cases"])
    parts = {
        "version": escape(summary["elliptude"]),
        "title": escape(title),
        "css": _text("report.css"),
        "summary": _lines(_of_all(summary)),
        "figure": _figure(cases, summary["form_edges"]),
        "cases": _table(cases),
        "cost": _lines(_of_cost(summary["cost"])),
    }
    pieces = _text("campaign.html").split("@")
    # A name between two @ is replaced.
    pieces[1::2] = [parts[name] for name in pieces[1::2]]
    with replacing(path) as temporary:
        temporary.write_text("".join(pieces), encoding="utf-8")


def _text(name: str) -> str:
    return (resources.files("elliptude") / "data" / "report" / name).read_text(encoding="utf-8")


# --- tables -----------------------------------------------------------------------------------------------------------


def _lines(lines: Sequence[tuple[str, str]]) -> str:
    body = "\n".join(f'<tr><th scope="row">{escape(name)}</th><td>{text}</td></tr>' for name, text in lines)
    return f"<table>\n{body}\n</table>"


def _of_all(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    settings, modes = summary["settings"], summary["modes"]
    seeds, faults = settings["seeds"], summary["faults_of_guaranteed_mode"]
    runs = sum(counts["runs"] for counts in modes.values())
    lines = [
        ("runs", f"{runs} of {settings['updates']} updates each"),
        ("seeds", f"{seeds['first']} to {seeds['first'] + seeds['count'] - 1}"),
    ]
    if max(settings["errors_over_bounds"]) > 1.0:
        lines.append(("errors", "in some cases larger than the bounds that are stated, so that no set is promised"))
    for mode, counts in modes.items():
        said = (
            f"{counts['updates']} updates, {counts['escapes']} escaped, {counts['refused']} refused, "
            f"{counts['without_set']} without a set, {counts['failed']} failed"
        )
        lines.append(
            (
                f"mode {mode.replace('_', ' ')}",
                f'<span class="warn">{said}</span>' if mode == "guaranteed" and faults else said,
            )
        )
    return lines


def _of_cost(cost: Mapping[str, Any]) -> list[tuple[str, str]]:
    per_million = cost["cpu_s_per_million_updates"]
    timed = "not known" if per_million is None else f"{per_million:.3g} s of a processor"
    return [
        ("a million updates", f"{timed}, simulation and judging included"),
        ("rows", f"{cost['rows']}, {cost['bytes_per_row']:.3g} bytes each"),
        ("files", f"{cost['blocks']}, {cost['bytes']} bytes"),
    ]


def _table(cases: Sequence[Mapping[str, Any]]) -> str:
    head = "".join(f'<th scope="col">{name}</th>' for name in _WORDS)
    head += "".join(f'<th scope="col" class="number">{name}</th>' for name in _NUMBERS)
    body = "\n".join(f"<tr>{_row(case)}</tr>" for case in cases)
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def _row(case: Mapping[str, Any]) -> str:
    errors = case["noise"] + ("" if case["errors_over_bounds"] == 1.0 else f" × {case['errors_over_bounds']:g}")
    words = (case["scenario"], case["directions"], f"{case['bound_deg']:g}", errors, case["estimator"])
    faults = (_count(case[name]) for name in ("escapes", "refused", "without_set", "failed"))
    worst = ("", "") if case["worst"] is None else (f"{case['worst']['form']:.6g}", str(case["worst"]["seed"]))
    widths = ("" if angle is None else f"{angle:.3g}" for angle in case["largest_angle_deg"].values())
    used = f"{100.0 * case['used'] / case['predictions']:.1f}" if case["predictions"] else ""
    cells = "".join(f"<td>{escape(word)}</td>" for word in words)
    return cells + "".join(
        f'<td class="number">{number}</td>' for number in (str(case["updates"]), *faults, *worst, *widths, used)
    )


def _count(number: int) -> str:
    return f'<span class="warn">{number}</span>' if number else "0"


def _with_estimators(cases: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The cases with a name of their estimator: the mode, and the criterion and policy if there are several."""
    several = [key for key in ("criterion", "policy") if len({case[key] for case in cases} - {None}) > 1]
    return [
        {**case, "estimator": " ".join(case[key].replace("_", " ") for key in ("mode", *several) if case[key])}
        for case in cases
    ]


# --- pictures ---------------------------------------------------------------------------------------------------------


def _figure(cases: Sequence[Mapping[str, Any]], form_edges: Sequence[float]) -> str:
    """The pictures as the address of an image."""
    estimators = list(dict.fromkeys(case["estimator"] for case in cases))
    colours = {name: _COLOURS[i % len(_COLOURS)] for i, name in enumerate(estimators)}
    scenarios = list(dict.fromkeys(case["scenario"] for case in cases))
    figure = new_figure(7.0)
    grid = figure.add_gridspec(2, 1, height_ratios=[1.1, 1.0])
    above, below = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    panels = above.subplots(1, len(scenarios), squeeze=False, sharey=True)[0]
    for axes, scenario in zip(panels, scenarios, strict=True):
        _draw_widths(axes, [case for case in cases if case["scenario"] == scenario], colours)
        axes.set_title(scenario, fontsize=9.5)
        axes.set_xlabel("update")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[0].set_ylabel("mean largest angle / bound (-)")
    _draw_forms(below.subplots(), cases, form_edges, colours)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=120, metadata={"Software": None})
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def _draw_widths(axes: Axes, cases: Sequence[Mapping[str, Any]], colours: Mapping[str, str]) -> None:
    for case in cases:
        means = np.array([np.nan if mean is None else mean for mean in case["mean_largest_angle_deg_by_update"]])
        marker = "." if len(means) < 60 else None
        updates = np.arange(1, len(means) + 1)
        axes.plot(updates, means / case["bound_deg"], color=colours[case["estimator"]], linewidth=0.9, marker=marker)
    plain_log_axis(axes)


def _draw_forms(
    axes: Axes, cases: Sequence[Mapping[str, Any]], form_edges: Sequence[float], colours: Mapping[str, str]
) -> None:
    """The share of updates whose form is larger than each edge, for each estimator."""
    for name, colour in colours.items():
        counts = np.sum([case["histogram"] for case in cases if case["estimator"] == name], axis=0)
        if not counts.sum():
            continue
        beyond = np.cumsum(counts[::-1])[::-1] / counts.sum()
        shown = beyond > 0.0
        axes.plot(np.array(form_edges)[shown], beyond[shown], color=colour, marker=".", markersize=4, label=name)
    axes.axvline(1.0, color=BLACK, linewidth=1.2, linestyle="--", label="edge of the set")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(r"$x^\mathsf{T}P^{-1}x$ (-)")
    axes.set_ylabel("share of updates beyond (-)")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8.5)
