"""Which rows of a recording are at rest."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def rest_rows(
    times: ArrayLike,
    angular_velocities: ArrayLike,
    specific_forces: ArrayLike,
    *,
    duration: float,
    rate_deviation: float,
    rate: float,
    acceleration_deviation: float,
) -> NDArray[np.bool_]:
    """Rows at rest: the recording is cut into pieces, and all samples of a piece stay near its mean.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    angular_velocities, specific_forces : (N, 3) array
        rad/s and m/s².
    duration : float
        Length of a piece, s.
    rate_deviation, acceleration_deviation : float
        Largest deviation of a sample from the piece's mean, rad/s and m/s².
    rate : float
        Largest norm of the piece's mean, rad/s.

    Returns
    -------
    (N,) array of bool
        False in pieces with a missing row.
    """
    stamps = np.asarray(times, dtype=np.float64)
    pieces = np.floor((stamps - stamps[0]) / duration + 1e-9).astype(np.intp)
    starts = np.flatnonzero(np.diff(pieces, prepend=-1))
    piece = np.cumsum(np.diff(pieces, prepend=-1) > 0) - 1
    counts = np.diff(starts, append=len(stamps))
    resting = counts > 1
    for values, deviation, most in (
        (np.asarray(angular_velocities, dtype=np.float64), rate_deviation, rate),
        (np.asarray(specific_forces, dtype=np.float64), acceleration_deviation, np.inf),
    ):
        means = np.add.reduceat(values, starts, axis=0) / counts[:, None]
        deviations = np.maximum.reduceat(np.linalg.norm(values - means[piece], axis=1), starts)
        resting &= (deviations <= deviation) & (np.linalg.norm(means, axis=1) <= most)
    rows: NDArray[np.bool_] = resting[piece]
    return rows
