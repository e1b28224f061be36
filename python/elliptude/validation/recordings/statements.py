"""What a configuration of the guaranteed mode states, by a rule or sensor by sensor, in SI units."""

import math
from dataclasses import dataclass, replace

import numpy as np

from elliptude import units
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.windows import MotionBounds
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow, RigidBodyFlow
from elliptude.configuration.rules import RestRule, Rule
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Direction, Magnetometer, Rate, Velocity
from elliptude.configuration.statements import (
    SUN_ERROR_DEG,
    AccelerationBound,
    FieldBound,
    RestPhase,
    SunByTime,
    VelocityWindowBound,
)
from elliptude.io.files import FileError
from elliptude.typing import FloatArray

# Without a rule that says it, a rest is this long at least, s.
_REST = 2.0


@dataclass(frozen=True)
class StatedGyro:
    """What is stated of the gyro and of how the body turns."""

    bounds: GyroBounds
    known_bias: FloatArray
    """rad/s, shape (3,)."""
    is_estimated: bool
    """Whether the bias is part of the state, and moves no faster than it drifts."""
    between: float
    """How fast the rate changes between samples beside the noise, rad/s²."""
    holds: bool
    """Whether the rate between two samples is that of the one before."""
    interval: float | None
    """The longest interval that is stated, s."""
    increment_over: float
    """The longest window that the increment is stated for, s."""
    correction: FloatArray
    """What samples are multiplied with, shape (3, 3): the scale error is that of what comes of it, all else theirs."""

    @property
    def stretch(self) -> float:
        """What the correction makes of a sample, at most."""
        return float(np.linalg.norm(self.correction, 2))

    @property
    def noise_of_rate(self) -> float:
        """How far a true rate may be off by noise of samples, rad/s."""
        return self.stretch * self.bounds.noise / (1.0 - self.bounds.scale_error)


@dataclass(frozen=True)
class StatedBody:
    """What is stated of a rigid body and of the torques on it."""

    flow: RigidBodyFlow
    inertia: FloatArray
    """kg m², shape (3, 3)."""
    largest_rate: float
    """rad/s."""


@dataclass(frozen=True)
class StatedForce:
    """What is stated of the accelerometer, and of how it moves."""

    sensor: VectorSensorBounds
    motion: MotionBounds
    windows: tuple[float, ...]
    """Lengths of the windows that are tried, s; none for single samples."""
    gravity: float
    gravity_error: float
    angle: float | None
    """If each sample is within a constant angle of up, rad."""


@dataclass(frozen=True)
class StatedField:
    """What is stated of the magnetometer, and of the field."""

    sensor: VectorSensorBounds
    disturbance: float
    """µT."""
    strength_error: float
    """µT."""
    angle: float | None
    """If each sample is within a constant angle of the reference, rad."""


@dataclass(frozen=True)
class StatedRest:
    """A rest that the log must have, in the time of its rows."""

    begin: float
    """s after the first row."""
    end: float
    velocity: float
    """m/s."""
    field_change: float
    """How far the field may be from its mean over the rest, µT."""
    shows: RestRule | None
    """By which a rule finds it, and takes the gyro's bias from it."""


class Stated:
    """All that a configuration states.

    Parameters
    ----------
    configuration : Configuration

    Raises
    ------
    FileError
        If it states something of which no logs are drawn.
    """

    def __init__(self, configuration: Configuration) -> None:
        self.configuration = configuration
        self.rule: Rule | None = None if configuration.rule is None else configuration.rule.rule()
        _require_drawable(configuration)
        self.flow = configuration.flow
        self.directions: tuple[AnyDirection, ...] = configuration.directions
        self.velocity: Velocity | None = configuration.velocity
        self.rate = configuration.rate
        self.body = _body(self.flow) if isinstance(self.flow, RigidBodyFlow) else None
        self._gyro = None if self.body is not None else self._stated_gyro()
        self.force, self.field = self._force(), self._field()
        self.rests = self._rests()

    def offset_of(self, sensor: AnyDirection | Rate) -> float:
        """How far a sensor's stamps may be off beside the gyro's, s."""
        if self.rule is None:
            return sensor.time_offset_bound_s
        if isinstance(sensor, Accelerometer):
            return self.rule.accelerometer.time_offset_bound_s
        assert self.rule.magnetometer is not None
        return self.rule.magnetometer.time_offset_bound_s

    @property
    def offset_of_force(self) -> float:
        """That of the accelerometer, s."""
        sensor = self.configuration.accelerometer
        return 0.0 if sensor is None else self.offset_of(sensor)

    @property
    def offset_change(self) -> float:
        """How far the accelerometer's offsets may differ within a window, s; 0 if it is not stated."""
        if self.rule is not None:
            return self.rule.accelerometer.time_offset_change_s or 0.0
        sensor = self.configuration.accelerometer
        bound = None if sensor is None else sensor.bound_from
        return (bound.time_offset_change_s or 0.0) if isinstance(bound, VelocityWindowBound) else 0.0

    def delay_of(self, sensor: AnyDirection | Rate) -> float:
        """How late a sensor's stamps are, s."""
        if self.rule is not None and self.rule.magnetometer is not None and isinstance(sensor, Magnetometer):
            return self.rule.magnetometer.delay_s
        return sensor.delay_s

    @property
    def main_clock(self) -> str:
        """The column of the gyro's times; those of a rigid body's torques."""
        return getattr(self.flow, "time_column", None) or self.configuration.time_column

    @property
    def main_delay(self) -> float:
        """How late these are, s."""
        return self.flow.delay_s if isinstance(self.flow, GyroFlow) else 0.0

    @property
    def gyro_offset(self) -> float:
        """How far the gyro's stamps may be off against all others, s."""
        return self.flow.time_offset_bound_s if isinstance(self.flow, GyroFlow) else 0.0

    @property
    def longest_window(self) -> float:
        """The longest window of the accelerometer, s; 0 without one."""
        return max(self.force.windows, default=0.0) if self.force is not None else 0.0

    @property
    def gyro(self) -> StatedGyro:
        """What is stated of the gyro, which a rigid body has not."""
        assert self._gyro is not None
        return self._gyro

    def _stated_gyro(self) -> StatedGyro:
        flow = self.flow
        assert isinstance(flow, GyroFlow)
        if self.rule is not None:
            over = max(self.rule.motion.windows_s)
            interval = self.rule.gyro.longest_interval_s
            bounds, correction = self._calibrated_gyro(self.rule)
            return StatedGyro(bounds, np.zeros(3), False, 0.0, False, interval, over, correction)
        windows = [w for sensor in self.directions for w in getattr(sensor.bound_from, "windows_s", ())]
        return StatedGyro(
            flow.bounds(),
            flow.known_bias(),
            flow.estimate_bias,
            math.radians(flow.angular_acceleration_deg_per_s2),
            flow.interval_rate == "first_sample",
            flow.longest_interval_s,
            max([*windows, flow.anchor_s or 0.0]),
            np.eye(3),
        )

    def _calibrated_gyro(self, rule: Rule) -> tuple[GyroBounds, FloatArray]:
        """What is stated of the samples, but for the scale error that a correction leaves, and the correction."""
        bounds, found = rule.gyro.bounds(), self.configuration.gyro_correction()
        if found is None:
            return bounds, np.eye(3)
        # Scale error, noise and bias were taken apart together: noise and bias are as large as either says.
        bounds = replace(
            bounds,
            scale_error=found.scale_error,
            noise=max(bounds.noise, math.radians(found.noise_deg_per_s or 0.0)),
            bias=max(bounds.bias, math.radians(found.bias_deg_per_s or 0.0)),
        )
        if found.noise_deg_per_s is not None:
            told = math.inf if found.increment_deg is None else math.radians(found.increment_deg)
            increment = max(bounds.increment, told)
            bounds = replace(
                bounds, increment=increment, noise_turn=math.inf, noise_turn_growth=0.0, bias_change=math.inf
            )
        return bounds, np.asarray(found.matrix)

    def _calibrated(self, sensor: Accelerometer | Magnetometer, stated: VectorSensorBounds) -> VectorSensorBounds:
        """What is left of a sensor's errors if its samples are corrected, or else what is stated of them."""
        found = self.configuration.correction_of(sensor)
        if found is None:
            return stated
        error, averaged = found.left()
        return VectorSensorBounds(error, found.scale_error, stated.misalignment, averaged, found.averaged_over_s)

    def _force(self) -> StatedForce | None:
        sensor = self.configuration.accelerometer
        if sensor is None:
            return None
        if self.rule is not None:
            stated, moves = self.rule.accelerometer, self.rule.motion
            return StatedForce(
                self._calibrated(sensor, stated.sensor()),
                moves.bounds(),
                moves.windows_s,
                stated.gravity_m_per_s2,
                stated.gravity_error_m_per_s2,
                None,
            )
        bound, errors = sensor.bound_from, self._calibrated(sensor, sensor.sensor_error.bounds())

        def known(value: float | None) -> float:
            return math.inf if value is None else value

        if isinstance(bound, VelocityWindowBound):
            motion = MotionBounds(
                known(bound.velocity_m_per_s),
                known(bound.position_m),
                known(bound.acceleration_m_per_s2),
                known(bound.largest_jerk_m_per_s3),
            )
            return StatedForce(
                errors, motion, bound.windows_s, sensor.gravity_m_per_s2, bound.gravity_error_m_per_s2, None
            )
        if isinstance(bound, AccelerationBound):
            motion = MotionBounds(acceleration=bound.acceleration_m_per_s2)
            return StatedForce(errors, motion, (), sensor.gravity_m_per_s2, bound.gravity_error_m_per_s2, None)
        return StatedForce(errors, MotionBounds(), (), sensor.gravity_m_per_s2, 0.0, radius_of(sensor))

    def _field(self) -> StatedField | None:
        sensor = next((one for one in self.directions if isinstance(one, Magnetometer)), None)
        if sensor is None:
            return None
        if self.rule is not None:
            assert self.rule.magnetometer is not None
            errors = self._calibrated(sensor, self.rule.magnetometer.sensor())
            return StatedField(errors, self.rule.magnetometer.disturbance_ut, 0.0, None)
        bound, errors = sensor.bound_from, self._calibrated(sensor, sensor.sensor_error.bounds())
        if isinstance(bound, FieldBound):
            return StatedField(errors, bound.disturbance_ut, bound.strength_error_ut, None)
        return StatedField(errors, 0.0, 0.0, radius_of(sensor))

    def _rests(self) -> tuple[StatedRest, ...]:
        if self.rule is not None:
            rest = self.rule.rest
            lasts = max(rest.least_s, rest.most_s or 0.0)
            return (StatedRest(0.0, lasts, rest.velocity_m_per_s, self.rule.field_change(), rest),)
        sensor = next((one for one in self.directions if isinstance(one, Magnetometer)), None)
        if sensor is None or not isinstance(sensor.reference, RestPhase):
            return ()
        phase, motion = sensor.reference, self.force.motion if self.force is not None else MotionBounds()
        velocity = motion.velocity if phase.velocity_m_per_s is None else phase.velocity_m_per_s
        change = self.field.disturbance if self.field is not None else 0.0
        return (StatedRest(phase.from_s, phase.to_s, velocity, change, None),)


def _body(flow: RigidBodyFlow) -> StatedBody:
    stated = np.asarray(flow.inertia_kg_m2, dtype=np.float64)
    largest = math.inf if flow.largest_rate_deg_per_s is None else math.radians(flow.largest_rate_deg_per_s)
    return StatedBody(flow, np.diag(stated) if stated.ndim == 1 else stated, largest)


def radius_of(sensor: AnyDirection) -> float:
    """The angle within which a direction with a constant bound lies, rad; of an ellipsoid the ball about it counts."""
    if sensor.bound_rad2 is not None:
        return float(math.sqrt(np.linalg.eigvalsh(np.asarray(sensor.bound_rad2))[-1]))
    degrees = sensor.bound_deg if sensor.bound_from is None else getattr(sensor.bound_from, "angle_deg", None)
    assert degrees is not None
    return math.radians(degrees)


def added_to(sensor: AnyDirection) -> float:
    """How far the reference and the sensor's axes may be off together, rad."""
    of_sun = isinstance(sensor, Direction) and isinstance(sensor.reference, SunByTime)
    of_reference = sensor.reference_error_deg
    if of_reference is None:
        of_reference = SUN_ERROR_DEG if of_sun else 0.0
    return math.radians(of_reference + sensor.alignment_error_deg)


def _require_drawable(configuration: Configuration) -> None:
    open_still = []
    if configuration.estimator.mode != "guaranteed":
        open_still.append("estimator.mode: only 'guaranteed' promises anything")
    flow, references = configuration.flow, [getattr(sensor, "reference", None) for sensor in configuration.directions]
    if isinstance(flow, RigidBodyFlow):
        if any(isinstance(reference, RestPhase) for reference in references):
            open_still.append("directions.reference: a rest of a rigid body, which torques turn, is not drawn")
        if flow.potential.lacks_time(1) and configuration.timing.origin == "first":
            open_still.append("timing.origin: flow.potential.stated_at_s has to say which time it is stated for")
    if open_still:
        raise FileError("; ".join(open_still))


def tesla_of(sensor: Magnetometer) -> float:
    """How many µT a sensor's unit is."""
    return sensor.tesla / units.FIELD["uT"]
