"""Whether a magnetometer's field can only be in another unit than is stated."""

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.sensors import AnyDirection, Magnetometer
from elliptude.configuration.statements import FieldBound

_MICROTESLA = units.FIELD["uT"]
# T; magnetometers that show the Earth's field end well below.
_FULL_RANGE = 0.01


def exceeded_limit(strength: float, sensor: AnyDirection, configuration: Configuration) -> float | None:
    """The strongest field (T) that what is stated allows, if one is stronger and the Earth's in another unit.

    Else None. The sensor shows (I + K) x + e of a field x, which is the Earth's and what is beside it. So with all of
    that as large as is stated no sample is longer than (1 + k) (B + d) + ε, where the Earth's field B is at most 70 µT.
    A stronger one that no unit would make the Earth's is that of a magnet or a coil, up to the sensor's full range.
    Where the unit is another, errors in µT count too little.
    """
    if not isinstance(sensor, Magnetometer) or not _is_in_another_unit(strength, sensor):
        return None
    if configuration.rule is not None:
        rule = configuration.calibrated_rule().magnetometer
        if rule is None:
            return None
        own, beside = rule.sensor(), rule.disturbance_ut
    elif isinstance(sensor.bound_from, FieldBound):
        own, beside = configuration.sensor_bounds(sensor), sensor.bound_from.disturbance_ut
    else:
        return None
    strongest = (1.0 + own.scale_error) * (units.STRONGEST_FIELD_UT + beside) + own.error
    limit = _MICROTESLA * strongest
    return limit if strength > limit else None


def _is_in_another_unit(strength: float, sensor: Magnetometer) -> bool:
    """Whether a field (T) is not the Earth's as stated and would be in another unit, or is beyond all sensors."""

    def is_of_the_earth(field: float) -> bool:
        return units.WEAKEST_FIELD_UT <= field / _MICROTESLA <= units.STRONGEST_FIELD_UT

    if sensor.unit == "normalized" or is_of_the_earth(strength):
        return False
    return strength > _FULL_RANGE or any(
        is_of_the_earth(strength / sensor.tesla * size) for size in units.FIELD.values()
    )
