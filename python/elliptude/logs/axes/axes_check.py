"""Finds axes or signs of sensors that a configuration states wrongly, and what would fit.

A choice of axes is contradicted where the vectors that it gives cannot be those of one gravity, or of one field, in the
frame that the gyro carries along: where they differ by more than motion, field, sensors and gyro may by what is stated
of them (`elliptude.logs.axes.sensor_axes`). A sign is contradicted where the angle between gravity and field is not the
one that their references state, and its supplement is. What a configuration does not state is as for a sensor in the
hand; no bound is taken to be less than that.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elliptude import units
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.windows import MotionBounds
from elliptude.configuration import rules
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings.finding import KEYS, Axes, Kind, Name, Said, TurnedRound
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import Rule
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer, rotation_of_axes
from elliptude.configuration.statements import AccelerationBound, FieldBound, VelocityWindowBound, WorldModel
from elliptude.logs.axes import sensor_axes
from elliptude.logs.axes.sensor_axes import ROTATIONS, AngleMisfit, VectorStatement
from elliptude.logs.axes.stated import Stated, over
from elliptude.logs.body_at_rest import axis_in_words, resting, up_in_log
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

# Other axes must fit this many times better than the stated ones, or nothing is sure.
_MARGIN = 2.0
# Relative to the length that a vector must have. Beyond, the unit or the vector is wrong, and no axes are tried.
_SHORTEST, _LONGEST = 0.5, 2.0
_FIELD_UT = 45.0
_MOST_NAMED = 4
# The signs of the gyro's rates that are tried.
_SIGNS = (1.0, -1.0)
_Choice: TypeAlias = tuple[int, int]
"""Which of these signs, and which of `elliptude.logs.axes.sensor_axes.ROTATIONS`."""


@dataclass(frozen=True)
class WrongAxes:
    """A sensor whose axes are not as stated."""

    sensor: str
    """Its name, or that of the gyro."""
    quotient: float
    """The largest difference as stated, divided by what the bounds allow."""
    fitting: tuple[tuple[float, FloatArray], ...]
    """What would fit, best first: the same quotient, and the axes (3, 3) as a configuration has them, left-handed ones
    too. Of the vector, the opposite fits as well."""
    said: Said
    is_sure: bool = True
    """Whether what is stated, and no wider bounds, rules the stated axes out."""

    @property
    def message(self) -> str:
        """What is said of the sensor, in the words of a configuration."""
        return KEYS(self.said)


@dataclass(frozen=True)
class AxesVerdict:
    """What a log shows of the axes of its sensors."""

    wrong: tuple[WrongAxes, ...]
    is_told: bool
    """Whether only what is stated fits, so that more of the log cannot show anything else."""


def look_at_axes(log: Log, configuration: Configuration, stated: Stated | None = None) -> AxesVerdict:
    """Try the axes of accelerometer and magnetometer against the gyro.

    Parameters
    ----------
    log : Log
    configuration : Configuration
    stated : Stated, optional
        The configuration's, if earlier pieces of the recording were looked at.

    Returns
    -------
    AxesVerdict
    """
    sensors = [sensor for sensor in configuration.directions if isinstance(sensor, Accelerometer | Magnetometer)]
    if log.rates is None or not sensors or len(log.times) < 3:
        return AxesVerdict((), True)
    known = np.isfinite(log.rates).all(axis=1)
    if known.sum() < 3:
        return AxesVerdict((), True)
    rates = np.column_stack([np.interp(log.times, log.times[known], column[known]) for column in log.rates.T])
    stated = Stated(configuration) if stated is None else stated
    rule = rules.hand_held() if configuration.rule is None else _wider_rule(configuration.rule.rule())
    rates, gyro = _gyro(log, rates, configuration, rule)
    vectors: dict[str, tuple[FloatArray, VectorStatement]] = {}
    for sensor in sensors:
        rows = log.directions[:, configuration.directions.index(sensor)]
        if isinstance(sensor, Magnetometer):
            rows = rows / units.FIELD["uT"]
        lengths = np.linalg.norm(rows, axis=1)
        if not np.isfinite(lengths).any():
            continue
        expected = sensor.gravity_m_per_s2 if isinstance(sensor, Accelerometer) else _FIELD_UT
        if _SHORTEST < float(np.nanmedian(lengths)) / expected < _LONGEST:
            offset = configuration.time_offset_of(sensor)
            if (sampled := log.sampled(configuration.directions.index(sensor))) is not None:
                offset += float(np.abs(sampled - log.times).max())
            vectors[sensor.name] = rows, _statement(sensor, rule, offset)

    def tried(sign: float) -> dict[str, FloatArray]:
        tables = sensor_axes.misfits_of_all(log.times, rates, list(vectors.values()), gyro, sign)
        return {name: table for name, table in zip(vectors, tables, strict=True) if table is not None}

    as_it_is = tried(1.0)
    is_told = len(as_it_is) == len(sensors) and all(table[1:].min() > 1.0 for table in as_it_is.values())
    if all(table[0] <= 1.0 for table in as_it_is.values()):
        wrong, are_signs_told = _signs(log, rates, gyro, vectors, configuration, stated)
        return AxesVerdict(tuple(wrong), is_told and are_signs_told)
    turned_round = tried(-1.0)
    both = {name: np.stack([table, turned_round[name]]) for name, table in as_it_is.items()}
    return AxesVerdict(tuple(_verdict(both, log, configuration, stated)), is_told)


def _wider_rule(rule: Rule) -> Rule:
    """The rule with no bound below that for a sensor in the hand; for rules that were proposed from a recording."""
    usual, stated = rules.hand_held().model_dump(), rule.model_dump(include=set(Rule.model_fields))
    for name, table in usual.items():
        if not isinstance(table, dict):
            continue
        if stated[name] is None:
            stated[name] = table
        for key, value in table.items():
            # An increment that is not stated is not a bound; neither are gravity, a delay and windows.
            is_bound = isinstance(value, float) and key not in {"gravity_m_per_s2", "delay_s", "window_s"}
            if is_bound and name != "rest" and stated[name][key] is not None:
                stated[name][key] = max(value, stated[name][key])
    return Rule.model_validate(stated)


def _gyro(log: Log, rates: FloatArray, configuration: Configuration, rule: Rule) -> tuple[FloatArray, GyroBounds]:
    """The rates without their bias, and their error bounds."""
    flow, usual = configuration.flow, rule.gyro_bounds()
    if not isinstance(flow, GyroFlow):
        assert configuration.rate is not None
        radius = float(np.sqrt(np.linalg.eigvalsh(configuration.rate.bound())[-1]))
        return rates, GyroBounds(max(radius, usual.noise), bias=np.deg2rad(rule.rest.rate_deg_per_s))
    accelerometer = configuration.accelerometer
    still = np.zeros(len(log.times), dtype=np.bool_)
    if accelerometer is not None:
        still = resting(log.times, log.rates, log.directions[:, configuration.directions.index(accelerometer)])
    stated = usual if flow.noise_deg_per_s is None else flow.bounds()
    bias = usual.bias
    if still.any():
        rates = rates - np.median(rates[still], axis=0)
    elif np.any(flow.known_bias_deg_per_s):
        rates = rates - np.deg2rad(flow.known_bias_deg_per_s)
    else:  # what a gyro that is not calibrated may show
        bias = np.deg2rad(rule.rest.rate_deg_per_s)
    increment = stated.increment
    if np.isinf(increment) and stated.noise <= usual.noise:
        increment = usual.increment
    return rates, GyroBounds(
        noise=max(stated.noise, usual.noise),
        bias=max(stated.bias, bias),
        drift=max(stated.drift, usual.drift),
        scale_error=max(stated.scale_error, usual.scale_error),
        increment=max(increment, usual.increment),
    )


def _statement(sensor: Accelerometer | Magnetometer, rule: Rule, offset: float) -> VectorStatement:
    bound = sensor.bound_from
    if isinstance(sensor, Accelerometer):
        usual, motion = rule.accelerometer, rule.motion.bounds()
        gravity_error = usual.gravity_error_m_per_s2
        if isinstance(bound, VelocityWindowBound):
            motion = _wider(motion, bound)
        if isinstance(bound, AccelerationBound | VelocityWindowBound):
            gravity_error = max(gravity_error, bound.gravity_error_m_per_s2)
        single = max(sensor.sensor_error.error_m_per_s2, usual.error_m_per_s2)
        averaged = sensor.sensor_error.averaged_error_m_per_s2
        averaged = sensor.sensor_error.error_m_per_s2 if averaged is None else averaged

        acceleration = bound.acceleration_m_per_s2 if isinstance(bound, AccelerationBound) else 0.0

        stamped = max(offset, usual.time_offset_bound_s)
        of_motion = over(motion, stamped)

        def mean_acceleration(half_length: float) -> float:
            return max(of_motion(half_length), acceleration)

        return VectorStatement(
            offset=mean_acceleration,
            error=single,
            averaged_error=max(averaged, usual.averaged_error_m_per_s2),
            averaged_over=max(sensor.sensor_error.averaged_over_s, usual.averaged_over_s),
            scale_error=_scale(sensor.sensor_error.scale_error, sensor, usual.scale_error),
            time_offset=stamped,
            length=sensor.gravity_m_per_s2,
            length_error=gravity_error,
        )
    of_field = rule.magnetometer
    assert of_field is not None  # the rule is of the hand at least
    disturbance = of_field.disturbance_ut
    if isinstance(bound, FieldBound):
        disturbance = max(disturbance, bound.disturbance_ut)
    averaged = sensor.sensor_error.averaged_error_ut
    averaged = sensor.sensor_error.error_ut if averaged is None else averaged
    return VectorStatement(
        offset=lambda _: disturbance,
        error=max(sensor.sensor_error.error_ut, of_field.error_ut),
        averaged_error=max(averaged, of_field.averaged_error_ut),
        averaged_over=max(sensor.sensor_error.averaged_over_s, of_field.averaged_over_s),
        scale_error=_scale(sensor.sensor_error.scale_error, sensor, of_field.scale_error),
        time_offset=max(offset, abs(of_field.delay_s) + of_field.time_offset_bound_s),
    )


def _wider(motion: MotionBounds, bound: VelocityWindowBound) -> MotionBounds:
    """The motion that the sensor's own statements allow, or that of the hand, whichever is more; none stated: any."""

    def wider(usual: float, stated: float | None) -> float:
        return np.inf if stated is None else max(usual, stated)

    return MotionBounds(
        wider(motion.velocity, bound.velocity_m_per_s),
        wider(motion.position, bound.position_m),
        np.inf if bound.acceleration_m_per_s2 is None else bound.acceleration_m_per_s2,
        wider(motion.jerk, bound.largest_jerk_m_per_s3),
    )


def _scale(stated: float, sensor: Accelerometer | Magnetometer, usual: float) -> float:
    """The scale error with the misalignment, which acts on every sample as a scale error does."""
    turned = 2.0 * math.sin(0.5 * math.radians(sensor.sensor_error.misalignment_deg))
    return min(max(stated, usual) + turned, 0.99)


# --- what follows -----------------------------------------------------------------------------------------------------


def _verdict(
    found: dict[str, FloatArray], log: Log, configuration: Configuration, statements: Stated
) -> list[WrongAxes]:
    fitting: dict[str, dict[_Choice, float]] = {}
    for name, table in found.items():
        if (stated := float(table[0, 0])) > 1.0:
            near = np.argwhere((table <= 1.0) & (_MARGIN * table <= stated))
            quotients = {(int(i), int(j)): float(table[i, j]) for i, j in near}
            fitting[name] = dict(sorted(quotients.items(), key=lambda one: one[1]))
    if not any(fitting.values()):
        return []
    # If all sensors are wrong alike, that is one mistake, the gyro's; and no axes of a vector mirror its turn.
    common = set.intersection(*(set(fits) for fits in fitting.values())) if len(fitting) == len(found) else set()
    if common and (len(found) > 1 or all(i == 1 for i, _ in common)):
        largest = {choice: max(fits[choice] for fits in fitting.values()) for choice in common}
        is_sure = any(statements.quotient(log, name) > 1.0 for name in fitting)
        blamed = _wrong_gyro(largest, max(float(found[name][0, 0]) for name in fitting), configuration)
        return [replace(blamed, is_sure=is_sure)]
    wrong = []
    for name, fits in fitting.items():
        own = {choice: quotient for choice, quotient in fits.items() if choice[0] == 0}
        if own:
            blamed = _wrong_vector(name, own, float(found[name][0, 0]), log, configuration, or_gyro=len(found) == 1)
            wrong.append(replace(blamed, is_sure=statements.quotient(log, name) > 1.0))
    return wrong


def _wrong_gyro(fits: dict[_Choice, float], stated: float, configuration: Configuration) -> WrongAxes:
    """Q x turns as s ω says, so x does as s Qᵀ ω: section 18.7."""
    flow = configuration.flow
    sensor = flow if isinstance(flow, GyroFlow) else configuration.rate
    assert sensor is not None
    name = "the gyro" if isinstance(flow, GyroFlow) else "rate"
    axes = rotation_of_axes(sensor.axes)
    ordered = sorted(fits.items(), key=lambda one: one[1])
    fitting = tuple((quotient, _SIGNS[i] * ROTATIONS[j].T @ axes) for (i, j), quotient in ordered)
    axes_of = functools.partial(_axes, "gyro" if isinstance(flow, GyroFlow) else "rate", sensor.columns)
    listed = _listed([(axes_of(matrix), f" ({quotient:.2g})") for quotient, matrix in fitting])
    more = "; or all of these have the same wrong axes" if any(i == 0 for i, _ in fits) else ""
    return WrongAxes(
        name, stated, fitting, (_not_as_stated(stated), " With ", listed, f" it fits all other sensors{more}")
    )


def _wrong_vector(
    name: str,
    fits: dict[_Choice, float],
    stated: float,
    log: Log,
    configuration: Configuration,
    *,
    or_gyro: bool,
) -> WrongAxes:
    sensor = next(one for one in configuration.directions if one.name == name)
    axes = rotation_of_axes(sensor.axes)
    fitting = tuple((quotient, ROTATIONS[j] @ axes) for (_, j), quotient in fits.items())
    at_rest = up_in_log(log, configuration) if isinstance(sensor, Accelerometer) else None
    assert isinstance(sensor, Accelerometer | Magnetometer)  # of others no axes are tried
    axes_of = functools.partial(_axes, sensor.kind, sensor.columns)
    each: list[Said] = []
    for (_, j), (quotient, matrix) in zip(fits, fitting, strict=True):
        up = "" if at_rest is None else f", with {axis_in_words(ROTATIONS[j] @ np.array(at_rest.up))} up at rest"
        each.append((axes_of(matrix), f" ({quotient:.2g}{up})"))
    opposite: Said = "its opposite, ", axes_of(-fitting[0][1])
    if isinstance(sensor, Accelerometer):
        opposite = "the same with ", _turned_round(sensor)
    said: Said = (
        f"{_not_as_stated(stated)} What fits is ",
        _listed(each),
        "; and so does ",
        opposite,
        ", as a vector and its opposite turn alike",
    )
    if or_gyro:
        gyro = configuration.flow if isinstance(configuration.flow, GyroFlow) else configuration.rate
        assert gyro is not None
        kind: Kind = "gyro" if isinstance(configuration.flow, GyroFlow) else "rate"
        of_gyro = next(ROTATIONS[j].T @ rotation_of_axes(gyro.axes) for _, j in fits)
        of_its = _axes(kind, gyro.columns, of_gyro)
        said = said, "; or those of the gyro are wrong, and ", of_its, " fits there"
    return WrongAxes(name, stated, fitting, said)


def _signs(
    log: Log,
    rates: FloatArray,
    gyro: GyroBounds,
    vectors: dict[str, tuple[FloatArray, VectorStatement]],
    configuration: Configuration,
    stated: Stated,
) -> tuple[list[WrongAxes], bool]:
    """What the angle between gravity and the field shows about their signs, and whether it shows anything; (18.18)."""
    accelerometer = configuration.accelerometer
    if configuration.rule is not None or accelerometer is None or accelerometer.name not in vectors:
        return [], True
    up = log.references[:, configuration.directions.index(accelerometer)]
    wrong, are_told = [], True
    for i, sensor in enumerate(configuration.directions):
        is_stated = isinstance(sensor, Magnetometer) and (
            sensor.reference_ut is not None or isinstance(sensor.reference, WorldModel)
        )
        if not is_stated or sensor.name not in vectors:
            continue
        angles = np.arctan2(
            np.linalg.norm(np.cross(up, log.references[:, i]), axis=1), (up * log.references[:, i]).sum(axis=1)
        )
        angles = angles[np.isfinite(angles)]
        if not len(angles):
            continue
        least, most = float(angles.min()), float(angles.max())
        angle, error = 0.5 * (least + most), 0.5 * (most - least) + _stated_angle(accelerometer) + _stated_angle(sensor)
        pair = vectors[accelerometer.name], vectors[sensor.name]
        found = sensor_axes.angle_misfit(log.times, rates, *pair, gyro, angle, error)
        if found is None:
            are_told = False
            continue
        are_told &= found.opposite > 1.0
        if found.as_stated > 1.0 and found.opposite <= 1.0 and _MARGIN * found.opposite <= found.as_stated:
            proof = stated.angle_misfit(log, accelerometer.name, sensor.name, angle, error)
            blamed = _wrong_sign(accelerometer, sensor, found, angle)
            wrong.append(replace(blamed, is_sure=proof is not None and proof.as_stated > 1.0))
    return wrong, are_told


def _stated_angle(sensor: AnyDirection) -> float:
    """How far its direction may be off by its own angle, if it states one, and by reference and alignment, rad."""
    if not sensor.is_bound_by_angle:
        return sensor.added_angle
    return float(np.sqrt(np.linalg.eigvalsh(sensor.bound())[-1]))


def _wrong_sign(accelerometer: Accelerometer, sensor: AnyDirection, found: AngleMisfit, stated: float) -> WrongAxes:
    assert isinstance(sensor, Magnetometer)
    opposite = -rotation_of_axes(sensor.axes)
    up, field = Name(accelerometer.name), Name(sensor.name)
    said = (
        "its sign or that of ",
        up,
        f" is not as stated: what they show is {math.degrees(found.median):.0f} degrees apart (median) and their "
        f"references {math.degrees(stated):.0f}, {found.as_stated:.2g} times further off than bounds of motion, field "
        f"and sensors allow. With one of the two turned round it fits ({found.opposite:.2g}): ",
        _turned_round(accelerometer),
        " for ",
        up,
        ", ",
        _axes("magnetometer", sensor.columns, opposite),
        " for ",
        field,
        ", or the opposite of its reference. Which one no log can tell: compare what is up at rest with how the body "
        "lay",
    )
    return WrongAxes(sensor.name, found.as_stated, ((found.opposite, opposite),), said)


def _not_as_stated(quotient: float) -> str:
    return (
        f"its axes are not as stated: what it shows differs by {quotient:.2g} times what the bounds of motion, field "
        "and sensors allow."
    )


def _axes(of: Kind, columns: Sequence[str], matrix: FloatArray) -> Axes:
    return Axes(of, tuple(columns), tuple(map(tuple, matrix.tolist())))


def _turned_round(sensor: Accelerometer) -> TurnedRound:
    return TurnedRound("down" if sensor.at_rest == "up" else "up")


def _listed(said: Sequence[Said]) -> Said:
    more = f", and {len(said) - _MOST_NAMED} others" if len(said) > _MOST_NAMED else ""
    first, *others = said[:_MOST_NAMED]
    return first, *((" or ", one) for one in others), more
