"""Whether a configuration states enough to know how far a reference by a phase of rest may be off."""

from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer
from elliptude.configuration.statements import AngleBound, FieldBound, RestPhase

# What an error in the sensor's own unit ends with.
_UNITS = ("_ut", "_m_per_s2")


def has_constant_angle(sensor: AnyDirection) -> bool:
    """Whether its bound is one angle for all samples, which holds in a rest as well."""
    return sensor.bound_from is None or isinstance(sensor.bound_from, AngleBound)


def why_rest_is_open(sensor: AnyDirection, accelerometer: Accelerometer | None) -> str | None:
    """What is missing to bound the reference of a magnetometer by a phase of rest; None if nothing is.

    An error of a sensor that nobody stated is no error of zero here: the same error makes the reference.
    """
    if not isinstance(sensor, Magnetometer) or not isinstance(sensor.reference, RestPhase):
        return None
    missing = []
    if sensor.reference_error_deg is None:
        by_gravity = sensor.reference.attitude_qw_qx_qy_qz is None
        missing += [one for one in (sensor, accelerometer if by_gravity else None) if one is not None]
    elif isinstance(sensor.bound_from, FieldBound) and "strength_error_ut" not in sensor.bound_from.model_fields_set:
        missing += [sensor]
    missing = [one for one in missing if not _states_its_error(one)]
    if not missing:
        return None
    errors = {"accelerometer": "error_m_per_s2", "magnetometer": "error_ut"}
    named = " and ".join(f"sensor_error.{errors[one.kind]} of {one.name!r}" for one in missing)
    instead = "reference_error_deg" if sensor.reference_error_deg is None else ""
    if isinstance(sensor.bound_from, FieldBound):
        instead += f"{' and ' if instead else ''}bound_from.strength_error_ut"
    return (
        f"{sensor.name!r}: its reference by a rest phase is as wrong as the sensors that showed it, and the guaranteed "
        f"mode has to know by how much: state {named}, or else {instead}"
    )


def _states_its_error(sensor: Accelerometer | Magnetometer) -> bool:
    return has_constant_angle(sensor) or any(key.endswith(_UNITS) for key in sensor.sensor_error.model_fields_set)
