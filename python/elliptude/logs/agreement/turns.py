"""Whether directions turn as the rate says.

A direction that stands still in the reference frame turns in the body by ḃ = b × ω, so over a short turn φ = ∫ω dt its
change is b̄ × φ, b̄ the mean of both ends. The slope of the measured changes on these says what the gyro's numbers must
be multiplied by: 1, or π/180 where degrees were declared as radians. A reference attitude C turns by C₁ᵀC₂ = exp(S(φ)).
A log that does not turn shows nothing, and neither does one in which the gyro's error alone may be what it shows. With
a bias β the change is b̄ × (φ - hβ) over a step h, so that the slope is sought beside three more unknowns.
"""

import math
from typing import Literal

import numpy as np

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings.finding import Finding, Name, Severity
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer
from elliptude.logs.agreement.wrong_units import FACTORS, like, of_rates, unit_of_rates
from elliptude.logs.axes.stated import Stated
from elliptude.logs.log import Log
from elliptude.logs.quaternion_readings import FEWEST_PAIRS, LARGEST_TURN, LEAST, MOST, STANDARD_ERROR, slope
from elliptude.typing import FloatArray

_PAIRS = 50_000
# rad; a direction that moves so far in the body shows a turn, whatever its noise.
_CLEAR_TURN = 0.35
# rad; a reference that moves by more is not used.
_STILL = 0.02
# rad/s; a gyro at rest may show this much (datasheets of small ones: 5 deg/s).
_LARGEST_BIAS = np.radians(5.0)
_LEFT_BY_ROUNDING = 1e-9
# A slope that no scale error and no bias makes of 1.
_FAR_FROM_ONE = 2.0
# Relative scatter of an accelerometer's length about its median, below which it shows gravity alone.
_GRAVITY_ALONE = 0.03


class WrongUnit(Finding):
    """One that only the unit of the rate, or of time, explains."""


def stuck_gyro(log: Log, configuration: Configuration, stated: Stated) -> Finding | None:
    """Whether the rate is the same in all rows of a body that turns otherwise."""
    if log.rates is None:
        return None
    shown = log.rates[np.isfinite(log.rates[:, 0])]
    if len(shown) < 2 or (shown != shown[0]).any():
        return None
    name, _ = of_rates(configuration)
    for i, sensor in enumerate(configuration.directions):
        vectors = log.directions[np.isfinite(log.directions[:, i, 0]), i]
        if not len(vectors):
            continue
        unit = unit_vectors(vectors)
        turned = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(unit - unit[0], axis=1), 0.0, 1.0))
        if np.mean(turned > _CLEAR_TURN) > 0.05:
            turns = f" turns by up to {np.rad2deg(turned.max()):.0f} degrees"
            what = "the same" if shown.any() else "0"
            severity: Severity = "error" if stated.quotient(log, sensor.name) > 1.0 else "warning"
            said = f"{what} in all of {len(shown)} rows, though ", Name(sensor.name), f"{turns}: is it off?"
            return Finding(severity, name, said)
    return None


class Turns:
    """How far the measured rates turn from one time to another, as a vector: for small turns.

    Parameters
    ----------
    log : Log
    configuration : Configuration
        What it states of the rates counts as their error.
    """

    def __init__(self, log: Log, configuration: Configuration) -> None:
        known = np.zeros(len(log.times), bool) if log.rates is None else np.isfinite(log.rates[:, 0])
        self.is_known = bool(known.sum() > FEWEST_PAIRS)
        if self.is_known and log.rates is not None:
            self._times, rates = log.times[known], log.rates[known]
            steps = np.diff(self._times)
            in_steps = 0.5 * (rates[1:] + rates[:-1]) * steps[:, None]
            self._sums = np.concatenate([np.zeros((1, 3)), np.cumsum(in_steps, axis=0)])
            errors = _rate_errors(self._times, rates, configuration)
            self._errors = np.concatenate([[0.0], np.cumsum(0.5 * (errors[1:] + errors[:-1]) * steps)])

    def between(self, begins: FloatArray, ends: FloatArray) -> FloatArray:
        """Shape (n, 3), rad."""
        return self._until(ends) - self._until(begins)

    def share_of_error(self, begins: FloatArray, ends: FloatArray) -> float:
        """By how much a slope on these turns may differ from 1 because of the rates' errors.

        With p = φ + n, n an error of at most N, changes that fit φ have the slope 1 - ⟨n, p⟩/⟨p, p⟩ on p, which is
        within ‖N‖/‖p‖ of 1 by Cauchy and Schwarz.
        """
        turns = self.between(begins, ends)
        power = float((turns**2).sum())
        if power == 0.0:
            return np.inf
        stated = np.interp(ends, self._times, self._errors) - np.interp(begins, self._times, self._errors)
        return math.sqrt(float((stated**2).sum()) / power)

    def _until(self, times: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(times, self._times, column) for column in self._sums.T])


def _rate_errors(times: FloatArray, rates: FloatArray, configuration: Configuration) -> FloatArray:
    """Bounds of the rates' errors as they stand in the log, rad/s, shape (N,)."""
    flow, speeds, since = configuration.flow, np.linalg.norm(rates, axis=1), times - times[0]
    if not isinstance(flow, GyroFlow):
        assert configuration.rate is not None  # whose rates these are
        return np.full_like(speeds, math.sqrt(float(np.linalg.eigvalsh(configuration.rate.bound())[-1])))
    if configuration.rule is not None:
        rule = configuration.calibrated_rule()
        errors: FloatArray = rule.gyro.bounds().rate_error(speeds, since) + math.radians(rule.rest.rate_deg_per_s)
        return errors
    between = flow.off_the_line(float(np.median(np.diff(times))))
    known_bias = float(np.linalg.norm(flow.known_bias()))
    return np.asarray(flow.bounds().rate_error(speeds, since) + between + known_bias)


def gyro_against_direction(
    log: Log, turns: Turns, i: int, configuration: Configuration
) -> Finding | Literal["confirmed", "unknown"]:
    """What the changes of a direction say of the rates: that they fit, nothing, or what is wrong."""
    sensor = configuration.directions[i]
    name = sensor.name
    there = np.flatnonzero(np.isfinite(log.directions[:, i, 0]))
    is_accelerometer = isinstance(sensor, Accelerometer)
    if is_accelerometer and len(there):
        # If it shows more than gravity, its direction does not stand still.
        lengths = np.linalg.norm(log.directions[there, i], axis=1)
        there = there[np.abs(lengths / np.median(lengths) - 1.0) < _GRAVITY_ALONE]
    if not turns.is_known or len(there) <= FEWEST_PAIRS:
        return "unknown"
    references = unit_vectors(log.references[there, i])
    if np.linalg.norm(references - references[0], axis=1).max() > _STILL:
        return "unknown"
    directions = unit_vectors(log.directions[there, i])
    chosen = spread_rows(len(there) - 1)
    before, after = directions[chosen], directions[chosen + 1]
    begins, ends = log.times[there[chosen]], log.times[there[chosen + 1]]
    turn = turns.between(begins, ends)
    middles = 0.5 * (before + after)
    changes, predicted = after - before, np.cross(middles, turn)
    sizes = np.linalg.norm(turn, axis=1)

    def times_as_far(factor: float) -> tuple[float, float]:
        small = factor * sizes < LARGEST_TURN
        if small.mean() < 0.9 or small.sum() < FEWEST_PAIRS:
            return 0.0, np.inf
        return slope(changes[small], factor * predicted[small])

    value, error = times_as_far(1.0)
    if error < STANDARD_ERROR and LEAST <= value <= MOST:
        return "confirmed"
    if (sizes < LARGEST_TURN).all():
        beside = _beside_bias(changes, predicted, middles * (ends - begins)[:, None])
        if beside is not None:
            return beside
    for factor in FACTORS:
        other, other_error = times_as_far(factor)
        if other_error < STANDARD_ERROR and LEAST <= other <= MOST:
            what = f"turns {factor * other:.3g} times as far as the rate says"
            return WrongUnit("error", name, (f"{what}, ", like(factor, configuration)))
    if (sizes < LARGEST_TURN).all() and getattr(configuration.flow, "unit", "") == "rad/s":
        mean = float(np.linalg.norm(turn.sum(axis=0)) / (ends - begins).sum())
        if said := _at_rest_in_degrees(changes, predicted, middles * (ends - begins)[:, None], mean):
            return WrongUnit("error", name, (said, unit_of_rates(configuration, "deg/s")))
    if value > _FAR_FROM_ONE and error < STANDARD_ERROR * value:
        # Stamps so close that noise is large beside a step's turn; of a large slope it is little.
        why = "as if its stamps were as many times too near: are the units of time and of the gyro right, or the rate?"
        return Finding("warning", name, f"turns {value:.2g} times as far as the rate says, {why}")
    if error >= STANDARD_ERROR:
        return "unknown"
    severity: Severity = "warning" if is_accelerometer else "error"
    # Errors of the rate bring the slope nearer to 0, and do not turn it round.
    if -MOST <= value <= -LEAST:
        return Finding(severity, name, f"turns {value:.3g} times as far as the rate says, as with a wrong sign")
    if abs(value - 1.0) <= turns.share_of_error(begins, ends):
        return "unknown"
    if abs(value) < 0.1:
        return Finding(severity, name, f"does not turn ({value:.2g} times) as the rate says: units or axes do not fit")
    return Finding("warning", name, f"turns {value:.2g} times as far as the rate says: are units and axes right?")


def _at_rest_in_degrees(changes: FloatArray, predicted: FloatArray, lasting: FloatArray, mean: float) -> str:
    """What is said of a mean rate, rad/s, that is too large for a bias and would be one in deg/s; else empty."""
    if mean <= _LARGEST_BIAS or _beside_bias(changes, math.pi / 180.0 * predicted, lasting) is None:
        return ""
    return (
        f"does not turn as the rate says, {math.degrees(mean):.3g} deg/s in the mean; in deg/s that would be "
        f"{mean:.3g} deg/s, as a bias may be: "
    )


def _beside_bias(
    changes: FloatArray, predicted: FloatArray, lasting: FloatArray
) -> Literal["confirmed", "unknown"] | None:
    """What changes of a direction say of the gyro's scale if it may have a bias; None if no bias explains them.

    ``lasting`` are directions times steps: a bias β takes these × β from what is predicted.
    """
    pushes = np.stack([-np.cross(lasting, axis) for axis in np.eye(3)], axis=-1).reshape(-1, 3)
    # About a direction that hardly moves in the body, the bias along it is noise.
    to_bias = np.linalg.pinv(pushes, rcond=0.1)
    beside = [values - (pushes @ (to_bias @ values.ravel())).reshape(-1, 3) for values in (changes, predicted)]
    # Where a bias could be the rate, only rounding is left of it.
    is_left = np.linalg.norm(beside[1]) > _LEFT_BY_ROUNDING * np.linalg.norm(predicted)
    value, error = slope(*beside) if is_left else (0.0, np.inf)
    if error < STANDARD_ERROR:
        return "confirmed" if LEAST <= value <= MOST else None
    if value > MOST and error < STANDARD_ERROR * value:
        return None  # of a scale of 57 an error of 0.4 is little, and no bias makes 1 of it
    bias = to_bias @ (changes - predicted).ravel()
    return "unknown" if float(np.linalg.norm(bias)) <= _LARGEST_BIAS else None


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) of length 1."""
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def spread_rows(count: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Indices spread over all rows, at most as many as are needed."""
    return np.unique(np.linspace(0, count - 1, min(count, _PAIRS)).astype(np.intp))
