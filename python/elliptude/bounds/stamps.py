"""Time stamps that are off: how far a direction turns within an offset, and how late values are moved to their time.

Needs only NumPy; SI units and radians; rows are instants. Derivation: docs/theory.md, section 18.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.arguments import increasing_times, require_not_negative, vector_rows
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.turns import lengths_of
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
# Pairs of a row and a sample within the offset of its stamp that are looked at one by one.
_MOST_ACROSS = 100


@dataclass(frozen=True, eq=False)
class OffsetTurns:
    """How far measured vectors turn between their rows and the true times of their stamps, (18.59)."""

    angles: FloatArray
    """Bounds of the whole turn, whichever way it goes, rad, shape (N,); as of `time_offset_angles`."""
    slopes: FloatArray
    """How fast each vector changes, body axes, its unit in a second, shape (N, 3); 0 where only the angle is known."""
    known: FloatArray
    """Seconds from the row to the stamp, shape (N,)."""
    common: float
    """Bound of the part of the offset that all vectors of a window share, s."""
    across: FloatArray
    """Bounds of the turn by the measured rate, rad, shape (N,); 0 where there is no slope."""
    others: FloatArray
    """Bounds of what slopes times offsets leave of the turn, rad, shape (N,)."""

    @classmethod
    def any_way(cls, angles: FloatArray) -> "OffsetTurns":
        """Of which nothing is known but how far they turn, rad, shape (N,)."""
        zero = np.zeros_like(angles)
        return cls(angles, np.zeros((len(angles), 3)), zero, 0.0, zero, angles)

    def take(self, rows: NDArray[np.intp]) -> "OffsetTurns":
        """Those of some rows."""
        return OffsetTurns(
            self.angles[rows],
            self.slopes[rows],
            self.known[rows],
            self.common,
            self.across[rows],
            self.others[rows],
        )

    @property
    def has_slopes(self) -> bool:
        """Whether they say more than the angles."""
        return bool(self.across.any()) and (self.common > 0.0 or bool(self.known.any()))


def turns_within_offset(
    times: FloatArray,
    angular_velocities: FloatArray,
    vectors: FloatArray,
    sampled: FloatArray,
    offset: float,
    change: float,
    gyro: GyroBounds,
) -> OffsetTurns:
    """How far vectors turn while their stamps are off, by one offset for all of a window but for a change.

    Parameters
    ----------
    times : (N,) array
        Of the rows, s, increasing.
    angular_velocities : (N, 3) array
        Measured, rad/s, body axes; NaN where there was no sample.
    vectors : (N, 3) array
        Body axes.
    sampled : (N,) array
        Their stamps, s.
    offset : float
        Bound τ of the difference between stamp and true time, s.
    change : float
        How far the offsets of two vectors of a window may differ, s.
    gyro : GyroBounds

    Raises
    ------
    ValueError
        If an offset or a change is out of its range.
    """
    if not change >= 0.0:
        raise ValueError(f"time_offset_change must be at least 0, not {change}")
    angles = time_offset_angles(times, angular_velocities, offset, gyro=gyro, vectors=vectors, sampled=sampled)
    known = sampled - times
    # About the middle of all offsets of a window none is further off than half of their change; nor is the middle
    # nearer to the bound than that.
    beside = min(0.5 * change, offset)
    common = offset - beside
    if common == 0.0 and not known.any():
        return OffsetTurns.any_way(angles)
    offsets = np.abs(known) + offset
    begins, ends = np.minimum(times, sampled) - offset, np.maximum(times, sampled) + offset
    first, last = _samples_in_reach(times, begins, ends)
    speeds = lengths_of(angular_velocities)
    fastest = _range_maximum(speeds, first, last)
    errors = gyro.rate_error(speeds, np.abs(times - times[0]) + offset + np.abs(known).max())
    units = _unit(vectors)
    across = _range_maximum_across(angular_velocities, units, first, last)
    changes = _range_maximum_across(angular_velocities, units, first, last, angular_velocities)
    with np.errstate(invalid="ignore"):  # where too many samples are in reach, and nothing is known across
        turned = offsets * across
        others = offsets * (_range_maximum(errors, first, last) + changes + 0.5 * fastest * turned) + beside * across
        others += 8.0 * _EPSILON * offsets * fastest
    gaps = np.append(np.diff(times) > gyro.longest_interval, False).astype(np.float64)
    within = (begins >= times[0]) & (ends <= times[-1])
    within &= np.isfinite(others) & (_range_maximum(gaps, first, np.maximum(first, last - 1)) == 0.0)
    slopes = np.where(within[:, None], np.cross(angular_velocities, vectors), 0.0)
    return OffsetTurns(angles, slopes, known, common, np.where(within, turned, 0.0), np.where(within, others, angles))


def time_offset_angles(
    times: ArrayLike,
    angular_velocities: ArrayLike,
    offset: float,
    *,
    at: ArrayLike | None = None,
    gyro: GyroBounds | None = None,
    bias_known: float | None = None,
    angular_acceleration: float = 0.0,
    vectors: ArrayLike | None = None,
    sampled: ArrayLike | None = None,
) -> FloatArray:
    """How far a direction in body axes may turn between the time on the stamp and the true one, (18.8).

    Parameters
    ----------
    times : (N,) array
        Of the gyro's samples, s, increasing.
    angular_velocities : (N, 3) array
        Measured, rad/s, body axes.
    offset : float
        Bound τ of the difference between stamp and true time, s.
    at : (M,) array, optional
        The stamps, s; those of the gyro's samples if left out.
    gyro : GyroBounds, optional
        Error bounds of the measured rates; exact if left out. In gaps the rate is at most its largest one, before the
        first and after the last sample also what its angular acceleration makes of that sample's, with the part that
        changes quickly.
    bias_known : float, optional
        When the gyro's bias was known, s, from where on it drifts; at the first row if left out.
    angular_acceleration : float
        Bound between samples, rad/s². With 0 the rate between two samples is at most the larger of them.
    vectors : (N, 3) array, optional
        Of the directions, body axes, at the gyro's samples. If given, only the part of the measured rate across the
        row's own counts.
    sampled : (M,) array, optional
        Their own stamps, s, where ``at`` are those of the rows that they were put into, (18.58): the turn is that from
        there to the row. Those of the rows if left out.

    Returns
    -------
    (M,) array
        rad; NaN where a rate is missing near the row and no largest one is stated. Without ``gyro`` the rate before the
        first and after the last sample counts as that sample's, changing by the angular acceleration.
    """
    require_not_negative("offset", offset)
    require_not_negative("angular_acceleration", angular_acceleration)
    stamps = increasing_times(times)
    wanted = stamps if at is None else increasing_times(at)
    rates = vector_rows("angular_velocities", angular_velocities, len(stamps))
    speeds = lengths_of(rates)
    directions = None if vectors is None else _unit(vector_rows("vectors", vectors, len(wanted)))
    own = wanted if sampled is None else np.asarray(sampled, dtype=np.float64)
    # From the row to the true time, wherever that is about the sample's stamp.
    begins, ends, away = np.minimum(wanted, own) - offset, np.maximum(wanted, own) + offset, np.abs(own - wanted)
    offsets = away + offset
    if not offsets.any():
        return np.zeros_like(wanted)
    # Between samples: at most the larger of both, but in a gap.
    fastest = np.zeros_like(stamps)
    errors = np.zeros_like(stamps)
    if gyro is not None:
        since = stamps - (stamps[0] if bias_known is None else bias_known)
        errors = gyro.rate_error(speeds, np.abs(since) + offset + away.max())
        speeds = speeds + errors
        fastest[:-1][np.diff(stamps) > gyro.longest_interval] = gyro.largest_rate
        if np.isfinite(gyro.largest_rate):
            speeds[np.isnan(speeds)] = gyro.largest_rate
    first, last = _samples_in_reach(stamps, begins, ends)
    steps = np.append(np.diff(stamps), 0.0)
    between = 0.5 * angular_acceleration * np.maximum(_range_maximum(steps, first, last), offsets)
    in_gaps = _range_maximum(fastest, first, np.maximum(first, last - 1))
    largest = _range_maximum(speeds, first, last)
    if directions is not None:
        # Where a rate is missing, the largest one or NaN stays.
        across = _range_maximum_across(rates, directions, first, last) + _range_maximum(errors, first, last)
        largest = np.where(np.isnan(across), largest, np.minimum(across, largest))
    largest = np.maximum(largest, in_gaps)
    largest = largest + between
    # Without a gyro's bounds the rate beyond the samples changes as it does between them.
    known = GyroBounds(0.0, angular_acceleration=angular_acceleration) if gyro is None else gyro
    beyond = _beyond(stamps, speeds, begins, ends, offsets, known, angular_acceleration)
    largest = np.where(np.isnan(largest), largest, np.fmax(largest, beyond))
    # Nothing turns in no time, whatever is known of the rate.
    angles = np.multiply(offsets, largest, out=np.zeros_like(wanted), where=offsets > 0.0)
    return np.minimum(angles, np.pi)


def _beyond(
    stamps: FloatArray,
    speeds: FloatArray,
    begins: FloatArray,
    ends: FloatArray,
    offsets: FloatArray,
    gyro: GyroBounds,
    angular_acceleration: float,
) -> FloatArray:
    """Bound of the mean rate in a part of each interval that no sample covers, rad/s; 0 without one.

    Parameters
    ----------
    stamps, speeds : (N,) array
        Of the samples, s, and what the true rate is at most, rad/s.
    begins, ends : (M,) array
        Of the intervals, s.
    offsets : (M,) array
        How long the parts are at most, s, wherever they are within the intervals.

    Returns
    -------
    (M,) array
    """
    # What is beside the angular acceleration of gaps is a part of at most the noise: it may be the one way in the
    # sample, and the other way beyond it.
    growth, quick = gyro.angular_acceleration, 2.0 * gyro.noise
    if 0.0 < angular_acceleration <= growth:
        growth, quick = angular_acceleration, 0.0
    found = np.zeros_like(begins)
    for lengths, speed in ((stamps[0] - begins, speeds[0]), (ends - stamps[-1], speeds[-1])):
        outside = lengths > 0.0
        # The furthest part is the fastest one: over its length the rate has grown by as much as in its middle.
        length = lengths[outside]
        with np.errstate(invalid="ignore"):  # where nothing is known of the growth
            grown = speed + quick + growth * (length - 0.5 * np.minimum(length, offsets[outside]))
        found[outside] = np.maximum(found[outside], np.fmin(grown, gyro.largest_rate))
    return found


def _range_maximum(values: FloatArray, first: NDArray[np.intp], last: NDArray[np.intp]) -> FloatArray:
    """The largest of values[first..last], each: two overlapping powers of two make up any range."""
    counts = last - first + 1
    result = np.empty(len(first))
    table, width = values, 1
    while True:
        rows = (counts >= width) & (counts < 2 * width)
        result[rows] = np.maximum(table[first[rows]], table[last[rows] - width + 1])
        if counts.max() < 2 * width:
            return result
        table = np.maximum(table[:-width], table[width:])
        width *= 2


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = lengths_of(vectors)[:, None]
    units: FloatArray = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return units


def _range_maximum_across(
    rates: FloatArray,
    directions: FloatArray,
    first: NDArray[np.intp],
    last: NDArray[np.intp],
    less: FloatArray | None = None,
) -> FloatArray:
    """The largest part of rates[first..last], ``less`` the row's own, across the row's direction, each.

    NaN where a rate is missing. Infinite where these are many: each row has a direction of its own, so that all pairs
    would have to be looked at.
    """
    largest = np.where(last - first < _MOST_ACROSS, 0.0, np.inf)
    for i in range(min(int((last - first).max()) + 1, _MOST_ACROSS)):
        there = rates[np.minimum(first + i, last)]
        # maximum, not fmax: a missing rate is not a small one.
        crossed = np.cross(there if less is None else there - less, directions)
        largest = np.maximum(largest, lengths_of(crossed))
    return largest


def _samples_in_reach(
    stamps: FloatArray, begins: FloatArray, ends: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first and last sample that say something of the rate in each interval: those on both sides of it, too."""
    first = np.maximum(np.searchsorted(stamps, begins, side="right") - 1, 0)
    return first, np.minimum(np.searchsorted(stamps, ends, side="left"), len(stamps) - 1)


def shift(times: ArrayLike, values: ArrayLike, delay: float) -> tuple[FloatArray, FloatArray]:
    """Move late values to their time: row n gets the values whose stamp is nearest to its time plus the delay.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    values : (N, ...) array
        With stamps ``times``, late by ``delay``: they show what was true at their stamp less the delay.
    delay : float
        s; negative where values are early.

    Returns
    -------
    shifted : (N, ...) array
        NaN where no value lies within the recording.
    left : (N,) array
        How far the chosen value's time is from the row's, s: to be added to the time offset bound.
    """
    stamps = increasing_times(times)
    return _shifted(stamps, stamps, values, delay)[:2]


def shift_by_own_stamps(
    times: ArrayLike, sampled: ArrayLike, values: ArrayLike, delay: float
) -> tuple[FloatArray, FloatArray]:
    """`shift` of values that have stamps of their own beside those of their rows, as near as the rows are.

    Parameters
    ----------
    times : (N,) array
        Of the rows, s, increasing.
    sampled : (N,) array
        The stamps of the values, s, increasing.
    values : (N, ...) array
    delay : float
        s.

    Returns
    -------
    shifted : (N, ...) array
        As of `shift`.
    sampled : (N,) array
        What time each of these shows, s; two rows may have the same value.
    """
    own = increasing_times(sampled)
    shifted, _, nearest = _shifted(increasing_times(times), own, values, delay)
    return shifted, own[nearest] - delay


def _shifted(
    times: FloatArray, stamps: FloatArray, values: ArrayLike, delay: float
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    numbers = np.asarray(values, dtype=np.float64)
    wanted = times + delay
    after = np.clip(np.searchsorted(stamps, wanted), 1, max(len(stamps) - 1, 1))
    if len(stamps) == 1:
        nearest = np.zeros(1, dtype=np.intp)
    else:
        nearest = np.where(wanted - stamps[after - 1] <= stamps[after] - wanted, after - 1, after)
    left = np.abs(stamps[nearest] - wanted)
    shifted = numbers[nearest].copy()
    shifted[(wanted < stamps[0]) | (wanted > stamps[-1])] = np.nan
    return shifted, left, nearest
