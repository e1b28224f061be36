"""Adversarial Monte Carlo: whether the truth stays in the set, whatever the errors within their bounds.

Every trial is a motion, a first set with the truth in it or on its boundary, and measurements with errors within the
bounds, drawn at random or by a search that pushes the truth out of the set. The truth solves the continuous
equations, by an integrator of its own; NumPy judges containment, in the chart of the set.
All draws and results are functions of the arguments alone.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, get_args

import numpy as np

import elliptude
from elliptude.typing import FloatArray
from elliptude.validation import trials
from elliptude.validation.adversary import (
    Case,
    Errors,
    Plant,
    Starts,
    draw_errors,
    draw_starts,
    measure,
    propose,
)
from elliptude.validation.filter_runs import forms, measured_alone, run
from elliptude.validation.judge import FORM_EDGES, Mode, sizes
from elliptude.validation.plants import plant
from elliptude.validation.tally import ALL_COUNTS, Tally, combine, mean_sizes

MODES: tuple[Mode, ...] = get_args(Mode)
CHUNK_TRIALS = 480
"""Trials that are drawn at once; an interrupted run keeps whole chunks of them."""
SEARCH_RUNS = 240
"""The number of runs in a search; each is a trial."""
SEARCH_DRAWN = 0.3
"""The share of them that is drawn at random; the search climbs from the worst of these."""


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
    tally = Tally()
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
    return tally.to_dict() | {"sizes": mean_sizes(compared)}


def _search(
    of: Plant, arguments: Arguments, count: int, draws: np.random.Generator, tally: Tally
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


def _highest_forms(of: Plant, mode: Mode, starts: Starts, errors: Errors, tally: Tally) -> FloatArray:
    """The largest form of each run, which is counted; shape (T,)."""
    motion = of.motion(starts, errors)
    runs = run(of, mode, starts, measure(of, motion, errors))
    values = forms(mode, runs, motion)
    tally.add(starts, runs, values)
    highest: FloatArray = np.where(np.isnan(values), -np.inf, values).max(axis=1)
    return highest


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
    total = {name: sum(chunk.get(name, 0) for chunk in every) for name in ALL_COUNTS}
    total["worst_form"] = max((case["worst"]["form"] for case in cases if case["worst"]), default=None)
    return settings | {"total": total, "cases": cases, "form_edges": FORM_EDGES[:-1].tolist()}
