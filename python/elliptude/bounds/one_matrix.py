"""What a gyro whose scale error is one matrix does to a mean over a window about its row: docs/theory.md, 18.12.

Before the row and after it such an error turns the carried frame in opposite ways, and a turn back undoes it.
"""

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.gyro import GyroBounds, scale_effects
from elliptude.bounds.turns import lengths_of, running_sum
from elliptude.bounds.window_averages import Average, Piece, Window, weighted, weighted_whole
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
# How many directions across the mean stand for all of them; a regular polygon of twice as many corners holds a circle
# that is smaller by this cosine.
_DIRECTIONS = 8
_POLYGON = math.cos(0.5 * math.pi / _DIRECTIONS)
# Cofactors and determinants in `nuclear_norms` may be off by some rounding of their size, which counts with its root.
_ROUNDED_NORM = 1.0 + 1e-6
# Second order is bounded by a q + b q² for each of these b, with an a that follows. With 3/4 the bound needs no a.
_CURVATURES = (0.0, 0.1, 0.3, 0.5)
_WHOLE_CURVATURE = 0.75
# A cell of the second order is this long, s, or this share of the longest window.
_LEAST_CELL = 0.1
_SHARE_OF_LONGEST = 1.0 / 120.0


def cell_length(longest: float) -> float:
    """The length of the cells in which products of errors are bounded, s."""
    return max(_LEAST_CELL, _SHARE_OF_LONGEST * longest)


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
    return norms * _ROUNDED_NORM


class OneMatrix:
    """Running integrals of a piece from which the effect of the scale error on any mean in it follows.

    Parameters
    ----------
    piece : Piece
    gyro : GyroBounds
        With a scale error.
    reach : float
        How far windows reach from their rows at most, s.
    cell : float
        From `cell_length`.
    """

    def __init__(self, piece: Piece, gyro: GyroBounds, reach: float, cell: float) -> None:
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
        crossed = _crossed(self._effects.transpose(1, 2, 0), piece.carried.T)
        self._pushed = running_sum(steps, np.ascontiguousarray(crossed.reshape(27, -1).T))
        # q: what the matrix would turn if all its effects had one direction.
        self._straight = self._scale * piece.turned
        lengths = lengths_of(piece.carried)
        averaged = np.column_stack([self._biased, self._chords, self._straight, self._straight**2])
        self._once = running_sum(steps, lengths[:, None] * averaged)
        cells = np.floor(piece.since_known / cell)
        self._nodes = np.concatenate([[0], np.flatnonzero(np.diff(cells)) + 1, [len(cells) - 1]])
        self._attitudes_at_nodes = np.ascontiguousarray(piece.attitudes[self._nodes].transpose(1, 2, 0))
        self._effects_at_nodes = np.ascontiguousarray(self._effects[self._nodes].transpose(1, 2, 0))
        self._growth = self._growth_to_cells(math.ceil(reach / cell) + 2)

    @cached_property
    def _pushed_twice(self) -> FloatArray:
        """The sums of `_pushed`, which triangular weights alone need."""
        return running_sum(self._piece.steps, self._pushed)

    @cached_property
    def _twice(self) -> FloatArray:
        """The sums of `_once`, likewise."""
        return running_sum(self._piece.steps, self._once)

    def turns(self, window: Window, average: Average, indices: NDArray[np.intp], *, triangular: bool) -> FloatArray:
        """Bounds as `Average.turn` of what the gyro and the stamps do to means, (18.36).

        Parameters
        ----------
        window : Window
            With rows in the middle.
        average : Average
            Over these windows.
        indices : (m,) array
            Of the windows to bound.
        triangular : bool
            Which weights these are.

        Returns
        -------
        (m,) array
            The sensor's unit.
        """
        gyro, of, mean = self._gyro, window.take(indices), average.mean[indices]
        rising, falling = weighted(self._once, self._twice if triangular else None, of)
        # A running bound is less before the row than at the row, and more after it.
        inward = average.rising[indices] - average.falling[indices]
        outward = (falling - rising).T
        biased, chords = self._biased[of.row] * inward + outward[0], self._chords[of.row] * inward + outward[1]
        # One entry after another, and the windows last: what follows goes through whole arrays.
        effects = self._mean_push(of, triangular=triangular)
        effects -= _crossed(_windows_last(self._effects.take(of.row, axis=0).reshape(-1, 27)), mean.T)
        swept, spanned = average.swept[indices], average.spanned[indices]
        pieces = average.pieces[indices] + average.lost[indices]
        biased *= self._other
        # Noise adds up in the true axes, and these may turn by as much more as the rate is off.
        truly_swept = (1.0 + self._scale) * swept + biased + self._other * gyro.noise * spanned
        longest = np.maximum(of.before, of.after) + 2.0 * self._piece.away
        noise = gyro.noise_angle(spanned, truly_swept, longest, pieces)
        second = self._second_order_bounds(of, average, indices, rising + falling)
        push = _largest_push(effects, mean, self._piece.attitudes.take(of.row, axis=0))
        # The matrix acts in the carried frame, which is no further off than over the whole window.
        apart = (self._piece.apart[of.stop] - self._piece.apart[of.start]) * swept
        turns: FloatArray = self._scale * (push + chords + apart) + noise + biased
        by_stamps = self._piece.by_stamps_of_frame(of, average, indices, triangular=triangular)
        return turns + second + by_stamps + self._rounding(of, average, indices)

    def _mean_push(self, window: Window, *, triangular: bool) -> FloatArray:
        """The weighted means of the effects crossed with what is averaged, as `weighted`, shape (3, 9, m)."""
        return _windows_last(weighted_whole(self._pushed, self._pushed_twice if triangular else None, window))

    def _rounding(self, window: Window, average: Average, indices: NDArray[np.intp]) -> FloatArray:
        """What rounding may add, as in section 18.2: to the 27 numbers of the effects, and to both bounds."""
        turned, rows, stop = self._piece.turned, self._piece.rows, window.stop
        steps = rows[stop] - rows[window.start] + 1.0 + turned[stop] - turned[window.start]
        entry = (average.lost[indices] + _EPSILON * steps * average.length[indices]) * turned[stop]
        bounds = self._other * self._biased[stop] + self._scale * self._chords[stop]
        rounding: FloatArray = 64.0 * self._scale * entry + 3.0 * average.lost[indices] * bounds
        return rounding

    def _second_order_bounds(
        self, window: Window, average: Average, indices: NDArray[np.intp], means: FloatArray
    ) -> FloatArray:
        """Bounds of what is of second order, from the means of q and q² times the lengths, (18.39)."""
        once = self._scale * average.swept[indices]
        at_row = self._straight[window.row]
        square = means[:, 3] - 2.0 * at_row * means[:, 2] + at_row**2 * average.length[indices]
        # Four such terms, each off by what a mean may lose, and the sums of q themselves.
        square = np.maximum(square, 0.0) + 8.0 * average.lost[indices] * self._straight[window.stop] ** 2
        row, start, stop = (self._cells(rows) for rows in (window.row, window.start, window.stop))
        last = self._growth.shape[2] - 1
        second = _WHOLE_CURVATURE * square
        within = np.maximum(row - start, stop - row) <= last
        for curvature, (before, after) in zip(_CURVATURES, self._growth, strict=True):
            growth = np.maximum(before[np.minimum(row - start, last), row], after[np.minimum(stop - row, last), row])
            second = np.where(within, np.minimum(second, growth * once + curvature * square), second)
        return second

    def _cells(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """The cell that each row is in."""
        cells: NDArray[np.intp] = np.searchsorted(self._nodes[1:-1], rows, side="right")
        return cells

    def _growth_to_cells(self, farthest: int) -> FloatArray:
        """For each curvature the a of (18.39) from any row of a cell to as many cells before, and after.

        Shape (curvatures, 2, how many cells away, cells).
        """
        nodes, count = self._nodes, len(self._nodes) - 1
        straight = self._straight[nodes]
        in_cell = np.diff(straight)
        farthest = min(farthest, count - 1)
        at_nodes = [self._turn_between_nodes(away) for away in range(min(farthest + 1, count) + 1)]
        growth = np.empty((len(_CURVATURES), 2, farthest + 1, count))
        along_before, along_after = np.zeros(count), np.zeros(count)
        for away in range(farthest + 1):
            near, far = slice(0, count - away), slice(away, count)
            between = self._turn_between_cells(at_nodes, away)
            along_after[near] += between * in_cell[far]
            along_before[far] += between * in_cell[near]
            most = straight[away + 1 :] - straight[near]
            least = straight[away:count] - straight[1 : count - away + 1] if away else np.zeros(count)
            for side, along, cells in ((0, along_before, far), (1, along_after, near)):
                with np.errstate(divide="ignore", invalid="ignore"):
                    share = 0.5 * along[cells] / least + 0.5 * between * np.minimum(1.0, between / least)
                for i, curvature in enumerate(_CURVATURES):
                    growth[i, side, away, cells] = np.fmin(
                        (_WHOLE_CURVATURE - curvature) * most, share - curvature * least
                    )
            # From the other cells the piece does not reach so far.
            growth[:, 0, away, :away] = growth[:, 1, away, count - away :] = np.inf
            if away:
                np.maximum(growth[:, :, away], growth[:, :, away - 1], out=growth[:, :, away])
        return growth

    def _turn_between_nodes(self, away: int) -> FloatArray:
        """Bounds of the turn by the scale error from nodes to those so many further on, rad."""
        nodes = self._nodes
        near, far = slice(0, len(nodes) - away), slice(away, None)
        first, last = nodes[near], nodes[far]
        # One entry after another, and the nodes last: what follows goes through whole arrays.
        turned_by = self._effects_at_nodes[:, :, far] - self._effects_at_nodes[:, :, near]
        # In the body axes at the first node, so that nothing depends on where the piece begins.
        axes = self._attitudes_at_nodes[:, :, None, near]
        effects = axes[0] * turned_by[0]
        effects += axes[1] * turned_by[1]
        effects += axes[2] * turned_by[2]
        norms = nuclear_norms(np.ascontiguousarray(effects.reshape(3, 3, 3, -1).transpose(1, 2, 0, 3)))
        by_rows = np.sqrt(np.sum(norms * norms, axis=0))
        # The largest of three numbers is within √2 standard deviations of their mean.
        squares = {(i, j): np.sum(turned_by[i] * turned_by[j], axis=0) for i in range(3) for j in range(i + 1)}
        middle = (squares[0, 0] + squares[1, 1] + squares[2, 2]) / 3.0
        spread = sum((1.0 if i == j else 2.0) * square * square for (i, j), square in squares.items()) / 3.0 - middle**2
        together = np.sqrt(3.0 * (middle + np.sqrt(2.0 * np.maximum(spread, 0.0)))) * _ROUNDED_NORM
        # Rounding of the sums as in 18.2; it is nothing beside the turns.
        turned, apart = self._piece.turned, self._piece.apart
        others = (
            64.0 * _EPSILON * (self._piece.rows[last] + 1.0) * turned[last] + self._chords[last] - self._chords[first]
        )
        others += (apart[last] - apart[first]) * (turned[last] - turned[first])
        turns: FloatArray = self._scale * (np.minimum(by_rows, together) + others)
        return turns

    def _turn_between_cells(self, at_nodes: list[FloatArray], away: int) -> FloatArray:
        """Bounds of the turn by the scale error between any rows of cells so many apart, (18.38), rad."""
        count = len(self._nodes) - 1
        turned = self._piece.turned[self._nodes]
        inner = at_nodes[away - 1][1 : count - away + 1] if away else at_nodes[1][:count]
        middle = at_nodes[away]
        corners = 0.25 * (middle[: count - away] + middle[1 : count - away + 1] + at_nodes[away + 1] + inner)
        in_cell = np.diff(turned)
        corners += 0.5 * self._scale * (in_cell[: count - away] + in_cell[away:])
        swept = turned[away + 1 :] - turned[: count - away]
        turn: FloatArray = np.minimum(corners, self._scale * swept)
        return turn


def _largest_push(effects: FloatArray, means: FloatArray, attitudes: FloatArray) -> FloatArray:
    """Bounds of the length of M vec K' over all matrices K' of norm one, for M of shape (3, 9, m).

    The component along e is at most the sum of singular values of M's combination e, which is a norm of e. Across the
    mean, where nearly all of it is, e is in a polygon; along the mean the norm is added by Pythagoras. The polygon is
    fixed to the body at each window's row, so that nothing depends on where the piece begins.
    """
    of_body = np.einsum("nji,nj->ni", attitudes, means)
    lengths = lengths_of(of_body)
    along = np.where(lengths[:, None] > 0.0, of_body / np.where(lengths > 0.0, lengths, 1.0)[:, None], [1.0, 0.0, 0.0])
    least = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    first = _cross(along, least)
    first /= lengths_of(first)[:, None]
    axes = [np.einsum("nij,nj->in", attitudes, axis) for axis in (first, _cross(along, first), along)]
    x, y, z = ((a * effects[0] + b * effects[1] + c * effects[2]).reshape(3, 3, -1) for a, b, c in axes)
    turned = math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    cosines, sines = np.cos(turned)[:, None], np.sin(turned)[:, None]
    across = nuclear_norms(cosines * x[:, :, None] + sines * y[:, :, None]).max(axis=0)
    pushes: FloatArray = np.hypot(across / _POLYGON, nuclear_norms(z))
    return pushes


def _windows_last(rows: FloatArray) -> FloatArray:
    """Rows (m, 27) as matrices (3, 9, m)."""
    return np.ascontiguousarray(rows.T).reshape(3, 9, -1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """`numpy.cross` of vectors (n, 3) to the last bit, in a third of its time."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _crossed(effects: FloatArray, vectors: FloatArray) -> FloatArray:
    """Each column of matrices (3, 9, n), crossed with a vector (3, n) from the right."""
    (a, b, c), (x, y, z) = effects, vectors
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x])
