"""What a recording shows about the errors of an accelerometer or a magnetometer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from elliptude.proposal.statistics import Quantiles, finite_rows, means_of_pieces, quantiles, rotations_of
from elliptude.typing import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class VectorProposal:
    """What a recording shows about an accelerometer or a magnetometer; the sensor's unit, rad."""

    reference: FloatArray | None
    """The vector in reference axes that is compared with, shape (3,); None without a reference attitude."""
    magnitude: float
    """Its length: gravity, or the field's median length at rest (of all rows if nothing is at rest)."""
    norm_rest: Quantiles | None
    """At rest, by how much the length is off."""
    norm_moving: Quantiles | None
    vector_rest: Quantiles | None
    """Against the reference attitude, length of the vector difference, at rest."""
    vector_moving: Quantiles | None
    angle_rest: Quantiles | None
    """Against the reference attitude, angle between measured and true direction; nothing is removed."""
    angle_moving: Quantiles | None
    aligned_rest: Quantiles | None
    """The same after the constant turn that fits all rows at rest best, ``misalignment``, is removed."""
    misalignment: float | None
    """Angle of that turn: how far sensor axes and the reference's body axes seem to differ."""
    averaged_rest: Quantiles | None = None
    """Error of means over 0.5 s at rest: of the vector against the reference attitude, or without one of its length."""
    scatter_rest: Quantiles | None = None
    """At rest, a sample's distance from the mean over its 0.5 s."""


def propose_vector(
    vectors: ArrayLike,
    resting: NDArray[np.bool_],
    attitudes: ArrayLike | None = None,
    reference: ArrayLike | None = None,
    magnitude: float | None = None,
) -> VectorProposal:
    """Measure the errors of a sensor that shows one vector of the reference frame: gravity, or the magnetic field.

    Parameters
    ----------
    vectors : (N, 3) array
        Body axes; rows may be NaN.
    resting : (N,) array of bool
        `rest_rows`.
    attitudes : (N, 4) array, optional
        The reference (qw, qx, qy, qz).
    reference : (3,) array, optional
        The vector in reference axes. Left out, it is the median over rest, turned by the reference attitude.
    magnitude : float, optional
        Its length. Left out, the median length at rest.

    Returns
    -------
    VectorProposal
    """
    rows = np.asarray(vectors, dtype=np.float64)
    lengths = np.linalg.norm(rows, axis=1)
    finite = np.isfinite(lengths)
    still = resting & finite
    chosen = still if still.any() else finite
    if not chosen.any():
        raise ValueError("vectors: no row is finite")
    size = float(np.median(lengths[chosen])) if magnitude is None else magnitude
    off = np.abs(lengths - size)
    nothing = VectorProposal(None, size, quantiles(off[still]), quantiles(off[finite & ~resting]), *(None,) * 6)
    if attitudes is None:
        return nothing
    turns, known = rotations_of(attitudes)
    if not (chosen & known).any():
        return nothing
    if reference is None:
        vector = np.median(turns[chosen & known].apply(rows[chosen & known]), axis=0)
    else:
        vector = np.asarray(reference, dtype=np.float64)
    expected = turns.inv().apply(vector)
    difference = np.linalg.norm(rows - expected, axis=1)
    angle = angles_between(rows, expected)
    rest, moving = still & known, finite & known & ~resting
    aligned, misalignment = None, None
    if rest.sum() > 2:
        # This needs rests in more than one pose. With one pose the turn about the vector stays zero.
        turn = _best_turn(expected[rest], rows[rest])
        misalignment = float(turn.magnitude())
        aligned = quantiles(angles_between(turn.apply(rows[rest]), expected[rest]))
    return VectorProposal(
        vector,
        size,
        nothing.norm_rest,
        nothing.norm_moving,
        quantiles(difference[rest]),
        quantiles(difference[moving]),
        quantiles(angle[rest]),
        quantiles(angle[moving]),
        aligned,
        misalignment,
    )


def with_averages(
    vector: VectorProposal,
    times: FloatArray,
    rows: FloatArray,
    resting: NDArray[np.bool_],
    attitudes: FloatArray | None,
    reference: FloatArray | None,
) -> VectorProposal:
    """The proposal, completed by averages over pieces of rest."""
    still = resting & finite_rows(rows)
    if not still.any():
        return vector
    means, piece = means_of_pieces(times, rows, still)
    scatter = quantiles(np.linalg.norm(rows[still] - means[piece], axis=1))
    off = np.abs(np.linalg.norm(means, axis=1) - vector.magnitude)
    if attitudes is not None and reference is not None:
        turns, known = rotations_of(attitudes)
        still &= known
        if still.any():
            differences, _ = means_of_pieces(times, rows - turns.inv().apply(reference), still)
            off = np.linalg.norm(differences, axis=1)
    return replace(vector, averaged_rest=quantiles(off), scatter_rest=scatter)


def _best_turn(expected: FloatArray, measured: FloatArray) -> Rotation:
    """The small turn after which the mean cross product vanishes, by least squares of least length; iterated."""
    turn = scipy.spatial.transform.Rotation.identity()
    goal = expected / np.linalg.norm(expected, axis=1, keepdims=True)
    start = measured / np.linalg.norm(measured, axis=1, keepdims=True)
    for _ in range(10):
        here = turn.apply(start)
        # (φ × b) = e - b: least squares in φ.
        normal = len(here) * np.eye(3) - here.T @ here
        step = np.linalg.lstsq(normal, np.cross(here, goal).sum(axis=0), rcond=1e-3)[0]
        turn = scipy.spatial.transform.Rotation.from_rotvec(step) * turn
    return turn


def angles_between(first: FloatArray, second: FloatArray) -> FloatArray:
    """Angles between rows, rad, shape (N,)."""
    across = np.linalg.norm(np.cross(first, second), axis=1)
    angles: FloatArray = np.arctan2(across, np.einsum("ni,ni->n", first, second))
    return angles


def dip_scatter(specific_forces: ArrayLike, fields: ArrayLike, resting: NDArray[np.bool_]) -> Quantiles | None:
    """At rest, by how much the angle between field and specific force differs from its median, rad."""
    forces, vectors = np.asarray(specific_forces, dtype=np.float64), np.asarray(fields, dtype=np.float64)
    angles = angles_between(forces[resting], vectors[resting])
    angles = angles[np.isfinite(angles)]
    return quantiles(np.abs(angles - np.median(angles))) if len(angles) else None
