"""Finds a sensor that stops before the others do, or that shows the same numbers from some row on."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings.finding import Finding
from elliptude.configuration.motion import GyroFlow
from elliptude.io.readers.base import LogFile
from elliptude.logs.log import Log, Samples
from elliptude.typing import FloatArray

# In median steps: one that has not been heard of for so long has stopped, or is stuck.
_SILENT = 20.0
# s; as short as this anything may be.
_LEAST_S = 1.0
# How many times longer than any other run of equal numbers one must be: coarse digits and rests have several.
_LONGER = 10


def stopped_sensors(samples: Sequence[Samples], log: Log) -> list[Finding]:
    """Which sensors stop before others, and where.

    Parameters
    ----------
    samples : sequence of Samples
    log : Log
        What they were put into: it knows the rows of the file.

    Returns
    -------
    list of Finding
    """
    found = []
    last = max((float(one.times[-1]) for one in samples if len(one.times)), default=0.0)
    for one in samples:
        if len(one.times) < 3:
            continue
        left = last - float(one.times[-1])
        if left > max(_SILENT * float(np.median(np.diff(one.times))), _LEAST_S):
            row = int(np.clip(np.searchsorted(log.times, one.times[-1] - 1e-9), 0, len(log.times) - 1))
            said = f"stops after {log.place(row)}; others go on for {left:.4g} s"
            found.append(Finding("warning", one.name, said))
    return found


@dataclass(frozen=True)
class _Run:
    """Samples on end that are equal: how many, from when to when, and where in the file they begin."""

    count: int
    begin: float
    end: float
    row: int
    is_first: bool = False


@dataclass
class _Sensor:
    """The longest runs of a sensor, found piece by piece."""

    name: str
    last: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    open: _Run | None = None
    longest: _Run | None = None
    usual: int = 0
    """How long the second longest run is, in samples."""
    samples: int = 0
    begin: float = np.nan

    def add(self, times: FloatArray, rows: NDArray[np.int64], values: FloatArray) -> None:
        """The next samples, with the rows of the file."""
        if not len(times):
            return
        self.begin = float(times[0]) if not self.samples else self.begin
        is_new = np.append((values[0] != self.last).any(), (values[1:] != values[:-1]).any(axis=1))
        begins = np.flatnonzero(is_new)
        stops = np.append(begins, len(times))
        if not is_new[0]:
            assert self.open is not None
            end = float(times[stops[0] - 1])
            self.open = replace(self.open, count=self.open.count + int(stops[0]), end=end)
        if len(begins):
            self._close(self.open)
            counts = np.diff(stops)

            def run(i: int) -> _Run:
                first, end = begins[i], stops[i + 1] - 1
                is_first = self.samples == 0 and i == 0
                return _Run(int(counts[i]), float(times[first]), float(times[end]), int(rows[first]), is_first)

            # Of the runs that end here the two longest count; the last one may go on.
            for i in np.argsort(-counts[:-1], kind="stable")[:2]:
                self._close(run(int(i)))
            self.open = run(len(begins) - 1)
        self.samples += len(times)
        self.last = values[-1]

    def _close(self, run: _Run | None) -> None:
        if run is None:
            return
        if self.longest is None or run.count > self.longest.count:
            self.usual, self.longest = 0 if self.longest is None else self.longest.count, run
        else:
            self.usual = max(self.usual, run.count)

    def found(self, file: LogFile | None) -> Finding | None:
        """What was found; None if no run is out of the ordinary."""
        end = np.nan if self.open is None else self.open.end
        self._close(self.open)
        self.open, run = None, self.longest
        # From its first sample on it may be at rest, or off: that is not half-way.
        if run is None or run.is_first or self.samples < 3 or run.count < _LONGER * self.usual:
            return None
        mean_step = (end - self.begin) / (self.samples - 1)
        if run.end - run.begin < max(_SILENT * mean_step, _LEAST_S):
            return None
        (place,) = [""] if file is None or run.row < 0 else file.places_of_rows([run.row])
        where = f"{place} ({run.begin:.6f} s)" if place else f"{run.begin:.6f} s"
        goes_on = "to its end" if run.end == end else f"for {run.end - run.begin:.4g} s"
        said = f"shows the same from {where} on, {goes_on} ({run.count} samples): is it stuck?"
        return Finding("warning", self.name, said)


class Stuck:
    """Looks through the pieces of a log for sensors that show the same from some row on.

    Parameters
    ----------
    configuration : Configuration
    """

    def __init__(self, configuration: Configuration) -> None:
        name = "the gyro" if isinstance(configuration.flow, GyroFlow) else "rate"
        self._rate = _Sensor(name)
        self._directions = [_Sensor(sensor.name) for sensor in configuration.directions]
        self._file: LogFile | None = None

    def add(self, log: Log) -> None:
        """Look at the next piece."""
        self._file = log.file
        rows = np.full(len(log.times), -1, dtype=np.int64) if log.rows is None else log.rows
        if log.rates is not None:
            # Rates at other sensors' stamps lie between samples.
            own = log.gyro_rows
            self._rate.add(log.times[own], rows[own], log.rates[own])
        for i, sensor in enumerate(self._directions):
            there = np.flatnonzero(np.isfinite(log.directions[:, i, 0]))
            sensor.add(log.times[there], rows[there], log.directions[there, i])

    def found(self) -> list[Finding]:
        """What was found, one for each sensor."""
        return [found for one in (self._rate, *self._directions) if (found := one.found(self._file)) is not None]
