"""The error of a mean, (18.51): against the worst samples that keep both bounds, found by linear programming."""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import VectorSensorBounds, mean_error
from elliptude.bounds.windows import MotionBounds, gravity_bounds_over_windows
from scipy.optimize import linprog

ERROR, AVERAGED = 1.0, 0.2


def worst(weights, shortest, count):
    """The largest weighted mean of samples within ERROR, if every mean over ``shortest`` or more is within AVERAGED."""
    rows = []
    for length in range(shortest, count + 1):
        for first in range(count - length + 1):
            row = np.zeros(count)
            row[first : first + length] = 1.0 / length
            rows += [row, -row]
    found = linprog(-weights, A_ub=np.array(rows), b_ub=np.full(len(rows), AVERAGED), bounds=[(-ERROR, ERROR)] * count)
    assert found.success
    return -found.fun


def triangle(before, after, count):
    """Weights that rise over ``before`` samples and fall over ``after``, as the mean over each sample's interval."""
    middles = np.arange(before + after) + 0.5
    rising = middles / before if before else np.ones_like(middles)
    falling = (before + after - middles) / after if after else np.ones_like(middles)
    weights = np.zeros(count)
    weights[: before + after] = np.minimum(rising, falling)
    return weights / weights.sum()


@pytest.mark.parametrize("length", [1, 3, 5, 6, 7, 9, 10, 14, 25])
def test_equal_weights(length):
    """Attained but for one length, at which means over still longer windows forbid it."""
    weights = np.zeros(30)
    weights[:length] = 1.0 / length
    bound, found = mean_error(ERROR, AVERAGED, 10.0, [length])[0], worst(weights, 10, 30)
    assert found <= bound + 1e-9
    assert found == pytest.approx(bound, abs=1e-9) or length == 6


@pytest.mark.parametrize(
    ("before", "after"),
    [(2, 2), (4, 4), (5, 5), (7, 7), (10, 10), (15, 15), (0, 8), (3, 9), (9, 13), (12, 14), (4, 24)],
)
def test_triangles(before, after):
    """Never beyond, and attained where the sides are equal and long."""
    bound = mean_error(ERROR, AVERAGED, 10.0, [before + after], [after - before])[0]
    found = worst(triangle(before, after, 32), 10, 32)
    assert found <= bound + 1e-9
    if before == after and before >= 10:
        assert found == pytest.approx(bound, abs=1e-9)
    assert found > 0.6 * bound


def test_by_integration():
    """The windows about a triangle's top, one after the other."""
    for length in (3.0, 6.5, 9.0, 11.0, 15.0, 19.0):
        shares = (np.arange(200_000) + 0.5) / 200_000
        parts = mean_error(ERROR, AVERAGED, 10.0, length * shares)
        expected = float(np.mean(2.0 * shares * parts))
        assert mean_error(ERROR, AVERAGED, 10.0, [length], [length])[0] == pytest.approx(expected, rel=1e-6)


def test_what_is_stated_for_any_window():
    """Also more than a sample's own error, as it covers what happens between samples."""
    lengths = [0.0, 1e-3, 1.0, np.nan]
    for error, averaged, over in ((1.0, 0.2, 0.0), (1.0, 1.0, 0.5), (0.2, 0.22, 0.5)):
        found = mean_error(error, averaged, over, lengths, np.zeros(4))
        np.testing.assert_array_equal(found, [averaged, averaged, averaged, np.nan])
    assert VectorSensorBounds(2.0).mean_error(0.1) == 2.0
    assert VectorSensorBounds(2.0, averaged_error=0.5, averaged_over=0.5).mean_error(0.5) == 0.5
    with pytest.raises(ValueError, match="averaged_over"):
        VectorSensorBounds(averaged_over=-1.0)


@pytest.mark.parametrize("every", [1, 7])
def test_windows_next_to_the_ends_keep_their_length(every):
    """What a sensor's mean is stated for half a second of holds for each row, with the row not in the middle."""
    times = 0.01 * np.arange(300)
    shaking = np.outer(0.3 * (-1.0) ** np.arange(300), [1.0, 0.0, 0.0])
    forces = shaking + np.array([0.0, 0.0, 9.807])
    sensor = VectorSensorBounds(0.35, averaged_error=0.02, averaged_over=0.5)
    found = gravity_bounds_over_windows(
        times, forces, np.zeros((300, 3)), [0.5], motion=MotionBounds(0.0), gyro=GyroBounds(1e-4, largest_rate=1e-4),
        sensor=sensor, gravity=9.807, at="middle", every=every,
    )  # fmt: skip
    rows = slice(0, None, every)
    np.testing.assert_allclose(found.durations[rows], 0.5, atol=1e-9)
    errors = np.arccos(np.clip(found.directions[rows, 2], -1.0, 1.0))
    assert (errors <= found.angles[rows]).all()
    assert (found.angles[rows] < 1.2 * 0.02 / 9.807 + 1e-4).all()
