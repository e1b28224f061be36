"""The table of measurements that a log becomes, and the configuration that reads it as the first one read the log."""

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Direction, Magnetometer
from elliptude.configuration.statements import RestPhase, SunByTime
from elliptude.io import tables
from elliptude.io.files import FileError
from elliptude.io.readers.base import Cells
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

_OF_A_CLOCK = ("time_column", "time_unit", "delay_s")
_OF_COLUMNS = (*_OF_A_CLOCK, "unit", "axes", "at_rest")


def columns_of(log: Log, configuration: Configuration) -> dict[str, Cells]:
    """All that is read of a piece of a log, by the names of a table's columns.

    Parameters
    ----------
    log : Log
    configuration : Configuration
        By which it was read.

    Returns
    -------
    dict of str to Cells
    """
    columns: dict[str, FloatArray] = {"time_s": log.times}

    def add(names: Sequence[str], values: FloatArray | None) -> None:
        if values is not None:
            columns.update(zip(names, values.T, strict=True))

    def stamped(name: str, vectors: FloatArray, offsets: FloatArray | None) -> None:
        if offsets is not None:
            columns[tables.own_stamps(name)] = np.where(np.isnan(vectors[:, 0]), np.nan, log.times + offsets)

    is_gyro = isinstance(configuration.flow, GyroFlow)
    if log.true_attitudes is not None:
        quaternions = np.full((len(log.times), 4), np.nan)
        known = np.isfinite(log.true_attitudes[:, 0, 0])
        quaternions[known] = tables.quaternions_from_attitudes(log.true_attitudes[known]) if known.any() else 0.0
        add(tables.QUATERNION, quaternions)
        stamped("true_attitude", quaternions, log.true_offsets)
    if log.true_vectors is not None:
        # Both have one clock.
        has_stamp = np.isfinite(log.times) if log.true_offsets is None else np.isfinite(quaternions[:, 0])
        vectors = np.where(has_stamp[:, None], log.true_vectors, np.nan)
        add(tables.BIAS if is_gyro else tables.RATE, vectors)
    for i, sensor in enumerate(configuration.directions):
        for names, vectors in (
            (tables.measured(sensor.name), log.directions[:, i]),
            (tables.reference(sensor.name), log.references[:, i]),
        ):
            add(names, vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
        size = sensor.tesla if isinstance(sensor, Magnetometer) and sensor.unit == "normalized" else 1.0
        add(tables.as_measured(sensor.name), log.directions[:, i] / size)
        if _moving(sensor):  # without a measurement it has no stamp
            is_there = np.isfinite(log.directions[:, i, :1])
            add(tables.moving_reference(sensor.name), np.where(is_there, log.references[:, i], np.nan))
        stamped(sensor.name, log.directions[:, i], None if log.offsets is None else log.offsets[:, i])
    add(tables.MEASURED_RATE, log.rates)
    if log.rates is not None and is_gyro:
        samples = np.full_like(log.rates, np.nan)
        samples[log.gyro_rows] = log.rates[log.gyro_rows]
        add(tables.GYRO, samples)
        stamped("gyro", samples, np.zeros(len(log.times)))
    elif log.rates is not None:
        stamped("rate", log.rates, log.rate_offsets)
    if log.velocities is not None:
        add(tables.VELOCITY, log.velocities)
        stamped("velocity", log.velocities, log.velocity_offsets)
    add(tables.CONTROL_TORQUE, log.control_torques)
    add(tables.WHEEL_MOMENTUM, log.wheel_momenta)
    return {name: Cells(values, np.isnan(values)) for name, values in columns.items()}


def _moving(sensor: AnyDirection) -> bool:
    """Whether its reference is in columns."""
    return isinstance(sensor, Direction) and sensor.reference_columns is not None


def configuration_of(log: Log, configuration: Configuration) -> dict[str, Any]:
    """The configuration that reads the table as the log was read: the same sets follow from both.

    Parameters
    ----------
    log : Log
        The first piece.
    configuration : Configuration
        By which it was read.

    Returns
    -------
    dict
        Its tables, as in a TOML file.

    Raises
    ------
    FileError
        If a time that is stated is none that counts as the table does.
    """
    full = configuration.model_dump(mode="json", exclude_unset=True, exclude_none=True)
    timing = {key: value for key, value in full.get("timing", {}).items() if key in ("same_within_s", "largest_gap_s")}
    found = {key: value for key, value in full.items() if key not in ("csv", "timing", "calibration", "time_unit")}
    found |= {"time_column": "time_s"} | ({"timing": timing} if timing else {})
    found["flow"] = _flow(full["flow"], configuration, log.origin)
    if configuration.directions:
        found["directions"] = [
            _direction(table, sensor, i, log, configuration)
            for i, (table, sensor) in enumerate(zip(full["directions"], configuration.directions, strict=True))
        ]
    for key, name, columns, offsets in (
        ("rate", "rate", tables.MEASURED_RATE, log.rate_offsets),
        ("velocity", "velocity", tables.VELOCITY, log.velocity_offsets),
    ):
        if key in full:
            found[key] = _without(full[key], _OF_COLUMNS) | {"columns": columns} | _clock(name, offsets)
    if configuration.truth is not None:
        kept = _without(full["truth"], (*_OF_A_CLOCK, "order", "turns", "vector_columns", "vector_unit"))
        found["truth"] = kept | {"attitude_columns": tables.QUATERNION} | _clock("true_attitude", log.true_offsets)
        if configuration.truth.vector_columns is not None:
            is_gyro = isinstance(configuration.flow, GyroFlow)
            found["truth"]["vector_columns"] = tables.BIAS if is_gyro else tables.RATE
    if configuration.rule is not None:
        rule = configuration.calibrated_rule()
        numbers = {name: getattr(rule, name) for name in type(rule).model_fields if name not in ("kind", "anchor_s")}
        found["rule"] = {"kind": "stated", "anchor_s": configuration.rule.anchor_s} | {
            name: value.model_dump(mode="json", exclude_none=True) if hasattr(value, "model_dump") else value
            for name, value in numbers.items()
        }
        found["rule"] = {key: value for key, value in found["rule"].items() if value is not None}
    return found


def _flow(table: dict[str, Any], configuration: Configuration, origin: int) -> dict[str, Any]:
    if isinstance(configuration.flow, GyroFlow):
        own = {"columns": tables.GYRO, "time_column": tables.own_stamps("gyro"), "time_unit": "s"}
        return _without(table, _OF_COLUMNS) | own
    names = {"control_torque_columns": tables.CONTROL_TORQUE, "wheel_momentum_columns": tables.WHEEL_MOMENTUM}
    found = table | {key: columns for key, columns in names.items() if key in table}
    if configuration.flow.potential.turns:
        try:
            moved = configuration.flow.potential.counted_from(origin)
        except ValueError as error:
            raise FileError(str(error)) from error
        found["potential"] = moved.model_dump(mode="json", exclude_unset=True, exclude_none=True)
    return found


def _direction(
    table: dict[str, Any], sensor: AnyDirection, i: int, log: Log, configuration: Configuration
) -> dict[str, Any]:
    found = _without(table, _OF_COLUMNS) | {"columns": tables.as_measured(sensor.name)}
    found |= _clock(sensor.name, None if log.offsets is None else log.offsets[:, i])
    if _moving(sensor):
        found["reference_columns"] = tables.moving_reference(sensor.name)
    if isinstance(sensor, Accelerometer):
        found["unit"] = "m/s^2"
    elif isinstance(sensor, Magnetometer):
        found["unit"] = "normalized" if sensor.unit == "normalized" else "T"
    # Times of the file are stated of these.
    if isinstance(sensor, Direction) and isinstance(sensor.reference, SunByTime):
        zero: datetime = sensor.reference.time_zero
        found["reference"] |= {"time_zero": (zero + timedelta(seconds=log.origin)).isoformat()}
    elif isinstance(sensor, Magnetometer) and isinstance(sensor.reference, RestPhase):
        phase = sensor.reference
        found["reference"] |= {"from_s": phase.from_s - log.origin, "to_s": phase.to_s - log.origin}
    if configuration.rule is None and isinstance(sensor, Accelerometer | Magnetometer):
        if configuration.correction_of(sensor) is None:
            return found
        left, unit = configuration.sensor_bounds(sensor), "m_per_s2" if isinstance(sensor, Accelerometer) else "ut"
        found["sensor_error"] = table.get("sensor_error", {}) | {
            f"error_{unit}": left.error,
            f"averaged_error_{unit}": left.averaged_error,
            "averaged_over_s": left.averaged_over,
            "scale_error": left.scale_error,
        }
    return found


def _clock(name: str, offsets: FloatArray | None) -> dict[str, str]:
    """The keys of own stamps, where the table has them."""
    return {} if offsets is None else {"time_column": tables.own_stamps(name), "time_unit": "s"}


def _without(table: dict[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key not in keys}


def require_rest_phases(configuration: Configuration, origin: int, first: float, last: float) -> None:
    """Refuse a phase of rest that the rows of the table, from ``first`` to ``last`` s, have not all of.

    Raises
    ------
    FileError
    """
    for i, sensor in enumerate(configuration.directions):
        phase = sensor.reference if isinstance(sensor, Magnetometer) else None
        if isinstance(phase, RestPhase) and not first <= phase.from_s - origin < phase.to_s - origin <= last:
            raise FileError(
                f"directions[{i}] ({sensor.name}): its rest phase from {phase.from_s:g} s to {phase.to_s:g} s reaches "
                f"beyond the rows that are written, from {first + origin:g} s to {last + origin:g} s: from these "
                "another reference would follow"
            )
