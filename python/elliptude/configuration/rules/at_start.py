"""The rest at the start of a recording, and what is taken from it: the gyro's bias, up, and the field's direction."""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from elliptude.bounds.gyro import GyroBounds, longest_interval_of
from elliptude.bounds.rest import mean_at_rest, why_no_rest
from elliptude.bounds.samples import angle_to_center
from elliptude.bounds.stamps import shift_by_own_stamps
from elliptude.configuration.rules.tables import MagnetometerRule, RestRule, Rule
from elliptude.typing import FloatArray


def rest_at_start(rule: RestRule, times: FloatArray, rates: FloatArray, forces: FloatArray, gyro: GyroBounds) -> slice:
    """Rows of the rest at the start: as long as the rule says that it lasts at least, or what is still up to its most.

    Else what goes on being still is not taken for it: sensors do not tell a rest from turning and speeding up smoothly.

    Raises
    ------
    ValueError
        If the recording does not start at rest.
    """
    resting = rule.rows(times, rates, forces)
    count = int(np.argmin(resting)) if not resting.all() else len(resting)
    gaps = np.flatnonzero(gyro.gaps(times, rates))
    if len(gaps):
        count = min(count, int(gaps[0]) + 1)
    lasted = times[count - 1] - times[0] if count else 0.0
    if lasted < 0.99 * rule.least_s:
        behind = slice(count, int(np.searchsorted(times, times[min(count, len(times) - 1)] + rule.duration_s)))
        if count == len(times):
            why = "the recording ends there"
        elif len(gaps) and count == gaps[0] + 1:
            why = f"the gyro has a gap of {times[count] - times[count - 1]:.3g} s after {times[count - 1]:.6g} s"
        else:
            why = why_no_rest(times[behind], rates[behind], forces[behind], **rule.limits())
        raise ValueError(
            f"the recording starts with a rest of {lasted:.3g} s; the rule asks for {rule.least_s:g} s: {why}"
        )
    most = (1.0 + 1e-9) * max(rule.least_s, rule.most_s or 0.0)
    return slice(0, min(count, int(np.searchsorted(times, times[0] + most, side="right"))))


def after_rest(gyro: GyroBounds, times: FloatArray) -> GyroBounds:
    """Bounds from the first of these times on of a gyro whose bias is its mean over them.

    That mean is the bias of no instant: at the first it may be off by what drifts in half of the rest, (18.52).
    """
    return dataclasses.replace(gyro, bias=gyro.bias + 0.5 * gyro.drift * float(times[-1] - times[0]))


class MovedFields(NamedTuple):
    """Values of a magnetometer, moved by its delay."""

    values: FloatArray
    """µT; NaN where none belongs to the row, shape (N, 3)."""
    sampled: FloatArray
    """What time each shows, s, shape (N,)."""
    offset: float
    """How far that may be off, s."""


def moved_fields(
    stated: MagnetometerRule,
    times: FloatArray,
    fields: ArrayLike,
    sampled: FloatArray | None,
    longest_interval: float,
) -> MovedFields:
    """Move a magnetometer's values by its delay to rows, but to none that is in a gap.

    Parameters
    ----------
    stated : MagnetometerRule
    times : (N,) array
        Of the rows, s.
    fields : (N, 3) array
        µT.
    sampled : (N,) array, optional
        Their own stamps, s; those of the rows if they have none.
    longest_interval : float
        Between rows, s.
    """
    shifted, own = shift_by_own_stamps(times, times if sampled is None else sampled, fields, stated.delay_s)
    shifted[np.abs(own - times) > 0.5 * longest_interval] = np.nan  # at a gap no value belongs there
    return MovedFields(shifted, own, stated.time_offset_bound_s)


class UpAtRest(NamedTuple):
    """What a rest says of up."""

    force: FloatArray
    """The mean specific force, m/s², body axes, shape (3,)."""
    tilt: float
    """How far up may be from it, rad."""


def up_at_rest(rule: Rule, times: FloatArray, forces: FloatArray) -> UpAtRest:
    """What the rest at the start says of up.

    Raises
    ------
    ValueError
        If its length contradicts the rule.
    """
    accelerometer = rule.accelerometer
    force, force_error, lasted = mean_at_rest(times, forces, accelerometer.sensor())
    k = accelerometer.scale_error
    length = float(np.linalg.norm(force))
    radius = force_error + k * (length + accelerometer.error_m_per_s2) / (1.0 - k)
    radius += 2.0 * rule.rest.velocity_m_per_s / lasted if lasted > 0.0 else np.inf
    tilt, excess = angle_to_center(length, accelerometer.gravity_m_per_s2, radius, accelerometer.gravity_error_m_per_s2)
    if excess > 0.0:
        raise ValueError(
            f"at rest the specific force is {length:.4g} m/s^2, "
            f"{excess:.2g} m/s^2 further from gravity than the rule allows"
        )
    return UpAtRest(force, float(tilt))


def field_at_rest(rule: Rule, up: UpAtRest, fields_at: FloatArray, fields: FloatArray) -> tuple[FloatArray, float]:
    """The reference field (0, horizontal, vertical), µT, and how far it may be off, theory.md (18.11).

    Each sensor's mean is over the times of its own samples.
    """
    magnetometer = rule.magnetometer
    assert magnetometer is not None
    force, tilt = up
    field, error, _ = mean_at_rest(fields_at, fields, magnetometer.sensor())
    if not np.isfinite(field).all():
        raise ValueError(
            "the magnetometer shows nothing in the rest at the start; does its delay, magnetometer.delay_s = "
            f"{magnetometer.delay_s:g}, move it out of there?"
        )
    length = float(np.linalg.norm(force))
    vertical = float(field @ force) / length
    horizontal = float(np.linalg.norm(field - vertical * force / length))
    strength, k = float(np.linalg.norm(field)), magnetometer.scale_error
    error += 2.0 * strength * np.sin(0.5 * tilt) + k * (strength + magnetometer.error_ut) / (1.0 - k)
    return np.array([0.0, horizontal, vertical]), float(error)


def require_heading(reference: FloatArray, error: float) -> None:
    """Refuse a field (0, horizontal, vertical), µT, that may point anywhere about up."""
    if not error < reference[1]:
        raise ValueError(
            f"at rest the magnetometer shows a field of {np.linalg.norm(reference):.3g} µT with a horizontal part of "
            f"{reference[1]:.3g} µT, which may be off by {error:.3g} µT: it says nothing of the heading. The Earth's "
            "field is 20 to 70 µT: is the unit right? If it is, leave the magnetometer out"
        )


def field_at_start(
    rule: Rule,
    times: FloatArray,
    angular_velocities: FloatArray,
    specific_forces: FloatArray,
    fields: FloatArray,
    *,
    forces_sampled: FloatArray | None = None,
    fields_sampled: FloatArray | None = None,
) -> FloatArray:
    """The direction (3,) of the field in the rule's reference frame, from the rest at the start; as `apply_rule`.

    Raises
    ------
    ValueError
        If the recording does not start at rest, or contradicts the rule there.
    """
    assert rule.magnetometer is not None
    longest = longest_interval_of(np.diff(times), rule.gyro.longest_interval_s)
    gyro = dataclasses.replace(rule.gyro.bounds(), longest_interval=longest)
    rest = rest_at_start(rule.rest, times, angular_velocities, specific_forces, gyro)
    moved = moved_fields(rule.magnetometer, times, fields, fields_sampled, longest)
    forces_at = times if forces_sampled is None else forces_sampled
    up = up_at_rest(rule, forces_at[rest], specific_forces[rest])
    reference, _ = field_at_rest(rule, up, moved.sampled[rest], moved.values[rest])
    direction: FloatArray = reference / np.linalg.norm(reference)
    return direction
