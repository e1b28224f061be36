"""Statements that are far from what sensors and hands do: they need not be wrong, but are often typing errors.

The measure is the rule for a sensor in the hand, or for how the rule says that it is carried. Another kind of sensor or
motion may well be far from it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from elliptude.configuration import rules
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import HandHeldRule
from elliptude.configuration.findings.finding import Finding, Key, Remedy, Said
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import Carried
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer
from elliptude.configuration.statements import FieldBound, VelocityWindowBound
from elliptude.typing import FloatArray
from elliptude.units import (
    FIELD,
    STANDARD_GRAVITY,
    STRONGEST_BESIDE_UT,
    STRONGEST_FIELD_UT,
    WEAKEST_BESIDE_UT,
    WEAKEST_FIELD_UT,
)


@dataclass(frozen=True)
class _Usual:
    """A key whose number is suspicious if it is too many times that of the rule, or too small a part of it."""

    most: float
    meaning: str
    least: float = 0.0
    why_not_less: str = ""


_TOO_GOOD = "no small sensor is so good, and sets that rest on it are too small"
_ANOTHER_UNIT = "is its unit right?"
_RUN_AGAIN = "if it was proposed while the unit was wrong, run `elliptude bounds` again"
# How many times gravity an accelerometer shows whose g are m/s², or the other way round, moved and uncalibrated.
_LEAST_IN_ANOTHER_UNIT, _MOST_IN_ANOTHER_UNIT = 5.0, 15.0
# By table and key of a rule. With a least of 0, zero is not suspicious.
_USUAL: Mapping[tuple[str, str], _Usual] = {
    ("gyro", "noise_deg_per_s"): _Usual(10.0, _ANOTHER_UNIT, 1e-3, _TOO_GOOD),
    ("gyro", "bias_deg_per_s"): _Usual(40.0, "so much is not left of a bias that was subtracted"),
    ("gyro", "scale_error"): _Usual(10.0, _ANOTHER_UNIT),
    ("gyro", "increment_deg"): _Usual(100.0, _ANOTHER_UNIT),
    ("accelerometer", "error_m_per_s2"): _Usual(5.0, "is it calibrated, and gravity what is stated?"),
    ("accelerometer", "averaged_error_m_per_s2"): _Usual(5.0, "is it calibrated, and gravity what is stated?"),
    ("motion", "velocity_m_per_s"): _Usual(3.0, "no hand moves so fast"),
    ("motion", "position_m"): _Usual(3.0, "no arm reaches so far"),
    ("magnetometer", "disturbance_ut"): _Usual(
        2.0, "as with a magnet or steel near the sensor or attached to it, or a magnetometer that is not calibrated"
    ),
    ("magnetometer", "error_ut"): _Usual(3.0, "is it calibrated?"),
    ("magnetometer", "averaged_error_ut"): _Usual(5.0, "is it calibrated?"),
}
# m/s²; gravity over the Earth's surface is 9.764 to 9.834.
_LEAST_GRAVITY, _MOST_GRAVITY = 9.7, 9.9
# What a reference field is multiplied by to be in µT: if it was stated in T, mT, G, mG or nT, or made of a field in T
# whose number was one of µT.
_TO_MICROTESLA = (*(size / FIELD["uT"] for size in FIELD.values()), 1e-6)
_NEXT_TO_NOTHING_DEG = 90.0
# s; the rules of the package are for recordings of up to ten minutes.
_LONGEST_S = 600.0


def of_rule(
    numbers: Mapping[str, Mapping[str, Any]], *, stated: str = "stated", carried: Carried = "hand"
) -> list[Finding]:
    """What is suspicious in a rule.

    Parameters
    ----------
    numbers : mapping
        From tables and keys of `elliptude.configuration.rules.Rule` to numbers; any of them may be missing.
    stated : str
        How the numbers came about, for the message.
    carried : {"hand", "person", "drone", "car", "boat"}
        Whose numbers are the usual ones.

    Returns
    -------
    list of Finding
    """
    names = {name for name, _ in _USUAL}
    # A rule may be without a magnetometer.
    tables = {name: table for name, table in numbers.items() if name in names and table is not None}
    return [one for name, table in tables.items() for one in _of_table(name, table, name, stated, carried)]


def of_configuration(configuration: Configuration) -> list[Finding]:
    """What is suspicious in a configuration.

    Parameters
    ----------
    configuration : Configuration

    Returns
    -------
    list of Finding
    """
    rule, found = configuration.rule, of_units(configuration)
    if rule is not None:
        numbers = rule.rule()
        if not isinstance(rule, HandHeldRule):
            found += of_rule(numbers.model_dump(mode="json"), carried=numbers.carried or "hand")
        return found
    flow, carried = configuration.flow, configuration.carried or "hand"
    if isinstance(flow, GyroFlow):
        # A number that is not stated is zero or has a meaning of its own, except the noise.
        there = flow.model_fields_set & {key for _, key in _USUAL}
        found += _of_table("gyro", {key: getattr(flow, key) for key in there}, "the gyro", "stated", carried)
    for sensor in configuration.directions:
        found += _of_sensor(sensor, carried)
    return found


def of_units(configuration: Configuration) -> list[Finding]:
    """What is suspicious in a configuration since it would be as usual in another unit.

    Parameters
    ----------
    configuration : Configuration

    Returns
    -------
    list of Finding
        What is stated of gravity first: if it is wrong, a field may contradict because of it.
    """
    found = []
    for sensor in configuration.directions:
        if isinstance(sensor, Accelerometer):
            found += _of_gravity(sensor, configuration)
    for sensor in configuration.directions:
        if isinstance(sensor, Magnetometer) and sensor.reference_ut is not None:
            found += _of_reference(sensor, np.asarray(sensor.reference_ut, dtype=np.float64))
    return found


def stated_gravity(sensor: Accelerometer, configuration: Configuration) -> float:
    """What is stated of gravity, m/s²: by the rule, if there is one."""
    rule = configuration.rule
    return sensor.gravity_m_per_s2 if rule is None else rule.rule().accelerometer.gravity_m_per_s2


def _of_gravity(sensor: Accelerometer, configuration: Configuration) -> list[Finding]:
    gravity = stated_gravity(sensor, configuration)
    if _LEAST_GRAVITY <= gravity <= _MOST_GRAVITY:
        return []
    key = Key("accelerometer", "gravity_m_per_s2")
    if configuration.rule is not None:
        key = Key("rule", "accelerometer.gravity_m_per_s2")
    said: Said = key, f" = {gravity:g} is not that of the Earth, {_LEAST_GRAVITY:g} to {_MOST_GRAVITY:g} m/s²"
    if _LEAST_GRAVITY <= gravity * STANDARD_GRAVITY <= _MOST_GRAVITY:
        in_g = Remedy(key, gravity, gravity * STANDARD_GRAVITY)
        said = said, "; as a number in g it would be: ", in_g
    return [_suspicious(sensor.name, said)]


def _of_reference(sensor: Magnetometer, field: FloatArray) -> list[Finding]:
    strength = float(np.linalg.norm(field))
    if WEAKEST_FIELD_UT <= strength <= STRONGEST_FIELD_UT:
        return []
    key = Key("magnetometer", "reference_ut")
    earths = f"({WEAKEST_FIELD_UT:g} to {STRONGEST_FIELD_UT:g} µT)"
    said: Said = key, f" is {strength:.4g} µT long, which is not the Earth's field {earths}"
    for factor in _TO_MICROTESLA:
        if WEAKEST_FIELD_UT <= factor * strength <= STRONGEST_FIELD_UT:
            in_microtesla = Remedy(key, tuple(map(float, field)), tuple(map(float, factor * field)))
            return [_suspicious(sensor.name, (said, f"; times {factor:g} it would be: ", in_microtesla))]
    is_odd = not WEAKEST_BESIDE_UT <= strength <= STRONGEST_BESIDE_UT
    return [_suspicious(sensor.name, said)] if is_odd else []


def before_a_rules_refusal(rule: rules.Rule, sensor: str, forces: FloatArray) -> str:
    """What is wrong with an accelerometer for which nothing can follow from a rule, as words before what failed.

    Parameters
    ----------
    rule : Rule
    sensor : str
        Its name.
    forces : (N, 3) array
        What it shows, m/s²; NaN where it shows nothing.
    """
    lengths = np.linalg.norm(forces, axis=1)
    if not np.isfinite(lengths).any():
        return ""
    length, stated = float(np.nanmedian(lengths)), rule.accelerometer
    times, said = length / stated.gravity_m_per_s2, ""
    if 1.0 / _MOST_IN_ANOTHER_UNIT <= times <= 1.0 / _LEAST_IN_ANOTHER_UNIT or (
        _LEAST_IN_ANOTHER_UNIT <= times <= _MOST_IN_ANOTHER_UNIT
    ):
        said = f"{sensor!r} shows {length:.3g} m/s^2, {times:.3g} times gravity: is its unit right? "
    error = stated.averaged_error_m_per_s2
    if error >= stated.gravity_m_per_s2:
        said += (
            f"accelerometer.averaged_error_m_per_s2 = {error:.4g} of the rule is more than gravity, so that up may be "
            f"anywhere: {_RUN_AGAIN}. "
        )
    return f"{said}What follows is because of that: " if said else ""


def of_duration(gyro: Mapping[str, Any], lasted: float, carried: Carried = "hand") -> list[Finding]:
    """What is suspicious of a recording that lasts longer than the rules of the package are for.

    Parameters
    ----------
    gyro : mapping
        From keys of a rule's table ``gyro`` to numbers.
    lasted : float
        s.
    carried : {"hand", "person", "drone", "car", "boat"}
        Whose numbers are the usual ones.

    Returns
    -------
    list of Finding
        None if a drift is stated, or more is left of the bias than by the rule.
    """
    usual = rules.rule_for(carried).gyro.bias_deg_per_s
    if lasted <= _LONGEST_S or gyro.get("drift_deg_per_s2") or float(gyro.get("bias_deg_per_s") or 0.0) > usual:
        return []
    said = (
        f"the recording lasts {lasted / 60.0:.3g} minutes, and the numbers of the rules are for up to ten: a gyro's "
        "bias drifts as it warms up. State bias_deg_per_s for all of it, or drift_deg_per_s2, or cut the recording"
    )
    return [_suspicious("gyro", said)]


def of_configured_duration(configuration: Configuration, lasted: float) -> list[Finding]:
    """The same of a configuration with a rule, or with the numbers of one, as `carried` says."""
    if configuration.rule is not None:
        rule = configuration.rule.rule()
        return of_duration(rule.gyro.model_dump(mode="json"), lasted, rule.carried or "hand")
    flow = configuration.flow
    if configuration.carried is None or not isinstance(flow, GyroFlow):
        return []
    return of_duration(flow.model_dump(mode="json"), lasted, configuration.carried)


def _of_sensor(sensor: AnyDirection, carried: Carried) -> Iterator[Finding]:
    bound = sensor.bound_from
    if isinstance(bound, VelocityWindowBound):
        yield from _of_table("motion", bound.model_dump(exclude_none=True), sensor.name, "stated", carried)
    elif isinstance(bound, FieldBound):
        yield from _of_table("magnetometer", bound.model_dump(exclude_none=True), sensor.name, "stated", carried)
    if sensor.kind != "direction":
        errors = sensor.sensor_error.model_dump(exclude_none=True)
        yield from _of_table(sensor.kind, errors, sensor.name, "stated", carried)
    angle = getattr(bound, "angle_deg", sensor.bound_deg)
    if angle is not None and angle + math.degrees(sensor.added_angle) >= _NEXT_TO_NOTHING_DEG:
        yield _suspicious(sensor.name, f"a bound of {angle:.3g} degrees says next to nothing of where it points")


def _of_table(table: str, numbers: Mapping[str, Any], sensor: str, stated: str, carried: Carried) -> Iterator[Finding]:
    rule = rules.rule_for(carried).model_dump(mode="json")[table]
    where = "in the hand" if carried == "hand" else f"on a {carried}"
    for key, value in numbers.items():
        usual, standard = _USUAL.get((table, key)), rule.get(key)
        if usual is None or standard is None or value is None:
            continue
        compared = f"{stated} is {key} = {value:.4g}, {{}} that of the rule for a sensor {where}, {standard:g}"
        if value > usual.most * standard:
            meaning = usual.meaning if carried == "hand" else _ANOTHER_UNIT
            if table == "accelerometer" and stated != "proposed" and value >= STANDARD_GRAVITY:
                meaning += f" It is more than gravity: {_RUN_AGAIN}"
            yield _suspicious(sensor, f"{compared.format(f'{value / standard:.3g} times')}: {meaning}")
        elif value < usual.least * standard:
            how = "against" if value == 0.0 else f"{value / standard:.1e} of"
            yield _suspicious(sensor, f"{compared.format(how)}: {usual.why_not_less}")


def _suspicious(sensor: str, said: Said) -> Finding:
    return Finding("warning", sensor, said)
