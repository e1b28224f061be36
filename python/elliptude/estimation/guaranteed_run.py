"""Runs the guaranteed filter over a log: directions with an angle per row, flow, anchors, claims, what was dropped."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import elliptude
from elliptude.bounds.gyro import GyroBounds
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import GivenStart
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation import gaps
from elliptude.estimation.direction_rows import Contradiction, DirectionRows, direction_rows
from elliptude.estimation.gaps import Gap
from elliptude.estimation.vertical import Turns, Vertical, followed, vertical_of
from elliptude.logs.log import Log, interval_rates
from elliptude.results import CLAIMS, GuaranteedLog
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
class GuaranteedRun:
    """One pass of the guaranteed filter over a log, with its sets and claims."""

    log: Log
    """What it is of."""
    sets: GuaranteedLog
    """The sets. Claims are at most conditional if anything in the log contradicts its own stated bounds."""
    rows: DirectionRows
    vertical: Vertical | None
    """Up in body axes with its bound and claim, also where no attitude is known; None if nothing says where up is."""
    starts_heading: bool
    """Whether the heading counts from the first row, because nothing else determines it."""
    gaps: tuple[Gap, ...] = ()
    """Gaps of the gyro, which its error bounds do not cover."""

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
    anchor = _anchor_duration(configuration)
    turns = _turns(log, configuration, rows, anchor)
    if anchor is None:
        guaranteed = _run(log, configuration, rows, start)
    else:
        assert turns is not None
        guaranteed = _run_from_anchors(log, configuration, rows, start, turns)
    if rows.contradictions:
        claims = guaranteed.claims.copy()
        claims[claims < CONDITIONAL] = CONDITIONAL
        guaranteed = replace(guaranteed, claims=claims)
    return GuaranteedRun(
        log=measured,
        sets=guaranteed,
        rows=rows,
        vertical=vertical_of(guaranteed, followed(configuration, rows, turns), rows.up),
        starts_heading=starts_heading,
        gaps=()
        if not isinstance(configuration.flow, GyroFlow) or rows.gyro is None
        else gaps.gaps_of(log, rows.gyro.longest_interval, rows.gyro.largest_rate, guaranteed),
    )


def _anchor_duration(configuration: Configuration) -> float | None:
    if configuration.rule is not None:
        return configuration.rule.anchor_s
    return configuration.flow.anchor_s if isinstance(configuration.flow, GyroFlow) else None


def _start(log: Log, configuration: Configuration, rows: DirectionRows) -> tuple[elliptude.StateEllipsoid | None, bool]:
    """The set at the first row, if one is given or follows; and whether the heading counts from there."""
    given = configuration.start
    if isinstance(given, GivenStart):
        start = given.build()
        if not isinstance(configuration.flow, GyroFlow) or configuration.flow.estimate_bias:
            return start, False
        if np.any(start.vector):
            raise ValueError(
                "start.rate_rad_per_s: the bias is not estimated; flow.known_bias_deg_per_s is what is known of it"
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
    turn = Rotation.from_rotvec(np.arctan2(sine, up[2]) / sine * axis)
    return np.asarray(turn.as_matrix(), dtype=np.float64)


def turned_to_start(true_attitudes: FloatArray, run: GuaranteedRun) -> FloatArray:
    """True attitudes (N, 3, 3) with the heading counted from the first row, as in the run; NaN if that is not known."""
    up, estimated = run.rows.directions[0, 0], run.sets.attitudes[0]
    true_up = true_attitudes[0, 2]
    axis = np.cross(true_up, up)
    sine = float(np.linalg.norm(axis))
    turn = np.eye(3)
    if sine > 0.0:
        turn = Rotation.from_rotvec(np.arctan2(sine, true_up @ up) / sine * axis).as_matrix()
    turned: FloatArray = estimated @ turn @ true_attitudes[0].T @ true_attitudes
    return turned


def _filter(
    flow: elliptude.GuaranteedRigidBodyFlow | elliptude.GuaranteedGyroFlow,
    start: elliptude.StateEllipsoid | None,
    time: float,
    vector_bound: float | None,
    estimate_vector: bool,
    configuration: Configuration,
) -> elliptude.GuaranteedFilter:
    settings = configuration.estimator
    return elliptude.GuaranteedFilter(
        flow,
        start,
        time=time,
        criterion=settings.criterion,
        weight=settings.weight(),
        policy=settings.policy,
        most_wrong=settings.most_wrong,
        regain_after=settings.regain_after,
        vector_bound=vector_bound,
        estimate_vector=estimate_vector,
    )


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


def _off_the_line(flow: GyroFlow, interval: float) -> float:
    """How far a rate that is filled in may be off because of the motion between samples, rad/s; section 18.3."""
    share = 0.5 if flow.interval_rate == "mean_of_ends" else 1.0
    return share * float(np.deg2rad(flow.angular_acceleration_deg_per_s2)) * interval


def _run(
    log: Log, configuration: Configuration, rows: DirectionRows, start: elliptude.StateEllipsoid | None
) -> GuaranteedLog:
    """Predict each row from the one before."""
    flow = configuration.flow
    arguments: dict[str, Any] = {}
    vector_bound = None
    if len(rows.names):
        arguments |= {"directions": rows.directions, "reference": rows.references, "bounds": rows.angles}
    if isinstance(flow, GyroFlow):
        assert log.rates is not None
        assert rows.gyro is not None
        rates = log.rates - rows.bias
        gyro = rows.gyro
        largest_bias = gyro.bias + gyro.drift * float(log.times[-1] - log.times[0])
        vector_bound = largest_bias if flow.estimate_bias else _NO_BIAS
        between = gaps.filled_in_between(log, gyro.longest_interval)
        gyro = replace(gyro, bias=largest_bias, noise=gyro.noise + _off_the_line(flow, between))
        used = interval_rates(rates) if flow.interval_rate == "mean_of_ends" else rates.copy()
        used[:-1][gyro.gaps(log.times, rates)] = np.nan
        used[np.isnan(used).any(axis=1)] = np.nan
        arguments["gyro"] = used
        core: elliptude.GuaranteedRigidBodyFlow | elliptude.GuaranteedGyroFlow = gyro_flow(gyro, flow)
    else:
        core = flow.guaranteed()
        if configuration.rate is not None:
            arguments |= {"angular_velocity": log.rates, "rate_bound": configuration.rate.bound()}
        if log.control_torques is not None:
            arguments["control_torque"] = log.control_torques
        if log.wheel_momenta is not None:
            arguments["wheel_momentum"] = log.wheel_momenta
    attitude_filter = _filter(
        core, start, float(log.times[0]), vector_bound, configuration.estimates_vector, configuration
    )
    names = rows.names if isinstance(flow, GyroFlow) or configuration.rate is None else (*rows.names, "rate")
    return attitude_filter.run(log.times, sensors=names or None, vertical=rows.up, **arguments)


def _turns(log: Log, configuration: Configuration, rows: DirectionRows, duration: float | None) -> Turns | None:
    """Each row's turn from its anchor, and how far it may be off; None without a gyro's rate on lines."""
    flow, gyro = configuration.flow, rows.gyro
    if not isinstance(flow, GyroFlow) or flow.interval_rate != "mean_of_ends":
        return None
    assert log.rates is not None
    assert gyro is not None
    if flow.angular_acceleration_deg_per_s2 > 0.0:
        # What the rate does between samples is not part of the noise, nor of its integral.
        off = _off_the_line(flow, gyro.longest_interval)
        gyro = replace(gyro, noise=gyro.noise + off, increment=np.inf)
    turns = gyro.anchored_turns(log.times, log.rates - rows.bias, _ANCHOR if duration is None else duration)
    anchors = turns.anchors.copy()
    anchors[0] = -1
    spans = log.times - log.times[turns.anchors]
    steps = np.arange(len(log.times)) - turns.anchors
    return Turns(anchors, turns.rates * spans[:, None], turns.angles + _ROUNDING * (steps + turns.turned))


def _run_from_anchors(
    log: Log, configuration: Configuration, rows: DirectionRows, start: elliptude.StateEllipsoid | None, turns: Turns
) -> GuaranteedLog:
    """Each row from its anchor in one prediction, so that errors of the gyro that cancel do; theory, section 18.6."""
    assert isinstance(configuration.flow, GyroFlow)
    assert rows.gyro is not None
    attitude_filter = _filter(
        gyro_flow(rows.gyro, configuration.flow), start, float(log.times[0]), _NO_BIAS, False, configuration
    )
    return attitude_filter.run_turns(
        log.times,
        turns.vectors,
        turns.angles,
        anchors=turns.anchors,
        directions=rows.directions,
        reference=rows.references,
        bounds=np.where(rows.angles < _NEXT_TO_NOTHING, rows.angles, np.nan),
        sensors=rows.names,
        vertical=rows.up,
    )
