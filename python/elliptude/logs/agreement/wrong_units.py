"""How much further than the rate says a body seems to turn if a unit is stated wrongly, and what to state then."""

import math
from collections.abc import Callable

import numpy as np

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings.finding import Key, Remedy, Said
from elliptude.configuration.motion import GyroFlow

FACTORS = (np.pi / 180.0, 180.0 / np.pi, 1e-3, 1e3, 1e-6, 1e-9)
"""How much further than the rate says a body may seem to turn if a unit is wrong."""
_LIKE = {
    np.pi / 180.0: "as if its degrees were declared as radians",
    180.0 / np.pi: "as if its radians were declared as degrees",
    1e-3: "as if the unit of time (or of the gyro) were 1000 times smaller",
    1e3: "as if the unit of time (or of the gyro) were 1000 times larger",
    1e-6: "as if the unit of time (or of the gyro) were a million times smaller",
    1e-9: "as if the unit of time were a billion times smaller",
}


def like(factor: float, configuration: Configuration) -> Said:
    """What it is like if a body turns one of `FACTORS` times as far as its rate says, and what to state then."""
    if 0.01 < factor < 100.0:
        declared, meant = ("rad/s", "deg/s") if factor < 1.0 else ("deg/s", "rad/s")
        _, unit = of_rates(configuration)
        return (_LIKE[factor], ": ", unit_of_rates(configuration, meant)) if unit == declared else _LIKE[factor]
    in_other = unit_of_time(configuration, lambda other: math.isclose(other, factor))
    return (_LIKE[factor], ": ", in_other) if in_other is not None else _LIKE[factor]


def of_rates(configuration: Configuration) -> tuple[str, units.AngularVelocityUnit]:
    """The name of what measures the rate, and its unit."""
    if isinstance(configuration.flow, GyroFlow):
        return "the gyro", configuration.flow.unit
    return "rate", "rad/s" if configuration.rate is None else configuration.rate.unit


def unit_of_rates(configuration: Configuration, meant: str, fitting: tuple[str, ...] = ()) -> Remedy:
    """Another unit of what measures the rate."""
    _, stated = of_rates(configuration)
    return Remedy(Key("gyro" if isinstance(configuration.flow, GyroFlow) else "rate", "unit"), stated, meant, fitting)


def unit_of_time(configuration: Configuration, fits: Callable[[float], bool]) -> Remedy | None:
    """The largest other unit of time for which it fits what the stated one is multiplied by to be it; None for none."""
    stated = getattr(configuration.flow, "time_unit", None) or configuration.time_unit
    meant = units.other_time_unit(stated, fits)
    return Remedy(Key("time", "time_unit"), stated, meant) if meant is not None else None
