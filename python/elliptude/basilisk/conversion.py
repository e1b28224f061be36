"""Attitudes as Basilisk writes them: modified Rodrigues parameters of the body B relative to the inertial frame N."""

import numpy as np
from numpy.typing import ArrayLike

from elliptude._core import quaternion_from_rotation, rotation_from_quaternion
from elliptude.typing import AttitudeLike, FloatArray


def attitude_from_mrp(sigma: ArrayLike) -> FloatArray:
    """Attitudes from Basilisk's ``sigma_BN``.

    Basilisk's matrix [BN] takes components along N to components along B. An attitude here goes the other way, from
    body to reference axes: with N as the reference frame it is the transpose of [BN].

    Parameters
    ----------
    sigma : (..., 3) array_like
        Modified Rodrigues parameters, of either set: inside or outside the unit sphere.

    Returns
    -------
    (..., 3, 3) array
        From body axes to axes of N.

    Raises
    ------
    ValueError
        If the last dimension is not 3, or a number is not finite.
    """
    parameters = np.asarray(sigma, dtype=np.float64)
    if parameters.ndim == 0 or parameters.shape[-1] != 3:
        raise ValueError(f"sigma must have shape (..., 3), not {parameters.shape}")
    if not np.isfinite(parameters).all():
        raise ValueError("sigma must be finite")
    # The tangent of a quarter of the angle, along the axis. It may be any number, and its square must not overflow.
    scale = np.maximum(1.0, np.abs(parameters).max(axis=-1, keepdims=True, initial=0.0))
    vector, one = parameters / scale, 1.0 / scale
    square = np.sum(vector * vector, axis=-1, keepdims=True)
    quaternion = np.concatenate([one * one - square, 2.0 * one * vector], axis=-1) / (one * one + square)
    attitudes: FloatArray = rotation_from_quaternion(quaternion)
    return attitudes


def mrp_from_attitude(attitude: AttitudeLike) -> FloatArray:
    """Basilisk's ``sigma_BN`` of attitudes; the inverse of `attitude_from_mrp`.

    Parameters
    ----------
    attitude : (..., 3, 3) array_like or scipy Rotation
        From body axes to axes of N.

    Returns
    -------
    (..., 3) array
        Modified Rodrigues parameters of the set that is at most 1 long.

    Raises
    ------
    ValueError
        If a matrix is not a rotation.
    """
    quaternion = quaternion_from_rotation(attitude)
    scalar = quaternion[..., :1]
    # A quaternion and its negative are the same attitude; the one with the positive scalar is taken.
    parameters: FloatArray = quaternion[..., 1:] / (scalar + np.copysign(1.0, scalar))
    return parameters
