"""Checks whether sensors agree with one another: a unit, an order or an axis that is stated wrongly shows.

A direction that stands still in the reference frame turns in the body by ḃ = b × ω, so over a short turn φ = ∫ω dt its
change is b̄ × φ, b̄ the mean of both ends. The slope of the measured changes on these says what the gyro's numbers must
be multiplied by: 1, or π/180 where degrees were declared as radians. A reference attitude C turns by C₁ᵀC₂ = exp(S(φ)).
A log that does not turn shows nothing, and neither does one in which the gyro's error alone may be what it shows. With
a bias β the change is b̄ × (φ - hβ) over a step h, so that the slope is sought beside three more unknowns.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
import scipy

from elliptude import units
from elliptude.configuration import suspicions
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, AnyDirection, FieldBound, Magnetometer
from elliptude.io.files import FileError, sentence
from elliptude.logs.axes.axes_check import look_at_axes
from elliptude.logs.axes.stated import Stated
from elliptude.logs.body_at_rest import UpAtRest, up_in_log
from elliptude.logs.log import Log, joined
from elliptude.logs.quaternion_readings import (
    FEWEST_PAIRS,
    LARGEST_TURN,
    LEAST,
    MOST,
    STANDARD_ERROR,
    misread,
    readings_of,
    slope,
)
from elliptude.logs.signals.saturation import Saturation
from elliptude.logs.signals.silence import Stuck
from elliptude.typing import FloatArray

# T; the Earth's field at sea level.
WEAKEST_FIELD, STRONGEST_FIELD = 1e-6 * units.WEAKEST_FIELD_UT, 7.0e-5
_MICROTESLA = units.FIELD["uT"]
BLOCK_ROWS = 1 << 18
"""Rows of a long log that are checked together."""

Severity: TypeAlias = Literal["error", "warning"]

_PAIRS = 50_000
# rad; a direction that moves so far in the body shows a turn, whatever its noise.
_CLEAR_TURN = 0.35
# rad; a reference that moves by more is not used.
_STILL = 0.02
# rad/s; a gyro at rest may show this much (datasheets of small ones: 5 deg/s).
_LARGEST_BIAS = np.radians(5.0)
_LEFT_BY_ROUNDING = 1e-9
# Relative scatter of an accelerometer's length about its median, below which it shows gravity alone.
_GRAVITY_ALONE = 0.03
_FACTORS = {
    np.pi / 180.0: "as if its degrees were declared as radians",
    180.0 / np.pi: "as if its radians were declared as degrees",
    1e-3: "as if the unit of time (or of the gyro) were 1000 times smaller",
    1e3: "as if the unit of time (or of the gyro) were 1000 times larger",
    1e-6: "as if the unit of time (or of the gyro) were a million times smaller",
    1e-9: "as if the unit of time were a billion times smaller",
}


@dataclass(frozen=True)
class Finding:
    """A fault, or something that may be one."""

    severity: Severity
    sensor: str
    message: str

    def __str__(self) -> str:
        """The kind of finding, and its message."""
        return f"{self.sensor}: {self.message}" if self.sensor else self.message


class ImplausibleError(FileError):
    """What contradicts within a log, and what to do if it is right.

    Parameters
    ----------
    name : str
        Name of the log.
    errors : sequence of str
    """

    def __init__(self, name: str, errors: Sequence[str]) -> None:
        self.errors = tuple(errors)
        super().__init__(
            f"{name}: {sentence('; '.join(errors))} If it is right as it is, say implausible = 'ignore' in the "
            "configuration, or --ignore-implausible of estimate"
        )


class _WrongUnit(Finding):
    """One that only the unit of the rate, or of time, explains."""


@dataclass
class Heard:
    """What a check of a log found besides faults, for the reader of the results."""

    ignored: list[str] = field(default_factory=list)
    """Errors that ``implausible = "ignore"`` goes on regardless of."""
    notes: list[str] = field(default_factory=list)
    """The same as notes in a table."""
    up: UpAtRest | None = None
    """What was up in the first rest."""
    suspicious: list[str] = field(default_factory=list)
    """What may be wrong: sensors that do not fit one another, or that may have been at the end of their range; complete
    when all pieces are passed on."""


def plausible_pieces(
    pieces: Iterable[Log], configuration: Configuration, name: str, heard: Heard | None = None
) -> Iterator[Log]:
    """Pass the pieces of a log on after `contradictions` has checked them.

    A stated unit, order or axis holds for the whole log. So it is looked at in blocks, each before any of its rows is
    passed on, until one has moved enough to tell; a log of one block is looked at as a whole.

    Parameters
    ----------
    pieces : iterable of Log
    configuration : Configuration
        Its key ``implausible`` may say to go on regardless.
    name : str
        Name of the log, for messages.
    heard : Heard, optional
        Collects what is found.

    Yields
    ------
    Log
        The pieces.

    Raises
    ------
    ImplausibleError
        With all errors that were found, unless the configuration says to ignore them.
    """
    waiting: list[Log] = []
    heard = Heard() if heard is None else heard
    saturation, stuck, stated = Saturation(configuration), Stuck(configuration), Stated(configuration)
    is_told = False
    begin = end = None
    for piece in pieces:
        saturation.add(piece)
        stuck.add(piece)
        if len(piece.times):
            begin, end = piece.times[0] if begin is None else begin, piece.times[-1]
        if is_told:
            yield piece
            continue
        waiting.append(piece)
        if sum(len(part.times) for part in waiting) >= BLOCK_ROWS:
            is_told = _require_plausible(joined(waiting), configuration, stated, name, heard)
            yield from waiting
            waiting = []
    if waiting:
        _require_plausible(joined(waiting), configuration, stated, name, heard)
        yield from waiting
    heard.suspicious += saturation.said()
    heard.suspicious += [f"{sensor}: {said}" for sensor, said in stuck.said()]
    if begin is not None and end is not None:
        heard.suspicious += map(str, suspicions.of_configured_duration(configuration, float(end - begin)))


def _require_plausible(log: Log, configuration: Configuration, stated: Stated, name: str, heard: Heard) -> bool:
    """Whether the log has moved enough, or no further check would help."""
    heard.up = heard.up or up_in_log(log, configuration)
    findings, is_told = _look(log, configuration, stated)
    errors = [str(finding) for finding in findings if finding.severity == "error"]
    # What an accelerometer shows beside gravity turns as it likes: `check` says it, and it means little.
    forces = {sensor.name for sensor in configuration.directions if isinstance(sensor, Accelerometer)}
    warnings = [str(one) for one in findings if one.severity == "warning" and one.sensor not in forces]
    heard.suspicious += [warning for warning in warnings if warning not in heard.suspicious]
    if not errors:
        return is_told
    if configuration.implausible == "refuse":
        raise ImplausibleError(name, errors)
    heard.ignored += errors
    heard.notes += [f"implausible, and gone on regardless: {error}" for error in errors]
    return True


def contradictions(log: Log, configuration: Configuration) -> list[Finding]:
    """Check the units, orders and axes of a log's sensors against one another.

    Parameters
    ----------
    log : Log
    configuration : Configuration

    Returns
    -------
    list of Finding
    """
    return _look(log, configuration, Stated(configuration))[0]


def _look(log: Log, configuration: Configuration, stated: Stated) -> tuple[list[Finding], bool]:
    """What was found, and whether the log has moved enough to check its directions and rates.

    Slopes and choices of axes suggest what is wrong; an error is only what a proof stands beside: means of the
    direction that differ by more than all that is stated allows.
    """
    stated.rates(log)  # in the first piece of a recording the bias is known
    turns = _Turns(log, configuration)
    by_direction = [_gyro_against_direction(log, turns, i, sensor) for i, sensor in enumerate(configuration.directions)]
    found = [_if_sure(finding, log, stated) for finding in by_direction if isinstance(finding, Finding)]
    is_confirmed = "confirmed" in by_direction
    of_unit: list[Finding] = [finding for finding in found if isinstance(finding, _WrongUnit)]
    # One that confirms the rate is enough: the others are at fault themselves, or do not stand still in the reference.
    if is_confirmed:
        found = [replace(finding, severity="warning") for finding in found]
    elif of_unit:
        # A rate of another size explains all else that does not turn as it says; axes tried against it show nothing.
        return of_unit + _fields_in_other_units(log, configuration), False
    if not is_confirmed and (stuck := _stuck_gyro(log, configuration, stated)) is not None:
        return [stuck, *_fields_in_other_units(log, configuration)], False
    axes = look_at_axes(log, configuration, stated)
    if axes.wrong:
        # What is sure, with what would be right, comes before what a slope only suggests.
        named = {wrong.sensor for wrong in axes.wrong}
        found = [] if named & {"the gyro", "rate"} else [finding for finding in found if finding.sensor not in named]
        found += [Finding("error" if wrong.is_sure else "warning", wrong.sensor, wrong.message) for wrong in axes.wrong]
    found += _fields_in_other_units(log, configuration)
    if not any(finding.severity == "error" for finding in found):
        attitude = _reference_attitude(log, turns, configuration, stated)
        found += [attitude] if attitude is not None else []
    return found, is_confirmed and axes.is_told


def units_of_field(strength: float, sensor: Magnetometer) -> list[str]:
    """The units in which a magnetometer's numbers would be the Earth's field; its strength is as stated, T."""
    fields = {unit: strength / sensor.tesla * size for unit, size in units.FIELD.items()}
    return [unit for unit, size in fields.items() if WEAKEST_FIELD <= size <= STRONGEST_FIELD]


def field_in_another_unit(strength: float, sensor: Magnetometer) -> str:
    """What is said of a field (T) that is not the Earth's as stated, and would be in another unit; else empty."""
    fitting = " or ".join(units_of_field(strength, sensor))
    if sensor.unit == "normalized" or WEAKEST_FIELD <= strength <= STRONGEST_FIELD or not fitting:
        return ""
    shown = f"{strength / sensor.tesla:.4g} {sensor.unit}"
    return f"its median norm is {shown}, which is not the Earth's field; it would be in {fitting}"


def voids_statements(strength: float, sensor: AnyDirection, configuration: Configuration) -> bool:
    """Whether a field (T) is too strong in the stated unit and not in another: errors in µT then count too little.

    The sensor shows (I + K) x + e of a field x, which is the Earth's and what is beside it. So with all of that as
    large as is stated no sample is longer than (1 + k) (B + d) + ε, where the Earth's field B is at most 70 µT.
    """
    if not isinstance(sensor, Magnetometer) or not field_in_another_unit(strength, sensor):
        return False
    if configuration.rule is not None:
        rule = configuration.calibrated_rule().magnetometer
        if rule is None:
            return False
        own, beside = rule.sensor(), rule.disturbance_ut
    elif isinstance(sensor.bound_from, FieldBound):
        own, beside = configuration.sensor_bounds(sensor), sensor.bound_from.disturbance_ut
    else:
        return False
    strongest = (1.0 + own.scale_error) * (STRONGEST_FIELD / _MICROTESLA + beside) + own.error
    return strength > _MICROTESLA * strongest


def _fields_in_other_units(log: Log, configuration: Configuration) -> list[Finding]:
    found = []
    for i, sensor in enumerate(configuration.directions):
        strengths = np.linalg.norm(log.directions[:, i], axis=1)
        strengths = strengths[np.isfinite(strengths)]
        strength = float(np.median(strengths)) if len(strengths) else 0.0
        if isinstance(sensor, Magnetometer) and voids_statements(strength, sensor, configuration):
            what = field_in_another_unit(strength, sensor)
            message = f"{what}, and what is stated of its errors in µT counts too little"
            found.append(Finding("error", sensor.name, message))
    return found


def _if_sure(finding: Finding, log: Log, stated: Stated) -> Finding:
    """The finding, of a direction's name, and a mere warning unless what is stated rules out what the log shows."""
    if finding.severity == "warning" or stated.quotient(log, finding.sensor) > 1.0:
        return finding
    return replace(finding, severity="warning")


def _stuck_gyro(log: Log, configuration: Configuration, stated: Stated) -> Finding | None:
    """Whether the rate is the same in all rows of a body that turns otherwise."""
    if log.rates is None:
        return None
    shown = log.rates[np.isfinite(log.rates[:, 0])]
    if len(shown) < 2 or (shown != shown[0]).any():
        return None
    name = "the gyro" if isinstance(configuration.flow, GyroFlow) else "rate"
    for i, sensor in enumerate(configuration.directions):
        vectors = log.directions[np.isfinite(log.directions[:, i, 0]), i]
        if not len(vectors):
            continue
        unit = _unit(vectors)
        turned = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(unit - unit[0], axis=1), 0.0, 1.0))
        if np.mean(turned > _CLEAR_TURN) > 0.05:
            turns = f"{sensor.name!r} turns by up to {np.rad2deg(turned.max()):.0f} degrees"
            what = "the same" if shown.any() else "0"
            severity: Severity = "error" if stated.quotient(log, sensor.name) > 1.0 else "warning"
            return Finding(severity, name, f"{what} in all of {len(shown)} rows, though {turns}: is it off?")
    return None


class _Turns:
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


def _gyro_against_direction(
    log: Log, turns: _Turns, i: int, sensor: AnyDirection
) -> Finding | Literal["confirmed", "unknown"]:
    name = sensor.name
    there = np.flatnonzero(np.isfinite(log.directions[:, i, 0]))
    is_accelerometer = isinstance(sensor, Accelerometer)
    if is_accelerometer and len(there):
        # If it shows more than gravity, its direction does not stand still.
        lengths = np.linalg.norm(log.directions[there, i], axis=1)
        there = there[np.abs(lengths / np.median(lengths) - 1.0) < _GRAVITY_ALONE]
    if not turns.is_known or len(there) <= FEWEST_PAIRS:
        return "unknown"
    references = _unit(log.references[there, i])
    if np.linalg.norm(references - references[0], axis=1).max() > _STILL:
        return "unknown"
    directions = _unit(log.directions[there, i])
    chosen = _some(len(there) - 1)
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
    for factor, meaning in _FACTORS.items():
        other, other_error = times_as_far(factor)
        if other_error < STANDARD_ERROR and LEAST <= other <= MOST:
            return _WrongUnit("error", name, f"turns {factor * other:.3g} times as far as the rate says, {meaning}")
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


def _reference_attitude(log: Log, turns: _Turns, configuration: Configuration, stated: Stated) -> Finding | None:
    if configuration.truth is None or log.true_attitudes is None:
        return None
    there = np.flatnonzero(np.isfinite(log.true_attitudes[:, 0, 0]))
    if len(there) <= FEWEST_PAIRS:
        return None
    chosen = _some(len(there) - 1)
    first = scipy.spatial.transform.Rotation.from_matrix(log.true_attitudes[there[chosen]])
    second = scipy.spatial.transform.Rotation.from_matrix(log.true_attitudes[there[chosen + 1]])
    label = configuration.truth.label
    if turns.is_known:
        begins, ends = log.times[there[chosen]], log.times[there[chosen + 1]]
        turn = turns.between(begins, ends)
        found = misread(first, second, turn, readings_of(configuration.truth))
        if found is None:
            return None
        if found.fitting is None and abs(found.slope - 1.0) <= turns.share_of_error(begins, ends):
            return None
        what = f"turns {found.slope:.2g} times as far as the rate says"
        severity: Severity = "error" if stated.quotient_of_truth(log) > 1.0 else "warning"
        if found.fitting is not None:
            return Finding(severity, label, f"{what}, and as far when read {found.fitting}")
        for factor, meaning in _FACTORS.items():
            if LEAST <= found.slope / factor <= MOST:
                return Finding(severity, label, f"{what}: of the rate, {meaning}")
        return Finding("warning", label, f"{what}: are its order, its direction and the axes right?")
    return _reference_against_directions(log, configuration)


def _reference_against_directions(log: Log, configuration: Configuration) -> Finding | None:
    """Without a rate: whether the attitude takes measured directions to their references."""
    assert log.true_attitudes is not None
    assert configuration.truth is not None
    choices = readings_of(configuration.truth)
    angles: dict[str, list[FloatArray]] = {str(read): [] for read in choices}
    is_sure = False
    for i, sensor in enumerate(configuration.directions):
        there = np.flatnonzero(np.isfinite(log.directions[:, i, 0]) & np.isfinite(log.true_attitudes[:, 0, 0]))
        if len(there) <= FEWEST_PAIRS:
            continue
        there = there[_some(len(there))]
        rotations = scipy.spatial.transform.Rotation.from_matrix(log.true_attitudes[there])
        directions, references = _unit(log.directions[there, i]), _unit(log.references[there, i])
        for read in choices:
            cosines = (read(rotations).apply(directions) * references).sum(axis=1)
            angles[str(read)].append(np.rad2deg(np.arccos(np.clip(cosines, -1.0, 1.0))))
        away = _stated_angle_deg(sensor, configuration) + configuration.truth.error_deg
        is_sure |= float(np.median(angles["as declared"][-1])) > away
    if not angles["as declared"]:
        return None
    medians = {reading: float(np.median(np.concatenate(some))) for reading, some in angles.items()}
    declared = medians.pop("as declared")
    best = min(medians, key=lambda reading: medians[reading])
    what = f"takes the measured directions {declared:.3g} degrees off their references (median)"
    if declared > 20.0 and medians[best] < 0.25 * declared:
        severity: Severity = "error" if is_sure else "warning"
        return Finding(severity, configuration.truth.label, f"{what}, and {medians[best]:.3g} when read {best}")
    if declared > 60.0:
        return Finding("warning", configuration.truth.label, f"{what}: are frames, axes and signs right?")
    return None


def _stated_angle_deg(sensor: AnyDirection, configuration: Configuration) -> float:
    """How far each sample may be off its reference, degrees; infinite where that is not stated as an angle."""
    is_in_time = configuration.time_offset_of(sensor) == configuration.time_offset_of_truth == 0.0
    if configuration.rule is not None or not sensor.is_bound_by_angle or not is_in_time:
        return math.inf
    return math.degrees(math.sqrt(float(np.linalg.eigvalsh(sensor.bound())[-1])))


def _unit(vectors: FloatArray) -> FloatArray:
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def _some(count: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Indices spread over all rows, at most as many as are needed."""
    return np.unique(np.linspace(0, count - 1, min(count, _PAIRS)).astype(np.intp))
