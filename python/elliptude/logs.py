"""From a file to one log in time order: what a configuration names, checked, in SI units and body axes.

Sensors may have stamps, rates and delays of their own. A log's rows are all stamps there are; where a sensor has no
sample there is NaN, but for the gyro, whose rate is needed throughout. Everything is done piece by piece, so that a
file of any length needs little memory: `read_pieces`; `read_log` puts the pieces together.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from elliptude import references, units
from elliptude.configuration import Configuration, GyroFlow
from elliptude.files import FileError
from elliptude.readers import Batch, Cells, LogFile, open_log, require_columns
from elliptude.results import FloatArray
from elliptude.sensors import (
    Accelerometer,
    Axes,
    Direction,
    Magnetometer,
    RestPhase,
    SunByTime,
    Timed,
    Timing,
    WorldModel,
    rotation_of_axes,
)
from elliptude.tables import Measurements

BoolArray: TypeAlias = NDArray[np.bool_]
Fill: TypeAlias = Literal["none", "linear", "previous", "next"]


@dataclass(frozen=True, eq=False)
class Log:
    """What a configuration takes from a log of N rows with m directions; NaN where there was no measurement."""

    times: FloatArray
    """s, strictly increasing, shape (N,)."""
    directions: FloatArray
    """Body axes, shape (N, m, 3); an accelerometer's in m/s² and up at rest, a magnetometer's in T."""
    references: FloatArray
    """Reference axes, shape (N, m, 3); gravity's in m/s² and up, the Earth's field in T."""
    rates: FloatArray | None = None
    """Measured angular velocities (rigid body) or gyro samples (gyro flow), rad/s, body axes, shape (N, 3)."""
    control_torques: FloatArray | None = None
    """N m, body axes, row k acting until times[k], shape (N, 3)."""
    true_attitudes: FloatArray | None = None
    """From body to reference axes, shape (N, 3, 3)."""
    true_vectors: FloatArray | None = None
    """True angular velocities or gyro biases, rad/s, body axes, shape (N, 3)."""
    origin: int = 0
    """What was subtracted from the file's times, s."""
    rows: NDArray[np.int64] | None = None
    """The row of the file, from 0, that has the time, shape (N,); -1 where none has, as with a delay."""
    file: LogFile | None = None

    def since(self, first: int) -> "Log":
        """The rows from one on."""
        arrays: dict[str, Any] = {
            name: values[first:] for name, values in vars(self).items() if isinstance(values, np.ndarray)
        }
        return replace(self, **arrays)

    def place(self, k: int) -> str:
        """Where row k is, for a message: "line 812" of the file if that is known, and the time."""
        at = f"{self.times[k]:.6f} s"
        if self.file is None or self.rows is None or self.rows[k] < 0:
            return at
        place = self.file.place_of_row(int(self.rows[k]))
        return f"{place} ({at})" if place else at


def log_of(measurements: Measurements) -> Log:
    """The log that a table of measurements is, without a detour by way of a file."""
    return Log(
        times=measurements.times,
        directions=measurements.directions,
        references=measurements.references,
        rates=measurements.angular_velocities,
        true_attitudes=measurements.true_attitudes,
        true_vectors=measurements.true_angular_velocities,
    )


def read_log(path: str | os.PathLike[str], configuration: Configuration) -> Log:
    """Read from a file what the configuration names.

    Parameters
    ----------
    path : path-like
        In a format of `elliptude.readers.open_log`.
    configuration : Configuration

    Returns
    -------
    Log

    Raises
    ------
    FileError
        If the file does not have it; with the line and the column where that is at fault.
    """
    pieces = list(read_pieces(path, configuration))
    if len(pieces) == 1:
        return pieces[0]

    def whole(parts: list[FloatArray | None]) -> FloatArray | None:
        there = [part for part in parts if part is not None]
        return np.concatenate(there) if there else None

    return replace(
        pieces[0],
        times=np.concatenate([piece.times for piece in pieces]),
        directions=np.concatenate([piece.directions for piece in pieces]),
        references=np.concatenate([piece.references for piece in pieces]),
        rates=whole([piece.rates for piece in pieces]),
        control_torques=whole([piece.control_torques for piece in pieces]),
        true_attitudes=whole([piece.true_attitudes for piece in pieces]),
        true_vectors=whole([piece.true_vectors for piece in pieces]),
        rows=np.concatenate([piece.rows for piece in pieces if piece.rows is not None]),
    )


def read_pieces(path: str | os.PathLike[str], configuration: Configuration) -> Iterator[Log]:
    """`read_log` piece by piece: one behind the other they are the log.

    A piece is as long as a batch of the file (`elliptude.readers`), and no more than a few of them are in memory. NPZ
    and ULog come in one piece.

    Yields
    ------
    Log
        Of one row or more.

    Raises
    ------
    FileError
        As `read_log`, when the reading gets there.
    """
    file = open_log(path)
    clocks = _clocks(file, configuration)
    constants = [_constant_reference(file, configuration, i) for i in range(len(configuration.directions))]
    is_empty = True
    for piece in _pieces(file, clocks, configuration.timing):
        is_empty = False
        yield _log(piece, file, configuration, constants)
    if is_empty:
        if all(clock.is_empty for clock in clocks):
            raise FileError(f"{path}: a header, but no rows below it")
        raise FileError(f"{path}: no row between the first and the last sample of {_filled(configuration)}")


def _filled(configuration: Configuration) -> str:
    return "the gyro" if isinstance(configuration.flow, GyroFlow) else "the control torque"


@dataclass(frozen=True, eq=False)
class Samples:
    """What one sensor measured, before sensors are put into rows together."""

    name: str
    """Of a direction; else "the gyro", "rate", "the control torque", "true attitude" or "true vector"."""
    rows: int
    """How many the file has, empty ones among them."""
    times: FloatArray
    """s, strictly increasing, delay subtracted, shape (N,)."""
    values: FloatArray
    """SI units and body axes, shape (N, 3); quaternions as they stand in the file, shape (N, 4)."""
    origin: int
    """What was subtracted from the file's times, s."""


def sensor_names(configuration: Configuration) -> list[str]:
    """The names that `Samples` of this configuration have."""
    flow, truth = configuration.flow, configuration.truth
    names = ["the gyro"] if isinstance(flow, GyroFlow) else []
    names += ["the control torque"] if not isinstance(flow, GyroFlow) and flow.control_torque_columns else []
    names += [sensor.name for sensor in configuration.directions]
    names += ["rate"] if configuration.rate is not None else []
    names += ["true attitude"] if truth is not None else []
    return names + (["true vector"] if truth is not None and truth.vector_columns else [])


def read_samples(
    path: str | os.PathLike[str], configuration: Configuration, names: Sequence[str] | None = None
) -> list[Samples]:
    """Read what each sensor measured, checked and converted as for `read_log`, each at its own times.

    Parameters
    ----------
    path : path-like
    configuration : Configuration
    names : sequence of str, optional
        Of the sensors; all if left out.

    Returns
    -------
    list of Samples

    Raises
    ------
    FileError
        As `read_log`.
    """
    file = open_log(path)
    clocks = _clocks(file, configuration, names)
    timing = configuration.timing
    origin: int | None = None if timing.origin == "first" else 0
    found: list[Samples] = []
    for stream in dict.fromkeys(clock.stream for clock in clocks):
        together = [clock for clock in clocks if clock.stream == stream]
        columns = list(dict.fromkeys(chain.from_iterable(clock.columns() for clock in together)))
        rows = 0
        for batch in file.batches(columns):
            if origin is None:
                origin = _first_second(file, together[0], batch)
            for clock in together:
                _take(file, clock, batch, rows, origin, timing)
            rows += len(next(iter(batch.values())).values)
        if not rows:
            raise FileError(f"{path}: a header, but no rows below it")
        for channel in chain.from_iterable(clock.channels for clock in together):
            times = np.concatenate(channel.times) if channel.times else np.empty(0)
            values = np.concatenate(channel.values) if channel.values else np.empty((0, len(channel.columns)))
            found.append(
                Samples(channel.name, rows, times, values[:, : len(channel.columns) - channel.companions], origin or 0)
            )
    return found


# --- what is read together -------------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Channel:
    """The columns of one sensor, and its samples."""

    name: str
    columns: tuple[str, ...]
    convert: Callable[[FloatArray], FloatArray]
    """From what the file holds (n, k) to SI units and body axes (n, k)."""
    fill: Fill = "none"
    vectors: int = 0
    """So many vectors of three among the columns must not be zero: a direction, and its reference if that moves."""
    companions: int = 0
    """So many columns at the end must be there where the others are, and may be without them."""
    last_time: float = -np.inf
    times: list[FloatArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)


@dataclass(eq=False)
class _Clock:
    """Channels with the same time stamps and the same delay."""

    column: str
    unit: units.TimeUnit
    delay: float
    is_own: bool
    """The stamps are the channels' own: a row without both is no row."""
    channels: list[_Channel]
    stream: str = ""
    last: float = -np.inf
    """The last stamp, s, delay not subtracted."""
    is_empty: bool = True
    stamps: list[FloatArray] = field(default_factory=list)
    rows: list[NDArray[np.int64]] = field(default_factory=list)

    def columns(self) -> list[str]:
        """All that are read."""
        return [self.column, *chain.from_iterable(channel.columns for channel in self.channels)]


def _clocks(file: LogFile, configuration: Configuration, names: Sequence[str] | None = None) -> list[_Clock]:
    """What is read, of all sensors or of some."""
    clocks: dict[tuple[str, str, float], _Clock] = {}

    def add(timed: Timed | None, channel: _Channel) -> None:
        if names is not None and channel.name not in names:
            return
        require_columns(file, channel.columns)
        stream = file.stream(channel.columns[0])
        stamps = file.stamps(stream)
        column, unit, delay = configuration.time_column, configuration.time_unit, timed.delay_s if timed else 0.0
        if timed is not None and timed.time_column is not None and timed.time_unit is not None:
            column, unit = timed.time_column, timed.time_unit
        elif stamps is not None:
            if "time_column" in configuration.model_fields_set:
                raise FileError(
                    f"{file.path}: {stream} has stamps of its own, {stamps[0]}: the log needs no time_column"
                )
            column, unit = stamps[0], _time_unit(stamps[1])
        require_columns(file, [column])
        for other in (column, *channel.columns):
            if file.stream(other) != stream:
                raise FileError(f"{file.path}: {channel.columns[0]!r} and {other!r} have not the same rows")
        clock = clocks.setdefault(
            (column, unit, delay), _Clock(column, unit, delay, column != configuration.time_column, [], stream)
        )
        clock.channels.append(channel)

    flow, truth = configuration.flow, configuration.truth
    if isinstance(flow, GyroFlow):
        fill: Fill = "linear" if flow.interval_rate == "mean_of_ends" else "previous"
        add(flow, _Channel("the gyro", flow.columns, _converted(units.ANGULAR_VELOCITY[flow.unit], flow.axes), fill))
    elif flow.control_torque_columns is not None:
        add(None, _Channel("the control torque", flow.control_torque_columns, lambda values: values, "next"))
    for sensor in configuration.directions:
        scale = 1.0
        moving: tuple[str, ...] = ()
        if isinstance(sensor, Accelerometer):
            scale = units.ACCELERATION[sensor.unit] * (1.0 if sensor.at_rest == "up" else -1.0)
        elif isinstance(sensor, Magnetometer):
            scale = units.FIELD[sensor.unit]
        else:
            moving = sensor.reference_columns or ()
        convert = _converted(scale, sensor.axes)
        vectors = 2 if moving else 1
        add(sensor, _Channel(sensor.name, (*sensor.columns, *moving), convert, vectors=vectors, companions=len(moving)))
    if (rate := configuration.rate) is not None:
        add(rate, _Channel("rate", rate.columns, _converted(units.ANGULAR_VELOCITY[rate.unit], rate.axes)))
    if truth is not None:
        add(truth, _Channel("true attitude", truth.attitude_columns, lambda values: values))
        if truth.vector_columns is not None:
            scale = units.ANGULAR_VELOCITY[truth.vector_unit]
            add(truth, _Channel("true vector", truth.vector_columns, _converted(scale, ("x", "y", "z"))))
    if not clocks:  # nothing is measured: there are the times alone
        require_columns(file, [configuration.time_column])
        stream = file.stream(configuration.time_column)
        return [_Clock(configuration.time_column, configuration.time_unit, 0.0, False, [], stream)]
    return list(clocks.values())


def _time_unit(unit: str) -> units.TimeUnit:
    return next(known for known in units.TICKS_PER_SECOND if known == unit)


def _converted(scale: float, axes: Axes) -> Callable[[FloatArray], FloatArray]:
    """SI units and body axes of the first three columns; the others, a reference that moves, stay."""
    matrix = scale * rotation_of_axes(axes)
    if np.array_equal(matrix, np.eye(3)):
        return lambda values: values

    def convert(values: FloatArray) -> FloatArray:
        converted = values.copy()
        # Component by component: a row's result must not depend on which rows are worked on with it.
        for i in range(3):
            converted[:, i] = matrix[i, 0] * values[:, 0] + matrix[i, 1] * values[:, 1] + matrix[i, 2] * values[:, 2]
        return converted

    return convert


# --- reading ----------------------------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Stream:
    """The batches of the clocks whose columns have their rows together."""

    clocks: list[_Clock]
    batches: Iterator[Batch]
    first_row: int = 0
    is_finished: bool = False


@dataclass(frozen=True, eq=False)
class _Piece:
    """Rows in time order, and the channels' values there."""

    times: FloatArray
    rows: NDArray[np.int64]
    values: dict[str, FloatArray]
    origin: int


def _pieces(file: LogFile, clocks: list[_Clock], timing: Timing) -> Iterator[_Piece]:
    streams: list[_Stream] = []
    for name in dict.fromkeys(clock.stream for clock in clocks):
        together = [clock for clock in clocks if clock.stream == name]
        columns = list(dict.fromkeys(chain.from_iterable(clock.columns() for clock in together)))
        streams.append(_Stream(together, file.batches(columns)))
    rows_mean_something = len(streams) == 1
    origin: int | None = None if timing.origin == "first" else 0
    begin = -np.inf
    while True:
        waiting = [stream for stream in streams if not stream.is_finished]
        if waiting:
            # The one that holds the others up.
            stream = min(waiting, key=lambda stream: min(clock.last - clock.delay for clock in stream.clocks))
            batch = next(stream.batches, None)
            if batch is None:
                stream.is_finished = True
            else:
                if origin is None:
                    origin = _first_second(file, stream.clocks[0], batch)
                for clock in stream.clocks:
                    _take(file, clock, batch, stream.first_row, origin or 0, timing)
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
        if end > begin:
            piece = _union(clocks, end, origin or 0, timing, rows_mean_something)
            begin = end
            if len(piece.times):
                yield piece
        if not unfinished:
            return


def _first_second(file: LogFile, clock: _Clock, batch: Batch) -> int:
    cells = batch[clock.column]
    present = np.flatnonzero(~cells.empty & np.isfinite(cells.values))
    if not len(present):
        raise FileError(f"{file.path}: {file.place(clock.column, 0)}: no time stamp to begin with")
    return int(cells.values[present[0]] // units.TICKS_PER_SECOND[clock.unit])


def _take(file: LogFile, clock: _Clock, batch: Batch, first_row: int, origin: int, timing: Timing) -> None:
    """Check a batch and keep its stamps and samples."""

    def refuse(bad: BoolArray, column: str, fault: str) -> None:
        if bad.any():
            raise FileError(f"{file.path}: {file.place(column, first_row + int(np.argmax(bad)))}: {fault}")

    stamps = batch[clock.column]
    rows = np.arange(first_row, first_row + len(stamps.values), dtype=np.int64)
    if not len(rows):
        return
    clock.is_empty = False
    empties = {column: _empty(batch[column], timing, refuse, column) for column in clock.columns()[1:]}
    no_stamp = stamps.empty.copy()
    refuse(~np.isfinite(stamps.values) & ~no_stamp, clock.column, "not a finite number")
    if clock.is_own:
        for column, empty in empties.items():
            refuse(no_stamp & ~empty, column, f"a number without a time: {clock.column!r} is empty")
    else:
        refuse(no_stamp, clock.column, "empty")
    times = _seconds(file, clock, stamps, origin)
    present = ~no_stamp
    times, rows = times[present], rows[present]
    if not len(rows):
        return

    # Compared with the latest stamp of all rows before.
    latest = np.maximum.accumulate(np.concatenate([[clock.last], times]))
    late = np.zeros(len(present), bool)
    late[present] = times < latest[:-1]
    if timing.backward == "refuse":
        refuse(late, clock.column, "not after the time of the row before: timing.backward = 'drop' would leave it out")
    again = np.zeros(len(present), bool)
    again[present] = times == latest[:-1]
    if timing.repeated == "refuse":
        refuse(
            again,
            clock.column,
            "not after the time of the row before: timing.repeated = 'merge' would make them one",
        )
    kept = ~late[present]
    clock.last = float(latest[-1])
    is_new = kept & ~again[present]
    clock.stamps.append(times[is_new] - clock.delay)
    clock.rows.append(rows[is_new])

    for channel in clock.channels:
        values = np.column_stack([batch[column].values for column in channel.columns])
        missing = np.column_stack([empties[column] for column in channel.columns])
        main = len(channel.columns) - channel.companions
        group = channel.columns[:main]
        some = _any(missing[:, :main])
        if timing.not_a_number == "refuse":
            for i, column in enumerate(group):
                refuse(some & ~missing[:, i], column, f"a number, but {' '.join(group)} are empty only together")
        if channel.companions:
            companions = channel.columns[main:]
            partly = _any(missing[:, main:])
            for i, column in enumerate(companions):
                fault = f"a number, but {' '.join(companions)} are empty only together"
                refuse(partly & ~missing[:, main + i], column, fault)
            refuse(~some & partly, companions[0], f"empty, but {channel.name!r} is measured")
        if channel.fill != "none" and timing.largest_gap_s is None:
            refuse(some & present, group[0], f"empty; timing.largest_gap_s would let {channel.name} have gaps")
        measured = ~some & present
        for i in range(channel.vectors):
            vector = values[:, 3 * i : 3 * i + 3]
            names = " ".join(channel.columns[3 * i : 3 * i + 3])
            zero = np.zeros(len(present), bool)
            zero[measured] = ~vector[measured].any(axis=1)
            refuse(zero, channel.columns[3 * i], f"{channel.name!r} has no direction: {names} are all zero")
        measured = measured[present] & kept
        sampled = times[measured]
        first = np.diff(sampled, prepend=channel.last_time) > 0.0
        sampled = sampled[first]
        if not len(sampled):
            continue
        if channel.fill != "none" and timing.largest_gap_s is not None:
            gaps = np.diff(sampled, prepend=channel.last_time if np.isfinite(channel.last_time) else sampled[0])
            if (gaps > timing.largest_gap_s).any():
                at = int(np.argmax(gaps > timing.largest_gap_s))
                place = file.place(group[0], int(rows[measured][first][at]))
                gap = f"{gaps[at]:.6g} s after the sample of {channel.name} before it"
                raise FileError(
                    f"{file.path}: {place}: {gap}, more than timing.largest_gap_s = {timing.largest_gap_s:g}"
                )
        channel.last_time = float(sampled[-1])
        channel.times.append(sampled - clock.delay)
        channel.values.append(channel.convert(values[present][measured][first].astype(np.float64)))


def _any(rows: BoolArray) -> BoolArray:
    return np.asarray(rows.any(axis=1), dtype=np.bool_)


def _empty(cells: Cells, timing: Timing, refuse: Callable[[BoolArray, str, str], None], column: str) -> BoolArray:
    """Where nothing was measured."""
    not_finite = ~np.isfinite(cells.values) & ~cells.empty
    if timing.not_a_number == "missing":
        not_a_number = not_finite & np.isnan(cells.values)
        refuse(not_finite & ~not_a_number, column, "infinite")
        return cells.empty | not_a_number
    refuse(not_finite, column, "not a finite number; leave empty what is not known, or timing.not_a_number = 'missing'")
    return cells.empty


def _seconds(file: LogFile, clock: _Clock, cells: Cells, origin: int) -> FloatArray:
    """Stamps in s since the origin. Whole numbers are subtracted as such: nanoseconds since 1970 keep their digits."""
    ticks = units.TICKS_PER_SECOND[clock.unit]
    seconds = np.asarray((cells.values - cells.values.dtype.type(origin * ticks)) / ticks, dtype=np.float64)
    if cells.values.dtype == np.int64 and len(seconds) and np.spacing(np.abs(seconds).max()) * ticks >= 1.0:
        raise FileError(
            f"{file.path}: column {clock.column!r}: {cells.values[0]} {clock.unit} lose digits as seconds; "
            f"timing.origin = 'first' counts from the log's first second"
        )
    return seconds


def _union(clocks: list[_Clock], end: float, origin: int, timing: Timing, rows_mean_something: bool) -> _Piece:
    """The rows up to ``end``; what is later stays with the clocks and channels."""
    stamps = [_cut(clock.stamps, end) for clock in clocks]
    every = stamps[0] if len(clocks) == 1 else np.unique(np.concatenate(stamps))
    # Delays that should make stamps meet make them differ in the last digits.
    is_first = np.diff(every, prepend=-np.inf) > (timing.same_within_s if len(clocks) > 1 else 0.0)
    row_of = np.cumsum(is_first) - 1
    times = every[is_first]
    rows = np.full(len(times), -1, dtype=np.int64)
    for clock, own in zip(clocks, stamps, strict=True):
        numbers = _cut_rows(clock.rows, len(own))
        if rows_mean_something:
            at = row_of[np.searchsorted(every, own)]
            free = rows[at] < 0
            rows[at[free]] = numbers[free]
    keep = np.ones(len(times), bool)
    values: dict[str, FloatArray] = {}
    for channel in chain.from_iterable(clock.channels for clock in clocks):
        sampled = np.concatenate(channel.times) if channel.times else np.empty(0)
        samples = np.concatenate(channel.values) if channel.values else np.empty((0, len(channel.columns)))
        count = int(np.searchsorted(sampled, end, side="right"))
        if channel.fill == "none":
            values[channel.name] = np.full((len(times), len(channel.columns)), np.nan)
            at = row_of[np.searchsorted(every, sampled[:count])]
            if (np.diff(at) == 0).any():
                limit = f"timing.same_within_s = {timing.same_within_s:g}"
                raise FileError(f"{limit} makes one row of several samples of {channel.name}")
            values[channel.name][at] = samples[:count]
            keep_from = count
        else:
            values[channel.name], inside = _filled_in(times, sampled, samples, channel.fill)
            keep &= inside
            keep_from = max(count - 1, 0)  # the next piece begins between this sample and the one after
        channel.times, channel.values = [sampled[keep_from:]], [samples[keep_from:]]
        if not len(channel.times[0]):
            channel.times, channel.values = [], []
    return _Piece(times[keep], rows[keep], {name: value[keep] for name, value in values.items()}, origin)


def _filled_in(times: FloatArray, sampled: FloatArray, samples: FloatArray, fill: Fill) -> tuple[FloatArray, BoolArray]:
    """Values at all times, and which of these lie where there are any."""
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
    """Take from a list of increasing stamps what is not after ``end``."""
    whole = np.concatenate(pieces) if pieces else np.empty(0)
    count = int(np.searchsorted(whole, end, side="right"))
    pieces[:] = [whole[count:]]
    return whole[:count]


def _cut_rows(pieces: list[NDArray[np.int64]], count: int) -> NDArray[np.int64]:
    whole = np.concatenate(pieces) if pieces else np.empty(0, dtype=np.int64)
    pieces[:] = [whole[count:]]
    return whole[:count]


# --- what it is -------------------------------------------------------------------------------------------------------


def _log(piece: _Piece, file: LogFile, configuration: Configuration, constants: Sequence[FloatArray | None]) -> Log:
    sensors, values = configuration.directions, piece.values
    directions = np.empty((len(piece.times), len(sensors), 3))
    vectors = np.empty_like(directions)
    for i, (sensor, constant) in enumerate(zip(sensors, constants, strict=True)):
        directions[:, i] = values[sensor.name][:, :3]
        if constant is not None:
            vectors[:, i] = constant
        elif isinstance(sensor, Direction) and isinstance(sensor.reference, SunByTime):
            vectors[:, i] = references.sun_directions(sensor.reference, piece.times + piece.origin)
        else:
            vectors[:, i] = values[sensor.name][:, 3:]
    rates = values.get("the gyro", values.get("rate"))
    log = Log(
        times=piece.times,
        directions=directions,
        references=vectors,
        rates=rates,
        control_torques=values.get("the control torque"),
        true_vectors=values.get("true vector"),
        origin=piece.origin,
        rows=piece.rows,
        file=file,
    )
    if configuration.truth is None:
        return log
    truth = configuration.truth
    return replace(log, true_attitudes=_attitudes(values["true attitude"], log, truth.order, truth.turns))


def _attitudes(quaternions: FloatArray, log: Log, order: str, turns: str) -> FloatArray:
    """Rotations of quaternions, NaN where they are."""
    attitudes = np.full((len(quaternions), 3, 3), np.nan)
    known = np.isfinite(quaternions[:, 0])
    zero = ~quaternions.any(axis=1)
    if zero.any():
        path = log.file.path if log.file else ""
        raise FileError(f"{path}: the quaternion to compare with is zero at {log.place(int(np.argmax(zero)))}")
    if known.any():
        rotations = Rotation.from_quat(quaternions[known], scalar_first=order == "wxyz")
        attitudes[known] = (rotations if turns == "body_to_reference" else rotations.inv()).as_matrix()
    return attitudes


def _constant_reference(file: LogFile, configuration: Configuration, i: int) -> FloatArray | None:
    """The reference vector (3,) of a direction sensor, if it does not move, with the length that belongs to it."""
    sensor, frame = configuration.directions[i], configuration.reference_frame
    if isinstance(sensor, Accelerometer):
        return sensor.gravity_m_per_s2 * references.up(frame)
    if isinstance(sensor, Direction):
        return np.asarray(sensor.reference, dtype=np.float64) if isinstance(sensor.reference, tuple) else None
    if sensor.reference_ut is not None:
        return units.FIELD["uT"] * np.asarray(sensor.reference_ut, dtype=np.float64)
    if isinstance(sensor.reference, WorldModel):
        return references.world_model_field(sensor.reference, frame)
    phase = sensor.reference
    assert isinstance(phase, RestPhase)

    def mean(name: str) -> FloatArray:
        return _rest_means(file, name, phase.from_s, phase.to_s, configuration)

    needs_up = phase.attitude_qw_qx_qy_qz is None
    assert configuration.accelerometer is not None or not needs_up
    upward = mean(configuration.accelerometer.name) if needs_up and configuration.accelerometer else None
    return references.rest_field(phase, mean(sensor.name), upward, frame)


def _rest_means(file: LogFile, name: str, begin: float, end: float, configuration: Configuration) -> FloatArray:
    (clock,) = _clocks(file, configuration, [name])
    total, count = np.zeros(3), 0
    for piece in _pieces(file, [clock], configuration.timing):
        times = piece.times + piece.origin
        chosen = piece.values[name][(times >= begin) & (times <= end), :3]
        chosen = chosen[np.isfinite(chosen[:, 0])]
        total, count = total + chosen.sum(axis=0), count + len(chosen)
        if times[-1] > end:
            break
    if not count:
        raise FileError(f"{file.path}: {name!r} shows nothing in the rest phase from {begin:g} s to {end:g} s")
    mean: FloatArray = total / count
    return mean
