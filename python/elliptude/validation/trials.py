"""Runs the guaranteed filter over trials of a kind, and judges what it claims: `elliptude validate --kind`.

A set must hold the truth if everything that it rests on kept its bounds. This module follows that from what was told
and from what the filter dropped: a lie that it kept is in its set until a conditional claim is regained.
"""

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude import _core
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray
from elliptude.validation.adversary import Case, Motion, Plant, draw_errors, draw_starts, measure
from elliptude.validation.judge import FORM_EDGES, forms_of
from elliptude.validation.plants import guaranteed, plant
from elliptude.validation.questions import (
    ANSWERS,
    QuestionTally,
    answers_of_filter,
    answers_of_log,
    draw_vertical,
    shares_of,
)
from elliptude.validation.trial_kinds import KINDS, Told, Trial

UNCONDITIONAL, CONDITIONAL, NO_SET = (CLAIMS.index(name) for name in ("unconditional", "conditional", "none"))
FAILED, TOO_LATE = 3, 4
"""Claims of rows at which the filter gave up, and of rows that came too late and were rightly refused."""

COUNTS = (
    "updates",
    "unconditional",
    "conditional",
    "without_set",
    "escapes",
    "overclaimed",
    "refused",
    "failed",
    "misled",
    "liars",
    "recoveries",
    "stuck",
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The filter's sets and claims after each of the R rows of a trial."""

    attitudes: FloatArray
    """Shape (R, 3, 3), as all that follows NaN where there is no set."""
    vectors: FloatArray
    """Shape (R, 3)."""
    shapes: FloatArray
    """Shape (R, 6, 6)."""
    claims: NDArray[np.uint8]
    """Shape (R,)."""
    dropped: NDArray[np.bool_]
    """Which directions and, last, rate were left out, shape (R, m + 1)."""
    contradicted: NDArray[np.bool_]
    """Shape (R,)."""
    refused: NDArray[np.bool_]
    """Rows whose measurements were refused as a whole, with an error: none of them is in the set, shape (R,)."""
    forgotten: NDArray[np.bool_]
    """Rows at which an input was refused, so that a new filter begins that knows nothing, shape (R,)."""
    answers: FloatArray
    """See `elliptude.validation.questions`, shape (R, 14)."""


# --- the filter over a trial ------------------------------------------------------------------------------------------


class _Runner:
    """The filter of one trial, which gets as many rows at once as it takes."""

    def __init__(self, of: Plant, flow: Any, told: Told, vertical: FloatArray) -> None:
        self.of, self.flow, self.told, self.vertical = of, flow, told, vertical
        self.times: FloatArray = of.interval * told.rows.astype(np.float64)
        count, sensors = told.lies.shape
        self.outcome = Outcome(
            attitudes=np.full((count, 3, 3), np.nan),
            vectors=np.full((count, 3), np.nan),
            shapes=np.full((count, 6, 6), np.nan),
            claims=np.full(count, FAILED, np.uint8),
            dropped=np.zeros((count, sensors), bool),
            contradicted=np.zeros(count, bool),
            refused=np.zeros(count, bool),
            forgotten=np.zeros(count, bool),
            answers=np.full((count, ANSWERS), np.nan),
        )
        self.filter = self._first()

    def _first(self) -> Any:
        """A filter that is told the first set, unless that is refused, which only a lie may be."""
        told = self.told
        if told.shape is None:
            return self._new(None, self.times[0])
        try:
            start = _core.StateEllipsoid(told.attitude, told.vector, told.shape, told.chart)  # type: ignore[arg-type]
            return self._new(start, self.times[0])
        except ValueError:
            if not told.start_lies:
                raise
        return self._new(None, self.times[0])

    def _new(self, start: Any, time: float) -> Any:
        return guaranteed("GuaranteedFilter")(self.flow, start, time=time, **self.told.options)

    def run(self) -> Outcome:
        """Feed all rows."""
        last, count = 0, len(self.times)
        self.outcome.claims[0] = CLAIMS.index(self.filter.claim)
        while last < count - 1:
            end = last + 1
            while end < count and self.times[end] >= self.times[end - 1]:
                end += 1
            rows = np.arange(last, end)
            # The first of these rows has been fed before, but for a gyro's sample.
            if not self._at_once(rows) and not self._one_by_one(rows):
                break
            last = end - 1
            if end < count:  # a row that comes too late
                last = self._offer_late(end, last)
        return self.outcome

    def _offer_late(self, row: int, last: int) -> int:
        """A row whose time is past must be refused; the filter goes on as if it had not come."""
        before = (self.filter.time, self.filter.claim)
        try:
            self.filter.predict(self.times[row], **self._input(row - 1))
        except ValueError:
            self.outcome.claims[row] = TOO_LATE if (self.filter.time, self.filter.claim) == before else FAILED
        self.told.rates[row] = self.told.rates[last]
        self.told.directions[row] = np.nan
        self.times[row] = self.times[last]
        return row

    def _input(self, row: int) -> dict[str, Any]:
        """Input of the interval from this row on."""
        if not self.of.has_gyro:
            return {}
        told = self.told
        return {"gyro": told.rates[row]} | ({} if told.increments is None else {"increment": told.increments[row]})

    def _at_once(self, rows: NDArray[np.intp]) -> bool:
        """Whether the filter takes all rows; it is as it was if not."""
        of, told = self.of, self.told
        directions, rates = told.directions[rows], told.rates[rows]
        directions[0] = np.nan
        arguments: dict[str, Any] = {"directions": directions, "reference": of.reference, "bounds": of.bound}
        arguments["vertical"] = self.vertical
        if of.has_gyro:
            arguments["gyro"] = rates
            if told.increments is not None:
                arguments["increment"] = told.increments[rows]
        else:
            rates[0] = np.nan
            arguments |= {"angular_velocity": rates, "rate_bound": of.rate_bound}
        try:
            log = self.filter.run(self.times[rows], **arguments)
        except ValueError:
            return False
        known = rows[1:]
        into = self.outcome
        for name in ("attitudes", "vectors", "shapes", "claims"):
            getattr(into, name)[known] = getattr(log, name)[1:]
        into.answers[known] = answers_of_log(log)[1:]
        into.dropped[known] = log.dropped[1:, : into.dropped.shape[1]]
        with np.errstate(invalid="ignore"):
            into.contradicted[known] = (log.margins[1:] < 0.0) | log.dropped[1:].any(axis=1)
        return True

    def _one_by_one(self, rows: NDArray[np.intp]) -> bool:
        """Feed rows one of which is refused; False if that one has no lie, and the trial ends."""
        told, into = self.told, self.outcome
        for before, row in pairwise(rows):
            try:
                self.filter.predict(self.times[row], **self._input(before))
            except ValueError:
                if not (self.of.has_gyro and told.lies[before, -1]):
                    return False
                self.filter = self._new(None, self.times[row])
                into.forgotten[row] = True
            try:
                into.contradicted[row], into.dropped[row] = self._update(row)
            except ValueError:
                if not (told.lies[row, :-1].any() or (told.lies[row, -1] and not self.of.has_gyro)):
                    return False
                into.dropped[row] = into.contradicted[row] = into.refused[row] = True
            into.claims[row] = CLAIMS.index(self.filter.claim)
            ellipsoid = self.filter.ellipsoid
            if ellipsoid is not None:
                into.attitudes[row], into.vectors[row] = ellipsoid.attitude, ellipsoid.vector
                into.shapes[row] = ellipsoid.shape
                into.answers[row] = answers_of_filter(self.filter, self.vertical)
        return True

    def _update(self, row: int) -> tuple[bool, NDArray[np.bool_]]:
        """Whether it contradicted, and what was dropped."""
        of, told = self.of, self.told
        count = told.directions.shape[1]
        measured = np.flatnonzero(np.isfinite(told.directions[row]).all(axis=1))
        arguments: dict[str, Any] = {}
        names = [str(i) for i in measured]
        if len(measured):
            arguments = {
                "directions": told.directions[row, measured],
                "reference": of.reference[measured],
                "bounds": of.bound,
            }
        if not of.has_gyro and not np.isnan(told.rates[row]).any():
            arguments |= {"angular_velocity": told.rates[row], "rate_bound": of.rate_bound}
            names.append(str(count))
        dropped = np.zeros(count + 1, bool)
        if not arguments:
            return False, dropped
        update = self.filter.update(**arguments, sensors=names)
        dropped[[int(name) for name in update.dropped]] = True
        return update.margin < 0.0 or bool(dropped.any()), dropped


# --- the judge --------------------------------------------------------------------------------------------------------


def rests_on_lies(of: Plant, told: Told, outcome: Outcome) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether a lie has gone into the set, row by row, and whether a true measurement was refused although none had.

    Parameters
    ----------
    of : Plant
    told : Told
    outcome : Outcome

    Returns
    -------
    resting, refused : (R,) array of bool
    """
    count = len(told.rows)
    resting, refused = np.zeros(count, bool), np.zeros(count, bool)
    measured_lies = told.lies.copy()
    if of.has_gyro:
        measured_lies[:, -1] = False
    now, sample = told.start_lies and told.shape is not None, 0
    resting[0] = now
    before = outcome.claims[0]
    for row in range(1, count):
        claim = outcome.claims[row]
        if claim in (FAILED, TOO_LATE):
            resting[row] = now
            continue
        if outcome.forgotten[row]:
            now = False
        elif of.has_gyro and told.lies[sample, -1]:
            now = True
        sample = row
        kept = measured_lies[row] & ~outcome.dropped[row]
        has_kept = np.count_nonzero(kept) > told.most_lies
        if told.most_lies:
            refused[row] = bool((outcome.dropped[row] & ~measured_lies[row]).any()) or (
                outcome.contradicted[row] and not outcome.dropped[row].any()
            )
        elif not now and not has_kept:
            # Three lies cost all measurements of an update, by design, and without a set, or where the past is given
            # up, nobody knows who lies.
            lied = np.count_nonzero(measured_lies[row])
            true_dropped = bool((outcome.dropped[row] & ~measured_lies[row]).any())
            refused[row] = (outcome.contradicted[row] and lied == 0) or (
                true_dropped and lied <= 2 and max(before, claim) <= CONDITIONAL and not outcome.refused[row]
            )
        regained = before == CONDITIONAL and claim == UNCONDITIONAL
        now = bool(has_kept) if regained else now or bool(has_kept)
        resting[row] = now
        before = claim
    return resting, refused


def overclaimed(told: Told, outcome: Outcome) -> NDArray[np.bool_]:
    """Where a claim is unconditional although something was dropped less than `regain_after` updates before.

    Parameters
    ----------
    told : Told
    outcome : Outcome

    Returns
    -------
    (R,) array of bool
    """
    result = np.zeros(len(told.rows), bool)
    if told.most_lies:
        return result
    regain_after, agreeing = int(told.options.get("regain_after", 10)), None
    for row in range(1, len(result)):
        if outcome.claims[row] == TOO_LATE or outcome.refused[row]:
            continue
        if outcome.claims[row] == NO_SET:
            agreeing = None  # nothing was kept, so what comes next does not rest on what was dropped
        elif outcome.contradicted[row]:
            agreeing = 0
        elif agreeing is not None and _has_measurement(told, row):
            agreeing += 1
        if outcome.claims[row] == UNCONDITIONAL and agreeing is not None:
            result[row] = agreeing < regain_after
            agreeing = None if agreeing >= regain_after else agreeing
    return result


def _has_measurement(told: Told, row: int) -> bool:
    return bool(np.isfinite(told.directions[row]).any() or np.isfinite(told.rates[row]).any())


def recovery(told: Told, outcome: Outcome, inside: NDArray[np.bool_]) -> tuple[int | None, bool]:
    """How many updates after the first contradiction the filter recovered from a liar, and whether that was too many.

    The first contradiction is that since the last lie. None if there is none, or if the log is too short.

    Parameters
    ----------
    told : Told
    outcome : Outcome
    inside : (R,) array of bool
        Whether there is a set, and the truth in it.

    Returns
    -------
    updates, is_stuck
    """
    if not (told.lies.any() or told.start_lies) or told.most_lies:
        return None, False
    last_lie = int(np.flatnonzero(told.lies.any(axis=1)).max(initial=0))
    suspicious = outcome.contradicted | (outcome.claims == FAILED) | outcome.forgotten
    suspicious[last_lie] |= outcome.claims[last_lie] != UNCONDITIONAL and last_lie > 0
    begun = np.flatnonzero(suspicious[last_lie:])
    if len(begun) == 0:
        return None, False
    first = last_lie + int(begun[0])
    good = (outcome.claims == UNCONDITIONAL) & inside
    bad = np.flatnonzero(~good[first:])
    updates = 0 if len(bad) == 0 else int(bad[-1]) + 1
    allowed = 2 * int(told.options.get("regain_after", 10))
    if updates <= allowed and good[-1]:
        return updates, False
    return None, first + allowed < len(good)


def try_kind(case: Case, count: int, updates: int, draws: np.random.Generator) -> dict[str, Any]:
    """Run some trials of a kind; returns plain numbers.

    Parameters
    ----------
    case : Case
    count : int
        Number of trials.
    updates : int
        Updates in each of them, if none are lost.
    draws : numpy.random.Generator

    Returns
    -------
    dict
    """
    kind = KINDS[case.kind]
    of = kind.plant(plant(case), draws)
    starts = kind.starts(of, draw_starts(of, count, draws), draws)
    errors = draw_errors(of, case.noise, starts, updates, draws)
    motion = of.motion(starts, errors)
    measured = measure(of, motion, errors)
    flow = of.guaranteed_flow()
    tally = Tally(draw_vertical(of, draws))
    for trial in range(count):
        told = kind.tell(Trial(of, starts, motion, measured, trial), draws)
        truth = Motion(*(getattr(motion, field.name)[trial, told.rows][None] for field in fields(motion)))
        outcome = _Runner(of, flow, told, tally.vertical).run()
        tally.add(of, told, outcome, truth)
    return tally.to_dict()


def _forms(told: Told, outcome: Outcome, truth: Motion) -> FloatArray:
    """Forms of the truth in each set; the larger of both parts if the vector is not estimated (a product)."""
    centers = (outcome.attitudes, outcome.vectors)
    true = (truth.attitudes[0], truth.vectors[0])
    if told.options.get("estimate_vector", True):
        return forms_of("guaranteed", *centers, outcome.shapes, *true)
    return np.maximum(
        forms_of("guaranteed", *centers, outcome.shapes, true[0], centers[1]),
        forms_of("guaranteed", *centers, outcome.shapes, centers[0], true[1]),
    )


class Tally:
    """Counts over the trials of a chunk, in which tilt and heading are about one vertical, shape (3,)."""

    def __init__(self, vertical: FloatArray) -> None:
        self.vertical = vertical
        self.questions = QuestionTally()
        self.counts = dict.fromkeys(COUNTS, 0)
        self.trials = 0
        self.slowest = 0
        self.worst: dict[str, Any] | None = None
        self.histogram = np.zeros(len(FORM_EDGES) - 1, np.int64)

    def add(self, of: Plant, told: Told, outcome: Outcome, truth: Motion) -> None:
        """Judge a trial."""
        values = _forms(told, outcome, truth)
        there = outcome.claims != TOO_LATE
        there[0] = False
        has_set = there & (outcome.claims <= CONDITIONAL)
        values = np.where(has_set, np.where(np.isnan(values), np.inf, values), np.nan)
        resting, refused = rests_on_lies(of, told, outcome)
        judged = has_set & ~resting
        escaped = judged & (values > 1.0)
        misled = has_set & resting & (outcome.claims == UNCONDITIONAL) & (values > 1.0)
        updates, is_stuck = recovery(told, outcome, ~(values > 1.0) & has_set)
        counted = {
            "updates": there,
            "unconditional": there & (outcome.claims == UNCONDITIONAL),
            "conditional": there & (outcome.claims == CONDITIONAL),
            "without_set": there & (outcome.claims == NO_SET),
            "escapes": escaped,
            "overclaimed": overclaimed(told, outcome) & there,
            "refused": refused & there,
            "failed": there & (outcome.claims == FAILED),
            "misled": misled,
            "liars": np.array(told.lies.any() or told.start_lies),
            "recoveries": np.array(updates is not None),
            "stuck": np.array(is_stuck),
        }
        for name, where in counted.items():
            self.counts[name] += int(np.sum(where))
        self.slowest = max(self.slowest, updates or 0)
        self.histogram += np.histogram(values[judged], np.append(FORM_EDGES[:-1], np.finfo(float).max))[0]
        self.histogram[-1] += int(np.sum(np.isinf(values[judged])))
        if judged.any():
            update = int(np.argmax(np.where(judged, values, -np.inf)))
            if self.worst is None or values[update] > self.worst["form"]:
                self.worst = {"form": float(values[update]), "trial": self.trials, "update": update}
        centers, true = (outcome.attitudes, outcome.vectors), (truth.attitudes[0], truth.vectors[0])
        shares = shares_of(of, centers, outcome.shapes, outcome.answers, true, self.vertical)
        self.questions.add({name: share[None, 1:] for name, share in shares.items()}, judged[None, 1:], self.trials)
        self.trials += 1

    def to_dict(self) -> dict[str, Any]:
        """The counts for JSON, which has no infinity."""
        worst = self.worst
        if worst is not None and np.isinf(worst["form"]):
            worst = worst | {"form": float(np.finfo(float).max)}
        figures = {"slowest": self.slowest, "worst": worst, "histogram": self.histogram.tolist()}
        return self.counts | figures | {"sizes": {"updates": 0}, "questions": self.questions.counts}
