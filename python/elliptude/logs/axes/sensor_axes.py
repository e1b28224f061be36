"""Finds the axes of a vector sensor that fit the turn that the gyro shows: docs/theory.md, section 18.7.

The mean of gravity's or the field's vector over a window, carried along by the gyro, is nearly the same in every window
if the sensor's axes are right: how far it may differ follows from bounds of motion, field and sensors. With wrong axes
it differs by much more once the body turns. All 24 rotations of the axes by quarter and half turns are tried, with the
gyro as it is and with its rates turned round. A vector and its opposite turn alike, so that is all of the 48 signed
permutations of the vector's axes, and of the gyro's. NumPy alone; SI units, or µT.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import mean_error
from elliptude.bounds.stamps import time_offset_angles
from elliptude.bounds.turns import attitudes_from_rates, coning_angles, from_the_first, lengths_of, running_integral
from elliptude.typing import FloatArray

# s; half-lengths of windows are multiples of a cell, which is so long, longer for a slow sensor, and shorter in a short
# recording, of which there are so many at least.
_CELL_S, _SAMPLES, _FEWEST_CELLS = 0.5, 4, 24
_HALF_LENGTHS = (1, 2, 4, 6, 8, 12)
# Distance between the tops of two compared windows, in half-lengths; from 2 on they do not overlap.
_DISTANCES = (2, 3, 4, 6, 8)
# In median steps: nothing is known between samples that are further apart.
_LONGEST_STEP = 10.0
# What is summed over so many rows then stays near the processor.
_CHUNK_ROWS = 1 << 12


def _quarter_turns() -> FloatArray:
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0.0:
                found.append(matrix)
    return np.array(sorted(found, key=lambda matrix: -float(np.trace(matrix))))


ROTATIONS: FloatArray = _quarter_turns()
"""The right-handed signed permutations, shape (24, 3, 3), the identity first."""


@dataclass(frozen=True)
class VectorStatement:
    """Statements about a sensor that shows one vector of the world, and about that vector; in the sensor's unit."""

    offset: Callable[[float], float]
    """Bound of the mean of what is added in the world, acceleration or disturbance, over a window with weights like a
    triangle, by its half-length, s."""
    error: float
    """Error of a sample, as in `elliptude.bounds.samples.VectorSensorBounds`; the next two likewise."""
    averaged_error: float
    scale_error: float
    time_offset: float
    """Bound of its time against the gyro's, s."""
    length: float | None = None
    """Length of the vector itself, if it is known."""
    length_error: float = 0.0
    averaged_over: float = 0.0
    """As there, s."""
    longest_step: float = np.inf
    """The longest step between samples over which a mean of theirs is one of the motion, s."""


@dataclass(frozen=True, eq=False)
class RatesBeside:
    """What is known of N rates beside their error bounds."""

    errors: FloatArray
    """How far the true rate about each row may be from the line between the rows, rad/s, shape (N,)."""
    gaps: NDArray[np.bool_]
    """Steps in which nothing is known of the turn, shape (N - 1,)."""


def misfits(
    times: FloatArray,
    rates: FloatArray,
    vectors: FloatArray,
    gyro: GyroBounds,
    statement: VectorStatement,
    sign: float = 1.0,
    *,
    beside: RatesBeside | None = None,
) -> FloatArray | None:
    """How far each choice of axes is from what is stated: at most 1 if it is right and the statements hold, (18.16).

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    rates : (N, 3) array
        rad/s, known bias subtracted.
    vectors : (N, 3) array
        The axes of the rates as stated; rows may be NaN.
    gyro : GyroBounds
        Error bounds of the rates.
    statement : VectorStatement
    sign : {1, -1}
        What the rates are multiplied by.
    beside : RatesBeside, optional

    Returns
    -------
    (24,) array, or None
        For each of `ROTATIONS`, the largest quotient of difference and bound. None if no two windows have a bound.
    """
    return misfits_of_all(times, rates, [(vectors, statement)], gyro, sign, beside=beside)[0]


def misfits_of_all(
    times: FloatArray,
    rates: FloatArray,
    sensors: Sequence[tuple[FloatArray, VectorStatement]],
    gyro: GyroBounds,
    sign: float = 1.0,
    *,
    beside: RatesBeside | None = None,
) -> list[FloatArray | None]:
    """`misfits` of several sensors, each by itself, in less time: those with the same rate share a carried frame.

    Parameters
    ----------
    times, rates, gyro, sign, beside
        As `misfits` takes them.
    sensors : sequence of tuple of (N, 3) array and VectorStatement
        Each sensor's vectors, as `misfits` takes them.

    Returns
    -------
    list of (24,) array, or None
    """
    frames = _Frames(times, rates, gyro, sign, beside)
    return [_worst(_carried(frames, [sensor]), sensor[1]) for sensor in sensors]


def _worst(carried: "_Carried | None", statement: VectorStatement) -> FloatArray | None:
    """For each of `ROTATIONS` the largest quotient of difference and bound; None if no two windows have a bound."""
    if carried is None:
        return None
    worst = np.zeros(len(ROTATIONS))
    is_told = False
    for windows in carried.cells[0].windows():
        for quotients in windows.quotients(carried.frame, statement):
            np.maximum(worst, quotients.max(axis=1, initial=0.0), out=worst)
            is_told |= quotients.size > 0
    return worst if is_told else None


@dataclass(frozen=True)
class AngleMisfit:
    """How far the angle between two measured vectors is from the stated one."""

    as_stated: float
    """The largest quotient of difference and bound: at most 1 if all that is stated holds, (18.18)."""
    opposite: float
    """The same with the opposite of one of the vectors."""
    median: float
    """Median of the angle between the means over windows, rad."""


def angle_misfit(
    times: FloatArray,
    rates: FloatArray,
    first: tuple[FloatArray, VectorStatement],
    second: tuple[FloatArray, VectorStatement],
    gyro: GyroBounds,
    angle: float,
    angle_error: float,
    *,
    beside: RatesBeside | None = None,
) -> AngleMisfit | None:
    """Whether two vectors are as far from one another as stated, or one and its opposite would be, (18.18).

    Parameters
    ----------
    times, rates, gyro
        As `misfits` takes them.
    first, second : tuple of (N, 3) array and VectorStatement
        Each sensor's vectors, as `misfits` takes them.
    angle, angle_error : float
        Between the vectors in the world, and how far that may be off, rad.
    beside : RatesBeside, optional

    Returns
    -------
    AngleMisfit, optional
        None if no window has both.
    """
    carried = _carried(_Frames(times, rates, gyro, 1.0, beside), [first, second])
    if carried is None:
        return None
    found = []
    for pair in zip(*(cells.windows() for cells in carried.cells), strict=False):
        count = min(len(windows.tops) for windows in pair)
        means, off = [], np.full(count, angle_error)
        for windows, (_, statement) in zip(pair, (first, second), strict=True):
            mean, reach = windows.means_as_stated(carried.frame, statement)
            length = np.linalg.norm(mean, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = reach / length
            # Within the ball about the mean; and it may point anywhere where the ball holds the origin.
            off += np.where(share >= 1.0, np.pi, np.arcsin(np.minimum(share, 1.0)))[:count]
            means.append(mean[:count])
        between = np.arctan2(np.linalg.norm(np.cross(*means), axis=1), np.einsum("ni,ni->n", *means))
        found.append(np.stack([between, off])[:, np.isfinite(off)])
    between, off = np.concatenate(found, axis=1) if found else np.empty((2, 0))
    if not len(between):
        return None
    return AngleMisfit(
        float(np.max(np.abs(between - angle) / off)),
        float(np.max(np.abs(np.pi - between - angle) / off)),
        float(np.median(between)),
    )


@dataclass(frozen=True, eq=False)
class _Frame:
    """The frame that the gyro carries along, and how far it may be off."""

    times: FloatArray
    steady: FloatArray
    """How far it may have turned since the beginning by errors that do not average out."""
    turned: FloatArray
    """The angle that it turned."""
    gyro: GyroBounds


@dataclass(frozen=True, eq=False)
class _Carried:
    frame: _Frame
    cells: list["_Cells"]
    """The cells of each sensor, with the same begin and duration."""


class _Frames:
    """Frames that the same rates carry along: how long a gap counts in one depends on how often a sensor is sampled."""

    def __init__(
        self, times: FloatArray, rates: FloatArray, gyro: GyroBounds, sign: float, beside: RatesBeside | None
    ) -> None:
        self.times, self.rates, self.gyro = times, rates, gyro
        self._sign, self._beside = sign, beside
        self._speeds = lengths_of(rates)
        self._found: dict[float, tuple[_Frame, FloatArray]] = {}

    def with_gaps_for(self, usual: float) -> tuple[_Frame, FloatArray]:
        """The frame for a sensor with usual steps of so many seconds, and its attitudes (N, 3, 3)."""
        if usual not in self._found:
            self._found[usual] = self._carry(usual)
        return self._found[usual]

    def _carry(self, usual: float) -> tuple[_Frame, FloatArray]:
        times, speeds, gyro = self.times, self._speeds, self.gyro
        elapsed, steps = times - times[0], np.diff(times)
        # Across a gap the turn may be anything. Its length does not matter, and a stamp far ahead would make endless
        # cells.
        is_gap = steps > _LONGEST_STEP * np.median(steps)
        more = np.zeros_like(speeds)
        if self._beside is not None:
            is_gap, more = is_gap | self._beside.gaps, self._beside.errors
        gaps = np.concatenate([[0.0], np.cumsum(np.where(is_gap, np.pi, 0.0))])
        short = np.where(is_gap, np.minimum(steps, (_LONGEST_STEP + 1.0) * usual), steps)
        clock = np.concatenate([[0.0], np.cumsum(short)])
        steady = running_integral(clock, gyro.steady_error(speeds, elapsed) + more) + gaps
        steady += from_the_first(coning_angles(short, self.rates))
        frame = _Frame(clock, steady, running_integral(clock, speeds), gyro)
        return frame, attitudes_from_rates(short, self._sign * self.rates)


def _carried(frames: _Frames, sensors: Sequence[tuple[FloatArray, VectorStatement]]) -> _Carried | None:
    """The measurements in the frame that the gyro carries along; None if a sensor has fewer than two vectors."""
    measured = [np.isfinite(vectors).all(axis=1) for vectors, _ in sensors]
    if any(there.sum() < 2 for there in measured):
        return None
    frame, attitudes = frames.with_gaps_for(max(float(np.median(np.diff(frames.times[there]))) for there in measured))
    clock = frame.times
    begin = max(float(clock[there][0]) for there in measured)
    shortest = _SAMPLES * max(float(np.median(np.diff(clock[there]))) for there in measured)
    duration = max(shortest, min(_CELL_S, float(clock[-1] - begin) / _FEWEST_CELLS))
    cells = []
    for there, (vectors, statement) in zip(measured, sensors, strict=True):
        there = there & (clock >= begin)
        if there.sum() < 2:
            return None
        offset = time_offset_angles(frames.times, frames.rates, statement.time_offset, gyro=frames.gyro)
        of_rows = attitudes[there], vectors[there], offset[there]
        cells.append(_Cells(frame, there, *of_rows, begin, duration, statement.longest_step))
    return _Carried(frame, cells)


# Columns of a cell's sums: C ⊗ x, then ‖x‖ times one, steady error, angle turned, time, and offset; last the weight.
_LENGTH, _STEADY, _TURNED, _TIME, _OFFSET, _WEIGHT = range(9 * 3, 9 * 3 + 6)


class _Cells:
    """Integrals over short cells of time, and the same weighed by the place in the cell from 0 to 1."""

    def __init__(
        self,
        frame: _Frame,
        there: NDArray[np.bool_],
        attitudes: FloatArray,
        vectors: FloatArray,
        offset: FloatArray,
        begin: float,
        duration: float,
        longest_step: float,
    ) -> None:
        stamps, steady, turned = frame.times[there], frame.steady[there], frame.turned[there]
        steps = np.diff(stamps)
        median = float(np.median(steps))
        self.begin, self.duration = begin, duration
        place = (stamps - begin) / duration
        count = int(np.floor(place[-1] + 1e-9))  # the last cell is not whole
        self.sums = np.zeros((count + 1, _WEIGHT + 1))
        self.moments = np.zeros_like(self.sums)
        lengths = lengths_of(vectors)
        scalars = (np.ones_like(lengths), steady, turned, stamps - self.begin, offset)
        for first in range(0, len(stamps) - 1, _CHUNK_ROWS):
            rows = slice(first, first + _CHUNK_ROWS + 1)
            products = attitudes[rows, :, :, None] * vectors[rows, None, None, :]
            weighed = [lengths[rows] * scalar[rows] for scalar in scalars]
            columns = np.column_stack([products.reshape(-1, 27), *weighed, np.ones_like(lengths[rows])])
            self._add(place[rows], columns)
        self.whole = self.sums[:, _WEIGHT] > 0.0
        for k in np.flatnonzero(steps > min(_LONGEST_STEP * median, longest_step)):
            self.whole[max(int(place[k]), 0) : int(place[k + 1]) + 1] = False
        self.sums, self.moments, self.whole = self.sums[:count], self.moments[:count], self.whole[:count]
        self.rounding = 32.0 * np.finfo(np.float64).eps * (len(stamps) + 1.0 + float(turned[-1])) * lengths.max()

    def _add(self, places: FloatArray, columns: FloatArray) -> None:
        """Add integrals of values that are on lines between samples, to the cell that each part of a step is in."""
        ends = np.arange(np.floor(places[0]) + 1.0, places[-1])
        behind = np.searchsorted(places, ends)
        share = ((ends - places[behind - 1]) / (places[behind] - places[behind - 1]))[:, None]
        columns = np.insert(columns, behind, (1.0 - share) * columns[behind - 1] + share * columns[behind], axis=0)
        places = np.insert(places, behind, ends)
        cell = np.clip(np.floor(0.5 * (places[1:] + places[:-1])), 0, len(self.sums) - 1).astype(np.intp)
        begins, stops = places[:-1] - cell, places[1:] - cell
        starts = np.flatnonzero(np.diff(cell, prepend=-1))
        weights = (self.duration / 6.0 * (stops - begins))[:, None]
        in_steps = 3.0 * weights * (columns[:-1] + columns[1:])
        self.sums[cell[starts]] += np.add.reduceat(in_steps, starts)
        in_steps = columns[:-1] * (2.0 * begins + stops)[:, None] + columns[1:] * (begins + 2.0 * stops)[:, None]
        self.moments[cell[starts]] += np.add.reduceat(weights * in_steps, starts)

    def windows(self) -> Iterator["_Windows"]:
        """Windows with weights like a triangle, of each half-length."""
        for cells in _HALF_LENGTHS:
            count = len(self.sums) // cells
            if count < 2:
                return
            sums = self.sums[: count * cells].reshape(count, cells, -1)
            moments = self.moments[: count * cells].reshape(count, cells, -1)
            whole: NDArray[np.bool_] = np.all(self.whole[: count * cells].reshape(count, cells), axis=1)
            rising = (np.arange(cells)[None, :, None] * sums + moments).sum(axis=1) / cells
            falling = sums.sum(axis=1) - rising
            half_length = cells * self.duration
            tops = self.begin + half_length * np.arange(1, count, dtype=np.float64)
            whole = whole[:-1] & whole[1:]
            yield _Windows(half_length, self.begin, self.rounding, tops, rising[:-1], falling[1:], whole)


@dataclass(frozen=True, eq=False)
class _Windows:
    half_length: float
    begin: float
    rounding: float
    """Of a mean, in the unit of the vectors."""
    tops: FloatArray
    rising: FloatArray
    """Sums before the top."""
    falling: FloatArray
    whole: NDArray[np.bool_]

    def quotients(self, frame: _Frame, statement: VectorStatement) -> Iterator[FloatArray]:
        """Differences over their bounds, shape (24, any)."""
        rising, falling = self._shares()
        both = rising + falling
        means = np.einsum("kiab,qab->qki", both[:, :27].reshape(-1, 3, 3, 3), ROTATIONS)
        radii = self._radii(both, statement)
        if statement.length is not None:
            lengths = lengths_of(means)
            allowed = radii + self._turn(frame, rising, falling, self.tops, self.half_length) + statement.length_error
            yield _known(np.abs(lengths - statement.length) / allowed)
        for distance in _DISTANCES:
            if distance >= len(self.tops):
                return
            middle = 0.5 * (self.tops[:-distance] + self.tops[distance:])
            longest = (0.5 * distance + 1.0) * self.half_length
            turn = self._turn(frame, both[:-distance], both[distance:], middle, longest)
            allowed = turn + radii[:-distance] + radii[distance:]
            yield _known(lengths_of(means[:, distance:] - means[:, :-distance]) / allowed)

    def means_as_stated(self, frame: _Frame, statement: VectorStatement) -> tuple[FloatArray, FloatArray]:
        """With the axes as stated: the means (k, 3), and how far each may be from the vector, seen from its top."""
        rising, falling = self._shares()
        both = rising + falling
        means = np.einsum("kiaa->ki", both[:, :27].reshape(-1, 3, 3, 3))
        turn = self._turn(frame, rising, falling, self.tops, self.half_length)
        return means, self._radii(both, statement) + turn

    def _shares(self) -> tuple[FloatArray, FloatArray]:
        """Shares of the means from before the top and from after it; NaN where a window is not whole."""
        weight = np.where(self.whole, self.rising[:, _WEIGHT] + self.falling[:, _WEIGHT], np.nan)[:, None]
        return self.rising / weight, self.falling / weight

    def _radii(self, both: FloatArray, statement: VectorStatement) -> FloatArray:
        """How far the world and the sensor may move each mean."""
        k = statement.scale_error
        own = mean_error(
            statement.error, statement.averaged_error, statement.averaged_over, 2.0 * self.half_length, 0.0
        )
        radii: FloatArray = statement.offset(self.half_length) + own + both[:, _OFFSET] + self.rounding
        return radii + k * (both[:, _LENGTH] + statement.error) / (1.0 - k)

    def _turn(
        self, frame: _Frame, earlier: FloatArray, later: FloatArray, at: FloatArray, longest: float
    ) -> FloatArray:
        """The mean of ‖x‖ times the bound of the turn's error between sample and an instant between the two."""

        def between(column: int, running: FloatArray | None) -> FloatArray:
            here = at - self.begin if running is None else np.interp(at, frame.times, running)
            after = later[:, column] - here * later[:, _LENGTH]
            distance: FloatArray = after + here * earlier[:, _LENGTH] - earlier[:, column]
            return np.maximum(distance, 0.0)

        lengths = earlier[:, _LENGTH] + later[:, _LENGTH]
        # Sums on the line between two samples say no less than those at one of them, which is up to a step further.
        longest = longest + float(np.diff(frame.times).max(initial=0.0))
        noise = frame.gyro.noise_angle(between(_TIME, None), between(_TURNED, frame.turned), longest, lengths)
        return between(_STEADY, frame.steady) + noise


def _known(quotients: FloatArray) -> FloatArray:
    return quotients[:, np.isfinite(quotients).all(axis=0)]
