"""Wahba's problem: against the NumPy reference and SciPy; batches."""

import elliptude
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from inputs import assert_close, direction, generators, rotation
from reference import wahba as reference
from scipy.spatial.transform import Rotation


def directions(rng, count, noise):
    attitude = rotation(rng)
    body = np.array([direction(rng) for _ in range(count)])
    seen = body @ attitude.T + noise * rng.standard_normal((count, 3))
    return seen / np.linalg.norm(seen, axis=1, keepdims=True), body


@pytest.mark.parametrize("method", ["svd", "foam", "davenport", "qr"])
@given(rng=generators, count=st.integers(2, 8), noise=st.sampled_from([0.0, 1e-6, 0.1]))
def test_methods(method, rng, count, noise):
    e, b = directions(rng, count, noise)
    weights = rng.uniform(0.1, 2.0, count)
    profile = reference.attitude_profile(e, b, weights)
    best = reference.solve_svd(e, b, weights)
    condition = reference.condition(best, e, b, weights)
    assume(0.0 < condition < 100.0)
    if method == "qr":
        # Forming RRᵀ squares the condition of L: keep it moderate.
        assume(np.linalg.det(profile) > 0.0)
        assume(np.linalg.cond(profile) < 20.0)
    # Lengths do not matter.
    solution = elliptude.wahba(3.0 * e, 0.5 * b, weights, method=method)
    if method == "foam":  # where three directions or more leave L regular, and the quartic's root simple by far
        if count > 2 and condition < 10.0 and np.linalg.cond(profile) < 100.0:
            assert_close(solution.attitude, reference.solve_foam(e, b, weights), relative=1e-9)
    else:
        solve = {"svd": reference.solve_svd, "davenport": reference.solve_davenport, "qr": reference.solve_qr}[method]
        assert_close(solution.attitude, solve(e, b, weights))
    assert_close(solution.attitude, best)
    assert_close(solution.cost, reference.cost(best, e, b, weights), size=weights.sum())
    # In closed form, half of the digits where two curvatures are alike.
    assert_close(solution.condition, condition, relative=1e-6 if method == "foam" else 1e-11)
    assert_close(np.linalg.det(solution.attitude), 1.0)


@given(rng=generators, count=st.integers(3, 6))
def test_against_scipy(rng, count):
    e, b = directions(rng, count, 0.01)
    weights = rng.uniform(0.5, 2.0, count)
    solution = elliptude.wahba(e, b, weights)
    assume(solution.condition < 100.0)
    expected, _ = Rotation.align_vectors(e, b, weights)
    assert_close(solution.attitude, expected.as_matrix())


@given(rng=generators)
def test_cross_product(rng):
    e, b = directions(rng, 2, 0.01)
    assume(np.linalg.norm(np.cross(b[0], b[1])) > 0.1)
    found = elliptude.add_cross_product(2.0 * e, 3.0 * b)
    for actual, expected in zip(found, reference.with_cross_product(e, b), strict=True):
        assert_close(actual, expected)
    # What it is for: the paper's formula applies then.
    assert_close(elliptude.wahba(*found, method="qr").attitude, reference.solve_svd(*found, np.ones(3)))


def test_improper_profile_and_two_directions():
    """det L < 0 and det L = 0: svd, foam and davenport give the best rotation, qr refuses."""
    rng = np.random.default_rng(1)
    nearly_coplanar = np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.1], [-1.0, 0.2, 0.1]])
    mirrored = nearly_coplanar * [1.0, 1.0, -1.0]
    cases = [(nearly_coplanar, mirrored), (np.eye(3)[:2], np.eye(3)[:2])]
    for e, b in cases:
        best = elliptude.wahba(e, b)
        assert_close(np.linalg.det(best.attitude), 1.0)
        for method in ("foam", "davenport"):
            assert_close(elliptude.wahba(e, b, method=method).attitude, best.attitude)
        unit, its_reference = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (b, e))
        for _ in range(200):
            near = best.attitude @ elliptude.exp(0.3 * rng.standard_normal(3))
            assert reference.cost(near, its_reference, unit, np.ones(len(e))) >= best.cost - 1e-14
        with pytest.raises(ValueError, match="det L"):
            elliptude.wahba(e, b, method="qr")


def test_batches_are_the_loop():
    rng = np.random.default_rng(2)
    e = np.array([[direction(rng) for _ in range(4)] for _ in range(5)])
    attitudes = elliptude.exp(rng.standard_normal((5, 3)))
    b = e @ attitudes + 0.01 * rng.standard_normal(e.shape)
    weights = rng.uniform(0.5, 1.0, (5, 4))
    batch = elliptude.wahba(e, b, weights)
    assert (batch.attitude.shape, batch.cost.shape, batch.condition.shape) == ((5, 3, 3), (5,), (5,))
    for k in range(5):
        for many, one in zip(batch, elliptude.wahba(e[k], b[k], weights[k]), strict=True):
            np.testing.assert_array_equal(many[k], one)
    # One set of reference directions and of weights for all.
    shared = elliptude.wahba(e[0], b, weights[0])
    np.testing.assert_array_equal(shared.attitude[3], elliptude.wahba(e[0], b[3], weights[0]).attitude)
    completed = elliptude.add_cross_product(e[0, :2], b[:, :2])
    assert completed[0].shape == completed[1].shape == (5, 3, 3)
    np.testing.assert_array_equal(completed[1][2], elliptude.add_cross_product(e[0, :2], b[2, :2])[1])
