"""Whether a magnetometer shows more than the Earth's field and all that is stated beside it."""

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.sensors import AnyDirection, Magnetometer
from elliptude.configuration.statements import FieldBound

_MICROTESLA = units.FIELD["uT"]


def voids_statements(strength: float, sensor: AnyDirection, configuration: Configuration) -> bool:
    """Whether a field (T) is stronger than all that is stated allows: errors in µT then count too little.

    The sensor shows (I + K) x + e of a field x, which is the Earth's and what is beside it. So with all of that as
    large as is stated no sample is longer than (1 + k) (B + d) + ε, where the Earth's field B is at most 70 µT.
    """
    if not isinstance(sensor, Magnetometer):
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
