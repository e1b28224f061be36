"""Which axes of a vector sensor fit the turn that the gyro shows: docs/theory.md, section 18.7.

The mean of gravity's or the field's vector over a window, carried along by the gyro, is nearly the same in every window
if the sensor's axes are right: how far it may differ follows from bounds of motion, field and sensors. With wrong axes
it differs by much more once the body turns. All 24 rotations of the axes by quarter and half turns are tried, with the
gyro as it is and with its rates turned round. A vector and its opposite turn alike, so that is all of the 48 signed
permutations of the vector's axes, and of the gyro's. NumPy alone; SI units, or µT.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elliptude.gyro_bounds import GyroBounds
from elliptude.results import FloatArray
from elliptude.time_offsets import time_offset_angles
from elliptude.turns import attitudes_from_rates, running_integral

# s; half-lengths of windows are multiples of a cell that is so long at least, and longer for a slow sensor.
_CELL_S, _SAMPLES = 0.5, 4
_HALF_LENGTHS = (1, 2, 4, 6, 8, 12)
# Between the tops of two windows that are compared, of their half-length; from 2 on they do not overlap.
_DISTANCES = (2, 3, 4, 6, 8)
# Times the median step: nothing is known between samples that are further apart.
_LONGEST_STEP = 10.0
_CHUNK_ROWS = 1 << 15


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
    """What is stated of a sensor that shows one vector of the world, and of that vector; the sensor's unit."""

    offset: Callable[[float], float]
    """Bound of the mean of what is added in the world, acceleration or disturbance, over a window with weights like a
    triangle, by its half-length, s."""
    error: float
    """Of a sample, as in `elliptude.physical_bounds.VectorSensorBounds`; the next two likewise."""
    averaged_error: float
    scale_error: float
    time_offset: float
    """Bound of its time against the gyro's, s."""
    length: float | None = None
    """Of the vector itself, where it is known."""
    length_error: float = 0.0


def misfits(
    times: FloatArray,
    rates: FloatArray,
    vectors: FloatArray,
    gyro: GyroBounds,
    statement: VectorStatement,
    sign: float = 1.0,
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
        Of the rates.
    statement : VectorStatement
    sign : {1, -1}
        What the rates are multiplied by.

    Returns
    -------
    (24,) array, or None
        By `ROTATIONS`: the largest quotient of difference and bound. None where no two windows have a bound.
    """
    there = np.isfinite(vectors).all(axis=1)
    if there.sum() < 2:
        return None
    offset = time_offset_angles(times, rates, statement.time_offset, gyro=gyro)
    speeds = np.linalg.norm(rates, axis=1)
    elapsed, steps = times - times[0], np.diff(times)
    # Over a gap the turn may be anything. Its length says nothing, and a stamp far ahead would make cells without end.
    is_gap = steps > _LONGEST_STEP * np.median(steps)
    gaps = np.concatenate([[0.0], np.cumsum(np.where(is_gap, np.pi, 0.0))])
    enough = (_LONGEST_STEP + 1.0) * float(np.median(np.diff(times[there])))
    steps = np.where(is_gap, np.minimum(steps, enough), steps)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    # Where the carried frame may have turned to since the beginning, without the noise; and the angle that it turned.
    steady = running_integral(times, gyro.steady_error(speeds, elapsed)) + gaps
    turned = running_integral(times, speeds)
    attitudes = attitudes_from_rates(steps, sign * rates)
    cells = _Cells(times[there], attitudes[there], vectors[there], steady[there], turned[there], offset[there])
    worst = np.zeros(len(ROTATIONS))
    is_told = False
    for windows in cells.windows():
        for quotients in windows.quotients(times, steady, turned, gyro, statement):
            np.maximum(worst, quotients.max(axis=1, initial=0.0), out=worst)
            is_told |= quotients.size > 0
    return worst if is_told else None


# Columns of a cell's sums: C ⊗ x, then ‖x‖ times one, steady error, angle turned, time, and offset; last the weight.
_LENGTH, _STEADY, _TURNED, _TIME, _OFFSET, _WEIGHT = range(9 * 3, 9 * 3 + 6)


class _Cells:
    """Integrals over short cells of time, and the same weighed by the place in the cell from 0 to 1."""

    def __init__(
        self,
        stamps: FloatArray,
        attitudes: FloatArray,
        vectors: FloatArray,
        steady: FloatArray,
        turned: FloatArray,
        offset: FloatArray,
    ) -> None:
        steps = np.diff(stamps)
        median = float(np.median(steps))
        self.duration = max(_CELL_S, _SAMPLES * median)
        self.begin = float(stamps[0])
        place = (stamps - self.begin) / self.duration
        cell = np.floor(place + 1e-9).astype(np.intp)
        weights = np.concatenate([[0.0], 0.5 * steps]) + np.concatenate([0.5 * steps, [0.0]])
        count = int(cell[-1])  # the last one is not whole
        self.sums = np.zeros((count + 1, _WEIGHT + 1))
        self.moments = np.zeros_like(self.sums)
        lengths = np.linalg.norm(vectors, axis=1)
        for first in range(0, len(stamps), _CHUNK_ROWS):
            rows = slice(first, first + _CHUNK_ROWS)
            products = attitudes[rows, :, :, None] * vectors[rows, None, None, :]
            scalars = (np.ones_like(lengths), steady, turned, stamps - self.begin, offset)
            weighed = [lengths[rows] * scalar[rows] for scalar in scalars]
            columns = np.column_stack([products.reshape(-1, 27), *weighed, np.ones_like(lengths[rows])])
            columns *= weights[rows, None]
            starts = np.flatnonzero(np.diff(cell[rows], prepend=-1))
            self.sums[cell[rows][starts]] += np.add.reduceat(columns, starts)
            columns *= (place[rows] - cell[rows])[:, None]
            self.moments[cell[rows][starts]] += np.add.reduceat(columns, starts)
        self.whole = self.sums[:, _WEIGHT] > 0.0
        for k in np.flatnonzero(steps > _LONGEST_STEP * median):
            self.whole[cell[k] : cell[k + 1] + 1] = False
        self.sums, self.moments, self.whole = self.sums[:count], self.moments[:count], self.whole[:count]

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
            yield _Windows(half_length, self.begin, tops, rising[:-1], falling[1:], whole[:-1] & whole[1:])


@dataclass(frozen=True, eq=False)
class _Windows:
    half_length: float
    begin: float
    tops: FloatArray
    rising: FloatArray
    """Sums before the top."""
    falling: FloatArray
    whole: NDArray[np.bool_]

    def quotients(
        self, times: FloatArray, steady: FloatArray, turned: FloatArray, gyro: GyroBounds, statement: VectorStatement
    ) -> Iterator[FloatArray]:
        """Differences over their bounds, shape (24, any)."""
        weight = np.where(self.whole, self.rising[:, _WEIGHT] + self.falling[:, _WEIGHT], np.nan)[:, None]
        rising, falling = self.rising / weight, self.falling / weight
        both = rising + falling
        means = np.einsum("kiab,qab->qki", both[:, :27].reshape(-1, 3, 3, 3), ROTATIONS)
        k = statement.scale_error
        radii = statement.offset(self.half_length) + statement.averaged_error + both[:, _OFFSET]
        radii = radii + k * (both[:, _LENGTH] + statement.error) / (1.0 - k)

        def turn(earlier: FloatArray, later: FloatArray, at: FloatArray, longest: float) -> FloatArray:
            """The mean of ‖x‖ times the bound of the turn's error between sample and an instant between the two."""

            def between(column: int, running: FloatArray | None) -> FloatArray:
                here = at - self.begin if running is None else np.interp(at, times, running)
                after = later[:, column] - here * later[:, _LENGTH]
                distance: FloatArray = after + here * earlier[:, _LENGTH] - earlier[:, column]
                return np.maximum(distance, 0.0)

            noise = gyro.noise * between(_TIME, None)
            if np.isfinite(gyro.increment):
                lengths = earlier[:, _LENGTH] + later[:, _LENGTH]
                swept = gyro.increment * (lengths + between(_TURNED, turned))
                noise = np.minimum(noise, swept * (1.0 + 0.5 * gyro.noise * longest))
            return between(_STEADY, steady) + noise

        if statement.length is not None:
            lengths = np.linalg.norm(means, axis=2)
            allowed = radii + turn(rising, falling, self.tops, self.half_length) + statement.length_error
            yield _known(np.abs(lengths - statement.length) / allowed)
        for distance in _DISTANCES:
            if distance >= len(self.tops):
                return
            middle = 0.5 * (self.tops[:-distance] + self.tops[distance:])
            longest = (0.5 * distance + 1.0) * self.half_length
            allowed = turn(both[:-distance], both[distance:], middle, longest) + radii[:-distance] + radii[distance:]
            yield _known(np.linalg.norm(means[:, distance:] - means[:, :-distance], axis=2) / allowed)


def _known(quotients: FloatArray) -> FloatArray:
    return quotients[:, np.isfinite(quotients).all(axis=0)]
