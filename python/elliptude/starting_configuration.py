"""A whole configuration to start from: the mapping of a log, and bounds proposed from it, each with how it was got.

Its bounds are what the recording showed, times a margin, and guarantee nothing about another recording.
"""

import copy
import math
from typing import Any

import numpy as np
import tomlkit

from elliptude import bound_rules
from elliptude.mapping import Tables
from elliptude.proposals import Proposal, Quantiles, VectorProposal
from elliptude.references import from_enu

# A direction that is off by more says next to nothing.
_WIDEST_DEG = 90.0
# s; the longest phase of rest is the magnetic reference if it is so long.
_SHORTEST_REST = 1.0
# °/s; what the bias of a small gyro that is not calibrated may be by its datasheet.
_BIAS_BY_DATASHEET = 5.0


def starting_configuration(
    tables: Tables, proposed: Proposal, margin: float, *, log: str, origin: int
) -> tomlkit.TOMLDocument:
    """A configuration for `elliptude estimate`, with comments.

    Parameters
    ----------
    tables : dict
        Of `elliptude.mapping`: which columns are which sensors. Bounds that they have stay.
    proposed : Proposal
    margin : float
        What maxima are multiplied by.
    log : str
        The recording's name.
    origin : int
        What was subtracted from the file's times, s.

    Returns
    -------
    tomlkit.TOMLDocument

    Raises
    ------
    ValueError
        If there are no two directions to start from, or nothing says where the magnetic field points.
    """
    full = copy.deepcopy(tables)
    comments: dict[tuple[str, str], str] = {}
    flow = full["flow"]
    if "noise_deg_per_s" not in flow:
        flow["noise_deg_per_s"], comments["the gyro", "noise_deg_per_s"] = _gyro_noise(proposed, margin)
    directions = full.get("directions", [])
    if len(directions) < 2:
        raise ValueError("a configuration to start from needs two directions, such as accelerometer and magnetometer")
    for sensor in directions:
        name = sensor["name"]
        if sensor.get("kind") == "magnetometer" and not sensor.keys() & {"reference", "reference_ut"}:
            key, value, comments[name, "reference"] = _field_reference(proposed, full.get("reference_frame"), origin)
            sensor[key] = value
            comments[name, key] = comments[name, "reference"]
        if not sensor.keys() & {"bound_deg", "bound_rad2", "bound_from"}:
            is_magnetometer = sensor.get("kind") == "magnetometer"
            vector = proposed.magnetometer if is_magnetometer else proposed.accelerometer
            if vector is None or sensor.get("kind", "direction") == "direction":
                raise ValueError(f"{name!r}: nothing proposes a bound of it; state bound_deg in the configuration")
            dip = proposed.dip if is_magnetometer else None
            sensor["bound_deg"], comments[name, "bound_deg"] = _angle(vector, dip, margin)
    if "start" not in full:
        bias, how = _bias(proposed, margin)
        full["start"] = {"kind": "first_measurement", "bias_bound_deg_per_s": bias}
        comments["start", "bias_bound_deg_per_s"] = how
    if "estimator" not in full:
        # Bounds that one recording showed are broken by the next one: such rows are said, not fatal.
        full["estimator"] = {"mode": "first_order", "when_sets_do_not_meet": "skip"}
    return _document(full, comments, margin, log)


def upward(value: float) -> float:
    """Three digits, rounded up."""
    if value == 0.0:
        return 0.0
    scale = 10.0 ** (2 - math.floor(math.log10(value)))
    return float(f"{math.ceil(value * scale - 1e-9) / scale:.3g}")


def _gyro_noise(proposed: Proposal, margin: float) -> tuple[float, str]:
    gyro = proposed.gyro
    if gyro.noise is None:
        noise = bound_rules.hand_held().gyro.noise_deg_per_s
        return noise, "not seen: the recording has no rest; a number for small sensors"
    spread = 0.0 if gyro.bias_spread is None else gyro.bias_spread.maximum
    value = upward(margin * math.degrees(gyro.noise.maximum + spread))
    return value, (
        f"largest at rest {math.degrees(gyro.noise.maximum):.3g}, and {math.degrees(spread):.3g} that the bias moved, "
        f"times {margin:g}; a scale error is not in it"
    )


def _bias(proposed: Proposal, margin: float) -> tuple[float, str]:
    gyro = proposed.gyro
    if gyro.bias is None:
        return _BIAS_BY_DATASHEET, "not seen: the recording has no rest; datasheets of small sensors"
    size = math.degrees(float(np.linalg.norm(gyro.bias)))
    spread = 0.0 if gyro.bias_spread is None else math.degrees(gyro.bias_spread.maximum)
    value = max(upward(margin * (size + spread)), 1e-3)
    return value, f"mean at rest {size:.3g}, from which it moved by {spread:.3g}, times {margin:g}"


def _angle(vector: VectorProposal, dip: Quantiles | None, margin: float) -> tuple[float, str]:
    """The bound of a direction in degrees, and how it was got."""
    against_reference = [found for found in (vector.angle_rest, vector.angle_moving) if found is not None]
    if against_reference:
        seen = max(math.degrees(found.maximum) for found in against_reference)
        moving = against_reference[-1]
        how = (
            f"largest angle from the reference {seen:.3g}, times {margin:g}; "
            f"99 % of what moved were within {math.degrees(moving.ninety_nine):.3g}"
        )
    else:
        lengths = [found.maximum for found in (vector.norm_rest, vector.norm_moving) if found is not None]
        # A disturbance across the vector that is as long as the largest seen along it.
        share = max(lengths) / vector.magnitude
        seen = math.degrees(math.asin(min(share, 1.0)))
        how = f"its length was off by up to {100.0 * share:.3g} %: arcsin of that"
        if dip is not None and math.degrees(dip.maximum) > seen:
            seen = math.degrees(dip.maximum)
            how = f"the angle to the accelerometer at rest was off by up to {seen:.3g}"
        how += f", times {margin:g}; no reference attitude, so the angle itself was not seen"
    bound = upward(margin * seen)
    return (bound, how) if bound <= _WIDEST_DEG else (_WIDEST_DEG, f"{how}; more than {_WIDEST_DEG:g} says nothing")


def _field_reference(proposed: Proposal, frame: Any, origin: int) -> tuple[str, Any, str]:
    """Key, value, and how it was got."""
    magnetometer = proposed.magnetometer
    if magnetometer is not None and magnetometer.reference is not None:
        field = from_enu(magnetometer.reference, frame)
        return "reference_ut", [round(float(part), 3) for part in field], "median at rest, by the reference attitude"
    begin, end = max(proposed.rests, key=lambda span: span[1] - span[0], default=(0.0, 0.0))
    if end - begin < _SHORTEST_REST:
        raise ValueError(
            f"no rest of {_SHORTEST_REST:g} s in the recording: state the magnetometer's reference in a configuration"
        )
    # Inwards, so that rounding takes no row that moves.
    phase = {
        "kind": "rest_phase",
        "from_s": math.ceil(1e3 * (begin + origin)) / 1e3,
        "to_s": math.floor(1e3 * (end + origin)) / 1e3,
        "declination_deg": 0.0,
    }
    return "reference", phase, "the longest rest; north is magnetic north"


def _document(full: Tables, comments: dict[tuple[str, str], str], margin: float, log: str) -> tomlkit.TOMLDocument:
    document = tomlkit.document()
    for line in (
        f"Proposed by `elliptude bounds` from {log}. Bounds are what was seen in that recording, times {margin:g}.",
        "They guarantee nothing about another recording, or the next minute of this one. Replace each by a number for",
        "which there is a reason, such as a datasheet or the size of the room.",
    ):
        document.add(tomlkit.comment(line))
    document.add(tomlkit.nl())
    for key, value in full.items():
        if not isinstance(value, dict | list):
            document.add(key, value)
    for key, value in full.items():
        if key == "directions":
            array = tomlkit.aot()
            for sensor in value:
                array.append(_section(sensor, sensor["name"], comments))
            document.add(key, array)
        elif isinstance(value, dict):
            document.add(key, _section(value, "the gyro" if key == "flow" else key, comments))
    return document


def _section(table: dict[str, Any], name: str, comments: dict[tuple[str, str], str]) -> tomlkit.items.Table:
    section = tomlkit.table()
    for key, value in table.items():
        if isinstance(value, dict):
            inline = tomlkit.inline_table()
            inline.update(value)
            section.add(key, inline)
        else:
            section.add(key, value)
        if (name, key) in comments:
            section[key].comment(comments[name, key])
    return section
