"""The results that functions return: named tuples and classes of arrays."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from importlib import import_module
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from elliptude import _core
from elliptude._arrays import unmasked
from elliptude._core import Ellipsoid, cayley_inverse, log
from elliptude.typing import AttitudeLike, Chart, FloatArray, SupportsAsMatrix

# Pieces of rows of a small plot, and its size in px.
_PIECES, _PANEL_WIDTH, _PANEL_HEIGHT = 300, 600, 90


def _equal(one: tuple[Any, ...], other: object) -> bool:
    """Whether two results of one kind have equal arrays; NaN is equal to NaN. Tuples of arrays cannot say so."""
    if type(other) is not type(one):
        return False
    assert isinstance(other, tuple)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


def _span(name: str, times: FloatArray, claims: NDArray[np.uint8] | None = None) -> str:
    """A log of rows in one line."""
    said = f"{name}: {len(times)} rows"
    if len(times):
        said += f", {times[0]:.6g} to {times[-1]:.6g} s"
    if claims is None or not len(claims):
        return f"<{said}>"
    shares = [f"{claim} {100.0 * float(np.mean(claims == i)):.3g} %" for i, claim in enumerate(CLAIMS)]
    return f"<{said}; claims: {', '.join(shares)}>"


def _panel(name: str, least: FloatArray, most: FloatArray, angle: FloatArray) -> str:
    """A band between the least and the most of each piece of rows, and the angle, all in degrees, as SVG."""
    starts = np.arange(0, len(angle), -(-len(angle) // _PIECES))
    least, most, angle = np.fmin.reduceat(least, starts), np.fmax.reduceat(most, starts), angle[starts]
    low, high = np.nanmin(least, initial=0.0), np.nanmax(most, initial=0.0)
    across, height = _PANEL_WIDTH / len(starts), _PANEL_HEIGHT / max(high - low, 1.0)
    known = np.flatnonzero(np.isfinite(least) & np.isfinite(most))
    bars = "".join(
        f'<rect x="{across * k:.1f}" y="{height * (high - most[k]):.1f}" width="{across + 0.1:.1f}" '
        f'height="{max(height * (most[k] - least[k]), 0.5):.1f}"/>'
        for k in known
    )
    dots = "".join(
        f'<rect x="{across * k:.1f}" y="{height * (high - angle[k]) - 0.6:.1f}" width="{across + 0.1:.1f}" '
        'height="1.2"/>'
        for k in np.flatnonzero(np.isfinite(angle))
    )
    return (
        f'<p style="margin:4px 0 0">{name}, {low:.0f}° to {high:.0f}°</p><svg viewBox="0 0 {_PANEL_WIDTH} '
        f'{_PANEL_HEIGHT}" style="width:100%;max-width:{_PANEL_WIDTH}px" role="img" aria-label="{name} over time">'
        f'<g fill="#0072B2" fill-opacity="0.3">{bars}</g><g fill="currentColor">{dots}</g></svg>'
    )


def _pictured(line: str, angles: FloatArray) -> str:
    """A log for notebooks: its line, and how far the attitude may be off in each row, rad."""
    said = f"<p>{escape(line)}</p>"
    if not np.isfinite(angles).any():
        return f"<div>{said}</div>"
    degrees = np.rad2deg(angles)
    return f"<div>{said}{_panel('largest angle', np.where(np.isnan(degrees), np.nan, 0.0), degrees, degrees)}</div>"


class PrincipalAxes(NamedTuple):
    """The semi-axes of an ellipsoid, longest first."""

    lengths: FloatArray
    """Shape (n,)."""
    directions: FloatArray
    """Unit vectors as columns, shape (n, n)."""


class Intersection(NamedTuple):
    """An ellipsoid that contains an intersection, and the share of each set in it."""

    ellipsoid: Ellipsoid
    share: float
    """0 is the first set alone, 1 the second."""


class Trajectory(NamedTuple):
    """States of a rigid body at n + 1 times."""

    times: FloatArray
    """In s, shape (n + 1,)."""
    attitudes: FloatArray
    """From body to reference axes, shape (n + 1, 3, 3)."""
    angular_velocities: FloatArray
    """In rad/s, body axes, shape (n + 1, 3)."""


class FlowLinearization(NamedTuple):
    """The state at the end of some steps, and the first-order effect on [ζ; δω] there.

    ζ is the error rotation vector on the body side, C = Ĉ exp(S(ζ)).
    """

    attitude: FloatArray
    """From body to reference axes, shape (..., 3, 3)."""
    angular_velocity: FloatArray
    """In rad/s, body axes, shape (..., 3)."""
    state: FloatArray
    """A, the effect of [ζ; δω] at the start, shape (..., 6, 6)."""
    control: FloatArray
    """B, the effect of a change of the control torque, shape (..., 6, 3)."""


class WahbaSolution(NamedTuple):
    """The attitude that fits directions best."""

    attitude: FloatArray
    """From body to reference axes, shape (..., 3, 3)."""
    cost: np.float64 | FloatArray
    """½ Σ wᵢ ‖eᵢ − C b̃ᵢ‖² of unit directions, shape (...)."""
    condition: np.float64 | FloatArray
    """Largest over smallest curvature of the cost, shape (...)."""


@dataclass(frozen=True)
class WahbaSet:
    """Ellipsoids of attitude errors that contain the truth, about the attitudes that fit directions best.

    The errors are coordinates of Ĉᵀ C, and the ellipsoids' centers are zero.
    """

    attitude: FloatArray
    """Ĉ, the Wahba solution for the weights, from body to reference axes, shape (..., 3, 3)."""
    shape: FloatArray
    """P in rad² of {x : xᵀ P⁻¹ x ≤ 1}, shape (..., 3, 3)."""
    chart: Chart
    """Whether x is ζ, with Ĉᵀ C = exp(S(ζ)), or γ = 2 tan(θ/2) n of the same turn."""
    margin: np.float64 | FloatArray
    """The margin: 1 for directions that fit exactly, 0 where they barely agree, shape (...)."""
    weights: FloatArray
    """Weights of the directions, given or found, shape (..., m)."""

    def largest_angle(self) -> np.float64 | FloatArray:
        """The largest attitude error in each set, rad, shape (...)."""
        longest = np.sqrt(np.linalg.eigvalsh(self.shape)[..., -1])
        angle: np.float64 | FloatArray = longest if self.chart == "exponential" else 2.0 * np.arctan(0.5 * longest)
        return angle

    def contains(self, attitude: AttitudeLike) -> np.bool_ | NDArray[np.bool_]:
        """Whether each attitude C, from body to reference axes, is in its set, shape (...)."""
        matrices = np.asarray(attitude.as_matrix() if isinstance(attitude, SupportsAsMatrix) else attitude)
        turn = np.swapaxes(self.attitude, -1, -2) @ matrices
        error = log(turn) if self.chart == "exponential" else 2.0 * cayley_inverse(turn)
        form = np.sum(error * np.linalg.solve(self.shape, error[..., None])[..., 0], axis=-1)
        inside: np.bool_ | NDArray[np.bool_] = form <= 1.0
        return inside


class Extent(NamedTuple):
    """How far a state ellipsoid reaches."""

    half_widths_body: FloatArray
    """Half-widths of the attitude error ζ (rad) and of the vector beside it (rad/s), along body axes, shape (6,)."""
    half_widths_reference: FloatArray
    """Half-widths of ζ along reference axes, rad, shape (3,)."""
    largest_angle: float
    """The largest ‖ζ‖ in the set, rad."""
    largest_angle_axis: FloatArray
    """Unit vector in body axes: the turn that is known least, shape (3,)."""
    greatest_uncertainty: FloatArray
    """Unit eigenvector of P to its largest eigenvalue, shape (6,)."""

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are equal."""
        return _equal(self, other)

    def __ne__(self, other: object) -> bool:
        """Whether any number differs."""
        return not _equal(self, other)


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
        return _span("FilterLog", self.times)

    def _repr_html_(self) -> str:
        """For notebooks: a small plot of the largest angle in each set."""
        return _pictured(repr(self), self.largest_angles() if len(self.times) else self.times)

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


Claim: TypeAlias = Literal["unconditional", "conditional", "none"]
CLAIMS: tuple[Claim, ...] = get_args(Claim)
"""The words for `GuaranteedLog.claims`, the strongest first.

'unconditional': the truth is in the set if all bounds that the filter used hold. 'conditional': if, besides,
the measurements that were dropped were the wrong ones. 'none': there is no set.
"""
IF_PROPOSED_BOUNDS_HOLD: dict[str, str] = {
    "unconditional": "have a set that holds if the proposed bounds do",
    "conditional": "one that also rests on what was dropped",
    "none": "none",
}
"""The claims in words if the bounds are only proposals: then there is no guarantee."""


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
        return _equal(self, other)

    def __ne__(self, other: object) -> bool:
        """Whether any number differs."""
        return not _equal(self, other)


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

    def __repr__(self) -> str:
        """One line: rows and claims."""
        return _span("GuaranteedLog", self.times, self.claims)

    def _repr_html_(self) -> str:
        """For notebooks: a small plot of the largest angle in each set."""
        return _pictured(repr(self), self.extents().largest_angles if len(self.times) else self.times)

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


@dataclass(frozen=True, eq=False, repr=False)
class AhrsResult:
    """Attitudes with their bounds, of n rows: what `elliptude.ahrs` returns. NaN where nothing is known.

    C = Rz(yaw) Ry(pitch) Rx(roll) takes body vectors to ENU: east, north, up; north is magnetic north.
    """

    times: FloatArray
    """In s, from the first whole second where they count from 1970, shape (n,)."""
    quaternions: FloatArray
    """(qw, qx, qy, qz) of the attitude, the center of its set, shape (n, 4)."""
    attitudes: FloatArray
    """The same as matrices, from body to reference axes, shape (n, 3, 3)."""
    roll_pitch_yaw: FloatArray
    """Roll and pitch of `ups`, also where no attitude is known, and yaw of the attitude, rad, shape (n, 3)."""
    least_roll_pitch_yaw: FloatArray
    """The truth is from here, up to whole turns, rad, shape (n, 3); −π to π: not defined, or anything."""
    most_roll_pitch_yaw: FloatArray
    """To here, rad, shape (n, 3)."""
    claims: NDArray[np.str_]
    """What attitude, yaw and sets rest on, a word of `elliptude.results.CLAIMS`, shape (n,)."""
    tilt_bounds: FloatArray
    """How far the attitude's up may be from true up, by `up_claims`, rad, shape (n,)."""
    heading_from: FloatArray
    """The turn about up from the attitude to the truth is at least this, rad, shape (n,)."""
    heading_to: FloatArray
    """And at most this, rad, shape (n,)."""
    largest_angles: FloatArray
    """The largest attitude error in each set, rad, shape (n,)."""
    ups: FloatArray
    """Up as well as it is known, unit vectors, body axes, shape (n, 3)."""
    up_bounds: FloatArray
    """How far true up may be from there, rad, shape (n,)."""
    up_claims: NDArray[np.str_]
    """What up, roll and pitch rest on, shape (n,)."""
    sets: GuaranteedLog
    """The sets themselves."""
    statements: str
    """What the bounds of the sensors' errors come from, as it was given."""
    are_proposals: bool
    """Whether they are only what the recording showed: then nothing is guaranteed."""
    heading: str
    """What yaw counts from: "from magnetic east", or "from the first row" without a magnetometer; or "not known"."""
    dropped: Mapping[str, int]
    """How many measurements of each sensor were left out, as they contradict the others or their own bounds."""
    notes: tuple[str, ...]
    """What a reader should know: why there is no set, gaps in the gyro, and which axis was up at rest."""
    columns: Mapping[str, NDArray[Any]]
    """The table that `elliptude estimate` writes, by its columns' names."""

    def __len__(self) -> int:
        """The number of rows."""
        return len(self.times)

    @property
    def claim_shares(self) -> dict[str, float]:
        """The share of rows with each claim of the attitude."""
        return {claim: float(np.mean(self.claims == claim)) for claim in CLAIMS}

    def contains(self, true_attitudes: AttitudeLike) -> NDArray[np.bool_]:
        """Whether attitudes (n, 3, 3) or a Rotation of SciPy, from body to the same axes, are in the sets, (n,)."""
        inside: NDArray[np.bool_] = self.sets.forms(true_attitudes) <= 1.0
        return inside

    def to_frame(self, library: Literal["pandas", "polars"] | None = None) -> Any:
        """The table that `elliptude estimate` writes as a data frame.

        Parameters
        ----------
        library : {"pandas", "polars"}, optional
            The one that is installed, pandas first, if left out.

        Raises
        ------
        ModuleNotFoundError
            If it is not installed.
        ValueError
            If it is another one.
        """
        if library not in {None, "pandas", "polars"}:
            raise ValueError(f"library: {library!r}, neither 'pandas' nor 'polars'")
        for name in (library,) if library is not None else ("pandas", "polars"):
            try:
                return import_module(name).DataFrame(dict(self.columns))
            except ModuleNotFoundError:
                continue
        raise ModuleNotFoundError(f"to_frame needs {library or 'pandas or polars'}, which is not installed")

    def __repr__(self) -> str:
        """One line: rows, claims, mean bounds."""
        span = f"{self.times[0]:.6g} to {self.times[-1]:.6g} s"
        claims = ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in self.claim_shares.items())
        bounds = ", ".join(f"{name} {size}" for name, size in self._means().items())
        doubt = "; by proposals, no guarantee" if self.are_proposals else ""
        return f"<AhrsResult: {len(self)} rows, {span}; claims: {claims}; mean bounds: {bounds}{doubt}>"

    def _repr_html_(self) -> str:
        """For notebooks: a small plot of roll, pitch and yaw with their bounds, and the mean bounds."""
        angles = (self.least_roll_pitch_yaw, self.most_roll_pitch_yaw, self.roll_pitch_yaw)
        panels = "".join(
            _panel(name, *(np.rad2deg(values[:, i]) for values in angles))
            for i, name in enumerate(("roll", "pitch", "yaw"))
        )
        rows = {f"{name} (mean bound)": size for name, size in self._means().items()}
        rows |= {f"claim: {name}": f"{100.0 * share:.4g} % of rows" for name, share in self.claim_shares.items()}
        rows |= {"statements": self.statements + (", proposals: no guarantee" if self.are_proposals else "")}
        rows |= {"yaw": f"counts {self.heading}"}
        table = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td>{escape(value)}</td></tr>'
            for name, value in rows.items()
        )
        return f"<div><table>{table}</table>{panels}</div>"

    def _means(self) -> dict[str, str]:
        """Mean bounds over rows that have any, in degrees."""
        heading = np.maximum(-self.heading_from, self.heading_to)
        bounds = {"up": self.up_bounds, "tilt": self.tilt_bounds, "heading": heading, "angle": self.largest_angles}
        known = {name: values[np.isfinite(values)] for name, values in bounds.items()}
        return {
            name: f"{np.rad2deg(values.mean()):.3g}°" if len(values) else "not known" for name, values in known.items()
        }
