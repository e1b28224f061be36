"""Vectors averaged over windows of a recording in a frame that the gyro carries along, docs/theory.md, section 18."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.carried.frame import CarriedFrame
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.stamps import OffsetTurns
from elliptude.bounds.turns import from_the_first, lengths_of, running_sum
from elliptude.typing import FloatArray

_BLOCK_ROWS = 1 << 16
_EPSILON = float(np.finfo(np.float64).eps)
Place = Literal["end", "middle"]
"""Where in its window a row lies."""


def blocks(times: FloatArray, longest: float, at: Place) -> Iterator[tuple[slice, slice]]:
    """Rows in pieces, each with the rows that its windows reach, so that memory and running sums stay bounded."""
    for start in range(0, len(times), _BLOCK_ROWS):
        stop = min(start + _BLOCK_ROWS, len(times))
        reach = longest * (1.0 + 1e-6)
        # Next to the ends of a recording a window about its row reaches its whole length to one side.
        before, after = (reach, reach) if at == "middle" else (reach, 0.0)
        first = int(np.searchsorted(times, times[start] - before))
        last = int(np.searchsorted(times, times[stop - 1] + after, side="right"))
        yield slice(start, stop), slice(first, last)


@dataclass(frozen=True, eq=False)
class Gaps:
    """What windows reach across without a sample of the sensor."""

    count: FloatArray
    """How many gaps."""
    time: FloatArray
    """How long they are together, s; rounded up."""
    squares: FloatArray
    """The sum of the squares of their lengths, s²; rounded up."""

    def take(self, indices: NDArray[np.intp]) -> "Gaps":
        """Those of some windows."""
        return Gaps(self.count[indices], self.time[indices], self.squares[indices])


@dataclass(frozen=True, eq=False)
class Window:
    """Indices of windows: their beginning, the top of the triangle, their end, and the row that they are for."""

    start: NDArray[np.intp]
    top: NDArray[np.intp]
    stop: NDArray[np.intp]
    row: NDArray[np.intp]
    before: FloatArray
    """From the beginning to the top, s; NaN where the window is not whole."""
    after: FloatArray
    """From the top to the end, s."""
    gaps: Gaps

    def take(self, indices: NDArray[np.intp]) -> "Window":
        """Some of them."""
        return Window(
            self.start[indices],
            self.top[indices],
            self.stop[indices],
            self.row[indices],
            self.before[indices],
            self.after[indices],
            self.gaps.take(indices),
        )


@dataclass(frozen=True, eq=False)
class Average:
    """Weighted means over windows."""

    mean: FloatArray
    """The mean of the vector, in the common frame."""
    length: FloatArray
    """The mean of the vectors' lengths."""
    turn: FloatArray
    """The mean of the lengths times the bound of the turn's error up to the row, rounded up but for time offsets."""
    rounding: FloatArray
    """Bound of what rounding may do to the mean, its length and that of time offsets; theory, section 18.2."""
    rising: FloatArray
    """The part of `length` before the top."""
    falling: FloatArray
    """The part of `length` after the top."""
    swept: FloatArray
    """The mean of the lengths times the angle that the measured rate turns up to the row, rounded up."""
    spanned: FloatArray
    """The mean of the lengths times the time to the row, rounded up."""
    by_stamps: FloatArray
    """What the offsets of the stamps do to the mean at most, if what a wrong frame does is bounded by lengths."""
    by_lengths: FloatArray
    """The mean of the lengths times the turn by the offsets of their stamps: whatever the frame."""
    share: FloatArray
    """What a mean may lose by rounding, of a running sum that is one at the window's end."""
    lost: FloatArray
    """What a mean of lengths may lose by rounding."""
    pieces: FloatArray
    """The mean of the lengths times the number of pieces, between gaps, up to the row; not below `length`."""


class RunningIntegrals:
    """Running integrals of numbers, of which weighted means over windows are differences.

    Parameters
    ----------
    steps : (n - 1,) array
        Between the rows, s.
    values : (n, k) array
    """

    def __init__(self, steps: FloatArray, values: FloatArray) -> None:
        self._steps = steps
        self.once = running_sum(steps, values)
        """From the first row to each, shape (n, k)."""

    @cached_property
    def twice(self) -> FloatArray:
        """The sums of `once`, which triangular weights alone need."""
        return running_sum(self._steps, self.once)

    def sides(self, window: Window, *, triangular: bool) -> tuple[FloatArray, FloatArray]:
        """Weighted means over windows: the parts before the top and after it, shape (m, k) each.

        Parameters
        ----------
        window : Window
        triangular : bool
            Whether the weights rise to the top and fall; they are equal otherwise.
        """
        before, after = window.before[:, None], window.after[:, None]
        span = before + after
        # `take` copies whole rows, which an index of rows does not.
        at_top, at_start, at_stop = (self.once.take(rows, axis=0) for rows in (window.top, window.start, window.stop))
        if not triangular:
            return (at_top - at_start) / span, (at_stop - at_top) / span
        top, start, stop = (self.twice.take(rows, axis=0) for rows in (window.top, window.start, window.stop))
        with np.errstate(invalid="ignore", divide="ignore"):
            below = at_top - (top - start) / before
            above = (stop - top) / after - at_top
        return 2.0 * below / span, 2.0 * above / span

    def means(self, window: Window, *, triangular: bool) -> FloatArray:
        """Both parts of `sides` together, in half the time."""
        span = (window.before + window.after)[:, None]
        if not triangular:
            whole: FloatArray = (self.once.take(window.stop, axis=0) - self.once.take(window.start, axis=0)) / span
            return whole
        start, top, stop = (self.twice.take(rows, axis=0) for rows in (window.start, window.top, window.stop))
        with np.errstate(invalid="ignore", divide="ignore"):
            means: FloatArray = (stop - top) * (2.0 / span / window.after[:, None])
            means -= (top - start) * (2.0 / span / window.before[:, None])
        return means


class Piece:
    """Running integrals of a piece of a recording, from which weighted means over windows are differences.

    Its rows are those with a sample of the sensor.

    Parameters
    ----------
    frame : CarriedFrame
        At the gyro's rows.
    rows : (n,) array
        Which of them have a sample.
    times : (n,) array
        Of these samples, s.
    vectors : (n, 3) array
    offsets : OffsetTurns
        How far the body turns within the offsets of their stamps.
    gyro : GyroBounds
    away : float
        How far samples are from their rows at most, s; their means are over the samples' times.
    across_gaps : bool
        Whether windows reach across gaps between samples, where the frame does.
    """

    def __init__(
        self,
        frame: CarriedFrame,
        rows: NDArray[np.intp],
        times: FloatArray,
        vectors: FloatArray,
        offsets: OffsetTurns,
        gyro: GyroBounds,
        *,
        away: float = 0.0,
        across_gaps: bool = True,
    ) -> None:
        self._times, self._gyro, self.away = times, gyro, away
        self.frame, self.rows = frame, rows
        self.attitudes, self.since_known = frame.attitudes[rows], frame.since_known[rows]
        self.elapsed, self.turned, self.apart = frame.elapsed[rows], frame.turned[rows], frame.apart[rows]
        self.steps = np.diff(self.elapsed)
        self._summed = self.elapsed
        if away > 0.0:
            # No window reaches across a closed gap, which has no length in the sums.
            self.steps = np.where(np.diff(frame.closed[rows]) > 0, 0.0, np.diff(times))
            self._summed = from_the_first(self.steps)
        gaps = (np.diff(frame.gaps[rows]) > 0) | (np.diff(rows) > 1)
        lengths_of_gaps = np.where(gaps, self.steps, 0.0)
        in_gaps = np.column_stack([gaps, lengths_of_gaps, lengths_of_gaps**2])
        self._in_gaps = np.concatenate([np.zeros((1, 3)), np.cumsum(in_gaps, axis=0)])
        self.frame_gaps = frame.gaps[rows].astype(np.float64)
        """How many gaps of the frame there are before each row; one between samples of the sensor may hold several."""
        self._closed = frame.closed[rows] if across_gaps else self._in_gaps[:, 0]
        lengths = lengths_of(vectors)
        self._steady = frame.steady[rows]
        self.carried = np.einsum("nij,nj->ni", self.attitudes, vectors)
        # Columns: the vector, ‖f‖, and ‖f‖ times what bounds its turn: steady error, angle turned, time, offset; gaps.
        weights = lengths[:, None] * np.column_stack(
            [
                np.ones_like(times),
                self._steady,
                self.turned,
                self.elapsed,
                offsets.angles,
                *([self.frame_gaps] if gaps.any() else []),
            ]
        )
        self._sums = RunningIntegrals(self.steps, np.column_stack([self.carried, weights]))
        self._common, self._across = offsets.common, lengths * offsets.across
        self._slopes = self._slope_sums(offsets, lengths) if offsets.has_slopes else None

    def _slope_sums(self, offsets: OffsetTurns, lengths: FloatArray) -> RunningIntegrals:
        """Running integrals for (18.60): ‖f‖ times the turn across, and times what slopes leave; and the slopes.

        These are in the common frame, and those of samples beside their rows also times the known seconds.
        """
        slopes = np.einsum("nij,nj->ni", self.attitudes, offsets.slopes)
        columns = [lengths * offsets.across, lengths * offsets.others, slopes]
        columns += [offsets.known[:, None] * slopes] if offsets.known.any() else []
        return RunningIntegrals(self.steps, np.column_stack(columns))

    @cached_property
    def _across_sums(self) -> RunningIntegrals:
        """Of ‖f‖ times the turn across, alone and times what the columns of `_sums` have."""
        running = [np.ones_like(self._across), self._steady, self.turned, self.elapsed, self.frame_gaps]
        return RunningIntegrals(self.steps, self._across[:, None] * np.column_stack(running))

    def window(
        self, rows: NDArray[np.intp], duration: float, at: Place, ends: tuple[float, float] = (-np.inf, np.inf)
    ) -> Window:
        """The windows of the rows, as long as the recording allows.

        Next to one of its ``ends`` a row is not in the middle of its window, so that this keeps its length.
        """
        times, here = self._times, self._times[rows]
        slack = 1e-9 * duration
        if at == "middle":
            first = np.maximum(np.minimum(here - 0.5 * duration, ends[1] - duration), ends[0])
            last = np.minimum(np.maximum(here + 0.5 * duration, ends[0] + duration), ends[1])
            start = np.searchsorted(times, first - slack)
            stop = np.searchsorted(times, last + slack, side="right") - 1
        else:
            start, stop = np.searchsorted(times, here - duration - slack), rows
        return self.between(start, stop, rows, at)

    def between(self, start: NDArray[np.intp], stop: NDArray[np.intp], rows: NDArray[np.intp], at: Place) -> Window:
        """The windows of the rows with these ends; a row is in the middle if it is not its window's end."""
        times = self._times
        top = rows if at == "middle" else np.searchsorted(times, 0.5 * (times[start] + times[stop]))
        whole = (times[stop] > times[start]) & (self._closed[stop] == self._closed[start])
        before = np.where(whole, times[top] - times[start], np.nan)
        # As many sums were rounded as there are gaps.
        in_gaps = self._in_gaps[stop] - self._in_gaps[start]
        in_gaps[:, 1:] += _EPSILON * self._in_gaps[stop, :1] * self._in_gaps[stop, 1:]
        return Window(start, top, stop, rows, before, times[stop] - times[top], Gaps(*in_gaps.T))

    def averages(self, window: Window, *, triangular: bool) -> Iterator[Average]:
        """Means with equal weights, then with those of a triangle."""
        span = window.before + window.after
        count = self.rows[window.stop] - self.rows[window.start]
        # What the additions of a running sum, as many as the window has, may lose of a mean, if the sum ends at one.
        share = _EPSILON * (count + 20.0) / span
        yield self._average(window, share, triangular=False)
        if triangular:
            half = np.minimum(window.before, window.after)
            halves = self._summed[window.stop] / np.where(half > 0.0, half, np.nan)
            share = _EPSILON * (count + 30.0 + (count + 2.0) * halves) / span
            yield self._average(window, share, triangular=True)

    def _average(self, window: Window, share: FloatArray, *, triangular: bool) -> Average:
        rising, falling = self._sums.sides(window, triangular=triangular)
        both = rising + falling
        lost = share * self._sums.once[window.stop, 3]

        def between(column: int, running: FloatArray) -> FloatArray:
            return _between(window, rising[:, [3, column]], falling[:, [3, column]], running, lost)

        spanned, swept = between(6, self.elapsed), between(5, self.turned)
        pieces = both[:, 3]
        if self._sums.once.shape[1] > 8:
            pieces = pieces + between(8, self.frame_gaps)
        noise = self._noise(window, spanned, swept, pieces + lost)
        turned = self.turned[window.stop] - self.turned[window.start]
        rounding = 2.0 * lost + share * self._sums.once[window.stop, 7]
        steps = self.rows[window.stop] - self.rows[window.start] + 1
        rounding += 32.0 * _EPSILON * (steps + turned) * both[:, 3]
        by_stamps = by_lengths = both[:, 7]
        if self._slopes is not None:
            by_stamps = np.fmin(by_lengths, self._by_slopes(window, share, steps + turned, triangular=triangular))
        return Average(
            mean=both[:, :3],
            length=both[:, 3],
            turn=between(4, self._steady) + noise + by_stamps,
            rounding=rounding,
            rising=rising[:, 3],
            falling=falling[:, 3],
            swept=swept,
            spanned=spanned,
            by_stamps=by_stamps,
            by_lengths=by_lengths,
            share=share,
            lost=lost,
            pieces=pieces,
        )

    def _by_slopes(self, window: Window, share: FloatArray, counted: FloatArray, *, triangular: bool) -> FloatArray:
        """What offsets of stamps do to means in the carried frame, (18.60)."""
        assert self._slopes is not None
        means = self._slopes.means(window, triangular=triangular)
        found = self._common * lengths_of(means[:, 2:5]) + means[:, 1]
        if means.shape[1] > 5:
            found += lengths_of(means[:, 5:8])
        # Six sums of slopes, of which none is longer than what is across; and the frame that they are in.
        lost = share[:, None] * self._slopes.once.take(window.stop, axis=0)[:, :2]
        found += 4.0 * lost[:, 0] + lost[:, 1] + 32.0 * _EPSILON * counted * means[:, 0]
        return found

    def by_stamps_of_frame(
        self, window: Window, average: Average, indices: NDArray[np.intp], *, triangular: bool
    ) -> FloatArray:
        """What offsets do to means, also because the frame is off that they turn vectors in, (18.60).

        Parameters
        ----------
        window : Window
            Those at the indices.
        average : Average
            Of all windows.
        indices : (m,) array
        triangular : bool
            Which weights these are.

        Returns
        -------
        (m,) array
            The sensor's unit.
        """
        by_lengths = average.by_lengths[indices]
        if self._slopes is None:
            return by_lengths
        rising, falling = self._across_sums.sides(window, triangular=triangular)
        lost = average.share[indices] * self._across_sums.once[window.stop, 0]

        def between(column: int, running: FloatArray) -> FloatArray:
            return _between(window, rising[:, [0, column]], falling[:, [0, column]], running, lost)

        pieces = rising[:, 0] + falling[:, 0] + between(4, self.frame_gaps) + lost
        noise = self._noise(window, between(3, self.elapsed), between(2, self.turned), pieces)
        return np.fmin(by_lengths, average.by_stamps[indices] + between(1, self._steady) + noise)

    def _noise(self, window: Window, spanned: FloatArray, swept: FloatArray, pieces: FloatArray) -> FloatArray:
        """The mean of what noise turns the frame away between each sample and the row."""
        at_top = window.row == window.top
        longest = np.where(at_top, np.maximum(window.before, window.after), window.before + window.after)
        return self._gyro.noise_angle(spanned, swept, longest + 2.0 * self.away, pieces)


def _between(
    window: Window, rising: FloatArray, falling: FloatArray, running: FloatArray, lost: FloatArray
) -> FloatArray:
    """The mean of a weight times what grows between each sample and the row: an error, an angle, or the time.

    The row is at the top or at the end, so that each side of the top lies on one side of the row. Rounding is in
    proportion to how far these have grown by the window's end.

    Parameters
    ----------
    window : Window
    rising, falling : (m, 2) array
        The means, before the top and after it, of the weight, and of the weight times what has grown by then.
    running : (n,) array
        What has grown by each row.
    lost : (m,) array
        What a mean of the weight may lose by rounding.
    """
    at_row, at_top = running[window.row], window.row == window.top
    before_row = at_row * rising[:, 0] - rising[:, 1]
    after_row = falling[:, 1] - at_row * falling[:, 0]
    difference = np.maximum(before_row + np.where(at_top, after_row, -after_row), 0.0)
    rounded: FloatArray = difference + 3.0 * lost * running[window.stop]
    return rounded
