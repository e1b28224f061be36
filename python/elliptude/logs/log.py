"""Reads a log in time order: the columns that a configuration names, checked, in SI units and body axes.

Sensors may have stamps, rates and delays of their own. A log's rows are all stamps there are; where a sensor has no
sample there is NaN, but for the gyro, whose rate is needed throughout. Everything is done piece by piece, so that a
file of any length needs little memory: `read_pieces`; `read_log` puts the pieces together.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude import units
from elliptude.configuration import references
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow, RigidBodyFlow
from elliptude.configuration.sensors import Accelerometer, Direction, Magnetometer
from elliptude.configuration.statements import RestPhase, SunByTime, WorldModel
from elliptude.io.column_files import origin_of
from elliptude.io.files import FileError, sentence
from elliptude.io.readers.base import LogFile
from elliptude.io.readers.open import LogSource, open_log
from elliptude.io.tables import Measurements
from elliptude.logs.alignment.batches import OutOfOrderError, first_second, take
from elliptude.logs.alignment.rows import ROUNDING_OF_STAMPS_S, Piece, pieces
from elliptude.logs.channels import clocks_of
from elliptude.logs.repair import Lost, Survey, require_rows_in_time, require_torques, survey
from elliptude.logs.repaired import Repaired
from elliptude.logs.rest_phase import RestField, field_in_rest
from elliptude.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Log:
    """A log of N rows with m directions, as a configuration describes it; NaN where nothing was measured."""

    times: FloatArray
    """s, strictly increasing, shape (N,)."""
    directions: FloatArray
    """Body axes, shape (N, m, 3); an accelerometer's in m/s² and up at rest, a magnetometer's in T."""
    references: FloatArray
    """Reference axes, shape (N, m, 3); gravity's in m/s² and up, the Earth's field in T."""
    rates: FloatArray | None = None
    """Measured angular velocities (rigid body) or gyro samples (gyro flow), rad/s, body axes, shape (N, 3)."""
    gyro_times: FloatArray | None = None
    """When a gyro was sampled, s, shape (M,), rates between being filled in; None where it was in every row."""
    velocities: FloatArray | None = None
    """Measured velocities, m/s, in axes that do not turn, shape (N, 3); NaN where none was measured."""
    offsets: FloatArray | None = None
    """By how much samples are later than their rows, s, shape (N, m); None where stamps were not brought together."""
    velocity_offsets: FloatArray | None = None
    """The same of the velocities, shape (N,)."""
    rate_offsets: FloatArray | None = None
    """The same of the rates of a rigid body, shape (N,)."""
    true_offsets: FloatArray | None = None
    """The same of the truth, shape (N,)."""
    control_torques: FloatArray | None = None
    """N m, body axes, row k acting until times[k], shape (N, 3)."""
    wheel_momenta: FloatArray | None = None
    """Angular momentum of wheels within the body, N m s, body axes, row k until times[k], shape (N, 3)."""
    true_attitudes: FloatArray | None = None
    """From body to reference axes, shape (N, 3, 3)."""
    true_vectors: FloatArray | None = None
    """True angular velocities or gyro biases, rad/s, body axes, shape (N, 3)."""
    origin: int = 0
    """What was subtracted from the file's times, s."""
    counts_from: int = 0
    """The second of the recording's clock that the times count from: ``origin``, and what a table's may count from."""
    rows: NDArray[np.int64] | None = None
    """The row of the file, from 0, that has the time, shape (N,); -1 where none has, as with a delay."""
    file: LogFile | None = None
    rests: tuple[RestField | None, ...] = ()
    """What a phase of rest showed, by direction; None where none is a reference."""

    @property
    def has_rate(self) -> NDArray[np.bool_]:
        """Rows with a measured rate, shape (N,)."""
        return np.zeros(len(self.times), dtype=np.bool_) if self.rates is None else np.isfinite(self.rates[:, 0])

    @property
    def gyro_rows(self) -> NDArray[np.intp]:
        """Rows that are samples of the gyro, or have a measured rate; the others are stamps of other sensors."""
        return np.flatnonzero(self.has_rate if self.gyro_times is None else np.isin(self.times, self.gyro_times))

    def sampled(self, i: int) -> FloatArray | None:
        """When direction i was sampled, s, shape (N,): its own stamps, or None where they are those of the rows."""
        return self._own_stamps(None if self.offsets is None else self.offsets[:, i])

    @property
    def rate_sampled(self) -> FloatArray | None:
        """The same of the rates of a rigid body."""
        return self._own_stamps(self.rate_offsets)

    @property
    def true_sampled(self) -> FloatArray | None:
        """The same of the truth."""
        return self._own_stamps(self.true_offsets)

    def _own_stamps(self, offsets: FloatArray | None) -> FloatArray | None:
        if offsets is None or not (np.abs(offsets) > ROUNDING_OF_STAMPS_S).any():
            return None
        times: FloatArray = self.times + offsets
        return times

    def since(self, first: int) -> "Log":
        """The rows from one on."""
        arrays: dict[str, Any] = {
            name: values[first:]
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray) and name != "gyro_times"
        }
        return replace(self, **arrays)

    def place(self, k: int) -> str:
        """Where row k is, for a message: "line 812" of the file if that is known, and the time."""
        at, (place,) = f"{self.times[k]:.6f} s", self.places_in_file([k])
        return f"{place} ({at})" if place else at

    def places_in_file(self, rows: Sequence[int]) -> list[str]:
        """The lines or rows of the file, such as "line 812", empty if unknown; the file is read once for all."""
        if self.file is None or self.rows is None:
            return [""] * len(rows)
        there = [int(self.rows[k]) for k in rows]
        places = iter(self.file.places_of_rows([row for row in there if row >= 0]))
        return ["" if row < 0 else next(places) for row in there]


def log_of(measurements: Measurements) -> Log:
    """The log that a table of measurements is, without writing a file."""
    return Log(
        times=measurements.times,
        directions=measurements.directions,
        references=measurements.references,
        rates=measurements.angular_velocities,
        true_attitudes=measurements.true_attitudes,
        true_vectors=measurements.true_angular_velocities,
    )


def read_log(path: LogSource, configuration: Configuration) -> Log:
    """Read the log that a configuration describes from a file.

    Parameters
    ----------
    path : path-like
        In a format of `elliptude.io.readers.open.open_log`.
    configuration : Configuration

    Returns
    -------
    Log

    Raises
    ------
    FileError
        If the file does not fit; with the line and the column at fault.
    """
    return joined(list(read_pieces(path, configuration)))


def joined(parts: Sequence[Log]) -> Log:
    """The log that these pieces make up; at least one, all from one file and configuration."""
    if len(parts) == 1:
        return parts[0]

    def whole(name: str) -> Any:
        there = [getattr(part, name) for part in parts]
        return None if there[0] is None else np.concatenate(there)

    names = [name for name in vars(parts[0]) if name not in {"origin", "counts_from", "file", "rests"}]
    arrays = {name: whole(name) for name in names}
    if arrays["gyro_times"] is not None:
        arrays["gyro_times"] = np.unique(arrays["gyro_times"])  # the last of a piece is the first of the next
    return replace(parts[0], **arrays)


def read_pieces(path: LogSource, configuration: Configuration) -> Iterator[Log]:
    """`read_log` piece by piece; together the pieces are the log.

    A piece is as long as a batch of the file (`elliptude.io.readers`), and no more than a few of them are in memory.
    NPZ and ULog come in one piece.

    Yields
    ------
    Log
        A piece of at least one row.

    Raises
    ------
    FileError
        As `read_log`, when the reading gets there.
    """
    file = open_configured(path, configuration)
    clocks = clocks_of(file, configuration)
    rests = tuple(_rest_of(file, configuration, i) for i in range(len(configuration.directions)))
    constants = [_constant_reference(configuration, i, rest) for i, rest in enumerate(rests)]
    is_empty = True
    try:
        for piece in pieces(file, clocks, configuration.timing.effective()):
            is_empty = False
            _require_time_of(piece, file, configuration)
            yield replace(_log(piece, file, configuration, constants), rests=rests)
    except FileError as error:
        raise with_all_faults(error, path, configuration) from error
    if is_empty:
        if all(clock.is_empty for clock in clocks):
            raise FileError(f"{file.path}: a header, but no rows below it")
        raise FileError(
            f"{file.path}: no row between the first and the last sample of {_filled(configuration)}, which every row "
            "needs: its columns are empty, or its times are others than those of the rows"
        )


def open_configured(path: LogSource, configuration: Configuration) -> LogFile:
    """Open a log as its configuration says: how a CSV file is written, and without what a repair leaves out.

    Raises
    ------
    FileError
        As `elliptude.io.readers.open.open_log`; or if something is wrong that a repair cannot leave out, or that
        leaving out rows that are late would hide.
    """
    file = open_log(path, configuration.stated(), lenient=configuration.timing.repair)
    timing, is_guaranteed = configuration.timing, configuration.estimator.mode == "guaranteed"
    if timing.repair:
        repaired = Repaired(file, survey(file, clocks_of(file, configuration)))
        if is_guaranteed:
            # That a torque acts since the one before, over empty cells, is for a user to say.
            unstated: tuple[Lost, ...] = ("empty",) if timing.largest_gap_s is None else ()
            require_torques(file, repaired.found, ("rows", "samples", *unstated), "a repair")
        return repaired
    if timing.backward == "drop":
        # The rows that are left out may be all that shows how much time went by.
        found = faults_of(path, configuration)
        require_rows_in_time(file, found)
        if is_guaranteed:
            require_torques(file, found, ("rows",), "timing.backward = 'drop'")
    return file


def faults_of(path: LogSource, configuration: Configuration) -> Survey:
    """All that is wrong with the rows of a log.

    Raises
    ------
    FileError
        If it cannot be read at all.
    """
    file = open_log(path, configuration.stated(), lenient=True)
    return survey(file, clocks_of(file, configuration))


def with_all_faults(error: FileError, path: LogSource, configuration: Configuration) -> FileError:
    """The error of the first fault, and all others that the rows have."""
    if configuration.timing.repair or not isinstance(path, str | os.PathLike):
        return error
    try:
        found = faults_of(path, configuration)
    except FileError:
        return error
    if not found.faults and not found.hopeless:
        return error
    listed = "; ".join(map(str, found.faults))
    if found.hopeless:
        # What a key would leave out is no advice for a file that no repair mends.
        return FileError(f"{path}: {'; '.join(found.hopeless)}{f'. Besides: {listed}' if listed else ''}")
    if isinstance(error, OutOfOrderError) and found.ahead:
        error = FileError(f"{path}: {found.ahead[0]}: after the time of rows below, so that it alone is wrong")
    said = f"{sentence(str(error))} In all: {listed}"
    if found.lost_torques and configuration.estimator.mode == "guaranteed":
        return FileError(said)  # a repair would be refused
    return FileError(f"{said}. --repair leaves them out, and lists them (timing.repair = true)")


def _filled(configuration: Configuration) -> str:
    return "the gyro" if isinstance(configuration.flow, GyroFlow) else "the control torque or the wheel momentum"


def interval_rates(samples: FloatArray) -> FloatArray:
    """The rate from each sample to the next as the mean of the two, shape (N, 3); nothing follows the last one."""
    rates = samples.copy()
    rates[:-1] = 0.5 * (samples[:-1] + samples[1:])
    return rates


@dataclass(frozen=True, eq=False)
class Samples:
    """The measurements of one sensor, before sensors are put into common rows."""

    name: str
    """Name of a direction; for other sensors as in `sensor_names`."""
    rows: int
    """The number of rows in the file, including empty ones."""
    times: FloatArray
    """s, strictly increasing, delay subtracted, shape (N,)."""
    values: FloatArray
    """SI units and body axes, shape (N, 3); quaternions as they stand in the file, shape (N, 4)."""
    origin: int
    """What was subtracted from the file's times, s."""
    counts_from: int
    """As of `Log`."""


def sensor_names(configuration: Configuration) -> list[str]:
    """The names that `Samples` of this configuration have."""
    flow, truth = configuration.flow, configuration.truth
    names = ["the gyro"] if isinstance(flow, GyroFlow) else []
    names += ["the control torque"] if not isinstance(flow, GyroFlow) and flow.control_torque_columns else []
    names += ["the wheel momentum"] if not isinstance(flow, GyroFlow) and flow.wheel_momentum_columns else []
    names += [sensor.name for sensor in configuration.directions]
    names += ["rate"] if configuration.rate is not None else []
    names += ["the velocity"] if configuration.velocity is not None else []
    names += ["true attitude"] if truth is not None else []
    return names + (["true vector"] if truth is not None and truth.vector_columns else [])


def read_samples(path: LogSource, configuration: Configuration, names: Sequence[str] | None = None) -> list[Samples]:
    """Read the measurements of each sensor at its own times, checked and converted as in `read_log`.

    Parameters
    ----------
    path : path-like
    configuration : Configuration
    names : sequence of str, optional
        Names of sensors; all if left out.

    Returns
    -------
    list of Samples

    Raises
    ------
    FileError
        As `read_log`.
    """
    file = open_configured(path, configuration)
    try:
        return _samples_of(file, configuration, names)
    except FileError as error:
        raise with_all_faults(error, path, configuration) from error


def _samples_of(file: LogFile, configuration: Configuration, names: Sequence[str] | None) -> list[Samples]:
    clocks = clocks_of(file, configuration, names)
    timing = configuration.timing.effective()
    origin: int | None = 0 if timing.origin == "file" else None
    found: list[Samples] = []
    for stream in dict.fromkeys(clock.stream for clock in clocks):
        together = [clock for clock in clocks if clock.stream == stream]
        columns = list(dict.fromkeys(chain.from_iterable(clock.columns() for clock in together)))
        rows = 0
        for batch in file.batches(columns):
            if origin is None:
                origin = first_second(file, together[0], batch, timing)
            for clock in together:
                take(file, clock, batch, rows, origin, timing)
            rows += len(next(iter(batch.values())).values)
        if not rows:
            raise FileError(f"{file.path}: a header, but no rows below it")
        for channel in chain.from_iterable(clock.channels for clock in together):
            times = np.concatenate(channel.times) if channel.times else np.empty(0)
            values = np.concatenate(channel.values) if channel.values else np.empty((0, len(channel.columns)))
            values, since = values[:, : len(channel.columns) - channel.companions], origin or 0
            found.append(
                Samples(channel.name, rows, times, values, since, since + _origin_of_table(file, configuration))
            )
    return found


def _origin_of_table(file: LogFile, configuration: Configuration) -> int:
    """The second that a table's own column of times counts from: elliptude converts logs to such tables."""
    return origin_of(file) if configuration.time_column == "time_s" else 0


# --- what it is -------------------------------------------------------------------------------------------------------


def _require_time_of(piece: Piece, file: LogFile, configuration: Configuration) -> None:
    """Refuse times that count from another second than the file, if a potential turns and no time is stated for it."""
    flow = configuration.flow
    if isinstance(flow, RigidBodyFlow) and flow.potential.lacks_time(piece.origin):
        raise FileError(
            f"{file.path}: flow.potential: its direction turns, and times count from {piece.origin} s of the file "
            "(timing.origin): stated_at_s has to say which of the file's seconds it is stated for"
        )


def _log(piece: Piece, file: LogFile, configuration: Configuration, constants: Sequence[FloatArray | None]) -> Log:
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
        gyro_times=piece.sampled.get("the gyro"),
        velocities=values.get("the velocity"),
        offsets=np.column_stack([piece.offsets[sensor.name] for sensor in sensors])
        if sensors and piece.offsets
        else None,
        velocity_offsets=piece.offsets.get("the velocity"),
        rate_offsets=piece.offsets.get("rate"),
        true_offsets=piece.offsets.get("true attitude"),
        control_torques=values.get("the control torque"),
        wheel_momenta=values.get("the wheel momentum"),
        true_vectors=values.get("true vector"),
        origin=piece.origin,
        counts_from=piece.origin + _origin_of_table(file, configuration),
        rows=piece.rows,
        file=file,
    )
    if configuration.truth is None:
        return log
    truth = configuration.truth
    return replace(log, true_attitudes=_attitudes(values["true attitude"], log, truth.order, truth.turns))


def _attitudes(quaternions: FloatArray, log: Log, order: str, turns: str) -> FloatArray:
    """Rotations of quaternions; NaN where the quaternions are."""
    attitudes = np.full((len(quaternions), 3, 3), np.nan)
    known = np.isfinite(quaternions[:, 0])
    zero = ~quaternions.any(axis=1)
    if zero.any():
        path = log.file.path if log.file else ""
        raise FileError(f"{path}: the quaternion to compare with is zero at {log.place(int(np.argmax(zero)))}")
    if known.any():
        rotations = scipy.spatial.transform.Rotation.from_quat(quaternions[known], scalar_first=order == "wxyz")
        attitudes[known] = (rotations if turns == "body_to_reference" else rotations.inv()).as_matrix()
    return attitudes


def _constant_reference(configuration: Configuration, i: int, rest: RestField | None) -> FloatArray | None:
    """The reference vector (3,) of a direction sensor, if it does not move, with the length that belongs to it."""
    sensor, frame = configuration.directions[i], configuration.reference_frame
    if configuration.rule is not None:  # only that it stands still matters: the rule finds the field's direction
        return np.array([0.0, 0.0, 1.0])
    if isinstance(sensor, Accelerometer):
        return sensor.gravity_m_per_s2 * references.up(frame)
    if isinstance(sensor, Direction):
        return np.asarray(sensor.reference, dtype=np.float64) if isinstance(sensor.reference, tuple) else None
    if sensor.reference_ut is not None:
        return units.FIELD["uT"] * np.asarray(sensor.reference_ut, dtype=np.float64)
    if isinstance(sensor.reference, WorldModel):
        return references.world_model_field(sensor.reference, frame)
    assert isinstance(sensor.reference, RestPhase)
    assert rest is not None
    return rest.reference(sensor.reference, configuration)


def _rest_of(file: LogFile, configuration: Configuration, i: int) -> RestField | None:
    sensor = configuration.directions[i]
    if configuration.rule is not None or not isinstance(sensor, Magnetometer):
        return None
    return field_in_rest(file, sensor, configuration) if isinstance(sensor.reference, RestPhase) else None
