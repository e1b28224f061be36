"""Each term of the bounds of a gyro's turns and of stamps, alone: the truth comes to the edge, so that none is lost.

Theory, sections 18.3 and 18.4. One source of error acts at its bound; a bound that leaves it out, or counts half of it,
is smaller than the error (`tests/mutations`).
"""

import dataclasses

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.matrix_effects import scale_effects
from elliptude.bounds.stamps import time_offset_angles
from scipy.spatial.transform import Rotation


def turn_of(times, rates):
    """The rotation that rates make, the rate in a step the mean of its ends."""
    turn = Rotation.identity()
    for step in Rotation.from_rotvec(0.5 * np.diff(times)[:, None] * (rates[1:] + rates[:-1])):
        turn = turn * step
    return turn


def anchored(gyro, times, shown, duration):
    """The bound of the last row's turn from its anchor."""
    turns = gyro.anchored_turns(times, shown, duration)
    return turns.angles[-1]


def assert_reached(angle, *bounds, share=0.999):
    for bound in bounds:
        assert angle <= bound * (1.0 + 1e-9)
        assert angle >= share * bound


# --- one error alone, about one axis ----------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [0.0, 0.3])
@pytest.mark.parametrize("error", ["noise", "bias"])
def test_a_gyro_that_shows_nothing(error, k):
    """The body turns, and noise or bias hide it: (1 - k) ω - e = 0, so that the turn is e/(1 - k) times the time."""
    gyro = GyroBounds(**({"noise": 0.0, "scale_error": k} | {error: 0.01}))
    times = np.linspace(0.0, 3.0, 301)
    shown = np.zeros((301, 3))
    angle = 0.03 / (1.0 - k)
    # The bounds' terms of second order: half of the angle squared.
    share = 0.98
    assert_reached(angle, gyro.window_angle(times, shown), anchored(gyro, times, shown, 10.0), share=share)


def test_a_scale_error_hides_a_part_of_the_turn():
    """Against what is shown it is k/(1 - k), which by one matrix of any kind may be √3 times as much."""
    k, turned = 0.6, 0.02
    gyro = GyroBounds(noise=0.0, scale_error=k)
    times = np.linspace(0.0, 1.0, 101)
    shown = np.tile([turned, 0.0, 0.0], (101, 1))
    angle = k / (1.0 - k) * turned
    assert_reached(angle, gyro.window_angle(times, shown), anchored(gyro, times, shown, 10.0))


@pytest.mark.parametrize("k", [0.0, 0.3])
def test_a_drift_since_the_beginning(k):
    """Anchors do not bring back what was known of the bias: the drift counts from the first row."""
    gyro = GyroBounds(noise=0.0, drift=0.001, scale_error=k)
    times = np.linspace(0.0, 8.0, 801)
    shown = np.zeros((801, 3))
    error = 0.001 * times / (1.0 - k)
    last = times >= 6.0
    angle = np.trapezoid(error[last], times[last])
    turns = gyro.anchored_turns(times, shown, 2.0)
    assert turns.anchors[-1] == 600
    assert_reached(angle, turns.angles[-1], gyro.window_angle(times[last], shown[last], times[last]), share=0.98)


# --- a gap ------------------------------------------------------------------------------------------------------------

GAP = 0.1
AROUND = np.array([0.0, GAP])


def across(shown, **bounds):
    """The row behind a gap, from the one before it."""
    gyro = GyroBounds(**({"noise": 0.0, "longest_interval": 0.02, "largest_rate": 50.0} | bounds))
    return gyro.anchored_turns(AROUND, np.asarray(shown, dtype=np.float64), 1.0)


def test_a_rate_that_changes_in_a_gap_and_back():
    """At both ends the gyro shows the same, and between them the rate rises and falls as fast as it may."""
    acceleration, rate = 0.1, np.array([0.3, 0.0, 0.0])
    turns = across([rate, rate], angular_acceleration=acceleration)
    times = np.linspace(0.0, GAP, 2001)
    true = rate + np.outer(acceleration * np.minimum(times, GAP - times), [1.0, 0.0, 0.0])
    off = (Rotation.from_rotvec(GAP * turns.rates[1]).inv() * turn_of(times, true)).magnitude()
    # Its axes turn by 0.03 rad meanwhile, which the bound counts and a fixed axis does not use.
    assert_reached(off, turns.angles[1], share=0.98)
    assert GAP * turns.noise[1] == pytest.approx(turns.angles[1], rel=1e-3)


@pytest.mark.parametrize(("error", "share"), [("bias", 1.0), ("noise", 3.0)])
def test_errors_of_the_samples_around_a_gap(error, share):
    """They hide the rate at its ends. So does a part that changes quickly, which is another one between them."""
    turns = across(np.zeros((2, 3)), angular_acceleration=1e-9, **{error: 0.01})
    assert_reached(share * 0.01 * GAP, turns.angles[1])


@pytest.mark.parametrize("seed", range(4))
def test_rates_that_change_in_a_gap_in_any_way(seed):
    """The true turn is within the bound of that at the mean of both ends, for changes of every direction."""
    draws = np.random.default_rng(seed)
    used = []
    for _ in range(40):
        acceleration, pieces = 10.0 ** draws.uniform(0.0, 3.0), int(draws.integers(1, 6))
        kinks = np.concatenate([[0.0], np.sort(draws.uniform(0.0, GAP, pieces - 1)), [GAP]])
        changes = draws.normal(size=(pieces, 3))
        changes *= acceleration / np.linalg.norm(changes, axis=1)[:, None]
        true = draws.normal(size=3) * draws.uniform(0.0, 10.0)
        corners = true + np.concatenate([np.zeros((1, 3)), np.cumsum(np.diff(kinks)[:, None] * changes, axis=0)])
        times = np.linspace(0.0, GAP, 501)
        rates = np.column_stack([np.interp(times, kinks, corner) for corner in corners.T])
        turns = across(rates[[0, -1]], angular_acceleration=acceleration, largest_rate=1e6)
        if turns.angles[1] < np.pi:
            off = (Rotation.from_rotvec(GAP * turns.rates[1]).inv() * turn_of(times, rates)).magnitude()
            used.append(off / turns.angles[1])
    assert len(used) > 20
    assert max(used) <= 1.0
    assert max(used) > 0.4


def test_what_a_gap_is_passed_with():
    """The largest rate where it says more, or where nothing else is stated; rows without a rate are passed by."""
    rates = np.tile([1.0, 0.0, 0.0], (2, 1))
    for bounds in ({}, {"angular_acceleration": 1e4}, {"angular_acceleration": 10.0, "largest_rate": 0.1}):
        turns = across(rates, **bounds)
        assert not turns.rates[1].any()
        assert turns.angles[1] == pytest.approx(min(GAP * bounds.get("largest_rate", 50.0), np.pi))
    gyro = GyroBounds(noise=0.0, longest_interval=0.02, largest_rate=5.0, angular_acceleration=10.0)
    times = np.array([0.0, 0.01, 0.04, 0.07, 0.11, 0.12])
    rates = np.tile([1.0, 0.0, 0.0], (6, 1))
    rates[[2, 3]] = np.nan  # other sensors' rows
    turns = gyro.anchored_turns(times, rates, 1.0)
    assert turns.anchors.tolist() == [0, 0, 1, 1, 1, 4]
    np.testing.assert_allclose(turns.rates[[2, 3, 4]], [[0.0, 0.0, 0.0]] * 2 + [[1.0, 0.0, 0.0]])
    np.testing.assert_allclose(turns.angles[[2, 3]], [0.15, 0.3])
    assert 0.025 < turns.angles[4] < 0.03
    # Where a row in the gap is so near its end that the largest rate says more from there, none is passed by.
    late = gyro.anchored_turns(np.array([0.0, 0.01, 0.04, 0.109, 0.11, 0.12]), rates, 1.0)
    assert late.anchors.tolist() == [0, 0, 1, 2, 3, 4]
    assert late.angles[4] == pytest.approx(0.005)
    rates[0] = np.nan  # no rate before the gap
    assert gyro.anchored_turns(times, rates, 1.0).angles[1] == pytest.approx(0.05)
    with pytest.raises(ValueError, match="angular_acceleration must be at least 0, not -1"):
        GyroBounds(0.1, angular_acceleration=-1.0)


def test_anchors_are_rows_with_measurements():
    """What is measured in a row that is no anchor is not carried on."""
    times, rates = 0.01 * np.arange(100), np.zeros((100, 3))
    measured = np.zeros(100, bool)
    measured[[3, 17, 18, 44]] = True
    gyro = GyroBounds(noise=0.1)
    anchors = gyro.anchored_turns(times, rates, 0.2, measured=measured).anchors
    assert np.unique(anchors).tolist() == [0, 18, 38, 44, 64, 84]
    every = gyro.anchored_turns(times, rates, 0.2, measured=np.ones(100, bool)).anchors
    np.testing.assert_array_equal(every, gyro.anchored_turns(times, rates, 0.2).anchors)


# --- increments -------------------------------------------------------------------------------------------------------


def test_noise_that_is_fixed_in_space_while_the_body_turns():
    """Seen from the body it turns, so that it integrates to little; in space it adds up: 1 + Θ."""
    speed, radius = 10.0, 1e-4
    times = np.linspace(0.0, 3.0, 6001)
    noise = speed * radius
    body = np.array([0.0, 0.0, 1.0]) * speed
    attitudes = Rotation.from_rotvec(times[:, None] * body)
    errors = attitudes.inv().apply([noise, 0.0, 0.0])
    shown = body + errors
    angle = (turn_of(times, shown) * attitudes[-1].inv()).magnitude()
    assert angle == pytest.approx(3.0 * noise, rel=1e-3)
    # The integral of noise that turns with the rate `speed` stays on a circle.
    gyro = GyroBounds(noise=noise, increment=2.0 * radius)
    for bound in (gyro.window_angle(times, shown), anchored(gyro, times, shown, 10.0)):
        assert 0.99 * bound <= angle <= bound


def test_noise_that_goes_round_while_the_gyro_shows_nothing():
    """Coning: each round leaves the area of its circle, which is all of second order."""
    frequency, noise = 100.0, 5.0
    times = np.linspace(0.0, 4.0, 40001)
    rates = noise * np.column_stack([np.cos(frequency * times), np.sin(frequency * times), np.zeros_like(times)])
    angle = turn_of(times, rates).magnitude()
    gyro = GyroBounds(noise=noise, increment=2.0 * noise / frequency)
    shown = np.zeros((401, 3))
    rows = np.linspace(0.0, 4.0, 401)
    assert angle > 4.0 * gyro.increment
    for bound in (gyro.window_angle(rows, shown), anchored(gyro, rows, shown, 10.0)):
        assert 0.4 * bound <= angle <= bound


# --- one matrix -------------------------------------------------------------------------------------------------------


def test_one_matrix_adds_up_where_the_body_turns_about_an_axis_in_space():
    """The axis is the body's first, second and third: a scale error of all three does √3 times what one does."""
    k, rounds = 1e-4, 5
    # Turns about a body axis in whole rounds, each followed by a quarter turn that brings the next axis there.
    quarter = 0.5 * np.pi
    legs = [
        (2.0 * np.pi * rounds, [1.0, 0.0, 0.0]),
        (quarter, [0.0, 0.0, -1.0]),
        (2.0 * np.pi * rounds, [0.0, 1.0, 0.0]),
        (quarter, [-1.0, 0.0, 0.0]),
        (2.0 * np.pi * rounds, [0.0, 0.0, 1.0]),
    ]
    times, shown = [0.0], [np.zeros(3)]
    for angle, axis in legs:
        # A rate that rises and falls, zero at both ends, so that rows say all of it.
        steps = int(np.ceil(angle / 0.02))
        profile = np.sin(np.pi * np.arange(1, steps + 1) / steps) ** 2
        profile *= angle / (0.01 * profile.sum())
        times += [times[-1] + 0.01 * (n + 1) for n in range(steps)]
        shown += [rate * np.asarray(axis) for rate in profile]
    times, shown = np.asarray(times), np.asarray(shown)
    # Where the first axis is at the start, the second is after the first quarter, and the third after the second.
    gyro = GyroBounds(noise=0.0, scale_error=k)
    true = shown / (1.0 - k)
    angle = (turn_of(times, true) * turn_of(times, shown).inv()).magnitude()
    bound = anchored(gyro, times, shown, 1e3)
    assert angle == pytest.approx(k / (1.0 - k) * 6.0 * np.pi * rounds, rel=1e-2)
    assert 0.95 * bound <= angle <= bound


def test_how_far_a_scale_error_has_been_when_it_comes_back():
    """Turns about x, y, back about x, back about y: to first order nothing is left, to second the square that was run
    round. A gyro that shows a tenth of the turn does not see nearly all of it."""
    k, side = 0.9, 1e-3
    profile = np.sin(np.pi * np.arange(1, 41) / 40) ** 2
    profile *= side / (0.01 * profile.sum())
    legs = [profile[:, None] * np.array(axis) for axis in ([1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0])]
    shown = np.concatenate([np.zeros((1, 3)), *legs])
    times = 0.01 * np.arange(len(shown))
    gyro = GyroBounds(noise=0.0, scale_error=k)
    true = shown / (1.0 - k)
    angle = (turn_of(times, true) * turn_of(times, shown).inv()).magnitude()
    assert angle == pytest.approx((side / (1.0 - k)) ** 2, rel=0.02)
    assert_reached(angle, anchored(gyro, times, shown, 10.0), share=0.2)


def test_rotation_vectors_differ_by_more_than_the_turns():
    """(18.12): about 2.5 rad, a small turn across the axis moves its vector by θ/2 / sin(θ/2) times as much."""
    gyro = GyroBounds(noise=0.01)
    times = np.array([0.0, 1.0])
    shown = np.tile([0.0, 0.0, 2.5], (2, 1))
    turns = gyro.anchored_turns(times, shown, 1.0)
    true = Rotation.from_rotvec(shown[0])
    largest = 0.0
    for direction in np.linspace(0.0, 2.0 * np.pi, 73):
        off = 0.01 * np.array([np.cos(direction), np.sin(direction), 0.0])
        moved = (true * Rotation.from_rotvec(off)).as_rotvec()
        largest = max(largest, np.linalg.norm(moved - turns.rates[1]))
    assert largest <= turns.noise[1]
    assert largest > 0.99 * turns.noise[1]


# --- stamps -----------------------------------------------------------------------------------------------------------


def test_a_stamp_that_is_off_while_the_gyro_shows_too_little():
    gyro = GyroBounds(noise=0.01, bias=0.02, scale_error=0.2)
    times = np.linspace(0.0, 2.0, 201)
    true = 1.0
    shown = np.tile([0.0, 0.0, 0.8 * true - 0.03], (201, 1))
    angles = time_offset_angles(times, shown, 0.05, gyro=gyro)
    np.testing.assert_allclose(angles[5:-5], 0.05 * true, rtol=1e-12)  # beyond the samples nothing is known


def test_what_the_rate_may_do_between_samples():
    """It rises from zero at one sample, and is zero again at the next: within an offset of a step it turns by ah²/4."""
    step, acceleration = 0.1, 2.0
    times = np.arange(0.0, 2.0, step)
    angles = time_offset_angles(times, np.zeros((20, 3)), step, angular_acceleration=acceleration)
    turned = 0.25 * acceleration * step**2
    assert (angles >= turned).all()
    assert (angles <= 2.0001 * turned).all()


@pytest.mark.parametrize("side", [-1, 1])
def test_the_samples_beyond_the_offset_count(side):
    """A rate that is high at one sample only is high for a part of the steps beside it."""
    times = np.arange(0.0, 2.0, 0.1)
    rates = np.zeros((20, 3))
    rates[10, 0] = 3.0
    angles = time_offset_angles(times, rates, 0.15)
    row = 10 + 2 * side
    # From 0.05 to 0.15 s away, on the line between the samples: the mean of 0 and 1.5 rad/s for 0.05 s.
    assert angles[row] >= 0.5 * 1.5 * 0.05


def test_a_stamp_between_two_samples():
    """The rate rises from zero at one sample and is zero again at the next; the stamps are in the middle between."""
    step, acceleration, tau = 0.1, 2.0, 0.01
    times = np.arange(0.0, 2.0, step)
    between = times[:-1] + 0.5 * step
    angles = time_offset_angles(times, np.zeros((20, 3)), tau, at=between, angular_acceleration=acceleration)
    turned = tau * (0.5 * acceleration * step - 0.5 * acceleration * tau)
    assert (angles >= turned).all()
    assert (angles <= 1.2 * turned).all()


@pytest.mark.parametrize("end", [0, -1])
def test_a_stamp_that_may_be_beyond_the_samples(end):
    """Nothing was measured there: the largest rate counts, or how fast the rate changes; without either anything."""
    times, rates, tau = 0.01 * np.arange(100), np.tile([0.1, 0.0, 0.0], (100, 1)), 0.02
    known = GyroBounds(0.01, longest_interval=0.015)
    assert time_offset_angles(times, rates, tau, gyro=known)[end] == np.pi
    largest = dataclasses.replace(known, largest_rate=3.0)
    np.testing.assert_allclose(time_offset_angles(times, rates, tau, gyro=largest)[end], tau * 3.0, rtol=1e-12)
    # A rate that grows from its sample on, by the angular acceleration. The sample shows too little by the noise; and
    # the part of the rate that changes quickly, as much, is the other way at the sample.
    growing = dataclasses.replace(largest, angular_acceleration=5.0)
    np.testing.assert_allclose(
        time_offset_angles(times, rates, tau, gyro=growing)[end], tau * (0.1 + 3.0 * 0.01 + 0.5 * 5.0 * tau), rtol=1e-12
    )
    # One that is stated beside the noise, as between samples.
    beside = time_offset_angles(times, rates, tau, gyro=growing, angular_acceleration=2.0)[end]
    assert tau * (0.11 + 0.5 * 2.0 * tau) <= beside <= tau * (0.11 + 2.0 * tau)
    # Within the samples nothing has changed.
    np.testing.assert_allclose(time_offset_angles(times, rates, tau, gyro=growing)[50], tau * 0.11, rtol=1e-12)


@pytest.mark.parametrize("end", [-1.0, 1.0])
@pytest.mark.parametrize("beyond", [0.0, 0.05, 1.0, 10.0])
def test_a_stamp_beyond_the_samples(beyond, end):
    """The rate grows from the last sample on: the turn is that about the stamp, long after it."""
    times, rates, growth, tau = 0.01 * np.arange(101), np.tile([1.0, 0.0, 0.0], (101, 1)), 1.0, 0.1
    stamp = times[-1 if end > 0.0 else 0] + end * beyond
    turned = tau * (1.0 + growth * beyond) + 0.5 * growth * tau**2
    gyro = GyroBounds(0.0, angular_acceleration=growth, longest_interval=0.02)
    known = ({"gyro": gyro}, {"gyro": gyro, "angular_acceleration": growth}, {"angular_acceleration": growth})
    for stated in known:
        (angle,) = time_offset_angles(times, rates, tau, at=[stamp], **stated)
        assert_reached(turned, angle, share=0.96 if "gyro" in stated and "angular_acceleration" in stated else 0.999)


def test_a_stamp_less_than_its_offset_beyond_the_samples():
    """Of the time between the stamp and the true one only a part is beyond them."""
    times, rates, growth, tau, beyond = 0.01 * np.arange(101), np.zeros((101, 3)), 1.0, 0.1, 0.04
    gyro = GyroBounds(0.0, angular_acceleration=growth, longest_interval=0.02)
    (angle,) = time_offset_angles(times, rates, tau, at=[times[-1] + beyond - tau], gyro=gyro)
    assert 0.5 * growth * beyond**2 <= angle <= tau * 0.5 * growth * beyond * (1.0 + 1e-9)


def test_only_what_is_across_a_direction_turns_it():
    """A body that turns about an axis 30° from the direction: half of the rate counts, and all of the gyro's error."""
    times, speed, tau = 0.01 * np.arange(200), 2.0, 0.03
    axis, direction = np.array([0.0, 0.0, 1.0]), np.array([0.5, 0.0, np.sqrt(0.75)])
    rates = np.tile(speed * axis, (200, 1))
    angles = time_offset_angles(times, rates, tau, vectors=np.tile(7.0 * direction, (200, 1)))
    turned = Rotation.from_rotvec(tau * speed * axis).apply(direction)
    true = np.arctan2(np.linalg.norm(np.cross(direction, turned)), direction @ turned)
    assert_reached(true, angles[100])
    gyro = GyroBounds(0.1, largest_rate=5.0)
    wrong = time_offset_angles(times, rates, tau, gyro=gyro, vectors=np.tile(direction, (200, 1)))
    np.testing.assert_allclose(wrong[3:-3], tau * (0.5 * speed + 0.1), rtol=1e-12)
    # Near a missing rate the largest one counts, or nothing is known.
    rates[100] = np.nan
    wrong = time_offset_angles(times, rates, tau, gyro=gyro, vectors=np.tile(direction, (200, 1)))
    np.testing.assert_allclose(wrong[98:103], tau * 5.0, rtol=1e-12)
    assert np.isnan(time_offset_angles(times, rates, tau, vectors=np.tile(direction, (200, 1)))[98:103]).all()


def test_noise_that_goes_round_at_the_rate_of_the_body():
    """Its integral runs on a circle: less than 1 + Θ times the largest distance there, and no less than half of it."""
    speed, radius = 10.0, 1e-4
    times = np.linspace(0.0, 3.0, 6001)
    attitudes = Rotation.from_rotvec(times[:, None] * np.array([0.0, 0.0, speed]))
    shown = np.array([0.0, 0.0, speed]) + attitudes.inv().apply([speed * radius, 0.0, 0.0])
    angle = (turn_of(times, shown) * attitudes[-1].inv()).magnitude()
    # A noise bound that says nothing leaves the integral's.
    gyro = GyroBounds(noise=1e-2, increment=2.0 * radius)
    for bound in (gyro.window_angle(times, shown), anchored(gyro, times, shown, 10.0)):
        assert angle <= bound <= 1.4 * angle


def test_the_ball_about_the_values_of_an_integral():
    """The corners of a regular tetrahedron are as far apart as the increment, and in no smaller ball."""
    corners = 0.5 * 0.3 / np.sqrt(2.0) * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    apart = np.linalg.norm(corners[:, None] - corners, axis=2)
    np.testing.assert_allclose(apart[~np.eye(4, dtype=bool)], 0.3, rtol=1e-12)
    radius = np.linalg.norm(corners[0])
    gyro = GyroBounds(1.0, increment=0.3)
    # From one end to the other, and Θ times in between; a short turn has less by the distance from where it began.
    np.testing.assert_allclose(gyro.swept_increment(np.array([8.0])), radius * 10.0, rtol=1e-12)
    np.testing.assert_allclose(gyro.swept_increment(np.array([0.1])), 0.3 * 1.1, rtol=1e-12)
    np.testing.assert_allclose(gyro.swept_increment(np.array([16.0]), 2.0), 2.0 * radius * 10.0, rtol=1e-12)
    assert np.isinf(GyroBounds(1.0).swept_increment(np.array([8.0]))).all()


# --- samples that are far apart ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [1.0, 0.01])
@pytest.mark.parametrize("k", [1e-6, 1e-3, 0.02])
def test_one_matrix_where_the_body_turns_far_in_a_step(k, step):
    """Up to 1.8 rad a step, and a matrix that was found by a search for the largest error."""
    shown = np.array(
        [
            [-2.01, -1.12, 1.3],
            [-0.52, -1.42, -0.87],
            [0.63, 1.29, 1.76],
            [0.87, -0.87, -0.35],
            [-0.02, 0.42, -0.59],
            [1.77, 0.06, -1.02],
        ]
    )
    worst = np.array([[0.789, 0.615, 0.013], [0.587, -0.759, 0.283], [-0.184, 0.215, 0.959]])
    matrix = -k * worst / np.linalg.norm(worst, 2)
    times = step * np.arange(len(shown))
    rates = 0.5 * (shown[1:] + shown[:-1])
    true = np.linalg.solve(np.eye(3) + matrix, rates.T).T
    off = Rotation.identity()
    for one in Rotation.from_rotvec(rates):
        off = off * one
    for one in Rotation.from_rotvec(true)[::-1]:
        off = off * one.inv()
    assert off.magnitude() <= anchored(GyroBounds(0.0, scale_error=k), times, shown / step, 100.0 * step)


def test_chords_of_arcs_are_counted():
    """A turn about one axis in one large step: the trapezoid's effect is shorter than the arc's by θ³/12."""
    steps, angle = np.array([0.5]), 1.2
    effects, chords = scale_effects(
        steps, Rotation.from_rotvec([[0.0, 0, 0], [0, 0, angle]]).as_matrix(), np.tile([0.0, 0, angle / 0.5], (2, 1))
    )
    # The integral of C(s) K' ω over the step, for K' that takes ω to x: ω ∫ (cos, sin) = (sin θ, 1 - cos θ).
    exact = np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
    found = effects[-1].reshape(3, 3, 3)[:, 0, 2]
    gap = np.linalg.norm(exact - found)
    assert 0.9 * chords[-1] <= gap <= chords[-1]


def test_one_matrix_needs_the_chords():
    """Turns of 1.3 rad about one axis after the other, each from rest to rest, and a matrix found by a search."""
    k, legs = 1e-5, np.array([[-0.859, 0.015, -0.913], [0.078, 1.034, 0.315], [-0.544, -0.783, 0.861]])
    shown = np.zeros((7, 3))
    shown[1::2] = 2.0 * legs
    worst = np.array([[0.5264, -0.2736, -0.805], [-0.2042, -0.9598, 0.1927], [-0.8254, 0.0629, -0.5611]])
    matrix = -k * worst / np.linalg.norm(worst, 2)
    true = np.linalg.solve(np.eye(3) + matrix, shown.T).T
    times = np.arange(7.0)
    off = (turn_of(times, shown) * turn_of(times, true).inv()).magnitude()
    bound = anchored(GyroBounds(0.0, scale_error=k), times, shown, 100.0)
    assert 0.7 * bound <= off <= bound
