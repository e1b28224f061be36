"""What the guaranteed filter and the filter of a direction return, and how far attitudes may be off."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elliptude import _core
from elliptude._arrays import unmasked
from elliptude.results.shown import equal, pictured, span
from elliptude.typing import AttitudeLike, FloatArray, SupportsAsMatrix


@dataclass(frozen=True)
class GuaranteedUpdate:
    """What a guaranteed update did."""

    claim: str
    """'unconditional', 'conditional' or 'none', see `elliptude.results.CLAIMS`."""
    prediction_used: bool
    """Whether the prediction made the set smaller than the measurements alone."""
    dropped: tuple[str | int, ...]
    """Measurements that were left out, or are proved wrong: names, and indices of directions that have none."""
    margin: float
    """How far the constraints are from having no common point, at most about 1; negative if they had none."""


class AttitudeBounds(NamedTuple):
    """How far an attitude is at most from the true one: three questions, each answered by itself.

    Arrays for many rows.
    """

    tilt: Any
    """The largest angle between the vertical as the body sees it in both, rad."""
    heading_from: Any
    """The turn about the vertical from it to the true one, when the tilt is taken away: at least this, rad."""
    heading_to: Any
    """And at most this, rad; positive about up in the sense of a right-handed screw."""
    angle: Any
    """The turn from one to the other is at most by this, rad."""

    @property
    def heading(self) -> Any:
        """How far the heading may be off to either side, rad."""
        return np.maximum(-self.heading_from, self.heading_to)


class Interval(NamedTuple):
    """Two numbers that an unknown one is between."""

    least: float
    """It is not less."""
    most: float
    """It is not more."""


class AttitudeSet(NamedTuple):
    """A set of attitudes by itself: C = attitude cay(γ/2) with γ in the ellipsoid of the shape about zero.

    A turn by an angle about a unit vector n is γ = 2 tan(angle/2) n.
    """

    attitude: FloatArray
    """The set's center, shape (3, 3)."""
    shape: FloatArray
    """P of γ in body axes, rad², shape (3, 3)."""


@dataclass(frozen=True)
class DirectionUpdate:
    """What an update of a DirectionFilter did."""

    claim: str
    """'unconditional', 'conditional' or 'none', see `elliptude.results.CLAIMS`."""
    prediction_used: bool
    """Whether the prediction made the cap smaller than the measurement alone."""
    contradicts: bool
    """Whether the measurement and the prediction had no common direction."""
    dropped: bool
    """Whether the measurement was left out."""


@dataclass(frozen=True, eq=False)
class DirectionLog:
    """The result of a DirectionFilter for a log of n rows, after each row."""

    directions: FloatArray
    """Where the direction is in body axes, unit vectors, NaN where it is not known, shape (n, 3)."""
    angles: FloatArray
    """How far it may be from there, rad, NaN where it is not known, shape (n,)."""
    claims: NDArray[np.uint8]
    """What that rests on, an index of `elliptude.results.CLAIMS`, shape (n,)."""
    dropped: NDArray[np.bool_]
    """Whether the measurement was left out, shape (n,)."""


class Extents(NamedTuple):
    """How far the sets of n rows reach, NaN where there is none; bounds of what is in the set, as angles."""

    half_widths_body: FloatArray
    """Half-widths of the attitude error ζ (rad) and of the vector beside it (rad/s), along body axes, shape (n, 6)."""
    half_widths_reference: FloatArray
    """Half-widths of ζ along reference axes, rad, shape (n, 3)."""
    largest_angles: FloatArray
    """The largest ‖ζ‖ in each set, rad, shape (n,)."""

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are equal."""
        return equal(self, other)

    def __ne__(self, other: object) -> bool:
        """Whether any number differs."""
        return not equal(self, other)


@dataclass(frozen=True, eq=False, repr=False)
class GuaranteedLog:
    """The result of a guaranteed filter for a log of n rows with m directions, after each row."""

    times: FloatArray
    """In s, shape (n,)."""
    attitudes: FloatArray
    """Centers, from body to reference axes, NaN where the attitude is not known, shape (n, 3, 3)."""
    vectors: FloatArray
    """Angular velocities or gyro biases, rad/s, body axes, NaN where the attitude is not known, shape (n, 3)."""
    shapes: FloatArray
    """P in the Gibbs chart, NaN where the attitude is not known, shape (n, 6, 6)."""
    claims: NDArray[np.uint8]
    """What the sets rest on, an index of `elliptude.results.CLAIMS`, shape (n,)."""
    prediction_used: NDArray[np.bool_]
    """Whether the prediction went into the row's set, shape (n,)."""
    updated: NDArray[np.bool_]
    """Whether anything was measured, shape (n,)."""
    dropped: NDArray[np.bool_]
    """Which directions and, last, angular velocity and attitude were left out or proved wrong, shape (n, m + 2)."""
    margins: FloatArray
    """How far the constraints are from having no common point, NaN where nothing was measured, shape (n,)."""
    question_bounds: FloatArray | None = None
    """Bounds of tilt, heading from and to, and angle, rad, if a vertical was given, NaN without a set, shape (n, 4)."""
    are_proposals: bool = False
    """Whether the bounds behind them are only what a recording showed: then no set proves anything."""

    def __repr__(self) -> str:
        """One line: rows and claims."""
        return span("GuaranteedLog", self.times, self.claims)

    def _repr_html_(self) -> str:
        """For notebooks: a small plot of the largest angle in each set."""
        return pictured(repr(self), self.extents().largest_angles if len(self.times) else self.times)

    @property
    def attitude_bounds(self) -> AttitudeBounds | None:
        """How far each row's attitude may be off, arrays of shape (n,), if a vertical was given."""
        return None if self.question_bounds is None else AttitudeBounds(*self.question_bounds.T)

    def forms(self, true_attitudes: AttitudeLike, true_vectors: NDArray[np.float64] | None = None) -> FloatArray:
        """Where the truth is in the sets, in the Gibbs chart: [γ; δ]ᵀ P⁻¹ [γ; δ], at most 1 inside.

        Parameters
        ----------
        true_attitudes : (n, 3, 3) array_like, or Rotation of SciPy
            From body to reference axes.
        true_vectors : (n, 3) array_like, optional
            Without it the form is of γ alone, in the projection of the set on the attitude. With
            ``estimate_vector=False`` leave it out: shapes are then of two sets, the attitude's and the vector's, and
            the form of all six numbers is the sum of both forms, up to 2 for a state that is in both.

        Returns
        -------
        (n,) ndarray
            NaN where there is no set, or no truth.
        """
        truth = unmasked(true_attitudes)
        matrices = truth.as_matrix() if isinstance(truth, SupportsAsMatrix) else truth
        vectors = unmasked(true_vectors)
        return np.asarray(_core._gibbs_forms(self.attitudes, self.vectors, self.shapes, matrices, vectors))

    def shapes_exponential(self) -> FloatArray:
        """Shapes (n, 6, 6) in the exponential chart of sets about the same centers that contain those of `shapes`."""
        return _core._gibbs_to_exponential(self.shapes)

    def extents(self) -> Extents:
        """Half-widths along body and reference axes and the largest angles."""
        rows = _core._gibbs_extents(self.attitudes, self.shapes)
        return Extents(rows[:, :6], rows[:, 6:9], rows[:, 9])
