"""Whether a reference attitude turns as the rate says, or takes directions to their references."""

import math

import numpy as np
import scipy

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings.finding import Finding, Severity
from elliptude.configuration.sensors import AnyDirection
from elliptude.logs.agreement.turns import Turns, spread_rows, unit_vectors
from elliptude.logs.agreement.wrong_units import FACTORS, like
from elliptude.logs.axes.stated import Stated
from elliptude.logs.log import Log
from elliptude.logs.quaternion_readings import FEWEST_PAIRS, LEAST, MOST, misread, readings_of
from elliptude.typing import FloatArray


def reference_attitude(log: Log, turns: Turns, configuration: Configuration, stated: Stated) -> Finding | None:
    """What is wrong with how the reference attitude is read; None if nothing is, or nothing is known."""
    if configuration.truth is None or log.true_attitudes is None:
        return None
    there = np.flatnonzero(np.isfinite(log.true_attitudes[:, 0, 0]))
    if len(there) <= FEWEST_PAIRS:
        return None
    chosen = spread_rows(len(there) - 1)
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
        for factor in FACTORS:
            if LEAST <= found.slope / factor <= MOST:
                return Finding(severity, label, (f"{what}: of the rate, ", like(factor, configuration)))
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
        there = there[spread_rows(len(there))]
        rotations = scipy.spatial.transform.Rotation.from_matrix(log.true_attitudes[there])
        directions, references = unit_vectors(log.directions[there, i]), unit_vectors(log.references[there, i])
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
