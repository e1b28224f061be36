"""A rule as TOML: what is known about a kind of recording, and what its numbers are in SI units."""

import dataclasses
from typing import Annotated, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.rest import rest_rows
from elliptude.bounds.samples import AVERAGED_OVER_S, VectorSensorBounds
from elliptude.bounds.windows import MotionBounds
from elliptude.configuration.motion import EarthRate, require_earth_rate
from elliptude.io.toml import Gravity, Model, Number, PositiveSize, Size
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
    # How far it changes within a window beside the drift. As far as its bound allows if it is not stated.
    bias_change_deg_per_s: Size | None = None
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
            bias_change=np.inf if self.bias_change_deg_per_s is None else np.deg2rad(self.bias_change_deg_per_s),
        )


class AccelerometerRule(Model):
    """Gravity, and bounds of the accelerometer."""

    gravity_m_per_s2: Gravity
    gravity_error_m_per_s2: Size
    error_m_per_s2: Size
    averaged_error_m_per_s2: Size
    # How long the shortest window is that this is stated for.
    averaged_over_s: Size = AVERAGED_OVER_S
    scale_error: Fraction
    time_offset_bound_s: Size
    # How far the offset drifts within a window at most, steadily; what differs from sample to sample beside that is
    # jitter, and part of the averaged error. As far as the bound allows, either way, if it is not stated.
    time_offset_change_s: Size | None = None

    @property
    def time_offset_change(self) -> float:
        """That, s; infinite if it is not stated."""
        return np.inf if self.time_offset_change_s is None else self.time_offset_change_s

    def sensor(self) -> VectorSensorBounds:
        """In SI units."""
        return _sensor_of(self, self.error_m_per_s2, self.averaged_error_m_per_s2)


class MotionRule(Model):
    """Bounds of the motion, and the windows to average over."""

    velocity_m_per_s: Size
    position_m: Size
    # How large the linear acceleration is at most, at any time: no mean.
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
        return _sensor_of(self, self.error_ut, self.averaged_error_ut)


def _sensor_of(rule: AccelerometerRule | MagnetometerRule, error: float, averaged_error: float) -> VectorSensorBounds:
    """Bounds of a sensor's own errors; the two that have a unit in the name of their keys are given."""
    return VectorSensorBounds(
        error=error,
        scale_error=rule.scale_error,
        averaged_error=averaged_error,
        averaged_over=rule.averaged_over_s,
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

    def gyro_bounds(self) -> GyroBounds:
        """Bounds of the gyro, in SI units: what its noise adds up to is stated for windows up to the longest one."""
        return dataclasses.replace(self.gyro.bounds(), longest_window=max(self.motion.windows_s))

    def require_earth_rate(self) -> None:
        """Refuse bounds that the Earth's turn alone breaks; in a longer anchor what noise may do adds up."""
        longest = max(self.motion.windows_s)
        require_earth_rate(self.gyro.earth_rate, self.gyro_bounds(), longest, place="gyro", since_rest=True)

    def motion_in_rest(self) -> MotionBounds:
        """Bounds of the motion in the rest at the start, in SI units."""
        return MotionBounds(self.rest.velocity_m_per_s, jerk=self.motion.jerk)

    def field_change(self) -> float:
        """How far the field may be from its mean over the rest, µT."""
        disturbance = 0.0 if self.magnetometer is None else self.magnetometer.disturbance_ut
        change = self.rest.field_change_ut
        return disturbance if change is None else min(change, disturbance)
