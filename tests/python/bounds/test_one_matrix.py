"""Means over windows with a gyro whose scale error is one matrix; theory, section 18.12."""

import numpy as np
import pytest
from elliptude.bounds.carried.frame import CarriedFrame
from elliptude.bounds.carried.one_matrix import OneMatrix, nuclear_norms
from elliptude.bounds.carried.second_order import SecondOrder
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.matrix_effects import scale_effects
from elliptude.bounds.stamps import OffsetTurns
from elliptude.bounds.window_averages import Piece
from elliptude.bounds.windows import MotionBounds, field_bounds_over_windows, gravity_bounds_over_windows
from inputs import angle_between
from scipy.spatial.transform import Rotation

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])
STILL = MotionBounds(acceleration=0.0)
STEP = 0.005


def carried(turns):
    """Attitudes from rotation vectors of steps, one after another."""
    attitudes = [Rotation.identity()]
    for turn in Rotation.from_rotvec(turns):
        attitudes.append(attitudes[-1] * turn)
    return Rotation.concatenate(attitudes)


def shown_rates(count, speed, seed):
    """What a gyro shows in a hand that turns in changing ways."""
    draws = np.random.default_rng(seed)
    times = STEP * np.arange(count)
    frequencies, phases = draws.uniform(0.3, 4.0, (3, 3)), draws.uniform(0.0, 2.0 * np.pi, (3, 3))
    rates = np.sin(times[:, None, None] * frequencies + phases).sum(axis=1)
    return times, rates * speed / np.linalg.norm(rates, axis=1).mean()


def true_attitudes(times, rates, matrix, added=0.0):
    """Attitudes if the gyro shows (I + K) ω + e, K' = K (I + K)⁻¹: the mean of ends, in each step."""
    means = 0.5 * (rates[1:] + rates[:-1])
    return carried(np.diff(times)[:, None] * ((means - added) @ (np.eye(3) - matrix).T))


def parts(times, rates, gyro, vectors):
    frame = CarriedFrame(times, rates, np.zeros(len(times) - 1, dtype=bool), gyro, times[0])
    piece = Piece(frame, np.arange(len(times)), times, vectors, OffsetTurns.any_way(np.zeros(len(times))), gyro)
    return piece, OneMatrix(piece, gyro)


def of_matrix(k):
    """The largest norm of K' that follows from a norm k of K."""
    return k / (1.0 - k)


def worst_matrix(piece, matrix, window, row, k):
    """Of all K of norm k nearly the one that moves the mean most: the polar factor of the worst direction's matrix."""
    effects = matrix._mean_push(window, triangular=True)[0]
    average = list(piece.averages(window, triangular=True))[1]
    effects = effects - np.cross(matrix._effects[row].T, average.mean[0]).T
    directions = np.random.default_rng(0).standard_normal((4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    combined = np.einsum("ni,ijk->njk", directions, effects.reshape(3, 3, 3))
    left, values, right = np.linalg.svd(combined[np.argmax(np.linalg.svd(combined, compute_uv=False).sum(axis=1))])
    assert values[0] > 0.0
    polar = -k * left @ right
    return polar @ np.linalg.inv(np.eye(3) + polar)


# --- the norm ---------------------------------------------------------------------------------------------------------


def test_sums_of_singular_values():
    draws = np.random.default_rng(3)
    matrices = draws.standard_normal((3, 3, 2000)) * 10.0 ** draws.uniform(-8.0, 8.0, 2000)
    matrices[:, 1, 500:1000] = 2.0 * matrices[:, 0, 500:1000]
    matrices[:, :, 1000:1500] = matrices[:, None, 0, 1000:1500] * matrices[None, 1, :, 1000:1500]
    matrices[:, :, 1500] = 0.0
    right = np.linalg.svd(np.moveaxis(matrices, -1, 0), compute_uv=False).sum(axis=1)
    found = nuclear_norms(matrices)
    assert (found >= right).all()
    np.testing.assert_allclose(found, right, rtol=0.02)
    np.testing.assert_allclose(found[500:1000], right[500:1000], rtol=1e-4)


# --- the bound --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_the_worst_matrix_comes_to_the_edge(seed):
    """Nothing is off but the gyro's scale: the truth is within the bound, and not far within."""
    k, duration, row = 2e-3, 4.0, 500
    times, rates = shown_rates(1001, 1.0, seed)
    gyro = GyroBounds(0.0, scale_error=k)
    still = carried(np.diff(times)[:, None] * 0.5 * (rates[1:] + rates[:-1]))
    piece, matrix = parts(times, rates, gyro, still.inv().apply(G * UP))
    wrong = worst_matrix(piece, matrix, piece.window(np.array([row]), duration, "middle"), row, k)
    true = true_attitudes(times, rates, wrong)
    bounds = gravity_bounds_over_windows(
        times, true.inv().apply(G * UP), rates, [duration], motion=MotionBounds(position=0.0), gyro=gyro, gravity=G,
        at="middle",
    )  # fmt: skip
    error = angle_between(bounds.directions[row], true[row].inv().apply(UP))
    assert error <= bounds.angles[row]
    assert error >= 0.9 * bounds.angles[row]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("speed", [0.5, 8.0])
def test_windows_hold_with_a_matrix_noise_and_bias_at_their_bounds(seed, speed):
    """Errors of first order and of second, where the turn by the scale error is large."""
    draws = np.random.default_rng(seed)
    times, rates = shown_rates(1601, speed, seed + 20)
    k, noise, bias = 0.03, 0.02, 0.005
    gyro = GyroBounds(noise, bias, scale_error=k)
    true_matrix = -k * Rotation.random(rng=draws).as_matrix() * draws.choice([-1.0, 1.0])
    matrix = true_matrix @ np.linalg.inv(np.eye(3) + true_matrix)
    axes = draws.standard_normal((2, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    # The bias may change with the pose, and noise in any way: here they change their signs at the row in the middle.
    sign = np.where(np.arange(1600) < 800, -1.0, 1.0)[:, None]
    true = true_attitudes(times, rates, matrix, sign * (noise * axes[0] + bias * axes[1]))
    forces = true.inv().apply(G * UP)
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [0.5, 2.0, 6.0], motion=MotionBounds(position=0.05), gyro=gyro, gravity=G, at="middle"
    )
    field = field_bounds_over_windows(times, forces, rates, [0.5], disturbance=0.0, gyro=gyro, strength=G, at="middle")
    for found in (bounds, field):
        known = np.isfinite(found.angles)
        error = angle_between(found.directions, true.inv().apply(UP))
        assert not found.contradicted.any()
        assert known[1:-1].all()
        assert (error <= found.angles)[known].all()


@pytest.mark.parametrize("error", ["noise", "bias"])
def test_an_error_that_turns_round_at_the_row_comes_to_the_edge(error):
    """A body at rest: before the row the gyro errs in one way, after it in the other, and the frame is off in one."""
    times, e = STEP * np.arange(801), 0.01
    sign = np.where(np.arange(801) < 400, -1.0, 1.0)
    sign[400] = 0.0
    bounds = gravity_bounds_over_windows(
        times, np.tile(G * UP, (801, 1)), e * sign[:, None] * [1.0, 0.0, 0.0], [4.0], motion=MotionBounds(position=0.0),
        gyro=GyroBounds(**({"noise": 0.0, "scale_error": 1e-6} | {error: e})), gravity=G, at="middle",
    )  # fmt: skip
    off = angle_between(bounds.directions[400], UP)
    assert off == pytest.approx(e * 2.0 / 3.0, rel=0.01)
    assert 0.97 * bounds.angles[400] <= off <= bounds.angles[400]


def test_an_offset_of_the_stamps_comes_to_the_edge():
    times, late = STEP * np.arange(801), 0.005
    rates = np.tile([1.0, 0.0, 0.0], (801, 1))
    forces = Rotation.from_rotvec((times - late)[:, None] * rates).inv().apply(G * UP)
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [2.0], motion=MotionBounds(position=0.0), gyro=GyroBounds(0.0, scale_error=1e-6),
        gravity=G, time_offset=late, at="middle",
    )  # fmt: skip
    off = angle_between(bounds.directions[400], Rotation.from_rotvec(times[400] * rates[400]).inv().apply(UP))
    assert 0.97 * bounds.angles[400] <= off <= bounds.angles[400]


def test_what_is_left_where_the_first_order_cancels():
    """Many rounds about one axis, and vectors that the gyro's frame shows at rest: a scale error is of second order."""
    k, speed, duration, row = 0.03, 15.0, 4.0, 500
    times = STEP * np.arange(1001)
    rates = np.tile([speed, 0.0, 0.0], (1001, 1))
    vector = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
    shown = Rotation.from_rotvec((times - times[row])[:, None] * rates)
    vectors = shown.inv().apply(vector)
    piece, matrix = parts(times, rates, GyroBounds(0.0, scale_error=k), vectors)
    window = piece.window(np.array([row]), duration, "middle")
    average = list(piece.averages(window, triangular=True))[1]
    bound = matrix.turns(window, average, np.array([0]), average.turn, triangular=True)[0]
    true = Rotation.from_rotvec((1.0 - of_matrix(k)) * (times - times[row])[:, None] * rates)
    weights = np.maximum(1.0 - np.abs(times - times[row]) / (0.5 * duration), 0.0)
    off = weights / weights.sum() @ (shown.apply(vectors) - true.apply(vectors))
    assert np.linalg.norm(off) <= bound
    # Less than by the lengths of turns all the same.
    assert bound < average.turn[0]


def test_before_and_after_the_row_undo_one_another():
    """A turn about one level axis: the frame is off in opposite ways, and second order is all that is left."""
    times = STEP * np.arange(801)
    rates = np.tile([0.4, 0.0, 0.0], (801, 1))
    forces = carried(STEP * rates[1:]).inv().apply(G * UP)

    def bound(k, at):
        found = gravity_bounds_over_windows(
            times, forces, rates, [4.0], motion=STILL, gyro=GyroBounds(0.0, scale_error=k), gravity=G, at=at
        )
        return found.angles[400 if at == "middle" else -1]

    # Up turns by 0.8 rad to either side. What the scale error may do is not all odd, but most of it is.
    by_length = 0.01 / 0.99 * 0.4 * 2.0 / 3.0
    assert bound(0.01, "middle") < 0.6 * by_length
    # Linear in the scale error; at the end of a window nothing undoes anything.
    assert bound(0.001, "middle") == pytest.approx(0.1 * bound(0.01, "middle"), rel=0.05)
    assert bound(0.01, "end") > 1.5 * by_length


# --- its parts against sums one by one --------------------------------------------------------------------------------


@pytest.mark.parametrize("duration", [0.6, 3.0])
@pytest.mark.parametrize("triangular", [True, False])
def test_effects_against_direct_sums(duration, triangular):
    draws = np.random.default_rng(5)
    times = np.cumsum(draws.uniform(0.004, 0.012, 700))
    rates, vectors = draws.standard_normal((2, 700, 3))
    piece, matrix = parts(times, rates, GyroBounds(0.01, scale_error=0.02), vectors)
    row = 330
    window = piece.window(np.array([row]), duration, "middle")
    average = list(piece.averages(window, triangular=True))[int(triangular)]
    attitudes = carried(0.5 * np.diff(times)[:, None] * (rates[1:] + rates[:-1])).as_matrix()
    rows = np.arange(window.start[0], window.stop[0] + 1)
    weights = np.zeros(len(times))
    for one in (slice(rows[0], row + 1), slice(row, rows[-1] + 1)):
        side = np.zeros(len(times))
        side[one] = 1.0 if not triangular else 1.0 - np.abs(times[one] - times[row]) / np.ptp(times[one])
        weights[one] += side[one] * np.gradient(times)[one] * np.where(np.arange(len(times))[one] == row, 0.5, 1.0)
    weights[[rows[0], rows[-1]]] *= 0.0 if triangular else 0.5
    weights /= weights.sum()
    wrong = 0.01 * draws.standard_normal((3, 3))
    steps = np.diff(times)[:, None] * 0.5 * (rates[1:] + rates[:-1]) @ wrong.T
    moved = np.concatenate(
        [np.zeros((1, 3)), np.cumsum(np.einsum("nij,nj->ni", 0.5 * (attitudes[1:] + attitudes[:-1]), steps), axis=0)]
    )
    pushed = weights @ np.cross(moved - moved[row], np.einsum("nij,nj->ni", attitudes, vectors))
    effects = matrix._mean_push(window, triangular=triangular)[0]
    effects = effects - np.cross(matrix._effects[row].T, average.mean[0]).T
    np.testing.assert_allclose(effects @ wrong.ravel(), pushed, rtol=0.05, atol=1e-4 * np.abs(pushed).max())


@pytest.mark.parametrize("triangular", [True, False])
def test_powers_of_a_turn_about_one_axis_in_closed_form(triangular):
    """q grows with the time to the row; what the frame is off, too, where the axis moves evenly."""
    k, row = 0.02, 900
    times = STEP * np.arange(1801)
    phases = 2.0 * times
    rates = 3.0 * np.column_stack([np.cos(phases), np.sin(phases), np.zeros_like(times)])
    piece, matrix = parts(times, rates, GyroBounds(0.0, scale_error=k), np.tile(G * UP, (1801, 1)))
    window = piece.window(np.array([row]), 4.0, "middle")
    average = list(piece.averages(window, triangular=True))[int(triangular)]
    rising, falling = matrix._sums.sides(window, triangular=triangular)
    square, cube, apart = matrix._mean_products(window, average, np.array([0]), rising, falling)
    rate = of_matrix(k) * 3.0
    in_step = STEP**2 / 12.0 * 9.0 * np.sin(2.0 * STEP) / STEP
    means = (4.0 / 6.0, 8.0 / 10.0) if triangular else (4.0 / 3.0, 8.0 / 4.0)
    assert square[0] == pytest.approx(G * means[0] * rate**2, rel=1e-3)
    assert cube[0] == pytest.approx(G * means[1] * rate**3, rel=1e-3)
    assert apart[0] == pytest.approx(G * means[0] * rate * in_step, rel=1e-3)


def turns_of(piece, gyro, row, duration):
    """The bound over one window with a triangle's weights."""
    window = piece.window(np.array([row]), duration, "middle")
    average = list(piece.averages(window, triangular=True))[1]
    return OneMatrix(piece, gyro).turns(window, average, np.array([0]), average.turn, triangular=True)[0]


def triangle_mean(times, row, duration, values):
    """The mean of values by the trapezoidal rule twice, for even steps."""
    weights = np.maximum(1.0 - np.abs(times - times[row]) / (0.5 * duration), 0.0)
    return weights @ values / weights.sum()


def test_an_error_that_keeps_to_one_way_comes_near_the_edge():
    """Rounds about one axis: before and after the row undo one another, and half of q² is left."""
    k, row = 0.01, 500
    times = STEP * np.arange(1001)
    rates = np.tile([0.0, 0.0, 30.0], (1001, 1))
    frames = Rotation.from_rotvec((times - times[row])[:, None] * rates)
    vectors = frames.inv().apply(np.tile([G, 0.0, 0.0], (1001, 1)))
    gyro = GyroBounds(0.0, scale_error=k)
    piece, _ = parts(times, rates, gyro, vectors)
    bound = turns_of(piece, gyro, row, 4.0)
    true = Rotation.from_rotvec((1.0 - of_matrix(k)) * (times - times[row])[:, None] * rates)
    off = triangle_mean(times, row, 4.0, frames.apply(vectors) - true.apply(vectors))
    assert 0.7 * bound <= np.linalg.norm(off) <= bound


def test_third_order_and_what_steps_leave_are_in_the_bound(monkeypatch):
    """Each by itself, in closed form or against a sum over rows: what is missing if it is taken for nothing."""
    k, row, duration = 0.02, 60, 4.0
    times = 0.05 * np.arange(121)
    phases = 3.0 * times
    rates = 8.0 * np.column_stack([np.cos(phases), np.sin(phases), np.zeros_like(times)])
    gyro = GyroBounds(0.0, scale_error=k)
    piece, matrix = parts(times, rates, gyro, np.tile(G * UP, (121, 1)))
    monkeypatch.setattr("elliptude.bounds.carried.second_order.SecondOrder.bounds", lambda *_, **__: np.zeros(1))
    whole = turns_of(piece, gyro, row, duration)
    away = np.abs(times - times[row])
    straight = of_matrix(k) * 8.0 * away
    chords = of_matrix(k) * np.abs(matrix._chords - matrix._chords[row])
    apart = np.abs(piece.apart - piece.apart[row]) * straight
    third = triangle_mean(times, row, duration, G * straight**3) / 6.0

    def without(change):
        with monkeypatch.context() as patch:
            change(patch)
            return whole - turns_of(piece, gyro, row, duration)

    def no_chords(patch):
        patch.setattr(
            "elliptude.bounds.carried.one_matrix.scale_effects",
            lambda *arguments: (scale_effects(*arguments)[0], np.zeros(len(times))),
        )

    products = OneMatrix._mean_products

    def no_power(which):
        def change(patch):
            patch.setattr(
                OneMatrix, "_mean_products",
                lambda *arguments: tuple(
                    0.0 * one if i == which else one for i, one in enumerate(products(*arguments))
                ),
            )  # fmt: skip

        return change

    share = 1.0 + 3.0 * (of_matrix(k) + of_matrix(k) * 8.0 * 0.5 * duration)
    assert without(no_chords) == pytest.approx(share * triangle_mean(times, row, duration, G * chords), rel=0.02)
    assert without(no_power(2)) == pytest.approx(share * triangle_mean(times, row, duration, G * apart), rel=0.02)
    assert without(no_power(1)) == pytest.approx(third, rel=0.02)


def test_products_count_with_the_square_of_the_scale_error(monkeypatch):
    times = STEP * np.arange(1001)
    rates = 5.0 * np.sin(times[:, None] * [7.0, 9.0, 11.0] + [0.0, 1.0, 2.0])
    gyro = GyroBounds(0.0, scale_error=0.02)
    piece, _ = parts(times, rates, gyro, carried(STEP * rates[1:]).inv().apply(G * UP))
    whole = turns_of(piece, gyro, 500, 3.0)
    found = SecondOrder.bounds
    products = []

    def nothing(*arguments, **named):
        products.append(found(*arguments, **named))
        return np.zeros(1)

    monkeypatch.setattr(SecondOrder, "bounds", nothing)
    assert whole - turns_of(piece, gyro, 500, 3.0) == pytest.approx(of_matrix(0.02) ** 2 * products[0][0], rel=1e-9)
    assert products[0][0] > 0.0


def test_turns_there_and_back_count_little():
    """If every turn counted by its length, the bound would be more than twice as large."""
    times = STEP * np.arange(2401)
    rates = 5.0 * np.sin(times[:, None] * [7.0, 9.0, 11.0] + [0.0, 1.0, 2.0])
    forces = carried(STEP * 0.5 * (rates[1:] + rates[:-1])).inv().apply(G * UP)
    gyro = GyroBounds(0.0, scale_error=0.02)
    found = gravity_bounds_over_windows(
        times, forces, rates, [1.0, 2.0, 4.0, 8.0], motion=MotionBounds(position=1.0), gyro=gyro, gravity=G, at="middle"
    )
    piece, _ = parts(times, rates, gyro, forces)
    rows = np.arange(800, 1601)
    by_length = np.inf
    for duration in (1.0, 2.0, 4.0, 8.0):
        average = list(piece.averages(piece.window(rows, duration, "middle"), triangular=True))[1]
        by_length = np.minimum(by_length, average.turn + 16.0 / duration**2)
    assert np.mean(found.radii[rows]) < 0.5 * np.mean(by_length)
