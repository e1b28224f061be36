"""Roll, pitch and yaw: every truth is between the ends, and some truth is at each; sections 18.11 of the theory."""

import mpmath as mp
import numpy as np
import pytest
from elliptude.bounds.angles.roll_pitch_yaw import Bounded, roll_and_pitch, yaw
from scipy.spatial.transform import Rotation

NEAR = 1e-9


def axes_of(roll, pitch, yaw):
    """C = Rz(yaw) Ry(pitch) Rx(roll), by SciPy."""
    return Rotation.from_euler("ZYX", np.column_stack([yaw, pitch, roll])).as_matrix()


def angles_of(attitudes):
    """Roll, pitch and yaw, by SciPy."""
    return Rotation.from_matrix(attitudes).as_euler("ZYX")[:, ::-1].T


def inside(angles, bounded: Bounded, slack=0.0):
    """Whether each angle is between the ends, up to whole turns."""
    middle, half = 0.5 * (bounded.least + bounded.most), 0.5 * (bounded.most - bounded.least)
    away = np.abs((angles - middle + np.pi) % (2.0 * np.pi) - np.pi)
    return away <= half + slack


def turned(vectors, axes, angles):
    """Vectors turned about unit axes by angles, a row each."""
    along = (axes * vectors).sum(axis=1, keepdims=True) * axes
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return along + cos * (vectors - along) + sin * np.cross(axes, vectors)


def any_unit(rng, count):
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_the_values_are_those_of_the_aerospace_sequence():
    rng = np.random.default_rng(1)
    roll, pitch, heading = rng.uniform(-3.1, 3.1, 200), rng.uniform(-1.5, 1.5, 200), rng.uniform(-3.1, 3.1, 200)
    attitudes = axes_of(roll, pitch, heading)
    found_roll, found_pitch = roll_and_pitch(attitudes[:, 2], np.full(200, 0.01))
    zero = np.zeros(200)
    found_yaw = yaw(attitudes, zero, zero, zero, is_up=True)
    for found, true in ((found_roll, roll), (found_pitch, pitch), (found_yaw, heading)):
        np.testing.assert_allclose(found.value, true, atol=1e-13)
        assert (found.least <= found.value).all()
        assert (found.value <= found.most).all()
    assert (found_yaw.most - found_yaw.least < 1e-10).all()


def test_a_nose_that_rises_in_north_east_down_has_a_positive_pitch():
    # Body axes forward, right, down; the nose 0.3 rad above the horizon, so that down leans to the back.
    down = np.array([[-np.sin(0.3), 0.0, np.cos(0.3)]])
    roll, pitch = roll_and_pitch(down, np.zeros(1))
    assert pitch.value[0] == pytest.approx(0.3)
    assert roll.value[0] == pytest.approx(0.0)


@pytest.mark.parametrize("radius", [1e-12, 1e-6, 0.02, 0.3, 1.2, 2.5, np.pi])
def test_all_of_a_cap_is_between_the_ends_and_reaches_them(radius):
    rng = np.random.default_rng(2)
    centers, rims = any_unit(rng, 25), 4000
    centers[:3] = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [np.sin(1.5), 0.0, np.cos(1.5)]]
    roll, pitch = roll_and_pitch(centers, np.full(25, radius))
    for k, center in enumerate(centers):
        across = np.cross(center, any_unit(rng, 1)[0])
        across /= np.linalg.norm(across)
        about = np.linspace(0.0, 2.0 * np.pi, rims)
        sizes = np.where(np.arange(rims) % 4 == 0, radius * rng.uniform(0, 1, rims), radius)
        axes = turned(np.tile(across, (rims, 1)), np.tile(center, (rims, 1)), about)
        within = turned(np.tile(center, (rims, 1)), axes, sizes)
        true_pitch = np.arctan2(-within[:, 0], np.hypot(within[:, 1], within[:, 2]))
        true_roll = np.arctan2(within[:, 1], within[:, 2])
        of_roll, of_pitch = (Bounded(*(part[k] for part in one)) for one in (roll, pitch))
        assert inside(true_pitch, of_pitch).all()
        assert inside(true_roll, of_roll).all()
        # No end is farther than it must be. Where a pole is in the cap, only a random place comes near to it.
        slack = 0.1 * radius + 1e-9 if of_pitch.most - of_pitch.least < 1.99 * radius else 1e-3 * radius + 1e-9
        assert true_pitch.max() > of_pitch.most - slack
        assert true_pitch.min() < of_pitch.least + slack
        if of_roll.most - of_roll.least < np.pi:
            away = (true_roll - of_roll.value + np.pi) % (2 * np.pi) - np.pi
            half = of_roll.most - of_roll.value
            assert away.max() > half - 1e-2 * half - 1e-9
            assert away.min() < -half + 1e-2 * half + 1e-9


def test_where_the_body_may_point_straight_up_roll_and_yaw_are_anywhere():
    attitudes = axes_of(np.zeros(3), np.array([0.5 * np.pi - 0.1, -0.5 * np.pi + 0.1, 1.0]), np.zeros(3))
    angle = np.full(3, 0.1)
    roll, pitch = roll_and_pitch(attitudes[:, 2], angle)
    found = yaw(attitudes, angle, -angle, angle, is_up=True)
    for one in (roll, found):
        np.testing.assert_array_equal(one.least[:2], -np.pi)
        np.testing.assert_array_equal(one.most[:2], np.pi)
        assert one.most[2] - one.least[2] < 1.0
    assert pitch.most[0] == 0.5 * np.pi
    assert pitch.least[1] == -0.5 * np.pi


@pytest.mark.parametrize("is_up", [True, False], ids=["ENU", "NED"])
@pytest.mark.parametrize("seed", range(3))
def test_no_truth_has_a_yaw_beyond_the_ends_and_some_have_one_at_them(seed, is_up):
    """Truths as 16.11 divides them: the estimate, a turn by at most the tilt about a level axis, then the heading."""
    rng = np.random.default_rng(seed)
    cases, count = 30, 2000
    up = np.array([0.0, 0.0, 1.0 if is_up else -1.0])
    for _ in range(cases):
        pitch = rng.choice([0.0, rng.uniform(-1.5, 1.5), rng.uniform(-0.3, 0.3)])
        estimate = axes_of(*np.array([[rng.uniform(-3, 3)], [pitch], [rng.uniform(-3, 3)]]))
        tilt = rng.choice([1e-9, 1e-3, 0.1, 0.5, 0.95 * (0.5 * np.pi - abs(pitch)), 2.0])
        least, most = np.sort(rng.uniform(-1.0, 1.0, 2)) * rng.choice([1e-6, 0.1, 1.0, 3.0])
        found = yaw(estimate, np.array([tilt]), np.array([least]), np.array([most]), is_up=is_up)
        about = np.linspace(0.0, 2.0 * np.pi, count)
        axes = np.column_stack([np.cos(about), np.sin(about), np.zeros(count)])
        size = np.where(np.arange(count) % 3 == 0, tilt * rng.uniform(0, 1, count), tilt)
        heading = rng.choice([least, most, rng.uniform(least, most)], count)
        tilts, headings = Rotation.from_rotvec(size[:, None] * axes), Rotation.from_rotvec(heading[:, None] * up)
        truths = (headings * tilts * Rotation.from_matrix(estimate[0])).as_matrix()
        # The construction is what the bounds are of: the tilt between both, and the turn about up without it.
        np.testing.assert_allclose(
            np.arccos(np.clip(truths[:, 2] @ estimate[0, 2], -1, 1)), np.minimum(size, 2 * np.pi - size), atol=1e-7
        )
        true = np.arctan2(truths[:, 1, 0], truths[:, 0, 0])
        is_level = np.hypot(truths[:, 0, 0], truths[:, 1, 0]) > NEAR
        assert inside(true[is_level], found).all()
        if found.most[0] - found.least[0] < 2.0 * np.pi - 0.1:
            offs = (true - found.value + np.pi) % (2 * np.pi) - np.pi
            across = found.most[0] - found.value[0], found.value[0] - found.least[0]
            if max(across) < np.pi:
                assert offs.max() > across[0] - 5e-2 * abs(across[0]) - 1e-6
                assert -offs.min() > across[1] - 5e-2 * abs(across[1]) - 1e-6


def test_a_level_body_has_a_yaw_that_a_tilt_hardly_changes():
    # To second order: tan²(a/2) about a level axis at 45° to the body's.
    found = yaw(np.eye(3)[None], np.array([0.1]), np.zeros(1), np.zeros(1), is_up=True)
    assert found.most[0] == pytest.approx(0.1**2 / 4.0, rel=0.01)
    assert found.least[0] == -found.most[0]


def test_what_is_not_known_has_no_angles():
    thirds = np.array([[np.nan] * 3, [0.0, 0.0, 1.0]])
    attitudes = np.array([np.full((3, 3), np.nan), np.eye(3)])
    some = np.array([np.nan, 0.1])
    for one in (*roll_and_pitch(thirds, some), yaw(attitudes, some, -some, some, is_up=True)):
        assert np.isnan([one.value[0], one.least[0], one.most[0]]).all()
        assert np.isfinite([one.value[1], one.least[1], one.most[1]]).all()
    assert np.isnan(roll_and_pitch(thirds[1:], np.array([np.nan]))[1].value).all()


def test_a_heading_that_may_be_anything_is_the_whole_circle():
    found = yaw(np.eye(3)[None], np.array([0.1]), np.array([-np.pi]), np.array([np.pi]), is_up=False)
    assert (found.least[0], found.most[0]) == (-np.pi, np.pi)


@mp.workdps(40)
def test_rounding_is_covered_up_to_the_vertical():
    """In 40 digits, with bodies and bounds that leave little room before the x axis may be vertical."""
    rng = np.random.default_rng(5)
    for _ in range(400):
        room = 10.0 ** rng.uniform(-5.9, 0.0)
        elevation = rng.choice([rng.uniform(0.0, 0.5 * np.pi - room), 0.5 * np.pi - 2.0 * room])
        elevation = max(elevation, 0.0)
        tilt = max(0.5 * np.pi - room - elevation, 0.0) * rng.choice([1.0, rng.random(), 1e-3])
        cos, sin = np.cos(elevation), np.sin(elevation)
        attitude = np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
        found = yaw(attitude[None], np.array([tilt]), np.zeros(1), np.zeros(1), is_up=True)
        t, reach = mp.mpf(float(sin)) / mp.mpf(float(cos)), mp.tan(mp.mpf(tilt) / 2)
        slope, product = t * (1 - 3 * reach**2), reach**2 * (1 + reach**2 + 2 * t**2)
        x = (mp.sqrt(slope**2 + 8 * product) - slope) / 4
        y = mp.sqrt(max(reach**2 - x**2, 0))
        exact = mp.atan2(2 * y * (t + x), 1 - 2 * t * x - x**2 + y**2)
        assert mp.mpf(float(found.most[0])) >= exact
        assert found.most[0] - float(exact) < 1e-13 / room
        roll, _ = roll_and_pitch(attitude[2:], np.array([tilt]))
        length = mp.sqrt(mp.mpf(float(sin)) ** 2 + mp.mpf(float(cos)) ** 2)
        assert mp.mpf(float(roll.most[0])) >= mp.asin(min(mp.sin(mp.mpf(tilt)) * length / mp.mpf(float(cos)), 1))
