"""Adversarial Monte Carlo: whether the truth stays in the set, whatever the errors within their bounds.

Every trial is a motion, a first set with the truth in it or on its boundary, and measurements with errors within the
bounds, drawn at random or by a search that pushes the truth out of the set, or out of the answer to one question. The
truth solves the continuous equations, by an integrator of its own; NumPy judges containment, in the chart of the set.
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
    Measured,
    Motion,
    Plant,
    Starts,
    draw_errors,
    draw_starts,
    measure,
    propose,
)
from elliptude.validation.filter_runs import Runs, forms, measured_alone, question_shares, run
from elliptude.validation.judge import FORM_EDGES, Mode, sizes
from elliptude.validation.plants import plant
from elliptude.validation.questions import combine_questions, draw_vertical
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
    judge = _Judge(of, arguments.mode, draw_vertical(of, draws))
    if case.noise == "search":
        starts, errors = _search(judge, arguments.updates, count, draws)
    else:
        starts = draw_starts(of, count, draws)
        errors = draw_errors(of, case.noise, starts, arguments.updates, draws)
    motion = of.motion(starts, errors)
    measured = measure(of, motion, errors)
    if case.noise == "search":  # all runs of the search have been counted
        runs = run(of, arguments.mode, starts, measured)
    else:
        runs, _ = judge.count(starts, motion, measured)
    compared = {
        "own": sizes(arguments.mode, runs.shapes),
        "paper": sizes("paper", run(of, "paper", starts, measured).shapes),
    }
    alone = measured_alone(of, arguments.mode, measured)
    if alone is not None:
        compared["measured"] = sizes(arguments.mode, alone)
    return judge.tally.to_dict() | {"sizes": mean_sizes(compared)}


class _Judge:
    """Runs the filter of a mode, and counts what becomes of its sets and, in the guaranteed mode, of its answers."""

    def __init__(self, of: Plant, mode: Mode, vertical: FloatArray) -> None:
        self.of, self.mode, self.vertical = of, mode, vertical
        self.tally = Tally()

    def count(self, starts: Starts, motion: Motion, measured: Measured) -> tuple[Runs, dict[str, FloatArray]]:
        """Runs, then their forms under "set" and the shares of all answers by question, shape (T, U)."""
        asks = self.mode == "guaranteed"
        runs = run(self.of, self.mode, starts, measured, vertical=self.vertical if asks else None)
        values = forms(self.mode, runs, motion)
        shares = question_shares(self.of, runs, motion, measured, self.vertical) if asks else {}
        self.tally.add(starts, runs, values, shares)
        return runs, {"set": values, **shares}


def _search(judge: _Judge, updates: int, count: int, draws: np.random.Generator) -> tuple[Starts, Errors]:
    """Searches with `count` runs in total, side by side; returns where each of them ended.

    Every second one, at random, climbs the form of the set, the others the share of one question each.
    """
    searches = -(-count // SEARCH_RUNS)
    drawn = max(searches, round(SEARCH_DRAWN * count))
    starts = draw_starts(judge.of, drawn, draws)
    errors = draw_errors(judge.of, "search", starts, updates, draws)
    heights = _heights(judge, starts, errors)
    goals = np.where(draws.random(searches) < 0.5, 0, draws.integers(len(heights), size=searches))
    chosen = np.empty(searches, np.intp)
    for search, goal in enumerate(goals):
        best_first = np.argsort(-heights[goal], kind="stable")
        chosen[search] = best_first[~np.isin(best_first, chosen[:search])][0]
    starts, best, highest = starts.of(chosen), errors.of(chosen), heights[goals, chosen]
    for done in range(drawn, count, searches):
        some = np.arange(min(searches, count - done))
        tried = propose(best, draws).of(some)
        reached = _heights(judge, starts.of(some), tried)[goals[some], some]
        better = reached > highest[some]
        highest[some[better]] = reached[better]
        for field in fields(best):
            getattr(best, field.name)[some[better]] = getattr(tried, field.name)[better]
    return starts, best


def _heights(judge: _Judge, starts: Starts, errors: Errors) -> FloatArray:
    """The largest form of each run, then its largest share of each question; counts them. Shape (K, T)."""
    motion = judge.of.motion(starts, errors)
    _, values = judge.count(starts, motion, measure(judge.of, motion, errors))
    heights: FloatArray = np.array([np.where(np.isnan(value), -np.inf, value).max(axis=1) for value in values.values()])
    return heights


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
        ``cases``, each with its figures, ``total``, and the arguments. ``questions`` of both, if any were asked, has
        for each how often it was answered, how often the truth was outside, and the largest share with its place.
    """
    by_case: dict[str, list[Mapping[str, Any]]] = {case.name: [] for case in arguments.cases}
    for name, case, number in chunks(arguments):
        by_case[case.name].append(_placed(done[name], chunk=number))
    cases = [asdict(case) | combine(by_case[case.name]) for case in arguments.cases]
    every = [chunk for case in arguments.cases for chunk in by_case[case.name]]
    settings = {key: value for key, value in arguments.to_dict().items() if key != "cases"}
    total = {name: sum(chunk.get(name, 0) for chunk in every) for name in ALL_COUNTS}
    total["worst_form"] = max((case["worst"]["form"] for case in cases if case["worst"]), default=None)
    asked = [
        _placed(counts, case=case.name)["questions"]
        for case, counts in zip(arguments.cases, cases, strict=True)
        if "questions" in counts
    ]
    if asked:
        total["questions"] = combine_questions(asked)
    return settings | {"total": total, "cases": cases, "form_edges": FORM_EDGES[:-1].tolist()}


def _placed(counts: Mapping[str, Any], **place: Any) -> dict[str, Any]:
    """Counts that say where the worst form and the largest shares are."""
    placed = dict(counts)
    if counts["worst"] is not None:
        placed["worst"] = counts["worst"] | place
    if "questions" in counts:
        placed["questions"] = {
            name: of_name | {"largest": None if of_name["largest"] is None else of_name["largest"] | place}
            for name, of_name in counts["questions"].items()
        }
    return placed
