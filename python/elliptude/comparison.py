"""Results against a reference attitude: whether it is in the sets, how far the centers are from it, how wide sets are.

A table of results may say in the column ``claim`` what a row's set rests on (``unconditional``, ``conditional`` or
``none``), and in ``chart`` whether P is the shape of ζ (``exponential``) or of γ = 2 tan(θ/2) n (``gibbs``) of the same
turn, with C = Ĉ exp(S(ζ)). Rows of a table without them claim nothing.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from elliptude import logs
from elliptude.configuration import Configuration
from elliptude.containment import least_forms
from elliptude.files import FileError, replacing
from elliptude.results import CLAIMS, FloatArray
from elliptude.tables import QUATERNION, column_names, read_columns

_ATTITUDE_SHAPE = ("P11", "P12", "P13", "P22", "P23", "P33")
_HALF_WIDTHS = ("half_width_rx", "half_width_ry", "half_width_rz")
_UPPER = np.triu_indices(3)
# s; stamps so near are the same.
_SAME_TIME = 1e-6


@dataclass(frozen=True, eq=False)
class Estimates:
    """Attitudes with their sets, NaN where there is none."""

    times: FloatArray
    """s, strictly increasing, shape (N,)."""
    quaternions: FloatArray
    """(qw, qx, qy, qz) of the attitude from body to reference axes, shape (N, 4)."""
    shapes: FloatArray
    """P of the attitude error, rad², shape (N, 3, 3)."""
    half_widths: FloatArray
    """Along body axes, rad, shape (N, 3)."""
    claims: NDArray[np.object_] | None
    """One of `CLAIMS`, or "", for each row; None where the table does not say."""
    is_gibbs: bool
    """Whether P is of γ."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Attitudes to compare with."""

    times: FloatArray
    """s, strictly increasing, shape (M,)."""
    attitudes: Rotation
    """From body to reference axes, M of them."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """The rows that have an attitude and a reference, n of them."""

    rows: int
    """Of the table."""
    times: FloatArray
    """s, shape (n,)."""
    estimated: Rotation
    """n centers."""
    true: Rotation
    """n references."""
    angles: FloatArray
    """Between them, rad, shape (n,)."""
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
        """Rows that claim to hold without a condition, and do not."""
        return 0 if self.claims is None else int((~self.inside & (self.claims == "unconditional")).sum())

    def to_dict(self) -> dict[str, Any]:
        """Figures in degrees: of all rows compared, and by claim where the table has it."""
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


def read_estimates(path: str | os.PathLike[str]) -> Estimates:
    """Read a table of results, or the one in a folder that `elliptude estimate` wrote.

    Raises
    ------
    FileError
        If it is no such table; with the place of the fault.
    """
    table = Path(path)
    if table.is_dir():
        found = [table / name for name in ("results.csv", "results.parquet") if (table / name).is_file()]
        if len(found) != 1:
            raise FileError(f"{path}: {'two tables' if found else 'no table'} of results in this folder: name the file")
        table = found[0]
    names = column_names(table, "results")
    texts = [name for name in ("claim", "chart") if name in names]
    columns = read_columns(table, optional=[QUATERNION, _ATTITUDE_SHAPE, _HALF_WIDTHS], texts=texts)
    for name, allowed in (("claim", (*CLAIMS, "")), ("chart", ("exponential", "gibbs", ""))):
        if name in columns and (strange := set(columns[name].tolist()) - {*allowed, None}):
            raise FileError(f"{table}: column {name!r}: {min(strange)!r} is none of {', '.join(filter(None, allowed))}")
    charts = set(columns["chart"].tolist()) - {"", None} if "chart" in columns else set()
    if len(charts) > 1:
        raise FileError(f"{table}: column 'chart': a table has one chart")
    shapes = np.empty((len(columns["time_s"]), 3, 3))
    shapes[:, *_UPPER] = _stack(columns, _ATTITUDE_SHAPE)
    shapes[:, *_UPPER[::-1]] = shapes[:, *_UPPER]
    return Estimates(
        times=columns["time_s"],
        quaternions=_stack(columns, QUATERNION),
        shapes=shapes,
        half_widths=_stack(columns, _HALF_WIDTHS),
        claims=np.asarray(columns["claim"], dtype=object) if "claim" in columns else None,
        is_gibbs=charts == {"gibbs"},
    )


def read_reference(path: str | os.PathLike[str], configuration: Configuration | None = None) -> Reference:
    """Read attitudes to compare with.

    Parameters
    ----------
    path : path-like
        Without a configuration a table with the columns ``time_s`` and ``qw,qx,qy,qz`` (docs/tables.md); with one a log
        in any format, whose truth the configuration names.
    configuration : Configuration, optional

    Returns
    -------
    Reference

    Raises
    ------
    FileError
        If it has no such attitudes.
    """
    if configuration is None:
        columns = read_columns(path, optional=[QUATERNION])
        times, quaternions, order, turns = columns["time_s"], _stack(columns, QUATERNION), "wxyz", "body_to_reference"
    else:
        truth = configuration.truth
        if truth is None:
            raise FileError(f"{path}: the configuration names no truth to compare with")
        (samples,) = logs.read_samples(path, configuration, ["true attitude"])
        times, quaternions, order, turns = samples.times, samples.values, truth.order, truth.turns
    lengths = np.linalg.norm(quaternions, axis=1)
    wrong = np.isfinite(lengths) & (np.abs(lengths - 1.0) > 0.01)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise FileError(f"{path}: the quaternion at {times[k]:.6f} s is {lengths[k]:.4g} long, not 1 within 0.01")
    known = np.isfinite(lengths)
    if not known.any():
        raise FileError(f"{path}: no attitude to compare with")
    rotations = Rotation.from_quat(quaternions[known], scalar_first=order == "wxyz")
    return Reference(times[known], rotations if turns == "body_to_reference" else rotations.inv())


def compare(
    estimates: Estimates, reference: Reference, *, largest_gap: float = 0.0, reference_error: float = 0.0
) -> Comparison:
    """Compare each row with the reference of its time.

    Parameters
    ----------
    estimates : Estimates
    reference : Reference
    largest_gap : float
        Where the reference has no sample at a row's time it is interpolated between two that are no further apart, s.
    reference_error : float
        Angle by which the reference may itself be off, rad: a row counts as inside if any attitude so near is.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If no row has a reference.
    """
    rows = np.flatnonzero(np.isfinite(estimates.quaternions[:, 0]) & np.isfinite(estimates.shapes[:, 0, 0]))
    rows, true = attitudes_at(reference, estimates.times, rows, largest_gap)
    if not len(rows):
        raise ValueError("no row with a set has a reference of its time")
    estimated = Rotation.from_quat(estimates.quaternions[rows], scalar_first=True)
    errors = estimated.inv() * true
    shapes = estimates.shapes[rows]
    matrices = estimated.as_matrix()
    along_reference = np.sqrt(np.einsum("nij,njk,nik->ni", matrices, shapes, matrices))
    if estimates.is_gibbs:
        quaternions = errors.as_quat(canonical=True)
        with np.errstate(divide="ignore"):
            offsets = 2.0 * quaternions[:, :3] / quaternions[:, 3:]
        along_reference = 2.0 * np.arctan(0.5 * along_reference)
    else:
        offsets = errors.as_rotvec()
    return Comparison(
        rows=len(estimates.times),
        times=estimates.times[rows],
        estimated=estimated,
        true=true,
        angles=np.asarray(errors.magnitude()),
        inside=is_near(offsets, shapes, reference_error),
        half_widths_body=estimates.half_widths[rows],
        half_widths_reference=along_reference,
        claims=None if estimates.claims is None else estimates.claims[rows],
    )


def attitudes_at(
    reference: Reference, times: FloatArray, rows: NDArray[np.intp], largest_gap: float
) -> tuple[NDArray[np.intp], Rotation]:
    """The reference at some rows.

    Parameters
    ----------
    reference : Reference
    times : (N,) array
        s.
    rows : array of int
        Of the times.
    largest_gap : float
        Between two samples of the reference no further apart it is interpolated, s.

    Returns
    -------
    rows : array of int
        Those that have a reference.
    attitudes : scipy.spatial.transform.Rotation
        One for each.
    """
    known = reference.times
    if len(known) == 1:
        rows = rows[np.abs(times[rows] - known[0]) <= _SAME_TIME]
        return rows, reference.attitudes[np.zeros(len(rows), dtype=np.intp)]
    after = np.clip(np.searchsorted(known, times[rows]), 1, len(known) - 1)
    before = after - 1
    nearest = np.where(times[rows] - known[before] <= known[after] - times[rows], before, after)
    is_same = np.abs(known[nearest] - times[rows]) <= _SAME_TIME
    is_between = (times[rows] >= known[before]) & (times[rows] <= known[after])
    is_between &= known[after] - known[before] <= largest_gap
    at = np.where(is_same, known[nearest], times[rows])[is_same | is_between]
    rows = rows[is_same | is_between]
    return rows, Slerp(known, reference.attitudes)(at) if len(rows) else Rotation.identity(0)


def is_near(points: FloatArray, shapes: FloatArray, distance: float) -> NDArray[np.bool_]:
    """Whether points are in ellipsoids {x : xᵀ P⁻¹ x ≤ 1}, or no further from them than a distance.

    An attitude error of angle θ has coordinates ζ and γ whose distances are at least those of attitudes, so nothing
    further than ``distance`` counts as near.

    Parameters
    ----------
    points : (n, 3) array
    shapes : (n, 3, 3) array
    distance : float

    Returns
    -------
    (n,) array of bool
        False where the point is no number.
    """
    usable = np.flatnonzero(np.isfinite(points).all(axis=1) & (np.linalg.eigvalsh(shapes)[:, 0] > 0.0))
    x, shapes = points[usable], shapes[usable]
    inside = (x * np.linalg.solve(shapes, x[..., None])[..., 0]).sum(axis=1) <= 1.0
    if distance > 0.0:
        inside[~inside] = least_forms(x[~inside], shapes[~inside], distance) <= 1.0
    near = np.zeros(len(points), dtype=np.bool_)
    near[usable] = inside
    return near


def _stack(columns: dict[str, NDArray[np.float64]], names: tuple[str, ...]) -> FloatArray:
    return np.column_stack([columns[name] for name in names])
