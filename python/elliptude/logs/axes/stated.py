"""What is stated of gyro and directions, no more and no less: whether a log proves that it cannot all hold.

Means of a direction that the gyro carries along differ by no more than all that is stated allows, (18.16). A quotient
above 1 is a proof that something stated is wrong, and nothing else is: what a slope or a choice of axes suggests is
refused only with such a proof. Derivation: docs/theory.md, section 18.7.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from elliptude import units
from elliptude.bounds.gyro import GyroBounds, covered_interval
from elliptude.bounds.rest import mean_over_time
from elliptude.bounds.windows import MotionBounds
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import FirstMeasurementStart, GivenStart
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import after_rest, rest_at_start
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer
from elliptude.configuration.statements import AccelerationBound, FieldBound, RestPhase, VelocityWindowBound
from elliptude.logs.axes import sensor_axes
from elliptude.logs.axes.sensor_axes import AngleMisfit, RatesBeside, VectorStatement
from elliptude.logs.log import Log
from elliptude.typing import FloatArray

_MICROTESLA = units.FIELD["uT"]


@dataclass(frozen=True, eq=False)
class StatedRates:
    """The rates of a log, less what is known of their bias, and all that is stated of them."""

    rates: FloatArray
    """rad/s, shape (N, 3)."""
    gyro: GyroBounds
    beside: RatesBeside


class Stated:
    """What a configuration states of a gyro and of directions, and what logs of one recording prove of it.

    Parameters
    ----------
    configuration : Configuration
    """

    def __init__(self, configuration: Configuration) -> None:
        self._configuration = configuration
        self._began: float | None = None
        self._rest: tuple[FloatArray, GyroBounds] | None = None
        self._is_refused = False

    def rates(self, log: Log) -> StatedRates | None:
        """The rates of a log with their bounds; None where nothing is stated of what a body does between them.

        Of the pieces of a recording the first one must be looked at first: there its bias is known.
        """
        flow = self._configuration.flow
        if not isinstance(flow, GyroFlow) or log.rates is None:
            return None
        known = np.isfinite(log.rates).all(axis=1)
        samples = log.times[known] if log.gyro_times is None else log.gyro_times
        if known.sum() < 3 or len(samples) < 3:
            return None
        begin = float(log.times[0]) + log.origin
        is_first = self._began is None
        self._began = begin if self._began is None else self._began
        try:
            longest = covered_interval(samples, self._longest_interval())
            if is_first and self._configuration.rule is not None:
                self._rest = self._bias_at_rest(log)
        except ValueError:
            # No rest where a rule states one, or samples too far apart: the guaranteed mode refuses such a log.
            self._is_refused = self._configuration.estimator.mode == "guaranteed"
            return None
        if self._configuration.rule is not None:
            if self._rest is None:
                return None
            bias, bounds = self._rest
        else:
            bias, bounds = flow.known_bias(), self._gyro(flow, longest)
        # What drifted before this piece.
        bounds = replace(bounds, bias=bounds.bias + bounds.drift * abs(begin - self._began))
        rates = np.column_stack([np.interp(log.times, log.times[known], column[known]) for column in log.rates.T])
        gyro = replace(bounds, longest_window=self._longest_window())
        return StatedRates(rates - bias, gyro, _beside(log, rates, samples, longest, flow))

    def quotient(self, log: Log, name: str) -> float:
        """The largest difference of a direction's means over what is stated, (18.16); 0 where nothing is stated.

        Infinite if the log contradicts what is stated of its rest and of its samples' times.
        """
        found, i = self.rates(log), self._index(name)
        if found is None or i is None:
            return np.inf if self._is_refused else 0.0
        vectors, statement = self.vectors(log, i)
        quotients = sensor_axes.misfits(
            log.times, found.rates, vectors, found.gyro, statement, 1.0, beside=found.beside
        )
        return 0.0 if quotients is None else float(quotients[0])

    def quotient_of_truth(self, log: Log) -> float:
        """The same of the axes of the reference attitude, seen from the body; what is not stated of it is no error."""
        found, truth = self.rates(log), self._configuration.truth
        if found is None or truth is None or log.true_attitudes is None:
            return np.inf if self._is_refused else 0.0
        offset = self._configuration.time_offset_of_truth
        if (sampled := log.true_sampled) is not None:
            offset += float(np.abs(sampled - log.times).max())
        away = _chord(math.radians(truth.error_deg))
        statement = VectorStatement(lambda _: away, 0.0, 0.0, 0.0, offset, length=1.0)
        axes = [(log.true_attitudes[:, axis, :], statement) for axis in range(3)]
        tables = sensor_axes.misfits_of_all(log.times, found.rates, axes, found.gyro, beside=found.beside)
        return max(float(table[0]) if table is not None else 0.0 for table in tables)

    def angle_misfit(self, log: Log, first: str, second: str, angle: float, error: float) -> AngleMisfit | None:
        """How far the angle between two directions is from the stated one, (18.18)."""
        found, i, j = self.rates(log), self._index(first), self._index(second)
        if found is None or i is None or j is None:
            return None
        pair = self.vectors(log, i), self.vectors(log, j)
        return sensor_axes.angle_misfit(log.times, found.rates, *pair, found.gyro, angle, error, beside=found.beside)

    def vectors(self, log: Log, i: int) -> tuple[FloatArray, VectorStatement]:
        """The vectors of a direction in the unit of what is stated of them: m/s², µT, or 1 for an angle."""
        sensor = self._configuration.directions[i]
        offset = self._configuration.time_offset_of(sensor)
        if (sampled := log.sampled(i)) is not None:
            offset += float(np.abs(sampled - log.times).max())
        moved = _moves(log, i) + offset * sensor.reference_rate
        vectors = log.directions[:, i]
        if self._configuration.rule is None and sensor.is_bound_by_angle:
            angle = math.sqrt(float(np.linalg.eigvalsh(sensor.bound())[-1]))
            with np.errstate(invalid="ignore", divide="ignore"):
                vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
            away = _chord(angle) + moved
            return vectors, VectorStatement(lambda _: away, 0.0, 0.0, 0.0, offset, length=1.0)
        if isinstance(sensor, Accelerometer):
            samples = log.times[log.gyro_rows]
            longest = covered_interval(samples, self._longest_interval())
            return vectors, self._force(sensor, offset, moved, longest)
        assert isinstance(sensor, Magnetometer)
        statement = self._field(sensor, offset, moved, vectors / _MICROTESLA)
        if self._configuration.rule is None and moved == 0.0 and not isinstance(sensor.reference, RestPhase):
            # What the strength may be off by is among what the world adds.
            first = int(np.argmax(np.isfinite(log.references[:, i]).all(axis=1)))
            statement = replace(statement, length=float(np.linalg.norm(log.references[first, i])) / _MICROTESLA)
        return vectors / _MICROTESLA, statement

    # --- the gyro -----------------------------------------------------------------------------------------------------

    def _longest_interval(self) -> float | None:
        flow, rule = self._configuration.flow, self._configuration.rule
        if rule is not None:
            return rule.rule().gyro.longest_interval_s
        assert isinstance(flow, GyroFlow)
        return flow.longest_interval_s

    def _longest_window(self) -> float:
        """The longest window that is averaged over, or predicted over from an anchor, s; for that noise is stated."""
        flow, windows = self._configuration.flow, [0.0]
        assert isinstance(flow, GyroFlow)
        if (rule := self._configuration.rule) is not None:
            windows += rule.rule().motion.windows_s
        else:
            windows.append(flow.anchor_s or 0.0)
        for sensor in self._configuration.directions:
            if isinstance(sensor.bound_from, VelocityWindowBound):
                windows += sensor.bound_from.windows_s
        return max(windows) or np.inf

    def _gyro(self, flow: GyroFlow, longest: float) -> GyroBounds:
        bounds, start = flow.bounds(), self._configuration.start
        if flow.longest_interval_s is not None:
            bounds = replace(bounds, longest_interval=longest)
        if self._configuration.estimator.mode != "guaranteed":
            # There the bias is stated by the start.
            started = 0.0
            if isinstance(start, FirstMeasurementStart):
                started = math.radians(start.bias_bound_deg_per_s or 0.0)
            elif isinstance(start, GivenStart):
                given = start.build(flow.known_bias())
                off = np.linalg.norm(given.vector - flow.known_bias())
                started = float(off) + math.sqrt(float(np.linalg.eigvalsh(given.shape[3:, 3:])[-1]))
            bounds = replace(bounds, bias=bounds.bias + started)
        off_the_line = flow.off_the_line(longest)
        return bounds.with_more_noise(off_the_line) if off_the_line > 0.0 else bounds

    def _bias_at_rest(self, log: Log) -> tuple[FloatArray, GyroBounds]:
        """The bias by the rest at the start, and the bounds from there on; ValueError without a rest."""
        configuration = self._configuration
        rule, accelerometer = configuration.calibrated_rule(), configuration.accelerometer
        assert accelerometer is not None
        assert log.rates is not None
        rows = log.gyro_rows
        forces = log.directions[rows, configuration.directions.index(accelerometer)]
        longest = covered_interval(log.times[rows], rule.gyro.longest_interval_s)
        gyro = replace(rule.gyro_bounds(), longest_interval=longest)
        rest = rest_at_start(rule.rest, log.times[rows], log.rates[rows], forces, gyro)
        stamps = log.times[rows][rest]
        return mean_over_time(stamps, log.rates[rows][rest]), after_rest(gyro, stamps)

    # --- directions ---------------------------------------------------------------------------------------------------

    def _index(self, name: str) -> int | None:
        names = [sensor.name for sensor in self._configuration.directions]
        return names.index(name) if name in names else None

    def _force(self, sensor: Accelerometer, offset: float, moved: float, longest: float) -> VectorStatement:
        configuration, bound = self._configuration, sensor.bound_from
        mean_acceleration: Callable[[float], float]
        if configuration.rule is not None:
            rule = configuration.calibrated_rule()
            own, gravity_error = rule.accelerometer.sensor(), rule.accelerometer.gravity_error_m_per_s2
            gravity = rule.accelerometer.gravity_m_per_s2
            offset += rule.accelerometer.time_offset_bound_s
            mean_acceleration = over(rule.motion.bounds(), offset)
        else:
            assert isinstance(bound, AccelerationBound | VelocityWindowBound)
            own, gravity_error = configuration.sensor_bounds(sensor), bound.gravity_error_m_per_s2
            gravity = sensor.gravity_m_per_s2
            if isinstance(bound, VelocityWindowBound):
                mean_acceleration = over(_motion(bound), offset)
            else:
                largest = bound.acceleration_m_per_s2
                mean_acceleration = lambda _: largest  # noqa: E731
        return VectorStatement(
            offset=lambda half_length: mean_acceleration(half_length) + gravity * moved,
            error=own.error,
            averaged_error=own.error if own.averaged_error is None else own.averaged_error,
            averaged_over=own.averaged_over,
            scale_error=_scale(own.scale_error, own.misalignment, sensor),
            time_offset=offset,
            length=gravity,
            length_error=gravity_error,
            longest_step=longest,
        )

    def _field(self, sensor: Magnetometer, offset: float, moved: float, fields: FloatArray) -> VectorStatement:
        configuration, bound = self._configuration, sensor.bound_from
        own = configuration.sensor_bounds(sensor)
        if configuration.rule is not None:
            of_field = configuration.calibrated_rule().magnetometer
            assert of_field is not None  # the configuration's check
            disturbance, own = of_field.disturbance_ut, of_field.sensor()
            offset += abs(of_field.delay_s) + of_field.time_offset_bound_s
        else:
            assert isinstance(bound, FieldBound)
            disturbance = bound.disturbance_ut + bound.strength_error_ut
        lengths = np.linalg.norm(fields, axis=1)
        longest = float(np.nanmax(lengths)) if np.isfinite(lengths).any() else 0.0
        away = disturbance + longest * moved
        return VectorStatement(
            offset=lambda _: away,
            error=own.error,
            averaged_error=own.error if own.averaged_error is None else own.averaged_error,
            averaged_over=own.averaged_over,
            scale_error=_scale(own.scale_error, own.misalignment, sensor),
            time_offset=offset,
        )


def over(motion: MotionBounds, offset: float) -> Callable[[float], float]:
    """The bound of the mean acceleration over windows of half-lengths, s, by stamps that may be off by an offset."""

    def mean_acceleration(half_length: float) -> float:
        # Within a window that may drift from early to late, (18.64).
        half = np.array([max(half_length - offset, 0.0)])
        return float(motion.mean_acceleration_triangular(half, half)[0])

    return mean_acceleration


def _motion(bound: VelocityWindowBound) -> MotionBounds:
    def known(value: float | None) -> float:
        return math.inf if value is None else value

    return MotionBounds(
        known(bound.velocity_m_per_s),
        known(bound.position_m),
        known(bound.acceleration_m_per_s2),
        known(bound.largest_jerk_m_per_s3),
    )


def _scale(scale_error: float, misalignment: float, sensor: AnyDirection) -> float:
    """The scale error with all that turns a sample's vector: it acts on each as a scale error does."""
    return min(scale_error + _chord(misalignment) + _chord(sensor.added_angle), 0.99)


def _chord(angle: float) -> float:
    """How far apart unit vectors are at this angle."""
    return 2.0 * math.sin(0.5 * min(angle, math.pi))


def _moves(log: Log, i: int) -> float:
    """How far a reference's direction is from its first one at most, as a share of its length."""
    references = log.references[np.isfinite(log.references[:, i]).all(axis=1), i]
    if not len(references):
        return 0.0
    unit = references / np.linalg.norm(references, axis=1, keepdims=True)
    return float(np.linalg.norm(unit - unit[0], axis=1).max())


def _beside(log: Log, rates: FloatArray, samples: FloatArray, longest: float, flow: GyroFlow) -> RatesBeside:
    """Steps between samples that are further apart than is stated, and what is beside rates on lines."""
    middles = 0.5 * (log.times[1:] + log.times[:-1])
    after = np.clip(np.searchsorted(samples, middles), 1, len(samples) - 1)
    errors = np.zeros(len(log.times))
    if flow.interval_rate == "first_sample":
        # The rate is still the one before, which a line leaves by no more than they differ.
        at_samples = np.column_stack([np.interp(samples, log.times, column) for column in rates.T])
        changes = np.linalg.norm(np.diff(at_samples, axis=0), axis=1)[after - 1]
        errors[1:] = changes
        errors[:-1] = np.maximum(errors[:-1], changes)
    return RatesBeside(errors, (samples[after] - samples[after - 1]) > longest)
