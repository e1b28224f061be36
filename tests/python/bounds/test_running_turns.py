"""Sums, products and lengths over rows: the same bits as the plain formulas, which are slower."""

import numpy as np
import pytest
from elliptude.bounds import turns


@pytest.mark.parametrize("width", [1, 3, 4])
def test_lengths_are_those_of_numpy(width):
    draws = np.random.default_rng(width)
    vectors = draws.standard_normal((2000, width)) * 10.0 ** draws.integers(-200, 150, (2000, 1))
    vectors[7, 0], vectors[11] = np.nan, 0.0
    assert turns.lengths_of(vectors).tobytes() == np.linalg.norm(vectors, axis=1).tobytes()


@pytest.mark.parametrize("shape", [(1,), (400,), (400, 27)])
def test_sums_are_those_of_the_trapezoidal_rule(shape):
    draws = np.random.default_rng(1)
    values, steps = draws.standard_normal(shape), draws.uniform(0.01, 0.02, shape[0] - 1)
    columns = values.reshape(shape[0], -1)
    expected = np.zeros_like(columns)
    for row in range(1, shape[0]):
        expected[row] = expected[row - 1] + (0.5 * steps[row - 1]) * (columns[row] + columns[row - 1])
    assert turns.running_sum(steps, values).tobytes() == expected.reshape(shape).tobytes()


@pytest.mark.parametrize("count", [1, 2, 50, 401])
def test_products_are_those_of_hamilton(count):
    draws = np.random.default_rng(count)
    a, b = draws.standard_normal((2, count, 4))
    a[0, 1] = b[0, 2] = 0.0
    for first in (a, a[:1]):
        (aw, ax, ay, az), (bw, bx, by, bz) = first.T, b.T
        expected = [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
        np.testing.assert_array_equal(turns._quaternion_product(first, b), np.stack(expected, axis=1))
