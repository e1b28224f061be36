"""Puts sensors with time stamps, rates and delays of their own into rows in time order, batch by batch.

A `Channel` is one sensor's columns, a `Clock` some channels with the same stamps. `pieces` reads a file once, checks it
as it goes, and yields rows as soon as no earlier stamp can come, so that no more than a few batches are in memory.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elliptude import units
from elliptude.configuration.sensors import Timing
from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, LogFile
from elliptude.typing import FloatArray

LARGEST_VALUE = 1e30
"""No sensor measures more, in any unit; the squares of larger numbers are soon beyond what a double holds."""

SHORTEST_VECTOR = 1e-130
"""Largest component of a vector, in any unit, below which it has no direction: its square is rounded to nothing."""

ROUNDING_OF_STAMPS_S = 1e-9
"""Stamps that are no further apart than this differ by rounding alone."""

LARGEST_TIME_S = 1e10
"""The longest recording, 317 years; a double tells times at its end apart by 2 µs, and later ones less well."""
# Since the year 1, as some count, it is 6.4e10.
_LARGEST_ORIGIN_S = 1e11


class OutOfOrderError(FileError):
    """A row's time is before that of a row above; which of the two is wrong, only the rows around them say."""


BoolArray: TypeAlias = NDArray[np.bool_]
Fill: TypeAlias = Literal["none", "linear", "previous", "next"]
"""The value of a channel between two samples: none, one on the line between both, or one of them."""


@dataclass(eq=False)
class Channel:
    """The columns of one sensor, and its samples."""

    name: str
    columns: tuple[str, ...]
    convert: Callable[[FloatArray], FloatArray]
    """From what the file holds (n, k) to SI units and body axes (n, k)."""
    fill: Fill = "none"
    vectors: int = 0
    """How many vectors of three among the columns must not be zero: a direction, and its reference if that moves."""
    companions: int = 0
    """How many columns at the end must be there if the others are, and may be there without them."""
    last_time: float = -np.inf
    times: list[FloatArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)


@dataclass(eq=False)
class Clock:
    """Channels with the same time stamps and the same delay."""

    column: str
    unit: units.TimeUnit
    delay: float
    is_own: bool
    """Whether the stamps are the channels' own: a row without stamp and samples does not count."""
    channels: list[Channel]
    stream: str = ""
    last: float = -np.inf
    """The last stamp, s, delay not subtracted."""
    is_empty: bool = True
    stamps: list[FloatArray] = field(default_factory=list)
    rows: list[NDArray[np.int64]] = field(default_factory=list)

    def columns(self) -> list[str]:
        """All columns that are read."""
        return [self.column, *chain.from_iterable(channel.columns for channel in self.channels)]


@dataclass(eq=False)
class _Stream:
    """The batches of the clocks whose columns have their rows together."""

    clocks: list[Clock]
    batches: Iterator[Batch]
    first_row: int = 0
    is_finished: bool = False


@dataclass(frozen=True, eq=False)
class Piece:
    """Rows in time order, and the channels' values there."""

    times: FloatArray
    rows: NDArray[np.int64]
    values: dict[str, FloatArray]
    origin: int
    sampled: dict[str, FloatArray]
    """When channels that have values between samples were sampled, from the last time of the piece before on."""
    offsets: dict[str, FloatArray]
    """By how much the others' samples are later than their rows, s; empty where stamps are not brought together."""


def pieces(file: LogFile, clocks: list[Clock], timing: Timing) -> Iterator[Piece]:
    """Read the columns of the clocks, and put them into rows in time order.

    Parameters
    ----------
    file : LogFile
    clocks : list of Clock
        New ones; they hold what was read and is not yet in a row.
    timing : Timing

    Yields
    ------
    Piece
        At least one row, later than those before.

    Raises
    ------
    FileError
        For the first row that is at fault, once the reading gets there.
    """
    streams: list[_Stream] = []
    for name in dict.fromkeys(clock.stream for clock in clocks):
        together = [clock for clock in clocks if clock.stream == name]
        columns = list(dict.fromkeys(chain.from_iterable(clock.columns() for clock in together)))
        streams.append(_Stream(together, file.batches(columns)))
    rows_mean_something = len(streams) == 1
    origin: int | None = 0 if timing.origin == "file" else None
    begin = -np.inf
    while True:
        waiting = [stream for stream in streams if not stream.is_finished]
        if waiting:
            # The stream that the others wait for.
            stream = min(waiting, key=lambda stream: min(clock.last - clock.delay for clock in stream.clocks))
            batch = next(stream.batches, None)
            if batch is None:
                stream.is_finished = True
            else:
                if origin is None:
                    origin = first_second(file, stream.clocks[0], batch, timing)
                for clock in stream.clocks:
                    take(file, clock, batch, stream.first_row, origin or 0, timing)
                stream.first_row += len(next(iter(batch.values())).values)
        unfinished = [clock for stream in streams if not stream.is_finished for clock in stream.clocks]
        # No stamp at or before it is still to come.
        end = min((clock.last - clock.delay for clock in unfinished), default=np.inf)
        for channel in chain.from_iterable(clock.channels for clock in clocks):
            # A rate between two samples needs the later one.
            if unfinished and channel.fill in {"linear", "next"}:
                end = min(end, channel.times[-1][-1] if channel.times else -np.inf)
        if timing.repeated == "merge" and unfinished:
            end = float(np.nextafter(end, -np.inf))  # the next row may have the same time
        if unfinished and len(clocks) > 1:
            end = _end_of_whole_rows(clocks, end, timing.same_within_s)
        if end > begin:
            piece = _union(clocks, end, origin or 0, timing, rows_mean_something)
            begin = end
            if len(piece.times):
                yield piece
        if not unfinished:
            return


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


# --- what is in a batch -----------------------------------------------------------------------------------------------


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
        too_long = np.zeros(len(measured), bool)
        too_long[at] = gaps > limit
        gap = f"{gaps[np.argmax(gaps > limit)]:.6g} s after the sample of {channel.name} before it"
        rows.refuse(too_long, columns[0], f"{gap}, more than timing.largest_gap_s = {limit:g}")
    channel.last_time = float(times[-1])
    channel.times.append(times - clock.delay)
    channel.values.append(channel.convert(values[at].astype(np.float64)))


# --- rows in time order -----------------------------------------------------------------------------------------------


def _union(clocks: list[Clock], end: float, origin: int, timing: Timing, rows_mean_something: bool) -> Piece:
    """The rows up to ``end``; later samples stay with the clocks and channels."""
    stamps = [_cut(clock.stamps, end) for clock in clocks]
    every = stamps[0] if len(clocks) == 1 else np.unique(np.concatenate(stamps))
    # If delays should make stamps meet, these may still differ in the last digits.
    is_first = _begin_rows(every, timing.same_within_s if len(clocks) > 1 else 0.0)
    row_of = np.cumsum(is_first) - 1
    times = every[is_first]
    rows = np.full(len(times), -1, dtype=np.int64)
    # First those that are filled in between samples, as a gyro is: a row has their stamp if it has one, so that a line
    # between two samples has no corner within a row.
    in_order = sorted(zip(clocks, stamps, strict=True), key=lambda one: not _is_filled_in(one[0]))
    for clock, own in reversed(in_order):
        if _is_filled_in(clock):
            times[row_of[np.searchsorted(every, own[::-1])]] = own[::-1]  # of several in a row the first
    for clock, own in in_order:
        numbers = _cut_rows(clock.rows, len(own))
        if rows_mean_something:
            at = row_of[np.searchsorted(every, own)]
            free = rows[at] < 0
            rows[at[free]] = numbers[free]
    keep = np.ones(len(times), bool)
    values: dict[str, FloatArray] = {}
    sampled_at: dict[str, FloatArray] = {}
    offsets: dict[str, FloatArray] = {}
    are_moved = len(clocks) > 1 and timing.same_within_s > ROUNDING_OF_STAMPS_S
    for channel in chain.from_iterable(clock.channels for clock in clocks):
        sampled = np.concatenate(channel.times) if channel.times else np.empty(0)
        samples = np.concatenate(channel.values) if channel.values else np.empty((0, len(channel.columns)))
        count = int(np.searchsorted(sampled, end, side="right"))
        # A channel that is filled in has kept its sample before the rows.
        first = int(np.searchsorted(sampled, every[0])) if len(every) else count
        at = row_of[np.searchsorted(every, sampled[first:count])]
        if (np.diff(at) == 0).any():
            limit = f"timing.same_within_s = {timing.same_within_s:g}"
            raise FileError(f"{limit} makes one row of several samples of {channel.name}")
        if channel.fill == "none":
            values[channel.name] = np.full((len(times), len(channel.columns)), np.nan)
            values[channel.name][at] = samples[:count]
            if are_moved:
                offsets[channel.name] = np.zeros(len(times))
                offsets[channel.name][at] = sampled[:count] - times[at]
            keep_from = count
        else:
            values[channel.name], inside = _filled_in(times, sampled, samples, channel.fill)
            sampled_at[channel.name] = sampled[:count]
            keep &= inside
            keep_from = max(count - 1, 0)  # the next piece begins between this sample and the one after
        channel.times, channel.values = [sampled[keep_from:]], [samples[keep_from:]]
        if not len(channel.times[0]):
            channel.times, channel.values = [], []
    kept, moved = ({name: value[keep] for name, value in some.items()} for some in (values, offsets))
    return Piece(times[keep], rows[keep], kept, origin, sampled_at, moved)


def _is_filled_in(clock: Clock) -> bool:
    return any(channel.fill != "none" for channel in clock.channels)


def _begin_rows(stamps: FloatArray, within: float) -> BoolArray:
    """Which stamps begin a row: those more than ``within`` after the first of the row before, which no stamp leaves."""
    begins: BoolArray = np.diff(stamps, prepend=-np.inf) > within
    first = np.flatnonzero(begins)
    last = np.append(first, len(stamps))[1:] - 1
    chained = stamps[last] - stamps[first] > within  # each near the one before, but not the first
    for begin, end in zip(first[chained], last[chained], strict=True):
        for k in range(begin + 1, end + 1):
            if stamps[k] - stamps[begin] > within:
                begins[k], begin = True, k
    return begins


def _end_of_whole_rows(clocks: list[Clock], end: float, within: float) -> float:
    """A time up to which rows are whole: ``end``, or before a row to which a stamp after ``end`` might belong."""
    stamps = np.unique(np.concatenate([stamps for clock in clocks for stamps in clock.stamps] or [np.empty(0)]))
    begins = stamps[stamps <= end][_begin_rows(stamps[stamps <= end], within)]
    return float(np.nextafter(begins[-1], -np.inf)) if len(begins) and end - begins[-1] <= within else end


def _filled_in(times: FloatArray, sampled: FloatArray, samples: FloatArray, fill: Fill) -> tuple[FloatArray, BoolArray]:
    """Values at all times, and at which of these times there are any."""
    if not len(sampled):
        return np.full((len(times), samples.shape[1]), np.nan), np.zeros(len(times), bool)
    inside = times <= sampled[-1]
    if fill != "next":
        inside &= times >= sampled[0]
    if fill == "linear":
        return np.column_stack([np.interp(times, sampled, column) for column in samples.T]), inside
    at = np.searchsorted(sampled, times, side="left" if fill == "next" else "right") - (fill == "previous")
    return samples[np.clip(at, 0, len(sampled) - 1)], inside


def _cut(pieces: list[FloatArray], end: float) -> FloatArray:
    """Take the stamps that are not after ``end`` from a list of increasing ones."""
    whole = np.concatenate(pieces) if pieces else np.empty(0)
    count = int(np.searchsorted(whole, end, side="right"))
    pieces[:] = [whole[count:]]
    return whole[:count]


def _cut_rows(pieces: list[NDArray[np.int64]], count: int) -> NDArray[np.int64]:
    whole = np.concatenate(pieces) if pieces else np.empty(0, dtype=np.int64)
    pieces[:] = [whole[count:]]
    return whole[:count]
