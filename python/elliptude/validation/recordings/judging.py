"""Judges what an estimation says of a drawn recording, row by row, by its exact truth."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.estimation.estimator import Estimation
from elliptude.estimation.guaranteed_run import turned_to_start
from elliptude.results import CLAIMS
from elliptude.typing import FloatArray
from elliptude.validation.questions import tilt_and_heading
from elliptude.validation.recordings.drawing import Recording

# Rounding of truth, of files and of bounds that they reach, rad and in shares.
_ROUNDING = 1e-9
_PI = np.pi


@dataclass
class Verdict:
    """What became of a recording."""

    rows: int = 0
    unconditional: int = 0
    contradicted: int = 0
    """Measurements that were called contradictory, or left out, although all kept their bounds."""
    answers: dict[str, dict[str, Any]] = field(default_factory=dict)
    """For each answer: how many there were, missing how many, without the truth how many, its largest share and row."""
    error: str | None = None
    """Why there is no result."""
    implausible: str | None = None
    """Why its log would have been refused, if nobody had said to go on; that is no promise, and no fault."""

    def add(self, name: str, shares: FloatArray, promised: NDArray[np.bool_]) -> None:
        """Count answers of the rows that promise one: there NaN is a promise that is missing."""
        missing, judged = promised & np.isnan(shares), promised & ~np.isnan(shares)
        shares = np.where(judged, shares, -np.inf)
        counted: dict[str, Any] = {
            "answers": int(judged.sum()),
            "missing": int(missing.sum()),
            "outside": int((shares > 1.0).sum()),
            "largest": None,
        }
        if judged.any():
            row = int(np.argmax(shares))
            counted["largest"] = {"share": float(min(shares[row], 1e300)), "row": row}
        self.answers[name] = counted

    @property
    def outside(self) -> int:
        """How many answers are without the truth."""
        return sum(one["outside"] for one in self.answers.values())

    @property
    def missing(self) -> int:
        """How many answers are not there, although their rows promise them."""
        return sum(one["missing"] for one in self.answers.values())

    @property
    def is_fault(self) -> bool:
        """Whether anything is wrong with it."""
        return self.outside + self.missing + self.contradicted > 0 or self.error is not None


def judge(recording: Recording, configuration: Configuration, estimation: Estimation) -> Verdict:
    """Compare all that a table of results promises with the truth.

    Parameters
    ----------
    recording : Recording
    configuration : Configuration
    estimation : Estimation
        Of the recording's log.

    Returns
    -------
    Verdict
    """
    run, result = estimation.guaranteed, estimation.result
    assert run is not None
    assert result.claims is not None
    verdict = Verdict(rows=len(result.times))
    times = result.times + result.origin
    true = recording.motion.attitudes(times)
    if run.starts_heading:
        true = turned_to_start(true, run)
    holds = np.array(result.claims) == "unconditional"
    verdict.unconditional = int(holds.sum())
    verdict.contradicted = _contradicted(estimation)
    sets = run.sets
    verdict.add("set", sets.forms(true), holds)
    estimated = sets.attitudes
    turns = np.linalg.norm(elliptude.log(np.where(holds[:, None, None], _turns(estimated, true), np.eye(3))), axis=1)
    verdict.add("largest angle", _share(turns, result.largest_angles), holds)
    _judge_vector(verdict, recording, configuration, estimation, holds, times, true)
    _judge_vertical(verdict, configuration, estimation, holds, true)
    _judge_best(verdict, configuration, estimation, holds, true)
    _judge_answers(verdict, configuration, estimation, holds, true)
    return verdict


def _turns(estimated: FloatArray, true: FloatArray) -> FloatArray:
    found: FloatArray = np.swapaxes(estimated, 1, 2) @ true
    return found


def _angles(estimated: FloatArray, true: FloatArray) -> FloatArray:
    cosines = 0.5 * (np.trace(_turns(estimated, true), axis1=1, axis2=2) - 1.0)
    found: FloatArray = np.arccos(np.clip(cosines, -1.0, 1.0))
    return found


def _contradicted(estimation: Estimation) -> int:
    run = estimation.guaranteed
    assert run is not None
    passes = [run] if run.forward is None else [run, run.forward]
    left_out = sum(int(one.sets.dropped.sum()) for one in passes)
    conditional = int((run.sets.claims == CLAIMS.index("conditional")).sum())
    of_up = 0 if run.vertical is None else int((run.vertical.claims == CLAIMS.index("conditional")).sum())
    return left_out + len(run.contradictions) + len(run.up_contradictions) + conditional + of_up


def _share(errors: FloatArray, bounds: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore"):
        found: FloatArray = errors / (bounds + _ROUNDING)
    return found


def _between(value: FloatArray, least: FloatArray, most: FloatArray) -> FloatArray:
    """How far angles go from the middle of their ends towards one; up to whole turns."""
    middle, half = 0.5 * (least + most), 0.5 * (most - least)
    off = np.abs((value - middle + _PI) % (2.0 * _PI) - _PI)
    return np.where(half >= _PI, 0.0, off / (half + _ROUNDING))


def _judge_vector(
    verdict: Verdict,
    recording: Recording,
    configuration: Configuration,
    estimation: Estimation,
    holds: NDArray[np.bool_],
    times: FloatArray,
    true: FloatArray,
) -> None:
    if not configuration.estimates_vector:
        return
    run = estimation.guaranteed
    assert run is not None
    vectors, name = recording.vectors(times), estimation.result.vector
    verdict.add(f"set with {name}", run.sets.forms(true, vectors), holds)
    # The table is of the gyro's bias, of which the state is what is not known.
    vectors = vectors + recording.known
    off = np.abs(vectors - estimation.result.vectors)
    verdict.add(name, _share(off, estimation.result.half_widths[:, 3:]).max(axis=1), holds)
    if "vector" in configuration.estimator.questions:
        ranges = estimation.result.vector_ranges
        ends = np.full((len(true), 3, 2), np.nan) if ranges is None else ranges.reshape(-1, 3, 2)
        share = np.abs(vectors - ends.mean(axis=2)) / (0.5 * np.diff(ends, axis=2)[:, :, 0] + _ROUNDING)
        verdict.add("vector by itself", share.max(axis=1), holds)


def _judge_vertical(
    verdict: Verdict, configuration: Configuration, estimation: Estimation, holds: NDArray[np.bool_], true: FloatArray
) -> None:
    run, result = estimation.guaranteed, estimation.result
    assert run is not None
    if configuration.accelerometer is None:
        return
    up, bounds = run.rows.up, run.sets.attitude_bounds
    if up is None or run.vertical is None or bounds is None or result.tilt_bounds is None:
        verdict.add("up", np.full(len(true), np.nan), holds)
        return
    assert result.headings is not None
    assert result.roll_pitch_yaw is not None
    true_up = np.einsum("nji,j->ni", true, up)
    of_up = run.vertical.claims == CLAIMS.index("unconditional")
    away = np.arctan2(
        np.linalg.norm(np.cross(run.vertical.directions, true_up), axis=1),
        np.sum(run.vertical.directions * true_up, axis=1),
    )
    verdict.add("up", _share(away, run.vertical.angles), of_up)
    tilt, heading = tilt_and_heading(run.sets.attitudes, true, up)
    # Up may be known without an attitude, whose tilt it would be.
    has_set = run.sets.claims != CLAIMS.index("none")
    verdict.add("tilt", _share(tilt, result.tilt_bounds), of_up & has_set)
    verdict.add("heading", _between(heading, *result.headings.T), holds)
    verdict.add("angle", _share(_angles(run.sets.attitudes, true), np.asarray(bounds.angle) + 1e-7), holds)
    c = true
    truth = {
        "roll": (np.arctan2(c[:, 2, 1], c[:, 2, 2]), of_up),
        "pitch": (np.arctan2(-c[:, 2, 0], np.hypot(c[:, 2, 1], c[:, 2, 2])), of_up),
        "yaw": (np.arctan2(c[:, 1, 0], c[:, 0, 0]), holds),
    }
    for i, (name, (value, judged)) in enumerate(truth.items()):
        least, most = result.roll_pitch_yaw[:, 3 * i + 1], result.roll_pitch_yaw[:, 3 * i + 2]
        verdict.add(name, _between(value, least, most), judged)


def _judge_best(
    verdict: Verdict, configuration: Configuration, estimation: Estimation, holds: NDArray[np.bool_], true: FloatArray
) -> None:
    result, run = estimation.result, estimation.guaranteed
    assert run is not None
    if configuration.estimator.best == "none":
        return
    if result.best_quaternions is None or result.best_bounds is None:
        verdict.add("best", np.full(len(true), np.nan), holds)
        return
    known = np.isfinite(result.best_quaternions[:, 0])
    attitudes = np.full_like(true, np.nan)
    best = [elliptude.rotation_from_quaternion(q) for q in result.best_quaternions[known]]
    attitudes[known] = np.array(best).reshape(-1, 3, 3)
    verdict.add("best", _share(_angles(attitudes, true), result.best_bounds + 1e-7), holds)
    if result.best_tilt_bounds is None or run.rows.up is None or result.best_tilt_claims is None:
        return
    tilt, heading = tilt_and_heading(attitudes, true, run.rows.up)
    of_tilt = np.array(result.best_tilt_claims) == "unconditional"
    verdict.add("tilt of best", _share(tilt, result.best_tilt_bounds), of_tilt)
    if result.best_headings is not None:
        verdict.add("heading of best", _between(heading, *result.best_headings.T), holds)


def _judge_answers(
    verdict: Verdict, configuration: Configuration, estimation: Estimation, holds: NDArray[np.bool_], true: FloatArray
) -> None:
    answers, run, asked = estimation.answers, estimation.guaranteed, configuration.estimator.questions
    assert run is not None
    if not asked:
        return
    if answers is None:
        verdict.add("questions", np.full(len(true), np.nan), holds)
        return
    nothing = np.full((len(true), 3, 3), np.nan)
    centers = run.sets.attitudes
    between = _turns(centers, true)
    level = np.tile(np.eye(3), (len(true), 1, 1))
    # About a body axis it is a turn of the inverse: what the body sees of the axis of the estimate.
    for question, turns, (begin, end) in (
        ("reference_turns", answers.reference_turns, (centers, true)),
        ("body_turns", answers.body_turns, (level, between)),
    ):
        if question not in asked:
            continue
        ends = nothing[:, :, :2] if turns is None else turns
        shares = np.zeros(len(true))
        for i in range(3):
            _, turned = tilt_and_heading(begin, end, np.eye(3)[i])
            shares = np.maximum(shares, _between(turned, ends[:, i, 0], ends[:, i, 1]))
        verdict.add(f"turns in {question.removesuffix('_turns')}", shares, holds)
    if "attitude" in asked:
        attitudes = nothing if answers.own_attitudes is None else answers.own_attitudes
        shapes = nothing if answers.own_shapes is None else answers.own_shapes
        known = np.isfinite(shapes[:, 0, 0])
        forms = np.full(len(true), np.nan)
        offsets = 2.0 * elliptude.cayley_inverse(_turns(attitudes[known], true[known]))
        solved = np.linalg.solve(shapes[known], offsets[:, :, None])[:, :, 0]
        forms[known] = np.sum(offsets * solved, axis=1)
        verdict.add("attitude by itself", forms, holds)
