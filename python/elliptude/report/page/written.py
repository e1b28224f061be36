"""The report written: one HTML file of the page in ``data/report``, with its numbers, texts and plots."""

import json
import os
from html import escape
from importlib import resources
from typing import Any

import elliptude
from elliptude.io.files import FileError, replacing
from elliptude.report.axes.sphere import frame_rows, sphere_frames, sphere_plot
from elliptude.report.breaks import broken, gaps_of
from elliptude.report.curves import PIECES, plots_over_time
from elliptude.report.estimated.curves import measured_plot
from elliptude.report.page import notes, tables
from elliptude.report.page.summary import summarize
from elliptude.report.run import Run
from elliptude.report.thinning import chosen_rows


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
    drawn, shown = broken(run, gaps_of(run)), frame_rows(run)
    rows = chosen_rows(drawn, PIECES)
    count = len(rows) - (0 if drawn.in_gap is None else int(drawn.in_gap.sum()))
    summary = summarize(run, label)
    summary["drawn"] = {"rows_of_curves": count, "times_on_sphere": len(shown)}
    spells = run.refusal_spells()
    each = tables.each_left_out(run.listed)
    plots = plots_over_time(drawn, rows, label, spells)
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
        "proposed": notes.proposed(run),
        "css": _text("report.css"),
        "summary": tables.summary_table(summary),
        "key": notes.key(label if compares else None),
        "magnified": notes.magnified(run.magnification(shown)),
        "axes": notes.reference_axes(run),
        "angles_hidden": "" if "angles" in plots else "hidden",
        "angles_note": notes.angles_note(run) + notes.shaded(plots.get("angles")),
        "bands_heading": "Attitude error and its bound" if compares else "Bound of the attitude error",
        "bands_note": notes.bands_note(run) + notes.shaded(plots.get("bands")),
        "size_hidden": "" if "size" in plots else "hidden",
        "bands_hidden": "" if "bands" in plots else "hidden",
        "not_measured": notes.warning(run.why_not_measured),
        "measured_note": "Where it is grey, there was no sample." if any(one.gaps for one in run.measured) else "",
        "measured_hidden": "" if run.measured else "hidden",
        "strip_hidden": "" if "strip" in plots else "hidden",
        "strip_heading": notes.strip_heading(run, spells),
        "strip_key": notes.strip_key(run),
        "size_heading": "Size of the set" if run.headings is None else "How far the attitude may be off",
        "size_note": notes.size_note(run) + notes.shaded(plots.get("size")),
        "dropped": tables.spell_table(spells),
        "each_hidden": "hidden" if each is None else "",
        "footnote": notes.footnote(run, count, len(shown)),
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
