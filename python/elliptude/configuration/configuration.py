"""What an estimation needs: which columns of a log are which sensors, how far each may be off, how the body moves.

A configuration is a TOML file. `read_configuration` checks it, and its errors name the file and the key at
fault. Keys name their units. An attitude takes body vectors to the reference frame, quaternions are (qw, qx, qy, qz),
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

``docs/logs.md`` has what the log of a hand-held IMU also needs: units, axes, delays, gravity and the Earth's field as
reference directions, and bounds that come from motion.
"""

import math
import os
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

import elliptude
from elliptude import units
from elliptude.bounds.gyro import GyroBounds
from elliptude.configuration import rules
from elliptude.configuration.rules import Rule
from elliptude.configuration.sensors import (
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
from elliptude.io.toml import (
    Bound,
    Column,
    Columns,
    Diagonal6,
    Matrix,
    Model,
    NotNegative,
    NotNegativeBound,
    Positive,
    Quaternion,
    Vector,
    Vector6,
    exactly_one,
    read_toml,
)
from elliptude.typing import FloatArray

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
    # For the guaranteed mode: how far the inertia may be off (spectral norm), and the momentum of wheels within the
    # body, N m s, body axes, each row until its time.
    inertia_error_kg_m2: NotNegative = 0.0
    # A prediction over more steps is refused: such a time is more likely an error than intended.
    most_steps: Annotated[int, Field(ge=1)] = 1_000_000
    wheel_momentum_columns: Columns | None = None

    @model_validator(mode="after")
    def _is_a_body(self) -> Self:
        self.build()
        return self

    def guaranteed(self) -> elliptude.GuaranteedRigidBodyFlow:
        """The core's guaranteed flow."""
        inertia = np.asarray(self.inertia_kg_m2)
        body = elliptude.RigidBody(np.diag(inertia) if inertia.ndim == 1 else inertia)
        return elliptude.GuaranteedRigidBodyFlow(
            body,
            self.potential.build(body),
            step=self.step_s,
            unknown_torque=self.unknown_torque_n_m or None,
            inertia_error=self.inertia_error_kg_m2,
            most_steps=self.most_steps,
        )

    def build(self) -> elliptude.RigidBodyFlow:
        """The core's flow."""
        inertia = np.asarray(self.inertia_kg_m2)
        body = elliptude.RigidBody(np.diag(inertia) if inertia.ndim == 1 else inertia)
        potential = self.potential.build(body)
        unknown_torque = self.unknown_torque_n_m or None
        return elliptude.RigidBodyFlow(
            body,
            potential,
            step=self.step_s,
            order=self.order,
            unknown_torque=unknown_torque,
            most_steps=self.most_steps,
        )


class GyroFlow(Timed):
    """The torques are not known, but a gyro measures the rate; its bias is part of the state."""

    kind: Literal["gyro"]
    columns: Columns
    unit: units.AngularVelocityUnit = "rad/s"
    axes: Axes = ("x", "y", "z")
    # The rate over an interval is the mean of the samples at its ends, or (for a gyro that integrates) the first one.
    # Between its samples, at another sensor's stamp, it is on the straight line, or still the one before.
    interval_rate: Literal["mean_of_ends", "first_sample"] = "mean_of_ends"
    noise_deg_per_s: Bound | None = None
    drift_deg_per_s2: NotNegativeBound = 0.0
    # For the guaranteed mode.
    # A known bias is subtracted; what is left of it is at most the bias bound. It is an error like noise, or it
    # may be estimated if it moves no faster than the drift says (a bias that depends on the pose moves faster).
    known_bias_deg_per_s: Vector = (0.0, 0.0, 0.0)
    bias_deg_per_s: NotNegative = 0.0
    estimate_bias: bool = False
    scale_error: Annotated[NotNegative, Field(lt=1)] = 0.0
    # How fast the rate changes between samples, if that is not part of the noise.
    angular_acceleration_deg_per_s2: NotNegative = 0.0
    # The longest interval between samples that all of this covers; 1.5 times the usual one if left out. About a longer
    # one only the largest rate of the body is known; without that the attitude is forgotten.
    longest_interval_s: Positive | None = None
    largest_rate_deg_per_s: Positive | None = None
    # Bound of the noise's integral over any window; predictions span windows of this length, each from an anchor.
    increment_deg: Positive | None = None
    anchor_s: Positive | None = None

    @model_validator(mode="after")
    def _predicts_over_windows(self) -> Self:
        if self.increment_deg is not None and self.anchor_s is None:
            raise ValueError("increment_deg needs anchor_s, the length of the windows that a prediction spans")
        if self.anchor_s is not None and self.estimate_bias:
            raise ValueError("estimate_bias does not go with anchor_s: over a window the bias is an error of the turn")
        if self.anchor_s is not None and self.angular_acceleration_deg_per_s2:
            raise ValueError("angular_acceleration_deg_per_s2 does not go with anchor_s: take it into the noise")
        if self.anchor_s is not None and self.interval_rate != "mean_of_ends":
            raise ValueError("anchor_s needs interval_rate = 'mean_of_ends'")
        if self.estimate_bias and not self.bias_deg_per_s:
            raise ValueError("estimate_bias needs bias_deg_per_s, the bound of the bias")
        return self

    def bounds(self) -> GyroBounds:
        """Error bounds of the gyro, in SI units."""
        assert self.noise_deg_per_s is not None  # the configuration's check
        return GyroBounds(
            noise=math.radians(self.noise_deg_per_s),
            bias=math.radians(self.bias_deg_per_s),
            drift=math.radians(self.drift_deg_per_s2),
            scale_error=self.scale_error,
            increment=math.inf if self.increment_deg is None else math.radians(self.increment_deg),
            longest_interval=math.inf if self.longest_interval_s is None else self.longest_interval_s,
            largest_rate=math.inf if self.largest_rate_deg_per_s is None else math.radians(self.largest_rate_deg_per_s),
        )

    def build(self) -> elliptude.GyroFlow:
        """The core's flow."""
        assert self.noise_deg_per_s is not None  # the configuration's check
        return elliptude.GyroFlow(math.radians(self.noise_deg_per_s), math.radians(self.drift_deg_per_s2))


# --- the estimator ----------------------------------------------------------------------------------------------------


class Estimator(Model):
    """Which estimator, what it minimises, and what it does when sets do not meet."""

    mode: Literal["paper", "first_order", "guaranteed"] = "first_order"
    # If left out: the volume in the guaranteed mode, the trace in the others.
    criterion: Literal["trace", "weighted_trace", "volume"] = "trace"
    weight_diagonal: Diagonal6 | None = None
    when_sets_do_not_meet: Literal["raise", "skip"] = "raise"
    # For the guaranteed mode.
    policy: Literal["raise", "drop_measurement", "restart", "relaxed"] = "raise"
    most_wrong: Annotated[int, Field(ge=0, le=2)] = 0
    regain_after: Annotated[int, Field(ge=1)] = 10

    @model_validator(mode="before")
    @classmethod
    def _by_mode(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        guaranteed = table.get("mode") == "guaranteed"
        others = ("when_sets_do_not_meet",) if guaranteed else ("policy", "most_wrong", "regain_after")
        for key in others:
            if key in table:
                raise ValueError(
                    f"{key} is not of mode = 'guaranteed'" if guaranteed else f"{key} needs mode = 'guaranteed'"
                )
        return {"criterion": "volume"} | table if guaranteed else table

    @model_validator(mode="after")
    def _tolerates_what_it_says(self) -> Self:
        if (self.policy == "relaxed") != (self.most_wrong > 0):
            raise ValueError("most_wrong, 1 or 2, belongs to policy = 'relaxed', which needs it")
        return self

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
        quaternion = quaternion / np.abs(quaternion).max()  # squares of very large or small numbers overflow or vanish
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


_SAID_OF_A_RULES_SENSOR = {"kind", "name", "columns", "unit", "axes", "at_rest"}


class HandHeldRule(Model):
    """The rule for a sensor in the hand."""

    kind: Literal["hand_held"]
    anchor_s: Positive | None = None

    def rule(self) -> Rule:
        """The rule itself."""
        return rules.hand_held()


class RuleFile(Model):
    """A rule in a file of its own, which a relative name finds beside the configuration."""

    kind: Literal["file"]
    file: Column
    anchor_s: Positive | None = None

    def rule(self) -> Rule:
        """The rule itself."""
        return rules.read_rule(self.file)


class StatedRule(Rule):
    """A rule in the configuration itself."""

    kind: Literal["stated"]
    anchor_s: Positive | None = None

    def rule(self) -> Rule:
        """The rule itself."""
        return self


class Configuration(Model):
    """An estimation."""

    time_column: Column = "time_s"
    time_unit: units.TimeUnit = "s"
    timing: Timing = Timing()
    reference_frame: ReferenceFrame | None = None
    # What to do if sensors contradict one another as they do when a unit or an order is stated wrongly.
    implausible: Literal["refuse", "ignore"] = "refuse"
    flow: Annotated[RigidBodyFlow | GyroFlow, Field(discriminator="kind")]
    directions: tuple[AnyDirection, ...] = ()
    rate: Rate | None = None
    # The recording that the bounds are proposals from; removed once there is a reason for each.
    bounds_from_recording: str | None = None
    # Bounds of an inertial sensor by a rule for all recordings of its kind; the guaranteed mode alone.
    rule: Annotated[HandHeldRule | RuleFile | StatedRule, Field(discriminator="kind")] | None = None
    # The guaranteed mode starts from nothing if it is left out.
    start: Annotated[GivenStart | FirstMeasurementStart, Field(discriminator="kind")] | None = None
    estimator: Estimator = Estimator()
    truth: Truth | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [direction.name for direction in self.directions]
        if len(set(names)) < len(names):
            raise ValueError("directions must have different names")
        if "rate" in names:
            raise ValueError("directions: the name 'rate' is that of the measured angular velocity")
        if self.rule is not None and self.estimator.mode != "guaranteed":
            raise ValueError("rule needs estimator.mode = 'guaranteed'")
        if self.start is None and self.estimator.mode != "guaranteed":
            raise ValueError("start: missing; the guaranteed mode alone needs none")
        if self.estimator.mode == "guaranteed" and isinstance(self.start, FirstMeasurementStart):
            raise ValueError(
                "start.kind = 'first_measurement' is what the guaranteed mode does where start is left out; "
                "flow.bias_deg_per_s bounds a gyro's bias"
            )
        if isinstance(self.flow, GyroFlow) and self.rate is not None:
            raise ValueError("rate: the gyro of flow.kind = 'gyro' is its input; it cannot be a measurement too")
        if not isinstance(self.start, FirstMeasurementStart):
            return self
        if isinstance(self.flow, GyroFlow):
            if self.start.bias_bound_deg_per_s is None:
                raise ValueError("start.bias_bound_deg_per_s is needed to start a gyro flow from the first measurement")
        elif self.rate is None:
            raise ValueError("start.kind = 'first_measurement' needs a rate beside the directions")
        elif self.start.bias_bound_deg_per_s is not None:
            raise ValueError("start.bias_bound_deg_per_s belongs to flow.kind = 'gyro'")
        if len(self.directions) < 2:
            raise ValueError("start.kind = 'first_measurement' needs two directions or more")
        return self

    @model_validator(mode="after")
    def _has_the_bounds_it_needs(self) -> Self:
        if self.rule is not None:
            self._require_what_a_rule_is_of()
            return self
        if isinstance(self.flow, GyroFlow) and self.flow.noise_deg_per_s is None:
            raise ValueError("flow.noise_deg_per_s: missing")
        for i, sensor in enumerate(self.directions):
            try:
                sensor.require_complete()
            except ValueError as error:
                raise ValueError(f"directions[{i}]: {error}") from error
        return self

    def _require_what_a_rule_is_of(self) -> None:
        if self.start is not None:
            raise ValueError("start: a rule says how a recording starts")
        if self.reference_frame not in {None, "ENU"}:
            raise ValueError("reference_frame: a rule's is ENU, with magnetic north where the recording starts")
        given = self.flow.model_fields_set - _SAID_OF_A_RULES_SENSOR
        if not isinstance(self.flow, GyroFlow) or given:
            raise ValueError(
                "flow: a rule is of a gyro, kind = 'gyro'"
                if not isinstance(self.flow, GyroFlow)
                else f"flow.{min(given)}: is for the rule to say"
            )
        kinds = sorted(sensor.kind for sensor in self.directions)
        if kinds not in (["accelerometer"], ["accelerometer", "magnetometer"]):
            raise ValueError("directions: a rule is of one accelerometer and, if there is one, one magnetometer")
        for i, sensor in enumerate(self.directions):
            if given := sensor.model_fields_set - _SAID_OF_A_RULES_SENSOR:
                raise ValueError(f"directions[{i}].{min(given)}: is for the rule to say")

    @model_validator(mode="after")
    def _has_the_frame_it_needs(self) -> Self:
        for i, sensor in enumerate(self.directions):
            reference = sensor.reference if isinstance(sensor, Direction | Magnetometer) else None
            by_gravity = isinstance(reference, RestPhase) and reference.attitude_qw_qx_qy_qz is None
            if by_gravity and self.accelerometer is None:
                raise ValueError(f"directions[{i}]: a rest phase without an attitude needs an accelerometer")
            on_earth = (
                (self.rule is None and isinstance(sensor, Accelerometer))
                or isinstance(reference, WorldModel)
                or by_gravity
            )
            if on_earth and self.reference_frame not in {"ENU", "NED", "NWU"}:
                raise ValueError(f"directions[{i}] ({sensor.name}) needs reference_frame = 'ENU', 'NED' or 'NWU'")
            if isinstance(reference, SunByTime) and self.reference_frame != "J2000":
                raise ValueError(f"directions[{i}] ({sensor.name}): the Sun by time needs reference_frame = 'J2000'")
        return self

    @property
    def proposed_from(self) -> str | None:
        """The recording that the bounds are proposals from, here or in the file of a rule."""
        of_rule = None if self.rule is None else self.rule.rule().bounds_from_recording
        return self.bounds_from_recording or of_rule

    @property
    def truth_error(self) -> float:
        """How far the truth may itself be off, rad."""
        return 0.0 if self.truth is None else math.radians(self.truth.error_deg)

    @property
    def estimates_vector(self) -> bool:
        """Whether angular velocity or gyro bias is estimated; the guaranteed mode may treat the bias as an error."""
        is_error = isinstance(self.flow, GyroFlow) and not self.flow.estimate_bias
        return not (is_error and self.estimator.mode == "guaranteed")

    @property
    def compares_vector(self) -> bool:
        """Whether forms include the vector, if its truth is known."""
        return self.estimates_vector and self.truth_error == 0.0

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
    configuration = read_toml(path, Configuration)
    if not isinstance(configuration.rule, RuleFile):
        return configuration
    beside = configuration.rule.model_copy(update={"file": str(Path(path).parent / configuration.rule.file)})
    beside.rule()
    return configuration.model_copy(update={"rule": beside})
