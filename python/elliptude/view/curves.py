"""Curves over time: roll, pitch and yaw, errors and their bounds, how far it may be off; claims; what was measured."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT
from elliptude.report.breaks import broken, gaps_of
from elliptude.report.estimated.drawn import heading_of
from elliptude.report.estimated.stored import MeasuredSensor
from elliptude.report.figures import HEADING_COLOUR, TILT_COLOUR, cut_at_wraps, true_roll_pitch_yaw
from elliptude.report.run import Run, Spell
from elliptude.report.run_figures import AXIS_COLOURS, CLAIM_COLOURS, claims_of_up
from elliptude.report.thinning import chosen_rows
from elliptude.typing import FloatArray
from elliptude.view.globe import TRUTH_COLOUR
from elliptude.view.stream import Stream

PIECES = 2000
"""Pieces of rows; the extremes of each are drawn."""
ANGLES = ("roll", "pitch", "yaw")

# On white and on black.
_ESTIMATE_COLOUR, _BOUND_COLOUR, _SIZE_COLOUR, _LEFT_OUT_COLOUR = "#2A93D1", "#8A8F98", "#D55E00", "#E0202B"
_WHY = {
    "dropped": "contradicted the prediction or one another",
    "refused": "did not meet the prediction",
    "own bound": "contradicted their own bound",
}


class Curves(NamedTuple):
    """What was drawn over time."""

    rows: int
    """How many of the run's."""
    angles: bool
    """Whether there are roll, pitch and yaw."""
    bands: tuple[str, ...]
    """The axes about which there are errors and half-widths."""
    claims: bool
    """Whether there are lanes for claims."""
    left_out: bool
    """Whether any measurement was left out."""
    sensors: tuple[tuple[str, str], ...]
    """Where what each sensor measured is, and what the plot is called."""


def send_curves(stream: Stream, run: Run, label: str) -> Curves:
    """Draw everything over time.

    Parameters
    ----------
    stream : Stream
    run : Run
    label : str
        What the run is compared with.

    Returns
    -------
    Curves
    """
    run = broken(run, gaps_of(run))
    rows = chosen_rows(run, PIECES)
    if run.in_gap is not None:
        rows = np.union1d(rows, np.flatnonzero(run.in_gap))
    times, known = run.times[rows], run.known[rows]
    compares = bool(run.compared.any())
    if run.roll_pitch_yaw is not None:
        true = (
            true_roll_pitch_yaw(run.attitudes[rows], run.errors[rows]) if compares and run.errors is not None else None
        )
        _send_angles(stream, times, np.rad2deg(run.roll_pitch_yaw[rows]), true, label)
    shown = run.about_axes()
    for i, name in enumerate(shown.names):
        width = np.where(known, np.rad2deg(shown.half_widths[rows, i]), np.nan)
        curves = {"least": (-width, _BOUND_COLOUR), "most": (width, _BOUND_COLOUR)}
        if compares and shown.errors is not None:
            curves[f"error against {label}"] = (np.rad2deg(shown.errors[rows, i]), TRUTH_COLOUR)
        _send_plot(stream, f"bounds/{name}", times, curves)
    sizes = {LARGEST_ANGLE: (run.largest_angles, known, _SIZE_COLOUR)}
    if run.heading_bounds is not None:
        sizes[HEADING] = (run.heading_bounds, known, HEADING_COLOUR)
    if run.tilt_bounds is not None:
        sizes[TILT] = (run.tilt_bounds, known, TILT_COLOUR)
    if run.up_bounds is not None and run.up_alone.any():
        sizes["up alone"] = (run.up_bounds, run.up_alone[rows], _ESTIMATE_COLOUR)
    drawn = {
        name: (np.where(where, np.rad2deg(angles[rows]), np.nan), colour)
        for name, (angles, where, colour) in sizes.items()
    }
    _send_plot(stream, "size", times, drawn)
    spells = run.refusal_spells()
    _send_left_out(stream, spells)
    sensors = tuple(_send_measured(stream, sensor) for sensor in run.measured)
    return Curves(
        len(rows), run.roll_pitch_yaw is not None, shown.names, _send_claims(stream, run), bool(spells), sensors
    )


def _send_plot(stream: Stream, path: str, times: FloatArray, curves: Mapping[str, tuple[FloatArray, str]]) -> None:
    """Curves by their names, with their colours."""
    values, colours = zip(*curves.values(), strict=True)
    still = stream.rr.SeriesLines(
        names=list(curves),
        colors=stream.colours(list(colours)),
        # Rows in one pixel are drawn as their extremes.
        aggregation_policy="MinMax",
        widths=[1.8 if colour == _ESTIMATE_COLOUR else 1.2 for colour in colours],
    )
    stream.still(path, still)
    stream.scalars(path, times, np.column_stack(values))


def _send_angles(stream: Stream, times: FloatArray, angles: FloatArray, true: FloatArray | None, label: str) -> None:
    """Roll, pitch and yaw with the angles between which the truth is, degrees but for ``true``."""
    for i, name in enumerate(ANGLES):
        value, least, most = angles[:, 3 * i : 3 * i + 3].T
        cut, value, least, most = cut_at_wraps(times, value, least, most)
        curves = {"least": (least, _BOUND_COLOUR), "most": (most, _BOUND_COLOUR), "estimate": (value, _ESTIMATE_COLOUR)}
        _send_plot(stream, f"angles/{name}/estimate", cut, curves)
        if true is not None:
            cut, value = cut_at_wraps(times, np.rad2deg(true[:, i]))
            _send_plot(stream, f"angles/{name}/reference", cut, {label: (value, TRUTH_COLOUR)})


def _send_measured(stream: Stream, sensor: MeasuredSensor) -> tuple[str, str]:
    """What a sensor measured, in body axes, with marks where it was left out; where that is, and what it is called."""
    path = stream.rr.new_entity_path(["measured", sensor.name])
    curves = {axis: (sensor.values[:, i], AXIS_COLOURS[i]) for i, axis in enumerate("xyz")}
    _send_plot(stream, f"{path}/axes", sensor.times, curves)
    if len(sensor.left_out):
        colours = stream.colours([_LEFT_OUT_COLOUR])
        points = stream.rr.SeriesPoints(names="left out", colors=colours, markers="cross", marker_sizes=3.0)
        stream.still(f"{path}/left_out", points)
        heights = np.full((len(sensor.left_out), 1), float(np.nanmin(sensor.values)))
        stream.scalars(f"{path}/left_out", sensor.left_out, heights)
    name, *more = heading_of(sensor)
    said = f"{name}, {' '.join(more)}" if sensor.kind else " ".join([name, *more])
    return path, said + "; red: left out" * bool(len(sensor.left_out))


def _send_claims(stream: Stream, run: Run) -> bool:
    """A lane for each claim, with its changes at all rows."""
    lanes = {name: claims for name, claims in (("claim", run.claims), ("claim_of_up", claims_of_up(run))) if claims}
    rr = stream.rr
    for name, claims in lanes.items():
        changes = [row for row, claim in enumerate(claims) if row == 0 or claim != claims[row - 1]]
        colours = stream.colours(list(CLAIM_COLOURS.values()))
        stream.still(f"claims/{name}", rr.StateConfiguration(values=list(CLAIM_COLOURS), colors=colours))
        # None ends the claim before.
        columns = rr.StateChange.columns(state=[claims[row] or None for row in changes])
        stream.moving(f"claims/{name}", run.times[changes], columns)
    return bool(lanes)


def _send_left_out(stream: Stream, spells: list[Spell]) -> None:
    """A line for each spell of measurements that were left out."""
    texts = [
        f"{spell.sensors}: {spell.measurements} left out up to {spell.last:.3f} s; they {_WHY[spell.what]}"
        for spell in spells
    ]
    stream.moving("left_out", np.array([spell.first for spell in spells]), stream.rr.TextLog.columns(text=texts))
