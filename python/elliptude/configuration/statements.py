"""What is stated of a sensor: what its bounds follow from, how far it may be off, and where its reference is from.

See ``docs/logs.md`` for each key.
"""

import math
from typing import Annotated, Literal, Self

from pydantic import AwareDatetime, Field, model_validator

from elliptude.bounds.samples import AVERAGED_OVER_S, VectorSensorBounds
from elliptude.io.toml import Angle, Model, Number, PositiveSize, Quaternion, Size, exactly_one


class AngleBound(Model):
    """A constant angle."""

    kind: Literal["angle"]
    angle_deg: Angle


class AccelerationBound(Model):
    """The bound of an accelerometer, sample by sample, from the largest linear acceleration."""

    kind: Literal["acceleration"]
    acceleration_m_per_s2: Size
    gravity_error_m_per_s2: Size = 0.0


class VelocityWindowBound(Model):
    """The bound of an accelerometer, averaged over windows, from how fast or how far it moves."""

    kind: Literal["velocity_window"]
    windows_s: Annotated[tuple[PositiveSize, ...], Field(min_length=1)]
    velocity_m_per_s: Size | None = None
    position_m: Size | None = None
    # How large the linear acceleration is at most, at any time: no mean.
    acceleration_m_per_s2: Size | None = None
    # How fast the acceleration changes at most, but for a part no larger than a sample's error: for lost samples.
    largest_jerk_m_per_s3: PositiveSize | None = None
    # How far the offset in time drifts within a window at most, steadily; what differs from sample to sample beside
    # that is jitter, and part of the averaged error. If not stated, as far as the bound allows, either way.
    time_offset_change_s: Size | None = None
    gravity_error_m_per_s2: Size = 0.0
    at: Literal["end", "middle"] = "end"

    @property
    def bounds_motion(self) -> bool:
        """Whether it says anything of how the sensor moves, which is else for a measured velocity to say."""
        return any(value is not None for value in (self.velocity_m_per_s, self.position_m, self.acceleration_m_per_s2))


class FieldBound(Model):
    """The bound of a magnetometer, sample by sample, from the largest field beside the reference field."""

    kind: Literal["field"]
    disturbance_ut: Size
    strength_error_ut: Size = 0.0


class AccelerometerError(Model):
    """How far an accelerometer may be off: (I + K) f + e, in axes that are turned."""

    error_m_per_s2: Size = 0.0
    averaged_error_m_per_s2: Size | None = None
    # How long the shortest window is that this is stated for.
    averaged_over_s: Size = AVERAGED_OVER_S
    scale_error: Annotated[Size, Field(lt=1)] = 0.0
    misalignment_deg: Size = 0.0

    def bounds(self) -> VectorSensorBounds:
        """In m/s² and rad."""
        return VectorSensorBounds(
            self.error_m_per_s2,
            self.scale_error,
            math.radians(self.misalignment_deg),
            self.averaged_error_m_per_s2,
            self.averaged_over_s,
        )


class MagnetometerError(Model):
    """How far a magnetometer may be off: (I + K) m + e, in axes that are turned."""

    error_ut: Size = 0.0
    averaged_error_ut: Size | None = None
    # How long the shortest window is that this is stated for.
    averaged_over_s: Size = AVERAGED_OVER_S
    scale_error: Annotated[Size, Field(lt=1)] = 0.0
    misalignment_deg: Size = 0.0

    def bounds(self) -> VectorSensorBounds:
        """In µT and rad."""
        return VectorSensorBounds(
            self.error_ut,
            self.scale_error,
            math.radians(self.misalignment_deg),
            self.averaged_error_ut,
            self.averaged_over_s,
        )


class WorldModel(Model):
    """The Earth's main field by place and date: IGRF, of the package ppigrf."""

    kind: Literal["world_model"]
    latitude_deg: Annotated[Number, Field(ge=-90, le=90)]
    longitude_deg: Annotated[Number, Field(ge=-180, le=360)]
    # From the deepest sea to where currents around the Earth are no small part; WMM is stated for 850 km.
    height_m: Annotated[Number, Field(ge=-11_000.0, le=1_000_000.0)] = 0.0
    date: AwareDatetime


class RestPhase(Model):
    """The field as the log has it while the body rests.

    With the attitude of that time it is turned into the reference frame. Without one, the accelerometer says which way
    is up, and the horizontal part of the field points as far east of north as the declination says: with 0, north
    means magnetic north. In the guaranteed mode its error is that of the sensors there, unless it is stated.
    """

    kind: Literal["rest_phase"]
    from_s: Number
    to_s: Number
    attitude_qw_qx_qy_qz: Quaternion | None = None
    declination_deg: Number | None = None
    # How far that attitude may be off.
    attitude_error_deg: Size = 0.0
    # How fast the accelerometer moves in that time at most; as at other times if it is left out.
    velocity_m_per_s: Size | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        exactly_one(self, "attitude_qw_qx_qy_qz", "declination_deg")
        of_other = "attitude_error_deg" if self.attitude_qw_qx_qy_qz is None else "velocity_m_per_s"
        if of_other in self.model_fields_set:
            other = "attitude_qw_qx_qy_qz" if self.attitude_qw_qx_qy_qz is None else "declination_deg"
            raise ValueError(f"{of_other}: belongs to {other}")
        if not self.from_s < self.to_s:
            raise ValueError("from_s must be before to_s")
        return self


SUN_ERROR_DEG = 0.03
"""How far the Sun by time may be off, seen from up to a geostationary orbit's height, from 1950 to 2050.

The almanac's formula is off by up to 0.008 degrees. It says where the Sun is from the Earth's middle: 0.016 degrees are
the parallax of 42,164 km, 0.0027 that of 7,000 km, and a satellite's own speed adds 0.0015 degrees of aberration there.
"""
# rad/s, in axes that do not turn: 1.02 degrees a day, where the Earth is nearest to the Sun, are 2.06e-7.
SUN_RATE = 2.1e-7


class SunByTime(Model):
    """The Sun by the time of day, in J2000 axes; ``time_zero`` is when the file's clock showed 0."""

    kind: Literal["sun"]
    time_zero: AwareDatetime
