"""What a recording shows about its gyro's errors, at rest and against a reference attitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.gyro import usual_longest, with_rounding
from elliptude.bounds.turns import attitudes_from_rates
from elliptude.proposal.statistics import PIECE_S, Quantiles, finite_rows, means_of_pieces, quantiles, rotations_of
from elliptude.typing import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

WINDOWS_S = (1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 256.0, 1024.0)
"""Windows over which the gyro's turn is compared with the reference's, s; up to a quarter of the recording."""
_LONGEST_INCREMENT_S = 16.0
# A scale error is proposed only if its standard error is at most this: a body must turn enough about all axes.
_SCALE_WITHIN = 0.01
# Turns that are slower than this share of the fastest ones are not taken into the fit.
_TURNING = 0.25
# A recording must turn about each axis by this share of what it turns about any.
_LEAST_TURNED = 0.05
# A scale error may be this many times as large as the largest share by which a turn is off: none may be about its axis.
_TIMES_SHOWN = 2.0
# In steps: a rate may be that of the moment, or the mean of the step before or behind it.
_LATE = (0.0, -0.5, 0.5)


@dataclass(frozen=True, eq=False)
class GyroProposal:
    """What a recording shows about its gyro; rad, s."""

    bias: FloatArray | None
    """Mean over rest, shape (3,); without rest the mean against the reference, and None without that."""
    bias_spread: Quantiles | None
    """Distance of the mean of a piece at rest from the bias: how the bias moved in this recording."""
    noise: Quantiles | None
    """At rest, a sample's distance from the bias."""
    speed: Quantiles | None
    """Norm of the rate without the bias."""
    rate_error: Quantiles | None
    """Against the reference's increments over 0.05 s or one row, whichever is longer; its jitter is in it."""
    window_angles: dict[float, Quantiles | None]
    """By how much the turn over a window (its duration in s) is off against the reference."""
    scale_error: float | None
    """Spectral norm of the matrix that explains the reference's increments best, less the identity; None where the
    recording hardly turns about some axis."""
    sums_rest: Quantiles | None
    """What the noise adds up to, rad: for each phase of rest the diagonal of the box about the integral of the rate
    less its mean in that phase. A constant bias in each phase, and noise whose integral over any window is at most this
    long, explain what was seen there."""
    unexplained: Quantiles | None
    """For the windows above of up to 16 s: what ``bias_spread`` and ``scale_error`` leave unexplained in the error of
    the turn, rad; the reference's jitter is in it. None without a reference."""
    longest_interval: float = np.inf
    """Between samples, s: 1.5 times the usual one. All of the above is from intervals up to it, from no window over a
    longer one."""


def propose_gyro(
    times: ArrayLike,
    angular_velocities: ArrayLike,
    resting: NDArray[np.bool_],
    attitudes: ArrayLike | None = None,
    *,
    delay: float = 0.0,
    piece: float = PIECE_S,
) -> GyroProposal:
    """Measure the gyro's errors.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    angular_velocities : (N, 3) array
        rad/s, body axes; rows may be NaN.
    resting : (N,) array of bool
        `rest_rows`.
    attitudes : (N, 4) array, optional
        The reference (qw, qx, qy, qz), from body to reference axes; NaN where there is none.
    delay : float
        How late the gyro is against the reference, s; it is removed before they are compared.
    piece : float
        How long a piece of rest is for the bias's spread, s.

    Returns
    -------
    GyroProposal
    """
    stamps, rates = np.asarray(times, dtype=np.float64), np.asarray(angular_velocities, dtype=np.float64)
    finite = finite_rows(rates)
    longest = usual_longest(np.diff(stamps))
    gaps = np.concatenate([[0], np.cumsum(np.diff(stamps) > with_rounding(longest, stamps))])
    still = resting & finite
    bias = rates[still].mean(axis=0) if still.any() else None
    noise = spread = sums = None
    if bias is not None:
        sums = quantiles(_sums_at_rest(stamps, rates, still))
        noise = quantiles(np.linalg.norm(rates[still] - bias, axis=1))
        means, _ = means_of_pieces(stamps, rates, still, piece)
        spread = quantiles(np.linalg.norm(means - bias, axis=1))
    rate_error = scale = left = None
    windows: dict[float, Quantiles | None] = {}
    if attitudes is not None:
        reference, known = rotations_of(attitudes)
        rates = np.column_stack([np.interp(stamps + delay, stamps, column) for column in rates.T])
        shown, true, scale = _against_the_reference(stamps, rates, reference, known)
        if bias is None and len(true):
            bias = (shown - true).mean(axis=0)
        offset = np.zeros(3) if bias is None else bias
        rate_error = quantiles(np.linalg.norm(shown - offset - true, axis=1))
        finite = finite_rows(rates)
        unbiased = np.where(finite[:, None], rates, 0.0) - offset
        moved = 0.0 if spread is None else spread.maximum
        windows, left = _over_windows(stamps, unbiased, reference, finite & known, gaps, scale or 0.0, moved)
    speed = quantiles(np.linalg.norm(rates - (0.0 if bias is None else bias), axis=1))
    return GyroProposal(bias, spread, noise, speed, rate_error, windows, scale, sums, left, longest)


def _against_the_reference(
    times: FloatArray, rates: FloatArray, reference: Rotation, known: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, float | None]:
    """Rates by gyro and by reference over 0.05 s or one row, and the scale error where the recording shows one."""
    step = float(np.median(np.diff(times)))
    shown, true = _increments(times, rates, reference, known, max(round(0.05 / step), 1))
    # The reference's jitter dominates short increments; beyond a radian a scale error is not just a factor.
    fast = np.quantile(np.linalg.norm(true, axis=1), 0.9) if len(true) else 0.0
    longer = max(round(min(0.5 / max(fast, 1.0), 0.5) / step), 1)
    fits: list[_ScaleFit] = []
    for late in _LATE:
        moved = np.column_stack([np.interp(times + late * step, times, column) for column in rates.T])
        fit = _scale_fit(*_increments(times, moved, reference, known, longer))
        fits += [] if fit is None else [fit]
    return shown, true, min(fits).scale_error if fits else None


class _ScaleFit(NamedTuple):
    """The scale error that explains turns best, and how much it leaves of them, rad/s."""

    residual: float
    scale_error: float


def _scale_fit(mean_rates: FloatArray, increments: FloatArray) -> _ScaleFit | None:
    """The fit of the turns per second by the gyro to those by the reference; None where they do not show a scale error.

    What rests shows nothing of it, however little its residual is.
    """
    lengths = np.linalg.norm(increments, axis=1)
    if len(lengths) <= 12:
        return None
    turning = (lengths > 0.0) & (lengths >= _TURNING * np.quantile(lengths, 0.99))
    if turning.sum() <= 12:
        return None
    mean_rates, increments, lengths = mean_rates[turning], increments[turning], lengths[turning]
    # ω̃ = M ω + b, so M and b fit the turns per second by the gyro to those by the reference.
    unknowns = np.column_stack([increments, np.ones(len(increments))])
    matrix = np.linalg.lstsq(unknowns, mean_rates, rcond=None)[0].T
    residual = float(np.sqrt(np.mean((mean_rates - unknowns @ matrix.T) ** 2)))
    turned = np.linalg.svd(increments - increments.mean(axis=0), compute_uv=False)
    scale_error = float(np.linalg.norm(matrix[:, :3] - np.eye(3), 2))
    off = mean_rates - increments
    shown = float(np.max(np.linalg.norm(off - off.mean(axis=0), axis=1) / lengths))
    is_shown = turned[-1] >= _LEAST_TURNED * turned[0] and residual <= _SCALE_WITHIN * turned[-1]
    # A fit that is larger than all that the turns are off by is of an axis about which nothing turned.
    return _ScaleFit(residual, scale_error) if is_shown and scale_error <= _TIMES_SHOWN * shown else None


def _over_windows(
    times: FloatArray,
    unbiased: FloatArray,
    reference: Rotation,
    there: NDArray[np.bool_],
    gaps: NDArray[np.intp],
    scale_error: float,
    bias_spread: float,
) -> tuple[dict[float, Quantiles | None], Quantiles | None]:
    """By how much turns over windows are off, and what scale error and bias leave unexplained of the shorter ones."""
    turned = _integrated(times, unbiased)
    swept = _running_sums(times, np.linalg.norm(unbiased, axis=1))
    missing = np.concatenate([[0], np.cumsum(~there)])
    windows: dict[float, Quantiles | None] = {}
    unexplained: list[FloatArray] = []
    for duration in WINDOWS_S:
        if duration > 0.25 * (times[-1] - times[0]):
            break
        end = np.searchsorted(times, times + duration)
        start = np.flatnonzero(end < len(times))
        end = end[start]
        whole = np.asarray((missing[end + 1] == missing[start]) & (gaps[end] == gaps[start]))
        start, end = start[whole], end[whole]
        by_gyro = turned[start].inv() * turned[end]
        by_reference = reference[start].inv() * reference[end]
        angles = (by_reference.inv() * by_gyro).magnitude()
        windows[duration] = quantiles(angles)
        if duration <= _LONGEST_INCREMENT_S:
            explained = scale_error * (swept[end] - swept[start])
            explained += bias_spread * duration
            unexplained.append(np.maximum(angles - explained, 0.0))
    return windows, quantiles(np.concatenate(unexplained)) if unexplained else None


def _running_sums(times: FloatArray, values: FloatArray) -> FloatArray:
    """Integral from the first row on, by trapezoids, shape (N, ...)."""
    sums = np.zeros_like(values)
    np.cumsum((0.5 * np.diff(times) * (values[1:] + values[:-1]).T).T, axis=0, out=sums[1:])
    return sums


def _sums_at_rest(times: FloatArray, rates: FloatArray, still: NDArray[np.bool_]) -> FloatArray:
    """For each phase of rest, the diagonal of the box about the integral of the rate less its mean there, rad."""
    changes = np.flatnonzero(np.diff(still, prepend=False, append=False)).reshape(-1, 2)
    phases = [slice(begin, end) for begin, end in changes]
    sums = [_running_sums(times[phase], rates[phase] - rates[phase].mean(axis=0)) for phase in phases]
    return np.array([np.linalg.norm(np.ptp(one, axis=0)) for one in sums], dtype=np.float64)


def _integrated(times: FloatArray, rates: FloatArray) -> Rotation:
    """Attitudes from the first row's body axes; the rate in a step is the mean of its ends."""
    return scipy.spatial.transform.Rotation.from_matrix(attitudes_from_rates(np.diff(times), rates))


def _increments(
    times: FloatArray, rates: FloatArray, reference: Rotation, known: NDArray[np.bool_], rows: int
) -> tuple[FloatArray, ...]:
    """Turns over ``rows`` rows per second, by the gyro and by the reference, shape (n, 3) each."""
    start = np.arange(0, len(times) - rows, rows)
    end = start + rows
    spans = times[end] - times[start]
    finite = finite_rows(rates)
    by_gyro = _integrated(times, np.where(finite[:, None], rates, 0.0))
    missing = np.concatenate([[0], np.cumsum(~finite)])
    whole = known[start] & known[end] & (missing[end + 1] == missing[start])
    whole &= spans < 1.5 * rows * np.median(np.diff(times))
    start, end, spans = start[whole], end[whole], spans[whole, None]
    return tuple((turns[start].inv() * turns[end]).as_rotvec() / spans for turns in (by_gyro, reference))
