"""What the filter of first order returns, for one update, for many filters, for a log."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude.results.shown import pictured, span
from elliptude.typing import FloatArray


class Convergence(NamedTuple):
    """Diagnostics of the paper's convergence theorem, a sufficient condition that most updates cannot meet."""

    flow_norm: float
    """‖A^f‖_F since the update before; at least √6, as det A^f = 1."""
    smallest_ratio: float
    """The least eigenvalue of (P^m)⁻¹ P^f."""
    chi: float
    """√(6 + 30 κ(P^m))."""
    contraction: float
    """The least c that satisfies the theorem; tr P < c tr P₀ is promised only where it is below 1."""
    trace_ratio: float
    """tr P / tr P₀ as it came out."""
    smaller_than_sets: float
    """tr P / min(tr P^m, tr P^f): at most 1 for the criterion 'trace', before recentring."""


class Update(NamedTuple):
    """What an update did."""

    share: float
    """0 is the measurement alone, 1 the prediction alone."""
    margin: float
    """The least overlap of the sets that were fused, see `elliptude.overlap_margin`."""
    convergence: Convergence | None
    """Diagnostics, if asked for: after two or more directions with an angular velocity."""


class Updates(NamedTuple):
    """What an update of n filters did."""

    share: FloatArray
    """0 is the measurement alone, 1 the prediction alone, which it also is where the update was skipped; shape (n,)."""
    margin: FloatArray
    """The least overlap of the sets that were fused, negative where they do not meet, shape (n,)."""
    used: NDArray[np.bool_]
    """Whether the filter took the measurement, shape (n,)."""


@dataclass(frozen=True, eq=False, repr=False)
class FilterLog:
    """The result of a first-order filter for a log of n rows with m directions."""

    times: FloatArray
    """In s, shape (n,)."""
    attitudes: FloatArray
    """Centers after each row, from body to reference axes, shape (n, 3, 3)."""
    vectors: FloatArray
    """Angular velocities or gyro biases, rad/s, body axes, shape (n, 3)."""
    shapes: FloatArray
    """P, shape (n, 6, 6)."""
    shares: FloatArray
    """0 is the measurement alone, 1 the prediction alone, shape (n,)."""
    margins: FloatArray
    """Least overlap of the sets that were fused, NaN where none were, shape (n,)."""
    used: NDArray[np.bool_]
    """Whether each direction and, last, the angular velocity went into the row's update, shape (n, m + 1)."""
    outcomes: NDArray[np.uint8]
    """0 updated, 1 predicted only, 2 refused: the sets did not meet; shape (n,)."""

    def __repr__(self) -> str:
        """One line: rows."""
        return span("FilterLog", self.times)

    def _repr_html_(self) -> str:
        """For notebooks: a small plot of the largest angle in each set."""
        return pictured(repr(self), self.largest_angles() if len(self.times) else self.times)

    def since(self, first: int) -> "FilterLog":
        """The rows from one on."""
        return FilterLog(**{name: values[first:] for name, values in vars(self).items()})

    def half_widths(self) -> FloatArray:
        """Half-widths along body axes of the attitude error (rad) and of the vector (rad/s), shape (n, 6)."""
        diagonals: FloatArray = np.sqrt(np.diagonal(self.shapes, axis1=1, axis2=2))
        return diagonals

    def largest_angles(self) -> FloatArray:
        """The largest attitude error in each set, rad, shape (n,)."""
        largest: FloatArray = np.sqrt(np.linalg.eigvalsh(self.shapes[:, :3, :3])[:, -1])
        return largest
