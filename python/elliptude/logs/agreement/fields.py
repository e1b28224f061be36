"""Whether a magnetometer's field can only be in another unit than is stated."""

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.sensors import AnyDirection, Magnetometer
from elliptude.configuration.statements import FieldBound

_MICROTESLA = units.FIELD["uT"]
# T; magnetometers that show the Earth's field end well below.
_FULL_RANGE = 0.01


def voids_statements(strength: float, sensor: AnyDirection, configuration: Configuration) -> bool:
    """Whether a field (T) is too strong in the stated unit and not in another: errors in µT then count too little.

    The sensor shows (I + K) x + e of a field x, which is the Earth's and what is beside it. So with all of that as
    large as is stated no sample is longer than (1 + k) (B + d) + ε, where the Earth's field B is at most 70 µT. A
    stronger one that no unit would make the Earth's is that of a magnet or a coil, up to the sensor's full range.
    """
    if not isinstance(sensor, Magnetometer) or not _is_in_another_unit(strength, sensor):
        return False
    if configuration.rule is not None:
        rule = configuration.calibrated_rule().magnetometer
        if rule is None:
            return False
        own, beside = rule.sensor(), rule.disturbance_ut
    elif isinstance(sensor.bound_from, FieldBound):
        own, beside = configuration.sensor_bounds(sensor), sensor.bound_from.disturbance_ut
    else:
        return False
    strongest = (1.0 + own.scale_error) * (units.STRONGEST_FIELD_UT + beside) + own.error
    return strength > _MICROTESLA * strongest


def _is_in_another_unit(strength: float, sensor: Magnetometer) -> bool:
    """Whether a field (T) is not the Earth's as stated and would be in another unit, or is beyond all sensors."""

    def is_of_the_earth(field: float) -> bool:
        return units.WEAKEST_FIELD_UT <= field / _MICROTESLA <= units.STRONGEST_FIELD_UT

    if sensor.unit == "normalized" or is_of_the_earth(strength):
        return False
    return strength > _FULL_RANGE or any(
        is_of_the_earth(strength / sensor.tesla * size) for size in units.FIELD.values()
    )
