"""What a pass forward and one backward answer together to single questions; theory, section 20.4.

Each pass answers about its own center. A range of a vector is about none. An answer about a turn becomes one about the
row's center by (18.29) and (18.30), with the axis that is asked in the place of up: they hold for any axis. A turn
about a body axis is the opposite of one of the inverse attitude about a reference axis.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elliptude.configuration.configuration import Configuration
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.estimation.questions.answers import Answers, answers_of_sets
from elliptude.monitoring import Sets, arcs, monitor
from elliptude.results import CLAIMS, AttitudeBounds, GuaranteedLog
from elliptude.smoothing.fusion import StateSets, common, log_sizes
from elliptude.typing import FloatArray

_NONE = CLAIMS.index("none")
# What rounding may do to a shape in other axes, as a share of its trace.
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)
_Rows = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Answered:
    """What one pass answers, in the order of the rows."""

    sets: GuaranteedLog
    answers: Answers
    counts: _Rows
    """Rows whose set rests on it, shape (n,)."""


def answers_of_both(
    run: GuaranteedRun, forward: Answered, backward: Answered, configuration: Configuration
) -> Answers | None:
    """What both passes answer about the centers of a smoothed run.

    Parameters
    ----------
    run : GuaranteedRun
        The smoothed one.
    forward, backward : Answered
    configuration : Configuration

    Returns
    -------
    Answers or None
        None if nothing is asked. An answer rests on what the row's set rests on.
    """
    answers = answers_of_sets(run.sets, configuration.estimator.questions)
    for one in (forward, backward):
        if answers.reference_turns is not None and one.answers.reference_turns is not None:
            _narrow_turns(answers.reference_turns, run.sets, one, one.answers.reference_turns)
        if answers.body_turns is not None and one.answers.body_turns is not None:
            inverse = replace(one, sets=_inverse(one.sets))
            turned = _opposite(answers.body_turns)
            _narrow_turns(turned, _inverse(run.sets), inverse, _opposite(one.answers.body_turns))
            answers.body_turns[:] = _opposite(turned)
        if answers.vectors is not None and one.answers.vectors is not None:
            _narrow(answers.vectors, one.answers.vectors, one.counts)
    if answers.own_attitudes is not None and answers.own_shapes is not None:
        weight = None if configuration.estimator.criterion == "volume" else np.eye(3)
        for attitudes, shapes, counts in _own_sets(forward, backward, weight):
            smaller = counts & (log_sizes(shapes, weight) < log_sizes(answers.own_shapes, weight))
            answers.own_attitudes[smaller], answers.own_shapes[smaller] = attitudes[smaller], shapes[smaller]
    return answers


def turned_round(answers: Answers) -> Answers:
    """Answers of a pass over a mirrored log, in the order of the log: attitudes are the same, a vector is opposite."""
    return Answers(
        reference_turns=_reversed(answers.reference_turns),
        body_turns=_reversed(answers.body_turns),
        vectors=None if answers.vectors is None else _opposite(answers.vectors[::-1]),
        own_attitudes=_reversed(answers.own_attitudes),
        own_shapes=_reversed(answers.own_shapes),
    )


def _reversed(values: FloatArray | None) -> FloatArray | None:
    return None if values is None else values[::-1]


def _opposite(ranges: FloatArray) -> FloatArray:
    """The ranges (..., 2) of the same with the other sign."""
    return np.asarray(-ranges[..., ::-1])


def _narrow(ranges: FloatArray, by: FloatArray, rows: _Rows) -> None:
    """Narrow ranges (n, 3, 2) by others at some rows; where rounding leaves nothing they stay."""
    least, most = np.fmax(ranges[..., 0], by[..., 0]), np.fmin(ranges[..., 1], by[..., 1])
    takes = rows[:, None] & (least <= most)
    ranges[takes] = np.stack([least, most], axis=-1)[takes]


def _narrow_turns(ranges: FloatArray, sets: GuaranteedLog, one: Answered, answered: FloatArray) -> None:
    """Narrow turns about reference axes from the centers of sets by what a pass answers about its own centers."""
    same = one.counts & (sets.attitudes == one.sets.attitudes).all(axis=(1, 2))
    _narrow(ranges, answered, same)
    moved = np.flatnonzero(one.counts & ~same & (sets.claims < _NONE))
    if not len(moved):
        return
    passed = Sets.of(one.sets)
    rows = Sets(sets.times[moved], passed.quaternions[moved], passed.shapes[moved], one.sets.claims[moved])
    for i, axis in enumerate(np.eye(3)):
        tilts = monitor(rows, one.sets.attitudes[moved], up=axis).bounds[:, 1]
        least, most = answered[moved, i].T
        bounds = AttitudeBounds(tilts, least, most, np.full(len(moved), np.pi))
        seen = monitor(replace(rows, bounds=bounds, vertical=axis), sets.attitudes[moved], up=axis).headings
        both = arcs.common(ranges[moved, i], seen)
        # An arc beyond half a turn to either side says nothing that a range could.
        within = (both[:, 0] >= -np.pi) & (both[:, 1] <= np.pi)
        ranges[moved, i] = np.where(within[:, None], both, ranges[moved, i])


def _inverse(sets: GuaranteedLog) -> GuaranteedLog:
    """The sets of the inverse attitudes Cᵀ: of ĈCᵀ, whose Gibbs vector is −Ĉγ."""
    shapes = sets.shapes.copy()
    turned = sets.attitudes @ sets.shapes[:, :3, :3] @ sets.attitudes.swapaxes(1, 2)
    shapes[:, :3, :3] = turned + _ROUNDING * np.trace(turned, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return replace(sets, attitudes=sets.attitudes.swapaxes(1, 2), shapes=shapes, question_bounds=None)


def _own_sets(
    forward: Answered, backward: Answered, weight: FloatArray | None
) -> Iterator[tuple[FloatArray, FloatArray, _Rows]]:
    """Sets of the attitude by itself: of each pass, and about what both leave possible, with the rows that count."""
    passes = []
    for one in (forward, backward):
        attitudes, shapes = one.answers.own_attitudes, one.answers.own_shapes
        assert attitudes is not None
        assert shapes is not None
        passes.append((attitudes, shapes, one.counts))
    yield from passes
    rows = forward.counts & backward.counts
    at = np.flatnonzero(rows)
    sets = [StateSets(attitudes[at], np.empty((len(at), 0)), shapes[at]) for attitudes, shapes, _ in passes]
    found = common(sets[0], sets[1], weight)
    attitudes, shapes = (np.full_like(part, np.nan) for part in passes[0][:2])
    attitudes[at], shapes[at] = found.sets.attitudes, found.sets.shapes
    usable = np.zeros_like(rows)
    usable[at] = found.meet & np.isfinite(found.sets.shapes).all(axis=(1, 2))
    yield attitudes, shapes, usable
