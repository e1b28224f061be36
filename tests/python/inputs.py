"""What several tests need: random input, and the angle between directions."""

import numpy as np
from hypothesis import strategies as st
from reference import so3
from scipy.spatial.transform import Rotation

generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)
dimensions = st.integers(1, 6)
scales = st.floats(-9.0, 0.0).map(lambda exponent: 10.0**exponent)


def direction(rng, n=3):
    vector = rng.standard_normal(n)
    return vector / np.linalg.norm(vector)


def rotation(rng, angle=np.pi):
    return so3.exp(rng.uniform(0.0, angle) * direction(rng))


def turning_body(rng, times):
    """Rates that are constant from one time to the next, and the attitudes at the times."""
    rates = 0.5 * np.sin(np.outer(times, [0.7, 1.1, 1.3]) + rng.uniform(0.0, 6.0, 3))
    attitudes = [Rotation.random(rng=rng).as_matrix()]
    for rate in (times[1] - times[0]) * rates[:-1]:
        attitudes.append(attitudes[-1] @ so3.exp(rate))
    return rates, np.array(attitudes)


def shape(rng, n, least=0.1, most=10.0):
    """A positive definite matrix with eigenvalues in the given range."""
    vectors, _ = np.linalg.qr(rng.standard_normal((n, n)))
    matrix = vectors @ np.diag(rng.uniform(least, most, n)) @ vectors.T
    return 0.5 * (matrix + matrix.T)


def inertia(rng):
    """An inertia in axes that are not the principal ones: of a cloud of points."""
    points = rng.standard_normal((6, 3))
    matrix = np.trace(points.T @ points) * np.eye(3) - points.T @ points
    return matrix / np.trace(matrix)


def assert_close(actual, expected, relative=1e-12, size=None):
    """Differences are measured against the largest entry, or against `size`."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert actual.shape == expected.shape
    scale = np.max(np.abs(expected), initial=0.0) if size is None else size
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=relative * scale)


def angle_between(a, b):
    """The angle between vectors (..., 3), rad, without loss of digits at small angles."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))
