"""What follows from a rule for one recording: a bound of each direction per row, which holds if its statements do."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from elliptude.bounds.gyro import GyroBounds, covered_interval
from elliptude.bounds.rest import mean_over_time
from elliptude.bounds.samples import DirectionBounds, angle_excess
from elliptude.bounds.velocity import MeasuredVelocity
from elliptude.bounds.windows import (
    MotionBounds,
    WindowBounds,
    cross_bounds,
    field_bounds_over_windows,
    gravity_bounds_over_windows,
)
from elliptude.configuration.rules.at_start import (
    after_rest,
    moved_fields,
    reference_at_rest,
    require_heading,
    rest_at_start,
    turn_in_rest,
    up_at_rest,
)
from elliptude.configuration.rules.tables import Rule
from elliptude.typing import FloatArray


@dataclass(frozen=True, eq=False)
class RuledRecording:
    """The bounds that a rule gives for a recording with N rows.

    The reference frame: up is its third axis; the field at the start lies in the plane of the second and third axis, so
    that the second points to magnetic north.
    """

    rest_at_start: slice
    """Rows of the rest at the start, as long as the rule states that it lasts."""
    bias: FloatArray
    """The gyro's mean over that rest, rad/s, shape (3,)."""
    gyro: GyroBounds
    """Bounds of the gyro's error after that bias is subtracted."""
    gyro_noise: FloatArray
    """Bound of the rate's error, row by row, rad/s, shape (N,): noise, scale error, and what is left of the bias.

    In an interval the larger of its ends' bounds counts. The bias may change with the pose within its bound, so that a
    filter must take all of this as noise and estimate no bias. `GyroBounds.anchored_turns` bounds turns over longer
    times better.
    """
    up: WindowBounds
    """Bounds of the direction (0, 0, 1)."""
    field: WindowBounds | None
    """Bounds of the direction ``field_reference``; a row whose dip contradicts the bounds is contradicted, too.

    Such a row proves that a statement about the field does not hold for this recording. The rule says whether any bound
    is left then.
    """
    east: DirectionBounds | None
    """Bounds of the direction (1, 0, 0), from both: what they say about the heading."""
    field_reference: FloatArray | None
    """Direction of the field in the reference frame, shape (3,)."""
    field_reference_error: float
    """Bound of the reference field's error, µT; it is in the bounds of ``field``."""


def apply_rule(
    rule: Rule,
    times: ArrayLike,
    angular_velocities: ArrayLike,
    specific_forces: ArrayLike,
    fields: ArrayLike | None = None,
    *,
    longest_interval: float | None = None,
    every: int = 1,
    velocity: MeasuredVelocity | None = None,
    forces_sampled: FloatArray | None = None,
    fields_sampled: FloatArray | None = None,
) -> RuledRecording:
    """Work out the bounds that a rule gives for a recording.

    Parameters
    ----------
    rule : Rule
    times : (N,) array
        s, increasing.
    angular_velocities : (N, 3) array
        rad/s, body axes, as the gyro shows them; NaN where it shows nothing.
    specific_forces : (N, 3) array
        m/s², body axes; at rest it points up.
    fields : (N, 3) array, optional
        µT, body axes.
    longest_interval : float, optional
        Between rows, that the gyro's bounds cover, s. If left out, the rule states it, or it follows from the times.
    every : int
        Only rows whose index is a multiple of this get directions, which saves time.
    velocity : MeasuredVelocity, optional
        Measured velocities: what of the specific forces is acceleration.
    forces_sampled, fields_sampled : (N,) array, optional
        When each was measured, s, increasing, if they have stamps of their own beside those of the rows.

    Returns
    -------
    RuledRecording

    Raises
    ------
    ValueError
        If the recording does not start at rest, or contradicts the rule there.
    """
    stamps = np.asarray(times, dtype=np.float64)
    rates, forces = np.asarray(angular_velocities, dtype=np.float64), np.asarray(specific_forces, dtype=np.float64)
    accelerometer, forces_at = rule.accelerometer, stamps if forces_sampled is None else forces_sampled
    if longest_interval is None:
        longest_interval = covered_interval(stamps, rule.gyro.longest_interval_s)
    gyro = dataclasses.replace(rule.gyro_bounds(), longest_interval=longest_interval)
    rest = rest_at_start(rule.rest, stamps, rates, forces, gyro)
    bias = mean_over_time(stamps[rest], rates[rest])
    rates, gyro = rates - bias, after_rest(gyro, stamps[rest])
    step = min(10.0 * float(np.median(np.diff(stamps))), longest_interval)
    in_rest = forces_at[rest], forces[rest]
    up_at_rest(rule, *in_rest, turn_in_rest(rule, stamps[rest]))  # or it contradicts the rule

    def up_within(rows: slice, motion: MotionBounds) -> WindowBounds:
        return gravity_bounds_over_windows(
            stamps[rows],
            forces[rows],
            rates[rows],
            rule.motion.windows_s,
            motion=motion,
            gyro=gyro,
            sensor=accelerometer.sensor(),
            gravity=accelerometer.gravity_m_per_s2,
            gravity_error=accelerometer.gravity_error_m_per_s2,
            time_offset=accelerometer.time_offset_bound_s,
            time_offset_change=accelerometer.time_offset_change,
            at=rule.motion.row_at,
            maximum_step=step,
            every=every,
            velocity=velocity,
            sampled=forces_at[rows],
        )

    up = _known_better(up_within(slice(None), rule.motion.bounds()), rest, up_within(rest, rule.motion_in_rest()))
    noise = gyro.rate_error(np.linalg.norm(rates, axis=1), stamps - stamps[0])
    if fields is None or rule.magnetometer is None:
        return RuledRecording(rest, bias, gyro, noise, up, None, None, None, 0.0)

    magnetometer = rule.magnetometer
    moved = moved_fields(magnetometer, stamps, fields, fields_sampled, longest_interval)
    reference, error = reference_at_rest(rule, stamps[rest], *in_rest, moved.sampled[rest], moved.values[rest])

    def field_within(rows: slice, disturbance: float) -> WindowBounds:
        return field_bounds_over_windows(
            stamps[rows],
            moved.values[rows],
            rates[rows],
            [magnetometer.window_s],
            disturbance=disturbance + error,
            gyro=gyro,
            strength=float(np.linalg.norm(reference)),
            sensor=magnetometer.sensor(),
            time_offset=moved.offset,
            at=rule.motion.row_at,
            maximum_step=step,
            every=every,
            sampled=moved.sampled[rows],
        )

    require_heading(reference, error)
    field = field_within(slice(None), magnetometer.disturbance_ut)
    # The reference is the mean field over the rest, from which it is less far there.
    field = _known_better(field, rest, field_within(rest, rule.field_change()))
    field = _without_contradictions(field, up, reference, whole=magnetometer.contradiction_voids == "recording")
    east = cross_bounds(up, field, reference, in_plane_error=error)
    return RuledRecording(rest, bias, gyro, noise, up, field, east, reference / np.linalg.norm(reference), error)


def _without_contradictions(
    field: WindowBounds, up: WindowBounds, reference: FloatArray, *, whole: bool
) -> WindowBounds:
    """The field without rows that contradict the dip, which are as wrong as those of a wrong length."""
    strength, dip = float(np.linalg.norm(reference)), float(np.arctan2(reference[1], reference[2]))
    excess = np.maximum(field.excess, strength * angle_excess(up, field, dip))
    void = excess > 0.0
    if whole:
        void = np.full_like(void, void.any())
    return dataclasses.replace(field, angles=np.where(void, np.nan, field.angles), excess=excess)


def _known_better(bounds: WindowBounds, rows: slice, there: WindowBounds) -> WindowBounds:
    """The bounds, replaced in some rows where others are smaller; both hold, either may contradict the data."""
    better = np.zeros(len(bounds.angles), dtype=np.bool_)
    better[rows] = ~(there.angles >= bounds.angles[rows]) & ~np.isnan(there.angles)

    def chosen(everywhere: FloatArray, there: FloatArray) -> FloatArray:
        result = everywhere.copy()
        result[better] = there[better[rows]]
        return result

    excess = bounds.excess.copy()
    excess[rows] = np.maximum(excess[rows], there.excess)
    angles = np.where(excess > 0.0, np.nan, chosen(bounds.angles, there.angles))
    return WindowBounds(
        chosen(bounds.directions, there.directions),
        angles,
        excess,
        chosen(bounds.durations, there.durations),
        chosen(bounds.lengths, there.lengths),
        chosen(bounds.radii, there.radii),
    )
