"""Ellipsoids and quadrics: the C++ core against the NumPy reference, known answers, sampling."""

import copy
import math
import pickle

import elliptude
import numpy as np
import pytest
from elliptude import Ellipsoid, Quadric
from hypothesis import given, settings
from hypothesis import strategies as st
from inputs import assert_close, dimensions, direction, generators, shape
from reference import ellipsoid as reference

criteria = st.sampled_from(["trace", "weighted", "volume"])


def random_ellipsoid(rng, n):
    return Ellipsoid(rng.standard_normal(n), shape(rng, n))


def random_criterion(rng, n, criterion):
    """The arguments criterion and weight of the functions that make something small."""
    if criterion == "weighted":
        return "trace", shape(rng, n)
    return criterion, None


@given(rng=generators, n=dimensions)
def test_questions_about_one_ellipsoid(rng, n):
    e = random_ellipsoid(rng, n)
    points = e.center + 2.0 * rng.standard_normal((5, n))
    forms = np.array([reference.quadratic_form(point, e.center, e.shape) for point in points])
    # The eigenvalues are from 0.1 to 10: a condition of 100 at most.
    assert_close(e.quadratic_form(points), forms)
    np.testing.assert_array_equal(e.contains(points), forms <= 1.0)
    assert_close(e.support(points), [reference.support(point, e.center, e.shape) for point in points])
    assert_close(e.half_widths(), np.sqrt(np.diag(e.shape)))
    assert_close(e.log_volume(), reference.log_volume(e.shape), size=n)
    axes = e.principal_axes()
    assert np.all(np.diff(axes.lengths) <= 0.0)
    assert_close(axes.directions @ np.diag(axes.lengths**2) @ axes.directions.T, e.shape)
    assert_close(axes.directions.T @ axes.directions, np.eye(n))


@given(rng=generators, n=dimensions, m=dimensions)
def test_images(rng, n, m):
    e = random_ellipsoid(rng, n)
    transform, shift = rng.standard_normal((m, n)), rng.standard_normal(m)
    image = e.affine_image(transform, shift)
    center, image_shape = reference.affine_image(transform, shift, e.center, e.shape)
    # With m > n the image is flat, and the zeros among its eigenvalues are rounding.
    assert_close(image.center, center, size=1.0 + np.abs(transform).sum() * np.abs(e.center).max())
    assert_close(image.shape, image_shape)
    assert e.affine_image(transform) == e.affine_image(transform, np.zeros(m))
    indices = list(rng.permutation(n)[: rng.integers(1, n + 1)])
    selection = np.eye(n)[indices]
    assert e.projection(indices) == e.affine_image(selection)


@given(rng=generators, n=dimensions, count=st.integers(1, 5), criterion=criteria)
def test_minimal_sum(rng, n, count, criterion):
    terms = [random_ellipsoid(rng, n) for _ in range(count)]
    shapes = [term.shape for term in terms]
    criterion, weight = random_criterion(rng, n, criterion)
    total = elliptude.minimal_sum(terms, criterion=criterion, weight=weight)
    assert_close(total.center, sum(term.center for term in terms), size=count)
    if criterion == "trace":
        assert_close(total.shape, reference.sum_minimum_trace(shapes, weight))
    else:
        # Near the fixed point the volume is flat: log det is promised within 1e-6, the shape has half as many digits.
        expected = reference.sum_minimum_volume(shapes)
        least = reference.log_size(expected, "volume")
        assert least - 1e-10 * n <= reference.log_size(total.shape, "volume") <= least + 1e-6
        assert_close(total.shape, expected, relative=1e-2)


@settings(max_examples=25, deadline=None)
@given(rng=generators, n=dimensions, criterion=criteria)
def test_minimal_intersection(rng, n, criterion):
    first = random_ellipsoid(rng, n)
    # From one in the other to hardly touching.
    offset = direction(rng, n) * rng.uniform(0.0, 1.5)
    second = Ellipsoid(first.center + offset, shape(rng, n))
    margin = reference.overlap_margin(first.center, first.shape, second.center, second.shape)
    if margin < 1e-3:
        return
    criterion, weight = random_criterion(rng, n, criterion)
    ellipsoid, share = elliptude.minimal_intersection(first, second, criterion=criterion, weight=weight)
    center, best = reference.intersection(first.center, first.shape, second.center, second.shape, criterion, weight)
    # The size is flat at the minimum: it has all its digits when the multiplier, and with it the set, has half of them.
    assert_close(
        reference.log_size(ellipsoid.shape, criterion, weight), reference.log_size(best, criterion, weight), size=n
    )
    assert_close(ellipsoid.center, center, relative=1e-6, size=1.0)
    assert_close(ellipsoid.shape, best, relative=1e-6)
    # At its own multiplier it has all its digits too. What cancels in the size is made up for by the margin.
    q = share / (1.0 - share) if share < 1.0 else math.inf
    center, member = reference.intersection_member(second.center - first.center, first.shape, second.shape, q)
    assert_close(ellipsoid.center, first.center + center, size=10.0)
    assert_close(ellipsoid.shape, member, relative=1e-12 / margin, size=10.0)


@settings(max_examples=25, deadline=None)
@given(rng=generators, n=dimensions, m=dimensions, criterion=criteria)
def test_minimal_intersection_with_a_quadric(rng, n, m, criterion):
    """A partial measurement y = H x + v with v in E(0, R) is a quadric, unbounded where H has a kernel."""
    m = min(m, n)
    e = random_ellipsoid(rng, n)
    h, r = rng.standard_normal((m, n)), shape(rng, m)
    inside = e.center + 0.5 * np.linalg.cholesky(e.shape) @ direction(rng, n)
    y = h @ inside + 0.5 * np.linalg.cholesky(r) @ direction(rng, m)
    quadric = Quadric.from_ellipsoid(Ellipsoid(y, r)).pullback(h)
    criterion, weight = random_criterion(rng, n, criterion)
    ellipsoid, share = elliptude.minimal_intersection(e, quadric, criterion=criterion, weight=weight)
    center, best = reference.fuse_measurement(e.center, e.shape, y, h, r, criterion, weight)
    # As above: the size has all its digits, the set half of them. The quadric's own constants cancel by up to 1e3.
    log_size = reference.log_size(best, criterion, weight)
    assert_close(reference.log_size(ellipsoid.shape, criterion, weight), log_size, relative=1e-11, size=n)
    assert_close(ellipsoid.center, center, relative=1e-6, size=1.0)
    assert_close(ellipsoid.shape, best, relative=1e-6)
    assert 0.0 <= share <= 1.0


@pytest.mark.parametrize("criterion", ["trace", "volume"])
def test_quadrics_with_a_kernel_are_not_taken_for_empty(criterion):
    """The kernel of A is known to rounding only, where no proof of emptiness must be looked for."""
    for seed in range(500):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 7))
        m = int(rng.integers(1, n))
        e = random_ellipsoid(rng, n)
        h, r = rng.standard_normal((m, n)), shape(rng, m)
        inside = e.center + 0.5 * np.linalg.cholesky(e.shape) @ direction(rng, n)
        y = h @ inside + 0.5 * np.linalg.cholesky(r) @ direction(rng, m)
        quadric = Quadric.from_ellipsoid(Ellipsoid(y, r)).pullback(h)
        bound = elliptude.minimal_intersection(e, quadric, criterion=criterion).ellipsoid
        assert bound.contains(inside)


@given(rng=generators, n=dimensions, distance=st.floats(0.0, 8.0))
def test_overlap_margin(rng, n, distance):
    first = random_ellipsoid(rng, n)
    second = Ellipsoid(first.center + distance * direction(rng, n), shape(rng, n))
    expected = reference.overlap_margin(first.center, first.shape, second.center, second.shape)
    assert_close(elliptude.overlap_margin(first, second), expected, size=1.0 + abs(1.0 - expected))
    assert_close(elliptude.overlap_margin(second, first), expected, size=1.0 + abs(1.0 - expected))
    if expected < -1e-9:
        with pytest.raises(elliptude.InconsistentMeasurement) as caught:
            elliptude.minimal_intersection(first, second)
        assert_close(caught.value.margin, expected, size=1.0 + abs(1.0 - expected))


@given(rng=generators, n=dimensions, m=dimensions)
def test_quadrics(rng, n, m):
    a, g, c = rng.standard_normal((n, n)), rng.standard_normal(n), rng.standard_normal()
    a = a + a.T
    quadric = Quadric(a, g, c)
    points = rng.standard_normal((6, n))
    slack = np.array([c - y @ a @ y - 2.0 * g @ y for y in points])
    assert_close(quadric.slack(points), slack, size=10.0 * n**2)
    np.testing.assert_array_equal(quadric.contains(points), slack >= 0.0)

    transform, shift = rng.standard_normal((n, m)), rng.standard_normal(n)
    seen = quadric.pullback(transform, shift)
    there = rng.standard_normal((6, m))
    assert_close(seen.slack(there), quadric.slack(there @ transform.T + shift), size=100.0 * n**2)


@given(rng=generators, n=dimensions)
def test_ellipsoid_as_quadric_and_back(rng, n):
    e = random_ellipsoid(rng, n)
    quadric = Quadric.from_ellipsoid(e)
    # c = 1 - x'P^-1 x holds numbers of up to 1e2 before they cancel.
    center, its_shape = reference.combine_quadrics([quadric.a], [quadric.g], [quadric.c], [1.0])
    back = quadric.to_ellipsoid()
    assert_close(back.center, center, relative=1e-11, size=1.0)
    assert_close(back.shape, its_shape, relative=1e-11)
    assert_close(back.center, e.center, relative=1e-11, size=1.0)
    assert_close(back.shape, e.shape, relative=1e-10)
    points = e.center + rng.standard_normal((4, n))
    assert_close(1.0 - quadric.slack(points), e.quadratic_form(points), size=1e3)


@given(rng=generators, n=dimensions, middle=st.floats(-2.0, 2.0), half_width=st.floats(0.0, 2.0))
def test_slab(rng, n, middle, half_width):
    normal = direction(rng, n)
    slab = Quadric.slab(normal, middle, half_width)
    points = rng.standard_normal((20, n))
    expected = half_width**2 - (points @ normal - middle) ** 2
    assert_close(slab.slack(points), expected, size=100.0)


def test_known_answers():
    unit = Ellipsoid(np.zeros(3), np.eye(3))
    near, far = Ellipsoid([1.0, 0.0, 0.0], np.eye(3)), Ellipsoid([2.2, 0.0, 0.0], np.eye(3))
    ellipsoid, share = elliptude.minimal_intersection(unit, near)
    assert_close(ellipsoid.center, [0.5, 0.0, 0.0])
    assert_close(ellipsoid.shape, 0.75 * np.eye(3))
    assert_close(share, 0.5)
    assert_close(elliptude.overlap_margin(unit, near), 0.75)
    assert_close(elliptude.overlap_margin(unit, far), -0.21)

    def diagonal(*entries):
        return Ellipsoid(np.zeros(len(entries)), np.diag(entries))

    assert_close(elliptude.minimal_intersection(diagonal(4, 1), diagonal(1, 4)).ellipsoid.shape, 1.6 * np.eye(2))
    by_trace = elliptude.minimal_intersection(diagonal(4, 1), diagonal(1, 9)).ellipsoid.shape
    assert_close(np.trace(by_trace), 3.36536439505, relative=1e-11)
    assert_close(np.diag(by_trace), [1.75411076, 1.61125363], relative=1e-8)
    by_volume = elliptude.minimal_intersection(diagonal(4, 1), diagonal(1, 9), criterion="volume").ellipsoid.shape
    assert_close(np.linalg.slogdet(by_volume)[1], 1.037171007, relative=1e-9)
    total = elliptude.minimal_sum([diagonal(4, 1), diagonal(1, 9)])
    assert_close(np.trace(total.shape), (math.sqrt(5.0) + math.sqrt(10.0)) ** 2)

    disc = Ellipsoid([0.0, 0.0, 0.2], np.diag([4.0, 4.0, 0.0]))
    for sets in ((unit, disc), (disc, unit)):
        flat = elliptude.minimal_intersection(*sets).ellipsoid
        assert_close(flat.shape, np.diag([0.96, 0.96, 0.0]))
        assert_close(flat.center, [0.0, 0.0, 0.2])


@pytest.mark.parametrize("n", range(1, 7))
def test_uniform_inside(n):
    """An affine map to the unit ball must give uniform directions, and radii with rⁿ uniform."""
    rng = np.random.default_rng(10 + n)
    e = random_ellipsoid(rng, n)
    points = e.sample(20_000, rng)
    assert points.shape == (20_000, n)
    assert np.all(e.quadratic_form(points) <= 1.0 + 1e-12)
    ball = np.linalg.solve(np.linalg.cholesky(e.shape), (points - e.center).T).T
    fill = np.sort(np.linalg.norm(ball, axis=1) ** n)
    # Kolmogorov and Smirnov: 1.95 is exceeded by chance once in a thousand, and the seed is fixed.
    assert np.max(np.abs(fill - np.arange(20_000) / 20_000)) < 1.95 / math.sqrt(20_000)
    # The second moment of a uniform unit ball is I/(n + 2).
    assert np.max(np.abs(ball.T @ ball / 20_000 - np.eye(n) / (n + 2))) < 0.01


@pytest.mark.parametrize("n", range(1, 7))
def test_uniform_on_the_surface(n):
    """Against the area's own moments, by weighting points of the sphere with what the map stretches it by."""
    rng = np.random.default_rng(20 + n)
    e = Ellipsoid(rng.standard_normal(n), shape(rng, n, 0.01, 4.0))
    points = e.sample(40_000, rng, surface=True)
    np.testing.assert_allclose(e.quadratic_form(points), 1.0, rtol=1e-10)
    axes = e.principal_axes()
    sphere = rng.standard_normal((200_000, n))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    weights = np.linalg.norm(sphere / axes.lengths, axis=1)
    expected = np.average(sphere**2, axis=0, weights=weights)
    found = np.mean(((points - e.center) @ axes.directions / axes.lengths) ** 2, axis=0)
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_circumference_of_an_ellipse():
    """Uniform by arc length: equal shares of points between equal steps along the ellipse."""
    e = Ellipsoid([0.0, 0.0], np.diag([25.0, 1.0]))
    points = e.sample(40_000, 3, surface=True)
    angles = np.linspace(0.0, 2.0 * np.pi, 100_001)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(5.0 * np.cos(angles)), np.diff(np.sin(angles))))])
    at = np.interp(np.arctan2(points[:, 1], points[:, 0] / 5.0) % (2.0 * np.pi), angles, lengths) / lengths[-1]
    assert np.max(np.abs(np.sort(at) - np.arange(40_000) / 40_000)) < 1.95 / math.sqrt(40_000)


def test_sampling_flat_ellipsoids():
    normal = np.array([1.0, 2.0, -2.0]) / 3.0
    plane = np.eye(3) - np.outer(normal, normal)
    # The same disc in units that differ by a million: what is flat does not depend on them.
    for units in (np.eye(3), np.diag([1.0, 1e6, 1e-6])):
        disc = Ellipsoid(np.zeros(3), units @ plane @ units)
        points = disc.sample(20_000, 4) @ np.linalg.inv(units)
        assert np.max(np.abs(points @ normal)) < 1e-7
        radii = np.sort(np.linalg.norm(points, axis=1) ** 2)
        assert np.max(np.abs(radii - np.arange(20_000) / 20_000)) < 1.95 / math.sqrt(20_000)
    point = Ellipsoid([1.0, 2.0], np.zeros((2, 2)))
    np.testing.assert_array_equal(point.sample(3, 0), [[1.0, 2.0]] * 3)
    with pytest.raises(ValueError, match="shortest semi-axis is 0"):
        point.sample(3, 0, surface=True)


def test_sampling_takes_seeds_and_generators():
    e = Ellipsoid(np.zeros(2), np.eye(2))
    np.testing.assert_array_equal(e.sample(5, 7), e.sample(5, np.random.default_rng(7)))
    rng = np.random.default_rng(7)
    assert not np.array_equal(e.sample(5, rng), e.sample(5, rng))
    assert e.sample(5).shape == (5, 2)
    assert e.sample(0, 1).shape == e.sample(0, 1, surface=True).shape == (0, 2)


def test_semidefinite_shapes_are_taken():
    """Rank-deficient shapes as they come out of products, with the eigenvalues that rounding leaves."""
    rng = np.random.default_rng(5)
    for n in range(2, 7):
        for rank in range(1, n):
            for _ in range(50):
                factor = rng.standard_normal((n, rank))
                e = Ellipsoid(np.zeros(n), factor @ factor.T)
                unit = direction(rng, rank)
                assert e.quadratic_form(0.999 * factor @ unit) <= 1.0


def test_batches():
    e = random_ellipsoid(np.random.default_rng(6), 3)
    points = np.random.default_rng(7).standard_normal((2, 4, 3))
    for question in (e.contains, e.quadratic_form, e.support, Quadric.from_ellipsoid(e).slack):
        answers = question(points)
        assert answers.shape == (2, 4)
        for index in np.ndindex(2, 4):
            assert answers[index] == question(points[index])
    assert isinstance(e.contains(points[0, 0]), np.bool_)
    assert isinstance(e.support(points[0, 0]), np.float64)


@pytest.mark.parametrize(
    "thing",
    [Ellipsoid([1.0, 2.0], [[2.0, 1.0], [1.0, 3.0]]), Quadric([[1.0, 0.0], [0.0, -1.0]], [0.1, 0.2], 0.3)],
    ids=["ellipsoid", "quadric"],
)
def test_values(thing):
    """Equality, representation, pickle, copy; nothing can be changed."""
    assert pickle.loads(pickle.dumps(thing)) == thing
    assert copy.copy(thing) == thing
    assert copy.deepcopy(thing) == thing
    assert eval(repr(thing), {"Ellipsoid": Ellipsoid, "Quadric": Quadric}) == thing
    assert thing != "something else"
    assert thing.dimension == 2
    first = "center" if isinstance(thing, Ellipsoid) else "g"
    assert thing != type(thing)(*([[0.0, 0.0], np.eye(2)] if first == "center" else [np.eye(2), [0.0, 0.0], 1.0]))
    with pytest.raises(ValueError, match="read-only"):
        getattr(thing, first)[0] = 5.0
    with pytest.raises(AttributeError):
        setattr(thing, first, [0.0, 0.0])
    with pytest.raises(TypeError, match="unhashable"):
        hash(thing)


@pytest.mark.parametrize("chart", ["exponential", "gibbs"])
def test_sets_of_states_are_values(chart):
    attitude = elliptude.exp([0.3, -0.2, 0.5])
    thing = elliptude.StateEllipsoid(attitude, [0.1, 0.2, 0.3], 0.01 * np.eye(6), chart)
    assert pickle.loads(pickle.dumps(thing)) == thing
    assert copy.deepcopy(thing) == thing
    assert elliptude.StateEllipsoid.from_dict(thing.to_dict()) == thing
    other = "gibbs" if chart == "exponential" else "exponential"
    for field in [{"attitude": np.eye(3)}, {"vector": [0.1, 0.2, 0.4]}, {"shape": np.eye(6)}, {"chart": other}]:
        assert elliptude.StateEllipsoid(**(thing.to_dict() | field)) != thing
    assert thing != "something else"
    with pytest.raises(TypeError, match="unhashable"):
        hash(thing)


def test_results_are_named():
    e = Ellipsoid([0.0, 0.0], np.diag([4.0, 9.0]))
    lengths, directions = e.principal_axes()
    np.testing.assert_allclose(lengths, [3.0, 2.0])
    np.testing.assert_allclose(np.abs(directions), [[0.0, 1.0], [1.0, 0.0]])
    intersection = elliptude.minimal_intersection(e, e)
    assert intersection.ellipsoid == e
    assert pickle.loads(pickle.dumps(intersection)) == intersection
