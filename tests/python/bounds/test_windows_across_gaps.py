"""Windows that reach across lost samples: each term at its edge, and motions with all errors. Theory, section 18.14."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.windows import MotionBounds, field_bounds_over_windows, gravity_bounds_over_windows
from inputs import angle_between
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])
STEP = 0.01
# A rate that does not change, of a body whose turns are known.
STEADY = GyroBounds(0.0, angular_acceleration=0.0)
NO_SPEED = MotionBounds(velocity=0.0, jerk=0.0)


def without(times, *arrays, lost):
    """What is left of arrays if samples between two times are lost."""
    kept = (times <= lost[0] + 1e-9) | (times >= lost[1] - 1e-9)
    return [array[kept] for array in (times, *arrays)]


def tilted(acceleration, length=G):
    """A specific force whose part across up is this, m/s², if it is (0, 0, length) but for that; shape (N, 3)."""
    acceleration = np.asarray(acceleration)
    return np.column_stack([acceleration, np.zeros((len(acceleration), 1)), np.full((len(acceleration), 1), length)])


def reached(bounds, share, row=-1, up=UP):
    error = angle_between(bounds.directions[row], up)
    assert not bounds.contradicted[row]
    assert share * bounds.angles[row] <= error <= bounds.angles[row] * (1.0 + 1e-9)


def over_one_second(times, forces, *, motion=NO_SPEED, gyro=STEADY, rates=None, **others):
    rates = np.zeros((len(times), 3)) if rates is None else rates
    return gravity_bounds_over_windows(
        times, forces, rates, [1.0], motion=motion, gyro=gyro, maximum_step=0.015, **others
    )


# --- each term alone --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lost", ["rows", "forces", "rates"])
def test_an_acceleration_that_rises_and_falls_in_a_gap(lost):
    """In the gap it comes to j h / 2 above its line; the speed at the ends is none. The mean of samples is j h² / 4."""
    jerk, gap = 50.0, 0.2
    times = STEP * np.arange(101)
    shown = np.full(101, -0.25 * jerk * gap**2)  # over 1 s this undoes what was not seen
    forces, rates = tilted(shown[:, None]), np.zeros((101, 3))
    in_gap = (times > 0.4 + 1e-9) & (times < 0.4 + gap - 1e-9)
    if lost == "rows":
        times, forces, rates = times[~in_gap], forces[~in_gap], rates[~in_gap]
    else:  # then a step of any length is one that the gyro covers, but not across a row without a sample
        (forces if lost == "forces" else rates)[in_gap] = np.nan
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [1.0], motion=MotionBounds(velocity=0.0, jerk=jerk), gyro=STEADY,
        maximum_step=0.015 if lost == "rows" else np.inf,
    )  # fmt: skip
    reached(bounds, share=0.99)


def test_what_is_in_a_triangle_while_nothing_is_seen():
    """The gap is at the top of a triangle, where weights are twice as large; the place is the same at both ends."""
    jerk, gap, top = 50.0, 0.1, 1.0
    times = STEP * np.arange(201)
    weights = 1.0 - np.abs(times - top)
    # The mean with the triangle's weights of the whole acceleration is zero, as at the edge of a ball of radius zero.
    in_gap = (times >= top - 1e-9) & (times <= top + gap + 1e-9)
    unseen = jerk * np.minimum(times - top, top + gap - times).clip(0.0) * in_gap
    fine = np.linspace(0.0, gap, 10_001)
    mean = np.trapezoid(jerk * np.minimum(fine, gap - fine) * (1.0 - fine), fine)
    assert mean == pytest.approx(np.sum(unseen * weights) * STEP, rel=0.02)
    times, forces = without(times, tilted(np.full((201, 1), -mean)), lost=(top, top + gap))
    row = int(np.searchsorted(times, top - 1e-9))
    bounds = gravity_bounds_over_windows(
        times, forces, np.zeros((len(times), 3)), [2.0], motion=MotionBounds(position=0.0, jerk=jerk), gyro=STEADY,
        at="middle", maximum_step=0.015,
    )  # fmt: skip
    # A third instead of a quarter covers that weights are not equal.
    reached(bounds, share=0.68, row=row)


def test_a_gap_between_wrong_samples():
    """The samples around it are off, and show the quick part of the acceleration, which is the other way in the gap."""
    error, gap = 0.5, 0.2
    times = STEP * np.arange(101)
    # The wrong samples and their neighbours cancel, in the means of all but the gap.
    off = np.zeros(101)
    off[[40, 60]], off[[39, 61]] = error, -0.5 * error
    # All is quick: outside the gap it is c, in it c - 2 error, so that over 1 s there is none.
    shown = off + 2.0 * error * gap
    times, forces = without(times, tilted(shown[:, None]), lost=(0.4, 0.6))
    sensor = VectorSensorBounds(error=error, averaged_error=0.0, averaged_over=0.0)
    reached(over_one_second(times, forces, sensor=sensor), share=0.99)


def test_pieces_that_are_short_for_a_mean():
    """A mean of 0.5 s is exact, and half of that is all wrong: on both sides of a gap."""
    error, gap, strength = 4.0, 0.1, 40.0
    times = STEP * np.arange(101)
    off = np.full(101, -error)
    off[(times >= 0.4 - 1e-9)] = error  # on the left from 0.15 s on it is the other way
    off[(times < 0.4 - 1e-9) & (times > 0.15)] = error
    times, fields = without(times, tilted(off[:, None], strength), lost=(0.4, 0.4 + gap))
    sensor = VectorSensorBounds(error=error, averaged_error=0.0, averaged_over=0.5)
    bounds = field_bounds_over_windows(
        times, fields, np.zeros((len(times), 3)), [0.6], disturbance=0.0, gyro=STEADY, strength=strength,
        strength_error=1.0, sensor=sensor, maximum_step=0.015,
    )  # fmt: skip
    row = int(np.searchsorted(times, 0.75 - 1e-9))
    reached(bounds, share=0.98, row=row)


def test_a_long_mean_is_not_lost_to_a_short_gap():
    sensor = VectorSensorBounds(error=4.0, averaged_error=1.0, averaged_over=0.5)
    # 1 + (2 · 0.5 · 15/8 + 0.02 · 3) / 10
    np.testing.assert_allclose(sensor.mean_error_across_gaps(0.1, 1, 0.02), 1.0 + 0.1 * (1.875 + 0.06))


def test_a_turn_in_a_gap():
    """In the gap the body turns and stops: a h² / 4 that no sample shows. Nearly all of the window lies before it."""
    acceleration, gap = 3.0, 0.2
    times = STEP * np.arange(201)
    turn = 0.25 * acceleration * gap**2
    forces = np.tile(Rotation.from_rotvec([turn, 0.0, 0.0]).inv().apply(G * UP), (201, 1))
    forces[times < 1.75] = G * UP
    times, forces = without(times, forces, lost=(1.74, 1.74 + gap))
    gyro = GyroBounds(0.0, angular_acceleration=acceleration)
    bounds = gravity_bounds_over_windows(
        times, forces, np.zeros((len(times), 3)), [2.0], motion=NO_SPEED, gyro=gyro, maximum_step=0.015
    )
    reached(bounds, share=0.96, up=Rotation.from_rotvec([turn, 0.0, 0.0]).inv().apply(UP))


def test_the_largest_rate_alone_closes_a_gap_as_well():
    """The body turns on at its largest rate, and the samples around the gap show none."""
    largest, gap = 0.2, 0.3
    times = STEP * np.arange(201)
    turn = largest * gap
    forces = np.tile(Rotation.from_rotvec([turn, 0.0, 0.0]).inv().apply(G * UP), (201, 1))
    forces[times < 1.65] = G * UP
    times, forces = without(times, forces, lost=(1.64, 1.64 + gap))
    gyro = GyroBounds(0.0, largest_rate=largest)
    bounds = gravity_bounds_over_windows(
        times, forces, np.zeros((len(times), 3)), [2.0], motion=NO_SPEED, gyro=gyro, maximum_step=0.015
    )
    reached(bounds, share=0.97, up=Rotation.from_rotvec([turn, 0.0, 0.0]).inv().apply(UP))


@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize("scale_error", [0.0, 1e-9])
def test_the_noise_of_each_piece_counts(at, scale_error):
    """Its integral is within c in each piece: on both sides of the gap it comes to c, the same way."""
    noise, increment, lasts = 0.04, 0.002, 0.05
    times = 0.002 * np.arange(1001)
    rates = np.zeros((1001, 3))
    row, lost = (2.0, (1.9, 1.904)) if at == "end" else (1.0, (0.93, 0.934))
    for begin in (lost[0] - lasts, lost[1]):
        rates[(times > begin - 1e-9) & (times < begin + lasts - 1e-9), 0] = noise
    if at == "middle":  # a turn to the other side behind the row pushes the mean the same way
        rates[(times > row - 1e-9) & (times < row + lasts - 1e-9), 0] = -noise
    times, rates, forces = without(times, rates, np.tile(G * UP, (1001, 1)), lost=lost)
    gyro = GyroBounds(noise, increment=increment, angular_acceleration=0.0, scale_error=scale_error)
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [2.0], motion=NO_SPEED, gyro=gyro, maximum_step=0.003, at=at
    )
    # With one c for all of the window the bound would be below the error.
    reached(bounds, share=0.8, row=int(np.searchsorted(times, row - 1e-9)))


@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize("scale_error", [0.0, 1e-9])
def test_the_noise_of_pieces_that_the_sensor_does_not_see(at, scale_error):
    """While no sample of the sensor is there the gyro loses several: its noise comes to c in each piece between."""
    noise, increment, lasts, count = 0.04, 0.002, 0.05, 4
    times = 0.002 * np.arange(1001)
    rates, forces = np.zeros((1001, 3)), np.tile(G * UP, (1001, 1))
    row = 1000 if at == "end" else 500
    steps = round(lasts / 0.002) + 2
    begin = row - count * steps
    for piece in range(count):
        rates[begin + piece * steps : begin + (piece + 1) * steps, 0] = noise
        rates[begin + piece * steps] = np.nan
    forces[begin + 1 : row - 1] = np.nan
    gyro = GyroBounds(noise, increment=increment, angular_acceleration=0.0, scale_error=scale_error)
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [2.0], motion=NO_SPEED, gyro=gyro, maximum_step=0.003, at=at
    )
    # All of the window before is off by four times c; counted as one gap it would be two.
    reached(bounds, share=0.6 if at == "end" else 0.5, row=row)


# --- which windows ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", ["end", "middle"])
def test_rows_without_a_sample_are_as_good_as_rows_that_are_not_there(at):
    draws = np.random.default_rng(3)
    times = STEP * np.arange(400)
    rates, forces = 0.3 * draws.standard_normal((2, 400, 3))
    forces += G * UP
    lost = draws.random(400) < 0.02
    gyro = GyroBounds(0.01, 0.01, scale_error=0.02, increment=0.01, angular_acceleration=200.0)
    arguments = {"motion": MotionBounds(1.0, 0.5, jerk=50.0), "gyro": gyro, "maximum_step": 0.015, "at": at}
    sensor = VectorSensorBounds(error=3.0)
    removed = gravity_bounds_over_windows(
        times[~lost], forces[~lost], rates[~lost], [0.5, 2.0], sensor=sensor, **arguments
    )
    empty, unknown = forces.copy(), rates.copy()
    empty[lost], unknown[lost] = np.nan, np.nan
    with_empty = gravity_bounds_over_windows(times, empty, unknown, [0.5, 2.0], sensor=sensor, **arguments)
    np.testing.assert_array_equal(with_empty.angles[~lost], removed.angles)
    assert np.isnan(with_empty.angles[lost]).all()
    # A rate that is there says more than a line across the gap.
    forces_alone = gravity_bounds_over_windows(times, empty, rates, [0.5, 2.0], sensor=sensor, **arguments)
    both = np.isfinite(removed.angles) & np.isfinite(forces_alone.angles[~lost])
    assert np.isfinite(removed.angles).sum() > 300
    assert (forces_alone.angles[~lost][both] <= removed.angles[both] + 1e-12).mean() > 0.95


def test_a_long_step_is_a_gap_for_stamps_too():
    """An offset in time that reaches into it counts the largest rate there, whichever way the step is known as one."""
    times = STEP * np.arange(201)
    times, forces = without(times, np.tile(G * UP, (201, 1)), lost=(1.0, 1.1))
    bounds = [
        gravity_bounds_over_windows(
            times, forces, np.zeros((len(times), 3)), [0.5], motion=MotionBounds(1.0, jerk=1.0),
            gyro=GyroBounds(0.01, longest_interval=longest, largest_rate=2.0, angular_acceleration=1.0),
            maximum_step=0.015, time_offset=0.05,
        )
        for longest in (0.015, np.inf)
    ]  # fmt: skip
    np.testing.assert_array_equal(bounds[0].angles, bounds[1].angles)
    far, near = int(np.searchsorted(times, 0.9)), int(np.searchsorted(times, 1.0))
    assert bounds[0].angles[near] > bounds[0].angles[far]


@pytest.mark.parametrize("unstated", ["rate", "jerk"])
def test_windows_end_at_a_gap_that_nothing_is_said_of(unstated):
    times = STEP * np.arange(201)
    times, forces = without(times, np.tile(G * UP, (201, 1)), lost=(1.0, 1.1))
    gyro = GyroBounds(0.01) if unstated == "rate" else GyroBounds(0.01, angular_acceleration=1.0)
    motion = MotionBounds(1.0) if unstated == "jerk" else MotionBounds(1.0, jerk=1.0)
    bounds = gravity_bounds_over_windows(
        times, forces, np.zeros((len(times), 3)), [0.5, 1.5], motion=motion, gyro=gyro, maximum_step=0.015
    )
    begin = times - bounds.durations
    across = (times > 1.05) & (begin < 1.05)
    assert not across[np.isfinite(bounds.angles)].any()


# --- motions with all errors ------------------------------------------------------------------------------------------


def moving(draws, duration):
    """Attitudes, rates, accelerations at times, and the largest speed, way, jerk and angular acceleration."""
    frequencies, phases = draws.uniform(0.5, 9.0, (2, 4, 3)), draws.uniform(0.0, 2.0 * np.pi, (2, 4, 3))
    sizes = draws.uniform(0.2, 1.0, 2)

    def wave(which, t, order):
        angle = frequencies[which] * np.asarray(t)[..., None, None] + phases[which] + order * np.pi / 2.0
        return sizes[which] * (frequencies[which] ** order * np.sin(angle)).sum(axis=-2)

    def turning(t, q):
        x, y, z = wave(0, t, 0)
        return 0.5 * np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]]) @ q

    solved = solve_ivp(turning, (0.0, duration), [1.0, 0.0, 0.0, 0.0], dense_output=True, rtol=1e-10, atol=1e-12)
    fine = np.linspace(0.0, duration, 8001)

    def largest(which, order):
        return float(np.linalg.norm(wave(which, fine, order), axis=1).max()) * (1.0 + 1e-4)

    motion = MotionBounds(largest(1, 1), largest(1, 0), jerk=largest(1, 3))
    attitudes = lambda t: Rotation.from_quat(solved.sol(t).T, scalar_first=True)  # noqa: E731
    return attitudes, lambda t: wave(0, t, 0), lambda t: wave(1, t, 2), motion, largest(0, 1)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("at", ["end", "middle"])
def test_windows_across_gaps_hold_for_motion_with_all_errors(seed, at):
    draws = np.random.default_rng(seed)
    attitudes_at, rates_at, acceleration_at, motion, angular = moving(draws, 8.0)
    times = 0.004 * np.arange(2001)
    attitudes, rates = attitudes_at(times), rates_at(times)
    up = attitudes.inv().apply(UP)
    gyro = GyroBounds(noise=0.02, bias=0.01, scale_error=0.02, increment=0.05, angular_acceleration=angular)
    sensor = VectorSensorBounds(error=0.2, scale_error=0.01)

    def unit():
        vector = draws.standard_normal(3)
        return vector / np.linalg.norm(vector)

    wobble = Rotation.from_rotvec(3.0 * times[:, None] * unit()).apply(unit())
    shown = (np.eye(3) + 0.02 * Rotation.random(rng=draws).as_matrix()) @ rates[:, :, None]
    shown = shown[:, :, 0] + 0.01 * unit() + 0.018 * wobble
    forces = 1.01 * attitudes.inv().apply(G * UP + acceleration_at(times)) + 0.2 * unit()
    # Gaps of one to twenty samples; some of the gyro alone, some of the accelerometer alone.
    kept = np.ones(len(times), dtype=bool)
    for begin in draws.integers(20, 1970, 8):
        lost = slice(begin, begin + int(draws.choice([1, 1, 2, 5, 20])))
        of = draws.integers(3)
        if of == 0:
            kept[lost] = False
        else:
            (shown if of == 1 else forces)[lost] = np.nan
    bounds = gravity_bounds_over_windows(
        times[kept], forces[kept], shown[kept], [0.5, 1.0, 2.0, 4.0], motion=motion, gyro=gyro, sensor=sensor,
        maximum_step=0.006, at=at,
    )  # fmt: skip
    assert not bounds.contradicted.any()
    error, angles = angle_between(bounds.directions, up[kept]), bounds.angles
    measured = np.isfinite(angles)
    assert measured.mean() > 0.9
    assert (error <= angles)[measured].all()
    # Windows do reach across gaps: many are longer than what lies between them.
    has_both = np.flatnonzero(np.isfinite(forces).all(axis=1) & np.isfinite(shown).all(axis=1) & kept)
    pieces = np.split(times[has_both], np.flatnonzero(np.diff(has_both) > 1) + 1)
    longest = max(piece[-1] - piece[0] for piece in pieces)
    assert np.nanmax(bounds.durations) > min(longest, 3.9)
