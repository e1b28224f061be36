"""Units that a configuration may state: the size of each in SI units, and how people write it."""

import math
from collections.abc import Callable
from typing import Literal, TypeAlias

TimeUnit: TypeAlias = Literal["s", "ms", "0.1ms", "us", "ns"]
AngularVelocityUnit: TypeAlias = Literal["rad/s", "deg/s"]
VelocityUnit: TypeAlias = Literal["m/s", "km/h", "kn"]
AccelerationUnit: TypeAlias = Literal["m/s^2", "g", "mg"]
FieldUnit: TypeAlias = Literal["T", "mT", "G", "mG", "uT", "nT"]
MagnetometerUnit: TypeAlias = Literal[FieldUnit, "normalized"]
"""Normalized: 1 is the strength of a field, which ``unit_ut`` of the sensor states (docs/theory.md, section 18.1)."""
WEAKEST_FIELD_UT, STRONGEST_FIELD_UT = 20.0, 70.0
"""µT; the Earth's field is nowhere on its surface weaker, and nowhere stronger."""
WEAKEST_BESIDE_UT, STRONGEST_BESIDE_UT = 5.0, 500.0
"""µT; with steel and magnets within reach it is hardly ever weaker, or stronger."""

STANDARD_GRAVITY = 9.80665
"""m/s², the unit g; gravity itself is 9.764 to 9.834 m/s² over the Earth's surface."""

TICKS_PER_SECOND: dict[TimeUnit, int] = {"s": 1, "ms": 1_000, "0.1ms": 10_000, "us": 1_000_000, "ns": 1_000_000_000}
ANGULAR_VELOCITY: dict[AngularVelocityUnit, float] = {"rad/s": 1.0, "deg/s": math.pi / 180.0}
VELOCITY: dict[VelocityUnit, float] = {"m/s": 1.0, "km/h": 1.0 / 3.6, "kn": 1852.0 / 3600.0}
ACCELERATION: dict[AccelerationUnit, float] = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000.0}
FIELD: dict[FieldUnit, float] = {"T": 1.0, "mT": 1e-3, "G": 1e-4, "mG": 1e-7, "uT": 1e-6, "nT": 1e-9}

SPELLINGS: dict[str, str] = {
    **dict.fromkeys(("sec", "seconds"), "s"),
    **dict.fromkeys(("µs", "μs"), "us"),
    **dict.fromkeys(("°/s", "dps"), "deg/s"),
    **dict.fromkeys(("rad s^-1", "rad s-1", "rad·s⁻¹"), "rad/s"),
    **dict.fromkeys(("m/s²", "m/s2", "m s^-2", "m s-2", "m·s⁻²"), "m/s^2"),
    **dict.fromkeys(("µT", "μT"), "uT"),
    **dict.fromkeys(("gauss", "Gauss", "Gs"), "G"),
    **dict.fromkeys(("mgauss", "mGauss", "milligauss"), "mG"),
}
"""How headers of files spell some of these units."""


SELDOM_S, OFTEN_S = 0.9, 2.8e-5
"""s; few gyros are read so seldom, unless it is on a spacecraft, and no sensor is read so often."""


def other_time_unit(stated: TimeUnit, fits: Callable[[float], bool]) -> TimeUnit | None:
    """The largest other unit of time for which it fits what the stated one is multiplied by to be it."""
    others: tuple[TimeUnit, ...] = ("s", "ms", "us", "ns")
    ticks = TICKS_PER_SECOND
    return next((unit for unit in others if unit != stated and fits(ticks[stated] / ticks[unit])), None)


def unit_of(spelled: str) -> str:
    """The unit that a header spells, or what it says if that is none."""
    return SPELLINGS.get(spelled.strip(), spelled.strip())


def readable_unit(name: str) -> str:
    """How people write a unit of a configuration, such as ``m/s^2`` or ``uT``."""
    return name.replace("^2", "²").replace("uT", "µT")
