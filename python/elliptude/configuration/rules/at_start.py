"""The rest at the start of a recording, and what is taken from it: the gyro's bias, up, and the field's direction."""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude.bounds.gyro import GyroBounds, covered_interval
from elliptude.bounds.rest import longest_run, mean_acceleration_at_rest, mean_at_rest, why_no_rest
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
    run: tuple[float, float] | None
    """When the mean begins and ends, s, by its sensor's stamps; None where it is one of samples, not over time."""


def turn_in_rest(rule: Rule, times: FloatArray) -> float:
    """How far the body's attitudes in a rest at these times may be from one another, rad, theory.md section 18.5."""
    return min(rule.gyro_bounds().bias * float(times[-1] - times[0]), np.pi)


def up_at_rest(rule: Rule, times: FloatArray, forces: FloatArray, turned: float = 0.0) -> UpAtRest:
    """What the rest at the start says of up, in body axes of a moment of it.

    Parameters
    ----------
    rule : Rule
    times : (N,) array
        The accelerometer's, s.
    forces : (N, 3) array
        m/s²; NaN where it shows nothing.
    turned : float
        How far attitudes in the rest may be from one another, rad.

    Raises
    ------
    ValueError
        If its length contradicts the rule.
    """
    accelerometer = rule.accelerometer
    gravity, gravity_error = accelerometer.gravity_m_per_s2, accelerometer.gravity_error_m_per_s2
    force, force_error, lasted = mean_at_rest(times, forces, accelerometer.sensor())
    k = accelerometer.scale_error
    length = float(np.linalg.norm(force))
    radius = force_error + k * (length + accelerometer.error_m_per_s2) / (1.0 - k)
    moved = mean_acceleration_at_rest(rule.rest.velocity_m_per_s, lasted, accelerometer.time_offset_bound_s)
    radius += (1.0 + 0.5 * turned) * moved  # the axes turn while it moves
    radius += _versine(turned) * (gravity + gravity_error)
    tilt, excess = angle_to_center(length, gravity, radius, gravity_error)
    if excess > 0.0:
        raise ValueError(
            f"at rest the specific force is {length:.4g} m/s^2, "
            f"{excess:.2g} m/s^2 further from gravity than the rule allows"
        )
    return UpAtRest(force, float(tilt), _run(times, forces))


def field_at_rest(
    rule: Rule, up: UpAtRest, fields_at: FloatArray, fields: FloatArray, turned: float = 0.0
) -> tuple[FloatArray, float]:
    """The reference field (0, horizontal, vertical), µT, and how far it may be off, theory.md (18.11) and (18.65).

    Each sensor's mean is over the times of its own samples. `turned` is that of `up_at_rest`.
    """
    magnetometer = rule.magnetometer
    assert magnetometer is not None
    field, error, _ = mean_at_rest(fields_at, fields, magnetometer.sensor())
    if not np.isfinite(field).all():
        raise ValueError(
            "the magnetometer shows nothing in the rest at the start; does its delay, magnetometer.delay_s = "
            f"{magnetometer.delay_s:g}, move it out of there?"
        )
    length = float(np.linalg.norm(up.force))
    vertical = float(field @ up.force) / length
    horizontal = float(np.linalg.norm(field - vertical * up.force / length))
    strength, k = float(np.linalg.norm(field)), magnetometer.scale_error
    chord = 2.0 * float(np.sin(0.5 * turned))
    error += k * (strength + magnetometer.error_ut) / (1.0 - k) + chord * rule.field_change()
    # What turning in the rest leaves of the true field's mean beside that of up, as a share of the field.
    slack = 2.0 * max(magnetometer.time_offset_bound_s, rule.accelerometer.time_offset_bound_s)
    share = _versine(turned) + chord * _apart(up.run, _run(fields_at, fields), slack)
    error = (error + share * strength) / (1.0 - share) if share < 1.0 else np.inf
    error += 2.0 * strength * np.sin(0.5 * up.tilt)
    return np.array([0.0, horizontal, vertical]), float(error)


def reference_at_rest(
    rule: Rule,
    times: FloatArray,
    forces_at: FloatArray,
    forces: FloatArray,
    fields_at: FloatArray,
    fields: FloatArray,
) -> tuple[FloatArray, float]:
    """`field_at_rest` of a rest at these times, from all that each sensor shows, or from what both do.

    What the body turns by is in both means alike if they are over the same time; over a longer one each is better.
    """
    turned = turn_in_rest(rule, times)
    found = [field_at_rest(rule, up_at_rest(rule, forces_at, forces, turned), fields_at, fields, turned)]
    of_forces, of_fields = _there(forces), _there(fields)
    both = of_forces & of_fields
    if both.any() and not np.array_equal(both, of_forces | of_fields):
        forces, fields = (np.where(both[:, None], vectors, np.nan) for vectors in (forces, fields))
        found.append(field_at_rest(rule, up_at_rest(rule, forces_at, forces, turned), fields_at, fields, turned))
    return min(found, key=lambda one: one[1])


def _there(vectors: FloatArray) -> NDArray[np.bool_]:
    """Rows in which a sensor shows something."""
    return np.asarray(np.isfinite(vectors).all(axis=1))


def _versine(turned: float) -> float:
    """How far a mean of attitudes this far apart is from a rotation at most."""
    return 2.0 * float(np.sin(0.5 * min(turned, np.pi))) ** 2


def _run(times: FloatArray, vectors: FloatArray) -> tuple[float, float] | None:
    """When the mean of `mean_at_rest` begins and ends, s; None where it is not over time."""
    run = times[longest_run(times, _there(vectors))]
    return (float(run[0]), float(run[-1])) if len(run) > 1 and run[-1] > run[0] else None


def _apart(one: tuple[float, float] | None, other: tuple[float, float] | None, slack: float) -> float:
    """The share of a mean over time that is of other instants than another one; 1 if either is not over time.

    `slack` is how far the ends of what they have in common may be off together, s.
    """
    if one is None or other is None:
        return 1.0
    common = min(one[1], other[1]) - max(one[0], other[0])
    longest = max(one[1] - one[0], other[1] - other[0])
    if one == other and slack == 0.0:
        return 0.0
    return min(1.0 - (common - slack) / (longest + slack), 1.0)


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
    longest = covered_interval(times, rule.gyro.longest_interval_s)
    gyro = dataclasses.replace(rule.gyro_bounds(), longest_interval=longest)
    rest = rest_at_start(rule.rest, times, angular_velocities, specific_forces, gyro)
    moved = moved_fields(rule.magnetometer, times, fields, fields_sampled, longest)
    forces_at = times if forces_sampled is None else forces_sampled
    reference, _ = reference_at_rest(
        rule, times[rest], forces_at[rest], specific_forces[rest], moved.sampled[rest], moved.values[rest]
    )
    direction: FloatArray = reference / np.linalg.norm(reference)
    return direction
