"""Runs the guaranteed filter over a log: directions with an angle per row, flow, anchors, claims, what was dropped."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation import gaps
from elliptude.estimation.direction_rows import Contradiction, DirectionRows, direction_rows
from elliptude.estimation.gaps import Gap
from elliptude.estimation.given.filter_input import FilterInput, filter_input, turns_of
from elliptude.estimation.given.start import first_set
from elliptude.estimation.vertical import Turns, Vertical, contradictions_of_up, followed, vertical_of
from elliptude.logs.log import Log
from elliptude.results import CLAIMS, DirectionLog, GuaranteedLog
from elliptude.typing import FloatArray

CONDITIONAL = CLAIMS.index("conditional")


@dataclass(frozen=True, eq=False)
class GuaranteedRun:
    """One pass of the guaranteed filter over a log, with its sets and claims."""

    log: Log
    """The log that it went over."""
    given: "FilterInput"
    """What the filter was given."""
    start: elliptude.StateEllipsoid | None
    """The set that it began with, if it did not begin with nothing."""
    sets: GuaranteedLog
    """The sets. Claims are at most conditional if anything in the log contradicts its own stated bounds."""
    rows: DirectionRows
    vertical: Vertical | None
    """Up in body axes with its bound and claim, also where no attitude is known; None if nothing says where up is."""
    caps: DirectionLog | None
    """Up by its measured direction and the gyro alone, if that was followed."""
    starts_heading: bool
    """Whether the heading counts from the first row, because nothing else determines it."""
    gaps: tuple[Gap, ...] = ()
    """Gaps of the gyro, which its error bounds do not cover."""
    turns: Turns | None = None
    """How the body turned to each row by the gyro, which ``caps`` follow; None where it is not known."""
    up_contradictions: tuple[Contradiction, ...] = ()
    """Measurements of up that contradict what was followed of it."""
    forward: "GuaranteedRun | None" = None
    """The pass forward alone, if the sets use the whole recording; else None."""

    @property
    def contradictions(self) -> tuple[Contradiction, ...]:
        """Measurements that contradict their own bounds."""
        return self.rows.contradictions

    def sensors(self) -> tuple[str, ...]:
        """Names of the columns of ``sets.dropped``."""
        return (*self.rows.names, "rate", "attitude")


def run_guaranteed(log: Log, configuration: Configuration) -> GuaranteedRun:
    """Run the guaranteed filter over a log.

    Parameters
    ----------
    log : Log
    configuration : Configuration
        Its ``estimator.mode`` is "guaranteed".

    Returns
    -------
    GuaranteedRun

    Raises
    ------
    InconsistentMeasurement
        If sets do not meet, or a measurement contradicts its own bounds, and the policy is to raise.
    ValueError
        If a bound does not follow from the log, or the log does not fit the filter.
    """
    measured = log
    if isinstance(configuration.flow, GyroFlow):
        log = gaps.without_rates_in_gaps(log, gaps.longest_interval(log, configuration))
    rows = direction_rows(log, configuration)
    if rows.contradictions and configuration.estimator.policy == "raise":
        first = rows.contradictions[0]
        raise elliptude.InconsistentMeasurement(
            f"{first.sensor!r} contradicts its own bounds by {first.excess:.3g} {first.unit}; some bound is wrong "
            "(estimator.policy says what to do then)",
            -first.excess,
            float(log.times[first.row]),
            first.sensor,
            first.row,
        )
    start, starts_heading = first_set(configuration, rows)
    turns = turns_of(log.times, log.rates, configuration, rows)
    given = filter_input(log, configuration, rows, turns)
    guaranteed = run_filter(given, start, configuration, rows.up)
    if rows.contradictions:
        claims = guaranteed.claims.copy()
        claims[claims < CONDITIONAL] = CONDITIONAL
        guaranteed = replace(guaranteed, claims=claims)
    caps = followed(configuration, rows, turns, guaranteed, from_anchors=given.turns is not None)
    return GuaranteedRun(
        log=measured,
        given=given,
        start=start,
        sets=guaranteed,
        rows=rows,
        vertical=vertical_of(guaranteed, caps, rows.up),
        caps=caps,
        starts_heading=starts_heading,
        gaps=gaps_between(log, configuration, rows, guaranteed, given.turns),
        turns=turns,
        up_contradictions=tuple(contradictions_of_up(rows, turns, caps)),
    )


def gaps_between(
    log: Log, configuration: Configuration, rows: DirectionRows, found: GuaranteedLog, turns: Turns | None
) -> tuple[Gap, ...]:
    """What sets of a log lost in the gaps of its gyro; ``turns`` are those by which rows follow from one another."""
    if not isinstance(configuration.flow, GyroFlow) or rows.gyro is None:
        return ()
    crossed = None if turns is None else (turns.anchors, turns.angles)
    return gaps.gaps_of(log, rows.gyro, found, crossed)


def turned_to_start(true_attitudes: FloatArray, run: GuaranteedRun) -> FloatArray:
    """True attitudes (N, 3, 3) with the heading counted from the first row, as in the run; NaN if that is not known."""
    assert run.start is not None
    up, estimated = run.rows.directions[0, 0], run.start.attitude
    true_up = true_attitudes[0, 2]
    axis = np.cross(true_up, up)
    sine = float(np.linalg.norm(axis))
    turn = np.eye(3)
    if sine > 0.0:
        turn = scipy.spatial.transform.Rotation.from_rotvec(np.arctan2(sine, true_up @ up) / sine * axis).as_matrix()
    turned: FloatArray = estimated @ turn @ true_attitudes[0].T @ true_attitudes
    return turned


def filter_of(
    given: FilterInput, start: elliptude.StateEllipsoid | None, configuration: Configuration
) -> elliptude.GuaranteedFilter:
    """The guaranteed filter at the first row, before its measurements; arguments as of `run_filter`."""
    settings = configuration.estimator
    try:
        return elliptude.GuaranteedFilter(
            given.flow,
            start,
            time=float(given.times[0]),
            criterion=settings.criterion,
            weight=settings.weight(),
            policy=settings.policy,
            most_wrong=settings.most_wrong,
            regain_after=settings.regain_after,
            vector_bound=given.vector_bound,
            estimate_vector=given.estimates_vector,
        )
    except ValueError as error:
        if start is None or given.vector_bound is None or "nothing in common with what start says" not in str(error):
            raise
        raise ValueError(_start_beyond_bound(start, given.vector_bound, configuration)) from error


def _start_beyond_bound(start: elliptude.StateEllipsoid, bound: float, configuration: Configuration) -> str:
    """What is said of a start whose angular velocity, or bias, is beyond its bound, rad/s."""
    about, most = np.rad2deg(np.linalg.norm(start.vector)), np.rad2deg(bound)
    if isinstance(configuration.flow, GyroFlow):
        return (
            "start.rate_rad_per_s (with P) and flow.bias_deg_per_s have nothing in common, one of them is wrong: the "
            f"start's bias is about {about:.4g} deg/s from flow.known_bias_deg_per_s, and the bound, with the drift, "
            f"is {most:.4g} deg/s"
        )
    return (
        "start.rate_rad_per_s (with P) and flow.largest_rate_deg_per_s have nothing in common, one of them is wrong: "
        f"the start turns by about {about:.4g} deg/s, and the bound is {most:.4g} deg/s"
    )


def run_filter(
    given: FilterInput,
    start: elliptude.StateEllipsoid | None,
    configuration: Configuration,
    vertical: FloatArray | None,
) -> GuaranteedLog:
    """One pass of the guaranteed filter.

    Parameters
    ----------
    given : FilterInput
    start : StateEllipsoid, optional
        Holds the state at the first row; nothing is known if left out.
    configuration : Configuration
        Says what is minimised, and what happens to what contradicts.
    vertical : (3,) array, optional
        Up in reference axes.

    Returns
    -------
    GuaranteedLog

    Raises
    ------
    InconsistentMeasurement, ValueError
        As `GuaranteedFilter.run`.
    """
    attitude_filter = filter_of(given, start, configuration)
    arguments: dict[str, Any] = given.measured | {"sensors": given.sensors or None, "vertical": vertical}
    if given.turns is None:
        return attitude_filter.run(given.times, **(arguments | given.motion))
    turns = given.turns
    return attitude_filter.run_turns(given.times, turns.vectors, turns.angles, anchors=turns.anchors, **arguments)
