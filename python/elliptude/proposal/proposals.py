"""Bounds proposed from a recording: how large errors and motions were in it, as quantiles and maxima.

What one recording showed is no promise about the next. A quantile, a maximum, and either with a margin, are all
*proposals*, places to start from. A guarantee needs a reason that the number cannot be exceeded: a datasheet, the size
of a room, the speed of an arm. Arrays in, dataclasses out; needs NumPy and SciPy.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.gyro import covered_interval
from elliptude.bounds.rest import noise_of, rest_rows, why_no_rest
from elliptude.bounds.stamps import shift as shifted_back
from elliptude.proposal.delays import DelayProposal, delay_of_rates, delay_of_vectors
from elliptude.proposal.gyro import GyroProposal, propose_gyro
from elliptude.proposal.statistics import Quantiles, finite_rows, means_of_pieces, quantiles, rotations_of
from elliptude.proposal.vectors import VectorProposal, angles_between, dip_scatter, propose_vector, with_averages
from elliptude.typing import FloatArray
from elliptude.units import STANDARD_GRAVITY

# rad/s and m/s²; what deviates by more is no rest of any sensor.
_NOISIEST_GYRO = float(np.deg2rad(15.0))
_NOISIEST_ACCELEROMETER = 3.0


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording with N rows; None for what was not measured."""

    times: FloatArray
    """s, increasing, shape (N,)."""
    angular_velocities: FloatArray
    """rad/s, body axes, shape (N, 3)."""
    specific_forces: FloatArray | None = None
    """m/s², body axes, up at rest, shape (N, 3)."""
    fields: FloatArray | None = None
    """µT, body axes, shape (N, 3)."""
    attitudes: FloatArray | None = None
    """The reference (qw, qx, qy, qz) from body to reference axes (third axis up), shape (N, 4)."""
    shared_stamps: float = 1.0
    """The share of rows at which all sensors were sampled; at the others their vectors are interpolated."""
    shared_forces: float = 1.0
    """The share of rows at which the accelerometer was sampled."""


@dataclass(frozen=True)
class StartProposal:
    """Differences from the rest at the start, in a recording that starts at rest."""

    duration: float
    """Length of the rest, s."""
    bias_moved: Quantiles | None
    """Distance of the mean of a piece at rest anywhere from the gyro's mean over the rest at the start, rad/s."""
    field_moved: Quantiles | None
    """Against the mean field of that rest, its delay taken out, µT: length of the vector difference with a reference
    attitude, without one the difference of the lengths."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """Everything that a recording shows about its errors."""

    duration: float
    """s."""
    rest: float
    """Share of rows at rest."""
    gyro: GyroProposal
    accelerometer: VectorProposal | None
    magnetometer: VectorProposal | None
    dip: Quantiles | None
    """Scatter of the angle between field and specific force at rest, rad."""
    gyro_delay: DelayProposal | None
    """Against the reference."""
    magnetometer_delay: DelayProposal | None
    """Against the gyro."""
    rests: list[tuple[float, float]]
    """First and last time of each phase of rest, s."""
    start: StartProposal | None
    """None where the recording does not start at rest."""
    rest_limits: dict[str, float] = field(default_factory=dict)
    """What counted as a rest, as `rest_rows` has it."""
    no_rest: str | None = None
    """Why nothing is a rest; None if something is."""
    rest_ends: str | None = None
    """What ends the rest at the start, or why there is none; None without an accelerometer."""
    field_angle: tuple[float, float] | None = None
    """The field's angle from the specific force over the whole recording, rad: median, and median distance from it."""


def propose(recording: Recording, *, gravity: float = STANDARD_GRAVITY) -> Proposal:
    """Measure how large errors and motions were in a recording, with its reference attitude if it has one.

    Parameters
    ----------
    recording : Recording
    gravity : float
        m/s².

    Returns
    -------
    Proposal
    """
    times, rates = recording.times, recording.angular_velocities
    forces, fields, attitudes = recording.specific_forces, recording.fields, recording.attitudes
    limits = rest_limits(recording)
    no_rest: str | None = "without an accelerometer a rest is not seen"
    ends: str | None = None
    if forces is None:
        resting = np.zeros(len(times), dtype=np.bool_)
    else:
        resting = rest_rows(times, rates, forces, **limits)
        no_rest = None if resting.any() else why_no_rest(times, rates, forces, **limits)
        # Whether the body rests across a gap is not known.
        gaps = np.diff(times) > covered_interval(times, None)
        ends = _what_ends_the_rest(recording, resting, gaps, limits)
        resting[:-1] &= ~gaps
    # A constant bias says nothing about the delay.
    gyro_delay = None if attitudes is None else delay_of_rates(times, rates, attitudes)
    delay = 0.0 if gyro_delay is None else gyro_delay.delay
    gyro = propose_gyro(times, rates, resting, attitudes, delay=delay)
    unbiased = rates if gyro.bias is None else rates - gyro.bias
    up = None if attitudes is None else np.array([0.0, 0.0, gravity])
    accelerometer = magnetometer = magnetometer_delay = None
    if forces is not None:
        accelerometer = propose_vector(forces, resting, attitudes, up, gravity)
        accelerometer = with_averages(accelerometer, times, forces, resting, attitudes, up)
    if fields is not None:
        magnetometer = propose_vector(fields, resting, attitudes)
        magnetometer = with_averages(magnetometer, times, fields, resting, attitudes, magnetometer.reference)
        magnetometer_delay = delay_of_vectors(times, fields, unbiased)
    late = 0.0 if magnetometer_delay is None else magnetometer_delay.delay
    return Proposal(
        duration=float(times[-1] - times[0]),
        rest=float(resting.mean()),
        gyro=gyro,
        accelerometer=accelerometer,
        magnetometer=magnetometer,
        dip=None if forces is None or fields is None else dip_scatter(forces, fields, resting),
        gyro_delay=gyro_delay,
        magnetometer_delay=magnetometer_delay,
        rests=_spans(times, resting),
        start=_against_the_start(recording, resting, delay + late) if resting[0] else None,
        rest_limits=limits,
        no_rest=no_rest,
        rest_ends=ends,
        field_angle=None if forces is None or fields is None else _field_angle(forces, fields),
    )


def _what_ends_the_rest(
    recording: Recording, still: NDArray[np.bool_], gaps: NDArray[np.bool_], limits: dict[str, float]
) -> str:
    """What ends the rest at the start, in words; ``gaps`` are those of the N − 1 steps."""
    times, forces = recording.times, recording.specific_forces
    assert forces is not None
    count = len(still) if still.all() else int(np.argmin(still))
    first_gap = int(np.argmax(gaps)) if gaps.any() else len(still)
    if first_gap < count:
        return f"a gap of {times[first_gap + 1] - times[first_gap]:.3g} s after {times[first_gap]:.6g} s"
    if count == len(still):
        return "the recording ends there"
    behind = slice(count, int(np.searchsorted(times, times[count] + limits["duration"])))
    return why_no_rest(times[behind], recording.angular_velocities[behind], forces[behind], **limits)


def rest_limits(recording: Recording) -> dict[str, float]:
    """What counts as a rest in a recording, as `rest_rows` has it: the usual limits, or more for a noisier sensor.

    A sample at rest is farther from the mean than five times the noise along an axis once in 60,000.
    """
    limits = {
        "duration": 0.5,
        "rate_deviation": float(np.deg2rad(1.0)),
        "rate": float(np.deg2rad(5.0)),
        "acceleration_deviation": 0.5,
    }
    noise = noise_of(recording.times, recording.angular_velocities, duration=limits["duration"])
    limits["rate_deviation"] = max(limits["rate_deviation"], min(5.0 * noise, _NOISIEST_GYRO))
    if recording.specific_forces is not None:
        noise = noise_of(recording.times, recording.specific_forces, duration=limits["duration"])
        limits["acceleration_deviation"] = max(
            limits["acceleration_deviation"], min(5.0 * noise, _NOISIEST_ACCELEROMETER)
        )
    return limits


def _field_angle(forces: FloatArray, fields: FloatArray) -> tuple[float, float] | None:
    """The angle of the field from the specific force, rad: its median, and the median distance from that."""
    angles = angles_between(forces, fields)
    angles = angles[np.isfinite(angles)]
    if not len(angles):
        return None
    middle = float(np.median(angles))
    return middle, float(np.median(np.abs(angles - middle)))


def _against_the_start(recording: Recording, resting: NDArray[np.bool_], late: float) -> StartProposal:
    """Differences from the rest at the start; ``late`` is the magnetometer's delay against the reference, s."""
    times, rates = recording.times, recording.angular_velocities
    begin, end = _spans(times, resting)[0]
    at_start, still = resting & (times <= end), resting & finite_rows(rates)
    bias_moved = None
    if (at_start & still).any():
        means, _ = means_of_pieces(times, rates, still)
        bias_moved = quantiles(np.linalg.norm(means - rates[at_start & still].mean(axis=0), axis=1))
    field_moved = None
    if recording.fields is not None and finite_rows(recording.fields[at_start]).any():
        fields, _ = shifted_back(times, recording.fields, late)
        off = np.abs(np.linalg.norm(fields, axis=1) - np.linalg.norm(np.nanmean(recording.fields[at_start], axis=0)))
        if recording.attitudes is not None:
            turns, known = rotations_of(recording.attitudes)
            there = at_start & known & finite_rows(recording.fields)
            if there.any():
                reference = turns[there].apply(recording.fields[there]).mean(axis=0)
                off = np.linalg.norm(fields - turns.inv().apply(reference), axis=1)[known]
        field_moved = quantiles(off)
    return StartProposal(end - begin, bias_moved, field_moved)


def _spans(times: FloatArray, chosen: NDArray[np.bool_]) -> list[tuple[float, float]]:
    changes = np.flatnonzero(np.diff(chosen, prepend=False, append=False))
    return [(float(times[begin]), float(times[end - 1])) for begin, end in changes.reshape(-1, 2)]
