"""Runs the guaranteed filter over a log: directions with an angle per row, flow, anchors, claims, what was dropped."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

import elliptude
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.turns import coning_angles, lengths_of
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import GivenStart
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation import gaps
from elliptude.estimation.direction_rows import Contradiction, DirectionRows, direction_rows
from elliptude.estimation.gaps import Gap
from elliptude.estimation.vertical import Turns, Vertical, contradictions_of_up, followed, vertical_of
from elliptude.logs.log import Log, interval_rates
from elliptude.results import CLAIMS, DirectionLog, GuaranteedLog
from elliptude.typing import FloatArray

CONDITIONAL = CLAIMS.index("conditional")

# rad/s: if the bias counts as noise, the state's bias is zero, and this is as good.
_NO_BIAS = 1e-9
# rad; a bound this near to half a turn says next to nothing.
_NEXT_TO_NOTHING = 0.75 * np.pi
# s; how often a prediction of the vertical begins anew where the configuration does not say.
_ANCHOR = 1.0
# Rounding of an integrated turn, rad: this for each step, and for each radian that the steps turn.
_ROUNDING = 32.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class FilterInput:
    """What a pass of the guaranteed filter over N rows is given: when, how the body moves, what was measured."""

    times: FloatArray
    """s, shape (N,)."""
    flow: elliptude.GuaranteedRigidBodyFlow | elliptude.GuaranteedGyroFlow
    motion: dict[str, FloatArray]
    """Row by row, shape (N, 3) each: `gyro` acts from its row on, `control_torque` and `wheel_momentum` until it.

    What a momentum was before, in the interval that ends at its row, is in the flow's unknown torque.
    """
    measured: dict[str, Any]
    """Arguments of `GuaranteedFilter.run` that are measurements."""
    sensors: tuple[str, ...]
    """Their names."""
    vector_bound: float | None = None
    """Bound of the gyro's bias, or of a body's angular velocity, rad/s."""
    estimates_vector: bool = True
    turns: Turns | None = None
    """If each row is predicted from an anchor, by a turn."""


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
    start, starts_heading = _start(log, configuration, rows)
    turns = turns_of(log.times, log.rates, configuration, rows)
    given = _filter_input(log, configuration, rows, turns)
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


def _anchor_duration(configuration: Configuration) -> float | None:
    if configuration.rule is not None:
        return configuration.rule.anchor_s
    return configuration.flow.anchor_s if isinstance(configuration.flow, GyroFlow) else None


def _start(log: Log, configuration: Configuration, rows: DirectionRows) -> tuple[elliptude.StateEllipsoid | None, bool]:
    """The set at the first row, if one is given or follows; and whether the heading counts from there."""
    given = configuration.start
    if isinstance(given, GivenStart):
        flow = configuration.flow
        if not isinstance(flow, GyroFlow):
            return given.build(), False
        known = flow.known_bias()
        start = given.build(known)
        if flow.estimate_bias:  # the filter's state is what is left of it
            return elliptude.StateEllipsoid(start.attitude, start.vector - known, start.shape), False
        if given.rate_rad_per_s is not None and (start.vector.any() or known.any()):
            raise ValueError(
                "start.rate_rad_per_s: the bias is not estimated; flow.known_bias_deg_per_s is what is known of it, "
                "so leave it out"
            )
        return _without_bias(start.attitude, start.shape[:3, :3]), False
    heading_is_measured = any(
        np.isfinite(rows.angles[:, i]).any() for i in range(len(rows.names)) if i != rows.up_column
    )
    if configuration.rule is None or heading_is_measured:
        return None, False
    # Nothing determines the heading: it counts from the first row, by a turn about the reference frame's vertical that
    # makes the error of the first attitude perpendicular to up. Theory, section 18.6.
    up, angle = rows.directions[0, 0], float(rows.angles[0, 0])
    if not angle < np.pi:
        return None, False
    return _without_bias(_shortest_turn_to_vertical(up), _disc(up, angle)), True


def _disc(normal: FloatArray, radius: float) -> FloatArray:
    """A shape (3, 3) that holds a disc, nowhere so thin that rounding makes it indefinite; section 18.6."""
    # By rounding it may be flat within 16ε of its size, and the attitude across it off by 1e-14 rad.
    epsilon = float(np.finfo(np.float64).eps)
    thickness = 64.0 * epsilon * radius**2 + _NO_BIAS**2
    shape: FloatArray = (1.0 + 1e-9) * (radius**2 * (np.eye(3) - np.outer(normal, normal)) + thickness * np.eye(3))
    return shape


def _without_bias(attitude: FloatArray, attitude_shape: FloatArray) -> elliptude.StateEllipsoid:
    shape = _NO_BIAS**2 * np.eye(6)
    shape[:3, :3] += attitude_shape
    return elliptude.StateEllipsoid(attitude, np.zeros(3), shape)


def _shortest_turn_to_vertical(up: FloatArray) -> FloatArray:
    """The attitude (3, 3) that takes a unit vector in body axes to the third reference axis."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if up[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    turn = scipy.spatial.transform.Rotation.from_rotvec(np.arctan2(sine, up[2]) / sine * axis)
    return np.asarray(turn.as_matrix(), dtype=np.float64)


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


def gyro_flow(gyro: GyroBounds, flow: GyroFlow) -> elliptude.GuaranteedGyroFlow:
    """The core's flow from bounds of a gyro, (18.9): the part that does not grow with the rate, and the part that does.

    Parameters
    ----------
    gyro : GyroBounds
    flow : GyroFlow
        Says whether the bias is estimated, and how the rate behaves between samples.

    Returns
    -------
    GuaranteedGyroFlow
    """
    k = gyro.scale_error
    constant = (gyro.noise + k * gyro.bias) if flow.estimate_bias else gyro.noise + gyro.bias
    return elliptude.GuaranteedGyroFlow(
        constant / (1.0 - k),
        gyro.drift if flow.estimate_bias else 0.0,
        scale=k / (1.0 - k),
        angular_acceleration=np.deg2rad(flow.angular_acceleration_deg_per_s2),
        interval_rate=flow.interval_rate,
        largest_rate=gyro.largest_rate if np.isfinite(gyro.largest_rate) else None,
    )


def _filter_input(log: Log, configuration: Configuration, rows: DirectionRows, turns: Turns | None) -> FilterInput:
    """What the filter is given of a log."""
    flow = configuration.flow
    measured: dict[str, Any] = {}
    if len(rows.names):
        measured = {"directions": rows.directions, "reference": rows.references, "bounds": rows.angles}
    if not isinstance(flow, GyroFlow):
        names = rows.names
        motion = {}
        if configuration.rate is not None:
            _require_rates_of_rows(log)
            measured |= {"angular_velocity": log.rates, "rate_bound": configuration.rate.bound()}
            names = (*names, "rate")
        if log.control_torques is not None:
            motion["control_torque"] = log.control_torques
        if log.wheel_momenta is not None:
            motion["wheel_momentum"] = log.wheel_momenta
        largest = flow.largest_rate_deg_per_s
        bound = None if largest is None else float(np.deg2rad(largest))
        body = flow.guaranteed(_torque_of_wheels(log, bound), log.origin)
        return FilterInput(log.times, body, motion, measured, names, bound)
    assert log.rates is not None
    assert rows.gyro is not None
    if _anchor_duration(configuration) is not None:
        # Each row from its anchor in one prediction, so that errors of the gyro that cancel do; theory, section 18.6.
        measured["bounds"] = np.where(rows.angles < _NEXT_TO_NOTHING, rows.angles, np.nan)
        return FilterInput(
            log.times,
            gyro_flow(rows.gyro, flow),
            {},
            measured,
            rows.names,
            _NO_BIAS,
            estimates_vector=False,
            turns=turns,
        )
    gyro = rows.gyro
    largest_bias = gyro.bias + gyro.drift * float(log.times[-1] - log.times[0])
    between = gaps.filled_in_between(log, gyro.longest_interval)
    off = flow.off_the_line(between, gyro.drift if flow.estimate_bias else 0.0)
    off += _coning_rate(log, rows, flow, largest_bias)
    gyro = replace(gyro.with_more_noise(off), bias=largest_bias)
    return FilterInput(
        log.times,
        gyro_flow(gyro, flow),
        {"gyro": used_rates(log, flow, rows)},
        measured,
        rows.names,
        largest_bias if flow.estimate_bias else _NO_BIAS,
        estimates_vector=configuration.estimates_vector,
    )


def _require_rates_of_rows(log: Log) -> None:
    """Refuse rates at other times than their rows: torques may change a rate by any amount in between."""
    if (sampled := log.rate_sampled) is not None:
        moved = float(np.abs(sampled - log.times).max())
        raise ValueError(
            f"rate: timing.same_within_s moves its stamps by up to {moved:.3g} s, and torques may change the rate by "
            "any amount meanwhile: state less, so that each stamp has a row"
        )


def _torque_of_wheels(log: Log, largest_rate: float | None) -> float:
    """The torque of wheels whose momentum changes within intervals, beside that of each row's, N m; section 17.5."""
    if log.wheel_momenta is None:
        return 0.0
    change = float(lengths_of(np.diff(log.wheel_momenta, axis=0)).max(initial=0.0))
    if change == 0.0:
        return 0.0
    changes = f"the momentum changes, by up to {change:.3g} N m s from one row to the next"
    needs = f"flow.wheel_momentum_columns: {changes}; it needs"
    if log.control_torques is None:
        raise ValueError(
            f"{needs} flow.control_torque_columns, as the motors turn the body the other way: what they take from the "
            "wheels' momentum in a second is a control torque"
        )
    if largest_rate is None:
        raise ValueError(
            f"{needs} flow.largest_rate_deg_per_s, as what is between the two values turns the body by a torque of up "
            "to that times the change"
        )
    return (1.0 + 8.0 * float(np.finfo(np.float64).eps)) * largest_rate * change


def _coning_rate(log: Log, rows: DirectionRows, flow: GyroFlow, bias: float) -> float:
    """What a rate on lines turns beside its mean in a step, at most, in any step that its bounds cover, (18.49), rad/s.

    A stated angular acceleration bounds all of what the rate does between samples.
    """
    if flow.interval_rate != "mean_of_ends" or flow.angular_acceleration_deg_per_s2 > 0.0 or len(log.times) < 2:
        return 0.0
    assert log.rates is not None
    assert rows.gyro is not None
    steps, rates = np.diff(log.times), log.rates - rows.bias
    # The bias is another one in each set: it changes the product of the rates by its own with their difference.
    changes = lengths_of(np.diff(rates, axis=0))
    angles = coning_angles(steps, rates) + steps**2 / 12.0 * bias * changes * (1.0 + 0.125 * steps * changes)
    within = ~rows.gyro.gaps(log.times, rates)
    # A scale's error makes the true rate up to 1/(1 - k) times as long, and what it turns the cube of that; `gyro_flow`
    # divides by 1 - k once.
    return float((angles / steps)[within].max(initial=0.0)) / (1.0 - rows.gyro.scale_error) ** 2


def used_rates(log: Log, flow: GyroFlow, rows: DirectionRows) -> FloatArray:
    """The rate that acts from each row of a log on, the known bias subtracted.

    Parameters
    ----------
    log : Log
        Without rates that were filled in within gaps.
    flow : GyroFlow
    rows : DirectionRows
        With what is known of the gyro.

    Returns
    -------
    (N, 3) array
        rad/s; NaN in gaps.
    """
    assert log.rates is not None
    assert rows.gyro is not None
    rates = log.rates - rows.bias
    used = interval_rates(rates) if flow.interval_rate == "mean_of_ends" else rates.copy()
    used[:-1][rows.gyro.gaps(log.times, rates)] = np.nan
    used[np.isnan(used).any(axis=1)] = np.nan
    return used


def turns_of(
    times: FloatArray,
    rates: FloatArray | None,
    configuration: Configuration,
    rows: DirectionRows,
    elapsed: FloatArray | None = None,
) -> Turns | None:
    """Each row's turn from its anchor, and how far it may be off.

    Parameters
    ----------
    times : (N,) array
        s, increasing.
    rates : (N, 3) array, optional
        Measured, rad/s.
    configuration : Configuration
    rows : DirectionRows
        With what is known of the gyro.
    elapsed : (N,) array, optional
        As in `GyroBounds.anchored_turns`.

    Returns
    -------
    Turns or None
        None without a gyro's rate on lines.
    """
    flow, gyro, duration = configuration.flow, rows.gyro, _anchor_duration(configuration)
    if not isinstance(flow, GyroFlow) or flow.interval_rate != "mean_of_ends":
        return None
    assert rates is not None
    assert gyro is not None
    if flow.angular_acceleration_deg_per_s2 > 0.0:
        # What the rate does between samples is not part of the noise, nor of its integral.
        off = flow.off_the_line(gyro.longest_interval)
        gyro = gyro.with_more_noise(off)
    measured = (rows.angles < _NEXT_TO_NOTHING).any(axis=1)
    turns = gyro.anchored_turns(times, rates - rows.bias, _ANCHOR if duration is None else duration, elapsed, measured)
    anchors = turns.anchors.copy()
    anchors[0] = -1
    spans = times - times[turns.anchors]
    steps = np.arange(len(times)) - turns.anchors
    return Turns(anchors, turns.rates * spans[:, None], turns.angles + _ROUNDING * (steps + turns.turned))


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
