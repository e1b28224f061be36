"""How far noise by itself turns an attitude away, stated for any window; theory, section 18.4, (18.56) and (18.57)."""

import dataclasses

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from elliptude.configuration.rules import apply_rule, hand_held
from inputs import angle_between
from scipy.spatial.transform import Rotation

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])
STEP = 0.005
SPIN = np.array([0.0, 0.0, 10.0])


def carried(times, rates):
    """Attitudes, the rate in a step the mean of its ends."""
    attitudes = [Rotation.identity()]
    for turn in Rotation.from_rotvec(0.5 * np.diff(times)[:, None] * (rates[1:] + rates[:-1])):
        attitudes.append(attitudes[-1] * turn)
    return Rotation.concatenate(attitudes)


def turns_of_both(gyro, times, shown):
    """The two bounds of the turn over all rows: by sums, and from an anchor."""
    return gyro.window_angle(times, shown), gyro.anchored_turns(times, shown, 1e3).angles[-1]


def up_in_the_middle(times, up, shown, gyro, duration):
    return gravity_bounds_over_windows(
        times, G * up, shown, [duration], motion=MotionBounds(position=0.0), gyro=gyro, gravity=G, at="middle"
    )


@pytest.mark.parametrize("k", [0.0, 1e-6])
@pytest.mark.parametrize("stated", ["turn", "growth"])
def test_noise_that_is_fixed_in_space_while_the_body_spins(stated, k):
    """It turns the attitude by its size times the time, whatever the body does, and no more is counted."""
    times, noise = np.linspace(0.0, 3.0, 6001), 1e-3
    body = Rotation.from_rotvec(times[:, None] * SPIN)
    shown = SPIN + body.inv().apply([noise, 0.0, 0.0])
    angle = (carried(times, shown)[-1] * body[-1].inv()).magnitude()
    assert angle == pytest.approx(3.0 * noise, rel=1e-3)
    numbers = {"noise_turn": 3.0 * noise} if stated == "turn" else {"noise_turn": 0.0, "noise_turn_growth": noise}
    for bound in turns_of_both(GyroBounds(noise=1.0, scale_error=k, **numbers), times, shown):
        # The matrix counts with all that was turned.
        scale = np.sqrt(3.0) * k * 31.0
        assert angle <= bound * (1.0 + 1e-3)
        assert bound <= angle * (1.0 + 1e-3) + 1.1 * scale


def test_a_noise_turn_before_and_behind_a_gap():
    """Nothing is said of noise across a gap: there are two windows, and each may be at the bound."""
    times = np.concatenate([0.01 * np.arange(101), 1.5 + 0.01 * np.arange(101)])
    shown = np.tile([0.02, 0.0, 0.0], (202, 1))
    gyro = GyroBounds(noise=1.0, noise_turn=0.02, longest_interval=0.02, largest_rate=0.0)
    assert gyro.window_angle(times, shown) == pytest.approx(0.04)


@pytest.mark.parametrize("k", [0.0, 1e-6])
@pytest.mark.parametrize("stated", ["turn", "growth"])
def test_a_mean_over_a_window_comes_to_the_edge(stated, k):
    """Before the row noise turns the frame one way, after it the other: all samples are off alike, or by their time."""
    times, noise = STEP * np.arange(801), 0.4 if stated == "turn" else 0.01
    shown = np.zeros((801, 3))
    side = slice(396, 405) if stated == "turn" else slice(0, 801)
    shown[side, 0] = noise * np.sign(np.arange(801) - 400)[side]
    if stated == "turn":
        turn = float(np.trapezoid(shown[400:, 0], times[400:]))
        gyro, expected = GyroBounds(1.0, scale_error=k, noise_turn=turn), turn
    else:
        gyro = GyroBounds(1.0, scale_error=k, noise_turn=0.0, noise_turn_growth=noise)
        expected = noise * 2.0 / 3.0
    bounds = up_in_the_middle(times, np.tile(UP, (801, 1)), shown, gyro, 4.0)
    off = angle_between(bounds.directions[400], UP)
    assert off == pytest.approx(expected, rel=0.02)
    assert 0.97 * bounds.angles[400] <= off <= bounds.angles[400]


@pytest.mark.parametrize("k", [0.0, 1e-6])
def test_an_increment_adds_up_in_space_on_both_sides_of_the_row(k):
    """Noise that is fixed in space, and turns round at the row: its integral in the body stays on circles."""
    times, radius = 0.001 * np.arange(4001), 1e-4
    body = Rotation.from_rotvec((times - 2.0)[:, None] * SPIN)
    sign = np.sign(np.arange(4001) - 2000)[:, None]
    errors = sign * body.inv().apply([SPIN[2] * radius, 0.0, 0.0])
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(0.0005 * (errors[1:] + errors[:-1]), axis=0)])[::10]
    increment = np.linalg.norm(sums[:, None] - sums, axis=2).max()
    assert increment < 4.0 * radius
    gyro = GyroBounds(0.01, scale_error=k, increment=increment)
    bounds = up_in_the_middle(times, np.tile(UP, (4001, 1)), SPIN + errors, gyro, 4.0)
    off = angle_between(bounds.directions[2000], UP)
    # What the matrix may do beside that.
    beside = np.sqrt(3.0) * k * 20.0
    assert 0.3 * (bounds.angles[2000] - beside) <= off <= bounds.angles[2000]


def worst_noise_turn(of_noise, times, longest):
    """The largest turn between any two rows, no further apart, by noise alone."""
    largest = 0.0
    for away in range(1, round(longest / STEP) + 1):
        largest = max(largest, float((of_noise[away:] * of_noise[:-away].inv()).magnitude().max()))
    return largest


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("speed", "frequency"), [(1.0, 3.0), (8.0, 8.0), (8.0, 40.0)])
def test_turns_and_windows_hold_with_all_errors_at_once(seed, speed, frequency):
    """Noise goes round in the body; the bound of its turn is what it does. Scale and bias are at their bounds."""
    draws = np.random.default_rng(seed)
    times, window = STEP * np.arange(1201), 3.0
    phases = draws.uniform(0.0, 2.0 * np.pi, (3, 3))
    true_rates = np.sin(times[:, None, None] * draws.uniform(0.3, 4.0, (3, 3)) + phases).sum(axis=1)
    true_rates *= speed / np.linalg.norm(true_rates, axis=1).mean()
    axes, noise, bias, k = Rotation.random(rng=draws).as_matrix(), 0.3, 0.01, 0.02
    around = np.outer(np.cos(frequency * times), axes[0]) + np.outer(np.sin(frequency * times), axes[1])
    # (I + K)⁻¹ of what the gyro shows as noise.
    referred = noise / (1.0 + k) * around
    true, with_noise = carried(times, true_rates), carried(times, true_rates + referred)
    turn = worst_noise_turn(with_noise * true.inv(), times, window)
    matrix = np.eye(3) + k * Rotation.random(rng=draws).as_matrix() * draws.choice([-1.0, 1.0])
    sign = np.where(times < 3.0, -1.0, 1.0)[:, None]
    shown = (true_rates + referred + bias / (1.0 + k) * sign * axes[2]) @ matrix.T
    gyro = GyroBounds(noise, bias, scale_error=k, noise_turn=turn)
    turns = gyro.anchored_turns(times, shown, window)
    estimated = carried(times, shown)
    off = ((estimated[turns.anchors].inv() * estimated).inv() * true[turns.anchors].inv() * true).magnitude()
    assert (off <= turns.angles + 1e-12).all()
    assert off[600] <= gyro.window_angle(times[:601], shown[:601])
    up = true.inv().apply(UP)
    bounds = up_in_the_middle(times, up, shown, gyro, window)
    assert not bounds.contradicted.any()
    known = np.isfinite(bounds.angles)
    assert known[300:900].all()
    assert (angle_between(bounds.directions, up) <= bounds.angles)[known].all()
    # By the size of the noise alone hardly anything is known.
    by_size = GyroBounds(noise, bias, scale_error=k).anchored_turns(times, shown, window)
    assert turns.angles[600] < by_size.angles[600]


@pytest.mark.parametrize("name", ["noise_turn", "noise_turn_growth", "increment"])
@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_numbers_that_bound_nothing_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        GyroBounds(1.0, **{name: value})


def test_a_growth_needs_what_it_is_added_to():
    with pytest.raises(ValueError, match="noise_turn_growth needs noise_turn"):
        GyroBounds(1.0, noise_turn_growth=0.1)


def test_more_noise_leaves_nothing_of_what_it_adds_up_to():
    gyro = GyroBounds(0.1, increment=0.2, noise_turn=0.3, noise_turn_growth=0.1).with_more_noise(0.05)
    assert gyro == GyroBounds(0.1 + 0.05)


# --- for how long it is stated ----------------------------------------------------------------------------------------


STATED = [
    {"increment": 0.02},
    {"noise_turn": 0.02, "noise_turn_growth": 0.001},
    {"increment": 0.03, "noise_turn": 0.02},
]


@pytest.mark.parametrize("stated", STATED)
def test_a_window_that_is_no_longer_than_stated_is_one(stated):
    gyro = GyroBounds(0.5, scale_error=0.1, longest_window=12.0, **stated)
    always = dataclasses.replace(gyro, longest_window=np.inf)
    for span in (0.01, 4.0, 12.0):
        assert gyro.noise_angle(span, 0.3, span) == always.noise_angle(span, 0.3, span)
        assert gyro.lasting_noise(span) == always.lasting_noise(span)


@pytest.mark.parametrize("stated", STATED)
def test_a_longer_window_is_several(stated):
    """Noise that lasts adds up in each; what a window is longer by than stated costs no more than any noise."""
    gyro = GyroBounds(0.5, longest_window=12.0, **stated)
    lasting = gyro.lasting_noise(60.0)
    assert lasting == gyro.lasting_noise(12.0)
    for span in (12.001, 13.0, 24.0, 60.0, 600.0):
        assert lasting * span <= gyro.noise_angle(span, 0.0, span) * (1.0 + 1e-12)
    at_most = gyro.noise_angle(12.0, 0.0, 12.0) + gyro.noise * 0.001
    assert gyro.noise_angle(12.001, 0.0, 12.001) <= at_most * (1.0 + 1e-4)


@pytest.mark.parametrize("stated", STATED)
def test_turns_from_anchors_further_apart_than_stated(stated):
    """The gyro shows nothing of a turn that keeps all that is stated of its noise over 2 s, for 20 s."""
    gyro = GyroBounds(0.05, longest_window=2.0, **stated)
    times = 0.01 * np.arange(2001)
    turns = gyro.anchored_turns(times, np.zeros((2001, 3)), 20.0)
    turned = gyro.lasting_noise(2.0) * times
    assert (turned <= turns.angles + 1e-12).all()
    assert turned[-1] >= 0.8 * turns.angles[-1]


def test_a_rule_states_it_for_its_longest_window():
    rule = hand_held()
    longest = max(rule.motion.windows_s)
    gyro = rule.gyro_bounds()
    assert gyro.noise_angle(5.0 * longest, 0.0, 5.0 * longest) >= 5.0 * gyro.increment
    assert gyro.noise_angle(longest, 0.0, longest) == rule.gyro.bounds().noise_angle(longest, 0.0, longest)
    times = 0.01 * np.arange(500)
    found = apply_rule(rule, times, np.zeros((500, 3)), np.tile([0.0, 0.0, 9.807], (500, 1)))
    assert found.gyro.longest_window == longest
