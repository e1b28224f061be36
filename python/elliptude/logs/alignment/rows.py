"""Rows in time order from what clocks and channels have read.

`pieces` reads a file once, checks it as it goes, and yields rows as soon as no earlier stamp can come, so that no more
than a few batches are in memory.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from elliptude.configuration.sensors import Timing
from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, LogFile
from elliptude.logs.alignment.batches import first_second, take
from elliptude.logs.alignment.clocks import BoolArray, Clock, Fill
from elliptude.typing import FloatArray

ROUNDING_OF_STAMPS_S = 1e-9
"""Stamps that are no further apart than this differ by rounding alone."""


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
