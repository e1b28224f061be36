"""Checks a batch of a file, and gives its stamps and samples to clocks and channels."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude import units
from elliptude.bounds.gyro import with_rounding
from elliptude.configuration.sensors import Timing
from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, LogFile
from elliptude.logs.alignment.clocks import BoolArray, Channel, Clock
from elliptude.typing import FloatArray

LARGEST_VALUE = 1e30
"""No sensor measures more, in any unit; the squares of larger numbers are soon beyond what a double holds."""

SHORTEST_VECTOR = 1e-130
"""Largest component of a vector, in any unit, below which it has no direction: its square is rounded to nothing."""

LARGEST_TIME_S = 1e10
"""The longest recording, 317 years; a double tells times at its end apart by 2 µs, and later ones less well."""
# Since the year 1, as some count, it is 6.4e10.
_LARGEST_ORIGIN_S = 1e11


class OutOfOrderError(FileError):
    """A row's time is before that of a row above; which of the two is wrong, only the rows around them say."""


def first_second(file: LogFile, clock: Clock, batch: Batch, timing: Timing) -> int:
    """The whole second of the first stamp in a batch; 0 if origin is not stated and stamps lose no digits as seconds.

    Raises
    ------
    FileError
        If there is none, or none that is a time.
    """
    cells, per_second = batch[clock.column], units.TICKS_PER_SECOND[clock.unit]
    present = np.flatnonzero(~cells.empty & np.isfinite(cells.values))
    if timing.origin is None and (not len(present) or not _lose_digits(cells.values[present], clock.unit)):
        return 0
    if not len(present):
        raise FileError(f"{file.path}: {file.place(clock.column, 0)}: no time stamp to begin with")
    first = float(cells.values[present[0]]) / per_second
    middle = float(np.sort(cells.values[present])[len(present) // 2]) / per_second
    if abs(first) > _LARGEST_ORIGIN_S or abs(first - middle) > LARGEST_TIME_S:
        raise FileError(f"{file.path}: {file.place(clock.column, int(present[0]))}: {_is_no_time(first)}")
    return int(cells.values[present[0]] // per_second)


def _is_no_time(seconds: float) -> str:
    return f"the time {seconds:.6g} s: is its unit right?"


def _lose_digits(ticks: NDArray[np.float64] | NDArray[np.int64], unit: units.TimeUnit) -> bool:
    """Whether whole numbers are so large that seconds do not tell them apart."""
    per_second = units.TICKS_PER_SECOND[unit]
    return ticks.dtype == np.int64 and float(np.spacing(np.abs(ticks / per_second).max())) * per_second >= 1.0


@dataclass(frozen=True, eq=False)
class _Rows:
    """A batch, and where it is in the file."""

    file: LogFile
    batch: Batch
    first: int
    timing: Timing

    def refuse(self, bad: BoolArray, column: str, fault: str, error: type[FileError] = FileError) -> None:
        """Raise an error for the first bad row, if there is one."""
        if bad.any():
            raise error(f"{self.file.path}: {self.file.place(column, self.first + int(np.argmax(bad)))}: {fault}")

    def missing(self, columns: tuple[str, ...]) -> BoolArray:
        """Rows without these numbers, shape (N,). The numbers of a row are there together or not at all."""
        empty = np.column_stack([self._empty(column) for column in columns])
        some = np.asarray(empty.any(axis=1), dtype=np.bool_)
        if self.timing.not_a_number == "refuse":
            for i, column in enumerate(columns):
                fault = f"a number, but {' '.join(columns)} are empty only together"
                self.refuse(some & ~empty[:, i], column, fault)
        return some

    def _empty(self, column: str) -> BoolArray:
        cells = self.batch[column]
        not_finite = ~np.isfinite(cells.values) & ~cells.empty
        if self.timing.not_a_number == "missing":
            not_a_number = not_finite & np.isnan(cells.values)
            self.refuse(not_finite & ~not_a_number, column, "infinite")
            return cells.empty | not_a_number
        fault = "not a finite number; leave empty what is not known, or say timing.not_a_number = 'missing'"
        self.refuse(not_finite, column, fault)
        return cells.empty


@dataclass(frozen=True, eq=False)
class _Stamps:
    """The stamps of a batch's rows."""

    present: BoolArray
    """Rows that have one and are not left out, shape (N,)."""
    times: FloatArray
    """Stamps of these rows, s, delay not subtracted; never less than the one before."""


def take(file: LogFile, clock: Clock, batch: Batch, first_row: int, origin: int, timing: Timing) -> None:
    """Check a batch, and give its stamps and samples to a clock and its channels.

    Parameters
    ----------
    file : LogFile
    clock : Clock
    batch : Batch
        With the clock's columns.
    first_row : int
        Where the batch begins in its stream.
    origin : int
        What to subtract from the stamps, s.
    timing : Timing

    Raises
    ------
    FileError
        For the first row that is at fault.
    """
    if not len(batch[clock.column].values):
        return
    clock.is_empty = False
    rows = _Rows(file, batch, first_row, timing)
    stamps = _take_stamps(rows, clock, origin)
    for channel in clock.channels:
        _take_samples(rows, clock, channel, stamps)


def _take_stamps(rows: _Rows, clock: Clock, origin: int) -> _Stamps:
    column, cells, timing = clock.column, rows.batch[clock.column], rows.timing
    present = ~cells.empty
    rows.refuse(~np.isfinite(cells.values) & present, column, "not a finite number")
    if not clock.is_own:
        rows.refuse(~present, column, "empty")
    _require_times(rows, clock, present, origin)
    times = _seconds(rows.file, clock, cells.values, present, origin)
    # Compared with the latest stamp of all rows before.
    latest = np.maximum.accumulate(np.concatenate([[clock.last], np.where(present, times, -np.inf)]))[:-1]
    late, again = present & (times < latest), present & (times == latest)
    fault = "not after the time of the row before"
    if timing.backward == "refuse":
        rows.refuse(late, column, f"{fault}: timing.backward = 'drop' would leave it out", OutOfOrderError)
    if timing.repeated == "refuse":
        rows.refuse(again, column, f"{fault}: timing.repeated = 'merge' would make them one")
    present = present & ~late
    is_new = present & ~again
    if is_new.any():
        clock.last = float(times[is_new][-1])
    clock.stamps.append(times[is_new] - clock.delay)
    clock.rows.append(rows.first + np.flatnonzero(is_new))
    return _Stamps(present, times[present])


def _require_times(rows: _Rows, clock: Clock, present: BoolArray, origin: int) -> None:
    """Refuse stamps so far from the origin that they are no times, before anything is subtracted from whole numbers."""
    per_second = units.TICKS_PER_SECOND[clock.unit]
    ticks = np.where(present, rows.batch[clock.column].values, float(origin * per_second))
    seconds = ticks / per_second - origin
    far = present & (np.abs(seconds) > LARGEST_TIME_S)
    if far.any():
        with np.errstate(over="ignore"):
            steps = np.diff(seconds[present])
        usual = _usual_step(float(np.median(steps)), clock.unit) if len(steps) else ""
        rows.refuse(far, clock.column, f"{_is_no_time(float(seconds[np.argmax(far)]))}{usual}")


def without_direction(vectors: NDArray[np.number[Any]]) -> BoolArray:
    """Which vectors (N, 3) are zero, or so short that they have no direction.

    Parameters
    ----------
    vectors : ndarray, shape (N, 3)

    Returns
    -------
    ndarray of bool, shape (N,)
    """
    largest: NDArray[np.number[Any]] = np.abs(vectors).max(axis=1, initial=0.0)
    return largest < SHORTEST_VECTOR


def _usual_step(step: float, unit: units.TimeUnit) -> str:
    """How far stamps are apart, s, and the unit in which that would be as of a sensor."""
    meant = units.other_time_unit(unit, lambda factor: units.OFTEN_S <= factor * step < units.SELDOM_S)
    in_other = f'; they would be in {meant}: write time_unit = "{meant}"' if step >= units.SELDOM_S and meant else ""
    return f" The steps are {step:.6g} s (median){in_other}"


def _seconds(
    file: LogFile, clock: Clock, ticks: NDArray[np.float64] | NDArray[np.int64], present: BoolArray, origin: int
) -> FloatArray:
    """Stamps in s since the origin; only those that are present mean something.

    Whole numbers are subtracted as such: nanoseconds since 1970 keep their digits.
    """
    per_second = units.TICKS_PER_SECOND[clock.unit]
    seconds = np.asarray((ticks - ticks.dtype.type(origin * per_second)) / per_second, dtype=np.float64)
    if _lose_digits(ticks[present] - origin * per_second, clock.unit):
        raise FileError(
            f"{file.path}: column {clock.column!r}: {ticks[present][0]} {clock.unit} lose digits as seconds; "
            f"timing.origin = 'first' counts from the log's first second"
        )
    return seconds


def _take_samples(rows: _Rows, clock: Clock, channel: Channel, stamps: _Stamps) -> None:
    main = len(channel.columns) - channel.companions
    columns, companions = channel.columns[:main], channel.columns[main:]
    missing = rows.missing(columns)
    if companions:
        rows.refuse(~missing & rows.missing(companions), companions[0], f"empty, but {channel.name!r} is measured")
    if clock.is_own:
        rows.refuse(
            rows.batch[clock.column].empty & ~missing, columns[0], f"a number without a time: {clock.column!r} is empty"
        )
    if channel.fill != "none" and rows.timing.largest_gap_s is None and not rows.timing.repair:
        fault = f"empty; timing.largest_gap_s would let {channel.name} have gaps"
        rows.refuse(missing & stamps.present, columns[0], fault)
    measured = ~missing & stamps.present
    values = np.column_stack([rows.batch[column].values for column in channel.columns])
    for i, column in enumerate(channel.columns):
        huge = np.zeros(len(measured), bool)
        huge[measured] = np.abs(values[measured, i].astype(np.float64)) > LARGEST_VALUE
        rows.refuse(huge, column, f"{values[int(np.argmax(huge)), i]:g}, which no sensor measures")
    for i in range(channel.vectors):
        names = channel.columns[3 * i : 3 * i + 3]
        zero = np.zeros(len(measured), bool)
        of_one = values[:, 3 * i : 3 * i + 3]
        zero[measured] = without_direction(of_one[measured])
        size = f"all below {SHORTEST_VECTOR:g} in size" if of_one[int(np.argmax(zero))].any() else "all zero"
        rows.refuse(zero, names[0], f"{channel.name!r} has no direction: {' '.join(names)} are {size}")
    at = np.flatnonzero(measured)
    times = stamps.times[measured[stamps.present]]
    is_first = np.diff(times, prepend=channel.last_time) > 0.0
    at, times = at[is_first], times[is_first]
    if not len(times):
        return
    limit = rows.timing.largest_gap_s
    if channel.fill != "none" and limit is not None:
        gaps = np.diff(times, prepend=channel.last_time if np.isfinite(channel.last_time) else times[0])
        too_long, is_longer = np.zeros(len(measured), bool), gaps > with_rounding(limit, times)
        too_long[at] = is_longer
        gap = f"{gaps[np.argmax(is_longer)]:.6g} s after the sample of {channel.name} before it"
        rows.refuse(too_long, columns[0], f"{gap}, more than timing.largest_gap_s = {limit:g}")
    channel.last_time = float(times[-1])
    channel.times.append(times - clock.delay)
    channel.values.append(channel.convert(values[at].astype(np.float64)))
