"""Rules for bounds: what is known about a kind of recording, as a TOML file, and what follows for one recording.

A rule states numbers once, for every recording of its kind. ``data/bounds/hand_held.toml`` gives its reasons beside
each; ``car.toml`` and others beside it say what differs where a sensor is carried otherwise. `apply_rule` turns a rule
into a bound of each direction per row. These bounds hold if the rule's statements do.
"""

import dataclasses
import functools
import os
from dataclasses import dataclass
from importlib import resources
from typing import Annotated, Any, Literal, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from elliptude.bounds.gyro import GyroBounds, longest_interval_of
from elliptude.bounds.rest import mean_at_rest, mean_over_time, rest_rows, why_no_rest
from elliptude.bounds.samples import (
    AVERAGED_OVER_S,
    DirectionBounds,
    VectorSensorBounds,
    angle_excess,
    angle_to_center,
)
from elliptude.bounds.stamps import shift_by_own_stamps
from elliptude.bounds.velocity import MeasuredVelocity
from elliptude.bounds.windows import (
    MotionBounds,
    WindowBounds,
    cross_bounds,
    field_bounds_over_windows,
    gravity_bounds_over_windows,
)
from elliptude.configuration.motion import EarthRate, require_earth_rate
from elliptude.io.toml import Model, Number, PositiveSize, Size, load_toml, read_toml
from elliptude.typing import FloatArray

# A quarter of an hour is no delay of a sensor, but another clock.
Delay = Annotated[Number, Field(ge=-1000.0, le=1000.0)]
Fraction = Annotated[Number, Field(ge=0, lt=1)]


Carried: TypeAlias = Literal["hand", "person", "drone", "car", "boat"]
"""How a sensor is carried, as far as there are numbers with reasons for it."""


class RestRule(Model):
    """What counts as a rest, and what holds in the rest at the start."""

    duration_s: PositiveSize
    rate_deviation_deg_per_s: PositiveSize
    rate_deg_per_s: PositiveSize
    acceleration_deviation_m_per_s2: PositiveSize
    least_s: PositiveSize
    # How much of what goes on being still is a rest, too, at most; none if it is left out.
    most_s: PositiveSize | None = None
    velocity_m_per_s: Size
    # How far the field may be from its mean over the rest; the magnetometer's disturbance if it is left out.
    field_change_ut: Size | None = None

    def rows(self, times: FloatArray, rates: FloatArray, forces: FloatArray) -> NDArray[np.bool_]:
        """Rows at rest, shape (N,)."""
        return rest_rows(times, rates, forces, **self.limits())

    def limits(self) -> dict[str, float]:
        """The limits as `rest_rows` has them: s, rad/s, m/s²."""
        return {
            "duration": self.duration_s,
            "rate_deviation": float(np.deg2rad(self.rate_deviation_deg_per_s)),
            "rate": float(np.deg2rad(self.rate_deg_per_s)),
            "acceleration_deviation": self.acceleration_deviation_m_per_s2,
        }


class GyroRule(Model):
    """Bounds of the gyro, its bias taken from the rest at the start."""

    noise_deg_per_s: Size
    bias_deg_per_s: Size
    drift_deg_per_s2: Size
    scale_error: Fraction
    increment_deg: PositiveSize | None = None
    noise_turn_deg: PositiveSize | None = None
    noise_turn_growth_deg_per_s: Size | None = None
    earth_rate: EarthRate | None = None
    # As in `flow`, if there is no rule.
    longest_interval_s: PositiveSize | None = None
    largest_rate_deg_per_s: PositiveSize | None = None
    largest_angular_acceleration_deg_per_s2: PositiveSize | None = None

    @model_validator(mode="after")
    def _adds_growth_to_something(self) -> Self:
        if self.noise_turn_growth_deg_per_s is not None and self.noise_turn_deg is None:
            raise ValueError("noise_turn_growth_deg_per_s needs noise_turn_deg, what it is added to")
        return self

    def bounds(self) -> GyroBounds:
        """In SI units."""
        acceleration = self.largest_angular_acceleration_deg_per_s2
        return GyroBounds(
            noise=np.deg2rad(self.noise_deg_per_s),
            bias=np.deg2rad(self.bias_deg_per_s),
            drift=np.deg2rad(self.drift_deg_per_s2),
            scale_error=self.scale_error,
            increment=np.inf if self.increment_deg is None else np.deg2rad(self.increment_deg),
            noise_turn=np.inf if self.noise_turn_deg is None else np.deg2rad(self.noise_turn_deg),
            noise_turn_growth=np.deg2rad(self.noise_turn_growth_deg_per_s or 0.0),
            longest_interval=np.inf if self.longest_interval_s is None else self.longest_interval_s,
            largest_rate=np.inf if self.largest_rate_deg_per_s is None else np.deg2rad(self.largest_rate_deg_per_s),
            angular_acceleration=np.inf if acceleration is None else np.deg2rad(acceleration),
        )


class AccelerometerRule(Model):
    """Gravity, and bounds of the accelerometer."""

    gravity_m_per_s2: PositiveSize
    gravity_error_m_per_s2: Size
    error_m_per_s2: Size
    averaged_error_m_per_s2: Size
    # How long the shortest window is that this is stated for.
    averaged_over_s: Size = AVERAGED_OVER_S
    scale_error: Fraction
    time_offset_bound_s: Size

    def sensor(self) -> VectorSensorBounds:
        """In SI units."""
        return VectorSensorBounds(
            error=self.error_m_per_s2,
            scale_error=self.scale_error,
            averaged_error=self.averaged_error_m_per_s2,
            averaged_over=self.averaged_over_s,
        )


class MotionRule(Model):
    """Bounds of the motion, and the windows to average over."""

    velocity_m_per_s: Size
    position_m: Size
    # The mean acceleration over any of the windows, and over shorter ones at the ends of a recording.
    acceleration_m_per_s2: PositiveSize | None = None
    # How fast the acceleration changes at most, but for a part no larger than a sample's error: for lost samples.
    largest_jerk_m_per_s3: PositiveSize | None = None
    windows_s: Annotated[tuple[PositiveSize, ...], Field(min_length=1)]
    row_at: Literal["end", "middle"]

    def bounds(self) -> MotionBounds:
        """In SI units."""
        acceleration = np.inf if self.acceleration_m_per_s2 is None else self.acceleration_m_per_s2
        return MotionBounds(self.velocity_m_per_s, self.position_m, acceleration, self.jerk)

    @property
    def jerk(self) -> float:
        """The largest, m/s³; infinite if it is not stated."""
        return np.inf if self.largest_jerk_m_per_s3 is None else self.largest_jerk_m_per_s3


class MagnetometerRule(Model):
    """Bounds of the magnetometer and of the field against the one at the start."""

    disturbance_ut: Size
    error_ut: Size
    averaged_error_ut: Size
    # How long the shortest window is that this is stated for.
    averaged_over_s: Size = AVERAGED_OVER_S
    scale_error: Fraction
    window_s: PositiveSize
    delay_s: Delay
    time_offset_bound_s: Size
    contradiction_voids: Literal["row", "recording"]
    """What a row that contradicts the bounds makes unusable: itself, or everything that rests on the field."""

    def sensor(self) -> VectorSensorBounds:
        """In µT."""
        return VectorSensorBounds(
            error=self.error_ut,
            scale_error=self.scale_error,
            averaged_error=self.averaged_error_ut,
            averaged_over=self.averaged_over_s,
        )


class Rule(Model):
    """A rule."""

    rest: RestRule
    gyro: GyroRule
    accelerometer: AccelerometerRule
    motion: MotionRule
    magnetometer: MagnetometerRule | None = None
    carried: Carried | None = None
    """Whose numbers are the usual ones for this kind of recording; those for the hand if it is not stated."""
    bounds_from_recording: str | None = None
    """The recording that the numbers are proposals from, if nobody has given reasons for them."""

    @model_validator(mode="after")
    def _is_of_a_gyro_on_earth(self) -> Self:
        self.require_earth_rate()
        return self

    def require_earth_rate(self, anchor_s: float | None = None) -> None:
        """Refuse bounds that the Earth's turn alone breaks; `anchor_s` is how long predictions are, 0 if left out."""
        windows = [*self.motion.windows_s, *([] if self.magnetometer is None else [self.magnetometer.window_s])]
        longest = max(*windows, anchor_s or 0.0)
        require_earth_rate(self.gyro.earth_rate, self.gyro.bounds(), longest, place="gyro", since_rest=True)

    def motion_in_rest(self) -> MotionBounds:
        """Bounds of the motion in the rest at the start, in SI units."""
        return MotionBounds(self.rest.velocity_m_per_s, jerk=self.motion.jerk)

    def field_change(self) -> float:
        """How far the field may be from its mean over the rest, µT."""
        disturbance = 0.0 if self.magnetometer is None else self.magnetometer.disturbance_ut
        change = self.rest.field_change_ut
        return disturbance if change is None else min(change, disturbance)


def read_rule(path: str | os.PathLike[str]) -> Rule:
    """Read a rule in a TOML file.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, or does not fit; with the file and every key at fault.
    """
    return read_toml(path, Rule)


@functools.cache
def hand_held() -> Rule:
    """The rule for a small sensor or phone in the hand, indoors, that starts at rest."""
    with resources.as_file(_preset("hand")) as file:
        return read_rule(file)


def rule_for(carried: Carried) -> Rule:
    """The rule for a small sensor that is carried in some way; ``"hand"`` is `hand_held`."""
    rule = hand_held()
    if carried == "hand":
        return rule
    tables = rule.model_dump(mode="json")
    for name, numbers in _stated(carried).items():
        tables[name] |= numbers
    return Rule.model_validate(tables | {"carried": carried})


def carried_numbers() -> list[tuple[str, str]]:
    """Tables and keys of the numbers that depend on how a sensor is carried."""
    others: tuple[Carried, ...] = ("person", "drone", "car", "boat")
    found = {(name, key): None for one in others for name, table in _stated(one).items() for key in table}
    of_hand = list(reasons_for("hand"))
    return [place for place in of_hand if place in found] + [place for place in found if place not in of_hand]


def reasons_for(carried: Carried) -> dict[tuple[str, str], str]:
    """The reason beside each number of `rule_for`, by table and key.

    A reason is the comment behind a number, or the lines of comments above it; a number without either has that of the
    number above it.
    """
    reasons = _reasons_in(_preset("hand").read_text(encoding="utf-8"))
    return reasons if carried == "hand" else reasons | _reasons_in(_preset(carried).read_text(encoding="utf-8"))


def _preset(carried: Carried) -> Any:
    name = "hand_held" if carried == "hand" else carried
    return resources.files("elliptude") / "data" / "bounds" / f"{name}.toml"


def _stated(carried: Carried) -> dict[str, dict[str, Any]]:
    with resources.as_file(_preset(carried)) as file:
        return load_toml(file)


def _reasons_in(text: str) -> dict[tuple[str, str], str]:
    reasons: dict[tuple[str, str], str] = {}
    table, above, last = "", list[str](), ""
    for line in text.splitlines():
        stated, _, comment = (part.strip() for part in line.partition("#"))
        if stated.startswith("["):
            table, above = stated.strip("[]"), []
        elif "=" in stated:
            last = " ".join([*above, comment]).strip() or last
            reasons[table, stated.split("=")[0].strip()] = last
            above = []
        else:
            above = [*above, comment] if comment else []
    return reasons


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
        longest_interval = longest_interval_of(np.diff(stamps), rule.gyro.longest_interval_s)
    gyro = dataclasses.replace(rule.gyro.bounds(), longest_interval=longest_interval)
    rest = rest_at_start(rule.rest, stamps, rates, forces, gyro)
    bias = mean_over_time(stamps[rest], rates[rest])
    rates = rates - bias
    gyro = after_rest(gyro, stamps[rest])
    step = min(10.0 * float(np.median(np.diff(stamps))), longest_interval)
    _up_at_rest(rule, forces_at[rest], forces[rest])

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
    reference, error = _field_at_rest(rule, forces_at[rest], forces[rest], moved.sampled[rest], moved.values[rest])
    strength = float(np.linalg.norm(reference))

    def field_within(rows: slice, disturbance: float) -> WindowBounds:
        return field_bounds_over_windows(
            stamps[rows],
            moved.values[rows],
            rates[rows],
            [magnetometer.window_s],
            disturbance=disturbance + error,
            gyro=gyro,
            strength=strength,
            sensor=magnetometer.sensor(),
            time_offset=moved.offset,
            at=rule.motion.row_at,
            maximum_step=step,
            every=every,
            sampled=moved.sampled[rows],
        )

    _require_heading(reference, error)
    field = field_within(slice(None), magnetometer.disturbance_ut)
    # The reference is the mean field over the rest, from which it is less far there.
    field = _known_better(field, rest, field_within(rest, rule.field_change()))
    field = _without_contradictions(field, up, reference, whole=magnetometer.contradiction_voids == "recording")
    east = cross_bounds(up, field, reference, in_plane_error=error)
    return RuledRecording(rest, bias, gyro, noise, up, field, east, reference / strength, error)


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
    reference, _ = _field_at_rest(rule, forces_at[rest], specific_forces[rest], moved.sampled[rest], moved.values[rest])
    direction: FloatArray = reference / np.linalg.norm(reference)
    return direction


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


def _require_heading(reference: FloatArray, error: float) -> None:
    """Refuse a field (0, horizontal, vertical), µT, that may point anywhere about up."""
    if not error < reference[1]:
        raise ValueError(
            f"at rest the magnetometer shows a field of {np.linalg.norm(reference):.3g} µT with a horizontal part of "
            f"{reference[1]:.3g} µT, which may be off by {error:.3g} µT: it says nothing of the heading. The Earth's "
            "field is 20 to 70 µT: is the unit right? If it is, leave the magnetometer out"
        )


def _up_at_rest(rule: Rule, times: FloatArray, forces: FloatArray) -> tuple[FloatArray, float]:
    """The mean specific force in the rest at the start, m/s², and how far up may be from it, rad.

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
    return force, float(tilt)


def _field_at_rest(
    rule: Rule, forces_at: FloatArray, forces: FloatArray, fields_at: FloatArray, fields: FloatArray
) -> tuple[FloatArray, float]:
    """The reference field (0, horizontal, vertical), µT, and how far it may be off, theory.md (18.11).

    Each sensor's mean is over the times of its own samples.
    """
    magnetometer = rule.magnetometer
    assert magnetometer is not None
    force, tilt = _up_at_rest(rule, forces_at, forces)
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
