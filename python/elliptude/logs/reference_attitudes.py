"""Reference attitudes to compare results with, from a table or a log, at the times of the compared rows."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.io.column_files import column_names, counts_from, read_columns, stacked, time_origin
from elliptude.io.files import FileError
from elliptude.io.tables import QUATERNION
from elliptude.logs import log
from elliptude.typing import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

# s; stamps this near are the same, as files with microseconds have them.
_SAME_TIME = 1e-6
# Where something is proved they must be the same but for what is lost of nanoseconds in a table.
_EQUAL_TIME = 2e-9


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference attitudes and their times."""

    times: FloatArray
    """s, strictly increasing, shape (M,)."""
    attitudes: Rotation
    """From body to reference axes, M of them."""


def read_reference(
    path: str | os.PathLike[str], configuration: Configuration | None = None, *, origin: int
) -> Reference:
    """Read reference attitudes, with times as those that they are compared with.

    Parameters
    ----------
    path : path-like
        Without a configuration a table with the columns ``time_s`` and ``qw,qx,qy,qz`` (docs/tables.md); with one a log
        in any format, whose truth the configuration names.
        A table's times are those of the recording's clock, unless it says which second they count from.
    configuration : Configuration, optional
    origin : int
        The second of the recording's clock that times count from where the attitudes are used, whatever second they
        count from in the file: files of one recording may begin in different ones.

    Returns
    -------
    Reference

    Raises
    ------
    FileError
        If it has no such attitudes.
    """
    if configuration is None:
        if "time_s" not in (names := column_names(path)):
            there_are = ", ".join(names[:12]) + (f" and {len(names) - 12} others" if len(names) > 12 else "")
            raise FileError(
                f"{path}: no column 'time_s', so no table with time_s,qw,qx,qy,qz; the columns are {there_are}. A "
                "configuration whose [truth] names the columns says how another file is read: --config of compare, "
                "--estimate-config of monitor"
            )
        columns = read_columns(path, optional=[QUATERNION])
        times, quaternions, order, turns = columns["time_s"], stacked(columns, QUATERNION), "wxyz", "body_to_reference"
        since = time_origin(path)
    else:
        truth = configuration.truth
        if truth is None:
            raise FileError(f"{path}: the configuration names no truth to compare with")
        (samples,) = log.read_samples(path, configuration, ["true attitude"])
        times, quaternions, order, turns = samples.times, samples.values, truth.order, truth.turns
        since = samples.counts_from
    lengths = np.linalg.norm(quaternions, axis=1)
    wrong = np.isfinite(lengths) & (np.abs(lengths - 1.0) > 0.01)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise FileError(f"{path}: the quaternion at {times[k]:.6f} s is {lengths[k]:.4g} long, not 1 within 0.01")
    known = np.isfinite(lengths)
    if not known.any():
        raise FileError(f"{path}: no attitude to compare with")
    times = times[known] + float(since - origin)
    # So far from the origin two stamps may be one number.
    apart = np.diff(times, prepend=-np.inf) > 0.0
    rotations = scipy.spatial.transform.Rotation.from_quat(quaternions[known][apart], scalar_first=order == "wxyz")
    return Reference(times[apart], rotations if turns == "body_to_reference" else rotations.inv())


def in_words_of_origin(origin: int) -> str:
    """What to say of times where none is at another's, so that it goes on a sentence; empty if they count from 0."""
    if origin == 0:
        return ""
    return (
        f"; these count from {origin} s of the recording's clock, and a table whose time_s does must say so in its "
        f"first line: '# {counts_from(origin)}'"
    )


def has_sample_at(reference: Reference, times: FloatArray) -> NDArray[np.bool_]:
    """Whether the reference has a sample at each time, neither interpolated nor near to it alone, shape (N,)."""
    return np.asarray(to_nearest_sample(reference, times) <= _EQUAL_TIME)


def to_nearest_sample(reference: Reference, times: FloatArray) -> FloatArray:
    """How far the nearest sample of the reference is from each time, s, shape (N,)."""
    known = reference.times
    after = np.clip(np.searchsorted(known, times), 0, len(known) - 1)
    before = np.maximum(after - 1, 0)
    return np.asarray(np.minimum(np.abs(known[after] - times), np.abs(known[before] - times)))


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
        Rows of the times.
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
    return rows, scipy.spatial.transform.Slerp(known, reference.attitudes)(at) if len(
        rows
    ) else scipy.spatial.transform.Rotation.identity(0)
