"""Bounds proposed from a recording: how large errors and motions were in it, as quantiles and maxima.

What was seen in one recording is no promise about the next: a quantile, a maximum and either with a margin are all
*proposals*, places to start from. A guarantee needs a reason that the number cannot be exceeded: a datasheet, the size
of a room, the speed of an arm. Nothing here is called more than it is. Arrays in, dataclasses out; NumPy and SciPy.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from elliptude.bounds.gyro import longest_interval_of
from elliptude.bounds.rest import rest_rows
from elliptude.bounds.stamps import shift as shifted_back
from elliptude.bounds.turns import attitudes_from_rates
from elliptude.typing import FloatArray
from elliptude.units import STANDARD_GRAVITY

WINDOWS_S = (1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 256.0, 1024.0)
"""Over which the turn by the gyro is compared with the reference's: those up to a quarter of the recording."""
_LONGEST_INCREMENT_S = 16.0
# A scale error is said where it is known with this standard error: what turns too little about some axis tells nothing.
_SCALE_WITHIN = 0.01
# s; a rest is cut into pieces so long, and what is averaged is averaged over one.
_PIECE_S = 0.5


@dataclass(frozen=True)
class Quantiles:
    """How large a number was in a recording. Not one of them bounds what another recording holds."""

    count: int
    half: float
    """50 % of the samples are at or below it; the names below likewise."""
    ninety: float
    ninety_nine: float
    ninety_nine_point_nine: float
    maximum: float


def quantiles(values: ArrayLike) -> Quantiles | None:
    """Quantiles of what is finite among the values, shape (N,); None where nothing is."""
    array = np.asarray(values, dtype=np.float64)
    array = array[np.isfinite(array)]
    if not len(array):
        return None
    half, ninety, ninety_nine, most, maximum = np.quantile(array, [0.5, 0.9, 0.99, 0.999, 1.0])
    return Quantiles(len(array), float(half), float(ninety), float(ninety_nine), float(most), float(maximum))


# --- gyro -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class GyroProposal:
    """What a recording shows of its gyro; rad, s."""

    bias: FloatArray | None
    """Mean over rest, shape (3,); without rest the mean against the reference, and None without that."""
    bias_spread: Quantiles | None
    """Of a piece at rest, its mean's distance from the bias: what the bias did in this recording."""
    noise: Quantiles | None
    """At rest, a sample's distance from the bias."""
    speed: Quantiles | None
    """Of the rate without the bias."""
    rate_error: Quantiles | None
    """Against the reference's increments over 0.05 s or one row, whichever is longer; its jitter is in it."""
    window_angles: dict[float, Quantiles | None]
    """By how much the turn over a window (its duration in s) is off against the reference."""
    scale_error: float | None
    """Spectral norm of the matrix that explains the reference's increments best, less the identity; None where the
    recording hardly turns about some axis."""
    sums_rest: Quantiles | None
    """What the noise adds up to, rad: for each phase of rest the diagonal of the box about the integral of the rate
    less its mean in that phase. A constant bias in each phase, and noise whose integral over any window is at most so
    long, explain what was seen there."""
    unexplained: Quantiles | None
    """Of the windows above of up to 16 s, what ``bias_spread`` and ``scale_error`` leave unexplained of the error of
    the turn, rad; the reference's jitter is in it. None without a reference."""
    longest_interval: float = np.inf
    """Between samples, s: 1.5 times the usual one. All of the above is of intervals up to it, and of no window over a
    longer one."""


def propose_gyro(
    times: ArrayLike,
    angular_velocities: ArrayLike,
    resting: NDArray[np.bool_],
    attitudes: ArrayLike | None = None,
    *,
    delay: float = 0.0,
    piece: float = _PIECE_S,
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
        How late the gyro is against the reference, s; it is taken out before they are compared.
    piece : float
        How long a piece of rest is for the bias's spread, s.

    Returns
    -------
    GyroProposal
    """
    stamps, rates = np.asarray(times, dtype=np.float64), np.asarray(angular_velocities, dtype=np.float64)
    finite = _finite(rates)
    longest = longest_interval_of(np.diff(stamps), None)
    gaps = np.concatenate([[0], np.cumsum(np.diff(stamps) > longest)])
    still = resting & finite
    bias = rates[still].mean(axis=0) if still.any() else None
    noise = spread = sums = None
    if bias is not None:
        sums = quantiles(_sums_at_rest(stamps, rates, still))
        noise = quantiles(np.linalg.norm(rates[still] - bias, axis=1))
        means, _ = _means_of_pieces(stamps, rates, still, piece)
        spread = quantiles(np.linalg.norm(means - bias, axis=1))
    rate_error, windows, scale = None, {}, None
    unexplained: list[FloatArray] = []
    if attitudes is not None:
        reference, known = _rotations(attitudes)
        step = float(np.median(np.diff(stamps)))
        rates = np.column_stack([np.interp(stamps + delay, stamps, column) for column in rates.T])
        finite = _finite(rates)
        rows = max(round(0.05 / step), 1)
        shown, true = _increments(stamps, rates, reference, known, rows)
        # The reference's jitter spoils short increments; beyond a radian a scale error is more than a factor.
        fast = np.quantile(np.linalg.norm(true, axis=1), 0.9) if len(true) else 0.0
        longer = max(round(min(0.5 / max(fast, 1.0), 0.5) / step), 1)
        mean_rates, increments = _increments(stamps, rates, reference, known, longer)
        if len(increments) > 12:
            # ω̃ = M ω + b, so M and b fit the turns per second by the gyro to those by the reference.
            unknowns = np.column_stack([increments, np.ones(len(increments))])
            matrix = np.linalg.lstsq(unknowns, mean_rates, rcond=None)[0].T
            residual = np.sqrt(np.mean((mean_rates - unknowns @ matrix.T) ** 2))
            turned_least = np.linalg.svd(increments - increments.mean(axis=0), compute_uv=False)[-1]
            if residual <= _SCALE_WITHIN * turned_least:
                scale = float(np.linalg.norm(matrix[:, :3] - np.eye(3), 2))
        if bias is None and len(true):
            bias = (shown - true).mean(axis=0)
        offset = np.zeros(3) if bias is None else bias
        rate_error = quantiles(np.linalg.norm(shown - offset - true, axis=1))
        turned = _integrated(stamps, np.where(finite[:, None], rates, 0.0) - offset)
        swept = _running_sums(stamps, np.linalg.norm(np.where(finite[:, None], rates, 0.0) - offset, axis=1))
        missing = np.concatenate([[0], np.cumsum(~(finite & known))])
        for duration in WINDOWS_S:
            if duration > 0.25 * (stamps[-1] - stamps[0]):
                break
            end = np.searchsorted(stamps, stamps + duration)
            start = np.flatnonzero(end < len(stamps))
            end = end[start]
            whole = np.asarray((missing[end + 1] == missing[start]) & (gaps[end] == gaps[start]))
            start, end = start[whole], end[whole]
            by_gyro = turned[start].inv() * turned[end]
            by_reference = reference[start].inv() * reference[end]
            angles = (by_reference.inv() * by_gyro).magnitude()
            windows[duration] = quantiles(angles)
            if duration <= _LONGEST_INCREMENT_S:
                explained = (scale or 0.0) * (swept[end] - swept[start])
                explained += (0.0 if spread is None else spread.maximum) * duration
                unexplained.append(np.maximum(angles - explained, 0.0))
    left = quantiles(np.concatenate(unexplained)) if unexplained else None
    speed = quantiles(np.linalg.norm(rates - (0.0 if bias is None else bias), axis=1))
    return GyroProposal(bias, spread, noise, speed, rate_error, windows, scale, sums, left, longest)


def _means_of_pieces(
    times: FloatArray, values: FloatArray, chosen: NDArray[np.bool_], piece: float = _PIECE_S
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Means of the chosen rows in each piece of the recording, shape (n, 3), and to which each chosen row belongs."""
    numbers = np.floor((times[chosen] - times[0]) / piece + 1e-9).astype(np.intp)
    starts = np.flatnonzero(np.diff(numbers, prepend=-1))
    means: FloatArray = np.add.reduceat(values[chosen], starts) / np.diff(starts, append=len(numbers))[:, None]
    return means, np.cumsum(np.diff(numbers, prepend=-1) > 0) - 1


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


def _finite(rows: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(rows).all(axis=1), dtype=np.bool_)


def _rotations(quaternions: ArrayLike) -> tuple[Rotation, NDArray[np.bool_]]:
    array = np.asarray(quaternions, dtype=np.float64)
    known = _finite(array) & (np.linalg.norm(array, axis=1) > 0.0)
    return Rotation.from_quat(np.where(known[:, None], array, [1.0, 0.0, 0.0, 0.0]), scalar_first=True), known


def _integrated(times: FloatArray, rates: FloatArray) -> Rotation:
    """Attitudes from the first row's body axes; the rate in a step is the mean of its ends."""
    return Rotation.from_matrix(attitudes_from_rates(np.diff(times), rates))


def _increments(
    times: FloatArray, rates: FloatArray, reference: Rotation, known: NDArray[np.bool_], rows: int
) -> tuple[FloatArray, ...]:
    """Turns over ``rows`` rows per second, by the gyro and by the reference, shape (n, 3) each."""
    start = np.arange(0, len(times) - rows, rows)
    end = start + rows
    spans = times[end] - times[start]
    finite = _finite(rates)
    by_gyro = _integrated(times, np.where(finite[:, None], rates, 0.0))
    missing = np.concatenate([[0], np.cumsum(~finite)])
    whole = known[start] & known[end] & (missing[end + 1] == missing[start])
    whole &= spans < 1.5 * rows * np.median(np.diff(times))
    start, end, spans = start[whole], end[whole], spans[whole, None]
    return tuple((turns[start].inv() * turns[end]).as_rotvec() / spans for turns in (by_gyro, reference))


# --- accelerometer and magnetometer -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class VectorProposal:
    """What a recording shows of an accelerometer or a magnetometer; the sensor's unit, rad."""

    reference: FloatArray | None
    """The vector in reference axes that is compared with, shape (3,); None without a reference attitude."""
    magnitude: float
    """Its length: gravity, or the field's median length at rest (of all rows where nothing is at rest)."""
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
    """Of the means over 0.5 s at rest: of the vector against the reference attitude, or without one of the length."""
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
    turns, known = _rotations(attitudes)
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
        # Needs rests in more than one pose to mean something; with one, the turn about the vector stays zero.
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


def _with_averages(
    vector: VectorProposal,
    times: FloatArray,
    rows: FloatArray,
    resting: NDArray[np.bool_],
    attitudes: FloatArray | None,
    reference: FloatArray | None,
) -> VectorProposal:
    """The proposal with what averages over pieces of rest show."""
    still = resting & _finite(rows)
    if not still.any():
        return vector
    means, piece = _means_of_pieces(times, rows, still)
    scatter = quantiles(np.linalg.norm(rows[still] - means[piece], axis=1))
    off = np.abs(np.linalg.norm(means, axis=1) - vector.magnitude)
    if attitudes is not None and reference is not None:
        turns, known = _rotations(attitudes)
        still &= known
        if still.any():
            differences, _ = _means_of_pieces(times, rows - turns.inv().apply(reference), still)
            off = np.linalg.norm(differences, axis=1)
    return replace(vector, averaged_rest=quantiles(off), scatter_rest=scatter)


def _best_turn(expected: FloatArray, measured: FloatArray) -> Rotation:
    """The small turn about which cross products vanish in the mean, by least squares of least length; iterated."""
    turn = Rotation.identity()
    goal = expected / np.linalg.norm(expected, axis=1, keepdims=True)
    start = measured / np.linalg.norm(measured, axis=1, keepdims=True)
    for _ in range(10):
        here = turn.apply(start)
        # (φ × b) = e - b: least squares in φ.
        normal = len(here) * np.eye(3) - here.T @ here
        step = np.linalg.lstsq(normal, np.cross(here, goal).sum(axis=0), rcond=1e-3)[0]
        turn = Rotation.from_rotvec(step) * turn
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


# --- time -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DelayProposal:
    """How late a signal seems; s."""

    delay: float
    """Positive: what the signal shows at a stamp was true that much earlier."""
    pieces: int
    """How many pieces of the recording moved enough to tell."""
    scatter: float
    """The largest difference between a piece's delay and this one."""
    step: float
    """Between samples: nothing is known below a part of it."""


def delay_of_rates(
    times: ArrayLike, angular_velocities: ArrayLike, attitudes: ArrayLike, *, limit: float = 0.1, piece: float = 8.0
) -> DelayProposal | None:
    """How late the gyro is against the reference, from the shift that makes both rates agree best.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    angular_velocities : (N, 3) array
        rad/s.
    attitudes : (N, 4) array
        The reference (qw, qx, qy, qz).
    limit : float
        Delays up to this size are tried, s.
    piece : float
        The recording is cut into pieces of this length, s.

    Returns
    -------
    DelayProposal or None
        None where nothing moves enough.
    """
    stamps, rates = np.asarray(times, dtype=np.float64), np.asarray(angular_velocities, dtype=np.float64)
    reference, known = _rotations(attitudes)
    if len(stamps) < 3:
        return None
    spans = stamps[2:] - stamps[:-2]
    turns = np.full_like(rates, np.nan)
    turns[1:-1] = (reference[:-2].inv() * reference[2:]).as_rotvec() / spans[:, None]
    turns[1:-1][~(known[:-2] & known[2:])] = np.nan
    turns[1:-1][spans > longest_interval_of(spans, None)] = np.nan  # of a gap the gyro knows nothing
    return _delay(stamps, lambda shifted: rates - shifted, turns, limit, piece)


def delay_of_vectors(
    times: ArrayLike, vectors: ArrayLike, angular_velocities: ArrayLike, *, limit: float = 0.1, piece: float = 8.0
) -> DelayProposal | None:
    """How late a vector sensor is against the gyro, no reference needed: b' = -ω × b holds with the ω of then.

    For a vector that is constant in space: the magnetic field, or the specific force as far as gravity outweighs
    motion. Arguments are those of `delay_of_rates`.

    Returns
    -------
    DelayProposal or None
        None where nothing turns enough.
    """
    stamps, rows = np.asarray(times, dtype=np.float64), np.asarray(vectors, dtype=np.float64)
    rates = np.asarray(angular_velocities, dtype=np.float64)
    if len(stamps) < 3:
        return None
    # Both sides as a mean over about 0.1 s, or noise drowns the derivative.
    half = max(round(0.05 / float(np.median(np.diff(stamps)))), 1)
    if len(stamps) <= 2 * half:
        return None
    steps = np.diff(stamps)[:, None]
    spans = (stamps[2 * half :] - stamps[: -2 * half])[:, None]

    def difference(shifted: FloatArray) -> FloatArray:
        turning = -np.cross(shifted, rows)
        running = np.concatenate(
            [np.zeros((1, 3)), np.cumsum(0.5 * steps * np.nan_to_num(turning[1:] + turning[:-1]), axis=0)]
        )
        result = np.full_like(rows, np.nan)
        result[half:-half] = (
            (rows[2 * half :] - rows[: -2 * half]) - (running[2 * half :] - running[: -2 * half])
        ) / spans
        result[half:-half][spans[:, 0] > longest_interval_of(spans, None)] = np.nan  # reaches over a gap
        return result

    return _delay(stamps, difference, rates, limit, piece)


def _delay(
    times: FloatArray, difference: Callable[[FloatArray], FloatArray], signal: FloatArray, limit: float, piece: float
) -> DelayProposal | None:
    """The shift of ``signal`` at which the mean square of the difference is least, for the whole and for each piece."""
    step = float(np.median(np.diff(times)))
    most = min(round(limit / step), len(times) // 4)
    if most < 1:
        return None
    shifts = np.arange(-most, most + 1) * step
    numbers = np.floor((times - times[0]) / piece).astype(np.intp)
    inside = (times >= times[0] + most * step) & (times <= times[-1] - most * step)
    sums: FloatArray = np.zeros((len(shifts), numbers[-1] + 1))
    counts = np.zeros_like(sums)
    for n, shift in enumerate(shifts):
        # The signal at the stamp less the delay.
        late = np.column_stack([np.interp(times - shift, times, column) for column in signal.T])
        squares = np.sum(difference(late) ** 2, axis=1)
        usable = inside & np.isfinite(squares)
        sums[n] = np.bincount(numbers[usable], squares[usable], len(sums[n]))
        counts[n] = np.bincount(numbers[usable], minlength=len(sums[n]))
    with np.errstate(invalid="ignore", divide="ignore"):
        costs: FloatArray = sums / counts
    whole: FloatArray = sums.sum(axis=1) / np.maximum(counts.sum(axis=1), 1.0)
    delay = _lowest(shifts, whole)
    if delay is None:
        return None
    moving = [_lowest(shifts, cost) for cost in costs.T]
    told = [one for one in moving if one is not None]
    scatter = max((abs(one - delay) for one in told), default=0.0)
    return DelayProposal(delay, len(told), scatter, step)


def _lowest(shifts: NDArray[np.floating[Any]], costs: NDArray[np.floating[Any]]) -> float | None:
    """Where a parabola through the least cost and its neighbours is least; None at an end or if the costs are flat."""
    if not np.isfinite(costs).all():
        return None
    n = int(np.argmin(costs))
    # Flat: no shift makes matters twice as bad as the best one.
    if n in (0, len(costs) - 1) or costs.max() < 2.0 * costs[n]:
        return None
    left, middle, right = costs[n - 1 : n + 2]
    curvature = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    return float(shifts[n] + offset * (shifts[1] - shifts[0]))


# --- all of it --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording with N rows; what was not measured is None."""

    times: FloatArray
    """s, increasing, shape (N,)."""
    angular_velocities: FloatArray
    """rad/s, body axes, shape (N, 3)."""
    specific_forces: FloatArray | None = None
    """m/s², body axes, up at rest, shape (N, 3)."""
    fields: FloatArray | None = None
    """µT, body axes, shape (N, 3)."""
    attitudes: FloatArray | None = None
    """The reference (qw, qx, qy, qz) from body to reference axes (third axis up), shape (N, 4)."""
    shared_stamps: float = 1.0
    """The share of rows at which all sensors were sampled; at the others their vectors are interpolated."""


@dataclass(frozen=True)
class StartProposal:
    """What a recording that starts at rest shows against that rest."""

    duration: float
    """Of the rest, s."""
    bias_moved: Quantiles | None
    """Of a piece at rest anywhere, its mean's distance from the gyro's mean over the rest at the start, rad/s."""
    field_moved: Quantiles | None
    """Against the mean field of that rest, its delay taken out, µT: length of the vector difference with a reference
    attitude, without one the difference of the lengths."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """What a recording shows of itself."""

    duration: float
    """s."""
    rest: float
    """Share of rows at rest."""
    gyro: GyroProposal
    accelerometer: VectorProposal | None
    magnetometer: VectorProposal | None
    dip: Quantiles | None
    """Scatter of the angle between field and specific force at rest, rad."""
    gyro_delay: DelayProposal | None
    """Against the reference."""
    magnetometer_delay: DelayProposal | None
    """Against the gyro."""
    rests: list[tuple[float, float]]
    """First and last time of each phase of rest, s."""
    start: StartProposal | None
    """None where the recording does not start at rest."""


def propose(recording: Recording, *, gravity: float = STANDARD_GRAVITY) -> Proposal:
    """Measure how large errors and motions were in a recording, with its reference attitude where it has one.

    Parameters
    ----------
    recording : Recording
    gravity : float
        m/s².

    Returns
    -------
    Proposal
    """
    times, rates = recording.times, recording.angular_velocities
    forces, fields, attitudes = recording.specific_forces, recording.fields, recording.attitudes
    if forces is None:
        resting = np.zeros(len(times), dtype=np.bool_)
    else:
        resting = rest_rows(
            times, rates, forces, duration=0.5, rate_deviation=np.deg2rad(1.0), rate=np.deg2rad(5.0),
            acceleration_deviation=0.5,
        )  # fmt: skip
        # Nobody knows of a rest across a gap whether it is one.
        resting[:-1] &= np.diff(times) <= longest_interval_of(np.diff(times), None)
    # A constant bias says nothing of the delay.
    gyro_delay = None if attitudes is None else delay_of_rates(times, rates, attitudes)
    delay = 0.0 if gyro_delay is None else gyro_delay.delay
    gyro = propose_gyro(times, rates, resting, attitudes, delay=delay)
    unbiased = rates if gyro.bias is None else rates - gyro.bias
    up = None if attitudes is None else np.array([0.0, 0.0, gravity])
    accelerometer = magnetometer = magnetometer_delay = None
    if forces is not None:
        accelerometer = propose_vector(forces, resting, attitudes, up, gravity)
        accelerometer = _with_averages(accelerometer, times, forces, resting, attitudes, up)
    if fields is not None:
        magnetometer = propose_vector(fields, resting, attitudes)
        magnetometer = _with_averages(magnetometer, times, fields, resting, attitudes, magnetometer.reference)
        magnetometer_delay = delay_of_vectors(times, fields, unbiased)
    late = 0.0 if magnetometer_delay is None else magnetometer_delay.delay
    return Proposal(
        duration=float(times[-1] - times[0]),
        rest=float(resting.mean()),
        gyro=gyro,
        accelerometer=accelerometer,
        magnetometer=magnetometer,
        dip=None if forces is None or fields is None else dip_scatter(forces, fields, resting),
        gyro_delay=gyro_delay,
        magnetometer_delay=magnetometer_delay,
        rests=_spans(times, resting),
        start=_against_the_start(recording, resting, delay + late) if resting[0] else None,
    )


def _against_the_start(recording: Recording, resting: NDArray[np.bool_], late: float) -> StartProposal:
    """What differs from the rest at the start; ``late`` is the magnetometer's delay against the reference, s."""
    times, rates = recording.times, recording.angular_velocities
    begin, end = _spans(times, resting)[0]
    at_start, still = resting & (times <= end), resting & _finite(rates)
    bias_moved = None
    if (at_start & still).any():
        means, _ = _means_of_pieces(times, rates, still)
        bias_moved = quantiles(np.linalg.norm(means - rates[at_start & still].mean(axis=0), axis=1))
    field_moved = None
    if recording.fields is not None and _finite(recording.fields[at_start]).any():
        fields, _ = shifted_back(times, recording.fields, late)
        off = np.abs(np.linalg.norm(fields, axis=1) - np.linalg.norm(np.nanmean(recording.fields[at_start], axis=0)))
        if recording.attitudes is not None:
            turns, known = _rotations(recording.attitudes)
            there = at_start & known & _finite(recording.fields)
            if there.any():
                reference = turns[there].apply(recording.fields[there]).mean(axis=0)
                off = np.linalg.norm(fields - turns.inv().apply(reference), axis=1)[known]
        field_moved = quantiles(off)
    return StartProposal(end - begin, bias_moved, field_moved)


def _spans(times: FloatArray, chosen: NDArray[np.bool_]) -> list[tuple[float, float]]:
    changes = np.flatnonzero(np.diff(chosen, prepend=False, append=False))
    return [(float(times[begin]), float(times[end - 1])) for begin, end in changes.reshape(-1, 2)]
