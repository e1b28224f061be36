"""Counts over many runs: what became of their updates, the worst of them, and how large their sets are."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from elliptude.typing import FloatArray
from elliptude.validation import trials
from elliptude.validation.adversary import Starts
from elliptude.validation.filter_runs import FAILED, HOLDS, REFUSED, WITHOUT_SET, Runs
from elliptude.validation.judge import FORM_EDGES
from elliptude.validation.questions import QuestionTally, combine_questions

SETTLED_UPDATE = 6
"""Sizes are means from this update on."""
COUNTS = ("updates", "escapes", "refused", "without_set", "failed", "predictions", "used")
ALL_COUNTS = tuple(dict.fromkeys((*COUNTS, *trials.COUNTS)))
"""With the counts of the kinds of trials."""
SIZES = ("trace", "volume_radius", "largest_angle_rad")


class Tally:
    """Counts over runs, with the largest form of the truth, its trial and its update."""

    def __init__(self) -> None:
        self.runs = 0
        self.counts = dict.fromkeys(COUNTS, 0)
        self.worst: dict[str, Any] | None = None
        self.histogram = np.zeros(len(FORM_EDGES) - 1, np.int64)
        self.questions = QuestionTally()

    def add(
        self, starts: Starts, runs: Runs, values: FloatArray, shares: Mapping[str, FloatArray] | None = None
    ) -> None:
        """Count runs.

        Parameters
        ----------
        starts : Starts
        runs : Runs
        values : (T, U) array
            Their forms.
        shares : mapping of (T, U) array, optional
            Of each question that was asked, how far the truth goes towards the end of the answer.
        """
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
        self.questions.add(shares or {}, judged, self.runs)
        self.runs += len(values)

    def to_dict(self) -> dict[str, Any]:
        """The counts for JSON, which has no infinity."""
        worst = self.worst
        if worst is not None and math.isinf(worst["form"]):
            worst = worst | {"form": float(np.finfo(float).max)}
        counts = self.counts | {"worst": worst, "histogram": self.histogram.tolist()}
        return counts | ({"questions": self.questions.counts} if self.questions.counts else {})


def mean_sizes(compared: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Means of sizes (T, U, 3) over the settled updates at which all compared filters have a set."""
    settled = {name: of[:, SETTLED_UPDATE - 1 :].reshape(-1, 3) for name, of in compared.items()}
    known = np.logical_and.reduce([np.isfinite(of).all(axis=1) for of in settled.values()])
    if not known.any():
        return {"updates": 0}
    means = {name: dict(zip(SIZES, of[known].mean(axis=0).tolist(), strict=True)) for name, of in settled.items()}
    return {"updates": int(known.sum())} | means


def combine(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Counts, worst form and mean sizes of chunks, or of cases that were combined before."""
    counts: dict[str, Any] = {name: sum(part[name] for part in parts) for name in ALL_COUNTS if name in parts[0]}
    if "slowest" in parts[0]:
        counts["slowest"] = max(part["slowest"] for part in parts)
    worsts = [part["worst"] for part in parts if part["worst"] is not None]
    histogram = np.sum([part["histogram"] for part in parts], axis=0).tolist()
    asked = [part["questions"] for part in parts if "questions" in part]
    if asked:
        counts["questions"] = combine_questions(asked)
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
                size: sum(part["updates"] * part[name][size] for part in counted) / updates for size in SIZES
            }
    return result
