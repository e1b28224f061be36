"""What a gyro whose scale error is one matrix does to a mean over a window about its row: docs/theory.md, 18.12.

Before the row and after it such an error turns the carried frame in opposite ways, and a turn back undoes it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.carried.second_order import ROUNDED_NORM, SecondOrder, crossed
from elliptude.bounds.carried.steady_bias import SteadyBias
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.matrix_effects import scale_effects
from elliptude.bounds.turns import lengths_of, running_sum
from elliptude.bounds.window_averages import Average, Piece, RunningIntegrals, Window
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
# How many directions across the mean stand for all of them; a regular polygon of twice as many corners holds a circle
# that is smaller by this cosine.
_DIRECTIONS = 8
_POLYGON = math.cos(0.5 * math.pi / _DIRECTIONS)
# Products are worked out one by one where they may be more than this share of the bound.
_WORTH = 0.02


def nuclear_norms(matrices: FloatArray) -> FloatArray:
    """Upper bounds of the sums of singular values of matrices of shape (3, 3, ...).

    The sum s obeys s² = ‖A‖² + 2 e, e² = ‖cof A‖² + 2 |det A| s, in Frobenius norms. The right-hand sides grow with s,
    so from above every step stays above.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrices
    first, second, third = e * i - f * h, f * g - d * i, d * h - e * g
    determinants = np.abs(a * first + b * second + c * third)
    of_cofactors = first * first + second * second + third * third
    for cofactor in (b * i - c * h, c * g - a * i, a * h - b * g, b * f - c * e, c * d - a * f, a * e - b * d):
        of_cofactors += cofactor * cofactor
    squares = a * a
    for entry in (b, c, d, e, f, g, h, i):
        squares += entry * entry
    norms: FloatArray = np.sqrt(3.0 * squares)
    for _ in range(3):
        norms = np.sqrt(squares + 2.0 * np.sqrt(of_cofactors + 2.0 * determinants * norms))
    return norms * ROUNDED_NORM


class OneMatrix:
    """Running integrals of a piece from which the effect of the scale error on any mean in it follows.

    Parameters
    ----------
    piece : Piece
    gyro : GyroBounds
        With a scale error.
    """

    def __init__(self, piece: Piece, gyro: GyroBounds) -> None:
        self._piece, self._gyro = piece, gyro
        # ω̃ - ω = K' ω̃ + (I - K')(b + v), K' = K (I + K)⁻¹, as in (18.13).
        self._scale, self._other = gyro.scale_error / (1.0 - gyro.scale_error), 1.0 / (1.0 - gyro.scale_error)
        steps, frame, rows = piece.steps, piece.frame, piece.rows
        # In a gap the matrix does nothing that is not in the bound of the turn across it.
        effects, chords = scale_effects(frame.covered_steps, frame.attitudes, frame.rates)
        self._effects, self._chords = effects[rows], chords[rows]
        # What is off without the matrix, noise apart; of the bias 1/(1 - k) as much counts as of the frame.
        biased = running_sum(frame.steps, gyro.bias + gyro.drift * frame.since_known)
        self._biased = biased[rows] + piece.apart / self._other
        self._pushed = RunningIntegrals(steps, crossed(self._effects, piece.carried).reshape(-1, 27))
        # q: what the matrix would turn if all its effects had one direction.
        self._straight = self._scale * piece.turned
        lengths = lengths_of(piece.carried)
        turned = self._straight
        averaged = [self._biased, self._chords, turned, turned**2, turned**3, piece.apart, piece.apart * turned]
        self._bias = SteadyBias(piece, gyro, turned) if gyro.is_steady else None
        self._sums = RunningIntegrals(steps, lengths[:, None] * np.column_stack(averaged))
        self._second_order = SecondOrder(steps, effects, rows, piece.carried)

    def turns(
        self, window: Window, average: Average, indices: NDArray[np.intp], below: FloatArray, *, triangular: bool
    ) -> FloatArray:
        """Bounds as `Average.turn` of what the gyro and the stamps do to means, (18.36).

        Parameters
        ----------
        window : Window
            With rows in the middle.
        average : Average
            Over these windows.
        indices : (m,) array
            Of the windows to bound.
        below : (m,) array
            A bound that is not below this need not be as small as it could be, as another window's is better.
        triangular : bool
            Which weights these are.

        Returns
        -------
        (m,) array
            The sensor's unit.
        """
        gyro, of, mean = self._gyro, window.take(indices), average.mean[indices]
        rising, falling = self._sums.sides(of, triangular=triangular)
        # A running bound is less before the row than at the row, and more after it.
        inward = average.rising[indices] - average.falling[indices]
        outward = (falling - rising).T
        biased, chords = self._biased[of.row] * inward + outward[0], self._chords[of.row] * inward + outward[1]
        effects = self._mean_push(of, triangular=triangular) - crossed(self._effects.take(of.row, axis=0), mean)
        swept, spanned = average.swept[indices], average.spanned[indices]
        pieces = average.pieces[indices] + average.lost[indices]
        biased *= self._other
        # Noise adds up in the true axes, and these may turn by as much more as the rate is off.
        truly_swept = (1.0 + self._scale) * swept + biased + self._other * gyro.noise * spanned
        entries = self._entries_lost(of, average, indices)
        if self._bias is not None:
            apart = self._piece.apart[of.row] * inward + outward[5]
            steady = self._bias.turns(of, average, indices, entries, triangular=triangular)
            biased = np.minimum(biased, apart + steady)
        longest = np.maximum(of.before, of.after) + 2.0 * self._piece.away
        noise = gyro.noise_angle(spanned, truly_swept, longest, pieces)
        # To body axes of the rows, so that nothing depends on where the piece begins.
        to_body = self._piece.attitudes.take(of.row, axis=0).transpose(0, 2, 1)
        push = _largest_push(to_body @ effects, (to_body @ mean[:, :, None])[:, :, 0])
        square, cube, apart = self._mean_products(of, average, indices, rising, falling)
        integrated = self._scale * chords + apart
        turns: FloatArray = self._scale * push + integrated + noise + biased
        turns += self._piece.by_stamps_of_frame(of, average, indices, triangular=triangular)
        turns += self._rounding(of, average, indices, entries)
        second = 0.5 * square
        some = np.flatnonzero((turns < below) & (second > _WORTH * below))
        if len(some):
            lost = np.column_stack([average.share[indices], entries])[some]
            near, row = of.take(some), self._straight[of.row]
            products = self._second_order.bounds(near, mean[some], effects[some], lost, triangular=triangular)
            farthest = np.maximum(self._straight[of.stop] - row, row - self._straight[of.start])
            integrated += 64.0 * self._scale * entries * self._piece.turned[of.stop]
            others = 3.0 * (self._scale + farthest) * integrated + cube / 6.0
            second[some] = np.minimum(second[some], self._scale**2 * products + others[some])
        return turns + second

    def _mean_push(self, window: Window, *, triangular: bool) -> FloatArray:
        """The weighted means of the effects crossed with what is averaged, shape (m, 3, 9)."""
        return self._pushed.means(window, triangular=triangular).reshape(-1, 3, 9)

    def _entries_lost(self, window: Window, average: Average, indices: NDArray[np.intp]) -> FloatArray:
        """What the mean of a number may lose by rounding that each row of the window adds an epsilon to."""
        turned, rows = self._piece.turned, self._piece.rows
        steps: FloatArray = rows[window.stop] - rows[window.start] + 1.0 + turned[window.stop] - turned[window.start]
        lost: FloatArray = average.lost[indices] + _EPSILON * steps * average.length[indices]
        return lost

    def _rounding(self, window: Window, average: Average, indices: NDArray[np.intp], entries: FloatArray) -> FloatArray:
        """What rounding may add, as in section 18.2: to the 27 numbers of the effects, and to both bounds."""
        stop = window.stop
        bounds = self._other * self._biased[stop] + self._scale * self._chords[stop]
        rounding: FloatArray = 64.0 * self._scale * entries * self._piece.turned[stop]
        return rounding + 3.0 * average.lost[indices] * bounds

    def _mean_products(
        self, window: Window, average: Average, indices: NDArray[np.intp], rising: FloatArray, falling: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The means of q², of q³, and of q times how far the carried frame is off, each times the lengths.

        All of these count from the row.
        """
        row, stop = self._straight[window.row], self._straight[window.stop]
        lengths, lost = average.length[indices], average.lost[indices]
        (once, twice, _, apart, product), outward = (rising + falling)[:, 2:].T, (falling - rising)[:, 2:].T
        inward = average.rising[indices] - average.falling[indices]
        square = twice - 2.0 * row * once + row**2 * lengths
        cube = outward[2] - 3.0 * row * outward[1] + 3.0 * row**2 * outward[0] + row**3 * inward
        off = self._piece.apart[window.row]
        product = product - off * once - row * apart + off * row * lengths
        # Four such terms, or eight, each off by what a mean may lose, and the sums of q themselves.
        return (
            np.maximum(square, 0.0) + 8.0 * lost * stop**2,
            np.maximum(cube, 0.0) + 16.0 * lost * stop**3,
            np.maximum(product, 0.0) + 8.0 * lost * stop * self._piece.apart[window.stop],
        )


def _largest_push(effects: FloatArray, means: FloatArray) -> FloatArray:
    """Bounds of the length of M vec K' over all matrices K' of norm one, for M of shape (m, 3, 9).

    The component along e is at most the sum of singular values of M's combination e, which is a norm of e. Across the
    mean, where nearly all of it is, e is in a polygon; along the mean the norm is added by Pythagoras.
    """
    lengths = lengths_of(means)
    along = np.where(lengths[:, None] > 0.0, means / np.where(lengths > 0.0, lengths, 1.0)[:, None], [1.0, 0.0, 0.0])
    least = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    first = _cross(along, least)
    first /= lengths_of(first)[:, None]
    axes = np.stack([first, _cross(along, first), along], axis=1)
    # One axis after another, and the windows last: what follows goes through whole arrays.
    x, y, z = np.ascontiguousarray((axes @ effects).transpose(1, 2, 0)).reshape(3, 3, 3, -1)
    turned = math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    cosines, sines = np.cos(turned)[:, None], np.sin(turned)[:, None]
    across = nuclear_norms(cosines * x[:, :, None] + sines * y[:, :, None]).max(axis=0)
    pushes: FloatArray = np.hypot(across / _POLYGON, nuclear_norms(z))
    return pushes


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """`numpy.cross` of vectors (n, 3) to the last bit, in a third of its time."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
