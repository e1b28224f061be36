"""Compares results with a reference attitude: whether it is in the sets, how far centers are off, how wide sets are."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from elliptude.io.files import replacing
from elliptude.logs.quaternion_readings import Reading, misread
from elliptude.logs.reference_attitudes import Reference, attitudes_at
from elliptude.report.run import Run
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray

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
    inside: NDArray[np.bool_]
    """Whether the reference, as far as it is known, is in the set, shape (n,)."""
    half_widths_body: FloatArray
    """rad, shape (n, 3)."""
    half_widths_reference: FloatArray
    """rad, shape (n, 3)."""
    claims: NDArray[np.object_] | None
    """Shape (n,)."""

    @property
    def broken_promises(self) -> int:
        """How many rows claim to hold without a condition, and do not."""
        return 0 if self.claims is None else int((~self.inside & (self.claims == "unconditional")).sum())

    def to_dict(self) -> dict[str, Any]:
        """Figures in degrees: for all compared rows, and for each claim if the table has claims."""
        count = len(self.times)
        result: dict[str, Any] = {"rows": self.rows, "all": self._figures(np.ones(count, dtype=np.bool_))}
        claims = self.claims
        result["by_claim"] = None if claims is None else {claim: self._figures(claims == claim) for claim in CLAIMS}
        return result

    def _figures(self, chosen: NDArray[np.bool_]) -> dict[str, Any]:
        count = int(chosen.sum())
        figures: dict[str, Any] = {
            "compared": count,
            "share_of_rows": count / self.rows,
            "inside": int(self.inside[chosen].sum()),
            "inside_share": float(self.inside[chosen].mean()) if count else None,
        }
        angles = np.rad2deg(self.angles[chosen])
        figures["error_deg"] = (
            {"mean": float(angles.mean()), "rms": float(np.sqrt(np.mean(angles**2))), "max": float(angles.max())}
            if count
            else None
        )
        for name, widths in (("body", self.half_widths_body), ("reference", self.half_widths_reference)):
            degrees = np.rad2deg(widths[chosen])
            figures[f"half_width_{name}_deg"] = (
                {"mean": degrees.mean(axis=0).tolist(), "max": degrees.max(axis=0).tolist()} if count else None
            )
        return figures

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


def compare(run: Run, reference: Reference, *, largest_gap: float = 0.0, reference_error: float = 0.0) -> Comparison:
    """Compare each row with the reference of its time.

    Parameters
    ----------
    run : Run
    reference : Reference
    largest_gap : float
        If the reference has no sample at a row's time, it is interpolated between two that are no further apart, s.
    reference_error : float
        Angle by which the reference may itself be off, rad: a row counts as inside if any attitude that near is.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If no row has a reference.
    """
    compared = run.against(reference, largest_gap, reference_error)
    rows = np.flatnonzero(compared.compared)
    if not len(rows):
        raise ValueError("no row with a set has a reference of its time")
    assert compared.errors is not None
    assert compared.forms is not None
    estimated = Rotation.from_quat(run.quaternions[rows], scalar_first=True)
    errors = Rotation.from_rotvec(compared.errors[rows])
    matrices = estimated.as_matrix()
    along_reference = np.sqrt(np.einsum("nij,njk,nik->ni", matrices, run.shapes[rows], matrices))
    if run.chart == "gibbs":
        along_reference = 2.0 * np.arctan(0.5 * along_reference)
    return Comparison(
        rows=len(run.times),
        times=run.times[rows],
        estimated=estimated,
        true=estimated * errors,
        angles=np.asarray(errors.magnitude()),
        inside=compared.forms[rows] <= 1.0,
        half_widths_body=run.half_widths[rows],
        half_widths_reference=along_reference,
        claims=None if run.claims is None else np.array(run.claims, dtype=object)[rows],
    )


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
    estimated, times = Rotation.from_quat(run.quaternions[rows], scalar_first=True), run.times[rows]
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
