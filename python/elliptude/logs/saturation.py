"""Finds a gyro or an accelerometer at the end of its range: it shows its largest number for several samples on end.

What is beyond that is not measured, and no bound of the sensor's error covers it.
"""

from dataclasses import dataclass, field

import numpy as np

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

_ON_END = 3
"""Samples; noise makes no sensor show its largest number so often by itself."""
# Less is no end of a range: small gyros have 125 deg/s or more, accelerometers 2 g or more.
_LEAST_RATE = np.deg2rad(100.0)
_LEAST_FORCE = 15.0
# A sensor that shows one number most of the time does not move, or was made up.
_LARGEST_SHARE = 0.5


@dataclass
class _Component:
    """The largest number of one component, in one direction, and how many samples had it on end."""

    largest: float = -np.inf
    count: int = 0

    def add(self, values: FloatArray) -> None:
        top = float(values.max())
        if top < self.largest:
            return
        if top > self.largest:
            self.largest, self.count = top, 0
        edges = np.diff(np.concatenate([[0], (values == top).astype(np.int8), [0]]))
        lengths = np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)
        self.count += int(lengths[lengths >= _ON_END].sum())


@dataclass
class _Sensor:
    name: str
    unit: str
    least: float
    """Below this no number is an end of its range, SI."""
    scale: float
    """How many SI units the unit is."""
    samples: int = 0
    components: list[_Component] = field(default_factory=lambda: [_Component() for _ in range(6)])

    def add(self, values: FloatArray) -> None:
        values = values[np.isfinite(values).all(axis=1)]
        self.samples += len(values)
        for component, column in zip(self.components, np.hstack([values, -values]).T, strict=True):
            if len(column):
                component.add(column)

    def said(self) -> str | None:
        found = [one for one in self.components if one.largest >= self.least and one.count]
        if not found or max(one.count for one in found) > _LARGEST_SHARE * self.samples:
            return None
        worst = max(found, key=lambda one: one.count)
        return (
            f"{self.name}: its largest number, {worst.largest / self.scale:.5g} {self.unit}, in {worst.count} samples, "
            f"{_ON_END} or more on end: is that the end of its range? No bound covers what is beyond"
        )


class Saturation:
    """Looks through the pieces of a log.

    Parameters
    ----------
    configuration : Configuration
    """

    def __init__(self, configuration: Configuration) -> None:
        self._gyro = (
            _Sensor("the gyro", "deg/s", float(_LEAST_RATE), float(np.deg2rad(1.0)))
            if isinstance(configuration.flow, GyroFlow)
            else None
        )
        self._accelerometers = {
            i: _Sensor(sensor.name, "m/s²", _LEAST_FORCE, 1.0)
            for i, sensor in enumerate(configuration.directions)
            if isinstance(sensor, Accelerometer)
        }

    def add(self, log: Log) -> None:
        """Look at the next piece."""
        if self._gyro is not None and log.rates is not None:
            # Rates at other sensors' stamps lie between samples.
            own = slice(None) if log.gyro_times is None else np.isin(log.times, log.gyro_times)
            self._gyro.add(log.rates[own])
        for i, sensor in self._accelerometers.items():
            sensor.add(log.directions[:, i])

    def said(self) -> list[str]:
        """What was found, a sentence for each sensor."""
        sensors = [*([] if self._gyro is None else [self._gyro]), *self._accelerometers.values()]
        return [said for sensor in sensors if (said := sensor.said()) is not None]
