"""Attitudes that a set excludes are moved onto its boundary, and no others."""

from dataclasses import replace

import numpy as np
from elliptude.monitoring import Sets, monitor, put_back
from scipy.spatial.transform import Rotation


def sets_of(centers, shapes, claims):
    return Sets(
        np.arange(len(shapes)) * 1.0,
        centers.as_quat(scalar_first=True),
        np.asarray(shapes),
        np.asarray(claims, np.uint8),
    )


def form(center, shape, quaternion):
    """γᵀP⁻¹γ of an attitude about a center."""
    w, *v = (center.inv() * Rotation.from_quat(quaternion, scalar_first=True)).as_quat(scalar_first=True)
    gibbs = 2.0 * np.array(v) / w
    return gibbs @ np.linalg.solve(shape, gibbs)


def test_what_is_outside_is_on_the_boundary_after_it():
    rng = np.random.default_rng(0)
    n = 300
    centers = Rotation.random(n, rng=rng)
    axes = Rotation.random(n, rng=rng).as_matrix()
    shapes = np.einsum("nij,nj,nkj->nik", axes, 10.0 ** rng.uniform(-5, 1, (n, 3)), axes)
    shapes = 0.5 * (shapes + shapes.swapaxes(1, 2))
    turns = rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-4, 0, (n, 1))
    attitudes = (centers * Rotation.from_rotvec(turns)).as_quat(scalar_first=True) * rng.choice([-1.0, 1.0], (n, 1))
    moved_to, moved = put_back(sets_of(centers, shapes, np.zeros(n)), attitudes)
    assert 50 < moved.sum() < 280
    for center, shape, before, after, was_moved in zip(centers, shapes, attitudes, moved_to, moved, strict=True):
        assert was_moved == (form(center, shape, before) > 1.0)
        if not was_moved:
            np.testing.assert_allclose(after, before, atol=1e-15)
            continue
        assert 1.0 - 1e-6 < form(center, shape, after) <= 1.0
        # On the way to the center: along the same axis.
        one, other = (
            (center.inv() * Rotation.from_quat(quaternion, scalar_first=True)).as_rotvec()
            for quaternion in (before, after)
        )
        np.testing.assert_allclose(np.cross(one, other), 0.0, atol=1e-9)
        assert one @ other > 0.0


def test_half_a_turn_away_and_flat_sets():
    center = Rotation.identity(2)
    half_turn = np.tile([0.0, 1.0, 0.0, 0.0], (2, 1))
    flat = np.diag([0.0, 0.04, 0.04])
    found, moved = put_back(sets_of(center, [0.04 * np.eye(3), flat], [0, 0]), half_turn)
    assert moved.all()
    np.testing.assert_allclose(np.abs(found[0]), [np.cos(np.arctan(0.1)), np.sin(np.arctan(0.1)), 0, 0], atol=1e-9)
    np.testing.assert_allclose(np.abs(found[1]), [1.0, 0, 0, 0], atol=1e-9)


def test_only_an_unconditional_set_moves_anything():
    centers = Rotation.identity(4)
    off = np.tile(Rotation.from_rotvec([0.5, 0, 0]).as_quat(scalar_first=True), (4, 1))
    off[3] = np.nan
    sets = sets_of(centers, np.tile(0.01 * np.eye(3), (4, 1, 1)), [0, 1, 2, 0])
    found, moved = put_back(sets, off)
    assert moved.tolist() == [True, False, False, False]
    np.testing.assert_allclose(found[1:3], off[1:3])
    assert np.isnan(found[3]).all()
    # What was moved is not proved wrong.
    assert not monitor(sets, found).alarms.proved.any()
    found, moved = put_back(replace(sets, are_proposals=True), off)
    assert not moved.any()
    np.testing.assert_allclose(found, off, atol=1e-15)
