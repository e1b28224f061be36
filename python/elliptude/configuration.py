"""What an estimation is made of: which columns of a log are which sensors, how far each may err, how the body moves.

A configuration is a TOML file; `read_configuration` checks it and names the file and the key of whatever is wrong with
it. Units are part of the keys. An attitude takes body vectors to the reference frame, quaternions are (qw, qx, qy, qz),
and an error bound given as one angle is a ball's radius.

An example::

    [flow]
    kind = "rigid_body"
    inertia_kg_m2 = [0.13, 0.28, 0.17]
    step_s = 0.005
    order = 4
    potential = { kind = "uniform_gravity", mass_kg = 1.0, gravity_m_per_s2 = 9.81, center_of_mass_m = [0.0, 0.0, 0.3] }

    [[directions]]
    name = "sun"
    columns = ["sun_x", "sun_y", "sun_z"]
    reference = [1.0, 0.0, 0.0]
    bound_deg = 7.0

    [[directions]]
    name = "field"
    columns = ["field_x", "field_y", "field_z"]
    reference_columns = ["model_x", "model_y", "model_z"]
    bound_deg = 7.0

    [rate]
    columns = ["wx", "wy", "wz"]
    bound_deg_per_s = 7.0

    [start]
    kind = "first_measurement"

What the log of a hand-held IMU needs beside this, units, axes, delays, gravity and the Earth's field as references and
bounds that come from motion, is in ``docs/logs.md``.
"""

import math
import os
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

import elliptude
from elliptude import units
from elliptude.models import (
    Bound,
    Column,
    Columns,
    Diagonal6,
    Matrix,
    Model,
    NotNegativeBound,
    Positive,
    Quaternion,
    Vector,
    Vector6,
    exactly_one,
    read_toml,
)
from elliptude.results import FloatArray
from elliptude.sensors import (
    Accelerometer,
    AnyDirection,
    Axes,
    Direction,
    Magnetometer,
    Rate,
    ReferenceFrame,
    RestPhase,
    SunByTime,
    Timed,
    Timing,
    Truth,
    WorldModel,
)

# --- how the body moves -----------------------------------------------------------------------------------------------


class FreeBody(Model):
    """No torque."""

    kind: Literal["free"] = "free"

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.FreeBody()


class UniformGravity(Model):
    """A pendulum about a fixed point; the reference frame's third axis points down."""

    kind: Literal["uniform_gravity"]
    mass_kg: Positive
    gravity_m_per_s2: Positive
    center_of_mass_m: Vector

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.UniformGravity(self.mass_kg, self.gravity_m_per_s2, self.center_of_mass_m)


class GravityGradient(Model):
    """A spacecraft on a circular orbit; the reference frame's first two axes span it, the first points up at time 0."""

    kind: Literal["gravity_gradient"]
    orbit_rate_rad_per_s: Positive

    def build(self, body: elliptude.RigidBody) -> elliptude.Potential:
        """The core's potential."""
        return elliptude.GravityGradient(body, self.orbit_rate_rad_per_s)


class RigidBodyFlow(Model):
    """The body's inertia and the torques on it are known; angular velocity is part of the state."""

    kind: Literal["rigid_body"]
    inertia_kg_m2: Vector | Matrix
    step_s: Positive
    order: Literal[2, 4, 6, 8] = 2
    potential: Annotated[FreeBody | UniformGravity | GravityGradient, Field(discriminator="kind")] = FreeBody()
    unknown_torque_n_m: NotNegativeBound = 0.0
    control_torque_columns: Columns | None = None

    @model_validator(mode="after")
    def _is_a_body(self) -> Self:
        self.build()
        return self

    def build(self) -> elliptude.RigidBodyFlow:
        """The core's flow."""
        inertia = np.asarray(self.inertia_kg_m2)
        body = elliptude.RigidBody(np.diag(inertia) if inertia.ndim == 1 else inertia)
        potential = self.potential.build(body)
        unknown_torque = self.unknown_torque_n_m or None
        return elliptude.RigidBodyFlow(
            body, potential, step=self.step_s, order=self.order, unknown_torque=unknown_torque
        )


class GyroFlow(Timed):
    """Nothing is known of the torques, but a gyro measures the rate; its bias is part of the state."""

    kind: Literal["gyro"]
    columns: Columns
    unit: units.AngularVelocityUnit = "rad/s"
    axes: Axes = ("x", "y", "z")
    # The rate over an interval is the mean of the samples at its ends, or (for a gyro that integrates) the first one.
    # Between its samples, at another sensor's stamp, it is on the straight line, or still the one before.
    interval_rate: Literal["mean_of_ends", "first_sample"] = "mean_of_ends"
    noise_deg_per_s: Bound
    drift_deg_per_s2: NotNegativeBound = 0.0

    def build(self) -> elliptude.GyroFlow:
        """The core's flow."""
        return elliptude.GyroFlow(math.radians(self.noise_deg_per_s), math.radians(self.drift_deg_per_s2))


# --- the estimator ----------------------------------------------------------------------------------------------------


class Estimator(Model):
    """Which estimator, what it minimises, and what it does when sets do not meet."""

    mode: Literal["paper", "first_order"] = "first_order"
    criterion: Literal["trace", "weighted_trace", "volume"] = "trace"
    weight_diagonal: Diagonal6 | None = None
    when_sets_do_not_meet: Literal["raise", "skip"] = "raise"

    @model_validator(mode="after")
    def _weighs_what_it_weighs(self) -> Self:
        if (self.criterion == "weighted_trace") != (self.weight_diagonal is not None):
            raise ValueError("weight_diagonal belongs to criterion = 'weighted_trace', which needs it")
        return self

    def weight(self) -> FloatArray | None:
        """The weight matrix (6, 6), if there is one."""
        return None if self.weight_diagonal is None else np.diag(self.weight_diagonal)


class GivenStart(Model):
    """A set given beforehand, which must hold the state at the log's first time.

    ``rate_rad_per_s`` is the angular velocity, or the gyro's bias for a gyro flow. P is in rad², rad²/s, rad²/s².
    """

    kind: Literal["given"]
    attitude_qw_qx_qy_qz: Quaternion
    rate_rad_per_s: Vector = (0.0, 0.0, 0.0)
    P_diagonal: Diagonal6 | None = None
    P: tuple[Vector6, Vector6, Vector6, Vector6, Vector6, Vector6] | None = None

    @model_validator(mode="after")
    def _is_a_set(self) -> Self:
        exactly_one(self, "P_diagonal", "P")
        self.build()
        return self

    def build(self) -> elliptude.StateEllipsoid:
        """The core's state ellipsoid."""
        quaternion = np.asarray(self.attitude_qw_qx_qy_qz)
        quaternion = quaternion / np.abs(quaternion).max()  # or squares of very large or small numbers are none
        attitude = elliptude.rotation_from_quaternion(quaternion / np.linalg.norm(quaternion))
        shape = np.diag(self.P_diagonal) if self.P_diagonal is not None else np.asarray(self.P)
        return elliptude.StateEllipsoid(attitude, self.rate_rad_per_s, shape)


class FirstMeasurementStart(Model):
    """The set that is measured by the log's first row that has two directions or more, and the rate.

    Rows before it are left out. A gyro flow has no measured rate in its state; there the gyro's bias starts within a
    ball about zero.
    """

    kind: Literal["first_measurement"]
    bias_bound_deg_per_s: Bound | None = None


class Configuration(Model):
    """An estimation."""

    time_column: Column = "time_s"
    time_unit: units.TimeUnit = "s"
    timing: Timing = Timing()
    reference_frame: ReferenceFrame | None = None
    # What is done where sensors contradict one another as they do when a unit or an order is stated wrongly.
    implausible: Literal["refuse", "ignore"] = "refuse"
    flow: Annotated[RigidBodyFlow | GyroFlow, Field(discriminator="kind")]
    directions: tuple[AnyDirection, ...] = ()
    rate: Rate | None = None
    start: Annotated[GivenStart | FirstMeasurementStart, Field(discriminator="kind")]
    estimator: Estimator = Estimator()
    truth: Truth | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [direction.name for direction in self.directions]
        if len(set(names)) < len(names):
            raise ValueError("directions must have different names")
        if "rate" in names:
            raise ValueError("directions: the name 'rate' is that of the measured angular velocity")
        if isinstance(self.flow, GyroFlow):
            if self.rate is not None:
                raise ValueError("rate: the gyro of flow.kind = 'gyro' is its input; it cannot be a measurement too")
            if self.start.kind == "first_measurement" and self.start.bias_bound_deg_per_s is None:
                raise ValueError("start.bias_bound_deg_per_s is needed to start a gyro flow from the first measurement")
        elif self.start.kind == "first_measurement":
            if self.rate is None:
                raise ValueError("start.kind = 'first_measurement' needs a rate beside the directions")
            if self.start.bias_bound_deg_per_s is not None:
                raise ValueError("start.bias_bound_deg_per_s belongs to flow.kind = 'gyro'")
        if self.start.kind == "first_measurement" and len(self.directions) < 2:
            raise ValueError("start.kind = 'first_measurement' needs two directions or more")
        return self

    @model_validator(mode="after")
    def _has_the_frame_it_needs(self) -> Self:
        for i, sensor in enumerate(self.directions):
            reference = sensor.reference if isinstance(sensor, Direction | Magnetometer) else None
            by_gravity = isinstance(reference, RestPhase) and reference.attitude_qw_qx_qy_qz is None
            if by_gravity and self.accelerometer is None:
                raise ValueError(f"directions[{i}]: a rest phase without an attitude needs an accelerometer")
            on_earth = isinstance(sensor, Accelerometer) or isinstance(reference, WorldModel) or by_gravity
            if on_earth and self.reference_frame not in {"ENU", "NED", "NWU"}:
                raise ValueError(f"directions[{i}] ({sensor.name}) needs reference_frame = 'ENU', 'NED' or 'NWU'")
            if isinstance(reference, SunByTime) and self.reference_frame != "J2000":
                raise ValueError(f"directions[{i}] ({sensor.name}): the Sun by time needs reference_frame = 'J2000'")
        return self

    @property
    def accelerometer(self) -> Accelerometer | None:
        """The first one among the directions."""
        return next((sensor for sensor in self.directions if isinstance(sensor, Accelerometer)), None)


def read_configuration(path: str | os.PathLike[str]) -> Configuration:
    """Read the configuration in a TOML file.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, or does not fit; with the file and every key at fault.
    """
    return read_toml(path, Configuration)
