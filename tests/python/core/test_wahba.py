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


def many(count, m, noise, seed=3):
    rng = np.random.default_rng(seed)
    e = rng.standard_normal((count, m, 3)) * rng.uniform(0.1, 10.0, (count, m, 1))
    attitudes = Rotation.random(count, rng=rng).as_matrix()
    b = e @ attitudes + noise * np.linalg.norm(e, axis=2, keepdims=True) * rng.standard_normal(e.shape)
    return e, b, rng.uniform(0.1, 2.0, (count, m))


@pytest.mark.parametrize("method", ["svd", "foam", "davenport"])
def test_any_number_of_threads_gives_the_same_numbers(method):
    e, b, weights = many(2501, 3, 0.05)
    one = elliptude.wahba(e, b, weights, method, threads=1)
    for threads in (2, 3, 7):
        for found, expected in zip(elliptude.wahba(e, b, weights, method, threads=threads), one, strict=True):
            np.testing.assert_array_equal(found, expected)
    for k in (0, 3, 255, 256, 2500):  # alone, and beside other neighbours
        for found, expected in zip(elliptude.wahba(e[k], b[k], weights[k], method), one, strict=True):
            np.testing.assert_array_equal(found, expected[k])
    for found, expected in zip(elliptude.wahba(e[1:], b[1:], weights[1:], method), one, strict=True):
        np.testing.assert_array_equal(found, expected[1:])


@pytest.mark.parametrize(("m", "noise"), [(2, 0.0), (2, 1e-3), (3, 0.0), (3, 0.1), (3, 0.5), (5, 1e-6), (20, 0.3)])
def test_many_problems_by_foam_against_numpy(m, noise):
    e, b, weights = many(2000, m, noise)
    solution = elliptude.wahba(e, b, weights, "foam")
    unit_e, unit_b = (d / np.linalg.norm(d, axis=2, keepdims=True) for d in (e, b))
    u, values, v = np.linalg.svd((weights[:, :, None] * unit_e).swapaxes(1, 2) @ unit_b)
    sign = np.linalg.det(u @ v)
    u[:, :, 2] *= sign[:, None]
    values[:, 2] *= sign
    expected = u @ v
    condition = (values[:, 0] + values[:, 1]) / (values[:, 1] + values[:, 2])
    assert condition.max() > 2.0
    error = np.linalg.norm(solution.attitude - expected, axis=(1, 2))
    assert (error <= 1.5e-14 * condition).all()  # most of it is that of LAPACK
    np.testing.assert_allclose(solution.condition / condition - 1.0, 0.0, atol=1e-7 * condition.max())
    cost = 0.5 * (weights * ((unit_e - unit_b @ expected.swapaxes(1, 2)) ** 2).sum(axis=2)).sum(axis=1)
    total = weights.sum(axis=1)  # each residual is right to rounding of one
    assert (np.abs(solution.cost - cost) <= 4e-15 * np.sqrt(cost * total) + 1e-29 * total * condition**2).all()


def test_shared_references_and_weights():
    e, b, weights = many(1000, 4, 0.01)
    b = e[0] @ Rotation.random(1000, rng=np.random.default_rng(4)).as_matrix() + 0.01 * b
    own = elliptude.wahba(np.broadcast_to(e[0], b.shape), b, np.broadcast_to(weights[0], (1000, 4)), "foam", threads=2)
    shared = elliptude.wahba(e[0], b, weights[0], "foam", threads=2)
    for one, other in zip(own, shared, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("method", ["svd", "foam"])
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda e, b, w: b.__setitem__((700, 1, 2), np.nan), r"body must be finite, but body\[700, 1, 2\] is nan"),
        (lambda e, b, w: e.__setitem__((700, 1, 2), np.inf), r"reference must be finite, but reference\[700, 1, 2\]"),
        (lambda e, b, w: e.__setitem__((700, 2), 0.0), r"reference\[700, 2\] must be a direction, but its length is 0"),
        (lambda e, b, w: w.__setitem__((700, 0), -1.0), r"weights must not be negative, but weights\[700, 0\] is -1"),
        (lambda e, b, w: w.__setitem__(700, 0.0), r"weights\[700\] must not be all zero"),
        (lambda e, b, w: w.__setitem__((700, 1), np.nan), r"weights must be finite, but weights\[700, 1\] is nan"),
        (lambda e, b, w: b.__setitem__(700, b[700, 0]), r"body\[700\] does not determine the attitude"),
    ],
)
def test_the_first_problem_without_a_solution_is_named(method, spoil, words):
    e, b, weights = many(1000, 3, 0.01)
    for k in (900, 950):
        b[k] = b[k, 0]
        e[k] = e[k, 0]
    if "determine" in words:
        e[700] = e[700, 0]
    spoil(e, b, weights)
    for threads in (1, 3):
        with pytest.raises(ValueError, match=words):
            elliptude.wahba(e, b, weights, method, threads=threads)


def test_threads_are_a_number():
    with pytest.raises(ValueError, match="threads must be at least 1, but is 0"):
        elliptude.wahba(np.eye(3), np.eye(3), threads=0)
    with pytest.raises(TypeError, match="threads must be an integer"):
        elliptude.wahba(np.eye(3), np.eye(3), threads=1.5)


def test_a_batch_may_be_empty():
    solution = elliptude.wahba(np.eye(3), np.empty((0, 3, 3)), method="foam", threads=2)
    assert solution.attitude.shape == (0, 3, 3)
