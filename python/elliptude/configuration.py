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
"""

import math
import os
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

import elliptude
from elliptude.models import Matrix, Model, Number, Vector, read_toml
from elliptude.results import FloatArray


def _not_zero(vector: tuple[float, ...]) -> tuple[float, ...]:
    if not any(vector):
        raise ValueError("must not be zero")
    return vector


def _different(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        raise ValueError("must name different columns")
    return names


def _one_word(name: str) -> str:
    """Names stand in a table's cell with a space between them."""
    if not name or any(character.isspace() or character in ',"' for character in name):
        raise ValueError("must be one word, without space, comma or quote")
    return name


def _squarable(bound: float) -> float:
    """A bound becomes a shape matrix by its square."""
    if bound != 0.0 and not 1e-150 <= bound <= 1e150:
        raise ValueError("must be from 1e-150 to 1e150, where its square is a number")
    return bound


NonzeroVector = Annotated[Vector, AfterValidator(_not_zero)]
Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_not_zero)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Bound = Annotated[Positive, AfterValidator(_squarable)]
Angle = Annotated[Bound, Field(lt=180)]
NotNegativeBound = Annotated[NotNegative, AfterValidator(_squarable)]
Column = Annotated[str, Field(min_length=1)]
Columns = Annotated[tuple[Column, Column, Column], AfterValidator(_different)]
QuaternionColumns = Annotated[tuple[Column, Column, Column, Column], AfterValidator(_different)]
Diagonal6 = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
Vector6 = tuple[Number, Number, Number, Number, Number, Number]


def _exactly_one(model: Model, *keys: str) -> None:
    """Raise ValueError unless exactly one of the optional keys is given."""
    given = [key for key in keys if getattr(model, key) is not None]
    if len(given) != 1:
        raise ValueError(f"give exactly one of {', '.join(keys)}" + (f", not {' and '.join(given)}" if given else ""))


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


class GyroFlow(Model):
    """Nothing is known of the torques, but a gyro measures the rate; its bias is part of the state."""

    kind: Literal["gyro"]
    columns: Columns
    unit: Literal["rad/s", "deg/s"] = "rad/s"
    # The rate over an interval is the mean of the samples at its ends, or (for a gyro that integrates) the first one.
    interval_rate: Literal["mean_of_ends", "first_sample"] = "mean_of_ends"
    noise_deg_per_s: Bound
    drift_deg_per_s2: NotNegativeBound = 0.0

    def build(self) -> elliptude.GyroFlow:
        """The core's flow."""
        return elliptude.GyroFlow(math.radians(self.noise_deg_per_s), math.radians(self.drift_deg_per_s2))


# --- sensors ----------------------------------------------------------------------------------------------------------


class Direction(Model):
    """A direction measured in body axes, and the same one in reference axes. Rows without it are empty in the log."""

    name: Annotated[str, AfterValidator(_one_word)]
    columns: Columns
    reference: NonzeroVector | None = None
    reference_columns: Columns | None = None
    bound_deg: Angle | None = None
    bound_rad2: Matrix | None = None
    weight: Positive = 1.0

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        _exactly_one(self, "reference", "reference_columns")
        _exactly_one(self, "bound_deg", "bound_rad2")
        return self

    def bound(self) -> FloatArray:
        """The shape (3, 3) of its error ellipsoid, rad²."""
        if self.bound_deg is not None:
            return np.eye(3) * math.radians(self.bound_deg) ** 2
        return np.asarray(self.bound_rad2, dtype=np.float64)


class Rate(Model):
    """A measured angular velocity, body axes. Rows without it are empty in the log."""

    columns: Columns
    unit: Literal["rad/s", "deg/s"] = "rad/s"
    bound_deg_per_s: Bound | None = None
    bound_rad2_per_s2: Matrix | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        _exactly_one(self, "bound_deg_per_s", "bound_rad2_per_s2")
        return self

    def bound(self) -> FloatArray:
        """The shape (3, 3) of its error ellipsoid, (rad/s)²."""
        if self.bound_deg_per_s is not None:
            return np.eye(3) * math.radians(self.bound_deg_per_s) ** 2
        return np.asarray(self.bound_rad2_per_s2, dtype=np.float64)


class Truth(Model):
    """What the log knows to compare with; the estimator never sees it. ``label`` names it in figures."""

    attitude_columns: QuaternionColumns
    vector_columns: Columns | None = None
    label: str = "truth"


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
        _exactly_one(self, "P_diagonal", "P")
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
    """The set that the log's first row measures: two directions or more, and the rate.

    A gyro flow has no measured rate in its state; there the gyro's bias starts within a ball about zero.
    """

    kind: Literal["first_measurement"]
    bias_bound_deg_per_s: Bound | None = None


class Configuration(Model):
    """An estimation."""

    time_column: Column = "time_s"
    flow: Annotated[RigidBodyFlow | GyroFlow, Field(discriminator="kind")]
    directions: tuple[Direction, ...] = ()
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


def read_configuration(path: str | os.PathLike[str]) -> Configuration:
    """Read the configuration in a TOML file.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, or does not fit; with the file and every key at fault.
    """
    return read_toml(path, Configuration)
