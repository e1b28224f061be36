"""Calibrates the sensors of a recording: which poses and turns count, and what follows from them."""

import hashlib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from elliptude import units
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.rest import mean_acceleration_at_rest, mean_over_time
from elliptude.bounds.samples import angle_to_center
from elliptude.bounds.stamps import time_offset_angles
from elliptude.calibration.found import Found, FoundGyro
from elliptude.calibration.gyro import Turn, gyro_set
from elliptude.calibration.poses import Pose, poses_of, windows_of
from elliptude.calibration.vector_sensors import (
    ContradictionError,
    SensorStatements,
    proposal,
    require_possible,
    sensor_set,
)
from elliptude.configuration.calibration import (
    AccelerometerStatements,
    CalibrationStatements,
    MagnetometerStatements,
)
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import Rule, after_rest, moved_fields, rest_at_start
from elliptude.configuration.sensors import Accelerometer, Magnetometer
from elliptude.estimation import gaps
from elliptude.estimation.direction_rows import require_shared_stamps
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

# So many windows of a long recording are used, evenly: leaving some out makes a set no smaller than it may be.
_MOST_WINDOWS = 1000
# A long rest has no more either: rounding of a mean is bounded for as many (docs/theory.md, 19.2).
_MOST_SAMPLES = 100_000
# Up at the end of a rest is that of its last seconds: the gyro's error grows with the time.
_UP_S = 2.0


def calibrate(log: Log, configuration: Configuration, statements: CalibrationStatements) -> list[Found | FoundGyro]:
    """What a recording says of its accelerometer, its magnetometer and its gyro.

    Parameters
    ----------
    log : Log
    configuration : Configuration
        With a rule: what a rest is, how far the gyro, gravity and the stamps may be off. No calibration is applied.
    statements : CalibrationStatements

    Returns
    -------
    list of Found or FoundGyro
        In the order of the directions, the gyro last.

    Raises
    ------
    ValueError
        If the configuration has no rule, or the recording does not start at rest.
    ContradictionError
        If no parameters agree with the samples and the statements.
    """
    if configuration.rule is None or log.rates is None:
        raise ValueError(
            "calibrate needs a configuration with a rule, which says what a rest is and what the gyro does"
        )
    for sensor in configuration.directions:
        if isinstance(sensor, Magnetometer) and sensor.unit == "normalized":
            raise ValueError(
                f"{sensor.name!r}: strength_ut is stated in µT, and a normalized magnetometer does not measure that; "
                "calibrate one that shows µT"
            )
    rule = configuration.rule.rule()
    if (known := statements.gyro) is not None:
        # What the rule's gyro turns by its noise, and how its bias changes, says nothing of another one.
        stated_instead = known.model_dump() | {"noise_turn_deg": None, "noise_turn_growth_deg_per_s": None}
        stated_instead["bias_change_deg_per_s"] = None
        rule = rule.model_copy(update={"gyro": rule.gyro.model_copy(update=stated_instead)})
        rule.require_earth_rate()
    gyro = replace(rule.gyro.bounds(), longest_interval=gaps.longest_interval(log, configuration))
    log = gaps.without_rates_in_gaps(log, gyro.longest_interval)
    assert log.rates is not None
    require_shared_stamps(log, [sensor.name for sensor in configuration.directions], np.arange(len(log.times)))
    accelerometer = next(i for i, sensor in enumerate(configuration.directions) if isinstance(sensor, Accelerometer))
    forces, forces_at = log.directions[:, accelerometer], log.sampled(accelerometer)
    rest = rest_at_start(rule.rest, log.times, log.rates, forces, gyro)
    rates = log.rates - mean_over_time(log.times[rest], log.rates[rest])
    gyro = after_rest(gyro, log.times[rest])
    rests = _rests(log, rule, forces, statements.accelerometer)
    found: list[Found | FoundGyro] = []
    for i, sensor in enumerate(configuration.directions):
        if isinstance(sensor, Accelerometer):
            vectors, rows = forces, np.zeros(len(log.times), dtype=np.bool_)
            for one in rests:
                rows[one] = True
            stated, poses = _accelerometer(log, rule, gyro, rates, forces, forces_at, rests, statements.accelerometer)
            force = statements.accelerometer
            later = force.later_noise_m_per_s2, force.later_averaged_noise_m_per_s2
        elif isinstance(sensor, Magnetometer) and rule.magnetometer is not None:
            vectors, rows = log.directions[:, i] / units.FIELD["uT"], np.ones(len(log.times), dtype=np.bool_)
            stated, poses = _magnetometer(log, rule, gyro, rates, vectors, log.sampled(i), statements.magnetometer)
            later = statements.magnetometer.later_noise_ut, statements.magnetometer.later_averaged_noise_ut
        else:
            continue
        try:
            require_possible(log.times[rows], vectors[rows], stated)
            left = sensor_set(poses, stated)
        except ContradictionError as error:
            unit = "m/s^2" if isinstance(sensor, Accelerometer) else "uT"
            raise ContradictionError(f"{sensor.name!r}: {error} {unit}; a statement is wrong") from error
        this = Found(sensor, stated, left, proposal(poses, stated)[:3] if poses else None, *later)
        found.append(this)
        if isinstance(sensor, Accelerometer):
            upright = this
    assert isinstance(configuration.flow, GyroFlow)
    turns = _turns(log, rule, gyro, rates, forces, forces_at, rests, upright, statements.accelerometer)
    try:
        found.append(FoundGyro(configuration.flow, rule.gyro, gyro_set(turns, gyro, max(rule.motion.windows_s))))
    except ContradictionError as error:
        raise ContradictionError(f"the gyro: {error}; a statement is wrong") from error
    return found


def _rests(log: Log, rule: Rule, forces: FloatArray, known: AccelerometerStatements) -> list[slice]:
    """The rests that last long enough."""
    assert log.rates is not None
    resting = rule.rest.rows(log.times, log.rates, forces)
    ends = np.flatnonzero(np.diff(resting, prepend=False, append=False))
    rests = [slice(int(a), int(b)) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    return [rows for rows in rests if log.times[rows.stop - 1] - log.times[rows.start] >= 0.99 * known.rest_s]


def _turns(
    log: Log,
    rule: Rule,
    gyro: GyroBounds,
    rates: FloatArray,
    forces: FloatArray,
    forces_at: FloatArray | None,
    rests: list[slice],
    accelerometer: Found,
    known: AccelerometerStatements,
) -> list[Turn]:
    """From each rest to the next, with up by the calibrated accelerometer at both ends, (18.7)."""
    found, times, table = accelerometer.left, log.times, rule.accelerometer
    corrected = (forces - found.offset) @ found.matrix.T
    k = found.scale_error
    own = times if forces_at is None else forces_at
    offset = table.time_offset_bound_s
    offsets = time_offset_angles(times, rates, offset, gyro=gyro, sampled=forces_at)

    def up(rows: slice) -> tuple[int, FloatArray, float] | None:
        duration = float(own[rows.stop - 1] - own[rows.start])
        mean = min(known.acceleration_m_per_s2, mean_acceleration_at_rest(known.velocity_m_per_s, duration, offset))
        poses = poses_of([rows], times, corrected, rates, offsets, gyro, 0.0, lambda _: mean, forces_at)
        if not poses:
            return None
        pose = poses[0]
        vector = np.einsum("app->a", pose.products)
        length = float(np.linalg.norm(vector))
        longest = float(np.linalg.norm(corrected[rows], axis=1).max())
        error, averaged_error = accelerometer.here(duration)
        radius = mean + pose.turn * longest + averaged_error
        radius += k / (1.0 - k) * (pose.length + error) + 1e-10 * longest
        angle, excess = angle_to_center(length, table.gravity_m_per_s2, radius, table.gravity_error_m_per_s2)
        if excess > 0.0:
            raise ContradictionError(
                f"{accelerometer.sensor.name!r}: the rest from {times[rows.start]:.2f} s shows {length:.4g} m/s^2, "
                f"{float(excess):.2g} m/s^2 further from gravity than what is stated allows"
            )
        return (rows.start + rows.stop) // 2, vector / length, float(angle)

    turns = []
    for one, other in pairwise(rests):
        begin = int(np.searchsorted(times, times[one.stop - 1] - _UP_S))
        end = int(np.searchsorted(times, times[other.start] + _UP_S, side="right"))
        before, after = up(slice(max(one.start, begin), one.stop)), up(slice(other.start, min(other.stop, end)))
        if before is None or after is None:
            continue
        rows = slice(before[0], after[0] + 1)
        if gyro.gaps(times[rows], rates[rows]).any():
            continue
        bias = gyro.bias + gyro.drift * float(times[after[0]] - times[0])
        turns.append(Turn(times[rows], rates[rows], before[1], after[1], before[2], after[2], bias))
    return turns


def _accelerometer(
    log: Log,
    rule: Rule,
    gyro: GyroBounds,
    rates: FloatArray,
    forces: FloatArray,
    forces_at: FloatArray | None,
    rests: list[slice],
    known: AccelerometerStatements,
) -> tuple[SensorStatements, list[Pose]]:
    """Rests: over one the mean acceleration is small, as the speed is."""
    gravity, error = rule.accelerometer.gravity_m_per_s2, rule.accelerometer.gravity_error_m_per_s2
    stated = SensorStatements(
        offset=known.offset_m_per_s2,
        scale_error=known.scale_error,
        noise=known.noise_m_per_s2,
        averaged_noise=known.averaged_noise_m_per_s2,
        least=gravity - error,
        greatest=gravity + error,
        disturbance=known.acceleration_m_per_s2,
        misalignment=np.pi if known.misalignment_deg is None else np.deg2rad(known.misalignment_deg),
        averaged_over=known.averaged_over_s,
    )
    offset = rule.accelerometer.time_offset_bound_s
    offsets = time_offset_angles(log.times, rates, offset, gyro=gyro, sampled=forces_at)

    def mean_of_rest(duration: float) -> float:
        return min(known.acceleration_m_per_s2, mean_acceleration_at_rest(known.velocity_m_per_s, duration, offset))

    rests = [slice(one.start, min(one.stop, one.start + _MOST_SAMPLES)) for one in rests]
    poses = poses_of(rests, log.times, forces, rates, offsets, gyro, stated.axes_error, mean_of_rest, forces_at)
    return stated, poses


def _magnetometer(
    log: Log,
    rule: Rule,
    gyro: GyroBounds,
    rates: FloatArray,
    fields: FloatArray,
    fields_at: FloatArray | None,
    known: MagnetometerStatements,
) -> tuple[SensorStatements, list[Pose]]:
    """Windows of the rule's length, one after the other: a disturbance does not average out."""
    assert rule.magnetometer is not None
    stated = SensorStatements(
        offset=known.offset_ut,
        scale_error=known.scale_error,
        noise=known.noise_ut,
        averaged_noise=known.averaged_noise_ut,
        least=known.strength_ut[0],
        greatest=known.strength_ut[1],
        disturbance=known.disturbance_ut,
        misalignment=np.pi if known.misalignment_deg is None else np.deg2rad(known.misalignment_deg),
        averaged_over=known.averaged_over_s,
    )
    moved = moved_fields(rule.magnetometer, log.times, fields, fields_at, gyro.longest_interval)
    angles = time_offset_angles(log.times, rates, moved.offset, gyro=gyro, sampled=moved.sampled)
    windows = windows_of(log.times, rule.magnetometer.window_s)
    windows = windows[:: -(-len(windows) // _MOST_WINDOWS) or 1]
    poses = poses_of(
        windows, log.times, moved.values, rates, angles, gyro, stated.axes_error, lambda _: known.disturbance_ut,
        moved.sampled,
    )  # fmt: skip
    return stated, poses


def sha256_of(path: Path) -> str:
    """The hash of a file, or of all files of a folder in the order of their names."""
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            with file.open("rb") as opened:
                while block := opened.read(1 << 20):
                    digest.update(block)
    return digest.hexdigest()
