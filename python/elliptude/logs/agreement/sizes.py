"""Whether sensors show as much as they would in the stated unit: gravity, the Earth's field, a turn, a step of time.

An odd size proves nothing: the sensor may be in a centrifuge, near a magnet, or in free fall. So it is named, with the
unit in which it would be usual; it is an error only where the log proves that not all that is stated holds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from elliptude import units
from elliptude.bounds.gyro import with_rounding
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings.finding import Finding, Key, Remedy, Said, Severity
from elliptude.configuration.findings.suspicions import stated_gravity
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer
from elliptude.logs.agreement.fields import exceeded_limit
from elliptude.logs.agreement.wrong_units import of_rates, unit_of_rates, unit_of_time
from elliptude.logs.log import Log
from elliptude.typing import FloatArray
from elliptude.units import OFTEN_S, SELDOM_S

# Shares of gravity: of a sensor that shows it, the median norm is within them.
_LEAST_OF_GRAVITY, _MOST_OF_GRAVITY = 0.5, 2.0
_MICROTESLA = units.FIELD["uT"]
# T; the Earth's field.
_LEAST_FIELD, _MOST_FIELD = _MICROTESLA * units.WEAKEST_FIELD_UT, _MICROTESLA * units.STRONGEST_FIELD_UT
# A normalized magnetometer shows this where it is not normalized for the place: the Earth's field over that elsewhere.
_LEAST_OF_UNIT, _MOST_OF_UNIT = 0.28, 3.5
# rad/s; the full range of common gyros.
_FULL_RANGE = 2000.0 * np.pi / 180.0
# Units of acceleration that cannot be stated.
_OTHER_ACCELERATIONS = {"mm/s^2": 1e-3}


@dataclass(frozen=True, eq=False)
class OddSize(Finding):
    """A size that is not what it usually is, and may be in another unit; of a direction an error if that is sure."""

    is_proved: bool = False
    """Whether that alone rules out what is stated."""


def odd_sizes(log: Log, configuration: Configuration) -> list[OddSize]:
    """What a log shows that is far from what its sensors usually show.

    Parameters
    ----------
    log : Log
    configuration : Configuration

    Returns
    -------
    list of OddSize
    """
    found = []
    for i, sensor in enumerate(configuration.directions):
        there = log.directions[np.isfinite(log.directions[:, i, 0]), i]
        if said := odd_length(there, sensor, configuration):
            limit = exceeded_limit(_median(there), sensor, configuration)
            if limit is not None:
                said = said, f"; its errors in µT as they count {_allowed(limit, sensor)}"
            severity: Severity = "error" if length_counts(sensor, configuration) else "warning"
            found.append(OddSize(severity, sensor.name, said, is_proved=limit is not None))
    if log.rates is None:
        return found
    rates = log.rates[log.has_rate]
    name, _ = of_rates(configuration)
    steps = np.diff(log.times[log.gyro_rows]) if isinstance(configuration.flow, GyroFlow) else np.empty(0)
    for said in (odd_rate(rates, configuration), odd_step(steps, configuration)):
        found += [OddSize("warning", name, said)] if said else []
    return found


def length_counts(sensor: AnyDirection, configuration: Configuration) -> bool:
    """Whether what is stated says anything of how long a direction's vectors are."""
    return configuration.rule is not None or not sensor.is_bound_by_angle


def odd_length(vectors: FloatArray, sensor: AnyDirection, configuration: Configuration) -> Said:
    """What is odd about the lengths of a direction's vectors (N, 3), in SI units; empty if nothing is."""
    if not len(vectors) or not isinstance(sensor, Accelerometer | Magnetometer):
        return ""
    median = _median(vectors)
    if isinstance(sensor, Accelerometer):
        return _odd_force(median, sensor, stated_gravity(sensor, configuration))
    return _odd_unit_field(median / sensor.tesla) if sensor.unit == "normalized" else _odd_field(median, sensor)


def odd_rate(rates: FloatArray, configuration: Configuration) -> Said:
    """What is odd about rates (N, 3), rad/s; empty if nothing is."""
    _, unit = of_rates(configuration)
    fastest = float(np.linalg.norm(rates, axis=1).max(initial=0.0))
    if fastest <= _FULL_RANGE:
        return ""
    said = f"up to {fastest / units.ANGULAR_VELOCITY[unit]:.4g} {unit}, which is {np.rad2deg(fastest):.4g} deg/s"
    said += ": more than most gyros can show, 2000 deg/s"
    in_degrees = unit == "rad/s" and np.radians(fastest) <= _FULL_RANGE
    return (said, "; ", unit_of_rates(configuration, "deg/s", ("deg/s",))) if in_degrees else said


def odd_step(steps: FloatArray, configuration: Configuration) -> Said:
    """What is odd about the steps (N,) between a gyro's samples, s; empty if nothing is."""
    if not len(steps):
        return ""
    step = float(np.median(steps))
    # An accelerometer that shows up is no spacecraft's.
    seldom = step >= SELDOM_S and configuration.accelerometer is not None and not _covers(configuration, step)
    if not seldom and step >= OFTEN_S:
        return ""
    limit = f"more than {SELDOM_S:g}" if seldom else f"less than {OFTEN_S:g}"
    how = f"{limit} s: {'few are read so seldom' if seldom else 'none is read so often'}"
    said = f"its samples are {step:.3g} s apart (median), {how}"
    in_other = unit_of_time(configuration, lambda factor: OFTEN_S <= factor * step < SELDOM_S)
    return said if in_other is None else (said, "; ", replace(in_other, fitting=(str(in_other.meant),)))


def _median(vectors: FloatArray) -> float:
    """Of the norms of vectors (N, 3)."""
    return float(np.median(np.linalg.norm(vectors, axis=1)))


def _covers(configuration: Configuration, step: float) -> bool:
    """Whether somebody states bounds that hold over such a step; a proposal from the log itself states nothing."""
    if configuration.proposed_from is not None:
        return False
    if configuration.rule is not None:
        longest = configuration.rule.rule().gyro.longest_interval_s
    else:
        longest = configuration.flow.longest_interval_s if isinstance(configuration.flow, GyroFlow) else None
    return longest is not None and step <= with_rounding(longest, np.array([step]))


def _odd_force(median: float, sensor: Accelerometer, gravity: float) -> Said:
    """Of the median norm of an accelerometer, m/s²."""
    unit = units.ACCELERATION[sensor.unit]
    least, most = _LEAST_OF_GRAVITY * gravity, _MOST_OF_GRAVITY * gravity
    if least <= median <= most:
        return ""
    said: Said = (
        f"its median norm is {median / unit:.4g} {sensor.unit}, which is not gravity ({least / unit:.3g} to "
        f"{most / unit:.3g} {sensor.unit})"
    )
    if fitting := _fitting(median / unit, units.ACCELERATION, least, most):
        said = said, "; ", _in_unit("accelerometer", sensor.unit, fitting)
    elif others := _fitting(median / unit, _OTHER_ACCELERATIONS, least, most):
        known = ", ".join(units.ACCELERATION)
        said = said, f"; it would be in {' or '.join(others)}, and only {known} can be stated: convert it"
    if median < least:
        without = "it is without gravity, as linear or user acceleration is, or in free fall: then it shows no up"
        said = said, f"; or {without}"
    return said


def _odd_field(median: float, sensor: Magnetometer) -> Said:
    """Of the median norm of a magnetometer in a unit of its own, T."""
    fitting = _fitting(median / sensor.tesla, units.FIELD, _LEAST_FIELD, _MOST_FIELD)
    is_possible = units.WEAKEST_BESIDE_UT <= median / _MICROTESLA <= units.STRONGEST_BESIDE_UT
    if _LEAST_FIELD <= median <= _MOST_FIELD or (not fitting and is_possible):
        return ""
    number = median / sensor.tesla
    said = (
        f"its median norm is {number:.4g} {sensor.unit}, which is not the Earth's field "
        f"({_LEAST_FIELD / sensor.tesla:.3g} to {_MOST_FIELD / sensor.tesla:.3g} {sensor.unit})"
    )
    if fitting:
        return said, "; ", _in_unit("magnetometer", sensor.unit, fitting)
    if _LEAST_OF_UNIT <= number <= _MOST_OF_UNIT:
        normalized = Remedy(Key("magnetometer", "unit"), sensor.unit, "normalized")
        return said, "; a normalized one is about 1: ", normalized
    return said


def _allowed(limit: float, sensor: AnyDirection) -> str:
    """The strongest field (T) that a magnetometer may show."""
    assert isinstance(sensor, Magnetometer)  # of others no field is measured
    return f"allow at most {limit / sensor.tesla:.4g} {sensor.unit}, beside the Earth's {units.STRONGEST_FIELD_UT:g} µT"


def _odd_unit_field(median: float) -> Said:
    """Of the median norm of a normalized magnetometer."""
    if _LEAST_OF_UNIT <= median <= _MOST_OF_UNIT:
        return ""
    said = (
        f"its median norm is {median:.4g}, and a normalized field is about 1: is it normalized? That is "
        f"{_LEAST_OF_UNIT:g} to {_MOST_OF_UNIT:g}"
    )
    fitting = _fitting(median, units.FIELD, _LEAST_FIELD, _MOST_FIELD)
    return (said, "; ", _in_unit("magnetometer", "normalized", fitting)) if fitting else said


def _in_unit(of: Literal["accelerometer", "magnetometer"], stated: str, fitting: tuple[str, ...]) -> Remedy:
    """The first unit in which a sensor would show what it usually does."""
    return Remedy(Key(of, "unit"), stated, fitting[0], fitting)


def _fitting(number: float, known: Mapping[Any, float], least: float, most: float) -> tuple[str, ...]:
    """The units in which a number would be between these, in SI units."""
    return tuple(unit for unit, size in known.items() if least <= number * size <= most)
