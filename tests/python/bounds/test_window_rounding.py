"""What rounding does to averages over windows is in their bounds, and contradicts nothing; theory, section 18.2."""

import copy

import numpy as np
import pytest
from elliptude.bounds import window_averages
from elliptude.bounds.carried.frame import CarriedFrame
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.stamps import OffsetTurns
from elliptude.bounds.turns import running_integral
from elliptude.bounds.window_averages import Piece
from elliptude.bounds.windows import MotionBounds, field_bounds_over_windows, gravity_bounds_over_windows

G = 9.80665
EXACT = np.longdouble


def turned(angles, axis):
    """Attitudes after turns about a fixed axis, in extended precision."""
    axis = np.asarray(axis, dtype=EXACT)
    axis = axis / np.sqrt((axis * axis).sum())
    x, y, z = axis
    hat = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=EXACT)
    sines, cosines = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3, dtype=EXACT) + sines * hat + (1 - cosines) * (hat @ hat)


def recorded(count, step, rate, vector):
    """Times, rates, body vectors, and attitudes in extended precision. Nothing is off but by rounding."""
    times = 1e5 + step * np.arange(count)
    rates = np.tile(np.asarray(rate, dtype=np.float64), (count, 1))
    speed = np.sqrt((rates[0].astype(EXACT) ** 2).sum())
    if not speed:
        attitudes = np.tile(np.eye(3, dtype=EXACT), (count, 1, 1))
    else:
        attitudes = turned(speed * (times.astype(EXACT) - times[0]), rates[0])
    vectors = np.einsum("nji,j->ni", attitudes, np.asarray(vector, dtype=EXACT))
    return times, rates, vectors.astype(np.float64), attitudes


CASES = [
    (200, 2.0**-7, [0.0, 0.0, 0.0], [0.5]),
    (200, 2.0**-7, [0.3, -0.5, 0.2], [0.5, 1.0]),
    (5000, 2.0**-7, [3.0, -5.0, 2.0], [0.5, 4.0]),
    (1000, 2.0**-7, [300.0, -500.0, 200.0], [2.0]),
    (1000, 2.0**-3, [3e7, -5e7, 2e7], [20.0]),
    (80_000, 2.0**-10, [0.3, -0.5, 0.2], [1.0]),
]


@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize("weights", ["equal", "triangle"])
@pytest.mark.parametrize(("count", "step", "rate", "durations"), CASES)
def test_bounds_of_zero_are_not_contradicted_by_rounding(count, step, rate, durations, weights, at):
    times, rates, forces, attitudes = recorded(count, step, rate, [0.0, 0.0, G])
    up = np.einsum("nji,j->ni", attitudes, np.array([0, 0, 1], dtype=EXACT))
    motion = MotionBounds(velocity=0.0) if weights == "equal" else MotionBounds(position=0.0)
    bounds = gravity_bounds_over_windows(
        times, forces, rates, durations, motion=motion, gyro=GyroBounds(0.0), gravity=G, at=at
    )
    field = field_bounds_over_windows(
        times, forces, rates, durations, disturbance=0.0, gyro=GyroBounds(0.0), strength=G, at=at
    )
    for found in (bounds, field):
        assert not found.contradicted.any()
        informative = found.angles < np.pi
        assert informative.mean() > 0.9
        off = np.linalg.norm(np.cross(found.directions.astype(EXACT), up), axis=1)
        assert (off[informative] <= found.angles[informative]).all()
        # And it costs nothing that anyone would see.
        assert np.nanmedian(found.angles) < (1e-9 if np.abs(rate).max() < 1e6 else 1e-4)


@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize("rate", [[0.0, 0.0, 0.0], [0.3, -0.5, 0.2]])
def test_what_is_behind_a_long_step_is_as_good_as_what_is_before(rate, at):
    """No window reaches over it; a running sum over years would leave no digits."""
    times, rates, forces, _ = recorded(2000, 2.0**-7, rate, [0.0, 0.0, G])
    times[1000:] += 2.0**30
    bounds = gravity_bounds_over_windows(
        times, forces, rates, [0.5, 2.0], motion=MotionBounds(position=0.0), gyro=GyroBounds(0.01), gravity=G, at=at,
        maximum_step=0.1,
    )  # fmt: skip
    assert not bounds.contradicted.any()
    np.testing.assert_allclose(bounds.angles[1400:1600], bounds.angles[400:600], rtol=1e-6)


def sums_of(stamps, values):
    """`RunningIntegrals` in extended precision."""
    sums = window_averages.RunningIntegrals(np.zeros(1), np.zeros((2, 1)))
    sums.once = running_integral(stamps, values)
    sums.twice = running_integral(stamps, sums.once)
    return sums


@pytest.mark.parametrize(
    "gyro",
    [
        GyroBounds(0.0),
        GyroBounds(0.1, bias=0.02),
        GyroBounds(0.1, drift=50.0),  # grows to 1e5 rad
        GyroBounds(1e3, increment=1e4),
    ],
)
@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize(("rate", "part"), [([0.3, -0.5, 0.2], 0.0), ([3e6, -5e6, 2e6], 3e3), ([0.0, 0.0, 0.0], 0.3)])
def test_running_sums_are_within_what_is_said_of_their_rounding(monkeypatch, gyro, at, rate, part):
    """Against the same sums in extended precision, of vectors that change."""
    times, rates, vectors, attitudes = recorded(20_000, 2.0**-8, rate, [0.2, -0.1, G])
    vectors[:, 0] += 0.3 * np.sin(times)
    offsets = np.full(len(times), 1e-3 * part)
    frame = CarriedFrame(times, rates, np.zeros(len(times) - 1, dtype=bool), gyro, times[0])
    piece = Piece(frame, np.arange(len(times)), times, vectors, OffsetTurns.any_way(offsets), gyro)
    exact = copy.copy(piece)
    stamps, speeds = times.astype(EXACT), np.sqrt((rates.astype(EXACT) ** 2).sum(axis=1))
    exact.elapsed = stamps - stamps[0]
    exact._steady = running_integral(stamps, gyro.steady_error(speeds, stamps - stamps[0]))
    exact.turned = running_integral(stamps, speeds)
    in_frame = np.einsum("nij,nj->ni", attitudes, vectors.astype(EXACT))
    lengths = np.sqrt((vectors.astype(EXACT) ** 2).sum(axis=1))
    columns = [np.ones_like(stamps), exact._steady, exact.turned, exact.elapsed, offsets.astype(EXACT)]
    exact._sums = sums_of(stamps, np.column_stack([in_frame, lengths[:, None] * np.column_stack(columns)]))
    rows = np.arange(400, 19_600, 37)
    lost = []
    for duration in (0.05, 2.5):
        window = piece.window(rows, duration, at)
        averages = list(piece.averages(window, triangular=True))
        with monkeypatch.context() as patch:
            patch.setattr(window_averages, "_EPSILON", 0.0)
            for found, right in zip(averages, exact.averages(window, triangular=True), strict=True):
                # In the row's axes, as the bounds are: what a common turn of the frame does is nothing.
                mean = np.einsum("nji,nj->ni", piece.attitudes[rows].astype(EXACT), found.mean)
                true = np.einsum("nji,nj->ni", attitudes[rows], right.mean)
                off = np.linalg.norm((mean - true).astype(np.float64), axis=1) + np.abs(found.length - right.length)
                assert (off <= found.rounding).all()
                assert (right.turn <= found.turn + found.rounding - off).all()
                np.testing.assert_allclose(found.turn, right.turn.astype(np.float64), rtol=0.01, atol=0.01)
                lost.append(float(off.max()))
    assert max(lost) > 0.0


@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize("rate", [[0.3, -0.5, 0.2], [3e5, -5e5, 2e5]])
def test_sums_of_slopes_are_within_what_is_said_of_their_rounding(monkeypatch, rate, at):
    """What offsets of stamps do, (18.60), against the same sums in extended precision."""
    times, rates, vectors, attitudes = recorded(20_000, 2.0**-8, rate, [0.2, -0.1, G])
    count, gyro, draws = len(times), GyroBounds(0.1, bias=0.02), np.random.default_rng(4)
    slopes = draws.uniform(-1.0, 1.0, (count, 3))
    known, lengths = draws.uniform(-0.01, 0.01, count), np.sqrt((vectors.astype(EXACT) ** 2).sum(axis=1))
    # Of slopes of at most √3, within 0.02 s.
    across = 0.02 * np.sqrt(3.0) / np.sqrt((vectors**2).sum(axis=1))
    offsets = OffsetTurns(np.ones(count), slopes, known, 0.01, across, 0.3 * across)
    frame = CarriedFrame(times, rates, np.zeros(count - 1, dtype=bool), gyro, times[0])
    piece = Piece(frame, np.arange(count), times, vectors, offsets, gyro)
    exact = copy.copy(piece)
    stamps, speeds = times.astype(EXACT), np.sqrt((rates.astype(EXACT) ** 2).sum(axis=1))
    exact.elapsed = stamps - stamps[0]
    exact._steady = running_integral(stamps, gyro.steady_error(speeds, stamps - stamps[0]))
    exact.turned = running_integral(stamps, speeds)
    in_frame = np.einsum("nij,nj->ni", attitudes, slopes.astype(EXACT))
    weights = lengths * across
    running = [np.ones_like(stamps), exact._steady, exact.turned, exact.elapsed, np.zeros_like(stamps)]
    columns = [weights, 0.3 * weights, in_frame, known[:, None] * in_frame]
    exact._slopes = sums_of(stamps, np.column_stack(columns))
    exact._across_sums = sums_of(stamps, weights[:, None] * np.column_stack(running))
    rows = np.arange(400, 19_600, 37)
    for duration in (0.05, 2.5):
        window, every = piece.window(rows, duration, at), np.arange(len(rows))
        for triangular in (False, True):
            found = list(piece.averages(window, triangular=True))[triangular]
            frame = piece.by_stamps_of_frame(window, found, every, triangular=triangular)
            with monkeypatch.context() as patch:
                patch.setattr(window_averages, "_EPSILON", 0.0)
                right = list(exact.averages(window, triangular=True))[triangular]
                exact_frame = exact.by_stamps_of_frame(window, right, every, triangular=triangular)
            # Only sums of the slopes are exact here, and by them offsets do less than by lengths.
            assert (right.by_stamps < right.by_lengths).all()
            for one, other in ((found.by_stamps, right.by_stamps), (frame, exact_frame)):
                assert (one >= other).all()
                np.testing.assert_allclose(one, other.astype(np.float64), rtol=0.01)
