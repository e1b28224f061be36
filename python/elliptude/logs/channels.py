"""What is read of a log: the columns of each sensor, by which clock, and how they become SI units and body axes."""

from collections.abc import Callable, Sequence
from itertools import chain

import numpy as np

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, Axes, Magnetometer, Timed, rotation_of_axes
from elliptude.io.files import FileError
from elliptude.io.readers.base import LogFile, require_columns
from elliptude.logs.alignment.clocks import Channel, Clock, Fill
from elliptude.typing import FloatArray

Sensor = tuple[Timed | None, Channel]
"""What is read, and what says of its stamps how they differ from those of the log."""


def clocks_of(file: LogFile, configuration: Configuration, names: Sequence[str] | None = None) -> list[Clock]:
    """What is read, of all sensors or of those with these names: channels with the same stamps have one clock."""
    clocks: dict[tuple[str, str, float], Clock] = {}
    sensors = (_of_motion, _of_directions, _of_velocity, _of_truth)
    for timed, channel in chain.from_iterable(of(configuration) for of in sensors):
        if names is not None and channel.name not in names:
            continue
        require_columns(file, channel.columns)
        stream = file.stream(channel.columns[0])
        column, unit = _stamps_of(file, configuration, timed, stream)
        for other in (column, *channel.columns):
            if file.stream(other) != stream:
                about = "; ".join(said for one in (channel.columns[0], other) if (said := file.about(one)))
                raise FileError(
                    f"{file.path}: {channel.columns[0]!r} and {other!r} have not the same rows"
                    f"{f': {about}' if about else ''}"
                )
        delay = timed.delay_s if timed else 0.0
        clock = clocks.setdefault(
            (column, unit, delay), Clock(column, unit, delay, column != configuration.time_column, [], stream)
        )
        clock.channels.append(channel)
    if not clocks:  # nothing is measured: there are only the times
        require_columns(file, [configuration.time_column])
        stream = file.stream(configuration.time_column)
        return [Clock(configuration.time_column, configuration.time_unit, 0.0, False, [], stream)]
    return list(clocks.values())


def _stamps_of(
    file: LogFile, configuration: Configuration, timed: Timed | None, stream: str
) -> tuple[str, units.TimeUnit]:
    """The column of a sensor's times, and their unit: its own, the stream's or the log's."""
    column, unit = configuration.time_column, configuration.time_unit
    stamps = file.stamps(stream)
    if timed is not None and timed.time_column is not None and timed.time_unit is not None:
        column, unit = timed.time_column, timed.time_unit
    elif stamps is not None:
        if "time_column" in configuration.model_fields_set:
            raise FileError(f"{file.path}: {stream} has stamps of its own, {stamps[0]}: the log needs no time_column")
        column, unit = stamps[0], _time_unit(stamps[1])
    require_columns(file, [column])
    if (own := file.time_unit(column)) is not None:
        states = configuration if timed is None or timed.time_unit is None else timed
        if "time_unit" in states.model_fields_set and unit != own:
            raise FileError(f"{file.path}: column {column!r} has times of day: leave time_unit out, or say '{own}'")
        unit = _time_unit(own)
    return column, unit


def _of_motion(configuration: Configuration) -> list[Sensor]:
    flow = configuration.flow
    if isinstance(flow, GyroFlow):
        fill: Fill = "linear" if flow.interval_rate == "mean_of_ends" else "previous"
        convert = _converted(units.ANGULAR_VELOCITY[flow.unit], flow.axes)
        if (gyro := configuration.gyro_correction()) is not None:
            convert = _corrected(convert, np.zeros(3), np.asarray(gyro.matrix))
        return [(flow, Channel("the gyro", flow.columns, convert, fill))]
    inputs = (("the control torque", flow.control_torque_columns), ("the wheel momentum", flow.wheel_momentum_columns))
    return [(None, Channel(name, columns, _as_it_is, "next")) for name, columns in inputs if columns is not None]


def _of_directions(configuration: Configuration) -> list[Sensor]:
    found: list[Sensor] = []
    for sensor in configuration.directions:
        scale = 1.0
        moving: tuple[str, ...] = ()
        if isinstance(sensor, Accelerometer):
            scale = units.ACCELERATION[sensor.unit] * (1.0 if sensor.at_rest == "up" else -1.0)
        elif isinstance(sensor, Magnetometer):
            scale = sensor.tesla
        else:
            moving = sensor.reference_columns or ()
        convert = _converted(scale, sensor.axes)
        if (correction := configuration.correction_of(sensor)) is not None:
            convert = _corrected(convert, correction.offset(), np.asarray(correction.matrix))
        columns, vectors = (*sensor.columns, *moving), 2 if moving else 1
        found.append((sensor, Channel(sensor.name, columns, convert, vectors=vectors, companions=len(moving))))
    return found


def _of_velocity(configuration: Configuration) -> list[Sensor]:
    if (velocity := configuration.velocity) is None:
        return []
    convert = _converted(units.VELOCITY[velocity.unit], ("x", "y", "z"))
    return [(velocity, Channel("the velocity", velocity.columns, convert))]


def _of_truth(configuration: Configuration) -> list[Sensor]:
    """A measured rate, and what to compare with."""
    found: list[Sensor] = []
    if (rate := configuration.rate) is not None:
        found.append((rate, Channel("rate", rate.columns, _converted(units.ANGULAR_VELOCITY[rate.unit], rate.axes))))
    if (truth := configuration.truth) is not None:
        found.append((truth, Channel("true attitude", truth.attitude_columns, _as_it_is)))
        if truth.vector_columns is not None:
            convert = _converted(units.ANGULAR_VELOCITY[truth.vector_unit], ("x", "y", "z"))
            found.append((truth, Channel("true vector", truth.vector_columns, convert)))
    return found


def _as_it_is(values: FloatArray) -> FloatArray:
    return values


def _time_unit(unit: str) -> units.TimeUnit:
    return next(known for known in units.TICKS_PER_SECOND if known == unit)


def _converted(scale: float, axes: Axes) -> Callable[[FloatArray], FloatArray]:
    """SI units and body axes of the first three columns; the others, a reference that moves, stay."""
    matrix = scale * rotation_of_axes(axes)
    if np.array_equal(matrix, np.eye(3)):
        return lambda values: values

    def convert(values: FloatArray) -> FloatArray:
        converted = values.copy()
        # Component by component: the result of a row must not depend on the rows that are converted with it.
        for i in range(3):
            converted[:, i] = matrix[i, 0] * values[:, 0] + matrix[i, 1] * values[:, 1] + matrix[i, 2] * values[:, 2]
        return converted

    return convert


def _corrected(
    convert: Callable[[FloatArray], FloatArray], offset: FloatArray, matrix: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """What a sensor's calibration makes of converted samples."""

    def correct(values: FloatArray) -> FloatArray:
        corrected = convert(values).copy()
        x, y, z = (corrected[:, :3] - offset).T
        for i in range(3):
            corrected[:, i] = matrix[i, 0] * x + matrix[i, 1] * y + matrix[i, 2] * z
        return corrected

    return correct
