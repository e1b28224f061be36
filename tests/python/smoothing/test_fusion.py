"""What two sets have in common: points of both are in the result, it is small, and emptiness is proved."""

import elliptude as el
import numpy as np
import pytest
from elliptude.results import DirectionLog
from elliptude.smoothing.both import common_caps
from elliptude.smoothing.fusion import StateSets, common, log_sizes
from reference import so3
from scipy.spatial.transform import Rotation


def gibbs(before, after):
    return 2.0 * el.cayley_inverse(before.swapaxes(-1, -2) @ after)


def pairs(seed, count, k, *, reach, near):
    """Pairs of sets, each with a common state: the state is at random in both, at times at their edge."""
    draws = np.random.default_rng(seed)
    truth = Rotation.random(count, rng=draws).as_matrix()
    vector = draws.standard_normal((count, k - 3))
    sets = []
    for _ in range(2):
        half = draws.standard_normal((count, k, k)) * 10.0 ** draws.uniform(-near, 0.0, (count, 1, k))
        half *= 10.0 ** draws.uniform(-3.0, 0.0, (count, 1, 1)) * reach
        u = draws.standard_normal((count, k))
        u *= draws.choice([1.0, 0.999999, 0.3], (count, 1)) / np.linalg.norm(u, axis=1, keepdims=True)
        error = np.einsum("nij,nj->ni", half, u)
        # C = Ĉ cay(γ/2): the center from the truth and the error.
        centers = truth @ el.cayley(0.5 * error[:, :3]).swapaxes(1, 2)
        sets.append(StateSets(centers, vector - error[:, 3:], half @ half.swapaxes(1, 2)))
    return sets[0], sets[1], truth, vector


def forms(sets, attitudes, vectors):
    y = np.concatenate([gibbs(sets.attitudes, attitudes), vectors - sets.vectors], axis=1)
    return np.einsum("ni,ni->n", y, np.linalg.solve(sets.shapes, y[:, :, None])[..., 0])


@pytest.mark.parametrize("k", [3, 6])
@pytest.mark.parametrize("reach", [1e-6, 0.01, 0.3, 2.0])
@pytest.mark.parametrize("weighted", [False, True])
def test_a_common_state_is_in_the_common_set(k, reach, weighted):
    one, other, truth, vector = pairs(7, 3000, k, reach=reach, near=2.0)
    weight = np.eye(k) if weighted else None
    found = common(one, other, weight)
    assert found.meet.all()
    known = np.isfinite(found.sets.shapes[:, 0, 0])
    assert known.mean() > (0.9 if reach < 1.0 else 0.3)
    sets = found.sets.take(np.flatnonzero(known))
    of_truth = forms(sets, truth[known], vector[known])
    assert np.max(of_truth) <= 1.0 + 1e-9
    assert np.max(of_truth) > 0.9
    gains = log_sizes(sets.shapes, weight) - log_sizes(one.shapes[known], weight)
    assert np.median(gains) < -0.5


@pytest.mark.parametrize("k", [3, 6])
def test_points_of_both_are_in_the_common_set(k):
    draws = np.random.default_rng(3)
    one, other, _, _ = pairs(5, 200, k, reach=0.5, near=1.0)
    found = common(one, other)
    half = np.linalg.cholesky(one.shapes)
    inside = 0
    for _ in range(300):
        u = draws.standard_normal((200, k))
        u *= draws.uniform(0.2, 1.0, (200, 1)) / np.linalg.norm(u, axis=1, keepdims=True)
        error = np.einsum("nij,nj->ni", half, u)
        attitudes = one.attitudes @ el.cayley(0.5 * error[:, :3])
        vectors = one.vectors + error[:, 3:]
        both = (forms(other, attitudes, vectors) <= 1.0) & np.isfinite(found.sets.shapes[:, 0, 0])
        inside += both.sum()
        rows = np.flatnonzero(both)
        if len(rows):
            assert np.max(forms(found.sets.take(rows), attitudes[rows], vectors[rows])) <= 1.0 + 1e-9
    assert inside > 1000


def test_two_thin_sets_across_one_another():
    """Each is known well about one axis: both together about both, as 1 over √2 of the ellipsoid of a plane says."""
    attitude = np.eye(3)[None]
    shapes = [np.diag([1e-6, 1e-2, 1e-6])[None], np.diag([1e-2, 1e-6, 1e-6])[None]]
    one, other = (StateSets(attitude, np.empty((1, 0)), shape) for shape in shapes)
    widths = np.sqrt(np.diagonal(common(one, other).sets.shapes[0]))
    np.testing.assert_allclose(widths[:2], np.sqrt(2.0) * 1e-3, rtol=0.01)


def test_a_set_and_itself():
    one, _, _, _ = pairs(1, 50, 6, reach=0.2, near=1.0)
    found = common(one, one)
    np.testing.assert_allclose(log_sizes(found.sets.shapes), log_sizes(one.shapes), atol=1e-3)


@pytest.mark.parametrize("k", [3, 6])
def test_sets_apart_are_proved_apart(k):
    one, other, _, _ = pairs(2, 300, k, reach=0.05, near=0.5)
    turned = StateSets(other.attitudes @ so3.exp(np.array([0.0, 1.2, 0.3])), other.vectors, other.shapes)
    found = common(one, turned)
    scales = np.sqrt(np.diagonal(one.shapes, axis1=1, axis2=2))
    fused = np.linalg.cond(one.shapes / (scales[:, :, None] * scales[:, None, :])) < 1e7
    assert fused.mean() > 0.9
    assert not found.meet[fused].any()
    assert np.isnan(found.sets.shapes[fused]).all()


def test_sets_that_only_touch():
    """At the edge rounding decides nothing: no proof, and no smaller set than the common point needs."""
    shape = np.diag([0.01, 0.01, 0.01])[None]
    # Both reach 0.1 in γ about the first axis; the turn between the centers is that of two such errors.
    turn = el.cayley(np.array([0.05, 0.0, 0.0]))
    one = StateSets(np.eye(3)[None], np.empty((1, 0)), shape)
    other = StateSets((turn @ turn)[None], np.empty((1, 0)), shape)
    found = common(one, other)
    assert found.meet.all()
    assert forms(found.sets, turn[None], np.empty((1, 0)))[0] <= 1.0


def test_centers_half_a_turn_apart():
    """Nothing is found about both there, and nothing is proved: sets in this chart end at half turns of their own."""
    one, _, _, _ = pairs(6, 8, 3, reach=1.0, near=0.5)
    turn = so3.exp(np.array([0.0, np.pi, 0.0]))
    other = StateSets(
        np.where(np.arange(8)[:, None, None] < 4, one.attitudes @ turn, one.attitudes), one.vectors, one.shapes
    )
    found = common(one, other)
    assert found.meet.all()
    assert np.isnan(found.sets.shapes[:4]).all()
    assert np.isfinite(found.sets.shapes[4:]).all()


def test_a_point_is_left_as_it_is():
    """A flat first set is not fused; a flat second one is all that both have in common."""
    point, ball = (StateSets(np.eye(3)[None], np.empty((1, 0)), size * np.eye(3)[None]) for size in (0.0, 0.1))
    assert np.isnan(common(point, ball).sets.shapes).all()
    assert np.max(np.abs(common(ball, point).sets.shapes)) < 1e-15


def test_no_set_has_nothing_in_common_with_any():
    one, other, _, _ = pairs(4, 10, 3, reach=0.2, near=1.0)
    other.shapes[3] = np.nan
    one.shapes[5] = np.nan
    found = common(one, other)
    assert found.meet.all()
    assert np.isnan(found.sets.shapes[[3, 5]]).all()
    assert np.isfinite(found.sets.shapes[[0, 1, 2, 4]]).all()
    nothing = StateSets(np.empty((0, 3, 3)), np.empty((0, 0)), np.empty((0, 3, 3)))
    assert len(common(nothing, nothing).meet) == 0


def caps(directions, angles, claims):
    directions = np.array(directions, dtype=float)
    return DirectionLog(
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
        np.array(angles, dtype=float),
        np.array(claims, dtype=np.uint8),
        np.zeros(len(angles), dtype=bool),
    )


def test_common_caps():
    one = caps([[0, 0, 1]] * 5, [0.2] * 5, [0, 0, 1, 0, 1])
    other = caps(
        [[0.2, 0, 1], [0, 1, 1], [0, 1, 1], [0.2, 0, 1], [0.2, 0, 1]], [0.2, 0.1, 0.1, 0.1, 0.1], [0, 1, 1, 0, 0]
    )
    found, apart = common_caps(one, other)
    assert not apart.any()
    # Smaller than both; the stronger; the first of two that are apart; smaller; the stronger.
    assert found.angles[0] < 0.19
    np.testing.assert_array_equal(found.angles[[1, 2, 4]], [0.2, 0.2, 0.1])
    np.testing.assert_array_equal(found.claims, [0, 0, 1, 0, 0])
    draws = np.random.default_rng(0)
    points = draws.standard_normal((20000, 3)) * 0.15 + [0, 0, 1]
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    both = (points @ one.directions[0] >= np.cos(0.2)) & (points @ other.directions[0] >= np.cos(0.2))
    assert both.sum() > 100
    assert np.min(points[both] @ found.directions[0]) >= np.cos(found.angles[0])


def test_caps_apart_prove_a_statement_wrong():
    one, other = caps([[0, 0, 1]] * 2, [0.2] * 2, [0, 0]), caps([[0, 1, 1], [0, 0, 1]], [0.1, 0.1], [0, 0])
    found, apart = common_caps(one, other)
    assert apart.tolist() == [True, False]
    assert found.claims.tolist() == [1, 1]
