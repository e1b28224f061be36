"""What is of second order and more in a gyro's matrix, of means over windows; theory, section 18.12."""

import numpy as np
import pytest
from elliptude.bounds.carried.frame import CarriedFrame
from elliptude.bounds.carried.one_matrix import OneMatrix
from elliptude.bounds.carried.second_order import SecondOrder, crossed, largest_singular_values
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.stamps import OffsetTurns
from elliptude.bounds.turns import attitudes_from_rates
from elliptude.bounds.window_averages import Piece
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from scipy.spatial.transform import Rotation

STEP, COUNT, ROW = 0.002, 1501, 700
DURATION = 2.0


def scene(seed, speed=3.0):
    """Rates that a gyro shows, and vectors in body axes of about ten, both changing in many ways."""
    draws = np.random.default_rng(seed)
    times = STEP * np.arange(COUNT)

    def waves():
        frequencies, phases = draws.uniform(0.3, 4.0, (3, 3)), draws.uniform(0.0, 2.0 * np.pi, (3, 3))
        return np.sin(times[:, None, None] * frequencies + phases).sum(axis=1)

    rates = waves()
    rates *= speed / np.linalg.norm(rates, axis=1).mean()
    return times, rates, 5.0 * waves() + [0.0, 0.0, 5.0]


def frame_and_piece(times, rates, vectors, gyro):
    frame = CarriedFrame(times, rates, np.zeros(len(times) - 1, dtype=bool), gyro, times[0])
    offsets = OffsetTurns.any_way(np.zeros(len(times)))
    return Piece(frame, np.arange(len(times)), times, vectors, offsets, gyro)


def weights_of(window, *, triangular):
    """Those of each row, by the trapezoidal rule."""
    rows = np.arange(COUNT)
    inside = (rows >= window.start[0]) & (rows <= window.stop[0])
    weights = inside * (1.0 - np.abs(rows - ROW) * STEP / (0.5 * DURATION) if triangular else 1.0)
    weights[[window.start[0], window.stop[0]]] *= 0.5
    return weights / weights.sum()


def error_of_mean(rates, vectors, weights, matrix):
    """The mean of (I - Eᵀ) Ĉ y, exact but for the step: Ĉ by the shown rates, C by the true ones, equal at the row."""

    def frames(shown):
        attitudes = attitudes_from_rates(np.full(COUNT - 1, STEP), shown)
        return attitudes[ROW].T @ attitudes

    calculated, true = frames(rates), frames(rates - rates @ matrix.T)
    return weights @ np.einsum("nij,nj->ni", calculated - true, vectors)


def products_of(piece, gyro, *, triangular):
    """T, M and the mean of the window about the row, in its body axes."""
    matrix = OneMatrix(piece, gyro)
    window = piece.window(np.array([ROW]), DURATION, "middle")
    mean = list(piece.averages(window, triangular=True))[int(triangular)].mean
    effects = matrix._mean_push(window, triangular=triangular) - crossed(matrix._effects[[ROW]], mean)
    products = matrix._second_order.products(window, mean, effects, triangular=triangular)[0]
    to_body = piece.attitudes[ROW].T
    return window, to_body @ products, to_body @ effects[0]


def in_pairs(matrix):
    """The products of two entries of a matrix as T takes them."""
    entries = matrix.ravel()
    first, second = np.triu_indices(9)
    return entries[first] * entries[second] * np.where(first == second, 1.0, np.sqrt(2.0))


@pytest.mark.parametrize("triangular", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_products_against_differences_of_the_exact_error(seed, triangular):
    """Errors of a matrix and of its opposite: what is even in it is of second order, but for its fourth."""
    times, rates, vectors = scene(seed)
    gyro = GyroBounds(0.0, scale_error=0.01)
    piece = frame_and_piece(times, rates, vectors, gyro)
    window, products, effects = products_of(piece, gyro, triangular=triangular)
    weights = weights_of(window, triangular=triangular)
    draws = np.random.default_rng(seed + 10)
    for _ in range(4):
        wrong = 1e-3 * draws.standard_normal((3, 3))
        one, other = (error_of_mean(rates, vectors, weights, sign * wrong) for sign in (1.0, -1.0))
        size = np.linalg.norm(products) * np.linalg.norm(wrong) ** 2
        np.testing.assert_allclose(products @ in_pairs(wrong), 0.5 * (one + other), atol=2e-3 * size)
        np.testing.assert_allclose(effects @ wrong.ravel(), 0.5 * (one - other), atol=2e-4 * np.linalg.norm(one))


@pytest.mark.parametrize("speed", [0.5, 8.0])
def test_no_matrix_does_more_and_some_do_a_quarter_of_it(speed):
    """Where the body turns about nearly one axis, three entries act, whose squares sum up to one and not to three."""
    times, rates, vectors = scene(7, speed)
    gyro = GyroBounds(0.0, scale_error=0.01)
    piece = frame_and_piece(times, rates, vectors, gyro)
    window, products, _ = products_of(piece, gyro, triangular=True)
    matrix = OneMatrix(piece, gyro)
    mean = list(piece.averages(window, triangular=True))[1].mean
    effects = matrix._mean_push(window, triangular=True) - crossed(matrix._effects[[ROW]], mean)
    bound = matrix._second_order.bounds(window, mean, effects, np.zeros((1, 2)), triangular=True)[0]
    largest = 0.0
    for wrong in Rotation.random(40, rng=np.random.default_rng(1)).as_matrix():
        for _ in range(60):  # uphill over matrices of norm one
            value = products @ in_pairs(wrong)
            along = value / np.linalg.norm(value) @ products
            quadratic = np.zeros((9, 9))
            quadratic[np.triu_indices(9)] = along * np.where(np.equal(*np.triu_indices(9)), 1.0, np.sqrt(0.5))
            quadratic += np.triu(quadratic, 1).T
            uphill = quadratic @ wrong.ravel() + np.linalg.norm(quadratic, 2) * wrong.ravel()
            left, _, right = np.linalg.svd(uphill.reshape(3, 3))
            wrong = left @ right
        largest = max(largest, np.linalg.norm(products @ in_pairs(wrong)))
    assert 0.25 * bound <= largest <= bound


@pytest.mark.parametrize("k", [0.003, 0.03, 0.1])
@pytest.mark.parametrize("seed", range(4))
def test_means_with_matrices_at_their_bound(seed, k):
    """The whole error, all orders of it, within the bound of a window; and the bound is less than by lengths alone."""
    times, rates, vectors = scene(seed, 6.0)
    gyro = GyroBounds(0.0, scale_error=k)
    piece = frame_and_piece(times, rates, vectors, gyro)
    matrix = OneMatrix(piece, gyro)
    window = piece.window(np.array([ROW]), DURATION, "middle")
    average = list(piece.averages(window, triangular=True))[1]
    bound = matrix.turns(window, average, np.array([0]), average.turn, triangular=True)[0]
    weights = weights_of(window, triangular=True)
    _, _, effects = products_of(piece, gyro, triangular=True)
    limit = k / (1.0 - k)
    worst = 0.0
    directions = np.random.default_rng(seed).standard_normal((60, 3))
    for direction in directions:
        left, _, right = np.linalg.svd((direction @ effects).reshape(3, 3))
        worst = max(worst, np.linalg.norm(error_of_mean(rates, vectors, weights, limit * left @ right)))
    assert 0.4 * bound <= worst <= bound
    assert bound < average.turn[0]


def test_third_order_of_a_turn_that_keeps_to_one_axis():
    """Rounds about one axis, the vector across it: what exp leaves after its square is q³/6 for small q."""
    times = STEP * np.arange(COUNT)
    rates = np.tile([0.0, 0.0, 5.0], (COUNT, 1))
    rates[:ROW] = 0.0
    k = 0.02
    gyro = GyroBounds(0.0, scale_error=k)
    limit = k / (1.0 - k)
    shown = Rotation.from_rotvec(np.maximum(times - times[ROW], 0.0)[:, None] * [0.0, 0.0, 5.0])
    vectors = shown.inv().apply(np.tile([10.0, 0.0, 0.0], (COUNT, 1)))
    piece = frame_and_piece(times, rates, vectors, gyro)
    window, products, effects = products_of(piece, gyro, triangular=False)
    weights = weights_of(window, triangular=False)
    wrong = limit * np.diag([0.0, 0.0, 1.0])
    left = error_of_mean(rates, vectors, weights, wrong) - effects @ wrong.ravel() - products @ in_pairs(wrong)
    cubes = 10.0 * weights @ (limit * 5.0 * np.maximum(times - times[ROW], 0.0)) ** 3 / 6.0
    assert np.linalg.norm(left) == pytest.approx(cubes, rel=0.01)


def test_a_body_that_turned_far_before_the_window():
    """Running sums of a recording are differences: how far the body turned before is nothing to the window."""
    times, rates, vectors = scene(3)
    spin = np.tile([0.0, 40.0, 0.0], (20_000, 1))
    long_times = STEP * np.arange(COUNT + 20_000)
    gyro = GyroBounds(0.0, scale_error=0.01)
    alone = frame_and_piece(times, rates, vectors, gyro)
    after = frame_and_piece(
        long_times, np.concatenate([spin, rates]), np.concatenate([np.tile(vectors[0], (20_000, 1)), vectors]), gyro
    )

    def bound(piece, row):
        window = piece.window(np.array([row]), DURATION, "middle")
        average = list(piece.averages(window, triangular=True))[1]
        matrix = OneMatrix(piece, gyro)
        return matrix.turns(window, average, np.array([0]), average.turn, triangular=True)[0]

    assert bound(after, 20_000 + ROW) == pytest.approx(bound(alone, ROW), rel=2e-4)


def test_largest_singular_values():
    draws = np.random.default_rng(4)
    matrices = draws.standard_normal((500, 3, 45)) * 10.0 ** draws.uniform(-3.0, 3.0, (500, 3, 1))
    matrices[100:200, 1] = matrices[100:200, 0]
    matrices[200:300, 1:] = 0.0
    right = np.linalg.svd(matrices, compute_uv=False)[:, 0]
    found = largest_singular_values(matrices)
    assert (found >= right).all()
    np.testing.assert_allclose(found[200:300], right[200:300], rtol=1e-5)
    assert (found <= 1.2 * right).all()


def test_sums_do_not_depend_on_how_many_rows_are_worked_on_at_once(monkeypatch):
    times, rates, vectors = scene(5)
    gyro = GyroBounds(0.0, scale_error=0.01)
    piece = frame_and_piece(times, rates, vectors, gyro)
    effects = OneMatrix(piece, gyro)._effects
    whole = SecondOrder(piece.steps, effects, piece.rows, piece.carried)._sums.once
    monkeypatch.setattr("elliptude.bounds.carried.second_order._AT_ONCE", 100)
    np.testing.assert_array_equal(SecondOrder(piece.steps, effects, piece.rows, piece.carried)._sums.once, whole)


def whole_turns(size):
    """Rates of turns there and back between two samples: about four axes across x by whole rounds, with a sign each."""
    across = [np.array([0.0, np.cos(angle), np.sin(angle)]) for angle in np.radians([0.0, 45.0, 90.0, 135.0])]
    x, eighth, whole = np.array([1.0, 0.0, 0.0]), 0.25 * np.pi, 2.0 * np.pi
    legs = [(across[0], whole), (-x, eighth), (-across[1], whole), (-x, eighth)]
    legs += [(across[2], whole), (-x, eighth), (-across[3], whole), (x, 3.0 * eighth)]
    rates = [np.zeros(3)]
    for axis, angle in legs:
        steps = int(np.ceil(2.0 * angle / size))
        profile = np.sin(np.pi * np.arange(1, steps + 1) / steps) ** 2
        rates += list(np.outer(profile * angle / (0.01 * profile.sum()), axis))
    one_way = np.array(rates)
    return np.concatenate([-one_way[:0:-1], one_way])


@pytest.mark.parametrize("limit", [1e-3, 2e-4])
def test_areas_between_samples_count(limit):
    """Three samples, and a body that turns so between them that a matrix does nothing of first order at these."""
    rates = whole_turns(0.01 if limit > 5e-4 else 0.005)
    count, row = len(rates), len(rates) // 2
    times, wrong = 0.01 * np.arange(count), limit * np.diag([0.0, 1.0, -1.0])
    true = attitudes_from_rates(np.full(count - 1, 0.01), rates - rates @ wrong.T)
    ups = np.einsum("nji,j->ni", true[row].T @ true, [0.0, 0.0, 1.0])
    forces = np.full((count, 3), np.nan)
    forces[[0, row, -1]] = 9.81 * ups[[0, row, -1]]
    k = np.linalg.norm(wrong @ np.linalg.inv(np.eye(3) - wrong), 2)
    found = gravity_bounds_over_windows(
        times, forces, rates, [times[-1]], motion=MotionBounds(acceleration=0.0, jerk=0.0),
        gyro=GyroBounds(0.0, scale_error=k), gravity=9.81, at="middle", every=row,
    )  # fmt: skip
    error = np.linalg.norm(np.cross(ups[row], found.directions[row]))
    assert 0.1 * found.angles[row] <= error <= found.angles[row]
