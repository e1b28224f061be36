"""How far a truth is from the centers of sets, and whether it is in the sets."""

import numpy as np

import elliptude
from elliptude.results import FilterLog, GuaranteedLog
from elliptude.typing import FloatArray

# rad/s; the squares of larger ones overflow for a small set.
_LARGEST_ERROR = 1e50
# Halvings of the interval that holds the multiplier: enough for any, because its ends are then neighbours.
_HALVINGS = 200


def compare(
    estimated: FilterLog | GuaranteedLog,
    true_attitudes: FloatArray | None,
    true_vectors: FloatArray | None,
    truth_error: float = 0.0,
    turned: FloatArray | None = None,
) -> tuple[FloatArray | None, FloatArray | None]:
    """Compute how far the truth is from the estimates, and its form in their sets.

    Parameters
    ----------
    estimated : FilterLog or GuaranteedLog
        N rows of sets.
    true_attitudes : (N, 3, 3) array, optional
    true_vectors : (N, 3) array, optional
        Angular velocities or gyro biases.
    truth_error : float
        Angle by which the true attitudes may themselves be off, rad.
    turned : (N,) array, optional
        How far the body may turn between a set's moment and that of the truth beside it, rad; in the guaranteed mode.

    Returns
    -------
    errors : (N, 6) array
        [ζ; δ], rad and rad/s; NaN where there is nothing to compare with. None without true attitudes.
    forms : (N,) array
        xᵀ P⁻¹ x in the sets' own chart, x = [ζ; δ] or [γ; δ], or of the attitude alone where δ is not known: at most 1
        in the set, or in its projection on attitude. If the truth may be off, the least of all attitudes that near.

    Raises
    ------
    ValueError
        If the truth is too far off to be compared.
    """
    if true_attitudes is None:
        return None, None
    count = len(estimated.times)
    errors, forms = np.full((count, 6), np.nan), np.full(count, np.nan)
    known = np.isfinite(true_attitudes[:, 0, 0]) & np.isfinite(estimated.shapes[:, 0, 0])
    turns = estimated.attitudes[known].swapaxes(1, 2) @ true_attitudes[known]
    errors[known, :3] = elliptude.log(turns)
    if true_vectors is not None:
        errors[:, 3:] = true_vectors - estimated.vectors
    if np.nanmax(np.abs(errors), initial=0.0) > _LARGEST_ERROR:
        row = np.argmax((np.abs(errors) > _LARGEST_ERROR).any(axis=1))
        raise ValueError(
            f"what the estimate is compared with is {np.nanmax(np.abs(errors[row])):.3g} rad/s off at "
            f"{estimated.times[row]:.6f} s, more than {_LARGEST_ERROR:g} rad/s"
        )
    is_gibbs = isinstance(estimated, GuaranteedLog)
    if truth_error > 0.0 or turned is not None:
        offsets = 2.0 * elliptude.cayley_inverse(turns) if is_gibbs else errors[known, :3]
        distance = truth_error + (0.0 if turned is None else reach_of_turns(offsets, turned[known]))
        forms[known] = attitude_forms(offsets, estimated.shapes[known, :3, :3], distance)
        return errors, forms
    whole = known & np.isfinite(errors[:, 3])
    if isinstance(estimated, GuaranteedLog):
        forms[known] = estimated.forms(true_attitudes)[known]
        if true_vectors is not None:
            forms[whole] = estimated.forms(true_attitudes, true_vectors)[whole]
        return errors, forms
    for rows, size in ((whole, 6), (known & ~whole, 3)):
        offsets = errors[rows, :size, None]
        forms[rows] = (offsets * np.linalg.solve(estimated.shapes[rows, :size, :size], offsets)).sum(axis=(1, 2))
    return errors, forms


def reach_of_turns(offsets: FloatArray, turned: FloatArray) -> FloatArray:
    """How far apart in the Gibbs chart attitudes are at most that are within an angle of one another.

    Along a turn the chart goes by at most 1 + |γ|²/4 as fast, so that a turn straight outward gets farthest.

    Parameters
    ----------
    offsets : (N, 3) array
        γ of the one.
    turned : (N,) array
        rad.

    Returns
    -------
    (N,) array
        Infinite where the other may be half a turn away, or nothing is known of the angle.
    """
    lengths = np.linalg.norm(offsets, axis=1)
    outward = np.arctan(0.5 * lengths) + 0.5 * turned
    is_near = outward < 0.5 * np.pi
    return np.where(is_near, 2.0 * np.tan(np.where(is_near, outward, 0.0)) - lengths, np.inf)


def attitude_forms(offsets: FloatArray, shapes: FloatArray, distance: float | FloatArray = 0.0) -> FloatArray:
    """xᵀ P⁻¹ x of attitude errors, or the least of all attitudes within a distance from each.

    Parameters
    ----------
    offsets : (N, 3) array
        x in the sets' own chart.
    shapes : (N, 3, 3) array
        P.
    distance : float or (N,) array
        rad.

    Returns
    -------
    (N,) array
        At most 1 in the set; infinite if P is not positive definite or x is not finite.
    """
    forms = np.full(len(offsets), np.inf)
    usable = np.isfinite(offsets).all(axis=1) & (np.linalg.eigvalsh(shapes)[:, 0] > 0.0)
    distances = np.broadcast_to(distance, len(offsets))
    for rows in (usable & (distances > 0.0), usable & ~(distances > 0.0)):
        x = offsets[rows]
        if (distances[rows] > 0.0).any():
            forms[rows] = least_forms(x, shapes[rows], distances[rows])
        else:
            forms[rows] = (x * np.linalg.solve(shapes[rows], x[..., None])[..., 0]).sum(axis=1)
    return forms


def least_forms(offsets: FloatArray, shapes: FloatArray, radius: float | FloatArray) -> FloatArray:
    """The least (x - e)ᵀ P⁻¹ (x - e) with ‖e‖ ≤ radius: at most 1 if a point that near to x is in the ellipsoid.

    With P = V diag(λ) Vᵀ and y = Vᵀ x, e = y/(1 + mλ) in these axes, where m makes its length the radius. In either
    chart rotations that are an angle apart are at least so far apart, so that this errs on the side of outside.

    Parameters
    ----------
    offsets : (N, n) array
        x.
    shapes : (N, n, n) array
        P, positive definite.
    radius : float or (N,) array
        Positive.

    Returns
    -------
    (N,) array
    """
    values, vectors = np.linalg.eigh(shapes)
    y = np.einsum("nji,nj->ni", vectors, offsets)
    lengths = np.linalg.norm(y, axis=1)
    # At this m the length is at most the radius; the m that is sought is smaller.
    most = np.maximum(lengths / radius - 1.0, 0.0) / values[:, 0]
    low = np.zeros_like(most)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + most)
        is_long = np.linalg.norm(y / (1.0 + middle[:, None] * values), axis=1) > radius
        low, most = np.where(is_long, middle, low), np.where(is_long, most, middle)
    left = y * (1.0 - 1.0 / (1.0 + most[:, None] * values))
    forms: FloatArray = np.sum(left**2 / values, axis=1)
    return forms
