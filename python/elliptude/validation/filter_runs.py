"""The filters over many trials at once: from what was measured to their sets, and to where in these the truth is."""

from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude import _core
from elliptude.typing import FloatArray
from elliptude.validation.adversary import Measured, Motion, Plant, Starts
from elliptude.validation.judge import Mode, forms_of
from elliptude.validation.plants import GyroPlant, guaranteed
from elliptude.validation.questions import ANSWERS, answers_of_log, direction_shares, shares_of

HOLDS, REFUSED, WITHOUT_SET, FAILED = range(4)
"""Outcomes of an update: there is a set; measurements contradict each other or the prediction; the attitude is not
known; the filter gave up."""


@dataclass(frozen=True, eq=False)
class Runs:
    """The sets of a filter in T trials, at the U updates; NaN where it gave up."""

    attitudes: FloatArray
    """Shape (T, U, 3, 3)."""
    vectors: FloatArray
    """Shape (T, U, 3)."""
    shapes: FloatArray
    """P, shape (T, U, 6, 6)."""
    used: NDArray[np.bool_]
    """Whether the prediction went into the set, shape (T, U)."""
    claims: NDArray[np.uint8]
    """`HOLDS`, `REFUSED`, `WITHOUT_SET` or `FAILED`, shape (T, U)."""
    answers: FloatArray
    """See `elliptude.validation.questions`, shape (T, U, 14); (T, U, 0) if nothing was asked."""

    def of(self, rows: NDArray[np.intp]) -> "Runs":
        """The rows of some trials."""
        return Runs(*(getattr(self, field.name)[rows] for field in fields(self)))


def run(
    of: Plant,
    mode: Mode,
    starts: Starts,
    measured: Measured,
    *,
    vertical: FloatArray | None = None,
    **options: Any,
) -> Runs:
    """Run the filter of a mode over each trial.

    Parameters
    ----------
    of : Plant
    mode : Mode
    starts : Starts
    measured : Measured
    vertical : (3,) array, optional
        In reference axes. With it the guaranteed filter is asked all questions after each update.
    **options
        What else the filter is made with, such as ``criterion``.

    Returns
    -------
    Runs
    """
    count, rows = measured.rates.shape[:2]
    asks = mode == "guaranteed" and vertical is not None
    runs = Runs(
        attitudes=np.full((count, rows - 1, 3, 3), np.nan),
        vectors=np.full((count, rows - 1, 3), np.nan),
        shapes=np.full((count, rows - 1, 6, 6), np.nan),
        used=np.zeros((count, rows - 1), bool),
        claims=np.full((count, rows - 1), FAILED, np.uint8),
        answers=np.full((count, rows - 1, ANSWERS if asks else 0), np.nan),
    )
    times: FloatArray = of.interval * np.arange(rows, dtype=np.float64)
    shapes = starts.shapes
    flow = of.guaranteed_flow() if mode == "guaranteed" else of.flow()
    for trial in range(count):
        told = None
        if not starts.from_measurement[trial]:
            told = _core.StateEllipsoid(starts.attitudes[trial], starts.vectors[trial], shapes[trial])
        try:
            arguments = (told, times, measured.directions[trial], measured.rates[trial])
            sets = (
                _guaranteed(of, flow, *arguments, vertical=vertical, **options)
                if mode == "guaranteed"
                else _first_order(of, flow, mode, *arguments, **options)
            )
        except ValueError:  # given up: a step that is too long, a set that overflows
            continue
        for field, values in zip(fields(runs), sets, strict=True):
            getattr(runs, field.name)[trial] = values
    return runs


_Sets: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_], NDArray[np.uint8], FloatArray]


def _first_order(
    of: Plant,
    flow: Any,
    mode: Mode,
    told: _core.StateEllipsoid | None,
    times: FloatArray,
    directions: FloatArray,
    rates: FloatArray,
    **options: Any,
) -> _Sets:
    """A trial in one of the modes of first order, as the fields of `Runs`."""
    arguments: dict[str, Any] = {"reference": of.reference, "bounds": of.bound, "on_inconsistent": "skip"}
    if told is None:
        start = _core.measured_state(directions[1], of.reference, of.bound, rates[1], of.bound)
        directions, rates = directions.copy(), rates.copy()
        directions[1] = rates[1] = np.nan  # it must not count twice
        attitude_filter = elliptude.AttitudeFilter(flow, start, time=times[1], mode=mode, **options)
        begin = 1
    else:
        attitude_filter = elliptude.AttitudeFilter(flow, told, time=times[0], mode=mode, **options)
        begin = 0
    if of.has_gyro:
        arguments["gyro"] = rates[begin:]
    else:
        arguments |= {"angular_velocity": rates[begin:], "rate_bound": of.bound}
    log = attitude_filter.run(times[begin:], directions=directions[begin:], **arguments)
    updates = slice(1 - begin, None)
    refused = log.outcomes[updates] == 2
    used = (log.shares[updates] > 0.0) & (log.outcomes[updates] == 0)
    claims = np.where(refused, REFUSED, HOLDS).astype(np.uint8)
    nothing = np.empty((len(claims), 0))
    return log.attitudes[updates], log.vectors[updates], log.shapes[updates], used, claims, nothing


def _guaranteed(
    of: Plant,
    flow: Any,
    told: _core.StateEllipsoid | None,
    times: FloatArray,
    directions: FloatArray,
    rates: FloatArray,
    *,
    vertical: FloatArray | None = None,
    **options: Any,
) -> _Sets:
    """A trial in the guaranteed mode, as the fields of `Runs`: the one place that knows its filter."""
    begin = 1 if told is None else 0
    arguments = {"gyro": rates[begin:]} if of.has_gyro else {"angular_velocity": rates[begin:], "rate_bound": of.bound}
    made = {"policy": "drop_measurement"} | options
    log = guaranteed("GuaranteedFilter")(flow, told, time=times[begin], **made).run(
        times[begin:],
        directions=directions[begin:],
        reference=of.reference,
        bounds=of.bound,
        vertical=vertical,
        **arguments,
    )
    updates = slice(1 - begin, None)
    names = [str(claim) for claim in log.claims[updates]]
    claims = np.array([_CLAIMS[name.rsplit(".", maxsplit=1)[-1]] for name in names], np.uint8)
    shapes = np.where((claims == WITHOUT_SET)[:, None, None], np.nan, log.shapes[updates])
    answers = np.empty((len(claims), 0)) if vertical is None else answers_of_log(log)[updates]
    return log.attitudes[updates], log.vectors[updates], shapes, log.prediction_used[updates], claims, answers


# A claim by name, member of an enumeration or number. A conditional one means that true measurements were dropped.
_CLAIMS = {
    **{"unconditional": HOLDS, "conditional": REFUSED, "none": WITHOUT_SET},
    **{"0": HOLDS, "1": REFUSED, "2": WITHOUT_SET},
}


def measured_alone(of: Plant, mode: Mode, measured: Measured) -> FloatArray | None:
    """The shapes from the measurements of each update without any prediction, (T, U, 6, 6).

    None for a gyro, because directions say nothing about its bias.
    """
    if of.has_gyro:
        return None
    count, rows = measured.rates.shape[:2]
    shapes = np.full((count, rows - 1, 6, 6), np.nan)
    flow = of.guaranteed_flow() if mode == "guaranteed" else None
    times, nothing = np.array([0.0, 1.0]), np.full(of.reference.shape, np.nan)
    for trial in range(count):
        for row in range(1, rows):
            directions, rate = measured.directions[trial, row], measured.rates[trial, row]
            try:
                if mode == "guaranteed":
                    # The first row of a log without a set to start from.
                    sets = _guaranteed(of, flow, None, times, np.array([nothing, directions]), np.array([rate, rate]))
                    shapes[trial, row - 1] = sets[2][0]
                else:
                    start = _core.measured_state(directions, of.reference, of.bound, rate, of.bound)
                    shapes[trial, row - 1] = start.shape
            except ValueError:  # no bounded set
                continue
    return shapes


def question_shares(
    of: Plant, runs: Runs, motion: Motion, measured: Measured, vertical: FloatArray
) -> dict[str, FloatArray]:
    """How far the truth goes towards the end of each answer of a filter that was asked, shape (T, U) by question."""
    truth = motion.attitudes[:, 1:], motion.vectors[:, 1:]
    shares = shares_of(of, (runs.attitudes, runs.vectors), runs.shapes, runs.answers, truth, vertical)
    if isinstance(of, GyroPlant):
        shares["direction"] = direction_shares(of, motion, measured)
    return shares


def forms(mode: Mode, runs: Runs, motion: Motion) -> FloatArray:
    """xᵀP⁻¹x of the truth at the updates, see `elliptude.validation.judge.forms_of`.

    Parameters
    ----------
    mode : Mode
    runs : Runs
    motion : Motion

    Returns
    -------
    (T, U) array
    """
    return forms_of(mode, runs.attitudes, runs.vectors, runs.shapes, motion.attitudes[:, 1:], motion.vectors[:, 1:])
