"""The directions that a log measured, at the rows of its results: each in a circle about its reference.

If a direction b in body axes is off by at most an angle, the true attitude C points it along C b, within that angle of
its reference e: in a circle on the sphere of reference directions. The estimate points it along Ĉ b.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation import gaps
from elliptude.estimation.direction_rows import direction_rows
from elliptude.io.files import FileError
from elliptude.io.spool import NamedFile
from elliptude.logs.log import read_log
from elliptude.report.axes.body_axes import perpendicular
from elliptude.report.run import Run
from elliptude.typing import FloatArray

POINTS = 49
"""Points of a circle; the last one is the first."""

# A direction is shown for so many of its sensor's usual intervals: then the next one is overdue.
_OVERDUE = 1.5


@dataclass(frozen=True, eq=False)
class MeasuredDirections:
    """The directions of m sensors at N rows of a run, with their bounds."""

    names: tuple[str, ...]
    directions: FloatArray
    """Unit vectors in body axes, NaN where nothing was measured, shape (N, m, 3)."""
    references: FloatArray
    """Unit vectors in reference axes, shape (N, m, 3)."""
    angles: FloatArray
    """How far each direction may be off, rad, shape (N, m); NaN: not measured, or against its own bound."""


def measured_directions(log: NamedFile, configuration: Configuration, run: Run) -> MeasuredDirections:
    """The directions that a run was estimated from.

    Parameters
    ----------
    log : NamedFile
        What `elliptude.io.spool.recording` returns.
    configuration : Configuration
        That of the run.
    run : Run

    Returns
    -------
    MeasuredDirections

    Raises
    ------
    FileError
        If the log cannot be read, a bound does not follow from it, or it has not all rows of the run.
    """
    read = read_log(log, configuration)
    try:
        if isinstance(configuration.flow, GyroFlow):
            read = gaps.without_rates_in_gaps(read, gaps.longest_interval(read, configuration))
        found = direction_rows(read, configuration)
    except ValueError as error:
        raise FileError(f"{log}: {error}") from error
    rows = np.searchsorted(read.times, run.times).clip(max=len(read.times) - 1)
    strange = (read.times[rows] != run.times) | (read.counts_from != run.origin)
    if strange.any():
        raise FileError(
            f"{log}: it has no row at {run.times[strange][0]:.6f} s, but the results do: they are not of this log and "
            "configuration"
        )
    references = found.references[rows]
    return MeasuredDirections(
        names=found.names,
        directions=found.directions[rows],
        references=references / np.linalg.norm(references, axis=-1, keepdims=True),
        angles=found.angles[rows],
    )


def latest_rows(times: FloatArray, measured: NDArray[np.bool_], rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The row of a sensor's latest direction at each of some rows; -1 before the first, and where the next is overdue.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    measured : (N,) array of bool
        Where the sensor measured.
    rows : (n,) array

    Returns
    -------
    (n,) array
    """
    there = np.flatnonzero(measured)
    if not len(there):
        return np.full(len(rows), -1)
    until = _OVERDUE * float(np.median(np.diff(times[there]))) if len(there) > 1 else 0.0
    latest = there[(np.searchsorted(there, rows, side="right") - 1).clip(min=0)]
    return np.where((latest <= rows) & (times[rows] - times[latest] <= until), latest, -1)


def circles(references: FloatArray, angles: FloatArray) -> FloatArray:
    """The directions at an angle (n,) from a unit vector (n, 3), once around, shape (n, POINTS, 3)."""
    first, second = perpendicular(references)
    around = np.linspace(0.0, 2.0 * np.pi, POINTS)
    across = first[:, None] * np.cos(around)[:, None] + second[:, None] * np.sin(around)[:, None]
    drawn = angles[:, None, None]
    return np.asarray(np.cos(drawn) * references[:, None] + np.sin(drawn) * across)


def moved_away(pointed: FloatArray, references: FloatArray, magnification: int) -> FloatArray:
    """Unit vectors (n, 3) so many times as far from their references (n, 3) as they are, half a turn at most."""
    along = (pointed * references).sum(axis=1, keepdims=True)
    across = pointed - along * references
    sine = np.linalg.norm(across, axis=1, keepdims=True)
    unit = np.divide(across, sine, out=np.zeros_like(across), where=sine > 0.0)
    angle = np.minimum(magnification * np.arctan2(sine, along), np.pi)
    return np.asarray(np.cos(angle) * references + np.sin(angle) * unit)
