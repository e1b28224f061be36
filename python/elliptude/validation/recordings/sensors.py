"""What sensors show of a motion, with errors that keep their bounds."""

import math

import numpy as np
import scipy

from elliptude import units
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.turns import running_integral
from elliptude.configuration import references
from elliptude.configuration.calibration import AccelerometerCalibration
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Direction, Magnetometer, Rate
from elliptude.configuration.statements import RestPhase, SunByTime, WorldModel
from elliptude.typing import FloatArray
from elliptude.validation.recordings import gyro_errors, vector_errors
from elliptude.validation.recordings.draw import Draw, own_stamps
from elliptude.validation.recordings.gyro_errors import AT_BOUND, unit_vector
from elliptude.validation.recordings.statements import StatedRest, added_to, radius_of, tesla_of
from elliptude.validation.recordings.truth.earths_field import field_of
from elliptude.validation.recordings.truth.tumbling import Tumbling
from elliptude.validation.recordings.truth.turning import Turning

# rad; directions that scatter less do not count as turning in a rest.
_STILL = math.radians(8.0)


def _rest_of(of: Draw) -> StatedRest | None:
    return of.stated.rests[0] if of.stated.rests else None


def moved_in(of: Draw) -> vector_errors.Moved | None:
    """How the accelerometer moves; None without one."""
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


def shown_by(
    of: Draw,
    sensor: AnyDirection | Rate,
    motion: Turning | Tumbling,
    moved: vector_errors.Moved | None,
    stamps: FloatArray,
) -> tuple[FloatArray, FloatArray | None]:
    """What a sensor shows at its stamps, in its unit but in body axes, and the reference beside it."""
    stated = of.stated
    rows = stamps - stated.delay_of(sensor)
    if isinstance(sensor, Rate):
        return _rate(of, sensor, motion, rows), None
    is_averaged = stated.rule is not None or (isinstance(sensor, Accelerometer) and stated.longest_window > 0.0)
    true_times = rows + of.offsets(sensor.name, stated.offset_of(sensor), len(rows), is_averaged=is_averaged)
    at_true, at_rows = motion.attitudes(true_times), motion.attitudes(rows)
    if isinstance(sensor, Accelerometer):
        assert moved is not None
        if is_averaged:
            at_true = motion.attitudes(true_times + of.changes(sensor.name, true_times))
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


def _rate(of: Draw, sensor: Rate, motion: Turning | Tumbling, rows: FloatArray) -> FloatArray:
    """A measured angular velocity, anywhere on the ellipsoid of its error."""
    true = motion.rates(rows)
    errors = gyro_errors.pattern(of.kinds["noise"], motion.attitudes(rows), true, of.draws)
    if sensor.bound_deg_per_s is not None:
        errors = math.radians(sensor.bound_deg_per_s) * errors
    else:
        errors = errors @ np.linalg.cholesky(np.asarray(sensor.bound_rad2_per_s2, dtype=np.float64)).T
    shown: FloatArray = true + AT_BOUND * errors
    return shown / units.ANGULAR_VELOCITY[sensor.unit]


def _references(of: Draw, sensor: Direction, times: FloatArray) -> FloatArray:
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
    of: Draw,
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
    shown = _uncorrected(of, sensor, shown) / units.ACCELERATION[sensor.unit]
    return -shown if sensor.at_rest == "down" else shown


def _less_in_rest(of: Draw, rows: FloatArray, angle: float) -> FloatArray:
    """How far directions are turned away, rad: in a rest not so far that the body would be taken to turn."""
    angles = np.full(len(rows), angle)
    for rest in of.stated.rests:
        angles[(rows >= rest.begin - 1e-6) & (rows <= rest.end + 1e-6)] = min(angle, _STILL)
    return angles


def _still_in_rest(of: Draw, rows: FloatArray, length: float) -> FloatArray:
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


def _uncorrected(of: Draw, sensor: Accelerometer | Magnetometer, corrected: FloatArray) -> FloatArray:
    """Samples that a sensor's calibration corrects to these, m/s² or µT, body axes."""
    found = of.stated.configuration.correction_of(sensor)
    if found is None:
        return corrected
    offset = found.offset_m_per_s2 if isinstance(found, AccelerometerCalibration) else found.offset_ut
    shown: FloatArray = np.linalg.solve(np.asarray(found.matrix), corrected.T).T + np.asarray(offset)
    return shown


def true_field(of: Draw, sensor: Magnetometer) -> FloatArray:
    """The field that the reference means, µT, reference axes, shape (3,)."""
    configuration, draws = of.stated.configuration, of.draws
    if sensor.reference_ut is not None:
        field_ut = np.asarray(sensor.reference_ut, dtype=np.float64)
    elif isinstance(sensor.reference, WorldModel):
        field_ut = field_of(sensor.reference, configuration.reference_frame or "ENU")
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
    of: Draw,
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
    return _uncorrected(of, sensor, _misaligned(shown, sensor.alignment_error_deg, draws)) / tesla


def shown_velocity(
    of: Draw,
    moved: vector_errors.Moved,
    columns: dict[str, FloatArray],
    clocks: dict[str, FloatArray],
) -> None:
    """Write down what a receiver shows of the velocity."""
    stated, draws = of.stated.velocity, of.draws
    assert stated is not None
    clock = stated.time_column or of.stated.configuration.time_column
    if clock not in clocks:
        clocks[clock] = own_stamps(of, stated.delay_s)
    stamps = clocks[clock]
    times = stamps - stated.delay_s
    times = times + of.offsets("the velocity", stated.time_offset_bound_s, len(times), is_averaged=False)
    true = moved.velocities_at(np.clip(times, moved.times[0], moved.times[-1]))
    along = gyro_errors.pattern(
        of.kinds["velocity"],
        np.tile(np.eye(3), (len(times), 1, 1)),
        true,
        draws,
    )
    turn = scipy.spatial.transform.Rotation.from_quat(draws.standard_normal(4))
    shown = turn.apply(true + AT_BOUND * stated.error_m_per_s * along) / units.VELOCITY[stated.unit]
    if clock == of.stated.main_clock:
        rare = np.arange(len(shown)) % int(draws.choice([1, 10, 25])) != 0
        shown[rare] = np.nan
    columns |= dict(zip(stated.columns, shown.T, strict=True))
