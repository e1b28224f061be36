"""Makes the recording of a run for Rerun: a file, or a viewer that shows it."""

import math
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import elliptude
from elliptude.bounds.angles.about_axes import ErrorAxes
from elliptude.configuration.configuration import read_configuration
from elliptude.io.files import FileError, replacing
from elliptude.io.spool import recording
from elliptude.report.comparison import run_against
from elliptude.report.estimated.reading import read_run
from elliptude.report.run import Run
from elliptude.view.curves import PIECES, send_curves
from elliptude.view.directions import MeasuredDirections, measured_directions
from elliptude.view.globe import send_globe
from elliptude.view.layout import layout
from elliptude.view.stream import Stream


class Drawn(NamedTuple):
    """What a view shows of a run."""

    rows: int
    """How many rows the run has."""
    rows_of_curves: int
    """At how many of them the curves are drawn."""
    times_on_sphere: int
    """At how many the sphere is."""
    magnification: int
    """By which the sphere draws sets, circles and errors too large."""


def to_rerun(
    result: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    log: str | os.PathLike[str] | None = None,
    config: str | os.PathLike[str] | None = None,
    reference: str | os.PathLike[str] | None = None,
    reference_config: str | os.PathLike[str] | None = None,
    largest_gap: float = 0.0,
    reference_error: float | None = None,
    axes: ErrorAxes = "reference",
) -> Drawn:
    """Write the results of `elliptude estimate` as a recording for Rerun.

    Parameters
    ----------
    result : path-like
        Their folder, or the table.
    path : path-like
        Path of the recording, ``.rrd``; it is replaced if it is there.
    log, config : path-like, optional
        The log and the configuration that they were estimated from, to draw the measured directions too.
    reference : path-like, optional
        Other attitudes to compare with than the truth that `estimate` found: a table with ``time_s,qw,qx,qy,qz``.
    reference_config : path-like, optional
        A configuration whose section ``truth`` says what the reference's columns are, if it is another log.
    largest_gap : float
        The reference is interpolated between two samples that are no further apart, s.
    reference_error : float, optional
        Angle by which the reference may itself be off, rad; if left out, what ``reference_config`` states, or 0.
    axes : {"reference", "body"}
        About which axes errors and half-widths are drawn.

    Returns
    -------
    Drawn
        How much of the run is drawn.

    Raises
    ------
    FileError
        If Rerun is not installed, a file cannot be read or written, the log is not that of the results, or no row has
        a reference.
    ValueError
        If ``log`` is given without ``config``, or the other way around, or what is of a reference without one.
    """
    if reference is None and (reference_config is not None or reference_error is not None):
        raise ValueError("reference_config and reference_error are of a reference: give it, too")
    if (log is None) != (config is None):
        raise ValueError("log and config belong together: give both, or none")
    run, label = read_run(result)
    measured = None
    if log is not None and config is not None:
        measured = measured_directions(recording(Path(log)), read_configuration(Path(config)), run)
    if reference is not None:
        of = None if reference_config is None else read_configuration(Path(reference_config))
        run = run_against(run, reference, of, largest_gap=largest_gap, reference_error=reference_error)
        label = Path(reference).name
    return write_view(replace(run, axes=axes), path, Path(result).resolve().name, label=label, measured=measured)


def write_view(
    run: Run,
    path: str | os.PathLike[str],
    title: str,
    *,
    label: str = "truth",
    measured: MeasuredDirections | None = None,
) -> Drawn:
    """Write the recording, in whole or not at all.

    Parameters
    ----------
    run : Run
    path : path-like
        Path of the recording, ``.rrd``.
    title : str
    label : str
        What the run is compared with.
    measured : MeasuredDirections, optional
        At all rows of the run.

    Returns
    -------
    Drawn

    Raises
    ------
    FileError
        If Rerun is not installed, or the file cannot be written.
    """
    stream = Stream(title, float(run.times[0]))
    try:
        with replacing(path) as temporary:
            stream.recording.save(temporary)
            drawn = _send(stream, run, label, measured)
    except RuntimeError as error:  # as where the disk is full
        raise FileError(f"{path}: not written: {error}") from error
    return drawn


def show(run: Run, title: str, *, label: str = "truth", measured: MeasuredDirections | None = None) -> Drawn:
    """Open Rerun's viewer with the recording; it stays when this program ends.

    Parameters
    ----------
    run : Run
    title : str
    label : str
        What the run is compared with.
    measured : MeasuredDirections, optional
        At all rows of the run.

    Returns
    -------
    Drawn

    Raises
    ------
    FileError
        If Rerun is not installed, or its viewer cannot be opened.
    """
    has_display = not sys.platform.startswith("linux") or "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    if not has_display:
        raise FileError("there is no display for Rerun's viewer: write a recording (--out), and open it elsewhere")
    stream = Stream(title, float(run.times[0]))
    # The viewer is installed beside this Python, which need not be on the path.
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    try:
        stream.rr.spawn(recording=stream.recording, executable_path=shutil.which("rerun", path=path))
        return _send(stream, run, label, measured)
    except RuntimeError as error:
        raise FileError(f"Rerun's viewer does not open: {error}; write a recording (--out) instead") from error


def _send(stream: Stream, run: Run, label: str, measured: MeasuredDirections | None) -> Drawn:
    """Send everything, and how it is laid out; then nothing is under way any more."""
    curves = send_curves(stream, run, label)
    times, magnification = send_globe(stream, run, label, measured)
    drawn = Drawn(len(run.times), curves.rows, times, magnification)
    stream.still("notes", stream.rr.TextDocument(_notes(run, label, drawn, measured), media_type="text/markdown"))
    stream.recording.send_blueprint(layout(stream, run, curves, magnification))
    stream.recording.flush()
    stream.recording.disconnect()
    return drawn


def _notes(run: Run, label: str, drawn: Drawn, measured: MeasuredDirections | None) -> str:
    """What there is to see, and what was left out of it, as Markdown."""
    lines = [f"**Implausible, gone on regardless:** {one}" for one in run.implausible]
    lines += [f"**Suspicious:** {one}" for one in run.suspicious]
    if run.bounds_from_recording is not None:
        lines.append(f"**The sets are no guarantee:** their bounds are proposals from {run.bounds_from_recording}.")
    lines.append("Each patch is where a body axis may point: the exact image of the set of attitudes.")
    if drawn.magnification > 1:
        lines.append(
            f"**Sets, circles and errors are drawn {drawn.magnification} times as large**, or they would be dots."
        )
    if measured is not None:
        lines.append(
            "A circle is about a sensor's reference: if the sensor's bound holds, the true attitude points what it "
            "measured into there. The point of the same colour is where the estimate points it, and red if it was left "
            "out. It stays until the next measurement is overdue."
        )
    if run.compared.any():
        error = f", which may itself be off by {_degrees(run.reference_error)}" if run.reference_error else ""
        lines.append(f"Violet is {label}{error}.")
    if run.why_not_measured is not None:
        lines.append(f"**Not drawn:** {run.why_not_measured}.")
    if run.heading_from_start:
        lines.append("The heading counts from the first row, because nothing determines it.")
    lines.append(f"Drawn are {in_words(drawn)}.")
    lines.append(f"elliptude {elliptude.__version__}")
    return "\n\n".join(lines)


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"


def in_words(drawn: Drawn) -> str:
    """How much of the run is drawn."""
    curves = "all rows" if drawn.rows_of_curves == drawn.rows else f"{drawn.rows_of_curves} of {drawn.rows} rows"
    said = f"curves at {curves}"
    if drawn.rows_of_curves < drawn.rows:
        said += f", the extremes of each of {PIECES} pieces among them"
    return f"{said}; the sphere at {drawn.times_on_sphere}, evenly in time"
