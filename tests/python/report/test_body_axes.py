"""Images of attitude sets on the sphere, compared with attitudes drawn from the sets."""

import numpy as np
import pytest
from elliptude.report.axes import body_axes
from scipy.spatial.transform import Rotation

SETS = {
    "small": np.diag([0.02, 0.05, 0.03]) ** 2,
    "long": np.diag([0.05, 1.2, 0.1]) ** 2,
    "tilted": None,
    "round": np.eye(3) * 0.5**2,
}


def shape_of(name):
    if SETS[name] is not None:
        return SETS[name]
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    return turn @ np.diag([0.1, 0.4, 0.9]) ** 2 @ turn.T


def surface(shape, count=20_000):
    u = np.random.default_rng(3).standard_normal((count, 3))
    return (u / np.linalg.norm(u, axis=1, keepdims=True)) @ np.linalg.cholesky(shape).T


@pytest.mark.parametrize("chart", ["exponential", "gibbs"])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("name", SETS)
def test_the_rim_is_that_of_the_directions_of_all_attitudes_in_the_set(name, axis, chart):
    """By support: along every great-circle direction that the image bulges to, none goes farther than the rim."""
    shape, attitude = shape_of(name), Rotation.from_rotvec([0.4, 0.2, -1.1]).as_matrix()
    rim = body_axes.axis_outlines(attitude[None], shape[None], axis, chart=chart, points=2880)[0]
    np.testing.assert_allclose(np.linalg.norm(rim, axis=1), 1.0, atol=1e-12)
    directions = body_axes.turns(surface(shape), chart).apply(np.eye(3)[axis]) @ attitude.T
    for normal in np.random.default_rng(5).standard_normal((50, 3)):
        normal /= np.linalg.norm(normal)
        farthest, drawn = (directions @ normal).max(), (rim @ normal).max()
        if farthest > 0.9999:  # the normal itself is inside
            continue
        assert drawn == pytest.approx(farthest, abs=2e-3)
        assert drawn > farthest - 2e-5


@pytest.mark.parametrize("name", SETS)
def test_in_the_gibbs_chart_the_rim_is_where_lines_touch_the_ellipsoid(name):
    """Turns that take e to d are a line in the Gibbs chart: its least form is 1 at the rim, below 1 in the image."""
    shape, e = shape_of(name), np.array([0.0, 0.0, 1.0])
    patch = body_axes.axis_patches(np.eye(3)[None], shape[None], 2, chart="gibbs", meridians=90, rings=4)[0]

    def least_form(d):
        # Two turns from e to d: the shortest one g, and g after a quarter turn about e, in tan(θ/2) n, times two.
        shortest = np.append(np.cross(e, d), 1.0 + e @ d)
        quarter = Rotation.from_rotvec(0.5 * np.pi * e)
        turn = (Rotation.from_quat(shortest) * quarter).as_quat()
        one, other = 2.0 * shortest[:3] / shortest[3], 2.0 * turn[:3] / turn[3]
        along = other - one
        weighted = np.linalg.solve(shape, along)
        nearest = one - (one @ weighted) / (along @ weighted) * along
        return nearest @ np.linalg.solve(shape, nearest)

    np.testing.assert_allclose([least_form(d) for d in patch[0]], 1.0, rtol=1e-6)
    assert max(least_form(d) for d in patch[1:].reshape(-1, 3)) < 1.0


def test_a_small_round_set_makes_a_circle_of_its_radius():
    attitude = Rotation.from_rotvec([0.1, 0.7, 0.2]).as_matrix()
    for axis in range(3):
        rim = body_axes.axis_outlines(attitude[None], np.eye(3)[None] * 0.1**2, axis)[0]
        # Turns perpendicular to the axis move it farthest.
        np.testing.assert_allclose(np.arccos(rim @ attitude[:, axis]), 0.1, atol=1e-9)


def test_a_turn_about_an_axis_leaves_that_axis_alone():
    """The long semi-axis about the body's y: y hardly moves, x and z sweep along a great circle."""
    shape = np.diag([0.01, 0.6, 0.02]) ** 2
    x, y, z = (body_axes.axis_outlines(np.eye(3)[None], shape[None], axis)[0] for axis in range(3))
    assert np.arccos(y[:, 1]).max() == pytest.approx(0.02, abs=1e-3)
    assert np.arctan2(-x[:, 2], x[:, 0]).max() == pytest.approx(0.6, abs=1e-3)
    assert np.arctan2(z[:, 0], z[:, 2]).max() == pytest.approx(0.6, abs=1e-3)
    assert np.abs(x[:, 1]).max() < 0.025


def test_what_is_not_known_or_has_no_rim_is_not_drawn():
    attitudes, shapes = np.tile(np.eye(3), (4, 1, 1)), np.tile(np.eye(3) * 0.01, (4, 1, 1))
    attitudes[1], shapes[2], shapes[3] = np.nan, np.nan, np.eye(3) * 6.0**2
    patches = body_axes.axis_patches(attitudes, shapes, 0, meridians=12, rings=3)
    assert np.isfinite(patches).all(axis=(1, 2, 3)).tolist() == [True, False, False, False]
    assert np.isnan(body_axes.axis_outlines(attitudes[1:2], shapes[:1], 0)).all()


def test_a_flat_set_is_drawn():
    rim = body_axes.axis_outlines(np.eye(3)[None], np.diag([0.0, 0.04, 0.0])[None], 0)[0]
    assert np.arctan2(-rim[:, 2], rim[:, 0]).max() == pytest.approx(0.2, abs=1e-6)
