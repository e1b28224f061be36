"""The estimator, its start, and the rule for its bounds, as a configuration states them."""

from typing import Annotated, Any, Literal, Self, TypeAlias, get_args

import numpy as np
from pydantic import Field, model_validator

import elliptude
from elliptude.configuration import rules
from elliptude.configuration.rules import Rule
from elliptude.io.toml import (
    Column,
    Count,
    Diagonal6,
    Model,
    PositiveSize,
    Quaternion,
    SizedBound,
    Vector,
    Vector6,
    exactly_one,
)
from elliptude.typing import FloatArray

Mode: TypeAlias = Literal["paper", "first_order", "guaranteed"]
BestEstimate: TypeAlias = Literal["vqf", "kalman", "center", "none"]
"""Whose estimate stands beside the sets of the guaranteed mode."""
Question: TypeAlias = Literal["reference_turns", "body_turns", "vector", "attitude"]
"""What may be asked by itself after each row of the guaranteed mode; the vector is angular velocity or gyro bias."""


class Estimator(Model):
    """Which estimator, what it minimises, and what it does when sets do not meet."""

    mode: Mode = "first_order"
    # If left out: the volume in the guaranteed mode, the trace in the others.
    criterion: Literal["trace", "weighted_trace", "volume"] = "trace"
    weight_diagonal: Diagonal6 | None = None
    when_sets_do_not_meet: Literal["raise", "skip"] = "raise"
    # For the guaranteed mode.
    policy: Literal["raise", "drop_measurement", "restart", "relaxed"] = "raise"
    most_wrong: Annotated[int, Field(ge=0, le=2)] = 0
    regain_after: Count = 10
    # The estimate beside the set. If left out: VQF's, or the center without it, where gyro, accelerometer and
    # magnetometer are all that is measured; a Kalman filter's for a rigid body; else the center.
    best: BestEstimate | None = None
    # Questions that each row answers by itself, beside tilt, heading and up: columns of the table of results.
    questions: tuple[Question, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _by_mode(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        if table.get("mode", "first_order") not in get_args(Mode):
            return table  # which is said by itself
        guaranteed = table.get("mode") == "guaranteed"
        others = (
            ("when_sets_do_not_meet",) if guaranteed else ("policy", "most_wrong", "regain_after", "best", "questions")
        )
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

    ``rate_rad_per_s`` is the angular velocity, or for a gyro flow the gyro's bias, the whole of it; if it is left out,
    what the flow says is known of that, or zero. P is in rad², rad²/s, rad²/s².
    """

    kind: Literal["given"]
    attitude_qw_qx_qy_qz: Quaternion
    rate_rad_per_s: Vector | None = None
    P_diagonal: Diagonal6 | None = None
    P: tuple[Vector6, Vector6, Vector6, Vector6, Vector6, Vector6] | None = None

    @model_validator(mode="after")
    def _is_a_set(self) -> Self:
        exactly_one(self, "P_diagonal", "P")
        self.build()
        return self

    def build(self, known_bias: FloatArray | None = None) -> elliptude.StateEllipsoid:
        """The core's state ellipsoid; `known_bias`, rad/s, shape (3,), is what is known of the bias of a gyro."""
        quaternion = np.asarray(self.attitude_qw_qx_qy_qz)
        quaternion = quaternion / np.abs(quaternion).max()  # squares of very large or small numbers overflow or vanish
        attitude = elliptude.rotation_from_quaternion(quaternion / np.linalg.norm(quaternion))
        shape = np.diag(self.P_diagonal) if self.P_diagonal is not None else np.asarray(self.P)
        if self.rate_rad_per_s is not None:
            vector = np.asarray(self.rate_rad_per_s)
        else:
            vector = np.zeros(3) if known_bias is None else known_bias
        return elliptude.StateEllipsoid(attitude, vector, shape)


class FirstMeasurementStart(Model):
    """The set that is measured by the log's first row that has two directions or more, and the rate.

    Rows before it are left out. A gyro flow has no measured rate in its state; there the gyro's bias starts within a
    ball about what the flow says is known of it.
    """

    kind: Literal["first_measurement"]
    bias_bound_deg_per_s: SizedBound | None = None


class HandHeldRule(Model):
    """The rule for a sensor in the hand."""

    kind: Literal["hand_held"]
    anchor_s: PositiveSize | None = None

    def rule(self) -> Rule:
        """The rule itself."""
        return rules.hand_held()


class RuleFile(Model):
    """A rule in a file of its own, which a relative name finds beside the configuration."""

    kind: Literal["file"]
    file: Column
    anchor_s: PositiveSize | None = None

    def rule(self) -> Rule:
        """The rule itself."""
        return rules.read_rule(self.file)


class StatedRule(Rule):
    """A rule in the configuration itself."""

    kind: Literal["stated"]
    anchor_s: PositiveSize | None = None

    def rule(self) -> Rule:
        """The rule itself."""
        return self
