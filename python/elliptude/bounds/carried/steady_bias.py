"""What a gyro's bias that hardly changes does to a mean over a window about its row: docs/theory.md, 18.12.

Before the row and after it such a bias turns the carried frame in opposite ways.
"""

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.carried.second_order import crossed, largest_singular_values
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.turns import from_the_first, lengths_of, running_sum
from elliptude.bounds.window_averages import Average, Piece, RunningIntegrals, Window
from elliptude.typing import FloatArray


class SteadyBias:
    """Running integrals of a piece from which the effect of a bias follows that hardly changes within a window.

    Parameters
    ----------
    piece : Piece
    gyro : GyroBounds
        With a bias, and how far it changes.
    straight : (n,) array
        q, rad.
    """

    def __init__(self, piece: Piece, gyro: GyroBounds, straight: FloatArray) -> None:
        self._piece, self._gyro, self._straight = piece, gyro, straight
        frame, rows, speeds = piece.frame, piece.rows, lengths_of(piece.frame.rates)
        # In a gap the bias does nothing that is not in the bound of the turn across it.
        steps = frame.covered_steps
        turned = steps * np.maximum(speeds[1:], speeds[:-1])
        changed = steps * lengths_of(np.diff(frame.rates, axis=0))
        bends = from_the_first(steps * (turned**2 + changed) / 12.0)[rows]
        self._moved = running_sum(steps, frame.attitudes)[rows]
        self._pushed = RunningIntegrals(piece.steps, crossed(self._moved, piece.carried).reshape(-1, 9))
        elapsed, lengths = piece.elapsed, lengths_of(piece.carried)
        averaged = np.column_stack([bends, elapsed, straight, elapsed**2, elapsed * straight])
        self._bends, self._sums = bends, RunningIntegrals(piece.steps, lengths[:, None] * averaged)

    def turns(
        self, window: Window, average: Average, indices: NDArray[np.intp], entries: FloatArray, *, triangular: bool
    ) -> FloatArray:
        """Bounds of what the bias does to means, (18.63).

        Parameters
        ----------
        window : Window
            Those at the indices, with rows in the middle.
        average : Average
            Of all windows.
        indices : (m,) array
        entries : (m,) array
            What the mean of a number may lose by rounding that each row of a window adds an epsilon to.
        triangular : bool
            Which weights these are.

        Returns
        -------
        (m,) array
            The sensor's unit.
        """
        gyro, piece, row, stop = self._gyro, self._piece, window.row, window.stop
        mean, lengths, lost = average.mean[indices], average.length[indices], average.lost[indices]
        spanned = average.spanned[indices]
        other = 1.0 / (1.0 - gyro.scale_error)
        most = other * (gyro.bias + gyro.drift * piece.since_known[stop])
        means = self._pushed.means(window, triangular=triangular).reshape(-1, 3, 3)
        push = largest_singular_values(means - crossed(self._moved.take(row, axis=0), mean))
        rising, falling = self._sums.sides(window, triangular=triangular)
        _, once, straight, square, product = (rising + falling).T
        elapsed, turned = piece.elapsed[row], self._straight[row]
        inward = average.rising[indices] - average.falling[indices]
        bends = self._bends[row] * inward + (falling - rising)[:, 0]
        square = np.maximum(square - 2.0 * elapsed * once + elapsed**2 * lengths, 0.0)
        product = np.maximum(product - elapsed * straight - turned * once + elapsed * turned * lengths, 0.0)
        last = piece.elapsed[stop]
        square += 8.0 * lost * last**2
        product += 8.0 * lost * last * self._straight[stop]
        apart = piece.apart[stop] - piece.apart[window.start]
        steady = push + bends + 64.0 * entries * last + 2.0 * product + apart * spanned + most * square
        unsteady = other * gyro.unsteady_bias(window.before + window.after + 2.0 * piece.away)
        turns: FloatArray = most * steady + unsteady * spanned
        return turns
