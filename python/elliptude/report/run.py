"""A run for pictures and the report: results, whole or with gaps, and what they are compared with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.bounds.angles.about_axes import AboutAxes, ErrorAxes, about_axes
from elliptude.estimation.containment import attitude_forms, reach_of_turns
from elliptude.io.tables import (
    attitudes_from_quaternions,
)
from elliptude.logs.reference_attitudes import Reference, attitudes_at
from elliptude.report.axes.body_axes import turns
from elliptude.report.estimated.stored import MeasuredSensor
from elliptude.results import CLAIMS, Claim
from elliptude.typing import Chart, FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

SPELL_GAP = 1.0
"""Measurements left out within this time of one another are listed together, s."""
# Sets up to the first size are magnified by one of these factors, so that they are at most the second, rad.
_LARGEST_DRAWN = np.deg2rad(20.0)
_MAGNIFICATIONS: tuple[int, ...] = tuple(digit * scale for scale in (1, 10, 100, 1000, 10_000) for digit in (1, 2, 5))


class Refusal(NamedTuple):
    """Measurements of one row that did not go into its set."""

    time: float
    """s."""
    sensors: str
    """Names, with a space between them."""
    what: Literal["dropped", "refused", "own bound"]
    """Left out by itself, with all others of its row because the sets did not meet, or by its own bound."""


class Spell(NamedTuple):
    """Refusals of the same measurements, one soon after the other."""

    first: float
    """s."""
    last: float
    """s."""
    sensors: str
    """Names, with a space between them."""
    what: str
    """As in `Refusal`."""
    measurements: int
    """How many."""


@dataclass(frozen=True, eq=False)
class DroppedMeasurements:
    """n measurements that were left out, in order of time, from ``dropped.csv``."""

    times: FloatArray
    """s, shape (n,)."""
    places: tuple[str, ...]
    """Lines or rows of the log."""
    sensors: tuple[str, ...]
    """Name of each sensor."""
    contradicts: tuple[str, ...]
    """``prediction``, ``prediction_of_up`` or ``own_bound``."""
    margins: FloatArray
    """How far the sets were from meeting, or minus what is missing to the own bound, shape (n,)."""
    units: tuple[str, ...]
    """Units of the margins; empty for those of sets."""


@dataclass(frozen=True, eq=False)
class Run:
    """The attitudes of a run with their sets; NaN where nothing is known."""

    times: FloatArray
    """s, strictly increasing, shape (N,), since ``origin``."""
    quaternions: FloatArray
    """(qw, qx, qy, qz) of the attitude from body to reference axes, shape (N, 4)."""
    shapes: FloatArray
    """P of the attitude error, rad², shape (N, 3, 3)."""
    half_widths: FloatArray
    """How far the attitude error reaches along body axes, rad, shape (N, 3)."""
    largest_angles: FloatArray
    """The largest attitude error in the set, rad, shape (N,)."""
    used: tuple[str, ...]
    """The sensors that went into each row, with a space between their names."""
    refused: tuple[str, ...]
    """The sensors of rows whose sets did not meet, likewise."""
    dropped: tuple[str, ...] | None = None
    """The sensors that were left out by themselves, likewise; None if the table does not say."""
    claims: tuple[str, ...] | None = None
    """A `Claim`, or empty, for each row; None if the table does not say."""
    chart: Chart = "exponential"
    """The coordinates of the error whose shape P is."""
    errors: FloatArray | None = None
    """ζ of the reference from the estimate, rotation vectors in rad, body axes, shape (N, 3)."""
    forms: FloatArray | None = None
    """The quadratic form of the reference, or the least of all attitudes within its error, shape (N,).

    At most 1 inside the set; infinite for a set without volume.
    """
    reference_error: float = 0.0
    """Angle by which the reference may itself be off, rad."""
    prediction_used: FloatArray | None = None
    """1 where the prediction went into the set, 0 where it did not, shape (N,); None if the table does not say."""
    tilt_bounds: FloatArray | None = None
    """Bound of the angle between estimated and true up, rad, shape (N,); None if the table does not say."""
    headings: FloatArray | None = None
    """The turn about the vertical from the estimate to the truth, at least and at most, rad, shape (N, 2)."""
    ups: FloatArray | None = None
    """Up as well as it is known, unit vectors, body axes, shape (N, 3); also where no attitude is known."""
    up_bounds: FloatArray | None = None
    """How far up may be off, rad, shape (N,); also where no attitude is known."""
    up_claims: tuple[str, ...] | None = None
    """What that rests on, in the words of ``claims``."""
    roll_pitch_yaw: FloatArray | None = None
    """Roll, pitch and yaw, each with the angles between which the truth is, rad, shape (N, 9)."""
    turns_reference: FloatArray | None = None
    """From and to which angle the turn about each reference axis is, rad, shape (N, 6); None if it was not asked."""
    turns_body: FloatArray | None = None
    """The same about each body axis, shape (N, 6)."""
    listed: DroppedMeasurements | None = None
    """Every measurement that was left out by itself; None without a list."""
    measured: tuple[MeasuredSensor, ...] = ()
    """What the sensors measured; empty if nothing says it."""
    why_not_measured: str | None = None
    """Why it is not known, although there is a file of it."""
    void: tuple[str, ...] = ()
    """Sensors that were left out from beginning to end because they contradict their own bounds."""
    heading_from_start: bool = False
    """Whether the heading counts from the first row, because nothing determines it."""
    gaps: tuple[str, ...] = ()
    """Lines about gaps in the gyro, and what they cost."""
    smoothing: tuple[str, ...] = ()
    """Lines about smoothing, and what it gained; empty without."""
    implausible: tuple[str, ...] = ()
    """Contradictions between log and configuration that were ignored."""
    suspicious: tuple[str, ...] = ()
    """What may be wrong with the log or with what is stated."""
    bounds_from_recording: str | None = None
    """The recording that the bounds are proposals from; None if they have reasons."""
    up_at_rest: str | None = None
    """Which body axis was up at rest, in words."""
    best: str | None = None
    """Whose the best estimate beside the sets is, and how far it may be off, in words; None without one."""
    frame: str | None = None
    """The reference frame, as a configuration calls it; None if nothing says it."""
    title: str | None = None
    """What the pictures of the estimation are called; None if nothing says it."""
    axes: ErrorAxes = "reference"
    """About which axes errors and half-widths are shown."""
    clock_turns: FloatArray | None = None
    """How far the body may turn within the offset of the rows' stamps against others', rad, shape (N,); None: not."""
    origin: int = 0
    """The second of the recording's clock that the times count from."""
    longest_step: float | None = None
    """A longer step between rows, s, is a gap; None if nothing says it."""
    in_gap: NDArray[np.bool_] | None = None
    """Which rows are nothing in a gap, shape (N,), as `elliptude.report.breaks.broken` has them; None: none is."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Rows with an attitude and a set, shape (N,)."""
        return np.asarray(np.isfinite(self.quaternions[:, 0]) & np.isfinite(self.largest_angles))

    @property
    def heading_bounds(self) -> FloatArray | None:
        """How far the heading may be off to either side, rad, shape (N,); None if the table does not say."""
        return None if self.headings is None else np.abs(self.headings).max(axis=1)

    @property
    def up_alone(self) -> NDArray[np.bool_]:
        """Rows in which up is known, and no attitude, shape (N,)."""
        if self.up_bounds is None:
            return np.zeros(len(self.times), dtype=bool)
        return np.asarray(np.isfinite(self.up_bounds) & ~self.known)

    @property
    def tilt_beyond_set(self) -> int:
        """In how many rows the bound of the tilt, by a stronger claim than the set's, is above its largest angle."""
        if self.tilt_bounds is None or self.claims is None or self.up_claims is None:
            return 0
        ranks = {claim: rank for rank, claim in enumerate((*CLAIMS, ""))}
        stronger = [ranks[up] < ranks[own] for up, own in zip(self.up_claims, self.claims, strict=True)]
        return int((np.array(stronger) & (self.tilt_bounds > self.largest_angles)).sum())

    @property
    def attitudes(self) -> FloatArray:
        """From body to reference axes, NaN where not known, shape (N, 3, 3)."""
        attitudes = np.full((len(self.times), 3, 3), np.nan)
        known = np.isfinite(self.quaternions).all(axis=1)
        if known.any():
            attitudes[known] = attitudes_from_quaternions(self.quaternions[known])
        return attitudes

    def about_axes(self) -> AboutAxes:
        """Errors and half-widths about the axes that are shown."""
        return about_axes(
            self.axes,
            self.attitudes,
            self.shapes,
            self.chart,
            self.half_widths,
            self.errors,
            turns=self.turns_reference if self.axes == "reference" else self.turns_body,
            frame=self.frame,
            heading_from_start=self.heading_from_start,
        )

    @property
    def escaped(self) -> NDArray[np.bool_]:
        """Rows whose reference lies outside the set, shape (N,)."""
        if self.forms is None:
            return np.zeros(len(self.times), dtype=bool)
        return np.asarray(self.forms > 1.0)

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Rows that have a set and a reference, shape (N,)."""
        if self.forms is None:
            return np.zeros(len(self.times), dtype=bool)
        return np.asarray(~np.isnan(self.forms) & self.known)

    def claimed(self, claim: Claim) -> NDArray[np.bool_]:
        """Rows with this claim, shape (N,)."""
        if self.claims is None:
            return np.zeros(len(self.times), dtype=bool)
        return np.array([one == claim for one in self.claims])

    def refusals(self) -> Iterator[Refusal]:
        """The measurements of each row that did not go in, in time order."""
        dropped = self.dropped if self.dropped is not None and self.listed is None else ("",) * len(self.times)
        found = [] if self.listed is None else self._of_list(self.listed)
        for time, alone, together in zip(self.times, dropped, self.refused, strict=True):
            if alone:
                found.append(Refusal(float(time), alone, "dropped"))
            if together and together != alone:
                found.append(Refusal(float(time), together, "refused"))
        yield from sorted(found, key=lambda refusal: refusal.time)

    @staticmethod
    def _of_list(listed: DroppedMeasurements) -> list[Refusal]:
        return [
            Refusal(float(time), sensor, "own bound" if why == "own_bound" else "dropped")
            for time, sensor, why in zip(listed.times, listed.sensors, listed.contradicts, strict=True)
        ]

    def refusal_spells(self) -> list[Spell]:
        """The refusals in spells of the same sensors, with at most `SPELL_GAP` between one time and the next."""
        spells: list[Spell] = []
        last: dict[tuple[str, str], int] = {}
        for refusal in self.refusals():
            key = (refusal.sensors, refusal.what)
            i = last.get(key)
            if i is not None and refusal.time - spells[i].last <= SPELL_GAP:
                spells[i] = spells[i]._replace(last=refusal.time, measurements=spells[i].measurements + 1)
            else:
                last[key] = len(spells)
                spells.append(Spell(refusal.time, refusal.time, *key, 1))
        return spells

    def against(self, reference: Reference, largest_gap: float = 0.0, reference_error: float = 0.0) -> Self:
        """The run compared with other attitudes.

        Parameters
        ----------
        reference : Reference
            What `elliptude.logs.reference_attitudes.read_reference` returns for the run's origin.
        largest_gap : float
            If the reference has no sample at a row's time, it is interpolated between two no further apart, s.
        reference_error : float
            Angle by which the reference may itself be off, rad: its form is the least of all attitudes that near.

        Returns
        -------
        Run
            With errors and forms of the attitude; NaN where there is no reference. If the heading counts from the
            first row, so does the reference's, as in what `elliptude estimate` compares.

        Raises
        ------
        ValueError
            If the heading counts from the first row and that has no reference.
        """
        errors, forms = np.full((len(self.times), 3), np.nan), np.full(len(self.times), np.nan)
        rows, true = attitudes_at(reference, self.times, np.flatnonzero(self.known), largest_gap)
        if len(rows):
            if self.heading_from_start:
                true = self._counted_from_start(rows, true)
            relative = (
                scipy.spatial.transform.Rotation.from_quat(self.quaternions[rows], scalar_first=True).inv() * true
            )
            errors[rows] = relative.as_rotvec()
            offsets = errors[rows] if self.chart == "exponential" else _gibbs(relative)
            distance: float | FloatArray = reference_error
            if self.clock_turns is not None:
                distance = reference_error + reach_of_turns(offsets, self.clock_turns[rows])
            forms[rows] = attitude_forms(offsets, self.shapes[rows], distance)
        return replace(self, errors=errors, forms=forms, reference_error=reference_error)

    def _counted_from_start(self, rows: NDArray[np.intp], true: Rotation) -> Rotation:
        """References turned so that the first one differs from the first estimate by a tilt alone, section 18.6."""
        if rows[0] != np.flatnonzero(self.known)[0]:
            raise ValueError(
                f"the heading counts from the first row, at {self.times[0]:.6f} s, and the reference has nothing there"
            )
        estimated = scipy.spatial.transform.Rotation.from_quat(self.quaternions[rows[0]], scalar_first=True)
        up, true_up = (one.inv().apply([0.0, 0.0, 1.0]) for one in (estimated, true[0]))
        axis = np.cross(true_up, up)
        sine = float(np.linalg.norm(axis))
        tilt = scipy.spatial.transform.Rotation.identity()
        if sine > 0.0:
            tilt = scipy.spatial.transform.Rotation.from_rotvec(np.arctan2(sine, true_up @ up) / sine * axis)
        return estimated * tilt * true[0].inv() * true

    def magnification(self, rows: NDArray[np.intp]) -> int:
        """How many times as large the sets of these rows are drawn on a sphere: small ones would be dots."""
        sizes = self.largest_angles[rows][self.known[rows]]
        if len(sizes) == 0:
            return 1
        return magnification_to(_LARGEST_DRAWN, sizes)

    def true_axes(self, magnification: int = 1) -> FloatArray:
        """The reference's body axes as columns, NaN where not known, (N, 3, 3).

        Its error is magnified in the coordinates of the sets, so that it is in a magnified set if it is in the set.
        """
        axes = np.full((len(self.times), 3, 3), np.nan)
        if self.errors is None:
            return axes
        rows = np.flatnonzero(np.isfinite(self.errors).all(axis=1) & self.known)
        if len(rows):
            angles = np.linalg.norm(self.errors[rows], axis=1)
            drawn = magnification * angles
            if self.chart == "gibbs":
                drawn = 2.0 * np.arctan(magnification * np.tan(0.5 * angles))
            factors = np.divide(drawn, angles, out=np.full(len(rows), float(magnification)), where=angles > 0.0)
            axes[rows] = self.attitudes[rows] @ turns(factors[:, None] * self.errors[rows], "exponential").as_matrix()
        return axes


def magnification_to(largest: float, angles: FloatArray) -> int:
    """The largest factor, of those that pictures have, by which nearly all of some angles are at most ``largest``."""
    fits = largest / max(float(np.quantile(angles, 0.9)), 1e-12)
    return max(step for step in _MAGNIFICATIONS if step <= max(fits, 1.0))


def _gibbs(turn: Rotation) -> FloatArray:
    """2 tan(θ/2) n, shape (M, 3)."""
    quaternions = turn.as_quat(canonical=True, scalar_first=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(2.0 * quaternions[:, 1:] / quaternions[:, :1])
