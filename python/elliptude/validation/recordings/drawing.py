"""Draws a recording: a motion, and a log of it whose errors keep all that a configuration states."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

import elliptude
from elliptude import units
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.turns import running_integral
from elliptude.configuration import references
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import GivenStart
from elliptude.configuration.sensors import (
    Accelerometer,
    AnyDirection,
    Direction,
    Magnetometer,
    RestPhase,
    SunByTime,
    WorldModel,
    rotation_of_axes,
)
from elliptude.typing import FloatArray
from elliptude.validation.recordings import gyro_errors, vector_errors
from elliptude.validation.recordings.gyro_errors import AT_BOUND, Shown, draw_gyro, unit_vector
from elliptude.validation.recordings.statements import Stated, StatedRest, added_to, radius_of, tesla_of
from elliptude.validation.recordings.turning import Turning

_MOST_ROWS = 3000
# rad; directions that scatter less do not count as turning in a rest.
_STILL = math.radians(8.0)
_KINDS: dict[str, tuple[str, ...]] = {
    "turns": gyro_errors.TURNS,
    "pauses": ("none", "some"),
    "ramps": ("at once", "slow"),
    "noise": gyro_errors.PATTERNS,
    "bias": gyro_errors.PATTERNS,
    "gyro scale": gyro_errors.MATRICES,
    "moves": vector_errors.MOTIONS,
    "force offset": gyro_errors.PATTERNS,
    "force wobble": gyro_errors.PATTERNS,
    "force scale": gyro_errors.MATRICES,
    "field offset": gyro_errors.PATTERNS,
    "field wobble": gyro_errors.PATTERNS,
    "field scale": gyro_errors.MATRICES,
    "disturbance": gyro_errors.PATTERNS,
    "directions": gyro_errors.PATTERNS,
    "velocity": (*gyro_errors.PATTERNS, "along the rate", "along the rate", "along the rate"),
    "stamps": ("even", "even", "uneven"),
    "lost": ("none", "none", "single", "runs"),
    "empty": ("none", "none", "some"),
    "offsets": ("none", "early", "late", "apart", "apart", "any"),
}


@dataclass(eq=False)
class Recording:
    """A log with the truth behind it."""

    columns: dict[str, FloatArray]
    """What the log's file has; NaN is an empty cell. Columns of one clock are of one length."""
    kinds: dict[str, str]
    """What was drawn, by what of it."""
    turning: Turning
    """The truth, in the time of the log's rows."""
    biases: tuple[FloatArray, FloatArray]
    """Times, and what is left of the gyro's bias there, rad/s."""
    known_bias: FloatArray
    """What is known of it, rad/s, shape (3,)."""
    clocks: dict[str, FloatArray] = field(default_factory=dict)


class _Draw:
    """One recording in the making."""

    def __init__(self, stated: Stated, draws: np.random.Generator) -> None:
        self.stated, self.draws = stated, draws
        self.kinds = {name: str(draws.choice(kinds)) for name, kinds in _KINDS.items()}
        self.signs = self._signs()
        self.grid, self.kept = self._grid()
        self.first = float(self.grid[self.kept][0])

    def _signs(self) -> dict[str, float]:
        kind, draws = self.kinds["offsets"], self.draws
        names = ["the gyro", "the velocity", *(sensor.name for sensor in self.stated.directions)]
        signs = {"none": 0.0, "early": -1.0, "late": 1.0}
        if kind in signs:
            return dict.fromkeys(names, signs[kind])
        if kind == "apart":
            return {name: float(draws.choice([-1.0, 1.0])) for name in names}
        return {name: float(draws.uniform(-1.0, 1.0)) for name in names}

    def offset(self, name: str, own: float) -> float:
        """How far a sensor's stamps are off against the gyro's, s."""
        return AT_BOUND * (self.signs[name] * own + self.signs["the gyro"] * self.stated.gyro_offset)

    @property
    def more(self) -> float:
        """How far any stamp may be off, and how late it may be, s."""
        offsets = [
            self.stated.offset_of(sensor) + abs(self.stated.delay_of(sensor)) for sensor in self.stated.directions
        ]
        velocity = self.stated.velocity
        offsets += [velocity.time_offset_bound_s + abs(velocity.delay_s)] if velocity is not None else []
        return max(offsets, default=0.0) + self.stated.gyro_offset

    def _grid(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """When the gyro might be sampled, some time before and behind the log, and which of these it is."""
        stated, draws = self.stated, self.draws
        windows = stated.force.windows if stated.force is not None else ()
        step = float(draws.choice([0.01, 0.02, 0.04]))
        if stated.gyro.interval is not None:
            step = stated.gyro.interval * float(draws.choice([0.5, 0.65, 0.95]))
        if windows:
            step = min(step, min(windows) / 20.0)
        rests = stated.rests
        begin = min([0.0, *(rest.begin - draws.uniform(0.0, 1.0) for rest in rests if rest.shows is None)])
        resting = max((rest.end - begin for rest in rests), default=0.0)
        window = stated.longest_window
        moving = draws.uniform(0.8, 2.0) * window if window <= 15.0 else draws.uniform(0.4, 1.1) * window
        lasts = resting + max(moving, 3.0) + 1.0
        lasts = min(lasts, max(_MOST_ROWS * step, resting + 2.0))
        pad = self.more + 10.0 * step
        count = math.ceil((lasts + 2.0 * pad) / step)
        grid = begin - pad + step * np.arange(count)
        if self.kinds["stamps"] == "uneven":
            grid += step * draws.uniform(-0.12, 0.12, count) if stated.gyro.interval is None else 0.0
        kept = (grid >= begin) & (grid <= begin + lasts)
        losable = kept & (grid > begin + resting + stated.longest_window * 0.2 + 0.6)
        if self.kinds["lost"] == "single":
            kept &= ~(losable & (draws.random(count) < 0.02))
        elif self.kinds["lost"] == "runs":
            for at in draws.choice(count, 3):
                kept[at : at + int(draws.integers(1, 12))] &= ~losable[at : at + int(draws.integers(1, 12))][:1].any()
        kept[np.flatnonzero((grid >= begin) & (grid <= begin + lasts))[[0, 1, -2, -1]]] = True
        return np.round(grid, 7), kept


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
    of = _Draw(stated, draws)
    gyro_kinds = of.kinds | {"scale": of.kinds["gyro scale"]}
    shown = draw_gyro(stated, of.grid, of.kept, of.more, gyro_kinds, draws)
    _set_attitude(of, shown)
    flow = configuration.flow
    columns: dict[str, FloatArray] = {}
    clocks: dict[str, FloatArray] = {}
    gyro_clock = flow.time_column or configuration.time_column  # type: ignore[union-attr]
    delay = flow.delay_s  # type: ignore[union-attr]
    clocks[gyro_clock] = of.grid[of.kept] + delay
    _put(columns, flow, shown.rates / units.ANGULAR_VELOCITY[flow.unit])  # type: ignore[union-attr]
    moved = _motion(of)
    for sensor in stated.directions:
        stamps, rows, all_stamps = _stamps(of, sensor, gyro_clock, clocks, delay)
        vectors = _shown_by(of, sensor, shown.turning, moved, all_stamps)
        if vectors is None:
            continue
        values, more = vectors
        values, more = values[rows], None if more is None else more[rows]
        if of.kinds["empty"] == "some":
            empty = draws.random(len(values)) < 0.1
            empty[:20] = False
            if not stated.rests:
                values[empty] = np.nan
        _put(columns, sensor, values)
        if more is not None and isinstance(sensor, Direction) and sensor.reference_columns is not None:
            columns |= dict(zip(sensor.reference_columns, np.where(np.isnan(values), np.nan, more).T, strict=True))
        clocks.setdefault(sensor.time_column or configuration.time_column, stamps)
    if stated.velocity is not None and moved is not None:
        _velocity(of, moved, columns, clocks, gyro_clock)
    for name, stamps in clocks.items():
        columns[name] = _in_ticks(stamps, _unit_of(configuration, name))
    return Recording(columns, of.kinds, shown.turning, (of.grid[of.kept], shown.biases), stated.gyro.known_bias, clocks)


def _unit_of(configuration: Configuration, clock: str) -> Any:
    timed: list[Any] = [configuration.flow, *configuration.directions, configuration.velocity]
    found = (one.time_unit for one in timed if getattr(one, "time_column", None) == clock)
    return next(found, configuration.time_unit)


def _in_ticks(stamps: FloatArray, unit: Any) -> FloatArray:
    ticks: FloatArray = np.round(stamps * units.TICKS_PER_SECOND[unit], 0 if unit in ("ns", "us") else 7)
    return ticks


def _put(columns: dict[str, FloatArray], sensor: Any, body: FloatArray) -> None:
    """Write vectors in body axes as the sensor shows them."""
    axes = rotation_of_axes(sensor.axes)
    columns |= dict(zip(sensor.columns, (body @ axes).T, strict=True))


def _set_attitude(of: _Draw, shown: Shown) -> None:
    configuration, draws = of.stated.configuration, of.draws
    attitude = scipy.spatial.transform.Rotation.from_quat(draws.standard_normal(4)).as_matrix()
    if draws.random() < 0.3 and of.stated.force is not None:
        attitude = scipy.spatial.transform.Rotation.from_euler("z", draws.uniform(0.0, 6.3)).as_matrix()
    if isinstance(configuration.start, GivenStart):
        start = configuration.start.build()
        vector = np.linalg.cholesky(start.shape[:3, :3]) @ unit_vector(draws) * draws.choice([0.5, 1.0]) * AT_BOUND
        attitude = start.attitude @ elliptude.cayley(0.5 * vector)
    time = of.first
    for sensor in of.stated.directions:
        phase = sensor.reference if isinstance(sensor, Magnetometer) else None
        if isinstance(phase, RestPhase) and phase.attitude_qw_qx_qy_qz is not None:
            stated = scipy.spatial.transform.Rotation.from_quat(phase.attitude_qw_qx_qy_qz, scalar_first=True)
            off = scipy.spatial.transform.Rotation.from_rotvec(
                AT_BOUND * math.radians(phase.attitude_error_deg) * unit_vector(draws)
            )
            attitude, time = (stated * off).as_matrix(), phase.from_s
    shown.turning.set_attitude(time, attitude)


def _rest_of(of: _Draw) -> StatedRest | None:
    return of.stated.rests[0] if of.stated.rests else None


def _motion(of: _Draw) -> vector_errors.Moved | None:
    force, velocity = of.stated.force, of.stated.velocity
    if force is None:
        return None
    sensor = of.stated.configuration.accelerometer
    assert sensor is not None
    times = of.grid + of.offset(sensor.name, of.stated.offset_of(sensor))
    largest = np.inf if velocity is None else velocity.largest_acceleration_m_per_s2
    return vector_errors.draw_motion(
        force, _rest_of(of), times, of.first, of.more, of.kept, of.kinds, largest, of.draws
    )


def _stamps(
    of: _Draw, sensor: AnyDirection, gyro_clock: str, clocks: dict[str, FloatArray], gyro_delay: float
) -> tuple[FloatArray, NDArray[Any], FloatArray]:
    """A sensor's stamps; which of all that it might have these are, and all of them."""
    clock = sensor.time_column or of.stated.configuration.time_column
    if clock == gyro_clock:
        return clocks[clock], of.kept, of.grid + gyro_delay
    if clock in clocks:
        return clocks[clock], np.ones(len(clocks[clock]), dtype=np.bool_), clocks[clock]
    stamps = own_stamps(of, sensor.delay_s)
    return stamps, np.ones(len(stamps), dtype=np.bool_), stamps


def own_stamps(of: _Draw, delay: float) -> FloatArray:
    """Stamps of a clock that is not the gyro's: rarer or more often, even or not."""
    times = of.grid[of.kept]
    step = float(np.median(np.diff(times))) * of.draws.choice([0.7, 1.0, 3.3, 10.0, 37.0])
    if of.stated.rests:
        step = min(step, (of.stated.rests[0].end - of.stated.rests[0].begin) / 20.0)
    # A file has a row for each stamp of its own clock, and what is beside that ends no later.
    count = min(int((times[-1] - times[0]) / step), len(times))
    stamps = times[0] + step * (np.arange(count) + of.draws.uniform(0.0, 1.0))
    stamps = stamps + step * of.draws.uniform(-0.2, 0.2, count) if of.kinds["stamps"] == "uneven" else stamps
    return np.asarray(np.round(stamps + delay, 7))


def _shown_by(
    of: _Draw,
    sensor: AnyDirection,
    turning: Turning,
    moved: vector_errors.Moved | None,
    stamps: FloatArray,
) -> tuple[FloatArray, FloatArray | None] | None:
    """What a sensor shows at its stamps, in its unit but in body axes, and the reference beside it."""
    stated = of.stated
    rows = stamps - stated.delay_of(sensor)
    true_times = rows + of.offset(sensor.name, stated.offset_of(sensor))
    at_true, at_rows = turning.attitudes(true_times), turning.attitudes(rows)
    if isinstance(sensor, Accelerometer):
        assert moved is not None
        return _force(of, sensor, moved, rows, true_times, at_true, at_rows), None
    if isinstance(sensor, Magnetometer):
        return _field(of, sensor, rows, true_times, at_true, at_rows), None
    beside = _references(of, sensor, rows)
    true = _references(of, sensor, true_times)
    true = np.einsum("nji,nj->ni", at_true, true)
    angle = radius_of(sensor) + added_to(sensor)
    kinds = {"offset": of.kinds["directions"]}
    shown = vector_errors.turned_away(true, angle, at_true, kinds, of.draws)
    return shown * 10.0 ** of.draws.uniform(-1.0, 1.0), beside


def _references(of: _Draw, sensor: Direction, times: FloatArray) -> FloatArray:
    """True reference directions at times of the rows, shape (N, 3)."""
    if isinstance(sensor.reference, SunByTime):
        return references.sun_directions(sensor.reference, times)
    if sensor.reference is not None:
        return np.tile(np.asarray(sensor.reference, dtype=np.float64), (len(times), 1))
    # It turns about an axis across it, as fast as is stated.
    draws = np.random.default_rng([len(sensor.name), *sensor.name.encode(), int(1e6 * abs(of.grid[0]))])
    one, other = unit_vector(draws), unit_vector(draws)
    across = np.cross(one, other) / np.linalg.norm(np.cross(one, other))
    rate = math.radians(sensor.reference_rate_deg_per_s or 0.0) * AT_BOUND
    if sensor.reference_rate_deg_per_s is None:
        rate = 0.02
    turned: FloatArray = scipy.spatial.transform.Rotation.from_rotvec(rate * times[:, None] * across).apply(one)
    return turned


def _force(
    of: _Draw,
    sensor: Accelerometer,
    moved: vector_errors.Moved,
    rows: FloatArray,
    true_times: FloatArray,
    at_true: FloatArray,
    at_rows: FloatArray,
) -> FloatArray:
    force, draws = of.stated.force, of.draws
    assert force is not None
    up = references.up(of.stated.configuration.reference_frame or "ENU")
    gravity = force.gravity + AT_BOUND * force.gravity_error * float(draws.choice([-1.0, 0.0, 1.0]))
    a = np.column_stack([np.interp(true_times, moved.times, moved.accelerations[:, i]) for i in range(3)])
    frame = np.column_stack([*_level_axes(up), up])
    if force.angle is not None:
        true = np.einsum("nji,j->ni", at_true, gravity * up)
        angle = _less_in_rest(of, rows, force.angle + added_to(sensor))
        kinds = {"offset": of.kinds["force offset"]}
        shown = vector_errors.turned_away(true, angle, at_true, kinds, draws)
    else:
        true = np.einsum("nji,nj->ni", at_true, gravity * up + a @ frame.T)
        still = _still_in_rest(of, rows, gravity)
        sampling = np.zeros_like(true)
        for rest in of.stated.rests:
            if rest.shows is not None:
                still[rows <= of.first + rest.end + of.more + rest.shows.duration_s] = (
                    0.3 * rest.shows.acceleration_deviation_m_per_s2
                )
        if of.stated.longest_window > 0.0 and len(rows) == len(moved.times):
            exact = moved.velocities_at(true_times)
            summed = running_integral(rows, a)
            sampling = (summed - (exact - exact[0])) @ frame.T
        shown = vector_errors.shown_vectors(
            true, at_rows, rows, force.sensor, sampling, _prefixed(of.kinds, "force"), still, draws
        )
        shown = _misaligned(shown, sensor.alignment_error_deg, draws)
    shown = shown / units.ACCELERATION[sensor.unit]
    return -shown if sensor.at_rest == "down" else shown


def _less_in_rest(of: _Draw, rows: FloatArray, angle: float) -> FloatArray:
    """How far directions are turned away, rad: in a rest not so far that the body would be taken to turn."""
    angles = np.full(len(rows), angle)
    for rest in of.stated.rests:
        angles[(rows >= rest.begin - 1e-6) & (rows <= rest.end + 1e-6)] = min(angle, _STILL)
    return angles


def _still_in_rest(of: _Draw, rows: FloatArray, length: float) -> FloatArray:
    """The same of what is added to a vector: how large it may be for each row."""
    still = np.full(len(rows), np.inf)
    for rest in of.stated.rests:
        if rest.shows is None:
            still[(rows >= rest.begin - 1e-6) & (rows <= rest.end + 1e-6)] = 0.5 * _STILL * length
    return still


def _level_axes(up: FloatArray) -> tuple[FloatArray, FloatArray]:
    one = np.cross(up, [0.3, 0.8, 0.52]) / np.linalg.norm(np.cross(up, [0.3, 0.8, 0.52]))
    return one, np.cross(up, one)


def _prefixed(kinds: dict[str, str], of: str) -> dict[str, str]:
    return {name.removeprefix(f"{of} "): kind for name, kind in kinds.items() if name.startswith(f"{of} ")}


def _misaligned(shown: FloatArray, degrees: float, draws: np.random.Generator) -> FloatArray:
    if degrees == 0.0:
        return shown
    turn = scipy.spatial.transform.Rotation.from_rotvec(AT_BOUND * math.radians(degrees) * unit_vector(draws))
    return np.asarray(turn.apply(shown))


def true_field(of: _Draw, sensor: Magnetometer) -> FloatArray:
    """The field that the reference means, µT, reference axes, shape (3,)."""
    configuration, draws = of.stated.configuration, of.draws
    if sensor.reference_ut is not None:
        field_ut = np.asarray(sensor.reference_ut, dtype=np.float64)
    elif isinstance(sensor.reference, WorldModel):
        field_ut = references.world_model_field(sensor.reference, configuration.reference_frame) / units.FIELD["uT"]
    else:
        dip, strength = math.radians(draws.uniform(-75.0, 75.0)), draws.uniform(22.0, 65.0)
        horizontal, up = strength * math.cos(dip), -strength * math.sin(dip)
        phase = sensor.reference
        east = math.radians(phase.declination_deg or 0.0) if isinstance(phase, RestPhase) else 0.0
        enu = np.array([horizontal * math.sin(east), horizontal * math.cos(east), up])
        if isinstance(phase, RestPhase) and phase.attitude_qw_qx_qy_qz is not None:
            return strength * unit_vector(draws)
        return references.from_enu(enu, configuration.reference_frame or "ENU")
    off = scipy.spatial.transform.Rotation.from_rotvec(
        AT_BOUND * math.radians(sensor.reference_error_deg or 0.0) * unit_vector(draws)
    )
    assert of.stated.field is not None
    stronger = AT_BOUND * of.stated.field.strength_error * float(draws.choice([-1.0, 0.0, 1.0]))
    strength = float(np.linalg.norm(field_ut))
    return np.asarray(off.apply(field_ut) * (1.0 + stronger / strength))


def _field(
    of: _Draw,
    sensor: Magnetometer,
    rows: FloatArray,
    true_times: FloatArray,
    at_true: FloatArray,
    at_rows: FloatArray,
) -> FloatArray:
    stated, draws = of.stated.field, of.draws
    assert stated is not None
    field_ut = true_field(of, sensor)
    errors = stated.sensor
    tesla = tesla_of(sensor)
    if sensor.unit == "normalized":
        assert sensor.unit_ut is not None
        tesla = sensor.unit_ut * draws.uniform(1.0, 1.5)
        if sensor.reference_ut is not None or isinstance(sensor.reference, WorldModel):
            # A part of the scale error is that of the unit.
            k = errors.scale_error
            tesla = sensor.unit_ut / (1.0 - 0.5 * k)
            errors = VectorSensorBounds(
                errors.error, 0.5 * k, errors.misalignment, errors.averaged_error, errors.averaged_over
            )
    if stated.angle is not None:
        true = np.einsum("nji,j->ni", at_true, field_ut)
        kinds = {"offset": of.kinds["field offset"]}
        error = _less_in_rest(of, rows, stated.angle + math.radians(sensor.alignment_error_deg))
        return vector_errors.turned_away(true, error, at_true, kinds, draws) / tesla
    added = vector_errors.draw_disturbances(
        stated, of.stated.rests, rows, of.first, of.stated.delay_of(sensor), at_true, of.kinds, draws
    )
    true = np.einsum("nji,nj->ni", at_true, field_ut + added)
    shown = vector_errors.shown_vectors(
        true,
        at_rows,
        rows,
        errors,
        None,
        _prefixed(of.kinds, "field"),
        _still_in_rest(of, rows, float(np.linalg.norm(field_ut))),
        draws,
    )
    return _misaligned(shown, sensor.alignment_error_deg, draws) / tesla


def _velocity(
    of: _Draw,
    moved: vector_errors.Moved,
    columns: dict[str, FloatArray],
    clocks: dict[str, FloatArray],
    gyro_clock: str,
) -> None:
    stated, draws = of.stated.velocity, of.draws
    assert stated is not None
    clock = stated.time_column or of.stated.configuration.time_column
    if clock not in clocks:
        clocks[clock] = own_stamps(of, stated.delay_s)
    stamps = clocks[clock]
    times = stamps - stated.delay_s + of.offset("the velocity", stated.time_offset_bound_s)
    true = moved.velocities_at(np.clip(times, moved.times[0], moved.times[-1]))
    along = gyro_errors.pattern(
        of.kinds["velocity"],
        np.tile(np.eye(3), (len(times), 1, 1)),
        true,
        draws,
    )
    turn = scipy.spatial.transform.Rotation.from_quat(draws.standard_normal(4))
    shown = turn.apply(true + AT_BOUND * stated.error_m_per_s * along) / units.VELOCITY[stated.unit]
    if clock == gyro_clock:
        rare = np.arange(len(shown)) % int(draws.choice([1, 10, 25])) != 0
        shown[rare] = np.nan
    columns |= dict(zip(stated.columns, shown.T, strict=True))
