"""What each sensor measured, in few enough samples for a picture, from a log that comes piece by piece."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, Magnetometer
from elliptude.io.tables import Result
from elliptude.logs.log import Log
from elliptude.report.thinning import largest_of_each
from elliptude.typing import FloatArray

LIMIT = 3000
"""Samples of a sensor, and times at which it was left out, that are kept at most."""
GAP = 3.5
"""An interval that is so many times as long as the usual one is a gap: at least three samples are missing."""
# Of so many samples the usual interval is known.
_FEWEST = 3


@dataclass(frozen=True, eq=False)
class MeasuredSensor:
    """Samples of a sensor: all extremes of a recording, and the samples beside its longest gaps."""

    name: str
    """What it is, and its name if there are others of the kind."""
    unit: str
    """Empty for directions."""
    times: FloatArray
    """s, shape (K,)."""
    values: FloatArray
    """In body axes, shape (K, 3); NaN at a time within a gap."""
    gaps: list[tuple[float, float]]
    """From the last sample before a gap to the first one after it, s."""
    left_out: FloatArray
    """When its measurements did not go into the set, s, shape (n,)."""


class Measured:
    """Collects what was measured. Memory does not grow with the log."""

    def __init__(self, configuration: Configuration) -> None:
        self._directions = _channels(configuration)
        self._rate = "gyro" if isinstance(configuration.flow, GyroFlow) else "rate"
        self._samples: dict[str, _Samples] = {}
        self._left_out: dict[str, FloatArray] = {}

    def add(self, log: Log) -> None:
        """Take the next piece of a log."""
        if log.rates is not None:
            rows = log.gyro_rows
            self._of(self._rate).add(log.times[rows], np.rad2deg(log.rates[rows]))
        for i, channel in enumerate(self._directions):
            self._of(channel.name).add(log.times, channel.scale * log.directions[:, i])

    def add_left_out(self, result: Result) -> None:
        """Take from the next rows of a result when measurements were left out."""
        words = zip(result.times, result.refused, result.dropped or [""] * len(result.times), strict=True)
        self.add_left_out_at((float(time), name) for time, *texts in words for name in set(" ".join(texts).split()))

    def add_left_out_at(self, times: Iterable[tuple[float, str]]) -> None:
        """Take times, s, and the sensors that were left out there."""
        by_name: dict[str, list[float]] = {}
        for time, name in times:
            by_name.setdefault(name, []).append(time)
        for name, more in by_name.items():
            kept = np.unique(np.concatenate([self._left_out.get(name, np.empty(0)), more]))
            if len(kept) > LIMIT:  # one of all that would hide one another
                bins = np.floor((kept - kept[0]) / (kept[-1] - kept[0]) * (LIMIT - 1))
                kept = kept[np.diff(bins, prepend=-1.0) > 0.0]
            self._left_out[name] = kept

    def sensors(self) -> list[MeasuredSensor]:
        """All sensors that measured anything, the gyro first."""
        channels = [_Channel(self._rate, self._rate, "deg/s"), *self._directions]
        return [
            MeasuredSensor(one.said, one.unit, *self._samples[one.name].with_gaps(), self._times_left_out(one.name))
            for one in channels
            if one.name in self._samples and len(self._samples[one.name].times)
        ]

    def _times_left_out(self, name: str) -> FloatArray:
        return self._left_out.get(name, np.empty(0))

    def _of(self, name: str) -> "_Samples":
        return self._samples.setdefault(name, _Samples())


class _Samples:
    """The samples of one sensor; when there are too many, the groups of which the extremes are kept double."""

    def __init__(self) -> None:
        self.times = np.empty(0)
        self._values, self._intervals = np.empty((0, 3)), np.empty(0)
        self._numbers: NDArray[np.intp] = np.empty(0, dtype=np.intp)
        self._count, self._stride, self._last = 0, 1, np.nan
        self._usual = np.nan

    def add(self, times: FloatArray, values: FloatArray) -> None:
        """Take the next rows, of which those without a number are no samples."""
        there = np.isfinite(values).all(axis=1)
        times, values = times[there], values[there]
        if not len(times):
            return
        intervals = np.diff(times, prepend=self._last if self._count else times[0])
        self._last = times[-1]
        self._numbers = np.concatenate([self._numbers, np.arange(self._count, self._count + len(times))])
        self._count += len(times)
        self.times = np.concatenate([self.times, times])
        self._values = np.concatenate([self._values, values])
        self._intervals = np.concatenate([self._intervals, intervals])
        if np.isnan(self._usual) and len(self._intervals) > _FEWEST:
            self._usual = float(np.median(self._intervals[1:]))
        while len(self.times) > LIMIT:
            self._stride *= 2
            self._keep(self._extremes())

    def _extremes(self) -> NDArray[np.intp]:
        """Rows with the least and the most of each axis of each group, and with the longest interval beside it."""
        bins = self._numbers // self._stride
        before = np.append(self._intervals[1:], 0.0)
        scores = [*self._values.T, *-self._values.T, self._intervals, before]
        return np.unique(np.concatenate([largest_of_each(bins, score) for score in scores]))

    def _keep(self, rows: NDArray[np.intp]) -> None:
        self.times, self._values = self.times[rows], self._values[rows]
        self._intervals, self._numbers = self._intervals[rows], self._numbers[rows]

    def with_gaps(self) -> tuple[FloatArray, FloatArray, list[tuple[float, float]]]:
        """Times, values with NaN between the samples beside a gap, and the gaps."""
        rows = np.flatnonzero(self._intervals > GAP * self._usual)
        begins, ends = self.times[rows] - self._intervals[rows], self.times[rows]
        times = np.insert(self.times, rows, 0.5 * (begins + ends))
        values = np.insert(self._values, rows, np.nan, axis=0)
        return times, values, list(zip(begins.tolist(), ends.tolist(), strict=True))


class _Channel(NamedTuple):
    """Three numbers of a log."""

    name: str
    said: str
    """What pictures call it."""
    unit: str
    scale: float = 1.0
    """From what a log has to the unit."""


def _channels(configuration: Configuration) -> list[_Channel]:
    """The directions of a log."""
    found = []
    for one in configuration.directions:
        kind, unit, scale = one.name, "", 1.0
        if isinstance(one, Accelerometer):
            kind, unit = "accelerometer", "m/s²"
        elif isinstance(one, Magnetometer):
            kind, unit, scale = "magnetometer", "µT", 1e6
        is_alone = sum(type(other) is type(one) for other in configuration.directions) == 1
        said = kind if is_alone or kind == one.name else f"{kind} {one.name}"
        found.append(_Channel(one.name, said, unit, scale))
    return found
