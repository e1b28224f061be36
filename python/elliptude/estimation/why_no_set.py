"""Explains why the guaranteed mode claims nothing at any row: which statements leave too little."""

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.turns import lengths_of
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.results import CLAIMS

# rad; a turn that may be off by this much over a step says nothing about the attitude after it.
_ANY_TURN = 0.5 * np.pi


def why_no_set(run: GuaranteedRun, configuration: Configuration) -> list[str]:
    """Hints for a reader whose result has no set.

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration

    Returns
    -------
    list of str
        Empty where any row has a claim.
    """
    if (run.sets.claims != CLAIMS.index("none")).any():
        return []
    rows, log = run.rows, run.log
    hints: list[str] = []
    says = rows.angles < np.pi
    for i, name in enumerate(rows.names):
        if says[:, i].any():
            continue
        if not np.isfinite(rows.directions[:, i, 0]).any():
            hints.append(_not_measured(name, run, configuration))
        elif np.isfinite(rows.angles[:, i]).any():
            hints.append(f"the bounds of {name!r} allow any direction, at every row")
        else:
            hints.append(f"{name!r} contradicts its own bounds, and is left out at every row")
    if len(rows.names) < 2 or not (says.sum(axis=1) >= 2).any():
        hints.append("an attitude needs two directions at the same time, and no row has two that say something")
    if _nothing_bounds_the_rate(run, configuration):
        hints.append(
            "the set holds the attitude and the angular velocity, and nothing bounds the angular velocity before the "
            "first set: measure it ([rate]), or state the largest (flow.largest_rate_deg_per_s) or a set to start from "
            "([start])"
        )
    if isinstance(configuration.flow, GyroFlow) and rows.gyro is not None and log.rates is not None:
        speeds = np.linalg.norm(log.rates - rows.bias, axis=1)
        error = float(np.median(rows.gyro.rate_error(speeds, log.times - log.times[0])))
        step = float(np.median(np.diff(log.times))) if len(log.times) > 1 else 0.0
        if error * step >= _ANY_TURN:
            hints.append(
                f"the gyro may be off by {np.rad2deg(error):.3g} deg/s, so that over one step of {step:.3g} s it says "
                "nothing of the turn"
            )
    if run.gaps and rows.gyro is not None:
        turn = float(np.median([gap.turn for gap in run.gaps]))
        hints.append(
            f"the gyro has {len(run.gaps)} gaps, intervals longer than {rows.gyro.longest_interval:.4g} s, in each of "
            f"which it may have turned {np.rad2deg(turn):.3g} deg otherwise than it shows: if the bound of its noise "
            "covers longer ones, state that (longest_interval_s)"
        )
    if hints:
        return hints
    kept = says & ~run.sets.dropped[:, : len(rows.names)]
    if (kept.sum(axis=1) >= 2).any():
        return [_too_wide_together(run, kept)]
    return [
        "in each row with two directions they contradict one another or the prediction, and of those that were left no "
        "row has two (dropped.csv): a reference, the axes of a sensor or a bound is wrong"
    ]


def _too_wide_together(run: GuaranteedRun, kept: NDArray[np.bool_]) -> str:
    """How wide the two directions are that most rows have: together they leave attitudes half a turn apart.

    `kept`, shape (N, m), is which of them say something and were not left out.
    """
    rows = run.rows
    together = np.triu(kept.T.astype(np.int64) @ kept.astype(np.int64), 1)
    i, j = (int(one) for one in np.unravel_index(int(np.argmax(together)), together.shape))
    both = kept[:, i] & kept[:, j]
    one, other = rows.directions[both, i], rows.directions[both, j]
    cosines = np.einsum("ni,ni->n", one, other) / (lengths_of(one) * lengths_of(other))
    widths = [float(np.rad2deg(np.median(rows.angles[both, k]))) for k in (i, j)]
    between = float(np.rad2deg(np.median(np.arccos(np.clip(cosines, -1.0, 1.0)))))
    return (
        f"{rows.names[i]!r} is known within {widths[0]:.3g} deg and {rows.names[j]!r} within {widths[1]:.3g} deg, "
        f"{between:.3g} deg from one another (medians): no row's directions leave a set that is less than half a turn "
        "wide"
    )


def _not_measured(name: str, run: GuaranteedRun, configuration: Configuration) -> str:
    """Why a direction counts at no row: it is not in the log, or the gaps of the gyro leave no window to average it."""
    names = [sensor.name for sensor in configuration.directions]
    is_there = name in names and bool(np.isfinite(run.log.directions[:, names.index(name), 0]).any())
    if not is_there or run.rows.gyro is None or not run.gaps:
        return f"{name!r} is measured at no row"
    return (
        f"{name!r} counts as a mean over a window, and none fits between {len(run.gaps)} gaps of the gyro, intervals "
        f"longer than {run.rows.gyro.longest_interval:.4g} s: if the bound of its noise covers longer ones, state that "
        "(longest_interval_s)"
    )


def _nothing_bounds_the_rate(run: GuaranteedRun, configuration: Configuration) -> bool:
    """Whether a rigid body's angular velocity is neither measured at any row, nor bounded by a statement."""
    if isinstance(configuration.flow, GyroFlow) or run.start is not None or run.given.vector_bound is not None:
        return False
    measured = run.given.measured.get("angular_velocity")
    return measured is None or not np.isfinite(measured).all(axis=-1).any()
