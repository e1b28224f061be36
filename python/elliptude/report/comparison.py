"""Compares results with a reference attitude: whether it is in the sets, how far centers are off, how wide sets are.

What evo calls absolute and relative pose errors of rotations are computed as evo does (github.com/MichaelGrupp/evo).
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.bounds.angles.about_axes import half_widths_along
from elliptude.configuration.configuration import Configuration
from elliptude.io.files import FileError, replacing
from elliptude.logs.quaternion_readings import Reading, misread, not_as_declared, readings_of
from elliptude.logs.reference_attitudes import Reference, attitudes_at, in_words_of_origin, read_reference
from elliptude.report.run import Run
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Alignment: TypeAlias = Literal["none", "origin", "all"]
"""Which rows a reference is turned onto: none of them, the first one, or all, as well as that can be."""

# s; a row this much too early still counts as a span later, and is as much too early by rounding.
_SAME_TIME = 1e-6
# A pair of rows counts if its span is a stated time within this share of it: evo's tolerance.
_SPAN_TOLERANCE = 0.1
# s; the shortest time between attitudes whose turn is compared, and the factor to the next one.
_SHORTEST_SPAN, _LONGER = 0.5, 4.0
# Degrees and share: a reading is wrong if it is this far off and another one is nearer than this share of that.
_FAR_OFF, _MUCH_NEARER = 20.0, 0.25


@dataclass(frozen=True, eq=False)
class Comparison:
    """The rows that have an attitude and a reference, n of them."""

    rows: int
    """Rows of the table."""
    times: FloatArray
    """s, shape (n,)."""
    estimated: Rotation
    """n centers."""
    true: Rotation
    """n references."""
    angles: FloatArray
    """Angles between them, rad, shape (n,)."""
    inside: NDArray[np.bool_] | None
    """Whether the reference, as far as it is known, is in the set, shape (n,); None if the reference was aligned."""
    half_widths_body: FloatArray
    """rad, shape (n, 3)."""
    half_widths_reference: FloatArray
    """rad, shape (n, 3)."""
    claims: NDArray[np.object_] | None
    """Shape (n,)."""
    alignment: Alignment = "none"
    turned: float = 0.0
    """Angle by which that turned the reference, rad."""

    @property
    def broken_promises(self) -> int:
        """How many rows claim to hold without a condition, and do not."""
        if self.claims is None or self.inside is None:
            return 0
        return int((~self.inside & (self.claims == "unconditional")).sum())

    def to_dict(self) -> dict[str, Any]:
        """Figures in degrees: for all compared rows, and for each claim if the table has claims."""
        count = len(self.times)
        result: dict[str, Any] = {
            "rows": self.rows,
            "alignment": self.alignment,
            "turned_deg": float(np.rad2deg(self.turned)),
            "all": self._figures(np.ones(count, dtype=np.bool_)),
        }
        claims = self.claims
        result["by_claim"] = None if claims is None else {claim: self._figures(claims == claim) for claim in CLAIMS}
        return result

    def _figures(self, chosen: NDArray[np.bool_]) -> dict[str, Any]:
        count = int(chosen.sum())
        figures: dict[str, Any] = {
            "compared": count,
            "share_of_rows": count / self.rows,
            "inside": None if self.inside is None else int(self.inside[chosen].sum()),
            "inside_share": float(self.inside[chosen].mean()) if count and self.inside is not None else None,
        }
        figures["error_deg"] = _statistics(self.angles[chosen])
        for name, widths in (("body", self.half_widths_body), ("reference", self.half_widths_reference)):
            degrees = np.rad2deg(widths[chosen])
            figures[f"half_width_{name}_deg"] = (
                {"mean": degrees.mean(axis=0).tolist(), "max": degrees.max(axis=0).tolist()} if count else None
            )
        return figures

    def relative(self, *, rows: int | None = None, seconds: float | None = None, all_pairs: bool = False) -> FloatArray:
        """Angles between a turn of the body as estimated and as the reference has it: evo's relative pose error.

        A turn is that from one compared row to a later one. Alignment changes none of them.

        Parameters
        ----------
        rows : int, optional
            Compared rows from the one to the other, at least 1.
        seconds : float, optional
            Time from the one to the other, within a tenth of it, s; positive. One of both is stated.
        all_pairs : bool
            Begin a turn at each row, and end it at the row whose time fits best. Otherwise one begins where the last
            one ended, and ends at the first row that is ``seconds`` later.

        Returns
        -------
        array
            rad, one for each pair.

        Raises
        ------
        ValueError
            If there is no such pair.
        """
        assert (rows is None) != (seconds is None)
        if rows is not None:
            first = np.arange(0, len(self.times) - rows, 1 if all_pairs else rows)
            last = first + rows
        else:
            assert seconds is not None
            first, last = (_best_pairs if all_pairs else _pairs_in_turn)(self.times, seconds)
        if not len(first):
            span = f"{rows} compared rows" if rows is not None else f"{seconds:g} s"
            raise ValueError(
                f"no two of the {len(self.times)} compared rows are {span} apart; they cover "
                f"{self.times[-1] - self.times[0]:g} s"
            )
        turns = [attitudes[first].inv() * attitudes[last] for attitudes in (self.true, self.estimated)]
        return np.asarray((turns[0].inv() * turns[1]).magnitude())

    def write_tum(self, folder: Path) -> tuple[Path, Path]:
        """Write both trajectories as TUM files: ``timestamp tx ty tz qx qy qz qw``, the place always zero.

        Parameters
        ----------
        folder : pathlib.Path
            Must be there; ``estimate.tum`` and ``reference.tum`` in it are replaced.

        Returns
        -------
        tuple of pathlib.Path
            Estimate and reference.

        Raises
        ------
        FileError
            If they cannot be written.
        """
        written = folder / "estimate.tum", folder / "reference.tum"
        for path, attitudes in zip(written, (self.estimated, self.true), strict=True):
            rows = np.column_stack([self.times, np.zeros((len(self.times), 3)), attitudes.as_quat(canonical=True)])
            with replacing(path) as temporary:
                np.savetxt(temporary, rows, fmt=["%.9f", *["%g"] * 3, *["%.15f"] * 4])
        return written


def _statistics(angles: FloatArray) -> dict[str, float] | None:
    """Mean, root of the mean square and maximum, degrees; None of no angles."""
    if not len(angles):
        return None
    degrees = np.rad2deg(angles)
    return {
        "mean": float(degrees.mean()),
        "rms": float(np.sqrt(np.mean(degrees**2))),
        "max": float(degrees.max()),
    }


def relative_figures(
    comparison: Comparison, *, rows: int | None = None, seconds: float | None = None, all_pairs: bool = False
) -> dict[str, Any]:
    """What `elliptude compare` says of the relative error; parameters as of `Comparison.relative`."""
    angles = comparison.relative(rows=rows, seconds=seconds, all_pairs=all_pairs)
    return {
        "delta_rows": rows,
        "delta_s": seconds,
        "all_pairs": all_pairs,
        "pairs": len(angles),
        "error_deg": _statistics(angles),
    }


def _pairs_in_turn(times: FloatArray, span: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Each pair begins where the last one ended; those over gaps are left out."""
    next_rows = np.searchsorted(times, times + (span - _SAME_TIME))
    chain = [0]
    while next_rows[chain[-1]] < len(times):
        chain.append(int(max(next_rows[chain[-1]], chain[-1] + 1)))
    first, last = np.array(chain[:-1], dtype=np.intp), np.array(chain[1:], dtype=np.intp)
    fits = times[last] - times[first] <= (1.0 + _SPAN_TOLERANCE) * span
    return first[fits], last[fits]


def _best_pairs(times: FloatArray, span: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For each row the later one whose time from there is nearest to the span."""
    first = np.arange(len(times) - 1, dtype=np.intp)
    after = np.clip(np.searchsorted(times, times[first] + span), first + 1, len(times) - 1)
    before = np.maximum(after - 1, first + 1)
    off = [np.abs(times[last] - times[first] - span) for last in (before, after)]
    last = np.where(off[0] <= off[1], before, after)
    fits = np.minimum(*off) <= _SPAN_TOLERANCE * span
    return first[fits], last[fits]


def _turn_onto(run: Run, reference: Reference, largest_gap: float, alignment: Alignment) -> Rotation:
    """What the reference is turned by, in reference axes, to lie on the centers of the sets.

    Over all rows it is the turn that leaves the least sum of squares of the differences of the matrices' entries:
    Umeyama's, with the body's axes for points.
    """
    rows, read = attitudes_at(reference, run.times, np.flatnonzero(run.known), largest_gap)
    if not len(rows):
        return scipy.spatial.transform.Rotation.identity()
    turns = scipy.spatial.transform.Rotation.from_quat(run.quaternions[rows], scalar_first=True) * read.inv()
    return turns[0] if alignment == "origin" else turns.mean()


def compare(
    run: Run,
    reference: Reference,
    *,
    largest_gap: float = 0.0,
    reference_error: float = 0.0,
    alignment: Alignment = "none",
) -> Comparison:
    """Compare each row with the reference of its time.

    Parameters
    ----------
    run : Run
    reference : Reference
    largest_gap : float
        If the reference has no sample at a row's time, it is interpolated between two that are no further apart, s.
    reference_error : float
        Angle by which the reference may itself be off, rad: a row counts as inside if any attitude that near is.
    alignment : {"none", "origin", "all"}
        Turn the reference onto the estimate first, by one turn in reference axes: at the first compared row, or as
        well as it can be at all of them. It then takes on errors of the estimate, so that no row counts as inside or
        outside.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If no row has a reference.
    """
    turned = 0.0
    if alignment != "none":
        run = replace(run, heading_from_start=False)
        turn = _turn_onto(run, reference, largest_gap, alignment)
        turned = float(turn.magnitude())
        reference = Reference(reference.times, turn * reference.attitudes)
    compared = run.against(reference, largest_gap, reference_error)
    rows = np.flatnonzero(compared.compared)
    if not len(rows):
        raise ValueError(f"no row with a set has a reference of its time{in_words_of_origin(run.origin)}")
    assert compared.errors is not None
    assert compared.forms is not None
    estimated = scipy.spatial.transform.Rotation.from_quat(run.quaternions[rows], scalar_first=True)
    errors = scipy.spatial.transform.Rotation.from_rotvec(compared.errors[rows])
    return Comparison(
        rows=len(run.times),
        times=run.times[rows],
        estimated=estimated,
        true=estimated * errors,
        angles=np.asarray(errors.magnitude()),
        inside=compared.forms[rows] <= 1.0 if alignment == "none" else None,
        half_widths_body=run.half_widths[rows],
        half_widths_reference=half_widths_along(estimated.as_matrix(), run.shapes[rows], run.chart),
        claims=None if run.claims is None else np.array(run.claims, dtype=object)[rows],
        alignment=alignment,
        turned=turned,
    )


def run_against(
    run: Run,
    path: str | os.PathLike[str],
    configuration: Configuration | None = None,
    *,
    largest_gap: float = 0.0,
    reference_error: float | None = None,
) -> Run:
    """The run compared with the reference attitudes of a file, for pictures.

    Parameters
    ----------
    run : Run
    path : path-like
        As in `elliptude.logs.reference_attitudes.read_reference`.
    configuration : Configuration, optional
        Its section ``truth`` says what the columns are.
    largest_gap : float
        As in `compare`.
    reference_error : float, optional
        Angle by which the reference may itself be off, rad; if left out, what the configuration states, or 0.

    Returns
    -------
    Run
        With errors and forms against them.

    Raises
    ------
    FileError
        If there are none, they are misread, or no row with a set has one.
    """
    reference = read_reference(path, configuration, origin=run.origin)
    truth = None if configuration is None else configuration.truth
    choices = readings_of(truth)
    if reference_error is None:
        reference_error = 0.0 if truth is None else math.radians(truth.error_deg)
    found = misread_reference(run, reference, choices, largest_gap=largest_gap)
    if found is not None:
        raise FileError(not_as_declared(f"{path}: {found}"))
    try:
        compared = run.against(reference, largest_gap, reference_error)
    except ValueError as error:
        raise FileError(f"{path}: {error}") from error
    if not compared.compared.any():
        raise FileError(
            f"{path}: no row with a set has a reference of its time; rows are from {run.times[0]:g} s to "
            f"{run.times[-1]:g} s, and the largest gap that the reference is interpolated over is {largest_gap:g} s"
            f"{in_words_of_origin(run.origin)}"
        )
    return compared


def misread_reference(
    run: Run,
    reference: Reference,
    choices: tuple[Reading, ...],
    *,
    largest_gap: float = 0.0,
    against: str = "the estimate",
) -> str | None:
    """Check whether the reference's quaternions are read in a wrong order or as their inverse.

    They are if the reference does not turn as the estimate does, or is far off from it, and is not when its columns
    are read another way: the test of `elliptude check`, with the estimate instead of the gyro.

    Parameters
    ----------
    run : Run
    reference : Reference
    choices : tuple of Reading
        Readings that `elliptude.logs.quaternion_readings.readings` returns: the declared one, and the others.
    largest_gap : float
        As in `compare`.
    against : str
        What the run's attitudes are called.

    Returns
    -------
    str, optional
        In words; None if nothing is wrong, or there is too little data.
    """
    rows, read = attitudes_at(reference, run.times, np.flatnonzero(run.known), largest_gap)
    if len(rows) < 2:
        return None
    estimated, times = (
        scipy.spatial.transform.Rotation.from_quat(run.quaternions[rows], scalar_first=True),
        run.times[rows],
    )
    span = _SHORTEST_SPAN
    while span < times[-1] - times[0]:
        later = np.searchsorted(times, times + span)
        earlier = np.flatnonzero(later < len(times))
        later = later[earlier]
        turns = (estimated[earlier].inv() * estimated[later]).as_rotvec()
        found = misread(read[earlier], read[later], turns, choices)
        if found is not None and found.fitting is not None:
            return f"turns {found.slope:.2g} times as far as {against}, and as far when read {found.fitting}"
        span *= _LONGER
    if run.heading_from_start:  # the frames differ
        return None
    medians = [float(np.rad2deg(np.median((estimated.inv() * choice(read)).magnitude()))) for choice in choices]
    best = int(np.argmin(medians))
    if medians[0] > _FAR_OFF and medians[best] < _MUCH_NEARER * medians[0]:
        return (
            f"is {medians[0]:.3g} degrees off from {against} (median), and {medians[best]:.3g} when read "
            f"{choices[best]}"
        )
    return None
