"""What each sensor measured, in few enough samples for a picture, from a log that comes piece by piece."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, Magnetometer
from elliptude.io.tables import Result
from elliptude.logs.log import Log
from elliptude.report.estimated.stored import MeasuredSensor, with_gaps
from elliptude.report.thinning import largest_of_each
from elliptude.typing import FloatArray

LIMIT = 3000
"""Samples of a sensor, and times at which it was left out, that are kept at most."""
GAP = 3.5
"""An interval that is so many times as long as the usual one is a gap: at least three samples are missing."""
# Of so many samples the usual interval is known.
_FEWEST = 3


class Measured:
    """Collects what was measured. Memory does not grow with the log."""

    def __init__(self, configuration: Configuration) -> None:
        self._directions = _channels(configuration)
        self._rate = "gyro" if isinstance(configuration.flow, GyroFlow) else "rate"
        self._samples: dict[str, _Samples] = {}
        self._left_out: dict[str, FloatArray] = {}
        self._own_stamps: dict[str, _OwnStamps] = {}

    def add(self, log: Log) -> None:
        """Take the next piece of a log."""
        if log.rates is not None:
            rows = log.gyro_rows
            times = self._sampled(self._rate, log.times, log.rate_sampled)
            self._of(self._rate).add(times[rows], np.rad2deg(log.rates[rows]))
        for i, channel in enumerate(self._directions):
            times = self._sampled(channel.name, log.times, log.sampled(i))
            self._of(channel.name).add(times, channel.scale * log.directions[:, i])

    def _sampled(self, name: str, times: FloatArray, own: FloatArray | None) -> FloatArray:
        """When the rows of a piece were sampled: by the sensor's own stamps, which are kept, or by the rows'."""
        if own is None:
            return times
        self._own_stamps.setdefault(name, _OwnStamps()).add(times, own)
        return own

    def add_left_out(self, result: Result) -> None:
        """Take from the next rows of a result when measurements were left out."""
        words = zip(result.times, result.refused, result.dropped or [""] * len(result.times), strict=True)
        self.add_left_out_at((float(time), name) for time, *texts in words for name in set(" ".join(texts).split()))
        for own in self._own_stamps.values():
            own.forget_until(float(result.times[-1]))

    def add_left_out_at(self, times: Iterable[tuple[float, str]]) -> None:
        """Take times of rows, s, and the sensors that were left out there, none of which `add_left_out` has had."""
        by_name: dict[str, list[float]] = {}
        for time, name in times:
            by_name.setdefault(name, []).append(time)
        for name, rows in by_name.items():
            more = self._own_stamps[name].at(np.array(rows)) if name in self._own_stamps else np.array(rows)
            kept = np.unique(np.concatenate([self._left_out.get(name, np.empty(0)), more]))
            if len(kept) > LIMIT:  # one of all that would hide one another
                bins = np.floor((kept - kept[0]) / (kept[-1] - kept[0]) * (LIMIT - 1))
                kept = kept[np.diff(bins, prepend=-1.0) > 0.0]
            self._left_out[name] = kept

    def sensors(self) -> list[MeasuredSensor]:
        """All sensors that measured anything, the gyro first."""
        channels = [_Channel(self._rate, "", "deg/s"), *self._directions]
        return [
            MeasuredSensor(
                one.name, one.kind, one.unit, *self._samples[one.name].with_gaps(), self._times_left_out(one.name)
            )
            for one in channels
            if one.name in self._samples and len(self._samples[one.name].times)
        ]

    def _times_left_out(self, name: str) -> FloatArray:
        return self._left_out.get(name, np.empty(0))

    def _of(self, name: str) -> "_Samples":
        return self._samples.setdefault(name, _Samples())


class _OwnStamps:
    """When a sensor was sampled, by the times of the rows of which it is not yet said whether they were left out."""

    def __init__(self) -> None:
        self._rows, self._own = np.empty(0), np.empty(0)

    def add(self, rows: FloatArray, own: FloatArray) -> None:
        """Take the next rows."""
        self._rows, self._own = np.concatenate([self._rows, rows]), np.concatenate([self._own, own])

    def at(self, rows: FloatArray) -> FloatArray:
        """The stamps of some rows; where the sensor has none of its own, those of the rows."""
        if not len(self._rows):
            return rows
        places = np.minimum(np.searchsorted(self._rows, rows), len(self._rows) - 1)
        return np.where(self._rows[places] == rows, self._own[places], rows)

    def forget_until(self, time: float) -> None:
        """The rows up to a time, s, are not asked for again."""
        later = int(np.searchsorted(self._rows, time, side="right"))
        self._rows, self._own = self._rows[later:], self._own[later:]


class _Samples:
    """The samples of one sensor; when there are too many, the groups of which the extremes are kept double."""

    def __init__(self) -> None:
        self.times = np.empty(0)
        self._values, self._before = np.empty((0, 3)), np.empty(0)
        self._numbers: NDArray[np.intp] = np.empty(0, dtype=np.intp)
        self._count, self._stride, self._last = 0, 1, np.nan
        self._usual = np.nan

    def add(self, times: FloatArray, values: FloatArray) -> None:
        """Take the next rows, of which those without a number are no samples."""
        there = np.isfinite(values).all(axis=1)
        times, values = times[there], values[there]
        if not len(times):
            return
        before = np.append(self._last if self._count else times[0], times[:-1])
        self._last = times[-1]
        self._numbers = np.concatenate([self._numbers, np.arange(self._count, self._count + len(times))])
        self._count += len(times)
        self.times = np.concatenate([self.times, times])
        self._values = np.concatenate([self._values, values])
        self._before = np.concatenate([self._before, before])
        if np.isnan(self._usual) and len(self.times) > _FEWEST:
            self._usual = float(np.median(self._intervals[1:]))
        if len(self.times) > LIMIT:  # what is new has not been thinned; the groups may be large enough
            self._keep(self._extremes())
        while len(self.times) > LIMIT:
            self._stride *= 2
            self._keep(self._extremes())

    @property
    def _intervals(self) -> FloatArray:
        """From the sample before, kept or not, to each."""
        return self.times - self._before

    def _extremes(self) -> NDArray[np.intp]:
        """Rows with the least and the most of each axis of each group, and with the longest interval beside it."""
        bins = self._numbers // self._stride
        scores = [*self._values.T, *-self._values.T, self._intervals, np.append(self._intervals[1:], 0.0)]
        return np.unique(np.concatenate([largest_of_each(bins, score) for score in scores]))

    def _keep(self, rows: NDArray[np.intp]) -> None:
        self.times, self._values = self.times[rows], self._values[rows]
        self._before, self._numbers = self._before[rows], self._numbers[rows]

    def with_gaps(self) -> tuple[FloatArray, FloatArray, list[tuple[float, float]]]:
        """Times, values with NaN between the samples beside a gap, and the gaps."""
        rows = np.flatnonzero(self._intervals > GAP * self._usual)
        begins, ends = self._before[rows], self.times[rows]
        gaps = list(zip(begins.tolist(), ends.tolist(), strict=True))
        return *with_gaps(self.times, self._values, gaps), gaps


class _Channel(NamedTuple):
    """Three numbers of a log."""

    name: str
    kind: str
    unit: str
    scale: float = 1.0
    """From what a log has to the unit."""


def _channels(configuration: Configuration) -> list[_Channel]:
    """The directions of a log."""
    found = []
    for one in configuration.directions:
        kind, unit, scale = "", "", 1.0
        if isinstance(one, Accelerometer):
            kind, unit = "accelerometer", "m/s²"
        elif isinstance(one, Magnetometer):
            kind, unit, scale = "magnetometer", "µT", 1e6
        found.append(_Channel(one.name, kind, unit, scale))
    return found
