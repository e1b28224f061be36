"""What is found of a log, and the rows and turns by which it is."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.typing import FloatArray

Severity: TypeAlias = Literal["error", "warning"]

_PAIRS = 50_000
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


@dataclass(frozen=True)
class Finding:
    """A fault, or something that may be one."""

    severity: Severity
    sensor: str
    message: str

    def __str__(self) -> str:
        """The kind of finding, and its message."""
        return f"{self.sensor}: {self.message}" if self.sensor else self.message


def write(key: str, unit: str) -> str:
    """What to write in a configuration."""
    return f'write {key} = "{unit}"'


def in_the_unit(fitting: Sequence[str], what_to_write: str = "") -> str:
    """The end of a message: in which units something would be as usual, and what to write then."""
    said = f"; it would be in {' or '.join(fitting)}" if fitting else ""
    return f"{said}: {what_to_write}" if said and what_to_write else said


def unit_of_time(configuration: Configuration, fits: Callable[[float], bool]) -> units.TimeUnit | None:
    """The unit of time that would make stamps fit, by the factor that it makes of the stated one; the largest such."""
    stated = getattr(configuration.flow, "time_unit", None) or configuration.time_unit
    return units.other_time_unit(stated, fits)


def like(factor: float, configuration: Configuration) -> str:
    """What it is like if a body turns one of `FACTORS` times as far as its rate says, and what to write then."""
    flow = configuration.flow
    key, unit = ("flow.unit", flow.unit) if isinstance(flow, GyroFlow) else ("rate.unit", "")
    if not isinstance(flow, GyroFlow) and configuration.rate is not None:
        unit = configuration.rate.unit
    if 0.01 < factor < 100.0:
        declared, meant = ("rad/s", "deg/s") if factor < 1.0 else ("deg/s", "rad/s")
        return f"{_LIKE[factor]}: {write(key, meant)}" if unit == declared else _LIKE[factor]
    meant_time = unit_of_time(configuration, lambda other: math.isclose(other, factor))
    return f"{_LIKE[factor]}: {write('time_unit', meant_time)}" if meant_time else _LIKE[factor]


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) of length 1."""
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def spread_rows(count: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Indices spread over all rows, at most as many as are needed."""
    return np.unique(np.linspace(0, count - 1, min(count, _PAIRS)).astype(np.intp))
