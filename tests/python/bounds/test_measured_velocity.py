"""Measured velocities: the mean acceleration over a window, and up from it. Theory, section 18.13."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.velocity import MeasuredVelocity
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from inputs import angle_between
from scipy.spatial.transform import Rotation

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])
UNKNOWN = MotionBounds()
EXACT_GYRO = GyroBounds(0.0)


def up_from(times, forces, velocity, *, durations=(1.0,), rates=None, gyro=EXACT_GYRO, motion=UNKNOWN, **others):
    rates = np.zeros((len(times), 3)) if rates is None else rates
    return gravity_bounds_over_windows(
        times, forces, rates, durations, motion=motion, gyro=gyro, velocity=velocity, **others
    )


# --- the velocity of a row --------------------------------------------------------------------------------------------


def test_the_nearest_velocity_counts_in_the_middle_and_the_last_one_at_the_end():
    measured = MeasuredVelocity([1.0, 2.0], [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], 0.5, 10.0, time_offset=0.01)
    rows = np.array([0.5, 1.0, 1.4, 1.6, 1.9, 2.3])
    nearest, last = measured.at_rows(rows, "middle"), measured.at_rows(rows, "end")
    np.testing.assert_array_equal(nearest.velocities[:, 0], [1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(last.velocities[:, 0], [np.nan, 1.0, 1.0, 1.0, 1.0, 2.0])
    np.testing.assert_allclose(nearest.errors, 0.6 + 10.0 * np.array([0.5, 0.0, 0.4, 0.4, 0.1, 0.3]))
    np.testing.assert_allclose(last.errors[1:], 0.6 + 10.0 * np.array([0.0, 0.4, 0.6, 0.9, 0.3]))
    assert last.errors[0] == np.inf
    np.testing.assert_array_equal(np.flatnonzero(nearest.nearest), [1, 4])
    np.testing.assert_array_equal(np.flatnonzero(last.nearest), [1, 5])


def test_rows_without_a_velocity_do_not_count():
    measured = MeasuredVelocity([0.0, 1.0, 2.0], [[1.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [3.0, 0.0, 0.0]], 0.0, 1.0)
    np.testing.assert_array_equal(measured.at_rows([0.9, 1.1], "middle").velocities[:, 0], [1.0, 3.0])
    nothing = MeasuredVelocity([0.0], [[np.nan] * 3], 0.0, 1.0).at_rows([0.0, 1.0], "middle")
    assert np.isinf(nothing.errors).all()
    assert not nothing.nearest.any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"error": -1.0}, "error must be finite and at least 0, not -1.0"),
        ({"largest_acceleration": np.inf}, "largest_acceleration must be finite and at least 0, not inf"),
        ({"time_offset": np.nan}, "time_offset must be finite and at least 0, not nan"),
        ({"times": [1.0, 1.0]}, "times must increase; row 1 does not"),
        ({"velocities": [[1.0, 2.0]]}, r"velocities must have shape \(2, 3\), not \(1, 2\)"),
    ],
)
def test_refused(changes, message):
    given = {"times": [0.0, 1.0], "velocities": np.zeros((2, 3)), "error": 0.1, "largest_acceleration": 1.0}
    with pytest.raises(ValueError, match=message):
        MeasuredVelocity(**(given | changes))


# --- each term alone: the truth comes to the edge ---------------------------------------------------------------------


def reached(bounds, row):
    error = angle_between(bounds.directions[row], UP)
    assert not bounds.contradicted[row]
    assert error <= bounds.angles[row] * (1.0 + 1e-9)
    return error / bounds.angles[row]


@pytest.mark.parametrize("at", ["end", "middle"])
def test_the_change_of_the_velocity(at):
    """A steady acceleration across gravity: nobody can tell it from a tilt, and the velocity says how large it is."""
    times, acceleration = 0.01 * np.arange(201), np.array([3.0, 0.0, 0.0])
    forces = np.tile(G * UP + acceleration, (201, 1))
    velocity = MeasuredVelocity(times[::10], np.outer(times[::10], acceleration), 0.0, 5.0)
    bounds = up_from(times, forces, velocity, at=at)
    assert reached(bounds, 100) > 0.999


def test_the_error_of_both_velocities():
    times, change = 0.01 * np.arange(101), 0.8
    forces = np.tile(G * UP + [2.0 * change, 0.0, 0.0], (101, 1))  # 2 ε over 1 s, both errors against each other
    velocity = MeasuredVelocity([0.0, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], change, 0.0)
    assert reached(up_from(times, forces, velocity), -1) > 0.999


@pytest.mark.parametrize("time_offset", [0.0, 0.02])
def test_what_happens_between_a_stamp_and_a_row(time_offset):
    """The window begins at a stamp and ends 0.1 s behind another, and both are off: the velocity went on changing."""
    times, largest = 0.01 * np.arange(101), 4.0
    forces = np.tile(G * UP + [largest, 0.0, 0.0], (101, 1))
    stamps = np.array([0.1, 0.9])
    shown = largest * (stamps + time_offset * np.array([1.0, -1.0]))
    velocity = MeasuredVelocity(stamps, np.outer(shown, [1.0, 0.0, 0.0]), 0.0, largest, time_offset)
    assert reached(up_from(times, forces, velocity), -1) > 0.999


def test_stamps_of_the_accelerometer_that_are_off():
    """It shows what is 0.05 s later, all of it, and the vehicle braked as hard until the samples' time began."""
    times, largest, late = 0.01 * np.arange(101), 4.0, 0.05
    forces = np.tile(G * UP + [largest, 0.0, 0.0], (101, 1))
    shown = np.array([[0.0, 0.0, 0.0], [largest * (1.0 - 2.0 * late), 0.0, 0.0]])
    velocity = MeasuredVelocity([0.0, 1.0], shown, 0.0, largest)
    still = GyroBounds(0.0, largest_rate=0.0)
    assert reached(up_from(times, forces, velocity, gyro=still, time_offset=late, time_offset_change=0.0), -1) > 0.999


# --- vehicles ---------------------------------------------------------------------------------------------------------


def vehicle(generator, count=4000, step=0.01):
    """Attitudes, rates, forces and velocities of something that brakes, turns and tilts."""
    times = np.concatenate([[0.0], np.cumsum(step * generator.uniform(0.8, 1.2, count - 1))])
    waves = generator.uniform(0.1, 1.5, (4, 3)), generator.uniform(0.0, 6.0, (4, 3))
    swing = generator.uniform(0.0, 1.2, (4, 3))

    def wave(at):
        return (swing * np.sin(waves[0] * at[:, None, None] + waves[1])).sum(axis=1)

    fine = np.sort(np.concatenate([times, 0.5 * (times[1:] + times[:-1])]))
    velocities = 6.0 * wave(fine)
    accelerations = np.gradient(velocities, fine, axis=0, edge_order=2)
    attitudes = Rotation.from_rotvec(wave(fine + 7.0))
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / np.diff(fine)[:, None]
    rates = np.concatenate([turns[:1], 0.5 * (turns[1:] + turns[:-1]), turns[-1:]])
    forces = attitudes.inv().apply(accelerations + G * UP)
    largest = float(np.linalg.norm(accelerations, axis=1).max())
    return times, attitudes[::2], rates[::2], forces[::2], velocities[::2], largest


@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize("seed", range(6))
def test_up_of_a_vehicle(seed, at):
    generator = np.random.default_rng(seed)
    times, attitudes, rates, forces, velocities, largest = vehicle(generator)
    # Errors at their bound, in one way before the middle and in the other behind it; stamps that are late or early.
    every, error, offset = 20, 0.3, 0.03
    rows = np.arange(int(generator.integers(every)), len(times), every)
    late = offset * generator.choice([-1.0, 1.0], len(rows))
    shown = np.stack([np.interp(times[rows] + late, times, velocities[:, i]) for i in range(3)], axis=1)
    way = generator.normal(size=3)
    sides = np.where(times[rows] < 0.5 * times[-1], 1.0, -1.0)
    shown += error * np.outer(sides, way / np.linalg.norm(way))
    velocity = MeasuredVelocity(times[rows], shown, error, 1.01 * largest, offset)
    gyro = GyroBounds(np.deg2rad(0.3))
    sensor = VectorSensorBounds(error=0.05)
    known = {"rates": rates, "gyro": gyro, "sensor": sensor, "durations": (1.0, 2.0, 4.0, 8.0), "at": at}
    fastest = MotionBounds(velocity=float(np.linalg.norm(velocities, axis=1).max()))
    with_it = up_from(times, forces, velocity, motion=fastest, **known)
    without = up_from(times, forces, None, motion=fastest, **known)
    ups = attitudes.inv().apply(UP)
    for bounds in (with_it, without):
        assert not bounds.contradicted.any()
        off = np.array([angle_between(one, up) for one, up in zip(bounds.directions, ups, strict=True)])
        there = ~np.isnan(bounds.angles)
        assert (off[there] <= bounds.angles[there]).all()
    assert np.nanmean(with_it.angles) < 0.7 * np.nanmean(np.where(np.isnan(without.angles), np.pi, without.angles))


def test_a_velocity_that_contradicts_is_found():
    """A specific force of 12 m/s² for 4 s, and a receiver that says the vehicle stands: one of both is wrong."""
    times = 0.01 * np.arange(401)
    velocity = MeasuredVelocity(times[::20], np.zeros((21, 3)), 0.2, 20.0)
    bounds = up_from(times, np.tile(12.0 * UP, (401, 1)), velocity, durations=(4.0,))
    assert bounds.contradicted[-1]
    assert bounds.excess[-1] == pytest.approx(12.0 - G - 0.1, rel=1e-6)
