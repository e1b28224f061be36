"""The field that a log shows in a phase of rest, and how far the reference that is made of it may be off.

The sensors that show it are as wrong there as elsewhere: docs/theory.md, section 18.5.
"""

import math
from dataclasses import dataclass

import numpy as np

from elliptude import units
from elliptude.bounds.gyro import usual_longest, with_rounding
from elliptude.bounds.rest import mean_acceleration_at_rest, mean_at_rest
from elliptude.bounds.samples import VectorSensorBounds, angle_to_center
from elliptude.configuration import references
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.rest_reference import has_constant_angle, why_rest_is_open
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer
from elliptude.configuration.statements import AccelerationBound, FieldBound, RestPhase, VelocityWindowBound
from elliptude.io.files import FileError
from elliptude.io.readers.base import LogFile
from elliptude.logs.alignment.rows import pieces
from elliptude.logs.channels import clocks_of
from elliptude.typing import FloatArray

_MICROTESLA = units.FIELD["uT"]
# The mean of vectors over the mean of their lengths: 0.98 where they scatter by 11 degrees.
_STILL = 0.98


@dataclass(frozen=True, eq=False)
class RestMean:
    """What a sensor shows in a rest in the mean."""

    vector: FloatArray
    """m/s² or T, body axes, shape (3,)."""
    error: float
    """Bound of the mean of the sensor's error, its scale apart, in the sensor's unit: m/s² or µT."""
    lasted: float
    """How long it was averaged, s."""


@dataclass(frozen=True, eq=False)
class RestField:
    """The field in a phase of rest."""

    field: RestMean
    force: RestMean | None
    """None where an attitude turns the field into reference axes."""

    def reference(self, phase: RestPhase, configuration: Configuration) -> FloatArray:
        """In T and reference axes, shape (3,)."""
        upward = None if self.force is None else self.force.vector
        return references.rest_field(phase, self.field.vector, upward, configuration.reference_frame)


@dataclass(frozen=True)
class ReferenceBounds:
    """How far a reference may be off."""

    angle: float
    """rad."""
    strength: float
    """Its length, µT."""


def field_in_rest(file: LogFile, sensor: Magnetometer, configuration: Configuration) -> RestField:
    """The means over the phase of rest that a magnetometer's reference is made of.

    Raises
    ------
    FileError
        If a sensor shows nothing in that phase, or turns.
    """
    phase = sensor.reference
    assert isinstance(phase, RestPhase)
    field = _rest_mean(file, sensor, phase, configuration)
    if phase.attitude_qw_qx_qy_qz is not None:
        return RestField(field, None)
    assert configuration.accelerometer is not None  # the configuration's check
    return RestField(field, _rest_mean(file, configuration.accelerometer, phase, configuration))


def _rest_mean(
    file: LogFile, sensor: Accelerometer | Magnetometer, phase: RestPhase, configuration: Configuration
) -> RestMean:
    (clock,) = clocks_of(file, configuration, [sensor.name])
    found_times, found_values = [], []
    for piece in pieces(file, [clock], configuration.timing.effective()):
        times, values = piece.times + piece.origin, piece.values[sensor.name][:, :3]
        chosen = (times >= phase.from_s) & (times <= phase.to_s) & np.isfinite(values[:, 0])
        found_times.append(times[chosen])
        found_values.append(values[chosen])
        if times[-1] > phase.to_s:
            break
    times = np.concatenate(found_times) if found_times else np.empty(0)
    vectors = np.concatenate(found_values) if found_values else np.empty((0, 3))
    where = f"the rest phase from {phase.from_s:g} s to {phase.to_s:g} s"
    if not len(times):
        raise FileError(f"{file.path}: {sensor.name!r} shows nothing in {where}")
    if np.linalg.norm(vectors.sum(axis=0)) < _STILL * np.linalg.norm(vectors, axis=1).sum():
        raise FileError(f"{file.path}: {sensor.name!r} turns in {where}")
    unit = 1.0 if isinstance(sensor, Accelerometer) else _MICROTESLA
    # Samples were lost in a longer step, and no mean is stated across it.
    longest = with_rounding(usual_longest(np.diff(times)), times)
    mean, error, lasted = mean_at_rest(times, vectors / unit, configuration.sensor_bounds(sensor), longest_step=longest)
    return RestMean(unit * mean, error, lasted)


# --- how far it may be off --------------------------------------------------------------------------------------------


def reference_error(sensor: Magnetometer, configuration: Configuration, rest: RestField | None) -> ReferenceBounds:
    """How far a reference by a phase of rest may be off: what is stated of it, and else what its sensors may be.

    Parameters
    ----------
    sensor : Magnetometer
        Whose reference is of kind "rest_phase".
    configuration : Configuration
    rest : RestField, optional
        What the log has of that phase.

    Raises
    ------
    ValueError
        If that does not follow from what is stated; it says what is missing.
    """
    open_still = why_rest_is_open(sensor, configuration.accelerometer)
    if open_still is not None:
        raise ValueError(open_still)
    bound = sensor.bound_from
    strength = bound.strength_error_ut if isinstance(bound, FieldBound) else 0.0
    by_length = isinstance(bound, FieldBound) and "strength_error_ut" not in bound.model_fields_set
    if rest is None and (by_length or sensor.reference_error_deg is None):
        raise ValueError(f"{sensor.name!r}: the log does not say what its rest phase showed; state reference_error_deg")
    if by_length:
        assert rest is not None
        strength = _field_error(rest.field, configuration.sensor_bounds(sensor))
    if sensor.reference_error_deg is not None:
        return ReferenceBounds(math.radians(sensor.reference_error_deg), strength)
    assert rest is not None
    angle = _of_field(sensor, rest.field, configuration)
    phase = sensor.reference
    assert isinstance(phase, RestPhase)
    if rest.force is None:
        angle += math.radians(phase.attitude_error_deg)
    else:
        assert configuration.accelerometer is not None
        # By the choice of north both errors are in the plane of up and the field: they add up.
        angle += _of_up(configuration.accelerometer, rest.force, phase, configuration)
    if not angle < math.pi:
        raise ValueError(
            f"{sensor.name!r}: what is stated of the sensors leaves it open where the field of its rest phase points: "
            "state reference_error_deg, or smaller errors, or reference.velocity_m_per_s, how fast the body moves "
            "in that rest"
        )
    return ReferenceBounds(angle, strength)


def _field_error(mean: RestMean, sensor: VectorSensorBounds) -> float:
    """How far the mean field may be off in body axes, its axes apart, µT: (18.11) without its tilt."""
    return mean.error + _scaled(float(np.linalg.norm(mean.vector)) / _MICROTESLA, sensor)


def _scaled(length: float, sensor: VectorSensorBounds) -> float:
    return sensor.scale_error * (length + sensor.error) / (1.0 - sensor.scale_error)


def _of_field(sensor: Magnetometer, mean: RestMean, configuration: Configuration) -> float:
    """How far the mean field's direction may be off in body axes, rad."""
    if has_constant_angle(sensor):
        return _in_cone(sensor)
    errors = configuration.sensor_bounds(sensor)
    length = float(np.linalg.norm(mean.vector)) / _MICROTESLA
    share = _field_error(mean, errors) / length if length > 0.0 else math.inf
    angle = math.asin(share) if share < 1.0 else math.pi
    return angle + errors.misalignment + math.radians(sensor.alignment_error_deg)


def _of_up(sensor: Accelerometer, mean: RestMean, phase: RestPhase, configuration: Configuration) -> float:
    """How far the mean specific force may be from up, rad."""
    if has_constant_angle(sensor):
        return _in_cone(sensor)
    bound, errors = sensor.bound_from, configuration.sensor_bounds(sensor)
    assert isinstance(bound, AccelerationBound | VelocityWindowBound)
    length = float(np.linalg.norm(mean.vector))
    speeds = [phase.velocity_m_per_s, bound.velocity_m_per_s if isinstance(bound, VelocityWindowBound) else None]
    offset = configuration.time_offset_of(sensor)
    moved = [mean_acceleration_at_rest(speed, mean.lasted, offset) for speed in speeds if speed is not None]
    moved += [bound.acceleration_m_per_s2] if bound.acceleration_m_per_s2 is not None else []
    radius = mean.error + _scaled(length, errors) + min(moved, default=math.inf)
    tilt, excess = angle_to_center(length, sensor.gravity_m_per_s2, radius, bound.gravity_error_m_per_s2)
    if excess > 0.0:
        raise ValueError(
            f"in the rest phase {sensor.name!r} shows a specific force of {length:.4g} m/s^2, {excess:.2g} m/s^2 "
            "further from gravity than what is stated of it allows"
        )
    return float(tilt) + errors.misalignment + sensor.added_angle


def _in_cone(sensor: AnyDirection) -> float:
    """Of the mean of directions that are all within an angle: the cone holds it, unless it is no cone."""
    angle = math.sqrt(float(np.linalg.eigvalsh(sensor.bound())[-1]))
    return angle if angle < 0.5 * math.pi else math.pi
