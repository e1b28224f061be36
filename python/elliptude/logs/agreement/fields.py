"""Whether a magnetometer shows the Earth's field, or would in another unit."""

import numpy as np

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.sensors import AnyDirection, Magnetometer
from elliptude.configuration.statements import FieldBound
from elliptude.logs.agreement.findings import Finding
from elliptude.logs.log import Log

# T; the Earth's field at sea level.
WEAKEST_FIELD, STRONGEST_FIELD = 1e-6 * units.WEAKEST_FIELD_UT, 7.0e-5
_MICROTESLA = units.FIELD["uT"]


def units_of_field(strength: float, sensor: Magnetometer) -> list[str]:
    """The units in which a magnetometer's numbers would be the Earth's field; its strength is as stated, T."""
    fields = {unit: strength / sensor.tesla * size for unit, size in units.FIELD.items()}
    return [unit for unit, size in fields.items() if WEAKEST_FIELD <= size <= STRONGEST_FIELD]


def field_in_another_unit(strength: float, sensor: Magnetometer) -> str:
    """What is said of a field (T) that is not the Earth's as stated, and would be in another unit; else empty."""
    fitting = " or ".join(units_of_field(strength, sensor))
    if sensor.unit == "normalized" or WEAKEST_FIELD <= strength <= STRONGEST_FIELD or not fitting:
        return ""
    shown = f"{strength / sensor.tesla:.4g} {sensor.unit}"
    return f"its median norm is {shown}, which is not the Earth's field; it would be in {fitting}"


def voids_statements(strength: float, sensor: AnyDirection, configuration: Configuration) -> bool:
    """Whether a field (T) is too strong in the stated unit and not in another: errors in µT then count too little.

    The sensor shows (I + K) x + e of a field x, which is the Earth's and what is beside it. So with all of that as
    large as is stated no sample is longer than (1 + k) (B + d) + ε, where the Earth's field B is at most 70 µT.
    """
    if not isinstance(sensor, Magnetometer) or not field_in_another_unit(strength, sensor):
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
    strongest = (1.0 + own.scale_error) * (STRONGEST_FIELD / _MICROTESLA + beside) + own.error
    return strength > _MICROTESLA * strongest


def fields_in_other_units(log: Log, configuration: Configuration) -> list[Finding]:
    """The magnetometers of a log whose fields are too strong in the stated unit, and not in another."""
    found = []
    for i, sensor in enumerate(configuration.directions):
        strengths = np.linalg.norm(log.directions[:, i], axis=1)
        strengths = strengths[np.isfinite(strengths)]
        strength = float(np.median(strengths)) if len(strengths) else 0.0
        if isinstance(sensor, Magnetometer) and voids_statements(strength, sensor, configuration):
            what = field_in_another_unit(strength, sensor)
            message = f"{what}, and what is stated of its errors in µT counts too little"
            found.append(Finding("error", sensor.name, message))
    return found
