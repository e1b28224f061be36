"""What is of second order in a gyro's matrix, of a mean over a window about its row: docs/theory.md, 18.12."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.turns import lengths_of, running_sum
from elliptude.bounds.window_averages import RunningIntegrals, Window
from elliptude.typing import FloatArray

_EPSILON = float(np.finfo(np.float64).eps)
# The pairs of entries of K' that products are of, and the factor of each in coordinates in which the matrix of all
# products is as long as its Frobenius norm.
_FIRST, _SECOND = np.triu_indices(9)
_FACTORS = np.where(_FIRST == _SECOND, 0.25, 0.125**0.5)
ROUNDED_NORM = 1.0 + 1e-6
"""For norms that come of a difference, which may be off by some rounding of its size, and counts with its root."""
# Rows that are worked on at once, so that what is between stays near the processor.
_AT_ONCE = 2048


class SecondOrder:
    """Running integrals of a piece, from which the part of second order of any mean in it follows.

    The carried frame's error grows with S(d), d = P vec K', and with iterated integrals of it. Those of two factors are
    S(d)² and S(g), g the integral of d × ḋ, along the straight lines between rows of the gyro.

    Parameters
    ----------
    steps : (n - 1,) array
        Between samples of what is averaged, s.
    effects : (N, 3, 9) array
        P at the gyro's rows, from the beginning of the piece.
    rows : (n,) array
        Which of these have a sample.
    vectors : (n, 3) array
        What is averaged, in the carried frame.
    """

    def __init__(self, steps: FloatArray, effects: FloatArray, rows: NDArray[np.intp], vectors: FloatArray) -> None:
        self._steps, self._of_gyro, self._rows, self._vectors = steps, effects, rows, vectors
        self._effects = effects[rows]

    def bounds(
        self, window: Window, means: FloatArray, effects: FloatArray, lost: FloatArray, *, triangular: bool
    ) -> FloatArray:
        """Bounds of the mean's part of second order, over all matrices K' of norm one.

        Parameters
        ----------
        window : Window
            With rows in the middle.
        means : (m, 3) array
            Of the vectors.
        effects : (m, 3, 9) array
            M: what takes the entries of K' to the mean's part of first order.
        lost : (m, 2) array
            What a mean may lose by rounding: of a running sum that is one at the window's end; and of a number that
            each row of the window adds an epsilon of itself to, times the mean of the vectors' lengths.
        triangular : bool
            Which weights these are.

        Returns
        -------
        (m,) array
            The sensor's unit.
        """
        found = np.empty(len(means))
        for start in range(0, len(means), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            here = window.take(np.arange(len(means))[some])
            found[some] = self._bounds(here, means[some], effects[some], lost[some], triangular=triangular)
        return found

    def _bounds(
        self, window: Window, means: FloatArray, effects: FloatArray, lost: FloatArray, *, triangular: bool
    ) -> FloatArray:
        largest = largest_singular_values(self.products(window, means, effects, triangular=triangular))
        sizes = self._sizes.take(window.stop, axis=0)
        rounding = 64.0 * (lost[:, 0] * sizes[:, 0] + lost[:, 1] * (sizes[:, 1] + sizes[:, 2]))
        # ‖K'‖ ≤ 1 in the spectral norm, so ‖vec K'‖² ≤ 3.
        bounds: FloatArray = 3.0 * (largest + rounding)
        return bounds

    def products(self, window: Window, means: FloatArray, effects: FloatArray, *, triangular: bool) -> FloatArray:
        """The matrices T (m, 3, 45) that take the products of two entries of K' to the mean's part, (18.38).

        The products are the entries of vec K' (vec K')ᵀ on its diagonal and above, these √2 times, row by row.
        Arguments are those of `bounds`.
        """
        at_row = self._effects.take(window.row, axis=0)
        sums = self._sums.means(window, triangular=triangular).reshape(-1, 3, 45)
        areas = self._areas.take(window.row, axis=0)
        of_row = _pairs(at_row, crossed(at_row, means) + 2.0 * effects) + crossed(areas, means)
        products: FloatArray = (of_row - sums) * _FACTORS
        return products

    @cached_property
    def _areas(self) -> FloatArray:
        """Integrals of d × ḋ from the first row, as products of two entries of K', shape (n, 3, 45)."""
        areas = np.zeros((len(self._of_gyro), 3, 45))
        for some in _blocks(len(areas)):
            before, after = self._of_gyro[:-1][some], self._of_gyro[1:][some]
            areas[1:][some] = _pairs(before, after - before)
        return np.cumsum(areas, axis=0, out=areas)[self._rows]

    @cached_property
    def _sums(self) -> RunningIntegrals:
        """Of S(d)² y + S(g) y, twice over, 135 columns."""
        products = np.empty((len(self._effects), 135))
        for some in _blocks(len(products)):
            effects, vectors = self._effects[some], self._vectors[some]
            whole = _pairs(effects, crossed(effects, vectors)) + crossed(self._areas[some], vectors)
            products[some] = whole.reshape(-1, 135)
        return RunningIntegrals(self._steps, products)

    @cached_property
    def _sizes(self) -> FloatArray:
        """How large what is summed may have become by each row, for rounding, shape (n, 3).

        The integral of the lengths of the products, the largest of these for a vector of length one, and of d.
        """
        effects = np.sqrt(np.einsum("nij,nij->n", self._effects, self._effects))
        areas = np.sqrt(np.einsum("nij,nij,j->n", self._areas, self._areas, _FACTORS**2))
        sizes = 0.5 * effects**2 + areas
        sums = running_sum(self._steps, lengths_of(self._vectors) * sizes)
        return np.column_stack([sums, np.maximum.accumulate(sizes), np.maximum.accumulate(effects)])


def _blocks(count: int) -> list[slice]:
    """Rows to be worked on one after another."""
    return [slice(start, start + _AT_ONCE) for start in range(0, count, _AT_ONCE)]


def crossed(columns: FloatArray, vectors: FloatArray) -> FloatArray:
    """Each column of matrices (n, 3, k), crossed with a vector (n, 3) from the right."""
    x, y, z = vectors.T[:, :, None]
    a, b, c = columns[:, 0], columns[:, 1], columns[:, 2]
    found: FloatArray = np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)
    return found


def _pairs(first: FloatArray, second: FloatArray) -> FloatArray:
    """The sums a_j × b_k + a_k × b_j of columns of matrices (n, 3, 9), for all pairs j ≤ k, shape (n, 3, 45)."""
    found = np.empty((len(first), 3, 45))
    for i in range(3):
        a, b = first[:, i - 2, :, None], second[:, i - 1, None, :]
        whole = a * b
        whole -= first[:, i - 1, :, None] * second[:, i - 2, None, :]
        whole += whole.transpose(0, 2, 1)
        found[:, i] = whole[:, _FIRST, _SECOND]
    return found


def largest_singular_values(matrices: FloatArray) -> FloatArray:
    """Upper bounds of the largest singular values of matrices (m, 3, k)."""
    squares = matrices @ matrices.transpose(0, 2, 1)
    # The largest of three numbers is within √2 standard deviations of their mean.
    middle = np.trace(squares, axis1=1, axis2=2) / 3.0
    spread = np.einsum("nij,nij->n", squares, squares) / 3.0 - middle**2
    largest: FloatArray = np.sqrt(middle + np.sqrt(2.0 * np.maximum(spread, 0.0)))
    return largest * ROUNDED_NORM
