"""Asks the guaranteed filter single questions after each row of a run; theory, sections 16.11 and 16.12.

The core runs a log in one call and keeps the sets. What an update leaves possible can be asked only of a filter that
has just been updated: a second one goes through the log row by row, with the same input, and comes to the same sets.
"""

import copy
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import Question
from elliptude.estimation.given.filter_input import FilterInput
from elliptude.estimation.guaranteed_run import GuaranteedRun, filter_of
from elliptude.results import GuaranteedLog, Interval
from elliptude.typing import FloatArray

# What a half-width may lose by rounding, as a share of what is summed.
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Answers:
    """What N rows of a run answer, NaN without a set; None for what was not asked."""

    reference_turns: FloatArray | None = None
    """From and to which angle the turn about each reference axis from center to truth is, rad, shape (N, 3, 2)."""
    body_turns: FloatArray | None = None
    """The same about each body axis at the center, shape (N, 3, 2)."""
    vectors: FloatArray | None = None
    """From and to what each component of angular velocity or gyro bias is, rad/s, body axes, shape (N, 3, 2)."""
    own_attitudes: FloatArray | None = None
    """Centers of the sets of the attitude by itself, shape (N, 3, 3)."""
    own_shapes: FloatArray | None = None
    """Their shapes in the Gibbs chart, rad², shape (N, 3, 3)."""


def answers_of(run: GuaranteedRun, configuration: Configuration) -> Answers | None:
    """What the updates of a run answer to the questions that its configuration asks.

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration
        The one of the run; ``estimator.questions`` says what is asked.

    Returns
    -------
    Answers or None
        None if nothing is asked. An answer rests on what the row's set rests on.
    """
    questions = configuration.estimator.questions
    if not questions:
        return None
    answers = answers_of_sets(run.sets, questions)
    is_volume = configuration.estimator.criterion == "volume"
    size = np.linalg.det if is_volume else np.trace
    for row, asked in enumerate(_after_each_row(run, configuration)):
        if not asked.knows_attitude:
            continue
        center = run.sets.attitudes[row]
        assert asked.ellipsoid is not None
        assert np.array_equal(asked.ellipsoid.attitude, center), "the second filter is not where the first one was"
        if answers.reference_turns is not None:
            # The reference axes in the body's are the rows of the center.
            _narrow(answers.reference_turns[row], asked.turn_about, center)
        if answers.body_turns is not None:
            _narrow(answers.body_turns[row], asked.turn_about, np.eye(3))
        if answers.vectors is not None:
            _narrow(answers.vectors[row], asked.vector_along, np.eye(3))
        if answers.own_attitudes is not None and answers.own_shapes is not None:
            with suppress(ValueError):  # it may hold half turns about its own center
                own = asked.attitude_set("volume" if is_volume else "trace")
                assert own is not None
                if size(own.shape) < size(answers.own_shapes[row]):
                    answers.own_attitudes[row], answers.own_shapes[row] = own
    return answers


def answers_of_sets(sets: GuaranteedLog, questions: Sequence[Question]) -> Answers:
    """What sets say, which answer all questions at once. It stands where a search finds no better bound.

    Parameters
    ----------
    sets : GuaranteedLog
    questions : sequence of Question

    Returns
    -------
    Answers
    """
    is_attitude, shapes = "attitude" in questions, sets.shapes[:, :3, :3]
    of_vector = np.sqrt(np.diagonal(sets.shapes[:, 3:, 3:], axis1=1, axis2=2))
    of_vector = of_vector + _ROUNDING * (of_vector + np.abs(sets.vectors))
    return Answers(
        reference_turns=_around(0.0, _reach(sets.attitudes, shapes)) if "reference_turns" in questions else None,
        body_turns=_around(0.0, _reach(np.eye(3), shapes)) if "body_turns" in questions else None,
        vectors=_around(sets.vectors, of_vector) if "vector" in questions else None,
        own_attitudes=sets.attitudes.copy() if is_attitude else None,
        own_shapes=shapes.copy() if is_attitude else None,
    )


def _reach(axes: FloatArray, shapes: FloatArray) -> FloatArray:
    """How far sets (N, 3, 3) turn about axes in body axes, the rows of (N, 3, 3): 2 atan(n · γ / 2), shape (N, 3)."""
    # Thin sets lose what is small beside their trace.
    squares = ((axes @ shapes) * axes).sum(axis=-1) + _ROUNDING * np.trace(shapes, axis1=1, axis2=2)[:, None]
    return np.asarray((1.0 + _ROUNDING) * 2.0 * np.arctan(0.5 * np.sqrt(squares)))


def _around(middle: FloatArray | float, half_widths: FloatArray) -> FloatArray:
    return np.stack([middle - half_widths, middle + half_widths], axis=-1)


def _narrow(answers: FloatArray, question: Callable[[FloatArray], Interval | None], axes: FloatArray) -> None:
    """Ask about three axes (3, 3), and narrow what is known of each, shape (3, 2)."""
    for axis, known in zip(axes, answers, strict=True):
        with suppress(ValueError):  # rounding leaves no bound
            found = question(axis)  # near the least bound, and so a little wider than the set's may be
            assert found is not None
            least, most = max(known[0], found.least), min(known[1], found.most)
            if least <= most:
                known[:] = least, most


def _after_each_row(run: GuaranteedRun, configuration: Configuration) -> Iterator[elliptude.GuaranteedFilter]:
    """The filter as the run had it after each row, ready to be asked."""
    given = run.given
    working = filter_of(given, run.start, configuration)
    anchor = working
    for row, time in enumerate(given.times):
        if given.turns is None:
            working.predict(float(time), **_motion(given, row))
        else:
            if given.turns.anchors[row] == row - 1:
                anchor = working
            working = copy.copy(anchor)
            working.predict_turn(float(time), given.turns.vectors[row], float(given.turns.angles[row]))
        if measured := _measured(given, row):
            working.update(**measured)
        yield working


def _motion(given: FilterInput, row: int) -> dict[str, Any]:
    """How the body moved until a row: a gyro's row is of the interval that it begins."""
    return {name: values[max(row - 1, 0) if name == "gyro" else row] for name, values in given.motion.items()}


def _measured(given: FilterInput, row: int) -> dict[str, Any]:
    """What was measured in a row, as arguments of `GuaranteedFilter.update`."""
    found: dict[str, Any] = {}
    if (directions := given.measured.get("directions")) is not None:
        bounds = given.measured["bounds"][row]
        there = np.isfinite(directions[row]).all(axis=1) & (bounds < np.pi)  # NaN fails, too
        if there.any():
            references = given.measured["reference"]
            found = {
                "directions": directions[row, there],
                "reference": (references if references.ndim == 2 else references[row])[there],
                "bounds": bounds[there],
            }
    rates = given.measured.get("angular_velocity")
    if rates is not None and np.isfinite(rates[row]).all():
        found |= {"angular_velocity": rates[row], "rate_bound": given.measured["rate_bound"]}
    return found
