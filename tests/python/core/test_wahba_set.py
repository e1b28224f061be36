"""The exact uncertainty set of Wahba's problem: against the NumPy reference, brute force, adversarial draws; errors."""

import dataclasses

import elliptude
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from inputs import assert_close, direction, generators, rotation
from reference import wahba_set as reference
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

charts = st.sampled_from(["exponential", "gibbs"])


def across(rng, vector):
    axis = np.cross(vector, direction(rng))
    return axis / np.linalg.norm(axis)


def draw(rng, count, bounds, share=1.0):
    """A truth, and directions that are wrong by `share` of their bounds."""
    truth = rotation(rng)
    exact = np.array([direction(rng) for _ in range(count)])
    turns = [Rotation.from_rotvec(share * r * across(rng, b)) for b, r in zip(exact, bounds, strict=True)]
    body = np.array([turn.apply(b) for turn, b in zip(turns, exact, strict=True)])
    return truth, exact @ truth.T, body


def set_unless_half_turns(*arguments, **options):
    """The set, or None where half turns cannot be excluded."""
    try:
        return elliptude.wahba_set(*arguments, **options)
    except elliptude.InconsistentMeasurement:
        raise
    except ValueError as error:
        if "half turns" not in str(error):
            raise
        return None


@given(rng=generators, count=st.integers(2, 8), bound=st.sampled_from([0.01, 0.1, 0.6]), chart=charts)
def test_reference(rng, count, bound, chart):
    bounds = bound * rng.uniform(0.5, 1.5, count)
    _, e, b = draw(rng, count, bounds, 0.9)
    weights = rng.uniform(0.5, 2.0, count)
    attitude, curvature, level = reference.solution(e, b, bounds, weights)
    least = np.linalg.eigvalsh(curvature)[0]
    assume(level < 0.8 * least and least > 0.02 * weights.sum())
    found = elliptude.wahba_set(2.0 * e, 3.0 * b, bounds, weights, chart=chart)
    assert_close(found.attitude, attitude, relative=1e-10)
    assert_close(found.shape, reference.shape(curvature, level, chart), relative=1e-8)
    assert_close(found.margin, level / (weights @ (1.0 - np.cos(bounds))), relative=1e-8, size=1.0)
    assert_close(found.weights, weights)
    assert found.chart == chart


@pytest.mark.parametrize("chart", ["exponential", "gibbs"])
@pytest.mark.parametrize("weights", ["given", "found"])
@pytest.mark.parametrize("bound", [0.05, 0.4, 1.0])
def test_every_attitude_in_all_cones_is_inside(chart, weights, bound):
    """Brute force: attitudes all about the set, down to those on its boundary."""
    rng = np.random.default_rng(3)
    tried = 0
    closest = 0.0
    for _ in range(30):
        count = int(rng.integers(3, 6))
        bounds = bound * rng.uniform(0.5, 1.2, count)
        _, e, b = draw(rng, count, bounds, rng.uniform(0.3, 1.0))
        given_weights = rng.uniform(0.2, 1.0, count) if weights == "given" else None
        found = set_unless_half_turns(e, b, bounds, given_weights, chart=chart)
        if found is None:
            continue
        root = np.linalg.cholesky(found.shape)
        for _ in range(300):
            # Uniform in a ball somewhat larger than the set, in its own coordinates.
            u = 1.2 * rng.uniform() ** (1 / 3) * direction(rng)
            x = root @ u
            length = float(np.linalg.norm(x))
            angle = length if chart == "exponential" else 2.0 * np.arctan(0.5 * length)
            attitude = found.attitude @ Rotation.from_rotvec(angle * x / length).as_matrix()
            if angle < np.pi and reference.in_all_cones(attitude, e, b, bounds):
                tried += 1
                closest = max(closest, float(u @ u))
                assert u @ u <= 1.0
                assert found.contains(attitude)
    assert tried > 300
    # The bound is not idle: some attitudes in all cones come near it.
    assert closest > 0.7


@given(rng=generators, exponent=st.floats(-7.0, 0.0), count=st.integers(2, 6), chart=charts, found=st.booleans())
def test_errors_as_large_as_allowed(rng, exponent, count, chart, found):
    """The truth with every error at its bound, also where directions are the same or nearly so."""
    bounds = np.full(count, 10.0**exponent)
    truth, e, b = draw(rng, count, bounds)
    if rng.uniform() < 0.3:
        e[-1], b[-1] = e[0], b[0]
    weights = None if found else rng.uniform(0.0, 1.0, count)
    result = set_unless_half_turns(e, b, bounds, weights, chart=chart)
    assume(result is not None)
    x = reference.coordinates(result.attitude, truth, chart)
    assert x @ np.linalg.solve(result.shape, x) <= 1.0
    assert result.contains(truth)
    assert result.margin <= 1.0


def test_two_directions_reach_the_boundary():
    """With errors that turn both ways the truth is on the boundary of the set: it cannot be made smaller."""
    rng = np.random.default_rng(5)
    bounds = np.full(2, 0.1)
    for chart in ("exponential", "gibbs"):
        largest = 0.0
        for _ in range(500):
            truth, e, b = draw(rng, 2, bounds)
            found = set_unless_half_turns(e, b, bounds, [1.0, 1.0], chart=chart)
            if found is None:
                continue
            x = reference.coordinates(found.attitude, truth, chart)
            largest = max(largest, float(x @ np.linalg.solve(found.shape, x)))
        assert 0.999 < largest <= 1.0


def worst_excess(e, b, bounds, rng):
    """min over attitudes of max over i of (angle_i - r_i): positive if no attitude is in all cones."""

    def excess(zeta):
        cosines = np.sum((e @ Rotation.from_rotvec(zeta).as_matrix()) * b, axis=1)
        return float(np.max(np.arccos(np.clip(cosines, -1.0, 1.0)) - bounds))

    starts = Rotation.random(200, rng=rng).as_rotvec()
    starts = sorted(starts, key=excess)[:6]
    options = {"maxiter": 600, "xatol": 1e-8, "fatol": 1e-9}
    return min(minimize(excess, start, method="Nelder-Mead", options=options).fun for start in starts)


@pytest.mark.parametrize("weights", [None, "ones"])
def test_contradictions(weights):
    """What is called a contradiction is one, by a search of all attitudes; and most contradictions are found."""
    rng = np.random.default_rng(7)
    called, falsely_called, real = 0, 0, 0
    for _ in range(50):
        count = int(rng.integers(2, 5))
        bounds = rng.uniform(0.02, 0.2, count)
        _, e, b = draw(rng, count, bounds, rng.uniform(0.5, 2.5))
        excess = worst_excess(e, b, bounds, rng)
        real += excess > 1e-6
        try:
            set_unless_half_turns(e, b, bounds, None if weights is None else np.ones(count))
        except elliptude.InconsistentMeasurement as contradiction:
            called += excess > 0.0 and contradiction.margin < 0.0
            falsely_called += not excess > 0.0
    assert falsely_called == 0
    assert real > 12
    assert called > (0.8 if weights is None else 0.5) * real


def test_opposite_measurements_of_one_direction_contradict():
    """Also where L is zero and no attitude fits better than another."""
    e = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    with pytest.raises(elliptude.InconsistentMeasurement):
        elliptude.wahba_set(e, [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], 0.5, [1.0, 1.0])


def test_half_turns():
    """Sets that reach half turns: one direction, collinear ones, bounds too large, weights of zero."""
    e = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for reference_, body, bounds, weights in [
        (e[:1], e[:1], 0.1, None),
        (e[[0, 0]], e[[0, 0]], 0.1, None),
        (e * [[1.0], [0.0]] - e[::-1] * [[0.0], [1.0]], e * [[1.0], [0.0]] - e[::-1] * [[0.0], [1.0]], 0.1, None),
        (e, e, 1.6, None),
        (e, e, 0.1, [1.0, 0.0]),
    ]:
        with pytest.raises(ValueError, match=r"body: half turns are consistent") as caught:
            elliptude.wahba_set(reference_, body, bounds, weights)
        assert not isinstance(caught.value, elliptude.InconsistentMeasurement)
    # For two axes that fit, Davenport's matrix has the eigenvalues 2, 0, 0, -2: half turns if 2 (1 - cos r) >= 2.
    limit = 0.5 * np.pi
    found = elliptude.wahba_set(e, e, limit - 1e-3, [1.0, 1.0])
    assert found.largest_angle() > np.pi - 0.2
    with pytest.raises(ValueError, match="half turns"):
        elliptude.wahba_set(e, e, limit + 1e-3, [1.0, 1.0])


@given(rng=generators, count=st.integers(3, 6), bound=st.sampled_from([0.01, 0.12]), volume=st.booleans())
def test_found_weights(rng, count, bound, volume):
    """Not larger than the first weights' set, and near the best that a search over weights finds."""
    bounds = bound * rng.uniform(0.5, 1.5, count)
    _, e, b = draw(rng, count, bounds, 0.6)
    criterion = "volume" if volume else "trace"

    def size(weights):
        try:
            shape = elliptude.wahba_set(e, b, bounds, weights).shape
        except ValueError:
            return np.inf
        return float(np.log(np.linalg.det(shape)) if volume else 3.0 * np.log(np.trace(shape)))

    first = 1.0 / (1.0 - np.cos(bounds))
    assume(np.isfinite(size(first)))
    found = elliptude.wahba_set(e, b, bounds, criterion=criterion)
    assert_close(np.max(found.weights), 1.0)
    at_found = size(found.weights)
    assert at_found <= size(first) + 1e-12
    best = at_found
    for _ in range(100):
        best = min(best, size(found.weights * np.exp(rng.normal(0.0, rng.uniform(0.01, 2.0), count))))
    assert at_found <= best + 0.02


def test_batches_are_the_loop():
    rng = np.random.default_rng(2)
    bounds = rng.uniform(0.05, 0.1, (5, 4))
    draws = [draw(rng, 4, r, 0.5) for r in bounds]
    e, b = (np.array([d[k] for d in draws]) for k in (1, 2))
    for weights in (None, rng.uniform(0.5, 1.0, (5, 4))):
        batch = elliptude.wahba_set(e, b, bounds, weights, chart="gibbs")
        assert (batch.attitude.shape, batch.shape.shape, batch.margin.shape) == ((5, 3, 3), (5, 3, 3), (5,))
        assert batch.weights.shape == (5, 4)
        assert batch.largest_angle().shape == (5,)
        assert np.all(batch.contains(np.array([d[0] for d in draws])))
        for k in range(5):
            one = elliptude.wahba_set(e[k], b[k], bounds[k], None if weights is None else weights[k], chart="gibbs")
            for field in ("attitude", "shape", "margin", "weights"):
                np.testing.assert_array_equal(getattr(batch, field)[k], getattr(one, field))
            assert batch.largest_angle()[k] == one.largest_angle()
    shared = elliptude.wahba_set(e[0], b[0], [[0.2] * 4, [0.3] * 4])
    np.testing.assert_array_equal(shared.shape[1], elliptude.wahba_set(e[0], b[0], 0.3).shape)
    # One bad item of a batch is named.
    b[3, 0] = -b[3, 0]
    with pytest.raises(elliptude.InconsistentMeasurement, match=r"body\[3\]: no attitude") as caught:
        elliptude.wahba_set(e, b, bounds)
    assert caught.value.margin < 0.0
    b[2, 1:] = b[2, 0]
    e[2, 1:] = e[2, 0]
    with pytest.raises(ValueError, match=r"body\[2\]: half turns"):
        elliptude.wahba_set(e, b, bounds)


def test_result():
    truth = rotation(np.random.default_rng(4))
    found = elliptude.wahba_set(truth.T, np.eye(3), 0.1)
    assert found.contains(Rotation.from_matrix(found.attitude))
    turned = found.attitude @ Rotation.from_rotvec([0.0, 0.5, 0.0]).as_matrix()
    assert not found.contains(turned)
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.shape = np.eye(3)
    gibbs = elliptude.wahba_set(truth.T, np.eye(3), 0.1, chart="gibbs")
    # The largest angle does not depend on the chart.
    assert_close(gibbs.largest_angle(), found.largest_angle(), relative=1e-9)


def test_bad_input():
    e = np.eye(3)
    good = {"reference": e, "body": e, "bounds": 0.1}
    for change, match in [
        ({"bounds": 0.0}, r"bounds must be angles between 0 and π, but bounds is 0"),
        ({"bounds": [0.1, -0.1, 0.1]}, r"bounds\[1\] is -0\.1"),
        ({"bounds": np.pi}, r"bounds is 3\.14"),
        ({"bounds": [0.1, np.nan, 0.1]}, r"bounds must be finite, but bounds\[1\] is nan"),
        ({"bounds": np.nan}, r"bounds must be finite"),
        ({"bounds": [0.1, 0.1]}, r"bounds must have the shape \(\.\.\., 3\)"),
        ({"weights": [1.0, -1.0, 1.0]}, r"weights\[1\] is -1"),
        ({"weights": np.zeros(3)}, "weights must not be all zero"),
        ({"chart": "polar"}, "chart must be 'exponential' or 'gibbs', not 'polar'"),
        ({"criterion": "size"}, "criterion must be 'trace' or 'volume', not 'size'"),
        ({"body": np.zeros((3, 3))}, r"body\[0\] must be a direction"),
        ({"reference": e[:2]}, "reference must have the shape"),
        ({"reference": np.ones((33, 3)), "body": np.ones((33, 3))}, "body has 33 directions; at most 32"),
    ]:
        with pytest.raises(ValueError, match=match):
            elliptude.wahba_set(**{**good, **change})
