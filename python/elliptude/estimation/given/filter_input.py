"""What the guaranteed filter is given of a log: flow, rates or turns, and measurements."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import elliptude
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.turns import coning_angles, lengths_of
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation import gaps
from elliptude.estimation.direction_rows import DirectionRows
from elliptude.estimation.vertical import Turns
from elliptude.logs.log import Log, interval_rates
from elliptude.typing import FloatArray

NO_BIAS = 1e-9
"""rad/s: if the bias counts as noise, the state's bias is zero, and this is as good."""
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


def filter_input(log: Log, configuration: Configuration, rows: DirectionRows, turns: Turns | None) -> FilterInput:
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
            NO_BIAS,
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
        largest_bias if flow.estimate_bias else NO_BIAS,
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


def _anchor_duration(configuration: Configuration) -> float | None:
    if configuration.rule is not None:
        return configuration.rule.anchor_s
    return configuration.flow.anchor_s if isinstance(configuration.flow, GyroFlow) else None
