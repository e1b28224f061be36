"""Integrals of rates over rows, and the attitudes that follow from them. Needs only NumPy."""

import math

import numpy as np

from elliptude.typing import FloatArray

# With which component of b each of a goes into (w, x, y, z) of the product a b, and its sign.
_FACTORS = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_SIGNS = np.array([[1.0, 1.0, 1.0, 1.0], [-1.0, 1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])


def lengths_of(vectors: FloatArray) -> FloatArray:
    """Euclidean norms of short vectors (..., k), to the last bit those of NumPy, which takes five times as long."""
    squares = vectors[..., 0] * vectors[..., 0]
    for i in range(1, vectors.shape[-1]):
        squares += vectors[..., i] * vectors[..., i]
    return np.asarray(np.sqrt(squares))


def running_integral(times: FloatArray, values: FloatArray) -> FloatArray:
    """The integral from the first row to each, by the trapezoidal rule, along the first axis."""
    return running_sum(np.diff(times), values)


def running_sum(steps: FloatArray, values: FloatArray) -> FloatArray:
    """`running_integral`, given the steps between times."""
    steps = steps.reshape(-1, *(1,) * (values.ndim - 1))
    sums = np.zeros(values.shape)
    in_steps = sums[1:]
    np.add(values[1:], values[:-1], out=in_steps)
    in_steps *= 0.5 * steps
    np.cumsum(in_steps, axis=0, out=in_steps)
    return sums


def attitudes_from_rates(steps: FloatArray, rates: FloatArray) -> FloatArray:
    """Attitudes relative to the first row; the rate in a step is the mean of its ends.

    Parameters
    ----------
    steps : (N - 1,) array
        s.
    rates : (N, 3) array
        rad/s, body axes.

    Returns
    -------
    (N, 3, 3) array
        From each row's body axes to those of the first.
    """
    return rotations_from_quaternions(quaternions_from_rates(steps, rates))


def coning_angles(steps: FloatArray, rates: FloatArray) -> FloatArray:
    """How far each step's turn at the mean of its ends is from that of a rate on the line between them, (18.49).

    Parameters
    ----------
    steps : (N - 1,) array
        s.
    rates : (N, 3) array
        At the ends, rad/s, body axes.

    Returns
    -------
    (N - 1,) array
        Bounds of the angle, rad.
    """
    (ax, ay, az), (bx, by, bz) = rates[:-1].T, rates[1:].T
    crossed = np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    angles: FloatArray = steps * steps * crossed / 12.0 * (1.0 + 0.125 * steps * lengths_of(rates[1:] - rates[:-1]))
    return angles


def from_the_first(in_steps: FloatArray) -> FloatArray:
    """What steps (N - 1,) add up to from the first row to each, shape (N,)."""
    return np.concatenate([[0.0], np.cumsum(in_steps)])


def quaternions_from_rates(steps: FloatArray, rates: FloatArray) -> FloatArray:
    """`attitudes_from_rates` as quaternions (qw, qx, qy, qz), shape (N, 4)."""
    turns = 0.5 * steps[:, None] * (rates[1:] + rates[:-1])
    angles = lengths_of(turns)
    quaternions = np.zeros((len(rates), 4))
    quaternions[0, 0] = 1.0
    quaternions[1:, 0] = np.cos(0.5 * angles)
    quaternions[1:, 1:] = 0.5 * np.sinc(angles / (2.0 * np.pi))[:, None] * turns
    # Products of all that came before: along the rows of a square first, then down its last column.
    width = math.isqrt(len(rates) - 1) + 1
    padding = np.zeros((-len(rates) % width, 4))
    square = np.concatenate([quaternions, padding]).reshape(-1, width, 4)
    for column in range(1, width):
        square[:, column] = _quaternion_product(square[:, column - 1], square[:, column])
    for row in range(1, len(square)):
        square[row] = _quaternion_product(square[row - 1, -1:], square[row])
    products = square.reshape(-1, 4)[: len(rates)]
    unit: FloatArray = products / lengths_of(products)[:, None]
    return unit


def rotations_from_quaternions(quaternions: FloatArray) -> FloatArray:
    """Rotation matrices (N, 3, 3) of unit quaternions (qw, qx, qy, qz)."""
    w, x, y, z = quaternions.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )


def rotation_vectors(quaternions: FloatArray) -> FloatArray:
    """The rotation vectors of unit quaternions, each the shorter way round."""
    signs = np.where(quaternions[:, :1] < 0.0, -1.0, 1.0)
    vectors = signs * quaternions[:, 1:]
    sines = lengths_of(vectors)
    angles = 2.0 * np.arctan2(sines, np.abs(quaternions[:, 0]))
    factors = np.where(sines > 0.0, angles / np.where(sines > 0.0, sines, 1.0), 2.0)
    return factors[:, None] * vectors


def _quaternion_product(a: FloatArray, b: FloatArray) -> FloatArray:
    # The terms with aw, ax, ay and az; few calls, as there are many products of few quaternions.
    w, x, y, z = a.T[:, :, None] * (b[:, _FACTORS] * _SIGNS).transpose(1, 0, 2)
    product: FloatArray = w + x + y + z
    return product
