"""Bounds of tilt and heading about a center, seen from other attitudes: against truths drawn by rotations alone."""

import numpy as np
import pytest
from elliptude.monitoring import Sets, arcs, monitor
from elliptude.monitoring.from_center import from_center
from elliptude.results import AttitudeBounds
from scipy.spatial.transform import Rotation

UP = np.array([0.0, 0.0, 1.0])


def tilt_and_heading(true, estimate):
    """The angle between the ups in body axes, and the turn about up that is left, by rotations in reference axes."""
    first, second = true.inv().apply(UP), estimate.inv().apply(UP)
    tilt = np.arctan2(np.linalg.norm(np.cross(first, second), axis=-1), np.sum(first * second, axis=-1))
    # The shortest turn of the estimate that brings its up to where the truth has it leaves the heading alone.
    difference = true * estimate.inv()
    turned = difference.apply(UP)
    axis = np.cross(turned, UP)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    back = Rotation.from_rotvec(axis / np.maximum(sine, 1e-300) * np.arctan2(sine, turned @ UP[:, None]))
    return tilt, (back * difference).as_rotvec() @ UP


def truths(center, tilt, heading_from, heading_to, count, rng):
    """Attitudes within a tilt and between two headings of a center, most of them at the ends of all three."""
    toward = rng.uniform(0.0, 2.0 * np.pi, count)
    tilts = tilt * np.where(rng.uniform(size=count) < 0.8, 1.0, rng.uniform(size=count))
    share = np.where(rng.uniform(size=count) < 0.8, rng.integers(0, 2, count), rng.uniform(size=count))
    headings = heading_from + share * (heading_to - heading_from)
    axis = np.column_stack([np.cos(toward), np.sin(toward), np.zeros(count)])
    return Rotation.from_rotvec(tilts[:, None] * axis) * Rotation.from_rotvec(headings[:, None] * UP) * center


def as_bounds(*values):
    return AttitudeBounds(*(np.array([value]) for value in values), np.array([np.pi]))


def modulo(angle, arc):
    """The angle, shifted to be as near as can be to the arc's middle."""
    middle = arc.mean()
    return angle - 2.0 * np.pi * np.round((angle - middle) / (2.0 * np.pi))


@pytest.mark.parametrize("seed", range(40))
def test_no_truth_within_the_centers_bounds_is_beyond(seed):
    rng = np.random.default_rng(seed)
    center = Rotation.random(rng=rng)
    largest = [0.02, 0.5, 2.0, 3.1][seed % 4]
    tilt = largest * rng.uniform()
    heading_from, heading_to = np.sort(rng.uniform(-np.pi, np.pi, 2) * [0.01, 0.3, 1.0][seed % 3])
    off = rng.normal(size=3)
    off *= [0.02, 0.5, 3.0][(seed // 2) % 3] * rng.uniform() / np.linalg.norm(off)
    estimate = Rotation.from_rotvec(off) * center
    offset = (center.inv() * estimate).as_quat(scalar_first=True) * rng.choice([-1.0, 1.0])
    found = from_center(offset[None], center.inv().apply(UP)[None], as_bounds(tilt, heading_from, heading_to))
    true = truths(center, tilt, heading_from, heading_to, 20_000, rng)
    tilts, headings = tilt_and_heading(true, estimate)
    # The headings of this test are as good as the cosine of half the tilt is far from 0.
    slack = 1e-13 / np.maximum(np.cos(0.5 * tilts), 1e-6)
    assert (tilts <= found.tilt[0] + 1e-13).all()
    assert (tilts >= found.least_tilt[0] - 1e-13).all()
    headings = modulo(headings, found.headings[0])
    assert (headings >= found.headings[0, 0] - slack).all()
    assert (headings <= found.headings[0, 1] + slack).all()
    # And they are reached.
    assert found.tilt[0] <= tilts.max() + 0.01 * tilt + 1e-9
    if found.headings[0, 1] - found.headings[0, 0] < 6.0:
        reached = headings.max() - headings.min()
        assert found.headings[0, 1] - found.headings[0, 0] <= 1.01 * reached + 0.01


def test_at_the_center_they_are_what_was_given():
    found = from_center(np.array([[1.0, 0, 0, 0]]), UP[None], as_bounds(0.2, -0.1, 0.4))
    np.testing.assert_allclose(found.headings, [[-0.1, 0.4]], atol=1e-12)
    assert found.tilt[0] == pytest.approx(0.2, abs=1e-12)
    # A turn about up adds to the heading exactly, whatever the tilt.
    for angle in (1.0, -3.0):
        offset = Rotation.from_rotvec(angle * UP).as_quat(scalar_first=True)[None]
        found = from_center(offset, UP[None], as_bounds(0.2, -0.1, 0.4))
        middle = modulo(0.15 - angle, np.zeros(2))
        np.testing.assert_allclose(found.headings, [[middle - 0.25, middle + 0.25]], atol=1e-12)


def test_without_a_tilt_bound_below_half_a_turn_any_heading_is_possible():
    offset = Rotation.from_rotvec([0.3, 0.0, 0.0]).as_quat(scalar_first=True)[None]
    found = from_center(offset, UP[None], as_bounds(np.pi, -0.1, 0.1))
    np.testing.assert_array_equal(found.headings, [[-np.pi, np.pi]])
    none = from_center(offset, UP[None], as_bounds(np.nan, np.nan, np.nan))
    assert np.isnan([none.tilt[0], none.least_tilt[0], *none.headings[0]]).all()


def test_common_arcs_lose_no_common_angle():
    rng = np.random.default_rng(1)
    middles, widths = rng.uniform(-4.0, 4.0, (2, 500)), rng.uniform(0.0, 3.3, (2, 500))
    first, second = (arcs.arc(middle, width) for middle, width in zip(middles, widths, strict=True))
    found = arcs.common(first, second)
    assert (np.abs(found.mean(axis=1)) <= np.pi + 1e-12).all()
    shortest = np.minimum(first[:, 1] - first[:, 0], second[:, 1] - second[:, 0])
    assert (found[:, 1] - found[:, 0] <= shortest + 1e-12).all()
    angles = np.linspace(-np.pi, np.pi, 1001)

    def holds(arc, slack):
        return np.abs(modulo_rows(angles, arc)) <= 0.5 * (arc[:, 1] - arc[:, 0])[:, None] + slack

    def modulo_rows(values, arc):
        away = values - arc.mean(axis=1)[:, None]
        return away - 2.0 * np.pi * np.round(away / (2.0 * np.pi))

    both = holds(first, -1e-9) & holds(second, -1e-9)
    assert holds(found, 1e-9)[both].all()
    assert both.any(axis=1).sum() > 100
    largest, least = arcs.largest(found)[:, None], arcs.least(found)[:, None]
    inside = holds(found, -1e-9)
    values = np.broadcast_to(np.abs(angles), inside.shape)
    assert (values <= largest + 1e-9)[inside].all()
    assert (values >= least - 1e-9)[inside].all()


def test_an_arc_without_the_other_is_itself():
    one, none = np.array([[-0.1, 0.2]]), np.full((1, 2), np.nan)
    np.testing.assert_array_equal(arcs.common(one, none), one)
    np.testing.assert_array_equal(arcs.common(none, one), one)
    assert np.isnan(arcs.common(none, none)).all()
    # Nothing in common: the shorter.
    np.testing.assert_array_equal(arcs.common(one, np.array([[1.0, 2.0]])), one)


@pytest.mark.parametrize("vertical", [1.0, -1.0])
def test_monitor_takes_both_the_set_and_the_centers_bounds(vertical):
    """Truths in a ball that also satisfy bounds of their own: none beyond, and sharper than the ball alone."""
    rng = np.random.default_rng(7)
    center = Rotation.random(rng=rng)
    estimate = Rotation.from_rotvec([0.1, 0.05, -0.2]) * center
    radius = 0.6
    shapes = (2.0 * np.tan(0.5 * radius)) ** 2 * np.eye(3)[None]
    heading = (-0.15, 0.1) if vertical > 0.0 else (-0.1, 0.15)
    plain = Sets(np.zeros(1), center.as_quat(scalar_first=True)[None], shapes, np.zeros(1, dtype=np.uint8))
    sets = Sets(
        plain.times, plain.quaternions, shapes, plain.claims, as_bounds(0.08, *heading), np.array([0.0, 0.0, vertical])
    )
    true = truths(center, 0.08, -0.15, 0.1, 50_000, rng)
    true = true[(true * center.inv()).magnitude() <= radius]
    quaternions = estimate.as_quat(scalar_first=True)[None]
    wide, found = monitor(plain, quaternions, up=UP), monitor(sets, quaternions, up=UP)
    tilts, headings = tilt_and_heading(true, estimate)
    errors = np.column_stack([(true * estimate.inv()).magnitude(), tilts, np.abs(headings)])
    assert (errors.max(axis=0) <= found.bounds[0] + 1e-12).all()
    assert (errors.min(axis=0) >= found.least[0] - 1e-12).all()
    assert (headings >= found.headings[0, 0] - 1e-12).all()
    assert (headings <= found.headings[0, 1] + 1e-12).all()
    assert (found.bounds < 0.8 * wide.bounds).all()
    np.testing.assert_allclose(found.bounds[0], errors.max(axis=0), rtol=0.05)


def test_bounds_of_another_vertical_are_refused():
    sets = Sets(
        np.zeros(1),
        np.array([[1.0, 0, 0, 0]]),
        np.eye(3)[None],
        np.zeros(1, dtype=np.uint8),
        as_bounds(0.1, -0.1, 0.1),
        np.array([0.0, 0.6, 0.8]),
    )
    with pytest.raises(ValueError, match=r"up: .* is not the vertical \[0.0, 0.6, 0.8\] that the sets' bounds are of"):
        monitor(sets, np.array([[1.0, 0, 0, 0]]), up=UP)
