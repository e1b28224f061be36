"""Means over windows with a gyro whose bias hardly changes; theory, section 18.12."""

import numpy as np
import pytest
from elliptude.bounds.carried.frame import CarriedFrame
from elliptude.bounds.carried.one_matrix import OneMatrix
from elliptude.bounds.carried.steady_bias import SteadyBias
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.stamps import OffsetTurns
from elliptude.bounds.turns import attitudes_from_rates
from elliptude.bounds.window_averages import Piece
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from inputs import angle_between
from scipy.spatial.transform import Rotation

G, STEP, COUNT, ROW, DURATION = 9.80665, 0.005, 1001, 500, 4.0
BIAS = 0.01


def waves(seed, speed):
    draws = np.random.default_rng(seed)
    times = STEP * np.arange(COUNT)
    frequencies, phases = draws.uniform(0.3, 4.0, (3, 3)), draws.uniform(0.0, 2.0 * np.pi, (3, 3))
    rates = np.sin(times[:, None, None] * frequencies + phases).sum(axis=1)
    return times, rates * speed / np.linalg.norm(rates, axis=1).mean()


def frames(rates):
    """Attitudes, the identity at the row."""
    attitudes = attitudes_from_rates(np.full(len(rates) - 1, STEP), rates)
    return attitudes[ROW].T @ attitudes


def piece_of(times, rates, vectors, gyro):
    frame = CarriedFrame(times, rates, np.zeros(len(times) - 1, dtype=bool), gyro, times[0])
    return Piece(frame, np.arange(len(times)), times, vectors, OffsetTurns.any_way(np.zeros(len(times))), gyro)


def bound_of(times, rates, vectors, gyro, *, triangular=True):
    piece = piece_of(times, rates, vectors, gyro)
    window = piece.window(np.array([ROW]), DURATION, "middle")
    average = list(piece.averages(window, triangular=True))[int(triangular)]
    matrix = OneMatrix(piece, gyro)
    return matrix.turns(window, average, np.array([0]), average.turn, triangular=triangular)[0]


def weights(*, triangular=True):
    away = np.abs(np.arange(COUNT) - ROW) * STEP
    found = np.where(away <= 0.5 * DURATION + 1e-9, 1.0 - away / (0.5 * DURATION) if triangular else 1.0, 0.0)
    if not triangular:
        found[[ROW - 400, ROW + 400]] = 0.5
    return found / found.sum()


def error_of(rates, vectors, biases, *, triangular=True):
    """What the mean is off: the gyro shows ω + b."""
    true = rates - biases
    return weights(triangular=triangular) @ np.einsum("nij,nj->ni", frames(rates) - frames(true), vectors)


DIRECTIONS = np.random.default_rng(8).standard_normal((60, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]


@pytest.mark.parametrize("triangular", [True, False])
@pytest.mark.parametrize("speed", [0.3, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_bias_that_stays_comes_near_the_edge(seed, speed, triangular):
    times, rates = waves(seed, speed)
    vectors = np.einsum("nji,j->ni", frames(rates), [0.0, 0.0, G]) + 3.0 * np.sin(times)[:, None]
    gyro = GyroBounds(0.0, BIAS, bias_change=0.0)
    bound = bound_of(times, rates, vectors, gyro, triangular=triangular)
    worst = max(
        np.linalg.norm(error_of(rates, vectors, np.tile(BIAS * one, (COUNT, 1)), triangular=triangular))
        for one in DIRECTIONS
    )
    assert 0.5 * bound <= worst <= bound
    # Far less than if it pointed anywhere at every instant, unless the body turns much.
    anywhere = bound_of(times, rates, vectors, GyroBounds(0.0, BIAS, scale_error=1e-9), triangular=triangular)
    assert bound < (0.5 if speed < 1.0 else 1.0) * anywhere


def test_a_bias_that_stays_does_nothing_to_first_order_where_the_gyro_shows_no_turn():
    """What is left is half the square of the turn by the bias, whose mean is a sixth of that at the window's ends."""
    times, rates = STEP * np.arange(COUNT), np.zeros((COUNT, 3))
    vectors = np.tile([G, 0.0, 0.0], (COUNT, 1))
    bound = bound_of(times, rates, vectors, GyroBounds(0.0, BIAS, bias_change=0.0))
    off = np.linalg.norm(error_of(rates, vectors, np.tile([0.0, 0.0, BIAS], (COUNT, 1))))
    square = G * (BIAS * 0.5 * DURATION) ** 2 / 6.0
    assert off == pytest.approx(0.5 * square, rel=0.01)
    assert 0.45 * bound <= off <= bound


def test_a_change_at_the_row_comes_to_the_edge_of_a_ball_for_any_two():
    """Half of the change either way: half of it would do for two biases, and 1.22 times that does for any set."""
    times, change = STEP * np.arange(COUNT), 0.004
    sign = np.sign(np.arange(COUNT) - ROW)[:, None]
    rates = 0.5 * change * sign * [1.0, 0.0, 0.0]
    vectors = np.tile([0.0, 0.0, G], (COUNT, 1))
    bound = bound_of(times, rates, vectors, GyroBounds(0.0, change, bias_change=change))
    off = np.linalg.norm(error_of(rates, vectors, rates))
    assert off == pytest.approx(G * 0.5 * change * 0.5 * DURATION / 3.0, rel=0.01)
    assert 0.78 * bound <= off <= bound


def test_a_drift_changes_the_bias_within_the_window():
    """A bias that goes through zero at the row: its turn grows with the square of the time, both ways alike."""
    times, drift = STEP * np.arange(COUNT), 0.002
    away = (times - times[ROW])[:, None]
    rates = drift * away * [1.0, 0.0, 0.0]
    vectors = np.tile([0.0, 0.0, G], (COUNT, 1))
    bound = bound_of(times, rates, vectors, GyroBounds(0.0, 1e-6, drift, bias_change=0.0))
    off = np.linalg.norm(error_of(rates, vectors, rates))
    assert off == pytest.approx(G * drift * (0.5 * DURATION) ** 2 / 12.0, rel=0.01)
    assert 0.2 * bound <= off <= bound


def test_the_mean_of_the_turn_by_the_matrix_times_the_time_in_closed_form():
    """Of a turn about one axis, twice, with the bias: q grows with the time to the row."""
    times, rate = STEP * np.arange(COUNT), 0.3
    gyro = GyroBounds(0.0, BIAS, scale_error=0.05, bias_change=0.0)
    piece = piece_of(times, np.tile([0.0, 0.0, rate], (COUNT, 1)), np.tile([0.0, 0.0, G], (COUNT, 1)), gyro)
    window = piece.window(np.array([ROW]), DURATION, "middle")
    average = list(piece.averages(window, triangular=True))[1]

    def turns(straight):
        bias = SteadyBias(piece, gyro, straight)
        return bias.turns(window, average, np.array([0]), np.zeros(1), triangular=True)[0]

    of_matrix = 0.05 / 0.95 * piece.turned
    expected = BIAS / 0.95 * 2.0 * G * 0.05 / 0.95 * rate * (0.5 * DURATION) ** 2 / 6.0
    assert turns(of_matrix) - turns(0.0 * of_matrix) == pytest.approx(expected, rel=1e-3)


def test_a_change_that_is_stated_too_large_is_no_worse_than_none():
    times, rates = waves(5, 1.0)
    vectors = np.einsum("nji,j->ni", frames(rates), [0.0, 0.0, G])
    without = bound_of(times, rates, vectors, GyroBounds(0.0, BIAS, scale_error=1e-3))
    assert bound_of(times, rates, vectors, GyroBounds(0.0, BIAS, scale_error=1e-3, bias_change=1.0)) == without


@pytest.mark.parametrize("seed", range(12))
def test_windows_hold_with_biases_matrix_drift_and_noise_at_their_bounds(seed):
    draws = np.random.default_rng(seed)
    times, rates = waves(seed + 40, draws.choice([0.2, 2.0, 8.0]))
    k, noise, bias, change, drift = 0.02, 0.003, 0.02, draws.choice([0.0, 0.004, 0.02]), draws.choice([0.0, 1e-3])
    gyro = GyroBounds(noise, bias, drift, scale_error=k, bias_change=change)
    wrong = k * Rotation.random(rng=draws).as_matrix()
    middle, aside, of_drift, of_noise = DIRECTIONS[draws.choice(60, 4)]
    signs = np.sign(np.arange(COUNT) - ROW)[:, None] if draws.random() < 0.5 else draws.choice([-1.0, 1.0], (COUNT, 1))
    biases = (bias - 0.5 * change) * middle + 0.5 * change * signs * aside + drift * times[:, None] * of_drift
    shaken = noise * draws.choice([-1.0, 1.0], (COUNT, 1)) * of_noise
    true = (rates - biases - shaken) @ np.linalg.inv(np.eye(3) + wrong).T
    turned = frames(true)
    forces = np.einsum("nji,j->ni", turned, [0.0, 0.0, G])
    found = gravity_bounds_over_windows(
        times, forces, rates, [1.0, 2.0, 4.0], motion=MotionBounds(acceleration=0.0), gyro=gyro, gravity=G, at="middle"
    )
    known = np.isfinite(found.angles)
    error = angle_between(found.directions, np.einsum("nji,j->ni", turned, [0.0, 0.0, 1.0]))
    assert not found.contradicted.any()
    assert known[1:-1].all()
    assert (error <= found.angles)[known].all()


def test_a_gyro_without_a_scale_error_is_helped_too():
    times, rates = waves(2, 0.5)
    forces = np.einsum("nji,j->ni", frames(rates), [0.0, 0.0, G])

    def radius(**stated):
        found = gravity_bounds_over_windows(
            times, forces, rates, [4.0], motion=MotionBounds(acceleration=0.0), gyro=GyroBounds(0.0, BIAS, **stated),
            gravity=G, at="middle",
        )  # fmt: skip
        return found.radii[ROW]

    assert radius(bias_change=0.0) < 0.7 * radius()


def test_a_change_must_not_be_negative():
    with pytest.raises(ValueError, match="bias_change must be at least 0, not -1"):
        GyroBounds(0.0, bias_change=-1.0)
