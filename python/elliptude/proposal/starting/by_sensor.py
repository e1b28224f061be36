"""The bounds that each sensor states by itself: what the recording showed, times a margin, with where it comes from.

In the mode of first order each direction has one angle; in the guaranteed mode they follow from numbers as a rule has
them.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from elliptude.bounds.gyro import TIMES_USUAL
from elliptude.configuration import rules
from elliptude.configuration.references import from_enu
from elliptude.configuration.rules import Carried
from elliptude.proposal.mapping import Tables
from elliptude.proposal.proposals import Proposal
from elliptude.proposal.proposed_rule import NOT_SEEN, RuleTables, rule_tables, upward
from elliptude.proposal.starting.document import Place
from elliptude.proposal.statistics import Quantiles
from elliptude.proposal.vectors import VectorProposal

# A direction with a larger bound says next to nothing.
_WIDEST_DEG = 90.0
# s; the longest phase of rest gives the magnetic reference if it is at least this long.
_SHORTEST_REST = 1.0
# °/s; the bias of a small, uncalibrated gyro, from datasheets.
_BIAS_BY_DATASHEET = 5.0
# Stamps of different sensors may make one row if they are within this share of the gyro's step.
_NEAR = 0.45
ANCHOR_S = 4.0
"""Time between anchors in the guaranteed mode, s. It changes how large sets are, not whether they hold."""


# --- first order ------------------------------------------------------------------------------------------------------


def put_first_order(full: Tables, comments: dict[Place, str], proposed: Proposal, margin: float, origin: int) -> None:
    """Put in what is missing for the mode of first order; ValueError if there are no two directions."""
    flow = full["flow"]
    if "noise_deg_per_s" not in flow:
        flow["noise_deg_per_s"], how = _gyro_noise(proposed, margin)
        comments["flow", "noise_deg_per_s"] = f"no guarantee: {how}"
    directions = full.get("directions", [])
    if len(directions) < 2:
        raise ValueError("a configuration to start from needs two directions, such as accelerometer and magnetometer")
    for sensor in directions:
        name = sensor["name"]
        _refer_field(sensor, full, comments, proposed, origin)
        if not _has_bound(sensor):
            is_magnetometer = sensor.get("kind") == "magnetometer"
            vector = _vector_of(sensor, proposed)
            dip = proposed.dip if is_magnetometer else None
            sensor["bound_deg"], how = _angle(vector, dip, margin)
            comments["directions", name, "bound_deg"] = f"no guarantee: {how}"
    if "start" not in full:
        bias, how = _bias(proposed, margin)
        full["start"] = {"kind": "first_measurement", "bias_bound_deg_per_s": bias}
        comments["start", "bias_bound_deg_per_s"] = f"no guarantee: {how}"
    if "estimator" not in full:
        # The next recording breaks bounds that one recording showed: such rows are reported, not fatal.
        full["estimator"] = {"mode": "first_order", "when_sets_do_not_meet": "skip"}


def _has_bound(sensor: Tables) -> bool:
    return bool(sensor.keys() & {"bound_deg", "bound_rad2", "bound_from"})


def _vector_of(sensor: Tables, proposed: Proposal) -> VectorProposal:
    """What was proposed for a sensor; ValueError if nothing was."""
    vector = {"magnetometer": proposed.magnetometer, "accelerometer": proposed.accelerometer}.get(
        sensor.get("kind", "direction")
    )
    if vector is None:
        raise ValueError(f"{sensor['name']!r}: nothing proposes a bound of it; state bound_deg in the configuration")
    return vector


def _refer_field(sensor: Tables, full: Tables, comments: dict[Place, str], proposed: Proposal, origin: int) -> None:
    """Give a magnetometer its reference, if it has none."""
    if sensor.get("kind") == "magnetometer" and not sensor.keys() & {"reference", "reference_ut"}:
        key, value, how = _field_reference(proposed, full.get("reference_frame"), origin)
        sensor[key] = value
        comments["directions", sensor["name"], key] = f"no guarantee: {how}"


def _gyro_noise(proposed: Proposal, margin: float) -> tuple[float, str]:
    gyro = proposed.gyro
    if gyro.noise is None:
        noise = rules.hand_held().gyro.noise_deg_per_s
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
    """The bound of a direction in degrees, and where it comes from."""
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
        # A disturbance across the vector, as long as the largest one seen along it.
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
    """Key, value, and where it comes from."""
    magnetometer = proposed.magnetometer
    if magnetometer is not None and magnetometer.reference is not None:
        field = from_enu(magnetometer.reference, frame)
        return "reference_ut", [round(float(part), 3) for part in field], "median at rest, by the reference attitude"
    begin, end = max(proposed.rests, key=lambda span: span[1] - span[0], default=(0.0, 0.0))
    if end - begin < _SHORTEST_REST:
        if magnetometer is None or proposed.field_angle is None:
            why = "" if proposed.no_rest is None else f": {proposed.no_rest}"
            raise ValueError(
                f"no rest of {_SHORTEST_REST:g} s in the recording{why}; state the magnetometer's reference in a "
                "configuration"
            )
        angle, _ = proposed.field_angle
        field = from_enu(magnetometer.magnitude * np.array([0.0, math.sin(angle), math.cos(angle)]), frame)
        how = "medians of the whole recording, which has no rest: the field's length, its angle from the specific force"
        return "reference_ut", [round(float(part), 3) for part in field], how
    # Rounded inwards, so that no row that moves is included.
    phase = {
        "kind": "rest_phase",
        "from_s": math.ceil(1e3 * (begin + origin)) / 1e3,
        "to_s": math.floor(1e3 * (end + origin)) / 1e3,
        "declination_deg": 0.0,
    }
    return "reference", phase, "the longest rest; north is magnetic north"


# --- guaranteed -------------------------------------------------------------------------------------------------------


class Shared(NamedTuple):
    """The share of the gyro's rows at which all sensors were sampled, and the accelerometer."""

    by_all: float
    forces: float


def is_up_alone(full: Tables) -> bool:
    """Whether up is all that a configuration lets follow: an accelerometer and a gyro alone, without rule and start."""
    directions = full.get("directions", [])
    on_lines = full["flow"].get("interval_rate", "mean_of_ends") == "mean_of_ends"
    alone = len(directions) == 1 and directions[0].get("kind") == "accelerometer"
    return alone and on_lines and not full.keys() & {"rule", "start"}


def put_by_sensor(
    full: Tables,
    comments: dict[Place, str],
    proposed: Proposal,
    margin: float,
    origin: int,
    shared: Shared,
    carried: Carried,
    reason: str,
) -> None:
    """Put in what is missing for the guaranteed mode, where the reason says why there is no rule."""
    directions = full.get("directions", [])
    up_alone = is_up_alone(full)
    if "start" not in full and len(directions) < 2 and not up_alone:
        raise ValueError(
            "a configuration to start from needs two directions, such as accelerometer and magnetometer, or an "
            "accelerometer and a gyro whose rate is on lines between samples (interval_rate = 'mean_of_ends'); "
            f"anything else needs a rule, but {reason}"
        )
    if carried != "hand":
        full["carried"] = carried
        comments["carried",] = "whose numbers are usual: those that were not seen are of its rule"
    if "start" not in full and shared.by_all == 0.0:
        _bring_together(full, comments, proposed)
    table = rule_tables(proposed, margin, from_start=False, carried=carried)
    _bound_gyro(full["flow"], comments, table, proposed, _shortest_for_bias(table, up_alone=up_alone))
    for sensor in directions:
        has_reference = bool(sensor.keys() & {"reference", "reference_ut"})
        _refer_field(sensor, full, comments, proposed, origin)
        if _has_bound(sensor):
            continue
        vector = _vector_of(sensor, proposed)
        if sensor["kind"] == "accelerometer":
            on_lines = full["flow"].get("interval_rate", "mean_of_ends") == "mean_of_ends"
            _bound_accelerometer(sensor, comments, table, vector, margin, over_windows=shared.forces > 0.5 and on_lines)
        else:
            _bound_magnetometer(sensor, comments, table, proposed, has_reference=has_reference)


def _bring_together(full: Tables, comments: dict[Place, str], proposed: Proposal) -> None:
    """Let stamps that are near make one row, as no two sensors have the same one."""
    timing = full.setdefault("timing", {})
    if "same_within_s" not in timing:
        # Less than half a step of the gyro: no two of its samples come into one row.
        step = proposed.gyro.longest_interval / TIMES_USUAL
        timing["same_within_s"] = float(f"{_NEAR * step:.2g}")
        comments["timing", "same_within_s"] = (
            "no two sensors have the same stamp; what was measured beside its row is known"
        )


def _put(table: Tables, comments: dict[Place, str], place: Place, values: Mapping[str, tuple[Any, str]]) -> None:
    """Put in keys that are missing, with their comments."""
    for key, (value, how) in values.items():
        if key not in table:
            table[key] = value
            comments[(*place, key)] = how


def _rule_numbers(table: RuleTables, section: str, *keys: str) -> dict[str, tuple[Any, str]]:
    return {key: (table[section][key].value, table[section][key].how) for key in keys}


def _shortest_for_bias(table: RuleTables, *, up_alone: bool) -> float:
    """How long the longest rest must be for the gyro's mean at rest to be its bias, s."""
    # With no other direction nothing else would show that a slow turn was taken for a rest.
    return 0.99 * float(table["rest"]["least_s"].value) if up_alone else 0.0


def _bound_gyro(
    flow: Tables, comments: dict[Place, str], table: RuleTables, proposed: Proposal, shortest_rest: float
) -> None:
    keys = ("noise_deg_per_s", "scale_error", "drift_deg_per_s2", "longest_interval_s", "largest_rate_deg_per_s")
    numbers = _rule_numbers(table, "gyro", *keys, "largest_angular_acceleration_deg_per_s2")
    if not flow.keys() & {"known_bias_deg_per_s", "bias_deg_per_s"}:
        at_rest = proposed.gyro.noise is not None
        if proposed.gyro.bias is None or (at_rest and _longest_rest(proposed) < shortest_rest):
            rest = table["rest"]
            how = f"{NOT_SEEN}: it has no rest of {rest['least_s'].value:g} s; the most that small sensors show at rest"
            numbers["bias_deg_per_s"] = rest["rate_deg_per_s"].value, f"{how}, by datasheets"
        else:
            known = [round(float(part), 4) for part in np.rad2deg(proposed.gyro.bias)]
            seen = "over all rest" if at_rest else "against the reference"
            numbers["known_bias_deg_per_s"] = known, f"no guarantee: mean {seen}, subtracted; the rest is bounded next"
            of_bias = ("bias_deg_per_s", "bias_change_deg_per_s")
            numbers |= _rule_numbers(table, "gyro", *(key for key in of_bias if key in table["gyro"]))
    over_windows = not flow.get("estimate_bias") and not flow.get("angular_acceleration_deg_per_s2")
    if over_windows and flow.get("interval_rate", "mean_of_ends") == "mean_of_ends":
        of_noise = ("increment_deg", "noise_turn_deg", "noise_turn_growth_deg_per_s")
        numbers |= _rule_numbers(table, "gyro", *(key for key in of_noise if key in table["gyro"]))
        numbers["anchor_s"] = ANCHOR_S, "how often a prediction begins anew"
    _put(flow, comments, ("flow",), numbers)


def _bound_accelerometer(
    sensor: Tables,
    comments: dict[Place, str],
    table: RuleTables,
    vector: VectorProposal,
    margin: float,
    *,
    over_windows: bool,
) -> None:
    place = ("directions", sensor["name"])
    gravity_error = _rule_numbers(table, "accelerometer", "gravity_error_m_per_s2")
    if over_windows:
        bound: Tables = {"kind": "velocity_window"}
        keys = ("velocity_m_per_s", "position_m", "largest_jerk_m_per_s3", "windows_s")
        numbers = _rule_numbers(table, "motion", *keys) | gravity_error
        numbers |= _rule_numbers(table, "accelerometer", "time_offset_change_s")
        numbers["at"] = table["motion"]["row_at"].value, table["motion"]["row_at"].how
    else:
        # Windows need the accelerometer's samples at the gyro's stamps, and rates on lines.
        bound = {"kind": "acceleration"}
        in_full = vector.vector_moving or vector.vector_rest
        found = [one.maximum for one in (in_full, vector.norm_rest, vector.norm_moving) if one is not None]
        what = "its difference from gravity" if in_full else "its length less gravity (a part alone)"
        how = f"no guarantee: maximum of {what}, {max(found):.3g}, times {margin:g}"
        numbers = {"acceleration_m_per_s2": (upward(margin * max(found)), how)} | gravity_error
    _put(bound, comments, (*place, "bound_from"), numbers)
    _put(sensor, comments, place, _rule_numbers(table, "accelerometer", "time_offset_bound_s"))
    sensor["bound_from"] = bound
    error: Tables = sensor.setdefault("sensor_error", {})
    errors = _rule_numbers(table, "accelerometer", "error_m_per_s2", "averaged_error_m_per_s2", "scale_error")
    _put(error, comments, (*place, "sensor_error"), errors)


def _bound_magnetometer(
    sensor: Tables, comments: dict[Place, str], table: RuleTables, proposed: Proposal, *, has_reference: bool
) -> None:
    place = ("directions", sensor["name"])
    magnetometer = proposed.magnetometer
    assert magnetometer is not None
    if "time_offset_bound_s" not in sensor and "delay_s" not in sensor:
        # A delay would move its samples away from those of the other sensors: the bound covers all of it.
        delay, left = table["magnetometer"]["delay_s"], table["magnetometer"]["time_offset_bound_s"]
        sensor["time_offset_bound_s"] = upward(abs(delay.value) + left.value)
        how = NOT_SEEN if left.how.startswith(NOT_SEEN) else "no guarantee"
        comments[(*place, "time_offset_bound_s")] = f"{how}; delay {delay.value:g}, and {left.value:g} beside it"
    bound: Tables = {"kind": "field"}
    _put(bound, comments, (*place, "bound_from"), _rule_numbers(table, "magnetometer", "disturbance_ut"))
    error: Tables = sensor.setdefault("sensor_error", {})
    keys = ("error_ut", "averaged_error_ut", "scale_error")
    _put(error, comments, (*place, "sensor_error"), _rule_numbers(table, "magnetometer", *keys))
    if not has_reference:
        off = _reference_field_error(table, proposed)
        share = min(off / magnetometer.magnitude, 1.0)
        values = (upward(off), upward(math.degrees(math.asin(share))))
        how = "no guarantee: of the reference, by averaged errors of magnetometer and accelerometer at rest"
        _put(bound, comments, (*place, "bound_from"), {"strength_error_ut": (values[0], how)})
        _put(sensor, comments, place, {"reference_error_deg": (values[1], how)})
    sensor["bound_from"] = bound


def _longest_rest(proposed: Proposal) -> float:
    """How long the longest rest is, s; 0 without one."""
    return max((end - begin for begin, end in proposed.rests), default=0.0)


def _reference_field_error(table: RuleTables, proposed: Proposal) -> float:
    """How far the mean field at rest, turned by the specific force there, may be off, µT; theory.md, (18.11)."""
    magnetometer, accelerometer = table["magnetometer"], table["accelerometer"]
    assert proposed.magnetometer is not None
    strength, k = proposed.magnetometer.magnitude, magnetometer["scale_error"].value
    error = magnetometer["averaged_error_ut"].value + k * (strength + magnetometer["error_ut"].value) / (1.0 - k)
    if proposed.magnetometer.reference is None:
        gravity, k = accelerometer["gravity_m_per_s2"].value, accelerometer["scale_error"].value
        radius = accelerometer["averaged_error_m_per_s2"].value + accelerometer["gravity_error_m_per_s2"].value
        radius += k * (gravity + accelerometer["error_m_per_s2"].value) / (1.0 - k)
        radius += 2.0 * table["rest"]["velocity_m_per_s"].value / max(_longest_rest(proposed), _SHORTEST_REST)
        tilt = math.asin(min(radius / gravity, 1.0))
        if _longest_rest(proposed) < _SHORTEST_REST and proposed.field_angle is not None:
            tilt = max(tilt, proposed.field_angle[1])
        error += 2.0 * strength * math.sin(0.5 * tilt)
    return float(error)
