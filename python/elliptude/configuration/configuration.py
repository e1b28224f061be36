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

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self, get_args

from pydantic import model_validator

from elliptude.configuration.calibration import (
    CalibrationFile,
)
from elliptude.configuration.estimator import (
    BestEstimate,
    FirstMeasurementStart,
    Question,
    RuleFile,
)
from elliptude.configuration.motion import EARTHS_FRAMES, GyroFlow, RigidBodyFlow
from elliptude.configuration.rest_reference import why_rest_is_open
from elliptude.configuration.sensors import (
    Accelerometer,
    AnyDirection,
    Direction,
    Magnetometer,
)
from elliptude.configuration.statements import RestPhase, SunByTime, VelocityWindowBound, WorldModel
from elliptude.configuration.tables import AllTables
from elliptude.io.files import FileError
from elliptude.io.readers.counted import ROW_TIME
from elliptude.io.toml import load_toml, validate

_NAMES_OF_OTHERS = {
    "rate": "the measured angular velocity",
    "gyro": "the gyro",
    "velocity": "the measured velocity",
    "true_attitude": "the truth",
}
_SAID_OF_A_RULES_SENSOR = {
    "kind",
    "name",
    "columns",
    "unit",
    "unit_ut",
    "axes",
    "at_rest",
    "time_column",
    "time_unit",
}


class Configuration(AllTables):
    """An estimation."""

    @model_validator(mode="before")
    @classmethod
    def _takes_times_by_rows(cls, given: Any) -> Any:
        timing = given.get("timing") if isinstance(given, dict) else None
        if not isinstance(timing, dict) or timing.get("row_rate_hz") is None:
            return given
        if given.get("time_column", ROW_TIME) != ROW_TIME:
            raise ValueError("timing.row_rate_hz is for a file without times: leave it or time_column out")
        return given | {"time_column": ROW_TIME, "time_unit": "s"}

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [direction.name for direction in self.directions]
        if len(set(names)) < len(names):
            raise ValueError("directions must have different names")
        for name, other in _NAMES_OF_OTHERS.items():
            if name in names:
                raise ValueError(f"directions: the name {name!r} is that of {other}")
        if self.rule is not None and self.estimator.mode != "guaranteed":
            raise ValueError("rule needs estimator.mode = 'guaranteed'")
        if self.start is None and self.estimator.mode != "guaranteed":
            raise ValueError("start: missing; the guaranteed mode alone needs none")
        from_first = self.start if isinstance(self.start, FirstMeasurementStart) else None
        is_guaranteed = self.estimator.mode == "guaranteed"
        if is_guaranteed and from_first is not None and from_first.bias_bound_deg_per_s is not None:
            raise ValueError(
                "start.bias_bound_deg_per_s is not for the guaranteed mode: flow.bias_deg_per_s bounds a gyro's bias"
            )
        self._require_answers()
        if not is_guaranteed and self.truth is not None and self.truth.time_offset_bound_s > 0.0:
            raise ValueError(
                "truth.time_offset_bound_s is for the guaranteed mode: in the others nothing bounds how far the body "
                "turns meanwhile. Leave it out, and state in truth.error_deg how far the truth may be off"
            )
        if isinstance(self.flow, GyroFlow) and self.rate is not None:
            raise ValueError("rate: the gyro of flow.kind = 'gyro' is its input; it cannot be a measurement too")
        if is_guaranteed or from_first is None:
            return self
        if isinstance(self.flow, GyroFlow):
            if from_first.bias_bound_deg_per_s is None:
                raise ValueError("start.bias_bound_deg_per_s is needed to start a gyro flow from the first measurement")
        elif self.rate is None:
            raise ValueError("start.kind = 'first_measurement' needs a rate beside the directions")
        elif from_first.bias_bound_deg_per_s is not None:
            raise ValueError("start.bias_bound_deg_per_s belongs to flow.kind = 'gyro'")
        if len(self.directions) < 2:
            raise ValueError("start.kind = 'first_measurement' needs two directions or more")
        return self

    @model_validator(mode="after")
    def _has_the_bounds_it_needs(self) -> Self:
        if self.rule is not None:
            self._require_what_a_rule_is_of()
            return self
        if self.velocity is not None and not any(
            isinstance(sensor.bound_from, VelocityWindowBound) for sensor in self.directions
        ):
            raise ValueError(
                "velocity: is for an accelerometer with bound_from.kind = 'velocity_window', or a rule; there is none"
            )
        if isinstance(self.flow, GyroFlow) and self.flow.noise_deg_per_s is None:
            raise ValueError("flow.noise_deg_per_s: missing")
        for i, sensor in enumerate(self.directions):
            try:
                sensor.require_complete()
            except ValueError as error:
                raise ValueError(f"directions[{i}]: {error}") from error
            self._require_how_fast_a_reference_moves(i, sensor)
            missing = why_rest_is_open(sensor, self.accelerometer)
            if missing is not None and self.estimator.mode == "guaranteed":
                raise ValueError(f"directions[{i}]: {missing}")
            if not isinstance(sensor.bound_from, VelocityWindowBound):
                continue
            needs = f"directions[{i}] ({sensor.name}): bound_from.kind = 'velocity_window' needs"
            if isinstance(self.flow, RigidBodyFlow):
                raise ValueError(
                    f"{needs} a gyro: windows carry a frame along with rates on lines, but torques turn a rigid body "
                    "between the measurements of its rate. Use bound_from.kind = 'acceleration' or bound_deg, or "
                    "flow.kind = 'gyro'"
                )
            if self.flow.interval_rate != "mean_of_ends":
                raise ValueError(
                    f"{needs} flow.interval_rate = 'mean_of_ends', as windows carry a frame along with rates on lines"
                )
            if not sensor.bound_from.bounds_motion and self.velocity is None:
                raise ValueError(
                    f"{needs} one or more of velocity_m_per_s, position_m, acceleration_m_per_s2, or a measured "
                    "[velocity]"
                )
        return self

    def _require_how_fast_a_reference_moves(self, i: int, sensor: AnyDirection) -> None:
        if self.estimator.mode != "guaranteed" or not isinstance(sensor, Direction):
            return
        moves = sensor.reference_columns is not None and sensor.reference_rate_deg_per_s is None
        if moves and self.time_offset_of(sensor) > 0.0:
            raise ValueError(
                f"directions[{i}] ({sensor.name}): reference_rate_deg_per_s: missing; with reference_columns a "
                "time_offset_bound_s, its own or the gyro's, needs how fast the reference turns at most, in reference "
                "axes (0 for stars)"
            )

    def _require_what_a_rule_is_of(self) -> None:
        if self.start is not None:
            raise ValueError("start: a rule says how a recording starts")
        if self.carried is not None:
            raise ValueError("carried: is for the rule to say")
        if self.estimator.policy == "relaxed":
            raise ValueError(
                "estimator.policy: 'relaxed' is not for a rule: it has one accelerometer and at most one magnetometer, "
                "and if either may be wrong, no attitude is left to begin with. Use 'drop_measurement' or 'restart'"
            )
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
            if by_gravity and self.estimator.policy == "relaxed":
                raise ValueError(
                    f"directions[{i}] ({sensor.name}).reference: a rest phase without an attitude takes up from the "
                    "accelerometer, so that this one sensor makes two measurements wrong, and estimator.policy = "
                    "'relaxed' counts each. State attitude_qw_qx_qy_qz, or reference_ut"
                )
            on_earth = (
                (self.rule is None and isinstance(sensor, Accelerometer))
                or isinstance(reference, WorldModel)
                or by_gravity
            )
            if on_earth and self.reference_frame not in EARTHS_FRAMES:
                raise ValueError(f"directions[{i}] ({sensor.name}) needs reference_frame = 'ENU', 'NED' or 'NWU'")
            if isinstance(reference, SunByTime) and self.reference_frame != "J2000":
                raise ValueError(f"directions[{i}] ({sensor.name}): the Sun by time needs reference_frame = 'J2000'")
        is_guaranteed = self.estimator.mode == "guaranteed" and self.rule is None
        if is_guaranteed and isinstance(self.flow, GyroFlow) and self.reference_frame in EARTHS_FRAMES:
            windows = [sensor.bound_from for sensor in self.directions]
            longest = [max(one.windows_s) for one in windows if isinstance(one, VelocityWindowBound)]
            self.flow.require_earth_rate(max(longest, default=0.0))
        return self

    def with_best(self, best: BestEstimate) -> Self:
        """The same with another choice of the estimate beside the sets."""
        return self.model_copy(update={"estimator": self.estimator.model_copy(update={"best": best})})

    def with_questions(self, questions: Sequence[str]) -> Self:
        """The same with other questions that each row of the guaranteed mode answers by itself.

        Raises
        ------
        ValueError
            If there is no such question, or the estimator does not answer it.
        """
        known: tuple[Question, ...] = get_args(Question)
        for name in questions:
            if name not in known:
                raise ValueError(f"questions: {name!r} is none of {', '.join(known)}")
        asking = self.estimator.model_copy(update={"questions": tuple(questions)})
        changed = self.model_copy(update={"estimator": asking})
        changed._require_answers()
        return changed

    def _require_answers(self) -> None:
        if self.estimator.questions and self.estimator.mode != "guaranteed":
            raise ValueError("estimator.questions: needs mode = 'guaranteed'")
        if "vector" in self.estimator.questions and not self.estimates_vector:
            raise ValueError(
                "estimator.questions: 'vector' asks for the gyro's bias, which is not estimated here but counts as an "
                "error (flow.estimate_bias)"
            )


# What an estimation needs and the attitudes of a file do not: it is not used.
_OF_ANY_GYRO = {"kind": "gyro", "columns": ["x", "y", "z"], "noise_deg_per_s": 1.0}


def read_configuration_of_truth(path: str | os.PathLike[str]) -> Configuration:
    """Read a configuration that is for the attitudes of a file alone: without ``flow`` it need not say how to estimate.

    Raises
    ------
    FileError
        As `read_configuration`.
    """
    tables = load_toml(path)
    if "flow" in tables or "truth" not in tables:
        return read_configuration(path)
    return validate(path, {"flow": _OF_ANY_GYRO, "estimator": {"mode": "guaranteed"}} | tables, Configuration)


def read_configuration(path: str | os.PathLike[str]) -> Configuration:
    """Read the configuration in a TOML file.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, or does not fit; with the file and every key at fault.
    """
    tables = load_toml(path)
    if "flow" not in tables and tables.keys() >= {"rest", "motion"}:
        raise FileError(
            f"{path}: a rule for bounds, and no configuration; one names it by [rule] with kind = 'file' and file = "
            f"{str(path)!r} (docs/logs.md), and `elliptude bounds LOG --out FILE` writes one"
        )
    configuration = validate(path, tables, Configuration)
    if isinstance(configuration.calibration, CalibrationFile):
        found = configuration.calibration.beside(path)
        found.calibration()
        configuration = configuration.model_copy(update={"calibration": found})
    if configuration.calibration is not None:
        try:
            used = [configuration._calibration_of(sensor) for sensor in configuration.directions]
            configuration.gyro_correction()
        except ValueError as error:
            raise FileError(f"{path}: {error}") from error
        if not any(used):
            columns = "; ".join(", ".join(one.columns) for one in configuration.calibration.calibration().sensors)
            raise FileError(f"{path}: calibration: of no sensor of this configuration, but of {columns}")
    if not isinstance(configuration.rule, RuleFile):
        return configuration
    beside = configuration.rule.model_copy(update={"file": str(Path(path).parent / configuration.rule.file)})
    try:
        beside.rule()
    except FileError as error:
        raise FileError(f"{path}: rule.file: {error}") from error
    return configuration.model_copy(update={"rule": beside})
