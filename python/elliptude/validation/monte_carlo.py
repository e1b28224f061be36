"""Adversarial Monte Carlo: whether the truth stays in the set, whatever the errors within their bounds.

Every trial is a motion, a first set with the truth in it or on its boundary, and measurements with errors within the
bounds, drawn at random or by a search that pushes the truth out of the set. The truth solves the continuous
equations, by an integrator of its own; NumPy judges containment, in the chart of the set.
All draws and results are functions of the arguments alone.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude import _core
from elliptude.typing import FloatArray
from elliptude.validation import trials
from elliptude.validation.adversary import (
    Case,
    Errors,
    Measured,
    Motion,
    Plant,
    Starts,
    draw_errors,
    draw_starts,
    measure,
    propose,
)
from elliptude.validation.judge import FORM_EDGES, Mode, forms_of, sizes
from elliptude.validation.plants import guaranteed, plant

MODES: tuple[Mode, ...] = get_args(Mode)
CHUNK_TRIALS = 480
"""Trials that are drawn at once; an interrupted run keeps whole chunks of them."""
SEARCH_RUNS = 240
"""The number of runs in a search; each is a trial."""
SEARCH_DRAWN = 0.3
"""The share of them that is drawn at random; the search climbs from the worst of these."""
SETTLED_UPDATE = 6
"""Sizes are means from this update on."""

_COUNTS = ("updates", "escapes", "refused", "without_set", "failed", "predictions", "used")
# With the counts of the other kinds of trials.
_ALL_COUNTS = tuple(dict.fromkeys((*_COUNTS, *trials.COUNTS)))
_SIZES = ("trace", "volume_radius", "largest_angle_rad")


@dataclass(frozen=True)
class Arguments:
    """Everything that a validation depends on."""

    mode: Mode
    trials: int
    """Trials of each case."""
    updates: int
    """Updates in each trial."""
    seed: int
    cases: tuple[Case, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON, with the version of the package."""
        cases = [asdict(case) for case in self.cases]
        return {"elliptude": elliptude.__version__, **asdict(self), "cases": cases}


HOLDS, REFUSED, WITHOUT_SET, FAILED = range(4)
"""Outcomes of an update: there is a set; measurements contradict each other or the prediction; the attitude is not
known; the filter gave up."""


# --- the filters ------------------------------------------------------------------------------------------------------


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


def run(of: Plant, mode: Mode, starts: Starts, measured: Measured) -> Runs:
    """Run the filter of a mode over each trial.

    Parameters
    ----------
    of : Plant
    mode : Mode
    starts : Starts
    measured : Measured

    Returns
    -------
    Runs
    """
    count, rows = measured.rates.shape[:2]
    runs = Runs(
        attitudes=np.full((count, rows - 1, 3, 3), np.nan),
        vectors=np.full((count, rows - 1, 3), np.nan),
        shapes=np.full((count, rows - 1, 6, 6), np.nan),
        used=np.zeros((count, rows - 1), bool),
        claims=np.full((count, rows - 1), FAILED, np.uint8),
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
                _guaranteed(of, flow, *arguments) if mode == "guaranteed" else _first_order(of, flow, mode, *arguments)
            )
        except ValueError:  # given up: a step that is too long, a set that overflows
            continue
        for field, values in zip(fields(runs), sets, strict=True):
            getattr(runs, field.name)[trial] = values
    return runs


_Sets: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_], NDArray[np.uint8]]


def _first_order(
    of: Plant,
    flow: Any,
    mode: Mode,
    told: _core.StateEllipsoid | None,
    times: FloatArray,
    directions: FloatArray,
    rates: FloatArray,
) -> _Sets:
    """A trial in one of the modes of first order, as the fields of `Runs`."""
    arguments: dict[str, Any] = {"reference": of.reference, "bounds": of.bound, "on_inconsistent": "skip"}
    if told is None:
        start = _core.measured_state(directions[1], of.reference, of.bound, rates[1], of.bound)
        directions, rates = directions.copy(), rates.copy()
        directions[1] = rates[1] = np.nan  # it must not count twice
        attitude_filter = elliptude.AttitudeFilter(flow, start, time=times[1], mode=mode)
        begin = 1
    else:
        attitude_filter = elliptude.AttitudeFilter(flow, told, time=times[0], mode=mode)
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
    return log.attitudes[updates], log.vectors[updates], log.shapes[updates], used, claims


def _guaranteed(
    of: Plant,
    flow: Any,
    told: _core.StateEllipsoid | None,
    times: FloatArray,
    directions: FloatArray,
    rates: FloatArray,
) -> _Sets:
    """A trial in the guaranteed mode, as the fields of `Runs`: the one place that knows its filter."""
    begin = 1 if told is None else 0
    arguments = {"gyro": rates[begin:]} if of.has_gyro else {"angular_velocity": rates[begin:], "rate_bound": of.bound}
    log = guaranteed("GuaranteedFilter")(flow, told, time=times[begin], policy="drop_measurement").run(
        times[begin:], directions=directions[begin:], reference=of.reference, bounds=of.bound, **arguments
    )
    updates = slice(1 - begin, None)
    names = [str(claim) for claim in log.claims[updates]]
    claims = np.array([_CLAIMS[name.rsplit(".", maxsplit=1)[-1]] for name in names], np.uint8)
    shapes = np.where((claims == WITHOUT_SET)[:, None, None], np.nan, log.shapes[updates])
    return log.attitudes[updates], log.vectors[updates], shapes, log.prediction_used[updates], claims


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


# --- the judge --------------------------------------------------------------------------------------------------------


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


# --- a chunk of a case ------------------------------------------------------------------------------------------------


def chunks(arguments: Arguments) -> Iterator[tuple[str, Case, int]]:
    """Name, case and number of each chunk that a validation is made of."""
    for case in arguments.cases:
        for number in range(-(-arguments.trials // CHUNK_TRIALS)):
            yield f"{case.name} {number}", case, number


def validate_chunk(arguments: Arguments, case: Case, number: int) -> dict[str, Any]:
    """The trials of a chunk, as counts, sums and the worst of them: plain numbers that `summarize` puts together.

    Parameters
    ----------
    arguments : Arguments
    case : Case
    number : int
        Number of the chunk in its case.

    Returns
    -------
    dict
    """
    count = min(CHUNK_TRIALS, arguments.trials - number * CHUNK_TRIALS)
    key = (*case.name.encode(), number)
    draws = np.random.default_rng(np.random.SeedSequence(arguments.seed, spawn_key=key))
    if case.kind != "honest":
        return trials.try_kind(case, count, arguments.updates, draws)
    of = plant(case)
    tally = _Tally()
    if case.noise == "search":
        starts, errors = _search(of, arguments, count, draws, tally)
    else:
        starts = draw_starts(of, count, draws)
        errors = draw_errors(of, case.noise, starts, arguments.updates, draws)
    motion = of.motion(starts, errors)
    measured = measure(of, motion, errors)
    runs = run(of, arguments.mode, starts, measured)
    if case.noise != "search":
        tally.add(starts, runs, forms(arguments.mode, runs, motion))
    compared = {
        "own": sizes(arguments.mode, runs.shapes),
        "paper": sizes("paper", run(of, "paper", starts, measured).shapes),
    }
    alone = measured_alone(of, arguments.mode, measured)
    if alone is not None:
        compared["measured"] = sizes(arguments.mode, alone)
    return tally.to_dict() | {"sizes": _mean_sizes(compared)}


def _search(
    of: Plant, arguments: Arguments, count: int, draws: np.random.Generator, tally: "_Tally"
) -> tuple[Starts, Errors]:
    """Searches with `count` runs in total, side by side; returns where each of them ended."""
    searches = -(-count // SEARCH_RUNS)
    drawn = max(searches, round(SEARCH_DRAWN * count))
    starts = draw_starts(of, drawn, draws)
    errors = draw_errors(of, "search", starts, arguments.updates, draws)
    heights = _highest_forms(of, arguments.mode, starts, errors, tally)
    chosen = np.argsort(-heights, kind="stable")[:searches]
    starts, best, highest = starts.of(chosen), errors.of(chosen), heights[chosen]
    for done in range(drawn, count, searches):
        some = np.arange(min(searches, count - done))
        tried = propose(best, draws).of(some)
        heights = _highest_forms(of, arguments.mode, starts.of(some), tried, tally)
        better = heights > highest[some]
        highest[some[better]] = heights[better]
        for field in fields(best):
            getattr(best, field.name)[some[better]] = getattr(tried, field.name)[better]
    return starts, best


def _highest_forms(of: Plant, mode: Mode, starts: Starts, errors: Errors, tally: "_Tally") -> FloatArray:
    """The largest form of each run, which is counted; shape (T,)."""
    motion = of.motion(starts, errors)
    runs = run(of, mode, starts, measure(of, motion, errors))
    values = forms(mode, runs, motion)
    tally.add(starts, runs, values)
    highest: FloatArray = np.where(np.isnan(values), -np.inf, values).max(axis=1)
    return highest


class _Tally:
    """Counts over the runs of a chunk."""

    def __init__(self) -> None:
        self.runs = 0
        self.counts = dict.fromkeys(_COUNTS, 0)
        self.worst: dict[str, Any] | None = None
        self.histogram = np.zeros(len(FORM_EDGES) - 1, np.int64)

    def add(self, starts: Starts, runs: Runs, values: FloatArray) -> None:
        judged = (runs.claims == HOLDS) | (runs.claims == REFUSED)
        values = np.where(judged & np.isnan(values), np.inf, values)
        # There is no prediction for a measurement that a filter starts from.
        predictions = values.size - int(np.sum(starts.from_measurement))
        counted = {
            "updates": values.size,
            "escapes": np.sum(judged & (values > 1.0)),
            "refused": np.sum(runs.claims == REFUSED),
            "without_set": np.sum(runs.claims == WITHOUT_SET),
            "failed": np.sum(runs.claims == FAILED),
            "predictions": predictions,
            "used": np.sum(runs.used),
        }
        for name, count in counted.items():
            self.counts[name] += int(count)
        self.histogram += np.histogram(values[judged], np.append(FORM_EDGES[:-1], np.finfo(float).max))[0]
        self.histogram[-1] += int(np.sum(np.isinf(values[judged])))
        if judged.any():
            trial, update = np.unravel_index(np.argmax(np.where(judged, values, -np.inf)), values.shape)
            form = float(values[trial, update])
            if self.worst is None or form > self.worst["form"]:
                self.worst = {"form": form, "trial": self.runs + int(trial), "update": int(update) + 1}
        self.runs += len(values)

    def to_dict(self) -> dict[str, Any]:
        worst = self.worst
        if worst is not None and math.isinf(worst["form"]):
            worst = worst | {"form": float(np.finfo(float).max)}  # JSON has no infinity
        return self.counts | {"worst": worst, "histogram": self.histogram.tolist()}


def _mean_sizes(compared: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Means of sizes (T, U, 3) over the settled updates at which all compared filters have a set."""
    settled = {name: of[:, SETTLED_UPDATE - 1 :].reshape(-1, 3) for name, of in compared.items()}
    known = np.logical_and.reduce([np.isfinite(of).all(axis=1) for of in settled.values()])
    if not known.any():
        return {"updates": 0}
    means = {name: dict(zip(_SIZES, of[known].mean(axis=0).tolist(), strict=True)) for name, of in settled.items()}
    return {"updates": int(known.sum())} | means


# --- what came of it --------------------------------------------------------------------------------------------------


def summarize(arguments: Arguments, done: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Figures of each case and of all, for JSON.

    Parameters
    ----------
    arguments : Arguments
    done : mapping
        Results of `validate_chunk` by the names of `chunks`.

    Returns
    -------
    dict
        ``cases``, each with its figures, ``total``, and the arguments.
    """
    by_case: dict[str, list[Mapping[str, Any]]] = {case.name: [] for case in arguments.cases}
    for name, case, number in chunks(arguments):
        worst = done[name]["worst"]
        placed = None if worst is None else {**worst, "chunk": number}
        by_case[case.name].append({**done[name], "worst": placed})
    cases = [asdict(case) | combine(by_case[case.name]) for case in arguments.cases]
    every = [chunk for case in arguments.cases for chunk in by_case[case.name]]
    settings = {key: value for key, value in arguments.to_dict().items() if key != "cases"}
    total = {name: sum(chunk.get(name, 0) for chunk in every) for name in _ALL_COUNTS}
    total["worst_form"] = max((case["worst"]["form"] for case in cases if case["worst"]), default=None)
    return settings | {"total": total, "cases": cases, "form_edges": FORM_EDGES[:-1].tolist()}


def combine(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Counts, worst form and mean sizes of chunks, or of cases that were combined before."""
    counts: dict[str, Any] = {name: sum(part[name] for part in parts) for name in _ALL_COUNTS if name in parts[0]}
    if "slowest" in parts[0]:
        counts["slowest"] = max(part["slowest"] for part in parts)
    worsts = [part["worst"] for part in parts if part["worst"] is not None]
    histogram = np.sum([part["histogram"] for part in parts], axis=0).tolist()
    return counts | {
        "worst": max(worsts, key=lambda worst: worst["form"], default=None),
        "histogram": histogram,
        "sizes": _combine_sizes([part["sizes"] for part in parts]),
    }


def _combine_sizes(parts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over all updates of several means."""
    counted = [part for part in parts if part["updates"]]
    updates = sum(part["updates"] for part in counted)
    result: dict[str, Any] = {"updates": updates}
    for name in counted[0] if counted else ():
        if name != "updates" and all(name in part for part in counted):
            result[name] = {
                size: sum(part["updates"] * part[name][size] for part in counted) / updates for size in _SIZES
            }
    return result
