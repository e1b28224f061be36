"""Samples that have stamps of their own beside those of their rows: theory, section 18.3, (18.58)."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import VectorSensorBounds
from elliptude.bounds.stamps import shift_by_own_stamps, time_offset_angles
from elliptude.bounds.velocity import MeasuredVelocity
from elliptude.bounds.windows import MotionBounds, field_bounds_over_windows, gravity_bounds_over_windows
from elliptude.calibration.poses import poses_of
from inputs import angle_between
from scipy.spatial.transform import Rotation

G = 9.80665
STEP = 0.01
X, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def windows(forces, *, times=None, rates=None, durations=(1.0,), motion=None, gyro=None, **others):
    times = STEP * np.arange(len(forces)) if times is None else times
    rates = np.zeros((len(forces), 3)) if rates is None else rates
    motion = MotionBounds(acceleration=0.0) if motion is None else motion
    gyro = GyroBounds(0.0) if gyro is None else gyro
    return gravity_bounds_over_windows(times, forces, rates, durations, motion=motion, gyro=gyro, **others)


def assert_reached(bounds, up=UP, share=0.99):
    error = angle_between(bounds.directions[-1], up)
    assert not bounds.contradicted[-1]
    assert share * bounds.angles[-1] <= error <= bounds.angles[-1] * (1.0 + 1e-9)


@pytest.mark.parametrize("at", ["end", "middle"])
def test_a_body_that_shakes_while_its_samples_come_late_by_turns(at):
    """The rows' times would make of the shaking a tilt that its speed does not allow."""
    times = STEP * np.arange(2000)
    frequency, acceleration = 10.0 * np.pi, 20.0
    sampled = times + 0.004 * (np.cos(frequency * times) > 0.0)
    forces = G * UP + np.outer(acceleration * np.sin(frequency * sampled), X)
    stated = {
        "times": times,
        "durations": [1.0, 2.0, 4.0, 8.0],
        "motion": MotionBounds(velocity=acceleration / frequency),
        "sensor": VectorSensorBounds(0.1),
        "at": at,
    }
    true = np.tile(UP, (2000, 1))
    own = windows(forces, sampled=sampled, **stated)
    assert not own.contradicted.any()
    bounded = np.isfinite(own.angles)
    assert bounded.sum() > 1900
    assert (angle_between(own.directions, true) <= own.angles)[bounded].all()
    by_offset = windows(forces, time_offset=0.0041, **stated)
    assert np.nanmax(angle_between(by_offset.directions, true) - by_offset.angles) > 0.0


def test_a_window_is_as_long_as_its_samples_say():
    """From -v to v between the first sample, which is late, and the last, which is early."""
    times = STEP * np.arange(101)
    sampled = times + np.linspace(0.004, -0.004, 101)
    speed, length = 0.1, sampled[-1] - sampled[0]
    bounds = windows(
        np.tile(G * UP + 2.0 * speed / length * X, (101, 1)),
        durations=[2.0],
        motion=MotionBounds(velocity=speed),
        sampled=sampled,
    )
    assert_reached(bounds, share=0.999)
    np.testing.assert_allclose(bounds.durations[-1], length)


def test_a_body_that_turns_between_samples_and_their_rows():
    """All samples are late by as much, known or not: the vector is off by the turn meanwhile."""
    times, rate = STEP * np.arange(101), 1.0
    attitudes = Rotation.from_rotvec(np.outer(rate * times, X))
    known, unknown = 0.003, 0.002
    shown = Rotation.from_rotvec(np.outer(rate * (times + known + unknown), X)).inv().apply(G * UP)
    gyro = GyroBounds(0.0, largest_rate=rate)
    turning = {"times": times, "rates": np.tile(rate * X, (101, 1)), "durations": [0.05], "gyro": gyro}
    bounds = windows(shown, sampled=times + known, time_offset=unknown, **turning)
    assert_reached(bounds, attitudes.inv().apply(UP)[-1], share=0.999)


@pytest.mark.parametrize("early", [True, False])
def test_the_turn_from_a_sample_to_its_row(early):
    """No more is in reach than what lies between them, and the offset of the stamp."""
    times = STEP * np.arange(200)
    rates = np.outer(np.where((times < 1.0) == early, 2.0, 0.5), X)
    sampled = times + (-0.2 if early else 0.2)
    angles = time_offset_angles(times, rates, 0.0, sampled=sampled)
    row = 80 if early else 120
    np.testing.assert_allclose(angles[row], 0.2 * 2.0)
    np.testing.assert_allclose(time_offset_angles(times, rates, 0.1, sampled=sampled)[row], 0.3 * 2.0)
    # Where the sample is on the other side of the row, its rate counts.
    within = 110 if early else 90
    np.testing.assert_allclose(angles[within], 0.2 * 2.0)
    at_rows = times + np.where(np.arange(200) == row, sampled - times, 0.0)
    np.testing.assert_allclose(np.flatnonzero(time_offset_angles(times, rates, 0.0, sampled=at_rows)), [row])


def test_nothing_turns_in_no_time():
    """Also beside a gap of the gyro, where nothing is known of the rate."""
    times = np.array([0.0, 0.01, 0.02, 0.52, 0.53])
    gyro = GyroBounds(0.01, longest_interval=0.02)
    sampled = times + np.array([0.0, 0.001, 0.0, 0.0, 0.0])
    angles = time_offset_angles(times, np.zeros((5, 3)), 0.0, gyro=gyro, sampled=sampled)
    np.testing.assert_allclose(angles, [0.0, 1e-5, 0.0, 0.0, 0.0], atol=1e-12)


def test_noise_that_grows_with_the_time_between_rows():
    """Rows are further apart than their samples; what the gyro does to second order is of the rows' times."""
    times = STEP * np.arange(201)
    noise, increment = 2.0, 0.01
    gyro = GyroBounds(noise, increment=increment)
    near = times + np.linspace(0.0049, -0.0049, 201)
    given = {"times": times, "durations": [3.0], "gyro": gyro}
    forces = np.tile(G * UP, (201, 1))
    assert windows(forces, sampled=near, **given).radii[-1] >= windows(forces, **given).radii[-1]


def test_a_field_that_is_moved_by_its_delay():
    times = STEP * np.arange(50)
    sampled = times + 0.003 * np.sin(np.arange(50))
    delay = 0.024
    values = np.outer(sampled - delay, X)
    shifted, shows = shift_by_own_stamps(times, sampled, values, delay)
    there = np.isfinite(shifted[:, 0])
    assert there.sum() >= 46
    np.testing.assert_allclose(shifted[there, 0], shows[there], atol=1e-12)
    assert (np.abs(shows - times)[there] <= 0.5 * STEP + 0.003).all()


def test_a_value_that_two_rows_have_counts_once():
    """Two rows may be nearest to one sample: between them no time passes."""
    times = STEP * np.arange(101)
    sampled = np.repeat(times[::2] + 0.005, 2)[:101]
    bounds = field_bounds_over_windows(
        times, np.tile(40.0 * UP, (101, 1)), np.zeros((101, 3)), [0.01, 0.5], disturbance=1.0, gyro=GyroBounds(0.0),
        strength=40.0, sampled=sampled,
    )  # fmt: skip
    assert np.isfinite(bounds.angles).sum() > 95
    assert not bounds.contradicted.any()


def test_times_of_samples_that_are_none():
    forces = np.tile(G * UP, (3, 1))
    with pytest.raises(ValueError, match="sampled must not decrease"):
        windows(forces, sampled=[0.0, 0.03, 0.02])
    with pytest.raises(ValueError, match=r"sampled must have one time for each of 3 rows, not shape \(2,\)"):
        windows(forces, sampled=[0.0, 0.01])


def test_a_velocity_at_the_time_of_a_sample():
    """The velocity was measured at the samples' own stamps: nothing is added for the time to their rows."""
    times = STEP * np.arange(101)
    sampled = times - 0.004
    acceleration, largest = 3.0, 50.0
    velocity = MeasuredVelocity(sampled, np.outer(acceleration * sampled, X), 0.0, largest)
    bounds = windows(
        np.tile(G * UP + acceleration * X, (101, 1)), durations=[0.5], motion=MotionBounds(), velocity=velocity,
        sampled=sampled,
    )  # fmt: skip
    assert_reached(bounds, share=0.999)


def test_the_weights_of_a_pose():
    """A field that grows with time: its mean is that over the samples' times, (19.2)."""
    times = STEP * np.arange(11)
    sampled = times + np.linspace(0.0, 0.005, 11) ** 2 * 200.0
    vectors = np.outer(sampled, X)
    (pose,) = poses_of(
        [slice(0, 11)], times, vectors, np.zeros((11, 3)), np.zeros(11), GyroBounds(0.0), 0.0, lambda length: length,
        sampled,
    )  # fmt: skip
    middle = 0.5 * (sampled[-1] + sampled[0])
    np.testing.assert_allclose(np.einsum("app->a", pose.products), middle * X, atol=1e-12)
    assert pose.end - pose.begin == pytest.approx(sampled[-1] - sampled[0])
    assert pose.mean_disturbance == pytest.approx(sampled[-1] - sampled[0])
