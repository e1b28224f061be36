"""Draws a recording: a motion, and a log of it whose errors keep all that a configuration states."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

import elliptude
from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import GivenStart
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import AnyDirection, Direction, Magnetometer, Rate, rotation_of_axes
from elliptude.configuration.statements import RestPhase
from elliptude.io.files import FileError
from elliptude.typing import FloatArray
from elliptude.validation.recordings.bodies import draw_body
from elliptude.validation.recordings.draw import Draw, own_stamps
from elliptude.validation.recordings.gyro_errors import AT_BOUND, Shown, draw_gyro, unit_vector
from elliptude.validation.recordings.sensors import moved_in, shown_by, shown_velocity
from elliptude.validation.recordings.statements import Stated
from elliptude.validation.recordings.truth.tumbling import Tumbling
from elliptude.validation.recordings.truth.turning import Turning

# States of a start are drawn until one has a bias that is stated.
_TRIES = 1000


@dataclass(eq=False)
class Recording:
    """A log with the truth behind it."""

    columns: dict[str, FloatArray]
    """What the log's file has; NaN is an empty cell. Columns of one clock are of one length."""
    kinds: dict[str, str]
    """What was drawn, by what of it."""
    motion: Turning | Tumbling
    """The true attitudes, in the time of the log's rows."""
    vectors: Callable[[FloatArray], FloatArray]
    """Of times: true angular velocities, or what is left of the gyro's bias, rad/s, shape (N, 3)."""
    known: FloatArray
    """What is known of the bias, rad/s, shape (3,)."""
    clocks: dict[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Stamps:
    """When a sensor is sampled."""

    shown: FloatArray
    """In the file, s."""
    kept: NDArray[np.bool_]
    """Which of all these are."""
    all: FloatArray
    """All that there might be, s."""


def draw_recording(configuration: Configuration, seed: Any) -> Recording:
    """Draw a recording that keeps all that a configuration states.

    Parameters
    ----------
    configuration : Configuration
    seed : int or SeedSequence
        It depends on nothing else.

    Returns
    -------
    Recording

    Raises
    ------
    FileError
        If the configuration states something of which no logs are drawn.
    """
    draws = np.random.default_rng(seed)
    stated = Stated(configuration)
    of = Draw(stated, draws)
    columns: dict[str, FloatArray] = {}
    clocks = {stated.main_clock: of.grid[of.kept] + stated.main_delay}
    stamps = {sensor.name: _stamps(of, sensor, clocks) for sensor in stated.directions}
    if stated.rate is not None:
        stamps["rate"] = _stamps(of, stated.rate, clocks)
    motion, vectors, known = _moving(of, stamps, columns)
    moved = moved_in(of)
    for sensor in (*stated.directions, *([stated.rate] if stated.rate is not None else [])):
        own = stamps["rate" if isinstance(sensor, Rate) else sensor.name]
        values, beside = shown_by(of, sensor, motion, moved, own.all)
        values, beside = values[own.kept], None if beside is None else beside[own.kept]
        if of.kinds["empty"] == "some":
            empty = draws.random(len(values)) < 0.1
            empty[:20] = False
            if not stated.rests:
                values[empty] = np.nan
        _put(columns, sensor, values)
        if beside is not None and isinstance(sensor, Direction) and sensor.reference_columns is not None:
            beside = np.where(np.isnan(values), np.nan, beside)
            columns |= dict(zip(sensor.reference_columns, beside.T, strict=True))
    if stated.velocity is not None and moved is not None:
        shown_velocity(of, moved, columns, clocks)
    for name, times in clocks.items():
        columns[name] = _in_ticks(times, _unit_of(configuration, name))
    return Recording(columns, of.kinds, motion, vectors, known, clocks)


def _moving(
    of: Draw, stamps: dict[str, _Stamps], columns: dict[str, FloatArray]
) -> tuple[Turning | Tumbling, Callable[[FloatArray], FloatArray], FloatArray]:
    """The motion with its vectors, and what is known of these; writes down what a gyro, or torques, show of it."""
    stated, flow = of.stated, of.stated.flow
    if not isinstance(flow, GyroFlow):
        used: dict[str, Any] = {sensor.name: sensor for sensor in stated.directions} | {"rate": stated.rate}
        firsts = [float(one.shown[0]) - used[name].delay_s for name, one in stamps.items()]
        firsts += [of.first] if flow.control_torque_columns or flow.wheel_momentum_columns else []
        moving = draw_body(of, min(firsts))
        columns |= moving.columns
        return moving.tumbling, moving.tumbling.rates, np.zeros(3)
    attitude, of_start = _start(of)
    kinds = of.kinds | {"scale": of.kinds["gyro scale"]}
    shown = draw_gyro(stated, of.grid, of.kept, of.more, kinds, of.draws, of_start)
    _set_attitude(of, shown, attitude)
    _put(columns, flow, shown.rates / units.ANGULAR_VELOCITY[flow.unit])
    times, biases = of.grid[of.kept], shown.biases

    def left(wanted: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(wanted, times, biases[:, i]) for i in range(3)])

    return shown.turning, left, stated.gyro.known_bias


def _unit_of(configuration: Configuration, clock: str) -> Any:
    timed: list[Any] = [configuration.flow, *configuration.directions, configuration.velocity, configuration.rate]
    found = (one.time_unit for one in timed if getattr(one, "time_column", None) == clock)
    return next(found, configuration.time_unit)


def _in_ticks(stamps: FloatArray, unit: Any) -> FloatArray:
    ticks: FloatArray = np.round(stamps * units.TICKS_PER_SECOND[unit], 0 if unit in ("ns", "us") else 7)
    return ticks


def _put(columns: dict[str, FloatArray], sensor: Any, body: FloatArray) -> None:
    """Write vectors in body axes as the sensor shows them."""
    axes = rotation_of_axes(sensor.axes)
    columns |= dict(zip(sensor.columns, (body @ axes).T, strict=True))


def _start(of: Draw) -> tuple[FloatArray, FloatArray | None]:
    """The attitude at the log's first row, and what is left of an estimated bias there, if a start is of both."""
    start, gyro, draws = of.stated.configuration.start, of.stated.gyro, of.draws
    if not isinstance(start, GivenStart):
        if draws.random() < 0.3 and of.stated.force is not None:
            return scipy.spatial.transform.Rotation.from_euler("z", draws.uniform(0.0, 6.3)).as_matrix(), None
        return scipy.spatial.transform.Rotation.from_quat(draws.standard_normal(4)).as_matrix(), None
    built, size = start.build(gyro.known_bias), 6 if gyro.is_estimated else 3
    root = np.linalg.cholesky(built.shape[:size, :size])
    for _ in range(_TRIES):
        direction = draws.standard_normal(size)
        away = root @ direction / np.linalg.norm(direction) * draws.choice([0.5, 1.0]) * AT_BOUND
        attitude = built.attitude @ elliptude.cayley(0.5 * away[:3])
        left = built.vector + away[3:] - gyro.known_bias if gyro.is_estimated else None
        if left is None or np.linalg.norm(left) <= AT_BOUND * gyro.bounds.bias:
            return attitude, left
    raise FileError("start: flow.bias_deg_per_s leaves next to nothing of its biases")


def _set_attitude(of: Draw, shown: Shown, attitude: FloatArray) -> None:
    draws, time = of.draws, of.first
    for sensor in of.stated.directions:
        phase = sensor.reference if isinstance(sensor, Magnetometer) else None
        if isinstance(phase, RestPhase) and phase.attitude_qw_qx_qy_qz is not None:
            stated = scipy.spatial.transform.Rotation.from_quat(phase.attitude_qw_qx_qy_qz, scalar_first=True)
            off = scipy.spatial.transform.Rotation.from_rotvec(
                AT_BOUND * math.radians(phase.attitude_error_deg) * unit_vector(draws)
            )
            attitude, time = (stated * off).as_matrix(), phase.from_s
    shown.turning.set_attitude(time, attitude)


def _stamps(of: Draw, sensor: AnyDirection | Rate, clocks: dict[str, FloatArray]) -> _Stamps:
    clock = sensor.time_column or of.stated.configuration.time_column
    if clock == of.stated.main_clock:
        return _Stamps(clocks[clock], of.kept, of.grid + of.stated.main_delay)
    if clock not in clocks:
        clocks[clock] = own_stamps(of, sensor.delay_s)
    return _Stamps(clocks[clock], np.ones(len(clocks[clock]), dtype=np.bool_), clocks[clock])
