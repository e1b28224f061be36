"""The directions of a log, row by row: the direction, its reference and the angle by which it may be off.

A configuration may state a constant angle, a bound of acceleration, speed or disturbance, or a rule for the
whole recording. Here this becomes one angle per row and sensor, for the guaranteed mode. Derivations: docs/theory.md,
section 18.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elliptude import units
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import DirectionBounds, VectorSensorBounds, accelerometer_bounds, magnetometer_bounds
from elliptude.bounds.stamps import time_offset_angles
from elliptude.bounds.velocity import MeasuredVelocity
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from elliptude.configuration import references, rules
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings import suspicions
from elliptude.configuration.motion import GyroFlow, RigidBodyFlow
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer
from elliptude.configuration.statements import AccelerationBound, FieldBound, RestPhase, VelocityWindowBound
from elliptude.estimation import gaps
from elliptude.logs.log import Log
from elliptude.logs.rest_phase import ReferenceBounds, RestField, reference_error
from elliptude.typing import FloatArray

_MICROTESLA = units.FIELD["uT"]
# A step of more than ten median ones is a gap for windows, whatever the gyro's bounds cover.
_LONGEST_STEP = 10.0


@dataclass(frozen=True)
class Contradiction:
    """A row whose measurement proves that a stated bound is wrong."""

    row: int
    sensor: str
    excess: float
    """By how much."""
    unit: str


@dataclass(frozen=True, eq=False)
class DirectionRows:
    """N rows of m directions, with their bounds."""

    names: tuple[str, ...]
    directions: FloatArray
    """Unit vectors in body axes, NaN where nothing is measured, shape (N, m, 3)."""
    references: FloatArray
    """In reference axes, shape (N, m, 3)."""
    angles: FloatArray
    """rad, shape (N, m); NaN: not measured or contradicted."""
    contradictions: tuple[Contradiction, ...]
    void: tuple[str, ...]
    """Names of the directions that a contradiction makes unusable for the whole recording."""
    gyro: GyroBounds | None
    """Bounds of what is left after ``bias`` is subtracted; the longest interval is stated, or follows from the log."""
    bias: FloatArray
    """To be subtracted from the gyro's rates, rad/s, shape (3,)."""
    up: FloatArray | None
    """The direction up in reference axes, if it is known, shape (3,)."""
    up_column: int | None
    """Which of the directions measures it."""


def direction_rows(log: Log, configuration: Configuration) -> DirectionRows:
    """Work out the directions of a log, and how far each may be off.

    Parameters
    ----------
    log : Log
    configuration : Configuration

    Returns
    -------
    DirectionRows

    Raises
    ------
    ValueError
        If a bound does not follow from the log, or a rule is not for this recording.
    """
    if configuration.rule is not None:
        return _by_rule(log, configuration)
    flow = configuration.flow
    bias = np.zeros(3)
    gyro: GyroBounds | None = None
    if isinstance(flow, GyroFlow):
        bias = flow.known_bias()
        gyro = replace(flow.bounds(), longest_interval=gaps.longest_interval(log, configuration))
    contradictions: list[Contradiction] = []
    found: list[DirectionBounds] = []
    for i, sensor in enumerate(configuration.directions):
        bounds = _of_sensor(sensor, i, log, bias, gyro, configuration)
        unit = "m/s^2" if isinstance(sensor, Accelerometer) else "uT"
        contradictions += _contradictions(bounds, sensor.name, unit)
        found.append(bounds)
    accelerometer = configuration.accelerometer
    return DirectionRows(
        names=tuple(sensor.name for sensor in configuration.directions),
        directions=_stacked([bounds.directions for bounds in found], len(log.times), 3),
        references=np.where(np.isfinite(log.references), log.references, [1.0, 0.0, 0.0]),
        angles=_stacked([bounds.angles[:, None] for bounds in found], len(log.times), 1)[:, :, 0],
        contradictions=tuple(contradictions),
        void=(),
        gyro=gyro,
        bias=bias,
        up=references.up(configuration.reference_frame) if accelerometer else None,
        up_column=configuration.directions.index(accelerometer) if accelerometer else None,
    )


def _stacked(arrays: list[FloatArray], count: int, width: int) -> FloatArray:
    return np.stack(arrays, axis=1) if arrays else np.empty((count, 0, width))


def _radius(shape: FloatArray) -> float:
    """The radius of the ball about an ellipsoid."""
    return float(math.sqrt(np.linalg.eigvalsh(shape)[-1]))


def _contradictions(bounds: DirectionBounds, sensor: str, unit: str) -> list[Contradiction]:
    rows = np.flatnonzero(bounds.contradicted)
    return [Contradiction(int(row), sensor, float(bounds.excess[row]), unit) for row in rows]


# --- sensors that state their own bounds ------------------------------------------------------------------------------


def _of_sensor(
    sensor: AnyDirection, i: int, log: Log, bias: FloatArray, gyro: GyroBounds | None, configuration: Configuration
) -> DirectionBounds:
    vectors = log.directions[:, i]
    by_rest = _error_of_rest(sensor, log.rests[i] if log.rests else None, configuration)
    flow = configuration.flow
    offset, sampled = configuration.time_offset_of(sensor), log.sampled(i)
    rates = None if log.rates is None else log.rates - bias
    if isinstance(sensor.bound_from, VelocityWindowBound):
        assert isinstance(sensor, Accelerometer)
        assert isinstance(flow, GyroFlow)  # the configuration's check
        assert gyro is not None
        errors = configuration.sensor_bounds(sensor)
        if flow.angular_acceleration_deg_per_s2 > 0.0:
            # What the rate does between samples is not part of the noise, nor of its integral.
            off = flow.off_the_line(gyro.longest_interval)
            gyro = gyro.with_more_noise(off)
        velocity = measured_velocity(log, configuration)
        _require_as_slow(velocity, sensor.bound_from.velocity_m_per_s or np.inf, f"{sensor.name!r}")
        bounds = _over_windows(sensor, sensor.bound_from, errors, vectors, sampled, rates, gyro, log, offset, velocity)
    else:
        turned = np.zeros(len(log.times))
        if offset > 0.0 or sampled is not None:
            turned = _turned_by_offset(sensor, log, sampled, rates, offset, gyro, flow)
        bounds = _of_samples(sensor, configuration, vectors, log.references[:, i], turned, by_rest.strength)
    # While a stamp is off, its reference moves, too. (theory, section 18.3)
    away = offset if sampled is None else offset + np.abs(sampled - log.times)
    added = by_rest.angle + sensor.added_angle + away * sensor.reference_rate
    return DirectionBounds(bounds.directions, np.minimum(bounds.angles + added, np.pi), bounds.excess)


def _error_of_rest(sensor: AnyDirection, rest: RestField | None, configuration: Configuration) -> ReferenceBounds:
    """How far a reference is off beside what is stated: what the sensors may be in the rest that shows it."""
    if not isinstance(sensor, Magnetometer) or not isinstance(sensor.reference, RestPhase):
        return ReferenceBounds(0.0, 0.0)
    error = reference_error(sensor, configuration, rest)
    return error if sensor.reference_error_deg is None else ReferenceBounds(0.0, error.strength)


def _turned_by_offset(
    sensor: AnyDirection,
    log: Log,
    sampled: FloatArray | None,
    rates: FloatArray | None,
    offset: float,
    gyro: GyroBounds | None,
    flow: GyroFlow | RigidBodyFlow,
) -> FloatArray:
    """How far the body may turn between a sensor's stamps and the true times, rad, shape (N,)."""
    if isinstance(flow, RigidBodyFlow):
        # Between two measurements of its rate a body is turned by torques: no line bounds that.
        if flow.largest_rate_deg_per_s is None:
            raise ValueError(
                f"{sensor.name!r}: time_offset_bound_s of a rigid body needs flow.largest_rate_deg_per_s: how fast it "
                "turns between the measurements of its rate. So do stamps that timing.same_within_s moves"
            )
        away = np.zeros(len(log.times)) if sampled is None else np.abs(sampled - log.times)
        return math.radians(flow.largest_rate_deg_per_s) * (away + offset)
    assert rates is not None
    assert gyro is not None
    return turned_by_offset(log, rates, offset, gyro, flow, sampled)


def turned_by_offset(
    log: Log,
    rates: FloatArray,
    offset: float,
    gyro: GyroBounds,
    flow: GyroFlow,
    sampled: FloatArray | None = None,
) -> FloatArray:
    """How far the body may turn within a time about each row, rad, shape (N,); NaN where nothing is known.

    Parameters
    ----------
    log : Log
        Without rates in gaps.
    rates : (N, 3) array
        Those of the log without what is known of their bias.
    offset : float
        s.
    gyro : GyroBounds
    flow : GyroFlow
    sampled : (N,) array, optional
        A sensor's own stamps, s: about these, and from there to the row.
    """
    # Rates between the gyro's samples are on lines, which do not show what the true rate does there.
    rows, acceleration = log.gyro_rows, math.radians(flow.angular_acceleration_deg_per_s2)
    if not len(rows):
        return np.full(len(log.times), np.nan)
    return time_offset_angles(
        log.times[rows],
        rates[rows],
        offset,
        at=log.times,
        gyro=gyro,
        angular_acceleration=acceleration,
        sampled=sampled,
    )


def _of_samples(
    sensor: AnyDirection,
    configuration: Configuration,
    vectors: FloatArray,
    reference: FloatArray,
    turned: FloatArray,
    strength_error: float,
) -> DirectionBounds:
    bound = sensor.bound_from
    if isinstance(sensor, Accelerometer) and isinstance(bound, AccelerationBound):
        return accelerometer_bounds(
            vectors,
            bound.acceleration_m_per_s2,
            gravity=sensor.gravity_m_per_s2,
            gravity_error=bound.gravity_error_m_per_s2,
            sensor=configuration.sensor_bounds(sensor),
            time_offset=turned,
        )
    if isinstance(sensor, Magnetometer) and isinstance(bound, FieldBound):
        return magnetometer_bounds(
            vectors / _MICROTESLA,
            bound.disturbance_ut,
            strength=np.linalg.norm(reference, axis=1) / _MICROTESLA,
            strength_error=max(bound.strength_error_ut, strength_error),
            sensor=configuration.sensor_bounds(sensor),
            time_offset=turned,
        )
    lengths = np.linalg.norm(vectors, axis=1)
    if sensor.bound_rad2 is not None:
        angle = _radius(np.asarray(sensor.bound_rad2))
    else:
        angle_deg = sensor.bound_deg if bound is None else getattr(bound, "angle_deg", None)
        assert angle_deg is not None
        angle = math.radians(angle_deg)
    with np.errstate(invalid="ignore", divide="ignore"):
        directions = vectors / lengths[:, None]
    angles = np.where(lengths > 0.0, angle + turned, np.nan)
    return DirectionBounds(directions, angles, np.zeros_like(lengths))


def measured_velocity(log: Log, configuration: Configuration) -> MeasuredVelocity | None:
    """The velocities of a log, and how far each may be off; None where the configuration has none."""
    stated = configuration.velocity
    if stated is None or log.velocities is None:
        return None
    if not np.isfinite(log.velocities[:, 0]).any():
        raise ValueError(
            f"velocity: {', '.join(stated.columns)} were measured at no row between the gyro's first and last sample: "
            "leave the table out, or correct its time_column, time_unit and delay_s"
        )
    moved = 0.0 if log.velocity_offsets is None else log.velocity_offsets
    return MeasuredVelocity(
        log.times + moved,
        log.velocities,
        stated.error_m_per_s,
        stated.largest_acceleration_m_per_s2,
        stated.time_offset_bound_s,
    )


def _require_as_slow(velocity: MeasuredVelocity | None, largest: float, stated_by: str) -> None:
    """Refuse a stated speed that velocities refute: twice as much is the most by which they may differ."""
    if velocity is None or not np.isfinite(largest):
        return
    differences = np.ptp(np.asarray(velocity.velocities), axis=0)
    proved = float(differences.max()) - 2.0 * (velocity.error + velocity.largest_acceleration * velocity.time_offset)
    if proved > 2.0 * largest:
        raise ValueError(
            f"{stated_by} states a speed of at most {largest:g} m/s, but the measured velocity changes by "
            f"{differences.max():.3g} m/s along an axis: state how fast this vehicle goes (--carried of `elliptude "
            "bounds` has numbers for a car, a drone, a boat or a person)"
        )


def _over_windows(
    sensor: Accelerometer,
    bound: VelocityWindowBound,
    errors: VectorSensorBounds,
    vectors: FloatArray,
    sampled: FloatArray | None,
    rates: FloatArray | None,
    gyro: GyroBounds,
    log: Log,
    offset: float,
    velocity: MeasuredVelocity | None,
) -> DirectionBounds:
    assert rates is not None  # a gyro's
    # Rows of other sensors, with stamps of their own, are none of a window's. Their rates are on the line between the
    # gyro's, so that without them the turns are the same. (theory, section 18.3)
    rows = log.gyro_rows
    times, vectors_there = log.times[rows], vectors[rows]
    share = float(np.isfinite(vectors_there[:, 0]).mean()) if len(rows) else 0.0
    if share < 0.5:
        raise ValueError(
            f"{sensor.name!r}: bound_from.kind = 'velocity_window' needs samples at the stamps of the gyro, but only "
            f"{100.0 * share:.3g} % of the gyro's rows have both"
        )

    usual = float(np.median(np.diff(times))) if len(times) > 1 else math.inf

    def known(value: float | None) -> float:
        return math.inf if value is None else value

    found = gravity_bounds_over_windows(
        times,
        vectors_there,
        rates[rows],
        bound.windows_s,
        motion=MotionBounds(
            known(bound.velocity_m_per_s),
            known(bound.position_m),
            known(bound.acceleration_m_per_s2),
            known(bound.largest_jerk_m_per_s3),
        ),
        gyro=gyro,
        sensor=errors,
        gravity=sensor.gravity_m_per_s2,
        gravity_error=bound.gravity_error_m_per_s2,
        time_offset=offset,
        time_offset_change=known(bound.time_offset_change_s),
        at=bound.at,
        maximum_step=min(_LONGEST_STEP * usual, gyro.longest_interval),
        velocity=velocity,
        sampled=None if sampled is None else sampled[rows],
    )
    return _among(found, rows, log)


def _among(found: DirectionBounds, rows: NDArray[np.intp], log: Log) -> DirectionBounds:
    """Bounds of some rows of a log among all of them; the others are not measured."""
    count = len(log.times)
    directions, angles, excess = np.full((count, 3), np.nan), np.full(count, np.nan), np.zeros(count)
    directions[rows], angles[rows], excess[rows] = found.directions, found.angles, found.excess
    return DirectionBounds(directions, angles, excess)


# --- a rule -----------------------------------------------------------------------------------------------------------


def require_shared_stamps(log: Log, names: Sequence[str], rows: NDArray[np.intp]) -> None:
    """Refuse a log that a rule cannot describe, by these rows of it: its windows are of rows with all sensors.

    Raises
    ------
    ValueError
        If most rows lack a sensor; it is named.
    """
    for name, values in zip(names, log.directions.transpose(1, 0, 2), strict=True):
        share = float(np.isfinite(values[rows, 0]).mean())
        if share < 0.5:
            raise ValueError(
                f"{name!r}: a rule needs all sensors at the same stamps, and this one was sampled in "
                f"{100.0 * share:.3g} % of the rows alone. Log it at the gyro's rate, or let each sensor state "
                "its own bounds, as `elliptude bounds` does then"
            )


def _by_rule(log: Log, configuration: Configuration) -> DirectionRows:
    assert configuration.rule is not None
    assert configuration.accelerometer is not None
    assert log.rates is not None
    names = [sensor.name for sensor in configuration.directions]
    up_column = configuration.directions.index(configuration.accelerometer)
    # Rows in which other sensors alone were sampled are none of a window's.
    sampled = np.asarray(np.isfinite(log.directions[:, :, 0]).any(axis=1))
    sampled[log.gyro_rows] = True
    rows = np.flatnonzero(sampled) if log.gyro_times is not None else np.arange(len(log.times))
    require_shared_stamps(log, names, rows)
    vectors, rule = log.directions[rows], configuration.calibrated_rule()
    rule.require_earth_rate()
    own = [None if (times := log.sampled(i)) is None else times[rows] for i in range(len(names))]
    velocity = measured_velocity(log, configuration)
    _require_as_slow(velocity, rule.motion.velocity_m_per_s, "the rule")
    try:
        ruled = rules.apply_rule(
            rule,
            log.times[rows],
            log.rates[rows],
            vectors[:, up_column],
            None if len(names) == 1 else vectors[:, 1 - up_column] / _MICROTESLA,
            longest_interval=gaps.longest_interval(log, configuration),
            velocity=velocity,
            forces_sampled=own[up_column],
            fields_sampled=None if len(names) == 1 else own[1 - up_column],
        )
    except ValueError as error:
        why = suspicions.before_a_rules_refusal(rule, names[up_column], vectors[:, up_column])
        unused = "".join(f"; {one}" for one in configuration.calibrations_not_used().values())
        raise ValueError(f"{why}{error}{unused}") from error
    up = np.array([0.0, 0.0, 1.0])
    found = [(names[up_column], _among(ruled.up, rows, log), up, "m/s^2")]
    if ruled.field is not None and ruled.east is not None and ruled.field_reference is not None:
        east = "east" if "east" not in names else "field_east"
        found += [
            (names[1 - up_column], _among(ruled.field, rows, log), ruled.field_reference, "uT"),
            (east, _among(ruled.east, rows, log), np.array([1.0, 0.0, 0.0]), "uT"),
        ]
    contradictions = [one for name, bounds, _, unit in found for one in _contradictions(bounds, name, unit)]
    angles = np.stack([bounds.angles for _, bounds, _, _ in found], axis=1)
    return DirectionRows(
        names=tuple(name for name, _, _, _ in found),
        directions=np.stack([bounds.directions for _, bounds, _, _ in found], axis=1),
        references=np.broadcast_to(np.array([vector for _, _, vector, _ in found]), (len(log.times), len(found), 3)),
        angles=angles,
        contradictions=tuple(sorted(contradictions, key=lambda one: one.row)),
        void=tuple(name for i, (name, _, _, _) in enumerate(found) if not np.isfinite(angles[:, i]).any()),
        gyro=ruled.gyro,
        bias=ruled.bias,
        up=up,
        up_column=0,
    )
