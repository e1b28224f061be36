"""Looks at a log, sensor by sensor: what is in it, and what in it or in the configuration is or may be wrong."""

import os
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from elliptude import units
from elliptude.bounds.gyro import usual_longest, with_rounding
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import FirstMeasurementStart
from elliptude.configuration.findings import suspicions
from elliptude.configuration.findings.finding import Finding, Said
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.sensors import Accelerometer, AnyDirection, Magnetometer
from elliptude.estimation import estimator, gaps
from elliptude.estimation.direction_rows import direction_rows
from elliptude.io.files import FileError
from elliptude.logs import log as logs
from elliptude.logs import plausibility
from elliptude.logs.agreement.sizes import OddSize, odd_length, odd_rate
from elliptude.logs.body_at_rest import UpAtRest, up_in_log
from elliptude.logs.log import Log, Samples
from elliptude.logs.signals.saturation import Saturation
from elliptude.logs.signals.silence import Stuck, stopped_sensors
from elliptude.typing import FloatArray

_GRAVITY_TOLERANCE = 0.1
_HIGHEST_SAMPLE_RATE = 1e5
_UNIT_NORM_TOLERANCE = 1e-3


@dataclass(frozen=True)
class SensorReport:
    """Figures of one sensor, in the unit that is named; None if nothing was measured."""

    name: str
    unit: str
    rows: int
    """Rows of the file."""
    measured: int
    empty: int
    """Rows in which it was not measured."""
    begin_s: float | None
    end_s: float | None
    rate_hz: float | None
    """One over the median step."""
    longest_step_s: float | None
    longest_step_at_s: float | None
    gaps: int
    """Steps longer than one and a half of the median one."""
    lowest: list[float] | None
    highest: list[float] | None
    median_norm: float | None
    still: float | None
    """The share of steps that repeat the values before: a sensor that is slower than its stamps."""


@dataclass(frozen=True)
class Report:
    """What `check` found."""

    sensors: list[SensorReport]
    findings: list[Finding]
    up_at_rest: UpAtRest | None = None
    repaired: tuple[str, ...] = ()
    """What was left out, in words."""

    @property
    def is_good(self) -> bool:
        """Whether there is no error."""
        return not any(finding.severity == "error" for finding in self.findings)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts, for JSON."""
        findings = [{"severity": one.severity, "sensor": one.sensor, "message": one.message} for one in self.findings]
        return {"good": self.is_good} | asdict(replace(self, findings=[])) | {"findings": findings}


def check(path: str | os.PathLike[str], configuration: Configuration) -> Report:
    """Look at a log.

    Parameters
    ----------
    path : path-like
    configuration : Configuration

    Returns
    -------
    Report
        It has what a reader of the log would refuse as an error, one for each sensor that has any.
    """
    samples: list[Samples] = []
    findings: list[Finding] = []
    try:
        samples = logs.read_samples(path, configuration)
    except FileError:
        messages: dict[str, str] = {}  # the same one for each sensor with the same time column
        for name in logs.sensor_names(configuration):
            try:
                samples += logs.read_samples(path, configuration, [name])
            except FileError as error:
                messages.setdefault(str(error), name)
        findings += [Finding("error", "", message) for message in messages]
    repaired: tuple[str, ...] = ()
    if configuration.timing.repair:
        try:
            repaired = tuple(logs.faults_of(path, configuration).lines())
        except FileError as error:
            findings.append(Finding("error", "", str(error)))
    up = None
    if not findings:
        try:
            log = logs.read_log(path, configuration)
        except FileError as error:
            findings.append(Finding("error", "", str(error)))
        else:
            contradictions = plausibility.contradictions(log, configuration)
            findings += [_suspicious(one) for one in suspicions.of_units(configuration) if one not in contradictions]
            findings += contradictions
            findings += _start(log, configuration)
            saturation = Saturation(configuration)
            saturation.add(log)
            findings += saturation.found()
            lasted = float(log.times[-1] - log.times[0]) if len(log.times) else 0.0
            too_long = suspicions.of_configured_duration(configuration, lasted)
            findings += map(_suspicious, too_long)
            stuck = Stuck(configuration)
            stuck.add(log)
            findings += [*stopped_sensors(samples, log), *stuck.found()]
            up = up_in_log(log, configuration)
            findings += _refused(log, configuration, findings)
    said = set(findings)
    odd_statements = [one for one in suspicions.of_configuration(configuration) if one not in said]
    findings += [Finding("warning", name, why) for name, why in configuration.calibrations_not_used().items()]
    findings += [one for one in map(_suspicious, odd_statements) if one not in said]
    reports = [_report(one, configuration) for one in samples]
    odd = {finding.sensor for finding in findings if isinstance(finding, OddSize)}
    findings += [finding for one in samples for finding in _suspicions(one, configuration, odd)]
    return Report(reports, findings, up, repaired)


def _suspicious(found: Finding) -> Finding:
    return replace(found, said=("suspicious: ", found.said))


def _refused(log: Log, configuration: Configuration, found: list[Finding]) -> list[Finding]:
    """What the guaranteed mode refuses: no rest for a rule, an interval that the gyro's bounds do not cover."""
    if configuration.estimator.mode != "guaranteed" or any(finding.severity == "error" for finding in found):
        return []
    try:
        if isinstance(configuration.flow, GyroFlow):
            log = gaps.without_rates_in_gaps(log, gaps.longest_interval(log, configuration))
        direction_rows(log, configuration)
    except ValueError as error:
        return [Finding("error", "", str(error))]
    return []


def _start(log: Log, configuration: Configuration) -> list[Finding]:
    """Whether there is a row that a start from the first measurement needs, and which one."""
    if not isinstance(configuration.start, FirstMeasurementStart) or configuration.estimator.mode == "guaranteed":
        return []
    try:
        first = estimator.first_complete_row(log, configuration)
    except ValueError as error:
        return [Finding("error", "start", str(error))]
    if first == 0:
        return []
    return [
        Finding("warning", "start", f"{first} rows are left out: the first with two directions is {log.place(first)}")
    ]


def _report(samples: Samples, configuration: Configuration) -> SensorReport:
    unit, scale = _unit(samples.name, configuration)
    times, values = samples.times + samples.origin, samples.values / scale
    steps = np.diff(times)
    there, several = len(times) > 0, len(times) > 1
    longest = int(np.argmax(steps)) if several else 0
    return SensorReport(
        name=samples.name,
        unit=unit,
        rows=samples.rows,
        measured=len(times),
        empty=samples.rows - len(times),
        begin_s=float(times[0]) if there else None,
        end_s=float(times[-1]) if there else None,
        rate_hz=float(1.0 / np.median(steps)) if several else None,
        longest_step_s=float(steps[longest]) if several else None,
        longest_step_at_s=float(times[longest]) if several else None,
        gaps=int((steps > with_rounding(usual_longest(steps), times)).sum()) if several else 0,
        lowest=values.min(axis=0).tolist() if there else None,
        highest=values.max(axis=0).tolist() if there else None,
        median_norm=float(np.median(np.linalg.norm(values, axis=1))) if there else None,
        still=float((values[1:] == values[:-1]).all(axis=1).mean()) if several else None,
    )


def _unit(name: str, configuration: Configuration) -> tuple[str, float]:
    """The unit in which a sensor is declared, and its size in SI units."""
    flow, rate, truth = configuration.flow, configuration.rate, configuration.truth
    if name == "the gyro" and isinstance(flow, GyroFlow):
        return flow.unit, units.ANGULAR_VELOCITY[flow.unit]
    if name == "rate" and rate is not None:
        return rate.unit, units.ANGULAR_VELOCITY[rate.unit]
    if name == "true vector" and truth is not None:
        return truth.vector_unit, units.ANGULAR_VELOCITY[truth.vector_unit]
    if name == "the control torque":
        return "N m", 1.0
    if name == "the velocity" and configuration.velocity is not None:
        return configuration.velocity.unit, units.VELOCITY[configuration.velocity.unit]
    for sensor in configuration.directions:
        if sensor.name == name and isinstance(sensor, Accelerometer):
            return sensor.unit, units.ACCELERATION[sensor.unit]
        if sensor.name == name and isinstance(sensor, Magnetometer):
            return sensor.unit, sensor.tesla
    return "1", 1.0


def _suspicions(samples: Samples, configuration: Configuration, odd: set[str]) -> list[Finding]:
    """What is odd about a sensor's samples, unless its size was found to be among those already."""
    found: list[Finding] = []

    def warn(said: Said) -> None:
        found.append(Finding("warning", samples.name, said))

    if not len(samples.times):
        warn("never measured")
        return found
    norms = np.linalg.norm(samples.values, axis=1)
    sensor = next((one for one in configuration.directions if one.name == samples.name), None)
    said: Said = "" if sensor is None else odd_length(samples.values, sensor, configuration)
    if samples.name in {"the gyro", "rate"}:
        said = odd_rate(samples.values, configuration)
    if said and samples.name not in odd:
        warn(said)
    elif sensor is not None and not said and (little := _hardly_odd(float(np.median(norms)), sensor)):
        warn(little)
    elif samples.name == "true attitude":
        worst = float(np.abs(norms - 1.0).max())
        if worst > _UNIT_NORM_TOLERANCE:
            at = samples.times[int(np.argmax(np.abs(norms - 1.0)))] + samples.origin
            warn(f"quaternions are not of length 1, but {worst:.3g} off at {at:.6f} s; only their direction counts")
    found += _clock(samples)
    return found


def _hardly_odd(median: float, sensor: AnyDirection) -> str:
    """What is said of a median norm, in SI units, that no unit explains and that is not as usual; else empty."""
    if isinstance(sensor, Accelerometer) and abs(median / sensor.gravity_m_per_s2 - 1.0) > _GRAVITY_TOLERANCE:
        shown = f"{median / units.ACCELERATION[sensor.unit]:.4g} {sensor.unit}"
        return f"its median norm is {shown}, which is not gravity within {100.0 * _GRAVITY_TOLERANCE:g} %"
    if not isinstance(sensor, Magnetometer) or sensor.unit == "normalized":
        return ""
    if units.WEAKEST_FIELD_UT <= median / units.FIELD["uT"] <= units.STRONGEST_FIELD_UT:
        return ""
    least, most = (units.FIELD["uT"] * one / sensor.tesla for one in (units.WEAKEST_FIELD_UT, units.STRONGEST_FIELD_UT))
    return (
        f"its median norm is {median / sensor.tesla:.4g} {sensor.unit}, which is not the Earth's field "
        f"({least:.3g} to {most:.3g} {sensor.unit})"
    )


def _clock(samples: Samples) -> list[Finding]:
    steps: FloatArray = np.diff(samples.times)
    if not len(steps):
        return [Finding("warning", samples.name, "measured but once")]
    rate = 1.0 / float(np.median(steps))
    if rate > _HIGHEST_SAMPLE_RATE:
        return [Finding("warning", samples.name, f"{rate:.3g} samples a second: is the unit of time right?")]
    longest = int(np.argmax(steps))
    if steps[longest] > 10.0 / rate:
        at = samples.times[longest] + samples.origin
        return [Finding("warning", samples.name, f"a gap of {steps[longest]:.4g} s after {at:.6f} s")]
    return []
