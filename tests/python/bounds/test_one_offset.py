"""Stamps that are off by one offset for all samples of a window; theory, section 18.3, (18.59) and (18.60)."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.stamps import time_offset_angles, turns_within_offset
from elliptude.bounds.velocity import MeasuredVelocity
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from inputs import angle_between
from scipy.spatial.transform import Rotation, RotationSpline

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])
X, Y, Z = np.eye(3)
STILL = MotionBounds(acceleration=0.0)
ACROSS = MotionBounds(acceleration=0.0, jerk=0.0)
"""The same where rows have no sample."""
EXACT = GyroBounds(0.0)
STEADY = GyroBounds(0.0, angular_acceleration=0.0)
"""Which bounds the rate beyond the samples, too."""


def about(axis, angles):
    return Rotation.from_rotvec(np.multiply.outer(angles, axis))


def up_over(times, shown, rates, duration, *, at="middle", gyro=EXACT, motion=STILL, **stated):
    return gravity_bounds_over_windows(
        times, G * shown, rates, [duration], motion=motion, gyro=gyro, gravity=G, at=at, **stated
    )


def swing(times, angle=0.4, pace=12.0):
    """A body that swings about an axis across gravity: its attitude at any time, and its rates."""
    return about(X, angle * np.sin(pace * times)), np.outer(angle * pace * np.cos(pace * times), X)


# --- what it says -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", ["middle", "end"])
@pytest.mark.parametrize("tau", [-0.005, 0.005])
def test_a_turn_that_goes_on_is_attained(at, tau):
    """The body spins about an axis across gravity, and every sample is of another time than its stamp says."""
    times, rate = 0.005 * np.arange(401), 3.0
    shown = about(X, rate * (times + tau)).inv().apply(UP)
    found = up_over(times, shown, np.tile(rate * X, (401, 1)), 1.0, at=at, time_offset=0.005, time_offset_change=0.0)
    error = angle_between(found.directions[200], about(X, rate * times[200]).inv().apply(UP))
    assert error == pytest.approx(rate * abs(tau), rel=1e-9)
    assert error <= found.angles[200] <= 1.02 * error


def test_a_turn_there_and_back_costs_next_to_nothing():
    times, tau = 0.004 * np.arange(1001), 0.005
    shown = swing(times + tau)[0].inv().apply(UP)
    attitudes, rates = swing(times)
    # The swing's whole periods fit into the window.
    duration = 2.0 * np.pi / 12.0 * 4.0
    one = up_over(times, shown, rates, duration, time_offset=tau, time_offset_change=0.0)
    any_ = up_over(times, shown, rates, duration, time_offset=tau)
    inner = slice(300, 700)
    errors = [angle_between(a, b) for a, b in zip(one.directions[inner], attitudes[inner].inv().apply(UP), strict=True)]
    assert (errors <= one.angles[inner]).all()
    assert one.angles[inner].max() < 0.5 * any_.angles[inner].min()
    assert not one.contradicted.any()


def test_what_is_beside_its_row_is_known_and_goes_away_too():
    """Samples that come before and after their rows by turns, and no offset beside that."""
    times = 0.004 * np.arange(1001)
    own = times + 0.0015 * (-1.0) ** np.arange(1001)
    rates = np.tile(3.0 * X, (1001, 1))
    shown = about(X, 3.0 * own).inv().apply(UP)
    found = up_over(times, shown, rates, 1.0, sampled=own)
    inner = slice(300, 700)
    truth = about(X, 3.0 * times).inv().apply(UP)[inner]
    errors = [angle_between(a, b) for a, b in zip(found.directions[inner], truth, strict=True)]
    assert (errors <= found.angles[inner]).all()
    by_lengths = time_offset_angles(times, rates, 0.0, gyro=EXACT, vectors=shown, sampled=own)
    assert found.angles[inner].max() < 0.05 * by_lengths[inner].min()


def test_samples_that_are_all_late_turn_the_mean():
    times, rate, late = 0.004 * np.arange(501), 3.0, 0.0015
    shown = about(X, rate * (times + late)).inv().apply(UP)
    found = up_over(times, shown, np.tile(rate * X, (501, 1)), 1.0, sampled=times + late)
    error = angle_between(found.directions[250], about(X, rate * times[250]).inv().apply(UP))
    assert 0.98 * rate * late <= error <= found.angles[250] <= 1.02 * rate * late


# --- each term alone --------------------------------------------------------------------------------------------------


def test_offsets_that_change_are_attained():
    """A turn there with one offset and back with another one: each half of the change away from the middle."""
    times, rate, change = 0.005 * np.arange(401), 3.0, 0.004
    # The way changes within a step on either side of the row, at an even pace.
    ways = np.sign(np.arange(401) - 200)
    angles = rate * (np.abs(times - times[200]) - 0.5 * 0.005 * np.abs(ways))
    attitudes = about(X, angles)
    shown = (attitudes * about(X, 0.5 * change * rate * np.abs(ways))).inv().apply(UP)
    rates = rate * np.outer(ways, X)
    found = up_over(times, shown, rates, 1.0, time_offset=0.006, time_offset_change=change)
    error = angle_between(found.directions[200], attitudes[200].inv().apply(UP))
    assert 0.98 * 0.5 * change * rate <= error <= found.angles[200]
    # Where the rate changes its sign neighbours are at another rate; these are few.
    assert found.angles[200] <= 1.15 * error


def test_the_error_of_the_rate_within_the_offset_is_attained():
    """The gyro does not show a slow turn: it is in the carried frame, and between stamp and time."""
    times, tau, bias, rate = 0.005 * np.arange(401), 0.2, 0.01, 1e-5
    shown = about(X, (bias + rate) * (times - tau)).inv().apply(UP)
    gyro = GyroBounds(0.0, bias=bias)
    stated = {"gyro": gyro, "at": "end", "time_offset": tau, "time_offset_change": 0.0}
    found = up_over(times, shown, np.tile(rate * X, (401, 1)), 1.0, **stated)
    error = angle_between(found.directions[300], about(X, (bias + rate) * times[300]).inv().apply(UP))
    assert error == pytest.approx(bias * (0.5 + tau), rel=0.005)
    assert error <= found.angles[300] <= 1.005 * error


@pytest.mark.parametrize("way", [-1, 1])
def test_a_rate_that_changes_within_the_offset(way):
    """The body rests at every stamp with a sample, and turns between stamp and time, on one side alone."""
    times, tau = 0.002 * np.arange(1001), 0.004
    with_sample = np.arange(1001) % 20 == 0
    # Back far from all samples.
    speeds = np.zeros(20)
    speeds[[way % 20, 2 * way % 20]] = 0.4, 0.8
    speeds[[8, 9, 10, 11]] = -0.3
    rates = np.outer(np.tile(speeds, 51)[:1001], X)
    turned = way * 0.002 * (0.4 + 0.5 * 0.8)
    shown = np.where(with_sample[:, None], about(X, np.full(1001, turned)).inv().apply(UP), np.nan)
    found = up_over(times, shown, rates, 0.8, motion=ACROSS, time_offset=tau, time_offset_change=0.0)
    row = int(np.flatnonzero(with_sample)[25])
    error = angle_between(found.directions[row], UP)
    assert 0.2 * found.angles[row] < error <= found.angles[row]


@pytest.mark.parametrize("rate", [0.5, 10.0])
def test_what_a_slope_leaves_of_an_even_turn_is_attained(rate):
    """About an axis across the vector, (18.59): the arc is off its tangent by half of the square of the turn."""
    times, tau = 0.005 * np.arange(41), 0.02
    rates, vectors = np.tile(rate * X, (41, 1)), np.tile(G * UP, (41, 1))
    found = turns_within_offset(times, rates, vectors, times, tau, 0.0, EXACT)
    turned = about(X, np.array([tau * rate])).apply(UP)[0]
    left = np.linalg.norm(turned - UP - tau * np.cross(rate * X, UP))
    assert left <= found.others[20] <= 1.01 * left


def test_what_is_of_second_order_contradicts_nothing():
    """A turn there and back: what each sample is turned by makes the mean shorter, and nothing else explains that."""
    times, tau, rate = 0.005 * np.arange(401), 0.02, 10.0
    ways = np.sign(np.arange(401) - 200)
    attitudes = about(X, rate * (np.abs(times - times[200]) - 0.5 * 0.005 * np.abs(ways)))
    shown = (attitudes * about(X, tau * rate * ways)).inv().apply(UP)
    # Next to the change of way the rate changes within the offset.
    shown[np.abs(times - times[200]) < tau + 0.01] = np.nan
    for change in (0.0, np.inf):
        stated = {"time_offset": tau, "time_offset_change": change}
        found = up_over(times, shown, rate * np.outer(ways, X), 1.0, motion=ACROSS, **stated)
        assert np.isfinite(found.angles[195:205]).sum() == 0
        assert not found.contradicted[[150, 250]].any()


# --- offsets that drift: what they leave of the motion's bounds, (18.64) ----------------------------------------------


def shaken(accelerations, *, duration=1.0, at="middle", **stated):
    """Up from accelerations along x at 101 rows within a second, of a body that does not turn."""
    times, forces = 0.01 * np.arange(101), np.outer(accelerations, X) + G * UP
    return gravity_bounds_over_windows(
        times, forces, np.zeros((101, 3)), [duration], gyro=STEADY, gravity=G, at=at, **stated
    )


def assert_edge(found, row, acceleration, share=0.999):
    """Up is off by all of the acceleration, and by no more than its bound."""
    error = angle_between(found.directions[row], UP)
    assert error == pytest.approx(np.arctan(acceleration / G), rel=1e-6)
    assert error <= found.angles[row] * (1.0 + 1e-9)
    assert share * found.angles[row] <= error


DRIFT = {"time_offset": 0.1, "time_offset_change": 0.2}
"""From 0.1 s early to 0.1 s late within a window of 1 s, which is 0.8 s of the motion."""


def test_a_window_that_drifts_is_a_shorter_one_of_the_speed():
    """A steady acceleration from one speed to the opposite one, in the time that the window really has."""
    speed = 1.0
    found = shaken(np.full(101, 2.0 * speed / 0.8), motion=MotionBounds(velocity=speed), **DRIFT)
    assert_edge(found, 50, 2.0 * speed / 0.8)


@pytest.mark.parametrize("change", [0.2, np.inf])
def test_a_window_that_drifts_is_a_shorter_one_of_the_place(change):
    """From one side of the ball to the other and back, in the time that the window really has. None stated: 2 τ."""
    radius = 0.1
    stated = DRIFT | {"time_offset_change": change}
    found = shaken(np.full(101, 16.0 * radius / 0.8**2), motion=MotionBounds(position=radius), **stated)
    assert_edge(found, 50, 16.0 * radius / 0.8**2)


def test_a_window_that_drifts_is_a_shorter_one_of_the_measured_velocity():
    """The true ends are within the stamps', and between these and those the velocity changes the other way."""
    steady, largest = 2.0, 3.0
    change = steady * 0.8 - largest * 0.2
    velocity = MeasuredVelocity([0.0, 1.0], [[0.0, 0.0, 0.0], [change, 0.0, 0.0]], 0.0, largest)
    found = shaken(np.full(101, steady), motion=MotionBounds(), velocity=velocity, **DRIFT)
    assert_edge(found, 50, steady)


def test_an_acceleration_changes_by_more_between_stamps_that_drift():
    """In a gap it rises and falls by its jerk, in a time that is longer than the stamps say."""
    jerk, gap = 50.0, 0.2
    unseen = 0.25 * jerk * 1.2 * gap**2
    shown = np.full(101, -unseen)
    shown[41:60] = np.nan
    found = shaken(shown, at="end", motion=MotionBounds(velocity=0.0, jerk=jerk), **DRIFT)
    assert_edge(found, 100, unseen, share=0.99)


@pytest.mark.parametrize("duration", [0.1, 0.2])
def test_a_window_that_may_be_no_time_at_all(duration):
    """Then a bound of the acceleration alone says something of its mean, and without one nothing does."""
    velocity = MeasuredVelocity([0.0, 1.0], np.zeros((2, 3)), 0.0, 1.0)
    bounds = MotionBounds(velocity=0.0, position=0.0, acceleration=1.5)
    found = shaken(np.full(101, 1.5), duration=duration, motion=bounds, velocity=velocity, **DRIFT)
    assert_edge(found, 50, 1.5)
    nothing = MotionBounds(velocity=0.0, position=0.0)
    found = shaken(np.full(101, 1.5), duration=duration, motion=nothing, velocity=velocity, **DRIFT)
    assert (found.angles[1:] == np.pi).all()
    assert not found.contradicted.any()


@pytest.mark.parametrize("at", ["middle", "end"])
@pytest.mark.parametrize("rate", [-0.02, 0.02])
def test_offsets_that_drift_while_the_body_shakes(rate, at):
    """At 5 Hz with 20 m/s²; windows of any length, whose samples are of times that come closer or part."""
    times = 0.005 * np.arange(801)
    pace, swing_ = 2.0 * np.pi * 5.0, 20.0
    offsets = rate * (times - 2.0)
    forces = np.outer(swing_ * np.sin(pace * (times + offsets)), X) + G * UP
    motion = MotionBounds(swing_ / pace, swing_ / pace**2, swing_)
    for duration in (0.3, 1.0, 1.9):
        found = gravity_bounds_over_windows(
            times, forces, np.zeros((801, 3)), [duration], motion=motion, gyro=EXACT, gravity=G, at=at,
            time_offset=0.041, time_offset_change=1.001 * abs(rate) * duration,
        )  # fmt: skip
        errors = np.array([angle_between(a, UP) for a in found.directions])
        assert not found.contradicted.any()
        # A trapezoidal sum of 40 samples a period is its integral but for a thousandth of the swing.
        assert (errors <= found.angles + 2e-3)[np.isfinite(found.angles)].all()


# --- anything that the bounds allow -----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_up_is_within_its_bound_whatever_the_motion(seed):
    """Random turns, samples beside their rows, offsets within theirs, and a gyro with one matrix and a bias."""
    draws = np.random.default_rng(seed)
    times = 0.01 * np.arange(500) + draws.uniform(0.0, 0.002, 500)
    knots = np.arange(-1.0, 7.0, draws.choice([0.3, 0.8]))
    fast = draws.choice([0.2, 0.6])
    motion = RotationSpline(knots, Rotation.from_rotvec(fast * draws.standard_normal((len(knots), 3))))
    tau, change = draws.choice([0.002, 0.02]), draws.choice([0.0, 0.002])
    common = draws.choice([-1.0, 1.0]) * (tau - 0.5 * change)
    offsets = common + 0.5 * change * draws.choice([-1.0, 1.0], 500)
    own = np.sort(times + draws.choice([0.0, 0.003]) * draws.uniform(-1.0, 1.0, 500))
    scale, bias = 0.01 * draws.standard_normal((3, 3)), 0.01 * draws.standard_normal(3)
    true_rates = motion(times, 1)
    rates = true_rates @ (np.eye(3) + scale).T + bias
    # What the true rate does beside the line between two samples is the gyro's noise.
    between = np.linspace(0.0, 1.0, 7)[1:-1]
    bent = 0.0
    for share in between:
        at = times[:-1] + share * np.diff(times)
        line = (1.0 - share) * true_rates[:-1] + share * true_rates[1:]
        bent = max(bent, np.linalg.norm(motion(at, 1) - line, axis=1).max())
    gyro = GyroBounds(
        1.1 * bent, bias=float(np.linalg.norm(bias)), scale_error=float(np.linalg.norm(scale, 2)), longest_interval=0.02
    )
    shown = motion(own + offsets).inv().apply(UP)
    truth = motion(times).inv().apply(UP)
    for at in ("middle", "end"):
        for duration in (0.3, 1.5):
            stated = {"time_offset": tau, "time_offset_change": change, "sampled": own, "gyro": gyro, "at": at}
            found = up_over(times, shown, rates, duration, **stated)
            assert not found.contradicted.any()
            errors = np.array([angle_between(a, b) for a, b in zip(found.directions, truth, strict=True)])
            assert (errors <= found.angles)[np.isfinite(found.angles)].all()
            assert np.isfinite(found.angles).sum() > 400
            wider = up_over(times, shown, rates, duration, **(stated | {"time_offset_change": np.inf}))
            # Not so the angles, as another mean may have the smaller radius.
            assert (found.radii <= wider.radii * (1.0 + 1e-12))[np.isfinite(found.angles)].all()


def test_next_to_gaps_and_ends_lengths_count():
    """No rate is known there: what is known of the turn is that of (18.58)."""
    times = np.concatenate([0.01 * np.arange(50), 1.0 + 0.01 * np.arange(50)])
    rates, vectors = np.tile(2.0 * X, (100, 1)), np.tile(UP, (100, 1))
    gyro = GyroBounds(0.0, longest_interval=0.02, largest_rate=20.0)
    turns = turns_within_offset(times, rates, vectors, times, 0.015, 0.0, gyro)
    by_lengths = time_offset_angles(times, rates, 0.015, gyro=gyro, vectors=vectors)
    near = np.isin(np.arange(100), [0, 1, 48, 49, 50, 51, 98, 99])
    np.testing.assert_array_equal(turns.others[near], by_lengths[near])
    assert not turns.slopes[near].any()
    assert not turns.across[near].any()
    assert (turns.others[~near] < 0.1 * by_lengths[~near]).all()
    np.testing.assert_allclose(turns.slopes[~near], np.tile(2.0 * np.cross(X, UP), (92, 1)))


def test_a_change_is_not_negative():
    times = np.linspace(0.0, 2.0, 201)
    with pytest.raises(ValueError, match=r"time_offset_change must be at least 0, not -1\.0"):
        up_over(times, np.tile(UP, (201, 1)), np.zeros((201, 3)), 1.0, time_offset_change=-1.0)
