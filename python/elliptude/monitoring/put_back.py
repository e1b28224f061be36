"""Attitudes that a set excludes, moved onto its boundary."""

import numpy as np
from numpy.typing import NDArray

from elliptude.monitoring.monitor import Sets, as_quaternions, product
from elliptude.results import CLAIMS
from elliptude.typing import AttitudeLike, FloatArray

_UNCONDITIONAL = CLAIMS.index("unconditional")
# What is put back is this much inside, so that rounding does not leave it outside.
_INSIDE = 1e-9
# A set is taken to be no flatter than this, as a share of its largest eigenvalue.
_FLAT = 1e-30


def put_back(sets: Sets, attitudes: AttitudeLike) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Move attitudes outside their unconditional set onto its boundary, towards the center: theory, section 18.10.

    Sets whose bounds are proposals prove nothing of an attitude, and move none.

    Parameters
    ----------
    sets : Sets
    attitudes : (n, 3, 3) array_like, SciPy's ``Rotation`` or (n, 4) array_like
        From body to reference axes; as quaternions (qw, qx, qy, qz). NaN where there is none.

    Returns
    -------
    quaternions : (n, 4) array
        (qw, qx, qy, qz), of length 1.
    moved : (n,) array of bool
        Which were outside.
    """
    count = len(sets.times)
    quaternions = as_quaternions("attitudes", attitudes, count)
    centers = as_quaternions("sets.quaternions", sets.quaternions, count)
    moved = np.zeros(count, dtype=np.bool_)
    proved = (sets.claims == _UNCONDITIONAL) & (not sets.are_proposals)
    rows = np.flatnonzero(np.isfinite(quaternions[:, 0]) & np.isfinite(centers[:, 0]) & proved)
    offsets = product(centers[rows] * [1.0, -1.0, -1.0, -1.0], quaternions[rows])
    scalars, vectors = offsets[:, 0], offsets[:, 1:]
    # γ = 2v/w is inside if w is at least this long; a half turn, w = 0, never is.
    values, axes = (part[rows] for part in sets.principal)
    along = np.einsum("nji,nj->ni", axes, vectors)
    reach = 2.0 * np.linalg.norm(along / np.sqrt(np.maximum(values, _FLAT * values[:, -1:])), axis=1)
    outside = reach > np.abs(scalars)
    within = np.column_stack([np.where(scalars < 0.0, -1.0, 1.0) * reach * (1.0 + _INSIDE), vectors])[outside]
    within /= np.linalg.norm(within, axis=1, keepdims=True)
    moved[rows[outside]] = True
    quaternions[moved] = product(centers[moved], within)
    return quaternions, moved
