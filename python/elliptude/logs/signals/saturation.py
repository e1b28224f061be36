"""Finds a gyro or an accelerometer at the end of its range: it stays at its largest number, and comes and goes fast.

What is beyond is not measured, and no bound of the sensor's error covers it. Slow turns and coarse digits also show
their largest number several times on end, but then the samples around are next to it.
"""

from dataclasses import dataclass, field

import numpy as np

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings.finding import Finding
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

_ON_END = 3
"""Samples with the largest number on end; fewer happen by themselves."""
_LEAST_COUNT = 5
"""So many in all."""
# Steps between the numbers that a sensor shows: a peak in coarse digits is left by fewer on both sides.
_LEFT_BY = 6.0
# Less is no end of a range: small gyros have 125 deg/s or more, accelerometers 2 g or more.
_LEAST_RATE = np.deg2rad(100.0)
_LEAST_FORCE = 15.0
_ROUNDING = 1e-9
"""A share of the largest number: smaller differences are not the sensor's digits."""


@dataclass
class _Component:
    """One component in one direction: its largest number, and when it stayed there."""

    largest: float = -np.inf
    finest: float = np.inf
    """The least step between two samples."""
    stays: list[tuple[int, float]] = field(default_factory=list)
    """For each time that it stayed at the largest number: how many samples, and how far below the nearer other is."""
    _open: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """The last two runs of equal numbers: number and length; the next piece may go on with them."""

    def add(self, values: FloatArray) -> None:
        """The next samples."""
        begins = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        runs = np.column_stack([values[begins], np.diff(np.append(begins, len(values)))])
        if len(self._open) and self._open[-1, 0] == runs[0, 0]:
            runs[0, 1] += self._open[-1, 1]
            runs = np.concatenate([self._open[:-1], runs])
        else:
            runs = np.concatenate([self._open, runs])
        numbers, lengths = runs.T
        steps = np.abs(np.diff(numbers))
        steps = steps[steps > _ROUNDING * np.abs(numbers).max()]
        self.finest = min(self.finest, float(steps.min(initial=np.inf)))
        if (top := float(numbers.max())) > self.largest:
            self.largest, self.stays = top, []
        # The first run and the last one have no samples on both sides.
        at = 1 + np.flatnonzero((numbers[1:-1] == self.largest) & (lengths[1:-1] >= _ON_END))
        around = self.largest - np.maximum(numbers[at - 1], numbers[at + 1])
        self.stays += list(zip(lengths[at].astype(int).tolist(), around.tolist(), strict=True))
        self._open = runs[-2:]

    @property
    def count(self) -> int:
        """How many samples were at the end of a range."""
        count = sum(length for length, around in self.stays if around > _LEFT_BY * self.finest)
        return count if count >= _LEAST_COUNT else 0


@dataclass
class _Sensor:
    name: str
    unit: str
    least: float
    """Below this no number is an end of its range, SI."""
    scale: float
    """How many SI units the unit is."""
    components: list[_Component] = field(default_factory=lambda: [_Component() for _ in range(6)])
    _last: FloatArray = field(default_factory=lambda: np.full((1, 3), np.nan))

    def add(self, values: FloatArray) -> None:
        """The next samples, shape (N, 3); one that was not measured, or is the one before once more, does not count."""
        values = values[np.isfinite(values).all(axis=1)]
        values = values[(np.diff(values, axis=0, prepend=self._last) != 0.0).any(axis=1)]
        if not len(values):
            return
        self._last = values[-1:]
        for component, column in zip(self.components, np.hstack([values, -values]).T, strict=True):
            component.add(column)

    def found(self) -> Finding | None:
        """What was found, if anything was."""
        worst = max(self.components, key=lambda one: one.count if one.largest >= self.least else 0)
        if worst.largest < self.least or not worst.count:
            return None
        said = (
            f"its largest number, {worst.largest / self.scale:.5g} {self.unit}, in {worst.count} samples, "
            f"{_ON_END} or more on end: is that the end of its range? No bound covers what is beyond"
        )
        return Finding("warning", self.name, said)


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
            own = slice(None) if log.gyro_times is None else log.gyro_rows
            self._gyro.add(log.rates[own])
        for i, sensor in self._accelerometers.items():
            sensor.add(log.directions[:, i])

    def found(self) -> list[Finding]:
        """What was found, one for each sensor."""
        sensors = [*([] if self._gyro is None else [self._gyro]), *self._accelerometers.values()]
        return [found for sensor in sensors if (found := sensor.found()) is not None]
